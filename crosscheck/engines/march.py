"""Numerical continuation over the times of a scene: full Newton at all times at once, on one branch.

The first pose is Newton's from an estimate. From there rough poses at a few times, cubics (Hermite) between them and
Newton at every time give poses of which none is believed yet. A step from one to the next is taken if Newton contracts
at once from the tangent of the first and no singular Jacobian can lie between the two; steps that fail are halved, all
at once. What is left is done one step after another, halved further until Newton contracts. So no pose is ever taken
that the tangent of the pose before it does not lead to, or the cubic through the two before it (towards an end, and for
an engine's own Newton), and a motion ends where its assembly ends.

A velocity, and with it the first derivative of each law, is taken of a scene too that calls for positions alone: the
difference of a law's values would predict as well where times are close, but does not see a law that leaves and comes
back between two times. For the same reason the times at which a law turns back are poses of their own.

Nothing here knows an engine: poses are those of `Equations` (`poses`).
"""

from __future__ import annotations

import math
from collections.abc import Callable, Generator, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from crosscheck.engines import Array
from crosscheck.engines.poses import (
    CAP,
    CONTRACTION,
    EPS,
    TRUST,
    Equations,
    Poses,
    close,
    extrema,
    largest,
    norm,
    nowhere,
    solve,
    within,
)
from refkin.motion import SINGULAR, Status

HALVINGS, HALVINGS_AFTER_FAILURE = 40, 6
"""How often a step may be halved on the way to the next time: down to 1e-12 of it; less after a time that failed."""
DIVISIONS, MOST_DIVIDED, PARTS, CLOSER = 4, 4, 32, 0.55
"""How often steps may be divided, how many together, into how many parts at most, each how much of the last."""
ATTEMPTS = 3000
"""Steps that may be tried between two times: beside a gimbal pose exudyn's Newton contracts in a thousandth of one."""
STRIDE, ROUGH, MOST_ROUGH = 12, 6e-2, 6
"""One in so many times has a rough pose; its last correction [rad, sizes], and how many it may take."""
FEW = 4
"""So many times are worth finding all at once; fewer are found sooner one after another."""
DEFECT, NEAR = 0.1, 1e-3
"""The part of a step, and the length [rad, sizes], by which it may miss what its two velocities say (trapezoid)."""
LEFT_OVER = 1.0 / 64.0
"""The part of what is left of a branch to its end that a step towards it leaves."""
CERTAIN = 1.0 / 16.0
"""The part of a step times what the Jacobian changes by on it, up to which a tangent may be off without being asked."""
GUESSED_WELL = 1e-9
"""A prediction that Newton's first correction brings this near its pose has contracted, whatever round-off adds."""


Closing = Callable[[Array, float], tuple[Array | None, float]]
"""A pose (n,) and a time -> the pose that an engine leads it to, None if it leads nowhere, and its largest residual."""


@dataclass(frozen=True)
class MarchResult:
    """Coordinates and rates over the times: levels of (n, T), NaN where there is no answer; what is known of each.

    `levels` holds positions, then velocities and accelerations if called for; `residual` (T,) the largest components.
    """

    levels: tuple[Array, ...]
    status: tuple[Status, ...]
    residual: Array


def one_by_one(closing: Closing, start: Array, times: Sequence[float]) -> MarchResult:
    """Return the poses to which an engine leads each time from its last answer, as a user would do it.

    Parameters
    ----------
    closing, start, times : Closing, (n,) array, sequence of float
        The engine's own way to a pose, the estimate, and times [s].
    """
    levels, residual = np.full((len(start), len(times)), np.nan), np.full(len(times), np.nan)
    status, q = [Status.NOT_CONVERGED] * len(times), start
    for k, t in enumerate(times):
        pose, gap = closing(q, t)
        if pose is not None:
            q, status[k], residual[k] = pose, Status.OK, gap
            levels[:, k] = q
    return MarchResult((levels,), tuple(status), residual)


