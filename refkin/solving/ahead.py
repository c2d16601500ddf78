"""The poses ahead of a sweep, all times at once: found as one batch, each step between them tested as one alone is.

Rough poses at a few of the times, cubics (Hermite) between them and Newton's method on all times together give poses
of which none is believed yet. Then each step from one to the next has to pass the test of `steps`: Newton's method is
started at what the polynomial through the poses before it predicts, and must contract at once, and to the pose that is
there. If it does, the sweep would have taken this step by itself. Steps that fail are divided, all at once; what is
left of them is left to it.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np

from refkin.differences import EPS
from refkin.motion import SINGULAR
from refkin.newton import CONTRACTION, TINY, is_round_off, solve_linear
from refkin.proof.numbers.extrema import LISTED, extrema_of
from refkin.proof.path.blocks import dips
from refkin.proof.path.curve import are_poses
from refkin.solving.passages import OFTEN, turning_points
from refkin.solving.steps import APART, CLEAR, FIRST, FURTHEST, LEAST, NEAR, SHORT, SPREAD, before, neville
from refkin.solving.sweep import ALONE, Sweep, pose_between
from refkin.system import System

DIVISIONS, MOST_DIVIDED, PARTS, SHRINKING = 4, 4, 10, 0.7
"""How often steps may be divided, how many together, into how many parts on either side, and how these shrink."""
FEW = 8
"""Fewer times than this are found sooner one after another."""
STRIDE, ROUGH, MOST_ROUGH = 18, 1e-2, 4
"""One in so many times has a rough pose; its last correction [sizes, rad], and how many it may take."""
MOST_CORRECTIONS = 30
"""Corrections after which a guess that has not come to round-off is given up; at a limit the error halves."""
CURVED = 4.0
"""What is left of a pose after a correction e may be as large as this times e^2, however well the last one did."""
MOST = 4
"""Batches that are begun for one sweep; one that it leaves is of no use any more."""
SAME = 1e-9
"""Poses nearer to each other than this are one [sizes, rad]."""


class Leaps:
    """What of the way over the times of a scene a sweep goes at once.

    Parameters
    ----------
    sweep : Sweep
    times : sequence of float
        All times of the scene [s].
    """

    def __init__(self, sweep: Sweep, times: Sequence[float]) -> None:
        self.sweep, self.times, self.left = sweep, times, MOST
        self.ahead: Ahead | None = None
        self.steps = set[int]()
        """The numbers of the poses from which it took the sweep's steps."""

    def over(self, done: int) -> list[Any]:
        """Take the sweep on from the last of the times that are done; return the poses (n,) at the next ones."""
        sweep, rest, first = self.sweep, self.times[done:], len(self.sweep.t) - 1
        poses = None if self.ahead is None else self.ahead.follow()
        alone = sweep.singular or sweep.winds
        if poses is None and self.left and len(rest) >= FEW and not alone:
            targets = _targets(sweep, rest)
            if targets[0].size:  # none where laws turn back often before the next time
                self.ahead, self.left = Ahead(sweep, *targets), self.left - 1
                poses = self.ahead.follow()
        self.steps.update(range(first, len(sweep.t) - 1))
        return poses or []

    def first_astray(self, doubted: list[int]) -> int | None:
        """Return the first of some of its steps to a pose that the sweep's own do not lead to; None if there is none.

        It is noted as uncertified. To find that there is no proof of it would take far longer; of steps whose
        determinants say enough, that there is one is found sooner.
        """
        t, q = self.sweep.t, self.sweep.q
        leapt = sorted(self.steps.intersection(doubted))
        unclear = dips(self.sweep.system, np.array(t), np.array(q).T) if leapt else ()
        for k in (k for k in leapt if unclear[k]):
            own = pose_between(self.sweep.system, q[k], t[k], t[k + 1], proving=False)
            if own is not None and not np.max(np.abs(own - q[k + 1])) <= SAME * max(1.0, np.max(np.abs(own))):
                self.sweep.uncertified.append(k)
                return k
        return None


