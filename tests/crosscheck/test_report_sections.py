"""The sections of the page that show what other commands measured, pictures of poses, and who was wrong in silence."""

from __future__ import annotations

import json
import math
import re
from dataclasses import asdict
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest
from hypothesis import example, given
from hypothesis import strategies as st

import refkin
from crosscheck.documents.ledger.page import slopes
from crosscheck.judge.records import Cause
from crosscheck.measure.check import check
from crosscheck.night import sections
from crosscheck.night.history import append, remember
from crosscheck.night.moving_parts import DrawnSample, SceneDrawing
from crosscheck.night.moving_parts import factor_below as magnified
from crosscheck.night.sections import pictures, write_documents
from crosscheck.report import totals
from crosscheck.report.build import build, summarized
from crosscheck.report.build import together as shown_together
from crosscheck.report.cells import Cell, MethodTotals, RecordLine
from crosscheck.report.first_table import _cell, first_table
from crosscheck.report.front import answer as sentence
from crosscheck.report.front import folds, hard_matrix
from crosscheck.report.prices import cheapest
from crosscheck.report.totals import OTHERS, Refusals, Together
from refkin.scenes.files import to_dict
from tests.linkages import ROCKER

from .report_records import answer, disagreement, effect_row, good_answer, of_run, quantity, record, typed, write

NEWTON = {"engine": "mujoco", "method": "newton"}
OF_PRICE = {"newton_by": "", "quantity": "acceleration", "digits_attainable": 15.0, "spread": 0.05}
OF_PRICE |= {"scene_class": "regular"}
PRICES: list[dict[str, Any]] = [
    {**OF_PRICE, **NEWTON, "setting": "k = 2", "digits": 7.0, "microseconds": 10.0},
    {**OF_PRICE, **NEWTON, "setting": "k = 4", "digits": 14.0, "microseconds": 31.0},
    {**OF_PRICE, **NEWTON, "setting": "k = 3", "digits": 9.5, "microseconds": 24.0},
    {**OF_PRICE, "engine": "exudyn", "method": "Newton", "setting": "1e-9", "digits": 8.9, "microseconds": 5.0},
]
OF_POSITION: Any = {"engine": "refkin", "method": "solve", "microseconds": 20.0, "largest_change": 0.0}
FELT: Any = {"inert": False, "largest_change": 1e-3, "worst": "acceleration of crank.phi at t = 1"}
EFFECTS = [asdict(effect_row("position", **OF_POSITION)), asdict(effect_row("gravity", engine="mujoco", **FELT))]
HARD: list[dict[str, Any]] = [
    {**NEWTON, "case": "dead centre", "verdict": "correct", "class": None, "quote": ""},
    {**NEWTON, "case": "dead centre", "verdict": "wrong", "class": "contract violated", "quote": "ok"},
    {**NEWTON, "case": "change point", "verdict": "refused", "class": None, "quote": "no"},
]


def reported(folder: Path, **files: Any) -> tuple[Any, str]:
    """Build a page for a run of one good scene with files beside its records."""
    return of_run(folder, record("a", good_answer("mujoco")), **files)


def rows_of_first(report: Any) -> list[dict[str, Any]]:
    """Return the rows of the first table, whatever their block."""
    return [row for block in first_table(report) for row in block["rows"]]


def test_what_was_not_measured_says_so_in_its_section(tmp_path: Path) -> None:
    report, page = reported(tmp_path)

    assert [report[name] for name in ("price", "effects", "hard_cases")] == [None] * 3
    assert page.count('<p class="none">Not measured in this run.</p>') == 6
    assert report["poses"]["marks"] == []
    assert "The records of this run hold no poses." in page


def test_rows_that_were_measured_stand_in_the_report_as_they_came(tmp_path: Path) -> None:
    report, _ = reported(tmp_path, price=PRICES, effects=EFFECTS, hard_cases=HARD)

    assert [{key: row[key] for key in PRICES[0]} for row in report["price"]] == PRICES
    assert report["effects"] == EFFECTS
    unsaid = {"setting": "", "distance": None, "of": 0, "note": ""}
    assert [{**unsaid, **row} for row in HARD] == report["hard_cases"]


