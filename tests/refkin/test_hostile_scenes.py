"""Scenes that once were answered wrongly, or too late, without a word: each by every solver there is."""

from __future__ import annotations

import math
from dataclasses import dataclass, replace
from functools import partial
from importlib import import_module
from itertools import pairwise
from typing import Literal

import numpy as np
import pytest

import refkin
from refkin import AngleDriver, Body, Mechanism, Revolute, Scene, fast
from refkin.joints import Constraint, Distance, Prismatic
from refkin.motion import Status
from refkin.motion_laws import Polynomial, Sinusoid, Table
from refkin.proof.numbers.bounded import NoFormula
from refkin.proof.path.blocks import dips
from refkin.proof.pose import krawczyk
from refkin.solving import ahead, passages
from refkin.solving.sweep import Arrival, Sweep
from refkin.vec import cosine_and_sine
from tests.linkages import PARALLELOGRAM, ROCKER, remade, system_of, with_estimates, with_law, without_estimates
from tests.places import CORPUS, EXAMPLES

OK, LOST = refkin.Status.OK, refkin.Status.BRANCH_LOST


def scene(name, **changes):
    return replace(refkin.load(CORPUS / name), **changes)


def statuses(motion):
    return "".join("o" if status is OK else "." for status in motion.status)


def test_the_fast_sweep_goes_by_way_of_a_pulse_in_a_table():
    motion = fast.sweep(scene("fast-table-pulse.toml"))

    assert motion.status == (OK, LOST, LOST)


@pytest.mark.parametrize(
    ("name", "statuses"),
    [
        ("crank-over-a-gap.toml", (*[OK] * 6, *[LOST] * 3)),
        ("swings-beyond-count.toml", (OK, Status.NOT_CONVERGED)),
        ("pulse-in-the-last-digits.toml", (OK, Status.NOT_CONVERGED, Status.NOT_CONVERGED)),
    ],
)
def test_where_there_is_no_pose_between_two_times_nothing_is_ok_after_it(name, statuses):
    """All were: determinants are alike beyond a gap, a list of extrema was cut, and last digits were passed over."""
    hidden = scene(name)

    for solved in (refkin.solve, partial(refkin.solve, certified=True), fast.sweep):
        assert solved(hidden).status == statuses
    assert refkin.solve(replace(hidden, evidence=frozenset())).status == statuses


@pytest.mark.parametrize(
    ("times", "done"),
    [
        ((-1.0, 0.0, 0.5, 0.75, 1.0, 1.25, 1.5, 1.75), 4),
        ((1.0 - 2.0**-46, *(1.0 + k * 2.0**-52 for k in (-60, -40, -30, -20, 0, 20, 30, 40, 60)), 1.0 + 2.0**-46), 4),
    ],
    ids=["far apart", "each a few digits from the next"],
)
def test_what_is_hidden_next_to_one_of_many_times_is_not_leapt_over(times, done):
    """Planted: poses of many times at once went on beyond it; and a time rounded to the first one ended in an error."""
    hidden = scene("pulse-in-the-last-digits.toml")
    (driver,), flat = hidden.mechanism.drivers, hidden.mechanism.drivers[0].law.value[0]
    table = Table(
        argument=(-1.0, -0.5, *driver.law.argument, 1.5, 2.0), value=(*[flat] * 2, *driver.law.value, flat, flat)
    )
    law = table if times[0] < 0.0 else driver.law

    assert statuses(refkin.solve(replace(with_law(hidden, law), times=times))) == "o" * done + "." * (len(times) - done)


@pytest.mark.parametrize(("hidden", "left"), [([], 4), ([math.pi], 1)])
def test_poses_are_found_at_once_up_to_what_is_hidden_next_to_a_time(hidden, left, monkeypatch):
    """The law turns back at pi alone; only on both sides of that it is asked how far it goes there."""
    law = Sinusoid(amplitude=0.3, angular_frequency=1.0, offset=1.0, phase=-math.pi / 2)
    still = ROCKER.scene(law=law, times=(0.1, 1.0, math.pi, 4.0, 5.0))
    asked = []
    monkeypatch.setattr(ahead, "turning_points", lambda system, a, b: asked.append((a, b)) or ([], hidden))
    sweep = Sweep(system_of(still), [0.1], [np.zeros(9)])

    assert ahead._targets(sweep, still.times[1:])[0].tolist() == [*still.times[1:][:left]]
    assert set(asked) <= {(1.0, math.pi), (math.pi, 4.0)}


def test_a_four_bar_that_just_cannot_turn_is_never_driven_over_its_gap():
    """Its links are too long by 1e-7 to 1e-2 of the crank, and 3 to 30 steps lead over the gap."""
    rng = np.random.default_rng(7)
    for _ in range(60):
        ground, crank, rocker, over = rng.uniform(1.5, 4.0), rng.uniform(0.05, 0.9), *rng.uniform((0.6, 2), (4.0, 7))
        gap = crank * 10.0**-over
        linkage = refkin.FourBar(ground=ground, crank=crank, coupler=rocker + ground - crank + gap, rocker=rocker)
        ((low, high),) = linkage.input_range()
        start, turned = rng.uniform(low + 0.3, high - 0.3), math.copysign(rng.uniform(4.0, 6.2), rng.uniform(-1, 1))
        still = linkage.scene(law=Polynomial(coefficients=(start,)), times=np.linspace(0, 1, rng.integers(4, 31)))
        motion = refkin.solve(remade(with_law(still, Polynomial(coefficients=(start, turned))), evidence=frozenset()))
        passed = ~((low < start + turned * motion.t) & (start + turned * motion.t < high))

        assert OK not in np.array(motion.status)[np.argmax(passed) :] if passed.any() else motion.verdict is OK


def test_a_doubted_step_is_ok_where_smaller_ones_say_enough():
    """Of 12,535 mechanisms three, beside a gimbal, were lost: their steps were doubted, and not proved."""
    assert refkin.solve(scene("space-gimbal-doubted.toml")).verdict is OK


def test_a_step_that_was_leapt_to_another_branch_is_taken_again_in_smaller_ones():
    """Of 2,000 mechanisms of a night one was lost: over its gimbal all tests of the leap were passed."""
    assert refkin.solve(scene("space-gimbal-leapt.toml")).verdict is OK


