"""The page in a real browser: offline, under its content policy, by keyboard, on a phone, in the dark, without scripts.

A missing browser skips these tests and says so; with CROSSCHECK_REQUIRE_BROWSER=1, as in the checks of every change, it
fails them.
"""

from __future__ import annotations

import json
import math
import os
import shutil
from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path
from typing import Any

import pytest

from crosscheck.judge.records import plain
from crosscheck.measure.check import check
from crosscheck.night.sections import pictures, write_documents
from crosscheck.scenes.conformance import questions
from refkin import FourBar, SliderCrank
from refkin.scenes.files import to_dict
from tests.linkages import ROCKER

from . import space_scenes
from .report_records import built, case, disagreement, outcome, write
from .test_report_sections import EFFECTS, HARD, PRICES

REQUIRED = os.environ.get("CROSSCHECK_REQUIRE_BROWSER") == "1"
NAMES = ("chromium", "chromium-browser", "google-chrome")
DOT = "data:image/gif;base64,R0lGODdhAQABAIAAAP///////ywAAAAAAQABAAACAkQBADs="
LAPTOP, PHONE = {"width": 1366, "height": 768}, {"width": 390, "height": 844}


def absent(reason: str) -> None:
    if REQUIRED:
        pytest.fail(f"CROSSCHECK_REQUIRE_BROWSER=1, but {reason}")
    pytest.skip(f"THE PAGE WAS NOT CHECKED IN A BROWSER: {reason}")


