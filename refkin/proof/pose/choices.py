"""Redundant rows: error bounds that hold whichever n of the m rows a reader takes for the mechanism.

A pose is certified on n independent rows; the others agree with them up to rounding of the mechanism's numbers. But
where rows nearly depend on each other, that rounding is magnified: the pose that another choice of n rows isolates lies
further away, and its rates further still. All of these are solutions of the scene as well as that of the first choice
is, so the bounds cover them: each choice is certified at the same answer, and the largest bound counts.

From one choice to the next some rows S_I give way to rows D_J that were left out; the new rows are independent where
det (D S^-1)[J, I] is not zero.

Loops of space have thousands of choices. There the bounds cover those that serve as well as the first: whose inverse
has a Frobenius norm of at most `WORSE` / sigma_min of all rows together. How far they lead from the first is computed
at each pose to first order. With R = phi_q[S]^-1 and F = phi_q[D] R, what solves S for a right side w is y = R w[S],
what solves the other choice y + R[:, I] a with a = F[J, I]^-1 (w[D] - phi_q[D] y)[J]. For poses w = -phi. For
velocities and accelerations w, and so a, is linear in what the levels below are moved by, which is in their a's.
"""

from __future__ import annotations

import math
from collections.abc import Iterator
from dataclasses import replace
from functools import partial
from itertools import combinations
from typing import Any

import numpy as np

from refkin.joints import SPACE
from refkin.proof.numbers.bounded import Extended, Times, bounded_system, box, off_by, product, read
from refkin.proof.numbers.preconditioned import WORSE, groups_of_rows, inverses, left_out
from refkin.proof.pose.certificate import certify, unique_within
from refkin.proof.pose.isolate import NEAR, Isolation, isolate
from refkin.proof.pose.krawczyk import krawczyk
from refkin.system import System

MOST_CHOICES = 256
"""Choices of rows that are certified, all of them; where there are more, those that serve as well are compared."""
MOST_OF_SPACE = 16
"""The same in space: a loop of four hinges has 2024 choices, each as costly as the first."""
MOST_COMBINATIONS = 20_000
"""Sets of rows of which it is asked whether they are such a choice; of more of them norms say how far they lead."""
STEP = 1e-100
"""Complex step: nothing of its square is left."""
CLOSE = 2.0**-6
"""Distance of another choice's pose, in uniqueness radii, up to which the first order tells how far it is."""
AT_A_TIME = 128
"""Poses whose choices are compared at a time: what a cache holds."""
DEPENDENT = 2.0**-40
"""Determinant, largest over the poses, up to which rows depend on each other: far more than rounding leaves of 0."""
LOOKED_AT = 16
"""Poses at which that is asked."""


Answers = tuple[Any, ...]
"""q (n, B), t (B,), qd and qdd, or None."""
Groups = list[tuple[Any, Any]]
"""Poses (their numbers), and the rows that serve there."""


def _over_all_choices(system: System, proof: Isolation, groups: Groups, answers: Answers) -> Isolation:
    """Return an isolation with bounds that hold for every choice of n rows that isolates a pose near the answer.

    With `why` where there are too many choices to certify: its bounds hold for those that serve as well as the rows of
    the proof, or are NaN where that is not known of some pose.
    """
    if system.m == system.n or not proof.ok.any():
        return proof
    bounds = [proof.position.copy(), proof.velocity.copy(), proof.acceleration.copy()]
    most, why = MOST_OF_SPACE if system.kind is SPACE else MOST_CHOICES, ""
    too_many = [np.zeros(0, int)]
    for samples, rows in groups:
        asked = samples[proof.ok[samples]]
        q, t, *_ = _at(asked, answers)
        choices = _other_choices(system, rows, q, t, most) if asked.size else []
        if choices is None:
            too_many.append(asked)
            continue
        for other in choices:
            every = np.array(_bounds(system, other, proof.ok[samples], *_at(samples, answers)))
            for k in np.flatnonzero(np.isnan(every[0])):
                chosen = _factors(system, rows, other, *_at(samples[[k]], answers)[:2])[0]
                if abs(np.linalg.det(chosen)) <= DEPENDENT:  # no choice at this pose
                    every[:, k] = 0.0
            for bound, of_choice in zip(bounds, every, strict=True):
                bound[samples] = np.maximum(bound[samples], of_choice)
        if np.isnan(bounds[0][asked]).any():
            why = why or "some choice of redundant rows is nearly singular: no error bound covers it"
    asked = np.sort(np.concatenate(too_many))
    for first in range(0, len(asked), AT_A_TIME):
        at = asked[first : first + AT_A_TIME]
        for bound, further in zip(bounds, _further(system, proof, at, answers), strict=False):
            bound[at] += further
    if asked.size:
        why = f"redundant rows can be chosen in more than {most} ways"
        if np.isnan(bounds[0][asked]).any():
            why = f"{why}: no error bound covers all of them"
        else:
            why = f"{why}: the bounds cover inverses of a Frobenius norm up to {WORSE:g} / sigma_min of all rows"
    return replace(proof, position=bounds[0], velocity=bounds[1], acceleration=bounds[2], why=why)


