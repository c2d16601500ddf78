"""What a record keeps for pictures: the worst samples, the digits that rounding leaves, who agrees with whom.

All of it falls out of comparisons that are made anyway; numbers are kept to two figures.
"""

from __future__ import annotations

from collections.abc import Mapping
from itertools import combinations
from typing import Any

import numpy as np

from crosscheck.budget import SAFETY
from crosscheck.comparison import MOST_DIGITS, QUANTITIES, Comparison, QuantityComparison, Reference, scales
from crosscheck.frames import wrap

Answered = Mapping[tuple[str, str], Comparison]
"""Engine and route -> its answer against the reference."""


def worst_samples(sigma: Any, found: QuantityComparison) -> dict[str, dict[str, Any]]:
    """Return, for each decade of sigma_min, the sample with the fewest digits: which time, and how far off.

    Parameters
    ----------
    sigma : (T,) array
        The distance to a singular pose.

    Returns
    -------
    dict
        Decade -> {k, digits, off}: the number of the time, the digits, and the signed error per scaled coordinate of
        the reference (answer - reference; None where the answer has no such body).
    """
    if found.difference is None:
        return {}
    seen = np.isfinite(found.digits) & np.isfinite(sigma) & (np.asarray(sigma) > 0.0)
    kept = {}
    decades = np.full(len(found.digits), 0)
    decades[seen] = np.floor(np.log10(np.asarray(sigma)[seen]))
    for decade in sorted(set(decades[seen].tolist())):
        places = np.flatnonzero(seen & (decades == decade))
        k = int(places[np.argmin(found.digits[places])])
        off = [float(f"{x:.2g}") if np.isfinite(x) else None for x in found.difference[:, k]]
        kept[str(decade)] = {"k": k, "digits": float(np.floor(found.digits[k] * 10) / 10), "off": off}
    return kept


def attainable(ref: Reference) -> dict[str, Any]:
    """Return, per quantity, the digits (T,) that the rounding of numbers and formulas leaves, by first order.

    It is the budget of an engine that adds nothing, without the safety factor; NaN where no budget is derived.
    """
    budget = ref.budget()
    found = {}
    for level, quantity in enumerate(QUANTITIES):
        allowed = np.max(getattr(budget, quantity), axis=0) / SAFETY
        with np.errstate(divide="ignore", invalid="ignore"):
            digits = np.minimum(MOST_DIGITS, -np.log10(allowed / scales(ref.levels[level], level)))
        found[quantity] = np.where(budget.judged, digits, np.nan)
    return found


def agreement(ref: Reference, answered: Answered) -> list[list[Any]]:
    """Return for each two answers the median over times of the digits to which they agree.

    Returns
    -------
    list of [engine, route, engine, route, digits of position, of velocity, of acceleration]
        None where the two have no time in common.
    """
    rows = []
    for (a, first), (b, second) in combinations(answered.items(), 2):
        digits = [_median_digits(ref, quantity, first, second) for quantity in QUANTITIES]
        rows.append([*a, *b, *digits])
    return rows


def _median_digits(ref: Reference, quantity: str, first: Comparison, second: Comparison) -> float | None:
    one, other = (found.quantities.get(quantity) for found in (first, second))
    if one is None or other is None or one.difference is None or other.difference is None:
        return None
    level = QUANTITIES.index(quantity)
    apart = one.difference - other.difference
    if level == 0:
        apart[2::3] = wrap(apart[2::3])
    both = np.isfinite(apart)
    lanes = both.any(axis=0)
    if not lanes.any():
        return None
    error = np.max(np.where(both, np.abs(apart), 0.0), axis=0)[lanes]
    with np.errstate(divide="ignore"):
        digits = np.minimum(MOST_DIGITS, -np.log10(error / scales(ref.levels[level], level)[lanes]))
    return float(np.floor(np.median(digits) * 10) / 10)
