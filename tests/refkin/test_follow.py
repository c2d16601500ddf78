"""Paths of poses: through limits of the driver in both directions, through change points, and back to their start."""

from __future__ import annotations

import math
from dataclasses import dataclass, replace
from types import SimpleNamespace

import numpy as np
import pytest

import refkin
from refkin import (
    AngleDriver,
    Body,
    Distance,
    DistanceDriver,
    FourBar,
    Mechanism,
    Polar,
    Polynomial,
    Revolute,
    Scene,
    Sinusoid,
    SliderCrank,
    Table,
    YDriver,
    compile_system,
)
from refkin.joints import DRIVER_TYPES, SPATIAL_DRIVER_TYPES
from refkin.motion_laws import Integral
from refkin.proof.path import tracing
from refkin.proof.path.curve import Curve
from refkin.proof.path.tracing import BEND, CLOSE, FIRST_STEP, INSIDE, STANDING, TraceEnd, Tracer
from refkin.scenes.linkages import RSSP
from refkin.solving.follow import Bifurcation, Tangent, TurningPoint, _is_driven_angle, driven_by, straight_on
from refkin.solving.table_ends import continued
from tests.linkages import CHANGE_POINT, KITE, LIMITED, PARALLELOGRAM, ROCKER, copied, posed, remade, with_law
from tests.places import CORPUS

from .assembled import beside_a_mast
from .contact_cases import cam, guide

PULLED = SliderCrank(crank=0.25, rod=0.5)


def driven(linkage, angle=0.5, **more):
    """A scene whose time is the angle of the crank."""
    return linkage.scene(law=Polynomial(coefficients=(0.0, 1.0)), times=(angle,), **more)


def off(angle, expected):
    return np.abs(np.angle(np.exp(1j * (angle - expected))))


def sides(linkage, path):
    """By which of its two closed forms each pose of a four-bar is explained: the distance to each, (2, K)."""
    crank, rocker = path["crank"].phi, path["rocker"].phi
    return np.array(
        [
            [off(b, linkage.assemble(float(a), branch)["rocker"][2]) for a, b in zip(crank, rocker, strict=True)]
            for branch in ("open", "crossed")
        ]
    )


@pytest.mark.parametrize(("direction", "until"), [(1, (0.0, 0.5)), (-1, (0.5, 1.0))])
def test_a_path_that_begins_where_it_may_not_go_on_is_one_pose(direction, until):
    path = refkin.follow(driven(ROCKER), direction=direction, until=until)

    assert path.t.tolist() == [0.5]


def test_what_no_law_moves_stays_where_it_is():
    m = ROCKER.scene().mechanism
    rod = Distance(name="rod", body_i="ground", point_i=(0.0, 1.0), body_j="crank", point_j=(0.5, 0.0), length=1.2)
    path = refkin.follow(refkin.Scene(mechanism=replace(m, joints=(*m.joints, rod), drivers=()), times=(0.0, 1.0)))

    assert path.t[-1] == 1.0
    assert np.ptp(path.q, axis=1).max() < 1e-12


def test_a_path_begins_at_the_limit_itself_where_that_is_zero():
    """Least squares over a pin that is there twice leave 1e-32 s, which lay outside of the limits."""
    scene = ROCKER.scene(law=Polynomial(coefficients=(0.3, 1.0)), times=(0.0, 1.0))
    again = (*scene.mechanism.joints, replace(scene.mechanism.joints[0], name="again"))
    path = refkin.follow(remade(scene, joints=again), until=(0.0, 1.0))

    assert (path.t[0], path.t[-1]) == (0.0, 1.0)


@pytest.mark.parametrize("until", [(0.6, 2.0), (-2.0, 0.4)])
def test_a_path_that_begins_where_it_may_not_be_is_refused(until):
    """It was said to leave a range in which it never was."""
    with pytest.raises(refkin.InvalidRequest, match=r"until: expected two values that t = 0\.5, where the path begins"):
        refkin.follow(driven(ROCKER), until=until)


def test_a_crossing_that_the_first_step_would_pass_is_met():
    path = refkin.follow(driven(PARALLELOGRAM, math.pi - 0.004), most_points=5)

    assert path.end is TraceEnd.BIFURCATION
    assert path.t[-1] == pytest.approx(math.pi, abs=1e-12)


@pytest.mark.parametrize("t_turns", [False, True])
def test_a_point_less_its_whole_turns_is_the_first_one_in_the_plane_and_in_space(t_turns):
    """Euler parameters p and -p are one turn; t is an angle where it is that of the driver."""
    plane = compile_system(LIMITED.scene(law=Polynomial(coefficients=(0.5,)), times=(0.0,)).mechanism)
    rod = RSSP(1.0, 3.0, (0.5, 0.25, 0.5), (1.0, 0.5, 0.25)).scene(samples=2, turns=0.1)
    for system in (plane, compile_system(rod.mechanism)):
        first = np.random.default_rng(2).uniform(-1.0, 1.0, system.n + 1)
        scale = np.append(np.ones(system.n), 0.25)
        tracer = Tracer(Curve(system, scale), (-9.0, 9.0), 1.0, 9, t_turns)
        tracer.trace.points.append(first)
        turned = first + 2 * np.pi * np.append(system.angles * np.arange(system.n), 3 * t_turns) / scale
        if system is not plane:
            turned[10:14] *= -1.0

        assert turned - tracer._turns(turned) == pytest.approx(first)
        assert turned + 0.1 - tracer._turns(turned + 0.1) == pytest.approx(first + 0.1)


