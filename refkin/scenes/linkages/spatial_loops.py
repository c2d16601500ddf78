"""Spatial loops of few numbers: Bennett, Bricard, Hooke and double Hooke joint; screw jack and Stewart platform.

Bodies are placed by the published loop equations of Bennett's and Bricard's linkages (Bennett 1903; Chen, You and
Tarnai, Int. J. Solids and Structures 42, 2005), and by the pins of a Hooke joint, which are across both shafts.
"""

from __future__ import annotations

import math
from collections.abc import Iterator
from dataclasses import dataclass
from typing import Any

from refkin.errors import Fault, InvalidScene
from refkin.joints import (
    GROUND,
    Constraint,
    Cylindrical,
    Driver,
    PointOnPlane,
    Screw,
    SpatialDistanceDriver,
    SpatialPrismatic,
    Triple,
    Universal,
)
from refkin.joints.annotations import plain
from refkin.joints.spatial_bodies import with_unit_length
from refkin.joints.spatial_frames import unit_vector
from refkin.joints.spatial_vectors import Quaternion, Vec3
from refkin.motion_laws import Law, Polynomial, Sinusoid
from refkin.scenes.linkages.spatial_base import AT, Place, SpatialLinkage, X, Y, Z, pose_of, revolute, turned


@dataclass(frozen=True)
class Loop(SpatialLinkage):
    """A single loop of revolute joints by the lengths, twists and angles of Denavit and Hartenberg, without offsets.

    From one joint's axis (z) to the next it is turned by the joint's angle about z, shifted along x, twisted about x.
    The ground bears the first axis as its z axis, and the last joint.
    """

    @property
    def links(self) -> tuple[tuple[float, float], ...]:
        """Length [m] and twist [rad] of each link, that of the ground last."""
        raise NotImplementedError

    def angles(self, value: float, sign: int) -> tuple[float, ...]:
        """Return the angle of each joint at an input [rad]."""
        raise NotImplementedError

    def joints(self) -> tuple[Constraint, ...]:
        """Return the hinges R1, R2 ... around the loop, the last one on the ground."""
        hinges, i, point, axis = [], GROUND, AT, Z
        *moving, (length, twist) = self.links
        for k, (a, t) in enumerate(moving, 1):
            hinges.append(revolute(f"R{k}", i, point, axis, X, f"link{k}", form=self.form))
            i, point, axis = f"link{k}", (a, 0.0, 0.0), (0.0, -math.sin(t), math.cos(t))
        back: dict[str, Any] = {"point_j": (-length, 0.0, 0.0), "axis_j": (0.0, math.sin(twist), math.cos(twist))}
        hinges.append(revolute(f"R{len(self.links)}", i, point, axis, X, GROUND, **back, form=self.form))
        return tuple(hinges)

    def _poses(self, value: float, sign: int) -> Iterator[tuple[str, Place]]:
        r, f, g, h = (Vec3(*v) for v in (AT, X, Y, Z))
        angles = self.angles(value, sign)
        for k, ((length, twist), angle) in enumerate(zip(self.links[:-1], angles, strict=False), 1):
            f, g = turned(f, g, angle), turned(g, -f, angle)
            yield f"link{k}", pose_of(r, f, h)
            r = r + f * length
            g, h = turned(g, h, twist), turned(h, -g, twist)


@dataclass(frozen=True)
class Bennett(Loop):
    """Bennett's linkage: four revolutes, opposite links alike, length / sin(twist) the same for all; mobility 1 not -2.

    `length` [m] and the two twists [rad]: the second length follows from them.
    """

    length: float
    alpha: float
    beta: float
    LENGTHS = ("length",)

    def _faults(self) -> Iterator[Fault]:
        yield from (wrong := list(super()._faults()))
        if not wrong and not math.sin(self.alpha) * math.sin((self.beta - self.alpha) / 2):
            yield Fault("alpha", self.alpha, f"a twist [rad] that is neither 0 nor beta = {self.beta}")

    @property
    def links(self) -> tuple[tuple[float, float], ...]:
        other = self.length * math.sin(self.beta) / math.sin(self.alpha)
        return ((self.length, self.alpha), (other, self.beta)) * 2

    def angles(self, value: float, sign: int) -> tuple[float, ...]:
        ratio = math.sin((self.beta + self.alpha) / 2) / math.sin((self.beta - self.alpha) / 2)
        second = 2 * math.atan2(ratio * math.cos(value / 2), math.sin(value / 2))
        return value, second, -value, -second


