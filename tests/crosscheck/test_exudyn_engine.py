"""exudyn's motions against closed forms, what it refuses, and faults that must not pass."""

from __future__ import annotations

import gc
import weakref
from collections.abc import Callable
from dataclasses import replace
from typing import Any

import numpy as np
import pytest

import refkin
from crosscheck.engines import EngineError, EngineRefusal, in_space
from crosscheck.engines.exudyn import methods
from crosscheck.engines.exudyn import model as exudyn_model
from crosscheck.engines.exudyn.engine import SHIPPED, STATIC, Exudyn
from crosscheck.engines.exudyn.methods import Static
from crosscheck.engines.exudyn.model import _sound
from crosscheck.engines.exudyn.solve import BACK, STEEPEST, extrapolation, quiet_settings, solved, stopping_rule
from crosscheck.engines.poses import Tabulated
from crosscheck.judge.budget import propagation
from crosscheck.judge.truth import CertifiedTruth
from crosscheck.measure.check import check
from crosscheck.scenes.conformance import questions
from refkin.joints import GROUND, AngleDriver, Distance
from refkin.model import Body
from refkin.motion import Motion, Status
from refkin.motion_laws import Polynomial, Sinusoid, Table
from refkin.system import compile_system
from tests.linkages import ROCKER, remade, with_law
from tests.places import CORPUS, ROOT

from .exact_linkages import CASES as LINKAGES
from .exact_linkages import (
    LAW,
    THETA,
    Angle,
    Case,
    T,
    at_rest,
    body_rows,
    case_with,
    four_bar,
    pin,
    scene_of,
    slider_crank,
    turned_on,
)  # fmt: skip
from .loose_rows import KINDS, loose_scene
from .space_scenes import rssr_by_a_cylinder

EXTRAPOLATED = "MainSolverStatic.Newton, extrapolated"
CASES: dict[str, Callable[[], Case]] = {
    **{name: case for name, case in LINKAGES.items() if name != "planet five-bar"},  # refused
    "four-bar of 1e-9 m": lambda: four_bar(size=1e-9),
    "four-bar of 1e9 m": lambda: four_bar(-1, size=1e9),
    "four-bar 1e6 m away": lambda: four_bar(at=1e6 - 2e6j),
    "four-bar after 1600 turns": lambda: turned_on(four_bar(), 1600),
}


def ratios(case: Case, motion: Motion, terms: tuple[Any, ...] = ()) -> list[float]:
    """Return the largest error / allowed of position, velocity, acceleration: the derived budget at the closed form."""
    system = compile_system(case.scene.mechanism, unit=case.scene.mechanism.unit())
    exact = [np.concatenate([case.rows[body][order] for body in case.scene.wanted]) for order in range(3)]
    scaled = [system.to_unit(level, order) for order, level in enumerate(exact)]
    budget = propagation(system, motion, *scaled).budget(terms)
    size = system.to_physical(np.ones_like(exact[0]), order=1)
    rows = []
    for k, allowed in enumerate(budget.levels):
        level = motion.levels[k]
        assert level is not None
        error = level - exact[k]
        if k == 0:
            error[2::3] = np.arctan2(np.sin(error[2::3]), np.cos(error[2::3]))
        rows.append(float(np.max(np.abs(error / size) / allowed)))
    return rows


def assert_exact(case: Case) -> None:
    motion = Exudyn().solve(case.scene)

    assert motion.verdict is Status.OK
    assert max(ratios(case, motion)) < 1.0


@pytest.mark.parametrize("name", CASES)
def test_static_method_agrees_with_the_closed_form_within_the_budget(name: str) -> None:
    assert_exact(CASES[name]())


@pytest.mark.parametrize("name", [n for n in CASES if n not in ("four-bar of 1e-9 m", "four-bar 1e6 m away")])
def test_shipped_method_agrees_with_the_closed_form_within_its_stopping_rule(name: str) -> None:
    case = CASES[name]()
    motion = Exudyn().solve(case.scene, SHIPPED)

    assert motion.verdict is Status.OK
    assert max(ratios(case, motion, tuple(Exudyn().terms(case.scene, SHIPPED)))) < 1.0


