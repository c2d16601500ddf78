"""`crosscheck bench`: every work in a process of its own, on one thread; JSON, or tables."""

from __future__ import annotations

import json
import os
import subprocess
import sys
import tempfile
from collections.abc import Sequence
from pathlib import Path
from typing import Any

from rich.console import Console

from crosscheck.commands.bench_shown import print_results
from crosscheck.measure.bench import merged
from crosscheck.scenes import works

DONE, USAGE, INFRASTRUCTURE = 0, 2, 4
THREADS = (
    "OMP_NUM_THREADS",
    "OPENBLAS_NUM_THREADS",
    "MKL_NUM_THREADS",
    "BLIS_NUM_THREADS",
    "VECLIB_MAXIMUM_THREADS",
    "NUMEXPR_NUM_THREADS",
)
"""What numerical libraries read, once, when they are loaded."""
SECONDS_PER_WORK = 600.0
LINES = 5
"""How much is told of a process that failed."""


class Failed(Exception):
    """A work whose process failed; the message says how."""


def run(only: Sequence[str], as_json: bool) -> int:
    """Measure works, by default all, and print the results; return the exit code."""
    unknown = [name for name in only if name not in works.names()]
    if unknown:
        print(f"--only: no work is called {unknown[0]!r}; there are: {', '.join(works.names())}", file=sys.stderr)
        return USAGE
    parts = []
    for name in only or works.names():
        print(f"{name} ...", file=sys.stderr, flush=True)
        try:
            parts.append(measured_apart(name))
        except Failed as error:
            print(error, file=sys.stderr)
            return INFRASTRUCTURE
    results = merged(parts)
    if as_json:
        print(json.dumps(results, indent=1))
    else:
        print_results(results, Console(width=None if sys.stdout.isatty() else 180))
    return DONE


def measured_apart(name: str) -> dict[str, Any]:
    """Return the results of one work, measured in a process of its own on one thread.

    Raises
    ------
    Failed
        If it ends without results or takes too long.
    """
    with tempfile.TemporaryDirectory(prefix="crosscheck-bench-") as folder:
        file = Path(folder) / "results.json"
        command = [sys.executable, "-m", "crosscheck.measure.bench_main", name, str(file)]
        environment = {**os.environ, **dict.fromkeys(THREADS, "1"), "MUJOCO_GL": "disable"}
        try:
            told = subprocess.run(
                command, env=environment, capture_output=True, text=True, check=False, timeout=SECONDS_PER_WORK
            )
        except subprocess.TimeoutExpired as error:
            raise Failed(f"{name}: not done after {SECONDS_PER_WORK:.0f} s") from error
        if told.returncode or not file.exists():
            last = "\n".join(told.stderr.strip().splitlines()[-LINES:])
            raise Failed(f"{name}: its process ended with code {told.returncode}\n{last}")
        found: dict[str, Any] = json.loads(file.read_text(encoding="utf-8"))
        return found
