"""What kind of pose a scene starts from, or a given pose is: `proof.singularity`, by the scene's own numbers."""

from __future__ import annotations

from typing import Any

import numpy as np

from refkin.joints import initial_contacts
from refkin.model import Scene
from refkin.proof.singularity.diagnosis import Diagnosis, diagnose_scaled
from refkin.solving.starts import find_start
from refkin.system import System, compile_system


def diagnose(given: Scene | System, q: Any = None, t: float | None = None) -> Diagnosis:
    """Say what a pose is.

    Parameters
    ----------
    given : Scene or System
    q : (n,) array, optional
        The pose [m, rad], contact parameters last, or without parameters; by default the first pose of the scene.
    t : float, optional
        Its time; by default the scene's first.

    Raises
    ------
    ValueError
        If there is no pose: a system without q and t, a scene without a first pose, a q that does not close
        or has another number of coordinates.
    """
    system = compile_system(given.mechanism, unit=given.mechanism.unit())
    if isinstance(given, Scene):
        t = given.times[0] if t is None else t
        if q is None:
            start = find_start(system, given)
            if start.q is None:
                raise ValueError(f"the scene has no first pose: {start.message}")
            return diagnose_scaled(system, start.q, t)
    if q is None or t is None:
        raise ValueError("a system alone has no pose: give q and t")
    pose = np.asarray(q, float)
    if len(pose) == system.n:
        return diagnose_scaled(system, system.to_unit(pose), float(t))
    if len(pose) != system.of_bodies:
        raise ValueError(f"q: {len(pose)} numbers; expected {system.n}, or {system.of_bodies} without parameters")
    whole = system.to_unit(np.append(pose, np.zeros(system.n - len(pose))))
    return diagnose_scaled(system, initial_contacts(system, whole, float(t)), float(t))
