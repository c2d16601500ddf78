"""Every mark of a figure stands where the ticks of its axes say: what a reader reads off is what was handed in."""

from __future__ import annotations

import math
import re
from typing import Any
from xml.etree import ElementTree as ET

import numpy as np
import pytest

from crosscheck.judge.prices import EffectRow
from crosscheck.report.figures import digits_figure, newton_figure, slopes_figure, trends_figure
from crosscheck.report.prices import effects_bars, iterations_of_notes, price_figure
from crosscheck.report.svg import SUPERSCRIPTS, style, swatch
from crosscheck.scenes.names import QUANTITIES

from .report_records import effect_row

PLAIN = {written: chr(digit) for digit, written in SUPERSCRIPTS.items()}
PIXEL = 0.06
"""Places are written to tenths of a pixel."""


def value_of(label: str) -> float:
    """Return what a tick says: a number, or the exponent of a power of ten."""
    exponent = re.fullmatch(r"10([⁻⁰¹²³⁴⁵⁶⁷⁸⁹]+)", label)
    return float("".join(PLAIN[ord(c)] for c in exponent[1]) if exponent else label)


class Read:
    """A panel as a reader has it: its ticks, and from them what a place in it means."""

    def __init__(self, panel: Any) -> None:
        self.root = ET.fromstring(panel)
        self.texts = [(float(t.get("x", 0)), float(t.get("y", 0)), t) for t in self.root.iter("text")]
        lines = [points(line) for line in self.root.findall("polyline")]
        grid = [line for line in lines if len(line) == 2 and line[0][1] == line[1][1]]
        (left, _), (right, _) = grid[0]
        self.left, self.right = left, right
        self.foot = max(line[0][1] for line in grid)
        below = [(x, t.text or "") for x, y, t in self.texts if 12 < y - self.foot < 20]
        beside = [(y - 3.8, t.text or "") for x, y, t in self.texts if abs(x - (left - 7)) < PIXEL]
        self.below = below
        _, _, width, height = map(float, (self.root.get("viewBox") or "").split())
        assert 0 < left < left + width / 2 < right < width
        assert all(left - PIXEL <= x <= right + PIXEL for x, _ in below)
        assert all(20 < y < self.foot + PIXEL < height for y, _ in beside)
        self.x, self.y = self.scale(below), self.scale(beside)

    def scale(self, ticks: list[tuple[float, str]]) -> Any:
        """Return the line through all ticks, from pixels to what they say; None of dates."""
        if not all(re.fullmatch(r"[-\d.e+⁻⁰¹²³⁴⁵⁶⁷⁸⁹]+", label) and label.count("-") < 2 for _, label in ticks):
            return None
        places, values = zip(*[(place, value_of(label)) for place, label in ticks], strict=True)
        assert len(set(values)) == len(values) >= 2
        line = np.polynomial.Polynomial.fit(places, values, 1)
        off = np.abs([line(place) - value for place, value in zip(places, values, strict=True)])
        assert np.max(off) < 2 * PIXEL * abs(line.deriv()(0.0))
        return line

    def near(self, places: Any, expected: Any) -> None:
        """Say that places mean these (x, y), and lie inside of the axes."""
        places, expected = np.array(sorted(places)), np.array(sorted(expected), float)
        tolerance = [3 * PIXEL * abs(line.deriv()(0.0)) for line in (self.x, self.y)]
        read = np.column_stack([self.x(places[:, 0]), self.y(places[:, 1])])
        assert read.shape == expected.shape
        assert np.all(np.abs(read - expected) < tolerance), (read, expected)
        assert np.all((places[:, 0] > self.left - PIXEL) & (places[:, 0] < self.right + PIXEL))
        assert np.all(places[:, 1] < self.foot + PIXEL)

    def marks(self) -> dict[str, tuple[float, float]]:
        """Return where what can be pointed at stands, by what it says."""
        around = {g.get("aria-label", ""): g.find("circle") for g in self.root.iter("g")}
        return {name: (float(c.get("cx")), float(c.get("cy"))) for name, c in around.items()}  # type: ignore[union-attr,arg-type]

    def lines(self) -> list[list[tuple[float, float]]]:
        """Return the lines of the series: those in a colour of their own."""
        return [points(line) for line in self.root.findall("polyline") if (line.get("stroke") or "").startswith("#")]


def points(line: ET.Element) -> list[tuple[float, float]]:
    pairs = [pair.split(",") for pair in (line.get("points") or "").split()]
    return [(float(x), float(y)) for x, y in pairs]


