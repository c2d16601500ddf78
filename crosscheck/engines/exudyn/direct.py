"""exudyn at its fastest: its own static Newton, called pose by pose on a solver that is set up once."""

from __future__ import annotations

from typing import Any

import exudyn as exu
import numpy as np

from crosscheck.engines import EngineError
from crosscheck.engines.exudyn.model import CURRENT, ExudynModel
from crosscheck.engines.exudyn.solve import rates_here
from crosscheck.scenes.workloads import Chain
from refkin.joints import Unit
from refkin.model import Scene

BARE = 1e-12
"""The norm of the residual, in sizes, at which its Newton stops where rounding does not let it reach a tighter one."""
CHAIN_TOLERANCE = 1e-9
"""The norm of the residual [m] at which its Newton stops on a chain; one correction more squares the error."""


class Direct:
    """One mechanism in exudyn, pose after pose from the extrapolated one.

    Raises
    ------
    EngineError
        If a driver's distance is set anew at each time: then extrapolating gains little, and the rows are ours in part.
    """

    def __init__(self, scene: Scene, unit: Unit, start: Any, tolerance: float) -> None:
        self.t, self.start, self.tolerance = scene.times, start, tolerance
        model = self.model = ExudynModel(scene.mechanism.bodies, scene.mechanism.constraints, unit)
        if any(block.cylinder is not None for _, block in model.blocks):
            raise EngineError("a driven distance is set anew at each time, which the direct Newton does not do")
        model.clock.tabulate(scene.times, 2)  # the laws themselves would be a good part of the time

    def solve(self, order: int) -> list[Any]:
        """Return coordinates and rates (n, T) up to an order, NaN where its Newton does not converge."""
        out = np.full((order + 1, self.model.n, len(self.t)), np.nan)
        for k, t in enumerate(self.t):
            self.model.clock.set(t, 2)
            out[0, :, k] = self._position(self._guess(out, k))
            if order and np.isfinite(out[0, 0, k]):
                out[1:, :, k] = rates_here(self.model, t, order)
        return list(out)

    def _guess(self, out: Any, k: int) -> Any:
        if k == 0 or not np.isfinite(out[0, 0, k - 1]):
            return self.start
        h = self.t[k] - self.t[k - 1]
        if len(out) > 2:
            return out[0, :, k - 1] + h * (out[1, :, k - 1] + 0.5 * h * out[2, :, k - 1])
        if len(out) > 1:
            return out[0, :, k - 1] + h * out[1, :, k - 1]
        if k == 1:
            return out[0, :, 0]
        return out[0, :, k - 1] + (out[0, :, k - 1] - out[0, :, k - 2]) * (h / (self.t[k - 1] - self.t[k - 2]))

    def _position(self, guess: Any) -> Any:
        model = self.model
        for tolerance in (self.tolerance, max(self.tolerance, BARE)):
            model.data.SetODE2Coordinates(guess, CURRENT)
            try:
                if model.newton(tolerance):
                    return model.data.GetODE2Coordinates(CURRENT)
            except EngineError:
                break
        return np.full(model.n, np.nan)


class ChainSolver:
    """A chain in exudyn, with its sparse solver, at one configuration."""

    def __init__(self, work: Chain) -> None:
        scene = work.scene
        self.start = work.start
        model = self.model = ExudynModel(scene.mechanism.bodies, scene.mechanism.constraints)
        model.settings.linearSolver.solverType = exu.LinearSolverType.EigenSparse
        model.solver.InitializeSolver(model.mbs, model.settings)
        model.set_time(scene.times[0])

    def run(self) -> int:
        """Let its Newton go from the start to a tolerance; return how many iterations it made."""
        self.model.data.SetODE2Coordinates(self.start, CURRENT)
        self.model.newton(CHAIN_TOLERANCE)
        return int(self.model.solver.it.newtonSteps)

    def answered(self) -> Any:
        """Return the coordinates (n,) where it ends, after one more correction."""
        self.run()
        self.model.newton(CHAIN_TOLERANCE)
        return self.model.data.GetODE2Coordinates(CURRENT)
