"""Gears, racks, cams, offset pins and moving slots: truths to 40 digits, contact parameters, faults in scene files.

An answer must have status ok, and all of it, rates too, must lie within its own certified radius of the truth
(`contact_cases`; rates are derivatives in 40 digits).
"""

from __future__ import annotations

from dataclasses import replace
from functools import lru_cache

import mpmath
import numpy as np
import pytest
from mpmath import mpf

import refkin
from refkin import Body, Mechanism, Point, Polar, RackAndPinion, compile_system
from refkin.errors import InvalidScene
from refkin.output import Drawing
from refkin.scenes.files import load, parse, to_dict, to_toml

from .contact_cases import CASES, CONTACTS, TIMES, scene

LEVELS = ("position", "velocity", "acceleration")


@lru_cache
def solved(name):
    return refkin.solve(scene(name))


def rates(f, order):
    """A function of time, or its derivative, at all times."""
    with mpmath.workdps(40):
        return [mpmath.diff(f, mpf(t), order) if order else f(mpf(t)) for t in TIMES]


def errors(answer, truth):
    """The distances of floats from the truth, less the half ulp by which an answer in metres is rounded."""
    with mpmath.workdps(40):
        values = [float(abs(mpf(float(a)) - b)) for a, b in zip(answer, truth, strict=True)]
    return np.array(values) - np.spacing(np.abs(answer)) / 2


def largest_error(name, order):
    """The largest error of any body's coordinate in the units of the proof, (T,)."""
    motion, size = solved(name), scene(name).mechanism.size()
    pose, result = CASES[name][0], []
    for body in motion.bodies:
        for k, unit in enumerate((size, size, 1.0)):
            truth = rates(lambda t, k=k, body=body: pose(t)[body][k], order)
            answer = (motion[body].q, motion[body].qd, motion[body].qdd)[order][k]
            result.append(errors(answer, truth) / unit)
    return np.max(result, axis=0)


@pytest.mark.parametrize("name", CASES)
def test_every_pose_is_proved(name):
    motion = solved(name)

    assert motion.verdict == "ok", motion.message
    assert all(np.max(getattr(motion.certified_radius, level)) < 1e-12 for level in LEVELS)


@pytest.mark.parametrize("name", CASES)
@pytest.mark.parametrize("level", LEVELS)
def test_the_closed_form_lies_within_the_certified_radius(name, level):
    order = LEVELS.index(level)

    assert np.all(largest_error(name, order) <= getattr(solved(name).certified_radius, level))


@pytest.mark.parametrize("name", CONTACTS)
@pytest.mark.parametrize("level", LEVELS)
def test_the_contact_parameter_lies_within_the_certified_radius(name, level):
    order = LEVELS.index(level)
    contact = solved(name).contacts["contact"]
    answer, truth = (contact.s, contact.sd, contact.sdd)[order], rates(CONTACTS[name], order)
    if order == 0:
        truth = [
            x + 2 * mpmath.pi * round(float((a - x) / (2 * mpmath.pi))) for a, x in zip(answer, truth, strict=True)
        ]

    assert np.all(errors(answer, truth) <= getattr(solved(name).certified_radius, level))


@pytest.mark.parametrize("name", CASES)
def test_a_scene_file_says_it_all(name, tmp_path):
    path = tmp_path / "scene.toml"
    path.write_text(to_toml(scene(name)), encoding="utf-8")

    assert load(path) == scene(name)
    assert np.array_equal(refkin.solve(load(path)).qdd, solved(name).qdd)


@pytest.mark.parametrize("name", ["rack above", "rack below", "wheel on road", "wheel on swing"])
def test_a_pinion_does_not_slide_on_its_rack(name):
    """The pinion's and the rack's material points at the pitch point have the same velocity along the rack."""
    motion, teeth = solved(name), next(j for j in CASES[name][1][0] if isinstance(j, RackAndPinion))
    wheel = motion[teeth.body_j]
    still = np.zeros((3, len(TIMES)))
    rack, moving = (still, still) if teeth.body_i == "ground" else (motion[teeth.body_i].q, motion[teeth.body_i].qd)
    along, left = np.array([np.cos(rack[2]), np.sin(rack[2])]), np.array([-np.sin(rack[2]), np.cos(rack[2])])
    at = wheel.q[:2] + left * teeth.radius  # a pinion to the right of the axis has the rack to its left
    slip = 0.0
    for q, qd, sign in ((wheel.q, wheel.qd, 1), (rack, moving, -1)):
        arm = at - q[:2]
        slip = slip + sign * np.sum(along * (qd[:2] + qd[2] * np.array([-arm[1], arm[0]])), axis=0)

    assert np.max(np.abs(slip)) < 1e-14


