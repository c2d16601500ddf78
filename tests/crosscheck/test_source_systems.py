"""Newton, differences and observed orders on the square systems of the documents, which know nothing of mechanisms."""

from __future__ import annotations

import math

import numpy as np
import pytest
from flint import arb

from crosscheck.documents.convergence import newton_order, slope
from crosscheck.documents.systems import me451, me581, metu
from crosscheck.documents.systems.shabana import SLIDER_DRIVEN, CoriolisExample, CrankAndRod, LoopOfFourBars
from refkin.analysis import acceleration, position, velocity
from refkin.differences import Scheme, jacobian
from refkin.newton import newton
from refkin.system import compile_system
from tests.claims import U, assert_near

LINKS, CYLINDER = CrankAndRod(0.2, 0.35), me451.Problem356(0.6, 0.25)


def square_systems():
    """Return the systems of the documents, each with a place at which nothing vanishes."""
    bar = me581.FourBarLengths(90.0, 30.0, 60.0, 45.0)
    slotted = metu.Slotted(0.3, 0.25, 0.9, 0.6, -0.5, 0.4, 0.7)
    drive = metu.Rapier(-6.0, -3.0, -5.0, -2.5, -6.0, 2.5, 12.0, 3.5, 6.0, 11.0)
    coordinates = np.linspace(-0.7, 1.3, 12)
    return [
        ("A1", me451.root_minus_sine(), [0.7]),
        ("A2", me451.sine_and_exponential(), [0.8, 1.3]),
        ("A3", me451.square_and_sine(1.841471), [1.4]),
        ("A4", me451.exponential_and_logarithm(), [0.7, 0.3]),
        ("A6", CYLINDER.system(0.43), [0.3, 0.2, 0.9]),
        ("A8", CYLINDER.fold(), [0.3, 0.2, 0.9, 0.43, 0.6, -0.7, 1.1]),
        ("A9", me451.even_function(0.6), [0.7]),
        ("A10", me451.square(4.0), [1.3]),
        ("B2", metu.slotted(slotted), [1.2, 0.4, 0.5, 1.1]),
        ("B5", metu.rapier(drive, 0.7), [3.1, 1.2, 2.9, 4.0]),
        ("B5 fold", metu.rapier_fold(drive), [3.1, 1.2, 2.9, 4.0, 0.7, 0.3, -0.6, 0.8, 1.4]),
        ("C1", me581.quadratic(), [5.0]),
        ("C4", me581.four_bar(bar, 1.1), [0.2, 1.9]),
        ("C6", me581.four_bar_by_rocker(bar, 1.1), [0.2, 1.9]),
        ("D4", LINKS.system(0.1, 1.1), [-0.3, 0.4]),
        ("D7", CoriolisExample(0.5, 0.2, 1.1).system(), [2.7, 0.4]),
        ("D10", LoopOfFourBars(0.35, 0.2, 0.35, 0.25).system(1.1), [1.1, 0.2, 4.3]),
        ("D15", LINKS.twelve_coordinates(1.1), coordinates),
        ("D16", LINKS.twelve_coordinates(0.4, SLIDER_DRIVEN), coordinates),
    ]


NOTES = me581.FourBarLengths(90.0, 30.0, 60.0, 45.0)
SLOTTED, CLOSED = metu.slotted_that_closes(0.25, 0.9, 0.6, *(math.radians(a) for a in (50.0, 70.0, 20.0)), 0.5)
OFF = np.array([0.05, -0.05, 0.05, 0.05])
SYSTEMS = square_systems()

REGULAR = {
    "A3": (me451.square_and_sine(1.841471), [2.0]),
    "A4": (me451.exponential_and_logarithm(), [1.0, 0.0]),
    "A6": (CYLINDER.system(0.4), [0.2, 0.2, math.pi / 4]),
    "B2": (metu.slotted(SLOTTED), CLOSED + 2 * OFF),
    "C4": (me581.four_bar(NOTES, math.radians(65.0)), [0.0, math.pi / 2]),
    "D10": (LoopOfFourBars(0.35, 0.2, 0.35, 0.25).system(1.1), [1.1, 0.4, 4.0]),
}


def test_document_jacobians_are_the_derivatives():
    """phi_q of every system of the documents is the complex-step derivative of its phi."""
    for name, system, at in square_systems():  # built here: a mutant changes what builds them
        q = np.asarray(at, float)
        exact = jacobian(system.phi, q, Scheme.COMPLEX_STEP)
        assert_near(np.asarray(system.phi_q(q), float), exact, 256 * U * max(1.0, np.max(np.abs(exact))), name)


@pytest.mark.parametrize("name", REGULAR)
def test_newton_converges_with_order_two(name):
    system, start = REGULAR[name]
    result = newton(*system, start)
    errors = np.max(np.abs(result.iterates - result.q), axis=1)
    observed = newton_order(errors, basin=2.0, floor=1e-13)

    assert result.converged
    assert observed.is_near(2.0, 0.35)


