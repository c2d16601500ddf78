"""What is asked: Body, Mechanism, Scene. Frozen, named, validated on creation; plain numbers, no arrays."""

from __future__ import annotations

import math
from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from enum import StrEnum
from functools import cached_property, reduce
from typing import Any

import numpy as np

from refkin.errors import Fault, InvalidScene, expect
from refkin.joints import GROUND, Constraint, Driver, Kind, Unit, with_unit_length
from refkin.joints.annotations import plain
from refkin.joints.checks import kind_of, looked_up, mechanism_faults, scene_faults
from refkin.motion_laws import STRICT


class Member(StrEnum):
    """A word that shows itself as a program writes it, so that a scene's text can be pasted back."""

    def __repr__(self) -> str:
        return f"{type(self).__name__}.{self.name}"


class Effect(Member):
    """What a scene may call for beyond position, which is always there."""

    VELOCITY = "velocity"
    """qd, from phi_q qd = nu."""
    ACCELERATION = "acceleration"
    """qdd, from phi_q qdd = gamma."""


class Evidence(Member):
    """What a scene may ask as evidence beyond status and residual, which are always there."""

    CONDITION = "condition"
    """sigma_min and condition number of phi_q."""
    CERTIFICATE = "certificate"
    """A proved bound of the error of each level."""


@dataclass(frozen=True, kw_only=True)
class Body:
    """A rigid body; `estimate` are its coordinates at the first time, if known.

    In the plane (x [m], y [m], phi [rad]); in space (x, y, z [m], e0, e1, e2, e3), Euler parameters made a unit.
    """

    name: str
    estimate: tuple[float, ...] | None = None
    __pydantic_config__ = STRICT

    def __post_init__(self) -> None:
        object.__setattr__(self, "estimate", with_unit_length(plain(self.estimate)))


@dataclass(frozen=True, kw_only=True)
class Point:
    """A point of a body whose motion is wanted; `position` [m] in the body's own frame."""

    name: str
    body: str
    position: tuple[float, ...]
    __pydantic_config__ = STRICT


@dataclass(frozen=True)
class Mechanism:
    """Bodies, joints and drivers, in lists if need be; InvalidScene has all that is wrong (`mechanism_faults`)."""

    bodies: tuple[Body, ...]
    joints: tuple[Constraint, ...]
    drivers: tuple[Driver, ...] = ()

    def __post_init__(self) -> None:
        for name in ("bodies", "joints", "drivers"):
            object.__setattr__(self, name, plain(getattr(self, name)))
        if faults := list(mechanism_faults(self)):
            raise InvalidScene(faults, "mechanism")

    @cached_property
    def constraints(self) -> tuple[Constraint, ...]:
        """Joints, then drivers: the order of the rows; those that name a joint have it looked up."""
        return looked_up(self)

    @property
    def kind(self) -> Kind:
        """Whether the bodies are of the plane or of space: their joints say so."""
        return kind_of(self)

    def size(self) -> float:
        """Return the power of two nearest the largest distance of two joint points on one body, ground included [m].

        A massless link (distance joint) counts with its length. 1 if no body has two points.
        """
        return self._size

    @cached_property
    def _size(self) -> float:
        points: dict[str, list[Any]] = {}
        for body, point in (end for c in self.constraints for end in c.points()):
            points.setdefault(body, []).append(point)
        largest = max([0.0, *map(_diameter, points.values()), *(c.reach() for c in self.constraints)])
        mantissa, exponent = math.frexp(largest or 1.0)
        return math.ldexp(1.0, exponent if mantissa > math.sqrt(0.5) else exponent - 1)

    def unit(self) -> Unit:
        """Return the unit every solve runs in: the size, and the first joint point on the ground as origin."""
        on_ground = (point for c in self.constraints for body, point in c.points() if body == GROUND)
        return Unit(self.size(), next(on_ground, (0.0,) * self.kind.dimension))


ROUNDED = 2.0**-48
"""Distance of points, in units of their coordinates, up to which a few roundings tell them apart: they are one."""


def _diameter(points: Sequence[Any]) -> float:
    """Return the largest distance of two points; of many, only those far enough from their middle are compared."""
    if len(points) > 32:
        away = reduce(np.hypot, (np.array(points) - (np.min(points, axis=0) + np.max(points, axis=0)) / 2).T)
        least = max(math.dist(p, points[int(np.argmax(away))]) for p in points) - (1 + 1e-12) * np.max(away)
        points = [p for p, a in zip(points, away, strict=True) if a >= least]
    away = ((math.dist(a, b), max(map(abs, a))) for k, a in enumerate(points) for b in points[:k])
    return max((d for d, size in away if d > ROUNDED * size), default=0.0)


@dataclass(frozen=True, kw_only=True)
class Scene:
    """A mechanism, times in increasing order [s], and what is wanted; what is not called for is not computed.

    Acceleration computes velocity, and reports it only when asked. `bodies_wanted` are all if None.
    """

    mechanism: Mechanism
    times: tuple[float, ...]
    name: str = "scene"
    effects: frozenset[Effect] = frozenset({Effect.VELOCITY, Effect.ACCELERATION})
    bodies_wanted: tuple[str, ...] | None = None
    evidence: frozenset[Evidence] = frozenset({Evidence.CONDITION, Evidence.CERTIFICATE})
    points: tuple[Point, ...] = ()

    def __post_init__(self) -> None:
        expect("mechanism", self.mechanism, Mechanism)
        expect("name", self.name, str)
        rows = {"times": tuple, "points": tuple, "effects": frozenset, "evidence": frozenset}
        rows |= {"bodies_wanted": tuple} if self.bodies_wanted is not None else {}
        words, strange = {"effects": Effect, "evidence": Evidence}, list[Fault]()
        for name, kind in rows.items():  # a list will do, or a range
            value = plain(getattr(self, name))
            if isinstance(value, str | bytes) or not isinstance(value, Iterable):
                raise InvalidScene([Fault(name, value, f"a {kind.__name__}, or a list")], self.name)
            known, every = [*words.get(name, ())], tuple(value)
            strange += [Fault(name, x, f"some of {', '.join(known)}") for x in every if known and x not in known]
            object.__setattr__(self, name, every if strange else kind(every))
        if faults := [*strange, *scene_faults(self)]:
            raise InvalidScene(faults, self.name)

    @property
    def wanted(self) -> tuple[str, ...]:
        return self.bodies_wanted if self.bodies_wanted is not None else tuple(b.name for b in self.mechanism.bodies)
