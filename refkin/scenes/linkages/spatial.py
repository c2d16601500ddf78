"""Spatial linkages by their parameters: RSSR, RSSP, RSCR, Bennett, Bricard, Hooke, double Hooke, screw jack, Stewart.

Letters name the joints from the ground to the ground: R revolute, S spherical, P prismatic, C cylindrical. Each
linkage places its bodies in closed form at an input, for the estimate that a scene starts from: circle against sphere
(RSSR), line against sphere (RSSP), circle against circle (RSCR), the published loop equations of Bennett's and
Bricard's linkages (Bennett 1903; Chen, You and Tarnai, Int. J. Solids and Structures 42, 2005), the pins of a Hooke
joint across both shafts. Solving a scene uses none of this.

Body frames have their z axis along the joint that leads to the body, their origin on it.
"""

from __future__ import annotations

import math
from collections.abc import Collection, Iterator, Sequence
from dataclasses import dataclass
from itertools import pairwise
from typing import Any, ClassVar

from refkin.errors import Fault, InvalidScene
from refkin.joints import (
    GROUND,
    Constraint,
    Cylindrical,
    Driver,
    PointOnPlane,
    Screw,
    SpatialAngleDriver,
    SpatialDistance,
    SpatialDistanceDriver,
    SpatialPrismatic,
    SpatialRevolute,
    Spherical,
    Triple,
    Universal,
)
from refkin.joints.spatial_terms import frame, parameters_of
from refkin.joints.spatial_vectors import Quaternion, Vec3
from refkin.model import Body, Effect, Evidence, Mechanism, Scene
from refkin.motion_laws import Law, Polynomial, Sinusoid
from refkin.output.picture import Picture
from refkin.scenes.linkages.base import Branch, given_law, law_keys, member, pictured, uniform_law
from refkin.scenes.linkages.closures import DoesNotAssemble

X, Y, Z, AT = (1.0, 0.0, 0.0), (0.0, 1.0, 0.0), (0.0, 0.0, 1.0), (0.0, 0.0, 0.0)
Poses = dict[str, tuple[float, ...]]
ROUGH = 9
"""Decimals that an estimate keeps: assemblies that are nearer to each other than that are not told apart."""


def placed(r: Vec3, f: Vec3, h: Vec3) -> tuple[float, ...]:
    """Return the coordinates of a body at r with its x axis along f and its z axis along h."""
    return (*r.parts, *parameters_of(f, h.cross(f), h))


def turned(f: Vec3, g: Vec3, angle: float) -> Vec3:
    """Return f turned towards g."""
    return f * math.cos(angle) + g * math.sin(angle)


def along(v: Vec3) -> tuple[float, Vec3]:
    """Return length and direction of a vector."""
    length = math.hypot(*v.parts)
    return length, v * (1 / length)


Frame = tuple[Vec3, Vec3, Vec3, Vec3]
GROUND_FRAME: Frame = (Vec3(*AT), Vec3(*X), Vec3(*Y), Vec3(*Z))
"""An origin and three axes."""


def of_frame(at: Frame, v: Vec3) -> Vec3:
    """Return a vector that a frame has, in the frame that the frame is given in."""
    of_ground: Vec3 = at[1] * v.x + at[2] * v.y + at[3] * v.z
    return of_ground


def revolute(name: str, i: str, point: Triple, axis: Triple, zero: Triple, j: str, **more: Any) -> SpatialRevolute:
    """Return a revolute joint to a body whose own z axis it is, its angle counted from `zero` to the body's x axis."""
    ends: dict[str, Any] = {"body_i": i, "point_i": point, "axis_i": axis, "zero_i": zero, "body_j": j}
    return SpatialRevolute(name=name, **{**ends, "point_j": AT, "axis_j": Z, "zero_j": X, **more})


def spherical(name: str, i: str, point_i: Triple, j: str, point_j: Triple) -> Spherical:
    """Return a spherical joint."""
    return Spherical(name=name, body_i=i, point_i=point_i, body_j=j, point_j=point_j)


