"""Many mechanisms of one topology: right in every sample, and no sample disturbs another."""

from __future__ import annotations

import importlib
import math
import re
import time
from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest

import refkin
from refkin import (
    AngleDriver,
    Body,
    Distance,
    DistanceDriver,
    Effect,
    Evidence,
    Mechanism,
    Polynomial,
    RefkinError,
    Revolute,
    Scene,
    Sinusoid,
    Status,
    Table,
    XDriver,
)
from refkin.errors import InvalidRequest, InvalidScene, UnknownName
from refkin.fast import solve_many, sweep
from refkin.fast.block import SMALL, Block
from refkin.fast.family import _change, common_extrema, family, may_turn
from refkin.motion_laws import Integral
from refkin.newton import CONTRACTION
from refkin.proof.pose.krawczyk import krawczyk
from refkin.system import compile_system
from tests.claims import assert_near
from tests.linkages import beside_a_wheel, remade, system_of, without_estimates
from tests.mutation.change import mutated

from .families import closed_form, errors, estimates, geometry, grashof, scene
from .linkworks import chain
from .scenes import ROCKER, SCENES, bare

block = importlib.import_module("refkin.fast.block")
U = 2.0**-53
LAW = Sinusoid(amplitude=1.0, angular_frequency=1.0)


def solved(lengths, sign=1, samples=72, **options):
    return solve_many(scene(samples), geometry(lengths), estimates(lengths, sign), **options)


def slack_of(lengths):
    """(p + q) - (s + l) in units of the longest link."""
    s, p, q, longest = np.sort(lengths, axis=0)
    return (p + q - s - longest) / longest


@pytest.mark.parametrize("sign", [1, -1])
def test_a_thousand_four_bars_agree_with_the_closed_form(sign):
    """Errors grow as the inverse of the distance of the branches, about the root of the slack."""
    lengths = grashof(1000, margin=0.02)
    many = solved(lengths, sign)

    assert many.ok.all()
    assert np.all(np.max(errors(many, lengths, sign), axis=1) < 64 * U / np.sqrt(slack_of(lengths)))


def test_a_thousand_four_bars_without_any_margin_are_right_or_not_ok():
    lengths = grashof(1000, margin=0.0, seed=4)
    many = solved(lengths)
    worst = np.max(errors(many, lengths), axis=1, where=many.ok, initial=0.0)

    assert np.mean(many.ok) > 0.99
    assert np.all(worst < 1e3 * U / slack_of(lengths))


def test_rates_agree_with_the_reference():
    lengths = grashof(20, margin=0.02)
    many = solved(lengths, samples=9)
    for sample in range(20):
        motion = refkin.solve(many.scene(sample))
        for ours, theirs in zip((many.q, many.qd, many.qdd), motion.levels, strict=True):
            assert np.max(np.abs(ours[:, sample] - theirs)) < 1e-12 * max(1.0, np.max(np.abs(theirs)))


def test_a_scene_of_one_sample_is_the_mechanism_of_that_sample():
    lengths = grashof(5, margin=0.02)
    many = solved(lengths, samples=3)
    own = refkin.FourBar(*lengths[:, 3]).mechanism(ROCKER.driver(Polynomial(coefficients=(0.0, 1.0))))

    assert many.scene(3).mechanism.joints == own.joints
    assert many.scene(3).mechanism.drivers == own.drivers


def test_every_sample_is_scaled_by_its_own_size():
    lengths = grashof(40, margin=0.02) * 10.0 ** np.linspace(-9, 9, 40)
    group = family(scene(), system_of(scene()), geometry(lengths))
    for sample in range(40):
        assert group.unit_of(sample) == group.sample(sample).mechanism.unit()


def test_points_that_rounding_tells_apart_give_no_sample_a_size():
    """Two wheels about one axis had a size of 5.6e-17 m in a family: estimates a hair off were never found."""
    pins = [
        Revolute(name=f"pin {k}", body_i="ground", point_i=(at, 0.0), body_j=f"wheel {k}", point_j=(0.2, 0.0))
        for k, at in enumerate((0.3, 0.1 + 0.2))
    ]
    turn = Polynomial(coefficients=(0.0, 1.0))
    motors = [AngleDriver(name=f"motor {k}", body=f"wheel {k}", law=turn) for k in (0, 1)]
    wheels = [Body(name=f"wheel {k}", estimate=(0.11, 0.0, 0.01)) for k in (0, 1)]
    wanted = Scene(mechanism=Mechanism(wheels, pins, motors), times=(0.0, 0.1, 0.5))
    many = solve_many(wanted, {"motor 1": {"law": Polynomial(coefficients=(0.0, np.array([1.0, -0.7])))}})

    assert many.family.unit_of(1) == many.scene(1).mechanism.unit()
    assert many.ok.all()


def test_samples_of_every_size_are_answered():
    lengths = grashof(100, margin=0.02) * 10.0 ** np.linspace(-9, 9, 100)
    exact = np.round(closed_form(lengths, np.zeros((1, 1)))[1], 3)
    assert exact.shape == (100, 1)
    first = estimates(lengths, decimals=0)
    many = solve_many(scene(), geometry(lengths), first)

    assert many.ok.all()
    _, _, coupler, _ = closed_form(lengths, np.array(many.t)[None, :])
    assert np.max(np.abs(np.exp(1j * many.q[5]) - np.exp(1j * coupler))) < 1e-12


