"""Geared five-bars, planets, racks, disc cams, six-bars, drawn so that they assemble over a full turn of their crank.

Each is planned in a plane of its own; `Frames` puts it on the ground, with a frame for every body.
"""

from __future__ import annotations

import cmath
import math
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from typing import Any

from hypothesis import strategies as st
from hypothesis.strategies import DrawFn

from crosscheck.strategies.linkages import ANGLES, COORDINATES
from refkin.joints import GROUND, Cam, Constraint, Disc, Gear, Pair, Prismatic, RackAndPinion, Revolute
from refkin.scenes.linkages.closures import direction_of, two_links

Place = tuple[complex, float]
"""Origin and angle of a body."""


@dataclass(frozen=True)
class ChainPlan:
    """A mechanism in its own plane: joints by their maker, poses by the angle of `driven`, and the closures' margin."""

    driven: str
    joints: Callable[[Frames], list[Constraint]]
    poses: Callable[[float], Mapping[str, Place]]
    margin: float
    longest: float


class Frames:
    """Where the plane lies on the ground, and where each body's frame lies on the body."""

    def __init__(self, origin: complex, angle: float, own: Mapping[str, tuple[complex, float]]) -> None:
        self.own = {GROUND: (-origin * cmath.exp(-1j * angle), -angle), **own}

    def point(self, side: str, body: str, u: complex) -> dict[str, Any]:
        """Return the keys of a point of a body, which stands at u in the body's plain frame."""
        at, angle = self.own[body]
        v = (u - at) * cmath.exp(-1j * angle)
        return {f"body_{side}": body, f"point_{side}": (v.real, v.imag)}

    def ends(self, i: str, p: complex, j: str, q: complex) -> dict[str, Any]:
        """Return the keys of the two points of a joint."""
        return {**self.point("i", i, p), **self.point("j", j, q)}

    def direction(self, body: str, e: complex) -> Pair:
        """Return a direction of a body."""
        v = e * cmath.exp(-1j * self.own[body][1])
        return v.real, v.imag

    def apart(self, i: str, j: str) -> float:
        """Return what the frames add to the angle of j against i."""
        return self.own[j][1] - self.own[i][1]

    def on_ground(self, place: Place, body: str) -> tuple[float, float, float]:
        """Return the coordinates of a body, from its place in the plane."""
        (r, phi), (at, angle), (at_ground, ground) = place, self.own[body], self.own[GROUND]
        origin = (r + at * cmath.exp(1j * phi) - at_ground) * cmath.exp(-1j * ground)
        return origin.real, origin.imag, phi + angle - ground

    def pin(self, name: str, i: str, p: complex, j: str, q: complex = 0j) -> Revolute:
        """Return a revolute joint."""
        return Revolute(name=name, **self.ends(i, p, j, q))

    def guide(self, name: str, p: complex, e: complex, j: str) -> Prismatic:
        """Return a guide on the ground through p along e for the origin of a body, which does not turn."""
        axis = self.direction(GROUND, e)
        return Prismatic(name=name, **self.ends(GROUND, p, j, 0j), axis_i=axis, angle=self.apart(GROUND, j))


PARTS = st.floats(0.125, 0.875)
SIGNS = st.sampled_from((1, -1))
FLAT = 1j
"""Normal of a flat follower in its own frame."""