def march(
    equations: Equations,
    start: Array | Callable[[float], Poses],
    times: Sequence[float],
    order: int,
    *,
    together: bool = True,
    resumes: bool = False,
) -> MarchResult:
    """Return the motion at each time, starting at an estimate and going on from the last pose that closed.

    Parameters
    ----------
    equations : Equations
    start : (n,) array, or callable
        Coordinates from which Newton finds the first pose, or what finds it at a time.
    times : sequence of float
        Strictly increasing [s].
    order : int
        0 for position, 1 for velocity too, 2 for acceleration too.
    together : bool
        Whether poses may be found all at once; not of coordinates whose value depends on the way to a pose.
    resumes : bool
        Whether a motion that ended goes on at a later time whose pose is near the last one again.
    """
    t, k, path, halvings, tried = np.asarray(times, float), 0, list[Poses](), HALVINGS, 1
    turns = extrema(equations.laws, t)
    last: Poses | None = None
    ahead: Poses | None = None
    with np.errstate(all="ignore"):  # a Newton that runs away is a status, not a warning
        while k < len(t):
            if last is None:
                pose = start(t[k]) if callable(start) else close(equations, start[None], t[k : k + 1])
                if pose.known[0] and not pose.regular[0]:  # nothing says which branch goes on from there
                    path += [pose, *(nowhere(pose, later) for later in t[k + 1 :].tolist())]
                    break
            else:
                if together and ahead is None and halvings == HALVINGS and len(t) - k >= FEW:
                    (ahead, kept), origin = _all_at_once(equations, last, t[k:], turns), k
                if ahead is not None:
                    count = int(np.argmin(np.append(kept[k - origin :], False)))
                    path.append(ahead[k - origin : k - origin + count])
                    last, k = path[-1][-1:] if count else last, k + count
                if k == len(t):
                    break
                # an engine's own Newton goes from pose to pose, and only it resumes: none of its times is passed over
                tried = 1 if halvings == HALVINGS or hasattr(equations, "closed") else 2 * tried
                poses = _advance(equations, last, t[k : k + tried], turns, halvings)
                lost = int(np.argmax(np.append(poses.known[:-1], True)))
                path.append(poses[:lost])
                pose, k = poses[lost : lost + 1], k + lost
                if resumes and halvings != HALVINGS and not pose.known[0]:
                    pose = _near_again(equations, last, t[k])
            path.append(pose)
            halvings = HALVINGS if pose.known[0] else HALVINGS_AFTER_FAILURE
            last = pose if pose.regular[0] else last
            if ahead is not None and not _same(ahead[k - origin : k - origin + 1], pose):
                ahead = None
            k += 1
        return march_of(equations, t, path, order)


def _same(guessed: Poses, pose: Poses) -> bool:
    """Return whether a pose that was not believed is the one that was found step by step."""
    return bool(len(guessed.t) and largest(guessed.q - pose.q)[0] <= GUESSED_WELL)


def march_of(equations: Equations, t: Array, path: Sequence[Poses], order: int) -> MarchResult:
    """Return poses at all times with their rates up to an order.

    Parameters
    ----------
    equations, t, path, order : Equations, (T,) array, sequence of Poses, int
        The poses are at these times [s], in their order; `order` is as for `march`.
    """
    poses = Poses.joined(path)
    levels = [poses.q, poses.qd, np.full_like(poses.q, np.nan)][: order + 1]
    ok = poses.regular
    if order == 2 and ok.any():
        right = equations.gamma(poses.q[ok], poses.qd[ok], t[ok])
        levels[2][ok] = solve(poses.jacobian[ok], right)
        ok = ok & np.isfinite(levels[2]).all(axis=1)
        levels[1] = np.where(ok[:, None], levels[1], np.nan)
    known = (Status.NOT_CONVERGED, Status.SINGULAR, Status.OK)
    status = tuple(known[at] for at in (poses.known.astype(int) + ok).tolist())
    return MarchResult(tuple(np.ascontiguousarray(level.T) for level in levels), status, poses.residual)


# all at once