def test_a_family_without_rows_is_one_mechanism_and_a_number_stands_for_a_row():
    lengths = grashof(3, margin=0.02)
    first = estimates(lengths)
    alone = family(scene(), system_of(scene()), {})
    phi = np.array([1.0, 2.0, 3.0])
    mixed = family(scene(), system_of(scene()), geometry(lengths), {**first, "rocker": (0.5, 0.25, phi)})

    assert alone.size == 1
    assert mixed.estimates["rocker"].tolist() == [[0.5] * 3, [0.25] * 3, phi.tolist()]


BAD = {
    "does not assemble": (np.s_[:, ::10], 0.01),
    "no length": (np.s_[2, ::10], np.nan),
    "too long a link": (np.s_[2, ::10], 1e300),
    "zero": (np.s_[1:3, ::10], 0.0),
}


@pytest.mark.parametrize("fault", BAD)
def test_bad_samples_change_no_bit_of_the_others(fault):
    """Nor does the first, by which a family is made if it is good."""
    lengths = grashof(200, margin=0.02)
    good = solved(lengths, samples=40)
    where, value = BAD[fault]
    spoilt = lengths.copy()
    spoilt[where] = value
    if fault == "does not assemble":
        spoilt[0, ::10] = 1.0
    many = solve_many(scene(40), geometry(spoilt), estimates(lengths))
    others = np.arange(200) % 10 != 0

    assert many.ok[others].all()
    assert not many.ok[~others].any()
    assert np.isnan(many.q[:, ~others]).all()
    for a, b in ((many.q, good.q), (many.qd, good.qd), (many.qdd, good.qdd)):
        assert np.array_equal(a[:, others], b[:, others])


def test_a_sample_that_cannot_go_on_is_lost_from_there_on():
    """Triple rockers among the cranks: each goes to its limit, and no further."""
    lengths = grashof(50, margin=0.02)
    lengths[:, 7] = 0.9, 0.3, 0.6, 0.45
    many = solved(lengths, samples=181)
    limit = refkin.FourBar(*lengths[:, 7]).input_range()[0][1]
    within = many.t < limit

    assert np.array_equal(many.ok[7], within)
    assert many.status(7)[-1] is Status.BRANCH_LOST
    assert many.ok[np.arange(50) != 7].all()


def test_an_estimate_between_two_assemblies_decides_nothing():
    lengths = grashof(10, margin=0.02)
    first = estimates(lengths)
    other = estimates(lengths, sign=-1)
    first["coupler"][:, 4] = (first["coupler"][:, 4] + other["coupler"][:, 4]) / 2
    first["rocker"][:, 4] = (first["rocker"][:, 4] + other["rocker"][:, 4]) / 2
    many = solve_many(scene(5), geometry(lengths), first)

    assert many.status(4) == (Status.NOT_CONVERGED,) * 5
    assert many.ok[np.arange(10) != 4].all()


def test_a_start_from_which_newton_first_goes_far_away_decides_nothing():
    """From 0.002 rad, nearly between 0.1 and -0.1 rad, it went 2.5 rad away, came back to -0.1 rad, and was ok."""
    pin = Revolute(name="O", body_i="ground", point_i=(0.0, 0.0), body_j="crank", point_j=(0.0, 0.0))
    tip = XDriver(name="tip", body="crank", point=(1.0, 0.0), law=Polynomial(coefficients=(math.cos(0.1),)))
    crank = Scene(mechanism=Mechanism((Body(name="crank"),), (pin,), (tip,)), times=(0.0,))
    angles = np.array([*np.linspace(1e-4, 0.02, 200), 0.09])
    many = solve_many(crank, {}, {"crank": (0.0, 0.0, angles)})

    assert many.ok[:, 0].tolist() == [False] * 200 + [True]
    assert many.q[2, -1, 0] == pytest.approx(0.1, rel=1e-12)


def test_bodies_off_at_the_angles_of_a_pose_start_there():
    """Newton had nothing to correct but what follows from the angles: alone such a mechanism was not ok."""
    given = scene(3)
    poses = refkin.solve(given).q[:, 0].reshape(-1, 3) + np.array([0.1, 0.0, 0.0])

    assert solve_many(given, {}, dict(zip(given.wanted, map(tuple, poses), strict=True))).ok.all()


def test_bad_samples_do_not_slow_the_others():
    """One sample in ten that never assembles, against none: within half as much again, the best of five."""
    lengths = grashof(2000, margin=0.02)
    spoilt = lengths.copy()
    spoilt[1:3, ::10] = 0.01
    best = {}
    for _ in range(5):
        for name, some in (("good", lengths), ("spoilt", spoilt)):
            start = time.process_time()
            solve_many(scene(20), geometry(some), estimates(lengths), reducer=lambda part: None)
            best[name] = min(best.get(name, np.inf), time.process_time() - start)

    assert best["spoilt"] < 1.5 * best["good"]


def test_what_is_no_reducer_is_refused_before_the_work_begins():
    with pytest.raises(InvalidRequest, match="reducer: expected what takes a Slice, got 3"):
        solve_many(scene(20), {}, reducer=3)


