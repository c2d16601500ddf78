"""The steps of a plan carried out in balls: every branch, and for each that ends, the proof that it does."""

from __future__ import annotations

from collections.abc import Callable, Iterable
from dataclasses import dataclass, field, replace
from functools import partial

from flint import arb

from refkin.joints import GROUND
from refkin.proof.assembly.group_poses import GroupPose, Link, Move, moves_of_group, moves_of_point
from refkin.proof.assembly.loci import Ball, Meeting, length
from refkin.proof.assembly.rigid_groups import AssemblyPlan, Closure, Relation, RelationForm, Step
from refkin.proof.assembly.rows import AssemblyRows, PointRow, RowKind, angles_from
from refkin.vec import Vec

MOST_BRANCHES = 256


@dataclass(frozen=True)
class PlacedBranch:
    """What is placed so far in one assembly.

    Attributes
    ----------
    modes : tuple of int
        The assembly mode: which of the two points of each meeting was taken, step by step; 0 where they coincide.
    decided : bool
        Whether every meeting is proved to exist; if not, the balls still hold every assembly of this branch.
    """

    poses: dict[str, GroupPose]
    pins: tuple[PointRow, ...] = ()
    modes: tuple[int, ...] = ()
    decided: bool = True


@dataclass(frozen=True)
class DeadEnd:
    """The proof that a branch cannot go on: what is missing, in scaled units (or rad), and what that means in words."""

    gap: Ball
    words: Callable[[], str]


@dataclass
class Placement:
    """All branches: those that passed every step, those that ended by proof, those whose loci run along each other."""

    branches: list[PlacedBranch]
    ends: list[DeadEnd] = field(default_factory=list)
    stuck: list[PlacedBranch] = field(default_factory=list)
    truncated: bool = False
    taken: int = 0
    """How many steps were taken, over all branches."""

    @property
    def impossible(self) -> bool:
        """Whether every branch ended by proof."""
        return bool(self.ends) and not (self.branches or self.stuck or self.truncated)


def place(
    plan: AssemblyPlan, rows: AssemblyRows, bodies: Iterable[str], size: float, holding: bool = True
) -> Placement:
    """Carry out a plan.

    Parameters
    ----------
    plan, rows : AssemblyPlan, AssemblyRows
        The order of steps, and what they rest on.
    bodies : iterable of str
        Those of the mechanism.
    size : float
        The unit of length [m], for messages.
    holding : bool
        Whether redundant rows end the branches that violate them.
    """
    start, end = _orientations(rows, (GROUND, *bodies))
    placement = Placement([PlacedBranch(start)] if end is None else [], [] if end is None else [end])
    worker = _Worker(rows.rows, size, holding)
    for step in plan.steps:
        reached: list[PlacedBranch] = []
        placement.taken += len(placement.branches)
        for branch in placement.branches:
            reached += worker.take(step, branch, placement)
        placement.truncated |= len(reached) > MOST_BRANCHES
        placement.branches = reached[:MOST_BRANCHES]
    return placement


def _orientations(rows: AssemblyRows, bodies: tuple[str, ...]) -> tuple[dict[str, GroupPose], DeadEnd | None]:
    """Return each body at the origin of its own group, at the angle that is given; or the two that disagree."""
    angles: dict[str, Ball] = {}
    for body in bodies:
        for relative, gap in angles_from(body, rows.relative_angles, angles) if body not in angles else ():
            words = f"{relative.name} asks for an angle of {relative.j} that is {_number(gap)} rad off"
            return {}, DeadEnd(gap, partial(str, words))
    zero = arb(0)
    return {b: GroupPose(Vec(zero, zero), phi, phi.cos(), phi.sin()) for b, phi in angles.items()}, None


