"""An engine that lists methods of its own, and no route, is in every measurement, and each is blamed by its name."""

from __future__ import annotations

from dataclasses import replace
from functools import cache
from pathlib import Path

import pytest

import refkin
from crosscheck.engines import EngineError
from crosscheck.engines.loading import load
from crosscheck.engines.methods import Model, Use, methods
from crosscheck.judge.comparison import reference
from crosscheck.judge.records import Cause, line_of, read_line, read_records
from crosscheck.measure import bench
from crosscheck.measure.check import check, key_of
from crosscheck.measure.conform import ask, hard_replies
from crosscheck.measure.effects import ablations
from crosscheck.measure.effects import rows as effect_rows
from crosscheck.measure.hard_table import hard_case_rows
from crosscheck.measure.price import price
from crosscheck.night.campaign import run
from crosscheck.night.hunting import hunt
from crosscheck.night.plan import NightPlan
from crosscheck.night.sections import pictures
from crosscheck.scenes import workloads
from crosscheck.scenes.conformance import questions
from crosscheck.scenes.hard import hard_cases
from crosscheck.scenes.names import called
from refkin.model import Effect, Mechanism
from refkin.scenes.files import to_dict
from tests.linkages import ROCKER
from tests.places import EXAMPLES

from .hard_engines import Complex, FaultyFirst, OneNameTwice, Own

FILE = Path(__file__).with_name("hard_engines.py")
OWN, FIRST, COMPLEX = (f"{FILE}:{name}" for name in ("Own", "FaultyFirst", "Complex"))
RIGHT, FAULTY = "right", "faulty, by 1e-6"
SCENE = ROCKER.scene(samples=4)
IN_SPACE = refkin.load(EXAMPLES / "rssr.toml")
IN_SPACE = replace(IN_SPACE, times=IN_SPACE.times[:3])


@pytest.mark.parametrize("scene", [SCENE, IN_SPACE], ids=["plane", "space"])
@pytest.mark.parametrize("effects", [{*Effect}, {Effect.ACCELERATION}, {Effect.VELOCITY}, ()])
def test_it_is_compared_at_what_a_scene_calls_for(scene, effects):
    record = check(replace(scene, effects=frozenset(effects)), [OWN], arbiter=True)
    places = {a.method.name: (a.certificate.inside > 0, a.certificate.outside > 0) for a in record.answers}

    assert places == {RIGHT: (True, False), FAULTY: (False, True)}
    assert {(d.engine, d.method, d.kind) for d in record.disagreements} == {("own", FAULTY, Cause.BEYOND)}
    assert {(a.version, a.method.newton_by, a.method.drift_by) for a in record.answers} == {("0", "refkin", "own")}


def test_it_is_asked_in_a_night_and_pictured(tmp_path):
    plan = {"seed": 21, "out": tmp_path, "engines": (OWN,), "workers": 1, "scenes": 4, "shrinking_seconds": 1.0}
    outcome = run(NightPlan(**plan))
    records = [record for _, record in read_records(tmp_path / "records.jsonl")]
    answered = {a.method.name: a.engine for record in records for a in record.answers}
    drawn = pictures([check(SCENE, [OWN])], lambda record: {"scene": to_dict(SCENE)}, {"own": OWN})

    assert (outcome.failed, outcome.missing) == ([], {})
    assert answered == {RIGHT: "own", FAULTY: "own"}
    assert {case.disagreement.method for case in outcome.new} == {FAULTY}
    assert {mark["method"] for mark in drawn["marks"]} == {RIGHT, FAULTY}


def test_its_first_method_is_hunted():
    own, first = (hunt({load(spec).name: spec}, 8.0, 1, scene_seconds=20.0) for spec in (OWN, FIRST))

    assert {name[:2] for name in own.catches} == {("own", RIGHT)}
    assert ([*own.blames], own.failures) == ([], [])
    assert {name[:2] for name in first.blames} == {("faulty_first", FAULTY)}


