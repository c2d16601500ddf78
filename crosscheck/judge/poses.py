"""An answer's poses in the coordinates of the reference's equations: with turns, and what joints bring.

Angles are compared without whole turns, but drivers, gears and wheels on a line count them. They are the reference's;
where it has no pose, those that such rows ask for. No answer has the coordinate that a joint brings: half the angle of
a screw is that of its bodies, and the place of a contact is where the contact's rows are smallest.
"""

from __future__ import annotations

import math
from dataclasses import replace
from typing import Any

import numpy as np

from crosscheck.judge.rounding import residual_error
from refkin.joints import Counted, initial_contacts, polar_cams
from refkin.motion import Motion
from refkin.system import System

CORRECTIONS = 4
"""Of a contact's place by Newton's method: two make rounding of the 1e-7 to which it is scanned."""


def rows_among(system: System, q: Any) -> Any:
    """Return which rows (m,) are of the ground and of bodies alone of which poses (n, K) say something."""
    there, among = np.isfinite(q).all(axis=1), np.zeros(system.m, bool)
    for p in system.placed:
        among[p.row : p.row + p.constraint.rows] = all(there[k] for k in p.starts if k is not None)
    return among


def all_levels(system: System, motion: Motion) -> Any:
    """Return an answer's levels [m, rad] in the order of the system's coordinates, (3, n, T); 0 what it has not."""
    levels, width = np.zeros((3, system.n, len(motion.t))), system.kind.width
    for own, level in zip(levels, motion.levels, strict=True):
        for k, body in enumerate(motion.bodies):
            own[system.columns(body)] = 0.0 if level is None else level[width * k : width * (k + 1)]
    return levels


def with_turns(system: System, q: Any, t: Any) -> Any:
    """Return poses (n, K) with whole turns added to angles, so that rows that count turns are nearest to zero.

    Of the angles in such a row one is turned, which no row before has turned or left; rows with the fewest such angles
    come first.

    Parameters
    ----------
    system : System
    q : (n, K) array
    t : (K,) array
        Times [s].
    """
    counts = _counts(system, q, t) if len(t) else {}
    q, left = q.copy(), dict.fromkeys(k for angles in counts.values() for k in angles)
    while counts:
        row = min(counts, key=lambda row: len(counts[row].keys() & left.keys()))
        turned = [k for k in counts[row] if k in left][-1:]
        for k in turned:
            q[k] += math.tau * np.round(-system.phi(q, t)[row] / counts[row][k])
        for k in counts.pop(row):
            left.pop(k, None)
    return q


def _counts(system: System, q: Any, t: Any) -> dict[int, dict[int, float]]:
    """Return row -> angle -> what a whole turn of that body adds to it, of the rows that count turns."""
    counts = dict[int, dict[int, float]]()
    at, among = q[:, :1], rows_among(system, q)
    for k in np.flatnonzero(system.angles[: system.of_bodies]).tolist():
        turned = at + math.tau * (np.arange(system.n) == k)[:, None]
        added, rounded = system.phi(turned, t[:1]) - system.phi(at, t[:1]), residual_error(system, turned, t[:1])
        for row in np.flatnonzero(among & (np.abs(added) > 2 * rounded)[:, 0]).tolist():
            counts.setdefault(row, {})[k] = float(added[row, 0])
    return counts


def with_counts(system: System, q: Any, t: Any, ours: Any) -> Any:
    """Return poses (n, K) of space in the turns that gears count: those of the reference, or else those of laws.

    Parameters
    ----------
    system, q, t, ours
        As for `with_contacts`.
    """
    counted = [p.starts[2] for p in system.placed if isinstance(p.constraint, Counted)]
    if not counted:
        return q
    q, known = q.copy(), np.isfinite(ours).all(axis=0)
    q[counted] += np.pi * np.round((np.nan_to_num(ours) - q)[counted] / np.pi)
    for k in np.flatnonzero(~known).tolist():
        q[counted, k] = initial_contacts(system, q[:, k], t[k])[counted]
    return q


def with_contacts(system: System, q: Any, t: Any, ours: Any) -> Any:
    """Return poses (n, K) with each contact where its own rows are smallest: near the reference's, or anywhere.

    Parameters
    ----------
    system : System
    q, ours : (n, K) array
        The poses, and the reference's; NaN where it has none.
    t : (K,) array
        Times [s].
    """
    cams: list[Any] = [p for p in system.placed if p.constraint in polar_cams(system.mechanism.joints)]
    if not cams:
        return q
    anywhere = {p.row: replace(p, constraint=replace(p.constraint, contact_estimate=None)) for p in cams}
    free = replace(system, placed=tuple(anywhere.get(p.row, p) for p in system.placed))
    q = q.copy()
    for k, known in enumerate(np.isfinite(ours).all(axis=0)):
        own = ours[:, k] if known else initial_contacts(free, q[:, k], t[k])
        q[system.of_bodies :, k] = own[system.of_bodies :]
    for p in CORRECTIONS * cams:
        own, rows = p.starts[2], slice(p.row, p.row + p.constraint.rows)
        residual, slope = system.phi(q, t)[rows], system.phi_q(q, t)[rows, own]
        corrected = q.copy()
        corrected[own] -= np.sum(residual * slope, axis=0) / np.sum(slope * slope, axis=0)
        nearer = np.sum(system.phi(corrected, t)[rows] ** 2, axis=0) < np.sum(residual**2, axis=0)
        q[:, nearer] = corrected[:, nearer]
    return q
