"""The page of what is shown of space names tests that exist and bounds that they state; what no other file holds."""

from __future__ import annotations

import ast
import json
import re
from dataclasses import replace

import numpy as np
import pytest

import refkin
from refkin.scenes.linkages import RSSR
from tests.places import ROOT

TEXT = (ROOT / "docs" / "space.md").read_text(encoding="utf-8")
ROWS = [[cell.strip() for cell in row.split("|")[1:-1]] for row in re.findall(r"^\| \d+ \|.*$", TEXT, re.MULTILINE)]
EXAMPLE = ROOT / "examples" / "rssr.toml"


def test_the_page_has_every_point_in_order():
    assert [row[0] for row in ROWS] == [str(k) for k in range(1, 14)]


def functions_of(text):
    """Return the source of each function of a file, with its decorators."""
    lines, functions = text.splitlines(), [node for node in ast.parse(text).body if isinstance(node, ast.FunctionDef)]
    firsts = [min([f.lineno, *(d.lineno for d in f.decorator_list)]) for f in functions]
    return {f.name: "\n".join(lines[at - 1 : f.end_lineno]) for f, at in zip(functions, firsts, strict=True)}


@pytest.mark.parametrize("row", ROWS, ids=lambda row: row[0])
def test_a_point_names_tests_that_exist_and_bounds_that_they_state(row):
    """A bound that is changed in a test, or a test that is called otherwise, is changed on the page, too."""
    _, _, held_by, bound, measured = row
    named = re.findall(r"`([\w/]+\.py)`: ((?:`test_\w+`(?:, )?)+)", held_by)
    sources = []
    for file, names in named:
        functions = functions_of((ROOT / "tests" / file).read_text(encoding="utf-8"))
        sources += [functions[name] for name in re.findall(r"`(\w+)`", names)]

    assert sources
    assert measured
    for number in re.findall(r"\d[\d.]*e-\d+|\d+ U", bound):
        assert any(number.replace(" U", " * U") in source for source in sources), number


def test_the_example_is_the_linkage_of_its_numbers():
    scene = refkin.load(EXAMPLE)
    linkage = RSSR(1.0, 3.0, 2.0, (2.5, -0.5, 0.75), (0.25, 1.0, 0.125))
    ours, theirs = refkin.solve(scene), refkin.solve(linkage.scene(start=0.4, speed=1.0, samples=73))

    assert ours.verdict == theirs.verdict == "ok"
    for body in ("crank", "rocker"):
        assert np.max(np.abs(ours[body].rotation[:, 2] - theirs[body].rotation[:, 2])) < 2e-15
        assert np.max(np.abs(ours[body].omega - theirs[body].omega)) < 2e-15


def test_a_broken_file_of_space_gets_all_its_faults_at_once(tmp_path):
    broken = {
        "estimate = [0.92, 0.39, 0.0, 0.7, 0.42, -0.57, 0.11]": "estimate = [0.92, 0.39, 0.0, 0.0, 0.0, 0.0, 0.0]",
        "zero_i = [1.0, 0.0, 0.0]": "zero_i = [0.0, 0.0, 2.0]",
        'type = "spherical"\nbody_i = "crank"': 'type = "cam"\nbody_i = "crank"',
        "point_j = [2.0, 0.0, 0.0]": "point_j = [2.0, 0.0]",
        "axis_i = [0.25, 1.0, 0.125]": "axis_i = [0.0, 0.0, 0.0]",
    }
    text = EXAMPLE.read_text(encoding="utf-8")
    for good, bad in broken.items():
        assert text.count(good) == 1
        text = text.replace(good, bad)
    (tmp_path / "broken.toml").write_text(text, encoding="utf-8")

    with pytest.raises(refkin.InvalidScene) as result:
        refkin.load(tmp_path / "broken.toml")

    places = {"body[1].estimate", "joint[0].zero_i", "joint[1].type", "joint[2].point_j", "joint[3].axis_i"}
    assert {fault.path for fault in result.value.faults} == places


@pytest.mark.parametrize(
    ("good", "bad", "told"),
    [
        ('body_j = "crank"', 'body_j = "krank"', "joint[0].body_j"),  # and nothing of the driver, which has no such key
        ('name = "S1"\ntype = "spherical"', 'name = "S1"', "joint[1].type: expected this key, which is missing"),
        ('body_j = "coupler"', 'body_j = "crank"', "joint[1]: expected two different bodies"),  # the coupler spins less
    ],
)
def test_a_fault_is_told_once_and_where_it_stands(good, bad, told, tmp_path):
    (tmp_path / "broken.toml").write_text(EXAMPLE.read_text(encoding="utf-8").replace(good, bad), encoding="utf-8")

    with pytest.raises(refkin.InvalidScene) as result:
        refkin.load(tmp_path / "broken.toml")

    (fault,) = result.value.faults
    assert told in str(fault)


def test_a_driver_of_a_joint_that_does_not_turn_is_refused(tmp_path):
    text = EXAMPLE.read_text(encoding="utf-8").replace('joint = "R1"', 'joint = "S2"')
    (tmp_path / "broken.toml").write_text(text, encoding="utf-8")

    with pytest.raises(refkin.InvalidScene, match="a joint of the scene that is revolute or cylindrical or screw"):
        refkin.load(tmp_path / "broken.toml")


@pytest.mark.parametrize(
    ("kind", "place", "word", "known"),
    [
        ("joints", 0, {"form": "cross"}, "joint[0].form: expected 'half' or 'dot' or 'printed', got 'cross'"),
        ("joints", 1, {"type": "fixed"}, "joint[1].type: expected 'spherical', got 'fixed'"),
        ("drivers", 0, {"form": "printed"}, "driver[0].form: expected 'half' or 'dot', got 'printed'"),
    ],
)
def test_a_word_that_a_joint_does_not_know_is_a_fault_of_a_program_too(kind, place, word, known):
    mechanism = refkin.load(EXAMPLE).mechanism
    parts = list(getattr(mechanism, kind))
    parts[place] = replace(parts[place], **word)

    with pytest.raises(refkin.InvalidScene, match=re.escape(known)):
        replace(mechanism, **{kind: tuple(parts)})


def test_answers_for_programs_have_all_rates_of_a_body_of_space(command):
    bodies = json.loads(command("solve", EXAMPLE, "--json").stdout)["bodies"]

    for body in bodies.values():
        assert {key: len(body[key][0]) for key in body} == {"q": 7, "qd": 7, "qdd": 7, "omega": 3, "alpha": 3}
