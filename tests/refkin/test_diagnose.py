"""What a pose is where phi_q loses rank: one mechanism for each kind, with the rows and bodies that it is due to."""

from __future__ import annotations

import math
from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest

import refkin
from refkin import (
    AngleDriver,
    Body,
    Cam,
    FourBar,
    InvertedSliderCrank,
    Mechanism,
    Polar,
    Polynomial,
    Prismatic,
    Revolute,
    Scene,
    SliderCrank,
    SpatialAngleDriver,
    SpatialRevolute,
    Status,
    YDriver,
    compile_system,
)
from refkin.proof.numbers.recentred import recentred
from refkin.proof.path.curve import common_roots
from refkin.proof.singularity.diagnosis import PoseKind, _Examination
from refkin.proof.singularity.second_order import balanced, cone
from tests.linkages import (
    CHANGE_POINT,
    KITE,
    LIMITED,
    PARALLELOGRAM,
    beside,
    moved_frame,
    posed,
    remade,
    system_of,
    with_estimates,
)
from tests.refkin.assembly_cases import cylinder, pin
from tests.refkin.test_sweep import three_cranks

GROUND = "ground"


def at(linkage, angle, **more):
    return linkage.scene(law=Polynomial(coefficients=(angle, 1.0)), times=(0.0,), **more)


def dead_centre():
    """Crank 1/4 and rod 1/2, stretched at 3/4: numbers without rounding."""
    return at(SliderCrank(0.25, 0.5), 0.75, driven="slider")


def with_wheel(scene):
    """A wheel that nothing drives, pinned to the ground."""
    m = scene.mechanism
    wheel = Body(name="wheel", estimate=(9.0, 0.0, 0.3))
    joints = (*m.joints, pin("axle", GROUND, (9.0, 0.0), "wheel", (0.0, 0.0)))
    return remade(scene, bodies=(*m.bodies, wheel), joints=joints)


def links(base, long):
    """Two links on the ground, pinned to each other, with no driver: a triangle, or one laid flat."""
    bodies = (Body(name="left", estimate=(0.0, 0.0, 0.3)), Body(name="right", estimate=(base, 0.0, 2.8)))
    joints = (
        pin("O", GROUND, (0.0, 0.0), "left", (0.0, 0.0)),
        pin("P", GROUND, (base, 0.0), "right", (0.0, 0.0)),
        pin("Q", "left", (long, 0.0), "right", (long, 0.0)),
    )
    return Scene(name="triangle", mechanism=Mechanism(bodies=bodies, joints=joints, drivers=()), times=(0.0,))


def reaching(length):
    """A link that turns about the origin, driven by the distance of its tip from a point it can touch."""
    bodies = (Body(name="link", estimate=(0.0, 0.0, 0.0)),)
    driver = cylinder(GROUND, (1.0, 0.0), "link", (1.0, 0.0), length)
    joints = (pin("O", GROUND, (0.0, 0.0), "link", (0.0, 0.0)),)
    return Scene(name="rope", mechanism=Mechanism(bodies=bodies, joints=joints, drivers=(driver,)), times=(0.0,))


def held_by_height():
    """A slider-crank driven by the height of its slider, which its guide holds already."""
    scene = at(SliderCrank(0.25, 0.5), 0.4)
    driver = YDriver(name="height", body="slider", law=Polynomial(coefficients=(0.0,)))
    return remade(scene, drivers=(driver,))


def limit():
    scene = at(LIMITED, 0.0)
    event = refkin.follow(scene).events[0]
    return scene, event.q, event.t


ONE = {
    PoseKind.REGULAR: lambda: (at(LIMITED, 0.5),),
    PoseKind.REDUNDANT: lambda: (three_cranks(0.0),),
    PoseKind.STRUCTURE: lambda: (links(2.0, 1.5),),
    PoseKind.FORMULATION: lambda: (reaching(0.0), (0.0, 0.0, 0.0), 0.0),
    PoseKind.TURNING_POINT: limit,
    PoseKind.ACTUATOR: lambda: (beside(dead_centre(), dead_centre()),),
    PoseKind.IDLE: lambda: (with_wheel(three_cranks(0.0)),),
    PoseKind.BIFURCATION: lambda: (at(CHANGE_POINT, math.pi),),
}


