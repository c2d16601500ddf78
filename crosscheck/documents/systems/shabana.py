"""Notes on Shabana, Computational Dynamics, chapter 3: its loops, closed forms and right sides.

Links 2 and 3 are crank and connecting rod or coupler, 4 is rocker or block; theta are angles against the x axis.

Section 3.12 has the slider-crank in twelve coordinates, q = (R1, theta1, ..., R4, theta4). Body 1 is the fixed link,
the frames of crank 2 and rod 3 sit in the middle of the links (R + A u with u_O = (-l/2, 0), u_A and u_B = (l/2, 0)),
block 4 has its frame at the pin B.
"""

from __future__ import annotations

from typing import Any, NamedTuple

import numpy as np

from crosscheck.documents.systems import Number, SquareSystem

CRANK_DRIVEN, SLIDER_DRIVEN = 5, 9
"""The coordinate that the last of the twelve rows holds: theta2 or R4x."""


class LoopOfFourBars(NamedTuple):
    """The four-bar of section 3.11 by its lengths; l1 is the ground's."""

    l1: Number
    l2: Number
    l3: Number
    l4: Number

    def system(self, driven: Number) -> SquareSystem:
        """Return the loop in q = (theta2, theta3, theta4); `driven` is omega t + theta_0 [rad].

        l2 cos theta2 + l3 cos theta3 + l4 cos theta4 - l1 = 0, the same with sines and without l1, theta2 - driven = 0
        """
        l1, l2, l3, l4 = self

        def phi(q: Any) -> Any:
            c, s = np.cos(q), np.sin(q)
            return np.array([l2 * c[0] + l3 * c[1] + l4 * c[2] - l1, l2 * s[0] + l3 * s[1] + l4 * s[2], q[0] - driven])

        def phi_q(q: Any) -> Any:
            c, s = np.cos(q), np.sin(q)
            return np.array([[-l2 * s[0], -l3 * s[1], -l4 * s[2]], [l2 * c[0], l3 * c[1], l4 * c[2]], [1, 0, 0]])

        return SquareSystem(phi, phi_q)

    def right_side(self, q: Any, qd: Any) -> Any:
        """Return Q_d at constant speed of the crank: C_q qdd = Q_d."""
        c, s = np.cos(q), np.sin(q)
        _, l2, l3, l4 = self
        square = qd * qd
        return np.array(
            [
                square[0] * l2 * c[0] + square[1] * l3 * c[1] + square[2] * l4 * c[2],
                square[0] * l2 * s[0] + square[1] * l3 * s[1] + square[2] * l4 * s[2],
                0,
            ]
        )


class CoriolisExample(NamedTuple):
    """The block on rod 3 of section 3.6: l2 e^(i theta2) - l1 - x e^(i theta3) = 0 in q = (theta3, x)."""

    l1: Number
    l2: Number
    theta2: Number

    def system(self) -> SquareSystem:
        """Return the loop."""
        l1, l2, theta2 = self

        def phi(q: Any) -> Any:
            return np.array([l2 * np.cos(theta2) - l1 - q[1] * np.cos(q[0]), l2 * np.sin(theta2) - q[1] * np.sin(q[0])])

        def phi_q(q: Any) -> Any:
            return np.array([[q[1] * np.sin(q[0]), -np.cos(q[0])], [-q[1] * np.cos(q[0]), -np.sin(q[0])]])

        return SquareSystem(phi, phi_q)

    def velocity(self, q: Any, rate: Number) -> Any:
        """Return (theta3', x') = theta2' (l2 cos(theta3 - theta2) / x, l2 sin(theta3 - theta2))."""
        _, l2, theta2 = self
        return rate * np.array([l2 * np.cos(q[0] - theta2) / q[1], l2 * np.sin(q[0] - theta2)])

    def right_side(self, q: Any, qd: Any, rate: Number, theta2dd: Number) -> tuple[Any, Any]:
        """Return matrix and right side of the linear system for (theta3'', x'')."""
        (theta3, x), (w3, v), (_, l2, theta2) = q, qd, self
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


