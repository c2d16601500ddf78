"""Jacobians by differences: forward, central, complex step.

=============== ============================ ============================================== ================
scheme          formula                      step h                                         error, about
=============== ============================ ============================================== ================
forward         (f(x+h) - f(x)) / h          sqrt(u) max(1, abs(x))                         h f''/2 + 2 e/h
central         (f(x+h) - f(x-h)) / 2h       cbrt(u) max(1, abs(x))                         h^2 f'''/6 + e/h
complex step    Im f(x + ih) / h             1e-100: no difference, so no cancellation      u f'
=============== ============================ ============================================== ================

with u = 2^-52 and e the error of one evaluation (Numerical Recipes, section 5.7; Squire and Trapp, SIAM Review 40,
1998).
"""

from __future__ import annotations

from collections.abc import Callable
from enum import StrEnum
from typing import Any

import numpy as np

from refkin.errors import InvalidRequest

EPS = float(np.finfo(float).eps)


class Scheme(StrEnum):
    """How a derivative is approximated."""

    FORWARD = "forward"
    """One value at x + h."""
    CENTRAL = "central"
    """Two, at x + h and x - h."""
    COMPLEX_STEP = "complex_step"
    """One, at x + ih."""


def step(scheme: Scheme, x: Any) -> Any:
    """Return the step h of each coordinate, in the shape of x; a real one is such that (x + h) - x is exactly h."""
    x = np.asarray(x, float)
    if scheme == Scheme.COMPLEX_STEP:
        return np.full(x.shape, 1e-100)
    rough = EPS ** (1 / 2 if scheme == Scheme.FORWARD else 1 / 3) * np.maximum(1.0, np.abs(x))
    return (x + rough) - x


def jacobian(f: Callable[[Any], Any], x: Any, scheme: Scheme = Scheme.COMPLEX_STEP, h: Any = None) -> Any:
    """Return df/dx, (m, n).

    Parameters
    ----------
    f : callable
        From (n,) to (m,). For the complex step it must be analytic: no abs, no comparison.
    x, h : (n,) array
        Where, and by which steps; by default those of `step`.
    scheme : Scheme
        Which difference.
    """
    if scheme not in [*Scheme]:
        raise InvalidRequest("scheme", " or ".join(Scheme), repr(scheme))
    x = np.asarray(x, float)
    steps = np.broadcast_to(step(scheme, x) if h is None else h, x.shape)
    middle = f(x) if scheme == Scheme.FORWARD else None
    columns = []
    for k, size in enumerate(steps):
        # Each coordinate is moved on a fresh copy: what one column moved must not stay moved for the next.
        moved = np.where(np.arange(x.size) == k, 1j * size if scheme == Scheme.COMPLEX_STEP else size, 0.0)
        if scheme == Scheme.COMPLEX_STEP:
            columns.append(np.imag(f(x + moved)) / size)
        elif scheme == Scheme.CENTRAL:
            columns.append((f(x + moved) - f(x - moved)) / (2 * size))
        else:
            columns.append((f(x + moved) - middle) / size)
    return np.stack(columns, axis=-1)
