"""Processes that check scenes one after the other, and how they begin and end.

Each has a pipe of its own and hands in each record as soon as it has it. So a process that ends, be it in the middle of
a write, costs the one scene it was at and cannot spoil what another hands in.
"""

from __future__ import annotations

import multiprocessing
import os
import signal
import sys
import time
import traceback
import types
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import contextmanager, suppress
from dataclasses import dataclass
from functools import lru_cache
from typing import Any

Job = Mapping[str, Any]
"""A scene as the data of its file under `scene`, what the generator knows of it under `about`; perhaps `arbiter`."""
Record = dict[str, Any]

SECONDS_TO_START = 60.0
"""How long a process may take to start and to load its engines."""
SERVER_DIES_WITHIN = (0.05, 0.2, 1.0)
"""How long to wait before a server that does not answer is asked again, or replaced [s]."""
LOADED = "loaded"
"""What comes before the first record of a task: the engines are loaded, the first scene begins."""
FROM_OUTSIDE = ("SIGKILL", "SIGTERM", "exit code 255")
"""Ends that come from outside: a person, a batch system, the kernel short of memory. (255 stands for a process of which
nobody was left to tell how it ended.)"""


@dataclass(frozen=True)
class Failure:
    """How a process failed at something: `kind` is crash, hang or error and which, `text` what is known of it."""

    kind: str
    text: str

    @property
    def from_outside(self) -> bool:
        """Whether somebody ended the process, rather than what it was doing."""
        return any(name in self.kind for name in FROM_OUTSIDE)


class SceneProcess:
    """A process that checks scenes, as its parent sees it.

    Attributes
    ----------
    pipe : Connection
        Where records come in; it ends when the process does.
    deadline : float
        Until when, by `time.monotonic`, the next record has time.
    """

    def __init__(self) -> None:
        self.pipe, theirs = _context().Pipe()
        self.process = _context().Process(target=serve, args=(theirs,), daemon=True)
        self.deadline = 0.0
        _begin(self.process)
        theirs.close()

    def give(self, jobs: Sequence[Job], engines: Sequence[str], seconds: float) -> bool:
        """Hand over scenes, with `seconds` for each; return whether there still was a process to take them."""
        try:
            self.pipe.send((tuple(jobs), tuple(engines), seconds))
        except OSError:
            return False
        self.deadline = time.monotonic() + SECONDS_TO_START
        return True

    def take(self, seconds: float) -> Record | Failure | str | None:
        """Return what came in: a record, what was raised, LOADED, None at the end; the next has `seconds` from now."""
        try:
            answer: Record | Failure | str = self.pipe.recv()
        except (EOFError, OSError):
            return None
        self.deadline = time.monotonic() + seconds
        return answer

    def end(self) -> Failure:
        """End the process, unless it has ended by itself; return how it had."""
        self.pipe.close()
        return stop(self.process)


def serve(pipe: Any) -> None:
    """Check what comes through a pipe until its other end is closed; this is what a process does."""
    with suppress(EOFError, OSError):  # the parent is gone: there is nobody left to tell
        while True:
            jobs, specs, seconds = pipe.recv()
            with ended_by_the_system(2 * SECONDS_TO_START):
                engines = told_if_raised(_loaded, specs)
            pipe.send(LOADED)
            for job in jobs:
                with ended_by_the_system(seconds + SECONDS_TO_START):
                    answer = engines if isinstance(engines, Failure) else told_if_raised(_checked, job, engines)
                pipe.send(answer)


@lru_cache
def _loaded(specs: tuple[str, ...]) -> list[Any]:
    from crosscheck.engines import load

    return [load(spec) for spec in specs]


def _checked(job: Job, engines: Sequence[Any]) -> Record:
    from crosscheck.measure.check import check
    from refkin.scenes.files import parse

    return check(parse(job["scene"]), engines, job["about"], arbiter=job.get("arbiter", False))


def told_if_raised(function: Callable[..., Any], *arguments: Any) -> Any:
    """Return what a function returns, or a Failure that tells what it raised and where.

    This is the border of a process: whatever an engine raises is told under its name, and nothing is lost beyond.
    """
    try:
        return function(*arguments)
    except Exception as error:
        where = traceback.extract_tb(error.__traceback__)[-1]
        name, file = type(error).__name__, os.path.basename(where.filename)
        return Failure(f"error ({name})", f"{name}: {error} ({where.name}, {file}:{where.lineno})")


def call_each(function: Callable[[str], Any], arguments: Sequence[str], seconds: float = SECONDS_TO_START) -> list[Any]:
    """Return what an importable function returns for each argument, or a Failure, each in a process of its own."""
    begun = [start(_call, function, argument) for argument in arguments]
    end = time.monotonic() + seconds
    return [_returned(ours, process, end, seconds) for ours, process in begun]


def start(function: Callable[..., None], *arguments: Any) -> tuple[Any, Any]:
    """Start an importable function in a process of its own; return a pipe to read from, and the process.

    The function takes the other end of the pipe, to which it writes, as its last argument.
    """
    ours, theirs = _context().Pipe(duplex=False)
    process = _context().Process(target=function, args=(*arguments, theirs), daemon=True)
    _begin(process)
    theirs.close()
    return ours, process


