"""exudyn's time integration, started at a closed pose with consistent velocities; and what it computes before a step.

Masses are 1 kg and 1 kg m^2 in the units of the mechanism's size. exudyn simulates what is added to a system and
nothing else: `EFFECTS` adds it, one by one, to see who feels it; forces are in the model's own units.
"""

from __future__ import annotations

import itertools
from collections.abc import Callable, Iterator, Sequence
from contextlib import suppress
from dataclasses import replace
from functools import partial
from typing import Any

import exudyn as exu
import numpy as np
from exudyn import itemInterface as item

from crosscheck.engines import Array, EngineRefusal, Switch, route_by
from crosscheck.engines.exudyn.model import CURRENT, ExudynModel, bear_redundant_rows, quiet_settings
from crosscheck.engines.exudyn.parts import Builder
from crosscheck.engines.exudyn.solve import StaticNewton, placed, rates_at
from refkin.joints import GROUND, PointDistance, Unit, elements_of
from refkin.model import Scene
from refkin.motion import Motion, PointMotion, Status

UNEVEN = 1e-9
"""Times are taken for evenly spaced if no step differs from the first by more than this part of it."""


class Integration:
    """A scene in exudyn's time integration; EngineRefusal if that cannot take it."""

    def __init__(self, scene: Scene, unit: Unit, start: Any) -> None:
        check_even(scene, "a time integration")
        self.times = scene.times
        bodies, constraints = scene.mechanism.bodies, scene.mechanism.constraints
        self.model = ExudynModel(bodies, constraints, unit, mass=1.0)
        still = ExudynModel(bodies, constraints, unit)
        t = scene.times[0]
        self.q = StaticNewton(still)(t, start)
        self.qd = rates_at(still, self.q[None], np.array([t]), 1)[0][0]
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


def check_even(scene: Scene, who: str) -> None:
    """Raise EngineRefusal if a scene is none for what goes through its times by itself."""
    _check_start(scene, who)
    if any(isinstance(e, PointDistance) and e.laws for e in elements_of(scene.mechanism.constraints)):
        raise EngineRefusal(f"a driven distance is set anew at each time, not within {who}")
    steps = np.diff(scene.times)
    if not len(steps) or np.max(np.abs(steps - steps[0])) > UNEVEN * steps[0]:
        raise EngineRefusal("its steps are even, the times of this scene are not")


def _check_start(scene: Scene, who: str) -> None:
    if scene.times[0] < 0.0:
        raise EngineRefusal(f"{who} of exudyn starts at no time below zero")


def _keep(levels: list[Any], steps: int, count: Iterator[int], mbs: Any, t: float) -> bool:
    """Keep the state after every `steps` steps; exudyn calls this once before the first."""
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

    Parameters
    ----------
    scene, motion, unit : Scene, Motion, Unit
    """
    _check_start(scene, "a time integration")
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
    at = placed(scene.points, motion.bodies, [motion.q, motion.qd, qdd])
    points = {p.name: PointMotion(*levels) for p, levels in zip(scene.points, at, strict=True)}
    return replace(motion, qdd=qdd, points=points, producer=replace(motion.producer, route=INITIAL))


def _initial(model: ExudynModel, q: Array, qd: Array, t: float) -> Array:
    settings = quiet_settings()
    settings.timeIntegration.startTime = t
    settings.timeIntegration.endTime = t + 1.0
    initial = exu.ConfigurationType.Initial
    model.data.SetODE2Coordinates(q, initial)
    model.data.SetODE2Coordinates_t(qd, initial)
    exu.MainSolverImplicitSecondOrder().InitializeSolver(model.mbs, settings)
    return np.array(model.data.GetODE2Coordinates_tt(CURRENT))


MASS = 7.0


def _bodies(b: Builder) -> Iterator[tuple[str, Any]]:
    return ((name, number) for name, number in b.bodies.items() if name != GROUND)


def _inertia(b: Builder) -> None:
    for _, number in _bodies(b):
        b.mbs.SetObjectParameter(number, "mass", MASS)
        b.mbs.SetObjectParameter(number, "inertia", MASS)


def _gravity(b: Builder) -> None:
    _inertia(b)
    for _, number in _bodies(b):
        weight = b.mbs.AddMarker(item.MarkerBodyMass(bodyNumber=number))
        b.mbs.AddLoad(item.LoadMassProportional(markerNumber=weight, loadVector=[0.0, -9.81, 0.0]))


def _on_angles(kind: Any, start: Sequence[float] = (), **numbers: Any) -> Callable[[Builder], None]:
    """Return what adds a force between the angle of each body and the ground, with data of its own that start so."""

    def add(b: Builder) -> None:
        for name, _ in _bodies(b):
            data = item.NodeGenericData(initialCoordinates=list(start), numberOfDataCoordinates=len(start))
            state = {"nodeNumber": b.mbs.AddNode(data)} if start else {}
            b.mbs.AddObject(kind(markerNumbers=[b.still, b.angle(name)], **state, **numbers))

    return add


def _actuation(b: Builder) -> None:
    for name, _ in _bodies(b):
        b.mbs.AddLoad(item.LoadCoordinate(markerNumber=b.angle(name), load=10.0))


def _sensors(b: Builder) -> None:
    for _, number in _bodies(b):
        what = {"outputVariableType": exu.OutputVariableType.Position, "storeInternal": True, "writeToFile": False}
        b.mbs.AddSensor(item.SensorBody(bodyNumber=number, **what))


STOPS = {"useLimitStops": True, "limitStopsLower": -1e-3, "limitStopsUpper": 1e-3, "limitStopsStiffness": 10.0}
"""They are hit from the start: exudyn finds out after a step only, and Newton alone makes none."""
EFFECTS = {
    "gravity": Switch(f"masses of {MASS:g} and 9.81 down the y axis", _gravity),
    "contact": Switch(
        "the angle of each body pressed against a stop of stiffness 1",
        _on_angles(item.ObjectContactCoordinate, [0.0], contactStiffness=1.0, offset=10.0),
    ),
    "friction": Switch(
        "a friction torque of 1 on each body",
        _on_angles(item.CoordinateSpringDamperExt, dynamicFrictionForce=1.0, frictionProportionalZone=1e-3),
    ),
    "joint limits": Switch(
        "stops of stiffness 10 at angles of 1e-3", _on_angles(item.CoordinateSpringDamperExt, [0.0, 0.0, 1.0], **STOPS)
    ),
    "passive forces": Switch(
        "stiffness 10 and damping 1 on each body's angle",
        _on_angles(item.CoordinateSpringDamper, stiffness=10.0, damping=1.0),
    ),
    "actuation": Switch("a torque of 10 on each body", _actuation),
    "sensors": Switch("a sensor of position on each body, stored", _sensors),
    "inertia": Switch(f"masses and inertias of {MASS:g}", _inertia),
}