@pytest.fixture(scope="module")
def browser() -> Iterator[Any]:
    try:
        from playwright.sync_api import sync_playwright
    except ImportError as error:
        absent(f"{error}: pip install -e '.[dev]'")
    path = os.environ.get("CROSSCHECK_BROWSER") or next(filter(None, map(shutil.which, NAMES)), None)
    if path is None:
        absent(f"there is none of {', '.join(NAMES)}: apt-get install chromium")
    with sync_playwright() as playwright:
        started = playwright.chromium.launch(executable_path=path, args=["--no-sandbox"])
        yield started
        started.close()


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A run of three real scenes with a new disagreement and everything that a page can show beside it."""
    almost_a_change_point = FourBar(ground=4.0, crank=1.0, coupler=3.5, rocker=1.5 + 1e-6)
    linkages = (ROCKER, almost_a_change_point, SliderCrank(crank=1.0, rod=3.0, offset=0.25))
    scenes = [linkage.scene(speed=2.0, turns=1, samples=25) for linkage in linkages]
    typed = [check(scene, ["closed_form"], {"kind": scene.name, "shard": k}) for k, scene in enumerate(scenes)]
    records = [plain(record) for record in typed]
    fields = {**disagreement("mujoco"), "engine": "closed_form", "method": "float"}
    records[0]["disagreements"] = [fields]
    made = write(tmp_path_factory.mktemp("run"), *records)
    (made / "disagreements").mkdir()
    (made / "disagreements" / "a.toml").write_text('name = "minimal <scene>"\n')
    for name, rows in {"price": PRICES, "effects": EFFECTS, "hard_cases": HARD}.items():
        (made / f"{name}.json").write_text(json.dumps(rows))
    new = [replace(case(fields, file="disagreements/a.toml", shrunk=True), key=typed[0].key)]
    poses = pictures(typed, lambda r: {"scene": to_dict(scenes[r.about["shard"]])}, {"closed_form": "closed_form"})
    (made / "pictures.json").write_text(json.dumps(poses))
    write_documents(made)
    built(made, outcome(new=new, versions={"closed_form": "0.1.0"}))
    return made


class Opened:
    """The page in a browser, with everything that it asked for and complained of."""

    def __init__(self, browser: Any, file: Path, **more: Any) -> None:
        self.context = browser.new_context(**{"viewport": LAPTOP, **more})
        self.page = self.context.new_page()
        self.requests: list[str] = []
        self.complaints: list[str] = []
        self.page.on("request", lambda request: self.requests.append(request.url))
        self.page.on("console", lambda message: self.complaints.append(message.text))
        self.page.on("pageerror", lambda error: self.complaints.append(str(error)))
        self.page.goto(file.as_uri())

    def unfold(self) -> None:
        self.page.evaluate("document.querySelectorAll('details').forEach((d) => { d.open = true; })")

    def text(self, selector: str) -> str:
        return str(self.page.locator(selector).inner_text())


@pytest.fixture
def opened(browser: Any, folder: Path) -> Iterator[Any]:
    """Open the page; keyword arguments are those of a browser context."""
    contexts: list[Any] = []

    def open_it(file: Path = folder / "index.html", **more: Any) -> Opened:
        page = Opened(browser, file, **more)
        contexts.append(page.context)
        return page

    yield open_it
    for context in contexts:
        context.close()


@pytest.mark.parametrize(
    ("required", "expected"), [(True, pytest.fail.Exception), (False, pytest.skip.Exception)], ids=["red", "skipped"]
)
def test_missing_browser_is_red_where_it_is_required(
    monkeypatch: pytest.MonkeyPatch, required: bool, expected: type[BaseException]
) -> None:
    monkeypatch.setitem(globals(), "REQUIRED", required)

    with pytest.raises(expected, match="no browser"):
        absent("no browser")


def test_page_asks_for_nothing_but_itself_and_complains_of_nothing(opened: Any, folder: Path) -> None:
    at = opened()
    at.unfold()
    at.page.locator("[data-pose]").first.hover()

    assert at.requests == [(folder / "index.html").as_uri()]
    assert at.complaints == []


@pytest.mark.parametrize("planted", ["script", "image", "style"])
def test_content_policy_stops_what_is_put_into_the_page(opened: Any, planted: str) -> None:
    at = opened()
    put = {
        "script": "const e = document.createElement('script'); e.textContent = 'planted = 1'; document.body.append(e)",
        "image": f"const e = new Image(); e.onload = () => {{ window.planted = 1; }}; e.src = '{DOT}'",
        "style": "const e = document.createElement('style'); e.textContent = '*{opacity:0}'; document.body.append(e)",
    }
    at.page.evaluate("addEventListener('securitypolicyviolation', () => { window.stopped = 1; })")
    at.page.evaluate(f"() => {{ {put[planted]} }}")
    at.page.wait_for_function("window.stopped === 1", timeout=5000)

    assert at.page.evaluate("window.planted") is None
    assert at.page.evaluate("getComputedStyle(document.body).opacity") == "1"


def test_script_with_one_byte_changed_does_not_run(opened: Any, folder: Path, tmp_path: Path) -> None:
    text = (folder / "index.html").read_text(encoding="utf-8")
    changed = tmp_path / "changed.html"
    changed.write_text(text.replace('"use strict";', '"use strict"; '), encoding="utf-8")
    assert changed.read_text(encoding="utf-8") != text

    assert opened().page.locator("#theme").is_visible()
    assert not opened(changed).page.locator("#theme").is_visible()


def test_without_scripts_every_mark_and_table_is_there_and_the_first_screen_is_whole(opened: Any) -> None:
    with_scripts, without = opened(), opened(java_script_enabled=False)
    for selector in ("[data-mark]", "table", "svg", "#pose-picture circle"):
        expected = with_scripts.page.locator(selector).count()
        assert expected == without.page.locator(selector).count() > 0

    for selector in (".first table >> nth=0", ".hero > svg >> nth=0", "#pose-picture"):
        assert without.page.locator(selector).is_visible()


def test_without_scripts_a_section_unfolds_and_no_button_is_offered_that_does_nothing(opened: Any) -> None:
    page = opened(java_script_enabled=False).page
    inside = page.locator("#method h3").first
    assert not inside.is_visible()
    page.locator("#method summary").first.click()

    assert inside.is_visible()
    assert [button for button in page.locator("button").all() if button.is_visible()] == []


@pytest.mark.parametrize("unfolded", [False, True])
def test_on_a_phone_nothing_sticks_out_sideways(opened: Any, unfolded: bool) -> None:
    at = opened(viewport=PHONE)
    if unfolded:
        at.unfold()

    assert at.page.evaluate("document.documentElement.scrollWidth") == PHONE["width"]


def test_on_a_phone_every_cell_of_the_first_table_is_on_the_screen_with_its_name(opened: Any) -> None:
    at = opened(viewport=PHONE)
    cells = at.page.locator("#first .scroll").first.locator("tbody td, tbody th")
    boxes = [cell.bounding_box() for cell in cells.all()]

    assert boxes
    assert all(box["x"] >= 0 and box["x"] + box["width"] <= PHONE["width"] for box in boxes)
    named = "e => getComputedStyle(e, '::before').content"
    silent = at.page.locator("#first td.silent").first

    assert silent.evaluate(named) == '"wrong without saying so"'
    assert at.page.locator("#first .scroll").first.evaluate("e => e.scrollWidth == e.clientWidth")


def test_first_screen_of_a_laptop_holds_verdict_table_and_figure(opened: Any) -> None:
    page = opened().page
    for selector in ("h1", ".first table >> nth=0", ".hero > svg >> nth=2", "#pose-picture", "#pose-play"):
        box = page.locator(selector).bounding_box()

        assert box["y"] + box["height"] <= LAPTOP["height"], selector


@pytest.mark.parametrize(("scheme", "dark"), [("light", False), ("dark", True)])
def test_page_follows_the_system_s_theme_until_the_reader_chooses(opened: Any, scheme: str, dark: bool) -> None:
    page = opened(color_scheme=scheme).page
    is_dark = "Number(getComputedStyle(document.body).backgroundColor.match(/\\d+/)[0]) < 100"

    assert page.evaluate(is_dark) is dark
    page.locator("#theme").click()
    assert page.evaluate(is_dark) is not dark


def test_focus_on_a_mark_shows_its_pose(opened: Any) -> None:
    at = opened()
    marks = at.page.locator("[data-pose]")
    seen = []
    for k in range(marks.count()):
        marks.nth(k).focus()
        pose = at.page.locator("#pose-truth > g").first.get_attribute("transform")
        seen.append((at.text("#pose-summary"), pose))
        label = marks.nth(k).get_attribute("aria-label")

        assert label.split(":")[0] == seen[-1][0].split(",")[0]
    assert len(set(seen)) > 2


def test_ghost_stands_where_the_report_says(opened: Any, folder: Path) -> None:
    at = opened()
    poses = json.loads((folder / "report.json").read_text())["poses"]
    for mark in at.page.locator("[data-pose]").all():
        mark.focus()
        value = poses["marks"][int(mark.get_attribute("data-pose"))]
        drawn = [part.get_attribute("transform") for part in at.page.locator("#pose-ghost > g").all()]
        heads = at.page.locator("#pose-arrows > path").count()

        assert drawn == [f"translate({x:g} {y:g}) rotate({a:g})" for x, y, a in value["ghost"]]
        assert heads == 2 * len(value["arrows"])


def test_pointing_at_a_mark_shows_its_pose(opened: Any) -> None:
    at = opened()
    mark = at.page.locator("[data-pose]").last
    before = at.text("#pose-summary")
    mark.hover()

    assert at.text("#pose-summary") != before
    assert mark.get_attribute("data-shown") == ""


def test_a_figure_is_one_tab_stop_and_arrows_go_on_within_it(opened: Any) -> None:
    page = opened().page
    first = page.locator(".hero > svg >> nth=0").locator("[data-mark]")
    first.first.focus()
    page.keyboard.press("ArrowRight")
    assert first.nth(1).evaluate("e => e === document.activeElement")
    page.keyboard.press("Tab")

    second = page.locator(".hero > svg >> nth=1").locator("[data-mark]").first
    assert second.evaluate("e => e === document.activeElement")


@pytest.mark.parametrize("motion", ["no-preference", "reduce"])
def test_mechanism_moves_only_on_request_and_stops_on_request(opened: Any, motion: str) -> None:
    page = opened(reduced_motion=motion).page
    crank = page.locator("#pose-truth > g").first
    still = crank.get_attribute("transform")
    page.wait_for_timeout(250)
    assert crank.get_attribute("transform") == still

    page.locator("#pose-play").click()
    page.wait_for_function("t => document.querySelector('#pose-truth > g').getAttribute('transform') !== t", arg=still)
    page.locator("#pose-play").click()
    assert crank.get_attribute("transform") == still


def test_played_the_engine_s_answer_moves_beside_the_reference_with_its_error_at_a_stated_factor(opened: Any) -> None:
    at = opened()
    at.page.locator("[data-pose]").first.focus()
    still = at.page.locator("#pose-ghost > g").nth(1).get_attribute("transform")
    at.page.locator("#pose-play").click()
    moved = "t => document.querySelector('#pose-ghost > g:nth-child(2)').getAttribute('transform') !== t"
    at.page.wait_for_function(moved, arg=still)

    assert "over the cycle; error drawn ×" in at.text("#pose-summary")
    at.page.locator("#pose-play").click()
    assert at.page.locator("#pose-ghost > g").nth(1).get_attribute("transform") == still


def test_link_into_a_folded_section_unfolds_it(opened: Any, folder: Path) -> None:
    page = opened().page
    page.goto(f"{(folder / 'index.html').as_uri()}#glance")

    assert page.locator("#glance table").first.is_visible()


def test_scene_of_a_disagreement_is_copied(opened: Any) -> None:
    at = opened(permissions=["clipboard-read", "clipboard-write"])
    at.unfold()
    at.page.locator("button[data-copy]").click()
    at.page.get_by_text("Copied").wait_for()

    assert at.page.evaluate("navigator.clipboard.readText()") == 'name = "minimal <scene>"\n'


@pytest.mark.parametrize("viewport", [LAPTOP, PHONE], ids=["laptop", "phone"])
@pytest.mark.parametrize("scheme", ["light", "dark"])
def test_accessibility_check_finds_nothing(opened: Any, scheme: str, viewport: Any) -> None:
    axe = pytest.importorskip("axe_playwright_python.sync_playwright") if not REQUIRED else _axe()
    at = opened(color_scheme=scheme, viewport=viewport)
    at.unfold()
    value = axe.Axe().run(at.page).response["violations"]

    assert [(v["id"], [n["html"][:160] for n in v["nodes"][:3]]) for v in value] == []


def test_accessibility_check_can_fail(opened: Any, folder: Path, tmp_path: Path) -> None:
    axe = pytest.importorskip("axe_playwright_python.sync_playwright") if not REQUIRED else _axe()
    broken = tmp_path / "broken.html"
    broken.write_text((folder / "index.html").read_text(encoding="utf-8").replace('<html lang="en">', "<html>"))
    value = axe.Axe().run(opened(broken).page).response["violations"]

    assert [v["id"] for v in value] == ["html-has-lang"]


def _axe() -> Any:
    from axe_playwright_python import sync_playwright

    return sync_playwright


def of_one(made: Path, scene: Any, engine: str) -> Path:
    """A run of one scene."""
    record = check(scene, [engine], {"kind": "one", "shard": 0})
    write(made, plain(record))
    poses = pictures([record], lambda r: {"scene": to_dict(scene)}, {engine: engine})
    (made / "pictures.json").write_text(json.dumps(poses))
    built(made, outcome(versions={engine: "0.1.0"}))
    return made


@pytest.fixture(scope="module")
def in_space(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A run of one mechanism of space."""
    scene = replace(space_scenes.rssr_by_distance(), times=space_scenes.TIMES[:5])
    return of_one(tmp_path_factory.mktemp("space"), scene, "closed_form")


