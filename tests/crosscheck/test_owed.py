"""What an engine owes: an answer to all that was asked, and no allowance beyond what its documentation states."""

from __future__ import annotations

import ctypes
import os
import platform
import sys
import types
import warnings
from copy import deepcopy
from dataclasses import replace
from pathlib import Path
from types import SimpleNamespace
from unittest.mock import patch

import numpy as np
import pytest

import refkin
from crosscheck.engines import ELEMENTS, NATIVE, EngineError, Level, Term
from crosscheck.engines.closed_form.engine import ClosedForm
from crosscheck.engines.loading import load
from crosscheck.engines.methods import of_routes
from crosscheck.judge.comparison import reference
from crosscheck.judge.delivery import ABSOLUTE, granted
from crosscheck.judge.records import Cause, line_of, read_line
from crosscheck.measure import hard_table
from crosscheck.measure.check import TURNED_ROUND, check, key_of
from crosscheck.measure.conform import ask
from crosscheck.measure.effects import ablations, rows
from crosscheck.scenes.conformance import Question
from crosscheck.scenes.drawing import draw
from refkin import FourBar
from refkin.joints import GROUND, AngleDriver, Revolute
from refkin.model import Body, Effect, Mechanism, Scene
from refkin.motion import Status
from refkin.motion_laws import Polynomial, Table
from refkin.scenes import files
from tests.linkages import ROCKER
from tests.places import CORPUS

from .fake_engines import engine_file
from .made_up_engines import Made

SCENE = ROCKER.scene(samples=9)
CROSSED = ROCKER.scene(samples=9, branch="crossed")
LIMIT = FourBar(ground=2.0, crank=2.0, coupler=1.0, rocker=2.0)
"""A crank that turns up to a limit."""


class Wrapped(ClosedForm):
    """An engine that is right but for what is done to its motion."""

    name = "wrapped"
    delivers = ("position", "velocity", "acceleration")

    def __init__(self, spoil=lambda motion: motion, terms=()):
        super().__init__()
        self.spoil, self.added = spoil, tuple(terms)

    def terms(self, scene, route=None):
        return (*super().terms(scene, route), *self.added)

    def solve(self, scene, route=None):
        return self.spoil(super().solve(scene, route))


def found(engine, scene=SCENE) -> set[tuple[str, str]]:
    return {(d.quantity, d.kind) for d in check(scene, [engine]).disagreements}


def without_answers_from(k: int):
    def spoil(motion):
        status = tuple(s if j < k else Status.NOT_CONVERGED for j, s in enumerate(motion.status))
        return replace(motion, status=status)

    return spoil


def test_an_engine_that_is_right_owes_nothing():
    assert found(Wrapped()) == set()


@pytest.mark.parametrize(
    ("spoil", "why"),
    [
        (lambda motion: replace(motion, q=None), "q: expected an array of floats, got NoneType"),
        (lambda motion: replace(motion, status=None), "status: expected a tuple, got NoneType"),
        (lambda motion: replace(motion, bodies=None), "bodies: expected a tuple, got NoneType"),
        (lambda motion: replace(motion, bodies=(), q=motion.q[:0]), "it answers for no body"),
        (lambda motion: replace(motion, points=[1]), "points: expected a table of PointMotion, got list"),
        (lambda motion: replace(motion, bodies=([], *motion.bodies[1:])), "it answers for [], which the scene has not"),
        (
            lambda motion: replace(motion, q=motion.q.view(np.matrix)),
            "q: expected an array of floats, got a numpy.matrix",
        ),
        (
            lambda motion: replace(motion, qd=np.ma.masked_invalid(motion.qd)),
            "qd: expected an array of floats, got a numpy.ma.MaskedArray",
        ),
        (lambda motion: replace(motion, qd=motion.qd.tolist()), "qd: expected an array of floats, got list"),
        (lambda motion: replace(motion, qdd=motion.qdd + 0j), "qdd: expected an array of floats, got complex128"),
        (lambda motion: replace(motion, q=np.rint(motion.q).astype(int)), "q: expected an array of floats, got int64"),
        (
            lambda motion: replace(motion, status=("ok",) * len(motion.t)),
            "expected statuses of refkin.motion.Status, got 'ok'",
        ),
        (
            lambda motion: replace(motion, producer=None),
            "expected a refkin.motion.Producer with a printable version and a Route, got None",
        ),
    ],
)
def test_an_answer_of_another_form_is_named_by_what_it_is(spoil, why):
    (fault,) = check(SCENE, [Wrapped(spoil)]).disagreements

    assert (fault.kind, fault.message) == ("not delivered", why)


