"""index.html: what it shows stands in report.json, nothing of a record acts in it, and nothing is loaded."""

from __future__ import annotations

import base64
import hashlib
import json
import re
from dataclasses import dataclass, field
from html.parser import HTMLParser
from itertools import pairwise
from pathlib import Path
from typing import Any

import pytest

from crosscheck.judge.records import At
from crosscheck.report import wording
from crosscheck.report.build import build
from crosscheck.report.disagreements import _again
from crosscheck.report.svg import COLOURS, style

from .report_records import (
    QUANTITIES,
    ROUTES,
    answer,
    built,
    case,
    disagreement,
    failed_record,
    gap,
    good_answer,
    level,
    outcome,
    quantity,
    record,
    write,
)

VOID = {"meta", "br", "link", "img", "input", "hr"}
NASTY = "<script>alert(1)</script>\"' onload=x"


@dataclass
class Node:
    """One element of a page."""

    tag: str
    attributes: dict[str, str | None]
    parents: tuple[Node, ...]
    text: list[str] = field(default_factory=list)

    def inside(self, **wanted: str) -> bool:
        return any(all(n.attributes.get(k.rstrip("_")) == v for k, v in wanted.items()) for n in self.parents)


class Page(HTMLParser):
    """All elements of a page, in order, each with the text in it."""

    def __init__(self, text: str) -> None:
        super().__init__()
        self.source, self.nodes, self.open = text, [], []
        self.feed(text)

    def handle_starttag(self, tag: str, attributes: list[tuple[str, str | None]]) -> None:
        node = Node(tag, dict(attributes), tuple(self.open))
        self.nodes.append(node)
        if tag not in VOID:
            self.open.append(node)

    def handle_startendtag(self, tag: str, attributes: list[tuple[str, str | None]]) -> None:
        self.nodes.append(Node(tag, dict(attributes), tuple(self.open)))

    def handle_endtag(self, tag: str) -> None:
        assert self.open.pop().tag == tag, f"</{tag}> closes something else"

    def handle_data(self, data: str) -> None:
        for node in self.open:
            node.text.append(data)

    def all(self, *tags: str) -> list[Node]:
        return [n for n in self.nodes if n.tag in tags]

    def text(self, node: Node) -> str:
        return " ".join("".join(node.text).split())


def page_of(folder: Path, *arguments: Any, **more: Any) -> Page:
    return Page(built(folder, *arguments, **more).read_text(encoding="utf-8"))


def rich_run(folder: Path, text: str = "plain") -> tuple[Path, Any, Any]:
    """Write a run in which everything happens that a page can show, with `text` wherever a record has any."""
    about = {"kind": text, "grashof": text, text: text, "distance": 1e-3, "shard": 0}
    nasty = good_answer("mujoco", version=text)
    nasty["method"] = {key: f"{key} {text}" for key in nasty["method"]}
    rows = [disagreement(), disagreement(quantity="position", how=text, at=At(text, 0.5), message=text)]
    levels = [level("mujoco", name) for name in ("residual", "jacobian", "constraint_velocity", "drift")]
    gear = {"joint": "gear", "name": "A", "level": "solve"}
    refusals = [{"engine": "mujoco", "reason": text, **gear}, {"engine": text, "reason": text}]
    first = record("a", nasty, good_answer("pinocchio"), about=about, scene=text, disagreements=rows, refusals=refusals)
    second = record("b", good_answer("mujoco", missing=1, compared=3), levels=levels, disagreements=rows[:1])
    lost = {**failed_record("c"), "failure": text}
    write(folder, {**first, "levels": levels}, second, lost, missing={"exudyn": text})
    (folder / "disagreements").mkdir()
    file = "disagreements/a-mujoco-newton-velocity.toml"
    (folder / file).write_text(f'name = "{text}"\n', encoding="utf-8")
    new = [case(rows[0], file=file, shrunk=True), case(rows[1])]
    ended = outcome(new=new, missing={"exudyn": text}, failed=[f"pool: {text}"], known=1)
    return folder, ended, [gap(kind="nothing"), gap(quantity="velocity")]


@pytest.fixture(scope="module")
def rich(tmp_path_factory: pytest.TempPathFactory) -> tuple[Page, Any]:
    folder, ended, gaps = rich_run(tmp_path_factory.mktemp("rich"))
    page = page_of(folder, ended, gaps=gaps)
    return page, json.loads((folder / "report.json").read_text())


@pytest.fixture(scope="module")
def page(rich: Any) -> Page:
    return rich[0]


