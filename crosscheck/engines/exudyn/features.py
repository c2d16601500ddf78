"""exudyn's initial accelerations: what its time integration computes at a pose before the first step."""

from __future__ import annotations

from dataclasses import replace

import exudyn as exu
import numpy as np

from crosscheck.engines import Array, route_by
from crosscheck.engines.exudyn.model import CURRENT, ExudynModel, quiet_settings
from crosscheck.engines.features import produced
from refkin.joints import Unit
from refkin.model import Scene
from refkin.motion import Motion, Status

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
    return replace(motion, qdd=qdd, producer=produced(motion, INITIAL))


def _initial(model: ExudynModel, q: Array, qd: Array, t: float) -> Array:
    settings = quiet_settings()
    settings.timeIntegration.startTime = t
    settings.timeIntegration.endTime = t + 1.0
    initial = exu.ConfigurationType.Initial
    model.data.SetODE2Coordinates(q, initial)
    model.data.SetODE2Coordinates_t(qd, initial)
    exu.MainSolverImplicitSecondOrder().InitializeSolver(model.mbs, settings)
    return np.array(model.data.GetODE2Coordinates_tt(CURRENT))
