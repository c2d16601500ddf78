"""Elimination: from the traced equations to expressions of their solutions.

1. Coordinates that some row states outright. A row +-x_c + (other coordinates) = 0 with a constant +-1 gives x_c, on
   all three levels. The rows so used form a spanning tree of the mechanism: pins carry positions from body to body,
   drivers and guides give angles. Nothing is divided, so nothing is lost, whatever the pose.
2. What is left is the core: loop equations in the angles that nothing states. Newton iterates in these alone; because
   the other coordinates were linear, its iterates are those of Newton on all n equations.
3. The core falls into blocks, by matching and strongly connected components: the Assur groups, each solved once those
   upstream of it are. A four-bar's is 2 x 2.

Murota, Matrices and Matroids for Systems Analysis (2000), section 2.2; Duff and Reid, ACM TOMS 4 (1978).
"""

from __future__ import annotations

import heapq
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, field

import numpy as np

from refkin.errors import RefkinError
from refkin.fast.elimination.blocks import Factored, factored
from refkin.fast.elimination.trace import Traced
from refkin.proof.numbers.symbols import Symbol, substitute
from refkin.proof.path.blocks import matching, strong_components


class NotReducible(RefkinError):
    """The equations have no unique solution by their structure alone: some are redundant, others are missing."""


Row = dict[int, Symbol]
"""The entries of a row of a matrix that are not zero, by coordinate."""


@dataclass(frozen=True)
class Pivot:
    """Row `row` is sign * (coordinate) + (others)."""

    coordinate: int
    row: int
    sign: int


@dataclass(frozen=True)
class Eliminated:
    """The solution of the equations as expressions in q[c], c in the core.

    Attributes
    ----------
    levels : tuple of lists of Symbol
        Coordinates, velocities, accelerations, n each.
    core : tuple of int
        The coordinates in which Newton iterates.
    blocks : tuple of tuple of int
        The core by groups, each downstream of none that comes later.
    corrections : list of Symbol
        What Newton subtracts from each core coordinate.
    determinants, pivots : list of Symbol
        Per block, its determinant, and a measure of how far from singular it is (`blocks.Factored`).
    depends : dict
        Per coordinate, those that its own equations hold.
    """

    levels: tuple[list[Symbol], list[Symbol], list[Symbol]]
    core: tuple[int, ...] = ()
    blocks: tuple[tuple[int, ...], ...] = ()
    corrections: Sequence[Symbol] = ()
    determinants: Sequence[Symbol] = ()
    pivots: Sequence[Symbol] = ()
    depends: Mapping[int, set[int]] = field(default_factory=dict)


