"""What every engine of the plane owes: the closed form, what is called for and no more, and refusals by name.

And what is wrong in one is seen.
"""

from __future__ import annotations

import cmath
import math
from dataclasses import replace

import numpy as np
import pytest

import refkin
from crosscheck.engines import OF_SPACE, Engine, EngineError, Level, Support, march
from crosscheck.engines.loading import load
from crosscheck.measure.check import check
from refkin.joints import GROUND, Fixed, Revolute, XDriver, elements_of
from refkin.model import Body, Effect, Mechanism, Point, Scene
from refkin.motion import Seeding, Status
from refkin.motion_laws import Polynomial
from tests.mutation.change import mutated
from tests.places import CORPUS
from tests.refkin.test_sweep import twice

from .exact_linkages import CASES, EPS, T, case_with, excess, four_bar, turned_on
from .made_up_engines import Made, raises

ENGINES = ("mujoco", "pinocchio", "vector_loop", "exudyn", "closed_form")
MARCHING = ENGINES[:3]
"""Those whose rounding is as small as that of a march of the tests' own allowance."""
TURNS = 5


@pytest.fixture(params=ENGINES)
def engine(request):
    return load(request.param)


@pytest.mark.parametrize("case", CASES)
@pytest.mark.parametrize("name", MARCHING)
def test_a_linkage_moves_as_its_closed_form(name, case):
    if name == "pinocchio" and case in ("geared five-bar", "planet five-bar"):
        assert load(name).capabilities()["rolling wheels"][Level.SOLVE].support is Support.REFUSED
        return
    case = CASES[case]()
    motion = load(name).solve(case.scene)

    assert motion.status == (Status.OK,) * len(T)
    assert excess(case, motion) <= 1.0


ELSEWHERE = {
    "far": four_bar(at=2.0**30 + 2.0**29 * 1j),
    "a million sizes away": four_bar(at=1e6 - 2e6j),
    "turned": turned_on(four_bar(), TURNS),
    "small": four_bar(size=2.0**-30),
    "large": four_bar(size=2.0**30),
    "small and far": four_bar(size=2.0**-10, at=1024 - 2048j),
}
"""Their ground points are doubles; what is rounded far away is a coordinate when it is handed over."""


@pytest.mark.parametrize("case", ELSEWHERE.values(), ids=ELSEWHERE)
def test_neither_scale_nor_distance_from_the_origin_nor_turns_cost_digits(engine, case):
    assert excess(case, engine.solve(case.scene)) <= 1.0


NEAR = (1.0, 2.5, 2.0, 1.5 + 1e-6)
"""A crank-rocker with a slack of 1e-6: when crank and ground line up, its branches pass each other at some 1e-3 rad."""


@pytest.mark.parametrize("branch", [1, -1])
@pytest.mark.parametrize("lengths", [NEAR, *((1.0, 3.5, 3.0, 5.5 - slack) for slack in (1e-3, 1e-6, 1e-9))])
def test_it_stays_on_its_branch_where_another_is_close(engine, lengths, branch):
    """Also with a second coupler and rocker on the same crank: a step of 0.2 rad passes where branches are close."""
    case = four_bar(branch, lengths=lengths)
    rows = {**case.rows, **{f"{name} 2": case.rows[name] for name in ("coupler", "rocker")}}

    for each in (case, replace(case, scene=twice(case.scene), rows=rows)):
        assert excess(each, engine.solve(each.scene)) <= 1.0


@pytest.mark.parametrize("name", MARCHING)
def test_contraction_alone_would_not_hold_it_there(name, monkeypatch):
    """Shows that the test before can fail."""
    monkeypatch.setattr(march, "connected", lambda inverse, other, off=0.0: np.ones(len(other), bool))
    cases = [four_bar(branch, lengths=NEAR) for branch in (1, -1)]

    assert max(excess(case, load(name).solve(case.scene)) for case in cases) > 1e6


