"""Frames of joints of space: h along the axis, f the part of `zero` across it, g = h x f."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np


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