def test_a_reducer_sees_what_is_stored_otherwise():
    lengths = grashof(300, margin=0.02)
    stored = solved(lengths, samples=10)

    def copied(part):
        return part.samples, part.k, part.t, part.q.copy(), part.qdd.copy(), part.codes.copy(), part.residual.copy()

    many = solved(lengths, samples=10, reducer=copied)

    assert many.q is None
    assert many.residual is None
    assert len(many.reduced) == 10
    for samples, k, t, q, qdd, codes, residual in many.reduced:
        assert t == stored.t[k]
        assert np.array_equal(q, stored.q[:, samples, k])
        assert np.array_equal(qdd, stored.qdd[:, samples, k])
        assert np.array_equal(codes, stored.codes[samples, k])
        assert np.array_equal(residual, stored.residual[samples, k])


def test_codes_that_a_reducer_keeps_are_those_of_their_time():
    """Of a mechanism that turns fully and of one that is lost on the way."""
    lengths = np.array([[4.0, 1.0, 3.5, 3.0], [4.0, 2.0, 2.5, 2.0]]).T
    stored = solved(lengths, samples=9)
    many = solved(lengths, samples=9, reducer=lambda part: part.codes)

    assert stored.codes[1, 0] != stored.codes[1, -1]
    assert np.array_equal(np.transpose(many.reduced), stored.codes)


def test_blocks_are_as_one(monkeypatch):
    lengths = grashof(700, margin=0.02)
    whole = solved(lengths, samples=8)
    monkeypatch.setattr(importlib.import_module("refkin.fast.elimination.run"), "MOST_SAMPLES", 256)
    seen = []
    parts = solved(lengths, samples=8)
    solved(lengths, samples=8, reducer=lambda part: seen.append(part.samples))

    assert len({(s.start, s.stop) for s in seen}) == 3
    assert np.array_equal(whole.q, parts.q)


def test_memory_is_that_of_a_block_whatever_the_number_of_times():
    import tracemalloc

    lengths = grashof(500, margin=0.02)
    solved(lengths, samples=2)  # compiles
    peaks = []
    for samples in (20, 200):
        tracemalloc.start()
        solved(lengths, samples=samples, reducer=lambda part: None)
        peaks.append(tracemalloc.get_traced_memory()[1])
        tracemalloc.stop()

    assert peaks[1] < 1.1 * peaks[0] + 500 * 200
    assert peaks[0] < 500 * 4096


def test_driver_laws_may_be_rows():
    """Speeds from slow to several radians between two times, and phases."""
    lengths = grashof(60, margin=0.1)
    speed, phase = np.linspace(0.1, 5.0, 60), np.linspace(0.0, 0.05, 60)
    law = {"driver": {"law": Polynomial(coefficients=(phase, speed))}}
    first = estimates(lengths)
    first["crank"][2] += phase
    many = solve_many(scene(9), {**geometry(lengths), **law}, first)
    _, _, coupler, _ = closed_form(lengths, phase[:, None] + speed[:, None] * many.t)

    assert many.ok.all()
    assert np.max(np.abs(np.exp(1j * many.q[5]) - np.exp(1j * coupler))) < 1e-12


def test_one_hasty_sample_makes_the_others_take_no_smaller_steps(monkeypatch):
    lengths = grashof(400, margin=0.1)
    speed = np.ones(400)
    speed[5] = 40.0
    steps = []
    step = block.Block._step
    monkeypatch.setattr(block.Block, "_step", lambda self, t, hasty: steps.append(t) or step(self, t, hasty))
    law = {"driver": {"law": Polynomial(coefficients=(0.0, speed))}}
    many = solve_many(scene(21), {**geometry(lengths), **law}, estimates(lengths))
    _, _, coupler, _ = closed_form(lengths, speed[:, None] * many.t)

    assert len(steps) == 20
    assert many.ok.all()
    assert np.max(np.abs(np.exp(1j * many.q[5]) - np.exp(1j * coupler))) < 1e-12


@pytest.mark.parametrize("begin", [-8.0, 8.0])
def test_when_a_sweep_begins_changes_nobody_s_steps(monkeypatch, begin):
    """Who marches alone, and when: the laws are the same of the time since the beginning."""
    lengths, march, alone = grashof(40, margin=0.1), Block._march_alone, {}
    speed = np.linspace(1.0, 9.0, 40)
    for start in (0.0, begin):
        some = alone.setdefault(start, [])
        law = {"driver": {"law": Polynomial(coefficients=(-start * speed, speed))}}
        monkeypatch.setattr(
            Block, "_march_alone", lambda self, samples, t, some=some: some.append(samples) or march(self, samples, t)
        )
        given = replace(scene(6), times=tuple(start + np.arange(6) / 8.0))
        assert solve_many(given, {**geometry(lengths), **law}, estimates(lengths)).ok.all()

    assert np.array_equal(alone[0.0], alone[begin])
    assert not np.all(alone[0.0])


