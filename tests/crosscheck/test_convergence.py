"""Orders and rates as they are on paper: Newton, differences, toggles; inconclusive where too little is seen."""

from __future__ import annotations

from functools import partial
from typing import Any

import numpy as np

from crosscheck.documents.convergence import NOTHING, linear_rate, newton_order, slope
from refkin import Polynomial
from refkin.differences import EPS, Scheme, jacobian, step
from refkin.newton import newton
from tests.claims import assert_near, error_bound
from tests.linkages import ROCKER, system_of


def test_the_chord_method_converges_linearly():
    scene = ROCKER.scene(law=Polynomial(coefficients=(1.0,)), times=(0.0,))
    system, pose = system_of(scene), ROCKER.assemble(1.0)
    start = system.to_unit(np.concatenate([pose[b.name] for b in scene.mechanism.bodies]))
    start[[5, 8]] += (0.1, -0.1)
    phi, phi_q = (partial(f, t=0.0) for f in (system.phi, system.phi_q))
    result = newton(phi, phi_q, start, jacobian_every=0, max_iterations=100)
    errors = np.max(np.abs(result.iterates - result.q), axis=1)
    observed = linear_rate(errors)

    assert observed.points
    assert 0.0 < observed.value < 0.6


AT = np.array([0.2, -1.9])


def mixed(x: Any) -> Any:
    """Three functions of two variables, none of them separable."""
    return np.array([x[0] ** 2 * x[1], np.sin(x[0] * x[1]), np.exp(x[1]) + x[0] * x[1] ** 3])


def exact(x: Any) -> Any:
    """Return the Jacobian of `mixed`."""
    turning = np.cos(x[0] * x[1])
    return np.array(
        [
            [2 * x[0] * x[1], x[0] ** 2],
            [x[1] * turning, x[0] * turning],
            [x[1] ** 3, np.exp(x[1]) + 3 * x[0] * x[1] ** 2],
        ]
    )


def test_each_coordinate_is_reset():
    """What one column moved is not moved for the next: quotients of x y are exact, and x itself stays as it was."""
    at = np.array([2.0, 3.0])
    for scheme in (Scheme.FORWARD, Scheme.CENTRAL, Scheme.COMPLEX_STEP):
        result = jacobian(lambda q: np.array([q[0] * q[1]]), at, scheme, 0.5)
        assert_near(result, [[3.0, 2.0]], 0.0, f"{scheme}")
    assert_near(at, [2.0, 3.0], 0.0, "x was changed")


def test_quotients_are_those_of_their_scheme():
    """Of x^3 at 2 with step h the forward quotient is 12 + 6h + h^2, the central 12 + h^2, the complex 12 - h^2."""
    for scheme, expected in ((Scheme.FORWARD, 15.25), (Scheme.CENTRAL, 12.25), (Scheme.COMPLEX_STEP, 11.75)):
        result = jacobian(lambda x: x**3, np.array([2.0]), scheme, 0.5)
        assert_near(result, [[expected]], 0.0, f"{scheme}")


def test_errors_fall_with_the_order_of_the_scheme():
    """Forward quotients err by slope 1 in the step, central ones by 2, the complex step not at all."""
    h = 10.0 ** np.arange(-4.0, -1.0, 0.5)
    for scheme, order in ((Scheme.FORWARD, 1.0), (Scheme.CENTRAL, 2.0)):
        errors = [np.max(np.abs(jacobian(mixed, AT, scheme, k) - exact(AT))) for k in h]
        observed = slope(h, errors, floor=0.0)
        assert observed.is_near(order, 0.05), f"{scheme}: slope {observed.value:.3f}"
    for k in (1e-20, 1e-100, 1e-200):
        off = np.max(np.abs(jacobian(mixed, AT, Scheme.COMPLEX_STEP, k) - exact(AT)))
        assert off <= 16 * EPS, f"complex step {k}: off by {off}"


