"""The bars of the ledger of effects: what is stacked, and that no two effects look alike."""

from __future__ import annotations

from xml.etree import ElementTree as ET

from crosscheck.judge.prices import EffectRow
from crosscheck.report.prices import CALLED_FOR, effects_bars, look, parts
from crosscheck.scenes.names import PHYSICAL

SVG = "{http://www.w3.org/2000/svg}"


def row(effect: str, microseconds: float | None, spread: float = 0.1) -> EffectRow:
    return EffectRow(
        engine="an engine",
        method="a method",
        setting="",
        effect=effect,
        microseconds=microseconds,
        without=50.0,
        spread=spread,
        inert=True,
        largest_change=0.0,
        worst="",
        called_for=effect not in PHYSICAL,
        note="",
    )


def test_no_two_effects_look_alike():
    looks = [look(effect) for effect in (*CALLED_FOR, *PHYSICAL)]

    assert len(set(looks)) == len(looks)


def test_an_effect_looks_the_same_whatever_else_is_drawn():
    alone, among = ([row("velocity", 5.0)], [row("gravity", 9.0), row("velocity", 5.0)])
    fills = [_fill_of("velocity", effects_bars(rows)) for rows in (alone, among)]

    assert fills[0] == fills[1]


def test_a_bar_begins_with_the_cost_of_positions_and_leaves_noise_out():
    rows = [row("velocity", 5.0), row("gravity", 0.05), row("contact", None)]

    assert parts(rows) == {("an engine", "a method"): [("position", 50.0, True), ("velocity", 5.0, True)]}


def test_an_effect_of_an_engine_that_nobody_knows_is_drawn():
    assert _fill_of("wind", effects_bars([row("wind", 5.0)]))


def _fill_of(effect: str, figure: str) -> tuple[str | None, str | None]:
    """Return fill and opacity of the part of a bar that carries the name of an effect."""
    for box in ET.fromstring(figure).iter():
        title = next((child.text or "" for child in box if child.tag.removeprefix(SVG) == "title"), "")
        if box.tag.removeprefix(SVG) == "rect" and title.startswith(f"{effect}:"):
            return box.get("fill"), box.get("fill-opacity")
    raise AssertionError(f"no part is called {effect!r}")
