"""The program as a producer of its own: within the reference's budget, or no answer; never the reference's own."""

from __future__ import annotations

import tomllib
from dataclasses import replace

import numpy as np
import pytest

from crosscheck.engines import EngineError, Level, Support
from crosscheck.engines.ours import batch as module
from crosscheck.engines.ours.batch import SINES, RefkinBatch
from crosscheck.judge.comparison import compare, reference
from crosscheck.measure.check import check
from refkin import Sinusoid
from refkin.joints import DRIVER_TYPES, JOINT_TYPES, elements_of
from refkin.scenes.files import load
from tests.linkages import LIMITED, PARALLELOGRAM, with_law
from tests.places import ROOT

from .scenes import ROCKER, SCENES, bare

PROJECT = ROOT / "pyproject.toml"


def test_it_is_registered():
    points = tomllib.loads(PROJECT.read_text(encoding="utf-8"))["project"]["entry-points"]["crosscheck.engines"]

    assert points[RefkinBatch.name] == "crosscheck.engines.ours.batch:RefkinBatch"


@pytest.mark.parametrize("name", SCENES)
def test_every_joint_is_in_its_table_and_within_the_budget(name):
    engine, scene = RefkinBatch(), SCENES[name]
    table = engine.capabilities()
    motion = engine.solve(scene)

    assert all(table[e.key][Level.SOLVE].support is Support.NATIVE for e in elements_of(scene.mechanism.constraints))
    assert motion.producer.name == RefkinBatch.name
    assert compare(reference(scene), motion, engine.terms(scene)).agrees


def test_no_joint_or_driver_is_without_a_scene():
    """What all tests over `SCENES` say, they say of every type."""
    solved = {type(c) for scene in SCENES.values() for c in scene.mechanism.constraints}

    assert solved == {*JOINT_TYPES, *DRIVER_TYPES}


def test_a_night_compares_it_like_any_other():
    record = check(ROCKER.scene(samples=20), [RefkinBatch()])

    assert [(a.engine, a.compared) for a in record.answers] == [(RefkinBatch.name, 20)]
    assert record.disagreements == []


def test_a_wrong_answer_is_a_disagreement(monkeypatch):
    def wrong(scene):
        answer = attempt(scene)
        return replace(answer, q=answer.q + 1e-12)

    attempt = module.attempt
    monkeypatch.setattr(module, "attempt", wrong)
    record = check(ROCKER.scene(samples=20), [RefkinBatch()])

    assert {d.engine for d in record.disagreements} == {RefkinBatch.name}


def test_what_is_left_to_the_reference_gets_no_answer():
    limit = LIMITED.input_range()[0][1]
    law = Sinusoid(amplitude=limit + 0.05, angular_frequency=1.0)
    scene = bare(LIMITED.scene(samples=2, turns=0.01))
    scene = replace(with_law(scene, law), times=(0.0, 1.0, 1.57))

    with pytest.raises(EngineError, match="to the reference"):
        RefkinBatch().solve(scene)


def test_an_unknown_method_is_refused():
    route = replace(module.ROUTE, name="other")
    with pytest.raises(EngineError, match="no method 'other'"):
        RefkinBatch().solve(ROCKER.scene(samples=2), route)


def test_a_term_of_nothing_is_given_where_there_is_no_answer(monkeypatch):
    monkeypatch.setattr(module, "attempt", lambda scene: None)

    assert RefkinBatch().terms(ROCKER.scene(samples=2)) == ()


def test_sines_of_half_angles_are_as_good_as_the_term_says():
    """Against extended precision, over 60 radians: r = 2 / (1 + t^2), cos = r - 1, sin = t r with t = tan(x / 2)."""
    x = np.random.default_rng(0).uniform(-30.0, 30.0, 400_000)
    t = np.tan(0.5 * x)
    r = 2.0 / (1.0 + t * t)
    off = [r - 1.0 - np.cos(np.longdouble(x)), t * r - np.sin(np.longdouble(x))]

    assert max(float(np.max(np.abs(d))) for d in off) <= SINES * 2.0**-53


def test_near_a_change_point_a_night_has_a_refusal_and_no_disagreement():
    record = check(PARALLELOGRAM.scene(turns=1, samples=8, start=0.3), [RefkinBatch()])

    assert any(row.reason.startswith("refkin-batch refuses") for row in record.refusals)
    assert [d for d in record.disagreements if d.engine == RefkinBatch.name] == []


def test_rates_that_do_not_feel_a_change_point_are_exact_beside_it():
    """By Cramer's rule the rate of a guided slider left its guide: 4.7 times the allowed error."""
    scene = load(PROJECT.parent / "tests" / "corpus" / "fast-guided-beside-a-change-point.toml")
    (x, y), rates = scene.mechanism.joints[3].axis_i, RefkinBatch().solve(scene).qd[6:8]

    assert np.max(np.abs(x * rates[1] - y * rates[0])) < 4e-15