@pytest.mark.parametrize("kind", ONE)
def test_a_pose_of_each_kind_is_called_what_it_is(kind):
    diagnosis = refkin.diagnose(*ONE[kind]())

    assert diagnosis.kind is kind
    assert diagnosis.message.startswith(f"{kind.value}: ")


@pytest.mark.parametrize(("linkage", "angle"), [(CHANGE_POINT, math.pi), (PARALLELOGRAM, 0.0), (KITE, math.pi)])
def test_change_points_have_two_tangents_that_satisfy_the_equations_to_first_order(linkage, angle):
    scene = at(linkage, angle)
    diagnosis = refkin.diagnose(scene)
    system = compile_system(scene.mechanism)
    q = refkin.solve(scene).q[:, 0]

    assert diagnosis.kind is PoseKind.BIFURCATION
    assert len(diagnosis.tangents) == 2
    for tangent in diagnosis.tangents:
        moved = system.phi_q(q, 0.0)[:-1] @ tangent
        assert np.max(np.abs(moved)) < 1e-6 * np.max(np.abs(tangent))
    crank_to_rocker = sorted(tangent[8] / tangent[2] for tangent in diagnosis.tangents)
    path = refkin.follow(at(linkage, angle - 0.5), until=(-0.5, 0.7))
    assert crank_to_rocker == pytest.approx(sorted(v.rate[8] for v in path.events[0].tangents), abs=1e-6)


@pytest.mark.parametrize("lone", ["driven", "free"])
def test_a_linkage_beside_an_independent_crank_is_what_it_is_alone(lone):
    """With a driver of its own: it was of higher order, which it is where nothing holds that crank."""
    scene = at(PARALLELOGRAM, 0.0)
    m, alone = scene.mechanism, refkin.diagnose(scene)
    hinge = Revolute(name="L", body_i=GROUND, point_i=(0.5, 5.0), body_j="lone", point_j=(0.0, 0.0))
    motor = replace(m.drivers[0], name="lone motor", body="lone" if lone == "driven" else "rocker")
    bodies = (*m.bodies, Body(name="lone", estimate=(0.5, 5.0, 0.0)))
    beside = refkin.diagnose(replace(scene, mechanism=Mechanism(bodies, (*m.joints, hinge), (*m.drivers, motor))))

    if lone == "free":
        assert beside.kind is PoseKind.HIGHER
        return
    assert (beside.kind, beside.rows, beside.bodies) == (alone.kind, alone.rows, alone.bodies)
    n = len(alone.tangents[0])
    pairs = [(a, b[:n]) for a in alone.tangents for b in beside.tangents]
    assert sum(np.allclose(a, b, atol=1e-9) or np.allclose(a, -b, atol=1e-9) for a, b in pairs) == 2


def test_a_dead_centre_names_rows_bodies_and_a_driver_that_would_hold():
    diagnosis = refkin.diagnose(dead_centre())

    assert diagnosis.kind is PoseKind.TURNING_POINT
    assert diagnosis.rows == ("A0", "A", "B", "driver")
    assert diagnosis.bodies == ("crank", "connecting_rod")
    assert diagnosis.other_driver == "the angle of crank"


@pytest.mark.parametrize("length", [1e-6, 1e6])
def test_bodies_and_rows_are_involved_by_their_part_of_a_null_vector_however_long_it_is(length):
    mechanism = dead_centre().mechanism
    frames = recentred(compile_system(mechanism, unit=mechanism.unit()))
    pose = _Examination(frames, np.linspace(0.1, 0.9, frames.inner.n), 0.0)
    motion, rows = np.zeros((frames.inner.n, 2)), np.zeros((1, frames.inner.m))
    motion[[2, 5, 8], [0, 1, 0]] = rows[0, [0, 2, 4]] = length * np.array([1.0, 2e-4, 0.5e-4])

    assert pose._bodies(motion) == ("crank", "connecting_rod")
    assert pose._rows(rows) == ("A0", "A")


