"""The tables of what engines are known to get wrong: named predicates, reasons, dates. It is strict in both directions.

A disagreement that no row covers is new and turns the night red. A row whose reproduction no longer disagrees has to
go: the test suite fails until it is removed. A row that a whole night did not need, although scene after scene was of
its kind, is shown as possibly closed.

`findings.toml` is as strict about wrong answers to hard scenes: every wrong answer, crash and hang in their table needs
a finding, and a finding that no row shows any more has to go. A finding is a fault of the engine only where it
contradicts what the engine promises; each quotes what that is.
"""

from __future__ import annotations

import datetime
import tomllib
from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass
from enum import StrEnum
from importlib.resources import files
from pathlib import Path
from typing import Annotated, Any, Literal

from pydantic import AfterValidator, Field, StringConstraints, ValidationError

from crosscheck.errors import CannotRun, UsageError
from crosscheck.judge.records import BEYOND_NEWTON, Cause, Disagreement, Record, Strict, adapter, fault

Predicate = Callable[[Record], bool]


def step_beyond_newton(record: Record) -> bool:
    """Return whether the motion has a step so long that Newton, started at the last pose, is not bound to the next one.

    Newton-Kantorovich binds it while |J^-1| K step <= 1/2. In scaled coordinates the Jacobian changes by about one per
    unit (K = 1), and |J^-1| is 1 / sigma: so there is no bond where a step is longer than sigma_min / 2 at its ends.
    """
    distance = None if record.reference is None else record.reference.sigma_per_step
    return distance is not None and distance < BEYOND_NEWTON


def step_beyond_newton_in_space(record: Record) -> bool:
    """Return whether the scene is one of space with such a step."""
    return record.about.get("dimension") == "spatial" and step_beyond_newton(record)


def ends_in_a_singular_pose(record: Record) -> bool:
    """Return whether the scene was made to end in a singular pose (`crosscheck.strategies.ended_scenes`)."""
    return record.about.get("expected") == "singular"


def redundant_in_the_plane(record: Record) -> bool:
    """Return whether the scene is one of the plane with more constraint rows than coordinates."""
    redundant = record.reference is not None and record.reference.redundant
    return redundant and record.about.get("dimension") == "planar"


def anywhere(record: Record) -> bool:
    """Return True: the gap does not depend on the scene."""
    return True


OF_STEPS = (step_beyond_newton, step_beyond_newton_in_space)
PREDICATES: dict[str, Predicate] = {
    f.__name__: f for f in (*OF_STEPS, ends_in_a_singular_pose, redundant_in_the_plane, anywhere)
}
ENOUGH = 30
"""Scenes of its kind in which a gap should have shown: one that shows in a tenth is missed by one night in 24."""


class InvalidGap(CannotRun):
    """A row of the table that makes no sense."""


def _known(predicate: str) -> str:
    if predicate not in PREDICATES:
        raise ValueError(f"there are: {', '.join(PREDICATES)}")
    return predicate


class HardOutcome(StrEnum):
    """How an engine did on a scene."""

    CORRECT = "correct"
    """Every answer that is called ok is right."""
    WARNED = "warned"
    """Every answer is right, but one is not called ok, or the engine warned."""
    REFUSED = "refused"
    """A time has no answer, or none that is called ok and right."""
    WRONG = "wrong"
    """An answer that is called ok is outside of what is allowed."""
    CRASH = "crash"
    """The engine ended its process."""
    HANG = "hang"
    """It took too long, and was ended."""


BAD = (HardOutcome.WRONG, HardOutcome.CRASH, HardOutcome.HANG)
"""Verdicts that need an explanation: `findings.toml`."""


def unexplained(rows: Sequence[Mapping[str, Any]]) -> list[Mapping[str, Any]]:
    """Return the rows of hard cases whose verdict needs an explanation that no finding gives."""
    return [row for row in rows if row["verdict"] in BAD and row["class"] is None]


Text = Annotated[str, StringConstraints(min_length=1)]
Date = Annotated[datetime.date, Field(strict=True)]
KindOfGap = Literal["contract violated", "documented limit", "our misuse"]


@dataclass(frozen=True, kw_only=True)
class KnownGap(Strict):
    """One row: whose gap, where (`predicate`), why, since when, and a scene that shows it.

    `method`, `quantity` and `kind` are those of the disagreements that it accounts for; any, where one is not said. One
    that holds anywhere says what goes wrong, or it would turn no night red again.
    """

    engine: Text
    predicate: Annotated[str, AfterValidator(_known)]
    reason: Text
    kind_of_gap: Annotated[KindOfGap, Field(alias="class")]
    date: Date
    reproduction: Text
    method: str = ""
    quantity: str = ""
    kind: str = ""

    @property
    def match(self) -> dict[str, str]:
        """What it says of method, quantity and kind."""
        return {key: getattr(self, key) for key in ("method", "quantity", "kind") if getattr(self, key)}

    def covers(self, record: Record, disagreement: Disagreement) -> bool:
        """Return whether this row accounts for a disagreement of a record."""
        d = disagreement
        has = {"method": (d.method,), "quantity": (d.quantity,), "kind": (d.kind, d.name)}
        fits = d.engine == self.engine and all(value in has[key] for key, value in self.match.items())
        if PREDICATES[self.predicate] in OF_STEPS:  # one later explains nothing
            fits &= not d.bound
        if d.kind is Cause.NO_ANSWER and PREDICATES[self.predicate] in OF_STEPS:  # there is a pose to step from
            fits &= any(
                a.missing < a.times for a in record.answers if (a.engine, a.method.name) == (d.engine, d.method)
            )
        return fits and self.holds(record)

    def holds(self, record: Record) -> bool:
        """Return whether the scene of a record is of the kind in which the gap shows; not if nothing is known of it."""
        return record.reference is not None and PREDICATES[self.predicate](record)

    def could_show(self, record: Record) -> bool:
        """Return whether the engine answered a scene in which the gap could show."""
        methods = {answer.method.name for answer in record.answers if answer.engine == self.engine}
        return bool(methods) and (self.method or "rows") in (*methods, "rows") and self.holds(record)