@pytest.mark.parametrize(
    ("file", "rows", "told"),
    [
        ("price", [{**PRICES[0], "microseconds": -1}], "0.microseconds"),
        ("price", {"engine": "mujoco"}, "array"),
        ("hard_cases", [{**HARD[0], "verdict": "fine"}], "0.verdict"),
        ("effects", [{"engine": "mujoco"}], "0.method"),
    ],
)
def test_file_that_cannot_be_read_fails_the_night_and_says_where(
    tmp_path: Path, file: str, rows: Any, told: str
) -> None:
    report, _ = reported(tmp_path, **{file: rows})

    assert report["verdict"] == "infrastructure"
    assert f"{file}.json cannot be read" in report["failures"][0]
    assert told in report["failures"][0]


def test_cheapest_way_is_the_least_time_among_settings_with_the_digits() -> None:
    offers = cheapest([row for row in PRICES if row["scene_class"] == "regular"], "acceleration", 9)

    assert {who: (row.method, row.microseconds) for who, row in offers.items()} == {"mujoco": ("newton", 24.0)}


def test_first_table_has_the_price_of_nine_digits_of_acceleration(tmp_path: Path) -> None:
    report, page = reported(tmp_path, price=PRICES)

    assert [row["price"] for row in rows_of_first(report)] == [24.0]
    said = "Nine digits of acceleration cost least over one cycle with mujoco · newton: 24 µs (regular scenes)."
    assert sentence(report) == said
    assert sentence(report) in page
    once = '24 <span class="soft">by one call</span>'
    assert once not in page
    assert once in reported(tmp_path, price=[{**row, "spread": None} for row in PRICES])[1]


def test_the_first_table_has_the_price_of_the_method_whose_digits_it_shows(tmp_path: Path) -> None:
    """That of the engine's best method stood beside digits that it did not buy."""
    batch = {**PRICES[1], "method": "mujoco.batch", "microseconds": 8.4}
    report, page = reported(tmp_path, price=[*PRICES, batch])

    (row,) = rows_of_first(report)
    assert (row["method"], row["price"]) == ("newton", 24.0)
    assert "mujoco · mujoco.batch: 8.4 µs" in sentence(report)
    assert '<span class="unit soft">1 scene in all</span>' in page


def test_the_page_prices_one_pose_a_cycle_and_bulk_with_the_second_best_and_the_model(tmp_path: Path) -> None:
    """The tables had one cycle alone, and did not say what was called once."""
    bulk = {"digits_bulk": 12.0, "microseconds_bulk": 6.9, "spread_bulk": 0.01, "microseconds_to_build": 850.0}
    one = {"digits_one": 12.0, "microseconds_one": 35.0, "spread_one": None}
    batch = {**PRICES[1], **bulk, "engine": "exudyn", "method": "Newton", "microseconds": 40.0}
    _, page = reported(tmp_path, price=[{**PRICES[1], **one, **bulk, "microseconds_bulk": 7.0}, batch])

    (table,) = re.findall(r'<table class="settings">.*?</table>', page, re.DOTALL)
    text = " ".join(re.sub(r"<[^>]*>", " ", table).split())
    said = [text.index(name) for name in ("one pose now", "one cycle", "in bulk")]
    now, cycle, bulk_ = text[said[0] : said[1]], text[said[1] : said[2]], text[said[2] :]
    assert "35 mujoco · newton" in now
    assert "; once nobody else" in now
    assert "exudyn never never never never never" in now
    assert "31 mujoco · newton" in cycle
    assert "exudyn 40 Newton: k = 4; model 850 µs 40" in cycle
    assert "next: 40 exudyn · Newton" in cycle
    assert "6.9 exudyn · Newton" in bulk_
    assert "model 850 µs as good: 7.0 mujoco · newton" in bulk_


def test_method_that_never_has_nine_digits_has_no_price(tmp_path: Path) -> None:
    report, page = reported(tmp_path, price=PRICES[:1])

    assert [row["price"] for row in rows_of_first(report)] == [None]
    assert "never reached" in page
    assert "No method reaches nine digits of acceleration." in page