def test_several_drivers_that_turn_back_together_are_told_as_several():
    """A platform whose three cylinders lie on lines through one point, about which it can turn."""
    ends = {"a": (1.0, 0.0), "b": (-0.5, 0.75), "c": (-0.5, -1.0)}
    cylinders = [
        refkin.DistanceDriver(
            name=name, body_i=GROUND, point_i=(2 * x, 2 * y), body_j="plate", point_j=(x, y),
            law=Polynomial(coefficients=(math.hypot(x, y), 1.0)),
        )
        for name, (x, y) in ends.items()
    ]  # fmt: skip
    found = refkin.diagnose(compile_system(Mechanism([Body(name="plate")], [], cylinders)), np.zeros(3), 0.0)

    assert (found.kind, found.rows) == (PoseKind.TURNING_POINT, ("a", "b", "c"))
    assert "to first order, and a, b and c turn back; driven by the angle of plate" in found.message


@pytest.mark.parametrize("estimate", [0.0, 0.3])
def test_a_lever_at_the_full_reach_of_its_cylinder_turns_back_though_nothing_else_feels_its_angle(estimate):
    """What rounding leaves of the angle's column, 1e-16, passed for full rank."""
    lever = Body(name="lever", estimate=(0.0, 0.0, estimate))
    stretched = cylinder(GROUND, (1.0, 0.0), "lever", (1.0, 0.0), 2.0)
    mechanism = Mechanism((lever,), (pin("O", GROUND, (0.0, 0.0), "lever", (0.0, 0.0)),), (stretched,))
    reached = refkin.diagnose(Scene(mechanism=mechanism, times=(0.0,)))

    assert reached.kind is PoseKind.TURNING_POINT
    assert (reached.bodies, reached.other_driver) == (("lever",), "the angle of lever")


@pytest.mark.parametrize(("angle", "regular"), [(math.pi, False), (2.0, True)])
def test_whether_a_pose_is_regular_is_asked_where_its_bodies_are_in_frames_near_the_joints(angle, regular):
    far = 2.0**10
    lever = Body(name="lever", estimate=(far * math.sin(angle), -far * math.cos(angle), angle))
    reached = cylinder(GROUND, (1.0, 0.0), "lever", (1.0, far), 2.0)
    mechanism = Mechanism((lever,), (pin("O", GROUND, (0.0, 0.0), "lever", (0.0, far)),), (reached,))
    system = compile_system(mechanism, unit=mechanism.unit())

    assert recentred(system).furthest > 0.0
    assert recentred(system).is_regular(system.to_unit(np.array(lever.estimate)), 0.0) is regular


def test_with_the_other_driver_the_same_pose_is_regular():
    assert refkin.diagnose(at(SliderCrank(0.25, 0.5), 0.0)).kind is PoseKind.REGULAR


def test_an_idle_wheel_is_named_alone():
    assert refkin.diagnose(with_wheel(three_cranks(0.0))).bodies == ("wheel",)


def test_a_driver_that_repeats_what_a_joint_holds_leaves_an_idle_motion():
    diagnosis = refkin.diagnose(held_by_height())

    assert diagnosis.kind is PoseKind.IDLE
    assert "height" in diagnosis.rows
    assert diagnosis.bodies == ("crank", "connecting_rod", "slider")


def driven(kind, name, value, **more):
    return kind(name=name, law=Polynomial(coefficients=(value,)), **more)


@pytest.mark.parametrize("order", [1, -1])
def test_two_drivers_that_hold_nothing_are_both_named_in_whichever_order(order):
    """One of them was, or a part of both."""
    drivers = [
        driven(what, f"{name} {what.__name__} {k}", 0.0, body=name)
        for name in ("left", "right")
        for k, what in enumerate((AngleDriver, AngleDriver, YDriver))
    ]
    bodies = tuple(Body(name=name, estimate=(0.0, 0.0, 0.0)) for name in ("left", "right"))
    diagnosis = refkin.diagnose(Scene(mechanism=Mechanism(bodies, (), drivers[::order]), times=(0.0,)))

    assert (diagnosis.kind, diagnosis.bodies) == (PoseKind.IDLE, ("left", "right"))
    assert {*diagnosis.rows} == {d.name for d in drivers if "Angle" in d.name}


