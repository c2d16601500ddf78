"""The numbers that proofs are made of: exact laws and geometry, and float64 numbers with bounds that hold."""

from __future__ import annotations

from dataclasses import replace
from typing import Any, cast

import numpy as np
import pytest
from flint import arb, ctx

from refkin.joints import AngleDriver, Revolute
from refkin.model import Body, Mechanism
from refkin.motion_laws import Integral, Law, Polynomial, Sinusoid, Table
from refkin.proof.numbers.bounded import Bounded, Bounds, Extended, InputError, Times, bounded_system, box, off_by, read
from refkin.proof.numbers.exact import exact, exact_system
from refkin.proof.pose.krawczyk import objects
from refkin.system import compile_system

from .assembled import FAMILIES
from .contact_cases import LOBES, scene

BITS = 200


def number(x: Any) -> Any:
    """Return a long double as an exact ball."""
    high = float(x)
    return arb(high) + float(x - np.longdouble(high))


def table(knots: int, periodic: bool) -> Table:
    rng = np.random.default_rng(knots)
    value = rng.uniform(-1, 1, knots)
    value[-1] = value[0] if periodic else value[-1]
    argument = np.cumsum(rng.uniform(0.5, 1.5, knots)) - 2.0
    return Table(argument=tuple(argument.tolist()), value=tuple(value.tolist()), periodic=periodic)


@pytest.mark.parametrize("periodic", [False, True])
@pytest.mark.parametrize("knots", [2, 3, 4, 5, 30])
def test_the_exact_spline_is_that_of_scipy_up_to_round_off(knots: int, periodic: bool) -> None:
    law, low = table(knots, periodic), table(knots, periodic).argument[0]
    times = np.linspace(low - 30.0, low + 30.0, 50) if periodic else np.linspace(0.0, law.argument[-1], 50)
    with ctx.workprec(BITS):
        spline = exact(law)
        for order in range(3):
            values = [float(spline(arb(t), order)) for t in times.tolist()]
            # Scale of the order-th derivative: the values are below 1, the knots half a unit apart at least.
            np.testing.assert_allclose(values, law(times, order), rtol=0, atol=1e-13 * 4.0**order)
        values = [float(spline.integral(arb(t))) for t in times.tolist()]
    np.testing.assert_allclose(values, law.integral(times), rtol=0, atol=1e-12)


def test_the_exact_spline_goes_through_its_table() -> None:
    law = table(30, periodic=False)
    with ctx.workprec(BITS):
        spline = exact(law)
        for t, value in zip(law.argument, law.value, strict=True):
            assert abs(spline(arb(t)) - value) < 1e-50


@pytest.mark.parametrize("order", range(4))
@pytest.mark.parametrize("periodic", [False, True])
def test_the_exact_spline_of_a_ball_encloses_its_values(periodic: bool, order: int) -> None:
    law = table(9, periodic)
    low, high = (law.argument[0] - 5, law.argument[-1] + 5) if periodic else (law.argument[0], law.argument[-1])
    with ctx.workprec(BITS):
        spline = exact(law)
        for middle in np.linspace(low + 0.8, high - 0.8, 20).tolist():
            over = spline(arb(middle, 0.7), order)
            assert all(over.contains(spline(arb(middle + by), order)) for by in np.linspace(-0.69, 0.69, 9).tolist())


def test_a_table_has_no_exact_value_outside_its_arguments() -> None:
    law = table(4, periodic=False)
    spline = exact(law)
    assert not spline(arb(law.argument[-1]) + 1e-9).is_finite()
    assert not spline(arb(law.argument[-1], 1e-9)).is_finite()


def test_over_more_than_a_period_a_table_has_no_exact_value() -> None:
    law = table(9, periodic=True)
    period = law.argument[-1] - law.argument[0]
    spline = exact(law)
    assert spline(arb(0.3, 0.49 * period)).is_finite()
    assert not spline(arb(0.3, 0.51 * period)).is_finite()


