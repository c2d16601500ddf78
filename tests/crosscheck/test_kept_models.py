"""A model that is built once answers each time as one that is built for the question, and is priced apart from it."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

import refkin
from crosscheck.engines import EngineError
from crosscheck.engines.exudyn.engine import Exudyn
from crosscheck.engines.loading import load
from crosscheck.engines.methods import ORDERS, Use, methods, of_routes
from crosscheck.scenes.drawing import draw
from refkin.model import Effect
from tests.places import CORPUS, EXAMPLES, ROOT

from .made_up_engines import Made, by

JOINTS = ROOT / "docs/scenes"
KEEP = ("exudyn", "pinocchio", "mujoco", "vector_loop")
"""The closed form is one run from a scene's numbers to its answer: there is nothing to be kept."""


def scenes():
    yield from (refkin.load(EXAMPLES / f"{name}.toml") for name in ("crank-rocker", "slider-crank", "rssr"))
    yield from (refkin.load(JOINTS / f"{name}.toml") for name in ("distance-driver", "spatial-distance-driver"))
    yield refkin.load(CORPUS / "space-distance-through-zero.toml")  # a law that exudyn does not follow to its end
    yield from (draw(23, number, 12).scene for number in range(6))


def bits(motion):
    levels = [None if level is None else np.asarray(level).tobytes() for level in motion.levels]
    return levels, motion.status, motion.message, np.asarray(motion.residual).tobytes()


def kept(name):
    return [method for method in methods(name, Use.PRICE) if method.route is not None]


@pytest.mark.parametrize("name", KEEP)
def test_every_call_of_a_model_has_the_bits_of_an_answer_of_its_own_whatever_was_asked_before(name):
    engine, asked = load(name), 0
    for scene in scenes():
        scene = replace(scene, times=scene.times[:: max(len(scene.times) // 8, 1)])
        for route in engine.kept:
            try:
                own = {order: bits(engine.solve(replace(scene, effects=ORDERS[order]), route)) for order in range(3)}
            except EngineError as error:
                with pytest.raises(type(error), match="^" + name):
                    engine.model(scene, route)
                continue
            model = engine.model(scene, route)
            for order in (2, 2, 0, 1, 2):
                assert bits(model.solve(replace(scene, effects=ORDERS[order]))) == own[order]
            model.close()
            asked += 1

    assert asked > 5


@pytest.mark.parametrize("name", KEEP)
def test_the_building_of_a_kept_model_is_no_part_of_its_price_and_no_row_says_it_is(name):
    listed = kept(name)

    assert listed
    for method in listed:
        assert method.build is not None
        assert "every call" not in method.note


def test_a_method_that_keeps_no_model_says_so():
    (method,) = kept("closed_form")

    assert method.build is None
    assert method.note == "builds its model in every call"


@pytest.mark.parametrize("effect", ["friction", "passive forces"])
def test_what_feels_rates_feels_none_of_the_motion_before(effect):
    engine, scene = Exudyn(effect), refkin.load(EXAMPLES / "crank-rocker.toml")
    for route in engine.kept:
        own, model = bits(engine.solve(scene, route)), engine.model(scene, route)

        assert [bits(model.solve(scene)) == own for _ in range(3)] == [True] * 3


class Counted(Made):
    """Builds a model, and counts how often."""

    built = 0

    @property
    def kept(self):
        return {self.routes()[0]: "a note of its own"}

    def model(self, scene, route):
        self.built += 1
        return self

    def solve(self, scene, route=None):
        return super().solve(scene, route)


def test_an_engine_of_a_users_own_is_asked_again_by_the_model_that_it_built():
    engine, scene = Counted("counted", by(0.0)), refkin.load(EXAMPLES / "crank-rocker.toml")
    (method,) = of_routes(engine)
    model = method.model(scene)
    answers = [model.read(model.solve(order)) for order in (0, 1, 2, 2)]

    assert (engine.built, method.note) == (1, "a note of its own")
    assert [len(levels) for levels in answers] == [1, 2, 3, 3]
    assert len(method.solve(scene, 2).levels) == 3
    assert engine.built == 1  # a night asks it as before


class Keeping(Made):
    kept: object = {}

    def __init__(self):
        super().__init__("keeping", by(0.0))


@pytest.mark.parametrize(
    ("kept", "model", "said"),
    [
        ({}, None, "lacks: model"),
        ((3,), Counted.model, "kept: expected a table of Route -> what is said of its price, got (3,)"),
        ({3: ""}, Counted.model, "got {3: ''}"),
    ],
)
def test_what_an_engine_says_of_its_models_in_another_form_is_named(monkeypatch, kept, model, said):
    monkeypatch.setattr(Keeping, "kept", kept)
    if model is not None:
        monkeypatch.setattr(Keeping, "model", model, raising=False)
    with pytest.raises(EngineError) as raised:
        load(f"{__name__}:Keeping")

    assert said in str(raised.value)


def test_a_model_is_asked_for_all_bodies_and_no_point():
    scene = refkin.load(EXAMPLES / "crank-rocker.toml")
    few = replace(scene, bodies_wanted=(scene.mechanism.bodies[0].name,))
    for name in KEEP:
        (method, *_) = kept(name)
        model = method.model(few)

        assert [len(level) for level in model.read(model.solve(1))] == [9, 9]


def test_where_shipped_stopped_is_told_of_the_scene_that_was_solved_last():
    """A model that is kept for a price does not stand in the way of the terms of a night."""
    engine, scene = Exudyn(), refkin.load(EXAMPLES / "crank-rocker.toml")
    route = engine.routes()[1]
    alone = engine.terms(scene, route)
    engine.model(replace(scene, times=scene.times[3:]), route)
    engine.solve(replace(scene, effects=frozenset({Effect.VELOCITY})), route)

    assert engine.terms(scene, route) == alone
