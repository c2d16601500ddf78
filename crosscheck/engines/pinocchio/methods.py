"""Pinocchio's methods, and its fastest: a joint tree, its loops closed by Newton on the coordinates that are free.

Pinocchio closes no loops itself. Residual, Jacobian and point accelerations are its own; Newton and systems of two
equations are done here in scalars, because two calls of numpy.linalg.solve would take longer than all of its work.
"""

from __future__ import annotations

from collections.abc import Iterator
from functools import partial
from typing import Any

import numpy as np

from crosscheck.engines.methods import Method, Model, Use, of_routes
from crosscheck.engines.pinocchio.engine import Pinocchio
from crosscheck.engines.pinocchio.rows import element_rows
from crosscheck.engines.pinocchio.space import PinocchioSpace
from crosscheck.engines.pinocchio.stepping import stepping_methods, tree_of
from crosscheck.engines.tree.newton import Loops, newton_methods, solved_one
from refkin.model import Scene

LIMITS = (1e-2, 1e-4, 1e-8)
"""Largest correction at which Newton stops; it squares the error."""
MOST_NEWTON = 12


def methods() -> Iterator[Method]:
    """Yield the methods of Pinocchio."""
    yield from of_routes(Pinocchio(), frozenset({Use.COMPARE, Use.PRICE, Use.EFFECTS, Use.HARD}))
    for limit in LIMITS:
        yield Method(
            engine="pinocchio",
            name="Newton on free coordinates",
            setting=f"|dq| < {limit:g}",
            newton_by="the adapter (in scalars)",
            uses=frozenset({Use.PRICE, Use.BENCH}) if limit == LIMITS[-1] else frozenset({Use.PRICE}),
            build=partial(_direct, limit),
            note="each pose from the extrapolated one; laws are tabulated with the model",
        )
    yield from newton_methods("pinocchio", tree_of, PinocchioSpace)
    yield from stepping_methods()


def _direct(limit: float, scene: Scene) -> Model:
    loops = Loops.of(tree_of(scene))
    return Model(Direct(loops, limit).solve, loops.tree.read)


class Direct:
    """One mechanism, pose after pose."""

    def __init__(self, loops: Loops, limit: float) -> None:
        self.loops, self.limit, self.t = loops, limit, loops.tree.scene.times
        engine: Any = loops.tree.engine
        joints, self.planar = engine.tree, engine.planar
        self.ends = [element_rows(self.planar, element, joints.scaled) for element in joints.closures]
        self.start, self.held, self.free = joints.start(), loops.clock.columns, loops.free
        self.values = loops.clock.values[:, :, 0]
        self.still = np.zeros(joints.width)

    def solve(self, order: int) -> list[Any]:
        """Return tree coordinates and rates (n, T) up to an order; NaN from where Newton does not converge."""
        out = np.full((order + 1, len(self.start), len(self.t)), np.nan)
        q, v, before = self.start.copy(), self.still, self.still
        for k in range(len(self.t)):
            if k:
                h = self.t[k] - self.t[k - 1]
                q = q + h * (v + 0.5 * h * self._bend(out, k, v, before))
            jacobian = self._close(q, k)
            if jacobian is None:
                break
            if order:
                jacobian = self._closure(q)[1]
            before, v = v, self._velocity(jacobian, self.values[1, k])
            for level, row in zip(out, (q, v), strict=False):
                level[:, k] = row
            if order > 1:
                out[2, :, k] = self._acceleration(jacobian, q, v, self.values[2, k])
        return list(out)

    def _bend(self, out: Any, k: int, v: Any, before: Any) -> Any:
        """Return the acceleration at the last time, or how the last two velocities differ."""
        if len(out) > 2:
            return out[2, :, k - 1]
        return (v - before) / (self.t[k - 1] - self.t[k - 2]) if k > 1 else self.still

    def _close(self, q: Any, k: int) -> Any:
        """Close the loops at a time from q, which is changed; return the last Jacobian, None without convergence."""
        q[self.held] = self.values[0, k]
        for _ in range(MOST_NEWTON):
            gap, jacobian = self._closure(q)
            step = solved_one(jacobian[:, self.free], gap)
            q[self.free] -= step
            if max(map(abs, step.tolist())) <= self.limit:
                return jacobian
        return None

    def _velocity(self, jacobian: Any, rate: Any) -> Any:
        v = np.empty(len(self.start))
        v[self.held] = rate
        v[self.free] = -solved_one(jacobian[:, self.free], jacobian[:, self.held] @ rate)
        return v

    def _acceleration(self, jacobian: Any, q: Any, v: Any, rate: Any) -> Any:
        self.planar.move(q, v)
        a = np.empty(len(self.start))
        a[self.held] = rate
        a[self.free] = -solved_one(jacobian[:, self.free], self._drift() + jacobian[:, self.held] @ rate)
        return a

    def _closure(self, q: Any) -> tuple[Any, Any]:
        """Return the gaps of the loops (2 L,) and their Jacobian (2 L, n)."""
        self.planar.place(q)
        rows, gaps = zip(*([read()[:2] for read, _ in row.still] for row in self.ends), strict=True)
        return (gaps[0], rows[0]) if len(rows) == 1 else (np.concatenate(gaps), np.concatenate(rows))

    def _drift(self) -> Any:
        """Return the accelerations of the gaps (2 L,) as the model moves."""
        rows = [np.subtract(*(read()[:2] for read, _ in row.bends)) for row in self.ends]
        return rows[0] if len(rows) == 1 else np.concatenate(rows)
