"""Splines: that of every producer is SciPy's at 2, 3, 4, 5 knots, and a motion is proved to the ends of its table."""

from __future__ import annotations

from itertools import pairwise

import numpy as np
import pytest
from flint import arb, ctx
from scipy.interpolate import CubicSpline

import refkin
from crosscheck.engines.closed_form.laws import BallSpline as ClosedForm
from refkin import Status, Table
from refkin.motion_laws import Integral
from refkin.proof.numbers.exact import continued, exact
from tests.claims import U, assert_near
from tests.linkages import ROCKER

ARGUMENT = (-0.4, 0.3, 1.1, 1.6, 2.5)
VALUE = (0.9, 1.4, 1.1, 2.3, 2.0)


def table(count, periodic=False):
    value = (*VALUE[: count - 1], VALUE[0] if periodic else VALUE[count - 1])
    return Table(argument=ARGUMENT[:count], value=value, periodic=periodic)


def on_balls(law, t, order):
    with ctx.workprec(113):
        spline = exact(law)
        return float(spline(arb(t), order) if order >= 0 else spline.integral(arb(t)))


def in_closed_form(law, t, order):
    with ctx.workprec(113):
        spline = ClosedForm(law)
        return float(spline.derivative(t, order) if order >= 0 else spline.antiderivative(t) - spline.antiderivative(0))


def in_floats(law, t, order):
    return law(t, order) if order >= 0 else law.integral(t)


@pytest.mark.parametrize("producer", [on_balls, in_closed_form, in_floats], ids=lambda f: f.__name__)
@pytest.mark.parametrize("periodic", [False, True], ids=["ends", "periodic"])
@pytest.mark.parametrize("count", [2, 3, 4, 5])
def test_the_spline_of_every_producer_is_scipys(count, periodic, producer):
    """Values, three derivatives and the integral, between the knots and on them."""
    law = table(count, periodic)
    scipys = CubicSpline(law.argument, law.value, bc_type="periodic" if periodic else "not-a-knot")
    for a, b in pairwise(law.argument):
        for share in (0.0, 0.3, 0.8):
            t, orders = a + share * (b - a), range(4 if share else 3)  # the third derivative jumps at a knot
            expected = [scipys.integrate(0.0, t), *(scipys(t, order) for order in orders)]
            values = [producer(law, t, order) for order in (-1, *orders)]
            assert_near(values, expected, 2**12 * U * np.maximum(1.0, np.abs(expected)), f"{law} at {t}")


@pytest.mark.parametrize("rate", [False, True], ids=["law", "rate_law"])
@pytest.mark.parametrize("count", [2, 3, 4, 5])
def test_a_motion_is_proved_to_the_ends_of_its_table(count, rate):
    """As balls the steps reach a rounding beyond the ends: the first and the last piece go on for that long."""
    law = Table(argument=tuple(np.linspace(0.0, 2.0, count).tolist()), value=VALUE[:count])
    times = (0.0, 0.9, 1.0, 2.0)
    scene = ROCKER.scene(law=Integral(rate=law, initial=0.3) if rate else law, times=times)
    motion = refkin.solve(scene, certified=True)

    assert motion.status == (Status.OK,) * 4, motion.message


def test_a_table_has_no_value_beyond_its_ends_unless_it_goes_on():
    spline = exact(table(4))
    with ctx.workprec(113):
        assert spline(arb(-0.5)).is_nan()
        assert spline(arb(1.6, 0.1)).is_nan()
        for t, piece in ((-0.5, 0), (1.7, 2)):
            goes_on = spline.pieces[piece](arb(t) - arb(ARGUMENT[piece]))
            assert continued(spline)(arb(t)).overlaps(goes_on)
            assert continued(spline)(arb(t, 1e-3)).contains(goes_on)
