"""exudyn's own constraint rows of a mechanism: residual, Jacobian, constraint velocity, drift, at any configuration."""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from contextlib import suppress
from typing import Any

import exudyn as exu
import numpy as np

from crosscheck.engines import Array, EngineError, EngineRefusal
from crosscheck.engines.exudyn.parts import Builder, Clock
from crosscheck.engines.frames import RowMap
from crosscheck.engines.poses import EPS
from refkin.joints import SI, Constraint, Unit
from refkin.model import Body

CURRENT = exu.ConfigurationType.Current
STILL = np.zeros(3)
ITERATIONS = int(exu.SimulationSettings().staticSolver.newton.maxIterations)
"""exudyn's own limit."""
FAR, MORE = 64.0, 8
"""Coordinates [sizes, rad] beyond which so many corrections follow, as the tolerance has grown with them."""
NO_LAW = NO_FORCES = (0.0, 0.0, 0.0)
"""By what the parts of the Jacobian are scaled that are no constraint's."""


class ExudynSystem:
    """exudyn's system of a mechanism and its solvers of a pose: what models of the plane and of space share.

    A row that is the length of a driven distance is exudyn's |d| - f, which knows no f'. The map from ours,
    x = (d . d - f^2) / 2 = y (y + 2 f) / 2, would depend on time; so it is turned into x: x_q = |d| y_q. Of a law below
    zero, which our square does not tell from its absolute value, exudyn is given that.

    It has n coordinates and m rows, which may depend on each other if it is `redundant`; its static Newton, by its
    `settings`, stops by an absolute tolerance alone. One that is `plain` has rates of one pose (`ExudynModel.rates`).
    """

    plain = False

    def __init__(self) -> None:
        exu.config.printToConsole = False  # for the whole process: exudyn knows no smaller scope
        exu.config.suppressWarnings = True
        self.container = exu.SystemContainer()
        self.mbs = self.container.AddSystem()
        self.settings = quiet_settings()
        self.settings.staticSolver.newton.relativeTolerance = 0.0

    def begin(self, *, redundant: bool) -> None:
        """Set its static solver up for the assembled system."""
        self.redundant = redundant
        if redundant:
            bear_redundant_rows(self.settings)
        self.data, self.solver = self.mbs.systemData, exu.MainSolverStatic()
        self.solver.InitializeSolver(self.mbs, self.settings)
        self.n, self.m = self.solver.GetODE2size(), self.solver.GetAEsize()

    def rest(self) -> None:
        """Put its bodies at rest, as they were when it was built: friction and dampers feel rates that were left."""
        self.data.SetODE2Coordinates_t(np.zeros(self.n), CURRENT)

    def lengths(self) -> Sequence[tuple[int, float]]:
        """Return exudyn's row and |f| of each driven distance at the present time."""
        raise NotImplementedError

    def equations(self, *, of_velocity: bool = False) -> Array:
        """Return exudyn's rows (m,) where it stands, as it has them."""
        try:
            self.solver.ComputeAlgebraicEquations(self.mbs, of_velocity)
        except exu.InternalError as error:
            raise EngineError(f"exudyn: {error}") from error
        return self.left()

    def left(self) -> Array:
        """Return exudyn's rows (m,) where they were computed last, be it by its own Newton."""
        rows: Array = self.solver.GetSystemResidual()[self.n :]
        return rows

    def squared(self, rows: Array) -> Array:
        """Return rows that exudyn has as ours: those of driven distances as (d . d - f^2) / 2."""
        for row, f in self.lengths():
            rows[row] *= 0.5 * (rows[row] + 2.0 * f)
        return rows

    def slopes(self, rows: Array | None = None) -> Array:
        """Return the Jacobian (m, n) of `squared` rows where exudyn stands; `rows` are its own there, if known."""
        try:
            # The first call only clears the matrix, to which the second adds.
            self.solver.ComputeJacobianODE2RHS(self.mbs, *NO_FORCES)
            self.solver.ComputeJacobianAE(self.mbs)
        except exu.InternalError as error:
            raise EngineError(f"exudyn: {error}") from error
        slopes: Array = self.solver.GetSystemJacobian()[self.n :, : self.n]
        return self.times_lengths(slopes, rows)

    def times_lengths(self, values: Array, rows: Array | None = None) -> Array:
        """Return what exudyn has of each row with those of driven distances times |d|, which its row says."""
        lengths = self.lengths()
        if lengths:
            rows = self.equations() if rows is None else rows
            for row, f in lengths:
                values[row] *= rows[row] + f
        return values

    def set_length(self, item: Any, name: str, t: float, length: float) -> None:
        """Set a driven distance; EngineError if exudyn takes none of that length, and a refusal if that is zero.

        There its row has no gradient, nor has ours.
        """
        try:
            self.mbs.SetObjectParameter(item, "distance", length)
        except exu.ExudynValueError as error:
            kind = EngineError if length else EngineRefusal
            raise kind(f"exudyn: driver {name!r} at t = {t!r}: {error}") from error

    def newton(self, tolerance: float, most: int = ITERATIONS) -> bool:
        """Let its static Newton go from where exudyn stands; return whether it reached a norm of the residual.

        It takes so many iterations at most, and leaves exudyn where it ended.
        """
        self.solver.newton.absoluteTolerance, self.solver.newton.maxIterations = tolerance, most
        try:
            return bool(self.solver.Newton(self.mbs, self.settings))
        except (exu.SolverError, exu.InternalError) as error:
            raise EngineError(f"its Newton stopped: {_first_line(error)}") from error

    def solve_static(self, start: Array, settings: Any) -> None:
        """Let mbs.SolveStatic go from exudyn's own coordinates; exudyn stands at the answer then."""
        self.data.SetODE2Coordinates(start, exu.ConfigurationType.Initial)
        try:
            success = self.mbs.SolveStatic(settings)
        except (exu.SolverError, exu.InternalError) as error:
            raise EngineError(f"SolveStatic: {_first_line(error)}") from error
        if not success:
            raise EngineError("SolveStatic reported no success")

    def drifts(self, q: Array, qd: Array, t: Array) -> Array:
        """Return gamma at several configurations."""
        raise NotImplementedError

    def drift(self, q: Array, qd: Array, t: float) -> Array:
        """Return gamma: minus the second derivative of rows, from exudyn's accelerations of points, at qdd = 0."""
        return self.drifts(q[None], qd[None], np.array([t]))[0]

    def close(self) -> None:
        """Free what exudyn holds."""
        self.container.Reset()


