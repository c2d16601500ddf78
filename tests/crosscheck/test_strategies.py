"""The strategies reach what they promise: measured on many examples, drawn as the nightly draws them."""

from __future__ import annotations

import math
from collections import Counter
from functools import cache
from inspect import signature
from itertools import pairwise
from random import Random

import numpy as np
import pytest
from hypothesis import Phase, find, given, seed, settings
from hypothesis import strategies as st

from crosscheck.scenes.drawing import own_choices_only
from crosscheck.strategies import (
    Hardness,
    chains,
    drawn_scenes,
    four_bars,
    inverted_slider_cranks,
    motion_laws,
    scenes,
    slider_cranks,
    spatial_scenes,
)
from crosscheck.strategies.scenes import KINDS
from crosscheck.strategies.spans import turning_inputs
from crosscheck.strategies.variety import Variant
from refkin.analysis import position
from refkin.differences import EPS
from refkin.model import Scene
from refkin.motion_laws import Integral, Polynomial, Sinusoid, Table
from refkin.scenes.linkages import Branch, FourBar, GrashofClass, InvertedSliderCrank, SliderCrank
from refkin.system import compile_system

GRID = 2.0**-50
"""Lengths are rounded to this part of the longest."""
HARD = (Hardness.LIMIT, Hardness.CHANGE_POINT)


def sample(strategy, count):
    """Return `count` examples, the same ones in every run; no health check is switched off."""
    drawn = []

    @seed(20)
    @settings(max_examples=count, database=None, phases=[Phase.generate])
    @given(strategy)
    def collect(example):
        drawn.append(example)

    with own_choices_only():  # what other test modules have loaded must not matter
        collect()
    return drawn


@cache
def drawn():
    return sample(drawn_scenes(), 1500)


@cache
def linkages():
    return sample(st.one_of(four_bars(), slider_cranks(), inverted_slider_cranks()), 1500)


@cache
def near_change_points():
    return sample(four_bars(slack_decades=(3, 10)), 1500)


def lengths(linkage):
    return [getattr(linkage, key) for key in linkage.LENGTHS]


def decades(numbers, first, last):
    """Return how many numbers lie in each decade from 10^first to 10^last."""
    counts = Counter(math.floor(math.log10(x)) for x in numbers)
    return {k: counts[k] for k in range(first, last)}


# --- what is reached ---------------------------------------------------------------------------------------------


def test_every_grashof_class_is_reached():
    counts = Counter(c.grashof for c in sample(four_bars(), 1000))

    assert set(GrashofClass) == {c for c, count in counts.items() if count >= 50}


@pytest.mark.parametrize("grashof", GrashofClass)
def test_a_class_asked_for_is_the_class_drawn(grashof):
    assert {grashof} == {linkage.grashof for linkage in sample(four_bars(classes=[grashof]), 200)}


def test_lengths_reach_over_six_decades():
    shortest = [min(lengths(linkage)) for linkage in linkages()]

    assert min(decades(shortest, -3, 3).values()) >= 60
    assert min(shortest) >= 1e-3 * (1 - EPS)
    assert max(shortest) <= 1e3 * (1 + EPS)


def ratio(linkage):
    return max(lengths(linkage)) / min(lengths(linkage))


@pytest.mark.parametrize("strategy", [four_bars, slider_cranks, inverted_slider_cranks])
@pytest.mark.parametrize("widest", [8.0, 1e6])
def test_ratios_of_lengths_are_bounded_and_use_the_bound(strategy, widest):
    ratios = [ratio(linkage) for linkage in sample(strategy(max_ratio=widest), 300)]

    assert widest / 4 < max(ratios) <= widest * (1 + widest * GRID)


def test_every_decade_of_slack_is_reached_on_both_sides_by_linkages_without_equal_links():
    distinct = []
    for linkage in near_change_points():
        sides = sorted(lengths(linkage))
        if min(b - a for a, b in pairwise(sides)) > 0.05 * sides[0]:
            distinct.append(linkage.slack / sides[0])

    assert len(distinct) == len(near_change_points())
    assert min(decades([s for s in distinct if s > 0], -10, -3).values()) >= 60
    assert min(decades([-s for s in distinct if s < 0], -10, -3).values()) >= 10