def test_an_answer_stands_under_who_was_asked_and_not_under_whom_it_names():
    def by_another(motion):
        route = replace(motion.producer.route, newton_by="exudyn")
        return replace(motion, producer=replace(motion.producer, name="exudyn", version="9", route=route))

    (own,), (other,) = (check(SCENE, [Wrapped(spoil)]).answers for spoil in (lambda motion: motion, by_another))

    assert (other.engine, other.version, other.method) == (own.engine, own.version, own.method)


def test_an_answer_is_what_it_was_when_it_was_given():
    """Whoever answers with views of one array writes over it, while it is asked what it adds, or asked again."""

    class Late(Wrapped):
        def solve(self, scene, route=None):
            motion = super().solve(scene, route)
            self.right, self.given = motion.q.copy(), motion.q
            motion.q[3] += 1e-3
            return motion

        def terms(self, scene, route=None):
            self.given[:] = self.right
            return super().terms(scene, route)

    assert ("position", "beyond the allowed error") in found(Late())


@pytest.mark.parametrize("terms", [None, [3], 1.5])
def test_terms_of_another_form_are_no_answer_and_named_by_what_they_are(terms):
    engine = Wrapped()
    engine.terms = lambda scene, route=None: terms
    record = check(SCENE, [engine])
    said = f"engine {engine.name!r}: terms(): expected a list of crosscheck.engines.Term, got {terms!r}"

    assert {(fault.kind, fault.message) for fault in record.disagreements} == {("no answer", said)}
    assert not record.answers


def test_a_form_that_no_rows_have_is_named():
    term = Term(name="own", level="position", reason="", form="dots")
    (fault,) = check(SCENE, [Wrapped(terms=[term])]).disagreements

    assert fault.kind == Cause.NO_ANSWER
    assert fault.message.endswith("expected of 'own' a form of half, dot, printed or '', got 'dots'")


@pytest.mark.parametrize("given", [{"level": "positon"}, {"level": "solve"}, {"relative": "1e-14"}, {"of_rates": None}])
def test_a_term_of_no_level_or_number_is_named_and_not_passed_over(given):
    term = Term(**{"name": "own", "level": "position", "reason": "", **given})
    (fault,) = check(SCENE, [Wrapped(terms=[term])]).disagreements

    assert fault.kind == Cause.NO_ANSWER
    assert "terms(): expected of 'own' numbers at a level of position, velocity, acceleration, " in fault.message


def test_numbers_too_large_for_any_equation_blame_no_joint_and_warn_nobody():
    small = FourBar(ground=0.4, crank=0.1, coupler=0.35, rocker=0.3).scene(samples=9)
    record = check(small, [Wrapped(lambda motion: replace(motion, q=motion.q + 1e308))])

    assert {(fault.kind, fault.message) for fault in record.disagreements} == {(Cause.NO_NUMBER, "")}


@pytest.mark.parametrize(
    ("attribute", "value", "said"),
    [
        ("api", None, "api: expected two whole numbers, as in (1, 0), got None"),
        (
            "capabilities",
            lambda self: None,
            "capabilities(): expected a table of element -> level -> Capability, got None",
        ),
        ("capabilities", lambda self: {"angle": {"solve": "yes"}}, "got {'angle': {'solve': 'yes'}}"),
        ("routes", lambda self: None, "routes(): expected a list of refkin.motion.Route, got None"),
        ("routes", lambda self: [3], "routes(): expected a list of refkin.motion.Route, got [3]"),
        ("name", "refkin", "calls itself 'refkin', as a registered one or one of ours does"),
        ("delivers", ("speed",), "delivers: expected some of position, velocity, acceleration, got ('speed',)"),
    ],
)
def test_what_an_engine_says_of_itself_in_another_form_is_named(monkeypatch, attribute, value, said):
    monkeypatch.setattr(Wrapped, attribute, value)
    with pytest.raises(EngineError) as raised:
        load(f"{__name__}:Wrapped")

    assert said in str(raised.value)


def test_a_record_holds_whatever_an_engine_says():
    def raising(motion):
        raise EngineError("cannot read \udce4.lib \x1b[2J\0" + 10**6 * "x")

    record = check(SCENE, [Wrapped(raising)])
    (said,) = read_line(line_of(record)).disagreements

    assert len(said.message) < 2100
    assert said.message.startswith("cannot read \\udce4.lib \x1b[2J\0xxx")


