"""What a record keeps of a comparison: histograms of digits, how sharp the budgets are, one common sample.

All of it falls out of comparisons that are made anyway. Every answer is kept by itself, so that a scene whose engines
are asked one by one has the same record.

Sharpness is what is allowed over the sensitivity to the input: how far the true solution moves when every number of a
scene, its time included, moves by one ulp up or down at random, for an error that large says nothing about a code. The
largest of a few such draws is taken. The equations of the moved scene are evaluated with `BITS` bits at the solution of
the scene as it is written, and one correction each solves them: what is left out is of second order.
"""

from __future__ import annotations

import math
import random
import sys
from collections import Counter
from collections.abc import Iterable, Sequence
from dataclasses import replace
from math import inf, nextafter
from typing import Any

import numpy as np
from flint import arb, ctx

from crosscheck.judge.comparison import Comparison, QuantityComparison, Reference, scales
from crosscheck.judge.records import (
    BEYOND_NEWTON,
    MOST_DIGITS,
    QUANTITIES,
    By,
    Common,
    Histogram,
    Quantity,
    ReferenceRow,
)
from crosscheck.judge.rounding import SAFETY
from crosscheck.judge.running_error import U
from refkin.motion_laws import Table
from refkin.proof.numbers.exact import by_parts, exact_system
from refkin.system import System, compile_system


def quantities(ref: Reference, comparison: Comparison) -> dict[str, Quantity]:
    """Return what a record keeps of each quantity of a comparison."""
    return {
        name: Quantity(
            ratio=largest_ratio(q.ratio),
            worst=q.worst,
            digits_by_sigma=by_decade(ref.decades, q.digits),
            common=off_at(q, ref.common),
        )
        for name, q in comparison.quantities.items()
    }


def reference_row(ref: Reference, seconds: float) -> ReferenceRow:
    """Return what a record keeps of the reference, which took so many seconds."""
    motion = ref.motion
    radius = motion.certified_radius
    return ReferenceRow(
        verdict=motion.verdict.value,
        message=motion.message,
        statuses={s.value: motion.status.count(s) for s in dict.fromkeys(motion.status)},
        sigma_min=smallest(ref.sigma_min),
        sigma_per_step=_sigma_per_step(ref),
        redundant=ref.system.m > ref.system.n,
        residual=largest(motion.residual),
        certified_radius={q: largest(getattr(radius, q)) for q in QUANTITIES},
        common=ref.common,
        rounding_by_sigma={q: by_decade(ref.decades, digits) for q, digits in rounding_digits(ref).items()},
        seconds=seconds,
    )


def sharpness_at_common(ref: Reference) -> dict[str, tuple[float, float]]:
    """Return how sharp the budgets are at the time at which answers are compared with each other."""
    if ref.common is None:
        return {}
    sharp = sharpness(ref, [ref.common.k]).items()
    at = {q: (largest(loosest), smallest(seen)) for q, (loosest, seen) in sharp}
    return {q: (float(f"{loosest:.3g}"), float(f"{seen:.3g}")) for q, (loosest, seen) in at.items() if loosest and seen}


def _sigma_per_step(ref: Reference) -> float | None:
    """Return the smallest ratio of sigma_min, at either end of a step, to what a coordinate changes by in it."""
    ratios = _sigma_of_steps(ref)
    known = np.isfinite(ratios)
    return smallest(ratios[known]) if known.any() else None


def _sigma_of_steps(ref: Reference) -> Any:
    """Return that ratio of each step, (T - 1,): NaN where a pose is not known, infinity where nothing moves."""
    steps = np.max(np.abs(np.diff(ref.levels[0], axis=1)), axis=0)
    with np.errstate(divide="ignore", invalid="ignore"):
        return np.where(steps == 0.0, np.inf, np.minimum(ref.sigma_min[1:], ref.sigma_min[:-1]) / steps)


def is_bound(ref: Reference, time: float) -> bool:
    """Return whether no step that begins up to a time is beyond Newton: what is wrong by then no step explains."""
    ratios = _sigma_of_steps(ref)[: 1 + int(np.searchsorted(ref.motion.t, time))]
    return bool(len(ratios) and np.all(ratios >= BEYOND_NEWTON))


def rounding_digits(ref: Reference) -> dict[str, Any]:
    """Return, per quantity, the digits (T,) that rounding leaves to one evaluation of the formulas, by first order.

    It is the budget of an engine that adds nothing, without the safety factor; NaN where no budget is derived.
    """
    budget = ref.budget()
    left = {}
    for level, quantity in enumerate(QUANTITIES):
        allowed = np.max(budget.levels[level], axis=0) / SAFETY
        with np.errstate(divide="ignore", invalid="ignore"):
            digits = np.minimum(MOST_DIGITS, -np.log10(allowed / scales(ref.levels, level, ref.rests)))
        left[quantity] = np.where(budget.compared, digits, np.nan)
    return left


