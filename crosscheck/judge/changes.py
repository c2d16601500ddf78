"""How much one answer differs from another to the same scene."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from crosscheck.engines import QUANTITIES, Term
from crosscheck.judge.comparison import Reference, difference, scaled
from refkin.motion import Motion


@dataclass(frozen=True)
class Change:
    """The largest change of what two answers both have, and where it is; `worst` is empty if nothing changed.

    `inert`: it is none, not a bit if that was asked for, else nothing above the allowed error. `largest` is relative,
    of positions to the mechanism's size (rad for angles), of rates to the largest one at that time.
    """

    inert: bool
    largest: float
    worst: str


def change(ref: Reference, off: Motion, on: Motion, terms: Sequence[Term] = (), *, exact: bool) -> Change:
    """Return the change from one answer to another.

    Parameters
    ----------
    ref : Reference
        What the allowed errors are derived at.
    off, on : Motion
        Without the effect, and with it.
    terms : sequence of Term
        What the engine adds to the allowed error.
    exact : bool
        Whether every bit counts. Otherwise a change is inert up to the error that one of the two answers may have:
        whoever is within it without the effect and further off with it has felt the effect.
    """
    sizes = list(_levels(ref, off, on, terms))
    largest, worst = max(((size, where) for size, _, where in sizes), default=(0.0, ""))
    if off.status != on.status:
        k = next(k for k, (a, b) in enumerate(zip(off.status, on.status, strict=True)) if a is not b)
        return Change(False, largest, f"{off.status[k]} becomes {on.status[k]} at t = {off.t[k]:.17g}")
    inert = same_bits(off, on) if exact else all(ratio <= 1.0 for _, ratio, _ in sizes)
    return Change(inert, largest, worst if largest else "")


def same_bits(off: Motion, on: Motion) -> bool:
    """Return whether everything that two answers both have is equal, bit for bit."""
    pairs = [
        (getattr(off[body], name), getattr(on[body], name))
        for body in off.bodies
        if body in on.bodies
        for name in ("q", "qd", "qdd")
    ]
    pairs += [
        (getattr(off.points[name], level), getattr(on.points[name], level))
        for name in off.points
        if name in on.points
        for level in "rva"
    ]
    pairs.append((off.residual, on.residual))
    return all(np.array_equal(a, b, equal_nan=True) for a, b in pairs if a is not None and b is not None)


def _levels(ref: Reference, off: Motion, on: Motion, terms: Sequence[Term]) -> Iterator[tuple[float, float, str]]:
    """Yield per level that both have the largest relative change, the largest of change / allowed, and where.

    A change where nothing can be allowed to first order, near a singular pose, is beyond what is allowed.
    """
    budget = ref.budget(terms)
    bodies = [body for body in off.bodies if body in on.bodies]
    rows = np.concatenate([np.r_[ref.system.columns(body)] for body in bodies])
    for order, quantity in enumerate(QUANTITIES):
        if off.levels[order] is None or on.levels[order] is None:
            continue
        size = np.abs(_difference(ref, off, on, bodies, order))
        ours = np.nan_to_num(np.max(np.abs(ref.levels[order]), axis=0))
        relative = size / np.where((order == 0) | (ours == 0.0), 1.0, ours)
        allowed = np.where(budget.compared, budget.levels[order][rows], 0.0)
        with np.errstate(divide="ignore", invalid="ignore"):
            ratio = np.where(size == 0.0, 0.0, size / allowed)
        row, sample = (int(k) for k in np.unravel_index(np.argmax(relative), relative.shape))
        body, coordinate = divmod(row, ref.system.kind.width)
        named = f"{bodies[body]}.{ref.system.kind.coordinates[coordinate]}"
        where = f"{quantity} of {named} at t = {off.t[sample]:.17g}"
        yield float(relative[row, sample]), float(np.max(ratio)), where


def _difference(ref: Reference, off: Motion, on: Motion, bodies: Sequence[str], order: int) -> Any:
    """Return on - off of some bodies at one level in scaled coordinates, angles of positions modulo full turns.

    It is 0 where neither has a number, and infinite where one has and the other has not.
    """
    scaled_levels = []
    for motion in (off, on):
        parts = ([motion[body].q, motion[body].qd, motion[body].qdd][: order + 1] for body in bodies)
        levels = [np.concatenate(level) for level in zip(*parts, strict=True)]
        scaled_levels.append(scaled(ref, bodies, dict(enumerate(levels)))[0][order])
    before, after = scaled_levels
    known = np.isfinite(before), np.isfinite(after)
    change = difference(ref.system, after, before, order)
    return np.where(known[0] & known[1], change, np.where(known[0] == known[1], 0.0, np.inf))
