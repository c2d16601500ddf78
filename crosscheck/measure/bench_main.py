"""One work, here: `python -m crosscheck.measure.bench_main WORK FILE`, which `run` starts with one thread."""

from __future__ import annotations

import json
import sys
from pathlib import Path

from crosscheck.measure.bench import measured
from crosscheck.measure.bench_first_use import first_use
from crosscheck.scenes import works

FIRST_USE = "sweep-1000"
"""The work beside which the costs of a first use are measured."""

if __name__ == "__main__":
    name, file = sys.argv[1:]
    work = works.work(name)
    results = measured(work)
    if name == FIRST_USE:
        assert isinstance(work, works.FourBars)
        results["first_use"] = first_use(work)
    # To a file: engines may write to standard output.
    Path(file).write_text(json.dumps(results, allow_nan=False), encoding="utf-8")
