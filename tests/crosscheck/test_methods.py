"""The real methods: looser settings have fewer digits, time integration has its order, what cannot be taken says so."""

from __future__ import annotations

import itertools
import math
import warnings
from dataclasses import dataclass, fields, replace
from functools import cache

import numpy as np
import pytest

from crosscheck.engines import QUANTITIES, EngineError
from crosscheck.engines.methods import PRICED, Use, copied, methods
from crosscheck.engines.tree.newton import _extrapolated, solved_rows
from crosscheck.engines.undisturbed import undisturbed
from crosscheck.judge.truth import CertifiedTruth
from crosscheck.measure.check import check
from crosscheck.measure.price_process import questions
from refkin.joints import Revolute
from refkin.motion_laws import Sinusoid
from refkin.scenes.files import load
from refkin.scenes.linkages import SliderCrank
from refkin.solving.solve import solve
from tests.linkages import ROCKER, without_estimates
from tests.places import EXAMPLES
from tests.refkin.test_sweep import three_cranks

SCENE = ROCKER.scene(speed=2.0, turns=0.5, samples=19)
SLIDER = SliderCrank(crank=1.0, rod=3.0, offset=0.4).scene(speed=2.0, turns=0.2, samples=5)


def answer(actual, scene, order):
    """Return the levels (3 bodies, T) of a method on a scene up to an order."""
    model = actual.model(scene)
    return list(model.read(model.solve(order)))


@cache
def digits(producer):
    """Return (method, setting, quantity) -> digits on the scene, in the order of the settings."""
    truth, result = CertifiedTruth(SCENE), {}
    for one in methods(producer, Use.PRICE):
        for order, level in enumerate(answer(one, SCENE, one.highest)):
            result[one.name, one.setting, QUANTITIES[order]] = truth.digits(level, order)[0]
    return result


def refused(producer, scene):
    """Return name -> reason of the methods that refuse a scene."""
    fields = {}
    for one in methods(producer, Use.PRICE):
        try:
            one.model(scene)
        except EngineError as error:
            fields[one.name] = str(error)
    return fields


def sweep(producer, name, quantity="position"):
    """Return the digits of one method, from its first setting to its last."""
    values = [d for (other, _, q), d in digits(producer).items() if (other, q) == (name, quantity)]
    assert len(values) > 1
    return values


SWEEPS = [
    ("refkin", "Newton, analytic Jacobian"),
    ("refkin", "Newton, stopped"),
    ("refkin", "chord"),
    ("scipy", "root, analytic Jacobian"),
    ("scipy", "root, its own differences"),
    ("scipy", "least_squares"),
    ("exudyn", "SolveStatic"),
    ("exudyn", "MainSolverStatic.Newton"),
    ("mujoco", "Newton on free coordinates"),
    ("mujoco", "Newton on its rows"),
    ("mujoco", "mj_step, quasi-static relaxation"),
    ("pinocchio", "Newton on free coordinates"),
    ("pinocchio", "Newton on its rows"),
]
SPRINGS = [("mujoco", "mj_step, Euler, solref swept"), ("mujoco", "mj_step, RK4, solimp swept")]


@pytest.mark.parametrize(("producer", "name"), SWEEPS)
def test_a_looser_setting_has_no_more_digits_and_the_tightest_what_double_precision_allows(producer, name):
    motion = sweep(producer, name)

    assert all(b > min(a, 14.0) - 0.3 for a, b in itertools.pairwise(motion))
    assert motion[0] < 6.0
    assert motion[-1] > 12.5


@pytest.mark.parametrize(("producer", "name"), SPRINGS)
def test_a_softer_loop_has_fewer_digits(producer, name):
    motion = sweep(producer, name)

    assert all(b > a for a, b in itertools.pairwise(motion))


ORDERS = [
    ("exudyn", "SolveDynamic, trapezoidal, index 2", "position", 2),
    ("exudyn", "SolveDynamic, trapezoidal, index 2", "velocity", 2),
    ("exudyn", "SolveDynamic, generalized-alpha, index 3", "velocity", 2),
    ("mujoco", "mj_step, Euler", "position", 2),
    ("pinocchio", "constraintDynamics, Euler", "position", 1),
    ("pinocchio", "constraintDynamics, Euler", "velocity", 1),
    ("pinocchio", "constraintDynamics, RK4", "position", 4),
    ("pinocchio", "constraintDynamics, RK4", "acceleration", 4),
]


@pytest.mark.parametrize(("producer", "name", "quantity", "order"), ORDERS)
def test_a_time_integration_gains_digits_by_its_order(producer, name, quantity, order):
    # Steps of a third to a tenth of a time step: digits gained are order * log10(10 / 3). With a loop that is held by
    # a spring of stiffness 1/h^2 MuJoCo's position follows the square of the step.
    motion = sweep(producer, name, quantity)
    gained = motion[2] - motion[1]

    assert gained == pytest.approx(order * math.log10(10 / 3), rel=0.25)


