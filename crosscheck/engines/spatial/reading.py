"""The joints and drivers of a scene of space in plain numbers, as every adapter builds from them.

Lengths are in units of the mechanism's size and seen from its first ground point, as in the plane.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, field, replace
from functools import cached_property
from itertools import product
from typing import Any

import numpy as np

from crosscheck.engines import Array
from crosscheck.engines.spatial.kinds import JointKind
from crosscheck.engines.spatial.passive import Line, spins
from crosscheck.engines.spatial.turning import about_z, joint_frame
from refkin import joints
from refkin.model import Mechanism
from refkin.motion_laws import Law

MEETING = frozenset({JointKind.SPHERICAL, JointKind.REVOLUTE, JointKind.UNIVERSAL, JointKind.FIXED})
"""Joints whose two points are one."""
SHAPES: Mapping[tuple[type[joints.Element], ...], JointKind] = {
    (joints.PointsMeet,): JointKind.SPHERICAL,
    (joints.PointsMeet, joints.AxesParallel): JointKind.REVOLUTE,
    (joints.AxesParallel, joints.PointOnAxis): JointKind.CYLINDRICAL,
    (joints.AxesParallel, joints.PointOnAxis, joints.TurnAboutAxis): JointKind.PRISMATIC,
    (joints.PointsMeet, joints.AxesPerpendicular): JointKind.UNIVERSAL,
    (joints.PointsMeet, joints.AxesParallel, joints.TurnAboutAxis): JointKind.FIXED,
    (joints.AxesParallel, joints.PointOnAxis, joints.ScrewMotion): JointKind.SCREW,
    (joints.SpatialPointDistance,): JointKind.DISTANCE,
    (joints.AxesParallel,): JointKind.PARALLEL,
    (joints.AxesPerpendicular,): JointKind.PERPENDICULAR,
    (joints.PointInPlane,): JointKind.ON_PLANE,
    (joints.PointOnAxis,): JointKind.ON_LINE,
    (joints.AxesParallel, joints.TurnAboutAxis): JointKind.ORIENTATION,
    (joints.TurnAboutAxis,): JointKind.TWIST,
    (joints.ScrewMotion,): JointKind.THREAD,
}
"""What a joint of these elements is, in whatever order it has them; its rows are those of the elements in this one."""
LARGEST_FIRST = sorted(SHAPES.items(), key=lambda shape: -len(shape[0]))
KEYS = ("point_i", "point_j", "axis_i", "axis_j", "zero_i", "zero_j")
DRIVEN: Mapping[type[joints.Element], JointKind] = {
    joints.TurnAboutAxis: JointKind.ANGLE,
    joints.ShiftAlongAxis: JointKind.DISPLACEMENT,
    joints.SpatialPointDistance: JointKind.DISTANCE,
}
"""What a driver of this element moves."""
F, G, H = 0, 1, 2
SAME: tuple[Any, ...] = (("dot", F, H), ("dot", G, H))
ON_AXIS: tuple[Any, ...] = (("along", F), ("along", G))
UNTURNED, CROSSED = ("dot", F, G), ("dot", H, H)
ROWS: dict[str, tuple[Any, ...]] = {
    **dict.fromkeys((JointKind.CYLINDRICAL, JointKind.SCREW), SAME + ON_AXIS),
    JointKind.PRISMATIC: (*SAME, *ON_AXIS, UNTURNED),
    **dict.fromkeys((JointKind.FIXED, JointKind.ORIENTATION), (*SAME, UNTURNED)),
    JointKind.TURN: (UNTURNED,),
    JointKind.PARALLEL: SAME,
    JointKind.ON_LINE: ON_AXIS,
    JointKind.ON_PLANE: (("along", H),),
    **dict.fromkeys((JointKind.UNIVERSAL, JointKind.PERPENDICULAR), (CROSSED,)),
}
"""What single axes hold of a joint beside points that meet, in the order of its rows.

