"""The commands about nights: `crosscheck nightly`, `crosscheck history`, `crosscheck baseline`."""

from __future__ import annotations

import json
import math
import os
import sys
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Annotated, Any

from cyclopts import Parameter
from rich.table import Table

from crosscheck.commands.engines import ENGINES, MOST_LINES, names, outcome_lines
from crosscheck.commands.usage import (
    Json,
    Whole,
    coloured,
    console,
    positive,
    shown_progress,
    table,
    writable,
    writable_folder,
)
from crosscheck.errors import DISAGREEMENT, ENGINE_MISSING, INFRASTRUCTURE, NOTHING_RAN, PASS, CannotRun, UsageError
from crosscheck.judge import known_gaps as gaps
from crosscheck.measure.jobs import checkers
from crosscheck.night import golden
from crosscheck.night.baseline import DEFAULT, read_baseline, scenes_of, write_baseline
from crosscheck.night.campaign import make_room, refuse_others, run, seed_of
from crosscheck.night.history import HistoryError, nights, other_versions, refuse_other, remember, trends, warnings
from crosscheck.night.plan import ALWAYS, SAMPLED, NightOutcome, NightPlan, taken, write_outcome
from crosscheck.night.sections import write_documents, write_pictures, write_sections
from crosscheck.report import summary
from crosscheck.report.build import build, summarized
from crosscheck.scenes.names import PEERS, QUANTITIES
from crosscheck.workers.cluster import LOCAL
from crosscheck.workers.pool import SECONDS_PER_SCENE, find_engines