@pytest.mark.parametrize(("body", "rows"), [("crank", slice(0, 3)), ("rocker", slice(6, 9))])
@pytest.mark.parametrize("effects", [(), (Effect.VELOCITY,), (Effect.ACCELERATION,)])
def test_only_what_is_called_for_is_reported(effects, body, rows):
    """Estimates of bodies on which nothing wanted depends are no hindrance."""
    lengths = grashof(10, margin=0.02)
    some = scene(6, effects=frozenset(effects), bodies_wanted=(body,))
    many = solve_many(some, geometry(lengths), estimates(lengths))
    whole = solved(lengths, samples=6)

    assert many.ok.all()
    assert many.bodies == (body,)
    assert many.q.shape == (3, 10, 6)
    assert np.max(np.abs(many.q - whole.q[rows])) < 1e-15
    assert (many.qd is not None) == (Effect.VELOCITY in effects)
    assert (many.qdd is not None) == (Effect.ACCELERATION in effects)


def test_all_bodies_in_another_order_have_the_rows_of_their_names():
    """They had those of the order of the scene, and were ok."""
    names = ("rocker", "crank", "coupler")
    many, alone = solve_many(scene(6, bodies_wanted=names), {}), refkin.solve(scene(6, bodies_wanted=names))

    assert many.bodies == alone.bodies == names
    assert many.ok.all()
    for level, expected in zip((many.q, many.qd, many.qdd), alone.levels, strict=True):
        assert_near(level[:, 0], expected, 1e-12, "rows")


def test_groups_that_nobody_wants_are_not_computed():
    whole = chain(3, evidence=frozenset())
    lengths = {"foot3": {"point_i": (np.linspace(4.5, 4.52, 5), 0.0)}}
    many = solve_many(replace(whole, bodies_wanted=("rocker1",)), lengths)

    assert many.ok.all()
    assert len(many.family.scene.mechanism.bodies) == 3


def test_many_mechanisms_say_what_is_not_looked_at_between_two_times():
    def unseen(given, joint):
        return solve_many(replace(given, times=given.times[:2]), {joint: {"point_j": (np.zeros(2), 0.0)}}).unseen

    two = beside_a_wheel(ROCKER.scene(), Polynomial(coefficients=(0.0, 1.0)))
    (*others, wheel) = two.mechanism.bodies
    two = remade(two, bodies=(*others, replace(wheel, estimate=(9.0, 0.0, 0.0))))

    assert unseen(ROCKER.scene(), "A0") == ""
    assert unseen(two, "A0") == "several laws together"
    assert unseen(chain(2), "foot0") == "a loop that another one moves"
    assert unseen(SCENES["tip on lobes"], "pin of cam") == "a cam's profile"


@pytest.mark.parametrize("name", [name for name in SCENES if name != "crank by its rate"])
def test_every_joint_goes_through_samples(name):
    """Three samples: the scene as it is, and one of its points moved a little to either side."""
    some = replace(SCENES[name], times=SCENES[name].times[:12])
    joint = some.mechanism.joints[-1]
    joint = joint if hasattr(joint, "point_j") else some.mechanism.joints[0]
    x, y = joint.point_j
    moved = {joint.name: {"point_j": (x + np.array([0.0, 1e-3, -1e-3]), y)}}
    many = solve_many(some, moved)

    assert many.ok.all()
    for sample in range(3):
        motion = refkin.solve(replace(many.scene(sample), evidence=frozenset()))
        assert np.max(np.abs(many.q[:, sample] - motion.q)) < 2e-13 * max(1.0, np.max(np.abs(motion.q)))
        assert np.max(np.abs(many.qdd[:, sample] - motion.qdd)) < 1e-11 * max(1.0, np.max(np.abs(motion.qdd)))


def test_axes_and_radii_may_be_rows():
    gears = SCENES["gear train"]
    train = solve_many(gears, {"g1": {"radius_j": np.array([0.75, 0.8])}})
    slider = SCENES["slider-crank"]
    axis = {
        "guide": {"axis_i": (np.array([1.0, 3.0]), np.array([0.0, 0.3])), "angle": np.array([0.0, np.atan2(0.3, 3.0)])}
    }
    slide = solve_many(slider, axis)
    for many in (train, slide):
        for sample in range(2):
            motion = refkin.solve(replace(many.scene(sample), evidence=frozenset()))
            assert np.max(np.abs(many.q[:, sample] - motion.q)) < 1e-13


def test_laws_of_time_other_than_polynomials():
    wave = Sinusoid(amplitude=0.5, angular_frequency=3.0)
    some = bare(ROCKER.scene(law=wave, times=tuple(np.linspace(0.0, 2.0, 30).tolist())))
    lengths = np.array([[4.0, 4.1], [1.0, 1.05], [3.5, 3.4], [3.0, 3.1]])
    many = solve_many(some, geometry(lengths), estimates(lengths))
    _, _, coupler, _ = closed_form(lengths, wave(many.t)[None, :])

    assert many.ok.all()
    assert np.max(np.abs(np.exp(1j * many.q[5]) - np.exp(1j * coupler))) < 1e-13


