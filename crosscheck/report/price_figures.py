"""The diagrams of the price list: work-precision per quantity, digits per Newton iteration; as SVG to be included."""

from __future__ import annotations

import math
from collections.abc import Iterable, Mapping, Sequence
from typing import Any

from markupsafe import Markup

from crosscheck.report.svg import COLOURS, DASHES, MARKERS, Plot, Style, power_of_ten, style, swatch
from crosscheck.scenes.names import QUANTITIES

HIGHEST_DIGITS = 17.0
Series = tuple[str, str]
"""Engine and method: one line, its settings the marks on it."""


def looks(rows: Iterable[Mapping[str, Any]]) -> dict[Series, Style]:
    """Return how each engine and method looks: a colour for each engine, marker and dash for each of its methods."""
    series = dict.fromkeys((row["engine"], row["method"]) for row in rows)
    engines = dict.fromkeys(engine for engine, _ in series)
    look_of = {}
    for k, engine in enumerate(engines):
        for j, name in enumerate(name for name in series if name[0] == engine):
            dash = DASHES[(j + j // len(MARKERS)) % len(DASHES)]  # after seven the combinations shift
            look_of[name] = Style(COLOURS[k % len(COLOURS)], dash, MARKERS[j % len(MARKERS)])
    return look_of


def legend(rows: Iterable[Mapping[str, Any]]) -> list[tuple[Markup, str]]:
    """Return (sample, name) of every series of the diagrams of these rows."""
    return [(swatch(look), " · ".join(name)) for name, look in looks(rows).items()]


def work_precision(rows: Sequence[Mapping[str, Any]], quantity: str) -> Markup:
    """Return digits against microseconds: a line per method, its settings as marks, what is attainable as a level.

    Parameters
    ----------
    rows : sequence of mapping
        Rows of a price list, of one scene; rows of other quantities give the scale, so that panels compare.
    """
    shown = [row for row in rows if row["digits"] is not None and row["microseconds"]]
    span = _decades([row["microseconds"] for row in shown])
    title = f"{quantity.capitalize()}: digits against microseconds"
    description = f"{title} per configuration, by engine and method; upwards and to the left is better"
    plot = Plot(f"price-{quantity}", title, description, span, (0.0, HIGHEST_DIGITS))
    x_ticks = [(float(d), power_of_ten(d)) for d in range(math.ceil(span[0]), math.floor(span[1]) + 1)]
    plot.axes(x_ticks, [(float(y), str(y)) for y in range(0, 17, 3)], "microseconds per configuration")
    for name, look in looks(rows).items():
        of_method = [row for row in shown if (row["engine"], row["method"], row["quantity"]) == (*name, quantity)]
        plot.series([(math.log10(row["microseconds"]), row["digits"]) for row in of_method], look)
    levels = [row["digits_attainable"] for row in rows if row["quantity"] == quantity]
    if levels and levels[0] is not None:
        y = plot.py(levels[0])
        plot.line([(plot.px(span[0]), y), (plot.px(span[1]), y)], stroke="currentColor", stroke_dasharray="3 3")
        plot.text(plot.px(span[1]) - 2, y - 4, "attainable", anchor="end", size="10")
    if not any(row["quantity"] == quantity for row in shown):
        plot.text(plot.px(sum(span) / 2), plot.py(HIGHEST_DIGITS / 2), "nothing was measured", size="13")
    return plot.markup()


def iterations_figure(rows: Sequence[Mapping[str, Any]]) -> Markup:
    """Return digits after each Newton iteration, a line per quantity; what is printed as marks at its iteration.

    Parameters
    ----------
    rows : sequence of mapping
        From `crosscheck.documents.page.digits_by_iteration`.
    """
    counted = [row for row in rows if row["iteration"] != "printed"]
    last = max(int(row["iteration"]) for row in counted)
    title = "Digits after each Newton iteration"
    description = f"{title}: position, velocity and acceleration of a four-bar of the source documents"
    plot = Plot("iterations", title, description, (0, last), (0.0, HIGHEST_DIGITS))
    ticks = [(float(k), str(k)) for k in range(last + 1)]
    plot.axes(ticks, [(float(y), str(y)) for y in range(0, 17, 3)], "iterations")
    for look, quantity in zip(iteration_looks(), QUANTITIES, strict=True):
        at = [(int(row["iteration"]), max(0.0, row["digits"])) for row in counted if row["quantity"] == quantity]
        plot.series(at, look)
    return plot.markup()


def iteration_looks() -> list[Style]:
    """Return the looks of position, velocity, acceleration in `iterations_figure`."""
    return [style(k) for k in range(1, 1 + len(QUANTITIES))]


def _decades(microseconds: Sequence[float]) -> tuple[float, float]:
    """Return the logarithms between which the prices lie, at least one decade apart."""
    low = math.floor(math.log10(min(microseconds, default=1.0)))
    return float(low), float(max(low + 1, math.ceil(math.log10(max(microseconds, default=1.0)))))
