"""What is allowed of a mechanism is its own, whatever moves beside it: no joint leads there, and no rounding."""

from __future__ import annotations

from dataclasses import replace
from functools import cache

import numpy as np
import pytest

from crosscheck.engines import Term
from crosscheck.judge.comparison import QUANTITIES, compare, reference
from crosscheck.judge.hard_poses import least_error
from crosscheck.judge.parts import parts_of
from crosscheck.judge.records import Cause
from crosscheck.measure.check import check
from refkin import AngleDriver, Body, Fixed, FourBar, Gear, Mechanism, Polynomial, Revolute
from refkin.system import compile_system
from tests.crosscheck.made_up_engines import Made
from tests.crosscheck.space_scenes import rssr
from tests.crosscheck.test_uncompared import beside

SLOW = FourBar(ground=4.0, crank=1.0, coupler=3.5, rocker=3.0).scene(times=(0.0, 0.3, 0.7))
FAST = 1e3
RATES = Term(name="of rates", level="velocity", reason="made up", of_rates=1e-11)


@cache
def with_rotor(speed):
    """The four-bar, and a rotor on a pin of its own."""
    pin = Revolute(name="pin", body_i="ground", point_i=(9.0, 0.0), body_j="rotor", point_j=(0.0, 0.0))
    motor = AngleDriver(name="motor", body="rotor", law=Polynomial(coefficients=(0.1, speed)))
    m, rotor = SLOW.mechanism, Body(name="rotor", estimate=(9.0, 0.0, 0.1))
    return replace(SLOW, mechanism=Mechanism((*m.bodies, rotor), (*m.joints, pin), (*m.drivers, motor)))


@pytest.mark.parametrize("terms", [(), (RATES,)])
def test_how_fast_a_rotor_turns_beside_a_linkage_says_nothing_of_the_linkage(terms):
    """A bound of the reference's error is of all coordinates, and counts up to what an engine is allowed."""
    still, fast = (reference(with_rotor(speed)).budget(terms).levels[:, :9] for speed in (0.0, FAST))

    assert np.all(fast <= 2.0 * still)


@pytest.mark.parametrize(("letter", "quantity"), [*zip(("q", "qd", "qdd"), QUANTITIES, strict=True)])
def test_a_slow_linkage_beside_a_fast_rotor_is_held_as_if_it_were_alone(letter, quantity):
    """Of the rotor's speed it was allowed 0.3 and 1e3 times as much in velocity and 5e5 times in acceleration."""
    order = QUANTITIES.index(quantity)
    allowed = reference(SLOW).budget().levels[order]

    def off(motion):
        level = np.array(getattr(motion, letter))
        for k, body in enumerate(motion.bodies):
            level[3 * k + 2, 1] += 10.0 * allowed[8, 1] * (body == "rocker")
        return replace(motion, **{letter: level})

    said = check(with_rotor(FAST), [Made("made", off)]).disagreements
    assert {(d.quantity, d.kind, d.at.component) for d in said if d.method != "rows" and d.at} == {
        (quantity, Cause.BEYOND, "rocker.phi")
    }


def test_a_redundant_mechanism_is_one_part_and_a_joint_makes_two_parts_one():
    """Least squares are of all rows together."""
    scene, twice = with_rotor(1.0), replace(with_rotor(1.0).mechanism.joints[-1], name="again")
    m = scene.mechanism
    counts = [
        len(list(parts_of(compile_system(mechanism))))
        for mechanism in (m, replace(m, joints=(*m.joints, twice)), rssr().mechanism)
    ]

    assert counts == [2, 1, 1]


