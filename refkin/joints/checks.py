"""What is wrong with a mechanism, or with a scene: all of it at once, in the paths of a scene file."""

from __future__ import annotations

import math
from collections.abc import Iterable, Iterator, Sequence
from operator import ge
from typing import Any

from refkin.errors import Fault
from refkin.joints.annotations import finite_faults, is_number, type_faults
from refkin.joints.base import PLANE, Constraint, Kind
from refkin.joints.elements import BODIES, GROUND
from refkin.joints.spatial_base import looked_up as looked_up


class WrongCount(Fault):
    """A list of another length; its value are the numbers that stand in the file."""


def kind_of(m: Any) -> Kind:
    """Return what the bodies of a mechanism are: what its first joint is for."""
    return next((c.kind for c in (*m.joints, *m.drivers)), PLANE)


def mechanism_faults(m: Any) -> Iterator[Fault]:
    """Yield all that is wrong with a mechanism, or with what has its attributes; paths are those of a scene file."""
    bodies, joints, drivers = m.bodies, m.joints, m.drivers
    if not bodies:
        yield Fault("body", None, "at least one body")
    groups: dict[str, Sequence[Any]] = {"body": bodies, "joint": joints, "driver": drivers}
    if strange := [fault for kind, items in groups.items() for fault in type_faults(kind, items)]:
        return (yield from strange)  # what else may be wrong cannot be asked
    taken = {"body": [GROUND], "joint": [], "driver": [c.name for c in joints]}
    for kind, items in groups.items():
        yield from (*_name_faults(kind, items, taken[kind]), *finite_faults(kind, tuple(items)))
    own, constraints = kind_of(m), _paths(m)
    for k, body in enumerate(bodies):
        if (estimate := body.estimate) is not None:
            path = f"body[{k}].estimate"
            yield from _count_faults(path, estimate, own.width)
            if len(estimate) == own.width and any(own.still) and not any(estimate[own.dimension :]):
                yield Fault(path, list(estimate), "Euler parameters that are not all 0")
    known = dict.fromkeys((GROUND, *(b.name for b in bodies if isinstance(b.name, str))))
    for path, c in constraints:
        if c.kind is not own:
            yield Fault(f"{path}.type", str(c.type), f"one of a {own.name} mechanism, as the others are")
            return
        for key in () if c.shares or hasattr(c, "joint") else ("body", *BODIES, "relative_to"):  # else its joints'
            if not (isinstance(body := getattr(c, key, GROUND), str) and body in known):
                yield _no_body(f"{path}.{key}", body, known)
        if c.bodies[0] == c.bodies[1]:
            pair = "two different bodies" + ", this one and `relative_to`" * hasattr(c, "relative_to")
            yield Fault(f"{path}.body" if hasattr(c, "body") else path, c.bodies[0], pair)
        yield from c.faults(path)
    rows = [c for _, c in constraints]
    missing = own.width * len(bodies) - sum(c.independent - c.parameters for c in (*rows, *own.own_rows(bodies, rows)))
    if bodies and missing > 0:
        yield Fault("driver", None, f"{missing} more constraint{'s' * (missing > 1)}: add drivers")


def scene_faults(scene: Any) -> Iterator[Fault]:
    """Yield all that is wrong with a scene, or with what has its attributes, beyond its mechanism."""
    times, bodies_wanted, bodies = scene.times, scene.bodies_wanted, scene.mechanism.bodies
    names = tuple(b.name for b in bodies)
    if not all(map(is_number, times)):
        return (yield Fault("times", list(times), "numbers [s]"))
    numbers = [*filter(math.isfinite, times)]
    if not times:
        yield Fault("times", [], "at least one time")
    if len(numbers) < len(times):
        yield Fault("times", list(times), "finite times")
    if any(map(ge, numbers, numbers[1:])):
        yield Fault("times", list(times), "strictly increasing times")
    if bodies_wanted is not None and not bodies_wanted:
        yield Fault("bodies_wanted", [], "at least one body, or no such key for all of them")
    for k, body in enumerate(bodies_wanted or ()):
        if body not in names:
            yield _no_body(f"bodies_wanted[{k}]", body, names)
        elif body in bodies_wanted[:k]:
            yield Fault(f"bodies_wanted[{k}]", body, "each body once")
    if strange := [*type_faults("point", scene.points)]:
        return (yield from strange)
    yield from _name_faults("point", scene.points, names)
    yield from finite_faults("point", tuple(scene.points))
    for k, point in enumerate(scene.points):
        yield from _count_faults(f"point[{k}].position", point.position, kind_of(scene.mechanism).dimension)
        if point.body not in names:
            yield _no_body(f"point[{k}].body", point.body, names)
    for path, c in _paths(scene.mechanism) if times and len(numbers) == len(times) else ():
        for key, law in zip(c.law_keys, c.laws, strict=True):
            low, high = (-math.inf, math.inf) if list(law.faults("")) else law.domain()
            if not (low <= times[0] and times[-1] <= high):
                yield Fault(f"{path}.{key}.argument", [low, high], f"a table from {times[0]} to {times[-1]}")


def _paths(m: Any) -> list[tuple[str, Constraint]]:
    paths = [f"{kind}[{k}]" for kind, group in (("joint", m.joints), ("driver", m.drivers)) for k in range(len(group))]
    return list(zip(paths, looked_up(m), strict=True))


def _no_body(path: str, name: str, known: Iterable[str]) -> Fault:
    names = tuple(map(str, filter(None, dict.fromkeys(known))))
    return Fault(path, name, f"a body of the scene: {', '.join(names)}", choices=names)


def _name_faults(kind: str, items: Sequence[Any], taken: Sequence[str] = ()) -> Iterator[Fault]:
    used = set(taken)
    for k, item in enumerate(items):
        name = item.name if isinstance(item.name, str) else ""
        if not name or name in used:
            expected = "a name not used before" if name in used else "a name that is not empty"
            yield Fault(f"{kind}[{k}].name", item.name, expected)
        used |= {name} - {""}


def _count_faults(path: str, numbers: Sequence[float], count: int) -> Iterator[Fault]:
    if len(numbers) != count:
        yield WrongCount(path, list(numbers), f"{count} numbers, not {len(numbers)}")