def digits_of(median: float, worst: float, samples: int = 3) -> dict[str, Any]:
    return {"samples": samples, "digits_median": median, "digits_p01": worst + 0.1, "digits_worst": worst}


def digits_report(engines: Any, rounding: Any = None) -> dict[str, Any]:
    blank: dict[str, Any] = {name: {"digits_by_sigma": {}} for name in QUANTITIES}
    return {
        "engines": {
            engine: {"newton": {**blank, **{name: {"digits_by_sigma": bins} for name, bins in quantities.items()}}}
            for engine, quantities in engines.items()
        },
        "poses": {"marks": [{"engine": "b", "method": "newton", "quantity": "position", "decade": -3}]},
        "methods": [
            {"engine": "a", "method": "newton", "unanswered_by_sigma": {"-7": 2}},
            {"engine": "b", "method": "newton", "unanswered_by_sigma": {}},
        ],
        "rounding": rounding or {},
    }


@pytest.mark.parametrize(
    ("line", "least", "foot"),
    [
        *(("digits_worst", least, foot) for least, foot in ((-2.5, -3.0), (2.5, 0.0), (6.5, 4.0))),
        *(("digits_median", least, foot) for least, foot in ((-2.5, -2.0), (2.5, 0.0), (3.0, 4.0))),
    ],
)
def test_digits_near_singular_poses_stand_in_their_decade_at_their_height(line: str, least: float, foot: float) -> None:
    bins = {-3: digits_of(12.0, 9.5), -1: digits_of(14.25, 11.0), 0: digits_of(15.0, 13.5)}
    here = {str(d): each for d, each in bins.items()}
    other = {"-3": digits_of(least + 1.0, least), "-1": digits_of(8.0, 7.75, 0)}
    band = {"-3": digits_of(13.0, 10.0), "-2": digits_of(14.0, 11.0)}
    report = digits_report({"a": {"position": here}, "b": {"position": other}}, {"position": band})
    figure = digits_figure(report, line)
    panel = Read(figure.panels[0])
    marks = panel.marks()
    shown = {"a": [(d, each[line]) for d, each in bins.items()], "b": [(-3, other["-3"][line])]}

    aside = set()
    for name, wanted in shown.items():
        own = sorted(place for label, place in marks.items() if label.startswith(f"{name} · newton"))
        offsets = [panel.x(x) - d for (x, _), (d, _) in zip(own, wanted, strict=True)]
        assert np.ptp(offsets) < 0.05
        assert 0.15 < offsets[0] < 0.85
        aside.add(round(offsets[0], 1))
        panel.near(own, [(d + offsets[0], digits) for d, digits in wanted])
    assert len(aside) == 2
    assert panel.y(panel.foot) == pytest.approx(foot, abs=0.1)
    (polygon,) = panel.root.findall("polygon")
    corners = {(round(panel.x(x), 1), round(panel.y(y), 1)) for x, y in points(polygon)}
    edges = [(d, v) for d, low, high in ((-3, 10.1, 13.0), (-2, 11.1, 14.0)) for d in (d, d + 1) for v in (low, high)]
    near = [min(math.dist(edge, corner) for corner in corners) for edge in edges]
    assert max(near) < 0.15
    assert [panel.x(panel.left), panel.x(panel.right)] == pytest.approx([-7, 1], abs=0.05)
    posed = [g.get("data-pose") for g in panel.root.iter("g") if g.get("aria-label", "").startswith("b")]
    assert posed == (["0"] if line == "digits_worst" else [None])
    crosses = [p for p in panel.root.findall("path") if p.get("fill") == "none"]
    assert len(crosses) == (line == "digits_worst")
    assert figure.rows[0][:7] == ("a · newton", "position", "10⁻³ to 10⁻²", 3, 12.0, 9.6, 9.5)
    assert [row[7] for row in figure.rows] == [13.0, None, None, 13.0]


def test_of_a_history_of_newton_every_residual_and_correction_stands_at_its_iteration() -> None:
    history = {"name": "a rocker", "status": "ok", "iterations": 3, "correction_ratio": [1e-2, 1e-4]}
    history |= {"residual": [0.5, 1e-3, 2e-8, 0.0], "correction": [0.3, 3e-3, 3e-7]}
    short = {**history, "iterations": 1, "residual": [0.5, 0.1], "correction": [0.3], "correction_ratio": []}
    figure = newton_figure({"newton_histories": [history, short]})
    panel, once = (Read(drawn) for drawn in figure.panels)
    residuals, corrections = panel.lines()

    panel.near(residuals, [(k, math.log10(v) if v else -18.0) for k, v in enumerate(history["residual"])])
    panel.near(corrections, [(k + 1, math.log10(v)) for k, v in enumerate(history["correction"])])
    assert [once.x(once.left), once.x(once.right)] == pytest.approx([0.0, 1.0])
    assert figure.rows[:4] == (
        ("a rocker", 0, 0.5, None, None),
        ("a rocker", 1, 1e-3, 0.3, None),
        ("a rocker", 2, 2e-8, 3e-3, 1e-2),
        ("a rocker", 3, 0.0, 3e-7, 1e-4),
    )


