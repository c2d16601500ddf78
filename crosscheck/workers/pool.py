"""Jobs for worker processes: engines may crash or hang on one, and take only their own process with them.

A job on which a process fails is taken apart: without any engine, then with one engine at a time, each in a process
that has nothing else to do. So the engine that fails is known by name, and what the others answer is kept. A process
that was killed from outside proves nothing: its job is done again. What is done, and how the parts of a job become one
result, is handed over as a `Work`. Which engines can be loaded is also tried in a process for each: one that crashes is
missing, no more.
"""

from __future__ import annotations

import time
from collections import deque
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field, replace
from multiprocessing import connection
from typing import Any, Protocol, Self

from crosscheck.errors import UsageError
from crosscheck.workers.processes import Child, Failure, FailureKind, Message, call_each, hang

SECONDS_PER_SCENE = 30.0
"""After this long on one scene a process is ended: some hundred times what a scene takes."""
LONGEST_WAIT = 1.0
"""After this long without news `results` returns, so that whoever waits can do something else [s]."""
BATCH = 5
"""Scenes handed to a process at once: enough that it seldom waits, few enough that a night ends when it is over."""
MOST_KILLS = 5
"""When a scene's process has been killed this often, something about the scene has it killed."""


Job = Mapping[str, Any]
"""What a worker does one thing about; it finds the specs of the engines to ask under `engines`."""
Parts = Mapping[str, Any]
"""What came of a job by engine, and under "" without any: a result, or a Failure."""


@dataclass(frozen=True)
class Work:
    """What workers do, in functions that a process can import.

    `do` returns the result of a job, which has a `key`; `prepare` loads the engines of a job, before its time begins;
    `joined` returns the result of a job from (job, engines in their order, parts).
    """

    do: Callable[[Job], Any]
    prepare: Callable[[Job], None]
    joined: Callable[[Job, Sequence[str], Parts], Any]


@dataclass(frozen=True)
class Task:
    """Scenes to be checked one after the other, with which engines; how often their process was killed before."""

    jobs: tuple[Job, ...]
    engines: tuple[str, ...]
    kills: int = 0
    trial: Trial | None = None

    @property
    def anew(self) -> bool:
        """Whether it wants a process that no engine has had: in another one, something was raised."""
        return self.trial is not None and self.trial.first.kind is FailureKind.ERROR


@dataclass
class Trial:
    """A scene on which a process failed, first so, taken apart.

    `engines` are names, in the order of the record; `parts` what came of it by engine, and under "" by the reference
    itself.
    """

    job: Job
    engines: tuple[str, ...]
    first: Failure
    parts: dict[str, Any] = field(default_factory=dict)

    @property
    def complete(self) -> bool:
        """Whether nothing more is to come; without the reference there is nothing to hold an engine against."""
        return isinstance(self.parts[""], Failure) or len(self.parts) == 1 + len(self.engines)

    @property
    def repeated(self) -> bool:
        """Whether something failed again."""
        return any(isinstance(part, Failure) for part in self.parts.values())


class Pool(Protocol):
    """Whatever checks scenes: processes of this machine (`Workers`), or a cluster (`crosscheck.workers.cluster`)."""

    engines: dict[str, str]
    unexplained: list[str]

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *_: object) -> None: ...

    def batch(self, scenes: int | None) -> int:
        """Return how many scenes to hand over at once if so many are to be checked in all."""

    @property
    def hungry(self) -> bool:
        """Whether a worker may soon be idle."""

    @property
    def pending(self) -> bool:
        """Whether records are still to come."""

    def submit(self, jobs: Iterable[Job], engines: Iterable[str] | None = None) -> None:
        """Let scenes be checked, on all engines or on those that are named."""

    def drop_waiting(self) -> None:
        """Forget the scenes that no worker has begun with, unless they are being taken apart."""

    def results(self) -> Iterator[Any]:
        """Wait until something happens, and yield the records that came in, perhaps none."""

    def check_one(self, job: Job, engines: Iterable[str] | None = None) -> Any:
        """Return the record of one scene; nothing else may be pending."""
        self.submit([job], engines)
        while True:
            for record in self.results():
                return record


