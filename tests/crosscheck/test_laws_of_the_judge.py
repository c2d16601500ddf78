"""What judgements rest on, held against differences and against bodies that are turned by products of quaternions."""

from __future__ import annotations

import math
from dataclasses import replace
from functools import cache
from itertools import product as every
from types import SimpleNamespace

import numpy as np
import pytest
from flint import arb, ctx
from scipy.interpolate import CubicSpline
from scipy.spatial.transform import Rotation

import refkin
from crosscheck.engines import EngineError, Level, Term
from crosscheck.engines.exudyn.solve import solved as solved_or_not
from crosscheck.engines.exudyn.space_solve import SpaceEquations
from crosscheck.engines.frames import Length, Linear, RowMap, SineRow
from crosscheck.engines.loading import load
from crosscheck.engines.spatial.kinds import JointKind
from crosscheck.engines.spatial.reading import Hold
from crosscheck.engines.spatial.turning import (
    bends,
    conjugate,
    continuous,
    joint_frame,
    matrix,
    parameters,
    product,
    rates,
)
from crosscheck.judge.agreement import assert_agrees
from crosscheck.judge.budget import BOTH_SIDES, _first_order, carried
from crosscheck.judge.changes import change
from crosscheck.judge.comparison import QUANTITIES, compare, reference
from crosscheck.judge.hard_poses import TOO_WIDE, _judged, least_error, residual_error, samples, scene_truths
from crosscheck.judge.levels import LEVELS, Configuration, _mapped, configurations
from crosscheck.judge.records import Cause
from crosscheck.judge.rounding import SAFETY, SOME, _spline_error, output_rounding, solve_error, table_error
from crosscheck.judge.running_error import Running, U
from crosscheck.judge.samples import histogram, input_sensitivity, sharpness
from crosscheck.judge.spatial import _half_angle, alike, passive_lines, reversed_joints, spun
from crosscheck.judge.truth import CertifiedTruth
from crosscheck.judge.uncompared import Uncompared
from crosscheck.measure.check import check
from refkin import AngleDriver, Distance, FourBar, Polynomial, SliderCrank, Table, compile_system
from refkin.joints import Prismatic, Revolute
from refkin.motion import Status, point_motion
from refkin.motion_laws import Integral
from refkin.proof.numbers.bounded import Times
from refkin.proof.numbers.exact import exact
from refkin.proof.pose.krawczyk import Verdict
from refkin.scenes.linkages import RSSR, Bennett
from tests.crosscheck.exact_linkages import scotch_yoke
from tests.crosscheck.space_scenes import AT, GROUND, SpatialRevolute, axes, between, motor, rssr, two_slides
from tests.crosscheck.space_scenes import scene as spatial_scene
from tests.linkages import ROCKER, moved_frame
from tests.places import CORPUS

RULE = Term(name="stopping rule", level="position", reason="made up", absolute=1e-8)
X, Y = Running(1.7, 3e-7), Running(-0.6, 2e-7)
OPERATIONS = {
    "sum": (lambda x, y: x + y),
    "difference": (lambda x, y: x - y),
    "product": (lambda x, y: x * y),
    "a number more": (lambda x, y: x + 0.3 + (0.2 + y)),
    "a number less": (lambda x, y: (x - 0.3) - (0.2 - y)),
    "a multiple": (lambda x, y: x * -2.5 + 1.5 * y),
    "a part": (lambda x, y: x / 4.1 + y),
    "the negative": (lambda x, y: -x - y),
    "circular functions": (lambda x, y: np.sin(x) + np.cos(y) if isinstance(x, float) else x.sin() + y.cos()),
    "a function": (lambda x, y: np.exp(x) + y if isinstance(x, float) else x.through(lambda v, _: np.exp(v)) + y),
}


@pytest.mark.parametrize("name", OPERATIONS)
def test_an_error_is_carried_as_far_as_its_corners_move(name):
    operation = OPERATIONS[name]
    result, exact = operation(X, Y), operation(X.value, Y.value)
    ends = [(v.value - v.error, v.value + v.error) for v in (X, Y)]
    moved = max(abs(operation(x, y) - exact) for x, y in every(*ends))

    assert result.value == exact
    assert result.error == pytest.approx(moved, rel=1e-5, abs=0.0)


@pytest.mark.parametrize("name", OPERATIONS)
def test_exact_numbers_gain_the_rounding_of_each_operation(name):
    result = OPERATIONS[name](Running(X.value), Running(Y.value))

    assert U * abs(result.value) * (name != "the negative") <= result.error <= 20 * U


@cache
def solved():
    """The reference of a four-bar in another unit, away from its origin, whose crank speeds up."""
    linkage = replace(ROCKER, origin=(3.0, -2.0))
    return reference(linkage.scene(law=Polynomial(coefficients=(0.3, 1.3, 0.4)), times=(0.0, 0.7)))


def moved_levels(system, levels, t, errors):
    """Return the three levels that solve the equations with errors (m,) of the residuals of each level."""
    q, slope = levels[0].copy(), system.phi_q
    for _ in range(6):
        q -= np.linalg.solve(slope(q, t), system.phi(q, t) - errors[0])
    qd = np.linalg.solve(slope(q, t), system.nu(q, t) + errors[1])
    return np.array([q, qd, np.linalg.solve(slope(q, t), system.gamma(q, qd, t) + errors[2])])


@pytest.mark.parametrize("sample", [0, 1])
def test_errors_of_residuals_are_carried_as_far_as_the_solution_moves(sample):
    """Central differences of the solutions of disturbed equations, one row of one level after the other."""
    ref, h = solved(), 1e-4
    own, t = [level[:, sample] for level in ref.levels], float(ref.motion.t[sample])
    moves = carried(ref.system, *ref.levels, ref.motion.t)
    for row in range(ref.system.m):
        for level, columns in enumerate((moves.phi, moves.nu, moves.gamma)):
            disturbed = np.zeros((3, ref.system.m))
            disturbed[level, row] = h
            ends = (moved_levels(ref.system, own, t, sign * disturbed) for sign in (1, -1))
            difference = np.abs(np.subtract(*ends)) / (2 * h)
            for order, column in enumerate(columns, level):
                assert column[:, row, sample] == pytest.approx(difference[order], rel=1e-5, abs=1e-6)


def test_first_order_ends_where_the_jacobian_changes_by_a_tenth_of_itself():
    ref, h = solved(), 1e-5
    system, q, t = ref.system, ref.levels[0], ref.motion.t
    direction = np.linspace(0.5, 1.5, system.n)[:, None] * np.array([1.0, 2.0])
    change = (system.phi_q(q + h * direction, t) - system.phi_q(q - h * direction, t)) / (2 * h)
    inverse = np.abs([np.linalg.inv(system.phi_q(q, t)[..., k]) for k in (0, 1)])
    shares = [np.max(np.sum(inverse[k] @ np.abs(change[..., k]), axis=1)) for k in (0, 1)]
    ends, stacked = 0.1 / np.array(shares), np.moveaxis(inverse, 0, -1)

    assert _first_order(system, stacked, direction * ends * 0.999, q, t).tolist() == [True, True]
    assert _first_order(system, stacked, direction * ends * [1.001, 0.999], q, t).tolist() == [False, True]