def _five_bar(draw: DrawFn, size: float, side: int) -> ChainPlan:
    """Draw two cranks that a gear turns together, and two couplers that meet whatever the cranks do.

    The crank pins are d - a - b to d + a + b apart; c + e is above that, |c - e| below.
    """
    a, b = size, size * draw(st.floats(0.5, 2.0), label="second crank")
    d = (a + b) * draw(st.floats(1.25, 2.5), label="ground")
    c, e, margin = _draw_two_links(draw, d - a - b, d + a + b)
    ratio = draw(st.sampled_from((1.0, -1.0, 2.0, -2.0, 0.5)) | st.floats(0.25, 3.0), label="ratio")
    phi0 = draw(ANGLES, label="angle of mesh")

    def poses(theta: float) -> dict[str, Place]:
        second = phi0 - ratio * (theta - 0.25)
        left, right = a * cmath.exp(1j * theta), d + b * cmath.exp(1j * second)
        alpha, beta = two_links(right - left, c, e, side)
        return {"crank": (0j, theta), "second": (d + 0j, second), "left": (left, alpha), "right": (right, beta)}

    def joints(f: Frames) -> list[Constraint]:
        crank, second = (f.apart(GROUND, body) for body in ("crank", "second"))
        mesh: dict[str, Any] = {"body_i": "crank", "body_j": "second", "phi0_i": 0.25 + crank, "phi0_j": phi0 + second}
        return [
            f.pin("A0", GROUND, 0j, "crank"),
            f.pin("B0", GROUND, d + 0j, "second"),
            Gear(name="mesh", **mesh, radius_i=ratio * size, radius_j=size),
            f.pin("A", "crank", a + 0j, "left"),
            f.pin("B", "second", b + 0j, "right"),
            f.pin("P", "left", c + 0j, "right", -e + 0j),
        ]

    return ChainPlan("crank", joints, poses, margin, max(c, e, d))


def _planet(draw: DrawFn, size: float, side: int) -> ChainPlan:
    """Draw a planet on a crank, which rolls on a wheel at rest; its arm moves a coupler and a rocker at any angle.

    The arm's tip comes as near to the rocker's pivot as d - a - b, and as far from it as d + a + b.
    """
    a, b = size, size * draw(st.floats(0.25, 1.0), label="arm of the planet")
    d = (a + b) * draw(st.floats(1.25, 2.5), label="ground")
    c, e, margin = _draw_two_links(draw, d - a - b, d + a + b)
    ratio = draw(st.sampled_from((1.0, -2.0, 2.0, -0.5)) | st.floats(0.25, 3.0), label="ratio")
    phi0 = draw(ANGLES, label="angle of mesh")

    def poses(theta: float) -> dict[str, Place]:
        centre, planet = a * cmath.exp(1j * theta), phi0 + (1.0 + ratio) * theta
        tip = centre + b * cmath.exp(1j * planet)
        alpha, beta = two_links(d - tip, c, e, side)
        return {
            "crank": (0j, theta),
            "planet": (centre, planet),
            "coupler": (tip, alpha),
            "rocker": (d + 0j, beta + math.pi),
        }

    def joints(f: Frames) -> list[Constraint]:
        zeros = {"phi0_i": f.apart("crank", GROUND), "phi0_j": phi0 + f.apart("crank", "planet")}
        mesh: dict[str, Any] = {"body_i": GROUND, "body_j": "planet", "carrier": "crank", **zeros}
        return [
            f.pin("A0", GROUND, 0j, "crank"),
            f.pin("B0", GROUND, d + 0j, "rocker"),
            f.pin("A", "crank", a + 0j, "planet"),
            Gear(name="mesh", **mesh, radius_i=ratio * size, radius_j=size),
            f.pin("P", "planet", b + 0j, "coupler"),
            f.pin("B", "coupler", c + 0j, "rocker", e + 0j),
        ]

    return ChainPlan("crank", joints, poses, margin, max(c, e, d))


def _draw_two_links(draw: DrawFn, near: float, far: float) -> tuple[float, float, float]:
    """Draw two links whose ends meet at any distance between two, and the margin that they keep."""
    c = far / 2 * draw(st.floats(1.125, 1.75), label="coupler")
    e = c + draw(SIGNS, label="longer coupler") * near * draw(PARTS, label="difference")
    e = e if c + e > 1.0625 * far else 2 * c - e
    return c, e, min(c + e - far, near - abs(c - e))


