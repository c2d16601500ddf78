"""exudyn by every route: its static solver with tolerances swept, its Newton called directly, its time integration.

The static routes start each pose at the last one, as exudyn does by itself; velocity and acceleration are solved from
exudyn's rows by NumPy, time by time, as it has no such analysis. The integrated routes start at a closed pose with
consistent velocities; their masses are 1 kg and 1 kg m^2 in the units of the mechanism's size.
"""

from __future__ import annotations

import itertools
from collections.abc import Iterator
from contextlib import suppress
from functools import partial
from typing import Any

import exudyn as exu
import numpy as np

from crosscheck.engines import EngineError, Level, refusals
from crosscheck.engines.exudyn.engine import Exudyn
from crosscheck.engines.exudyn.model import CURRENT, ExudynModel, quiet_settings
from crosscheck.engines.exudyn.solve import ShippedSolve, StaticNewton, bear_redundant_rows, solved
from crosscheck.engines.price_route import NOBODY, PricedRoute, Refused
from refkin.joints import SI, PointDistance, Unit, elements_of
from refkin.model import Scene

TOLERANCES = (1e-1, 1e-2, 1e-4, 1e-6, 1e-8, 1e-10, 1e-12, 1e-14)
"""Norms of the residual at which the static solver stops, in sizes of the mechanism."""
STEPS = (1, 3, 10, 30)
"""Steps of the time integration from one time of the scene to the next."""
UNEVEN = 1e-9
"""Times are taken for evenly spaced if no step differs from the first by more than this part of it."""
SCALED = "lengths in sizes of the mechanism"


def routes(scene: Scene) -> Iterator[PricedRoute | Refused]:
    """Yield the routes of exudyn.

    Raises
    ------
    EngineError
        If exudyn cannot express the scene.
    """
    reasons = refusals(Exudyn(), scene, Level.SOLVE)
    reasons += [f"no estimate to start from: {b.name}" for b in scene.mechanism.bodies if b.estimate is None]
    if reasons:
        raise EngineError("; ".join(reasons))
    yield from _static_routes(scene)
    yield from _dynamic_routes(scene)


class Static:
    """A scene in exudyn's static solver, in a unit of length."""

    def __init__(self, scene: Scene, unit: Unit) -> None:
        self.scene, self.unit = scene, unit
        self.model = ExudynModel(scene.mechanism.bodies, scene.mechanism.constraints, unit)
        self.start = _estimate(scene, unit)

    def solve(self, step: Any, order: int) -> list[Any]:
        """Return the levels up to an order by `step`, (t, start) -> pose."""
        times, q = self.scene.times, self.start
        levels = [np.full((len(q), len(times)), np.nan) for _ in range(order + 1)]
        for k, t in enumerate(times):
            try:
                q = step(t, q)
            except EngineError:
                continue
            levels[0][:, k] = q
            if order:
                self._rates(levels, k, q, t, order)
        return levels

    def _rates(self, levels: list[Any], k: int, q: Any, t: float, order: int) -> None:
        model, live = self.model, self.model.live
        jacobian = model.jacobian(q, t)[live]
        qd = solved(jacobian, -model.constraint_velocity(q, np.zeros_like(q), t)[live])
        levels[1][:, k] = qd
        if order > 1:
            levels[2][:, k] = solved(jacobian, model.drift(q, qd, t)[live])

    def read(self, levels: list[Any]) -> list[Any]:
        """Return levels in metres."""
        return _in_metres(levels, self.unit)


def _static_routes(scene: Scene) -> Iterator[PricedRoute]:
    size = scene.mechanism.size()
    shipped = Static(scene, SI)
    yield _route("SolveStatic, as shipped", "default tolerances", shipped, ShippedSolve(shipped.model, size))
    for tolerance in TOLERANCES:
        at = Static(scene, scene.mechanism.unit())
        step = ShippedSolve(at.model, 1.0)
        step.settings.staticSolver.newton.absoluteTolerance = tolerance
        step.settings.staticSolver.newton.relativeTolerance = 0.0
        bear_redundant_rows(step.settings, at.model)
        yield _route("SolveStatic", f"absoluteTolerance {tolerance:g}", at, step, SCALED)
    for tolerance in TOLERANCES:
        at = Static(scene, scene.mechanism.unit())
        call = partial(StaticNewton(at.model).once, tolerance=tolerance)
        yield _route("MainSolverStatic.Newton", f"absoluteTolerance {tolerance:g}", at, call, SCALED)


def _route(name: str, knob: str, at: Static, step: Any, note: str = "") -> PricedRoute:
    return PricedRoute(
        engine="exudyn",
        name=name,
        knob=knob,
        newton_by="exudyn",
        solve=partial(at.solve, step),
        read=at.read,
        note="; ".join(filter(None, (note, "rates: linear solves by the adapter"))),
    )


