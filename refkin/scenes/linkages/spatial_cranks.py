"""Crank and rocker, or slider, in space: RSSR, a chain of them, RSSP, RSCR.

Letters name the joints from the ground to the ground: R revolute, S spherical, P prismatic, C cylindrical. Bodies are
placed in closed form: circle against sphere (RSSR), line against sphere (RSSP), circle against circle (RSCR).
"""

from __future__ import annotations

import math
from collections.abc import Iterator
from dataclasses import dataclass
from itertools import pairwise
from numbers import Integral
from typing import Any

from refkin.errors import Fault
from refkin.joints import GROUND, Constraint, Cylindrical, SpatialDistance, SpatialPrismatic, Triple
from refkin.joints.annotations import is_flag
from refkin.joints.spatial_frames import frame, unit_vector
from refkin.joints.spatial_vectors import Vec3
from refkin.scenes.linkages.closures import DoesNotAssemble
from refkin.scenes.linkages.spatial_base import AT, Place, SpatialLinkage, X, Y, Z, pose_of, revolute, spherical, turned

Frame = tuple[Vec3, Vec3, Vec3, Vec3]
GROUND_FRAME: Frame = (Vec3(*AT), Vec3(*X), Vec3(*Y), Vec3(*Z))
"""An origin and three axes."""


def of_frame(at: Frame, v: Vec3) -> Vec3:
    """Return a vector that a frame has, in the frame that the frame is given in."""
    of_ground: Vec3 = at[1] * v.x + at[2] * v.y + at[3] * v.z
    return of_ground


@dataclass(frozen=True)
class CrankRocker(SpatialLinkage):
    """A crank about the z axis, and a rocker about an axis anywhere whose end a coupler holds."""

    crank: float
    coupler: float
    rocker: float
    pivot: Triple
    axis: Triple
    LENGTHS = ("crank", "coupler", "rocker")

    def _rocker(self, value: float, sign: int, p: float, q: float, square: float) -> float:
        """Return the rocker's angle: a point is at p, q from its zero, and from its pivot the root of a square away."""
        r, across = self.rocker, math.hypot(p, q)
        near, far = (math.sqrt(max(0.0, square + r * r + side * 2 * r * across)) for side in (-1, 1))
        reach, gap = (square + r * r - self.coupler**2) / (2 * r), max(near - self.coupler, self.coupler - far)
        return math.atan2(q, p) + sign * self._cosine(value, reach / across if across else reach * math.inf, gap)


@dataclass(frozen=True)
class RSSR(CrankRocker):
    """A crank about the z axis of the ground, a coupler on two spherical joints, a rocker about an axis anywhere.

    Attributes
    ----------
    crank, coupler, rocker : float
        Lengths [m]; the crank turns about the origin, from the ground's x axis.
    pivot, axis : triple of float
        A point of the rocker's axis, which its spherical joint turns in a plane through, and its direction.
    massless : bool
        Whether the coupler is a distance joint, and no body.
    """

    massless: bool = False

    def joints(self) -> tuple[Constraint, ...]:
        """Return R1, S1 and S2 (the distance L if the coupler is massless), R2."""
        inner, outer = (self.crank, 0.0, 0.0), (self.rocker, 0.0, 0.0)
        f, _, _ = frame(self.axis, None)
        ends: dict[str, Any] = {"body_i": "crank", "point_i": inner, "body_j": "rocker", "point_j": outer}
        coupler: tuple[Constraint, ...] = (SpatialDistance(name="L", length=self.coupler, **ends),)
        if not self.massless:
            coupler = (
                spherical("S1", "crank", inner, "coupler", AT),
                spherical("S2", "coupler", (self.coupler, 0.0, 0.0), "rocker", outer),
            )
        return (
            revolute("R1", GROUND, AT, Z, X, "crank", form=self.form),
            *coupler,
            revolute("R2", GROUND, self.pivot, self.axis, f.parts, "rocker", form=self.form),
        )

    def output(self, value: float, sign: int) -> float:
        """Return the rocker's angle [rad] at an input, from the zero of `R2`."""
        f, g, _ = frame(self.axis, None)
        w = turned(Vec3(*X), Vec3(*Y), value) * self.crank - Vec3(*self.pivot)
        return self._rocker(value, sign, w.dot(f), w.dot(g), w.dot(w))

    def _poses(self, value: float, sign: int) -> Iterator[tuple[str, Place]]:
        f, g, h = frame(self.axis, None)
        x, arm = turned(Vec3(*X), Vec3(*Y), value), turned(f, g, self.output(value, sign))
        inner, outer = x * self.crank, Vec3(*self.pivot) + arm * self.rocker
        yield "crank", pose_of(Vec3(*AT), x, Vec3(*Z))
        if not self.massless:
            rod = unit_vector((outer - inner).parts)
            yield "coupler", pose_of(inner, rod, frame(rod.parts, None)[0])
        yield "rocker", pose_of(Vec3(*self.pivot), arm, h)