@dataclass(frozen=True)
class Bricard(Loop):
    """Bricard's threefold symmetric linkage: six revolutes, links alike, twists `alpha` and -`alpha` by turns."""

    length: float
    alpha: float
    LENGTHS = ("length",)

    @property
    def links(self) -> tuple[tuple[float, float], ...]:
        return ((self.length, self.alpha), (self.length, -self.alpha)) * 3

    def angles(self, value: float, sign: int) -> tuple[float, ...]:
        c, s = math.cos(self.alpha), math.sin(self.alpha)
        a = s * s + (1 + c * c) * math.cos(value)
        b = -2 * c * math.sin(value)
        other = math.atan2(b, a) + sign * self._cosine(value, -(c * c + s * s * math.cos(value)) / math.hypot(a, b))
        return (value, other) * 3


@dataclass(frozen=True)
class Hooke(SpatialLinkage):
    """A Hooke joint between two shafts whose axes meet at an angle `beta` [rad]; mobility 1, not -2.

    tan(output) = tan(input) / cos(beta), up to the zeros.
    """

    beta: float

    def joints(self) -> tuple[Constraint, ...]:
        """Return R1, the Hooke joint U, R2."""
        axis = (0.0, -math.sin(self.beta), math.cos(self.beta))
        ends: dict[str, Any] = {"body_i": "input", "point_i": AT, "body_j": "output", "point_j": AT}
        return (
            revolute("R1", GROUND, AT, Z, X, "input", form=self.form),
            Universal(name="U", **ends, axis_i=X, axis_j=Y),
            revolute("R2", GROUND, AT, axis, X, "output", form=self.form),
        )

    def _poses(self, value: float, sign: int) -> Iterator[tuple[str, Place]]:
        pin = turned(Vec3(*X), Vec3(*Y), value)
        axis = Vec3(0.0, -math.sin(self.beta), math.cos(self.beta))
        f = unit_vector((pin.cross(axis).cross(axis) * -1.0).parts)  # the output's y axis is across both pin and axis
        yield "input", pose_of(Vec3(*AT), pin, Vec3(*Z))
        yield "output", pose_of(Vec3(*AT), f, axis)


@dataclass(frozen=True)
class DoubleHooke(SpatialLinkage):
    """Two Hooke joints, R-U-U-C: the middle shaft makes `beta` [rad] with either end, in one plane (Z or W).

    With matched forks (`phase` 0) the output turns as the input does. `length` [m] is that of the middle shaft.
    """

    beta: float
    length: float = 1.0
    parallel: bool = True
    phase: float = 0.0
    LENGTHS = ("length",)

    @property
    def _axes(self) -> tuple[Vec3, Vec3]:
        """The axes of the middle shaft and of the output."""
        last = 0.0 if self.parallel else 2 * self.beta
        return tuple(Vec3(0.0, -math.sin(b), math.cos(b)) for b in (self.beta, last))  # type: ignore[return-value]

    def joints(self) -> tuple[Constraint, ...]:
        """Return R1, the Hooke joints U1 and U2, and C, which lets the output slide."""
        middle, last = self._axes
        fork = (math.sin(self.phase), math.cos(self.phase), 0.0)
        one: dict[str, Any] = {"body_i": "input", "point_i": AT, "body_j": "shaft", "point_j": AT}
        two: dict[str, Any] = {"body_i": "shaft", "point_i": (0.0, 0.0, self.length), "body_j": "output", "point_j": AT}
        end = (middle * self.length).parts
        line: dict[str, Any] = {"body_i": GROUND, "point_i": end, "axis_i": last.parts, "zero_i": X}
        own: dict[str, Any] = {"body_j": "output", "point_j": AT, "axis_j": Z, "zero_j": X}
        return (
            revolute("R1", GROUND, AT, Z, X, "input", form=self.form),
            Universal(name="U1", **one, axis_i=X, axis_j=Y),
            Universal(name="U2", **two, axis_i=fork, axis_j=X),
            Cylindrical(name="C", **line, **own, form=self.form),
        )

    def _poses(self, value: float, sign: int) -> Iterator[tuple[str, Place]]:
        middle, last = self._axes
        pin = turned(Vec3(*X), Vec3(*Y), value)
        f = unit_vector((pin.cross(middle).cross(middle) * -1.0).parts)
        g = middle.cross(f)
        fork = f * math.sin(self.phase) + g * math.cos(self.phase)
        other = unit_vector(fork.cross(last).parts)
        yield "input", pose_of(Vec3(*AT), pin, Vec3(*Z))
        yield "shaft", pose_of(Vec3(*AT), f, middle)
        yield "output", pose_of(middle * self.length, other, last)


