"""A number that depends on one parameter, enclosed over an interval of it by a ball and a slope.

For a parameter m + h, |h| <= r, `whole` holds every value x(m + h), `centre` holds x(m), and x(m + h) - x(m) lies in
slope * h (Krawczyk and Neumaier, SIAM J. Numer. Anal. 22, 1985). So the excess of an enclosure shrinks with r^2, not
with r, and few intervals prove that a mechanism misses by little. Mixed with plain balls, those are constants.
"""

from __future__ import annotations

from typing import Any

from flint import arb

from refkin.proof.assembly.loci import Ball


class Slope:
    """See the module; `step` is the ball of all h."""

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
