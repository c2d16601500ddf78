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
        return self._result(self.value / other, self.error / abs(other))

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


def parts(numbers: Any, shape: tuple[int, ...] = ()) -> tuple[Any, Any]:
    """Return values and error bounds of an object array of results, plain ones too, each spread to a batch's shape."""
    numbers = np.asarray(numbers, object)
    value, error = np.zeros((2, *numbers.shape, *shape))
    for place in np.ndindex(numbers.shape):
        entry = numbers[place]
        if isinstance(entry, Running):
            value[place], error[place] = entry.value, entry.error
        else:
            value[place] = entry
    return value, error


def off_by(slope: tuple[Any, Any], rates: Any, right: tuple[Any, Any]) -> tuple[Any, Any]:
    """Return slope rates - right, (m,) or (m, B), and its error bounds: term by term, as numbers would be added up.

    Parameters
    ----------
    slope, right : tuple of arrays
        `parts` of phi_q, (m, n) or (m, n, B), and of nu or gamma.
    rates : (n,) or (n, B) array
        Without an error of their own.
    """
    value, error = np.zeros((2, *right[0].shape))
    for column, own, x in zip(*(np.moveaxis(part, 1, 0) for part in slope), rates, strict=True):
        term = column * x
        value = value + term
        error = error + (np.abs(x) * own + U * np.abs(term)) + U * np.abs(value)
    value = value - right[0]
    return value, error + right[1] + U * np.abs(value)
