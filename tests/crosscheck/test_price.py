"""The price list: digits are measured against the truth, a crash or a hang is a row, a setting that lies shows."""

from __future__ import annotations

import json
import math
from dataclasses import asdict, astuple, replace
from functools import partial
from types import SimpleNamespace
from unittest.mock import MagicMock

import numpy as np
import pytest

import refkin
from crosscheck.commands import price as priced_by
from crosscheck.commands.price import lines, print_repeated, to_json
from crosscheck.engines.methods import PRICED, Model
from crosscheck.judge.prices import Offer, Repeated, cheapest, may_be_cheapest, repeated, settings, with_suspicions
from crosscheck.judge.truth import CertifiedTruth, NoTruth
from crosscheck.measure import price as measuring
from crosscheck.measure import price_process
from crosscheck.measure.check import key_of
from crosscheck.measure.price import PriceList, price
from crosscheck.measure.price_process import BULK, CYCLE, JUDGED, PriceQuestion, measure, nearest_first, questions
from crosscheck.report.measured import measured
from crosscheck.workers import timing
from refkin.motion_laws import Polynomial
from refkin.scenes.files import to_dict
from tests.crosscheck import price_fakes
from tests.linkages import PARALLELOGRAM, ROCKER
from tests.places import EXAMPLES

from .report_records import QUANTITIES, price_row

KEYS = {"engine", "method", "setting", "quantity", "newton_by", "note"}
KEYS |= {"digits_attainable", "microseconds_to_build", "unasked_bulk"}
KEYS |= {f"{number}{poses}" for number in ("digits", "microseconds", "spread") for poses in ("", "_one", "_bulk")}


def scene(**more):
    return ROCKER.scene(speed=2.0, turns=0.1, samples=5, **more)


MADE_UP, HANGING = (f"{price_fakes.__file__}:{name}" for name in ("MadeUp", "Hanging"))


@pytest.fixture(scope="module")
def made_up():
    """The price list of the methods made up."""
    return price(scene(), [MADE_UP], within=15.0)


def row_of(actual, method, setting="-", quantity="position"):
    (row,) = (r for r in actual.rows if (r.method, r.setting, r.quantity) == (method, setting, quantity))
    return row


def test_an_answer_that_is_off_by_1e_6_sizes_has_six_digits(made_up):
    assert row_of(made_up, "off", "by 1e-6 sizes").digits == pytest.approx(6.0, abs=1e-6)


def test_an_answer_that_is_the_truth_has_as_many_digits_as_the_truth_is_proved_to(made_up):
    row = row_of(made_up, "right")

    assert 14.0 < row.digits < 17.0
    assert f"truth proved to {row.digits:.1f} digits" in row.note


@pytest.mark.parametrize("quantity", QUANTITIES)
def test_the_truth_has_no_fewer_digits_than_half_an_ulp_of_the_scene_leaves(made_up, quantity):
    row = row_of(made_up, "right", quantity=quantity)

    assert 13.0 < row.digits_attainable <= row.digits


def test_digits_are_measured_and_not_what_the_setting_says(made_up):
    row = row_of(made_up, "liar", "tolerance 1e-12")

    assert row.digits == pytest.approx(3.0, abs=1e-6)
    assert "fewer digits than at the looser setting 'tolerance 1e-9'" in row.note
    assert not [r for r in made_up.rows if r.method == "honest" and "fewer" in r.note]


def test_digits_are_those_of_the_calls_that_are_timed(made_up):
    """A model that is right the first time alone is sold as what it is afterwards."""
    row = row_of(made_up, "stale")

    assert (row.digits, row.digits_one) == pytest.approx((3.0, 3.0), abs=1e-6)


def test_a_time_without_an_answer_leaves_no_digits(made_up):
    row = row_of(made_up, "gap")

    assert row.digits is None
    assert "no answer at 1 of 5 times" in row.note


@pytest.mark.parametrize(
    ("route", "told"),
    [
        ("crashes", "SIGSEGV"),
        ("raises", "ValueError: no such thing"),
        ("raises while it builds", "ValueError: no such thing"),
    ],
)
def test_a_method_that_fails_is_a_row_that_says_how_and_costs_no_other_its_price(made_up, route, told):
    row = row_of(made_up, route)

    assert (row.digits, row.microseconds, row.newton_by) == (None, None, "nobody")
    assert told in row.note
    assert row_of(made_up, "right").microseconds > 0.0


def test_what_an_engine_says_of_itself_is_told_as_it_says_it(made_up):
    assert row_of(made_up, "ends").note == "it does not like four-bars"


def test_a_method_that_gives_position_alone_has_no_row_for_velocity(made_up):
    assert {r.quantity for r in made_up.rows if r.method == "position alone"} == {"position"}


def test_a_refusal_is_told(made_up):
    assert "made up, refused: refused: it does not like four-bars" in lines(to_json(made_up))


def test_a_method_that_does_not_come_back_is_a_row_and_the_next_is_priced():
    prices = price(scene(effects=()), [HANGING], within=1.0, patience=4.0)

    assert "no answer within 4 s" in row_of(prices, "hangs").note
    assert row_of(prices, "right").microseconds > 0.0


