"""Newton on callables: the sources' scalar examples, their four stopping tests, and every way to end."""

from __future__ import annotations

import re

import numpy as np
import pytest

import refkin
from crosscheck.documents.stopping import BothLargest, ResidualOrCorrection, ScaledNorms
from refkin.newton import CorrectionNorm, NewtonStatus, RoundOff, newton


def parabola(x):
    return x**2 - 4 * x + 1


def parabola_slope(x):
    return 2 * x - 4


def test_the_iterates_of_the_notes_are_reproduced():
    """ME581: x^2 - 4x + 1 from 5."""
    result = newton(parabola, parabola_slope, 5.0)

    assert result.converged
    assert result.iterates[:5, 0] == pytest.approx([5, 4, 3.75, 3.73214286, 3.73205081], abs=5e-9)
    assert result.residuals[:4, 0] == pytest.approx([6, 1, 0.0625, 0.00031888], abs=5e-9)
    assert -result.corrections[:4, 0] == pytest.approx([1, 0.25, 0.01785714, 0.00009205], abs=5e-9)


def test_it_ends_at_the_last_bit():
    assert newton(parabola, parabola_slope, 5.0).q[0] == pytest.approx(2 + np.sqrt(3), rel=2.3e-16)


@pytest.mark.parametrize(
    ("stop", "iterations"),
    [
        (CorrectionNorm(1e-2), 4),
        (ResidualOrCorrection(0.1, 1e-12), 3),
        (ResidualOrCorrection(1e-12, 0.3), 2),
        (BothLargest(0.1, 0.3), 3),
        (BothLargest(10.0, 1e-3), 4),
        (ScaledNorms(0.3), 2),
    ],
    ids=lambda value: type(value).__name__,
)
def test_each_stopping_test_stops_where_its_numbers_say(stop, iterations):
    """Residuals 6, 1, 0.0625, 0.00031888; corrections 1, 0.25, 0.0179, 0.000092."""
    result = newton(parabola, parabola_slope, 5.0, stop=stop)

    assert result.converged
    assert result.iterations == iterations


def test_a_negative_residual_does_not_stop_it():
    """METU 3.9 prints its test without absolute values: from 2.5 the residual is -2.75."""
    assert newton(parabola, parabola_slope, 2.5, stop=ResidualOrCorrection(1e-9, 1e-9)).iterations > 3


def test_scaled_norms_divide_by_the_number_of_components():
    phi = np.array([3e-4, 4e-4, 0.0])

    assert ScaledNorms(1.7e-4)(phi, phi, phi)
    assert not ScaledNorms(1.6e-4)(phi, phi, phi)


@pytest.mark.parametrize(
    ("phi", "slope", "start", "status"),
    [
        (lambda x: x**2 + 4, lambda x: 2 * x, 5.0, NewtonStatus.ITERATION_LIMIT),
        (parabola, parabola_slope, 2.0, NewtonStatus.SINGULAR),
        (lambda x: np.log(x), lambda x: 1 / x, 9.0, NewtonStatus.NOT_FINITE),
        (lambda x: x - np.nan, lambda x: 1 + 0 * x, 1.0, NewtonStatus.NOT_FINITE),
    ],
    ids=["no root", "slope zero", "leaves the domain", "nan"],
)
def test_it_never_says_converged_without_a_root(phi, slope, start, status):
    assert newton(phi, slope, start).status is status


def test_the_cap_is_kept_and_everything_is_recorded():
    result = newton(lambda x: x**2 + 4, lambda x: 2 * x, 5.0, max_iterations=7)

    assert result.iterations == 7
    assert result.iterates.shape == result.residuals.shape == (8, 1)


def test_the_chord_method_keeps_its_first_slope():
    slopes = []

    def slope(x):
        slopes.append(float(x[0]))
        return parabola_slope(x)

    result = newton(parabola, slope, 4.0, jacobian_every=0, stop=CorrectionNorm(1e-10))

    assert result.converged
    assert slopes == [4.0]
    assert result.iterations > 8


def test_damping_finds_a_root_that_full_steps_miss():
    """arctan from 3: full steps diverge."""
    full = newton(np.arctan, lambda x: 1 / (1 + x**2), 3.0)
    damped = newton(np.arctan, lambda x: 1 / (1 + x**2), 3.0, damped=True)

    assert not full.converged
    assert damped.converged
    assert abs(damped.q[0]) < 1e-15


def test_redundant_rows_change_nothing():
    """Three consistent equations for two unknowns."""

    def phi(v):
        return np.array([v[0] ** 2 + v[1] ** 2 - 2, v[0] - v[1], v[0] ** 2 + v[1] ** 2 - 2])

    def slope(v):
        return np.array([[2 * v[0], 2 * v[1]], [1, -1], [2 * v[0], 2 * v[1]]])

    result = newton(phi, slope, [2.0, 0.5])

    assert result.converged
    assert result.q == pytest.approx([1.0, 1.0], abs=4e-16)


def test_round_off_keeps_no_memory_between_solves():
    stop = RoundOff()
    first = newton(parabola, parabola_slope, 5.0, stop=stop)
    second = newton(parabola, parabola_slope, 5.0, stop=stop)

    assert first.iterations == second.iterations


@pytest.mark.parametrize(
    ("q0", "phi_q", "told"),
    [
        ("here", lambda q: [[1.0]], "q0: expected numbers, got 'here'"),
        ([[1.0, 2.0]], lambda q: np.eye(2), r"q0: expected a number or a row of numbers, got shape (1, 2)"),
        ([], lambda q: np.eye(2), "q0: expected a number or a row of numbers, got shape (0,)"),
        (
            [1.0, 2.0],
            lambda q: np.ones((2, 3)),
            "phi_q: expected a matrix of shape (2, 2), got shape (2, 3) of float64",
        ),
        ([1.0, 2.0], lambda q: None, "phi_q: expected a matrix of shape (2, 2), got shape () of object"),
    ],
)
def test_arguments_that_make_no_sense_are_named(q0, phi_q, told):
    with pytest.raises(refkin.errors.InvalidRequest, match=re.escape(told)):
        newton(lambda q: q - 1.0, phi_q, q0)
