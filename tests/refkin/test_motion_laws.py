"""Laws: derivatives against complex steps, integrals against derivatives, splines against SciPy's contract."""

from __future__ import annotations

from itertools import pairwise

import numpy as np
import pytest

from refkin.motion_laws import Integral, Polynomial, Sinusoid, Table

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
