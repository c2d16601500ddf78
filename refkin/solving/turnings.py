"""Where a law turns back between two times: what it reaches there is seen at neither of them."""

from __future__ import annotations

import math
from itertools import pairwise

import numpy as np

from refkin.motion_laws import Law, Polynomial, Sinusoid

MOST = 1000
"""Turnings of a sinusoid that are listed: one that turns more often in a step leaves no step to take."""
LOOKS = 65
"""Places at which the rate of any other law is looked at."""
BESIDE = 1e-9
"""Part of an interval at its ends in which a turning is left out: the law moves by a squared part, 1e-18, there."""


def turnings(law: Law, a: float, b: float) -> list[float]:
    """Return the times well between a and b where the rate of a law vanishes and changes sign, unsorted."""
    margin = BESIDE * (b - a)
    return [t for t in _vanishing_rate(law, a, b) if a + margin < t < b - margin]


def _vanishing_rate(law: Law, a: float, b: float) -> list[float]:
    if isinstance(law, Polynomial):
        rate = [k * c for k, c in enumerate(law.coefficients)][1:]
        return [float(x.real) for x in np.roots(rate[::-1]) if x.imag == 0.0] if any(rate[1:]) else []
    if isinstance(law, Sinusoid):
        w, quarter = law.angular_frequency, 0.5 * math.pi
        if not w * law.amplitude:
            return []
        first = math.ceil((min(w * a, w * b) + law.phase - quarter) / math.pi)
        count = min(MOST, 1 + math.ceil(abs(w) * (b - a) / math.pi))
        return [(quarter + math.pi * (first + k) - law.phase) / w for k in range(count)]
    times = np.linspace(a, b, LOOKS)
    rates = np.asarray(law(times, 1))
    return [
        _between(law, lo, hi) for (lo, hi), (r, s) in zip(pairwise(times), pairwise(rates), strict=True) if r * s < 0
    ]


def _between(law: Law, lo: float, hi: float) -> float:
    """Halve an interval in which the rate changes sign until no float64 number is left in it."""
    rising = law(lo, 1) < 0.0
    while lo < (middle := 0.5 * (lo + hi)) < hi:
        lo, hi = (middle, hi) if (law(middle, 1) < 0.0) == rising else (lo, middle)
    return float(lo)
