"""exudyn's methods: its static solver with tolerances swept, its Newton called directly, its time integration.

The static methods start each pose at the last one, as exudyn does by itself, be they called for each time or, by load
steps, once for all; the direct one starts at the extrapolated pose. Velocity and acceleration are solved from exudyn's
rows by NumPy, at all times at once, as it has no such analysis.
"""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import suppress
from functools import partial
from itertools import product
from typing import Any

import exudyn as exu
import numpy as np

from crosscheck.engines import EngineError, EngineRefusal, Level, in_space, refusals, refuse
from crosscheck.engines.exudyn.engine import STATIC, Exudyn
from crosscheck.engines.exudyn.integration import UNEVEN, Integration, check_even
from crosscheck.engines.exudyn.model import CURRENT, ExudynModel, bear_redundant_rows, quiet_settings
from crosscheck.engines.exudyn.solve import (
    BACK,
    ShippedSolve,
    StaticNewton,
    extrapolation,
    in_metres,
    rates_at,
    solved,
    start_of,
)
from crosscheck.engines.exudyn.space_solve import SpaceModel, unit
from crosscheck.engines.methods import Batch, Method, Model, Use, of_routes, one_by_one, priced
from crosscheck.scenes.workloads import LoopChain, Workload
from refkin.joints import SI, Unit
from refkin.model import Scene
from refkin.motion import Producer

TOLERANCES = (1e-1, 1e-2, 1e-4, 1e-6, 1e-8, 1e-10, 1e-12, 1e-14)
"""Norms of the residual at which the static solver stops, in sizes of the mechanism."""
DIRECT = (1e-4, 1e-8, 2e-15)
"""The same where poses are extrapolated; the last is round-off."""
BARE = 1e-12
"""The same where rounding does not let it reach a tighter one."""
CHAIN_TOLERANCE = 1e-9
"""The norm of the residual [m] at which its Newton stops on a chain; one correction more squares the error."""
IN_ONE_CALL = (None, 1e-8, 1e-12, 1e-14)
"""The same where one call goes through all times; None: as shipped."""
STEPS = (1, 3, 10, 30)
"""Steps of the time integration from one time of the scene to the next."""
SCALED = "lengths in sizes of the mechanism"
RATES = "rates: linear solves by the adapter"
INTEGRATED = {
    "SolveDynamic, trapezoidal, index 2": (exu.DynamicSolverType.TrapezoidalIndex2, None),
    "SolveDynamic, generalized-alpha, index 3": (exu.DynamicSolverType.GeneralizedAlpha, 0.5),
}
"""Name -> solver and spectral radius."""


def methods() -> Iterator[Method]:
    """Yield the methods of exudyn."""
    yield from of_routes(Exudyn(), frozenset({Use.COMPARE, Use.PRICE, Use.EFFECTS, Use.HARD}))
    for tolerance in DIRECT:
        best = tolerance == DIRECT[-1]
        more: dict[str, Any] = {"uses": frozenset({Use.PRICE, Use.BENCH}), "batch": _batched} if best else {}
        name, build = "MainSolverStatic.Newton, extrapolated", partial(_direct, tolerance)
        note = f"{SCALED}; laws are tabulated with the model; {RATES}"
        yield priced("exudyn", name, f"absoluteTolerance {tolerance:g}", "exudyn", build, note, **more)
    yield priced("exudyn", "SolveStatic, as shipped", "default tolerances", "exudyn", _shipped, RATES)
    for (name, by), tolerance in product((("SolveStatic", _static), ("MainSolverStatic.Newton", _newton)), TOLERANCES):
        setting, note = f"absoluteTolerance {tolerance:g}", f"{SCALED}; {RATES}"
        yield priced("exudyn", name, setting, "exudyn", partial(by, tolerance), note)
    for stop in IN_ONE_CALL:
        setting = "default tolerances" if stop is None else f"absoluteTolerance {stop:g}"
        note = "even times; " + f"{SCALED}; " * (stop is not None) + RATES
        build = partial(_in_one_call, stop)
        yield priced("exudyn", "SolveStatic, load steps", setting, "exudyn (in each step)", build, note, steps=True)
    for (name, (kind, radius)), steps in product(INTEGRATED.items(), STEPS):
        setting, build = f"{steps} step{'s' * (steps > 1)} between times", partial(_integrated, kind, radius, steps)
        note = "steps in time" + "; spectral radius 0.5" * (radius is not None)
        yield priced("exudyn", name, setting, "exudyn (in each step)", build, note, at_once=True, steps=True)


