"""The drivers: what prescribes motion. angle, x, y, distance; each by a law, or by the rate of one.

`law` gives the value, `rate_law` the rate, with `initial` the value at t = 0 (Shabana: theta - theta_0 - g(t) = 0, g
the integral of the rate). A driving constraint is a constraint like any other whose nu holds f' and whose gamma f''.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from functools import cached_property
from typing import Any, Literal

from refkin.errors import Fault
from refkin.joints.base import Blocks, Constraint, Rows, Unit, along, arms, drift, gap_rate
from refkin.joints.elements import GROUND, Element, Pair, PointCoordinate, PointDistance, RelativeAngle
from refkin.joints.planar import BetweenPoints, ends_of
from refkin.motion_laws import AnyLaw, Integral, Law
from refkin.vec import BodyValues, Vec


@dataclass(frozen=True, kw_only=True)
class Driver(Constraint):
    """A constraint of one row that follows a law of time; a law that is an `Integral` is the `rate_law` that it is of.

    So there is one way to say a rate: that of scene files.
    """

    rows = 1
    law: AnyLaw | None = None
    rate_law: AnyLaw | None = None
    initial: float = 0.0

    def __post_init__(self) -> None:
        if isinstance(self.law, Integral) and self.rate_law is None and self.initial == 0.0:
            for key, value in (("law", None), ("rate_law", self.law.rate), ("initial", self.law.initial)):
                object.__setattr__(self, key, value)

    @property
    def laws(self) -> tuple[Law, ...]:
        return self._laws

    @cached_property
    def _laws(self) -> tuple[Law, ...]:
        if self.law is not None:
            return (self.law,)
        return () if self.rate_law is None else (Integral(rate=self.rate_law, initial=self.initial),)

    @property
    def law_keys(self) -> tuple[str, ...]:
        return (("law" if self.law is not None else "rate_law"),) * len(self.laws)

    def faults(self, path: str) -> Iterator[Fault]:
        if (self.law is None) == (self.rate_law is None):
            yield Fault(f"{path}.law", None, "either `law` or `rate_law`, one of the two")
        elif self.law is not None and self.initial != 0.0:
            yield Fault(f"{path}.initial", self.initial, "`initial` only beside `rate_law`")
        yield from super().faults(path)


@dataclass(frozen=True, kw_only=True)
class AngleDriver(Driver):
    """The angle of a body, absolute or against another body: phi - phi_relative_to - f(t) = 0 (J14) [rad]."""

    body: str
    relative_to: str = GROUND
    type: Literal["angle"] = "angle"
    law_is_angle = True

    @property
    def bodies(self) -> tuple[str, str]:
        return self.relative_to, self.body

    def elements(self) -> Iterator[Element]:
        yield RelativeAngle(body_i=self.relative_to, body_j=self.body, laws=self.laws)

    @staticmethod
    def residual(g: Any, f: Any, i: BodyValues, j: BodyValues) -> Rows:
        return (j.phi - i.phi - f[0][0],)

    @staticmethod
    def jacobian(g: Any, f: Any, i: BodyValues, j: BodyValues) -> Blocks:
        return ((0, 0, -1),), ((0, 0, 1),)

    @staticmethod
    def nu(g: Any, f: Any, i: BodyValues, j: BodyValues) -> Rows:
        return (f[0][1],)

    @staticmethod
    def gamma(g: Any, f: Any, i: BodyValues, j: BodyValues) -> Rows:
        return (f[0][2],)


@dataclass(frozen=True, kw_only=True)
class CoordinateDriver(Driver):
    """A coordinate (0: x, 1: y) of a point of a body in the ground frame follows f(t): (r + A u) . e - f = 0 (J15)."""

    body: str
    point: Pair = (0.0, 0.0)
    axis = 0

    @property
    def bodies(self) -> tuple[str, str]:
        return GROUND, self.body

    def points(self) -> Iterator[tuple[str, Pair]]:
        yield self.body, self.point

    def elements(self) -> Iterator[Element]:
        yield PointCoordinate(body_j=self.body, point_j=self.point, axis=self.axis, laws=self.laws)

    def law_scale(self, unit: Unit) -> tuple[tuple[float, ...], float]:
        return (unit.origin[self.axis],), unit.size

    def residual(self, g: Any, f: Any, i: BodyValues, j: BodyValues) -> Rows:  # type: ignore[override]
        return ((j.r + j.turned(Vec(g[0], g[1]))).parts[self.axis] - f[0][0],)

    def jacobian(self, g: Any, f: Any, i: BodyValues, j: BodyValues) -> Blocks:  # type: ignore[override]
        e = (1, 0) if self.axis == 0 else (0, 1)
        return ((0, 0, 0),), ((*e, j.turned(Vec(g[0], g[1])).perp().parts[self.axis]),)

    @staticmethod
    def nu(g: Any, f: Any, i: BodyValues, j: BodyValues) -> Rows:
        return (f[0][1],)

    def gamma(self, g: Any, f: Any, i: BodyValues, j: BodyValues) -> Rows:  # type: ignore[override]
        return (j.turned(Vec(g[0], g[1])).parts[self.axis] * (j.omega * j.omega) + f[0][2],)


@dataclass(frozen=True, kw_only=True)
class XDriver(CoordinateDriver):
    """x + (A point)_x - f(t) = 0 [m]."""

    type: Literal["x"] = "x"


@dataclass(frozen=True, kw_only=True)
class YDriver(CoordinateDriver):
    """y + (A point)_y - f(t) = 0 [m]."""

    type: Literal["y"] = "y"
    axis = 1


@dataclass(frozen=True, kw_only=True)
class DistanceDriver(Driver, BetweenPoints):
    """The distance of two points follows |f(t)| [m], as a hydraulic cylinder does: (d . d - f^2) / 2 = 0 (J16)."""

    type: Literal["distance"] = "distance"

    def elements(self) -> Iterator[Element]:
        yield PointDistance(**ends_of(self), laws=self.laws)

    @staticmethod
    def residual(g: Any, f: Any, i: BodyValues, j: BodyValues) -> Rows:
        _, _, d = arms(g, i, j)
        return ((d.dot(d) - f[0][0] * f[0][0]) * 0.5,)

    @staticmethod
    def jacobian(g: Any, f: Any, i: BodyValues, j: BodyValues) -> Blocks:
        a_i, a_j, d = arms(g, i, j)
        block_i, block_j = along(d, a_i, a_j)
        return (block_i,), (block_j,)

    @staticmethod
    def nu(g: Any, f: Any, i: BodyValues, j: BodyValues) -> Rows:
        return (f[0][0] * f[0][1],)

    @staticmethod
    def gamma(g: Any, f: Any, i: BodyValues, j: BodyValues) -> Rows:
        a_i, a_j, d = arms(g, i, j)
        rate = gap_rate(a_i, a_j, i, j)
        moving = f[0][1] * f[0][1] + f[0][0] * f[0][2]
        return (moving - rate.dot(rate) - d.dot(drift(a_i, a_j, i, j)),)


DRIVER_TYPES: tuple[type[Driver], ...] = (AngleDriver, XDriver, YDriver, DistanceDriver)