def test_a_motion_that_goes_on_is_found_beside_one_that_does_not():
    """A link swings round, and what is guided along it; a slider is held to second order: all three were a mixture."""
    arm = refkin.Distance(name="arm", body_i=GROUND, point_i=(-1.0, 0.0), body_j="a", point_j=(-1.0, 1.0), length=1.0)
    slide = {"body_i": GROUND, "point_i": (2.0, -2.0), "axis_i": (1.0, 0.0), "body_j": "b", "point_j": (1.0, -2.0)}
    guide = {"body_i": "a", "point_i": (-1.0, 0.0), "axis_i": (-4.0, 3.0), "body_j": "c", "point_j": (-5.0, 3.0)}
    drivers = (
        driven(YDriver, "lift", -2.0, body="b", point=(-2.0, -2.0)),
        driven(AngleDriver, "turn c", 0.0, body="c"),
        cylinder(GROUND, (0.0, 0.0), "b", (0.0, 1.0), 1.0),
        driven(AngleDriver, "turn b", 0.0, body="b"),
        driven(AngleDriver, "turn b on a", 0.0, body="b", relative_to="a"),
    )
    bodies = tuple(Body(name=name, estimate=(0.0, 0.0, 0.0)) for name in "abc")
    joints = (arm, Prismatic(name="slide", **slide), refkin.PointOnLine(name="guide", **guide))

    assert refkin.diagnose(Scene(mechanism=Mechanism(bodies, joints, drivers), times=(0.0,))).kind is PoseKind.IDLE


def test_links_that_are_short_for_the_mechanism_turn_far_while_a_motion_is_followed():
    """A plate on two bars that turn against each other, in a mechanism of 32 m: it was held to first order alone."""
    bars, arm = {"body_i": GROUND, "body_j": "plate"}, pin("pin", GROUND, (30.0, 0.0), "arm", (0.0, 0.0))
    bar = refkin.Distance(name="bar", **bars, point_i=(-1.0, -1.0), point_j=(2.0, 3.0), length=5.0)
    drivers = (
        cylinder(GROUND, (4.0, 5.0), "plate", (1.0, 1.0), 5.0),
        driven(AngleDriver, "turn", 0.0, body="arm"),
        driven(AngleDriver, "turn again", 0.0, body="arm"),
    )
    bodies = (Body(name="plate", estimate=(0.0, 0.0, 0.0)), Body(name="arm", estimate=(30.0, 0.0, 0.0)))

    found = refkin.diagnose(Scene(mechanism=Mechanism(bodies, (bar, arm), drivers), times=(0.0,)))
    assert (found.kind, found.bodies) == (PoseKind.IDLE, ("plate",))


@pytest.mark.parametrize("angle", [2.9, -1.0])
def test_a_root_far_away_that_rounding_makes_is_not_that_of_a_pose_where_no_driver_holds_the_slider(angle):
    """It is 713 m away, or 0.6: a guide that is level by the axis' numbers, at a height that drivers hold."""
    c, s = math.cos(angle), math.sin(angle)
    place = (c - 0.5 * s, s + 0.5 * c)
    slide = {"point_i": (1.0, 0.5), "axis_i": (c, -s), "angle": -angle}
    joints = (
        pin("pin", GROUND, (0.0, 0.0), "arm", (0.0, 0.0)),
        Prismatic(name="slide", body_i="arm", body_j="slider", point_j=(0.0, 0.0), **slide),
    )
    drivers = (driven(AngleDriver, "turn", angle, body="arm"), driven(YDriver, "lift", place[1], body="slider"))
    bodies = (Body(name="arm", estimate=(0.0, 0.0, angle)), Body(name="slider", estimate=(*place, 0.0)))
    scene = Scene(mechanism=Mechanism(bodies, joints, drivers), times=(0.0,))
    found = refkin.diagnose(scene, (0.0, 0.0, angle, *place, 0.0))

    assert (found.kind, found.bodies) == (PoseKind.IDLE, ("slider",))
    assert "nearly singular" in (said := refkin.solve(scene).message)
    assert "idle motion: with the drivers held slider can still move" in said


def test_a_pose_is_not_said_to_be_alone_where_solve_says_that_it_is_singular():
    """Other rows of the redundant ones may say something else there: `redundant rows that agree` explained it."""
    scene = with_estimates(three_cranks(0.0), lambda b: (*b.estimate[:2], 0.3))
    motion = refkin.solve(remade(scene, drivers=(driven(AngleDriver, "motor", 0.3 + 1e-8, body="first"),)))

    assert motion.status[0] is Status.SINGULAR
    assert "redundant rows: " not in motion.message
    assert PoseKind.HIGHER.value in motion.message


