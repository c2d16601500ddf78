"""What of MuJoCo's joint trees is no other engine's: its log, and faults planted in its rows."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import mujoco
import numpy as np
import pytest

from crosscheck.engines.mujoco.engine import Mujoco, TreeRows
from crosscheck.engines.mujoco.model import Plan
from crosscheck.engines.mujoco.rows import MujocoRows
from crosscheck.engines.tree.joint_tree import joint_tree
from crosscheck.engines.tree.tree_system import TreeSystem
from crosscheck.measure.check import check
from refkin.joints import GROUND, AngleDriver, Prismatic, Revolute, XDriver
from refkin.model import Body, Effect, Mechanism, Point, Scene
from refkin.motion_laws import Polynomial

from .exact_linkages import excess, four_bar


def test_mujoco_leaves_no_log_behind_when_it_warns(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(tmp_path)
    rows = MujocoRows(Plan(joint_tree(four_bar().scene.mechanism), ()))
    rows.data.qpos[:] = np.nan
    mujoco.mj_step(rows.model, rows.data)
    warned = sum(w.number for w in rows.data.warning)

    assert (warned > 0, list(tmp_path.iterdir())) == (True, [])


@pytest.mark.parametrize("far", [1e3, 1e6])
def test_a_point_of_an_arm_that_slid_far_keeps_the_digits_of_its_velocity(far: float) -> None:
    slide = Prismatic(name="p", body_i=GROUND, body_j="s", point_i=(0, 0), point_j=(0, 0), axis_i=(1, 0), angle=0)
    pin = Revolute(name="q", body_i="s", point_i=(1, 0), body_j="t", point_j=(0, 0))
    drivers = (
        XDriver(name="x", body="s", point=(0, 0), law=Polynomial(coefficients=(far, 1.0))),
        AngleDriver(name="a", body="t", law=Polynomial(coefficients=(0.2, 10.0))),
    )
    bodies = Body(name="s", estimate=(far, 0, 0)), Body(name="t", estimate=(far + 1, 0, 0.2))
    scene = Scene(
        name="slid far",
        mechanism=Mechanism(bodies=bodies, joints=(slide, pin), drivers=drivers),
        times=(0.0, 1.0, 2.0),
        effects=frozenset({Effect.VELOCITY, Effect.ACCELERATION}),
        points=(Point(name="p", body="t", position=(0.7, 0.1)),),
    )

    assert check(scene, ["mujoco"]).disagreements == []


# ---- planted faults: the checks above must turn red


def test_a_forgotten_rate_of_the_driver_is_seen_in_the_velocities(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(TreeSystem, "nu", lambda self, q, t: np.zeros((len(t), self.engine.closure_rows + 1)))

    assert not excess(four_bar(), Mujoco().solve(four_bar().scene)) <= 1.0


def test_a_missing_drift_term_of_the_loop_is_seen_in_the_accelerations(monkeypatch: pytest.MonkeyPatch) -> None:
    right = TreeRows.closure_drift
    monkeypatch.setattr(TreeRows, "closure_drift", lambda self, *at: [0.0 * part for part in right(self, *at)])

    assert excess(four_bar(), Mujoco().solve(four_bar().scene)) > 1.0


def test_a_tree_without_open_loops_has_no_rows_of_mujoco() -> None:
    rows = TreeRows(replace(joint_tree(four_bar().scene.mechanism), closures=()))
    q = np.zeros((3, rows.tree.width))
    residual, jacobian, *_ = rows.closure(q, [])

    assert (residual.shape, jacobian.shape) == ((3, 0), (3, 0, rows.tree.width))
