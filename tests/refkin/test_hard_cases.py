"""Hard scenes against rigorous truth: no wrong answer with status ok, and the answers that there must be."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from flint import arb, ctx

import refkin
from refkin import Evidence, Status
from refkin.differences import EPS

from .hard_cases import BITS, CASES

ULPS = 8
"""Allowed error in ulps of an angle, at least of 1, times the condition: residual and correction round a few times."""


@pytest.fixture(scope="module")
def motions():
    """The answers of all scenes, with every evidence."""
    return [refkin.solve(case.scene) for case in CASES]


def errors(case, motion, k):
    """The distance of each angle from the truth, whole turns aside, rounded up; infinite where there is no truth."""
    truth = case.truth(case.scene.times[k])
    if truth is None:
        return np.array([np.inf])
    rows = []
    with ctx.workprec(BITS):
        for body, (x, y) in truth.items():
            phi = arb(float(motion[body].phi[k]))
            off = arb.atan2(phi.sin() * x - phi.cos() * y, phi.cos() * x + phi.sin() * y)
            rows.append(float(abs(off).upper()) * (1 + EPS))
    return np.array(rows)


def wrong(case, motion, allowed):
    """The samples with status ok and an error above what is allowed, which is a function of the sample's number."""
    return [
        f"{case.name}, sample {k}: {np.max(errors(case, motion, k)):.3g} allowed {allowed(motion, k):.3g}"
        for k, status in enumerate(motion.status)
        if status is Status.OK and np.max(errors(case, motion, k)) > allowed(motion, k)
    ]


def by_condition(motion, k):
    size = np.nanmax(np.abs(motion.q[2::3, k]))
    return ULPS * EPS * max(1.0, size) * max(1.0, 1.0 / motion.sigma_min[k])


def test_there_are_as_many_cases_as_were_meant():
    assert len(CASES) >= 240
    assert len({case.name for case in CASES}) == len(CASES)


def test_the_truth_of_an_ok_pose_lies_within_its_certified_radius(motions):
    values = [
        w
        for case, m in zip(CASES, motions, strict=True)
        for w in wrong(case, m, lambda m, k: m.certified_radius.position[k])
    ]

    assert not values


def test_no_ok_pose_is_off_by_more_than_a_few_ulps_times_its_condition(motions):
    values = [w for case, motion in zip(CASES, motions, strict=True) for w in wrong(case, motion, by_condition)]

    assert not values


def test_what_must_be_found_is_found(motions):
    missed = [
        f"{case.name}, sample {k}: {motion.status[k].value}, not {must.value}: {motion.message}"
        for case, motion in zip(CASES, motions, strict=True)
        for k, must in enumerate(case.must)
        if must is not None and motion.status[k] is not must
    ]

    assert not missed


def test_without_certificates_no_ok_pose_is_wrong_either():
    rows = []
    for case in CASES:
        motion = refkin.solve(replace(case.scene, evidence=frozenset({Evidence.CONDITION}), effects=frozenset()))
        rows += wrong(case, motion, by_condition)

    assert not rows


def test_with_every_step_proved_no_ok_pose_is_wrong_and_regular_turns_are_ok():
    result, coarse = [], [case for case in CASES if len(case.scene.times) > 1][::2]
    for case in coarse:
        motion = refkin.solve(replace(case.scene, effects=frozenset()), certified=True)
        result += wrong(case, motion, lambda m, k: m.certified_radius.position[k])
        if case.name.startswith(("coarse", "unit", "ratio", "four-bar at", "slider at")):
            assert motion.verdict is Status.OK, case.name

    assert not result


def left_its_range(case, k):
    """Whether the crank was driven beyond its limit before a sample."""
    if not case.name.startswith("over the limit"):
        return False
    law = case.scene.mechanism.drivers[0].law
    return case.scene.times[k] > np.arcsin(1 / 1.001) / law.angular_frequency


def test_with_every_step_proved_a_motion_ends_where_its_crank_leaves_its_range():
    """Between two samples it leaves it, and comes back: only a proof of every step can tell."""
    cases = [case for case in CASES if case.name.startswith("over the limit")]
    for case in cases:
        motion = refkin.solve(replace(case.scene, effects=frozenset()), certified=True)
        after = [k for k in range(len(motion.t)) if left_its_range(case, k)]

        assert after
        assert not any(motion.status[k] is Status.OK for k in after), case.name


def test_an_answer_moved_by_its_radius_would_be_seen(motions):
    """The check can fail: every ok pose, off by twice its radius and a few ulps, is found wrong."""
    for case, motion in zip(CASES, motions, strict=True):
        if motion.status[0] is Status.OK:
            radius = motion.certified_radius.position[0]
            moved = replace(motion, q=motion.q + 2 * radius + 4 * np.spacing(np.abs(motion.q)))
            assert wrong(case, moved, lambda m, k: m.certified_radius.position[k]), case.name