def test_shipped_tolerances_do_not_see_a_linkage_of_a_nanometre_and_no_answer_is_ok() -> None:
    motion = Exudyn().solve(CASES["four-bar of 1e-9 m"]().scene, SHIPPED)

    assert set(motion.status) == {Status.NOT_CONVERGED}
    assert np.all(np.isnan(motion.q))
    assert "reported success with a residual" in motion.message


def test_only_the_shipped_method_adds_to_the_allowed_error() -> None:
    scene = four_bar().scene

    assert Exudyn().terms(scene) == Exudyn().terms(scene, STATIC) == ()
    assert [term.name for term in Exudyn().terms(scene, SHIPPED)] == ["stopping rule"]


def test_times_out_of_reach_are_marked_and_the_others_are_answered() -> None:
    """The crank of a triple rocker is driven past its limit, 2.5477 rad, and back again."""
    linkage = refkin.FourBar(ground=4.0, crank=3.0, coupler=3.5, rocker=3.2)
    start = linkage.scene(law=Polynomial(coefficients=(2.0,)), times=(0.0,))
    times = tuple(np.linspace(0.0, 2.0, 21).tolist())
    scene = replace(with_law(start, Polynomial(coefficients=(2.0, 1.5, -0.75))), times=times)
    motion = Exudyn().solve(scene)
    reached = [2.0 + 1.5 * t - 0.75 * t * t < 2.5476 for t in scene.times]

    assert reached.count(False) == 11
    assert [status is Status.OK for status in motion.status] == reached
    assert [bool(np.all(np.isfinite(column))) for column in motion.q.T] == reached
    assert "11 of 21 times not ok, first t = 0.5" in motion.message


def parallelogram() -> Case:
    """Return an open parallelogram with a rod between the middles of coupler and ground: one row too many."""
    first = THETA.p < 2.7
    half, still = THETA.arm(0.5), Angle(0.0, 0.0, 0.0)
    rows = {
        "crank": body_rows(half, THETA),
        "coupler": body_rows(at_rest(1.0 + 0j) + THETA.arm(1.0), still),
        "rocker": body_rows(at_rest(2.0 + 0j) + half, THETA),
    }
    joints = (
        pin("A", GROUND, 0.0, "crank", -0.5),
        pin("P", "crank", 0.5, "coupler", -1.0),
        pin("S", "coupler", 1.0, "rocker", 0.5),
        pin("D", GROUND, 2.0, "rocker", -0.5),
        Distance(name="rod", body_i=GROUND, point_i=(1.0, 0.0), body_j="coupler", point_j=(0.0, 0.0), length=1.0),
    )
    scene = replace(scene_of(rows, joints), times=tuple(T[first].tolist()))
    return Case(scene, {name: [level[:, first] for level in levels] for name, levels in rows.items()}, 1.0)


def test_redundant_rows_are_solved_by_the_static_method_and_stop_the_shipped_settings() -> None:
    assert_exact(parallelogram())
    assert set(Exudyn().solve(parallelogram().scene, SHIPPED).status) == {Status.NOT_CONVERGED}


def with_slider_turned(case: Case, by: float) -> Case:
    *others, slider = case.scene.mechanism.bodies
    x, y, phi = slider.estimate
    return case_with(case, bodies=(*others, Body(name="slider", estimate=(x, y, phi + by))))


@pytest.mark.parametrize("route", [STATIC, SHIPPED])
def test_a_slider_that_starts_upside_down_is_never_taken_for_an_answer(route: Any) -> None:
    """exudyn's prismatic joint holds the sine of the angle, which is zero at a half turn as well."""
    motion = Exudyn().solve(with_slider_turned(slider_crank(), np.pi).scene, route)

    assert set(motion.status) == {Status.NOT_CONVERGED}
    assert "holds only the sine of 'G'" in motion.message


def test_a_slider_that_starts_whole_turns_off_comes_back_on_the_turn_of_its_joint() -> None:
    motion = Exudyn().solve(with_slider_turned(slider_crank(angle=0.8), -3 * 2 * np.pi).scene)

    assert motion.verdict is Status.OK
    assert np.max(np.abs(motion["slider"].phi - 0.8)) < 1e-14