class Ahead:
    """Poses at times after the last one of a sweep, and which of the steps to them it may take as they are.

    Parameters
    ----------
    sweep : Sweep
        At a regular pose. Of redundant rows those tell its branch that are independent there.
    asked, between : (A,), (B,) array
        Times asked for, in order, and extrema of the laws between them: steps of their own, as in a sweep.
    """

    def __init__(self, sweep: Sweep, asked: Any, between: Any) -> None:
        self.sweep, self.system = sweep, sweep.full
        self.blocks, self.signs = sweep.sides()
        with np.errstate(all="ignore"):  # guesses may lie anywhere
            here, t = sweep.t[-1], _merged(asked, between)
            knots = self._rough(t)
            t = t[t <= knots[0][-1]]
            self.t, self.q = np.append(here, t), np.empty((len(sweep.q[-1]), 1 + len(t)))
            self.q[:, 0], self.q[:, 1:] = sweep.q[-1], self._closed(_cubic(*knots, t), t)
            self.stops, self.asked, self.turning = self.t, _among(asked, self.t), _among(between, self.t)
            self.sure = np.zeros(len(t), bool)
            if len(t):
                self._test(np.arange(len(t)))
            for _ in range(DIVISIONS):
                if not self._divide():
                    break

    def follow(self) -> list[Any] | None:
        """Take the steps that are sure, on from where the sweep is, and return the poses (n,) at the times asked for.

        None if the sweep has gone elsewhere, or to the end of these poses.
        """
        sweep, k = self.sweep, int(np.searchsorted(self.t, self.sweep.t[-1]))
        if k >= len(self.sure) or not np.max(np.abs(self.q[:, k] - sweep.q[-1])) <= SAME:
            return None
        steps = range(k, k + int(np.argmin(np.append(self.sure[k:], False))))
        for j in steps:
            sweep.t.append(float(self.t[j + 1]))
            sweep.q.append(self.q[:, j + 1].copy())
            sweep.step = 2 * (sweep.t[-1] - sweep.t[-2])
        return [self.q[:, j + 1] for j in steps if self.asked[j + 1]]

    def _rough(self, t: Any) -> tuple[Any, Any, Any]:
        """Return times (K,), poses and velocities (n, K), the sweep's last first, as far as Newton's method leads."""
        s, first, start = self.system, self.sweep.q[-1], self.sweep.t[-1]
        knots = [(start, first, _solve(s.phi_q(first, start), _pushed(s, first, start, t[0])))]
        bend, k, stride = np.zeros_like(first), -1, STRIDE
        while k < len(t) - 1 and stride:
            aim = min(k + stride, len(t) - 1)
            (last, at, rate), now = knots[-1], float(t[aim])
            h = now - last
            q = predicted = at + h * (rate + 0.5 * h * bend)
            for _ in range(MOST_ROUGH if stride > 1 else MOST_CORRECTIONS):  # the next time may be at a limit
                jacobian = s.phi_q(q, now)
                correction = _solve(jacobian, -s.phi(q, now))
                q = q + correction
                size = np.max(np.abs(correction))
                if not ROUGH < size <= 1.0:
                    break
            near = size <= ROUGH and (stride == 1 or np.max(np.abs(q - predicted)) <= NEAR)
            if near and np.isfinite(qd := _solve(jacobian, _pushed(s, q, now, last))).all():
                bend, k, stride = (qd - rate) / h, aim, min(2 * stride, STRIDE)
                knots.append((now, q, qd))
            else:
                stride //= 2
        times, poses, rates = zip(*knots, strict=True)
        return np.array(times), np.array(poses).T, np.array(rates).T

    def _closed(self, q: Any, t: Any) -> Any:
        """Return the poses (n, B) that Newton's method finds from guesses, to round-off; NaN where it finds none."""
        s, previous, open_ = self.system, np.full(len(t), np.inf), np.arange(len(t))
        q, out = q.copy(), np.full_like(q, np.nan)
        for _ in range(MOST_CORRECTIONS):
            if not open_.size:
                break
            at, now = q[:, open_], t[open_]
            residual = s.phi(at, now)
            at = at + _solve(s.phi_q(at, now), -residual)
            size, scale = np.max(np.abs(at - q[:, open_]), axis=0), np.maximum(1.0, np.max(np.abs(at), axis=0))
            ratio = size / previous[open_]
            stalled = (size <= 1e-6 * scale) & is_round_off(residual, at) & (ratio > 0.6)
            # The error is squared: of the next correction nothing would be left but rounding. A correction along which
            # the equations are straight says nothing of the next one: that is C e^2 with C of order 1 at the least.
            squared = (size * np.maximum(ratio**2, CURVED * size) <= EPS / 8 * scale) & (ratio > 0.0) & (ratio < 1e-2)
            done = (size <= EPS * scale) | stalled | squared
            q[:, open_], previous[open_] = at, size
            out[:, open_[done]] = at[:, done]
            open_ = open_[~done & np.isfinite(size)]
        return out

    def _divide(self) -> bool:
        """Put poses into the first of the steps that failed; return whether there are any."""
        bad = np.flatnonzero(~self.sure & np.isfinite(np.diff(self.q, axis=1)).all(axis=0))[:MOST_DIVIDED]
        if not bad.size:
            return False
        ends = np.stack([bad, bad + 1])
        q, t = self.q[:, ends], self.t[ends]
        slopes = self.system.phi_q(q.reshape(len(q), -1), t.ravel())
        pushed = _pushed(self.system, q.reshape(len(q), -1), t.ravel(), t[::-1].ravel())
        rates = _solve(slopes, pushed).reshape(q.shape)
        same, _ = self._sides(slopes)
        fastest = np.max(np.abs(rates), axis=(0, 1), initial=0.0)
        near = _largest(q[:, 1] - q[:, 0]) <= 2.0 * (t[1] - t[0]) * fastest + SAME
        count = int(np.argmin(np.append(near & same.reshape(2, -1).all(axis=0), False)))
        if not count:  # another branch: what follows is of no use
            return False
        regular = np.moveaxis(slopes.reshape(*slopes.shape[:2], *t.shape)[..., :count], (2, 3), (0, 1))
        inverse = np.linalg.pinv if self.system.m > self.system.n else np.linalg.inv
        sizes = np.linalg.norm(inverse(regular), axis=(2, 3))
        worst = sizes[1] / (sizes[0] + sizes[1])
        return self._insert(*_parts(t[:, :count], q[..., :count], rates[..., :count], worst))

    def _insert(self, guesses: Any, t: Any) -> bool:
        """Add the poses that Newton's method finds from guesses, and test the steps to and from them."""
        q = self._closed(guesses, t)
        there = np.isfinite(q).all(axis=0)
        t, q = t[there], q[:, there]
        at = np.searchsorted(self.t, t)
        self.t, self.q = np.insert(self.t, at, t), np.insert(self.q, at, q, axis=1)
        self.asked, self.turning = np.insert(self.asked, at, False), np.insert(self.turning, at, False)
        self.sure = np.insert(self.sure, at - 1, False)
        new = at + np.arange(len(t))
        steps = _merged(new - 1, new)
        if steps.size:
            self._test(steps)
        return bool(steps.size)

    def _test(self, steps: Any) -> None:
        """Note which of the steps, by the number of the pose that they start from, pass the test."""
        sweep, s, ends = self.sweep, self.system, steps + 1
        t, q, moved = self.t[ends], self.q[:, ends], np.abs(self.q[:, ends] - self.q[:, steps])
        predicted, unled = self._predicted(ends)
        first = _solve(s.phi_q(predicted, t), -s.phi(predicted, t))
        # What is left after it is Newton's second correction, if that leads to the pose.
        first, left, move, off = map(_largest, (first, q - predicted - first, moved, q - predicted))
        contracted, led = left <= CONTRACTION * first, off <= NEAR * move
        sure = contracted | ((first < TINY) & (left <= SAME))
        sure &= np.where(unled, move <= FIRST, led | (off <= TINY)) & (_largest(moved[s.angles]) <= FURTHEST)
        jacobian = s.phi_q(q, t)
        same, determinant = self._sides(jacobian)
        decided, k = contracted & (unled | led), np.searchsorted(self.stops, t)
        clear = decided & (determinant > np.log(CLEAR)) & ~self.turning[ends]
        clear &= t - self.t[steps] >= SHORT * (self.stops[k] - self.stops[k - 1])
        sure &= same & (sweep.driven(self.t[steps], t) <= FURTHEST) & are_poses(s.phi(q, t), q)
        undecided = np.flatnonzero(sure & ~clear)
        if undecided.size:
            sigma = np.linalg.svd(np.moveaxis(jacobian[..., undecided], -1, 0), compute_uv=False)[:, -1]
            near = np.maximum(off, first)[undecided] <= sigma / APART
            least = np.where(self.turning[ends[undecided]], ALONE, SINGULAR)
            sure[undecided] = (sigma > least) & (decided[undecided] | near)
        sure &= (steps > 0) | (t - self.t[steps] <= sweep.step)  # a sweep may be to set out with a short step
        self.sure[steps] = sure

    def _sides(self, phi_q: Any) -> tuple[Any, Any]:
        """Return where all determinants have the signs of the sweep's last pose, and the smallest's logarithm, (B,)."""
        signs, logarithms = self.blocks.each_of_batch(phi_q)
        return (signs == self.signs).all(axis=1), np.min(logarithms, axis=1, initial=0.0)

    def _predicted(self, ends: Any) -> tuple[Any, Any]:
        """Return what the poses before each of some predict for it (n, B), and where that is one pose alone, (B,)."""
        sweep = self.sweep
        first = max(len(sweep.t) - 8, sweep.jumps[-1] + 1 if sweep.jumps else 0)
        times = np.append(sweep.t[first:-1], self.t)
        poses = np.concatenate([np.array(sweep.q[first:]).T, self.q[:, 1:]], axis=1)
        numbers, listed, apart = ends + len(times) - len(self.t), times.tolist(), np.diff(times)
        least, nearest = SPREAD * apart[numbers - 1], apart[np.maximum(numbers - [[2], [3], [4]], 0)].min(axis=0)
        few = set(numbers[(numbers < 4) | (nearest < np.maximum(least, LEAST))].tolist())
        kept = [before(listed, k - 1, listed[k]) if k in few else range(k - 1, k - 5, -1) for k in numbers.tolist()]
        counts, out = np.array([len(these) for these in kept]), np.empty((len(poses), len(ends)))
        for count in set(counts.tolist()):
            some = np.flatnonzero(counts == count)
            these = np.array([kept[k] for k in some])[:, ::-1].T
            out[:, some] = neville([times[k] for k in these], [poses[:, k] for k in these], self.t[ends[some]])
        return out, counts == 1


