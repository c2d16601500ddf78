"""METU, Mechanisms, section 3.9: loop closure equations as scalar equations.

`crosscheck.documents.loops` has the same mechanisms as vectors, in complex form; they share nothing but lengths.
"""

from __future__ import annotations

from typing import Any, NamedTuple

import numpy as np

from crosscheck.documents.systems import Number, SquareSystem


class Slotted(NamedTuple):
    """Lengths of the mechanism of the coupled example, and its input theta12 [rad]; the source gives no numbers."""

    a1: Number
    a2: Number
    a4: Number
    a5: Number
    b1: Number
    c1: Number
    theta12: Number


def slotted_that_closes(
    a2: Number, a4: Number, a5: Number, theta12: Number, theta14: Number, theta15: Number, s4: Number
) -> tuple[Slotted, Any]:
    """Return the lengths with which the loops close at these values of the unknowns, and q with the s6 that follows.

    Parameters
    ----------
    a2, a4, a5 : number
        Lengths that are given.
    theta12, theta14, theta15, s4 : number
        The input, and the unknowns [rad, the unit of the lengths].
    """
    b1 = a2 * np.cos(theta12) - a5 * np.cos(theta15) - s4 * np.cos(theta14)
    c1 = -a2 * np.sin(theta12) + a5 * np.sin(theta15) + s4 * np.sin(theta14)
    m = Slotted(a5 * np.sin(theta15) + a4 * np.sin(theta14), a2, a4, a5, b1, c1, theta12)
    return m, np.array([theta14, theta15, s4, b1 + a5 * np.cos(theta15) + a4 * np.cos(theta14)])


def slotted(m: Slotted) -> SquareSystem:
    """Return the four coupled equations in q = (theta14, theta15, s4, s6).

    b1 - a2 cos theta12 + a5 cos theta15 + s4 cos theta14 = 0
    -c1 - a2 sin theta12 + a5 sin theta15 + s4 sin theta14 = 0
    b1 - s6 + a5 cos theta15 + a4 cos theta14 = 0
    -a1 + a5 sin theta15 + a4 sin theta14 = 0
    """

    def phi(q: Any) -> Any:
        theta14, theta15, s4, s6 = q
        c14, s14, c15, s15 = np.cos(theta14), np.sin(theta14), np.cos(theta15), np.sin(theta15)
        return np.array(
            [
                m.b1 - m.a2 * np.cos(m.theta12) + m.a5 * c15 + s4 * c14,
                -m.c1 - m.a2 * np.sin(m.theta12) + m.a5 * s15 + s4 * s14,
                m.b1 - s6 + m.a5 * c15 + m.a4 * c14,
                -m.a1 + m.a5 * s15 + m.a4 * s14,
            ]
        )

    def phi_q(q: Any) -> Any:
        theta14, theta15, s4, _ = q
        c14, s14, c15, s15 = np.cos(theta14), np.sin(theta14), np.cos(theta15), np.sin(theta15)
        return np.array(
            [
                [-s4 * s14, -m.a5 * s15, c14, 0],
                [s4 * c14, m.a5 * c15, s14, 0],
                [-m.a4 * s14, -m.a5 * s15, 0, -1],
                [m.a4 * c14, m.a5 * c15, 0, 0],
            ]
        )

    return SquareSystem(phi, phi_q)


class Rapier(NamedTuple):
    """Lengths of the six-link rapier drive, in one unit, and how its lost figure is read.

    C0 = (x0, y0) and the guide at height `guide`, against A0; D = C + to_d (cos theta14, sin theta14); s16 is counted
    from x = `counted_from`.
    """

    x0: Number
    y0: Number
    guide: Number
    to_d: Number
    counted_from: Number
    a2: Number
    a3: Number
    a4: Number
    a5: Number
    a6: Number


def rapier(m: Rapier, theta12: Number) -> SquareSystem:
    """Return the two loops of the rapier drive in q = (theta13, theta14, theta15, s16).

    a2 e^(i theta12) + a3 e^(i theta13) = C0 + a5 e^(i theta15) + a4 e^(i theta14), and
    C0 + a5 e^(i theta15) + to_d e^(i theta14) + a6 = counted_from + s16 + i guide
    """

    def phi(q: Any) -> Any:
        theta13, theta14, theta15, s16 = q
        c_x, c_y = m.x0 + m.a5 * np.cos(theta15), m.y0 + m.a5 * np.sin(theta15)
        return np.array(
            [
                m.a2 * np.cos(theta12) + m.a3 * np.cos(theta13) - c_x - m.a4 * np.cos(theta14),
                m.a2 * np.sin(theta12) + m.a3 * np.sin(theta13) - c_y - m.a4 * np.sin(theta14),
                c_x + m.to_d * np.cos(theta14) + m.a6 - m.counted_from - s16,
                c_y + m.to_d * np.sin(theta14) - m.guide,
            ]
        )

    def phi_q(q: Any) -> Any:
        theta13, theta14, theta15, _ = q
        c14, s14, c15, s15 = np.cos(theta14), np.sin(theta14), np.cos(theta15), np.sin(theta15)
        return np.array(
            [
                [-m.a3 * np.sin(theta13), m.a4 * s14, m.a5 * s15, 0],
                [m.a3 * np.cos(theta13), -m.a4 * c14, -m.a5 * c15, 0],
                [0, -m.to_d * s14, -m.a5 * s15, -1],
                [0, m.to_d * c14, m.a5 * c15, 0],
            ]
        )

    return SquareSystem(phi, phi_q)


def rapier_fold(m: Rapier) -> SquareSystem:
    """Return the equations of the pose at which the crank can go no further, in (q, theta12, v), v of four numbers.

    phi = 0, phi_q v = 0, v2 = 1: regular where phi_q alone is singular.
    """

    def phi(z: Any) -> Any:
        loops = rapier(m, z[4])
        return np.concatenate([loops.phi(z[:4]), loops.phi_q(z[:4]) @ z[5:], [z[6] - 1]])

    def phi_q(z: Any) -> Any:
        (theta13, theta14, theta15, _), theta12, v = z[:4], z[4], z[5:]
        slope = rapier(m, theta12).phi_q(z[:4])
        out = np.zeros((9, 9), slope.dtype)
        out[:4, :4], out[4:8, 5:] = slope, slope
        out[0, 4], out[1, 4] = -m.a2 * np.sin(theta12), m.a2 * np.cos(theta12)
        # The second derivative of a vector of a loop by its own angle is minus that vector.
        for column, angle, loops in (
            (0, theta13, (m.a3, 0)),
            (1, theta14, (-m.a4, m.to_d)),
            (2, theta15, (-m.a5, m.a5)),
        ):
            for k, length in enumerate(loops):
                out[4 + 2 * k, column] = -length * np.cos(angle) * v[column]
                out[5 + 2 * k, column] = -length * np.sin(angle) * v[column]
        out[8, 6] = 1
        return out

    return SquareSystem(phi, phi_q)
