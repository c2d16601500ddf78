"""What an answer owes where it says ok and no budget holds: numbers, closed joints, no rates where there are none.

In and next to a singular pose an error has no first-order bound, and where the reference is lost or locked there is
nothing to compare with: an engine may go on there, on any branch. A residual has a bound everywhere: rounding leaves as
little of it as anywhere. So joints are asked, those between the bodies that an answer has: by its pose, and by its
rates at that pose. Rows with a coordinate of their own, whose rates no answer has, say nothing of rates; nor do those
of a part with a body that an answer has not: its rates may be the largest, of which the others are rounded.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from typing import Any

import numpy as np

from crosscheck.engines import Term
from crosscheck.judge.budget import times_with
from crosscheck.judge.comparison import Reference, difference, rows_of, scaled, uncompared, whole_poses
from crosscheck.judge.hard_poses import TOO_WIDE, allowed_at
from crosscheck.judge.parts import by_part, parts_of
from crosscheck.judge.poses import all_levels, rows_among
from crosscheck.judge.records import QUANTITIES, At, Cause, wrong
from crosscheck.judge.rounding import largest, output_rounding, rate_rows, residual_error, solve_error, table_error
from crosscheck.judge.samples import short
from crosscheck.judge.spatial import reversed_joints
from refkin.model import Scene
from refkin.motion import Motion, Status
from refkin.proof.numbers.bounded import Times
from refkin.solving.starts import in_form
from refkin.system import System, compile_system

TURNING = 8.0
"""Two bodies turn a row of three, in space with 2 |p'| each: 2 * 2 * sqrt(3), rounded up."""


def uncompared_faults(ref: Reference, motion: Motion, terms: Sequence[Term] = ()) -> Iterator[dict[str, Any]]:
    """Yield all that is wrong with uncompared answers by themselves, but rates that there are not (`believed`).

    Parameters
    ----------
    ref, motion, terms
        As for `uncompared`.
    """
    for asked in (numberless, unclosed, opening, elsewhere):
        yield from asked(ref, motion, terms)


def numberless(ref: Reference, motion: Motion, terms: Sequence[Term] = ()) -> Iterator[dict[str, Any]]:
    """Yield where an uncompared answer has no number; rates where there are none need none.

    Parameters
    ----------
    ref, motion, terms
        As for `uncompared`.
    """
    asked, without_rates = uncompared(ref, motion, terms), _without_rates(ref)
    for order, (quantity, level) in enumerate(zip(QUANTITIES, motion.levels, strict=True)):
        here = asked & ~without_rates if order else asked
        nothing = here & (False if level is None else ~np.isfinite(level).all(axis=0))
        if nothing.any():
            yield _at(motion, nothing, quantity, Cause.NO_NUMBER)


def unclosed(ref: Reference, motion: Motion, terms: Sequence[Term] = ()) -> Iterator[dict[str, Any]]:
    """Yield where an uncompared pose leaves more of a joint than rounding does, and what the engine adds.

    Parameters
    ----------
    ref, motion, terms
        As for `uncompared`.
    """
    wrong_at = _closed(ref, motion, terms)[1]
    if wrong_at.any():
        yield _at(motion, wrong_at, QUANTITIES[0], Cause.UNCLOSED)


def _closed(ref: Reference, motion: Motion, terms: Sequence[Term]) -> tuple[Any, Any]:
    """Return at which times (T,) an uncompared pose is closed, and at which it is not."""
    asked = uncompared(ref, motion, terms) & np.isfinite(motion.q).all(axis=0)
    t, closed = motion.t[asked], asked.copy()
    if t.size:
        whole = whole_poses(ref.system, motion, asked, ref.levels[0][:, asked])
        q = np.nan_to_num(whole, nan=1.0)
        system = _system(ref, terms).held_at(q)  # no spin violates anything
        rows = rows_among(system, whole)
        rounded = np.einsum("mnt,nt->mt", np.abs(system.phi_q(q, t)), output_rounding(system, q, 0.0 * q, 0.0 * q)[0])
        formulas = residual_error(system, q, t)
        off = formulas + table_error(system, Times(t, 0), 0)
        added = _added(terms, formulas)
        closed[asked] = np.all((np.abs(system.phi(q, t)) <= off + rounded + added)[rows], axis=0)
    return closed, asked & ~closed


def opening(ref: Reference, motion: Motion, terms: Sequence[Term] = ()) -> Iterator[dict[str, Any]]:
    """Yield where rates of a closed uncompared pose leave more of their equations than rounding and the engine do.

    Parameters
    ----------
    ref, motion, terms
        As for `uncompared`.
    """
    closed, none = _closed(ref, motion, terms)[0], _without_rates(ref)
    for order, quantity in enumerate(QUANTITIES[1:], 1):
        levels = [level for level in motion.levels[1 : order + 1] if level is not None]
        if len(levels) < order:
            return
        asked = closed & np.isfinite(levels).all(axis=(0, 1))
        asked &= ~(none & np.isnan(ref.levels[order]).any(axis=0))
        if asked.any():
            asked[asked] = _opened(ref, motion, terms, asked, order)
            if asked.any():
                yield _at(motion, asked, quantity, Cause.UNCLOSED)


