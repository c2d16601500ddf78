"""The parts of a mechanism: what joints and drivers connect, but for the ground, that moves with nothing.

Nothing of one part is in the equations of another, whose matrix has blocks of zeros there: to eliminate in the one
rounds nothing in the other. So an answer is held part by part where only a norm of many rows is known. Where rows are
redundant they are solved by least squares, of all rows together: all of it is one part there.

The chains of a part are what its joints connect without those that roll. Who works in the coordinates of joints
composes a pose of the bodies before it in such a chain; what a wheel rolls on is found by a row, and has no turn of the
wheel to round.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from refkin.joints import GearedTurns, PointDistance, RollingOnLine, RollingWheels, SpatialPointDistance, elements_of
from refkin.motion import point_motion
from refkin.system import ConstraintRows, System


@dataclass(frozen=True)
class Parts:
    """Which part, 0 for the first, each row (m,) of the equations belongs to, and each coordinate (n,)."""

    rows: Any
    coordinates: Any

    def __iter__(self) -> Any:
        """Yield the rows and the coordinates of each part, as places."""
        for k in range(int(np.max(self.coordinates)) + 1):
            yield np.flatnonzero(self.rows == k), np.flatnonzero(self.coordinates == k)


def parts_of(system: System) -> Parts:
    """Return the parts of a system; one, if any of them has not as many rows as coordinates."""
    parts = _connected(system, system.placed)
    counts = [np.bincount(x, minlength=system.n) for x in (parts.rows, parts.coordinates)]
    return parts if np.array_equal(counts[0], counts[1]) else Parts(0 * parts.rows, 0 * parts.coordinates)


def chains_of(system: System) -> Parts:
    """Return the chains of a system; rows of what rolls are of one of the chains that they are between."""
    rolling = (RollingWheels, RollingOnLine, GearedTurns)
    return _connected(
        system, [p for p in system.placed if not all(isinstance(e, rolling) for e in elements_of([p.constraint]))]
    )


def _connected(system: System, by: Sequence[ConstraintRows]) -> Parts:
    """Return the parts that some rows connect, with all rows."""
    starts = [*range(0, system.of_bodies, system.kind.width), *range(system.of_bodies, system.n)]
    first = {start: start for start in starts}  # numbers are few, and arrays of them slower
    for p in by:
        met = {first[start] for start in p.starts if start is not None}
        first = {start: min(met) if one in met else one for start, one in first.items()}
    part = {one: k for k, one in enumerate(sorted({*first.values()}))}
    coordinates, rows = np.zeros(system.n, int), np.zeros(system.m, int)
    for start, end in zip(starts, [*starts[1:], system.n], strict=True):
        coordinates[start:end] = part[first[start]]
    for p in system.placed:
        own = [start for start in p.starts if start is not None]
        rows[p.row : p.row + p.constraint.rows] = coordinates[own[0]] if own else 0
    return Parts(rows, coordinates)


def links_of(system: System, parts: Parts) -> Any:
    """Return how many massless links each of its parts has, distances that no law changes."""
    links = np.zeros(system.n, int)
    for p in system.placed:
        kinds = elements_of([p.constraint])
        links[parts.rows[p.row]] += any(
            isinstance(e, PointDistance | SpatialPointDistance) and not e.laws for e in kinds
        )
    return links


def by_part(f: Callable[[Any], Any], values: Any, of: Any, to: Any) -> Any:
    """Return what a function makes of the values (len(of), T) of each part, spread to all places of that part.

    Parameters
    ----------
    f : callable
        It takes some of the rows, (K, T), and returns (T,).
    values : (len(of), T) array
    of, to : array of int
        The part of each value, and of each place: rows or coordinates of `Parts`.
    """
    made = np.array([f(values[of == k]) for k in range(int(np.max(of)) + 1)])
    return made[to]


def at_joints(system: System, q: Any, qd: Any, qdd: Any) -> tuple[Any, Any]:
    """Return rates and their rates (n, T), those of frames replaced by the largest of the points of joints on the body.

    A frame far from its joints is fast where nothing that joints connect is.

    Parameters
    ----------
    system : System
    q, qd, qdd : (n, T) array
        In the system's coordinates.
    """
    rate, bend, places = qd.copy(), qdd.copy(), system.kind.dimension
    points: dict[str, Any] = {body.name: [] for body in system.mechanism.bodies}
    for body, point in (end for c in system.mechanism.constraints for end in c.points() if end[0] in points):
        points[body].append(tuple(x / system.unit.size for x in point))
    for body, own in points.items():
        at = system.columns(body)
        moved = [point_motion(u, q[at], qd[at], qdd[at]) for u in dict.fromkeys(own)]
        of_levels: Any = (rate, [p.v for p in moved]), (bend, [p.a for p in moved])
        for level, of_points in of_levels:
            if of_points:
                level[at][:places] = np.max(np.abs(of_points), axis=0)
    return rate, bend