def test_an_extended_number_made_of_three_parts_is_as_far_off_as_the_third() -> None:
    assert Extended.near((1.0, 0.0, 1e-30)).rounding == 1e-30
    assert Extended.near((1.0, 1e-17, 1e-19)).rounding == 2 * Extended.unit + 1e-19


def test_over_a_knot_the_third_derivative_has_a_range_but_no_slope() -> None:
    over = arb(table(9, periodic=False).argument[3], 1e-3)
    spline = exact(table(9, periodic=False))
    assert (spline(over, 3).is_finite(), spline(over, 4).is_finite()) == (True, False)


@pytest.mark.parametrize("periodic", [False, True])
def test_a_time_between_two_floats_lies_on_its_own_side_of_a_knot(periodic: bool) -> None:
    """By 2^-80: the third derivative there is that of the piece that ends, and on the knot that of the next."""
    law = table(9, periodic)
    spline = exact(law)
    with ctx.workprec(BITS):
        for knot in law.argument[2:-2]:
            before, after = (spline(arb(knot) + side, 3) for side in (-0.01, 0.01))
            assert spline(arb(knot) - arb(2) ** -80, 3).overlaps(before)
            assert spline(arb(knot), 3).overlaps(after)
            assert not before.overlaps(after)


LAWS: tuple[Law, ...] = (
    Polynomial(coefficients=(0.1, 0.0, -0.3, 0.7)),
    Sinusoid(amplitude=0.4, angular_frequency=3.0, offset=0.2, phase=0.6),
    Integral(rate=Sinusoid(amplitude=0.4, angular_frequency=0.0, offset=0.2, phase=0.6), initial=0.3),
    Integral(rate=Sinusoid(amplitude=0.4, angular_frequency=3.0), initial=-0.1),
    Integral(rate=Polynomial(coefficients=(0.1, 0.3)), initial=0.3),
    Integral(rate=table(7, periodic=True)),
)


@pytest.mark.parametrize("law", LAWS)
@pytest.mark.parametrize("order", [0, 1, 2])
def test_an_exact_law_is_the_float_law_without_its_rounding(law: Law, order: int) -> None:
    for t in (-1.3, 0.0, 0.7, 2.9):
        with ctx.workprec(BITS):
            value = arb(exact(law)(arb(t), order))
            assert float(value.rad()) < 1e-50
            assert abs(value - float(law(t, order))) < 1e-14


def test_the_numbers_of_a_joint_are_exact() -> None:
    system, _ = FAMILIES[1](np.random.default_rng(0)).system()
    slider = next(p for p in exact_system(system, BITS).placed if p.constraint.type == "prismatic")
    normal = slider.g[4:6]
    with ctx.workprec(BITS):
        assert abs(normal[0] * normal[0] + normal[1] * normal[1] - 1) < 1e-55


@pytest.mark.parametrize("kind", [float, np.longdouble])
@pytest.mark.parametrize("largest", [1.0, 1e3, 1e6, 1e9])
def test_sine_and_cosine_are_within_two_ulp_as_is_assumed(kind: type, largest: float) -> None:
    x = np.random.default_rng(0).uniform(-largest, largest, 1000).astype(kind)
    with ctx.workprec(BITS):
        for argument, sine, cosine in zip(x, np.sin(x), np.cos(x), strict=True):
            for true, item in ((number(argument).sin(), sine), (number(argument).cos(), cosine)):
                assert abs(true - number(item)) < 2 * float(np.spacing(abs(item)))


@pytest.mark.parametrize("kind", [Bounded, Extended])
@pytest.mark.parametrize("operation", ["__add__", "__sub__", "__rsub__", "__mul__", "cos", "sin"])
def test_each_operation_bounds_its_own_rounding_and_that_of_a_sum_is_known(operation: str, kind: type[Bounded]) -> None:
    rng = np.random.default_rng(0)
    draws = [rng.uniform(-1, 1, 1000) * 2.0 ** rng.integers(-20, 3, 1000) for _ in range(2)]
    operands = [kind.exactly(x) for x in draws[operation in ("cos", "sin") :]]
    result = getattr(operands[0], operation)(*operands[1:])
    with ctx.workprec(BITS):
        for k, bound in enumerate(result.rounding):
            exact_operands = [number(x.mid[k]) for x in operands]
            off = abs(getattr(exact_operands[0], operation)(*exact_operands[1:]) - number(result.mid[k]))
            assert off <= bound
            assert off >= bound * (1 - 2.0**-50) or operation not in ("__add__", "__sub__", "__rsub__")


