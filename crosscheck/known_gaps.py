"""The table of what engines are known to get wrong: named predicates, reasons, dates. It is strict in both directions.

A disagreement that no row covers is new and turns the night red. A row whose reproduction no longer disagrees has to go:
`stale` names it, and the test suite and the nightly fail until it is removed.
"""

from __future__ import annotations

import datetime
import tomllib
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from importlib.resources import files
from typing import Any

Predicate = Callable[[Mapping[str, Any]], bool]


def near_singular(record: Mapping[str, Any]) -> bool:
    """Return whether the smallest scaled singular value met in the scene is below 1e-2."""
    return bool(record["reference"]["sigma_min"] < 1e-2)


def anywhere(record: Mapping[str, Any]) -> bool:
    """Return True: the gap does not depend on the scene."""
    return True


PREDICATES: dict[str, Predicate] = {f.__name__: f for f in (near_singular, anywhere)}
CLASSES = ("contract violated", "documented limit", "our misuse")


class InvalidGap(Exception):
    """A row of the table that makes no sense."""


@dataclass(frozen=True, kw_only=True)
class Gap:
    """One row: whose gap, where (`predicate`), why, since when, and a scene that shows it."""

    engine: str
    predicate: str
    reason: str
    kind_of_gap: str
    date: datetime.date
    reproduction: str
    match: Mapping[str, str]

    def covers(self, record: Mapping[str, Any], disagreement: Mapping[str, Any]) -> bool:
        """Return whether this row accounts for a disagreement of a record."""
        fits = all(disagreement.get(key) == value for key, value in {"engine": self.engine, **self.match}.items())
        return fits and PREDICATES[self.predicate](record)


def read(text: str | None = None) -> tuple[Gap, ...]:
    """Return the rows of the table; raises InvalidGap naming the row and key that is wrong."""
    if text is None:
        text = files("crosscheck").joinpath("known_gaps.toml").read_text(encoding="utf-8")
    return tuple(_gap(k, row) for k, row in enumerate(tomllib.loads(text).get("gap", [])))


def new_disagreements(record: Mapping[str, Any], gaps: Sequence[Gap]) -> list[Mapping[str, Any]]:
    """Return the disagreements of a record that no row covers."""
    return [d for d in record["disagreements"] if not any(gap.covers(record, d) for gap in gaps)]


def stale(gaps: Sequence[Gap], check: Callable[[str, str], Mapping[str, Any]]) -> list[Gap]:
    """Return the rows whose reproduction shows the gap no longer; `check(scene file, engine)` gives a record."""
    found = []
    for gap in gaps:
        record = check(gap.reproduction, gap.engine)
        if not any(gap.covers(record, d) for d in record["disagreements"]):
            found.append(gap)
    return found


def _gap(k: int, row: dict[str, Any]) -> Gap:
    required = ("engine", "predicate", "reason", "class", "date", "reproduction")
    optional = ("route", "quantity", "kind")
    for key in required:
        if key not in row:
            raise InvalidGap(f"gap[{k}].{key} is missing")
    for key in row:
        if key not in (*required, *optional):
            raise InvalidGap(f"gap[{k}].{key}: no such key; there are: {', '.join((*required, *optional))}")
    if row["predicate"] not in PREDICATES:
        raise InvalidGap(f"gap[{k}].predicate: {row['predicate']!r}; there are: {', '.join(PREDICATES)}")
    if row["class"] not in CLASSES:
        raise InvalidGap(f"gap[{k}].class: {row['class']!r}; there are: {', '.join(CLASSES)}")
    return Gap(
        engine=row["engine"],
        predicate=row["predicate"],
        reason=row["reason"],
        kind_of_gap=row["class"],
        date=row["date"],
        reproduction=row["reproduction"],
        match={key: row[key] for key in optional if key in row},
    )
