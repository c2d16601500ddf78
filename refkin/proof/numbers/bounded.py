"""Float64 numbers that carry a proved bound of their rounding error and of how far they move with the coordinates.

The formulas of the joints run on these numbers unchanged, so no bound is stated beside a formula: it is computed from
it. A `Bounded` number stands for a function of the coordinates, at q0 and over a box |q - q0| <= s box, 0 <= s <= 1:

    |value(q0) - mid| <= rounding     |value(q) - value(q0)| <= s spread

`rounding` is a running-error bound (Higham, Accuracy and Stability of Numerical Algorithms, section 3.3). `spread`
bounds the motion over the box; the spread of phi_q over a box of radius r is r times a Lipschitz constant of phi_q
there, the K(r) of Newton and Kantorovich. For a sum it is the sum, and for a product

    |x y - x0 y0| <= |x0| |dy| + |y0| |dx| + |dx| |dy|,   |x0| <= |mid| + rounding,   |dx| <= s spread,   s^2 <= s.

What is assumed: IEEE 754 arithmetic, rounding to nearest, and sine and cosine within 2 ulp. The bounds themselves are
computed in binary64 from sums and products of non-negative numbers; each such operation is off by a factor within
1 +- 2^-53 and at most 2^12 of them lie on the way to any bound, which `UP` makes good when the bounds are read.

`Extended` does the same with the machine's long double in the middle, 64 bits on x86-64 and those of binary64 where a
machine has no more. What is small by cancellation, a residual at a solution, is then known to a few digits; it alone
decides how sharp a certificate is.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import lru_cache
from typing import Any, Self, cast

import numpy as np
from flint import arb, ctx

from refkin.errors import RefkinError
from refkin.joints import Unit
from refkin.proof.numbers.exact import continued, exact, exact_system
from refkin.system import System

U = 2.0**-53
"""Unit round-off of binary64: a result r of + - * is off by at most U |r|."""
UP = 1.0 + 2.0**-40
"""More than (1 + U)^(2^12)."""
TINY = 2.0**-900
"""More than all that is lost by underflow."""
LAW_BITS = 160
"""Precision in which geometry and laws are computed before they are rounded."""


class NoFormula(RefkinError):
    """The formulas of a joint do what the numbers of a proof cannot."""

    def __init__(self, what: str) -> None:
        super().__init__(f"formulas of joints add, subtract, multiply, and take sines and cosines; here is {what}")


class Bounded:
    """A float or a row of floats (B,), with the bounds `rounding` and `spread` of the module."""

    __slots__ = ("_size", "mid", "rounding", "spread")
    __array_ufunc__ = None  # an array on the left of + - * leaves the operation to this class
    unit = U

    def __init__(self, mid: Any, rounding: Any = 0.0, spread: Any = 0.0, size: Any = None) -> None:
        self.mid = mid
        self.rounding = rounding
        self.spread = spread
        self._size = size

    @classmethod
    def near(cls, parts: Any, spread: Any = 0.0) -> Self:
        """Return the number, or row, that lies within parts[2] of parts[0] + parts[1] (see `parts`)."""
        high, low, rest = parts
        return cls(high, abs(low) + rest, spread)

    @classmethod
    def exactly(cls, mid: Any, spread: Any = 0.0) -> Self:
        """Return binary64 numbers, which are what they are."""
        return cls(mid, 0.0, spread)

    @staticmethod
    def size_of(mid: Any) -> Any:
        """Return |mid| in binary64."""
        return abs(mid)

    @property
    def size(self) -> Any:
        """The size of `mid`, which is a factor of several products."""
        if self._size is None:
            self._size = self.size_of(self.mid)
        return self._size

    def __add__(self, other: Any) -> Bounded:
        if isinstance(other, int | float) and not other:
            return self
        x = other if isinstance(other, Bounded) else self.exactly(other)
        mid = self.mid + x.mid
        back = mid - self.mid
        lost = (self.mid - (mid - back)) + (x.mid - back)  # exactly (Knuth's two-sum)
        return type(self)(mid, self.rounding + x.rounding + self.size_of(lost), self.spread + x.spread)

    def __sub__(self, other: Any) -> Bounded:
        if not isinstance(other, Bounded):
            return self.__add__(-other)
        mid = self.mid - other.mid
        back = mid - self.mid
        lost = (self.mid - (mid - back)) - (other.mid + back)
        return type(self)(mid, self.rounding + other.rounding + self.size_of(lost), self.spread + other.spread)

    def __rsub__(self, other: Any) -> Bounded:
        return (-self).__add__(other)

    def __mul__(self, other: Any) -> Any:
        if isinstance(other, int | float) and other in (0, 1, -1):  # as of the ground, and of points on an axis
            return self if other == 1 else -self if other else 0
        x = other if isinstance(other, Bounded) else self.exactly(other)
        mid = self.mid * x.mid
        size, most, most_x = self.size_of(mid), self.size + self.rounding, x.size
        rounding = _scaled(self.rounding, most_x) + _scaled(x.rounding, most) + (self.unit * size + TINY)
        spread = _scaled(self.spread, most_x, x.rounding) + _scaled(x.spread, most, self.spread)
        return type(self)(mid, rounding, spread, size)

    def __truediv__(self, other: Any) -> Bounded:
        raise NoFormula("a quotient")

    __radd__ = __add__
    __rmul__ = __mul__
    __rtruediv__ = __truediv__

    def __neg__(self) -> Bounded:
        return type(self)(-self.mid, self.rounding, self.spread, self._size)

    def cos(self) -> Bounded:
        """Return the cosine; its slope is at most 1."""
        return self._trigonometric(np.cos(self.mid))

    def sin(self) -> Bounded:
        """Return the sine; its slope is at most 1."""
        return self._trigonometric(np.sin(self.mid))

    def _trigonometric(self, mid: Any) -> Bounded:
        # An ulp of x is at most 2 unit |x|.
        size = self.size_of(mid)
        return type(self)(mid, self.rounding + (4 * self.unit * size + TINY), self.spread, size)


def _scaled(bound: Any, size: Any, more: Any = None) -> Any:
    """Return a bound times a size, or a sum of two; no bounds, as those of what is exact, cost nothing so."""
    if not (isinstance(bound, np.ndarray) or bound):
        return 0.0
    return bound * (size if more is None else size + more)


class Extended(Bounded):
    """A `Bounded` number whose `mid` is a long double; its bounds stay in binary64."""

    __slots__ = ()
    unit = 2.0 ** -(np.finfo(np.longdouble).nmant + 1)

    @classmethod
    def near(cls, parts: Any, spread: Any = 0.0) -> Self:
        high, low, rest = parts
        mid = np.longdouble(high) + np.longdouble(low)
        return cls(mid, 2 * cls.unit * abs(high) * (low != 0) + rest, spread)

    @classmethod
    def exactly(cls, mid: Any, spread: Any = 0.0) -> Self:
        return cls(np.longdouble(mid), 0.0, spread)

    @staticmethod
    def size_of(mid: Any) -> Any:
        return abs(mid.astype(float))


@dataclass(frozen=True)
class Bounds:
    """The parts of many `Bounded` numbers as arrays of shape (..., B), the bounds read: rounded up."""

    mid: Any
    rounding: Any
    spread: Any


def box(q: Any, radii: Any = 0.0, number: type[Bounded] = Bounded) -> Any:
    """Return coordinates as an object array (n,) of rows over a box around them.

    Parameters
    ----------
    q : (n, B) array
        The middles, in the system's coordinates.
    radii : float or (n, B) array
        Half-widths of the boxes.
    number : type
        `Bounded`, or a kind of it that carries more.
    """
    spreads = [0.0] * len(q) if isinstance(radii, float) and not radii else np.broadcast_to(radii, np.shape(q))
    out = np.empty(len(q), object)
    for k, (mid, spread) in enumerate(zip(q, spreads, strict=True)):
        out[k] = number.exactly(mid, spread)
    return out


def read(numbers: Any, batch: int, wide: Any = float) -> Bounds:
    """Return an object array of `Bounded` numbers and plain ones as arrays, B = `batch`.

    The middles are binary64, or `wide`: then they are as they are.

    Parameters
    ----------
    numbers : array of object
        Of any shape.
    batch : int
        B.
    wide : type
        Of the numbers that are returned.
    """
    mid, rounding, spread = (np.zeros((numbers.size, batch), kind) for kind in (wide, float, float))
    for place, x in enumerate(numbers.flat):
        if isinstance(x, Bounded):
            mid[place], rounding[place], spread[place] = x.mid, x.rounding, x.spread + TINY
            if x.unit < U and wide is float:
                rounding[place] += U * x.size
        elif not isinstance(x, int) or x:
            mid[place] = x
    return Bounds(*(part.reshape(*numbers.shape, batch) for part in (mid, rounding * UP, spread * UP)))


def off_by(slope: Bounds, rates: Any, right: Bounds) -> Bounds:
    """Return slope rates - right, (m, B).

    Parameters
    ----------
    slope : Bounds
        phi_q, (m, n, B), with middles of either kind.
    rates : (n, B) array
        qd or qdd, the numbers that they are.
    right : Bounds
        nu or gamma, (m, B).
    """
    sizes, unit = np.abs(rates), (Extended if slope.mid.dtype == np.longdouble else Bounded).unit
    mid = product(slope.mid, rates) - right.mid
    # A rounding per term that is not zero, and one of their sum, at most; U: what is lost of the result in binary64.
    terms = 2 + np.count_nonzero(slope.mid.any(axis=-1), axis=1, keepdims=True)
    lost = terms * unit * (product(np.abs(slope.mid), sizes) + np.abs(right.mid)) + U * np.abs(mid)
    rounding = product(slope.rounding, sizes) + right.rounding + lost
    return Bounds(mid.astype(float), UP * rounding.astype(float), UP * (product(slope.spread, sizes) + right.spread))


def product(matrix: Any, vector: Any) -> Any:
    """Return the product sample by sample of (m, n, B) and (n, B)."""
    return np.einsum("ijb,jb->ib", matrix, vector)


class Times:
    """Times (B,), or all within `half` of them, for a `bounded_system`; each law is computed exactly and once."""

    def __init__(self, t: Any, order: int, half: Any = None) -> None:
        self.t, self.order, self.half = np.asarray(t, float), order, half
        self._values: dict[str, list[Any]] = {}

    def values(self, constraint: Any, unit: Unit) -> list[Any]:
        """Return per law its scaled value and derivatives up to `order` as `parts`, (order + 1, 3, B)."""
        if constraint.name not in self._values:
            with ctx.workprec(LAW_BITS):
                laws = constraint.inputs(np.frompyfunc(arb, 1, 1)(self.t), unit, self.order)
                each = [[np.array([parts(x) for x in rows]).reshape(-1, 3).T for rows in law] for law in laws]
            self._values[constraint.name] = [np.array(law) for law in each]
        return self._values[constraint.name]

    def blurs(self, blurred: Any, unit: Unit) -> list[Any]:
        """Return per law of a blurred constraint how far its values and derivatives may be off, (order + 1, B)."""
        with ctx.workprec(LAW_BITS):
            laws = blurred.inputs(np.frompyfunc(arb, 1, 1)(self.t), unit, self.order)
            return [np.array([[float(arb(x).rad()) for x in row] for row in law]) for law in laws]

    def moves(self, constraint: Any, unit: Unit) -> Any:
        """Return bounds of |f(t + s) - f(t)| and |f'(t + s) - f'(t)|, |s| <= half, for each law, (laws, 2, B).

        As balls the intervals are a rounding longer than they are: where a table ends, its last piece goes on so long.
        """
        onward, widths = continued(constraint), []
        with ctx.workprec(LAW_BITS):
            for t, half in zip(self.t.tolist(), self.half.tolist(), strict=True):
                at, around = (onward.inputs(x, unit, 1) for x in (arb(t), arb(t, half)))
                widths.append([[half * _above(b[1]), _above(b[1] - a[1])] for a, b in zip(at, around, strict=True)])
        return np.moveaxis(np.array(widths), 0, -1)


@dataclass(frozen=True)
class InputError:
    """An error of every number of a mechanism: `relative` times the number, or times `least` if it is smaller."""

    relative: float
    least: float = 0.0

    def of(self, x: Any) -> Any:
        """Return the error of a number or row."""
        return self.relative * np.maximum(abs(x), self.least)


EXACT = InputError(0.0)
"""The numbers of the mechanism are meant as they stand."""


class _Rounded:
    """A constraint whose laws come from `Times`; its formulas are the constraint's own.

    `blurred` is the constraint of numbers that have the error: a table magnifies it in the derivatives of a law.
    """

    def __init__(self, exact: Any, number: type[Bounded], error: InputError, blurred: Any) -> None:
        self.exact, self.number, self.error, self.blurred = exact, number, error, blurred

    def __getattr__(self, name: str) -> Any:
        return getattr(self.exact, name)

    def inputs(self, t: Times, unit: Unit, order: int) -> tuple[tuple[Bounded, ...], ...]:
        """Return the laws' values; more orders than asked do no harm."""
        if not self.exact.laws:
            return ()
        values = t.values(self.exact, unit)
        if t.half is not None:
            moves = t.moves(self.exact, unit)
            return tuple(tuple(map(self.number.near, law, by)) for law, by in zip(values, moves, strict=True))
        blurs = values if self.error is EXACT else t.blurs(self.blurred, unit)
        return tuple(self._law(orders, blur, t.t) for orders, blur in zip(values, blurs, strict=True))

    def profile_values(self, s: Bounded, unit: Unit, order: int) -> tuple[Bounded, ...]:
        """Return the profile around s: its exact values there, and how far its slope over all of s moves them."""
        at, reach = np.broadcast_arrays(s.mid, UP * (s.rounding + s.spread))
        values: list[Any] = []
        slopes: list[Any] = []
        blurs: list[Any] = []
        with ctx.workprec(LAW_BITS):
            for mid, off in zip(at.ravel(), reach.ravel().tolist(), strict=True):
                high = float(mid)
                middle = arb(high) + arb(float(mid - high))
                values.append([parts(x) for x in self.exact.profile_values(middle, unit, order)])
                around = self.exact.profile_values(middle + arb(0, off), unit, order + 1)[1:]
                slopes.append([_above(x) for x in around])
                off_by_error = () if self.error is EXACT else self.blurred.profile_values(middle, unit, order)
                blurs.append([float(arb(x).rad()) for x in off_by_error] or [0.0] * len(values[-1]))
        rounded = []
        each = (np.moveaxis(np.array(values), 0, -1), np.array(slopes).T, np.array(blurs).T)
        for near, slope, blur in zip(*each, strict=True):
            x = self.number.near(near.reshape(3, *at.shape))
            steep, own = slope.reshape(at.shape), np.maximum(self.error.of(0.0), blur).reshape(at.shape)
            rounded.append(self.number(x.mid, x.rounding + steep * s.rounding, own + steep * s.spread))
        return tuple(rounded)

    def _law(self, orders: Any, blur: Any, t: Any) -> tuple[Bounded, ...]:
        if self.error is EXACT:
            return tuple(map(self.number.near, orders))
        # The time is a number too: what an error of it does to the value, by the derivative.
        by_time = [self.error.relative * abs(t * derivative[0]) for derivative in orders[1:]]
        own = [np.maximum(self.error.of(0.0), by) + more for by, more in zip(blur, by_time, strict=False)]
        return tuple(self.number.near(at, spread) for at, spread in zip(orders, own, strict=False))


