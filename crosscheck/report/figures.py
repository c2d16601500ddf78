"""The figures of the page, from the data of `report.json`: digits against distance to the singularity, Newton histories."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

from markupsafe import Markup

from crosscheck.report.summary import SOLVED
from crosscheck.report.svg import Plot, Style, power_of_ten, style, swatch

Report = Mapping[str, Any]
LINES = {"digits_median": "median", "digits_worst": "worst"}
NO_ANSWER = Style("#D55E00", "none", "cross")


@dataclass(frozen=True)
class Figure:
    """Panels side by side, what each series looks like, and the same numbers as a table."""

    panels: tuple[Markup, ...]
    legend: tuple[tuple[Markup, str], ...]
    head: tuple[str, ...]
    rows: tuple[tuple[Any, ...], ...]


def digits_figure(report: Report) -> Figure:
    """Return digits against sigma_min: per quantity, a line per engine and route, median above worst."""
    names = [(engine, route) for engine, routes in report["engines"].items() for route in routes]
    looks = {name: style(k) for k, name in enumerate(names)}
    samples = _samples(report)
    blanks = _blanks(report)
    decades = [row[3] for row in samples] + [decade for _, decade, _ in blanks]
    values = [row[5][line] for row in samples for line in LINES]
    span = _decades(decades)
    floor = min(0 if min(values, default=0) < 4 else 4, math.floor(min(values, default=0)))
    panels = [
        _digits_panel(samples, blanks, quantity, line, span, (floor, 17.5), looks)
        for line in LINES
        for quantity in SOLVED
    ]
    legend = [(swatch(look), f"{engine} · {route}") for (engine, route), look in looks.items()]
    legend += [(swatch(NO_ANSWER), "some configurations without an answer")] if blanks else []
    rows = [
        (f"{engine} · {route}", quantity, _bin(decade), count, *(told[k] for k in ("digits_median", "digits_p01", "digits_worst")))
        for engine, route, quantity, decade, count, told in samples
    ]
    head = ("engine · route", "quantity", "sigma min", "samples", "median", "1st percentile", "worst")
    return Figure(tuple(panels), tuple(legend), head, tuple(rows))


def _samples(report: Report) -> list[tuple[str, str, str, int, int, Mapping[str, float]]]:
    """Return (engine, route, quantity, decade, samples, digits) of every bin that holds something."""
    return [
        (engine, route, quantity, int(decade), told["samples"], told)
        for engine, routes in report["engines"].items()
        for route, quantities in routes.items()
        for quantity in SOLVED
        for decade, told in quantities[quantity]["digits_by_sigma"].items()
        if told["samples"]
    ]


def _blanks(report: Report) -> list[tuple[tuple[str, str], int, int]]:
    """Return ((engine, route), decade of the scene's smallest sigma_min, configurations without an answer)."""
    return [
        ((row["engine"], row["route"]), int(decade), count)
        for row in report["routes"]
        for decade, count in row["unanswered_by_sigma"].items()
    ]


def _decades(found: Sequence[int]) -> tuple[int, int]:
    """Return the decades to show: those that were met, at least four."""
    high = max(found, default=0) + 1
    return min(min(found, default=0), high - 4), high


def _digits_panel(
    samples: Sequence[tuple[Any, ...]],
    blanks: Sequence[tuple[tuple[str, str], int, int]],
    quantity: str,
    line: str,
    span: tuple[int, int],
    y: tuple[float, float],
    looks: Mapping[tuple[str, str], Style],
) -> Markup:
    title = f"{quantity.capitalize()}: {LINES[line]} digits"
    plot = Plot(f"digits-{quantity}-{LINES[line]}", title, f"{title} per decade of sigma min, by engine and route", span, y)
    every = 2 if span[1] - span[0] > 8 else 1
    x_ticks = [(float(d), power_of_ten(d)) for d in range(span[1], span[0] - 1, -every)]
    first = 4 * math.ceil(y[0] / 4)
    plot.axes(x_ticks, [(v, str(v)) for v in range(first, 17, 4)], "← nearer to singular        sigma min")
    for k, (name, look) in enumerate(looks.items()):
        # Engines agree to the digit in most bins: each stands a little beside the others, inside its decade.
        aside = 0.5 + 0.5 * ((k + 0.5) / len(looks) - 0.5)
        mine = [row for row in samples if row[:3] == (*name, quantity)]
        plot.series([(row[3] + aside, row[5][line]) for row in mine], look)
        for who, decade, _ in blanks:
            if who == name and line == "digits_worst":
                plot.series([(decade + aside, y[0] + 0.04 * (y[1] - y[0]))], Style(look.colour, "none", "cross"))
    return plot.markup()


def _bin(decade: int) -> str:
    return f"{power_of_ten(decade)} to {power_of_ten(decade + 1)}"


RESIDUAL, CORRECTION = Style("#0072B2", "none", "circle"), Style("#D55E00", "6 3", "square")
LOWEST, HIGHEST = -18, 1
"""Decades that are shown of a history; an exact zero stands on the lowest line."""


def newton_figure(report: Report) -> Figure:
    """Return residual and correction per iteration, one panel per solve."""
    histories = report["newton_histories"]
    panels = [_newton_panel(k, history) for k, history in enumerate(histories)]
    legend = [(swatch(RESIDUAL), "residual, largest component"), (swatch(CORRECTION), "correction, largest component")]
    rows = []
    for history in histories:
        corrections = [None, *history["correction"]]
        ratios = [None, None, *history["correction_ratio"]]
        for k, residual in enumerate(history["residual"]):
            rows.append((history["name"], k, residual, corrections[k], ratios[k] if k < len(ratios) else None))
    head = ("solve", "iteration", "residual", "correction", "correction / the one before")
    return Figure(tuple(panels), tuple(legend), head, tuple(rows))


def _newton_panel(k: int, history: Mapping[str, Any]) -> Markup:
    count = history["iterations"]
    plot = Plot(
        f"newton-{k}",
        history["name"].capitalize(),
        f"Largest component of residual and correction in {count} iterations; {history['status']}",
        (0, max(count, 1)),
        (LOWEST, HIGHEST),
    )
    every = max(1, math.ceil(count / 6))
    y_ticks = [(float(d), power_of_ten(d)) for d in range(0, LOWEST, -4)]
    plot.axes([(float(i), str(i)) for i in range(0, count + 1, every)], y_ticks, "iteration")
    plot.series([(i, _log(v)) for i, v in enumerate(history["residual"])], RESIDUAL)
    plot.series([(i + 1, _log(v)) for i, v in enumerate(history["correction"])], CORRECTION)
    return plot.markup()


def _log(value: float) -> float:
    return min(max(math.log10(value), LOWEST), HIGHEST) if value > 0 else float(LOWEST)
