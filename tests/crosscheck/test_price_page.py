"""The diagrams and the page of a price list, and what stands on the terminal."""

from __future__ import annotations

import io
from xml.etree import ElementTree as ET

import pytest
from rich.console import Console

from crosscheck.commands.price import cheapest_table, lines, methods_table, page_of, to_json
from crosscheck.documents.page import digits_by_iteration
from crosscheck.judge.prices import Row
from crosscheck.measure.price import PriceList
from crosscheck.report.price_figures import iterations_figure, legend, looks, work_precision

SVG = "{http://www.w3.org/2000/svg}"


def row(engine="exudyn", method="static", setting="1e-3", digits=3.0, microseconds=10.0, quantity="position", note=""):
    return Row(
        engine=engine,
        method=method,
        setting=setting,
        quantity=quantity,
        digits=digits,
        digits_attainable=14.5,
        microseconds=microseconds,
        spread=0.05,
        newton_by=engine,
        note=note,
    )


ROWS = [
    row(),
    row(setting="1e-9", digits=9.0, microseconds=20.0),
    row(engine="mujoco", method="mj_step", setting="h", digits=4.0, microseconds=100.0),
    row(engine="mujoco", method="mj_step", setting="crash", digits=None, microseconds=None, note="its process ended"),
    row(digits=2.0, microseconds=30.0, quantity="velocity"),
]


def told(**more):
    given = {"scene": "four-bar", "rows": ROWS, "times": 73, "known": 73, "asked": 73, "refused": []}
    return to_json(PriceList(**{**given, **more}))


def drawn(svg):
    return ET.fromstring(str(svg))


def marks(root):
    return [e for e in root if e.tag.endswith(("circle", "path"))]


def test_every_setting_that_has_digits_and_a_price_is_a_mark():
    assert len(marks(drawn(work_precision(told()["rows"], "position")))) == 3


def test_more_digits_are_higher_and_a_higher_price_is_further_right():
    plot = [e for e in drawn(work_precision(told()["rows"], "position")) if e.tag.endswith("circle")]
    (x1, y1), (x2, y2) = ((float(e.get("cx")), float(e.get("cy"))) for e in plot[:2])

    assert y2 < y1
    assert x2 > x1


def test_prices_stand_on_a_logarithmic_axis():
    rows = [row(microseconds=price).to_json() for price in (1.0, 10.0, 100.0)]
    a, b, c = (float(e.get("cx")) for e in drawn(work_precision(rows, "position")) if e.tag.endswith("circle"))

    assert b - a == pytest.approx(c - b, abs=0.2)


def test_what_is_attainable_is_a_level():
    assert "attainable" in [e.text for e in drawn(work_precision(told()["rows"], "position")) if e.tag.endswith("text")]


def test_a_quantity_that_nobody_was_measured_at_says_so():
    assert "nothing was measured" in str(work_precision(told()["rows"], "acceleration"))


def test_no_two_routes_look_alike():
    many = [row(method=f"method {k}", engine=e).to_json() for e in ("refkin", "exudyn", "mujoco") for k in range(12)]

    assert len(set(looks(many).values())) == len(many) == len(legend(many))


def test_the_diagram_of_iterations_has_a_mark_per_iteration_and_quantity():
    assert len(marks(drawn(iterations_figure(digits_by_iteration())))) == 3 * 6


def test_a_page_needs_nothing_from_elsewhere():
    text = page_of(told())

    assert "default-src 'none'" in text
    assert "http" not in text.replace("http-equiv", "").replace("http://www.w3.org/2000/svg", "")
    assert "<script" not in text


def test_a_scene_cannot_write_into_the_page():
    text = page_of(told(scene="<script>alert(1)</script>"))

    assert "<script>" not in text
    assert "&lt;script&gt;" in text


def test_a_page_shows_every_row_and_every_refusal():
    text = page_of(told(refused=[("mujoco", "mj_step", "no such loop")]))

    assert text.count("<td>exudyn</td>") + text.count("<td>mujoco</td>") == 2 * len(ROWS)  # engine, and Newton by
    assert "no such loop" in text
    assert "its process ended" in text


def test_the_terminal_names_the_cheapest_way_or_says_that_there_is_none():
    console = Console(width=150, record=True, file=io.StringIO())
    console.print(cheapest_table(told()["cheapest"]["cycle"], "title"))
    text = console.export_text()

    assert "exudyn: static, 1e-9" in text
    assert "20.0 us (9.0 digits)" in text
    assert "nobody" in text


def test_what_is_no_engine_is_not_the_cheapest_engine():
    found = told(rows=[*ROWS, row(engine="refkin", digits=15.0, microseconds=1.0)])

    assert found["cheapest"]["cycle"]["position"]["9"]["engine"] == "refkin"
    assert found["cheapest_engine"]["cycle"]["position"]["9"]["engine"] == "exudyn"


def test_the_terminal_tells_crashes_and_what_was_left_out():
    found = lines(told(times=361, asked=1000, known=360))

    assert "priced are the first 361 of the scene's 1000 times" in found
    assert "1 of them have no certified truth and are left out" in found
    assert "mujoco, mj_step, crash: its process ended" in found


def test_a_route_is_shown_with_its_most_digits():
    table = methods_table(told()["rows"], "title")

    assert list(table.columns[4].cells) == ["9.0", "4.0"]


def test_the_panels_of_all_quantities_have_one_scale():
    rows = told()["rows"]
    axes = [
        [e.text for e in drawn(work_precision(rows, q)) if e.tag.endswith("text")] for q in ("position", "velocity")
    ]

    assert [t for t in axes[0] if t.startswith("10")] == [t for t in axes[1] if t.startswith("10")]
