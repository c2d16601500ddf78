"""The joints that roll without slip: gear, rack_and_pinion (Shabana, Computational Dynamics, section 3.9)."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from typing import Any, Literal

from refkin.errors import Fault
from refkin.joints.base import Blocks, Constraint, Rows, Unit
from refkin.joints.elements import GROUND, Element, Pair, RollingOnLine, RollingWheels
from refkin.joints.planar import BetweenPoints, PointOnLine, axis_faults, direction, ends_of
from refkin.vec import BodyValues


@dataclass(frozen=True, kw_only=True)
class Gear(Constraint):
    """Two wheels roll on each other: radius_i (phi_i - phi_c - phi0_i) + radius_j (phi_j - phi_c - phi0_j) = 0 (J8).

    Both angles count against body c, the carrier, on which both centres are at rest: the ground, or the arm of a
    planetary gear. Nothing asks where the centres are: only the ratio of radii matters; opposite signs are an internal
    gear, or a belt. Source: (theta^i - theta^i_o) a^i + (theta^j - theta^j_o) a^j = 0.
    """

    rows = 1
    body_i: str
    radius_i: float
    body_j: str
    radius_j: float
    phi0_i: float = 0.0
    phi0_j: float = 0.0
    carrier: str = GROUND
    type: Literal["gear"] = "gear"

    def elements(self) -> Iterator[Element]:
        yield RollingWheels(
            body_i=self.body_i, radius_i=self.radius_i, zero_i=self.phi0_i,
            body_j=self.body_j, radius_j=self.radius_j, zero_j=self.phi0_j, carrier=self.carrier,
        )  # fmt: skip

    def reach(self) -> float:
        return max(abs(self.radius_i), abs(self.radius_j))

    def constants(self, unit: Unit) -> tuple[float, ...]:
        return self.radius_i / unit.size, self.radius_j / unit.size, self.phi0_i, self.phi0_j

    def faults(self, path: str) -> Iterator[Fault]:
        for key in ("radius_i", "radius_j"):
            if getattr(self, key) == 0.0:
                yield Fault(f"{path}.{key}", 0.0, "a radius that is not zero")
        if self.carrier != GROUND and self.carrier in (self.body_i, self.body_j):
            yield Fault(f"{path}.carrier", self.carrier, "a body other than the two wheels")

    @staticmethod
    def residual(g: Any, f: Any, i: BodyValues, j: BodyValues, carrier: BodyValues) -> Rows:  # type: ignore[override]
        return ((i.phi - carrier.phi - g[2]) * g[0] + (j.phi - carrier.phi - g[3]) * g[1],)

    @staticmethod
    def jacobian(g: Any, f: Any, i: BodyValues, j: BodyValues, carrier: BodyValues) -> Blocks:  # type: ignore[override]
        return ((0, 0, g[0]),), ((0, 0, g[1]),), ((0, 0, -(g[0] + g[1])),)

    @staticmethod
    def gamma(g: Any, f: Any, *bodies: BodyValues) -> Rows:
        return (0,)


@dataclass(frozen=True, kw_only=True)
class RackAndPinion(BetweenPoints):
    """A wheel rolls on a straight rack: axis_i . d - s0 - radius (phi_j - phi_i - phi0) = 0 (J9).

    Body i is the rack, and carries the axis (in its own frame, of any length); body j is the pinion, with its centre at
    point_j. So axis_i . d says how far along the rack the pinion's centre is. The radius is positive for a pinion that
    lies to the right of the axis, negative to the left; the distance of its centre from the rack is held by other
    joints. The pinion's angle counts against the rack, which may itself turn. Source: that of gears, one arc unrolled.
    """

    rows = 1
    axis_i: Pair
    radius: float
    phi0: float = 0.0
    s0: float = 0.0
    type: Literal["rack_and_pinion"] = "rack_and_pinion"

    def elements(self) -> Iterator[Element]:
        yield RollingOnLine(**ends_of(self), axis_i=self.axis_i, radius=self.radius, phi0=self.phi0, s0=self.s0)

    def reach(self) -> float:
        return abs(self.radius)

    def constants(self, unit: Unit) -> tuple[float, ...]:
        lengths = self.radius / unit.size, self.s0 / unit.size
        return (*super().constants(unit), *direction(self.axis_i), *lengths, self.phi0)

    def faults(self, path: str) -> Iterator[Fault]:
        yield from axis_faults(path, self.axis_i)
        if self.radius == 0.0:
            yield Fault(f"{path}.radius", 0.0, "a radius that is not zero")

    @staticmethod
    def residual(g: Any, f: Any, i: BodyValues, j: BodyValues) -> Rows:
        (travel,) = PointOnLine.residual(g, f, i, j)  # n . d with n along the rack
        return (travel - g[7] - (j.phi - i.phi - g[8]) * g[6],)

    @staticmethod
    def jacobian(g: Any, f: Any, i: BodyValues, j: BodyValues) -> Blocks:
        ((x_i, y_i, phi_i),), ((x_j, y_j, phi_j),) = PointOnLine.jacobian(g, f, i, j)
        return ((x_i, y_i, phi_i + g[6]),), ((x_j, y_j, phi_j - g[6]),)

    gamma = staticmethod(PointOnLine.gamma)