LIMIT = math.acos((90.0**2 + 30.0**2 - 105.0**2) / (2 * 90.0 * 30.0)) - math.radians(60.0)
SAID = {"vector_loop": "not followed beyond t = 0.2", "closed_form": "cannot be assembled from t = 0.9"}


def to_its_limit(beyond):
    """A crank whose four-bar ends at 112.0243 degrees, driven from 60 degrees at 1 rad/s."""
    law = Polynomial(coefficients=(math.radians(60.0), 1.0))
    scene = refkin.FourBar(90.0, 30.0, 60.0, 45.0).scene(law=law, times=[0.0, 0.2])
    return replace(scene, times=(0.0, 0.2, LIMIT + beyond))


def test_beyond_the_limit_there_is_no_answer_at_all(engine):
    motion = engine.solve(to_its_limit(1e-9))

    assert motion.status[:2] == (Status.OK, Status.OK)
    assert motion.status[2] is (Status.UNASSEMBLABLE if engine.name == "closed_form" else Status.NOT_CONVERGED)
    assert all(np.isnan(level[:, 2]).all() for level in motion.levels)
    assert SAID.get(engine.name, "") in motion.message


def test_at_the_limit_there_is_a_position_and_no_rates(engine):
    """There the angles go with the root of the input, whose rounding of 1e-16 is 1e-8 of them."""
    motion = engine.solve(to_its_limit(0.0))
    between = math.remainder(motion["rocker"].phi[2] - motion["coupler"].phi[2], math.tau)

    assert motion.status == (Status.OK, Status.OK, Status.SINGULAR)
    assert abs(between) == pytest.approx(math.pi, abs=1e-6)
    assert np.isnan(motion.qd[:, 2]).all()


@pytest.mark.parametrize("name", ["mujoco", "pinocchio", "exudyn"])
def test_every_element_of_its_table_is_solved_above(name):
    table = load(name).capabilities()
    solved = {e.key for build in CASES.values() for e in elements_of(build().scene.mechanism.constraints)}
    declared = {key for key, levels in table.items() if levels[Level.SOLVE].support is not Support.REFUSED}

    refused = {
        "pinocchio": {"rolling wheels", "rolling wheels on a carrier"},
        "exudyn": {"rolling wheels on a carrier"},
    }
    assert declared - set(OF_SPACE) == solved - refused.get(name, set())


def test_the_angle_of_a_crank_runs_on_without_a_jump(engine):
    assert np.abs(np.diff(engine.solve(four_bar().scene)["crank"].phi)).max() < 0.2


@pytest.mark.parametrize("turns", [1, -3])
@pytest.mark.parametrize("case", [four_bar(), CASES["inverted slider-crank"]()], ids=["four-bar", "inverted"])
def test_a_law_may_begin_whole_turns_from_where_estimates_show_its_pose(engine, case, turns):
    """From estimates a turn away Newton went to the other assembly, and called it ok."""
    scene = case_with(turned_on(case, turns), bodies=case.scene.mechanism.bodies).scene

    assert engine.solve(scene).verdict is Status.OK
    assert check(scene, [engine]).disagreements == []


@pytest.mark.parametrize("name", ["relative-law-begins-a-turn-on.toml", "geared-crank-begins-turns-on.toml"])
def test_turns_that_drivers_and_gears_count_choose_no_other_assembly(engine, name):
    """Nor for the reference, which closed forms contradicted."""
    scene = refkin.load(CORPUS / name)

    assert check(scene, [engine]).disagreements == []


@pytest.mark.parametrize("name", ENGINES[:4])
def test_a_tangent_beside_a_limit_spins_nothing(name):
    """A crank held by x = 1 - 1e-10 - t is at arccos x; exudyn's march took it round 6e7 times, and lost its digits."""
    times = (0.0, 0.01, 0.3, 0.5)
    pin = Revolute(name="A0", body_i=GROUND, point_i=(0.0, 0.0), body_j="crank", point_j=(0.0, 0.0))
    motor = XDriver(name="motor", body="crank", point=(1.0, 0.0), law=Polynomial(coefficients=(1.0 - 1e-10, -1.0)))
    crank = Body(name="crank", estimate=(0.0, 0.0, 1.4e-5))
    motion = load(name).solve(Scene(mechanism=Mechanism((crank,), (pin,), (motor,)), times=times))

    assert motion["crank"].phi[1:] == pytest.approx(np.arccos(1.0 - 1e-10 - np.array(times[1:])), abs=1e-14)


