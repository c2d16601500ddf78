"""What linkages of space are drawn from: poses whose joints are placed in the ground frame, spans, couplers that reach.

How far an input may go is decided by the distance of a point from a circle or a line: a coupler is long enough, and
short enough, for all of the span.
"""

from __future__ import annotations

import math
import sys
from collections.abc import Callable
from dataclasses import dataclass, field
from typing import Any

import numpy as np
from hypothesis import strategies as st
from hypothesis.strategies import DrawFn

from crosscheck.strategies.linkages import ANGLES, COORDINATES, draw_power_of_ten
from refkin.joints import SpatialAngleDriver, SpatialDistance, Spherical
from refkin.joints.spatial_drivers import JointDriver
from refkin.joints.spatial_frames import frame
from refkin.model import Member

Array = Any
X, Y, Z = np.eye(3)
GRID = 181
"""Inputs of a span at which distances are looked at."""
ROOM = 0.15
"""A coupler has at least so much room between too short and too long, in cranks, or the span is halved."""


class Region(Member):
    """Where a scene goes on purpose.

    REGULAR keeps away from what follows; LIMIT ends 10^-k before an input that the coupler cannot follow; FOLD passes a
    pose in which crank and rocker are as far apart as the coupler is long, but for 10^-k of it; GIMBAL turns a Hooke
    joint of almost a right angle through the pose in which the ratio of speeds is largest; PLANAR has all axes parallel
    but for 10^-k; OVER has a coupler that turns over; ALIKE is a Bennett linkage whose twists differ by a tenth
    at most: where they are alike all links may fold into one line, and go on in two ways.
    """

    REGULAR = "regular"
    LIMIT = "limit"
    FOLD = "fold"
    GIMBAL = "gimbal"
    PLANAR = "near planar"
    OVER = "turning over"
    ALIKE = "twists nearly alike"


@dataclass
class SpaceAssembly:
    """A mechanism at the first time: frames of bodies on the ground, and what is added to it of joints there.

    Points and axes of joints are given in cranks of `size` [m], before they are turned by `place` and shifted `apart`.
    """

    frames: dict[str, tuple[Array, Array]]
    place: Array
    apart: Array
    size: float
    joints: list[Any] = field(default_factory=list)

    def local(self, body: str, point: Array) -> tuple[float, ...]:
        """Return a point in a body's frame."""
        r, a = self.frames[body]
        return tuple((a.T @ (self.size * (self.apart + self.place @ point) - r)).tolist())

    def turned(self, body: str, axis: Array) -> tuple[float, ...]:
        """Return a direction in a body's frame."""
        return tuple((self.frames[body][1].T @ (self.place @ axis)).tolist())

    def add(self, kind: Any, name: str, i: str, j: str, point: Array, axis: Array = None, **more: Any) -> None:
        """Add a joint at a point, its axes along one direction; also `zero_i`, `zero_j`, `axis_j`, `at_j`."""
        ends: dict[str, Any] = {"point_i": self.local(i, point), "point_j": self.local(j, more.pop("at_j", point))}
        if axis is not None:
            ends |= {"axis_i": self.turned(i, axis), "axis_j": self.turned(j, more.pop("axis_j", axis))}
        for side, body in (("zero_i", i), ("zero_j", j)):
            if side in more:
                ends[side] = self.turned(body, more.pop(side))
        self.joints.append(kind(name=name, body_i=i, body_j=j, **ends, **more))


def joint_frame(axis: Array, zero: Array | None) -> Array:
    """Return the matrix of columns f, g, h: h along the axis, f along what of a zero (or any vector) is across it."""
    given = None if zero is None else tuple(map(float, zero))
    vectors = frame((float(axis[0]), float(axis[1]), float(axis[2])), given)  # type: ignore[arg-type]
    return np.array([v.parts for v in vectors]).T


def turn(axis: Array, angle: float) -> Array:
    """Return the rotation by an angle about an axis."""
    f = joint_frame(axis, None)
    c, s = math.cos(angle), math.sin(angle)
    return f @ np.array([[c, -s, 0.0], [s, c, 0.0], [0.0, 0.0, 1.0]]) @ f.T


SENSES = st.sampled_from((1.0, -1.0))


