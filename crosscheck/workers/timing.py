"""One timer for everything that states a price: works timed in turns, the minimum of several rounds, and its spread.

Timed one after the other, works on a shared machine differ by half for no reason of their own; taken in turns, round by
round, each with its least time, they repeat to within a tenth, and ratios better. The collector of garbage is off while
a work runs. Numerical libraries should run on one thread (`OMP_NUM_THREADS=1` before the start).
"""

from __future__ import annotations

import gc
import math
import time
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field

ROUNDS = 7
"""How often each work gets its turn."""
AT_LEAST = 2e-3
"""What one turn lasts at least [s]: a work that is quicker is repeated within it."""


@dataclass(frozen=True)
class Timing:
    """What one call of a work costs.

    Attributes
    ----------
    seconds : float
        The least of all rounds [s]: what disturbs a measurement only ever adds to it.
    spread : float
        How far the median round lies above the least, as a part of it.
    turns : tuple of float
        One call in each round [s]: works that were timed together had their turns side by side.
    """

    seconds: float
    spread: float
    turns: tuple[float, ...] = field(default=(), repr=False)


def timed_in_turns(
    works: Mapping[str, Callable[[], object]],
    *,
    rounds: int = ROUNDS,
    at_least: float = AT_LEAST,
    within: float = math.inf,
) -> dict[str, Timing]:
    """Return what one call of each work costs.

    Parameters
    ----------
    works : mapping of str to callable
        Each is called once before it is timed.
    rounds : int
        How often each gets its turn.
    at_least : float
        What one turn lasts at least [s].
    within : float
        No round is begun after this long [s]; the first always is.
    """
    repeats = {name: _repeats(work, at_least) for name, work in works.items()}
    turns: dict[str, list[float]] = {name: [] for name in works}
    end = time.perf_counter() + within
    for k in range(rounds):
        if k and time.perf_counter() > end:
            break
        for name, work in works.items():
            turns[name].append(_turn(work, repeats[name]) / repeats[name])
    return {name: _timing(seconds) for name, seconds in turns.items()}


def _repeats(work: Callable[[], object], at_least: float) -> int:
    """Return how often a work is to be called in one turn; it is warm afterwards."""
    work()
    count = 1
    while (took := _turn(work, count)) < at_least:
        count = max(2 * count, math.ceil(count * at_least / max(took, 1e-9)))
    return count


def _turn(work: Callable[[], object], count: int) -> float:
    collecting = gc.isenabled()
    gc.disable()
    try:
        start = time.perf_counter()
        for _ in range(count):
            work()
        return time.perf_counter() - start
    finally:
        if collecting:
            gc.enable()


def _timing(seconds: list[float]) -> Timing:
    least, middle = min(seconds), sorted(seconds)[len(seconds) // 2]
    return Timing(seconds=least, spread=middle / least - 1.0, turns=tuple(seconds))
