"""Further figures: orders of convergence, agreement between engines, trends over nights."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from typing import Any

from crosscheck.report.figures import Figure
from crosscheck.report.svg import Mark, Plot, Style, power_of_ten, style, swatch
from crosscheck.report.wording import number

LOWEST = -17
"""Decade on which an exact zero stands."""
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
        return f"{line['name']}: {'no slope: exact to round-off' if line['expected'] is None else 'inconclusive'}"
    spread = f"± {line['spread']:.3f}"
    return f"{line['name']}: slope {line['fitted']:.3f} {spread}, on paper {line['expected']:g}"


def _log_panel(ident: str, over: str, lines: Sequence[Mapping[str, Any]], looks: Mapping[str, Style]) -> Any:
    x = [math.log10(v) for line in lines for v in line["x"]]
    y = [_log(v) for line in lines for v in line["y"]]
    title = "Error of the Jacobian" if over == "step" else lines[0]["name"].capitalize()
    span = (math.floor(min(x)), math.ceil(max(x)))
    plot = Plot(
        ident, title, f"{title} over {over}, both logarithmic", span, (math.floor(min(y)), math.ceil(max(y)) + 0.5)
    )
    x_ticks = [(float(d), power_of_ten(d)) for d in range(span[0], span[1] + 1, 2)]
    y_ticks = [(float(d), power_of_ten(d)) for d in range(math.ceil(max(y)), math.floor(min(y)) - 1, -4)]
    plot.axes(x_ticks, y_ticks, over)
    for line in lines:
        placed = [(math.log10(a), _log(b)) for a, b in zip(line["x"], line["y"], strict=True)]
        plot.series(placed, looks[line["name"]])
    return plot.markup()


def _log(value: float) -> float:
    return max(math.log10(value), LOWEST) if value > 0 else float(LOWEST)


def agreement_matrices(rows: Sequence[Mapping[str, Any]]) -> list[dict[str, Any]]:
    """Return a table per quantity: who x who -> (median, worst) digits; None for oneself and where two never met."""
    names = list(dict.fromkeys(n for row in rows for n in zip(row["engines"], row["routes"], strict=True)))
    tables = []
    for quantity in ("position", "velocity", "acceleration"):
        known = {}
        for row in rows:
            a, b = zip(row["engines"], row["routes"], strict=True)
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
        ident,
        one["name"],
        text,
        span,
        (0.0, top),
        width=300,
        height=140,
        left=40,
        right=34,
        bottom=30,
        role="group",
    )
    plot.axes([(0.0, one["nights"][0][:10]), (span[1], one["nights"][-1][:10])], [(0.0, "0"), (top, f"{top:.2g}")], "")
    look = Style("#0072B2", "none", "circle")
    plot.series([(float(k), v) for k, v in enumerate(values)], look)
    for k, factor in one["changes"].items():
        label = f"{one['name']}: changed on {one['nights'][int(k)]} by a factor {number(factor)}"
        plot.marks([Mark(float(k), values[int(k)], label)], ALARM)
    return plot.markup()
