"""The ledger as tables on a terminal."""

from __future__ import annotations

import json
import sys
from collections.abc import Sequence
from typing import Any

from rich.console import Console
from rich.markup import escape
from rich.table import Table

from crosscheck.documents.ledger import ledger_rows
from crosscheck.documents.ledger.digits import Printed
from crosscheck.documents.ledger.rows import read

COLOURS = {"pass": "green", "fail": "red", "open": "yellow"}


def tally(row: dict[str, Any]) -> dict[str, int]:
    """Return how many numbers of a row were checked, and how many printed ones are right, truncated, wrong."""
    verdicts = [v.get("verdict") for v in row["values"]]
    return {"checked": len(verdicts), **{kind.value: verdicts.count(kind.value) for kind in Printed}}


def digits_told(row: dict[str, Any], erratum: dict[str, Any]) -> str:
    """Return the printed numbers of an erratum with their digits: "2.7109 for 2.701942 (2.4 of 5 digits)"."""
    by_name = {v["name"]: v for v in row["values"]}
    told = []
    for path in erratum["at"]:
        v = by_name[path]
        told.append(
            f"{path}: {v['printed']} for {v['truth']} ({v['digits_correct']:g} of {v['digits_printed']} digits)"
        )
    return "; ".join(told)


def print_ledger(console: Console, rows: Sequence[dict[str, Any]]) -> None:
    """Print rows, errata, what is inferred, what is open, and what fails."""
    table = Table("row", "document", "item", "status", "checked", "right", "cut off", "wrong", "errata")
    for row in rows:
        counts = tally(row)
        status = f"[{COLOURS[row['status']]}]{row['status']}[/]"
        errata = sum(e["counts"] for e in row["errata"])
        numbers = (counts["checked"], counts["right"], counts["truncated"], counts["wrong"], errata)
        shown = (str(n) if n else "" for n in numbers)
        table.add_row(row["id"], row["document"], escape(row["item"]), status, *shown)
    console.print(table)
    errata = Table("row", "kind", "what is wrong", "printed")
    for row in rows:
        for e in row["errata"]:
            reading = f" ({e['reading']})" if e["reading"] else ""
            errata.add_row(row["id"], e["kind"], escape(e["cause"] + reading), escape(digits_told(row, e)))
    console.print(errata)
    for key, title in (("inferred", "inferred"), ("open", "open")):
        for row in rows:
            if row[key]:
                console.print(f"{row['id']} {title}: {row[key]}", markup=False)
    for row in rows:
        for text in row["failures"]:
            console.print(f"FAIL {row['id']}: {text}", markup=False)
    console.print(closing(rows), markup=False)


def closing(rows: Sequence[dict[str, Any]]) -> str:
    """Return the ledger in one line."""
    counts = {status: sum(row["status"] == status for row in rows) for status in COLOURS}
    errata = sum(e["counts"] for row in rows for e in row["errata"])
    checked = sum(len(row["values"]) for row in rows)
    told = ", ".join(f"{n} {status}" for status, n in counts.items())
    return f"{len(rows)} rows: {told}; {checked} numbers and facts recomputed, {errata} errata of the documents"


def run(names: Sequence[str], as_json: bool) -> int:
    """Recompute rows, all by default, and print them; return 1 if one fails, 2 if there is no row of a name, else 0."""
    known = [row.id for row in read().row]
    unknown = [name for name in names if name not in known]
    if unknown:
        print(f"no row is called {unknown[0]!r}; there are: {', '.join(known)}", file=sys.stderr)
        return 2
    rows = ledger_rows(names)
    if as_json:
        print(json.dumps({"schema": 1, "documents": dict(read().documents), "rows": rows}))
    else:
        print_ledger(Console(width=None if sys.stdout.isatty() else 200), rows)
    return int(any(row["status"] == "fail" for row in rows))
