"""Near folds, between branches, without a root, with redundant rows: what is isolated, and what must not be."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import numpy as np
import pytest
from flint import arb, arb_mat, ctx

from refkin.analysis import acceleration, velocity
from refkin.joints import GROUND, AngleDriver, Prismatic, Revolute, XDriver
from refkin.model import Body, Mechanism
from refkin.motion_laws import Polynomial
from refkin.proof.numbers.exact import exact_system
from refkin.proof.numbers.inputs import half_ulp
from refkin.proof.pose.certificate import Certificate, certify, unique_within
from refkin.proof.pose.isolate import isolate
from refkin.proof.pose.krawczyk import column, objects
from refkin.system import System, compile_system
from tests.drawn import Drawn

from .test_redundant import ring
from .test_sweep import three_cranks

# A bar on a pivot, the x of its tip given: x = cos phi, with the roots +-phi, which meet at x = 1.


def bar(x: float, far: float = 0.0) -> System:
    tip = XDriver(name="tip", body="bar", point=(far + 1.0, 0.0), law=Polynomial(coefficients=(x,)))
    pivot = Revolute(name="pivot", body_i=GROUND, point_i=(0.0, 0.0), body_j="bar", point_j=(far, 0.0))
    mechanism = Mechanism((Body(name="bar"),), (pivot,), (tip,))
    return compile_system(mechanism, unit=mechanism.unit())


def at_angle(phi: float) -> Any:
    return np.array([[0.0], [0.0], [phi]])


@pytest.mark.parametrize("k", range(2, 53, 5))
def test_towards_a_fold_the_pose_stays_certified(k: int) -> None:
    assert certify(bar(1 - 2.0**-k), at_angle(2 * np.arcsin(np.sqrt(2.0 ** -(k + 1)))), [0.0]).ok[0]


@pytest.mark.parametrize("k", range(2, 53, 5))
def test_the_uniqueness_radius_does_not_reach_the_other_branch(k: int) -> None:
    phi = 2 * np.arcsin(np.sqrt(2.0 ** -(k + 1)))
    system = bar(1 - 2.0**-k)
    proof = certify(system, at_angle(phi), [0.0])
    unique = unique_within(system, proof.rows, at_angle(phi), [0.0], proof.position)[0]
    assert phi / 2 < unique <= 2 * phi


@pytest.mark.parametrize("phi", [0.0, 1e-12, 1e-8, 1e-4])
def test_a_double_root_is_never_isolated(phi: float) -> None:
    assert not isolate(bar(1.0), at_angle(phi), [0.0]).ok[0]


@pytest.mark.parametrize("phi", [0.0, 1e-12, 1e-8, 1e-4, 1.0])
def test_what_cannot_be_assembled_has_no_proof_of_a_pose(phi: float) -> None:
    assert not isolate(bar(1 + 2.0**-40), at_angle(phi), [0.0]).ok[0]


@pytest.mark.parametrize("part", [-0.5, -0.1, 0.1, 0.2])
def test_an_answer_between_two_branches_is_not_isolated(part: float) -> None:
    phi = 2 * np.arcsin(np.sqrt(2.0**-21))
    assert not isolate(bar(1 - 2.0**-20), at_angle(part * phi), [0.0]).ok[0]


def test_what_is_said_to_be_unique_is_the_box_that_balls_prove_and_no_more(monkeypatch: Any) -> None:
    """Float64 is made to prove nothing: balls take a box that holds the answer and leaves the other branch out."""
    phi, off = 0.5, 1e-3
    monkeypatch.setattr("refkin.proof.pose.isolate.certify", lambda *args, **_: nothing_of(certify(*args)))
    isolation = isolate(bar(float(np.cos(phi))), at_angle(phi + off), [0.0])

    assert isolation.ok[0]
    assert isolation.position[0] == pytest.approx(off, rel=1e-6, abs=0.0)
    assert isolation.enclosures[0].radii[2] == pytest.approx(off, rel=1e-6, abs=0.0)


def nothing_of(proof: Certificate) -> Certificate:
    """Return a certificate of nothing."""
    return replace(proof, ok=np.zeros(len(proof.ok), bool), radii=proof.radii * np.nan)


def test_balls_take_over_where_float64_proves_nothing() -> None:
    d = Drawn(np.random.default_rng(6), "crank", "coupler", "rocker")
    d.pose["coupler"] = (1e8 + 1e8j, 0.3)  # its own origin far from its joints: every product loses eight digits
    for i, j in ((GROUND, "crank"), ("crank", "coupler"), ("coupler", "rocker"), (GROUND, "rocker")):
        d.pin(i, j)
    d.drivers.append(AngleDriver(name="motor", body="crank", law=Polynomial(coefficients=(d.pose["crank"][1],))))
    system, start = d.system()
    with ctx.workprec(200):
        exact, root = exact_system(system, 200), objects([arb(x) for x in start.tolist()])
        for _ in range(8):
            slope = arb_mat(exact.phi_q(root, arb(0)).tolist())
            correction = slope.solve(column(exact.phi(root, arb(0)))).entries()
            root = objects([(x - dx).mid() for x, dx in zip(root, correction, strict=True)])
    q = np.array([[float(x)] for x in root])
    assert not certify(system, q, [0.0]).ok[0]
    isolation = isolate(system, q, [0.0])
    assert (isolation.ok[0], isolation.bits[0]) == (True, 113)
    assert isolation.position[0] <= np.max(half_ulp(system, q)) * (1 + 1e-9)


@pytest.mark.parametrize(("far", "bits"), [(60.0, 53), (70.0, 113)])
def test_balls_take_over_where_a_frame_is_far_from_its_joints(far: float, bits: int) -> None:
    """Float64 proves the pose as well, with a bound that is up to five times as wide before 640 sizes."""
    q = np.array([[-far * np.cos(0.5)], [-far * np.sin(0.5)], [0.5]])

    assert isolate(bar(float(np.cos(0.5)), far), q, [0.0]).bits == [bits]


@pytest.mark.parametrize("off", [0.8, 0.9, 1.1, 1.2, 1.23])
@pytest.mark.parametrize("far", [0.0, 2.0**23])
def test_beside_a_fold_a_root_is_known_and_its_own_however_far_off_and_wherever_the_frame_is(far, off) -> None:
    """One of a wide box was left as wide, and rates had no digits; a frame far away made a hair a long way."""
    system, phi = bar(1 - 2.0**-50, far), 2 * np.arcsin(np.sqrt(2.0**-51))
    turned = off * phi
    proof = isolate(system, [[-far * np.cos(turned)], [-far * np.sin(turned)], [turned]], [0.0])

    assert proof.ok[0]
    assert max(float(x.rad()) for x in proof.enclosures[0].q) < 1e-15
    assert proof.enclosures[0].with_rates(2)[2]


def test_one_bad_sample_spoils_no_other() -> None:
    q = np.concatenate([at_angle(phi) for phi in (1.0, 0.0, np.nan, 1e300, -1.0)], axis=1)
    assert certify(bar(float(np.cos(1.0))), q, np.zeros(5)).ok.tolist() == [True, False, False, False, True]


def at_estimates(mechanism: Mechanism) -> tuple[System, Any]:
    """Return the system of a mechanism and the pose (n, 1) that its bodies are estimated at."""
    system = compile_system(mechanism, unit=mechanism.unit())
    return system, system.to_unit(np.concatenate([body.estimate for body in mechanism.bodies])[:, None])


def test_a_redundant_mechanism_is_certified_on_independent_rows() -> None:
    """Its driver moves; that its lengths and pins are rounded explains what redundant rows miss, at every level."""
    system, q = at_estimates(three_cranks(0.0).mechanism)
    isolation = isolate(system, q, [0.0])
    assert (system.m, system.n, isolation.ok[0], isolation.contradiction.max() < 1) == (13, 12, True, True)
    qd = velocity(system, q, np.zeros(1))
    assert isolate(system, q, [0.0], qd, acceleration(system, q, qd, np.zeros(1))).contradiction.max() < 1


@pytest.mark.parametrize("off", [1e-3, 1e-9, 1e-12])
def test_redundant_rows_that_contradict_each_other_are_seen(off: float) -> None:
    system, q = at_estimates(three_cranks(0.0, off).mechanism)
    assert isolate(system, q, [0.0]).contradiction.max() > 1


@pytest.mark.parametrize(("count", "explained"), [(3, False), (4, True)])
def test_rows_that_share_a_pose_but_no_velocity_contradict_each_other(count: int, explained: bool) -> None:
    """Three wheels in a ring lock each other, four do not; either way all rows hold at the first pose."""
    system, q = at_estimates(ring(count))
    isolation = isolate(system, q, [0.0], velocity(system, q, np.zeros(1)))
    assert isolate(system, q, [0.0]).contradiction.max() <= 1
    assert bool(isolation.contradiction.max() <= 1) is explained


def test_rows_that_share_pose_and_velocity_but_no_acceleration_contradict_each_other() -> None:
    """A slider that follows t^2 and is kept at rest: at t = 0 only the accelerations differ."""
    guide = Prismatic(name="g", body_i=GROUND, point_i=(0.0, 0.0), axis_i=(1.0, 0.0), body_j="s", point_j=(0.0, 0.0))
    still = XDriver(name="still", body="s", law=Polynomial(coefficients=(0.0,)))
    moved = XDriver(name="moved", body="s", law=Polynomial(coefficients=(0.0, 0.0, 1.0)))
    mechanism = Mechanism((Body(name="s"),), (guide,), (still, moved))
    system, q = compile_system(mechanism, unit=mechanism.unit()), np.zeros((3, 1))
    qd = velocity(system, q, np.zeros(1))
    assert isolate(system, q, [0.0], qd).contradiction.max() <= 1
    assert isolate(system, q, [0.0], qd, acceleration(system, q, qd, np.zeros(1))).contradiction.max() > 1
