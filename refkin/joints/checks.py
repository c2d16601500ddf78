"""What is wrong with a mechanism, or with a scene: all of it at once, in the paths of a scene file."""

from __future__ import annotations

import math
from collections.abc import Iterable, Iterator, Sequence
from contextlib import suppress
from dataclasses import MISSING, fields, is_dataclass, replace
from functools import cache
from operator import ge
from types import NoneType
from typing import Any, Literal, get_args, get_origin, get_type_hints

import numpy as np

from refkin.errors import Fault
from refkin.joints.base import PLANE, Constraint, Kind
from refkin.joints.drivers import Driver
from refkin.joints.elements import BODIES, GROUND
from refkin.joints.spatial_base import looked_up as looked_up

LONGEST = 1e300
"""Of a length [m], so that the distance of two points is in float64; a law's rate that is not ends in a status."""


class WrongCount(Fault):
    """A list of another length; its value are the numbers that stand in the file."""


def kind_of(m: Any) -> Kind:
    """Return what the bodies of a mechanism are: what its first joint is for."""
    return next((c.kind for c in (*m.joints, *m.drivers)), PLANE)


def plain(given: Any) -> Any:
    """Return what is given with tuples of Python's numbers in the place of lists and arrays, however deep they are."""
    try:
        hash(given)
    except TypeError:
        given = given.tolist() if isinstance(given, np.ndarray) else given
        if isinstance(given, list | tuple):
            return tuple(map(plain, given))
        if _is_instance(given):
            return replace(given, **{key.name: plain(getattr(given, key.name)) for key in fields(given) if key.init})
    return given


def mechanism_faults(m: Any) -> Iterator[Fault]:
    """Yield all that is wrong with a mechanism, or with what has its attributes; paths are those of a scene file."""
    bodies, joints, drivers = m.bodies, m.joints, m.drivers
    if not bodies:
        yield Fault("body", None, "at least one body")
    groups: dict[str, Sequence[Any]] = {"body": bodies, "joint": joints, "driver": drivers}
    if strange := [fault for kind, items in groups.items() for fault in _type_faults(kind, items)]:
        return (yield from strange)  # what else may be wrong cannot be asked
    taken = {"body": [GROUND], "joint": [], "driver": [c.name for c in joints]}
    for kind, items in groups.items():
        yield from (*_name_faults(kind, items, taken[kind]), *_finite_faults(kind, tuple(items)))
    own, constraints = kind_of(m), _paths(m)
    for k, body in enumerate(bodies):
        if (estimate := body.estimate) is not None:
            path = f"body[{k}].estimate"
            yield from _count_faults(path, estimate, own.width)
            if len(estimate) == own.width and any(own.still) and not any(estimate[own.dimension :]):
                yield Fault(path, list(estimate), "Euler parameters that are not all 0")
    known = dict.fromkeys((GROUND, *(b.name for b in bodies)))
    for path, c in constraints:
        if c.kind is not own:
            yield Fault(f"{path}.type", str(c.type), f"one of a {own.name} mechanism, as the others are")
            return
        for key in () if hasattr(c, "joint") else ("body", *BODIES, "relative_to"):  # else its joint's
            if (body := getattr(c, key, GROUND)) not in known:
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
    if not all(map(_is_number, times)):
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
    if strange := [*_type_faults("point", scene.points)]:
        return (yield from strange)
    yield from _name_faults("point", scene.points, names)
    yield from _finite_faults("point", tuple(scene.points))
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
        if not (isinstance(item.name, str) and item.name) or item.name in used:
            expected = "a name not used before" if item.name in used else "a name that is not empty"
            yield Fault(f"{kind}[{k}].name", item.name, expected)
        used.add(item.name)


def _type_faults(path: str, item: Any) -> Iterator[Fault]:
    """Yield what holds no number, not as many, or no word of those that its annotation says, in a dataclass or rows."""
    kind, one, _ = path.partition("[")
    known = isinstance(item, Constraint) + isinstance(item, Driver)  # a driver is a constraint, and no joint
    of_kind = "." in path or known == {"joint": 1, "driver": 2}.get(kind, 0)
    if isinstance(item, tuple) and not one:
        for k, part in enumerate(item):
            yield from _type_faults(f"{path}[{k}]", part)
    elif not (one and _is_instance(item) and of_kind):
        yield Fault(path, item, f"a {kind}" if one else "a tuple, or a list")
    else:
        for key in fields(item):
            x, count = getattr(item, key.name), _counts(item.__class__).get(key.name, 0)
            words = _words(item.__class__).get(key.name, (x,))
            row = (x,) if count == 1 else x
            held = isinstance(row, tuple) and all(map(_is_number, row)) and not len(row) != count > 0
            if _is_instance(x):
                yield from _type_faults(f"{path}.{key.name}", x)
            elif x not in words:
                yield Fault(f"{path}.{key.name}", x, " or ".join(map(repr, words)))
            elif count and not held and (x is not None or key.default is MISSING):
                expected = {1: "a number", -1: "a row of numbers"}.get(count, f"a row of {count} numbers")
                yield Fault(f"{path}.{key.name}", x, expected)


def _is_instance(item: Any) -> bool:
    return is_dataclass(item) and not isinstance(item, type)


def _is_number(x: Any) -> bool:
    return isinstance(x, float) or (type(x) is int and abs(x) < LONGEST)


@cache
def _counts(kind: Any) -> dict[str, int]:
    """Return how many numbers each field of a dataclass holds, -1 for any; nothing of annotations unknown here."""
    counts = {}
    with suppress(NameError, TypeError):
        for name, hint in get_type_hints(kind).items():
            whole = [part for part in get_args(hint) if part is not NoneType] if NoneType in get_args(hint) else [hint]
            parts = get_args(whole[0]) if get_origin(whole[0]) is tuple else whole
            if all(part in (float, int, ...) for part in parts):
                counts[name] = -1 if ... in parts else len(parts)
    return counts


@cache
def _words(kind: Any) -> dict[str, tuple[str, ...]]:
    """Return the words of which each field of a dataclass is one, by fields; nothing of annotations unknown here."""
    with suppress(NameError, TypeError):
        return {name: get_args(hint) for name, hint in get_type_hints(kind).items() if get_origin(hint) is Literal}
    return {}


def _finite_faults(path: str, item: Any) -> Iterator[Fault]:
    """Yield every number in a dataclass, at any depth, that is not finite or too long."""
    if isinstance(item, float) and not (math.isfinite(item) and (abs(item) <= LONGEST or "law" in path)):
        yield Fault(path, item, "a finite number" + f" of at most {LONGEST:g} in size" * math.isfinite(item))
    elif isinstance(item, tuple):
        for k, part in enumerate(item):
            yield from _finite_faults(f"{path}[{k}]", part)
    elif _is_instance(item):
        for key in fields(item):
            yield from _finite_faults(f"{path}.{key.name}", getattr(item, key.name))


def _count_faults(path: str, numbers: Sequence[float], count: int) -> Iterator[Fault]:
    if len(numbers) != count:
        yield WrongCount(path, list(numbers), f"{count} numbers, not {len(numbers)}")
