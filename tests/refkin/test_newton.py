"""Newton on callables: its histories, its stopping tests on both signs, its cap, every way to end."""

from __future__ import annotations

import re
from collections.abc import Callable, Iterator
from itertools import count
from typing import Any

import numpy as np
import pytest

import refkin
from crosscheck.documents.convergence import both_largest, residual_or_correction, scaled_norms
from crosscheck.documents.systems import me581
from refkin.differences import EPS, jacobian
from refkin.newton import CorrectionNorm, NewtonStatus, RoundOff, StoppingTest, is_round_off, newton, solve_linear
from tests.claims import assert_near


@pytest.mark.parametrize(
    ("q0", "phi_q", "told"),
    [
        ("here", lambda q: [[1.0]], "q0: expected numbers, got 'here'"),
        ([[1.0, 2.0]], lambda q: np.eye(2), r"q0: expected a number or a row of numbers, got shape (1, 2)"),
        (None, lambda q: np.eye(1), "q0: expected a number or a row of numbers, got None"),
        ([], lambda q: np.eye(2), "q0: expected a number or a row of numbers, got shape (0,)"),
        (
            [1.0, 2.0],
            lambda q: np.ones((2, 3)),
            "phi_q: expected a matrix of shape (2, 2), got shape (2, 3) of float64",
        ),
        ([1.0] * 6, lambda q: np.ones((4, 9)), "phi_q: expected a matrix of shape (6, 6), got shape (4, 9) of float64"),
        ([1.0, 2.0], lambda q: None, "phi_q: expected a matrix of shape (2, 2), got shape () of object"),
    ],
)
def test_arguments_that_make_no_sense_are_named(q0, phi_q, told):
    with pytest.raises(refkin.errors.InvalidRequest, match=re.escape(told)):
        newton(lambda q: q - 1.0, phi_q, q0)


@pytest.mark.parametrize("key", ["max_iterations", "jacobian_every"])
@pytest.mark.parametrize("count", [-1, 1.5, None])
def test_counts_are_whole_numbers_from_0_on(key, count):
    with pytest.raises(refkin.InvalidRequest, match=f"{key}: expected a whole number from 0 on, got {count}"):
        newton(lambda q: q - 1.0, np.eye, [1.0], **{key: count})


def test_a_number_is_no_stopping_test():
    with pytest.raises(TypeError, match="stop: expected a Callable, got a float"):
        newton(lambda q: q - 1.0, np.eye, [1.0], stop=1e-6)


def test_a_scheme_goes_by_its_name_and_an_unknown_one_is_told_which_there_are():
    assert jacobian(lambda x: x * x, [3.0], "forward", 1e-6) == pytest.approx(np.array([[6.0]]), abs=1e-5)
    with pytest.raises(refkin.InvalidRequest, match="scheme: expected forward or central or complex_step, got 'back'"):
        jacobian(lambda x: x * x, [3.0], "back", 1e-6)


QUADRATIC = me581.quadratic()
SMALL, LARGE = np.array([3e-4, -4e-4, 0.0]), np.array([-30.0, 40.0, 0.0])
"""Of norm 5e-4 and 50, each with components of both signs."""


def counted(limit: int, f: Callable[[Any], Any]) -> Callable[[Any], Any]:
    """Return a function that gives up after so many calls: an iteration that has no end shows itself."""
    calls = iter(range(limit))

    def f_counted(x: Any) -> Any:
        if next(calls, None) is None:
            raise AssertionError(f"the function was called more than {limit} times")
        return f(x)

    return f_counted


def _never(residual: Any, correction: Any, q: Any) -> bool:
    return False


