"""Loops over time: from one pose to the next, on one branch, with rates by the differentiated loop equations.

Each pose is predicted from position, velocity and acceleration of the last, and corrected by Newton; so rates are taken
of every pose, whether a scene calls for them or not. A step is taken if Newton contracted at once and no singular
Jacobian can lie on the way (`connected`); else it is halved. So a whole cycle stays in the assembly in which it
started, and ends where that assembly ends.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from crosscheck.engines.vector_loop.solving import close
from crosscheck.engines.vector_loop.system import EPS, LoopSystem
from refkin.motion import Status
from refkin.newton import NewtonResult

CONTRACTION = 0.25
"""Largest ratio of Newton's second correction to the first; larger says that the prediction was too far off."""
TRUST = 0.25
"""The largest first correction (rad, or scales) of a predicted pose; what lies further off may be another branch."""
ATTEMPTS, HALVINGS = 500, 40
"""Steps that may be tried between two times, and how often one may be halved: down to 1e-12 of the way."""
SINGULAR = 8.0 * math.sqrt(EPS)
"""The least singular value of a regular pose, weighted: rates err by EPS over its square, there by 1/64."""


@dataclass(frozen=True)
class Pose:
    """Where the loops are closed; rates are NaN if it is not `regular`, and `jacobian` is weighted."""

    t: float
    q: Any
    qd: Any
    qdd: Any
    jacobian: Any
    residual: float
    regular: bool


@dataclass(frozen=True)
class March:
    """Unknowns and rates over the times.

    Attributes
    ----------
    t : (T,) array
    q, qd, qdd : (n, T) array
        NaN where there is no answer; rates also where the pose is singular.
    status : tuple of Status
        OK, SINGULAR, or NOT_CONVERGED: not reached, which proves nothing.
    residual : (T,) array
        Largest closure error, in units of the system's scale.
    """

    t: Any
    q: Any
    qd: Any
    qdd: Any
    status: tuple[Status, ...]
    residual: Any

    @property
    def reached(self) -> int:
        """The number of times before the first that was not reached."""
        lost = [s is Status.NOT_CONVERGED for s in self.status]
        return lost.index(True) if any(lost) else len(lost)


Distance = Callable[[Any], float]
"""How far unknowns lie from an estimate."""


def march(system: LoopSystem, times: Sequence[float], q0: Any, distance: Distance | None = None) -> March:
    """Close the loops at each time: at the first from the estimate q0, then from pose to pose.

    `distance` says which of several assemblies is meant, where the estimate is far from all: by default the one whose
    unknowns are nearest to q0.
    """
    n, count = system.n, len(times)
    q, qd, qdd = (np.full((n, count), np.nan) for _ in range(3))
    status, residual = [Status.NOT_CONVERGED] * count, np.full(count, np.nan)
    with np.errstate(all="ignore"):  # a Newton that runs away is a status, not a warning
        pose = start(system, q0, float(times[0]), distance)
        for k, t in enumerate(map(float, times)):
            if k and pose is not None:
                pose = advance(system, pose, t) if pose.regular else None
            if pose is None:
                break
            q[:, k], qd[:, k], qdd[:, k] = pose.q, pose.qd, pose.qdd
            status[k], residual[k] = (Status.OK if pose.regular else Status.SINGULAR), pose.residual
    return March(np.asarray(times, float), q, qd, qdd, tuple(status), residual)


def start(system: LoopSystem, q0: Any, t: float, distance: Distance | None = None) -> Pose | None:
    """Return the pose at t that an estimate leads to: that of Newton, if it contracts at once.

    From any other estimate Newton may go anywhere: then damped Newton is run also from estimates in which one angle is
    turned, and the nearest of the ends is taken, without the whole turns made on the way.
    """
    if not system.n:
        return _pose(system, np.zeros(0), t)
    near = close(system, q0, t)
    if near.converged and _contracts(system, near):
        return _pose(system, near.q, t)
    ends = [near, *(close(system, guess, t, damped=True) for guess in _guesses(system, q0))]
    closed = [close(system, _unwound(system, end.q, q0), t) for end in ends if end.converged]
    poses = [pose for end in closed for pose in [_pose(system, end.q, t)] if pose is not None]
    far = distance or (lambda q: float(np.linalg.norm((q - q0) * system.weights)))
    return min(poses, key=lambda pose: far(pose.q), default=None)


