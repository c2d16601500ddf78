"""What a record keeps of comparisons, and the sample that a picture is drawn of."""

from __future__ import annotations

import json
import sys
from dataclasses import replace

import numpy as np
import pytest

from crosscheck.judge.comparison import QuantityComparison, compare, reference
from crosscheck.judge.records import Cause, Disagreement, Unreadable, line_of, read_line
from crosscheck.judge.samples import by_decade, off_at, rounding_digits, short
from crosscheck.measure.check import check
from crosscheck.night.sections import worst_sample
from crosscheck.scenes.names import decade
from refkin import FourBar, Polynomial
from refkin.solving.solve import nearest
from tests.linkages import ROCKER

OFF = 3e-7


@pytest.fixture(scope="module")
def scene():
    return ROCKER.scene(speed=2.0, turns=1, samples=12, branch="open")


@pytest.fixture(scope="module")
def ref(scene):
    return reference(scene)


def shifted(scene, sample, by=OFF):
    """What answers are held against, with the rocker's angle wrong at one time."""
    motion = nearest(scene)
    q = motion.q.copy()
    q[8, sample] += by
    return replace(motion, q=q)


@pytest.mark.parametrize("place", [0, 5, 11])
def test_worst_sample_is_the_one_that_is_wrong(scene, ref, place):
    value = compare(ref, shifted(scene, place)).quantities["position"]
    kept = worst_sample(ref.sigma_min, value, int(np.floor(np.log10(ref.sigma_min[place]))))

    assert (place, 6.5) == (kept.k, kept.digits)
    assert pytest.approx(kept.off[:, place], rel=0.01, abs=0.0) == [0.0] * 8 + [OFF]


def test_a_decade_without_a_sample_has_no_worst(scene, ref):
    assert worst_sample(ref.sigma_min, compare(ref, nearest(scene)).quantities["position"], -9) is None


def test_common_sample_is_the_same_time_for_every_answer(scene, ref):
    common = ref.common
    right, wrong = (
        compare(ref, motion).quantities["position"] for motion in (nearest(scene), shifted(scene, common.k))
    )

    assert off_at(right, common) == [0.0] * 9
    assert pytest.approx(off_at(wrong, common), rel=0.01, abs=0.0) == [0.0] * 8 + [OFF]


def test_rounding_digits_are_fewer_near_a_fold():
    fold = FourBar(ground=90.0, crank=30.0, coupler=60.0, rocker=45.0)
    limit = fold.input_range()[0][1]
    times = (limit - 1e-2, limit - 1e-6)
    digits = rounding_digits(reference(fold.scene(law=Polynomial(coefficients=(0.0, 1.0)), times=times)))

    for quantity in ("position", "velocity", "acceleration"):
        far, near = digits[quantity]
        # sigma goes with the square root of the distance: two of four decades, once or more in each quantity
        assert far - near > 1.5


def test_a_record_comes_back_from_its_line_as_it_was(scene):
    record = check(scene, ["closed_form"], {"kind": "four-bar", "shard": 3}, arbiter=True)

    assert read_line(line_of(record)) == record
    assert record.answers[0].certificate is not None


@pytest.mark.parametrize(("ratio", "agrees"), [(1.0, True), (1.0 + 1e-12, False), (np.inf, False), (np.nan, True)])
def test_an_answer_agrees_up_to_its_budget_at_every_time_that_is_judged(ratio, agrees):
    nothing = np.zeros(3)

    assert QuantityComparison(nothing, np.array([np.nan, ratio, 0.5]), nothing, None).agrees is agrees


def test_a_ratio_that_is_shortened_stays_on_its_side_of_one():
    assert [short(ratio) for ratio in (0.123456789, 41.23456789)] == [0.123457, 41.2346]
    assert short(1.0 + 1e-9) > 1.0 > short(1.0 - 1e-9)
    assert short(sys.float_info.max) == sys.float_info.max


def test_digits_are_counted_by_decade_where_both_they_and_the_distance_to_a_singular_pose_are_known():
    sigma = np.array([3e-3, 1e-3, 0.0, np.nan, 0.5, 0.5, 0.5])
    digits = np.array([5.0, 5.04, 6.0, 7.0, 9.0, np.nan, np.inf])

    assert by_decade([decade(s) for s in sigma], digits) == {-3: {50: 2}, -1: {90: 1}}


def test_a_disagreement_says_its_ratio_if_it_has_one():
    beyond = Disagreement(engine="a", method="b", quantity="position", kind=Cause.BEYOND, ratio=12.34)
    silent = Disagreement(engine="a", method="b", quantity="status", kind=Cause.NO_ANSWER, message="at 3 times")

    assert str(beyond) == "a (b), position: beyond the allowed error, 12.3 times the allowed error; "
    assert str(silent) == "a (b), status: no answer; at 3 times"


def test_a_record_has_a_reference_or_a_failure_and_what_is_wrong_with_it_is_said():
    empty = {key: [] for key in ("answers", "levels", "refusals", "disagreements")} | {"key": 16 * "0", "about": {}}

    assert read_line(json.dumps({**empty, "scene": "a", "failure": "crash"})).failure == "crash"
    with pytest.raises(Unreadable, match=r"^reference: missing; expected one, or a failure$"):
        read_line(json.dumps({**empty, "scene": "a"}))
    with pytest.raises(Unreadable, match=r"^scene: missing; field required$"):
        read_line(json.dumps(empty))
    with pytest.raises(Unreadable, match=r"^scene: 3; input should be a valid string$"):
        read_line(json.dumps({**empty, "scene": 3}))