def test_what_a_scene_does_not_call_for_has_no_row():
    prices = price(scene(effects=("acceleration",)), [MADE_UP], within=1.0)

    assert {r.quantity for r in prices.rows} == {"position", "acceleration"}


def test_a_scene_without_a_certified_pose_has_no_prices():
    folded = PARALLELOGRAM.scene(times=[0.0], law=Polynomial(coefficients=(0.0,)))

    with pytest.raises(NoTruth, match="no pose is certified"):
        price(folded, [MADE_UP], within=1.0)


def priced(digits, microseconds, method="newton", attainable=15.0, **more):
    return price_row(digits=digits, microseconds=microseconds, method=method, digits_attainable=attainable, **more)


def best(rows, poses="cycle"):
    return cheapest([asdict(row) for row in rows])[poses]["position"]


def test_the_second_best_is_that_of_another_method():
    rows = [priced(9.0, 5.0), priced(9.0, 5.1, setting="looser"), priced(9.0, 6.5, "chord"), priced(9.0, 9.0, "other")]
    value = best(rows)["9"]

    assert (value["method"], value["second"]["method"], value["second"]["microseconds"]) == ("newton", "chord", 6.5)


def test_what_was_called_once_and_may_be_cheaper_is_named_beside_the_second_best():
    """The first call of a method took twice what it takes: its twin was said to win, or stood for the second."""
    rows = [priced(9.0, 5.0), priced(9.0, 6.5, "chord")]
    once = [replace(priced(9.0, price, "twin"), spread=None) for price in (14.9, 15.1)]
    found = [best([*rows, one])["9"] for one in once]

    assert [(one["second"]["method"], one["differs"]) for one in found] == [("chord", True)] * 2
    assert [one["unsure"] and one["unsure"]["method"] for one in found] == ["twin", None]
    assert [repeated(*[of_all(*rows, one)] * 2).cells for one in once] == [0, 6]


@pytest.mark.parametrize(("price", "differs"), [(5.9, False), (6.5, True)])
def test_two_prices_differ_if_their_difference_exceeds_the_spread_of_both(price, differs):
    assert best([priced(9.0, 5.0), priced(9.0, price, "chord")])["9"]["differs"] is differs


def test_what_was_timed_once_is_never_known_to_differ():
    """It was taken to be off by two thirds of its price at most, and was by 86 %."""
    once, other = (Offer("made up", "newton", "-", 9.0, *price, "nobody") for price in ((1.0, None), (100.0, 0.0)))

    assert not once.differs(other)
    assert not other.differs(once)
    assert other.differs(replace(once, spread=0.0))


def test_a_rate_is_offered_with_the_position_that_it_is_one_of():
    """A setting with nine digits of velocity and five of position was the cheapest way to nine of velocity."""
    loose = [priced(5.0, 1.0, setting="loose"), priced(9.5, 2.0, setting="loose", quantity="velocity")]
    tight = [priced(12.0, 3.0, setting="tight"), priced(9.2, 4.0, setting="tight", quantity="velocity")]
    alone = [priced(None, 0.1, setting="none"), priced(9.2, 0.1, setting="none", quantity="velocity")]
    rows = [asdict(row) for row in (*loose, *alone, *tight)]
    found = [settings(rows, "cycle", "velocity", digits) for digits in (9, 5)]

    assert [[(offer.setting, offer.digits) for offer in listed] for listed in found] == [
        [("tight", 9.2)],
        [("loose", 5.0), ("tight", 9.2)],
    ]
    assert [offer.setting for offer in settings(rows[::-1], "cycle", "position", 5)] == ["loose", "tight"]


def test_one_pose_a_cycle_and_bulk_each_have_their_own_winner():
    many = {"digits_bulk": 9.0, "microseconds_bulk": 1.0, "spread_bulk": 0.0}
    rows = [
        priced(9.0, 5.0),
        replace(priced(9.0, 50.0, "batch"), **many),
        replace(priced(9.0, 9.0, "now"), **{"digits_one": 9.0, "microseconds_one": 20.0}),
    ]

    assert [best(rows, poses)["9"]["method"] for poses in ("one", "cycle", "bulk")] == ["now", "newton", "batch"]


@pytest.mark.parametrize(("share", "answers"), [(1.0, False), (0.05, True), (0.0, False)])
def test_a_process_that_gets_a_small_part_of_a_busy_machine_is_no_hang(monkeypatch, share, answers):
    """It answers after 40 s: none that worked all the time, nor that slept, is given more than 20."""
    now = [0.0]

    def poll(seconds):
        now[0] += seconds
        return now[0] >= 40.0

    monkeypatch.setattr(measuring, "time", SimpleNamespace(monotonic=lambda: now[0]))
    monkeypatch.setattr(measuring, "seconds_of", lambda process: share * now[0])
    assert measuring._says_something(SimpleNamespace(poll=poll), 0, patience=20.0) is answers


def of_all(*rows):
    """Return the winners of rows, among all as among engines."""
    return dict.fromkeys(("cheapest", "cheapest_engine"), cheapest([asdict(row) for row in rows]))


def test_winners_within_the_spread_count_for_nothing():
    near, known = (of_all(priced(9.0, 5.0), priced(9.0, price, "chord")) for price in (5.1, 9.0))

    assert repeated(near, near) == Repeated(0, 0, 0, 0, [])
    assert not print_repeated(near, near, as_json=False)
    assert print_repeated(known, known, as_json=False)


