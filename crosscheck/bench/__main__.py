"""One work, measured in this process: `python -m crosscheck.bench WORK FILE`; `run` starts it with one thread."""

from __future__ import annotations

import json
import sys
from pathlib import Path

from crosscheck.bench import works
from crosscheck.bench.first_use import first_use
from crosscheck.bench.measure import measured

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
