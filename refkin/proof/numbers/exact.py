"""A system whose numbers are exact: lengths, points, angles and laws of the scene as `flint.arb`, rounded nowhere.

The truth that an answer is held against is the scene as it is written: every number of it the binary64 number it is,
each law evaluated exactly at the binary64 time, a table the cubic spline through its values and not what a float64
solver makes of it. `exact_system` gives the equations of that truth, by the same formulas: `phi(q, t)` of an (n,)
object array of `arb` and an `arb` time are balls that enclose the value, as narrow as the precision in force.
"""

from __future__ import annotations

import math
from bisect import bisect_right
from collections.abc import Callable, Sequence
from dataclasses import dataclass, fields, is_dataclass, replace
from fractions import Fraction
from functools import cached_property, lru_cache, partial
from itertools import pairwise
from typing import Any

import numpy as np
from flint import arb, ctx

from refkin.motion_laws import Law, Polynomial, Table
from refkin.system import System


def exact_system(system: System, bits: int) -> System:
    """Return the system with the numbers of its mechanism as `arb`, computed with `bits` bits; its gauge as it is."""
    exact = _exact_system(system, bits)
    return replace(exact, gauge=system.gauge) if system.gauge or exact.gauge else exact


@lru_cache(maxsize=64)
def _exact_system(system: System, bits: int) -> System:
    with ctx.workprec(bits):
        placed = []
        for p in system.placed:
            constraint = exact(p.constraint)
            placed.append(replace(p, constraint=constraint, g=constraint.constants(system.unit)))
    return replace(system, placed=tuple(placed))


def exact(item: Any, blur: float = 0.0) -> Any:
    """Return a dataclass, tuple or number with every number in it, at any depth, as an exact `arb`.

    Zeros stay as they are: exact anyway, and a formula may ask whether a number is zero (a sinusoid does). With a
    `blur` the numbers are balls of so much of their size, but for the arguments of tables.
    """
    if isinstance(item, Table):
        return ExactSpline.through(item.argument, exact(item.value, blur), item.periodic)
    if isinstance(item, int | float) and not isinstance(item, bool):
        return arb(item, blur * abs(item)) if item else item
    return by_parts(item, partial(exact, blur=blur))


def continued(item: Any) -> Any:
    """Return what `exact` gave with every table in it going on beyond its ends, as its first and last pieces do."""
    return replace(item, continued=True) if isinstance(item, ExactSpline) else by_parts(item, continued)


def by_parts(item: Any, change: Callable[[Any], Any]) -> Any:
    """Return a dataclass or tuple with each of its parts changed; anything else as it is."""
    if isinstance(item, tuple):
        return tuple(map(change, item))
    if is_dataclass(item) and not isinstance(item, type):
        return replace(item, **{f.name: change(getattr(item, f.name)) for f in fields(item) if f.init})
    return item


CUBIC = 3
"""The order of the highest derivative of a spline that has values, if not a slope, everywhere."""


