"""The command `crosscheck price`."""

from __future__ import annotations

import json
import sys
from pathlib import Path
from typing import Any

from crosscheck.commands.engines import ENGINES, names
from crosscheck.commands.usage import Json
from crosscheck.errors import DISAGREEMENT, PASS, USAGE

SAME_WINNERS = 0.95
"""Of the cells whose winner is clear, so many are to have the same one when the list is measured anew."""


def price(
    scene: Path, *, engines: str = ENGINES, as_json: Json = False, page: Path | None = None, again: Path | None = None
) -> int:
    """Show what accuracy costs on a scene: every engine by every method, digits against microseconds.

    Exit codes: 0 done, 1 no pose of the scene is certified, so that there is nothing to hold digits against, or fewer
    than 95 % of the winners are the same again, 2 the scene or a file is invalid. A method that crashes or hangs is a
    row that says so.

    Parameters
    ----------
    scene
        A scene file (TOML, or JSON if it ends in .json).
    engines
        Names, separated by commas, or `file.py:Class`; refkin, its fast path and SciPy are priced as well.
    as_json
        Print one JSON object instead of tables.
    page
        Write a page with the work-precision diagrams to this file, too.
    again
        What an earlier run printed with --json: measure anew, and say in what share of the cells that differ by more
        than the spread the winner is the same.
    """
    from crosscheck.commands.price_shown import print_list, print_repeated, to_json  # here: no other command needs them
    from crosscheck.engines.methods import OURS, PRICED
    from crosscheck.judge.truth import NoTruth
    from crosscheck.measure.price import price as measured
    from refkin.scenes.files import load

    if page is not None and not page.parent.is_dir():
        print(f"--page: expected a file in a folder that exists, got {page}", file=sys.stderr)
        return USAGE
    before = None if again is None else _earlier(again)
    if again is not None and before is None:
        print(f"--again: expected what `crosscheck price --json` prints, got {again}", file=sys.stderr)
        return USAGE
    ours = [name for name in PRICED if name in OURS]
    try:
        found = measured(load(scene), (*ours, *names(engines, always=())))
    except NoTruth as error:
        print(error, file=sys.stderr)
        return DISAGREEMENT
    result = to_json(found)
    if page is not None:
        from crosscheck.commands.price_page import page as page_of

        page.write_text(page_of(result), encoding="utf-8")
    if before is not None:
        return PASS if print_repeated(before, result, as_json) >= SAME_WINNERS else DISAGREEMENT
    if as_json:
        print(json.dumps(result, allow_nan=False))
    else:
        print_list(result)
    return PASS


def _earlier(file: Path) -> dict[str, Any] | None:
    """Return an earlier list; None if the file is none."""
    try:
        found = json.loads(file.read_text(encoding="utf-8"))
    except (OSError, ValueError):
        return None
    return found if isinstance(found, dict) and "cheapest" in found else None