class CrankAndRod(NamedTuple):
    """The lengths of links 2 and 3: of the slider-crank of sections 3.6 and 3.12, and of the arm of section 3.10."""

    l2: Number
    l3: Number

    def system(self, h: Number, theta2: Number) -> SquareSystem:
        """Return the slider-crank with offset h in q = (theta3, x) (section 3.6).

        l2 cos theta2 + l3 cos theta3 - x = 0, l2 sin theta2 + l3 sin theta3 - h = 0
        """
        l2, l3 = self

        def phi(q: Any) -> Any:
            along, across = l2 * np.cos(theta2) + l3 * np.cos(q[0]), l2 * np.sin(theta2) + l3 * np.sin(q[0])
            return np.array([along - q[1], across - h])

        def phi_q(q: Any) -> Any:
            return np.array([[-l3 * np.sin(q[0]), -1], [l3 * np.cos(q[0]), 0]])

        return SquareSystem(phi, phi_q)

    def position(self, h: Number, theta2: Number, sign: int) -> tuple[Number, Number]:
        """Return sin theta3 and x = l2 cos theta2 + sign sqrt(l3^2 - (h - l2 sin theta2)^2); sign: of cos theta3."""
        rise = h - self.l2 * np.sin(theta2)
        return rise / self.l3, self.l2 * np.cos(theta2) + sign * np.sqrt(self.l3 * self.l3 - rise * rise)

    def theta3(self, n: Any, theta2: Number) -> Number:
        """Return the angle of the rod, along the guide, without offset; the arithmetic `n` has the arcsine."""
        return n.arcsin(-self.l2 * np.sin(theta2) / self.l3)

    def velocity(self, theta2: Number, theta3: Number, rate: Number) -> Any:
        """Return (theta3', x') of the slider-crank at the rate theta2'."""
        factor = rate * self.l2 / (self.l3 * np.cos(theta3))
        return np.array([-factor * np.cos(theta2), factor * self.l3 * np.sin(theta3 - theta2)])

    def acceleration(self, theta2: Number, theta3: Number, rates: tuple[Number, Number], theta2dd: Number) -> Any:
        """Return (theta3'', x'') of the slider-crank at the rates (theta2', theta3') and theta2''."""
        (w2, w3), (l2, l3) = rates, self
        c1 = -l2 * w2 * w2 * np.cos(theta2) - l2 * theta2dd * np.sin(theta2) - l3 * w3 * w3 * np.cos(theta3)
        c2 = -l2 * w2 * w2 * np.sin(theta2) + l2 * theta2dd * np.cos(theta2) - l3 * w3 * w3 * np.sin(theta3)
        below = l3 * np.cos(theta3)
        return np.array([-c2 / below, (c1 * l3 * np.cos(theta3) + c2 * l3 * np.sin(theta3)) / below])

    def arm_rates(self, theta2: Number, theta3: Number, w2: Number, w3: Number) -> tuple[Any, Any]:
        """Return (R2x, R2y, R3x, R3y)' and '' of the driven two-link arm at constant speeds w2, w3 (section 3.10)."""
        l2, half = self.l2, (self.l2 / 2, self.l3 / 2)
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

    def twelve_coordinates(self, driven: Number, coordinate: int = CRANK_DRIVEN) -> SquareSystem:
        """Return C(q, t) of section 3.12; the last row holds theta2 or R4x at what it is driven by."""

        def phi(q: Any) -> Any:
            arms = self._arms(q)
            at_o = q[3:5] - arms[0]
            at_a = q[3:5] + arms[0] - q[6:8] + arms[1]
            at_b = q[6:8] + arms[1] - q[9:11]
            return np.concatenate([q[:3], at_o, at_a, at_b, q[10:12], [q[coordinate] - driven]])

        def phi_q(q: Any) -> Any:
            crank, rod = (np.array([-arm[1], arm[0]]) for arm in self._arms(q))
            out = np.zeros((12, 12), np.result_type(q, crank))
            out[(0, 1, 2), (0, 1, 2)] = 1
            for row, columns, turning in ((3, 3, ((5, -crank),)), (5, 3, ((5, crank), (8, rod))), (7, 6, ((8, rod),))):
                out[(row, row + 1), (columns, columns + 1)] = 1
                for column, slope in turning:
                    out[row : row + 2, column] = slope
            out[(5, 6), (6, 7)] = -1
            out[(7, 8), (9, 10)] = -1
            out[9, 10] = out[10, 11] = 1
            out[11, coordinate] = 1
            return out

        return SquareSystem(phi, phi_q)

    def right_side(self, q: Any, qd: Any, second: Number = 0) -> Any:
        """Return Q_d of the twelve coordinates; `second` is the second derivative of what the last row is driven by."""
        crank, rod = (arm * (rate * rate) for arm, rate in zip(self._arms(q), (qd[5], qd[8]), strict=True))
        return np.concatenate([[0, 0, 0], -crank, crank + rod, rod, [0, 0, second]])

    def pose(self, theta2: Number, theta3: Number) -> Any:
        """Return the twelve coordinates for the angles of crank and rod, the block wherever the rod ends."""
        crank = np.array([np.cos(theta2), np.sin(theta2)]) * self.l2
        rod = np.array([np.cos(theta3), np.sin(theta3)]) * self.l3
        return np.concatenate([[0, 0, 0], crank / 2, [theta2], crank + rod / 2, [theta3], crank + rod, [0]])

    def _arms(self, q: Any) -> tuple[Any, Any]:
        """Return A2 u_A and A3 u_B: half of crank and rod."""
        halves = ((5, self.l2), (8, self.l3))
        crank, rod = (np.array([np.cos(q[k]), np.sin(q[k])]) * length / 2 for k, length in halves)
        return crank, rod
