"""What commands have in common: kinds of arguments, and what is said of arguments that make no sense."""

from __future__ import annotations

import math
import sys
from collections.abc import Sequence
from typing import TYPE_CHECKING, Annotated, Any

from cyclopts import Parameter

from crosscheck.errors import UsageError

if TYPE_CHECKING:
    from rich.console import Console


def _whole(_: Any, tokens: Sequence[Any]) -> int:
    """Return a whole number; cyclopts by itself takes 2.5 for 2."""
    try:
        return int(tokens[0].value)
    except ValueError as error:
        raise ValueError(f"expected a whole number, got {tokens[0].value!r}") from error


Whole = Annotated[int, Parameter(converter=_whole)]
Json = Annotated[bool, Parameter(name="--json", negative="")]


def positive(key: str, value: float | None) -> None:
    """Refuse a number that is not above 0 and finite; None was not given."""
    if value is not None and not 0 < value < math.inf:
        raise UsageError(f"--{key}: expected a number above 0, got {value}")


def console(width: int) -> Console:
    """Return standard output as a console, of this width where it is no terminal."""
    from rich.console import Console  # answers in JSON need none

    return Console(width=None if sys.stdout.isatty() else width, markup=False)
