"""Numbers that carry a bound of their own rounding error: running error analysis by running the joints' formulas.

A `Running` number is a float (or a row of floats) and a bound of its absolute error. Each operation adds its own
rounding, at most U times its result, to what its operands bring (Higham, Accuracy and Stability of Numerical
Algorithms, section 3.3). The formulas of refkin run on it unchanged, so a bound is never stated beside a formula, it
is computed from it.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import numpy as np

U = 2.0**-53
"""Unit round-off of binary64."""


class Running:
    """A value and a bound of its absolute error, to first order in U."""

    __slots__ = ("error", "value")
    __array_ufunc__ = None  # an array on the left of + - * leaves the operation to this class

    def __init__(self, value: Any, error: Any = 0.0) -> None:
        self.value = value
        self.error = error

    def _result(self, value: Any, inherited: Any) -> Running:
        return Running(value, inherited + U * abs(value))

    def __add__(self, other: Any) -> Running:
        if isinstance(other, Running):
            return self._result(self.value + other.value, self.error + other.error)
        return self._result(self.value + other, self.error)

    def __sub__(self, other: Any) -> Running:
        if isinstance(other, Running):
            return self._result(self.value - other.value, self.error + other.error)
        return self._result(self.value - other, self.error)

    def __mul__(self, other: Any) -> Running:
        if isinstance(other, Running):
            inherited = abs(self.value) * other.error + abs(other.value) * self.error
            return self._result(self.value * other.value, inherited)
        return self._result(self.value * other, abs(other) * self.error)

    def __truediv__(self, other: float) -> Running:
        """Divide by a plain number."""
        return self * (1.0 / other)

    __radd__ = __add__
    __rmul__ = __mul__

    def __rsub__(self, other: Any) -> Running:
        return self._result(other - self.value, self.error)

    def __neg__(self) -> Running:
        return Running(-self.value, self.error)

    def cos(self) -> Running:
        """Return the cosine, its library error one ulp at most: of a number up to 1 that is U."""
        return Running(np.cos(self.value), self.error * abs(np.sin(self.value)) + U)

    def sin(self) -> Running:
        """Return the sine, its library error one ulp at most: of a number up to 1 that is U."""
        return Running(np.sin(self.value), self.error * abs(np.cos(self.value)) + U)

    def through(self, f: Callable[[Any, int], Any]) -> Running:
        """Return f(x, 0) of a function of floats whose derivative is f(x, 1), with one rounding of its own."""
        return self._result(f(self.value, 0), self.error * abs(f(self.value, 1)))


def running(q: Any, error: Any = 0.0) -> Any:
    """Return coordinates (n,) or (n, B) as an object array (n,) of `Running` numbers with the given error bounds."""
    q, error = np.asarray(q, float), np.broadcast_to(error, np.shape(q))
    out = np.empty(len(q), object)
    if q.ndim == 1:  # plain floats: NumPy's own take several times as long
        q, error = q.tolist(), error.tolist()
    for k, (value, bound) in enumerate(zip(q, error, strict=True)):
        out[k] = Running(value, bound)
    return out


def product_sum(row: Any, rates: Any) -> Running:
    """Return the sum of the products of two rows (n,), the first with plain zeros where nothing stands."""
    total = Running(0.0)
    for a, x in zip(row, rates, strict=True):
        total = total + (0.0 if isinstance(a, int | float) and a == 0 else x * a)
    return total


def errors(values: Any, shape: tuple[int, ...]) -> Any:
    """Return the error bounds of an object array of results, each spread to `shape` (of the batch)."""
    values = np.asarray(values, object)
    out = np.zeros((*values.shape, *shape))
    for place in np.ndindex(values.shape):
        entry = values[place]
        if isinstance(entry, Running):
            out[place] = entry.error
    return out