def test_rates_at_a_singular_jacobian_are_no_answer() -> None:
    singular, beyond_rounding = np.array([[1.0, 1.0], [1.0, 1.0]]), np.array([[1.0, 1.0], [1.0, 1.0 + 2.0**-52]])

    for matrix in (singular, beyond_rounding, np.vstack([singular, singular])):
        assert np.all(np.isnan(solved(matrix[None], np.arange(float(len(matrix)))[None])))
    both = solved(np.array([np.eye(2), singular]), np.array([[1.0, 2.0], [1.0, 2.0]]))
    assert np.array_equal(both, [[1.0, 2.0], [np.nan, np.nan]], equal_nan=True)


@pytest.mark.parametrize("kind", ["rate", "table"])
def test_a_law_by_rate_or_by_table_drives_as_the_polynomial_it_stands_for(kind: str) -> None:
    """The cubic spline through values of a quadratic is that quadratic."""
    c0, c1, c2 = LAW.coefficients
    knots = [0.5 * k for k in range(5)]
    laws: dict[str, dict[str, Any]] = {
        "rate": {"rate_law": Polynomial(coefficients=(c1, 2 * c2)), "initial": c0},
        "table": {"law": Table(argument=tuple(knots), value=tuple(c0 + c1 * t + c2 * t * t for t in knots))},
    }
    assert_exact(case_with(four_bar(), drivers=(AngleDriver(name="motor", body="crank", **laws[kind]),)))


# What is declared and what is refused


def test_its_version_and_its_methods_are_those_that_are_pinned() -> None:
    assert Exudyn().version().startswith("1.13.")
    assert [route.name for route in Exudyn().routes()] == ["static", "shipped"]


def test_turns_that_newton_added_from_a_far_start_cost_no_digits():
    """The rod was turned eleven times on the way to its first pose, and each pose was off by what an ulp is there."""
    scene = refkin.load(CORPUS / "exudyn-shipped-distance-driver.toml")
    (rod,) = scene.mechanism.bodies
    far = replace(rod, estimate=(-0.8068, 0.291, 0.53))
    scene = replace(scene, mechanism=replace(scene.mechanism, bodies=(far,)))

    assert np.all(np.abs(Exudyn().solve(scene, STATIC).q[2]) < np.pi)
    assert [d for d in check(scene, ["exudyn"]).disagreements if d.method == "static"] == []


def test_what_its_stopping_rule_leaves_of_a_driven_distance_is_of_its_own_row_and_not_of_the_squared_one() -> None:
    """Its row, |d| - f, moves by 908 m from time to time, and is 33 m off at the estimates; ours is 357,464 m^2 off."""
    scene = refkin.load(CORPUS / "exudyn-shipped-squared-residual.toml")
    (rule,) = Exudyn().terms(scene, SHIPPED)
    law = scene.mechanism.drivers[0].laws[0]
    lengths = [law(t, 0) for t in scene.times]

    assert rule.absolute == pytest.approx(1e-8 * abs(lengths[1] - lengths[0]) * max(lengths) / scene.mechanism.size())
    assert [item for item in check(scene, ["exudyn"]).disagreements if item.method == SHIPPED.name] == []


@pytest.mark.parametrize(
    ("name", "asked"),
    [
        ("steps-of-200-rad.toml", [STATIC]),
        ("slider-in-steps-of-a-kilometre.toml", [STATIC, SHIPPED]),
        ("exudyn-shipped-beside-a-crossing.toml", [STATIC, SHIPPED]),
        ("exudyn-shipped-distance-driver.toml", [SHIPPED]),
    ],
)
def test_what_its_stopping_rules_leave_is_no_disagreement(name: str, asked: list[Any]) -> None:
    """Steps may be of any size, and what an error does counts by its square, too, where it does nothing by itself."""
    record = check(refkin.load(CORPUS / name), ["exudyn"])

    assert [str(item) for item in record.disagreements if item.method in {route.name for route in asked}] == []


def test_a_pose_at_a_fold_is_corrected_until_little_of_its_residual_is_left() -> None:
    """Corrected once, it was off by 1.02 times the allowed error."""
    record = check(refkin.load(CORPUS / "exudyn-corrected-at-a-fold.toml"), ["exudyn"])
    (static,) = (answer for answer in record.answers if answer.method.name == "static")

    assert max(q.ratio for q in static.quantities.values()) < 0.2


