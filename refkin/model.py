"""What is asked: Body, Mechanism, Scene. Frozen, named, validated on creation; plain numbers, no arrays."""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, fields
from enum import StrEnum
from itertools import pairwise
from typing import Any, ClassVar

from refkin.errors import Fault, InvalidScene
from refkin.joints import GROUND, Constraint, Driver, Pair, Unit
from refkin.motion_laws import STRICT


class Effect(StrEnum):
    """What a scene may call for beyond position, which is always there."""

    VELOCITY = "velocity"
    ACCELERATION = "acceleration"


class Evidence(StrEnum):
    """What a scene may ask as evidence beyond status and residual, which are always there."""

    CONDITION = "condition"
    CERTIFICATE = "certificate"


@dataclass(frozen=True, kw_only=True)
class Body:
    """A rigid body of the plane; `estimate` is (x [m], y [m], phi [rad]) at the first time, if known."""

    name: str
    estimate: tuple[float, float, float] | None = None
    __pydantic_config__: ClassVar[dict[str, Any]] = STRICT


@dataclass(frozen=True, kw_only=True)
class Point:
    """A point of a body whose motion is wanted; `position` [m] in the body's own frame."""

    name: str
    body: str
    position: Pair
    __pydantic_config__: ClassVar[dict[str, Any]] = STRICT


@dataclass(frozen=True)
class Mechanism:
    """Bodies, joints and drivers.

    Raises
    ------
    InvalidScene
        With every fault: a name twice, a body that does not exist, a body held against itself, numbers that are not
        finite, too few constraints.
    """

    bodies: tuple[Body, ...]
    joints: tuple[Constraint, ...]
    drivers: tuple[Driver, ...] = ()

    def __post_init__(self) -> None:
        found = list(mechanism_faults(self.bodies, self.joints, self.drivers))
        if found:
            raise InvalidScene(found, "mechanism")

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
        largest = max(map(_diameter, points.values()), default=0.0)
        largest = max([largest, *(c.reach() for c in self.constraints)])
        if largest == 0.0:
            return 1.0
        mantissa, exponent = math.frexp(largest)
        return math.ldexp(1.0, exponent if mantissa > math.sqrt(0.5) else exponent - 1)

    def unit(self) -> Unit:
        """Return the unit every solve runs in: the size, and the first joint point on the ground as origin."""
        on_ground = (point for c in self.constraints for body, point in c.points() if body == GROUND)
        return Unit(self.size(), next(on_ground, (0.0, 0.0)))


MANY = 32
"""Points on one body of which only the corners of their convex hull are compared."""


def _diameter(points: Sequence[Pair]) -> float:
    """Return the largest distance of two points."""
    if len(points) > MANY:
        points = [*_hull(sorted(points)), *_hull(sorted(points, reverse=True))]
    return max((math.dist(a, b) for k, a in enumerate(points) for b in points[:k]), default=0.0)


def _hull(points: Sequence[Pair]) -> list[Pair]:
    """Return the corners of a convex hull to the left of the way along sorted points, ends included (Andrew)."""
    corners: list[Pair] = []
    for x, y in points:
        while len(corners) > 1:
            (ax, ay), (bx, by) = corners[-2:]
            if (bx - ax) * (y - by) < (by - ay) * (x - bx):
                break
            corners.pop()
        corners.append((x, y))
    return corners


