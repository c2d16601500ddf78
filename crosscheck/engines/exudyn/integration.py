"""exudyn's time integration, started at a closed pose with consistent velocities; and what it computes before a step.

Masses are 1 kg and 1 kg m^2 in the units of the mechanism's size.
"""

from __future__ import annotations

import itertools
from collections.abc import Iterator
from contextlib import suppress
from dataclasses import replace
from functools import partial
from typing import Any

import exudyn as exu
import numpy as np

from crosscheck.engines import Array, EngineError, route_by
from crosscheck.engines.exudyn.model import CURRENT, ExudynModel, bear_redundant_rows, quiet_settings
from crosscheck.engines.exudyn.solve import StaticNewton, rates_here
from refkin.joints import PointDistance, Unit, elements_of
from refkin.model import Scene
from refkin.motion import Motion, Status

UNEVEN = 1e-9
"""Times are taken for evenly spaced if no step differs from the first by more than this part of it."""


class Integration:
    """A scene in exudyn's time integration.

    Raises
    ------
    EngineError
        If it cannot take the scene.
    """

    def __init__(self, scene: Scene, unit: Unit, start: Any) -> None:
        _check(scene)
        self.times = scene.times
        bodies, constraints = scene.mechanism.bodies, scene.mechanism.constraints
        self.model = ExudynModel(bodies, constraints, unit, mass=1.0)
        still = ExudynModel(bodies, constraints, unit)
        t = scene.times[0]
        self.q = StaticNewton(still)(t, start)
        (self.qd,) = rates_here(still, t, 1)
        still.close()

    def solve(self, kind: Any, radius: float | None, steps: int, order: int) -> list[Any]:
        """Return all levels at the scene's times, NaN from where the integration stops."""
        model = self.model
        data, initial = model.data, exu.ConfigurationType.Initial
        levels = [np.full((model.n, len(self.times)), np.nan) for _ in range(3)]
        model.clock.follows = True
        data.SetODE2Coordinates(self.q, initial)
        data.SetODE2Coordinates_t(self.qd, initial)
        model.mbs.SetPostStepUserFunction(partial(_keep, levels, steps, itertools.count()))
        with suppress(exu.SolverError, exu.InternalError):  # the times that were not reached have no answer
            settings = _settings(self.times, steps, radius)
            if model.redundant:
                bear_redundant_rows(settings)
            model.mbs.SolveDynamic(settings, solverType=kind)
        return levels


def _check(scene: Scene) -> None:
    """Raise EngineError if exudyn's time integration cannot take a scene."""
    if any(isinstance(e, PointDistance) and e.laws for e in elements_of(scene.mechanism.constraints)):
        raise EngineError("a driven distance is set anew at each time, which a time integration does not do")
    steps = np.diff(scene.times)
    if not len(steps) or np.max(np.abs(steps - steps[0])) > UNEVEN * steps[0]:
        raise EngineError("its steps are even, the times of this scene are not")


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


INITIAL = route_by(
    "exudyn",
    "initial accelerations",
    "exudyn (by the method static)",
    linear_solve_by="velocity: adapter (numpy); acceleration: exudyn",
    drift_by="exudyn (numerical differences)",
)
FEATURES = (INITIAL,)


def with_initial_accelerations(scene: Scene, motion: Motion, unit: Unit) -> Motion:
    """Return a motion of the method `static` of all bodies with the accelerations that exudyn computes for itself.

    Its bodies have a mass of 1 and an inertia of 1 in the unit.
    """
    assert motion.qd is not None
    model = ExudynModel(scene.mechanism.bodies, scene.mechanism.constraints, unit, mass=1.0)
    model.clock.follows = True
    scale = np.tile([unit.size, unit.size, 1.0], len(motion.bodies))
    shift = np.tile([*unit.origin, 0.0], len(motion.bodies))
    qdd = np.full_like(motion.q, np.nan)
    try:
        for k in np.flatnonzero([status is Status.OK for status in motion.status]):
            q, qd = (motion.q[:, k] - shift) / scale, motion.qd[:, k] / scale
            qdd[:, k] = _initial(model, q, qd, scene.times[k]) * scale
    finally:
        model.close()
    return replace(motion, qdd=qdd, producer=replace(motion.producer, route=INITIAL))


def _initial(model: ExudynModel, q: Array, qd: Array, t: float) -> Array:
    settings = quiet_settings()
    settings.timeIntegration.startTime = t
    settings.timeIntegration.endTime = t + 1.0
    initial = exu.ConfigurationType.Initial
    model.data.SetODE2Coordinates(q, initial)
    model.data.SetODE2Coordinates_t(qd, initial)
    exu.MainSolverImplicitSecondOrder().InitializeSolver(model.mbs, settings)
    return np.array(model.data.GetODE2Coordinates_tt(CURRENT))
