"""ME581, notes: Newton-Raphson for the four-bar, numerical partial derivatives."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any, NamedTuple

import numpy as np

from crosscheck.documents.systems import Number, SquareSystem, scalar


def quadratic() -> SquareSystem:
    """Return x^2 - 4x + 1 = 0, whose roots are 2 - sqrt(3) and 2 + sqrt(3)."""
    return scalar(lambda x: x * x - 4 * x + 1, lambda x: 2 * x - 4)


class FourBarLengths(NamedTuple):
    """r1 ... r4 in one unit: ground, which lies along x, crank, coupler, rocker."""

    r1: Number
    r2: Number
    r3: Number
    r4: Number


def four_bar(m: FourBarLengths, theta2: Number) -> SquareSystem:
    """Return the closure of the four-bar in q = (theta3, theta4) for a crank angle theta2.

    r2 cos theta2 + r3 cos theta3 - r4 cos theta4 - r1 = 0, and with sines the same without r1
    """
    return _closure(m, slice(1, 3), lambda q: (theta2, *q))


def four_bar_by_rocker(m: FourBarLengths, theta4: Number) -> SquareSystem:
    """Return the closure in q = (theta2, theta3) with theta4 as the driver; det phi_q = r2 r3 sin(theta3 - theta2)."""
    return _closure(m, slice(2), lambda q: (*q, theta4))


def _closure(m: FourBarLengths, unknown: slice, angles: Callable[[Any], Any]) -> SquareSystem:
    """Return the closure in those of theta2, theta3, theta4 that are unknown; `angles` are all three at q."""

    def phi(q: Any) -> Any:
        (c2, c3, c4), (s2, s3, s4) = (tuple(map(f, angles(q))) for f in (np.cos, np.sin))
        return np.array([m.r2 * c2 + m.r3 * c3 - m.r4 * c4 - m.r1, m.r2 * s2 + m.r3 * s3 - m.r4 * s4])

    def phi_q(q: Any) -> Any:
        c, s = np.cos(q), np.sin(q)
        r = np.array((m.r2, m.r3, -m.r4)[unknown])
        return np.array([-r * s, r * c])

    return SquareSystem(phi, phi_q)