def leaving(ref, residual):
    """Return the reference's answer with so much (m, T) left of the position's residual, in scaled coordinates."""
    moved = np.array(ref.levels)
    for k, t in enumerate(ref.motion.t.tolist()):
        errors = np.outer([1.0, 0.0, 0.0], residual[:, k])
        moved[..., k] = moved_levels(ref.system, [*moved[..., k]], t, errors)
    levels = (ref.system.to_physical(level, order) for order, level in enumerate(moved))
    return replace(ref.motion, **dict(zip(("q", "qd", "qdd"), levels, strict=True)))


@pytest.mark.parametrize(("part", "beyond"), [(0.99, False), (2.5, True)])
def test_an_error_within_a_stopping_rule_is_allowed_what_its_square_does(part, beyond):
    """To first order a rocker next to a crossing is not moved across: it was beyond by 13 times its acceleration."""
    ref, rule = reference(refkin.load(CORPUS / "exudyn-shipped-beside-a-crossing.toml")), replace(RULE, absolute=4e-9)
    slope = np.moveaxis(ref.system.phi_q(ref.levels[0], ref.motion.t), -1, 0)
    answer = leaving(ref, part * rule.absolute * np.sign(np.linalg.svd(slope)[0][..., -1]).T)
    off = ref.system.to_unit(answer.qdd, 2) - ref.levels[2]

    assert (np.abs(off) > ref.propagation.budget([rule]).levels[2]).any()
    assert compare(ref, answer, [rule]).agrees is not beyond


TURN = Polynomial(coefficients=(0.0, 1.0))
STROKE = replace(scotch_yoke().scene.mechanism, drivers=(AngleDriver(name="motor", body="crank", law=TURN),))
POINT = refkin.Point(name="P", body="yoke", position=(0.1, 0.2))
YOKE = refkin.Scene(mechanism=STROKE, times=(0.5 * math.pi, 2.0), points=(POINT,))
STRETCHED = SliderCrank(crank=1.0, rod=2.5).scene(law=TURN, times=(0.0, 0.3))


@pytest.mark.parametrize("scene", [YOKE, STRETCHED])
@pytest.mark.parametrize(("part", "beyond"), [(0.99, False), (4.0, True)])
def test_a_square_counts_wherever_the_first_order_cancels(scene, part, beyond):
    """Far from any singular pose, too: where a yoke, or the rod of a slider-crank, is fastest it was beyond."""
    ref, rule = reference(scene), replace(RULE, absolute=1e-5)
    residual = np.zeros((ref.system.m, 2))
    residual[-1] = part * rule.absolute

    assert compare(ref, leaving(ref, residual), [rule]).quantities["velocity"].agrees is not beyond


@pytest.mark.parametrize("sign", [1.0, -1.0])
@pytest.mark.parametrize(("part", "beyond"), [(0.999, False), (1.1, True)])
def test_what_a_rule_leaves_may_do_what_it_does_beyond_first_order_also_where_that_is_little(sign, part, beyond):
    """By a hundredth of the position's, twice and three times that of the rates', it was beyond."""
    ref = reference(SliderCrank(crank=1.0, rod=1.01).scene(law=TURN, times=(0.5 * math.pi,)))
    last = np.linalg.svd(ref.system.phi_q(ref.levels[0], ref.motion.t)[..., 0])[0][:, -1:]
    compared = compare(ref, leaving(ref, sign * part * 1e-4 * np.sign(last)), [replace(RULE, absolute=1e-4)])

    assert [compared.quantities[quantity].agrees for quantity in QUANTITIES] == [not beyond] * 3


def pushed_along():
    """Return two bars that nearly lie in line, from pin to pin of a slide that is pushed along: nothing turns."""
    ends = {"body_i": GROUND, "point_i": (0.0, 0.0), "body_j": "slide", "point_j": (0.0, 0.0)}
    pins = [("slide", (0.0, 0.0), "a", (0.0, 0.0)), ("a", (1.0, 0.0), "b", (1.0, 0.0))]
    pins.append(("slide", (2.0 - 2e-9, 0.0), "b", (0.0, 0.0)))
    bars = [Revolute(name=i + j, body_i=i, point_i=u, body_j=j, point_j=v) for i, u, j, v in pins]
    driver = refkin.XDriver(name="motor", body="slide", law=TURN)
    turns = {"slide": (0.0, 0.0), "a": (0.0, 4.5e-5), "b": (2.0, math.pi - 4.5e-5)}
    bodies = [refkin.Body(name=name, estimate=(x, 0.0, phi)) for name, (x, phi) in turns.items()]
    joints = [Prismatic(name="guide", axis_i=(1.0, 0.0), **ends), *bars]
    return refkin.Scene(mechanism=refkin.Mechanism(bodies, joints, (driver,)), times=(0.5,))


@pytest.mark.parametrize(("more", "beyond"), [(0.0, False), (1e-12, True)])
def test_a_velocity_that_is_rounded_may_do_what_its_square_does_where_nothing_turns(more, beyond):
    """No first order is there: exudyn, asked in another order of bodies, was beyond by 8e7 times with 1e-23 rad/s^2."""
    ref = reference(pushed_along())
    sign = np.sign(np.linalg.svd(ref.system.phi_q(ref.levels[0], ref.motion.t)[..., 0])[0][:, -1])
    errors = np.outer([0.0, 1.0, 0.0], 0.4 * sign * ref.propagation.of_rows[1][:, 0])
    moved = moved_levels(ref.system, [level[:, 0] for level in ref.levels], 0.5, errors)
    qd, qdd = (ref.system.to_physical(level[:, None], k) for k, level in enumerate(moved[1:], 1))
    answer = replace(ref.motion, qd=qd, qdd=qdd + more)

    assert np.max(np.abs(qdd)) > 2.0 * np.max(ref.budget().levels[2])
    assert compare(ref, answer).agrees is not beyond


def test_a_point_and_a_message_go_by_what_a_body_was_held_against():
    """A yoke was within what its square is allowed, and a point of it was not; what is beyond was said to be 1e4."""
    ref, residual = reference(YOKE), np.zeros((6, 2))
    answers = []
    for part in (0.99, 4.0):
        residual[-1] = part * 1e-5
        answer = leaving(ref, residual)
        moved = point_motion(POINT.position, *(level[3:] for level in answer.levels))
        answers.append(replace(answer, points={"P": moved}))
    assert_agrees(answers[0], YOKE, residual=1e-5)

    compared = compare(ref, answers[1], [replace(RULE, absolute=1e-5)]).quantities["velocity"]
    with pytest.raises(AssertionError, match=f"yoke.xd .* {compared.ratio[0]:.3g} times the allowed"):
        assert_agrees(answers[1], YOKE, residual=1e-5)


def test_a_residual_that_leads_to_no_pose_adds_nothing():
    """A square is that of an error within the same assembly."""
    ref = reference(FourBar(ground=2.0, crank=1.0, coupler=2.0, rocker=1.0 + 1e-9).scene(law=TURN, times=(1e-3,)))
    budget = ref.propagation.budget([RULE])
    more = ref.propagation.second_order(budget, [replace(RULE, absolute=1e-2)], np.array([True]))

    assert np.array_equal(more.levels, budget.levels)


