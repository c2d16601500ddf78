"""Scene files forgive and explain: what was perhaps meant, which joint it is in, at which line, and how many."""

from __future__ import annotations

import codecs

import pytest

import refkin
from refkin.scenes.explained import unconnected
from refkin.scenes.files import load
from refkin.solving.solve import solve
from tests.places import ROOT

from .test_scene_files import DRIVEN, TEXT, refused_file


def told(tmp_path, text: str) -> str:
    path = tmp_path / "scene.toml"
    return str(refused_file(path, text)).replace(f"{path}: ", "")


def test_a_byte_order_mark_is_no_fault(tmp_path):
    path = tmp_path / "scene.toml"
    path.write_bytes(codecs.BOM_UTF8 + TEXT.encode())

    assert load(path).name == "crank-rocker"


@pytest.mark.parametrize(
    ("right", "wrong", "meant"),
    [
        ("bodies_wanted =", "body_wanted =", "body_wanted: expected no such key (did you mean 'bodies_wanted'?)"),
        ("count = 3", "cuont = 3", "times.cuont: expected no such key (did you mean 'count'?)"),
        ("point_j = [-1.75", "pont_j = [-1.75", "joint[1].pont_j: expected no such key (did you mean 'point_j'?)"),
        ('kind = "polynomial", coefficients', 'kind = "polynomial", coeficients', "(did you mean 'coefficients'?)"),
        ('type = "angle"', 'type = "angel"', "(did you mean 'angle'?)"),
        ('body_j = "rocker"', 'body_j = "roker"', "(did you mean 'rocker'?)"),
        ('type = "revolute"', 'type = "spherical"', 'or dimension = "spatial", which has it'),
        ('name = "crank"', 'name = "ground"', "body[0].name: expected a name other than 'ground', which is reserved"),
    ],
)
def test_a_word_that_is_wrong_gets_the_one_that_was_perhaps_meant_or_why(tmp_path, right, wrong, meant):
    assert meant in told(tmp_path, TEXT.replace(right, wrong, 1))


def test_a_key_like_no_other_gets_no_guess(tmp_path):
    assert "did you mean" not in told(tmp_path, TEXT.replace("count = 3", "count = 3\nzzz = 1"))


def test_a_key_that_stands_there_is_not_what_was_meant(tmp_path):
    text = told(tmp_path, TEXT.replace("count = 3", "step = 0.1"))

    assert "times.step: expected no such key, got 0.1" in text
    assert "times.count: expected `count` (or `values`)" in text


def test_a_table_whose_arguments_cannot_be_read_is_one_fault(tmp_path):
    table = 'law = { kind = "table", argument = "motor.csv", value = [0.0, 1.0] }'
    text = told(tmp_path, TEXT.replace(DRIVEN, table))

    assert text.startswith("driver[0].law.argument: expected a list, got 'motor.csv'")
    assert len(text.splitlines()) == 1


@pytest.mark.parametrize(
    ("wrong", "number"),
    [("[0.5]", "2 numbers, not 1"), ("[]", "2 numbers, not 0"), ("[1.0, 2.0, 3.0]", "2 numbers, not 3")],
)
def test_a_wrong_length_says_how_many(tmp_path, wrong, number):
    text = TEXT.replace("point_i = [0.5, 0.0]", f"point_i = {wrong}")

    assert f"joint[1].point_i: expected {number}" in told(tmp_path, text)
    assert told(tmp_path, text).count("joint[1].point_i") == 1


def test_a_fault_names_its_joint_and_its_line(tmp_path):
    text = TEXT.replace('body_i = "coupler"', 'body_i = "elsewhere"')
    line = 1 + text.splitlines().index('body_i = "elsewhere"')

    assert f"(joint 'B', line {line})" in told(tmp_path, text)


def test_a_fault_outside_of_bodies_and_joints_names_its_line_too(tmp_path):
    """That of the key, or the header of a table that is not known."""
    text = TEXT.replace("count = 3", "count = 0")
    line, last = 1 + text.splitlines().index("count = 0"), 1 + len(text.splitlines())

    assert f"times.count: expected a count of at least 1, got 0 (line {line})" in told(tmp_path, text)
    assert f"gravity: expected no such key, got {{'z': -9.81}} (line {last})" in told(
        tmp_path, f"{TEXT.rstrip()}\n[gravity]\nz = -9.81\n"
    )


SPATIAL = (ROOT / "docs" / "scenes" / "spatial-cylindrical.toml").read_text(encoding="utf-8")


@pytest.mark.parametrize(
    ("right", "wrong", "said"),
    [
        ('dimension = "spatial"', "", 'dimension: expected "spatial", as the rest of the file is'),
        ('joint = "rod"', 'joint = "rods"', "(did you mean 'rod'?), got 'rods' (driver 'motor', line 29)"),
        ("axis_i = [0.0, 0.0, 1.0]", "axis_i = [0.0, 1.0]", "3 numbers, not 2, got [0.0, 1.0] (joint 'rod', line 19)"),
        ('"cylindrical"', '"cylindical"', "(did you mean 'cylindrical'?), got 'cylindical' (joint 'rod', line 16)"),
    ],
)
def test_a_fault_of_a_scene_of_space_is_explained_as_one_of_the_plane(tmp_path, right, wrong, said):
    message = told(tmp_path, SPATIAL.replace(right, wrong, 1))

    assert said in message
    assert "tie to the ground" not in message or not wrong  # of a joint that cannot be read nothing is concluded


