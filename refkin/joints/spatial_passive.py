"""Which bodies of space spin about a line while nothing else moves: by their joints' elements alone, at every pose.

The rows of an element stay as they are while one of its bodies spins about a line that its point on that body lies on,
or its axis is along; which of them, it says itself (`spins_about`). So couplers between two ball joints spin, rods
between a ball and a distance, the halves of a rod that a hinge along it joins. Where rows would change, the element's
other body goes along: bodies fixed to each other, or on a slide along the line, spin as one. The line is known in the
other body where the joint says so; where it does not, or where the ground would have to come along, nothing spins. A
body that hangs on one joint alone is no case of this: it lacks a driver.
"""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping, Sequence
from itertools import permutations
from typing import Any

from refkin.joints.elements import GROUND, Element, Triple
from refkin.joints.spatial_elements import AxesParallel, PointOnAxis, PointsMeet, TurnAboutAxis
from refkin.joints.spatial_frames import across, frame, unit_vector
from refkin.joints.spatial_vectors import Vec3

Line = tuple[Vec3, Vec3]
"""A point of a line, and a vector along it."""
Spin = Mapping[str, tuple[Triple, Triple]]
"""Bodies that spin as one, in their order, with the line in each: a point [m] and a vector along it."""
ByBody = Mapping[str, Sequence[Any]]
"""The constraints of each body, by its name."""
ALIKE, ROUNDED = 2.0**-40, 2.0**-48
"""How far off a line is on it: in parts of the way along it, and of the coordinates, which are rounded."""


def passive_spins(bodies: Sequence[Any], constraints: Sequence[Any]) -> Iterator[Spin]:
    """Yield the spins that move nothing else, each once: no body takes part in two."""
    at: dict[str, list[Any]] = {body.name: [] for body in bodies}
    for c in constraints:
        for body in set(c.bodies) & at.keys():
            at[body].append(c)
    taken = set[str]()
    for body in at:
        spins = (lines for line in _candidates(body, at) if (lines := _spinning(body, line, at)))
        lines = next(spins, None) if body not in taken else None
        if lines is not None:
            taken.update(lines)
            yield {name: (lines[name][0].parts, lines[name][1].parts) for name in at if name in lines}


def _spinning(body: str, line: Line, at: ByBody) -> dict[str, Line] | None:
    """Return the bodies that spin as one with a body about a line of it, with the line in each; None if none may."""
    lines, reached = {body: line}, [body]
    while reached:
        here = reached.pop()
        for c in at[here]:
            # rows that no element says, None: every spin changes those
            elements: Sequence[Element | None] = c.placed_elements or ((None,) if c.rows else ())
            blind = all(_blind(e, here, lines[here]) for e in elements)
            for other in () if blind else (name for name in c.bodies if name not in lines):
                there = (_carried(k, here, lines[here]) for k in at[here] if other in k.bodies and other in at)
                carried = next((line for line in there if line is not None), None)
                if carried is None:
                    return None
                lines[other] = carried
                reached.append(other)
    outer = {getattr(c, "joint", "") or c.name for name in lines for c in at[name] if not lines.keys() >= {*c.bodies}}
    return lines if len(outer) > 1 else None


def _blind(e: Element | None, body: str, line: Line) -> bool:
    """Whether the rows of an element stay as they are while a body spins about a line of it: the element says it."""
    if e is None or not e.spins_about:
        return False
    own = "_i" if e.bodies[0] == body else "_j"
    ends = {key: Vec3(*getattr(e, key)) for key in e.spins_about if key.endswith(own)}
    return all(_along(v, line) if key.startswith("axis") else _on(v, line) for key, v in ends.items())


def _end(e: Any, body: str) -> tuple[Vec3 | None, Vec3 | None]:
    """Return the point and the axis of an element on one of its bodies, None where it has none."""
    side = "i" if e is not None and e.bodies[0] == body else "j"
    point, axis = (getattr(e, f"{key}_{side}", None) for key in ("point", "axis"))
    return (None if point is None else Vec3(*point)), (None if axis is None else Vec3(*axis))


