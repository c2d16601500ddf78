"""Scenes for the workers of a Dask cluster: the same batches, the same isolation of engines, on more than one machine.

A worker of the cluster checks a batch in an embedded child process of its own (`crosscheck.workers.pool`), so that an
engine that crashes or hangs takes neither the worker nor the batch with it. A worker that ends in the middle of a
batch has it done again elsewhere: a scene may be checked twice, and its first record counts
(`crosscheck.night.plan`).

Workers need `distributed.worker.daemon` to be false, or they may have no children; a local cluster is started that way.
"""

from __future__ import annotations

import logging
import threading
import time
from collections.abc import Iterable, Iterator, Mapping, Sequence
from contextlib import ExitStack
from functools import lru_cache
from typing import Any

from crosscheck.errors import CannotRun
from crosscheck.workers.pool import (
    LONGEST_WAIT,
    MOST_KILLS,
    SECONDS_PER_SCENE,
    Job,
    Pool,
    Work,
    Workers,
    name_and_version,
)
from crosscheck.workers.processes import Failure, call_each
from crosscheck.workers.source import SOURCE, digest, files_of

LOCAL = "local"
BATCH = 100
"""Scenes in a batch: some ten seconds of work, a thousand times what handing it over takes."""
SECONDS_TO_CONNECT = 20.0
"""After this long without a scheduler, or without one worker, there is no cluster."""
Batch = tuple[list[Any], list[str]]
"""The records of a batch, and failures that were none when their scenes were taken apart."""


class NoCluster(CannotRun):
    """The cluster that was asked for is not there, is not fit for the work, or was lost in the middle of it."""