def test_redundant_rows_are_those_of_the_parallel_cranks():
    diagnosis = refkin.diagnose(three_cranks(0.0))

    assert set(diagnosis.rows) == {f"{crank} {end}" for crank in ("first", "middle", "last") for end in (0, 1)}
    assert diagnosis.message.endswith("and agree")


def test_a_flat_triangle_is_a_structure_that_can_move_to_first_order_only():
    angles = {"left": 0.0, "right": math.pi}
    diagnosis = refkin.diagnose(with_estimates(links(2.0, 1.0), lambda b: (*b.estimate[:2], angles[b.name])))

    assert diagnosis.kind is PoseKind.STRUCTURE
    assert "shaky" in diagnosis.message
    assert diagnosis.bodies == ("left", "right")


def test_a_pin_on_the_pivot_of_its_slot_is_a_bifurcation_of_the_lever():
    diagnosis = refkin.diagnose(at(InvertedSliderCrank(ground=1.0, crank=1.0), 0.0))

    assert diagnosis.kind is PoseKind.BIFURCATION
    assert diagnosis.bodies == ("lever",)


@pytest.mark.parametrize(
    ("a", "known", "kind"),
    [(0.1, 0.0, PoseKind.ACTUATOR), (0.1, 4e-6, PoseKind.ACTUATOR), (0.125, 0.0, PoseKind.TURNING_POINT)],
)
def test_a_face_turns_its_cam_back_at_an_inflection_but_not_on_a_flat_spot(a, known, kind):
    """r = 1 + a sin 3s: two inflections, at a = 1/10 in one place, known to 4e-6, of which the bend was one."""
    sine = (11.0 - math.sqrt(121.0 + 32.0 * (1.0 + 18.0 * a * a))) / (16.0 * a)
    s = math.asin(max(sine, -1.0)) / 3.0
    r, slope = 1.0 + a * sine, 3.0 * a * math.cos(3.0 * s)
    angle = math.pi - s - math.atan2(r, slope)  # there the face, on top of the cam, is level
    ends = {"point_i": (0.0, 0.0), "body_j": "face", "point_j": (0.0, 0.0)}
    lobes = Polar(law=refkin.Sinusoid(offset=1.0, amplitude=a, angular_frequency=3.0))
    joints = (
        pin("O", GROUND, (0.0, 0.0), "cam", (0.0, 0.0)),
        Prismatic(name="guide", body_i=GROUND, **ends, axis_i=(0.0, 1.0)),
        Cam(name="touch", body_i="cam", **ends, profile=lobes, follower="flat", normal_j=(0.0, -1.0)),
    )
    bodies, motor = (Body(name="cam"), Body(name="face")), driven(AngleDriver, "motor", angle, body="cam")
    pose = (0.0, 0.0, angle, 0.0, r * math.sin(angle + s), 0.0, s + known)
    found = refkin.diagnose(compile_system(Mechanism(bodies, joints, (motor,))), pose, 0.0)

    assert (found.kind, found.bodies) == (kind, ())
    assert "with the drivers held the place where a cam is touched can still move to first order" in found.message


def test_a_cam_that_is_a_point_is_touched_anywhere():
    law, profile = Polynomial(coefficients=(0.2, 1.0)), Polar(law=Polynomial(coefficients=(0.0,)))
    at = {"body_i": "cam", "point_i": (0.0, 0.0), "body_j": "pin"}
    joints = (
        pin("O", GROUND, (0.0, 0.0), "cam", (0.0, 0.0)),
        Prismatic(name="guide", **(at | {"body_i": GROUND}), point_j=(0.0, 0.0), axis_i=(0.0, 1.0), angle=0.0),
        Cam(name="touch", **at, point_j=(0.0, 0.0), profile=profile, follower="point"),
    )
    bodies = (Body(name="cam", estimate=(0.0, 0.0, 0.2)), Body(name="pin", estimate=(0.0, 0.0, 0.0)))
    drivers = (AngleDriver(name="motor", body="cam", law=law),)
    found = refkin.diagnose(Scene(mechanism=Mechanism(bodies, joints, drivers), times=(0.0,)))

    assert (found.kind, found.bodies) == (PoseKind.IDLE, ())
    assert found.message == "idle motion: no driver holds the place where a cam is touched"


