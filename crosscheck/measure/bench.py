"""All methods of a workload, in turns, in one process: prices and errors, as rows of the JSON."""

from __future__ import annotations

import math
import os
import platform
from collections.abc import Iterable, Iterator, Mapping, Sequence
from importlib.metadata import PackageNotFoundError, version
from typing import Any

from crosscheck.engines import PEERS, QUANTITIES, EngineError
from crosscheck.engines.methods import OURS, Batch, Method, Use, methods
from crosscheck.engines.ours.c_kernels import compiler_version
from crosscheck.judge.workloads import Accuracy, of_chain, of_four_bars, of_spatial_loops
from crosscheck.scenes.workloads import LoopChain, Workload, workload
from crosscheck.scenes.workloads_space import SpatialLoops
from crosscheck.workers.timing import Timing, timed_in_turns

ROUNDS = 20
TURN = 0.03
"""What a turn lasts at least [s]: within it work is repeated, with caches as warm as in a program that uses it."""
SECONDS = 30.0
"""No round of a workload is begun after this long."""
PACKAGES = ("refkin", "numpy", "scipy", "exudyn", "pin", "mujoco")
PRODUCERS = (*OURS, *PEERS)
CONFIGURATION, NEWTON_ITERATION = "configuration", "newton-iteration"
Key = tuple[str, str, str]
"""Engine, method, setting."""


def measured(
    work: Workload, producers: Sequence[str] = PRODUCERS, rounds: int = ROUNDS, listed: Sequence[Method] | None = None
) -> dict[str, Any]:
    """Return rows, what is absent, versions and machine of one workload: what the JSON holds, for this workload.

    Parameters
    ----------
    work : Workload
    producers : sequence of str
        What `crosscheck.engines.methods.methods` takes.
    rounds : int
        How often each method is timed, in turns.
    listed : sequence of Method, optional
        The methods, if they are not all of the producers'.
    """
    absent: list[dict[str, Any]] = []
    entries = list(_entries(work, _listed(work, producers, absent) if listed is None else listed, absent))
    workloads = {str(k): batch.run for k, (_, batch) in enumerate(entries)}
    timings = timed_in_turns(workloads, rounds=rounds, at_least=TURN, within=SECONDS)
    rows = [row(work, *entry, timings[str(k)]) for k, entry in enumerate(entries)]
    return {"rows": rows, "absent": absent, "versions": versions(), "machine": machine()}


def _listed(work: Workload, producers: Sequence[str], absent: list[dict[str, Any]]) -> Iterator[Method]:
    for producer in producers:
        try:
            yield from methods(producer, Use.BENCH)
        except EngineError as error:
            absent.append(_absent(work, (producer, "any", ""), error))


def _entries(work: Workload, listed: Iterable[Method], absent: list[dict[str, Any]]) -> Iterator[tuple[Method, Batch]]:
    """Yield the methods that take a workload, for all quantities, and where it makes a difference for positions alone.

    A Newton iteration is one of positions.
    """
    for method in listed:
        alone = isinstance(work, LoopChain) or method.highest == 0
        orders = (0,) if alone else (method.highest,) if method.at_once else (method.highest, 0)
        for order in orders:
            try:
                yield method, method.batched(work, order)
            except EngineError as error:
                absent.append(_absent(work, method.key, error))
                break


def _absent(work: Workload, key: tuple[str, str, str], error: EngineError) -> dict[str, Any]:
    return {"workload": work.name, **dict(zip(("engine", "method", "setting"), key, strict=True)), "reason": str(error)}


def row(work: Workload, method: Method, batch: Batch, timing: Timing) -> dict[str, Any]:
    """Return a row of the JSON; an infinite error is null, and its row is not ranked.

    Parameters
    ----------
    work, method, batch, timing : Workload, Method, Batch, Timing
        What was asked of whom, its answers, and how long they took.
    """
    accuracy = accuracy_of(work, batch)
    engine, name, setting = method.key
    return {
        "workload": work.name,
        "engine": engine,
        "method": name,
        "setting": setting,
        "nanoseconds_per_configuration": timing.seconds / batch.count * 1e9,
        "unit": NEWTON_ITERATION if isinstance(work, LoopChain) else CONFIGURATION,
        "spread": timing.spread,
        "max_error": _finite(accuracy.max_error),
        "worst_over_allowed": _finite(accuracy.worst_over_allowed),
        "computes": list(QUANTITIES[: accuracy.levels]),
        "ranked": accuracy.ranked,
        "timed": batch.count,
        "compared": accuracy.configurations,
        "uncompared": accuracy.uncompared,
        "newton_by": method.newton_by,
        "note": "; ".join(filter(None, (method.note, batch.note))),
    }


def accuracy_of(work: Workload, batch: Batch) -> Accuracy:
    """Return how right the answers to a workload are."""
    if isinstance(work, LoopChain):
        return of_chain(work, batch.answers())
    if isinstance(work, SpatialLoops):
        return of_spatial_loops(work, batch.answers())
    return of_four_bars(work, batch.answers())


def versions() -> dict[str, str]:
    """Return what was measured with, by name."""
    by_package = {"python": platform.python_version()}
    for package in PACKAGES:
        try:
            by_package[package] = version(package)
        except PackageNotFoundError:
            by_package[package] = "absent"
    try:
        by_package["compiler"] = compiler_version()
    except EngineError:
        by_package["compiler"] = "absent"
    return by_package


def machine() -> dict[str, Any]:
    """Return what it was measured on."""
    return {
        "system": f"{platform.system()} {platform.machine()}",
        "processor": _processor(),
        "cores": os.cpu_count(),
        "threads": os.environ.get("OMP_NUM_THREADS", "not limited"),
    }


def _processor() -> str:
    """Return the processor's name as far as the system tells it without asking anybody else."""
    try:
        with open("/proc/cpuinfo", encoding="utf-8") as file:
            names = [line.split(":", 1)[1].strip() for line in file if line.startswith("model name")]
    except OSError:
        names = []
    return names[0] if names else platform.processor() or "unknown"


def _finite(x: float) -> float | None:
    return x if math.isfinite(x) else None


def merged(parts: Iterable[dict[str, Any]]) -> dict[str, Any]:
    """Return the results of several workloads as one."""
    parts = list(parts)
    return {**parts[-1], **{key: [row for part in parts for row in part[key]] for key in ("rows", "absent")}}


def key_of(row: Mapping[str, Any]) -> Key:
    """Return engine, method and setting of a row."""
    return row["engine"], row["method"], row["setting"]


def measured_by_name(asked: tuple[str, Sequence[str]]) -> dict[str, Any]:
    """Return the results of one workload for some producers: what a process of its own does."""
    name, producers = asked
    return measured(workload(name), producers)
