"""What an answer owes where it says ok and no budget holds: numbers, closed joints, no rates where there are none.

In and next to a singular pose an error has no first-order bound, and where the reference is lost or locked there is
nothing to compare with: an engine may go on there, on any branch. A residual has a bound everywhere: rounding leaves as
little of it as anywhere. So joints are asked, those between the bodies that an answer has: by its pose, and by its
rates at that pose. Rows with a coordinate of their own, whose rates no answer has, say nothing of rates; nor do those
of a part with a body that an answer has not: its rates may be the largest, of which the others are rounded.

Beside a singular pose a budget holds, but of each coordinate by itself: all of them may be off together, along the one
way that the joints hardly hold, by 1e4 times as much as rounding leaves of a joint, and more. There joints are asked,
too (`opened_beside`).
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from functools import cached_property
from itertools import takewhile
from typing import Any

import numpy as np

from crosscheck.engines import Term
from crosscheck.judge.budget import slopes, times_with
from crosscheck.judge.comparison import Comparison, Reference, difference, rows_of, scaled, uncompared, whole_poses
from crosscheck.judge.hard_poses import TOO_WIDE, allowed_at
from crosscheck.judge.parts import at_joints, by_part, parts_of
from crosscheck.judge.poses import all_levels, rows_among
from crosscheck.judge.records import QUANTITIES, At, Cause, wrong
from crosscheck.judge.rounding import (
    largest,
    output_rounding,
    rate_rows,
    residual_error,
    solve_error,
    table_error,
    times,
)
from crosscheck.judge.samples import short
from crosscheck.judge.spatial import reversed_joints
from refkin.model import Scene
from refkin.motion import Motion, Status
from refkin.proof.numbers.bounded import Times
from refkin.solving.starts import in_form
from refkin.system import System, compile_system

TURNING = 8.0
"""Two bodies turn a row of three, in space with 2 |p'| each: 2 * 2 * sqrt(3), rounded up."""

BESIDE = 1e-4
"""Up to this sigma_min a pose is beside a singular one."""


def uncompared_faults(ref: Reference, motion: Motion, terms: Sequence[Term] = ()) -> Iterator[dict[str, Any]]:
    """Yield all that is wrong with uncompared answers by themselves, but rates that there are not (`believed`).

    Parameters
    ----------
    ref, motion, terms
        As for `Uncompared`.
    """
    those = Uncompared(ref, motion, terms)
    for asked in (those.numberless, those.unclosed, those.opening, those.elsewhere):
        yield from asked()


