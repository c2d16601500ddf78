"""MuJoCo's constraint rows against refkin's formulas where nothing is assembled, and faults that this must show."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from typing import Any, Literal

import numpy as np
import pytest

from crosscheck.engines import OF_SPACE, EngineError, Level, Support
from crosscheck.engines.mujoco.engine import Mujoco
from crosscheck.engines.mujoco.model import Plan
from crosscheck.engines.mujoco.parts import Driven
from crosscheck.engines.mujoco.rows import MujocoRows
from refkin.joints import (
    DRIVER_TYPES,
    JOINT_TYPES,
    AngleDriver,
    Constraint,
    Distance,
    DistanceDriver,
    Fixed,
    Gear,
    PointOnLine,
    Prismatic,
    Revolute,
    XDriver,
    YDriver,
    elements_of,
)
from refkin.model import Body, Mechanism, Scene
from refkin.motion_laws import Sinusoid
from refkin.system import compile_system

U = 2.0**-53
ROWS = (Level.RESIDUAL, Level.JACOBIAN, Level.CONSTRAINT_VELOCITY, Level.DRIFT)
KINDS = ("revolute", "fixed", "prismatic", "point_on_line", "distance", "gear", "angle", "x", "y", "distance driver")
LENGTH = 1.25


def constraint(kind: str, k: int, i: str, j: str, u: Callable[[], Any], size: float = 1.0) -> Constraint:
    """Return the k-th constraint of a kind between two bodies, its numbers drawn by `u`."""
    law = Sinusoid(offset=2.0 * size, amplitude=0.5 * size, angular_frequency=2.0, phase=0.3)
    turn = Sinusoid(offset=0.2, amplitude=0.5, angular_frequency=2.0, phase=0.3)
    name = f"{kind} {k}"
    axis: Any = ((0.6, -0.8), (-3.0, 2.0), (0.0, 1e-20))[k]
    moving = i if j == "ground" else j
    if kind == "angle":
        return AngleDriver(name=name, body=j, relative_to=i, law=turn)
    if kind == "gear":
        (radius_i, radius_j), (phi0_i, phi0_j) = u(), u()
        zeros = {"phi0_i": phi0_i / size, "phi0_j": phi0_j / size}
        return Gear(name=name, body_i=i, radius_i=radius_i, body_j=j, radius_j=radius_j, **zeros)
    if kind in "xy":
        return {"x": XDriver, "y": YDriver}[kind](name=name, body=moving, point=u(), law=law)
    ends: dict[str, Any] = {"name": name, "body_i": i, "point_i": u(), "body_j": j, "point_j": u()}
    made: dict[str, Callable[[], Constraint]] = {
        "revolute": lambda: Revolute(**ends),
        "fixed": lambda: Fixed(angle=0.7, **ends),
        "prismatic": lambda: Prismatic(axis_i=axis, angle=-2.3, **ends),
        "point_on_line": lambda: PointOnLine(axis_i=axis, **ends),
        "distance": lambda: Distance(length=LENGTH * size, **ends),
        "distance driver": lambda: DistanceDriver(law=law, **ends),
    }
    return made[kind]()


def loose_scene(*kinds: str, size: float = 1.0) -> Scene:
    """Return two bodies, held together by each kind against the ground, each other, and the ground again."""
    draw = np.random.default_rng(7)

    def u() -> Any:
        return tuple((size * draw.uniform(-1.0, 1.0, 2)).tolist())

    between = (("ground", "a"), ("a", "b"), ("b", "ground"))
    wanted = dict.fromkeys((*kinds, "revolute"))  # the revolute joints make it a mechanism: six rows at least
    values = [constraint(kind, k, i, j, u, size) for kind in wanted for k, (i, j) in enumerate(between)]
    joints = tuple(c for c in values if isinstance(c, JOINT_TYPES))
    drivers = tuple(c for c in values if isinstance(c, DRIVER_TYPES))
    return Scene(mechanism=Mechanism((Body(name="a"), Body(name="b")), joints, drivers), times=(0.0,))


def configurations(count: int = 40) -> Iterator[tuple[Any, Any, float]]:
    """Yield q, qd, t at random: places within 3, angles within 7 (more than a turn), rates within 3."""
    draw = np.random.default_rng(11)
    for _ in range(count):
        q = draw.uniform(-1.0, 1.0, 6) * [3.0, 3.0, 7.0, 3.0, 3.0, 7.0]
        yield q, draw.uniform(-3.0, 3.0, 6), float(draw.uniform(0.0, 3.0))


# What rounding allows, in units of U = 2^-53, at these configurations. An arm (a joint point in its body's frame) is
# at most sqrt 2 long, two joint points are less than 11 apart, their relative velocity is below 17, the drift part of
# their relative acceleration below 26. refkin turns an arm by a cosine and a sine; MuJoCo by the quaternion of half
# the angle (2 roundings), its product with that of the site (4), the matrix of it (6) and the product with the arm
# (4): with what refkin spends, below 18 roundings of each arm, and 10 of the sums. A line has a normal that is turned
# so too, over levers of 11; with its rates it multiplies 17, 2 * 3 * 17 and 3^2 * 11. Squares: d . err(d) and so on
# for d . d / 2, d . d', d' . d' + d . d''. Lengths: err(d), err(d') + |d'| err(d) / |d|, 2 |d'| err(d') / |d| +
# |d'|^2 err(d) / |d|^2 at |d| = LENGTH; for shorter ones see `allowed_error`.
ROUNDINGS = {
    "points": (100.0, 100.0, 350.0, 750.0),
    "lines": (300.0, 300.0, 1400.0, 6400.0),
    "squares": (1400.0, 1300.0, 5600.0, 23000.0),
    "lengths": (100.0, 212.0, 1700.0, 28000.0),
}


def disagreement(scene: Scene, level: Level, model: Any = None) -> float:
    """Return the largest error of a level, over its allowed error, through the declared row maps."""
    model = Mujoco().constraints(scene) if model is None else model
    system = compile_system(scene.mechanism)
    first = {p.constraint.name: p.row for p in system.placed}
    worst = 0.0
    for q, qd, t in configurations():
        x, x_q, gamma = system.phi(q, t), system.phi_q(q, t), system.gamma(q, qd, t)
        # MuJoCo owns no driver: its velocity is phi_q qd alone. The law's rate stands in x' of the drift term only.
        rate = x_q @ qd
        theirs = {
            Level.RESIDUAL: lambda q=q, t=t: model.residual(q, t),
            Level.JACOBIAN: lambda q=q, t=t: model.jacobian(q, t),
            Level.CONSTRAINT_VELOCITY: lambda q=q, qd=qd, t=t: model.constraint_velocity(q, qd, t),
            Level.DRIFT: lambda q=q, qd=qd, t=t: model.drift(q, qd, t),
        }[level]()
        for m in model.rows:
            k = first[m.constraint] + m.row
            slope, bend = m.factor * m.form(x[k], 1), m.factor * m.form(x[k], 2)
            ours = {
                Level.RESIDUAL: m.factor * m.form(x[k], 0),
                Level.JACOBIAN: slope * x_q[k],
                Level.CONSTRAINT_VELOCITY: slope * rate[k],
                Level.DRIFT: slope * gamma[k] - bend * rate[k] ** 2,
            }[level]
            allowed = allowed_error(scene, m.constraint, level, float(m.form(x[k], 0)))
            worst = max(worst, float(np.max(np.abs(theirs[m.engine_row] - ours))) / allowed)
    return worst


def allowed_error(scene: Scene, name: str, level: Level, row: float) -> float:
    """Return what rounding allows a row of a constraint to differ.

    A distance joint is mapped by |d| = sqrt(L^2 + 2 L x), x = (d . d - L^2) / (2 L). Where |d| is below L the root
    cancels and magnifies its rounding by L / |d|; its derivatives L / |d| and -L^2 / |d|^3 do so once more each.
    """
    c = next(c for c in scene.mechanism.constraints if c.name == name)
    family = {PointOnLine: "lines", Prismatic: "lines", DistanceDriver: "squares", Distance: "lengths"}
    bound = U * ROUNDINGS[family.get(type(c), "points")][ROWS.index(level)]
    if isinstance(c, Distance):
        bound *= max(1.0, c.length / (c.length + row)) ** (1, 2, 2, 3)[ROWS.index(level)]
    return bound


# ---- rows at unassembled configurations


@pytest.mark.parametrize("level", ROWS)
@pytest.mark.parametrize("kind", KINDS)
def test_row_agrees_with_refkin_where_nothing_is_assembled(kind: str, level: Level) -> None:
    scene = loose_scene(kind)

    assert disagreement(scene, level) <= 1.0


@pytest.mark.parametrize("level", ROWS)
def test_rows_of_all_kinds_stand_together_in_one_model(level: Level) -> None:
    scene = loose_scene(*KINDS)

    assert disagreement(scene, level) <= 1.0


def test_every_row_of_refkin_is_mapped_once() -> None:
    scene = loose_scene(*KINDS)
    rows = [(m.constraint, m.row) for m in Mujoco().constraints(scene).rows]

    assert sorted((c.name, k) for c in scene.mechanism.constraints for k in range(c.rows)) == sorted(rows)


@pytest.mark.parametrize("level", ROWS)
@pytest.mark.parametrize("kind", KINDS)
@pytest.mark.parametrize("power", [-30, 30])
def test_rows_of_a_mechanism_scaled_by_a_power_of_two_are_the_same_to_the_last_bit(
    kind: str, level: Level, power: int
) -> None:
    size = 2.0**power
    q, qd, t = next(configurations(1))
    metres = np.array([size, size, 1.0] * 2)
    answers = [
        (mapped_rows(loose_scene(kind), level, q, qd, t)),
        (mapped_rows(loose_scene(kind, size=size), level, q * metres, qd * metres, t)),
    ]
    if level is Level.JACOBIAN:
        answers[1] = answers[1] * metres

    ratio = np.unique(answers[1][answers[0] != 0.0] / answers[0][answers[0] != 0.0])

    assert set(ratio) <= {1.0, size, size**2}


def mapped_rows(scene: Scene, level: Level, q: Any, qd: Any, t: float) -> Any:
    """Return MuJoCo's rows at a level."""
    model = Mujoco().constraints(scene)
    if level in (Level.RESIDUAL, Level.JACOBIAN):
        return getattr(model, level.value)(q, t)
    return getattr(model, level.value)(q, qd, t)


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


