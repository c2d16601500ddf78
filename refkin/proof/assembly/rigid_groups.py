"""In what order a mechanism can be put together from what its joints say of two rigid groups at a time.

A *rigid group* is a set of bodies that do not move against one another; at first each body is one, and so is the
ground. Groups whose angle against each other is known have the same *orientation* (drivers, prismatic and fixed joints
give relative angles). Two groups become one when what is known of them fixes one in the other, a *closure*:

================ =================================================================================================
same orientation a pin; or two loci (lines, distances) for the shift
two orientations a pin and a second pin, line or distance; or three lines
either           two loci for one and the same point make it a pin, which is then used as above (*locate*)
================ =================================================================================================

What is known of groups A and B may pass through a third one, C:

*link*   C is pinned to A and to B: the two pins keep their distance. So the inner pin of an RRR dyad, or the driven
         coupler of a four-bar, needs no rule of its own.
*slide*  C has the orientation of B, is pinned to A, and has a line or distance to B: that holds for A's pin, shifted
         by a vector that turns with B. So RPR and PRP dyads need none either.

Everything here follows from which bodies the rows join; no length is looked at.
"""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass
from enum import Enum, auto
from functools import lru_cache
from itertools import combinations

from refkin.joints import GROUND
from refkin.proof.assembly.rows import AssemblyRows, RowKind

AnglePairs = tuple[tuple[str, str], ...]
"""The pairs of bodies whose angle against each other is given."""
MOST_CANDIDATES = 8
"""How many closures of the same two groups are kept, in case some meet at a bad angle (parallel guides)."""


class RelationForm(Enum):
    """How a relation follows from rows; see the module."""

    DIRECT = auto()
    """A row between A and B."""
    LINK = auto()
    """Two pins on a third group C: it keeps a distance between A and B."""
    SLIDE = auto()
    """A line and another row on C: it slides along the one, and carries the other."""


@dataclass(frozen=True)
class Relation:
    """What rows `first` (and `second`, through a third group) say of groups A and B.

    `line_on_b`: whether a line is carried by B. `uses` are the rows that it rests on: relations that share one are not
    independent.
    """

    form: RelationForm
    kind: RowKind
    first: int
    second: int
    line_on_b: bool
    uses: frozenset[int]


Closure = tuple[Relation, ...]
"""Independent relations that fix one group in another."""


@dataclass(frozen=True)
class Step:
    """Join group `b` to group `a`, or locate a point of `b` in `a`.

    Attributes
    ----------
    turning : frozenset of str
        The bodies that turn with b, if its orientation is not that of a.
    candidates : tuple of tuples of Relation
        Independent relations that suffice; the first whose loci do not run along each other will do.
    held : tuple of int
        The rows between a and b: those beyond the ones used must agree.
    locates : bool
        Whether the result is a pin, not a joined group.
    """

    a: frozenset[str]
    b: frozenset[str]
    turning: frozenset[str]
    candidates: tuple[Closure, ...]
    held: tuple[int, ...]
    locates: bool = False


@dataclass(frozen=True)
class AssemblyPlan:
    """The steps, the groups that remain after them, and whether rows are redundant."""

    steps: tuple[Step, ...]
    groups: tuple[frozenset[str], ...]
    redundant: bool


@dataclass(frozen=True)
class _Item:
    """A row, or a pin that was located, as far as structure goes."""

    kind: RowKind
    i: str
    j: str
    keys: tuple[object, object]
    uses: frozenset[int]


def plan(rows: AssemblyRows, bodies: Iterable[str]) -> AssemblyPlan:
    """Return the steps that put a mechanism together as far as they can."""
    relative_angles = tuple((relative.i, relative.j) for relative in rows.relative_angles)
    items = (_Item(r.kind, r.i, r.j, (r.key_i, r.key_j), frozenset({k})) for k, r in enumerate(rows.rows))
    return _plan(tuple(items), relative_angles, (GROUND, *bodies))