def test_the_history_is_what_happened():
    """Iterates, residuals at each of them, and corrections between them: of x^2 - 4x + 1 from 5."""
    result = newton(*QUADRATIC, 5.0, stop=CorrectionNorm(1e-3))
    assert result.status is NewtonStatus.CONVERGED, f"status {result.status}"
    assert result.iterations == 4, f"{result.iterations} iterations, not 4"
    assert_near(result.iterates[:, 0], [5.0, 4.0, 3.75, 3.7321428571428571, 3.7320508100147275], 1e-15, "iterates")
    assert_near(result.residuals[:, 0], [QUADRATIC.phi([x])[0] for x in result.iterates[:, 0]], 0.0, "residuals")
    assert_near(result.corrections[:, 0], np.diff(result.iterates[:, 0]), 1e-15, "corrections")
    assert result.q[0] == result.iterates[-1, 0], "q is not the last iterate"
    assert result.residual == abs(result.residuals[-1, 0]), "residual is not that of the last iterate"


def test_it_ends_at_round_off():
    """By default it ends at the last bit of a simple root, and halves the error of a double one while it can."""
    assert_near(newton(*QUADRATIC, 5.0).q, [2 + np.sqrt(3.0)], 4.5e-16, "simple root")
    double = newton(lambda x: (x - 1) ** 2, lambda x: 2 * (x - 1), 3.0, max_iterations=100)
    assert double.converged, f"double root: {double.status}"
    # (x - 1)^2 is evaluated without cancellation: nothing stops the halving but the spacing of the numbers at 1.
    assert_near(double.q, [1.0], 1e-15, "double root")
    assert double.iterations > 45, "a double root in fewer steps than halving takes"


def test_each_way_to_end_has_its_status():
    """No root, a vanishing slope, leaving the domain, NaN: none of them is called converged."""
    for phi, slope, start, status in (
        (lambda x: x * x + 4, lambda x: 2 * x, 5.0, NewtonStatus.ITERATION_LIMIT),
        (*QUADRATIC, 2.0, NewtonStatus.SINGULAR),
        (np.log, lambda x: 1 / x, 9.0, NewtonStatus.NOT_FINITE),
        (lambda x: x - np.nan, lambda x: 1 + 0 * x, 1.0, NewtonStatus.NOT_FINITE),
        (lambda x: x * x, lambda x: 2 * x, 0.0, NewtonStatus.CONVERGED),
    ):
        result = newton(phi, slope, start)
        assert result.status is status, f"from {start}: {result.status}, not {status}"
        assert result.converged is (status is NewtonStatus.CONVERGED), f"from {start}: converged {result.converged}"
    hollow = newton(lambda x: np.where(np.abs(x) < 0.5, np.nan, x), lambda x: 1 + 0 * x, 0.6, stop=CorrectionNorm(1.0))
    assert hollow.status is NewtonStatus.NOT_FINITE, f"where there is no residual: {hollow.status}"


def test_the_cap_is_kept():
    """It makes exactly as many corrections as the cap allows, and the counter counts each of them."""
    for cap in (1, 7):
        phi, slope = counted(cap + 20, lambda x: x * x + 4), counted(cap + 20, lambda x: 2 * x)
        result = newton(phi, slope, 5.0, max_iterations=cap, stop=_never)
        assert result.status is NewtonStatus.ITERATION_LIMIT, f"status {result.status}"
        assert result.iterations == cap, f"{result.iterations} iterations under a cap of {cap}"
        assert len(result.iterates) == len(result.residuals) == cap + 1, "the history has another length"


def test_the_default_cap_is_kept():
    """Without a cap of the caller's there is one."""
    result = newton(counted(200, lambda x: x * x + 4), counted(200, lambda x: 2 * x), 5.0)
    assert result.status is NewtonStatus.ITERATION_LIMIT, f"status {result.status}"