def test_poses_that_are_extrapolated_begin_anew_after_one_that_was_not_reached():
    """At the estimates, at the first that is reached, and where the line through the first two leads."""
    times = (0.0, 0.1, 0.2, 0.4, 0.5)
    scene = replace(ROCKER.scene(speed=1.0), times=times)
    model, starts = Static(scene, scene.mechanism.unit(), extrapolates=True), []

    def step(t, start):
        starts.append(start)
        if t == scene.times[1]:
            raise EngineError("not reached")
        return model.start + t

    model.solve(step, 0)

    assert np.array(starts) - model.start == pytest.approx(np.tile([[0.0], [0.0], [0.0], [0.2], [0.5]], 9), abs=1e-14)


def test_what_solvestatic_leaves_is_a_part_of_the_largest_residual_that_it_starts_with():
    """That of the estimates, or what all laws together step from one time to the next, times the largest distance."""
    newton = quiet_settings().staticSolver.newton
    values, lengths = np.array([[0.0, 3.0, 3.0], [0.0, 4.0, 9.0]]), [np.array([0.5, 3.0])]

    for residual, laws, started in (
        ([2.0, 1.0], values, 5.0),
        ([6.0, 8.0], values, 10.0),
        ([3.0, 4.0], values[:0], 5.0),
    ):
        rule = stopping_rule(np.array(residual), laws, lengths, 0.1, "m")
        assert rule.absolute == pytest.approx(max(newton.absoluteTolerance, newton.relativeTolerance * started) * 0.3)
    at_rest_already = stopping_rule(np.zeros(2), values[:0], (), 0.1, "m")
    assert at_rest_already.absolute == pytest.approx(newton.absoluteTolerance * 0.1)


def test_the_direct_method_starts_at_the_polynomial_through_the_last_poses_whatever_the_steps(monkeypatch):
    times = tuple(0.1 * k + 0.03 * (k % 3) for k in range(9))
    scene = replace(ROCKER.scene(speed=1.0), times=times)
    starts = []

    def step(_newton, _tolerance, t, start):
        starts.append(start)
        return starts[0] + np.polyval(np.arange(1.0, BACK + 1.0), t)

    monkeypatch.setattr(methods, "_once_or_bare", step)
    methods._direct(0.0, scene).solve(0)

    for t, start in list(zip(times, starts, strict=True))[BACK:]:
        assert start == pytest.approx(starts[0] + np.polyval(np.arange(1.0, BACK + 1.0), t), abs=1e-11)


@pytest.mark.parametrize("near", range(1, 8))
def test_poses_are_extrapolated_through_fewer_where_times_nearly_coincide(near):
    """The polynomial through both would carry the rounding of a sample off by as much as they are close."""
    times = np.sort([*(0.1 * np.arange(9.0)), 0.1 * near + 1e-12])
    weights = extrapolation(times)

    assert np.max(np.abs(weights)) <= STEEPEST
    for k in range(1, len(times)):
        before = np.append(np.zeros(BACK), times)[k : k + BACK]
        assert weights[k].sum() == pytest.approx(1.0, abs=1e-12)
        assert weights[k] @ before == pytest.approx(times[k], abs=0.11)  # the step, at worst


def below_zero(scene: refkin.Scene) -> refkin.Scene:
    """The same scene, its driven distance given by a law below zero: our row has its square."""
    *others, driver = scene.mechanism.drivers
    below = replace(driver, law=Polynomial(coefficients=tuple(-c for c in driver.law.coefficients)))
    return remade(scene, drivers=(*others, below))


def by_a_cylinder() -> refkin.Scene:
    """A crank that a cylinder turns."""
    pivot = refkin.Revolute(name="pivot", body_i=GROUND, point_i=(0.0, 0.0), body_j="crank", point_j=(-0.5, 0.0))
    at, law = {"body_i": GROUND, "point_i": (1.5, 0.0)}, Polynomial(coefficients=(1.0, 0.1))
    cylinder = refkin.DistanceDriver(name="cylinder", **at, body_j="crank", point_j=(0.5, 0.0), law=law)
    crank = Body(name="crank", estimate=(0.5, 0.1, 0.6))
    return refkin.Scene(mechanism=refkin.Mechanism((crank,), (pivot,), (cylinder,)), times=(0.0, 0.1, 0.2))


