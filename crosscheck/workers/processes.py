"""Processes that call a function for one argument after the other, and how they begin and end: the one mechanism.

Each has a pipe of its own and hands in each result as soon as it has it. So a process that ends, be it in the middle of
a write, costs the one argument it was at and cannot spoil what another hands in. `start` begins any function in a
process; a `Child` calls one again and again; `call_each` and `call_in_turn` are the two ways to have many arguments
done; `crosscheck.workers.pool` has many children at once. Functions are handed over by whoever wants them called, and
must be importable.
"""

from __future__ import annotations

import gc
import multiprocessing
import os
import signal
import sys
import time
import traceback
import types
from collections.abc import Callable, Generator, Iterator, Sequence
from contextlib import contextmanager, suppress
from dataclasses import dataclass
from enum import StrEnum
from functools import cache
from itertools import islice
from threading import Thread
from typing import Any

from crosscheck.errors import kept

try:
    import fcntl
except ImportError:  # Windows, where a process whose parent has ended goes on to its next result
    fcntl = None  # type: ignore[assignment]

SECONDS_TO_START = 60.0
"""How long a process may take to start and to prepare."""
SERVER_DIES_WITHIN = (0.05, 0.2, 1.0)
"""How long to wait before a server that does not answer is asked again, or replaced [s]."""
FROM_OUTSIDE = ("SIGKILL", "SIGTERM", "exit code 255")
"""Ends that come from outside: a person, a batch system, the kernel short of memory. (255 stands for a process of which
nobody was left to tell how it ended.)"""

MOST_PRINTED = 1 << 14
"""Of what a process prints so many bytes are shown."""
LAST_PRINTED = 1 << 10
"""And of what is beyond them so many, the last."""
COLLECTED_AFTER = 10_000
"""So many objects more than there were make a child look for those that nobody needs. After 700, as Python has it, a
thirtieth of a night went into looking: what a scene makes is needed for long."""
THREADS = [
    f"{name}_THREADS" for name in ("OMP_NUM", "OPENBLAS_NUM", "MKL_NUM", "BLIS_NUM", "NUMEXPR_NUM", "VECLIB_MAXIMUM")
]
"""What numerical libraries read, once, when they are loaded."""


class FailureKind(StrEnum):
    """How a process failed at something."""

    CRASH = "crash"
    """It ended."""
    HANG = "hang"
    """It took too long, and was ended."""
    ERROR = "error"
    """It raised an exception."""


@dataclass(frozen=True)
class Failure:
    """How a process failed; `how` is the signal, the exit code or the exception, `text` what else is known."""

    kind: FailureKind
    text: str
    how: str = ""

    @property
    def name(self) -> str:
        """The kind with how it came."""
        return f"{self.kind} ({self.how})" if self.how else str(self.kind)

    @property
    def from_outside(self) -> bool:
        """Whether somebody ended the process, rather than what it was doing."""
        return self.kind is FailureKind.CRASH and self.how in FROM_OUTSIDE


def hang(seconds: float) -> Failure:
    """Return that no answer came in time."""
    return Failure(FailureKind.HANG, f"no answer within {seconds:g} s")


class Message(StrEnum):
    """What a child sends: that it is ready for the first argument, or what came of one."""

    READY = "ready"
    """The child is ready for the first argument: its time begins."""
    DONE = "done"
    """What came of one argument follows."""


class Child:
    """A process that calls a function, as its parent sees it.

    Results come in through `pipe`, which ends when the process does; the next one has time until `deadline`, by
    `time.monotonic`.

    The function, importable, is called with one argument at a time; before, and before its time begins, `prepare` with
    the first of some arguments. What that raises is the result of all.
    """

    def __init__(self, function: Callable[[Any], Any], prepare: Callable[[Any], None] | None = None) -> None:
        self.deadline = 0.0
        self.pipe, self.process = start(serve, function, prepare)

    def give(self, arguments: Sequence[Any], to_start: float = SECONDS_TO_START) -> bool:
        """Hand over arguments; return whether there still was a process to take them."""
        try:
            self.pipe.send(tuple(arguments))
        except OSError:
            return False
        self.deadline = time.monotonic() + to_start
        return True

    def take(self, seconds: float) -> tuple[Message, Any] | None:
        """Return what came in, None at the end; the next result has `seconds` from now."""
        try:
            message: tuple[Message, Any] = self.pipe.recv()
        except (EOFError, OSError):
            return None
        self.deadline = time.monotonic() + seconds
        return message

    def result(self, seconds: float) -> Any:
        """Wait for the next result, and return it or a Failure; after a crash or a hang the process is ended."""
        while self.pipe.poll(max(0.0, self.deadline - time.monotonic())):
            message = self.take(seconds)
            if message is None:
                return self.end()
            if message[0] is Message.DONE:
                return message[1]
        self.end()
        return hang(seconds)

    def end(self) -> Failure:
        """End the process, unless it has ended by itself; return how it had."""
        self.pipe.close()
        return stop(self.process)