def test_every_winner_that_the_earlier_list_has_ahead_counts_once(capsys):
    """Also where the later one has another within the spread, or nobody: so no claim is out of sight."""
    rows = [priced(9.0, 5.0), priced(9.0, 9.0, "chord")]
    twice = of_all(*rows, *(replace(row, quantity="velocity") for row in rows))
    near = of_all(priced(9.0, 9.0), priced(9.0, 8.9, "chord"), priced(None, 1.0, quantity="velocity"))

    cells = 2 * 2 * 3  # the same two at 3, 6 and 9 digits, and in both lists
    assert repeated(twice, twice) == Repeated(2, 2, cells, cells, [])
    assert astuple(repeated(twice, near))[:4] == (2, 0, cells, 0)
    assert repeated(twice, near).changed[::3] == [
        "one cycle, 3 digits of position: made up, newton before, made up, chord now",
        "one cycle, 3 digits of velocity: made up, newton before, nobody now",
    ]
    assert repeated(near, twice) == Repeated(0, 0, 0, 0, [])
    half = of_all(*rows, *(replace(row, quantity="velocity") for row in (priced(9.0, 9.0), priced(9.0, 5.0, "chord"))))
    assert not print_repeated(twice, half, as_json=False)
    assert not print_repeated(twice, half, as_json=True)
    *_, said, cells, data = capsys.readouterr().out.splitlines()

    assert said == (
        "cheapest again are 1 of 2 winners that the earlier list has ahead of the second by more than the spread: 50.0%"
    )
    assert cells == "they are so in 6 of 12 cells of the tables"
    found = json.loads(data)["repeated"]
    assert len(found.pop("changed")) == 3
    assert found == {"pairs": 2, "same": 1, "cells": 12, "same_cells": 6, "share": 0.5}


def test_in_bulk_nobody_is_ahead_of_one_that_was_not_asked_and_may_be_cheaper():
    """The list said so, and the winner was dearer by twice."""
    many = {"digits_bulk": 9.0, "spread_bulk": 0.0}
    rows = [replace(priced(9.0, 5.0, str(price)), **many, microseconds_bulk=price) for price in (1.0, 2.0)]
    unasked = [replace(priced(9.0, 5.0, "batch"), unasked_bulk=price) for price in (0.5, 2.9, 3.1)]

    found = [best([*rows, *more], "bulk")["9"]["unsure"] for more in ([], *([one] for one in unasked))]
    assert [one and one["microseconds"] for one in found] == [None, 0.5, 2.9, None]
    assert best([*rows, replace(unasked[0], digits=2.0)], "bulk")["9"]["unsure"] is None
    assert best([*rows, unasked[0]])["9"] == best(rows)["9"]
    named = [may_be_cheapest(list(map(asdict, [*rows, *more]))) for more in ([], unasked[1:2], unasked[2:])]
    assert named == [[], [("made up", "batch", "-")], []]


def test_the_cheapest_way_is_the_least_price_among_those_with_so_many_digits():
    given = [(3.1, 1.0), (9.0, 5.0), (9.5, 4.0), (15.0, 50.0), (None, 0.1)]
    rows = [priced(*row, setting=str(k)) for k, row in enumerate(given)]
    offers = best(rows)

    assert [offers[str(d)] and offers[str(d)]["microseconds"] for d in (3, 6, 9, 12, 14)] == [1.0, 4.0, 4.0, 50.0, 50.0]


def test_where_nobody_has_so_many_digits_or_a_price_there_is_no_cheapest_way():
    assert best([priced(3.1, 1.0)])["6"] is None
    assert best([priced(15.0, None)])["3"] is None


def test_beyond_what_is_attainable_a_loss_of_digits_is_not_suspicious():
    rows = [priced(15.0, 1.0, attainable=9.0), priced(9.5, 1.0, attainable=9.0)]

    assert [row.note for row in with_suspicions(rows)] == ["", ""]


@pytest.fixture
def again(tmp_path, monkeypatch, command):
    """`price --again` of the scene, against what an earlier run printed: it measures nothing, and finds the same."""
    rows = [priced(9.0, 5.0), priced(9.0, 9.0, "chord")]
    prices = PriceList(scene().name, key_of(scene()), rows, times=5, known=5, asked=5, refused=[])
    measured_now = []

    def run(change=lambda before: None, **more):
        before = json.loads(json.dumps(to_json(prices)))
        change(before)
        (tmp_path / "before.json").write_text(json.dumps(before), encoding="utf-8")
        monkeypatch.setattr(priced_by, "measured", lambda *_, **__: measured_now.append(1) or prices)
        options = [word for name, value in more.items() for word in (f"--{name}", value)]
        return command("price", scene(), "--again", tmp_path / "before.json", *options), measured_now

    return run


def test_a_list_is_measured_again_where_it_is_of_the_scene(again):
    (code, out, _), measured_now = again()
    (renamed, _, _), _ = again(lambda before: before.update(scene="under another name"))

    assert (code, renamed, len(measured_now)) == (0, 0, 2)
    assert "cheapest again are 1 of 1 winners" in out


