"""Broken scene files that once ended in a traceback, in nonsense, or in a message of megabytes."""

from __future__ import annotations

from pathlib import Path

import pytest

from refkin.errors import Fault, InvalidScene
from refkin.scenes.files import load

SCENE = """schema = 1
[times]
values = [0.0, 0.1]
[[body]]
name = "crank"
estimate = [0.5, 0.0, 0.0]
[[joint]]
name = "A0"
type = "revolute"
body_i = "ground"
point_i = [0.0, 0.0]
body_j = "crank"
point_j = [-0.5, 0.0]
[[driver]]
name = "motor"
type = "angle"
body = "crank"
law = { kind = "polynomial", coefficients = [0.0, 1.0] }
"""
LAW = '{ kind = "polynomial", coefficients = [0.0, 1.0] }'
TIMES = "values = [0.0, 0.1]"
CLOSE = '{ kind = "table", argument = [0.0, 5e-324, 1e-323, 1.0], value = [0.0, 1.0, 2.0, 0.0] }'
BROKEN = {
    "an integer that Python does not read": (("schema = 1", "schema = " + "9" * 5000), {"file"}),
    "an integer beyond every float": (("[0.5, 0.0", "[0x" + "f" * 5000 + ", 0.0"), {"body[0].estimate[0]"}),
    "a list in a list in a list ...": (("schema = 1", "schema = 1\nx = " + "[" * 100_000 + "]" * 100_000), {"file"}),
    "a list nested 300 deep": (("[0.5, 0.0, 0.0]", "[" * 300 + "]" * 300), None),
    "a date for a name": (("schema = 1", "schema = 1\nname = 2020-01-01"), {"name"}),
    "a date for a number": (("[0.5, 0.0", "[2020-01-01, 0.0"), {"body[0].estimate[0]"}),
    "a table too close for a spline": ((LAW, CLOSE), {"driver[0].law.argument"}),
    "a stop at infinity": ((TIMES, "start = 0.0\nstop = inf\ncount = 5"), {"times.stop"}),
    "a span that overflows": ((TIMES, "start = -1.7e308\nstop = 1.7e308\ncount = 5"), {"times.stop"}),
    "a time that is no number": ((TIMES, "values = [0.0, nan]"), {"times"}),
}


@pytest.mark.parametrize("kind", BROKEN)
def test_a_broken_file_gets_its_faults_and_no_others(kind: str, tmp_path: Path) -> None:
    """Each fault once, under its own key; nothing else is raised, and nothing follows from a fault already told."""
    change, expected = BROKEN[kind]
    scene = tmp_path / "scene.toml"
    scene.write_text(SCENE.replace(*change, 1))
    with pytest.raises(InvalidScene) as raised:
        load(scene)
    paths = [fault.path for fault in raised.value.faults]
    assert len(paths) == len(set(paths))
    assert expected is None or set(paths) == expected


def test_json_nested_without_end_is_a_fault(tmp_path: Path) -> None:
    """A JSON file of opening brackets alone is refused like any other file that cannot be read."""
    scene = tmp_path / "scene.json"
    scene.write_text("[" * 100_000)
    with pytest.raises(InvalidScene):
        load(scene)


def test_a_long_value_is_not_quoted_whole() -> None:
    """A message stays a line that a person reads, however many numbers a table has."""
    assert len(str(Fault("times", [0.0] * 100_000, "strictly increasing times"))) < 300