def test_the_rate_of_a_law_may_hold_rows_of_frequencies():
    """One of them 0: there the rate is its offset and the sine of its phase."""
    rate = Sinusoid(amplitude=0.5, offset=0.25, angular_frequency=np.array([3.0, 0.0, -0.5]), phase=0.25)
    (driver,) = scene(9).mechanism.drivers
    some = replace(scene(9), mechanism=replace(scene(9).mechanism, drivers=(replace(driver, law=None, rate_law=LAW),)))
    lengths = grashof(3, margin=0.1)
    many = solve_many(some, {**geometry(lengths), "driver": {"rate_law": rate}}, estimates(lengths))
    each = [replace(rate, angular_frequency=w).integral(many.t) for w in rate.angular_frequency.tolist()]
    _, _, coupler, _ = closed_form(lengths, np.array(each))

    assert many.ok.all()
    assert np.max(np.abs(np.exp(1j * many.q[5]) - np.exp(1j * coupler))) < 1e-12


WRONG = {
    "a joint": ({"Z": {"point_j": (1.0, 0.0)}}, None, UnknownName, "'Z'"),
    "a key": ({"A": {"length": 1.0}}, None, UnknownName, "length"),
    "a name": ({"A": {"name": "B"}}, None, UnknownName, "name"),
    "a body": ({}, {"link": (0.0, 0.0, 0.0)}, UnknownName, "link"),
    "rows of two lengths": (
        {"A": {"point_j": (np.ones(3), 0.0)}, "B": {"point_j": (np.ones(4), 0.0)}},
        None,
        InvalidScene,
        r"\[3, 4\]",
    ),
    "a table": ({"A": {"point_j": (np.ones((3, 2)), 0.0)}}, None, InvalidScene, r"\(3, 2\)"),
    "an estimate of two": ({}, {"crank": (0.0, 1.0)}, InvalidScene, "estimates.crank"),
    "an estimate of one": ({}, {"crank": 1.0}, InvalidScene, "estimates.crank"),
    "an estimate of words": ({}, {"crank": "abc"}, InvalidScene, "estimates.crank"),
    "an estimate of two lengths": ({}, {"crank": (np.ones(3), np.ones(2), 0.0)}, InvalidScene, "estimates.crank"),
    "no mechanism": ({"A": {"point_j": (np.ones(0), 0.0)}}, None, InvalidScene, "at least one mechanism"),
    "no mapping": (None, None, InvalidScene, "geometry"),
    "no keys": ({"A": (1.0, 2.0)}, None, InvalidScene, "geometry.A"),
    "a point of three": ({"A": {"point_j": (-1.75, 0.0, 0.0)}}, None, InvalidScene, "geometry.A.point_j"),
    "points one by one": ({"A": {"point_j": np.ones((5, 2))}}, None, InvalidScene, "geometry.A.point_j"),
    "a point of one": ({"A": {"point_j": (-1.75,)}}, None, InvalidScene, "geometry.A.point_j"),
    "a number for a point": ({"A": {"point_j": -1.75}}, None, InvalidScene, "geometry.A.point_j"),
    "nothing for a point": ({"A": {"point_j": None}}, None, InvalidScene, "geometry.A.point_j"),
    "letters for a point": ({"A": {"point_j": "ab"}}, None, InvalidScene, "geometry.A.point_j"),
    "words in a row": ({"A": {"point_j": (["a", "b"], 0.0)}}, None, InvalidScene, "geometry.A.point_j"),
    "complex numbers": ({"A": {"point_j": (np.ones(2) * 1j, 0.0)}}, None, InvalidScene, "geometry.A.point_j"),
    "a number for all that is none": ({"A": {"point_j": (math.nan, 0.0)}}, None, InvalidScene, "a finite number"),
    "a number for a law": ({"driver": {"law": 2.0}}, None, InvalidScene, "geometry.driver.law"),
    "a law without numbers": ({"driver": {"law": Polynomial(coefficients=())}}, None, InvalidScene, "coefficients"),
    "a second law": ({"driver": {"rate_law": Polynomial(coefficients=(1.0,))}}, None, InvalidScene, "rate_law"),
    "a law that ends": (
        {"driver": {"law": Table(argument=(0.0, 0.1, 0.2), value=(0.0, 0.1, 0.2))}},
        None,
        InvalidScene,
        "a table from",
    ),
    "a law with rows that cannot be": (
        {"driver": {"law": Table(argument=(0.0, 4.0, 8.0), value=(0.0, 1.0, np.ones(3)))}},
        None,
        InvalidScene,
        "geometry.driver.law",
    ),
}


@pytest.mark.parametrize("what", WRONG)
def test_what_does_not_fit_the_scene_is_refused(what):
    given, first, error, message = WRONG[what]

    with pytest.raises(error, match=message):
        solve_many(scene(3), given, first)


FORBIDDEN = {
    "a length below 0": ("closed by a distance", "link", "length", -1.0),
    "a radius of 0": ("gear train", "g1", "radius_j", 0.0),
    "a radius that is no number": ("gear train", "g1", "radius_j", math.nan),
}


def with_a_distance():
    """The four-bar with a distance joint in place of its coupler."""
    some = scene(9)
    m = some.mechanism
    link = Distance(name="link", body_i="crank", point_i=(0.5, 0.0), body_j="rocker", point_j=(1.5, 0.0), length=3.5)
    bodies = tuple(b for b in m.bodies if b.name != "coupler")
    joints = tuple(j for j in m.joints if j.name in ("A0", "B0"))
    return replace(some, mechanism=Mechanism(bodies, (*joints, link), m.drivers))


