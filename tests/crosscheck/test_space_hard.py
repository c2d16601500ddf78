"""Hard cases of space: the arbiter is fair to signs, spins and directions of joints, and sees what is beyond it."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import numpy as np
import pytest

import refkin
from crosscheck.engines.loading import load
from crosscheck.engines.spatial.turning import product
from crosscheck.judge.comparison import reference
from crosscheck.judge.hard_poses import PoseSample, samples, scene_truths, truths
from crosscheck.judge.known_gaps import HardOutcome
from crosscheck.measure.hard_table import classed
from crosscheck.scenes.hard import hard_cases
from crosscheck.scenes.hard_case import LIMITED, REACH, HardCase
from refkin.motion import Motion
from refkin.motion_laws import Sinusoid
from refkin.scenes.linkages import RSSR

CASES = {case.key: case for case in hard_cases() if case.scene.mechanism.kind.name == "spatial"}
COUPLER = CASES["limit of an RSSR with its coupler, 1e-03"]


def judged(case: HardCase, motion: Motion) -> tuple[PoseSample, ...]:
    system, truth = truths(case)
    return samples(system, truth, case.scene, motion, ())


@pytest.fixture(scope="module")
def answer() -> Motion:
    return refkin.solve(COUPLER.scene)


def test_the_other_sign_of_p_and_another_passive_spin_are_no_error(answer: Motion) -> None:
    q = answer.q.copy()
    q[3:7] *= -1.0
    spin = np.array([np.cos(0.4), np.sin(0.4), 0.0, 0.0])  # the coupler lies along its own x axis
    q[10:14] = product(q[10:14].T, spin).T
    assert classed(judged(COUPLER, replace(answer, q=q)))[0] == HardOutcome.CORRECT


@pytest.mark.parametrize("row", [4, 11, 18], ids=["crank", "coupler", "rocker"])
def test_a_pose_beyond_the_least_error_is_wrong_in_every_body(answer: Motion, row: int) -> None:
    q = answer.q.copy()
    q[row] += 1e-9
    outcome, note = classed(judged(COUPLER, replace(answer, q=q)))
    assert (outcome, "radii outside" in note) == (HardOutcome.WRONG, True)


def test_a_joint_the_wrong_way_round_is_named() -> None:
    case = CASES["estimate with a joint the wrong way round, 3e+00"]
    engine: Any = load("exudyn")
    (sample,) = judged(case, engine.solve(case.scene, engine.routes()[1]))
    assert (sample.called_ok, sample.note) == (True, "R2 the wrong way round")


@pytest.mark.parametrize("key", [key for key in CASES if key.startswith("estimate")])
def test_from_an_estimate_the_wrong_way_round_every_assembly_will_do(key: str) -> None:
    _, truth = truths(CASES[key])
    assert [len(true.roots) for true in truth] == [2]
    assert classed(judged(CASES[key], load("pinocchio").solve(CASES[key].scene)))[0] == HardOutcome.CORRECT


def test_where_the_reference_has_lost_the_branch_in_space_no_assembly_is_taken_for_the_truth() -> None:
    """There are assemblies, but none that are proved to be all: an answer that is another one may be right."""
    law = Sinusoid(amplitude=1.5, angular_frequency=1.0, offset=0.3)  # beyond the limit, and back
    scene = RSSR(**LIMITED, coupler=REACH - 0.5, massless=True).scene(law=law, times=(0.0, 3.0))
    first, last = scene_truths(reference(scene))

    assert (len(first.roots), last.roots, last.gap) == (1, (), None)


@pytest.mark.parametrize("key", [key for key in CASES if key.startswith("gimbal")])
def test_the_least_error_at_a_gimbal_pose_goes_with_the_ratio_of_the_speeds(key: str) -> None:
    _, truth = truths(CASES[key])
    assert 1e-17 < np.max(truth[-1].roots[0][1]) * float(key.split()[-1]) < 1e-13