Axis a of i is perpendicular to axis b of j ("dot"), or the points differ by nothing along axis a of i ("along").
"""
AXIAL = frozenset(kind for shape, kind in SHAPES.items() if joints.AxesParallel in shape)
"""Joints whose two axes have one direction."""
COUNTED = frozenset(kind for shape, kind in SHAPES.items() if joints.ScrewMotion in shape)
"""Joints whose turns count."""
MOVED: Mapping[JointKind, tuple[JointKind, ...]] = {
    JointKind.ANGLE: (JointKind.REVOLUTE, JointKind.CYLINDRICAL, JointKind.SCREW),
    JointKind.DISPLACEMENT: (JointKind.PRISMATIC, JointKind.CYLINDRICAL, JointKind.SCREW),
}
"""Of which joints a driver moves a coordinate."""


@dataclass(frozen=True, kw_only=True)
class Hold:
    """A joint between bodies i and j: its points u (3,), each in its body's frame, and what is said of them.

    Its frames (3, 3) have columns f, g, h (`joint_frame`); of a joint without axes they are the identity. `length` is a
    distance, `pitch` a screw's length for each radian, `shift` its length at angle zero. `rows` are those of the joint
    that are its own, in the order of `SHAPES`.
    """

    name: str
    kind: JointKind
    rows: tuple[int, ...] = ()
    body_i: str
    body_j: str
    u_i: Any
    u_j: Any
    frame_i: Any = field(default_factory=lambda: np.eye(3))
    frame_j: Any = field(default_factory=lambda: np.eye(3))
    length: float = 0.0
    pitch: float = 0.0
    shift: float = 0.0

    @property
    def bodies(self) -> tuple[str, str]:
        """The names of bodies i and j."""
        return self.body_i, self.body_j

    def end(self, body: str) -> tuple[Any, Any]:
        """Return point and frame on one of its bodies."""
        return (self.u_i, self.frame_i) if body == self.body_i else (self.u_j, self.frame_j)

    def other(self, body: str) -> str:
        """Return the other body."""
        return self.body_j if body == self.body_i else self.body_i


@dataclass(frozen=True, kw_only=True)
class Drive:
    """A driver: an angle or a displacement of a joint, or the distance of two points, follows a law over `size`."""

    name: str
    kind: JointKind
    hold: Hold
    law: Any
    size: float = 1.0
    row: int = 0

    def value(self, t: Any, order: int = 0) -> Any:
        """Return the law, or a derivative of it, at a time or times (B,) [s], in the numbers' unit."""
        return (self.law(t, order) + 0.0 * t) / self.size


@dataclass(frozen=True, kw_only=True)
class Wheels:
    """A gear: radius times turn of two joints, from i to j, turns counted, add up to `sum`; radii over the larger."""

    name: str
    joints: tuple[str, str]
    radii: tuple[float, float]
    sum: float


@dataclass(frozen=True, kw_only=True)
class Numbers:
    """A mechanism of space: bodies in their order, joints, drivers, gears; size [m] and origin [m] of the lengths."""

    bodies: tuple[str, ...]
    holds: tuple[Hold, ...]
    drives: tuple[Drive, ...]
    gears: tuple[Wheels, ...]
    size: float
    origin: Any

    @cached_property
    def counted(self) -> frozenset[str]:
        """The joints whose turns count: screws, and those in gear."""
        screws = (hold.name for hold in self.holds if hold.kind in COUNTED)
        return frozenset((*screws, *(name for gear in self.gears for name in gear.joints)))

    @cached_property
    def passive(self) -> tuple[dict[str, Line], ...]:
        """Bodies that spin freely about a line while nothing else moves: those of each spin, with the line in each."""
        return tuple(spins(self.bodies, self.holds, self.drives))

    def levels(self, coordinates: Any, order: int) -> Any:
        """Return coordinates or rates (7 bodies, T) of this unit as those of the scene, in metres."""
        out = np.array(coordinates, float)
        for axis in range(3):
            out[axis::7] = out[axis::7] * self.size + (0.0 if order else self.origin[axis])
        return out

    def scaled(self, estimate: Any) -> Array:
        """Return a pose (7,) of the scene in this unit, its Euler parameters of length 1."""
        r, p = np.array(estimate[:3], float), np.array(estimate[3:], float)
        return np.concatenate([(r - self.origin) / self.size, p / np.linalg.norm(p)])


@dataclass(frozen=True)
class Given:
    """A joint, a part of one, or a driver in the scene's own numbers [m]: kind, bodies i and j, what is said of each.

    `joint` is the name of the joint that a driver moves, "" if there is none; `rows` are those of the joint that it is.
    """

    name: str
    kind: JointKind
    rows: tuple[int, ...]
    bodies: tuple[str, str]
    points: tuple[Any, Any]
    axes: tuple[Any, Any]
    zeros: tuple[Any, Any]
    length: float
    pitch: float
    shift: float
    angle: float
    laws: tuple[Law, ...]
    joint: str


def given(mechanism: Mechanism) -> Iterator[Given]:
    """Yield the joints, then the drivers of a mechanism of space, as their elements have them; but for gears.

    A joint of elements that are together none of `SHAPES` is yielded in parts, the largest that are, then those of
    single elements; what is not known here, or not said by elements, as `OTHER`.
    """
    for constraint in mechanism.constraints:
        elements: list[Any] = list(joints.elements_of([constraint]))
        of_two = [e for e in elements if not isinstance(e, joints.GearedTurns)]
        for e in of_two or [constraint] * (not elements):
            if e is constraint or (e.laws and type(e) not in DRIVEN):
                yield _given(constraint.name, JointKind.OTHER, [e], "")
            elif e.laws:
                own = constraint.name if len(elements) > 1 else ""  # a joint with a motor
                yield _given(constraint.name, DRIVEN[type(e)], [e], getattr(constraint, "joint", own))
        for kind, part in parts([e for e in of_two if not e.laws]):
            yield _given(constraint.name, kind, part, "")