@pytest.mark.parametrize("direction", [1, -1])
def test_a_crank_with_limits_passes_both_and_comes_back_on_the_other_branch(direction):
    path = refkin.follow(driven(LIMITED), direction=direction)
    limit = LIMITED.input_range()[0][1]
    first, second = (event.index for event in path.events)
    inside = np.flatnonzero(np.abs(path.t) < 0.999 * limit)  # at it no closed form says on which side a pose is
    by_open, by_crossed = sides(LIMITED, replace(path, q=path.q[:, inside]))

    assert path.end is TraceEnd.CLOSED
    assert [event.t for event in path.events] == pytest.approx([direction * limit, -direction * limit], abs=1e-14)
    assert [event.is_maximum for event in path.events] == [direction > 0, direction < 0]
    between = (inside > first) & (inside < second)
    assert np.max(np.where(between, by_crossed, by_open)) < 1e-11
    assert np.min(np.where(between, by_open, by_crossed)) > 1e-3


@pytest.mark.parametrize("direction", [1, -1])
def test_a_crank_pulled_by_its_slider_goes_through_both_dead_centres_around(direction):
    """Its stroke is from 1/4 to 3/4; the crank goes on turning one way, as no solve at given times could."""
    scene = PULLED.scene(driven="slider", law=Polynomial(coefficients=(0.0, 1.0)), times=(0.6,))
    path = refkin.follow(scene, direction=direction)
    turn = np.diff(path["crank"].phi)

    assert path.end is TraceEnd.CLOSED
    assert sorted(event.t for event in path.events) == pytest.approx([0.25, 0.75], abs=1e-15)
    assert np.all(turn > 0) or np.all(turn < 0)
    assert abs(path["crank"].phi[-1] - path["crank"].phi[0]) == pytest.approx(2 * np.pi, abs=1e-12)
    assert (
        np.max(
            np.abs(0.25 * np.cos(path["crank"].phi) + np.sqrt(0.25 - (0.25 * np.sin(path["crank"].phi)) ** 2) - path.t)
        )
        < 1e-14
    )


@pytest.mark.parametrize("direction", [1, -1])
def test_a_crank_without_limits_comes_back_after_a_turn(direction):
    path = refkin.follow(driven(ROCKER), direction=direction)

    assert path.end is TraceEnd.CLOSED
    assert path.t[-1] - path.t[0] == pytest.approx(direction * 2 * np.pi, abs=1e-12)
    assert path["rocker"].phi[-1] == path["rocker"].phi[0]
    assert path.events == ()


def test_every_pose_closes_and_all_but_turning_points_are_proved_to_be_alone():
    """Where it turns, the tangent does not move the driver."""
    path = refkin.follow(driven(LIMITED))
    not_proved, turning = np.flatnonzero(np.isnan(path.radius)), [event.index for event in path.events]

    assert np.max(path.residual) < 4e-16
    assert set(not_proved) <= {*turning}
    assert np.nanmax(path.radius) < 1e-9
    assert all(abs(v.t) < 1e-7 * np.max(np.abs(v.q)) for v in (path.tangents[k] for k in turning))


def test_the_radius_holds_the_closed_form():
    path = refkin.follow(driven(ROCKER), until=(0.0, 6.0))
    by_open, _ = sides(ROCKER, path)

    assert np.max(by_open - path.radius * (1 + 1e-9)) < 1e-14


def test_tangents_are_the_directions_of_the_path():
    """Against rates of a solve: dq/dt of every pose where t does not turn."""
    scene = driven(LIMITED)
    path = refkin.follow(scene, until=(0.0, 1.5))
    system = compile_system(scene.mechanism)

    for k, t in enumerate(path.t):
        assert path.tangents[k].t > 0
        assert np.max(np.abs(path.tangents[k].rate - refkin.velocity(system, path.q[:, k], t))) < 1e-11


@pytest.mark.parametrize("linkage", [CHANGE_POINT, PARALLELOGRAM, KITE], ids=["change point", "parallelogram", "kite"])
def test_a_change_point_is_found_with_the_tangents_of_both_branches(linkage):
    """The rates of both against closed forms near by: fourth-order differences on each side, continued across."""
    path = refkin.follow(driven(linkage))
    (result,) = path.events
    h = 1e-2 * np.array([-2, -1, 1, 2])
    rates = []
    for before, after in (("open", "crossed"), ("crossed", "open")):  # a branch goes on as the other closed form
        at = [linkage.assemble(np.pi + x, before if x < 0 else after)["rocker"][2] for x in h]
        a, b, c, d = np.unwrap(at)
        rates.append((a - 8 * b + 8 * c - d) / 0.12)

    assert isinstance(result, Bifurcation)
    assert path.end is TraceEnd.BIFURCATION
    assert result.t == pytest.approx(np.pi, abs=1e-14)
    assert sorted(v.rate[8] for v in result.tangents) == pytest.approx(sorted(rates), abs=1e-6)


