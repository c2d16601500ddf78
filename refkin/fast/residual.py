"""The residual by the formulas that a person reads, on rows: what every pose of the fast paths is checked by.

Nothing here is compiled or traced; only sines and cosines are others than the library's. On rows they would take half
of the time of the check: with t = tan(x / 2) and r = 2 / (1 + t^2) they are cos x = r - 1 and sin x = t r, off by at
most about 3 units 2^-53, of which rounding allows the residual 64. A tangent is computed 8 numbers at a time.
"""

from __future__ import annotations

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
    """Return what `residual` does, also where the numbers of a joint are rows: those of many mechanisms."""
    kind, bodies = system.kind, range(0, system.of_bodies, system.kind.width)
    turns = (*kind.turns * len(bodies), *(1.0,) * (system.n - system.of_bodies))  # 1 for an angle, as `System.angles`
    rows = [row.view(_Angle) if turn == 1.0 else row for row, turn in zip(q, turns, strict=True)]
    values: dict[int | None, Any] = {None: kind.values(*kind.still)}
    values |= {k: kind.values(*rows[k : k + kind.width]) for k in bodies}
    values |= {k: ParameterValue(rows[k]) for k in range(system.of_bodies, system.n)}
    largest = np.zeros(q.shape[1])
    for row in system.rows(values, t, 0, lambda constraint: constraint.residual):
        np.maximum(largest, np.abs(row), out=largest)
    return largest


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