@dataclass(frozen=True)
class Uncompared:
    """The answers of an engine that are held against no budget.

    Attributes
    ----------
    ref, motion : Reference, Motion
    terms : sequence of Term
        What the engine adds.
    """

    ref: Reference
    motion: Motion
    terms: Sequence[Term] = ()

    @cached_property
    def asked(self) -> Any:
        """At which times (T,) they are."""
        return uncompared(self.ref, self.motion, self.terms)

    @cached_property
    def without_rates(self) -> Any:
        """At which times (T,) the reference has a pose in which there may be no rates."""
        return times_with(self.ref.motion, Status.SINGULAR) | times_with(self.ref.motion, Status.LOCKED)

    @cached_property
    def system(self) -> System:
        """The equations in whose form the engine leaves a residual."""
        system, form = self.ref.system, next((term.form for term in self.terms if term.form), "")
        return compile_system(in_form(system.mechanism, form), unit=system.unit) if form else system

    def numberless(self) -> Iterator[dict[str, Any]]:
        """Yield where one has no number; rates where there are none need none."""
        for order, (quantity, level) in enumerate(zip(QUANTITIES, self.motion.levels, strict=True)):
            here = self.asked & ~self.without_rates if order else self.asked
            nothing = here & (False if level is None else ~np.isfinite(level).all(axis=0))
            if nothing.any():
                yield _at(self.motion, nothing, quantity, Cause.NO_NUMBER)

    def unclosed(self) -> Iterator[dict[str, Any]]:
        """Yield where a pose leaves more of a joint than rounding does, and what the engine adds."""
        wrong_at = self.asked & np.isfinite(self.motion.q).all(axis=0) & ~self.closed
        if wrong_at.any():
            yield _at(self.motion, wrong_at, QUANTITIES[0], Cause.UNCLOSED)

    @cached_property
    def closed(self) -> Any:
        """At which times (T,) a pose is closed."""
        closed = self.asked & np.isfinite(self.motion.q).all(axis=0)
        t = self.motion.t[closed]
        if t.size:
            whole = whole_poses(self.ref.system, self.motion, closed, self.ref.levels[0][:, closed])
            q = np.nan_to_num(whole, nan=1.0)
            system = self.system.held_at(q)  # no spin violates anything
            rows, still = rows_among(system, whole), 0.0 * q
            rounding = output_rounding(system, q, still, still, t)[0]
            rounded = np.einsum("mnt,nt->mt", np.abs(system.phi_q(q, t)), rounding)
            formulas = residual_error(system, q, t)
            off = formulas + table_error(system, Times(t, 0), 0)
            allowed = off + rounded + self._added(formulas)
            closed[closed] = np.all((np.abs(system.phi(q, t)) <= allowed)[rows], axis=0)
        return closed

    def _added(self, formulas: Any) -> Any:
        """Return what the engine leaves of the residual by its own doing, where the formulas leave so much."""
        return sum(term.absolute + term.relative * formulas for term in self.terms if term.level == QUANTITIES[0])

    def opening(self) -> Iterator[dict[str, Any]]:
        """Yield where rates of a closed pose leave more of their equations than rounding and the engine do."""
        for order, quantity in enumerate(QUANTITIES[1:], 1):
            levels = [level for level in self.motion.levels[1 : order + 1] if level is not None]
            if len(levels) < order:
                return
            asked = self.closed & np.isfinite(levels).all(axis=(0, 1))
            asked &= ~(self.without_rates & np.isnan(self.ref.levels[order]).any(axis=0))
            wrong_at = asked & self.opened[order - 1] if asked.any() else asked
            if wrong_at.any():
                yield _at(self.motion, wrong_at, quantity, Cause.UNCLOSED)

    @cached_property
    def opened(self) -> Any:
        """At which times (T,) a closed pose has velocities that open a joint, and at which accelerations, (2, T)."""
        qd, system = np.asarray(self.motion.levels[1]), self.ref.system
        moving = self.closed & np.isfinite(qd).all(axis=0)
        q = whole_poses(system, self.motion, moving, self.ref.levels[0][:, moving])
        q[system.of_bodies :] = np.nan  # no answer has rates of coordinates that joints bring
        known, q = np.isfinite(q).all(axis=1), np.nan_to_num(q, nan=1.0)
        levels = np.nan_to_num(all_levels(system, self.motion)[..., moving], posinf=0.0, neginf=0.0)
        opened = np.zeros((2, len(moving)), bool)
        opened[:, moving] = self._opened(system.held_at(q), self.rows(known), q, levels, self.motion.t[moving])
        return opened

    def rows(self, known: Any) -> Any:
        """Return which rows (m,) say something of the rates of coordinates (n,) that are known."""
        system, missing = self.ref.system, np.flatnonzero(~known[: self.ref.system.of_bodies])
        rows = rows_among(system, np.where(known, 0.0, np.nan)[:, None])
        if missing.size:
            place = parts_of(system)
            rows &= ~np.isin(place.rows, place.coordinates[missing])
        for p in system.placed:
            rows[p.row : p.row + p.constraint.rows] &= not p.constraint.passive
        return rows

    def _opened(self, system: System, rows: Any, q: Any, levels: Any, t: Any) -> list[Any]:
        """Return at which times (K,) velocities open some rows, and at which accelerations do.

        An engine's rows may turn with its joints, y = M phi, and its rates then satisfy not ours, but phi' = -M' phi
        and phi'' = -M'' phi - 2 M' phi': M' is up to `TURNING` times a rate, and phi is what the pose leaves.
        """
        place, opened = parts_of(system), []
        qd, qdd = (system.to_unit(level, k) for k, level in enumerate(levels[1:], 1))
        rounding, slope = output_rounding(system, q, qd, qdd, t), system.phi_q(q, t)
        rate, bend = (by_part(largest, x, place.coordinates, place.rows) for x in (qd, qdd))
        joint, bent = (by_part(largest, x, place.coordinates, place.rows) for x in at_joints(system, q, qd, qdd))
        at_joint = joint, bent + joint**2
        left = by_part(largest, np.where(rows[:, None], system.phi(q, t), 0.0), place.rows, place.rows)
        turned = _turned(rate, bend, left)
        for order, own in enumerate(rate_rows(system, q, qd, qdd, t, rounding), 1):
            allowed = own.error + np.einsum("mnt,nt->mt", np.abs(slope), rounding[order])
            allowed += by_part(solve_error, own.size, place.rows, place.rows) + turned[order]
            for term in (term for term in self.terms if term.level == QUANTITIES[order]):
                allowed += term.absolute + term.relative * own.size + term.of_rates * at_joint[order - 1]
            beyond = np.abs(own.left) > allowed + _contradiction(slope, own.right, rows)
            opened.append(beyond[rows].any(axis=0))
        return opened

    def elsewhere(self) -> Iterator[dict[str, Any]]:
        """Yield where a pose is closed, but further from the reference's than its residual can take it.

        At a fold that is far along the one way, the root of the residual, and near along all others (`least_error`):
        so loops that are regular there are held as everywhere. Either side may be off by as much. A coordinate that is
        free there is not held, nor is one of a pose that the reference calls locked, or has lost: other branches are
        as good.
        """
        ref, motion = self.ref, self.motion
        known = times_with(ref.motion, Status.OK) | times_with(ref.motion, Status.SINGULAR)
        places = np.flatnonzero(self.closed & known)
        if not places.size:
            return
        theirs, ours = scaled(ref, motion.bodies, {0: motion.q})
        off = np.abs(difference(ref.system, theirs[0], ours[0], 0))[:, places]
        allowed = np.array([self._allowed(k) for k in places.tolist()]).T[rows_of(ref.system, motion.bodies)]
        ratio = np.where(allowed < TOO_WIDE, off / allowed, 0.0)
        row, k = np.unravel_index(np.argmax(ratio), ratio.shape)
        if ratio[row, k] > 1.0:
            names = [f"{body}.{coordinate}" for body in motion.bodies for coordinate in ref.system.kind.coordinates]
            wrong_at = np.isin(np.arange(len(motion.t)), places[(ratio > 1.0).any(axis=0)])
            seen = {"ratio": short(float(ratio[row, k])), "at": At(names[row], float(motion.t[places[k]]))}
            yield {**_at(motion, wrong_at, QUANTITIES[0], Cause.OTHER_ASSEMBLY), **seen}

    def _allowed(self, k: int) -> Any:
        """Return how far poses of the engine and of the reference, the k-th, may be apart, (n,)."""
        q, t = self.ref.levels[0][:, k], float(self.ref.motion.t[k])
        formulas = residual_error(self.system, q[:, None], self.ref.motion.t[[k]])[:, 0]
        return allowed_at(self.system, q, t, self._added(formulas)) + allowed_at(self.ref.system, q, t)