@pytest.mark.parametrize("sign", [1, -1])
@pytest.mark.parametrize("which", [0, 1])
def test_from_a_change_point_each_branch_can_be_followed_in_both_directions(which, sign):
    """On the parallelogram's the rocker is parallel to the crank; on the other it is not."""
    scene = driven(PARALLELOGRAM)
    (change,) = refkin.follow(scene).events
    chosen = change.tangents[which] if sign > 0 else -change.tangents[which]
    path = refkin.follow(scene, change, along=chosen, until=(np.pi - 1, np.pi + 1))
    parallel = abs(chosen.rate[8] - 1.0) < 1e-6
    away = off(path["rocker"].phi, path["crank"].phi)

    assert path.end is TraceEnd.RANGE
    assert path.t[-1] == np.pi + np.sign(chosen.t)
    assert (np.max(away) < 1e-12) == parallel
    assert np.all((np.diff(path.t) > 0) == (chosen.t > 0))
    unit = np.tile([PARALLELOGRAM.scene().mechanism.size()] * 2 + [1.0], 3)
    assert np.linalg.norm((path.q[:, 1] - path.q[:, 0]) / unit) <= 1.01 * FIRST_STEP


def test_straight_on_through_change_points_a_parallelogram_stays_one():
    path = refkin.follow(driven(PARALLELOGRAM), until=(0.5, 13.0), choose=straight_on)

    assert [event.t for event in path.events] == pytest.approx(np.pi * np.arange(1, 5), abs=1e-13)
    assert np.max(off(path["rocker"].phi, path["crank"].phi)) < 1e-12
    for there in path.bifurcations:
        assert np.array_equal(path.tangents[there.index].q, there.incoming.q)


LOST = math.sin(BEND / 2)
"""Up to this rate of t a tangent that strays can lose its sign."""


def test_there_is_no_way_straight_on_without_a_way_in_or_a_way_out():
    way = Tangent(np.array([1.0, 0.0]), 0.5)
    crossing = Bifurcation(0.0, np.zeros(2), (way,), way, 0)

    assert straight_on(crossing) is way
    assert straight_on(replace(crossing, tangents=())) is None
    assert straight_on(replace(crossing, incoming=None)) is None


def test_t_turns_twice_in_a_step_where_the_parabola_of_its_rate_falls_to_a_quarter_of_that_at_either_end():
    """The rates at both ends and the way of t in between tell the parabola; a rate of another sign is one turn."""
    rng, part, seen = np.random.default_rng(7), np.linspace(0.0, 1.0, 2001), []
    for k in range(400):
        first, middle, last = rng.uniform([0.05, -0.5, 0.05], 1.0)
        last, length, way = last * (-1.0 if k % 8 == 0 else 1.0), 1e-6 if k % 8 == 1 else 0.3, rng.choice([-1.0, 1.0])
        least = (
            np.min(np.polynomial.Polynomial.fit((0.0, 0.5, 1.0), (first, middle, last), 2)(part)) - min(first, last) / 4
        )
        t = length * (first + 4.0 * middle + last) / 6.0
        new = np.array([math.sqrt(length * length - t * t), 0.0, way * t])
        if abs(least) > 1e-3:
            seen.append(
                tracing._turns_twice(
                    0.0 * new, np.array([0.0, 0.0, way * first]), new, np.array([0.0, 0.0, way * last])
                )
            )
            assert seen[-1] == (least < 0.0 and k % 8 > 1)

    assert 100 < sum(seen) < 250


@pytest.mark.parametrize("slack", [1e-4, 1e-8, 1e-12, -1e-12, -1e-8, -1e-4])
def test_near_a_change_point_the_path_stays_on_its_curve(slack):
    """Positive: the curves pass by each other, and t goes on. Negative: they turn back before they meet."""
    linkage = FourBar(ground=4.0, crank=1.0, coupler=3.5, rocker=1.5 + slack)
    path = refkin.follow(driven(linkage), until=(0.0, 6.0), most_points=500)

    if slack > 0:
        assert path.end is TraceEnd.RANGE
        assert path.t[-1] == 6.0
        assert np.max(sides(linkage, path)[0]) < 1e-8
    else:
        assert isinstance(path.events[0], TurningPoint)
        assert path.t[-1] == 0.0
        assert path["rocker"].phi[-1] == pytest.approx(linkage.assemble(0.0, "crossed")["rocker"][2], abs=1e-9)


def two(one, other, angle=0.5):
    """A scene of two four-bars on one crank, whose time is its angle."""
    return copied(driven(one, angle), ("coupler", "rocker"), driven(other, angle))


@pytest.mark.parametrize("other", [CHANGE_POINT, replace(PARALLELOGRAM, ground=4.0, coupler=4.0)])
def test_where_four_curves_cross_at_once_a_path_ends_with_the_tangents_of_all(other):
    """Both linkages may go on in two ways; the determinant changes its sign twice."""
    path, there = refkin.follow(two(PARALLELOGRAM, other)), refkin.follow(two(PARALLELOGRAM, other, np.pi))

    assert np.max(sides(PARALLELOGRAM, path)[0]) < 1e-7
    for one in (path, there):
        assert (one.end, [len(event.tangents) for event in one.events]) == (TraceEnd.BIFURCATION, [4])
        assert one.t[-1] == pytest.approx(np.pi, abs=1e-14)
    assert there.t.size == 1


