"""Gears of space: wheels do not slide where they touch, turns are counted, and what is wrong with one is named."""

from __future__ import annotations

import math
from dataclasses import replace
from itertools import permutations
from typing import Any

import numpy as np
import pytest

import refkin
from refkin import fast
from refkin.joints import (
    GROUND,
    Cylindrical,
    Screw,
    SpatialAngleDriver,
    SpatialDistance,
    SpatialGear,
    SpatialPrismatic,
    SpatialRevolute,
)
from refkin.model import Body, Mechanism, Point, Scene
from refkin.motion_laws import Polynomial
from refkin.proof.assembly.assembly import assemblies
from refkin.proof.singularity.diagnosis import PoseKind
from refkin.scenes.files import parse, to_dict
from refkin.solving.mobility import count, mobility
from refkin.solving.starts import diagnose, find_start
from refkin.system import compile_system

AT, X, Y, Z = (0.0, 0.0, 0.0), (1.0, 0.0, 0.0), (0.0, 1.0, 0.0), (0.0, 0.0, 1.0)
LAW = Polynomial(coefficients=(0.2, 3.0, 1.0))
TIMES = tuple(np.linspace(0.0, 5.0, 26).tolist())


def axle(name: str, i: str, j: str, axis: Any, at: Any = AT, kind: Any = SpatialRevolute, **more: Any) -> Any:
    """Return a joint about an axis through a point of body i; the zero is the part of y across it."""
    along: Any = {f"{key}_{end}": v for key, v in (("axis", axis), ("zero", Y)) for end in "ij"}
    return kind(name=name, body_i=i, point_i=at, body_j=j, point_j=AT, **along, **more)


def mesh(i: str, radius_i: float, j: str, radius_j: float, **more: float) -> SpatialGear:
    return SpatialGear(name=f"{i} {j}", joint_i=i, radius_i=radius_i, joint_j=j, radius_j=radius_j, **more)


def turned(name: str, angle: float, axis: Any, at: Any = AT) -> Body:
    """Return a body with its estimate, turned about an axis."""
    return Body(name=name, estimate=(*at, math.cos(angle / 2), *(math.sin(angle / 2) * x for x in axis)))


def driven(joint: str, law: Polynomial = LAW) -> SpatialAngleDriver:
    return SpatialAngleDriver(name=f"motor of {joint}", joint=joint, law=law)


def pair(axis: Any, at: Any, radii: tuple[float, float], law: Polynomial = LAW, **more: float) -> Scene:
    """Return two wheels on the ground, the first of which is driven about z."""
    angle = more.get("phi0_j", 0.0) - radii[0] / radii[1] * (law(0.0) - more.get("phi0_i", 0.0))
    joints = axle("A", GROUND, "a", Z), axle("B", GROUND, "b", axis, at), mesh("A", radii[0], "B", radii[1], **more)
    bodies = turned("a", law(0.0) + 0.01, Z), turned("b", angle - 0.01, axis, at)
    return Scene(mechanism=Mechanism(bodies, joints, (driven("A", law),)), times=TIMES)


CONES, HELICES, RADII = (0.5, 0.9), (0.4, 0.7), (0.3, 0.7)
BEVEL = (math.sin(sum(CONES)), 0.0, math.cos(sum(CONES)))
CROSSED = (0.0, -math.sin(sum(HELICES)), math.cos(sum(HELICES)))
TOUCHING: dict[str, Any] = {
    "spur": (Z, (1.0, 0.0, 0.0), RADII, (0.3, 0.0, 0.0), None),
    "bevel": (BEVEL, AT, tuple(map(math.sin, CONES)), (math.sin(CONES[0]), 0.0, math.cos(CONES[0])), None),
    "helical": (
        *(CROSSED, (1.0, 0.0, 0.0), tuple(r * math.cos(h) for r, h in zip(RADII, HELICES, strict=True))),
        *((0.3, 0.0, 0.0), (0.0, math.cos(HELICES[0]), math.sin(HELICES[0]))),
    ),
}
"""Axis of the second wheel, a point of it, radii, where wheels touch; the one direction in which they keep up."""


