"""Paths through poses where several rows depend at once: of linkages stacked on each other, and of one of space."""

from __future__ import annotations

import math
import tracemalloc
from dataclasses import replace
from itertools import product

import numpy as np
import pytest

import refkin
from refkin import (
    AngleDriver,
    Body,
    Mechanism,
    Polynomial,
    Revolute,
    Scene,
    SpatialAngleDriver,
    SpatialRevolute,
    Spherical,
    Status,
    Table,
    Universal,
    compile_system,
)
from refkin.proof.path.curve import Crossing, Curve, common_roots, crossing
from refkin.proof.path.tracing import TraceEnd
from tests.linkages import remade
from tests.refkin.test_mobility import parallelogram


def stacked(bases, later=0.0):
    """Parallelograms one after the other, the follower of one the crank of the next, the first flat at t = 0.

    Each of the others is flat so much `later` than the one before it [s], at the same time unless it is given.
    """
    at = np.cumsum([0.0, *bases]).tolist()
    link = {"bar 0": (0.0, 0.0, -0.5)}
    joints = [Revolute(name="O 0", body_i="ground", point_i=(0.0, 0.0), body_j="bar 0", point_j=(0.0, 0.0))]
    for k, base in enumerate(bases, 1):
        phi, arm = -0.5 - (k - 1) * later, (1.0, 0.0) if k == 1 else (math.cos(later), -math.sin(later))
        tip = at[k - 1] + math.cos(phi), math.sin(phi)
        link |= {f"coupler {k}": (*tip, 0.0), f"bar {k}": (at[k], 0.0, phi)}
        for name, i, u, j, x in (
            (f"A {k}", f"bar {k - 1}", arm, f"coupler {k}", 0.0),
            (f"B {k}", f"coupler {k}", (base, 0.0), f"bar {k}", 1.0),
            (f"O {k}", "ground", (at[k], 0.0), f"bar {k}", 0.0),
        ):
            joints.append(Revolute(name=name, body_i=i, point_i=u, body_j=j, point_j=(x, 0.0)))
    bodies = tuple(Body(name=name, estimate=q) for name, q in link.items())
    crank = AngleDriver(name="crank", body="bar 0", law=Polynomial(coefficients=(0.0, 1.0)))
    return Scene(mechanism=Mechanism(bodies, tuple(joints), (crank,)), times=(-0.5, 0.5), name="stacked")


def test_second_derivatives_take_one_jacobian_of_each_coordinate_and_no_copies_of_them():
    """Of 50 hinges in space that is 0.7 GB: copied twice, a third of the time went there, where no two curves cross."""
    scene = stacked((2.0,) * 12)
    system = compile_system(scene.mechanism, unit=scene.mechanism.unit())
    q = np.concatenate([body.estimate for body in scene.mechanism.bodies])
    curve = Curve.through(system, q, scene.times)
    tracemalloc.start()
    curve.bend(curve.point(q, -0.5), np.ones(system.n), np.arange(system.n))
    peak = tracemalloc.get_traced_memory()[1]
    tracemalloc.stop()

    assert peak < 1.3 * system.n**2 * (system.n + 1) * np.dtype(complex).itemsize


def test_where_several_rows_depend_beyond_the_end_of_a_table_there_is_no_crossing():
    """The law has no numbers there: the step that leads to it is not taken."""
    given = stacked((3.0, 2.0)).mechanism
    arguments = (-0.5, -0.2, -0.1, -1e-5)
    crank = replace(given.drivers[0], law=Table(argument=arguments, value=arguments))
    scene = Scene(mechanism=replace(given, drivers=(crank,)), times=(-0.5, -1e-4))
    system = compile_system(scene.mechanism, unit=scene.mechanism.unit())
    q = system.to_unit(refkin.solve(scene).q[:, -1])
    curve = Curve.through(system, q, [-0.5, -1e-4])
    assert crossing(curve, curve.point(q, -1e-4)) is None


@pytest.mark.parametrize("bases", [(3.0, 2.0), (3.0, 2.0, 2.5)])
def test_where_stacked_parallelograms_are_flat_at_once_the_branches_of_all_of_them_cross(bases):
    """A follower turns with its crank, or as that of an antiparallelogram: -(base + 1) / (base - 1) times as fast."""
    scene = stacked(bases)
    (change,) = refkin.follow(scene).events
    bars = [3 * k + 2 for k, body in enumerate(scene.mechanism.bodies) if body.name.startswith("bar")]
    ratios = [(1.0, -(base + 1.0) / (base - 1.0)) for base in bases]
    rates = [np.cumprod((1.0, *choice)) for choice in product(*ratios)]
    found = [tangent.rate[bars] for tangent in change.tangents]

    assert abs(change.t) < 1e-14
    assert len(found) == len(rates)
    assert all(min(np.max(np.abs(rate - one)) for one in found) < 1e-7 for rate in rates)
    for tangent in change.tangents:
        path = refkin.follow(scene, change, along=tangent, until=(-0.25, 0.25))
        assert path.end is TraceEnd.RANGE
        assert np.max(path.residual) < 1e-13
        assert path.q[bars, 1] == pytest.approx(tangent.rate[bars] * path.t[1], rel=0.1)


