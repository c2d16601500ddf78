"""Vectors of space, Euler parameters, and the values of one body of space: all that a spatial formula may touch.

A body has seven coordinates, its origin r and Euler parameters p = (e0, e), scalar first (Nikravesh, Computer-Aided
Analysis of Mechanical Systems, 6; Haug, 9.3). Its rotation is taken in the homogeneous form, which is polynomial in p:

    A(p) u = (e0^2 - e.e) u + 2 e (e.u) + 2 e0 e x u = e0 c + e s + e x c,   s = e.u,  c = e0 u + e x u
    d(A u)/dp k = 2 (c k0 + s k + k x c)      (A u)' = that for k = p'      (A u)'' = that for k = p'', and 2 A(p') u

so values, slopes, rates and drifts need + - * alone, and hold on p.p = 1 and off it. There, as everywhere, p and -p are
the same pose. With |p| = 1 and E = (-e, e0 I + e~): omega = 2 E p', p' = E^T omega / 2, in the ground frame.
"""

from __future__ import annotations

from collections.abc import Iterator
from typing import Any

import numpy as np

from refkin.joints.elements import Triple
from refkin.vec import Scalar

Quad = tuple[Scalar, Scalar, Scalar, Scalar]


class Vec3:
    """A vector of space."""

    __slots__ = ("x", "y", "z")

    def __init__(self, x: Scalar, y: Scalar, z: Scalar) -> None:
        self.x, self.y, self.z = x, y, z

    def __add__(self, other: Vec3) -> Vec3:
        return Vec3(self.x + other.x, self.y + other.y, self.z + other.z)

    def __sub__(self, other: Vec3) -> Vec3:
        return Vec3(self.x - other.x, self.y - other.y, self.z - other.z)

    def __neg__(self) -> Vec3:
        return Vec3(-self.x, -self.y, -self.z)

    def __mul__(self, factor: Scalar) -> Vec3:
        return Vec3(self.x * factor, self.y * factor, self.z * factor)

    def dot(self, other: Vec3) -> Scalar:
        return self.x * other.x + self.y * other.y + self.z * other.z

    def cross(self, other: Vec3) -> Vec3:
        return Vec3(
            self.y * other.z - self.z * other.y,
            self.z * other.x - self.x * other.z,
            self.x * other.y - self.y * other.x,
        )

    @property
    def parts(self) -> tuple[Scalar, Scalar, Scalar]:
        return self.x, self.y, self.z


class Quaternion:
    """Euler parameters, or any four numbers with their product: `a` is the scalar part, `v` the vector part."""

    __slots__ = ("a", "v")

    def __init__(self, a: Scalar, v: Vec3) -> None:
        self.a, self.v = a, v

    @classmethod
    def of(cls, e0: Scalar, e1: Scalar, e2: Scalar, e3: Scalar) -> Quaternion:
        return cls(e0, Vec3(e1, e2, e3))

    def times(self, other: Quaternion) -> Quaternion:
        """Return the product: first the turn of `other`, then that of this one."""
        vector = other.v * self.a + self.v * other.a + self.v.cross(other.v)
        return Quaternion(self.a * other.a - self.v.dot(other.v), vector)

    def part(self, other: Quaternion, k: int) -> Scalar:
        """Return the k-th number, 0, 1, 2, of the vector part of the product, and compute no other."""
        u, w, x, y = self.v.parts, other.v.parts, (k + 1) % 3, (k + 2) % 3
        return w[k] * self.a + u[k] * other.a + (u[x] * w[y] - u[y] * w[x])

    def conj(self) -> Quaternion:
        """Return the conjugate: the turn back."""
        return Quaternion(self.a, -self.v)

    def __add__(self, other: Quaternion) -> Quaternion:
        return Quaternion(self.a + other.a, self.v + other.v)

    def __mul__(self, factor: Scalar) -> Quaternion:
        return Quaternion(self.a * factor, self.v * factor)

    def times_axis(self, k: int) -> Quaternion:
        """Return the product with the k-th unit vector, k = 0, 1, 2."""
        a, (x, y, z) = self.a, self.v.parts
        v = (Vec3(a, z, -y), Vec3(-z, a, x), Vec3(y, -x, a))[k]
        return Quaternion(-self.v.parts[k], v)

    def dot(self, other: Quaternion) -> Scalar:
        return self.a * other.a + self.v.dot(other.v)

    @property
    def parts(self) -> Quad:
        return (self.a, *self.v.parts)


