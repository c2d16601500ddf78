"""The residual of every sample, by the formulas a person reads, in rows.

Only sines and cosines are others than the library's. On rows they would take half of the time of the check: with
t = tan(x / 2) and r = 2 / (1 + t^2) they are cos x = r - 1 and sin x = t r, off by at most about 3 units 2^-53, of
which rounding allows the residual 64. A tangent is computed 8 numbers at a time.
"""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import numpy as np

from refkin.system import System
from refkin.vec import ParameterValue


def residual(system: System, q: Any, t: Any) -> Any:
    """Return the largest component of phi in each sample, (B,); NaN where one is.

    Parameters
    ----------
    system : System
    q : (n, B) array
        Scaled coordinates.
    t : float or (B,) array
        Time [s].
    """
    if q.shape[1] == 1:  # number by number; NumPy's calls on rows of one take four times as long
        return np.array([np.max(np.abs(system.phi(q[:, 0], float(np.ravel(t)[0]))))])
    return residual_of_rows(system, q, t)


def residual_of_rows(system: System, q: Any, t: Any) -> Any:
    """Return what `residual` does, also where the numbers of a joint are rows: those of many mechanisms.

    Parameters
    ----------
    system : System
    q : (n, T) array
        Poses, in the system's coordinates.
    t : (T,) array
        Times [s].
    """
    kind, bodies = system.kind, range(0, system.of_bodies, system.kind.width)
    rows = [row.view(_Angle) if angle else row for row, angle in zip(q, system.angles.tolist(), strict=True)]
    values: dict[int | None, Any] = {None: kind.values(*(x or _NOTHING for x in kind.still))}
    values |= {k: kind.values(*rows[k : k + kind.width]) for k in bodies}
    values |= {k: ParameterValue(rows[k]) for k in range(system.of_bodies, system.n)}
    largest = np.zeros(q.shape[1])
    for row in system.rows(values, t, 0, lambda constraint: constraint.residual):
        np.maximum(largest, abs(row), out=largest)
    return largest


def without_zeros(system: System) -> System:
    """Return the system for `residual_of_rows`: a number that is 0, in all mechanisms, takes no time there."""
    numbers: Any = (tuple(x if np.any(x) else _NOTHING for x in p.g) for p in system.placed)
    return replace(system, placed=tuple(replace(p, g=g) for p, g in zip(system.placed, numbers, strict=True)))


class _Nothing:
    """The number 0 as an arithmetic of its own: NumPy would add it to every number of a row."""

    __array_ufunc__ = None  # a row leaves sums and products with it to it

    def __mul__(self, other: Any) -> Any:
        return self

    def __add__(self, other: Any) -> Any:
        return other

    def __sub__(self, other: Any) -> Any:
        return -other

    def __rsub__(self, other: Any) -> Any:
        return other

    def __neg__(self) -> Any:
        return self

    def __abs__(self) -> float:
        return 0.0

    def cos(self) -> float:
        return 1.0

    def sin(self) -> Any:
        return self

    __rmul__, __radd__ = __mul__, __add__


_NOTHING = _Nothing()


class _Angle(np.ndarray[Any, Any]):
    """A row of angles that brings its own cosine and sine, as balls do."""

    def cos(self) -> Any:
        """Return the cosines, and keep what the sines are made of."""
        self.tangent = np.tan(0.5 * self.view(np.ndarray))
        square = self.tangent * self.tangent
        square += 1.0
        self.ratio = np.divide(2.0, square, out=square)
        return self.ratio - 1.0

    def sin(self) -> Any:
        """Return the sines; `cos` was asked before."""
        return self.tangent * self.ratio
