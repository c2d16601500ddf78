"""`crosscheck mutants`: the unharmed run first, then each mutant with the check that kills it."""

from __future__ import annotations

import json
import sys
import time
from collections.abc import Sequence
from typing import Any

from rich.console import Console
from rich.markup import escape
from rich.table import Table

from crosscheck.mutants import Mutant, Outcome, mutants, try_all, unharmed
from crosscheck.mutation import DoesNotFit


def run(words: Sequence[str], as_json: bool) -> int:
    """Try the mutants that one of the words fits, all by default, and print what became of them.

    Returns
    -------
    int
        0 if all are killed; 1 if one survives, or if a check is red without any mutant; 2 if the words fit no mutant,
        or a mutant no longer fits the code.
    """
    try:
        chosen = [
            m for m in mutants() if not words or any(word in (m.row, m.target) or word in m.label for word in words)
        ]
    except (DoesNotFit, ValueError) as error:
        print(error, file=sys.stderr)
        return 2
    if not chosen:
        print(f"no mutant has any of these in its label, row or target: {', '.join(words)}", file=sys.stderr)
        return 2
    start = time.perf_counter()
    red = unharmed()
    outcomes = [] if red else list(try_all(chosen))
    seconds = time.perf_counter() - start
    if as_json:
        print(json.dumps(plain(red, outcomes, seconds)))
    else:
        _print(Console(width=None if sys.stdout.isatty() else 200), red, outcomes, seconds)
    return int(bool(red) or any(o.killed_by is None for o in outcomes))


def plain(red: dict[str, str], outcomes: Sequence[Outcome], seconds: float) -> dict[str, Any]:
    """Return the run as data."""
    return {
        "schema": 1,
        "red_without_a_mutant": red,
        "mutants": [
            {**_mutant(o.mutant), "killed_by": o.killed_by, "how": o.how, "seconds": o.seconds} for o in outcomes
        ],
        "survived": sum(o.killed_by is None for o in outcomes),
        "seconds": seconds,
    }


def _mutant(m: Mutant) -> dict[str, str]:
    return {key: getattr(m, key) for key in ("label", "row", "target", "old", "new")}


def _print(console: Console, red: dict[str, str], outcomes: Sequence[Outcome], seconds: float) -> None:
    for name, why in red.items():
        console.print(f"red without any mutant: {name}: {why}", markup=False)
    if red:
        console.print("nothing was tried: a check that is red on its own kills nothing", markup=False)
        return
    console.print("without any mutant every check is green", markup=False)
    table = Table("mutant", "row", "replaces", "killed by")
    for o in outcomes:
        m = o.mutant
        passage = f"{m.target}\n{m.old.strip()}  ->  {m.new.strip()}"
        table.add_row(escape(m.label), m.row, escape(passage), o.killed_by or "[red]SURVIVED[/]")
    console.print(table)
    killers = {o.killed_by for o in outcomes if o.killed_by}
    alive = sum(o.killed_by is None for o in outcomes)
    told = f"{len(outcomes)} mutants, {alive} survived; {len(killers)} different checks killed; {seconds:.0f} s"
    console.print(told, markup=False)
