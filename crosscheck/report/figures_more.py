"""Further figures: orders of convergence, agreement between engines, trends over nights, what effects cost."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from itertools import accumulate
from typing import Any

from markupsafe import Markup

from crosscheck.judge.prices import EffectRow
from crosscheck.report.figures import Figure
from crosscheck.report.svg import COLOURS, Mark, Plot, Style, power_of_ten, style, swatch
from crosscheck.report.wording import filled, number
from crosscheck.scenes.names import PHYSICAL, QUANTITIES

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
    names = list(dict.fromkeys(n for row in rows for n in zip(row["engines"], row["methods"], strict=True)))
    tables = []
    for quantity in QUANTITIES:
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


POSITION = "position"
CALLED_FOR = (POSITION, "velocity", "acceleration", "points", "condition", "certificate", "other bodies")
"""What a scene may call for, in the order of its colours; what it never does has them in the order of `PHYSICAL`."""
OPACITIES = ("1", "0.55", "0.2")
"""Of what a scene may call for, of what it never does, and of that again when the colours are used up."""
LEFT, ROOM = 178, 554
"""The room for the name of a bar, and for the longest bar [pixels]."""
Part = tuple[str, float, bool]


def parts(rows: Sequence[EffectRow]) -> dict[tuple[str, str], list[Part]]:
    """Return per engine and method the parts of its bar: effect, microseconds, and whether a scene may call for it.

    The first is position alone. What is noise is no part of a bar.
    """
    bars: dict[tuple[str, str], list[Part]] = {}
    for row in rows:
        if row.microseconds is None or row.without is None:
            continue
        of_method = bars.setdefault((row.engine, row.method), [])
        if not of_method:
            of_method.append((POSITION, row.without, True))
        if not row.within_noise:
            of_method.append((row.effect, row.microseconds, row.called_for))
    return bars


def effects_bars(rows: Sequence[EffectRow]) -> Markup:
    """Return the stacked bars of a ledger as SVG; each part carries its name and its price as a title."""
    bars = parts(rows)
    longest = max((sum(cost for _, cost, _ in bar) for bar in bars.values()), default=1.0)
    step = _step(longest)
    top = step * math.ceil(longest / step)
    names = {effect: called_for for bar in bars.values() for effect, _, called_for in bar}

    def px(x: float) -> float:
        return LEFT + x / top * ROOM

    ends = [[px(x) for x in accumulate((cost for _, cost, _ in bar), initial=0.0)] for bar in bars.values()]
    ticks = [(px(step * k), f"{step * k:g}") for k in range(round(top / step) + 1)]
    known: Any = {"bars": bars, "ends": ends, "names": names, "ticks": ticks, "left": LEFT, "look": look}
    return Markup(filled("bars.html.j2", **known))


def look(effect: str) -> tuple[str, str]:
    """Return colour and opacity of an effect, the same in every figure; those that nobody knows share one."""
    if effect in CALLED_FOR:
        return COLOURS[CALLED_FOR.index(effect)], OPACITIES[0]
    again, k = divmod(PHYSICAL.index(effect) if effect in PHYSICAL else len(PHYSICAL), len(COLOURS))
    return COLOURS[k], OPACITIES[1 + again]


def _step(longest: float) -> float:
    """Return the distance of ticks: 1, 2 or 5 times a power of ten, at most six of them."""
    power = 10.0 ** math.floor(math.log10(longest / 6)) if longest > 0 else 1.0
    return next(factor * power for factor in (1.0, 2.0, 5.0, 10.0) if factor * power * 6 >= longest)
