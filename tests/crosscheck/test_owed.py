"""What an engine owes: an answer to all that was asked, and no allowance beyond what its documentation states."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from crosscheck.engines import Term
from crosscheck.engines.closed_form.engine import ClosedForm
from crosscheck.judge.delivery import granted
from crosscheck.judge.records import Cause
from crosscheck.measure.check import check
from crosscheck.scenes.drawing import draw
from refkin import FourBar
from refkin.model import Effect
from refkin.motion import Status
from refkin.motion_laws import Polynomial

SCENE = FourBar(ground=4.0, crank=1.0, coupler=3.5, rocker=3.0).scene(samples=9)
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


def of_first_body(motion):
    return replace(motion, bodies=motion.bodies[:1], q=motion.q[:3], qd=motion.qd[:3], qdd=motion.qdd[:3])


def without_answers_from(k: int):
    def spoil(motion):
        status = tuple(s if j < k else Status.NOT_CONVERGED for j, s in enumerate(motion.status))
        return replace(motion, status=status)

    return spoil


def test_an_engine_that_is_right_owes_nothing():
    assert found(Wrapped()) == set()


@pytest.mark.parametrize(
    ("spoil", "owed"),
    [
        (lambda motion: replace(motion, qd=None), {("velocity", "not delivered")}),
        (lambda motion: replace(motion, qdd=None), {("acceleration", "not delivered")}),
        (of_first_body, {("position", "not delivered")}),
    ],
)
def test_what_was_asked_and_not_delivered_is_a_failure(spoil, owed):
    assert found(Wrapped(spoil)) == owed


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


def test_of_a_term_that_is_not_granted_the_largest_part_is_told():
    message = granted(Wrapped(), SCENE, [big(absolute=1e-3, relative=1e-9)])[1][0]["message"]

    assert message.startswith("'own' of 0.001: no documentation of wrapped states more than 1.14e-13")


@pytest.mark.parametrize("number", [np.nan, np.inf])
def test_an_answer_that_says_ok_without_a_number_at_one_time_is_called_so(number):
    off = np.zeros((9, 9))
    off[4, 2] = number

    assert found(Wrapped(lambda motion: replace(motion, q=motion.q + off))) == {("position", Cause.NO_NUMBER)}


def test_a_documented_term_is_granted_no_further_than_its_documentation():
    class Exudyn(Wrapped):
        name = "exudyn"

    def stopping(size):
        return Exudyn(terms=[replace(big(absolute=size), name="stopping rule")])

    assert found(stopping(1e-8)) == set()
    assert found(stopping(1e-3)) == {("position", "undocumented error term")}


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