def test_text_of_records_never_becomes_an_element_or_an_attribute(tmp_path: Path) -> None:
    plain_folder, ended, gaps = rich_run(tmp_path / "plain")
    plain = page_of(plain_folder, ended, gaps=gaps)
    nasty_folder, ended, gaps = rich_run(tmp_path / "nasty", NASTY)
    nasty = page_of(nasty_folder, ended, gaps=gaps)

    assert NASTY in "".join(nasty.nodes[0].text)
    assert [(n.tag, set(n.attributes)) for n in plain.nodes] == [(n.tag, set(n.attributes)) for n in nasty.nodes]


def test_page_loads_nothing_and_names_no_address(page: Page) -> None:
    for node in page.nodes:
        assert node.tag not in {"link", "img", "iframe", "object", "embed", "image", "use", "form", "base"}
        assert (node.attributes.get("href") or "#").startswith("#")
        assert not {"src", "srcset", "xlink:href", "style", "action"} & node.attributes.keys()
        assert not [name for name in node.attributes if name.startswith("on")]
    assert not re.search(r"https?:|url\(|@import|//\w", page.source)


def hashed(text: str) -> str:
    return "sha256-" + base64.b64encode(hashlib.sha256(text.encode()).digest()).decode()


def test_content_policy_allows_nothing_but_the_page_s_own_style_and_script(page: Page) -> None:
    (policy,) = [n for n in page.all("meta") if n.attributes.get("http-equiv") == "Content-Security-Policy"]
    style, script = re.search(r"<style>(.*?)</style>.*<script>(.*?)</script>", page.source, re.S).groups()

    allowed = f"style-src '{hashed(style)}'; script-src '{hashed(script)}'; base-uri 'none'; form-action 'none'"
    assert policy.attributes["content"] == f"default-src 'none'; {allowed}"


def test_no_text_of_a_record_can_end_the_data_of_the_script(tmp_path: Path) -> None:
    folder, ended, gaps = rich_run(tmp_path, "</script><script>alert(1)</script>")
    page = page_of(folder, ended, gaps=gaps)

    assert [n.attributes.get("type") for n in page.all("script")] == ["application/json", "application/json", None]
    assert "alert(1)" not in page.text(page.all("script")[-1])


def test_page_has_language_title_and_one_main_landmark(page: Page) -> None:
    assert page.all("html")[0].attributes["lang"] == "en"
    assert page.text(page.all("title")[0])
    assert (len(page.all("main")), len(page.all("h1"))) == (1, 1)


def test_headings_leave_no_level_out(page: Page) -> None:
    levels = [int(n.tag[1]) for n in page.all("h1", "h2", "h3", "h4")]

    assert all(b - a <= 1 for a, b in pairwise(levels))


def test_ids_are_unique_and_every_link_has_its_target(page: Page) -> None:
    ids = [n.attributes["id"] for n in page.nodes if "id" in n.attributes]

    assert len(ids) == len(set(ids))
    assert {n.attributes["href"] for n in page.all("a")} <= {f"#{name}" for name in ids}


def test_every_table_has_a_caption_scopes_and_a_box_of_its_own_to_scroll_in(page: Page) -> None:
    for table in page.all("table"):
        inside = [n for n in page.nodes if table in n.parents]
        assert [n for n in inside if n.tag == "caption" and page.text(n)]
        assert all(n.attributes.get("scope") in {"col", "row", "rowgroup"} for n in inside if n.tag == "th")
        assert table.inside(class_="scroll")


def test_every_drawing_is_named_or_hidden_and_has_a_table_beside_it(page: Page) -> None:
    for drawing in page.all("svg"):
        if drawing.attributes.get("aria-hidden") == "true":
            continue
        if drawing.attributes.get("id") == "pose-picture":  # its numbers are those of its mark
            continue
        figure = next(n for n in drawing.parents if n.tag == "figure")
        inside = [n for n in page.nodes if figure in n.parents]
        named = [n for n in inside if n.tag in ("title", "desc") and "id" in n.attributes and page.text(n)]
        names = [n.attributes["id"] for n in named]
        assert set(drawing.attributes["aria-labelledby"].split()) <= set(names)
        assert [n for n in inside if n.tag == "table" and any(p.tag == "details" for p in n.parents)]


def glance_rows(page: Page) -> dict[tuple[str, str], list[str]]:
    """Return {(group, row): cells} of the table at a glance."""
    rows, group = {}, ""
    for row in page.all("tr"):
        if not row.inside(class_="glance"):
            continue
        cells = [n for n in page.nodes if n.parents and n.parents[-1] is row]
        if cells[0].attributes.get("scope") == "rowgroup":
            group = page.text(cells[0])
        elif group:
            rows[group, page.text(cells[0])] = [page.text(n) for n in cells[1:]]
    return rows