def test_it_is_replayed(command):
    code, said, _ = command("replay", SCENE, "--engines", OWN)

    assert code == 1
    assert f"own ({FAULTY}), position: beyond the allowed error" in said
    assert f"own ({RIGHT})" not in said


def in_order(engine):
    """Have the right method of an engine answer for the bodies in an order of its own."""
    by_name = {one.name: one for one in engine.methods()}
    build = by_name[RIGHT].build
    by_name[RIGHT] = replace(by_name[RIGHT], build=lambda s: build(replace(s, mechanism=sorted_by_name(s.mechanism))))
    engine.methods = lambda: list(by_name.values())
    return engine


def reading(change):
    """Return what builds a model that reads what `change` makes of the right levels."""
    (build,) = (one.build for one in Own().methods() if one.name == RIGHT)

    def built(scene):
        model = build(scene)
        return replace(model, read=lambda answer: change(model.read(answer)))

    return built


def sorted_by_name(m):
    return Mechanism(tuple(sorted(m.bodies, key=lambda body: body.name)), m.joints, m.drivers)


def test_the_first_method_alone_is_asked_again_with_the_bodies_in_another_order():
    scenes = (replace(SCENE, times=(*SCENE.times[:-1], SCENE.times[-1] + k)) for k in range(99))
    scene = next(scene for scene in scenes if int(key_of(scene), 16) % 4 == 0)
    swapped = replace(scene, mechanism=sorted_by_name(scene.mechanism))
    said = [{(d.method, d.kind) for d in check(swapped, [in_order(one())]).disagreements} for one in (Own, FaultyFirst)]

    assert said == [{(RIGHT, Cause.ORDER), (FAULTY, Cause.BEYOND)}, {(FAULTY, Cause.BEYOND)}]


def test_it_is_asked_whether_it_keeps_its_promises():
    replies = [ask(load(OWN), question) for question in list(questions())[:3]] + list(hard_replies(OWN, 4.0))
    whole = "\n".join(fault.what for reply in replies for fault in reply.faults)

    assert all(reply.faults for reply in replies[:3])
    assert f"position is wrong (method '{FAULTY}')" in whole
    assert f"a wrong pose is called ok at a hard case (method '{FAULTY}')" in whole
    assert f"(method '{RIGHT}')" not in whole


def test_a_method_is_asked_for_no_more_than_it_gives_and_gives_no_more_than_it_is_asked():
    engine, orders = Own(), set()
    whole, _ = methods(engine)
    model = whole.model(SCENE)
    listed = [
        replace(whole, highest=0, build=lambda _: replace(model, solve=lambda k: orders.add(k) or model.solve(k)))
    ]
    engine.methods = lambda: listed
    record = check(SCENE, [engine])
    levels = whole.solve(replace(SCENE, effects=frozenset({Effect.ACCELERATION}))).levels

    assert (orders, record.disagreements, list(record.answers[0].quantities)) == ({0}, [], ["position"])
    assert [level is None for level in levels] == [False, True, False]


@pytest.mark.parametrize("effects", [{*Effect}, {Effect.ACCELERATION}, {Effect.VELOCITY}, ()])
def test_a_level_that_a_scene_does_not_call_for_may_be_none(effects):
    """A motion has its levels so, and an engine whose model is read as one was blamed."""
    engine, scene = Own(), replace(SCENE, effects=frozenset(effects))
    (right,) = (one for one in engine.methods() if one.name == RIGHT)

    def build(scene):
        return Model(solve=lambda order: refkin.solve(scene), read=lambda motion: motion.levels)

    engine.methods = lambda: [replace(right, build=build)]
    assert check(scene, [engine]).disagreements == []