@pytest.mark.parametrize(
    ("change", "said"),
    [
        (lambda b: b.update(scene="slider-crank", key="0" * 16), "got one of 'slider-crank' (0000000000000000)"),
        (lambda b: b.update(key="0" * 16), f"got one of '{scene().name}' (0000000000000000)"),
        (lambda b: b.update(engines=["exudyn"]), "expected a price list of exudyn, mujoco, pinocchio, refkin"),
        (lambda b: b.pop("versions"), "before.json cannot be read: versions: missing"),
        (lambda b: b.pop("key"), "what `crosscheck price --json` prints: before.json cannot be read: key: missing"),
        (lambda b: b.update(rows=3), "what `crosscheck price --json` prints: before.json cannot be read: rows: 3"),
        (lambda b: b["rows"][0].update(quantity="jerk"), "rows.0.quantity: 'jerk'; input should be 'position'"),
        (lambda b: b["rows"][0].update(digits="many"), "rows.0.digits: 'many'"),
        (lambda b: b["rows"][0].update(microseconds=-1.0), "rows.0.microseconds: -1.0; input should be greater than"),
        (lambda b: b["rows"][0].update(microseconds=1e-9), "expected the winners that its rows have, got others"),
        (lambda b: b.update(rows=[]), "expected the winners that its rows have, got others"),
        (lambda b: b.update(schema=2), "schema: 2; input should be 3"),
    ],
)
def test_the_list_of_another_scene_is_refused_in_one_line_before_anything_is_measured(again, tmp_path, change, said):
    """Planted: 27 of 37 winners were the same, of two scenes that have nothing in common."""
    (code, out, err), measured_now = again(change)

    assert (code, out, measured_now, err.count("\n")) == (2, "", [], 1)
    assert said in err
    assert "before.json" in err
    assert "--again" in err


@pytest.mark.parametrize(
    ("change", "said"),
    [
        (lambda b: b["versions"].update(exudyn="1.0", numpy="1.26"), ("exudyn 1.0", "numpy 1.26")),
        (lambda b: b["machine"].update(processor="an abacus"), ("processor an abacus",)),
        (lambda b: b["versions"].update(chrono="9.0"), ("chrono 9.0, now none",)),
    ],
)
def test_other_versions_or_another_machine_of_the_earlier_list_are_told(again, change, said):
    """Who wins depends on them: a list of another year was compared as if nothing but the time had changed."""
    (code, out, err), _ = again(change)

    assert (code, "cheapest again are 1 of 1 winners" in out) == (0, True)
    assert "before.json was measured with other versions, or elsewhere: " in err
    assert all(text in err for text in said)
    assert "was measured with" not in again()[0].stderr


def test_a_list_is_printed_though_its_page_cannot_be_written(again, tmp_path):
    """It was measured for a minute, and lost."""
    (page := tmp_path / "page.html").symlink_to("/dev/full")
    (code, out, err), _ = again(page=page)

    assert (code, "cheapest again are 1 of 1 winners" in out) == (4, True)
    assert "page.html: No space left on device" in err


def test_the_command_prints_one_object_with_the_promised_keys(tmp_path, command):
    path = tmp_path / "scene.toml"
    text = (EXAMPLES / "crank-rocker.toml").read_text(encoding="utf-8").replace("count = 73", "count = 3")
    path.write_text(text.replace('["acceleration", "velocity"]', "[]"), encoding="utf-8")
    code, out, err = command("price", path, "--json", "--page", tmp_path / "page.html")
    data = json.loads(out)

    assert code == 0
    assert err.startswith("this takes up to 50 s of the processor")
    assert (data["schema"], data["scene"], data["key"]) == (3, "crank-rocker", key_of(refkin.load(path)))
    assert (data["engines"], data["machine"], data["versions"]) == (sorted(PRICED), timing.machine(), timing.versions())
    assert all(set(row) == KEYS for row in data["rows"])
    assert {row["engine"] for row in data["rows"]} == {*PRICED}
    assert data["cheapest"]["cycle"]["position"]["12"]["microseconds"] > 0.0
    assert "<svg" in (tmp_path / "page.html").read_text(encoding="utf-8")


