"""What is known of wrong answers to hard scenes, strict in both directions: `findings.toml`.

Every wrong answer, crash and hang in the table needs a finding, and a finding that no row shows any more has to go. A
finding is a fault of the engine only where it contradicts what the engine promises; each quotes what that is.
"""

from __future__ import annotations

import datetime
import tomllib
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from importlib.resources import files
from typing import Any

from crosscheck.judge.known_gaps import CLASSES, InvalidGap

KEYS = (
    *("engine", "method", "cases", "verdict", "class", "quote", "source"),
    *("reason", "scene", "script", "since", "date"),
)
SHOWN_BY = ("scene", "script")
OPTIONAL = (*SHOWN_BY, "cases")


@dataclass(frozen=True, kw_only=True)
class Finding:
    """One finding.

    Attributes
    ----------
    engine, method, verdict : str
        Whose answers, and what they are classed as.
    cases : tuple of str
        The kinds of hard scenes that show it; none for a feature, which a night asks by itself.
    kind : str
        One of `crosscheck.judge.known_gaps.CLASSES`.
    quote, source : str
        What the engine's documentation says, word for word, and where.
    reason, since : str
        What happens, and which versions show it.
    scene, script : str
        A minimal scene, and a script in the engine's own API, from the root of the project; one of them may be "".
    """

    engine: str
    method: str
    cases: tuple[str, ...]
    verdict: str
    kind: str
    quote: str
    source: str
    reason: str
    since: str
    date: datetime.date
    scene: str = ""
    script: str = ""


def read(text: str | None = None) -> tuple[Finding, ...]:
    """Return the findings.

    Raises
    ------
    InvalidGap
        Naming the finding and key that is wrong.
    """
    if text is None:
        text = files("crosscheck.judge").joinpath("findings.toml").read_text(encoding="utf-8")
    try:
        table = tomllib.loads(text)
    except tomllib.TOMLDecodeError as error:
        raise InvalidGap(f"findings.toml: {error}") from error
    return tuple(_finding(k, row) for k, row in enumerate(table.get("finding", [])))


def finding_of(known: Sequence[Finding], engine: str, method: str, case: str, verdict: str) -> Finding | None:
    """Return the finding that explains a row of the table, if there is one."""
    return next(
        (f for f in known if (f.engine, f.method, f.verdict) == (engine, method, verdict) and case in f.cases), None
    )


def closed(known: Sequence[Finding], rows: Sequence[Mapping[str, Any]]) -> list[tuple[Finding, str]]:
    """Return the findings, each with a case, that the table shows no more although the engine was asked."""
    asked = {(row["engine"], row["method"], row["case"]) for row in rows}
    shown = {(row["engine"], row["method"], row["case"], row["verdict"]) for row in rows}
    return [
        (f, case)
        for f in known
        for case in f.cases
        if (f.engine, f.method, case) in asked and (f.engine, f.method, case, f.verdict) not in shown
    ]


def _finding(k: int, row: Mapping[str, Any]) -> Finding:
    for key in KEYS:
        if key not in row and key not in OPTIONAL:
            raise InvalidGap(f"finding[{k}].{key} is missing")
    for key, value in row.items():
        expected = {"cases": list, "date": datetime.date}.get(key, str)
        if key not in KEYS:
            raise InvalidGap(f"finding[{k}].{key}: no such key; there are: {', '.join(KEYS)}")
        if type(value) is not expected or not value:
            raise InvalidGap(f"finding[{k}].{key}: {value!r}; expected {expected.__name__}")
    if not row.keys() & set(SHOWN_BY):
        raise InvalidGap(f"finding[{k}]: neither scene nor script: nothing shows it")
    if row["class"] not in CLASSES:
        raise InvalidGap(f"finding[{k}].class: {row['class']!r}; there are: {', '.join(CLASSES)}")
    named = {key: row[key] for key in KEYS if key not in ("class", "cases") and key in row}
    return Finding(**named, kind=row["class"], cases=tuple(row.get("cases", ())))
