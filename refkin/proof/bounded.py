"""Float64 numbers that carry a proved bound of their rounding error and of how far they move with the coordinates.

The formulas of the joints run on these numbers unchanged, so no bound is stated beside a formula: it is computed from it.
A `Bounded` number stands for a function of the coordinates over a box |q - q0| <= s box, 0 <= s <= 1:

    |value(q) - mid| <= rounding + s spread

`rounding` is a running-error bound (Higham, Accuracy and Stability of Numerical Algorithms, section 3.3): what the number
is off at q0 itself. `spread` bounds the motion over the whole box; the spread of phi_q over a box of radius r is r times a
Lipschitz constant of phi_q there, the K(r) of Newton and Kantorovich. For a sum it is the sum, and for a product

    |x y - x0 y0| <= |x0| |dy| + |y0| |dx| + |dx| |dy|,   |dx| <= rounding_x + s spread_x,   s^2 <= s.

What is assumed: IEEE 754 binary64, rounding to nearest, and sine and cosine within 2 ulp. The bounds themselves are
computed in float64 from sums and products of non-negative numbers; each such operation is off by a factor within
1 +- 2^-53 and at most 2^12 of them lie on the way to any bound, which `UP` makes good when the bounds are read.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import lru_cache
from typing import Any

import numpy as np
from flint import arb, ctx

from refkin.joints import Unit
from refkin.proof.exact import exact_system
from refkin.system import System

U = 2.0**-53
"""Unit round-off of binary64: a result r of + - * is off by at most U |r|."""
UP = 1.0 + 2.0**-40
"""More than (1 + U)^(2^12)."""
TINY = 2.0**-900
"""More than all that is lost by underflow."""
LAW_BITS = 113
"""Precision in which geometry and laws are computed before they are rounded to float64."""
TRIGONOMETRIC = 4 * U
"""Relative error of a sine or cosine within 2 ulp: an ulp of x is at most 2 U |x|."""


class Bounded:
    """A float or a row of floats (B,), with the bounds `rounding` and `spread` of the module."""

    __slots__ = ("mid", "rounding", "spread")
    __array_ufunc__ = None  # an array on the left of + - * leaves the operation to this class

    def __init__(self, mid: Any, rounding: Any = 0.0, spread: Any = 0.0) -> None:
        self.mid = mid
        self.rounding = rounding
        self.spread = spread

    def __add__(self, other: Any) -> Bounded:
        x = other if isinstance(other, Bounded) else Bounded(other)
        mid = self.mid + x.mid
        return Bounded(mid, self.rounding + x.rounding + U * abs(mid), self.spread + x.spread)

    def __sub__(self, other: Any) -> Bounded:
        x = other if isinstance(other, Bounded) else Bounded(other)
        mid = self.mid - x.mid
        return Bounded(mid, self.rounding + x.rounding + U * abs(mid), self.spread + x.spread)

    def __rsub__(self, other: Any) -> Bounded:
        return Bounded(other) - self

    def __mul__(self, other: Any) -> Bounded:
        x = other if isinstance(other, Bounded) else Bounded(other)
        mid = self.mid * x.mid
        most, most_x = abs(self.mid) + self.rounding, abs(x.mid)
        rounding = most * x.rounding + most_x * self.rounding + (U * abs(mid) + TINY)
        spread = (most + self.spread) * x.spread + (most_x + x.rounding) * self.spread
        return Bounded(mid, rounding, spread)

    __radd__ = __add__
    __rmul__ = __mul__

    def __neg__(self) -> Bounded:
        return Bounded(-self.mid, self.rounding, self.spread)

    def cos(self) -> Bounded:
        """Return the cosine; its slope is at most 1."""
        mid = np.cos(self.mid)
        return Bounded(mid, self.rounding + (TRIGONOMETRIC * abs(mid) + TINY), self.spread)

    def sin(self) -> Bounded:
        """Return the sine; its slope is at most 1."""
        mid = np.sin(self.mid)
        return Bounded(mid, self.rounding + (TRIGONOMETRIC * abs(mid) + TINY), self.spread)


@dataclass(frozen=True)
class Bounds:
    """The parts of many `Bounded` numbers as arrays of shape (..., B), the bounds read: rounded up."""

    mid: Any
    rounding: Any
    spread: Any


def box(q: Any, radii: Any = 0.0) -> Any:
    """Return coordinates (n, B) as an object array (n,) of `Bounded` rows over the box of the given radii."""
    q, radii = np.asarray(q, float), np.broadcast_to(radii, np.shape(q))
    out = np.empty(len(q), object)
    for k, (mid, spread) in enumerate(zip(q, radii, strict=True)):
        out[k] = Bounded(mid, 0.0, spread)
    return out


def read(numbers: Any, lanes: int) -> Bounds:
    """Return an object array of `Bounded` numbers and plain ones as arrays, B = `lanes`."""
    mid, rounding, spread = (np.zeros((*numbers.shape, lanes)) for _ in range(3))
    for place, x in np.ndenumerate(numbers):
        if isinstance(x, Bounded):
            mid[place], rounding[place], spread[place] = x.mid, x.rounding, x.spread + TINY
        else:
            mid[place] = x
    return Bounds(mid, rounding * UP, spread * UP)


class Times:
    """Times (B,) for a `bounded_system`, with the laws' values there: each computed exactly once, then rounded."""

    def __init__(self, t: Any, order: int, input_error: float = 0.0) -> None:
        self.t = np.asarray(t, float)
        self.order = order
        self.input_error = input_error
        self._inputs: dict[str, tuple[tuple[Bounded, ...], ...]] = {}

    def inputs(self, constraint: Any, unit: Unit) -> tuple[tuple[Bounded, ...], ...]:
        """Return per law its scaled value and derivatives up to `order`, as rows."""
        if not constraint.laws:
            return ()
        if constraint.name not in self._inputs:
            with ctx.workprec(LAW_BITS):
                exact = [constraint.inputs(arb(t), unit, self.order) for t in self.t.tolist()]
                laws = [[[rounded(x) for x in at] for at in zip(*law, strict=True)] for law in zip(*exact, strict=True)]
            self._inputs[constraint.name] = tuple(tuple(self._row(values) for values in law) for law in laws)
        return self._inputs[constraint.name]

    def _row(self, values: list[tuple[float, float]]) -> Bounded:
        mid, rounding = np.array(values).T
        return Bounded(mid, rounding, self.input_error * abs(mid))