@pytest.mark.parametrize("scripts", [False, True])
def test_wheels_and_profiles_are_lines_that_hide_nothing(opened: Any, tmp_path: Path, scripts: bool) -> None:
    """They were black discs, and what meshes with them, or lies on them, could not be seen."""
    (scene,) = (q.scene for q in questions() if q.about == "gear on a carrier")
    page = opened(of_one(tmp_path, scene, "refkin-batch") / "index.html", java_script_enabled=scripts).page
    if scripts:
        page.locator("[data-pose]").first.hover()
    fills = "(paths) => paths.map((p) => getComputedStyle(p).fill)"

    assert set(page.locator("#pose-truth path[stroke-opacity]").evaluate_all(fills)) == {"none"}


def places(page: Any) -> list[str]:
    every = "(groups) => groups.map((g) => g.getAttribute('transform'))"
    return list(page.locator("#pose-truth > g").evaluate_all(every))


def test_a_mechanism_of_space_is_turned_by_the_pointer_and_back(opened: Any, in_space: Path) -> None:
    shown = opened(in_space / "index.html")
    page, picture = shown.page, shown.page.locator("#pose-picture")
    before, box = places(page), picture.bounding_box()
    middle = box["x"] + box["width"] / 2, box["y"] + box["height"] / 2
    page.mouse.move(*middle)
    page.mouse.down()
    page.mouse.move(middle[0] + 80, middle[1] + 20, steps=4)
    page.mouse.up()
    turned = places(page)
    assert len(turned) == len(before)
    assert turned != before
    picture.press("ArrowRight")
    assert places(page) != turned
    assert shown.complaints == []


def test_a_quarter_turn_shows_what_lay_in_front_at_the_side(opened: Any, in_space: Path) -> None:
    """Arrow keys turn by a tenth of a radian: a point moves to the right as far as it lay in front."""
    page = opened(in_space / "index.html").page
    data = json.loads(page.locator("#poses").inner_text())
    scene, mark = data["scenes"][0], data["marks"][data["first"]]
    x, y, _, _, near = mark["pose"][-1]
    page.locator("#pose-picture").press("ArrowRight")
    told = places(page)[-1].removeprefix("translate(").split(")")[0].split()
    fit = scene["fit"] + (1 - scene["fit"]) * math.cos(0.1)
    right = data["width"] / 2 + fit * ((x - data["width"] / 2) * math.cos(0.1) + near * math.sin(0.1))
    assert [float(n) for n in told] == pytest.approx(
        [right, data["height"] / 2 + fit * (y - data["height"] / 2)], abs=1e-6
    )
