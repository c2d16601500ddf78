"""The first pose: from the scene's estimate, or, without one, from starts that are tried."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np

from refkin.model import Scene
from refkin.motion import Status
from refkin.newton import newton
from refkin.system import System


@dataclass(frozen=True)
class Start:
    """The first pose in the system's coordinates, or the status and the reason why there is none."""

    status: Status
    q: Any = None
    message: str = ""


def find_start(system: System, scene: Scene) -> Start:
    """Return the assembly at the first time that the scene's estimates lead to."""
    t = scene.times[0]
    estimate = system.to_unit(np.concatenate([b.estimate or (0.0, 0.0, 0.0) for b in scene.mechanism.bodies]))
    smallest = np.inf
    for damped in (False, True):
        result = newton(lambda q: system.phi(q, t), lambda q: system.phi_q(q, t), estimate, damped=damped)
        if result.converged:
            return Start(Status.OK, result.q)
        smallest = min(smallest, np.nanmin(np.max(np.abs(result.residuals), axis=1), initial=np.inf))
    message = f"no assembly was found at t = {t:g}: {result.status}; smallest scaled residual {smallest:.3g}"
    return Start(Status.NOT_CONVERGED, message=message)
