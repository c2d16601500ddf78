"""Pinocchio's own rows against the reference's formulas where nothing is assembled, and its capability table."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass, replace
from itertools import product
from typing import Any, ClassVar, Literal

import numpy as np
import pytest

from crosscheck.engines import EngineError, Level, Support, load, refusals
from crosscheck.engines.pinocchio import engine as pinocchio_engine
from crosscheck.engines.pinocchio import model as pinocchio_model
from crosscheck.engines.pinocchio import rows as pinocchio_rows
from crosscheck.engines.pinocchio.engine import CAPABILITIES, Pinocchio
from crosscheck.engines.pinocchio.model import PlanarModel
from crosscheck.engines.pinocchio.rows import PointToLine, Rows, TwoPoints
from refkin.joints import (
    AngleDriver,
    Constraint,
    Distance,
    DistanceDriver,
    Driver,
    Fixed,
    PointOnLine,
    Prismatic,
    Revolute,
    XDriver,
    YDriver,
    elements_of,
)
from refkin.model import Body, Mechanism, Scene
from refkin.motion import Motion, Status
from refkin.motion_laws import Polynomial
from refkin.system import compile_system

EPS = float(np.finfo(float).eps)
LEVELS = (Level.RESIDUAL, Level.JACOBIAN, Level.CONSTRAINT_VELOCITY, Level.DRIFT)
JOINTS = ("revolute", "fixed", "prismatic", "point_on_line")
PLACES = (("ground", "a"), ("a", "ground"), ("a", "b"), ("b", "a"))


def joint_of(kind: str, i: str, j: str, rng: np.random.Generator) -> Constraint:
    point_i, point_j, axis = (tuple(rng.uniform(-2.0, 2.0, 2).tolist()) for _ in range(3))
    ends: dict[str, Any] = {"name": "j", "body_i": i, "point_i": point_i, "body_j": j, "point_j": point_j}
    angle = float(rng.uniform(-3.0, 3.0))
    return {
        "revolute": lambda: Revolute(**ends),
        "fixed": lambda: Fixed(**ends, angle=angle),
        "prismatic": lambda: Prismatic(**ends, axis_i=axis, angle=angle),
        "point_on_line": lambda: PointOnLine(**ends, axis_i=axis),
        "distance": lambda: Distance(**ends, length=1.5),
    }[kind]()


def driven(*bodies: str) -> tuple[Driver, ...]:
    """Return drivers of every coordinate, so that the mechanism has enough constraints whatever its joints."""
    law = Polynomial(coefficients=(0.1, 0.2))
    kinds = (("x", XDriver), ("y", YDriver), ("phi", AngleDriver))
    return tuple(kind(name=f"{body} {key}", body=body, law=law) for body in bodies for key, kind in kinds)


def two_bodies(*joints: Constraint) -> Scene:
    bodies = (Body(name="a", estimate=(0.1, 0.1, 0.1)), Body(name="b", estimate=(0.1, 0.1, 0.1)))
    return Scene(mechanism=Mechanism(bodies, joints, driven("a", "b")), times=(0.0,))


def states(count: int, rng: np.random.Generator) -> list[tuple[np.ndarray, np.ndarray]]:
    return [(rng.uniform(-4.0, 4.0, 6), rng.uniform(-4.0, 4.0, 6)) for _ in range(count)]


def errors(scene: Scene, at: list[tuple[np.ndarray, np.ndarray]]) -> dict[Level, float]:
    """Return per level the largest difference of Pinocchio's rows to the reference's, over the size of what cancels.

    With |x|, |y|, |u| < 4 and rates w < 4, the terms of a row are at most reach = 4 * 4, and reach w, reach w^2 when
    differentiated; the second derivative of point_on_line has the largest factor, 2.
    """
    system, model = compile_system(scene.mechanism), Pinocchio().constraints(scene)
    start = {placed.constraint.name: placed.row for placed in system.placed}
    ours = [start[m.constraint] + m.row for m in model.rows]
    factor = np.array([m.factor for m in model.rows])
    theirs = [m.engine_row for m in model.rows]
    result = dict.fromkeys(LEVELS, 0.0)
    for q, qd in at:
        slope = system.phi_q(q, 0.0)[ours]
        rate = np.max(np.abs(qd))
        pairs = {
            Level.RESIDUAL: (model.residual(q, 0.0), system.phi(q, 0.0)[ours], 1.0),
            Level.JACOBIAN: (model.jacobian(q, 0.0).T, slope.T, 1.0),
            Level.CONSTRAINT_VELOCITY: (model.constraint_velocity(q, qd, 0.0), slope @ qd, rate),
            Level.DRIFT: (model.drift(q, qd, 0.0), system.gamma(q, qd, 0.0)[ours], 2.0 * rate**2),
        }
        for level, (engine, reference, scale) in pairs.items():
            error = np.max(np.abs(engine[..., theirs] - factor * reference)) / (16.0 * scale)
            result[level] = max(result[level], float(error))
    return result


ALLOWED = 8 * EPS
"""Two codes, at most 8 roundings that matter in a row of each, each half an EPS of the largest term."""


@pytest.mark.parametrize(("kind", "place"), list(product(JOINTS, PLACES)), ids=str)
def test_rows_are_those_of_the_reference_where_nothing_is_assembled(kind: str, place: tuple[str, str]) -> None:
    rng = np.random.default_rng([JOINTS.index(kind), PLACES.index(place)])
    worst = dict.fromkeys(LEVELS, 0.0)
    for _ in range(10):
        scene = two_bodies(joint_of(kind, *place, rng))
        worst = {level: max(worst[level], error) for level, error in errors(scene, states(10, rng)).items()}

    assert {level: error for level, error in worst.items() if error > ALLOWED} == {}


def test_rows_of_several_joints_keep_the_scene_s_order() -> None:
    rng = np.random.default_rng(5)
    joints = [replace(joint_of(kind, *PLACES[k], rng), name=kind) for k, kind in enumerate(JOINTS)]
    scene = two_bodies(*joints)

    names = [m.constraint for m in Pinocchio().constraints(scene).rows]
    assert names == ["revolute"] * 2 + ["fixed"] * 3 + ["prismatic"] * 2 + ["point_on_line"]
    assert max(errors(scene, states(20, rng)).values()) <= ALLOWED


def test_a_residual_angle_keeps_its_turns() -> None:
    joint = Prismatic(
        name="p", body_i="a", point_i=(0.0, 0.0), axis_i=(1.0, 0.0), body_j="b", point_j=(0.0, 0.0), angle=0.5
    )
    q = np.array([0.0, 0.0, 1.0, 0.0, 0.0, 101.5])

    assert Pinocchio().constraints(two_bodies(joint)).residual(q, 0.0)[1] == pytest.approx(100.0, abs=100 * EPS)


@pytest.mark.parametrize("beyond", [1e-3, 1e-8, 1e-15])
def test_a_residual_angle_is_exact_near_a_half_turn(beyond: float) -> None:
    """Where Pinocchio's own log6 is right to 1e-11 only."""
    joint = Prismatic(name="p", body_i="a", point_i=(0.0, 0.0), axis_i=(1.0, 0.0), body_j="b", point_j=(0.0, 0.0))
    model = Pinocchio().constraints(two_bodies(joint))

    for angle in (math.pi - beyond, math.pi + beyond):
        assert model.residual(np.array([0.0] * 5 + [angle]), 0.0)[1] == pytest.approx(angle, abs=2 * EPS)


