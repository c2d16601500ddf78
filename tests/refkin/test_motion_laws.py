"""Laws: derivatives against complex steps, integrals against derivatives, splines against SciPy's contract."""

from __future__ import annotations

from itertools import pairwise

import numpy as np
import pytest

from refkin.motion_laws import Integral, Polynomial, Sinusoid, Table, zeros

SMOOTH = [
    Polynomial(coefficients=(0.3, -1.0, 0.5, 0.25)),
    Sinusoid(amplitude=0.7, angular_frequency=3.0, offset=0.2, phase=-0.4),
    Integral(rate=Sinusoid(amplitude=0.7, angular_frequency=3.0, offset=0.2, phase=-0.4), initial=1.5),
    Integral(rate=Sinusoid(amplitude=0.7, angular_frequency=1e-12, phase=0.3), initial=0.0),
    Integral(rate=Sinusoid(amplitude=0.7, angular_frequency=0.0, phase=0.3), initial=0.0),
    Integral(rate=Polynomial(coefficients=(0.3, -1.0, 0.5)), initial=-2.0),
]
TABLE = Table(argument=(0.0, 1.0, 2.5, 3.0, 4.5), value=(0.0, 0.4, 0.1, 1.0, 0.7))
AROUND = Table(argument=(0.0, 1.0, 2.0, 3.0), value=(0.5, 0.9, -0.2, 0.5), periodic=True)


@pytest.mark.parametrize("law", SMOOTH, ids=lambda law: type(law).__name__)
@pytest.mark.parametrize("order", [0, 1, 2])
def test_each_order_is_the_derivative_of_the_one_before(law, order):
    t = 0.83

    assert np.imag(law(t + 1e-100j, order)) / 1e-100 == pytest.approx(law(t, order + 1), rel=1e-14, abs=1e-14)


@pytest.mark.parametrize("rate", [*SMOOTH[:2], TABLE, AROUND], ids=lambda law: type(law).__name__)
def test_a_rate_is_integrated_exactly_from_its_initial_value(rate):
    law = Integral(rate=rate, initial=0.25)
    ends, weights = np.polynomial.legendre.leggauss(5)
    knots = np.unique(np.r_[np.linspace(0.0, 2.7, 28), [1.0, 2.5], [2.0]])
    pieces = pairwise(knots)
    total = sum((b - a) / 2 * np.dot(weights, rate((b - a) / 2 * ends + (a + b) / 2)) for a, b in pieces)

    assert law(0.0) == 0.25
    assert law(2.7) == pytest.approx(0.25 + total, rel=1e-13)
    assert law(2.7, 1) == rate(2.7)


def test_a_table_goes_through_its_values_and_bends_without_a_kink():
    t = np.array(TABLE.argument)
    eps = 1e-9

    assert TABLE(t) == pytest.approx(TABLE.value, abs=1e-15)
    assert TABLE(t[1:-1] - eps, 2) == pytest.approx(TABLE(t[1:-1] + eps, 2), abs=1e-6)


def test_a_periodic_table_goes_on_for_ever():
    assert AROUND(7.3, 1) == pytest.approx(AROUND(1.3, 1), rel=1e-12)
    assert Integral(rate=AROUND)(6.4) == pytest.approx(2 * Integral(rate=AROUND)(3.0) + Integral(rate=AROUND)(0.4))


@pytest.mark.parametrize(
    ("law", "key"),
    [
        (Polynomial(coefficients=()), "coefficients"),
        (Table(argument=(0.0,), value=(1.0,)), "argument"),
        (Table(argument=(0.0, 1.0), value=(1.0,)), "value"),
        (Table(argument=(0.0, 0.0), value=(1.0, 2.0)), "argument"),
        (Table(argument=(0.0, 1.0), value=(1.0, 2.0), periodic=True), "value"),
        (Integral(rate=Table(argument=(1.0, 2.0), value=(1.0, 2.0))), "argument"),
    ],
)
def test_numbers_that_make_no_law_are_named(law, key):
    assert [fault.path for fault in law.faults("law")] == [f"law.{key}"]


WAVES = [
    Polynomial(coefficients=(0.1, -0.7, 0.3, 0.9, -0.4)),
    Sinusoid(amplitude=0.7, angular_frequency=-30.0, offset=0.2, phase=-0.4),
    TABLE,
    AROUND,
    Integral(rate=Polynomial(coefficients=(0.3, -1.0, 0.5)), initial=-0.1),
    Integral(rate=Sinusoid(amplitude=0.7, angular_frequency=30.0, offset=0.2, phase=-0.4), initial=0.01),
    Integral(rate=TABLE, initial=0.0),
    Integral(rate=AROUND, initial=-0.3),
]


@pytest.mark.parametrize("law", WAVES, ids=lambda law: f"{type(law).__name__} {getattr(law, 'rate', '')!s:.10}")
@pytest.mark.parametrize("order", [0, 1])
def test_zeros_and_extrema_are_where_a_dense_sampling_sees_a_change_of_sign(law, order):
    times = np.linspace(0.01, 4.4, 200_001)
    values = law(times, order)
    seen = times[:-1][values[:-1] * values[1:] < 0.0]

    told = law.extrema(times[0], times[-1]) if order else zeros(law, times[0], times[-1])

    assert len(told) == len(seen)
    assert np.all(np.abs(np.array(told) - seen) < 2 * (times[1] - times[0]))
    at = np.array(told)
    assert np.all(np.abs(law(at, order)) <= 4 * np.spacing(at) * np.abs(law(at, order + 1)) + 1e-15)


def test_extrema_closer_than_any_sampling_are_all_there():
    fast = Integral(rate=Sinusoid(amplitude=1.0, angular_frequency=2 * np.pi * 64, phase=0.3), initial=0.0)
    narrow = Table(argument=(0.0, 0.4, 0.4001, 0.4002, 1.0), value=(0.0, 0.0, 1.0, 0.0, 0.0))
    close = Polynomial(coefficients=(0.0, 0.25 - 1e-18, -0.5, 1 / 3))

    assert len(fast.extrema(0.0, 1.0)) == 128
    assert any(abs(t - 0.4001) < 1e-5 for t in narrow.extrema(0.0, 1.0))
    assert len(close.extrema(0.0, 1.0)) == 1  # the coefficients rounded: a double zero of f'
    assert Polynomial(coefficients=(-0.25, 1.0, -1.0)).extrema(0.0, 1.0) == [0.5]


def test_the_sign_of_a_polynomial_is_exact_where_rounding_decides_on_its_value():
    cubed = Polynomial(coefficients=(-1.0, 3.0, -3.0, 1.0))  # (t - 1)^3

    assert [cubed.sign(1.0 + k * 2.0**-52) for k in (-2, -1, 0, 1, 2)] == [-1.0, -1.0, 0.0, 1.0, 1.0]
    assert cubed(1.0 + 2.0**-40) == 0.0
