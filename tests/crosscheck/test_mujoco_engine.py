"""The motions of MuJoCo's joint trees against closed forms; what the adapter reports, refuses and must not hide."""

from __future__ import annotations

import cmath
import math
from dataclasses import replace
from pathlib import Path
from typing import Any

import mujoco
import numpy as np
import pytest

from crosscheck.engines import EngineError, load
from crosscheck.engines.mujoco.engine import NEWTON, Mujoco, TreeRows
from crosscheck.engines.mujoco.model import Plan
from crosscheck.engines.mujoco.rows import MujocoRows
from crosscheck.engines.tree.joint_tree import joint_tree
from crosscheck.engines.tree.tree_system import TreeSystem
from refkin.joints import AngleDriver, Constraint, Prismatic, Revolute
from refkin.model import Body, Effect, Mechanism, Point, Scene
from refkin.motion import Motion, Seeding, Status
from refkin.motion_laws import Polynomial

U = 2.0**-53
# Points of the plane are complex numbers; a path is a point with its velocity and acceleration.

CRANK, COUPLER, ROCKER, GROUND_LINK = 1.0, 3.5, 3.0, 4.0
ROD, OFFSET = 3.0, 0.4
GUIDE = (0.8, 0.6)
LAW = Polynomial(coefficients=(0.3, 2.0, -0.15))
TIMES = tuple(np.linspace(0.0, 4.0, 73).tolist())
PINS = {"crank": (-0.4 + 0.1j, 0.6 + 0.1j), "coupler": (-1.5 + 0.2j, 2.0 + 0.2j), "rocker": (0.1 - 0.3j, 3.1 - 0.3j)}
PINS["rod"] = (0.5j, ROD + 0.5j)
"""Where the pins of each link are in its body's frame: along its x axis."""
Path3 = tuple[complex, complex, complex]
REST: Path3 = (0j, 0j, 0j)


def dot(a: complex, b: complex) -> float:
    return (a.conjugate() * b).real


def crank_pin(t: float) -> Path3:
    phi, rate, change = (float(LAW(t, order)) for order in range(3))
    arm = CRANK * cmath.exp(1j * phi)
    return arm, 1j * rate * arm, (1j * change - rate**2) * arm


def meeting(at: complex, *conditions: tuple[complex, Path3, bool]) -> Path3:
    """Return the path of a point that keeps its distance to one path (True) or its place on a line with normal g."""
    (g, first, on_circle), (h, second, on_other) = conditions
    det = g.real * h.imag - g.imag * h.real

    def solve(p: float, q: float) -> complex:
        return complex(h.imag * p - g.imag * q, g.real * q - h.real * p) / det

    v = solve(dot(g, first[1]), dot(h, second[1]))
    p = dot(g, first[2]) - on_circle * abs(v - first[1]) ** 2
    q = dot(h, second[2]) - on_other * abs(v - second[1]) ** 2
    return at, v, solve(p, q)


def link_rows(pins: tuple[complex, complex], start: list[Path3], end: list[Path3]) -> list[Any]:
    """Return per level (x, y, phi) of a link between two paths, (3, T)."""
    (r, v, a), (s, w, b) = (np.array(path).T for path in (start, end))
    along = (s - r) / np.abs(s - r)
    phi = np.unwrap(np.angle(along))
    rate = (along.conj() * (w - v)).imag / np.abs(s - r)
    change = (along.conj() * (b - a)).imag / np.abs(s - r)
    arm = -along * pins[0]
    paths = (r + arm, v + 1j * rate * arm, a + (1j * change - rate**2) * arm)
    return [np.array([p.real, p.imag, turn]) for p, turn in zip(paths, (phi, rate, change), strict=True)]


