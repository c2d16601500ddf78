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