@pytest.mark.parametrize(
    ("doubted", "off", "missing", "seen"),
    [
        (lambda t: [], 0.0, False, True),
        (lambda t: [0] if t[1] - t[0] > 0.01 else [], 0.0, False, True),
        (lambda t: [0], 0.0, False, False),
        (lambda t: [0, 1], 0.0, False, False),
        (lambda t: [], 1e-6, False, False),
        (lambda t: [], 0.0, True, False),
    ],
    ids=["at once", "nearer", "nowhere", "nowhere at all", "another branch", "no pose"],
)
def test_smaller_steps_say_enough_where_none_is_doubted_and_they_lead_to_the_end(
    doubted, off, missing, seen, monkeypatch
):
    """However many are doubted, it ends."""
    at = lambda t: np.array([t, 2.0 * t])  # noqa: E731
    marks = lambda system, t, q: np.isin(np.arange(2), doubted(t))  # noqa: E731
    monkeypatch.setattr(passages, "dips", marks)
    between = lambda system, q, t, later: None if missing else at(later) + off  # noqa: E731

    assert passages._seen_nearer(None, np.array([0.0, 1.0]), np.stack([at(0.0), at(1.0)], axis=1), between) is seen


def test_a_family_goes_by_way_of_a_pulse_in_a_table():
    many = fast.solve_many(scene("fast-table-pulse.toml", evidence=frozenset()), {"e1P": {"point_j": (np.zeros(3), 0)}})

    assert many.ok.tolist() == [[True, False, False]] * 3


@pytest.mark.parametrize(
    "law",
    [
        Sinusoid(amplitude=np.array([0.05, 0.2, 0.5]), angular_frequency=np.full(3, 44.0), offset=1.4559, phase=0.0),
        Sinusoid(amplitude=np.array([0.05, 0.2, 0.5]), angular_frequency=44.0, offset=1.4559, phase=0.0),
        Polynomial(coefficients=(1.4559, np.array([0.2, 0.8, 2.0]), np.array([-0.2, -0.8, -2.0]))),
    ],
    ids=["rows in the times of turning", "the same times in all", "polynomials"],
)
def test_mechanisms_of_a_family_are_lost_where_a_law_of_their_own_passes_the_limit(law):
    pulse = scene("fast-table-pulse.toml", evidence=frozenset())
    many = fast.solve_many(pulse, {"e0d": {"law": law}})

    assert many.ok[:, 1].tolist() == [True, False, False]
    assert [refkin.solve(many.scene(sample)).status[1] is OK for sample in range(3)] == [True, False, False]


def test_lengths_of_a_family_pass_zero_with_rows_and_without():
    lever = scene("distance-through-zero.toml", evidence=frozenset())
    slopes = np.array([-1.0, -0.4, -0.9])
    own = fast.solve_many(lever, {"cyl": {"law": Polynomial(coefficients=(0.5, slopes))}})
    common = fast.solve_many(lever, {"O": {"point_j": (np.zeros(2), 0.0)}})

    assert own.ok.tolist() == [[True, False], [True, True], [True, False]]
    assert common.ok.tolist() == [[True, False]] * 2


def test_the_fast_sweep_does_not_pass_a_limit_by_a_law_that_turns_a_rounding_beyond_it():
    motion = fast.sweep(scene("fast-limit-1e-17.toml"))

    assert statuses(motion) == "ooooooo..."


def test_times_a_denormal_number_apart_are_times_like_others():
    hardly_apart = scene("fast-denormal-times.toml")
    motion = fast.sweep(hardly_apart)

    assert motion.producer.name == "refkin.fast"
    assert statuses(motion) == statuses(refkin.solve(hardly_apart)) == "oooo"
    assert motion["crank"].phi == pytest.approx([0.3, 0.3, 0.3, 1.3], abs=1e-15)


EITHER_WAY = pytest.mark.parametrize("certified", [False, True], ids=["as it is", "certified"])
EVERY_WAY = pytest.mark.parametrize(
    "solver", [refkin.solve, partial(refkin.solve, certified=True), fast.sweep], ids=["solve", "certified", "fast"]
)


@EVERY_WAY
@pytest.mark.parametrize("of", ["", "space-"])
def test_a_cylinder_of_length_zero_is_a_pose_that_no_step_goes_over(of, solver):
    motion = solver(scene(f"{of}distance-through-zero.toml"))

    assert motion.status == (OK, LOST)
    assert "t = 0.5" in motion.message


@pytest.mark.parametrize("turns", [1640.0, 1.0, 2.005])
def test_whole_turns_in_space_are_no_short_step(turns):
    whole = scene("space-whole-turns-between-times.toml", evidence=frozenset())
    (driver,) = whole.mechanism.drivers
    law = replace(driver.law, coefficients=(driver.law.coefficients[0], 2.0 * np.pi * turns / 5.0))
    turned = with_law(whole, law)
    often = replace(turned, times=tuple(np.linspace(0.0, 5.0 * 10, 11)))  # steps of a batch are tested by themselves

    assert refkin.solve(turned).status == fast.sweep(turned).status == (OK, LOST)
    assert refkin.solve(often).status[1] is not OK


def test_a_distance_of_space_reaches_as_far_as_its_law_is_large_whatever_its_sign():
    lever = scene("space-distance-through-zero.toml")
    motion = refkin.solve(with_law(lever, Polynomial(coefficients=(-0.5,))))

    assert motion.status == (OK, OK)


def test_a_law_that_turns_back_often_before_the_first_of_many_times_is_gone_along():
    pulse = scene("fast-table-pulse.toml")
    swing = Sinusoid(amplitude=0.01, angular_frequency=700.0, offset=1.4559, phase=0.0)
    motion = refkin.solve(replace(with_law(pulse, swing), times=(0.0, *np.linspace(0.9, 1.0, 9))))

    assert set(motion.status) == {OK}


@EITHER_WAY
def test_a_swing_faster_than_any_sampling_is_lost_at_the_limit(certified):
    motion = refkin.solve(scene("rate-law-alias.toml"), certified=certified)

    assert motion.status == (OK, LOST, LOST, LOST)


@EITHER_WAY
def test_a_law_that_turns_a_rounding_beyond_the_flat_pose_is_lost_there(certified):
    motion = refkin.solve(scene("limit-touched-1e-17.toml"), certified=certified)

    assert statuses(motion) == "o" * 14 + "." * 14
    assert "at t = 1, where a law turns back, no pose of the branch is proved to be alone" in motion.message


@pytest.mark.parametrize(
    ("name", "answered"),
    [
        ("cam-bump-between-times.toml", 3),
        ("laws-turn-back-together.toml", 3),
        ("limit-touched-by-another-loop.toml", 1),
        ("fast-limit-touched-by-another-loop.toml", 1),
    ],
)
def test_what_turns_back_between_times_though_no_law_does_is_lost_at_the_limit(name, answered):
    """The bump of a cam's profile, the sum of two angles, and a loop that another moves to its limit and back."""
    motion = refkin.solve(scene(name))

    assert motion.status == (OK,) * answered + (LOST,) * (len(motion.status) - answered)
    assert "it is not proved on which branch the motion goes on" in motion.message
    assert fast.attempt(scene(name)) is None


