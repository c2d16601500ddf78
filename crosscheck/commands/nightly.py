"""The command `crosscheck nightly`."""

from __future__ import annotations

import os
import sys
from dataclasses import replace
from pathlib import Path
from typing import Annotated

from cyclopts import Parameter

from crosscheck.commands.engines import ENGINES, names
from crosscheck.commands.progress import shown_progress
from crosscheck.commands.tables import outcome_lines
from crosscheck.commands.usage import Whole, console, positive
from crosscheck.errors import DISAGREEMENT, ENGINE_MISSING, INFRASTRUCTURE, NOTHING_RAN, PASS, UsageError
from crosscheck.night import golden
from crosscheck.night.campaign import make_room, run, seed_of
from crosscheck.night.history import HistoryError, remember, warnings
from crosscheck.night.pictures import write_pictures
from crosscheck.night.plan import ALWAYS, SAMPLED, NightPlan, write_outcome
from crosscheck.night.sections import write_documents, write_sections
from crosscheck.report import verdict
from crosscheck.report.build import summarized, write
from crosscheck.workers.cluster import LOCAL
from crosscheck.workers.pool import SECONDS_PER_SCENE

CODES = {
    verdict.PASS: PASS,
    verdict.NEW_DISAGREEMENTS: DISAGREEMENT,
    verdict.ENGINE_MISSING: ENGINE_MISSING,
    verdict.INFRASTRUCTURE: INFRASTRUCTURE,
    verdict.NOTHING_RAN: NOTHING_RAN,
}
"""A night ends as its report says; the worst comes first there."""
SECONDS_FOR_PICTURES = 30.0


def nightly(
    *,
    minutes: float | None = None,
    scenes: Whole | None = None,
    seed: Whole | None = None,
    engines: str = ENGINES,
    require_engines: str = "",
    out: Path = Path("reports/latest"),
    fresh: Annotated[bool, Parameter(negative="")] = False,
    workers: Whole | None = None,
    cluster: str | None = None,
    scene_seconds: float = SECONDS_PER_SCENE,
    history: Path | None = None,
    baseline: Path | None = None,
    known_gaps: str = "",
    sections_seconds: float | None = None,
) -> int:
    """Draw scenes, check them on all engines, write a report.

    Exit codes: 0 pass, 1 new disagreement, 2 usage, 3 engine missing, 4 infrastructure, 5 nothing ran, 130 interrupted.
    A run that was killed or interrupted is continued by the same command.

    Parameters
    ----------
    minutes
        How long to draw new scenes (3 if neither this nor `scenes` is given).
    scenes
        How many scenes to check, those of an earlier part of the run included.
    seed
        The night's seed; the day's date as a number by default. A folder that holds a run is continued with its seed.
    engines
        Names, separated by commas, or `file.py:Class` for one that is not registered; the closed form is always among
        the sources.
    require_engines
        Engines without which the night fails with exit code 3 before anything runs.
    out
        The folder of the run: records.jsonl, report.json, index.html, disagreements/*.toml.
    fresh
        Make room for a new night where the folder holds a finished one: what that night wrote is removed, no more.
    workers
        Worker processes; one per processor by default.
    cluster
        Check the scenes on a Dask cluster: `local` for one of `workers` processes, or a scheduler, `tcp://host:8786`.
    scene_seconds
        After this long on one scene a worker is ended, and the engine that it was at is told.
    known_gaps
        A table to hold the run against instead of our own: a file, or `none`. Then every row of our own is told, and
        after how many scenes it was found again.
    sections_seconds
        How long to measure what the report shows beside the scenes, hard cases, prices and effects, when the scenes are
        done; not at all in less than eight. By default as long as `minutes`, four minutes at most, and not at all for
        a night of `scenes` alone.
    history
        The file that nights are kept in; `history.sqlite` beside the folder by default.
    baseline
        The accepted digits of the golden set; that of this checkout by default, if there is one.
    """
    if baseline is not None:
        golden.read(baseline)
    if fresh:
        make_room(out)
    accepted = baseline or (golden.DEFAULT if golden.DEFAULT.is_file() else None)
    plan = _plan(minutes, scenes, seed, engines, require_engines, out, workers, cluster, scene_seconds, accepted)
    plan = replace(plan, known_gaps=known_gaps)
    with shown_progress(plan.scenes, plan.minutes) as progress:
        try:
            outcome = run(plan, progress)
        except KeyboardInterrupt:
            message = f"interrupted; what was checked is kept in {plan.out}, and the same command goes on from there"
            raise KeyboardInterrupt(message) from None
    seconds = min(240.0, 60.0 * (plan.minutes or 0.0)) if sections_seconds is None else sections_seconds
    if outcome.checked:
        write_sections(plan.out, outcome.engines, {ALWAYS, *SAMPLED}, seconds, _told)
        _told("pictures and documents")
        write_pictures(plan.out, plan.seed, outcome.engines, SECONDS_FOR_PICTURES)
        write_documents(plan.out)
    report = summarized(plan.out)
    try:
        report["trends"] = remember(history or plan.out.parent / "history.sqlite", report, plan.out)
    except (HistoryError, OSError) as error:
        outcome.failed.append(f"the history cannot be kept: {error}")
        write_outcome(plan.out, outcome)
        report = summarized(plan.out)
    page = write(plan.out, report)
    warned = [f"warning: {line}" for line in warnings(report["trends"])] if report["trends"] else []
    shown = console(None, stderr=True)
    for line in (*outcome_lines(outcome), *warned, f"{report['verdict']}: {report['why']}", f"report: {page}"):
        shown.print(line, soft_wrap=True)
    return CODES[report["verdict"]]


def _told(doing: str) -> None:
    print(f"measuring {doing}", file=sys.stderr, flush=True)


def _plan(
    minutes: float | None,
    scenes: int | None,
    seed: int | None,
    engines: str,
    require_engines: str,
    out: Path,
    workers: int | None,
    cluster: str | None,
    scene_seconds: float,
    baseline: Path | None,
) -> NightPlan:
    numbers = {"minutes": minutes, "scenes": scenes, "workers": workers, "scene-seconds": scene_seconds}
    for key, value in numbers.items():
        positive(key, value)
    if out.exists() and not out.is_dir():
        raise UsageError(f"--out: expected a folder, got the file {out}")
    if cluster is not None and cluster != LOCAL and "://" not in cluster:
        raise UsageError(
            f"--cluster: expected {LOCAL!r} or a scheduler's address like tcp://host:8786, got {cluster!r}"
        )
    if minutes is None and scenes is None:
        minutes = 3.0
    required = names(require_engines, always=())
    return NightPlan(
        seed=seed_of(out, seed),
        out=out,
        engines=tuple(dict.fromkeys((*names(engines), *required))),
        required=required,
        minutes=minutes,
        scenes=scenes,
        workers=workers or _processors(),
        cluster=cluster,
        scene_seconds=scene_seconds,
        baseline=baseline,
    )


def _processors() -> int:
    """Return how many processors this process may use, where the system tells, else how many there are."""
    if hasattr(os, "sched_getaffinity"):
        return len(os.sched_getaffinity(0))
    return os.cpu_count() or 1