def _checked(scene: Scene) -> Scene:
    """Return a scene of the plane that exudyn can express; raise EngineRefusal if it is none."""
    refuse(refusals(Exudyn(), scene, Level.SOLVE))
    if in_space(scene.mechanism):
        raise EngineRefusal("this method is refused in space: the adapter has it for the plane alone")
    return scene


def _direct(tolerance: float, scene: Scene) -> Model:
    if in_space(scene.mechanism) and not refusals(Exudyn(), scene, Level.SOLVE):
        space = SpaceStatic(scene, tolerance)
        return Model(partial(space.solve, space.step), space.read)
    at = Static(_checked(scene), scene.mechanism.unit(), extrapolates=True)
    if at.model.lengths():
        raise EngineError("a driven distance is set anew at each time, which the direct Newton does not do")
    at.model.clock.tabulate(scene.times, 2)  # the laws themselves would be a good part of the time
    return at.by(partial(_once_or_bare, StaticNewton(at.model), tolerance))


def _once_or_bare(newton: StaticNewton, tolerance: float, t: float, start: Any) -> Any:
    with suppress(EngineError):
        return newton.once(t, start, tolerance)
    return newton.once(t, start, max(tolerance, BARE))


def _batched(workload: Workload, order: int) -> Batch:
    if isinstance(workload, LoopChain):
        solver = ChainSolver(workload)
        return Batch(solver.run, solver.run(), solver.answered)
    return one_by_one(partial(_direct, DIRECT[-1]), workload, order)


def _shipped(scene: Scene) -> Model:
    at = Static(_checked(scene), SI)
    return at.by(ShippedSolve(at.model, scene.mechanism.size()))


def _static(tolerance: float, scene: Scene) -> Model:
    at = Static(_checked(scene), scene.mechanism.unit())
    step = ShippedSolve(at.model, 1.0)
    _stop_at(tolerance, step.settings, at.model)
    return at.by(step)


def _stop_at(tolerance: float, settings: Any, model: ExudynModel) -> None:
    """Have SolveStatic stop by an absolute tolerance alone, and bear what rows there are."""
    settings.staticSolver.newton.absoluteTolerance = tolerance
    settings.staticSolver.newton.relativeTolerance = 0.0
    if model.redundant:
        bear_redundant_rows(settings)


def _newton(tolerance: float, scene: Scene) -> Model:
    at = Static(_checked(scene), scene.mechanism.unit())
    return at.by(partial(StaticNewton(at.model).once, tolerance=tolerance))


def _in_one_call(tolerance: float | None, scene: Scene) -> Model:
    at = LoadSteps(_checked(scene), SI if tolerance is None else scene.mechanism.unit(), tolerance)
    return Model(at.solve, partial(in_metres, at.unit))


def _integrated(kind: Any, radius: float | None, steps: int, scene: Scene) -> Model:
    unit = scene.mechanism.unit()
    integration = Integration(_checked(scene), unit, start_of(scene, unit))
    return Model(partial(integration.solve, kind, radius, steps), partial(in_metres, unit))


class Static:
    """A scene in exudyn's static solver, in a unit of length.

    Each pose is started at the last one that was reached; if it `extrapolates`, where the polynomial through the last
    `BACK` ones leads; if the one before was not reached, at the estimates. Rates are found at all times at once.
    """

    def __init__(self, scene: Scene, unit: Unit, *, extrapolates: bool = False) -> None:
        self.scene, self.unit, self.extrapolates = scene, unit, extrapolates
        self.model = ExudynModel(scene.mechanism.bodies, scene.mechanism.constraints, unit)
        self.start = start_of(scene, unit)
        self.times = np.array(scene.times)
        self.weights = extrapolation(self.times)

    def by(self, step: Any) -> Model:
        """Return the model that goes from pose to pose by `step`, (t, start) -> pose."""
        return Model(partial(self.solve, step), partial(in_metres, self.unit))

    def solve(self, step: Any, order: int) -> list[Any]:
        """Return the levels up to an order."""
        if len(self.times) == 1 and self.model.plain:
            return self._one(step, self.scene.times[0], order)
        levels = np.full((order + 1, len(self.times), len(self.start)), np.nan)
        q, start, since, weights = levels[0], self.start, 0, self.weights
        for k, t in enumerate(self.scene.times):
            if self.extrapolates and k > since:
                back = min(k - since, BACK)
                start = weights[k - since, -back:] @ q[k - back : k]
            try:
                q[k] = start = step(t, start)
            except EngineError:
                if self.extrapolates:
                    start, since, weights = self.start, k + 1, extrapolation(self.times[k + 1 :])
        return _with_rates(levels, self.times, self.rates)

    def rates(self, q: Any, times: Any, order: int) -> list[Any]:
        """Return the rates (B, n) of poses up to an order."""
        return rates_at(self.model, q, times, order)

    def _one(self, step: Any, t: float, order: int) -> list[Any]:
        """Return the levels of one pose: what is made for many costs as much as what exudyn does."""
        with suppress(EngineError):
            q = step(t, self.start)
            return [level[:, None] for level in (q, *(self.model.rates(q, t, order) if order else ()))]
        return [np.full((len(self.start), 1), np.nan)] * (order + 1)