@dataclass(frozen=True)
class RSSRChain(SpatialLinkage):
    """Copies of an RSSR one after another: the rocker of each is the crank of the next."""

    first: RSSR
    count: int

    def _faults(self) -> Iterator[Fault]:
        yield from super()._faults()
        if not isinstance(self.first, RSSR) or self.first.massless:
            yield Fault("first", self.first, "an RSSR with a coupler that is a body")
        if is_flag(self.count) or not (isinstance(self.count, Integral) and self.count > 0):
            yield Fault("count", self.count, "a whole number above 0")

    def _frames(self) -> Iterator[Frame]:
        """Yield the frames in which each copy stands: z along its crank's axis."""
        at, own = GROUND_FRAME, frame(self.first.axis, None)
        for _ in range(self.count + 1):
            yield at
            f, g, h = (of_frame(at, v) for v in own)
            at = (at[0] + of_frame(at, Vec3(*self.first.pivot)), f, g, h)

    def joints(self) -> tuple[Constraint, ...]:
        """Return R1, then A, B and R of each copy, numbered."""
        one = self.first
        joints: list[Constraint] = [revolute("R1", GROUND, AT, Z, X, "rocker0", form=self.form)]
        for k, (origin, f, _, h) in enumerate(list(self._frames())[1:], 1):
            inner, coupler, outer = f"rocker{k - 1}", f"coupler{k}", f"rocker{k}"
            joints += [
                spherical(f"A{k}", inner, (one.crank, 0.0, 0.0), coupler, AT),
                spherical(f"B{k}", coupler, (one.coupler, 0.0, 0.0), outer, (one.rocker, 0.0, 0.0)),
                revolute(f"R{k + 1}", GROUND, origin.parts, h.parts, f.parts, outer, form=self.form),
            ]
        return tuple(joints)

    def _poses(self, value: float, sign: int) -> Iterator[tuple[str, Place]]:
        one, arm = self.first, turned(Vec3(*X), Vec3(*Y), value)
        yield "rocker0", pose_of(Vec3(*AT), arm, Vec3(*Z))
        frames = list(self._frames())
        for k, (before, after) in enumerate(pairwise(frames), 1):
            inner = before[0] + arm * one.crank
            value = one.output(value, sign)
            arm = turned(after[1], after[2], value)
            rod = unit_vector((after[0] + arm * one.rocker - inner).parts)
            yield f"coupler{k}", pose_of(inner, rod, frame(rod.parts, None)[0])
            yield f"rocker{k}", pose_of(after[0], arm, after[3])


@dataclass(frozen=True)
class RSSP(SpatialLinkage):
    """The spatial slider-crank: a crank about the z axis, a rod on two spherical joints, a slider along a line.

    `guide` is a point of the line and `axis` its direction. OPEN is the pose further along it.
    """

    crank: float
    rod: float
    guide: Triple
    axis: Triple
    LENGTHS = ("crank", "rod")

    def joints(self) -> tuple[Constraint, ...]:
        """Return R1, S1, S2 and the slide P."""
        f, _, _ = frame(self.axis, None)
        line: dict[str, Any] = {"point_i": self.guide, "axis_i": self.axis, "zero_i": f.parts}
        own: dict[str, Any] = {"body_j": "slider", "point_j": AT, "axis_j": Z, "zero_j": X}
        return (
            revolute("R1", GROUND, AT, Z, X, "crank", form=self.form),
            spherical("S1", "crank", (self.crank, 0.0, 0.0), "rod", AT),
            spherical("S2", "rod", (self.rod, 0.0, 0.0), "slider", AT),
            SpatialPrismatic(name="P", body_i=GROUND, **line, **own, form=self.form),
        )

    def _poses(self, value: float, sign: int) -> Iterator[tuple[str, Place]]:
        f, _, h = frame(self.axis, None)
        x = turned(Vec3(*X), Vec3(*Y), value)
        inner = x * self.crank
        w = inner - Vec3(*self.guide)
        ahead = w.dot(h)
        left = w - h * ahead
        half = self.rod**2 - left.dot(left)
        if half < -(2.0**-44) * self.rod**2:
            raise DoesNotAssemble(self, self.DRIVEN, value, math.hypot(*left.parts) - self.rod)
        pin = Vec3(*self.guide) + h * (ahead + sign * math.sqrt(max(half, 0.0)))
        rod = unit_vector((pin - inner).parts)
        yield "crank", pose_of(Vec3(*AT), x, Vec3(*Z))
        yield "rod", pose_of(inner, rod, frame(rod.parts, None)[0])
        yield "slider", pose_of(pin, f, h)


@dataclass(frozen=True)
class RSCR(CrankRocker):
    """A crank about the z axis, a coupler on a spherical and a cylindrical joint, a rocker that bears the latter.

    The cylindrical joint is parallel to the rocker's axis, `rocker` away from it; the spherical joint is `coupler` away
    from the cylindrical one. So seen along that axis, it is circle against circle.
    """

    def joints(self) -> tuple[Constraint, ...]:
        """Return R1, S, C, R2."""
        f, _, _ = frame(self.axis, None)
        line: dict[str, Any] = {"axis_i": Z, "zero_i": X, "axis_j": Z, "zero_j": X}
        ends: dict[str, Any] = {"body_i": "rocker", "point_i": (self.rocker, 0.0, 0.0), "body_j": "coupler"}
        return (
            revolute("R1", GROUND, AT, Z, X, "crank", form=self.form),
            spherical("S", "crank", (self.crank, 0.0, 0.0), "coupler", (self.coupler, 0.0, 0.0)),
            Cylindrical(name="C", **ends, point_j=AT, **line, form=self.form),
            revolute("R2", GROUND, self.pivot, self.axis, f.parts, "rocker", form=self.form),
        )

    def _poses(self, value: float, sign: int) -> Iterator[tuple[str, Place]]:
        f, g, h = frame(self.axis, None)
        x = turned(Vec3(*X), Vec3(*Y), value)
        inner = x * self.crank
        w = inner - Vec3(*self.pivot)
        p, q = w.dot(f), w.dot(g)
        arm = turned(f, g, self._rocker(value, sign, p, q, p * p + q * q))
        origin = Vec3(*self.pivot) + arm * self.rocker + h * w.dot(h)
        towards = unit_vector((inner - origin).parts)
        yield "crank", pose_of(Vec3(*AT), x, Vec3(*Z))
        yield "coupler", pose_of(origin, towards, h)
        yield "rocker", pose_of(Vec3(*self.pivot), arm, h)
