"""Points of bodies that a scene wants: held against the reference's, within what their bodies may be off.

A point at u on a body is at r + A u. To first order it is off by what the body's origin is off, and by |u| times what
the body is turned too far; its rates by those of the two, and by what moves them (w and alpha: how the body turns):

    position      dr + |u| dt
    velocity      dv + |u| (dw + w dt)
    acceleration  da + |u| (dalpha + alpha dt + 2 w dw + w^2 dt)

In the plane dt, dw and dalpha are the errors of phi and its rates. In space w = 2 E p', so that dt = 2 |dp|,
dw = 2 (|dp'| + |p'| |dp|), dalpha = 2 (|dp''| + |p''| |dp|). To compose a point rounds once more.
"""

from __future__ import annotations

import math
from collections.abc import Collection, Iterator, Sequence
from typing import Any

import numpy as np

from crosscheck.engines import Term, is_plain
from crosscheck.judge.budget import times_with
from crosscheck.judge.comparison import Comparison, Reference, uncompared
from crosscheck.judge.poses import all_levels
from crosscheck.judge.records import QUANTITIES, At, Cause, wrong
from crosscheck.judge.rounding import output_rounding
from crosscheck.judge.running_error import U
from crosscheck.judge.samples import largest_ratio
from refkin.motion import Motion, PointMotion, Status, point_motion
from refkin.system import System

ROUNDINGS = 32.0
"""Of a point, in both answers: a sine or cosine, products and sums, of rates the squares of turns as well."""
LEVELS = dict(zip(QUANTITIES, ("r", "v", "a"), strict=True))
"""Where a point's motion has each quantity."""


def points_off(
    ref: Reference, motion: Motion, able: Collection[str], terms: Sequence[Term], compared: Comparison
) -> Iterator[dict[str, Any]]:
    """Yield the points that a motion lacks, or has further off than their bodies may be, as disagreements.

    Who gives no points at all is not asked for them. Of a quantity of bodies that is beyond its bounds that is said,
    and points add nothing. Where a point of a body that spins as it likes is depends on the spin: it is held
    against the answer's own body, as all are where nothing is compared.

    Parameters
    ----------
    ref, motion : Reference, Motion
    able : collection of str
        The quantities that its method owes.
    terms : sequence of Term
        What the engine adds.
    compared : Comparison
        The same answer's bodies.
    """
    if not motion.points:
        return
    budget, judged, apart = compared.budget, times_with(motion, Status.OK), uncompared(ref, motion, terms)
    owed = [quantity for quantity in LEVELS if quantity in able and quantity in compared.quantities]
    agreeing = [quantity for quantity in owed if compared.quantities[quantity].agrees]
    whole = [q for k, q in enumerate(LEVELS) if all(level is not None for level in motion.levels[: k + 1])]
    spinning, own = {body for spin in ref.passive for body in spin}, all_levels(ref.system, motion)
    scaled = [ref.system.to_unit(level, order) for order, level in enumerate(own)]
    q, qd, qdd = np.nan_to_num(scaled)
    rounding = output_rounding(ref.system, q, qd, qdd, motion.t)
    for point in ref.scene.points:
        theirs, ours = motion.points.get(point.name), ref.motion.points[point.name]
        given: dict[str, Any] = {q: getattr(theirs, LEVELS[q], None) for q in owed}
        shaped = [q for q in owed if is_plain(given[q], "f") and given[q].shape == ours.r.shape]
        for quantity in owed:
            if quantity not in shaped:
                expected = f"point {point.name!r}: expected an array of floats of shape {ours.r.shape}"
                yield wrong(quantity, Cause.NOT_DELIVERED, expected)
        composed = point_motion(point.position, *(level[ref.system.columns(point.body)] for level in own))
        of_own = [q for q in shaped if q in whole and point.body in motion.bodies]
        spins = point.body in spinning
        true, levels, asked = (composed, scaled, of_own) if spins else (ours, ref.levels, shaped)
        allowed = _allowed(ref.system, budget.levels, levels, point, true)
        asked = [q for q in asked if q in agreeing]
        yield from _further(motion, point.name, true, allowed, asked, budget.compared & judged)
        allowed = _allowed(ref.system, rounding, scaled, point, composed)
        yield from _further(motion, point.name, composed, allowed, of_own, apart)


def _further(
    motion: Motion, name: str, true: PointMotion, allowed: Sequence[Any], asked: Sequence[str], samples: Any
) -> Iterator[dict[str, Any]]:
    """Yield the quantities in which a point is further off than is allowed; where both have no number it is not."""
    for (quantity, letter), most in zip(LEVELS.items(), allowed, strict=True):
        if quantity not in asked or not samples.any():
            continue
        pair = [getattr(point, letter)[:, samples] for point in (motion.points[name], true)]
        parts = np.where(np.isnan(pair).all(axis=0), 0.0, np.abs(pair[0] - pair[1]))
        off = np.max(parts, axis=0)
        with np.errstate(divide="ignore", invalid="ignore"):
            ratio = np.where(np.isfinite(off), off / most[samples], np.inf)
        ratio[off == 0.0] = 0.0  # at rest nothing is allowed, and nothing is off
        k = int(np.argmax(ratio))
        if ratio[k] > 1.0:
            at = At(f"{name}.{motion.kind.coordinates[int(np.argmax(parts[:, k]))]}", float(motion.t[samples][k]))
            where = f"by {off[k]:.3g} at t = {at.time:.17g}, {ratio[k]:.3g} times the allowed"
            message = f"point {name!r} is off {where}"
            yield {**wrong(quantity, Cause.BEYOND, message), "ratio": largest_ratio(ratio), "at": at}


def _allowed(system: System, errors: Any, levels: Any, point: Any, ours: PointMotion) -> list[Any]:
    """Return how far a point may be off in position, velocity and acceleration, (T,) each [m, s]."""
    size, arm = system.unit.size, math.hypot(*point.position)
    columns, d = system.columns(point.body), system.kind.dimension
    (dr, dv, da), (dt, dw, dalpha), (_, w, alpha) = (
        [np.linalg.norm(level[columns][part], axis=0) for level in of]
        for of, part in ((errors, slice(d)), (errors, slice(d, None)), (levels, slice(d, None)))
    )
    if system.kind.name == "spatial":
        w, alpha, dw, dalpha, dt = 2 * w, 2 * alpha, 2 * (dw + w * dt), 2 * (dalpha + alpha * dt), 2 * dt
    turning = [1.0, w, alpha + w**2]
    composed = [dt, dw + w * dt, dalpha + alpha * dt + 2 * w * dw + w**2 * dt]
    largest = [np.max(np.abs(getattr(ours, letter)), axis=0) for letter in LEVELS.values()]
    return [
        size * linear + arm * turn + ROUNDINGS * U * (place + arm * rate)
        for linear, turn, place, rate in zip((dr, dv, da), composed, largest, turning, strict=True)
    ]