def bounded_system(system: System, number: type[Bounded] = Bounded, error: InputError = EXACT) -> System:
    """Return the system of `exact_system` with its numbers rounded, each with the bound of its rounding.

    Its `q` are object arrays of `number` (see `box`), its `t` are `Times`. With an `error` every geometric number, law
    value and time also spreads by it (times of `order` 1 then serve order 0), by that of its size in the scene.
    Its gauge is that of the system.

    Parameters
    ----------
    system : System
    number : type
        `Bounded`, or `Extended` for the sharper residual.
    error : InputError
        How far each number of the mechanism may be off.
    """
    kind: Any = number
    bounded = _bounded_system(system, kind, error)
    return replace(bounded, gauge=system.gauge) if system.gauge or bounded.gauge else bounded


@lru_cache(maxsize=64)
def _bounded_system(system: System, number: type[Bounded], error: InputError) -> System:
    placed = []
    for own, p in zip(system.placed, exact_system(system, LAW_BITS).placed, strict=True):
        with ctx.workprec(LAW_BITS):
            if error is EXACT:  # zeros cost nothing so
                g = tuple(int(float(x)) if x in (0, 1, -1) else number.near(parts(x)) for x in p.g)
            else:
                in_scene = [float(x) for x in p.constraint.constants(Unit(system.unit.size))]
                g = tuple(number.near(parts(x), error.of(size)) for x, size in zip(p.g, in_scene, strict=True))
            blurred = p.constraint if error is EXACT else exact(own.constraint, error.relative)
        constraint = _Rounded(p.constraint, number, error, blurred)
        placed.append(replace(p, constraint=cast(Any, constraint), g=cast(Any, g)))
    return replace(system, placed=tuple(placed))


def parts(x: Any) -> tuple[float, float, float]:
    """Return a ball, or a float, as two floats that add up to about it, and a bound of what they leave."""
    high = float(x)
    if x == high:
        return high, 0.0, 0.0
    low = float(left := x - high)
    return high, low, _above(left - low)


def _above(x: Any) -> float:
    return float(abs(arb(x)).upper()) * UP + TINY