@lru_cache(maxsize=256)
def _plan(items: tuple[_Item, ...], relative_angles: AnglePairs, bodies: tuple[str, ...]) -> AssemblyPlan:
    structure = _Structure(items, relative_angles, bodies)
    steps = []
    while (step := structure.next_step()) is not None:
        steps.append(step)
    return AssemblyPlan(tuple(steps), tuple(structure.groups), structure.redundant(items, relative_angles))


def orientations(relative_angles: AnglePairs, bodies: Iterable[str]) -> list[set[str]]:
    """Return the sets of bodies whose angles against each other are given; the ground is in one of them."""
    groups = [{b} for b in dict.fromkeys((GROUND, *bodies))]
    for i, j in relative_angles:
        first, second = (next(h for h in groups if body in h) for body in (i, j))
        if first is not second:
            first |= second
            groups.remove(second)
    return groups


Group = frozenset[str]


class _Structure:
    """Groups and orientations while they grow."""

    def __init__(self, items: Sequence[_Item], relative_angles: AnglePairs, bodies: tuple[str, ...]) -> None:
        self.groups = [frozenset({b}) for b in bodies]
        self.orientations = orientations(relative_angles, bodies)
        self.items = list(items)

    def next_step(self) -> Step | None:
        """Find a step and take it; None if there is none."""
        self._look_around()
        pairs = list(self._pairs())
        for a, b in pairs:
            step = self._join(a, b)
            if step is not None:
                self._merge(step.a, step.b)
                return step
        for a, b in pairs:
            step = self._locate(a, b) or self._locate(b, a)
            if step is not None:
                return step
        return None

    def redundant(self, items: Sequence[_Item], relative_angles: AnglePairs) -> bool:
        """Whether there are more rows inside groups, and relative angles inside orientations, than rigidity needs."""
        inside = len(relative_angles)
        for item in items:
            if any({item.i, item.j} <= c for c in self.groups):
                inside += 2 if item.kind is RowKind.PIN else 1
        bodies = sum(len(c) for c in self.groups)
        return inside > 3 * bodies - 2 * len(self.groups) - len(self.orientations)

    def _look_around(self) -> None:
        """Note which rows join which groups, and each group's orientation."""
        home = {body: c for c in self.groups for body in c}
        self.orientation = {c: next(h for h in self.orientations if not h.isdisjoint(c)) for c in self.groups}
        self.joined: dict[Group, dict[Group, list[int]]] = {c: {} for c in self.groups}
        for k, item in enumerate(self.items):
            i, j = home[item.i], home[item.j]
            if i is not j:
                self.joined[i].setdefault(j, []).append(k)
                self.joined[j].setdefault(i, []).append(k)

    def _pairs(self) -> Iterator[tuple[Group, Group]]:
        """Yield the pairs that rows join, directly or through a third group; those with the ground first."""
        order = {c: k for k, c in enumerate(self.groups)}
        for a in self.groups:
            near = self.joined[a]
            around = {b for c in (a, *near) for b in self.joined[c] if order[b] > order[a]}
            for b in sorted(around, key=order.__getitem__):
                yield a, b

    def _merge(self, a: Group, b: Group) -> None:
        first, second = self.orientation[a], self.orientation[b]
        if first is not second:
            first |= second
            self.orientations.remove(second)
        self.groups = [a | b, *(c for c in self.groups if c not in (a, b))]
        self.groups.sort(key=lambda c: GROUND not in c)

    def _between(self, a: Group, b: Group) -> list[int]:
        return self.joined[a].get(b, [])

    def _join(self, a: Group, b: Group) -> Step | None:
        if GROUND in self.orientation[b] and GROUND not in a:  # what turns is never the orientation of the ground
            a, b = b, a
        same = self.orientation[a] is self.orientation[b]
        closures = _sufficient(list(self._relations(a, b)), same)
        if not closures:
            return None
        turning = frozenset() if same else frozenset(self.orientation[b])
        return Step(a, b, turning, closures, tuple(self._between(a, b)))

    def _locate(self, a: Group, b: Group) -> Step | None:
        """Return the step that pins a point of b by two loci that are fixed in a."""
        located = [item.uses for item in self.items if len(item.uses) > 1]
        loci: dict[tuple[str, object], list[Relation]] = {}
        for relation in self._relations(a, b):
            item = self.items[relation.second]
            body, key = (item.i, item.keys[0]) if item.i in b else (item.j, item.keys[1])
            fixed_in_a = (
                relation.form is not RelationForm.SLIDE and not relation.line_on_b and relation.kind is not RowKind.PIN
            )
            if fixed_in_a and key is not None:
                loci.setdefault((body, key), []).append(relation)
        for (body, key), through in loci.items():
            for closure in _independent(through, 2):
                if not any(_uses(closure) <= pin for pin in located):
                    self.items.append(_Item(RowKind.PIN, min(a), body, (None, key), _uses(closure)))
                    return Step(a, b, frozenset(), (closure,), (), locates=True)
        return None

    def _relations(self, a: Group, b: Group) -> Iterator[Relation]:
        for k in self._between(a, b):
            item = self.items[k]
            line_on_b = item.kind is RowKind.LINE and item.i in b
            yield Relation(RelationForm.DIRECT, item.kind, k, k, line_on_b, item.uses)
        for c in self.joined[a]:
            if c is not b and b in self.joined[c]:
                for first, second, uses in self._both(a, c, b):
                    if self.items[second].kind is RowKind.PIN:  # c keeps the distance of its pins to a and to b
                        yield Relation(RelationForm.LINK, RowKind.DISTANCE, first, second, False, uses)
                yield from self._slides(a, c, b, line_on_b=True)
                yield from self._slides(b, c, a, line_on_b=False)

    def _slides(self, a: Group, c: Group, b: Group, line_on_b: bool) -> Iterator[Relation]:
        """Yield what a line or distance of c and b says of a, which is pinned to c; c has the orientation of b."""
        if self.orientation[c] is self.orientation[b]:
            for first, second, uses in self._both(a, c, b):
                if self.items[second].kind is not RowKind.PIN:
                    yield Relation(RelationForm.SLIDE, self.items[second].kind, first, second, line_on_b, uses)

    def _both(self, a: Group, c: Group, b: Group) -> Iterator[tuple[int, int, frozenset[int]]]:
        """Yield the pairs of a pin between a and c and a row between c and b."""
        for first in self._between(a, c):
            for second in self._between(c, b):
                one, two = self.items[first], self.items[second]
                if one.kind is RowKind.PIN and not one.uses & two.uses:
                    yield first, second, one.uses | two.uses


def _sufficient(relations: list[Relation], same_orientation: bool) -> tuple[Closure, ...]:
    """Return the sets of relations that fix one group in the other, those without a detour first."""
    pins = [r for r in relations if r.kind is RowKind.PIN]
    loci = sorted((r for r in relations if r.kind is not RowKind.PIN), key=lambda r: r.form is not RelationForm.DIRECT)
    closures: list[Closure] = []
    if same_orientation:
        closures += [(pin,) for pin in pins] or _independent(loci, 2)
    else:
        closures += [(pin, other) for pin in pins for other in (*loci, *pins) if not pin.uses & other.uses]
        for carried in (False, True):
            closures += _independent([r for r in loci if r.kind is RowKind.LINE and r.line_on_b is carried], 3)
    return tuple(closures[:MOST_CANDIDATES])


def _independent(relations: list[Relation], count: int) -> Iterator[Closure]:
    for closure in combinations(relations, count):
        if sum(len(r.uses) for r in closure) == len(_uses(closure)):
            yield closure


def _uses(closure: Closure) -> frozenset[int]:
    return frozenset(k for r in closure for k in r.uses)
