"""The ledger of the source documents as the page shows it: one line per row, and one per erratum."""

from __future__ import annotations

from typing import Any

from crosscheck.documents.ledger import all_rows, read
from crosscheck.documents.ledger.show import closing, digits_told, tally


def documents() -> dict[str, Any]:
    """Return titles, rows with their counts, errata with the digits that are right, and all of it in one line."""
    rows = all_rows()
    return {
        "titles": dict(read().documents),
        "closing": closing(rows),
        "rows": [_row(row) for row in rows],
        "errata": [_erratum(row, e) for row in rows for e in row["errata"]],
    }


def _row(row: dict[str, Any]) -> dict[str, Any]:
    keys = ("id", "document", "item", "status", "inferred", "open", "failures", "computed_by")
    return {**{key: row[key] for key in keys}, **tally(row), "errata": sum(e["counts"] for e in row["errata"])}


def _erratum(row: dict[str, Any], erratum: dict[str, Any]) -> dict[str, Any]:
    return {
        "row": row["id"],
        "document": row["document"],
        "kind": erratum["kind"],
        "cause": erratum["cause"],
        "reading": erratum["reading"],
        "printed": digits_told(row, erratum),
    }
