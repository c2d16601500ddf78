"""Checks of the vector loops: real and complex form, rates, the mechanisms as the documents write them; no roots."""

from __future__ import annotations

import math
from functools import partial
from typing import Any

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from crosscheck.documents import loops
from crosscheck.documents.systems import SquareSystem, me581, metu, shabana
from crosscheck.engines import vector_loop
from crosscheck.engines.march import connected
from crosscheck.engines.vector_loop.vectors import LoopVector, Variable
from refkin.differences import EPS, Scheme, jacobian
from refkin.motion_laws import Polynomial, Sinusoid
from refkin.newton import NewtonStatus, newton
from tests.claims import U, assert_near

from .loop_scenes import DRIVES

LAW = Polynomial(coefficients=(0.4, 1.3, -0.7))
SWING = Sinusoid(amplitude=0.4, angular_frequency=1.3, offset=0.9)
STEP = 1e-100
ROUNDING = 64 * U
AT = 0.6
GUESS = np.array([*np.radians([200.0, 80.0, 180.0]), 400.0])
"""Of the rapier drive, as its source has it: theta13, theta14, theta15, s16."""


def systems() -> list[tuple[str, vector_loop.LoopSystem, SquareSystem | None]]:
    """Return mechanisms as vectors, and the same equations at one time as the documents write them out, if they do."""
    given = float(LAW(AT))
    coupled = metu.Slotted(0.3, 0.25, 0.9, 0.6, -0.5, 0.4, given)
    bar = me581.FourBarLengths(4.0, 1.0, 3.5, 3.0)
    return [
        ("four-bar", loops.four_bar(4.0, 1.0, 3.5, 3.0, LAW), me581.four_bar(bar, given)),
        ("slider-crank", loops.slider_crank(0.2, 0.35, 0.1, LAW), shabana.CrankAndRod(0.2, 0.35).system(0.1, given)),
        ("geared", geared(), None),
        (
            "inverted",
            loops.inverted_slider_crank(0.5, 0.2, LAW),
            shabana.CoriolisExample(0.5, 0.2, given).system(),
        ),
        ("slotted", loops.slotted(coupled, LAW), metu.slotted(coupled)),
        ("rapier R1", loops.rapier(DRIVES["R1"], LAW), metu.rapier(DRIVES["R1"], given)),
        ("rapier R2", loops.rapier(DRIVES["R2"], LAW), metu.rapier(DRIVES["R2"], given)),
    ]


def geared() -> vector_loop.LoopSystem:
    """Return a five-bar whose first and last links are geared to each other, the last a slide that is driven."""
    first, second, third = (Variable(unknown=name) for name in ("a", "b", "c"))
    turned = Variable(0.3, laws=((1.0, LAW),))
    loop = (
        LoopVector(1.0, angle=turned),
        LoopVector(1.4, angle=first),
        LoopVector(-1.5, angle=second),
        LoopVector(-1.1, Variable(laws=((1.0, SWING),)), third),
        LoopVector(-2.0),
    )
    return vector_loop.LoopSystem(
        ("a", "b", "c"), [loop], [vector_loop.AngleRelation(((0.5, third), (0.8, turned)), 0.25)]
    )


def some(n: int, seed: int = 3) -> Any:
    """Return n numbers of order 1."""
    return np.random.default_rng(seed).normal(size=n)


def test_loops_are_the_equations_of_the_documents():
    """Residual and Jacobian of each mechanism are, up to the sign of an equation, those of its document."""
    for name, system, written in systems():
        if written is None:
            continue
        q = some(system.n)
        result, expected = system.residual(q, AT), written.phi(q)
        sign = np.where(np.abs(result - expected) < np.abs(result + expected), 1.0, -1.0)
        allowed = ROUNDING * system.scale * 8
        assert_near(result, sign * expected, allowed, name)
        assert_near(system.jacobian(q, AT), sign[:, None] * written.phi_q(q), allowed, f"{name}: Jacobian")


def test_jacobians_are_the_derivatives():
    """The real Jacobian is the complex-step derivative of the real residual."""
    for name, system, _ in systems():
        q = some(system.n)
        exact = jacobian(partial(system.residual, t=AT), q, Scheme.COMPLEX_STEP)
        assert_near(system.jacobian(q, AT), exact, ROUNDING * system.scale * 8, name)


