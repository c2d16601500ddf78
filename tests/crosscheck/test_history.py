"""Nights in SQLite, changes of level against planted shifts and noise, and what the terminal shows of both."""

from __future__ import annotations

import json
import sqlite3
from contextlib import closing
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from crosscheck.night.history import (
    HistoryError,
    append,
    change_points,
    nights,
    refuse_other,
    remember,
    trends,
    warnings,
)
from crosscheck.report.build import build, summarized

from .fake_engines import crosscheck
from .report_records import good_answer, of_run, record, write

NIGHTS, SHIFT = 90, 60
NOISE = 0.08
"""What times in turns repeat to on a shared machine."""


def course(seed: int, factor: float = 1.0) -> list[float]:
    """Ratios of 90 nights with 8 % noise, 3 % outliers, and a change of level at night 60."""
    draw = np.random.default_rng(seed)
    ratios = np.exp(NOISE * draw.standard_normal(NIGHTS))
    outliers = draw.random(NIGHTS) < 0.03
    ratios[outliers] *= draw.uniform(1.5, 4.0, outliers.sum())
    ratios[SHIFT:] *= factor
    return [float(r) for r in ratios]


@pytest.mark.parametrize("factor", [1.25, 0.8])
def test_a_planted_shift_is_found_where_it_was_planted_and_as_large(factor: float) -> None:
    for seed in range(30):
        changes = change_points(course(seed, factor))
        place, result = min(changes.items(), key=lambda item: abs(item[0] - SHIFT))

        assert abs(place - SHIFT) <= 5
        assert result == pytest.approx(factor, rel=0.1)


def test_noise_alone_raises_hardly_an_alarm() -> None:
    alarms = sum(bool(change_points(course(seed))) for seed in range(100))

    assert alarms <= 5


def test_without_noise_a_constant_has_no_change_and_a_step_has_its_own() -> None:
    assert change_points([1.0] * 20) == {}
    assert change_points([1.0] * 10 + [2.0] * 10) == pytest.approx({10: 2.0})


def test_one_bad_night_is_no_change() -> None:
    ratios = [1.0, 1.01, 0.99, 1.0, 1.02] * 4
    ratios[9] = 50.0

    assert change_points(ratios) == {}


def test_a_change_below_a_twentieth_is_not_told() -> None:
    assert change_points([1.0] * 20 + [1.04] * 20) == {}


def test_of_few_nights_nothing_is_said() -> None:
    assert change_points([1.0, 1.0, 1.0, 9.0, 9.0, 9.0, 9.0]) == {}


def night(folder: Path, day: int, seconds: float = 0.0004, **more: Any) -> Any:
    """A report of one night: its date, and how long mujoco took for four configurations."""
    report, _ = of_run(folder, record("a", good_answer("mujoco", seconds=seconds)))
    return {**report, "date": f"2026-10-{day:02d} 02:17", **more}


def test_nights_come_back_in_order_with_their_digits(tmp_path: Path) -> None:
    for day in (3, 1, 2):
        append(tmp_path / "h.sqlite", night(tmp_path / "run", day))
    kept = nights(tmp_path / "h.sqlite")

    assert [n["date"][:10] for n in kept] == ["2026-10-01", "2026-10-02", "2026-10-03"]
    assert [(a["quantity"], a["digits_worst"]) for a in kept[0]["accuracy"]] == [
        ("position", 14.0),
        ("velocity", 14.0),
        ("acceleration", 14.0),
    ]


def test_the_same_night_once_more_replaces_itself_and_the_ratio_to_the_reference_is_watched(tmp_path: Path) -> None:
    report = night(tmp_path / "run", 1)
    append(tmp_path / "h.sqlite", report)
    append(tmp_path / "h.sqlite", {**report, "verdict": "infrastructure"})

    assert [n["verdict"] for n in nights(tmp_path / "h.sqlite")] == ["infrastructure"]
    (series,) = trends(tmp_path / "h.sqlite")["series"]
    # good_answer: 400 us for 4 configurations; the reference: 2000 us for 4
    assert (series["name"], series["values"]) == ("mujoco · newton", pytest.approx([0.2], rel=0.02))


@pytest.mark.parametrize("lacking", [{"scenes": 0}, {"date": None}])
def test_a_night_in_which_nothing_ran_leaves_no_trace(tmp_path: Path, lacking: Any) -> None:
    assert not append(tmp_path / "h.sqlite", night(tmp_path / "run", 1, **lacking))
    assert not (tmp_path / "h.sqlite").exists()


def test_a_price_is_watched_against_that_of_the_reference_for_the_same(tmp_path: Path) -> None:
    row = {"setting": "k", "quantity": "position", "scene_class": "regular", "digits": 15.0}
    prices = [
        {**row, "engine": "refkin", "method": "newton", "microseconds": 20.0},
        {**row, "engine": "mujoco", "method": "newton", "microseconds": 50.0},
        {**row, "engine": "mujoco", "method": "newton", "microseconds": 60.0, "quantity": "velocity"},
    ]
    append(tmp_path / "h.sqlite", night(tmp_path / "run", 1, price=prices))
    by_name = {s["name"]: s["values"] for s in trends(tmp_path / "h.sqlite")["series"]}

    assert by_name["mujoco · newton, k: position, regular"] == [2.5]
    assert "mujoco · newton, k: velocity, regular" not in by_name