@pytest.mark.parametrize("name", TOUCHING)
def test_wheels_in_gear_do_not_slide_where_they_touch(name):
    """At a time the points of both that touch then; of crossed helical wheels across the teeth alone."""
    axis, at, radii, touch, teeth = TOUCHING[name]
    motion = refkin.solve(pair(axis, at, radii))

    assert motion.verdict == "ok"
    velocities = [np.cross(motion[body].omega.T, np.subtract(touch, place)) for body, place in (("a", AT), ("b", at))]
    slides = velocities[0] - velocities[1]
    slides = slides if teeth is None else slides @ teeth
    assert np.max(np.abs(slides)) < 1e-14 * np.max(np.abs(velocities))


def test_wheels_are_where_the_angles_say_within_the_radii_and_count_turns():
    axis, at, radii, *_ = TOUCHING["bevel"]
    motion = refkin.solve(pair(axis, at, radii, phi0_i=0.3, phi0_j=-0.4))
    angle = -0.4 - radii[0] / radii[1] * (0.2 + 3.0 * motion.t + motion.t**2 - 0.3)
    p = np.array([np.cos(angle / 2), *(np.sin(angle / 2) * np.array(axis)[:, None])])
    p *= np.sign(np.sum(p * motion["b"].q[3:], axis=0))

    off = np.max(np.abs(p - motion["b"].q[3:]), axis=0)
    assert np.all(off <= motion.certified_radius.position + 4e-16 * (1 + np.abs(angle)))
    assert np.max(motion.certified_radius.position) < 1e-13
    assert motion.contacts["B"].s == pytest.approx(angle / 2, abs=1e-13)
    assert motion.contacts["A"].sd == pytest.approx(1.5 + motion.t, abs=1e-13)
    ratio = -radii[0] / radii[1]
    assert motion["b"].omega == pytest.approx(np.outer(axis, ratio * (3.0 + 2.0 * motion.t)), abs=1e-13)
    assert motion["b"].alpha == pytest.approx(np.outer(axis, ratio * np.full(len(motion.t), 2.0)), abs=1e-11)


@pytest.mark.parametrize("size", [2.0**-30, 2.0**30])
def test_only_the_ratio_of_radii_counts(size):
    axis, at, radii, *_ = TOUCHING["spur"]
    motion, scaled = (refkin.solve(pair(axis, at, (k * radii[0], k * radii[1]))) for k in (1.0, size))

    assert scaled.verdict == "ok"
    for key in ("q", "qd", "qdd", "sigma_min", "condition"):
        assert np.array_equal(getattr(scaled, key), getattr(motion, key))


def differential() -> Scene:
    """Return an arm, two suns and a planet between them; the arm turns, and one sun against it. Gears stand first."""
    axles = (
        *(axle("shaft", GROUND, "arm", Z), axle("one", "arm", "sun", Z)),
        *(axle("two", "arm", "planet", X), axle("three", "arm", "other sun", Z)),
    )
    gears = mesh("two", 0.25, "three", 0.5), mesh("one", 0.5, "two", 0.25)
    bodies = turned("arm", 0.0, Z), turned("sun", LAW(0.0), Z), turned("planet", -2 * LAW(0.0), X)
    drivers = driven("shaft", Polynomial(coefficients=(0.0, 0.5))), driven("one", LAW)
    every = (*bodies, turned("other sun", LAW(0.0), Z))
    return Scene(mechanism=Mechanism(every, (*gears, *axles), drivers), times=TIMES[:11])


