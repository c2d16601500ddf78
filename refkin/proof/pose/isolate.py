"""What is known of an answer: proved by float64 where that is enough, else by balls, else not at all."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field
from typing import Any

import numpy as np
from flint import ctx

from refkin.analysis import sigma_min
from refkin.motion import SINGULAR
from refkin.proof.numbers.inputs import contradiction, rate_contradiction
from refkin.proof.numbers.preconditioned import Nearly
from refkin.proof.numbers.recentred import Recentred, recentred
from refkin.proof.pose.certificate import certify
from refkin.proof.pose.krawczyk import Enclosure, krawczyk, objects
from refkin.system import System

FLOAT64, BITS = 53, 113
BLURRED, BLURRED_RATE = 2.0**-36, 2.0**-26
"""Bounds of errors beyond which balls take over from float64: of a position, and of a rate in units of its size."""
FAR = 64.0
"""Distance of a frame from the joints, in sizes, beyond which they do likewise: errors grow as its square."""
NEAR = 2.0**-10
"""Distance [sizes, rad] up to which a root that a nearly singular pose leads to is its own, and that of another choice
of rows one of the same assembly."""


@dataclass(frozen=True)
class Isolation:
    """Proved error bounds of a batch of poses, largest scaled coordinate, each (B,); NaN where there is no proof.

    Attributes
    ----------
    ok : (B,) array of bool
        Whether the pose is isolated: exactly one solution lies within the bound, in a box that holds q.
    bits : (B,) array of int
        The precision of the proof: 53 float64, more for balls, 0 none.
    position, velocity, acceleration : (B,) array
        Bounds of the errors of q, qd, qdd; a rate that was not given has NaN.
    contradiction : (3, B) array
        Where rows are redundant, the largest |phi| of a row that was not needed, and what such a row misses of velocity
        and of acceleration, in units of what a few roundings of the mechanism's numbers explain: at most 1 is
        consistent. 0 without redundant rows, and for rates that were not given.
    rows : (n,) or (n, B) array of int
        The rows that were certified in float64.
    enclosures : dict
        By sample: the roots that balls enclose, where float64 proved little. They are better than the answers.
    levels : tuple of Nearly
        The solution and its rates, as float64 proves them.
    why : str
        Why there are no bounds of poses that are isolated; empty if there are.
    """

    ok: Any
    bits: Any
    position: Any
    velocity: Any
    acceleration: Any
    contradiction: Any
    rows: Any
    enclosures: dict[int, Enclosure] = field(default_factory=dict)
    levels: tuple[Nearly, ...] = ()
    why: str = ""


def isolate(system: System, q: Any, t: Any, qd: Any = None, qdd: Any = None, *, rows: Any = None) -> Isolation:
    """Prove what can be proved of the poses q (n, B) at the times t (B,) and of their rates.

    Poses are certified in float64, all at once; each for which that fails, or leaves a bound above `BLURRED`, is tried
    by Krawczyk's test with `BITS` bits.

    Parameters
    ----------
    system : System
        Compiled in its mechanism's own unit.
    q, qd, qdd : (n, B) array
        Answers in the system's coordinates; qdd only with qd.
    t : (B,) array
        Times [s].
    rows : (n,) or (n, B) array of int, optional
        The rows to certify where there are more than n, of all poses or of each; by default a maximal independent set
        at the first pose.
    """
    q, t = np.asarray(q, float), np.broadcast_to(np.asarray(t, float), np.shape(q)[1:])
    proof = certify(system, q, t, qd, qdd, rows)
    nothing = np.full(len(t), np.nan)
    isolation = Isolation(
        ok=proof.ok.copy(),
        bits=np.where(proof.ok, FLOAT64, 0),
        position=proof.position,
        velocity=nothing.copy() if proof.velocity is None else np.max(proof.velocity, axis=0),
        acceleration=nothing.copy() if proof.acceleration is None else np.max(proof.acceleration, axis=0),
        contradiction=np.zeros((3, len(t))),
        rows=proof.rows,
        levels=(proof.root, *proof.rates),
    )
    isolation.contradiction[0] = contradiction(system, proof.rows, proof.root, t)
    frames = recentred(system)
    sharp = are_sharp((isolation.position, isolation.velocity, isolation.acceleration), (q, qd, qdd))
    sharp &= frames.furthest <= FAR
    for sample in np.flatnonzero(~sharp & np.isfinite(q).all(axis=0) & np.isfinite(t)):
        enclosure = _root(frames, q[:, sample], t[sample])
        if enclosure is not None:
            levels = [None if x is None else np.asarray(x, float)[:, sample] for x in (q, qd, qdd)]
            _by_balls(isolation, sample, enclosure, levels)
    if qd is not None:
        isolation.contradiction[1:] = rate_contradiction(system, proof.rows, q, t, qdd is not None)
    isolation.ok[np.isnan(isolation.contradiction[0])] = False  # redundant rows were not held against the root
    return isolation


def are_sharp(bounds: Sequence[Any], levels: Sequence[Any]) -> Any:
    """Return at which poses (B,) float64 says enough: its bounds of position and rates are not `BLURRED`.

    `bounds` are proved errors of the largest component, `levels` position and as many rates (n, B) as there are.
    """
    sharp = bounds[0] <= BLURRED
    for bound, rate in zip(bounds[1:], levels[1:], strict=False):
        if rate is not None:
            sharp = sharp & (bound <= BLURRED_RATE * np.maximum(1.0, np.max(np.abs(rate), axis=0)))
    return sharp


def _root(frames: Recentred, q: Any, t: float) -> Enclosure | None:
    """Return the root that a pose leads to; None if it is not proved, or not its own.

    Both are asked in frames near the joints where some are far away: turning a body there shifts it as well.
    """
    moved = frames.inward(q)
    root = krawczyk(frames.inner, moved, t, BITS)
    if root is not None:
        return _outward(frames, root, q) if _is_its_own(root, moved) else None
    root = krawczyk(frames.system, q, t, BITS) if frames.shifts.any() else None
    return root if root is not None and _is_its_own(root, q) else None


def _is_its_own(root: Enclosure, q: Any) -> bool:
    """Whether a root is that of the pose that led to it: of what no driver holds rounding makes one, anywhere."""
    near = bool(np.max(root.distance(q)) <= NEAR)
    return near or sigma_min(root.system.held_at(q).phi_q(q, root.t)) > SINGULAR


def _outward(frames: Recentred, root: Enclosure, q: Any) -> Enclosure:
    """Return a root that a pose leads to in moved frames as one in the given ones."""
    if not frames.shifts.any():
        return root
    with ctx.workprec(BITS):
        place = tuple(frames.outward(objects(root.q)))
    # All that is closer in the given coordinates is in the box: shifts turn with the angles.
    radii = root.radii / (1.0 + np.sum(np.abs(frames.shifts)))
    return Enclosure(frames.system.held_at(q), root.t, BITS, place, radii, root.rows)


def _by_balls(bounds: Isolation, sample: Any, enclosure: Enclosure, levels: list[Any]) -> None:
    known = (bounds.position, bounds.velocity, bounds.acceleration)
    for bound, distance in zip(known, enclosure.distances(*levels), strict=False):
        bound[sample] = distance
    bounds.ok[sample], bounds.bits[sample], bounds.enclosures[int(sample)] = True, enclosure.bits, enclosure
    off = contradiction(enclosure.system, enclosure.rows, enclosure.root(levels[0]), [enclosure.t])
    bounds.contradiction[0, sample] = off[0]