@dataclass(frozen=True, kw_only=True)
class SpatialLinkage:
    """A spatial linkage with one input, the angle of its joint `R1` (of a screw jack `H1`).

    Raises
    ------
    InvalidScene
        If a length is not a finite number above 0.
    """

    form: str = "half"
    LENGTHS: ClassVar[tuple[str, ...]] = ()
    DRIVEN: ClassVar[str] = "R1"

    def __post_init__(self) -> None:
        faults = [
            Fault(key, getattr(self, key), "a length above 0 [m]")
            for key in self.LENGTHS
            if not (math.isfinite(getattr(self, key)) and getattr(self, key) > 0)
        ]
        if faults:
            raise InvalidScene(faults, type(self).__name__)

    def joints(self) -> tuple[Constraint, ...]:
        """Return the joints, without driver."""
        raise NotImplementedError

    def assemble(self, value: float, branch: Branch | str = Branch.OPEN) -> Poses:
        """Return the coordinates of all bodies at an input [rad], in closed form.

        Raises
        ------
        DoesNotAssemble
            With the gap [m], or what of a cosine is beyond 1.
        """
        return dict(self._poses(value, member(Branch, branch, "branch").sign))

    def plot(self, value: float = 0.0, branch: Branch | str = Branch.OPEN) -> Picture:
        """Return a picture of the linkage at an input [rad], by its closed form; a notebook shows it.

        Raises
        ------
        DoesNotAssemble
            As `assemble` does.
        """
        scene = self.scene(law=Polynomial(coefficients=(value,)), times=(0.0,), branch=branch)
        return pictured(scene, self.assemble(value, branch))

    def _repr_svg_(self) -> str | None:
        try:
            return self.plot().svg
        except DoesNotAssemble:
            return None

    def _poses(self, value: float, sign: int) -> Iterator[tuple[str, tuple[float, ...]]]:
        raise NotImplementedError

    def _cosine(self, value: float, x: float) -> float:
        """Return the angle in [0, pi] of a cosine; what rounding leaves beyond 1 counts as 1."""
        if abs(x) > 1 + 2.0**-44:
            raise DoesNotAssemble(self, self.DRIVEN, value, abs(x) - 1)
        return math.acos(max(-1.0, min(1.0, x)))

    def drivers(self, law: Law) -> tuple[Driver, ...]:
        """Return the drivers that make the input follow a law."""
        return (SpatialAngleDriver(name="driver", joint=self.DRIVEN, **law_keys(law)),)

    def scene(
        self,
        speed: float = 2.0,
        turns: float = 1,
        samples: int = 361,
        branch: Branch | str = Branch.OPEN,
        *,
        start: float = 0.0,
        law: Law | None = None,
        times: Sequence[float] | None = None,
        effects: Collection[Effect | str] = tuple(Effect),
        evidence: Collection[Evidence | str] = tuple(Evidence),
        name: str | None = None,
    ) -> Scene:
        """Return a scene that starts on a branch.

        Parameters
        ----------
        speed, turns, samples, start : float, float, int, float
            The input turns from `start` [rad] at constant `speed` [rad/s], that many turns, over so many times.
        branch : Branch or str
            The assembly at the first time.
        law, times : Law and sequence of float, optional
            Instead of those four: any motion law of the input, and the times [s].
        """
        law, times = uniform_law(speed, turns, samples, start) if law is None else (law, given_law(law, times))
        poses = self.assemble(float(law(times[0])), branch)
        return Scene(
            mechanism=Mechanism(
                tuple(Body(name=body, estimate=tuple(round(x, ROUGH) for x in pose)) for body, pose in poses.items()),
                self.joints(),
                self.drivers(law),
            ),
            times=tuple(times),
            name=name or f"{type(self).__name__} {member(Branch, branch, 'branch')}",
            effects=frozenset(member(Effect, effect, "effects") for effect in effects),
            evidence=frozenset(member(Evidence, kind, "evidence") for kind in evidence),
        )


