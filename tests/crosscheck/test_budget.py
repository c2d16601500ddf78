"""The budgets are sharp: what they allow is a small multiple of what the rounding of a scene's numbers makes of it."""

from __future__ import annotations

from dataclasses import replace
from functools import cache

import numpy as np
import pytest

from crosscheck.engines import Term
from crosscheck.judge import budget as budgets
from crosscheck.judge.comparison import QUANTITIES, compare, reference
from crosscheck.judge.samples import _corrections, input_sensitivity, sharpness
from crosscheck.scenes.drawing import draw
from refkin import AngleDriver, Body, FourBar, Mechanism, Revolute, Scene
from refkin.motion_laws import Polynomial, Sinusoid, Table

NIGHT, SCENES, SAMPLES = 11, 100, 3
MEDIAN, LARGEST, LARGEST_OF_TREES = 50.0, 500.0, 1000.0
"""Errors add up over the loops of a branching tree of thirteen bodies, where their directions do not; and over the
products of three terms, and seven coordinates a body, of space: 546 for a double Hooke joint."""
PLANTED = 10.0
"""Times the sensitivity to the input."""


@cache
def references():
    values = [reference(draw(NIGHT, number, SAMPLES).scene) for number in range(SCENES)]
    return [ref for ref in values if ref.budget().compared.any()]


def samples(ref):
    return [k for k in range(SAMPLES) if ref.budget().compared[k]]


@cache
def sharp():
    values = [sharpness(ref, range(SAMPLES)) for ref in references()]
    return {q: np.concatenate([b[q][0] for b in values]) for q in QUANTITIES}


def seen(ref, quantity: str, sensitivities: float) -> bool:
    """Whether an answer that is right but for one quantity, off by so many times the sensitivity, is found out."""
    samples = np.flatnonzero(ref.budget().compared)
    order = QUANTITIES.index(quantity)
    off = np.zeros_like(ref.levels[order])
    off[:, samples] = sensitivities * input_sensitivity(ref, samples)[order]
    off = ref.system.to_physical(off, 1)[: ref.system.of_bodies]  # as a rate: a difference has no origin
    key = ("q", "qd", "qdd")[order]
    return not compare(ref, replace(ref.motion, **{key: getattr(ref.motion, key) + off})).agrees


@pytest.mark.parametrize("quantity", QUANTITIES)
def test_a_budget_allows_a_small_multiple_of_the_sensitivity(quantity):
    assert np.median(sharp()[quantity]) < MEDIAN
    large = [len(m.bodies) > 7 or m.kind.name == "spatial" for m in (ref.scene.mechanism for ref in references())]
    trees = np.array([one for one, ref in zip(large, references(), strict=True) for _ in samples(ref)])
    assert np.max(sharp()[quantity][~trees]) < LARGEST
    assert np.max(sharp()[quantity][trees]) < LARGEST_OF_TREES


@pytest.mark.parametrize("quantity", QUANTITIES)
def test_no_budget_is_below_the_sensitivity(quantity):
    assert np.min(sharp()[quantity]) > 1.0


@pytest.mark.parametrize("quantity", ["velocity", "acceleration"])
def test_an_error_of_ten_times_the_sensitivity_is_seen(quantity):
    caught = sum(seen(ref, quantity, PLANTED) for ref in references())

    assert caught >= SCENES / 20
    assert sum(seen(ref, quantity, 1.0) for ref in references()) == 0


def test_the_sensitivity_is_what_the_solution_moves_by():
    """One number moves by 1e-9 of itself: the solutions before and after differ by what the correction says."""
    linkage = {"ground": 4.0, "crank": 1.0, "coupler": 3.5, "rocker": 3.0}
    law = Polynomial(coefficients=(0.3, 1.0, 0.25))
    near, far = (
        reference(FourBar(**{**linkage, "coupler": coupler}).scene(law=law, times=(0.5, 1.0)))
        for coupler in (3.5, 3.5 * (1.0 + 1e-9))
    )
    moved = _corrections(far.system, near.levels, near.motion.t.tolist())

    for level, (a, b) in enumerate(zip(near.levels, far.levels, strict=True)):
        assert moved[level] == pytest.approx(b - a, rel=1e-6, abs=1e-14)


def test_the_rounding_of_a_law_counts_beside_a_table_too():
    """It counted for nothing there, which nobody saw as long as answers were held against one that rounds alike."""
    wave, table = Sinusoid(amplitude=2.0, angular_frequency=8.3), Table(argument=(0.0, 0.4, 1.0), value=(0.0, 1.0, 0.5))
    pins = [
        Revolute(name=f"pin {b}", body_i="ground", point_i=(0.0, 0.0), body_j=b, point_j=(1.0, 0.0)) for b in ("a", "b")
    ]

    def left(law):
        drivers = tuple(AngleDriver(name=b, body=b, law=x) for b, x in (("a", law), ("b", wave)))
        cranks = Mechanism((Body(name="a"), Body(name="b")), tuple(pins), drivers)
        return reference(Scene(mechanism=cranks, times=(0.0, 0.3, 0.9))).propagation.e[1][-1]

    assert left(table).tolist() == left(Polynomial(coefficients=(0.0, 1.0))).tolist()
    assert (left(table) > 0.0).all()


def test_beyond_first_order_one_direction_at_a_time_says_what_all_at_once_say(monkeypatch):
    """Of a mechanism of which one has more entries than are computed at once there was an error."""
    for ref in references()[:10]:
        seen = []
        for at_once in (1, 1_000_000_000):
            monkeypatch.setattr(budgets, "AT_ONCE", at_once)
            term = Term(name="rule", level="position", reason="", absolute=1e-3)
            seen.append(ref.propagation.second_order(ref.budget(), (term,), ref.budget().compared).levels)
        assert np.array_equal(*seen, equal_nan=True)
