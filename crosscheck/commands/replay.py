"""The command `crosscheck replay`."""

from __future__ import annotations

from pathlib import Path

from crosscheck.commands.engines import ENGINES, names
from crosscheck.commands.tables import agreement_table, arbiter_table, line_with_gap, refusal_lines, rows_table
from crosscheck.commands.usage import console, positive
from crosscheck.errors import DISAGREEMENT, ENGINE_MISSING, INFRASTRUCTURE, PASS
from crosscheck.judge.known_gaps import read
from crosscheck.measure.jobs import checkers
from crosscheck.workers.installed import find_engines
from crosscheck.workers.pool import SECONDS_PER_SCENE
from refkin.scenes.files import load, to_dict


def replay(
    scene: Path, *, engines: str = ENGINES, features: bool = False, scene_seconds: float = SECONDS_PER_SCENE
) -> int:
    """Show one scene on all engines.

    Exit codes: 0 all agree, 1 some disagree, 2 usage or invalid scene, 3 engine missing, 4 infrastructure.

    Parameters
    ----------
    scene
        A scene file, for instance one that a night wrote to its folder `disagreements`.
    engines
        Names, separated by commas, or `file.py:Class`; the closed form is always among the sources.
    features
        Ask the features of engines as well that a night asks by themselves.
    scene_seconds
        After this long an engine is ended, and said to hang.
    """
    job = {"scene": to_dict(load(scene)), "about": {"of_features": features}, "arbiter": True}
    positive("scene-seconds", scene_seconds)
    installed, missing = find_engines(names(engines))
    with checkers(1, {name: spec for name, (spec, _) in installed.items()}, scene_seconds) as pool:
        record = pool.check_one(job)
    out = console(160)
    if record.reference is None:
        out.print(record.failure)
        return INFRASTRUCTURE
    reference = record.reference
    out.print(f"refkin: {reference.verdict} {reference.message}  smallest singular value {reference.sigma_min:.3g}")
    out.print(agreement_table(record))
    out.print(arbiter_table(record))
    if record.levels:
        out.print(rows_table(record))
    for line in [*refusal_lines(record.refusals), *missing.values(), *pool.unexplained]:
        out.print(line)
    for disagreement in record.disagreements:
        out.print(line_with_gap(disagreement, record, read()))
    if missing:
        return ENGINE_MISSING
    return DISAGREEMENT if record.disagreements else PASS
