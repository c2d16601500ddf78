"""Two-component vectors and the values of one body or parameter: all that a joint's formula may use.

The components are scalars of any arithmetic: `float`, `complex`, NumPy rows of shape (B,), `flint.arb` balls, traced
symbols. Nothing here branches on a value or makes an array, so a formula written with these runs on all of them.
"""

from __future__ import annotations

import math
from collections.abc import Iterator
from typing import Any

import numpy as np

Scalar = Any
"""A number of any arithmetic that has `+ - *`: float, complex, NumPy row, ball or symbol."""


class Vec:
    """A vector of the plane."""

    __slots__ = ("x", "y")

    def __init__(self, x: Scalar, y: Scalar) -> None:
        self.x = x
        self.y = y

    def __add__(self, other: Vec) -> Vec:
        return Vec(self.x + other.x, self.y + other.y)

    def __sub__(self, other: Vec) -> Vec:
        return Vec(self.x - other.x, self.y - other.y)

    def __neg__(self) -> Vec:
        return Vec(-self.x, -self.y)

    def __mul__(self, factor: Scalar) -> Vec:
        return Vec(self.x * factor, self.y * factor)

    def dot(self, other: Vec) -> Scalar:
        return self.x * other.x + self.y * other.y

    def perp(self) -> Vec:
        """Return the vector turned by a quarter turn counter-clockwise: d(A u)/dphi = (A u).perp()."""
        return Vec(-self.y, self.x)

    @property
    def parts(self) -> tuple[Scalar, Scalar]:
        return self.x, self.y


class BodyValues:
    """One body: origin `r` [m], angle `phi` [rad], its cos `c` and sin `s`; moving also `v` [m/s], `omega` [rad/s]."""

    __slots__ = ("c", "omega", "phi", "r", "s", "v")
    v: Vec
    omega: Scalar

    def __init__(self, x: Scalar, y: Scalar, phi: Scalar) -> None:
        self.r = Vec(x, y)
        self.phi = phi
        self.c, self.s = cosine_and_sine(phi)

    def moving(self, xd: Scalar, yd: Scalar, phid: Scalar) -> BodyValues:
        self.v = Vec(xd, yd)
        self.omega = phid
        return self

    def turned(self, u: Vec) -> Vec:
        """Return A(phi) u: a body-fixed vector in the ground frame."""
        return Vec(self.c * u.x - self.s * u.y, self.s * u.x + self.c * u.y)

    def point_motion(self, u: tuple[float, ...], qd: Any, qdd: Any) -> Iterator[tuple[Scalar, Scalar] | None]:
        """Yield r = R + A u, v = R' + omega x A u, a = R'' + alpha x A u - omega^2 A u; None for rates not given."""
        arm = self.turned(Vec(*u))
        yield (self.r + arm).parts
        yield None if qd is None else (Vec(qd[0], qd[1]) + arm.perp() * qd[2]).parts
        yield None if qdd is None else (Vec(qdd[0], qdd[1]) + arm.perp() * qdd[2] + arm * -(qd[2] * qd[2])).parts


class ParameterValue:
    """An angle that is a coordinate but no body's: `value` [rad], cos and sin; moving also `rate` [rad/s]."""

    __slots__ = ("c", "rate", "s", "value")
    rate: Scalar

    def __init__(self, value: Scalar) -> None:
        self.value = value
        self.c, self.s = cosine_and_sine(value)

    def moving(self, rate: Scalar) -> ParameterValue:
        self.rate = rate
        return self


def cosine_and_sine(angle: Scalar) -> tuple[Scalar, Scalar]:
    """Return cos and sin of an angle of any arithmetic."""
    if isinstance(angle, float):
        return (math.cos(angle), math.sin(angle)) if math.isfinite(angle) else (math.nan, math.nan)
    if hasattr(angle, "cos"):  # balls and symbols bring their own
        return angle.cos(), angle.sin()
    return np.cos(angle), np.sin(angle)
