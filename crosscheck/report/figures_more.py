"""Further figures: orders of convergence, agreement between engines, trends over nights, what effects cost."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from typing import Any
from xml.etree import ElementTree as ET

from markupsafe import Markup

from crosscheck.judge.prices import EffectRow
from crosscheck.report.figures import Figure
from crosscheck.report.svg import COLOURS, Mark, Plot, Style, power_of_ten, style, swatch
from crosscheck.report.wording import number
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
BAR, LEFT = 18, 178
"""Height of a bar, and the room for its name [pixels]."""
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
    names = list(dict.fromkeys(effect for bar in bars.values() for effect, _, _ in bar))
    described = "; ".join(f"{engine}, {method}: {_words(bar)}" for (engine, method), bar in bars.items())
    plot = Plot(
        "effects-bars",
        "What effects cost",
        f"Microseconds per configuration, stacked. {described}",
        (0.0, top),
        (0.0, float(max(len(bars), 1))),
        width=744,
        height=76 + (BAR + 10) * len(bars) + 20 * math.ceil(len(names) / 5),
        left=LEFT,
        bottom=46 + 20 * math.ceil(len(names) / 5),
    )
    for k, ((engine, method), bar) in enumerate(bars.items()):
        y = plot.py(len(bars) - k - 0.5) - BAR / 2
        plot.text(LEFT - 8, y + 13, f"{engine}, {method}", anchor="end")
        _bar(plot, bar, y)
    ticks = [(step * k, f"{step * k:g}") for k in range(round(top / step) + 1)]
    floor = plot.height - plot.bottom
    for x, label in ticks:
        plot.line([(plot.px(x), plot.top), (plot.px(x), floor)], stroke="currentColor", opacity="0.14")
        plot.text(plot.px(x), floor + 16, label)
    plot.text((plot.px(0.0) + plot.px(top)) / 2, floor + 34, "microseconds per configuration")
    _legend(plot, names, {effect: called for bar in bars.values() for effect, _, called in bar}, floor + 52)
    return plot.markup()


def _bar(plot: Plot, bar: Sequence[Part], y: float) -> None:
    start = 0.0
    for effect, cost, called_for in bar:
        x, width = plot.px(start), plot.px(start + cost) - plot.px(start)
        box = _box(plot.root, x, y, max(width, 0.5), BAR, *look(effect), called_for)
        ET.SubElement(box, "title").text = f"{effect}: {cost:.1f} microseconds"
        start += cost


def _box(
    parent: ET.Element, x: float, y: float, width: float, height: float, colour: str, opacity: str, called_for: bool
) -> ET.Element:
    place = {"x": f"{x:.1f}", "y": f"{y:.1f}", "width": f"{width:.1f}", "height": f"{height:.1f}"}
    drawn = {"fill": colour, "fill-opacity": opacity, "stroke": "currentColor", "stroke-width": "0.5"}
    dash = {} if called_for else {"stroke-dasharray": "2 2"}
    return ET.SubElement(parent, "rect", {**place, **drawn, **dash})


def _legend(plot: Plot, names: Sequence[str], called_for: dict[str, bool], y: float) -> None:
    for k, name in enumerate(names):
        x, row = plot.left - 100 + 128 * (k % 5), y + 20 * (k // 5)
        _box(plot.root, x, row - 9, 12, 10, *look(name), called_for[name])
        plot.text(x + 18, row, name, anchor="start")


def look(effect: str) -> tuple[str, str]:
    """Return colour and opacity of an effect, the same in every figure; those that nobody knows share one."""
    if effect in CALLED_FOR:
        return COLOURS[CALLED_FOR.index(effect)], OPACITIES[0]
    again, k = divmod(PHYSICAL.index(effect) if effect in PHYSICAL else len(PHYSICAL), len(COLOURS))
    return COLOURS[k], OPACITIES[1 + again]


def _words(bar: Sequence[Part]) -> str:
    return ", ".join(f"{effect} {cost:.1f}" for effect, cost, _ in bar)


def _step(longest: float) -> float:
    """Return the distance of ticks: 1, 2 or 5 times a power of ten, at most six of them."""
    power = 10.0 ** math.floor(math.log10(longest / 6)) if longest > 0 else 1.0
    return next(factor * power for factor in (1.0, 2.0, 5.0, 10.0) if factor * power * 6 >= longest)
