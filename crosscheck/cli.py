"""The command line: `crosscheck ...`. Results go to standard output, everything else to standard error.

A command is imported when it is called: solving a small scene does not wait for engines, reports and drawn scenes.
"""

from __future__ import annotations

import io
import os
import sys
import traceback
from collections.abc import Sequence
from contextlib import redirect_stderr, redirect_stdout, suppress
from itertools import pairwise
from pathlib import Path
from typing import TextIO

import cyclopts

from crosscheck.commands.usage import BAR, Printable, keep_nothing
from crosscheck.errors import INFRASTRUCTURE, INTERRUPTED, PASS, UNREAD, USAGE, CannotRun, UsageError
from refkin import __version__
from refkin.errors import InvalidRequest, InvalidScene

COMMANDS = {
    "solve": ("solve:solve", "Solve a scene with the reference."),
    "follow": ("follow:print_path", "Follow the poses of a scene through limits and up to change points."),
    "diagnose": ("solve:print_diagnosis", "Classify the pose of a scene that is nearest to a singular one."),
    "mobility": ("solve:mobility", "Count the freedoms of a scene's mechanism, by count and by rank."),
    "schema": ("solve:print_schema", "Print the JSON schema of scene files, for editors."),
    "draw": ("draw:draw", "Draw the mechanism of a scene in one pose, as SVG or PNG."),
    "animate": ("draw:animate", "Draw the motion of a scene, as SVG that plays by itself or GIF."),
    "replay": ("replay:replay", "Solve one scene on all engines, and compare."),
    "nightly": ("nightly:nightly", "Draw scenes, check them on all engines, write a report."),
    "hunt": ("hunt:hunt_worst", "Hunt for the worst error / allowed."),
    "hard": ("hunt:hard", "Solve the hard cases on every engine: limits, change points, gaps."),
    "price": ("price:price", "Show what accuracy costs on a scene: digits against microseconds."),
    "effects": ("bench:effects", "Show what every effect costs on a scene."),
    "bench": ("bench:bench", "Measure time and error against C, the engines, SciPy and the closed form."),
    "program": ("solve:program", "Print the operations that the fast path runs for a scene."),
    "conform": ("replay:conform", "Test an engine on every joint, driver and status."),
    "engines": ("engines:print_engines", "Print what each engine can do, and why it refuses the rest."),
    "ledger": ("documents:ledger", "Recompute every printed number of the source documents."),
    "history": ("nightly:history", "Show the nights that were kept, and what has changed."),
    "problems export": ("documents:write_set", "Write the problem set: mechanisms with answers of 30 proved digits."),
    "problems grade": ("documents:grade", "Grade answers to the problem set: correct digits."),
    "baseline": ("nightly:baseline", "Compare the golden set with the accepted baseline."),
}
"""Command -> where it is in `crosscheck.commands`, and what the list of commands says of it."""

app = cyclopts.App(
    suppress_keyboard_interrupt=False,  # `main` says what is kept
    name="crosscheck",
    help="How many digits can you trust from exudyn, Pinocchio and MuJoCo, and what does each digit cost?",
    version_flags=["--version"],
    version=__version__,
)
app.command(cyclopts.App(name="problems", help="The problem set: write it, grade answers to it."))
app.register_install_completion_command(help="Have the shell complete commands and options.")
for name, (place, what) in COMMANDS.items():
    *group, own = name.split()
    (app[group[0]] if group else app).command(f"crosscheck.commands.{place}", name=own, help=what)


PATHS = ("--out", "--night", "--history", "--baseline", "--csv")
"""Options that take a path."""


def main(arguments: Sequence[str] | None = None) -> None:
    """Run the command line; whatever cannot be done ends with one line that says why, and no traceback."""
    if not os.environ.get("COLUMNS", "80").strip("0"):
        del os.environ["COLUMNS"]  # a terminal of no size says so, and nothing fits into it
    aside = Printable(_open(sys.stderr), BAR, aside=True)
    with redirect_stdout(Printable(_open(sys.stdout))), redirect_stderr(aside):
        code = _run(arguments)
    sys.exit(_lost(sys.stdout) or code)


def _lost(stream: TextIO | None) -> int:
    """Return the exit code, if what a stream still holds cannot be written; the stream keeps nothing then."""
    if stream is None:
        return 0
    try:
        stream.flush()
    except OSError as error:
        keep_nothing(stream)
        return UNREAD if isinstance(error, BrokenPipeError) else _ended(_said(error), INFRASTRUCTURE)
    return 0


def _open(stream: TextIO | None) -> TextIO:
    """Return a stream; for one that was closed by the shell, one that keeps nothing, in its place among the files.

    What its encoding cannot say is written out.
    """
    if stream is None:
        return open(os.devnull, "w", encoding="utf-8")
    if isinstance(stream, io.TextIOWrapper):
        stream.reconfigure(errors="backslashreplace")
    return stream


def _run(arguments: Sequence[str] | None) -> int:
    given = sys.argv[1:] if arguments is None else list(arguments)
    try:
        _refuse_no_path(given)
        code = app(given, exit_on_error=False, print_error=True)
    except CannotRun as error:
        code = _ended(error, error.code)
    except (InvalidScene, InvalidRequest) as error:
        code = _ended(error, USAGE)
    except cyclopts.CycloptsError:
        code = USAGE
    except BrokenPipeError:
        code = UNREAD
    except SystemExit as error:
        if not isinstance(error.__context__, BrokenPipeError):
            raise
        code = UNREAD  # rich says 1 of help that nobody reads
    except OSError as error:
        code = _ended(_said(error), INFRASTRUCTURE)
    except KeyboardInterrupt as error:
        code = _ended(error, getattr(error, "code", INTERRUPTED))
    except Exception as error:  # a fault of our own: said like any other, with the place to look at
        at = traceback.extract_tb(error.__traceback__)[-1]
        where = f"{at.name}, {Path(at.filename).name}:{at.lineno}"
        print(f"crosscheck itself failed: {type(error).__name__}: {error} ({where})", file=sys.stderr)
        code = INFRASTRUCTURE
    return int(code or PASS)


def _refuse_no_path(given: Sequence[str]) -> None:
    """Refuse an empty path, of which nobody could tell any more that it is not the folder that one is in."""
    for option in PATHS:
        if f"{option}=" in given or (option, "") in pairwise(given):
            raise UsageError(f"{option}: expected a path, got ''")


def _said(error: OSError) -> str:
    """Return what the system says, and of which file: no "[Errno 21]", which says nothing to who asked for it."""
    file = error.filename2 or error.filename
    return f"{file}: {error.strerror}" if file and error.strerror else error.strerror or str(error)


def _ended(error: BaseException | str, code: int) -> int:
    with suppress(OSError):  # a terminal that was closed hears nothing more
        print(str(error) or "interrupted", file=sys.stderr, flush=True)
    return code
