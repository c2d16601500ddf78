"""Symbols: expressions are kept once, folded without changing a value, and substituted without changing a meaning."""

from __future__ import annotations

import math
from fractions import Fraction
from types import SimpleNamespace

import mpmath
import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from refkin.fast.elimination.schedule import half_angled, stages_of
from refkin.proof.numbers.symbols import Graph, needed, substitute

PYTHON = {
    "add": lambda a, b: a + b,
    "sub": lambda a, b: a - b,
    "mul": lambda a, b: a * b,
    "div": lambda a, b: a / b,
    "neg": lambda a: -a,
    "abs": abs,
}


def value(symbol, numbers):
    """The value of an expression whose inputs q[k] are given."""
    fields = {}
    for node in needed((symbol,)):
        if node.op == "const":
            fields[node] = numbers[0] * 0 + Fraction(node.value) if isinstance(numbers[0], Fraction) else node.value
        elif node.op == "input":
            fields[node] = numbers[node.value.place[0]]
        else:
            fields[node] = PYTHON[node.op](*(fields[a] for a in node.args))
    return fields[symbol]


NUMBERS = st.sampled_from((0.0, 1.0, -1.0, 2.0, 0.5, -3.0))
LEAVES = st.integers(0, 2) | NUMBERS.map(lambda x: ("const", x))
TREES = st.recursive(
    LEAVES,
    lambda inner: st.tuples(st.sampled_from(("add", "sub", "mul")), inner, inner) | st.tuples(st.just("neg"), inner),
    max_leaves=12,
)


def built(tree, of_leaf, of_number):
    if isinstance(tree, int):
        return of_leaf(tree)
    if tree[0] == "const":
        return of_number(tree[1])
    return PYTHON[tree[0]](*(built(part, of_leaf, of_number) for part in tree[1:]))


@given(TREES, st.tuples(*[st.fractions(-3, 3, max_denominator=7)] * 3), st.tuples(*[st.floats(-3, 3)] * 3))
def test_folding_changes_no_value_and_no_bit(tree, fractions, floats):
    """In binary64, too: no rule reorders a sum or a product of three."""
    graph = Graph()
    symbol = built(tree, lambda k: graph.input("q", k), graph.constant)

    assert value(symbol, fractions) == built(tree, lambda k: fractions[k], Fraction)
    assert value(symbol, floats) == built(tree, lambda k: floats[k], float)


@given(TREES)
def test_equal_expressions_are_one_node(tree):
    graph = Graph()
    first, second = (built(tree, lambda k: graph.input("q", k), graph.constant) for _ in range(2))

    assert first is second


def test_a_product_with_zero_is_the_constant_zero():
    graph = Graph()
    x = graph.input("q", 0)

    assert (x * 0.0).zero
    assert (0 * x.cos()).zero
    assert (x - x).zero


def test_products_and_sums_do_not_depend_on_their_order():
    graph = Graph()
    a, b = graph.input("q", 0), graph.input("q", 1)

    assert a * b is b * a
    assert a + b is b + a


def test_an_array_leaves_the_operation_to_the_symbol():
    graph = Graph()
    x = graph.input("q", 0)

    assert np.float64(2.0) * x is x * 2.0


def test_what_is_no_number_is_refused():
    with pytest.raises(TypeError, match="'one'"):
        Graph().input("q", 0) + "one"


@given(TREES, st.tuples(*[st.fractions(-3, 3, max_denominator=7)] * 3))
def test_rewriting_puts_an_expression_for_an_input(tree, numbers):
    graph = Graph()
    q = [graph.input("q", k) for k in range(3)]
    symbol = built(tree, lambda k: q[k], graph.constant)
    moved = substitute(symbol, {q[0]: q[1] * q[2] - 1.0})

    assert value(moved, numbers) == value(symbol, (numbers[1] * numbers[2] - 1, *numbers[1:]))


def half_angle(name, x):
    """Sine or cosine of a float by the tangent of half the angle, as the program computes them."""
    graph = Graph()
    operations = {**PYTHON, "tan": math.tan}
    symbol = half_angled(SimpleNamespace(op=name, graph=graph), (graph.input("q", 0),))
    fields = {}
    for node in needed((symbol,)):
        known = {"const": node.value, "input": x}
        fields[node] = known.get(node.op) if node.op in known else operations[node.op](*(fields[a] for a in node.args))
    return fields[symbol]


@given(st.floats(-200.0, 200.0))
@pytest.mark.parametrize("name", ["cos", "sin"])
def test_sine_and_cosine_by_half_angles_err_by_a_few_round_offs(name, x):
    """1 + t^2 and the quotient r <= 2 are rounded once each, r - 1 or t r once more; the tangent is off by an ulp."""
    with mpmath.workdps(40):
        off = abs(float(getattr(mpmath, name)(mpmath.mpf(x)) - half_angle(name, x)))

    assert off <= 5 * 2.0**-53


def test_half_angles_survive_half_a_turn():
    """The tangent of a float near pi/2 is large, about 1.6e16, and never infinite."""
    for x in (math.pi, -math.pi, 3 * math.pi, math.nextafter(math.pi, 4.0)):
        assert abs(half_angle("cos", x) + 1.0) <= 2.0**-52
        assert abs(half_angle("sin", x) - math.sin(x)) <= 2.0**-52


def test_a_constant_zero_has_no_sign():
    """As an argument of atan2 it would be the other side of the cut."""
    assert math.copysign(1.0, Graph().constant(-0.0).value) == 1.0


def test_what_depends_on_geometry_alone_is_done_once_for_a_mechanism_but_for_what_is_no_plain_arithmetic():
    graph = Graph()
    g, f, q = graph.input("g", 0, 0), graph.input("f", 0, 0, 0), graph.input("q", 0)
    mask = graph.node("greater", g, g * g)
    solution = graph.node("apply", graph.node("inverse", g, value=1), g, value=1)
    chosen, entry = graph.node("select", mask, g, g * g), graph.node("entry", solution, value=0)
    stages = stages_of([chosen, entry, g * f, q * f, mask, g * g])

    assert {stages[some] for some in (g, g * g)} == {"mechanism"}
    assert {stages[some] for some in (f, g * f, mask, chosen, solution, entry)} == {"time"}
    assert {stages[some] for some in (q, q * f)} == {"core"}


def test_a_quotient_by_one_and_of_nothing_is_folded():
    graph = Graph()
    a, one, other, nothing = graph.input("q", 0), *(graph.constant(x) for x in (1.0, -1.0, 0.0))

    for x, divisor, expected in ((a, one, 5.0), (a, other, -5.0), (nothing, a, 0.0), (nothing, other, 0.0)):
        assert value(graph.div(x, divisor), (5.0,)) == expected
