"""Tables and lines of the terminal hold the numbers that they were handed, in their places."""

from __future__ import annotations

import io
import json
from dataclasses import asdict, replace
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest
from rich.console import Console

import refkin
from crosscheck.commands import bench, engines, follow, hunt, nightly, price, solve, usage
from crosscheck.judge.known_gaps import read
from crosscheck.judge.records import Cause, EnclosedTimes, RefusalRow
from crosscheck.measure.hard_table import hard_cases
from crosscheck.night.hunting import Bag, Catch
from crosscheck.night.plan import NightOutcome
from tests.linkages import PARALLELOGRAM, ROCKER

from .report_records import answer, effect_row, good_answer, level, price_row, quantity, record, typed

SCENE = ROCKER.scene(samples=3)


def cells(table: Any) -> list[list[str]]:
    """Return the rows of a table as text."""
    columns = [[str(getattr(cell, "plain", cell)) for cell in column.cells] for column in table.columns]
    return [list(row) for row in zip(*columns, strict=True)]


def priced(method: str, digits: float | None, one: float | None, **more: Any) -> dict[str, Any]:
    prices = {"setting": "", "microseconds_one": one, "microseconds": 12.34, "microseconds_to_build": 2500.0, **more}
    return asdict(price_row(engine="mujoco", method=method, newton_by="it", digits=digits, **prices))


def test_of_each_method_the_setting_of_most_digits_is_shown_with_its_three_prices():
    rows = [
        priced("newton", 9.0, 123.4, setting="1e-3"),
        priced("newton", 12.0, 150.6, setting="1e-9"),
        priced("newton", 11.0, 1.0, setting="1e-6"),
        priced("none", None, 5.0),
    ]

    assert cells(price.methods_table(rows)) == [
        ["mujoco", "newton, 1e-9", "it", "2.5", "12.0", "151/12.3/-"],
        ["mujoco", "none", "it", "2.5", "-", "-"],
    ]


def test_all_that_is_shown_of_a_method_is_of_one_setting_that_of_the_most_digits_where_it_has_fewest():
    """So nothing costs more for position than for position with rates, for want of one setting for both."""
    digits = {"1 step": (9.0, 5.0, 4.0, 26.0), "10 steps": (9.1, 5.1, 4.5, 62.0), "100 steps": (9.2, None, 4.6, 700.0)}
    rows = [
        priced("steps", found, cost + k, setting=setting, quantity=quantity, microseconds_to_build=cost)
        for setting, (*of, cost) in digits.items()
        for k, (quantity, found) in enumerate(zip(("position", "velocity", "acceleration"), of, strict=True))
    ]
    shown = ["9.1", "62.0/12.3/-", "5.1", "63.0/12.3/-", "4.5", "64.0/12.3/-"]

    assert cells(price.methods_table(rows)) == [["mujoco", "steps, 10 steps", "it", "0.062", *shown]]
    assert cells(price.methods_table(rows[::-1]))[0][1] == "steps, 10 steps"


def test_the_cheapest_is_shown_with_the_second_and_whether_they_differ():
    first = {"microseconds": 5.0, "digits": 9.0, "engine": "a", "method": "newton", "setting": "k"}
    second, third = ({**first, "engine": "b", "microseconds": x, "setting": ""} for x in (6.0, 7.0))
    near = {**first, "second": second, "unsure": None, "differs": False}
    unsure = {**near, "differs": True, "unsure": third}
    offers = [None, {**first, "second": None, "unsure": None}, near, {**near, "unsure": second}, unsure]
    table = price.cheapest_table({str(k): dict.fromkeys(map(str, price.STEPS), o) for k, o in enumerate(offers)}, "all")
    own = "5.0 us (9.0 digits) a: newton, k"

    assert cells(table)[0] == [
        str(price.STEPS[0]),
        "nobody",
        f"{own}\nnobody else",
        f"{own}\n~ 6.0 us (9.0 digits) b: newton",
        f"{own}\n~ 6.0 us (9.0 digits) b: newton",
        f"{own}\n< 6.0 us (9.0 digits) b: newton\n? 7.0 us (9.0 digits) b: newton",
    ]