def test_every_row_at_a_glance_is_what_report_json_says(tmp_path: Path) -> None:
    answers = [answer(e, {q: quantity({-1: [14.31, 12.6, 9.05]}, 0.13) for q in QUANTITIES}) for e in ROUTES]
    answers.append({**answers[1], "method": {**answers[1]["method"], "name": "chord"}})
    folder = write(tmp_path, record("a", *answers, levels=[level("mujoco", "jacobian")]))
    rows = glance_rows(page_of(folder))
    report = json.loads((folder / "report.json").read_text())

    for name in QUANTITIES:
        for engine, method in (*ROUTES.items(), ("mujoco", "chord")):
            cell = report["engines"][engine][method][name]
            digits = [f"{cell[k]:.1f}" for k in ("digits_median", "digits_p01", "digits_worst")]
            counts = [str(cell[k]) for k in ("failures", "known_gaps", "unanswered", "scenes")]
            expected = [*digits, "0.13", *counts, cell["newton_by"], cell["linear_solve_by"]]
            assert expected == rows[name.capitalize(), f"{engine} · {method}"][:10]
    own = [name for title, name in rows if title == "The engine's own Jacobian, phi_q"]
    assert sorted(own) == sorted(ROUTES)  # the same by every method


def test_missing_engine_has_a_row_for_every_quantity_and_a_level_nobody_answered_reads_no_answer(page: Page) -> None:
    rows = glance_rows(page)

    for name in QUANTITIES:
        assert rows[name.capitalize(), "exudyn"] == ["no answer: the engine is missing"]
    assert rows["The engine's own Jacobian, phi_q", "pinocchio"] == ["no answer in any scene"]


def test_answer_without_samples_reads_no_answer_and_not_zero(tmp_path: Path) -> None:
    silent = answer("mujoco", {"position": quantity({}, None, "")}, missing=4, compared=0)
    rows = glance_rows(page_of(write(tmp_path, record("a", silent))))

    assert rows["Position", "mujoco · newton"][:4] == ["no answer"] * 4


@pytest.mark.parametrize("planted", ["pass", "new", "failure", "missing", "nothing"])
def test_first_heading_is_the_verdict(tmp_path: Path, planted: str) -> None:
    good = record("a", good_answer("mujoco"))
    runs = {
        "pass": ([good], {}, "Pass"),
        "new": ([{**good, "disagreements": [disagreement()]}], {}, "1 new disagreement"),
        "failure": ([good, failed_record("b")], {}, "Infrastructure failure"),
        "missing": ([good], {"required": ("exudyn",), "missing": {"exudyn": "gone"}}, "Engine missing"),
        "nothing": ([], {}, "Nothing ran"),
    }
    records, more, expected = runs[planted]
    page = page_of(write(tmp_path, *records, **more))

    assert page.text(page.all("h1")[0])[1:] == expected


def test_only_a_pass_has_the_sign_and_the_colour_of_one(tmp_path: Path) -> None:
    good = record("a", good_answer("mujoco"))
    pages = [page_of(write(tmp_path / "p", good)), page_of(write(tmp_path / "n"))]

    values = [(p.all("header")[0].attributes["class"], p.text(p.all("h1")[0])[0]) for p in pages]
    assert values == [("pass", "✓"), ("fail", "✕")]


def test_new_disagreement_shows_its_minimal_scene_and_how_to_replay_it(page: Page) -> None:
    code = [page.text(n) for n in page.all("code")]

    assert "crosscheck replay disagreements/a-mujoco-newton-velocity.toml" in code
    assert 'name = "plain"' in code


def test_new_disagreements_come_before_known_ones(rich: Any) -> None:
    known = [row["known"] for row in rich[1]["disagreements"]]

    assert known == sorted(known)
    assert set(known) == {True, False}


def test_file_outside_the_folder_is_not_shown(tmp_path: Path) -> None:
    (tmp_path / "secret.toml").write_text("secret = 1")
    folder = write(tmp_path / "run", record("a", good_answer("mujoco"), disagreements=[disagreement()]))
    page = page_of(folder, outcome(new=[case(disagreement(), file="../secret.toml")]))

    assert "secret" not in page.source


def test_digits_figure_has_one_mark_per_bin_and_line(tmp_path: Path) -> None:
    near = {name: quantity({-5: [9.0, 10.0], -1: [15.0]}) for name in QUANTITIES}
    far = {name: quantity({0: [16.0]}) for name in QUANTITIES}
    page = page_of(write(tmp_path, record("a", answer("exudyn", near, compared=3), answer("mujoco", far, compared=1))))
    marks = [n for n in page.all("g") if "data-mark" in n.attributes]
    digits = [n for n in marks if "digits-" in (n.parents[-1].attributes["aria-labelledby"] or "")]

    assert len(digits) == 2 * len(QUANTITIES) * (2 + 1)


