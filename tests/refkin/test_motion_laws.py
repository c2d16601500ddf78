"""The motion laws: values, derivatives of each order, integrals, and what makes none."""

from __future__ import annotations

import math
from collections.abc import Iterator
from typing import Any

import numpy as np
import pytest

from refkin.joints import AngleDriver
from refkin.motion_laws import Integral, Law, Polynomial, Sinusoid, Table
from tests.claims import U, assert_near

CUBIC = (0.3, -1.0, 0.5, 0.25)
KNOTS = (-1.0, 0.0, 0.7, 1.5, 3.0)
AROUND = Table(argument=(0.5, 1.5, 2.0, 3.5), value=(0.5, 0.9, -0.2, 0.5), periodic=True)
ROUNDING = 64 * U
"""What a dozen roundings of numbers of order 1 may leave, with a reserve of four."""
STEP = 1e-100


def cubic(t: float, order: int) -> float:
    """Return a derivative of the cubic, or its integral from 0 (order -1), written out."""
    a, b, c, d = CUBIC
    return (
        a * t + b * t**2 / 2 + c * t**3 / 3 + d * t**4 / 4,
        a + b * t + c * t**2 + d * t**3,
        b + 2 * c * t + 3 * d * t**2,
        2 * c + 6 * d * t,
        6 * d,
    )[order + 1]


def wave(t: float, order: int) -> float:
    """Return a derivative of 0.2 + 0.7 sin(3 t - 0.4), or its integral from 0 (order -1), written out."""
    s, c = math.sin(3 * t - 0.4), math.cos(3 * t - 0.4)
    lobe = 0.2 * t + 0.7 / 3 * (math.cos(0.4) - c)
    return (lobe, 0.2 + 0.7 * s, 2.1 * c, -6.3 * s, -18.9 * c)[order + 1]


def through(f: Any) -> Table:
    """Return the table of a function at the knots; of a cubic the spline is the cubic itself."""
    return Table(argument=KNOTS, value=tuple(f(k, 0) for k in KNOTS))


def laws() -> Iterator[tuple[Law, Any]]:
    """Yield laws, made anew: what a table remembers of itself is not what another test made it remember."""
    yield Polynomial(coefficients=CUBIC), cubic
    yield Sinusoid(amplitude=0.7, angular_frequency=3.0, offset=0.2, phase=-0.4), wave
    yield through(cubic), cubic


def test_values_and_derivatives_are_those_written_out():
    """Each law and its derivatives up to the third are those that calculus gives."""
    for law, f in laws():
        for t in (-0.9, 0.0, 0.83, 2.2):
            for order in range(4):
                assert_near(law(t, order), f(t, order), 256 * ROUNDING, f"{law} of order {order} at {t}")


def test_rates_are_integrated_from_the_initial_value():
    """A law given as a rate starts at its initial value, grows by the integral, and has the rate's derivatives."""
    for rate, f in laws():
        law = Integral(rate=rate, initial=0.6)
        assert law(0.0) == 0.6, f"{law} at 0 is {law(0.0)}"
        for t in (-0.9, 0.83, 2.2):
            assert_near(law(t), 0.6 + f(t, -1), 64 * ROUNDING, f"{law} at {t}")
            assert_near([law(t, k) for k in (1, 2, 3)], [rate(t, k) for k in (0, 1, 2)], 0.0, f"derivatives of {law}")


def test_a_driver_given_as_a_rate_starts_at_its_initial_value():
    """A driver takes `rate_law` as a rate and `initial` as the value at t = 0."""
    rate = Polynomial(coefficients=(2.0, 6.0))
    (law,) = AngleDriver(name="d", body="b", rate_law=rate, initial=0.5).laws
    assert_near([law(2.0, k) for k in range(3)], [16.5, 14.0, 6.0], 0.0, "law of the driver")
    (law,) = AngleDriver(name="d", body="b", law=rate).laws
    assert_near([law(2.0, k) for k in range(3)], [14.0, 6.0, 0.0], 0.0, "law of the driver")


def test_slow_waves_are_integrated_without_loss():
    """The integral of a sinusoid keeps its digits however small its frequency is, down to none."""
    for w in (1e-3, 1e-9, 1e-300, 0.0):
        rate = Sinusoid(amplitude=0.7, angular_frequency=w, phase=0.3)
        half = w * 2.0 / 2
        lobe = math.sin(half) / half if half else 1.0
        assert_near(rate.integral(2.0), 1.4 * math.sin(half + 0.3) * lobe, ROUNDING, f"frequency {w}")