def test_a_planet_on_an_arm_drives_the_other_sun_against_it():
    """In the frame of the arm: the planet at -2 times the sun's speed, the other sun at the sun's."""
    scene = differential()
    motion = refkin.solve(scene)
    of_arm, against = motion["arm"].omega[2], 3.0 + 2.0 * motion.t

    assert motion.verdict == "ok"
    assert np.max(np.abs(of_arm - 0.5)) < 1e-14
    assert np.max(np.abs(motion["other sun"].omega[2] - of_arm - against)) < 1e-13
    assert np.max(np.abs(motion.contacts["two"].sd + against)) < 1e-13  # half of -2 times
    of_rank = mobility(scene.mechanism, np.append(motion.q[:, 0], [c.s[0] for c in motion.contacts.values()]))
    assert (count(scene.mechanism).mobility, of_rank.mobility, of_rank.driven.freedoms) == (2, 2, 0)
    assert diagnose(scene).kind is PoseKind.REGULAR


@pytest.mark.parametrize(("wheel", "left_out"), [("other sun", ""), ("planet", "other sun")])
def test_on_the_fast_path_a_wheel_alone_is_answered_with_what_turns_it(wheel, left_out):
    scene = differential()
    motion = fast.sweep(replace(scene, bodies_wanted=(wheel,), evidence=frozenset()))

    assert motion.verdict == "ok"
    assert left_out in motion.message
    assert np.max(np.abs(motion.qd - refkin.solve(scene)[wheel].qd)) < 1e-12


@pytest.mark.parametrize("scene", [pair(Z, X, (0.3, -0.7)), differential()], ids=["pair", "differential"])
def test_the_fast_path_proves_wheels_in_gear_as_the_reference_does(scene):
    motion, expected = fast.sweep(scene), refkin.solve(scene)

    assert (motion.verdict, motion.producer.name) == ("ok", "refkin.fast")
    off = np.max(np.abs(motion.q - expected.q), axis=0)
    assert np.all(off <= motion.certified_radius.position + expected.certified_radius.position)


def test_a_scene_of_gears_is_read_back_as_it_is_and_one_path_leads_through_it():
    scene = differential()
    again = parse(to_dict(scene))

    assert again == scene
    path = refkin.follow(replace(scene, times=(0.0, 1.0)))
    assert path.t[-1] == 1.0


def test_a_joint_in_gear_may_have_the_name_of_its_wheel():
    joints = axle("a", GROUND, "a", Z), axle("b", GROUND, "b", X), mesh("a", 0.5, "b", 0.25)
    bodies = turned("a", LAW(0.0), Z), turned("b", -2 * LAW(0.0), X)
    motion = refkin.solve(Scene(mechanism=Mechanism(bodies, joints, (driven("a"),)), times=TIMES))

    assert motion.verdict == "ok"
    assert motion.contacts["b"].sd == pytest.approx(-3.0 - 2.0 * motion.t, abs=1e-13)


@pytest.mark.parametrize("order", [*permutations(range(5))][::11])
def test_turns_begin_where_laws_are_and_go_from_wheel_to_wheel(order):
    """Three turns on: at a ratio of 1 to 2 the second wheel has turned by one and a half, and is half a turn round."""
    law = Polynomial(coefficients=(6 * math.pi + 0.1, 1.0))
    joints = (
        *(axle("A", GROUND, "a", Z), axle("B", GROUND, "b", X), axle("C", GROUND, "c", Y, kind=SpatialRevolute)),
        *(mesh("B", 0.5, "A", 0.25), mesh("B", 0.5, "C", 0.75)),
    )
    joints = (*joints[:2], replace(joints[2], zero_i=X, zero_j=X), *joints[3:])
    angles = {"a": (law(0.0), Z), "b": (-law(0.0) / 2, X), "c": (law(0.0) / 3, Y)}
    bodies = tuple(turned(name, angle + 0.02, axis) for name, (angle, axis) in angles.items())
    mechanism = Mechanism(bodies, tuple(joints[k] for k in order), (driven("A", law),))
    motion = refkin.solve(Scene(mechanism=mechanism, times=(0.0, 0.5)))

    assert (motion.verdict, motion.message) == ("ok", "")  # from the estimate, without a search
    assert {name: c.s[0] for name, c in motion.contacts.items()} == pytest.approx(
        {"A": law(0.0) / 2, "B": -law(0.0) / 4, "C": law(0.0) / 6}, abs=1e-13
    )
    for name, (angle, axis) in angles.items():
        p = np.array([math.cos(angle / 2), *(math.sin(angle / 2) * x for x in axis)])
        assert abs(p @ motion[name].q[3:, 0]) == pytest.approx(1.0, abs=1e-14)


