"""Small numbers that judgements rest on, where a random change of the code has survived all other tests."""

from __future__ import annotations

import time
from collections.abc import Callable
from dataclasses import replace
from typing import Any

import numpy as np
import pytest
from flint import arb

import refkin
from crosscheck.engines import Level
from crosscheck.engines.loading import load
from crosscheck.judge import levels
from crosscheck.judge.comparison import reference
from crosscheck.judge.hard_poses import _judged, fold
from crosscheck.judge.known_gaps import finding_of, read_findings
from crosscheck.judge.levels import compare_levels, configurations
from crosscheck.judge.rounding import output_rounding
from crosscheck.judge.running_error import U
from crosscheck.measure.check import check
from refkin import FourBar, Polynomial, compile_system
from refkin.proof.pose.krawczyk import Verdict

SCENE = FourBar(ground=4.0, crank=1.0, coupler=3.5, rocker=3.0).scene(samples=3)


@pytest.mark.parametrize(("k", "f"), [(0.25, 0.1), (1.0, 1e-16), (1.0, 0.49), (1.0, 0.1), (3.0, 0.1)])
def test_what_a_residual_hides_solves_its_quadratic(k, f):
    s = 1.0
    x = fold(s, k, f)

    assert s * x - k * x * x / 2 == pytest.approx(f, rel=1e-13, abs=0.0)
    assert x < s / k  # the nearer root


def test_an_angle_is_stated_in_radians_and_a_place_in_sizes():
    far = FourBar(ground=4.0, crank=1.0, coupler=3.5, rocker=3.0, origin=(4e3, 0.0)).scene(samples=2)
    system = compile_system(far.mechanism, unit=far.mechanism.unit())
    q = np.array([0.0, 0.0, 40.0] * 3)
    costs = output_rounding(system, *3 * [q[:, None]], np.zeros(1))[0].reshape(3, 3)

    assert costs[:, 2] == pytest.approx(6 * U * 40.0, rel=1e-12, abs=0.0)
    assert costs[:, 0] == pytest.approx(6 * U * 4e3 / far.mechanism.size(), rel=1e-12, abs=0.0)
    assert costs[:, 1] == pytest.approx(6 * U * 40.0, rel=1e-12, abs=0.0)


def residuals(planted: Callable[[Any], Any]):
    """Return the comparison of MuJoCo's residuals with what is planted for the right ones."""
    engine, m = load("mujoco"), SCENE.mechanism
    model, ref = engine.constraints(SCENE), reference(SCENE)
    at = configurations(m, ref.system.to_physical(ref.levels[0]), ref.motion.t, "1", 2)
    exact, model.residual = model.residual, lambda q, t: planted(exact(q, t))
    return compare_levels(engine, model, m, at)[Level.RESIDUAL]


def _nothing_but_1e_12(maps, *_):
    """Return rows of zeros, each allowed to be off by 1e-12: of the Jacobian nine numbers a row, for three bodies."""
    numbers, rows = (len(maps),), (len(maps), 9)
    return {k: (np.zeros(n), np.full(n, 1e-12)) for k in Level for n in [rows if k == Level.JACOBIAN else numbers]}


@pytest.mark.parametrize("fault", [1e-9, 1.0, 2.0])
def test_rows_that_are_off_by_any_number_disagree(fault, monkeypatch):
    """Also by one to the last bit, as an angle that is counted from elsewhere may be."""
    monkeypatch.setattr(levels, "_mapped", _nothing_but_1e_12)

    assert residuals(lambda exact: np.full(99, fault)).ratio == pytest.approx(fault * 1e12)


def test_digits_of_rows_are_many_where_they_agree_and_few_where_they_do_not():
    assert min(residuals(lambda exact: exact).digits) > 13.0
    assert all(6.0 < digits < 10.0 for digits in residuals(lambda exact: exact + 1e-8).digits)


def test_an_answer_takes_no_longer_than_the_check_it_is_part_of():
    start = time.perf_counter()
    record = check(SCENE, ["closed_form"])
    elapsed = time.perf_counter() - start

    assert all(0.0 < answer.seconds < elapsed for answer in record.answers)


def test_a_step_counts_by_the_smaller_sigma_at_its_ends():
    """The smallest sigma is in the middle, and the step after it is the longest."""
    linkage = FourBar(ground=4.0, crank=1.0, coupler=3.5, rocker=1.6)
    scene = linkage.scene(law=Polynomial(coefficients=(0.0, 1.0)), times=(2.9, 3.14, 3.9))
    motion, size = refkin.solve(scene), scene.mechanism.size()
    scale = np.tile([size, size, 1.0], 3)[:, None]
    moves = np.max(np.abs(np.diff(motion.q, axis=1)) / scale, axis=0)

    assert np.argmin(motion.sigma_min) == 1
    assert check(scene, []).reference.sigma_per_step == pytest.approx(motion.sigma_min[1] / moves[1], rel=1e-9, abs=0.0)


def test_a_finding_explains_its_own_rows_alone():
    known = read_findings()
    finding = next(f for f in known if f.cases)
    own = {**vars(finding), "case": finding.cases[0]}

    assert finding_of(known, own) is finding
    assert finding_of([finding], {**own, "engine": "another"}) is None
    assert finding_of([replace(finding, cases=("another",))], own) is None


@pytest.mark.parametrize(("known_to", "verdict"), [(0.09, Verdict.INSIDE), (0.11, Verdict.UNDECIDABLE)])
def test_a_root_of_which_one_coordinate_is_hardly_known_decides_nothing(known_to, verdict):
    """The allowed error of the others may be as small as ever: beyond a tenth of a size or radian it says nothing."""
    system = compile_system(SCENE.mechanism, unit=SCENE.mechanism.unit())
    q = system.to_unit(refkin.solve(SCENE).q[:, 0])
    allowed = np.full(len(q), 1e-12)
    rows = np.arange(len(q))

    assert _judged(system, tuple(map(arb, q.tolist())), allowed, q, rows, 0.0).verdict is Verdict.INSIDE
    allowed[4] = known_to
    assert _judged(system, tuple(map(arb, q.tolist())), allowed, q, rows, 0.0).verdict is verdict