@dataclass(frozen=True)
class ExactSpline:
    """The cubic spline through a table, its coefficients balls: `pieces[k]` is a polynomial in t - knots[k].

    `until[k]` is the integral from knots[0] to knots[k]. Over a ball of arguments the values of all pieces that it
    touches are enclosed together. NaN where that is not possible: beyond the ends of a table that is neither periodic
    nor `continued`, over more than a period, and over a knot for the slope of the third derivative, which jumps there.
    """

    knots: tuple[float, ...]
    pieces: tuple[Law, ...]
    until: tuple[Any, ...]
    periodic: bool
    continued: bool = False

    @classmethod
    def through(cls, argument: tuple[float, ...], value: tuple[Any, ...], periodic: bool) -> ExactSpline:
        """Return the spline with not-a-knot ends, or the periodic one, of SciPy's `CubicSpline`."""
        x, y = [arb(a) for a in argument], [arb(v) for v in value]
        h = [b - a for a, b in pairwise(x)]
        chord = [(b - a) / step for (a, b), step in zip(pairwise(y), h, strict=True)]
        slope = periodic_slopes(h, chord) if periodic and len(x) > 2 else not_a_knot_slopes(h, chord)
        pieces, until = [], [arb(0)]
        for k, step in enumerate(h):
            bend = (slope[k] + slope[k + 1] - 2 * chord[k]) / step
            rise = (chord[k] - slope[k]) / step - bend
            pieces.append(Polynomial(coefficients=(y[k], slope[k], rise, bend / step)))
            until.append(until[k] + pieces[k].integral(step))
        return cls(tuple(argument), tuple(pieces), tuple(until), periodic)

    def __call__(self, t: Any, order: int = 0) -> Any:
        """Return the derivative of the given order at t, or over it if t is a ball; NaN where there is no value."""
        if isinstance(t, np.ndarray):
            return np.frompyfunc(lambda x: self(x, order), 1, 1)(t)
        low, high = _ends(t)
        if not self._covers(low, high):
            return arb.nan()
        if self.periodic and low != high and Fraction(high) - Fraction(low) > self._length:
            return arb.nan()
        turn, k = self._place(low)
        last = (turn, k) if low == high else self._place(high)
        if order > CUBIC and (turn, k) != last:
            return arb.nan()
        value = self._on_piece(t, turn, k, order)
        while (turn, k) != last:  # a ball over several pieces: what each of them makes of it
            turn, k = (turn, k + 1) if k + 1 < len(self.pieces) else (turn + 1, 0)
            value = value.union(self._on_piece(t, turn, k, order))
        return value

    def integral(self, t: Any) -> Any:
        """Return the integral from 0 to an exact t."""
        if isinstance(t, np.ndarray):
            return np.frompyfunc(self.integral, 1, 1)(t)
        return self._primitive(t) - self._primitive(arb(0))

    def _primitive(self, t: Any) -> Any:
        low, high = _ends(t)
        if not self._covers(low, high) or low != high:
            return arb.nan()
        turn, k = self._place(low)
        return turn * self.until[-1] + self.until[k] + self.pieces[k].integral(t - self._start(turn, k))

    def _on_piece(self, t: Any, turn: int, k: int, order: int) -> Any:
        return arb(self.pieces[k](t - self._start(turn, k), order))

    @cached_property
    def _length(self) -> Fraction:
        return Fraction(self.knots[-1]) - Fraction(self.knots[0])

    def _covers(self, low: Any, high: Any) -> bool:
        inside = self.periodic or self.continued or (self.knots[0] <= low and high <= self.knots[-1])
        return bool(inside and math.isfinite(high) and math.isfinite(low))

    def _place(self, t: float | Fraction) -> tuple[int, int]:
        """Return the whole periods before t, and the piece it then lies in; a knot belongs to the piece that begins."""
        turn, x = 0, t
        if self.periodic:
            first = Fraction(self.knots[0])
            turn, since = divmod(Fraction(t) - first, self._length)
            x = first + since
        near = float(x)  # comparing rational numbers would cost more than all the rest
        count = bisect_right(self.knots, near)
        if count and self.knots[count - 1] == near and x < near:
            count -= 1
        return int(turn), min(max(count, 1), len(self.pieces)) - 1

    def _start(self, turn: int, k: int) -> Any:
        if not turn:
            return arb(self.knots[k])
        start = turn * self._length + Fraction(self.knots[k])
        return arb(start.numerator) / start.denominator


def _ends(t: Any) -> tuple[Any, Any]:
    """Return exact numbers that a ball lies between: itself, twice, if it is exact; NaN if it has no end."""
    ball = arb(t)
    if not ball.is_finite():
        return math.nan, math.nan
    if ball.is_exact():
        if ball == (near := float(ball)):
            return near, near
        whole = fraction_of(ball)
        return whole, whole
    # The nearest floats of the ends, one step further out.
    low, high = float(ball.lower()), float(ball.upper())
    return math.nextafter(low, -math.inf), math.nextafter(high, math.inf)