def test_lu_leaves_a_rounding_of_its_largest_row_for_each_row_in_the_norm_of_all():
    assert solve_error(np.array([[1.0, 4.0], [3.0, 2.0], [2.0, 5.0]])).tolist() == [9.0 * U, 15.0 * U]


def test_what_rates_may_be_off_is_solved_for_with_them():
    """At sigma_min = 1e-7 accelerations of 0.07 are off by 500; of that QR left in the crank 36 times what it may."""
    law = Polynomial(coefficients=(np.pi - 0.5 - 1e-6, 0.5))
    ref = reference(FourBar(ground=4.0, crank=1.0, coupler=4.0, rocker=1.0).scene(law=law, times=(0.0, 1.0)))
    system, t, q = ref.system, 1.0, ref.levels[0][:, 1]
    q = q + 1e-9 * np.linalg.svd(system.phi_q(q, t))[2][-1]
    rng, levels = np.random.default_rng(0), [level.copy() for level in ref.motion.levels]
    for _ in range(20):
        rows, columns = rng.permutation(9), rng.permutation(9)

        def by_qr(right, rows=rows, columns=columns):
            turned, upper = np.linalg.qr(system.phi_q(q, t)[np.ix_(rows, columns)])
            return np.linalg.solve(upper, turned.T @ right[rows])[np.argsort(columns)]

        qd = by_qr(system.nu(q, t))
        for order, level in enumerate((q, qd, by_qr(system.gamma(q, qd, t)))):
            levels[order][:, 1] = system.to_physical(level, order)
        assert compare(ref, replace(ref.motion, q=levels[0], qd=levels[1], qdd=levels[2])).agrees


def moved_by_velocity(ref, own, t):
    """Return how errors of the rows of the velocity move the acceleration, (n, m), by central differences."""
    errors = np.zeros((ref.system.m, 3, ref.system.m))
    errors[:, 1] = 1e-4 * np.eye(ref.system.m)
    ends = [[moved_levels(ref.system, own, t, sign * row)[2] for row in errors] for sign in (1, -1)]
    return np.subtract(*np.array(ends)).T / 2e-4


@pytest.mark.parametrize("in_gamma", [0.0, 0.25])
def test_no_residual_of_a_norm_moves_a_rate_further_than_the_worst_of_that_norm(in_gamma):
    """The worst for a component is along its row of the inverse, and moves it as far as is said."""
    ref = solved()
    t, slope = float(ref.motion.t[0]), ref.system.phi_q(ref.levels[0][:, 0], float(ref.motion.t[0]))
    _, velocity, acceleration = carried(ref.system, *ref.levels, ref.motion.t).of_norm(np.ones(2), np.full(2, in_gamma))
    rows = np.linalg.inv(slope)
    own = np.array([level[:, 0] for level in ref.levels])
    stacked = np.zeros((ref.system.n, 3, ref.system.m))
    stacked[:, 1] = rows / np.linalg.norm(rows, axis=1)[:, None]
    moved = np.array([moved_levels(ref.system, own, t, 1e-4 * errors) - own for errors in stacked]) / 1e-4
    largest = np.linalg.norm(moved_by_velocity(ref, own, t), axis=1) + in_gamma * np.linalg.norm(rows, axis=1)

    assert velocity[:, 0] == pytest.approx(np.diagonal(moved[:, 1]), rel=1e-6)
    assert acceleration[:, 0] == pytest.approx(largest, rel=1e-5)


def test_an_answer_is_rounded_once_for_each_arm_and_as_far_as_it_lies_from_the_origin():
    """Three arms, six roundings each, or as many as the largest angle is, which turns them; rates likewise."""
    system = compile_system((mechanism := ROCKER.scene().mechanism), unit=mechanism.unit())
    size = system.unit.size
    q = np.array([[40.0, 1.0, 0.5, 2.0, -70.0, -9.0, 1.0, 1.0, 4.0]]).T
    qd = np.array([[0.5, -7.0, 2.0, 1.0, 1.0, 1.0, 1.0, 1.0, 1.0]]).T
    qdd = np.array([[0.5, 2.0, -11.0, 1.0, 1.0, 1.0, 1.0, 1.0, 1.0]]).T
    x, v, a = output_rounding(system, system.to_unit(q), qd, qdd, np.zeros(1))
    expected = [max(9.0, 40.0 / size), 9.0, 9.0, 9.0, max(9.0, 70.0 / size), 9.0, 9.0, 9.0, 9.0]

    assert x[:, 0] / (6 * U) == pytest.approx(expected)
    assert v / (6 * U) == pytest.approx(9 * 7.0)
    assert a / (6 * U) == pytest.approx(9 * (11.0 + 2.0 * 7.0))  # the largest alpha or a, omega times the largest v


FAR = 2.0**14


def test_a_frame_far_from_its_joints_is_in_what_accelerations_are_allowed_once_and_not_squared():
    """With the crank's frame 16384 m off, the other bodies were allowed 40 times more than its arm explains."""
    scene = ROCKER.scene(times=(0.0, 0.3, 0.7))
    scenes = scene, moved_frame(scene, "crank", (-FAR, 0.0))
    near, away = (reference(one).budget().levels[2, 3:] for one in scenes)

    assert np.all(away <= FAR * np.max(near, axis=0))


def test_a_body_that_is_placed_by_another_whose_frame_is_far_off_is_rounded_there_and_back():
    """Composed of rocker and coupler, the crank was off by 186 times what it was allowed; its rates were not."""
    ref = reference(moved_frame(ROCKER.scene(times=(0.0, 0.3, 0.7, 1.1)), "coupler", (-FAR, 0.0)))
    crank, coupler, rocker = (ref.motion[name].q for name in ("crank", "coupler", "rocker"))
    a, b = (joint for joint in ref.scene.mechanism.joints if "coupler" in (joint.body_i, joint.body_j))

    def ahead(phi, point):
        return np.array([np.cos(phi) * point[0], np.sin(phi) * point[0]])

    placed = rocker[:2] + ahead(rocker[2], b.point_j) - ahead(coupler[2], b.point_i)
    q = np.array(ref.motion.q)
    q[:2] = placed + ahead(coupler[2], a.point_j) - ahead(crank[2], a.point_i)

    assert np.max(np.abs(q[:2] - crank[:2])) > 1e3 * U
    assert compare(ref, replace(ref.motion, q=q)).agrees


@pytest.mark.parametrize(("name", "least"), [("rack_and_pinion", 1e-16), ("spatial-displacement-driver", 1e-33)])
def test_what_slides_evenly_is_allowed_what_turns_leave_that_are_rounded_or_those_of_its_wheel(name, least):
    """It was allowed 0: who finds turns of 1e-17 rad/s, by QR, leaves 1e-34, and at a wheel's teeth 1e-16 omega v."""
    rounding = reference(refkin.load(CORPUS.parents[1] / f"docs/scenes/{name}.toml")).propagation.rounding[2]

    assert least < np.min(rounding) < 1e4 * least