def test_parameters_come_after_all_bodies():
    system = compile_system(scene("plate over lobes").mechanism)

    assert (system.n, system.m, system.of_bodies) == (7, 7, 6)
    assert system.parameter("contact") == slice(6, 7)
    assert system.parameter("guide of follower") == slice(0, 0)
    assert system.angles.tolist() == [False, False, True, False, False, True, True]


def test_units_change_lengths_and_leave_parameters_alone():
    mechanism = scene("plate over lobes").mechanism
    system = compile_system(mechanism, unit=refkin.Unit(0.25, (3.0, -2.0)))
    q = np.arange(1.0, 8.0)

    assert system.to_unit(q).tolist() == [-8.0, 16.0, 3.0, 4.0, 28.0, 6.0, 7.0]
    assert system.to_physical(system.to_unit(q)).tolist() == q.tolist()
    assert system.to_physical(system.to_unit(q, 1), 1).tolist() == q.tolist()


def test_a_body_asked_for_alone_is_that_body_and_its_point_lies_on_it():
    whole = replace(scene("lever over lobes"), points=(Point(name="tip", body="follower", position=(2.0, 0.0)),))
    motion, alone = refkin.solve(whole), refkin.solve(replace(whole, bodies_wanted=("follower",)))

    assert np.array_equal(alone.q, motion["follower"].q)
    assert np.array_equal(alone.points["tip"].r[0], 3.0 + 2.0 * np.cos(motion["follower"].phi))


@pytest.mark.parametrize("name", CASES)
def test_the_order_of_bodies_and_joints_does_not_matter(name):
    m = scene(name).mechanism
    other = replace(scene(name), mechanism=Mechanism(m.bodies[::-1], m.joints[::-1], m.drivers[::-1]))
    one, two = refkin.solve(scene(name)), refkin.solve(other)
    allowed = m.size() * (one.certified_radius.position + two.certified_radius.position) + 1e-15

    for body in one.bodies:
        assert np.all(np.max(np.abs(one[body].q - two[body].q), axis=0) <= allowed)


def times(lengths, factor):
    return tuple(x * factor for x in lengths) if isinstance(lengths, tuple) else lengths * factor


def scaled(item, factor):
    """A joint, driver or law with all its lengths multiplied."""
    lengths = {"point", "point_i", "point_j", "radius", "radius_i", "radius_j", "s0", "roller_radius", "length"}
    of_lengths = {"offset", "amplitude", "coefficients", "value"}
    keys = {}
    for key in item.__dataclass_fields__:
        value = getattr(item, key)
        if key in lengths and value is not None:
            keys[key] = times(value, factor)
        elif key == "profile":
            keys[key] = scaled(value, factor)
        elif key == "law" and (isinstance(item, Polar) or item.type in ("x", "y")):
            law = {k: getattr(value, k) for k in of_lengths & value.__dataclass_fields__.keys()}
            keys[key] = replace(value, **{k: times(v, factor) for k, v in law.items()})
        elif key == "offset_law" and value is not None:
            laws = [{k: getattr(law, k) for k in of_lengths & law.__dataclass_fields__.keys()} for law in value]
            parts = [{k: times(v, factor) for k, v in law.items()} for law in laws]
            keys[key] = tuple(replace(law, **part) for law, part in zip(value, parts, strict=True))
    return replace(item, **keys)


@pytest.mark.parametrize("name", CASES)
def test_a_copy_of_another_size_gives_the_same_bits(name):
    factor = 2.0**-30
    m = scene(name).mechanism
    bodies = tuple(Body(name=b.name, estimate=(*(x * factor for x in b.estimate[:2]), b.estimate[2])) for b in m.bodies)
    small = Mechanism(bodies, *(tuple(scaled(c, factor) for c in group) for group in (m.joints, m.drivers)))
    one, two = refkin.solve(scene(name)), refkin.solve(replace(scene(name), mechanism=small))

    for body in one.bodies:
        assert np.array_equal(one[body].qdd * [[factor], [factor], [1.0]], two[body].qdd)
    assert np.array_equal(one.certified_radius.position, two.certified_radius.position)
    drawn = [[s for part in Drawing(m.scene, m).parts for s in part.at(0)] for m in (one, two)]
    for shape, copy in zip(*drawn, strict=True) if name != "crank by its rate" else ():  # it has no length
        assert (shape.role, shape.radius * factor) == (copy.role, copy.radius)
        assert copy.points / factor == pytest.approx(shape.points, abs=1e-12)


