"""A scene as a closed form sees it: rigid groups, the nodes where their points meet, and rows between them.

Points that coincide are no equation here: they become one *node*, which both bodies hold. Three rows remain:

============== ============================== ======================================
`AngleRow`     phi_j - phi_i = f              angle
`LineRow`      normal_i . (r_j - r_i) = f     point on line, coordinate of a point
`DistanceRow`  |r_j - r_i| = |f|              distance
============== ============================== ======================================

And where two loci of a point meet: two lines, a line and a circle, two circles. All of class II rests on these three.
With g_1, g_2 the gradients of the two loci at the meeting point (a line's normal, a circle's radius vector), the sign
of g_1 x g_2 tells the two meeting points apart. It is the sign of the determinant of the dyad's loop Jacobian, so it
cannot change along a motion away from a singular pose.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field
from functools import partial

import numpy as np

from crosscheck.engines.closed_form.jets import ONE, ZERO, Arithmetic, Jet, Mask, Number, Planar, Spin
from crosscheck.engines.closed_form.laws import law_jet
from refkin import joints
from refkin.model import Scene


@dataclass(frozen=True)
class LineLocus:
    """normal . p = level."""

    normal: Planar
    level: Jet


@dataclass(frozen=True)
class CircleLocus:
    """|p - centre|^2 = square: a square keeps the digits of its derivatives where the radius is short."""

    centre: Planar
    square: Jet

    def gap(self, point: Planar) -> Jet:
        """Return half of what the square of a point's distance is too large."""
        arm = point - self.centre
        return (arm.dot(arm) - self.square).times(0.5)


Locus = LineLocus | CircleLocus
Rows = Callable[[Planar, str], tuple[Number, Number, Number]]


@dataclass(frozen=True)
class Slack:
    """A number that must not be negative if the loci are to meet: `scale` bounds its terms, `name` says what it is.

    Where it is 0 both meeting points are one; `rate` is its derivative in time.
    """

    value: Number
    rate: Number
    scale: Number
    name: str


@dataclass(frozen=True)
class Intersection:
    """The meeting points foot + sign * chord; sign of g_1 x g_2. Without a chord there is one point.

    Foot and chord are values; `moving` returns the point at the given end of the chord with its derivatives.
    """

    foot: Planar
    chord: Planar | None
    absent: Mask
    singular: Mask
    slacks: tuple[Slack, ...]
    moving: Callable[[Planar], Planar] = Planar.still

    def point(self, sign: float) -> Planar:
        """Return the meeting point of the given orientation, +1 or -1."""
        if self.chord is None:
            return self.foot
        return self.moving(self.chord if sign > 0 else Planar(ZERO, ZERO) - self.chord)


def meet(one: Locus, two: Locus, arithmetic: Arithmetic) -> Intersection:
    """Return where two loci meet.

    Parameters
    ----------
    one, two, arithmetic : Locus, Locus, Arithmetic
        Not a circle and a line in this order.
    """
    if isinstance(one, LineLocus):
        return _lines(one, two, arithmetic) if isinstance(two, LineLocus) else _line_and_circle(one, two, arithmetic)
    assert isinstance(two, CircleLocus), "a line comes before a circle"
    return _circles(one, two, arithmetic)


def _lines(one: LineLocus, two: LineLocus, arithmetic: Arithmetic) -> Intersection:
    """Solve n_1 . p = k_1, n_2 . p = k_2 by Cramer: singular where the lines are parallel."""
    det = one.normal.cross(two.normal)
    x = (one.level * two.normal.y - two.level * one.normal.y) / det
    y = (one.normal.x * two.level - two.normal.x * one.level) / det
    _, parallel = arithmetic.sign(det.v, 1.0)
    return Intersection(Planar(x, y), None, np.zeros_like(parallel), parallel, ())


def _line_and_circle(line: LineLocus, circle: CircleLocus, arithmetic: Arithmetic) -> Intersection:
    """Solve n . p = k, |p - c| = r: p = c + d n + s h n.perp() with d = k - n . c and h^2 = (r - d)(r + d).

    n x (p - c) = s h.
    """
    d, radius = line.level - line.normal.dot(circle.centre), circle.square.sqrt()
    slack = radius - _magnitude(d)
    scale = radius.v + abs(line.level.v) + _reach(circle.centre)
    slacks = (Slack(slack.v, slack.d, scale, "radius - distance of the line"),)
    absent, singular = _judge(slacks, arithmetic)
    h = _root((radius.v - d.v) * (radius.v + d.v), singular, arithmetic)
    seen = CircleLocus(Planar(ZERO, ZERO), circle.square)
    normal, foot = line.normal.still(), line.normal.still().times(d.v)

    def rows(arm: Planar, part: str) -> tuple[Number, Number, Number]:
        return getattr(line.normal.dot(arm) - d, part), getattr(seen.gap(arm), part), d.v

    moving = partial(_moving, circle.centre, foot, normal, rows)
    return Intersection(circle.centre.still() + foot, normal.perp().times(h), absent, singular, slacks, moving)