def test_a_massless_link_is_an_arm_as_a_body_is():
    """The end of a rod on a massless crank is a sum of both: Pinocchio's was off by 1.4 times what one arm may be."""
    mechanism = refkin.load(CORPUS / "massless-link-near-limit.toml").mechanism
    system = compile_system(mechanism, unit=mechanism.unit())
    still, turning = np.zeros((system.n, 1)), np.ones((system.n, 1))
    links = sum(isinstance(joint, Distance) for joint in mechanism.joints)

    assert links == 1
    rates = output_rounding(system, still, turning, still, np.zeros(1))[1]
    assert rates / (6 * U) == pytest.approx(len(mechanism.bodies) + links)


@pytest.mark.parametrize("size", [1e-6, 1.0, 1e6])
def test_a_parameter_of_a_turn_is_rounded_as_itself_whatever_the_size(size):
    """Of a mechanism of a micrometre it was allowed a million roundings."""
    mechanism = refkin.load(CORPUS / "space-turns-of-a-tiny-linkage.toml").mechanism
    system = compile_system(mechanism, unit=replace(mechanism.unit(), size=size))
    still, turns = np.zeros((system.n, 1)), system.turns == 2.0
    rounding = output_rounding(system, 1.0 * turns[:, None], still, still, np.zeros(1))[0]

    assert rounding[turns] / (6 * U) == pytest.approx(len(mechanism.bodies) + 1)  # a massless link


def off_the_exact(law, times, order):
    with ctx.workprec(200):
        return np.array([abs(float(arb(float(law(t, order))) - exact(law)(arb(t), order))) for t in times])


@pytest.mark.parametrize("order", [0, 1, 2])
def test_a_table_is_rounded_by_its_largest_value_over_its_finest_step(order):
    table = Table(argument=(0.0, 0.5, 0.75, 1.5), value=(0.3, -2.5, 0.2, 0.1))
    mechanism = ROCKER.scene(law=table, times=(0.2, 0.75)).mechanism
    system, t = compile_system(mechanism, unit=mechanism.unit()), np.array([0.2, 0.75])
    (row,) = (p.row for p in system.placed if p.constraint.laws)
    off = table_error(system, Times(t, order), order)
    assert off[row] / (SOME * U) == pytest.approx(2.5 / 0.25**order * np.maximum(1.0, np.abs(table(t, 0))))
    assert not np.delete(off, row, axis=0).any()


STEPS = {
    "one short": [1.0, 1.0, 1.0, 1e-6, 1.0, 1.0, 1.0],
    "first short": [1e-6, *[1.0] * 6],
    "second short": [1.0, 1e-3, *[1.0] * 5],
    "growing": [4.0**k for k in range(8)],
    "uneven": [0.3, 1.0, 0.02, 0.5, 0.01, 0.7, 0.2],
    "even": [1.0] * 7,
}


@pytest.mark.parametrize("periodic", [False, True])
@pytest.mark.parametrize("steps", STEPS.values(), ids=STEPS)
def test_a_table_is_allowed_what_its_values_move_it_by_and_a_short_step_frees_none_far_from_it(steps, periodic):
    """Each value is moved by as much as it is rounded, in the direction that is worst; the bound has 32 of these."""
    x = np.concatenate([[0.0], np.cumsum(steps)])
    t = np.sort(np.concatenate([x, *(x[:-1] + part * np.diff(x) for part in (0.1, 0.5, 0.9))]))
    table = Table(argument=tuple(x.tolist()), value=(1.0,) * len(x), periodic=periodic)
    rows = np.vstack([np.eye(len(x))[1:-1], np.eye(len(x))[0] + np.eye(len(x))[-1] * periodic])
    ends = "periodic" if periodic else "not-a-knot"
    for order in (1, 2):
        moved = np.sum([np.abs(CubicSpline(x, row, bc_type=ends)(t, order)) for row in rows], axis=0)
        allowed = _spline_error(table, order, t) / U

        assert np.all(moved < allowed)
        if steps == STEPS["one short"]:
            assert np.max(allowed[t < 1.0]) < 500.0 * np.max(moved[t < 1.0])


@pytest.mark.parametrize("rate", [False, True])
def test_a_table_of_uneven_steps_is_allowed_what_its_spline_is_off(rate):
    """With arguments 0.01 apart between others 7 apart SciPy's spline is off by 5e-11: all engines were wrong alike."""
    table = Table(argument=(0.0, 1.0, 1.01, 8.0), value=(0.0, 1.0, 1.01, 2.0))
    law = Integral(rate=table) if rate else table
    record = check(ROCKER.scene(law=law, times=tuple(np.linspace(0.0, 6.0, 9).tolist())), ["closed_form"])

    assert not record.disagreements
    assert 0.05 < record.answers[0].quantities["position"].ratio < 0.75


def test_a_table_of_uneven_steps_whose_scene_has_no_assembly_is_judged_as_any_other():
    """No time was held against its exact spline, and the check ended in an error of Python."""
    table = Table(argument=(0.0, 1.0, 1.01, 8.0), value=(0.0, 0.1, 0.11, 0.3))
    mechanism = (
        replace(ROCKER, coupler=1.5, rocker=2.0).scene(law=Polynomial(coefficients=(0.3,)), times=(0.0,)).mechanism
    )
    driver = AngleDriver(name="motor", body="crank", law=replace(table, value=tuple(3.0 + v for v in table.value)))
    apart = refkin.Scene(mechanism=replace(mechanism, drivers=(driver,)), times=(0.0, 2.0))

    assert not check(apart, ["exudyn"], {"expected": "unassemblable"}).disagreements


def test_a_rate_table_is_allowed_what_the_areas_that_it_adds_up_are_off():
    """A thousand steps to 500 rad and back: the law is off by 2500 units, and every engine was in another assembly.

    Of a law of one's own as much is allowed, whatever the law that engines are given happens to be off by.
    """
    rates = [math.copysign(100.0, 499.5 - k) * (1.0 + 0.1 * (k * 7919 % 97) / 97) for k in range(1001)]
    table = Table(argument=tuple(0.01 * k for k in range(1001)), value=tuple(rates))
    law, late = Integral(rate=table), np.linspace(8.0, 10.0, 20001)
    times = sorted(late[np.argsort(np.abs(law(late)))[:3]].tolist())
    record = check(ROCKER.scene(law=law, times=times), ["closed_form", "pinocchio"])
    off = np.max(off_the_exact(law, times, 0))

    assert not record.disagreements
    assert [answer.quantities["position"].ratio < 0.75 for answer in record.answers] == [True, True]
    assert 1000 * U < off < _spline_error(law, 0, late)[0] < 20 * off


def test_an_answer_that_balls_cannot_judge_is_as_far_off_as_its_worst_coordinate():
    """In what may be off; one coordinate of which too little is known is enough."""
    system = compile_system(ROCKER.scene().mechanism)
    away, rows = np.linspace(0.1, 0.9, system.n) * TOO_WIDE, np.arange(system.n)
    allowed = np.where(rows == 4, 2.0 * TOO_WIDE, 0.0)
    judgement = _judged(system, (arb(0),) * system.n, allowed, away, rows, 0.0)

    assert judgement.verdict is Verdict.UNDECIDABLE
    assert judgement.radii == pytest.approx(0.9)


