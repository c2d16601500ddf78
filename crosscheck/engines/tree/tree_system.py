"""The equations of a joint tree: an engine's rows for its loops, and the adapter's for the drivers.

An engine supplies rows for the joints that its tree leaves open, and the motion of points (`TreeEngine`). Driver rows
are appended here, the same way for every engine; `loop_closing` solves the whole.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import Protocol

import numpy as np

from crosscheck.engines import EngineError
from crosscheck.engines.tree.joint_tree import Array, JointTree
from refkin.joints import GROUND, AngleDriver, DistanceDriver, Driver, Pair, XDriver, YDriver


class TreeEngine(Protocol):
    """An engine's model of a `JointTree`, in the tree's coordinates, unit of length and origin.

    Arrays are fresh copies. Points are given in their body's own frame, in units of the size; never on the ground.

    Attributes
    ----------
    tree : JointTree
    closure_rows : int
        The number of rows that the tree's closures have.
    """

    tree: JointTree
    closure_rows: int

    def closure(self, q: Array) -> tuple[Array, Array]:
        """Return the residual (closure_rows,) of the tree's closures and its Jacobian (closure_rows, n)."""

    def closure_drift(self, q: Array, qd: Array) -> Array:
        """Return gamma of the closures (closure_rows,): their Jacobian times qdd equals it."""

    def point(self, q: Array, body: str, u: Pair) -> tuple[Array, Array]:
        """Return a point of a body in the ground frame (2,), and its Jacobian (2, n)."""

    def point_drift(self, q: Array, qd: Array, body: str, u: Pair) -> Array:
        """Return the acceleration of a point (2,) at qdd = 0."""


class TreeSystem:
    """The rows to be solved: the engine's closures, then the drivers, which the adapter appends.

    A driver's row rests on the engine's motion of its points; an angle driver's on the sum of the joint angles alone.
    A distance driver's is (d . d - f^2) / 2, divided by the number f (t is fixed while it is solved).
    """

    def __init__(self, engine: TreeEngine, drivers: Sequence[Driver]) -> None:
        for driver in drivers:
            if not isinstance(driver, AngleDriver | XDriver | YDriver | DistanceDriver):
                raise EngineError(f"driver {driver.name!r} of type {driver.type}: a joint tree has no row for it")
        self.engine, self.tree, self.drivers = engine, engine.tree, tuple(drivers)
        self._known: tuple[float, list[tuple[float, float]]] = (math.nan, [])

    def position(self, q: Array, t: float) -> tuple[Array, Array]:
        """Return the residual (m,) and its Jacobian (m, n)."""
        residual, jacobian = self.engine.closure(q)
        rows = [self._position(driver, law[0], q) for driver, law in zip(self.drivers, self._laws(t), strict=True)]
        return np.concatenate([residual, [r for r, _ in rows]]), np.vstack([jacobian, *(row for _, row in rows)])

    def nu(self, t: float) -> Array:
        """Return the right side (m,) of the velocities: zero for a closure, the law's rate for a driver."""
        return np.concatenate([np.zeros(self.engine.closure_rows), [law[1] for law in self._laws(t)]])

    def gamma(self, q: Array, qd: Array, t: float) -> Array:
        """Return the right side (m,) of the accelerations."""
        own = [
            self._gamma(driver, (*law, self._law(driver, t, 2)), q, qd)
            for driver, law in zip(self.drivers, self._laws(t), strict=True)
        ]
        return np.concatenate([self.engine.closure_drift(q, qd), own])

    def _position(self, driver: Driver, f: float, q: Array) -> tuple[float, Array]:
        if isinstance(driver, AngleDriver):
            i, j = driver.bodies
            return self.tree.angle(j, q) - self.tree.angle(i, q) - f, self._turn(driver)
        if isinstance(driver, DistanceDriver):
            d, jacobian = self._gap(driver, q)
            return float(d @ d - f * f) / (2.0 * (f or 1.0)), d @ jacobian / (f or 1.0)
        assert isinstance(driver, XDriver | YDriver)
        k = _component(driver)
        r, jacobian = self._point(q, driver.body, driver.point)
        return r[k] - f, jacobian[k]

    def _gamma(self, driver: Driver, law: tuple[float, float, float], q: Array, qd: Array) -> float:
        f, fd, fdd = law
        if isinstance(driver, AngleDriver):
            return fdd
        if isinstance(driver, DistanceDriver):
            d, jacobian = self._gap(driver, q)
            rate = jacobian @ qd
            drift = self._drift(q, qd, driver.body_j, driver.point_j) - self._drift(
                q, qd, driver.body_i, driver.point_i
            )
            return (fd * fd + f * fdd - float(rate @ rate) - float(d @ drift)) / (f or 1.0)
        assert isinstance(driver, XDriver | YDriver)
        return fdd - float(self._drift(q, qd, driver.body, driver.point)[_component(driver)])

    def _turn(self, driver: AngleDriver) -> Array:
        i, j = driver.bodies
        return self.tree.angle_rows[j] - self.tree.angle_rows[i]

    def _gap(self, driver: DistanceDriver, q: Array) -> tuple[Array, Array]:
        r_i, jacobian_i = self._point(q, driver.body_i, driver.point_i)
        r_j, jacobian_j = self._point(q, driver.body_j, driver.point_j)
        return r_j - r_i, jacobian_j - jacobian_i

    def _point(self, q: Array, body: str, u: Pair) -> tuple[Array, Array]:
        scaled = self.tree.scaled(body, u)
        if body == GROUND:
            return np.array(scaled), np.zeros((2, self.tree.width))
        return self.engine.point(q, body, scaled)

    def _drift(self, q: Array, qd: Array, body: str, u: Pair) -> Array:
        if body == GROUND:
            return np.zeros(2)
        return self.engine.point_drift(q, qd, body, self.tree.scaled(body, u))

    def _laws(self, t: float) -> list[tuple[float, float]]:
        """Return value and rate of each driver's law, kept for the corrections that follow at the same time."""
        if self._known[0] != t:
            self._known = t, [(self._law(driver, t, 0), self._law(driver, t, 1)) for driver in self.drivers]
        return self._known[1]

    def _law(self, driver: Driver, t: float, order: int) -> float:
        value = float(driver.laws[0](t, order))
        if isinstance(driver, AngleDriver):
            return value
        if order == 0 and not isinstance(driver, DistanceDriver):
            value -= self.tree.origin[_component(driver)]
        return value / self.tree.size


def _component(driver: Driver) -> int:
    return 1 if isinstance(driver, YDriver) else 0
