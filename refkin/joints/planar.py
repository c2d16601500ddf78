"""The planar joints: revolute, fixed, prismatic, point_on_line, distance.

To add a joint, write a dataclass like these (its fields are its keys in a scene file) and name it in `PLANAR_TYPES`:
docs/howto/code.md has an example, and what tests will ask for. r_P = r + A(phi) u is a point of a body (K1), d = r_Pj -
r_Pi the gap of the two points of a joint (J1) (Shabana, Computational Dynamics, 3; Haug, Computer Aided Kinematics, 3).
"""

from __future__ import annotations

import math
from collections.abc import Iterator
from dataclasses import dataclass
from typing import Any, Literal

from refkin.errors import Fault
from refkin.joints.base import Blocks, Constraint, Rows, Unit, along, arms, drift, gap_rate, offset, turned_points
from refkin.joints.elements import Element, GuidedPoint, Pair, PointDistance, PointsCoincide, RelativeAngle
from refkin.motion_laws import AnyLaw, Law
from refkin.vec import BodyValues, Vec


@dataclass(frozen=True, kw_only=True)
class BetweenPoints(Constraint):
    """What is said of a point of body i and a point of body j, each in the frame of its body [m]."""

    body_i: str
    point_i: Pair
    body_j: str
    point_j: Pair


@dataclass(frozen=True, kw_only=True)
class Revolute(BetweenPoints):
    """Two points coincide, d = 0; or, by an `offset_law`, two functions of time keep them apart: d - f(t) = 0 (J3) [m].

    The offset leads from point i to point j, in the ground frame. (Shabana has the bodies the other way round:
    R^i + A^i u^i - R^j - A^j u^j = f(t).)
    """

    rows = 2
    offset_law: tuple[AnyLaw, AnyLaw] | None = None
    type: Literal["revolute"] = "revolute"

    @property
    def laws(self) -> tuple[Law, ...]:
        return self.offset_law or ()

    @property
    def law_keys(self) -> tuple[str, ...]:
        return ("offset_law[0]", "offset_law[1]")[: len(self.laws)]

    def elements(self) -> Iterator[Element]:
        yield PointsCoincide(**ends_of(self), laws=self.laws)

    @staticmethod
    def residual(g: Any, f: Any, i: BodyValues, j: BodyValues) -> Rows:
        _, _, d = arms(g, i, j)
        return (d - offset(f, 0)).parts

    @staticmethod
    def jacobian(g: Any, f: Any, i: BodyValues, j: BodyValues) -> Blocks:
        a_i, a_j = turned_points(g, i, j)
        return ((-1, 0, a_i.y), (0, -1, -a_i.x)), ((1, 0, -a_j.y), (0, 1, a_j.x))

    @staticmethod
    def nu(g: Any, f: Any, i: BodyValues, j: BodyValues) -> Rows:
        return offset(f, 1).parts

    @staticmethod
    def gamma(g: Any, f: Any, i: BodyValues, j: BodyValues) -> Rows:
        return (offset(f, 2) - drift(*turned_points(g, i, j), i, j)).parts


@dataclass(frozen=True, kw_only=True)
class Fixed(BetweenPoints):
    """Two bodies move as one: d = 0 and phi_j - phi_i = angle (J4) [rad]."""

    rows = 3
    angle: float = 0.0
    type: Literal["fixed"] = "fixed"

    def elements(self) -> Iterator[Element]:
        yield PointsCoincide(**ends_of(self))
        yield RelativeAngle(body_i=self.body_i, body_j=self.body_j, angle=self.angle)

    def constants(self, unit: Unit) -> tuple[float, ...]:
        return (*super().constants(unit), self.angle)

    @staticmethod
    def residual(g: Any, f: Any, i: BodyValues, j: BodyValues) -> Rows:
        return (*Revolute.residual(g, f, i, j), j.phi - i.phi - g[4])

    @staticmethod
    def jacobian(g: Any, f: Any, i: BodyValues, j: BodyValues) -> Blocks:
        block_i, block_j = Revolute.jacobian(g, f, i, j)
        return (*block_i, (0, 0, -1)), (*block_j, (0, 0, 1))

    @staticmethod
    def gamma(g: Any, f: Any, i: BodyValues, j: BodyValues) -> Rows:
        return (*Revolute.gamma(g, f, i, j), 0)