def evaluated(system: Any, q: Any, qd: Any, t: Any) -> Any:
    """Return phi, phi_q, nu and gamma, one after the other, in any arithmetic."""
    return np.concatenate(
        [x.ravel() for x in (system.phi(q, t), system.phi_q(q, t), system.nu(q, t), system.gamma(q, qd, t))]
    )


EVERY = [*range(len(FAMILIES)), "tip on lobes", "plate over lobes", "roller over lobes"]


def excess(family: int | str, kind: type[Bounded], radius: float, corner: bool) -> Any:
    """Return the true |value - mid| of all formulas at points of a box, over what `rounding` + `spread` allow."""
    rng = np.random.default_rng(EVERY.index(family))
    contact = isinstance(family, str) and compile_system(scene(family).mechanism)
    system, q = (contact, np.zeros(contact.n)) if contact else FAMILIES[family](rng).system()
    q, qd = q + rng.uniform(-1, 1, q.shape), rng.uniform(-1, 1, q.shape)
    numbers = bounded_system(system, kind), box(q[:, None], radius, kind), box(qd[:, None], radius, kind)
    bounds = read(evaluated(*numbers, Times([0.3], 2)), 1)
    ratios = []
    for _ in range(10):
        moves = rng.choice([-1.0, 1.0], (2, len(q))) if corner else rng.uniform(-1, 1, (2, len(q)))
        at, moving = q + moves[0] * radius * (1 - 1e-6), qd + moves[1] * radius * (1 - 1e-6)
        with ctx.workprec(BITS):
            balls = (objects([arb(x) for x in level.tolist()]) for level in (at, moving))
            true = evaluated(exact_system(system, BITS), *balls, arb(0.3))
            off = np.array([float(abs(x - m)) for x, m in zip(true, bounds.mid[:, 0].tolist(), strict=True)])
        allowed = bounds.rounding[:, 0] + bounds.spread[:, 0]
        assert not off[allowed == 0].any()
        ratios.append(off[allowed > 0] / allowed[allowed > 0])
    return np.array(ratios)


@pytest.mark.parametrize("kind", [Bounded, Extended])
@pytest.mark.parametrize("radius", [0.0, 1e-12, 1e-3, 1.0])
@pytest.mark.parametrize("family", EVERY)
def test_every_formula_stays_within_its_bounds_over_a_box(
    family: int | str, radius: float, kind: type[Bounded]
) -> None:
    assert np.max(excess(family, kind, radius, corner=False)) <= 1


@pytest.mark.parametrize("family", EVERY)
def test_the_bounds_over_a_box_are_reached_to_a_good_part(family: int | str) -> None:
    assert np.max(np.median(excess(family, Bounded, 1e-3, corner=True), axis=1)) > 0.1


@pytest.mark.parametrize("kind", [Bounded, Extended])
def test_a_profile_over_a_box_is_bounded_by_its_slope_there(kind: type[Bounded]) -> None:
    system = compile_system(scene("tip on lobes").mechanism)
    contact = next(p.constraint for p in bounded_system(system, kind).placed if p.constraint.name == "contact")
    s = np.linspace(-3.0, 3.0, 41)
    over = cast(Any, contact).profile_values(kind.exactly(s, np.full(41, 1e-3)), system.unit, 2)
    for order, values in enumerate(over):
        bounds = read(np.array([values]), 41)
        off = [np.abs(LOBES(s + way, order) - bounds.mid[0]) for way in (-1e-3, 1e-3)]

        assert (off <= bounds.rounding + bounds.spread + 1e-14).all()
        assert np.median(off / bounds.spread) > 0.99


