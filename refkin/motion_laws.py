"""Laws of motion f(t) with exact derivatives and integrals: polynomial, sinusoid, table (cubic spline).

A law is evaluated by order: `law(t, 0)` is f, `law(t, 1)` is f', up to order 3. `t` is a number of any arithmetic for
polynomial and sinusoid; for a table it is a float, a NumPy row, a complex number or a row of them (to first order in
the imaginary part, which is all that a complex step asks for), or a number that brings a method `through`.
A law given as a rate f' becomes `Integral(rate=..., initial=f(0))`, integrated exactly. `law.extrema(a, b)` and
`zeros(law, a, b)` are complete: between two neighbours in the extrema a law is monotone, so that its signs there say
whether it has a zero in between. Nothing is sampled.
"""

from __future__ import annotations

import math
from bisect import bisect_right
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass
from fractions import Fraction
from functools import cached_property
from itertools import pairwise
from typing import Annotated, Any, ClassVar, Literal, Protocol

import numpy as np
from pydantic import Field

from refkin.errors import Fault
from refkin.vec import cosine_and_sine

STRICT: dict[str, Any] = {"extra": "forbid", "strict": True}
"""How dataclasses are read from a scene file: no unknown key, no text where a number belongs."""


class Law(Protocol):
    """A scalar function of one argument, with derivatives by order and an exact integral."""

    def __call__(self, t: Any, order: int = 0) -> Any:
        """Return the derivative of the given order at t, in the shape of t."""

    def integral(self, t: Any) -> Any:
        """Return the integral of f from 0 to t."""

    def faults(self, path: str) -> Iterator[Fault]:
        """Yield what is wrong with the law's numbers."""

    def domain(self) -> tuple[float, float]:
        """Return the interval of arguments in which the law is defined."""

    def extrema(self, a: float, b: float) -> list[float]:
        """Return where f' changes its sign between a and b, in order; `MOST_EXTREMA` of them at most."""


MOST_EXTREMA = 100_000
"""Extrema of a law that are listed; nobody steps through more."""


class _Everywhere:
    """A law without gaps: every finite set of its numbers is one."""

    __pydantic_config__: ClassVar[dict[str, Any]] = STRICT

    def domain(self) -> tuple[float, float]:
        return (-np.inf, np.inf)

    def faults(self, path: str) -> Iterator[Fault]:
        return iter(())


@dataclass(frozen=True, kw_only=True)
class Polynomial(_Everywhere):
    """f(t) = sum_k coefficients[k] t^k."""

    coefficients: tuple[float, ...]
    kind: Literal["polynomial"] = "polynomial"

    def __call__(self, t: Any, order: int = 0) -> Any:
        coefficients = list(self.coefficients)
        for _ in range(order):
            coefficients = [k * c for k, c in enumerate(coefficients)][1:]
        return _horner(coefficients, t)

    def integral(self, t: Any) -> Any:
        """Return sum_k coefficients[k] t^(k+1) / (k+1)."""
        return _horner([0.0, *(c / (k + 1) for k, c in enumerate(self.coefficients))], t)

    def extrema(self, a: float, b: float) -> list[float]:
        """Return the zeros of f', which is a polynomial of lower degree, between a and b."""
        return zeros(self.derivative(), a, b) if len(self.coefficients) > 2 else []

    def derivative(self) -> Polynomial:
        """Return f'. Its coefficients are rounded; so are the extrema, by as much as an ulp of those moves them."""
        return Polynomial(coefficients=tuple(k * c for k, c in enumerate(self.coefficients) if k))

    def sign(self, t: float) -> float:
        """Return the sign of f(t), exact: where rounding could decide on it, it is computed with rational numbers."""
        value, size = 0.0, 0.0
        for c in reversed(self.coefficients):
            value, size = value * t + c, size * abs(t) + abs(c)
        if abs(value) > len(self.coefficients) * 2.0**-51 * size and size < math.inf:
            return math.copysign(1.0, value)
        exact: Any = Fraction(0)
        for c in reversed(self.coefficients):
            exact = exact * Fraction(t) + Fraction(c)
        return float((exact > 0) - (exact < 0))

    def faults(self, path: str) -> Iterator[Fault]:
        """Yield whether there is no coefficient at all."""
        if not self.coefficients:
            yield Fault(f"{path}.coefficients", [], "at least one coefficient")


