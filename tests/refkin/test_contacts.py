"""Gears, racks, cams, offset pins and moving slots: truths to 40 digits, contact parameters, faults in scene files.

An answer must have status ok, and all of it, rates too, must lie within its own certified radius of the truth
(`contact_cases`; rates are derivatives in 40 digits).
"""

from __future__ import annotations

import math
from dataclasses import replace
from functools import lru_cache

import mpmath
import numpy as np
import pytest
from flint import arb, ctx
from mpmath import mpf

import refkin
from refkin import Body, Cam, Mechanism, Point, Polar, Polynomial, RackAndPinion, Sinusoid, Table, compile_system
from refkin.errors import InvalidScene, UnknownName
from refkin.output import Drawing
from refkin.proof.numbers.bounded import Bounded, Extended, Times, _Rounded, bounded_system, box
from refkin.proof.numbers.exact import exact, exact_system
from refkin.scenes.files import load, parse, to_dict, to_toml

from .contact_cases import CASES, CONTACTS, FOLLOWERS, LOBES, TIMES, over_profile, scene, turning

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
    with pytest.raises(UnknownName, match=r"no part is called 'guide'; there are: .*contact"):
        system.parameter("guide")
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


KNOTS = np.linspace(0.0, math.tau, 13)
ROUND = (1.0 + 0.0625 * np.sin(3 * KNOTS)).tolist()
WAVY_TABLE = Table(argument=tuple(KNOTS.tolist()), value=(*ROUND[:-1], ROUND[0]), periodic=True)
SECTOR = Table(argument=tuple(np.linspace(-0.75, 1.5, 8).tolist()), value=(1.0, 1.1, 1.15, 1.1, 1.1, 1.0, 0.95, 1.0))
STEEP = Sinusoid(offset=1.0, amplitude=0.5, angular_frequency=5.0)


@pytest.mark.parametrize("follower", FOLLOWERS)
def test_a_table_that_is_a_profile_is_proved_as_the_spline_it_is(follower):
    motion = refkin.solve(over_profile(WAVY_TABLE, follower))

    assert motion.verdict == "ok", motion.message
    assert np.max(motion.certified_radius.acceleration) < 1e-12


def test_a_point_on_a_table_is_as_high_as_the_exact_spline():
    given = over_profile(WAVY_TABLE)
    motion = refkin.solve(given)
    with ctx.workprec(200):
        spline, t = exact(WAVY_TABLE), [arb(x) for x in TIMES]
        motor = exact(given.mechanism.drivers[0].law)
        height = [spline(arb.pi() / 2 - motor(x)) for x in t]
        rate = [-spline(arb.pi() / 2 - motor(x), 1) * motor(x, 1) for x in t]
        off = [float(abs(y - float(a))) for y, a in zip(height, motion["follower"].y, strict=True)]
        off_rate = [float(abs(y - float(a))) for y, a in zip(rate, motion["follower"].yd, strict=True)]

    assert np.all(np.array(off) <= motion.certified_radius.position)
    assert np.all(np.array(off_rate) <= motion.certified_radius.velocity)


def test_a_contact_on_a_knot_has_a_pose_and_no_proof_of_more_than_there_is():
    """At a knot the third derivative jumps, and with it the acceleration of the contact on a flat face."""
    law = replace(WAVY_TABLE, value=(1.0, 1.03, 1.06, 1.03, *ROUND[4:-1], 1.0))
    angle = math.pi / 2 - math.atan2(-law(KNOTS[2], 1), law(KNOTS[2])) - KNOTS[2]
    given = over_profile(law, "flat", times=(0.0,), estimates=((0.0, 0.0, angle), (0.0, 1.0, 0.0)))
    drivers = (turning("cam", Polynomial(coefficients=(angle, 1.0))),)
    motion = refkin.solve(replace(given, mechanism=replace(given.mechanism, drivers=drivers)))

    assert motion.contacts["contact"].s[0] == pytest.approx(KNOTS[2], abs=1e-12)
    assert motion.verdict == "ok"
    assert motion.certified_radius.position[0] < 1e-12
    assert not motion.certified_radius.acceleration[0] < 0.1


def test_a_contact_that_leaves_its_profile_has_no_answer_there():
    motion = refkin.solve(over_profile(SECTOR, times=tuple(np.linspace(0.0, 3.0, 13).tolist())))
    inside = np.array([s == "ok" for s in motion.status])

    assert inside[0]
    assert not inside[-1]
    assert np.all(motion.contacts["contact"].s[inside] >= -0.75)
    assert "the contact of contact leaves its profile after t = " in motion.message


