"""What is asked: Body, Mechanism, Scene. Frozen, named, validated on creation; plain numbers, no arrays."""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, fields, replace
from enum import StrEnum
from itertools import pairwise
from typing import Any

import numpy as np

from refkin.errors import Fault, InvalidScene
from refkin.joints import GROUND, Constraint, Driver, Pair, Unit
from refkin.motion_laws import STRICT


class Member(StrEnum):
    """A word that shows itself as a program writes it, so that a scene's text can be pasted back."""

    def __repr__(self) -> str:
        return f"{type(self).__name__}.{self.name}"


class Effect(Member):
    """What a scene may call for beyond position, which is always there."""

    VELOCITY = "velocity"
    ACCELERATION = "acceleration"


class Evidence(Member):
    """What a scene may ask as evidence beyond status and residual, which are always there."""

    CONDITION = "condition"
    CERTIFICATE = "certificate"


@dataclass(frozen=True, kw_only=True)
class Body:
    """A rigid body of the plane; `estimate` is (x [m], y [m], phi [rad]) at the first time, if known."""

    name: str
    estimate: tuple[float, float, float] | None = None
    __pydantic_config__ = STRICT


@dataclass(frozen=True, kw_only=True)
class Point:
    """A point of a body whose motion is wanted; `position` [m] in the body's own frame."""

    name: str
    body: str
    position: Pair
    __pydantic_config__ = STRICT


@dataclass(frozen=True)
class Mechanism:
    """Bodies, joints and drivers; InvalidScene lists all that is wrong with them (`mechanism_faults`)."""

    bodies: tuple[Body, ...]
    joints: tuple[Constraint, ...]
    drivers: tuple[Driver, ...] = ()

    def __post_init__(self) -> None:
        if faults := list(mechanism_faults(self)):
            raise InvalidScene(faults, "mechanism")

    @property
    def constraints(self) -> tuple[Constraint, ...]:
        """Joints, then drivers: the order of the rows."""
        return (*self.joints, *self.drivers)

    def size(self) -> float:
        """Return the power of two nearest the largest distance of two joint points on one body, ground included [m].

        A massless link (distance joint) counts with its length. 1 if no body has two points.
        """
        points: dict[str, list[Pair]] = {}
        for constraint in self.constraints:
            for body, point in constraint.points():
                points.setdefault(body, []).append(point)
        largest = max([0.0, *map(_diameter, points.values()), *(c.reach() for c in self.constraints)])
        if largest == 0.0:
            return 1.0
        mantissa, exponent = math.frexp(largest)
        return math.ldexp(1.0, exponent if mantissa > math.sqrt(0.5) else exponent - 1)

    def unit(self) -> Unit:
        """Return the unit every solve runs in: the size, and the first joint point on the ground as origin."""
        on_ground = (point for c in self.constraints for body, point in c.points() if body == GROUND)
        return Unit(self.size(), next(on_ground, (0.0, 0.0)))


def _diameter(points: Sequence[Pair]) -> float:
    """Return the largest distance of two points; of many, only those far enough from their middle are compared."""
    if len(points) > 32:
        middle = (np.min(points, axis=0) + np.max(points, axis=0)) / 2
        away = np.hypot(*(np.array(points) - middle).T)
        least = max(math.dist(p, points[int(np.argmax(away))]) for p in points) - (1 + 1e-12) * np.max(away)
        points = [p for p, a in zip(points, away, strict=True) if a >= least]
    return max((math.dist(a, b) for k, a in enumerate(points) for b in points[:k]), default=0.0)


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
        object.__setattr__(self, "times", tuple(self.times))  # a row of numbers will do
        if faults := list(scene_faults(self)):
            raise InvalidScene(faults, self.name)

    @property
    def wanted(self) -> tuple[str, ...]:
        return self.bodies_wanted if self.bodies_wanted is not None else tuple(b.name for b in self.mechanism.bodies)

    def _repr_svg_(self) -> str | None:
        import refkin  # a notebook asks for it; what draws stands above

        asked = replace(self, bodies_wanted=None, effects=frozenset(), evidence=frozenset())
        return refkin.solve(asked)._repr_svg_()