def opened_beside(
    ref: Reference, motion: Motion, terms: Sequence[Term], compared: Comparison
) -> Iterator[dict[str, Any]]:
    """Yield where an answer is within its budget beside a singular pose, but opens a joint by more than rounding does.

    Its rates are held at its own pose. They may be those of any pose within the budget, as of Newton's last but one.

    Parameters
    ----------
    ref, motion, terms
        As for `Uncompared`.
    compared : Comparison
        The answer's.
    """
    held = [compared.quantities[q] for q in takewhile(compared.quantities.__contains__, QUANTITIES)]
    here = (ref.sigma_min <= BESIDE) & np.all([quantity.ratio <= 1.0 for quantity in held], axis=0)
    if not here.any():
        return
    off = [np.nan_to_num(quantity.difference[:, here]) for quantity in held]
    known = np.zeros(ref.system.n, bool)
    known[: ref.system.of_bodies] = np.isfinite(held[0].difference[:, here]).all(axis=1)
    rows = Uncompared(ref, motion, terms).rows(known)
    levels = [level[:, here] for level in ref.levels[: len(held)]]
    for level, more in zip(levels, off, strict=True):
        level[: ref.system.of_bodies] += more
    for quantity, beyond in zip(QUANTITIES, _beyond(ref, levels, here, terms, compared), strict=False):
        wrong_at = here.copy()
        wrong_at[here] = beyond[rows].any(axis=0)
        if wrong_at.any():
            yield _at(motion, wrong_at, quantity, Cause.UNCLOSED)


def _beyond(
    ref: Reference, levels: Sequence[Any], here: Any, terms: Sequence[Term], compared: Comparison
) -> Iterator[Any]:
    """Yield in which rows (m, K) levels (n, K) leave more than rounding, the engine, and a pose and rates do.

    That is any pose, and any rates, within the budget: two of them are up to twice as far apart as each is off. What
    that does is the answer's own: of rates of 0.07 that are off by 500 it is far more than the reference's.
    """
    carry, t, off = ref.propagation, ref.motion.t[here], [level[:, here] for level in compared.budget.levels]
    k = np.searchsorted(carry.samples, np.flatnonzero(here))
    system: Any = ref.system.held_at(levels[0])  # no spin violates anything
    q, qd, qdd = (*levels, *(level[:, here] for level in ref.levels[len(levels) :]))
    s, further, coriolis = map(np.abs, slopes(system, q, qd, qdd, t)[1:])
    slope, mechanism = system.phi_q(levels[0], t), system.mechanism
    others = [term for term in terms if in_form(mechanism, term.form) is not mechanism]
    left_in = sum((_left_in(system, term, levels[0], slope, t) for term in others), np.zeros(1))
    turned = _turned(np.max(np.abs(qd), axis=0), np.max(np.abs(qdd), axis=0), left_in)
    for order, (level, moved) in enumerate(zip(levels, ((), (s,), (further, coriolis)), strict=False)):
        left = (system.phi, system.nu, system.gamma)[order](*levels[: max(order, 1)], t)
        allowed = carry.of_rows[order][:, k] + turned[order]
        if order:
            left = left - times(slope, level)
            allowed = allowed + solve_error(times(np.abs(slope), off[order]))  # what is off is solved for, too
        for term in (term for term in terms if term.level == QUANTITIES[order] and term not in others):
            of_rates = term.of_rates * largest(carry.rates[order][:, k])
            allowed = allowed + term.absolute + term.relative * carry.size[order][:, k] + of_rates
        for by, of in zip(moved, off, strict=False):
            allowed = allowed + 2.0 * np.einsum("kmn,nk->mk", by, of)
        yield np.abs(left) > carry.weights * allowed