def _further(system: System, proof: Isolation, at: Any, answers: Answers) -> list[Any]:
    """Return what choices that serve as well add to the bounds at some poses, (B,) for each level."""
    q, t, *rates = _at(at, answers)
    rows = proof.rows if proof.rows.ndim == 1 else proof.rows[:, at]
    moves = _Moves(system, rows, q, t, [x for x in rates if x is not None])
    with np.errstate(all="ignore"):
        away = moves.at_most() if math.comb(system.m, system.n) > MOST_COMBINATIONS else moves.farthest()
        share = away[0] / unique_within(system, rows, q, t, proof.position[at])
        factor = np.where(share <= CLOSE, 1 + 8 * share, np.nan)  # what is beyond the first order
    return [far * factor for far in away]


def _at(samples: Any, answers: Answers) -> Answers:
    """Return answers at some poses."""
    return tuple(None if x is None else x[..., samples] for x in answers)


def isolate_every_choice(system: System, q: Any, t: Any, qd: Any = None, qdd: Any = None) -> Isolation:
    """Isolate poses, redundant ones by the rows that serve best at each, with bounds over all choices of rows.

    Parameters
    ----------
    system, q, t, qd, qdd
        As for `isolate`.
    """
    t = np.broadcast_to(np.asarray(t, float), np.shape(q)[1:])
    answers = tuple(None if x is None else np.asarray(x, float) for x in (q, t, qd, qdd))
    groups = list(groups_of_rows(system, answers[0], t))
    rows = groups[0][1]
    if len(groups) > 1:
        rows = np.empty((system.n, len(t)), int)
        for samples, own in groups:
            rows[:, samples] = own[:, None]
    return _over_all_choices(system, isolate(system, *answers, rows=rows), groups, answers)


def _other_choices(system: System, rows: Any, q: Any, t: Any, most: int) -> list[Any] | None:
    """Return the sets of n rows, other than the given one, that are independent at some pose; None if more than `most`.

    Some of the poses q (n, B) at times t (B,) are looked at.
    """
    others = np.delete(np.arange(system.m), rows)
    if math.comb(system.m, system.n) > MOST_COMBINATIONS:
        return None
    some = np.unique(np.linspace(0, q.shape[1] - 1, LOOKED_AT).astype(int))
    factors = np.nan_to_num(_factors(system, rows, others, q[:, some], t[some]))
    choices = []
    for count in range(1, len(others) + 1):
        for new in combinations(range(len(others)), count):
            for old in combinations(range(system.n), count):
                if np.max(np.abs(np.linalg.det(factors[:, new][:, :, old]))) > DEPENDENT:
                    choices.append(np.sort(np.append(np.delete(rows, old), others[list(new)])))
                    if len(choices) > most:
                        return None
    return choices


def _factors(system: System, rows: Any, others: Any, q: Any, t: Any) -> Any:
    """Return the factors by which other rows of phi_q are sums of n rows, (B, others, n)."""
    slope = np.moveaxis(system.phi_q(q, t), -1, 0)
    return slope[:, others] @ inverses(slope[:, rows])


def _bounds(system: System, rows: Any, asked: Any, q: Any, t: Any, qd: Any = None, qdd: Any = None) -> list[Any]:
    """Return the error bounds (3, B) of one choice of rows: 0 where its pose is another one, NaN without a proof."""
    proof = certify(system, q, t, qd, qdd, rows=rows)
    bounds = [np.zeros(len(t)) for _ in range(3)]
    for bound, radii in zip(bounds, (proof.radii, proof.velocity, proof.acceleration), strict=True):
        if radii is not None:
            bound[proof.ok] = np.max(radii[:, proof.ok], axis=0)
    for sample in np.flatnonzero(asked & ~proof.ok):
        root = krawczyk(system, q[:, sample], float(t[sample]), rows=rows)
        levels = [None if x is None else x[:, sample] for x in (q, qd, qdd)]
        if root is None or np.max(root.distance(levels[0])) <= NEAR:
            for bound, distance in zip(bounds, root.distances(*levels) if root else [np.nan] * 3, strict=False):
                bound[sample] = distance
    return bounds


