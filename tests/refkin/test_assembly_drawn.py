"""No wrong claim: four-bars over six decades and mechanisms of every kind of group, drawn around a pose."""

from __future__ import annotations

import numpy as np
from hypothesis import assume, given, settings
from hypothesis import strategies as st

from refkin.newton import newton
from tests.drawn import Drawn

from .assembly_cases import ROUND_OFF, add_group, diagonal, distance, four_bar, missing, residual, solved

LENGTH = st.floats(-3.0, 3.0).map(lambda x: 10.0**x)
SHARE = st.floats(1e-6, 1 - 1e-6)
ANGLE = st.floats(-3.2, 3.2)


@settings(max_examples=300)
@given(LENGTH, LENGTH, LENGTH, ANGLE, SHARE)
def test_a_linkage_that_assembles_is_never_called_unassemblable(ground, crank, rocker, angle, share):
    """Lengths over six decades; the coupler is drawn between the limits of its reach, 1e-6 of the range inside them."""
    d = float(diagonal(ground, crank, angle))
    assume(d > 1e-6 * max(ground, crank))
    coupler = abs(d - rocker) + share * 2 * min(d, rocker)
    system, result = solved(four_bar(ground, crank, coupler, rocker, angle))

    assert missing(ground, crank, coupler, rocker, angle) < 0
    assert result.gap is None
    assert len(result.poses) == 2
    assert residual(system, result) < ROUND_OFF


@settings(max_examples=300)
@given(LENGTH, LENGTH, LENGTH, LENGTH, ANGLE)
def test_a_proof_and_the_formula_agree_on_every_four_bar(ground, crank, coupler, rocker, angle):
    truth = missing(ground, crank, coupler, rocker, angle)
    system, result = solved(four_bar(ground, crank, coupler, rocker, angle))

    assert (result.gap is not None) == (truth > 0)
    if truth > 0:
        assert 0 < result.gap * system.unit.size <= truth


@settings(max_examples=400)
@given(st.integers(0, 2**32 - 1), st.integers(1, 4))
def test_the_pose_a_mechanism_was_drawn_around_is_among_its_assemblies(seed, groups):
    """Every kind of group, one upon another. The drawn numbers are rounded: the pose moves by that over sigma_min."""
    drawn = Drawn(np.random.default_rng(seed), still=True)
    for _ in range(groups):
        add_group(drawn)
    mechanism = drawn.mechanism()
    system, result = solved(mechanism)
    q = drawn.q(system)
    sigma = float(np.linalg.svd(system.phi_q(q, 0.0), compute_uv=False)[system.n - 1])

    # At a fold a rounding u of the numbers opens a gap of that order: what is proved then is no more than that.
    assert result.gap is None or (result.gap < 1e-14 / sigma and sigma < 1e-6)
    if result.gap is None:
        assert result.complete
        assert len(result.branches) == len(set(result.branches))
        assert min(distance(x, q) for x in result.poses) < 1e-14 / sigma
        assert residual(system, result) < ROUND_OFF


@settings(max_examples=60)
@given(st.integers(0, 2**32 - 1), st.integers(1, 3))
def test_what_newton_finds_from_anywhere_is_among_the_assemblies(seed, groups):
    rng = np.random.default_rng(seed)
    drawn = Drawn(rng, still=True)
    for _ in range(groups):
        add_group(drawn)
    system, outcome = solved(drawn.mechanism())
    for _ in range(10):
        start = drawn.q(system) + rng.uniform(-1, 1, system.n)
        result = newton(lambda q: system.phi(q, 0.0), lambda q: system.phi_q(q, 0.0), start, damped=True)
        sigma = float(np.linalg.svd(system.phi_q(result.q, 0.0), compute_uv=False)[-1])
        closed = result.converged and result.residual < ROUND_OFF and np.abs(result.q).max() < 1e3

        assert not closed or sigma < 1e-4 or min(distance(x, result.q) for x in outcome.poses) < 1e-13 / sigma