def _left_in(system: System, term: Term, q: Any, slope: Any, t: Any) -> Any:
    """Return what a residual of the position in rows of another form is in ours, (m, K): they are linear in those."""
    other = compile_system(in_form(system.mechanism, term.form), unit=system.unit).held_at(q).phi_q(q, t)
    ours, theirs = (np.moveaxis(x, -1, 0) for x in (slope, other))
    return term.absolute * np.sum(np.abs(ours @ np.linalg.pinv(theirs)), axis=2).T


def _turned(rate: Any, bend: Any, left: Any) -> tuple[Any, Any, Any]:
    """Return what rows that turn as joints do, M phi, leave of ours and their rates (`Uncompared._opened`)."""
    return left, TURNING * rate * left, TURNING * (1.0 + 2.0 * TURNING) * (bend + rate**2) * left


def _contradiction(slope: Any, right: Any, rows: Any) -> Any:
    """Return what no rates solve (T,) of redundant rows, some of all: least squares with weights of 1/2 to 2 leave it.

    An engine's rows are ours times as much (`Propagation.weights`), so that it leaves at most four times as much as the
    least, in the two-norm.
    """
    m, n, count = slope.shape
    if m == n:
        return np.zeros(count)
    u, s, _ = np.linalg.svd(np.moveaxis(slope[rows], -1, 0), full_matrices=False)
    u = u * (s > m * np.finfo(float).eps * s[:, :1])[:, None]
    right = right[rows].T[..., None]
    return 4.0 * np.linalg.norm(right - u @ (u.swapaxes(1, 2) @ right), axis=(1, 2))


def believed(ref: Reference, motion: Motion) -> Iterator[dict[str, Any]]:
    """Yield where an engine says ok and there is nothing: no assembly, no rates in a singular pose or a locked one.

    Only to be asked where the reference's verdict is the one that the scene was made for.
    """
    ok = times_with(motion, Status.OK)
    nowhere = times_with(ref.motion, Status.UNASSEMBLABLE) & ok
    if nowhere.any():
        yield _at(motion, nowhere, QUANTITIES[0], Cause.NO_ASSEMBLY)
    for status, kind in ((Status.SINGULAR, Cause.SINGULAR_RATES), (Status.LOCKED, Cause.LOCKED_RATES)):
        there = times_with(ref.motion, status) & ok
        if not there.any():
            continue
        for order, quantity in enumerate(QUANTITIES[1:], 1):
            level, none = motion.levels[order], np.isnan(ref.levels[order]).any(axis=0)
            rated = there & none & (False if level is None else np.isfinite(level).any(axis=0))
            if rated.any():
                yield _at(motion, rated, quantity, kind)


def put_together_wrongly(scene: Scene, motion: Motion) -> tuple[list[dict[str, Any]], Any]:
    """Return joints and drivers of space that an answer called ok has the wrong way round, and at which times (T,).

    Dot products of axes, and sin(theta - f), are zero there too: closed equations, and no assembly.
    """
    ok, rows, wrong_at = times_with(motion, Status.OK), list[dict[str, Any]](), np.zeros(len(motion.t), bool)
    spatial = scene.mechanism.kind.name == "spatial"
    for name, samples in reversed_joints(scene.mechanism, motion).items() if spatial else ():
        here = ok & samples
        wrong_at |= here
        if here.any():
            row = _at(motion, here, QUANTITIES[0], Cause.REVERSED)
            rows.append({**row, "message": f"{name!r}: {row['message']}"})
    return rows, wrong_at


def _at(motion: Motion, samples: Any, quantity: str, kind: Cause) -> dict[str, Any]:
    return wrong(quantity, kind, f"{int(samples.sum())} times, first t = {motion.t[samples][0]:.17g}")
