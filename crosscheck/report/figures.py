"""The figures of the page, from the data of `report.json`: curves of digits, convergence and trends, and agreement."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any, NamedTuple

from markupsafe import Markup

from crosscheck.judge.records import QUANTITIES as SOLVED
from crosscheck.report.svg import BAND, Mark, Plot, Style, power_of_ten, style, swatch
from crosscheck.report.wording import number

Report = Mapping[str, Any]
LINES = {"digits_worst": "worst", "digits_median": "median"}
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
    """The samples of one quantity by one method in one decade of sigma_min."""

    name: tuple[str, str]
    quantity: str
    decade: int
    digits: Mapping[str, Any]


def looks_of(report: Report) -> dict[tuple[str, str], Style]:
    """Return what each engine and method looks like in every figure of the page."""
    named = ((engine, method) for engine, methods in report["engines"].items() for method in methods)
    return {name: style(k) for k, name in enumerate(named)}


def digits_figure(report: Report, line: str = "digits_worst") -> Figure:
    """Return digits against sigma_min: a panel per quantity, a line per method, the band that rounding leaves.

    `line` is what is drawn: "digits_worst", whose marks have a picture each, or "digits_median".
    """
    looks = looks_of(report)
    bins = _bins(report)
    # Decades of a scene's smallest sigma_min where configurations have no answer.
    blanks = [((m["engine"], m["method"]), int(x)) for m in report["methods"] for x in m["unanswered_by_sigma"]]
    lowest = min((b.digits[line] for b in bins), default=0.0)
    floor = 4.0 if lowest >= 4 else min(0.0, math.floor(lowest))
    span = _decades([b.decade for b in bins] + [decade for _, decade in blanks])
    marks = report["poses"]["marks"] if line == "digits_worst" else ()
    pictures = {(m["engine"], m["method"], m["quantity"], m["decade"]): k for k, m in enumerate(marks)}
    panels = []
    for quantity in SOLVED if bins else ():
        plot = _digits_axes(quantity, line, span, floor)
        _rounding_band(plot, report["rounding"].get(quantity, {}), floor)
        for k, (name, look) in enumerate(looks.items()):
            # Engines agree to the digit in most bins: each stands a little beside the others, inside its decade.
            aside = 0.5 + 0.6 * ((k + 0.5) / len(looks) - 0.5)
            of_line = [b for b in bins if b.quantity == quantity and b.name == name]
            shown = [
                Mark(b.decade + aside, b.digits[line], _spoken(b, line), pictures.get((*name, quantity, b.decade)))
                for b in of_line
            ]
            plot.marks(shown, look)
            if line == "digits_worst":
                foot = floor + 0.04 * (HIGHEST_DIGITS - floor)
                for decade in (decade for who, decade in blanks if who == name):
                    plot.series([(decade + aside, foot)], Style(look.colour, "none", "cross"))
        if not any(b.quantity == quantity for b in bins):
            plot.text(plot.px(sum(span) / 2), plot.py((floor + HIGHEST_DIGITS) / 2), "no answer", size="13")
        panels.append(plot.markup())
    legend = [(swatch(look), " · ".join(name)) for name, look in looks.items()]
    if any(report["rounding"].values()):
        legend.append((BAND, "rounding leaves (bound), 1 % to median"))
    if blanks and line == "digits_worst":
        legend.append((swatch(NO_ANSWER, line=False), "at the foot: no answer"))
    numbers = {"median": "digits_median", "1st percentile": "digits_p01", "worst": "digits_worst"}
    head = ("engine · method", "quantity", "sigma min", "samples", *numbers, "rounding leaves, median")
    rows = []
    for b in bins:
        left = report["rounding"].get(b.quantity, {}).get(str(b.decade), {}).get("digits_median")
        shown_digits = (b.digits["samples"], *map(b.digits.get, numbers.values()))
        rows.append((" · ".join(b.name), b.quantity, _range(b.decade), *shown_digits, left))
    return Figure(tuple(panels), tuple(legend), head, tuple(rows))


def _spoken(b: Bin, line: str) -> str:
    """Return what a mark says to whoever cannot see it."""
    where = f"{' · '.join(b.name)}: {b.quantity}, sigma min {_range(b.decade)}"
    return f"{where}: {LINES[line]} {b.digits[line]:.1f} digits of {b.digits['samples']} samples"


def _digits_axes(quantity: str, line: str, span: tuple[int, int], floor: float) -> Plot:
    title = f"{quantity.capitalize()}: {LINES[line]} digits"
    plot = Plot(
        f"{line.replace('_', '-')}-{quantity}",
        title,
        f"{title} per decade of sigma min, by engine and method",
        span,
        (floor, HIGHEST_DIGITS),
        width=300,
        height=226,
        left=30,
        role="group",
    )
    every = -(-(span[1] - span[0]) // 5)
    x_ticks = [(float(d), power_of_ten(d)) for d in range(span[1], span[0] - 1, -every)]
    y_ticks = [(float(v), str(v)) for v in range(4 * math.ceil(floor / 4), 17, 4)]
    plot.axes(x_ticks, y_ticks, "← nearer to singular · sigma min")
    return plot


def _rounding_band(plot: Plot, band: Mapping[str, Any], floor: float) -> None:
    """Shade, decade by decade, from what rounding leaves to one sample in a hundred to what to the median one.

    The very worst is that of a rate that passes through zero, where no relative error says anything.
    """
    edges = sorted((int(d), max(v["digits_p01"], floor), v["digits_median"]) for d, v in band.items() if v["samples"])
    x = [edge for decade, _, _ in edges for edge in (decade, decade + 1)]
    low, high = ([v for edge in edges for v in (edge[k], edge[k])] for k in (1, 2))
    shown = [k for k, v in enumerate(x) if plot.x[0] <= v <= plot.x[1]]
    if shown:
        plot.band([x[k] for k in shown], [low[k] for k in shown], [high[k] for k in shown])


def _bins(report: Report) -> list[Bin]:
    return [
        Bin((engine, method), quantity, int(decade), digits)
        for engine, methods in report["engines"].items()
        for method, quantities in methods.items()
        for quantity in SOLVED
        for decade, digits in quantities[quantity]["digits_by_sigma"].items()
        if digits["samples"]
    ]


def _decades(decades: Sequence[int]) -> tuple[int, int]:
    """Return the decades to show: those that were met, at least four."""
    high = max(decades, default=0) + 1
    return min(min(decades, default=0), high - 4), high


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
    plot.series([(i, _log(v, LOWEST, HIGHEST)) for i, v in enumerate(history["residual"])], RESIDUAL)
    plot.series([(i + 1, _log(v, LOWEST, HIGHEST)) for i, v in enumerate(history["correction"])], CORRECTION)
    return plot.markup()


def _log(value: float, lowest: int, highest: float = math.inf) -> float:
    return min(max(math.log10(value), lowest), highest) if value > 0 else float(lowest)


EXACT = -17
"""Decade of a slope's figure on which an exact zero stands."""
ALARM = Style("#D55E00", "none", "diamond")


