"""Which bodies of space spin, alone or as one, about a line while nothing else moves; from the joints' kinds alone.

A joint that does not feel a body turn about a line holds it at a point of the line, or by an axis along it. What feels
it takes its other body along, if that has the line at one place: fixed, on a slide along the line, by an axis on it.
"""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence
from itertools import permutations
from typing import Any

import numpy as np

from crosscheck.engines.spatial.kinds import JointKind
from refkin.joints import GROUND

Array = Any
Line = tuple[Array, Array]
"""A point of a line and its direction, of length 1."""
NEAR, ROUNDED = 1e-12, 4e-15
"""A point is on a line that misses it by less than these parts of the way to it, and of its coordinates."""


def spins(bodies: Sequence[str], holds: Sequence[Any], drives: Sequence[Any]) -> Iterator[dict[str, Line]]:
    """Yield for each spin its bodies, in their order, with the line in each.

    Parameters
    ----------
    bodies : sequence of str
    holds, drives : sequence of Hold, of Drive
        As `Numbers` has them.
    """
    pairs = [*((hold, hold.kind) for hold in holds), *((drive.hold, drive.kind) for drive in drives)]
    taken = set[str]()
    for body in bodies:
        if body in taken:
            continue
        for line in _lines(body, pairs):
            group = _group(body, line, pairs)
            if group is not None:
                taken |= group.keys()
                yield {name: group[name] for name in bodies if name in group}
                break


def _group(body: str, line: Line, pairs: Sequence[Any]) -> dict[str, Line] | None:
    """Return what turns with a body about a line of it, at least two joints holding all of it; None if something fails.

    A body on one joint alone has no driver, which is another matter.
    """
    group, todo = {body: line}, [body]
    while todo:
        here = todo.pop()
        own = [(hold, kind) for hold, kind in pairs if here in hold.bodies]
        for hold, kind in own:
            other = hold.other(here)
            if other in group or not _feels(hold, kind, here, group[here]):
                continue
            there = [] if other == GROUND else [_in_other(h, here, group[here]) for h, _ in own if other in h.bodies]
            known = [at for at in there if at is not None]
            if not known:
                return None
            group[other] = known[0]
            todo.append(other)
    outer = {hold.name for hold, _ in pairs if len(group.keys() & {*hold.bodies}) == 1}
    return group if len(outer) > 1 else None


def _feels(hold: Any, kind: JointKind, body: str, line: Line) -> bool:
    """Whether a joint, or the driver of one, feels that one of its bodies turns about a line."""
    u, frame = hold.end(body)
    on, along, first = _on(u, line), _along(frame[:, 2], line), body == hold.body_i
    if kind in (JointKind.SPHERICAL, JointKind.DISTANCE):
        return not on
    if kind in (JointKind.REVOLUTE, JointKind.CYLINDRICAL, JointKind.UNIVERSAL):
        return not (on and along)
    if kind in (JointKind.PARALLEL, JointKind.PERPENDICULAR):
        return not along
    if kind in (JointKind.ON_PLANE, JointKind.DISPLACEMENT):
        return not (along if first else on)
    return kind is not JointKind.ON_LINE or not (on and (along or not first))


def _in_other(hold: Any, body: str, line: Line) -> Line | None:
    """Return a line of a body as the other body of a joint has it, wherever a slide along it may be."""
    (u, frame), (v, other) = hold.end(body), hold.end(hold.other(body))
    along = _along(frame[:, 2], line)
    if hold.kind is JointKind.FIXED or (hold.kind is JointKind.PRISMATIC and along):
        turn = other @ frame.T
        return v + turn @ (line[0] - u), turn @ line[1]
    if hold.kind in (JointKind.REVOLUTE, JointKind.CYLINDRICAL, JointKind.SCREW) and along and _on(u, line):
        return v, other[:, 2] * np.sign(frame[:, 2] @ line[1])
    return None


def _lines(body: str, pairs: Sequence[Any]) -> Iterator[Line]:
    """Yield lines through two points of a body, or one point along an axis, also of bodies fixed to it."""
    ends = list(_ends(body, pairs, {body}))
    for p, q in permutations([u for u, _ in ends], 2):
        if np.linalg.norm(q - p) > 1e-9 * np.linalg.norm(p):
            yield p, (q - p) / np.linalg.norm(q - p)
    for (p, _), (_, axis) in ((one, two) for one in ends for two in ends):
        yield p, axis


def _ends(body: str, pairs: Sequence[Any], seen: set[str]) -> Iterator[Line]:
    for hold, kind in pairs:
        if body not in hold.bodies:
            continue
        u, frame = hold.end(body)
        if kind is not JointKind.FIXED:
            yield u, frame[:, 2]
        elif hold.other(body) not in seen | {GROUND}:
            seen.add(hold.other(body))
            for end in _ends(hold.other(body), pairs, seen):
                yield _in_other(hold, hold.other(body), end)  # type: ignore[misc]  # a fixed joint has it anywhere


def _along(axis: Array, line: Line) -> bool:
    return _area(axis, line[1]) <= NEAR


def _on(point: Array, line: Line) -> bool:
    away = point - line[0]
    allowed = NEAR * math.hypot(*away) + ROUNDED * (math.hypot(*point) + math.hypot(*line[0]))
    return _area(away, line[1]) <= allowed


def _area(a: Array, b: Array) -> float:
    """Return the length of a cross product: of plain floats, which NumPy takes ten times as long for."""
    (a1, a2, a3), (b1, b2, b3) = a.tolist(), b.tolist()
    return math.hypot(a2 * b3 - a3 * b2, a3 * b1 - a1 * b3, a1 * b2 - a2 * b1)
