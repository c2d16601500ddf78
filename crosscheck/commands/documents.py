"""The command about the source documents: `crosscheck ledger`."""

from __future__ import annotations

from typing import Annotated

from cyclopts import Parameter

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
    from crosscheck.documents.ledger.show import run  # here, because no other command needs it

    return run(rows, as_json)