def test_errors_over_steps_stand_at_the_logarithms_of_both() -> None:
    lines = [
        {"name": "forward", "over": "step", "x": [1e-6, 1e-4, 1e-1], "y": [2e-10, 3e-8, 0.02], "fitted": 1.0},
        {"name": "exact", "over": "step", "x": [1e-6, 1e-1], "y": [0.0, 0.0], "fitted": None},
        {"name": "sigma", "over": "distance", "x": [1e-6, 1e-3], "y": [2e-8, 0.05], "fitted": 0.5},
    ]
    rows = [{**line, "expected": 1.0, "spread": 0.01} for line in lines]
    panels = [Read(drawn) for drawn in slopes_figure(rows).panels]

    assert len(panels) == 2
    drawn = [(panel, line) for panel in panels for line in panel.lines()]
    for (panel, places), line in zip(drawn, rows, strict=True):
        wanted = [(math.log10(x), math.log10(y) if y else -17.0) for x, y in zip(line["x"], line["y"], strict=True)]
        panel.near(places, wanted)


def test_a_course_over_nights_stands_at_its_ratios_between_its_first_and_its_last_night() -> None:
    nights = [f"2026-10-{day:02d} 02:17" for day in range(1, 6)]
    one = {"name": "mujoco · newton", "nights": nights, "values": [2.0, 2.1, 1.9, 3.0, 3.1], "changes": {"3": 1.5}}
    figure = trends_figure([one, {**one, "nights": nights[:1], "values": [1.0], "changes": {}}])
    (drawn,) = figure.panels
    panel = Read(drawn)
    (line,) = panel.lines()
    steps = np.linspace(panel.left, panel.right, 5)
    ((label, place),) = panel.marks().items()

    assert sorted(panel.below) == [(panel.left, "2026-10-01"), (panel.right, "2026-10-05")]
    assert [x for x, _ in line] == pytest.approx(steps.tolist(), abs=0.2)
    assert [panel.y(y) for _, y in line] == pytest.approx(one["values"], abs=0.06)
    assert place == pytest.approx(line[3], abs=0.2)
    assert "changed on 2026-10-04 02:17 by a factor 1.5" in label
    assert [row[3] for row in figure.rows] == ["", "", "", "changed", "", ""]


def test_a_price_stands_at_its_time_and_its_digits() -> None:
    row = {"engine": "a", "method": "newton", "scene_class": "regular", "quantity": "velocity", "spread": 0.1}
    priced = {(0.2, -0.5): "none", (0.3, 0.4): "one", (0.4, 6.0): "loose", (12.0, 9.5): "k = 3"}
    priced |= {(300.0, 14.0): "tight", (2000.0, 18.0): "far"}
    rows = [
        {
            **row,
            "setting": setting,
            "microseconds": time,
            "digits": digits,
            "digits_attainable": min(digits + 9.0, 15.0),
        }
        for (time, digits), setting in priced.items()
    ]
    silent = {**row, "setting": "silent", "microseconds": 3.0, "digits": None, "digits_attainable": None}
    drawn, blank = (price_figure(some, {}).panels[0] for some in ([*rows, silent], [silent]))
    panel = Read(drawn)

    assert ["nothing was measured" in drawn, "nothing was measured" in blank] == [False, True]
    panel.near(panel.marks().values(), [(math.log10(time), min(max(digits, 0.0), 17.5)) for time, digits in priced])
    levels = [line for line in map(points, panel.root.findall("polyline")) if line[0][0] == panel.left]
    assert any(panel.y(line[0][1]) == pytest.approx(15.0, abs=0.1) for line in levels)


def test_an_engine_has_in_the_figure_of_prices_the_look_of_its_best_method_elsewhere() -> None:
    """Of a method that is not its shipped defaults; else one that no other series of the page has."""
    looks = {("a", "shipped"): style(0), ("a", "newton"): style(1), ("c", "shipped"): style(2)}
    row = {
        "method": "any",
        "scene_class": "regular",
        "quantity": "velocity",
        "spread": 0.1,
        "setting": "",
        "digits": 9.0,
    }
    rows = [{**row, "engine": engine, "microseconds": 2.0, "digits_attainable": 15.0} for engine in "abc"]

    assert price_figure(rows, looks).legend == (
        (swatch(style(1)), "a"),
        (swatch(style(4)), "b"),
        (swatch(style(5)), "c"),
    )


