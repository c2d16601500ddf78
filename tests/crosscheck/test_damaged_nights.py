"""The folder of a night with a wrong value in it, planted: the report says so, and is written all the same."""

from __future__ import annotations

from dataclasses import asdict
from pathlib import Path
from typing import Any

import pytest

from .report_records import good_answer, of_run, price_row, record

HARD = {
    "engine": "mujoco",
    "method": "newton",
    "setting": "",
    "case": "toggle",
    "distance": 1e-3,
    "of": 87,
    "verdict": "wrong",
    "class": "documented limit",
    "quote": "it says so",
    "note": "",
}
PRICE = {**asdict(price_row()), "scene_class": "regular"}


def refused(folder: Path, name: str, rows: Any) -> str:
    """Return what a report says of a file that it cannot take."""
    report, _ = of_run(folder, record("a", good_answer("mujoco")), **{name: rows})

    assert (report["verdict"], report[name]) == ("infrastructure", None)
    (failure,) = report["failures"]
    assert failure.startswith(f"{name}.json cannot be read: 0.")
    return str(failure)


@pytest.mark.parametrize(
    ("key", "value"),
    [("of", None), ("of", -1), ("distance", "near"), ("class", "because"), ("class", 5), ("setting", 3)],
)
def test_a_cell_of_the_hard_cases_that_is_none_is_told_with_its_key(tmp_path: Path, key: str, value: Any) -> None:
    """A made-up class would stand for an explanation of what is wrong, and the night would pass."""
    assert f"0.{key}: {value!r}; " in refused(tmp_path, "hard_cases", [{**HARD, key: value}])


def test_what_is_wrong_at_a_hard_case_and_has_no_class_in_the_file_of_an_older_version_is_not_explained(
    tmp_path: Path,
) -> None:
    older = {key: HARD[key] for key in ("engine", "method", "case", "verdict")}
    report, page = of_run(tmp_path, record("a", good_answer("mujoco")), hard_cases=[older])

    assert report["verdict"] == "new disagreements"
    assert "not explained" in page


@pytest.mark.parametrize(
    ("rows", "said"),
    [
        ([HARD, HARD], "mujoco · newton was asked toggle at 0.001 twice"),
        ([HARD, {**HARD, "distance": 1e-5, "of": 66}], "of 66 and of 87 cases"),
        ([{**HARD, "of": 1}, {**HARD, "of": 1, "distance": 1e-5}], "2 of 1 cases"),
    ],
)
def test_rows_of_hard_cases_that_contradict_each_other_are_told(tmp_path: Path, rows: Any, said: str) -> None:
    report, _ = of_run(tmp_path, record("a", good_answer("mujoco")), hard_cases=rows)

    assert report["verdict"] == "infrastructure"
    assert report["failures"] == [f"hard_cases.json contradicts itself: {said}"]


@pytest.mark.parametrize(
    ("key", "value"),
    [
        ("digits_one", "many"),
        ("microseconds_bulk", "many"),
        ("microseconds_one", -5.0),
        ("microseconds_to_build", "many"),
        ("spread_bulk", "wide"),
        ("unasked_bulk", -3.0),
        ("note", 5),
    ],
)
def test_a_price_that_is_none_is_told_with_its_key(tmp_path: Path, key: str, value: Any) -> None:
    assert f"0.{key}: {value!r}; " in refused(tmp_path, "price", [{**PRICE, key: value}])


SERIES = {"name": "mujoco", "priced": False, "nights": ["a", "b"], "values": [1.0, 2.0], "changes": {"1": 2.0}}


@pytest.mark.parametrize(
    ("key", "value"),
    [
        ("name", None),
        ("nights", []),
        ("nights", ["a"]),
        ("nights", "ab"),
        ("values", True),
        ("values", [1.0, "slow"]),
        ("values", [1.0, -2.0]),
        ("changes", None),
        ("changes", {"2": 2.0}),
        ("changes", {"one": 2.0}),
    ],
)
def test_a_course_of_times_that_is_none_is_told_with_its_place(tmp_path: Path, key: str, value: Any) -> None:
    """Instead of the report stood a fault of our own."""
    trends = {"nights": ["a", "b"], "series": [{**SERIES, key: value}]}
    report, _ = of_run(tmp_path, record("a", good_answer("mujoco")), trends=trends)

    assert (report["verdict"], report["trends"]) == ("infrastructure", None)
    assert report["failures"][0].startswith("trends.json cannot be read: series.0")


@pytest.mark.parametrize("value", [5e-324, 1e-320, 2.3e-308])
def test_a_number_that_is_hardly_one_is_shown(tmp_path: Path, value: float) -> None:
    bare = record("a", good_answer("mujoco"))
    planted = {**bare, "reference": {**bare["reference"], "sigma_min": value}}
    report, _ = of_run(tmp_path, planted, price=[{**PRICE, "microseconds": value}])

    assert report["reference"]["smallest_sigma_min"]["value"] == value


