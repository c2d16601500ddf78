"""Every assembly of a mechanism at one time, or the proof that there is none.

The mechanism is put together group by group (`rigid_groups`), each step in closed form and in balls of 113 bits
(`closed_form`, `loci`), along every branch. A branch ends where loci certainly miss each other; if all of them end, the
mechanism cannot be assembled, and the gap is the smallest distance that is missing. Where all steps can be taken and
all meetings are proved, the assemblies found are all there are. What closed form does not reach is left to `search`.
"""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence
from functools import partial
from itertools import islice
from typing import Any, cast

from flint import arb, ctx

from refkin.analysis import position
from refkin.joints import SPACE
from refkin.motion import Array
from refkin.proof.assembly.closed_form import MOST_BRANCHES, DeadEnd, PlacedBranch, Placement, place
from refkin.proof.assembly.loci import Ball, above, length
from refkin.proof.assembly.rigid_groups import plan
from refkin.proof.assembly.rows import SPREAD, PointRow, RowKind, read_rows
from refkin.proof.assembly.search import Assemblies, Search, by_search, closes, coordinates, none_of, starts_of
from refkin.proof.assembly.spatial import MOST_STARTS, across, assemblies_in_space, certain_miss, point_rows
from refkin.system import System

PRECISION = 113
MOST_LOOPS, LONGEST_LOOP = 200, 8
"""How many loops are looked at, of how many links, for one that is longer than all the others of its loop together."""


def assemblies(system: System, t: float, trying: bool = True) -> Assemblies:
    """Return the assemblies of a system at time t.

    Parameters
    ----------
    system : System
        Compiled with `mechanism.unit()`, so that lengths are of the order of 1.
    t : float
        Taken as exact, as are the numbers of the mechanism. Where constraints are redundant they are held against each
        other with all numbers spread by `SPREAD`.
    trying : bool
        Whether to look for assemblies also where none could be proved to be the only ones, nor that there are none.
        If not, and rows are not redundant, one that is found proves that there are some: others are not looked for.
    """
    if system.kind is SPACE:
        return _in_space(system, t, trying)
    with ctx.workprec(PRECISION):
        names = [body.name for body in system.mechanism.bodies]
        rows = read_rows(system, t)
        scheme = plan(rows, names)
        if scheme.redundant:
            rows = read_rows(system, t, SPREAD)
        placement = place(scheme, rows, names, system.unit.size)
        if placement.impossible:
            return none_of(placement.ends)
        if len(scheme.groups) == 1 and not (rows.foreign or placement.stuck):
            return _placed(system, t, placement)
        if (end := _open_loop(rows.rows, system.unit.size)) is not None:
            return none_of([end])
        if rows.foreign and not trying:
            return Assemblies(message=f"there is no closed form of {', '.join(rows.foreign)}")
        why = "the outer joints of a dyad coincide, or its lines are parallel" if placement.stuck else ""
        return Search(system, t, rows, why, all_wanted=trying or system.m > system.n).run()


def _in_space(system: System, t: float, trying: bool) -> Assemblies:
    """Return the proof that some link does not reach, or what many starts lead to."""
    end = certain_miss(system, t)
    if end is None:
        with ctx.workprec(PRECISION):
            rows = point_rows(system, t)
            end = _open_loop(rows, system.unit.size) or _loose_loop(rows, system.unit.size)
    if end is not None:
        return none_of([end])
    if not trying:
        return Assemblies(message="no closed form")
    poses, allowed = assemblies_in_space(system, t), starts_of(system.n)
    note = f"so large a mechanism has {allowed} starts in vain at most" if allowed < MOST_STARTS else ""
    return by_search(tuple(poses), (math.nan,) * len(poses), note=note)


def _placed(system: System, t: float, placement: Placement) -> Assemblies:
    """Return what closed form has placed."""
    poses = [(*_pose(system, t, branch), branch.modes) for branch in placement.branches]
    # A pin is off by no more than 2 radii and 2 radii times its arms, about 1: that much a decided ball may leave open,
    # which is more than round-off where redundant rows were held against spread numbers.
    allowed = [8 * radius if b.decided else 0.0 for b, (_, radius, _) in zip(placement.branches, poses, strict=True)]
    closed = [p for p, limit in zip(poses, allowed, strict=True) if closes(system, p[0], t, limit)]
    decided = all(branch.decided for branch in placement.branches)
    message = "" if decided else "a dyad is at the limit of its reach: its assemblies coincide, or just miss"
    if placement.truncated:
        message = f"there are more than {MOST_BRANCHES} branches: not all were followed"
    return Assemblies(
        poses=tuple(q for q, _, _ in closed),
        branches=tuple(modes for _, _, modes in closed),
        radii=tuple(radius for _, radius, _ in closed),
        complete=decided and not placement.truncated and len(closed) == len(poses),
        message=message,
    )