def mechanism_faults(m: Any) -> Iterator[Fault]:
    """Yield all that is wrong with a mechanism, or with what has its attributes; paths are those of a scene file."""
    bodies, joints, drivers = m.bodies, m.joints, m.drivers
    if not bodies:
        yield Fault("body", None, "at least one body")
    groups: dict[str, Sequence[Any]] = {"body": bodies, "joint": joints, "driver": drivers}
    taken = {"body": [GROUND], "joint": [], "driver": [c.name for c in joints]}
    for kind, items in groups.items():
        yield from (*_name_faults(kind, items, taken[kind]), *_finite_faults(kind, tuple(items)))
    known = dict.fromkeys((GROUND, *(b.name for b in bodies)))
    for path, c in _paths(m):
        for key in ("body", "body_i", "body_j", "relative_to"):
            body = getattr(c, key, None)
            if body is not None and body not in known:
                yield Fault(f"{path}.{key}", body, f"a body of the scene: {', '.join(known)}")
        if c.bodies[0] == c.bodies[1]:
            yield Fault(path, c.bodies[0], "two different bodies")
        yield from c.faults(path)
    missing = 3 * len(bodies) - sum(c.rows - c.parameters for c in (*joints, *drivers))
    if bodies and missing > 0:
        yield Fault("driver", None, f"{missing} more constraint{'s' * (missing > 1)}: add drivers")


def scene_faults(scene: Any) -> Iterator[Fault]:
    """Yield all that is wrong with a scene, or with what has its attributes, beyond its mechanism."""
    times, bodies_wanted, bodies = scene.times, scene.bodies_wanted, scene.mechanism.bodies
    names = tuple(b.name for b in bodies)
    one_of = f"a body of the scene: {', '.join(names)}"
    finite = all(math.isfinite(t) for t in times)
    if not times:
        yield Fault("times", [], "at least one time")
    if not finite:
        yield Fault("times", list(times), "finite times")
    elif any(b <= a for a, b in pairwise(times)):
        yield Fault("times", list(times), "strictly increasing times")
    if bodies_wanted is not None and not bodies_wanted:
        yield Fault("bodies_wanted", [], "at least one body, or no such key for all of them")
    for k, body in enumerate(bodies_wanted or ()):
        if body not in names:
            yield Fault(f"bodies_wanted[{k}]", body, one_of)
        elif body in bodies_wanted[:k]:
            yield Fault(f"bodies_wanted[{k}]", body, "each body once")
    yield from _name_faults("point", scene.points)
    yield from _finite_faults("point", tuple(scene.points))
    for k, point in enumerate(scene.points):
        if point.body not in names:
            yield Fault(f"point[{k}].body", point.body, one_of)
    for path, c in _paths(scene.mechanism) if times and finite else ():
        for key, law in zip(c.law_keys, c.laws, strict=True):
            low, high = (-math.inf, math.inf) if list(law.faults("")) else law.domain()
            if not (low <= times[0] and times[-1] <= high):
                yield Fault(f"{path}.{key}.argument", [low, high], f"a table from {times[0]} to {times[-1]}")


def _paths(m: Any) -> list[tuple[str, Constraint]]:
    return [
        (f"{kind}[{k}]", c) for kind, group in (("joint", m.joints), ("driver", m.drivers)) for k, c in enumerate(group)
    ]


def _name_faults(kind: str, items: Sequence[Any], taken: Sequence[str] = ()) -> Iterator[Fault]:
    used = set(taken)
    for k, item in enumerate(items):
        if not item.name or item.name in used:
            expected = "a name not used before" if item.name else "a name that is not empty"
            yield Fault(f"{kind}[{k}].name", item.name, expected)
        used.add(item.name)


def _finite_faults(path: str, item: Any) -> Iterator[Fault]:
    """Yield every number in a dataclass, at any depth, that is not finite."""
    if isinstance(item, float) and not math.isfinite(item):
        yield Fault(path, item, "a finite number")
    elif isinstance(item, tuple):
        for k, part in enumerate(item):
            yield from _finite_faults(f"{path}[{k}]", part)
    elif hasattr(item, "__dataclass_fields__"):
        for key in fields(item):
            yield from _finite_faults(f"{path}.{key.name}", getattr(item, key.name))
