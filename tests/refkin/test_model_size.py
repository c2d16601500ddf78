"""The size of a mechanism with many points on one body is that of the pair furthest apart, and is found soon."""

from __future__ import annotations

import math

import numpy as np
import pytest

from refkin.joints import AngleDriver, Gear, Revolute
from refkin.model import Body, Mechanism, _diameter
from refkin.motion_laws import Polynomial

COUNT = 200
DRAW = np.random.default_rng(2)
CLOUDS = {
    "scattered": DRAW.normal(size=(COUNT, 2)),
    "on a line": np.stack([DRAW.uniform(size=COUNT), np.full(COUNT, 0.5)], axis=1),
    "upright": np.stack([np.full(COUNT, 0.5), DRAW.uniform(size=COUNT)], axis=1),
    "few places": DRAW.integers(0, 3, size=(COUNT, 2)).astype(float),
    "on a circle": np.stack([np.cos(np.arange(COUNT)), np.sin(np.arange(COUNT))], axis=1),
    "one place": np.ones((COUNT, 2)),
}


@pytest.mark.parametrize("cloud", CLOUDS)
def test_the_largest_distance_is_that_of_all_pairs(cloud):
    points = [tuple(p) for p in CLOUDS[cloud].tolist()]

    assert _diameter(points) == pytest.approx(max(math.dist(a, b) for a in points for b in points), rel=1e-15, abs=0.0)


@pytest.mark.parametrize(("first", "second"), [(-0.3, 7.9), (-7.9, 0.3)])
def test_a_gear_brings_the_larger_of_its_radii(first, second):
    wheels = Gear(name="teeth", body_i="a", radius_i=first, body_j="b", radius_j=second)
    axes = tuple(
        Revolute(name=f"axis {k}", body_i="ground", point_i=(0.0, 0.0), body_j=k, point_j=(0.0, 0.0)) for k in "ab"
    )
    motor = AngleDriver(name="motor", body="a", law=Polynomial(coefficients=(0.0, 1.0)))

    assert Mechanism((Body(name="a"), Body(name="b")), (*axes, wheels), (motor,)).size() == 8.0
