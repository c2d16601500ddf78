"""A sweep over many times at once takes the steps that it takes one by one, and no others."""

from __future__ import annotations

import math
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

import refkin
import refkin.solving.solve
from refkin import FourBar, Polynomial, Sinusoid, SliderCrank, Status, compile_system
from refkin.scenes.linkages.base import Branch
from refkin.solving.ahead import Ahead, Leaps

ROCKER = FourBar(ground=4.0, crank=1.0, coupler=3.5, rocker=3.0)
LIMIT = math.acos((16.0 + 9.0 - 25.0) / 24.0)  # a crank of 3 on a ground of 4, coupler and rocker 5 in line
TIMES = tuple(np.linspace(0.0, 1.0, 30))


def turning(scale, start=0.3):
    return Polynomial(coefficients=(start, scale))


SCENES = {
    "a whole turn": ROCKER.scene(law=turning(2 * math.pi), times=TIMES),
    "a law that turns back": ROCKER.scene(law=Sinusoid(amplitude=1.0, angular_frequency=9.0, offset=1.0), times=TIMES),
    "a slider": SliderCrank(crank=1.0, rod=2.5).scene(law=turning(6.0), times=TIMES),
    "near a change point": FourBar(ground=4.0, crank=1.0, coupler=3.5, rocker=1.5 + 1e-5).scene(
        law=turning(6.0), times=TIMES
    ),
    "up to a limit": FourBar(ground=4.0, crank=3.0, coupler=2.0, rocker=3.0).scene(
        law=turning(LIMIT - 0.3 - 1e-7), times=TIMES
    ),
    "past a limit": replace(
        FourBar(ground=4.0, crank=3.0, coupler=2.0, rocker=3.0).scene(law=turning(2.0), times=TIMES[:9]), times=TIMES
    ),
}


@pytest.mark.parametrize("name", SCENES)
def test_the_poses_found_at_once_are_those_found_step_by_step(monkeypatch, name):
    at_once = refkin.solve(SCENES[name])
    monkeypatch.setattr(Leaps, "over", lambda self, done: [])
    alone = refkin.solve(SCENES[name])
    assert at_once.status == alone.status
    assert Status.OK in at_once.status
    for level, other, radii, theirs in zip(
        at_once.levels,
        alone.levels,
        vars(at_once.certified_radius).values(),
        vars(alone.certified_radius).values(),
        strict=True,
    ):
        ok = np.isfinite(radii)
        scale = 1e-13 * np.abs(level[:, ok]).max(initial=1.0)
        assert (np.abs(level - other)[:, ok] <= 8.0 * (radii + theirs)[ok] + scale).all()


@pytest.mark.parametrize("name", ["a whole turn", "a law that turns back", "up to a limit"])
def test_almost_no_step_is_left_to_the_sweep_alone(monkeypatch, name):
    steps = []
    walk = refkin.solving.solve.Sweep.to
    monkeypatch.setattr(refkin.solving.solve.Sweep, "to", lambda self, t: steps.append(t) or walk(self, t))
    assert set(refkin.solve(SCENES[name]).status) == {Status.OK}
    assert len(steps) <= 2


@pytest.mark.parametrize("place", [0, 7, 28])
def test_a_pose_of_the_other_branch_is_taken_by_no_step(monkeypatch, place):
    """The guess at one time, and from there on at all, is the other assembly, which closes as well."""
    closed = Ahead._closed
    scene = SCENES["a whole turn"]
    right, wrong = (
        refkin.solve(ROCKER.scene(branch=branch, law=turning(2 * math.pi), times=TIMES)) for branch in Branch
    )
    system = compile_system(scene.mechanism, unit=scene.mechanism.unit())

    def swapped(self, q, t):
        q = closed(self, q, t)
        if len(t) == len(TIMES) - 1:
            q[:, place:] = system.to_unit(wrong.q)[:, 1 + place :]
        return q

    monkeypatch.setattr(Ahead, "_closed", swapped)
    answer = refkin.solve(scene)
    assert set(answer.status) == {Status.OK}
    assert np.abs(answer.q - right.q).max() < 1e-12
    assert np.abs(answer.q - wrong.q).max() > 0.1


def test_a_straight_correction_is_no_sign_that_the_next_one_is_rounding():
    """Two poses were left 1e-13 off: their bounds said so, 40 and 6 times what the condition lets a float64 pose be."""
    motion = refkin.solve(refkin.load(Path(__file__).parents[1] / "corpus" / "closed-by-a-straight-correction.toml"))

    assert np.max(motion.certified_radius.position / motion.condition) < 2.0 * np.finfo(float).eps
