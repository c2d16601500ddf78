"""How far a night is: a bar on a terminal, a line now and then in a log."""

from __future__ import annotations

import sys
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager

from rich.console import Console
from rich.progress import BarColumn, Progress, TextColumn, TimeElapsedColumn

SECONDS_BETWEEN_LINES = 10.0

Show = Callable[[int, str], None]
"""What is called with the number of scenes checked and what is being done."""


@contextmanager
def shown_progress(scenes: int | None, minutes: float | None) -> Iterator[Show]:
    """Show progress on standard error, towards a number of scenes or else a number of minutes."""
    console = Console(stderr=True)
    start = time.monotonic()
    if not console.is_terminal:
        yield _lines(start)
        return
    bar = Progress(TextColumn("{task.description}"), BarColumn(), TimeElapsedColumn(), console=console)
    total = scenes if scenes is not None else 60.0 * (minutes or 0.0)
    with bar:
        task = bar.add_task("starting", total=total)

        def show(checked: int, doing: str) -> None:
            done = checked if scenes is not None else time.monotonic() - start
            bar.update(task, completed=min(done, total), description=f"{doing}: {checked} scenes")

        yield show


def _lines(start: float) -> Show:
    last = start

    def show(checked: int, doing: str) -> None:
        nonlocal last
        now = time.monotonic()
        if now - last >= SECONDS_BETWEEN_LINES:
            last = now
            print(f"{now - start:.0f} s, {doing}: {checked} scenes checked", file=sys.stderr, flush=True)

    return show
