"""Spatial linkages, feasible by construction: at the first time every joint is placed in the ground frame, closed.

What a joint is on each of its bodies follows from that pose, so it closes whatever was drawn. How far the input may go
is decided by the distance of a point from a circle or a line: a coupler is long enough, and short enough, for all of
the span. Hard regions are gone to on purpose (`Region`).
"""

from __future__ import annotations

import math
import sys
from collections.abc import Callable, Collection, Sequence
from dataclasses import dataclass, field
from typing import Any

import numpy as np
from hypothesis import strategies as st
from hypothesis.strategies import DrawFn, SearchStrategy

from crosscheck.strategies.laws import draw_law
from refkin.joints import (
    GROUND,
    Cylindrical,
    Screw,
    SpatialAngleDriver,
    SpatialDistance,
    SpatialPrismatic,
    SpatialRevolute,
    Spherical,
    Universal,
)
from refkin.joints.spatial_terms import frame, parameters_of
from refkin.joints.spatial_vectors import Vec3
from refkin.model import Body, Mechanism, Member, Scene
from refkin.motion_laws import Integral, Law
from refkin.scenes.linkages import Branch

Array = Any
X, Y, Z = np.eye(3)
GRID = 181
"""Inputs of a span at which distances are looked at."""
NEARLY_ALIKE = (1.0, 2.0)
"""Decades of what the twists of a Bennett linkage may differ by [rad]; its speeds go up to one over that."""
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


@dataclass(frozen=True)
class Spatial:
    """A drawn scene of space, and what reports are binned by, as `scenes.Drawn` has it.

    Attributes
    ----------
    distance : float
        How near the span comes to a pose without an assembly: the least room of the coupler, in cranks.
    """

    scene: Scene
    kind: str
    branch: Branch
    distance: float
    hardness: Region
    grashof: None = None


@dataclass
class Pose:
    """A mechanism at the first time: frames of bodies on the ground, and joints by points and axes there."""

    frames: dict[str, tuple[Array, Array]]
    joints: list[Any] = field(default_factory=list)

    def local(self, body: str, point: Array) -> tuple[float, ...]:
        """Return a point of the ground frame in a body's."""
        r, a = self.frames[body]
        return tuple((a.T @ (point - r)).tolist())

    def turned(self, body: str, axis: Array) -> tuple[float, ...]:
        """Return a direction of the ground frame in a body's."""
        return tuple((self.frames[body][1].T @ axis).tolist())

    def add(self, kind: Any, name: str, i: str, j: str, point: Array, axis: Array = None, **more: Any) -> None:
        """Add a joint at a point, its axes along one direction; `zero_i`, `zero_j`, `axis_j` of the ground frame."""
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


UNITS = st.floats(-1.0, 1.0, allow_subnormal=False)
ANGLES = st.just(0.0) | st.floats(-math.pi, math.pi)
SENSES = st.sampled_from((1.0, -1.0))


def _direction(draw: DrawFn, label: str) -> Array:
    """Draw a unit vector: the z axis, or any."""
    z, angle = draw(st.just(1.0) | UNITS, label=f"{label}, height"), draw(ANGLES, label=f"{label}, angle")
    flat = math.sqrt(1.0 - z * z)
    return np.array([flat * math.cos(angle), flat * math.sin(angle), z])


def _decade(draw: DrawFn, decades: tuple[float, float]) -> float:
    return math.pow(10.0, -draw(st.floats(*decades), label="decade"))


def spatial_scenes(
    *,
    kinds: Collection[str] | None = None,
    regions: Collection[Region] = tuple(Region),
    decades: tuple[float, float] = (2, 6),
    samples: int = 72,
    min_size: float = 1e-2,
    max_size: float = 1e2,
) -> SearchStrategy[Spatial]:
    """Return scenes of `KINDS` that assemble at all times; `min_size`, `max_size` bound the crank [m].

    `decades` (k, k') say that hard regions are 10^-k ... 10^-k' wide. Examples from this strategy shrink towards an
    RSSR with a crank of about one metre at the origin.
    """
    wanted = [
        (kind, r) for kind, (_, own) in KINDS.items() if kinds is None or kind in kinds for r in own if r in regions
    ]
    if not wanted or samples < 1:
        raise ValueError(f"expected kinds, regions, samples >= 1; got {kinds!r}, {regions!r}, {samples!r}")
    return _spatial(tuple(wanted), decades, samples, min_size, max_size)


