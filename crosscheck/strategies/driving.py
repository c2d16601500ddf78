"""What a driver holds: the input itself, or a coordinate of a pin that goes one way while the input does."""

from __future__ import annotations

import cmath
import math
from dataclasses import dataclass, replace

from crosscheck.strategies.linkages import AnyLinkage
from crosscheck.strategies.variety import Model
from refkin.joints import GROUND, AngleDriver, DistanceDriver, Driver, Pair, XDriver, YDriver
from refkin.motion_laws import Integral, Law, Polynomial, Sinusoid, Table
from refkin.scenes.linkages import SliderCrank, law_keys

WIDEST = 1.0
"""Largest range of the crank [rad] over which a coordinate of its pin is driven, so that it stays off its extremes."""


class Drive:
    """How an input is held: `to` gives the driven coordinate at an input, `back` the input at a coordinate."""

    def to(self, value: float) -> float:
        return value

    def back(self, coordinate: float) -> float:
        return coordinate

    def driver(self, model: Model, pair: tuple[str, str], law: Law, turned: float) -> Driver:
        """Return the driver of the pair (driven, relative_to) in a model whose frames turn their angle by `turned`."""
        return AngleDriver(name="driver", body=pair[0], relative_to=pair[1], **law_keys(moved(law, turned)))


@dataclass(frozen=True)
class Coordinate(Drive):
    """x or y, by the angle of `axis` (0 or pi/2), of a pin."""

    pin: str
    axis: float

    def driver(self, model: Model, pair: tuple[str, str], law: Law, turned: float) -> Driver:
        body, point = model.pins[self.pin]
        return (YDriver if self.axis else XDriver)(name="driver", body=body, point=point, **law_keys(law))


@dataclass(frozen=True)
class CircleCoordinate(Coordinate):
    """Of a pin on a circle: p + radius cos(phi - axis), for phi near `middle`."""

    pivot: float
    radius: float
    middle: float

    def to(self, value: float) -> float:
        return self.pivot + self.radius * math.cos(value - self.axis)

    def back(self, coordinate: float) -> float:
        corner = math.acos((coordinate - self.pivot) / self.radius)
        return nearest(self.middle, self.axis + corner, self.axis - corner)


@dataclass(frozen=True)
class LineCoordinate(Coordinate):
    """Of a pin on a line: foot + slope * position."""

    foot: float
    slope: float

    def to(self, value: float) -> float:
        return self.foot + self.slope * value

    def back(self, coordinate: float) -> float:
        return (coordinate - self.foot) / self.slope


@dataclass(frozen=True)
class Distance(Drive):
    """The distance of a pin from a ground point, as a hydraulic cylinder sets it."""

    pin: str
    anchor: Pair

    def driver(self, model: Model, pair: tuple[str, str], law: Law, turned: float) -> Driver:
        body, point = model.pins[self.pin]
        ends = {"body_i": GROUND, "point_i": self.anchor, "body_j": body, "point_j": point}
        return DistanceDriver(name="driver", **ends, **law_keys(law))  # type: ignore[arg-type]


@dataclass(frozen=True)
class CircleDistance(Distance):
    """Of a pin on a circle from a point 2 radii from its centre, a quarter turn ahead of the pin at `middle`."""

    radius: float
    middle: float

    def to(self, value: float) -> float:
        return self.radius * abs(2 - cmath.rect(1.0, value - self.middle - math.pi / 2))

    def back(self, coordinate: float) -> float:
        corner = math.acos((5 - (coordinate / self.radius) ** 2) / 4)
        return self.middle + math.pi / 2 - corner


@dataclass(frozen=True)
class LineDistance(Distance):
    """Of a pin on a line from a point at `behind` along the line and `aside` from it."""

    behind: float
    aside: float

    def to(self, value: float) -> float:
        return math.hypot(value - self.behind, self.aside)

    def back(self, coordinate: float) -> float:
        return self.behind + math.sqrt(coordinate**2 - self.aside**2)


def crank_drive(linkage: AnyLinkage, kind: str, middle: float) -> Drive:
    """Return the drive of a crank by its angle, or by x, y (whichever changes faster) or a distance of its pin."""
    radius = linkage.crank
    if kind == "coordinate":
        is_x = abs(math.sin(middle)) >= abs(math.cos(middle))
        axis, pivot = (0.0, linkage.origin[0]) if is_x else (math.pi / 2, linkage.origin[1])
        return CircleCoordinate("crank", axis, pivot, radius, middle)
    if kind == "distance":
        anchor = complex(*linkage.origin) + cmath.rect(2 * radius, middle + math.pi / 2)
        return CircleDistance("crank", (anchor.real, anchor.imag), radius, middle)
    return Drive()


def slider_drive(linkage: SliderCrank, kind: str) -> Drive:
    """Return the drive of a slider by x or y (whichever changes faster) or a distance of the wrist pin."""
    if kind == "distance":
        behind, aside = -1.5 * (linkage.crank + linkage.rod), linkage.crank
        return LineDistance("slider", linkage.place(complex(behind, linkage.offset + aside)), behind, aside)
    x, y = linkage.place(complex(0.0, linkage.offset))
    cosine, sine = math.cos(linkage.angle), math.sin(linkage.angle)
    if abs(cosine) >= abs(sine):
        return LineCoordinate("slider", 0.0, x, cosine)
    return LineCoordinate("slider", math.pi / 2, y, sine)


def moved(law: Law, by: float) -> Law:
    """Return the law plus a constant."""
    if isinstance(law, Integral):
        return replace(law, initial=law.initial + by)
    if isinstance(law, Polynomial):
        return replace(law, coefficients=(law.coefficients[0] + by, *law.coefficients[1:]))
    if isinstance(law, Sinusoid):
        return replace(law, offset=law.offset + by)
    assert isinstance(law, Table)
    return replace(law, value=tuple(v + by for v in law.value))


def nearest(middle: float, *angles: float) -> float:
    """Return the one of the angles, full turns added, that is nearest to `middle`."""
    turned = (angle + math.tau * round((middle - angle) / math.tau) for angle in angles)
    return min(turned, key=lambda angle: abs(angle - middle))