class ExudynModel(ExudynSystem):
    """A mechanism in exudyn, at configurations that need not be assembled.

    Lengths are in the unit given, metres by default. Arrays returned are fresh copies, columns (x, y, phi) per body. A
    `mass`, which is the inertia too, is for exudyn's time integration; `more` adds to the system what is no constraint,
    before it is assembled. `rows` say how exudyn's rows follow from ours; those that are not empty are `live`, in the
    order of ours.
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
        super().__init__()
        self.clock = Clock()
        self._distances_at = math.nan
        self._moved: Array | None = None
        builder = Builder(self.mbs, bodies, constraints, unit, self.clock, mass)
        if more is not None:
            more(builder)
        self.mbs.Assemble()
        data = self.mbs.systemData
        for k, body in enumerate(bodies):
            columns = list(data.GetObjectLTGODE2(builder.bodies[body.name]))
            if columns != [3 * k, 3 * k + 1, 3 * k + 2]:
                raise EngineError(f"exudyn keeps the coordinates of body {body.name!r} in columns {columns}")
        self.lines, self.read = builder.rows, builder.read
        self.live = [list(data.GetObjectLTGAE(line.item))[line.own] for line in self.lines]
        self.rows: Sequence[RowMap] = tuple(
            RowMap(constraint=line.name, row=line.row, engine_row=at, factor=line.factor, form=line.form)
            for at, line in zip(self.live, self.lines, strict=True)
        )
        pairs = list(zip(self.live, self.lines, strict=True))
        self._driven = [(at, line, line.law) for at, line in pairs if line.what == "length" and line.law is not None]
        pins = [(at, line) for at, line in pairs if line.what == "d" and line.law is None]
        moved = [(at, line) for at, line in pairs if line.what or line.law is not None]
        self._others = [pair for pair in moved if pair not in pins]
        self._pins, self._ends = [at for at, _ in pins], self.read.ends([line for _, line in pins])
        self._factors = np.array([line.factor for _, line in pins])
        self.powers = np.array([line.power for line in self.lines])
        self.begin(redundant=len(self.live) > 3 * len(bodies))
        turns = not any(line.what for _, line in self._others)
        self.plain = turns and not self.redundant and sorted(self.live) == list(range(self.m))

    def residual(self, q: Array, t: float) -> Array:
        """Return exudyn's residual, (m,).

        Raises EngineError where it has none: where the points of a distance coincide, or a driven one is not positive.
        """
        self.set_state(q, t)
        return self.squared(self.equations())

    def jacobian(self, q: Array, t: float) -> Array:
        """Return exudyn's constraint Jacobian, (m, n); raises as `residual` does."""
        self.set_state(q, t)
        return self.slopes()

    def constraint_velocity(self, q: Array, qd: Array, t: float) -> Array:
        """Return exudyn's residual of velocities, phi_q qd + phi_t, (m,); raises as `residual` does."""
        self.set_state(q, t, qd)
        rows = self.times_lengths(self.equations(of_velocity=True))
        for row, _, law in self._driven:  # what they owe to f', which exudyn knows not
            f, fd, _ = self.clock.values[law]
            rows[row] -= f * fd
        return rows

    def at_rest(self, q: Array, t: Array) -> Array:
        """Return exudyn's rows of velocity (B, m) at times (B,) while bodies rest at q, NaN where it has none there.

        They are what the rates of laws move, wherever bodies are: exudyn is asked once for each law, at a rate of 1.
        """
        if self._moved is None:
            with suppress(EngineError):
                self._moved = self._moved_by_laws(q)
        if self._moved is None:
            return np.full((len(t), self.m), math.nan)
        f, fd, _ = self.clock.over(t, 1).transpose(1, 0, 2)
        rows = fd.T @ self._moved
        for row, _, law in self._driven:
            rows[:, row] -= f[law] * fd[law]
        return rows

    def _moved_by_laws(self, q: Array) -> Array:
        """Return what a rate of 1 of each law makes of exudyn's rows of velocity, (laws, m)."""
        self.data.SetODE2Coordinates(q, CURRENT)
        self.data.SetODE2Coordinates_t(np.zeros(self.n), CURRENT)
        moved = np.zeros((len(self.clock.laws), self.m))
        for law, rows in enumerate(moved):
            self.clock.at_rate(law)
            rows[:] = self.equations(of_velocity=True)
        return moved

    def drifts(self, q: Array, qd: Array, t: Array) -> Array:
        """Return gamma (B, m) at q (B, n), qd (B, n), t (B,): read state by state, put together for all at once.

        The rows of pins, which most are, are taken all together, too.
        """
        place, move, read = self.data.SetODE2Coordinates, self.data.SetODE2Coordinates_t, self.read.now
        states = []
        for at, rate in zip(q, qd, strict=True):
            place(at, CURRENT)
            move(rate, CURRENT)
            states.append(read())
        self.read.keep(states)
        laws, out = self.clock.over(t, 2), np.zeros((len(t), self.m))
        i, j = map(self.read.at, self._ends)
        out[:, self._pins] = (i - j) * self._factors
        for at, line in self._others:
            out[:, at] = -line.factor * self.read.bend(line, NO_LAW if line.law is None else laws[line.law])
        return out

    def rates(self, q: Array, t: float, order: int) -> list[Array]:
        """Return the rates (n,) of one pose up to an order, NaN where singular, of a model that is `plain`.

        That is one of pins and angles alone, no row of which is empty or redundant. For one pose all that is made for
        many takes three times as long.
        """
        slopes = self.jacobian(q, t)
        if self._moved is None:
            self.at_rest(q, np.array([t]))
        self.clock.set(t, order)
        laws, limit = np.array(self.clock.values), self.n * EPS * np.abs(slopes).max()
        rates = [_sound(slopes, -(laws[:, 1] @ self._moved), limit)]
        if order > 1:
            self.data.SetODE2Coordinates_t(rates[0], CURRENT)
            read, right = np.concatenate((*self.read.now(), STILL)), np.zeros(self.m)
            i, j = self._ends
            right[self._pins] = (read[i] - read[j]) * self._factors
            for at, line in self._others:
                right[at] = line.factor * laws[line.law, 2]
            rates.append(_sound(slopes, right, limit))
        return rates

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
        self._distances_at = math.nan  # a length that exudyn does not take leaves the others set
        for _, line, law in self._driven:
            self.set_length(line.item, line.name, t, abs(self.clock.values[law][0]))
        self._distances_at = t

    def lengths(self) -> Sequence[tuple[int, float]]:
        return [(row, abs(self.clock.values[law][0])) for row, _, law in self._driven]


def _sound(matrix: Array, right: Array, limit: float) -> Array:
    """Return x (n,) with matrix x = right; NaN where singular, or where the rounding of the matrix alone makes x.

    `limit` is what that makes of each unit of x.
    """
    with suppress(np.linalg.LinAlgError):
        x: Any = np.linalg.solve(matrix, right)
        if limit * largest_of(x) <= largest_of(right):
            return x
    return np.full(len(right), math.nan)


def largest_of(x: Array) -> float:
    """Return the largest component of a short vector, infinite if one is not finite."""
    values = x.tolist()
    return max(max(values), -min(values)) if math.isfinite(sum(values)) else math.inf


def quiet_settings() -> Any:
    """Return exudyn's shipped settings, except that no file is written."""
    settings = exu.SimulationSettings()
    settings.solution.file.write = False
    return settings


def bear_redundant_rows(settings: Any) -> None:
    """Choose a linear solver that bears redundant rows: exudyn's default stops at their matrix."""
    settings.linearSolver.solverType = exu.LinearSolverType.EigenDense
    settings.linearSolver.ignoreSingularJacobian = True


def _first_line(error: Exception) -> str:
    return str(error).strip().splitlines()[0]