def test_what_stands_in_a_table_is_timed_first_then_what_is_near_and_what_costs_three_times_as_much_not_at_all():
    """Of one method the setting that one call found cheapest was timed alone: 9.7 us were published for 6.7."""

    def run(engine, name, setting, seconds, digits):
        method = SimpleNamespace(key=(engine, name, setting), newton_by="", at_once=False)
        answered = {quantity: (digits, "") for quantity in QUANTITIES}
        return price_process._Run(method, 2, {}, {"cycle": seconds}, {"cycle": answered})

    given = [
        ("refkin", "best", "as good", 1.2, 9.5),
        ("refkin", "best", "to nine", 1.0, 9.5),
        ("refkin", "second", "", 8.0, 9.5),
        ("refkin", "third", "", 9.0, 9.5),
        ("refkin", "best", "to fourteen", 10.0, 14.5),
        ("refkin", "third", "to fourteen", 50.0, 14.5),
        ("refkin", "second", "to fourteen", 40.0, 14.5),
        ("refkin", "best", "to two", 0.1, 2.0),
        ("refkin", "no answer", "", 0.1, None),
        ("one engine", "own", "", 30.0, 9.5),
        ("one engine", "own", "dear", 105.0, 9.5),
        ("another engine", "own", "", 20.0, 9.5),
        ("another engine", "other", "", 42.0, 9.5),
    ]
    ranked = nearest_first([run(*each) for each in given], "cycle")
    found = [(round(min(away.values()), 2), *run.method.key) for away, run in ranked]

    assert found == [
        (1.0, "refkin", "best", "to nine"),
        (1.0, "refkin", "second", ""),
        (1.0, "refkin", "best", "to fourteen"),
        (1.0, "another engine", "own", ""),
        (1.0, "one engine", "own", ""),
        (1.0, "refkin", "second", "to fourteen"),
        (1.0, "another engine", "other", ""),
        (1.2, "refkin", "best", "as good"),
        (3.5, "one engine", "own", "dear"),
        (5.0, "refkin", "third", "to fourteen"),
        (9.0, "refkin", "third", ""),
        (math.inf, "refkin", "best", "to two"),
        (math.inf, "refkin", "no answer", ""),
    ]


def test_of_a_setting_the_quantities_are_timed_of_which_it_may_be_the_cheapest():
    """Its position alone is near the cheapest, which is told by what part of a call that takes."""
    answered = {quantity: (9.5, "") for quantity in QUANTITIES}
    runs = []
    for name, took, parts in (("best", 1.0, {0: 0.6, 1: 0.9}), ("second", 1.5, {}), ("third", 5.0, {0: 0.2, 1: 0.7})):
        method = SimpleNamespace(key=("one", name, ""), newton_by="", at_once=name == "second")
        runs.append(price_process._Run(method, 2, {}, {"cycle": took}, {"cycle": answered}, parts))

    found = [(run.method.key[1], *(round(x, 2) for x in away.values())) for away, run in nearest_first(runs, "cycle")]
    assert found == [("best", 1.0, 1.0, 1.0), ("second", 2.5, 1.0, 1.0), ("third", 1.0, 3.89, 5.0)]


def test_what_part_of_a_call_position_takes_is_known_of_the_quickest_too(monkeypatch):
    """Below 2 ms it was taken to be a part of these: a third of what it is, and others seemed three times as far."""
    took = iter([3e-4, 5e-4])
    monkeypatch.setattr(price_process, "turn", lambda call: next(took))
    run = price_process._Run(SimpleNamespace(at_once=False), 2, {"cycle": []}, {"cycle": 6e-4}, {})
    run.look()

    assert [run.expected("cycle", order) for order in range(3)] == pytest.approx([3e-4, 5e-4, 6e-4])


def rows_of_cycle(timed, **more):
    """Return the rows of a method that was asked for a cycle: (seconds, spread) of it by the highest order."""
    key, nines = ("made up", "newton", ""), dict.fromkeys(QUANTITIES, (9.0, ""))
    answered = {key: {"newton_by": "nobody", "note": "", "cycle": nines, **more}}
    took = {(key, "cycle", order): seconds for order, seconds in timed.items()}
    known = {"answered": answered, "attainable": dict.fromkeys(QUANTITIES, 15.0)}
    return list(measuring._rows(scene(), measuring._Progress(**known, timed=took)))


def test_a_price_that_was_timed_with_rates_alone_says_so():
    notes = [row.note for row in rows_of_cycle({2: (6e-6, 0.1)})]

    assert notes == ["one cycle timed with rates", "one cycle timed with rates", ""]


class Clock:
    """A clock that the made-up methods alone set forward: what is measured is theirs to the last digit."""

    def __init__(self, sent):
        self.now, self.sent = 0.0, sent

    def process_time(self):
        return self.now

    monotonic = process_time  # there is no clock on the wall: whoever asked it would fail

    def method(self, name, call, pose, most=BULK, off=0.0, setting="", **more):
        """A method that takes so long for a call and for each pose in it, twice for two levels, and answers so many."""

        built = []

        def build(scene):
            self.now += 0.25 if built else 0.75  # the first time a library is loaded
            built.append(scene)
            return Model(partial(solve, scene), list)

        def solve(scene, order):
            np.square([1e200])  # an integrator that runs away overflows, of which nobody is to be warned
            self.sent.append(("asked", ("made up", name, setting)))
            self.now += (call + pose * len(scene.times)) * (order + 1)
            return price_fakes._moved(off if len(scene.times) <= most else math.nan, scene, order)

        return replace(price_fakes.made(name, setting, solve, **more), build=build)


@pytest.fixture(scope="module")
def sent():
    """What the process says of methods whose cost is known, in a pipe of a list."""
    clock = Clock(messages := [])
    listed = [
        clock.method("plain", 1e-2, 1e-4),
        clock.method("steps", 2e-2, 5e-3, steps=True),
        clock.method("at once", 3e-2, 2e-4, at_once=True),
        clock.method("cycles alone", 1e-2, 3e-4, most=CYCLE),
        clock.method("dear", 9e-2, 9e-4),
    ]
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(price_process, "time", clock)
        patch.setattr(timing, "time", clock)
        patch.setattr(price_process, "methods", lambda producer, use: listed)
        pipe = SimpleNamespace(send=messages.append)
        listed.append(clock.method("failed", 1e-2, 1e-2))
        measure(to_dict(scene()), ["made up"], {("made up", "failed", "")}, 1e6, pipe)
    return messages