@st.composite
def _spatial(
    draw: DrawFn,
    wanted: tuple[tuple[str, Region], ...],
    decades: tuple[float, float],
    samples: int,
    min_size: float,
    max_size: float,
) -> Spatial:
    kind, region = draw(st.sampled_from(wanted), label="kind and region")
    size = math.pow(10.0, draw(st.floats(math.log10(min_size), math.log10(max_size)), label="decade of the size"))
    branch = draw(st.sampled_from(Branch), label="branch")
    plan = KINDS[kind][0](draw, region, 1.0 if branch is Branch.OPEN else -1.0, decades)
    duration = 10.0 ** draw(st.floats(-1.0, 1.0), label="decade of the duration")
    law = draw_law(draw, *plan.span, duration, monotone=True)
    scene = _scene(
        draw, plan, law, size, tuple(np.linspace(0.0, duration, samples).tolist()), f"{kind} {branch}, {plan.region}"
    )
    return Spatial(scene, kind, branch, plan.room, plan.region)


@dataclass
class Plan:
    """What a kind is made of: bodies with their frames and joints in cranks, the driven joint, its span, its room."""

    bodies: dict[str, tuple[Array, Array]]
    joints: Callable[[Pose], None]
    driven: str
    span: tuple[float, float]
    room: float
    region: Region


def _scene(draw: DrawFn, plan: Plan, law: Law, size: float, times: tuple[float, ...], name: str) -> Scene:
    """Return the scene of a plan: somewhere on the ground, its bodies with frames of their own."""
    place, apart = np.eye(3), np.zeros(3)
    if draw(st.booleans(), label="somewhere else"):
        place = turn(_direction(draw, "axis of the place"), draw(ANGLES, label="turn of the place"))
        apart = 10.0 * np.array([draw(UNITS, label="origin") for _ in range(3)])
    frames = {GROUND: (np.zeros(3), np.eye(3))}
    other = draw(st.booleans(), label="other frames")
    for body, (r, a) in plan.bodies.items():
        if other:
            a = a @ turn(_direction(draw, f"axis of {body}"), draw(ANGLES, label=f"turn of {body}"))
            r = r + np.array([draw(UNITS, label=f"frame of {body}") for _ in range(3)])
        frames[body] = (size * (apart + place @ r), place @ a)
    pose = _Scaled(frames, place=place, apart=apart, size=size)
    plan.joints(pose)
    bodies = tuple(Body(name=body, estimate=_rough(*frames[body], size)) for body in plan.bodies)
    keys: dict[str, Any] = {"rate_law": law.rate, "initial": law.initial} if isinstance(law, Integral) else {"law": law}
    driver = SpatialAngleDriver(name="driver", joint=plan.driven, **keys)
    return Scene(mechanism=Mechanism(bodies, tuple(pose.joints), (driver,)), times=times, name=name)


@dataclass
class _Scaled(Pose):
    """A pose whose joints are given in cranks, before it was put in its place."""

    place: Array = None
    apart: Array = None
    size: float = 1.0

    def local(self, body: str, point: Array) -> tuple[float, ...]:
        return super().local(body, self.size * (self.apart + self.place @ point))

    def turned(self, body: str, axis: Array) -> tuple[float, ...]:
        return super().turned(body, self.place @ axis)


def _rough(r: Array, a: Array, size: float) -> tuple[float, ...]:
    """Return a pose as an estimate of three decimals, of the size and of its Euler parameters."""
    return (
        *(size * round(float(x) / size, 3) for x in r),
        *(round(float(x), 3) for x in parameters_of(*(Vec3(*column) for column in a.T))),
    )


# spans and couplers


@dataclass
class Circle:
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


