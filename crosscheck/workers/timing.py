"""One timer for everything that states a price: work timed in turns, the minimum of several rounds, and its spread.

Timed one after the other, pieces of work on a shared machine differ by half for no reason of their own; taken in turns,
round by round, each with its least time, they repeat to within a tenth, and ratios better. Whoever comes after another
engine finds caches that are the other's: so each turn begins with a call that is not timed, but where a call is so long
that this is nothing. Time is that of the processor: what it does for others meanwhile is not counted. Numerical
libraries should run on one thread (`OMP_NUM_THREADS=1` before the start). The collector of garbage is off while work
runs.
"""

from __future__ import annotations

import gc
import math
import os
import platform
import time
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from importlib.metadata import PackageNotFoundError, version
from typing import Any

ROUNDS = 7
"""How often each gets its turn."""
AT_LEAST = 2e-3
"""What one turn lasts at least [s]: work that is quicker is repeated within it."""
LONG = 0.05
"""From here on a call needs none before it that is not timed [s]: cold caches cost some tenths of a millisecond."""

PACKAGES = ("refkin", "numpy", "scipy", "exudyn", "pin", "mujoco")
"""Whose versions are told with what was measured."""


@dataclass(frozen=True)
class Timing:
    """What one call costs: the least of all rounds [s], since what disturbs a measurement only ever adds to it.

    `spread` is how far the median round lies above it, as a part of it; `turns` are one call in each round [s], in
    which all that is timed together was called one after another.
    """

    seconds: float
    spread: float
    turns: tuple[float, ...] = field(default=(), repr=False)


def timed_in_turns(
    workloads: Mapping[str, Callable[[], object]],
    *,
    rounds: int = ROUNDS,
    fewest: int = 1,
    at_least: float = AT_LEAST,
    within: float = math.inf,
    known: Mapping[str, float] | None = None,
    clock: Callable[[], float] | None = None,
) -> dict[str, Timing]:
    """Return what one call of each costs.

    Parameters
    ----------
    workloads : mapping of str to callable
        Each is called before it is timed.
    rounds : int
        How often each gets its turn.
    fewest : int
        How many rounds there are however long they take.
    at_least : float
        What one turn lasts at least [s].
    within : float
        No other round is begun after this long [s].
    known : mapping of str to float, optional
        What a call takes, about, where that is known already [s].
    clock : callable, optional
        By what `within` is measured; by default the clock on the wall.
    """
    known = known or {}
    repeats = {name: _repeats(work, at_least, known.get(name)) for name, work in workloads.items()}
    turns: dict[str, list[float]] = {name: [] for name in workloads}
    clock = clock or time.perf_counter
    end = clock() + within
    for k in range(rounds):
        if k >= fewest and clock() > end:
            break
        for name, work in workloads.items():
            count, long = repeats[name]
            if not long:
                work()
            turns[name].append(turn(work, count) / count)
    timings = {}
    for name, seconds in turns.items():
        least, middle = min(seconds), sorted(seconds)[len(seconds) // 2]
        timings[name] = Timing(seconds=least, spread=middle / least - 1.0, turns=tuple(seconds))
    return timings


def seconds_of(process: int) -> float | None:
    """Return the processor time of another process by its id [s]; None where the system does not say (not Linux)."""
    try:
        return time.clock_gettime((~process << 3) | 2)  # what clock_getcpuclockid makes of an id
    except (AttributeError, OSError):
        return None


def _repeats(work: Callable[[], object], at_least: float, known: float | None) -> tuple[int, bool]:
    """Return how often work is to be called in one turn, and whether a call is long."""
    if known is not None:
        return max(1, math.ceil(at_least / max(known, 1e-9))), known >= LONG
    work()
    count = 1
    while (took := turn(work, count)) < at_least:
        count = max(2 * count, math.ceil(count * at_least / max(took, 1e-9)))
    return count, took / count >= LONG


def turn(work: Callable[[], object], count: int = 1) -> float:
    """Return what so many calls take of the processor [s], while nobody collects garbage."""
    collecting = gc.isenabled()
    gc.disable()
    try:
        start = time.process_time()
        for _ in range(count):
            work()
        return time.process_time() - start
    finally:
        if collecting:
            gc.enable()


def versions() -> dict[str, str]:
    """Return what was measured with, by name."""
    by_package = {"python": platform.python_version()}
    for package in PACKAGES:
        try:
            by_package[package] = version(package)
        except PackageNotFoundError:
            by_package[package] = "absent"
    return by_package


def machine() -> dict[str, Any]:
    """Return what it was measured on."""
    return {"system": f"{platform.system()} {platform.machine()}", "processor": _processor(), "cores": os.cpu_count()}


def _processor() -> str:
    """Return the processor's name as far as the system tells it without asking anybody else."""
    try:
        with open("/proc/cpuinfo", encoding="utf-8") as file:
            names = [line.split(":", 1)[1].strip() for line in file if line.startswith("model name")]
    except OSError:
        names = []
    return names[0] if names else platform.processor() or "unknown"