def four_bar_rows(sign: float) -> dict[str, list[Any]]:
    """Return per body and level (x, y, phi) of the four-bar."""
    pivot, pivots, crank, joint = complex(GROUND_LINK), [], [], []
    for t in TIMES:
        b = crank_pin(t)
        gap = pivot - b[0]
        s = abs(gap)
        along = (s * s + COUPLER**2 - ROCKER**2) / (2.0 * s)
        c = b[0] + gap / s * complex(along, sign * math.sqrt(COUPLER**2 - along**2))
        fixed: Path3 = (pivot, 0j, 0j)
        joint.append(meeting(c, (c - b[0], b, True), (c - pivot, fixed, True)))
        crank.append(b)
        pivots.append(fixed)
    ends = {"crank": ([REST] * len(TIMES), crank), "coupler": (crank, joint), "rocker": (pivots, joint)}
    return {body: link_rows(PINS[body], *paths) for body, paths in ends.items()}


def slider_crank_rows() -> dict[str, list[Any]]:
    """Return per body and level (x, y, phi) of the slider-crank on its inclined guide; the slider keeps its angle."""
    guide = complex(*GUIDE)
    crank, wrist = [], []
    for t in TIMES:
        b = crank_pin(t)
        local = b[0] / guide
        c = guide * complex(local.real + math.sqrt(ROD**2 - (OFFSET - local.imag) ** 2), OFFSET)
        wrist.append(meeting(c, (c - b[0], b, True), (1j * guide, REST, False)))
        crank.append(b)
    rows = {
        "crank": link_rows(PINS["crank"], [REST] * len(TIMES), crank),
        "rod": link_rows(PINS["rod"], crank, wrist),
    }
    paths = np.array(wrist).T
    rows["slider"] = [np.array([p.real, p.imag, 0.0 * p.real]) for p in paths]
    return rows


def scene_of(
    rows: dict[str, list[Any]], joints: list[Constraint], origin: complex = 0j, turns: int = 0, **more: Any
) -> Scene:
    """Return the scene of a linkage that starts near its closed form; the frame lies at `origin`."""
    bodies = []
    for name, (q, _, _) in rows.items():
        x, y, phi = q[:, 0] + [origin.real + 0.02, origin.imag - 0.01, math.tau * turns + 0.01]
        bodies.append(Body(name=name, estimate=(float(x), float(y), float(phi))))
    law = replace(LAW, coefficients=(LAW.coefficients[0] + math.tau * turns, *LAW.coefficients[1:]))
    motor = AngleDriver(name="motor", body="crank", law=law)
    return Scene(mechanism=Mechanism(tuple(bodies), tuple(joints), (motor,)), times=TIMES, **more)


def pin(name: str, i: str, at_i: complex, j: str, at_j: complex) -> Revolute:
    return Revolute(name=name, body_i=i, point_i=pair(at_i), body_j=j, point_j=pair(at_j))


def pair(z: complex) -> tuple[float, float]:
    return z.real, z.imag


def four_bar(sign: float = 1.0, origin: complex = 0j, **more: Any) -> Scene:
    """Return the four-bar in one of its two assemblies."""
    joints: list[Constraint] = [
        pin("A0", "ground", origin, "crank", PINS["crank"][0]),
        pin("A", "crank", PINS["crank"][1], "coupler", PINS["coupler"][0]),
        pin("B", "rocker", PINS["rocker"][1], "coupler", PINS["coupler"][1]),
        pin("B0", "rocker", PINS["rocker"][0], "ground", origin + GROUND_LINK),
    ]
    return scene_of(four_bar_rows(sign), joints, origin, **more)


def slider_crank() -> Scene:
    """Return the slider-crank on its inclined guide."""
    base = complex(*GUIDE) * 1j * OFFSET
    slide = Prismatic(
        name="C0", body_i="ground", point_i=pair(base), axis_i=GUIDE, body_j="slider", point_j=(0.0, 0.0), angle=0.0
    )
    joints: list[Constraint] = [
        pin("A0", "ground", 0j, "crank", PINS["crank"][0]),
        pin("A", "crank", PINS["crank"][1], "rod", PINS["rod"][0]),
        pin("C", "rod", PINS["rod"][1], "slider", 0j),
        slide,
    ]
    return scene_of(slider_crank_rows(), joints)