MARK = {
    "engine": "exudyn",
    "method": "static",
    "quantity": "position",
    "decade": -1,
    "digits": 9.0,
    "time": 0.0,
    "factor": 10.0,
    "scene": 0,
    "pose": [[1.0, 2.0, 3.0]],
    "ghost": [],
    "arrows": [[0.0, 0.0, 9.0, 9.0, 9.0, 8.0]],
    "cycle": {"factor": 10.0, "frames": [None, [[1.0, 2.0, 3.0]]]},
}
PART = {"path": "M0 0", "pins": [[0.0, 0.0]], "guide": ""}
DRAWN = {"name": "a", "key": "b", "ground": [[0.0, 0.0]], "guide": "", "parts": [PART], "frames": [[[1.0, 2.0, 3.0]]]}


@pytest.mark.parametrize(
    ("key", "value"),
    [("scene", 1), ("scene", -1), ("quantity", {}), ("decade", "near"), ("digits", None), ("cycle", 0.5), ("time", "")]
    + [
        (key, value)
        for key in ("pose", "ghost", "arrows")
        for value in (None, 3, "M0 0", [1.0], [["x", 0.0]], [[10**400] * 6])
    ]
    + [("pose", [[0.0, 0.0, 0.0]] * 2), ("ghost", [[0.0, 0.0, 0.0]] * 2), ("arrows", [[0.0, 0.0]])]
    + [("cycle", {"factor": 1.0}), ("cycle", {"factor": 1.0, "frames": [[[0.0, 0.0, 0.0]] * 2]})],
)
def test_a_mark_without_a_picture_is_told_with_its_place(tmp_path: Path, key: str, value: Any) -> None:
    pictures = {"width": 300, "height": 190, "scenes": [DRAWN], "marks": [{**MARK, key: value}]}
    report, _ = of_run(tmp_path, record("a", good_answer("mujoco")), pictures=pictures)

    assert report["verdict"] == "infrastructure"
    assert report["failures"][0].startswith("pictures.json cannot be read: ")


@pytest.mark.parametrize("key", DRAWN)
@pytest.mark.parametrize("value", [None, 3, [3], [[["x"]]], ...])
def test_a_scene_without_a_picture_is_told_with_its_place(tmp_path: Path, key: str, value: Any) -> None:
    """Instead of the report stood a fault of our own."""
    drawn = {k: v for k, v in {**DRAWN, key: value}.items() if v is not ...}
    pictures = {"width": 300, "height": 190, "scenes": [drawn], "marks": [MARK]}
    report, _ = of_run(tmp_path, record("a", good_answer("exudyn")), pictures=pictures)

    assert report["verdict"] == "infrastructure"
    assert report["failures"][0].startswith(f"pictures.json cannot be read: scenes.0.{key}")


def test_pictures_of_an_engine_whose_records_were_lost_are_not_shown(tmp_path: Path) -> None:
    pictures = {"width": 300, "height": 190, "scenes": [DRAWN], "marks": [MARK]}
    report, _ = of_run(tmp_path, pictures=pictures)

    assert report["verdict"] == "nothing ran"
    assert report["poses"]["marks"] == []


def test_a_record_of_another_run_is_told(tmp_path: Path) -> None:
    records = [record(name, good_answer("mujoco"), run=run) for name, run in (("a", "one"), ("b", "one"), ("c", "two"))]
    report, _ = of_run(tmp_path, *records)

    assert report["verdict"] == "infrastructure"
    assert report["failures"] == ["records.jsonl holds records of 2 runs: 'one' (2), 'two' (1)"]


@pytest.mark.parametrize(
    ("key", "value"),
    [
        *[("seconds", -1.0), ("compared", 5), ("missing", 4), ("times", 3)],
        *[("ratio", -5.0), ("digits_by_sigma", {"-1": {"171": 4}})],
    ],
    ids=str,
)
def test_an_answer_whose_numbers_cannot_be_is_no_record(tmp_path: Path, key: str, value: Any) -> None:
    wrong = good_answer("mujoco")
    of_position = wrong["quantities"]["position"]
    (of_position if key in of_position else wrong)[key] = value
    report, _ = of_run(tmp_path, record("a", wrong))

    assert report["verdict"] == "infrastructure"
    where = f".quantities.position.{key}" if key in of_position else ""
    assert report["failures"][0].startswith(f"records.jsonl, line 1 is no record: answers.0{where}")


def test_a_record_that_holds_one_answer_twice_is_told(tmp_path: Path) -> None:
    """It was counted twice: of one scene 8 times of 4 were right."""
    report, _ = of_run(tmp_path, record("a", *[good_answer("mujoco")] * 2))

    assert report["verdict"] == "infrastructure"
    (failure,) = report["failures"]
    assert failure.endswith("answers: mujoco (newton) more than once; expected each method once")