def timings(sent, name):
    return {message[2:4]: message[4] for message in sent if message[0] == "timed" and message[1][1] == name}


TIMES, LAST = len(scene().times), -1


def test_a_price_is_what_one_new_pose_costs_in_a_cycle_alone_and_in_bulk(sent):
    """So much for a call, a hundredth of it for a pose, twice for velocity too: shared by all poses of a call."""
    alike = {poses: 1e-2 / count + 1e-4 for poses, count in (("cycle", TIMES), ("one", 1), ("bulk", BULK))}
    expected = {(poses, order): (order + 1) * cost for poses, cost in alike.items() for order in (0, 1, 2)}
    actual = timings(sent, "plain")

    assert {at: actual[at] for at in expected} == pytest.approx(expected)
    assert {at: actual[at] for at in actual.keys() - expected} == pytest.approx(
        {(poses, LAST): 3 * cost for poses, cost in alike.items()}
    )


def test_what_cannot_be_the_cheapest_is_not_called_again(sent):
    assert set(timings(sent, "dear")) == {("cycle", LAST), ("one", LAST)}
    asked = sent.count(("asked", ("made up", "dear", "")))
    assert asked == 1 + 3  # a cycle, and three poses of it: so long that one tells


def test_a_method_that_steps_in_time_goes_one_pose_before_the_one_that_is_new(sent):
    assert timings(sent, "steps")["one", 0] == pytest.approx(2e-2 + 2 * 5e-3)
    assert timings(sent, "plain")["one", 0] == pytest.approx(1e-2 + 1e-4)


def test_in_bulk_the_first_pose_and_the_last_are_judged_and_others_in_any_part_of_a_block():
    judged = range(0, BULK, JUDGED)

    assert judged[-1] == BULK - 1
    assert all(len({k % block for k in judged}) == block for block in (8, 16, 64, 100))


def test_what_has_no_answer_in_bulk_is_priced_but_there(sent):
    digits = {message[1][1]: message[3] for message in sent if message[0] == "digits"}

    assert {poses for poses, _ in timings(sent, "cycles alone")} == {"cycle", "one"}
    judged = len(range(0, BULK, JUDGED))
    assert digits["cycles alone"]["position"] == (None, f"no answer at {judged} of {judged} times")
    assert min(digits["plain"][quantity][0] for quantity in QUANTITIES) > 12.0


def test_a_cycle_is_the_longest_run_of_times_that_have_a_truth(monkeypatch):
    """To look for a pose that is not there took a method fourteen times as long as a pose."""

    class Truth(CertifiedTruth):
        def __init__(self, scene):
            super().__init__(scene)
            self.known[[k for k, t in enumerate(scene.times) if t in lost]] = False

    monkeypatch.setattr(price_process, "CertifiedTruth", Truth)
    times = scene().times
    for gone, run in (((), times), (times[-2:], times[:-2]), (times[1:2], times[2:])):
        lost = {*gone}
        ((cycle, truth),) = questions(scene())["cycle"].scenes

        assert (cycle.times, truth.known.all()) == (run, True)
        assert questions(scene())["bulk"].scenes[0][0].times[-1] == run[-1]


def test_of_a_single_time_a_pose_is_asked_for_from_the_estimates_and_nobody_steps():
    """What steps from one time to the next was the cheapest: it had no step to take."""
    asked, messages = questions(replace(scene(), times=scene().times[:1])), []
    steps = price_fakes.made("steps", "", partial(price_fakes._moved, 0.0), steps=True)
    pipe = SimpleNamespace(send=messages.append)

    assert set(asked) == {"cycle", "one"}
    assert asked["one"].scenes[0][0].times == scene().times[:1]
    assert price_process._answered(steps, asked, 2, pipe) is None
    assert messages[-1][0] == "refused"
    assert price_process._answered(replace(steps, steps=False), asked, 2, pipe) is not None


def test_what_may_be_the_cheapest_in_bulk_is_told_by_what_more_poses_take(monkeypatch):
    """One that gains by many is asked though a cycle is dear; who had no time is told, with what is expected of it.

    And one that finds all poses together: of what they cost a cycle says nothing. The fast path without evidence was
    left out, as its proofs, which are asked for together, seemed to cost a third of it.
    """
    listed = {"slow": (20.0, 4 * 0.2), "gains": (30.0, 4 * 500.0), "together": (20.0, 0.0), "next": (4.0, 4 * 0.04)}
    digits = {poses: dict.fromkeys(QUANTITIES, (9.0, "")) for poses in ("one", "cycle")}
    runs, who = [], {"newton_by": "", "steps": False, "at_once": False}
    for name, (cycle, one) in listed.items():
        method = SimpleNamespace(key=("made up", name, ""), together=name == "together", **who)
        runs.append(price_process._Run(method, 2, {}, {"cycle": cycle, "one": one}, digits))
    asked = {
        "cycle": PriceQuestion(((SimpleNamespace(times=range(73)), None),), ()),
        "one": PriceQuestion(((SimpleNamespace(times=[0.0]), None),) * 4, ()),
        "bulk": None,
    }
    clock = iter([0.0, 1.0, 1.0, 9.0])
    monkeypatch.setattr(price_process, "time", SimpleNamespace(process_time=lambda: next(clock)))
    monkeypatch.setattr(price_process, "_digits", lambda run, poses, question: digits["cycle"])
    messages = []
    first = list(price_process._in_bulk(runs, asked, 10.0, SimpleNamespace(send=messages.append)))

    assert [run.method.key[1] for run in first] == ["together", "gains"]
    assert [m[1:] for m in messages if m[0] == "unasked"] == [(("made up", "next", ""), pytest.approx(3.96 / 72))]