def serve(function: Callable[[Any], Any], prepare: Callable[[Any], None] | None, pipe: Any) -> None:
    """Call a function with what comes through a pipe until its other end is closed; this is what a child does.

    Parameters
    ----------
    function : callable
        Of one argument.
    prepare : callable, optional
        Called with the first argument of each list that comes, before the time of that begins.
    pipe : Connection
    """
    gc.set_threshold(COLLECTED_AFTER)
    with suppress(EOFError, OSError):  # the parent is gone: there is nobody left to tell
        while True:
            arguments = pipe.recv()
            ready = told_if_raised(prepare, arguments[0]) if prepare else None
            pipe.send((Message.READY, None))
            for argument in arguments:
                result = ready if isinstance(ready, Failure) else told_if_raised(function, argument)
                pipe.send((Message.DONE, result))


def call_each(function: Callable[[Any], Any], arguments: Sequence[Any], seconds: float = SECONDS_TO_START) -> list[Any]:
    """Return what a function returns for each argument, or a Failure, each in a process of its own.

    All are done at once.

    Parameters
    ----------
    function : callable
        Importable, of one argument.
    arguments : sequence
    seconds : float
        For all of it, the start as well.
    """
    children = []
    for argument in arguments:
        children.append(Child(function))
        children[-1].give([argument], to_start=seconds)
    end = time.monotonic() + seconds
    results = []
    for child in children:
        child.deadline = end
        results.append(child.result(seconds))
        child.end()
    return results


def call_in_turn(
    function: Callable[[Any], Any], arguments: Sequence[Any], seconds: float = SECONDS_TO_START, count: int = 1
) -> Generator[Any, None, None]:
    """Yield what a function returns for each argument, or a Failure; processes take turns.

    A process that ends, or that takes too long, is replaced for the arguments that are left.

    Parameters
    ----------
    function, arguments
        As for `call_each`.
    seconds : float
        How long a call may take.
    count : int
        How many processes take turns.
    """
    children: dict[int, Child] = {}
    given = iter(enumerate(arguments))
    try:
        for k in range(len(arguments)):
            for n, argument in islice(given, count if k == 0 else 1):
                while n % count not in children or not children[n % count].give([argument]):
                    children[n % count] = Child(function)
            result = children[k % count].result(seconds)
            if isinstance(result, Failure) and result.kind is not FailureKind.ERROR:
                children.pop(k % count).end()
            yield result
    finally:
        for child in children.values():
            child.end()


def start(function: Callable[..., None], *arguments: Any) -> tuple[Any, Any]:
    """Start an importable function in a process of its own; return our end of a pipe, and the process.

    The function takes the other end of the pipe as its last argument.
    """
    context = _context()
    ours, theirs = context.Pipe()
    printed, printing = context.Pipe(duplex=False)
    living, life = context.Pipe(duplex=False)
    process = context.Process(target=_begun, args=(function, printing, living, *arguments, theirs), daemon=True)
    _begin(process)
    for end in (theirs, printing, living):
        end.close()
    shown = Thread(target=_show, args=(printed,), daemon=True)
    _begun_here[id(process)] = shown, life
    shown.start()
    return ours, process


def _begun(function: Callable[..., None], printing: Any, living: Any, *arguments: Any) -> None:
    """Call a function in a process whose standard output and error are a pipe: results go through another alone.

    It is a group of its own, with what an engine starts in it, and may start processes as any program may. A copy of
    itself that an engine forks, and that comes back from it, has no pipe for results, and ends without a word.
    """
    for stream in (1, 2):
        os.dup2(printing.fileno(), stream)
    printing.close()
    if hasattr(os, "setpgid"):
        os.setpgid(0, 0)
        _end_with_parent(living)
        os.register_at_fork(after_in_child=arguments[-1].close)
    multiprocessing.current_process()._config["daemon"] = False  # type: ignore[attr-defined]
    process = os.getpid()
    try:
        function(*arguments)
    finally:
        if os.getpid() != process:
            os._exit(0)


