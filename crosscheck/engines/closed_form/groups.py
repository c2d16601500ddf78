"""Where two loci of a point meet: two lines, a line and a circle, two circles. All of class II rests on these three.

With g_1, g_2 the gradients of the two loci at the meeting point (a line's normal, a circle's radius vector), the sign
of g_1 x g_2 tells the two meeting points apart. It is the sign of the determinant of the dyad's loop Jacobian, so it
cannot change along a motion away from a singular pose.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from crosscheck.engines.closed_form.jets import Arithmetic, Jet, Mask, Number, Planar


@dataclass(frozen=True)
class Line:
    """normal . p = level."""

    normal: Planar
    level: Jet


@dataclass(frozen=True)
class Circle:
    """|p - centre| = radius."""

    centre: Planar
    radius: Jet


Locus = Line | Circle


@dataclass(frozen=True)
class Slack:
    """A number that must not be negative if the loci are to meet: `scale` bounds its terms, `name` says what it is.

    Where it is 0 both meeting points are one; `rate` is its derivative in time.
    """

    value: Number
    rate: Number
    scale: Number
    name: str


@dataclass(frozen=True)
class Meeting:
    """The meeting points foot + sign * chord; sign of g_1 x g_2. Without a chord there is one point."""

    foot: Planar
    chord: Planar | None
    absent: Mask
    singular: Mask
    slacks: tuple[Slack, ...]

    def point(self, sign: float) -> Planar:
        """Return the meeting point of the given orientation, +1 or -1."""
        if self.chord is None:
            return self.foot
        return self.foot + self.chord if sign > 0 else self.foot - self.chord


def meet(one: Locus, two: Locus, arithmetic: Arithmetic) -> Meeting:
    """Return where two loci meet, lines before circles."""
    if isinstance(one, Line):
        return lines(one, two, arithmetic) if isinstance(two, Line) else line_and_circle(one, two, arithmetic)
    assert isinstance(two, Circle), "a line comes before a circle"
    return circles(one, two, arithmetic)


def lines(one: Line, two: Line, arithmetic: Arithmetic) -> Meeting:
    """Solve n_1 . p = k_1, n_2 . p = k_2 by Cramer: singular where the lines are parallel."""
    det = one.normal.cross(two.normal)
    x = (one.level * two.normal.y - two.level * one.normal.y) / det
    y = (one.normal.x * two.level - two.normal.x * one.level) / det
    _, parallel = arithmetic.sign(det.v, 1.0)
    return Meeting(Planar(x, y), None, np.zeros_like(parallel), parallel, ())


def line_and_circle(line: Line, circle: Circle, arithmetic: Arithmetic) -> Meeting:
    """Solve n . p = k, |p - c| = r: p = c + d n + s h n.perp() with d = k - n . c and h^2 = (r - d)(r + d).

    n x (p - c) = s h.
    """
    d = line.level - line.normal.dot(circle.centre)
    slack = circle.radius - _magnitude(d)
    scale = circle.radius.v + abs(line.level.v) + _reach(circle.centre)
    slacks = (Slack(slack.v, slack.d, scale, "radius - distance of the line"),)
    absent, singular = _judge(slacks, arithmetic)
    h = _root((circle.radius - d) * (circle.radius + d), singular, arithmetic)
    foot = circle.centre + line.normal.scaled(d)
    return Meeting(foot, line.normal.perp().scaled(h), absent, singular, slacks)


def circles(one: Circle, two: Circle, arithmetic: Arithmetic) -> Meeting:
    """Solve |p - c_1| = a, |p - c_2| = b: p = c_1 + x e + s h e.perp(), e along D = |c_2 - c_1|.

    x = (D^2 + (a - b)(a + b)) / (2 D), h = sqrt((a+b-D)(a+b+D)(D+a-b)(D-a+b)) / (2 D) (Heron, factored so that neither
    end of the range cancels); (p - c_1) x (p - c_2) = s h D.
    """
    a, b = one.radius, two.radius
    span = two.centre - one.centre
    distance = span.length()
    e = span.over(distance)
    total, difference = a + b, a - b
    scale = total.v + distance.v + _reach(one.centre) + _reach(two.centre)
    outer, inner = total - distance, distance - _magnitude(difference)
    slacks = (Slack(outer.v, outer.d, scale, "(a + b) - D"), Slack(inner.v, inner.d, scale, "D - |a - b|"))
    absent, singular = _judge(slacks, arithmetic)
    heron = (total - distance) * (total + distance) * (distance + difference) * (distance - difference)
    twice = distance + distance
    x = (distance * distance + difference * total) / twice
    h = _root(heron, singular, arithmetic) / twice
    return Meeting(one.centre + e.scaled(x), e.perp().scaled(h), absent, singular, slacks)


def _magnitude(x: Jet) -> Jet:
    """Return |x| with its rate; the second derivative is not used."""
    sign = np.where(np.asarray(x.v < 0, bool), -1, 1)
    return Jet(abs(x.v), 0 if type(x.d) is int else x.d * sign)


def _reach(point: Planar) -> Number:
    return abs(point.x.v) + abs(point.y.v)


def _judge(slacks: tuple[Slack, ...], arithmetic: Arithmetic) -> tuple[Mask, Mask]:
    judged = [arithmetic.sign(slack.value, slack.scale) for slack in slacks]
    absent = np.logical_or.reduce([negative for negative, _ in judged])
    return absent, np.logical_or.reduce([zero for _, zero in judged]) & ~absent


def _root(square: Jet, zero: Mask, arithmetic: Arithmetic) -> Jet:
    clipped = arithmetic.clipped(square.v, zero) if np.any(zero) else square.v
    return Jet(clipped, square.d, square.a).sqrt()
