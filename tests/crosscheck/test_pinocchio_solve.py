"""Pinocchio's joint trees against closed forms of linkages that have one."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import replace
from typing import Any

import numpy as np
import pinocchio as pin
import pytest

from crosscheck.engines import march
from crosscheck.engines.pinocchio.engine import Pinocchio
from crosscheck.engines.pinocchio.rows import Rows
from crosscheck.engines.poses import Tabulated
from crosscheck.engines.tree.joint_tree import JointTree, joint_tree
from crosscheck.engines.tree.tree_system import TreeSystem
from crosscheck.scenes.drawing import draw
from refkin.joints import GROUND, Fixed, XDriver
from refkin.model import Body, Effect, Mechanism, Scene
from refkin.motion import Status
from refkin.motion_laws import Polynomial
from tests.refkin.test_sweep import twice

from .exact_linkages import EPS, Case, cylinder, excess, four_bar, lifted_end, scotch_yoke, slider_crank

NEARLY_FLAT = (1.0, 2.5, 2.0, 1.5 + 1e-6)
"""A crank-rocker with a slack of 1e-6: when crank and ground line up, its branches pass each other at some 1e-3 rad."""


def twin(case: Case) -> Case:
    """Return a four-bar with a second coupler and rocker, each a copy of the first, on the same crank."""
    rows = {**case.rows, **{f"{name} 2": case.rows[name] for name in ("coupler", "rocker")}}
    return replace(case, scene=twice(case.scene), rows=rows)


@pytest.mark.parametrize("branch", [1, -1])
@pytest.mark.parametrize("double", [False, True], ids=["one loop", "two loops"])
def test_it_stays_on_its_branch_where_another_is_close(branch: int, double: bool) -> None:
    case = four_bar(branch=branch, lengths=NEARLY_FLAT)
    case = twin(case) if double else case

    assert excess(case, Pinocchio().solve(case.scene)) <= 1.0


def test_contraction_alone_would_not_hold_it_there(monkeypatch: pytest.MonkeyPatch) -> None:
    """Shows that the test before can fail."""
    monkeypatch.setattr(march, "connected", lambda inverse, other, off=0.0: np.ones(len(other), bool))
    cases = [four_bar(branch=branch, lengths=NEARLY_FLAT) for branch in (1, -1)]

    assert max(excess(case, Pinocchio().solve(case.scene)) for case in cases) > 1e6


@pytest.mark.parametrize(("size", "at"), [(2.0**-30, 0j), (2.0**30, 0j), (1.0, 1e6 - 2e6j), (2.0**-10, 1024 - 2048j)])
def test_neither_scale_nor_distance_from_the_origin_costs_digits(size: float, at: complex) -> None:
    """The ground points are doubles here; what is rounded far away is a coordinate when it is handed over."""
    case = four_bar(size=size, at=at)

    assert excess(case, Pinocchio().solve(case.scene)) <= 1.0


def test_only_what_is_called_for_is_computed(monkeypatch: pytest.MonkeyPatch) -> None:
    """Without the acceleration of any point or joint being asked of Pinocchio."""
    monkeypatch.setattr(pin, "getFrameClassicalAcceleration", None)
    monkeypatch.setattr(Rows, "drift", None)
    motion = Pinocchio().solve(four_bar(effects=frozenset({Effect.VELOCITY})).scene)

    assert (motion.verdict, motion.qdd) == (Status.OK, None)


def short_rod(stop: float) -> Scene:
    """A slider pulled by its driver from x = 3.2 to `stop`; crank 1 and rod 3 are stretched at x = 4."""
    scene = slider_crank().scene
    joints = tuple(
        replace(j, point_i=(0.0, 0.0)) if j.name == "G" else j for j in scene.mechanism.joints
    )  # no offset: stretched at 4 exactly
    theta = math.acos((3.2**2 + 1.0 - 9.0) / 6.4)
    phi = math.atan2(-math.sin(theta), 3.2 - math.cos(theta))
    start = {"crank": (0.0, 0.0, theta), "rod": (math.cos(theta), math.sin(theta), phi), "slider": (3.2, -0.5, 0.0)}
    bodies = tuple(replace(b, estimate=start[b.name]) for b in scene.mechanism.bodies)
    pull = XDriver(name="pull", body="slider", law=Polynomial(coefficients=(3.2, 1.0)))
    return replace(scene, mechanism=Mechanism(bodies, joints, (pull,)), times=(0.0, 0.4, stop - 3.2))


def test_what_does_not_assemble_has_no_answer() -> None:
    motion = Pinocchio().solve(short_rod(4.0 + 1e-9))

    assert motion.status == (Status.OK, Status.OK, Status.NOT_CONVERGED)
    assert np.isnan(motion.q[:, 2]).all()
    assert np.isnan(motion.qd[:, 2]).all()


def test_a_dead_centre_has_a_position_and_no_rates() -> None:
    """Where the residual is at round-off, the angle is known to the root of it: 16 * 9 EPS gives 2e-7."""
    motion = Pinocchio().solve(short_rod(4.0))

    assert motion.status == (Status.OK, Status.OK, Status.SINGULAR)
    assert abs(motion["crank"].phi[2]) <= 2e-7
    assert np.isnan(motion.qd[:, 2]).all()


def test_bodies_that_cannot_move_are_placed() -> None:
    """A model without a single coordinate, whose frame Jacobian ends Pinocchio's process."""
    weld = Fixed(name="W", body_i=GROUND, point_i=(1.0, 2.0), body_j="a", point_j=(0.5, 0.0), angle=math.pi / 2)
    scene = Scene(mechanism=Mechanism((Body(name="a", estimate=(0.0, 0.0, 0.0)),), (weld,)), times=(0.0,))
    motion = Pinocchio().solve(scene)

    assert motion.q[:, 0] == pytest.approx([1.0, 1.5, math.pi / 2], abs=EPS)


