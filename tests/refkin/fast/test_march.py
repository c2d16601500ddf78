"""The quintic and the march: predictions have the error they are said to have, and steps keep to the branch."""

from __future__ import annotations

import importlib
import math
from types import SimpleNamespace

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from refkin import FourBar
from refkin.fast.march import FAR, SMALL, Guesses, Pose, at, coefficients, factor, predicted, slope, weights
from refkin.fast.prepare import prepared

from .scenes import ROCKER, bare

sweep = importlib.import_module("refkin.fast.sweep")
COEFFICIENTS = st.lists(st.floats(-2.0, 2.0), min_size=6, max_size=6)


def levels(polynomial, t):
    p = np.polynomial.Polynomial(polynomial)
    return [[float(p.deriv(k)(t) if k else p(t))] for k in range(3)]


@given(COEFFICIENTS, st.floats(0.125, 2.0), st.floats(-1.0, 3.0))
def test_a_quintic_is_reproduced(polynomial, h, s):
    p = np.polynomial.Polynomial(polynomial)
    (result,) = coefficients(levels(polynomial, 0.5), levels(polynomial, 0.5 + h), h)
    added_up = sum(x * h**order for order, (x,) in enumerate(levels(list(map(abs, polynomial)), 0.5 + h)))
    size = 1000 * 2.0**-53 * added_up * max(1.0, abs(s)) ** 5

    assert at(result, s) == pytest.approx(p(0.5 + s * h), abs=size)
    assert slope(result, s) / h == pytest.approx(p.deriv()(0.5 + s * h), abs=size / h)


@given(COEFFICIENTS, st.floats(0.125, 2.0), st.floats(1.0, 3.0))
def test_weights_are_those_of_the_same_polynomial(polynomial, h, s):
    before, last = (levels(polynomial, t) for t in (0.5, 0.5 + h))
    value, rate = weights(0.5, 0.5 + h, 0.5 + s * h)
    data = [x[0] for x in (*before, *last)]
    (result,) = coefficients(before, last, h)

    assert np.dot(value, data) == pytest.approx(at(result, s), abs=1e-9)
    assert np.dot(rate, data) == pytest.approx(slope(result, s) / h, abs=1e-8 / h)


def test_a_prediction_errs_512_times_as_much_as_the_quintic_between():
    """sin t has the sixth derivative -sin t; steps of 0.1 around pi/2, where that hardly changes."""
    h, t = 0.1, math.pi / 2

    def pose(t):
        return Pose(t, ((math.sin(t),), (math.cos(t),), (-math.sin(t),)), ())

    (ahead,), (rate,) = predicted(t + h, pose(t), pose(t - h))
    (between,) = coefficients(pose(t - h).levels, pose(t).levels, h)
    off, inside = ahead - math.sin(t + h), at(between, 0.5) - math.sin(t - h / 2)

    assert abs(off / inside) == pytest.approx(512, rel=0.05, abs=0.0)
    assert (rate - math.cos(t + h)) * h / off == pytest.approx(4.5, rel=0.05, abs=0.0)


def test_a_step_that_predicts_well_grows_and_another_shrinks():
    assert factor(FAR / 64) == pytest.approx(0.9 * 2)
    assert factor(64 * FAR) == pytest.approx(0.9 / 2)
    assert factor(0.0) == 3.0


def task(linkage=ROCKER, samples=400, **options):
    return sweep._Task(prepared(bare(linkage.scene(samples=samples, **options))))


def test_a_march_takes_few_steps():
    """One turn of a smooth four-bar."""
    work = task()
    poses = work._marched(work._start())

    assert len(poses) < 16
    assert work.march.steps < 20


def test_marched_poses_are_on_the_branch_of_the_closed_form():
    linkage = FourBar(ground=4.0, crank=1.0, coupler=3.5, rocker=1.5 + 1e-6)
    work = task(linkage)
    for pose in work._marched(work._start()):
        coupler, rocker = pose.levels[0]
        own = linkage.assemble(2.0 * pose.t, "open")
        assert abs(np.angle(np.exp(1j * (coupler - own["coupler"][2])))) < 1e-11
        assert abs(np.angle(np.exp(1j * (rocker - own["rocker"][2])))) < 1e-11


def test_no_step_turns_a_driven_link_by_more_than_a_radian():
    work = task(turns=5, samples=3)
    poses = work._marched(work._start())

    assert np.max(np.diff([2.0 * p.t for p in poses])) <= 1.0


def test_a_step_to_the_other_branch_a_bend_and_numbers_that_leave_their_range_are_refused():
    """On the mirrored branch Newton contracts: the determinant tells; rates are others as beyond a crossing."""
    work = task()
    start, other = work._start(), ROCKER.assemble(0.0, "crossed")
    pose, rates, second = start.levels
    mirrored = (other["coupler"][2], other["rocker"][2]), rates, second
    bent, lost = (pose, tuple(v + 0.5 for v in rates), second), ((math.inf, 0.0), rates, second)

    for h, levels in ((1e-6, mirrored), (1e-3, bent), (0.1, lost)):
        assert work.march.step(h, start, None) is not None
        assert work.march.step(h, Pose(start.t, levels, start.laws), None) is None


@pytest.mark.parametrize(("slack", "begins"), [(0.7e-9, False), (0.85e-9, True)])
def test_no_march_begins_where_branches_are_a_hundred_thousandth_apart(slack, begins):
    """The pivot goes with the root of the slack: 0.96e-5 and 1.06e-5."""
    linkage = FourBar(ground=4.0, crank=1.0, coupler=3.5, rocker=1.5 + slack)
    march, pose = task(linkage).march, linkage.assemble(math.pi, "open")
    core, laws = (pose["coupler"][2], pose["rocker"][2]), march.laws(math.pi / 2)

    assert 0.95e-5 < march._newton(laws, core).pivots[0] < 1.07e-5
    assert (march.start(math.pi / 2, core, laws) is not None) is begins


def test_a_march_ends_after_so_many_steps():
    work = task()
    start = work._start()
    work.march.most_steps = 3

    assert work.march.to(100.0, start) is None
    assert work.march.steps == 3


def test_a_march_goes_by_way_of_the_times_at_which_laws_turn_back():
    work = task()
    start = work._start()
    work.march.extrema = lambda a, b: [t for t in (0.0123,) if a < t < b]

    assert 0.0123 in [pose.t for pose in work.march.to(0.1, start)]


@pytest.mark.parametrize(("off", "same"), [(0.5 * SMALL, True), (2.0 * SMALL, False), (None, False)])
def test_steps_around_times_are_quartered_if_that_leads_to_the_same_pose(off, same):
    """A coordinate is the time, the other may be off; None leads nowhere."""
    poses, asked = [Pose(t, ((t, 0.0),), (), path=[(0.0,) * 6]) for t in (0.0, 1.0, 2.0, 3.0)], []

    def to(t, start, h):
        asked.append((start.t, t))
        between = [poses[0]._replace(t=s, levels=((s, off),)) for s in start.t + h * np.arange(1, 5)]
        return None if off is None else between

    guesses = Guesses([*poses])

    assert guesses.quarter(np.array([0.2, 0.3, 2.5]), SimpleNamespace(to=to)) is same
    assert asked == [(2.0, 3.0), (0.0, 1.0)][: 1 + same]
    assert guesses.t.tolist() == [0.0, *[0.25, 0.5, 0.75] * same, 1.0, 2.0, *[2.25, 2.5, 2.75] * same, 3.0]
    assert guesses.width.tolist() == np.diff(guesses.t).tolist()
    assert Guesses(poses[:1]).quarter(np.array([0.0]), None) is False
