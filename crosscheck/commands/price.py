"""The command `crosscheck price`."""

from __future__ import annotations

import sys
from pathlib import Path
from typing import Annotated

from cyclopts import Parameter

Json = Annotated[bool, Parameter(name="--json", negative="")]


def price(scene: Path, *, as_json: Json = False, page: Path | None = None) -> int:
    """Show what accuracy costs on a scene: every engine by every route, digits against microseconds.

    Exit codes: 0 done, 1 no pose of the scene is certified, so that there is nothing to hold digits against, 2 the
    scene is invalid. A route that crashes or hangs is a row that says so.

    Parameters
    ----------
    scene
        A scene file (TOML, or JSON if it ends in .json).
    as_json
        Print one JSON object instead of tables.
    page
        Write a page with the work-precision diagrams to this file, too.
    """
    from crosscheck.commands.price_shown import run  # here, because no other command needs it
    from crosscheck.judge.truth import NoTruth
    from refkin.scenes.files import load

    if page is not None and not page.parent.is_dir():
        print(f"--page: expected a file in a folder that exists, got {page}", file=sys.stderr)
        return 2
    try:
        run(load(scene), as_json, page)
    except NoTruth as error:
        print(error, file=sys.stderr)
        return 1
    return 0