def _crank(angle: Any) -> Array:
    """Return the tip of a crank of length 1 about z, (..., 3)."""
    return np.stack([np.cos(angle), np.sin(angle), 0.0 * np.asarray(angle)], axis=-1)


def _span(draw: DrawFn) -> tuple[float, float]:
    first = draw(ANGLES, label="first angle")
    return first, first + draw(SENSES, label="sense") * draw(st.just(math.tau) | st.floats(0.75, 6.25), label="turned")


def _coupler(
    draw: DrawFn, region: Region, decades: tuple[float, float], reach: Callable[[Array], tuple[Array, Array]]
) -> tuple[tuple[float, float], float, float, Region]:
    """Draw a span, and a coupler's length that follows it: not below the least distance, not above the greatest.

    Returns the span, the length, its room, and the region: a regular one where there is no limit or fold to go to.
    """
    regular = Region.REGULAR if region in (Region.LIMIT, Region.FOLD) else region
    first, last = _span(draw)
    part = draw(st.floats(0.2, 0.8), label="part of the room")
    near = _decade(draw, decades) if region in (Region.LIMIT, Region.FOLD) else 0.0
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


# kinds


def _rocker(draw: DrawFn, region: Region, decades: tuple[float, float]) -> Circle:
    if region is Region.OVER:
        centre = np.array(
            [draw(st.floats(0.125, 0.375), label="ground"), 0.0, draw(st.floats(-0.25, 0.25), label="rise")]
        )
        axis, radius = Z + 0.125 * _direction(draw, "axis of the rocker"), draw(st.floats(1.0, 1.5), label="rocker")
    elif region is Region.PLANAR:
        tilt = _decade(draw, decades)
        centre = np.array([draw(st.floats(1.5, 4.0), label="ground"), 0.0, tilt * draw(UNITS, label="rise")])
        axis, radius = Z + tilt * _direction(draw, "tilt of the rocker"), draw(st.floats(1.0, 3.0), label="rocker")
    else:
        centre = np.array([draw(st.floats(1.25, 4.0), label="ground"), *(draw(UNITS, label="rise") for _ in range(2))])
        axis, radius = _direction(draw, "axis of the rocker"), draw(st.floats(0.75, 3.0), label="rocker")
    return Circle(centre, joint_frame(axis, None), radius)


def _rod(draw: DrawFn) -> bool:
    return draw(st.booleans(), label="coupler is a body")


def _linked(pose: Pose, i: str, j: str, ends: tuple[Array, Array], name: str, whole: bool) -> None:
    """Join two bodies by a coupler, a body with a spherical joint at either end, or by a distance."""
    if whole:
        pose.add(Spherical, f"{name} S1", i, name, ends[0])
        pose.add(Spherical, f"{name} S2", name, j, ends[1])
    else:
        length = float(np.linalg.norm(ends[1] - ends[0])) * getattr(pose, "size", 1.0)
        pose.add(SpatialDistance, name, i, j, ends[0], at_j=ends[1], length=length)


def _along(ends: tuple[Array, Array]) -> tuple[Array, Array]:
    """Return the frame of a coupler: at its first end, x along it."""
    frame = joint_frame(ends[1] - ends[0], None)
    return ends[0], frame[:, [2, 0, 1]]


def _rssr(draw: DrawFn, region: Region, sign: float, decades: tuple[float, float]) -> Plan:
    circle, whole = _rocker(draw, region, decades), _rod(draw)
    span, length, room, region = _coupler(draw, region, decades, lambda angles: circle.reach(_crank(angles)))
    tip = _crank(span[0])
    end = circle.at(np.array(circle.meets(tip, length, sign)))
    bodies = {"crank": (np.zeros(3), turn(Z, span[0])), "rocker": (circle.centre, circle.frame)}
    if whole:
        bodies["coupler"] = _along((tip, end))

    def joints(pose: Pose) -> None:
        pose.add(SpatialRevolute, "R1", GROUND, "crank", np.zeros(3), Z, zero_i=X, zero_j=tip)
        _linked(pose, "crank", "rocker", (tip, end), "coupler", whole)
        pose.add(SpatialRevolute, "R2", GROUND, "rocker", circle.centre, circle.frame[:, 2])

    return Plan(bodies, joints, "R1", span, room, region)