@pytest.mark.parametrize("off", [1e-6, 1e-10])
def test_a_parallelogram_beside_another_that_is_none_keeps_its_own_change_point(off):
    """The second one's links miss being equal by so much that its curves pass by each other."""
    scene = stacked((3.0, 2.0))
    joints = tuple(replace(j, point_i=(2.0 - off, 0.0)) if j.name == "B 2" else j for j in scene.mechanism.joints)
    (change,) = refkin.follow(remade(scene, joints=joints)).events

    assert len(change.tangents) == 2


def test_of_a_crossing_all_tangents_are_told_or_none():
    """x^2 = y^2 and x y = z^2 have two real common directions; two others are not real, as far as anybody can tell."""
    product_of_two = np.array([[0.0, 0.5, 0.0], [0.5, 0.0, 0.0], [0.0, 0.0, -1.0]])
    forms = np.array([np.diag([1.0, -1.0, 0.0]), product_of_two])

    assert len(common_roots(list(forms))) == 2
    assert Crossing(np.zeros(3), 0.0, 0.0, forms, np.eye(3)).tangents == ()


@pytest.mark.parametrize("third", [True, False])
def test_a_third_crank_carries_a_parallelogram_through_its_flat_pose(third):
    """Of the rows that are chosen two curves cross there; one that is redundant contradicts a direction of theirs."""
    mechanism, _ = parallelogram(third)
    driver = replace(mechanism.drivers[0], law=Polynomial(coefficients=(1.0, 1.0)))
    path = refkin.follow(Scene(mechanism=replace(mechanism, drivers=(driver,)), times=(0.0, 6.0)))
    bars = [k for k in range(2, 9, 3) if mechanism.bodies[k // 3].name != "coupler"]

    assert path.end is (TraceEnd.RANGE if third else TraceEnd.BIFURCATION)
    assert len(path.bifurcations) == (0 if third else 1)
    assert np.max(np.abs(path.q[bars] - (1.0 + path.t))) < 1e-12


@pytest.mark.parametrize("certified", [False, True])
def test_a_pose_where_branches_cross_is_not_reached_by_a_step_within_which_others_do(certified):
    """The second parallelogram is flat 0.1 s after the first, at a time that is asked for: the pose is not known."""
    passing, at_first = (
        replace(stacked((3.0, 2.0), later=0.1), times=(-0.5, *times)) for times in [(-0.2, 0.1), (-0.2, 0.0)]
    )

    assert refkin.solve(passing, certified=certified).status == (Status.OK, Status.OK, Status.BRANCH_LOST)
    assert refkin.solve(at_first, certified=certified).status == (Status.OK, Status.OK, Status.SINGULAR)


def test_a_last_step_to_a_stretched_pose_that_is_too_short_for_a_proof_leads_there():
    """From 7.5e-7 s before it no tube is proved: the pose was called lost."""
    ground, coupler, rocker, begin = 0.40991783142089844, 0.3866233825683594, 1.023294448852539, 0.8781601073640913
    pins = ("ground", 0.0, "a", 0.0), ("a", -1.0, "b", 0.0), ("b", coupler, "c", rocker), ("ground", ground, "c", 0.0)
    at = {"a": (0.0, 0.0, begin), "b": (-math.cos(begin), -math.sin(begin), 1.2941108), "c": (ground, 0.0, -2.7424868)}
    joints = tuple(Revolute(name=i + j, body_i=i, point_i=(x, 0.0), body_j=j, point_j=(y, 0.0)) for i, x, j, y in pins)
    motor = AngleDriver(name="motor", body="a", law=Polynomial(coefficients=(begin, -begin)))
    bodies = tuple(Body(name=name, estimate=q) for name, q in at.items())
    times = tuple(np.linspace(0.0, 1.0, 72).tolist())
    motion = refkin.solve(Scene(mechanism=Mechanism(bodies, joints, (motor,)), times=times))

    assert motion.status == (*[Status.OK] * 71, Status.SINGULAR)


def test_two_changes_within_a_step_are_met_although_no_sign_changes():
    """One driver spans both parallelograms, so one block of phi_q holds both, and its sign changes twice."""
    scene = stacked((3.0, 2.0))

    def length(angle):
        return math.dist((-math.sin(angle), math.cos(angle)), (5.0 + math.cos(angle), math.sin(angle)))

    law = Polynomial(coefficients=(length(-0.5), length(0.0) - length(-0.5)))
    ends = {"body_i": "bar 0", "point_i": (0.0, 1.0), "body_j": "bar 2", "point_j": (1.0, 0.0)}
    driver = refkin.DistanceDriver(name="span", **ends, law=law)
    (change,) = refkin.follow(remade(scene, drivers=(driver,), times=(0.0, 2.0))).bifurcations

    assert change.t == pytest.approx(1.0, abs=1e-12)
    assert len(change.tangents) == 4


@pytest.mark.parametrize("off", [0.0, 2e-13])
def test_poses_that_a_redundant_row_contradicts_have_no_radius(off):
    """The third crank's pin is off: `solve` proves that no pose is one, and radii were given."""
    mechanism, _ = parallelogram(True)
    driver = replace(mechanism.drivers[0], law=Polynomial(coefficients=(1.0, 1.0)))
    places = {"third pivot": {"point_i": (1.3, 1.0)}, "third pin": {"point_j": (1.3 + off, 1.0)}}
    joints = tuple(replace(j, **places.get(j.name, {})) for j in mechanism.joints)
    bodies = tuple(replace(b, estimate=(1.3, 1.0, 1.0)) if b.name == "third" else b for b in mechanism.bodies)
    path = refkin.follow(Scene(mechanism=Mechanism(bodies, joints, (driver,)), times=(0.0, 1.0)))

    assert len(path.t) > 9
    assert bool(np.isfinite(path.radius[0])) is (off == 0.0)


def test_a_motion_at_a_time_that_stands_still_comes_round_to_the_next_crossing():
    """A folded rhombus turns as one. Rates of t that are rounding halved every step: 2000 points were 0.18 rad."""
    law = Polynomial(coefficients=(-0.5, 1.0))
    scene = refkin.FourBar(1.0, 1.0, 1.0, 1.0).scene(law=law, times=(0.0, 2.0))
    crossing = refkin.follow(scene).bifurcations[0]
    still = min(crossing.tangents, key=lambda tangent: abs(tangent.t))
    path = refkin.follow(scene, crossing, along=still)

    assert path.end is TraceEnd.BIFURCATION
    assert np.ptp(path.q, axis=1).max() == pytest.approx(math.pi, abs=1e-6)
    assert len(path.t) < 100


def of_space(rod):
    """A parallelogram of space if its rod is 2 m long; a ball and a universal joint hold the rod, which may spin."""
    ground, frame = {"body_i": "ground", "axis_i": (0, 0, 1)}, {"zero_i": (1, 0, 0), "zero_j": (1, 0, 0)}
    hinge = {**ground, **frame, "axis_j": (0, 0, 1), "point_j": (0, 0, 0)}
    joints = (
        SpatialRevolute(name="O", **hinge, point_i=(0, 0, 0), body_j="crank"),
        Spherical(name="A", body_i="crank", point_i=(1, 0, 0), body_j="rod", point_j=(0, 0, 0)),
        Universal(
            name="B",
            body_i="rod",
            point_i=(rod, 0, 0),
            axis_i=(0, 0, 1),
            body_j="rocker",
            point_j=(1, 0, 0),
            axis_j=(1, 0, 0),
        ),
        SpatialRevolute(name="C", **hinge, point_i=(2, 0, 0), body_j="rocker"),
    )
    turn = (math.cos(1.3), 0.0, 0.0, math.sin(1.3))
    at = {"crank": (0, 0, 0, *turn), "rod": (math.cos(2.6), math.sin(2.6), 0, 1, 0, 0, 0), "rocker": (2, 0, 0, *turn)}
    bodies = tuple(Body(name=name, estimate=q) for name, q in at.items())
    motor = SpatialAngleDriver(name="motor", joint="O", law=Polynomial(coefficients=(2.6, 1.0)))
    return Scene(mechanism=Mechanism(bodies, joints, (motor,)), times=(0.0, 1.2))


def test_a_path_stops_where_two_rows_depend_at_once_and_tangents_are_not_decided():
    """Flat, the rod may spin, too: no sign changes, and the path went on as if nothing were there."""
    path = refkin.follow(of_space(2.0))

    assert (path.end, path.events) == (TraceEnd.STOPPED, ())
    assert path.t[-1] == pytest.approx(math.pi - 2.6, abs=1e-12)
    assert "how paths go on beside a singular pose is not decided" in path.message


def test_a_path_does_not_step_onto_a_curve_that_passes_by_where_two_signs_change_at_once():
    """A rod that is longer by 1e-6 folds the other way; one that is shorter is in line with the rocker before that."""
    path = refkin.follow(of_space(2.0 + 1e-6))
    rocker = 2.0 * np.arctan2(path.q[20], path.q[17])
    (change,) = refkin.follow(of_space(2.0 - 1e-6)).bifurcations

    assert (path.end, path.events) == (TraceEnd.RANGE, ())
    assert rocker[-1] == pytest.approx(2.9148, abs=1e-4)
    assert change.t == pytest.approx(math.acos((5.0 - (3.0 - 1e-6) ** 2) / 4.0) - 2.6, abs=1e-9)
    assert len(change.tangents) == 2