class Elimination:
    """The steps of the module, in order, with what they share.

    Raises
    ------
    NotReducible
        If some core equations cannot be matched with coordinates.

    Attributes
    ----------
    core, open_rows : list of int
        The coordinates that no row states, and the rows that state none.
    known : dict
        What stands for each traced coordinate.
    q : list of Symbol
        All coordinates in terms of the core.
    slope : list of dict
        phi_q in terms of the core.
    matrix : list of dict
        Derivatives of the open rows by the core coordinates, the spanning tree taken into account.
    groups : list
        Per block its coordinates, its open rows (as numbers into `open_rows`), and the block, factored.
    """

    def __init__(self, traced: Traced) -> None:
        self.graph, self.n = traced.graph, len(traced.phi)
        self.stated = spanning_tree(traced.phi_q)
        rows = {pivot.row for pivot in self.stated}
        given = {pivot.coordinate for pivot in self.stated}
        self.core = [c for c in range(self.n) if c not in given]
        self.open_rows = [r for r in range(self.n) if r not in rows]
        self.known: dict[Symbol, Symbol] = {}
        self.traced = traced
        self.q = self._coordinates()
        self.slope = [{c: substitute(x, self.known) for c, x in row.items()} for row in traced.phi_q]
        total = self._total_derivatives()
        self.matrix = [_chained(self.slope[r], total, 1) for r in self.open_rows]
        self.matched, groups = blocks_of(self.matrix, self.core)
        self.groups = [self._factored(group) for group in groups]

    def result(self) -> Eliminated:
        """Return the corrections of Newton and the three levels."""
        phi = [substitute(self.traced.phi[r], self.known) for r in self.open_rows]
        corrections = self._solved(phi)
        qd = self._level([substitute(x, self.known) for x in self.traced.nu])
        for c, rate in enumerate(qd):
            self.known[self.graph.input("qd", c)] = rate
        qdd = self._level([substitute(x, self.known) for x in self.traced.gamma])
        return Eliminated(
            levels=(self.q, qd, qdd),
            core=tuple(self.core),
            blocks=tuple(tuple(columns) for columns, _, _ in self.groups),
            corrections=[corrections[c] for c in self.core],
            determinants=[f.determinant for _, _, f in self.groups],
            pivots=[f.pivot for _, _, f in self.groups],
            depends=self._depends(),
        )

    def _depends(self) -> dict[int, set[int]]:
        """Return for each coordinate those that its own equations hold, in a block those of all its rows."""
        depends = {p.coordinate: set(self.traced.phi_q[p.row]) for p in self.stated}
        for columns, rows, _ in self.groups:
            together = {c for i in rows for c in self.traced.phi_q[self.open_rows[i]]}
            depends.update(dict.fromkeys(columns, together))
        return depends

    def _coordinates(self) -> list[Symbol]:
        """Return all coordinates in terms of the core, and note them in `known`."""
        zero = self.graph.constant(0.0)
        q = {c: self.graph.input("q", c) for c in range(self.n)}
        for c in self.core:
            self.known[q[c]] = q[c]
        for pivot in self.stated:
            # The row is sign x_c + rest; with 0 for x_c only the rest is left. That trial is not for others to see.
            trial = {**self.known, q[pivot.coordinate]: zero}
            rest = substitute(self.traced.phi[pivot.row], trial)
            self.known[q[pivot.coordinate]] = rest if pivot.sign < 0 else -rest
        return [self.known[q[c]] for c in range(self.n)]

    def _total_derivatives(self) -> dict[int, Row]:
        """Return each coordinate's derivatives by the core coordinates, the spanning tree taken into account."""
        one = self.graph.constant(1.0)
        total: dict[int, Row] = {c: {c: one} for c in self.core}
        for pivot in self.stated:
            others = {c: x for c, x in self.slope[pivot.row].items() if c != pivot.coordinate}
            total[pivot.coordinate] = _chained(others, total, -pivot.sign)
        return total

    def _factored(self, group: Sequence[int]) -> tuple[list[int], list[int], Factored]:
        columns = sorted(group)
        rows = sorted(self.matched[c] for c in columns)
        zero = self.graph.constant(0.0)
        return columns, rows, factored([[self.matrix[i].get(c, zero) for c in columns] for i in rows])

    def _solved(self, right: Sequence[Symbol]) -> Row:
        """Return the solution of the core's matrix for a right side in the order of `open_rows`."""
        solution: Row = {}
        for columns, rows, block in self.groups:
            sides = [_without(right[i], self.matrix[i], solution) for i in rows]
            solution.update(zip(columns, block.solve(sides), strict=True))
        return solution

    def _level(self, right: Sequence[Symbol]) -> list[Symbol]:
        """Return x with phi_q x = right, for all n coordinates.

        First with the core at rest, which gives the right sides of the core; then, with the core's rates known, by the
        rows themselves, which costs less than the total derivatives would.
        """
        still = self.along_tree({}, right)
        sides = [_without(right[r], self.slope[r], still) for r in self.open_rows]
        rates = self.along_tree(self._solved(sides), right)
        return [rates[c] for c in range(self.n)]

    def along_tree(self, core: Row, right: Sequence[Symbol]) -> Row:
        """Return the rates that the spanning tree's rows state for given rates of the core; those not given are 0."""
        rates = dict(core)
        for pivot in self.stated:
            side = _without(right[pivot.row], self.slope[pivot.row], rates)
            rates[pivot.coordinate] = side if pivot.sign > 0 else -side
        return rates


def _without(side: Symbol, row: Row, known: Row) -> Symbol:
    """Return a right side less what the coordinates that are known make of it."""
    for c, entry in row.items():
        if c in known:
            side = side - entry * known[c]
    return side


