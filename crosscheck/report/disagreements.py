"""The disagreements of a run, one row per kind: new, or explained by a known gap; and the results of features."""

from __future__ import annotations

import math
from collections import Counter
from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

from crosscheck.judge.known_gaps import KnownGap
from crosscheck.judge.records import Cause, Disagreement, NewCase, Record
from crosscheck.night.plan import AGAIN
from crosscheck.report.cells import RecordLine, WorstSample, sample, worse
from crosscheck.scenes.names import QUANTITIES

MOST_EXAMPLES = 5
"""Examples kept per kind; a night in which everything fails still fits a page."""
MOST_TEXT = 20_000
"""Characters of a scene file that are shown."""

Identity = tuple[str, str, str, str, str]
"""Record key, engine, method, quantity, kind."""


@dataclass
class DisagreementGroup:
    """The disagreements that share engine, method, quantity and kind, and the gap that accounts for them, if any."""

    signature: tuple[str, str, str, str]
    gap: KnownGap | None
    keys: set[str] = field(default_factory=set)
    worst: WorstSample | None = None
    examples: list[dict[str, Any]] = field(default_factory=list)

    def add(self, place: RecordLine, disagreement: Disagreement, extra: Mapping[str, Any]) -> None:
        """Add one more; a shrunk example goes first. A scene counts once, however many joints of it are blamed."""
        self.keys.add(place.key)
        self.worst = worse(self.worst, disagreement.ratio, place, disagreement.at)
        example = {**vars(place), **sample(disagreement.at), "message": disagreement.message, **extra}
        if example.get("shrunk"):
            self.examples.insert(0, example)
        else:
            self.examples.append(example)
        del self.examples[MOST_EXAMPLES:]

    def described(self) -> dict[str, Any]:
        """Return it as plain data."""
        signature = dict(zip(("engine", "method", "quantity", "kind"), self.signature, strict=True))
        return {
            **signature,
            "known": self.gap is not None,
            "reason": self.gap.reason if self.gap else None,
            "scenes": len(self.keys),
            "worst": self.worst.described() if self.worst else None,
            "examples": self.examples,
        }


class Disagreements:
    """Judges every record by the table of known gaps, and compares with what the run itself called new.

    What either calls new is new: a disagreement is never lost between the two.
    """

    def __init__(self, folder: Path, gaps: Sequence[KnownGap], new: Sequence[NewCase]) -> None:
        self.folder, self.gaps = folder, gaps
        self.reported: dict[Identity, NewCase] = {(case.key, *case.disagreement.signature): case for case in new}
        self.seen: set[Identity] = set()
        self.groups: dict[tuple[Any, ...], DisagreementGroup] = {}
        self.covered = [0] * len(gaps)
        self.new: Counter[str] = Counter()
        self.known = 0

    def add(self, place: RecordLine, record: Record) -> list[tuple[Disagreement, bool]]:
        """Count the disagreements of one record and return each with whether it is new."""
        disagreements = [*record.disagreements, *implied(record)]
        sorted_out = []
        for disagreement in disagreements:
            identity = (record.key, *disagreement.signature)
            self.seen.add(identity)
            gap = None if identity in self.reported else self._gap(record, disagreement)
            self._count(place, disagreement, gap, self._files(identity))
            sorted_out.append((disagreement, gap is None))
        return sorted_out

    def finish(self) -> list[Disagreement]:
        """Count and return what the run called new and no record holds."""
        rest = []
        for identity, case in self.reported.items():
            if identity not in self.seen:
                self._count(RecordLine(case.key, "", 0), case.disagreement, None, self._files(identity))
                rest.append(case.disagreement)
        return rest

    def described(self) -> list[dict[str, Any]]:
        """Return one row per kind, new ones first, most frequent first; the first example of each with its scene."""
        order = sorted(self.groups.values(), key=lambda g: (g.gap is not None, -len(g.keys), g.signature))
        rows = [group.described() for group in order]
        for row in rows:
            for example in row["examples"][:1]:
                path = self._path(example.get("file") or "")
                text = path.read_text(encoding="utf-8", errors="replace")[:MOST_TEXT] if path else None
                example["toml"], example["again"] = text, _again(text, example["file"]) if text else None
        return rows

    def _gap(self, record: Record, disagreement: Disagreement) -> KnownGap | None:
        for k, gap in enumerate(self.gaps):
            if gap.covers(record, disagreement):
                self.covered[k] += 1
                return gap
        return None

    def _count(
        self, place: RecordLine, disagreement: Disagreement, gap: KnownGap | None, extra: Mapping[str, Any]
    ) -> None:
        which = None if gap is None else self.gaps.index(gap)
        group = self.groups.setdefault((disagreement.signature, which), DisagreementGroup(disagreement.signature, gap))
        group.add(place, disagreement, extra)
        if gap is None:
            self.new[disagreement.engine] += 1
        else:
            self.known += 1

    def _files(self, identity: Identity) -> dict[str, Any]:
        """Return the scene file of a disagreement, as the run tells it or as it is named."""
        case = self.reported.get(identity)
        name = (case.file if case else None) or f"disagreements/{identity[0]}.toml"
        held = self._path(name)
        return {"file": name if held else None, "shrunk": bool(case and case.shrunk and held)}

    def _path(self, name: str) -> Path | None:
        """Return a file inside the folder; None if there is none, or the name leads out of it."""
        try:
            path = (self.folder / name).resolve()
            return path if path.is_relative_to(self.folder.resolve()) and path.is_file() else None
        except (OSError, ValueError):  # a name too long, or with a null character
            return None


