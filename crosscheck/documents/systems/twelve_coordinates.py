"""Notes on Shabana, section 3.12: the slider-crank in twelve coordinates, q = (R1, theta1, ..., R4, theta4).

Body 1 is the fixed link, the frames of crank 2 and rod 3 sit in the middle of the links (R + A u with u_O = (-l/2, 0),
u_A and u_B = (l/2, 0)), block 4 has its frame at the pin B.
"""

from __future__ import annotations

from typing import Any

import numpy as np

from crosscheck.documents.systems import Number, SquareSystem

CRANK_DRIVEN, SLIDER_DRIVEN = 5, 9
"""The coordinate that the last row holds: theta2 or R4x."""


def twelve_coordinates(l2: Number, l3: Number, driven: Number, coordinate: int = CRANK_DRIVEN) -> SquareSystem:
    """Return C(q, t) of section 3.12; `driven` is theta2_0 + g(t), or f(t) where the slider is driven."""

    def phi(q: Any) -> Any:
        arms = _arms(l2, l3, q)
        at_o = q[3:5] - arms[0]
        at_a = q[3:5] + arms[0] - q[6:8] + arms[1]
        at_b = q[6:8] + arms[1] - q[9:11]
        return np.concatenate([q[:3], at_o, at_a, at_b, q[10:12], [q[coordinate] - driven]])

    def phi_q(q: Any) -> Any:
        crank, rod = (np.array([-arm[1], arm[0]]) for arm in _arms(l2, l3, q))
        out = np.zeros((12, 12), np.result_type(q, crank))
        out[(0, 1, 2), (0, 1, 2)] = 1
        for row, columns, sign, turning in (
            (3, 3, 1, ((5, -crank),)),
            (5, 3, 1, ((5, crank), (8, rod))),
            (7, 6, 1, ((8, rod),)),
        ):
            out[(row, row + 1), (columns, columns + 1)] = sign
            for column, slope in turning:
                out[row : row + 2, column] = slope
        out[(5, 6), (6, 7)] = -1
        out[(7, 8), (9, 10)] = -1
        out[9, 10] = out[10, 11] = 1
        out[11, coordinate] = 1
        return out

    return SquareSystem(phi, phi_q)


def right_side(l2: Number, l3: Number, q: Any, qd: Any, second: Number = 0) -> Any:
    """Return Q_d; `second` is the second derivative of what the last row is driven by."""
    crank, rod = (arm * (rate * rate) for arm, rate in zip(_arms(l2, l3, q), (qd[5], qd[8]), strict=True))
    return np.concatenate([[0, 0, 0], -crank, crank + rod, rod, [0, 0, second]])


def pose(l2: Number, l3: Number, theta2: Number, theta3: Number) -> Any:
    """Return q for the angles of crank and rod, the block wherever the rod ends."""
    crank = np.array([np.cos(theta2), np.sin(theta2)]) * l2
    rod = np.array([np.cos(theta3), np.sin(theta3)]) * l3
    return np.concatenate([[0, 0, 0], crank / 2, [theta2], crank + rod / 2, [theta3], crank + rod, [0]])


def _arms(l2: Number, l3: Number, q: Any) -> tuple[Any, Any]:
    """Return A2 u_A and A3 u_B: half of crank and rod."""
    return (
        np.array([np.cos(q[5]), np.sin(q[5])]) * l2 / 2,
        np.array([np.cos(q[8]), np.sin(q[8])]) * l3 / 2,
    )