def _rssp(draw: DrawFn, region: Region, sign: float, decades: tuple[float, float]) -> Plan:
    axis, whole = joint_frame(_direction(draw, "axis of the slide") + 0.125 * X, None), _rod(draw)
    foot = np.array([draw(UNITS, label="offset of the slide") for _ in range(3)])

    def away(points: Array) -> Array:
        w = (points - foot) @ axis
        return np.hypot(w[..., 0], w[..., 1])

    span = _span(draw)
    least = float(np.max(away(_crank(np.linspace(*span, GRID)))))
    if region is Region.LIMIT:
        near = _decade(draw, decades)
        span = (
            span[0],
            span[0] + (span[1] - span[0]) * int(np.argmax(away(_crank(np.linspace(*span, GRID))))) / GRID * 0.8,
        )
        if abs(span[1] - span[0]) < 0.1:
            span = span[0], span[0] + 0.1
        beyond = float(away(_crank(span[1] + math.copysign(near, span[1] - span[0]))))
        least = float(np.max(away(_crank(np.linspace(*span, GRID)))))
        if beyond > least:
            least, room = beyond, 0.0
        else:
            region = Region.REGULAR
    if region is not Region.LIMIT:
        room = draw(st.floats(0.25, 2.0), label="room of the rod")
    length = least + room
    tip = _crank(span[0])
    along = (tip - foot) @ axis[:, 2] + sign * math.sqrt(max(length**2 - float(away(tip)) ** 2, 0.0))
    end = foot + along * axis[:, 2]
    bodies = {"crank": (np.zeros(3), turn(Z, span[0])), "slider": (end, axis)}
    if whole:
        bodies["coupler"] = _along((tip, end))

    def joints(pose: Pose) -> None:
        pose.add(SpatialRevolute, "R1", GROUND, "crank", np.zeros(3), Z, zero_i=X, zero_j=tip)
        _linked(pose, "crank", "slider", (tip, end), "coupler", whole)
        pose.add(SpatialPrismatic, "P", GROUND, "slider", end, axis[:, 2], zero_i=axis[:, 0], zero_j=axis[:, 0])

    return Plan(bodies, joints, "R1", span, max(room, 1e-12), region)


def _bennett(draw: DrawFn, region: Region, sign: float, decades: tuple[float, float]) -> Plan:
    alpha = draw(st.floats(0.25, 0.75), label="first twist")
    if region is Region.ALIKE:
        beta = alpha + _decade(draw, NEARLY_ALIKE)
    else:
        beta = draw(st.floats(1.0, 1.5), label="second twist")
    b, span = math.sin(beta) / math.sin(alpha), _span(draw)
    first = math.remainder(span[0], math.tau)
    if abs(math.sin(first)) < 0.125:  # not begun where all links lie in a line
        span, first = (span[0] + 0.25, span[1] + 0.25), first + 0.25
    other = 2.0 * math.atan(math.sin((beta + alpha) / 2) / math.sin((beta - alpha) / 2) / math.tan(first / 2))
    links = (("link 1", first, 1.0, alpha), ("link 2", other, b, beta), ("link 3", -first, 1.0, alpha))
    at, bodies, axes = np.eye(4), dict[str, tuple[Array, Array]](), [(np.zeros(3), Z)]
    for name, angle, length, twist in links:
        a, r = turn(Z, angle), np.array([length * math.cos(angle), length * math.sin(angle), 0.0])
        step = np.eye(4)
        step[:3, :3], step[:3, 3] = a @ turn(X, twist), r
        at = at @ step
        bodies[name] = (at[:3, 3].copy(), at[:3, :3].copy())
        axes.append((at[:3, 3].copy(), at[:3, 2].copy()))
    chain = (GROUND, "link 1", "link 2", "link 3", GROUND)

    def joints(pose: Pose) -> None:
        zero = {"zero_i": X, "zero_j": np.array([math.cos(first), math.sin(first), 0.0])}
        for k, (point, axis) in enumerate(axes):
            pose.add(SpatialRevolute, f"R{k + 1}", chain[k], chain[k + 1], point, axis, **(zero if k == 0 else {}))

    moved = span[0] - first
    return Plan(bodies, joints, "R1", (first, span[1] - moved), abs(b - 1.0), region)


