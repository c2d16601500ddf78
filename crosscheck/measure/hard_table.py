"""The table of hard cases: engine, route, case, distance, verdict; of what is wrong the class and the quotation."""

from __future__ import annotations

import time
from collections.abc import Iterator, Mapping, Sequence
from typing import Any

from crosscheck.engines import EngineError
from crosscheck.judge.findings import Finding, finding_of, read
from crosscheck.judge.hard_poses import Outcome
from crosscheck.measure.hard_classing import job, outcome_of, outcome_of_failure, routes_of
from crosscheck.scenes.hard import HardCase, hard_cases
from crosscheck.workers.processes import Failure, call_each, call_in_turn

SECONDS = 20.0
"""After this long on one scene a route is said to hang: the slowest takes about three."""
KEYS = ("engine", "route", "case", "distance", "verdict", "class", "quote", "note")
BAD = (Outcome.WRONG, Outcome.CRASH, Outcome.HANG)
"""Verdicts that need an explanation: `findings.toml`."""

Row = dict[str, Any]


def hard_case_rows(
    engines: Sequence[str],
    within: float | None = None,
    *,
    cases: Sequence[HardCase] | None = None,
    findings: Sequence[Finding] | None = None,
    seconds: float = SECONDS,
) -> list[Row]:
    """Return one row per engine, route and case, with the keys `KEYS`, all of them plain data.

    Parameters
    ----------
    engines : sequence of str
        What `crosscheck.engines.load` takes, or "refkin" for the reference itself.
    within : float, optional
        After this many seconds no further case is begun; of each kind the nearest come last, and so are left out.
    cases : sequence of HardCase, optional
        All by default; each must be one of them.
    findings : sequence of Finding, optional
        What classes and quotes wrong answers; `findings.toml` by default.
    seconds : float
        After this long on one case a route is said to hang.

    Raises
    ------
    EngineError
        If an engine cannot be loaded.
    """
    end = None if within is None else time.monotonic() + within
    chosen = _in_turn_by_kind(hard_cases() if cases is None else cases)
    known = read() if findings is None else findings
    rows = list(_rows(engines, chosen, known, seconds, end))
    order = {case.key: k for k, case in enumerate(hard_cases())}
    names = list(dict.fromkeys((row["engine"], row["route"]) for row in rows))
    rows.sort(key=lambda row: (order[row.pop("key")], names.index((row["engine"], row["route"]))))
    return rows


def _rows(
    engines: Sequence[str], cases: Sequence[HardCase], known: Sequence[Finding], seconds: float, end: float | None
) -> Iterator[Row]:
    """Yield rows; engine by engine each gets its part of the time."""
    found = call_each(routes_of, engines)
    for k, (spec, told) in enumerate(zip(engines, found, strict=True)):
        if isinstance(told, Failure):
            raise EngineError(told.text.removeprefix("EngineError: "))
        name, _, routes = told
        until = None if end is None else time.monotonic() + (end - time.monotonic()) / (len(engines) - k)
        asked = [(case, route) for case in cases for route in routes]
        answers = call_in_turn(outcome_of, [job(spec, route, case.key) for case, route in asked], seconds)
        for case, route in asked:
            if until is not None and time.monotonic() > until:
                break
            yield _row(name, route, case, next(answers), known)
        answers.close()  # type: ignore[attr-defined]


def _row(engine: str, route: str, case: HardCase, answer: Any, known: Sequence[Finding]) -> Row:
    verdict, note = outcome_of_failure(answer) if isinstance(answer, Failure) else answer
    finding = finding_of(known, engine, route, case.case, verdict) if verdict in BAD else None
    return {
        "key": case.key,
        "engine": engine,
        "route": route,
        "case": case.case,
        "distance": case.distance,
        "verdict": verdict,
        "class": None if finding is None else finding.kind,
        "quote": None if finding is None else f"{finding.quote} ({finding.source})",
        "note": note,
    }


def unexplained(rows: Sequence[Mapping[str, Any]]) -> list[Mapping[str, Any]]:
    """Return the rows whose verdict needs an explanation that no finding gives."""
    return [row for row in rows if row["verdict"] in BAD and row["class"] is None]


def _in_turn_by_kind(cases: Sequence[HardCase]) -> list[HardCase]:
    """Return the first of every kind, then the second of every kind and so on."""
    place: dict[str, int] = {}
    numbered = []
    for case in cases:
        place[case.case] = place.get(case.case, -1) + 1
        numbered.append((place[case.case], case))
    return [case for _, case in sorted(numbered, key=lambda pair: pair[0])]
