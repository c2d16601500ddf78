"""Every kind of joint and driver, between two bodies and from the ground, with every law and every contact."""

from __future__ import annotations

from typing import Any

import numpy as np

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
    Polar,
    Prismatic,
    RackAndPinion,
    Revolute,
    Unit,
    XDriver,
    YDriver,
)
from refkin.model import Body, Mechanism
from refkin.motion_laws import Polynomial, Sinusoid, Table
from refkin.system import System, compile_system

LAW = Polynomial(coefficients=(2.0, -0.7, 0.4, 0.1))
WAVE = Sinusoid(amplitude=0.3, angular_frequency=1.7, offset=2.0, phase=0.4)
KNOTS = Table(argument=(-9.0, -1.0, 0.2, 1.0, 9.0), value=(2.0, 0.4, 1.1, 1.0, 2.7))
BETWEEN: dict[str, Any] = {"name": "c", "body_i": "a", "point_i": (0.3, -0.2), "body_j": "b", "point_j": (-0.4, 0.7)}
GROUNDED: dict[str, Any] = {**BETWEEN, "body_i": "ground"}
FOLLOWERS: tuple[dict[str, Any], ...] = (
    {"follower": "flat", "normal_j": (-0.3, 1.1)},
    {"follower": "point"},
    {"follower": "roller", "roller_radius": 0.4},
)
UNITS = (Unit(), Unit(0.25, (3.0, -2.0)))
TIMES = (0.37, -0.8)


def constraints() -> list[Constraint]:
    """Return one of each kind, at least; no length, angle or rate in them is 0 or 1, where a factor would hide."""
    return [
        *(Revolute(**ends) for ends in (BETWEEN, GROUNDED)),
        *(Revolute(**ends, offset_law=(LAW, WAVE)) for ends in (BETWEEN, GROUNDED)),
        *(Fixed(**ends, angle=0.4) for ends in (BETWEEN, GROUNDED)),
        *(PointOnLine(**ends, axis_i=(3.0, -1.5)) for ends in (BETWEEN, GROUNDED)),
        *(Prismatic(**ends, axis_i=(0.2, 0.9), angle=-1.1) for ends in (BETWEEN, GROUNDED)),
        *(Distance(**ends, length=1.3) for ends in (BETWEEN, GROUNDED)),
        Gear(name="c", body_i="a", radius_i=0.3, body_j="b", radius_j=-0.7, phi0_i=0.2, phi0_j=-0.4),
        Gear(name="c", body_i="ground", radius_i=0.3, body_j="b", radius_j=0.7, phi0_i=0.2),
        Gear(name="c", body_i="b", radius_i=0.3, body_j="ground", radius_j=0.7, phi0_j=-0.4, carrier="a"),
        RackAndPinion(**BETWEEN, axis_i=(3.0, -1.5), radius=0.3, phi0=0.4, s0=0.2),
        RackAndPinion(**GROUNDED, axis_i=(0.0, -2.0), radius=-0.6),
        *(Cam(**BETWEEN, profile=Disc(radius=0.8), **follower) for follower in FOLLOWERS),
        *(Cam(**GROUNDED, profile=Disc(radius=0.8), **follower) for follower in FOLLOWERS),
        *(Cam(**BETWEEN, profile=Polar(law=law), **follower) for law in (LAW, WAVE, KNOTS) for follower in FOLLOWERS),
        *(Cam(**GROUNDED, profile=Polar(law=WAVE), **follower) for follower in FOLLOWERS),
        AngleDriver(name="c", body="b", law=LAW),
        AngleDriver(name="c", body="b", relative_to="a", rate_law=WAVE, initial=0.3),
        XDriver(name="c", body="b", point=(0.3, 0.1), law=WAVE),
        YDriver(name="c", body="a", point=(-0.2, 0.5), rate_law=LAW, initial=-0.6),
        *(DistanceDriver(**ends, law=law) for ends, law in ((BETWEEN, WAVE), (GROUNDED, KNOTS))),
    ]


def name_of(constraint: Constraint) -> str:
    """Return what a message calls a case."""
    profile = getattr(constraint, "profile", None)
    contact = f" {constraint.follower} on {profile.kind}" if profile is not None else ""  # type: ignore[attr-defined]
    carried = " on a carrier" * ("a" in constraint.bodies[2:])
    return f"{constraint.type}{contact} from {constraint.bodies[0]}{carried}"


def system_of(constraint: Constraint, unit: Unit) -> tuple[System, slice]:
    """Return a system in which the constraint's rows come first, filled up with rows that hold nothing of interest."""
    filling = tuple(AngleDriver(name=f"filling{k}", body="a", law=LAW) for k in range(7))
    is_driver = isinstance(constraint, DRIVER_TYPES)
    joints = () if is_driver else (constraint,)
    drivers = (constraint, *filling) if is_driver else filling
    bodies = (Body(name="a"), Body(name="b"))
    return compile_system(Mechanism(bodies, joints, drivers), unit=unit), slice(0, constraint.rows)  # type: ignore[arg-type]


def state(system: System, seed: int = 1) -> tuple[Any, Any, Any]:
    """Return coordinates and two rates, each (n,), of order 1."""
    draw = np.random.default_rng(seed)
    q, qd, qdd = (draw.normal(size=system.n) for _ in range(3))
    return q, qd, qdd
