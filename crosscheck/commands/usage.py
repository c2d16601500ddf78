"""What commands have in common: exit codes, kinds of arguments, and what is said of arguments that make no sense."""

from __future__ import annotations

import math
import sys
from collections.abc import Sequence
from typing import Annotated, Any

from cyclopts import Parameter
from rich.console import Console

from crosscheck.engines import available
from crosscheck.night.campaign import ALWAYS, SAMPLED

PASS, DISAGREEMENT, USAGE, ENGINE_MISSING, INFRASTRUCTURE, NOTHING_RAN = range(6)
INTERRUPTED = 130
ENGINES = "exudyn,pinocchio,mujoco"


def _whole(_: Any, tokens: Sequence[Any]) -> int:
    """Return a whole number; cyclopts by itself takes 2.5 for 2."""
    try:
        return int(tokens[0].value)
    except ValueError as error:
        raise ValueError(f"expected a whole number, got {tokens[0].value!r}") from error


Whole = Annotated[int, Parameter(converter=_whole)]
Json = Annotated[bool, Parameter(name="--json", negative="")]


class UsageError(Exception):
    """A request on the command line that makes no sense."""


def positive(key: str, value: float | None) -> None:
    """Refuse a number that is not above 0 and finite; None was not given."""
    if value is not None and not 0 < value < math.inf:
        raise UsageError(f"--{key}: expected a number above 0, got {value}")


def names(text: str, always: tuple[str, ...] = (ALWAYS, *SAMPLED)) -> tuple[str, ...]:
    """Return the names in a list separated by commas; an engine nobody has heard of is a usage error."""
    named = [name.strip() for name in text.split(",") if name.strip()]
    known = available()
    for name in named:
        if name not in known and ":" not in name:
            raise UsageError(f"no engine is called {name!r}; there are: {', '.join(sorted(known))}, or file.py:Class")
    return tuple(dict.fromkeys((*always, *named)))


def console(width: int) -> Console:
    """Return standard output as a console, of this width where it is no terminal."""
    return Console(width=None if sys.stdout.isatty() else width, markup=False)
