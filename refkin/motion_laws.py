"""Laws of motion f(t) with exact derivatives and integrals: polynomial, sinusoid, table (cubic spline).

A law is evaluated by order: `law(t, 0)` is f, `law(t, 1)` is f', up to order 3. `t` is a number of any arithmetic for
polynomial and sinusoid; for a table it is a float, a NumPy row, a complex number or a row of them (to first order in
the imaginary part, which is all that a complex step asks for), or a number that brings a method `through`.
A law given as a rate f' becomes `Integral(rate=..., initial=f(0))`, integrated exactly.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass
from functools import cached_property
from itertools import pairwise
from typing import Annotated, Any, Literal, Protocol

import numpy as np

from refkin.errors import Fault
from refkin.vec import cosine_and_sine

STRICT: dict[str, Any] = {"extra": "forbid", "strict": True}
"""How dataclasses are read from a scene file: no unknown key, no text where a number belongs."""


class Law(Protocol):
    """A function f of one number: its derivatives by order, integral from 0, domain, and what is wrong with it."""

    def __call__(self, t: Any, order: int = 0) -> Any: ...
    def integral(self, t: Any) -> Any: ...
    def domain(self) -> tuple[float, float]: ...
    def faults(self, path: str) -> Iterator[Fault]: ...


class _Everywhere:
    """A law that is defined at all times, whatever its numbers."""

    __pydantic_config__ = STRICT

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
        return _horner(self._derived(order), t)

    def _derived(self, order: int) -> tuple[float, ...]:
        """Return the coefficients of a derivative."""
        while len(known := self._orders) <= order:
            known.append(tuple([k * c for k, c in enumerate(known[-1])][1:]))
        return known[order]

    @cached_property
    def _orders(self) -> list[tuple[float, ...]]:
        return [self.coefficients]

    def integral(self, t: Any) -> Any:
        """Return sum_k coefficients[k] t^(k+1) / (k+1)."""
        return _horner([0.0, *(c / (k + 1) for k, c in enumerate(self.coefficients))], t)

    def faults(self, path: str) -> Iterator[Fault]:
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
        wave = cosine_and_sine((w := self.angular_frequency) * t + self.phase)[(order + 1) % 2]
        value = (-1.0) ** (order // 2) * self.amplitude * math.prod([w] * order) * wave  # `**` raises
        return value if order else self.offset + value

    def integral(self, t: Any) -> Any:
        """Return offset t + amplitude (cos(phase) - cos(w t + phase))/w, written so that a small w cancels nothing."""
        w, rows = self.angular_frequency, isinstance(self.angular_frequency, np.ndarray)
        half = 0.5 * (np.where(w, w, 2.0**-499) if rows else w)  # a power of two: no digit of t is lost
        lobe = cosine_and_sine(half * t)[1] * (1.0 / half) if rows or half else t
        return self.offset * t + self.amplitude * cosine_and_sine(half * t + self.phase)[1] * lobe

    def faults(self, path: str) -> Iterator[Fault]:
        """Yield a frequency so small that its reciprocal, a factor of the integral, is no number."""
        if self.angular_frequency and math.isinf(2.0 / self.angular_frequency):
            yield Fault(f"{path}.angular_frequency", self.angular_frequency, "0, or a frequency of at least 2e-308")


@dataclass(frozen=True, kw_only=True)
class Table:
    """Cubic spline through (argument, value): not-a-knot ends, and NaN beyond them; or, if periodic, C2 all around."""

    argument: tuple[float, ...]
    value: tuple[float, ...]
    periodic: bool = False
    kind: Literal["table"] = "table"
    __pydantic_config__ = STRICT

    @cached_property
    def _spline(self) -> Any:
        from scipy.interpolate import CubicSpline  # here, because importing it costs more than the rest of refkin

        ends: Any = {"bc_type": "periodic"} if self.periodic else {"extrapolate": False}
        return CubicSpline(*np.array([self.argument, self.value], float), **ends)

    def __call__(self, t: Any, order: int = 0) -> Any:
        return _through(lambda x, k: self._spline(x, order + k)[()], t)

    def integral(self, t: Any) -> Any:
        return _through(lambda x, k: self._spline(x)[()] if k else self._integral(x), t)

    @cached_property
    def _areas(self) -> Any:
        """The integrals from 0 to the knots; the rest of an integral is that of one piece, so that no digit is lost."""
        return np.array([self._spline.integrate(0.0, knot) for knot in self.argument])

    def _integral(self, t: Any) -> Any:
        x, known, turns = self._spline.x, 0.0 * self._spline(t), 0.0  # NaN beyond the ends
        if self.periodic:
            turns = np.floor((t - x[0]) / (x[-1] - x[0]))
            t = np.minimum(np.maximum(t - turns * (x[-1] - x[0]), x[0]), x[-1])  # `np.clip` takes three times as long
        k = x[1:-1].searchsorted(t, side="right")
        (a, b, c, d), s = self._spline.c[:, k], t - x[k]
        piece = s * (d + s * (c / 2 + s * (b / 3 + s * a / 4)))
        return (piece + self._areas[k] + turns * (self._areas[-1] - self._areas[0]) + known)[()]

    def domain(self) -> tuple[float, float]:
        return (-np.inf, np.inf) if self.periodic else (self.argument[0], self.argument[-1])

    def faults(self, path: str) -> Iterator[Fault]:
        """Yield what keeps arguments and values from being those of a spline, and ends that do not meet if periodic."""
        x, y = self.argument, self.value
        if len(x) < 2:
            yield Fault(f"{path}.argument", list(x), "at least two arguments")
        if len(x) != len(y):
            yield Fault(f"{path}.value", list(y), f"{len(x)} values, one for each argument")
        if any(b <= a for a, b in pairwise(x)):
            yield Fault(f"{path}.argument", list(x), "strictly increasing arguments")
        well = 2 <= len(x) == len(y) and all(a < b < np.inf for a, b in pairwise(x)) and all(abs(v) < np.inf for v in y)
        if self.periodic and y and y[0] != y[-1]:
            yield Fault(f"{path}.value", list(y), "a last value equal to the first, as the table is periodic")
        elif well and not self._interpolates():
            yield Fault(f"{path}.argument", list(x), "arguments between which a spline is finite")

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
        raise NotImplementedError("a law is integrated once")

    def domain(self) -> tuple[float, float]:
        return self.rate.domain()

    def faults(self, path: str) -> Iterator[Fault]:
        twice = [Fault(path, self.rate, "a law that is no integral itself")] * isinstance(self.rate, Integral)
        yield from (of_rate := twice or list(self.rate.faults(path)))
        if not of_rate and not self.domain()[0] <= 0.0 <= self.domain()[1]:
            yield Fault(f"{path}.argument", list(self.domain()), "a table that covers t = 0, where `initial` holds")


class ByKind:
    """Tells pydantic, which reads scene files, that the key `kind` says which law stands there."""

    def __get_pydantic_core_schema__(self, source: Any, handler: Any) -> Any:
        from pydantic import Field

        return handler.generate_schema(Annotated[source, Field(discriminator="kind")])


AnyLaw = Annotated[Polynomial | Sinusoid | Table, ByKind()]
"""The laws a scene file may name, by their `kind`."""


def _through(f: Callable[[Any, int], Any], t: Any) -> Any:
    """Return f(t, 0) of a function of real numbers whose derivative is f(t, 1)."""
    if hasattr(t, "through"):
        return t.through(f)
    if np.iscomplexobj(t):
        return f(np.real(t), 0) + 1j * np.imag(t) * f(np.real(t), 1)
    return f(t, 0)


def _horner(coefficients: Sequence[float], t: Any) -> Any:
    value = t * 0.0
    for c in reversed(coefficients):
        value = value * t + c
    return value