def _hooke(draw: DrawFn, region: Region, sign: float, decades: tuple[float, float]) -> Plan:
    """One Hooke joint between two shafts that cross: two rows more than are independent."""
    near = (
        _decade(draw, decades) if region is Region.GIMBAL else draw(st.floats(0.25, 1.5), label="angle off a right one")
    )
    bend = sign * (math.pi / 2 - near)
    n, span = np.array([0.0, math.sin(bend), math.cos(bend)]), _span(draw)
    first = span[0]
    if abs(math.cos(first)) < 0.25:  # where the pin of the input is across both shafts the speeds differ most
        span = (first + 0.5, span[1] + 0.5)
    pin = _crank(span[0])
    fork = np.cross(n, pin) / np.linalg.norm(np.cross(n, pin))
    bodies = {"input": (np.zeros(3), turn(Z, span[0])), "output": (np.zeros(3), joint_frame(n, fork))}

    def joints(pose: Pose) -> None:
        pose.add(SpatialRevolute, "R1", GROUND, "input", -Z, Z, zero_i=X, zero_j=pin)
        pose.add(Universal, "U", "input", "output", np.zeros(3), pin, axis_j=fork)
        pose.add(SpatialRevolute, "R2", GROUND, "output", n, n)

    return Plan(bodies, joints, "R1", span, near, region)


def _double_hooke(draw: DrawFn, region: Region, sign: float, decades: tuple[float, float]) -> Plan:
    """Two shafts and a link between them, a universal joint at either end; the output may shift."""
    bends = [
        sign * draw(st.floats(0.125, 1.0), label="angle of the link"),
        draw(st.floats(0.125, 1.0), label="of the output"),
    ]
    line = np.array([0.0, math.sin(bends[0]), math.cos(bends[0])])
    n = turn(Z, draw(ANGLES, label="angle of the shafts")) @ turn(X, bends[1]) @ line
    span, second = _span(draw), line * draw(st.floats(0.5, 3.0), label="length of the link")
    pin = _crank(span[0])
    one = np.cross(line, pin) / np.linalg.norm(np.cross(line, pin))
    two = turn(line, draw(ANGLES, label="angle of the forks")) @ one
    fork = np.cross(two, n) / np.linalg.norm(np.cross(two, n))
    bodies = {
        "input": (np.zeros(3), turn(Z, span[0])),
        "link": (np.zeros(3), joint_frame(line, one)),
        "output": (second, joint_frame(n, fork)),
    }

    def joints(pose: Pose) -> None:
        pose.add(SpatialRevolute, "R1", GROUND, "input", -Z, Z, zero_i=X, zero_j=pin)
        pose.add(Universal, "U1", "input", "link", np.zeros(3), pin, axis_j=one)
        pose.add(Universal, "U2", "link", "output", second, two, axis_j=fork)
        pose.add(Cylindrical, "C", GROUND, "output", second + n, n)

    return Plan(bodies, joints, "R1", span, math.pi / 2 - max(map(abs, bends)), region)