# ---- capabilities


def test_the_table_lists_every_joint_and_driver_type_at_every_level() -> None:
    keys = {element.key for element in elements_of(loose_scene(*KINDS).mechanism.constraints)}

    table = {k: set(v) for k, v in Mujoco().capabilities().items() if k not in OF_SPACE}

    assert {key: set(Level) for key in keys} == table


def test_every_derived_capability_names_what_the_adapter_supplies() -> None:
    table = Mujoco().capabilities()
    silent = [
        (kind, level)
        for kind, levels in table.items()
        for level, capability in levels.items()
        if capability.support is Support.DERIVED and not capability.reason
    ]

    assert silent == []


@dataclass(frozen=True, kw_only=True)
class Magnet(Constraint):
    """A joint that no engine has."""

    rows = 6
    body_i: str
    body_j: str
    type: Literal["magnet"] = "magnet"


@pytest.mark.parametrize("ask", [Mujoco().constraints, Mujoco().solve])
def test_a_joint_that_is_not_in_the_table_is_refused_by_name(ask: Callable[[Scene], Any]) -> None:
    joint = Magnet(name="snap", body_i="ground", body_j="a")
    scene = Scene(mechanism=Mechanism((Body(name="a", estimate=(0.0, 0.0, 0.0)),), (joint,)), times=(0.0,))

    with pytest.raises(EngineError, match=r"mujoco refuses magnet 'snap' at .*: no such joint in this engine"):
        ask(scene)