def test_index_3_keeps_positions_whatever_the_step():
    assert min(sweep("exudyn", "SolveDynamic, generalized-alpha, index 3")) > 9.0


def test_without_baumgarte_positions_drift_further():
    plain, held = (sweep("pinocchio", f"constraintDynamics, Euler{b}") for b in ("", ", Baumgarte"))

    assert all(b > a + 0.5 for a, b in zip(plain, held, strict=True))


@pytest.mark.parametrize(("scheme", "low", "high"), [("forward", 6.0, 9.0), ("central", 8.5, 12.0)])
def test_a_jacobian_by_differences_costs_velocity_its_digits_but_not_position(scheme, low, high):
    name = f"Newton, {scheme} Jacobian"

    assert sweep("refkin", name)[-1] > 14.0
    assert low < sweep("refkin", name, "velocity")[-1] < high


def test_a_jacobian_by_complex_steps_costs_no_digits():
    assert sweep("refkin", "Newton, complex-step Jacobian", "velocity")[-1] > 14.0


def test_what_is_relaxed_has_no_velocity():
    assert not [key for key in digits("mujoco") if "relaxation" in key[0] and key[2] != "position"]


@pytest.mark.parametrize("producer", ["exudyn", "mujoco", "pinocchio"])
def test_a_driver_that_speeds_up_is_followed(producer):
    law = Sinusoid(amplitude=0.8, angular_frequency=2.0, offset=0.5)
    scene = ROCKER.scene(law=law, times=np.linspace(0.0, 1.0, 11).tolist())
    truth = CertifiedTruth(scene)
    stepped = ("SolveDynamic", "mj_step, Euler", "constraintDynamics, RK4")
    values = [
        truth.digits(answer(one, scene, 0)[0], 0)[0]
        for one in methods(producer, Use.PRICE)
        if one.name.startswith(stepped) and one.setting == "10 steps between times"
    ]

    assert min(values) > 3.0


@pytest.mark.parametrize("producer", PRICED)
def test_a_slider_crank_has_its_positions(producer):
    truth = CertifiedTruth(SLIDER)
    values = [truth.digits(answer(one, SLIDER, 0)[0], 0)[0] for one in methods(producer, Use.PRICE)]

    assert max(d for d in values if d is not None) > 14.0


@pytest.mark.parametrize(
    ("producer", "name"),
    [
        ("refkin", "Newton, analytic Jacobian"),
        ("scipy", "least_squares"),
        ("exudyn", "SolveStatic"),
        ("exudyn", "MainSolverStatic.Newton"),
        ("mujoco", "Newton on its rows"),
        ("pinocchio", "Newton on its rows"),
    ],
)
def test_redundant_rows_cost_no_digits(producer, name):
    scene = three_cranks(0.0)
    truth = CertifiedTruth(scene)
    last = [one for one in methods(producer, Use.PRICE) if one.name == name][-1]

    assert min(truth.digits(level, k)[0] for k, level in enumerate(answer(last, scene, 2))) > 13.0


@pytest.mark.parametrize("producer", ["mujoco", "pinocchio"])
def test_a_loop_that_the_engines_forces_do_not_close_is_refused_for_stepping_by_name(producer):
    reasons = refused(producer, load(EXAMPLES / "inverted-slider-crank.toml"))
    stepped = {name for name, *_ in digits(producer) if name.startswith(("mj_step", "constraintDynamics"))}

    assert stepped <= set(reasons)
    assert all("joint 'A' closes a loop" in reasons[name] for name in stepped)


def test_a_driver_that_holds_no_coordinate_of_the_tree_is_refused_for_stepping_by_name():
    driven = ROCKER.scene(
        driven="coupler", law=Sinusoid(amplitude=0.1, angular_frequency=1.0, offset=0.9), times=[0.0, 0.1]
    )
    reasons = refused("mujoco", driven)

    assert set(reasons.values()) == {"driver 'driver' does not hold one coordinate of the tree, as stepping needs it"}
    assert "newton" not in reasons


def test_without_damping_mujocos_implicitfast_is_as_right_as_its_euler():
    by_step = [
        {k[1]: d for k, d in digits("mujoco").items() if k[0] == f"mj_step, {name}" and k[2] == "acceleration"}
        for name in ("Euler", "implicitfast")
    ]

    assert len(by_step[1]) == 2
    assert all(d == pytest.approx(by_step[0][step], abs=0.1) and d > 0.5 for step, d in by_step[1].items())


@pytest.mark.parametrize(("times", "why"), [((0.0, 0.1, 0.3), "even"), ((-0.1, 0.0, 0.1), "below zero")])
def test_times_that_exudyn_does_not_go_through_by_itself_are_refused(times, why):
    reasons = refused("exudyn", replace(SCENE, times=times))
    integrations = {"SolveDynamic, trapezoidal, index 2", "SolveDynamic, generalized-alpha, index 3"}

    assert set(reasons) == {*integrations, "SolveStatic, load steps"}
    assert all(why in reason for reason in reasons.values())