@pytest.mark.parametrize("turns", [1, -3])
def test_turns_of_the_estimate_of_one_body_are_kept(engine, turns):
    case = four_bar()
    *others, rocker = case.scene.mechanism.bodies
    x, y, phi = rocker.estimate
    motion = engine.solve(
        case_with(case, bodies=(*others, replace(rocker, estimate=(x, y, phi + turns * math.tau)))).scene
    )
    off = motion["rocker"].phi - case.rows["rocker"][0][2]

    assert off == pytest.approx(turns * math.tau, abs=256 * EPS * case.kappa)


def test_the_order_of_bodies_and_joints_does_not_matter(engine):
    mechanism = four_bar().scene.mechanism
    case = case_with(four_bar(), bodies=mechanism.bodies[::-1], joints=mechanism.joints[::-1])
    motion = engine.solve(case.scene)

    assert motion.bodies == ("rocker", "coupler", "crank")
    assert excess(case, motion) <= 1.0


def test_only_what_is_called_for_is_reported_and_it_is_the_same(engine):
    scene = four_bar().scene
    part = engine.solve(replace(scene, effects=frozenset({Effect.ACCELERATION}), bodies_wanted=("rocker",)))
    whole, velocity, position = (
        engine.solve(replace(scene, effects=frozenset(effects))) for effects in (Effect, {Effect.VELOCITY}, ())
    )

    assert (part.bodies, part.q.shape, part.qd) == (("rocker",), (3, len(T)), None)
    assert (velocity.qdd, position.qd, position.qdd) == (None, None, None)
    assert np.array_equal(whole["rocker"].qdd, part["rocker"].qdd)
    assert np.array_equal(whole.q, position.q)


@pytest.mark.parametrize("name", MARCHING)
def test_a_pin_moves_as_a_point_of_either_of_its_bodies(name):
    pins = {"B": ("coupler", (1.75, -0.25)), "same": ("rocker", (1.5, 0.0))}
    points = tuple(Point(name=name, body=body, position=at) for name, (body, at) in pins.items())
    case = four_bar(points=points)
    one, other = (load(name).solve(case.scene).points[pin] for pin in pins)

    for power, level in enumerate(("r", "v", "a"), start=1):
        gap = np.abs(getattr(one, level) - getattr(other, level))
        assert np.max(gap) <= 64 * EPS * (4.0 * case.kappa) ** power


@pytest.mark.parametrize("pinned", [False, True])
def test_bodies_that_nothing_drives_or_moves_are_placed(pinned):
    """One fixed to the ground, one to that; a pin and a driver that say once more where they are."""
    at = 1.0 + 2.0j + cmath.rect(0.5, 0.3) + (0.4 + 0.5j) * cmath.rect(1.0, 0.1)
    bodies = tuple(Body(name=name, estimate=(1.0, 2.0, 0.2)) for name in "ab")
    first = Fixed(name="first", body_i=GROUND, point_i=(1.0, 2.0), body_j="a", point_j=(0.0, 0.0), angle=0.3)
    second = Fixed(name="second", body_i="a", point_i=(0.5, 0.0), body_j="b", point_j=(0.0, 0.1), angle=-0.2)
    pin = Revolute(name="pin", body_i=GROUND, point_i=(at.real, at.imag), body_j="b", point_j=(0.4, 0.6))
    driver = XDriver(name="driver", body="a", point=(0.0, 0.0), law=Polynomial(coefficients=(1.0,)))
    mechanism = Mechanism(bodies, (first, second, *(pin,) * pinned), (driver,) * pinned)
    scene = Scene(mechanism=mechanism, times=(0.0, 1.0))
    record = check(scene, ENGINES[:2] if pinned else ENGINES)

    assert [str(seen) for seen in record.disagreements] == []
    assert {(a.compared, a.missing) for a in record.answers} == {(2, 0)}