@dataclass(frozen=True)
class RSSR(SpatialLinkage):
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

    crank: float
    coupler: float
    rocker: float
    pivot: Triple
    axis: Triple
    massless: bool = False
    LENGTHS = ("crank", "coupler", "rocker")

    def joints(self) -> tuple[Constraint, ...]:
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
        p, q, r = w.dot(f), w.dot(g), self.rocker
        reach = (w.dot(w) + r * r - self.coupler**2) / (2 * r)
        return math.atan2(q, p) + sign * self._cosine(value, reach / math.hypot(p, q))

    def _poses(self, value: float, sign: int) -> Iterator[tuple[str, tuple[float, ...]]]:
        f, g, h = frame(self.axis, None)
        x, arm = turned(Vec3(*X), Vec3(*Y), value), turned(f, g, self.output(value, sign))
        inner, outer = x * self.crank, Vec3(*self.pivot) + arm * self.rocker
        yield "crank", placed(Vec3(*AT), x, Vec3(*Z))
        if not self.massless:
            _, rod = along(outer - inner)
            yield "coupler", placed(inner, rod, frame(rod.parts, None)[0])
        yield "rocker", placed(Vec3(*self.pivot), arm, h)


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
        f, _, _ = frame(self.axis, None)
        line: dict[str, Any] = {"point_i": self.guide, "axis_i": self.axis, "zero_i": f.parts}
        own: dict[str, Any] = {"body_j": "slider", "point_j": AT, "axis_j": Z, "zero_j": X}
        return (
            revolute("R1", GROUND, AT, Z, X, "crank", form=self.form),
            spherical("S1", "crank", (self.crank, 0.0, 0.0), "rod", AT),
            spherical("S2", "rod", (self.rod, 0.0, 0.0), "slider", AT),
            SpatialPrismatic(name="P", body_i=GROUND, **line, **own, form=self.form),  # type: ignore[arg-type]
        )

    def _poses(self, value: float, sign: int) -> Iterator[tuple[str, tuple[float, ...]]]:
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
        _, rod = along(pin - inner)
        yield "crank", placed(Vec3(*AT), x, Vec3(*Z))
        yield "rod", placed(inner, rod, frame(rod.parts, None)[0])
        yield "slider", placed(pin, f, h)