def test_rows_of_the_price_list_are_read_as_it_gives_them(tmp_path: Path) -> None:
    untimed = {**PRICES[2], "microseconds": None, "spread": None, "digits": 15.0}
    report, _ = reported(tmp_path, price=[{**PRICES[2], "newton_by": "adapter", "note": ""}, untimed])

    assert [row["scene_class"] for row in report["price"]] == [PRICES[2]["scene_class"]] * 2
    assert [row["price"] for row in rows_of_first(report)] == [24.0]


def test_method_that_was_not_priced_says_so(tmp_path: Path) -> None:
    _, page = reported(tmp_path, price=PRICES[3:])

    assert "not priced" in page
    assert "never reached" not in page
    other = [{**PRICES[1], "method": name, "microseconds": us} for name, us in (("rows", 31.0), ("all at once", 7.0))]
    report, page = reported(tmp_path, price=other)
    assert [row["price"] for row in rows_of_first(report)] == [None]
    assert 'not priced</span> <span class="soft">all at once: 7.0</span>' in page


def test_cheapest_of_all_is_told_beside_the_cheapest_of_the_engines(tmp_path: Path) -> None:
    """Also where what is ours, and no engine, is one of those that were compared."""
    own = {**PRICES[1], "engine": "refkin-batch", "method": "batch", "microseconds": 0.5}
    report, _ = reported(tmp_path, price=[*PRICES, own])
    report["engines"]["refkin-batch"] = {}

    engines = "of the engines compared here, with mujoco · newton: 24 µs (regular scenes)."
    assert (
        sentence(report)
        == f"Nine digits of acceleration cost least over one cycle with refkin-batch · batch: 0.50 µs; {engines}"
    )


def test_page_with_a_long_price_list_and_a_long_history_is_below_a_megabyte(tmp_path: Path) -> None:
    knobs = [{**row, "setting": f"{row['setting']}, {k}"} for row in PRICES[:3] for k in range(40)]
    own = {**PRICES[0], "engine": "refkin", "method": "newton"}
    history = tmp_path / "h.sqlite"
    write(tmp_path / "run", record("a", good_answer("mujoco")))
    (tmp_path / "run" / "price.json").write_text(json.dumps([own, *knobs]))
    for day in range(30):
        run = json.loads((tmp_path / "run" / "run.json").read_text())
        (tmp_path / "run" / "run.json").write_text(json.dumps({**run, "date": f"2026-10-{day + 1:02d} 02:17"}))
        report = json.loads((tmp_path / "run" / "report.json").read_text()) if day else {}
        if 0 < day < 29:
            append(history, {**report, "date": f"2026-10-{day + 1:02d} 02:17"})
        else:
            remember(history, summarized(tmp_path / "run"), tmp_path / "run")
            page = build(tmp_path / "run")
    value = json.loads((tmp_path / "run" / "report.json").read_text())["trends"]

    assert (len(value["nights"]), len(value["series"]), value["not_shown"]) == (30, 24, 98)
    assert page.stat().st_size < 1e6


def test_every_setting_that_its_engine_does_not_beat_is_a_mark_and_a_row(tmp_path: Path) -> None:
    beaten = {**PRICES[0], "setting": "k = 1", "digits": 6.0, "microseconds": 11.0}
    report, page = reported(tmp_path, price=[*PRICES, beaten])

    assert beaten in [{key: row[key] for key in beaten} for row in report["price"]]
    assert "k = 1:" not in page

    for row in PRICES:
        mark = f"{row['engine']} · {row['method']}, {row['setting']}: {row['digits']:.1f} digits of acceleration for"
        assert page.count(f'aria-label="{mark}') == 1
    section = page[page.index('<section id="price"') : page.index('<section id="effects"')]
    assert section.count('<tr><th scope="row">') == len(PRICES)


def test_effect_that_changes_what_was_called_for_is_named(tmp_path: Path) -> None:
    _, page = reported(tmp_path, effects=EFFECTS)

    felt = "acceleration of crank.phi at t = 1 by 0.0010 of its size."
    assert f"mujoco (newton): gravity changes the answer that the scene asks for: {felt}" in page
    assert "refkin: position changes" not in page