def direction(draw: DrawFn, label: str) -> Array:
    """Draw a unit vector: the z axis, or any."""
    z, angle = draw(st.just(1.0) | COORDINATES, label=f"{label}, height"), draw(ANGLES, label=f"{label}, angle")
    flat = math.sqrt(1.0 - z * z)
    return np.array([flat * math.cos(angle), flat * math.sin(angle), z])


@dataclass
class SpacePlan:
    """What a kind is made of: bodies with their frames and joints in cranks, the driven joint, its span, its room.

    Where no joint is driven, what is driven is among the joints. The span is of angles [rad], or of displacements.
    """

    bodies: dict[str, tuple[Array, Array]]
    joints: Callable[[SpaceAssembly], None]
    driven: str
    span: tuple[float, float]
    room: float
    region: Region
    driver: type[JointDriver] = SpatialAngleDriver


# spans and couplers


@dataclass
class RockerCircle:
    """Where a rocker's joint may be: a circle, f and g across its axis h."""

    centre: Array
    frame: Array
    radius: float

    def at(self, angle: Any) -> Array:
        """Return its point at an angle, (..., 3)."""
        c, s = np.cos(angle)[..., None], np.sin(angle)[..., None]
        return self.centre + self.radius * (c * self.frame[:, 0] + s * self.frame[:, 1])

    def reach(self, points: Array) -> tuple[Array, Array]:
        """Return the least and the greatest distance (T,) of points (T, 3) from the circle."""
        w = (points - self.centre) @ self.frame
        flat = np.hypot(w[:, 0], w[:, 1])
        return np.hypot(flat - self.radius, w[:, 2]), np.hypot(flat + self.radius, w[:, 2])

    def meets(self, point: Array, length: float, sign: float) -> float:
        """Return the angle of one of the two points at a distance from a point."""
        w = (point - self.centre) @ self.frame
        k = (w @ w + self.radius**2 - length**2) / (2.0 * self.radius)
        away = max(math.hypot(w[0], w[1]), sys.float_info.min)  # on the circle's axis any angle will do
        return float(math.atan2(w[1], w[0]) + sign * math.acos(np.clip(k / away, -1.0, 1.0)))


def crank(angle: Any) -> Array:
    """Return the tip of a crank of length 1 about z, (..., 3)."""
    return np.stack([np.cos(angle), np.sin(angle), 0.0 * np.asarray(angle)], axis=-1)


def drawn_span(draw: DrawFn) -> tuple[float, float]:
    """Return the first and the last input [rad]."""
    first = draw(ANGLES, label="first angle")
    return first, first + draw(SENSES, label="sense") * draw(st.just(math.tau) | st.floats(0.75, 6.25), label="turned")


def drawn_coupler(
    draw: DrawFn, region: Region, decades: tuple[float, float], reach: Callable[[Array], tuple[Array, Array]]
) -> tuple[tuple[float, float], float, float, Region]:
    """Draw a span, and a coupler's length that follows it: not below the least distance, not above the greatest.

    Returns the span, the length, its room, and the region: a regular one where there is no limit or fold to go to.

    Parameters
    ----------
    draw : callable
        What Hypothesis draws with.
    region : Region
    decades : (float, float)
        Of the distance from what the region goes to.
    reach : callable
        Inputs (N,) [rad], or displacements -> least and greatest distance that a coupler spans at each (N,).
    """
    regular = Region.REGULAR if region in (Region.LIMIT, Region.FOLD) else region
    first, last = drawn_span(draw)
    part = draw(st.floats(0.2, 0.8), label="part of the room")
    near = draw_power_of_ten(draw, decades) if region in (Region.LIMIT, Region.FOLD) else 0.0
    if region is Region.FOLD:
        first, last = _around_least(first, last, reach)
    while True:
        angles = np.linspace(first, last, GRID)
        least, greatest = reach(angles)
        k = int(np.argmin(greatest))
        low, high = float(np.max(least)), float(greatest[k])
        if region is Region.LIMIT and k > 0:
            last = first + (last - first) * max(k, 2) / (GRID - 1) * (0.8 if k < GRID - 1 else 1.0)
            angles = np.linspace(first, last, GRID)
            least, greatest = reach(angles)
            beyond = float(reach(np.array([last + math.copysign(near, last - first)]))[1][0])
            inside = beyond < float(np.min(greatest)) and beyond > float(np.max(least)) + ROOM / 4
            if inside and beyond < greatest[0] - ROOM / 4:
                return (first, last), beyond, near, region
        elif region is Region.FOLD and 0 < k < GRID - 1 and high - low > ROOM / 2 and greatest[0] > high + ROOM / 4:
            angles = np.linspace(angles[k - 1], angles[k + 1], GRID)
            lowest = float(np.min(reach(angles)[1]))  # to the square of a step of this finer grid
            return (first, last), lowest * (1.0 - near) - 1e-9, near, region
        elif high - low > ROOM:
            return (first, last), low + (high - low) * part, (high - low) * min(part, 1.0 - part), regular
        last = (first + last) / 2
        if abs(last - first) < 1e-2:  # it begins at a singular pose: the tip is on the rocker's axis
            first, last = first + 1.0, last + 2.0