# What rounding allows here, in metres, radians and seconds. Both linkages close with |sin mu| >= 0.8 over links of 1
# m to 3.5 m, turned at up to 2 rad/s and 5 rad/s^2. The closing point is computed down chains of two links: 2 * 2 *
# 18 roundings of arms up to 3.5 m, below 250 U; so an angle is off by 250 U / (3 * 0.8), about 100 U, and a frame 1.5
# m along by 400 U. Rates solve systems whose entries (3.5 m) are off by 3.5 * 100 U: 0.4 * 350 U * 2 * 2 rad/s for an
# angle, 1500 U for a frame. Accelerations add 2 * 2 rad/s * 600 U * 3.5 m in the drift term: 0.4 * 12000 U for an
# angle, 12000 U for a frame.
CLOSED = (400.0 * U, 1500.0 * U, 12000.0 * U)
ORDERS = pytest.mark.parametrize("order", [0, 1, 2], ids=["position", "velocity", "acceleration"])


def error(motion: Motion, rows: dict[str, list[Any]], order: int, shift: Any = 0.0) -> float:
    """Return the largest error of a level over all bodies and times; `shift` is added to the closed form's rows."""
    by_name = {body: (motion[body].q, motion[body].qd, motion[body].qdd)[order] for body in rows}
    return max(float(np.abs(by_name[body] - rows[body][order] - shift).max()) for body in rows)


@ORDERS
@pytest.mark.parametrize("sign", [1.0, -1.0], ids=["open", "crossed"])
def test_four_bar_moves_as_in_closed_form(sign: float, order: int) -> None:
    motion = Mujoco().solve(four_bar(sign))

    assert error(motion, four_bar_rows(sign), order) <= CLOSED[order]


@ORDERS
def test_offset_slider_crank_on_an_inclined_guide_moves_as_in_closed_form(order: int) -> None:
    motion = Mujoco().solve(slider_crank())

    assert error(motion, slider_crank_rows(), order) <= CLOSED[order]


def test_a_four_bar_far_from_the_origin_is_solved_as_exactly_as_one_near_it() -> None:
    origin = 2.0**30 + 2.0**29 * 1j  # exact in binary: what is left is the rounding of the answer itself
    motion = Mujoco().solve(four_bar(origin=origin))
    shift = np.array([[origin.real], [origin.imag], [0.0]])

    assert error(motion, four_bar_rows(1.0), 0, shift) <= abs(origin) * U + CLOSED[0]
    assert error(motion, four_bar_rows(1.0), 2) <= CLOSED[2]


def test_phi_keeps_the_turns_of_the_estimate() -> None:
    motion = Mujoco().solve(four_bar(turns=5))
    turns = [round(float((motion[b].phi - r[0][2]).min()) / math.tau) for b, r in four_bar_rows(1.0).items()]

    assert turns == [5, 5, 5]


def test_phi_of_a_full_turn_runs_on_without_a_jump() -> None:
    motion = Mujoco().solve(four_bar())

    assert np.abs(np.diff(motion["crank"].phi)).max() < 0.2


# ---- what is called for, and what is refused


@pytest.mark.parametrize(
    ("effects", "given"),
    [(set(), (False, False)), ({Effect.VELOCITY}, (True, False)), ({Effect.ACCELERATION}, (False, True))],
    ids=["position", "velocity", "acceleration alone"],
)
def test_only_the_levels_called_for_are_reported(effects: set[Effect], given: tuple[bool, bool]) -> None:
    motion = Mujoco().solve(four_bar(effects=frozenset(effects)))

    assert given == (motion.qd is not None, motion.qdd is not None)


def test_accelerations_are_right_where_velocities_are_not_called_for() -> None:
    motion = Mujoco().solve(four_bar(effects=frozenset({Effect.ACCELERATION})))

    assert error(motion, four_bar_rows(1.0), 2) <= CLOSED[2]


def test_only_the_bodies_wanted_are_reported() -> None:
    motion = Mujoco().solve(four_bar(bodies_wanted=("rocker",)))

    assert (("rocker",), (3, len(TIMES))) == (motion.bodies, motion.q.shape)