def slopes_figure(lines: Sequence[Mapping[str, Any]]) -> Figure:
    """Return one log-log panel per abscissa, a line per method with its fitted slope in the legend."""
    looks = {line["name"]: style(k + 1) for k, line in enumerate(lines)}
    panels = [
        _log_panel(f"slopes-{k}", over, [line for line in lines if line["over"] == over], looks)
        for k, over in enumerate(dict.fromkeys(line["over"] for line in lines))
    ]
    legend = tuple((swatch(looks[line["name"]]), _slope_label(line)) for line in lines)
    rows = tuple((line["name"], x, y) for line in lines for x, y in zip(line["x"], line["y"], strict=True))
    return Figure(tuple(panels), legend, ("line", "abscissa", "value"), rows)


def _slope_label(line: Mapping[str, Any]) -> str:
    if line["fitted"] is None:
        return f"{line['name']}: {'exact to round-off at small steps' if line['expected'] is None else 'inconclusive'}"
    spread = f"± {line['spread']:.3f}"
    return f"{line['name']}: slope {line['fitted']:.3f} {spread}, on paper {line['expected']:g}"


def _log_panel(ident: str, over: str, lines: Sequence[Mapping[str, Any]], looks: Mapping[str, Style]) -> Any:
    x = [math.log10(v) for line in lines for v in line["x"]]
    y = [_log(v, EXACT) for line in lines for v in line["y"]]
    title = "Error of the Jacobian" if over == "step" else lines[0]["name"].capitalize()
    span = (math.floor(min(x)), math.ceil(max(x)))
    plot = Plot(
        ident, title, f"{title} over {over}, both logarithmic", span, (math.floor(min(y)), math.ceil(max(y)) + 0.5)
    )
    x_ticks = [(float(d), power_of_ten(d)) for d in range(span[0], span[1] + 1, 2)]
    y_ticks = [(float(d), power_of_ten(d)) for d in range(math.ceil(max(y)), math.floor(min(y)) - 1, -4)]
    plot.axes(x_ticks, y_ticks, over)
    for line in lines:
        placed = [(math.log10(a), _log(b, EXACT)) for a, b in zip(line["x"], line["y"], strict=True)]
        plot.series(placed, looks[line["name"]])
    return plot.markup()


