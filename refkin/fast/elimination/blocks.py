"""The blocks of the core, solved by expressions: 1x1, 2x2 by Cramer's rule, larger with pivots chosen sample by sample.

========= ======================================================================= ====================================
unknowns  how                                                                     determinant
========= ======================================================================= ====================================
1         division
2         Cramer's rule, which is forward stable (Higham, Accuracy and Stability  a d - b c
          of Numerical Algorithms, section 1.10.1)
3 to 8    LU with partial pivoting; rows are exchanged by selecting, so that      product of the pivots, sign changed
          every sample has its own order                                          with every exchange
above     LAPACK, sample by sample                                                its sign
========= ======================================================================= ====================================
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass

from refkin.proof.numbers.symbols import Graph, Symbol

LARGEST_INVERTED = 4
"""From here on the inverse, which nothing but its norm is asked of, costs more than all the rest."""
LARGEST_SELECTED = 8
"""From here on a batched inverse costs less than selecting rows does."""


@dataclass(frozen=True)
class Factored:
    """A block that is ready to be solved for any right side.

    Attributes
    ----------
    determinant : Symbol
        Its sign does not change along a branch.
    pivot : Symbol
        The smallest singular value within a factor of about the number of unknowns: |det| / (sum of all sizes) of a
        2x2 block, 1 / (row-sum norm of the inverse) of the next larger; of those that are selected but larger, a bound.
    solve : callable
        Right side -> solution.
    """

    determinant: Symbol
    pivot: Symbol
    solve: Callable[[Sequence[Symbol]], list[Symbol]]


def factored(matrix: Sequence[Sequence[Symbol]]) -> Factored:
    """Return a square matrix of symbols, factored."""
    if len(matrix) == 1:
        ((a,),) = matrix
        return Factored(a, abs(a), lambda right: [right[0] / a])
    if len(matrix) == 2:
        return _by_cramer(matrix)
    return _by_selection(matrix) if len(matrix) <= LARGEST_SELECTED else _by_lapack(matrix)


def _by_cramer(matrix: Sequence[Sequence[Symbol]]) -> Factored:
    (a, b), (c, d) = matrix
    determinant = a * d - b * c
    size = abs(a) + abs(b) + abs(c) + abs(d)

    def solve(right: Sequence[Symbol]) -> list[Symbol]:
        e, f = right
        return [(e * d - b * f) / determinant, (a * f - e * c) / determinant]

    return Factored(determinant, abs(determinant) / size, solve)


def _by_selection(matrix: Sequence[Sequence[Symbol]]) -> Factored:
    graph, size = matrix[0][0].graph, len(matrix)
    rows = [list(row) for row in matrix]
    exchanges: list[tuple[int, int, Symbol]] = []
    factors: dict[tuple[int, int], Symbol] = {}
    determinant = graph.constant(1.0)
    for j in range(size):
        for i in range(j + 1, size):
            if rows[i][j].zero:
                continue
            larger = graph.node("greater", abs(rows[i][j]), abs(rows[j][j]))
            exchanges.append((j, i, larger))
            for k in range(j, size):
                rows[j][k], rows[i][k] = _exchanged(larger, rows[j][k], rows[i][k])
            determinant = graph.node("select", larger, -determinant, determinant)
        determinant = determinant * rows[j][j]
        for i in range(j + 1, size):
            if rows[i][j].zero:
                continue
            factors[i, j] = factor = rows[i][j] / rows[j][j]
            for k in range(j + 1, size):
                rows[i][k] = rows[i][k] - factor * rows[j][k]

    def solve(right: Sequence[Symbol]) -> list[Symbol]:
        return _substituted(rows, exchanges, factors, right)

    least = 1.0 / _inverse_norm(graph, solve, size) if size <= LARGEST_INVERTED else _least(determinant, matrix)
    return Factored(determinant, least, solve)


def _least(determinant: Symbol, matrix: Sequence[Sequence[Symbol]]) -> Symbol:
    """Return |det| ((n - 1) / s)^((n - 1) / 2), s the sum of all squares: no singular value is smaller.

    The n - 1 others have at most the product that equal ones with that sum of squares have (Yu and Gu, Linear Algebra
    and its Applications 253, 1997). For the root of an odd power: sqrt f >= 2 f / (1 + f).
    """
    entries = [entry * entry for row in matrix for entry in row if not entry.zero]
    others = len(matrix) - 1
    factor, least = float(others) / sum(entries), abs(determinant)
    for _ in range(others // 2):
        least = least * factor
    return least * (2.0 * factor / (1.0 + factor)) if others % 2 else least


def _inverse_norm(graph: Graph, solve: Callable[[Sequence[Symbol]], list[Symbol]], size: int) -> Symbol:
    """Return the largest row sum of the inverse, from its columns."""
    columns = [solve([graph.constant(float(k == j)) for k in range(size)]) for j in range(size)]
    return graph.largest(sum(map(abs, row), graph.constant(0.0)) for row in zip(*columns, strict=True))


def _substituted(
    rows: list[list[Symbol]],
    exchanges: list[tuple[int, int, Symbol]],
    factors: dict[tuple[int, int], Symbol],
    right: Sequence[Symbol],
) -> list[Symbol]:
    """Return the solution for a right side that goes through the same exchanges as the rows did."""
    x, size = list(right), len(rows)
    for j in range(size):
        for _, i, larger in (e for e in exchanges if e[0] == j):
            x[j], x[i] = _exchanged(larger, x[j], x[i])
        for i in range(j + 1, size):
            if (i, j) in factors:
                x[i] = x[i] - factors[i, j] * x[j]
    for j in reversed(range(size)):
        for k in range(j + 1, size):
            x[j] = x[j] - rows[j][k] * x[k]
        x[j] = x[j] / rows[j][j]
    return x


def _exchanged(mask: Symbol, a: Symbol, b: Symbol) -> tuple[Symbol, Symbol]:
    if a is b:
        return a, b
    graph = a.graph
    return graph.node("select", mask, b, a), graph.node("select", mask, a, b)


def _by_lapack(matrix: Sequence[Sequence[Symbol]]) -> Factored:
    graph, size = matrix[0][0].graph, len(matrix)
    inverse = graph.node("inverse", *(x for row in matrix for x in row), value=size)

    def solve(right: Sequence[Symbol]) -> list[Symbol]:
        solution = graph.node("apply", inverse, *right, value=size)
        return [graph.node("entry", solution, value=k) for k in range(size)]

    return Factored(graph.node("entry", inverse, value=0), graph.node("entry", inverse, value=1), solve)
