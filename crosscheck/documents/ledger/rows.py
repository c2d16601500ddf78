"""The rows of the ledger as `ledger.toml` holds them, and decimal numbers as they are written.

Of a written number: how much its last digit says, and how many of its digits are right.
"""

from __future__ import annotations

import json
import math
import tomllib
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from decimal import Decimal, InvalidOperation
from enum import StrEnum
from functools import cache
from importlib.resources import files
from typing import Any, ClassVar, Literal

from flint import arb
from pydantic import TypeAdapter


class Printed(StrEnum):
    """What a printed number is to the true one."""

    RIGHT = "right"
    """It is that number, rounded to the digits that are printed."""
    TRUNCATED = "truncated"
    """It is, but cut off where it should be rounded."""
    WRONG = "wrong"
    """It is neither."""


@dataclass(frozen=True)
class Written:
    """A decimal number with the place of its last digit.

    `value` is a ball around what `text` says, as narrow as the precision in force; `unit` one of its last digit;
    `digits` the significant ones that are written, of a zero those behind the point and at least one.
    """

    text: str
    value: Any
    unit: Decimal
    digits: int

    @classmethod
    def read(cls, text: str) -> Written:
        """Read a number; ValueError if the text is no finite decimal number."""
        try:
            number = Decimal(text)
        except InvalidOperation:
            raise ValueError(f"expected a decimal number, got {text!r}") from None
        if not number.is_finite():
            raise ValueError(f"expected a finite number, got {text!r}")
        exponent = int(number.as_tuple().exponent)
        digits = len(number.as_tuple().digits) if number else max(1, -exponent)
        return cls(text, arb(text), Decimal(1).scaleb(exponent), digits)

    @property
    def half(self) -> Any:
        """Half a unit of the last digit, as an `arb`: what correct rounding may change."""
        return arb(str(self.unit)) / 2


def printed_is(printed: Written, truth: Any) -> Printed:
    """Return what a printed number is to a ball around the truth; a tie may be rounded either way."""
    away = abs(printed.value - truth)
    slack = arb(2) ** -100 * (printed.half + abs(truth))
    if away <= printed.half + slack:
        return Printed.RIGHT
    towards_zero = printed.value * truth >= 0 and abs(printed.value) <= abs(truth)
    return Printed.TRUNCATED if towards_zero and away < 2 * printed.half else Printed.WRONG


def correct_digits(printed: Written, truth: Any) -> float:
    """Return how many digits of a printed number are right: all if it is correctly rounded, else -log10 of its error.

    The error is taken relative to the truth; the result is cut to a tenth and lies between 0 and the digits printed.
    """
    if printed_is(printed, truth) is Printed.RIGHT:
        return float(printed.digits)
    size = abs(float(truth))
    if size == 0.0:
        return 0.0
    digits = -math.log10(abs(float(printed.value - truth)) / size)
    return math.floor(10 * min(max(digits, 0.0), printed.digits)) / 10


class _StrictRow:
    """What the file of the ledger says is of the types that stand here, and nothing else is in it."""

    __pydantic_config__: ClassVar[dict[str, Any]] = {"extra": "forbid", "strict": True}


Tree = Any
"""A text, a whole number, yes or no, or a list of trees."""


@dataclass(frozen=True, kw_only=True)
class Value(_StrictRow):
    """One quantity of a row, as the computation names it.

    Leaves of `truth` are decimal numbers to all digits that are known (as text), whole numbers, yes or no, or words,
    those of `printed` what the document prints, "" where it prints nothing. What depends on rounding has no truth, but
    lies `between` two numbers.
    """

    name: str
    truth: Tree = None
    printed: Tree = None
    between: tuple[str, str] | None = None


@dataclass(frozen=True, kw_only=True)
class Erratum(_StrictRow):
    """What is wrong in a document.

    The printed numbers `at`, such as "f'[1]" or "q[2][0]", are "wrong" or "truncated"; for each of them `explained_by`
    may have the number that stands there instead, which the document took for the right one. A "formula" or a "claim"
    is shown to be wrong by a number of the row, `shown_by`: were it right, that would be what is `claimed`. `counts` is
    how many of the errata of the documents this is, 0 for a remark; `reading` is set if the page may have been read
    wrongly: what it may say instead.
    """

    kind: Literal["wrong", "truncated", "formula", "claim", "notation"]
    cause: str
    at: tuple[str, ...] = ()
    explained_by: tuple[str, ...] = ()
    shown_by: str = ""
    claimed: Tree = None
    counts: int = 1
    reading: str = ""


@dataclass(frozen=True, kw_only=True)
class LedgerRow(_StrictRow):
    """One system, algorithm or printed number of the source documents.

    `module` is that of this package whose functions recompute it; it is named by the `document`. `inferred` says what
    that does not fix, because a figure or a number is lost, and how it is read here; `open` what cannot be checked yet,
    and why: such a row is never called passed.
    """

    id: str
    module: str
    document: str
    item: str
    inputs: Mapping[str, Any] = field(default_factory=dict)
    values: tuple[Value, ...] = ()
    errata: tuple[Erratum, ...] = ()
    inferred: str = ""
    open: str = ""
    note: str = ""


@dataclass(frozen=True, kw_only=True)
class Ledger(_StrictRow):
    """The whole file; `documents` are title and place by key."""

    documents: Mapping[str, str]
    row: tuple[LedgerRow, ...]


@cache
def read() -> Ledger:
    """Return the ledger."""
    whole = tomllib.loads(files("crosscheck.documents.ledger").joinpath("ledger.toml").read_text(encoding="utf-8"))
    documents = whole.pop("documents")
    named, rows = {name.lower(): name for name in documents}, list[dict[str, Any]]()
    for module, table in whole.items():
        about = {"module": module, "document": named[module.partition("_")[0]]}
        rows += [{"id": key, **about, **row} for key, row in table.items()]
    rows.sort(key=lambda row: (row["id"][0], int(row["id"][1:])))
    return TypeAdapter(Ledger).validate_json(json.dumps({"documents": documents, "row": rows}))


def leaves(name: str, tree: Any) -> Iterator[tuple[str, Any]]:
    """Yield (path, leaf) for each leaf of a tree: "q[2][0]"."""
    if isinstance(tree, Sequence) and not isinstance(tree, str):
        for k, part in enumerate(tree):
            yield from leaves(f"{name}[{k}]", part)
    else:
        yield name, tree
