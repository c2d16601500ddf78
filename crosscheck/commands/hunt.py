"""`crosscheck hunt`: where error / allowed is worst."""

from __future__ import annotations

import sys
import time
from collections.abc import Mapping, Sequence
from pathlib import Path

from crosscheck.commands.engines import ENGINES, names
from crosscheck.commands.progress import shown_progress
from crosscheck.commands.usage import Whole, console, positive, printable, table
from crosscheck.engines import load
from crosscheck.errors import DISAGREEMENT, ENGINE_MISSING, INFRASTRUCTURE, PASS
from crosscheck.night.campaign import OtherRun, seed_of
from crosscheck.night.disagreements import slug
from crosscheck.night.hunting import Bag, hunt, worst_of_night
from crosscheck.night.journal import replace_file
from crosscheck.night.plan import ALWAYS, engines_option
from crosscheck.workers.installed import find_engines
from crosscheck.workers.pool import SECONDS_PER_SCENE
from refkin.scenes.files import to_toml

LATEST = Path("reports/latest")


def hunt_worst(
    *,
    minutes: float = 5.0,
    seed: Whole | None = None,
    engines: str = ENGINES,
    out: Path = Path("reports/hunt"),
    night: Path = LATEST,
    scene_seconds: float = SECONDS_PER_SCENE,
) -> int:
    """Hunt for the worst error / allowed: near the worst scenes of a night, then ever nearer to singular poses.

    Exit codes: 0 nothing above 1, 1 something, 2 usage, 3 engine missing, 4 an engine crashed or hung, 130 interrupted.

    Parameters
    ----------
    minutes
        How long.
    seed
        Where to begin; the day's date as a number by default.
    engines
        Names, separated by commas, or `file.py:Class`; the closed form is always among the sources.
    out
        The folder for the worst scene of each target, as a scene file to replay.
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
    bag, starts = Bag(), _starts(night, specs)
    print(f"starting from {len(starts)} scenes of {night}" if starts else "starting from no night", file=sys.stderr)
    try:
        with shown_progress(None, minutes) as show:
            worst = lambda bag: show(bag.scenes, f"hunting, worst {bag.worst:.3g}")  # noqa: E731
            hunt(specs, 60.0 * minutes, today, scene_seconds=scene_seconds, starts=starts, bag=bag, progress=worst)
    finally:  # also when it is interrupted: what was caught is kept
        _write(bag, out, names(engines, always=()))
        _print(bag, out)
    if bag.failures:
        return INFRASTRUCTURE
    return DISAGREEMENT if bag.above() else PASS


def _starts(night: Path, specs: Mapping[str, str]) -> list[tuple[int, int]]:
    """Return the scenes of a night to start from; none if there is no night."""
    if not (night / "run.json").is_file():
        if night != LATEST:
            raise OtherRun(f"--night {night} holds no run")
        return []
    best = {name: load(spec).routes()[0].name for name, spec in specs.items()}
    return worst_of_night(night, best, seed_of(night, None))


def _write(bag: Bag, out: Path, engines: Sequence[str]) -> None:
    """Write the worst scene of each target."""
    out.mkdir(parents=True, exist_ok=True)
    for name, catch in bag.catches.items():
        file = f"{slug(*name)}.toml"
        comment = f"# {' '.join(name)}: {catch.ratio:.3g} times the allowed error, the worst of {bag.scenes} scenes\n"
        again = f"# Show it again: crosscheck replay {file}{engines_option(engines)}\n\n"
        replace_file(out / file, printable(comment) + again + to_toml(catch.scene))


def _print(bag: Bag, out: Path) -> None:
    shown = console(160)
    worst = sorted(bag.catches.items(), key=lambda pair: -pair[1].ratio)
    rows = ([*name, f"{catch.ratio:.3g}", catch.origin, catch.number] for name, catch in worst)
    heads = ("engine", "route", "quantity", ">error/allowed", ">from", ">found by scene")
    shown.print(table(*heads, rows=rows, title=f"The worst of {bag.scenes} scenes"))
    for name, catch in bag.above():
        shown.print(f"above 1: {' '.join(name)}, {catch.ratio:.3g} times the allowed error")
    for failure in bag.failures:
        shown.print(f"failed: {failure}")
    shown.print(f"scenes: {out}")