def test_case_with_two_verdicts_shows_the_worse_one_and_of_how_many(tmp_path: Path) -> None:
    report, page = reported(tmp_path, hard_cases=HARD)

    assert hard_matrix(report)["lines"] == [("dead centre", [("wrong", "1 of 2")]), ("change point", [("refused", "")])]
    assert 'class="v-wrong">✕ wrong <span class="soft">1 of 2</span>' in page


def test_a_refusal_where_there_is_no_assembly_is_right(tmp_path: Path) -> None:
    gap = {**HARD[2], "case": "gap", "note": "rightly, there is no assembly: no answer at 2 of 3 times"}
    report, page = reported(tmp_path, hard_cases=[*HARD, gap, {**gap, "verdict": "warned", "note": ""}, gap])

    assert hard_matrix(report)["lines"][-1] == ("gap", [("warned", "1 of 3")])
    assert hard_matrix({"hard_cases": [gap, gap]})["lines"] == [("gap", [("rightly refused", "")])]
    assert 'class="v-refused">⊘ refused' in page


def test_hard_case_that_is_wrong_in_silence_stands_in_the_first_table(tmp_path: Path) -> None:
    report, _ = reported(tmp_path, hard_cases=HARD)
    (row,) = rows_of_first(report)

    assert (row["silent"], row["silent_class"]) == (
        "1 of 1 kinds of hard cases that it answers (contract violated)",
        "bad",
    )


@pytest.mark.parametrize(
    ("worst", "known", "new", "seriousness"),
    [(3.5, 2, 0, "gap"), (3.5, 2, 1, "bad"), (3.5, 0, 1, "bad"), (0.5, 2, 1, "")],
)
def test_cell_with_a_new_failure_beside_known_gaps_is_bad(worst: float, known: int, new: int, seriousness: str) -> None:
    cell = Cell(known_gaps=known, failures=new).described()

    assert _cell(None, {**cell, "worst_over_allowed": worst})["class"] == seriousness


def test_scene_that_is_wrong_in_three_quantities_counts_once_as_silent(tmp_path: Path) -> None:
    values = [disagreement(quantity=q) for q in ("position", "velocity", "acceleration")]
    made = record("a", good_answer("mujoco"), disagreements=values), record("b", good_answer("mujoco"))
    (method,) = of_run(tmp_path, *made)[0]["methods"]

    assert method["silent"] == {"any": 1, "beyond the allowed error": 1}


def test_engine_that_gave_no_answer_was_not_silent(tmp_path: Path) -> None:
    rows = [disagreement(quantity="status", kind=Cause.NO_ANSWER, ratio=None)]
    made = record("a", good_answer("mujoco", missing=1, compared=3), disagreements=rows)
    (method,) = of_run(tmp_path, made)[0]["methods"]

    assert method["silent"] == {}


def agreement(folder: Path, dimension: str) -> dict[tuple[str, ...], float]:
    """Return the digits to which three answers agree whose third coordinates are wrong, two of them alike but 2 pi."""

    def off(engine: str, by: float) -> Any:
        result = good_answer(engine)
        result["quantities"]["position"]["common"] = [0.0, 0.0, by]
        return result

    made = record("a", off("mujoco", 3e-7), off("exudyn", 3e-7 + 2 * math.pi), off("pinocchio", 0.0))
    made["reference"]["common"] = {"k": 0, "scale": {"position": 100.0}}
    made["about"]["dimension"] = dimension
    report, _ = of_run(folder, made)
    return {tuple(row["engines"]): row["position"]["digits_median"] for row in report["agreement"]}


def test_two_that_are_wrong_alike_agree_and_the_odd_one_stands_out(tmp_path: Path) -> None:
    digits = agreement(tmp_path, "planar")

    assert digits.pop(("exudyn", "mujoco")) > 15
    assert digits == {("exudyn", "pinocchio"): 8.5, ("mujoco", "pinocchio"): 8.5}


def test_in_space_the_third_coordinate_is_a_length_and_counts_whole_turns(tmp_path: Path) -> None:
    assert agreement(tmp_path, "spatial") == {
        ("exudyn", "mujoco"): 1.2,
        ("exudyn", "pinocchio"): 1.2,
        ("mujoco", "pinocchio"): 8.5,
    }


