"""Where the laws of a family turn back between two times: for all mechanisms at once, as far as that is common to all.

A law whose times of turning hold no rows turns back at the same times in every mechanism. Of any other it is asked in
which mechanisms it may: in those where its rate, or the value of a distance, is not proved to keep its sign. They march
alone, and there it is known exactly.
"""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import numpy as np

from refkin.fast.given import has_rows
from refkin.joints import Constraint
from refkin.motion_laws import Integral, Law, Polynomial, Sinusoid
from refkin.proof.numbers.extrema import derivative, drives_a_distance, extrema, extrema_of, zeros


def common_extrema(constraints: tuple[Constraint, ...], a: float, b: float) -> list[float]:
    """Return the times between a and b at which laws turn back in all mechanisms, in order."""
    times: set[float] = set()
    for constraint in constraints:
        if constraint.laws and not has_rows(constraint.laws):
            times.update(extrema_of([constraint], a, b))
        else:
            times.update(t for law in constraint.laws for t in _common(law, a, b) or ())
    return sorted(times)


def _common(law: Law, a: float, b: float) -> list[float] | None:
    """Return the extrema of a law between a and b if they hold no rows, else None."""
    if isinstance(law, Polynomial) and not has_rows(law.coefficients[1:]):
        return zeros(derivative(law), a, b) if len(law.coefficients) > 1 else []
    if isinstance(law, Sinusoid) and not has_rows((law.angular_frequency, law.phase)):
        return extrema(replace(law, amplitude=1.0, offset=0.0), a, b)
    if isinstance(law, Integral) and not has_rows(law.rate):
        return extrema(law, a, b)
    return None


def may_turn(constraints: tuple[Constraint, ...], a: float, b: float, samples: int) -> Any:
    """Return in which of so many mechanisms a law may turn back between a and b at a time of its own, (samples,)."""
    turning = np.zeros(samples, bool)
    for constraint in constraints:
        if not has_rows(constraint.laws):
            continue
        for law in constraint.laws:
            if _common(law, a, b) is None:
                turning |= _turns(law, a, b)
            if drives_a_distance(constraint):
                turning |= ~_keeps_its_sign(law, a, b)
    return turning


def _turns(law: Law, a: float, b: float) -> Any:
    if isinstance(law, Sinusoid):
        first, last = ((law.angular_frequency * t + law.phase) / np.pi - 0.5 for t in (a, b))
        return np.floor(first) != np.floor(last)
    rate: Any = law.rate if isinstance(law, Integral) else derivative(law) if isinstance(law, Polynomial) else law
    return ~_keeps_its_sign(rate, a, b)


def _keeps_its_sign(law: Law, a: float, b: float) -> Any:
    """Return where |f| in the middle is more than it can change by up to the ends; not always where it is so."""
    middle, half = 0.5 * (a + b), 0.5 * (b - a)
    if isinstance(law, Sinusoid):
        change = half * np.abs(law.amplitude * law.angular_frequency)
    elif isinstance(law, Integral):
        rate = law.rate
        assert isinstance(rate, Polynomial | Sinusoid)  # a table has no rows
        if isinstance(rate, Sinusoid):
            change = half * (np.abs(rate.offset) + np.abs(rate.amplitude))
        else:
            change = half * (np.abs(rate(middle)) + _change(rate, middle, half))
    else:
        assert isinstance(law, Polynomial)
        change = _change(law, middle, half)
    return np.abs(law(middle)) > change


def _change(law: Polynomial, middle: float, half: float) -> Any:
    """Return by how much a polynomial can change within `half` of a time: the sum of its Taylor terms."""
    factor, change = 1.0, 0.0
    for order in range(1, len(law.coefficients)):
        factor *= half / order
        change = change + factor * np.abs(law(middle, order))
    return change
