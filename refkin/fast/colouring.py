"""Sparse Jacobians by differences: columns that share no row are moved together, so that a few evaluations give all.

The number of colours is that of the densest row, or a little more, whatever the number of coordinates: 4 to 7 for
planar mechanisms. Steps and error bounds are those of `refkin.differences`, entry by entry; only the complex step is
exact at every size, as the others' error grows with the coordinates. (Curtis, Powell and Reid, J. Inst. Maths
Applics 13 (1974); the grouping is SciPy's.)
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import numpy as np

from refkin.differences import Scheme, step

SAMPLES = 3
"""How many random configurations are looked at for entries that are not zero."""


class Colouring:
    """A pattern of entries, and groups of columns of which no two have an entry in the same row.

    Attributes
    ----------
    pattern : (m, n) csc_array
        Its entries in order; the values do not matter.
    colour : (n,) array of int
    colours : int
        The number of groups.
    """

    def __init__(self, pattern: Any) -> None:
        from scipy.optimize._numdiff import group_columns  # here: importing SciPy's parts costs more than using them
        from scipy.sparse import csc_array

        self.pattern = csc_array(pattern)
        self.pattern.sort_indices()
        self.colour = np.asarray(group_columns(self.pattern))
        self.colours = int(self.colour.max(initial=-1)) + 1
        self._column = np.repeat(np.arange(self.pattern.shape[1]), np.diff(self.pattern.indptr))

    def jacobian(self, f: Callable[[Any], Any], x: Any, scheme: Scheme = Scheme.COMPLEX_STEP, h: Any = None) -> Any:
        """Return df/dx at x (n,) as a csc_array with the entries of the pattern.

        Parameters
        ----------
        f : callable
            From (n, B) to (m, B), such as ``lambda q: system.phi(q, t)``; for the complex step analytic.
        h : float or (n,) array, optional
            The steps; by default those of `refkin.differences.step`.
        """
        x = np.asarray(x, float)
        steps = np.broadcast_to(step(scheme, x) if h is None else np.asarray(h, float), x.shape)
        moves = np.zeros((len(x), self.colours))
        moves[np.arange(len(x)), self.colour] = steps
        middle = x[:, None]
        if scheme is Scheme.COMPLEX_STEP:
            quotients = np.imag(f(middle + 1j * moves))
        elif scheme is Scheme.CENTRAL:
            ahead, behind = np.split(f(np.concatenate([middle + moves, middle - moves], axis=1)), 2, axis=1)
            quotients = (ahead - behind) / 2
        else:
            both = f(np.concatenate([middle, middle + moves], axis=1))
            quotients = both[:, 1:] - both[:, :1]
        return self.filled(quotients[self.pattern.indices, self.colour[self._column]] / steps[self._column])

    def filled(self, values: Any) -> Any:
        """Return a csc_array with the pattern's entries set to values, in the order of the pattern."""
        from scipy.sparse import csc_array

        return csc_array((values, self.pattern.indices, self.pattern.indptr), shape=self.pattern.shape)


def pattern_of(f: Callable[[Any], Any], n: int) -> Any:
    """Return where df/dx of an analytic f is not zero at random configurations, as a csc_array; for small n.

    An entry that is zero at some special configuration is not at a random one; so the pattern serves all of them.
    """
    from scipy.sparse import csc_array

    draw = np.random.default_rng(0)
    entries: Any = 0.0
    for _ in range(SAMPLES):
        x = draw.uniform(-1.0, 1.0, n)
        moved = x[:, None] + 1e-100j * np.eye(n)
        entries = entries + np.abs(np.imag(f(moved)))
    return csc_array(entries != 0.0, dtype=float)
