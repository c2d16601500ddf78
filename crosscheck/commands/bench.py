"""The command `crosscheck bench`: every workload in a process of its own, on one thread; JSON, or tables."""

from __future__ import annotations

import json
import os
import subprocess
import sys
import tempfile
from collections.abc import Sequence
from pathlib import Path
from typing import Annotated, Any

from cyclopts import Parameter

from crosscheck.commands.engines import ENGINES, names
from crosscheck.commands.usage import Json, console
from crosscheck.errors import INFRASTRUCTURE, PASS, USAGE

THREADS = (
    "OMP_NUM_THREADS",
    "OPENBLAS_NUM_THREADS",
    "MKL_NUM_THREADS",
    "BLIS_NUM_THREADS",
    "VECLIB_MAXIMUM_THREADS",
    "NUMEXPR_NUM_THREADS",
)
"""What numerical libraries read, once, when they are loaded."""
SECONDS_PER_WORKLOAD = 600.0
LINES = 5
"""How much is said of a process that failed."""


def bench(
    *,
    only: Annotated[list[str] | None, Parameter(negative="")] = None,
    engines: str = ENGINES,
    as_json: Json = False,
) -> int:
    """Measure this project's time and error against C, the engines, SciPy and the closed form, on one thread.

    Exit codes: 0 done, 2 there is no workload of that name, 4 a workload could not be measured.

    Parameters
    ----------
    only
        A workload, such as sweep-1000; may be given more than once. All by default, which takes some minutes.
    engines
        Names, separated by commas, or `file.py:Class`.
    as_json
        Print one JSON object instead of tables.
    """
    from crosscheck.commands.bench_shown import print_results  # here, because no other command needs it
    from crosscheck.engines.methods import OURS
    from crosscheck.measure.bench import merged
    from crosscheck.scenes import workloads

    unknown = [name for name in only or () if name not in workloads.names()]
    if unknown:
        there = ", ".join(workloads.names())
        print(f"--only: no workload is called {unknown[0]!r}; there are: {there}", file=sys.stderr)
        return USAGE
    producers, parts = (*OURS, *names(engines, always=())), []
    for name in only or workloads.names():
        print(f"{name} ...", file=sys.stderr, flush=True)
        try:
            parts.append(measured_apart(name, producers))
        except Failed as error:
            print(error, file=sys.stderr)
            return INFRASTRUCTURE
    results = merged(parts)
    if as_json:
        print(json.dumps(results, indent=1))
    else:
        print_results(results, console(180))
    return PASS


class Failed(Exception):
    """A workload whose process failed; the message says how."""


def measured_apart(name: str, producers: Sequence[str]) -> dict[str, Any]:
    """Return the results of one workload, measured in a process of its own on one thread.

    Raises
    ------
    Failed
        If it ends without results or takes too long.
    """
    with tempfile.TemporaryDirectory(prefix="crosscheck-bench-") as folder:
        file = Path(folder) / "results.json"
        command = [sys.executable, "-m", "crosscheck.measure.bench", name, str(file), *producers]
        environment = {**os.environ, **dict.fromkeys(THREADS, "1"), "MUJOCO_GL": "disable"}
        try:
            ended = subprocess.run(
                command, env=environment, capture_output=True, text=True, check=False, timeout=SECONDS_PER_WORKLOAD
            )
        except subprocess.TimeoutExpired as error:
            raise Failed(f"{name}: not done after {SECONDS_PER_WORKLOAD:.0f} s") from error
        if ended.returncode or not file.exists():
            last = "\n".join(ended.stderr.strip().splitlines()[-LINES:])
            raise Failed(f"{name}: its process ended with code {ended.returncode}\n{last}")
        found: dict[str, Any] = json.loads(file.read_text(encoding="utf-8"))
        return found
