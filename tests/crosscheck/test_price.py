"""The price list: digits are measured against the truth, a crash or a hang is a row, a knob that lies shows."""

from __future__ import annotations

import json
from pathlib import Path

import pytest

from crosscheck.cli import main
from crosscheck.commands.price_shown import lines, to_json
from crosscheck.judge.truth import NoTruth
from crosscheck.measure.price import price
from crosscheck.measure.price_rows import Row, cheapest, ratios, with_suspicions
from refkin.motion_laws import Polynomial
from refkin.scenes.linkages import FourBar

HERE = Path(__file__).parent
EXAMPLE = HERE.parent.parent / "examples" / "crank-rocker.toml"
KEYS = {
    "engine",
    "route",
    "knob",
    "quantity",
    "digits",
    "digits_attainable",
    "microseconds",
    "spread",
    "newton_by",
    "note",
}


def scene(**more):
    linkage = FourBar(ground=4.0, crank=1.0, coupler=3.5, rocker=3.0)
    return linkage.scene(speed=2.0, turns=0.1, samples=5, **more)


@pytest.fixture
def importable(monkeypatch):
    """Let the processes that measure find the routes made up here."""
    monkeypatch.syspath_prepend(str(HERE))


@pytest.fixture(scope="module")
def made_up():
    """The price list of the routes made up."""
    with pytest.MonkeyPatch.context() as patch:
        patch.syspath_prepend(str(HERE))
        return price(scene(), ["price_fakes"], within=8.0)


def row_of(found, route, knob="-", quantity="position"):
    (row,) = (r for r in found.rows if (r.route, r.knob, r.quantity) == (route, knob, quantity))
    return row


def test_an_answer_that_is_off_by_1e_6_sizes_has_six_digits(made_up):
    assert row_of(made_up, "off", "by 1e-6 sizes").digits == pytest.approx(6.0, abs=1e-6)


def test_an_answer_that_is_the_truth_has_as_many_digits_as_the_truth_is_proved_to(made_up):
    row = row_of(made_up, "right")

    assert 14.0 < row.digits < 17.0
    assert f"truth proved to {row.digits:.1f} digits" in row.note


@pytest.mark.parametrize("quantity", ["position", "velocity", "acceleration"])
def test_the_truth_has_no_fewer_digits_than_half_an_ulp_of_the_scene_leaves(made_up, quantity):
    row = row_of(made_up, "right", quantity=quantity)

    assert 13.0 < row.digits_attainable <= row.digits


def test_digits_are_measured_and_not_what_the_knob_says(made_up):
    row = row_of(made_up, "liar", "tolerance 1e-12")

    assert row.digits == pytest.approx(3.0, abs=1e-6)
    assert "fewer digits than at the looser setting 'tolerance 1e-9'" in row.note


def test_a_knob_that_keeps_its_word_is_not_suspected(made_up):
    assert not [r for r in made_up.rows if r.route == "honest" and "fewer" in r.note]


def test_a_time_without_an_answer_leaves_no_digits(made_up):
    row = row_of(made_up, "gap")

    assert row.digits is None
    assert "no answer at 1 of 5 times" in row.note


@pytest.mark.parametrize(("route", "told"), [("crashes", "SIGSEGV"), ("raises", "ValueError: no such thing")])
def test_a_route_that_fails_is_a_row_that_says_how(made_up, route, told):
    row = row_of(made_up, route)

    assert (row.digits, row.microseconds) == (None, None)
    assert told in row.note


def test_who_ran_newton_is_told_of_a_route_that_crashes_too(made_up):
    assert row_of(made_up, "crashes").newton_by == "nobody"


def test_a_crash_costs_no_other_route_its_price(made_up):
    assert row_of(made_up, "right").microseconds > 0.0
    assert row_of(made_up, "slower with each order").microseconds > 0.0


def test_a_route_that_gives_position_alone_has_no_row_for_velocity(made_up):
    assert {r.quantity for r in made_up.rows if r.route == "position alone"} == {"position"}


def test_each_quantity_costs_what_it_takes_and_no_more(made_up):
    costs = [row_of(made_up, "slower with each order", quantity=q).microseconds for q in ("position", "velocity")]

    # Sleeps of 20 and 60 ms over five configurations; on a busy machine sleeps last longer.
    assert costs[1] - costs[0] == pytest.approx(40e-3 / 5 * 1e6, rel=0.5)


