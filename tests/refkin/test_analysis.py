"""Scenes solved: closure, rates against differences, invariance to scale and place, one branch, honest verdicts."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

import refkin
from refkin import FourBar, Polynomial, Sinusoid, SliderCrank, Status, Unit, compile_system, fast
from refkin.analysis import acceleration, estimate_of, march, position, sweep, velocity
from refkin.motion import point_motion
from tests.linkages import ROCKER, system_of

ENGINE = SliderCrank(crank=1.0, rod=3.0, offset=0.4)


@pytest.mark.parametrize("branch", ["open", "crossed"])
@pytest.mark.parametrize("linkage", [ROCKER, ENGINE], ids=["four-bar", "slider-crank"])
def test_a_turn_closes_with_rates_that_are_its_derivatives(linkage, branch):
    """Velocity and acceleration against fourth-order differences of the positions: h^4 is 1e-10 here."""
    motion = refkin.solve(linkage.scene(speed=2.0, turns=1, samples=1001, branch=branch))
    h = motion.t[1] - motion.t[0]

    def derivative(values):
        return (values[:, :-4] - 8 * values[:, 1:-3] + 8 * values[:, 3:-1] - values[:, 4:]) / (12 * h)

    assert motion.verdict is Status.OK
    assert np.max(motion.residual) < 4e-16
    assert np.max(np.abs(derivative(motion.q) - motion.qd[:, 2:-2])) < 1e-7
    assert np.max(np.abs(derivative(motion.qd) - motion.qdd[:, 2:-2])) < 1e-7


@pytest.mark.parametrize("solver", [refkin.solve, fast.sweep])
@pytest.mark.parametrize("exponent", [-30, 30])
def test_a_linkage_in_another_unit_gives_the_same_bits(exponent, solver):
    lengths = {key: getattr(ROCKER, key) * 2.0**exponent for key in ("ground", "crank", "coupler", "rocker")}
    here, there = (solver(linkage.scene(samples=37)) for linkage in (ROCKER, FourBar(**lengths)))
    is_angle = np.arange(9) % 3 == 2

    for a, b in zip(here.levels, there.levels, strict=True):
        assert np.array_equal(a[is_angle], b[is_angle])
        assert np.array_equal(a[~is_angle], b[~is_angle] * 2.0**-exponent)


def test_a_linkage_far_from_its_origin_loses_nothing_but_its_coordinates():
    """At 2^27 sizes from the origin the ground points are still exact, and so is all that is not a coordinate."""
    far = replace(ROCKER, origin=(2.0**29, -(2.0**29)))
    here, there = (refkin.solve(linkage.scene(samples=37)) for linkage in (ROCKER, far))

    assert np.array_equal(here.qdd, there.qdd)
    assert np.array_equal(here["rocker"].phi, there["rocker"].phi)


def test_wanted_bodies_are_reported_alone_and_as_ever():
    scene = ROCKER.scene(samples=5)
    motion = refkin.solve(replace(scene, bodies_wanted=("rocker",)))

    assert motion.bodies == ("rocker",)
    assert np.array_equal(motion["rocker"].q, refkin.solve(scene)["rocker"].q)
    with pytest.raises(refkin.RefkinError, match="rocker"):
        motion["crank"]


def test_a_step_that_lands_on_the_next_time_by_rounding_is_the_last():
    """A sweep that took such a step for an inner one asked for the same time again, and ended there with 0/0."""
    table = {
        0.0: 0.00024013814943283474,
        0.12184037977982422: 0.6853523971003729,
        0.31601484770435423: 2.560190215378128,
        0.551865149770244: 2.7119007408605302,
        0.8196411087200428: 4.609107678935194,
        1.1139738599948024: 6.264149927436847,
    }
    law = refkin.Table(argument=tuple(table), value=tuple(table.values()))
    times = np.linspace(0.0, 1.1139738599948024, 12)
    motion = refkin.solve(refkin.InvertedSliderCrank(ground=2.0, crank=1.0, offset=0.5).scene(law=law, times=times))

    assert set(motion.status) == {Status.OK}


@pytest.mark.parametrize("turned", [2.0, 4.0, 6.0, 8.0])
def test_a_long_way_in_steps_of_its_own_ends_where_a_short_one_does(turned):
    """The crank slows down and turns back at the end: steps of twice the length fit there, and led beyond it."""
    scene = ROCKER.scene(law=Polynomial(coefficients=(0.3, 2.0 * turned, -turned)), times=(0.0, 1.0))
    system = system_of(scene)
    q = position(system, estimate_of(system, scene), 0.0).q
    fine = march(system, q, np.linspace(0.0, 1.0, 100).tolist())

    assert march(system, q, (0.0, 1.0))[:, -1] == pytest.approx(fine[:, -1], abs=1e-12)


@pytest.mark.parametrize("samples", [3, 9, 73])
def test_the_plain_analysis_goes_on_where_a_swing_turns_back(samples):
    """Planted: the change of the law's rate was taken for a kink of the path, twice the move to where it turns."""
    law = Sinusoid(amplitude=1.0, angular_frequency=1.0, phase=0.0, offset=0.3)
    scene = ROCKER.scene(law=law, times=tuple(np.linspace(0.0, np.pi, samples).tolist()))
    plain, proved = sweep(scene), refkin.solve(scene)

    assert set(plain.status) == {Status.OK}
    assert plain.q == pytest.approx(proved.q, abs=1e-13)


