"""The blocks of phi_q, groups of equations that are solved together such as a dyad's, and their determinants' signs.

With its rows and columns in a suitable order phi_q is block triangular, and its determinant the product of those of the
blocks on the diagonal. None of these can change its sign on a branch without phi_q being singular in between. Of the
product that is only seen where an odd number of blocks changes: two linkages of the same lengths on one crank reach
their change points together, and go over to their other branches together.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import lru_cache
from typing import Any

import numpy as np

from refkin.joints import SPACE
from refkin.proof.numbers.preconditioned import independent_rows
from refkin.system import System

LATER = 1e-9
"""A moment, in units of the time or of a second."""
MOMENT = 1e-6
"""A part of a step after which determinants have changed by their rate, and far more than by rounding."""
NEAR_ZERO = 1 / 4
"""How near zero the tangent of a determinant leads, to be doubted in between, in units of the smaller end."""


@dataclass(frozen=True)
class Blocks:
    """Where the entries of the diagonal blocks are in phi_q (`entries`) and in their stack (`places`), both flat."""

    entries: Any
    places: Any
    empty: Any

    def determinants(self, phi_q: Any) -> tuple[list[float], float]:
        """Return the sign of the determinant of each block, and the logarithm of the smallest size of one."""
        stack = self.empty.copy()
        stack.reshape(-1)[self.places] = phi_q.reshape(-1)[self.entries]
        signs, logarithms = np.linalg.slogdet(stack)
        return signs.tolist(), float(np.min(logarithms, initial=0.0))

    def each_of_batch(self, phi_q: Any) -> tuple[Any, Any]:
        """Return signs and logarithms (B, K) of the determinants of all blocks of a batch of phi_q (m, n, B)."""
        count = phi_q.shape[-1]
        stack = np.repeat(self.empty[None], count, axis=0)
        stack.reshape(count, -1)[:, self.places] = phi_q.reshape(-1, count)[self.entries].T
        signs, logarithms = np.linalg.slogdet(stack)
        return signs, logarithms


def blocks(system: System, q: Any, t: float, rows: Any = None) -> Blocks:
    """Return the irreducible diagonal blocks of n rows of phi_q.

    The entries that are not always zero are those that are not at the pose or at one with its bodies elsewhere,
    a moment later: slopes of an angle driver of space hold its law, which may be zero now. What is passive may be held
    as it is at either.

    Parameters
    ----------
    system : System
    q : (n,) array
        A pose, in the system's coordinates, at the time t [s].
    t : float
        When [s].
    rows : (n,) array of int, optional
        The rows that are solved, of the m; by default some that are independent at the pose.
    """
    rows = independent_rows(system, np.asarray(q)[:, None], np.array([t])) if rows is None else rows
    elsewhere = np.array(q, float)
    moved = system.n if system.kind is SPACE else system.of_bodies  # in space the own coordinate of a screw, too
    elsewhere[:moved] += np.sqrt(np.arange(2, moved + 2))  # no two of them in a simple ratio
    there = system.held_at(elsewhere).phi_q(elsewhere, t + LATER * max(1.0, abs(t)))
    pattern = (system.phi_q(q, t) != 0) | (there != 0)
    return _blocks_of(pattern[rows].tobytes(), tuple(rows.tolist()))


def dips(system: System, t: Any, q: Any, parts: Blocks | None = None, loops: int = 1) -> Any:
    """Return (T - 1,) whether a block may become singular between two poses, for all that their determinants show.

    A law that does not turn back may move a loop over a gap in which it does not close, or one loop may move another to
    its limit and back between two times, with the same sign of its determinant at both. Towards a singular pose the
    determinant goes down and from one it comes up, about as the way that is left or its root: so the tangent at one of
    the ends leads to zero, or near it, within the step. Where a branch only ends at a limit it does not: it lies above
    the root. Of redundant rows only those are looked at that are independent at the first pose: where all are singular,
    so are these.

    Parameters
    ----------
    system : System
    t, q : (T,) and (n, T) array
        Times in increasing order [s], and the poses there, in the system's coordinates.
    parts : Blocks, optional
        The blocks of phi_q, if they are known.
    loops : int
        How many loops there are at least for any to be looked at.
    """
    if len(t) < 2:
        return np.zeros(0, bool)
    rows = independent_rows(system, q, t)
    parts = blocks(system, q[:, 0], t[0], rows) if parts is None else parts
    system = system.held_at(q)
    jacobian, h = system.phi_q(q, t), np.diff(t)
    _, here = parts.each_of_batch(jacobian)
    with np.errstate(invalid="ignore"):
        changing = np.ptp(here, axis=0) > MOMENT
    if np.count_nonzero(changing) < loops:
        return np.zeros(len(t) - 1, bool)
    stacked = jacobian[rows].transpose(2, 0, 1)  # a copy
    stacked[np.linalg.slogdet(stacked)[0] == 0.0] = np.nan
    moment = np.maximum(MOMENT * np.append(h, h[-1]), np.spacing(np.abs(t)))
    moment[-1] *= -1.0  # a table may end with the last step
    after = t + moment
    moment = after - t
    with np.errstate(all="ignore"):
        pushed = (system.phi(q, t) - system.phi(q, after))[rows] / moment
        later = q + moment * np.linalg.solve(stacked, pushed.T[..., None])[..., 0].T
        rates = (parts.each_of_batch(system.phi_q(later, after))[1] - here) / moment[:, None]
        rise = np.exp(here[1:] - here[:-1])  # the determinant at the end of a step, that at its start being 1
        falls, rises = rates[:-1] * h[:, None], rise * rates[1:] * h[:, None]
        return (np.minimum(1.0 + falls, rise - rises) <= NEAR_ZERO * np.minimum(1.0, rise)).any(axis=1)


def diagonal_blocks(pattern: Any) -> list[tuple[Any, Any]]:
    """Return the rows and the columns of each irreducible diagonal block of a square pattern (n, n) of bool.

    Rows are matched to columns; then those belong to one block that depend on each other in both directions (A. L.
    Dulmage and N. S. Mendelsohn, 1958). One block of everything if there is no such matching.
    """
    row_of = matching([np.flatnonzero(row).tolist() for row in pattern])
    if row_of is None:
        return [(np.arange(len(pattern)), np.arange(len(pattern)))]
    return [(row_of[columns], columns) for columns in strong_components(pattern[row_of])]


def strong_components(pattern: Any) -> list[Any]:
    """Return the columns of a pattern (n, n) that reach each other, row k being matched to column k, by groups."""
    n = len(pattern)
    reached = pattern | np.eye(n, dtype=bool)  # of columns, by way of the rows matched to them
    for _ in range((n - 1).bit_length()):
        reached = (reached.astype(np.float32) @ reached.astype(np.float32)) > 0
    return [np.array(k) for k in sorted({tuple(np.flatnonzero(row).tolist()) for row in reached & reached.T})]


def matching(columns: Sequence[Sequence[int]]) -> Any:
    """Return a row for each of as many columns, none twice, that has it among its `columns`; None if there is none.

    By augmenting paths. SciPy's matching takes a time that doubles with every few loops of a chain in some orders.
    """
    row_of: dict[int, int] = {}
    column_of: dict[int, int] = {}
    for start in range(len(columns)):
        reached_from: dict[int, int] = {}
        waiting, end = [start], None
        for row in waiting:
            new = [column for column in columns[row] if column not in reached_from]
            reached_from.update(dict.fromkeys(new, row))
            end = next((column for column in new if column not in row_of), None)
            if end is not None:
                break
            waiting += [row_of[column] for column in new]
        if end is None:
            return None
        while end is not None:
            row = reached_from[end]
            row_of[end] = row
            column_of[row], end = end, column_of.get(row)
    return np.array([row_of[c] for c in range(len(columns))], int)


@lru_cache(maxsize=64)
def _blocks_of(pattern: bytes, chosen: tuple[int, ...]) -> Blocks:
    """Return the blocks of the pattern (n, n) of so many rows: the steps of a branch ask for the same again and again.

    They are one stack of matrices of the largest size; smaller ones are continued by ones.
    """
    n, rows = len(chosen), np.array(chosen)
    parts = [(rows[r], c) for r, c in diagonal_blocks(np.frombuffer(pattern, bool).reshape(n, n))]
    size = max((len(r) for r, _ in parts), default=0)
    entries = [
        (row * n + column, (k * size + i) * size + j)
        for k, (rows, columns) in enumerate(parts)
        for i, row in enumerate(rows)
        for j, column in enumerate(columns)
    ]
    empty = np.zeros((len(parts), size, size))
    for k, (rows, _) in enumerate(parts):
        beyond = np.arange(len(rows), size)
        empty[k, beyond, beyond] = 1.0
    here, there = np.array(entries, int).reshape(-1, 2).T
    return Blocks(here, there, empty)
