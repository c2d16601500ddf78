"""What the files of a problem are written with.

Frames of joints of space, h along the axis, f the part of `zero` across it, g = h x f; and motion laws as formulas that
are read, and run, in Python.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np

from crosscheck.errors import CannotRun
from refkin.motion_laws import Integral, Polynomial, Sinusoid


def joint_frame(axis: Sequence[float], zero: Sequence[float] | None) -> tuple[Any, Any, Any]:
    """Return f, g and h, unit vectors; where there is no zero, any f across the axis."""
    h = np.array(axis, float) / np.linalg.norm(axis)
    across = np.eye(3)[int(np.argmin(np.abs(h)))] if zero is None else np.array(zero, float)
    f = across - h * (h @ across)
    f /= np.linalg.norm(f)
    return f, np.cross(h, f), h


def quaternion(columns: Sequence[Any]) -> tuple[float, ...]:
    """Return the unit quaternion, scalar first, of the rotation with these columns."""
    a = np.stack(columns, axis=1)
    # The largest of the four squares is at least 1/4: no digit is lost.
    squares = np.array([1 + np.trace(a), *(1 + 2 * a[k, k] - np.trace(a) for k in range(3))]) / 4
    k = int(np.argmax(squares))
    e = np.empty(4)
    e[k] = np.sqrt(squares[k])
    skew = np.array([a[2, 1] - a[1, 2], a[0, 2] - a[2, 0], a[1, 0] - a[0, 1]])
    if k == 0:
        e[1:] = skew / (4 * e[0])
    else:
        i = k - 1
        e[0] = skew[i] / (4 * e[k])
        for j in range(3):
            if j != i:
                e[j + 1] = (a[i, j] + a[j, i]) / (4 * e[k])
    return tuple(float(x) for x in e / np.linalg.norm(e))


def formula(law: Any) -> str:
    """Return f(t) as an expression in `t`, with `sin` and `cos`.

    Raises
    ------
    CannotRun
        For a table, which has no formula.
    """
    if isinstance(law, Polynomial):
        return _polynomial(law.coefficients)
    if isinstance(law, Sinusoid):
        return f"{law.offset!r} + {law.amplitude!r} * sin({law.angular_frequency!r} * t + {law.phase!r})"
    if isinstance(law, Integral) and isinstance(law.rate, Polynomial):
        return _polynomial([law.initial, *(c / (k + 1) for k, c in enumerate(law.rate.coefficients))])
    raise CannotRun(f"no formula for {law!r}")


def _polynomial(coefficients: Any) -> str:
    first, *rest = coefficients
    return f"{first!r} + t * ({_polynomial(rest)})" if rest else repr(first)