@pytest.mark.parametrize(("first", "second"), [(-200, -200), (-200, 0), (200, -200)])
def test_beside_a_pose_where_four_curves_meet_a_path_does_not_turn_to_and_fro_by_rounding(first, second):
    """Lengths are a rounding off, so that the curves all but meet: steps shorter than what rounding moves are none."""
    one, other = (
        replace(linkage, coupler=linkage.coupler + ulps * 2.0**-52)
        for linkage, ulps in ((PARALLELOGRAM, first), (CHANGE_POINT, second))
    )
    path = refkin.follow(two(one, other))

    assert np.all(np.diff(path.t) > 0.0)
    assert path.t[-1] == pytest.approx(np.pi, abs=1e-6)
    assert path.message == "no step is small enough: how paths go on beside a singular pose is not decided"


@pytest.mark.parametrize("law", [(np.pi - 1.0, 2.0, -1.0), (np.pi - 1.0, 3.0, -3.0, 1.0)], ids=["back", "on"])
def test_where_curves_only_touch_because_the_law_stands_still_a_path_stops(law):
    """No tangent tells them apart, so there is none to choose."""
    path = refkin.follow(PARALLELOGRAM.scene(law=Polynomial(coefficients=law), times=(0.0, 2.0)))

    assert (path.end, path.events) == (TraceEnd.STOPPED, ())
    assert path.t[-1] == pytest.approx(1.0, abs=1e-9)


def test_a_path_stops_where_the_table_of_its_law_ends():
    law = refkin.Table(argument=(0.0, 1.0, 2.0, 3.0), value=(0.0, 0.5, 0.3, 0.9))
    path = refkin.follow(LIMITED.scene(law=law, times=(0.5,)))

    assert (path.end, path.t[-1]) == (TraceEnd.RANGE, 3.0)


@pytest.mark.parametrize("most", [1, 2, 33, 34, 35])
def test_a_path_has_no_more_poses_than_asked_for_also_where_the_last_is_a_turning_point(most):
    path = refkin.follow(driven(LIMITED), most_points=most)

    assert (path.end, path.t.size) == (TraceEnd.POINTS, most)


def test_two_linkages_that_pass_a_near_change_point_together_stay_on_their_curves():
    """The determinant changes its sign twice, those of the blocks once each."""
    linkage = FourBar(ground=4.0, crank=1.0, coupler=3.5, rocker=1.5 + 1e-5)
    path = refkin.follow(two(linkage, linkage), until=(0.0, 6.0), max_step=0.5)

    assert path.end is TraceEnd.RANGE
    assert np.max(sides(linkage, path)[0]) < 1e-8


@pytest.mark.parametrize("slack", [1e-6, -1e-6])
def test_long_steps_of_a_linkage_with_redundant_rows_stay_on_its_curve(slack):
    """A second coupler on the same pins: which rows are independent is asked anew on the way."""
    linkage = FourBar(ground=4.0, crank=1.0, coupler=3.5, rocker=1.5 + slack)
    scene = copied(driven(linkage), ("coupler",))
    path = refkin.follow(scene, until=(0.0, 6.0), max_step=0.5)
    alone = refkin.follow(driven(linkage), until=(0.0, 6.0), max_step=0.5)

    assert [event.t for event in path.events] == pytest.approx([event.t for event in alone.events], abs=1e-9)
    assert path["rocker"].phi[-1] == pytest.approx(alone["rocker"].phi[-1], abs=1e-9)
    assert len(path.events) == (slack < 0)


def test_two_turning_points_that_a_step_would_go_over_are_both_found():
    """The height of a coupler's point rests and falls a little while the crank turns by 0.06 rad."""
    point, angles = (-0.91430943, -2.95), np.linspace(0.0, 2 * np.pi, 20001)

    def pose(angle):
        return ROCKER.assemble(float(angle), "open")

    def height(angle):
        _, y, phi = pose(angle)["coupler"]
        return y + np.sin(phi) * point[0] + np.cos(phi) * point[1]

    rising = np.diff([height(angle) for angle in angles]) > 0
    driver = YDriver(name="lift", body="coupler", point=point, law=Polynomial(coefficients=(0.0, 1.0)))
    m = driven(ROCKER).mechanism
    bodies = tuple(replace(b, estimate=pose(1.27)[b.name]) for b in m.bodies)
    scene = replace(driven(ROCKER, height(1.27)), mechanism=replace(m, bodies=bodies, drivers=(driver,)))
    path = refkin.follow(scene)
    turns = sorted(float(event.q[2]) % (2 * np.pi) for event in path.turning_points)

    assert path.end is TraceEnd.CLOSED
    assert turns == pytest.approx(angles[1:-1][rising[1:] != rising[:-1]].tolist(), abs=2e-3)


@pytest.mark.parametrize(("least", "twice"), [(-0.05, True), (0.05, True), (0.5, False), (1.2, False)])
def test_a_rate_of_t_that_is_small_or_negative_between_like_ends_is_seen_in_how_far_t_goes(least, twice):
    """The rate is a parabola with 0.8 at both ends of a step of length 2 and its least, or most, in the middle."""
    way = 2 * (0.8 + 0.8 + 4 * 0.8 * least) / 6
    new, tangent = np.array([math.sqrt(4.0 - way**2), way]), np.array([0.6, 0.8])

    assert tracing._turns_twice(np.zeros(2), tangent, new, tangent) is twice