@pytest.fixture(scope="module")
def posed() -> tuple[Any, Any]:
    """A picture of one real scene, with the rocker's angle off by 1e-9 at time 7: its scene and its mark."""
    scene = ROCKER.scene(speed=1.0, turns=1, samples=73, branch="open")
    off = np.zeros((9, 73))
    off[8] = 99e-11
    off[8, :4], off[:, 4], off[8, 7] = 50e-11, np.nan, 1e-9
    drawing = SceneDrawing(scene, refkin.solve(scene))
    return drawing.described("a", "b"), drawing.ghost(DrawnSample(7, 9.0, off), 0)


def test_ghost_differs_from_the_pose_by_the_error_times_the_stated_factor(posed: Any) -> None:
    _, mark = posed
    turned = mark["pose"][2][2] - mark["ghost"][2][2]  # degrees, clockwise in pixels

    assert mark["factor"] * math.degrees(1e-9) == pytest.approx(turned, abs=0.11)
    assert mark["pose"][:2] == mark["ghost"][:2]


def test_over_the_cycle_every_frame_has_its_own_error_times_one_factor(posed: Any) -> None:
    scene, mark = posed
    cycle = mark["cycle"]
    turned = [
        None if ghost is None else math.remainder(truth[2][2] - ghost[2][2], 360)
        for truth, ghost in zip(scene["frames"], cycle["frames"], strict=True)
    ]
    full = math.degrees(cycle["factor"] * 99e-11)

    assert turned[:3] == [pytest.approx(full * 50 / 99, abs=0.11), None, pytest.approx(full, abs=0.11)]
    assert full > 1.0
    assert math.radians(full) <= 0.35  # the largest error is to be a small one, too


def test_pose_of_a_mark_is_the_one_at_its_time(posed: Any) -> None:
    _, mark = posed
    crank = mark["pose"][0][2]

    assert mark["time"] == pytest.approx(2 * np.pi * 7 / 72)
    assert -math.degrees(mark["time"]) == pytest.approx(crank, abs=0.06)


def test_bars_of_a_picture_keep_together_in_every_frame(posed: Any) -> None:
    """Joint points of two bodies that a joint holds together are drawn at one place, to the tenths of the picture."""
    scene, _ = posed

    def place(part: Any, where: Any, pin: int) -> Any:
        x, y, degrees = where
        c, s = math.cos(math.radians(degrees)), math.sin(math.radians(degrees))
        a, b = part["pins"][pin]
        return x + c * a - s * b, y + s * a + c * b

    for frame in scene["frames"]:
        crank, coupler, rocker = zip(scene["parts"], frame, strict=True)
        assert place(*crank, 1) == pytest.approx(place(*coupler, 0), abs=0.5)
        assert place(*coupler, 1) == pytest.approx(place(*rocker, 1), abs=0.5) or place(*coupler, 1) == pytest.approx(
            place(*rocker, 0), abs=0.5
        )


@given(st.floats(1.0, 1e29))
@example(1000.0)
@example(math.nextafter(1e15, 0))
@example(math.nextafter(1.0, 2))
def test_factor_of_an_error_is_round_and_makes_it_as_visible_as_it_may_be(limit: float) -> None:
    factor = magnified(limit)

    assert limit / 2.51 < factor <= limit
    assert f"{factor:.9e}"[0] in "125"


def test_the_worst_of_each_decade_is_pictured_once(tmp_path: Path) -> None:
    scenes = [ROCKER.scene(speed=1.0, turns=1, samples=samples) for samples in (5, 7)]
    made = [(check(scene, ["closed_form"]), {"scene": to_dict(scene)}) for scene in scenes]
    jobs = {record.key: job for record, job in made}
    drawn = pictures([record for record, _ in made], lambda r: jobs[r.key], {"closed_form": "closed_form"})
    decades = {d for record, _ in made for d in record.answers[0].quantities["position"].digits_by_sigma}

    positions = [mark for mark in drawn["marks"] if mark["quantity"] == "position"]
    assert sorted(mark["decade"] for mark in positions) == sorted(decades)
    assert 1 <= len(drawn["scenes"]) <= 2