@pytest.mark.parametrize("fault", FORBIDDEN)
def test_a_mechanism_that_no_scene_may_have_is_not_ok_and_changes_no_other(fault):
    name, joint, key, value = FORBIDDEN[fault]
    some = with_a_distance() if name == "closed by a distance" else SCENES[name]
    own = getattr(next(c for c in some.mechanism.constraints if c.name == joint), key)
    factors = np.array([1.0, 1.0, 1.01, 1.02])
    good = solve_many(some, {joint: {key: own * factors}})
    many = solve_many(some, {joint: {key: own * np.where(np.arange(4) == 1, value, factors)}})
    others = [0, 2, 3]

    assert good.ok.all()
    assert many.ok[others].all()
    assert not many.ok[1].any()
    assert np.array_equal(many.q[:, others], good.q[:, others])
    with pytest.raises(InvalidScene):
        many.scene(1)


@pytest.mark.parametrize("sample", [2, -1, 0.0, "0", None, True])
@pytest.mark.parametrize("asked", ["scene", "status"])
def test_a_mechanism_that_is_not_there_is_told(asked, sample):
    many = solve_many(scene(3), {"A": {"point_j": (-1.75 * np.ones(2), 0.0)}})

    with pytest.raises(InvalidRequest, match=re.escape(f"sample: expected a whole number from 0 to 1, got {sample!r}")):
        getattr(many, asked)(sample)


def test_rows_that_are_written_over_afterwards_change_no_mechanism():
    """The scene was that of a mechanism that nobody had solved."""
    row = -1.75 * np.ones(2)
    many = solve_many(scene(3), {"A": {"point_j": (row, 0.0)}})
    first = many.scene(1)
    row[:] = -1.5

    assert many.scene(1) == first


def test_a_scene_without_estimates_is_refused():
    with pytest.raises(InvalidScene, match="an estimate of its first pose"):
        solve_many(without_estimates(scene(3)), {"A": {"point_j": (-1.75 * np.ones(2), 0.0)}})


def test_redundant_rows_are_refused():
    some = scene(3)
    again = Revolute(name="again", body_i="ground", point_i=(0.0, 0.0), body_j="crank", point_j=(-0.5, 0.0))
    mechanism = replace(some.mechanism, joints=(*some.mechanism.joints, again))

    with pytest.raises(RefkinError, match="11 rows for 9 coordinates"):
        solve_many(replace(some, mechanism=mechanism), {})


# Planted faults.


def test_samples_that_jump_to_the_other_branch_are_noticed(monkeypatch):
    """Newton that leaves every seventh sample on the mirrored branch at one step."""
    lengths = grashof(70, margin=0.02)
    newton = block.Block._newton
    calls = []

    def jumping(self):
        doubtful = newton(self)
        calls.append(1)
        if len(calls) == 5:
            _, _, coupler, rocker = closed_form(lengths, np.full((70, 1), self.given[4][0][0]), sign=-1)
            for row, angle in zip(self.space.core(), (coupler, rocker), strict=True):
                row[::7] = angle[::7, 0]
        return doubtful

    monkeypatch.setattr(block.Block, "_newton", jumping)
    many = solved(lengths, samples=12)

    assert np.max(errors(many, lengths)[many.ok]) < 1e-12


@pytest.mark.parametrize("move", [1e-9, 0.1, 10.0])
def test_a_sample_goes_on_where_it_and_its_rates_are_near_the_prediction(move):
    """Off by a part of what it moved, within a limit, and rates by as much as that over the step; or by rounding."""
    limit = min(block.FARTHEST, max(block.PART * move, block.SMALL))
    off, guess, rates, h = limit * np.array([[0.99, -0.99, 1.01, -1.01, 0.99, 0.0, 0.0]]), np.zeros((1, 7)), 2.0, 0.5
    most = np.maximum(block.SMOOTH * np.abs(off), block.SMALL)
    bent = most / h * [[0.99, -0.99, 0.0, 0.0, 1.01, 0.99, 1.01]]
    history = [None, [off - move], (off, rates + bent, None)]
    going_on = block.Block._continues(SimpleNamespace(history=history, count=7), guess, rates, h)

    assert going_on.tolist() == [True, True, False, False, False, True, False]


def test_without_the_checks_of_the_branch_the_jump_is_answered(monkeypatch):
    everything = lambda self, *_: np.ones(self.count, bool)  # noqa: E731
    monkeypatch.setattr(block.Block, "_regular", everything)
    monkeypatch.setattr(block.Block, "_continues", everything)

    with pytest.raises(AssertionError):
        test_samples_that_jump_to_the_other_branch_are_noticed(monkeypatch)


def test_a_residual_above_round_off_is_not_ok():
    lengths = grashof(10, margin=0.02)
    off = "function(*args)\n    if segment == 'answer':\n        self.w[0, 3] += 1e-9"
    with mutated("refkin.fast.elimination.run:Workspace.run", "function(*args)", off):
        many = solved(lengths, samples=4)

    assert not many.ok[3].any()
    assert many.ok[np.arange(10) != 3].all()


# Certificates.


def proving(samples=20, **changes):
    return replace(scene(samples, **changes), evidence=frozenset({Evidence.CERTIFICATE}))


