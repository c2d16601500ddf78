"""A mechanism's constraints at one time, as ties, pins, lines and distances between bodies, their numbers as balls.

======== ============================================== ===========================================================
tie      phi_j - phi_i = angle                          angle driver; part of fixed, prismatic
pin      two points coincide                            revolute; part of fixed
line     a point of j stays on a line of i              point_on_line, x and y driver; part of prismatic
distance two points keep a distance                     distance joint, distance driver
======== ============================================== ===========================================================

The numbers are those of `exact`: the scene's as they stand, scaled by the unit of the system. With `spread` > 0 each is
instead a ball of that relative radius (relative to the size where a length is smaller than it): what a redundant
constraint is held against, since its numbers were rounded on the way.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from enum import Enum, auto
from typing import Any

from flint import arb, ctx

from refkin.joints import (
    GROUND,
    AngleDriver,
    Constraint,
    Distance,
    DistanceDriver,
    Driver,
    Fixed,
    Pair,
    PointOnLine,
    Prismatic,
    Revolute,
    Unit,
    XDriver,
    YDriver,
)
from refkin.proof.exact import exact_system
from refkin.proof.loci import Ball
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
    ties: list[Tie] = []
    rows: list[Row] = []
    foreign = []
    exact = exact_system(system, ctx.prec)
    for given, placed in zip(system.placed, exact.placed, strict=True):
        found = list(_Reader(given.constraint, placed, system.unit, arb(t), spread).parts())
        ties += [part for part in found if isinstance(part, Tie)]
        rows += [part for part in found if isinstance(part, Row)]
        if not found:
            foreign.append(given.constraint.name)
    return Rows(tuple(ties), tuple(rows), tuple(foreign))


class _Reader:
    """Reads one constraint: its numbers are those of `placed`, its points' keys those of the constraint as given."""

    def __init__(self, given: Constraint, placed: Placed, unit: Unit, t: Ball, spread: float) -> None:
        self.given, self.exact, self.g, self.spread = given, placed.constraint, placed.g, spread
        self.unit, self.t = unit, t
        # Numbers of the ground were rounded at their distance from the scene's origin.
        self.offset = max(1.0, *(abs(c) / unit.size for c in unit.origin))

    def parts(self) -> Iterator[Tie | Row]:
        """Yield what the constraint says; nothing if it is none of the kinds."""
        c, g = self.given, self.g
        i, j = c.bodies
        if c.laws and not isinstance(c, Driver):
            return  # a joint that a law moves is not the joint whose closed form is known here
        if isinstance(c, AngleDriver):
            yield Tie(i, j, self._wide(self._law()), c.name)
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
        if isinstance(c, Fixed | Prismatic):
            yield Tie(i, j, self._wide(g[-1]), c.name)

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
