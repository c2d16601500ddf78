"""The command about the source documents: `crosscheck ledger`."""

from __future__ import annotations

import json
import sys
from collections.abc import Sequence
from typing import Annotated, Any

from cyclopts import Parameter
from rich.console import Console
from rich.markup import escape
from rich.table import Table

from crosscheck.documents.ledger import ledger_rows, read
from crosscheck.documents.page import closing, digits_told, tally

COLOURS = {"pass": "green", "fail": "red", "open": "yellow"}
Json = Annotated[bool, Parameter(name="--json", negative="")]


def ledger(*rows: str, as_json: Json = False) -> int:
    """Recompute every printed number of the source documents, and print what of it is right.

    Exit codes: 0 every row passes or is open, 1 a row fails, 2 there is no row of that name.

    Parameters
    ----------
    rows
        Names of rows, such as A3; all by default.
    as_json
        Print one JSON object instead of tables.
    """
    known = [row.id for row in read().row]
    unknown = [name for name in rows if name not in known]
    if unknown:
        print(f"no row is called {unknown[0]!r}; there are: {', '.join(known)}", file=sys.stderr)
        return 2
    found = ledger_rows(rows)
    if as_json:
        print(json.dumps({"schema": 1, "documents": dict(read().documents), "rows": found}))
    else:
        print_ledger(Console(width=None if sys.stdout.isatty() else 200), found)
    return int(any(row["status"] == "fail" for row in found))


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
