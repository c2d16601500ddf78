"""What the features of engines that a night asks by themselves came to: one row for each."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass, field
from typing import Any

from crosscheck.judge.known_gaps import KnownGap
from crosscheck.judge.records import Disagreement, Record
from crosscheck.report.cells import Place, WorstSample, worse


@dataclass
class _Feature:
    """One feature of one engine.

    Attributes
    ----------
    scenes, known, new : int
        Scenes in which it answered; in which a known gap, or nothing, accounts for what disagrees.
    """

    version: str
    scenes: int = 0
    known: int = 0
    new: int = 0
    worst: WorstSample | None = None
    quantities: set[str] = field(default_factory=set)


class Features:
    """Counts the answers of features, which are no answers of their engines' other routes."""

    def __init__(self) -> None:
        self.rows: dict[tuple[str, str], _Feature] = {}

    def add(self, record: Record, place: Place) -> None:
        """Count the answers of one record."""
        for answer in record.answers:
            if answer.feature:
                row = self.rows.setdefault((answer.engine, answer.route.name), _Feature(answer.version))
                row.scenes += 1
                for quantity in answer.quantities.values():
                    row.worst = worse(row.worst, quantity.ratio, place, quantity.worst)

    def blame(self, met: Iterable[tuple[Disagreement, bool]]) -> list[tuple[Disagreement, bool]]:
        """Count the disagreements of features, each with whether it is new, and return the others of the record."""
        rest: list[tuple[Disagreement, bool]] = []
        blamed: dict[tuple[str, str], bool] = {}
        for disagreement, is_new in met:
            who = disagreement.engine, disagreement.route
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
        known = {(gap.engine, gap.match.get("route")): gap for gap in gaps}
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
                "class": known[engine, name].kind_of_gap if (engine, name) in known else None,
                "reason": known[engine, name].reason if (engine, name) in known else None,
            }
            for (engine, name), row in sorted(self.rows.items())
        ]
