"""What digits are held against: attainable errors bound what half an ulp of the scene does; fixed scenes are hard."""

from __future__ import annotations

import math
from dataclasses import replace
from functools import cache
from pathlib import Path

import numpy as np
import pytest

from crosscheck.documents.ledger.page import digits_by_iteration
from crosscheck.judge.truth import CertifiedTruth, attainable_levels
from crosscheck.measure.price import price_list
from crosscheck.scenes.hard import AWAY, REGULAR, priced_classes
from refkin.motion_laws import Polynomial
from refkin.proof.numbers.inputs import half_ulp
from refkin.proof.pose.krawczyk import krawczyk
from refkin.scenes.linkages import FourBar

LENGTHS = {"ground": 4.1, "crank": 1.3, "coupler": 3.7, "rocker": 3.1}
QUANTITIES = ("position", "velocity", "acceleration")


def enclosed(system, q):
    """Return position, velocity and acceleration at t = 0, right to far more digits than binary64 has."""
    root = krawczyk(system, q, 0.0, bits=113)
    qd = root.velocity()
    return [list(level) for level in (root.q, qd, root.acceleration(qd))]


@pytest.mark.parametrize("seed", range(8))
def test_an_ulp_of_the_lengths_moves_each_level_by_what_attainable_says_at_most(seed):
    rng = np.random.default_rng(seed)
    beside = {k: float(np.nextafter(x, x + rng.choice([-1.0, 1.0]))) for k, x in LENGTHS.items()}
    given = {"law": Polynomial(coefficients=(0.7, 1.9, -0.4)), "times": [0.0]}
    one, two = (CertifiedTruth(FourBar(**lengths).scene(**given)) for lengths in (LENGTHS, beside))
    q = one.ref.levels[0][:, 0]
    pairs = zip(enclosed(one.ref.system, q), enclosed(two.ref.system, q), strict=True)
    for order, ((allowed, level), (a, b)) in enumerate(zip(attainable_levels(one.ref, one.known), pairs, strict=True)):
        moved = np.abs([float(x - y) for x, y in zip(a, b, strict=True)])
        carried = (allowed - half_ulp(one.ref.system, level, order))[:, 0]

        # A neighbour is at most two half-ulps away; second order: 1e-9 of it.
        assert np.all(moved <= 2 * carried * (1 + 1e-9))
        assert np.max(moved) > 0.01 * np.max(carried)


@cache
def attainable(name):
    return CertifiedTruth(priced_classes()[name]).attainable


@pytest.mark.parametrize("quantity", QUANTITIES)
@pytest.mark.parametrize("name", ["near a change point", "near a dead centre"])
def test_the_hard_scenes_leave_fewer_digits_than_the_regular_one(name, quantity):
    assert attainable(name)[quantity] < attainable("regular")[quantity] - 1.0


def test_far_from_the_origin_positions_in_metres_lose_the_digits_that_the_offset_takes():
    """Half an ulp of the answer, and of the two ground points, whose distance is known to that: through the linkage."""
    of_the_answer = -math.log10(np.spacing(AWAY) / 2 / 4.0)  # in sizes of 4 m

    assert of_the_answer - 1.0 < attainable("far from the origin")["position"] < of_the_answer


def test_a_truth_far_from_the_origin_is_not_called_better_than_its_rounding_to_metres():
    truth = CertifiedTruth(priced_classes()["far from the origin"])
    digits, note = truth.digits(truth.ref.motion.q, 0)

    assert digits == pytest.approx(truth.attainable["position"], abs=0.5)
    assert "truth proved to" in note


@pytest.mark.parametrize("name", ["regular", "near a change point", "near a dead centre", "far from the origin"])
def test_every_pose_of_the_fixed_scenes_is_certified(name):
    assert CertifiedTruth(priced_classes()[name]).known.all()


def test_a_body_that_is_not_wanted_costs_no_digits():
    scene = REGULAR.scene(turns=0.1, samples=3)
    motion = CertifiedTruth(scene).ref.motion
    off = np.array(motion.q)
    off[0] += 1e-3
    assert CertifiedTruth(scene).digits(off, 0)[0] < 5.0
    assert CertifiedTruth(replace(scene, bodies_wanted=("rocker",))).digits(off, 0)[0] > 14.0


def test_the_price_list_has_the_class_of_each_row():
    fakes = Path(__file__).parent / "price_fakes.py"
    rows = price_list(within=4.0, producers=[f"{fakes}:PositionAlone"])

    assert [row["scene_class"] for row in rows] == list(priced_classes())
    assert all(row["microseconds"] > 0.0 for row in rows)


def by_iteration(quantity):
    return {r["iteration"]: r["digits"] for r in digits_by_iteration() if r["quantity"] == quantity}


@pytest.mark.parametrize(("quantity", "printed"), [("velocity", 1.7), ("acceleration", 1.9)])
def test_of_the_five_digits_that_the_notes_print_two_are_right_at_best(quantity, printed):
    digits = by_iteration(quantity)

    assert digits["printed"] == pytest.approx(printed, abs=0.05)
    assert digits["1"] == pytest.approx(digits["printed"], abs=0.05)


@pytest.mark.parametrize(("iteration", "whole"), [("2", 4), ("3", 10), ("4", 14)])
def test_further_iterations_double_the_digits(iteration, whole):
    assert min(by_iteration(quantity)[iteration] for quantity in QUANTITIES) >= whole
