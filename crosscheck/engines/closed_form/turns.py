"""How many whole turns make an angle continuous over times that may be far apart."""

from __future__ import annotations

import math

import numpy as np

from crosscheck.engines.closed_form.jets import Mask


def count_turns(t: np.ndarray, value: np.ndarray, rate: np.ndarray, start: float | None) -> tuple[np.ndarray, Mask]:
    """Return the whole turns (T,) that make an angle continuous, and the intervals (T-1,) in which they are unsure.

    From one time to the next the mean of its two rates carries the angle. An interval is unsure if the angle found
    is more than an eighth of a turn off that, or if either rate would turn it by more than half a turn. Times without
    an angle are passed over: behind them the nearest turns are taken, as no motion leads there.
    """
    turns, unsure = np.zeros(len(t)), np.zeros(max(len(t) - 1, 0), bool)
    (finite,) = np.nonzero(np.isfinite(value))
    if not len(finite):
        return turns, unsure
    v, r = value[finite], np.where(np.isfinite(rate[finite]), rate[finite], 0.0)
    off = (0.5 * (r[1:] + r[:-1]) * np.diff(t[finite]) - np.diff(v)) / math.tau
    first = 0.0 if start is None or not math.isfinite(start) else np.round((start - v[0]) / math.tau)
    turns[finite] = first + np.concatenate([[0.0], np.cumsum(np.round(off))])
    swept = np.maximum(np.abs(r[1:]), np.abs(r[:-1])) * np.diff(t[finite])
    unsure[finite[:-1]] = ((np.abs(off - np.round(off)) > 0.125) | (swept > math.pi)) & (np.diff(finite) == 1)
    return turns, unsure