@pytest.mark.parametrize("waves", [130, 170])
def test_three_and_four_turning_points_that_a_step_would_go_over_are_all_found(waves):
    """A tip that is lifted turns a waved cam: its height turns on each crest and in each trough."""
    law = Sinusoid(offset=1.0, amplitude=0.05 / waves, angular_frequency=float(waves), phase=0.375)
    height = float(law(math.pi / 2 - 0.3))
    lift = YDriver(name="lift", body="follower", law=Polynomial(coefficients=(0.0, 1.0)))
    joints, _ = cam(Polar(law=law), "point", guide("follower"))
    bodies = (Body(name="cam", estimate=(0.0, 0.0, 0.3)), Body(name="follower", estimate=(0.0, height, 0.0)))
    m = Mechanism(bodies=bodies, joints=joints, drivers=(lift,))
    path = refkin.follow(Scene(mechanism=m, times=(height,)), most_points=52)
    turns = np.array([event.q[2] for event in path.turning_points])

    assert len(turns) > 16
    assert np.abs(np.diff(turns)) == pytest.approx(np.full(len(turns) - 1, math.pi / waves), abs=1e-7)


@pytest.mark.parametrize("slack", [1e-9, -1e-9])
def test_curves_of_a_small_linkage_beside_a_large_body_do_not_cross_for_its_size(slack):
    """They pass by each other 3e-5 rad apart; 1e-12 m are much to links of millimetres, not to a body of 1 km."""
    small = FourBar(ground=4e-3, crank=1e-3, coupler=3.5e-3, rocker=(1.5 + slack) * 1e-3)
    path = refkin.follow(beside_a_mast(driven(small, 2.9)), until=(2.9, 3.4))

    assert path.end is TraceEnd.RANGE
    assert [type(event) for event in path.events] == [TurningPoint] * (slack < 0)


def test_time_may_be_the_parameter():
    scene = ROCKER.scene(law=Polynomial(coefficients=(0.3, 2.0)), times=(0.0, 1.0))
    path = refkin.follow(scene)

    assert path.t[-1] == 1.0
    assert path["crank"].phi[-1] == pytest.approx(2.3, abs=1e-15)


@dataclass(frozen=True, kw_only=True)
class Carried(Revolute):
    """A joint of one's own, whose laws have a field of their own."""

    away: tuple[Polynomial, Polynomial]

    @property
    def laws(self):
        return self.away


@pytest.mark.parametrize(("joint", "field"), [(Revolute, "offset_law"), (Carried, "away")])
def test_along_the_value_of_a_driver_all_other_laws_stay_as_they_are_at_the_start(joint, field):
    """A joint's law was asked for its value at the driver's, as if that were time."""
    away = Polynomial(coefficients=(0.1, 0.1)), Polynomial(coefficients=(0.0,))
    pin = joint(name="A", body_i="ground", point_i=(0, 0), body_j="a", point_j=(0, 0), **{field: away})
    other = Revolute(name="B", body_i="ground", point_i=(0, 0), body_j="b", point_j=(0, 0))
    turn = AngleDriver(name="motor", body="a", law=Polynomial(coefficients=(1.0, 2.0)))
    fan = AngleDriver(name="fan", body="b", law=Polynomial(coefficients=(0.5, 0.2)))
    mechanism = Mechanism((Body(name="a"), Body(name="b")), (pin, other), (turn, fan))
    path = refkin.follow(driven_by(Scene(mechanism=mechanism, times=(2.0, 3.0)), "motor"), until=(5.0, 6.0))

    assert path.q[:, -1] == pytest.approx([0.3, 0.0, 6.0, 0.0, 0.0, 0.9])


def test_laws_of_a_joint_that_cannot_be_held_are_refused():
    """They went on with the driver's value for time: wrong, and ok."""

    class Slipping(Carried):
        @property
        def laws(self):
            return tuple(Polynomial(coefficients=law.coefficients) for law in self.away)

    away = Polynomial(coefficients=(0.1, 0.1)), Polynomial(coefficients=(0.0,))
    pin = Slipping(name="A", body_i="ground", point_i=(0, 0), body_j="a", point_j=(0, 0), away=away)
    still = replace(pin, away=(Polynomial(coefficients=(0.3,)), away[1]))
    turn = AngleDriver(name="motor", body="a", law=Polynomial(coefficients=(1.0, 2.0)))
    scenes = [Scene(mechanism=Mechanism((Body(name="a"),), (one,), (turn,)), times=(2.0,)) for one in (pin, still)]

    with pytest.raises(refkin.InvalidRequest, match=r"^joint 'A': expected laws that are fields of it, got \("):
        driven_by(scenes[0], "motor")
    assert driven_by(scenes[1], "motor").mechanism.joints == (still,)


def test_a_driver_is_the_parameter_at_the_values_that_all_drivers_have_at_first():
    scene = driven_by(ROCKER.scene(law=Polynomial(coefficients=(0.3, 2.0, 5.0)), times=(0.1,)), "driver")

    assert scene.times == (pytest.approx(0.55),)
    assert scene.mechanism.drivers[0].law == Polynomial(coefficients=(0.0, 1.0))