class _Moves:
    """How far choices of rows lead from the first one, at poses (B of them) and to first order.

    The first may be others at each pose: `rows` (B, n). `slope` (B, m, n) and `inverse` (B, n, n) are phi_q and R,
    `factors` (B, d, n) is F. Per level `moved` (B, n, L) is what moves the answer, `missed` (B, d, L) what that leaves
    of the d rows left out: for a pose along each column of R, and, last of the L, for what the answer itself misses.
    `turned`: accelerations, for velocities along R.
    """

    def __init__(self, system: System, rows: Any, q: Any, t: Any, rates: list[Any]) -> None:
        self.every = np.arange(len(t))[:, None]
        self.rows, self.others = (
            np.broadcast_to(some.T, (len(t), len(some))) for some in (rows, left_out(rows, system.m))
        )
        self.slope = np.moveaxis(system.held_at(q).phi_q(q, t), -1, 0)
        self.inverse = inverses(self.slope[self.every, self.rows])
        self.factors = self.slope[self.every, self.others] @ self.inverse
        missing = _missing(system, q, t, rates)
        own, left = self.solved(-missing[0][:, :, None])
        along = np.append(self.inverse, own, axis=2)
        self.moved, self.missed = [along], [np.append(0.0 * self.factors, left, axis=2)]
        for order, rate in enumerate(rates, 1):
            w = _change(system, q, t, rate, along, self.moved[1] if order == 2 else None, rates[0])
            w[:, :, -1] -= missing[order]
            for kept, part in zip((self.moved, self.missed), self.solved(w), strict=True):
                kept.append(part)
        if len(rates) == 2:
            still = _change(system, q, t, None, 0.0 * self.inverse, self.inverse, rates[0])
            self.turned, self.missed_turning = self.solved(still)
        own = np.linalg.norm(self.inverse, axis=(1, 2))
        self.limit = np.fmax(WORSE / np.linalg.svd(self.slope, compute_uv=False)[:, -1], own)

    def solved(self, w: Any) -> tuple[Any, Any]:
        """Return what solves the first rows for right sides (B, m, L), and what that leaves of the others."""
        y = self.inverse @ w[self.every, self.rows]
        return y, w[self.every, self.others] - self.slope[self.every, self.others] @ y

    def at_most(self) -> list[Any]:
        """Return a bound of the distance of every choice that serves as well, by norms, (B,) for each level.

        What another choice adds to a level is its inverse times what its rows miss there: of the rows left out what the
        answer misses, and of all rows what the levels below are moved by.
        """
        inward, n = self.slope[self.every, self.rows], self.rows.shape[1]

        def effect(moved: Any, missed: Any) -> Any:
            right = self.slope @ moved
            right[self.every, self.others] += missed
            return right[:, :, :n] @ inward

        missed = [np.linalg.norm(level[:, :, -1], axis=1) for level in self.missed]
        far, norm = [self.limit * missed[0]], partial(np.linalg.norm, ord=2, axis=(1, 2))
        if len(missed) > 1:
            slopes = [effect(*both) for both in zip(self.moved[1:], self.missed[1:], strict=True)]
            far.append(self.limit * (missed[1] + norm(slopes[0]) * far[0]))
        if len(missed) > 2:
            turning = effect(self.turned, self.missed_turning)
            along = slopes[1] - turning @ self.moved[1][:, :, :n] @ inward
            far.append(self.limit * (missed[2] + norm(along) * far[0] + norm(turning) * far[1]))
        return far

    def farthest(self) -> list[Any]:
        """Return the largest distance of a choice that serves as well, (B,) for each level; NaN of no inverse."""
        _, d, n = self.factors.shape
        own, limit = np.linalg.norm(self.inverse, axis=(1, 2)), self.limit
        gram, far = np.swapaxes(self.inverse, 1, 2) @ self.inverse, [0.0 * own for _ in self.moved]
        for count in range(1, min(d, n) + 1):
            olds = np.array(list(combinations(range(n), count)))
            for new in map(np.array, combinations(range(d), count)):
                rows = self.factors[:, new]
                blocks = np.moveaxis(rows[:, :, olds], 1, 2)
                with np.errstate(invalid="ignore"):  # a pose whose first choice has no inverse: all of it is NaN
                    b, c = np.nonzero(np.abs(np.linalg.det(blocks)) > DEPENDENT)
                inner, old = np.linalg.inv(blocks[b, c]), olds[c]
                # |R - R[:, I] inner F[J]|^2 + |R[:, I] inner|^2, the square of the norm of the other inverse
                inward = np.swapaxes(inner, 1, 2) @ gram[b[:, None, None], old[:, :, None], old[:, None, :]] @ inner
                outward = (rows @ np.swapaxes(rows, 1, 2) + np.eye(count))[b]
                shared = np.swapaxes((rows @ gram)[b[:, None], :, old], 1, 2)
                size = own[b] ** 2 + np.sum(inward * outward - 2 * inner * np.swapaxes(shared, 1, 2), axis=(1, 2))
                serve = size <= limit[b] ** 2
                for level, moved in zip(far, self.moves(b[serve], new, old[serve], inner[serve]), strict=True):
                    np.maximum.at(level, b[serve], np.max(np.abs(moved), axis=1))
        return far

    def moves(self, b: Any, new: Any, old: Any, inner: Any) -> Iterator[Any]:
        """Yield, per level, how P choices move the answers at poses b (P,): rows old (P, k) give way to new (k,)."""

        def of(matrix: Any) -> Any:
            return np.swapaxes(matrix[b[:, None], :, old], 1, 2)

        def through(left: Any, *parts: tuple[Any, Any]) -> Any:
            right = left[b][:, new, -1]
            return np.einsum("pij,pj->pi", inner, right + sum(_times(of(m)[:, new], a) for m, a in parts))

        a = [through(self.missed[0])]
        yield _times(of(self.inverse), a[0])
        if len(self.moved) > 1:
            a.append(through(self.missed[1], (self.missed[1], a[0])))
            yield _times(of(self.moved[1]), a[0]) + _times(of(self.inverse), a[1])
        if len(self.moved) > 2:
            last = through(self.missed[2], (self.missed[2], a[0]), (self.missed_turning, a[1]))
            yield _times(of(self.moved[2]), a[0]) + _times(of(self.turned), a[1]) + _times(of(self.inverse), last)


