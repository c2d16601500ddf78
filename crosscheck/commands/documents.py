"""The command about the source documents: `crosscheck ledger`."""

from __future__ import annotations

import json
import sys
from collections.abc import Sequence
from typing import Any

from rich.console import Console

from crosscheck.commands.usage import Json, coloured, console, table
from crosscheck.documents.ledger import ledger_rows, read
from crosscheck.documents.page import closing, digits_told, tally
from crosscheck.errors import DISAGREEMENT, PASS, USAGE

COLOURS = {"pass": "green", "fail": "red", "open": "yellow"}


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
        return USAGE
    checked = ledger_rows(rows)
    if as_json:
        print(json.dumps({"schema": 1, "documents": dict(read().documents), "rows": checked}))
    else:
        print_ledger(console(200), checked)
    return DISAGREEMENT if any(row["status"] == "fail" for row in checked) else PASS


def _counted(row: dict[str, Any]) -> list[Any]:
    counts, errata = tally(row), sum(e["counts"] for e in row["errata"])
    numbers = (counts["checked"], counts["right"], counts["truncated"], counts["wrong"], errata)
    status = coloured(row["status"], COLOURS[row["status"]])
    return [row["id"], row["document"], row["item"], status, *(n or "" for n in numbers)]


def print_ledger(out: Console, rows: Sequence[dict[str, Any]]) -> None:
    """Print rows, errata, what is inferred, what is open, and what fails."""
    heads = ("row", "document", "item", "status", "checked", "right", "cut off", "wrong", "errata")
    out.print(table(*heads, rows=map(_counted, rows)))
    errata = [
        [row["id"], e["kind"], e["cause"] + (f" ({e['reading']})" if e["reading"] else ""), digits_told(row, e)]
        for row in rows
        for e in row["errata"]
    ]
    out.print(table("row", "kind", "what is wrong", "printed", rows=errata))
    for key, title in (("inferred", "inferred"), ("open", "open")):
        for row in rows:
            if row[key]:
                out.print(f"{row['id']} {title}: {row[key]}")
    for row in rows:
        for text in row["failures"]:
            out.print(f"FAIL {row['id']}: {text}")
    out.print(closing(rows))
