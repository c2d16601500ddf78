"""Which constraints an answer violates: the joint that a wrong answer does not satisfy, level by level.

At the answer's own coordinates: position by phi(q, t), velocity by phi_q qd - nu, acceleration by phi_q qdd - gamma. An
engine that takes one joint for another satisfies all the others; one that leaves a term out satisfies all equations
below that level.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np

from crosscheck.judge.comparison import Reference, difference
from refkin.motion import Motion

SHARE = 0.02
"""A row with so much of the largest residual is named with it."""
MOST = 3
"""Joints that are named."""


@dataclass(frozen=True)
class Violation:
    """What an answer violates: constraints by name, the most violated first; and the same in words."""

    names: tuple[str, ...] = ()
    text: str = ""


NOT_KNOWN = Violation()


def violations(ref: Reference, motion: Motion, order: int, t: float) -> Violation:
    """Return which joints and drivers an answer violates at a time; `NOT_KNOWN` if it has not all bodies or numbers.

    Parameters
    ----------
    ref : Reference
    motion : Motion
        An answer in metres and radians, its bodies in any order.
    order : {0, 1, 2}
        Position, velocity or acceleration.
    t : float
        One of its times [s].
    """
    residual = _residual(ref, motion, order, t)
    if residual is None:
        return NOT_KNOWN
    for placed in ref.system.placed:
        if placed.constraint.passive:  # a row of the reference's own: each answer ends on a spin of its own
            residual[placed.row : placed.row + placed.constraint.rows] = 0.0
    worst = float(np.max(np.abs(residual)))
    if not np.isfinite(worst):  # the numbers are too large for their equations
        return NOT_KNOWN
    if np.all(np.abs(residual) <= ref.propagation.left(order, t)):
        other = "is it put together another way?" if order == 0 else "does its position belong to another pose?"
        return Violation((), f"every joint and driver is satisfied there to rounding: {other}")
    largest, words = {}, {}
    for placed in ref.system.placed:
        c = placed.constraint
        if c.passive:  # it has the name of its body, as the length of the Euler parameters has
            continue
        largest[c.name] = float(np.max(np.abs(residual[placed.row : placed.row + c.rows])))
        words[c.name] = f"{'driver' if c in ref.scene.mechanism.drivers else 'joint'} {c.name!r} ({c.type})"
    names = sorted((name for name in largest if largest[name] >= SHARE * worst), key=lambda name: -largest[name])
    listed = ", ".join(words[name] for name in names[:MOST])
    more = f" and {len(names) - MOST} more" if len(names) > MOST else ""
    what = ("", "velocity of ", "acceleration of ")[order]
    return Violation(tuple(names), f"it violates the {what}{listed}{more}: scaled residual {worst:.2g}")


def _residual(ref: Reference, motion: Motion, order: int, t: float) -> Any:
    """Return the residual (m,) of a level at a time; None if there is no number."""
    names = [body.name for body in ref.scene.mechanism.bodies]
    if set(names) - set(motion.bodies):
        return None
    theirs, ours = (int(np.flatnonzero(m.t == t)[0]) for m in (motion, ref.motion))
    width, of_bodies = len(motion.q) // len(motion.bodies), ref.system.of_bodies
    rows = np.concatenate([np.arange(width) + width * motion.bodies.index(name) for name in names])
    state = []
    for k, level in enumerate(motion.levels[: order + 1]):
        if level is None or not np.isfinite(level[:, theirs]).all():
            return None
        bodies, contacts = np.split(ref.levels[k][:, ours], [of_bodies])  # an answer has no contacts: the reference's
        off = difference(ref.system, ref.system.to_unit(level[rows, theirs], k), bodies, k)
        state.append(np.concatenate([bodies + off, contacts]))  # the reference's turns: drivers count them
    if order == 0:
        return ref.system.phi(state[0], t)
    right = ref.system.nu(state[0], t) if order == 1 else ref.system.gamma(state[0], state[1], t)
    return ref.system.phi_q(state[0], t) @ state[order] - right
