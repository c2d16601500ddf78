"""The exudyn adapter: its rows against refkin's formulas, its motions against closed forms, faults that must not pass."""

from __future__ import annotations

import gc
import weakref
from collections.abc import Callable, Iterator
from dataclasses import dataclass, replace
from typing import Any

import mpmath
import numpy as np
import pytest
from mpmath import mp

from crosscheck.engines import Engine, EngineError, Level, Support, load, refusals, table_key
from crosscheck.engines.exudyn_engine import CAPABILITIES, SHIPPED, STATIC, Exudyn
from crosscheck.engines.exudyn_model import ExudynModel
from refkin.joints import (
    DRIVER_TYPES,
    JOINT_TYPES,
    AngleDriver,
    Constraint,
    Distance,
    DistanceDriver,
    Fixed,
    PointOnLine,
    Prismatic,
    Revolute,
    Unit,
    XDriver,
    YDriver,
)
from refkin.model import Body, Effect, Mechanism, Scene
from refkin.motion import Motion, Seeding, Status
from refkin.motion_laws import Polynomial, Sinusoid, Table
from refkin.system import compile_system

U = 2.0**-53
ROWS = (Level.RESIDUAL, Level.JACOBIAN, Level.CONSTRAINT_VELOCITY, Level.DRIFT)
KINDS = ("revolute", "fixed", "prismatic", "point_on_line", "distance", "angle", "x", "y", "distance driver")
DRIVERS = ("angle", "x", "y", "distance driver")
KINDS_AND_LEVELS = [(kind, level) for kind in KINDS for level in ROWS]


# Rows at configurations that are not assembled


def constraint(kind: str, name: str, i: str, j: str, u: Callable[[], Any]) -> Constraint:
    """Return a constraint of a kind between two bodies, its numbers drawn by `u`."""
    law = Sinusoid(offset=2.0, amplitude=0.5, angular_frequency=2.0, phase=0.3)
    moving = i if j == "ground" else j
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
    }
    return made[kind]()


def loose_scene(*kinds: str) -> Scene:
    """Return two bodies held by each kind against the ground, each other, and the ground again; nothing assembles."""
    draw = np.random.default_rng(7)

    def u() -> Any:
        return tuple(draw.uniform(-1.0, 1.0, 2).tolist())

    found = [
        constraint(kind, f"{kind} {i} {j}", i, j, u)
        for kind in dict.fromkeys((*kinds, "revolute"))
        for i, j in (("ground", "a"), ("a", "b"), ("b", "ground"))
    ]
    drivers = [c for c in found if isinstance(c, DRIVER_TYPES)]
    joints = [c for c in found if c not in drivers]
    bodies = (Body(name="a", estimate=(0.0, 0.0, 0.0)), Body(name="b", estimate=(0.0, 0.0, 0.0)))
    return Scene(mechanism=Mechanism(bodies, tuple(joints), tuple(drivers)), times=(0.0,))


def worst_row(scene: Scene, kinds: tuple[str, ...], level: Level) -> float:
    """Return the largest error / allowed of a level over 40 random (q, qd, t), of the rows of `kinds`.

    A row adds up at most 8 terms on either side, each known to 1 ulp: 16 u times the size of a term. That is |d| < 7 m in
    these scenes (|d|^2 for a driven distance), times a rate, or a rate squared. A form F carries the error of x on, by F'
    into a value and by F'' x_q into a slope.
    """
    system = compile_system(scene.mechanism)
    first = {p.constraint.name: p.row for p in system.placed}
    wanted = {c.name for c in scene.mechanism.constraints if table_key(c) in kinds}
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
                Level.RESIDUAL: (f0, abs(f1) * e),
                Level.JACOBIAN: (f1 * x_q[k], (abs(f1) + abs(f2) * size) * e),
                Level.CONSTRAINT_VELOCITY: (f1 * rate, (abs(f1) + abs(f2) * size) * e * speed),
                Level.DRIFT: (f1 * gamma[k] - f2 * rate**2, (abs(f1) + abs(f2) * size) * e * speed**2),
            }[level]
            ratios.append(float(np.max(np.abs(rows[row.engine_row] - expected))) / allowed)
    model.close()
    return max(ratios)