def test_laws_of_the_drivers_called_angle_alone_are_angles():
    assert {c.type for c in (*DRIVER_TYPES, *SPATIAL_DRIVER_TYPES) if c.law_is_angle} == {"angle"}


@pytest.mark.parametrize(
    ("laws", "endless"),
    [
        ([("angle", (0.0, 1.0))], True),
        ([("angle", (0.0, 1.0)), ("angle", (0.5,)), ("distance", (2.0, 0.0))], True),
        ([("angle", (0.5,)), ("angle", (0.0, 1.0))], True),
        ([("angle", (0.0, 1.0)), ("angle", (0.5, 0.1))], False),
        ([("angle", (0.0, 2.0))], False),
        ([("angle", (0.5,))], False),
        ([("distance", (0.0, 1.0))], False),
        ([("angle", (0.0, 1.0)), ("angle", None)], False),
    ],
)
def test_a_path_may_come_back_after_a_turn_if_its_t_is_the_one_angle_that_is_driven(laws, endless):
    laws = [
        (kind, Sinusoid(amplitude=0.1, angular_frequency=1.0) if of is None else Polynomial(coefficients=of))
        for kind, of in laws
    ]
    ends = {"body_i": "ground", "point_i": (0.0, 0.0), "body_j": "crank", "point_j": (1.0, 0.0)}
    drivers = [
        AngleDriver(name=str(k), body="crank", law=law)
        if kind == "angle"
        else DistanceDriver(name=str(k), law=law, **ends)
        for k, (kind, law) in enumerate(laws)
    ]

    assert _is_driven_angle(SimpleNamespace(drivers=drivers)) is endless


def test_an_unknown_driver_is_refused_by_name():
    with pytest.raises(refkin.RefkinError, match="there are: driver"):
        driven_by(ROCKER.scene(), "motor")


def test_a_system_alone_is_refused():
    with pytest.raises(refkin.InvalidRequest, match="start"):
        refkin.follow(compile_system(ROCKER.scene().mechanism))


@pytest.mark.parametrize(
    ("name", "value"),
    [
        *(("direction", x) for x in (0, 2, math.nan, "x", None)),
        *(("max_step", x) for x in (0.0, -1.0, math.nan, math.inf, 10**400, "x", None)),
        *(("most_points", x) for x in (0, -1, math.nan, 2.5, None)),
        *(("until", x) for x in (3, ("a", "b"), (0.0, math.nan), (0.0, 1.0, 2.0))),
        *(("start", x) for x in (3, (np.zeros(3), 0.0), (np.zeros(9), "x"), "ab")),
        *(("along", x) for x in (3, Tangent(np.zeros(3), 1.0))),
        ("choose", 3),
    ],
)
def test_an_argument_that_makes_no_sense_is_named_with_its_value(name, value):
    with pytest.raises(refkin.InvalidRequest, match=f"^{name}: expected .*, got ") as refused:
        refkin.follow(ROCKER.scene(), **{name: value})

    assert repr(value)[:20] in str(refused.value)


def test_without_a_first_pose_there_is_no_path():
    scene = LIMITED.scene(law=Polynomial(coefficients=(0.0, 1.0)), times=(0.5,))
    path = refkin.follow(with_law(scene, Polynomial(coefficients=(2.5,))))

    assert path.end is TraceEnd.NO_START
    assert path.t.size == 0
    assert "cannot meet" in path.message


@pytest.mark.parametrize("factor", [2.0**-30, 2.0**30])
def test_a_path_in_another_unit_is_the_same(factor):
    linkage = FourBar(ground=0.9 * factor, crank=0.3 * factor, coupler=0.6 * factor, rocker=0.45 * factor)
    here, there = (refkin.follow(driven(x)) for x in (LIMITED, linkage))

    assert np.max(np.abs(here.t - there.t)) < 1e-12


def test_a_path_of_a_linkage_far_from_its_origin_is_the_same():
    there = replace(LIMITED, origin=(1e8, -1e8))
    here, path = (refkin.follow(driven(x)) for x in (LIMITED, there))

    assert path.end is TraceEnd.CLOSED
    assert [e.t for e in path.events] == pytest.approx([e.t for e in here.events], abs=1e-7)
    assert np.nanmin(path.radius) > 2.0**-28, "half an ulp of 1e8, to which each pose is rounded"


@pytest.mark.parametrize("angle", [0.5, 1.5, 2.5, 4.0, 5.0])
def test_a_point_is_a_pose_in_other_units_and_no_step_from_it_however_long_leads_to_the_other_branch(angle):
    """Of a crank-rocker, where a determinant tells the branches apart all along them."""
    scene = ROCKER.scene(law=Polynomial(coefficients=(angle - 2.0, 4.0)), times=(0.5,))
    system, q = posed(scene)
    curve = Curve.through(system, q, scene.times)
    x = curve.point(q, 0.5)
    assert curve.pose(x)[1] == 0.5

    tangent, side = curve.tangent(x), np.linalg.det(system.phi_q(q, 0.5))
    steps = [curve.stepped(x, tangent, h) for h in np.linspace(0.1, 8.0, 50)]
    assert (steps[0] - x) @ tangent > 0.0
    assert all(np.linalg.det(system.phi_q(*curve.pose(y))) * side > 0.0 for y in steps if y is not None)


