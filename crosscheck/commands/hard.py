"""`crosscheck hard`: what the engines do where it is hard."""

from __future__ import annotations

import json
import sys
from collections import Counter
from collections.abc import Sequence
from typing import Annotated, Any

from cyclopts import Parameter
from rich.console import Console

from crosscheck.commands.engines import ENGINES, names
from crosscheck.commands.progress import shown_progress
from crosscheck.commands.usage import Json, console, positive, table
from crosscheck.engines import EngineError
from crosscheck.errors import DISAGREEMENT, ENGINE_MISSING, PASS, UsageError
from crosscheck.judge.hard_poses import HardOutcome
from crosscheck.measure.hard_table import BAD, SECONDS, hard_case_rows, unexplained
from crosscheck.scenes.hard import hard_cases
from crosscheck.scenes.hard_case import HardCase

OURS = "refkin"


def hard(
    *,
    engines: str = ENGINES,
    case: Annotated[tuple[str, ...], Parameter(negative="")] = (),
    within: float | None = None,
    case_seconds: float = SECONDS,
    as_json: Json = False,
) -> int:
    """Send the hard scenes through every method of the engines, those of their shipped defaults included.

    Verdicts: correct; warned (right, but called doubtful); refused; wrong (and called right); crash; hang.
    Exit codes: 0 whatever is wrong is explained by a finding, 1 something is not, 2 usage, 3 engine missing.

    Parameters
    ----------
    engines
        Names, separated by commas, or `file.py:Class`; refkin is always asked, too.
    case
        Kinds of hard scenes, all by default.
    within
        Seconds after which no further scene is begun, for any engine: all are asked the same ones.
    case_seconds
        After this long on one scene a method is said to hang.
    as_json
        Print one JSON array of rows instead of a table.
    """
    cases = _cases(case)
    positive("within", within)
    positive("case-seconds", case_seconds)
    asked = (OURS, *names(engines, always=()))
    try:
        with shown_progress(len(cases), noun="cases") as show:
            rows = hard_case_rows(asked, within, cases=cases, seconds=case_seconds, tell=show)
    except EngineError as error:
        print(error, file=sys.stderr)
        return ENGINE_MISSING
    if as_json:
        print(json.dumps(rows, indent=1, allow_nan=False))
    else:
        _print(rows)
    return DISAGREEMENT if unexplained(rows) else PASS


def _cases(kinds: Sequence[str]) -> list[HardCase]:
    every = hard_cases()
    known = list(dict.fromkeys(case.case for case in every))
    for kind in kinds:
        if kind not in known:
            raise UsageError(f"--case: no hard scene is called {kind!r}; there are: {', '.join(known)}")
    return [case for case in every if not kinds or case.case in kinds]


def _print(rows: Sequence[dict[str, Any]]) -> None:
    """Print case x method with the verdicts, how many of each, and what is wrong with its explanation."""
    out = console(200)
    names = list(dict.fromkeys((row["engine"], row["method"]) for row in rows))
    count, of = len({(row["case"], row["distance"]) for row in rows}), max((row["of"] for row in rows), default=0)
    asked = f"all {of}" if count == of else f"{count} of {of}, the same for all engines"
    by_case: dict[tuple[str, float | None], dict[tuple[str, str], str]] = {}
    for row in rows:
        verdicts = by_case.setdefault((row["case"], row["distance"]), {})
        verdicts[row["engine"], row["method"]] = row["verdict"]
    shown: list[Any] = [
        [case, "" if distance is None else f"{distance:.3g}", *(verdicts.get(name, "") for name in names)]
        for (case, distance), verdicts in by_case.items()
    ]
    counts = Counter((r["engine"], r["method"], r["verdict"]) for r in rows)
    shown += [None, *([f"all: {verdict}", "", *(counts[*name, verdict] for name in names)] for verdict in HardOutcome)]
    heads = ("case", "distance", *("\n".join(name) for name in names))
    out.print(table(*heads, rows=shown, title=f"Hard cases: {asked}"))
    _print_wrong(out, rows)


def _print_wrong(out: Console, rows: Sequence[dict[str, Any]]) -> None:
    """Print what is wrong with its explanation, the rows that share one together."""
    by_reason: dict[tuple[str, ...], list[dict[str, Any]]] = {}
    for row in rows:
        if row["verdict"] in BAD:
            reason = f"{row['class']}: {row['quote']}" if row["class"] else "no finding explains this"
            by_reason.setdefault((row["engine"], row["method"], row["verdict"], reason), []).append(row)
    for (engine, name, verdict, reason), rows_of in by_reason.items():
        out.print(f"\n{engine} ({name}), {verdict}: {reason}")
        for row in rows_of:
            out.print(f"  {row['case']}, {row['distance']:.3g}: {row['note']}")