def test_two_solves_give_the_same_bits(engine):
    one, other = (engine.solve(four_bar().scene) for _ in range(2))

    assert [level.tobytes() for level in one.levels] == [level.tobytes() for level in other.levels]


def test_a_linkage_that_cannot_close_has_no_answer_and_nothing_is_printed_or_written(
    engine, tmp_path, monkeypatch, capfd
):
    monkeypatch.chdir(tmp_path)
    joints = {joint.name: joint for joint in four_bar().scene.mechanism.joints}
    joints["B"] = replace(joints["B"], point_j=(7.75, -0.25))
    open_loop = replace(case_with(four_bar(), joints=tuple(joints.values())).scene, times=(0.0, 0.1))

    for route in engine.routes():
        motion = engine.solve(open_loop, route)

        assert set(motion.status) <= {Status.NOT_CONVERGED, Status.UNASSEMBLABLE}
        assert all(np.isnan(level).all() for level in motion.levels)
    assert list(tmp_path.iterdir()) == []
    assert capfd.readouterr() == ("", "")


NO_ESTIMATE = {
    "mujoco": "body 'coupler' has no estimate",
    "pinocchio": "body 'coupler' has no estimate",
    "vector_loop": "no body has an estimate of the angle of coupler",
    "exudyn": "no estimate for coupler",
}
"""The closed form needs none."""


@pytest.mark.parametrize("name", NO_ESTIMATE)
def test_a_body_without_estimate_is_refused_by_name(name):
    crank, coupler, rocker = four_bar().scene.mechanism.bodies
    scene = case_with(four_bar(), bodies=(crank, replace(coupler, estimate=None), rocker)).scene

    with pytest.raises(EngineError, match=NO_ESTIMATE[name]):
        load(name).solve(scene)


def test_an_unknown_method_is_refused_with_those_there_are(engine):
    names = ", ".join(repr(route.name) for route in engine.routes())
    with pytest.raises(EngineError, match=f"{engine.name} has no method 'guess'; there are: {names}"):
        engine.solve(four_bar().scene, replace(engine.routes()[0], name="guess"))


@pytest.mark.parametrize(
    ("name", "newton", "residual", "linear_solve"),
    [
        ("mujoco", "adapter", "mujoco", "numpy"),
        ("pinocchio", "adapter", "pinocchio", "numpy"),
        ("vector_loop", "refkin.newton", "vector loops", "numpy"),
        ("exudyn", "exudyn (MainSolverStatic.Newton)", "exudyn", "position: exudyn; velocity, acceleration: adapter"),
        ("closed_form", "none", "closed form", "closed form"),
    ],
)
def test_an_engine_is_found_by_its_name_and_its_method_says_who_did_what(name, newton, residual, linear_solve):
    """Of the estimate every one of them takes where to begin, and nothing else."""
    engine = load(name)
    route = engine.solve(four_bar().scene).producer.route

    assert isinstance(engine, Engine)
    assert (route.newton_by, route.residual_by) == (newton, residual)
    assert route.linear_solve_by.startswith(linear_solve)
    assert {route.seeding for route in engine.routes()} == {Seeding.INITIAL_GUESS}


def test_the_crossed_assembly_is_not_taken_for_the_open_one(engine):
    """Shows that what is allowed above can be exceeded."""
    assert excess(four_bar(), engine.solve(four_bar(branch=-1).scene)) > 1.0


