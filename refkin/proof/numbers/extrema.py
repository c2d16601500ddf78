"""Extrema and zeros of motion laws between two times: where what drives a row turns back.

Between two neighbours in the extrema a law is monotone, so that its signs there say whether it has a zero in between;
and the extrema are zeros of f', which is a law of the same kind, a polynomial of lower degree, or known in closed form.
So nothing is sampled. Each is a float64 number next to a true one of the law whose derivative has the coefficients that
float64 leaves of it: two extrema between which f moves by no more than its rounding may be missing, or both be there.
"""

from __future__ import annotations

import math
from bisect import bisect_left, bisect_right
from collections.abc import Callable, Iterable, Sequence
from fractions import Fraction
from functools import lru_cache, partial
from typing import Any

import numpy as np

from refkin.joints import Constraint
from refkin.motion_laws import Integral, Law, Polynomial, Sinusoid, Table

LISTED = 100_000
"""Extrema of a law that are listed; nobody steps through more. A list that is longer holds some times of many more."""


def extrema_of(constraints: Iterable[Constraint], a: float, b: float) -> list[float]:
    """Return the times between a and b at which what drives one of these constraints turns back, in order.

    The row of a distance depends on f^2: that turns back where f does, and where f is zero.

    Parameters
    ----------
    constraints : iterable of Constraint
    a, b : float
        Times [s].
    """
    times: set[float] = set()
    for constraint in constraints:
        for law in constraint.laws:
            times.update(extrema(law, a, b))
            if drives_a_distance(constraint):
                times.update(zeros(law, a, b))
    return sorted(times)


def drives_a_distance(constraint: Constraint) -> bool:
    """Return whether its row depends on the square of its law."""
    return any(element.squared and element.laws for element in constraint.elements())


def extrema(law: Law, a: float, b: float) -> list[float]:
    """Return where the rate of a law changes its sign between a and b, in order; if at more than `LISTED`, more times.

    Parameters
    ----------
    law : Law
        Polynomial, sinusoid, table, or the integral of one.
    a, b : float
        The ends of the interval [s].

    Raises
    ------
    TypeError
        If it is a law of another kind.
    """
    if isinstance(law, Integral):
        return zeros(law.rate, a, b)
    if isinstance(law, Polynomial):
        return zeros(derivative(law), a, b) if len(law.coefficients) > 2 else []
    if isinstance(law, Sinusoid):
        return _of_sine(law, a, b)
    if isinstance(law, Table):
        return _of_spline(law, a, b)
    raise TypeError(f"law: expected a Polynomial, Sinusoid, Table or Integral of one, got a {type(law).__name__}")


def hides(law: Law, a: float, b: float) -> bool:
    """Return whether a law may do between a and b what nobody expects who knows it there.

    A table may where more than one of its arguments lies between, a sinusoid where its phase goes on by a radian, any
    other law where it turns back.

    Parameters
    ----------
    law : Law
    a, b : float
        Times [s].
    """
    if isinstance(law, Sinusoid):
        return abs(law.angular_frequency) * (b - a) > 1.0
    if not isinstance(law, Table):
        return bool(extrema(law, a, b))
    first, length = law.argument[0], law.argument[-1] - law.argument[0]
    turns = [math.floor((x - first) / length) if law.periodic else 0 for x in (a, b)]
    before, after = (
        turn * (len(law.argument) - 1) + bisect_left(law.argument, x - turn * length)
        for turn, x in zip(turns, (a, b), strict=True)
    )
    return after - before > 1


def zeros(law: Law, a: float, b: float) -> list[float]:
    """Return where a law changes its sign, or is 0 at an extremum, between a and b, in order.

    Parameters
    ----------
    law, a, b
        As for `extrema`.
    """
    if isinstance(law, Polynomial):
        return _of_polynomial(law, a, b)
    value: Callable[[float], float] = law
    if isinstance(law, Table):
        value = _Spline.of(law).value
    turning = extrema(law, a, b)
    return turning if len(turning) > LISTED else sign_changes(value, [a, *turning, b])


def derivative(law: Polynomial) -> Polynomial:
    """Return f' with rounded coefficients; a small part of it where they would leave float64: it has the same zeros."""
    exact = all(np.all(np.isfinite(k * c)) for k, c in enumerate(law.coefficients))
    part = 1.0 if exact else 0.5 ** len(law.coefficients)
    return Polynomial(coefficients=tuple(k * (part * c) for k, c in enumerate(law.coefficients) if k))


def sign_of(law: Polynomial, t: float) -> float:
    """Return 1.0, 0.0 or -1.0, exactly: where rounding could decide on the sign, it is that of rational numbers."""
    value, size, t = 0.0, 0.0, float(t)
    for c in reversed(law.coefficients):
        value, size = value * t + c, size * abs(t) + abs(c)
    if abs(value) > len(law.coefficients) * 2.0**-51 * size and size < math.inf:
        return math.copysign(1.0, value)
    exact: Any = Fraction(0)
    for c in reversed(law.coefficients):
        exact = exact * Fraction(t) + Fraction(c)
    return float((exact > 0) - (exact < 0))