def _times(matrices: Any, vectors: Any) -> Any:
    return np.einsum("pij,pj->pi", matrices, vectors)


def _missing(system: System, q: Any, t: Any, rates: list[Any]) -> list[Any]:
    """Return what answers miss of all rows, (B, m) for each level: small by cancellation, so in extended precision."""
    sharp, times, at = bounded_system(system.held_at(q), Extended), Times(t, len(rates)), box(q, 0.0, Extended)
    slope = read(sharp.phi_q(at, times), len(t), np.longdouble)
    rows = [read(sharp.phi(at, times), len(t))]
    for order, rate in enumerate(rates):
        right = sharp.gamma(at, box(rates[0], 0.0, Extended), times) if order else sharp.nu(at, times)
        rows.append(off_by(slope, rate, read(right, len(t), np.longdouble)))
    return [missing.mid.T for missing in rows]


def _change(system: System, q: Any, t: Any, rate: Any, along: Any, turned: Any, qd: Any) -> Any:
    """Return the derivative of right side less phi_q rate along directions (B, n, L), by complex steps, (B, m, L).

    The right side is nu or, where velocities change as well (`turned`), gamma.
    """
    batch, _, count = along.shape
    many, times = (np.repeat(x, count, axis=-1) for x in (q, t))
    moving = system.held_at(many)

    def stepped(x: Any, by: Any) -> Any:
        return x + 1j * STEP * np.moveaxis(by, 0, 1).reshape(len(q), -1)

    at = stepped(many, along)
    if turned is None:
        w = np.imag(moving.nu(at, times)) / STEP
    else:
        w = np.imag(moving.gamma(at, stepped(np.repeat(qd, count, axis=-1), turned), times)) / STEP
    if rate is not None:
        w = w - product(np.imag(moving.phi_q(at, times)) / STEP, np.repeat(rate, count, axis=-1))
    return np.moveaxis(w.reshape(-1, batch, count), 0, 1)