def test_two_models_at_once_do_not_disturb_each_other() -> None:
    scene = loose_scene(*KINDS)
    q, qd, t = next(configurations(1))
    first, second = Mujoco().constraints(scene), Mujoco().constraints(scene)
    before = first.drift(q, qd, t)
    second.drift(2.0 * q, 3.0 * qd, t + 1.0)

    assert before.tolist() == first.drift(q, qd, t).tolist()


# ---- planted faults: the checks above must turn red


def off_by_1e_9(patch: pytest.MonkeyPatch) -> None:
    right = Plan._site
    patch.setattr(Plan, "_site", lambda self, name, body, point: right(self, name, body, (point[0] + 1e-9, point[1])))


def swapped_ends(patch: pytest.MonkeyPatch) -> None:
    right = Plan._connect
    patch.setattr(Plan, "_connect", lambda self, j, i: right(self, i, j))


def permuted_columns(patch: pytest.MonkeyPatch) -> None:
    right = MujocoRows.__init__

    def wrong(self: MujocoRows, plan: Plan) -> None:
        right(self, plan)
        self.columns = np.roll(self.columns, 3)

    patch.setattr(MujocoRows, "__init__", wrong)


def stale_positions(patch: pytest.MonkeyPatch) -> None:
    right = MujocoRows.rows
    first: dict[int, Any] = {}
    patch.setattr(MujocoRows, "rows", lambda self, q: right(self, first.setdefault(id(self), q)))


