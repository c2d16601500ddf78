"""An engine that is asked the same again: what it did in between is told apart from how the scene is stated."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from typing import Any

import pytest

import refkin
from crosscheck.engines import EngineError
from crosscheck.engines.closed_form.engine import ClosedForm
from crosscheck.measure.check import check
from tests.places import ROOT

SCENE = refkin.load(ROOT / "examples" / "crank-rocker.toml")
FIRST = SCENE.mechanism.bodies[0].name
STATED, ASKED = "depends on how a scene is stated", "differs when asked again"


def nothing(motion: Any) -> Any:
    return replace(motion, q=motion.q * float("nan"), status=(refkin.Status.NOT_CONVERGED,) * len(motion.t))


def fails(motion: Any) -> Any:
    raise EngineError("by the test")


def none(motion: Any) -> Any:
    return None


def shifted(motion: Any) -> Any:
    return replace(motion, q=motion.q + 1e-6)


HOW = [nothing, fails, none, shifted]


class Asked(ClosedForm):
    """It answers otherwise where its count of questions, or what it is asked, makes it."""

    def __init__(self, how: Callable[[Any], Any], where: Callable[[int, Any], bool]) -> None:
        super().__init__()
        self.how, self.where, self.count = how, where, 0

    def solve(self, scene: Any, route: Any = None) -> Any:
        self.count += 1
        motion = super().solve(scene, route)
        return self.how(motion) if self.where(self.count, scene) else motion


def found(how: Any, where: Any) -> set[tuple[str, str]]:
    record = check(SCENE, [Asked(how, where)], arbiter=True)
    assert record.answers
    return {(d.quantity, d.kind) for d in record.disagreements}


@pytest.mark.parametrize("how", HOW)
@pytest.mark.parametrize(
    "where",
    [lambda count, scene: count == 2, lambda count, scene: count >= 2, lambda count, scene: count % 2 == 0],
    ids=["the second question", "all but the first", "every other"],
)
def test_who_answers_the_same_otherwise_when_asked_again_does_not_depend_on_the_statement(how: Any, where: Any) -> None:
    """An engine that fell silent after its first answer was said to mind the order of bodies."""
    assert found(how, where) == {("position" if how is shifted else "status", ASKED)}


@pytest.mark.parametrize("how", HOW)
def test_who_minds_the_order_of_bodies_is_still_said_to(how: Any) -> None:
    where = lambda count, scene: scene.mechanism.bodies[0].name != FIRST  # noqa: E731

    assert found(how, where) == {("position" if how is shifted else "status", STATED)}


@pytest.mark.parametrize("how", HOW)
def test_who_answers_as_ever_is_asked_no_third_time(how: Any) -> None:
    engine = Asked(how, lambda count, scene: False)

    assert not check(SCENE, [engine], arbiter=True).disagreements
    assert engine.count == 2