def agreement_matrices(rows: Sequence[Mapping[str, Any]]) -> list[dict[str, Any]]:
    """Return a table per quantity: who x who -> (median, worst) digits; None for oneself and where two never met."""
    names = list(dict.fromkeys(n for row in rows for n in zip(row["engines"], row["methods"], strict=True)))
    tables = []
    for quantity in SOLVED:
        known = {}
        for row in rows:
            a, b = zip(row["engines"], row["methods"], strict=True)
            agreement = row[quantity]
            met = (agreement["digits_median"], agreement["digits_worst"]) if agreement["scenes"] else None
            known[a, b] = known[b, a] = met
        lines = [(" · ".join(a), [known.get((a, b)) for b in names]) for a in names]
        tables.append({"quantity": quantity, "names": [" · ".join(n) for n in names], "lines": lines})
    return tables


def trends_figure(series: Sequence[Mapping[str, Any]]) -> Figure:
    """Return a small panel per series over nights; where its level changed, a mark says by how much."""
    shown = [one for one in series if len(one["values"]) > 1]
    panels = [_trend_panel(f"trend-{k}", one) for k, one in enumerate(shown)]
    legend = (
        (swatch(Style("#0072B2", "none", "circle")), "time / that of refkin, per night"),
        (swatch(ALARM, line=False), "the level changed (a warning)"),
    )
    rows = tuple(
        (one["name"], night, value, "changed" if str(k) in one["changes"] else "")
        for one in series
        for k, (night, value) in enumerate(zip(one["nights"], one["values"], strict=True))
    )
    return Figure(tuple(panels), legend, ("series", "night", "ratio", ""), rows)


def _trend_panel(ident: str, one: Mapping[str, Any]) -> Any:
    values = one["values"]
    top = max(values) * 1.15 or 1.0
    span = (0.0, float(max(len(values) - 1, 1)))
    text = f"{one['name']}: time relative to refkin over {len(values)} nights"
    plot = Plot(
        ident, one["name"], text, span, (0.0, top), width=300, height=140, left=40, right=34, bottom=30, role="group"
    )
    plot.axes([(0.0, one["nights"][0][:10]), (span[1], one["nights"][-1][:10])], [(0.0, "0"), (top, f"{top:.2g}")], "")
    look = Style("#0072B2", "none", "circle")
    plot.series([(float(k), v) for k, v in enumerate(values)], look)
    for k, factor in one["changes"].items():
        label = f"{one['name']}: changed on {one['nights'][int(k)]} by a factor {number(factor)}"
        plot.marks([Mark(float(k), values[int(k)], label)], ALARM)
    return plot.markup()