FAULTS = {
    "pinocchio: gamma forgotten": ("pinocchio.rows:Rows.drift", "return -", "return 0.0 * "),
    "pinocchio: drift of points forgotten": (
        "pinocchio.rows:Rows.drift", "*points.motion(of_points)",
        "*points.motion(of_points)[:2], 0.0 * points.motion(of_points)[2]",
    ),
    "pinocchio: sign of nu": ("tree.tree_system:TreeSystem.nu", "law(t, 1)", "-law(t, 1)"),
    "pinocchio: other branch": (
        "tree.joint_tree:JointTree._estimated_poses", "estimate[2])",
        "estimate[2] * (1.0 if body == 'crank' else -1.0))",
    ),
    "mujoco: driver rate forgotten": ("tree.tree_system:TreeSystem.nu", "law(t, 1)", "0.0"),
    "mujoco: drift of the loop forgotten": (
        "mujoco.engine:TreeRows.closure_drift", "self.rates(q, qd, places)", "self.rates(q, 0.0 * qd, places)",
    ),
    "vector_loop: Coriolis and centripetal terms forgotten": (
        "vector_loop.vectors:Sums.acceleration", "- r * angled**2 + 1j * (2.0 * rd * angled + r * angledd)",
        "+ 1j * r * angledd",
    ),
    "vector_loop: sign of nu": ("vector_loop.system:LoopSystem.nu", "return -", "return "),
    "vector_loop: driver rate forgotten": (
        "vector_loop.vectors:Variables.known", "law(t, order)", "law(t, order) * (order != 1)",
    ),
    "vector_loop: driver acceleration forgotten": (
        "vector_loop.vectors:Variables.known", "law(t, order)", "law(t, order) * (order != 2)",
    ),
    "vector_loop: a slide's axis turned by 1e-9": (
        "vector_loop.chains:VectorChains._slide", "complex(*axis)", "complex(*axis) * (1.0 + 1e-9j)",
    ),
    "vector_loop: a link longer by 1e-9": (
        "vector_loop.chains:VectorChains._link", "LoopVector(1.0,", "LoopVector(1.0 + 1e-9,",
    ),
    "vector_loop: a constant angle the wrong way round": (
        "vector_loop.chains:_carried", "1.0 if body == e.body_i else -1.0", "-1.0",
    ),
}  # fmt: skip
"""What is put in an engine's adapter: where, and in place of what."""
SPOILT = ("four-bar, open", "slider-crank, tilted and turned", "scotch yoke", "cylinder", "driven x", "welded arm")


@pytest.mark.parametrize("name", FAULTS)
def test_a_planted_fault_is_seen(name):
    asked, cases, (target, old, new) = load(name.split(":")[0]), [CASES[case]() for case in SPOILT], FAULTS[name]
    assert max(excess(case, asked.solve(case.scene)) for case in cases) <= 1.0

    with mutated(f"crosscheck.engines.{target}", old, new):
        assert not max(excess(case, asked.solve(case.scene)) for case in cases) <= 1.0


@pytest.mark.parametrize("error", [SystemExit(3), RecursionError("too deep"), ZeroDivisionError("planted")], ids=repr)
def test_what_an_engine_raises_is_its_error_in_that_scene_and_ends_nobody_else(error):
    engines = [Made("first", lambda motion: motion), Made("bad", raises(error)), Made("last", lambda motion: motion)]
    record = check(four_bar().scene, engines)

    assert {answer.engine for answer in record.answers} == {"first", "last"}
    assert [(d.engine, d.name, str(error) in d.message) for d in record.disagreements] == [
        ("bad", f"error ({type(error).__name__})", True)
    ]


def test_a_ctrl_c_ends_the_caller_of_an_engine():
    with pytest.raises(KeyboardInterrupt):
        check(four_bar().scene, [Made("slow", raises(KeyboardInterrupt()))])


def test_a_file_that_ends_the_process_is_no_engine(tmp_path):
    (tmp_path / "ends.py").write_text("raise SystemExit(3)", encoding="utf-8")
    with pytest.raises(EngineError, match=r"cannot be imported: it ends with SystemExit\(3\)"):
        check(four_bar().scene, [f"{tmp_path / 'ends.py'}:Engine"])
