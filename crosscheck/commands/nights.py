"""The commands about nights that are over: `crosscheck history` and `crosscheck baseline`."""

from __future__ import annotations

import json
import sys
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Annotated, Any

from cyclopts import Parameter
from rich.table import Table

from crosscheck.commands.usage import Json, coloured, console, table
from crosscheck.errors import DISAGREEMENT, ENGINE_MISSING, PASS, USAGE
from crosscheck.measure.jobs import checkers
from crosscheck.night import golden
from crosscheck.night.history import SOLVED, nights, trends, warnings
from crosscheck.night.plan import ALWAYS, SAMPLED
from crosscheck.scenes.names import PEERS
from crosscheck.workers.installed import find_engines

BLOCKS = "▁▂▃▄▅▆▇█"
MOST_NIGHTS = 90
"""Nights that a line of blocks shows."""

PRICED = ": "
"""What the name of a series of the price list has in it, and that of a route has not."""


def history(*, history: Path = Path("reports/history.sqlite"), last: int = 14, as_json: Json = False) -> int:
    """Show the nights that were kept: how they ended, their worst digits, times relative to refkin and their changes.

    Exit codes: 0 shown, 2 there is no such file, 4 it cannot be read.

    Parameters
    ----------
    history
        The file that nights are kept in.
    last
        How many nights the tables show; changes are looked for in all.
    as_json
        Print one JSON object instead of tables.
    """
    if not history.is_file():
        print(f"there is no history {history}: crosscheck nightly makes one", file=sys.stderr)
        return USAGE
    if last < 1:
        print(f"--last: expected a number above 0, got {last}", file=sys.stderr)
        return USAGE
    kept, course = nights(history), trends(history)
    if as_json:
        print(json.dumps({"schema": 1, "nights": kept, "series": course["series"], "warnings": warnings(course)}))
        return PASS
    out = console(140)
    out.print(_night_table(kept[-last:]))
    out.print(_digit_table(kept[-last:]))
    out.print(_cost_table(course["series"]))
    quiet = sum(not one["changes"] and PRICED in one["name"] for one in course["series"])
    if quiet:
        out.print(f"{quiet} series of the price list without a change: --json has them")
    for line in warnings(course):
        out.print(f"warning: {line}")
    return PASS


def baseline(
    *,
    accept: Annotated[bool, Parameter(negative="")] = False,
    engines: str = ",".join((ALWAYS, *SAMPLED, *PEERS)),
    file: Path = golden.DEFAULT,
) -> int:
    """Compare the golden set with the accepted baseline, or accept what is measured now as the new one.

    Exit codes: 0 nothing is worse, 1 something is, 2 there is no baseline, 3 an engine is missing.

    Parameters
    ----------
    accept
        Write the baseline anew; what is worse than before is told all the same.
    engines
        Names, separated by commas.
    file
        The baseline.
    """
    installed, missing = find_engines(tuple(name.strip() for name in engines.split(",") if name.strip()))
    if missing:
        print("\n".join(f"{name}: {why}" for name, why in missing.items()), file=sys.stderr)
        return ENGINE_MISSING
    try:
        before = golden.read(file)["cases"]
    except golden.NoBaseline as error:
        if not accept:
            print(error, file=sys.stderr)
            return USAGE
        before = {}
    with checkers(1, {name: spec for name, (spec, _) in installed.items()}) as workers:
        scenes = golden.golden_scenes() if accept else golden.scenes_of(before)
        now = golden.measure(scenes, workers, list(installed))
    worse = golden.differences({k: v for k, v in before.items() if k in now}, now, installed)
    for case in worse:
        print(f"{case.case}: {case.disagreement}")
    if accept:
        golden.write(file, now, {name: version for name, (_, version) in installed.items()})
        print(f"accepted: {len(now)} cases in {file}")
        return PASS
    print(f"{len(now)} cases, {len(worse)} of their numbers are worse than the baseline")
    return DISAGREEMENT if worse else PASS


def _night_table(kept: Sequence[Mapping[str, Any]]) -> Table:
    counts = ("scenes", "new", "known")
    verdicts = [coloured(n["verdict"], "green" if n["verdict"] == "pass" else "red") for n in kept]
    rows = ([n["date"], n["seed"], said, *(n[k] for k in counts)] for n, said in zip(kept, verdicts, strict=True))
    return table("night (UTC)", "seed", "verdict", *(f">{name}" for name in counts), rows=rows, title="Nights")


def _digit_table(kept: Sequence[Mapping[str, Any]]) -> Table:
    """Return the digits of the latest night, and the fewest and most worst digits of the nights shown."""
    by_route: dict[tuple[str, str], dict[str, list[Mapping[str, Any]]]] = {}
    for night in kept:
        for row in night["accuracy"]:
            by_route.setdefault((row["engine"], row["route"]), {}).setdefault(row["quantity"], []).append(row)
    rows = [[*route, *(_digits(of.get(q, [])) for q in SOLVED)] for route, of in sorted(by_route.items())]
    title = "Digits: median / worst of the last night (range of the worst)"
    return table("engine", "route", *(f">{quantity}" for quantity in SOLVED), rows=rows, title=title)


def _digits(rows: Sequence[Mapping[str, Any]]) -> str:
    worst = [row["digits_worst"] for row in rows if row["digits_worst"] is not None]
    if not worst or rows[-1]["digits_worst"] is None:
        return "no answer"
    return f"{rows[-1]['digits_median']:.1f} / {rows[-1]['digits_worst']:.1f} ({min(worst):.1f} to {max(worst):.1f})"


def _cost_table(series: Sequence[Mapping[str, Any]]) -> Table:
    rows = []
    for one in series:
        if not one["changes"] and PRICED in one["name"]:
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
