"""The price list and the effects on the page: cheapest way to N digits, work against precision, stacked bars."""

from __future__ import annotations

import math
from collections.abc import Iterable, Mapping, Sequence
from itertools import accumulate
from typing import Any

from markupsafe import Markup

from crosscheck.judge.prices import POSES, STEPS, EffectRow, Offer, offers
from crosscheck.judge.prices import cheapest as winners
from crosscheck.judge.records import QUANTITIES as SOLVED
from crosscheck.report.figures import HIGHEST_DIGITS, Figure
from crosscheck.report.svg import COLOURS, DASHES, MARKERS, Mark, Plot, Style, power_of_ten, style, swatch
from crosscheck.report.wording import filled, number
from crosscheck.scenes.names import PHYSICAL

Row = Mapping[str, Any]
SHIPPED = "shipped"
"""The name of the methods that use no setting."""
PREFERRED = "regular"
"""The class of scenes that the first table speaks of, if there is one of that name."""


def main_class(rows: Sequence[Row]) -> str | None:
    """Return the class of scenes that the first table speaks of."""
    classes = list(dict.fromkeys(row["scene_class"] for row in rows))
    return PREFERRED if PREFERRED in classes else next(iter(classes), None)


def cheapest(rows: Iterable[Row], quantity: str, goal: float, poses: str = "cycle") -> dict[str, Offer]:
    """Return, per engine, its best offer with enough digits, the cheapest first.

    Parameters
    ----------
    rows : iterable of mapping
        Of a price list, all of one class of scenes.
    quantity : str
    goal : float
        Digits that an offer has at least.
    poses : str
        Of how many: one of `crosscheck.judge.prices.POSES`.
    """
    best: dict[str, Offer] = {}
    for offer in offers(rows, poses, quantity, goal):
        best.setdefault(offer.engine, offer)
    return best


def frontier(rows: Sequence[Row]) -> list[Row]:
    """Return the settings that no other of the same engine beats, for the same quantity and class of scenes.

    Beaten is what has no more digits than another and takes no less time; what gave no number is not beaten by anyone.
    """
    groups: dict[tuple[str, ...], list[Row]] = {}
    for row in rows:
        groups.setdefault((row["engine"], row["scene_class"], row["quantity"]), []).append(row)
    kept = []
    for group in groups.values():
        most = -math.inf
        for row in sorted(group, key=lambda r: (r["microseconds"] is None, r["microseconds"], -(r["digits"] or 0.0))):
            if row["digits"] is None or row["microseconds"] is None:
                kept.append(row)
            elif row["digits"] > most:
                most = row["digits"]
                kept.append(row)
    return kept


def cheapest_tables(rows: Sequence[Row]) -> list[dict[str, Any]]:
    """Return a table per class of scenes and quantity: who asks -> digits -> the cheapest way, and each engine's.

    Who asks needs one pose now, one cycle, or a thousand poses and more. With the cheapest way comes the best of
    another method, and whether it costs more than the spread of both leaves open.
    """
    tables = []
    for scene_class in dict.fromkeys(row["scene_class"] for row in rows):
        of_class = [row for row in rows if row["scene_class"] == scene_class]
        best, engines = winners(of_class), dict.fromkeys(row["engine"] for row in of_class)
        for quantity in best["cycle"]:
            users = []
            for poses, name in POSES.items():
                paid = [cheapest(of_class, quantity, goal, poses) for goal in STEPS]
                lines = [(engine, [offers.get(engine) for offers in paid]) for engine in engines]
                users.append((name, list(best[poses][quantity].values()), lines))
            tables.append({"scenes": scenes_of(scene_class), "quantity": quantity, "users": users})
    return tables


def scenes_of(scene_class: str | None) -> str:
    """Return what scenes of a class are called: "regular scenes", but "scenes near a change point"."""
    return f"scenes {scene_class}" if " " in (scene_class or "") else f"{scene_class} scenes"


def price_figure(rows: Sequence[Row], looks: Mapping[tuple[str, str], Style]) -> Figure:
    """Return digits against microseconds: a panel per class of scenes and quantity, the frontier of each engine."""
    rows = frontier(rows)
    of_engines = _looks(list(dict.fromkeys(r["engine"] for r in rows)), looks)
    span = _decades(rows)
    panels: list[Markup] = []
    for scene_class in dict.fromkeys(row["scene_class"] for row in rows):
        for quantity in SOLVED:
            shown = [r for r in rows if (r["quantity"], r["scene_class"]) == (quantity, scene_class)]
            lines = [(look, [r for r in shown if r["engine"] == engine]) for engine, look in of_engines.items()]
            if shown:
                title, ident = f"{quantity.capitalize()}, {scenes_of(scene_class)}", f"price-{len(panels)}"
                panels.append(_panel(ident, title, shown, lines, span, width=300, height=226, left=30))
    legend = tuple((swatch(look), engine) for engine, look in of_engines.items())
    head = ("engine · method", "setting", "scenes", "quantity", "digits", "attainable", "µs", "spread")
    keys = ("setting", "scene_class", "quantity", "digits", "digits_attainable", "microseconds", "spread")
    return Figure(
        tuple(panels), legend, head, tuple((f"{r['engine']} · {r['method']}", *(r[k] for k in keys)) for r in rows)
    )


def _looks(engines: Sequence[str], looks: Mapping[tuple[str, str], Style]) -> dict[str, Style]:
    """Return what each engine looks like: as its best method in the other figures, if it has one there."""
    look_of: dict[str, Style] = {}
    for engine in engines:
        known = [look for (name, method), look in looks.items() if name == engine and method != SHIPPED]
        look_of[engine] = known[0] if known else style(len(looks) + len(look_of))
    return look_of


