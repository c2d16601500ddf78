"""Joins rigid groups until every body is on the ground.

Four deductions suffice for every group of class II:

1. An angle row puts two groups into one family: their angle against each other is known.
2. Two groups of one family that share a node are one group.
3. Two groups that share two nodes are one group: the nodes give the angle.
4. Two groups of one family with two rows between them are one group; two rows between a group and a lone node
   put the node into the group. Each row is a line or a circle, so `linkage` says where they meet. A row is a line row,
   a distance row, or a *link*: a third group that shares a node with either side holds the two nodes at a distance.

RRR: the inner pin is a lone node with two links. RRP: slider and guide are of one family, with a line row and a link.
RPR: the two sliding bodies are of one family, with a line row, and what they are pinned to is their link. A point on a
line, a massless link, a driven coupler, a four-bar driven by its coupler angle: the same deductions in other places.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, field
from itertools import combinations

import numpy as np

from crosscheck.engines.closed_form.jets import (
    ZERO,
    Arithmetic,
    Jet,
    Mask,
    Planar,
    Spin,
    count_turns,
    midpoint,
    spin_between,
)
from crosscheck.engines.closed_form.linkage import (
    AngleRow,
    CircleLocus,
    DistanceRow,
    GroupedScene,
    Intersection,
    JetPose,
    LineLocus,
    LineRow,
    Locus,
    RigidGroup,
    meet,
)
from refkin.joints import GROUND
from refkin.model import Scene

DECISIVE = 0.1
"""Sine of the angle between two gradients above which the estimate's own orientation decides; else the nearer pose."""


class NotDyadic(Exception):
    """A mechanism that these deductions do not place; the message names what is left."""


@dataclass(frozen=True)
class LocusRow:
    """A line or circle for the position of one group in another, and its gradient's direction in the estimates."""

    locus: Locus
    gradient: complex | None
    name: str


