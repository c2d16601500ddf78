"""Closing a planar loop by its last two unknowns: what linkages know in closed form rests on these.

Vectors of the plane are complex numbers. Differences of lengths are taken before products (Kahan, Miscalculating Area
and Angles of a Needle-like Triangle, 2014), so that a nearly flat triangle loses no digits; with lengths as `Fraction`
they are exact, and so is the decision whether an angle is limited at all.
"""

from __future__ import annotations

import math
from fractions import Fraction

from refkin.errors import RefkinError

Number = float | Fraction
Interval = tuple[float, float]
ANYWHERE: tuple[Interval, ...] = ((-math.inf, math.inf),)
"""The range of an angle that makes full turns."""


class DoesNotAssemble(RefkinError):
    """A linkage whose last two links do not meet; `gap` [m] is what they miss each other by, NaN if no length says."""

    def __init__(self, linkage: object, driven: str, value: float, gap: float) -> None:
        self.linkage, self.driven, self.value, self.gap = linkage, driven, value, gap
        miss = "do not meet" if math.isnan(gap) else f"miss by {gap:.3g} m"
        super().__init__(f"{linkage} does not assemble at {driven} = {value:.17g}: its last two links {miss}")


def corner(a: Number, b: Number, opposite: Number) -> float:
    """Return the angle between the sides a and b of a triangle, in [0, pi]; flat triangles may be open by round-off.

    Parameters
    ----------
    a, b, opposite : float
        The sides, each above 0 [m].
    """
    if not b:
        return math.pi / 2  # isosceles, in the limit of b going to 0
    above = (opposite - a + b) * (opposite + a - b)
    below = (a + b + opposite) * (a + b - opposite)
    return 2 * math.atan2(math.sqrt(max(0.0, float(above))), math.sqrt(max(0.0, float(below))))


def leg(hypotenuse: Number, other: Number) -> float:
    """Return sqrt(hypotenuse^2 - other^2), 0 where round-off makes that negative."""
    return math.sqrt(max(0.0, float((hypotenuse - other) * (hypotenuse + other))))


def direction_of(z: complex) -> float:
    """Return the angle of a vector to the x axis [rad]; unlike `cmath.phase`, also where that underflows."""
    return math.atan2(z.imag, z.real)


def two_links(gap: complex, a: float, b: float, sign: int) -> tuple[float, float]:
    """Return alpha, beta with a e^(i alpha) + b e^(i beta) = gap; the joint lies left of the gap if sign is 1.

    Both corners come from the same three differences, so that they belong to one triangle: near a flat pose, where the
    angles are uncertain by the root of round-off, the loop still closes to round-off.

    Parameters
    ----------
    gap : complex
        From the first link's foot to the second's end [m].
    a, b : float
        The links [m].
    sign : int
        1 or -1: which of the two triangles.
    """
    d, direction = abs(gap), direction_of(gap)
    if d == 0.0:
        return direction + sign * math.pi / 2, direction - sign * math.pi / 2
    over, over_a, over_b = (math.sqrt(max(0.0, x)) for x in (a + b - d, (d - a) + b, (d - b) + a))
    all_sides = math.sqrt(a + b + d)
    at_a, at_b = 2 * math.atan2(over * over_a, all_sides * over_b), 2 * math.atan2(over * over_b, all_sides * over_a)
    return direction + sign * at_a, direction - sign * at_b


def link_to_line(start: float, length: float, height: float, sign: int) -> float:
    """Return the angle of a link from height `start` to a horizontal line; it points along the line if sign is 1.

    Parameters
    ----------
    start, height : float
        Where the link begins, and the line [m].
    length : float
        Of the link [m].
    sign : int
        1 or -1.
    """
    rise = height - start
    return math.atan2(rise, sign * leg(length, rise))


def two_links_margin(distance: float, a: float, b: float) -> float:
    """Return how far `distance` is inside [|a - b|, a + b], where two links close; negative outside.

    Parameters
    ----------
    distance, a, b : float
        From foot to end, and the links [m].
    """
    return min(distance - abs(a - b), a + b - distance)


def between_circles(p: Fraction, q: Fraction, low: Fraction, high: Fraction | None) -> tuple[Interval, ...]:
    """Return the angles theta at which low <= |p - q e^(i theta)| <= high; None sets no upper bound.

    Parameters
    ----------
    p, q, low, high : Fraction
        Lengths [m].
    """
    high = p + q if high is None else high
    if p + q < low or abs(p - q) > high:
        return ()
    first = corner(p, q, low) if abs(p - q) < low else 0.0
    last = corner(p, q, high) if p + q > high else math.pi
    if first == 0.0:
        return ((-last, last),) if last < math.pi else ANYWHERE
    return ((first, last), (-last, -first)) if last < math.pi else ((first, math.tau - first),)


def between_lines(radius: Fraction, low: Fraction, high: Fraction) -> tuple[Interval, ...]:
    """Return the angles theta at which low <= radius sin(theta) <= high.

    Parameters
    ----------
    radius, low, high : Fraction
        Lengths [m].
    """
    if low > radius or high < -radius:
        return ()
    bottom = math.atan2(low, leg(radius, low)) if low > -radius else None
    top = math.atan2(high, leg(radius, high)) if high < radius else None
    if bottom is None:
        return ANYWHERE if top is None else ((-math.pi - top, top),)
    return ((bottom, math.pi - bottom),) if top is None else ((bottom, top), (math.pi - top, math.pi - bottom))


def shifted(intervals: tuple[Interval, ...], by: float) -> tuple[Interval, ...]:
    """Return the intervals moved by a constant."""
    return tuple((low + by, high + by) for low, high in intervals)


def covers(intervals: tuple[Interval, ...], low: float, high: float, period: float) -> bool:
    """Return whether one interval, or a copy of it whole periods away, covers [low, high].

    Parameters
    ----------
    intervals : tuple of (float, float)
        From, to.
    low, high, period : float
        In their unit.
    """
    for first, last in intervals:
        away = period * math.floor((low - first) / period) if math.isfinite(first) and math.isfinite(period) else 0.0
        if first + away <= low and high <= last + away:
            return True
    return False
