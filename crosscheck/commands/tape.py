"""The command `crosscheck tape`: what the fast path computes for a scene, operation by operation."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

from cyclopts import Parameter

from crosscheck.errors import DISAGREEMENT, PASS
from refkin.errors import RefkinError
from refkin.scenes.files import load


def tape(scene: Path, *, counts: Annotated[bool, Parameter(negative="")] = False) -> int:
    """Print the operations that the fast path runs for a scene, and how many there are.

    A scene that calls for less has fewer: no accelerations, or bodies wanted that do not hang on all others.

    Exit codes: 0 done, 1 the equations of the scene have no such form, 2 the scene is invalid.

    Parameters
    ----------
    scene
        A scene file (TOML, or JSON if it ends in .json).
    counts
        Print the numbers of operations alone.
    """
    read = load(scene)
    try:
        from refkin import fast  # here, because no other command needs it
    except ImportError as error:
        print(f"this installation has no fast path: {error}")
        return DISAGREEMENT
    try:
        compiled = fast.tape(read)
    except RefkinError as error:
        print(error)
        return DISAGREEMENT
    if not counts:
        print(fast.legend(read) + str(compiled))
    for segment, count in compiled.counts().items():
        kinds = ", ".join(f"{k} {op}" for op, k in compiled.operations(segment).most_common())
        print(f"{segment:9}  {count:5}  {kinds}".rstrip())
    print(f"all        {sum(compiled.counts().values()):5}")
    return PASS
