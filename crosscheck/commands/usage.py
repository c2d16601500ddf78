"""Arguments that commands share, messages about invalid ones, and the one printer of tables."""

from __future__ import annotations

import math
import os
import re
import sys
import time
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from contextlib import contextmanager, suppress
from itertools import groupby
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any, TextIO

from cyclopts import Parameter

from crosscheck.errors import UsageError, printable

if TYPE_CHECKING:
    from rich.console import Console
    from rich.table import Table
    from rich.text import Text


def _whole(_: Any, tokens: Sequence[Any]) -> int:
    """Return a whole number; cyclopts by itself takes 2.5 for 2."""
    try:
        return int(tokens[0].value)
    except ValueError as error:
        raise ValueError(f"expected a whole number, got {tokens[0].value!r}") from error


Whole = Annotated[int, Parameter(converter=_whole)]
SceneFile = Annotated[Path, Parameter(help="A scene file (TOML, or JSON if it ends in .json).")]
Names = Annotated[str, Parameter(help="Names of engines, separated by commas, or `file.py:Class`.")]
Json = Annotated[bool, Parameter(name="--json", negative="", help="Print JSON instead.")]


def positive(key: str, value: float | None) -> None:
    """Refuse a number that is not above 0 and finite; None was not given."""
    if value is not None and not 0 < value < math.inf:
        raise UsageError(f"--{key}: expected a number above 0, got {value}")


def writable(key: str, file: Path | None, *read: Path | None) -> None:
    """Refuse a file that cannot be written, or that is read itself, before anything is computed for it.

    Parameters
    ----------
    key, file : str, Path
        The option, and its file; None was not given.
    *read : Path
        What the command reads.
    """
    if file is None:
        return
    if os.path.isdir(file):
        raise UsageError(f"--{key}: expected a file, got the folder {file}")
    if "\0" in str(file) or not file.absolute().parent.is_dir():
        raise UsageError(f"--{key}: expected a file in a folder that exists, got {file}")
    if not _opens(file):
        raise UsageError(f"--{key}: expected a file that can be written, got {file}")
    if any(other is not None and file.exists() and other.exists() and file.samefile(other) for other in read):
        raise UsageError(f"--{key}: expected another file than the one that is read, got {file}")


def _opens(file: Path) -> bool:
    """Return whether a file can be written; one that is not there is made and removed: rights alone do not say it."""
    file = Path(os.path.realpath(file))
    try:
        if file.exists():
            return os.access(file, os.W_OK)
        file.open("xb").close()
        file.unlink()
    except OSError:
        return False
    return True


def writable_folder(key: str, folder: Path) -> None:
    """Make a folder, or refuse one that cannot be written to, before anything is computed for it."""
    with suppress(OSError, ValueError):
        folder.mkdir(parents=True, exist_ok=True)
        if os.access(folder, os.W_OK):
            return
    raise UsageError(f"--{key}: expected a folder that can be written to, got {folder}")


COLOUR = re.compile("(\x1b\\[[0-9;]*m)")
BAR = re.compile("(\x1b\\[[0-9;]*m|\x1b\\[\\?25[hl]|\x1b\\[[0-9]*[AK]|\r)")
"""What a bar of progress writes beside colours."""


def console(width: int | None, stderr: bool = False) -> Console:
    """Return standard output, or standard error, as a console, of this width where it is no terminal.

    No text of a scene or an engine does anything on it but stand there.
    """
    from rich.console import Console  # answers in JSON need none

    class PrintableConsole(Console):
        def render_str(self, text: str, **more: Any) -> Text:
            return super().render_str(printable(text), **more)

        def on_broken_pipe(self) -> None:
            raise  # as any other print does, and not SystemExit(1), which says that something is wrong

    stream = sys.stderr if stderr else sys.stdout
    plain: Any = dict.fromkeys(("markup", "highlight", "emoji"), False)
    return PrintableConsole(stderr=stderr, width=None if stream.isatty() else width, **plain)


def coloured(text: str, colour: str) -> Text:
    """Return a cell of a table in a colour."""
    from rich.text import Text

    return Text(printable(text), colour)


def table(*heads: str, rows: Iterable[Sequence[Any] | None], title: str | None = None) -> Table:
    """Return a table as the terminal shows it; what is in it is made printable where it is printed.

    Parameters
    ----------
    *heads : str
        Headings; one that begins with > is that of numbers, which stand at the right.
    rows : iterable of sequence, or None
        Text, other cells as `str` has them; None draws a line between two rows.
    title : str, optional
    """
    from rich.table import Table
    from rich.text import Text

    shown = Table(title=title)
    for head in heads:
        shown.add_column(head.removeprefix(">"), justify="right" if head.startswith(">") else "left", overflow="fold")
    for row in rows:
        if row is None:
            shown.add_section()
        else:
            shown.add_row(*(cell if isinstance(cell, Text) else str(cell) for cell in row))
    return shown


BAR_BETWEEN = 3
"""Characters from one column of a table to the next; one more stands before the first."""


def _needed(shown: Table, parts: Callable[[str], Sequence[str]]) -> list[int]:
    """Return how wide each column of a table is for the longest of some parts of its cells."""
    texts = ([str(cell) for cell in (column.header, *column.cells)] for column in shown.columns)
    return [max(len(part) for text in column for part in parts(text) or [""]) for column in texts]