def _targets(sweep: Sweep, times: Sequence[float]) -> tuple[Any, Any]:
    """Return the times up to where laws turn back often, and where they do between them, not next to one of them."""
    ends = np.append(sweep.t[-1], times)
    close = 4 * EPS * np.abs(ends).max()
    constraints = sweep.system.mechanism.constraints
    turning = np.array(extrema_of(constraints, ends[0], ends[-1]))
    if len(turning) > LISTED:  # not all of them are known
        return ends[:0], turning[:0]
    turning = turning[(ends[0] < turning) & (turning < ends[-1])]  # one next to an end may be rounded to it
    interval = np.searchsorted(ends, turning) - 1
    near = np.minimum(turning - ends[interval], ends[interval + 1] - turning) <= close
    counts = np.bincount(interval, minlength=1)
    # What happens within the last digits of a time is left to the sweep.
    for k in set(interval[near].tolist()):
        if turning_points(sweep.system, ends[k], ends[k + 1])[1]:
            counts[k] = OFTEN + 1
    turning, often = turning[~near], np.flatnonzero(counts > OFTEN)
    end = ends[often[0]] if often.size else ends[-1]
    return ends[1:][ends[1:] <= end], turning[turning < end]


def _merged(one: Any, other: Any) -> Any:
    """Return what stands in either, in order, none twice; NumPy's own loads masked arrays for it, 30 ms."""
    return np.array(sorted({*one.tolist(), *other.tolist()}), other.dtype)