@pytest.mark.parametrize(
    ("change", "said"),
    [
        ({"build": lambda scene: None}, "right: build: expected a crosscheck.engines.methods.Model, got None"),
        ({"build": reading(lambda levels: None)}, "right: read: expected a list of arrays (rows, times), got None"),
        ({"build": reading(lambda levels: [None])}, "right: read: expected a list of arrays (rows, times), got [None]"),
        ({"build": reading(lambda levels: [])}, "right: read: expected a list of arrays (rows, times), got []"),
        (
            {"build": reading(lambda levels: [1.0, *levels[1:]])},
            "right: read: expected a list of arrays (rows, times), got [",
        ),
        ({"uses": "compare"}, "methods(): expected of a Method a set of Use, and highest 0 to 2, got 'compare' and 2"),
        ({"highest": -1}, "methods(): expected of a Method a set of Use, and highest 0 to 2, got frozenset("),
        ({"highest": "2"}, "methods(): expected of a Method a set of Use, and highest 0 to 2, got frozenset("),
    ],
)
def test_a_method_of_another_form_is_named_by_what_it_is(change, said):
    engine = Own()
    listed = [replace(one, **change) for one in engine.methods() if one.name == RIGHT]
    engine.methods = lambda: listed
    (fault,) = check(SCENE, [engine]).disagreements

    assert (fault.engine, said in fault.message) == ("own", True)


def test_two_methods_of_one_name_are_named():
    engine = OneNameTwice()
    (fault,) = ask(engine, next(iter(questions()))).faults

    assert (fault.level, "got ['right', 'right']" in fault.what) == ("form", True)
    record = check(SCENE, [engine])
    assert [answer.method.name for answer in record.answers] == [RIGHT]
    assert read_line(line_of(record)) == record


def test_of_two_methods_of_one_name_the_first_is_asked_hard_cases():
    """Of both a report would say that one was asked everything twice."""
    rows = hard_case_rows([f"{FILE}:OneNameTwice"], cases=hard_cases()[:1])

    assert [(row["engine"], row["method"]) for row in rows] == [("own", RIGHT)]


def test_complex_numbers_are_an_answer_of_another_form_in_every_table():
    """Nobody takes their real parts for what was answered."""
    why = "expected an array of floats, got complex128"
    faults = {(d.kind, d.message) for d in check(SCENE, [Complex()]).disagreements}
    (method,) = methods(Complex())
    answers = effect_rows(ablations(method, SCENE), reference(SCENE), 0.0)
    priced = price(SCENE, [COMPLEX], within=3.0).rows

    assert faults == {(Cause.NOT_DELIVERED, f"{level}: {why}") for level in ("q", "qd", "qdd")}
    assert {row.inert for row in answers} == {None}
    assert {(row.digits, row.microseconds, why in row.note) for row in priced} == {(None, None, True)}
    with pytest.raises(EngineError, match=why):
        bench.accuracy_of(workloads.sweep(12), method.batched(workloads.sweep(12), 2))


@cache
def of_effects():
    ref = reference(SCENE)
    return [row for one in methods(OWN, Use.EFFECTS) for row in effect_rows(ablations(one, SCENE), ref, 0.0)]


CASE = [case for case in hard_cases() if case.case == "large offset"][:1]
MEASURES = {
    Use.PRICE: lambda: [(vars(r), r.digits < 10.0) for r in price(SCENE, [OWN], within=3.0).rows],
    Use.EFFECTS: lambda: [(vars(r), not r.inert) for r in of_effects() if r.inert is not None],
    Use.HARD: lambda: [(r, r["verdict"] == "wrong") for r in hard_case_rows([OWN], cases=CASE)],
    Use.BENCH: lambda: [(r, not r["ranked"]) for r in bench.measured(workloads.sweep(12), [OWN], rounds=1)["rows"]],
}


@pytest.mark.parametrize("use", MEASURES)
def test_it_is_in_every_table_under_the_name_of_its_method(use):
    rows = MEASURES[use]()
    wrong = {called(row["method"], row["setting"]) for row, is_wrong in rows if is_wrong}

    assert {row["engine"] for row, _ in rows} == {"own"}
    assert {called(row["method"], row["setting"]) for row, _ in rows} == {RIGHT, FAULTY}
    assert wrong == {FAULTY}