def test_digits_after_iterations_stand_at_their_iteration() -> None:
    digits = {"position": [1.0, 3.5, 9.0], "velocity": [0.5, 2.0, 7.0], "acceleration": [-1.0, 1.5, 6.0]}
    rows = [
        {"iteration": str(k), "quantity": name, "digits": value}
        for name, values in digits.items()
        for k, value in enumerate(values)
    ]
    figure = iterations_of_notes([*rows, {"iteration": "printed", "quantity": "position", "digits": 4.0}])
    panel = Read(figure.panels[0])

    for drawn, values in zip(panel.lines(), digits.values(), strict=True):
        panel.near(drawn, [(k, max(0.0, value)) for k, value in enumerate(values)])


def test_the_parts_of_a_bar_are_as_long_as_what_they_cost_and_one_begins_where_the_other_ends() -> None:
    made = [("velocity", 20.0, 5.0, True), ("gravity", 20.0, 40.0, False), ("contact", 20.0, 0.01, False)]
    rows = [
        effect_row(effect, engine="a", without=without, microseconds=cost, called_for=called, spread=0.5)
        for effect, without, cost, called in made
    ]
    who = {"engine": "b", "method": "any", "setting": "", "effect": "points"}
    root = ET.fromstring(effects_bars([*rows, EffectRow(**who, note="none", inert=None, called_for=True)]))
    titled = [(box, (box.findtext("title") or "").split(": ")) for box in root.iter("rect")]
    bars = {words[0]: box for box, words in titled if len(words) == 2}
    ticks = [(float(t.get("x", 0)), t.text or "") for t in root.iter("text") if (t.text or "").isdigit()]
    places, values = zip(*[(x, float(label)) for x, label in ticks], strict=True)
    per = np.polynomial.Polynomial.fit(places, values, 1)
    ends = {name: (float(b.get("x", 0)), float(b.get("x", 0)) + float(b.get("width", 0))) for name, b in bars.items()}

    assert list(bars) == ["position", "velocity", "gravity"]  # what is noise is no part
    read = [tuple(per(end) for end in of_part) for of_part in ends.values()]
    assert np.array(read) == pytest.approx(np.array([(0.0, 20.0), (20.0, 25.0), (25.0, 65.0)]), abs=0.2)
    assert ["stroke-dasharray" in b.attrib for b in bars.values()] == [False, False, True]
    assert len({(b.get("fill"), b.get("fill-opacity")) for b in bars.values()}) == 3
    legend = {t.text: float(t.get("x", 0)) for t in root.iter("text") if t.text in bars}
    boxes = [float(box.get("x", 0)) for box, words in titled if len(words) == 1]
    assert sorted(x - 18 for x in legend.values()) == pytest.approx(sorted(boxes))
    assert len(set(legend.values())) == 3


@pytest.mark.parametrize("longest", [1.3e-4, 0.059, 0.7, 6.0, 11.0, 12.5, 29.0, 65.0, 3e3])
def test_ticks_of_bars_have_the_smallest_round_step_that_reaches_the_longest_bar_in_six(longest: float) -> None:
    lengths = {"a": 0.3 * longest, "b": longest, "c": 0.1 * longest}
    rows = [
        effect_row("velocity", engine=k, without=0.75 * x, spread=0.0, microseconds=0.25 * x, called_for=True)
        for k, x in lengths.items()
    ]
    root = ET.fromstring(effects_bars(rows))
    texts = [(float(t.get("x", 0)), t.text or "") for t in root.iter("text")]
    ticks = [(x, float(text)) for x, text in texts if re.fullmatch(r"[\d.e+-]+", text)]
    places, values = zip(*ticks, strict=True)
    step = min(s for k in range(-6, 5) for s in (10.0**k, 2.0 * 10.0**k, 5.0 * 10.0**k) if 6.0 * s >= longest)

    assert values == pytest.approx([step * k for k in range(len(values))])
    assert values[-2] < longest <= values[-1] * (1.0 + 1e-12)
    ends = [
        float(b.get("x", 0)) + float(b.get("width", 0)) for b in root.iter("rect") if ": " in b.findtext("title", "")
    ]
    assert max(ends) == pytest.approx(np.interp(longest, values, places), abs=0.1)
