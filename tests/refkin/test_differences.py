"""Difference Jacobians: slopes 1 and 2 in the step, a flat complex step, step rules, and bounds that hold."""

from __future__ import annotations

import numpy as np
import pytest

from refkin.differences import EPS, Scheme, jacobian, step
from tests.claims import error_bound

Q = np.array([0.2, 1.9])


def loop(q):
    """The closure of the notes' four-bar (lengths in metres) in the coupler and rocker angles."""
    return np.array(
        [
            0.3 * np.cos(q[0]) - 0.45 * np.cos(q[1]) - 0.5,
            0.3 * np.sin(q[0]) - 0.45 * np.sin(q[1]) + 0.8,
        ]
    )


def exact(q):
    return np.array([[-0.3 * np.sin(q[0]), 0.45 * np.sin(q[1])], [0.3 * np.cos(q[0]), -0.45 * np.cos(q[1])]])


def error(scheme, h):
    return np.max(np.abs(jacobian(loop, Q, scheme, h) - exact(Q)))


@pytest.mark.parametrize(("scheme", "order"), [(Scheme.FORWARD, 1), (Scheme.CENTRAL, 2)])
def test_the_error_falls_with_the_order_of_the_scheme(scheme, order):
    h = np.array([1e-1, 1e-2, 1e-3])
    slope = np.polyfit(np.log(h), np.log([error(scheme, k) for k in h]), 1)[0]

    assert slope == pytest.approx(order, abs=0.05)


def test_the_complex_step_is_flat_and_exact():
    assert max(error(Scheme.COMPLEX_STEP, h) for h in (1e-8, 1e-30, 1e-100, 1e-200)) <= 2 * EPS


@pytest.mark.parametrize("scheme", list(Scheme))
def test_the_step_rule_stays_within_its_own_bound(scheme):
    """|f''|, |f'''|, |f'| are at most 0.45 here; one evaluation errs by at most two units of its largest term."""
    h = step(scheme, Q)
    bound = error_bound(scheme, h, 0.45, 0.45, 2 * EPS, 0.45)

    assert error(scheme, None) <= np.max(bound)


def test_the_step_rules_are_near_their_best():
    """No step does much better than the rule: within a factor 30 of the best of a scan."""
    for scheme in (Scheme.FORWARD, Scheme.CENTRAL):
        best = min(error(scheme, h) for h in 10.0 ** np.arange(-13, 0, 0.5))
        assert error(scheme, None) <= 30 * best


def test_a_coordinate_that_was_moved_is_put_back():
    """The notes' rule 'reset and use the original': the second column knows nothing of the first."""
    columns = jacobian(lambda q: np.array([q[0] * q[1]]), np.array([2.0, 3.0]), Scheme.FORWARD, 0.5)

    assert columns.tolist() == [[3.0, 2.0]]