def short_of_its_limit(by, *more):
    touching = scene("fast-limit-touched-by-another-loop.toml")
    gear = next(j for j in touching.mechanism.joints if j.type == "gear")
    joints = [replace(j, phi0_j=j.phi0_j - by) if j is gear else j for j in touching.mechanism.joints]
    return remade(touching, joints=(*joints, *more), evidence=frozenset())


@pytest.mark.parametrize("redundant", [False, True], ids=["rows as many as coordinates", "a pin that is there twice"])
@pytest.mark.parametrize("solver", [refkin.solve, fast.attempt])
def test_a_loop_that_another_moves_to_and_fro_is_answered_short_of_its_limit_alone(solver, redundant):
    pin, *_ = short_of_its_limit(0.0).mechanism.joints
    more = (replace(pin, name="again"),) if redundant else ()
    clear, touching = (solver(short_of_its_limit(by, *more)) for by in (0.01, 0.0))

    assert clear.verdict is OK
    assert touching is None or touching.verdict is LOST


@pytest.mark.parametrize("speed", [1e-3, 1.0, 1e3])
def test_what_another_loop_moves_near_its_limit_and_back_is_doubted_however_fast_it_goes(speed):
    clear = short_of_its_limit(0.001)
    motion = refkin.solve(replace(clear, times=tuple(np.linspace(*np.array(clear.times)[[0, -1]], 8))))
    (driver,) = clear.mechanism.drivers
    start, rate = driver.law.coefficients
    law = replace(driver.law, coefficients=(start, rate * speed))
    system = system_of(with_law(clear, law))

    # The second step leaves the limit, and in the third another loop's determinant falls as steeply as to zero.
    assert np.flatnonzero(dips(system, motion.t / speed, system.to_unit(motion.q))).tolist() == [0, 1, 2]


def test_a_table_that_begins_and_ends_with_a_step_hides_no_loop_that_is_moved_to_its_limit_and_back_there():
    """Rates at the last pose were asked for after it, where the table has none: no step that ends there was doubted."""
    clear = short_of_its_limit(0.001)
    motion = refkin.solve(replace(clear, times=tuple(np.linspace(*np.array(clear.times)[[0, -1]], 8))))
    (driver,) = clear.mechanism.drivers
    knots = np.linspace(*motion.t[:2], 5)
    table = Table(argument=tuple(knots.tolist()), value=tuple(driver.law(knots).tolist()))
    system = system_of(with_law(replace(clear, times=tuple(motion.t[:2])), table))

    assert dips(system, motion.t[:2], system.to_unit(motion.q[:, :2])).tolist() == [True]


def test_what_turns_back_between_times_and_reaches_no_limit_is_answered():
    within = scene("laws-turn-back-together.toml")
    one, two = within.mechanism.drivers
    less = replace(two, law=replace(two.law, coefficients=(two.law.coefficients[0] - 0.3, two.law.coefficients[1])))
    within = remade(without_estimates(within), drivers=(one, less))

    assert refkin.solve(within).verdict is fast.attempt(within).verdict is OK


def test_a_law_that_turns_just_before_the_flat_pose_is_not_lost():
    touched = scene("limit-touched-1e-17.toml")
    (driver,) = touched.mechanism.drivers
    first, *rest = driver.law.coefficients
    before = replace(driver, law=replace(driver.law, coefficients=(first + 1e-9, *rest)))
    motion = refkin.solve(remade(touched, drivers=(before,)))

    assert motion.verdict is OK


@EITHER_WAY
def test_where_t_has_no_digits_left_no_singular_pose_is_blamed(certified):
    motion = refkin.solve(scene("time-resolution.toml"), certified=certified)

    assert motion.status == (OK, refkin.Status.NOT_CONVERGED, refkin.Status.NOT_CONVERGED)
    assert "t has no more digits" in motion.message


def test_where_a_law_turns_back_and_t_has_no_digits_left_the_branch_is_not_blamed():
    t = (2.308e-4, 2.236e-4, 3.707e-4, 5.307e-4, 9.414e-4, 9.344e-4)
    first, *argument, last = (1e9 + after for after in t)
    law = Table(argument=tuple(argument), value=(-3.0225165, -2.8989689, -2.5734628, -2.7694688))
    motion = refkin.solve(ROCKER.scene(law=law, times=(first, last)))

    assert motion.status == (OK, refkin.Status.NOT_CONVERGED)
    assert "t has no more digits" in motion.message


@pytest.mark.parametrize("law", [(0.3, 1e16), (2e17, -1e17, 0.5)])
@pytest.mark.parametrize("evidence", [frozenset(), frozenset(refkin.Evidence)], ids=["unproved", "proved"])
def test_an_angle_without_digits_is_no_answer_and_no_singular_pose(law, evidence):
    far = replace(ROCKER.scene(law=Polynomial(coefficients=law), times=(1.0,)), evidence=evidence)

    assert refkin.solve(far).verdict is refkin.Status.NOT_CONVERGED
    assert fast.attempt(far) is None


def test_a_step_that_passed_every_test_and_is_not_proved_is_tried_once(monkeypatch):
    together = scene("laws-turn-back-together.toml")
    often = replace(together, times=tuple(np.linspace(*np.array(together.times)[[0, 2]], 12)))
    asked = []
    monkeypatch.setattr(
        "refkin.solving.sweep.first_unproved", lambda _, t, q, between, steps: asked.append(1) or steps[3]
    )

    assert refkin.solve(often).verdict is LOST
    assert asked == [1]


def test_a_way_of_too_many_steps_is_given_up_once(monkeypatch):
    """20,000 steps of gears of space take a minute."""
    given_up = []
    in_steps = Sweep._in_steps

    def counted(sweep, target, most):
        arrival = in_steps(sweep, target, most)
        given_up.extend([1] if arrival is Arrival.OUT_OF_STEPS else [])
        return arrival

    monkeypatch.setattr(Sweep, "_in_steps", counted)
    monkeypatch.setattr("refkin.solving.sweep.MOST_STEPS", 50)
    turning = with_law(refkin.load(EXAMPLES / "rssr.toml"), Polynomial(coefficients=(0.3, 1e3)))
    motion = refkin.solve(replace(turning, times=tuple(np.linspace(0.0, 1.0, 12))))

    assert "after 50 steps" in motion.message
    assert given_up == [1]


