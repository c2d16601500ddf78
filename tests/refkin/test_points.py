"""Points fixed in a body and moving in it: parts of velocity and acceleration, and the Coriolis example."""

from __future__ import annotations

import math
from dataclasses import fields

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

import refkin
from crosscheck.documents.loops import PointParts, point_parts, rod_and_block
from refkin.differences import EPS
from refkin.motion import point_motion

NUMBERS = st.floats(-3.0, 3.0)
TRIPLE = st.tuples(NUMBERS, NUMBERS, NUMBERS).map(np.array)
PAIR = st.tuples(NUMBERS, NUMBERS)


@given(u=PAIR, ud=PAIR, udd=PAIR, q=TRIPLE, qd=TRIPLE, qdd=TRIPLE)
def test_rows_of_times_give_what_single_times_give(u, ud, udd, q, qd, qdd):
    row = [np.stack([np.asarray(x, float), 2.0 * np.asarray(x, float)], axis=1) for x in (u, q, qd, qdd, ud, udd)]
    batch = point_parts(*row)
    for k, factor in enumerate((1.0, 2.0)):
        single = point_parts(*(factor * np.asarray(x, float) for x in (u, q, qd, qdd, ud, udd)))
        for name in (f.name for f in fields(PointParts)):
            assert np.abs(getattr(batch, name)[:, k] - getattr(single, name)).max() <= 4 * EPS * 1000, name


def test_a_fixed_point_has_no_relative_and_no_coriolis_part():
    parts = point_parts((0.3, 0.4), *np.array([[1.0, 2.0, 0.5], [0.1, 0.2, 3.0], [4.0, 5.0, 6.0]]))

    assert not np.any([parts.v_relative, parts.a_coriolis, parts.a_relative])


def test_no_answer_stays_no_answer():
    """NaN where a body's pose is not known."""
    q = np.array([[0.0, np.nan], [0.0, np.nan], [0.0, np.nan]])
    motion = point_motion((1.0, 0.0), q, q, q)

    assert np.isnan(motion.a[:, 1]).all()
    assert not np.isnan(motion.a[:, 0]).any()


def test_rates_that_are_not_given_are_not_reported():
    q = np.zeros((3, 2))

    assert point_motion((1.0, 0.0), q).v is None
    assert point_motion((1.0, 0.0), q, q).a is None


# ---- the Coriolis example: crank 2, rod 3, block P on the rod at the crank's end


def example():
    """Crank of length l2 and a rod pivoted at distance d on x; theta2' = 1.3, theta2'' = -0.7."""
    l2, d, theta2, omega2, alpha2 = 0.2, 0.35, 0.9, 1.3, -0.7
    pin = l2 * np.array([math.cos(theta2), math.sin(theta2)])
    x, y = pin - [d, 0.0]
    crank = point_parts((l2, 0.0), *np.array([[0.0, 0.0, theta2], [0.0, 0.0, omega2], [0.0, 0.0, alpha2]]))
    return l2, theta2, omega2, alpha2, math.atan2(y, x), math.hypot(x, y), crank


def test_the_rates_of_rod_and_block_are_those_of_the_notes():
    """theta3' = theta2' l2 cos(theta3 - theta2) / x,  x' = theta2' l2 sin(theta3 - theta2)."""
    l2, theta2, omega2, _, theta3, x, pin = example()
    rates = rod_and_block(theta3, x, pin.v, pin.a)

    assert rates.omega == pytest.approx(omega2 * l2 * math.cos(theta3 - theta2) / x, abs=8 * EPS)
    assert rates.slide_rate == pytest.approx(omega2 * l2 * math.sin(theta3 - theta2), rel=8 * EPS, abs=0.0)


def test_the_accelerations_solve_the_notes_equations_with_the_right_sign():
    """Row 2 of the right side starts +theta2'' l2 cos theta2, which the notes print with a minus."""
    l2, theta2, omega2, alpha2, theta3, x, pin = example()
    rates = rod_and_block(theta3, x, pin.v, pin.a)
    c2, s2, c3, s3 = math.cos(theta2), math.sin(theta2), math.cos(theta3), math.sin(theta3)
    w, xd = rates.omega, rates.slide_rate
    right = np.array(
        [
            -alpha2 * l2 * s2 - omega2**2 * l2 * c2 + w**2 * x * c3 + 2 * w * xd * s3,
            alpha2 * l2 * c2 - omega2**2 * l2 * s2 + w**2 * x * s3 - 2 * w * xd * c3,
        ]
    )
    solved = np.linalg.solve([[-x * s3, c3], [x * c3, s3]], right)

    assert (rates.alpha, rates.slide_acceleration) == pytest.approx(tuple(solved), rel=64 * EPS, abs=0.0)


def test_the_pin_seen_from_the_rod_moves_as_seen_from_the_crank():
    """Three of the five parts of the acceleration are at work: normal, tangential, Coriolis, and relative."""
    *_, theta3, x, pin = example()
    rates = rod_and_block(theta3, x, pin.v, pin.a)
    rod = np.array([[0.0, 0.0, theta3], [0.0, 0.0, rates.omega], [0.0, 0.0, rates.alpha]])
    seen = point_parts((x, 0.0), *rod, (rates.slide_rate, 0.0), (rates.slide_acceleration, 0.0))

    assert seen.v == pytest.approx(pin.v, abs=8 * EPS)
    assert seen.a == pytest.approx(pin.a, abs=8 * EPS)


def test_a_whole_motion_of_the_inverted_slider_crank_is_that_of_rod_and_block():
    """Absolute coordinates against relative motion, over a turn.

    At the crank's fastest the lever turns with 0.2/0.15 of it, so qd and qdd are within 10; phi_q has a condition below
    10: each level carries some 100 roundings of the one before, times these.
    """
    scene = refkin.InvertedSliderCrank(ground=0.35, crank=0.2).scene(samples=37)
    motion = refkin.solve(scene)
    crank, lever = motion["crank"], motion["lever"]
    pin = point_parts((0.1, 0.0), crank.q, crank.qd, crank.qdd)
    slide = np.hypot(*(pin.r - lever.q[:2]))
    rates = rod_and_block(lever.phi, slide, pin.v, pin.a)

    assert rates.omega == pytest.approx(lever.phid, abs=1000 * EPS)
    assert rates.alpha == pytest.approx(lever.phidd, abs=1000 * EPS * 10)
