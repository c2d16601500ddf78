"""exudyn's fastest route: its own static Newton, called pose by pose on a solver that is set up once."""

from __future__ import annotations

from collections.abc import Iterator
from typing import Any

import exudyn as exu
import numpy as np

from crosscheck.engines.batch_route import LEVELS, Route, of_four_bars, whole
from crosscheck.engines.exudyn.model import CURRENT, ExudynModel, quiet_settings
from crosscheck.judge.of_batches import Piece
from crosscheck.scenes.works import SPEED, Chain, FourBars

CONFIGURATIONS = 3600
"""About so many configurations of a work are done."""
TOLERANCES = (5e-15, 1e-12)
"""The norm of the residual, in units of the longest length, at which its Newton stops; the second if need be."""
CHAIN_TOLERANCE = 1e-9
"""The norm of the residual [m] at which its Newton stops on a chain; one correction more squares the error."""
WHAT = "MainSolverStatic.Newton from the extrapolated pose"


def four_bars(work: FourBars) -> Route:
    """Return position by exudyn's Newton, velocity and acceleration from its own rows."""
    what = f"{WHAT}; rates by numpy.linalg.solve from its Jacobian, velocity rows and point accelerations"
    return _route("exudyn", work, LEVELS, what)


def positions(work: FourBars) -> Route:
    """Return the least that exudyn can be asked: positions alone."""
    return _route("exudyn-position", work, LEVELS[:1], WHAT)


def _route(name: str, work: FourBars, computes: tuple[str, ...], what: str) -> Route:
    part = work.first(max(1, CONFIGURATIONS // len(work.t)))
    solvers = [_Solver(part, lane, len(computes)) for lane in range(part.mechanisms)]

    def pieces() -> Iterator[Piece]:
        for lane, solver in enumerate(solvers):
            yield whole(part, np.array([lane]), solver.run()[:, :, None])

    return of_four_bars(
        name,
        part,
        lambda: [solver.run() for solver in solvers],
        pieces,
        driven_by="Python: pose after pose; exudyn iterates",
        what=what,
        computes=computes,
    )


class _Solver:
    """One mechanism in exudyn, set up once."""

    def __init__(self, work: FourBars, lane: int, levels: int) -> None:
        scene = work.scene(lane)
        self.t, self.levels, self.start = work.t.tolist(), levels, work.starts[:, lane]
        self.model = ExudynModel(scene.mechanism.bodies, scene.mechanism.constraints)
        self.settings = quiet_settings()
        self.settings.staticSolver.newton.relativeTolerance = 0.0
        self.settings.staticSolver.newton.absoluteTolerance = TOLERANCES[0]
        self.size = float(np.max(work.lengths[:, lane]))
        self.model.solver.InitializeSolver(self.model.mbs, self.settings)

    def run(self) -> Any:
        """Return the levels (levels, 9, T)."""
        out = np.empty((self.levels, 9, len(self.t)))
        for k, t in enumerate(self.t):
            out[0, :, k] = self._position(t, self._guess(out, k))
            if self.levels > 1:
                out[1:, :, k] = self._rates(t, out[0, :, k])
        return out

    def _guess(self, out: Any, k: int) -> Any:
        if k == 0:
            return self.start
        if self.levels > 1:
            h = self.t[k] - self.t[k - 1]
            return out[0, :, k - 1] + h * (out[1, :, k - 1] + 0.5 * h * out[2, :, k - 1])
        return out[0, :, 0] if k == 1 else 2.0 * out[0, :, k - 1] - out[0, :, k - 2]

    def _position(self, t: float, guess: Any) -> Any:
        model = self.model
        model.clock.values[0] = (SPEED * t, SPEED, 0.0)  # the law itself would be a good part of the time
        for tolerance in TOLERANCES:
            model.data.SetODE2Coordinates(guess, CURRENT)
            model.solver.newton.absoluteTolerance = tolerance * self.size
            try:
                if model.solver.Newton(model.mbs, self.settings):
                    return model.data.GetODE2Coordinates(CURRENT)
            except (exu.SolverError, exu.InternalError):
                break
        return np.full(9, np.nan)

    def _rates(self, t: float, q: Any) -> Any:
        """Return velocity and acceleration; exudyn is at the pose already."""
        model, solver, n = self.model, self.model.solver, self.model.n
        model.data.SetODE2Coordinates_t(_STILL, CURRENT)
        solver.ComputeAlgebraicEquations(model.mbs, True)
        right = -solver.GetSystemResidual()[n:]
        solver.ComputeJacobianODE2RHS(model.mbs, scalarFactor_ODE2=0, scalarFactor_ODE2_t=0, scalarFactor_ODE1=0)
        solver.ComputeJacobianAE(model.mbs)
        jacobian = solver.GetSystemJacobian()[n:, :n]
        try:
            qd = np.linalg.solve(jacobian, right)
            model.data.SetODE2Coordinates_t(qd, CURRENT)
            drift = np.zeros(model.m)
            for rows, block in model.blocks:
                drift[rows] = tuple(block.drift())
            return qd, np.linalg.solve(jacobian, drift)
        except np.linalg.LinAlgError:
            return np.full((2, 9), np.nan)


_STILL = np.zeros(9)


class ChainSolver:
    """A chain in exudyn, with its sparse solver, at one configuration."""

    def __init__(self, work: Chain, start: Any) -> None:
        scene = work.scene
        self.start = start
        self.model = ExudynModel(scene.mechanism.bodies, scene.mechanism.constraints)
        self.settings = quiet_settings()
        self.settings.linearSolver.solverType = exu.LinearSolverType.EigenSparse
        self.settings.staticSolver.newton.relativeTolerance = 0.0
        self.model.solver.InitializeSolver(self.model.mbs, self.settings)
        self.model.set_time(scene.times[0])

    def run(self, tolerance: float = CHAIN_TOLERANCE) -> int:
        """Let its Newton go from the start to a tolerance; return how many iterations it made."""
        model, solver = self.model, self.model.solver
        model.data.SetODE2Coordinates(self.start, CURRENT)
        solver.newton.absoluteTolerance = tolerance
        solver.Newton(model.mbs, self.settings)
        return int(solver.it.newtonSteps)

    def answered(self) -> Any:
        """Return the coordinates (n,) where it ends, after one more correction."""
        self.run()
        self.model.solver.Newton(self.model.mbs, self.settings)
        return self.model.data.GetODE2Coordinates(CURRENT)