def _begin(process: Any) -> None:
    """Start a process; a server that was killed this moment still counts as alive, but takes no more requests."""
    for seconds in SERVER_DIES_WITHIN:
        try:
            with _by_itself():
                process.start()
        except (ConnectionError, EOFError):
            time.sleep(seconds)
        else:
            return
    with _by_itself():
        process.start()


def stop(process: Any) -> Failure:
    """Return how a process ended; one that still runs is ended."""
    process.join(0.2)  # a pipe is closed before an exit code is known
    code = process.exitcode
    if code is None:
        process.kill()
        process.join(5.0)
    return _crash(code)


def call_in_turn(
    function: Callable[[str], Any], arguments: Sequence[str], seconds: float = SECONDS_TO_START
) -> Iterator[Any]:
    """Yield what an importable function returns for each argument, or a Failure; one process does as many as it can.

    A process that ends, or that takes longer than `seconds`, is replaced for the arguments that are left.
    """
    worker = None
    try:
        for argument in arguments:
            worker = worker or _Caller(function)
            answer = worker.call(argument, seconds)
            if isinstance(answer, Failure) and not answer.kind.startswith("error"):
                worker.end()
                worker = None
            yield answer
    finally:
        if worker is not None:
            worker.end()


class _Caller:
    """A process that calls a function for one argument after the other."""

    def __init__(self, function: Callable[[str], Any]) -> None:
        self.pipe, theirs = _context().Pipe()
        self.process = _context().Process(target=_call_each_that_comes, args=(function, theirs), daemon=True)
        with _by_itself():
            self.process.start()
        theirs.close()
        self.pipe.poll(SECONDS_TO_START)  # until it is there: `LOADED`, which the first call takes

    def call(self, argument: str, seconds: float) -> Any:
        try:
            self.pipe.send((argument, seconds))
            answer: Any = LOADED
            while answer == LOADED:
                if not self.pipe.poll(seconds):
                    return Failure("hang", f"no answer within {seconds:g} s")
                answer = self.pipe.recv()
            return answer
        except (EOFError, OSError):
            self.process.join(5.0)
            return _crash(self.process.exitcode)

    def end(self) -> None:
        self.pipe.close()
        if self.process.exitcode is None:
            self.process.kill()
        self.process.join(5.0)


def _call_each_that_comes(function: Callable[[str], Any], pipe: Any) -> None:
    with suppress(EOFError, OSError):
        pipe.send(LOADED)
        while True:
            argument, seconds = pipe.recv()
            with ended_by_the_system(seconds + SECONDS_TO_START):
                pipe.send(told_if_raised(function, argument))


def _returned(pipe: Any, process: Any, end: float, seconds: float) -> Any:
    with pipe:
        if not pipe.poll(max(0.0, end - time.monotonic())):
            process.kill()
            process.join(5.0)
            return Failure("hang", f"no answer within {seconds:g} s")
        try:
            return pipe.recv()
        except (EOFError, OSError):
            process.join(5.0)
            return _crash(process.exitcode)


def _call(function: Callable[[str], Any], argument: str, pipe: Any) -> None:
    with ended_by_the_system(2 * SECONDS_TO_START):
        pipe.send(told_if_raised(function, argument))


def _crash(code: int | None) -> Failure:
    """Return the end of a process as data: the signal it got, or its exit code."""
    name = f"exit code {code}"
    if code is not None and code < 0:
        with suppress(ValueError):
            name = signal.Signals(-code).name
    return Failure(f"crash ({name})", f"its process ended: {name}")


@contextmanager
def ended_by_the_system(seconds: float) -> Iterator[None]:
    """Have the system end this process should it hang where no Python runs, with no parent left to end it."""
    if not hasattr(signal, "setitimer"):
        yield
        return
    signal.signal(signal.SIGALRM, signal.SIG_DFL)
    signal.setitimer(signal.ITIMER_REAL, seconds)
    try:
        yield
    finally:
        signal.setitimer(signal.ITIMER_REAL, 0.0)


@lru_cache
def _context() -> Any:
    """Return how processes are made: forked from a small server that has imported what they need, if there is one."""
    if "forkserver" not in multiprocessing.get_all_start_methods():
        return multiprocessing.get_context("spawn")
    context = multiprocessing.get_context("forkserver")
    context.set_forkserver_preload(["crosscheck.measure.check"])
    return context


@contextmanager
def _by_itself() -> Iterator[None]:
    """Start a process with one thread for NumPy, that does not run our own program anew nor end at a Ctrl-C for it."""
    environment = dict(os.environ)
    os.environ.update(dict.fromkeys(("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS", "MKL_NUM_THREADS"), "1"))
    main = sys.modules["__main__"]
    sys.modules["__main__"] = types.ModuleType("__main__")  # multiprocessing would have the child import ours
    try:
        with _interrupts_held_back():
            yield
    finally:
        sys.modules["__main__"] = main
        os.environ.clear()
        os.environ.update(environment)


@contextmanager
def _interrupts_held_back() -> Iterator[None]:
    """Hold SIGINT back: a process started meanwhile inherits that, here it is delivered afterwards."""
    if not hasattr(signal, "pthread_sigmask"):
        yield
        return
    from multiprocessing import resource_tracker

    resource_tracker.ensure_running()  # it lets SIGINT through again when it starts, so it has to be there before
    before = signal.pthread_sigmask(signal.SIG_BLOCK, {signal.SIGINT})
    try:
        yield
    finally:
        signal.pthread_sigmask(signal.SIG_SETMASK, before)
