"""Newton on the free coordinates of a tree's loops at many poses at once, for engines that close no loops.

An engine supplies its loops at so many poses (`ManyLoops`); Newton on these rows, and where it begins, are the
adapter's, the same for every engine. One mechanism is taken to a few poses one after another (`tree.scalars`), and to
all others from the cubics between them.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import replace
from functools import partial
from typing import Any, Protocol

import numpy as np

from crosscheck.engines.methods import Batch, Method, Model, Use, priced
from crosscheck.engines.tree.joint_tree import Array
from crosscheck.engines.tree.newton import Loops, Tree, between, coarse, solved_rows
from crosscheck.engines.tree.scalars import LIMITS, MOST_NEWTON, LoopRows, ScalarNewton
from crosscheck.scenes.workloads import Workload
from refkin.model import Scene

NEAR = 1e-4
"""A Jacobian this near is taken for the next correction, too: what that leaves is about the product of both."""

WHO = "the adapter (NumPy on rows)"
"""Who ran Newton."""


class ManyLoops(Protocol):
    """An engine's L loops at B poses. Tree coordinate k is the engine's in `columns[k]`."""

    columns: Array

    def gaps(self, q: Array) -> Array:
        """Return the gaps (B, 2 L) at q (B, n)."""

    def slopes(self) -> Array:
        """Return their Jacobians (B, 2 L, n) at the poses whose gaps were asked for last."""

    def drift(self, v: Array, slopes: Array) -> Array:
        """Return the accelerations of the gaps (B, 2 L) at qdd = 0, at rates v (B, n) there, where slopes are known."""


def at_once_methods(
    engine: str,
    name: str,
    note: str,
    tree_of: Callable[[Scene], Tree],
    rows_of: Callable[[Loops], LoopRows],
    loops_of: Callable[[Loops, int], ManyLoops],
    batched: Callable[[float, Callable[[Scene], Model], Workload, int], Batch] | None = None,
) -> Iterator[Method]:
    """Yield Newton on an engine's loops at all times of a scene at once, stopped by the size of the correction.

    Parameters
    ----------
    engine, name, note : str
        What the methods are called, and what is said of them.
    tree_of, rows_of, loops_of : callable
        Scene of the plane -> its tree; loops of the tree -> what the engine says of them at one pose; and at so many.
    batched : callable, optional
        Limit, scene -> model, workload and order -> what is made of many mechanisms; by default one after the other.
    """

    def build(limit: float, scene: Scene) -> Model:
        loops = Loops.of(tree_of(scene))
        sweep = AtOnce(loops, loops_of(loops, len(scene.times)), rows_of, limit)
        return Model(sweep.solve, loops.tree.read)

    of_bench: dict[str, Any] = {"uses": frozenset({Use.PRICE, Use.BENCH})}
    for limit in LIMITS:
        own, more = partial(build, limit), of_bench if limit == LIMITS[-1] else {}
        if more and batched:
            more = more | {"batch": partial(batched, limit, own)}
        yield priced(engine, name, f"|dq| < {limit:g}", WHO, own, note, together=True, **more)


class AtOnce:
    """One mechanism at all times: a few poses one after another, then all at once."""

    def __init__(self, loops: Loops, rows: ManyLoops, rows_of: Callable[[Loops], LoopRows], limit: float) -> None:
        self.newton, self.t = ManyNewton(loops, rows, limit), np.array(loops.tree.scene.times)
        self.values, self.columns = loops.clock.values[:, :, 0], rows.columns
        self.coarse = coarse(self.t)
        few = Loops.of(replace(loops.tree, scene=replace(loops.tree.scene, times=tuple(self.coarse.tolist()))))
        self.few = ScalarNewton(few, rows_of(few), LIMITS[-2])

    def solve(self, order: int) -> list[Array]:
        """Return tree coordinates and rates (n, T) up to an order."""
        levels = self.newton.solved(self._guess(), self.values[1:], order)
        return [level[:, self.columns].T for level in levels]

    def _guess(self) -> Array:
        """Return guesses (T, n) by the cubics between the coarse poses."""
        q, v = np.array(self.few.solve(1)).transpose(1, 0, 2)
        guess = between(self.coarse, q, v, self.t)
        guess[:, self.newton.held] = self.values[0]
        return guess


class ManyNewton:
    """Newton on an engine's loops at B poses, in the engine's columns."""

    def __init__(self, loops: Loops, rows: ManyLoops, limit: float) -> None:
        self.rows, self.limit = rows, limit
        self.held, self.free = rows.columns[loops.clock.columns], rows.columns[loops.free]

    def solved(self, guess: Array, rates: Array, order: int) -> list[Array]:
        """Return coordinates and rates (B, n) up to an order from a guess like them; NaN where Newton does not end.

        `rates`, (2, B, d) or (2, 1, d), are rate and acceleration of the prescribed coordinates.
        """
        rows, free, q = self.rows, self.free, guess.copy()
        slope, off = guess, np.inf
        for _ in range(MOST_NEWTON):
            gap, anew = rows.gaps(q), not off <= NEAR
            slope = rows.slopes()[..., free] if anew else slope
            step = solved_rows(slope, gap)
            q[:, free] -= step
            size = np.max(np.abs(step))
            off = size if anew else off
            if off * size <= self.limit**2:
                break
        else:
            q[np.max(np.abs(step), axis=1) > self.limit] = np.nan
        levels = [q]
        if order:
            rows.gaps(q)
            jacobian = rows.slopes()
            levels.append(self._rates(jacobian, rates[0]))
        if order > 1:
            levels.append(self._rates(jacobian, rates[1], rows.drift(levels[1], jacobian)))
        return levels

    def _rates(self, jacobian: Array, held: Array, drift: Array | float = 0.0) -> Array:
        """Return the rates (B, n) for which rows and drift make 0, from those of the prescribed coordinates."""
        rates = np.empty((len(jacobian), jacobian.shape[2]))
        rates[:, self.held] = held
        moved = (jacobian[..., self.held] @ held[..., None])[..., 0]
        rates[:, self.free] = -solved_rows(jacobian[..., self.free], moved + drift)
        return rates
