"""Whole cycles of vector loops: rates of the rapier drive, assemblies that nearly meet."""

from __future__ import annotations

import math

import numpy as np
import pytest

from crosscheck.documents import loops
from crosscheck.engines import march, vector_loop
from crosscheck.engines.march import connected
from refkin.differences import EPS
from refkin.motion import Status
from refkin.motion_laws import Polynomial

from .loop_scenes import DRIVES

ANGLE = Polynomial(coefficients=(0.0, 1.0))
"""Time is the input itself."""
GUESS = np.array([*np.radians([200.0, 80.0, 180.0]), 400.0])
"""Of the rapier drive, as its source has it: theta13, theta14, theta15, s16."""


def test_rates_of_the_cycle_are_those_of_its_positions():
    """Periodic and smooth: Fourier differentiation of 512 positions is exact to round-off times the wave number."""
    times = np.linspace(0.0, math.tau, 513)[:-1]
    start = vector_loop.march(loops.rapier(DRIVES["R1"], ANGLE), [math.radians(60.0), math.tau], GUESS).q[:, -1]
    motion = vector_loop.march(loops.rapier(DRIVES["R1"], ANGLE), times, start)
    waves = 1j * np.fft.fftfreq(512, 1.0 / 512)
    first = np.fft.ifft(waves * np.fft.fft(motion.q)).real
    second = np.fft.ifft(waves**2 * np.fft.fft(motion.q)).real
    size = np.max(np.abs(motion.q), axis=1, keepdims=True)

    assert np.max(np.abs(first - motion.qd) / size) <= 256 * 64 * EPS
    assert np.max(np.abs(second - motion.qdd) / size) <= 256**2 * 64 * EPS


def signs_of_a_cycle_near_a_change_point(sign):
    """A crank-rocker with a slack of 1e-8: its assemblies pass each other at some 1e-4 rad."""
    system = loops.four_bar(4.0, 1.0, 2.5, 5.5 - 1e-8, ANGLE)
    motion = vector_loop.march(system, np.linspace(0.3, 0.3 + math.tau, 73), [sign * 1.0, sign * 1.5])

    assert set(motion.status) == {Status.OK}
    return set(np.sign(np.sin(motion.q[1] - motion.q[0])))


@pytest.mark.parametrize("sign", [1, -1])
def test_a_cycle_stays_in_its_assembly_where_another_is_near(sign):
    assert signs_of_a_cycle_near_a_change_point(sign) == {sign}


def test_contraction_alone_would_not_keep_it_there(monkeypatch):
    """Shows that the test before can fail."""
    monkeypatch.setattr(march, "connected", lambda inverse, other, off=0.0: np.ones(len(other), bool))
    kept = [signs_of_a_cycle_near_a_change_point(sign) == {sign} for sign in (1, -1)]

    assert not all(kept)


def test_jacobians_of_opposite_orientation_are_not_connected():
    others = [[[1.0, 5.0], [0.0, 2.0]], np.diag([1.0, -1.0]), np.full((2, 2), np.nan)]

    assert connected(np.repeat(np.eye(2)[None], 3, axis=0), np.array(others)).tolist() == [True, False, False]