@dataclass(frozen=True)
class RSCR(SpatialLinkage):
    """A crank about the z axis, a coupler on a spherical and a cylindrical joint, a rocker that bears the latter.

    The cylindrical joint is parallel to the rocker's axis, `rocker` away from it; the spherical joint is `coupler` away
    from the cylindrical one. So seen along that axis, it is circle against circle.
    """

    crank: float
    coupler: float
    rocker: float
    pivot: Triple
    axis: Triple
    LENGTHS = ("crank", "coupler", "rocker")

    def joints(self) -> tuple[Constraint, ...]:
        f, _, _ = frame(self.axis, None)
        line: dict[str, Any] = {"axis_i": Z, "zero_i": X, "axis_j": Z, "zero_j": X}
        ends: dict[str, Any] = {"body_i": "rocker", "point_i": (self.rocker, 0.0, 0.0), "body_j": "coupler"}
        return (
            revolute("R1", GROUND, AT, Z, X, "crank", form=self.form),
            spherical("S", "crank", (self.crank, 0.0, 0.0), "coupler", (self.coupler, 0.0, 0.0)),
            Cylindrical(name="C", **ends, point_j=AT, **line, form=self.form),  # type: ignore[arg-type]
            revolute("R2", GROUND, self.pivot, self.axis, f.parts, "rocker", form=self.form),
        )

    def _poses(self, value: float, sign: int) -> Iterator[tuple[str, tuple[float, ...]]]:
        f, g, h = frame(self.axis, None)
        x = turned(Vec3(*X), Vec3(*Y), value)
        inner = x * self.crank
        w = inner - Vec3(*self.pivot)
        p, q, r = w.dot(f), w.dot(g), self.rocker
        reach = (p * p + q * q + r * r - self.coupler**2) / (2 * r)
        psi = math.atan2(q, p) + sign * self._cosine(value, reach / math.hypot(p, q))
        arm = turned(f, g, psi)
        origin = Vec3(*self.pivot) + arm * r + h * w.dot(h)
        _, towards = along(inner - origin)
        yield "crank", placed(Vec3(*AT), x, Vec3(*Z))
        yield "coupler", placed(origin, towards, h)
        yield "rocker", placed(Vec3(*self.pivot), arm, h)


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
        hinges, i, point, axis = [], GROUND, AT, Z
        *moving, (length, twist) = self.links
        for k, (a, t) in enumerate(moving, 1):
            hinges.append(revolute(f"R{k}", i, point, axis, X, f"link{k}", form=self.form))
            i, point, axis = f"link{k}", (a, 0.0, 0.0), (0.0, -math.sin(t), math.cos(t))
        back: dict[str, Any] = {"point_j": (-length, 0.0, 0.0), "axis_j": (0.0, math.sin(twist), math.cos(twist))}
        hinges.append(revolute(f"R{len(self.links)}", i, point, axis, X, GROUND, **back, form=self.form))
        return tuple(hinges)

    def _poses(self, value: float, sign: int) -> Iterator[tuple[str, tuple[float, ...]]]:
        r, f, g, h = (Vec3(*v) for v in (AT, X, Y, Z))
        angles = self.angles(value, sign)
        for k, ((length, twist), angle) in enumerate(zip(self.links[:-1], angles, strict=False), 1):
            f, g = turned(f, g, angle), turned(g, -f, angle)
            yield f"link{k}", placed(r, f, h)
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
        axis = (0.0, -math.sin(self.beta), math.cos(self.beta))
        ends: dict[str, Any] = {"body_i": "input", "point_i": AT, "body_j": "output", "point_j": AT}
        return (
            revolute("R1", GROUND, AT, Z, X, "input", form=self.form),
            Universal(name="U", **ends, axis_i=X, axis_j=Y),
            revolute("R2", GROUND, AT, axis, X, "output", form=self.form),
        )

    def _poses(self, value: float, sign: int) -> Iterator[tuple[str, tuple[float, ...]]]:
        pin = turned(Vec3(*X), Vec3(*Y), value)
        axis = Vec3(0.0, -math.sin(self.beta), math.cos(self.beta))
        _, f = along(pin.cross(axis).cross(axis) * -1.0)  # the output's y axis is across both pin and axis
        yield "input", placed(Vec3(*AT), pin, Vec3(*Z))
        yield "output", placed(Vec3(*AT), f, axis)


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
        middle, last = self._axes
        fork = (math.sin(self.phase), math.cos(self.phase), 0.0)
        one: dict[str, Any] = {"body_i": "input", "point_i": AT, "body_j": "shaft", "point_j": AT}
        two: dict[str, Any] = {"body_i": "shaft", "point_i": (0.0, 0.0, self.length), "body_j": "output", "point_j": AT}
        line: dict[str, Any] = {"point_i": (middle * self.length).parts, "axis_i": last.parts, "zero_i": X}
        return (
            revolute("R1", GROUND, AT, Z, X, "input", form=self.form),
            Universal(name="U1", **one, axis_i=X, axis_j=Y),
            Universal(name="U2", **two, axis_i=fork, axis_j=X),
            Cylindrical(
                name="C",
                body_i=GROUND,
                **line,
                body_j="output",
                point_j=AT,
                axis_j=Z,
                zero_j=X,
                form=self.form,  # type: ignore[arg-type]
            ),
        )

    def _poses(self, value: float, sign: int) -> Iterator[tuple[str, tuple[float, ...]]]:
        middle, last = self._axes
        pin = turned(Vec3(*X), Vec3(*Y), value)
        _, f = along(pin.cross(middle).cross(middle) * -1.0)
        g = middle.cross(f)
        fork = f * math.sin(self.phase) + g * math.cos(self.phase)
        _, other = along(fork.cross(last))
        yield "input", placed(Vec3(*AT), pin, Vec3(*Z))
        yield "shaft", placed(Vec3(*AT), f, middle)
        yield "output", placed(middle * self.length, other, last)