def _dynamic_routes(scene: Scene) -> Iterator[PricedRoute | Refused]:
    kinds = exu.DynamicSolverType
    solvers = {
        "SolveDynamic, trapezoidal, index 2": (kinds.TrapezoidalIndex2, None),
        "SolveDynamic, generalized-alpha, index 3": (kinds.GeneralizedAlpha, 0.5),
    }
    reason = _no_integration(scene)
    for name, (kind, radius) in solvers.items():
        if reason:
            yield Refused(engine="exudyn", name=name, reason=reason)
            continue
        integration = Integration(scene)
        for steps in STEPS:
            h = (scene.times[1] - scene.times[0]) / steps
            yield PricedRoute(
                engine="exudyn",
                name=name,
                knob=f"h = {h:.3g} s",
                newton_by="exudyn (in each step)",
                solve=partial(integration.solve, kind, radius, steps),
                read=integration.read,
                at_once=True,
                note=NOBODY.split(": ")[1] + "; spectral radius 0.5" * (radius is not None),
            )


def _no_integration(scene: Scene) -> str:
    """Return why exudyn's time integration cannot take a scene."""
    if any(isinstance(e, PointDistance) and e.laws for e in elements_of(scene.mechanism.constraints)):
        return "a driven distance is set anew at each time, which a time integration does not do"
    steps = np.diff(scene.times)
    if not len(steps) or np.max(np.abs(steps - steps[0])) > UNEVEN * steps[0]:
        return "its steps are even, the times of this scene are not"
    return ""


class Integration:
    """A scene in exudyn's time integration, from a closed pose with consistent velocities."""

    def __init__(self, scene: Scene) -> None:
        self.scene, self.unit = scene, scene.mechanism.unit()
        constraints = scene.mechanism.constraints
        self.model = ExudynModel(scene.mechanism.bodies, constraints, self.unit, mass=1.0)
        still = Static(scene, self.unit)
        first = StaticNewton(still.model)(scene.times[0], still.start)
        live, t = still.model.live, scene.times[0]
        jacobian = still.model.jacobian(first, t)[live]
        self.q = first
        self.qd = solved(jacobian, -still.model.constraint_velocity(first, np.zeros_like(first), t)[live])
        still.model.close()

    def solve(self, kind: Any, radius: float | None, steps: int, order: int) -> list[Any]:
        """Return all levels at the scene's times, NaN from where the integration stops."""
        times, model = self.scene.times, self.model
        data, initial = model.data, exu.ConfigurationType.Initial
        levels = [np.full((model.n, len(times)), np.nan) for _ in range(3)]
        model.clock.follows = True
        data.SetODE2Coordinates(self.q, initial)
        data.SetODE2Coordinates_t(self.qd, initial)
        model.mbs.SetPostStepUserFunction(partial(_keep, levels, steps, itertools.count()))
        with suppress(exu.SolverError, exu.InternalError):  # the times that were not reached have no answer
            settings = _settings(times, steps, radius)
            bear_redundant_rows(settings, model)
            model.mbs.SolveDynamic(settings, solverType=kind)
        return levels

    def read(self, levels: list[Any]) -> list[Any]:
        """Return levels in metres."""
        return _in_metres(levels, self.unit)


def _keep(levels: list[Any], steps: int, count: Iterator[int], mbs: Any, t: float) -> bool:
    """Keep the state after every so manieth step; exudyn calls this once before the first."""
    k, rest = divmod(next(count), steps)
    if not rest and k < levels[0].shape[1]:
        data = mbs.systemData
        levels[0][:, k] = data.GetODE2Coordinates(CURRENT)
        levels[1][:, k] = data.GetODE2Coordinates_t(CURRENT)
        levels[2][:, k] = data.GetODE2Coordinates_tt(CURRENT)
    return True


def _settings(times: Any, steps: int, radius: float | None) -> Any:
    settings = quiet_settings()
    integration = settings.timeIntegration
    integration.startTime, integration.endTime = times[0], times[-1]
    integration.numberOfSteps = steps * (len(times) - 1)
    integration.adaptiveStep = False
    if radius is not None:
        integration.generalizedAlpha.spectralRadius = radius
    return settings


def _estimate(scene: Scene, unit: Unit) -> Any:
    start = np.array([body.estimate for body in scene.mechanism.bodies], float)
    start[:, :2] = (start[:, :2] - unit.origin) / unit.size
    return start.ravel()


def _in_metres(levels: list[Any], unit: Unit) -> list[Any]:
    bodies = len(levels[0]) // 3
    scale, shift = np.tile([unit.size, unit.size, 1.0], bodies), np.tile([*unit.origin, 0.0], bodies)
    return [level * scale[:, None] + (shift[:, None] if k == 0 else 0.0) for k, level in enumerate(levels)]
