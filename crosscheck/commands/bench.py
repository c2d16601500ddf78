"""`crosscheck bench` compares times and errors; `crosscheck effects` measures what each effect costs on a scene."""

from __future__ import annotations

import json
import sys
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import asdict
from itertools import groupby
from pathlib import Path
from typing import Annotated, Any

from cyclopts import Parameter
from rich.console import Console
from rich.table import Table

from crosscheck.commands.engines import ENGINES, names
from crosscheck.commands.usage import Json, Names, coloured, console, shown_progress, table
from crosscheck.errors import DISAGREEMENT, ENGINE_MISSING, INFRASTRUCTURE, PASS, UsageError
from crosscheck.judge.prices import EffectRow
from crosscheck.measure.bench import key_of, measured_apart, merged
from crosscheck.measure.effects import REFKIN, effects_ledger
from crosscheck.measure.price_process import Key
from crosscheck.scenes import workloads
from crosscheck.scenes.names import OURS, called
from crosscheck.workers.pool import find_engines
from crosscheck.workers.processes import Failure
from refkin.motion import Status
from refkin.scenes.files import load
from refkin.solving.limits import said_if_long
from refkin.solving.solve import solve


def bench(
    *, only: Annotated[list[str] | None, Parameter(negative="")] = None, engines: Names = ENGINES, as_json: Json = False
) -> int:
    """Measure this project's time and error against C, the engines, SciPy and the closed form, on one thread.

    An engine that raises, ends its process or hangs is absent, with the reason.

    Exit codes: 0 done, 2 there is no workload of that name, 4 a workload could not be measured.

    Parameters
    ----------
    only
        A workload, such as sweep-1000; may be given more than once. All by default, which takes some minutes.
    """
    unknown = [name for name in only or () if name not in workloads.WORKLOADS]
    if unknown:
        there = ", ".join(workloads.WORKLOADS)
        raise UsageError(f"--only: no workload is called {unknown[0]!r}; there are: {there}")
    producers = (*OURS, *names(engines, always=()))
    parts, hung = list[dict[str, Any]](), dict[Key, str]()
    asked = [*dict.fromkeys(only or workloads.WORKLOADS)]
    with shown_progress(len(asked), noun="workloads") as show:
        for name in asked:
            show(len(parts), name)
            with said_if_long(f"measuring {name}"):
                part = measured_apart(name, producers, hung)
            if isinstance(part, Failure):
                print(f"{name}: {part.text}", file=sys.stderr)
                return INFRASTRUCTURE
            parts.append(part)
    results = merged(parts)
    if as_json:
        print(json.dumps({"schema": 1, **results}, indent=1))
    else:
        print_results(results, console(180))
    return PASS


RIVALS: dict[Key, str] = {
    ("c", "same program", ""): "the same operations compiled as C",
    ("c", "dense Newton", ""): "dense Newton in C",
}
"""The rivals that every claim names first: the same algorithm in C, then what a person would write in C."""
CLAIMED = (("refkin-batch", "all times at once", "no evidence"), ("refkin-batch", "sparse", ""))
UNRANKED = "not ranked"


def print_results(results: dict[str, Any], out: Console) -> None:
    """Print all workloads, then what was absent, and on what it was measured."""
    for name, rows in groupby(results["rows"], key=lambda row: row["workload"]):
        of_one = list(rows)
        out.print(workload_table(name, of_one))
        for line in (*claims(of_one), *notes(of_one)):
            out.print(line)
        out.print()
    for absent in results["absent"]:
        out.print(f"absent: {named(absent)} ({absent['workload']}): {absent['reason']}")
    setup = [f"{name} {value}" for name, value in results["versions"].items()]
    machine = results["machine"]
    setup += [f"{machine['processor']}, {machine['system']}, threads: {machine['threads']} of {machine['cores']}"]
    out.print(", ".join(setup))


def named(row: Mapping[str, Any]) -> str:
    """Return engine, method and setting of a row."""
    return ", ".join(filter(None, key_of(row)))


def workload_table(name: str, rows: list[dict[str, Any]]) -> Table:
    """Return the table of one workload: right answers by price, then the others, which have no rank."""
    times = {key_of(row): row["nanoseconds_per_configuration"] for row in rows if row["ranked"]}
    rivals = [rival for rival in RIVALS if rival in times]
    ratios_to = (f">/ {', '.join(rival[:2])}" for rival in rivals)
    numbers_of = (">time", ">spread", *ratios_to, ">error", ">error / allowed")
    shown: list[Any] = []
    for row in sorted(rows, key=lambda r: (not r["ranked"], r["nanoseconds_per_configuration"])):
        time = row["nanoseconds_per_configuration"]
        ratios = [f"{time / times[rival]:.3g}" if row["ranked"] else UNRANKED for rival in rivals]
        errors = ["no answer" if x is None else f"{x:.1e}" for x in (row["max_error"], row["worst_over_allowed"])]
        words = [", ".join(level[:3] for level in row["computes"]), row["newton_by"]]
        cells = [named(row), duration(time), f"{row['spread']:.0%}", *ratios, *errors, *words]
        shown.append(cells if row["ranked"] else [coloured(cell, "red") for cell in cells])
    title = f"{name}: per {rows[0]['unit']}"
    return table("engine, method, setting", *numbers_of, "computes", "Newton by", rows=shown, title=title)


