"""How far long work is: a bar on a terminal, a line now and then in a log; on standard error."""

from __future__ import annotations

import sys
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager

from rich.console import Console
from rich.progress import BarColumn, Progress, TextColumn, TimeElapsedColumn

SECONDS_BETWEEN_LINES = 10.0

Show = Callable[[int, str], None]
"""What is called with how many are done and what is being done."""


@contextmanager
def shown_progress(count: int | None, minutes: float | None = None, noun: str = "scenes") -> Iterator[Show]:
    """Show progress towards a number of things, or else a number of minutes.

    Parameters
    ----------
    count, minutes : int and float, optional
        How many, or how long it may take.
    noun : str
        What is counted.
    """
    console = Console(stderr=True)
    start = time.monotonic()
    if not console.is_terminal:
        yield _lines(start, noun if count is None else f"of {count} {noun}")
        return
    bar = Progress(TextColumn("{task.description}"), BarColumn(), TimeElapsedColumn(), console=console)
    total = count if count is not None else 60.0 * (minutes or 0.0)
    with bar:
        task = bar.add_task("starting", total=total)

        def show(done: int, doing: str) -> None:
            completed = done if count is not None else time.monotonic() - start
            bar.update(task, completed=min(completed, total), description=f"{doing}: {done} {noun}")

        yield show


def _lines(start: float, what: str) -> Show:
    last = start

    def show(done: int, doing: str) -> None:
        nonlocal last
        now = time.monotonic()
        if now - last >= SECONDS_BETWEEN_LINES:
            last = now
            print(f"{now - start:.0f} s, {doing}: {done} {what}", file=sys.stderr, flush=True)

    return show