def advance(system: LoopSystem, last: Pose, t: float) -> Pose | None:
    """Return the pose at t on the branch of `last`; None if the branch does not lead there."""
    step = t - last.t
    smallest = math.ldexp(step, -HALVINGS)
    for _ in range(ATTEMPTS):
        target = min(t, last.t + step)
        pose = _corrected(system, last, target)
        on_branch = pose is not None and connected(last.jacobian, pose.jacobian)
        if pose is not None and on_branch and target == t:
            return pose
        if pose is not None and on_branch and pose.regular:
            last, step = pose, 2.0 * step
            continue
        step = 0.5 * (target - last.t)
        if step < smallest:
            return _end_of_branch(system, last, t)
    return None


def connected(jacobian: Any, other: Any) -> bool:
    """Return whether every matrix on the straight line between two Jacobians is regular.

    (1 - s) J + s J' = J ((1 - s) I + s J^-1 J') is, for all s in [0, 1], if no eigenvalue of J^-1 J' lies in the left
    half plane. Another branch lies beyond a singular pose, so it is not connected, however near it comes.
    """
    if not jacobian.size:
        return True
    try:
        change = np.linalg.solve(jacobian, other)
    except np.linalg.LinAlgError:
        return False
    return bool(np.isfinite(change).all() and (np.linalg.eigvals(change).real > 0.0).all())


def _corrected(system: LoopSystem, last: Pose, t: float) -> Pose | None:
    """Return the pose near the prediction for t, if Newton contracts at once."""
    if not system.n:
        return _pose(system, last.q, t)
    h = t - last.t
    result = close(system, last.q + h * (last.qd + 0.5 * h * last.qdd), t)
    if not result.converged:
        return None
    return _pose(system, result.q, t) if _contracts(system, result) else None


def _contracts(system: LoopSystem, result: NewtonResult) -> bool:
    """Return whether the first correction was not large and the second a small part of it.

    A first correction below 1e-6 is round-off of a good prediction.
    """
    sizes = np.max(np.abs(result.corrections * system.weights), axis=1, initial=0.0)
    first, second = (*sizes, 0.0, 0.0)[:2]
    return bool(first <= TRUST and (second <= CONTRACTION * first or first <= 1e-6))


def _guesses(system: LoopSystem, q0: Any) -> Iterator[Any]:
    yield q0
    for k in np.flatnonzero(system.is_angle):
        for quarters in (1, 2, 3):
            yield q0 + 0.5 * math.pi * quarters * np.eye(system.n)[k]


def _unwound(system: LoopSystem, q: Any, near: Any) -> Any:
    """Return q with whole turns taken off the angles, as far as no relation counts them."""
    counted = {v.unknown for relation in system.relations for _, v in relation.terms}
    free = system.is_angle & np.array([name not in counted for name in system.unknowns], bool)
    return q - np.where(free, math.tau * np.round((q - near) / math.tau), 0.0)


def _pose(system: LoopSystem, q: Any, t: float) -> Pose | None:
    """Return the pose at q, if the loops are closed there."""
    residual = system.residual(q, t)
    if not (np.abs(residual) <= system.rounding(q, t)).all():
        return None
    slope = system.jacobian(q, t)
    jacobian = slope / system.weights / system.scale
    gap = float(np.max(np.abs(residual), initial=0.0)) / system.scale
    if q.size and np.linalg.svd(jacobian, compute_uv=False)[-1] < SINGULAR:
        nothing = np.full(q.shape, np.nan)
        return Pose(t, q, nothing, nothing, jacobian, gap, False)
    qd = np.linalg.solve(slope, system.nu(q, t))
    return Pose(t, q, qd, np.linalg.solve(slope, system.gamma(q, qd, t)), jacobian, gap, True)


def _end_of_branch(system: LoopSystem, last: Pose, t: float) -> Pose | None:
    """Return the singular pose at t if the branch of `last` ends right there, where Newton contracts by halves."""
    pose = start(system, last.q, t)
    if pose is None or pose.regular or np.max(np.abs((pose.q - last.q) * system.weights)) > TRUST:
        return None
    return pose
