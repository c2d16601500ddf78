"""The command `crosscheck bench`: every workload in a process of its own, on one thread; JSON, or tables."""

from __future__ import annotations

import json
import sys
from collections.abc import Iterable, Mapping
from itertools import groupby
from typing import Annotated, Any

from cyclopts import Parameter
from rich.console import Console
from rich.table import Table

from crosscheck.commands.engines import ENGINES, names
from crosscheck.commands.progress import shown_progress
from crosscheck.commands.usage import Json, coloured, console, table
from crosscheck.engines.methods import OURS
from crosscheck.errors import INFRASTRUCTURE, PASS, USAGE
from crosscheck.measure.bench import measured_by_name, merged
from crosscheck.measure.bench_aims import DENSE, SAMPLES, SPARSE, Key, key_of
from crosscheck.scenes import workloads
from crosscheck.workers.processes import Failure, call_each

SECONDS_PER_WORKLOAD = 600.0


def bench(
    *,
    only: Annotated[list[str] | None, Parameter(negative="")] = None,
    engines: str = ENGINES,
    as_json: Json = False,
) -> int:
    """Measure this project's time and error against C, the engines, SciPy and the closed form, on one thread.

    Exit codes: 0 done, 2 there is no workload of that name, 4 a workload could not be measured.

    Parameters
    ----------
    only
        A workload, such as sweep-1000; may be given more than once. All by default, which takes some minutes.
    engines
        Names, separated by commas, or `file.py:Class`.
    as_json
        Print one JSON object instead of tables.
    """
    unknown = [name for name in only or () if name not in workloads.names()]
    if unknown:
        there = ", ".join(workloads.names())
        print(f"--only: no workload is called {unknown[0]!r}; there are: {there}", file=sys.stderr)
        return USAGE
    producers = (*OURS, *names(engines, always=()))
    parts: list[dict[str, Any]] = []
    asked = only or workloads.names()
    with shown_progress(len(asked), noun="workloads") as show:
        for name in asked:
            show(len(parts), name)
            (part,) = call_each(measured_by_name, [(name, producers)], SECONDS_PER_WORKLOAD)
            if isinstance(part, Failure):
                print(f"{name}: {part.text}", file=sys.stderr)
                return INFRASTRUCTURE
            parts.append(part)
    results = merged(parts)
    if as_json:
        print(json.dumps(results, indent=1))
    else:
        print_results(results, console(180))
    return PASS


RIVALS: dict[Key, str] = {
    ("c", "same program", ""): "the same operations compiled as C",
    DENSE: "dense Newton in C",
}
"""The rivals that every claim names first: the same algorithm in C, then what a person would write in C."""
CLAIMED = (SAMPLES, SPARSE)
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
    for line in aim_lines(results.get("aims", [])):
        out.print(line)
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
        ratios = [ratio(time / times[rival]) if row["ranked"] else UNRANKED for rival in rivals]
        numbers = [duration(time), f"{row['spread']:.0%}", *ratios, *map(error, (row["max_error"], allowed(row)))]
        words = [", ".join(level[:3] for level in row["computes"]), row["newton_by"]]
        cells = [named(row), *numbers, *words]
        shown.append(cells if row["ranked"] else [coloured(cell, "red") for cell in cells])
    title = f"{name}: per {rows[0]['unit']}"
    return table("engine, method, setting", *numbers_of, "computes", "Newton by", rows=shown, title=title)


def aim_lines(aims: Iterable[dict[str, Any]]) -> list[str]:
    """Return what the run says of each aim."""
    lines = []
    for aim in aims:
        word, bound = ("at most", aim["at_most"]) if "at_most" in aim else ("at least", aim["at_least"])
        measured = "not measured" if aim["measured"] is None else f"{aim['measured']:.3g}"
        verdict = "reached" if aim["reached"] else "MISSED"
        lines.append(f"{verdict}: {aim['aim']}: {measured} ({word} {bound:g})")
    return lines


def notes(rows: Iterable[dict[str, Any]]) -> list[str]:
    """Return what each method does, and of how much of the workload, where that is a part of it."""
    lines = []
    for row in rows:
        judged = f"; judged {row['judged']:,}" if row["unit"] == "configuration" else ""
        without = f", no budget holds at {row['unjudged']} of the sample" if row["unjudged"] else ""
        lines.append(f"  {named(row)}: {row['note']} (timed {row['timed']:,}{judged}{without})")
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
        words = [f"{ratio(times[ours] / time)} times {what}" for what, time in there.items()]
        if engines:
            first = min(engines, key=lambda key: engines[key])
            words.append(f"{ratio(times[ours] / engines[first])} times {', '.join(first[:2])}, the fastest engine")
        if words:
            sentences.append(f"{', '.join(ours[:2])} takes {', '.join(words)}.")
    return sentences


def allowed(row: dict[str, Any]) -> float | None:
    """Return error / allowed of a row."""
    value: float | None = row["worst_over_allowed"]
    return value


def duration(nanoseconds: float) -> str:
    """Return a time with three digits."""
    for unit, size in (("s", 1e9), ("ms", 1e6), ("us", 1e3)):
        if nanoseconds >= size:
            return f"{nanoseconds / size:.3g} {unit}"
    return f"{nanoseconds:.3g} ns"


def ratio(x: float) -> str:
    """Return a ratio with three digits."""
    return f"{x:.3g}"


def error(x: float | None) -> str:
    """Return an error, which is null where there was no answer."""
    return "no answer" if x is None else f"{x:.1e}"