def fraction_of(ball: Any) -> Fraction:
    """Return the number that an exact ball is."""
    mantissa, exponent = ball.man_exp()
    return Fraction(int(mantissa)) * Fraction(2) ** int(exponent)


def not_a_knot_slopes(h: Sequence[Any], chord: Sequence[Any]) -> list[Any]:
    """Return the spline's slopes at its knots if its first two pieces, and its last two, are one polynomial each."""
    if len(h) == 1:
        return [chord[0], chord[0]]
    if len(h) == 2:  # one parabola
        middle = (h[1] * chord[0] + h[0] * chord[1]) / (h[0] + h[1])
        return [2 * chord[0] - middle, middle, 2 * chord[1] - middle]
    below, diagonal, above, right = _inner_rows(h, chord)
    for rows, a, b, s, r in ((0, h[0], h[1], chord[0], chord[1]), (len(h), h[-1], h[-2], chord[-1], chord[-2])):
        diagonal[rows] = b
        (above if rows == 0 else below)[rows] = a + b
        right[rows] = ((3 * a + 2 * b) * b * s + a * a * r) / (a + b)
    return _tridiagonal(below, diagonal, above, right)


def periodic_slopes(h: Sequence[Any], chord: Sequence[Any]) -> list[Any]:
    """Return the slopes of the spline that goes on from its last knot at its first, smooth up to f''."""
    count = len(h)
    below, diagonal, above, right = _inner_rows([h[-1], *h], [chord[-1], *chord])
    # Rows 1 ... count belong to knots 0 ... count - 1; the corners are moved to one column (Sherman and Morrison).
    below, diagonal, above, right = (row[1 : count + 1] for row in (below, diagonal, above, right))
    top, bottom = below[0], above[-1]
    diagonal[0], diagonal[-1] = diagonal[0] - top, diagonal[-1] - bottom
    corner = [top] + [arb(0)] * (count - 2) + [bottom]
    y, z = _tridiagonal(below, diagonal, above, right), _tridiagonal(below, diagonal, above, corner)
    factor = (y[0] + y[-1]) / (1 + z[0] + z[-1])
    slopes = [a - factor * b for a, b in zip(y, z, strict=True)]
    return [*slopes, slopes[0]]


def _inner_rows(h: Sequence[Any], chord: Sequence[Any]) -> tuple[list[Any], ...]:
    """Return the rows that make f'' continuous at the inner knots, as three diagonals and a right side."""
    inner = range(1, len(h))
    zero = arb(0)
    below = [zero, *(h[k] for k in inner), zero]
    diagonal = [zero, *(2 * (h[k - 1] + h[k]) for k in inner), zero]
    above = [zero, *(h[k - 1] for k in inner), zero]
    right = [zero, *(3 * (h[k] * chord[k - 1] + h[k - 1] * chord[k]) for k in inner), zero]
    return below, diagonal, above, right


def _tridiagonal(
    below: Sequence[Any], diagonal: Sequence[Any], above: Sequence[Any], right: Sequence[Any]
) -> list[Any]:
    """Return x with below[k] x[k-1] + diagonal[k] x[k] + above[k] x[k+1] = right[k], by elimination.

    Without pivots (the Thomas algorithm): the diagonal is larger than the rest of its row, but for the ends of a spline
    that is not periodic, where exact numbers lose nothing.
    """
    pivots, sides = [diagonal[0]], [right[0]]
    for k in range(1, len(diagonal)):
        factor = below[k] / pivots[-1]
        pivots.append(diagonal[k] - factor * above[k - 1])
        sides.append(right[k] - factor * sides[-1])
    x = [sides[-1] / pivots[-1]]
    for k in range(len(diagonal) - 2, -1, -1):
        x.append((sides[k] - above[k] * x[-1]) / pivots[k])
    return x[::-1]
