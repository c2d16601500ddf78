"""What ends a command with one line and an exit code of its own, and the exit codes."""

from __future__ import annotations

import re
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

MOST_CHARACTERS = 2000
"""Of what an engine says, so many are kept."""
MOST_QUOTED = 100
"""Of what is asked for, so many are repeated in a message."""
CONTROL = re.compile("[\x00-\x08\x0b-\x1f\x7f-\x9f\u061c\u200e\u200f\u202a-\u202e\u2066-\u2069]")
"""What moves a terminal's cursor, sets its title or turns the direction of text: everything but lines and tabs."""
PASS, DISAGREEMENT, USAGE, ENGINE_MISSING, INFRASTRUCTURE, NOTHING_RAN = range(6)
INTERRUPTED, UNREAD = 130, 141
"""As a shell says of a program that was interrupted, and of one whose output nobody reads any more."""


class CannotRun(Exception):
    """A command that cannot go on; its text is the one line that a person reads."""

    code = INFRASTRUCTURE
    """The exit code: something outside of the request is not as it has to be."""


class UsageError(CannotRun):
    """A request that makes no sense."""

    code = USAGE


class Terminated(KeyboardInterrupt):
    """Asked to end by a signal, which ends what Ctrl-C ends; its exit code is the one that a shell tells it by."""

    def __init__(self, number: int) -> None:
        super().__init__("terminated")
        self.code = 128 + number


def kept(text: str) -> str:
    """Return what an engine says as records hold it: of bounded length, and what UTF-8 cannot say written out."""
    text = text if len(text) <= MOST_CHARACTERS else f"{text[:MOST_CHARACTERS]} ..."
    return text.encode("utf-8", "backslashreplace").decode()


def printable(text: str) -> str:
    """Return text with its control characters as they are written in a string."""
    return CONTROL.sub(lambda match: match[0].encode("unicode_escape").decode(), text)


def quoted(text: str) -> str:
    """Return text in quotes, as one line of a message has room for it."""
    return repr(text) if len(text) <= MOST_QUOTED else f"{text[:MOST_QUOTED]!r}... ({len(text)} characters)"


@contextmanager
def naming(path: Path) -> Iterator[None]:
    """Name the file in what the system says while it is written: of a full disk it says no more than that."""
    try:
        yield
    except OSError as error:
        error.filename = error.filename or str(path)
        raise