def _candidates(body: str, at: ByBody) -> Iterator[Line]:
    """Yield lines through two points of a body, or through one along an axis; those fixed to it have theirs on it.

    A hinge, or a cylinder, on the ground leaves its own axis alone.
    """
    for c in at[body]:
        parts = {type(e): _end(e, body) for e in c.placed_elements}
        place = parts.get(PointsMeet) or parts.get(PointOnAxis)
        if GROUND in c.bodies and AxesParallel in parts and place:
            yield place[0], parts[AxesParallel][1]  # type: ignore[misc]  # both have them
            return
    ends = list(_ends(body, at, {body}))
    points = list({p.parts: p for p, _ in ends if p is not None}.values())
    axes = [axis for _, axis in ends if axis is not None]
    away = {(p.parts, q.parts): q - p for p, q in permutations(points, 2)}
    for p in points:
        for v in sorted((away[p.parts, q.parts] for q in points if q is not p), key=lambda v: -_size(v)):
            if _size(v) > ROUNDED * _size(p):
                yield p, v
        yield from ((p, axis) for axis in axes)


def _ends(body: str, at: ByBody, seen: set[str]) -> Iterator[tuple[Vec3 | None, Vec3 | None]]:
    """Yield the points and axes by which a body, or one fixed to it, is held, as they lie on it."""
    for c in at[body]:
        rigid = {PointsMeet, TurnAboutAxis} <= {type(e) for e in c.placed_elements}
        if not rigid:
            yield from (_end(e, body) for e in c.placed_elements)
        elif (other := next(name for name in c.bodies if name != body)) in at and other not in seen:
            seen.add(other)
            for point, axis in _ends(other, at, seen):
                moved = _carried(c, other, (point or Vec3(0, 0, 0), axis or Vec3(0, 0, 0)))
                if moved is not None:
                    yield (point and moved[0]), (axis and moved[1])


def _carried(c: Any, body: str, line: Line) -> Line | None:
    """Return a line of a body as it lies in the other one, if a joint keeps it at one place there, but for a shift."""
    parts = {type(e): e for e in c.placed_elements}
    axes, place = parts.get(AxesParallel), parts.get(PointsMeet) or parts.get(PointOnAxis)
    if axes is None or place is None:
        return None
    here, there = ("i", "j") if c.bodies[0] == body else ("j", "i")
    h, start = Vec3(*getattr(axes, f"axis_{here}")), Vec3(*getattr(place, f"point_{here}"))
    k, end = Vec3(*getattr(axes, f"axis_{there}")), Vec3(*getattr(place, f"point_{there}"))
    along, turn = _along(h, line), parts.get(TurnAboutAxis)
    if turn is not None and (PointsMeet in parts or along):
        given = [(getattr(turn, f"axis_{side}"), getattr(turn, f"zero_{side}")) for side in (here, there)]
        if turn.angle or not all(zero is not None and across(axis, zero) for axis, zero in given):
            return None
        own, other = (frame(axis, zero) for axis, zero in given)
        (p, u), zero = line, Vec3(0, 0, 0)
        at, to = (sum((x * v.dot(y) for x, y in zip(other, own, strict=True)), zero) for v in (p - start, u))
        return end + at, to
    if along and _on(start, line):
        return end, k * math.copysign(1.0, h.dot(_direction(line[1])))
    return None


def _size(v: Vec3) -> float:
    return math.hypot(*v.parts)


def _direction(v: Vec3) -> Vec3:
    return unit_vector(v.parts) if any(v.parts) else v


def _along(axis: Vec3, line: Line) -> bool:
    return _size(_direction(axis).cross(_direction(line[1]))) <= ALIKE


def _on(point: Vec3, line: Line) -> bool:
    away = point - line[0]
    allowed = ALIKE * _size(away) + ROUNDED * max(_size(point), _size(line[0]))
    return _size(away.cross(_direction(line[1]))) <= allowed
