"""A baseline with a wrong value in it, planted at every depth: it is refused by its key, before a scene is drawn."""

from __future__ import annotations

import copy
import json
import re
from pathlib import Path
from typing import Any

import pytest

from crosscheck.commands import nightly
from crosscheck.night.baseline import DEFAULT, NoBaseline, read_baseline

from .fake_engines import crosscheck

NAME = "crank-rocker open"
ACCEPTED = json.loads(DEFAULT.read_text(encoding="utf-8"))
ONE: dict[str, Any] = {**ACCEPTED, "cases": {NAME: ACCEPTED["cases"][NAME]}}
METHOD = f"cases.{NAME}.methods.exudyn.static"


def planted(where: str, value: Any) -> dict[str, Any]:
    """Return the baseline with a value at a place, named by keys; with `...` for a value the place is empty."""
    *path, last = [int(key) if key.isdigit() else key for key in where.split(".")]
    whole = inside = copy.deepcopy(ONE)
    for key in path:
        inside = inside[key]
    if value is ...:
        del inside[last]
    else:
        inside[last] = value
    return whole


def refused(folder: Path, text: str) -> str:
    """Return why a baseline is refused."""
    path = folder / "b.json"
    path.write_text(text, encoding="utf-8")
    with pytest.raises(NoBaseline) as told:
        read_baseline(path)
    assert str(told.value).startswith(f"{path} is no baseline: ")
    return str(told.value).removeprefix(f"{path} is no baseline: ")


@pytest.mark.parametrize(
    ("where", "value"),
    [
        ("schema", 2),
        ("versions", []),
        ("cases", {}),
        (f"cases.{NAME}", 3),
        (f"cases.{NAME}.scene", []),
        (f"cases.{NAME}.reference", ...),
        (f"cases.{NAME}.reference.status", "ok"),
        (f"cases.{NAME}.reference.status.2", "fine"),
        (f"cases.{NAME}.reference.velocity", ...),
        (f"cases.{NAME}.reference.velocity.3.1", "fast"),
        (f"cases.{NAME}.reference.certified_radius.position", 1.0),
        (f"cases.{NAME}.reference.certified_radius.position.1", -1e-15),
        (f"cases.{NAME}.rounding", []),
        (f"cases.{NAME}.rounding.position", ...),
        (f"cases.{NAME}.rounding.position", [14.4]),
        (f"cases.{NAME}.methods", []),
        (METHOD, 1),
        (f"{METHOD}.missing", "many"),
        (f"{METHOD}.missing", -1),
        (f"{METHOD}.ratio", 0.1),
        (f"{METHOD}.ratio.velocity", "little"),
        (f"{METHOD}.position", [15.6]),
        (f"{METHOD}.position", [15.6, 15.3, 15.0]),
        (f"{METHOD}.position", [15.6, None]),
        (f"{METHOD}.position", 15.6),
        (f"{METHOD}.positoin", [15.6, 15.3]),
        (f"{METHOD}", {"missing": 0, "ratio": {"position": 0.1}}),
        (f"{METHOD}", {"missing": 0, "ratio": {}, "position": [15.6, 15.3]}),
    ],
)
def test_a_value_that_is_none_is_told_with_its_key(tmp_path: Path, where: str, value: Any) -> None:
    """It ended in a fault of our own, or as digits that nothing was held against."""
    assert refused(tmp_path, json.dumps(planted(where, value))).startswith(f"{where}")


@pytest.mark.parametrize("text", ["[]", "3", "null", '"cases"'])
def test_what_is_no_table_is_refused(tmp_path: Path, text: str) -> None:
    assert refused(tmp_path, text) == f"the line: {json.loads(text)!r}; input should be an object"


@pytest.mark.parametrize("number", ["NaN", "Infinity", "1e999"])
def test_a_number_that_is_not_finite_is_told_with_its_key(tmp_path: Path, number: str) -> None:
    text = json.dumps(planted(f"{METHOD}.position.0", 123.25)).replace("123.25", number)

    assert refused(tmp_path, text).startswith(f"{METHOD}.position.0")


