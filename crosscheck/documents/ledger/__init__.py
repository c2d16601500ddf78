"""The ledger: every system, algorithm and printed number of the source documents, recomputed, with its verdict.

`ledger.toml` states each row's inputs, its truth to all digits and what the document prints. A row is recomputed in
binary64, through the code that solves scenes too, and on balls that enclose the truth; how many digits of a printed
number are right is always computed. A row that needs what does not exist yet is open, never passed.
"""

from __future__ import annotations

from collections.abc import Sequence
from functools import cache
from typing import Any

from crosscheck.documents.ledger.judging import check_row
from crosscheck.documents.ledger.rows import Ledger, LedgerRow, read

__all__ = ["Ledger", "LedgerRow", "check_row", "ledger_rows", "read"]


def ledger_rows(ids: Sequence[str] = ()) -> list[dict[str, Any]]:
    """Return the rows with these names, all by default, each recomputed, as plain data; KeyError if there is none."""
    by_id = {row.id: row for row in read().row}
    return [check_row(by_id[name]) for name in (ids or by_id)]


all_rows = cache(ledger_rows)
"""Recomputes a row once in the life of a process."""