def test_arrays_are_fresh() -> None:
    """A row read before must not change when the model moves on."""
    rng = np.random.default_rng(6)
    model = Pinocchio().constraints(two_bodies(*(replace(joint_of(k, "a", "b", rng), name=k) for k in JOINTS)))
    (q, qd), (other, rate) = states(2, rng)
    read = [
        model.residual(q, 0.0),
        model.jacobian(q, 0.0),
        model.constraint_velocity(q, qd, 0.0),
        model.drift(q, qd, 0),
    ]
    before = [a.copy() for a in read]
    model.residual(other, 0.0), model.jacobian(other, 0.0), model.constraint_velocity(other, rate, 0.0)
    model.drift(other, rate, 0.0)

    assert all(np.array_equal(a, b) for a, b in zip(read, before, strict=True))


def test_levels_do_not_depend_on_what_was_asked_before() -> None:
    """Pinocchio leaves velocities and accelerations of earlier calls where they are; none of them may be read."""
    rng = np.random.default_rng(7)
    scene = two_bodies(*(replace(joint_of(k, "a", "b", rng), name=k) for k in JOINTS))
    (q, qd), (other, rate) = states(2, rng)
    used = Pinocchio().constraints(scene)
    used.drift(other, rate, 0.0)

    assert np.array_equal(
        used.constraint_velocity(q, qd, 0.0), Pinocchio().constraints(scene).constraint_velocity(q, qd, 0.0)
    )
    assert np.array_equal(used.jacobian(q, 0.0), Pinocchio().constraints(scene).jacobian(q, 0.0))


