"""What a record keeps for pictures: the sample that is worst, how far off it is, what rounding leaves, who agrees."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from crosscheck.judge.comparison import compare, reference
from crosscheck.judge.samples import attainable, common_sample, cycle, off_at, worst_samples
from crosscheck.measure.check import check
from refkin import FourBar, Polynomial, solve

OFF = 3e-7


@pytest.fixture(scope="module")
def scene():
    linkage = FourBar(ground=4.0, crank=1.0, coupler=3.5, rocker=3.0)
    return linkage.scene(speed=2.0, turns=1, samples=12, branch="open")


@pytest.fixture(scope="module")
def ref(scene):
    return reference(scene)


def shifted(scene, sample, by=OFF):
    """The reference's own answer with the rocker's angle wrong at one time."""
    motion = solve(scene)
    q = motion.q.copy()
    q[8, sample] += by
    return replace(motion, q=q)


@pytest.mark.parametrize("sample", [0, 5, 11])
def test_worst_sample_is_the_one_that_is_wrong(scene, ref, sample):
    found = compare(ref, shifted(scene, sample)).quantities["position"]
    decade = str(int(np.floor(np.log10(ref.sigma_min[sample]))))
    kept = worst_samples(ref.sigma_min, found)[decade]

    assert (sample, 6.5) == (kept["k"], kept["digits"])
    assert pytest.approx(kept["off"], rel=0.01) == [0.0] * 8 + [OFF]


def test_answer_for_some_bodies_says_nothing_of_the_others(scene, ref):
    motion = solve(replace(scene, bodies_wanted=("coupler",)))
    kept = worst_samples(ref.sigma_min, compare(ref, motion).quantities["position"])

    for sample in kept.values():
        assert [value is None for value in sample["off"]] == [True] * 3 + [False] * 3 + [True] * 3


def test_common_sample_is_the_same_time_for_every_answer(scene, ref):
    common = common_sample(ref)
    right, wrong = (
        compare(ref, motion).quantities["position"] for motion in (solve(scene), shifted(scene, common["k"]))
    )

    assert off_at(right, common) == [0.0] * 9
    assert pytest.approx(off_at(wrong, common), rel=0.01) == [0.0] * 8 + [OFF]


def test_errors_over_the_cycle_come_back_to_two_figures(scene, ref):
    found = compare(ref, shifted(scene, slice(None, 3))).quantities["position"]
    kept = cycle(found)

    assert len(kept["off"]) == 12
    angles = [kept["unit"] * row[8] for row in kept["off"]]
    assert angles == pytest.approx([OFF] * 3 + [0.0] * 9, abs=OFF / 99)


def test_attainable_digits_are_fewer_near_a_fold():
    fold = FourBar(ground=90.0, crank=30.0, coupler=60.0, rocker=45.0)
    limit = fold.input_range()[0][1]
    times = (limit - 1e-2, limit - 1e-6)
    found = attainable(reference(fold.scene(law=Polynomial(coefficients=(0.0, 1.0)), times=times)))

    for quantity in ("position", "velocity", "acceleration"):
        far, near = found[quantity]
        # sigma goes with the square root of the distance: two of four decades, once or more in each quantity
        assert far - near > 1.5


def test_record_holds_its_scene_and_a_sample_for_each_decade_of_digits(scene):
    record = check(scene, ["closed_form"])
    (answer,) = record["answers"]

    assert record["scene_file"]["body"][0]["name"] == scene.mechanism.bodies[0].name
    for quantity in answer["quantities"].values():
        assert quantity["samples"].keys() == quantity["digits_by_sigma"].keys()
        for decade, sample in quantity["samples"].items():
            assert min(map(float, quantity["digits_by_sigma"][decade])) == pytest.approx(sample["digits"])