class _Worker:
    """Takes steps; `holding` says whether rows that are not needed to join groups must agree."""

    def __init__(self, rows: tuple[PointRow, ...], size: float, holding: bool) -> None:
        self.rows, self.size, self.holding = rows, size, holding

    def take(self, step: Step, branch: PlacedBranch, placement: Placement) -> list[PlacedBranch]:
        """Return the branches that one branch goes on to, and note in `placement` those that end."""
        for closure in step.candidates:
            links = [self._link(r, step, branch) for r in closure]
            ways = moves_of_point(links) if step.locates else moves_of_group(links, bool(step.turning))
            if ways is None:
                continue
            moves, meeting = ways
            if meeting.gap is not None:
                placement.ends.append(self._cannot_meet(step, closure, meeting, branch))
                return []
            children = [self._child(step, closure, branch, m, meeting.decided) for m in moves]
            return [c for c in children if not self._ends(step, closure, c, placement)]
        placement.stuck.append(branch)
        return []

    def _row(self, k: int, branch: PlacedBranch) -> PointRow:
        return self.rows[k] if k < len(self.rows) else branch.pins[k - len(self.rows)]

    def _link(self, relation: Relation, step: Step, branch: PlacedBranch) -> Link:
        first, second = self._row(relation.first, branch), self._row(relation.second, branch)
        zero = arb(0)
        poses, on_b = branch.poses, relation.line_on_b
        normal = poses[second.i].turned(second.normal) if second.normal else Vec(zero, zero)
        distance = zero if second.distance is None else second.distance
        if relation.form is RelationForm.DIRECT:
            (p, _), (q, _) = _ends_of(second, step.a, poses), _ends_of(second, step.b, poses)
            return Link(relation.kind, p, q, normal, on_b, distance)
        near, far = (step.a, step.b) if relation.form is RelationForm.LINK or on_b else (step.b, step.a)
        (p, c_first), (q, c_second) = _ends_of(first, near, poses), _ends_of(second, far, poses)
        if relation.form is RelationForm.LINK:
            return Link(relation.kind, p, q, normal, on_b, length(c_second - c_first))
        q = q - (c_second - c_first)
        return Link(relation.kind, *((p, q) if on_b else (q, p)), normal, on_b, distance)

    def _child(self, step: Step, closure: Closure, branch: PlacedBranch, move: Move, decided: bool) -> PlacedBranch:
        poses, pins = dict(branch.poses), branch.pins
        if step.locates:
            second = self._row(closure[0].second, branch)
            body, q = (second.i, second.p) if second.i in step.b else (second.j, second.q)
            base = min(step.a)
            pins = (*pins, PointRow(RowKind.PIN, base, body, poses[base].local(move.shift), q, second.name))
        else:
            for body in step.turning:
                poses[body] = poses[body].rotated(move.turn)  # type: ignore[arg-type]
            for body in step.b:
                poses[body] = replace(poses[body], r=poses[body].r + move.shift)
        modes = branch.modes if move.mode is None else (*branch.modes, move.mode)
        return PlacedBranch(poses, pins, modes, branch.decided and decided)

    def _ends(self, step: Step, closure: Closure, branch: PlacedBranch, placement: Placement) -> bool:
        """Hold the rows between the joined groups that were not needed to join them."""
        used = {r.first for r in closure[:1] if r.form is RelationForm.DIRECT}
        used |= {r.first for r in closure if r.form is RelationForm.DIRECT and r.kind is not RowKind.PIN}
        for k in step.held if self.holding else ():
            if k in used:
                continue
            row = self._row(k, branch)
            gap = _missing(row, branch.poses)
            if gap > 0:
                words = f"{row.name} cannot close: {row.i} and {row.j} miss by {self._metres(gap)}"
                placement.ends.append(DeadEnd(gap, partial(str, words)))
                return True
        return False

    def _cannot_meet(self, step: Step, closure: Closure, meeting: Meeting, branch: PlacedBranch) -> DeadEnd:
        def words() -> str:
            who = " and ".join(self._involved(step, closure, branch))
            apart, reach, gap = (self._metres(x) for x in (meeting.apart, meeting.reach, meeting.gap))
            lines = sum(r.kind is RowKind.LINE for r in closure)
            if lines >= 2:
                return f"{who} cannot meet: {gap} are missing between their lines"
            if lines:
                return f"{who} cannot meet: the line is {apart} away, the length reaches {reach}; {gap} are missing"
            can = "cannot come closer than" if meeting.inside else "reach"
            return f"{who} cannot meet: their pins are {apart} apart, their lengths {can} {reach}; {gap} are missing"

        return DeadEnd(meeting.gap, words)

    def _involved(self, step: Step, closure: Closure, branch: PlacedBranch) -> list[str]:
        """Return the names of the moving bodies that a closure joins, and of the lines and distances."""
        names: list[str] = []
        for relation in closure:
            rows = [self._row(k, branch) for k in dict.fromkeys((relation.first, relation.second))]
            names += [end for row in rows for end in (row.i, row.j) if end in step.b or end not in step.a]
            names += [row.name for row in rows if row.kind is not RowKind.PIN]
        return [name for name in dict.fromkeys(names) if name != GROUND]

    def _metres(self, x: Ball) -> str:
        return f"{_number(x * self.size)} m"


def _ends_of(row: PointRow, group: frozenset[str], poses: dict[str, GroupPose]) -> tuple[Vec, Vec]:
    """Return the row's point in a group, and its other point, each in the frame of its own group."""
    at_i, at_j = poses[row.i].point(row.p), poses[row.j].point(row.q)
    return (at_i, at_j) if row.i in group else (at_j, at_i)


def _missing(row: PointRow, poses: dict[str, GroupPose]) -> Ball:
    """Return by how much a row between bodies of one group is violated."""
    d = poses[row.j].point(row.q) - poses[row.i].point(row.p)
    if row.kind is RowKind.LINE:
        return abs(poses[row.i].turned(row.normal).dot(d))  # type: ignore[arg-type]
    return length(d) if row.kind is RowKind.PIN else abs(length(d) - row.distance)


def _number(x: Ball) -> str:
    return f"{float(x.mid()):.6g}"
