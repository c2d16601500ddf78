"""Where two loci meet, line or circle, in ball arithmetic: the closed form behind every dyad.

A ball encloses the true number, so a comparison that holds for the whole ball is proved: `gap > 0` says that two loci
certainly miss each other, and by how much at least. Where the balls do not decide (a dead centre, an exact toggle) the
meeting is *undecided*: its one point encloses every point at which the loci may touch.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Any

from flint import arb

from refkin.vec import Vec

Ball = Any
"""A `flint.arb`."""


@dataclass(frozen=True)
class Line:
    """The points x with normal . (x - through) = 0; the normal has length 1."""

    through: Vec
    normal: Vec


@dataclass(frozen=True)
class Circle:
    """The points at a distance of `radius` from the centre."""

    centre: Vec
    radius: Ball


Locus = Line | Circle


@dataclass(frozen=True)
class Meeting:
    """Where two loci meet.

    Attributes
    ----------
    points : tuple of (int, Vec)
        Each point with its side of the line from the first centre to the second (or of the line's normal, seen from the
        centre): 1 left, -1 right, 0 where there is but one.
    decided : bool
        Whether the points are proved to be there, no more and no less.
    gap : ball or None
        If they certainly do not meet: the distance that is missing.
    apart, reach : ball or None
        The distance between the loci's centres or lines, and what it would have to be at most (at least if `inside`).
    inside : bool
        Whether one circle lies within the other.
    """

    points: tuple[tuple[int, Vec], ...] = ()
    decided: bool = True
    gap: Ball | None = None
    apart: Ball | None = None
    reach: Ball | None = None
    inside: bool = False


def meet(first: Locus, second: Locus) -> Meeting | None:
    """Return where two loci meet; None where not even a candidate can be named (parallel lines, concentric circles)."""
    if isinstance(first, Line):
        return _lines(first, second) if isinstance(second, Line) else _line_and_circle(first, second)
    if isinstance(second, Line):
        return _line_and_circle(second, first)
    return _circles(first, second)


def _lines(a: Line, b: Line) -> Meeting | None:
    det = a.normal.x * b.normal.y - a.normal.y * b.normal.x
    if det.contains(0):
        apart = abs(a.normal.dot(b.through - a.through))
        if det.is_zero() and apart > 0:
            return Meeting(gap=apart, apart=apart, reach=arb(0))
        return None
    h_a, h_b = a.normal.dot(a.through), b.normal.dot(b.through)
    x, y = (h_a * b.normal.y - h_b * a.normal.y) / det, (a.normal.x * h_b - b.normal.x * h_a) / det
    return Meeting(((0, Vec(x, y)),))


def _line_and_circle(line: Line, circle: Circle) -> Meeting:
    height = line.normal.dot(line.through - circle.centre)
    apart, reach = abs(height), circle.radius
    if apart > reach:
        return Meeting(gap=apart - reach, apart=apart, reach=reach)
    return _chord(circle.centre + line.normal * height, line.normal.perp(), (reach - height) * (reach + height))


def _circles(a: Circle, b: Circle) -> Meeting | None:
    along = b.centre - a.centre
    apart, reach, least = length(along), a.radius + b.radius, abs(a.radius - b.radius)
    if apart > reach:
        return Meeting(gap=apart - reach, apart=apart, reach=reach)
    if apart < least:
        return Meeting(gap=least - apart, apart=apart, reach=least, inside=True)
    if apart.contains(0):
        return None
    along = along * (1 / apart)
    difference = a.radius - b.radius
    foot = (apart + reach * difference / apart) / 2
    # Heron's product: no difference of squares, so that the sign of a small gap survives.
    heron = (reach - apart) * (reach + apart) * (apart - difference) * (apart + difference)
    return _chord(a.centre + along * foot, along.perp(), heron / (4 * apart * apart))


def _chord(foot: Vec, direction: Vec, half_squared: Ball) -> Meeting:
    """Return the ends of a chord from its middle, its direction and the square of its half length."""
    if half_squared > 0:
        half = half_squared.sqrt()
        return Meeting(((1, foot + direction * half), (-1, foot - direction * half)))
    return Meeting(((0, foot + direction * arb(0, root(half_squared).upper())),), decided=False)


def root(x: Ball) -> Ball:
    """Return the square root of the numbers of a ball that are not negative."""
    if x > 0:
        return x.sqrt()
    half = x.upper().sqrt() / 2
    return half + half * arb(0, 1)


def length(v: Any) -> Ball:
    """Return |v|, of the plane or of space."""
    return root(v.dot(v))


def below(x: Ball) -> float:
    """Return a float that is no larger than any number of a ball."""
    return math.nextafter(float(x.lower()), -math.inf)


def above(x: Ball) -> float:
    """Return a float that is no smaller than any number of a ball."""
    return math.nextafter(float(x.upper()), math.inf)


class Slope:
    """A number that depends on one parameter, enclosed over an interval of it by a ball and a slope.

    For a parameter m + h, |h| <= r, `whole` holds every value x(m + h), `centre` holds x(m), and x(m + h) - x(m) lies
    in slope * h (Krawczyk and Neumaier, SIAM J. Numer. Anal. 22, 1985); `step` is the ball of all h. So the excess of
    an enclosure shrinks with r^2, not with r, and few intervals prove that a mechanism misses by little. Mixed with
    plain balls, those are constants.
    """

    __slots__ = ("centre", "slope", "step", "whole")

    def __init__(self, centre: Ball, slope: Ball, step: Ball, whole: Ball | None = None) -> None:
        self.centre, self.slope, self.step = centre, slope, step
        reached = centre + slope * step
        if whole is None:
            whole = reached
        elif whole.is_finite() and reached.is_finite():
            whole = whole.intersection(reached)
        self.whole = whole if whole.is_finite() else reached

    def _other(self, other: Any) -> tuple[Ball, Ball, Ball]:
        if isinstance(other, Slope):
            return other.whole, other.centre, other.slope
        constant = arb(other)
        return constant, constant, arb(0)

    def __neg__(self) -> Slope:
        return Slope(-self.centre, -self.slope, self.step, -self.whole)

    def __add__(self, other: Any) -> Slope:
        whole, centre, slope = self._other(other)
        return Slope(self.centre + centre, self.slope + slope, self.step, self.whole + whole)

    def __sub__(self, other: Any) -> Slope:
        whole, centre, slope = self._other(other)
        return Slope(self.centre - centre, self.slope - slope, self.step, self.whole - whole)

    def __mul__(self, other: Any) -> Slope:
        whole, centre, slope = self._other(other)
        return Slope(self.centre * centre, self.slope * whole + self.centre * slope, self.step, self.whole * whole)

    def __truediv__(self, other: Any) -> Slope:
        whole, centre, slope = self._other(other)
        ratio = self.centre / centre
        return Slope(ratio, (self.slope - ratio * slope) / whole, self.step, self.whole / whole)

    __radd__, __rmul__ = __add__, __mul__

    def __rsub__(self, other: Any) -> Slope:
        return (-self).__add__(other)

    def __rtruediv__(self, other: Any) -> Slope:
        return Slope(arb(other), arb(0), self.step).__truediv__(self)

    def __abs__(self) -> Slope:
        if self.whole > 0:
            return self
        if self.whole < 0:
            return -self
        return Slope(abs(self.centre), self.slope * arb(0, 1), self.step, abs(self.whole))

    def __gt__(self, other: Any) -> bool:
        return bool((self - other).whole > 0)

    def __lt__(self, other: Any) -> bool:
        return bool((self - other).whole < 0)

    def sqrt(self) -> Slope:
        """Return the square root; sqrt x - sqrt y = (x - y) / (sqrt x + sqrt y)."""
        whole, centre = self.whole.sqrt(), self.centre.sqrt()
        return Slope(centre, self.slope / (whole + centre), self.step, whole)

    def cos(self) -> Slope:
        """Return the cosine."""
        return Slope(self.centre.cos(), -self.whole.sin() * self.slope, self.step, self.whole.cos())

    def sin(self) -> Slope:
        """Return the sine."""
        return Slope(self.centre.sin(), self.whole.cos() * self.slope, self.step, self.whole.sin())

    def contains(self, number: Any) -> bool:
        """Whether the number is among the values."""
        return bool(self.whole.contains(number))

    def is_zero(self) -> bool:
        """Whether the only value is 0."""
        return bool(self.whole.is_zero())

    def lower(self) -> Ball:
        """Return a lower bound of the values."""
        return self.whole.lower()

    def upper(self) -> Ball:
        """Return an upper bound of the values."""
        return self.whole.upper()

    def mid(self) -> Ball:
        """Return the middle of the values."""
        return self.whole.mid()


def whole(x: Ball | Slope) -> Ball:
    """Return the ball of all values of a number, whether it depends on the parameter or not."""
    return x.whole if isinstance(x, Slope) else x


def interval(low: float, high: float) -> Slope:
    """Return the parameter itself over an interval."""
    middle = (arb(low) + arb(high)) / 2
    half = ((arb(high) - arb(low)) / 2).upper()
    centre = arb(middle.mid())
    return Slope(centre, arb(1), arb(0, half) + (middle - centre))