@dataclass
class Assembly:
    """The state of a solve: groups so far, the ground's first; what failed when, what no estimate decided."""

    linkage: GroupedScene
    scene: Scene
    arithmetic: Arithmetic
    absent: Mask = field(init=False)
    singular: Mask = field(init=False)
    remarks: list[str] = field(default_factory=list)
    unsure_turns: Mask = field(init=False)
    turns_of: Callable[[int], np.ndarray] | None = None
    known_angles: list[np.ndarray] = field(default_factory=list)
    meetings: list[Intersection] = field(default_factory=list)

    def __post_init__(self) -> None:
        count, self.groups = len(self.scene.times), self.linkage.groups
        self.absent, self.singular = np.zeros(count, bool), np.zeros(count, bool)
        self.unsure_turns = np.zeros(max(count - 1, 0), bool)
        self.estimates = {b.name: b.estimate for b in self.scene.mechanism.bodies if b.estimate is not None}

    def run(self) -> RigidGroup:
        """Join everything to the ground and return that group; NotDyadic if one is left, or an angle is given twice."""
        for row in self.linkage.angles:
            self._join_families(row)
        while len(self.groups) > 1:
            if not (self._share_node() or self._share_two_nodes() or self._meet_clusters() or self._meet_nodes()):
                left = ", ".join(repr(name) for group in self.groups[1:] for name in group.bodies)
                raise NotDyadic(f"no dyad places {left}: a group of higher class, or bodies that are not held")
        return self.groups[0]

    # the deductions

    def _join_families(self, row: AngleRow) -> None:
        i, j = self._group_of(row.body_i), self._group_of(row.body_j)
        if i.family == j.family:
            raise NotDyadic(f"{row.name!r} gives an angle that is already given")
        self._move_family(j, i.spin + Spin(row.value, Planar(*row.value.cos_sin())) - j.spin, i.family)

    def _share_node(self) -> bool:
        for g, x in combinations(self.groups, 2):
            common = g.nodes.keys() & x.nodes.keys()
            if g.family == x.family and common:
                node = min(common)
                turn = (x.spin - g.spin).turn
                self._absorb(g, x, g.nodes[node] - turn * x.nodes[node])
                return True
        return False

    def _share_two_nodes(self) -> bool:
        for g, x in combinations(self.groups, 2):
            common = sorted(g.nodes.keys() & x.nodes.keys())
            if len(common) > 1:
                n, m = common[0], common[1]
                in_g, in_x = g.nodes[m] - g.nodes[n], x.nodes[m] - x.nodes[n]
                spin = spin_between(in_x, in_g)
                angle = self._unwrapped(spin.angle, g, x)
                self._move_family(x, g.spin + Spin(angle, spin.unit) - x.spin, g.family)
                self._absorb(g, x, g.nodes[n] - spin.turn * x.nodes[n])
                return True
        return False

    def _meet_clusters(self) -> bool:
        for g, x in combinations(self.groups, 2):
            if g.family == x.family:
                rows = list(self._rows(g, x))
                if len(rows) > 1:
                    self._absorb(g, x, self._meeting_point(g, rows, ", ".join(x.bodies)))
                    return True
        return False

    def _meet_nodes(self) -> bool:
        for g in self.groups:
            for node, label in enumerate(self.linkage.labels):
                if node in g.nodes:
                    continue
                rows = list(self._rows(g, RigidGroup({}, {node: Planar(ZERO, ZERO)}, g.family, g.spin)))
                if len(rows) > 1:
                    g.nodes[node] = self._meeting_point(g, rows, label)
                    return True
        return False

    # joining

    def _group_of(self, body: str) -> RigidGroup:
        return next(group for group in self.groups if body in group.bodies)

    def _move_family(self, x: RigidGroup, by: Spin, family: int) -> None:
        """Turn the whole family of x, and rename it."""
        moved = x.family
        for group in self.groups:
            if group.family == moved:
                group.spin = group.spin + by
                group.family = family

    def _absorb(self, g: RigidGroup, x: RigidGroup, origin: Planar) -> None:
        """Put x, of g's family, into g with its frame's origin there."""
        spin = x.spin - g.spin
        frame = JetPose(spin.angle, spin.turn, origin)
        g.bodies.update({name: pose.after(frame) for name, pose in x.bodies.items()})
        g.nodes.update({node: frame.point(local) for node, local in x.nodes.items() if node not in g.nodes})
        self.groups.remove(x)

    # rows between two groups of one family, as loci of the origin of x in the frame of g

    def _rows(self, g: RigidGroup, x: RigidGroup) -> Iterator[LocusRow]:
        turn = (x.spin - g.spin).turn
        for line in self.linkage.lines:
            locus = _line_locus(line, g, x, turn)
            if locus is not None:
                angle = self._body_angle(line.body_i)
                gradient = None if angle is None else _start(line.normal) * complex(math.cos(angle), math.sin(angle))
                yield LocusRow(locus, gradient, line.name)
        held = set[tuple[int, int]]()
        for row in self.linkage.distances:
            for a, b in ((row.node_a, row.node_b), (row.node_b, row.node_a)):
                if a in g.nodes and b in x.nodes:
                    held.add((a, b))
                    yield self._circle_row(g, x, a, b, turn, row)
        for link in self.groups:
            ends = [sorted(link.nodes.keys() & side.nodes.keys()) for side in (g, x)]
            if link is not g and link is not x and ends[0] and ends[1]:
                a, b = ends[0][0], ends[1][0]
                if (a, b) not in held:  # else the row that placed one of them, once more
                    yield self._circle_row(g, x, a, b, turn, link)

    def _circle_row(
        self, g: RigidGroup, x: RigidGroup, a: int, b: int, turn: Planar, by: DistanceRow | RigidGroup
    ) -> LocusRow:
        if isinstance(by, DistanceRow):
            square, name = by.value * by.value, by.name
        else:
            link = by.nodes[b] - by.nodes[a]
            square, name = link.dot(link), "link " + ", ".join(by.bodies)
        ends = self._estimate(a), self._estimate(b)
        gradient = None if ends[0] is None or ends[1] is None else ends[1] - ends[0]
        return LocusRow(CircleLocus(g.nodes[a] - turn * x.nodes[b], square), gradient, name)

    def _meeting_point(self, g: RigidGroup, rows: Sequence[LocusRow], what: str) -> Planar:
        one, two = sorted(rows[:2], key=lambda row: isinstance(row.locus, CircleLocus))
        meeting = meet(one.locus, two.locus, self.arithmetic)
        self.meetings.append(meeting)
        self._note(meeting, what, (one.name, two.name))
        return meeting.point(self._sign(g, meeting, (one, two), what))

    def _note(self, meeting: Intersection, what: str, names: tuple[str, str]) -> None:
        known = self.absent | self.singular
        absent = np.broadcast_to(meeting.absent, known.shape) & ~known
        singular = np.broadcast_to(meeting.singular, known.shape) & ~known
        for mask, word in ((absent, "cannot be assembled"), (singular, "is at a singular pose")):
            if mask.any():
                k = int(np.argmax(mask))
                values = [(s.name, float(midpoint(np.broadcast_to(s.value, known.shape)[k]))) for s in meeting.slacks]
                gaps = ", ".join(f"{name} = {value:.17g} m" for name, value in values)
                held = f"{names[0]} (a) and {names[1]} (b)"
                self.remarks.append(f"{what} between {held} {word} from t = {self.scene.times[k]:.17g} s: {gaps}")
        self.absent |= absent
        self.singular |= singular

    # which assembly, by the estimates at the first time

    def _sign(self, g: RigidGroup, meeting: Intersection, rows: tuple[LocusRow, LocusRow], what: str) -> float:
        if meeting.chord is None:
            return 1.0
        first, second = rows[0].gradient, rows[1].gradient
        if first is None or second is None:
            self.remarks.append(f"no estimate tells the assembly of {what}: positive orientation taken")
            return 1.0
        cross = (first.conjugate() * second).imag
        if abs(cross) > DECISIVE * abs(first) * abs(second):
            return math.copysign(1.0, cross)
        return self._nearer(g, meeting, rows) or math.copysign(1.0, cross)

    def _nearer(self, g: RigidGroup, meeting: Intersection, rows: tuple[LocusRow, LocusRow]) -> float:
        """Return the sign of the assembly nearer the estimate, 0 if it is right between or nowhere."""
        angle, chord, circle = self._angle_estimate(g), meeting.chord, rows[1].locus
        if angle is None or chord is None or rows[1].gradient is None or not isinstance(circle, CircleLocus):
            return 0.0
        seen = rows[1].gradient * complex(math.cos(angle), -math.sin(angle))
        middle = _start(meeting.foot - circle.centre)
        side = ((seen - middle).conjugate() * _start(chord)).real
        return math.copysign(1.0, side) if side and not math.isnan(side) else 0.0

    def _estimate(self, node: int) -> complex | None:
        """Return where the estimates see a node, or where it is if it is on the ground already."""
        for body, (x, y) in self.linkage.places[node]:
            if body == GROUND:
                return complex(x, y) - complex(*self.linkage.origin)
            if body in self.estimates:
                ex, ey, phi = self.estimates[body]
                turned = complex(x, y) * complex(math.cos(phi), math.sin(phi))
                return complex(ex, ey) + turned - complex(*self.linkage.origin)
        placed = self.groups[0].nodes.get(node)
        return None if placed is None else _start(placed)

    def _body_angle(self, body: str) -> float | None:
        if body in self.estimates:
            return self.estimates[body][2]
        placed = self.groups[0].bodies.get(body)
        return None if placed is None else _first(placed.angle)

    def _angle_estimate(self, group: RigidGroup) -> float | None:
        """Return the angle of a group's frame as the estimates see it."""
        for body, pose in group.bodies.items():
            angle = 0.0 if body == GROUND else self._body_angle(body)
            if angle is not None:
                return angle - _first(pose.angle)
        return None

    # turns

    def _unwrapped(self, angle: Jet, g: RigidGroup, x: RigidGroup) -> Jet:
        """Return the angle of x in g with its turns: nearest the estimate at first, then as its rate carries it."""
        count = len(self.scene.times)
        value, rate = (np.broadcast_to(midpoint(part), (count,)) for part in (angle.v, angle.d))
        if self.turns_of is not None:
            near = self.turns_of(len(self.known_angles))
            turns = np.where(np.isfinite(value) & np.isfinite(near), np.round((near - value) / math.tau), 0.0)
        else:
            in_g, in_x = self._angle_estimate(g), self._angle_estimate(x)
            start = None if in_g is None or in_x is None else in_x - in_g
            turns, unsure = count_turns(np.array(self.scene.times), value, rate, start)
            self.unsure_turns |= unsure
        self.known_angles.append(value + math.tau * turns)
        if not turns.any():
            return angle
        whole = self.arithmetic.row(tuple(2.0 * turns)) * self.arithmetic.pi()
        return Jet(angle.v + whole, angle.d, angle.a)


def _line_locus(line: LineRow, g: RigidGroup, x: RigidGroup, turn: Planar) -> LineLocus | None:
    """Return the line on which the row holds the origin of x in the frame of g, if it is between these two."""
    if line.body_i in g.bodies and line.node in x.nodes:
        pose = g.bodies[line.body_i]
        normal, arm = pose.turn * line.normal, turn * x.nodes[line.node]
        return LineLocus(normal, line.value + normal.dot(pose.point(line.anchor) - arm))
    if line.body_i in x.bodies and line.node in g.nodes:
        pose = x.bodies[line.body_i]
        normal, arm = turn * pose.turn * line.normal, turn * pose.point(line.anchor)
        return LineLocus(normal, normal.dot(g.nodes[line.node] - arm) - line.value)
    return None


def _first(jet: Jet) -> float:
    return float(np.ravel(midpoint(jet.v))[0])


def _start(vector: Planar) -> complex:
    return complex(_first(vector.x), _first(vector.y))