@pytest.mark.parametrize(("terms", "within", "beyond"), [((), 8 * U, 64 * U), ((RULE,), 0.99e-8, 1.01e-8)])
def test_a_singular_pose_closes_up_to_rounding_and_what_the_engine_adds(terms, within, beyond):
    """Nothing else holds an answer there: a body is off by so many sizes."""
    law, linkage = Polynomial(coefficients=(np.pi - 0.5, 1.0)), replace(ROCKER, rocker=1.5)
    ref = reference(linkage.scene(law=law, times=(0.0, 0.5)))
    move = np.zeros_like(ref.motion.q)
    move[1, 1] = ref.scene.mechanism.size()
    moved = [replace(ref.motion, q=ref.motion.q + off * move, status=(Status.OK,) * 2) for off in (within, beyond)]

    assert ref.motion.status[1] is Status.SINGULAR
    assert [[fault["kind"] for fault in Uncompared(ref, motion, terms).unclosed()] for motion in moved] == [
        [],
        [Cause.UNCLOSED],
    ]


def row_values(x, rate, gamma, slope, off):
    """A row's value, rate, gamma and slope, with their errors, as the judge has them."""
    pairs = ((x, off[0]), (slope, off[3]), (rate, off[1]), (gamma, off[2]))
    return {level: (np.array([value]), np.array([error])) for level, (value, error) in zip(Level, pairs, strict=False)}


@pytest.mark.parametrize("form", [Linear(), SineRow(0.0), Length(1.5)], ids=str)
@pytest.mark.parametrize("level", list(Level)[:4], ids=str)
def test_a_row_in_another_form_is_its_derivative_and_may_be_off_as_far_as_ours(level, form):
    """y(x(s)) with x = 0.4 + 0.7 s - gamma s^2 / 2, as where q'' is zero; differences of y, and of y at the corners."""
    row, h = RowMap(constraint="c", row=0, engine_row=0, factor=-2.0, form=form), 1e-4
    numbers, off = (0.4, 0.7, 0.9, np.array([0.3, -1.1])), (1e-6, 2e-6, 3e-6, np.array([4e-6, 5e-6]))

    def expected(x, rate, gamma, slope):
        def y(s):
            return -2.0 * form(x + rate * s - gamma * s * s / 2, 0)

        if level is Level.RESIDUAL:
            return y(0.0)
        if level is Level.JACOBIAN:
            return slope * -2.0 * (form(x + h, 0) - form(x - h, 0)) / (2 * h)
        return (y(h) - y(-h)) / (2 * h) if level is Level.CONSTRAINT_VELOCITY else -(y(h) + y(-h) - 2 * y(0.0)) / h**2

    value, allowed = (part[0] for part in _mapped([row], [0], row_values(*numbers, off))[level])
    middle = expected(*numbers)
    corners = [
        [n + sign * e for n, e, sign in zip(numbers, off, signs, strict=True)] for signs in every(*4 * [(-1, 1)])
    ]
    moved = np.max([np.abs(expected(*corner) - middle) for corner in corners], axis=0)

    assert value == pytest.approx(middle, rel=1e-6, abs=0.0)
    assert np.all(moved * 0.99 <= allowed / (BOTH_SIDES * SAFETY))
    assert np.all(allowed / (BOTH_SIDES * SAFETY) <= 2.5 * moved)


@pytest.mark.parametrize("rate", [0.1, 7.0])
def test_a_bent_row_of_exact_numbers_may_be_off_by_the_rounding_of_its_square_and_of_its_value(rate):
    form, exact = Length(1.5), (0.0, 0.0, 0.0, np.zeros(2))
    row = RowMap(constraint="c", row=0, engine_row=0, form=form)
    mapped = _mapped([row], [0], row_values(0.4, rate, 0.9, np.ones(2), exact))
    value, allowed = (part[0] for part in mapped[Level.DRIFT])
    square = abs(form(0.4, 2)) * rate * rate

    assert allowed / (BOTH_SIDES * SAFETY * U) == pytest.approx(square + 2 * abs(value))


def test_a_budget_is_as_loose_as_its_largest_component_at_each_time():
    ref = solved()
    budget, moved = ref.budget(), input_sensitivity(ref, [0, 1])
    for quantity, sensitivity in zip(QUANTITIES, moved, strict=True):
        allowed, (largest, smallest) = budget.levels[QUANTITIES.index(quantity)], sharpness(ref, [0, 1])[quantity]
        expected = [max(allowed[:, k]) / max(sensitivity[:, k]) for k in (0, 1)]

        assert largest == pytest.approx(expected)
        assert np.all(smallest <= [min(allowed[:, k] / np.maximum(sensitivity[:, k], 1e-300)) for k in (0, 1)])


@pytest.mark.parametrize("crank", [1.0, 0.02])
def test_the_least_error_holds_every_residual_of_round_off_at_a_regular_pose(crank):
    """Every corner of the residual's box moves the pose by |J^-1| e at most; not much more is granted."""
    ref = reference(
        FourBar(ground=4.0, crank=crank, coupler=3.5, rocker=3.0).scene(
            times=(0.7,), law=Polynomial(coefficients=(0.3, 1.0))
        )
    )
    system, q = ref.system, ref.levels[0][:, 0]
    corners = np.abs(np.linalg.inv(system.phi_q(q, 0.7))) @ residual_error(system, q, 0.7)
    granted = least_error(system, q, 0.7) - output_rounding(system, *3 * [q[:, None]], np.array([0.7]))[0][:, 0]

    assert np.all(corners <= granted * (1 + 1e-9))
    assert np.max(granted) < 20 * np.max(corners)


@pytest.mark.parametrize("engine", ["closed_form", "mujoco"])
def test_where_a_body_spins_as_it_likes_balls_decide_of_all_but_its_spin(engine):
    """Spun about its line by an angle of its own it is inside, turned out of it by 3e-12 outside."""
    scene = RSSR(1.0, 3.0, 2.0, (2.5, -0.5, 0.75), (0.25, 1.0, 0.125)).scene(start=0.4, samples=3)
    motion, ref = load(engine).solve(scene), reference(scene)
    at = 7 * motion.bodies.index("coupler")
    p = Rotation.from_quat(motion.q[at + 3 : at + 7].T, scalar_first=True)
    for turn, inside in (((0.7, 0.0, 0.0), 3), ((0.0, 3e-12, 0.0), 0)):
        q = motion.q.copy()
        q[at + 3 : at + 7] = (p * Rotation.from_rotvec(turn)).as_quat(scalar_first=True).T
        there = samples(ref.system, scene_truths(ref), scene, replace(motion, q=q), load(engine).terms(scene))

        assert sum(sample.judgement.verdict == "inside" for sample in there) == inside


NUMBERS = np.random.default_rng(5)


def turning(count):
    """A body that turns anyhow: Euler parameters and their first two rates, (count, 4) each."""
    p = NUMBERS.normal(size=(count, 4))
    p /= np.linalg.norm(p, axis=1, keepdims=True)
    w, alpha = NUMBERS.normal(size=(2, count, 3))
    return [p, rates(p, w), bends(p, w, alpha)]


