"""Checks of the analysis: branches, rates in batches, units, what was not called for."""

from __future__ import annotations

import math
from dataclasses import replace
from itertools import product

import numpy as np
import pytest

from refkin.analysis import acceleration, position, velocity
from refkin.differences import Scheme, jacobian
from refkin.errors import NotCalledFor
from refkin.joints import AngleDriver, XDriver, YDriver
from refkin.model import Body, Mechanism
from refkin.motion import Status
from refkin.motion_laws import Polynomial
from refkin.scenes.linkages import FourBar
from refkin.solving.mobility import row_names
from refkin.solving.solve import solve
from refkin.system import compile_system
from tests.claims import U, assert_near
from tests.linkages import ROCKER

LAW = Polynomial(coefficients=(0.4, 1.3, -0.7, 0.2))
TIMES = (0.0, 0.35, 0.9)


BOTH_TURN = FourBar(ground=1.0, crank=4.0, coupler=3.5, rocker=3.0)
NEAR_CHANGE_POINT = FourBar(ground=4.0, crank=1.0, coupler=3.5, rocker=1.5 + 1e-8)


def test_a_coarse_sweep_stays_on_its_branch():
    """Nine times in two turns, or in seven, give poses of one branch, also where the branches come near each other.

    With a slack of 1e-8 they come within 1e-4: there an angle moves by 1e4 times what the crank's does, whose 1e-15
    are rounding.
    """
    coarse = ((ROCKER, 2), (FourBar(4.0, 1.0, 3.5, 1.55), 2), (ROCKER, 7), (BOTH_TURN, 7))
    cases = [(*case, 9, 1e-12) for case in coarse] + [(NEAR_CHANGE_POINT, 1, 13, 1e-9)]
    for (linkage, turns, samples, allowed), branch in product(cases, ("open", "crossed")):
        motion = solve(linkage.scene(turns=turns, samples=samples, branch=branch))
        assert motion.verdict is Status.OK, f"{linkage} {branch}: {motion.verdict}"
        for k, phi in enumerate(motion["crank"].phi):
            expected = linkage.assemble(float(phi), branch)["rocker"][2]
            off = abs(math.remainder(motion["rocker"].phi[k] - expected, math.tau))
            assert off < allowed, f"{linkage} {branch}: the rocker is off by {off} at {phi}"


def test_what_is_not_called_for_is_refused_by_name():
    """A system compiled without velocity refuses it by name."""
    scene = ROCKER.scene(samples=3)
    bare = compile_system(scene.mechanism, frozenset())
    at = np.zeros(9)
    with pytest.raises(NotCalledFor, match="'velocity' was not"):
        bare.nu(at, 0.0)
    with pytest.raises(NotCalledFor):
        bare.gamma(at, at, 0.0)


def test_linear_systems_are_solved_in_batches():
    """Rates solve phi_q qd = nu and phi_q qdd = gamma, at one pose or many, with redundant rows or without."""
    scene = ROCKER.scene(law=LAW, times=TIMES)
    twice = replace(scene.mechanism, joints=(*scene.mechanism.joints, replace(scene.mechanism.joints[0], name="again")))
    motion = solve(scene)
    for mechanism in (scene.mechanism, twice):
        system = compile_system(mechanism)
        q = motion.q
        qd, t = velocity(system, q, motion.t), motion.t
        qdd = acceleration(system, q, qd, t)
        for k in range(len(t)):
            slope = system.phi_q(q[:, k], t[k])
            assert_near(slope @ qd[:, k], system.nu(q[:, k], t[k]), 256 * U, "phi_q qd = nu")
            right = system.gamma(q[:, k], qd[:, k], t[k])
            assert_near(slope @ qdd[:, k], right, 2048 * U, "phi_q qdd = gamma")
            assert_near(velocity(system, q[:, k], t[k]), qd[:, k], 256 * U, "one pose")
    start = motion.q[:, 0] + 0.05
    pose = position(compile_system(scene.mechanism), start, 0.0)
    assert_near(pose.q, motion.q[:, 0], 1024 * U, "position from an estimate")


def test_coordinates_sit_where_they_are_said_to():
    """Columns of phi_q belong to the bodies in their order, with units there and back, and a row for each name."""
    law = Polynomial(coefficients=(0.0,))
    bodies = (Body(name="a"), Body(name="b"))
    drivers = tuple(
        kind(name=f"{kind.__name__}{b.name}", body=b.name, law=law)
        for b in bodies
        for kind in (XDriver, YDriver, AngleDriver)
    )
    system = compile_system(Mechanism(bodies, (), drivers))
    assert_near(system.phi_q(np.zeros(6), 0.0), np.eye(6), 0.0, "phi_q")
    assert (system.columns("b").start, len(row_names(system))) == (3, 6), f"{system.columns('b')} {row_names(system)}"
    q = np.random.default_rng(2).normal(size=6)
    scaled = compile_system(ROCKER.scene(samples=2).mechanism, unit=replace(system.unit, size=4.0, origin=(1.0, -2.0)))
    for order in range(3):
        there = scaled.to_unit(np.r_[q, q[:3]], order)
        shift = np.array([1.0, -2.0]) if order == 0 else np.zeros(2)
        assert_near(there[:2], (q[:2] - shift) / 4.0, 0.0, f"order {order}")
        assert there[2] == q[2], "an angle was scaled"
        assert_near(scaled.to_physical(there, order)[:6], q, 2 * U * np.abs(q) + 2 * U, f"order {order} there and back")
    exact = jacobian(lambda x: scaled.phi(x, 0.0), np.r_[q, q[:3]], Scheme.COMPLEX_STEP)
    assert_near(scaled.phi_q(np.r_[q, q[:3]], 0.0), exact, 16 * U, "phi_q in another unit")