def _among(some: Any, values: Any) -> Any:
    known = set(some.tolist())
    return np.array([x in known for x in values.tolist()], bool)


def _pushed(system: System, q: Any, t: Any, towards: Any) -> Any:
    """Return -phi_t about as it is, by a difference: guesses are no reason to ask for rates that no scene calls for."""
    other = t + 1e-6 * (towards - t)
    other = np.where(other == t, towards, other)
    return (system.phi(q, t) - system.phi(q, other if np.ndim(t) else float(other))) / (other - t)


def _cubic(knots: Any, q: Any, qd: Any, t: Any) -> Any:
    """Return poses (n, B) at t by the cubics through knots (K,), with poses and velocities (n, K) there."""
    if len(knots) == 1:
        return np.repeat(q, len(t), axis=1)
    k = np.clip(np.searchsorted(knots, t) - 1, 0, len(knots) - 2)
    h = knots[k + 1] - knots[k]
    s, rise = (t - knots[k]) / h, q[:, k + 1] - q[:, k]
    one, other = h * qd[:, k] - rise, rise - h * qd[:, k + 1]
    return q[:, k] + s * (rise + (1.0 - s) * (one * (1.0 - s) + other * s))


def _parts(t: Any, q: Any, rates: Any, worst: Any) -> tuple[Any, Any]:
    """Return guesses (n, P) and times (P,) within steps between two poses, ends of (n, 2, B).

    A step fails where a singular pose is near, and the inverse of phi_q goes about as the inverse of the way that is
    left to it: that is the part `worst` (B,) of the step. So parts become smaller towards there, from either side, on
    cubics in the space of q and t, because towards a limit q goes as the root of the time that is left.
    """
    h = t[1] - t[0]
    unit = np.maximum(_largest(q[:, 1] - q[:, 0]), EPS) / h
    way = np.append(q[:, 1] - q[:, 0], (unit * h)[None], axis=0)
    tangents = np.append(rates, np.stack([unit, unit])[None], axis=0)
    tangents *= np.linalg.norm(way, axis=0) / np.linalg.norm(tangents, axis=0)
    left = SHRINKING ** np.arange(1.0, PARTS + 1)[:, None]
    u = np.append(worst * (1.0 - left), 1.0 - (1.0 - worst) * (1.0 - left), axis=0)
    one, other = (tangents[:, 0] - way)[:, None], (way - tangents[:, 1])[:, None]
    x = u * (way[:, None] + (1.0 - u) * (one * (1.0 - u) + other * u))
    at = t[0] + x[-1] / unit
    inside = (at > t[0]) & (at < t[1]) & np.isfinite(x).all(axis=0)
    at, first = np.unique(at[inside], return_index=True)
    return (q[:, :1] + x[:-1])[:, inside][:, first], at


def _solve(matrix: Any, right: Any) -> Any:
    """Return x of a system (m, n), (m,), or of a batch (m, n, B), (m, B); NaN where a matrix is singular."""
    try:
        return solve_linear(matrix, right)
    except np.linalg.LinAlgError:  # one of them spoils the batch
        x, square = np.full(matrix.shape[1:], np.nan), matrix.shape[0] == matrix.shape[1]
        if matrix.ndim > 2:
            stacked = matrix.transpose(2, 0, 1)
            regular = np.linalg.slogdet(stacked)[0] != 0.0 if square else np.isfinite(stacked).all(axis=(1, 2))
            x[:, regular] = solve_linear(matrix[..., regular], right[:, regular])
        return x


def _largest(values: Any) -> Any:
    return np.abs(values).max(axis=0, initial=0.0)
