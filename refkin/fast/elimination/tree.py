"""The spanning tree: which coordinates the rows with a constant +-1 state outright, and in which order."""

from __future__ import annotations

import heapq
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass

from refkin.proof.numbers.symbols import Symbol

Row = dict[int, Symbol]
"""The entries of a row of a matrix that are not zero, by coordinate."""


@dataclass(frozen=True)
class Pivot:
    """Row `row` is sign * (coordinate) + (others)."""

    coordinate: int
    row: int
    sign: int


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