@pytest.mark.parametrize("factor", [2.0**-30, 1e-9, 1e9])
def test_units_change_no_diagnosis(factor):
    scenes = [at(SliderCrank(0.25 * x, 0.5 * x), 0.75 * x, driven="slider") for x in (1.0, factor)]
    here, there = map(refkin.diagnose, scenes)

    assert there == replace(here, sigma=there.sigma, message=there.message)


@pytest.mark.parametrize("ratio", [1e-6, 1e-4, 1e4, 1e6])
def test_lengths_of_very_different_size_are_no_singularity(ratio):
    diagnosis = refkin.diagnose(at(FourBar(ground=1.0, crank=ratio, coupler=1.0, rocker=max(1.0, ratio)), 1.0))

    assert diagnosis.kind is PoseKind.REGULAR
    assert "nearly" not in diagnosis.message


@pytest.mark.parametrize("far", [1e4, 2.0**26])
def test_a_body_frame_far_away_is_no_singularity(far):
    diagnosis = refkin.diagnose(moved_frame(at(LIMITED, 0.5), "coupler", (far, -far)))

    assert diagnosis.kind is PoseKind.REGULAR
    assert "nearly" not in diagnosis.message


def test_a_pose_proved_by_balls_is_handed_over_as_the_nearest_numbers():
    """Its angles are right to round-off, though Newton's are off by 1e-8. No length is rounded here."""
    far = 2.0**26
    exact = FourBar(ground=0.875, crank=0.25, coupler=0.625, rocker=0.5)
    here = refkin.solve(at(exact, 0.5))
    there = refkin.solve(moved_frame(at(exact, 0.5), "coupler", (far, -far)))
    away = far * math.hypot(1.0, 1.0)

    assert there.verdict is Status.OK
    assert there["rocker"].phi[0] == pytest.approx(here["rocker"].phi[0], abs=8e-16)
    assert there["coupler"].phi[0] == pytest.approx(here["coupler"].phi[0], abs=8e-16)
    assert there.certified_radius.position[0] <= 2.0**-52 * away


@pytest.mark.parametrize("far", [2.0**6, 2.0**13, 2.0**20, 2.0**26])
def test_the_radius_of_a_pose_in_a_far_frame_holds_the_truth(far):
    exact = FourBar(ground=0.875, crank=0.25, coupler=0.625, rocker=0.5)
    truth = refkin.solve(at(exact, 0.5))
    motion = refkin.solve(moved_frame(at(exact, 0.5), "coupler", (far, -far)))
    off = abs(motion["rocker"].phi[0] - truth["rocker"].phi[0])

    assert motion.verdict is Status.OK
    assert off <= motion.certified_radius.position[0] + truth.certified_radius.position[0]


@pytest.mark.parametrize("far", [2.0**10, 2.0**20, 2.0**26])
def test_a_motion_in_a_far_frame_is_followed_with_the_same_rates(far):
    exact = FourBar(ground=0.875, crank=0.25, coupler=0.625, rocker=0.5)
    scene = exact.scene(law=Polynomial(coefficients=(0.5, 1.0)), times=tuple(np.linspace(0.0, 0.8, 9)))
    here, there = refkin.solve(scene), refkin.solve(moved_frame(scene, "coupler", (far, -far)))

    assert there.verdict is Status.OK
    assert np.max(np.abs(there["rocker"].qd[2] - here["rocker"].qd[2])) < 1e-14
    assert np.max(np.abs(there["coupler"].qdd[2] - here["coupler"].qdd[2])) < 1e-13


def test_changes_of_coordinates_and_of_moved_frames_go_together():
    """Against complex steps, both ways."""
    scene = moved_frame(at(LIMITED, 0.5), "coupler", (8.0, -16.0))
    frames = recentred(system_of(scene))
    q, rate = np.linspace(-1.0, 2.0, 9), np.linspace(1.0, -3.0, 9) ** 3
    h = 1e-6
    inner = (frames.inward(q + h * rate) - frames.inward(q - h * rate)) / (2 * h)

    assert np.any(frames.shifts)
    assert np.max(np.abs(frames.outward(frames.inward(q)) - q)) < 1e-14
    assert np.max(np.abs(frames.inward_rate(frames.inward(q), rate) - inner)) < 1e-7
    assert np.max(np.abs(frames.outward_rate(frames.inward(q), inner) - rate)) < 1e-7


