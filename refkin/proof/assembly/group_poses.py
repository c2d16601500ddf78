"""How one group comes to another: the shift, and the turn if their orientations differ, that close what joins them."""

from __future__ import annotations

from dataclasses import dataclass

from flint import arb

from refkin.proof.assembly.loci import Ball, Circle, Line, Locus, Meeting, length, meet, whole
from refkin.proof.assembly.rows import RowKind
from refkin.vec import Vec


@dataclass(frozen=True)
class GroupPose:
    """Position and angle of a body in its group; groups of one orientation have parallel axes."""

    r: Vec
    phi: Ball
    c: Ball
    s: Ball

    def turned(self, u: Vec) -> Vec:
        """Return A(phi) u."""
        return Vec(self.c * u.x - self.s * u.y, self.s * u.x + self.c * u.y)

    def point(self, u: Vec) -> Vec:
        """Return r + A(phi) u."""
        return self.r + self.turned(u)

    def local(self, x: Vec) -> Vec:
        """Return u with r + A(phi) u = x."""
        d = x - self.r
        return Vec(self.c * d.x + self.s * d.y, self.c * d.y - self.s * d.x)

    def rotated(self, by: GroupPose) -> GroupPose:
        """Return the pose with its group turned about the group's origin by the angle of `by`."""
        c, s = by.c * self.c - by.s * self.s, by.s * self.c + by.c * self.s
        return GroupPose(by.turned(self.r), self.phi + by.phi, c, s)


@dataclass(frozen=True)
class Link:
    """A relation in numbers: p fixed in group A, q in group B."""

    kind: RowKind
    p: Vec
    q: Vec
    normal: Vec
    on_b: bool
    distance: Ball


@dataclass(frozen=True)
class Move:
    """How group B comes to A: turned (if it is), then shifted; and in which assembly mode that is."""

    mode: int | None
    turn: GroupPose | None
    shift: Vec


Moves = tuple[tuple[Move, ...], Meeting]
"""Every move that joins two groups, and the meeting that they come from, or that fails."""


def moves_of_point(links: list[Link]) -> Moves | None:
    """Return where the point of B that two loci of A share can be; as shifts."""
    return _shifts([_locus(k, k.p) for k in links])


def moves_of_group(links: list[Link], turning: bool) -> Moves | None:
    """Return how B comes to A by the given relations, B turning or not; None where loci run along each other."""
    if turning:
        return _from_three_lines(links) if len(links) == 3 else _about_pin(*links)
    if links[0].kind is RowKind.PIN:
        return (Move(None, None, links[0].p - links[0].q),), Meeting()
    return _shifts([_locus(k, k.p - k.q) for k in links])


def _locus(link: Link, at: Vec) -> Locus:
    return Line(at, link.normal) if link.kind is RowKind.LINE else Circle(at, link.distance)


def _shifts(loci: list[Locus]) -> Moves | None:
    met = meet(*loci)
    return None if met is None else (tuple(Move(_mode(met, mode), None, x) for mode, x in met.points), met)


def _mode(met: Meeting, mode: int) -> int | None:
    """Return the assembly mode to be noted: none where there was no choice."""
    return mode if mode or not met.decided else None


def _about_pin(pin: Link, other: Link) -> Moves | None:
    """Turn B about a pin until a second pin, line or distance closes."""
    arm, goal = other.q - pin.q, other.p - pin.p
    met: Meeting | None = Meeting(((0, goal),))
    if other.kind is RowKind.LINE and other.on_b:
        met = meet(Circle(pin.q, length(goal)), Line(other.q, other.normal))
    elif other.kind is RowKind.LINE:
        met = meet(Circle(pin.p, length(arm)), Line(other.p, other.normal))
    elif other.kind is RowKind.DISTANCE:
        met = meet(Circle(pin.p, length(arm)), Circle(other.p, other.distance))
    if met is None:
        return None
    moves = []
    for mode, x in met.points:
        if other.kind is RowKind.LINE and other.on_b:
            turn = _turn(goal, x - pin.q)
        else:
            turn = _turn(goal if other.kind is RowKind.PIN else x - pin.p, arm)
        if turn is None:
            return None
        chosen = None if other.kind is RowKind.PIN else _mode(met, mode)
        moves.append(Move(chosen, turn, pin.p - turn.turned(pin.q)))
    return tuple(moves), met


def _from_three_lines(links: list[Link]) -> Moves | None:
    """Lay three points of one group on three lines of the other (the elliptic trammel): a cos + b sin = d."""
    on_b = links[0].on_b
    points = [k.p if on_b else k.q for k in links]
    lines = [Line(k.q if on_b else k.p, k.normal) for k in links]
    n1, n2, n3 = (line.normal for line in lines)
    det = _cross(n1, n2)
    if det.contains(0):
        return None
    weights = (_cross(n3, n2) / det, _cross(n1, n3) / det, arb(-1))  # n3 = w1 n1 + w2 n2
    a = sum(w * line.normal.dot(q) for w, line, q in zip(weights, lines, points, strict=True))
    b = sum(w * line.normal.dot(q.perp()) for w, line, q in zip(weights, lines, points, strict=True))
    d = sum(w * line.normal.dot(line.through) for w, line in zip(weights, lines, strict=True))
    size = length(Vec(a, b))
    if size.contains(0):
        return None
    zero = arb(0)
    normal = Vec(a, b) * (1 / size)
    met = meet(Circle(Vec(zero, zero), size), Line(normal * d, normal))
    if met is None:
        return None
    moves = []
    for mode, x in met.points:
        turn = _turn(x, Vec(size, zero))
        if turn is None:
            return None
        heights = [line.normal.dot(line.through - turn.turned(q)) for line, q in zip(lines, points, strict=True)]
        shift = Vec((heights[0] * n2.y - heights[1] * n1.y) / det, (n1.x * heights[1] - n2.x * heights[0]) / det)
        if on_b:  # A was laid on B: B lies on A by the inverse
            turn = GroupPose(turn.r, -turn.phi, turn.c, -turn.s)
            shift = turn.turned(shift) * -1
        moves.append(Move(_mode(met, mode), turn, shift))
    return tuple(moves), met


def _turn(to: Vec, arm: Vec) -> GroupPose | None:
    """Return the rotation that turns one vector into the direction of another; None if a vector may be zero."""
    size = length(to) * length(arm)
    if size.contains(0):
        return None
    c, s = arm.dot(to) / size, _cross(arm, to) / size
    # atan2 has its cut at -pi: there the angle is taken from the opposite direction.
    c_all, s_all = whole(c), whole(s)
    phi = arb.atan2(s_all, c_all) if c_all > -0.5 else arb.atan2(-s_all, -c_all) + arb.pi()
    if phi > arb.pi():
        phi = phi - 2 * arb.pi()
    return GroupPose(Vec(arb(0), arb(0)), phi, c, s)


def _cross(a: Vec, b: Vec) -> Ball:
    return a.x * b.y - a.y * b.x
