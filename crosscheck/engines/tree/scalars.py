"""Newton on the free coordinates of a tree's loops, pose after pose, in plain floats: for engines that close no loops.

An array of so few numbers costs more than what is done to it. An engine supplies its loops at one pose (`LoopRows`);
the steps, the linear systems and where the next pose is looked for are the adapter's, the same for every engine.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator, Sequence
from contextlib import suppress
from functools import partial
from typing import Protocol

import numpy as np

from crosscheck.engines.methods import Method, Model, Use, priced
from crosscheck.engines.tree.joint_tree import Array
from crosscheck.engines.tree.newton import Loops, Tree
from refkin.model import Scene

LIMITS = (1e-2, 1e-4, 1e-8)
"""Largest correction at which Newton stops; it squares the error."""
MOST_NEWTON = 12
"""Corrections that a pose may take."""
Row = list[float]
"""Coordinates or rates (n,), a number for each row of the loops, or a Jacobian of these, row by row."""


class LoopRows(Protocol):
    """An engine's L loops at one pose: x, y and z of each, of which z is not read.

    Tree coordinate k is the engine's in `columns[k]`.
    """

    columns: Sequence[int]

    def closure(self, q: Row) -> tuple[Row, Row]:
        """Return the gaps of the loops (3 L,) and their Jacobian (3 L n,) at q (n,)."""

    def drift(self, q: Row, qd: Row) -> Row:
        """Return the accelerations of the gaps (3 L,) at qdd = 0, at the q whose closure was asked for last."""


def scalar_methods(
    engine: str, tree_of: Callable[[Scene], Tree], rows_of: Callable[[Loops], LoopRows]
) -> Iterator[Method]:
    """Yield Newton in plain floats on an engine's loops, stopped by the size of the correction.

    Parameters
    ----------
    engine, tree_of, rows_of : str, callable, callable
        Its name; scene of the plane -> its tree; loops of the tree -> what the engine says of them.
    """

    def build(limit: float, scene: Scene) -> Model:
        loops = Loops.of(tree_of(scene))
        newton = ScalarNewton(loops, rows_of(loops), limit)
        return Model(newton.solve, newton.read)

    note = "each pose from the extrapolated one; laws are tabulated with the model"
    for limit in LIMITS:
        name, setting, who = "Newton on free coordinates", f"|dq| < {limit:g}", "the adapter (in scalars)"
        uses = frozenset({Use.PRICE, Use.BENCH} if limit == LIMITS[-1] else {Use.PRICE})
        yield priced(engine, name, setting, who, partial(build, limit), note, uses=uses)


class ScalarNewton:
    """One mechanism, pose after pose, in the engine's columns."""

    def __init__(self, loops: Loops, rows: LoopRows, limit: float) -> None:
        self.tree, self.rows, self.limit, self.t = loops.tree, rows, limit, loops.tree.scene.times
        start = dict(zip(rows.columns, loops.tree.start().tolist(), strict=True))
        self.start, width = [start[column] for column in range(len(start))], len(start)
        self.held, self.free = ([rows.columns[k] for k in at.tolist()] for at in (loops.clock.columns, loops.free))
        self.values = loops.clock.values[:, :, 0].tolist()
        self.equations = [row for row in range(3 * len(self.free) // 2) if row % 3 < 2]
        self._of_held = [[(row, row * width + column) for row in self.equations] for column in self.held]
        self._of_free = [[row * width + column for column in self.free] for row in self.equations]
        self._still, self._steady = [0.0] * width, [0.0] * 3 * len(self.equations)
        self._solved = self._of_two if len(self.equations) == 2 else self._of_many

    def solve(self, order: int) -> list[list[Row]]:
        """Return for each time coordinates and rates up to an order; NaN from where Newton does not converge."""
        poses: list[list[Row]] = []
        with suppress(ZeroDivisionError, np.linalg.LinAlgError):  # a singular pose, beyond which it does not go
            poses.extend(self._poses(order))
        if len(poses) < len(self.t):
            poses += [[[math.nan] * len(self.start)] * (order + 1)] * (len(self.t) - len(poses))
        return poses

    def read(self, poses: list[list[Row]]) -> list[Array]:
        """Return an answer as levels of bodies (3 b, T)."""
        return self.tree.read(list(np.array(poses).transpose(1, 2, 0)[:, self.rows.columns]))

    def _poses(self, order: int) -> Iterator[list[Row]]:
        """Yield coordinates and rates up to an order, each pose from where all that is known of the last one leads."""
        known: list[Row] = []
        last = len(self.t) - 1
        for k, t in enumerate(self.t):
            h = t - self.t[k - 1]
            q = _led(known, h) if k else self.start.copy()
            slopes = self._close(q, self.values[0][k])
            if slopes is None:
                return
            pose = [q]
            if order:
                slopes = self.rows.closure(q)[1]
            if order or k < last:  # where the next pose is looked for takes rates
                pose.append(self._rates(slopes, self.values[1][k], self._steady))
            if order > 1:
                pose.append(self._rates(slopes, self.values[2][k], self.rows.drift(q, pose[1])))
            yield pose[: order + 1]
            if k < last:
                pairs = zip(pose[-1], known[len(pose) - 1], strict=True) if k else ()
                known = [*pose, [(x - y) / h for x, y in pairs] or self._still, self._still][:4]

    def _close(self, q: Row, held: Row) -> Row | None:
        """Close the loops from q, which is changed; return the last Jacobian, None without convergence."""
        for column, value in zip(self.held, held, strict=True):
            q[column] = value
        closure, solved, free, limit = self.rows.closure, self._solved, self.free, self.limit
        for _ in range(MOST_NEWTON):
            gaps, slopes = closure(q)
            step = solved(slopes, gaps)
            for k, column in enumerate(free):
                q[column] -= step[k]
            if max(map(abs, step)) <= limit:
                return slopes
        return None

    def _rates(self, slopes: Row, held: Row, drift: Row) -> Row:
        """Return the rates (n,) for which rows and drift make 0, from those of the prescribed coordinates."""
        right, rates = drift.copy(), self._still.copy()
        for k, column in enumerate(self.held):
            rates[column] = rate = held[k]
            for row, place in self._of_held[k]:
                right[row] += slopes[place] * rate
        solution = self._solved(slopes, right)
        for k, column in enumerate(self.free):
            rates[column] = -solution[k]
        return rates

    def _of_two(self, slopes: Row, right: Row) -> Row:
        """Return the solution in the free columns of two equations, without LAPACK, whose call would take longer."""
        (a, b), (c, d) = self._of_free
        a, b, c, d = slopes[a], slopes[b], slopes[c], slopes[d]
        x, y, determinant = right[0], right[1], a * d - b * c
        return [(d * x - b * y) / determinant, (a * y - c * x) / determinant]

    def _of_many(self, slopes: Row, right: Row) -> Row:
        """Return the solution in the free columns."""
        matrix = np.array(slopes)[self._of_free]
        solution: Row = np.linalg.solve(matrix, [right[row] for row in self.equations]).tolist()
        return solution


def _led(known: list[Row], h: float) -> Row:
    """Return where coordinates and three rates lead in a time h."""
    return [x + h * (v + h * (a / 2.0 + h * j / 6.0)) for x, v, a, j in zip(*known, strict=True)]