@pytest.mark.parametrize("distance", [1e-4, 1e-7, 1e-10])
def test_near_a_singularity_a_regular_pose_says_which_one(distance):
    diagnosis = refkin.diagnose(at(CHANGE_POINT, math.pi - distance))

    assert diagnosis.kind is PoseKind.REGULAR
    assert "nearly singular" in diagnosis.message
    assert "bifurcation" in diagnosis.message


def test_solve_says_what_its_first_singular_pose_is():
    motion = refkin.solve(CHANGE_POINT.scene(turns=1, samples=13))

    assert Status.SINGULAR in motion.status
    assert "bifurcation: the joints allow 2 motions to first order" in motion.message


@pytest.mark.parametrize(("numbers", "said"), [(9, "no pose"), (6, r"q: expected 9 numbers, got array\(")])
def test_a_pose_that_does_not_close_or_has_too_few_coordinates_is_refused(numbers, said):
    with pytest.raises(ValueError, match=said):
        refkin.diagnose(at(LIMITED, 0.5), np.zeros(numbers), 0.0)


def test_redundant_rows_that_contradict_each_other_are_refused_and_have_no_diagnosis():
    scene = three_cranks(0.0, 1e-3)

    assert refkin.solve(scene).verdict is Status.UNASSEMBLABLE
    with pytest.raises(ValueError, match="no first pose"):
        refkin.diagnose(scene)


def cone_of(*forms):
    """The cone of motions that satisfy conditions with these forms, of coordinates that are free to first order."""
    n = len(forms[0])
    held = SimpleNamespace(
        rank=lambda tolerance: 0, right_null=lambda tolerance: np.eye(n), system=SimpleNamespace(n=n)
    )
    return cone(SimpleNamespace(**vars(held), left_null=lambda rank: forms, bend=np.array), 1e-9)


@pytest.mark.parametrize(
    ("forms", "independent", "count", "definite"),
    [
        ([np.zeros((2, 2))], 0, 0, False),
        ([np.diag([1.0, 2.0])], 1, 0, True),
        ([np.diag([1.0, -2.0])], 1, 2, False),
        ([np.diag([1.0, -2.0]), np.diag([-3.0, 6.0])], 1, 2, False),
        ([np.diag([1.0, -2.0]), np.array([[0.0, 1.0], [1.0, 0.0]])], 2, 0, False),
        ([np.diag([1.0, -1.0, 0.0])], 1, 0, False),
        ([np.diag([1.0, 2.0, 3.0])], 1, 0, True),
        ([np.diag([1.0, -1.0, 0.0]), np.diag([0.0, 1.0, -1.0])], 2, 4, False),
        ([np.diag([1.0, -1.0, 0.0]), np.diag([0.0, 1.0, -1.0]), np.diag([2.0, -1.0, -1.0])], 2, 4, False),
        ([np.diag([1.0, -1.0, 0.0]), np.diag([0.0, 1.0, -1.0]), np.diag([0.0, 0.0, 1.0])], 3, 0, True),
    ],
)
def test_the_motions_that_go_on_satisfy_every_condition_where_they_are_finitely_many(
    forms, independent, count, definite
):
    result = cone_of(*forms)

    assert (result.forms, len(result.tangents)) == (independent, count)
    assert all(abs(a @ form @ a) < 1e-12 for a in result.tangents for form in forms)
    if independent < 3:
        assert result.is_definite is definite


def test_the_bend_of_rows_is_their_second_difference():
    scene = at(LIMITED, 0.3)
    system, h = compile_system(scene.mechanism), 1e-3
    rng = np.random.default_rng(1)
    q, way, weights = rng.uniform(-1.0, 1.0, system.n), rng.uniform(-1.0, 1.0, system.n), rng.uniform(-1.0, 1.0, 5)
    held = balanced(system, q, 0.0, np.arange(5))
    sums = [weights @ system.phi(q + k * h * way, 0.0)[:5] for k in (-1, 0, 1)]

    assert way @ held.bend(weights) @ way == pytest.approx((sums[0] - 2 * sums[1] + sums[2]) / h**2, rel=1e-5)