def about(line, angle):
    """Euler parameters of an angle (3, count), with its rates, about a line; and their first two rates."""
    half = 0.5 * angle
    c, s = (f(half[0])[:, None] * part for f, part in ((np.cos, [1.0, 0, 0, 0]), (np.sin, [0.0, *line])))
    dc, ds = (f(half[0])[:, None] * part for f, part in ((np.cos, [0.0, *line]), (np.sin, [-1.0, 0, 0, 0])))
    first = half[1][:, None] * (dc + ds)
    return [c + s, first, half[2][:, None] * (dc + ds) - half[1][:, None] ** 2 * (c + s)]


def product_of(a, b):
    """The product of two quaternions and its first two rates (Leibniz)."""
    return [product(a[0], b[0]), product(a[1], b[0]) + product(a[0], b[1]),
            product(a[2], b[0]) + 2 * product(a[1], b[1]) + product(a[0], b[2])]  # fmt: skip


def still(p):
    return [np.broadcast_to(p, (6, 4)), np.zeros((6, 4)), np.zeros((6, 4))]


def carried_point(p, u):
    """The point A(p) u and its first two rates, (6, 3) each."""
    return [x[:, 1:] for x in product_of(product_of(p, still([0.0, *u])), [conjugate(x) for x in p])]


@pytest.mark.parametrize("count", [1, 2, 3])
def test_a_passive_body_is_brought_back_from_any_spin_and_sign(count):
    """Spun about its line by any angle, at any rate, with the other sign of p: as near the truth as can be is there."""
    at, line = np.array([0.3, -0.2, 0.5]), np.array([2.0, -1.0, 2.0]) / 3.0
    p, foot = turning(6), NUMBERS.normal(size=(3, 6, 3))
    other = product_of(p, about(line, NUMBERS.uniform(-3.0, 3.0, (3, 6))))
    truth, spun = (
        [np.concatenate([f - c, x], axis=1).T for f, c, x in zip(foot, carried_point(one, at), one, strict=True)][
            :count
        ]
        for one in (p, other)
    )
    spun = [np.concatenate([level[:3], -level[3:]]) for level in spun]
    beside = [np.concatenate([NUMBERS.normal(size=(3, 6)), x.T]) for x in turning(6)][:count]

    assert np.max(np.abs(spun[0] - truth[0])) > 0.1
    negative = [np.concatenate([level[:3], -level[3:]]) for level in beside]
    for k, bodies in enumerate((["b", "beside"], ["beside", "b"])):
        there, expected = (
            [np.concatenate([one, two][:: 1 - 2 * k]) for one, two in zip(*pair, strict=True)]
            for pair in ((spun, negative), (truth, beside))
        )
        for level, right in zip(alike(there, expected, bodies, [{"b": (at, line)}]), expected, strict=True):
            assert level == pytest.approx(right, abs=1e-12)


def test_a_passive_body_may_be_off_by_a_spin_as_large_as_the_error_of_its_turn_and_no_other_body_may():
    """A spin by d moves each Euler parameter by up to d, and a point that lies r from the line by up to 2 d r."""
    allowed, turn = np.linspace(1.0, 14.0, 14)[:, None], 11.0 + 12.0 + 13.0 + 14.0
    line = {"b": (np.array([0.3, 5.0, 0.4]), np.array([0.0, 1.0, 0.0]))}

    expected = [*range(1, 8), *(own + 2.0 * 0.5 * turn for own in (8, 9, 10)), *[turn] * 4]
    assert spun(allowed, ["a", "b"], [line])[:, 0] == pytest.approx(expected)
    assert spun(allowed, ["a", "b"], []).tolist() == allowed.tolist()


def test_the_line_of_a_passive_coupler_goes_through_its_two_balls():
    ((at, line),) = (spin["coupler"] for spin in passive_lines(rssr().mechanism))

    assert at.tolist() == [0.0, 0.0, 0.0]
    assert line.tolist() == [1.0, 0.0, 0.0]


def test_euler_parameters_come_back_from_the_matrix_of_their_turn():
    """Whichever of them are zero, and whichever are largest."""
    weights = ((1.0, 1.0, 1.0, 1.0), (1.0, 2.0, 3.0, 4.0), (4.0, 1e-9, 2.0, 1.0), (1e-9, 1.0, 1e-9, 1.0))
    for signs, weight in every(every([-1.0, 0.0, 1.0], repeat=4), weights):
        if any(signs):
            p = np.multiply(signs, weight) / np.linalg.norm(np.multiply(signs, weight))
            back = parameters(matrix(p))

            assert np.max(np.abs(back * np.sign(back @ p) - p)) < 1e-15, p


@pytest.mark.parametrize("size", [1e-8, 1.0, 1e8])
def test_where_a_solution_is_nothing_but_rounding_there_is_none_in_any_unit(size):
    """Rows that differ by an ulp turn a right side of 1 into 1e16; regular ones do not, nor a right side that fits."""
    ulp = np.array([[1.0, 1.0], [1.0, 1.0 + 2.0**-52]])
    regular = np.array([[1.0, 0.5], [0.25, 1.0]])

    matrices, right = np.array([ulp, ulp, regular]), np.array([[1.0 / size, 0.0], [2.0, 2.0], regular @ [3.0, -1.0]])
    beyond, fitting, of_regular = solved_or_not(size * matrices, size * right)

    assert not np.isfinite(beyond).any()
    assert fitting == pytest.approx([2.0, 0.0])
    assert of_regular == pytest.approx([3.0, -1.0])


@pytest.mark.parametrize("far", [1.0, 1e5])
@pytest.mark.parametrize(("gap", "believed"), [(0.5, True), (2.0, False)])
def test_a_residual_is_believed_as_a_part_of_the_farthest_coordinate(far, gap, believed):
    """Of exudyn's Newton in space, which reports success; a coordinate at zero beside it changes nothing."""
    q = np.array([far, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0])
    model = SimpleNamespace(both=lambda q, t: (np.array([0.0, -gap * 1e-10 * far]), None))
    ends = SimpleNamespace(predicts=False, accepted=1e-10, model=model, _shipped_newton=lambda t, start: q)
    if believed:
        assert SpaceEquations.solved(ends, q, 0.0)[1] == gap * 1e-10 * far
    else:
        with pytest.raises(EngineError, match="reported success"):
            SpaceEquations.solved(ends, q, 0.0)