def a_slower_engine(path: Path, folder: Path) -> None:
    report = night(folder, 1)
    for day in range(1, 25):
        slower = 1.5 if day > 19 else 1.0
        routes = [{**row, "microseconds_median": slower * row["microseconds_median"]} for row in report["methods"]]
        append(path, {**report, "date": f"2026-10-{day:02d} 02:17", "methods": routes})


def test_an_engine_that_got_slower_is_warned_of_with_the_night_it_did(tmp_path: Path) -> None:
    a_slower_engine(tmp_path / "h.sqlite", tmp_path / "run")

    text = "time of mujoco · newton, relative to refkin: up by 1.50 times since 2026-10-20 02:17"
    assert warnings(trends(tmp_path / "h.sqlite")) == [text]


def test_series_that_changed_come_first_and_methods_before_prices(tmp_path: Path) -> None:
    path, report = tmp_path / "h.sqlite", night(tmp_path / "run", 1)
    row = {
        "engine": "a",
        "method": "b",
        "setting": "k",
        "quantity": "position",
        "scene_class": "regular",
        "digits": 9.0,
    }
    prices = [{**row, "microseconds": 5.0}, {**row, "engine": "refkin", "microseconds": 1.0}]
    steady = [{**report["methods"][0], "engine": name} for name in ("exudyn", "another")]
    for day in range(1, 25):
        slower = {**report["methods"][0], "microseconds_median": 1.5 if day > 19 else 1.0}
        methods = [*steady, slower]
        append(path, {**report, "date": f"2026-10-{day:02d} 02:17", "methods": methods, "price": prices})

    assert [one["name"] for one in trends(path)["series"]] == [
        "mujoco · newton",
        "another · newton",
        "exudyn · newton",
        "a · b, k: position, regular",
        "refkin · b, k: position, regular",
    ]


def test_a_slower_engine_does_not_fail_the_night_and_stands_on_its_page(tmp_path: Path) -> None:
    a_slower_engine(tmp_path / "h.sqlite", tmp_path / "run")
    write(tmp_path / "run", record("a", good_answer("mujoco", seconds=0.0006)))
    remember(tmp_path / "h.sqlite", summarized(tmp_path / "run"), tmp_path / "run")
    page = build(tmp_path / "run").read_text(encoding="utf-8")
    report = json.loads((tmp_path / "run" / "report.json").read_text(encoding="utf-8"))

    assert report["verdict"] == "pass"
    assert len(report["trends"]["nights"]) == 25
    assert "changed on 2026-10-20 02:17 by a factor" in page


def test_a_file_that_is_no_history_fails_the_night_and_keeps_its_report_or_was_named_and_is_refused(
    tmp_path: Path,
) -> None:
    (tmp_path / "history.sqlite").write_text("not a database at all, but long enough to be looked at" * 20)
    night = ("nightly", "--scenes", 1, "--seed", 1, "--engines", "closed_form", "--out", tmp_path / "run")
    refused = [crosscheck(*night, "--history", other) for other in (tmp_path / "history.sqlite", tmp_path)]

    assert [one.returncode for one in refused] == [4, 4]
    assert refused[0].stderr == f"{tmp_path / 'history.sqlite'}: file is not a database\n"
    below = crosscheck(*night, "--history", tmp_path / "history.sqlite" / "h")  # was told when the night was over
    where = f"expected a folder that can be written to, got {tmp_path / 'history.sqlite'}"
    assert (below.returncode, below.stderr) == (2, f"--history: {where}\n")
    assert not (tmp_path / "run").exists()

    process = crosscheck(*night)
    report = json.loads((tmp_path / "run" / "report.json").read_text(encoding="utf-8"))

    assert (process.returncode, report["verdict"]) == (4, "infrastructure")
    assert "failed: the history cannot be kept" in process.stderr
    assert "the history cannot be kept" in report["failures"][0]


def test_a_night_that_cannot_be_written_leaves_the_others_as_they_were(tmp_path: Path) -> None:
    path = tmp_path / "h.sqlite"
    append(path, night(tmp_path / "run", 1))
    broken = night(tmp_path / "run", 2)
    broken["methods"] = [{"engine": "mujoco"}]

    with pytest.raises(KeyError):
        append(path, broken)
    assert len(nights(path)) == 1


def test_a_small_file_that_is_no_history_is_left_as_it_is(tmp_path: Path) -> None:
    """SQLite takes one of a few bytes for an empty database, and writes over it."""
    path = tmp_path / "notes"
    path.write_text("x", encoding="utf-8")
    with pytest.raises(HistoryError, match="notes: file is not a database"):
        nights(path)

    assert path.read_text(encoding="utf-8") == "x"