def test_step_rules_are_near_their_best():
    """No step does much better than the rule, errors stay within their own bound, and steps are exact differences."""
    for scheme in (Scheme.FORWARD, Scheme.CENTRAL):
        off = np.max(np.abs(jacobian(mixed, AT, scheme) - exact(AT)))
        best = min(np.max(np.abs(jacobian(mixed, AT, scheme, h) - exact(AT))) for h in 10.0 ** np.arange(-13, 0, 0.5))
        assert off <= 30 * best, f"{scheme}: off by {off:.3g}, the best step by {best:.3g}"
        h = step(scheme, AT)
        # f'', f''' of `mixed` near AT are below 12; an evaluation errs by a few units of its largest term, 7.
        bound = np.max(error_bound(scheme, h, 12.0, 12.0, 16 * EPS, 12.0))
        assert off <= bound, f"{scheme}: off by {off:.3g}, beyond its bound {bound:.3g}"
        assert bound <= 1e-6, f"{scheme}: its bound {bound:.3g} says nothing"
        assert ((AT + h) - AT == h).all(), f"{scheme}: a step that is no difference"
        large = step(scheme, np.array([1e6]))[0]
        assert 0.5e6 < large / step(scheme, np.array([1.0]))[0] < 2e6, f"{scheme}: a step that does not grow with x"


def test_bounds_are_those_of_the_table():
    """The error bounds are h f''/2 + 2 e/h, h^2 f'''/6 + e/h and 8 u f'."""
    given = (0.5, 3.0, 5.0, 0.25, 7.0)
    values = [error_bound(scheme, *given) for scheme in Scheme]
    assert_near(values, [0.75 + 1.0, 0.25 * 5 / 6 + 0.5, 56 * EPS], 1e-16, "bounds")


def test_orders_are_told_apart():
    """Quadratic, secant and cubic sequences show their own order, and no other."""
    for order in (1.618, 2.0, 3.0):
        errors = [0.3]
        while errors[-1] > 1e-14:
            errors.append(0.9 * errors[-1] ** order)
        observed = newton_order(errors, floor=1e-30, basin=0.5)
        assert observed.is_near(order, 0.1), f"{order}: {observed}"
        assert not observed.is_near(order + 0.5, 0.1), f"{order} is taken for {order + 0.5}"
    exact = newton_order([2.0 ** -(2**k) for k in range(2, 9)], floor=1e-99, basin=0.5)
    assert_near([exact.value, exact.spread, exact.points], [2.0, 0.0, 5], 1e-12, "of e, e^2, e^4, ...")
    bent = newton_order([1e-1, 1e-2, 1e-4, 1e-9], floor=1e-99, basin=0.5)
    assert_near([bent.value, bent.spread, bent.points], [2.5, 0.5, 2], 1e-12, "of 1e-1, 1e-2, 1e-4, 1e-9")


def test_rates_are_told_apart():
    """Sequences that shrink by a constant factor show it, whatever stands before the basin and below the floor."""
    for rate in (0.25, 0.5, 0.9):
        errors = [3.0, 0.4, *(0.09 * rate**k for k in range(60))]
        errors[-3:] = [0.05, 1e-17, 1e-17]
        observed = linear_rate(errors, floor=errors[40], basin=0.1)
        assert observed.points, f"{rate}: {observed}"
        assert observed.is_near(rate, 1e-12), f"{rate}: {observed}"
    bent = linear_rate([0.08, 0.04, 0.02, 0.01, 0.002], floor=1e-9)
    assert_near([bent.value, bent.spread, bent.points], [0.5, 0.3, 4], 1e-12, "of 0.08, 0.04, 0.02, 0.01, 0.002")
    assert linear_rate([0.5, 0.4], basin=0.1).points == 0, "a rate of nothing"


def test_too_little_is_inconclusive():
    """A history that is too short, or too few points, is no pass: it is near nothing."""
    few = (
        newton_order([1e-2, 1e-4, 1e-8]),
        linear_rate([0.05, 0.025, 0.0125]),
        slope([1, 2, 3], [1, 2, 3], 0.0),
        NOTHING,
    )
    for observed in few:
        assert observed.points == 0, f"{observed}"
        assert not observed.is_near(2.0, 1e9), f"{observed} is near 2"


def test_what_is_below_the_floor_does_not_count():
    """A slope is fitted to the errors above the floor alone, and its spread shows what does not fit."""
    h = 2.0 ** np.arange(6)
    kept = slope(h, [9e-9, 2.0, 8.0, 32.0, 128.0, 512.0], floor=0.5)
    assert kept.points == 5, f"{kept.points} points"
    assert_near([kept.value, kept.spread], [2.0, 0.0], 1e-12, "slope and spread")
    bent = slope(h, h ** np.array([2, 2, 2, 2, 2, 2.2]), floor=0.0)
    assert bent.spread > 0.3, f"a kink shows as a spread of {bent.spread}"
