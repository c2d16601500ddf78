"""Numbers that carry their first two derivatives in time, and the two arithmetics they run in: float64 rows and balls.

A closed form for the position, evaluated on jets, is a closed form for velocity and acceleration: no formula for either
is written anywhere (Griewank and Walther, Evaluating Derivatives, chapter 13, for the recurrences).
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from functools import cached_property
from typing import Any

import numpy as np
from flint import arb
from numpy.typing import NDArray

Number = Any
"""A float, a ball, or a NumPy row (T,) of either; the int 0 as a derivative means "constant"."""

Mask = NDArray[np.bool_]


class Floats:
    """IEEE double precision; a slack is zero when the half-chord that it makes is below 8 sqrt(eps) of the scale.

    A half-chord is h = sqrt(2 r slack) for a slack far below r: h / r <= 8 sqrt(eps) is slack / r <= 32 eps. A few
    round-offs of the slack then are a good part of it.
    """

    zero = 32 * np.finfo(float).eps

    def number(self, value: float) -> Number:
        """Return a float of the scene, exactly."""
        return float(value)

    def row(self, values: tuple[float, ...]) -> Number:
        """Return the numbers as a row (T,), exactly."""
        return np.array(values, float)

    def pi(self) -> Number:
        """Return pi."""
        return math.pi

    def sign(self, slack: Number, scale: Number) -> tuple[Mask, Mask]:
        """Return where the slack is surely negative, and where its sign cannot be told; `scale` bounds its terms."""
        small = np.abs(slack) <= self.zero * scale
        return np.asarray((slack < 0.0) & ~small), np.asarray(small)

    def clipped(self, square: Number, zero: Mask) -> Number:
        """Return a square whose true value is not negative, fit for a root where it vanishes (`zero`)."""
        return np.where(zero, np.maximum(square, 0.0), square)


class Balls:
    """`flint.arb` balls at the precision of the current flint context: every number encloses the exact one."""

    def number(self, value: float) -> Number:
        return arb(value)

    def row(self, values: tuple[float, ...]) -> Number:
        return np.array([arb(value) for value in values], dtype=object)

    def pi(self) -> Number:
        return arb.pi()

    def sign(self, slack: Number, scale: Number) -> tuple[Mask, Mask]:
        del scale
        negative, positive = np.asarray(slack < 0, bool), np.asarray(slack > 0, bool)
        return negative, ~negative & ~positive & ~np.asarray(np.isnan(midpoint(slack)))

    def clipped(self, square: Number, zero: Mask) -> Number:
        return _nonnegative(square, zero)


Arithmetic = Floats | Balls

_nonnegative = np.frompyfunc(lambda ball, zero: ball.nonnegative_part() if zero else ball, 2, 1)
_ball_atan2 = np.frompyfunc(lambda y, x: arb.atan2(arb(y), arb(x)), 2, 1)
_float = np.frompyfunc(float, 1, 1)


def midpoint(value: Number) -> Any:
    """Return the float nearest each number."""
    return np.asarray(_float(value) if np.asarray(value).dtype.hasobject else value, float)


def atan2(y: Number, x: Number) -> Number:
    """Return the angle of (x, y) in either arithmetic."""
    of_balls = any(np.asarray(part).dtype.hasobject for part in (y, x))
    return _ball_atan2(y, x) if of_balls else np.arctan2(y, x)


def _mul(a: Number, b: Number) -> Number:
    return 0 if type(a) is int or type(b) is int else a * b


def _add(a: Number, b: Number) -> Number:
    if type(a) is int:
        return b
    return a if type(b) is int else a + b


def _neg(a: Number) -> Number:
    return 0 if type(a) is int else -a


def _sub(a: Number, b: Number) -> Number:
    if type(b) is int:
        return a
    return -b if type(a) is int else a - b


def _div(a: Number, b: Number) -> Number:
    return 0 if type(a) is int else a / b


class Jet:
    """A number with its first and second derivative in time; with `ZERO` and `ONE` nothing is computed."""

    __slots__ = ("a", "d", "v")

    def __init__(self, value: Number, rate: Number = 0, acceleration: Number = 0) -> None:
        self.v, self.d, self.a = value, rate, acceleration

    def __add__(self, other: Jet) -> Jet:
        if self is ZERO or other is ZERO:
            return other if self is ZERO else self
        return Jet(self.v + other.v, _add(self.d, other.d), _add(self.a, other.a))

    def __neg__(self) -> Jet:
        return self if self is ZERO else Jet(-self.v, _neg(self.d), _neg(self.a))

    def __sub__(self, other: Jet) -> Jet:
        if self is ZERO or other is ZERO:
            return -other if self is ZERO else self
        return Jet(self.v - other.v, _sub(self.d, other.d), _sub(self.a, other.a))

    def __mul__(self, other: Jet) -> Jet:
        if self is ZERO or other is ONE:
            return self
        if other is ZERO or self is ONE:
            return other
        if type(other.d) is int and type(other.a) is int:
            return self.times(other.v)
        if type(self.d) is int and type(self.a) is int:
            return other.times(self.v)
        cross = _mul(self.d, other.d)
        return Jet(
            self.v * other.v,
            _add(_mul(self.d, other.v), _mul(self.v, other.d)),
            _add(_add(_mul(self.a, other.v), _mul(self.v, other.a)), _add(cross, cross)),
        )

    def __truediv__(self, other: Jet) -> Jet:
        v = self.v / other.v
        d = _div(_sub(self.d, _mul(v, other.d)), other.v)
        turning = _mul(d, other.d)
        rest = _add(_add(turning, turning), _mul(v, other.a))
        return Jet(v, d, _div(_sub(self.a, rest), other.v))

    def times(self, factor: Number) -> Jet:
        """Return the jet multiplied by a constant."""
        return Jet(self.v * factor, _mul(self.d, factor), _mul(self.a, factor))

    def sqrt(self) -> Jet:
        """Return the square root r: r' = v'/(2 r), r'' = (v''/2 - r'^2)/r."""
        r = np.sqrt(self.v)
        d = _div(self.d, r + r)
        return Jet(r, d, _div(_sub(_div(self.a, 2), _mul(d, d)), r))

    def cos_sin(self) -> tuple[Jet, Jet]:
        """Return cosine and sine."""
        return _circling(np.cos(self.v), np.sin(self.v), self.d, self.a)


ZERO, ONE = Jet(0), Jet(1.0)
"""Numbers of frames that coincide."""


class Planar:
    """A vector of the plane, or a rotation (a unit one), as the complex number x + i y with jets for x and y."""

    __slots__ = ("x", "y")

    def __init__(self, x: Jet, y: Jet) -> None:
        self.x, self.y = x, y

    def __add__(self, other: Planar) -> Planar:
        return Planar(self.x + other.x, self.y + other.y)

    def __sub__(self, other: Planar) -> Planar:
        return Planar(self.x - other.x, self.y - other.y)

    def __mul__(self, other: Planar) -> Planar:
        """Return the complex product: a rotation times a vector is the vector turned."""
        return Planar(self.x * other.x - self.y * other.y, self.x * other.y + self.y * other.x)

    def conj(self) -> Planar:
        """Return the conjugate: the inverse of a rotation."""
        return Planar(self.x, -self.y)

    def perp(self) -> Planar:
        """Return the vector turned by a quarter turn counter-clockwise."""
        return Planar(-self.y, self.x)

    def scaled(self, factor: Jet) -> Planar:
        """Return the vector multiplied by a number."""
        return Planar(self.x * factor, self.y * factor)

    def over(self, divisor: Jet) -> Planar:
        """Return the vector divided by a number."""
        return Planar(self.x / divisor, self.y / divisor)

    def dot(self, other: Planar) -> Jet:
        """Return the scalar product."""
        return self.x * other.x + self.y * other.y

    def cross(self, other: Planar) -> Jet:
        """Return x_1 y_2 - y_1 x_2."""
        return self.x * other.y - self.y * other.x

    def length(self) -> Jet:
        """Return the length."""
        return self.dot(self).sqrt()

    def still(self) -> Planar:
        """Return the vector without its derivatives."""
        return Planar(*(c if type(c.d) is int and type(c.a) is int else Jet(c.v) for c in (self.x, self.y)))

    def part(self, part: str) -> Planar:
        """Return its values "v", rates "d" or accelerations "a", as a vector that has no derivatives."""
        return Planar(Jet(getattr(self.x, part)), Jet(getattr(self.y, part)))

    def with_part(self, part: str, values: Planar) -> Planar:
        """Return the vector with these rates "d" or accelerations "a"."""
        both = ((self.x, values.x), (self.y, values.y))
        return Planar(*(Jet(of.v, new.v) if part == "d" else Jet(of.v, of.d, new.v) for of, new in both))

    def times(self, factor: Number) -> Planar:
        """Return the vector multiplied by a constant."""
        return Planar(self.x.times(factor), self.y.times(factor))


@dataclass(frozen=True)
class Spin:
    """A rotation of the plane: its angle, and the unit vector at that angle, of which only the value is taken.

    Two components by themselves are one rotation's only to rounding of fast turns, which long slow arms would feel.
    """

    angle: Jet
    unit: Planar

    @cached_property
    def turn(self) -> Planar:
        """The unit vector, with the derivatives that those of the angle make."""
        d, a = self.angle.d, self.angle.a
        still = type(d) is int and type(a) is int
        return self.unit if still else Planar(*_circling(self.unit.x.v, self.unit.y.v, d, a))

    def __add__(self, other: Spin) -> Spin:
        return Spin(self.angle + other.angle, self.unit.still() * other.unit.still())

    def __sub__(self, other: Spin) -> Spin:
        return Spin(self.angle - other.angle, self.unit.still() * other.unit.still().conj())


def spin_between(arm: Planar, other: Planar) -> Spin:
    """Return the rotation e, by an angle in (-pi, pi], that turns a vector a into another b as long.

    From e a = b follow i theta' b = b' - e a' and i theta'' b = b'' - e (a'' + 2 i theta' a') + theta'^2 b: what is
    fast in both is subtracted before a short arm divides it.
    """
    swung = other.still() * arm.still().conj()
    turn, square = swung.over(swung.length()), other.dot(other).v
    towards = other.still()
    rate = towards.cross(other.part("d") - turn * arm.part("d")).v / square
    coriolis = arm.part("d").perp().times(rate + rate)
    bend = towards.cross(other.part("a") - turn * (arm.part("a") + coriolis)).v / square
    return Spin(Jet(atan2(swung.y.v, swung.x.v), rate, bend), turn)


def _circling(cos: Number, sin: Number, rate: Number, bend: Number) -> tuple[Jet, Jet]:
    """Return a cosine and a sine whose angle has these derivatives."""
    square = _mul(rate, rate)
    return (
        Jet(cos, _neg(_mul(sin, rate)), _neg(_add(_mul(sin, bend), _mul(cos, square)))),
        Jet(sin, _mul(cos, rate), _sub(_mul(cos, bend), _mul(sin, square))),
    )


def on_circle(cos: Jet, sin: Jet) -> tuple[Jet, Jet]:
    """Return a cosine and a sine whose derivatives are those of one angle.

    Each by itself they are only so to rounding of a fast turn's acceleration, which a slow direction would feel.
    """
    rate = _sub(_mul(cos.v, sin.d), _mul(sin.v, cos.d))
    bend = _sub(_mul(cos.v, sin.a), _mul(sin.v, cos.a))
    return _circling(cos.v, sin.v, rate, bend)


def count_turns(t: np.ndarray, value: np.ndarray, rate: np.ndarray, start: float | None) -> tuple[np.ndarray, Mask]:
    """Return the whole turns (T,) that make an angle continuous, and the intervals (T-1,) in which they are unsure.

    From one time to the next the mean of its two rates carries the angle. An interval is unsure if the angle found
    is more than an eighth of a turn off that, or if either rate would turn it by more than half a turn. Times without
    an angle are passed over: behind them the nearest turns are taken, as no motion leads there.

    Parameters
    ----------
    t, value, rate : (T,) array
        Times [s]; the angle [rad] but for whole turns, and its rate [rad/s]; NaN where there is none.
    start : float or None
        Near which the first angle is [rad]; None leaves it without turns.
    """
    turns, unsure = np.zeros(len(t)), np.zeros(max(len(t) - 1, 0), bool)
    (finite,) = np.nonzero(np.isfinite(value))
    if not len(finite):
        return turns, unsure
    v, r = value[finite], np.where(np.isfinite(rate[finite]), rate[finite], 0.0)
    off = (0.5 * (r[1:] + r[:-1]) * np.diff(t[finite]) - np.diff(v)) / math.tau
    first = 0.0 if start is None or not math.isfinite(start) else np.round((start - v[0]) / math.tau)
    turns[finite] = first + np.concatenate([[0.0], np.cumsum(np.round(off))])
    swept = np.maximum(np.abs(r[1:]), np.abs(r[:-1])) * np.diff(t[finite])
    unsure[finite[:-1]] = ((np.abs(off - np.round(off)) > 0.125) | (swept > math.pi)) & (np.diff(finite) == 1)
    return turns, unsure