@pytest.mark.parametrize("scene", [by_a_cylinder(), rssr_by_a_cylinder()], ids=["plane", "space"])
def test_a_distance_given_below_zero_is_the_distance(scene: refkin.Scene) -> None:
    """exudyn takes none, and was said to have no answer."""
    record = check(below_zero(scene), ["exudyn"])

    assert record.disagreements == []
    assert [answer.missing for answer in record.answers] == [0, 0]
    assert {row.level for row in record.levels} == {"residual", "jacobian", "constraint_velocity", "drift"}


@pytest.mark.parametrize("scene", [four_bar().scene, slider_crank().scene], ids=["pins alone", "a slide"])
def test_rates_of_one_pose_have_the_bits_that_they_have_among_others(scene):
    """They are read apart: what is made for many costs as much again."""
    for one in (one for one in methods.methods() if one.name in ("SolveStatic, as shipped", EXTRAPOLATED)):
        among, alone = (one.model(replace(scene, times=scene.times[:k])) for k in (3, 1))
        levels = list(zip(alone.read(alone.solve(2)), among.read(among.solve(2)), strict=True))

        assert len(levels) == 3
        assert all(np.array_equal(own[:, 0], others[:, 0]) for own, others in levels)


@pytest.mark.parametrize(
    ("matrix", "sound"),
    [([[2.0, 0.0], [0.0, 1.0]], True), ([[1.0, 1.0], [1.0, 1.0]], False), ([[1.0, 0.0], [0.0, 1e-17]], False)],
)
def test_rates_of_one_pose_are_none_where_it_is_singular_or_nothing_but_rounding(matrix, sound):
    x = _sound(np.array(matrix), np.array([2.0, 1.0]), 2.0 * 2.0**-52)

    assert np.array_equal(x, [1.0, 1.0]) if sound else np.isnan(x).all()


@pytest.mark.parametrize(
    "scene",
    [
        *(case.scene for case in (four_bar(), slider_crank(), four_bar(-1, size=1e3))),
        ROCKER.scene(law=Polynomial(coefficients=(0.3, 40.0)), times=(0.0, 0.1)),
        ROCKER.scene(law=Polynomial(coefficients=(0.3, 1.0)), times=(5.0, 9.0)),
    ],
    ids=["four-bar", "slider-crank", "large", "a tenth of a second", "from 5 s on"],
)
def test_one_call_of_its_static_solver_goes_through_all_times_by_load_steps(scene):
    times = tuple(np.linspace(scene.times[0], scene.times[-1], 200).tolist())
    listed = [one for one in methods.methods() if one.name == "SolveStatic, load steps"]
    truth = CertifiedTruth(replace(scene, times=times))
    for one in listed:
        model = one.model(replace(scene, times=times))
        again = [model.read(model.solve(order)) for order in (2, 0, 2)]
        digits = [truth.digits(level, k, again[0][:k])[0] for k, level in enumerate(again[0])]

        assert min(digits) > (12.0 if one is listed[-1] else 6.0)
        assert all(np.array_equal(a, b) for a, b in zip(again[0], again[2], strict=True))


def test_load_steps_are_refused_where_times_are_uneven():
    one = next(one for one in methods.methods() if one.name == "SolveStatic, load steps")

    with pytest.raises(EngineError, match="its steps are even, the times of this scene are not"):
        one.model(replace(four_bar().scene, times=(0.0, 0.1, 0.3)))


IN_SPACE = {question.about: question.scene for question in questions() if question.expected is Status.OK}
IN_SPACE = {about: scene for about, scene in IN_SPACE.items() if in_space(scene.mechanism)}
IN_SPACE = {about: scene for about, scene in IN_SPACE.items() if "screw" not in about and "gear" not in about}


@pytest.mark.parametrize("about", IN_SPACE)
def test_in_space_its_newton_alone_is_as_right_from_pose_to_pose(about):
    """What is priced there: nothing of a march is between exudyn's Newton and the next."""
    one = next(one for one in reversed(list(methods.methods())) if one.name == EXTRAPOLATED)
    scene = replace(IN_SPACE[about], points=(), bodies_wanted=None)
    model, truth = one.model(scene), CertifiedTruth(scene)
    levels = model.read(model.solve(2))
    digits = [truth.digits(level, k, levels[:k])[0] for k, level in enumerate(levels)]

    assert one.setting == "absoluteTolerance 2e-15"
    assert min(digits) > 13.0