def stale_laws(patch: pytest.MonkeyPatch) -> None:
    patch.setattr(MujocoRows, "drive", lambda self, t: None)


def stabilised(patch: pytest.MonkeyPatch) -> None:
    right = Plan._equality

    def wrong(self: Plan, *args: Any) -> int:
        first = right(self, *args)
        self.spec.equalities[-1].solref = [0.02, 1.0]
        return first

    patch.setattr(Plan, "_equality", wrong)


def no_coriolis_on_a_line(patch: pytest.MonkeyPatch) -> None:
    def wrong(self: MujocoRows, gap: Any, rate: Any, drift: Any, turning: Any) -> Any:
        at = [[g.connect, g.connect + 1] for g in self.plan.guides]
        return np.sum(turning[..., :2] * drift[:, at], axis=-1)

    patch.setattr(MujocoRows, "_guide_drift", wrong)


def no_bias_of_a_length(patch: pytest.MonkeyPatch) -> None:
    patch.setattr(MujocoRows, "_length_drift", lambda self, row: 0.0)


def no_second_derivative_of_a_law(patch: pytest.MonkeyPatch) -> None:
    right = Driven.value
    patch.setattr(Driven, "value", lambda self, t, order: 0.0 if order == 2 else right(self, t, order))


FAULTS: list[tuple[Callable[[pytest.MonkeyPatch], None], str, Level]] = [
    *((off_by_1e_9, kind, Level.RESIDUAL) for kind in KINDS if kind != "angle"),
    *((off_by_1e_9, kind, Level.JACOBIAN) for kind in ("revolute", "distance", "prismatic")),
    *((swapped_ends, kind, Level.RESIDUAL) for kind in ("revolute", "x", "y")),
    *((permuted_columns, kind, Level.JACOBIAN) for kind in KINDS),
    *((stale_positions, kind, level) for kind in KINDS for level in ROWS[:2]),
    *((stale_laws, kind, Level.RESIDUAL) for kind in ("angle", "x", "y", "distance driver")),
    *((stabilised, kind, Level.DRIFT) for kind in ("revolute", "fixed", "prismatic", "angle")),
    *((no_coriolis_on_a_line, kind, Level.DRIFT) for kind in ("prismatic", "point_on_line")),
    *((no_bias_of_a_length, kind, Level.DRIFT) for kind in ("distance", "distance driver")),
    *((no_second_derivative_of_a_law, kind, Level.DRIFT) for kind in ("angle", "x", "y", "distance driver")),
]


@pytest.mark.parametrize(("plant", "kind", "level"), FAULTS, ids=lambda v: getattr(v, "__name__", str(v)))
def test_a_fault_in_the_rows_is_seen(
    plant: Callable[[pytest.MonkeyPatch], None], kind: str, level: Level, monkeypatch: pytest.MonkeyPatch
) -> None:
    scene = loose_scene(kind)
    assert disagreement(scene, level) <= 1.0
    plant(monkeypatch)

    assert disagreement(scene, level) > 1.0


def test_a_site_taken_for_the_origin_of_its_body_is_seen(monkeypatch: pytest.MonkeyPatch) -> None:
    def without_the_reset(self: Plan) -> Any:
        return self.spec.compile()

    monkeypatch.setattr(Plan, "compile", without_the_reset)

    with pytest.raises(AssertionError):
        test_a_joint_point_nearer_to_its_body_s_origin_than_1e_6_is_not_taken_for_the_origin()