def _rack(draw: DrawFn, size: float, side: int) -> ChainPlan:
    """Draw a slider-crank whose slider is a rack, which turns a pinion on the ground."""
    offset = size * draw(st.floats(-0.5, 0.5), label="offset")
    rod = (size + abs(offset)) * draw(st.floats(1.25, 3.0), label="rod")
    radius = size * draw(st.floats(0.25, 1.5), label="radius") * draw(SIGNS, label="side of the rack")
    s0, phi0 = size * draw(COORDINATES, label="s0"), draw(ANGLES, label="phi0")
    along = cmath.exp(1j * draw(ANGLES, label="angle of the teeth"))
    centre = complex(0.0, offset) + size * complex(*draw(st.tuples(COORDINATES, COORDINATES), label="pinion"))

    def poses(theta: float) -> dict[str, Place]:
        pin = size * cmath.exp(1j * theta)
        rise = offset - pin.imag
        slider = complex(pin.real + side * math.sqrt(rod * rod - rise * rise), offset)
        travel = ((centre - slider) / along).real
        angles = direction_of(slider - pin), phi0 + (travel - s0) / radius
        return {"crank": (0j, theta), "rod": (pin, angles[0]), "rack": (slider, 0.0), "pinion": (centre, angles[1])}

    def joints(f: Frames) -> list[Constraint]:
        teeth = f.ends("rack", 0j, "pinion", 0j)
        turned = f.apart("rack", "pinion")
        return [
            f.pin("A0", GROUND, 0j, "crank"),
            f.pin("A", "crank", size + 0j, "rod"),
            f.pin("B", "rod", rod + 0j, "rack"),
            f.guide("guide", complex(0.0, offset), 1.0 + 0j, "rack"),
            f.pin("C0", GROUND, centre, "pinion"),
            RackAndPinion(
                name="teeth", **teeth, axis_i=f.direction("rack", along), radius=radius, s0=s0, phi0=phi0 + turned
            ),
        ]

    return ChainPlan("crank", joints, poses, rod - size - abs(offset), rod + size)


def _cam(draw: DrawFn, size: float, side: int) -> ChainPlan:
    """Draw a disc on a pivot beside its centre; a flat follower, a roller or a knife edge; on a guide or a lever."""
    radius = size * draw(st.floats(1.25, 4.0), label="radius")
    form = draw(st.sampled_from(("roller", "point", "flat")), label="follower")
    rho = radius * draw(st.floats(0.0625, 1.0), label="roller") if form == "roller" else 0.0
    if draw(st.booleans(), label="on a guide"):
        return _lifted(draw, size, radius, rho, form, side)
    return _levered(draw, size, radius, rho, form, side)


def _touch(f: Frames, size: float, radius: float, rho: float, form: str, at: complex) -> Cam:
    more: dict[str, Any] = {"roller_radius": rho} if form == "roller" else {}
    if form == "flat":
        more = {"normal_j": f.direction("follower", FLAT)}
    ends = f.ends("cam", size + 0j, "follower", at)
    return Cam(name="touch", **ends, profile=Disc(radius=radius), follower=form, **more)  # type: ignore[arg-type]


def _lifted(draw: DrawFn, size: float, radius: float, rho: float, form: str, side: int) -> ChainPlan:
    """The guide runs along y at an offset; a face on it is level, so that it may only be above."""
    length = radius + rho
    offset = (length - size) * draw(st.floats(-0.75, 0.75), label="offset")

    def poses(theta: float) -> dict[str, Place]:
        centre = size * cmath.exp(1j * theta)
        if form == "flat":
            return {"cam": (0j, theta), "follower": (complex(offset, centre.imag + radius), 0.0)}
        across = offset - centre.real
        y = centre.imag + side * math.sqrt(length * length - across * across)
        return {"cam": (0j, theta), "follower": (complex(offset, y), 0.0)}

    def joints(f: Frames) -> list[Constraint]:
        guide = f.guide("guide", complex(offset, 0.0), 1j, "follower")
        return [f.pin("A0", GROUND, 0j, "cam"), guide, _touch(f, size, radius, rho, form, 0j)]

    margin = length - size - abs(offset)
    return ChainPlan("cam", joints, poses, radius - size if form == "flat" else margin, length + size)


