"""How near to a singular pose a motion comes between the times of a scene.

An engine steps from time to time, so what lies between is its business too: where the motion all but meets the other
branch there, no answer is no fault. The excuse is a pose of the reference with a certificate, not a guess.
"""

from __future__ import annotations

from dataclasses import replace
from itertools import pairwise

import numpy as np

from crosscheck.judge.comparison import Reference
from refkin.model import Evidence, Scene
from refkin.motion import Motion, Status
from refkin.solving.solve import solve

FIRST, LATER = 4, 8
"""Times that are put into each interval at first, and on either side of the smallest values found afterwards."""
ROUNDS = 12
"""Each narrows the intervals ninefold: twelve reach the resolution of time."""
NARROWED = 3
"""Smallest local minima that are looked into."""


def excuse(ref: Reference, first: float, enough: float) -> tuple[float, float] | None:
    """Return (time, sigma_min) of a pose as near to singular as `enough` that is met no later than a time, or None.

    Who gives no answer from `first` [s] on is excused by such a pose, at one of the times or between two: the branch
    may have been lost there. What comes later is none of its business.
    """
    times = ref.motion.t
    asked = times <= first
    near = np.flatnonzero(asked & (ref.sigma_min <= enough))
    if near.size:
        return float(times[near[0]]), float(ref.sigma_min[near[0]])
    return singular_between(replace(ref.scene, times=tuple(times[asked].tolist())), enough)


def singular_between(scene: Scene, enough: float) -> tuple[float, float] | None:
    """Return (time, sigma_min) of a certified pose as near to singular as `enough`, or None if none is found.

    Parameters
    ----------
    scene : Scene
        Solved by the reference, every time of it ok.
    enough : float
        The largest sigma_min, of the scaled phi_q, that counts.
    """
    times = sorted({*scene.times, *_within(scene.times, FIRST)})
    for _ in range(ROUNDS):
        motion = solve(replace(scene, times=tuple(times), effects=frozenset(), evidence=frozenset(Evidence)))
        proved = np.array([s is Status.OK for s in motion.status])
        sigma = np.where(proved, motion.sigma_min, np.inf)
        k = int(np.argmin(sigma))
        if sigma[k] <= enough:
            return times[k], float(sigma[k])
        more = {t for k in _minima(motion) for side in pairwise(times[max(k - 1, 0) : k + 2]) for t in _within(side)}
        if more <= set(times):
            return None
        times = sorted({*times, *more})
    return None


def _within(times: tuple[float, ...] | list[float], count: int = LATER) -> list[float]:
    """Return some times between each two."""
    return [float(t) for a, b in pairwise(times) for t in np.linspace(a, b, count + 2)[1:-1]]


def _minima(motion: Motion) -> list[int]:
    """Return where sigma_min is smaller than before and after, the smallest first."""
    sigma = np.concatenate([[np.inf], np.where(np.isfinite(motion.sigma_min), motion.sigma_min, np.inf), [np.inf]])
    lowest = np.flatnonzero((sigma[1:-1] <= sigma[:-2]) & (sigma[1:-1] <= sigma[2:]))
    return [int(k) for k in lowest[np.argsort(sigma[1:-1][lowest])][:NARROWED]]