def change(name, joint, **keys):
    """The data of a case's scene file with some keys of a joint set, or with `...` left out."""
    data = to_dict(scene(name))
    for key, value in keys.items():
        data["joint"][joint][key] = value
        if value is ...:
            del data["joint"][joint][key]
    return data


BAD_LAW = {"kind": "table", "argument": [0.0, 1.0], "value": [0.0]}
HALF = {"kind": "table", "argument": [0.0, 2.0, 5.0], "value": [1.0, 1.5, 1.0], "periodic": True}
BROKEN = {
    "a face without normal": (("disc under plate", 2, {"normal_j": ...}), "joint[2].normal_j: expected the normal of"),
    "a normal without direction": (("plate over lobes", 2, {"normal_j": [0.0, 0.0]}), "joint[2].normal_j: "),
    "a normal without face": (("tip on disc", 2, {"normal_j": [0.0, 1.0]}), "joint[2].normal_j: expected no normal"),
    "a roller without radius": (("roller over disc", 2, {"roller_radius": ...}), "joint[2].roller_radius: "),
    "a roller of no radius": (("roller over lobes", 2, {"roller_radius": 0.0}), "joint[2].roller_radius: "),
    "a radius without roller": (
        ("tip on lobes", 2, {"roller_radius": 0.5}),
        "joint[2].roller_radius: expected no roller",
    ),
    "an unknown follower": (("tip on disc", 2, {"follower": "knife"}), "joint[2].follower: "),
    "a disc of no radius": (
        ("tip on disc", 2, {"profile": {"kind": "disc", "radius": 0.0}}),
        "joint[2].profile.radius: expected a radius above 0",
    ),
    "an unknown profile": (("tip on disc", 2, {"profile": {"kind": "ellipse"}}), "joint[2].profile.kind: "),
    "a profile without law": (("tip on lobes", 2, {"profile": {"kind": "polar"}}), "joint[2].profile.law: "),
    "a disc with a law": (
        ("tip on disc", 2, {"profile": {"kind": "disc", "radius": 1.0, "law": BAD_LAW}}),
        "joint[2].profile.law: expected no such key",
    ),
    "a profile that is no table": (
        ("tip on lobes", 2, {"profile": {"kind": "polar", "law": BAD_LAW}}),
        "joint[2].profile.law.value: ",
    ),
    "a profile that is not round": (
        ("tip on lobes", 2, {"profile": {"kind": "polar", "law": HALF}}),
        "joint[2].profile.law.argument: expected a period of 6.283185307179586 or of a whole part of it, got 5.0",
    ),
    "a profile that repeats itself after more than all numbers": (
        ("tip on lobes", 2, {"profile": {"kind": "polar", "law": {**HALF, "argument": [-1e308, 0.0, 1e308]}}}),
        "joint[2].profile.law.argument: expected a period of 6.283185307179586 or of a whole part of it, got inf",
    ),
    "a contact on a disc": (("tip on disc", 2, {"contact_estimate": 1.0}), "joint[2].contact_estimate: "),
    "a wheel of no radius": (("gear train", 3, {"radius_j": 0.0}), "joint[3].radius_j: "),
    "a pinion of no radius": (("rack above", 2, {"radius": 0.0}), "joint[2].radius: "),
    "a rack without direction": (("rack above", 2, {"axis_i": [0.0, 0.0]}), "joint[2].axis_i: "),
    "half an offset": (("shifted rocker", 1, {"offset_law": [BAD_LAW]}), "joint[1].offset_law: expected 2 laws, not 1"),
    "an offset that is no table": (
        ("shifted rocker", 1, {"offset_law": [{"kind": "polynomial", "coefficients": [0.0]}, BAD_LAW]}),
        "joint[1].offset_law[1].value: ",
    ),
    "an offset that ends too soon": (
        ("shifted rocker", 1, {"offset_law": [{**BAD_LAW, "value": [0.0, 1.0]}] * 2}),
        "joint[1].offset_law[0].argument: expected a table from 0.0 to 2.0",
    ),
}


@pytest.mark.parametrize(("broken", "told"), BROKEN.values(), ids=BROKEN.keys())
def test_each_bad_combination_gets_one_clear_message(broken, told):
    name, joint, keys = broken
    with pytest.raises(InvalidScene) as result:
        parse(change(name, joint, **keys), "scene.toml")
    lines = str(result.value).splitlines()

    assert sum(line.startswith(f"scene.toml: {told}") for line in lines) == 1, lines


def test_a_polar_cam_brings_a_coordinate_that_counts_when_drivers_are_missing():
    data = to_dict(scene("plate over lobes"))
    del data["driver"]
    with pytest.raises(InvalidScene, match="expected 1 more constraint: add drivers"):
        parse(data)