def _levered(draw: DrawFn, size: float, radius: float, rho: float, form: str, side: int) -> ChainPlan:
    """The lever's pivot is outside of all the cam sweeps; cam centre, pivot and follower make a triangle."""
    length = radius + rho
    pivot = (length + size) * draw(st.floats(1.75, 3.5), label="pivot")
    arm = pivot + (length - size) * draw(st.floats(-0.75, 0.75), label="arm")
    height = radius * draw(st.floats(-0.5, 0.5), label="height of the face")

    def poses(theta: float) -> dict[str, Place]:
        away = size * cmath.exp(1j * theta) - pivot
        d = abs(away)
        if form == "flat":  # the face's normal: n . (pivot - centre) + height = radius
            phi = direction_of(-away) - math.pi / 2 + side * math.acos((radius - height) / d)
        else:
            phi = direction_of(away) + side * math.acos((arm * arm + d * d - length * length) / (2 * arm * d))
        return {"cam": (0j, theta), "follower": (pivot + 0j, phi)}

    def joints(f: Frames) -> list[Constraint]:
        touch = _touch(f, size, radius, rho, form, complex(arm, height) if form == "flat" else arm + 0j)
        return [f.pin("A0", GROUND, 0j, "cam"), f.pin("P0", GROUND, pivot + 0j, "follower"), touch]

    margin = pivot - size - abs(radius - height) if form == "flat" else length - size - abs(pivot - arm)
    return ChainPlan("cam", joints, poses, margin, pivot + arm)


def _six_bar(draw: DrawFn, size: float, side: int) -> ChainPlan:
    """Draw a crank-rocker, and on its rocker two more links, or a link and a slider."""
    ground = size * draw(st.floats(2.0, 5.0), label="ground")
    coupler, rocker, first = _draw_two_links(draw, ground - size, ground + size)
    tip = rocker * complex(*draw(st.tuples(st.floats(0.5, 1.5), COORDINATES), label="tip of the rocker"))
    reach, other = abs(tip), draw(SIGNS, label="second dyad")
    sliding = draw(st.booleans(), label="slider")
    base = ground + reach * draw(st.floats(1.5, 3.0), label="second pivot") * cmath.exp(1j * draw(ANGLES))
    apart = abs(base - ground)
    link = (apart + reach) * draw(st.floats(0.625, 1.25), label="link")
    last = link + draw(SIGNS, label="longer") * (apart - reach) * draw(PARTS, label="difference")
    last = last if link + last > 1.0625 * (apart + reach) else 2 * link - last
    level = draw(st.floats(-1.0, 1.0), label="level") * size
    rod = (reach + abs(level)) * draw(st.floats(1.25, 3.0), label="connecting rod")

    def poses(theta: float) -> dict[str, Place]:
        pin = size * cmath.exp(1j * theta)
        alpha, beta = two_links(ground - pin, coupler, rocker, side)
        places: dict[str, Place] = {
            "crank": (0j, theta),
            "coupler": (pin, alpha),
            "rocker": (ground + 0j, beta + math.pi),
        }
        at = ground + tip * cmath.exp(1j * (beta + math.pi))
        if sliding:
            rise = level - at.imag
            slider = complex(at.real + other * math.sqrt(rod * rod - rise * rise), level)
            return {**places, "rod": (at, direction_of(slider - at)), "slider": (slider, 0.0)}
        gamma, delta = two_links(base - at, link, last, other)
        return {**places, "link": (at, gamma), "last": (base, delta + math.pi)}

    def joints(f: Frames) -> list[Constraint]:
        four = [
            f.pin("A0", GROUND, 0j, "crank"),
            f.pin("B0", GROUND, ground + 0j, "rocker"),
            f.pin("A", "crank", size + 0j, "coupler"),
            f.pin("B", "coupler", coupler + 0j, "rocker", rocker + 0j),
        ]
        if sliding:
            guide = f.guide("guide", complex(0.0, level), 1.0 + 0j, "slider")
            return [*four, f.pin("C", "rocker", tip, "rod"), f.pin("D", "rod", rod + 0j, "slider"), guide]
        end = f.pin("D", "link", link + 0j, "last", last + 0j)
        return [*four, f.pin("C", "rocker", tip, "link"), end, f.pin("E0", GROUND, base, "last")]

    second = rod - reach - abs(level) if sliding else min(link + last - apart - reach, apart - reach - abs(link - last))
    return ChainPlan("crank", joints, poses, min(first, second), max(coupler, rocker, ground, apart + reach))


KINDS: Mapping[str, Callable[[DrawFn, float, int], ChainPlan]] = {
    "geared five-bar": _five_bar,
    "planet five-bar": _planet,
    "rack and pinion": _rack,
    "disc cam": _cam,
    "six-bar": _six_bar,
}
"""Each draws a mechanism by the length of its crank [m], on one side of its closures."""