def test_a_price_list_says_what_it_left_out_and_who_gave_no_digits():
    rows = [priced("newton", 9.0, None), priced("steps", None, None, setting="1e-3", note="it ended")]
    made_on = {"machine": {"processor": "a", "system": "b", "cores": 2}, "versions": {"c": "1"}, "refused": []}
    said = price.lines({"times": {"priced": 73, "asked": 80, "certified": 70}, "rows": rows, **made_on})
    whole = price.lines({"times": {"priced": 73, "asked": 73, "certified": 73}, "rows": rows[:1], **made_on})

    assert said[5:] == [
        "a cycle has 73 of the scene's 80 times, evenly spread",
        "3 of 73 times are outside the longest run with a certified truth: nobody is asked there",
        *(
            f"{price.POSES[k]}: nothing was timed, for want of time or of several times in the scene"
            for k in ("one", "bulk")
        ),
        "a, b, 2 cores, c 1",
        "mujoco, steps, 1e-3: it ended",
    ]
    assert said[0] == price.ADAPTERS
    assert said[1].startswith("one cycle: 70 configurations;")
    assert whole[2:] == said[2:5] + said[7:10]


def test_a_course_is_a_block_for_each_night_as_high_as_its_ratio():
    assert nightly._blocks([1.0, 8.0, 2.0, 4.4]) == "▁█▂▄"
    assert nightly._blocks([3.0, 3.0]) == "▁▁"


def test_digits_of_nights_are_those_of_the_last_and_the_range_of_the_worst():
    def night(*rows: tuple[str, float | None, float | None]) -> Any:
        keys = ("engine", "method", "quantity", "digits_median", "digits_worst")
        return {"accuracy": [dict(zip(keys, ("a", "newton", *row), strict=True)) for row in rows]}

    kept = [
        night(("position", 15.0, 9.0), ("velocity", 14.0, 13.0)),
        night(("position", 15.1, 12.0), ("velocity", None, None)),
        night(("position", 15.2, 11.0), ("velocity", None, None)),
    ]

    assert cells(nightly._digit_table(kept)) == [["a", "newton", "15.2 / 11.0 (9.0 to 12.0)", "no answer", "no answer"]]


def test_of_the_price_list_only_what_changed_is_shown_with_its_course():
    nights = ["2026-10-01 02:17", "2026-10-02 02:17"]
    quiet = {"nights": nights, "values": [1.0, 2.0], "changes": {}}
    series = [
        {**quiet, "name": "a · b", "priced": False},
        {**quiet, "name": "a · b, k: position, regular", "priced": True},
    ]
    series.append({**series[1], "changes": {"1": 1.5}})

    assert cells(nightly._cost_table(series)) == [
        ["a · b", "2", "2", "▁█", "none"],
        ["a · b, k: position, regular", "2", "2", "▁█", "2026-10-02 02:17: × 1.50"],
    ]


def test_agreement_rows_and_certificates_stand_by_engine_and_method():
    places = EnclosedTimes(inside=3, outside=1, undecidable=0, no_answer=2, radii=1.25)
    sparse = answer(
        "exudyn", {"position": quantity({-1: [14.0, 9.5], 0: [12.0]}, 0.25), "velocity": quantity({0: [9.0]}, None)}
    )
    planted = record(
        "a",
        good_answer("mujoco"),
        {**sparse, "missing": 1, "compared": 3},
        levels=[level("mujoco", "drift", [13.0, 9.0])],
    )
    met = typed(planted)
    certified = [met.answers[0], replace(met.answers[1], certificate=places)]

    assert [row[4:] for row in cells(engines.agreement_table(met))] == [
        ["14.0", "0.5", "14.0", "0.5", "14.0", "0.5", "0 of 4"],
        ["9.5", "0.25", "9.0 at 1 of 3", "-", "-", "-", "1 of 4"],
    ]
    assert {row[3] for row in cells(engines.agreement_table(met))} == {"an estimate"}  # as the report says it
    narrow = cells(engines.agreement_table(met, 80))
    assert [row[1:] for row in narrow[-3:]] == [
        ["static newton", "position", "9.5", "0.25", "1 of 4"],
        ["static newton", "velocity", "9.0 at 1 of 3", "-", "1 of 4"],
        ["static newton", "acceleration", "-", "-", "1 of 4"],
    ]
    assert cells(engines.rows_table(met)) == [["mujoco", "drift", "8", "9.0", "0.25"]]
    assert [row[2:] for row in cells(engines.arbiter_table(replace(met, answers=certified)))] == [
        ["-"] * 5,
        ["3", "1", "0", "2", "1.2"],
    ]


