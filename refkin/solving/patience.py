"""What takes long says so while it is under way: what decides of it, a limit nearly touched, is not seen beforehand."""

from __future__ import annotations

import threading
import time
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass, field

LONG = 5.0
"""Seconds of silence; then it is said again after twice as long."""
LOOK = 0.5
"""Seconds between two looks."""


@dataclass
class _Begun:
    """What is under way, when it began, and after how long it is to be said next [s]."""

    what: str
    start: float = field(default_factory=time.monotonic)
    due: float = field(default_factory=lambda: LONG)


class _Watch:
    """One thread looks after all that is under way, and ends where nothing is.

    A thread for each would cost as much as a tenth of the solve of one pose. There is no lock: first the thread says
    that it is gone, then it looks a last time; what begins does it the other way round.
    """

    def __init__(self) -> None:
        self.begun: dict[int, _Begun] = {}
        self.thread: threading.Thread | None = None

    def look_after(self, begun: _Begun) -> None:
        self.begun[id(begun)] = begun
        if self.thread is None or not self.thread.is_alive():  # a process that was forked has none
            self.thread = threading.Thread(target=self._look, name="refkin-patience", daemon=True)
            self.thread.start()

    def _look(self) -> None:
        while True:
            time.sleep(LOOK)
            for begun in list(self.begun.values()):
                taken = time.monotonic() - begun.start
                if taken >= begun.due:
                    begun.due = 2.0 * taken
                    _say(f"{begun.what}: {taken:.0f} s so far")
            self.thread = None
            if not self.begun:
                return
            self.thread = threading.current_thread()


_WATCH = _Watch()


@contextmanager
def said_if_long(what: str) -> Iterator[None]:
    """Say by the log "refkin", as a warning, that what is done meanwhile takes long, as soon as it does."""
    begun = _Begun(what)
    _WATCH.look_after(begun)
    try:
        yield
    finally:
        del _WATCH.begun[id(begun)]


def _say(message: str) -> None:
    import logging  # what takes no time loads nothing for it

    logging.getLogger("refkin").warning(message)
