"""A mechanism's constraints at one time as ties, pins, lines and distances between bodies, their numbers as balls.

======== ============================================== ===========================================================
tie      phi_j - phi_i = angle                          angle driver; part of fixed, prismatic
pin      two points coincide                            revolute; part of fixed
line     a point of j stays on a line of i              point_on_line, x and y driver; part of prismatic
distance two points keep a distance                     distance joint, distance driver
======== ============================================== ===========================================================

The numbers of the scene are taken as they stand, exactly, and scaled by the unit of the system. With `spread` > 0 each is
instead a ball of that relative radius (relative to the size where a length is smaller than it): what a redundant
constraint is held against, since its numbers were rounded on the way.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from enum import Enum, auto
from typing import Any

from flint import arb

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
    XDriver,
    YDriver,
)
from refkin.motion_laws import Integral, Law, Polynomial, Sinusoid, Table
from refkin.proof.loci import Ball, length
from refkin.system import System
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


class Reader:
    """Reads a system's constraints at a time; see the module."""

    def __init__(self, system: System, t: float, spread: float = 0.0) -> None:
        self.unit, self.t, self.spread = system.unit, t, spread
        self.constraints = system.mechanism.constraints

    def read(self) -> Rows:
        """Return the rows of all constraints."""
        ties: list[Tie] = []
        rows: list[Row] = []
        foreign = []
        for c in self.constraints:
            # A joint that a law moves is not the joint whose closed form is known here.
            moving = bool(c.laws) and not isinstance(c, Driver)
            found = [] if moving else list(self._parts(c))
            ties += [part for part in found if isinstance(part, Tie)]
            rows += [part for part in found if isinstance(part, Row)]
            if not found:
                foreign.append(c.name)
        return Rows(tuple(ties), tuple(rows), tuple(foreign))

    def _parts(self, c: Constraint) -> Iterator[Tie | Row]:
        i, j = c.bodies
        if isinstance(c, AngleDriver):
            yield Tie(i, j, self._angle(self._law(c.laws[0])), c.name)
        elif isinstance(c, XDriver | YDriver):
            yield self._coordinate(c, axis=0 if isinstance(c, XDriver) else 1)
        elif isinstance(c, Revolute | Fixed):
            yield self._row(Kind.PIN, c)
        elif isinstance(c, PointOnLine | Prismatic):
            yield self._row(Kind.LINE, c, normal=self._normal(c.axis_i))
        elif isinstance(c, Distance):
            yield self._row(Kind.DISTANCE, c, distance=self._length(arb(c.length)))
        elif isinstance(c, DistanceDriver):
            # d . d = f^2 holds for -f as well: the residual knows no sign.
            yield self._row(Kind.DISTANCE, c, distance=abs(self._length(self._law(c.laws[0]))))
        if isinstance(c, Fixed | Prismatic):
            yield Tie(i, j, self._angle(arb(c.angle)), c.name)

    def _row(self, kind: Kind, c: Any, normal: Vec | None = None, distance: Ball | None = None) -> Row:
        p, q = self._point(c.body_i, c.point_i), self._point(c.body_j, c.point_j)
        return Row(kind, c.body_i, c.body_j, p, q, c.name, normal, distance, c.point_i, c.point_j)

    def _coordinate(self, c: XDriver | YDriver, axis: int) -> Row:
        at = self._length(self._law(c.laws[0])) - arb(self.unit.origin[axis]) / self.unit.size
        zero, one = arb(0), arb(1)
        p, normal = (Vec(at, zero), Vec(one, zero)) if axis == 0 else (Vec(zero, at), Vec(zero, one))
        return Row(Kind.LINE, GROUND, c.body, p, self._point(c.body, c.point), c.name, normal, key_j=c.point)

    def _point(self, body: str, u: Pair) -> Vec:
        origin = self.unit.origin if body == GROUND else (0.0, 0.0)
        x, y = (self._length(arb(c)) - arb(o) / self.unit.size for c, o in zip(u, origin, strict=True))
        return Vec(x, y)

    def _normal(self, axis: Pair) -> Vec:
        # Scaled to about 1 first, so that neither a tiny nor a huge axis meets the spread of a length.
        scale = max(abs(axis[0]), abs(axis[1]))
        a = Vec(self._wide(arb(axis[0]) / scale), self._wide(arb(axis[1]) / scale))
        return Vec(-a.y, a.x) * (1 / length(a))

    def _length(self, metres: Ball) -> Ball:
        return self._wide(metres / self.unit.size)

    def _angle(self, angle: Ball) -> Ball:
        return self._wide(angle)

    def _wide(self, x: Ball) -> Ball:
        """Return x as a ball of radius spread max(1, |x|)."""
        return x + arb(0, self.spread) * abs(x).max(1) if self.spread else x

    def _law(self, law: Law) -> Ball:
        """Return an enclosure of the law's value at t, in the law's own unit."""
        if isinstance(law, Integral):
            return arb(law.initial) + self._integral(law.rate)
        return self._value(law)

    def _value(self, law: Law) -> Ball:
        t = arb(self.t)
        if isinstance(law, Polynomial):
            return _horner([arb(c) for c in law.coefficients], t)
        if isinstance(law, Sinusoid):
            wave = (arb(law.angular_frequency) * t + arb(law.phase)).sin()
            return arb(law.offset) + arb(law.amplitude) * wave
        return _rounded(law, law(self.t), 1.0)

    def _integral(self, law: Law) -> Ball:
        t = arb(self.t)
        if isinstance(law, Polynomial):
            return t * _horner([arb(c) / (k + 1) for k, c in enumerate(law.coefficients)], t)
        if isinstance(law, Sinusoid):
            w, phase = arb(law.angular_frequency), arb(law.phase)
            mean = (w * t / 2).sinc() * (w * t / 2 + phase).sin()  # of the wave from 0 to t
            return t * (arb(law.offset) + arb(law.amplitude) * mean)
        return _rounded(law, law.integral(self.t), self.t)


def _horner(coefficients: list[Ball], t: Ball) -> Ball:
    value = arb(0)
    for c in reversed(coefficients):
        value = value * t + c
    return value


def _rounded(law: Law, value: float, factor: float) -> Ball:
    """Return a float evaluation of a table as a ball.

    A spline's coefficients come from a linear system that is well conditioned, up to the spacing of the arguments, and
    each of its N pieces adds a few roundings to an integral: (N + 16) ulp of the largest value is allowed.
    """
    values = law.value if isinstance(law, Table) else (value,)
    largest = max(abs(v) for v in values) * max(1.0, abs(factor))
    return arb(value, (len(values) + 16) * 2.0**-52 * max(largest, abs(value)))