@pytest.mark.parametrize("width", [60, 80, 200])
def test_a_table_of_hard_cases_breaks_no_word_and_loses_no_verdict(monkeypatch, width):
    terminal = io.StringIO()
    monkeypatch.setattr(hunt, "console", lambda _: Console(file=terminal, width=width))
    methods = [("exudyn", f"static, setting {k}") for k in range(4)] + [("pinocchio", "undamped, constrained")] * 2
    about = {"setting": "", "of": 87, "class": None, "note": "", "case": "dead centre", "distance": 1e-6}
    hunt._print_table(
        [{**about, "engine": e, "method": f"{m} {k}", "verdict": "correct"} for k, (e, m) in enumerate(methods)]
    )
    text = terminal.getvalue()

    assert max(map(len, text.splitlines())) <= width
    assert (text.count("exudyn"), text.count("undamped,"), text.count("correct") >= 6) == (4, 2, True)
    assert (text.count("Hard cases") > 1) == (width < 100)


def test_a_table_of_certificates_breaks_no_word_at_80_columns():
    terminal = io.StringIO()
    met = typed(record("a", answer("exudyn", {"position": quantity({0: [12.0]}, 0.25)})))
    met = replace(met, answers=[replace(met.answers[0], engine="refkin-batch")])
    Console(file=terminal, width=80).print(usage.fitted(engines.arbiter_table(met), 80))

    assert all(word in terminal.getvalue() for word in ("refkin-batch", "undecidable"))


def test_a_refusal_names_the_engine_and_a_gap_that_may_be_closed_says_which_it_is():
    reasons = ("not today", "mujoco refuses hinges")
    refused = [RefusalRow(engine="mujoco", reason=reason) for reason in reasons]
    gap = next(gap for gap in read() if gap.kind == Cause.OTHER_ASSEMBLY)
    (closed,) = engines.outcome_lines(NightOutcome(versions={}, missing={}, possibly_closed=[(gap, 9)]))

    assert engines.refusal_lines(refused) == ["mujoco refuses: not today", reasons[1]]
    assert f"({gap.predicate}: shipped, other assembly) showed in none of 9 scenes" in closed


def test_the_worst_of_a_hunt_stands_first_and_each_has_its_scene(tmp_path, capsys):
    places = {"a": 2.0, "b": 9.0, "c": 0.5}
    catches = {
        ("e", "r", name): Catch(ratio, SCENE, "1e-1 .. 1e-3", k) for k, (name, ratio) in enumerate(places.items())
    }
    bag = Bag(catches, 7, ["one that failed"])
    for _ in range(2):  # into the same folder again, where what is there stays
        hunt._write_bag(bag, tmp_path / "deep" / "out", ["own.py:Mine"])
    hunt._print_bag(bag, tmp_path)
    shown = capsys.readouterr().out
    files = sorted(path.name for path in (tmp_path / "deep" / "out").iterdir())

    assert files == [f"e-r-{name}{again}.toml" for name in "abc" for again in ("-2", "")]
    text = (tmp_path / "deep" / "out" / "e-r-b.toml").read_text(encoding="utf-8")
    assert text.startswith(
        "# e r b: 9 times the allowed error, the worst of 7 scenes\n# Show it again: crosscheck replay"
    )
    assert refkin.load(tmp_path / "deep" / "out" / "e-r-b.toml") == SCENE
    order = [shown.index(f" {ratio} ") for ratio in ("9", "2", "0.5")]
    assert order == sorted(order)
    assert "to blame" not in shown  # by the judge alone
    assert "failed: one that failed" in shown