def test_tangents_point_along_the_path_all_around():
    """On a closed path, also on its way back: each between the poses before and after it."""
    path = refkin.follow(driven(LIMITED))
    x = np.vstack([path.q, path.t])
    moves = (x[:, 2:] - x[:, :-2]).T
    tangents = [np.append(tangent.q, tangent.t) for tangent in path.tangents[1:-1]]

    assert path.end is TraceEnd.CLOSED
    assert all(np.dot(move, tangent) > 0.0 for move, tangent in zip(moves, tangents, strict=True))


def test_a_path_that_is_to_end_on_one_side_does_not_close_after_a_turn():
    """A crank's angle that has one limit is a number, not a direction: it goes on until that or for ever."""
    path = refkin.follow(driven(ROCKER), until=(0.0, math.inf), most_points=120)

    assert path.end is not TraceEnd.CLOSED
    assert path.t[-1] > 0.5 + math.tau


def test_a_path_starts_at_the_t_that_it_is_given():
    """Near the pose that is given, on the curve, at the same t."""
    scene = driven(ROCKER)
    q = refkin.solve(scene).q[:, 0] + 0.01
    path = refkin.follow(compile_system(scene.mechanism), start=(q, 0.5), until=(0.4, 0.6))

    assert path.t[0] == 0.5
    assert path.residual[0] < 1e-14


@pytest.mark.parametrize("order", [slice(None), slice(None, None, -1)], ids=["crank first", "crank last"])
def test_a_path_along_which_t_stands_still_does_not_turn(order):
    """A folded kite turns about two pins that coincide while the crank rests: t, and its sign, are rounding."""
    kite, a = FourBar(ground=1.0, crank=1.0, coupler=2.0, rocker=2.0), 1.0
    along = np.array([-np.sin(a), np.cos(a), 1.0])
    folded = np.concatenate([[[0.5, 0.0, 0.0]], 2 * [[1.0 + np.cos(a), np.sin(a), a]]])[order].ravel()
    around = Tangent(np.concatenate([np.zeros((1, 3)), [along, along]])[order].ravel(), 0.0)
    scene = driven(kite, 0.0)
    scene = remade(scene, bodies=scene.mechanism.bodies[order])
    path = refkin.follow(scene, (folded, 0.0), along=around, choose=straight_on)

    assert path.end is TraceEnd.CLOSED
    assert np.max(np.abs(path.t)) < 1e-12
    assert path.turning_points == ()
    rocker = [b.q.reshape(3, 3)[order][2, 2] for b in path.bifurcations]
    assert np.abs(np.cos(rocker)) == pytest.approx([1.0, 1.0])


@pytest.mark.parametrize(("linkage", "angle"), [(ROCKER, 0.5), (PARALLELOGRAM, math.pi - 2.5e-3)])
def test_no_step_is_longer_than_the_longest_that_is_asked_for(linkage, angle):
    """Neither the first one nor the one after a bifurcation, which the parallelogram meets after three."""
    path = refkin.follow(driven(linkage, angle), max_step=1e-3, most_points=8, choose=straight_on)
    unit = compile_system(driven(linkage).mechanism, unit=driven(linkage).mechanism.unit()).unit
    steps = np.diff(path.q, axis=1) / np.tile([unit.size, unit.size, 1.0], 3)[:, None]

    assert len(path.t) == 8
    assert len(path.events) == (linkage is PARALLELOGRAM)
    assert np.max(np.abs(steps)) <= 1e-3


@pytest.mark.parametrize(
    ("at", "met"), [((0.5, 0.9), True), ((1.5, 0.0), False), ((-0.5, 0.0), False), ((0.5, 1.1), False)]
)
def test_a_crossing_is_one_between_two_points_if_it_is_beside_their_chord_and_no_further_than_it_is_long(
    monkeypatch, at, met
):
    there = SimpleNamespace(x=2.0 * np.array(at), is_decided=True, forms=[None])
    monkeypatch.setattr(tracing, "crossing", lambda *_: there)
    tracer = Tracer(None, (0.0, 1.0), 1.0, 9)

    assert tracer._crossing(np.zeros(2), np.array([2.0, 0.0])) is (there if met else None)


@pytest.mark.parametrize(
    ("first", "inside", "last", "length", "unseen"),
    [
        (0.9 * LOST, -0.1, 0.5, 0.3, True),
        (0.5, -0.1, -0.9 * LOST, 0.3, False),
        (0.5, 0.1, 0.9 * LOST, 0.3, False),
        (0.5, math.nan, 0.9 * LOST, 0.3, True),
        (1.1 * LOST, -0.1, 0.5, 0.3, False),
        (0.5 * STANDING, -0.1, 0.5, 0.3, False),
        (0.9 * LOST, -0.1, 0.5, 0.5 * CLOSE, False),
    ],
)
def test_t_turns_unseen_in_a_step_where_a_tangent_that_strays_can_lose_it(first, inside, last, length, unseen):
    """By the rates of t at both ends and inside, NaN where there is no point: asked where one at an end is small."""
    x, places, (before, between, after) = np.ones(3), [], (np.array([1.0, 0.0, r]) for r in (first, inside, last))

    def corrected(guess, across):
        places.append((guess - x)[0] / length)
        return SimpleNamespace(converged=not (math.isnan(inside) and len(places) > 2), q=guess)

    tracer = Tracer(SimpleNamespace(corrected=corrected, tangent=lambda *_: between), (0.0, 1.0), 1.0, 9)

    assert tracer._turns_unseen(x, before, x + np.array([length, 0.0, 0.0]), after, length) is unseen
    assert not places or places == pytest.approx(INSIDE)