def turned(p: Quaternion, u: Vec3) -> tuple[Scalar, Vec3, Vec3]:
    """Return s, c and A(p) u."""
    s, c = p.v.dot(u), u * p.a + p.v.cross(u)
    return s, c, c * p.a + p.v * s + p.v.cross(c)


class SpatialValues:
    """One body of space: `r`, Euler parameters `p`; moving also their rates `v` and `pd`."""

    __slots__ = ("p", "pd", "r", "v")
    v: Vec3
    pd: Quaternion

    def __init__(self, x: Scalar, y: Scalar, z: Scalar, e0: Scalar, e1: Scalar, e2: Scalar, e3: Scalar) -> None:
        self.r = Vec3(x, y, z)
        self.p = Quaternion.of(e0, e1, e2, e3)

    def moving(self, *rates: Scalar) -> SpatialValues:
        self.v = Vec3(*rates[:3])
        self.pd = Quaternion.of(*rates[3:])
        return self

    def arm(self, x: Scalar, y: Scalar, z: Scalar) -> Arm:
        """Return a body-fixed vector as it is turned with the body."""
        return Arm(self, Vec3(x, y, z))

    def drift(self, u: Vec3) -> Vec3:
        """Return the part of (A u)'' that holds no p'', of a body-fixed vector: 2 A(p') u."""
        return turned(self.pd, u)[2] * 2

    def point_motion(self, u: tuple[float, ...], qd: Any, qdd: Any) -> Iterator[Triple | None]:
        """Yield r = R + A u, v = R' + (A u)' and a = R'' + (A u)'' of a point of the body; None for rates not given."""
        arm = self.arm(*u)
        yield (self.r + arm.at).parts
        yield None if qd is None else (self.moving(*qd).v + arm.rate).parts
        yield None if qdd is None else (Vec3(*qdd[:3]) + arm.along(Quaternion.of(*qdd[3:])) + arm.drift).parts

    def omega(self, qd: Any) -> Any:
        """Return 2 E p' in the ground frame, (3, T): the angular velocity of qd (7, T), the acceleration of qdd."""
        return None if qd is None else np.array((Quaternion.of(*qd[3:]).times(self.p.conj()).v * 2).parts)

    def rotation(self) -> Any:
        """Return the matrix A, (3, 3, T)."""
        return np.array([self.arm(*axis).at.parts for axis in np.eye(3)]).swapaxes(0, 1)


class Arm:
    """A body-fixed vector u in the ground frame: `at` is A u; with its slopes, and how it moves."""

    __slots__ = ("at", "body", "c", "s", "u")

    def __init__(self, body: SpatialValues, u: Vec3) -> None:
        self.body, self.u = body, u
        self.s, self.c, self.at = turned(body.p, u)

    def slope(self, n: Vec3) -> Quad:
        """Return d(n . A u)/dp with n held fixed."""
        turned = n * self.s + self.c.cross(n)
        return (2 * n.dot(self.c), 2 * turned.x, 2 * turned.y, 2 * turned.z)

    def slopes(self) -> tuple[Quad, Quad, Quad]:
        """Return dA u/dp, a row for each component."""
        (x, y, z), s = (self.c * 2).parts, 2 * self.s
        return (x, s, z, -y), (y, -z, s, x), (z, y, -x, s)

    @property
    def rate(self) -> Vec3:
        """(A u)'."""
        return self.along(self.body.pd)

    def along(self, k: Quaternion) -> Vec3:
        """Return dA u/dp k."""
        slope: Vec3 = (self.c * k.a + k.v * self.s + k.v.cross(self.c)) * 2
        return slope

    @property
    def drift(self) -> Vec3:
        """The part of (A u)'' that holds no p''."""
        return self.body.drift(self.u)
