"""How sharp the budgets are: what is allowed over what is attainable.

Attainable is how far the true solution moves when every number of a scene, its time included, moves by one ulp up or
down at random: an error that large says nothing about a code. The largest of a few such draws is taken. The equations
of the moved scene are evaluated with `BITS` bits at the solution of the scene as it is written, and one correction
each solves them: what is left out is of second order.
"""

from __future__ import annotations

import random
from collections.abc import Sequence
from dataclasses import replace
from math import inf, nextafter
from typing import Any

import numpy as np
from flint import arb, ctx

from crosscheck.engines import QUANTITIES
from crosscheck.judge.comparison import Reference
from crosscheck.judge.running_error import U
from refkin.motion_laws import Table
from refkin.proof.numbers.exact import by_parts, exact_system
from refkin.system import System, compile_system

BITS = 160
DRAWS = 8
"""The largest of eight draws is about 1.4 standard deviations of such a move; of three, a fifth less."""


def sharpness(ref: Reference, lanes: Sequence[int]) -> dict[str, tuple[Any, Any]]:
    """Return allowed over attainable, by quantity, at some of the times; those without a budget are left out.

    Returns
    -------
    dict of str to (array, array)
        Per time, the largest component of what is allowed over the largest of what is attainable: how loose the budget
        is; and the smallest allowed over attainable of any component: errors of so many times the attainable are seen.
    """
    budget = ref.budget()
    chosen = [k for k in lanes if budget.judged[k]]
    moved = attainable_by_inputs(ref, chosen)
    by_quantity = {}
    for quantity, level, attainable in zip(QUANTITIES, budget.levels, moved, strict=True):
        allowed = level[:, chosen]
        with np.errstate(divide="ignore", over="ignore"):
            smallest = np.min(allowed / attainable, axis=0)
        by_quantity[quantity] = np.max(allowed, axis=0) / np.max(attainable, axis=0), smallest
    return by_quantity


def attainable_by_inputs(ref: Reference, lanes: Sequence[int]) -> Any:
    """Return the largest move of position, velocity and acceleration, (3, n, len(lanes)), in scaled coordinates.

    Where the largest component moves by less than its own rounding, which no answer goes without, it moves by that.
    """
    numbers = random.Random(0)
    levels = [level[:, list(lanes)] for level in ref.levels]
    times = tuple(ref.motion.t[list(lanes)].tolist())
    here = _corrections(ref.system, levels, times)
    largest_change = np.zeros_like(here)
    for _ in range(DRAWS):
        moved = {key: nudged(getattr(ref.scene.mechanism, key), numbers) for key in ("joints", "drivers")}
        system = compile_system(replace(ref.scene.mechanism, **moved), unit=ref.system.unit)
        there = _corrections(system, levels, np.clip(nudged(times, numbers), *ref.motion.t[[0, -1]]).tolist())
        largest_change = np.maximum(largest_change, np.abs(there - here))
    largest = np.abs(levels) == np.max(np.abs(levels), axis=1, keepdims=True)
    return np.where(largest, np.maximum(largest_change, U * np.abs(levels)), largest_change)


def nudged(item: Any, numbers: random.Random) -> Any:
    """Return a number, tuple or dataclass with every float in it moved by one ulp up or down; zeros stay."""
    if isinstance(item, float) and item != 0.0:
        return nextafter(item, inf if numbers.random() < 0.5 else -inf)
    moved = by_parts(item, lambda part: nudged(part, numbers))
    return _same_ends(moved, item) if isinstance(item, Table) else moved


def _same_ends(moved: Any, table: Table) -> Any:
    """Return a moved table that begins and ends where it did, for the times do, and is periodic if it was."""
    argument = (table.argument[0], *moved.argument[1:-1], table.argument[-1])
    value = (*moved.value[:-1], moved.value[0]) if table.periodic else moved.value
    return replace(moved, argument=argument, value=value)


def _corrections(system: System, levels: Sequence[Any], times: Sequence[float]) -> Any:
    """Return what has to be added to the three levels (n, T) to solve the system's equations exactly, (3, n, T)."""
    out = np.zeros((3, system.n, len(times)))
    with ctx.workprec(BITS):
        exactly = exact_system(system, BITS)
        for k, t in enumerate(times):
            q, qd, qdd = ([arb(float(x)) for x in level[:, k]] for level in levels)
            out[:, :, k] = _correct(exactly, system, (q, qd, qdd), arb(t), t)
    return out


def _correct(exactly: System, system: System, levels: Sequence[Any], t: Any, at: float) -> Any:
    q, qd, qdd = (np.array(level, object) for level in levels)
    inverse = np.linalg.pinv(system.phi_q(np.array([float(x) for x in q]), at))
    dq = -_product(inverse, exactly.phi(q, t))
    q = q + dq
    slope = exactly.phi_q(q, t)
    dqd = _product(inverse, exactly.nu(q, t) - slope @ qd)
    qd = qd + dqd
    dqdd = _product(inverse, exactly.gamma(q, qd, t) - slope @ qdd)
    return [dq, dqd, dqdd]


def _product(inverse: Any, rows: Any) -> Any:
    return inverse @ np.array([float(x) for x in rows])