def _of_sine(law: Sinusoid, a: float, b: float) -> list[float]:
    """Return the times at which the argument of the sine is pi/2 + k pi."""
    w = law.angular_frequency
    first, last = sorted((w * end + law.phase) / math.pi - 0.5 for end in (a, b))
    if not w * law.amplitude or not math.isfinite(last - first) or math.floor(last) < math.ceil(first):
        return []
    count = math.ceil(last) - math.floor(first) + 1
    numbers = float(math.floor(first)) + np.arange(min(count, LISTED + 3))  # two may lie outside
    return _inside(np.sort((math.pi * (numbers + 0.5) - law.phase) / w), a, b)


def _of_polynomial(law: Polynomial, a: float, b: float) -> list[float]:
    """Return where a polynomial changes its sign, which each of its derivatives tells of the one before it."""
    found: list[float] = []
    derivatives = [law]
    while len(derivatives[-1].coefficients) > 2:
        derivatives.append(derivative(derivatives[-1]))
    for each in reversed(derivatives):
        found = sign_changes(partial(sign_of, each), [a, *found, b])
    return found


def _of_spline(law: Table, a: float, b: float) -> list[float]:
    spline, first = _Spline.of(law), law.argument[0]
    places, length = spline.monotone, law.argument[-1] - first
    if law.periodic:
        before, after = (math.floor((end - first) / length) for end in (a, b))
        turns = before + np.arange(min(after - before + 1, 3 + LISTED // (len(places) - 1)))  # two may lie outside
        places = np.unique(places + length * turns[:, None])
        if len(turns) <= after - before:
            return _inside(places, a, b)
    return sign_changes(spline.rate, [a, *_inside(places, a, b), b])


class _Spline:
    """A cubic spline, number by number: a call of SciPy's costs ten times as much.

    Attributes
    ----------
    monotone : (K,) array
        The arguments between which f' is monotone: those of the table, and where f'' vanishes in a piece.
    """

    def __init__(self, law: Table) -> None:
        self.law, self.argument = law, law.argument
        self.pieces: list[list[float]] = law._spline.c.T.tolist()
        argument, (c3, c2, _, _) = np.array(law.argument), law._spline.c
        with np.errstate(all="ignore"):
            vanishing = argument[:-1] - c2 / (3.0 * c3)
        inner = (argument[:-1] < vanishing) & (vanishing < argument[1:])
        self.monotone = np.sort(np.concatenate([argument, vanishing[inner]]))

    @staticmethod
    @lru_cache(maxsize=64)
    def of(law: Table) -> _Spline:
        """Return the spline of a table, made once."""
        return _Spline(law)

    def value(self, t: float) -> float:
        """Return f(t)."""
        s, (c3, c2, c1, c0) = self._piece(t)
        return ((c3 * s + c2) * s + c1) * s + c0

    def rate(self, t: float) -> float:
        """Return f'(t)."""
        s, (c3, c2, c1, _) = self._piece(t)
        return (3.0 * c3 * s + 2.0 * c2) * s + c1

    def _piece(self, t: float) -> tuple[float, list[float]]:
        first, last = self.argument[0], self.argument[-1]
        x = first + (t - first) % (last - first) if self.law.periodic else t
        k = min(max(bisect_right(self.argument, x) - 1, 0), len(self.pieces) - 1)
        return x - self.argument[k], self.pieces[k]


def sign_changes(f: Callable[[float], float], places: Sequence[float]) -> list[float]:
    """Return the zeros of a function between the first and the last of places between which it is monotone.

    Each interval at whose ends the signs differ is halved until no float64 number is left in it.
    """
    signs = [float(np.sign(f(t))) for t in places]
    changes = [t for t, sign in zip(places[1:-1], signs[1:-1], strict=True) if sign == 0.0]
    for lo, hi, sign, other in zip(places, places[1:], signs, signs[1:], strict=False):
        if sign * other < 0.0:
            changes.append(_halved(f, lo, hi, sign))
    return sorted(changes)


def _halved(f: Callable[[float], float], lo: float, hi: float, sign: float) -> float:
    while lo < (middle := 0.5 * (lo + hi)) < hi and hi - lo > 2.0**-60 * max(abs(lo), abs(hi)):
        value = f(middle) * sign
        if value == 0.0:
            return middle
        lo, hi = (middle, hi) if value > 0.0 else (lo, middle)
    return float(lo)


def _inside(times: Any, a: float, b: float) -> list[float]:
    inside: list[float] = times[(a < times) & (times < b)].tolist()
    return inside