def test_a_wanted_point_moves_as_the_pin_it_lies_on() -> None:
    point = Point(name="B", body="coupler", position=pair(PINS["coupler"][1]))
    motion = Mujoco().solve(four_bar(points=(point,)))
    x, y, phi = four_bar_rows(1.0)["rocker"][0]
    pin_b = x + 1j * y + np.exp(1j * phi) * PINS["rocker"][1]

    assert np.abs(motion.points["B"].r - [pin_b.real, pin_b.imag]).max() <= CLOSED[0]


def test_without_an_estimate_the_scene_is_refused_and_the_body_named() -> None:
    scene = four_bar()
    bodies = tuple(replace(b, estimate=None) if b.name == "coupler" else b for b in scene.mechanism.bodies)

    with pytest.raises(EngineError, match="coupler"):
        Mujoco().solve(replace(scene, mechanism=replace(scene.mechanism, bodies=bodies)))


def test_an_unknown_route_is_refused_by_name() -> None:
    with pytest.raises(EngineError, match="'dynamics'"):
        Mujoco().solve(four_bar(), replace(NEWTON, name="dynamics"))


def test_the_route_says_who_did_what() -> None:
    route = Mujoco().solve(four_bar()).producer.route

    assert (route.residual_by, route.newton_by, route.seeding) == ("mujoco", "adapter", Seeding.INITIAL_GUESS)


def test_the_engine_is_found_by_its_name() -> None:
    assert isinstance(load("mujoco"), Mujoco)


# ---- where there is no answer


def open_four_bar() -> Scene:
    """Return the four-bar with a coupler that is too long to meet the rocker at any crank angle."""
    scene = four_bar()
    joints = tuple(
        replace(j, point_j=pair(PINS["coupler"][1] + 6.0)) if j.name == "B" else j for j in scene.mechanism.joints
    )
    return replace(scene, mechanism=replace(scene.mechanism, joints=joints))


def test_a_linkage_that_cannot_close_is_not_converged() -> None:
    motion = Mujoco().solve(open_four_bar())

    assert {Status.NOT_CONVERGED} == set(motion.status)


def test_where_there_is_no_answer_every_number_is_nan() -> None:
    motion = Mujoco().solve(open_four_bar())

    assert all(np.isnan(level).all() for level in motion.levels if level is not None)


def test_mujoco_leaves_no_log_behind_when_it_warns(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(tmp_path)
    rows = MujocoRows(Plan(joint_tree(four_bar().mechanism), ()))
    rows.data.qpos[:] = np.nan
    mujoco.mj_step(rows.model, rows.data)
    warned = sum(w.number for w in rows.data.warning)

    assert (warned > 0, list(tmp_path.iterdir())) == (True, [])


# ---- planted faults: the checks above must turn red


def test_the_other_assembly_is_not_taken_for_the_one_that_was_asked_for() -> None:
    motion = Mujoco().solve(four_bar(-1.0))

    assert error(motion, four_bar_rows(1.0), 0) > 1.0


def test_a_forgotten_rate_of_the_driver_is_seen_in_the_velocities(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(TreeSystem, "nu", lambda self, q, t: np.zeros((len(t), self.engine.closure_rows + 1)))
    motion = Mujoco().solve(four_bar())

    assert not error(motion, four_bar_rows(1.0), 1) <= CLOSED[1]


def test_a_missing_drift_term_of_the_loop_is_seen_in_the_accelerations(monkeypatch: pytest.MonkeyPatch) -> None:
    right = TreeRows.closure_drift
    monkeypatch.setattr(TreeRows, "closure_drift", lambda self, *at: [0.0 * part for part in right(self, *at)])
    motion = Mujoco().solve(four_bar())

    assert error(motion, four_bar_rows(1.0), 2) > CLOSED[2]


def test_a_tree_without_open_loops_has_no_rows_of_mujoco() -> None:
    rows = TreeRows(replace(joint_tree(four_bar().mechanism), closures=()))
    q = np.zeros((3, rows.tree.width))
    residual, jacobian, *_ = rows.closure(q, [])

    assert (residual.shape, jacobian.shape) == ((3, 0), (3, 0, rows.tree.width))
