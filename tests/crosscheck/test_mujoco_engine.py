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

from .exact_linkages import excess, four_bar


def test_mujoco_leaves_no_log_behind_when_it_warns(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(tmp_path)
    rows = MujocoRows(Plan(joint_tree(four_bar().scene.mechanism), ()))
    rows.data.qpos[:] = np.nan
    mujoco.mj_step(rows.model, rows.data)
    warned = sum(w.number for w in rows.data.warning)

    assert (warned > 0, list(tmp_path.iterdir())) == (True, [])


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
