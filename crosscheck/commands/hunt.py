"""`crosscheck hunt`: where error / allowed is worst; `crosscheck hard`: the engines at hard cases."""

from __future__ import annotations

import json
import sys
import time
from collections import Counter
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Annotated, Any

from cyclopts import Parameter

from crosscheck.commands.engines import ENGINES, any_answered, names
from crosscheck.commands.usage import (
    Json,
    Whole,
    console,
    positive,
    print_in_parts,
    shown_progress,
    table,
    writable_folder,
)
from crosscheck.engines import EngineError
from crosscheck.errors import DISAGREEMENT, ENGINE_MISSING, INFRASTRUCTURE, NOTHING_RAN, PASS, UsageError
from crosscheck.judge.known_gaps import BAD, HardOutcome, told, unexplained
from crosscheck.measure.effects import REFKIN
from crosscheck.measure.hard_table import SECONDS, hard_case_rows
from crosscheck.night.campaign import OtherRun, seed_of
from crosscheck.night.disagreements import slug
from crosscheck.night.hunting import CERTIFICATE, Bag, Start, drawn_again, hunt, hunted, worst_of_night
from crosscheck.night.plan import ALWAYS, taken, write_scene
from crosscheck.scenes.hard import hard_cases
from crosscheck.scenes.hard_case import HardCase
from crosscheck.scenes.names import called
from crosscheck.workers.pool import SECONDS_PER_SCENE, find_engines

LATEST = Path("reports/latest")
LEAST_ERRORS = "least errors (radii) from the certified pose"


def hunt_worst(
    *,
    minutes: float = 5.0,
    seed: Whole | None = None,
    engines: str = ENGINES,
    out: Path = Path("reports/hunt"),
    night: Path = LATEST,
    scene_seconds: float = SECONDS_PER_SCENE,
) -> int:
    """Hunt for the worst error / allowed: the worst scenes of a night, near those, then ever nearer to singular poses.

    Each engine is hunted by its best method. To blame is what `crosscheck replay` calls a disagreement; that asks every
    method, and may blame others beside. How far a position lies from the certified one is shown, and is no error yet.
    Exit codes: 0 nobody is to blame, 1 somebody is, 2 usage, 3 engine missing, 4 an engine crashed or hung, 5 nobody
    answered, 130 interrupted.

    Parameters
    ----------
    minutes
        How long; the scenes of a night are checked first in any case.
    seed
        Where to begin; the day's date as a number by default.
    engines
        Names, separated by commas, or `file.py:Class`; the closed form is always among the sources.
    out
        The folder for the worst scene of each target and of each kind of disagreement, as scene files to replay; those
        of an earlier hunt stay, and new ones of the same name have a number.
    night
        The folder of a night, from whose worst scenes to start, if there is one.
    scene_seconds
        After this long on one scene an engine is said to hang.
    """
    positive("minutes", minutes)
    positive("scene-seconds", scene_seconds)
    installed, missing = find_engines(names(engines, always=(ALWAYS,)))
    if missing:
        print("\n".join(missing.values()), file=sys.stderr)
        return ENGINE_MISSING
    specs = {name: spec for name, (spec, _) in installed.items()}
    today = int(time.strftime("%Y%m%d", time.gmtime())) if seed is None else seed
    bag, starts = Bag(), _starts(night, hunted(specs))
    writable_folder("out", out)  # made where nothing else is refused
    with taken(out):
        try:
            with shown_progress(None, minutes) as show:
                worst = lambda bag: show(bag.scenes, f"hunting, worst {bag.worst:.3g}")  # noqa: E731
                hunt(specs, 60.0 * minutes, today, scene_seconds=scene_seconds, starts=starts, bag=bag, progress=worst)
        finally:  # also when it is interrupted: what was caught is kept
            _write_bag(bag, out, names(engines, always=()))
            _print_bag(bag, out)
    if bag.failures:
        return INFRASTRUCTURE
    if bag.blames:
        return DISAGREEMENT
    return PASS if any_answered(specs, {engine for engine, *_ in bag.catches}) else NOTHING_RAN


def _starts(night: Path, best: Mapping[str, str]) -> list[Start]:
    """Return the scenes of a night to start from, none if there is no night; say how many that is."""
    known = (night / "run.json").is_file()
    if not known and night != LATEST:
        raise OtherRun(f"--night {night} holds no run")
    worst, unread = worst_of_night(night, best, seed_of(night, None)) if known else ({}, 0)
    starts = drawn_again(worst)
    left_out = {"that this version draws otherwise": len(worst) - len(starts), "whose records cannot be read": unread}
    others = " and ".join(f"{count} {why}" for why, count in left_out.items() if count)
    said = f"starting from {len(starts)} scenes of {night}" if known else "starting from no night"
    print("; left out are ".join(filter(None, (said, others))), file=sys.stderr)
    return starts


def _write_bag(bag: Bag, out: Path, engines: Sequence[str]) -> None:
    for name, catch in bag.catches.items():
        unit = LEAST_ERRORS if name[2] == CERTIFICATE else "times the allowed error"
        about = f"{' '.join(name)}: {catch.ratio:.3g} {unit}, the worst of {bag.scenes} scenes"
        write_scene(_free(out, slug(*name)), [about], catch.scene, engines, expected=catch.expected)
    for signature, blame in bag.blames.items():
        about = told(blame.record, blame.disagreement)
        write_scene(_free(out, slug(*signature)), [about], blame.scene, engines, expected=blame.expected)