def _all_at_once(equations: Equations, last: Poses, times: Array, turns: Array) -> tuple[Poses, Any]:
    """Return poses at the times, as far as they were reached, and whether each follows from the one before it.

    The first one is held against `last`; `turns` are when laws turn back.
    """
    t = np.union1d(times, turns[(turns > last.t) & (turns < times[-1])])
    if hasattr(equations, "along"):  # an engine's own Newton goes from pose to pose
        poses = equations.along(last, t)
    else:
        knots = _rough(equations, last, t)
        t = t[t <= knots[0][-1]]
        poses = close(equations, _cubics(*knots, t), t) if len(t) else last[:0]
    t = poses.t
    if not len(t):
        return last[:0], np.zeros(0, bool)
    poses, kept = _with_steps(equations, last, np.zeros(1, bool), poses)
    for _ in range(DIVISIONS):
        bad = np.flatnonzero(~kept[:-1])
        if bad.size:
            here = _passable(poses[bad], poses[bad + 1]) & (_sides(poses.jacobian[bad + 1]) == _sides(last.jacobian))
            bad = bad[here][:MOST_DIVIDED]
        if not bad.size:
            break
        guess, between = _divided(poses[bad], poses[bad + 1])
        if not len(between):
            break
        more = close(equations, guess, between)
        poses, kept = _with_steps(equations, poses, kept, more)
    at = np.searchsorted(poses.t, times[times <= t[-1]])
    failed = np.append(0, np.cumsum(~kept))
    return poses[at], np.diff(failed[at], prepend=0) == 0


def _with_steps(equations: Equations, poses: Poses, kept: Any, more: Poses) -> tuple[Poses, Any]:
    """Return poses and more in the order of their times, and which steps, from each to the next, are to be believed."""
    order = np.argsort(np.append(poses.t, more.t), kind="stable")
    new = np.append(np.zeros(len(poses.t), bool), np.ones(len(more.t), bool))[order]
    kept = np.append(kept, np.zeros(len(more.t), bool))[order]
    poses = Poses.joined((poses, more))[order]
    steps = np.flatnonzero(new[:-1] | new[1:])
    kept[steps] = _believed(equations, poses[steps], poses[steps + 1])
    kept[-1] = False
    return poses, kept


def _rough(equations: Equations, last: Poses, t: Array) -> tuple[Array, Array, Array]:
    """Return times (K,), coordinates and velocities (K, n) of rough poses from `last` on, as far as Newton goes."""
    at, q, qd, jacobians = [float(last.t[0])], [last.q], [last.qd], [last.jacobian]
    k, stride = -1, STRIDE // 2
    while k < len(t) - 1 and stride:
        target = min(k + stride, len(t) - 1)
        now = t[target : target + 1]
        predicted = guess = hermite(at[-2:], q[-2:], qd[-2:], float(now[0]))
        both = np.empty((1, last.jacobian.shape[1], 2))
        both[:, :, 1] = equations.nu(guess, now)
        for _ in range(MOST_ROUGH if stride > 1 else CAP):  # the next time may be at a fold
            both[:, :, 0], jacobian = equations.rows(guess, now)
            correction, rate = solve(jacobian, both).transpose(2, 0, 1)
            guess, size = guess - correction, float(largest(correction)[0])
            if not ROUGH < size <= 1.0:
                break
        off = float(largest(guess - predicted)[0])
        if (stride == 1 or off <= TRUST) and size <= ROUGH and math.isfinite(rate.sum()):
            k = target
            at.append(float(t[k]))
            q.append(guess)
            qd.append(rate)
            jacobians.append(jacobian)
            if off <= TRUST / 16.0:  # what is left of a cubic goes with the fourth power of the step
                stride = min(2 * stride, STRIDE)
        else:
            stride //= 2
    sides = _sides(np.concatenate(jacobians))
    end = 1 + int(np.argmax(np.append(sides != sides[0], True)))  # what follows the first on another branch is lost
    return np.array(at[:end]), np.concatenate(q[:end]), np.concatenate(qd[:end])


def _sides(jacobian: Array) -> Array:
    """Return the signs (B,) of determinants, which are the same all along a branch; 1 if rows are redundant."""
    _, m, n = jacobian.shape
    sides: Array = np.linalg.slogdet(jacobian)[0] if m == n else np.ones(len(jacobian))
    return sides


