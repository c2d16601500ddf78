"""The command `crosscheck replay`."""

from __future__ import annotations

from pathlib import Path

from crosscheck.commands.engines import ENGINES, names
from crosscheck.commands.tables import agreement_table, arbiter_table, lines_with_gap, rows_table
from crosscheck.commands.usage import console, positive
from crosscheck.errors import DISAGREEMENT, ENGINE_MISSING, INFRASTRUCTURE, PASS
from crosscheck.judge.known_gaps import read
from crosscheck.night.campaign import find_engines
from crosscheck.workers.pool import SECONDS_PER_SCENE, Workers
from refkin.scenes.files import load, to_dict


def replay(scene: Path, *, engines: str = ENGINES, scene_seconds: float = SECONDS_PER_SCENE) -> int:
    """Show one scene on all engines.

    Exit codes: 0 all agree, 1 some disagree, 2 usage or invalid scene, 3 engine missing, 4 infrastructure.

    Parameters
    ----------
    scene
        A scene file, for instance one that a night wrote to its folder `disagreements`.
    engines
        Names, separated by commas, or `file.py:Class`; the closed form is always among the sources.
    scene_seconds
        After this long an engine is ended, and said to hang.
    """
    job = {"scene": to_dict(load(scene)), "about": {}, "arbiter": True}
    positive("scene-seconds", scene_seconds)
    found, missing = find_engines(names(engines))
    with Workers(1, {name: spec for name, (spec, _) in found.items()}, scene_seconds) as pool:
        record = pool.check_one(job)
    out = console(160)
    if "failure" in record:
        out.print(record["failure"], markup=False)
        return INFRASTRUCTURE
    told = record["reference"]
    out.print(f"refkin: {told['verdict']} {told['message']}  smallest sigma {told['sigma_min']:.3g}", markup=False)
    out.print(agreement_table(record))
    out.print(arbiter_table(record))
    out.print(rows_table(record))
    disagreements = [line for told in record["disagreements"] for line in lines_with_gap(told, record, read())]
    for line in [*record["refusals"], *missing.values(), *pool.unexplained, *disagreements]:
        out.print(line, markup=False)
    if missing:
        return ENGINE_MISSING
    return DISAGREEMENT if record["disagreements"] else PASS
