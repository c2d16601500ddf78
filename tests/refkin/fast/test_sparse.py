"""Large mechanisms: sparse assembly is the reference's assembly, and its answers are the reference's answers."""

from __future__ import annotations

from copy import deepcopy
from dataclasses import replace
from itertools import product

import numpy as np
import pytest

import refkin
from refkin import Body, Distance, DistanceDriver, Effect, Mechanism, Polynomial, Revolute, Scene, Status
from refkin.errors import InvalidScene, RefkinError
from refkin.fast import SparseSystem, attempt, program_of, solve_large, sweep
from tests.linkages import ROCKER, system_of
from tests.places import ROOT

from .linkworks import chain
from .scenes import SCENES, bare


def drawn(system, seed=0):
    draw = np.random.default_rng(seed)
    return draw.uniform(-1.0, 1.0, (2, system.n))


def rod():
    """A crank that is held by a rod to the ground, so that its row is quadratic in the ground's place."""
    ends = {"body_i": "ground", "point_i": (2.0, 0.5), "body_j": "crank", "point_j": (1.0, 0.0)}
    pin = {"body_i": "ground", "point_i": (0.0, 0.0), "body_j": "crank", "point_j": (0.0, 0.0)}
    joints = (Revolute(name="pin", **pin), Distance(name="rod", **ends, length=1.5))
    return Scene(mechanism=Mechanism((Body(name="crank", estimate=(0.0, 0.0, 0.5)),), joints), times=(0.0,))


@pytest.mark.parametrize("name", [*SCENES, "rod"])
def test_assembly_by_groups_is_that_of_the_reference(name):
    """Bit for bit, at unassembled poses: the same formulas on the same numbers."""
    system = system_of(rod() if name == "rod" else SCENES[name])
    large = SparseSystem(system)
    q, qd = drawn(system)

    assert np.array_equal(large.phi(q, 0.3), system.phi(q, 0.3))
    assert np.array_equal(large.phi_q(q, 0.3).toarray(), system.phi_q(q, 0.3))
    assert np.array_equal(large.nu(q, 0.3), system.nu(q, 0.3))
    assert np.array_equal(large.gamma(q, qd, 0.3), system.gamma(q, qd, 0.3))


def test_a_copy_is_the_same_system():
    large = SparseSystem(system_of(SCENES["four-bar"]))
    q, _ = drawn(large.system)

    assert np.array_equal(deepcopy(large).phi(q, 0.3), large.phi(q, 0.3))


@pytest.mark.parametrize("together", [False, True])
@pytest.mark.parametrize("windows", [1, 4, 20])
def test_position_velocity_and_acceleration_are_those_of_the_reference(windows, together):
    scene = bare(chain(windows, together=together, times=(0.0,)))
    result, motion = solve_large(scene), refkin.solve(scene)

    assert result.status is Status.OK
    for ours, theirs in zip((result.q, result.qd, result.qdd), motion.levels, strict=True):
        assert np.max(np.abs(ours - theirs[:, 0])) <= 1e-15 * result.inverse_norm * max(1.0, np.max(np.abs(theirs)))


@pytest.mark.parametrize("name", SCENES)
def test_every_kind_of_joint_is_solved_as_by_the_reference(name):
    result, motion = solve_large(SCENES[name]), refkin.solve(SCENES[name])

    assert result.status is Status.OK
    assert np.max(np.abs(result.q[: len(motion.q)] - motion.q[:, 0])) <= 1e-12 * result.inverse_norm


@pytest.mark.parametrize("loops", [300, 10_000])
def test_ten_thousand_loops_are_solved_on_all_levels(loops):
    """60,003 coordinates; held against the rows of the reference, and the grouped rows' own products."""
    scene = bare(chain(loops, times=(0.0,)))
    result, system = solve_large(scene), system_of(scene)
    q, qd, qdd = (system.to_unit(x, k) for k, x in enumerate((result.q, result.qd, result.qdd)))
    slope = SparseSystem(system).phi_q(q, 0.0)

    assert result.status is Status.OK
    # Places grow with the chain, 15,000 units long: an ulp there is what the rows are off by.
    assert np.max(np.abs(system.phi(q, 0.0))) <= 8 * np.spacing(np.max(np.abs(q)))
    for rates, right in ((qd, system.nu(q, 0.0)), (qdd, system.gamma(q, qd, 0.0))):
        assert np.max(np.abs(slope @ rates - right)) <= 1e-13 * np.max(np.abs(rates))


def test_only_what_is_called_for_is_computed():
    for effects in ((), (Effect.VELOCITY,)):
        motion = solve_large(bare(chain(2, times=(0.0,)), effects=frozenset(effects)))

        assert (motion.qd is None) == (not effects)
        assert motion.qdd is None
    accelerations = solve_large(bare(chain(2, times=(0.0,)), effects=frozenset({Effect.ACCELERATION})))

    assert accelerations.qd is None
    assert np.isfinite(accelerations.qdd).all()


def test_the_pattern_never_changes():
    system = system_of(SCENES["chain"])
    large = SparseSystem(system)
    first, second = (large.phi_q(q, 0.0) for q in drawn(system))

    assert np.array_equal(first.indices, second.indices)
    assert np.array_equal(first.indptr, second.indptr)