def _cubics(knots: Array, q: Array, qd: Array, t: Array) -> Array:
    """Return coordinates (B, n) at t by the cubics through knots (K,), with coordinates and velocities (K, n) there."""
    k = np.clip(np.searchsorted(knots, t) - 1, 0, len(knots) - 2)
    return hermite((knots[k, None], knots[k + 1, None]), (q[k], q[k + 1]), (qd[k], qd[k + 1]), t[:, None])


def hermite(ends: Sequence[Any], q: Sequence[Array], qd: Sequence[Array], t: Any) -> Array:
    """Return coordinates at t by the cubic through two ends; of one end alone, those on its tangent.

    Parameters
    ----------
    ends, q, qd : sequence of array
        Of one or two ends: times [s], coordinates and rates.
    t : array
        Where [s].
    """
    if len(ends) == 1:
        return q[0] + (t - ends[0]) * qd[0]
    h = ends[1] - ends[0]
    s = (t - ends[0]) / h
    rise = q[1] - q[0]
    left: Array = (1.0 - s) * (h * qd[0] - rise) + s * (rise - h * qd[1])
    return q[0] + s * (rise + (1.0 - s) * left)


def _passable(a: Poses, b: Poses) -> Any:
    """Return whether poses b may lie on the way of poses a, (B,): further off than their rates go is another branch."""
    fastest = np.maximum(largest(a.qd), largest(b.qd))
    return a.regular & b.regular & (largest(b.q - a.q) <= 2.0 * (b.t - a.t) * fastest + GUESSED_WELL)


def _divided(a: Poses, b: Poses) -> tuple[Array, Array]:
    """Return guesses and times within steps from poses a to poses b, on cubics through both in the space of q and t.

    A step fails where a singular pose is near, and J^-1 goes about as the inverse of the way that is left to it: so the
    parts become smaller towards the place where that way ends, from either side, three more than it takes until they
    are as small as the way that is left at the other end. In the space of q and t, because towards a fold a coordinate
    goes as the root of the time that is left.
    """
    h, move = b.t - a.t, b.q - a.q
    length = np.maximum(largest(move), EPS)
    zero, one = np.zeros((len(h), 1)), length[:, None]
    slopes = [np.append(h[:, None] * pose.qd, one, axis=1) for pose in (a, b)]
    ends = [np.append(a.q, zero, axis=1), np.append(b.q, one, axis=1)]
    chord = np.linalg.norm(ends[1] - ends[0], axis=1)
    slopes = [slope * (chord / np.linalg.norm(slope, axis=1))[:, None] for slope in slopes]
    near, far = (1.0 / norm(pose.inverse) for pose in (a, b))
    worst = (near / (near + far))[:, None]
    part = np.arange(1.0, PARTS + 1.0)
    left = [
        np.where(part <= 3.0 + np.log(end) / math.log(CLOSER), CLOSER**part, np.nan) for end in (1.0 - worst, worst)
    ]
    u = np.append(worst * (1.0 - left[0]), 1.0 - (1.0 - worst) * (1.0 - left[1]), axis=1)[:, :, None]
    at = hermite((0.0, 1.0), [end[:, None] for end in ends], [slope[:, None] for slope in slopes], u)
    t = a.t[:, None] + h[:, None] * at[:, :, -1] / one
    inside = (t > a.t[:, None]) & (t < b.t[:, None])
    return at[inside][:, :-1], t[inside]


def _believed(equations: Equations, a: Poses, b: Poses) -> Any:
    """Return whether the tangents of poses a lead to poses b, (B,): what `_advance` asks of a step, and more.

    Newton contracts if from the tangent its first correction leads to b but for a small part of itself: about half of
    what the Jacobian changes by, relative to itself, on a way as long as the tangent is off. Where that is far below
    `CONTRACTION` by what it changes from a to b, the correction is not asked for.
    """
    h = (b.t - a.t)[:, None]
    good = a.regular & b.regular
    guess = a.q + h * a.qd
    move, far = b.q - a.q, largest(b.q - guess)
    defect = largest(move - 0.5 * h * (a.qd + b.qd))
    good &= (far <= TRUST) & (defect <= np.maximum(DEFECT * largest(move), NEAR))
    some = np.flatnonzero(good)
    change = a.inverse[some] @ b.jacobian[some]
    size = _from_one(change)
    good[some] = _stays_regular(change, size, a.inverse[some])
    some = some[good[some] & ~(size * far[some] <= CERTAIN * largest(move[some]))]
    if not some.size or hasattr(equations, "closed"):  # an engine's own Newton does not say how it contracts
        return good
    residual, jacobian = equations.rows(guess[some], b.t[some])
    correction = solve(jacobian, residual)
    first, second = largest(correction), largest(b.q[some] - guess[some] + correction)
    closed = within(residual, equations.round_off(guess[some], b.t[some]))
    good[some] = closed | ((first <= TRUST) & (second <= np.maximum(CONTRACTION * first, GUESSED_WELL)))
    return good