# ---- capabilities


KINDS = ("revolute", "fixed", "prismatic", "point_on_line", "distance", "angle", "x", "y", "distance driver")
DRIVERS: dict[str, Driver] = {
    "angle": AngleDriver(name="j", body="a", law=Polynomial(coefficients=(0.2,))),
    "x": XDriver(name="j", body="a", law=Polynomial(coefficients=(0.2,))),
    "y": YDriver(name="j", body="a", law=Polynomial(coefficients=(0.2,))),
    "distance driver": DistanceDriver(
        name="j", body_i="b", point_i=(1.0, 0.0), body_j="a", point_j=(0.0, 0.0), law=Polynomial(coefficients=(1.5,))
    ),
}


def scene_with(kind: str) -> Scene:
    """Return a scene with one constraint of that kind, and drivers that leave it something to decide."""
    rng = np.random.default_rng(8)
    bodies = (Body(name="a", estimate=(0.1, 0.0, 0.3)), Body(name="b", estimate=(0.0, 0.1, 0.2)))
    others = [d for d in driven("a", "b") if d.name.startswith("b")]
    if kind in DRIVERS:
        free = {"angle": "a phi", "x": "a x", "y": "a y", "distance driver": "a y"}[kind]
        others += [d for d in driven("a") if d.name != free]
        return Scene(mechanism=Mechanism(bodies, (), (*others, DRIVERS[kind])), times=(0.0, 1.0))
    joint = joint_of(kind, "b", "a", rng)
    kept = {
        "revolute": ["a phi"],
        "prismatic": ["a x"],
        "point_on_line": ["a x", "a phi"],
        "distance": ["a y", "a phi"],
    }
    others += [d for d in driven("a") if d.name in kept.get(kind, [])]
    return Scene(mechanism=Mechanism(bodies, (joint,), tuple(others)), times=(0.0, 1.0))


def residual_of(scene: Scene, motion: Motion) -> float:
    system = compile_system(scene.mechanism)
    return max(float(np.max(np.abs(system.phi(motion.q[:, k], t)))) for k, t in enumerate(scene.times))


@pytest.mark.parametrize("kind", KINDS)
def test_every_type_is_solved_or_refused_as_declared(kind: str) -> None:
    scene = scene_with(kind)
    motion = Pinocchio().solve(scene)

    assert refusals(Pinocchio(), scene, Level.SOLVE) == []
    assert (motion.verdict, residual_of(scene, motion) <= 64 * EPS) == (Status.OK, True)


