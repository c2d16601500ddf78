"""The table of hard cases: engine, method, case, distance, verdict; of what is wrong the class and the quotation.

`of` is how many cases there were: where time did not suffice for all, all methods were asked the same ones.
"""

from __future__ import annotations

import time
from collections.abc import Callable, Iterator, Mapping, Sequence
from typing import Any

from crosscheck.engines import EngineError
from crosscheck.judge.findings import Finding, finding_of, read
from crosscheck.judge.hard_poses import HardOutcome
from crosscheck.measure.hard_classing import job, listed, outcome_of, outcome_of_failure
from crosscheck.scenes.hard import hard_cases
from crosscheck.scenes.hard_case import HardCase
from crosscheck.workers.processes import Failure, call_each, call_in_turn

SECONDS = 20.0
"""After this long on one scene a method is said to hang: the slowest takes about three."""
KEYS = ("engine", "method", "setting", "case", "distance", "of", "verdict", "class", "quote", "note")
BAD = (HardOutcome.WRONG, HardOutcome.CRASH, HardOutcome.HANG)
"""Verdicts that need an explanation: `findings.toml`."""

Row = dict[str, Any]


def hard_case_rows(
    engines: Sequence[str],
    within: float | None = None,
    *,
    cases: Sequence[HardCase] | None = None,
    findings: Sequence[Finding] | None = None,
    seconds: float = SECONDS,
    tell: Callable[[int, str], None] = lambda done, case: None,
) -> list[Row]:
    """Return one row per engine, method and case, with the keys `KEYS`, all of them plain data.

    Parameters
    ----------
    engines : sequence of str
        What `crosscheck.engines.load` takes, or "refkin" for the reference itself.
    within : float, optional
        After this many seconds no further case is begun, for any engine; of each kind the nearest come last, and so
        are left out.
    cases : sequence of HardCase, optional
        All by default; each must be one of them.
    findings : sequence of Finding, optional
        What classes and quotes wrong answers; `findings.toml` by default.
    seconds : float
        After this long on one case a method is said to hang.
    tell : callable
        Is told how many cases are done, and which comes next.

    Raises
    ------
    EngineError
        If an engine cannot be loaded.
    """
    end = None if within is None else time.monotonic() + within
    chosen = _in_turn_by_kind(hard_cases() if cases is None else cases)
    known = read() if findings is None else findings
    rows = list(_rows(engines, chosen, known, seconds, end, tell))
    order = {case.key: k for k, case in enumerate(hard_cases())}
    names = list(dict.fromkeys(_name(row) for row in rows))
    rows.sort(key=lambda row: (order[row.pop("key")], names.index(_name(row))))
    return rows


def _name(row: Mapping[str, Any]) -> tuple[str, ...]:
    return row["engine"], row["method"], row["setting"]


def _rows(
    engines: Sequence[str],
    cases: Sequence[HardCase],
    known: Sequence[Finding],
    seconds: float,
    end: float | None,
    tell: Callable[[int, str], None],
) -> Iterator[Row]:
    """Yield rows, case by case: where time is up, all engines have been asked the same cases."""
    by_engine = dict(zip(engines, call_each(listed, engines), strict=True))
    for answer in by_engine.values():
        if isinstance(answer, Failure):
            raise EngineError(answer.text.removeprefix("EngineError: "))
    answers = {
        spec: call_in_turn(
            outcome_of, [job(spec, name, case.key, setting) for case in cases for _, name, setting in keys], seconds
        )
        for spec, keys in by_engine.items()
    }
    for done, case in enumerate(cases):
        tell(done, case.key)
        if end is not None and time.monotonic() > end:
            break
        for spec, keys in by_engine.items():
            for key in keys:
                yield _row(key, case, next(answers[spec]), len(cases), known)
    for left in answers.values():
        left.close()  # type: ignore[attr-defined]


def _row(key: tuple[str, str, str], case: HardCase, answer: Any, of: int, known: Sequence[Finding]) -> Row:
    engine, name, setting = key
    verdict, note = outcome_of_failure(answer) if isinstance(answer, Failure) else answer
    finding = finding_of(known, engine, name, case.case, verdict) if verdict in BAD else None
    return {
        "key": case.key,
        "engine": engine,
        "method": name,
        "setting": setting,
        "case": case.case,
        "distance": case.distance,
        "of": of,
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
