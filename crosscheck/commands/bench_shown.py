"""The benchmark for a person: a table for each workload, the fairest rivals first, and what it comes to in words."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from itertools import groupby
from typing import Any

from rich.console import Console
from rich.markup import escape
from rich.table import Table

from crosscheck.engines.methods import OURS
from crosscheck.measure.bench_aims import DENSE, LANES, SPARSE, Key, key_of

RIVALS: dict[Key, str] = {
    ("c", "same program", ""): "the same operations compiled as C",
    DENSE: "dense Newton in C",
}
"""The rivals that every claim names first: the same algorithm in C, then what a person would write in C."""
CLAIMED = (LANES, SPARSE)
UNRANKED = "not ranked"


def print_results(results: dict[str, Any], console: Console) -> None:
    """Print all workloads, then what was absent, and on what it was measured."""
    for name, rows in groupby(results["rows"], key=lambda row: row["workload"]):
        of_one = list(rows)
        console.print(table(name, of_one))
        for line in (*claims(of_one), *notes(of_one)):
            console.print(line, markup=False, highlight=False)
        console.print()
    for absent in results["absent"]:
        console.print(f"absent: {named(absent)} ({absent['workload']}): {absent['reason']}", markup=False)
    for line in aim_lines(results.get("aims", [])):
        console.print(line, markup=False, highlight=False)
    told = [f"{name} {value}" for name, value in results["versions"].items()]
    machine = results["machine"]
    told += [f"{machine['processor']}, {machine['system']}, threads: {machine['threads']} of {machine['cores']}"]
    console.print(", ".join(told), markup=False, highlight=False)


def named(row: Mapping[str, Any]) -> str:
    """Return engine, method and setting of a row."""
    return ", ".join(filter(None, key_of(row)))


def table(name: str, rows: list[dict[str, Any]]) -> Table:
    """Return the table of one workload: right answers by price, then the others, which have no rank."""
    times = {key_of(row): row["nanoseconds_per_configuration"] for row in rows if row["ranked"]}
    rivals = [rival for rival in RIVALS if rival in times]
    shown = Table(title=f"{name}: per {rows[0]['unit']}", title_justify="left")
    shown.add_column("engine, method, setting")
    for heading in ("time", "spread", *(f"/ {', '.join(rival[:2])}" for rival in rivals), "error", "error / allowed"):
        shown.add_column(heading, justify="right")
    shown.add_column("computes")
    shown.add_column("Newton by")
    for row in sorted(rows, key=lambda r: (not r["ranked"], r["nanoseconds_per_configuration"])):
        time = row["nanoseconds_per_configuration"]
        ratios = [ratio(time / times[rival]) if row["ranked"] else UNRANKED for rival in rivals]
        numbers = [duration(time), f"{row['spread']:.0%}", *ratios, *map(error, (row["max_error"], allowed(row)))]
        words = [", ".join(level[:3] for level in row["computes"]), row["newton_by"]]
        shown.add_row(*map(escape, (named(row), *numbers, *words)), style=None if row["ranked"] else "red")
    return shown


def aim_lines(aims: Iterable[dict[str, Any]]) -> list[str]:
    """Return what the run says of each aim."""
    found = []
    for aim in aims:
        word, bound = ("at most", aim["at_most"]) if "at_most" in aim else ("at least", aim["at_least"])
        measured = "not measured" if aim["measured"] is None else f"{aim['measured']:.3g}"
        verdict = "reached" if aim["reached"] else "MISSED"
        found.append(f"{verdict}: {aim['aim']}: {measured} ({word} {bound:g})")
    return found


def notes(rows: Iterable[dict[str, Any]]) -> list[str]:
    """Return what each method does, and of how much of the workload, where that is a part of it."""
    found = []
    for row in rows:
        judged = f"; judged {row['judged']:,}" if row["unit"] == "configuration" else ""
        without = f", no budget holds at {row['unjudged']} of the sample" if row["unjudged"] else ""
        found.append(f"  {named(row)}: {row['note']} (timed {row['timed']:,}{judged}{without})")
    return list(dict.fromkeys(found))


def claims(rows: Iterable[dict[str, Any]]) -> list[str]:
    """Return in words how this project's methods compare: with the same algorithm in C first."""
    ranked = sorted((row for row in rows if row["ranked"]), key=lambda row: len(row["computes"]))
    times = {key_of(row): row["nanoseconds_per_configuration"] for row in ranked}
    engines = {key: times[key] for key in times if key[0] not in OURS}
    found = []
    for ours in CLAIMED:
        if ours not in times:
            continue
        there = {what: times[rival] for rival, what in RIVALS.items() if rival in times}
        words = [f"{ratio(times[ours] / time)} times {what}" for what, time in there.items()]
        if engines:
            first = min(engines, key=lambda key: engines[key])
            words.append(f"{ratio(times[ours] / engines[first])} times {', '.join(first[:2])}, the fastest engine")
        if words:
            found.append(f"{', '.join(ours[:2])} takes {', '.join(words)}.")
    return found


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