def test_half_the_angle_of_a_screw_counts_its_turns():
    frame_i, frame_j = joint_frame((0.3, 2.0, -0.5), (1.0, 0.2, 0.3)), joint_frame((-1.1, 0.2, 0.4), (0.1, 0.3, 2.0))
    u_i, u_j, pitch, shift = np.array([0.3, -1.2, 0.7]), np.array([-0.4, 0.6, 0.9]), 0.25, 0.4
    ends = {"body_i": "i", "body_j": "j", "u_i": u_i, "u_j": u_j, "frame_i": frame_i, "frame_j": frame_j}
    hold = Hold(name="h", kind=JointKind.SCREW, **ends, pitch=pitch, shift=shift)
    angle = np.linspace(-20.0, 20.0, 6)
    i = turning(6)
    about_z = about((0.0, 0.0, 1.0), np.array([angle, 0.0 * angle, 0.0 * angle]))
    between_them = product_of(product_of(still(parameters(frame_i)), about_z), still(conjugate(parameters(frame_j))))
    j = product_of(i, between_them)
    r_i = NUMBERS.normal(size=(6, 3))
    arm = [carried_point(i, u_i + frame_i[:, 2] * (shift + pitch * a))[0][k] for k, a in enumerate(angle)]
    r_j = r_i + arm - carried_point(j, u_j)[0]
    longer = 1.001 * j[0]  # no parameters of a turn
    poses = np.concatenate([r_i, i[0]], axis=1), np.concatenate([r_j, longer], axis=1)

    assert _half_angle(hold, *poses) == pytest.approx(angle / 2, abs=1e-11)
    in_the_turn_about_0 = [math.remainder(a, math.tau) / 2 for a in angle]
    assert _half_angle(replace(hold, pitch=0.0), *poses) == pytest.approx(in_the_turn_about_0, abs=1e-11)


def test_a_joint_is_reversed_beyond_a_right_angle():
    """The crank turned on by an angle about its axis, or upside down about its line of angle zero."""
    axis_j, zero_j = (-1.1, 0.2, 0.4), (0.1, 0.3, 2.0)
    pin = SpatialRevolute(
        name="R1", **between(GROUND, AT, "crank", AT), **axes((0.3, 2.0, -0.5), (1, 0.2, 0.3), axis_j, zero_j)
    )
    scene = spatial_scene("crank", [("crank", (0.0, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0))], [pin], motor())
    motion = refkin.solve(scene)
    frame, count = joint_frame(axis_j, zero_j), len(motion.t)

    def wrong(line, angle):
        turned = product(motion.q[3:].T, [np.cos(angle / 2), *(np.sin(angle / 2) * line)])
        there = reversed_joints(scene.mechanism, replace(motion, q=np.concatenate([motion.q[:3], turned.T])))
        assert all(len(set(some.tolist())) == 1 and len(some) == count for some in there.values())
        return {name for name, some in there.items() if some[0]}

    assert [wrong(frame[:, 2], angle) for angle in (0.0, 1.5, -1.5)] == [set(), set(), set()]
    assert [wrong(frame[:, 2], angle) for angle in (1.6, -1.6, 3.0)] == [{"motor"}] * 3
    assert wrong(frame[:, 0], np.pi) == {"R1"}
    assert wrong(frame[:, 1], np.pi) == {"R1", "motor"}


def test_only_axes_and_driven_angles_can_be_the_wrong_way_round():
    """A cylindrical joint, driven by angle and by length, and a slide; a rod of a length has no axis."""
    scene = two_slides()
    wrong = reversed_joints(scene.mechanism, refkin.solve(replace(scene, times=scene.times[:2])))

    assert wrong.keys() == {"C", "P", "motor"}
    assert not np.any(list(wrong.values()))


def test_a_histogram_counts_every_number_of_digits_once_in_tenths_rounded_down():
    digits = [3.14, 3.19, np.nan, 3.2, -0.05, 3.1, np.inf, 16.0]

    assert histogram(digits) == {31: 3, 32: 1, -1: 1, 160: 1}


@pytest.mark.parametrize(
    ("level", "where"), [("q", "position of "), ("qd", "velocity of "), ("qdd", "acceleration of ")]
)
def test_a_change_is_a_part_of_the_size_of_the_mechanism_and_of_a_rate_of_the_largest_rate(level, where):
    off, size = solved().motion, ROCKER.scene().mechanism.size()
    moved = np.array(getattr(off, level))
    moved += np.tile([[1e-6 * size], [0.0], [0.0]], (3, 1)) if level == "q" else 1e-6 * moved
    seen = change(solved(), off, replace(off, **{level: moved}), exact=False)

    assert seen.largest == pytest.approx(1e-6, rel=1e-6)
    assert seen.worst.startswith(where)
    assert not seen.inert


@pytest.mark.parametrize(("order", "level"), [(0, "q"), (1, "qd"), (2, "qdd")])
def test_digits_of_an_answer_are_of_the_size_of_the_mechanism_and_of_the_largest_rate_at_each_time(order, level):
    ref, size = solved(), ROCKER.scene().mechanism.size()
    moved = np.array(getattr(ref.motion, level))
    moved += np.tile([[1e-6 * size], [0.0], [0.0]], (3, 1)) if level == "q" else 1e-6 * moved
    quantity = compare(ref, replace(ref.motion, **{level: moved})).quantities[QUANTITIES[order]]
    fastest, most = (np.max(np.abs(part), axis=0) for part in ref.levels[1:])
    more = np.log10(np.maximum(fastest**2 / most, 1.0)) if level == "qdd" else 0.0

    assert quantity.digits == pytest.approx(6.0 + more, abs=1e-6)
    assert quantity.error == pytest.approx(1e-6 * (np.max(np.abs(ref.levels[order]), axis=0) if order else 1.0))


@pytest.mark.parametrize(("bend", "scale"), [(1e-30, 4.0), (400.0, 800.0)])
def test_digits_of_an_acceleration_count_from_the_square_of_the_velocity_where_that_is_more(bend, scale):
    """A crank whose frame is at its pivot turns at 2 rad/s, and is off by 1e-5 rad/s^2."""
    crank, law = refkin.Body(name="crank", estimate=(0.0, 0.0, 0.0)), Polynomial(coefficients=(0.0, 2.0, bend))
    at, pair = {"point_i": (0.0, 0.0), "point_j": (0.0, 0.0)}, {"body_i": "ground", "body_j": "crank"}
    mechanism = refkin.Mechanism(
        bodies=(crank,),
        joints=(refkin.Revolute(name="pivot", **at, **pair),),
        drivers=(AngleDriver(name="turn", law=law, body="crank"),),
    )
    ref = reference(refkin.Scene(name="crank", mechanism=mechanism, times=(0.0,)))
    off = replace(ref.motion, qdd=ref.motion.qdd + np.array([[0.0], [0.0], [1e-5]]))

    assert compare(ref, off).quantities["acceleration"].digits == pytest.approx(5.0 + np.log10(scale), abs=1e-6)
    assert ref.common.scale["acceleration"] == pytest.approx(scale)


def test_a_mechanism_at_rest_has_the_digits_of_one_that_moves():
    """At the turning point of its law nothing is left of a velocity but rounding: of that no answer has a digit."""
    law = refkin.Sinusoid(amplitude=0.4, angular_frequency=2.0, offset=1.0, phase=0.5 * np.pi)
    scene = ROCKER.scene(law=law, times=(0.0, 0.2, 0.4, 0.6))
    ref, truth = reference(scene), CertifiedTruth(scene)
    moving = np.max(np.abs(ref.levels[1]), axis=0)
    off = replace(ref.motion, qd=ref.motion.qd + 1e-9)
    digits = compare(ref, off).quantities["velocity"].digits

    assert moving[0] < 1e-15 * moving[1]
    assert ref.rests[:, 0].tolist() == [False, True, False]  # its acceleration is the law's
    assert digits[0] == pytest.approx(-np.log10(1e-9 / np.median(moving[1:])), abs=1e-6)
    assert digits[1:] == pytest.approx(-np.log10(1e-9 / moving[1:]), abs=1e-6)
    assert min(truth.attainable.values()) > 14.0
    assert truth.digits(off.qd, 1)[0] == pytest.approx(digits.min(), abs=1e-5)
    assert reference(ROCKER.scene(law=Polynomial(coefficients=(1.0,)), times=(0.0,))).common.scale["velocity"] == 1.0