class SpaceStatic(Static):
    """A scene of space, each pose by exudyn's Newton from where the polynomial through the last ones leads."""

    model: Any

    def __init__(self, scene: Scene, tolerance: float) -> None:
        kept = SpaceModel(scene, Producer(name="exudyn", version="", route=STATIC), (tolerance,))
        self.scene, self.extrapolates, self.tolerance = scene, True, tolerance
        self.equations, self.model, self.start = kept.equations, kept.model, kept.start
        self.times = np.array(scene.times)
        self.weights = extrapolation(self.times)

    def step(self, t: float, start: Any) -> Any:
        """Return the pose at a time from a start."""
        for tolerance in (self.tolerance, max(self.tolerance, BARE)):
            self.model.set_state(unit(start), t)
            with suppress(EngineError):
                if self.model.newton(tolerance):
                    return unit(self.model.coordinates())
        raise EngineError(f"its Newton did not reach {tolerance:g}")

    def read(self, levels: list[Any]) -> list[Any]:
        """Return an answer as levels of bodies (7 b, T) [m]."""
        return [self.equations.numbers.levels(level, order) for order, level in enumerate(levels)]

    def rates(self, q: Any, times: Any, order: int) -> list[Any]:
        """Return the rates (B, n) of poses up to an order."""
        if not order or not len(q):
            return [q] * order
        jacobians, right = self.equations.velocities(q, times)
        rates = [solved(jacobians, right)]
        if order > 1:
            rates.append(solved(jacobians, self.equations.gamma(q, rates[0], times)))
        return rates


class LoadSteps:
    """A scene in one call of exudyn's SolveStatic, which goes through its times by load steps, by a tolerance or none.

    Rates are found at all times at once. EngineRefusal where times are not even, or a distance is driven.
    """

    def __init__(self, scene: Scene, unit: Unit, tolerance: float | None) -> None:
        check_even(scene, "one call")
        self.unit, self.times, self.first = unit, np.array(scene.times), scene.times[0]
        self.step = (scene.times[-1] - self.first) / (len(scene.times) - 1)
        self.model = ExudynModel(scene.mechanism.bodies, scene.mechanism.constraints, unit)
        self.start = start_of(scene, unit)
        self.one, self.all = quiet_settings(), quiet_settings()
        steps = self.all.staticSolver
        steps.loadStepStart, steps.loadStepDuration = self.first, scene.times[-1] - self.first
        steps.numberOfLoadSteps = len(self.times) - 1
        for settings in (self.one, self.all):
            if tolerance is not None:
                _stop_at(tolerance, settings, self.model)

    def solve(self, order: int) -> list[Any]:
        """Return the levels up to an order, NaN from where SolveStatic stops."""
        model, levels = self.model, np.full((order + 1, len(self.times), len(self.start)), np.nan)
        model.clock.follows = False
        model.set_time(self.first)
        model.mbs.SetPostStepUserFunction(partial(_keep, levels[0], self.first, self.step))
        with suppress(EngineError):
            model.solve_static(self.start, self.one)
            levels[0][:], levels[0][0] = np.nan, model.data.GetODE2Coordinates(CURRENT)
            model.clock.follows = True
            model.solve_static(levels[0][0], self.all)
        model.clock.follows = False
        return _with_rates(levels, self.times, partial(rates_at, model))


def _with_rates(levels: Any, times: Any, rates: Any) -> list[Any]:
    """Return levels (n, T) of which the poses are there, with the rates of those that were found."""
    known = np.isfinite(levels[0][:, 0])
    for level, found in zip(levels[1:], rates(levels[0][known], times[known], len(levels) - 1), strict=True):
        level[known] = found
    return [level.T for level in levels]


def _keep(poses: Any, first: float, step: float, mbs: Any, t: float) -> bool:
    """Keep the pose that exudyn has come to, if it is at one of the times: it may take smaller steps."""
    k = (t - first) / step
    if abs(k - round(k)) <= UNEVEN * len(poses) and 0 <= round(k) < len(poses):
        poses[round(k)] = mbs.systemData.GetODE2Coordinates(CURRENT)
    return True


class ChainSolver:
    """A chain in exudyn, with its sparse solver, at one configuration."""

    def __init__(self, work: LoopChain) -> None:
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
