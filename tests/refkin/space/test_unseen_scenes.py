"""Spatial scene files of all kinds against truths that share no formula with `refkin`, and those that cannot close."""

from __future__ import annotations

import tomllib
from pathlib import Path

import numpy as np
import pytest

import refkin
from refkin import fast
from refkin.motion import Status
from tests.refkin.space.truth import Truth, off

CORPUS = Path(__file__).parents[2] / "corpus"
U = 2.0**-53
BY_TAPES = ("space-small-and-far.toml", "space-large-and-far.toml")
SOLVED = (
    "space-bodies-at-rest.toml",
    "space-screw-loop-printed.toml",
    "space-seven-joints-dot.toml",
    "space-small-and-far.toml",
    "space-large-and-far.toml",
    "space-points-planes-and-links.toml",
)


@pytest.mark.parametrize("name", SOLVED)
def test_a_scene_nobody_tuned_for_is_answered_to_its_radii_and_to_ulps_times_its_condition(name):
    path = CORPUS / name
    scene = refkin.load(path)
    truth, motions, size = Truth(tomllib.loads(path.read_text())), [refkin.solve(scene)], scene.mechanism.size()
    exact = truth.near(motions[0].q[:, 0], motions[0].t[0])
    motions += [fast.sweep(scene)] if name in BY_TAPES else []

    for motion in motions:
        errors, rates = off(exact, motion, 0, size)
        radius = motion.certified_radius

        # A rotation is off by 4 |dp|, omega by 2 |dp'| + 2 |p'| |dp|, both once more where p'' enters.
        proved = np.array([radius.position[0], radius.velocity[0], radius.acceleration[0]])
        reach = np.cumsum(4 * proved * rates) * rates + 8 * U * rates
        scale = max(1.0, np.max(np.abs(motion.q[:, 0])) / size)  # of what metres round to far from the origin
        assert motion.status[0] is Status.OK
        assert (errors <= reach).all()
        assert (errors <= 8 * U * rates * [truth.condition, truth.condition, truth.condition**2] * scale).all()


def test_the_truth_would_see_an_answer_that_is_wrong():
    """The same scene with one number off by 1e-9."""
    text = (CORPUS / "space-large-and-far.toml").read_text()
    motion = refkin.solve(refkin.load(CORPUS / "space-large-and-far.toml"))
    document = tomllib.loads(text)
    document["joint"][0]["point_i"][0] += 1e-9

    errors, _ = off(Truth(document).near(motion.q[:, 0], 0.0), motion, 0, 1.0)

    assert errors[0] > 1e-11


@pytest.mark.parametrize("name", ["space-leg-too-long.toml", "space-ball-out-of-reach.toml"])
def test_a_loop_of_points_whose_longest_side_is_too_long_is_proved_not_to_close(name):
    motion = refkin.solve(refkin.load(CORPUS / name))

    assert set(motion.status) == {Status.UNASSEMBLABLE}
    assert "than the rest of its loop" in motion.message