@dataclass(frozen=True, kw_only=True)
class Sinusoid(_Everywhere):
    """f(t) = offset + amplitude sin(angular_frequency t + phase)."""

    amplitude: float
    angular_frequency: float
    offset: float = 0.0
    phase: float = 0.0
    kind: Literal["sinusoid"] = "sinusoid"

    def __call__(self, t: Any, order: int = 0) -> Any:
        w = self.angular_frequency
        wave = cosine_and_sine(w * t + self.phase)[(order + 1) % 2]
        value = (-1.0) ** (order // 2) * self.amplitude * w**order * wave
        return value if order else self.offset + value

    def integral(self, t: Any) -> Any:
        """Return offset t + amplitude (cos(phase) - cos(w t + phase))/w, written so that a small w cancels nothing."""
        half = 0.5 * self.angular_frequency
        lobe = cosine_and_sine(half * t)[1] * (1.0 / half) if half else t
        return self.offset * t + self.amplitude * cosine_and_sine(half * t + self.phase)[1] * lobe

    def extrema(self, a: float, b: float) -> list[float]:
        """Return the times between a and b at which the argument of the sine is pi/2 + k pi."""
        w = self.angular_frequency
        if not w * self.amplitude:
            return []
        first, last = sorted((w * end + self.phase) / math.pi - 0.5 for end in (a, b))
        if not math.isfinite(last - first) or math.floor(last) < math.ceil(first):
            return []
        numbers = math.floor(first) + np.arange(min(math.ceil(last) - math.floor(first) + 1, MOST_EXTREMA))
        return _inside(np.sort((math.pi * (numbers + 0.5) - self.phase) / w), a, b)


@dataclass(frozen=True, kw_only=True)
class Table:
    """Cubic spline through (argument, value): not-a-knot ends, or, if periodic, smooth (C2) all around.

    Outside its arguments a table that is not periodic has no value: NaN.
    """

    argument: tuple[float, ...]
    value: tuple[float, ...]
    periodic: bool = False
    kind: Literal["table"] = "table"
    __pydantic_config__: ClassVar[dict[str, Any]] = STRICT

    @cached_property
    def _spline(self) -> Any:
        from scipy.interpolate import CubicSpline  # here, because importing it costs more than the rest of refkin

        if self.periodic:
            return CubicSpline(self.argument, self.value, bc_type="periodic")
        return CubicSpline(self.argument, self.value, extrapolate=False)

    def __call__(self, t: Any, order: int = 0) -> Any:
        return _through(lambda x, k: self._spline(x, order + k)[()], t)

    def integral(self, t: Any) -> Any:
        """Return the integral of the spline from 0 to t, exact piece by piece."""
        return _through(lambda x, k: self._spline(x)[()] if k else self._integral(x), t)

    def _integral(self, t: Any) -> Any:
        return np.vectorize(lambda end: float(self._spline.integrate(0.0, end)), otypes=[float])(t)[()]

    def extrema(self, a: float, b: float) -> list[float]:
        """Return the zeros of f' between a and b: on each piece it is monotone up to where f'' vanishes, and beyond."""
        places, length = self._monotone, self.argument[-1] - self.argument[0]
        if self.periodic:
            before, after = (math.floor((end - self.argument[0]) / length) for end in (a, b))
            turns = before + np.arange(min(after - before + 1, 1 + MOST_EXTREMA // len(places)))
            places = np.unique(places + length * turns[:, None])
        return sign_changes(lambda t: self.at(t, 1), [a, *_inside(places, a, b), b])

    def at(self, t: float, order: int = 0) -> float:
        """Return f(t) or f'(t) for one t: what a call does, as a call of SciPy's costs ten times as much."""
        first, last = self.argument[0], self.argument[-1]
        x = first + (t - first) % (last - first) if self.periodic else t
        k = min(max(bisect_right(self.argument, x) - 1, 0), len(self.argument) - 2)
        s, (c3, c2, c1, c0) = x - self.argument[k], self._pieces[k]
        return (3.0 * c3 * s + 2.0 * c2) * s + c1 if order else ((c3 * s + c2) * s + c1) * s + c0

    @cached_property
    def _pieces(self) -> list[list[float]]:
        pieces: list[list[float]] = self._spline.c.T.tolist()
        return pieces

    @cached_property
    def _monotone(self) -> Any:
        """The arguments between which f' is monotone: those of the table, and where f'' vanishes in a piece."""
        argument = np.array(self.argument)
        with np.errstate(all="ignore"):
            vanishing = argument[:-1] - self._spline.c[1] / (3.0 * self._spline.c[0])
        inner = (argument[:-1] < vanishing) & (vanishing < argument[1:])
        return np.sort(np.concatenate([argument, vanishing[inner]]))

    def domain(self) -> tuple[float, float]:
        """Return the arguments covered: the table's own, or all if periodic."""
        return (-np.inf, np.inf) if self.periodic else (self.argument[0], self.argument[-1])

    def faults(self, path: str) -> Iterator[Fault]:
        """Yield what keeps the table from being interpolated."""
        if len(self.argument) < 2:
            yield Fault(f"{path}.argument", list(self.argument), "at least two arguments")
        if len(self.argument) != len(self.value):
            yield Fault(f"{path}.value", list(self.value), f"{len(self.argument)} values, one for each argument")
        if any(b <= a for a, b in zip(self.argument, self.argument[1:], strict=False)):
            yield Fault(f"{path}.argument", list(self.argument), "strictly increasing arguments")
        if self.periodic and self.value and self.value[0] != self.value[-1]:
            yield Fault(f"{path}.value", list(self.value), "a last value equal to the first, as the table is periodic")
        elif self._in_order() and not self._interpolates():
            yield Fault(f"{path}.argument", list(self.argument), "arguments between which a spline is finite")

    def _in_order(self) -> bool:
        several = 2 <= len(self.argument) == len(self.value)
        return (
            several and all(a < b < np.inf for a, b in pairwise(self.argument)) and bool(np.isfinite(self.value).all())
        )

    def _interpolates(self) -> bool:
        """Whether the spline has coefficients: arguments may be too close for float64, or too far apart."""
        with np.errstate(all="ignore"):
            try:
                return bool(np.isfinite(self._spline.c).all())
            except (np.linalg.LinAlgError, ValueError):  # a singular system; coefficients that overflow
                return False


@dataclass(frozen=True, kw_only=True)
class Integral:
    """f(t) = initial + integral of `rate` from 0 to t: the law of a driver that is given as a rate."""

    rate: Law
    initial: float = 0.0

    def __call__(self, t: Any, order: int = 0) -> Any:
        return self.rate(t, order - 1) if order else self.initial + self.rate.integral(t)

    def integral(self, t: Any) -> Any:
        """Refuse: no scene integrates a law twice."""
        raise NotImplementedError("a law is integrated once")

    def extrema(self, a: float, b: float) -> list[float]:
        """Return the zeros of the rate between a and b."""
        return zeros(self.rate, a, b)

    def domain(self) -> tuple[float, float]:
        """Return the arguments covered by the rate."""
        return self.rate.domain()

    def faults(self, path: str) -> Iterator[Fault]:
        """Yield the rate's faults, and whether it leaves out 0, where `initial` holds."""
        found = list(self.rate.faults(path))
        yield from found
        if not found and not self.domain()[0] <= 0.0 <= self.domain()[1]:
            yield Fault(f"{path}.argument", list(self.domain()), "a table that covers t = 0, where `initial` holds")


AnyLaw = Annotated[Polynomial | Sinusoid | Table, Field(discriminator="kind")]
"""The laws a scene file may name, by their `kind`."""


def zeros(law: Law, a: float, b: float) -> list[float]:
    """Return where a law changes its sign, or is 0 at an extremum, between a and b, in order."""
    places = [a, *law.extrema(a, b), b]
    one: Callable[[float], float] = law.sign if isinstance(law, Polynomial) else law
    return sign_changes(law.at if isinstance(law, Table) else one, places)


def sign_changes(f: Callable[[float], Any], places: Sequence[float]) -> list[float]:
    """Return the zeros of a function between the first and the last of places between which it is monotone.

    Each interval at whose ends the signs differ is halved until no float64 number is left in it.
    """
    signs = [float(np.sign(f(t))) for t in places]
    found = [t for t, sign in zip(places[1:-1], signs[1:-1], strict=True) if sign == 0.0]
    for lo, hi, sign, other in zip(places, places[1:], signs, signs[1:], strict=False):
        if sign * other < 0.0:
            found.append(_halved(f, lo, hi, sign))
    return sorted(found)


def _halved(f: Callable[[float], Any], lo: float, hi: float, sign: float) -> float:
    while lo < (middle := 0.5 * (lo + hi)) < hi and hi - lo > 2.0**-60 * max(abs(lo), abs(hi)):
        value = f(middle) * sign
        if value == 0.0:
            return middle
        lo, hi = (middle, hi) if value > 0.0 else (lo, middle)
    return float(lo)


def _inside(times: Any, a: float, b: float) -> list[float]:
    """Return of times in order those between a and b."""
    found: list[float] = times[(a < times) & (times < b)][:MOST_EXTREMA].tolist()
    return found


def _through(f: Callable[[Any, int], Any], t: Any) -> Any:
    """Return f(t, 0) of a function of real numbers whose derivative is f(t, 1)."""
    if hasattr(t, "through"):
        return t.through(f)
    if np.iscomplexobj(t):
        return f(np.real(t), 0) + 1j * np.imag(t) * f(np.real(t), 1)
    return f(t, 0)


def _horner(coefficients: list[float], t: Any) -> Any:
    value = t * 0.0
    for c in reversed(coefficients):
        value = value * t + c
    return value