class _Rounded:
    """A constraint whose laws come from `Times`; its formulas are the constraint's own."""

    def __init__(self, exact: Any) -> None:
        self.exact = exact

    def __getattr__(self, name: str) -> Any:
        return getattr(self.exact, name)

    def inputs(self, t: Times, unit: Unit, order: int) -> tuple[tuple[Bounded, ...], ...]:
        """Return the laws' values; more orders than asked do no harm."""
        return t.inputs(self.exact, unit)


@lru_cache(maxsize=64)
def bounded_system(system: System, input_error: float = 0.0) -> System:
    """Return the system of `exact_system` with its numbers rounded to float64, each with the bound of its rounding.

    Its `q` are object arrays of `Bounded` (see `box`), its `t` are `Times`. With `input_error` every geometric number
    also spreads by that part of itself; the laws' values do so by the `input_error` of the `Times`.
    """
    placed = []
    for p in exact_system(system, LAW_BITS).placed:
        with ctx.workprec(LAW_BITS):
            g = tuple(Bounded(mid, error, input_error * abs(mid)) for mid, error in map(rounded, p.g))
        placed.append(replace(p, constraint=_Rounded(p.constraint), g=g))
    return replace(system, placed=tuple(placed))


def rounded(x: Any) -> tuple[float, float]:
    """Return a ball, or a float, as a float and a bound of the distance to everything in it."""
    mid = float(x)
    return mid, 0.0 if x == mid else float(abs(x - mid).upper()) * UP + TINY


def _row(values: Any, input_error: float) -> Bounded:
    mid, rounding = np.array(values).T
    return Bounded(mid, rounding, input_error * abs(mid))