def _decades(rows: Sequence[Row]) -> tuple[int, int]:
    """Return the decades between which the prices lie, at least one."""
    times = [math.log10(row["microseconds"]) for row in rows if row["microseconds"]]
    low = math.floor(min(times, default=0.0))
    return low, max(low + 1, math.ceil(max(times, default=0.0)))


def _panel(
    ident: str,
    title: str,
    rows: Sequence[Row],
    series: Iterable[tuple[Style, Sequence[Row]]],
    span: tuple[int, int],
    **size: int,
) -> Markup:
    """Return digits against microseconds: a line per series, a mark per setting, what is attainable as a level."""
    described = f"{title}: digits against microseconds per configuration; upwards and to the left is better"
    plot = Plot(ident, title, described, span, (0.0, HIGHEST_DIGITS), role="group", **size)
    x_ticks = [(float(d), power_of_ten(d)) for d in range(span[0], span[1] + 1)]
    plot.axes(x_ticks, [(float(v), str(v)) for v in range(0, 17, 4)], "µs per configuration · cheaper on the left")
    best = [r["digits_attainable"] for r in rows if r["digits_attainable"] is not None]
    if best:
        level = plot.py(min(max(best), HIGHEST_DIGITS))
        plot.line([(plot.px(span[0]), level), (plot.px(span[1]), level)], stroke="currentColor", stroke_dasharray="1 3")
        plot.text(plot.px(span[1]) - 2, level - 4, "attainable", anchor="end", size="10")
    for look, of_line in series:
        priced = [r for r in of_line if r["microseconds"] and r["digits"] is not None]
        marks = [
            Mark(math.log10(r["microseconds"]), min(max(r["digits"], 0.0), HIGHEST_DIGITS), _spoken(r))
            for r in sorted(priced, key=lambda r: float(r["microseconds"]))
        ]
        plot.marks(marks, look)
    if not any(r["digits"] is not None for r in rows):
        plot.text(plot.px(sum(span) / 2), plot.py(HIGHEST_DIGITS / 2), "nothing was measured", size="13")
    return plot.markup()


def methods_figure(rows: Sequence[Row], quantity: str) -> Markup:
    """Return the panel of one quantity of one scene's price list: a line per method; panels have one scale."""
    shown = [row for row in rows if row["quantity"] == quantity]
    series = [
        (look, [row for row in shown if (row["engine"], row["method"]) == name])
        for name, look in looks_of_methods(rows).items()
    ]
    return _panel(f"price-{quantity}", quantity.capitalize(), shown, series, _decades(rows))


def looks_of_methods(rows: Iterable[Row]) -> dict[tuple[str, str], Style]:
    """Return how each engine and method looks: a colour for each engine, marker and dash for each of its methods."""
    methods = dict.fromkeys((row["engine"], row["method"]) for row in rows)
    look_of = {}
    for k, engine in enumerate(dict.fromkeys(engine for engine, _ in methods)):
        for j, name in enumerate(name for name in methods if name[0] == engine):
            dash = DASHES[(j + j // len(MARKERS)) % len(DASHES)]  # after seven the combinations shift
            look_of[name] = Style(COLOURS[k % len(COLOURS)], dash, MARKERS[j % len(MARKERS)])
    return look_of


def _spoken(row: Row) -> str:
    digits = f"{row['engine']} · {row['method']}, {row['setting']}: {row['digits']:.1f} digits of {row['quantity']}"
    return f"{digits} for {number(row['microseconds'])} µs"


def iterations_of_notes(rows: Sequence[Row]) -> Figure:
    """Return the digits after each Newton iteration of a four-bar of the source documents, and of what they print."""
    looks = [style(k) for k in range(1, 1 + len(SOLVED))]
    legend = tuple((swatch(look), quantity) for look, quantity in zip(looks, SOLVED, strict=True))
    lines = tuple((row["iteration"], row["quantity"], row["digits"]) for row in rows)
    counted = [row for row in rows if row["iteration"] != "printed"]
    last = max(int(row["iteration"]) for row in counted)
    title = "Digits after each Newton iteration"
    description = f"{title}: position, velocity and acceleration of a four-bar of the source documents"
    plot = Plot("iterations", title, description, (0, last), (0.0, HIGHEST_DIGITS))
    ticks = [(float(k), str(k)) for k in range(last + 1)]
    plot.axes(ticks, [(float(y), str(y)) for y in range(0, 17, 3)], "iterations")
    for look, quantity in zip(looks, SOLVED, strict=True):
        at = [(int(row["iteration"]), max(0.0, row["digits"])) for row in counted if row["quantity"] == quantity]
        plot.series(at, look)
    return Figure((plot.markup(),), legend, ("iterations", "quantity", "digits"), lines)


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


def effects_figure(rows: Sequence[Row]) -> Figure:
    """Return one stacked bar per engine and method, a part per effect; and all rows as a table."""
    ledger = [EffectRow(**row) for row in rows]
    panels = (effects_bars(ledger),) if rows else ()
    head = ("engine", "method", "effect", "µs", "changes the answer", "largest change", "note")
    changes = {True: "no", False: "yes", None: "–"}
    lines = tuple(
        (
            *(row.engine, row.method, row.effect, "within noise" if row.within_noise else row.microseconds),
            *(changes[row.inert], row.largest_change, row.note),
        )
        for row in ledger
    )
    return Figure(panels, (), head, lines)