@pytest.mark.parametrize("strategy", [slider_cranks, inverted_slider_cranks])
def test_slack_of_slider_linkages_is_reached_on_both_sides(strategy):
    slacks = [linkage.slack / min(lengths(linkage)) for linkage in sample(strategy(slack_decades=(3, 10)), 700)]

    assert min(decades([s for s in slacks if s > 0], -10, -3).values()) >= 10
    assert min(decades([-s for s in slacks if s < 0], -10, -3).values()) >= 10


def test_exact_change_points_have_no_slack_at_all():
    result = sample(four_bars(classes=[GrashofClass.CHANGE_POINT]), 200)

    assert {0.0} == {linkage.slack for linkage in result}


def test_linkages_stand_at_the_origin_and_elsewhere_straight_and_turned():
    at_origin = [linkage.origin == (0.0, 0.0) for linkage in linkages()]
    straight = [linkage.angle == 0.0 for linkage in linkages()]

    assert 0.2 < np.mean(at_origin) < 0.8
    assert 0.2 < np.mean(straight) < 0.8


def test_every_kind_meets_every_hardness_and_branch():
    counts = Counter((d.kind, d.hardness, d.branch) for d in drawn())

    assert min(counts[kind, h, b] for kind in KINDS for h in Hardness for b in Branch) >= 20


def test_every_input_of_every_linkage_is_driven():
    counts = Counter((type(d.linkage), d.pair) for d in drawn())
    wanted = {(type(d.linkage), pair) for d in drawn() for pair in d.linkage.INPUTS}

    assert len(wanted) == 13
    assert min(counts[pair] for pair in wanted) >= 10


def test_every_grashof_class_is_in_scenes():
    counts = Counter(d.grashof for d in drawn())

    assert min(counts[c] for c in GrashofClass) >= 8


def test_every_driver_type_is_reached_regular_and_hard():
    counts = Counter((d.scene.mechanism.drivers[0].type, d.hardness in HARD) for d in drawn())

    assert min(counts[kind, hard] for kind in ("angle", "x", "y", "distance") for hard in (False, True)) >= 15


def test_angles_are_driven_absolute_and_relative():
    counts = Counter(d.scene.mechanism.drivers[0].bodies[0] == "ground" for d in drawn())

    assert min(counts[True], counts[False]) >= 150


def test_every_law_is_reached_as_a_value_and_as_a_rate():
    counts = Counter()
    for d in drawn():
        as_rate = isinstance(d.law, Integral)
        counts[type(d.law.rate if as_rate else d.law), as_rate] += 1

    assert min(counts[law, as_rate] for law in (Polynomial, Sinusoid, Table) for as_rate in (False, True)) >= 60


def test_every_joint_type_is_reached():
    counts = Counter(kind for d in drawn() for kind in {joint.type for joint in d.scene.mechanism.joints})

    assert min(counts[kind] for kind in ("revolute", "prismatic", "point_on_line", "distance")) >= 100
    assert 20 <= counts["fixed"] <= 400  # rarely


def test_any_link_can_be_a_distance_joint():
    counts = Counter(d.variant.massless for d in drawn())

    assert min(counts[link] for link in ("crank", "coupler", "rocker", "connecting_rod")) >= 8


def test_joints_name_their_bodies_in_either_order():
    ground_second = [d for d in drawn() if any(j.bodies[1] == "ground" for j in d.scene.mechanism.joints)]

    assert 0.1 < len(ground_second) / len(drawn()) < 0.9


def test_body_frames_are_generic_in_about_half_of_the_scenes():
    assert 0.3 < np.mean([bool(d.variant.frames) for d in drawn()]) < 0.7


def test_moving_guides_and_guides_at_an_angle_are_reached():
    slides = [j for d in drawn() for j in d.scene.mechanism.joints if j.type == "prismatic"]

    assert sum("ground" not in joint.bodies for joint in slides) >= 50
    assert sum(joint.angle != 0.0 for joint in slides) >= 50


