"""Each joint's residual, Jacobian, nu and gamma against each other by complex steps, in every arithmetic."""

from __future__ import annotations

import numpy as np
import pytest
from flint import arb

from refkin import (
    AngleDriver,
    Body,
    Distance,
    DistanceDriver,
    Fixed,
    Mechanism,
    PointOnLine,
    Polynomial,
    Prismatic,
    Revolute,
    Sinusoid,
    Unit,
    XDriver,
    YDriver,
    compile_system,
)
from refkin.differences import jacobian
from refkin.joints import DRIVER_TYPES, JOINT_TYPES

BODIES = (Body(name="a"), Body(name="b"))
BETWEEN = {"name": "c", "body_i": "a", "point_i": (0.3, -0.2), "body_j": "b", "point_j": (-0.4, 0.7)}
FROM_GROUND = {**BETWEEN, "body_i": "ground"}
LAW = Polynomial(coefficients=(2.0, -0.7, 0.4, 0.1))
WAVE = Sinusoid(amplitude=0.3, angular_frequency=1.7, offset=2.0, phase=0.4)

CONSTRAINTS = [
    Revolute(**BETWEEN),
    Revolute(**FROM_GROUND),
    Fixed(**BETWEEN, angle=0.4),
    PointOnLine(**BETWEEN, axis_i=(3.0, -1.0)),
    PointOnLine(**FROM_GROUND, axis_i=(0.0, 2.0)),
    Prismatic(**BETWEEN, axis_i=(0.2, 0.9), angle=-1.1),
    Distance(**BETWEEN, length=1.3),
    Distance(**FROM_GROUND, length=0.2),
    AngleDriver(name="c", body="b", law=LAW),
    AngleDriver(name="c", body="b", relative_to="a", rate_law=WAVE, initial=0.3),
    XDriver(name="c", body="b", point=(0.3, 0.1), law=WAVE),
    YDriver(name="c", body="a", point=(-0.2, 0.5), rate_law=LAW),
    DistanceDriver(**BETWEEN, law=WAVE),
]
UNIT = Unit(0.25, (3.0, -2.0))
T = 0.37


def _system(constraint):
    """The one constraint, and enough rows that hold nothing of interest to make a mechanism of it."""
    filling = [AngleDriver(name=f"filling{k}", body="a", law=LAW) for k in range(6)]
    is_driver = isinstance(constraint, DRIVER_TYPES)
    joints = () if is_driver else (constraint,)
    drivers = (constraint, *filling) if is_driver else tuple(filling)
    return compile_system(Mechanism(BODIES, joints, drivers), unit=UNIT), slice(0, constraint.rows)


def _state(seed=1):
    draw = np.random.default_rng(seed)
    return tuple(draw.normal(size=6) for _ in range(3))


@pytest.mark.parametrize("constraint", CONSTRAINTS, ids=lambda c: type(c).__name__)
def test_jacobian_is_the_derivative_of_the_residual(constraint):
    system, rows = _system(constraint)
    q, _, _ = _state()

    assert np.max(np.abs(jacobian(lambda x: system.phi(x, T), q) - system.phi_q(q, T))[rows]) < 1e-14


@pytest.mark.parametrize("constraint", CONSTRAINTS, ids=lambda c: type(c).__name__)
def test_nu_is_minus_the_time_derivative_of_the_residual(constraint):
    if any(type(law).__name__ == "Table" for law in constraint.laws):
        pytest.fail("a table has no complex argument: test it by its own derivative")
    system, rows = _system(constraint)
    q, _, _ = _state()
    phi_t = np.imag(system.phi(q.astype(complex), T + 1e-100j)) / 1e-100

    assert np.max(np.abs(phi_t + system.nu(q, T))[rows]) < 1e-14


@pytest.mark.parametrize("constraint", CONSTRAINTS, ids=lambda c: type(c).__name__)
def test_gamma_has_every_term_of_the_second_time_derivative(constraint):
    """Phi_q qdd - gamma is the derivative of phi_q qd - nu along a motion with rates qd and qdd."""
    system, rows = _system(constraint)
    q, qd, qdd = _state()
    e = 1e-100j
    moved = system.phi_q(q + e * qd, T + e) @ (qd + e * qdd) - system.nu(q + e * qd, T + e)

    assert np.max(np.abs(np.imag(moved) / 1e-100 - (system.phi_q(q, T) @ qdd - system.gamma(q, qd, T)))[rows]) < 2e-14


@pytest.mark.parametrize("constraint", CONSTRAINTS, ids=lambda c: type(c).__name__)
def test_the_same_text_runs_on_rows_and_balls(constraint):
    """A row gives lane by lane what floats give; a ball encloses it."""
    system, _ = _system(constraint)
    states = [_state(seed) for seed in range(4)]
    q, qd, _ = (np.stack(part, axis=-1) for part in zip(*states, strict=True))
    t = np.linspace(0.1, 0.9, 4)
    formulas = (system.phi, system.phi_q, system.nu)
    lane = [np.stack([f(q[:, k], t[k]) for k in range(4)], axis=-1) for f in formulas]
    lane.append(np.stack([system.gamma(q[:, k], qd[:, k], t[k]) for k in range(4)], axis=-1))
    rows = [*(f(q, t) for f in formulas), system.gamma(q, qd, t)]
    ball = system.phi(np.array([arb(v) for v in q[:, 0]], object), t[0])

    assert all(np.max(np.abs(a - b)) < 1e-14 for a, b in zip(lane, rows, strict=True))
    # A row has about eight roundings, each at most of the largest term on the way: d . d is up to eight times the result.
    exact = np.array([float(arb(b).mid()) for b in ball])
    assert np.max(np.abs(exact - lane[0][:, 0]) / np.maximum(1.0, np.abs(exact))) < 64 * 2.0**-53


def test_every_joint_and_driver_type_is_among_the_cases():
    assert {type(c) for c in CONSTRAINTS} == {*JOINT_TYPES, *DRIVER_TYPES}


def test_a_missing_term_of_gamma_is_seen(monkeypatch):
    """The check above can fail: without the Coriolis term of a moving guide it does."""
    constraint = CONSTRAINTS[3]
    whole = PointOnLine.gamma

    def without_coriolis(g, f, i, j):
        (value,) = whole(g, f, i, j)
        still = [type(b)(b.r.x, b.r.y, b.phi).moving(0.0, 0.0, b.omega) for b in (i, j)]
        return (0.5 * value + 0.5 * whole(g, f, *still)[0],)

    monkeypatch.setattr(PointOnLine, "gamma", staticmethod(without_coriolis))
    with pytest.raises(AssertionError):
        test_gamma_has_every_term_of_the_second_time_derivative(constraint)