@pytest.mark.parametrize(("seconds", "there"), [(math.inf, "abc"), (15.0, "ab")])
def test_a_mark_is_pictured_by_the_scene_with_its_fewest_digits_the_fewest_first(monkeypatch, seconds, there) -> None:
    digits = {"c": {-3: [5.5], 0: [16.0]}, "a": {-1: [9.0, 12.0], -3: [5.0]}, "b": {-1: [14.0, 8.5], -3: [7.0]}}
    records = [typed(record(name, answer("mujoco", {"position": quantity(of)}))) for name, of in digits.items()]
    asked, now = [], iter((0.0, 10.0, 20.0, 30.0))

    def drawn_at_once(function: Any, jobs: Any) -> Any:
        for job in jobs:
            asked.append(job)
            keys = ("engine", "method", "quantity", "decade")
            marks = [{**dict(zip(keys, mark, strict=True)), "digits": 0.0} for mark in job["marks"]]
            yield {"scene": job["about"], "marks": marks}

    monkeypatch.setattr(sections, "call_in_turn", drawn_at_once)
    monkeypatch.setattr(sections, "time", SimpleNamespace(monotonic=lambda: next(now)))
    drawn = pictures(records, lambda r: {"about": r.scene}, {"mujoco": "a.py", "exudyn": "b.py"}, seconds)
    by_decade = {mark["decade"]: drawn["scenes"][mark["scene"]] for mark in drawn["marks"]}

    assert [job["about"] for job in asked] == [f"scene {name}" for name in there]
    assert by_decade == {d: f"scene {name}" for d, name in {-3: "a", -1: "b", 0: "c"}.items() if name in there}
    assert all(job["specs"] == {"mujoco": "a.py"} for job in asked)


def test_an_engine_that_is_not_there_any_more_is_not_pictured() -> None:
    scene = ROCKER.scene(samples=5)
    drawn = pictures([check(scene, ["closed_form"])], lambda r: {"scene": to_dict(scene)}, {})

    assert (drawn["scenes"], drawn["marks"]) == ([], [])


def test_fitted_slopes_are_those_on_paper() -> None:
    fitted = {line["name"]: (line["expected"], line["fitted"]) for line in slopes()}

    assert set(fitted) == {
        "forward difference",
        "central difference",
        "complex step difference",
        "smallest singular value",
    }
    for expected, value in fitted.values():
        assert (value is None) if expected is None else value == pytest.approx(expected, abs=0.05)


def test_page_says_how_many_of_the_digits_that_the_notes_print_are_right(tmp_path: Path) -> None:
    write_documents(tmp_path)
    _, page = reported(tmp_path)

    assert "1.7 of velocity and 1.9 of acceleration are right" in page


def test_the_smallest_planted_error_that_is_seen_is_a_figure_of_the_report(tmp_path: Path) -> None:
    sharp = {"a": {"velocity": [60.0, 20.0]}, "b": {"velocity": [30.0, 8.0]}, "c": {}}
    records = [record(name, good_answer("mujoco")) for name in sharp]
    for planted, figures in zip(records, sharp.values(), strict=True):
        planted["reference"]["sharpness"] = figures
    report, page = of_run(tmp_path, *records)

    assert report["reference"]["sharpness"] == {
        "velocity": {"scenes": 2, "smallest_seen": 8.0, "median_seen": 14.0, "always_seen": 20.0, "loosest": 60.0}
    }
    assert "How sharp the budgets are" in page


def test_an_error_term_that_documentation_grants_is_shown_at_its_largest(tmp_path: Path) -> None:
    answers = [good_answer("mujoco", granted={"soft constraints": size}) for size in (1e-4, 3e-4)]
    report, page = of_run(tmp_path, *(record(name, item) for name, item in zip("ab", answers, strict=True)))

    assert [row["granted"] for row in report["methods"]] == [{"soft constraints": 3e-4}]
    assert "“soft constraints”: up to 0.0003" in page


