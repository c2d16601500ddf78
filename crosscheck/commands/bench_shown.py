"""The benchmark for a person: one table for each work, with the fairest rivals first, and what it comes to in words."""

from __future__ import annotations

from collections.abc import Iterable
from itertools import groupby
from typing import Any

from rich.console import Console
from rich.markup import escape
from rich.table import Table

from crosscheck.measure.bench_aims import ENGINES

RIVALS = ("c-same-tape", "c-dense")
"""The rivals that every claim names first: the same algorithm in C, then what a person would write in C."""
OURS = ("refkin-lanes", "refkin-sparse")
UNRANKED = "not ranked"


def print_results(results: dict[str, Any], console: Console) -> None:
    """Print all works, then what was absent, and on what it was measured."""
    for name, rows in groupby(results["rows"], key=lambda row: row["work"]):
        of_work = list(rows)
        console.print(table(name, of_work))
        for line in (*claims(of_work), *notes(of_work)):
            console.print(line, markup=False, highlight=False)
        console.print()
    for absent in results["absent"]:
        console.print(f"absent: {absent['route']} ({absent['work']}): {absent['reason']}", markup=False)
    for line in aim_lines(results.get("aims", [])):
        console.print(line, markup=False, highlight=False)
    told = [f"{name} {value}" for name, value in results["versions"].items()]
    machine = results["machine"]
    told += [f"{machine['processor']}, {machine['system']}, threads: {machine['threads']} of {machine['cores']}"]
    console.print(", ".join(told), markup=False, highlight=False)


def table(name: str, rows: list[dict[str, Any]]) -> Table:
    """Return the table of one work: right answers by price, then the others, which have no rank."""
    times = {row["route"]: row["nanoseconds_per_configuration"] for row in rows if row["ranked"]}
    rivals = [rival for rival in RIVALS if rival in times]
    shown = Table(title=f"{name}: per {rows[0]['unit']}", title_justify="left")
    shown.add_column("route", no_wrap=True)
    for heading in ("time", "spread", *(f"/ {rival}" for rival in rivals), "error", "error / allowed"):
        shown.add_column(heading, justify="right", no_wrap=True)
    shown.add_column("computes")
    shown.add_column("loop driven by")
    for row in sorted(rows, key=lambda r: (not r["ranked"], r["nanoseconds_per_configuration"])):
        time = row["nanoseconds_per_configuration"]
        ratios = [ratio(time / times[rival]) if row["ranked"] else UNRANKED for rival in rivals]
        numbers = [duration(time), f"{row['spread']:.0%}", *ratios, *map(error, (row["max_error"], allowed(row)))]
        words = [", ".join(level[:3] for level in row["computes"]), row["driven_by"]]
        shown.add_row(*map(escape, (row["route"], *numbers, *words)), style=None if row["ranked"] else "red")
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
    """Return what each route does, and of how much of the work, where that is a part of it."""
    found = []
    for row in rows:
        judged = f"; judged {row['judged']:,}" if row["unit"] == "configuration" else ""
        without = f", no budget holds at {row['unjudged']} of the sample" if row["unjudged"] else ""
        found.append(f"  {row['route']}: {row['what']} (timed {row['timed']:,}{judged}{without})")
    return found


def claims(rows: Iterable[dict[str, Any]]) -> list[str]:
    """Return in words how this project's routes compare: with the same algorithm in C first."""
    ranked = {row["route"]: row for row in rows if row["ranked"]}
    times = {name: row["nanoseconds_per_configuration"] for name, row in ranked.items()}
    engines = {name: times[name] for name in ENGINES if name in times}
    found = []
    for ours in OURS:
        if ours not in times:
            continue
        words = [f"{ratio(times[ours] / times[rival])} times {_what(rival)}" for rival in RIVALS if rival in times]
        if engines:
            first = min(engines, key=lambda name: engines[name])
            words.append(f"{ratio(times[ours] / engines[first])} times {first}, the fastest engine route")
        if words:
            found.append(f"{ours} takes {', '.join(words)}.")
    return found


def _what(rival: str) -> str:
    return {"c-same-tape": "the same operations compiled as C", "c-dense": "dense Newton in C"}[rival]


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
