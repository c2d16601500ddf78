"""What a first use costs: the import of refkin, and the program of a topology nobody has used yet."""

from __future__ import annotations

import contextlib
import subprocess
import sys
import time

from crosscheck.engines import EngineError
from crosscheck.engines.ours.lanes_methods import fast
from crosscheck.scenes.workloads import FourBars

ROUNDS = 5
LIBRARIES = "import numpy, scipy"
TIMED = "import time; start = time.perf_counter(); {}; print(time.perf_counter() - start)"


def first_use(work: FourBars) -> dict[str, float]:
    """Return seconds: `tape_seconds` to compile a four-bar, `import_seconds` beyond NumPy's and SciPy's own import.

    Both are the least of several rounds. What the import of refkin loads of NumPy and SciPy beyond their bare import
    counts as refkin's. The first is left out where there are no fast paths.
    """
    costs = {"import_seconds": import_seconds()}
    with contextlib.suppress(EngineError):
        costs["tape_seconds"] = tape_seconds(work)
    return costs


def tape_seconds(work: FourBars) -> float:
    """Return what it takes from a scene to a program that can be run."""
    fast()
    from refkin.fast.compiled import forget
    from refkin.fast.prepare import prepared

    scene, taken = work.scene(), []
    for _ in range(ROUNDS):
        forget()
        start = time.perf_counter()
        ready = prepared(scene)
        if ready is None:
            raise EngineError("there is no program for this scene")
        assert ready.made.program.counts()
        assert ready.made.march
        taken.append(time.perf_counter() - start)
    return min(taken)


def import_seconds() -> float:
    """Return what `import refkin` takes in processes of its own, after NumPy and SciPy are imported, in turns."""
    with_it, without = [], []
    for _ in range(ROUNDS):
        without.append(_timed(LIBRARIES))
        with_it.append(_timed(f"{LIBRARIES}, refkin"))
    return min(with_it) - min(without)


def _timed(statement: str) -> float:
    command = [sys.executable, "-c", TIMED.format(statement)]
    return float(subprocess.run(command, capture_output=True, text=True, check=True).stdout)
