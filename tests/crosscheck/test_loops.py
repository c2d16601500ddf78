"""Loop-closure equations: what is no root, and what makes no sense; the documents' numbers are in the ledger."""

from __future__ import annotations

import math

import pytest
from hypothesis import given
from hypothesis import strategies as st

from crosscheck.documents import loops
from crosscheck.engines import vector_loop
from crosscheck.engines.vector_loop.marching import MinimumStatus
from refkin.newton import NewtonStatus


def c4():
    """The four-bar of the ME581 notes."""
    return loops.four_bar(90.0, 30.0, 60.0, 45.0, math.radians(65.0))


# ---- what is no root, and new estimates


@given(angle=st.floats(math.radians(115.0), math.radians(245.0)), q0=st.tuples(*[st.floats(-0.6, 0.6)] * 2))
def test_a_stalled_minimum_is_no_root_and_tells_the_gap(angle, q0):
    """Beyond the limit of 112.02 deg coupler and rocker, in one line, miss each other by |d| - (r3 + r4)."""
    system = loops.four_bar(90.0, 30.0, 60.0, 45.0, angle)
    distance = 90.0 - 30.0 * complex(math.cos(angle), math.sin(angle))
    straight = math.atan2(distance.imag, distance.real)
    minimum = vector_loop.minimise(system, [straight + q0[0], straight + math.pi + q0[1]])

    assert minimum.status is MinimumStatus.STALLED
    assert minimum.gap == pytest.approx(abs(distance) - 105.0, abs=1e-9)


def test_an_evaluation_limit_is_not_called_a_minimum():
    assert vector_loop.minimise(c4(), [2.0, -1.0], max_evaluations=2).status is MinimumStatus.ITERATION_LIMIT


def test_all_estimates_may_be_used_up():
    tried = vector_loop.with_new_estimates(lambda x: x * x + 4, lambda x: 2 * x, [0.0, 0.0])

    assert [r.status for r in tried] == [NewtonStatus.SINGULAR] * 2


# ---- planted faults


@pytest.mark.parametrize(
    ("build", "words"),
    [
        (lambda: vector_loop.LoopSystem(("x",), [[vector_loop.LoopVector(1.0)]]), "expected 1 equations for"),
        (lambda: vector_loop.LoopSystem(("x", "y"), [[vector_loop.LoopVector(1.0)]]), "which the loops contain"),
        (lambda: vector_loop.with_new_estimates(math.cos, math.sin, []), "estimates: expected at least one"),
    ],
)
def test_a_request_without_sense_is_refused_in_words(build, words):
    with pytest.raises(ValueError, match=words):
        build()