def test_a_history_that_is_not_there_is_not_made_by_looking(tmp_path: Path) -> None:
    with pytest.raises(HistoryError, match="there is no history"):
        nights(tmp_path / "h.sqlite")
    assert not (tmp_path / "h.sqlite").exists()


@pytest.mark.parametrize("open_it", [nights, refuse_other])
def test_somebody_elses_database_is_left_as_it_is(tmp_path: Path, open_it: Any) -> None:
    path = tmp_path / "addresses.sqlite"
    with closing(sqlite3.connect(path)) as db:
        db.execute("CREATE TABLE addresses (name TEXT)")
    before = path.read_bytes()
    with pytest.raises(HistoryError, match=r"expected a history of nights, got the tables \['addresses'\]"):
        open_it(path)

    assert path.read_bytes() == before


def test_an_empty_file_is_no_history_to_look_at(tmp_path: Path) -> None:
    (tmp_path / "h.sqlite").touch()
    with pytest.raises(HistoryError, match=r"expected a history of nights, got the tables \[\]"):
        nights(tmp_path / "h.sqlite")

    assert not (tmp_path / "h.sqlite").read_bytes()


def test_two_nights_can_be_added_at_once(tmp_path: Path) -> None:
    """A writer waits for the other's transaction instead of failing."""
    path = tmp_path / "h.sqlite"
    append(path, night(tmp_path / "run", 1))
    with closing(sqlite3.connect(path)) as other, other:
        other.execute("SELECT * FROM night").fetchall()
        append(path, night(tmp_path / "run", 2))

    assert len(nights(path)) == 2


def test_the_terminal_shows_nights_digits_and_the_change(tmp_path: Path, command: Any) -> None:
    a_slower_engine(tmp_path / "h.sqlite", tmp_path / "run")
    code, shown, _ = command("history", "--history", tmp_path / "h.sqlite")

    assert code == 0
    assert "2026-10-24 02:17" in shown
    assert "15.0 / 14.0" in shown
    assert "2026-10-20 02:17: × 1.50" in shown
    assert "warning: time of mujoco" in shown


def test_the_terminal_gives_one_json_object_on_request(tmp_path: Path, command: Any) -> None:
    a_slower_engine(tmp_path / "h.sqlite", tmp_path / "run")
    data = json.loads(command("history", "--history", tmp_path / "h.sqlite", "--json").stdout)

    assert (len(data["nights"]), len(data["warnings"])) == (24, 1)


def test_an_engine_of_another_version_is_told_with_the_night_it_became_so(tmp_path: Path, command: Any) -> None:
    """Digits fell from one night to the next, and nothing said that the engine was another one."""
    for day, versions in enumerate(({"mujoco": "3"}, {"mujoco": "3", "exudyn": "1"}, {"exudyn": "1"}, {"mujoco": "4"})):
        append(tmp_path / "h.sqlite", night(tmp_path / "run", day + 1, versions=versions))
    shown = command("history", "--history", tmp_path / "h.sqlite", "--last", 1).stdout
    data = json.loads(command("history", "--history", tmp_path / "h.sqlite", "--json").stdout)

    assert [line for line in shown.splitlines() if "became" in line] == ["2026-10-04 02:17: mujoco 3 became 4"]
    assert [one["versions"] for one in data["nights"]][2:] == [{"exudyn": "1"}, {"mujoco": "4"}]


def test_what_is_no_history_is_told_in_one_line(tmp_path: Path, command: Any) -> None:
    (path := tmp_path / "h.sqlite").write_text("no database, and long enough to tell" * 40)
    told = command("history", "--history", path)

    assert (told.returncode, told.stderr.count("\n")) == (4, 1)
    assert str(path) in told.stderr


@pytest.mark.parametrize(
    ("table", "set_to"),
    [
        ("cost", "ratio = 'slow'"),
        ("cost", "ratio = 0.0"),
        ("cost", "ratio = -1.0"),
        ("cost", "ratio = 9e999"),
        ("accuracy", "digits_worst = 'few'"),
        ("accuracy", "digits_median = NULL"),
        ("accuracy", "digits_worst = 9e999"),
        ("night", "date = x'00ff'"),
        ("night", "scenes = 'many'"),
        ("night", "versions = '{'"),
        ("night", "versions = '[]'"),
    ],
)
def test_a_history_whose_rows_were_damaged_is_told_in_one_line_with_the_row(
    tmp_path: Path, command: Any, table: str, set_to: str
) -> None:
    a_slower_engine(tmp_path / "h.sqlite", tmp_path / "run")
    with closing(sqlite3.connect(tmp_path / "h.sqlite")) as db, db:
        db.execute(f"UPDATE {table} SET {set_to} WHERE rowid = 2")

    for options in ((), ("--json",)):
        told = command("history", "--history", tmp_path / "h.sqlite", *options)
        assert (told.returncode, told.stdout) == (4, "")
        assert told.stderr.startswith(f"{tmp_path / 'h.sqlite'}: row 2 of its table {table} is damaged: ")
        assert told.stderr.count("\n") == 1
    with pytest.raises(HistoryError):
        refuse_other(tmp_path / "h.sqlite")
