"""A scene that gives no estimates leaves the assembly open: the engines are asked for the one the reference found."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from crosscheck.engines import EngineError, EngineRefusal
from crosscheck.judge.comparison import reference
from crosscheck.measure.check import _is_refusal, check, estimated
from refkin.joints import PLANE
from refkin.scenes.files import load
from refkin.scenes.linkages import FourBar
from tests.linkages import ROCKER, without_estimates
from tests.places import ROOT

EXAMPLES = sorted((ROOT / "examples").glob("*.toml"))


@pytest.mark.parametrize("kept", [(), ("crank",)], ids=["no estimate", "one estimate"])
@pytest.mark.parametrize("path", EXAMPLES, ids=lambda path: path.stem)
def test_every_engine_answers_a_scene_without_estimates_and_agrees(path, kept):
    whole = load(path)
    scene = without_estimates(replace(whole, times=whole.times[:5]), *kept)
    engines = ["closed_form", "exudyn", "pinocchio", "mujoco"]
    engines += ["vector_loop"] if scene.mechanism.kind is PLANE else []
    record = check(scene, engines)

    assert record.disagreements == []
    assert {a.engine for a in record.answers} == set(engines)


def test_an_estimate_that_is_absent_is_the_first_pose_of_the_reference_rounded():
    scene = without_estimates(load(EXAMPLES[0]))
    ref = reference(scene)
    given = np.concatenate([body.estimate for body in estimated(scene, ref).mechanism.bodies])
    off = [np.max(np.abs(given - ref.motion.q[:, k])) for k in (0, -1)]

    assert 0.0 < off[0] < 0.01 * scene.mechanism.size() < 0.2 * off[1]


def test_an_estimate_that_is_absent_has_the_digits_that_tell_assemblies_apart():
    """Near a flat pose they are about sigma_min apart; rounding takes a twentieth of that, in sizes and radians."""
    scene = FourBar(ground=4.0, crank=1.0, coupler=2.0 + 1e-5, rocker=3.0).scene(samples=3)
    scene = without_estimates(replace(scene, times=scene.times[1:2]))
    ref = reference(scene)
    given = np.concatenate([body.estimate for body in estimated(scene, ref).mechanism.bodies])
    off = np.max(np.abs(given - ref.motion.q[:, 0]) / np.tile([4.0, 4.0, 1.0], 3))

    assert ref.sigma_min[0] < 0.01
    assert 1e-3 * ref.sigma_min[0] < off <= 0.05 * ref.sigma_min[0]
    ref.levels[0][0, 0] = np.nan
    assert estimated(scene, ref) is scene


def test_what_an_engine_says_of_a_scene_without_all_estimates_is_taken_for_a_refusal():
    """Which assembly is meant is left open; with all of them only what is called a refusal is one."""
    scenes = (ROCKER.scene(samples=2), without_estimates(ROCKER.scene(samples=2), "coupler", "rocker"))

    assert [_is_refusal(EngineError("no"), scene) for scene in scenes] == [False, True]
    assert [_is_refusal(EngineRefusal("never"), scene) for scene in scenes] == [True, True]
