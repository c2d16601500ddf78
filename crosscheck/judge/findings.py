"""What is known of wrong answers to hard scenes, strict in both directions: `findings.toml`.

Every wrong answer, crash and hang in the table needs a finding, and a finding that no row shows any more has to go. A
finding is a fault of the engine only where it contradicts what the engine promises; each quotes what that is.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Annotated, Any

from pydantic import Field

from crosscheck.judge.known_gaps import Date, KindOfGap, Text, rows_of
from crosscheck.judge.records import Strict


@dataclass(frozen=True, kw_only=True)
class Finding(Strict):
    """One finding.

    Attributes
    ----------
    engine, method, verdict : str
        Whose answers, and what they are classed as.
    cases : tuple of str
        The kinds of hard scenes that show it; none for a feature, which a night asks by itself.
    kind : str
        Under `class` in the file: whose fault it is.
    quote, source : str
        What the engine's documentation says, word for word, and where.
    reason, since : str
        What happens, and which versions show it.
    scene, script : str
        A minimal scene, and a script in the engine's own API, from the root of the project; one of them may be "".
    """

    engine: Text
    method: Text
    cases: Annotated[tuple[Text, ...], Field(min_length=1)] = ()
    verdict: Text
    kind: Annotated[KindOfGap, Field(validation_alias="class")]
    quote: Text
    source: Text
    reason: Text
    since: Text
    date: Date
    scene: Text = ""
    script: Text = ""

    def __post_init__(self) -> None:
        if not (self.scene or self.script):
            raise ValueError("neither scene nor script: nothing shows it")


def read(text: str | None = None) -> tuple[Finding, ...]:
    """Return the findings; raises InvalidGap naming the finding and key that is wrong."""
    return rows_of(Finding, "finding", "findings.toml", text)


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