# one step after another


def _advance(equations: Equations, last: Poses, times: Array, turns: Array, halvings: int = HALVINGS) -> Poses:
    """Return the poses at times (B,) on the branch of `last`, where there is one: each on a way of its own (`_way`).

    The next pose of every way that has not ended is closed together with those of the others.
    """
    on_the_way = turns[turns > last.t].tolist()
    ways = [_way(equations, last, t, [*(x for x in on_the_way if x < t), t], halvings) for t in times.tolist()]
    poses, asked = [last] * len(ways), {k: next(way) for k, way in enumerate(ways)}
    while asked:
        guesses, targets, near = zip(*asked.values(), strict=True)
        before = Poses.joined(near)
        pose = close(equations, np.concatenate(guesses), np.array(targets), near=before.q)
        off = np.where(pose.regular, 0.0, SINGULAR)
        joined = pose.known & connected(before.inverse, pose.jacobian, off)
        for at, k in enumerate(tuple(asked)):
            try:
                asked[k] = ways[k].send((pose[at : at + 1], bool(joined[at])))
            except StopIteration as end:
                poses[k] = end.value
                del asked[k]
    return Poses.joined(poses)


def _way(
    equations: Equations, last: Poses, t: float, stops: Sequence[float], halvings: int
) -> Generator[tuple[Array, float, Poses], tuple[Poses, bool], Poses]:
    """Return the pose at t on the branch of a pose, if there is one: by steps halved until Newton contracts.

    No step goes over one of the `stops`, of which t is the last.

    A step that went is followed by one twice as long, or as long if the one tried before it did not go; but where
    the branch seems to end on the way (`_end`), by one that leaves a small part of what is left. What did not go so
    is tried along the tangent; an engine's own Newton may go astray from what that misses beside a singular pose, so
    from the cubic through the last two poses, if no coordinate depends on the way to a pose (`together`). It ends where
    a singular pose follows on a short step, or none on the shortest.

    Yields a guess (1, n), its time and the pose that it starts from; is sent the pose that Newton makes of it, and
    whether the two are `connected`.
    """
    first, step, failed = last, t - float(last.t[0]), False
    before, end = last, math.inf
    smallest, ended = (math.ldexp(step, -times) for times in (halvings, halvings // 2))
    curved = getattr(equations, "together", False)
    for _ in range(ATTEMPTS):
        now = float(last.t[0])
        if not failed:
            step = max(min(step, (1.0 - LEFT_OVER) * (end - now)), 2.0 * smallest)
        stop = next(stop for stop in stops if stop > now)
        target = stop if now + (1.0 + LEFT_OVER) * step >= stop else now + step  # a cubic asks for poses that are apart
        pose, joined = yield _ahead(before, last, math.inf if failed else end, target, curved), target, last
        joined = joined and not _spun(equations.laws, last, pose)
        if joined and target == t:
            return pose
        if joined and pose.regular[0]:
            before, last, step, failed = last, pose, step if failed else 2.0 * step, False
            end = math.inf if float(before.t[0]) in stops else _end(before, last)  # from rest all rates grow
        else:
            step, failed = 0.5 * (target - now), True
            if step < smallest or (joined and step < ended):
                return _fold(equations, last, t) if halvings == HALVINGS else nowhere(first, t)
    return nowhere(first, t)


def _spun(laws: Sequence[Any], a: Poses, b: Poses) -> bool:
    """Return whether a step goes round more than laws turn anything, and than the velocities at its ends say.

    Beside a singular pose tangents spin: what follows is right but for thousands of turns, and is rounded as these are.
    """
    (now,), (then,) = a.t, b.t
    driven = max((abs(float(law(then)) - float(law(now))) for law in laws), default=0.0)
    off = b.q - a.q - 0.5 * (then - now) * (a.qd + b.qd)
    return bool(largest(off)[0] > math.tau + driven)


def _end(a: Poses, b: Poses) -> float:
    """Return the time at which the branch through poses a and b seems to end; infinity if it does not.

    Near a limit position rates grow as 1 / sqrt(end - t), so 1 / |qd|^2 falls to zero there along a straight line.
    """
    left, now = (float(1.0 / np.vdot(pose.qd, pose.qd)) for pose in (a, b))
    return float(b.t[0]) + float(b.t[0] - a.t[0]) * now / (left - now) if now < left < math.inf else math.inf


def _ahead(a: Poses, b: Poses, end: float, t: float, curved: bool = False) -> Array:
    """Return coordinates (1, n) at t on the tangent of pose b, or if curved on the cubic through poses a and b.

    Before an end it is a cubic in the root of what is left.
    """
    roots = [math.sqrt(max(end - float(at), 0.0)) for at in (a.t[0], b.t[0], t)]
    if end == math.inf or not roots[0] > roots[1] > roots[2] > 0.0:  # of an end far beyond the step roots are equal
        ends = (a, b) if curved and a.t[0] < b.t[0] else (b,)
        return hermite([float(x.t[0]) for x in ends], [x.q for x in ends], [x.qd for x in ends], t)
    return hermite(roots[:2], (a.q, b.q), (-2.0 * roots[0] * a.qd, -2.0 * roots[1] * b.qd), roots[2])


def _fold(equations: Equations, last: Poses, t: float) -> Poses:
    """Return the pose at t if the branch of `last` ends there, in a singular pose, where Newton contracts by halves."""
    pose = close(equations, last.q, np.array([t]))
    return nowhere(last, t) if pose.regular[0] or not largest(pose.q - last.q)[0] <= TRUST else pose


def _near_again(equations: Equations, last: Poses, t: float) -> Poses:
    """Return the pose at t that Newton finds from `last` itself, if it is near, and no singular one between them."""
    pose = close(equations, last.q, np.array([t]))
    good = pose.regular[0] and largest(pose.q - last.q)[0] <= TRUST and connected(last.inverse, pose.jacobian)[0]
    return pose if good else nowhere(last, t)


def connected(inverse: Array, other: Array, off: Any = 0.0) -> Any:
    """Return whether every matrix on the straight line from a Jacobian to another is regular, for B of them.

    Another branch lies beyond a singular pose, where an eigenvalue of J changes its sign. Where branches nearly meet,
    Newton contracts towards either, and only this tells them apart: (1 - s) J + s J' = J ((1 - s) I + s J^-1 J') is
    regular for all s in [0, 1] if no eigenvalue of J^-1 J' lies in the left half plane; so it is if J^-1 J' differs
    from I by less than 1. Of a singular pose the sign of that eigenvalue is rounding.

    Parameters
    ----------
    inverse, other : (B, n, m), (B, m, n) array
        Inverses of the ones, and the others.
    off : float, or (B,) array
        How far the others may be off: as much may an eigenvalue lie left of zero.
    """
    change = inverse @ other
    return _stays_regular(change, _from_one(change), inverse, off)


def _from_one(change: Array) -> Array:
    """Return by how much matrices (B, n, n) differ from 1, (B,)."""
    return norm(change - np.eye(change.shape[1]))


def _stays_regular(change: Array, size: Array, inverse: Array, off: Any = 0.0) -> Any:
    """Return what `connected` does, from J^-1 J' and by how much it differs from 1."""
    near, off = size < 1.0, np.broadcast_to(off, size.shape)
    for k in np.flatnonzero(~near & np.isfinite(size)):
        near[k] = (np.linalg.eigvals(change[k]).real > -off[k] * np.linalg.norm(inverse[k])).all()
    return near
