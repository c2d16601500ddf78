"""One work, measured in this process: `python -m crosscheck.bench WORK FILE`; `run` starts it with one thread."""

from __future__ import annotations

import json
import sys
from pathlib import Path

from crosscheck.bench import works
from crosscheck.bench.measure import measured

if __name__ == "__main__":
    name, file = sys.argv[1:]
    # To a file: engines may write to standard output.
    Path(file).write_text(json.dumps(measured(works.work(name)), allow_nan=False), encoding="utf-8")