def test_steps_that_lead_to_no_time_before_the_branch_ends_are_not_proved(monkeypatch):
    """From the only time that is reached they lead to the limit."""
    monkeypatch.setattr("refkin.solving.sweep.first_unproved", lambda *_: pytest.fail("proved"))
    motion = refkin.solve(scene("fast-table-pulse.toml"), certified=True)

    assert motion.status == (OK, LOST, LOST)
    assert "the branch ends or meets another at a singular pose" in motion.message


@pytest.mark.parametrize("solver", [refkin.solve, fast.sweep], ids=["solve", "fast"])
@pytest.mark.parametrize(
    ("name", "velocity"),
    [("unassemblable-but-assembled.toml", False), ("unassemblable-acceleration-only.toml", True)],
    ids=["in velocity", "in acceleration"],
)
def test_rows_that_contradict_each_other_in_a_rate_lock_a_pose_that_exists(solver, name, velocity):
    motion = solver(scene(name))

    assert motion.verdict is refkin.Status.LOCKED
    radius = motion.certified_radius
    levels = ((motion.q, radius.position, True), (motion.qd, radius.velocity, velocity))
    for numbers, radii, exist in (*levels, (motion.qdd, radius.acceleration, False)):
        assert np.isfinite(numbers).all() == exist == np.isfinite(radii).all()
        assert np.isnan(numbers).all() != exist
    assert f"contradict each other in {'acceleration' if velocity else 'velocity'}" in motion.message


@pytest.mark.parametrize("solver", [refkin.solve, fast.sweep], ids=["solve", "fast"])
@pytest.mark.parametrize(
    ("name", "position", "acceleration"),
    [("redundant-one-ulp.toml", 3e-13, 6e-7), ("redundant-16-ulp.toml", 4e-11, 1e-2)],
)
def test_radii_hold_for_every_choice_of_redundant_rows(solver, name, position, acceleration):
    motion = solver(scene(name))

    assert motion.verdict is OK
    assert motion.certified_radius.position[0] > position
    assert motion.certified_radius.acceleration[0] > acceleration


@pytest.mark.parametrize(("most", "looser"), [(20_000, 1.0), (3, 120.0)], ids=["compared", "by norms"])
def test_where_choices_are_too_many_to_certify_the_radii_hold_for_those_that_serve_as_well(monkeypatch, most, looser):
    """Those of all of them are 3.4e-13 and 6.7e-7."""
    monkeypatch.setattr("refkin.proof.pose.choices.MOST_CHOICES", 3)
    monkeypatch.setattr("refkin.proof.pose.choices.MOST_COMBINATIONS", most)
    motion = refkin.solve(scene("redundant-one-ulp.toml"))

    assert motion.verdict is OK
    assert 2.7e-13 < motion.certified_radius.position[0] < 2.9e-13 * looser
    assert 5.5e-7 < motion.certified_radius.acceleration[0] < 5.7e-7 * looser
    assert "more than 3 ways: the bounds cover inverses of a Frobenius norm up to 3 /" in motion.message


def test_too_many_choices_of_redundant_rows_far_from_each_other_have_no_radius_and_say_so(monkeypatch):
    monkeypatch.setattr("refkin.proof.pose.choices.MOST_CHOICES", 3)
    monkeypatch.setattr("refkin.proof.pose.choices.CLOSE", 0.0)
    motion = refkin.solve(scene("redundant-one-ulp.toml"))

    assert motion.verdict is OK
    assert np.isnan(motion.certified_radius.position).all()
    assert "more than 3 ways: no error bound covers all of them" in motion.message


@EVERY_WAY
def test_an_open_profile_is_not_taken_to_be_the_same_in_every_turn(solver):
    """It rises in the 33rd turn alone, by more than the link reaches: that turn was passed over, and all called ok."""
    angles = np.arange(-10.0, 400.0, 2.0)
    heights = np.where((angles >= 200.0) & (angles <= 220.0), 1.3, 1.0)
    profile = refkin.Polar(law=refkin.Table(argument=tuple(angles.tolist()), value=tuple(heights.tolist())))
    rod = {"body_j": "rod", "point_j": (0.0, 0.0)}
    joints = (
        refkin.Revolute(name="O", body_i="ground", point_i=(0.0, 0.0), body_j="cam", point_j=(0.0, 0.0)),
        refkin.Prismatic(name="guide", body_i="ground", point_i=(0.0, 0.0), axis_i=(0.0, 1.0), **rod),
        refkin.Cam(
            name="contact",
            body_i="cam",
            point_i=(0.0, 0.0),
            profile=profile,
            follower="point",
            contact_estimate=math.pi / 2,
            **rod,
        ),
        refkin.Revolute(name="R", body_i="ground", point_i=(1.0, 0.0), body_j="rocker", point_j=(0.0, 0.0)),
        refkin.Distance(name="link", body_i="rocker", point_i=(1.0, 0.0), length=0.45907719124109403, **rod),
    )
    bodies = (
        refkin.Body(name="cam", estimate=(0.0, 0.0, 0.0)),
        refkin.Body(name="rod", estimate=(0.0, 1.0, 0.0)),
        refkin.Body(name="rocker", estimate=(1.0, 0.0, 2.1895573800486186)),
    )
    motor = refkin.AngleDriver(name="motor", body="cam", law=refkin.Polynomial(coefficients=(0.0, -1.0)))
    mechanism = refkin.Mechanism(bodies=bodies, joints=joints, drivers=(motor,))

    motion = solver(refkin.Scene(mechanism=mechanism, times=(0.0, 60.0 * math.tau)))
    assert motion.status[0] is OK
    assert motion.status[1] is not OK