@pytest.mark.parametrize("producer", PRICED)
def test_bodies_without_an_estimate_are_named(producer):
    reasons = refused(producer, without_estimates(SCENE)).values()

    assert any("estimate" in reason and "crank" in reason for reason in reasons) or producer == "refkin-batch"


def test_a_producer_that_is_not_there_is_named():
    with pytest.raises(EngineError, match="no engine is called 'absent'"):
        methods("absent")


@pytest.mark.parametrize("producer", [*PRICED, "closed_form", "vector_loop", "numpy", "c"])
def test_every_setting_has_a_name_of_its_own(producer):
    listed = methods(producer)

    assert len({one.key for one in listed}) == len(listed)


FASTEST = [
    ("exudyn", "MainSolverStatic.Newton, extrapolated"),
    ("mujoco", "mujoco.batch, all times at once"),
    ("mujoco", "Newton on free coordinates"),
    ("pinocchio", "all times at once"),
    ("pinocchio", "Newton on free coordinates"),
]


@pytest.mark.parametrize(("producer", "name"), FASTEST)
def test_the_fastest_method_of_an_engine_is_as_right_as_double_precision_allows(producer, name):
    by_name = {q: sweep(producer, name, q)[-1] for q in QUANTITIES}

    assert min(by_name.values()) > 13.5


@pytest.mark.parametrize(("producer", "name"), FASTEST)
def test_the_fastest_method_of_an_engine_takes_any_loops_of_revolute_joints_and_slides(producer, name):
    last = [one for one in methods(producer, Use.PRICE) if one.name == name][-1]
    for scene in (SLIDER, replace(SLIDER, times=SLIDER.times[:1])):
        truth = CertifiedTruth(scene)

        assert min(truth.digits(level, k)[0] for k, level in enumerate(answer(last, scene, 2))) > 13.0


def test_what_an_engine_computes_beyond_all_numbers_is_no_warning_of_ours():
    with warnings.catch_warnings(record=True) as warned, undisturbed():
        product = np.array([1e300]) * 1e300

    assert (product[0], warned) == (math.inf, [])


def test_the_next_pose_is_guessed_as_if_the_acceleration_stayed():
    """Of 3 + 2 t - t^2, and of one that has no rates."""
    t = (0.5, 2.0, 2.5)
    with_rates = [3.0 + 2.0 * x - x * x for x in t], [2.0 - 2.0 * x for x in t], [-2.0] * 3

    guess = _extrapolated([np.array([level, [np.nan] * 3]) for level in with_rates], 2, t)
    assert guess[0] == 3.0 + 2.0 * 2.5 - 2.5 * 2.5
    assert np.isnan(guess[1])


@pytest.mark.parametrize("size", [1, 2, 3, 4])
def test_systems_of_loops_are_solved_whatever_their_size(size):
    draw = np.random.default_rng(size)
    matrices, x = draw.normal(size=(5, size, size)) + 3.0 * np.eye(size), draw.normal(size=(5, size))
    right = np.einsum("bij,bj->bi", matrices, x)

    assert solved_rows(matrices, right) == pytest.approx(x, abs=1e-12)


def test_a_joint_that_a_function_defines_is_copied():
    """Nothing can pickle its class, and the engines were blamed for that."""

    @dataclass(frozen=True, kw_only=True)
    class Pin(Revolute):
        """A pin of one's own."""

    pins = tuple(Pin(**{f.name: getattr(j, f.name) for f in fields(j) if f.init}) for j in SCENE.mechanism.joints)
    scene = replace(SCENE, mechanism=replace(SCENE.mechanism, joints=pins))
    other = copied(scene)

    assert other == scene
    assert other.mechanism.joints[0] is not scene.mechanism.joints[0]
    assert check(scene, ["pinocchio"]).disagreements == []


def test_what_is_copied_in_a_way_of_its_own_alone_is_copied():
    """Bindings that say how, and cannot be pickled, raise whatever they like for it."""

    class Handle:
        """What an engine keeps with its answer."""

        def __deepcopy__(self, memo):
            return Handle()

        def __reduce__(self):
            raise RuntimeError("pickling is not enabled")

    motion = solve(SCENE)
    object.__setattr__(motion, "handle", Handle())

    assert copied(motion).q.tolist() == motion.q.tolist()


@pytest.mark.parametrize("producer", PRICED)
def test_whoever_answers_a_cycle_answers_the_pose_that_is_needed_now(producer):
    """Also late in the cycle: what fails there is a row without a price."""
    asked = questions(ROCKER.scene(speed=0.5, samples=73))
    for one in methods(producer, Use.PRICE):
        (cycle, _), (late, _) = asked["cycle"].of(one)[0], asked["one"].of(one)[-1]
        try:
            model = one.model(cycle)
        except EngineError:
            continue
        now = one.model(late)
        whole, pose = (next(iter(each.read(each.solve(0)))) for each in (model, now))

        assert np.isfinite(pose[:, -1]).all() or not np.isfinite(whole).all(), one.key