def test_stopping_tests_see_both_signs_and_both_limits():
    """Each stopping test looks at the size of what it tests, whatever the sign, and stops below its limit only."""
    either, both = residual_or_correction, both_largest
    big: tuple[tuple[StoppingTest, Any, Any, bool], ...] = (
        (CorrectionNorm(5.01e-4), LARGE, SMALL, True),
        (CorrectionNorm(4.99e-4), SMALL, SMALL, False),
        (CorrectionNorm(1.0), SMALL, LARGE, False),
        (either(5.01e-4, 1e-9), SMALL, LARGE, True),
        (either(4.99e-4, 1e-9), SMALL, LARGE, False),
        (either(1e-9, 5.01e-4), LARGE, SMALL, True),
        (either(1e-9, 4.99e-4), LARGE, SMALL, False),
        (both(4.01e-4, 4.01e-4), SMALL, SMALL, True),
        (both(3.99e-4, 1.0), SMALL, SMALL, False),
        (both(1.0, 3.99e-4), SMALL, SMALL, False),
        (both(1.0, 1.0), LARGE, SMALL, False),
        (both(1.0, 1.0), SMALL, LARGE, False),
        (scaled_norms(1.67e-4), SMALL, LARGE, True),
        (scaled_norms(1.66e-4), SMALL, LARGE, False),
        (scaled_norms(1.67e-4), LARGE, SMALL, True),
        (scaled_norms(1.66e-4), LARGE, SMALL, False),
    )
    for test, residual, correction, stops in big:
        for sign in (1, -1):
            result = test(sign * residual, sign * correction, np.ones(3))
            assert result is stops, f"{test} of {sign * residual} and {sign * correction} is {result}"
    for limit in (-1e-3, 1e-3):  # one component alone, below the limit by its sign but not by its size
        for test in (CorrectionNorm(1e-8), either(), both(), scaled_norms()):
            assert not test(np.array([limit]), np.array([limit]), np.ones(1)), f"{test} stops at {limit}"


def test_stopping_tests_end_runs_where_their_numbers_say():
    """Residuals 6, 1, 0.0625, 0.00032 and corrections 1, 0.25, 0.018, 0.000092 end each test at its own step."""
    for test, iterations in (
        (CorrectionNorm(1e-2), 4),
        (residual_or_correction(0.1, 1e-12), 3),
        (residual_or_correction(1e-12, 0.3), 2),
        (both_largest(0.1, 0.3), 3),
        (both_largest(10.0, 1e-3), 4),
        (scaled_norms(0.3), 2),
    ):
        value = newton(*QUADRATIC, 5.0, stop=test).iterations
        assert value == iterations, f"{test} stops after {value}, not {iterations}"
    assert newton(*QUADRATIC, 2.5, stop=residual_or_correction(1e-9, 1e-9)).iterations > 5, "stopped at a negative F"


def test_the_jacobian_is_renewed_as_asked():
    """Full Newton evaluates it in each step, the chord method once, and every second step means that."""
    for every, slopes in ((1, 6), (2, 3), (0, 1)):
        calls = count()

        def phi_q(x: Any, calls: Iterator[int] = calls) -> Any:
            next(calls)
            return QUADRATIC.phi_q(x)

        newton(QUADRATIC.phi, phi_q, 5.0, jacobian_every=every, max_iterations=6, stop=_never)
        asked = next(calls)
        assert asked == slopes, f"every {every}: {asked} Jacobians, not {slopes}"


def test_damping_brings_far_starts_home():
    """From 3 to the root of arctan: full steps diverge, steps that are halved until the residual shrinks do not."""
    full, damped = (newton(np.arctan, lambda x: 1 / (1 + x * x), 3.0, damped=d) for d in (False, True))
    assert not full.converged, "full steps converge"
    assert damped.converged, f"damped: {damped.status} at {damped.q}"
    assert abs(damped.q[0]) < 1e-15, f"damped: {damped.status} at {damped.q}"
    sizes = np.abs(damped.residuals[:, 0])
    assert (np.diff(sizes) <= 0).all(), f"the residual grows: {sizes}"


