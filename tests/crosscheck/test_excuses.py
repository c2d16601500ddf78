"""Nobody is blamed for what lies in the scene: a singular pose between two times, full turns in a constant angle."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np
import pytest

import refkin
from crosscheck.engines import EngineError
from crosscheck.engines.closed_form.engine import ClosedForm
from crosscheck.engines.loading import load
from crosscheck.engines.tree import joint_tree
from crosscheck.judge import delivery
from crosscheck.judge.comparison import reference
from crosscheck.judge.delivery import NARROWED, _falls, _minima, _narrowed, _within, singular_between
from crosscheck.judge.records import Cause
from crosscheck.measure import check as checking
from crosscheck.measure.check import REGULAR, check, restated
from refkin import FourBar, Polynomial
from refkin.motion import Status
from tests.places import CORPUS

PASSED = refkin.load(CORPUS / "near-singular-between-times.toml")
TURNED = refkin.load(CORPUS / "slider-turned-1e4-rad.toml")
REGULAR_MOTION = FourBar(ground=4.0, crank=1.0, coupler=3.5, rocker=3.0).scene(samples=5)


class Mute(ClosedForm):
    """An engine that has no answer to anything."""

    name = "mute"

    def solve(self, scene, route=None):
        raise EngineError("mute: Newton did not converge")


class Short(ClosedForm):
    """An engine that gives up before the last time."""

    name = "short"

    def solve(self, scene, route=None):
        motion = super().solve(scene, route)
        status = (*motion.status[:-1], Status.NOT_CONVERGED)
        levels = {name: np.array(getattr(motion, name)) for name in ("q", "qd", "qdd")}
        for level in levels.values():
            level[:, -1] = np.nan
        return replace(motion, status=status, producer=replace(motion.producer, name=self.name), **levels)


def kinds(scene, engine) -> set[str]:
    return {d.kind for d in check(scene, [engine]).disagreements}


def test_the_pose_between_two_times_is_certified_to_be_nearly_singular():
    time, sigma = singular_between(PASSED, REGULAR)
    there = refkin.solve(replace(PASSED, times=(*(t for t in PASSED.times if t < time), time)))

    assert there.status[-1] == "ok"
    assert there.sigma_min[-1] == pytest.approx(sigma, rel=1e-6, abs=0.0)
    assert sigma < REGULAR
    assert min(abs(time - t) for t in PASSED.times) > 0.1


def test_a_motion_far_from_singular_poses_gives_no_excuse():
    assert singular_between(REGULAR_MOTION, REGULAR) is None


@pytest.mark.parametrize(("floor", "falls"), [(0.0, True), (0.1, True), (0.7, False), (5.0, False)])
@pytest.mark.parametrize("passed", [-0.5, -0.2, 0.0, 0.4])
def test_a_minimum_is_narrowed_as_long_as_it_may_be_the_side_of_a_smaller_one(floor, falls, passed):
    """Of sigma_min = |t - passed| with a floor, sampled once a second: straight down to zero, or flat at its bottom."""
    t = np.array([-1.0, 0.0, 1.0])
    motion = replace(refkin.solve(REGULAR_MOTION), t=t, sigma_min=np.hypot(t - passed, floor))

    assert _falls(motion, 1) is falls


@pytest.mark.parametrize(("scene", "blamed"), [(PASSED, set()), (REGULAR_MOTION, {"no answer"})])
def test_no_answer_is_a_fault_but_where_the_motion_all_but_meets_a_singular_pose(scene, blamed):
    assert kinds(scene, Mute()) == blamed
    assert kinds(scene, Short()) == {"no answer"}


class Silent(ClosedForm):
    """An engine without an answer at some of the times."""

    name = "silent"

    def __init__(self, at):
        self.at = at

    def solve(self, scene, route=None):
        motion = super().solve(scene, route)
        silent = np.isin(np.arange(len(motion.t)), self.at)
        status = tuple(Status.NOT_CONVERGED if none else Status.OK for none in silent)
        q, qd, qdd = (np.where(silent, np.nan, level) for level in motion.levels)
        return replace(motion, status=status, q=q, qd=qd, qdd=qdd, producer=replace(motion.producer, name=self.name))


@pytest.mark.parametrize(
    ("at", "blamed"), [(range(1, 10), set()), ((1, 2, 5), {"no answer"}), ((1, 2), set()), ((2,), {"no answer"})]
)
def test_who_is_right_after_a_nearly_singular_pose_is_not_excused_by_it_later(at, blamed):
    """It is passed before the second time."""
    assert kinds(PASSED, Silent(at)) == blamed


@pytest.mark.parametrize(("longer", "sigma", "blamed"), [(1.7e-7, 0.95e-4, set()), (2.1e-7, 1.06e-4, {"no answer"})])
def test_a_pose_excuses_up_to_a_ten_thousandth_of_sigma_min(longer, sigma, blamed):
    """By how much the longest link of a change point is off says how near to singular it passes."""
    law = Polynomial(coefficients=(math.pi, 1.0))
    scene = FourBar(ground=4.0, crank=1.0, coupler=3.5, rocker=1.5 + longer).scene(law=law, times=(-0.5, 0.0, 0.5))

    assert refkin.solve(scene).sigma_min[1] == pytest.approx(sigma, rel=0.01, abs=0.0)
    assert kinds(scene, Mute()) == blamed


@pytest.mark.parametrize("engine", ["pinocchio", "mujoco"])
def test_full_turns_of_a_constant_angle_do_not_round_what_hangs_on_it(engine, monkeypatch):
    turned, right = restated(TURNED), reference(TURNED).motion

    def off():
        motion = load(engine).solve(turned)
        return max(np.max(np.abs(motion[body].q - right[body].q)[:2]) for body in right.bodies)

    assert kinds(TURNED, engine) == set()
    assert off() < 4e-15
    monkeypatch.setattr(joint_tree, "_within_a_turn", lambda angle: angle)
    assert off() > 1e-13


def test_a_minimum_is_a_pose_that_is_ok_and_no_farther_from_singular_than_those_beside_it():
    """A pose that is not ok is no neighbour: whatever its sigma_min, those beside it may be minima."""
    motion = refkin.solve(replace(REGULAR_MOTION, times=tuple(0.1 * k for k in range(7))))
    ok, bad, sigma = Status.OK, Status.NOT_CONVERGED, np.array([0.3, 0.4, 0.2, 0.2, 0.1, 0.5, 0.4])
    some = replace(motion, status=(ok, ok, ok, ok, bad, ok, ok), sigma_min=sigma)

    assert [(s, k) for s, k, _ in _minima(some)] == [(0.3, 0), (0.2, 2), (0.2, 3), (0.4, 6)]


def test_times_are_put_evenly_between_each_two():
    assert _within((0.0, 1.0, 3.0), 3) == [0.25, 0.5, 0.75, 1.5, 2.0, 2.5]


@pytest.mark.parametrize(("before", "first"), [(Status.OK, -1.0), (Status.NOT_CONVERGED, 0.0)])
def test_a_minimum_is_narrowed_from_the_pose_before_it_if_there_is_one(before, first):
    solved = refkin.solve(REGULAR_MOTION)
    motion = replace(solved, t=np.array([-1.0, 0.0, 1.0]), status=(before, Status.OK, Status.OK))
    (narrowed,) = _narrowed(REGULAR_MOTION, motion, 1)
    k = int(first) + 1

    assert (narrowed.times[0], narrowed.times[-1]) == (first, 1.0)
    assert narrowed.mechanism.bodies[0].estimate == tuple(solved.q[:3, k].tolist())


def test_of_many_minima_the_lowest_are_narrowed(monkeypatch):
    """They come in the order of time, the lowest last."""
    narrowed, found = [], [(1.0 / (k + 1), k, None) for k in range(NARROWED + 3)]
    monkeypatch.setattr(delivery, "solve", lambda _: None)
    monkeypatch.setattr(delivery, "_minima", lambda _: iter(found))
    monkeypatch.setattr(delivery, "_narrowed", lambda _, motion, k: narrowed.append(k) or [])

    assert singular_between(REGULAR_MOTION, 1e-3) is None
    assert sorted(narrowed) == [k for _, k, _ in found[3:]]


def test_a_regular_motion_is_looked_into_once_beside_each_of_its_smallest_values(monkeypatch):
    solved = []
    monkeypatch.setattr(delivery, "solve", lambda scene: solved.append(scene) or refkin.solve(scene))

    assert singular_between(REGULAR_MOTION, REGULAR) is None
    assert len(solved) <= 1 + 2 * NARROWED


def test_a_scene_is_looked_into_once_for_all_that_give_no_answer_from_a_time_on(monkeypatch):
    asked = []
    monkeypatch.setattr(checking, "excuse", lambda *some: asked.append(some))
    record = check(REGULAR_MOTION, [Mute(), Mute()])

    assert [d.kind for d in record.disagreements] == [Cause.NO_ANSWER] * 2
    assert len(asked) == 1