class ClusterWorkers(Pool):
    """The workers of a Dask cluster; a context manager.

    NoCluster if there is no such cluster, or one of its workers has other engines; and from `results`, if it is lost.

    The address is "local" for a cluster of `count` processes of this machine's, else a scheduler's, as tcp://host:8786,
    whose workers are counted. Each of them must have these versions of the engines, and our source as it is here. The
    rest is as for `crosscheck.workers.pool.Workers`.
    """

    def __init__(
        self,
        work: Work,
        address: str,
        count: int,
        engines: Mapping[str, str],
        versions: Mapping[str, str],
        seconds: float = SECONDS_PER_SCENE,
    ) -> None:
        self.work, self.engines, self.seconds = work, dict(engines), seconds
        self.unexplained: list[str] = []
        self._waiting: dict[Any, tuple[tuple[Job, ...], tuple[str, ...], int]] = {}
        self._stack = ExitStack()
        try:
            self.client = self._connected(address, count)
            self.count = self._workers(versions)
        except BaseException:
            self._stack.close()
            raise

    def __exit__(self, *_: object) -> None:
        self._stack.close()

    def batch(self, scenes: int | None) -> int:
        # Every worker gets some.
        return BATCH if scenes is None else max(1, min(BATCH, scenes // (2 * self.count)))

    @property
    def hungry(self) -> bool:
        return len(self._waiting) < 2 * self.count

    @property
    def pending(self) -> bool:
        return bool(self._waiting)

    def submit(self, jobs: Iterable[Job], engines: Iterable[str] | None = None) -> None:
        self._submit(tuple(jobs), tuple(self.engines) if engines is None else tuple(engines), 0)

    def drop_waiting(self) -> None:
        begun = {key for keys in self.client.processing().values() for key in keys}
        for future in [f for f in self._waiting if not f.done() and f.key not in begun]:
            del self._waiting[future]
            future.cancel()

    def results(self) -> Iterator[Any]:
        end = time.monotonic() + LONGEST_WAIT
        while not (done := [f for f in self._waiting if f.done()]) and time.monotonic() < end:
            time.sleep(0.01)
        if self.client.status != "running":
            raise NoCluster(f"the cluster was lost; {len(self._waiting)} batches were still to come")
        for future in done:
            jobs, engines, kills = self._waiting.pop(future)
            if future.status == "finished":
                records, unexplained = future.result()
                self.unexplained += unexplained
                yield from records
            elif kills < MOST_KILLS:  # its workers were killed, or were lost
                self._submit(jobs, engines, kills + 1)
            else:
                raise NoCluster(f"a batch of {len(jobs)} scenes was lost {kills + 1} times: {future.exception()}")

    def _submit(self, jobs: tuple[Job, ...], engines: tuple[str, ...], kills: int) -> None:
        specs = {name: self.engines[name] for name in engines}
        future = self.client.submit(check_batch, self.work, jobs, specs, self.seconds, pure=False)
        self._waiting[future] = (jobs, engines, kills)

    def _connected(self, address: str, count: int) -> Any:
        try:
            import dask
            from distributed import Client, LocalCluster
        except ImportError as error:
            raise NoCluster("--cluster needs the package distributed: pip install 'refkin[cluster]'") from error
        logging.getLogger("distributed").setLevel(logging.CRITICAL)
        if address == LOCAL:
            self._stack.enter_context(dask.config.set({"distributed.worker.daemon": False}))
            sizes: dict[str, Any] = {"n_workers": count, "threads_per_worker": 1, "processes": True}
            own = LocalCluster(**sizes, dashboard_address=":0", silence_logs=logging.CRITICAL)
            return self._stack.enter_context(Client(self._stack.enter_context(own)))
        try:
            client = self._stack.enter_context(Client(address, timeout=SECONDS_TO_CONNECT))
            client.wait_for_workers(1, timeout=SECONDS_TO_CONNECT)
        except (OSError, TimeoutError, ValueError) as error:
            raise NoCluster(f"--cluster {address}: {error or 'no worker'}") from error
        return client

    def _workers(self, versions: Mapping[str, str]) -> int:
        """Return how many workers there are, all with the engines of these versions."""
        by_worker = self.client.run(versions_here, tuple(self.engines.values()))
        for worker, versions_there in by_worker.items():
            if isinstance(versions_there, str):
                raise NoCluster(f"worker {worker}: {versions_there}")
            if versions_there != dict(versions):
                raise NoCluster(f"worker {worker} has {versions_there}, this machine {dict(versions)}")
        return len(by_worker)


def check_batch(work: Work, jobs: Sequence[Job], engines: Mapping[str, str], seconds: float) -> Batch:
    """Return the records of scenes; this is what a worker of the cluster does, its engines in a child process.

    Parameters
    ----------
    work : Work
        What is done.
    jobs : sequence of mapping
        The scenes.
    engines : mapping
        Name -> what `engines.loading.load` takes for it.
    seconds : float
        How long a scene may take.
    """
    workers = _child(threading.get_ident(), work, tuple(engines.items()), seconds)
    workers.submit(jobs)
    records: list[Any] = []
    while workers.pending:
        records += workers.results()
    unexplained, workers.unexplained = workers.unexplained, []
    return records, unexplained


def versions_here(specs: Sequence[str]) -> dict[str, str] | str:
    """Return name -> version of the engines on this worker, our own source among them, or why they cannot be used."""
    import multiprocessing

    if multiprocessing.current_process().daemon:
        return "is a daemon and may have no children: start it with DASK_DISTRIBUTED__WORKER__DAEMON=False"
    answers = call_each(name_and_version, specs)
    if failures := [answer.text for answer in answers if isinstance(answer, Failure)]:
        return "; ".join(failures)
    files = files_of({name: spec for (name, _), spec in zip(answers, specs, strict=True)})
    return {SOURCE: digest(), **dict(answers), **files}


@lru_cache
def _child(thread: int, work: Work, engines: tuple[tuple[str, str], ...], seconds: float) -> Workers:
    """Return the child process of a thread of this worker; it ends with the worker."""
    return Workers(work, 1, dict(engines), seconds)