def test_a_body_that_nothing_ties_to_the_ground_is_named(tmp_path):
    loose = TEXT + '\n[[body]]\nname = "loose"\n[[body]]\nname = "hanging"\n[[joint]]\nname = "C"\ntype = "fixed"\n'
    loose += 'body_i = "loose"\npoint_i = [0.0, 0.0]\nbody_j = "hanging"\npoint_j = [0.0, 0.0]\n'
    message = told(tmp_path, loose)

    assert "body[3]: expected a body that joints or drivers tie to the ground, got 'loose'" in message
    assert "got 'hanging'" in message
    assert "got 'crank'" not in message


SECOND = """
[[driver]]
name = "second"
type = "angle"
body = "{body}"
law = {{ kind = "polynomial", coefficients = [{at}, 2.0] }}
"""


def test_too_many_drivers_are_named_as_that_where_they_contradict_each_other_and_not_where_they_agree(tmp_path):
    path, motions = tmp_path / "scene.toml", []
    for body, at in (("rocker", 1.0), ("crank", 0.0)):
        path.write_text(TEXT + SECOND.format(body=body, at=at), encoding="utf-8")
        motions.append(solve(load(path)))

    assert motions[0].message.endswith("too many drivers, by count: 2 (driver, second) of 1 freedom")
    assert motions[1].verdict == "ok"
    assert "too many" not in motions[1].message


def test_where_a_body_is_loose_nobody_is_told_to_add_drivers(tmp_path):
    said = told(tmp_path, TEXT + '\n[[body]]\nname = "loose"\n')

    assert "a body that joints or drivers tie to the ground, got 'loose'" in said
    assert "add drivers" not in said


CYLINDER = (ROOT / "docs" / "scenes" / "distance-driver.toml").read_text(encoding="utf-8")
ENDS = ("body_i", "point_i", "body_j", "point_j")


@pytest.mark.parametrize(
    ("text", "right", "wrong", "paths"),
    [
        (TEXT, "[[joint]]", "[[joints]]", ["joints"]),  # and nothing of bodies that no joint ties
        (TEXT, "[[body]]", "[[bodies]]", ["bodies"]),
        (TEXT, "point_j = [-1.75", "pont_j = [-1.75", ["joint[1].pont_j"]),  # which is not missing as well
        (TEXT, 'name = "crank"', "name = 2020-01-01", ["body[0].name"]),
        (TEXT, "start = 0.0", "start = nan\ncount = -1", ["times.start", "times.count"]),
        (TEXT, "count = 3", "values = [1.0, 1.0, nan]", ["times.start", "times.stop", "times", "times"]),
        (TEXT, "start = 0.0\nstop = 1.0\ncount = 3", "values = 3.0", ["times.values"]),
        (TEXT, "start = 0.0\nstop = 1.0\ncount = 3", "values = [0.0, 'x']", ["times.values[1]"]),
        (TEXT, 'body = "crank"', 'joint = "A0"', ["driver[0].body", "driver[0].joint"]),
        (SPATIAL, 'dimension = "spatial"', 'dimension = "spacial"', ["dimension"]),
        (SPATIAL, 'dimension = "spatial"', "", ["dimension"]),
        (CYLINDER, 'type = "distance"', 'type = "displacement"', ["driver[0].type"]),
        (CYLINDER, 'type = "distance"', 'type = "x"', [f"driver[0].{key}" for key in ("body", *ENDS)]),
    ],
)
def test_each_fault_is_named_once_and_none_that_follows_from_another(tmp_path, text, right, wrong, paths):
    if "count = -1" in wrong:
        text = text.replace("count = 3\n", "")
    message = told(tmp_path, text.replace(right, wrong))

    assert sorted(line.split(": ")[0] for line in message.splitlines()) == sorted(paths)


def test_a_group_that_is_no_list_is_a_fault_like_any_other(tmp_path):
    message = told(tmp_path, "schema = 1\nbody = 'a'\njoint = 3\ndriver = {}\ntimes = [0, 1]\n")

    assert "joint: expected a list: each joint under a header [[joint]], got 3 (line 3)" in message
    assert "times: expected a table of keys, got [0, 1] (line 5)" in message


@pytest.mark.parametrize(("carrier", "loose"), [("ground", ["b", "c"]), ("a", [])])
def test_wheels_in_gear_are_tied_to_their_carrier_and_not_to_the_ground_that_their_angles_count_from(carrier, loose):
    bodies = [refkin.Body(name=name) for name in "abc"]
    pin = refkin.Revolute(name="A", body_i="ground", point_i=(0.0, 0.0), body_j="a", point_j=(0.0, 0.0))
    teeth = refkin.Gear(name="teeth", body_i="b", radius_i=1.0, body_j="c", radius_j=2.0, carrier=carrier)

    assert [fault.value for fault in unconnected(bodies, [pin, teeth])] == loose