@dataclass(frozen=True, kw_only=True)
class PointOnLine(BetweenPoints):
    """A point of body j stays on a line of body i: axis_i x d = n . d = 0 (J5) with n the unit normal of the axis."""

    rows = 1
    axis_i: Pair
    type: Literal["point_on_line"] = "point_on_line"

    def elements(self) -> Iterator[Element]:
        yield GuidedPoint(**ends_of(self), axis_i=self.axis_i)

    def constants(self, unit: Unit) -> tuple[float, ...]:
        return (*super().constants(unit), *unit_normal(self.axis_i))

    def faults(self, path: str) -> Iterator[Fault]:
        yield from axis_faults(path, self.axis_i)

    @staticmethod
    def residual(g: Any, f: Any, i: BodyValues, j: BodyValues) -> Rows:
        _, _, d = arms(g, i, j)
        return (i.turned(Vec(g[4], g[5])).dot(d),)

    @staticmethod
    def jacobian(g: Any, f: Any, i: BodyValues, j: BodyValues) -> Blocks:
        a_i, a_j, d = arms(g, i, j)
        n = i.turned(Vec(g[4], g[5]))
        (x, y, phi), block_j = along(n, a_i, a_j)
        return ((x, y, phi + n.perp().dot(d)),), (block_j,)

    @staticmethod
    def gamma(g: Any, f: Any, i: BodyValues, j: BodyValues) -> Rows:
        a_i, a_j, d = arms(g, i, j)
        n = i.turned(Vec(g[4], g[5]))
        turning = n.perp().dot(gap_rate(a_i, a_j, i, j)) * (2 * i.omega) - n.dot(d) * (i.omega * i.omega)
        return (-turning - n.dot(drift(a_i, a_j, i, j)),)


@dataclass(frozen=True, kw_only=True)
class Prismatic(BetweenPoints):
    """Body j slides along an axis of body i and does not turn on it: n . d = 0, phi_j - phi_i = angle (J6) [rad]."""

    rows = 2
    axis_i: Pair
    angle: float = 0.0
    type: Literal["prismatic"] = "prismatic"

    def elements(self) -> Iterator[Element]:
        yield GuidedPoint(**ends_of(self), axis_i=self.axis_i)
        yield RelativeAngle(body_i=self.body_i, body_j=self.body_j, angle=self.angle)

    def constants(self, unit: Unit) -> tuple[float, ...]:
        return (*super().constants(unit), *unit_normal(self.axis_i), self.angle)

    def faults(self, path: str) -> Iterator[Fault]:
        yield from axis_faults(path, self.axis_i)

    @staticmethod
    def residual(g: Any, f: Any, i: BodyValues, j: BodyValues) -> Rows:
        return (*PointOnLine.residual(g, f, i, j), j.phi - i.phi - g[6])

    @staticmethod
    def jacobian(g: Any, f: Any, i: BodyValues, j: BodyValues) -> Blocks:
        block_i, block_j = PointOnLine.jacobian(g, f, i, j)
        return (*block_i, (0, 0, -1)), (*block_j, (0, 0, 1))

    @staticmethod
    def gamma(g: Any, f: Any, i: BodyValues, j: BodyValues) -> Rows:
        return (*PointOnLine.gamma(g, f, i, j), 0)


@dataclass(frozen=True, kw_only=True)
class Distance(BetweenPoints):
    """Two points keep a distance, as the ends of a massless link do: (d . d - length^2) / (2 length) = 0 (J7)."""

    rows = 1
    length: float
    type: Literal["distance"] = "distance"

    def elements(self) -> Iterator[Element]:
        yield PointDistance(**ends_of(self), length=self.length)

    def constants(self, unit: Unit) -> tuple[float, ...]:
        length = self.length / unit.size
        return (*super().constants(unit), length, 1 / length)

    def reach(self) -> float:
        return self.length

    def faults(self, path: str) -> Iterator[Fault]:
        if not self.length > 0:
            yield Fault(f"{path}.length", self.length, "a length above 0 (a revolute joint keeps two points together)")

    @staticmethod
    def residual(g: Any, f: Any, i: BodyValues, j: BodyValues) -> Rows:
        _, _, d = arms(g, i, j)
        return ((d.dot(d) - g[4] * g[4]) * g[5] * 0.5,)

    @staticmethod
    def jacobian(g: Any, f: Any, i: BodyValues, j: BodyValues) -> Blocks:
        a_i, a_j, d = arms(g, i, j)
        block_i, block_j = along(d * g[5], a_i, a_j)
        return (block_i,), (block_j,)

    @staticmethod
    def gamma(g: Any, f: Any, i: BodyValues, j: BodyValues) -> Rows:
        a_i, a_j, d = arms(g, i, j)
        rate = gap_rate(a_i, a_j, i, j)
        return ((rate.dot(rate) + d.dot(drift(a_i, a_j, i, j))) * -g[5],)


PLANAR_TYPES: tuple[type[Constraint], ...] = (Revolute, Fixed, PointOnLine, Prismatic, Distance)


def ends_of(c: Any) -> dict[str, Any]:
    """Return bodies and points of a joint, by the names that elements have for them too."""
    return {key: getattr(c, key) for key in ("body_i", "point_i", "body_j", "point_j")}


def direction(axis: Pair) -> Pair:
    """Return the axis scaled to length 1."""
    square = axis[0] * axis[0] + axis[1] * axis[1]
    length = square.sqrt() if hasattr(square, "sqrt") else math.hypot(*axis)  # balls bring their own root
    return axis[0] / length, axis[1] / length


def unit_normal(axis: Pair) -> Pair:
    """Return the axis turned by a quarter turn counter-clockwise, scaled to length 1."""
    x, y = direction(axis)
    return -y, x


def axis_faults(path: str, axis: Pair) -> Iterator[Fault]:
    """Yield a fault if an axis has no direction."""
    if math.hypot(*axis) == 0.0:
        yield Fault(f"{path}.axis_i", list(axis), "a vector that is not zero")
