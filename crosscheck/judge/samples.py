"""What a record keeps for pictures: the worst samples, the digits that rounding leaves, one sample for all engines.

All of it falls out of comparisons that are made anyway; errors are kept to a few figures. Every answer is kept by
itself, so that a scene whose engines are asked one by one has the same record.
"""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import numpy as np

from crosscheck.engines import QUANTITIES
from crosscheck.judge.budget import SAFETY
from crosscheck.judge.comparison import MOST_DIGITS, QuantityComparison, Reference, scales

MOST_FRAMES = 24
"""Frames of a moving picture."""


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


def common_sample(ref: Reference) -> dict[str, Any] | None:
    """Return the one time per scene at which answers are compared with each other, and what their errors relate to.

    Returns
    -------
    dict or None
        {k, scale}: the middle one of the times at which a budget is derived, the scale of each quantity there; None if
        there is no such time.
    """
    lanes = np.flatnonzero(ref.budget().judged)
    if not lanes.size:
        return None
    k = int(lanes[lanes.size // 2])
    size = {q: float(scales(ref.levels[level], level)[k]) for level, q in enumerate(QUANTITIES)}
    return {"k": k, "scale": size}


def off_at(found: QuantityComparison, common: Mapping[str, Any] | None) -> list[float | None]:
    """Return the signed error per scaled coordinate at the common time, to three figures; None where there is none."""
    if common is None or found.difference is None:
        return []
    return [float(f"{x:.3g}") if np.isfinite(x) else None for x in found.difference[:, common["k"]]]


def cycle(found: QuantityComparison) -> dict[str, Any] | None:
    """Return the signed errors at up to `MOST_FRAMES` times of a scene, to two figures of the largest: to be drawn.

    Returns
    -------
    dict or None
        {unit, off}: off holds, per time, one whole number of units per scaled coordinate of the reference; None at a
        time without answer. None if there is nothing to draw.
    """
    if found.difference is None:
        return None
    off = found.difference[:, :: frame_step(found.difference.shape[1])]
    whole = np.all(np.isfinite(off), axis=0)
    if not whole.any():
        return None
    unit = float(f"{np.max(np.abs(off[:, whole])) / 99:.3g}") or 1.0
    return {
        "unit": unit,
        "off": [[round(x / unit) for x in row] if ok else None for row, ok in zip(off.T, whole, strict=True)],
    }


def frame_step(times: int) -> int:
    """Return every how manieth time is a frame of a moving picture."""
    return max(1, -(-times // MOST_FRAMES))
