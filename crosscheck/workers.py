"""Worker processes: engines may crash or hang on a scene, and take only their own process with them.

Batches go out, records come in. A batch that dies or takes too long is sent again scene by scene; a scene that fails alone a
second time is tried with one engine at a time, so that the engine that fails on it is known by name.
"""

from __future__ import annotations

import multiprocessing
import os
from collections.abc import Iterator, Mapping, Sequence
from concurrent.futures import FIRST_COMPLETED, wait
from concurrent.futures import TimeoutError as FutureTimeout
from dataclasses import dataclass, field
from typing import Any

from pebble import ProcessExpired, ProcessFuture, ProcessPool

Job = Mapping[str, Any]
"""A scene as the data of its file under `scene`, and what the generator knows of it under `about`."""


@dataclass(frozen=True)
class Task:
    """Jobs to be done together, with which engines, and how often they failed before."""

    jobs: tuple[Job, ...]
    engines: tuple[str, ...]
    failures: int = 0


def check_batch(jobs: Sequence[Job], engines: Sequence[str]) -> list[dict[str, Any]]:
    """Return one record per job; runs in a worker."""
    from crosscheck.check import check
    from crosscheck.engines import load
    from refkin.scene_files import parse

    loaded = [load(name) for name in engines]
    return [check(parse(job["scene"]), loaded, job["about"]) for job in jobs]


@dataclass
class Workers:
    """A pool of worker processes; use it as a context manager.

    Parameters
    ----------
    count : int
        How many processes.
    seconds_per_scene : float
        After this long per scene a batch is ended.
    """

    count: int
    seconds_per_scene: float = 20.0
    pool: ProcessPool = field(init=False)
    pending: dict[ProcessFuture, Task] = field(init=False, default_factory=dict)

    def __enter__(self) -> Workers:
        for name in ("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS", "MKL_NUM_THREADS"):
            os.environ[name] = "1"  # the workers are the parallelism; read by NumPy when the server imports it
        context = multiprocessing.get_context("forkserver")
        context.set_forkserver_preload(["crosscheck.check"])
        self.pool = ProcessPool(max_workers=self.count, context=context)
        return self

    def __exit__(self, *_: object) -> None:
        self.pool.stop()
        self.pool.join()

    @property
    def hungry(self) -> bool:
        """Whether a worker may soon be idle."""
        return len(self.pending) < 2 * self.count

    def submit(self, task: Task) -> None:
        """Send a task to the pool."""
        limit = 30.0 + self.seconds_per_scene * len(task.jobs)
        future = self.pool.schedule(check_batch, args=(task.jobs, task.engines), timeout=limit)
        self.pending[future] = task

    def results(self) -> Iterator[dict[str, Any]]:
        """Wait until some task ends and yield its records; failed tasks are sent again in smaller parts."""
        done, _ = wait(self.pending, return_when=FIRST_COMPLETED)
        for future in done:
            task = self.pending.pop(future)
            failure = future.exception()
            if failure is None:
                yield from future.result()
            elif len(task.jobs) > 1 or task.failures == 0:
                for job in task.jobs:
                    self.submit(Task((job,), task.engines, task.failures + 1))
            else:
                yield self.check_alone(task.jobs[0], task.engines)

    def check_alone(self, job: Job, engines: tuple[str, ...]) -> dict[str, Any]:
        """Return the record of one scene, each engine in its turn, so that one that fails is known by name."""
        record = self._attempt(job, ())
        if isinstance(record, _Failure):
            return {**_bare(job), "failure": f"the reference itself: {record.text}"}
        for engine in engines:
            part = self._attempt(job, (engine,))
            if isinstance(part, _Failure):
                told = {"engine": engine, "route": "any", "quantity": "status", "kind": part.kind}
                record["disagreements"].append({**told, "ratio": None, "worst": part.text})
            else:
                for key in ("answers", "levels", "refusals"):
                    record[key] += part[key]
                record["disagreements"] += [d for d in part["disagreements"] if d["engine"] == engine]
        return record

    def _attempt(self, job: Job, engines: tuple[str, ...]) -> dict[str, Any] | _Failure:
        """Return the record of one scene with the given engines, or how the worker failed."""
        limit = 30.0 + self.seconds_per_scene
        future = self.pool.schedule(check_batch, args=((job,), engines), timeout=limit)
        failure = future.exception()
        return future.result()[0] if failure is None else _Failure(_kind(failure), f"{failure}")


@dataclass(frozen=True)
class _Failure:
    """How a worker failed on a scene: crash, hang or an error, and what it said."""

    kind: str
    text: str


def _kind(failure: BaseException) -> str:
    if isinstance(failure, ProcessExpired):
        return f"crash (exit code {failure.exitcode})"
    return "hang" if isinstance(failure, FutureTimeout | TimeoutError) else f"error {type(failure).__name__}"


def _bare(job: Job) -> dict[str, Any]:
    from crosscheck.check import key_of
    from refkin.scene_files import parse

    scene = parse(job["scene"])
    nothing: dict[str, Any] = {"answers": [], "levels": [], "refusals": [], "disagreements": []}
    return {"key": key_of(scene), "scene": scene.name, "about": dict(job["about"]), **nothing}