def test_redundant_rows_change_nothing():
    """A consistent third equation for two unknowns leaves the root where it is."""

    def phi(v: Any) -> Any:
        return np.array([v[0] ** 2 + v[1] ** 2 - 2, v[0] - v[1], v[0] ** 2 + v[1] ** 2 - 2])

    def slope(v: Any) -> Any:
        return np.array([[2 * v[0], 2 * v[1]], [1, -1], [2 * v[0], 2 * v[1]]])

    result = newton(phi, slope, [2.0, 0.5])
    assert result.converged, f"status {result.status}"
    assert_near(result.q, [1.0, 1.0], 1e-15, "root")
    assert_near(solve_linear(np.diag([2.0, 4.0]), np.array([2.0, 2.0])), [1.0, 0.5], 0.0, "square system")


def test_complex_iterates_stay_complex():
    """From a complex estimate it finds a complex root: x^2 + 4 has 2i."""
    result = newton(lambda x: x * x + 4, lambda x: 2 * x, 1.0 + 1.0j)
    assert result.converged, f"status {result.status}"
    assert_near(result.q, [2j], 1e-15, "root")


def test_one_test_serves_many_runs():
    """A stopping test with a memory does not carry it from one run to the next."""
    stop = RoundOff()
    first, second = (newton(*QUADRATIC, 5.0, stop=stop).iterations for _ in range(2))
    assert first == second, f"{first} iterations, then {second}"


def test_a_stall_is_a_correction_that_is_not_nearly_halved():
    """Near a multiple root corrections halve, which goes on; one of more than 0.6 of the one before ends the run."""
    stop, at = RoundOff(), np.ones(1)
    sizes = (1e-7, 0.5e-7, 0.25e-7, 0.14e-7, 0.1e-7)
    assert [stop(np.zeros(1), np.array([size]), at) for size in sizes] == [False, False, False, False, True]


def test_a_correction_of_more_than_the_spacing_of_the_numbers_is_not_the_last():
    at = np.ones(1)

    assert [RoundOff()(at, np.array([part * EPS]), at) for part in (1.0, 1.25)] == [True, False]


def test_the_residual_is_that_of_the_worst_equation():
    """x = 1, 3 y = -6 from (1, 1) with a slope that is 2 for 3: y goes to -3.5."""
    slope = np.diag([1.0, 2.0])
    result = newton(lambda x: np.array([x[0] - 1, 3 * x[1] + 6]), lambda x: slope, [1.0, 1.0], max_iterations=1)
    assert result.residual == 4.5


def test_where_one_equation_has_no_value_nothing_is_solved():
    def phi(x):
        return np.array([x[0], x[1] if x[1] > 0.5 else np.nan])

    assert newton(phi, lambda x: np.eye(2), [1.0, 0.6], stop=CorrectionNorm(9.0)).status is NewtonStatus.NOT_FINITE


def test_real_estimates_stay_real():
    assert newton(*QUADRATIC, 5).q.dtype == float


@pytest.mark.parametrize(("size", "closes"), [(1.0, False), (1000.0, True)])
def test_a_residual_is_round_off_by_the_largest_coordinate(size, closes):
    assert is_round_off(np.array([0.0, 1e-13]), np.array([0.4, size])) == closes


def test_redundant_rows_of_a_batch_that_agree_are_left_with_round_off_whatever_their_condition():
    """By the pseudoinverse alone they were left with 1e6 times as much."""
    numbers = np.random.default_rng(1)
    (left, _), (right, _) = (np.linalg.qr(numbers.normal(size=(5, rows, 3))) for rows in (6, 3))
    matrix = np.moveaxis(left * [1.0, 1e-3, 1e-6] @ right, 0, -1)
    values = np.einsum("ijb,jb->ib", matrix, numbers.normal(size=(3, 5)))

    left_over = np.einsum("ijb,jb->ib", matrix, solve_linear(matrix, values)) - values
    assert np.max(np.abs(left_over)) < 16 * EPS