def test_an_error_of_the_values_of_a_table_moves_the_derivatives_of_a_profile_by_what_its_spline_makes_of_it() -> None:
    knots, error, s = np.linspace(-3.0, 3.0, 241), 2.0**-40, np.array([0.01, 0.5])
    values, more = LOBES(knots, 0), error * (-1.0) ** np.arange(241)
    one, other = (Table(argument=tuple(knots.tolist()), value=tuple(y.tolist())) for y in (values, values * (1 + more)))
    m = scene("tip on lobes").mechanism
    joints = tuple(replace(j, profile=replace(j.profile, law=one)) if j.name == "contact" else j for j in m.joints)
    system = compile_system(replace(m, joints=joints))
    placed = bounded_system(system, error=InputError(error)).placed
    contact = next(p.constraint for p in placed if p.constraint.name == "contact")
    for order, value in enumerate(cast(Any, contact).profile_values(Bounded.exactly(s), system.unit, 2)):
        moved = np.abs(other(s, order) - one(s, order))

        assert (moved <= 1.01 * read(np.array([value]), 2).spread + 1e-15).all()


@pytest.mark.parametrize("least", [0.0, 1.0, 5.0])
def test_an_error_of_the_inputs_moves_each_derivative_of_a_law_by_what_it_adds_up_or_the_least(least: float) -> None:
    """Of gamma, f'' = -0.8 + 0.3 for the driver of an angle: that of these numbers, and that of the time by f'''."""
    law, t = Polynomial(coefficients=(2.0, -0.7, -0.4, 0.1)), np.array([0.5])
    pin = Revolute(name="pin", body_i="ground", point_i=(0.0, 0.0), body_j="b", point_j=(0.0, 0.0))
    mechanism = Mechanism((Body(name="b"),), (pin,), (AngleDriver(name="d", body="b", law=law),))
    rough = bounded_system(compile_system(mechanism), error=InputError(2.0**-40, least))
    gamma = read(rough.gamma(box(np.zeros((3, 1))), box(np.zeros((3, 1))), Times(t, 3)), 1)

    expected = 2.0**-40 * (max(0.8 + 0.3, least) + t * law(t, 3))
    assert gamma.mid[2] == law(t, 2)
    assert gamma.spread[2] == pytest.approx(expected, rel=2.0**-26, abs=0.0), "radii of balls have 30 bits"


@pytest.mark.parametrize("kind", [Bounded, Extended])
def test_the_bound_of_a_sine_or_a_cosine_is_no_less_than_nothing_at_zero_and_next_to_it(kind: type[Bounded]) -> None:
    numbers = kind.exactly(np.array([0.0, -0.0, 5e-324, -1e-310]))
    with ctx.workprec(BITS):
        for name in ("sin", "cos"):
            result = getattr(numbers, name)()
            for x, middle, bound in zip(numbers.mid, result.mid, result.rounding, strict=True):
                assert abs(getattr(number(x), name)() - number(middle)) <= bound


@pytest.mark.parametrize(("wide", "unit"), [(float, Bounded.unit), (np.longdouble, Extended.unit)])
def test_what_rates_miss_their_right_side_by_is_rounded_in_the_numbers_it_is_made_of(wide: Any, unit: float) -> None:
    """Products that cancel with their right side: what is left of them is the rounding itself."""
    rng = np.random.default_rng(5)
    slope, rates = rng.normal(size=(1, 5, 200)).astype(wide) / 3, rng.normal(size=(5, 200))
    right = np.sum(slope[0] * rates, axis=0)[None]
    left = off_by(Bounds(slope, 0.0 * slope, 0.0 * slope), rates, Bounds(right, 0.0 * right, 0.0 * right))
    with ctx.workprec(BITS):
        for k in range(200):
            exact_sum = sum((number(x) * number(y) for x, y in zip(slope[0, :, k], rates[:, k], strict=True)), arb(0))
            assert abs(exact_sum - number(right[0, k]) - number(left.mid[0, k])) <= left.rounding[0, k]
    size = np.sum(np.abs(slope[0] * rates), axis=0) + np.abs(right[0])
    assert (left.rounding[0] <= 8 * unit * size).all()