def test_where_all_comes_at_once_the_highest_order_alone_is_timed(sent):
    assert set(timings(sent, "at once")) == {
        (poses, order) for poses in ("one", "cycle", "bulk") for order in (LAST, 2)
    }


def test_of_a_method_its_build_is_told_and_of_one_that_failed_nothing(sent):
    answers = {message[1]: message[2] for message in sent if message[0] == "answered"}

    builds = {name: answer["build"] for (_, name, _), answer in answers.items()}
    assert builds == pytest.approx(dict.fromkeys(("plain", "steps", "at once", "cycles alone", "dear"), 0.25))
    assert sent[-1] == ("done",)


def test_what_builds_its_model_in_every_call_has_no_price_of_building():
    asked = {"cycle": questions(scene())["cycle"]}
    anew, messages = replace(price_fakes.made("anew", "", None), build=None, answer=refkin.solve), []
    price_process._answered(anew, asked, 2, SimpleNamespace(send=messages.append))

    assert messages[-1][2]["build"] is None


def test_bulk_is_a_thousand_poses_over_the_same_time():
    ((bulk, _),) = questions(scene())["bulk"].scenes

    assert (len(bulk.times), bulk.times[0], bulk.times[-1]) == (1000, scene().times[0], scene().times[-1])


@pytest.mark.parametrize(("turns", "told"), [((1.0, 1.0, 1.5), 0.5), ((1.0,), None)])
def test_the_spread_of_a_price_is_that_of_its_rounds_and_a_single_one_has_none(monkeypatch, turns, told):
    method, messages = SimpleNamespace(key=("made up", "newton", ""), newton_by="", at_once=True, steps=False), []
    asked = {"one": PriceQuestion(((SimpleNamespace(times=[0.0]), None),), ())}
    digits = {"one": dict.fromkeys(QUANTITIES, (9.0, ""))}
    run = price_process._Run(method, 2, {"one": [Model(lambda order: None, list)]}, {"one": 1e-3}, digits)
    monkeypatch.setattr(
        price_process, "timed_in_turns", lambda calls, **_: dict.fromkeys(calls, timing.Timing(1.0, 0.5, turns))
    )
    price_process._time([run], "one", asked, math.inf, SimpleNamespace(send=messages.append))

    assert [m[2:] for m in messages if m[0] == "timed" and m[3] != LAST] == [("one", 2, 1.0, told)]


def test_of_two_answers_the_fewer_digits_count_and_none_at_all_are_the_fewest():
    none, five, nine = (None, "no answer"), (5.0, ""), (9.0, "")
    fewer = price_process._fewer

    assert [fewer(None, x) for x in (none, five)] == [none, five]
    assert [fewer(none, five), fewer(five, none), fewer(none, none)] == [none] * 3
    assert [fewer(five, nine), fewer(nine, five)] == [five, five]


def test_who_is_asked_is_told_before(sent):
    """A process that ends is blamed on whom it named last: of each call and each answer that is who it is about."""
    at = None
    for kind, *rest in sent:
        at = rest[0] if kind == "at" else at
        assert kind not in ("asked", "answered", "digits", "failed") or rest[0] == at


@pytest.mark.parametrize("unknown", [[], [2]])
def test_one_pose_is_asked_for_from_the_truth_at_the_time_before(monkeypatch, unknown):
    """And by whoever steps in time from that time on; of the longest run of times that are known."""

    class Truth(CertifiedTruth):
        def __init__(self, scene):
            super().__init__(scene)
            self.known[[k for k in unknown if k < len(self.known)]] = False

    monkeypatch.setattr(price_process, "CertifiedTruth", Truth)
    asked, motion = questions(scene())["one"], refkin.solve(scene())
    for kind in (asked.scenes, asked.stepped):
        for one, _ in kind:
            k = motion.t.tolist().index(one.times[-1])
            estimates = np.concatenate([body.estimate for body in one.mechanism.bodies])

            assert not {k - 1, k} & {*unknown}
            assert estimates == pytest.approx(motion.q[:, k - 1], abs=1e-12)
            assert one.times == scene().times[k - 1 if kind is asked.stepped else k : k + 1]


ENDS = ("made up", "steps", "")
"""The method that ends the process that measures."""


