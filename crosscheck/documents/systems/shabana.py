"""Notes on Shabana, Computational Dynamics, chapter 3: its loops, closed forms and right sides.

Links 2 and 3 are crank and connecting rod or coupler, 4 is rocker or block; theta are angles against the x axis.

Section 3.12 has the slider-crank in twelve coordinates, q = (R1, theta1, ..., R4, theta4). Body 1 is the fixed link,
the frames of crank 2 and rod 3 sit in the middle of the links (R + A u with u_O = (-l/2, 0), u_A and u_B = (l/2, 0)),
block 4 has its frame at the pin B.
"""

from __future__ import annotations

from typing import Any

import numpy as np

from crosscheck.documents.systems import Number, SquareSystem


def four_bar(l1: Number, l2: Number, l3: Number, l4: Number, driven: Number) -> SquareSystem:
    """Return the loop of section 3.11 in q = (theta2, theta3, theta4).

    l2 cos theta2 + l3 cos theta3 + l4 cos theta4 - l1 = 0, the same with sines and without l1, theta2 - driven = 0

    Parameters
    ----------
    l1, l2, l3, l4 : number
        Lengths; l1 is the ground's.
    driven : number
        omega t + theta_0 [rad].
    """

    def phi(q: Any) -> Any:
        c, s = np.cos(q), np.sin(q)
        return np.array([l2 * c[0] + l3 * c[1] + l4 * c[2] - l1, l2 * s[0] + l3 * s[1] + l4 * s[2], q[0] - driven])

    def phi_q(q: Any) -> Any:
        c, s = np.cos(q), np.sin(q)
        return np.array([[-l2 * s[0], -l3 * s[1], -l4 * s[2]], [l2 * c[0], l3 * c[1], l4 * c[2]], [1, 0, 0]])

    return SquareSystem(phi, phi_q)


def four_bar_right_side(l2: Number, l3: Number, l4: Number, q: Any, qd: Any) -> Any:
    """Return Q_d of the four-bar at constant speed of the crank: C_q qdd = Q_d.

    Parameters
    ----------
    l2, l3, l4 : number
        Lengths.
    q, qd : (3,) array
        Pose [rad] and velocity.
    """
    c, s = np.cos(q), np.sin(q)
    square = qd * qd
    return np.array(
        [
            square[0] * l2 * c[0] + square[1] * l3 * c[1] + square[2] * l4 * c[2],
            square[0] * l2 * s[0] + square[1] * l3 * s[1] + square[2] * l4 * s[2],
            0,
        ]
    )


def slider_crank(l2: Number, l3: Number, h: Number, theta2: Number) -> SquareSystem:
    """Return the offset slider-crank of section 3.6 in q = (theta3, x).

    l2 cos theta2 + l3 cos theta3 - x = 0, l2 sin theta2 + l3 sin theta3 - h = 0

    Parameters
    ----------
    l2, l3, h : number
        Lengths of crank and rod, and the offset.
    theta2 : number
        Angle of the crank [rad].
    """

    def phi(q: Any) -> Any:
        return np.array([l2 * np.cos(theta2) + l3 * np.cos(q[0]) - q[1], l2 * np.sin(theta2) + l3 * np.sin(q[0]) - h])

    def phi_q(q: Any) -> Any:
        return np.array([[-l3 * np.sin(q[0]), -1], [l3 * np.cos(q[0]), 0]])

    return SquareSystem(phi, phi_q)


def slider_crank_position(l2: Number, l3: Number, h: Number, theta2: Number, sign: int) -> tuple[Number, Number]:
    """Return sin theta3 and x = l2 cos theta2 + sign sqrt(l3^2 - (h - l2 sin theta2)^2).

    Parameters
    ----------
    l2, l3, h, theta2
        As for `slider_crank`.
    sign : int
        That of cos theta3.
    """
    rise = h - l2 * np.sin(theta2)
    return rise / l3, l2 * np.cos(theta2) + sign * np.sqrt(l3 * l3 - rise * rise)


def slider_crank_velocity(l2: Number, l3: Number, theta2: Number, theta3: Number, rate: Number) -> Any:
    """Return (theta3', x') of a slider-crank.

    Parameters
    ----------
    l2, l3 : number
        Lengths of crank and rod.
    theta2, theta3 : number
        Their angles [rad].
    rate : number
        theta2' [rad/s].
    """
    factor = rate * l2 / (l3 * np.cos(theta3))
    return np.array([-factor * np.cos(theta2), factor * l3 * np.sin(theta3 - theta2)])


def slider_crank_acceleration(
    l2: Number, l3: Number, theta2: Number, theta3: Number, rates: tuple[Number, Number], theta2dd: Number
) -> Any:
    """Return (theta3'', x'') of a slider-crank.

    Parameters
    ----------
    l2, l3, theta2, theta3
        As for `slider_crank_velocity`.
    rates : (theta2', theta3')
        [rad/s]
    theta2dd : number
        theta2'' [rad/s^2].
    """
    w2, w3 = rates
    c1 = -l2 * w2 * w2 * np.cos(theta2) - l2 * theta2dd * np.sin(theta2) - l3 * w3 * w3 * np.cos(theta3)
    c2 = -l2 * w2 * w2 * np.sin(theta2) + l2 * theta2dd * np.cos(theta2) - l3 * w3 * w3 * np.sin(theta3)
    below = l3 * np.cos(theta3)
    return np.array([-c2 / below, (c1 * l3 * np.cos(theta3) + c2 * l3 * np.sin(theta3)) / below])


