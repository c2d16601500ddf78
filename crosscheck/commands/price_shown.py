"""The price list on a terminal and as one object of data."""

from __future__ import annotations

import json
from collections.abc import Mapping
from pathlib import Path
from typing import Any

from rich.console import Console
from rich.table import Table

from crosscheck.commands.price_page import page
from crosscheck.engines.price_route import PRODUCERS
from crosscheck.measure.price import WITHIN, PriceList, price
from crosscheck.measure.price_rows import OURS, STEPS, cheapest
from refkin.model import Scene

SCHEMA = 1
WIDTH = 150
"""Columns of output that goes to no terminal."""


def to_json(found: PriceList) -> dict[str, Any]:
    """Return the price list as plain data."""
    return {
        "schema": SCHEMA,
        "scene": found.scene,
        "rows": [row.to_json() for row in found.rows],
        "cheapest": cheapest(found.rows),
        "cheapest_engine": cheapest(row for row in found.rows if row.engine not in OURS),
        "times": {"asked": found.asked, "priced": found.times, "certified": found.known},
        "refused": [{"engine": r.engine, "route": r.name, "reason": r.reason} for r in found.refused],
    }


def run(scene: Scene, as_json: bool, to_page: Path | None, within: float = WITHIN) -> None:
    """Measure and show the price list of a scene.

    Raises
    ------
    NoTruth
        If no pose of the scene is certified.
    """
    found = price(scene, tuple(PRODUCERS), within)
    told = to_json(found)
    if to_page is not None:
        to_page.write_text(page(told), encoding="utf-8")
    if as_json:
        print(json.dumps(told, allow_nan=False))
    else:
        _print(found, told)


def _print(found: PriceList, told: Mapping[str, Any]) -> None:
    console = Console(markup=False)
    if not console.is_terminal:
        console = Console(width=WIDTH, markup=False)
    console.print(cheapest_table(told["cheapest"], f"{found.scene}: the cheapest way to so many digits"))
    console.print(cheapest_table(told["cheapest_engine"], "The same among the engines alone"))
    console.print(routes_table(told["rows"], "Every route at its best: most digits, and what they cost"))
    for line in lines(told):
        console.print(line, highlight=False)


def lines(told: Mapping[str, Any]) -> list[str]:
    """Return what is to be said of a price list beside its rows."""
    times = told["times"]
    out = [f"{times['priced']} configurations; digits are the fewest over them, prices are per configuration"]
    if times["priced"] < times["asked"]:
        out.append(f"priced are the first {times['priced']} of the scene's {times['asked']} times")
    if times["certified"] < times["priced"]:
        out.append(f"{times['priced'] - times['certified']} of them have no certified truth and are left out")
    out += [f"{r['engine']}, {r['route']}: refused: {r['reason']}" for r in told["refused"]]
    silent = {(r["engine"], r["route"], r["knob"], r["note"]) for r in told["rows"] if r["digits"] is None}
    return out + [f"{engine}, {route}, {knob}: {note}" for engine, route, knob, note in sorted(silent)]


def cheapest_table(found: Mapping[str, Mapping[str, Mapping[str, Any] | None]], title: str) -> Table:
    """Return digits x quantity: who, how, for how many microseconds."""
    table = Table("digits", *found, title=title)
    for step in STEPS:
        cells = [_cell(for_quantity[str(step)]) for for_quantity in found.values()]
        table.add_row(str(step), *cells, end_section=True)
    return table


def _cell(row: Mapping[str, Any] | None) -> str:
    if row is None:
        return "nobody"
    return f"{row['microseconds']:.1f} us ({row['digits']:.1f} digits)\n{row['engine']}: {row['route']}, {row['knob']}"


def routes_table(rows: Any, title: str) -> Table:
    """Return for each route and quantity its setting of most digits."""
    table = Table("engine", "route", "Newton by", title=title)
    quantities = list(dict.fromkeys(row["quantity"] for row in rows))
    for quantity in quantities:
        table.add_column(f"{quantity}\ndigits", justify="right")
        table.add_column("us", justify="right")
    best: dict[tuple[str, str, str], dict[str, Any]] = {}
    for row in rows:
        cells = best.setdefault((row["engine"], row["route"], row["newton_by"]), {})
        if row["digits"] is not None and row["digits"] > cells.get(row["quantity"], {"digits": -1.0})["digits"]:
            cells[row["quantity"]] = row
    for name, cells in best.items():
        table.add_row(*name, *(text for q in quantities for text in _digits_and_price(cells.get(q))))
    return table


def _digits_and_price(row: Mapping[str, Any] | None) -> tuple[str, str]:
    if row is None:
        return "-", "-"
    return f"{row['digits']:.1f}", "-" if row["microseconds"] is None else f"{row['microseconds']:.1f}"