@pytest.mark.parametrize("q", [[0.5, 0.0], [0.5] * 10, np.zeros((8, 4))])
def test_a_pose_has_as_many_coordinates_as_its_system(q):
    system, rates = compile_system(ROCKER.scene(samples=2).mechanism), np.zeros(9)
    asked = [lambda: system.phi(q, 0.0), lambda: velocity(system, q, 0.0), lambda: acceleration(system, q, rates, 0.0)]
    asked += [lambda: position(system, q, 0.0)] * (np.ndim(q) == 1)
    for one in asked:
        with pytest.raises(refkin.InvalidRequest, match=r"^q0?: expected 9 coordinates, got shape "):
            one()


def test_whole_numbers_are_coordinates_as_others_are():
    """Jacobian and residual of integers, at a time that is one, were cut to integers: qd was 0."""
    system = compile_system(ROCKER.scene(samples=2).mechanism, unit=Unit(0.5, (0.25, 0.75)))
    whole, same = [1, 0, 1, 2, 1, 0, 3, 1, 1], [1.0, 0.0, 1.0, 2.0, 1.0, 0.0, 3.0, 1.0, 1.0]
    asked = [system.phi, system.phi_q, system.nu, lambda q, t: velocity(system, q, t), lambda q, _: system.to_unit(q)]
    asked += [lambda q, t: system.gamma(q, whole, t), lambda q, t: acceleration(system, q, whole, t)]

    assert all(np.array_equal(one(whole, 0), one(same, 0.0)) for one in asked)


@pytest.mark.parametrize(("key", "value"), [("effects", "velocity"), ("effects", ["velocity"]), ("unit", 2.0)])
def test_what_a_system_is_compiled_for_is_named(key, value):
    with pytest.raises(TypeError, match=f"{key}: expected a .*, got a {type(value).__name__}"):
        compile_system(ROCKER.scene(samples=2).mechanism, **{key: value})


def test_no_answer_stays_no_answer():
    """NaN where a body's pose is not known."""
    q = np.array([[0.0, np.nan], [0.0, np.nan], [0.0, np.nan]])
    motion = point_motion((1.0, 0.0), q, q, q)

    assert np.isnan(motion.a[:, 1]).all()
    assert not np.isnan(motion.a[:, 0]).any()


def test_rates_that_are_not_given_are_not_reported():
    q = np.zeros((3, 2))

    assert point_motion((1.0, 0.0), q).v is None
    assert point_motion((1.0, 0.0), q, q).a is None


def test_a_sweep_that_begins_in_a_pose_without_an_inverse_says_singular():
    """It ended in an error of the linear solve: two guides in one line hold a body nowhere along it."""
    along = {"body_i": "ground", "point_i": (0, 0), "body_j": "b", "point_j": (0, 0), "axis_i": (1, 0)}
    guides = tuple(refkin.PointOnLine(name=name, **along) for name in ("one", "again"))
    driver = refkin.AngleDriver(name="d", body="b", law=refkin.Polynomial(coefficients=(0.1, 1.0)))
    body = refkin.Body(name="b", estimate=(0.3, 0.0, 0.1))
    motion = sweep(refkin.Scene(mechanism=refkin.Mechanism((body,), guides, (driver,)), times=(0.0, 0.5)))

    assert [status.value for status in motion.status] == ["singular", "branch_lost"]