def test_hard_cases_of_the_kinds_that_are_asked_for_are_asked_in_their_order():
    every, some = [case.key for case in hard_cases()], ("toggle", "large offset")

    assert [case.key for case in hunt._cases(())] == every
    assert [case.key for case in hunt._cases(some)] == [case.key for case in hard_cases() if case.case in some]


def test_hard_cases_are_counted_by_verdict_and_what_is_wrong_stands_with_its_reason(capsys):
    keys = ("engine", "method", "setting", "case", "distance", "of", "verdict", "class", "quote", "note")
    rows = [
        ("a", "newton", "", "toggle", 0.01, 3, "correct", None, None, ""),
        ("a", "newton", "", "toggle", 0.001, 3, "wrong", "defect", "so it is", "far off"),
        ("b", "newton", "", "toggle", 0.01, 3, "hang", None, None, "never came"),
    ]
    hunt._print_table([dict(zip(keys, row, strict=True)) for row in rows])
    shown = capsys.readouterr().out
    counts = {line.split("│")[1].strip(): line.split("│")[3:5] for line in shown.splitlines() if "all: " in line}

    assert "Hard cases: 2 of 3, the same for all engines" in shown
    assert {name: [int(x) for x in cell] for name, cell in counts.items() if any(int(x) for x in cell)} == {
        "all: correct": [1, 0],
        "all: wrong": [1, 0],
        "all: hang": [0, 1],
    }
    assert "a (newton), wrong: defect: so it is\n  toggle, 0.001: far off" in shown
    assert "b (newton), hang: no finding explains this\n  toggle, 0.01: never came" in shown


def test_effects_that_are_known_stand_in_the_table_and_those_that_are_felt_in_a_line():
    felt = effect_row("gravity", inert=False, largest_change=0.25, worst="rocker.phi at t = 1")
    rows = [effect_row("velocity", largest_change=0.0), felt, effect_row("sensors", inert=None, microseconds=None)]

    assert [row[:2] + row[5:7] for row in cells(bench.ledger_table("any", rows))] == [
        ["made up, newton", "velocity", "yes", "0"],
        ["", "gravity", "no", "0.25"],
    ]
    assert bench.felt_lines(rows) == ["not inert: gravity in made up, newton: changes rocker.phi at t = 1 by 0.25"]
    assert bench.felt_lines(rows[:1]) == ["every effect that was measured is inert where it is not called for"]
    assert bench.felt_lines(rows[2:]) == ["no effect was measured"]


def test_what_a_benchmark_judged_is_said_where_it_is_a_part():
    row = {
        "engine": "a",
        "method": "newton",
        "setting": "",
        "note": "in C",
        "timed": 1000,
        "compared": 100,
        "uncompared": 3,
    }
    rows = [{**row, "unit": "configuration"}, {**row, "unit": "newton-iteration", "uncompared": 0}]

    assert bench.notes(rows) == [
        "  a, newton: in C (timed 1,000; compared 100, no budget holds at 3 of the sample)",
        "  a, newton: in C (timed 1,000)",
    ]


def test_rows_without_a_number_share_one_and_no_number_at_all_is_told(capsys):
    columns = {"t": [0.0, 1.0, 2.0, 3.0], "status": ["ok", "lost", "lost", "none"], "x": [0.125, *[np.nan] * 3]}
    printed = usage.print_numbers({**columns, "y": [0.1, *[np.nan] * 3]}, 2)
    lines = [line.split("│")[1:-1] for line in capsys.readouterr().out.splitlines() if line.startswith("│")]

    assert printed
    assert [[cell.strip() for cell in line] for line in lines] == [
        ["0", "ok", "0.125", "0.1"],
        ["1 ... 2", "lost (2 times)", "-", "-"],
        ["3", "none (1 times)", "-", "-"],
    ]
    assert not usage.print_numbers({**columns, "x": [np.nan] * 4}, 2)
    assert capsys.readouterr().out == ""


