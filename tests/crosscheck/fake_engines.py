"""Engines written to a file for one test, and the command line run as a person runs it."""

from __future__ import annotations

import os
import signal
import subprocess
import sys
from collections.abc import Iterator, Mapping, Sequence
from pathlib import Path
from typing import Any

from crosscheck.judge.records import Record, plain, read_line
from crosscheck.measure.check import key_of
from crosscheck.scenes.drawing import describe, draw
from refkin.scenes.files import to_dict

SOURCE = '''
import ctypes, os, signal, time
from dataclasses import replace
from pathlib import Path
import numpy as np
import refkin
from crosscheck.measure.check import key_of, restated
from crosscheck.engines import ELEMENTS, NATIVE, EngineError, Level
from refkin.motion import Producer, Route, Seeding, Status

ROUTE = Route(name="made up", residual_by="test", jacobian_by="test", newton_by="test", linear_solve_by="test",
              drift_by="test", seeding=Seeding.NONE)


class Fake:
    """Answers with the reference's own answer, but for what a test wants of it."""

    name = "{name}"
    api = (1, 0)

    def version(self):
        return "1"

    def routes(self):
        return [ROUTE]

    def capabilities(self):
        return {{key: {{Level.SOLVE: NATIVE}} for key in ELEMENTS}}

    def terms(self, scene, route=None):
        return ()

    def solve(self, scene, route=None):
        key = key_of(scene)
        {before}
        motion = replace(refkin.solve(scene), producer=Producer(name=self.name, version="1", route=ROUTE))
        {after}
        return motion
'''
SEGFAULT = "ctypes.string_at(0)"
EXIT = "os._exit(7)"
HANG = "ctypes.PyDLL(None).pause()  # in C, and no other thread of Python runs"
RAISE = 'raise ZeroDivisionError("by the test")'
SHIFT = "motion = replace(motion, q=motion.q + 1e-6)"


def engine_file(folder: Path, *, name: str = "fake", before: str = "pass", after: str = "pass") -> str:
    """Write an engine that does something before it solves and after; return what `load` takes for it."""
    path = folder / f"{name}.py"
    path.write_text(SOURCE.format(name=name, before=before, after=after), encoding="utf-8")
    return f"{path}:Fake"


def jobs(night: int, count: int, samples: int = 6) -> list[dict[str, Any]]:
    """Return the first scenes of a night, at few times, as workers take them."""
    drawn = [draw(night, number, samples) for number in range(count)]
    return [{"scene": to_dict(d.scene), "about": {**describe(d), "shard": k}} for k, d in enumerate(drawn)]


def drained(pool: Any, todo: Sequence[Any] = (), batch: int = 1) -> Iterator[Any]:
    """Submit jobs in batches, if there are any, and yield all results that are still to come."""
    for k in range(0, len(todo), batch):
        pool.submit(todo[k : k + batch])
    while pool.pending:
        yield from pool.results()


def key_of_drawn(night: int, number: int, samples: int = 6) -> str:
    return key_of(draw(night, number, samples).scene)


def settled(record: Any) -> dict[str, Any]:
    """Return a record as plain data without how long things took."""
    record = plain(record) if isinstance(record, Record) else record
    reference = {k: v for k, v in record["reference"].items() if k != "seconds"}
    answers = [{k: v for k, v in a.items() if k != "seconds"} for a in record["answers"]]
    return {**record, "reference": reference, "answers": answers}


def kinds(actual: Any) -> list[str]:
    """Return the kinds of disagreements of a plain record as they are shown."""
    return [d["kind"] + (f" ({d['how']})" if d["how"] else "") for d in actual]


def records_of(out: Path) -> dict[str, dict[str, Any]]:
    """Return the records of a run by key, and fail if a key is there twice."""
    lines = (out / "records.jsonl").read_text(encoding="utf-8").splitlines()
    records = [read_line(line) for line in lines]
    by_key = {record.key: settled(record) for record in records}
    assert len(by_key) == len(records)
    return by_key


def command(*arguments: Any) -> list[str]:
    return [sys.executable, "-c", "from crosscheck.__main__ import main; main()", *map(str, arguments)]


def crosscheck(*arguments: Any, env: Mapping[str, str] | None = None) -> subprocess.CompletedProcess[str]:
    """Run the command line to its end."""
    whole = {**os.environ, **(env or {})}
    return subprocess.run(command(*arguments), capture_output=True, text=True, timeout=100, env=whole, check=False)


def hear_interrupts() -> None:
    for number in (signal.SIGINT, signal.SIGHUP):
        signal.signal(number, signal.SIG_DFL)


def start(*arguments: Any) -> subprocess.Popen[str]:
    """Start the command line in a group of its own that hears Ctrl-C, as a terminal does.

    A suite that was itself started in the background, or by `nohup`, ignores such signals and would hand that on.
    """
    streams = {"stdout": subprocess.PIPE, "stderr": subprocess.PIPE, "text": True, "preexec_fn": hear_interrupts}
    return subprocess.Popen(command(*arguments), start_new_session=True, **streams)  # type: ignore[call-overload, no-any-return]


def alive(pids: Sequence[int]) -> list[int]:
    """Return which of some processes run; one that only waits to be collected does not."""
    rows = []
    for pid in pids:
        try:
            state = Path(f"/proc/{pid}/stat").read_text(encoding="utf-8").rsplit(")", 1)[1].split()[0]
        except OSError:
            continue
        if state != "Z":
            rows.append(pid)
    return rows
