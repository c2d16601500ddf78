"""What of MuJoCo is no other engine's: its log, scale by bits, its origin and its drift term."""

from __future__ import annotations

import math
from dataclasses import replace
from pathlib import Path

import mujoco
import numpy as np
import pytest

from crosscheck.engines import Level
from crosscheck.engines.mujoco.engine import Mujoco, TreeRows
from crosscheck.engines.mujoco.model import Plan
from crosscheck.engines.mujoco.rows import MujocoRows
from crosscheck.engines.tree.joint_tree import joint_tree
from crosscheck.measure.check import check
from refkin.joints import GROUND, AngleDriver, Distance, Fixed, Prismatic, Revolute, XDriver
from refkin.model import Body, Effect, Mechanism, Point, Scene
from refkin.motion_laws import Polynomial
from refkin.system import compile_system

from .exact_linkages import four_bar
from .loose_rows import KINDS, ROWS, U, configurations, loose_scene, rows_of


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


def test_a_tree_without_open_loops_has_no_rows_of_mujoco() -> None:
    rows = TreeRows(replace(joint_tree(four_bar().scene.mechanism), closures=()))
    q = np.zeros((3, rows.tree.width))
    residual, jacobian, *_ = rows.closure(q, [])

    assert (residual.shape, jacobian.shape) == ((3, 0), (3, 0, rows.tree.width))


@pytest.mark.parametrize("level", ROWS)
@pytest.mark.parametrize("kind", KINDS["mujoco"])
@pytest.mark.parametrize("power", [-30, 30])
def test_rows_of_a_mechanism_scaled_by_a_power_of_two_are_the_same_to_the_last_bit(
    kind: str, level: Level, power: int
) -> None:
    size = 2.0**power
    q, qd, t = next(configurations(1))
    metres = np.array([size, size, 1.0] * 2)
    answers = [
        rows_of(Mujoco().constraints(loose_scene(kind)), level, q, qd, t),
        rows_of(Mujoco().constraints(loose_scene(kind, size=size)), level, q * metres, qd * metres, t),
    ]
    if level is Level.JACOBIAN:
        answers[1] = answers[1] * metres

    ratio = np.unique(answers[1][answers[0] != 0.0] / answers[0][answers[0] != 0.0])

    assert set(ratio) <= {1.0, size, size**2}


def test_a_joint_point_nearer_to_its_body_s_origin_than_1e_6_is_not_taken_for_the_origin() -> None:
    point = (3e-9, -1e-9)
    joints = (
        Revolute(name="far", body_i="ground", point_i=(1.0, 0.0), body_j="a", point_j=(1.0, 0.0)),
        Revolute(name="near", body_i="ground", point_i=(0.0, 0.0), body_j="a", point_j=point),
    )
    scene = Scene(mechanism=Mechanism((Body(name="a"),), joints), times=(0.0,))
    model = Mujoco().constraints(scene)
    near = [m.engine_row for m in model.rows if m.constraint == "near"]

    assert [0.0 + x for x in point] == pytest.approx(model.residual(np.zeros(3), 0.0)[near].tolist(), abs=4 * U)


def fast_and_slow() -> tuple[float, float]:
    """Return the error of the drift term of bodies that fly fast and turn slowly, and omega v + omega^2 r of them."""
    scene = loose_scene("revolute")
    system, model = compile_system(scene.mechanism), Mujoco().constraints(scene)
    worst, omega, speed = 0.0, 1e-3, 3.0
    for q, qd, t in configurations():
        rates = qd / 3.0 * [speed, speed, omega, speed, speed, omega]
        worst = max(worst, float(np.abs(model.drift(q, rates, t) - system.gamma(q, rates, t)).max()))
    return worst, omega * (speed + omega * 3.0)


def test_drift_of_fast_bodies_that_turn_slowly_errs_no_more_than_declared() -> None:
    worst, convective = fast_and_slow()
    (term,) = (t for t in Mujoco().terms(loose_scene("revolute")) if t.level == Level.DRIFT)

    assert worst <= term.relative * convective


def test_the_declared_term_of_the_drift_is_needed() -> None:
    worst, _ = fast_and_slow()
    arms = 2.0 * math.sqrt(2.0) * 1e-6  # omega^2 r of both arms: what the formula itself adds

    assert worst > 20.0 * U * arms


def test_lengths_have_their_drift_where_mujoco_leaves_out_one_that_no_joint_can_move() -> None:
    """A lever of 1 at 0 rad, turning; its end is held from (2, 1), and from where it is: there it has no direction."""
    omega, at_ends = 1.5, [("plate", (2.0, 1.0)), ("lever", (2.0, 1.0)), ("lever", (1.0, 0.0))]
    lengths = (
        Distance(name=f"{k}", body_i="ground", point_i=at, body_j=body, point_j=(1.0, 0.0), length=1.0)
        for k, (body, at) in enumerate(at_ends)
    )
    ends = {"body_i": "ground", "point_i": (0.0, 0.0), "point_j": (0.0, 0.0)}
    joints = (Fixed(name="base", body_j="plate", **ends), Revolute(name="pivot", body_j="lever", **ends), *lengths)
    tree = joint_tree(Mechanism((Body(name="plate"), Body(name="lever")), joints))
    rate, drift = MujocoRows(Plan(tree, tree.closures)).rates(np.zeros((1, 1)), np.full((1, 1), omega))[:2]
    length = math.sqrt(2.0)

    assert tree.size * rate[0] == pytest.approx([0.0, -omega / length, 0.0], abs=16 * U)
    assert tree.size * drift[0] == pytest.approx([0.0, -1.5 * omega**2 / length, math.nan], abs=64 * U, nan_ok=True)