def test_radii_of_many_are_no_less_than_the_errors():
    """Against balls, in some samples: mechanisms of every size, each scaled by its own."""
    lengths = grashof(60, margin=0.02) * 2.0 ** np.arange(-30, 30)
    many = solve_many(proving(5), geometry(lengths), estimates(lengths, decimals=0))

    assert np.isfinite(many.radii).all()
    for sample in range(0, 60, 7):
        own = many.scene(sample)
        system = compile_system(own.mechanism, unit=own.mechanism.unit())
        for k, t in enumerate(many.t.tolist()):
            levels = [system.to_unit(x[:, sample, k], order) for order, x in enumerate((many.q, many.qd, many.qdd))]
            root = krawczyk(system, levels[0], t, 113)
            rate = root.velocity()
            off = (root.distance(levels[0]), root.distance(levels[1], rate))
            off = (*off, root.distance(levels[2], root.acceleration(rate)))
            assert all(np.max(o) <= r for o, r in zip(off, many.radii[:, sample, k], strict=True))


def test_radii_of_many_are_those_of_a_sweep():
    lengths = grashof(8, margin=0.05)
    many = solve_many(proving(), geometry(lengths), estimates(lengths))
    for sample in range(8):
        radius = sweep(many.scene(sample)).certified_radius
        for ours, theirs in zip(
            many.radii[:, sample], (radius.position, radius.velocity, radius.acceleration), strict=True
        ):
            assert np.all((0.25 * theirs < ours) & (ours < 4 * theirs))


@pytest.mark.parametrize("far", [0.0, 1e6])
def test_radii_of_many_far_from_their_origin_count_the_way_back(far):
    lengths = grashof(4, margin=0.1)
    ends, first = geometry(lengths), estimates(lengths)
    for name in ("A0", "B0"):
        ends[name]["point_i"] = (far + (lengths[0] if name == "B0" else 0.0 * lengths[0]), 0.0)
    away = np.array([[far], [0.0], [0.0]])
    many = solve_many(proving(3), ends, {body: rows + away for body, rows in first.items()})

    assert many.ok.all()
    assert np.all((many.radii[0] > 1e-12) == (far > 0.0))


def test_bad_samples_have_no_radius_and_spoil_no_other():
    lengths = grashof(50, margin=0.02)
    good = solve_many(proving(), geometry(lengths), estimates(lengths)).radii
    spoilt = lengths.copy()
    spoilt[1:3, 3::10] = 0.01
    many = solve_many(proving(), geometry(spoilt), estimates(lengths))
    bad = np.arange(50) % 10 == 3

    assert np.isnan(many.radii[:, bad]).all()
    assert np.array_equal(many.radii[:, ~bad], good[:, ~bad])


def test_radii_are_given_to_a_reducer_and_only_if_asked_for():
    lengths = grashof(20, margin=0.02)
    stored = solve_many(proving(6), geometry(lengths), estimates(lengths))
    many = solve_many(proving(6), geometry(lengths), estimates(lengths), reducer=lambda part: part.radii.copy())

    assert many.radii is None
    assert np.array_equal(np.stack(many.reduced, axis=2), stored.radii)
    assert solved(lengths, samples=6).radii is None


def test_where_there_is_no_proof_for_many_there_is_no_radius():
    """A table as law: its spline has no errors beside it."""
    law = Table(argument=(0.0, 1.0, 2.0, 4.0), value=(0.0, 1.0, 2.2, 4.1))
    some = replace(bare(ROCKER.scene(law=law, times=(0.0, 0.5, 1.0))), evidence=frozenset({Evidence.CERTIFICATE}))
    many = solve_many(some, {"B0": {"point_i": (np.array([4.0, 4.01]), 0.0)}})

    assert many.ok.all()
    assert np.isnan(many.radii).all()


def test_a_polynomial_of_rows_changes_by_no_more_than_its_taylor_terms():
    """By so much in the first sample, whose terms all have one sign; by less in the second."""
    law = Polynomial(coefficients=(np.array([0.2, 0.2]), np.array([1.0, -4.0]), np.array([0.5, 0.5]), 0.25))
    change = _change(law, 1.0, 0.5)
    moved = np.max(np.abs([law(t) - law(1.0) for t in np.linspace(0.5, 1.5, 9)]), axis=0)

    assert change[0] == pytest.approx(moved[0], rel=1e-14, abs=0.0)
    assert change[1] > moved[1]


def laws_of_rows():
    """A law of each kind with a row of 300 for each of its numbers."""
    rows = np.random.default_rng(3).uniform(-1.0, 1.0, (5, 300)) * [[4.0], [1.0], [3.0], [0.5], [1.0]]
    wave = Sinusoid(offset=rows[0], amplitude=rows[1], angular_frequency=rows[2], phase=rows[3])
    curve = Polynomial(coefficients=tuple(rows[:4] * [[1.0], [2.0], [1.0], [1.0]]))
    return wave, curve, Integral(rate=wave, initial=rows[4]), Integral(rate=curve, initial=rows[4])


