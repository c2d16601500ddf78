"""Where the level of a series of nightly ratios changed, told from noise by a penalty that the noise itself scales.

The series is cut into pieces of constant level so that the squared distances from the levels, plus a price per cut,
are least (optimal partitioning; Jackson et al., IEEE Signal Processing Letters 12, 2005). Three things make it fit for
times:

* logarithms: a machine is slower by a factor;
* a running median of five takes outliers out, two in a row included, before anything is cut;
* a cut costs 4 log(n) times the variance of the noise, and the noise is estimated from the differences of neighbours,
  which a change of level disturbs only once.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from itertools import pairwise
from typing import Any

import numpy as np

FEWEST = 8
"""Nights below which nothing is said."""
SHORTEST = 4
"""Nights that a level must last to be one."""
SMALLEST = 0.05
"""Changes by less than this part of the level are not told."""
QUIET = 0.01
"""The least noise that is believed of a timer, as a part of what it measures."""
PER_CUT = 4.0


def change_points(values: Sequence[float]) -> dict[int, float]:
    """Return {first night of a new level: new level / old level}.

    Parameters
    ----------
    values : sequence of float
        One positive number per night, oldest first.
    """
    n = len(values)
    if n < FEWEST:
        return {}
    logs = np.log(np.asarray(values, float))
    smooth = _median_of_five(logs)
    price = PER_CUT * math.log(n) * _noise(logs) ** 2
    cuts = _partition(smooth, price)
    edges = [0, *cuts, n]
    levels = [float(np.median(smooth[a:b])) for a, b in pairwise(edges)]
    factors = {cut: math.exp(levels[k + 1] - levels[k]) for k, cut in enumerate(cuts)}
    return {cut: factor for cut, factor in factors.items() if abs(math.log(factor)) >= math.log1p(SMALLEST)}


def _noise(logs: Any) -> float:
    """Return the standard deviation of the noise, from the median of the differences of neighbours (normal noise)."""
    typical = float(np.median(np.abs(np.diff(logs))))
    return max(QUIET, 1.4826 * typical / math.sqrt(2.0))


def _median_of_five(x: Any) -> Any:
    padded = np.pad(x, 2, mode="reflect")
    return np.median(np.stack([padded[k : k + len(x)] for k in range(5)]), axis=0)


def _partition(x: Any, price: float) -> list[int]:
    """Return the cuts of the cheapest partition into pieces of at least `SHORTEST` points."""
    n = len(x)
    first, second = (np.concatenate([[0.0], np.cumsum(x**power)]) for power in (1, 2))
    best = np.full(n + 1, np.inf)
    best[0] = -price
    before = np.zeros(n + 1, int)
    for end in range(SHORTEST, n + 1):
        for start in [0, *range(SHORTEST, end - SHORTEST + 1)]:
            total = first[end] - first[start]
            cost = best[start] + second[end] - second[start] - total**2 / (end - start) + price
            if cost < best[end]:
                best[end], before[end] = cost, start
    cuts = []
    at = int(before[n])
    while at > 0:
        cuts.append(at)
        at = int(before[at])
    return cuts[::-1]
