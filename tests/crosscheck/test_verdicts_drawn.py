"""A night draws equal links, and scenes that end in a singular pose or in none: who mistakes them is seen."""

from __future__ import annotations

from dataclasses import replace
from functools import cache

import numpy as np
import pytest

from crosscheck.engines.closed_form.engine import ClosedForm
from crosscheck.measure.check import check
from crosscheck.scenes.drawing import ENDED, EQUAL, SPECIAL_EVERY, describe, draw
from refkin.joints import GROUND
from refkin.motion import Status

from .test_wrapped_engines import believing

SAMPLES = 9
NUMBERS = range(0, 10 * SPECIAL_EVERY, SPECIAL_EVERY)


@cache
def ended():
    return [draw(3, number + ENDED, SAMPLES) for number in NUMBERS]


@cache
def equal():
    return [draw(3, number + EQUAL, 3) for number in NUMBERS]


class Wrapped(ClosedForm):
    name = "wrapped"

    def solve(self, scene, route=None):
        return self.spoil(scene, super().solve(scene, route))


class Trusting(Wrapped):
    """Says ok whatever comes of a scene, with the last numbers that it had."""

    def spoil(self, scene, motion):
        return believing(motion, scene)


class Resting(Trusting):
    """Says ok as well, and has no rates."""

    def spoil(self, scene, motion):
        return replace(super().spoil(scene, motion), qd=None, qdd=None)


class Confusing(Wrapped):
    """Takes bodies whose joint points are equally far apart for one another."""

    def spoil(self, scene, motion):
        points = {body: [] for body in (GROUND, *motion.bodies)}
        for constraint in scene.mechanism.joints:
            for body, point in constraint.points():
                points[body].append(complex(*point))
        spans = [abs(points[body][0] - points[body][-1]) for body in motion.bodies]
        first = [next(j for j, other in enumerate(spans) if abs(other - span) <= 1e-6 * span) for span in spans]
        rows = np.concatenate([np.arange(3 * j, 3 * j + 3) for j in first])
        return replace(motion, q=motion.q[rows], qd=motion.qd[rows], qdd=motion.qdd[rows])


def kinds(drawn, engine) -> set[str]:
    return {d.kind for d in check(drawn.scene, [engine], describe(drawn)).disagreements}


def test_the_reference_proves_how_each_scene_ends():
    assert {d.expected for d in ended()} == {Status.SINGULAR, Status.UNASSEMBLABLE}
    assert [kinds(d, "closed_form") for d in ended()] == [set()] * len(NUMBERS)


@pytest.mark.parametrize(
    ("expected", "kind"),
    [(Status.UNASSEMBLABLE, "ok where there is no assembly"), (Status.SINGULAR, "rates in a singular pose")],
)
def test_an_engine_that_says_ok_where_there_is_nothing_fails(expected, kind):
    of_kind = [d for d in ended() if d.expected is expected]

    assert of_kind
    assert all(kind in kinds(d, Trusting()) for d in of_kind)
    assert all((kind in kinds(d, Resting())) is (expected is Status.UNASSEMBLABLE) for d in of_kind)


def test_another_verdict_than_the_one_a_scene_was_made_for_is_the_reference_s_disagreement():
    drawn = ended()[0]
    value = check(drawn.scene, [], {**describe(drawn), "expected": "ok"}).disagreements

    assert [(d.engine, d.how) for d in value] == [("refkin", drawn.expected.value)]


def test_an_engine_that_mistakes_equal_bodies_is_seen_on_equal_links_alone():
    unequal = [draw(3, number, 3) for number in range(5)]

    assert [kinds(d, "closed_form") for d in equal()] == [set()] * len(NUMBERS)
    assert any(kinds(d, Confusing()) for d in equal())
    assert not any(kinds(d, Confusing()) for d in unequal)
