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

from crosscheck.engines import Term
from crosscheck.judge.budget import times_with
from crosscheck.judge.comparison import Comparison, Reference
from crosscheck.judge.records import QUANTITIES, Cause, wrong
from crosscheck.judge.running_error import U
from refkin.motion import Motion, Status

ROUNDINGS = 32.0
"""Of a point, in both answers: a sine or cosine, products and sums, of rates the squares of turns as well."""
LEVELS = dict(zip(QUANTITIES, ("r", "v", "a"), strict=True))
"""Where a point's motion has each quantity."""


def points_off(
    ref: Reference, motion: Motion, able: Collection[str], terms: Sequence[Term], compared: Comparison
) -> Iterator[dict[str, Any]]:
    """Yield the points that a motion lacks, or has further off than their bodies may be, as disagreements.

    Who gives no points at all is not asked for them. Of a quantity of bodies that is beyond its bounds that is said,
    and points add nothing. A point of a body that spins as it likes is not compared: where it is depends on the spin.

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
    budget = ref.budget(terms)
    samples = budget.compared & times_with(motion, Status.OK)
    spinning = {body for spin in ref.passive for body in spin}
    for point in ref.scene.points:
        theirs, ours = motion.points.get(point.name), ref.motion.points[point.name]
        allowed = _allowed(ref, budget.levels, point, ours)
        for (quantity, letter), most in zip(LEVELS.items(), allowed, strict=True):
            of_bodies = compared.quantities.get(quantity)
            if of_bodies is None or quantity not in able:
                continue
            own, true = getattr(theirs, letter, None), getattr(ours, letter)
            if own is None or np.shape(own) != np.shape(true):
                yield wrong(quantity, Cause.NOT_DELIVERED, f"point {point.name!r}: expected shape {np.shape(true)}")
            elif of_bodies.agrees and samples.any() and point.body not in spinning:
                off = np.max(np.abs(own - true)[:, samples], axis=0)
                with np.errstate(divide="ignore", invalid="ignore"):
                    ratio = np.where(np.isfinite(off), off, np.inf) / most[samples]
                ratio[off == 0.0] = 0.0  # at rest nothing is allowed, and nothing is off
                k = int(np.argmax(ratio))
                if ratio[k] > 1.0:
                    where = f"by {off[k]:.3g} at t = {motion.t[samples][k]:.17g}, {ratio[k]:.3g} times the allowed"
                    yield wrong(quantity, Cause.BEYOND, f"point {point.name!r} is off {where}")


def _allowed(ref: Reference, levels: Any, point: Any, ours: Any) -> list[Any]:
    """Return how far a point may be off in position, velocity and acceleration, (T,) each [m, s]."""
    system, size, arm = ref.system, ref.system.unit.size, math.hypot(*point.position)
    columns, d = system.columns(point.body), system.kind.dimension
    (dr, dv, da), (dt, dw, dalpha), (_, w, alpha) = (
        [np.linalg.norm(level[columns][part], axis=0) for level in of]
        for of, part in ((levels, slice(d)), (levels, slice(d, None)), (ref.levels, slice(d, None)))
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
