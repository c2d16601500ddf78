"""Each joint's residual, Jacobian, nu and gamma against each other by complex steps, in every arithmetic."""

from __future__ import annotations

import numpy as np
import pytest
from flint import arb

from refkin import (
    AngleDriver,
    Body,
    Cam,
    Disc,
    Distance,
    DistanceDriver,
    Fixed,
    Gear,
    Mechanism,
    PointOnLine,
    Polar,
    Polynomial,
    Prismatic,
    RackAndPinion,
    Revolute,
    Sinusoid,
    Table,
    Unit,
    XDriver,
    YDriver,
    compile_system,
)
from refkin.differences import jacobian
from refkin.joints import DRIVER_TYPES, JOINT_TYPES
from refkin.joints.contact_kinematics import Gap
from refkin.proof.numbers.exact import exact_system

BODIES = (Body(name="a"), Body(name="b"))
BETWEEN = {"name": "c", "body_i": "a", "point_i": (0.3, -0.2), "body_j": "b", "point_j": (-0.4, 0.7)}
FROM_GROUND = {**BETWEEN, "body_i": "ground"}
LAW = Polynomial(coefficients=(2.0, -0.7, 0.4, 0.1))
WAVE = Sinusoid(amplitude=0.3, angular_frequency=1.7, offset=2.0, phase=0.4)
KNOTS = Table(argument=(-9.0, -1.0, 0.2, 1.0, 9.0), value=(2.0, 0.4, 1.1, 1.0, 2.7))
FLAT = {"follower": "flat", "normal_j": (-0.3, 1.1)}
ROLLER = {"follower": "roller", "roller_radius": 0.4}

