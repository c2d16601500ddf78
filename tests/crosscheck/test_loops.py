"""Loop-closure equations: their derivatives, the source documents' own numbers, and what is no root."""

from __future__ import annotations

import ast
import math
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

import crosscheck.engines.vector_loop
from crosscheck.documents import loops
from crosscheck.documents.convergence import BothLargest, ResidualOrCorrection, newton_order
from crosscheck.engines import vector_loop
from crosscheck.engines.vector_loop.solving import MinimumStatus
from refkin.differences import Scheme, jacobian
from refkin.motion_laws import Sinusoid
from refkin.newton import NewtonStatus, newton

LAW = Sinusoid(amplitude=0.7, angular_frequency=1.3, offset=0.4, phase=0.2)
GUESS = np.array([*np.radians([200.0, 80.0, 180.0]), 400.0])
"""Of the rapier drive, as its source has it: theta13, theta14, theta15, s16."""
SYSTEMS = {
    "four-bar": loops.four_bar(90.0, 30.0, 60.0, 45.0, LAW),
    "four-bar, coupler driven": loops.four_bar(90.0, 30.0, 60.0, 45.0, LAW, driven="theta3", ground_angle=0.3),
    "slider-crank": loops.slider_crank(0.2, 0.35, 0.05, LAW, guide_angle=-0.4),
    "slider-crank, slider driven": loops.slider_crank(0.2, 0.35, 0.05, LAW, driven="s"),
    "inverted slider-crank": loops.inverted_slider_crank(1.0, 0.4, 0.1, LAW),
    "slotted": loops.slotted(1.05, 0.25, 0.9, 0.6, -0.57, 0.48, LAW),
    "rapier R1": loops.rapier("R1", LAW),
    "rapier R2": loops.rapier("R2", LAW),
}


def test_loops_know_of_refkin_only_types_laws_and_newton():
    """No joint's formula and no pose of a linkage: what agrees with them is another formulation."""
    allowed = {"joints", "model", "motion", "motion_laws", "newton", "differences", "errors"}
    for path in Path(crosscheck.engines.vector_loop.__file__).parent.glob("*.py"):
        for node in ast.walk(ast.parse(path.read_text(encoding="utf-8"))):
            if isinstance(node, ast.ImportFrom) and node.module and node.module.startswith("refkin"):
                modules = node.module.split(".")[1:2] or [alias.name for alias in node.names]
                assert set(modules) <= allowed, (path.name, modules)


# ---- derivatives, at configurations that need not be assembled


def c4():
    return loops.four_bar(90.0, 30.0, 60.0, 45.0, math.radians(65.0))


def test_the_four_bar_of_the_notes_converges_as_recomputed_at_every_iterate():
    """ME581: iterates, residuals and corrections as recomputed with 30 digits, here to the digits they are given in."""
    r = newton(c4().residual, c4().jacobian, np.radians([0.0, 90.0]), stop=BothLargest(1e-12, 1e-12))
    q = np.degrees(r.iterates)

    assert q[1] == pytest.approx((17.0080290663, 112.054357847), abs=5e-10)
    assert q[2] == pytest.approx((13.2163961329, 114.647100651), abs=5e-10)
    assert q[3] == pytest.approx((13.1517247536, 114.827662726), abs=5e-10)
    assert r.residuals[0] == pytest.approx((-17.32145, -17.81077), abs=5e-6)
    assert r.residuals[1] == pytest.approx((-3.04875, 3.03231), abs=6e-6)
    assert r.corrections[3] == pytest.approx((-3.93409e-6, 1.88303e-6), abs=5e-12)
    assert np.degrees(r.q) == pytest.approx((13.1514993464592379702, 114.827770615851464450), abs=1e-13)


def test_the_determinant_is_that_of_the_transmission_angle():
    """-r3 r4 sin(theta4 - theta3) with the rocker as follower; r2 r3 sin(theta3 - theta2) with the rocker driving."""
    system, q = c4(), np.array([0.2, 1.9])
    driven = loops.four_bar(90.0, 30.0, 60.0, 45.0, 1.9, driven="theta4")

    assert np.linalg.det(system.jacobian(q)) == pytest.approx(-60.0 * 45.0 * math.sin(1.7), rel=1e-14, abs=0.0)
    assert np.linalg.det(driven.jacobian(np.array([0.7, 0.2]))) == pytest.approx(
        1800.0 * math.sin(-0.5), rel=1e-14, abs=0.0
    )


def test_the_other_estimate_leads_to_the_crossed_assembly():
    closure = vector_loop.close(c4(), np.radians([300.0, 200.0]))

    assert np.degrees(closure.q) == pytest.approx((308.10118075, 206.42490948), abs=1e-8)


@pytest.mark.parametrize(("h", "errors"), [(1e-3, (0.03, 0.0225)), (1e-2, (0.2999975, 0.22499813))])
def test_numerical_partials_err_as_the_notes_show(h, errors):
    """At (0, 90 deg) entry (0, 0) is off by -r3 h/2 and (1, 1) by r4 h/2."""
    system, q = c4(), np.array([0.0, math.pi / 2])
    off = jacobian(system.residual, q, Scheme.FORWARD, h=h) - system.jacobian(q)

    assert (-off[0, 0], off[1, 1]) == pytest.approx(errors, rel=1e-6, abs=0.0)


