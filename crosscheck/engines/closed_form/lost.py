"""When a motion first meets a pose where the two meeting points of a dyad are one, also between the asked times.

Beyond such a pose the sign that tells meeting points apart says nothing of the branch: where a parallelogram is flat
its sign changes, and keeping it answers with the antiparallelogram. So every slack is held to be positive all along
the motion. Between two times it is least where its rate goes from - to +; such an interval is halved as long as the
tangents at its ends, which lie below a slack that is curved upwards, go down to zero.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from itertools import pairwise
from typing import Any

import numpy as np

from crosscheck.engines.closed_form.assemble import Assembly
from crosscheck.engines.closed_form.jets import Floats, midpoint

PIECES = 16
"""Parts into which an interval between two times is cut: of a turn of a crank a part has one least slack at most."""
HALVINGS = 60
"""After so many no float64 time is left between."""

Solve = Callable[[tuple[float, ...]], Assembly]
"""Returns the groups joined at times that begin with the scene's first: there the estimates tell the assembly."""


@dataclass(frozen=True)
class _Slacks:
    """Every slack of every dyad, in scales (S, T), and its rate."""

    value: Any
    rate: Any

    @staticmethod
    def of(assembly: Assembly) -> _Slacks:
        kept = [slack for meeting in assembly.meetings for slack in meeting.slacks]
        value, rate, scale = (
            _rows([getattr(slack, part) for slack in kept], len(assembly.scene.times))
            for part in ("value", "rate", "scale")
        )
        return _Slacks(value / scale, rate / scale)


def _rows(numbers: list[Any], count: int) -> Any:
    return np.array([np.broadcast_to(midpoint(x), (count,)) for x in numbers]).reshape(len(numbers), count)


def lost_after(times: tuple[float, ...], solve: Solve) -> float:
    """Return the time from which the branch is not known: the first at which a slack is not positive; else inf."""
    if len(times) < 2:
        return np.inf
    fine = np.unique(np.concatenate([np.linspace(a, b, PIECES + 1) for a, b in pairwise(times)]))
    slacks = _Slacks.of(solve(tuple(fine)))
    met = _first(fine, slacks.value)
    least = (slacks.rate[:, :-1] < 0.0) & (slacks.rate[:, 1:] > 0.0) & (fine[1:] < met)
    which, k = np.nonzero(least)
    at = [(fine[i], slacks.value[which, i], slacks.rate[which, i]) for i in (k, k + 1)]
    return min(met, _least(times[0], which, at, solve))


def _least(first: float, which: Any, ends: Any, solve: Solve) -> float:
    """Return the first time at which a slack is not positive within intervals in which each has one least value."""
    (lo, v_lo, r_lo), (hi, v_hi, r_hi) = ends
    met = np.inf
    for _ in range(HALVINGS):
        with np.errstate(all="ignore"):
            bound = (v_lo * r_hi - v_hi * r_lo + (hi - lo) * r_lo * r_hi) / (r_hi - r_lo)
        middle = (lo + hi) / 2
        open_ = ~(bound > Floats.zero) & (lo < middle) & (middle < hi) & (lo < met)
        if not open_.any():
            break
        which, lo, v_lo, r_lo, hi, v_hi, r_hi, middle = (
            x[open_] for x in (which, lo, v_lo, r_lo, hi, v_hi, r_hi, middle)
        )
        times = np.unique(np.append(middle, first))
        slacks, at = _Slacks.of(solve(tuple(times))), np.searchsorted(times, middle)
        value, rate = slacks.value[which, at], slacks.rate[which, at]
        met = min(met, float(np.min(middle[~(value > Floats.zero)], initial=np.inf)))
        left = rate > 0.0
        lo, v_lo, r_lo = (np.where(left, a, b) for a, b in ((lo, middle), (v_lo, value), (r_lo, rate)))
        hi, v_hi, r_hi = (np.where(left, a, b) for a, b in ((middle, hi), (value, v_hi), (rate, r_hi)))
    return met


def _first(times: Any, value: Any) -> float:
    bad = np.any(value <= Floats.zero, axis=0)
    return float(times[np.argmax(bad)]) if bad.any() else np.inf