def _screw(draw: DrawFn, region: Region, sign: float, decades: tuple[float, float]) -> Plan:
    """A nut on a screw, and a slider that a rod ties to it."""
    pitch, span = draw(st.floats(0.03125, 0.25), label="pitch"), _span(draw)
    axis = joint_frame(_direction(draw, "axis of the slide"), None)
    foot = np.array([draw(UNITS, label="offset of the slide") for _ in range(3)])
    angles = np.linspace(*span, GRID)
    w = (_crank(angles) + np.outer(pitch * angles, Z) - foot) @ axis
    away = np.hypot(w[:, 0], w[:, 1])
    length = float(np.max(away)) + draw(st.floats(0.25, 2.0), label="room of the rod")
    nut, tip = pitch * span[0] * Z, _crank(span[0]) + pitch * span[0] * Z
    end = foot + (w[0, 2] + sign * math.sqrt(length**2 - away[0] ** 2)) * axis[:, 2]
    bodies = {"nut": (nut, turn(Z, span[0])), "slider": (end, axis)}

    def joints(pose: Pose) -> None:
        scale = getattr(pose, "size", 1.0)
        zeros = {"zero_i": X, "zero_j": _crank(span[0])}
        pose.add(Screw, "H", GROUND, "nut", np.zeros(3), Z, at_j=nut, pitch=pitch * scale, **zeros)
        _linked(pose, "nut", "slider", (tip, end), "rod", False)
        pose.add(SpatialPrismatic, "P", GROUND, "slider", end, axis[:, 2], zero_i=axis[:, 0], zero_j=axis[:, 0])

    return Plan(bodies, joints, "H", span, length - float(np.max(away)), region)


def _chain(draw: DrawFn, region: Region, sign: float, decades: tuple[float, float]) -> Plan:
    """An RSSR whose rocker is the crank of another."""
    circle, whole = _rocker(draw, region, decades), _rod(draw)
    span, length, room, region = _coupler(draw, region, decades, lambda angles: circle.reach(_crank(angles)))
    second = Circle(
        circle.centre + 2.0 * circle.radius * _direction(draw, "second ground"),
        joint_frame(_direction(draw, "second axis"), None),
        circle.radius,
    )
    arm = draw(st.floats(-1.0, 1.0), label="angle of the arm")

    def arms(inputs: Array) -> Array:
        return circle.at(np.array([circle.meets(_crank(x), length, sign) for x in inputs]) + arm)

    while True:
        least, greatest = second.reach(arms(np.linspace(*span, GRID)))
        low, high = float(np.max(least)), float(np.min(greatest))
        if high - low > ROOM or abs(span[1] - span[0]) < 1e-2:
            break
        span = span[0], (span[0] + span[1]) / 2
    tip, angle = _crank(span[0]), circle.meets(_crank(span[0]), length, sign)
    end, begin = circle.at(np.array(angle)), circle.at(np.array(angle + arm))
    last = second.at(np.array(second.meets(begin, (low + high) / 2, sign)))
    bodies = {
        "crank": (np.zeros(3), turn(Z, span[0])),
        "rocker": (circle.centre, circle.frame),
        "second rocker": (second.centre, second.frame),
    }
    if whole:
        bodies |= {"coupler": _along((tip, end)), "second coupler": _along((begin, last))}

    def joints(pose: Pose) -> None:
        pose.add(SpatialRevolute, "R1", GROUND, "crank", np.zeros(3), Z, zero_i=X, zero_j=tip)
        _linked(pose, "crank", "rocker", (tip, end), "coupler", whole)
        pose.add(SpatialRevolute, "R2", GROUND, "rocker", circle.centre, circle.frame[:, 2])
        _linked(pose, "rocker", "second rocker", (begin, last), "second coupler", whole)
        pose.add(SpatialRevolute, "R3", GROUND, "second rocker", second.centre, second.frame[:, 2])

    return Plan(bodies, joints, "R1", span, min(room, (high - low) / 2), region)


KINDS: dict[str, tuple[Callable[..., Plan], Sequence[Region]]] = {
    "RSSR": (_rssr, (Region.REGULAR, Region.LIMIT, Region.FOLD, Region.PLANAR, Region.OVER)),
    "RSSP": (_rssp, (Region.REGULAR, Region.LIMIT)),
    "Bennett": (_bennett, (Region.REGULAR, Region.ALIKE)),
    "Hooke": (_hooke, (Region.REGULAR, Region.GIMBAL)),
    "double Hooke": (_double_hooke, (Region.REGULAR,)),
    "screw": (_screw, (Region.REGULAR,)),
    "RSSR chain": (_chain, (Region.REGULAR,)),
}
"""How each kind is made, and where it can go."""
