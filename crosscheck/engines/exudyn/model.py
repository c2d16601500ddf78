"""exudyn's own constraint rows of a mechanism: residual, Jacobian, constraint velocity, drift, at any configuration."""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping, Sequence
from typing import Any

import exudyn as exu
import numpy as np

from crosscheck.engines import Array, EngineError, EngineRefusal
from crosscheck.engines.exudyn.parts import Block, Builder, Clock
from crosscheck.engines.frames import RowMap
from refkin.joints import SI, Constraint, Unit
from refkin.model import Body

CURRENT = exu.ConfigurationType.Current


class ExudynModel:
    """A mechanism in exudyn, at configurations that need not be assembled.

    Lengths are in the unit given, metres by default. Arrays returned are fresh copies, columns (x, y, phi) per body.

    Parameters
    ----------
    bodies : sequence of Body
        Their order is that of the columns.
    constraints : sequence of Constraint
        Joints and drivers that exudyn can express.
    unit : Unit
        Length of one unit, and the ground point that becomes the origin.
    mass : float
        Mass and inertia of each body: none for kinematics, some for exudyn's time integration.
    more : callable, optional
        Adds to the system what is no constraint, before it is assembled.

    Attributes
    ----------
    n, m : int
        Number of coordinates, and of exudyn's rows. A row that no RowMap names is empty.
    rows : tuple of RowMap
        How exudyn's rows follow from ours.
    live : list of int
        exudyn's rows that are not empty, in the order of ours.
    """

    owns_driver = True

    def __init__(
        self,
        bodies: Sequence[Body],
        constraints: Sequence[Constraint],
        unit: Unit = SI,
        mass: float = 0.0,
        more: Callable[[Builder], None] | None = None,
    ) -> None:
        if any(c.kind.name == "spatial" for c in constraints):
            raise EngineRefusal("a model of the plane takes no mechanism of space")
        exu.config.printToConsole = False  # for the whole process: exudyn knows no smaller scope
        exu.config.suppressWarnings = True
        self.clock = Clock()
        self._distances_at = math.nan
        self.container = exu.SystemContainer()
        self.mbs = self.container.AddSystem()
        builder = Builder(self.mbs, bodies, constraints, unit, self.clock, mass)
        if more is not None:
            more(builder)
        self.mbs.Assemble()
        self.data = self.mbs.systemData
        for k, body in enumerate(bodies):
            columns = list(self.data.GetObjectLTGODE2(builder.bodies[body.name]))
            if columns != [3 * k, 3 * k + 1, 3 * k + 2]:
                raise EngineError(f"exudyn keeps the coordinates of body {body.name!r} in columns {columns}")
        self.blocks = [(self._engine_rows(block), block) for block in builder.blocks]
        self.rows: Sequence[RowMap] = tuple(row for rows, block in self.blocks for row in _row_maps(rows, block))
        self.live = [row.engine_row for row in self.rows]
        self.read = builder.read
        self._driven = [(rows[0], b, b.cylinder) for rows, b in self.blocks if b.cylinder is not None]
        self.powers = np.array([power for _, block in self.blocks for power in block.powers])
        self.solver = exu.MainSolverStatic()
        self.solver.InitializeSolver(self.mbs, quiet_settings())
        self.n, self.m = self.solver.GetODE2size(), self.solver.GetAEsize()
        self.still = np.zeros(self.n)

    def _engine_rows(self, block: Block) -> list[int]:
        rows = list(self.data.GetObjectLTGAE(block.item))
        return rows[: len(block.maps)]

    def residual(self, q: Array, t: float) -> Array:
        """Return exudyn's residual, (m,).

        Raises
        ------
        EngineError
            Where exudyn has no answer: the two points of a distance constraint coincide, or a driven distance is not
            positive.
        """
        self.set_state(q, t)
        rows = self._algebraic_equations(velocity_level=False)
        for row, f, _ in self._cylinders():
            rows[row] *= 0.5 * (rows[row] + 2.0 * f)
        return rows

    def jacobian(self, q: Array, t: float) -> Array:
        """Return exudyn's constraint Jacobian, (m, n); raises as `residual` does."""
        self.set_state(q, t)
        return self._jacobian(self._driven_distances())

    def rows_here(self) -> tuple[Array, Array]:
        """Return residual (m,) and Jacobian (m, n) where exudyn stands; raises as `residual` does."""
        rows, cylinders = self._algebraic_equations(velocity_level=False), self._cylinders()
        jacobian = self._jacobian({row: rows[row] + f for row, f, _ in cylinders})
        for row, f, _ in cylinders:
            rows[row] *= 0.5 * (rows[row] + 2.0 * f)
        return rows, jacobian

    def _jacobian(self, distances: Mapping[int, float]) -> Array:
        try:
            # The first call only clears the matrix, to which the second adds.
            self.solver.ComputeJacobianODE2RHS(
                self.mbs, scalarFactor_ODE2=0, scalarFactor_ODE2_t=0, scalarFactor_ODE1=0
            )
            self.solver.ComputeJacobianAE(self.mbs)
        except exu.InternalError as error:
            raise EngineError(f"exudyn: {error}") from error
        rows: Array = self.solver.GetSystemJacobian()[self.n :, : self.n]
        for row, distance in distances.items():
            rows[row] *= distance
        return rows

    def constraint_velocity(self, q: Array, qd: Array, t: float) -> Array:
        """Return exudyn's residual of velocities, phi_q qd + phi_t, (m,); raises as `residual` does."""
        self.set_state(q, t, qd)
        distances = self._driven_distances()
        rows = self._algebraic_equations(velocity_level=True)
        for row, f, fd in self._cylinders():
            rows[row] = distances[row] * rows[row] - f * fd
        return rows

    def at_rest(self, q: Array, times: Sequence[float]) -> Array:
        """Return exudyn's rows of velocity (B, m) at times while bodies rest at q, NaN where exudyn has none."""
        out = np.full((len(times), self.m), math.nan)
        for rows, t in zip(out, times, strict=True):
            try:
                self.set_state(q, t, self.still)
                rows[:] = self._algebraic_equations(velocity_level=True)
            except EngineError:
                continue
            for row, f, fd in self._cylinders():
                rows[row] = -f * fd
        return out

    def drift(self, q: Array, qd: Array, t: float) -> Array:
        """Return gamma, (m,): phi_q qdd = gamma; from exudyn's accelerations of points at qdd = 0."""
        return self.drifts(q[None], qd[None], np.array([t]))[0]

    def drifts(self, q: Array, qd: Array, t: Array) -> Array:
        """Return gamma (B, m) at q (B, n), qd (B, n), t (B,): read state by state, put together for all at once."""
        place, move, read = self.data.SetODE2Coordinates, self.data.SetODE2Coordinates_t, self.read.now
        states = []
        for at, rate in zip(q, qd, strict=True):
            place(at, CURRENT)
            move(rate, CURRENT)
            states.append(read())
        table, laws = np.array(states).T, self.clock.over(t, 2)
        out = np.zeros((len(t), self.m))
        for rows, block in self.blocks:
            for row, values in zip(rows, block.drift(table, laws), strict=True):
                out[:, row] = values
        return out

    def close(self) -> None:
        """Free what exudyn holds."""
        self.blocks, self._driven = [], []
        self.container.Reset()

    def set_state(self, q: Array, t: float, qd: Array | None = None) -> None:
        """Put exudyn at (q, qd, t), with the laws' rates if there is a qd."""
        self.set_time(t, 0 if qd is None else 1)
        self.data.SetODE2Coordinates(q, CURRENT)
        if qd is not None:
            self.data.SetODE2Coordinates_t(qd, CURRENT)

    def set_time(self, t: float, order: int = 0) -> None:
        """Set the laws, and the driven distances with them, to time t."""
        self.clock.set(t, order)
        if t == self._distances_at:
            return
        for _, block, law in self._driven:
            try:
                self.mbs.SetObjectParameter(block.item, "distance", self.clock.values[law][0])
            except exu.ExudynValueError as error:
                raise EngineError(f"exudyn: driver {block.constraint!r} at t = {t!r}: {error}") from error
        self._distances_at = t

    def _algebraic_equations(self, velocity_level: bool) -> Array:
        try:
            self.solver.ComputeAlgebraicEquations(self.mbs, velocity_level)
        except exu.InternalError as error:
            raise EngineError(f"exudyn: {error}") from error
        rows: Array = self.solver.GetSystemResidual()[self.n :]
        return rows

    def _cylinders(self) -> list[tuple[int, float, float]]:
        """Return engine row, f and f' of each driven distance.

        exudyn's row is y = |d| - f, and it knows no f'. The map from ours, x = (d . d - f^2) / 2 = y (y + 2 f) / 2,
        would depend on time; so the model turns y into x: x_q = |d| y_q, x' = |d| |d|' - f f'.
        """
        return [(row, self.clock.values[law][0], self.clock.values[law][1]) for row, _, law in self._driven]

    def _driven_distances(self) -> dict[int, float]:
        """Return |d| of each driven distance by its engine row, as exudyn's own row gives it."""
        cylinders = self._cylinders()
        if not cylinders:
            return {}
        rows = self._algebraic_equations(velocity_level=False)
        return {row: rows[row] + f for row, f, _ in cylinders}


def quiet_settings() -> Any:
    """Return exudyn's shipped settings, except that no file is written."""
    settings = exu.SimulationSettings()
    settings.solution.file.write = False
    return settings


def _row_maps(engine_rows: list[int], block: Block) -> list[RowMap]:
    return [
        RowMap(
            constraint=block.constraint,
            row=block.first + k,
            engine_row=engine_row,
            factor=factor,
            form=form,
            derived=block.cylinder is not None,
        )
        for k, (engine_row, (factor, form)) in enumerate(zip(engine_rows, block.maps, strict=True))
    ]