def _opened(ref: Reference, motion: Motion, terms: Sequence[Term], asked: Any, order: int) -> Any:
    """Return at which of some times the rates of a level open a joint.

    An engine's rows may turn with its joints, y = M phi, and its rates then satisfy not ours, but phi' = -M' phi and
    phi'' = -M'' phi - 2 M' phi': M' is up to `TURNING` times a rate, and phi is what the pose leaves.
    """
    t, place = motion.t[asked], parts_of(ref.system)
    q, bodies = whole_poses(ref.system, motion, asked, ref.levels[0][:, asked]), ref.system.of_bodies
    q[bodies:] = np.nan
    lacking = place.coordinates[:bodies][np.isnan(q[:bodies]).any(axis=1)]
    rows = rows_among(ref.system, q) & ~np.isin(place.rows, lacking)
    q = np.nan_to_num(q, nan=1.0)
    system = ref.system.held_at(q)
    for p in system.placed:
        rows[p.row : p.row + p.constraint.rows] &= not p.constraint.passive
    qd, qdd = (system.to_unit(level[:, asked], k) for k, level in enumerate(all_levels(system, motion)[1:], 1))
    rounding, slope = output_rounding(system, q, qd, qdd), system.phi_q(q, t)
    own = rate_rows(system, q, qd, qdd, t, rounding)[order - 1]
    rate, bend = (by_part(largest, x, place.coordinates, place.rows) for x in (qd, qdd))
    rates, left = (rate, bend + rate**2)[order - 1], np.where(rows[:, None], system.phi(q, t), 0.0)
    allowed = own.error + np.einsum("mnt,nt->mt", np.abs(slope), rounding[order])
    allowed += by_part(solve_error, own.size, place.rows, place.rows)
    turned = TURNING * (1.0, 1.0 + 2.0 * TURNING)[order - 1] * rates
    allowed += turned * by_part(largest, left, place.rows, place.rows)
    for term in (term for term in terms if term.level == QUANTITIES[order]):
        allowed += term.absolute + term.relative * own.size + term.of_rates * rates
    return (np.abs(own.left) > allowed + _contradiction(slope, own.right, rows))[rows].any(axis=0)


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


def _without_rates(ref: Reference) -> Any:
    """Return at which times (T,) the reference has a pose in which there may be no rates."""
    return times_with(ref.motion, Status.SINGULAR) | times_with(ref.motion, Status.LOCKED)


def _added(terms: Sequence[Term], formulas: Any) -> Any:
    """Return what an engine leaves of the residual by its own doing, where the formulas leave so much."""
    return sum(term.absolute + term.relative * formulas for term in terms if term.level == QUANTITIES[0])


def elsewhere(ref: Reference, motion: Motion, terms: Sequence[Term] = ()) -> Iterator[dict[str, Any]]:
    """Yield where an uncompared pose is closed, but further from the reference's than its residual can take it.

    At a fold that is far along the one way, the root of the residual, and near along all others (`least_error`): so
    loops that are regular there are held as everywhere. Either side may be off by as much. A coordinate that is free
    there is not held, nor is one of a pose that the reference calls locked, or has lost: other branches are as good.

    Parameters
    ----------
    ref, motion, terms
        As for `uncompared`.
    """
    known = times_with(ref.motion, Status.OK) | times_with(ref.motion, Status.SINGULAR)
    places = np.flatnonzero(_closed(ref, motion, terms)[0] & known)
    if not places.size:
        return
    theirs, ours = scaled(ref, motion.bodies, {0: motion.q})
    off = np.abs(difference(ref.system, theirs[0], ours[0], 0))[:, places]
    allowed = np.array([_allowed(ref, terms, k) for k in places.tolist()]).T[rows_of(ref.system, motion.bodies)]
    ratio = np.where(allowed < TOO_WIDE, off / allowed, 0.0)
    row, k = np.unravel_index(np.argmax(ratio), ratio.shape)
    if ratio[row, k] > 1.0:
        names = [f"{body}.{coordinate}" for body in motion.bodies for coordinate in ref.system.kind.coordinates]
        wrong_at = np.isin(np.arange(len(motion.t)), places[(ratio > 1.0).any(axis=0)])
        seen = {"ratio": short(float(ratio[row, k])), "at": At(names[row], float(motion.t[places[k]]))}
        yield {**_at(motion, wrong_at, QUANTITIES[0], Cause.OTHER_ASSEMBLY), **seen}


def _allowed(ref: Reference, terms: Sequence[Term], k: int) -> Any:
    """Return how far poses of the engine and of the reference, the k-th, may be apart, (n,)."""
    system, q, t = _system(ref, terms), ref.levels[0][:, k], float(ref.motion.t[k])
    formulas = residual_error(system, q[:, None], ref.motion.t[[k]])[:, 0]
    return allowed_at(system, q, t, _added(terms, formulas)) + allowed_at(ref.system, q, t)


def _system(ref: Reference, terms: Sequence[Term]) -> System:
    """Return the equations in whose form the engine leaves a residual."""
    form = next((term.form for term in terms if term.form), "")
    return compile_system(in_form(ref.system.mechanism, form), unit=ref.system.unit) if form else ref.system


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