def _around_least(first: float, last: float, reach: Callable[[Array], tuple[Array, Array]]) -> tuple[float, float]:
    """Return a span, at most half as long, around the input at which the greatest distance is least.

    The widest in which a coupler follows, of four halvings; where there is none the span as it is.
    """
    turn = first + np.linspace(0.0, math.tau, GRID)
    at, half = float(turn[int(np.argmin(reach(turn)[1]))]), (last - first) / 4
    for _ in range(4):
        least, greatest = reach(np.linspace(at - half, at + half, GRID))
        high = float(np.min(greatest))
        if high - float(np.max(least)) > ROOM / 2 and greatest[0] > high + ROOM / 4:
            return at - half, at + half
        half /= 2
    return first, last


def drawn_rocker(draw: DrawFn, region: Region, decades: tuple[float, float]) -> RockerCircle:
    """Return where a rocker's joint may be; beside the crank's plane, or about it, if the region says so.

    Parameters
    ----------
    draw : callable
        What Hypothesis draws with.
    region : Region
    decades : (float, float)
        Of the tilt, of a linkage that is nearly planar.
    """
    if region is Region.OVER:
        centre = np.array(
            [draw(st.floats(0.125, 0.375), label="ground"), 0.0, draw(st.floats(-0.25, 0.25), label="rise")]
        )
        axis, radius = Z + 0.125 * direction(draw, "axis of the rocker"), draw(st.floats(1.0, 1.5), label="rocker")
    elif region is Region.PLANAR:
        tilt = draw_power_of_ten(draw, decades)
        centre = np.array([draw(st.floats(1.5, 4.0), label="ground"), 0.0, tilt * draw(COORDINATES, label="rise")])
        axis, radius = Z + tilt * direction(draw, "tilt of the rocker"), draw(st.floats(1.0, 3.0), label="rocker")
    else:
        centre = np.array(
            [draw(st.floats(1.25, 4.0), label="ground"), *(draw(COORDINATES, label="rise") for _ in range(2))]
        )
        axis, radius = direction(draw, "axis of the rocker"), draw(st.floats(0.75, 3.0), label="rocker")
    return RockerCircle(centre, joint_frame(axis, None), radius)


def link(pose: SpaceAssembly, i: str, j: str, ends: tuple[Array, Array], name: str, whole: bool) -> None:
    """Join two bodies by a coupler, a body with a spherical joint at either end, or by a distance.

    Parameters
    ----------
    pose : SpaceAssembly
        What is added to.
    i, j : str
        The bodies.
    ends : (first, second)
        Of the coupler, (3,) each, as `pose` has points.
    name : str
        The coupler's.
    whole : bool
        Whether it is a body, and no distance.
    """
    if whole:
        pose.add(Spherical, f"{name} S1", i, name, ends[0])
        pose.add(Spherical, f"{name} S2", name, j, ends[1])
    else:
        length = float(np.linalg.norm(ends[1] - ends[0])) * pose.size
        pose.add(SpatialDistance, name, i, j, ends[0], at_j=ends[1], length=length)


def coupler_frame(ends: tuple[Array, Array]) -> tuple[Array, Array]:
    """Return the frame of a coupler: at its first end, x along it."""
    frame = joint_frame(ends[1] - ends[0], None)
    return ends[0], frame[:, [2, 0, 1]]
