"""All routes of a work, in turns, in one process: prices and errors, as rows of the JSON."""

from __future__ import annotations

import math
import os
import platform
from collections.abc import Callable, Iterable
from importlib.metadata import PackageNotFoundError, version
from typing import Any

from crosscheck.engines.batch_route import Absent, Route
from crosscheck.engines.ours import c_batch as c_routes
from crosscheck.engines.ours import chain_batch as chain_routes
from crosscheck.engines.ours import numpy_batch as numpy_routes
from crosscheck.engines.ours import own_batch as own_routes
from crosscheck.engines.ours.c_kernels import Kernels, NoKernel, compiler_version
from crosscheck.measure.bench_aims import reached
from crosscheck.scenes.works import Chain, FourBars, Work
from crosscheck.workers.timing import Timing, timed_in_turns

ROUNDS = 20
TURN = 0.03
"""What a turn lasts at least [s]: within it a work is repeated, from caches as warm as a program has them that uses it.
"""
SECONDS = 30.0
"""No round of a work is begun after this long."""
PACKAGES = ("refkin", "numpy", "scipy", "exudyn", "pin", "mujoco")
Builder = Callable[[Any, Kernels], Route]


def builders(work: Work) -> dict[str, Builder]:
    """Return the routes of a work by name, in the order of the table where nothing is measured."""
    if isinstance(work, Chain):
        return chain_routes.BUILDERS
    return {
        "refkin-lanes": lambda w, _: own_routes.lanes(w),
        "refkin-lanes-position": lambda w, _: own_routes.lanes_position(w),
        "refkin-lanes-certificate": lambda w, _: own_routes.lanes_certificate(w),
        "refkin-reference": lambda w, _: own_routes.reference(w),
        "c-same-tape": c_routes.same_tape,
        "c-dense": c_routes.dense,
        "c-closed-form": c_routes.closed_form,
        "exudyn": _engine("exudyn", "four_bars"),
        "exudyn-position": _engine("exudyn", "positions"),
        "pinocchio": _engine("pinocchio", "four_bars"),
        "mujoco": _engine("mujoco", "four_bars"),
        "scipy-root": lambda w, _: numpy_routes.scipy_root(w),
        "numpy-closed-form": lambda w, _: numpy_routes.closed_form(w),
    }


def measured(work: Work, routes: dict[str, Builder] | None = None, rounds: int = ROUNDS) -> dict[str, Any]:
    """Return rows, absent routes, versions and machine of one work: what the JSON holds, for this work.

    Parameters
    ----------
    routes : dict, optional
        Name -> builder; all of the work's by default.
    """
    found: list[Route] = []
    absent = []
    with Kernels() as kernels:
        for name, builder in (builders(work) if routes is None else routes).items():
            try:
                found.append(builder(work, kernels))
            except Absent as error:
                absent.append({"work": work.name, "route": name, "reason": str(error)})
        timings = timed_in_turns({r.name: r.run for r in found}, rounds=rounds, at_least=TURN, within=SECONDS)
        rows = [row(work, route, timings[route.name]) for route in found]
    return {"rows": rows, "absent": absent, "versions": versions(), "machine": machine()}


def row(work: Work, route: Route, timing: Timing) -> dict[str, Any]:
    """Return a row of the JSON; an infinite error is null, and its row is not ranked."""
    accuracy = route.accuracy()
    return {
        "work": work.name,
        "route": route.name,
        "nanoseconds_per_configuration": timing.seconds / route.count * 1e9,
        "unit": route.unit,
        "spread": timing.spread,
        "max_error": _finite(accuracy.max_error),
        "worst_over_allowed": _finite(accuracy.worst_over_allowed),
        "computes": list(route.computes),
        "ranked": accuracy.ranked,
        "timed": route.count,
        "judged": accuracy.configurations,
        "unjudged": accuracy.unjudged,
        "driven_by": route.driven_by,
        "what": route.what,
    }


def versions() -> dict[str, str]:
    """Return what was measured with, by name."""
    found = {"python": platform.python_version()}
    for package in PACKAGES:
        try:
            found[package] = version(package)
        except PackageNotFoundError:
            found[package] = "absent"
    try:
        found["compiler"] = compiler_version()
    except NoKernel:
        found["compiler"] = "absent"
    return found


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


def _engine(name: str, function: str) -> Builder:
    """Return the builder of an engine's route, which is absent where the engine is not installed."""

    def build(work: FourBars, _: Kernels) -> Route:
        module = engine_module(name)
        made: Route = getattr(module, function)(work)
        return made

    return build


def engine_module(name: str) -> Any:
    """Return the module of an engine's routes.

    Raises
    ------
    Absent
        If the engine is not installed.
    """
    from importlib import import_module

    try:
        return import_module(f"crosscheck.engines.{name}.batch")
    except ImportError as error:
        raise Absent(f"{name} is not installed: {error}") from error


def merged(parts: Iterable[dict[str, Any]]) -> dict[str, Any]:
    """Return the results of several works as one."""
    parts = list(parts)
    last = parts[-1]
    rows = [r for part in parts for r in part["rows"]]
    absent = [a for part in parts for a in part["absent"]]
    first = [part["first_use"] for part in parts if "first_use" in part]
    whole = {"rows": rows, "absent": absent, "versions": last["versions"], "machine": last["machine"]}
    if first:
        whole["first_use"] = first[0]
    return {**whole, "aims": reached(whole)}
