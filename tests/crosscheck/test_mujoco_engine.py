"""The motions of MuJoCo's joint trees against closed forms; what the adapter reports, refuses and must not hide."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import mujoco
import numpy as np
import pytest

from crosscheck.engines import EngineError, load
from crosscheck.engines.mujoco.engine import NEWTON, Mujoco, TreeRows
from crosscheck.engines.mujoco.model import Plan
from crosscheck.engines.mujoco.rows import MujocoRows
from crosscheck.engines.tree.joint_tree import joint_tree
from crosscheck.engines.tree.tree_system import TreeSystem
from refkin.model import Effect, Point, Scene
from refkin.motion import Seeding, Status

from .exact_linkages import CASES, T, excess, four_bar, turned_on


@pytest.mark.parametrize("name", CASES)
def test_the_joint_tree_moves_as_the_closed_form(name: str) -> None:
    case = CASES[name]()

    assert excess(case, Mujoco().solve(case.scene)) <= 1.0


def test_a_four_bar_far_from_the_origin_is_solved_as_exactly_as_one_near_it() -> None:
    case = four_bar(at=2.0**30 + 2.0**29 * 1j)

    assert excess(case, Mujoco().solve(case.scene)) <= 1.0


def test_phi_keeps_the_turns_of_the_estimate() -> None:
    case = turned_on(four_bar(), 5)

    assert excess(case, Mujoco().solve(case.scene)) <= 1.0


def test_phi_of_a_full_turn_runs_on_without_a_jump() -> None:
    motion = Mujoco().solve(four_bar().scene)

    assert np.abs(np.diff(motion["crank"].phi)).max() < 0.2


# ---- what is called for, and what is refused


@pytest.mark.parametrize(
    ("effects", "given"),
    [(set(), (False, False)), ({Effect.VELOCITY}, (True, False)), ({Effect.ACCELERATION}, (False, True))],
    ids=["position", "velocity", "acceleration alone"],
)
def test_only_the_levels_called_for_are_reported(effects: set[Effect], given: tuple[bool, bool]) -> None:
    motion = Mujoco().solve(four_bar(effects=frozenset(effects)).scene)

    assert given == (motion.qd is not None, motion.qdd is not None)


def test_accelerations_are_right_where_velocities_are_not_called_for() -> None:
    case = four_bar(effects=frozenset({Effect.ACCELERATION}))

    assert excess(case, Mujoco().solve(case.scene)) <= 1.0


def test_only_the_bodies_wanted_are_reported() -> None:
    motion = Mujoco().solve(four_bar(bodies_wanted=("rocker",)).scene)

    assert (("rocker",), (3, len(T))) == (motion.bodies, motion.q.shape)


def test_a_wanted_point_moves_as_the_pin_it_lies_on() -> None:
    case = four_bar(points=(Point(name="B", body="coupler", position=(1.75, -0.25)),))
    motion = Mujoco().solve(case.scene)
    x, y, phi = case.rows["rocker"][0]
    pin_b = x + 1j * y + np.exp(1j * phi) * 1.5

    assert np.abs(motion.points["B"].r - [pin_b.real, pin_b.imag]).max() <= 1e-14


def test_without_an_estimate_the_scene_is_refused_and_the_body_named() -> None:
    scene = four_bar().scene
    bodies = tuple(replace(b, estimate=None) if b.name == "coupler" else b for b in scene.mechanism.bodies)

    with pytest.raises(EngineError, match="coupler"):
        Mujoco().solve(replace(scene, mechanism=replace(scene.mechanism, bodies=bodies)))


def test_an_unknown_route_is_refused_by_name() -> None:
    with pytest.raises(EngineError, match="'dynamics'"):
        Mujoco().solve(four_bar().scene, replace(NEWTON, name="dynamics"))


def test_the_route_says_who_did_what() -> None:
    route = Mujoco().solve(four_bar().scene).producer.route

    assert (route.residual_by, route.newton_by, route.seeding) == ("mujoco", "adapter", Seeding.INITIAL_GUESS)


def test_the_engine_is_found_by_its_name() -> None:
    assert isinstance(load("mujoco"), Mujoco)


# ---- where there is no answer


def open_four_bar() -> Scene:
    """Return the four-bar with a coupler that is too long to meet the rocker at any crank angle."""
    scene = four_bar().scene
    joints = tuple(replace(j, point_j=(7.75, -0.25)) if j.name == "B" else j for j in scene.mechanism.joints)
    return replace(scene, mechanism=replace(scene.mechanism, joints=joints))


def test_a_linkage_that_cannot_close_is_not_converged() -> None:
    motion = Mujoco().solve(open_four_bar())

    assert {Status.NOT_CONVERGED} == set(motion.status)


def test_where_there_is_no_answer_every_number_is_nan() -> None:
    motion = Mujoco().solve(open_four_bar())

    assert all(np.isnan(level).all() for level in motion.levels if level is not None)


def test_mujoco_leaves_no_log_behind_when_it_warns(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(tmp_path)
    rows = MujocoRows(Plan(joint_tree(four_bar().scene.mechanism), ()))
    rows.data.qpos[:] = np.nan
    mujoco.mj_step(rows.model, rows.data)
    warned = sum(w.number for w in rows.data.warning)

    assert (warned > 0, list(tmp_path.iterdir())) == (True, [])


# ---- planted faults: the checks above must turn red


def test_the_other_assembly_is_not_taken_for_the_one_that_was_asked_for() -> None:
    assert excess(four_bar(), Mujoco().solve(four_bar(branch=-1).scene)) > 1.0


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
