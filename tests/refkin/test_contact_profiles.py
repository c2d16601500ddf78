"""Profiles as tables, profiles with ends, and the proofs that rest on profiles."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np
import pytest
from flint import arb, ctx

import refkin
from refkin import Cam, Polar, Polynomial, Sinusoid, Table, compile_system
from refkin.proof.numbers.bounded import Bounded, Extended, Times, _Rounded, bounded_system, box
from refkin.proof.numbers.exact import exact, exact_system

from .contact_cases import FOLLOWERS, LOBES, TIMES, over_profile, scene, turning

KNOTS = np.linspace(0.0, math.tau, 13)
ROUND = (1.0 + 0.0625 * np.sin(3 * KNOTS)).tolist()
WAVY_TABLE = Table(argument=tuple(KNOTS.tolist()), value=(*ROUND[:-1], ROUND[0]), periodic=True)
SECTOR = Table(argument=tuple(np.linspace(-0.75, 1.5, 8).tolist()), value=(1.0, 1.1, 1.15, 1.1, 1.1, 1.0, 0.95, 1.0))
STEEP = Sinusoid(offset=1.0, amplitude=0.5, angular_frequency=5.0)


@pytest.mark.parametrize("follower", FOLLOWERS)
def test_a_table_that_is_a_profile_is_proved_as_the_spline_it_is(follower):
    motion = refkin.solve(over_profile(WAVY_TABLE, follower))

    assert motion.verdict == "ok", motion.message
    assert np.max(motion.certified_radius.acceleration) < 1e-12


def test_a_point_on_a_table_is_as_high_as_the_exact_spline():
    given = over_profile(WAVY_TABLE)
    motion = refkin.solve(given)
    with ctx.workprec(200):
        spline, t = exact(WAVY_TABLE), [arb(x) for x in TIMES]
        motor = exact(given.mechanism.drivers[0].law)
        height = [spline(arb.pi() / 2 - motor(x)) for x in t]
        rate = [-spline(arb.pi() / 2 - motor(x), 1) * motor(x, 1) for x in t]
        off = [float(abs(y - float(a))) for y, a in zip(height, motion["follower"].y, strict=True)]
        off_rate = [float(abs(y - float(a))) for y, a in zip(rate, motion["follower"].yd, strict=True)]

    assert np.all(np.array(off) <= motion.certified_radius.position)
    assert np.all(np.array(off_rate) <= motion.certified_radius.velocity)


def test_a_contact_on_a_knot_has_a_pose_and_no_proof_of_more_than_there_is():
    """At a knot the third derivative jumps, and with it the acceleration of the contact on a flat face."""
    law = replace(WAVY_TABLE, value=(1.0, 1.03, 1.06, 1.03, *ROUND[4:-1], 1.0))
    angle = math.pi / 2 - math.atan2(-law(KNOTS[2], 1), law(KNOTS[2])) - KNOTS[2]
    given = over_profile(law, "flat", times=(0.0,), estimates=((0.0, 0.0, angle), (0.0, 1.0, 0.0)))
    drivers = (turning("cam", Polynomial(coefficients=(angle, 1.0))),)
    motion = refkin.solve(replace(given, mechanism=replace(given.mechanism, drivers=drivers)))

    assert motion.contacts["contact"].s[0] == pytest.approx(KNOTS[2], abs=1e-12)
    assert motion.verdict == "ok"
    assert motion.certified_radius.position[0] < 1e-12
    assert not motion.certified_radius.acceleration[0] < 0.1


def test_a_contact_that_leaves_its_profile_has_no_answer_there():
    motion = refkin.solve(over_profile(SECTOR, times=tuple(np.linspace(0.0, 3.0, 13).tolist())))
    inside = np.array([s == "ok" for s in motion.status])

    assert inside[0]
    assert not inside[-1]
    assert np.all(motion.contacts["contact"].s[inside] >= -0.75)
    assert "the contact of contact leaves its profile after t = " in motion.message


def test_a_spiral_goes_on_for_more_than_a_turn():
    """An open profile is not the same a turn later: the follower rises on and on."""
    spiral, times = Polynomial(coefficients=(1.0, -0.125)), tuple(np.linspace(0.0, 3.0, 7).tolist())
    given = over_profile(spiral, times=times, estimates=((0.0, 0.0, 0.0), (0.0, 0.8, 0.0)))
    law = Polynomial(coefficients=(0.0, 4.0))
    motion = refkin.solve(replace(given, mechanism=replace(given.mechanism, drivers=(turning("cam", law),))))

    assert motion.verdict == "ok"
    assert motion["follower"].y == pytest.approx(
        1.0 - 0.125 * (math.pi / 2 - 4.0 * np.array(times)), rel=1e-14, abs=0.0
    )


def test_a_round_polar_profile_is_a_disc():
    round_, law = Polynomial(coefficients=(1.25,)), Polar(law=Polynomial(coefficients=(1.25,)))
    assert law.closed
    for name in ("disc under wedge", "disc under lever", "roller over disc", "tip on disc"):
        m = scene(name).mechanism
        joints = tuple(replace(j, profile=Polar(law=round_)) if isinstance(j, Cam) else j for j in m.joints)
        one, two = refkin.solve(scene(name)), refkin.solve(replace(scene(name), mechanism=replace(m, joints=joints)))

        for level in range(3):
            assert one.levels[level] == pytest.approx(two.levels[level], abs=1e-13)


@pytest.mark.parametrize(
    ("law", "closed"),
    [
        (LOBES, True),
        (Sinusoid(offset=1.0, amplitude=0.1, angular_frequency=1.5), False),
        (Sinusoid(offset=1.0, amplitude=0.0, angular_frequency=1.5), True),
        (Polynomial(coefficients=(1.0, 0.0)), True),
        (Polynomial(coefficients=(1.0, 0.0, 0.1)), False),
        (WAVY_TABLE, True),
        (SECTOR, False),
    ],
)
def test_a_profile_is_closed_if_it_repeats_itself_every_turn(law, closed):
    assert Polar(law=law).closed is closed


def everything(system, q, qd, t):
    """phi, phi_q and gamma in one row."""
    return [*system.phi(q, t), *system.phi_q(q, t).ravel(), *system.gamma(q, qd, t)]


@pytest.mark.parametrize("bound", ["rounding", "spread"])
@pytest.mark.parametrize("number", [Bounded, Extended])
@pytest.mark.parametrize("follower", FOLLOWERS)
@pytest.mark.parametrize("law", [STEEP, WAVY_TABLE, Polynomial(coefficients=(1.0, 0.125))], ids=lambda law: law.kind)
def test_bounds_hold_over_an_interval_of_contacts(number, follower, law, bound):
    """Exact values lie within rounding and spread, whether the contact is not known well or moves over a box."""
    mechanism = over_profile(law, follower).mechanism
    system, draw = compile_system(mechanism, unit=mechanism.unit()), np.random.default_rng(4)
    q, qd = draw.uniform(-1, 1, (2, system.n))
    radius = np.array([0.0] * system.of_bodies + [2.0**-6])
    at, rates = box(q[:, None], 0.0, number), box(qd[:, None], 0.0, number)
    for coordinate, off in zip((*at, *rates), (*radius, *radius), strict=True):
        setattr(coordinate, bound, off)
    result = everything(bounded_system(system, number), at, rates, Times([0.625], 2))
    with ctx.workprec(200):
        for move in draw.uniform(-1, 1, (20, 2, system.n)):
            x, v = (
                np.array([arb(c) for c in values], object) for values in (q + radius * move[0], qd + radius * move[1])
            )
            for value, bounds in zip(everything(exact_system(system, 200), x, v, arb(0.625)), result, strict=True):
                if isinstance(bounds, Bounded):
                    (mid,) = np.ravel(bounds.mid)
                    off = abs(arb(value) - float(mid) - float(mid - type(mid)(float(mid))))
                    assert float(off.lower()) <= np.ravel(bounds.rounding + bounds.spread)[0]


@pytest.mark.parametrize("bound", ["rounding", "spread"])
def test_bounds_that_forget_the_interval_are_seen(monkeypatch, bound):
    """The check above can fail: it does if what an unknown contact does to the profile is left out."""
    right = _Rounded.profile_values

    def without_interval(self, s, unit, order):
        return right(self, self.number.exactly(s.mid), unit, order)

    monkeypatch.setattr(_Rounded, "profile_values", without_interval)
    with pytest.raises(AssertionError):
        test_bounds_hold_over_an_interval_of_contacts(Bounded, "flat", STEEP, bound)