def _end_with_parent(living: Any) -> None:
    """Have the system kill this group when a pipe is closed whose other end the parent alone has.

    A signal to the parent's group does not reach this one, and an engine may hang where no Python runs. So it is the
    system that signals the end of the pipe: by SIGKILL where it can be told which (Linux). Elsewhere that is SIGIO,
    which most systems ignore: there a process goes on to its next result.
    """
    with suppress(OSError):  # a system that does not signal for pipes
        fcntl.fcntl(living, fcntl.F_SETOWN, -os.getpgrp())
        if hasattr(fcntl, "F_SETSIG"):
            fcntl.fcntl(living, fcntl.F_SETSIG, signal.SIGKILL)
        fcntl.fcntl(living, fcntl.F_SETFL, fcntl.fcntl(living, fcntl.F_GETFL) | os.O_ASYNC)
    if living.poll():  # it has ended before that
        os._exit(0)


_begun_here: dict[int, tuple[Thread, Any]] = {}
"""The `id` of a process that was begun -> what shows what it prints, and the pipe with which it ends."""


def _show(printed: Any) -> None:
    """Show on standard error what a process prints, up to `MOST_PRINTED`; then how much more it was, and its end.

    Why a process ended is what it said last.
    """
    left, dropped, last = MOST_PRINTED, 0, b""
    with printed, suppress(OSError, ValueError):  # standard error may be closed
        while some := os.read(printed.fileno(), MOST_PRINTED):
            sys.stderr.write(_plain(some[:left]))
            more, left = some[left:], max(0, left - len(some))
            dropped, last = dropped + len(more), (last + more)[-LAST_PRINTED:]
        if dropped:
            sys.stderr.write(f"\n... a process of engines printed {dropped:,} bytes more, at last:\n{_plain(last)}\n")


def _plain(printed: bytes) -> str:
    """Return what was printed, with all that a terminal would act on written out, but ends of lines and tabs."""
    text = printed.decode("utf-8", "replace")
    return "".join(c if c.isprintable() or c in "\n\t" else repr(c)[1:-1] for c in text)


def told_if_raised(function: Callable[..., Any], *arguments: Any) -> Any:
    """Return what a function returns, or a Failure that tells what it raised and where.

    This is the border of a process: whatever an engine raises is reported under its name, and nothing is lost beyond.
    Nobody else interrupts a process: it is in no group with a terminal.
    """
    try:
        return function(*arguments)
    except BaseException as error:
        return raised(error)


def raised(error: BaseException) -> Failure:
    """Return an exception that was caught as a failure: what it is, what it says, and where it came from."""
    where, words = traceback.extract_tb(error.__traceback__)[-1], ""
    with suppress(Exception):  # an exception of an engine's own may have no words
        words = kept(str(error))
    name, file = type(error).__name__, os.path.basename(where.filename)
    return Failure(FailureKind.ERROR, f"{name}: {words} ({where.name}, {file}:{where.lineno})", name)


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
    with suppress(OSError, AttributeError):  # nothing that it started is left, or there are no groups
        os.killpg(process.pid, signal.SIGKILL)
    if id(process) in _begun_here:
        shown, life = _begun_here.pop(id(process))
        shown.join(1.0)
        life.close()
    name = f"exit code {code}"
    if code is not None and code < 0:
        with suppress(ValueError):
            name = signal.Signals(-code).name
    return Failure(FailureKind.CRASH, f"its process ended: {name}", name)


_preloaded: list[str] = []


def preload(module: str) -> None:
    """Have a module imported once for all processes, if none was started yet."""
    _preloaded.append(module)


@cache
def _context() -> Any:
    """Return how processes are made: forked from a small server that has imported what they need, if there is one."""
    if "forkserver" not in multiprocessing.get_all_start_methods():
        return multiprocessing.get_context("spawn")
    context = multiprocessing.get_context("forkserver")
    context.set_forkserver_preload(_preloaded)
    return context


@contextmanager
def _by_itself() -> Iterator[None]:
    """Start a process on one thread, that does not run our own program anew nor end at a Ctrl-C for it."""
    environment = dict(os.environ)
    os.environ.update({**dict.fromkeys(THREADS, "1"), "MUJOCO_GL": "disable"})
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