def fitted(shown: Table, width: int) -> Table:
    """Return a table that breaks no word, if its words have room in so many characters: Rich breaks some before."""
    widths, lines = _needed(shown, str.split), _needed(shown, str.splitlines)
    room = width - 1 - sum(n + BAR_BETWEEN for n in widths)
    if room < 0:
        return shown
    for _ in range(min(room, sum(lines) - sum(widths))):
        widths[max(range(len(widths)), key=lambda k: lines[k] - widths[k])] += 1
    for column, own in zip(shown.columns, widths, strict=True):
        column.width = own
    return shown


def print_in_parts(out: Console, *heads: str, rows: Sequence[Sequence[Any] | None], title: str, first: int) -> None:
    """Print a table, as several if its words have no room beside each other.

    Parameters
    ----------
    out : Console
    *heads, rows, title
        As for `table`.
    first : int
        So many columns say which row it is, and stand in every part.
    """

    def part(places: Sequence[int]) -> Table:
        chosen = [row and [row[k] for k in places] for row in rows]
        return table(*(heads[k] for k in places), rows=chosen, title=title)

    parts = [list(range(first))]
    for k in range(first, len(heads)):
        wider = [*parts[-1], k]
        needed = sum(n + BAR_BETWEEN for n in _needed(part(wider), str.split))
        if len(wider) > first + 1 and needed >= out.width:
            parts.append(wider := [*range(first), k])
        parts[-1] = wider
    for places in parts:
        out.print(fitted(part(places), out.width))


def print_numbers(columns: Mapping[str, Any], first: int) -> bool:
    """Print columns of numbers as a table, on a terminal as several that are no wider; return if there are any.

    Values are (T,) each, by header. Rows that hold no number beyond so many columns at `first`, which say which row it
    is, share one row while the last of those, their status, stays the same.
    """

    def numbers(row: Sequence[Any]) -> bool:
        return any(math.isfinite(x) for x in row[first:])

    rows = list(zip(*columns.values(), strict=True))
    if not any(map(numbers, rows)):
        return False
    lines: list[Sequence[str]] = []
    for (some, _), run in groupby(rows, lambda row: (numbers(row), row[first - 1] if not numbers(row) else None)):
        group = list(run)
        if some:
            for row in group:
                lines.append([x if isinstance(x, str) else f"{x:.15g}" for x in row])
        else:
            times = f"{group[0][0]:.6g} ... {group[-1][0]:.6g}" if len(group) > 1 else f"{group[0][0]:.6g}"
            status = f"{group[0][first - 1]} ({len(group)} times)"
            lines.append([times, *[""] * (first - 2), status, *["-"] * (len(columns) - first)])
    head = [printable(name) for name in columns]
    widths = [max(map(len, column)) + 3 for column in zip(head, *lines, strict=True)]
    room = console(None).width - 1 if sys.stdout.isatty() else math.inf
    blocks = [list(range(first))]
    for k in range(first, len(head)):
        if len(blocks[-1]) > first and sum(widths[j] for j in (*blocks[-1], k)) > room:
            blocks.append(list(range(first)))
        blocks[-1].append(k)
    for block in blocks:
        print(boxed([head[k] for k in block], [[line[k] for k in block] for line in lines]))
    return True


def boxed(head: Sequence[str], lines: Sequence[Sequence[str]]) -> str:
    """Return a table as text, as wide as it is: Rich would take longer than the solution."""
    says_bars = (sys.stdout.encoding or "utf").lower().startswith("utf")
    bars = ("┏┳┓━", "┃┃┃ ", "┡╇┩━", "│││ ", "└┴┘─") if says_bars else ("+++-", "||| ", "+++-", "||| ", "+++-")
    widths = [max(map(len, column)) for column in zip(head, *lines, strict=True)]

    def line(cells: Sequence[str], bar: str) -> str:
        left, between, right, fill = tuple(bar)
        padded = (fill + cell.ljust(width, fill) + fill for cell, width in zip(cells, widths, strict=True))
        return left + between.join(padded) + right

    nothing = [""] * len(head)
    above = [line(of, bar) for of, bar in zip((nothing, head, nothing), bars, strict=False)]
    return "\n".join([*above, *(line(cells, bars[3]) for cells in lines), line(nothing, bars[4])])


def keep_nothing(stream: TextIO) -> None:
    """Let what a stream holds, and all that is printed to it, go nowhere: Python would end with 120 otherwise."""
    os.dup2(os.open(os.devnull, os.O_WRONLY), stream.fileno())


class Printable:
    """A stream that lets no control character through but a terminal's colours, and what `allowed` lets besides.

    If it is `aside`, what is done goes on where nobody hears it any more: from then on it keeps nothing.
    """

    def __init__(self, stream: TextIO, allowed: re.Pattern[str] = COLOUR, *, aside: bool = False) -> None:
        self._stream, self._allowed = stream, allowed
        self._aside = aside

    def write(self, text: str) -> int:
        parts = self._allowed.split(text) if self._stream.isatty() else [text]
        with self._unheard():
            self._stream.write("".join(part if k % 2 else printable(part) for k, part in enumerate(parts)))
        return len(text)

    def flush(self) -> None:
        with self._unheard():
            self._stream.flush()

    @contextmanager
    def _unheard(self) -> Iterator[None]:
        try:
            yield
        except BrokenPipeError:
            if not self._aside:
                raise
            keep_nothing(self._stream)

    def __getattr__(self, name: str) -> Any:
        return getattr(self._stream, name)


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
    from rich.console import Console
    from rich.progress import BarColumn, Progress, TextColumn, TimeElapsedColumn

    console = Console(stderr=True)
    start = time.monotonic()
    if not console.is_terminal:
        yield _lines(start, noun if count is None else f"of {count} {noun}")
        return
    bar = Progress(TextColumn("{task.description}", markup=False), BarColumn(), TimeElapsedColumn(), console=console)
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