@dataclass(frozen=True)
class ScrewJack(SpatialLinkage):
    """A screw in the ground, driven, lifts a platform that slides along the z axis; `pitch` [m/rad]."""

    pitch: float
    height: float = 1.0
    LENGTHS = ("pitch", "height")
    DRIVEN = "H1"

    def joints(self) -> tuple[Constraint, ...]:
        line: dict[str, Any] = {"axis_i": Z, "zero_i": X, "axis_j": Z, "zero_j": X, "form": self.form}
        side = (0.5 * self.height, 0.0, 0.0)
        return (
            Screw(name="H1", body_i=GROUND, point_i=AT, body_j="screw", point_j=AT, **line, pitch=self.pitch),
            PointOnPlane(
                name="tip", body_i="platform", point_i=AT, axis_i=Z, body_j="screw", point_j=(0.0, 0.0, self.height)
            ),
            SpatialPrismatic(name="P", body_i=GROUND, point_i=side, body_j="platform", point_j=side, **line),
        )

    def _poses(self, value: float, sign: int) -> Iterator[tuple[str, tuple[float, ...]]]:
        x, shift = turned(Vec3(*X), Vec3(*Y), value), self.pitch * value
        yield "screw", placed(Vec3(0.0, 0.0, shift), x, Vec3(*Z))
        yield "platform", placed(Vec3(0.0, 0.0, shift + self.height), Vec3(*X), Vec3(*Z))


@dataclass(frozen=True)
class Stewart(SpatialLinkage):
    """A platform on six legs whose lengths are driven.

    Attributes
    ----------
    base, platform : tuple of six triples of float
        Where the legs stand on the ground, and in the platform's frame.
    home : tuple of seven floats
        The platform's coordinates at which the legs have their middle lengths.
    stroke : float
        How far the law of the input moves the legs, by turns out and in [m].
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
        p = Quaternion.of(*self.home[3:])
        tops = [Vec3(*self.home[:3]) + p.times(Quaternion(0.0, Vec3(*u))).before_inverse(p).v for u in self.platform]
        return tuple(math.hypot(*(a - Vec3(*b)).parts) for a, b in zip(tops, self.base, strict=True))

    def joints(self) -> tuple[Constraint, ...]:
        return ()

    def drivers(self, law: Law) -> tuple[Driver, ...]:
        """Return the six drivers; of the law the rate counts, as that of a phase [rad/s]."""
        rate = float(law(0.0, 1))
        ends = zip(self.base, self.platform, self.lengths(), strict=True)
        return tuple(
            SpatialDistanceDriver(
                name=f"leg{k}",
                body_i=GROUND,
                point_i=base,
                body_j="platform",
                point_j=top,
                law=Sinusoid(amplitude=self.stroke, angular_frequency=rate, phase=float(k), offset=length),
            )
            for k, (base, top, length) in enumerate(ends, 1)
        )

    def _poses(self, value: float, sign: int) -> Iterator[tuple[str, tuple[float, ...]]]:
        yield "platform", self.home


@dataclass(frozen=True)
class RSSRChain(SpatialLinkage):
    """Copies of an RSSR one after another: the rocker of each is the crank of the next."""

    first: RSSR
    count: int

    def _frames(self) -> Iterator[Frame]:
        """Yield the frames in which each copy stands: z along its crank's axis."""
        at, own = GROUND_FRAME, frame(self.first.axis, None)
        for _ in range(self.count + 1):
            yield at
            f, g, h = (of_frame(at, v) for v in own)
            at = (at[0] + of_frame(at, Vec3(*self.first.pivot)), f, g, h)

    def joints(self) -> tuple[Constraint, ...]:
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

    def _poses(self, value: float, sign: int) -> Iterator[tuple[str, tuple[float, ...]]]:
        one, arm = self.first, turned(Vec3(*X), Vec3(*Y), value)
        yield "rocker0", placed(Vec3(*AT), arm, Vec3(*Z))
        frames = list(self._frames())
        for k, (before, after) in enumerate(pairwise(frames), 1):
            inner = before[0] + arm * one.crank
            value = one.output(value, sign)
            arm = turned(after[1], after[2], value)
            _, rod = along(after[0] + arm * one.rocker - inner)
            yield f"coupler{k}", placed(inner, rod, frame(rod.parts, None)[0])
            yield f"rocker{k}", placed(after[0], arm, after[3])
