"""The figures of the page, from the data of `report.json`: digits near singular poses, Newton histories."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any, NamedTuple

from markupsafe import Markup

from crosscheck.report.summary import SOLVED
from crosscheck.report.svg import Plot, Style, power_of_ten, style, swatch

Report = Mapping[str, Any]
LINES = {"digits_median": "median", "digits_worst": "worst"}
HIGHEST_DIGITS = 17.5
NO_ANSWER = Style("currentColor", "none", "cross")


@dataclass(frozen=True)
class Figure:
    """Panels side by side, what each series looks like, and the same numbers as a table."""

    panels: tuple[Markup, ...]
    legend: tuple[tuple[Markup, str], ...]
    head: tuple[str, ...]
    rows: tuple[tuple[Any, ...], ...]


class Bin(NamedTuple):
    """The samples of one quantity by one route in one decade of sigma_min."""

    name: tuple[str, str]
    quantity: str
    decade: int
    told: Mapping[str, Any]


def digits_figure(report: Report) -> Figure:
    """Return digits against sigma_min: per quantity, a line per engine and route, median above worst."""
    looks = {name: style(k) for k, name in enumerate((e, r) for e, routes in report["engines"].items() for r in routes)}
    bins, blanks = _bins(report), _blanks(report)
    lowest = min((b.told[line] for b in bins for line in LINES), default=0.0)
    floor = 4.0 if lowest >= 4 else min(0.0, math.floor(lowest))
    span = _decades([b.decade for b in bins] + [decade for _, decade in blanks])
    panels = [
        _digits_panel(quantity, line, [b for b in bins if b.quantity == quantity], blanks, span, floor, looks)
        for line in LINES
        for quantity in SOLVED
        if bins
    ]
    legend = [(swatch(look), " · ".join(name)) for name, look in looks.items()]
    legend += [(swatch(NO_ANSWER, line=False), "at the foot: some configurations without an answer")] if blanks else []
    head = ("engine · route", "quantity", "sigma min", "samples", "median", "1st percentile", "worst")
    keys = ("samples", "digits_median", "digits_p01", "digits_worst")
    rows = [(" · ".join(b.name), b.quantity, _range(b.decade), *(b.told[key] for key in keys)) for b in bins]
    return Figure(tuple(panels), tuple(legend), head, tuple(rows))


def _bins(report: Report) -> list[Bin]:
    """Return every bin that holds a sample."""
    return [
        Bin((engine, route), quantity, int(decade), told)
        for engine, routes in report["engines"].items()
        for route, quantities in routes.items()
        for quantity in SOLVED
        for decade, told in quantities[quantity]["digits_by_sigma"].items()
        if told["samples"]
    ]


def _blanks(report: Report) -> list[tuple[tuple[str, str], int]]:
    """Return ((engine, route), decade of a scene's smallest sigma_min) where configurations have no answer."""
    return [
        ((row["engine"], row["route"]), int(decade))
        for row in report["routes"]
        for decade in row["unanswered_by_sigma"]
    ]


def _decades(found: Sequence[int]) -> tuple[int, int]:
    """Return the decades to show: those that were met, at least four."""
    high = max(found, default=0) + 1
    return min(min(found, default=0), high - 4), high


def _digits_panel(
    quantity: str,
    line: str,
    bins: Sequence[Bin],
    blanks: Sequence[tuple[tuple[str, str], int]],
    span: tuple[int, int],
    floor: float,
    looks: Mapping[tuple[str, str], Style],
) -> Markup:
    title = f"{quantity.capitalize()}: {LINES[line]} digits"
    description = f"{title} per decade of sigma min, by engine and route"
    plot = Plot(f"digits-{quantity}-{LINES[line]}", title, description, span, (floor, HIGHEST_DIGITS))
    every = 2 if span[1] - span[0] > 8 else 1
    x_ticks = [(float(d), power_of_ten(d)) for d in range(span[1], span[0] - 1, -every)]
    y_ticks = [(float(v), str(v)) for v in range(4 * math.ceil(floor / 4), 17, 4)]
    plot.axes(x_ticks, y_ticks, "sigma min · nearer to singular on the left")
    for k, (name, look) in enumerate(looks.items()):
        # Engines agree to the digit in most bins: each stands a little beside the others, inside its decade.
        aside = 0.5 + 0.5 * ((k + 0.5) / len(looks) - 0.5)
        plot.series([(b.decade + aside, b.told[line]) for b in bins if b.name == name], look)
        unanswered = [decade for who, decade in blanks if who == name and line == "digits_worst"]
        for decade in unanswered:
            foot = floor + 0.04 * (HIGHEST_DIGITS - floor)
            plot.series([(decade + aside, foot)], Style(look.colour, "none", "cross"))
    if not bins:
        plot.text(plot.px(sum(span) / 2), plot.py((floor + HIGHEST_DIGITS) / 2), "no answer", size="13")
    return plot.markup()


def _range(decade: int) -> str:
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