@dataclass(frozen=True)
class ScrewJack(SpatialLinkage):
    """A screw in the ground, driven, lifts a platform that slides along the z axis; `pitch` [m/rad]."""

    pitch: float
    height: float = 1.0
    LENGTHS = ("pitch", "height")
    DRIVEN = "H1"

    def joints(self) -> tuple[Constraint, ...]:
        """Return the screw H1, its tip in the plane of the platform, and the slide P."""
        line: dict[str, Any] = {"axis_i": Z, "zero_i": X, "axis_j": Z, "zero_j": X, "form": self.form}
        side, tip = (0.5 * self.height, 0.0, 0.0), (0.0, 0.0, self.height)
        return (
            Screw(name="H1", body_i=GROUND, point_i=AT, body_j="screw", point_j=AT, **line, pitch=self.pitch),
            PointOnPlane(name="tip", body_i="platform", point_i=AT, axis_i=Z, body_j="screw", point_j=tip),
            SpatialPrismatic(name="P", body_i=GROUND, point_i=side, body_j="platform", point_j=side, **line),
        )

    def _poses(self, value: float, sign: int) -> Iterator[tuple[str, Place]]:
        x, shift = turned(Vec3(*X), Vec3(*Y), value), self.pitch * value
        yield "screw", pose_of(Vec3(0.0, 0.0, shift), x, Vec3(*Z))
        yield "platform", pose_of(Vec3(0.0, 0.0, shift + self.height), Vec3(*X), Vec3(*Z))


@dataclass(frozen=True)
class Stewart(SpatialLinkage):
    """A platform on six legs whose lengths are driven; of its poses there is no closed form: `assemble` says `home`.

    Attributes
    ----------
    base, platform : tuple of six triples of float
        Where the legs stand on the ground, and in the platform's frame.
    home : tuple of seven floats
        The platform's coordinates at which the legs have their middle lengths.
    stroke : float
        How far the legs go out and in [m], each by a sine of the input, a phase [rad] of constant rate.
    """

    base: tuple[Triple, ...]
    platform: tuple[Triple, ...]
    home: tuple[float, ...]
    stroke: float = 0.0

    @classmethod
    def three_three(cls, side: float = 1.0, top: float = 0.6, height: float = 0.8, stroke: float = 0.1) -> Stewart:
        """Return the octahedron: legs from three points of the base to three of the platform, two to each."""
        at = [(math.cos(a), math.sin(a)) for a in (math.tau * k / 6 for k in range(6))]
        base = tuple((side * at[k][0], side * at[k][1], 0.0) for k in (0, 0, 2, 2, 4, 4))
        platform = tuple((top * at[k][0], top * at[k][1], 0.0) for k in (5, 1, 1, 3, 3, 5))
        return cls(base, platform, (0.0, 0.0, height, 1.0, 0.0, 0.0, 0.0), stroke)

    def lengths(self) -> tuple[float, ...]:
        """Return the middle lengths of the legs [m]."""
        p = Quaternion.of(*with_unit_length(plain(self.home))[3:])
        tops = [Vec3(*self.home[:3]) + p.times(Quaternion(0.0, Vec3(*u))).times(p.conj()).v for u in self.platform]
        return tuple(math.hypot(*(a - Vec3(*b)).parts) for a, b in zip(tops, self.base, strict=True))

    def joints(self) -> tuple[Constraint, ...]:
        """Return none: the legs are drivers."""
        return ()

    def drivers(self, law: Law) -> tuple[Driver, ...]:
        """Return the six drivers."""
        if not isinstance(law, Polynomial) or any(law.coefficients[2:]):
            raise InvalidScene([Fault("law", law, "a polynomial of degree 1 at most")], "Stewart")
        start, rate = float(law(0.0)), float(law(0.0, 1))
        ends = zip(self.base, self.platform, self.lengths(), strict=True)
        return tuple(
            SpatialDistanceDriver(
                name=f"leg{k}",
                body_i=GROUND,
                point_i=base,
                body_j="platform",
                point_j=top,
                law=Sinusoid(amplitude=self.stroke, angular_frequency=rate, phase=start + k, offset=length),
            )
            for k, (base, top, length) in enumerate(ends, 1)
        )

    def _poses(self, value: float, sign: int) -> Iterator[tuple[str, Place]]:
        yield "platform", with_unit_length(plain(self.home))
