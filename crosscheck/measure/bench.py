"""All methods of a workload, in turns, in one process: prices and errors, as rows of the JSON.

An engine that is none of ours and no peer is asked once before, in a process without the others: it may raise, crash or
hang, and none of their rows is lost with it.
"""

from __future__ import annotations

import math
import os
from collections.abc import Collection, Iterable, Iterator, Mapping, Sequence
from typing import Any

from crosscheck.engines import PEERS, QUANTITIES, EngineError
from crosscheck.engines.methods import Batch, Method, Use, methods
from crosscheck.engines.ours.c_kernels import compiler_version
from crosscheck.judge.workloads import Accuracy, of_chain, of_four_bars, of_spatial_loops
from crosscheck.measure.price_process import Key, any_of
from crosscheck.scenes.names import OURS
from crosscheck.scenes.workloads import LoopChain, Workload, workload
from crosscheck.scenes.workloads_space import SpatialLoops
from crosscheck.workers.processes import Failure, FailureKind, call_each, call_in_turn
from crosscheck.workers.timing import Timing, machine, timed_in_turns, versions

ROUNDS = 20
TURN = 0.03
"""What a turn lasts at least [s]: within it work is repeated, with caches as warm as in a program that uses it."""
SECONDS = 30.0
"""No round of a workload is begun after this long."""
PATIENCE = 120.0
"""How long a method that is asked once may take for a workload [s], both orders together."""
SECONDS_PER_WORKLOAD = 600.0
PRODUCERS = (*OURS, *PEERS)
CONFIGURATION, NEWTON_ITERATION = "configuration", "newton-iteration"


def measured(
    work: Workload,
    producers: Sequence[str] = PRODUCERS,
    rounds: int = ROUNDS,
    listed: Sequence[Method] | None = None,
    without: Collection[Key] = (),
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
    without : collection of Key
        Those of them that are left out.
    """
    absent: list[dict[str, Any]] = []
    asked = _listed(work, producers, absent) if listed is None else listed
    entries = list(_entries(work, (method for method in asked if method.key not in without), absent))
    workloads = {str(k): batch.run for k, (_, batch) in enumerate(entries)}
    timings = timed_in_turns(workloads, rounds=rounds, at_least=TURN, within=SECONDS)
    rows = [row(work, *entry, timings[str(k)]) for k, entry in enumerate(entries)]
    made_on = {**machine(), "threads": os.environ.get("OMP_NUM_THREADS", "not limited")}
    return {"rows": rows, "absent": absent, "versions": {**versions(), "compiler": compiler()}, "machine": made_on}


def _listed(work: Workload, producers: Sequence[str], absent: list[dict[str, Any]]) -> Iterator[Method]:
    for producer in producers:
        try:
            yield from methods(producer, Use.BENCH)
        except EngineError as error:
            absent.append(_absent(work.name, any_of(producer), str(error)))


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
                absent.append(_absent(work.name, method.key, str(error)))
                break


def _absent(workload: str, key: Key, reason: str) -> dict[str, Any]:
    return {"workload": workload, **dict(zip(("engine", "method", "setting"), key, strict=True)), "reason": reason}


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


def compiler() -> str:
    """Return which compiler made what is of C."""
    try:
        return compiler_version()
    except EngineError:
        return "absent"


def _finite(x: float) -> float | None:
    return x if math.isfinite(x) else None


def merged(parts: Iterable[dict[str, Any]]) -> dict[str, Any]:
    """Return the results of several workloads as one."""
    parts = list(parts)
    return {**parts[-1], **{key: [row for part in parts for row in part[key]] for key in ("rows", "absent")}}


def key_of(row: Mapping[str, Any]) -> Key:
    """Return engine, method and setting of a row."""
    return row["engine"], row["method"], row["setting"]


def measured_by_name(asked: tuple[str, Sequence[str], Collection[Key]]) -> dict[str, Any]:
    """Return the results of one workload for some producers, without some methods: what a process of its own does."""
    name, producers, without = asked
    return measured(workload(name), producers, without=without)


def keys_of(spec: str) -> list[Key]:
    """Return engine, name and setting of an engine's methods; none if it is not there: why, is said with the rows."""
    try:
        return [method.key for method in methods(spec, Use.BENCH)]
    except EngineError:
        return []


def tried(asked: tuple[str, str, Key]) -> str:
    """Have a method answer a workload once; return why it does not, if it says so.

    Asked with the workload's name, what `crosscheck.engines.methods.methods` takes, and the method's key.
    """
    name, spec, key = asked
    work = workload(name)
    method = next(one for one in methods(spec, Use.BENCH) if one.key == key)
    try:
        for _, batch in _entries(work, [method], []):
            batch.run()
            accuracy_of(work, batch)
    except EngineError as error:
        return str(error)
    return ""


def measured_apart(
    name: str, producers: Sequence[str], hung: dict[Key, str], patience: float = PATIENCE
) -> dict[str, Any] | Failure:
    """Return the results of one workload, measured in another process; a Failure if ours or a peer ends that.

    A method of any other engine that fails is absent. So are all of these if they fail only beside others.

    Parameters
    ----------
    name : str
        The workload's.
    producers : sequence of str
        What `crosscheck.engines.methods.methods` takes.
    hung : dict
        What hung at workloads before, and why it is not asked again; what hangs at this one is added.
    patience : float
        How long one method may take to answer once [s].
    """
    absent = dict(hung)
    own = [spec for spec in producers if spec not in PRODUCERS and any_of(spec) not in hung]
    listed = dict(zip(own, call_each(keys_of, own), strict=True))
    there = {spec: keys for spec, keys in listed.items() if not isinstance(keys, Failure)}
    asked = [(name, spec, key) for spec, keys in there.items() for key in keys if key not in hung]
    found = [(any_of(spec), why) for spec, why in listed.items() if spec not in there]
    found += zip((key for *_, key in asked), call_in_turn(tried, asked, patience), strict=True)
    for key, why in found:
        if why:
            absent[key] = why.text if isinstance(why, Failure) else why
        if isinstance(why, Failure) and why.kind is FailureKind.HANG:
            hung[key] = f"not asked again: {why.text}, at {name}"
    while True:
        loaded = [producer for producer in producers if any_of(producer) not in absent]
        (part,) = call_each(measured_by_name, [(name, loaded, {*absent})], SECONDS_PER_WORKLOAD)
        left = [key for *_, key in asked if key not in absent]
        if not isinstance(part, Failure):
            rows = [_absent(name, key, reason) for key, reason in absent.items()]
            return {**part, "absent": part["absent"] + rows}
        if not left:
            return part
        absent |= dict.fromkeys(left, f"beside others: {part.text}")