def coriolis_example(l1: Number, l2: Number, theta2: Number) -> SquareSystem:
    """Return the block on rod 3 in q = (theta3, x): l2 e^(i theta2) - l1 - x e^(i theta3) = 0 (section 3.6).

    Parameters
    ----------
    l1, l2 : number
        Distance of the pivots, and length of the crank.
    theta2 : number
        Angle of the crank [rad].
    """

    def phi(q: Any) -> Any:
        return np.array([l2 * np.cos(theta2) - l1 - q[1] * np.cos(q[0]), l2 * np.sin(theta2) - q[1] * np.sin(q[0])])

    def phi_q(q: Any) -> Any:
        return np.array([[q[1] * np.sin(q[0]), -np.cos(q[0])], [-q[1] * np.cos(q[0]), -np.sin(q[0])]])

    return SquareSystem(phi, phi_q)


def coriolis_velocity(l2: Number, theta2: Number, q: Any, rate: Number) -> Any:
    """Return (theta3', x') = theta2' (l2 cos(theta3 - theta2) / x, l2 sin(theta3 - theta2)).

    Parameters
    ----------
    l2, theta2
        As for `coriolis_example`.
    q : (theta3, x)
    rate : number
        theta2' [rad/s].
    """
    return rate * np.array([l2 * np.cos(q[0] - theta2) / q[1], l2 * np.sin(q[0] - theta2)])


def coriolis_right_side(l2: Number, theta2: Number, q: Any, qd: Any, rate: Number, theta2dd: Number) -> tuple[Any, Any]:
    """Return matrix and right side of the linear system for (theta3'', x'').

    Parameters
    ----------
    l2, theta2, q, rate
        As for `coriolis_velocity`.
    qd : (theta3', x')
    theta2dd : number
        theta2'' [rad/s^2].
    """
    (theta3, x), (w3, v) = q, qd
    matrix = np.array([[-x * np.sin(theta3), np.cos(theta3)], [x * np.cos(theta3), np.sin(theta3)]])
    along, across = w3 * w3 * x, 2 * w3 * v
    right = np.array(
        [
            -theta2dd * l2 * np.sin(theta2) - rate * rate * l2 * np.cos(theta2)
            + along * np.cos(theta3) + across * np.sin(theta3),
            theta2dd * l2 * np.cos(theta2) - rate * rate * l2 * np.sin(theta2)
            + along * np.sin(theta3) - across * np.cos(theta3),
        ]
    )  # fmt: skip
    return matrix, right


def two_link_rates(l2: Number, l3: Number, theta2: Number, theta3: Number, w2: Number, w3: Number) -> tuple[Any, Any]:
    """Return (R2x, R2y, R3x, R3y)' and '' of the driven two-link arm at constant speeds (section 3.10).

    Parameters
    ----------
    l2, l3 : number
        Lengths.
    theta2, theta3, w2, w3 : number
        Their angles [rad], and the rates of these [rad/s].
    """
    half = l2 / 2, l3 / 2
    c2, s2, c3, s3 = np.cos(theta2), np.sin(theta2), np.cos(theta3), np.sin(theta3)
    velocity = [
        -w2 * half[0] * s2,
        w2 * half[0] * c2,
        -w2 * l2 * s2 - w3 * half[1] * s3,
        w2 * l2 * c2 + w3 * half[1] * c3,
    ]
    n2, n3 = w2 * w2, w3 * w3
    acceleration = [
        -n2 * half[0] * c2,
        -n2 * half[0] * s2,
        -n2 * l2 * c2 - n3 * half[1] * c3,
        -n2 * l2 * s2 - n3 * half[1] * s3,
    ]
    return np.array(velocity), np.array(acceleration)


CRANK_DRIVEN, SLIDER_DRIVEN = 5, 9
"""The coordinate that the last row holds: theta2 or R4x."""


def twelve_coordinates(l2: Number, l3: Number, driven: Number, coordinate: int = CRANK_DRIVEN) -> SquareSystem:
    """Return C(q, t) of section 3.12.

    Parameters
    ----------
    l2, l3 : number
        Lengths of crank and rod.
    driven : number
        theta2_0 + g(t), or f(t) where the slider is driven.
    coordinate : int
        Which one the last row holds: `CRANK_DRIVEN` or `SLIDER_DRIVEN`.
    """

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
    """Return Q_d of the twelve coordinates.

    Parameters
    ----------
    l2, l3 : number
        Lengths of crank and rod.
    q, qd : (12,) array
        Pose and velocity.
    second : number
        The second derivative of what the last row is driven by.
    """
    crank, rod = (arm * (rate * rate) for arm, rate in zip(_arms(l2, l3, q), (qd[5], qd[8]), strict=True))
    return np.concatenate([[0, 0, 0], -crank, crank + rod, rod, [0, 0, second]])


def pose(l2: Number, l3: Number, theta2: Number, theta3: Number) -> Any:
    """Return q for the angles of crank and rod, the block wherever the rod ends.

    Parameters
    ----------
    l2, l3 : number
        Lengths of crank and rod.
    theta2, theta3 : number
        Their angles [rad].
    """
    crank = np.array([np.cos(theta2), np.sin(theta2)]) * l2
    rod = np.array([np.cos(theta3), np.sin(theta3)]) * l3
    return np.concatenate([[0, 0, 0], crank / 2, [theta2], crank + rod / 2, [theta3], crank + rod, [0]])


def _arms(l2: Number, l3: Number, q: Any) -> tuple[Any, Any]:
    """Return A2 u_A and A3 u_B: half of crank and rod."""
    return (np.array([np.cos(q[5]), np.sin(q[5])]) * l2 / 2, np.array([np.cos(q[8]), np.sin(q[8])]) * l3 / 2)