def test_a_gear_that_no_driver_turns_begins_in_the_turn_about_zero():
    """A slide pushes a crank by a rod, and the crank's wheel is in gear: nothing but estimates says how far it is."""
    crank, wheel = axle("A", GROUND, "a", Z), axle("B", GROUND, "b", X)
    slide = axle("P", GROUND, "slide", X, (4.0, 0.0, 0.0), SpatialPrismatic)
    ends: Any = {"body_i": "a", "point_i": X, "body_j": "slide", "point_j": AT}
    rod = SpatialDistance(name="rod", **ends, length=3.0)
    push = refkin.DisplacementDriver(name="push", joint="P", law=Polynomial(coefficients=(-0.5, -0.25)))
    first = math.acos((1.0 + 3.5**2 - 9.0) / 7.0)
    bodies = (
        turned("a", first + 0.03, Z),
        turned("b", -2 * first, X),
        Body(name="slide", estimate=(3.5, *AT[1:], *(1.0, *AT))),
    )
    mechanism = Mechanism(bodies, (crank, wheel, slide, rod, mesh("A", 0.5, "B", 0.25)), (push,))
    motion = refkin.solve(Scene(mechanism=mechanism, times=(0.0, 0.5, 1.0)))

    assert motion.verdict == "ok"
    reach = 3.5 - 0.25 * motion.t
    assert motion.contacts["A"].s == pytest.approx(np.arccos((1.0 + reach**2 - 9.0) / (2 * reach)) / 2, abs=1e-14)
    assert motion.contacts["B"].s == pytest.approx(-2 * motion.contacts["A"].s, abs=1e-14)


@pytest.mark.parametrize(("radii", "turns"), [((1.0, 1.0), 1), ((1.0, 2.0), 2)])
def test_a_wheel_that_a_rod_holds_is_in_as_many_assemblies_as_look_different(radii, turns):
    """A rod leaves two angles to the first wheel; after `turns` of it the second looks as before."""
    wheels = axle("A", GROUND, "a", Z), axle("B", GROUND, "b", Z, (sum(radii), 0.0, 0.0))
    ends = {"body_i": GROUND, "point_i": (2.0, 1.0, 0.5), "body_j": "a", "point_j": X}
    joints = (*wheels, mesh("A", radii[0], "B", radii[1]), SpatialDistance(name="rod", **ends, length=1.5))
    mechanism = Mechanism((Body(name="a"), Body(name="b")), joints)

    assert len(assemblies(compile_system(mechanism, unit=mechanism.unit()), 0.0).poses) == 2 * turns


@pytest.mark.parametrize(("phi", "radii"), [(-3.0, (1.0, 1.0)), (-1.0, (1.0, 2.0)), (3.0, (3.0, 2.0))])
def test_the_assembly_that_an_estimate_leads_to_is_not_counted_once_more(phi, radii):
    """Newton goes from it to an assembly that the search knows, or to that after turns; it is not the nearest."""
    wheels = axle("A", GROUND, "a", Z), axle("B", GROUND, "b", Z, (sum(radii), 0.0, 0.0))
    ends = {"body_i": GROUND, "point_i": (2.0, 1.0, 0.5), "body_j": "a", "point_j": X}
    joints = (*wheels, mesh("A", radii[0], "B", radii[1]), SpatialDistance(name="rod", **ends, length=1.5))
    for other in (-3.0, -1.0, 1.0, 3.0):
        estimates = (
            (x, 0.0, 0.0, math.cos(a / 2), 0.0, 0.0, math.sin(a / 2)) for x, a in ((0, phi), (sum(radii), other))
        )
        bodies = tuple(Body(name=name, estimate=estimate) for name, estimate in zip("ab", estimates, strict=True))
        mechanism = Mechanism(bodies, joints)
        message = find_start(
            compile_system(mechanism, unit=mechanism.unit()), Scene(mechanism=mechanism, times=(0.0,))
        ).message

        assert f"of {2 if radii[0] == radii[1] else 4} found" in message