def notes(rows: Iterable[dict[str, Any]]) -> list[str]:
    """Return what each method does, and of how much of the workload, where that is a part of it."""
    lines = []
    for row in rows:
        compared = f"; compared {row['compared']:,}" if row["unit"] == "configuration" else ""
        without = f", no budget holds at {row['uncompared']} of the sample" if row["uncompared"] else ""
        lines.append(f"  {named(row)}: {row['note']} (timed {row['timed']:,}{compared}{without})")
    return list(dict.fromkeys(lines))


def claims(rows: Iterable[dict[str, Any]]) -> list[str]:
    """Return in words how this project's methods compare: with the same algorithm in C first."""
    ranked = sorted((row for row in rows if row["ranked"]), key=lambda row: len(row["computes"]))
    times = {key_of(row): row["nanoseconds_per_configuration"] for row in ranked}
    engines = {key: times[key] for key in times if key[0] not in OURS}
    sentences = []
    for ours in CLAIMED:
        if ours not in times:
            continue
        there = {what: times[rival] for rival, what in RIVALS.items() if rival in times}
        words = [f"{times[ours] / time:.3g} times {what}" for what, time in there.items()]
        if engines:
            first = min(engines, key=lambda key: engines[key])
            words.append(
                f"{times[ours] / engines[first]:.3g} times {', '.join(filter(None, first))}, the fastest engine"
            )
        if words:
            sentences.append(f"{', '.join(ours[:2])} takes {', '.join(words)}.")
    return sentences


def duration(nanoseconds: float) -> str:
    """Return a time with three digits."""
    for unit, size in (("s", 1e9), ("ms", 1e6), ("us", 1e3)):
        if nanoseconds >= size:
            return f"{nanoseconds / size:.3g} {unit}"
    return f"{nanoseconds:.3g} ns"


def effects(scene: Path, *, engines: Names = ENGINES, as_json: Json = False) -> int:
    """Show what every effect costs on a scene, and whether one that the scene does not ask for changes the answer.

    Exit codes: 0 done, 1 an effect changes another number of the reference, or the scene has no pose, 2 usage
    or invalid scene, 3 engine missing.

    Parameters
    ----------
    scene
        A scene file (TOML, or JSON if it ends in .json); its first times are measured.
    """
    read_scene = load(scene)
    motion = solve(read_scene)
    if Status.OK not in motion.status:
        print(f"{read_scene.name}: no pose, so no effect has a price: {motion.message}", file=sys.stderr)
        return DISAGREEMENT
    installed, missing = find_engines(names(engines, always=()))
    with shown_progress(1 + len(installed), noun="producers") as tell:
        rows = effects_ledger(read_scene, [spec for spec, _ in installed.values()], tell=tell)
    if as_json:
        plain = [asdict(row) for row in rows]
        print(json.dumps({"schema": SCHEMA, "scene": read_scene.name, "rows": plain, "missing": [*missing.values()]}))
    else:
        out = console(180)
        out.print(ledger_table(read_scene.name, rows))
        for line in (*felt_lines(rows), *absent_lines(rows), *missing.values()):
            out.print(line)
    if missing:
        return ENGINE_MISSING
    ours = [row.inert for row in rows if row.engine == REFKIN]
    return PASS if True in ours and False not in ours else DISAGREEMENT


SCHEMA = 2


def ledger_table(scene: str, rows: Sequence[EffectRow]) -> Table:
    """Return the rows as a table, method by method; times are per configuration."""
    prices = (">adds\nmicroseconds", ">noise\nmicroseconds", ">to\nmicroseconds")
    heads = ("engine, method", "effect", *prices, "inert", ">largest change", "note")
    shown: list[Any] = []
    last = ""
    for row in (row for row in rows if row.inert is not None):
        name = named(vars(row))
        shown += [None] if last not in ("", name) else []
        price = "within noise" if row.within_noise else _number(row.microseconds)
        numbers = (price, _number(row.spread), _number(row.without))
        change = "-" if row.largest_change is None else f"{row.largest_change:.2g}"
        cells = ("" if name == last else name, row.effect, *numbers, "yes" if row.inert else "no", change, row.note)
        shown.append(cells if row.inert else [coloured(cell, "red") for cell in cells])
        last = name
    title = f"{scene}: what each effect costs per configuration, and whether it is inert"
    return table(*heads, rows=shown, title=title)


def felt_lines(rows: Sequence[EffectRow]) -> list[str]:
    """Return a line for each effect that is not inert: which, where it is felt, and how much."""
    lines = []
    for row in rows:
        if row.inert is False:
            what = row.note if row.largest_change is None else f"changes {row.worst} by {row.largest_change:.2g}"
            lines.append(f"not inert: {row.effect} in {named(vars(row))}: {what}")
    if not lines and all(row.inert is None for row in rows):
        return ["no effect was measured"]
    return lines or ["every effect that was measured is inert where it is not called for"]


def absent_lines(rows: Sequence[EffectRow]) -> list[str]:
    """Return a line for each reason why effects have no price: in which engine, by which methods, and which."""
    reasons: dict[tuple[str, str], tuple[list[str], list[str]]] = {}
    for row in rows:
        if row.inert is None:
            by, effects = reasons.setdefault((row.engine, row.note), ([], []))
            by += [name] if (name := called(row.method, row.setting)) not in by else []
            effects += [row.effect] if row.effect not in effects else []
    return [
        f"no price in {engine} ({', '.join(by)}): {', '.join(effects)}: {why}"
        for (engine, why), (by, effects) in reasons.items()
    ]


def _number(value: float | None) -> str:
    return "-" if value is None else f"{value:.1f}"