@pytest.fixture
def listed(sent, monkeypatch):
    """The price list of what a process says that ends at one method, and of what the next one says without it."""
    whole = [message for message in sent if message[0] != "asked"]
    at = next(k for k, message in enumerate(whole) if message[0] == "timed" and message[1] == ENDS)
    broken = [*whole[: at + 1], ("at", ENDS, "nobody")]
    rest = [m for m in whole if ENDS not in m[1:2]]
    rest.insert(1, ("refused", ("made up", "likes none", ""), "it does not like four-bars"))
    asked = []

    def start(function, *words):
        asked.append(words)
        said = iter((broken, rest)[len(asked) - 1])

        def recv():
            try:
                return next(said)
            except StopIteration:
                raise EOFError from None

        pipe = MagicMock(poll=lambda seconds: True, recv=recv)
        return pipe, SimpleNamespace(pid=0)

    monkeypatch.setattr(measuring, "start", start)
    monkeypatch.setattr(measuring, "stop", lambda process: SimpleNamespace(text="its process ended: SIGSEGV"))
    told = []
    prices = price(ROCKER.scene(samples=CYCLE + 7), ["made up"], 100.0, tell=lambda *words: told.append(words))
    return prices, asked, told, sum(message[0] == "at" for message in (*broken, *rest))


def test_the_list_holds_what_the_process_said_and_of_a_method_that_ended_it_how(listed):
    prices, asked, *_ = listed
    poses = {"": TIMES, "_one": 1, "_bulk": BULK}
    for order, quantity in enumerate(QUANTITIES):
        plain, ended = row_of(prices, "plain", "", quantity), row_of(prices, "steps", "", quantity)
        at_once, cycles = row_of(prices, "at once", "", quantity), row_of(prices, "cycles alone", "", quantity)

        for suffix, count in poses.items():
            cost = 1e6 * (1e-2 / count + 1e-4)
            assert getattr(plain, f"microseconds{suffix}") == pytest.approx((order + 1) * cost)
            assert getattr(plain, f"spread{suffix}") == pytest.approx(0.0, abs=1e-9)
            assert getattr(plain, f"digits{suffix}") > 12.0
            assert getattr(ended, f"microseconds{suffix}") is getattr(ended, f"digits{suffix}") is None
        assert plain.microseconds_to_build == pytest.approx(0.25e6)
        assert at_once.microseconds == pytest.approx(3 * 1e6 * (3e-2 / TIMES + 2e-4))
        assert (cycles.microseconds_bulk, cycles.digits_bulk) == (None, None)
        assert ended.note.startswith("its process ended: SIGSEGV")
        assert 13.0 < plain.digits_attainable <= 17.0
        assert "once" not in plain.note
    assert prices.refused == [("made up", "likes none", "it does not like four-bars")]
    assert (prices.times, prices.known, prices.asked) == (CYCLE, TIMES, CYCLE + 7)
    assert [words[2] for words in asked] == [set(), {ENDS}]
    assert [words[3] for words in asked] == pytest.approx([100.0, 100.0], abs=1.0)


def test_whoever_waits_is_told_how_often_a_method_was_begun_with_and_which(listed):
    _, _, told, begun = listed

    assert [done for done, _ in told] == list(range(begun))
    assert {"made up, plain", "made up, steps"} <= {method for _, method in told}


def test_what_was_timed_once_is_said_to_be_and_costs_what_that_took():
    position, velocity = rows_of_cycle({LAST: (2e-6, None)}, cycle={"position": (9.0, "a limit")}, highest=1)

    assert (position.microseconds, velocity.microseconds) == pytest.approx((2.0, 2.0))
    assert (position.spread, position.digits, velocity.digits) == (None, 9.0, None)
    assert position.note == "a limit; one cycle timed once, all quantities together"


def test_a_price_is_that_of_the_cheapest_run_that_gives_the_quantity_and_what_was_not_timed_has_none():
    rows = rows_of_cycle({0: (5e-6, 0.0), 1: (4e-6, 0.1), 2: (6e-6, 0.2)})

    assert [(row.microseconds, row.spread) for row in rows] == [(4.0, 0.1), (4.0, 0.1), (6.0, 0.2)]
    assert [row.note for row in rows] == ["one cycle 5 us where it ends with position", "", ""]
    others = ("microseconds_one", "spread_one", "microseconds_bulk", "spread_bulk")
    assert {getattr(row, key) for row in rows for key in others} == {None}


def test_a_list_of_all_classes_shares_its_time_among_those_that_are_left(monkeypatch, tmp_path):
    asked = []

    def priced_alone(scene, producers, within):
        asked.append((scene.name, producers, within))
        return SimpleNamespace(rows=[priced(9.0, 5.0, scene.name)])

    monkeypatch.setattr(measuring, "price", priced_alone)
    monkeypatch.setattr(measuring, "time", SimpleNamespace(monotonic=lambda: 7.0))
    there = measuring.priced_classes()
    rows = measuring.price_list(60.0, ("made up",))

    assert [(row["scene_class"], row["method"]) for row in rows] == [(name, one.name) for name, one in there.items()]
    (tmp_path / "price.json").write_text(json.dumps(rows), encoding="utf-8")
    assert measured(tmp_path)[1] == []  # what a night writes is what its report reads
    left = [60.0 / (len(there) - k) for k in range(len(there))]
    assert [(name, within) for name, _, within in asked] == list(
        zip([s.name for s in there.values()], left, strict=True)
    )
    asked.clear()
    measuring.price_list(0.0, ("made up",))
    assert [within for *_, within in asked] == [measuring.LEAST] * len(there)
