"""ME581, notes: Newton-Raphson for the four-bar, numerical partial derivatives."""

from __future__ import annotations

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
    free = _closure(m)

    def phi(q: Any) -> Any:
        return free(theta2, q[0], q[1])

    def phi_q(q: Any) -> Any:
        return np.array([[-m.r3 * np.sin(q[0]), m.r4 * np.sin(q[1])], [m.r3 * np.cos(q[0]), -m.r4 * np.cos(q[1])]])

    return SquareSystem(phi, phi_q)


def four_bar_by_rocker(m: FourBarLengths, theta4: Number) -> SquareSystem:
    """Return the closure in q = (theta2, theta3) with theta4 as the driver; det phi_q = r2 r3 sin(theta3 - theta2)."""
    free = _closure(m)

    def phi(q: Any) -> Any:
        return free(q[0], q[1], theta4)

    def phi_q(q: Any) -> Any:
        return np.array([[-m.r2 * np.sin(q[0]), -m.r3 * np.sin(q[1])], [m.r2 * np.cos(q[0]), m.r3 * np.cos(q[1])]])

    return SquareSystem(phi, phi_q)


def _closure(m: FourBarLengths) -> Any:
    def phi(theta2: Number, theta3: Number, theta4: Number) -> Any:
        return np.array(
            [
                m.r2 * np.cos(theta2) + m.r3 * np.cos(theta3) - m.r4 * np.cos(theta4) - m.r1,
                m.r2 * np.sin(theta2) + m.r3 * np.sin(theta3) - m.r4 * np.sin(theta4),
            ]
        )

    return phi