@dataclass(frozen=True, kw_only=True)
class Scene:
    """A mechanism, the times, and what is wanted; what is not called for is not computed.

    Attributes
    ----------
    times : tuple of float
        Strictly increasing [s].
    effects : frozenset of Effect
        Acceleration computes velocity, and reports it only when asked.
    bodies_wanted : tuple of str or None
        The bodies that are reported; all if None.
    evidence : frozenset of Evidence
        What is delivered with every answer beside status and residual.
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
        m = self.mechanism
        found = list(scene_faults(m.bodies, m.joints, m.drivers, self.times, self.points, self.bodies_wanted))
        if found:
            raise InvalidScene(found, self.name)

    @property
    def wanted(self) -> tuple[str, ...]:
        """The names of the bodies that are reported."""
        return self.bodies_wanted if self.bodies_wanted is not None else tuple(b.name for b in self.mechanism.bodies)


def mechanism_faults(
    bodies: Sequence[Body], joints: Sequence[Constraint], drivers: Sequence[Driver]
) -> Iterator[Fault]:
    """Yield everything that is wrong with a mechanism, with paths as in a scene file."""
    if not bodies:
        yield Fault("body", None, "at least one body")
    yield from name_faults("body", [b.name for b in bodies], taken=(GROUND,))
    yield from name_faults("joint", [c.name for c in joints])
    yield from name_faults("driver", [c.name for c in drivers], taken=[c.name for c in joints])
    known = dict.fromkeys((GROUND, *(b.name for b in bodies)))
    for kind, group in (("body", bodies), ("joint", joints), ("driver", drivers)):
        for k, item in enumerate(group):
            yield from finite_faults(f"{kind}[{k}]", item)
    for kind, constraints in (("joint", joints), ("driver", drivers)):
        for k, constraint in enumerate(constraints):
            yield from _constraint_faults(f"{kind}[{k}]", constraint, known)
    missing = 3 * len(bodies) - sum(c.rows - c.parameters for c in (*joints, *drivers))
    if bodies and missing > 0:
        yield Fault("driver", None, f"{missing} more constraint{'s' * (missing > 1)}: add drivers")


def _constraint_faults(path: str, constraint: Constraint, known: dict[str, None]) -> Iterator[Fault]:
    for key in ("body", "body_i", "body_j", "relative_to"):
        body = getattr(constraint, key, None)
        if body is not None and body not in known:
            yield Fault(f"{path}.{key}", body, f"a body of the scene: {', '.join(known)}")
    if constraint.bodies[0] == constraint.bodies[1]:
        yield Fault(path, constraint.bodies[0], "two different bodies")
    yield from constraint.faults(path)


def scene_faults(
    bodies: Sequence[Body],
    joints: Sequence[Constraint],
    drivers: Sequence[Driver],
    times: Sequence[float],
    points: Sequence[Point] = (),
    bodies_wanted: Sequence[str] | None = None,
) -> Iterator[Fault]:
    """Yield everything that is wrong with a scene beyond its mechanism."""
    names = tuple(b.name for b in bodies)
    if not times:
        yield Fault("times", [], "at least one time")
    finite = all(math.isfinite(t) for t in times)
    if not finite:
        yield Fault("times", list(times), "finite times")
    elif any(b <= a for a, b in pairwise(times)):
        yield Fault("times", list(times), "strictly increasing times")
    if bodies_wanted is not None and not bodies_wanted:
        yield Fault("bodies_wanted", [], "at least one body, or no such key for all of them")
    for k, body in enumerate(bodies_wanted or ()):
        if body not in names:
            yield Fault(f"bodies_wanted[{k}]", body, f"a body of the scene: {', '.join(names)}")
        elif body in bodies_wanted[:k]:  # type: ignore[index]
            yield Fault(f"bodies_wanted[{k}]", body, "each body once")
    yield from name_faults("point", [p.name for p in points])
    for k, point in enumerate(points):
        yield from finite_faults(f"point[{k}]", point)
        if point.body not in names:
            yield Fault(f"point[{k}].body", point.body, f"a body of the scene: {', '.join(names)}")
    for kind, constraints in (("joint", joints), ("driver", drivers)):
        for k, constraint in enumerate(constraints):
            for key, law in zip(constraint.law_keys, constraint.laws, strict=True):
                if times and finite and not list(law.faults("")):
                    low, high = law.domain()
                    if not (low <= times[0] and times[-1] <= high):
                        expected = f"a table from {times[0]} to {times[-1]}"
                        yield Fault(f"{kind}[{k}].{key}.argument", [low, high], expected)


def name_faults(kind: str, names: Sequence[str], taken: Sequence[str] = ()) -> Iterator[Fault]:
    """Yield empty names and names that are taken."""
    used = set(taken)
    for k, name in enumerate(names):
        if not name:
            yield Fault(f"{kind}[{k}].name", name, "a name that is not empty")
        elif name in used:
            yield Fault(f"{kind}[{k}].name", name, "a name not used before")
        used.add(name)


def finite_faults(path: str, item: Any) -> Iterator[Fault]:
    """Yield every number in a dataclass, at any depth, that is not finite."""
    if isinstance(item, float) and not math.isfinite(item):
        yield Fault(path, item, "a finite number")
    elif isinstance(item, tuple):
        for k, part in enumerate(item):
            yield from finite_faults(f"{path}[{k}]", part)
    elif hasattr(item, "__dataclass_fields__"):
        for key in fields(item):
            yield from finite_faults(f"{path}.{key.name}", getattr(item, key.name))
