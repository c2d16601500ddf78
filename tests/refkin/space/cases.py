"""Every kind of spatial joint and driver, in every form, between two bodies and from the ground."""

from __future__ import annotations

from typing import Any

import numpy as np

from refkin.joints import (
    Constraint,
    Cylindrical,
    DisplacementDriver,
    Parallel,
    Perpendicular,
    PointOnPlane,
    Screw,
    SpatialAngleDriver,
    SpatialDistance,
    SpatialDistanceDriver,
    SpatialFixed,
    SpatialGear,
    SpatialPointOnLine,
    SpatialPrismatic,
    SpatialRevolute,
    Spherical,
    Unit,
    Universal,
)
from refkin.model import Body, Mechanism
from refkin.motion_laws import Polynomial, Sinusoid
from refkin.system import EVERYTHING, ConstraintRows, System

LAW = Polynomial(coefficients=(1.2, -0.7, 0.4, 0.1))
WAVE = Sinusoid(amplitude=0.3, angular_frequency=1.7, offset=2.0, phase=0.4)
POINTS: dict[str, Any] = {"point_i": (0.3, -0.2, 0.7), "point_j": (-0.4, 0.6, 0.9)}
AXES: dict[str, Any] = {"axis_i": (0.3, 2.0, -0.5), "axis_j": (-1.1, 0.2, 0.4)}
ZEROS: dict[str, Any] = {"zero_i": (1.0, 0.2, 0.3), "zero_j": (0.1, 0.3, 2.0)}
FORMS = ("half", "dot", "printed")


def joints(bodies: dict[str, str]) -> list[Constraint]:
    """Return joints of all types and forms between two bodies."""
    lines: dict[str, Any] = {"name": "c", **bodies, **POINTS, **AXES, **ZEROS}
    points: dict[str, Any] = {"name": "c", **bodies, **POINTS}
    axes: dict[str, Any] = {"name": "c", **bodies, **AXES}
    guided: dict[str, Any] = {**points, "axis_i": AXES["axis_i"]}
    rows: list[Constraint] = [
        Spherical(**points),
        Universal(**points, **AXES),
        Perpendicular(**axes),
        PointOnPlane(**guided),
        SpatialPointOnLine(**guided),
        SpatialDistance(**points, length=1.3),
    ]
    for form in FORMS:
        lines["form"] = form
        rows += [SpatialRevolute(**lines), Cylindrical(**lines), SpatialPrismatic(**lines), SpatialFixed(**lines)]
        rows += [Screw(**lines, pitch=0.3, shift=0.7), Parallel(**axes, **ZEROS, form=form)]
        gear = SpatialGear(name="g", joint_i="c", radius_i=0.4, joint_j="e", radius_j=-1.1, phi0_i=0.3, phi0_j=-0.7)
        other = Cylindrical(**lines | {"name": "e", "body_i": "ground", "body_j": "a"})
        turning = [SpatialRevolute(**lines), other, gear]
        rows += [joint.among(turning) for joint in turning]
    return rows


def drivers(bodies: dict[str, str]) -> list[Constraint]:
    """Return drivers of all types and forms, looked up among their joints."""
    lines: dict[str, Any] = {"name": "c", **bodies, **POINTS, **AXES, **ZEROS}
    turning, screw = Cylindrical(**lines), Screw(**lines, pitch=0.3)
    named: dict[str, Any] = {"name": "d", "joint": "c"}
    return [
        *(SpatialAngleDriver(**named, law=LAW, form=form).among([turning]) for form in ("half", "dot")),
        SpatialAngleDriver(**named, rate_law=LAW, initial=0.4).among([screw]),
        DisplacementDriver(**named, law=WAVE).among([turning]),
        SpatialDistanceDriver(**{**bodies, **POINTS}, name="d", law=WAVE),
    ]


BETWEEN, GROUNDED = {"body_i": "a", "body_j": "b"}, {"body_i": "ground", "body_j": "b"}
CASES = [*joints(BETWEEN), *joints(GROUNDED), *drivers(BETWEEN), *drivers(GROUNDED)]
NAMES = [f"{type(c).__name__} {getattr(c, 'form', '')} {c.bodies[0]}" for c in CASES]


def alone(constraint: Constraint) -> System:
    """Return the rows of one constraint, and those of the unit lengths, of two bodies."""
    unit = Unit(0.5, (0.1, -0.3, 0.2))
    held = Spherical(name="held", body_i="ground", point_i=(0.0, 0.0, 0.0), body_j="a", point_j=(0.0, 0.0, 0.0))
    mechanism = object.__new__(Mechanism)  # one joint is no mechanism
    for key, value in {"bodies": (Body(name="a"), Body(name="b")), "joints": (held, constraint), "drivers": ()}.items():
        object.__setattr__(mechanism, key, value)
    starts = {"a": 0, "b": 7}
    own = range(14, 14 + constraint.parameters + len(constraint.shares))
    where = (*(starts.get(body) for body in constraint.bodies), *own)
    placed = ConstraintRows(constraint, constraint.constants(unit), 0, where)
    return System(mechanism, EVERYTHING, unit, (placed,), 14 + len(own), constraint.rows, mechanism.kind, starts)


def anywhere(system: System, seed: int, length: float | None = None) -> tuple[Any, Any]:
    """Return a pose and rates of everything, with Euler parameters of any length, or of a given one."""
    random = np.random.default_rng(seed)
    q, qd = random.normal(size=(2, system.n))
    for at in (slice(3, 7), slice(10, 14)):
        if length is not None:
            q[at] *= length / np.linalg.norm(q[at])
    return q, qd