def test_a_spiral_goes_on_for_more_than_a_turn():
    """An open profile is not the same a turn later: the follower rises on and on."""
    spiral, times = Polynomial(coefficients=(1.0, -0.125)), tuple(np.linspace(0.0, 3.0, 7).tolist())
    given = over_profile(spiral, times=times, estimates=((0.0, 0.0, 0.0), (0.0, 0.8, 0.0)))
    law = Polynomial(coefficients=(0.0, 4.0))
    motion = refkin.solve(replace(given, mechanism=replace(given.mechanism, drivers=(turning("cam", law),))))

    assert motion.verdict == "ok"
    assert motion["follower"].y == pytest.approx(
        1.0 - 0.125 * (math.pi / 2 - 4.0 * np.array(times)), rel=1e-14, abs=0.0
    )


def test_a_round_polar_profile_is_a_disc():
    round_, law = Polynomial(coefficients=(1.25,)), Polar(law=Polynomial(coefficients=(1.25,)))
    assert law.closed
    for name in ("disc under wedge", "disc under lever", "roller over disc", "tip on disc"):
        m = scene(name).mechanism
        joints = tuple(replace(j, profile=Polar(law=round_)) if isinstance(j, Cam) else j for j in m.joints)
        one, two = refkin.solve(scene(name)), refkin.solve(replace(scene(name), mechanism=replace(m, joints=joints)))

        for level in range(3):
            assert one.levels[level] == pytest.approx(two.levels[level], abs=1e-13)


@pytest.mark.parametrize(
    ("law", "closed"),
    [
        (LOBES, True),
        (Sinusoid(offset=1.0, amplitude=0.1, angular_frequency=1.5), False),
        (Sinusoid(offset=1.0, amplitude=0.0, angular_frequency=1.5), True),
        (Polynomial(coefficients=(1.0, 0.0)), True),
        (Polynomial(coefficients=(1.0, 0.0, 0.1)), False),
        (WAVY_TABLE, True),
        (SECTOR, False),
    ],
)
def test_a_profile_is_closed_if_it_repeats_itself_every_turn(law, closed):
    assert Polar(law=law).closed is closed


def everything(system, q, qd, t):
    """phi, phi_q and gamma in one row."""
    return [*system.phi(q, t), *system.phi_q(q, t).ravel(), *system.gamma(q, qd, t)]


@pytest.mark.parametrize("bound", ["rounding", "spread"])
@pytest.mark.parametrize("number", [Bounded, Extended])
@pytest.mark.parametrize("follower", FOLLOWERS)
@pytest.mark.parametrize("law", [STEEP, WAVY_TABLE, Polynomial(coefficients=(1.0, 0.125))], ids=lambda law: law.kind)
def test_bounds_hold_over_an_interval_of_contacts(number, follower, law, bound):
    """Exact values lie within rounding and spread, whether the contact is not known well or moves over a box."""
    mechanism = over_profile(law, follower).mechanism
    system, draw = compile_system(mechanism, unit=mechanism.unit()), np.random.default_rng(4)
    q, qd = draw.uniform(-1, 1, (2, system.n))
    radius = np.array([0.0] * system.of_bodies + [2.0**-6])
    at, rates = box(q[:, None], 0.0, number), box(qd[:, None], 0.0, number)
    for coordinate, off in zip((*at, *rates), (*radius, *radius), strict=True):
        setattr(coordinate, bound, off)
    result = everything(bounded_system(system, number), at, rates, Times([0.625], 2))
    with ctx.workprec(200):
        for move in draw.uniform(-1, 1, (20, 2, system.n)):
            x, v = (
                np.array([arb(c) for c in values], object) for values in (q + radius * move[0], qd + radius * move[1])
            )
            for value, bounds in zip(everything(exact_system(system, 200), x, v, arb(0.625)), result, strict=True):
                if isinstance(bounds, Bounded):
                    (mid,) = np.ravel(bounds.mid)
                    off = abs(arb(value) - float(mid) - float(mid - type(mid)(float(mid))))
                    assert float(off.lower()) <= np.ravel(bounds.rounding + bounds.spread)[0]


@pytest.mark.parametrize("bound", ["rounding", "spread"])
def test_bounds_that_forget_the_interval_are_seen(monkeypatch, bound):
    """The check above can fail: it does if what an unknown contact does to the profile is left out."""
    right = _Rounded.profile_values

    def without_interval(self, s, unit, order):
        return right(self, self.number.exactly(s.mid), unit, order)

    monkeypatch.setattr(_Rounded, "profile_values", without_interval)
    with pytest.raises(AssertionError):
        test_bounds_hold_over_an_interval_of_contacts(Bounded, "flat", STEEP, bound)
