"""A sweep over many times at once takes the steps that it takes one by one, and no others."""

from __future__ import annotations

import math
from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest

import refkin
import refkin.solving.solve
from refkin import FourBar, Polynomial, Sinusoid, SliderCrank, Status, compile_system
from refkin.analysis import sigma_min
from refkin.differences import EPS
from refkin.scenes.linkages.base import Branch
from refkin.solving.ahead import SAME, Ahead, Leaps
from refkin.solving.steps import neville
from refkin.solving.sweep import Arrival, Sweep
from tests.linkages import PARALLELOGRAM, ROCKER, remade, system_of
from tests.places import CORPUS

LIMIT = math.acos((16.0 + 9.0 - 25.0) / 24.0)  # a crank of 3 on a ground of 4, coupler and rocker 5 in line
TIMES = tuple(np.linspace(0.0, 1.0, 30))


def turning(scale, start=0.3):
    return Polynomial(coefficients=(start, scale))


def twice(scene):
    """A scene with its first joint twice."""
    m = scene.mechanism
    return remade(scene, joints=(*m.joints, replace(m.joints[0], name="again")))


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
    "a joint that is there twice": twice(ROCKER.scene(law=turning(2 * math.pi), times=TIMES)),
    "past a limit": replace(
        FourBar(ground=4.0, crank=3.0, coupler=2.0, rocker=3.0).scene(law=turning(2.0), times=TIMES[:9]), times=TIMES
    ),
}


def test_newton_s_method_ends_where_nothing_but_rounding_is_left_from_wherever_it_comes():
    """x^2 = 0.0025, of which a correction s leaves 10 s^2; x^2 = -1 has no root."""
    ahead = object.__new__(Ahead)
    ahead.system = SimpleNamespace(phi=lambda q, t: q * q - t, phi_q=lambda q, t: 2.0 * q[None])
    guesses = 0.05 + np.append(np.logspace(-16.0, -2.0, 400), 0.0)

    assert ahead._closed(guesses[None], np.full(401, 0.0025))[0] == pytest.approx(0.05, rel=0.0, abs=0.25 * EPS)
    assert np.isnan(ahead._closed(guesses[None], np.full(401, -1.0))).all()


def test_no_step_is_taken_again_where_determinants_say_enough(monkeypatch):
    """Each was where all were to be proved: that took two to three times as long."""
    monkeypatch.setattr("refkin.solving.ahead.pose_between", None)

    assert refkin.solve(SCENES["a whole turn"], certified=True).verdict is Status.OK


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


@pytest.mark.parametrize(
    "name", ["a whole turn", "a law that turns back", "up to a limit", "a joint that is there twice"]
)
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
    system = system_of(scene)

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


def test_no_step_leads_to_poses_that_do_not_close_redundant_rows():
    """A pin that is there twice, the second time slightly apart: least squares converge, to no pose."""
    scene = SCENES["a joint that is there twice"]
    *joints, again = scene.mechanism.joints
    apart = replace(again, point_i=(again.point_i[0] + 1e-6, again.point_i[1]))
    starts = refkin.solve(scene).q
    system = compile_system(replace(scene.mechanism, joints=(*joints, apart)), unit=scene.mechanism.unit())
    ahead = Ahead(Sweep(system, [TIMES[0]], [system.to_unit(starts)[:, 0]]), np.array(TIMES[1:]), np.zeros(0))

    assert np.isfinite(ahead.q).all()
    assert not ahead.sure.any()


def test_what_is_lost_with_poses_ahead_is_found_without_them(monkeypatch):
    """A sweep that comes to no time after a leap."""
    over, to = Leaps.over, Sweep.to

    def lost(self, done):
        poses = over(self, done)
        self.sweep.leapt = self.ahead is not None
        return [] if self.sweep.leapt else poses

    monkeypatch.setattr(Leaps, "over", lost)
    monkeypatch.setattr(Sweep, "to", lambda self, t: Arrival.STOPPED if self.leapt else to(self, t))

    assert set(refkin.solve(replace(SCENES["a slider"], evidence=frozenset())).status) == {Status.OK}