def test_where_all_comes_from_one_run_every_quantity_costs_the_same(made_up):
    assert len({r.microseconds for r in made_up.rows if r.route == "all at once"}) == 1


def test_a_refusal_is_told(made_up):
    assert "made up, refused: refused: it does not like four-bars" in lines(to_json(made_up))


def test_a_route_that_does_not_come_back_is_a_row_and_the_next_is_priced(importable):
    found = price(scene(effects=()), ["price_hanging"], within=1.0, patience=1.0)

    assert "no answer within 1 s" in row_of(found, "hangs").note
    assert row_of(found, "right").microseconds > 0.0


def test_what_a_scene_does_not_call_for_has_no_row(importable):
    found = price(scene(effects=("acceleration",)), ["price_fakes"], within=1.0)

    assert {r.quantity for r in found.rows} == {"position", "acceleration"}


def test_a_scene_without_a_certified_pose_has_no_prices(importable):
    linkage = FourBar(ground=3.0, crank=1.0, coupler=3.0, rocker=1.0)
    folded = linkage.scene(times=[0.0], law=Polynomial(coefficients=(0.0,)))

    with pytest.raises(NoTruth, match="no pose is certified"):
        price(folded, ["price_fakes"], within=1.0)


def priced(digits, microseconds, route="newton", engine="made up", quantity="position", attainable=15.0, knob="-"):
    return Row(
        engine=engine,
        route=route,
        knob=knob,
        quantity=quantity,
        digits=digits,
        digits_attainable=attainable,
        microseconds=microseconds,
        spread=0.1,
        newton_by="nobody",
    )


def test_the_cheapest_way_is_the_least_price_among_those_with_so_many_digits():
    rows = [priced(3.1, 1.0), priced(9.0, 5.0), priced(9.5, 4.0), priced(15.0, 50.0), priced(None, 0.1)]
    found = cheapest(rows)["position"]

    assert [found[str(d)] and found[str(d)]["microseconds"] for d in (3, 6, 9, 12, 14)] == [1.0, 4.0, 4.0, 50.0, 50.0]


def test_where_nobody_has_so_many_digits_there_is_no_cheapest_way():
    assert cheapest([priced(3.1, 1.0)])["position"]["6"] is None


def test_a_route_that_was_not_timed_is_no_cheapest_way():
    assert cheapest([priced(15.0, None)])["position"]["3"] is None


def test_beyond_what_is_attainable_a_loss_of_digits_is_not_suspicious():
    rows = [priced(15.0, 1.0, attainable=9.0), priced(9.5, 1.0, attainable=9.0)]

    assert [row.note for row in with_suspicions(rows)] == ["", ""]


def test_prices_are_tracked_in_units_of_the_reference():
    rows = [priced(15.0, 200.0, "Newton, analytic Jacobian", "refkin", knob="to round-off"), priced(9.0, 50.0)]

    assert ratios(rows)["made up", "newton", "-", "position"] == 0.25


@pytest.mark.parametrize("arguments", [["no such scene.toml"], [str(EXAMPLE), "--page", "no such folder/page.html"]])
def test_a_request_that_makes_no_sense_is_told_in_one_line_before_anything_is_measured(arguments, capsys):
    with pytest.raises(SystemExit) as ended:
        main(["price", *arguments])
    told = capsys.readouterr()

    assert ended.value.code == 2
    assert "no such" in told.err
    assert told.out == ""


def test_the_command_prints_one_object_with_the_promised_keys(tmp_path, capsys):
    path = tmp_path / "scene.toml"
    text = EXAMPLE.read_text(encoding="utf-8").replace("count = 73", "count = 3")
    path.write_text(text.replace('["acceleration", "velocity"]', "[]"), encoding="utf-8")
    with pytest.raises(SystemExit) as ended:
        main(["price", str(path), "--json", "--page", str(tmp_path / "page.html")])
    told = json.loads(capsys.readouterr().out)

    assert ended.value.code == 0
    assert (told["schema"], told["scene"]) == (1, "crank-rocker")
    assert all(set(row) == KEYS for row in told["rows"])
    assert {row["engine"] for row in told["rows"]} == {"refkin", "scipy", "exudyn", "mujoco", "pinocchio"}
    assert told["cheapest"]["position"]["12"]["microseconds"] > 0.0
    assert "<svg" in (tmp_path / "page.html").read_text(encoding="utf-8")