CODES = {
    summary.PASS: PASS,
    summary.NEW_DISAGREEMENTS: DISAGREEMENT,
    summary.ENGINE_MISSING: ENGINE_MISSING,
    summary.INFRASTRUCTURE: INFRASTRUCTURE,
    summary.NOTHING_RAN: NOTHING_RAN,
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
    A run that was killed or interrupted is continued by the same command, with the same source, versions and
    engine files.

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
        Start a new night where the folder holds a finished one: the files of that night are removed, and no others.
    workers
        Worker processes; one per processor by default.
    cluster
        Check the scenes on a Dask cluster: `local` for one here (of `workers` processes), or a scheduler, `tcp://host:8786`.
    scene_seconds
        An engine that takes longer [s] on a scene is stopped, and counts as hanging; a run goes on only with the same.
    known_gaps
        A table of known gaps to use instead of our own: a file, or `none`. Then the night reports for each row of our
        own after how many scenes it occurred. A run that goes on may take another: all is judged anew.
    sections_seconds
        How long to measure hard cases, prices and effects after the scenes [s]; they are left out if it is less than
        eight. By default as long as `minutes`, four minutes at most; none for a night of `scenes` alone.
    history
        The file with the history of all nights; `history.sqlite` beside the folder by default.
    baseline
        The accepted digits of the golden set; that of this checkout by default, if there is one.
    """
    accepted = baseline or (DEFAULT if DEFAULT.is_file() else None)
    if accepted is not None:
        read_baseline(accepted)
    if history is not None:
        refuse_other(history)
    gaps.table(known_gaps)  # a table that makes no sense is told before there is a folder
    refuse_others(out)
    if history is not None:
        writable_folder("history", history.parent)
        writable("history", history)
    if sections_seconds is not None and not 0.0 <= sections_seconds < math.inf:
        raise UsageError(f"--sections-seconds: expected a number from 0 on, got {sections_seconds}")
    _refuse(out, cluster, minutes=minutes, scenes=scenes, workers=workers, scene_seconds=scene_seconds)
    required = names(require_engines, always=())
    asked = tuple(dict.fromkeys((*names(engines), *required)))
    with taken(out):
        if fresh:
            make_room(out)
        plan = NightPlan(
            seed=seed_of(out, seed),
            out=out,
            engines=asked,
            required=required,
            minutes=3.0 if minutes is None and scenes is None else minutes,
            scenes=scenes,
            workers=workers or _cores(),
            cluster=cluster,
            scene_seconds=scene_seconds,
            baseline=accepted,
            known_gaps=known_gaps,
        )
        seconds = min(240.0, 60.0 * (plan.minutes or 0.0)) if sections_seconds is None else sections_seconds
        return _reported(plan.out, _carried_out(plan, seconds), history or plan.out.parent / "history.sqlite")


def _cores() -> int:
    """Return how many processors this process may use."""
    return len(os.sched_getaffinity(0)) if hasattr(os, "sched_getaffinity") else os.cpu_count() or 1


def _carried_out(plan: NightPlan, seconds: float) -> NightOutcome:
    """Carry out a plan: its scenes, then for so many seconds what is measured beside them."""
    try:
        with shown_progress(plan.scenes, plan.minutes) as progress:
            outcome = run(plan, progress)
        if outcome.checked:
            write_sections(plan.out, outcome.engines, {ALWAYS, *SAMPLED}, seconds, _told)
            _told("pictures and documents")
            write_pictures(plan.out, plan.seed, outcome.engines, SECONDS_FOR_PICTURES)
            write_documents(plan.out)
    except KeyboardInterrupt as error:
        kept = f"what was checked is kept in {plan.out}, and the same command goes on from there"
        error.args = (f"{str(error) or 'interrupted'}; {kept}",)
        raise
    return outcome


def _reported(out: Path, outcome: NightOutcome, history: Path) -> int:
    """Keep a night in the history, write its report, print how it ended, and return its exit code."""
    report = summarized(out)
    try:
        report["trends"] = remember(history, report, out)
    except (HistoryError, OSError) as error:
        outcome.failed.append(f"the history cannot be kept: {error}")
        write_outcome(out, outcome)
        report = summarized(out)
    page = build(out, report)
    warned = [f"warning: {line}" for line in warnings(report["trends"])] if report["trends"] else []
    shown = console(None, stderr=True)
    unread = [f"failed: {text}" for text in report["failures"] if text not in outcome.failed][:MOST_LINES]
    warned += [f"note: {line}" for line in report["notes"]]
    counted = f"{report['new_disagreements']} new and {report['known_disagreements']} known disagreements"
    lines = [*outcome_lines(outcome), f"{outcome.checked} scenes checked, {counted}"]
    for line in (*unread, *lines, *warned, f"{report['verdict']}: {report['why']}", f"report: {page}"):
        shown.print(line, soft_wrap=True)
    return CODES[report["verdict"]]


def _told(doing: str) -> None:
    print(f"measuring {doing}", file=sys.stderr, flush=True)


def _refuse(out: Path, cluster: str | None, **numbers: float | None) -> None:
    for key, value in numbers.items():
        positive(key.replace("_", "-"), value)
    if out.exists() and not out.is_dir():
        raise UsageError(f"--out: expected a folder, got the file {out}")
    if cluster is not None and cluster != LOCAL and "://" not in cluster:
        where = f"{LOCAL!r} or a scheduler's address like tcp://host:8786"
        raise UsageError(f"--cluster: expected {where}, got {cluster!r}")


BLOCKS = "▁▂▃▄▅▆▇█"
MOST_NIGHTS = 90
"""Nights that a line of blocks shows."""


def history(*, history: Path = Path("reports/history.sqlite"), last: Whole = 14, as_json: Json = False) -> int:
    """Show the nights that were kept: how they ended, versions, worst digits, times relative to refkin, what changed.

    Exit codes: 0 shown, 2 there is no such file, 4 it cannot be read.

    Parameters
    ----------
    history
        The file that nights are kept in.
    last
        How many nights the tables show; changes are looked for in all.
    """
    if not history.is_file():
        raise UsageError(f"there is no history {history}: crosscheck nightly makes one")
    positive("last", last)
    kept, course = nights(history), trends(history)
    if as_json:
        print(json.dumps({"schema": 1, "nights": kept, "series": course["series"], "warnings": warnings(course)}))
        return PASS
    out = console(140)
    counts = ("scenes", "new", "known")
    verdicts = [coloured(n["verdict"], "green" if n["verdict"] == "pass" else "red") for n in kept[-last:]]
    last_nights = zip(kept[-last:], verdicts, strict=True)
    rows = ([n["date"], n["seed"], said, *(n[k] for k in counts)] for n, said in last_nights)
    out.print(table("night (UTC)", "seed", "verdict", *(f">{name}" for name in counts), rows=rows, title="Nights"))
    for line in other_versions(kept):
        out.print(line, soft_wrap=True)
    out.print(_digit_table(kept[-last:]))
    out.print(_cost_table(course["series"]))
    quiet = sum(not one["changes"] and one["priced"] for one in course["series"])
    if quiet:
        out.print(f"{quiet} series of the price list without a change: --json has them")
    for line in warnings(course):
        out.print(f"warning: {line}")
    return PASS


class NoAnswers(CannotRun):
    """An engine answers nothing of what is to be compared."""

    code = DISAGREEMENT


def baseline(
    *,
    accept: Annotated[bool, Parameter(negative="")] = False,
    engines: str = ",".join((ALWAYS, *SAMPLED, *PEERS)),
    file: Annotated[Path, Parameter(show_default=False)] = DEFAULT,
) -> int:
    """Compare the golden set with the accepted baseline, or accept what is measured now as the new one.

    Exit codes: 0 nothing is worse, 1 something is, or an engine answers nothing, 2 there is no baseline, or none of the
    engines is in it, 3 an engine is missing.

    Parameters
    ----------
    accept
        Write the baseline anew; what is worse than before is printed all the same.
    engines
        Names, separated by commas.
    file
        The baseline; that of this checkout by default.
    """
    installed, missing = find_engines(names(engines, always=()))
    if missing:
        print("\n".join(f"{name}: {why}" for name, why in missing.items()), file=sys.stderr)
        return ENGINE_MISSING
    before = {} if accept and not file.exists() else read_baseline(file)["cases"]  # another file is not written over
    with checkers(1, {name: spec for name, (spec, _) in installed.items()}) as workers:
        scenes = golden.golden_scenes() if accept else scenes_of(before)
        now = golden.measure(scenes, workers, list(installed))
    worse = golden.differences({k: v for k, v in before.items() if k in now}, now, installed)
    for case in worse:
        print(f"{case.case}: {case.disagreement}")
    known, answering = ({name for case in cases.values() for name in case["methods"]} for cases in (before, now))
    mute, new = ([name for name in installed if name not in there] for there in (answering, known))
    if mute:
        raise NoAnswers(f"no answer to any case of the golden set: {', '.join(mute)}")
    if accept:
        for name in sorted(known - answering):
            print(f"no longer in the baseline: {name}")
        write_baseline(file, now, {name: version for name, (_, version) in installed.items()})
        print(f"accepted: {len(now)} cases in {file}")
        return PASS
    if new:
        print(f"not compared, as the baseline does not have them: {', '.join(new)}")
    if len(new) == len(installed):
        raise UsageError("--engines: expected one that the baseline has, or more")
    print(f"{len(now)} cases, {len(worse)} of their numbers are worse than the baseline")
    return DISAGREEMENT if worse else PASS


def _digit_table(kept: Sequence[Mapping[str, Any]]) -> Table:
    """Return the digits of the latest night, and the fewest and most worst digits of the nights shown."""
    by_method: dict[tuple[str, str], dict[str, list[Mapping[str, Any]]]] = {}
    for night in kept:
        for row in night["accuracy"]:
            by_method.setdefault((row["engine"], row["method"]), {}).setdefault(row["quantity"], []).append(row)
    rows = [[*method, *(_digits(of.get(q, [])) for q in QUANTITIES)] for method, of in sorted(by_method.items())]
    title = "Digits: median / worst of the last night, each over all its own scenes (range of the worst)"
    return table("engine", "method", *(f">{quantity}" for quantity in QUANTITIES), rows=rows, title=title)


def _digits(rows: Sequence[Mapping[str, Any]]) -> str:
    worst = [row["digits_worst"] for row in rows if row["digits_worst"] is not None]
    if not worst or rows[-1]["digits_worst"] is None:
        return "no answer"
    return f"{rows[-1]['digits_median']:.1f} / {rows[-1]['digits_worst']:.1f} ({min(worst):.1f} to {max(worst):.1f})"


def _cost_table(series: Sequence[Mapping[str, Any]]) -> Table:
    rows = []
    for one in series:
        if not one["changes"] and one["priced"]:
            continue
        changes = "; ".join(f"{one['nights'][int(k)]}: × {factor:.2f}" for k, factor in one["changes"].items())
        course = _blocks(one["values"][-MOST_NIGHTS:])
        rows.append([one["name"], len(one["values"]), f"{one['values'][-1]:.3g}", course, changes or "none"])
    heads = ("series", "nights", "last", "course", "change of level")
    return table(*heads, rows=rows, title="Time relative to refkin")


def _blocks(values: Sequence[float]) -> str:
    """Return a line of blocks, the lowest for the least value."""
    low, high = min(values), max(values)
    room = (high - low) or 1.0
    return "".join(BLOCKS[round((value - low) / room * (len(BLOCKS) - 1))] for value in values)
