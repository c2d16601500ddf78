"""Vectors of space whose components are jets, frames made of them, and turns about a line by an unknown angle."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from crosscheck.engines.closed_form.jets import Jet, midpoint


class Vector:
    """A vector of three jets."""

    __slots__ = ("x", "y", "z")

    def __init__(self, x: Jet, y: Jet, z: Jet) -> None:
        self.x, self.y, self.z = x, y, z

    def __add__(self, other: Vector) -> Vector:
        return Vector(self.x + other.x, self.y + other.y, self.z + other.z)

    def __sub__(self, other: Vector) -> Vector:
        return Vector(self.x - other.x, self.y - other.y, self.z - other.z)

    def dot(self, other: Vector) -> Jet:
        """Return the scalar product."""
        return self.x * other.x + self.y * other.y + self.z * other.z

    def cross(self, other: Vector) -> Vector:
        """Return the vector product."""
        return Vector(
            self.y * other.z - self.z * other.y,
            self.z * other.x - self.x * other.z,
            self.x * other.y - self.y * other.x,
        )

    def scaled(self, factor: Jet) -> Vector:
        """Return the vector multiplied by a number."""
        return Vector(self.x * factor, self.y * factor, self.z * factor)

    def unit(self) -> Vector:
        """Return the vector divided by its length."""
        length = self.dot(self).sqrt()
        return Vector(self.x / length, self.y / length, self.z / length)

    def part(self, order: str, count: int) -> Any:
        """Return the floats (3, T) nearest its values ("v"), rates ("d") or accelerations ("a")."""
        rows = [np.broadcast_to(midpoint(getattr(c, order)), (count,)) for c in (self.x, self.y, self.z)]
        return np.stack(rows)


@dataclass(frozen=True)
class Frame:
    """A body on the ground: where its origin is, and its axes."""

    origin: Vector
    x: Vector
    y: Vector
    z: Vector

    def turned(self, u: Vector) -> Vector:
        """Return a vector of the body in the ground frame."""
        return self.x.scaled(u.x) + self.y.scaled(u.y) + self.z.scaled(u.z)

    def point(self, u: Vector) -> Vector:
        """Return where a point of the body is."""
        return self.origin + self.turned(u)

    def moved(self, by: Vector) -> Frame:
        """Return the body shifted."""
        return Frame(self.origin + by, self.x, self.y, self.z)


Condition = tuple[Jet, Jet, Jet]
"""P, Q, K of P cos + Q sin = K."""


@dataclass(frozen=True)
class TurningVector:
    """What turns about a line: v = still + c cos + s sin, of a point or a direction."""

    still: Vector
    c: Vector
    s: Vector

    def at(self, cos: Jet, sin: Jet) -> Vector:
        """Return it at an angle."""
        return self.still + self.c.scaled(cos) + self.s.scaled(sin)

    def on_sphere(self, centre: Vector, radius: Jet) -> Condition:
        """Return the condition |v - centre| = radius; the arms c and s of a circle are equal and at right angles."""
        w = self.still - centre
        k = radius * radius - w.dot(w) - self.c.dot(self.c)
        return w.dot(self.c).times(2.0), w.dot(self.s).times(2.0), k

    def in_plane(self, normal: Vector, value: Jet) -> Condition:
        """Return the condition normal . v = value."""
        return normal.dot(self.c), normal.dot(self.s), value - normal.dot(self.still)


@dataclass(frozen=True)
class Turning:
    """A body that is free to turn about a line through a point: `frame` is where it is at the angle zero."""

    frame: Frame
    foot: Vector
    axis: Vector

    def direction(self, u: Vector) -> TurningVector:
        """Return how a vector of the body turns."""
        return self._circle(self.frame.turned(u))

    def point(self, u: Vector) -> TurningVector:
        """Return how a point of the body turns."""
        arm = self._circle(self.frame.point(u) - self.foot)
        return TurningVector(arm.still + self.foot, arm.c, arm.s)

    def _circle(self, arm: Vector) -> TurningVector:
        along = self.axis.scaled(self.axis.dot(arm))
        return TurningVector(along, arm - along, self.axis.cross(arm))

    def at(self, cos: Jet, sin: Jet) -> Frame:
        """Return the body at an angle."""
        arm = self._circle(self.frame.origin - self.foot)
        axes = (self._circle(v).at(cos, sin) for v in (self.frame.x, self.frame.y, self.frame.z))
        return Frame(arm.at(cos, sin) + self.foot, *axes)


def basis(axis: Vector, across: Vector) -> tuple[Vector, Vector, Vector]:
    """Return unit vectors f, g, h: h along the axis, f along what of `across` is across it, g = h x f."""
    h = axis.unit()
    f = (across - h.scaled(h.dot(across))).unit()
    return f, h.cross(f), h


def composed(at: Vector, axes: Sequence[Vector], u: Vector, own: Sequence[Vector]) -> Frame:
    """Return the frame of a body, of which a point and three unit vectors are given in the ground, too.

    Parameters
    ----------
    at, axes, u, own : Vector, sequence of three Vector, Vector, sequence of three Vector
        A place and unit vectors of the ground; the body's point there and its unit vectors along them.
    """

    def turned(local: Vector) -> Vector:
        parts = [axis.scaled(mine.dot(local)) for axis, mine in zip(axes, own, strict=True)]
        return parts[0] + parts[1] + parts[2]

    one, zero = Jet(1.0), Jet(0.0)
    x, y, z = (turned(Vector(*e)) for e in ((one, zero, zero), (zero, one, zero), (zero, zero, one)))
    return Frame(at - turned(u), x, y, z)


def together(rows: Sequence[Any]) -> float:
    """Return the smallest singular value of all conditions together, each of length 1."""
    p, q = (np.stack(np.broadcast_arrays(*[midpoint(row[k].v) for row in rows])).astype(float) for k in (0, 1))
    length = np.hypot(p, q)
    p, q = p / length, q / length
    trace, det = (
        np.sum(p * p + q * q, axis=0),
        np.sum(p * p, axis=0) * np.sum(q * q, axis=0) - np.sum(p * q, axis=0) ** 2,
    )
    return float(np.sqrt(np.min(2.0 * det / (trace + np.sqrt(np.maximum(trace * trace - 4.0 * det, 0.0))))))


def least_squares(rows: Sequence[Condition]) -> tuple[Jet, Jet]:
    """Return cos and sin from conditions that agree, by the normal equations.

    These square the condition, so the solution is corrected by what it leaves of the conditions themselves.
    """

    def product(a: int, b: int, rows: Sequence[Condition] = rows) -> Jet:
        return sum((row[a] * row[b] for row in rows[1:]), rows[0][a] * rows[0][b])

    pp, pq, qq = product(0, 0), product(0, 1), product(1, 1)
    det = pp * qq - pq * pq

    def solved(rows: Sequence[Condition]) -> tuple[Jet, Jet]:
        pk, qk = product(0, 2, rows), product(1, 2, rows)
        return (pk * qq - qk * pq) / det, (pp * qk - pq * pk) / det

    cos, sin = solved(rows)
    more_cos, more_sin = solved([(p, q, k - p * cos - q * sin) for p, q, k in rows])
    return cos + more_cos, sin + more_sin