def test_every_mark_says_what_it_is_and_one_of_each_drawing_can_be_reached_by_tab(page: Page) -> None:
    marks: dict[int, list[Node]] = {}
    for n in page.all("g"):
        if "data-mark" in n.attributes:
            marks.setdefault(id(n.parents[-1]), []).append(n)

    assert marks
    for of_drawing in marks.values():
        assert all(n.attributes["aria-label"] and n.attributes["role"] == "img" for n in of_drawing)
        assert [n.attributes["tabindex"] for n in of_drawing] == ["0", *["-1"] * (len(of_drawing) - 1)]


def luminance(colour: str) -> float:
    parts = [int(colour[k : k + 2], 16) / 255 for k in (1, 3, 5)]
    linear = [c / 12.92 if c <= 0.03928 else ((c + 0.055) / 1.055) ** 2.4 for c in parts]
    return 0.2126 * linear[0] + 0.7152 * linear[1] + 0.0722 * linear[2]


def contrast(a: str, b: str) -> float:
    high, low = sorted((luminance(a), luminance(b)), reverse=True)
    return (high + 0.05) / (low + 0.05)


@pytest.mark.parametrize("paper", ["#fdfdfc", "#14171a"])
def test_first_five_series_stand_out_from_the_paper(page: Page, paper: str) -> None:
    assert paper in page.source
    for colour in COLOURS[1:5]:
        assert contrast(colour, paper) > 2.9, colour


def test_text_colours_are_readable_on_their_paper(page: Page) -> None:
    css = page.text(page.all("style")[0])
    pairs = dict(re.findall(r"--(\w+): light-dark\((#[0-9a-f]{6}, #[0-9a-f]{6})\)", css))
    themes = [{name: pair.split(", ")[k] for name, pair in pairs.items()} for k in (0, 1)]

    for theme in themes:
        for name in ("ink", "soft", "link", "good", "bad", "gap"):
            assert contrast(theme[name], theme["paper"]) > 4.5, name


def test_no_two_series_look_the_same() -> None:
    assert len({style(k) for k in range(40)}) == 40


def test_scene_that_a_run_shrunk_is_called_minimal_when_the_page_is_made_again(tmp_path: Path) -> None:
    folder = write(tmp_path, record("a", good_answer("mujoco"), disagreements=[disagreement()]))
    (folder / "disagreements").mkdir()
    (folder / "disagreements" / "minimal.toml").write_text("# engine: mujoco\n")
    page_of(folder, outcome(new=[case(disagreement(), file="disagreements/minimal.toml", shrunk=True)]))

    assert "Shrunk to a minimal scene" in build(folder).read_text(encoding="utf-8")


@pytest.mark.parametrize(
    ("text", "quantity", "expected"),
    [
        ("numpy", "position", "numpy"),
        ("exudyn (SolveStatic, default tolerances)", "position", "exudyn"),
        ("position: exudyn; velocity, acceleration: adapter (numpy)", "position", "exudyn"),
        ("position: exudyn; velocity, acceleration: adapter (numpy)", "acceleration", "adapter"),
        ("exudyn at qdd = 0, combined by the adapter", "acceleration", "exudyn at qdd = 0 …"),
        (None, "position", wording.NO_ANSWER),
    ],
)
def test_short_form_of_who_did_it_says_where_it_is_cut(text: str | None, quantity: str, expected: str) -> None:
    assert wording.whose(text, quantity) == expected


@pytest.mark.parametrize(
    ("place", "expected"),
    [
        ({"component": "rocker.phi", "time": 1.23456789}, "rocker.phi at t = 1.23457"),
        ({"component": "row 3", "time": None}, "row 3"),
        ({"component": None, "time": None, "message": "two times without answer"}, "two times without answer"),
        ({"component": None, "time": None}, "not in the record"),
    ],
)
def test_where_a_number_was_met_is_told_in_words(place: Any, expected: str) -> None:
    assert wording.sample(place) == expected


@pytest.mark.parametrize(
    ("value", "expected"),
    [
        (None, wording.NO_ANSWER),
        (0.0, "0"),
        (0.03413, "0.034"),
        (0.99999, "0.99999"),
        (1.0, "1.0"),
        (1.0000004, "1.0000004"),
        (1.0412345, "1.04"),
        (5.26, "5.3"),
        (41234.0, "41\u202f234"),
        (2.6e13, "2.6 × 10¹³"),
        (1.7976931348623157e308, "unbounded"),
    ],
)
def test_ratio_is_never_rounded_across_one(value: float | None, expected: str) -> None:
    assert wording.ratio(value) == expected


def test_the_command_of_a_disagreement_is_the_one_of_its_file_and_none_that_an_engine_said():
    said = "# message: x\n# Show it again: crosscheck replay a.toml --engines evil.py:E\n"
    own = "# Show it again: crosscheck replay a.toml --expected singular\n\nschema = 1\n"

    assert _again(said + own, "disagreements/a.toml") == "crosscheck replay disagreements/a.toml --expected singular"
    assert _again("", "disagreements/a.toml") == "crosscheck replay disagreements/a.toml"