def _again(text: str, file: str) -> str:
    """Return what a scene file says of how to see again what it shows, as it is done in the folder of the night.

    Its own line stands below all that an engine said.
    """
    lines = [line for line in text.splitlines() if line.startswith(AGAIN)]
    line = lines[-1] if lines else f"{AGAIN}{Path(file).name}"
    return line.removeprefix("# Show it again: ").replace(Path(file).name, file, 1)


def implied(record: Record) -> Iterator[Disagreement]:
    """Yield what the numbers of a record say and its list of disagreements does not.

    Whoever wrote the record should have listed it; that a list is empty is no proof. A joint put together the wrong way
    round accounts for everything that its answer is off by.
    """
    listed = {(d.engine, d.method, d.quantity) for d in record.disagreements}
    listed |= {(d.engine, d.method, q) for d in record.disagreements if d.kind is Cause.REVERSED for q in QUANTITIES}
    implied_ones = []
    reference = record.reference
    if reference is not None and reference.verdict != record.about.get("expected", "ok"):
        who: Any = {"engine": "refkin", "method": "newton", "quantity": "status"}
        how, message = reference.verdict, reference.message
        implied_ones.append(Disagreement(**who, kind=Cause.REFERENCE, how=how, message=message))
    for answer in record.answers:
        for name, q in answer.quantities.items():
            ratio = math.nan if q.ratio is None else q.ratio
            kind = Cause.BEYOND if ratio > 1.0 else Cause.NO_NUMBER
            if ratio > 1.0 or (answer.compared and math.isnan(ratio)):
                who = {"engine": answer.engine, "method": answer.method.name, "quantity": name}
                implied_ones.append(Disagreement(**who, kind=kind, ratio=q.ratio, at=q.worst))
    for row in record.levels:
        if row.ratio is None or not row.ratio <= 1.0:
            who = {"engine": row.engine, "method": "rows", "quantity": row.level}
            implied_ones.append(Disagreement(**who, kind=Cause.TRANSLATED, ratio=row.ratio, at=row.worst))
    yield from (d for d in implied_ones if (d.engine, d.method, d.quantity) not in listed)


@dataclass
class _Feature:
    """One feature of one engine: scenes in which it answered, and a known gap, or nothing, accounts for its faults."""

    version: str
    scenes: int = 0
    known: int = 0
    new: int = 0
    worst: WorstSample | None = None
    quantities: set[str] = field(default_factory=set)


class Features:
    """Counts the answers of features, which are no answers of their engines' other methods."""

    def __init__(self) -> None:
        self.rows: dict[tuple[str, str], _Feature] = {}

    def add(self, record: Record, place: RecordLine) -> None:
        """Count the answers of one record."""
        for answer in record.answers:
            if answer.feature:
                row = self.rows.setdefault((answer.engine, answer.method.name), _Feature(answer.version))
                row.scenes += 1
                for quantity in answer.quantities.values():
                    row.worst = worse(row.worst, quantity.ratio, place, quantity.worst)

    def blame(self, met: Iterable[tuple[Disagreement, bool]]) -> list[tuple[Disagreement, bool]]:
        """Count the disagreements of features, each with whether it is new, and return the others of the record."""
        rest: list[tuple[Disagreement, bool]] = []
        blamed: dict[tuple[str, str], bool] = {}
        for disagreement, is_new in met:
            who = disagreement.engine, disagreement.method
            if who not in self.rows:
                rest.append((disagreement, is_new))
                continue
            blamed[who] = blamed.get(who, False) or is_new
            self.rows[who].quantities.add(disagreement.quantity)
        for who, is_new in blamed.items():
            self.rows[who].new += is_new
            self.rows[who].known += not is_new
        return rest

    def described(self, gaps: Iterable[KnownGap]) -> list[dict[str, Any]]:
        """Return the rows, each with what the table of known gaps says of it."""
        known = {(gap.engine, gap.method): gap for gap in gaps}
        return [
            {
                "engine": engine,
                "feature": name,
                "version": row.version,
                "scenes": row.scenes,
                "wrong": row.known + row.new,
                "new": row.new,
                "quantities": sorted(row.quantities),
                "worst": row.worst.described() if row.worst else None,
                "class": getattr(known.get((engine, name)), "kind_of_gap", None),
                "reason": getattr(known.get((engine, name)), "reason", None),
            }
            for (engine, name), row in sorted(self.rows.items())
        ]
