"""What of exudyn's rows is no other engine's: its errors, what it frees, and faults that must not hide."""

from __future__ import annotations

import gc
import weakref
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

import refkin
from crosscheck.engines import EngineError, EngineRefusal
from crosscheck.engines.exudyn import model as exudyn_model
from crosscheck.engines.exudyn.engine import Exudyn
from crosscheck.engines.poses import Tabulated
from refkin.joints import Distance
from refkin.motion_laws import Polynomial, Sinusoid

from .loose_rows import KINDS, loose_scene


@pytest.mark.parametrize("kind", KINDS["exudyn"])
def test_drift_is_the_derivative_of_exudyns_own_velocity_rows(kind: str) -> None:
    """gamma = -d/de (phi_q qd + phi_t)(q + e qd, qd, t + e): ties the point accelerations to the joint itself.

    The central difference over +-h ... +-4h errs by h^8/630 of the ninth derivative, below 1e-14 for h = 0.01 and
    rates of order 1 (distances stay above 0.5), and by rounding of u/h of the rows, about 1e-13.
    """
    scene = loose_scene(kind)
    model = Exudyn().constraints(scene)
    q, qd, t = np.array([1.4, 0.9, 0.3, -1.1, 0.2, -0.4]), np.array([0.3, -0.8, 0.9, 0.5, 0.7, -0.6]), 0.4
    h = 0.01
    weights = {1: 4 / 5, 2: -1 / 5, 3: 4 / 105, 4: -1 / 280}
    slope = sum(
        sign * w * model.constraint_velocity(q + sign * k * h * qd, qd, t + sign * k * h) / h
        for k, w in weights.items()
        for sign in (1, -1)
    )

    assert np.max(np.abs(model.drift(q, qd, t) + slope)) < 1e-12


def test_two_coinciding_points_of_a_distance_joint_are_an_engine_error() -> None:
    scene = loose_scene("distance")
    rod = next(c for c in scene.mechanism.joints if isinstance(c, Distance) and c.body_i == "ground")
    (xi, yi), (xj, yj) = rod.point_i, rod.point_j
    model = Exudyn().constraints(scene)
    q = np.array([xi - xj, yi - yj, 0.0, 0.0, 0.0, 0.0])

    for ask in (model.residual, model.jacobian):
        with pytest.raises(EngineError, match="distance of the markers is zero"):
            ask(q, 0.0)


def test_a_driven_distance_of_zero_is_a_refusal_that_names_driver_and_time() -> None:
    model = Exudyn().constraints(loose_scene("cylinder"))
    model.clock.laws[0] = Tabulated(Sinusoid(amplitude=0.0, angular_frequency=1.0))

    with pytest.raises(EngineRefusal, match=r"driver 'cylinder 0' at t = 0\.5: .*must be positive"):
        model.residual(np.zeros(6), 0.5)


def test_a_closed_model_is_freed() -> None:
    """User functions that reached back to the system would keep it for ever: the system owns them."""
    model = Exudyn().constraints(loose_scene("angle"))
    model.residual(np.zeros(6), 0.0)
    clock, whole = weakref.ref(model.clock), weakref.ref(model)
    model.close()
    del model
    gc.collect()

    assert whole() is None
    assert clock() is None


def test_bodies_in_another_order_than_the_columns_are_an_engine_error(monkeypatch: pytest.MonkeyPatch) -> None:
    build = exudyn_model.Builder
    monkeypatch.setattr(exudyn_model, "Builder", lambda mbs, bodies, *rest: build(mbs, bodies[::-1], *rest))

    with pytest.raises(EngineError, match="keeps the coordinates of body 'a' in columns"):
        Exudyn().constraints(loose_scene("revolute"))


@pytest.mark.parametrize("name", ["distance-driver", "spatial-distance-driver"])
def test_a_length_that_exudyn_does_not_take_leaves_no_other_at_its_time(name: str) -> None:
    scene = refkin.load(Path(__file__).parents[2] / "docs" / "scenes" / f"{name}.toml")
    (driver,) = scene.mechanism.drivers
    two = [replace(driver, name=x, law=Polynomial(coefficients=(1.5, slope))) for x, slope in (("a", 1.0), ("b", -1.0))]
    model = Exudyn().constraints(replace(scene, mechanism=replace(scene.mechanism, drivers=tuple(two))))
    q = np.concatenate([body.estimate for body in scene.mechanism.bodies])
    rows = model.residual(q, 0.0)

    with pytest.raises(EngineError, match="driver 'b' at"):
        model.residual(q, 1.5)
    np.testing.assert_array_equal(model.residual(q, 0.0), rows)