def test_a_screw_and_a_cylindrical_joint_are_in_gear_by_their_turns():
    """The screw shifts by its pitch and turns; what is in gear turns with it and shifts by its own driver."""
    screw = axle("H", GROUND, "nut", Z, kind=Screw, pitch=0.1)
    sleeve = axle("C", GROUND, "sleeve", X, kind=Cylindrical)
    shift = refkin.DisplacementDriver(name="shift", joint="C", law=Polynomial(coefficients=(0.3, 0.2)))
    bodies = turned("nut", 0.2, Z, (0.0, 0.0, 0.02)), turned("sleeve", -0.4, X, (0.3, 0.0, 0.0))
    mechanism = Mechanism(bodies, (screw, sleeve, mesh("H", 0.5, "C", 0.25)), (driven("H"), shift))
    motion = refkin.solve(Scene(mechanism=mechanism, times=TIMES, points=(Point(name="P", body="sleeve", position=Z),)))
    angle = -2 * (0.2 + 3.0 * motion.t + motion.t**2)

    assert motion.verdict == "ok"
    assert motion["nut"].q[2] == pytest.approx(-0.05 * angle, abs=1e-13)
    assert motion.points["P"].r == pytest.approx(
        np.array([0.3 + 0.2 * motion.t, -np.sin(angle), np.cos(angle)]), abs=1e-13
    )


def faults(*joints: Any, bodies: str = "ab") -> dict[str, Any]:
    """Return path -> value of what is wrong with joints."""
    with pytest.raises(refkin.InvalidScene) as caught:
        Mechanism(tuple(Body(name=name) for name in bodies), joints, (driven("A"),))
    return {fault.path: fault.value for fault in caught.value.faults}


def test_what_is_wrong_with_a_gear_is_named():
    a, b = axle("A", GROUND, "a", Z), axle("B", GROUND, "b", X)
    gear = mesh("A", 1.0, "B", 2.0)

    for wrong in (
        (a, b, replace(gear, joint_j="D")),
        (a, b, replace(gear, joint_j="A")),
        (a, axle("B", GROUND, "b", X, kind=SpatialPrismatic), gear),
        (a, axle("B", "b", "c", X), gear),  # no body in common
        (a, axle("B", GROUND, "a", X), gear),  # two
        (a, axle("B", GROUND, GROUND, X), gear),  # a joint of one body
    ):
        assert faults(*wrong, bodies="abc")["joint[2].joint_i"] == "A"
    held = axle("A", "a", "a", Z), axle("B", "a", "b", Z)  # one of them has one body at both ends
    assert faults(*held, gear) == {"joint[0]": "a", "joint[2].joint_i": "A", "driver[0]": "a"}
    lost = axle("A", "far", "a", Z), axle("B", "far", "b", Z)  # a gear has no keys of bodies
    assert faults(*lost, gear) == {"joint[0].body_i": "far", "joint[1].body_i": "far"}
    assert faults(a, b, replace(gear, radius_j=0.0)) == {"joint[2].radius_j": 0.0}
    assert faults(a, replace(b, zero_i=None), gear) == {"joint[1].zero_i": None}
    assert faults(a, b, replace(gear, phi0_i=math.inf)) == {"joint[2].phi0_i": math.inf}