def _pose(system: System, t: float, branch: PlacedBranch) -> tuple[Array, float]:
    """Return a branch's coordinates as floats, and how far they may be from the true ones.

    The middles of the balls are better than what Newton in floats can make of them, unless the balls are wide (where
    loci touch, or with spread numbers).
    """
    q = coordinates(system, branch)
    if not closes(system, q, t):
        refined = position(system, q, t, max_iterations=20)
        q = refined.q if refined.converged and closes(system, refined.q, t) else q
    radius = 0.0
    for body in system.mechanism.bodies:
        pose, columns = branch.poses[body.name], system.columns(body.name)
        for exact, x in zip((pose.r.x, pose.r.y, pose.phi), q[columns], strict=True):
            radius = max(radius, above(abs(exact - float(x))))
    return q, radius


def _open_loop(rows: Sequence[Any], size: float) -> DeadEnd | None:
    """Return the proof that some loop of pins and distances never closes; None if there is none. `size` in metres."""
    for loop in islice(_loops(rows), MOST_LOOPS):
        lengths = [(name, x) for name, x in _lengths(loop) if not x.is_zero()]
        for name, x in lengths:
            others = sum((y for _, y in lengths), arb(0)) - x
            if x > others:
                long, rest = (float((length * size).mid()) for length in (x, others))
                words = f"{name} is longer ({long:.6g} m) than the rest of its loop ({rest:.6g} m): no angle closes it"
                return DeadEnd(x - others, partial(str, words))
    return None


def _loose_loop(rows: Sequence[Any], size: float) -> DeadEnd | None:
    """Return the proof that some loop with one joint of space that slides along an axis never closes; None if none is.

    What enters the one body of that joint and what leaves the other are, at any slide, at least as far apart as their
    distances from the axis differ: the rest of the loop has to reach that far.
    """
    links = [row for row in rows if row.kind is not RowKind.LINE]
    loops = (loop for row in rows if row.kind is RowKind.LINE for loop in _closed([(row, row.i, row.j)], links))
    for loop in islice(loops, MOST_LOOPS):
        line, after, before = (cast(Any, loop[k][0]) for k in (0, 1, -1))
        out = (after.p if after.i == line.j else after.q) - line.q
        into = (before.q if before.j == line.i else before.p) - line.p
        others = sum((x for _, x in _lengths(loop)), arb(0)) - length(into)
        axis_i, axis_j = line.normal
        apart = across(into, axis_i)
        if axis_j is not None:
            apart, others = abs(apart - across(out, axis_j)), others - length(out)
        if apart > others:
            wide, rest = (float((length * size).mid()) for length in (apart, others))
            ways = f"its loop is {wide:.6g} m wide, the rest of it {rest:.6g} m long: no shift closes it"
            return DeadEnd(apart - others, partial(str, f"across the axis of {line.name} {ways}"))
    return None


Passage = tuple[PointRow, str, str]
"""A row on the way around a loop, the body it is entered from and the body it leads to."""


def _loops(rows: Sequence[Any]) -> Iterator[list[Passage]]:
    """Yield closed ways over different bodies, each from its first row on."""
    links = [row for row in rows if row.kind is not RowKind.LINE]
    for k, row in enumerate(links):
        yield from _closed([(row, row.i, row.j)], links[k + 1 :])


def _closed(passed: list[Passage], links: list[PointRow]) -> Iterator[list[Passage]]:
    start, here = passed[0][1], passed[-1][2]
    if here == start:
        yield passed
        return
    visited = {leaving for _, leaving, _ in passed[1:]} | {here}
    for row in links if len(passed) < LONGEST_LOOP else ():
        for leaving, entering in ((row.i, row.j), (row.j, row.i)):
            if leaving == here and entering not in visited and all(row is not r for r, _, _ in passed):
                yield from _closed([*passed, (row, leaving, entering)], links)


def _lengths(loop: list[Passage]) -> Iterator[tuple[str, Ball]]:
    """Yield the links of a loop: bodies, from the point they are entered by to that they are left by, and distances."""
    for (row, _, body), (following, _, _) in zip(loop, [*loop[1:], loop[0]], strict=True):
        entered = row.q if row.j == body else row.p
        left = following.p if following.i == body else following.q
        yield body, length(left - entered)
        if row.kind is RowKind.DISTANCE:
            yield row.name, row.distance
