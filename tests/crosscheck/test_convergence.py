"""Orders and rates as they are on paper: Newton, differences, toggles; and inconclusive where too little is seen."""

from __future__ import annotations

import numpy as np
import pytest

from crosscheck.documents.convergence import Kind, linear_rate, newton_order, slope
from refkin import FourBar, Polynomial, compile_system
from refkin.differences import EPS, Scheme, jacobian
from refkin.newton import newton

ROCKER = FourBar(ground=4.0, crank=1.0, coupler=3.5, rocker=3.0)


def system_at(linkage, angle, branch="open", shake=0.0):
    """The linkage's equations with the crank at an angle, its pose there, and a start that is off by `shake` rad."""
    scene = linkage.scene(law=Polynomial(coefficients=(angle,)), times=(0.0,), branch=branch)
    system = compile_system(scene.mechanism, unit=scene.mechanism.unit())
    pose = linkage.assemble(angle, branch)
    q = system.to_unit(np.concatenate([pose[b.name] for b in scene.mechanism.bodies]))
    start = q.copy()
    start[5] += shake
    start[8] -= shake
    return system, q, start


def solve(system, start, **options):
    return newton(lambda q: system.phi(q, 0.0), lambda q: system.phi_q(q, 0.0), start, **options)


@pytest.mark.parametrize("branch", ["open", "crossed"])
@pytest.mark.parametrize("angle", [0.4, 1.9, 4.0])
def test_newton_converges_with_order_two_at_a_regular_pose(angle, branch):
    system, _, start = system_at(ROCKER, angle, branch, shake=0.3)
    result = solve(system, start)
    errors = np.max(np.abs(result.iterates - result.q), axis=1)

    assert newton_order(errors, basin=0.5).is_near(2.0, 0.25)


def test_the_chord_method_converges_linearly():
    system, _, start = system_at(ROCKER, 1.0, shake=0.1)
    result = solve(system, start, jacobian_every=0, max_iterations=100)
    errors = np.max(np.abs(result.iterates - result.q), axis=1)
    observed = linear_rate(errors)

    assert observed.kind is Kind.RATE
    assert 0.0 < observed.value < 0.6


def fold():
    """The 1-2-2-3 linkage with its crank at pi: ground and crank in one line, as long as the other two together."""
    linkage = FourBar(ground=2.0, crank=1.0, coupler=1.25, rocker=1.75)
    return system_at(linkage, np.pi)


def test_newton_halves_the_error_and_quarters_the_residual_at_a_fold():
    system, q, _ = fold()
    start = q.copy()
    start[[5, 8]] += (0.05, 0.03)
    result = solve(system, start, max_iterations=40)
    errors = np.max(np.abs(result.iterates - q), axis=1)
    residuals = np.max(np.abs(result.residuals), axis=1)

    assert linear_rate(errors, floor=1e-6).is_near(0.5, 0.02)
    assert linear_rate(residuals, floor=1e-13).is_near(0.25, 0.02)


def test_at_a_fold_the_residual_is_at_round_off_while_the_pose_is_not():
    """The error stops at sqrt(eps): no residual test can see it."""
    system, q, _ = fold()
    start = q.copy()
    start[[5, 8]] += (0.05, 0.03)
    result = solve(system, start, max_iterations=60)

    assert result.residual < 1e-15
    assert 1e-10 < np.max(np.abs(result.q - q)) < 1e-6


@pytest.mark.parametrize(("scheme", "order"), [(Scheme.FORWARD, 1.0), (Scheme.CENTRAL, 2.0)])
def test_difference_jacobians_err_with_the_order_of_their_scheme(scheme, order):
    system, q, _ = system_at(ROCKER, 1.0)
    h = 10.0 ** np.arange(-6, 0.0, 0.5)
    exact = system.phi_q(q, 0.0)
    errors = [np.max(np.abs(jacobian(lambda x: system.phi(x, 0.0), q, scheme, k) - exact)) for k in h]
    # A difference quotient errs by EPS / h in round-off: below 1e-9 (h = 1e-6) that shows beside either order.
    observed = slope(h, errors, floor=1e-9 if order == 2.0 else 1e-7)

    assert observed.is_near(order, 0.05)


def test_the_complex_step_errs_with_no_order_at_all():
    system, q, _ = system_at(ROCKER, 1.0)
    exact = system.phi_q(q, 0.0)
    steps = [1e-10, 1e-50, 1e-100, 1e-200]
    errors = [np.max(np.abs(jacobian(lambda x: system.phi(x, 0.0), q, Scheme.COMPLEX_STEP, h) - exact)) for h in steps]

    assert max(errors) <= 2 * EPS


def test_sigma_min_goes_with_the_square_root_of_the_distance_to_a_toggle():
    linkage = FourBar(ground=90.0, crank=30.0, coupler=60.0, rocker=45.0)
    limit = linkage.input_range()[0][1]
    distance = 10.0 ** np.arange(-9, -2, 0.5)

    def sigma(d):
        system, q, _ = system_at(linkage, limit - d)
        return np.linalg.svd(system.phi_q(q, 0.0), compute_uv=False)[-1]

    assert slope(distance, [sigma(d) for d in distance], floor=0.0).is_near(0.5, 0.02)


def test_too_short_a_history_is_inconclusive_and_never_near_anything():
    observed = newton_order([1e-2, 1e-4, 1e-8])

    assert observed.kind is Kind.INCONCLUSIVE
    assert not observed.is_near(2.0, 100.0)


def test_a_wrong_order_is_told_from_the_right_one():
    """Order 1.6 (the secant method) is not 2, whatever the scatter."""
    errors = [0.1]
    while errors[-1] > 1e-14:
        errors.append(errors[-1] ** 1.618)

    assert not newton_order(errors, basin=0.5).is_near(2.0, 0.25)
    assert newton_order(errors, basin=0.5).is_near(1.618, 0.01)
