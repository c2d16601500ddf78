"""An engine's own rows, where two points nearly meet far from the origin: there each side rounds in its own place."""

from __future__ import annotations

import numpy as np
import pytest

from crosscheck.engines import Level, load
from crosscheck.levels import Configuration, compare_levels
from refkin import AngleDriver, Body, Mechanism, Polynomial, Revolute, Scene, compile_system

GROUND_POINT = (116.83380688588964, 245.63337161426253)
LEVER_POINT = (-7.402744570506538e-06, 3e-6)


def lever() -> Scene:
    pin = Revolute(name="B0", body_i="lever", point_i=LEVER_POINT, body_j="ground", point_j=GROUND_POINT)
    driver = AngleDriver(name="driver", body="lever", law=Polynomial(coefficients=(0.2, 1.0)))
    return Scene(
        name="lever",
        mechanism=Mechanism((Body(name="lever", estimate=(*GROUND_POINT, 0.2)),), (pin,), (driver,)),
        times=(0.0, 1.0),
    )


def residual_ratio(name: str, fault: float = 0.0) -> float:
    """Return the worst error / allowed of an engine's residual at poses that all but close the joint."""
    scene, engine = lever(), load(name)
    model = engine.constraints(scene)
    numbers = np.random.default_rng(1)
    system = compile_system(scene.mechanism)
    at = []
    for _ in range(50):
        off = numbers.uniform(-1e-3, 1e-3, 2)
        q = np.array([*(np.array(GROUND_POINT) + off), numbers.uniform(-3.0, 3.0)])
        at.append(Configuration(system, q, np.ones(3), 0.0, np.zeros(0)))
    exact, model.residual = model.residual, lambda q, t: exact(q + np.array([fault, 0.0, 0.0]), t)
    return compare_levels(engine, model, scene.mechanism, at, engine.terms(scene))[Level.RESIDUAL].ratio


@pytest.mark.parametrize("engine", ["exudyn", "pinocchio", "mujoco"])
def test_an_engine_may_round_the_places_of_points_before_it_subtracts_them(engine):
    assert residual_ratio(engine) < 0.5


@pytest.mark.parametrize("engine", ["exudyn", "pinocchio", "mujoco"])
def test_a_point_off_by_1e_11_is_found_all_the_same(engine):
    assert residual_ratio(engine, fault=1e-11) > 1.0