def off_at(q: QuantityComparison, common: Common | None) -> list[float | None]:
    """Return the signed error per scaled coordinate at the common time, to three figures; None where there is none.

    Zero is written as a whole number: `0.0` in every sixth place makes a record half a percent longer.
    """
    if common is None or q.difference is None:
        return []
    return [float(f"{x:.3g}") or 0 if math.isfinite(x) else None for x in q.difference[:, common.k].tolist()]


def histogram(digits: Iterable[float]) -> Histogram:
    """Return how often each number of digits occurs, in whole tenths, rounded down; NaN is left out."""
    return dict(Counter(math.floor(10 * float(value)) for value in digits if math.isfinite(value)))


def by_decade(decades: Sequence[int | None], digits: Any) -> By:
    """Return the histogram of digits (T,) for each decade of sigma_min; what is no number, or has none, is left out."""
    tenths = np.floor(np.asarray(digits, float) * 10)
    counts: By = {}
    for (decade, value), count in Counter(zip(decades, tenths.tolist(), strict=True)).items():
        if decade is not None and math.isfinite(value):
            counts.setdefault(decade, {})[int(value)] = count
    return dict(sorted(counts.items()))


def largest(values: Any) -> float | None:
    """Return the largest finite number; None if there is none."""
    finite = np.asarray(values)[np.isfinite(values)]
    return float(finite.max()) if finite.size else None


def largest_ratio(ratios: Any) -> float | None:
    """Return the largest ratio to six figures, an infinite one as the largest double; None if nothing was compared."""
    compared = np.asarray(ratios)[~np.isnan(ratios)]
    return short(min(float(compared.max()), sys.float_info.max)) if compared.size else None


def short(ratio: float) -> float:
    """Return a ratio to six figures, but as it is where those might move it across 1, or to infinity."""
    return ratio if abs(ratio - 1.0) < 1e-3 or ratio > 1e300 else float(f"{ratio:.6g}")


def smallest(values: Any) -> float:
    """Return the smallest finite number; 0 if there is none."""
    finite = np.asarray(values)[np.isfinite(values)]
    return float(finite.min()) if finite.size else 0.0


BITS = 160
DRAWS = 8
"""The largest of eight draws is about 1.4 standard deviations of such a move; of three, a fifth less."""


def sharpness(ref: Reference, samples: Sequence[int]) -> dict[str, tuple[Any, Any]]:
    """Return allowed over sensitivity, by quantity, at some of the times; those without a budget are left out.

    Per time, the largest component of what is allowed over the largest of the sensitivity: how loose the budget is; and
    the smallest allowed over sensitivity of any component: errors of so many times the sensitivity are seen.
    """
    budget = ref.budget()
    chosen = [k for k in samples if budget.compared[k]]
    moved = input_sensitivity(ref, chosen)
    by_quantity = {}
    for quantity, level, sensitivity in zip(QUANTITIES, budget.levels, moved, strict=True):
        allowed = level[:, chosen]
        with np.errstate(divide="ignore", over="ignore", invalid="ignore"):
            seen = np.where(sensitivity == 0.0, np.inf, allowed / sensitivity)  # what is at rest is moved by nothing
        smallest = np.min(seen, axis=0)
        by_quantity[quantity] = np.max(allowed, axis=0) / np.max(sensitivity, axis=0), smallest
    return by_quantity


def input_sensitivity(ref: Reference, samples: Sequence[int]) -> Any:
    """Return the largest move of position, velocity and acceleration, (3, n, len(samples)), in scaled coordinates.

    Where the largest component moves by less than its own rounding, which no answer goes without, it moves by that.
    """
    numbers = random.Random(0)
    levels = [level[:, list(samples)] for level in ref.levels]
    times = tuple(ref.motion.t[list(samples)].tolist())
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
    if not isinstance(item, Table):
        return moved
    # a table begins and ends where it did, for the times do, and is periodic if it was
    argument = (item.argument[0], *moved.argument[1:-1], item.argument[-1])
    return replace(moved, argument=argument, value=(*moved.value[:-1], moved.value[0 if item.periodic else -1]))


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
    inverted = np.linalg.inv if system.m == system.n else np.linalg.pinv  # LU moves no part for another
    inverse = inverted(system.phi_q(np.array([float(x) for x in q]), at))
    dq = -_product(inverse, exactly.phi(q, t))
    q = q + dq
    slope = exactly.phi_q(q, t)
    dqd = _product(inverse, exactly.nu(q, t) - slope @ qd)
    qd = qd + dqd
    dqdd = _product(inverse, exactly.gamma(q, qd, t) - slope @ qdd)
    return [dq, dqd, dqdd]


def _product(inverse: Any, rows: Any) -> Any:
    return inverse @ np.array([float(x) for x in rows])