def _circles(one: CircleLocus, two: CircleLocus, arithmetic: Arithmetic) -> Intersection:
    """Solve |p - c_1| = a, |p - c_2| = b: p = c_1 + x e + s h e.perp(), e along D = |c_2 - c_1|.

    x = (D^2 + (a - b)(a + b)) / (2 D), h = sqrt((a+b-D)(a+b+D)(D+a-b)(D-a+b)) / (2 D) (Heron, factored so that neither
    end of the range cancels); (p - c_1) x (p - c_2) = s h D.
    """
    a, b = one.square.sqrt(), two.square.sqrt()
    span = two.centre - one.centre
    distance = span.length()
    outer, inner = a + b - distance, distance - _magnitude(a - b)
    scale = a.v + b.v + distance.v + _reach(one.centre) + _reach(two.centre)
    slacks = (Slack(outer.v, outer.d, scale, "(a + b) - D"), Slack(inner.v, inner.d, scale, "D - |a - b|"))
    absent, singular = _judge(slacks, arithmetic)
    total, difference, long = a.v + b.v, a.v - b.v, distance.v
    heron = (total - long) * (total + long) * (long + difference) * (long - difference)
    x = (long * long + difference * total) / (long + long)
    h = _root(heron, singular, arithmetic) / (long + long)
    e = span.still().over(Jet(long))
    foot, shorter = e.times(x), np.asarray(a.v <= b.v, bool)
    seen, other = CircleLocus(Planar(ZERO, ZERO), one.square), CircleLocus(span, two.square)

    def rows(arm: Planar, part: str) -> tuple[Number, Number, Number]:
        near, far = (getattr(circle.gap(arm), part) for circle in (seen, other))
        return (near - far) / long, np.where(shorter, near, far), np.where(shorter, x, x - long)

    moving = partial(_moving, one.centre, foot, e, rows)
    return Intersection(one.centre.still() + foot, e.perp().times(h), absent, singular, slacks, moving)


def _moving(centre: Planar, foot: Planar, e: Planar, rows: Rows, chord: Planar) -> Planar:
    """Return centre + foot + chord with its derivatives: those that keep two rows zero, found one after the other.

    A row is linear in the highest derivative, which so has to cancel what the row is without it: its component along
    the unit vector e is found from the first row, then that along the chord from the second, whose gradient is `reach`
    e + chord. Each row then holds to the rounding of its own terms, however short the chord is. To differentiate the
    root that gives the chord would lose digits as its length to the power -3.

    Parameters
    ----------
    centre : Planar
    foot, e, chord : Planar
        Values, the foot seen from the centre.
    rows : callable
        The point seen from the centre, "d" or "a" -> this of the row along e and of the second row, and `reach`.
    """
    arm, square = foot + chord, chord.dot(chord).v
    for part in "da":
        row, own, reach = rows(arm, part)
        across = (reach * row - own) / square
        arm = arm.with_part(part, chord.times(across) - e.times(row))
    return centre + arm


def _magnitude(x: Jet) -> Jet:
    """Return |x| with its rate; the second derivative is not used."""
    sign = np.where(np.asarray(x.v < 0, bool), -1, 1)
    return Jet(abs(x.v), 0 if type(x.d) is int else x.d * sign)


def _reach(point: Planar) -> Number:
    return abs(point.x.v) + abs(point.y.v)


def _judge(slacks: tuple[Slack, ...], arithmetic: Arithmetic) -> tuple[Mask, Mask]:
    signs = [arithmetic.sign(slack.value, slack.scale) for slack in slacks]
    absent = np.logical_or.reduce([negative for negative, _ in signs])
    return absent, np.logical_or.reduce([zero for _, zero in signs]) & ~absent


def _root(square: Number, zero: Mask, arithmetic: Arithmetic) -> Number:
    return np.sqrt(arithmetic.clipped(square, zero) if np.any(zero) else square)


Place = tuple[str, joints.Pair]
"""A point of a body: the body's name, the point in its frame."""


@dataclass(frozen=True)
class AngleRow:
    """phi_j - phi_i = value."""

    name: str
    body_i: str
    body_j: str
    value: Jet


@dataclass(frozen=True)
class LineRow:
    """normal . (r_node - anchor) = value, with the anchor and the unit normal fixed in body i."""

    name: str
    body_i: str
    anchor: Planar
    normal: Planar
    node: int
    value: Jet


@dataclass(frozen=True)
class DistanceRow:
    """|r_b - r_a| = value."""

    name: str
    node_a: int
    node_b: int
    value: Jet


@dataclass(frozen=True)
class JetPose:
    """A frame in another: its angle, the rotation by that angle, its origin."""

    angle: Jet
    turn: Planar
    origin: Planar

    def point(self, local: Planar) -> Planar:
        """Return a point of the frame in the other."""
        return self.origin + self.turn * local

    def after(self, outer: JetPose) -> JetPose:
        """Return this frame in the frame in which `outer` is given."""
        spin = Spin(outer.angle + self.angle, outer.turn.still() * self.turn.still())
        return JetPose(spin.angle, spin.turn, outer.point(self.origin))