def slotted():
    """The geometry on which the slotted mechanism is tried out, and the pose it is consistent with."""
    a2, a4, a5, theta12, theta14, theta15, s4 = 0.25, 0.9, 0.6, *np.radians([50.0, 70.0, 20.0]), 0.5
    first = a2 * np.exp(1j * theta12) - a5 * np.exp(1j * theta15) - s4 * np.exp(1j * theta14)
    second = a5 * np.exp(1j * theta15) + a4 * np.exp(1j * theta14)
    system = loops.slotted(second.imag, a2, a4, a5, first.real, -first.imag, theta12)
    return system, np.array([theta14, theta15, s4, first.real + second.real])


@pytest.mark.parametrize("complex_form", [False, True], ids=["real", "complex"])
def test_the_slotted_mechanism_converges_as_recorded(complex_form):
    """From (0.05, -0.04, 0.03) off: 7.1e-3, 1.2e-4, 3.9e-8, 4.0e-15, the last at round-off."""
    system, root = slotted()
    closure = vector_loop.close(system, root + np.array([0.05, -0.04, 0.03, -0.02]), complex_form=complex_form)
    errors = np.max(np.abs(closure.iterates - root), axis=1)

    assert [float(f"{e:.1e}") for e in errors[1:4]] == [7.1e-3, 1.2e-4, 3.9e-8]
    assert errors[4] < 8e-15


RAPIER = {
    "R1": (188.572555996644, 67.3949336605564, 175.143712272957, 406.059657496346),
    "R2": (191.349010435964, 65.1746608282384, 180.211258797277, 275.864910951621),
}


@pytest.mark.parametrize("complex_form", [False, True], ids=["real", "complex"])
@pytest.mark.parametrize("reading", RAPIER)
def test_the_rapier_drive_at_sixty_degrees(reading, complex_form):
    closure = vector_loop.close(loops.rapier(reading, math.radians(60.0)), GUESS, complex_form=complex_form)

    assert closure.converged
    assert (*np.degrees(closure.q.real[:3]), closure.q.real[3]) == pytest.approx(RAPIER[reading], abs=2e-12, rel=1e-14)
    assert np.max(np.abs(closure.q.imag), initial=0.0) <= 1e-15


def test_newton_on_the_rapier_loops_has_order_two():
    closure = vector_loop.close(loops.rapier("R1", math.radians(60.0)), GUESS)
    errors = np.max(np.abs(closure.iterates - closure.q)[:, :3], axis=1)

    assert newton_order(errors, basin=0.15).is_near(2.0, 0.15)


# ---- what is no root, and new estimates


@given(angle=st.floats(math.radians(115.0), math.radians(245.0)), q0=st.tuples(*[st.floats(-0.6, 0.6)] * 2))
@settings(deadline=None)
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


def test_links_in_one_line_are_such_an_estimate():
    system = c4()
    tried = vector_loop.with_new_estimates(system.residual, system.jacobian, [[0.0, 0.0], np.radians([0.0, 90.0])])

    assert [r.status for r in tried] == [NewtonStatus.SINGULAR, NewtonStatus.CONVERGED]


def test_all_estimates_may_be_used_up():
    tried = vector_loop.with_new_estimates(lambda x: x * x + 4, lambda x: 2 * x, [0.0, 0.0])

    assert [r.status for r in tried] == [NewtonStatus.SINGULAR] * 2


@pytest.mark.parametrize(
    ("start", "status"),
    [(5.0, NewtonStatus.CONVERGED), (2.0, NewtonStatus.SINGULAR), (2.0 + 1e-12, NewtonStatus.ITERATION_LIMIT)],
)
def test_the_three_outcomes_of_the_document_are_statuses(start, status):
    outcome = newton(
        lambda x: x * x - 4 * x + 1,
        lambda x: 2 * x - 4,
        start,
        stop=ResidualOrCorrection(1e-9, 1e-9),
        max_iterations=10,
    )

    assert outcome.status is status


# ---- planted faults


@pytest.mark.parametrize(
    ("build", "words"),
    [
        (lambda: loops.four_bar(4.0, 1.0, 3.5, 3.0, 0.0, driven="theta1"), "driven: expected one of theta2"),
        (lambda: loops.rapier("R3", 0.0), "R3"),
        (lambda: vector_loop.LoopSystem(("x",), [[vector_loop.Vector(1.0)]]), "expected 1 equations for"),
        (lambda: vector_loop.LoopSystem(("x", "y"), [[vector_loop.Vector(1.0)]]), "which the loops contain"),
        (lambda: vector_loop.with_new_estimates(math.cos, math.sin, []), "estimates: expected at least one"),
    ],
)
def test_a_request_without_sense_is_refused_in_words(build, words):
    with pytest.raises(ValueError, match=words):
        build()
