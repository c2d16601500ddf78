"""Close the loops of a joint tree over the times of a scene: full Newton, and a march that stays on its branch.

Residual, Jacobian and drift term are an engine's own (`tree_system`); Newton is the adapter's and the same for every
engine; linear systems are solved by NumPy. The march starts at the scene's estimates, predicts each pose from the
velocity before it, and takes shorter steps where Newton does not contract at once or a singular pose may lie
between, so that it does not jump to another branch in silence.

So the march takes a velocity, and with it the first derivative of each law, of a scene too that calls for positions
alone, and the least singular value that tells a regular pose; drift terms only where accelerations are called for.
The difference of a law's values would predict as well where times are close, but it does not see a law that leaves and
comes back between two times: then a pose may be reached past one that does not exist.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from crosscheck.engines.tree.joint_tree import Array
from crosscheck.engines.tree.tree_system import TreeEngine, TreeSystem
from refkin.joints import Pair
from refkin.motion import Status

EPS = float(np.finfo(float).eps)
CAP = 60
"""Corrections that Newton may take; at a fold, where the error halves, it needs about 26 to reach round-off."""
CONTRACTION = 0.25
"""A correction larger than this part of the one before says that the prediction was too far off."""
STALLED = 0.9
"""A correction larger than this part of the one before, at a residual of round-off, is noise: the error of a regular
pose shrinks faster, so does that of a fold (1/2), and of four roots in one (3/4). Noise may shrink for ever."""
TRUST = 0.25
"""The largest correction (rad, or sizes) of a predicted pose; what lies further off may be another branch."""
HALVINGS, HALVINGS_AFTER_FAILURE = 40, 6
"""How often a step may be halved on the way to the next time: down to 1e-12 of it; less after a time that failed."""
ATTEMPTS = 500
"""Steps that may be tried between two times."""
SINGULAR = 8.0 * math.sqrt(EPS)
"""The least singular value of a regular pose, lengths in sizes: rates err by EPS over its square, there by 1/64."""


@dataclass(frozen=True)
class Pose:
    """Where the tree is closed.

    Time, coordinates (n,), Jacobian (m, n), largest component of the residual, velocities (n,): NaN if not `regular`.
    """

    t: float
    q: Array
    jacobian: Array
    residual: float
    qd: Array
    regular: bool


@dataclass(frozen=True)
class March:
    """Tree coordinates and rates over the times: levels of (n, T), NaN where there is no answer; what is known of each.

    `levels` holds positions, then velocities and accelerations if called for; `residual` (T,) the largest components.
    """

    levels: tuple[Array, ...]
    status: tuple[Status, ...]
    residual: Array


def march(system: TreeSystem, times: Sequence[float], order: int) -> March:
    """Close the tree at each time, starting at the scene's estimates and going on from the last pose that closed.

    Parameters
    ----------
    system : TreeSystem
    times : sequence of float
        Strictly increasing [s].
    order : int
        0 for position, 1 for velocity too, 2 for acceleration too.

    Raises
    ------
    EngineError
        If a body of the scene has no estimate.
    """
    levels = tuple(np.full((system.tree.width, len(times)), np.nan) for _ in range(order + 1))
    status, residual = [Status.NOT_CONVERGED] * len(times), np.full(len(times), np.nan)
    start, last, halvings = system.tree.start(), None, HALVINGS
    with np.errstate(all="ignore"):  # a Newton that runs away is a status, not a warning
        for k, t in enumerate(times):
            pose = close(system, start, t) if last is None else advance(system, last, t, halvings)
            halvings = HALVINGS if pose else HALVINGS_AFTER_FAILURE
            if pose is None:
                continue
            rates = _rates(system, pose, order)
            status[k], residual[k] = Status.SINGULAR if rates is None else Status.OK, pose.residual
            last = last if rates is None else pose
            for level, values in zip(levels, (pose.q, *(rates or ())), strict=False):
                level[:, k] = values
    return March(levels, tuple(status), residual)


def advance(system: TreeSystem, last: Pose, t: float, halvings: int = HALVINGS) -> Pose | None:
    """Return the pose at t on the branch of `last`, or None: by steps in time, halved until Newton contracts."""
    step = t - last.t
    smallest = math.ldexp(step, -halvings)
    for _ in range(ATTEMPTS):
        target = min(t, last.t + step)
        pose = close(system, last.q + (target - last.t) * last.qd, target, near=True)
        connected = pose is not None and _connected(last, pose)
        if connected and target == t:
            return pose
        if pose is None or not (connected and pose.regular):
            step = 0.5 * (target - last.t)
            if step < smallest:
                return _fold(system, last, t) if halvings == HALVINGS else None
        else:
            last, step = pose, 2.0 * step
    return None


def _connected(last: Pose, pose: Pose) -> bool:
    """Return whether every matrix on the straight line from one Jacobian to the other is regular.

    Another branch lies beyond a singular pose, where an eigenvalue of J changes its sign. Where branches nearly meet,
    Newton contracts towards either, and only this tells them apart: (1 - s) J + s J' = J ((1 - s) I + s J^-1 J') is
    regular for all s in [0, 1] if no eigenvalue of J^-1 J' lies in the left half plane.
    """
    change = solve(last.jacobian, pose.jacobian)
    return change is not None and bool((np.linalg.eigvals(change).real > 0.0).all())


def _fold(system: TreeSystem, last: Pose, t: float) -> Pose | None:
    """Return the pose at t if the branch of `last` ends there, in a singular pose, where Newton contracts by halves."""
    pose = close(system, last.q, t)
    return None if pose is None or pose.regular or _largest(pose.q - last.q) > TRUST else pose


def close(system: TreeSystem, q: Array, t: float, *, near: bool = False) -> Pose | None:
    """Return the pose to which full Newton converges from q, or None if it does not.

    Converged means that the residual is at round-off and the correction has stalled. `near` says that q is a
    prediction: then each correction must contract and the first not be large.
    """
    previous = math.inf
    guess = q
    for _ in range(CAP):
        residual, jacobian = system.position(q, t)
        correction = solve(jacobian, residual)
        if correction is None or _largest(correction) > 1.0 / EPS:  # an angle that large has no digit left
            return None
        size, gap = _largest(correction), _largest(residual)
        if gap <= round_off(q, system.tree.depth):
            if size > STALLED * previous or size <= EPS * (1.0 + _largest(q)):
                far = near and _largest(q - guess) > TRUST
                return None if far else _pose(system, t, q, jacobian, gap)
        elif near and (size > CONTRACTION * previous or size > TRUST):
            return None
        q, previous = q - correction, size
    return None


def round_off(q: Array, depth: int) -> float:
    """Return a bound on what rounding leaves of a residual that is zero.

    A row compares two points, each at the end of at most `depth` links. In units of the size a link is no longer than
    3/2 and a slide no longer than |q|, so a point lies within 3/2 depth (1 + |q|). Every link costs it at most 4 EPS of
    that (cosine and sine, a product of rotations, a sum), the rounding of the angles themselves another EPS |q|:
    together less than 8 (1 + depth)^2 EPS (1 + |q|) for a point, and twice that for two.
    """
    return 16.0 * (1 + depth) ** 2 * EPS * (1.0 + _largest(q))


def solve(matrix: Array, right: Array) -> Array | None:
    """Return x with matrix x = right, by least squares if rows are redundant; None if there is no finite one."""
    rows, columns = matrix.shape
    if columns == 0:
        return np.zeros_like(right[:0])
    try:
        x = np.linalg.solve(matrix, right) if rows == columns else np.linalg.lstsq(matrix, right, rcond=None)[0]
    except np.linalg.LinAlgError:
        return None
    return np.asarray(x, float) if np.isfinite(x).all() else None


def _pose(system: TreeSystem, t: float, q: Array, jacobian: Array, gap: float) -> Pose:
    """Return the pose with its velocities, unless it is singular."""
    qd = solve(jacobian, system.nu(t)) if _regular(jacobian) else None
    return Pose(t, q, jacobian, gap, np.full(q.shape, np.nan) if qd is None else qd, qd is not None)


def _regular(jacobian: Array) -> bool:
    """Return whether the columns are independent by more than `SINGULAR`."""
    return not jacobian.shape[1] or bool(np.linalg.svd(jacobian, compute_uv=False)[-1] >= SINGULAR)


def _rates(system: TreeSystem, pose: Pose, order: int) -> tuple[Array, ...] | None:
    """Return velocity and acceleration as far as they are called for, or None if the pose has none."""
    if not pose.regular or order < 2:
        return (pose.qd,)[:order] if pose.regular else None
    qdd = solve(pose.jacobian, system.gamma(pose.q, pose.qd, pose.t))
    return None if qdd is None else (pose.qd, qdd)


def _largest(values: Array) -> float:
    return float(np.abs(values).max(initial=0.0))


def body_levels(engine: TreeEngine, march: March, bodies: Sequence[str]) -> list[Array]:
    """Return per level (x [m], y [m], phi [rad]) of the bodies in the ground frame, or its derivative, (3 n, T).

    phi is the sum of the joint angles, with its turns; x and y are the engine's own.
    """
    found = [np.empty((3 * len(bodies), march.levels[0].shape[1])) for _ in march.levels]
    for k, body in enumerate(bodies):
        origins = point_levels(engine, march, body, (0.0, 0.0))
        for order, (rows, origin, q) in enumerate(zip(found, origins, march.levels, strict=True)):
            phi = engine.tree.angle(body, q) if order == 0 else engine.tree.angle_rows[body] @ q
            rows[3 * k : 3 * k + 3] = *origin, phi
    return found


def point_levels(engine: TreeEngine, march: March, body: str, u: Pair) -> list[Array]:
    """Return per level position [m] of a point of a body (u [m] in its frame), or its derivative, (2, T)."""
    tree, scaled = engine.tree, engine.tree.scaled(body, u)
    found = [np.full((2, march.levels[0].shape[1]), np.nan) for _ in march.levels]
    for k, q in enumerate(march.levels[0].T):
        if not np.isfinite(q).all():
            continue
        r, jacobian = engine.point(q, body, scaled)
        found[0][:, k] = r * tree.size + tree.origin
        rates = [level[:, k] for level in march.levels[1:]]
        for order, rate in enumerate(rates, start=1):
            drift = engine.point_drift(q, rates[0], body, scaled) if order == 2 else 0.0
            found[order][:, k] = (jacobian @ rate + drift) * tree.size
    return found