UNEVEN = np.append(0.0, np.cumsum(np.random.default_rng(5).choice([0.01, 0.1, 0.3, 0.7, 1.1], 40)))
NEARER = np.cumprod(np.random.default_rng(5).choice([0.3, 0.8, 0.98], 30))
STRIDES = {
    "a crank-rocker": (ROCKER, UNEVEN),
    "near a change point": (FourBar(ground=4.0, crank=1.0, coupler=3.5, rocker=1.5 + 1e-3), 0.3 * UNEVEN),
    "towards a flat pose": (PARALLELOGRAM, math.pi - NEARER),
    "at a flat pose": (PARALLELOGRAM, math.pi - 1e-5 * NEARER),
}


@pytest.mark.parametrize("largest", [0.0, 0.3])
@pytest.mark.parametrize("name", STRIDES)
def test_a_step_is_sure_at_once_where_a_step_alone_is_taken(monkeypatch, name, largest):
    """On the way to every fifth time; and at every third, where a law turns back, the pose there is to be alone.

    Predictions are off by more than they are, by any power of ten up to the largest.
    """
    linkage, times = STRIDES[name]
    monkeypatch.setattr("refkin.solving.ahead.DIVISIONS", 0)

    def shifted(times, poses, t):
        return neville(times, poses, t) + largest * np.multiply.outer(np.cos(np.arange(9)), 10.0 ** -(1e5 * t % 9))

    for module in ("ahead", "steps"):
        monkeypatch.setattr(f"refkin.solving.{module}.neville", shifted)
    scene = linkage.scene(law=turning(1.0, 0.0), times=(float(times[0]),))
    system = system_of(scene)
    alone = Sweep(system, [times[0]], [system.to_unit(refkin.solve(scene).q[:, 0])])
    ahead = Ahead(alone, times[1:], times[:0])
    times = ahead.t
    ahead.stops, ahead.turning = np.append(times[:-1:5], times[-1]), np.arange(len(times)) % 3 == 0
    ahead._test(np.arange(len(times) - 1))
    taken = []
    for k, t in enumerate(times[1:].tolist()):
        alone.t[1:], alone.q[1:], alone.asked = (
            times[1 : k + 1],
            ahead.q.T[1 : k + 1],
            np.ptp(ahead.stops[k // 5 :][:2]),
        )
        clear = (k + 1) % 3 or sigma_min(system.phi_q(ahead.q[:, k + 1], t)) > 1e-4
        taken.append(bool(clear and alone._on_branch(alone._corrected(t), t)))

    assert ahead.sure.tolist() == taken
    assert {True, False} == set(taken)


def test_a_straight_correction_is_no_sign_that_the_next_one_is_rounding():
    """Two poses were left 1e-13 off: their bounds said so, 40 and 6 times what the condition lets a float64 pose be."""
    motion = refkin.solve(refkin.load(CORPUS / "closed-by-a-straight-correction.toml"))

    assert np.max(motion.certified_radius.position / motion.condition) < 2.0 * np.finfo(float).eps


@pytest.mark.parametrize(
    ("off", "at", "last", "taken"),
    [
        (0.0, 1, False, [2, 3]),
        (0.0, 1, True, [2, 3, 4]),
        (2 * SAME, 1, True, None),
        (0.0, 4, True, None),
        (0.0, 3, False, []),
    ],
)
def test_a_sweep_takes_the_steps_that_are_sure_from_where_it_is_and_no_more(off, at, last, taken):
    """Of four steps the last may not be sure; one pose was asked for. A coordinate of the sweep may be elsewhere."""
    t, q = np.array([0.0, 1.0, 3.0, 3.5, 4.0]), np.random.default_rng(1).uniform(size=(3, 5))
    poses = [q[:, 0], q[:, 2], q[:, at] + off * np.array([0.0, 1.0, 0.0])]
    sweep = SimpleNamespace(t=[-2.0, -1.0, t[at]], q=poses, step=np.inf)
    ahead = object.__new__(Ahead)
    vars(ahead).update(sweep=sweep, t=t, q=q, sure=np.array([True, True, True, last]), asked=np.arange(5) == 3)
    found = ahead.follow()

    assert (found is None) is (taken is None)
    assert [pose.tolist() for pose in found or []] == [q[:, k].tolist() for k in taken or [] if k == 3]
    assert sweep.t[3:] == t[taken or []].tolist()
    assert [pose.tolist() for pose in sweep.q[3:]] == q[:, taken or []].T.tolist()
    assert sweep.step == (1.0 if taken else np.inf)
