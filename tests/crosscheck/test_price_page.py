"""The diagrams and the page of a price list, and what stands on the terminal."""

from __future__ import annotations

import io
from dataclasses import asdict
from xml.etree import ElementTree as ET

import pytest
from rich.console import Console

from crosscheck.commands.price import cheapest_table, lines, methods_table, page_of, to_json
from crosscheck.documents.ledger.page import digits_by_iteration
from crosscheck.measure.price import PriceList
from crosscheck.report.prices import cheapest_tables, iterations_of_notes, looks_of_methods, methods_figure

from .report_records import price_row


def row(engine="exudyn", digits=3.0, **more):
    more = {"method": "static", "setting": "1e-3", "microseconds": 10.0, **more}
    return price_row(engine=engine, digits=digits, digits_attainable=14.5, spread=0.05, newton_by=engine, **more)


ROWS = [
    row(),
    row(setting="1e-9", digits=9.0, microseconds=20.0),
    row(engine="mujoco", method="mj_step", setting="h", digits=4.0, microseconds=100.0),
    row(engine="mujoco", method="mj_step", setting="crash", digits=None, microseconds=None, note="its process ended"),
    row(setting="1e-9", digits=2.0, microseconds=30.0, quantity="velocity"),
]


def price_list(**more):
    given = {"scene": "four-bar", "key": "", "rows": ROWS, "times": 73, "known": 73, "asked": 73, "refused": []}
    return to_json(PriceList(**{**given, **more}))


def drawn(svg):
    return ET.fromstring(str(svg))


def marks(root):
    return [e for e in root if "data-mark" in e.attrib]


def places(rows, quantity="position"):
    """Where the marks of a panel stand (pixels), in the order of their rows."""
    circles = [mark.find("{*}circle") for mark in marks(drawn(methods_figure(rows, quantity)))]
    return [(float(c.get("cx")), float(c.get("cy"))) for c in circles]


def test_every_setting_that_has_digits_and_a_price_is_a_mark():
    assert len(places(price_list()["rows"])) == 3


def test_more_digits_are_higher_and_a_higher_price_is_further_right():
    (x1, y1), (x2, y2) = places(price_list()["rows"])[:2]

    assert y2 < y1
    assert x2 > x1


def test_prices_stand_on_a_logarithmic_axis():
    (a, _), (b, _), (c, _) = places([asdict(row(microseconds=price)) for price in (1.0, 10.0, 100.0)])

    assert b - a == pytest.approx(c - b, abs=0.2)


def test_what_is_attainable_is_a_level():
    assert "attainable" in [
        e.text for e in drawn(methods_figure(price_list()["rows"], "position")) if e.tag.endswith("text")
    ]


def test_a_quantity_that_nobody_was_measured_at_says_so():
    assert "nothing was measured" in str(methods_figure(price_list()["rows"], "acceleration"))


def test_no_two_methods_look_alike():
    many = [asdict(row(method=f"method {k}", engine=e)) for e in ("refkin", "exudyn", "mujoco") for k in range(12)]

    assert len(set(looks_of_methods(many).values())) == len(many)


def test_the_diagram_of_iterations_has_a_mark_per_iteration_and_quantity():
    (panel,) = iterations_of_notes(digits_by_iteration()).panels

    assert sum(e.tag.endswith(("circle", "path")) for e in drawn(panel)) == 3 * 6


def test_a_page_needs_nothing_from_elsewhere():
    text = page_of(price_list())

    assert "default-src 'none'" in text
    assert "http" not in text.replace("http-equiv", "").replace("http://www.w3.org/2000/svg", "")
    assert "<script" not in text


def test_a_scene_cannot_write_into_the_page():
    text = page_of(price_list(scene="<script>alert(1)</script>"))

    assert "<script>" not in text
    assert "&lt;script&gt;" in text


def test_a_page_shows_every_row_and_every_refusal():
    text = page_of(price_list(refused=[("mujoco", "mj_step", "no such loop")]))

    assert text.count("<td>exudyn</td>") + text.count("<td>mujoco</td>") == 2 * len(ROWS)  # engine, and Newton by
    assert "no such loop" in text
    assert "its process ended" in text


def test_the_terminal_names_the_cheapest_way_or_says_that_there_is_none():
    console = Console(width=150, record=True, file=io.StringIO())
    console.print(cheapest_table(price_list()["cheapest"]["cycle"], "title"))
    text = console.export_text()

    assert "exudyn: static, 1e-9" in text
    assert "20.0 us (9.0 digits)" in text
    assert "nobody" in text


def test_what_is_no_engine_is_not_the_cheapest_engine():
    result = price_list(rows=[*ROWS, row(engine="refkin", digits=15.0, microseconds=1.0)])

    assert result["cheapest"]["cycle"]["position"]["9"]["engine"] == "refkin"
    assert result["cheapest_engine"]["cycle"]["position"]["9"]["engine"] == "exudyn"


def test_the_terminal_tells_crashes_and_what_was_left_out():
    text = lines(price_list(times=361, asked=1000, known=360))

    assert "a cycle has 361 of the scene's 1000 times, evenly spread" in text
    assert "1 of 361 times are outside the longest run with a certified truth: nobody is asked there" in text
    assert "mujoco, mj_step, crash: its process ended" in text


def test_a_method_is_shown_with_its_most_digits():
    table = methods_table(price_list()["rows"])

    assert list(table.columns[4].cells) == ["9.0", "4.0"]


def test_the_panels_of_all_quantities_have_one_scale():
    rows = price_list()["rows"]
    axes = [
        [e.text for e in drawn(methods_figure(rows, q)) if e.tag.endswith("text")] for q in ("position", "velocity")
    ]

    assert [t for t in axes[0] if t.startswith("10")] == [t for t in axes[1] if t.startswith("10")]


def test_scenes_of_a_class_are_called_as_one_says_it():
    tables = cheapest_tables([{**asdict(row()), "scene_class": name} for name in ("regular", "near a change point")])

    assert [*dict.fromkeys(table["scenes"] for table in tables)] == ["regular scenes", "scenes near a change point"]