CONSTRAINTS = [
    Revolute(**BETWEEN),
    Revolute(**FROM_GROUND),
    Fixed(**BETWEEN, angle=0.4),
    PointOnLine(**BETWEEN, axis_i=(3.0, -1.0)),
    PointOnLine(**FROM_GROUND, axis_i=(0.0, 2.0)),
    Prismatic(**BETWEEN, axis_i=(0.2, 0.9), angle=-1.1),
    Distance(**BETWEEN, length=1.3),
    Distance(**FROM_GROUND, length=0.2),
    Revolute(**BETWEEN, offset_law=(LAW, WAVE)),
    Revolute(**FROM_GROUND, offset_law=(KNOTS, LAW)),
    Gear(name="c", body_i="a", radius_i=0.3, body_j="b", radius_j=-0.7, phi0_i=0.2, phi0_j=-0.4),
    Gear(name="c", body_i="ground", radius_i=0.3, body_j="b", radius_j=0.7, phi0_i=0.2),
    RackAndPinion(**BETWEEN, axis_i=(3.0, -1.0), radius=0.3, phi0=0.4, s0=0.2),
    RackAndPinion(**FROM_GROUND, axis_i=(0.0, -2.0), radius=-0.6),
    Cam(**BETWEEN, profile=Disc(radius=0.8), **FLAT),
    Cam(**FROM_GROUND, profile=Disc(radius=0.8), **FLAT),
    Cam(**BETWEEN, profile=Disc(radius=0.8), follower="point"),
    Cam(**BETWEEN, profile=Disc(radius=0.8), **ROLLER),
    *(
        Cam(**ends, profile=Polar(law=law), **follower)
        for ends, law in ((BETWEEN, LAW), (FROM_GROUND, WAVE), (BETWEEN, KNOTS))
        for follower in (FLAT, {"follower": "point"}, ROLLER)
    ),
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
    filling = [AngleDriver(name=f"filling{k}", body="a", law=LAW) for k in range(7)]
    is_driver = isinstance(constraint, DRIVER_TYPES)
    joints = () if is_driver else (constraint,)
    drivers = (constraint, *filling) if is_driver else tuple(filling)
    return compile_system(Mechanism(BODIES, joints, drivers), unit=UNIT), slice(0, constraint.rows)


def _state(system, seed=1):
    draw = np.random.default_rng(seed)
    return tuple(draw.normal(size=system.n) for _ in range(3))


def _name(constraint):
    profile = getattr(constraint, "profile", None)
    if profile is None:
        return type(constraint).__name__
    law = getattr(profile, "law", profile)
    return f"{constraint.follower} on {type(law).__name__}"


def _scale(values):
    """The largest of the values, by which their rounding errors grow, at least 1."""
    return max(1.0, np.max(np.abs(values)))


@pytest.mark.parametrize("constraint", CONSTRAINTS, ids=_name)
def test_jacobian_is_the_derivative_of_the_residual(constraint):
    system, rows = _system(constraint)
    q, _, _ = _state(system)
    slope = system.phi_q(q, T)[rows]

    assert np.max(np.abs(jacobian(lambda x: system.phi(x, T), q)[rows] - slope)) < 1e-14 * _scale(slope)


@pytest.mark.parametrize("constraint", CONSTRAINTS, ids=_name)
def test_nu_is_minus_the_time_derivative_of_the_residual(constraint):
    system, rows = _system(constraint)
    q, _, _ = _state(system)
    phi_t = np.imag(system.phi(q.astype(complex), T + 1e-100j)) / 1e-100

    assert np.max(np.abs(phi_t + system.nu(q, T))[rows]) < 1e-14


@pytest.mark.parametrize("constraint", CONSTRAINTS, ids=_name)
def test_gamma_has_every_term_of_the_second_time_derivative(constraint):
    """Phi_q qdd - gamma is the derivative of phi_q qd - nu along a motion with rates qd and qdd."""
    system, rows = _system(constraint)
    q, qd, qdd = _state(system)
    e = 1e-100j
    moved = system.phi_q(q + e * qd, T + e) @ (qd + e * qdd) - system.nu(q + e * qd, T + e)
    left, gamma = (system.phi_q(q, T) @ qdd)[rows], system.gamma(q, qd, T)[rows]

    assert np.max(np.abs(np.imag(moved)[rows] / 1e-100 - (left - gamma))) < 2e-14 * _scale(gamma)


@pytest.mark.parametrize("constraint", CONSTRAINTS, ids=_name)
def test_the_same_text_runs_on_rows_and_balls(constraint):
    """A row gives lane by lane what floats give; a ball encloses it."""
    system, _ = _system(constraint)
    states = [_state(system, seed) for seed in range(4)]
    q, qd, _ = (np.stack(part, axis=-1) for part in zip(*states, strict=True))
    t = np.linspace(0.1, 0.9, 4)
    formulas = (system.phi, system.phi_q, system.nu)
    lane = [np.stack([f(q[:, k], t[k]) for k in range(4)], axis=-1) for f in formulas]
    lane.append(np.stack([system.gamma(q[:, k], qd[:, k], t[k]) for k in range(4)], axis=-1))
    rows = [*(f(q, t) for f in formulas), system.gamma(q, qd, t)]
    ball = exact_system(system, 53).phi(np.array([arb(v) for v in q[:, 0]], object), arb(t[0]))

    assert all(np.max(np.abs(a - b)) < 1e-14 * _scale(a) for a, b in zip(lane, rows, strict=True))
    # A row has about eight roundings, each at most of the largest term on the way: d . d is up to eight times the row.
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


@pytest.mark.parametrize("follower", [FLAT, {"follower": "point"}, ROLLER], ids=lambda f: f["follower"])
@pytest.mark.parametrize("term", ["normal", "Coriolis", "relative"])
def test_a_missing_term_of_the_contact_point_is_seen(monkeypatch, follower, term):
    """The touched point moves on a body that turns: without one of its three accelerations the check is red."""
    whole = Gap.curve_drift

    def without(self, k):
        omega, rate = self.i.omega, self.s.rate
        terms = {
            "normal": self.curve[k] * (-omega * omega),
            "Coriolis": self.curve[k + 1].perp() * (2 * omega * rate),
            "relative": self.curve[k + 2] * (rate * rate),
        }
        return whole(self, k) - terms[term]

    monkeypatch.setattr(Gap, "curve_drift", without)
    with pytest.raises(AssertionError):
        test_gamma_has_every_term_of_the_second_time_derivative(Cam(**BETWEEN, profile=Polar(law=WAVE), **follower))