@pytest.mark.parametrize(("attribute", "value"), [("name", "own\udce4"), ("name", ""), ("version", lambda self: 1)])
def test_an_engine_whose_name_or_version_no_file_takes_is_none(tmp_path, monkeypatch, attribute, value):
    spec = engine_file(tmp_path, before="pass")
    fake = type(load(spec))
    setattr(fake, attribute, value)
    monkeypatch.setitem(sys.modules, "own_module", types.SimpleNamespace(Fake=fake))

    with pytest.raises(EngineError, match=rf"{attribute}.*: expected printable text, got"):
        load("own_module:Fake")


class Meddling(Wrapped):
    """It moves the first estimate and all times of the scene that it was given, and what NumPy does about errors."""

    name = "meddling"

    def solve(self, scene, route=None):
        motion = super().solve(scene, route)
        object.__setattr__(scene.mechanism.bodies[0], "estimate", (9.0, 9.0, 9.0))
        object.__setattr__(scene, "times", tuple(t + 1.0 for t in scene.times))
        np.seterr(all="raise")
        warnings.simplefilter("always")
        os.chdir(os.sep)
        return motion


class Scaling(Wrapped):
    """It scales in place what the laws of its scene keep at hand: a spline's coefficients."""

    name = "scaling"

    def solve(self, scene, route=None):
        motion = super().solve(scene, route)
        for driver in scene.mechanism.drivers:
            for kept in vars(driver.law).values():
                if hasattr(kept, "c"):
                    kept.c[:] *= 1.001
        return motion


class Altering(type(load("mujoco"))):
    """It changes the scene whose rows it gives."""

    name = "altering"

    def constraints(self, scene):
        object.__setattr__(scene, "times", (9.0, 10.0))
        return super().constraints(scene)


@pytest.mark.parametrize("asked", [check, lambda scene, engines: ask(engines[0], Question("", scene))])
def test_what_an_engine_does_to_what_its_scene_keeps_at_hand_reaches_nobody_else(asked):
    table = Table(argument=(0.0, 1.0, 2.0, 3.0), value=(0.0, 1.0, 1.5, 2.0))
    scene = ROCKER.scene(law=table, times=(0.5, 1.0, 1.5))
    refkin.solve(scene)
    assert any(hasattr(kept, "c") for kept in vars(table).values())

    said = asked(scene, [Scaling(), Wrapped(), "exudyn"])

    assert not (said.disagreements if asked is check else said.faults)


def turned_round(scene: Scene, is_asked: bool) -> Scene:
    """Return the scene over a time with which it is, or is not, solved with its bodies in another order."""
    scenes = (replace(scene, times=(*scene.times[:-1], scene.times[-1] + k)) for k in range(99))
    return next(scene for scene in scenes if (int(key_of(scene), 16) % TURNED_ROUND == 0) is is_asked)


@pytest.mark.parametrize("is_asked", [True, False])
@pytest.mark.parametrize("engine", [Meddling, Altering])
def test_an_engine_that_changes_what_is_not_its_own_is_named_alone(engine, is_asked):
    scene = replace(turned_round(SCENE, is_asked), name="meddled with")
    before, folder, heard = deepcopy(scene), Path.cwd(), list(warnings.filters)

    said = {(d.engine, d.kind) for d in check(scene, [engine(), Wrapped(), "exudyn"]).disagreements}

    assert said == {(engine.name, "changed the scene that it was given")}
    assert scene == before
    assert (np.geterr()["divide"] != "raise", Path.cwd(), warnings.filters) == (True, folder, heard)


class Rounding(Wrapped):
    """It leaves numbers rounded upward."""

    def solve(self, scene, route=None):
        motion = super().solve(scene, route)
        ctypes.CDLL(None).fesetround({"x86_64": 0x800, "aarch64": 0x400000}[platform.machine()])
        return motion


class Rebinding(Wrapped):
    """It binds a name of the reference's modules to what has no truth."""

    def solve(self, scene, route=None):
        motion = super().solve(scene, route)
        refkin.system.compile_system = np.ones(2)
        return motion


@pytest.mark.parametrize("engine", [Rounding, Rebinding])
def test_an_engine_that_rounds_or_binds_names_of_the_reference_in_its_own_way_changes_no_other(engine):
    bound = refkin.system.compile_system
    said = check(SCENE, [engine(), "exudyn"]).disagreements

    assert said == []
    assert refkin.system.compile_system is bound
    assert np.add(1.0, 2.0**-60) == 1.0


