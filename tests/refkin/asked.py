"""Poses that proofs and solvers are asked about, and what of an answer is kept as numbers."""

from __future__ import annotations

from typing import Any

import numpy as np

from refkin import analysis
from refkin.model import Scene
from refkin.solving.starts import find_start
from refkin.solving.sweep import Sweep
from refkin.system import EVERYTHING, System, compile_system
from tests.kept import Bound

WEIGHTS = np.cos(np.arange(1e5))
MOVED = 1e-6
PARTS = (2.0**-6, 2.0**-4, 2.0**-2, 1.0)


def summed(item: Any) -> Any:
    """Return how many numbers there are, how many of them are finite, and a sum that nothing cancels."""
    numbers = np.asarray(item, float).ravel()
    known = np.isfinite(numbers)
    return [numbers.size, int(known.sum()), float(WEIGHTS[: numbers.size][known] @ numbers[known])]


def bounds(item: Any) -> list[Bound]:
    return [Bound(x) for x in np.ravel(np.asarray(item, float))]


def unsigned(vector: Any) -> Any:
    """Return a sum of a vector that is known up to its sign, and its length."""
    vector = np.asarray(vector, float)
    return abs(float(WEIGHTS[: vector.size] @ vector)), float(np.linalg.norm(vector))


def system_of(scene: Scene) -> System:
    return compile_system(scene.mechanism, EVERYTHING, scene.mechanism.unit())


def moved(q: Any, by: float = MOVED) -> Any:
    return q + by * np.cos(7.0 * np.arange(q.size)).reshape(q.shape)


def first_pose(scene: Scene) -> tuple[System, Any, float]:
    system = system_of(scene)
    start = find_start(system, scene)
    if start.q is None:
        raise ValueError(start.message)
    return system, start.q, scene.times[0]


def poses(scene: Scene, most: int = 2) -> tuple[System, Any, Any]:
    """Return the first pose and some that a sweep reaches."""
    system, q, t = first_pose(scene)
    sweep, known, places = Sweep(system, [t], [q]), [(t, q)], np.linspace(0, len(scene.times) - 1, most + 1)
    for k in sorted(set(places.round().astype(int).tolist()) - {0}):
        if sweep.to(scene.times[k]).name != "REACHED":
            break
        known.append((sweep.t[-1], sweep.q[-1]))
    return system, np.array([x for _, x in known]).T, np.array([at for at, _ in known])


def rates_of(system: System, q: Any, t: Any) -> tuple[Any, Any]:
    qd = analysis.velocity(system, q, t)
    return qd, analysis.acceleration(system, q, qd, t)


def step_of(scene: Scene) -> float:
    """Return a time in which a pose changes well: that between two of the scene's."""
    return float(scene.times[1] - scene.times[0]) if len(scene.times) > 1 else 0.125