def _chained(entries: Mapping[int, Symbol], total: Mapping[int, Row], sign: int) -> Row:
    """Return sign * sum over c of entries[c] * total[c], without zeros."""
    out: Row = {}
    for c, entry in entries.items():
        for k, derivative in total[c].items():
            product = entry * derivative
            out[k] = out[k] + product if k in out else product
    return {k: x if sign > 0 else -x for k, x in out.items() if not x.zero}


def blocks_of(matrix: Sequence[Row], core: Sequence[int]) -> tuple[dict[int, int], list[list[int]]]:
    """Return for each core coordinate its row, and the coordinates by strongly connected groups, upstream first.

    Raises
    ------
    NotReducible
        If there is no perfect matching of rows and coordinates.
    """
    place = {c: k for k, c in enumerate(core)}
    pattern = np.zeros((len(matrix), len(core)), bool)
    for i, row in enumerate(matrix):
        pattern[i, [place[c] for c in row]] = True
    columns = [np.flatnonzero(row).tolist() for row in pattern]
    row_of = matching(columns) if len(matrix) == len(core) else None
    if row_of is None:
        raise NotReducible(f"{len(core)} core coordinates and {len(matrix)} rows that cannot be matched one to one")
    ordered = pattern[row_of]  # the row of each coordinate
    left = [group.tolist() for group in strong_components(ordered)]
    order: list[list[int]] = []
    known: set[int] = set()
    while left:
        ready = [group for group in left if known.union(group).issuperset(np.flatnonzero(ordered[group].any(axis=0)))]
        order, left = order + ready, [group for group in left if group not in ready]
        known.update(*ready)
    return {c: int(row_of[k]) for k, c in enumerate(core)}, [[core[k] for k in group] for group in order]


def spanning_tree(phi_q: Sequence[Row]) -> list[Pivot]:
    """Return as many pivots +-1 as there are without a circle, each after those whose coordinates it needs.

    Taken first is the row with which a coordinate depends on the fewest others, which keeps the paths to the ground,
    and so the expressions, short.
    """
    rows_of: dict[int, list[int]] = {}
    for r, row in enumerate(phi_q):
        for c in row:
            rows_of.setdefault(c, []).append(r)
    taken: dict[int, Pivot] = {}
    used: set[int] = set()
    needs: dict[int, set[int]] = {}  # what a coordinate that was taken depends on, others that were taken seen through
    waiting = [(len(row), r, c) for r, row in enumerate(phi_q) for c, x in row.items() if x.unit]
    heapq.heapify(waiting)
    while waiting:
        cost, r, c = heapq.heappop(waiting)
        if r in used or c in taken:
            continue
        others = _leaves((k for k in phi_q[r] if k != c), needs)
        if c in others:  # it would depend on itself
            continue
        if len(others) > cost:
            heapq.heappush(waiting, (len(others), r, c))
            continue
        taken[c], needs[c] = Pivot(c, r, phi_q[r][c].unit), others
        used.add(r)
        for other in rows_of[c]:
            for k, x in phi_q[other].items():
                if x.unit and other not in used and k not in taken:
                    heapq.heappush(waiting, (len(_leaves((m for m in phi_q[other] if m != k), needs)), other, k))
    return _in_order(taken, phi_q)


def _leaves(coordinates: Iterable[int], needs: Mapping[int, set[int]]) -> set[int]:
    """Return the coordinates on which others depend in the end."""
    leaves: set[int] = set()
    seen: set[int] = set()
    waiting = list(coordinates)
    while waiting:
        c = waiting.pop()
        if c in needs and c not in seen:
            waiting.extend(needs[c])
        elif c not in needs:
            leaves.add(c)
        seen.add(c)
    return leaves


def _in_order(taken: Mapping[int, Pivot], phi_q: Sequence[Row]) -> list[Pivot]:
    """Return pivots so that each comes after those whose coordinates stand in its row."""
    order: list[Pivot] = []
    placed: set[int] = set()
    for start in taken:
        waiting = [start]
        while waiting:
            c = waiting[-1]
            first = [k for k in phi_q[taken[c].row] if k != c and k in taken and k not in placed]
            if first:
                waiting.extend(first)
                continue
            waiting.pop()
            if c not in placed:
                placed.add(c)
                order.append(taken[c])
    return order
