"""ME451, Kinematics and Dynamics of Machine Systems, slides of October 25, 2010: Newton-Raphson, position analysis."""

from __future__ import annotations

from typing import Any, NamedTuple

import numpy as np

from crosscheck.documents.systems import Number, SquareSystem, scalar
from crosscheck.scenes.hard_case import ends, pin
from refkin.joints import GROUND, DistanceDriver, Prismatic
from refkin.model import Body, Mechanism
from refkin.motion_laws import Polynomial


def root_minus_sine() -> SquareSystem:
    """Return sqrt(x) - sin(x) = 0 (slide "Solving a Nonlinear System"); not differentiable at its root."""
    return scalar(lambda x: np.sqrt(x) - np.sin(x), lambda x: 1 / (2 * np.sqrt(x)) - np.cos(x))


def sine_and_exponential() -> SquareSystem:
    """Return 3x + sin(xy) - 4 = 0, x - e^(cos y) = 0 (slide "Solving a Nonlinear System")."""

    def phi(q: Any) -> Any:
        x, y = q
        return np.array([3 * x + np.sin(x * y) - 4, x - np.exp(np.cos(y))])

    def phi_q(q: Any) -> Any:
        x, y = q
        turning = np.cos(x * y)
        return np.array([[3 + y * turning, x * turning], [1, np.sin(y) * np.exp(np.cos(y))]])

    return SquareSystem(phi, phi_q)


def square_and_sine(constant: Number) -> SquareSystem:
    """Return x^2 + sin(x) - constant = 0 (slide "Example: Solve f(x) = 0"; 1.841471 there)."""
    return scalar(lambda x: x * x + np.sin(x) - constant, lambda x: 2 * x + np.cos(x))


def exponential_and_logarithm(right: Number = 0) -> SquareSystem:
    """Return x - e^y = right, ln(1 + x) - cos y = 0 (slide "Example: Solve nonlinear system").

    The code of the slide has right = 0, the equations printed beside it, and on the first slide, right = 1.
    """

    def phi(q: Any) -> Any:
        x, y = q
        return np.array([x - np.exp(y) - right, np.log(1 + x) - np.cos(y)])

    def phi_q(q: Any) -> Any:
        x, y = q
        return np.array([[1, -np.exp(y)], [1 / (1 + x), np.sin(y)]])

    return SquareSystem(phi, phi_q)


class Problem356(NamedTuple):
    """Problem 3.5.6 by its lengths; `reach`, that of the cylinder, is t/10 + 0.4 there."""

    ground: Number
    link: Number

    def system(self, reach: Number) -> SquareSystem:
        """Return the equations in the reduced coordinates q = (x2, y2, phi3).

        x2 - ground + link sin(phi3) = 0, y2 - link cos(phi3) = 0, x2^2 + y2^2 - reach^2 = 0
        """
        ground, link = self

        def phi(q: Any) -> Any:
            x, y, angle = q
            square = x * x + y * y - reach * reach
            return np.array([x - ground + link * np.sin(angle), y - link * np.cos(angle), square])

        def phi_q(q: Any) -> Any:
            x, y, angle = q
            return np.array([[1, 0, link * np.cos(angle)], [0, 1, link * np.sin(angle)], [2 * x, 2 * y, 0]])

        return SquareSystem(phi, phi_q)

    def nu(self, reach: Number, speed: Number) -> Any:
        """Return nu = -phi_t; `speed` is the rate of `reach`."""
        return np.array([0, 0, 2 * reach * speed])

    def gamma(self, q: Any, qd: Any, speed: Number) -> Any:
        """Return gamma = -(phi_q qd)_q qd - 2 phi_qt qd - phi_tt at a constant speed, for q and qd (3,)."""
        turning = self.link * qd[2] * qd[2]
        last = 2 * speed * speed - 2 * (qd[0] * qd[0] + qd[1] * qd[1])
        return np.array([turning * np.sin(q[2]), -turning * np.cos(q[2]), last])

    def fold(self) -> SquareSystem:
        """Return the equations of the pose at which it folds, in (x2, y2, phi3, reach, v1, v2, v3).

        phi(q, reach) = 0, phi_q v = 0, v3 = 1: regular where phi_q alone is singular (Moore and Spence, SIAM J. Numer.
        Anal. 17, 1980).
        """

        def phi(z: Any) -> Any:
            pose = self.system(z[3])
            return np.concatenate([pose.phi(z[:3]), pose.phi_q(z[:3]) @ z[4:], [z[6] - 1]])

        def phi_q(z: Any) -> Any:
            _, _, angle, reach, *v = z
            slope = self.system(reach).phi_q(z[:3])
            out = np.zeros((7, 7), slope.dtype)
            out[:3, :3], out[3:6, 4:] = slope, slope
            out[2, 3] = -2 * reach
            out[3, 2], out[4, 2] = -self.link * np.sin(angle) * v[2], self.link * np.cos(angle) * v[2]
            out[5, 0], out[5, 1] = 2 * v[0], 2 * v[1]
            out[6, 6] = 1
            return out

        return SquareSystem(phi, phi_q)


def problem_356_mechanism(ground: float = 0.6, link: float = 0.25) -> Mechanism:
    """Return Problem 3.5.6 in absolute coordinates: cylinder, rod and rocker, the cylinder's length a law of time.

    The frame of the rod is the point (x2, y2), where it carries the rocker; the length is 0.4 + 0.1 t.
    """
    origin = (0.0, 0.0)
    joints = (
        pin("foot", GROUND, origin, "cylinder"),
        Prismatic(name="bore", **ends("cylinder", origin, "rod"), axis_i=(1.0, 0.0)),
        pin("pin", "rod", origin, "rocker", (0.0, link)),
        pin("pivot", GROUND, (ground, 0.0), "rocker"),
    )
    law = Polynomial(coefficients=(0.4, 0.1))
    stroke = DistanceDriver(name="stroke", **ends(GROUND, origin, "rod"), law=law)
    return Mechanism(tuple(Body(name=name) for name in ("cylinder", "rod", "rocker")), joints, (stroke,))


def even_function(constant: Number) -> SquareSystem:
    """Return (ln(cos x) + 1)^2 - sin(x^2 + 1) + constant = 0 (slide "Position Analysis", 0.645206284641418 there)."""

    def f(x: Any) -> Any:
        return (np.log(np.cos(x)) + 1) ** 2 - np.sin(x * x + 1) + constant

    def slope(x: Any) -> Any:
        tangent = np.sin(x) / np.cos(x)
        return -2 * (np.log(np.cos(x)) + 1) * tangent - 2 * x * np.cos(x * x + 1)

    return scalar(f, slope)


def square(constant: Number) -> SquareSystem:
    """Return x^2 + constant = 0 (slide "Position Analysis": no real root for 4, two for -4)."""
    return scalar(lambda x: x * x + constant, lambda x: 2 * x)