@pytest.mark.parametrize("length", [1.0, 1e-3, 1e3])
def test_the_length_of_tangents_is_nothing_to_the_path_that_is_chosen(length):
    """Neither to the one that is nearest, nor to the first step in it."""
    first, near, far = (Tangent(np.array(q), 1.0) for q in ((1.0, 0.0), (length, 0.1 * length), (1.0, 2.0)))
    assert straight_on(Bifurcation(0.0, np.zeros(2), (near, far), first, 0)) is near

    def longer(crossing):
        chosen = straight_on(crossing)
        return Tangent(length * chosen.q, length * chosen.t)

    path = refkin.follow(driven(PARALLELOGRAM, 3.0), until=(3.0, 3.5), choose=longer)
    k = path.events[0].index
    unit = np.tile([PARALLELOGRAM.scene().mechanism.size()] * 2 + [1.0], 3)
    assert np.linalg.norm((path.q[:, k + 1] - path.q[:, k]) / unit) == pytest.approx(FIRST_STEP, rel=0.5)


def test_a_path_whose_drivers_leave_float64_is_refused():
    """It ended in a LinAlgError of NumPy's."""
    law = Polynomial(coefficients=(0.3, 0.0, 1e308))

    with pytest.raises(refkin.InvalidRequest, match="rates"):
        refkin.follow(ROCKER.scene(law=law, times=(0.0, 0.5)))


KNOWN = Table(argument=(0.0, 0.5, 1.0, 2.0), value=(0.3, 0.6, 0.7, 1.1))


def by_table(linkage, of_rate):
    scene = linkage.scene(law=KNOWN, times=(0.25,))
    (driver,) = scene.mechanism.drivers
    own = replace(driver, law=None, rate_law=KNOWN, initial=0.3) if of_rate else driver
    return remade(scene, drivers=(own,))


@pytest.mark.parametrize("until", [None, (-3.0, 3.0)])
@pytest.mark.parametrize(("direction", "last"), [(1, 2.0), (-1, 0.0)])
@pytest.mark.parametrize("of_rate", [False, True])
def test_a_path_ends_where_the_table_of_a_law_does_and_says_so(of_rate, direction, last, until):
    path = refkin.follow(by_table(ROCKER, of_rate), direction=direction, until=until)

    assert path.end is TraceEnd.RANGE
    assert path.message.endswith("the parameter leaves its range: the table of driver ends")
    assert path.t[-1] == last
    assert np.all(path.radius < 1e-12)


def test_a_path_ends_where_the_profile_of_a_cam_does_and_says_so():
    profile = Polar(law=Table(argument=(-0.6, 0.0, 0.5, 1.0), value=(1.0, 1.1, 1.3, 1.2)))
    joints, _ = cam(profile, "point", guide("follower"))
    turn = AngleDriver(name="motor", body="cam", law=Polynomial(coefficients=(0.0, 1.0)))
    start = math.pi / 2 - 0.3
    bodies = Body(name="cam", estimate=(0.0, 0.0, start)), Body(name="follower", estimate=(0.0, 1.2, 0.0))
    path = refkin.follow(Scene(mechanism=Mechanism(bodies=bodies, joints=joints, drivers=(turn,)), times=(start,)))

    assert path.end is TraceEnd.STOPPED
    assert path.message.endswith("the contact of contact leaves its profile")


@pytest.mark.parametrize("t", [-0.25, 0.5, 1.25])
def test_beyond_an_open_table_of_a_rate_a_path_has_the_integral_of_its_last_piece(t):
    """A Bricard's path to the end of its table was lost at 1 - 5e-12: beyond it only the rate went on."""
    rate = Table(argument=(0.0, 0.4, 0.7, 1.0), value=(1.0, 1.5, 0.5, 2.0))
    scene = ROCKER.scene(law=Integral(rate=rate, initial=0.3), times=(0.0, 1.0))
    law, h = continued(scene.mechanism).drivers[0].laws[0], 1e-4

    assert (law(t + h) - law(t - h)) / (2 * h) == pytest.approx(law(t, 1), rel=1e-6)


def test_what_runs_away_from_a_step_is_not_waited_for_where_curves_might_cross(monkeypatch):
    """Of a tree of 13 bodies a step took a second: Newton sought a crossing a thousand sizes away, 25 iterations."""
    asked, bend = [], Curve.bend
    monkeypatch.setattr(Curve, "bend", lambda *a: asked.append(a) or bend(*a))
    path = refkin.follow(refkin.load(CORPUS / "features-branching-tree.toml"))

    assert (path.end, path.t[-1]) == (TraceEnd.RANGE, 1.0)
    assert 0 < len(asked) < 50