def test_a_rate_that_is_small_and_known_is_no_rest():
    law = Polynomial(coefficients=(0.3, 0.0, 0.0, 0.0, 0.5))
    ref = reference(ROCKER.scene(law=law, times=(0.0, 1e-6, 1.0)))

    assert ref.rests.tolist() == [[False] * 3, [True, False, False], [True, False, False]]


def test_where_nothing_can_be_allowed_to_first_order_any_change_is_felt():
    ref, off = solved(), solved().motion
    on, budget = replace(off, q=off.q * (1.0 + 2.0**-52)), ref.budget()
    none = replace(budget, compared=np.zeros_like(budget.compared))
    near_singular = SimpleNamespace(system=ref.system, levels=ref.levels, motion=off, budget=lambda terms: none)

    assert change(ref, off, on, exact=False).inert
    assert change(near_singular, off, off, exact=False).inert
    assert not change(near_singular, off, on, exact=False).inert


def test_rates_that_come_without_positions_are_compared_and_are_no_other_assembly():
    ref = solved()
    compared = compare(ref, replace(ref.motion, q=None, qd=1.001 * ref.motion.qd))

    assert [(name, q.agrees) for name, q in compared.quantities.items()] == [
        ("velocity", False),
        ("acceleration", True),
    ]
    assert not compared.other_assembly


def test_rows_lose_what_the_farthest_coordinate_and_the_fastest_body_take_away():
    """Of two bodies one lies 5 away and moves at 2, the other turns with |p'| = 0.4, at 0.8 rad/s."""
    q = np.array([0.3, -5.0, 1.0, 1.0, 0.0, 0.0, 0.0, 0.1, 0.2, 0.3, 1.0, 0.0, 0.0, 0.0])
    qd = np.array([0.5, 1.0, -2.0, 0.0, 0.1, 0.0, 0.0, 0.1, 0.0, 0.0, 0.0, 0.0, 0.4, 0.0])
    at = Configuration(rssr().mechanism, q, qd, 0.0, np.zeros(0))
    rate = 2.0 + 0.8 * 5.0

    assert [at.sizes[False][level] for level in LEVELS] == pytest.approx([5.0, 5.0, rate, 0.8 * rate])
    assert [at.sizes[True][level] for level in LEVELS] == pytest.approx([1.0, 1.0, 0.4, 0.16])


def test_configurations_lie_on_all_sides_of_a_pose_as_far_as_a_size_or_a_radian():
    """With rates of three sizes or radians a second; of twenty there are both signs, and some beyond a half."""
    mechanism, near = ROCKER.scene().mechanism, np.arange(18.0).reshape(9, 2)
    at = configurations(mechanism, near, np.array([0.5, 1.5]), "sides", 20)
    scale = np.tile([mechanism.size(), mechanism.size(), 1.0], 3)
    moves = np.array([(c.q - near[:, round(c.t - 0.5)]) / scale for c in at])
    rates = np.array([c.qd / (3.0 * scale) for c in at])

    assert {c.t for c in at} == {0.5, 1.5}
    for part in (moves, rates):
        assert np.all(np.max(part, axis=0) > 0.5)
        assert np.all(np.min(part, axis=0) < -0.5)
        assert np.max(np.abs(part)) <= 1.0


def test_least_squares_of_rows_that_weigh_otherwise_are_within_what_redundant_rows_are_allowed():
    """Rows times 1/2 to 2, at poses that leave 1e-9 in one of them: rates are up to 3.4 times as far off as ours."""
    ref = reference(refkin.load(CORPUS / "space-bennett-stopped-early.toml"))
    system, t, numbers, left = ref.system, ref.motion.t, np.random.default_rng(0), 1e-9
    off = []
    for k in range(0, len(t), 2):
        q, qd, qdd = (level[:, k] for level in ref.levels)
        slope = system.phi_q(q, t[k])
        for _ in range(40):
            weights = 2.0 ** numbers.uniform(-1.0, 1.0, system.m)
            dq = np.linalg.pinv(slope) @ numbers.uniform(-1.0, 1.0, system.m)
            near = q + dq * left / np.max(np.abs(slope @ dq))
            inverse = np.linalg.pinv(weights[:, None] * system.phi_q(near, t[k]))
            v = inverse @ (weights * system.nu(near, t[k]))
            moved = v - qd, inverse @ (weights * system.gamma(near, v, t[k])) - qdd
            allowed = (left * of_one[:, k] for of_one in ref.propagation.of_one[0][1:])
            off.append([np.max(np.abs(move) / allow) for move, allow in zip(moved, allowed, strict=True)])

    assert np.max(off) > 2.0
    assert np.max(off) < ref.propagation.weights


def test_no_engine_is_blamed_for_redundant_rows_that_contradict_each_other_far_from_the_origin():
    """A Bennett linkage 12 km away is one to 1e-13 sizes only: who satisfied other rows than ours was 6 times off."""
    scene = Bennett(1.0, 0.7, 1.1).scene(samples=3)
    m, by = scene.mechanism, (1e4, 3e3, -7e3)
    ends = {"R1": "point_i", "R4": "point_j"}
    on_ground = {
        j.name: {end: tuple(np.add(getattr(j, end), by)) for end in [ends.get(j.name)] if end} for j in m.joints
    }
    joints = tuple(replace(j, **on_ground[j.name]) for j in m.joints)
    bodies = tuple(replace(b, estimate=(*np.add(b.estimate[:3], by), *b.estimate[3:])) for b in m.bodies)
    far = replace(scene, mechanism=replace(m, joints=joints, bodies=bodies))
    record = check(far, ["closed_form", "exudyn", "pinocchio", "mujoco"])
    least = {
        a.engine: min(x.ratio for x in a.quantities.values()) for a in record.answers if a.method.name != "shipped"
    }

    assert [d for d in record.disagreements if d.method != "shipped"] == []
    assert len(least) == 4
    assert min(least.values()) > 1e-3


def test_signs_of_euler_parameters_go_on_from_row_to_row_past_those_that_are_not_there():
    angles = np.linspace(0.0, 4.0 * np.pi, 25)
    smooth = np.stack([np.cos(angles / 2), 0.6 * np.sin(angles / 2), 0.0 * angles, 0.8 * np.sin(angles / 2)], axis=1)
    signs = np.random.default_rng(1).choice([-1.0, 1.0], size=25)
    given = smooth * signs[:, None]
    given[[0, 7, 8, 24]] = np.nan
    expected = smooth * signs[1]
    expected[[0, 7, 8, 24]] = np.nan

    assert np.array_equal(continuous(given), expected, equal_nan=True)