def test_an_answer_in_another_order_that_has_no_shape_is_one_that_depends_on_the_order():
    first = SCENE.mechanism.bodies[0].name
    engine = Wrapped(lambda motion: motion if motion.bodies[0] == first else replace(motion, q=motion.q.T))

    assert {kind for _, kind in found(engine, turned_round(SCENE, True))} == {"depends on how a scene is stated"}
    assert found(engine, turned_round(SCENE, False)) == set()
    by_itself = check(turned_round(SCENE, False), [engine], arbiter=True)  # what a shorter scene showed is shown again
    assert {d.kind for d in by_itself.disagreements} == {"depends on how a scene is stated"}


def felt(method, scene):
    return [work() for work in ablations(method, scene).runs.values()]


def asked_hard(method, scene):
    known = lambda key: (SimpleNamespace(scene=scene), None, ())  # noqa: E731
    with patch.multiple(hard_table, _known=known, _methods=lambda spec: [method], samples=lambda *_: ()):
        return hard_table.outcome_of(("", method.name, "", ""))


@pytest.mark.parametrize("ask", [felt, asked_hard, lambda m, scene: m.model(scene).solve(2)])
def test_an_engine_that_changes_what_is_not_its_own_changes_no_price_no_effect_and_no_hard_case(ask):
    scene = replace(SCENE, name="meddled with")
    before, folder, heard = deepcopy(scene), Path.cwd(), list(warnings.filters)
    (method,) = of_routes(Meddling())
    ask(method, scene)

    assert scene == before
    assert (np.geterr()["divide"] != "raise", Path.cwd(), warnings.filters) == (True, folder, heard)


def test_an_answer_of_another_form_has_no_effects():
    (method,) = of_routes(Wrapped(lambda motion: replace(motion, q=motion.q[:-1])))
    ledger = rows(ablations(method, SCENE), reference(SCENE), 0.0)

    assert {row.microseconds for row in ledger} == {None}
    assert "no answer without it: q has shape (8, 9), not (9, 9): 3 rows a body" in {row.note for row in ledger}


def test_an_engine_without_a_method_to_compare_is_not_passed_over():
    engine = Wrapped(lambda motion: replace(motion, q=motion.q + 1.0))
    engine.methods = list

    assert found(engine) == {("status", "not delivered")}


class Believing(Wrapped):
    """What is locked has rates of 1, and is ok."""

    def capabilities(self):
        return {key: {Level.SOLVE: NATIVE} for key in ELEMENTS}

    def solve(self, scene, route=None):
        motion = refkin.solve(scene)
        ones, ok = np.ones_like(motion.q), (Status.OK,) * len(motion.t)
        qd = np.where(np.isfinite(motion.qd), motion.qd, ones)
        return replace(motion, qd=qd, qdd=ones, status=ok)


def test_rates_of_a_locked_mechanism_are_called_so():
    crank = AngleDriver(name="d", body="a", law=Polynomial(coefficients=(0.0, 1.0)))
    other = replace(crank, name="e", law=Polynomial(coefficients=(0.0, 1.0, 1.0)))
    pin = Revolute(name="p", body_i=GROUND, point_i=(0.0, 0.0), body_j="a", point_j=(0.0, 0.0))
    body = Body(name="a", estimate=(0.0, 0.0, 0.0))
    scene = Scene(mechanism=Mechanism((body,), (pin,), (crank, other)), times=(0.0,), name="two motors")

    record = check(scene, [Believing()], {"expected": "locked"})

    assert {(d.quantity, d.kind) for d in record.disagreements} == {
        ("acceleration", "rates of a mechanism that is locked")
    }


def test_a_level_that_nobody_asked_for_is_not_owed():
    scene = replace(SCENE, effects=frozenset({Effect.VELOCITY}))

    assert found(Wrapped(lambda motion: replace(motion, qdd=None)), scene) == set()


def test_an_engine_that_says_it_has_positions_alone_owes_no_rates():
    engine = Wrapped(lambda motion: replace(motion, qd=None, qdd=None))
    engine.delivers = ("position",)

    assert found(engine) == set()


def big(**size: float) -> Term:
    return Term(name="own", reason="because", **{"level": "position", **size})