def test_both_forms_are_one():
    """The complex form holds each loop and its conjugate; its Jacobian holds those of the real form."""
    for name, system, _ in systems():
        q, m = some(system.n), len(system.loops)
        real, pair = system.residual(q, AT), system.complex_residual(q, AT)
        slope, slopes = system.jacobian(q, AT), system.complex_jacobian(q, AT)
        allowed = ROUNDING * system.scale * 8
        for a, b, item in ((real, pair, "residual"), (slope, slopes, "Jacobian")):
            z = a[0 : 2 * m : 2] + 1j * a[1 : 2 * m : 2]
            assert_near(b[:m], z, allowed, f"{name}: {item}")
            assert_near(b[m : 2 * m], np.conj(z), allowed, f"{name}: conjugate {item}")
            assert_near(b[2 * m :], a[2 * m :], allowed, f"{name}: relations, {item}")


def test_rates_are_the_derivatives():
    """The right sides of velocity and acceleration are those of the equations, differentiated along a motion."""
    for name, system, _ in systems():
        q, qd, qdd = (some(system.n, seed) for seed in (3, 4, 5))
        e = STEP * 1j
        allowed = 8 * ROUNDING * system.scale * 8
        moved = system.residual(q.astype(complex), AT + e)
        assert_near(system.nu(q, AT), -np.imag(moved) / STEP, allowed, f"{name}: nu")
        # nu holds complex sums of its own, so that a complex step does not pass through it: a central difference does.
        h = 2.0**-18
        ends = [_rate(system, q + s * h * qd + h * h / 2 * qdd, qd + s * h * qdd, AT + s * h) for s in (1, -1)]
        left = system.jacobian(q, AT) @ qdd - system.gamma(q, qd, AT)
        assert_near(left, (ends[0] - ends[1]) / (2 * h), 1e-8 * system.scale, f"{name}: gamma")


def _rate(system: vector_loop.LoopSystem, q: Any, qd: Any, t: float) -> Any:
    return system.jacobian(q, t) @ qd - system.nu(q, t)


def test_relations_are_sums_of_their_terms():
    """A relation between unknowns and the input is the sum of its terms and its constant, with two derivatives."""
    q, qd = some(3), some(3, 4)
    system = geared()
    value = 0.5 * q[2] + 0.8 * (0.3 + LAW(AT)) + 0.25
    assert_near(system.residual(q, AT)[2], value, ROUNDING, "value")
    assert_near(system.nu(q, AT)[2], -0.8 * LAW(AT, 1), ROUNDING, "nu")
    assert_near(system.gamma(q, qd, AT)[2], -0.8 * LAW(AT, 2), ROUNDING, "gamma")
    assert_near(system.jacobian(q, AT)[2], [0.0, 0.0, 0.5], 0.0, "Jacobian")


def test_scales_and_rounding_are_of_the_right_size():
    """The scale is the power of two nearest the longest link, and what rounding may leave is small against it."""
    for name, scale in (("four-bar", 4.0), ("rapier R1", 1024.0), ("geared", 2.0)):
        system = next(s for n, s, _ in systems() if n == name)
        assert system.scale == scale, f"{name}: scale {system.scale}, not {scale}"
        allowed = system.rounding(some(system.n), AT)
        assert (allowed > 8 * U).all(), f"{name}: rounding {allowed}"
        assert (allowed < 1e-13 * scale).all(), f"{name}: rounding {allowed}"
    drive = next(s for n, s, _ in systems() if n == "rapier R1")
    assert_near(drive.weights, [1.0, 1.0, 1.0, 1 / 1024], 0.0, "weights")


def test_many_times_are_each_of_them():
    """A row of times gives column by column what one time gives."""
    for name, system, _ in systems():
        times = np.array([0.1, 0.6, 1.4])
        q, qd = (np.stack([some(system.n, k + seed) for k in range(3)], axis=1) for seed in (1, 7))
        for call in (system.residual, system.complex_residual, system.jacobian, system.nu):
            whole = call(q, times)
            for k in range(3):
                assert_near(whole[..., k], call(q[:, k], float(times[k])), ROUNDING * system.scale * 8, name)
        whole = system.gamma(q, qd, times)
        for k in range(3):
            one = system.gamma(q[:, k], qd[:, k], float(times[k]))
            assert_near(whole[:, k], one, 16 * ROUNDING * system.scale * 8, f"{name}: gamma")


