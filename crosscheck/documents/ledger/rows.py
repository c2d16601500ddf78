"""The rows of the ledger as `ledger.toml` holds them."""

from __future__ import annotations

import json
import tomllib
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from functools import cache
from importlib.resources import files
from typing import Any, ClassVar, Literal

from pydantic import TypeAdapter

STRICT: dict[str, Any] = {"extra": "forbid", "strict": True}
Leaf = str | int | bool
Tree = Any
"""A leaf, or a list of trees."""


@dataclass(frozen=True, kw_only=True)
class Value:
    """One quantity of a row.

    Attributes
    ----------
    name : str
        As the computation names it.
    truth : tree of leaves
        A decimal number to all digits that are known (as text), a whole number, yes or no, or a word.
    printed : tree of text
        What the document prints, where it prints something; "" where it does not.
    between : pair of text
        Instead of a truth, for what depends on rounding: two numbers it lies between.
    """

    name: str
    truth: Tree = None
    printed: Tree = None
    between: tuple[str, str] | None = None
    __pydantic_config__: ClassVar[dict[str, Any]] = STRICT


@dataclass(frozen=True, kw_only=True)
class Erratum:
    """What is wrong in a document.

    Attributes
    ----------
    kind : str
        "wrong" or "truncated": the numbers `at`; "formula", "claim": shown by the quantity `shown_by`; "notation".
    at : tuple of str
        Which printed numbers, such as "f'[1]" or "q[2][0]".
    cause : str
    explained_by : tuple of str
        One for each of `at`: the number that stands there instead, which the document took for the right one.
    shown_by : str
        The quantity of the row that shows a formula or a claim to be wrong.
    counts : int
        How many of the errata of the documents this is; 0 for a remark.
    reading : str
        Set if the page may have been read wrongly: what it may say instead.
    """

    kind: Literal["wrong", "truncated", "formula", "claim", "notation"]
    cause: str
    at: tuple[str, ...] = ()
    explained_by: tuple[str, ...] = ()
    shown_by: str = ""
    counts: int = 1
    reading: str = ""
    __pydantic_config__: ClassVar[dict[str, Any]] = STRICT


@dataclass(frozen=True, kw_only=True)
class Row:
    """One system, algorithm or printed number of the source documents.

    Attributes
    ----------
    computation : str
        module:function of this package that recomputes it in binary64 and on balls.
    also : tuple of str
        Functions that recompute it by other parts of the project.
    inferred : str
        What the document does not fix, because a figure or a number is lost, and how it is read here.
    open : str
        What cannot be checked yet, and why; such a row is never called passed.
    """

    id: str
    document: str
    item: str
    computation: str = ""
    also: tuple[str, ...] = ()
    inputs: Mapping[str, Any] = field(default_factory=dict)
    values: tuple[Value, ...] = ()
    errata: tuple[Erratum, ...] = ()
    inferred: str = ""
    open: str = ""
    note: str = ""
    __pydantic_config__: ClassVar[dict[str, Any]] = STRICT


@dataclass(frozen=True, kw_only=True)
class Ledger:
    """The whole file; `documents` are title and place by key."""

    documents: Mapping[str, str]
    row: tuple[Row, ...]
    __pydantic_config__: ClassVar[dict[str, Any]] = STRICT


@cache
def read() -> Ledger:
    """Return the ledger."""
    text = files("crosscheck.documents.ledger").joinpath("ledger.toml").read_text(encoding="utf-8")
    return TypeAdapter(Ledger).validate_json(json.dumps(tomllib.loads(text)))


def leaves(name: str, tree: Any) -> Iterator[tuple[str, Any]]:
    """Yield (path, leaf) for each leaf of a tree: "q[2][0]"."""
    if isinstance(tree, Sequence) and not isinstance(tree, str):
        for k, part in enumerate(tree):
            yield from leaves(f"{name}[{k}]", part)
    else:
        yield name, tree