@pytest.mark.parametrize(
    ("where", "said"),
    [
        ("status.6", "6 values; expected 7"),
        ("position.6", "6 values; expected 7"),
        ("acceleration.2.8", "8 values; expected 9"),
        ("certified_radius.velocity.0", "6 values; expected 7"),
        ("certified_radius.velocity", "0 values; expected 7"),
    ],
)
def test_numbers_that_are_not_those_of_the_scene_are_no_fault_of_the_reference(
    tmp_path: Path, where: str, said: str
) -> None:
    """What is not there was told as a reference that has left its proof."""
    key = where if where.endswith("velocity") else where.rpartition(".")[0]
    found = refused(tmp_path, json.dumps(planted(f"cases.{NAME}.reference.{where}", ...)))
    assert found == f"cases.{NAME}.reference.{key}: {said}"


@pytest.mark.parametrize("value", [None, []])
@pytest.mark.parametrize("quantity", ["position", "velocity", "acceleration"])
def test_a_level_that_the_scene_calls_for_and_the_file_lacks_is_no_fault_of_the_reference(
    tmp_path: Path, quantity: str, value: Any
) -> None:
    """It was told as a reference that has left its proof."""
    key = f"cases.{NAME}.reference.{quantity}"
    assert refused(tmp_path, json.dumps(planted(key, value))).startswith(f"{key}: ")


def test_a_level_that_the_scene_does_not_call_for_is_no_fault_of_the_reference(tmp_path: Path) -> None:
    found = refused(tmp_path, json.dumps(planted(f"cases.{NAME}.scene.effects", ["velocity"])))
    assert found == f"cases.{NAME}.reference.acceleration: 7 values; expected 0"


def test_a_scene_that_is_none_is_told_with_its_case(tmp_path: Path) -> None:
    text = json.dumps(planted(f"cases.{NAME}.scene.joint.0.type", "hinge"))

    assert re.match(rf"cases\.{NAME}\.scene: .*hinge", refused(tmp_path, text))


def test_a_file_that_was_cut_short_anywhere_is_refused(tmp_path: Path) -> None:
    text = json.dumps(ONE)

    assert all("invalid JSON" in refused(tmp_path, text[:place]) for place in range(0, len(text), 997))


def test_the_baseline_of_a_night_is_read_before_it_begins_also_if_it_was_not_asked_for(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, command: Any
) -> None:
    """A night of an hour ended without a report."""
    (tmp_path / "b.json").write_text("{")
    monkeypatch.setattr(nightly, "DEFAULT", tmp_path / "b.json")
    told = command("nightly", "--scenes", "1", "--engines", "closed_form", "--out", tmp_path / "out")

    assert (told.returncode, (tmp_path / "out").exists()) == (2, False)
    assert told.stderr.startswith(f"{tmp_path / 'b.json'} is no baseline: ")


@pytest.mark.parametrize("text", [b"\xff\xfe\x00", b"", b"[" * 100_000])
def test_what_is_no_text_is_refused_by_every_command(tmp_path: Path, text: bytes) -> None:
    (tmp_path / "b.json").write_bytes(text)
    told = crosscheck("baseline", "--engines", "closed_form", "--file", tmp_path / "b.json")

    assert told.returncode == 2
    assert told.stderr.startswith(f"{tmp_path / 'b.json'} is no baseline: ")
    assert told.stderr.count("\n") == 1


@pytest.mark.parametrize("text", ["notes", "{}", json.dumps({**ONE, "schema": 2})])
def test_what_is_no_baseline_is_not_replaced_by_one(tmp_path: Path, text: str, command: Any) -> None:
    """Whatever file was named was written over without a word, and so was a baseline that a merge had damaged."""
    (path := tmp_path / "b.json").write_text(text)
    told = command("baseline", "--accept", "--engines", "closed_form", "--file", path)

    assert (told.returncode, path.read_text()) == (2, text)
    assert told.stderr.startswith(f"{path} is no baseline: ")
