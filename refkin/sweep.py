"""Position over time: from one pose to the next, on one branch.

From the last poses the next is predicted by a polynomial in t, then Newton corrects it. The step is taken only if
Newton contracted at once (its second correction is a small part of the first: no other root is near) and the sign of
det phi_q is what it was; otherwise it is halved. So the branch is never changed; where no step is small enough the sweep
stops, and says whether it stopped at a singular pose.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field
from enum import Enum, auto
from typing import Any

import numpy as np

from refkin.differences import EPS
from refkin.newton import NewtonResult, RoundOff, newton
from refkin.system import System

CONTRACTION = 1 / 8
"""Largest ratio of Newton's second correction to its first: a quarter of what Newton-Kantorovich needs for a root."""
REACH = 0.25
"""Largest distance to a singular pose from which it is approached in one step [sizes, rad]."""
SINGULAR = 8 * np.sqrt(EPS)
"""Smallest singular value of the scaled phi_q at or below which a pose is not isolated by first-order terms."""
MOST_STEPS = 20_000


class Arrival(Enum):
    """How a step towards a time ended."""

    REACHED = auto()
    AT_SINGULAR_POSE = auto()
    STOPPED = auto()


@dataclass
class Sweep:
    """The poses accepted so far; times need not be those that were asked."""

    system: System
    t: list[float]
    q: list[Any]
    sign: float = field(init=False)
    steps: int = 0

    def __post_init__(self) -> None:
        self.sign = orientation(self.system, self.q[0], self.t[0])

    def to(self, target: float) -> Arrival:
        """Go on to a time, in as many steps as it takes; on REACHED and AT_SINGULAR_POSE `q[-1]` is the pose there."""
        step = target - self.t[-1]
        smallest = 4 * EPS * max(abs(target), abs(self.t[-1]), abs(step))
        while self.steps < MOST_STEPS:
            self.steps += 1
            last = step >= target - self.t[-1]
            t = target if last else self.t[-1] + step
            result = self._corrected(t)
            if self._on_branch(result, t):
                self._accept(result.q, t)
                if last:
                    return Arrival.REACHED
                step = 2 * step
                continue
            if last and self._arrives_at_singular_pose(t):
                return Arrival.AT_SINGULAR_POSE
            step = min(step, target - self.t[-1]) / 2
            if step < smallest:
                break
        return Arrival.STOPPED

    def _accept(self, q: Any, t: float) -> None:
        self.t.append(t)
        self.q.append(q)

    def _predicted(self, t: float) -> Any:
        """Extrapolate the last poses, at most four, by the polynomial through them (Neville's scheme)."""
        times, poses = self.t[-4:], list(self.q[-4:])
        for width in range(1, len(times)):
            for k in range(len(times) - width):
                a, b = times[k], times[k + width]
                poses[k] = ((t - b) * poses[k] + (a - t) * poses[k + 1]) / (a - b)
        return poses[0]

    def _corrected(self, t: float) -> NewtonResult:
        s, stop = self.system, _WhileContracting()
        return newton(lambda q: s.phi(q, t), lambda q: s.phi_q(q, t), self._predicted(t), stop=stop)

    def _on_branch(self, result: NewtonResult, t: float) -> bool:
        if not result.converged:
            return False
        sizes = np.max(np.abs(result.corrections), axis=1)
        return contracts(sizes) and orientation(self.system, result.q, t) == self.sign

    def _arrives_at_singular_pose(self, t: float) -> bool:
        """Whether Newton, started at the last pose itself, ends at a singular pose nearby; accepts it if so."""
        s, start = self.system, self.q[-1]
        result = newton(lambda q: s.phi(q, t), lambda q: s.phi_q(q, t), start, max_iterations=60)
        if not result.converged or np.max(np.abs(result.q - start)) > REACH:
            return False
        sigma = np.linalg.svd(s.phi_q(result.q, t), compute_uv=False)[s.n - 1]
        if sigma > SINGULAR:
            return False
        self._accept(result.q, t)
        return True


@dataclass
class _WhileContracting(RoundOff):
    """Goes on to round-off, but gives a step up at once that will not be taken.

    Near a singular pose what is left at round-off may shrink slowly, by any factor: that takes iterations, no smaller step.
    """

    sizes: list[float] = field(default_factory=list)

    def __call__(self, residual: Any, correction: Any, q: Any) -> bool:
        self.sizes.append(float(np.max(np.abs(correction))))
        return super().__call__(residual, correction, q) or not contracts(self.sizes)


def contracts(sizes: Sequence[float]) -> bool:
    """Return whether Newton's second correction is small against its first.

    A first correction below 1e-6 is round-off of a good prediction, or too small to leave a regular branch.
    """
    return len(sizes) < 2 or bool(sizes[1] <= CONTRACTION * sizes[0] or sizes[0] < 1e-6)


def orientation(system: System, q: Any, t: float) -> float:
    """Return the sign of det phi_q, which cannot change on a branch; 0 for systems with redundant rows."""
    if system.m != system.n:
        return 0.0
    return float(np.linalg.slogdet(system.phi_q(q, t))[0])