@pytest.mark.parametrize("kind", range(4))
@pytest.mark.parametrize("squared", [False, True])
def test_no_law_of_rows_turns_back_or_passes_nothing_without_a_word(kind, squared):
    """As their values at many times say; over a hundredth of the time few are suspected."""
    law = laws_of_rows()[kind]
    pin = {"body_i": "ground", "point_i": (0.0, 0.0), "body_j": "b", "point_j": (0.0, 0.0)}
    driver = DistanceDriver(name="d", **pin, law=law) if squared else AngleDriver(name="d", body="b", law=law)
    for a, b, most in ((0.5, 1.5, 1.0), (-0.25, 0.0, 1.0), (0.75, 0.76, 0.05)):
        followed = [np.array([law(t, k) for t in np.linspace(a, b, 401)]) for k in ((0, 1) if squared else (1,))]
        turns = np.any([(np.sign(x) != np.sign(x[0])).any(axis=0) for x in followed], axis=0)
        suspected = may_turn((driver,), a, b, 300)

        assert not (turns & ~suspected).any()
        assert suspected.mean() <= min(most, 0.1 + 3 * turns.mean())


@pytest.mark.parametrize(("more", "times"), [((0.5, -1.0), [0.25]), ((0.5,), []), ((), [])])
def test_a_law_whose_offset_alone_holds_rows_turns_back_when_all_do(more, times):
    law = Polynomial(coefficients=(np.array([0.5, 2.0]), *more))

    assert common_extrema((AngleDriver(name="d", body="b", law=law),), 0.0, 1.0) == times


def test_a_distance_that_passes_nothing_in_one_mechanism_is_seen_there():
    """Its row depends on the square: 0.5 - t has a zero between 0 and 1, 2 - t has one between 0 and 3 only."""
    ends = {"body_i": "ground", "point_i": (0.0, 0.0), "body_j": "b", "point_j": (0.0, 0.0)}
    driver = DistanceDriver(name="d", **ends, law=Polynomial(coefficients=(np.array([0.5, 2.0, 5.0]), -1.0)))

    assert may_turn((driver,), 0.0, 1.0, 3).tolist() == [True, False, False]
    assert may_turn((driver,), 0.0, 3.0, 3).tolist() == [True, True, False]


def test_a_sample_whose_corrections_do_not_shrink_enough_is_not_answered_at_once():
    """Four samples: one contracts, one does not, one does not but is there already, one is dead."""
    late = np.zeros(4, bool)
    first = np.array([0.1, 0.1, SMALL / 2, 0.1])
    corrections = [first, CONTRACTION * first * np.array([0.9, 1.1, 1.1, 1.1])]
    block = SimpleNamespace(alive=np.array([True, True, True, False]), _iterate=lambda most: (corrections, late))

    assert Block._newton(block).tolist() == [False, True, False, False]


def test_profiles_of_many_cams_may_differ():
    """A knife edge over the pivot is as high as the profile, at the angle that the cam has turned under it."""
    profile = refkin.Polar(law=Sinusoid(amplitude=0.2, angular_frequency=2.0, offset=1.0))
    bodies = tuple(refkin.Body(name=name, estimate=(0.0, y, 0.0)) for name, y in (("cam", 0.0), ("edge", 1.0)))
    at = {"body_i": "ground", "point_i": (0.0, 0.0), "point_j": (0.0, 0.0)}
    joints = (
        Revolute(name="pivot", body_j="cam", **at),
        refkin.Prismatic(name="guide", body_j="edge", axis_i=(0.0, 1.0), **at),
        refkin.Cam(name="cam", **{**at, "body_i": "cam"}, body_j="edge", profile=profile, follower="point"),
    )
    driver = AngleDriver(name="motor", body="cam", law=Polynomial(coefficients=(0.0, 1.0)))
    scene = refkin.Scene(mechanism=Mechanism(bodies=bodies, joints=joints, drivers=(driver,)), times=(0.0, 0.3, 0.6))
    amplitudes = np.array([0.1, 0.2, 0.3])

    many = solve_many(scene, {"cam": {"profile": replace(profile, law=replace(profile.law, amplitude=amplitudes))}})

    assert many.ok.all()
    heights = 1.0 + amplitudes[:, None] * np.sin(2.0 * (math.pi / 2 - np.array(scene.times)))
    assert np.max(np.abs(many.q[4] - heights)) < 1e-15


@pytest.mark.parametrize(("evidence", "codes"), [((), [0, 1]), ((refkin.Evidence.CERTIFICATE,), [0, 0])])
@pytest.mark.parametrize("body", ["crank", "coupler"])
def test_where_numbers_have_no_digits_a_position_is_ok_only_if_it_is_proved(body, evidence, codes):
    """2e8 turns of the law, or of an estimate, round by 2e-7 rad, beyond what a pose is called singular by."""
    at, turns = 0.3, math.tau * np.array([0.0, 2e8])
    one = ROCKER.scene(law=Polynomial(coefficients=(at, 1.0)), times=(0.0,))
    one = replace(one, effects=frozenset(), evidence=frozenset(evidence))
    x, y, phi = next(b.estimate for b in one.mechanism.bodies if b.name == body)
    laws = {"driver": {"law": Polynomial(coefficients=(at + turns * (body == "crank"), 1.0))}}
    many = solve_many(one, laws, {body: (x, y, phi + turns)})

    assert many.codes.tolist() == [[code] for code in codes]