@pytest.mark.parametrize(
    "term",
    [
        big(absolute=1e-3),
        big(absolute=1e-12),
        big(relative=1e3),
        big(level="velocity", relative=1e-9),
        big(level="acceleration", of_rates=1e-3),
    ],
)
def test_an_error_term_without_documentation_is_a_failure_and_allows_nothing(term):
    off = Wrapped(lambda motion: replace(motion, q=motion.q + 1e-6), [term])

    assert (term.level, "undocumented error term") in found(Wrapped(terms=[term]))
    assert ("position", "beyond the allowed error") in found(off)


def test_an_error_term_in_many_pieces_is_granted_no_more_than_whole():
    kept, faults = granted(Wrapped.name, SCENE, [big(absolute=1e-13)] * 50)

    assert (len(kept), len(faults)) == (1, 49)


@pytest.mark.parametrize("key", ["absolute", "relative", "of_rates"])
def test_a_term_below_zero_is_not_granted_and_pays_for_no_other(key):
    kept, faults = granted(Wrapped.name, SCENE, [big(**{key: -1e3}), big(**{key: 1e3})])

    assert kept == []
    assert [fault["message"].split(":")[0] for fault in faults] == ["'own' of -1e+03", "'own' of 1e+03"]


def test_a_term_for_own_rows_is_granted_no_more_than_others():
    class Rows(Wrapped):
        name = "rows"

        def __init__(self, terms=()):
            super().__init__(terms=terms)
            self.inner = load("exudyn")

        def capabilities(self):
            return self.inner.capabilities()

        def constraints(self, scene):
            model = self.inner.constraints(scene)
            jacobian = model.jacobian
            model.jacobian = lambda q, t: jacobian(q, t) + 1e-6
            return model

    wrong = {("jacobian", "model translated wrongly")}
    assert found(Rows()) == wrong
    assert found(Rows([big(level="jacobian", absolute=1e-3)])) == {*wrong, ("jacobian", "undocumented error term")}


def test_of_a_term_that_is_not_granted_the_largest_part_is_told():
    message = granted(Wrapped.name, SCENE, [big(absolute=1e-3, relative=1e-9)])[1][0]["message"]

    assert message.startswith("'own' of 0.001: no documentation of wrapped states more than 1.14e-13")


def test_a_documented_term_is_granted_no_further_than_its_documentation():
    class Exudyn(Wrapped):
        name = "exudyn"

    def stopping(size):
        return Exudyn(terms=[replace(big(absolute=size), name="stopping rule")])

    assert found(stopping(1e-8)) == set()
    assert found(stopping(1e-3)) == {("position", "undocumented error term")}


@pytest.mark.parametrize("size", [4.0, 0.25])
@pytest.mark.parametrize(("part", "kept"), [(39.0, 1), (41.0, 0)])
def test_a_stopping_rule_is_granted_what_its_tolerance_leaves_of_forty_sizes(size, part, kept):
    """1e-8 of a residual; the engine's norm takes metres for radians, and radians for metres."""
    scene = FourBar(ground=size, crank=0.3 * size, coupler=0.8 * size, rocker=0.9 * size).scene(samples=2)
    rule = replace(big(absolute=part * 1e-8 * max(size, 1.0 / size)), name="stopping rule")

    assert scene.mechanism.size() == size
    assert len(granted("exudyn", scene, [rule])[0]) == kept


def test_how_far_a_mechanism_is_from_the_origin_pays_for_no_term():
    """A driven coordinate counts from the first point of the ground: 1e-8 of 1e6 m were granted to anybody."""

    def lifted(x):
        pin = refkin.Revolute(name="A0", body_i="ground", point_i=(x, 0.0), body_j="boom", point_j=(0.0, 0.0))
        law = Polynomial(coefficients=(x + 0.9, -0.1))
        driver = refkin.XDriver(name="D", body="boom", point=(1.0, 0.0), law=law)
        boom = refkin.Body(name="boom", estimate=(x, 0.0, 0.4))
        return refkin.Scene(mechanism=refkin.Mechanism((boom,), (pin,), (driver,)), times=(0.0, 1.0))

    for given in (lifted(0.0), lifted(2.0**20)):
        assert len(granted("any", given, [big(absolute=float(ABSOLUTE) * 2.0)])[0]) == 0
        assert len(granted("exudyn", given, [replace(big(absolute=1e-6), name="stopping rule")])[0]) == 0


