"""A mechanism's constraints at one time, as ties, pins, lines and distances between bodies, their numbers as balls.

======== ============================================== ===========================================================
tie      phi_j - phi_i = angle                          angle driver; part of fixed, prismatic; gear *
pin      two points coincide                            revolute (with an offset *); part of fixed
line     a point of j stays on a line of i              point_on_line, x and y driver; part of prismatic; rack *;
                                                        flat follower on a disc
distance two points keep a distance                     distance joint, distance driver; point or roller on a disc
======== ============================================== ===========================================================

* where the drivers give the angles that it takes: those of one wheel of a gear, of pinion and rack, of a body that an
offset is seen from. Otherwise, and with other cams, the constraint is none of the kinds.

The numbers are those of `exact`: the scene's as they stand, scaled by the unit of the system. With `spread` > 0 each is
instead a ball of that relative radius (relative to the size where a length is smaller than it): what a redundant
constraint is held against, since its numbers were rounded on the way.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, replace
from enum import Enum, auto
from typing import Any

from flint import arb, ctx

from refkin.joints import (
    GROUND,
    AngleDriver,
    Cam,
    Constraint,
    Disc,
    Distance,
    DistanceDriver,
    Fixed,
    Gear,
    Pair,
    PointOnLine,
    Prismatic,
    RackAndPinion,
    Revolute,
    Unit,
    XDriver,
    YDriver,
)
from refkin.proof.assembly.loci import Ball
from refkin.proof.numbers.exact import exact_system
from refkin.system import Placed, System
from refkin.vec import Vec


class Kind(Enum):
    """What a row says of two points."""

    PIN = auto()
    LINE = auto()
    DISTANCE = auto()


@dataclass(frozen=True)
class Tie:
    """phi_j - phi_i = angle."""

    i: str
    j: str
    angle: Ball
    name: str


@dataclass(frozen=True)
class Row:
    """What joins point `p` of body i and point `q` of body j, both in their body's frame.

    `number` is the unit normal of the line (in the frame of i) or the distance. `key_i`, `key_j` are the points as the
    scene gives them: the same key is the same point.
    """

    kind: Kind
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
        return 2 if self.kind is Kind.PIN else 1


@dataclass(frozen=True)
class Rows:
    """All constraints at one time; `foreign` names those that are none of the four kinds."""

    ties: tuple[Tie, ...]
    rows: tuple[Row, ...]
    foreign: tuple[str, ...]


def read_rows(system: System, t: float, spread: float = 0.0) -> Rows:
    """Return the rows of all constraints of a system at time t, in the precision in force; see the module."""
    exact = exact_system(system, ctx.prec)
    readers = [
        _Reader(given.constraint, placed, system.unit, arb(t), spread)
        for given, placed in zip(system.placed, exact.placed, strict=True)
    ]
    ties = [tie for reader in readers for tie in reader.ties()]
    angles = _angles(ties, [reader for reader in readers if isinstance(reader.given, Gear)])
    rows = [row for reader in readers for row in reader.rows(angles)]
    known = {tie.name for tie in ties} | {row.name for row in rows}
    return Rows(tuple(ties), tuple(rows), tuple(r.given.name for r in readers if r.given.name not in known))


def _angles(ties: list[Tie], gears: list[_Reader]) -> dict[str, Ball]:
    """Return the angle of each body that follows from the ties; a gear with one known wheel is one more tie, added."""
    angles: dict[str, Ball] = {GROUND: arb(0)}
    while True:
        for _ in ties:
            for tie in ties:
                if tie.i in angles and tie.j not in angles:
                    angles[tie.j] = angles[tie.i] + tie.angle
                elif tie.j in angles and tie.i not in angles:
                    angles[tie.i] = angles[tie.j] - tie.angle
        turned = next((gear for gear in gears if not angles.keys().isdisjoint(gear.given.bodies)), None)
        if turned is None:
            return angles
        gears.remove(turned)
        ties.append(turned.gear(angles))


class _Reader:
    """Reads one constraint: its numbers are those of `placed`, its points' keys those of the constraint as given."""

    def __init__(self, given: Constraint, placed: Placed, unit: Unit, t: Ball, spread: float) -> None:
        self.given, self.exact, self.g, self.spread = given, placed.constraint, placed.g, spread
        self.unit, self.t = unit, t
        # Numbers of the ground were rounded at their distance from the scene's origin.
        self.offset = max(1.0, *(abs(c) / unit.size for c in unit.origin))

    def ties(self) -> Iterator[Tie]:
        """Yield what the constraint says of angles alone."""
        c = self.given
        i, j = c.bodies
        if isinstance(c, AngleDriver):
            yield Tie(i, j, self._wide(self._law()), c.name)
        elif isinstance(c, Fixed | Prismatic):
            yield Tie(i, j, self._wide(self.g[-1]), c.name)

    def gear(self, angles: dict[str, Ball]) -> Tie:
        """Return the angle of the second wheel of a gear whose first is known, or the other way round."""
        i, j = self.given.bodies
        radius_i, radius_j, zero_i, zero_j = map(self._wide, self.g)
        if i in angles:
            return Tie(GROUND, j, zero_j - radius_i / radius_j * (angles[i] - zero_i), self.given.name)
        return Tie(GROUND, i, zero_i - radius_j / radius_i * (angles[j] - zero_j), self.given.name)

    def rows(self, angles: dict[str, Ball]) -> Iterator[Row]:
        """Yield what the constraint says of points; nothing if it is none of the kinds."""
        c, g = self.given, self.g
        if isinstance(c, Revolute) and c.offset_law:
            yield from self._apart(angles)
        elif isinstance(c, XDriver | YDriver):
            yield self._coordinate(c)
        elif isinstance(c, Revolute | Fixed):
            yield self._row(Kind.PIN)
        elif isinstance(c, PointOnLine | Prismatic):
            yield self._row(Kind.LINE, normal=Vec(self._wide(g[4]), self._wide(g[5])))
        elif isinstance(c, Distance):
            yield self._row(Kind.DISTANCE, distance=self._wide(g[4]))
        elif isinstance(c, DistanceDriver):
            # d . d = f^2 holds for -f as well: the residual knows no sign.
            yield self._row(Kind.DISTANCE, distance=abs(self._wide(self._law())))
        elif isinstance(c, RackAndPinion):
            yield from self._rack(c, angles)
        elif isinstance(c, Cam) and isinstance(c.profile, Disc):
            yield self._face(c) if c.follower == "flat" else self._row(Kind.DISTANCE, distance=self._wide(g[4]))

    def _apart(self, angles: dict[str, Ball]) -> Iterator[Row]:
        """Yield the pin of two points that are kept apart, if the offset is known in the frame of one of the bodies."""
        row = self._row(Kind.PIN)
        apart = Vec(*(self._wide(law[0]) for law in self.exact.inputs(self.t, self.unit, 0)))
        if row.i in angles:
            yield replace(row, p=row.p + _seen_from(angles[row.i], apart), key_i=None)
        elif row.j in angles:
            yield replace(row, q=row.q - _seen_from(angles[row.j], apart), key_j=None)

    def _rack(self, c: RackAndPinion, angles: dict[str, Ball]) -> Iterator[Row]:
        """Yield the line across the rack on which the pinion's centre lies, if both angles are known."""
        if c.body_i in angles and c.body_j in angles:
            radius, s0, phi0 = map(self._wide, self.g[6:9])
            axis = Vec(self._wide(self.g[4]), self._wide(self.g[5]))
            travel = s0 + radius * (angles[c.body_j] - angles[c.body_i] - phi0)
            row = self._row(Kind.LINE, normal=axis)
            yield replace(row, p=row.p + axis * travel, key_i=None)

    def _face(self, c: Cam) -> Row:
        """Return the line of the follower, a radius behind its face, on which the centre of the disc lies."""
        centre, face = self._point(c.body_i, 0), self._point(c.body_j, 2)
        normal, radius = Vec(self._wide(self.g[4]), self._wide(self.g[5])), self._wide(self.g[6])
        behind = face - normal * radius
        return Row(Kind.LINE, c.body_j, c.body_i, behind, centre, c.name, normal, key_j=c.point_i)

    def _row(self, kind: Kind, normal: Vec | None = None, distance: Ball | None = None) -> Row:
        c: Any = self.given
        p, q = self._point(c.body_i, 0), self._point(c.body_j, 2)
        return Row(kind, c.body_i, c.body_j, p, q, c.name, normal, distance, c.point_i, c.point_j)

    def _coordinate(self, c: XDriver | YDriver) -> Row:
        at = self._wide(self._law(), self.offset)
        zero, one = arb(0), arb(1)
        p, normal = (Vec(at, zero), Vec(one, zero)) if isinstance(c, XDriver) else (Vec(zero, at), Vec(zero, one))
        return Row(Kind.LINE, GROUND, c.body, p, self._point(c.body, 0), c.name, normal, key_j=c.point)

    def _point(self, body: str, first: int) -> Vec:
        scale = self.offset if body == GROUND else 1.0
        return Vec(*(self._wide(x, scale) for x in self.g[first : first + 2]))

    def _law(self) -> Ball:
        return arb(self.exact.inputs(self.t, self.unit, 0)[0][0])

    def _wide(self, x: Any, scale: float = 1.0) -> Ball:
        """Return x as a ball of radius spread max(scale, |x|)."""
        x = arb(x)
        return x + arb(0, self.spread) * abs(x).max(scale) if self.spread else x


def _seen_from(angle: Ball, v: Vec) -> Vec:
    """Return a vector of the ground in a frame that is turned by an angle."""
    c, s = angle.cos(), angle.sin()
    return Vec(c * v.x + s * v.y, c * v.y - s * v.x)