@pytest.mark.parametrize(("name", "system", "at"), SYSTEMS, ids=[name for name, _, _ in SYSTEMS])
@pytest.mark.parametrize(("scheme", "order"), [(Scheme.FORWARD, 1.0), (Scheme.CENTRAL, 2.0)])
def test_difference_jacobians_err_with_the_order_of_their_scheme(name, system, at, scheme, order):
    """But for a quadratic, whose central quotient is exact but for round-off."""
    q = np.asarray(at, float)
    exact = np.asarray(system.phi_q(q), float)
    h = 10.0 ** np.arange(-4.0, -2.0, 0.25)
    errors = np.array([np.max(np.abs(jacobian(system.phi, q, scheme, k) - exact)) for k in h])
    size = np.max(np.abs(exact))
    if name in ("A10", "C1") and scheme is Scheme.CENTRAL:
        assert np.max(errors) < 1e-10 * size
        return
    # What a quotient loses in round-off is 1e-16 times the values over h: at h = 1e-4 that is 1e-12 of them.
    observed = slope(h, errors, floor=1e-10 * size if order == 2.0 else 1e-8 * size)

    assert observed.points
    assert observed.is_near(order, 0.1)


@pytest.mark.parametrize("name", REGULAR)
def test_newton_on_a_difference_jacobian_ends_at_the_same_root(name):
    system, start = REGULAR[name]
    exact = newton(*system, start)
    approximate = newton(system.phi, lambda q: jacobian(system.phi, q, Scheme.FORWARD), start)

    assert approximate.converged
    assert np.max(np.abs(approximate.q - exact.q)) < 1e-13 * max(1.0, np.max(np.abs(exact.q)))


@pytest.mark.parametrize("t", [0.0, 1.0, 2.0, 4.0])
def test_reduced_and_absolute_form_of_problem_356_agree(t):
    """Position, velocity and acceleration of (x2, y2, phi3)."""
    reach, rows = 0.4 + 0.1 * t, [3, 4, 8]
    reduced = CYLINDER.system(reach)
    start = np.array([0.2, 0.2, math.pi / 4])
    for part in np.linspace(0.0, t, 9):
        start = newton(*CYLINDER.system(0.4 + 0.1 * part), start).q
    qd = np.linalg.solve(reduced.phi_q(start), CYLINDER.nu(reach, 0.1))
    qdd = np.linalg.solve(reduced.phi_q(start), CYLINDER.gamma(start, qd, 0.1))

    x, y, angle = start
    along = math.atan2(y, x)
    system = compile_system(me451.problem_356_mechanism())
    q = position(system, np.array([0.0, 0.0, along, x, y, along, 0.6, 0.0, angle]) + 0.01, t).q
    rates = velocity(system, q, t)

    assert q[rows] == pytest.approx(start, abs=1e-14)
    assert rates[rows] == pytest.approx(qd, abs=1e-13)
    assert acceleration(system, q, rates, t)[rows] == pytest.approx(qdd, abs=1e-13)


def test_the_right_sides_of_problem_356_are_its_time_derivatives():
    """phi_q qdd - gamma is the second derivative of phi along a motion, nu minus the first by time alone."""
    q, qd, qdd, t, e = *np.random.default_rng(1).normal(size=(3, 3)), 0.7, 1e-100j
    reach = 0.4 + 0.1 * t

    def rate(step):
        at = CYLINDER.system(reach + 0.1 * step)
        moved = q + step * qd
        return at.phi_q(moved) @ (qd + step * qdd) - CYLINDER.nu(reach + 0.1 * step, 0.1)

    second = np.imag(rate(e)) / 1e-100
    gamma = CYLINDER.gamma(q, qd, 0.1)
    phi_t = np.imag(CYLINDER.system(reach + 0.1 * e).phi(q.astype(complex))) / 1e-100

    assert CYLINDER.system(reach).phi_q(q) @ qdd - gamma == pytest.approx(second, abs=1e-14)
    assert CYLINDER.nu(reach, 0.1) == pytest.approx(-phi_t, abs=1e-15)


@pytest.mark.parametrize("coordinate", [5, SLIDER_DRIVEN])
def test_twelve_coordinates_give_the_rates_of_the_closed_form(coordinate):
    theta2, theta3 = 1.0, math.asin(-LINKS.l2 / LINKS.l3 * math.sin(1.0))
    q = LINKS.pose(theta2, theta3).astype(float)
    slide_rate = LINKS.velocity(theta2, theta3, 150.0)[1]
    given = 150.0 if coordinate == 5 else slide_rate
    slope_ = LINKS.twelve_coordinates(float(q[coordinate]), coordinate).phi_q(q)
    qd = np.linalg.solve(slope_, np.r_[np.zeros(11), given])
    second = LINKS.acceleration(theta2, theta3, (150.0, qd[8]), 0.0)
    qdd = np.linalg.solve(slope_, LINKS.right_side(q, qd, 0.0 if coordinate == 5 else second[1]).astype(float))

    assert [qd[5], qd[8], qd[9]] == pytest.approx([150.0, -52.818431944720, -34.133165133143], rel=1e-12, abs=0.0)
    assert [qdd[8], qdd[9]] == pytest.approx([10809.0591207778, -1468.39606892724], rel=1e-12, abs=0.0)


def test_the_same_text_runs_on_floats_complex_numbers_and_balls():
    for name, system, at in SYSTEMS:
        q = np.asarray(at, float)
        balls = np.array([arb(x) for x in q], object)
        floats, numbers = np.asarray(system.phi(q), float), system.phi(q.astype(complex))
        enclosed = np.array([float(arb(x).mid()) for x in system.phi(balls)])

        assert np.array_equal(np.real(numbers), floats) or np.max(np.abs(np.real(numbers) - floats)) < 1e-13, name
        assert np.max(np.abs(enclosed - floats)) < 1e-13 * max(1.0, np.max(np.abs(floats))), name