def parts(elements: Sequence[Any]) -> Iterator[tuple[JointKind, list[Any]]]:
    """Yield what elements are, and which, each once: the largest of `SHAPES` first, whatever order they come in."""
    left = list(elements)
    for shape, kind in LARGEST_FIRST:
        while {type(e) for e in left}.issuperset(shape):
            plain = [e for e in left if len(shape) == 1 or not getattr(e, "angle", 0.0)]  # what is turned stands alone
            groups = product(*([e for e in plain if type(e) is t] for t in shape))
            if (group := next(filter(_alike, groups), None)) is None:
                break
            left = [e for e in left if not any(e is own for own in group)]
            tied = kind is JointKind.TWIST and any(_keeps_parallel(e, *group) for e in elements)
            yield JointKind.TURN if tied else kind, list(group)
    yield from ((JointKind.OTHER, [e]) for e in left)


def _keeps_parallel(e: Any, turn: Any) -> bool:
    same = e.bodies == turn.bodies and isinstance(e, joints.AxesParallel)
    return same and (e.axis_i, e.axis_j) == (turn.axis_i, turn.axis_j)


def _alike(group: Sequence[Any]) -> bool:
    """Whether elements say what they say of the same bodies, points, axes and zeros."""
    said = [[one.bodies, *(getattr(one, key, None) for key in KEYS)] for one in group]
    return len(group) == 1 or all(len({*values} - {None}) < 2 for values in zip(*said, strict=True))


def _given(name: str, kind: JointKind, elements: list[Any], joint: str) -> Given:
    def said(key: str) -> tuple[Any, Any]:
        values = ([getattr(e, f"{key}_{side}", None) for e in elements] for side in "ij")
        one, other = (next((v for v in group if v is not None), None) for group in values)
        return one, other

    return Given(
        name=name,
        kind=kind,
        rows=tuple(getattr(e, "row", 0) + k for e in elements for k in range(e.rows)),
        bodies=elements[0].bodies,
        points=said("point"),
        axes=said("axis"),
        zeros=said("zero"),
        laws=elements[0].laws,
        joint=joint,
        **{key: getattr(elements[-1], key, 0.0) for key in ("length", "pitch", "shift", "angle")},
    )


def numbers_of(mechanism: Mechanism, unit: Any = None) -> Numbers:
    """Return a mechanism of space: joints, then drivers that know the joint they move; by default in its own unit."""
    unit = mechanism.unit() if unit is None else unit
    origin = np.array([*unit.origin, 0.0, 0.0, 0.0][:3], float)
    every = list(given(mechanism))
    whole = [(g, _hold(g, unit.size, origin)) for g in every if not g.laws]
    drives = tuple(
        Drive(
            name=g.name,
            kind=g.kind,
            hold=next(_moved(g, whole), None) or _hold(replace(g, name=g.joint or g.name), unit.size, origin),
            law=g.laws[0],
            size=1.0 if g.kind == JointKind.ANGLE else unit.size,
            row=g.rows[0],
        )
        for g in every
        if g.laws
    )
    bodies = tuple(body.name for body in mechanism.bodies)
    holds = tuple(hold for _, hold in whole)
    wheels = [e for e in joints.elements_of(mechanism.constraints) if isinstance(e, joints.GearedTurns)]
    gears = tuple(_wheels(e, max(abs(e.radius_i), abs(e.radius_j))) for e in wheels)
    return Numbers(bodies=bodies, holds=holds, drives=drives, gears=gears, size=unit.size, origin=origin)


def _wheels(e: Any, largest: float) -> Wheels:
    radii = e.radius_i / largest, e.radius_j / largest
    total = radii[0] * e.phi0_i + radii[1] * e.phi0_j
    return Wheels(name=e.name, joints=(e.joint_i, e.joint_j), radii=radii, sum=total)


def _moved(driver: Given, holds: Sequence[tuple[Given, Hold]]) -> Iterator[Hold]:
    """Yield of the parts of a driver's joint those that have the coordinate it moves, then those of parallel axes."""
    for kinds in (MOVED.get(driver.kind, ()), AXIAL):
        for part, hold in holds:
            ends = zip(driver.points + driver.axes + driver.zeros, part.points + part.axes + part.zeros, strict=True)
            same = all(own is None or own == other for own, other in ends)
            if part.name == driver.joint and part.kind in kinds and same:
                yield hold


def _hold(g: Given, size: float, origin: Array) -> Hold:
    ends: dict[str, Any] = {}
    for side, body, point, axis, zero in zip("ij", g.bodies, g.points, g.axes, g.zeros, strict=True):
        at = np.array((0.0, 0.0, 0.0) if point is None else point, float)
        ends[f"body_{side}"] = body
        ends[f"u_{side}"] = (at - origin if body == joints.GROUND and point is not None else at) / size
        if axis is not None:
            ends[f"frame_{side}"] = joint_frame(axis, zero)
    if g.angle and not g.laws:
        ends["frame_i"] = ends["frame_i"] @ about_z(g.angle)
    ends |= {"length": g.length / size, "pitch": g.pitch / size, "shift": g.shift / size}
    return Hold(name=g.name, kind=g.kind, rows=g.rows, **ends)