def power(x, n):
    return x if n == 1 else power(x * x, n // 2) if n % 2 == 0 else x * power(x, n - 1)


def hump(x):
    """Return sin(x)^40 and its derivatives."""
    c, s = cosine_and_sine(x)
    bend = power(s, 38) * (c * c) * (40 * 39) - power(s, 40) * 40
    return power(s, 40), power(s, 39) * c * 40, bend


@dataclass(frozen=True, kw_only=True)
class Hump(Constraint):
    """phi_j = 1 + sin(phi_i / 120)^40, which no element states: body j is at rest but about one turn of body i."""

    rows = 1
    body_i: str
    body_j: str
    type: Literal["hump"] = "hump"

    def constants(self, unit):
        return (1.0 / 120.0,)

    @staticmethod
    def residual(g, f, i, j):
        return (j.phi - hump(i.phi * g[0])[0] - 1.0,)

    @staticmethod
    def jacobian(g, f, i, j):
        return ((0, 0, -hump(i.phi * g[0])[1] * g[0]),), ((0, 0, 1),)

    @staticmethod
    def gamma(g, f, i, j):
        return (hump(i.phi * g[0])[2] * (g[0] * g[0]) * (i.omega * i.omega),)


@EVERY_WAY
def test_a_joint_of_ones_own_is_not_taken_to_say_the_same_in_every_turn(solver):
    """Its crank goes to 2 rad, beyond its limit, in one of 60 turns: that was passed over, and all called ok."""
    crank = refkin.FourBar(ground=2.0, crank=1.5, coupler=1.2, rocker=1.4)
    m = crank.scene(law=Polynomial(coefficients=(1.0,)), times=(0.0,), branch="open").mechanism
    wheel = Body(name="wheel", estimate=(0.0, 0.0, 0.0))
    pin = Revolute(name="axle", body_i="ground", point_i=(0.0, 0.0), body_j="wheel", point_j=(0.0, 0.0))
    joints = (*m.joints, pin, Hump(name="hump", body_i="wheel", body_j=m.bodies[0].name))
    motor = AngleDriver(name="motor", body="wheel", law=Polynomial(coefficients=(0.0, 1.0)))
    mechanism = Mechanism(bodies=(*m.bodies, wheel), joints=joints, drivers=(motor,))

    motion = solver(Scene(mechanism=mechanism, times=(0.0, 60.0 * math.tau)))
    assert (motion.status[0], motion.status[1] is OK) == (OK, False)


def test_what_a_scene_calls_for_may_be_a_set_or_a_list():
    """A set ended in a TypeError of hashes, deep in the certificate."""
    four = ROCKER.scene(samples=3)
    for kind in (set, list):
        asked = replace(four, effects=kind(four.effects), evidence=kind(four.evidence))
        assert (asked, refkin.solve(asked).verdict) == (four, OK)


SMALL_LOOPS = [
    (0.0002283203333420593, 1.540633083265168, 1.6068197442891348, 0.9995755780405677, (0.0, 1.0)),
    (0.0005034285441026853, 1.5271845017882777, 1.6102086060713974, 0.9993554909665562, (0.0, 1.0)),
    (0.0007595629963331041, 1.5217963267948966, 1.6184366359950144, 0.9989600207346894, (0.0, 1.0)),
    (0.00019275405065786376, 1.548506592891429, 1.5961983494352705, 0.9997421893043535, (0.0, 1.0)),
    (0.0005288822144204536, 1.5359413217805797, 1.6157575035639569, 0.9993602472611117, (0.0, 1.0)),
    (0.0004076491025198057, 1.5338740602497982, 1.6105031936466832, 0.9995627904712945, (0.0, 0.9399879068391092, 1.0)),
]


@EVERY_WAY
@pytest.mark.parametrize(("link", "start", "end", "height", "times"), SMALL_LOOPS)
def test_a_small_loop_does_not_leap_over_a_gap_in_the_first_step_of_a_large_crank(
    solver, link, start, end, height, times
):
    """Half way the link of a millimetre is too short for its slider by a third: Newton's second correction was small
    against the first, which is that of a crank of a metre.
    """
    off = (math.sin(start) - height) / link
    at = {"body_i": "ground", "body_j": "wheel", "point_j": (0.0, 0.0)}
    slider = (math.cos(start) + link * math.sqrt(1.0 - off * off), height, 0.0)
    joints = (
        Revolute(name="O", point_i=(0.0, 0.0), **at),
        Distance(name="l", body_i="wheel", point_i=(1.0, 0.0), body_j="s", point_j=(0.0, 0.0), length=link),
        Prismatic(name="g", body_i="ground", point_i=(0.0, height), axis_i=(1.0, 0.0), body_j="s", point_j=(0.0, 0.0)),
    )
    bodies = (Body(name="wheel", estimate=(0.0, 0.0, start)), Body(name="s", estimate=slider))
    motor = AngleDriver(name="m", body="wheel", law=Polynomial(coefficients=(start, end - start)))

    assert max((math.sin(x) - height) / link for x in np.linspace(start, end, 99)) > 1.02
    assert solver(Scene(mechanism=Mechanism(bodies, joints, (motor,)), times=times)).status[-1] is not OK


@pytest.mark.parametrize(
    ("slack", "start", "turned"),
    [
        (1.3150089764261557e-14, 3.1415926553995, -3.385824551922331e-05),
        (1.2280054059132791e-14, 3.141592653589878, -1.273539720266815e-05),
    ],
)
def test_beside_a_change_point_the_noise_of_corrections_tells_of_no_small_loop(slack, start, turned):
    """They stay at 1e-10 there, however short a first step is: a motion that is proved was lost."""
    linkage = refkin.FourBar(ground=3.0, crank=1.0, coupler=3.0, rocker=1.0 + slack)
    law = Polynomial(coefficients=(start, turned))

    assert refkin.solve(linkage.scene(law=law, times=(0.0, 1.0), branch="crossed")).verdict is OK


@dataclass(frozen=True, kw_only=True)
class Quotient(Constraint):
    """phi_j = 1 / (3 + phi_i)."""

    rows = 1
    body_i: str
    body_j: str
    type: Literal["quotient"] = "quotient"

    def constants(self, unit):
        return ()

    @staticmethod
    def residual(g, f, i, j):
        return (j.phi - 1.0 / (i.phi + 3.0),)

    @staticmethod
    def jacobian(g, f, i, j):
        return ((0, 0, 1.0 / ((i.phi + 3.0) * (i.phi + 3.0))),), ((0, 0, 1),)

    @staticmethod
    def gamma(g, f, i, j):
        return (2.0 / ((i.phi + 3.0) * (i.phi + 3.0) * (i.phi + 3.0)) * (i.omega * i.omega),)


@EVERY_WAY
def test_a_joint_of_ones_own_that_divides_is_told_what_formulas_may_do(solver):
    """It ended in a KeyError of 'div', or in a TypeError of numbers that carry bounds."""
    wheels = [Body(name=name, estimate=(0.0, 0.0, angle)) for name, angle in (("a", 0.0), ("b", 0.3))]
    at = {"body_i": "ground", "point_i": (0.0, 0.0), "point_j": (0.0, 0.0)}
    axles = [Revolute(name=f"axle {body.name}", **at, body_j=body.name) for body in wheels]
    motor = AngleDriver(name="motor", body="a", law=Polynomial(coefficients=(0.0, 1.0)))
    joints = (*axles, Quotient(name="own", body_i="a", body_j="b"))
    mechanism = Mechanism(bodies=tuple(wheels), joints=joints, drivers=(motor,))

    with pytest.raises(NoFormula, match="formulas of joints add, subtract, multiply, and take sines and cosines"):
        solver(Scene(mechanism=mechanism, times=(0.0, 0.5)))


STRETCHED = math.acos((1.5**2 + 2.0**2 - (1.2 + 1.4) ** 2) / (2.0 * 1.5 * 2.0))
"""The crank's angle at which coupler and rocker of the linkage above lie in one line."""


def turned_by(law, times):
    return refkin.FourBar(ground=2.0, crank=1.5, coupler=1.2, rocker=1.4).scene(law=law, times=times, branch="open")


def between_digits(begin):
    """Return a table that goes 1.8e-4 rad beyond the limit between two floats, never at one, 12 times; from a place."""
    first, digit = 2.0**20, math.ulp(2.0**20)
    low = STRETCHED - 0.3 + 0.5 * 0.3 * (math.pi / 64.0) ** 2 / 2.0
    places = range(0, 65, 4)
    values = [low + 0.3 * math.cos(math.tau * (k - 32.5) / 64.0) for k in places]
    at = tuple(first + k * digit for k in places)
    law = Table(argument=at, value=(*values[:-1], values[0]), periodic=True)
    return turned_by(law, (first + begin * digit, first + (begin + 12 * 64) * digit))


def above_a_last_digit():
    """Return a parabola with its top half a digit after 1, 0.02 rad beyond the limit, and 0.005 short of it at both."""
    at = (-8.0, -4.0, 4.0, 8.0, 12.0)
    values = tuple(STRETCHED + 0.1 * (0.2 - (k - 0.5) ** 2) for k in at)
    law = Table(argument=tuple(1.0 + k * math.ulp(1.0) for k in at), value=values)
    return turned_by(law, (1.0, 1.0 + math.ulp(1.0)))


def beside_a_last_digit():
    """Return a pulse one float before the last time, 7.5e-13 rad beyond the limit."""
    digit = 2.0**-53
    at = tuple(1.0 + k * digit * (1 if k <= 0 else 2) for k in range(-40, 41))
    values = tuple(STRETCHED - 2e-13 + (9.5e-13 if k == -2 else 0.0) for k in range(-40, 41))
    return turned_by(Table(argument=at, value=values), (1.0 - 30 * digit, 1.0))


@EVERY_WAY
@pytest.mark.parametrize(
    "of", [partial(between_digits, 0), partial(between_digits, 16), above_a_last_digit, beside_a_last_digit]
)
def test_what_a_law_does_between_two_floats_is_not_called_ok(of, solver):
    motion = solver(of())

    assert (motion.status[0], motion.status[1] is OK) == (OK, False)


@pytest.mark.parametrize("solver", [refkin.solve, fast.sweep], ids=["solve", "fast"])
def test_a_pose_that_is_half_of_all_numbers_away_ends_in_a_status(solver):
    """The mean of two such poses was none."""
    sliding = refkin.load(CORPUS.parents[1] / "examples" / "slider-crank.toml")

    assert solver(with_law(sliding, Polynomial(coefficients=(1e308, 1.0)))).verdict is not OK


def test_a_long_step_over_a_cam_is_proved_by_way_of_the_poses_that_led_there(monkeypatch):
    """From its two ends 226 poses in between are looked for, each by a sweep of its own."""
    looked_for, place = [], import_module("refkin.fast.sweep")
    between = place.pose_between
    monkeypatch.setattr(place, "pose_between", lambda *at: looked_for.append(at) or between(*at))
    profile = refkin.Polar(law=Sinusoid(amplitude=0.05, angular_frequency=3.0, offset=1.0))
    at = {"point_i": (0.0, 0.0), "body_j": "follower", "point_j": (0.0, 0.0)}
    joints = (
        Revolute(name="pivot", body_i="ground", **{**at, "body_j": "disc"}),
        refkin.Cam(name="cam", body_i="disc", profile=profile, follower="point", **at),
        refkin.Prismatic(name="slide", body_i="ground", axis_i=(0.0, 1.0), **at),
    )
    motor = AngleDriver(name="motor", body="disc", law=Sinusoid(amplitude=1.5, angular_frequency=20.0))
    bodies = (Body(name="disc", estimate=(0.0, 0.0, 0.0)), Body(name="follower", estimate=(0.0, 0.95, 0.0)))
    motion = fast.attempt(Scene(mechanism=Mechanism(bodies, joints, (motor,)), times=(0.0, 3.0)))

    assert motion.verdict is OK
    assert len(looked_for) < 160


@pytest.mark.parametrize("certified", [False, True])
def test_a_swing_within_its_range_is_gone_through_once_however_often_it_is_made(monkeypatch, certified):
    monkeypatch.setattr("refkin.solving.sweep.MOST_STEPS", 200)
    motion = refkin.solve(scene("slow-sinusoid.toml"), certified=certified)
    (driver,) = scene("slow-sinusoid.toml").mechanism.drivers

    assert motion.verdict is OK
    assert motion["crank"].phi == pytest.approx([driver.law(t) for t in motion.t], abs=1e-12)
    once = refkin.solve(scene("slow-sinusoid.toml", times=(0.0, 1e-5)))  # the same branch, by plain steps
    assert np.sign(np.sin(motion["rocker"].phi - motion["coupler"].phi)) == pytest.approx(
        np.sign(np.sin(once["rocker"].phi[0] - once["coupler"].phi[0])) * np.ones(3)
    )


@pytest.mark.parametrize("certified", [False, True])
def test_turns_of_a_wheel_are_counted_without_going_through_them(monkeypatch, certified):
    """The same times as 556 turns each, and, with a larger wheel, as less than a turn: the same poses of the loop."""
    monkeypatch.setattr("refkin.solving.sweep.MOST_STEPS", 800)
    motion = refkin.solve(scene("slow-gear.toml"), certified=certified)
    phi, coupler, rocker = (motion[name].phi for name in ("w2", "co", "ro"))

    assert motion.verdict is OK
    assert phi[-1] - phi[0] > 2 * np.pi * 6000
    gap_x = 0.5 * np.cos(phi) + 3.0 + 2.0 * np.cos(coupler) - 5.5 - 1.8 * np.cos(rocker)
    gap_y = 0.5 * np.sin(phi) + 2.0 * np.sin(coupler) - 0.2 - 1.8 * np.sin(rocker)
    assert np.max(np.abs([gap_x, gap_y])) < 1e-11
    assert len(set(np.sign(np.sin(rocker - coupler)))) == 1
    assert np.ptp(rocker) < 2 * np.pi > np.ptp(coupler)


@pytest.mark.parametrize("certified", [False, True])
def test_wheels_without_a_loop_have_one_pose_at_each_time_however_far_they_turn(certified):
    """Five of them, each a hundred times as fast as the one before: sigma_min is 1e-8, and nothing is singular."""
    names, ground = [f"wheel{k}" for k in range(5)], {"body_i": "ground"}
    pins = [
        refkin.Revolute(name=f"pin of {name}", **ground, point_i=(3.0 * k, 0.0), body_j=name, point_j=(0.3, 0.0))
        for k, name in enumerate(names)
    ]
    gears = [
        refkin.Gear(name=f"{slow} {fast}", body_i=slow, radius_i=100.0, body_j=fast, radius_j=-1.0)
        for slow, fast in pairwise(names)
    ]
    motor = AngleDriver(name="motor", body="wheel0", law=Polynomial(coefficients=(0.0, 1.0)))
    wheels = [Body(name=name, estimate=(3.0 * k - 0.3, 0.0, 0.0)) for k, name in enumerate(names)]
    motion = refkin.solve(
        Scene(mechanism=Mechanism(wheels, [*pins, *gears], [motor]), times=(0.0, 0.5, 1.0)), certified=certified
    )

    assert motion.verdict is OK
    assert motion["wheel4"].phi == pytest.approx(1e8 * motion.t, rel=1e-15)
    assert motion["wheel4"].x == pytest.approx(12.0 - 0.3 * np.cos(motion["wheel4"].phi), abs=1e-14)
    assert motion["wheel4"].yd == pytest.approx(-0.3e8 * np.cos(motion["wheel4"].phi), abs=1e-6)


def test_a_coupler_that_turns_with_the_crank_is_wound_as_often(monkeypatch):
    """A drag link: all moving links turn fully, 5000 times; after whole turns the rocker has made as many."""
    monkeypatch.setattr("refkin.solving.sweep.MOST_STEPS", 800)
    linkage = refkin.FourBar(ground=1.0, crank=3.0, coupler=2.7, rocker=3.5)
    law = Polynomial(coefficients=(0.3, 2 * np.pi * 5000))
    motion = refkin.solve(linkage.scene(law=law, times=(0.0, 0.001, 1.0)))

    assert motion.verdict is OK
    assert motion["rocker"].phi[-1] - motion["rocker"].phi[0] == pytest.approx(2 * np.pi * 5000, abs=1e-9)
    assert motion["crank"].phi[-1] == pytest.approx(0.3 + 2 * np.pi * 5000, abs=1e-9)


@pytest.mark.parametrize("turns", [0, 1, 500])
def test_branches_that_never_cross_are_no_bifurcation_at_any_turn(turns):
    start = scene("follow-false-bifurcation.toml")
    (driver,) = start.mechanism.drivers
    turned = replace(driver, law=Polynomial(coefficients=(3.0 + 2 * np.pi * turns, 1.0)))
    before = remade(start, drivers=(turned,))
    path = refkin.follow(before, until=(-0.1, 0.5))

    assert not path.bifurcations
    assert path.t[-1] == 0.5


@pytest.mark.parametrize("turns", [0, 1, 500])
def test_branches_that_cross_are_a_bifurcation_at_every_turn(turns):
    linkage, first = refkin.FourBar(ground=4.0, crank=1.0, coupler=3.0, rocker=2.0), 3.0 + 2 * np.pi * turns
    crossing = linkage.scene(law=Polynomial(coefficients=(first, 1.0)), times=(0.0,))
    path = refkin.follow(crossing, until=(-0.1, 0.5))

    assert [b.t for b in path.bifurcations] == pytest.approx([np.pi - 3.0], abs=1e-9)


def peaucellier(noise, seed):
    """Peaucellier's inversor, two loops of rhombus and arms on a crank, from estimates that are off by some noise."""
    crank, arm, side, phi = 1.0, 3.0, 1.2, 0.4
    d = crank + crank * np.exp(1j * phi)
    along = (arm**2 - side**2 + abs(d) ** 2) / (2 * abs(d))
    b, c = ((along + sign * 1j * np.sqrt(arm**2 - along**2)) * d / abs(d) for sign in (1, -1))
    e = 2 * along * d / abs(d) - d
    ends = {"AD": (crank, d), "OB": (0, b), "OC": (0, c), "DB": (d, b), "DC": (d, c), "BE": (b, e), "CE": (c, e)}
    poses = {name: np.array([np.real(p), np.imag(p), np.angle(q - p)]) for name, (p, q) in ends.items()}
    rng = np.random.default_rng(seed)
    bodies = tuple(Body(name=n, estimate=tuple((x + noise * rng.normal(size=3)).tolist())) for n, x in poses.items())
    length = {"AD": crank, "OB": arm, "OC": arm} | dict.fromkeys(("DB", "DC", "BE", "CE"), side)
    pins = [("AD", 1, "DB", 0), ("AD", 1, "DC", 0), ("OB", 1, "DB", 1), ("OB", 1, "BE", 0)]
    pins += [("OC", 1, "DC", 1), ("OC", 1, "CE", 0), ("BE", 1, "CE", 1)]
    joints = [
        Revolute(name=n, body_i="ground", point_i=(x, 0.0), body_j=n, point_j=(0.0, 0.0))
        for n, x in (("AD", crank), ("OB", 0.0), ("OC", 0.0))
    ]
    joints += [
        Revolute(name=i + j, body_i=i, point_i=(m * length[i], 0.0), body_j=j, point_j=(n * length[j], 0.0))
        for i, m, j, n in pins
    ]
    driver = AngleDriver(name="d", body="AD", law=Polynomial(coefficients=(phi, 0.3)))
    return Scene(mechanism=Mechanism(bodies, tuple(joints), (driver,)), times=(0.0, 0.1))


@pytest.mark.parametrize("noise", [0.2, 0.4])
def test_peaucellier_starts_from_usable_estimates_in_a_regular_assembly(noise):
    for seed in range(6):
        motion = refkin.solve(peaucellier(noise, seed))

        assert motion.verdict is OK, (seed, motion.message)
        assert motion.sigma_min[0] > 1e-3


@pytest.mark.parametrize("angle", [1e-9, 3e-9, 1e-8])
def test_an_estimate_between_two_assemblies_that_closes_to_round_off_is_neither_of_them(angle):
    """A parallelogram beside its flat pose: half way between its branches, 1e-8 from each, residuals are round-off."""
    given = PARALLELOGRAM.scene(law=Polynomial(coefficients=(angle,)), times=(0.0,))
    half_way = {"crank": angle, "coupler": -angle / 2, "rocker": -angle / 2}
    motion = refkin.solve(with_estimates(given, lambda b: (*b.estimate[:2], half_way[b.name])))

    assert motion.verdict is OK
    assert min(abs(motion["rocker"].phi[0] - x) for x in (angle, -2 * angle)) < 1e-15


@pytest.mark.parametrize("solve", [refkin.solve, fast.sweep])
@pytest.mark.parametrize(("speed", "verdict"), [(1e138, "ok"), (1e141, "not_converged"), (1e154, "not_converged")])
def test_a_time_at_which_a_point_goes_beyond_the_largest_number_is_not_ok(solve, speed, verdict):
    """Its body turns about a pin that does not move: coordinates and rates of it are numbers."""
    scene = ROCKER.scene(law=refkin.Polynomial(coefficients=(0.5, speed)), times=[0.0])
    motion = solve(replace(scene, points=(refkin.Point(name="far", body="crank", position=(1e8, 0.0)),)))

    assert motion.verdict == verdict
    assert np.isfinite(motion.points["far"].a).all() == (verdict == "ok")


@pytest.mark.parametrize(
    "law",
    [
        refkin.Polynomial(coefficients=(0.3, 1e200)),
        refkin.Sinusoid(amplitude=0.1, angular_frequency=1e200),
        refkin.Integral(rate=refkin.Polynomial(coefficients=(1e200,)), initial=0.3),
    ],
    ids=lambda law: type(law).__name__,
)
def test_rates_beyond_all_numbers_are_ok_nowhere(law):
    """The square of a frequency may be no float: that ended in a traceback; many mechanisms were ok with NaN."""
    turned = ROCKER.scene(law=law, times=(0.0,))

    motion = refkin.solve(turned)

    assert {motion.verdict, fast.sweep(turned).verdict} == {"not_converged"}
    assert motion.message == "rates at t = 0 are too large for numbers"
    assert not fast.solve_many(turned, {"A0": {"point_j": (np.full(3, -0.5), 0.0)}}).ok.any()


@pytest.mark.parametrize("solve", [refkin.solve, fast.sweep])
def test_a_wheel_so_small_that_the_square_of_its_rate_is_no_number_is_not_ok(solve):
    """A crank of a metre drives it at 1e300 rad/s."""
    m = (turned := ROCKER.scene(times=(0.0,))).mechanism
    pin = Revolute(name="pin", body_i="ground", point_i=(9.0, 0.0), body_j="wheel", point_j=(0.0, 0.0))
    gear = refkin.Gear(name="gear", body_i="crank", radius_i=1.0, body_j="wheel", radius_j=1e-300)
    bodies = (*m.bodies, Body(name="wheel", estimate=(9.0, 0.0, 0.0)))

    assert solve(remade(turned, bodies=bodies, joints=(*m.joints, pin, gear))).verdict == "not_converged"


@pytest.mark.parametrize(
    "law",
    [
        refkin.Polynomial(coefficients=(-1e14, 1e15)),
        refkin.Integral(rate=refkin.Polynomial(coefficients=(1e15,)), initial=-1e14),
        refkin.Sinusoid(amplitude=1e14, angular_frequency=1.0, offset=-1e14 * 0.09983341664682815),
        refkin.Sinusoid(amplitude=0.5, angular_frequency=1e16),
        refkin.Sinusoid(amplitude=0.5, angular_frequency=1.0, phase=1e16),
    ],
)
def test_a_law_whose_small_value_is_left_of_large_ones_is_not_ok_unproved(law):
    """In float64 it is up to 0.015 rad off, and nothing else of the pose shows it."""
    scene = ROCKER.scene(law=law, times=(0.1,), evidence=())
    exact = refkin.solve(replace(scene, evidence=frozenset(refkin.Evidence)))
    changes = {"A0": {"point_j": (np.full(3, -0.5), 0.0)}}
    many = fast.solve_many(scene, changes)
    proved = fast.solve_many(replace(scene, evidence=frozenset({refkin.Evidence.CERTIFICATE})), changes)

    assert exact.certified_radius.position[0] < 1e-12
    for motion in (refkin.solve(scene), fast.sweep(scene)):
        assert motion["crank"].phi[0] == pytest.approx(exact["crank"].phi[0], abs=1e-12)
    assert not many.ok.any()
    assert np.array_equal(proved.ok, np.isfinite(proved.radii[:, 0]))


ISOSCELES = refkin.SliderCrank(crank=0.2, rod=0.2, offset=0.0)
CROSSINGS = {
    "isosceles": (ISOSCELES, math.pi / 2, (1.0, -1.0, 0.0), ((0.0, -0.1),) * 2 + ((0.0, 0.0),)),
    "parallelogram": (
        refkin.FourBar(ground=4.0, crank=1.0, coupler=4.0, rocker=1.0),
        math.pi,
        (1.0, 0.0, 1.0),
        ((0.5, 0), (1, 0), (0.5, 0)),
    ),
}
"""Where two motions cross, but for the rounding of an angle: a linkage, the angle, rates, pulls of places."""


@pytest.mark.parametrize(("linkage", "angle", "rates", "pulls"), CROSSINGS.values(), ids=CROSSINGS)
@pytest.mark.parametrize("speed", [1.0, 1e-3, 150.0])
@pytest.mark.parametrize("evidence", [True, False])
def test_a_pose_that_rounding_alone_keeps_from_being_singular_is_ok_with_its_true_rates(
    linkage, angle, rates, pulls, speed, evidence
):
    """113 bits say where it is, and nothing of its rates: -1.16 rad/s where -1 is right was ok, and -1e15 m/s^2."""
    at = linkage.scene(law=Polynomial(coefficients=(angle, speed)), times=(0.0,))
    motion = refkin.solve(at if evidence else replace(at, evidence=frozenset()))

    assert motion.status == (OK,)
    assert motion.qd[2::3, 0] / speed == pytest.approx(rates, abs=1e-15)
    assert motion.qdd[2::3, 0] / speed**2 == pytest.approx(np.zeros(3), abs=1e-15)
    assert np.delete(motion.qdd[:, 0], [2, 5, 8]) / speed**2 == pytest.approx(np.ravel(pulls), abs=1e-15)


def test_a_pose_whose_rates_no_precision_tells_is_not_ok(monkeypatch):
    """With 113 bits alone no digit of them is known; the pose is, and lies where two motions seem to cross."""
    monkeypatch.setattr(krawczyk, "MORE_BITS", ())
    motion = refkin.solve(ISOSCELES.scene(law=Polynomial(coefficients=(math.pi / 2, 1.0)), times=(0.0,)))

    assert motion.status == (Status.SINGULAR,)
    assert np.isnan(motion.qd).all()
