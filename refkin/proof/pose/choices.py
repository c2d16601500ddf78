"""Redundant rows: error bounds that hold whichever n of the m rows a reader takes for the mechanism.

A pose is certified on n independent rows; the others agree with them up to rounding of the mechanism's numbers. But
where rows nearly depend on each other, that rounding is magnified: the pose that another choice of n rows isolates lies
further away, and its rates further still. All of these are solutions of the scene as well as that of the first choice
is, so the bounds cover them: each choice is certified at the same answer, and the largest bound counts.

From one choice to the next some rows S_I give way to rows D_J that were left out; the new rows are independent where
det (D S^-1)[J, I] is not zero.
"""

from __future__ import annotations

import math
from dataclasses import replace
from itertools import combinations
from typing import Any

import numpy as np

from refkin.joints import SPACE
from refkin.proof.numbers.preconditioned import groups_of_rows, inverses
from refkin.proof.pose.certificate import certify
from refkin.proof.pose.isolate import Isolation, isolate
from refkin.proof.pose.krawczyk import krawczyk
from refkin.system import System

MOST_CHOICES = 256
"""Choices of rows that are certified; where there are more, no bound is given."""
MOST_OF_SPACE = 16
"""The same in space: a loop of four hinges has 2024 choices, each as costly as the first."""
MOST_COMBINATIONS = 20_000
"""Sets of rows of which it is asked whether they are such a choice."""
DEPENDENT = 2.0**-40
"""Determinant, largest over the poses, up to which rows depend on each other: far more than rounding leaves of 0."""
LOOKED_AT = 16
"""Poses at which that is asked."""
NEAR = 2.0**-10
"""Distance up to which the pose of another choice is one of the same assembly [sizes, rad]."""


def over_all_choices(system: System, proof: Isolation, q: Any, t: Any, qd: Any = None, qdd: Any = None) -> Isolation:
    """Return an isolation with bounds that hold for every choice of n rows that isolates a pose near the answer.

    Parameters
    ----------
    system : System
        Compiled in its mechanism's own unit.
    proof : Isolation
        What `isolate` proved of the same answers.
    q, qd, qdd : (n, B) array
        Answers in the system's coordinates, as for `isolate`.

    Returns
    -------
    Isolation
        With `why` where there are too many choices: then with NaN for all bounds, or, in space, with those of the rows
        of the proof alone.
    """
    if system.m == system.n or not proof.ok.any():
        return proof
    q, t = np.asarray(q, float), np.broadcast_to(np.asarray(t, float), np.shape(q)[1:])
    most = MOST_OF_SPACE if system.kind is SPACE else MOST_CHOICES
    choices = other_choices(system, proof.rows, q[:, proof.ok], t[proof.ok], most)
    if choices is None:
        if system.kind is SPACE:
            why = f"redundant rows can be chosen in more than {most} ways: the bounds are those of one choice"
            return replace(proof, why=why)
        nothing = np.full_like(proof.position, np.nan)
        why = f"redundant rows can be chosen in more than {most} ways: no error bound covers all of them"
        return replace(proof, position=nothing, velocity=nothing, acceleration=nothing, why=why)
    bounds = [proof.position.copy(), proof.velocity.copy(), proof.acceleration.copy()]
    for rows in choices:
        for bound, of_choice in zip(bounds, _bounds(system, rows, proof.ok, q, t, qd, qdd), strict=True):
            np.maximum(bound, of_choice, out=bound)
    return replace(proof, position=bounds[0], velocity=bounds[1], acceleration=bounds[2])


def isolate_every_choice(system: System, q: Any, t: Any, qd: Any = None, qdd: Any = None) -> Isolation:
    """Isolate poses, redundant ones by the rows that serve best at each, with bounds over all choices of rows.

    Parameters
    ----------
    system, q, t, qd, qdd
        As for `isolate`.
    """
    t = np.broadcast_to(np.asarray(t, float), np.shape(q)[1:])
    parts = []
    for samples, rows in groups_of_rows(system, np.asarray(q, float), t):
        levels = [None if x is None else np.asarray(x, float)[:, samples] for x in (q, qd, qdd)]
        answers = (levels[0], t[samples], *levels[1:])
        parts.append((samples, over_all_choices(system, isolate(system, *answers, rows=rows), *answers)))
    if len(parts) == 1:
        return parts[0][1]
    order = np.argsort(np.concatenate([samples for samples, _ in parts]))
    names = ("ok", "bits", "position", "velocity", "acceleration", "unique", "contradiction")
    joined = {name: np.concatenate([getattr(p, name) for _, p in parts], axis=-1)[..., order] for name in names}
    balls = {int(samples[k]): ball for samples, part in parts for k, ball in part.enclosures.items()}
    why = next((part.why for _, part in parts if part.why), "")
    return Isolation(**joined, rows=parts[0][1].rows, enclosures=balls, why=why)


def other_choices(system: System, rows: Any, q: Any, t: Any, most: int) -> list[Any] | None:
    """Return the sets of n rows, other than the given one, that are independent at some pose; None if too many.

    Parameters
    ----------
    rows : (n,) array of int
        The rows that were solved, of the m.
    q : (n, B) array
        Poses, in the system's coordinates; some of them are looked at.
    t : (B,) array
        Their times [s].
    most : int
        How many sets are too many.
    """
    others = np.delete(np.arange(system.m), rows)
    counts = [math.comb(len(others), k) * math.comb(system.n, k) for k in range(1, len(others) + 1)]
    if sum(counts) > MOST_COMBINATIONS:
        return None
    some = np.unique(np.linspace(0, q.shape[1] - 1, LOOKED_AT).astype(int))
    slope = np.moveaxis(system.phi_q(q[:, some], t[some]), -1, 0)
    factors = np.nan_to_num(slope[:, others] @ inverses(slope[:, rows]))
    choices = []
    for count in range(1, len(others) + 1):
        for new in combinations(range(len(others)), count):
            for old in combinations(range(system.n), count):
                if np.max(np.abs(np.linalg.det(factors[:, new][:, :, old]))) > DEPENDENT:
                    choices.append(np.sort(np.append(np.delete(rows, old), others[list(new)])))
                    if len(choices) > most:
                        return None
    return choices


def _bounds(system: System, rows: Any, asked: Any, q: Any, t: Any, qd: Any, qdd: Any) -> list[Any]:
    """Return the error bounds (3, B) of one choice of rows: 0 where it isolates no pose near the answer."""
    proof = certify(system, q, t, qd, qdd, rows=rows)
    bounds = [np.zeros(len(t)) for _ in range(3)]
    for bound, radii in zip(bounds, (proof.radii, proof.velocity, proof.acceleration), strict=True):
        if radii is not None:
            bound[proof.ok] = np.max(radii[:, proof.ok], axis=0)
    for sample in np.flatnonzero(asked & ~proof.ok):
        root = krawczyk(system, q[:, sample], float(t[sample]), rows=rows)
        levels = [None if x is None else x[:, sample] for x in (q, qd, qdd)]
        if root is not None and np.max(root.distance(levels[0])) <= NEAR:
            for bound, distance in zip(bounds, root.distances(*levels), strict=False):
                bound[sample] = distance
    return bounds
