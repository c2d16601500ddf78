"""A mechanism's constraints at one time, as relative angles, pins, lines and distances of two bodies, in balls.

======== ============================================== =========================================================
angle    phi_j - phi_i = angle                          angle; rolling wheels *
pin      two points coincide                            points coincide (by a law *)
line     a point of j stays on a line of i              point on line, coordinate of a point; rolling on a line *
distance two points keep a distance                     distance
======== ============================================== =========================================================

* where the drivers give the angles that it takes: of one wheel of a gear and its carrier, or of both wheels, of pinion
and rack, of a body that an offset is seen from. Otherwise, and with other cams, the constraint is none of the kinds.

The numbers are those of `exact`: the scene's as they stand, scaled by the unit of the system. With `spread` > 0 each is
instead a ball of that relative radius (relative to the size where a length is smaller than it): what a redundant
constraint is held against, since its numbers were rounded on the way.
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from enum import Enum, auto
from typing import Any

from flint import arb, ctx

from refkin.joints import (
    GROUND,
    Element,
    GuidedPoint,
    Pair,
    PointCoordinate,
    PointDistance,
    PointsCoincide,
    RelativeAngle,
    RollingOnLine,
    RollingWheels,
    Unit,
    elements_of,
)
from refkin.joints.planar import direction, unit_normal
from refkin.proof.assembly.loci import Ball
from refkin.proof.numbers.exact import exact_system
from refkin.system import System
from refkin.vec import Vec

SPREAD = 2.0**-50
"""Relative radius of the numbers that redundant constraints are held against: eight half-ulps, a few roundings."""


class RowKind(Enum):
    """What a row says of two points."""

    PIN = auto()
    """They coincide."""
    LINE = auto()
    """One stays on a line through the other."""
    DISTANCE = auto()
    """They keep a distance."""


@dataclass(frozen=True)
class AngleConstraint:
    """phi_j - phi_i = angle."""

    i: str
    j: str
    angle: Ball
    name: str


@dataclass(frozen=True)
class PointRow:
    """What joins point `p` of body i and point `q` of body j, both in their body's frame.

    `normal` is that of a line, of length 1 and in the frame of i. `key_i`, `key_j` are the points as the scene gives
    them: the same key is the same point.
    """

    kind: RowKind
    i: str
    j: str
    p: Vec
    q: Vec
    name: str
    normal: Vec | None = None
    distance: Ball | None = None
    key_i: Pair | None = None
    key_j: Pair | None = None

    @property
    def count(self) -> int:
        """How many scalar equations the row stands for."""
        return 2 if self.kind is RowKind.PIN else 1


@dataclass(frozen=True)
class AssemblyRows:
    """All constraints at one time; `foreign` names those that are none of the four kinds."""

    relative_angles: tuple[AngleConstraint, ...]
    rows: tuple[PointRow, ...]
    foreign: tuple[str, ...]


def read_rows(system: System, t: float, spread: float = 0.0) -> AssemblyRows:
    """Return the rows of all constraints of a system at time t, in the precision in force; see the module.

    Parameters
    ----------
    system : System
    t : float
        When [s].
    spread : float
        By how much of itself each number may be off.
    """
    exact = exact_system(system, ctx.prec)
    given, balls = (elements_of(p.constraint for p in s.placed) for s in (system, exact))
    readers = [_Reader(*pair, system.unit, arb(t), spread) for pair in zip(given, balls, strict=True)]
    relative_angles = [relative for reader in readers for relative in reader.relative_angles()]
    angles = _angles(relative_angles, [reader for reader in readers if isinstance(reader.e, RollingWheels)])
    rows = [row for reader in readers for row in reader.rows(angles)]
    read = Counter([relative.name for relative in relative_angles])
    for row in rows:
        read[row.name] += row.count
    foreign = (p.constraint.name for p in system.placed if read[p.constraint.name] < p.constraint.rows)
    return AssemblyRows(tuple(relative_angles), tuple(rows), tuple(foreign))


def angles_from(
    body: str, relative_angles: Sequence[AngleConstraint], angles: dict[str, Ball]
) -> Iterator[tuple[AngleConstraint, Ball]]:
    """Note the angles that follow from that of a body, 0 where none is known; yield what disagrees, and by how much.

    Parameters
    ----------
    body : str
        Where to begin.
    relative_angles : sequence of AngleConstraint
        What is known.
    angles : dict of str to Ball
        Body -> its angle [rad]; filled in.
    """
    angles.setdefault(body, arb(0))
    waiting = [body]
    while waiting:
        here = waiting.pop()
        for relative in relative_angles:
            if here not in (relative.i, relative.j):
                continue
            there = relative.j if here == relative.i else relative.i
            angle = angles[here] + (relative.angle if here == relative.i else -relative.angle)
            if there not in angles:
                angles[there] = angle
                waiting.append(there)
            elif not (angle - angles[there]).contains(0):
                yield relative, abs(angle - angles[there])


def _angles(relative_angles: list[AngleConstraint], gears: list[_Reader]) -> dict[str, Ball]:
    """Return the angle of each body that follows from those given; a gear of which two are known gives one more."""
    angles: dict[str, Ball] = {}
    while True:
        for _ in angles_from(GROUND, relative_angles, angles):
            pass  # who disagrees is asked where the mechanism is put together
        turned = next((gear for gear in gears if gear.turns_one(angles)), None)
        if turned is None:
            return angles
        gears.remove(turned)
        relative_angles.append(turned.gear(angles))


class _Reader:
    """Reads one element: its numbers are those of `e`, balls; its points' keys those of the element as given."""

    def __init__(self, given: Element, e: Any, unit: Unit, t: Ball, spread: float) -> None:
        self.given, self.e, self.unit, self.spread = given, e, unit, spread
        self.laws = [arb(law(t, 0)) for law in e.laws]
        # Numbers of the ground were rounded at their distance from the scene's origin.
        self.offset = max(1.0, *(abs(c) / unit.size for c in unit.origin))

    def relative_angles(self) -> Iterator[AngleConstraint]:
        """Yield what the element says of angles alone."""
        e = self.e
        if isinstance(e, RelativeAngle):
            yield AngleConstraint(e.body_i, e.body_j, self._wide(self.laws[0] if self.laws else e.angle), e.name)

    def turns_one(self, angles: dict[str, Ball]) -> bool:
        """Return whether a gear gives the angle of a body, of the wheels and the carrier, by those of two others."""
        e = self.e
        two = sum(body in angles for body in e.bodies) >= 2
        return two and (e.carrier in angles or not (e.radius_i + e.radius_j).contains(0))

    def gear(self, angles: dict[str, Ball]) -> AngleConstraint:
        """Return the angle of the body that a gear turns."""
        e = self.e
        radius_i, radius_j = (self._length(radius) for radius in (e.radius_i, e.radius_j))
        zero_i, zero_j = self._wide(e.zero_i), self._wide(e.zero_j)
        phi_i, phi_j, carrier = (angles.get(body) for body in e.bodies)
        if carrier is None:
            turned = radius_i * (phi_i - zero_i) + radius_j * (phi_j - zero_j)
            return AngleConstraint(GROUND, e.carrier, turned / (radius_i + radius_j), e.name)
        if phi_i is not None:
            turned = carrier + zero_j - radius_i / radius_j * (phi_i - carrier - zero_i)
            return AngleConstraint(GROUND, e.body_j, turned, e.name)
        turned = carrier + zero_i - radius_j / radius_i * (phi_j - carrier - zero_j)
        return AngleConstraint(GROUND, e.body_i, turned, e.name)

    def rows(self, angles: dict[str, Ball]) -> Iterator[PointRow]:
        """Yield what the element says of points; nothing if it is none of the kinds."""
        e = self.e
        if isinstance(e, PointsCoincide):
            yield from self._apart(angles) if self.laws else [self._row(RowKind.PIN)]
        elif isinstance(e, PointCoordinate):
            yield self._coordinate()
        elif isinstance(e, GuidedPoint):
            row = self._row(RowKind.LINE, normal=self._vector(unit_normal(e.axis_i)))
            yield self._beside(row, self._length(e.offset)) if e.offset else row
        elif isinstance(e, PointDistance):
            # d . d = f^2 holds for -f as well: the residual knows no sign.
            yield self._row(RowKind.DISTANCE, distance=abs(self._length(self.laws[0] if self.laws else e.length)))
        elif isinstance(e, RollingOnLine) and e.body_i in angles and e.body_j in angles:
            turned = angles[e.body_j] - angles[e.body_i] - self._wide(e.phi0)
            travel = self._length(e.s0) + self._length(e.radius) * turned
            yield self._beside(self._row(RowKind.LINE, normal=self._vector(direction(e.axis_i))), travel)

    def _apart(self, angles: dict[str, Ball]) -> Iterator[PointRow]:
        """Yield the pin of two points that are kept apart, if the offset is known in the frame of one of the bodies."""
        row = self._row(RowKind.PIN)
        apart = Vec(*(self._length(value) for value in self.laws))
        if row.i in angles:
            yield replace(row, p=row.p + _seen_from(angles[row.i], apart), key_i=None)
        elif row.j in angles:
            yield replace(row, q=row.q - _seen_from(angles[row.j], apart), key_j=None)

    def _beside(self, row: PointRow, away: Ball) -> PointRow:
        """Return the row of a line that lies further along its normal."""
        assert row.normal is not None
        return replace(row, p=row.p + row.normal * away, key_i=None)

    def _row(self, kind: RowKind, normal: Vec | None = None, distance: Ball | None = None) -> PointRow:
        e, (key_i, key_j) = self.e, (point for _, point in self.given.ends)
        p, q = (self._point(*end) for end in e.ends)
        return PointRow(kind, e.body_i, e.body_j, p, q, e.name, normal, distance, key_i, key_j)

    def _coordinate(self) -> PointRow:
        e, ((_, key),) = self.e, self.given.ends
        at = self._wide((self.laws[0] - self.unit.origin[e.axis]) / self.unit.size, self.offset)
        along = Vec(arb(e.axis == 0), arb(e.axis == 1))
        return PointRow(RowKind.LINE, GROUND, e.body_j, along * at, self._point(*e.ends[0]), e.name, along, key_j=key)

    def _point(self, body: str, u: Pair) -> Vec:
        return self._vector(self.unit.point(body, u), self.offset if body == GROUND else 1.0)

    def _vector(self, v: Any, scale: float = 1.0) -> Vec:
        return Vec(*(self._wide(x, scale) for x in v))

    def _length(self, x: Any) -> Ball:
        return self._wide(x / self.unit.size)

    def _wide(self, x: Any, scale: float = 1.0) -> Ball:
        return wide(x, self.spread, scale)


def wide(x: Any, spread: float, scale: float = 1.0) -> Ball:
    """Return x as a ball of radius spread max(scale, |x|).

    Parameters
    ----------
    x : float or ball
        A number.
    spread : float
        As of `read_rows`.
    scale : float
        What a number counts as at least, in sizes.
    """
    x = arb(x)
    return x + arb(0, spread) * abs(x).max(scale) if spread else x


def _seen_from(angle: Ball, v: Vec) -> Vec:
    """Return a vector of the ground in a frame that is turned by an angle."""
    c, s = angle.cos(), angle.sin()
    return Vec(c * v.x + s * v.y, c * v.y - s * v.x)
