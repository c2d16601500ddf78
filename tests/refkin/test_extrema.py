"""Extrema and zeros of motion laws: complete, against a dense sampling and in cases that no sampling sees."""

from __future__ import annotations

import numpy as np
import pytest

from refkin.motion_laws import Integral, Polynomial, Sinusoid, Table
from refkin.proof.numbers.extrema import _Spline, extrema, sign_of, zeros

TABLE = Table(argument=(0.0, 1.0, 2.5, 3.0, 4.5), value=(0.0, 0.4, 0.1, 1.0, 0.7))
TWICE_IN_ONE_PIECE = Table(argument=(0.0, 1.0, 2.0, 3.0, 4.0), value=(-0.9, 0.7, 0.1, 0.1, -0.8))
AROUND = Table(argument=(0.0, 1.0, 2.0, 3.0), value=(0.5, 0.9, -0.2, 0.5), periodic=True)
WAVES = [
    Polynomial(coefficients=(0.1, -0.7, 0.3, 0.9, -0.4)),
    Sinusoid(amplitude=0.7, angular_frequency=-30.0, offset=0.2, phase=-0.4),
    TABLE,
    TWICE_IN_ONE_PIECE,
    AROUND,
    Table(argument=(0.0, 0.25, 0.275, 0.3), value=(0.5, 0.9, -0.2, 0.5), periodic=True),
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

    value = extrema(law, times[0], times[-1]) if order else zeros(law, times[0], times[-1])

    assert len(value) == len(seen)
    assert np.all(np.abs(np.array(value) - seen) < 2 * (times[1] - times[0]))
    at = np.array(value)
    assert np.all(np.abs(law(at, order)) <= 4 * np.spacing(at) * np.abs(law(at, order + 1)) + 1e-15)


def test_extrema_closer_than_any_sampling_are_all_there():
    fast = Integral(rate=Sinusoid(amplitude=1.0, angular_frequency=2 * np.pi * 64, phase=0.3), initial=0.0)
    narrow = Table(argument=(0.0, 0.4, 0.4001, 0.4002, 1.0), value=(0.0, 0.0, 1.0, 0.0, 0.0))
    close = Polynomial(coefficients=(0.0, 0.25 - 1e-18, -0.5, 1 / 3))

    assert len(extrema(fast, 0.0, 1.0)) == 128
    assert any(abs(t - 0.4001) < 1e-5 for t in extrema(narrow, 0.0, 1.0))
    assert len(extrema(close, 0.0, 1.0)) == 1  # the coefficients rounded: a double zero of f'
    assert extrema(Polynomial(coefficients=(-0.25, 1.0, -1.0)), 0.0, 1.0) == [0.5]


@pytest.mark.parametrize("frequency", [1e19, 1e300, 1e308])
def test_a_sinusoid_of_more_waves_than_can_be_counted_has_extrema_without_an_exception(frequency):
    law = Sinusoid(amplitude=1.0, angular_frequency=frequency)

    assert all(1.0 < t < 2.0 for t in extrema(law, 1.0, 2.0))


def test_the_sign_of_a_polynomial_is_exact_where_rounding_decides_on_its_value():
    cubed = Polynomial(coefficients=(-1.0, 3.0, -3.0, 1.0))  # (t - 1)^3

    assert [sign_of(cubed, 1.0 + k * 2.0**-52) for k in (-2, -1, 0, 1, 2)] == [-1.0, -1.0, 0.0, 1.0, 1.0]
    assert cubed(1.0 + 2.0**-40) == 0.0


def test_pieces_of_a_periodic_table_repeat():
    spline, times = _Spline.of(AROUND), np.linspace(-7.3, 8.9, 100)

    assert [spline.value(t) for t in times] == pytest.approx(AROUND(times).tolist(), abs=1e-13)
    assert [spline.rate(t) for t in times] == pytest.approx(AROUND(times, 1).tolist(), abs=1e-12)


def test_a_polynomial_whose_rate_leaves_float64_has_its_extrema():
    """f' is 2 c t - 4 c t^3 + ..., whose second coefficient overflows: that ended in an OverflowError."""
    law = Polynomial(coefficients=(0.3, 0.0, 0.5e308, 0.0, -1e308))

    assert extrema(law, 0.1, 10.0) == [pytest.approx(0.5, rel=1e-15)]


def test_a_polynomial_of_any_number_of_coefficients_has_its_extrema():
    """Each derivative asked the next one, until Python had no more room for it."""
    law = Polynomial(coefficients=(0.0, -0.01, *[0.0] * 800, 1.0))  # t^802 - t/100

    assert extrema(law, 0.0, 1.0) == [pytest.approx((0.01 / 802.0) ** (1.0 / 801.0), rel=1e-14)]
    assert zeros(law, -1.0, 1.0) == [pytest.approx(0.0, abs=1e-300), pytest.approx(0.01 ** (1.0 / 801.0), rel=1e-14)]


WAVE = Sinusoid(amplitude=1.0, angular_frequency=6.0, offset=0.25, phase=0.3)


@pytest.mark.parametrize(
    ("listed", "law"),
    [(extrema, WAVE), (zeros, WAVE), (extrema, AROUND), (zeros, AROUND), (extrema, Integral(rate=AROUND, initial=0.0))],
)
def test_a_list_that_does_not_hold_all_times_is_longer_than_any_that_does(listed, law, monkeypatch):
    """One that was cut could be as short as a whole one: what a law did later was passed over."""
    some = listed(law, 0.1, 30.1)
    monkeypatch.setattr("refkin.proof.numbers.extrema.LISTED", 600)

    assert listed(law, 0.1, 30.1) == some
    for end in (1e3, 1e4, 1e5):
        assert 600 < len(listed(law, 0.1, end)) < 620


@pytest.mark.parametrize("law", [TABLE, AROUND, Integral(rate=AROUND, initial=0.0)])
def test_however_many_arguments_a_table_has_all_its_extrema_are_listed(law, monkeypatch):
    """Between the arguments up to the limit and the end a table was taken for monotone."""
    for end in np.linspace(0.5, 4.4, 9).tolist():
        whole = extrema(law, 0.1, end)
        for limit in range(12):
            monkeypatch.setattr("refkin.proof.numbers.extrema.LISTED", limit)
            assert extrema(law, 0.1, end) == whole or len(extrema(law, 0.1, end)) > limit
        monkeypatch.undo()