@pytest.mark.parametrize(("kind", "level"), list(product(KINDS, LEVELS)))
def test_every_type_has_rows_or_is_refused_as_declared(kind: str, level: Level) -> None:
    scene = scene_with(kind)
    declared = {e.name: CAPABILITIES[e.key][level] for e in elements_of(scene.mechanism.constraints)}["j"]
    if declared.support is Support.REFUSED:
        with pytest.raises(EngineError, match=f"refuses {kind.split()[0]} 'j' at residual: {declared.reason}"):
            Pinocchio().constraints(scene)
    else:
        rng = np.random.default_rng(9)
        assert errors(scene, states(5, rng))[level] <= ALLOWED


def test_a_refused_joint_beside_others_is_named_and_left_out() -> None:
    rng = np.random.default_rng(10)
    pin, rod = joint_of("revolute", "a", "b", rng), replace(joint_of("distance", "a", "b", rng), name="rod")
    scene = two_bodies(pin, rod)

    assert "pinocchio refuses distance 'rod' at residual" in refusals(Pinocchio(), scene, Level.RESIDUAL)[0]
    assert {m.constraint for m in Pinocchio().constraints(scene).rows} == {"j"}


@dataclass(frozen=True, kw_only=True)
class Gear(Constraint):
    """A joint that no table has."""

    rows: ClassVar[int] = 1
    body_i: str
    body_j: str
    type: Literal["gear"] = "gear"


@pytest.mark.parametrize("ask", [Pinocchio().solve, Pinocchio().constraints], ids=["solve", "constraints"])
def test_a_joint_that_is_in_no_table_is_refused_by_name(ask: Callable[[Scene], Any]) -> None:
    with pytest.raises(EngineError, match=r"pinocchio refuses gear 'teeth' at [a-z]+: no such joint"):
        ask(two_bodies(Gear(name="teeth", body_i="a", body_j="b")))


def test_drivers_are_not_claimed() -> None:
    model = Pinocchio().constraints(scene_with("revolute"))

    assert (model.owns_driver, {m.constraint for m in model.rows}) == (False, {"j"})


def test_it_is_found_by_name() -> None:
    engine = load("pinocchio")

    assert (engine.name, engine.version().startswith("4.1")) == ("pinocchio", True)


# ---- planted faults: each replaces a piece of the adapter, and must not go unseen


Plant = tuple[Any, str, Callable[[Any], Any]]
FAULTS: dict[str, Plant] = {
    "stale placements": (PlanarModel, "place", lambda f: lambda self, q: None),
    "stale rates": (PlanarModel, "move", lambda f: lambda self, q, qd: f(self, q, 0.0 * qd)),
    "bodies exchanged": (TwoPoints, "__init__", lambda f: lambda self, planar, i, j: f(self, planar, j, i)),
    "along the axis instead of across": (PointToLine, "component", lambda f: 0),
    "constant angle of the other sign": (pinocchio_rows, "unit_vector", lambda f: lambda angle: f(-angle)),
    "sign of gamma": (Rows, "drift", lambda f: lambda *a: [-part for part in f(*a)]),
    "a point off by 1e-9": (pinocchio_model, "shift", lambda f: lambda u: f((u[0] + 1e-9, u[1]))),
    "bodies permuted": (pinocchio_engine, "absolute_model", lambda f: lambda bodies: f(bodies[::-1])),
}


@pytest.mark.parametrize("name", FAULTS)
def test_a_planted_fault_is_seen(name: str, monkeypatch: pytest.MonkeyPatch) -> None:
    rng = np.random.default_rng(12)
    scene, at = two_bodies(*(replace(joint_of(k, "a", "b", rng), name=k) for k in JOINTS)), states(3, rng)
    healthy = max(errors(scene, at).values())
    owner, attribute, plant = FAULTS[name]
    monkeypatch.setattr(owner, attribute, plant(getattr(owner, attribute)))

    assert healthy <= ALLOWED < max(errors(scene, at).values())
