"""exudyn's rows against refkin's formulas at configurations that are not assembled, and faults they must not hide."""

from __future__ import annotations

import gc
import weakref
from collections.abc import Callable
from typing import Any

import numpy as np
import pytest

from crosscheck.engines import ELEMENTS, OF_SPACE, EngineError, Level, Support
from crosscheck.engines.exudyn import model as exudyn_model
from crosscheck.engines.exudyn import parts as exudyn_parts
from crosscheck.engines.exudyn import readings as exudyn_readings
from crosscheck.engines.exudyn.engine import CAPABILITIES, Exudyn
from crosscheck.engines.exudyn.model import ExudynModel
from refkin.joints import (
    DRIVER_TYPES,
    AngleDriver,
    Cam,
    Constraint,
    Disc,
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
KINDS = ("revolute", "fixed", "prismatic", "point_on_line", "distance", "gear", "angle", "x", "y", "distance driver",
    "disc", "face on disc")  # fmt: skip


def constraint(kind: str, name: str, i: str, j: str, u: Callable[[], Any]) -> Constraint:
    """Return a constraint of a kind between two bodies, its numbers drawn by `u`."""
    law = Sinusoid(offset=2.0, amplitude=0.5, angular_frequency=2.0, phase=0.3)
    moving = i if j == "ground" else j
    if kind == "gear":
        (radius_i, radius_j), (phi0_i, phi0_j) = u(), u()
        return Gear(name=name, body_i=i, radius_i=radius_i, body_j=j, radius_j=radius_j, phi0_i=phi0_i, phi0_j=phi0_j)
    ends: dict[str, Any] = {"name": name, "body_i": i, "point_i": u(), "body_j": j, "point_j": u()}
    made: dict[str, Callable[[], Constraint]] = {
        "revolute": lambda: Revolute(**ends),
        "fixed": lambda: Fixed(angle=0.7, **ends),
        "prismatic": lambda: Prismatic(axis_i=u(), angle=-2.3, **ends),
        "point_on_line": lambda: PointOnLine(axis_i=u(), **ends),
        "distance": lambda: Distance(length=1.25, **ends),
        "angle": lambda: AngleDriver(name=name, body=j, relative_to=i, law=law),
        "x": lambda: XDriver(name=name, body=moving, point=u(), law=law),
        "y": lambda: YDriver(name=name, body=moving, point=u(), law=law),
        "distance driver": lambda: DistanceDriver(law=law, **ends),
        "disc": lambda: Cam(profile=Disc(radius=0.8), follower="roller", roller_radius=0.3, **ends),
        "face on disc": lambda: Cam(profile=Disc(radius=0.8), follower="flat", normal_j=u(), **ends),
    }
    return made[kind]()


def loose_scene(*kinds: str) -> Scene:
    """Return two bodies held by each kind against the ground, each other, and the ground again; nothing assembles."""
    draw = np.random.default_rng(7)

    def u() -> Any:
        return tuple(draw.uniform(-1.0, 1.0, 2).tolist())

    values = [
        constraint(kind, f"{kind} {i} {j}", i, j, u)
        for kind in dict.fromkeys((*kinds, "revolute"))
        for i, j in (("ground", "a"), ("a", "b"), ("b", "ground"))
    ]
    drivers = [c for c in values if isinstance(c, DRIVER_TYPES)]
    joints = [c for c in values if c not in drivers]
    bodies = (Body(name="a", estimate=(0.0, 0.0, 0.0)), Body(name="b", estimate=(0.0, 0.0, 0.0)))
    return Scene(mechanism=Mechanism(bodies, tuple(joints), tuple(drivers)), times=(0.0,))


def worst_row(scene: Scene, kinds: tuple[str, ...], level: Level) -> float:
    """Return the largest error / allowed of a level over 40 random (q, qd, t), of the rows of `kinds`.

    A row adds up at most 8 terms on either side, each known to 1 ulp: 16 u times the size of a term. That is |d| < 7 m
    in these scenes (|d|^2 for a driven distance), times a rate, or a rate squared. A form F carries the error of x on,
    by F' into a value and by F'' x_q into a slope.
    """
    system = compile_system(scene.mechanism)
    first = {p.constraint.name: p.row for p in system.placed}
    wanted = {c.name for c in scene.mechanism.constraints if c.name.rsplit(" ", 2)[0] in kinds}
    cylinders = {d.name for d in scene.mechanism.drivers if isinstance(d, DistanceDriver)}
    model = Exudyn().constraints(scene)
    draw = np.random.default_rng(11)
    ratios = []
    for _ in range(40):
        q, qd, t = draw.uniform(-2.0, 2.0, system.n), draw.uniform(-3.0, 3.0, system.n), float(draw.uniform(0.0, 3.0))
        answers: dict[Level, Callable[[], Any]] = {
            Level.RESIDUAL: lambda q=q, t=t: model.residual(q, t),
            Level.JACOBIAN: lambda q=q, t=t: model.jacobian(q, t),
            Level.CONSTRAINT_VELOCITY: lambda q=q, qd=qd, t=t: model.constraint_velocity(q, qd, t),
            Level.DRIFT: lambda q=q, qd=qd, t=t: model.drift(q, qd, t),
        }
        rows = answers[level]()
        x, x_q, nu, gamma = system.phi(q, t), system.phi_q(q, t), system.nu(q, t), system.gamma(q, qd, t)
        for row in (r for r in model.rows if r.constraint in wanted):
            k = first[row.constraint] + row.row
            rate = float(x_q[k] @ qd - nu[k])
            size = 49.0 if row.constraint in cylinders else 7.0
            e = 16 * U * size
            f0, f1, f2 = (float(row.factor * row.form(x[k], order)) for order in range(3))
            speed = float(np.abs(qd).max())
            expected, allowed = {
                Level.RESIDUAL: (f0, abs(f1) * e + 16 * U),  # a sine row is itself a product of unit vectors
                Level.JACOBIAN: (f1 * x_q[k], (abs(f1) + abs(f2) * size) * e),
                Level.CONSTRAINT_VELOCITY: (f1 * rate, (abs(f1) + abs(f2) * size) * e * speed),
                Level.DRIFT: (f1 * gamma[k] - f2 * rate**2, (abs(f1) + abs(f2) * size) * e * speed**2),
            }[level]
            ratios.append(float(np.max(np.abs(rows[row.engine_row] - expected))) / allowed)
    model.close()
    return max(ratios)


@pytest.mark.parametrize(("kind", "level"), [(kind, level) for kind in KINDS for level in ROWS])
def test_rows_that_are_declared_agree_with_the_reference_at_unassembled_configurations(kind: str, level: Level) -> None:
    elements = elements_of(c for c in loose_scene(kind).mechanism.constraints if c.name.startswith(kind))

    assert all(CAPABILITIES[e.key][level].support in (Support.NATIVE, Support.DERIVED) for e in elements)
    assert worst_row(loose_scene(kind), (kind,), level) < 1.0


def test_every_row_of_ours_is_mapped_once_and_the_others_of_exudyn_are_empty() -> None:
    scene = loose_scene(*KINDS)
    model = ExudynModel(scene.mechanism.bodies, scene.mechanism.constraints)
    ours = [(c.name, k) for c in scene.mechanism.constraints for k in range(c.rows)]
    empty = sorted(set(range(model.m)) - {row.engine_row for row in model.rows})
    q, qd = np.linspace(0.3, 1.1, model.n), np.linspace(-2.0, 1.0, model.n)

    assert [(row.constraint, row.row) for row in model.rows] == ours
    assert len(empty) == 6  # the second row of each point_on_line and face on a disc
    assert not np.any(model.jacobian(q, 0.2)[empty])
    assert not np.any([f[empty] for f in (model.residual(q, 0.2), model.drift(q, qd, 0.2))])


@pytest.mark.parametrize("kind", KINDS)
def test_drift_is_the_derivative_of_exudyns_own_velocity_rows(kind: str) -> None:
    """gamma = -d/de (phi_q qd + phi_t)(q + e qd, qd, t + e): ties the point accelerations to the joint itself.

    The central difference over +-h ... +-4h errs by h^8/630 of the ninth derivative, below 1e-14 for h = 0.01 and
    rates of order 1 (distances stay above 0.5), and by rounding of u/h of the rows, about 1e-13.
    """
    scene = loose_scene(kind)
    model = Exudyn().constraints(scene)
    q, qd, t = np.array([1.4, 0.9, 0.3, -1.1, 0.2, -0.4]), np.array([0.3, -0.8, 0.9, 0.5, 0.7, -0.6]), 0.4
    h = 0.01
    weights = {1: 4 / 5, 2: -1 / 5, 3: 4 / 105, 4: -1 / 280}
    slope = sum(
        sign * w * model.constraint_velocity(q + sign * k * h * qd, qd, t + sign * k * h) / h
        for k, w in weights.items()
        for sign in (1, -1)
    )

    assert np.max(np.abs(model.drift(q, qd, t) + slope)) < 1e-12


def test_returned_arrays_are_copies() -> None:
    model = Exudyn().constraints(loose_scene("revolute"))
    q = np.linspace(0.1, 0.6, 6)
    first = model.jacobian(q, 0.0)
    kept = first.copy()
    model.jacobian(q + 1.0, 0.0)

    assert np.array_equal(kept, first)


def test_the_table_names_every_element_but_three_at_every_level() -> None:
    built = {e.key for e in elements_of(loose_scene(*KINDS).mechanism.constraints)}

    planar = set(ELEMENTS) - {"points coincide by a law", "rolling on a line", "contact"} - set(OF_SPACE)
    assert built == planar == set(CAPABILITIES) - set(OF_SPACE)
    assert set(OF_SPACE) <= set(CAPABILITIES)
    assert all(set(levels) == set(Level) for levels in CAPABILITIES.values())


def test_every_support_that_is_not_native_says_why() -> None:
    capabilities = [c for levels in CAPABILITIES.values() for c in levels.values()]

    assert all(c.reason for c in capabilities if c.support is not Support.NATIVE)


def test_two_coinciding_points_of_a_distance_joint_are_an_engine_error() -> None:
    scene = loose_scene("distance")
    rod = next(c for c in scene.mechanism.joints if isinstance(c, Distance) and c.body_i == "ground")
    (xi, yi), (xj, yj) = rod.point_i, rod.point_j
    model = Exudyn().constraints(scene)
    q = np.array([xi - xj, yi - yj, 0.0, 0.0, 0.0, 0.0])

    for ask in (model.residual, model.jacobian):
        with pytest.raises(EngineError, match="distance of the markers is zero"):
            ask(q, 0.0)


def test_a_driven_distance_that_is_not_positive_is_an_engine_error_that_names_driver_and_time() -> None:
    model = Exudyn().constraints(loose_scene("distance driver"))
    model.clock.laws[0] = (Sinusoid(amplitude=1.0, angular_frequency=1.0, offset=-2.0), 0.0, 1.0)

    with pytest.raises(EngineError, match=r"driver 'distance driver ground a' at t = 0\.5: .*must be positive"):
        model.residual(np.zeros(6), 0.5)


def test_a_closed_model_is_freed() -> None:
    """User functions that reached back to the system would keep it for ever: the system owns them."""
    model = Exudyn().constraints(loose_scene("angle"))
    model.residual(np.zeros(6), 0.0)
    clock, whole = weakref.ref(model.clock), weakref.ref(model)
    model.close()
    del model
    gc.collect()

    assert whole() is None
    assert clock() is None


# Planted faults


def lengths_off(m: pytest.MonkeyPatch) -> None:
    """Make every coordinate of a point too long by 1e-9."""
    local = exudyn_readings.Readings.local
    m.setattr(exudyn_readings.Readings, "local", lambda self, body, p: [c * (1 + 1e-9) for c in local(self, body, p)])


def rate_missing(m: pytest.MonkeyPatch) -> None:
    """Do not tell exudyn the rate of a driver."""
    add = exudyn_parts.item.CoordinateConstraint

    def without_rate(**more: Any) -> Any:
        more.pop("offsetUserFunction_t", None)
        return add(**more)

    m.setattr(exudyn_parts.item, "CoordinateConstraint", without_rate)


def coriolis_missing(m: pytest.MonkeyPatch) -> None:
    """Leave the mixed term out of the drift of a product."""
    whole = exudyn_parts.product_drift
    m.setattr(exudyn_parts, "product_drift", lambda a, b: whole(a, b) + 2.0 * (a[1][0] * b[1][0] + a[1][1] * b[1][1]))


def sign_of_velocity_rows(m: pytest.MonkeyPatch) -> None:
    """Give exudyn's velocity residual with the wrong sign."""
    whole = ExudynModel.constraint_velocity
    m.setattr(ExudynModel, "constraint_velocity", lambda self, q, qd, t: -whole(self, q, qd, t))


def stale_laws(m: pytest.MonkeyPatch) -> None:
    """Evaluate the laws once and keep them."""
    whole = exudyn_parts.Clock.set

    def once(self: Any, t: float, order: int) -> None:
        if np.isnan(self.values[0][0]):
            whole(self, t, 2)

    m.setattr(exudyn_parts.Clock, "set", once)


def swapped_markers(m: pytest.MonkeyPatch) -> None:
    """Take the two bodies of a revolute joint in the wrong order."""
    points = exudyn_parts.Builder.points
    m.setattr(exudyn_parts.Builder, "points", lambda self, c: points(self, c)[::-1])


FAULTS = [
    (lengths_off, "revolute", Level.RESIDUAL),
    (rate_missing, "angle", Level.CONSTRAINT_VELOCITY),
    (rate_missing, "x", Level.CONSTRAINT_VELOCITY),
    (coriolis_missing, "point_on_line", Level.DRIFT),
    (coriolis_missing, "distance", Level.DRIFT),
    (sign_of_velocity_rows, "prismatic", Level.CONSTRAINT_VELOCITY),
    (stale_laws, "y", Level.RESIDUAL),
    (swapped_markers, "revolute", Level.RESIDUAL),
    (swapped_markers, "fixed", Level.JACOBIAN),
]


@pytest.mark.parametrize(("fault", "kind", "level"), FAULTS)
def test_a_planted_fault_is_caught(
    fault: Callable[[pytest.MonkeyPatch], None], kind: str, level: Level, monkeypatch: pytest.MonkeyPatch
) -> None:
    assert worst_row(loose_scene(kind), (kind,), level) < 1.0

    fault(monkeypatch)

    assert not worst_row(loose_scene(kind), (kind,), level) < 1.0


def test_bodies_in_another_order_than_the_columns_are_an_engine_error(monkeypatch: pytest.MonkeyPatch) -> None:
    build = exudyn_model.Builder
    monkeypatch.setattr(exudyn_model, "Builder", lambda mbs, bodies, *rest: build(mbs, bodies[::-1], *rest))

    with pytest.raises(EngineError, match="keeps the coordinates of body 'a' in columns"):
        Exudyn().constraints(loose_scene("revolute"))