def _free(out: Path, name: str) -> Path:
    """Return a file of that name, with a number where an earlier hunt has left one, which may be a worse scene."""
    numbers = ("", *(f"-{k}" for k in range(2, 2 + len(list(out.glob(f"{name}*"))))))
    return next(path for number in numbers if not (path := out / f"{name}{number}.toml").exists())


def _print_bag(bag: Bag, out: Path) -> None:
    shown, rows = console(160), []
    for name, catch in sorted(bag.catches.items(), key=lambda pair: (pair[0][2] == CERTIFICATE, -pair[1].ratio)):
        numbers = ["-", f"{catch.ratio:.3g}"] if name[2] == CERTIFICATE else [f"{catch.ratio:.3g}", "-"]
        rows.append([*name, *numbers, catch.origin, catch.number])
    numbers_of = (">error/allowed", ">certificate,\nradii")
    heads = ("engine", "method", "quantity", *numbers_of, ">starting from", ">number of the scene")
    shown.print(table(*heads, rows=rows, title=f"The worst of {bag.scenes} scenes"))
    for blame in sorted(bag.blames.values(), key=lambda blame: -blame.ratio):
        shown.print(f"to blame: {told(blame.record, blame.disagreement)}")
    for who, scenes in bag.beside.most_common():
        shown.print(f"not hunted, though replay blames it: {who}, in {scenes} of the scenes")
    for failure in bag.failures:
        shown.print(f"failed: {failure}")
    shown.print(f"scenes: {out}")


def hard(
    *,
    engines: str = ENGINES,
    case: Annotated[tuple[str, ...], Parameter(negative="")] = (),
    within: float | None = None,
    case_seconds: float = SECONDS,
    as_json: Json = False,
) -> int:
    """Solve the hard cases by every method of the engines, with their default settings among them.

    Verdicts: correct; warned (right, with a warning); refused; wrong (without a warning); crash; hang.
    Exit codes: 0 a finding explains each wrong answer, 1 some are not explained, 2 usage, 3 engine missing.

    Parameters
    ----------
    engines
        Names, separated by commas, or `file.py:Class`; refkin is always among them.
    case
        Kinds of hard scenes, all by default.
    within
        Seconds after which no further case is begun, for any engine: all solve the same ones.
    case_seconds
        A method that takes longer [s] on one case is stopped, and counts as hanging.
    as_json
        Print one JSON object, whose `rows` they are, instead of a table.
    """
    cases = _cases(case)
    positive("within", within)
    positive("case-seconds", case_seconds)
    asked = (REFKIN, *names(engines, always=()))
    try:
        with shown_progress(len(cases), noun="cases") as show:
            rows = hard_case_rows(asked, within, cases=cases, seconds=case_seconds, tell=show)
    except EngineError as error:
        print(error, file=sys.stderr)
        return ENGINE_MISSING
    if as_json:
        print(json.dumps({"schema": 1, "rows": rows}, indent=1, allow_nan=False))
    else:
        _print_table(rows)
    return DISAGREEMENT if unexplained(rows) else PASS


def _cases(kinds: Sequence[str]) -> list[HardCase]:
    every = hard_cases()
    known = list(dict.fromkeys(case.case for case in every))
    for kind in kinds:
        if kind not in known:
            raise UsageError(f"--case: no hard scene is called {kind!r}; there are: {'; '.join(known)}")
    return [case for case in every if not kinds or case.case in kinds]


def _print_table(rows: Sequence[dict[str, Any]]) -> None:
    """Print case x method with the verdicts, how many of each, and what is wrong with its explanation."""
    out = console(200)
    rows = [{**row, "method": called(row["method"], row["setting"])} for row in rows]
    names = list(dict.fromkeys((row["engine"], row["method"]) for row in rows))
    count, of = len({(row["case"], row["distance"]) for row in rows}), max((row["of"] for row in rows), default=0)
    asked = f"all {of}" if count == of else f"{count} of {of}, the same for all engines"
    by_case: dict[tuple[str, float | None], dict[tuple[str, str], str]] = {}
    for row in rows:
        verdicts = by_case.setdefault((row["case"], row["distance"]), {})
        verdicts[row["engine"], row["method"]] = row["verdict"]
    shown: list[Any] = [
        [case, "" if distance is None else f"{distance:.3g}", *(verdicts.get(name, "") for name in names)]
        for (case, distance), verdicts in by_case.items()
    ]
    counts = Counter((r["engine"], r["method"], r["verdict"]) for r in rows)
    shown += [None, *([f"all: {verdict}", "", *(counts[*name, verdict] for name in names)] for verdict in HardOutcome)]
    heads = ("case", "distance", *("\n".join(name) for name in names))
    print_in_parts(out, *heads, rows=shown, title=f"Hard cases: {asked}", first=2)
    by_reason: dict[tuple[str, ...], list[dict[str, Any]]] = {}  # rows that share an explanation stand together
    for row in rows:
        if row["verdict"] in BAD:
            reason = f"{row['class']}: {row['quote']}" if row["class"] else "no finding explains this"
            by_reason.setdefault((row["engine"], row["method"], row["verdict"], reason), []).append(row)
    for (engine, name, verdict, reason), rows_of in by_reason.items():
        out.print(f"\n{engine} ({name}), {verdict}: {reason}")
        for row in rows_of:
            out.print(f"  {row['case']}, {row['distance']:.3g}: {row['note']}")
