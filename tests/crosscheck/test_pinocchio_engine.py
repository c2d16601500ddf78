"""Pinocchio's own rows against the reference's formulas, and its joint trees against closed forms."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass, replace
from itertools import product
from typing import Any, ClassVar, Literal

import numpy as np
import pytest

from crosscheck import loop_closing, tree_system
from crosscheck.engines import EngineError, Level, Support, load, refusals
from crosscheck.engines.pinocchio_engine import CAPABILITIES, TREE, Pinocchio
from crosscheck.engines.pinocchio_model import EqualAngles, PlanarModel, PointToLine, Row, Rows, TwoPoints
from refkin.joints import (
    GROUND,
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
)
from refkin.model import Body, Effect, Mechanism, Scene
from refkin.motion import Motion, Seeding, Status
from refkin.motion_laws import Polynomial, Sinusoid
from refkin.system import compile_system

EPS = float(np.finfo(float).eps)
LEVELS = (Level.RESIDUAL, Level.JACOBIAN, Level.CONSTRAINT_VELOCITY, Level.DRIFT)
JOINTS = ("revolute", "fixed", "prismatic", "point_on_line")
PLACES = (("ground", "a"), ("a", "ground"), ("a", "b"), ("b", "a"))


# ---- levels: Pinocchio's rows at configurations that are not assembled


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
    found = dict.fromkeys(LEVELS, 0.0)
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
            found[level] = max(found[level], float(error))
    return found


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
    kept = {"revolute": ["a phi"], "prismatic": ["a x"], "point_on_line": ["a x", "a phi"], "distance": ["a y", "a phi"]}
    others += [d for d in driven("a") if d.name in kept.get(kind, [])]
    return Scene(mechanism=Mechanism(bodies, (joint,), tuple(others)), times=(0.0, 1.0))


def residual_of(scene: Scene, motion: Motion) -> float:
    system = compile_system(scene.mechanism)
    return max(float(np.max(np.abs(system.phi(motion.q[:, k], t)))) for k, t in enumerate(scene.times))


@pytest.mark.parametrize("kind", CAPABILITIES)
def test_every_type_is_solved_or_refused_as_declared(kind: str) -> None:
    scene = scene_with(kind)
    motion = Pinocchio().solve(scene)

    assert CAPABILITIES[kind][Level.SOLVE].support is not Support.REFUSED
    assert (motion.verdict, residual_of(scene, motion) <= 64 * EPS) == (Status.OK, True)


@pytest.mark.parametrize(("kind", "level"), list(product(CAPABILITIES, LEVELS)))
def test_every_type_has_rows_or_is_refused_as_declared(kind: str, level: Level) -> None:
    scene = scene_with(kind)
    if CAPABILITIES[kind][level].support is Support.REFUSED:
        reason = CAPABILITIES[kind][level].reason
        with pytest.raises(EngineError, match=f"refuses {kind} 'j' at residual: {reason}"):
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
    with pytest.raises(EngineError, match="pinocchio refuses gear 'teeth' at (solve|residual): no such joint"):
        ask(two_bodies(Gear(name="teeth", body_i="a", body_j="b")))


def test_drivers_are_not_claimed() -> None:
    model = Pinocchio().constraints(scene_with("revolute"))

    assert (model.owns_driver, {m.constraint for m in model.rows}) == (False, {"j"})


# ---- solve: joint trees against closed forms


@dataclass(frozen=True)
class Path:
    """A complex function of time with its first two derivatives: a point, or e^(i angle)."""

    r: Any
    v: Any
    a: Any

    def __add__(self, other: Path) -> Path:
        return Path(self.r + other.r, self.v + other.v, self.a + other.a)


@dataclass(frozen=True)
class Angle:
    """A real function of time with its first two derivatives."""

    p: Any
    d: Any
    dd: Any

    def arm(self, u: complex) -> Path:
        """Return u turned by the angle."""
        e = np.exp(1j * self.p) * u
        return Path(e, 1j * self.d * e, (1j * self.dd - self.d**2) * e)

    def plus(self, constant: float) -> Angle:
        return Angle(self.p + constant, self.d, self.dd)


def at_rest(z: complex) -> Path:
    return Path(z, 0j, 0j)


def body_rows(origin: Path, angle: Angle) -> list[np.ndarray]:
    """Return the (3, T) rows of a body at each level."""
    levels = ((origin.r, angle.p), (origin.v, angle.d), (origin.a, angle.dd))
    return [np.array([np.broadcast_to(x, T.shape) for x in (np.real(r), np.imag(r), phi)]) for r, phi in levels]


def pair(z: complex) -> tuple[float, float]:
    return complex(z).real, complex(z).imag


T = np.linspace(0.0, 2.0, 72)
LAW = Polynomial(coefficients=(0.6, 1.5, 0.7))
THETA = Angle(LAW(T), LAW(T, 1), LAW(T, 2) + 0.0 * T)
MOTOR = AngleDriver(name="motor", body="crank", law=LAW)


def pin(name: str, i: str, point_i: complex, j: str, point_j: complex) -> Revolute:
    return Revolute(name=name, body_i=i, point_i=pair(point_i), body_j=j, point_j=pair(point_j))


def scene_of(
    rows: dict[str, list[np.ndarray]], joints: Any, drivers: Any = (MOTOR,), size: float = 1.0, **more: Any
) -> Scene:
    """Return the scene whose exact motion is `rows`, with estimates that are off by up to 0.02 (sizes, rad)."""
    rng = np.random.default_rng(11)
    bodies = []
    for name, levels in rows.items():
        off = rng.uniform(-0.02, 0.02, 3) * [size, size, 1.0]
        bodies.append(Body(name=name, estimate=tuple((levels[0][:, 0] + off).tolist())))
    return Scene(mechanism=Mechanism(tuple(bodies), tuple(joints), tuple(drivers)), times=tuple(T.tolist()), **more)


@dataclass(frozen=True)
class Case:
    """A scene, its exact motion, and kappa: how much its equations, in units of its size, amplify an error."""

    scene: Scene
    rows: dict[str, list[np.ndarray]]
    kappa: float


def four_bar(
    branch: int = 1, size: float = 1.0, at: complex = 0j, lengths: Any = (1.0, 3.5, 3.0, 4.0), **more: Any
) -> Case:
    """Crank a, coupler b, rocker c, ground d; frames away from the pins."""
    a, b, c, d = (size * length for length in lengths)
    crank = THETA.arm(a)
    reach = d - crank.r
    s = np.abs(reach)
    theta3 = np.unwrap(np.angle(reach) + branch * np.arccos((s * s + b * b - c * c) / (2 * b * s)))
    theta4 = np.unwrap(np.angle(crank.r + b * np.exp(1j * theta3) - d))
    e3, e4 = np.exp(1j * theta3), np.exp(1j * theta4)

    def solved(rest: Any) -> tuple[Any, Any]:
        """Return (x, y) with rest + i b x e3 - i c y e4 = 0, by projection on e4 and e3."""
        x = -np.real(rest * np.conj(e4)) / np.real(1j * b * e3 * np.conj(e4))
        return x, np.real(rest * np.conj(e3)) / np.real(1j * c * e4 * np.conj(e3))

    w3, w4 = solved(crank.v)
    a3, a4 = solved(crank.a - b * w3**2 * e3 + c * w4**2 * e4)
    coupler, rocker = Angle(theta3, w3, a3), Angle(theta4, w4, a4)
    rows = {
        "crank": body_rows(at_rest(at) + THETA.arm(0.5 * a), THETA),
        "coupler": body_rows(at_rest(at) + crank + coupler.arm(0.5 * b + 0.25j * size), coupler),
        "rocker": body_rows(at_rest(at + d) + rocker.arm(0.5 * c), rocker),
    }
    joints = (
        pin("A0", GROUND, at, "crank", -0.5 * a),
        pin("A", "crank", 0.5 * a, "coupler", -0.5 * b - 0.25j * size),
        pin("B", "rocker", 0.5 * c, "coupler", 0.5 * b - 0.25j * size),
        pin("B0", "rocker", -0.5 * c, GROUND, at + d),
    )
    return Case(scene_of(rows, joints, size=size, **more), rows, float(np.max(1.0 / np.abs(np.sin(theta4 - theta3)))))


def slider_crank(tilt: float = 0.0, angle: float = 0.0, rod_is: str = "body", guide_on: str = GROUND) -> Case:
    """Crank 1, rod 3, offset 0.4, on a guide at `tilt` whose slider is turned by `angle`; the rod a body or a distance."""
    r, length, offset = 1.0, 3.0, 0.4
    sine = (offset - r * np.sin(THETA.p)) / length
    phi = np.arcsin(sine)
    d = -r * THETA.d * np.cos(THETA.p) / (length * np.cos(phi))
    dd = -r * (THETA.dd * np.cos(THETA.p) - THETA.d**2 * np.sin(THETA.p)) + length * d**2 * sine
    crank, rod = THETA.plus(tilt), Angle(phi, d, dd / (length * np.cos(phi))).plus(tilt)
    still = Angle(tilt + angle, 0.0, 0.0)
    end = crank.arm(r) + rod.arm(length)
    rows = {
        "crank": body_rows(at_rest(0j), crank),
        "rod": body_rows(crank.arm(r), rod),
        "slider": body_rows(end + still.arm(-0.5j), still),
    }
    along = np.exp(1j * tilt)
    guide = {"name": "G", "point_i": pair(1j * offset * along), "axis_i": pair(2.0 * along), "point_j": (0.0, 0.5)}
    prismatic = Prismatic(**guide, body_i=GROUND, body_j="slider", angle=tilt + angle)
    if guide_on == "slider":
        own = np.exp(-1j * angle)
        guide = {"name": "G", "point_i": (0.0, 0.5), "axis_i": pair(own), "point_j": pair(1j * offset * along)}
        prismatic = Prismatic(**guide, body_i="slider", body_j=GROUND, angle=-tilt - angle)
    joints: list[Constraint] = [pin("A0", GROUND, 0j, "crank", 0j), prismatic]
    if rod_is == "body":
        joints += [pin("A", "crank", r, "rod", 0j), pin("B", "rod", length, "slider", 0.5j)]
    else:
        del rows["rod"]
        ends = {"body_i": "crank", "point_i": (r, 0.0), "body_j": "slider", "point_j": (0.0, 0.5)}
        joints.append(Distance(name="rod", **ends, length=length))
    driver = replace(MOTOR, law=Polynomial(coefficients=(LAW.coefficients[0] + tilt, *LAW.coefficients[1:])))
    return Case(scene_of(rows, joints, (driver,)), rows, float(np.max(1.0 / np.cos(phi))))


def inverted_slider_crank() -> Case:
    """A crank of 1 drives a block along a rocker pivoted at -2.5: a guide that moves, closed between two moving bodies."""
    pivot, turned = -2.5, 0.4
    reach = at_rest(-pivot + 0j) + THETA.arm(1.0)
    rate, curve = reach.v / reach.r, reach.a / reach.r - (reach.v / reach.r) ** 2
    rocker = Angle(np.unwrap(np.angle(reach.r)), np.imag(rate), np.imag(curve))
    rows = {
        "crank": body_rows(at_rest(0j), THETA),
        "rocker": body_rows(at_rest(pivot + 0j), rocker),
        "block": body_rows(THETA.arm(1.0), rocker.plus(turned)),
    }
    guide = Prismatic(
        name="G",
        body_i="rocker",
        point_i=(0.3, 0.0),
        axis_i=(1.0, 0.0),
        body_j="block",
        point_j=(0.0, 0.0),
        angle=turned,
    )
    joints = (
        pin("A0", GROUND, 0j, "crank", 0j),
        pin("B0", GROUND, pivot, "rocker", 0j),
        pin("A", "crank", 1.0, "block", 0j),
        guide,
    )
    return Case(scene_of(rows, joints), rows, float(np.max(1.0 / np.abs(reach.r))))


def scotch_yoke() -> Case:
    """A crank pin on a line across a yoke that slides along x: x = cos theta."""
    pin_path = THETA.arm(1.0)
    rows = {
        "crank": body_rows(at_rest(0j), THETA),
        "yoke": body_rows(Path(*(np.real(x) + 0j for x in (pin_path.r, pin_path.v, pin_path.a))), Angle(0.0, 0.0, 0.0)),
    }
    line = PointOnLine(
        name="L", body_i="yoke", point_i=(0.0, 0.7), axis_i=(0.0, -2.0), body_j="crank", point_j=(1.0, 0.0)
    )
    guide = Prismatic(name="G", body_i=GROUND, point_i=(3.0, 0.0), axis_i=(1.0, 0.0), body_j="yoke", point_j=(0.0, 0.0))
    return Case(scene_of(rows, (pin("A0", GROUND, 0j, "crank", 0j), line, guide)), rows, 1.0)


def welded_arm() -> Case:
    """Two links, the second driven against the first, with a body fixed on its end."""
    second = Angle(*(2.0 * x for x in (THETA.p, THETA.d, THETA.dd)))
    tip = THETA.arm(1.0) + second.arm(0.8)
    tool = second.plus(-0.3)
    rows = {
        "tool": body_rows(tip + tool.arm(-0.2j), tool),
        "crank": body_rows(at_rest(0j), THETA),
        "arm": body_rows(THETA.arm(1.0), second),
    }
    weld = Fixed(name="W", body_i="tool", point_i=(0.0, 0.2), body_j="arm", point_j=(0.8, 0.0), angle=0.3)
    joints = (weld, pin("A0", GROUND, 0j, "crank", 0j), pin("A", "crank", 1.0, "arm", 0j))
    relative = AngleDriver(name="second", body="arm", relative_to="crank", law=LAW)
    return Case(scene_of(rows, joints, (MOTOR, relative)), rows, 1.0)


def cylinder() -> Case:
    """A boom raised by a cylinder between (1.5, 0) and its point at 2: f^2 = 2^2 + 1.5^2 - 2 * 2 * 1.5 cos psi."""
    law = Sinusoid(offset=2.5, amplitude=0.6, angular_frequency=2.0, phase=0.3)
    f, fd, fdd = law(T), law(T, 1), law(T, 2)
    cosine = (2.0**2 + 1.5**2 - f * f) / (2 * 2.0 * 1.5)
    psi = np.arccos(cosine)
    d = f * fd / (3.0 * np.sin(psi))
    boom = Angle(psi, d, ((fd * fd + f * fdd) / 3.0 - cosine * d * d) / np.sin(psi))
    rows = {"boom": body_rows(at_rest(0j), boom)}
    ends = {"body_i": GROUND, "point_i": (1.5, 0.0), "body_j": "boom", "point_j": (2.0, 0.0)}
    driver = DistanceDriver(name="C", **ends, law=law)
    kappa = float(np.max(f / (3.0 * np.sin(psi))))
    return Case(scene_of(rows, (pin("A0", GROUND, 0j, "boom", 0j),), (driver,)), rows, kappa)


def lifted_end(key: str) -> Case:
    """A crank of length 1 whose end follows x = f or y = f: psi = acos f or asin f."""
    law = Sinusoid(offset=0.1, amplitude=0.7, angular_frequency=2.0, phase=0.3)
    f, fd, fdd = law(T), law(T, 1), law(T, 2)
    slope = np.sqrt(1.0 - f * f) * (-1.0 if key == "x" else 1.0)  # f' = slope psi'
    psi = np.arccos(f) if key == "x" else np.arcsin(f)
    d = fd / slope
    rows = {"boom": body_rows(at_rest(2.0 - 1j), Angle(psi, d, (fdd + f * d * d) / slope))}
    kind, shift = (XDriver, 2.0) if key == "x" else (YDriver, -1.0)
    driver = kind(name="D", body="boom", point=(1.0, 0.0), law=replace(law, offset=law.offset + shift))
    return Case(
        scene_of(rows, (pin("A0", GROUND, 2.0 - 1j, "boom", 0j),), (driver,)), rows, float(np.max(1 / np.abs(slope)))
    )


def floating() -> Case:
    """A body that no joint holds: x, y and phi of it are driven."""
    path = Path(THETA.p + 2j * THETA.p, THETA.d + 2j * THETA.d, THETA.dd + 2j * THETA.dd)
    rows = {"crank": body_rows(path, THETA)}
    double = Polynomial(coefficients=tuple(2.0 * c for c in LAW.coefficients))
    drivers = (MOTOR, XDriver(name="x", body="crank", law=LAW), YDriver(name="y", body="crank", law=double))
    return Case(scene_of(rows, (), drivers), rows, 1.0)


def parallel_links() -> Case:
    """A plate on two distance joints of equal length, side by side: it moves without turning; the links are massless."""
    place = THETA.arm(1.5)
    rows = {"plate": body_rows(place, Angle(0.0, 0.0, 0.0)), "crank": body_rows(at_rest(0j), THETA)}
    ends = {"body_i": GROUND, "body_j": "plate", "length": 1.5}
    joints = (
        pin("A0", GROUND, 0j, "crank", 0j),
        Distance(name="left", point_i=(0.0, 0.0), point_j=(0.0, 0.0), **ends),
        Distance(name="right", point_i=(0.0, 2.0), point_j=(0.0, 2.0), **ends),
        PointOnLine(
            name="L", body_i="crank", point_i=(0.0, 0.0), axis_i=(1.0, 0.0), body_j="plate", point_j=(0.0, 0.0)
        ),
    )
    return Case(scene_of(rows, joints), rows, float(np.max(1.0 / np.abs(np.cos(THETA.p)))))


CASES: dict[str, Callable[[], Case]] = {
    "four-bar, open": four_bar,
    "four-bar, crossed": lambda: four_bar(branch=-1),
    "slider-crank": slider_crank,
    "slider-crank, tilted and turned": lambda: slider_crank(tilt=0.7, angle=-1.1),
    "slider-crank, axis on the slider": lambda: slider_crank(tilt=0.7, angle=-1.1, guide_on="slider"),
    "slider-crank, rod a distance": lambda: slider_crank(tilt=-0.4, rod_is="distance"),
    "inverted slider-crank": inverted_slider_crank,
    "scotch yoke": scotch_yoke,
    "welded arm": welded_arm,
    "cylinder": cylinder,
    "driven x": lambda: lifted_end("x"),
    "driven y": lambda: lifted_end("y"),
    "floating body": floating,
    "parallel links": parallel_links,
}


def excess(case: Case, motion: Motion) -> float:
    """Return the largest error over what is allowed, at any level of any body.

    A row takes some 16 roundings of numbers up to 1 + |phi| in units of the size, here and there. kappa carries them into
    q; J changes by |qd| dq, so they enter qd by kappa once more, and qdd by kappa a third time.
    """
    size = case.scene.mechanism.size()
    worst = 0.0
    for body, exact in case.rows.items():
        found = motion[body]
        scale = np.array([[size], [size], [1.0]])
        e = 32 * EPS * (1.0 + max(np.max(np.abs(levels[0][2])) for levels in case.rows.values()))
        rate = max(1.0, *(float(np.max(np.abs(levels[1] / scale))) for levels in case.rows.values()))
        for order, (ours, theirs) in enumerate(zip(exact, (found.q, found.qd, found.qdd), strict=True)):
            far = np.abs(exact[0]) * EPS if order == 0 else 0.0  # a coordinate is handed over in metres from the origin
            allowed = e * case.kappa ** (order + 1) * rate**order * scale + far
            worst = max(worst, float(np.max(np.abs(ours - theirs) / allowed)))
    return worst


@pytest.mark.parametrize("name", CASES)
def test_the_joint_tree_moves_as_the_closed_form(name: str) -> None:
    case = CASES[name]()
    motion = Pinocchio().solve(case.scene)

    assert motion.status == (Status.OK,) * len(T)
    assert excess(case, motion) <= 1.0


@pytest.mark.parametrize(("size", "at"), [(2.0**-30, 0j), (2.0**30, 0j), (1.0, 1e6 - 2e6j), (1e-3, 1e5 + 0j)])
def test_neither_scale_nor_distance_from_the_origin_costs_digits(size: float, at: complex) -> None:
    """Far away a coordinate is rounded when it is handed over, and so are the ground points of the scene itself."""
    case = four_bar(size=size, at=at)
    exact = four_bar(size=size, at=at)
    ground = 4 * EPS * abs(at) / size  # the distance of the ground points is known to this part of the size
    allowed = 1.0 + ground * 64 / EPS

    assert excess(replace(exact, scene=case.scene), Pinocchio().solve(case.scene)) <= allowed