def test_a_complex_argument_moves_a_table_along_its_slope():
    """A complex step through a table gives its derivative, of each order, and of its integral."""
    for law in (through(cubic), AROUND):
        for order in (0, 1):
            moved = law(0.83 + STEP * 1j, order)
            assert_near([moved.real, moved.imag / STEP], [law(0.83, order), law(0.83, order + 1)], ROUNDING, str(law))
        moved = law.integral(0.83 + STEP * 1j)
        assert_near([moved.real, moved.imag / STEP], [law.integral(0.83), law(0.83)], ROUNDING, f"integral of {law}")


def test_waves_of_many_scenes_lose_no_digit_where_one_is_at_rest():
    rows, still = (Sinusoid(amplitude=1.0, angular_frequency=w, phase=0.3) for w in (np.zeros(1), 0.0))
    t = np.linspace(0.1, 2.0, 200)

    assert rows.integral(t).tolist() == still.integral(t).tolist()


def test_a_table_that_is_zero_has_an_integral_there_all_the_same():
    assert Table(argument=(-1.0, 0.0, 1.0), value=(-1.0, 0.0, 1.0)).integral(0.0) == 0.0


def test_tables_pass_through_their_values():
    """A table has its values at its arguments, bends without a kink there, and has none beyond its ends."""
    law = Table(argument=KNOTS, value=(0.0, 0.4, 0.1, 1.0, 0.7))
    t = np.array(KNOTS)
    assert_near(law(t), law.value, 16 * U, "values")
    inner = t[1:-1]
    kinks = law(inner - 1e-9, 2) - law(inner + 1e-9, 2)
    assert_near(kinks, 0.0 * kinks, 1e-6, "kinks of f''")
    assert np.isnan(law(3.1)), "a value beyond the ends"
    assert np.isnan(law(-1.1)), "a value beyond the ends"
    assert law.domain() == (-1.0, 3.0), f"its domain is {law.domain()}"


def test_the_integral_of_a_periodic_table_grows_by_its_values_in_every_piece():
    for x in AROUND.argument[:-1]:
        grown = AROUND.integral(x + 1e-3) - AROUND.integral(x)
        assert_near(grown, 1e-3 * AROUND(x + 5e-4), 1e-8, f"behind {x}")


def test_periodic_tables_go_on():
    """A periodic table repeats itself, and its integral grows by one period's each time."""
    period = 3.0
    for order in range(3):
        assert_near(AROUND(1.3 + 2 * period, order), AROUND(1.3, order), 1e-12, f"order {order} two periods on")
    once, twice = (AROUND.integral(k * period) for k in (1, 2))
    assert_near(twice, 2 * once, 1e-13, "integral over two periods")
    assert AROUND.domain() == (-math.inf, math.inf), "its domain has ends"


def test_numbers_that_make_no_law_are_faults():
    """Empty polynomials, tables that are too short, not increasing, uneven or not closed are named as faults."""
    wrong: tuple[tuple[Law, str], ...] = (
        (Polynomial(coefficients=()), "coefficients"),
        (Table(argument=(0.0,), value=(1.0,)), "argument"),
        (Table(argument=(0.0, 1.0), value=(1.0,)), "value"),
        (Table(argument=(0.0, 0.0), value=(1.0, 2.0)), "argument"),
        (Table(argument=(0.0, 2.0, 1.0), value=(1.0, 2.0, 3.0)), "argument"),
        (Table(argument=(0.0, 5e-324), value=(1.0, 2.0)), "argument"),
        (Table(argument=(0.0, 1.0), value=(1.0, 2.0), periodic=True), "value"),
        (Table(argument=(0.0, 1.0, 2.0), value=(1.0, 2.0, 2.0), periodic=True), "value"),
        (Table(argument=(0.0, 1.0, 2.0), value=(2.0, 2.0, 1.0), periodic=True), "value"),
        (Integral(rate=Table(argument=(1.0, 2.0), value=(1.0, 2.0))), "argument"),
    )
    for law, key in wrong:
        assert [fault.path for fault in law.faults("law")] == [f"law.{key}"], f"{law} has other faults"
    large = Table(argument=(0, 1, 2), value=(0, 10**25, 1))  # a number that NumPy has no integer for
    for law in (*(law for law, _ in laws()), AROUND, large):
        assert not list(law.faults("law")), f"{law} has faults"
    with pytest.raises(NotImplementedError):
        Integral(rate=Polynomial(coefficients=CUBIC)).integral(1.0)


def test_a_sinusoid_has_the_fourth_derivative_that_the_proof_of_a_roller_asks_for():
    wave = Sinusoid(amplitude=2.0, angular_frequency=3.0, phase=0.1)

    assert wave(0.5, 4) == pytest.approx(3.0**4 * wave(0.5), rel=1e-15)