class Workers(Pool):
    """Some worker processes; use it as a context manager.

    By their names `engines` are what `engines.loading.load` takes. After so many seconds on one job a process is
    ended. Failures that were none when their jobs were taken apart are `unexplained`.
    """

    def __init__(self, work: Work, count: int, engines: Mapping[str, str], seconds: float = SECONDS_PER_SCENE) -> None:
        self.work, self.count, self.engines, self.seconds = work, count, dict(engines), seconds
        self.waiting: deque[Task] = deque()
        self.idle: list[Child] = []
        self.busy: dict[Child, Task] = {}
        self.unexplained: list[str] = []

    def __exit__(self, *_: object) -> None:
        for process in (*self.idle, *self.busy):
            process.process.kill()
        for process in (*self.idle, *self.busy):
            process.end()

    def batch(self, scenes: int | None) -> int:
        return BATCH

    @property
    def hungry(self) -> bool:
        return len(self.waiting) < self.count

    @property
    def pending(self) -> bool:
        return bool(self.waiting or self.busy)

    def submit(self, jobs: Iterable[Job], engines: Iterable[str] | None = None) -> None:
        names = tuple(self.engines) if engines is None else tuple(engines)
        self.waiting.append(Task(tuple(jobs), names))

    def drop_waiting(self) -> None:
        self.waiting = deque(task for task in self.waiting if task.trial)

    def results(self) -> Iterator[Any]:
        self._hand_out()
        if not self.busy:
            return
        left = min(process.deadline for process in self.busy) - time.monotonic()
        ready = connection.wait([process.pipe for process in self.busy], timeout=min(max(0.0, left), LONGEST_WAIT))
        for process in list(self.busy):
            if process.pipe in ready:
                message = process.take(self.seconds)
                if message is None:
                    yield from self._answered(process, process.end(), True)
                elif message[0] is Message.DONE:
                    failed = isinstance(message[1], Failure)
                    if failed:
                        process.end()  # an engine may have changed anything in it: the reference is not asked there
                    yield from self._answered(process, message[1], failed)
            elif time.monotonic() > process.deadline:
                process.end()
                yield from self._answered(process, hang(self.seconds), True)

    def _hand_out(self) -> None:
        while self.waiting and (self.idle or len(self.busy) < self.count):
            task = self.waiting[0]
            if self.idle and task.anew:
                self.idle.pop().end()
            process = self.idle.pop() if self.idle and not task.anew else Child(self.work.do, self.work.prepare)
            specs = tuple(self.engines[name] for name in task.engines)
            if process.give([{**job, "engines": specs} for job in task.jobs]):
                self.busy[process] = self.waiting.popleft()
            else:
                process.end()  # it was killed while it was idle

    def _answered(self, process: Child, answer: Any, ended: bool) -> Iterator[Any]:
        """Note that a process is done with its first scene, or has ended at it; the others go on, or wait again."""
        task = self.busy.pop(process)
        rest = replace(task, jobs=task.jobs[1:], kills=0)
        if ended and rest.jobs:
            self.waiting.appendleft(rest)
        elif rest.jobs:
            self.busy[process] = rest
        elif not ended:
            self.idle.append(process)
        yield from self._settled(replace(task, jobs=task.jobs[:1]), answer)

    def _settled(self, task: Task, answer: Any) -> Iterator[Any]:
        """Yield the record of a scene if this completes it, else see to it that it will be complete."""
        if isinstance(answer, Failure) and answer.from_outside and task.kills < MOST_KILLS:
            self.waiting.appendleft(replace(task, kills=task.kills + 1))
        elif task.trial is not None:
            yield from self._part_settled(task.trial, task.engines, answer)
        elif isinstance(answer, Failure):
            self.waiting.appendleft(Task(task.jobs, (), trial=Trial(task.jobs[0], task.engines, answer)))
        else:
            yield answer

    def _part_settled(self, trial: Trial, engines: tuple[str, ...], answer: Any) -> Iterator[Any]:
        trial.parts["".join(engines)] = answer
        if not engines and not isinstance(answer, Failure):
            self.waiting.extendleft(Task((trial.job,), (engine,), trial=trial) for engine in reversed(trial.engines))
        if trial.complete:
            result = self.work.joined(trial.job, trial.engines, trial.parts)
            if not trial.repeated:
                first = trial.first.text if trial.first.kind is FailureKind.ERROR else trial.first.name
                self.unexplained.append(f"{result.key}: {first}, but not when it was done again")
            yield result


class SameName(UsageError):
    """Two engines have the same name, so that their answers could not be told apart."""


def find_engines(specs: Sequence[str]) -> tuple[dict[str, tuple[str, str]], dict[str, str]]:
    """Return the engines that can be loaded, as name -> (what loads it, version), and for the others why not.

    SameName if two have the same name.
    """
    loaded: dict[str, tuple[str, str]] = {}
    missing = {}
    for spec, answer in zip(specs, call_each(_tried, specs), strict=True):
        if isinstance(answer, Failure | str):
            missing[spec] = answer if isinstance(answer, str) else f"engine {spec!r} cannot be loaded: {answer.text}"
        elif answer[0] in loaded:
            raise SameName(f"engines {loaded[answer[0]][0]!r} and {spec!r} are both called {answer[0]!r}")
        else:
            loaded[answer[0]] = (spec, answer[1])
    return loaded, missing


def _tried(spec: str) -> tuple[str, str] | str:
    """Return name and version, or why there is no such engine: no fault of ours, so no place in our code is named."""
    from crosscheck.engines import EngineError  # here: a report reads how long a scene may take without any engine

    try:
        return name_and_version(spec)
    except EngineError as error:
        return str(error)


def name_and_version(spec: str) -> tuple[str, str]:
    """Return what an engine calls itself, and its version."""
    from crosscheck.engines.loading import load

    engine = load(spec)
    return engine.name, engine.version()
