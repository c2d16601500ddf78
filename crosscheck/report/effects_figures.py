"""What effects cost, drawn: one bar per engine and method, stacked from position up to what nobody called for."""

from __future__ import annotations

import math
from collections.abc import Sequence
from xml.etree import ElementTree as ET

from markupsafe import Markup

from crosscheck.judge.effects_rows import EffectRow
from crosscheck.report.svg import COLOURS, Plot
from crosscheck.scenes.names import PHYSICAL

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


def effects_figure(rows: Sequence[EffectRow], ident: str = "effects") -> Markup:
    """Return the stacked bars of a ledger as SVG; each part carries its name and its price as a title.

    Parameters
    ----------
    rows : sequence of EffectRow
        As `effects_ledger` returns them.
    ident : str
        Unique on the page.
    """
    bars = parts(rows)
    longest = max((sum(cost for _, cost, _ in bar) for bar in bars.values()), default=1.0)
    step = _step(longest)
    top = step * math.ceil(longest / step)
    names = list(dict.fromkeys(effect for bar in bars.values() for effect, _, _ in bar))
    described = "; ".join(f"{engine}, {method}: {_words(bar)}" for (engine, method), bar in bars.items())
    plot = Plot(
        ident,
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
    parent: ET.Element,
    x: float,
    y: float,
    width: float,
    height: float,
    colour: str,
    opacity: str,
    called_for: bool,
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
