"""The price list and the effects on the page: cheapest way to N digits, work against precision, stacked bars."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from typing import Any
from xml.etree import ElementTree as ET

from markupsafe import Markup

from crosscheck.report.figures import HIGHEST_DIGITS, Figure
from crosscheck.report.summary import SOLVED
from crosscheck.report.svg import COLOURS, Mark, Plot, Style, power_of_ten, style, swatch
from crosscheck.report.wording import number

Row = Mapping[str, Any]
GOALS = (3, 6, 9, 12, 14)
PREFERRED = "regular"
"""The class of scenes that the first table speaks of, if there is one of that name."""


def main_class(rows: Sequence[Row]) -> str | None:
    """Return the class of scenes that the first table speaks of."""
    classes = list(dict.fromkeys(row["scene_class"] for row in rows))
    return PREFERRED if PREFERRED in classes else next(iter(classes), None)


def cheapest(rows: Sequence[Row], quantity: str, goal: float, scene_class: str | None) -> dict[tuple[str, str], Row]:
    """Return, per engine and route, the row of the least time that has at least `goal` digits."""
    found: dict[tuple[str, str], Row] = {}
    for row in rows:
        if (row["quantity"], row["scene_class"]) != (quantity, scene_class) or (row["digits"] or 0.0) < goal:
            continue
        who = (row["engine"], row["route"])
        if row["microseconds"] is None:
            continue
        if who not in found or row["microseconds"] < found[who]["microseconds"]:
            found[who] = row
    return found


def cheapest_tables(rows: Sequence[Row]) -> list[dict[str, Any]]:
    """Return a table per class of scenes and quantity: engine and route x goal -> the cheapest row, None if none."""
    tables = []
    for scene_class in dict.fromkeys(row["scene_class"] for row in rows):
        for quantity in SOLVED:
            of_table = [r for r in rows if (r["quantity"], r["scene_class"]) == (quantity, scene_class)]
            names = dict.fromkeys((r["engine"], r["route"]) for r in of_table)
            best = {goal: cheapest(rows, quantity, goal, scene_class) for goal in GOALS}
            least = {
                goal: min((r["microseconds"] for r in found.values()), default=None) for goal, found in best.items()
            }
            lines = [(" · ".join(name), [(best[g].get(name), least[g]) for g in GOALS]) for name in names]
            if lines:
                tables.append({"scene_class": scene_class, "quantity": quantity, "lines": lines})
    return tables


def price_figure(rows: Sequence[Row], looks: Mapping[tuple[str, str], Style]) -> Figure:
    """Return digits against microseconds: a panel per class of scenes and quantity, a line per engine and route."""
    names = list(dict.fromkeys((r["engine"], r["route"]) for r in rows))
    known = dict(looks)
    for name in names:
        known.setdefault(name, style(len(known)))
    times = [math.log10(r["microseconds"]) for r in rows if r["microseconds"]]
    span = (
        math.floor(min(times, default=0.0)),
        max(math.floor(min(times, default=0.0)) + 1, math.ceil(max(times, default=1.0))),
    )
    panels: list[Markup] = []
    for scene_class in dict.fromkeys(row["scene_class"] for row in rows):
        for quantity in SOLVED:
            shown = [r for r in rows if (r["quantity"], r["scene_class"]) == (quantity, scene_class)]
            if shown:
                panels.append(_price_panel(f"price-{len(panels)}", scene_class, quantity, shown, names, known, span))
    legend = tuple((swatch(known[name]), " · ".join(name)) for name in names)
    head = ("engine · route", "knob", "scenes", "quantity", "digits", "attainable", "µs", "spread")
    keys = ("knob", "scene_class", "quantity", "digits", "digits_attainable", "microseconds", "spread")
    return Figure(
        tuple(panels), legend, head, tuple((f"{r['engine']} · {r['route']}", *(r[k] for k in keys)) for r in rows)
    )


def _price_panel(
    ident: str,
    scene_class: str,
    quantity: str,
    rows: Sequence[Row],
    names: Sequence[tuple[str, str]],
    looks: Mapping[tuple[str, str], Style],
    span: tuple[int, int],
) -> Markup:
    title = f"{quantity.capitalize()}, {scene_class} scenes"
    described = f"Digits against microseconds per configuration: {title}"
    plot = Plot(ident, title, described, span, (0.0, HIGHEST_DIGITS), width=300, height=226, left=30, role="group")
    x_ticks = [(float(d), power_of_ten(d)) for d in range(span[0], span[1] + 1)]
    plot.axes(x_ticks, [(float(v), str(v)) for v in range(0, 17, 4)], "µs per configuration · cheaper on the left")
    best = [r["digits_attainable"] for r in rows if r["digits_attainable"] is not None]
    if best:
        level = plot.py(min(max(best), HIGHEST_DIGITS))
        plot.line([(plot.px(span[0]), level), (plot.px(span[1]), level)], stroke="currentColor", stroke_dasharray="1 3")
    for name in names:
        of_line = [r for r in rows if (r["engine"], r["route"]) == name and r["microseconds"]]
        marks = [
            Mark(math.log10(r["microseconds"]), min(max(r["digits"], 0.0), HIGHEST_DIGITS), _spoken(r))
            for r in sorted(of_line, key=lambda r: r["microseconds"])
            if r["digits"] is not None
        ]
        plot.marks(marks, looks[name])
    return plot.markup()


def _spoken(row: Row) -> str:
    told = f"{row['engine']} · {row['route']}, {row['knob']}: {row['digits']:.1f} digits of {row['quantity']}"
    return f"{told} for {number(row['microseconds'])} µs"


def effects_figure(rows: Sequence[Row]) -> Figure:
    """Return one stacked bar per engine, a part per effect; the same effect has the same colour everywhere."""
    engines = list(dict.fromkeys(r["engine"] for r in rows))
    effects = list(dict.fromkeys(r["effect"] for r in rows))
    looks = {effect: _fill(k) for k, effect in enumerate(effects)}
    panels = (_bars(engines, rows, looks),) if rows else ()
    legend = tuple((_patch(look), effect) for effect, look in looks.items())
    head = ("engine", "effect", "µs", "changes what was called for", "largest change")
    told = {True: "no", False: "yes", None: "not known"}
    lines = tuple((r["engine"], r["effect"], r["microseconds"], told[r["inert"]], r["largest_change"]) for r in rows)
    return Figure(panels, legend, head, lines)


def _fill(k: int) -> dict[str, str]:
    """Return colour and opacity of the k-th effect: after the palette it starts again, paler."""
    colours = [c for c in COLOURS if c != "currentColor"]
    return {"fill": colours[k % len(colours)], "fill-opacity": ("1", "0.55", "0.3")[k // len(colours) % 3]}


def _bars(engines: Sequence[str], rows: Sequence[Row], looks: Mapping[str, Mapping[str, str]]) -> Markup:
    longest = max(sum(max(0.0, r["microseconds"]) for r in rows if r["engine"] == e) for e in engines) or 1.0
    width, left, step = 640, 120, 30
    size = {
        "viewBox": f"0 0 {width} {step * len(engines) + 8}",
        "width": str(width),
        "height": str(step * len(engines) + 8),
    }
    named = {"role": "group", "aria-labelledby": "effects-bars", "font-size": "12", "fill": "currentColor"}
    root = ET.Element("svg", {**size, **named, "font-family": "system-ui, sans-serif"})
    ET.SubElement(root, "title", {"id": "effects-bars"}).text = "Microseconds per effect, stacked, by engine"
    for k, engine in enumerate(engines):
        y, x = step * k + 4, float(left)
        name = ET.SubElement(root, "text", {"x": str(left - 8), "y": str(y + 15), "text-anchor": "end"})
        name.text = engine
        for row in (r for r in rows if r["engine"] == engine and r["microseconds"] > 0):
            long = (width - left - 70) * row["microseconds"] / longest
            label = f"{engine}, {row['effect']}: {number(row['microseconds'])} µs"
            told = {"role": "img", "aria-label": label, "tabindex": "-1", "data-mark": ""}
            group = ET.SubElement(root, "g", told)
            ET.SubElement(group, "title").text = label
            at = {"x": f"{x:.1f}", "y": str(y), "width": f"{max(long - 1, 0.5):.1f}", "height": "20"}
            ET.SubElement(group, "rect", {**at, **looks[row["effect"]]})
            x += long
        total = ET.SubElement(root, "text", {"x": f"{x + 6:.1f}", "y": str(y + 15)})
        total.text = f"{number(sum(r['microseconds'] for r in rows if r['engine'] == engine))} µs"
    return Markup(ET.tostring(root, encoding="unicode"))


def _patch(look: Mapping[str, str]) -> Markup:
    root = ET.Element("svg", {"viewBox": "0 0 14 12", "width": "14", "height": "12", "aria-hidden": "true"})
    ET.SubElement(root, "rect", {"width": "14", "height": "12", **look})
    return Markup(ET.tostring(root, encoding="unicode"))