def test_drivers_have_rates_and_accelerations():
    laws = [d.scene.mechanism.drivers[0].laws[0] for d in drawn()]
    middle = [d.scene.times[len(d.scene.times) // 2] for d in drawn()]

    assert np.mean([law(t, 1) != 0.0 for law, t in zip(laws, middle, strict=True)]) > 0.95
    assert np.mean([law(t, 2) != 0.0 for law, t in zip(laws, middle, strict=True)]) > 0.6


def test_times_begin_at_zero_and_later():
    starts = [d.scene.times[0] > 0.0 for d in drawn() if d.hardness is Hardness.REGULAR]

    assert 0.2 < np.mean(starts) < 0.8


def test_samples_are_as_many_as_asked():
    assert {72} == {len(d.scene.times) for d in drawn()}
    assert {5} == {len(scene.times) for scene in sample(scenes(samples=5), 50)}


# --- how near to singular poses ----------------------------------------------------------------------------------


def test_regular_scenes_keep_a_thousandth_of_the_longest_link_from_singular_poses():
    assert min(d.distance for d in drawn() if d.hardness is Hardness.REGULAR) > 1e-3


def test_every_decade_of_the_distance_to_a_limit_is_reached_at_the_last_time():
    """The distance of the last input from the nearest end of its range [rad, or longest lengths]."""
    left = []
    for d in drawn():
        if d.hardness is Hardness.LIMIT:
            unit = max(lengths(d.linkage)) if d.pair[0] == "slider" else 1.0
            ends = [end for interval in d.linkage.input_range(*d.pair) for end in interval]
            left.append(min(abs(d.input(d.scene.times[-1]) - end) for end in ends) / unit)

    assert min(decades(left, -10, -3).values()) >= 15


def test_limits_are_met_from_below_and_from_above():
    rising = [d.span[1] > d.span[0] for d in drawn() if d.hardness is Hardness.LIMIT]

    assert 0.2 < np.mean(rising) < 0.8


@pytest.mark.parametrize("hardness", HARD)
def test_every_decade_of_the_closure_margin_is_reached(hardness):
    values = [d.distance for d in drawn() if d.hardness is hardness]

    assert min(decades(values, -10, -4).values()) >= 15


def test_scenes_near_a_change_point_come_as_near_to_it_as_its_slack_lets_them():
    for d in drawn():
        if d.hardness is Hardness.CHANGE_POINT:
            # Beside a gap of half width w the margin is slack ((1 + part)^2 - 1) with part <= 1: at most 3 slacks; it
            # is taken twice for the terms of higher order in w.
            assert d.distance <= 6 * abs(d.linkage.slack) / max(lengths(d.linkage))


def test_scenes_near_a_change_point_end_there_or_go_through():
    ends, through = 0, 0
    for d in drawn():
        if d.hardness is Hardness.CHANGE_POINT:
            last = d.linkage.closure_margin(d.span[1], *d.pair) / max(lengths(d.linkage))
            ends, through = ends + (last <= 2 * d.distance), through + (last > 10 * d.distance)

    assert min(ends, through) >= 50


def test_no_input_closes_worse_than_the_worst_turning_input():
    for linkage in linkages()[:300]:
        for pair in linkage.INPUTS:
            worst = min(linkage.closure_margin(value, *pair) for value in turning_inputs(linkage, pair))
            values = np.linspace(-math.pi, math.pi, 41) if pair[0] != "slider" else [0.0]
            margins = [linkage.closure_margin(value, *pair) for value in values]
            assert min(margins) >= worst - 64 * EPS * linkage.reach


def test_distance_bounds_the_margin_at_every_sample_from_below():
    for d in drawn()[:400]:
        margins = [d.linkage.closure_margin(d.input(t), *d.pair) for t in d.scene.times]
        assert min(margins) >= d.distance * max(lengths(d.linkage)) - 64 * EPS * d.linkage.reach


# --- what every scene is -----------------------------------------------------------------------------------------


def assembled(d, system, t):
    return system.to_unit(np.concatenate([d.pose(t)[body.name] for body in d.scene.mechanism.bodies]))


@settings(max_examples=150)
@given(drawn_scenes())
def test_every_scene_assembles_at_every_time(d):
    system = compile_system(d.scene.mechanism, unit=d.scene.mechanism.unit())
    for t in d.scene.times:
        q = assembled(d, system, t)
        phi = system.phi(q, t)
        turns = [math.remainder(row, math.tau) if abs(row) > 1 else row for row in phi]  # angles differ by full turns

        # Coordinates up to |q| carry a few roundings of |q| from placing and turning frames; rows add a few of them.
        assert np.max(np.abs(turns)) <= 32 * EPS * (1 + np.max(np.abs(q)))


@settings(max_examples=150)
@given(drawn_scenes())
def test_every_scene_stays_on_one_branch(d):
    """The sign of det phi_q, which changes only through a singular pose, is one sign at all times."""
    system = compile_system(d.scene.mechanism, unit=d.scene.mechanism.unit())

    signs = {np.linalg.slogdet(system.phi_q(assembled(d, system, t), t))[0] for t in d.scene.times}

    assert signs in ({1.0}, {-1.0})


@settings(max_examples=300)
@given(drawn_scenes())
def test_newton_from_the_estimates_finds_the_branch_that_was_drawn(d):
    mechanism, t = d.scene.mechanism, d.scene.times[0]
    system = compile_system(mechanism, unit=mechanism.unit())
    q0 = system.to_unit(np.concatenate([body.estimate for body in mechanism.bodies]))

    result = position(system, q0, t)

    assert result.converged
    apart = [math.remainder(angle, math.tau) for angle in (result.q - assembled(d, system, t))[2::3]]
    sigma = np.linalg.svd(system.phi_q(result.q, t), compute_uv=False)[-1]
    # Two solutions of round-off residual differ by round-off over sigma; the other branch is about sigma away.
    assert np.max(np.abs(apart)) <= 64 * EPS * (1 + np.max(np.abs(result.q))) / sigma


def test_estimates_are_no_answers():
    """Most are off by more than a thousandth of the longest length or a milliradian, though none by a hundredth."""
    errors = []
    for d in (d for d in drawn() if d.hardness is Hardness.REGULAR):
        size, exact = max(lengths(d.linkage)), d.pose(d.scene.times[0])
        off = [np.subtract(b.estimate, exact[b.name]) / (size, size, 1.0) for b in d.scene.mechanism.bodies]
        errors.append(np.max(np.abs(off)))

    assert np.mean(np.array(errors) > 1e-3) > 0.5
    assert max(errors) < 1e-2


def test_scenes_are_scenes():
    assert {Scene} == {type(scene) for scene in sample(scenes(), 30)}


def test_equal_scenes_are_rare():
    assert len({d.scene for d in drawn()}) > 0.9 * len(drawn())


# --- laws --------------------------------------------------------------------------------------------------------


@given(st.data(), st.floats(-20.0, 20.0), st.floats(0.5, 5.0) | st.floats(-5.0, -0.5), st.floats(0.1, 10.0))
def test_laws_stay_between_their_ends(data, first, step, duration):
    law = data.draw(motion_laws(first=first, last=first + step, duration=duration))
    values = law(np.linspace(0.0, duration, 501))

    beyond = 64 * EPS * (abs(first) + abs(step))
    assert min(first, first + step) - beyond <= np.min(values)
    assert np.max(values) <= max(first, first + step) + beyond


@given(st.data(), st.floats(-20.0, 20.0), st.floats(0.5, 5.0) | st.floats(-5.0, -0.5), st.floats(0.1, 10.0))
def test_monotone_laws_go_from_end_to_end_without_a_stop(data, first, step, duration):
    law = data.draw(motion_laws(first=first, last=first + step, duration=duration, monotone=True))
    t = np.linspace(0.0, duration, 501)

    assert law(np.array([0.0, duration])) == pytest.approx(
        [first, first + step], abs=64 * EPS * (abs(first) + abs(step))
    )
    assert np.min(law(t, 1) * math.copysign(1.0, step)) > 0.0


# --- bounds and shrinking ----------------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("strategy", "bounds", "named"),
    [
        (four_bars, {"min_size": 0.0}, "min_size"),
        (four_bars, {"min_size": 2.0, "max_size": 1.0}, "max_size"),
        (four_bars, {"max_ratio": 3.0}, "max_ratio"),
        (four_bars, {"max_offset": -1.0}, "max_offset"),
        (four_bars, {"classes": []}, "classes"),
        (four_bars, {"classes": [GrashofClass.CHANGE_POINT], "slack_decades": (3, 10)}, "classes"),
        (slider_cranks, {"slack_decades": (10, 3)}, "slack_decades"),
        (slider_cranks, {"slack_decades": (3, 15)}, "slack_decades"),
        (inverted_slider_cranks, {"slack_decades": (3, 10), "max_ratio": 1e6}, "slack_decades"),
        (drawn_scenes, {"kinds": []}, "kinds: expected some of four-bar, slider-crank, "),
        (drawn_scenes, {"kinds": ["four-bar", "sixbar"]}, "kinds: expected .*, in a list, got .*'sixbar'"),
        (drawn_scenes, {"kinds": "inverted slider-crank"}, "kinds: expected .*, got 'inverted slider-crank'"),
        (drawn_scenes, {"kinds": None}, "kinds: expected .*, got None"),
        (drawn_scenes, {"hardness": []}, "hardness: expected some of regular, limit, change-point, in a list"),
        (drawn_scenes, {"hardness": "regular"}, "hardness: expected .*, got 'regular'"),
        (drawn_scenes, {"samples": 0}, "samples: expected a whole number from 1 on, got 0"),
        (drawn_scenes, {"samples": 2.5}, "samples: expected a whole number from 1 on, got 2.5"),
        (drawn_scenes, {"samples": "5"}, "samples: expected a whole number from 1 on, got '5'"),
        (chains, {"kinds": ["six-bar", "seven-bar"]}, "kinds: expected .*six-bar"),
        (chains, {"samples": None}, "samples: expected a whole number from 1 on, got None"),
        (spatial_scenes, {"kinds": ["RSSR", "SSSS"]}, "kinds: expected some of RSSR, "),
        (spatial_scenes, {"regions": "limit"}, "regions: expected some of regular, limit, "),
        (spatial_scenes, {"samples": True}, "samples: expected a whole number from 1 on, got True"),
    ],
)
def test_bounds_that_contradict_each_other_are_an_error(strategy, bounds, named):
    with pytest.raises(ValueError, match=named):
        find(strategy(**bounds), lambda _: True)


@pytest.mark.parametrize("strategy", [four_bars, slider_cranks, inverted_slider_cranks])
def test_a_strategy_of_linkages_says_which_bounds_it_takes(strategy):
    """To whoever asks for help, in a failing example, and where one is misspelt."""
    bounds = {"min_size", "max_size", "max_ratio", "max_offset", "slack_decades"}

    assert bounds <= signature(strategy).parameters.keys()
    assert repr(strategy(min_size=1.0)) == f"{strategy.__name__}(min_size=1.0)"
    with pytest.raises(TypeError, match=f"{strategy.__name__}.* 'smallest'"):
        strategy(smallest=1.0)


SHRUNK = settings(database=None, max_examples=1000)


@pytest.mark.parametrize(
    "wanted",
    [
        lambda d: d.law(d.scene.times[0], 2) != 0.0,
        lambda d: d.kind == "four-bar" and d.hardness is Hardness.REGULAR,
        lambda d: d.hardness is Hardness.CHANGE_POINT,
        lambda d: d.scene.mechanism.drivers[0].type == "distance",
    ],
    ids=["accelerated", "regular four-bar", "near a change point", "distance driver"],
)
def test_scenes_shrink_to_a_linkage_of_a_metre_at_the_origin_in_its_own_frames(wanted):
    d = find(drawn_scenes(), wanted, settings=SHRUNK, random=Random(1))

    assert (d.linkage.origin, d.linkage.angle) == ((0.0, 0.0), 0.0)
    assert min(lengths(d.linkage)) == 1.0
    assert d.variant == Variant()


@pytest.mark.parametrize(
    ("strategy", "wanted", "expected"),
    [
        (four_bars(), lambda linkage: linkage.rocker > 2.5, FourBar(ground=2.0, crank=1.0, coupler=3.5, rocker=3.0)),
        (slider_cranks(), lambda linkage: linkage.rod > 1.5, SliderCrank(1.0, 2.0)),
        (inverted_slider_cranks(), lambda linkage: linkage.ground > 1.5, InvertedSliderCrank(2.0, 1.0)),
    ],
)
def test_linkages_shrink_to_short_decimals(strategy, wanted, expected):
    assert expected == find(strategy, wanted, settings=SHRUNK, random=Random(1))