def test_common_roots_of_forms_are_all_found_once():
    """a^2 = b^2 = c^2: the four lines through the corners of a cube."""
    result = common_roots([np.diag([1.0, -1.0, 0.0]), np.diag([0.0, 1.0, -1.0])])
    signs = {tuple(np.sign(a * a[0])) for a in result}

    assert len(result) == len(signs) == 4
    assert np.max(np.abs(np.abs(result) - 3**-0.5)) < 1e-14


def test_a_double_root_of_forms_is_one_direction():
    """a^2 = b c and c (b - c) = 0: the conic has two points on one line, and touches the other."""
    conic = np.array([[1.0, 0.0, 0.0], [0.0, 0.0, -0.5], [0.0, -0.5, 0.0]])
    lines = np.array([[0.0, 0.0, 0.0], [0.0, 0.0, 0.5], [0.0, 0.5, -1.0]])
    for seed in range(26):
        turn = np.linalg.qr(np.random.default_rng(seed).normal(size=(3, 3)))[0]

        assert len(common_roots([turn @ form @ turn.T for form in (conic, lines)])) <= 3


def test_forms_have_no_common_root_where_least_squares_satisfy_but_one_of_them():
    """a^2 = b^2 by symmetry; a^2 + b^2 is c^2 and 3 c^2 for none."""
    assert common_roots([np.diag([1.0, -1.0, 0.0]), np.diag([1.0, 1.0, -1.0]), np.diag([1.0, 1.0, -3.0])]) == ()


def test_a_driver_of_another_coordinate_takes_the_row_of_one_that_is_there():
    scene = at(LIMITED, 0.5)
    system, q = posed(scene)
    other = balanced(system, q, 0.0, np.arange(system.m)).with_row(8, 5)

    assert np.flatnonzero(other.matrix[8]).tolist() == [5]


def test_a_frame_far_from_the_only_joint_point_of_its_body_is_moved_to_it():
    pin = refkin.Revolute(name="pin", body_i="ground", point_i=(0.0, 0.0), body_j="b", point_j=(1e6, 0.25))
    motor = refkin.AngleDriver(name="motor", body="b", law=refkin.Polynomial(coefficients=(0.0, 1.0)))
    mechanism = refkin.Mechanism((refkin.Body(name="b"),), (pin,), (motor,))

    assert recentred(refkin.compile_system(mechanism, unit=mechanism.unit())).shifts.tolist() == [[1e6, 0.0]]


def test_a_flat_parallelogram_of_space_is_the_bifurcation_that_it_is_in_the_plane():
    """The rows of bodies stand after those of drivers, and were taken for drivers: `turning point` was said."""
    places = {"crank": (0.0, 0.0), "coupler": (1.0, 0.0), "rocker": (2.0, 0.0)}
    frame = {f"{key}_{side}": axis for key, axis in (("axis", (0, 0, 1)), ("zero", (1, 0, 0))) for side in "ij"}
    pins = [
        ("A0", "ground", 0.0, "crank", 0.0),
        ("A", "crank", 1.0, "coupler", 0.0),
        ("B", "coupler", 2.0, "rocker", 1.0),
        ("B0", "ground", 2.0, "rocker", 0.0),
    ]
    joints = [
        SpatialRevolute(name=name, body_i=i, point_i=(x, 0, 0), body_j=j, point_j=(y, 0, 0), **frame)
        for name, i, x, j, y in pins
    ]
    bodies = [Body(name=name, estimate=(*at, 0, 1, 0, 0, 0)) for name, at in places.items()]
    motor = SpatialAngleDriver(name="motor", joint="A0", law=Polynomial(coefficients=(0.0, 1.0)))
    diagnosis = refkin.diagnose(Scene(mechanism=Mechanism(bodies, joints, [motor]), times=(0.0,)))

    assert diagnosis.kind is PoseKind.BIFURCATION
    assert len(diagnosis.tangents) == 2
    assert (diagnosis.rows, diagnosis.other_driver) == (("A0", "A", "B", "B0"), "")