def test_what_users_of_an_engine_run_stands_beside_its_method_on_the_first_screen(tmp_path: Path) -> None:
    """By its digits in the price list and its verdicts at hard cases: no drawn scene is sent through it."""
    stepped = {**HARD[1], "method": "mj_step", "class": "documented limit"}
    hard = [*HARD, stepped, {**stepped, "verdict": "correct", "class": None}, {**stepped, "verdict": "refused"}]
    priced = [
        {**PRICES[0], "method": "mj_step, as shipped", "quantity": "position", "digits": digits, "newton_by": "nobody"}
        for digits in (2.25, 3.5)
    ]
    report, page = reported(tmp_path, price=[*PRICES, *priced], hard_cases=hard)
    row = next(row for row in rows_of_first(report) if row["method"] == "mj_step, as shipped")

    assert (row["engine"], row["newton_by"]) == ("mujoco", "nobody")
    assert [cell["best"] for cell in row["cells"]] == [3.5, None, None]
    assert (row["silent"], row["silent_class"]) == (
        "1 of 1 kinds of hard cases that it answers (documented limit)",
        "gap",
    )
    assert re.search("at most</span> <b>3.5</b>", page)
    assert "not asked" in page

    report["methods"] = [row for row in report["methods"] if row["engine"] != "mujoco"]
    (block,) = (block for block in first_table(report) if row["method"] in [r["method"] for r in block["rows"]])
    assert block["head"].startswith("no answer but to other scenes: the most digits")
    assert {row["asked"] for row in block["rows"]} == {True}  # it refused them


ANSWERED = [
    {"times": 4, "compared": 3, "missing": 1, "seconds": 4e-6 * 10**2.005, "granted": {"stopping rule": 2e-9}},
    {"times": 10, "compared": 7, "missing": 2, "seconds": 1e-5, "granted": {"stopping rule": 5e-9, "step": 1e-6}},
    {"times": 2, "compared": 2, "missing": 0, "seconds": 8e-2, "granted": {"stopping rule": 3e-9}},
    {"times": 0, "compared": 0, "missing": 0, "seconds": 1e-9, "granted": {}},
]


def test_a_method_adds_up_its_answers_and_states_the_most_that_it_was_granted():
    """Scenes of 101, 1 and 40,000 microseconds a configuration: the median is a scene's, the mean a configuration's."""
    method = MethodTotals(SimpleNamespace(name="newton", newton_by="nobody"), "1.0")
    for fields, decade in zip(ANSWERED, (-3, -1, -2, None), strict=True):
        method.add(SimpleNamespace(**fields), decade)
    described = method.described()

    assert {k: described[k] for k in ("scenes", "configurations", "compared", "unanswered", "not_compared")} == {
        **{"scenes": 4, "configurations": 16, "compared": 12, "unanswered": 3, "not_compared": 1}
    }
    assert described["granted"] == {"stopping rule": 5e-9, "step": 1e-6}
    assert described["unanswered_by_sigma"] == {"-3": 1, "-1": 2}
    assert described["microseconds_mean"] == pytest.approx(1e6 * sum(each["seconds"] for each in ANSWERED) / 16)
    assert described["microseconds_median"] == pytest.approx(10**2.005, rel=1e-3)
    assert (described["newton_by"], described["version"], "name" in described) == ("nobody", "1.0", False)


def test_a_cell_keeps_its_largest_ratio_and_its_fewest_digits_with_their_places():
    cell, places = Cell(), [RecordLine(str(k), f"scene {k}", k) for k in range(4)]
    for place, ratio, histogram in zip(
        places, (0.5, math.nan, 2.0, 1.5), ({150: 2}, {121: 1, 140: 2}, {90: 0, 130: 3}, {}), strict=True
    ):
        cell.add({-1: histogram}, place)
        cell.meet(ratio, place, None)
    described = cell.described()

    assert (described["scenes"], described["samples"]) == (4, 8)
    assert (described["worst_over_allowed"], described["worst"]["key"]) == (2.0, "2")
    assert (described["digits_worst_at"]["digits"], described["digits_worst_at"]["key"]) == (12.1, "1")
    assert (described["digits_worst"], described["digits_median"]) == (12.1, 13.0)
    assert {decade: row["samples"] for decade, row in described["digits_by_sigma"].items()} == {"-1": 8}


