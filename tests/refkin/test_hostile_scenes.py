"""Scenes that once were answered wrongly, or too late, without a word: each by every solver there is."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

import refkin
from refkin import fast
from refkin.motion_laws import Polynomial, Sinusoid

CORPUS = Path(__file__).parents[1] / "corpus"
OK, LOST = refkin.Status.OK, refkin.Status.BRANCH_LOST


def scene(name, **changes):
    return replace(refkin.load(CORPUS / name), **changes)


def statuses(motion):
    return "".join("o" if status is OK else "." for status in motion.status)


def test_the_fast_sweep_goes_by_way_of_a_pulse_in_a_table():
    motion = fast.sweep(scene("fast-table-pulse.toml"))

    assert motion.status == (OK, LOST, LOST)


def test_a_family_goes_by_way_of_a_pulse_in_a_table():
    many = fast.solve_many(scene("fast-table-pulse.toml", evidence=frozenset()), {"e1P": {"point_j": (np.zeros(3), 0)}})

    assert many.ok.tolist() == [[True, False, False]] * 3


@pytest.mark.parametrize(
    "law",
    [
        Sinusoid(amplitude=np.array([0.05, 0.2, 0.5]), angular_frequency=np.full(3, 44.0), offset=1.4559, phase=0.0),
        Sinusoid(amplitude=np.array([0.05, 0.2, 0.5]), angular_frequency=44.0, offset=1.4559, phase=0.0),
        Polynomial(coefficients=(1.4559, np.array([0.2, 0.8, 2.0]), np.array([-0.2, -0.8, -2.0]))),
    ],
    ids=["rows in the times of turning", "the same times in all", "polynomials"],
)
def test_mechanisms_of_a_family_are_lost_where_a_law_of_their_own_passes_the_limit(law):
    pulse = scene("fast-table-pulse.toml", evidence=frozenset())
    many = fast.solve_many(pulse, {"e0d": {"law": law}})

    assert many.ok[:, 1].tolist() == [True, False, False]
    assert [refkin.solve(many.scene(lane)).status[1] is OK for lane in range(3)] == [True, False, False]


def test_lengths_of_a_family_pass_zero_with_rows_and_without():
    lever = scene("distance-through-zero.toml", evidence=frozenset())
    slopes = np.array([-1.0, -0.4, -0.9])
    own = fast.solve_many(lever, {"cyl": {"law": Polynomial(coefficients=(0.5, slopes))}})
    common = fast.solve_many(lever, {"O": {"point_j": (np.zeros(2), 0.0)}})

    assert own.ok.tolist() == [[True, False], [True, True], [True, False]]
    assert common.ok.tolist() == [[True, False]] * 2


def test_the_fast_sweep_does_not_pass_a_limit_by_a_law_that_turns_a_rounding_beyond_it():
    motion = fast.sweep(scene("fast-limit-1e-17.toml"))

    assert statuses(motion) == "ooooooo..."


def test_times_a_denormal_number_apart_are_times_like_others():
    motion = fast.sweep(scene("fast-denormal-times.toml"))

    assert motion.producer.name == "refkin.fast"
    assert statuses(motion) == "oooo"
    assert motion["crank"].phi == pytest.approx([0.3, 0.3, 0.3, 1.3], abs=1e-15)