def test_poses_close_in_either_form():
    """Newton in real and in complex form, and least squares, end at the same pose, which closes."""
    for reading in ("R1", "R2"):
        system = loops.rapier(DRIVES[reading], math.radians(60.0))
        real, pair = (vector_loop.close(system, GUESS, complex_form=form) for form in (False, True))
        least = vector_loop.minimise(system, GUESS)
        assert real.converged, f"{reading}: {real.status}, {pair.status}"
        assert pair.converged, f"{reading}: {real.status}, {pair.status}"
        assert least.status is vector_loop.MinimumStatus.ROOT, f"{reading}: {least.status}"
        assert_near(pair.q, real.q, 1e-10, f"{reading}: complex form")
        assert_near(least.q, real.q, 1e-10, f"{reading}: least squares")
    beyond = vector_loop.minimise(loops.rapier(DRIVES["R2"], math.radians(160.0)), GUESS)
    assert beyond.status is vector_loop.MinimumStatus.STALLED, f"beyond the limit: {beyond.status}"


def test_new_estimates_are_taken_where_the_slope_vanishes():
    """One estimate after the other is used while the derivative vanishes, and no longer."""
    system = me581.quadratic()
    runs = vector_loop.with_new_estimates(*system, [2.0, 5.0, 1.0])
    assert [r.converged for r in runs] == [False, True], f"{[r.status for r in runs]}"
    assert len(vector_loop.with_new_estimates(*system, [5.0, 2.0])) == 1, "an estimate was used after a root"
    used_up = vector_loop.with_new_estimates(lambda x: x * x + 4, lambda x: 2 * x, [0.0, 0.0])
    assert [r.status for r in used_up] == [NewtonStatus.SINGULAR] * 2


def test_branches_are_told_apart_by_their_jacobians():
    """Jacobians of one branch are connected by regular matrices; those of the two assemblies are not."""
    poses = [
        newton(*me581.four_bar(me581.FourBarLengths(4.0, 1.0, 3.5, 3.0), 0.7), q).q for q in ([0.6, 1.5], [-1.2, -2.2])
    ]
    slopes = [me581.four_bar(me581.FourBarLengths(4.0, 1.0, 3.5, 3.0), 0.7).phi_q(q) for q in poses]
    inverses = np.linalg.inv(slopes)
    assert connected(inverses, np.array(slopes)).all(), "a pose is not connected with itself"
    assert not connected(inverses, np.array(slopes[::-1])).any(), "the two assemblies are connected"
    others = [[[1.0, 5.0], [0.0, 2.0]], np.diag([1.0, -1.0]), np.full((2, 2), np.nan)]
    assert connected(np.repeat(np.eye(2)[None], 3, axis=0), np.array(others)).tolist() == [True, False, False]


def test_rates_of_the_cycle_are_those_of_its_positions():
    """Periodic and smooth: Fourier differentiation of 512 positions is exact to round-off times the wave number."""
    times, drive = np.linspace(0.0, math.tau, 513)[:-1], loops.rapier(DRIVES["R1"], Polynomial(coefficients=(0.0, 1.0)))
    start = vector_loop.march(drive, [math.radians(60.0), math.tau], GUESS).q[:, -1]
    motion = vector_loop.march(drive, times, start)
    waves = 1j * np.fft.fftfreq(512, 1.0 / 512)
    first = np.fft.ifft(waves * np.fft.fft(motion.q)).real
    second = np.fft.ifft(waves**2 * np.fft.fft(motion.q)).real
    size = np.max(np.abs(motion.q), axis=1, keepdims=True)

    assert np.max(np.abs(first - motion.qd) / size) <= 256 * 64 * EPS
    assert np.max(np.abs(second - motion.qdd) / size) <= 256**2 * 64 * EPS


@given(angle=st.floats(math.radians(115.0), math.radians(245.0)), q0=st.tuples(*[st.floats(-0.6, 0.6)] * 2))
def test_a_stalled_minimum_is_no_root_and_tells_the_gap(angle, q0):
    """Beyond the limit of 112.02 deg coupler and rocker, in one line, miss each other by |d| - (r3 + r4)."""
    system = loops.four_bar(90.0, 30.0, 60.0, 45.0, angle)
    distance = 90.0 - 30.0 * complex(math.cos(angle), math.sin(angle))
    straight = math.atan2(distance.imag, distance.real)
    minimum = vector_loop.minimise(system, [straight + q0[0], straight + math.pi + q0[1]])

    assert minimum.status is vector_loop.MinimumStatus.STALLED
    assert minimum.gap == pytest.approx(abs(distance) - 105.0, abs=1e-9)


def test_an_evaluation_limit_is_not_called_a_minimum():
    four_bar = loops.four_bar(90.0, 30.0, 60.0, 45.0, math.radians(65.0))

    assert (
        vector_loop.minimise(four_bar, [2.0, -1.0], max_evaluations=2).status
        is vector_loop.MinimumStatus.ITERATION_LIMIT
    )


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