def test_refusals_beyond_the_most_that_are_told_apart_are_counted_together(monkeypatch):
    monkeypatch.setattr(totals, "MOST_VALUES", 3)
    refusals = Refusals()
    names = [("mujoco", "gear"), ("exudyn", "screw"), ("mujoco", "gear"), ("mujoco", "belt"), ("mujoco", "cam")]
    for joints in (names, names[:3], names[4:]):
        refusals.add([SimpleNamespace(engine=e, joint=j, level="solve", reason="none") for e, j in joints])
    rows = [(row["engine"], row["joint"], row["reason"], row["scenes"], row["joints"]) for row in refusals.described()]

    assert rows == [
        ("", "", OTHERS, 2, 2),
        ("exudyn", "screw", "none", 2, 2),
        ("mujoco", "gear", "none", 2, 4),
        ("mujoco", "belt", "none", 1, 1),
    ]


def test_features_that_were_met_together_are_counted_and_the_rarest_cell_comes_last():
    about = {"joints": "revolute", "driver": "angle", "law": "table", "class": "rocker", "hardness": "hard"}
    scenes = [
        about,
        {**about, "law": "sine"},
        {**about, "law": "sine", "distance": 0.02},
        about,
        about,
        {"kind": "own"},
    ]
    together = Together()
    for scene in scenes:
        together.add(scene)
    counted = together.described()
    laws = {tuple(pair["features"]): pair for pair in counted["pairs"]}["decade of the distance", "law"]

    assert [(row[2], row[5], row[-1]) for row in counted["rows"]] == [
        ("table", "none", 3),
        ("sine", "-2", 1),
        ("sine", "none", 1),
    ]
    assert (counted["cells"], counted["once"], shown_together(counted)["unseen"]) == (3, 2, 2 / 5)
    assert (laws["met"], laws["of"], laws["once"], laws["missing"]) == (3, 4, 2, [["-2", "table"]])


def test_folded_sections_say_how_much_is_in_them(tmp_path: Path) -> None:
    report, _ = reported(tmp_path, price=PRICES, effects=EFFECTS, hard_cases=HARD)
    planted = {
        "slopes": [{"fitted": 1.0}, {"fitted": None}, {"fitted": 2.004}],
        "newton_histories": [{"last_order": 1.9}, {"last_order": 2.01}, {"last_order": None}],
        "trends": {"nights": ["a", "b"], "series": [{"changes": {"1": 1.5}}, {"changes": {}}]},
        "golden": {"worse": [1, 2], "cases": 10},
        "features": [{"wrong": 2, "new": 1}, {"wrong": 0, "new": 0}, {"wrong": 1, "new": 0}],
        "known_gaps": [{"disagreements": 3}, {"disagreements": 0}],
        "agreement": [1, 2],
        "refusals": [1],
    }
    nothing = {"slopes": [], "trends": None, "features": [], "agreement": [], "price": None, "hard_cases": None}
    full, bare = folds({**report, **planted}), folds({**report, **nothing})

    assert {name: full[name] for name in planted if name in full} == {
        "features": "3 asked, 2 of them wrong, 1 of these new",
        "agreement": "2 pairs",
        "trends": "golden set of 10 scenes: 2 numbers worse; 2 nights, 1 change of level",
        "refusals": "1 kinds",
    }
    assert full["newton"] == "Newton's last order 1.90 to 2.01; fitted slopes 1.00, 2.00"
    assert [full[name] for name in ("price", "effects", "gaps")] == [
        "4 settings on scenes of 1 class; 0 of 4 prices by a single call",
        "2 of 2 effects priced, 0 of them within noise",
        "2 in the table, 1 met",
    ]
    assert full["hard_cases"] == "1 correct, 1 refused, 1 wrong"
    assert full["disagreements"] == "0 new, 0 known"
    assert [bare[name] for name in ("price", "hard_cases", "newton")] == ["not measured in this run"] * 3
    assert (bare["features"], bare["agreement"]) == ("not asked in this run", "not in the records of this run")
    assert bare["trends"] == "the golden set was not compared in this run; no history was kept with this run"
    one = {**planted, "golden": {"worse": [], "cases": 9}, "trends": {"nights": ["a"], "series": [{"changes": {}}]}}
    assert folds({**report, **one})["trends"] == ("golden set of 9 scenes: nothing worse; 1 night, 0 changes of level")