class Tally:
    """Sorts disagreements into known and new, record by record, and counts what each row of the table was good for."""

    def __init__(self, gaps: Sequence[KnownGap]) -> None:
        self.gaps = tuple(gaps)
        self.chances = [0] * len(self.gaps)
        self.covered = [0] * len(self.gaps)

    def add(self, record: Record) -> list[Disagreement]:
        """Return the disagreements of a record that no row covers."""
        new = []
        for k, gap in enumerate(self.gaps):
            self.chances[k] += gap.could_show(record)
        for disagreement in record.disagreements:
            rows = [k for k, gap in enumerate(self.gaps) if gap.covers(record, disagreement)]
            for k in rows:
                self.covered[k] += 1
            if not rows:
                new.append(disagreement)
        return new

    def possibly_closed(self) -> list[tuple[KnownGap, int]]:
        """Return the rows that covered nothing although many scenes were of their kind, and how many were."""
        counted = zip(self.gaps, self.chances, self.covered, strict=True)
        return [(gap, chances) for gap, chances, covered in counted if chances >= ENOUGH and not covered]


def table(choice: str = "") -> tuple[KnownGap, ...]:
    """Return the table that a run is held against: our own, that of a file, or for "none" one without rows.

    UsageError if the file makes no sense, or cannot be read.
    """
    if choice == "none":
        return ()
    try:
        return read(Path(choice).read_text(encoding="utf-8") if choice else None)
    except (InvalidGap, UnicodeDecodeError, OSError) as error:
        raise UsageError(f"{choice}: {getattr(error, 'strerror', None) or error}") from error


def told(record: Record, disagreement: Disagreement) -> str:
    """Return a disagreement of a record in words, with the gap of ours that accounts for it, if one does."""
    gap = next((gap for gap in read() if gap.covers(record, disagreement)), None)
    return f"{disagreement}{f' [known since {gap.date}: {gap.reason}]' if gap else ''}"


def found_again(gaps: Sequence[KnownGap], records: Iterable[Record]) -> list[int | None]:
    """Return for each row how many records it took until one showed it; None if none did.

    For a run against an empty table: it should find every row of our own that the installed engines still have.
    """
    first: list[int | None] = [None] * len(gaps)
    for number, record in enumerate(records, start=1):
        for k, gap in enumerate(gaps):
            if first[k] is None and any(gap.covers(record, disagreement) for disagreement in record.disagreements):
                first[k] = number
    return first


def read(text: str | None = None) -> tuple[KnownGap, ...]:
    """Return the rows of the table; raises InvalidGap naming the row and key that is wrong."""
    rows: tuple[KnownGap, ...] = _rows_of(KnownGap, "gap", "known_gaps.toml", text)
    for k, row in enumerate(rows):
        if row.predicate == anywhere.__name__ and not (row.quantity or row.kind):
            message = f"gap.{k}.predicate: {row.predicate!r}; expected a quantity or a kind beside it: else it covers"
            raise InvalidGap(f"{message} whatever goes wrong, crashes too")
    return rows


def _rows_of(kind: Any, key: str, file: str, text: str | None) -> tuple[Any, ...]:
    """Return the rows that stand under a key in TOML: in a file beside this module, or in a text of its form.

    What a person writes there says something: an empty text would be taken for what is left out, which is any.
    """
    if text is None:
        text = files("crosscheck.judge").joinpath(file).read_text(encoding="utf-8")
    try:
        table = tomllib.loads(text)
        written = table.pop(key, [])
        rows: tuple[Any, ...] = adapter(tuple[kind, ...]).validate_python(written)
    except tomllib.TOMLDecodeError as error:
        raise InvalidGap(f"no TOML: {error}") from error
    except ValidationError as error:
        raise InvalidGap(fault(error, key)) from error
    empty = [f"{key}.{k}.{name}" for k, row in enumerate(written) for name, value in row.items() if value == ""]
    if empty:
        raise InvalidGap(f"{empty[0]}: ''; expected a text, or no such key")
    if table:
        raise InvalidGap(f"{', '.join(table)}: no such key; there is: {key}")
    return rows


@dataclass(frozen=True, kw_only=True)
class Finding(Strict):
    """One finding.

    The `cases` are the kinds of hard scenes that show it; there are none for a feature, which a night asks by itself.
    `kind`, in the file `class`, is whose fault it is; `quote` and `source` are what the engine's documentation says,
    word for word, and where, `reason` and `since` what happens, and in which versions. It is shown by a minimal `scene`
    or a `script` in the engine's own API, from the root of the project; one of them may be "".
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


def read_findings(text: str | None = None) -> tuple[Finding, ...]:
    """Return the findings; raises InvalidGap naming the finding and key that is wrong."""
    return _rows_of(Finding, "finding", "findings.toml", text)


def finding_of(known: Sequence[Finding], row: Mapping[str, Any]) -> Finding | None:
    """Return the finding that explains a row of the table, if there is one."""
    who = tuple(row[key] for key in ("engine", "method", "verdict"))
    return next((f for f in known if (f.engine, f.method, f.verdict) == who and row["case"] in f.cases), None)