def moved(scene, name, q):
    bodies = tuple(Body(name=b.name, estimate=q) if b.name == name else b for b in scene.mechanism.bodies)
    return replace(scene, mechanism=replace(scene.mechanism, bodies=bodies))


def test_a_far_estimate_is_not_converged_rather_than_elsewhere():
    """A rocker upside down: Newton goes somewhere, and does not contract at once."""
    scene = bare(chain(3, times=(0.0,)))
    motion = solve_large(moved(scene, "rocker2", (3.0, -0.5, -1.7)))

    assert motion.status is Status.NOT_CONVERGED
    assert motion.q is None
    assert motion.residual > 0.0 or len(motion.steps) > 1


def test_a_singular_pose_is_not_ok():
    """A slider-crank driven by its slider, stretched."""
    linkage = refkin.SliderCrank(crank=1.0, rod=3.0)
    scene = linkage.scene(law=refkin.Polynomial(coefficients=(4.0,)), times=(0.0,), driven="slider")

    assert solve_large(bare(scene)).status is not Status.OK


@pytest.mark.parametrize("angle", np.arange(0.1, 3.1, 0.1))
def test_a_singular_pose_is_not_ok_where_its_residual_is_exactly_zero(angle):
    """A plate on three parallel rods whose rates contradict each other."""
    rods = tuple(
        DistanceDriver(
            **{"name": f"d{k}", "body_i": "ground", "point_i": (x, 0.0), "body_j": "plate", "point_j": (x, 0.0)},
            law=Polynomial(coefficients=(1.0, rate)),
        )
        for k, (x, rate) in enumerate([(0.0, 1.0), (0.3, 2.0), (1.1, 4.0)])
    )
    plate = Body(name="plate", estimate=(float(np.cos(angle)), float(np.sin(angle)), 0.0))
    answer = solve_large(Scene(mechanism=Mechanism((plate,), (), rods), times=(0.0,)))

    assert answer.status in (Status.SINGULAR, Status.NOT_CONVERGED)
    assert answer.qd is None


def test_rates_beyond_numbers_are_not_ok():
    """Accelerations that are the squares of these velocities are none."""
    scene = chain(1, times=(0.0,))
    driver = replace(
        scene.mechanism.drivers[0], law=Polynomial(coefficients=(scene.mechanism.drivers[0].law(0.0), 1e160))
    )
    fast = replace(scene, mechanism=replace(scene.mechanism, drivers=(driver,)))

    for answer in (solve_large(fast), solve_large(replace(fast, effects=frozenset({Effect.VELOCITY})))):
        assert (answer.status, answer.q, answer.qd, answer.qdd) == (Status.NOT_CONVERGED, None, None, None)
    assert solve_large(replace(fast, effects=frozenset())).status is Status.OK


@pytest.mark.timeout(60)
def test_the_order_of_bodies_and_joints_does_not_make_a_long_chain_endless():
    scene = bare(chain(400, times=(0.0,)))
    draw, m = np.random.default_rng(3), scene.mechanism
    bodies, joints = ([parts[k] for k in draw.permutation(len(parts))] for parts in (m.bodies, m.joints))
    moved = replace(scene, mechanism=Mechanism(bodies, joints, m.drivers))
    result, other = solve_large(scene), solve_large(moved)
    system = system_of(moved)
    back = np.concatenate([other.q[system.columns(b.name)] for b in m.bodies])

    assert (result.status, other.status) == (Status.OK, Status.OK)
    assert result.q == pytest.approx(back, abs=1e-9)


def test_rows_that_are_redundant_by_their_structure_are_refused_before_they_are_factorized():
    """A slider whose angle is driven, too: SuperLU ended the process at such."""
    ends = {"body_i": "ground", "point_i": (0.0, 0.0), "body_j": "slider", "point_j": (0.0, 0.0)}
    slide = refkin.Prismatic(name="slide", **ends, axis_i=(1.0, 0.3))
    driver = refkin.AngleDriver(name="motor", body="slider", law=Polynomial(coefficients=(0.0,)))
    slider = Body(name="slider", estimate=(0.0, 0.0, 0.0))
    scene = Scene(mechanism=Mechanism((slider,), (slide,), (driver,)), times=(0.0,))

    with pytest.raises(RefkinError, match="no unique solution by their structure"):
        solve_large(scene)


def test_what_it_does_not_take_is_refused_by_what_it_is():
    scene = chain(1)
    again = replace(scene.mechanism.joints[0], name="again")
    twice = replace(scene, mechanism=replace(scene.mechanism, joints=(*scene.mechanism.joints, again)))

    with pytest.raises(RefkinError, match="11 rows for 9 coordinates"):
        solve_large(twice)
    with pytest.raises(RefkinError, match="bodies are spatial"):
        solve_large(refkin.load(ROOT / "examples/rssr.toml"))
    for one, given in product((solve_large, sweep, attempt, program_of), (ROCKER, None)):
        with pytest.raises(TypeError, match=f"scene: expected a Scene, got a {type(given).__name__}"):
            one(given)


def test_a_body_without_estimate_is_refused_by_name():
    with pytest.raises(InvalidScene, match="coupler0"):
        solve_large(moved(chain(1), "coupler0", None))
