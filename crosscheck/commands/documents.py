"""The source documents and the problem set: `crosscheck ledger`, `crosscheck problems export` and `problems grade`."""

from __future__ import annotations

import json
import sys
from collections.abc import Sequence
from pathlib import Path
from typing import Any

from rich.console import Console

from crosscheck.commands.usage import Json, Whole, coloured, console, positive, shown_progress, table, writable_folder
from crosscheck.documents.ledger import ledger_rows, read
from crosscheck.documents.ledger.page import closing, digits_told, tally
from crosscheck.errors import DISAGREEMENT, PASS, UsageError, quoted
from crosscheck.problems import SHA256, VERSION
from crosscheck.problems.export import export
from crosscheck.problems.grader import LEVELS, grade_all
from crosscheck.problems.statement import drafts

COLOURS = {"pass": "green", "fail": "red", "open": "yellow"}


def ledger(*rows: str, as_json: Json = False) -> int:
    """Recompute every printed number of the source documents, and print which of them are right.

    Exit codes: 0 every row passes or is open, 1 a row fails, 2 there is no row of that name.

    Parameters
    ----------
    rows
        Names of rows, such as A3; all by default.
    """
    known = [row.id for row in read().row]
    unknown = [name for name in rows if name not in known]
    if unknown:
        raise UsageError(f"no row is called {unknown[0]!r}; there are: {', '.join(known)}")
    checked = ledger_rows(rows)
    if as_json:
        print(json.dumps({"schema": 1, "documents": dict(read().documents), "rows": checked}))
    else:
        print_ledger(console(200), checked)
    return DISAGREEMENT if any(row["status"] == "fail" for row in checked) else PASS


def print_ledger(out: Console, rows: Sequence[dict[str, Any]]) -> None:
    """Print rows, errata, what is inferred, what is open, and what fails."""
    heads = ("row", "document", "item", "status", "checked", "right", "cut off", "wrong", "errata")
    counted = []
    for row in rows:
        numbers = (*tally(row).values(), sum(e["counts"] for e in row["errata"]))
        status = coloured(row["status"], COLOURS[row["status"]])
        counted.append([row["id"], row["document"], row["item"], status, *(n or "" for n in numbers)])
    out.print(table(*heads, rows=counted))
    errata = [
        [row["id"], e["kind"], e["cause"] + (f" ({e['reading']})" if e["reading"] else ""), digits_told(row, e)]
        for row in rows
        for e in row["errata"]
    ]
    out.print(table("row", "kind", "what is wrong", "printed", rows=errata))
    for key in ("inferred", "open"):
        for row in rows:
            if row[key]:
                out.print(f"{row['id']} {key}: {row[key]}")
    for row in rows:
        for text in row["failures"]:
            out.print(f"FAIL {row['id']}: {text}")
    out.print(closing(rows))


def write_set(folder: Path, *, only: str = "", processes: Whole = 1) -> int:
    """Write the problem set: scenes, models for MuJoCo and exudyn, answers of 30 proved digits, a grader.

    It takes two to three minutes of processor time. Exit codes: 0 written, 2 usage, 4 an answer is not proved.

    Parameters
    ----------
    folder
        Where; the files of a set that is there are overwritten.
    only
        Problems of the families whose name contains this text, as `six`; all by default.
    processes
        How many prove answers side by side.
    """
    positive("processes", processes)
    asked = list(drafts(only))
    if not asked:
        families = ", ".join(sorted({draft.family for draft in drafts("")}))
        raise UsageError(f"--only: expected a part of the name of a family, got {quoted(only)}; there are: {families}")
    writable_folder("folder", folder)
    with shown_progress(len(asked), noun="problems") as show:
        digest = export(folder, asked, processes, lambda done, of: show(done, "proving"))
    count = len(json.loads((folder / "problems.json").read_text(encoding="utf-8"))["problems"])
    whole = "" if only else f" ({'as' if digest == SHA256 else 'NOT as'} published)"
    print(f"{folder}: {count} problems, version {VERSION}, sha256 {digest}{whole}")
    return PASS


def grade(answers: Path, *, problems: Path = Path("problems"), as_json: Json = False) -> int:
    """Grade answers to the problem set: correct digits of position, velocity and acceleration (LRE, as NIST's StRD).

    Exit codes: 0 graded, 1 an answer is of another assembly, or has not the form that is asked for, 2 usage.

    Parameters
    ----------
    answers
        A JSON file; `grade.py` in the folder of the set, which does the same without this package, says its form.
    problems
        The folder that `crosscheck problems export` has written.
    """
    try:
        given = json.loads(answers.read_text(encoding="utf-8"), parse_float=str)
        scores_of = dict(grade_all(given, problems))
        index = json.loads((problems / "problems.json").read_text(encoding="utf-8"))["problems"]
    except OSError as error:
        raise UsageError(f"{error.filename}: {error.strerror}") from error
    except (ValueError, RecursionError) as error:
        raise UsageError(f"{answers}: not answers to the problems of {problems}: {error}") from error
    if as_json:
        print(json.dumps(scores_of))
    else:
        _print_scores(scores_of, {entry["name"]: entry["attainable"] for entry in index})
    return DISAGREEMENT if any("refused" in scores for scores in scores_of.values()) else PASS


def _print_scores(scores_of: dict[str, Any], attainable: dict[str, Any]) -> None:
    rows = []
    for name, scores in scores_of.items():
        there = attainable[name]
        cells = [f"{scores[x]:.1f} ({there[x]:.1f})" if x in scores else "" for x in LEVELS.values()]
        rows.append([name, *cells, f"refused: {scores['refused']}" if "refused" in scores else ""])
    out = console(140)
    out.print(table("problem", *(f"{level} (attainable)" for level in LEVELS.values()), "", rows=rows))
    for level in LEVELS.values():
        scored = sorted(scores[level] for scores in scores_of.values() if level in scores)
        if scored:
            middle = scored[len(scored) // 2]
            out.print(f"{level}: {len(scored)} answers, median {middle:.1f}, worst {scored[0]:.1f} digits")
    refused = sum("refused" in scores for scores in scores_of.values())
    print(f"{len(scores_of)} of {len(attainable)} problems answered, {refused} refused", file=sys.stderr)
