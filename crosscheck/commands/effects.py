"""The command `crosscheck effects`."""

from __future__ import annotations

from pathlib import Path

from crosscheck.commands.engines import ENGINES, names
from crosscheck.commands.usage import Json
from crosscheck.errors import DISAGREEMENT, ENGINE_MISSING, PASS
from crosscheck.workers.installed import find_engines
from refkin.scenes.files import load


def effects(scene: Path, *, engines: str = ENGINES, as_json: Json = False) -> int:
    """Show what every effect costs on a scene, and whether one that is not called for changes anything.

    Exit codes: 0 done, 1 an effect changes another number of the reference, 2 usage or invalid scene, 3 engine missing.

    Parameters
    ----------
    scene
        A scene file (TOML, or JSON if it ends in .json); its first times are measured.
    engines
        Names, separated by commas, or `file.py:Class`.
    as_json
        Print one JSON object instead of a table.
    """
    from crosscheck.commands.effects_shown import run as show  # here, because no other command needs it

    read_scene = load(scene)
    found, missing = find_engines(names(engines, always=()))
    inert = show(read_scene, [spec for spec, _ in found.values()], list(missing.values()), as_json)
    if missing:
        return ENGINE_MISSING
    return PASS if inert else DISAGREEMENT