@pytest.mark.parametrize("width", [30, 60, 200])
def test_on_a_narrow_terminal_numbers_stand_whole_in_several_tables(monkeypatch, width):
    """They stood in one, of columns too narrow for any number."""
    terminal = io.StringIO()
    terminal.isatty = lambda: True
    monkeypatch.setattr("sys.stdout", terminal)
    monkeypatch.setenv("COLUMNS", str(width))
    columns = {f"c{k} [m]": [k + 1 / 3, -k - 2 / 3] for k in range(5)}
    usage.print_numbers({"t [s]": [0.0, 0.5], "status": ["ok", "ok"], **columns}, 2)
    lines = terminal.getvalue().splitlines()
    cells = [cell.strip() for line in lines for cell in line.split("│")[1:-1]]

    assert max(map(len, lines)) <= max(width, 39)
    assert {f"{x:.15g}" for column in columns.values() for x in column} <= {*cells}
    assert cells.count("0.5") == sum(line.startswith("┏") for line in lines) == {30: 5, 60: 3, 200: 1}[width]


@pytest.mark.parametrize(("count", "minutes", "part"), [(8, None, "25%"), (None, 2.0, "50%")])
def test_a_bar_shows_the_part_that_is_done_of_a_count_or_of_the_time(monkeypatch, count, minutes, part):
    shown: list[Any] = []
    terminal = io.StringIO()
    monkeypatch.setattr("rich.console.Console", lambda **_: Console(file=terminal, force_terminal=True, width=100))
    monkeypatch.setattr(
        "rich.progress.Progress.update", lambda self, task, **what: shown.append((self.tasks[0].total, what))
    )
    now = iter([100.0, *[160.0] * 99])
    monkeypatch.setattr(usage, "time", SimpleNamespace(monotonic=lambda: next(now)))
    with usage.shown_progress(count, minutes) as show:
        show(2, "checking")
    ((total, what),) = shown

    assert f"{what['completed'] / total:.0%}" == part
    assert what["description"] == "checking: 2 scenes"


def test_a_path_says_how_bodies_turn_by_its_parameter_and_how_it_ended(tmp_path, command, monkeypatch):
    path = refkin.follow(SCENE)
    text = follow._direction(path, "driver", path.q[:, 0], SimpleNamespace(q=path.q[:, 0] * 0 + 6.0, t=2.0))
    still = follow._direction(path, "driver", path.q[:, 0], SimpleNamespace(q=path.q[:, 0] * 0 + 6e8, t=0.5))

    assert text == "crank 3, coupler 3, rocker 3 rad per unit of driver"
    assert still == "crank 6e+08, coupler 6e+08, rocker 6e+08 with the parameter at rest"
    few = command("follow", SCENE, "--most-points", 3)
    whole = command("follow", SCENE, "--json")
    assert (few.returncode, whole.returncode) == (1, 0)
    assert json.loads(whole.stdout)["scene"]


def test_a_singular_pose_is_said_with_its_tangents_and_as_plain_data(command):
    scene = PARALLELOGRAM.scene(times=[0.0], law=refkin.Polynomial(coefficients=(0.0,)))
    words, data = command("diagnose", scene), json.loads(command("diagnose", scene, "--json").stdout)

    assert words.returncode == 1
    assert words.stdout.count("tangent: ") == len(data["tangents"]) > 0
    assert words.stdout.startswith(f"verdict: {data['verdict']}\nt = 0\n{data['message']}\n")
    assert solve.hardest(refkin.solve(SCENE)) == int(np.argmin(refkin.solve(SCENE).sigma_min))
