"""What a record keeps of a comparison: histograms of digits, what rounding leaves attainable, one common sample.

All of it falls out of comparisons that are made anyway. Every answer is kept by itself, so that a scene whose engines
are asked one by one has the same record.
"""

from __future__ import annotations

import math
import sys
from collections import Counter
from collections.abc import Iterable, Sequence
from typing import Any

import numpy as np

from crosscheck.judge.budget import SAFETY
from crosscheck.judge.comparison import Comparison, QuantityComparison, Reference, scales
from crosscheck.judge.records import MOST_DIGITS, QUANTITIES, By, Common, Histogram, Quantity, ReferenceRow
from crosscheck.judge.sharpness import sharpness


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
        residual=largest(motion.residual),
        certified_radius={q: largest(getattr(radius, q)) for q in QUANTITIES},
        common=ref.common,
        attainable_by_sigma={q: by_decade(ref.decades, digits) for q, digits in attainable_digits(ref).items()},
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
    steps = np.max(np.abs(np.diff(ref.levels[0], axis=1)), axis=0)
    sigma = np.minimum(ref.sigma_min[1:], ref.sigma_min[:-1])
    moved = np.isfinite(sigma) & (steps > 0.0)
    return smallest(sigma[moved] / steps[moved]) if moved.any() else None


def attainable_digits(ref: Reference) -> dict[str, Any]:
    """Return, per quantity, the digits (T,) that the rounding of numbers and formulas leaves, by first order.

    It is the budget of an engine that adds nothing, without the safety factor; NaN where no budget is derived.
    """
    budget = ref.budget()
    attained = {}
    for level, quantity in enumerate(QUANTITIES):
        allowed = np.max(budget.levels[level], axis=0) / SAFETY
        with np.errstate(divide="ignore", invalid="ignore"):
            digits = np.minimum(MOST_DIGITS, -np.log10(allowed / scales(ref.levels[level], level)))
        attained[quantity] = np.where(budget.judged, digits, np.nan)
    return attained


def off_at(q: QuantityComparison, common: Common | None) -> list[float | None]:
    """Return the signed error per scaled coordinate at the common time, to three figures; None where there is none."""
    if common is None or q.difference is None:
        return []
    return [float(f"{x:.3g}") if np.isfinite(x) else None for x in q.difference[:, common.k]]


def histogram(digits: Iterable[float]) -> Histogram:
    """Return how often each number of digits occurs, in whole tenths, rounded down; NaN is left out."""
    values = list(digits)
    return _counted([0] * len(values), values).get(0, {})


def by_decade(decades: Sequence[int | None], digits: Any) -> By:
    """Return the histogram of digits (T,) for each decade of sigma_min, the distance to a singular pose."""
    return dict(sorted(_counted(decades, digits).items()))


def _counted(groups: Sequence[int | None], digits: Any) -> By:
    """Return the histogram of digits in each group; those without a group, or that are no number, are left out."""
    tenths = np.floor(np.asarray(digits, float) * 10)
    counts: By = {}
    for (group, value), count in Counter(zip(groups, tenths.tolist(), strict=True)).items():
        if group is not None and math.isfinite(value):
            counts.setdefault(group, {})[int(value)] = count
    return counts


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