def test_of_a_residual_that_holds_a_large_angle_so_many_roundings_are_more():
    """What a driver asks for is in its row, and what a slide holds: a thousand roundings of that, not of one turn."""
    turns = ROCKER.scene(law=Polynomial(coefficients=(400.0,)), times=(0.0, 1.0))
    sizes = [float(ABSOLUTE) * part for part in (1.0, 1.1, 63.0, 64.0)]

    assert [len(granted("any", turns, [big(absolute=size)])[0]) for size in sizes] == [1, 1, 1, 0]
    slider = refkin.SliderCrank(crank=1.0, rod=2.5).scene(times=(0.0,))
    joints = [replace(j, angle=-400.0) if isinstance(j, refkin.Prismatic) else j for j in slider.mechanism.joints]
    held = replace(slider, mechanism=replace(slider.mechanism, joints=tuple(joints)))
    assert [len(granted("any", held, [big(absolute=size)])[0]) for size in sizes] == [1, 1, 1, 0]
    assert [len(granted("any", SCENE, [big(absolute=size)])[0]) for size in sizes] == [1, 0, 0, 0]


def test_every_term_that_a_drawn_scene_calls_for_is_granted():
    engines = ["exudyn", "pinocchio", "mujoco", "closed_form", "vector_loop"]
    kinds = [d.kind for k in range(8) for d in check(draw(5, k, 3).scene, engines).disagreements]

    assert [kind for kind in kinds if kind in ("undocumented error term", "not delivered")] == []


def test_a_limit_at_the_end_excuses_nobody_before_it():
    high = LIMIT.input_range()[0][1]
    times = tuple(np.linspace(0.0, 1.0, 9))
    end = high * (1.0 - 1e-12)
    scene = LIMIT.scene(law=Polynomial(coefficients=(1.0, end - 1.0)), times=times)

    assert found(Wrapped(without_answers_from(8)), scene) == set()
    assert found(Wrapped(without_answers_from(4)), scene) == {("status", "no answer")}


def test_another_assembly_counts_turns_of_its_own():
    """Its rocker was turned back to the reference's, and it was said to violate the gear between rocker and wheel."""

    def geared(branch, turns):
        scene = ROCKER.scene(times=(0.0, 0.3), branch=branch)
        m = scene.mechanism
        *others, rocker = m.bodies
        x, y, phi = rocker.estimate
        bodies = (
            *others,
            replace(rocker, estimate=(x, y, phi + turns * np.pi)),
            Body(name="wheel", estimate=(6, 0, 0)),
        )
        pin = Revolute(name="pin", body_i=GROUND, point_i=(6, 0), body_j="wheel", point_j=(0, 0))
        gear = refkin.Gear(name="gear", body_i="rocker", radius_i=1.0, body_j="wheel", radius_j=-0.7)
        return replace(scene, mechanism=Mechanism(bodies, (*m.joints, pin, gear), m.drivers))

    there = refkin.solve(geared("crossed", 6))
    said = check(geared("open", 0), [Made("made", lambda motion: there)]).disagreements
    assert {d.kind for d in said if d.method != "rows" and d.kind is not Cause.ORDER} == {Cause.OTHER_ASSEMBLY}


def test_one_pose_of_another_assembly_does_not_name_what_is_plainly_wrong_elsewhere():
    def spoil(motion):
        q = motion.q.copy()
        q[:, 3] = ClosedForm().solve(replace(CROSSED, times=SCENE.times)).q[:, 3]
        if plainly:
            q[0, 5] += 100.0
        return replace(motion, q=q)

    plainly = False
    assert found(Wrapped(spoil)) == {("position", "other assembly")}
    plainly = True
    assert found(Wrapped(spoil)) == {("position", "other assembly"), ("position", "beyond the allowed error")}


def test_rates_that_are_wrong_elsewhere_are_not_those_of_another_assembly():
    """A known gap of the one would hide the other."""

    def spoil(motion):
        q, qd = motion.q.copy(), motion.qd.copy()
        q[:, 3] = ClosedForm().solve(replace(CROSSED, times=SCENE.times)).q[:, 3]
        qd[:, 5] *= 1.5
        return replace(motion, q=q, qd=qd)

    assert found(Wrapped(spoil)) == {("position", "other assembly"), ("velocity", "beyond the allowed error")}


def test_a_term_of_rates_is_granted_as_far_as_links_may_turn():
    short = files.load(CORPUS / "slider-on-a-short-rod.toml")
    assert [d for d in check(short, ["pinocchio"]).disagreements if d.engine == "pinocchio"] == []

    fast = Term(name="own", reason="because", level="acceleration", of_rates=1e-8)
    assert [granted(Wrapped.name, scene, [fast])[0] for scene in (short, SCENE)] == [[], []]