# ---- planted faults: each replaces a piece of the adapter or of what it reads, and must not go unseen


def of_law(order: int) -> Callable[[Any], Any]:
    """Return the replacement that forgets one derivative of the laws."""
    return lambda f: lambda self, t, k: 0.0 * t if k == order else f(self, t, k)


def long_coupler(f: Any) -> Any:
    """Return the replacement that moves the far pin of the coupler by 1e-9."""
    return lambda self, body, u: f(self, body, (u[0] + (1e-9 if body == "coupler" and u[0] > 0 else 0.0), u[1]))


def other_branch(f: Any) -> Any:
    """Return the replacement that starts a four-bar on its crossed branch."""
    crossed = joint_tree(four_bar(branch=-1).scene.mechanism)
    return lambda self: f(crossed if "coupler" in self.estimates else self)


FAULTS: dict[str, tuple[Any, str, Callable[[Any], Any]]] = {
    "gamma forgotten": (Rows, "drift", lambda f: lambda *a: [0.0 * part for part in f(*a)]),
    "sign of nu": (TreeSystem, "nu", lambda f: lambda *a: -f(*a)),
    "driver rate forgotten": (Tabulated, "__call__", of_law(1)),
    "driver acceleration forgotten": (Tabulated, "__call__", of_law(2)),
    "drift of points forgotten": (Rows, "drift", lambda f: lambda *a: [*f(*a)[:-1], 0.0 * f(*a)[-1]]),
    "a length off by 1e-9": (JointTree, "scaled", long_coupler),
    "other branch": (JointTree, "start", other_branch),
}


@pytest.mark.parametrize("name", FAULTS)
def test_a_planted_fault_is_seen(name: str, monkeypatch: pytest.MonkeyPatch) -> None:
    cases = (four_bar(), slider_crank(), scotch_yoke(), cylinder(), lifted_end("x"))
    healthy = max(excess(case, Pinocchio().solve(case.scene)) for case in cases)
    owner, attribute, plant = FAULTS[name]
    monkeypatch.setattr(owner, attribute, plant(getattr(owner, attribute)))

    assert healthy <= 1.0 < max(excess(case, Pinocchio().solve(case.scene)) for case in cases)


def test_a_pose_just_before_the_end_of_a_branch_is_found_where_the_end_was_guessed_wrong() -> None:
    """A cubic towards a wrong end fails at the same time from however near, where the tangent goes on."""
    scene = draw(777001, 149).scene
    engine = Pinocchio()

    assert set(engine.solve(scene, engine.routes()[0]).status) == {Status.OK}