@dataclass(eq=False)
class RigidGroup:
    """Bodies whose poses in one frame are known, with the nodes they hold, in that frame.

    `family` numbers the groups whose angles against each other are known; `spin` is the rotation in the
    family.
    """

    bodies: dict[str, JetPose]
    nodes: dict[int, Planar]
    family: int
    spin: Spin


@dataclass
class GroupedScene:
    """A scene in groups and rows; `places` are the points that make up each node, `labels` what to call it."""

    groups: list[RigidGroup] = field(default_factory=list)
    angles: list[AngleRow] = field(default_factory=list)
    lines: list[LineRow] = field(default_factory=list)
    distances: list[DistanceRow] = field(default_factory=list)
    places: list[tuple[Place, ...]] = field(default_factory=list)
    labels: list[str] = field(default_factory=list)
    origin: joints.Pair = (0.0, 0.0)


def read_linkage(scene: Scene, arithmetic: Arithmetic) -> GroupedScene:
    """Return the groups (one per body, ground first), nodes and rows of a scene; lengths in metres."""
    # Seen from the first joint point on the ground: floats keep their digits when a mechanism stands far out.
    on_ground = (point for c in scene.mechanism.constraints for body, point in c.points() if body == joints.GROUND)
    linkage = GroupedScene(origin=next(on_ground, (0.0, 0.0)))
    nodes = _nodes(scene, linkage)
    for name in (joints.GROUND, *(body.name for body in scene.mechanism.bodies)):
        held = {k: _local(linkage, place, arithmetic) for place, k in nodes.items() if place[0] == name}
        still = JetPose(ZERO, Planar(ONE, ZERO), Planar(ZERO, ZERO))
        linkage.groups.append(RigidGroup({name: still}, held, len(linkage.groups), Spin(ZERO, still.turn)))
    for element in joints.elements_of(scene.mechanism.constraints):
        _read_rows(linkage, element, nodes, scene, arithmetic)
    return linkage


def _local(linkage: GroupedScene, place: Place, arithmetic: Arithmetic) -> Planar:
    body, (x, y) = place
    ox, oy = linkage.origin if body == joints.GROUND else (0.0, 0.0)
    number = arithmetic.number
    return Planar(*(Jet(number(a) - number(o)) if a != o else ZERO for a, o in ((x, ox), (y, oy))))


def _nodes(scene: Scene, linkage: GroupedScene) -> dict[Place, int]:
    """Return the node of every joint point; points that coincide share one."""
    members: dict[Place, list[Place]] = {}
    names: dict[Place, str] = {}
    for element in joints.elements_of(scene.mechanism.constraints):
        places = [(body, (float(point[0]), float(point[1]))) for body, point in element.ends]
        for place in places:
            members.setdefault(place, [place])
            names.setdefault(place, element.name)
        if isinstance(element, joints.PointsCoincide) and members[places[0]] is not members[places[1]]:
            merged = members[places[0]] + members[places[1]]
            members.update(dict.fromkeys(merged, merged))
    node: dict[Place, int] = {}
    for place, together in members.items():
        if place not in node:
            node.update(dict.fromkeys(together, len(linkage.places)))
            linkage.places.append(tuple(together))
            linkage.labels.append(f"the point of {names[place]!r}")
    return node


def _read_rows(
    linkage: GroupedScene, e: joints.Element, nodes: dict[Place, int], scene: Scene, arithmetic: Arithmetic
) -> None:
    """Append the row of one element, if it is one."""
    number, name = arithmetic.number, e.name
    law = law_jet(e.laws[0], scene.times, arithmetic) if e.laws else None
    ends = [nodes[body, (float(point[0]), float(point[1]))] for body, point in e.ends]
    if isinstance(e, joints.RelativeAngle):
        linkage.angles.append(AngleRow(name, e.body_i, e.body_j, Jet(number(e.angle)) if law is None else law))
    elif isinstance(e, joints.GuidedPoint):
        anchor = _local(linkage, (e.body_i, e.point_i), arithmetic)
        normal, level = unit_normal(e.axis_i, arithmetic), Jet(number(e.offset))
        linkage.lines.append(LineRow(name, e.body_i, anchor, normal, ends[1], level))
    elif isinstance(e, joints.PointCoordinate):
        assert law is not None
        along = Planar(ZERO, ONE) if e.axis else Planar(ONE, ZERO)
        origin = _local(linkage, (joints.GROUND, (0.0, 0.0)), arithmetic)
        linkage.lines.append(LineRow(name, joints.GROUND, origin, along, ends[0], law))
    elif isinstance(e, joints.PointDistance):
        length = Jet(number(e.length)) if law is None else (law * law).sqrt()
        linkage.distances.append(DistanceRow(name, ends[0], ends[1], length))


def unit_normal(axis: joints.Pair, arithmetic: Arithmetic) -> Planar:
    """Return the axis turned by a quarter turn counter-clockwise, of length 1."""
    x, y = (Jet(arithmetic.number(c)) if c else ZERO for c in axis)
    return Planar(x, y).perp().over(Planar(x, y).length())