def test_a_bracket_may_have_the_rates_that_qr_of_all_rows_leaves_it():
    """It was allowed 0, as LU leaves it: 1e-17 m/s of it was infinitely wrong."""
    bolts = Fixed(name="bolts", body_i="ground", point_i=(9.0, 0.0), body_j="bracket", point_j=(0.0, 0.0), angle=0.3)
    m, bracket = SLOW.mechanism, Body(name="bracket", estimate=(9.0, 0.0, 0.3))
    ref = reference(replace(SLOW, mechanism=Mechanism((*m.bodies, bracket), (*m.joints, bolts), m.drivers)))
    system, (q, qd, _), t = ref.system, ref.levels, ref.motion.t
    factors = [np.linalg.qr(slope) for slope in np.moveaxis(system.phi_q(q, t), -1, 0)]
    v, a = (
        np.stack([np.linalg.solve(r, q.T @ of_time) for (q, r), of_time in zip(factors, right.T, strict=True)], axis=1)
        for right in (system.nu(q, t), system.gamma(q, qd, t))
    )

    assert np.any(v[9:] != 0.0)
    assert compare(ref, replace(ref.motion, qd=system.to_physical(v, 1), qdd=system.to_physical(a, 2))).agrees


def by_a_motor(ratio):
    """The four-bar as it was, its crank driven through a gear by a rotor that has turned far, fast."""
    m, turned = with_rotor(0.0).mechanism, 1.0 / ratio
    wheels = {"body_i": "rotor", "body_j": "crank", "radius_i": ratio, "radius_j": 1.0}
    gear = Gear(name="gear", **wheels, phi0_i=turned, phi0_j=-SLOW.mechanism.drivers[0].law(0.0))
    motor = AngleDriver(name="motor", body="rotor", law=Polynomial(coefficients=(turned, -turned)))
    bodies = (*m.bodies[:-1], Body(name="rotor", estimate=(9.0, 0.0, turned)))
    return replace(SLOW, mechanism=Mechanism(bodies, (*m.joints, gear), (motor,)))


def test_a_motor_rounds_nothing_of_what_its_gear_drives_slowly():
    """At 5000 rad/s it was allowed 260 times as much in position, 6e5 in velocity, and 8e8 in acceleration.

    What is left in rates is that of elimination, which is of the largest row of all.
    """
    alone, driven = (reference(scene).budget().levels[:, :9] for scene in (SLOW, by_a_motor(2e-4)))

    assert np.all(driven[0] <= 4.0 * np.max(alone[0]))
    assert np.all(driven[1:] <= 5e3 * np.max(alone[1:], axis=1, keepdims=True))


@pytest.mark.parametrize("engine", ["exudyn", "mujoco", "vector_loop"])
def test_no_engine_rounds_a_linkage_for_the_motor_that_drives_it(engine):
    assert check(by_a_motor(2e-4), [engine]).disagreements == []


@pytest.mark.parametrize("engine", ["exudyn", "pinocchio", "mujoco", "closed_form", "vector_loop"])
def test_no_engine_rounds_a_linkage_for_a_rotor_beside_it(engine):
    assert check(with_rotor(FAST), [engine]).disagreements == []


@pytest.mark.parametrize("exactly", [False, True])
def test_each_of_two_loops_that_are_singular_at_once_is_held_at_a_fold_of_its_own(exactly):
    """One of the two was allowed twelve times as much, and, where both are so to the last bit, anything."""
    flat = FourBar(ground=2.0, crank=1.0, coupler=2.0, rocker=1.0).scene(
        law=Polynomial(coefficients=(1.0, -1.0)), times=(0.0, 0.5, 1.0)
    )
    regular = FourBar(ground=4.0, crank=1.0, coupler=3.5, rocker=3.0).scene(times=flat.times)
    allowed = []
    for scene in (flat, regular, beside(flat, beside(regular, flat))):
        q = reference(scene).motion.q[:, -1]
        allowed.append(least_error(compile_system(scene.mechanism), np.round(q, 6) if exactly else q, 1.0))
    alone = np.concatenate([allowed[0], allowed[1], allowed[0]])

    assert allowed[2] == pytest.approx(alone, rel=0.5)