# Its rows


@pytest.mark.parametrize("kind", KINDS["exudyn"])
def test_drift_is_the_derivative_of_exudyns_own_velocity_rows(kind: str) -> None:
    """gamma = -d/de (phi_q qd + phi_t)(q + e qd, qd, t + e): ties the point accelerations to the joint itself.

    The central difference over +-h ... +-4h errs by h^8/630 of the ninth derivative, below 1e-14 for h = 0.01 and
    rates of order 1 (distances stay above 0.5), and by rounding of u/h of the rows, about 1e-13.
    """
    scene = loose_scene(kind)
    model = Exudyn().constraints(scene)
    q, qd, t = np.array([1.4, 0.9, 0.3, -1.1, 0.2, -0.4]), np.array([0.3, -0.8, 0.9, 0.5, 0.7, -0.6]), 0.4
    h = 0.01
    weights = {1: 4 / 5, 2: -1 / 5, 3: 4 / 105, 4: -1 / 280}
    slope = sum(
        sign * w * model.constraint_velocity(q + sign * k * h * qd, qd, t + sign * k * h) / h
        for k, w in weights.items()
        for sign in (1, -1)
    )

    assert np.max(np.abs(model.drift(q, qd, t) + slope)) < 1e-12


def test_two_coinciding_points_of_a_distance_joint_are_an_engine_error() -> None:
    scene = loose_scene("distance")
    rod = next(c for c in scene.mechanism.joints if isinstance(c, Distance) and c.body_i == "ground")
    (xi, yi), (xj, yj) = rod.point_i, rod.point_j
    model = Exudyn().constraints(scene)
    q = np.array([xi - xj, yi - yj, 0.0, 0.0, 0.0, 0.0])

    for ask in (model.residual, model.jacobian):
        with pytest.raises(EngineError, match="distance of the markers is zero"):
            ask(q, 0.0)


def test_a_driven_distance_of_zero_is_a_refusal_that_names_driver_and_time() -> None:
    model = Exudyn().constraints(loose_scene("cylinder"))
    model.clock.laws[0] = Tabulated(Sinusoid(amplitude=0.0, angular_frequency=1.0))

    with pytest.raises(EngineRefusal, match=r"driver 'cylinder 0' at t = 0\.5: .*must be positive"):
        model.residual(np.zeros(6), 0.5)


def test_a_closed_model_is_freed() -> None:
    """User functions that reached back to the system would keep it for ever: the system owns them."""
    model = Exudyn().constraints(loose_scene("angle"))
    model.residual(np.zeros(6), 0.0)
    clock, whole = weakref.ref(model.clock), weakref.ref(model)
    model.close()
    del model
    gc.collect()

    assert whole() is None
    assert clock() is None


def test_bodies_in_another_order_than_the_columns_are_an_engine_error(monkeypatch: pytest.MonkeyPatch) -> None:
    build = exudyn_model.Builder
    monkeypatch.setattr(exudyn_model, "Builder", lambda mbs, bodies, *rest: build(mbs, bodies[::-1], *rest))

    with pytest.raises(EngineError, match="keeps the coordinates of body 'a' in columns"):
        Exudyn().constraints(loose_scene("revolute"))


@pytest.mark.parametrize("name", ["distance-driver", "spatial-distance-driver"])
def test_a_length_that_exudyn_does_not_take_leaves_no_other_at_its_time(name: str) -> None:
    scene = refkin.load(ROOT / "docs" / "scenes" / f"{name}.toml")
    (driver,) = scene.mechanism.drivers
    two = [replace(driver, name=x, law=Polynomial(coefficients=(1.5, slope))) for x, slope in (("a", 1.0), ("b", -1.0))]
    model = Exudyn().constraints(remade(scene, drivers=tuple(two)))
    q = np.concatenate([body.estimate for body in scene.mechanism.bodies])
    rows = model.residual(q, 0.0)

    with pytest.raises(EngineError, match="driver 'b' at"):
        model.residual(q, 1.5)
    np.testing.assert_array_equal(model.residual(q, 0.0), rows)
