"""Checks of redundant rows: which they are, what they may contradict, and on which side of a dead centre they stand."""

from __future__ import annotations

import math
from dataclasses import replace
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

import refkin
from refkin import fast
from refkin.analysis import sweep
from refkin.joints import GROUND, AngleDriver, Gear, Revolute, SpatialAngleDriver, SpatialRevolute
from refkin.model import Body, Evidence, Mechanism, Scene
from refkin.motion import Motion, Status
from refkin.motion_laws import Polynomial, Table
from refkin.proof.numbers import inputs
from refkin.proof.numbers.preconditioned import Preconditioned
from refkin.proof.path.tracing import TraceEnd
from refkin.proof.pose import choices
from refkin.proof.pose.certificate import certify, unique_within
from refkin.proof.pose.isolate import isolate
from refkin.scenes.files import load
from refkin.scenes.linkages import Bennett, Branch, FourBar
from refkin.solving.mobility import mobility, rank_of
from refkin.solving.solve import solve
from refkin.solving.sweep import Sweep
from refkin.system import System, compile_system
from tests.claims import U, assert_near
from tests.linkages import ROCKER, remade, system_of, with_estimates, with_law
from tests.places import CORPUS, ROOT

ORIGIN = (0.0, 0.0)
TIMES = (0.0, 0.4, 0.8)


def ring(count: int, radius: float = 0.3, phi0: float = 0.0) -> Mechanism:
    """Return wheels of which each meshes with the next, and the last with the first, driven."""
    names = [f"wheel {k}" for k in range(count)]
    axles = tuple(
        Revolute(name=f"axle {k}", body_i=GROUND, point_i=(0.75 * k, 0.0), body_j=name, point_j=ORIGIN)
        for k, name in enumerate(names)
    )
    wheel: dict[str, Any] = {"radius_i": radius, "radius_j": radius}
    meshes = tuple(
        Gear(name=f"mesh {k}", body_i=name, body_j=names[(k + 1) % count], **wheel, phi0_i=phi0 * (k == 0))
        for k, name in enumerate(names)
    )
    bodies = tuple(Body(name=name, estimate=(0.75 * k, 0.0, 0.0)) for k, name in enumerate(names))
    motor = AngleDriver(name="motor", body=names[0], law=Polynomial(coefficients=(0.0, 1.0)))
    return Mechanism(bodies, axles + meshes, (motor,))


def turned(mechanism: Mechanism) -> Motion:
    """Return the motion of a mechanism."""
    return solve(Scene(mechanism=mechanism, times=TIMES))


def doubled(scene: Scene) -> tuple[System, Scene]:
    """Return a linkage with its first joint twice: rows that say the same."""
    m = scene.mechanism
    twice = remade(scene, joints=(*m.joints, replace(m.joints[0], name="again")))
    return system_of(twice), twice


def test_there_is_no_bound_where_a_choice_of_rows_is_nearly_singular():
    """A mechanism of those rows alone stands 3e-8 rad away; not where it is flat, as its rows choose nothing there."""
    flat = load("tests/corpus/redundant-beside-flat.toml")
    motion = solve(replace(flat, times=(-1e-9, 0.0, 1e-3)))

    assert motion.verdict is Status.OK
    assert np.isnan(motion.certified_radius.position).tolist() == [False, True, False]
    assert motion.message == "some choice of redundant rows is nearly singular: no error bound covers it"


def test_redundant_rows_contradict_at_each_level():
    """An even ring of wheels turns; an odd one has a pose, but no velocity; a shifted even one not even a pose."""
    even = turned(ring(4))
    assert even.verdict is Status.OK, f"four wheels: {even.verdict} {even.message}"
    for k in range(4):
        assert_near(even[f"wheel {k}"].phid, np.full(3, (-1.0) ** k), 64 * U, f"wheel {k} of four")
    three = ring(3)
    # With an axle twice: of the rows that are left out most agree, and one does not.
    pinned = replace(three, joints=(*three.joints, replace(three.joints[0], name="again")))
    for item, mechanism in (("three", three), ("three", pinned), ("four, shifted,", ring(4, phi0=1e-9))):
        for evidence in (frozenset(Evidence), frozenset[Evidence]()):
            motion = solve(Scene(mechanism=mechanism, times=TIMES, evidence=evidence))
            first = Status.LOCKED if item == "three" else Status.UNASSEMBLABLE  # all angles 0 is a pose of three wheels
            expected = (first, *[Status.UNASSEMBLABLE] * (len(TIMES) - 1))
            assert motion.status == expected, f"{item} wheels: {motion.status} {motion.message}"


def test_a_row_that_is_left_out_is_held_against_the_pose():
    """Where the other rows close, a wheel shifted by 1e-9 rad contradicts them, and one that is not does not."""
    for phi0, contradicts in ((0.0, False), (1e-9, True)):
        mechanism = ring(4, phi0=phi0)
        system = compile_system(mechanism, unit=mechanism.unit())
        pose = system.to_unit(turned(ring(4)).q[:, :1])
        apart = isolate(system, pose, TIMES[:1]).contradiction.max()
        assert bool(apart > 1.0) is contradicts, f"shifted by {phi0:g}: {apart:.3g} times what rounding explains"


@pytest.mark.parametrize(("part", "first"), [(0.8, Status.OK), (1.25, Status.UNASSEMBLABLE)])
def test_a_contradiction_is_one_as_soon_as_rounding_does_not_explain_it(monkeypatch, part, first):
    real = choices.isolate_every_choice

    def shifted(*given):
        isolation = real(*given)
        isolation.contradiction[0] = part
        return isolation

    monkeypatch.setattr("refkin.solving.solve.isolate_every_choice", shifted)
    assert turned(ring(4)).status[0] is first


def test_rounding_is_no_contradiction():
    """A joint that is there twice changes no answer, and contradicts nothing."""
    scene = ROCKER.scene(law=Polynomial(coefficients=(0.4, 1.3, -0.7)), times=TIMES)
    once, again = solve(scene), solve(doubled(scene)[1])
    assert again.verdict is Status.OK, f"{again.verdict} {again.message}"
    for level in ("q", "qd", "qdd"):
        assert_near(getattr(again, level), getattr(once, level), 256 * U, level)


@pytest.mark.parametrize(("off", "verdict"), [(0.0, Status.OK), (1e-12, Status.LOCKED)])
def test_a_table_contradicts_the_cubic_that_it_samples_if_its_values_are_off_by_more_than_rounding(off, verdict):
    """Its second derivative magnifies what its values are rounded by: over 2e-3 s, 1e-16 rad are 1e-10 rad/s^2."""
    knots, cubic = np.linspace(0.0, 0.01, 6), Polynomial(coefficients=(0.84, 0.0, 0.0, 1e6))
    values = cubic(knots) + off * np.array([0.0, 1.0, -1.0, 1.0, -1.0, 0.0])
    table = Table(argument=tuple(knots.tolist()), value=tuple(values.tolist()))
    scene = FourBar(ground=2.0, crank=1.0, coupler=2.0, rocker=1.0).scene(law=cubic, times=(0.0, 0.003, 0.01))
    m = scene.mechanism
    drivers = (*m.drivers, AngleDriver(name="second motor", body="rocker", law=table))

    assert solve(remade(scene, drivers=drivers)).verdict is verdict


def test_a_table_of_a_cubic_does_not_contradict_it_on_another_crank():
    assert solve(load("tests/corpus/redundant-table-and-its-cubic.toml")).verdict is Status.OK


def test_accelerations_contradict_where_a_pin_that_is_there_twice_is_a_little_aside():
    """What explains them is a sum of bounds: were one taken off, a contradiction would be less than nothing."""
    times = np.linspace(0.0, 0.8, 5)
    scene = ROCKER.scene(law=Polynomial(coefficients=(0.4, 1.0)), times=tuple(times.tolist()))
    system, twice = doubled(scene)
    q = system.to_unit(solve(twice).q)
    *joints, again = twice.mechanism.joints
    aside = replace(again, point_j=(again.point_j[0] + 1e-9, again.point_j[1] + 1e-9))
    shifted = compile_system(replace(twice.mechanism, joints=(*joints, aside)), unit=system.unit)
    rows = np.setdiff1d(np.arange(system.m), [8, 9])
    assert (inputs.rate_contradiction(system, rows, q, times, True) < 0.1).all()
    assert (inputs.rate_contradiction(shifted, rows, q, times, True) > 1e3).all()


def test_a_change_of_branch_is_seen_with_redundant_rows():
    """Where no determinant has a sign, that of independent rows tells one branch from the other."""
    law = Polynomial(coefficients=(0.4, 1.0))
    poses = [solve(doubled(ROCKER.scene(law=law, times=TIMES, branch=b))[1]) for b in Branch]
    system, _ = doubled(ROCKER.scene(law=law, times=TIMES))
    first, other = (system.to_unit(motion.q) for motion in poses)
    sweep = Sweep(system, [TIMES[0]], [first[:, 0]])
    assert sweep._sides(first[:, 1], TIMES[1])[0], "the next pose of the branch is taken for another branch"
    assert not sweep._sides(other[:, 1], TIMES[1])[0], "the other branch is taken for this one"


def test_dependences_are_told_apart():
    """Of rows that depend on the same others, each is named by itself, on what is independent alone."""
    rows = np.array([[1.0, 0.0, 0.0], [0.0, 1.0, 0.0], [1.0, 1.0, 0.0], [1.0, -1.0, 0.0], [2.0, 0.5, 0.0]])
    names = ["a", "b", "c", "d", "e"]
    rank = rank_of(rows, names)
    assert [d.row for d in rank.dependent] == ["c", "d", "e"], f"{rank.dependent}"
    for d in rank.dependent:
        total = sum((f * rows[names.index(n)] for n, f in d.factors.items()), np.zeros(3))
        assert set(d.factors) <= {"a", "b"}, f"{d}"
        assert_near(total, rows[names.index(d.row)], 1e-13, f"{d}")
    steep = rank_of(np.diag([1e3, 1e-5]), ["a", "b"])
    assert steep.rank == 2, f"a value of 1e-5 does not count beside one of 1000: {steep}"


def test_the_size_of_wheels_is_nothing_to_mobility():
    """Wheels of a nanometre take one freedom away, as those of a gigametre do."""
    for radius in (1e-9, 1.0, 1e9):
        pair = ring(2, radius)
        single = replace(pair, joints=pair.joints[:3])
        freedoms = mobility(single, np.array([0.0, 0.0, 0.0, 0.75, 0.0, 0.0]))
        assert (freedoms.mobility, freedoms.joints.dependent) == (1, ()), f"radius {radius}: {freedoms}"


def test_no_other_solution_is_within_the_proved_distance():
    """Near the dead centre of a lever, whose two poses lie an angle of 2 apart, what is unique is less than that."""
    low, high = ROCKER.input_range("rocker")[0]
    for away in (1e-2, 1e-4):
        law = Polynomial(coefficients=(high - away * (high - low), -1e-3))
        motions = [solve(ROCKER.scene(law=law, times=TIMES[:2], driven="rocker", branch=b)) for b in Branch]
        system = compile_system(ROCKER.scene(law=law, times=TIMES[:2], driven="rocker").mechanism)
        poses = [motion.q for motion in motions]
        apart = np.max(np.abs(np.mod(poses[0] - poses[1] + math.pi, math.tau) - math.pi), axis=0)
        q, t = poses[0], np.array(TIMES[:2])
        proof = certify(system, q, t)
        unique = unique_within(system, proof.rows, q, t, proof.position)
        assert (unique > 0).all(), f"no proof {away} from the dead centre"
        assert (unique < apart).all(), f"unique within {unique}, another solution at {apart}"


@pytest.mark.parametrize(("off", "near"), [(0.0, True), (2e-3, False)])
def test_a_choice_of_rows_that_float64_does_not_prove_is_bounded_by_balls_if_its_pose_is_near(monkeypatch, off, near):
    """A pose that is far from the answer in one coordinate alone is another one."""
    system, scene = doubled(ROCKER.scene(law=Polynomial(coefficients=(0.4, 1.0)), times=TIMES))
    motion, shift, last = solve(scene), 1e-9, slice(2, 3)
    q, qd, qdd = (system.to_unit(level, k)[:, last] for k, level in enumerate(motion.levels))
    q = q + shift * (off == 0.0)
    q[5] += off
    unproved = SimpleNamespace(ok=np.array([False]), radii=None, velocity=None, acceleration=None)
    monkeypatch.setattr(choices, "certify", lambda *_, **__: unproved)
    rows = np.delete(np.arange(system.m), [0, 1])
    bounds = np.array(choices._bounds(system, rows, np.array([True]), q, np.array(TIMES[last]), qd, qdd))

    assert (bounds > 0.0).all() == near
    assert bounds[0, 0] == pytest.approx(shift * near, rel=1e-3)


def test_of_poses_of_other_choices_that_are_compared_the_second_order_counts_too(monkeypatch):
    """At a share of what is unique eight shares are put on the distance; and none of it is put on that of the proof."""
    law = Polynomial(coefficients=(0.4, 1.0))
    _, scene = doubled(ROCKER.scene(law=law, times=TIMES))
    motion, (*joints, again) = solve(scene), scene.mechanism.joints
    longer = replace(scene.mechanism, joints=(*joints, replace(again, point_j=(-0.5 + 1e-9, 1e-9))))
    system = compile_system(longer, unit=longer.unit())
    answers = (system.to_unit(motion.q), np.array(TIMES), *(system.to_unit(motion.levels[k], k) for k in (1, 2)))
    proof = isolate(system, *answers)
    monkeypatch.setattr(choices, "MOST_CHOICES", 2)

    groups = [(np.arange(len(TIMES)), proof.rows)]

    without = choices._over_all_choices(system, proof, groups, (*answers[:3], None))
    whole = choices._over_all_choices(system, proof, groups, answers)
    assert np.array_equal(without.velocity, whole.velocity)
    assert "the bounds cover inverses of a Frobenius norm" in whole.why
    monkeypatch.setattr(choices, "unique_within", lambda *_: np.array([np.inf, 0.0, np.inf]))
    assert "no error bound covers all of them" in choices._over_all_choices(system, proof, groups, answers).why

    def far(unique):
        monkeypatch.setattr(choices, "unique_within", lambda *_: unique)
        bounds = choices._over_all_choices(system, proof, groups, answers)
        own = proof.position, proof.velocity, proof.acceleration
        return [
            bound - x for bound, x in zip((bounds.position, bounds.velocity, bounds.acceleration), own, strict=True)
        ]

    first = far(np.full(3, np.inf))
    assert np.min(first) > 0.0
    for share, factor in ((0.01, 1.08), (0.015, 1.12), (0.016, np.nan)):
        np.testing.assert_allclose(far(first[0] / share), factor * np.array(first), rtol=1e-2)


def test_a_nearly_singular_pose_of_which_other_rows_may_say_anything_is_not_ok():
    """It was, with accelerations of 2e5 rad/s^2 where there are none."""
    flat = load(CORPUS / "redundant-one-ulp.toml")
    at = {"c0": (0.0, 0.0, 1e-7), "c1": (1.0, 0.0, 1e-7), "c2": (3.0, 0.0, 1e-7), "bar": (1.0, 1e-7, 0.0)}
    motion = solve(with_estimates(with_law(flat, Polynomial(coefficients=(1e-7, 1.0))), lambda b: at[b.name]))

    assert motion.verdict is Status.SINGULAR
    assert np.isnan(motion.qdd).all()


@pytest.mark.parametrize("hinges", [2, 3, 4])
def test_a_door_may_hang_on_any_number_of_hinges(hinges):
    """Of three there are more rows to spare than coordinates, and as many were asked to be changed for one another."""
    scene = load(ROOT / "docs" / "scenes" / "spatial-distance-driver.toml")
    (hinge,) = scene.mechanism.joints
    joints = (hinge, *(replace(hinge, name=f"hinge {k}") for k in range(1, hinges)))
    alone, motion = (
        solve(replace(scene, times=(0.0, 0.3))),
        solve(remade(replace(scene, times=(0.0, 0.3)), joints=joints)),
    )

    assert motion.verdict is Status.OK
    assert_near(motion.q, alone.q, 16 * U, "q")


def test_the_fast_path_says_which_choices_its_bounds_cover_too(monkeypatch):
    monkeypatch.setattr(choices, "MOST_CHOICES", 2)
    _, scene = doubled(ROCKER.scene(law=Polynomial(coefficients=(0.4, 1.0)), times=TIMES))

    assert "more than 2 ways: the bounds cover inverses" in fast.attempt(scene).message


def test_what_is_proved_of_a_pose_is_the_same_beside_poses_that_are_proved_by_other_rows():
    """Each pose by its own rows, all at once, and by how much the rows that are left out contradict them."""
    _, scene = doubled(ROCKER.scene(law=Polynomial(coefficients=(0.4, 1.0)), times=TIMES))
    motion, (*joints, again) = solve(scene), scene.mechanism.joints
    aside = replace(again, point_j=(again.point_j[0] + 1e-9, again.point_j[1] + 1e-9))
    system = compile_system(replace(scene.mechanism, joints=(*joints, aside)), unit=scene.mechanism.unit())
    answers = [system.to_unit(level, k) for k, level in enumerate(motion.levels)]
    own = [np.delete(np.arange(system.m), out) for out in ([0, 1], [8, 9], [0, 9])]
    together = isolate(system, answers[0], np.array(TIMES), *answers[1:], rows=np.stack(own, axis=1))

    for k, rows in enumerate(own):
        alone = isolate(system, answers[0], np.array(TIMES), *answers[1:], rows=rows)
        assert together.ok[k]
        for name in ("position", "velocity", "acceleration", "contradiction"):
            one, other = (getattr(proof, name)[..., k] for proof in (together, alone))
            # Terms of sums are counted of all; what lies far below one rounding depends on how products are added.
            np.testing.assert_allclose(one, other, rtol=1e-2, atol=2.0**-59, err_msg=name)
    assert (together.contradiction > 1.0).all()


@pytest.mark.parametrize("law", [(0.4, 1.0), (0.4, 1e-3, 0.3)], ids=["under way", "nearly at rest"])
def test_norms_bound_how_far_choices_of_rows_lead_and_not_by_much_more(law):
    """A joint that is there twice, 1e-9 aside the second time, or 1e-6 at one level: all that it moves is within.

    Nearly at rest accelerations change with the pose far more than with the velocity.
    """
    scene = doubled(ROCKER.scene(law=Polynomial(coefficients=law), times=TIMES))[1]
    motion, (*joints, again) = solve(scene), scene.mechanism.joints
    longer = replace(scene.mechanism, joints=(*joints, replace(again, point_j=(-0.5 + 1e-9, 1e-9))))
    system = compile_system(longer, unit=longer.unit())
    q, *rates = (system.to_unit(level, k) for k, level in enumerate(motion.levels))
    for factors in ((1.0, 1.0, 1.0), (1e3, 1.0, 1.0), (1.0, 1e3, 1.0), (1.0, 1.0, 1e3)):
        moves = choices._Moves(system, np.delete(np.arange(11), [0, 1]), q, np.array(TIMES), rates)
        for missed, factor in zip(moves.missed, factors, strict=True):
            missed[:, :, -1] *= factor
        share = np.array(moves.farthest()) / moves.at_most()

        assert np.min(share) > 2e-3
        assert np.max(share) <= 1.0
    assert len(choices._Moves(system, np.delete(np.arange(11), [0, 1]), q, np.array(TIMES), rates[:1]).at_most()) == 2


def test_the_radius_of_a_velocity_is_the_same_whether_accelerations_are_asked_for_or_not():
    """Of three levels over all choices of rows each is its own."""
    system, scene = doubled(ROCKER.scene(law=Polynomial(coefficients=(0.4, 1.0)), times=TIMES))
    q, qd, qdd = (system.to_unit(level, k) for k, level in enumerate(solve(scene).levels))
    radii = []
    for rates in ((qd,), (qd, qdd)):
        radii.append(choices.isolate_every_choice(system, q, np.array(TIMES), *rates).velocity)

    assert np.array_equal(*radii)


def test_what_an_inverse_leaves_of_a_body_at_rest_contradicts_nothing(monkeypatch):
    """A crank at rest whose pivot is there twice, beside one that turns: all of its rate is what the inverse is off."""
    names, at = ("turning", "resting"), {"turning": (0.0, 0.0), "resting": (2.0, 0.0)}
    pins = [Revolute(name=n, body_i=GROUND, point_i=at[n], body_j=n, point_j=(-0.5, 0.25)) for n in names]
    laws = (Polynomial(coefficients=(0.4, 1.0)), Polynomial(coefficients=(0.7,)))
    drivers = [AngleDriver(name=f"drives {n}", body=n, law=law) for n, law in zip(names, laws, strict=True)]
    bodies = [Body(name=n, estimate=(*at[n], 0.5)) for n in names]
    mechanism = Mechanism(tuple(bodies), (*pins, replace(pins[1], name="again")), tuple(drivers))
    system = compile_system(mechanism, unit=mechanism.unit())
    q = system.to_unit(turned(mechanism).q)

    def off(*args: Any) -> Preconditioned:
        pose = Preconditioned(*args)
        pose.inverse[3:6, 4] += 2.0**-40 * np.array([[1.0], [0.5], [1.5]])  # of the row that drives the other
        pose.size = np.abs(pose.inverse)
        return pose

    monkeypatch.setattr(inputs, "Preconditioned", off)
    ratio = inputs.rate_contradiction(system, np.array([0, 1, 2, 3, 6, 7]), q, np.array(TIMES), False)[0]

    assert ((ratio > 0.1) & (ratio <= 1.0)).all()


LINKAGE = Bennett(1.0, 0.7, 1.2)


def loop() -> Scene:
    """Return a loop of four revolutes that closes at its first pose alone: three of them have any other axes there."""
    numbers, scene = np.random.default_rng(0), LINKAGE.scene(start=0.4, samples=2)
    first = refkin.solve(replace(scene, times=scene.times[:1]))
    joints: list[Any] = [scene.mechanism.joints[0]]
    for joint in scene.mechanism.joints[1:]:
        axis, other, point = numbers.normal(size=(3, 3))
        axis /= np.linalg.norm(axis)
        zero = np.cross(axis, other) / np.linalg.norm(np.cross(axis, other))
        own = {}
        for side, body in (("i", joint.body_i), ("j", joint.body_j)):  # type: ignore[attr-defined]
            r, a = (np.zeros(3), np.eye(3)) if body == "ground" else (first[body].q[:3, 0], _turned(first[body]))
            for key, of in (("point", a.T @ (point - r)), ("axis", a.T @ axis), ("zero", a.T @ zero)):
                own[f"{key}_{side}"] = tuple(of.tolist())
        joints.append(replace(joint, **own))
    mechanism = replace(scene.mechanism, joints=tuple(joints))
    return replace(scene, mechanism=mechanism, effects=frozenset())


def _turned(body: Any) -> Any:
    return np.asarray(body.rotation).reshape(3, 3)


def test_a_loop_that_cannot_move_is_not_swept_along_least_squares_to_where_it_closes_again() -> None:
    """The driver turns once around: the second pose is the first, and there is none on the way."""
    motion = refkin.solve(loop())

    assert motion.status == (Status.OK, Status.BRANCH_LOST)
    assert sweep(loop()).status == motion.status  # the plain one stepped along them for minutes


def test_a_path_of_a_loop_that_cannot_move_stops_where_it_starts() -> None:
    path = refkin.follow(loop())

    assert path.end is TraceEnd.STOPPED
    assert np.max(path.residual) <= 1e-9
    assert np.max(np.abs(path.t - path.t[0])) < 1e-6


@pytest.mark.parametrize("phi", [-2.8, -0.4, 1.8, 2.6])
def test_rows_that_are_held_against_no_root_leave_a_slider_idle_that_nothing_moves_along(phi):
    """Two drivers of the arm, and one across the slide: ok, as what redundant rows were off by was no number."""
    cos, sin = math.cos(phi), math.sin(phi)
    slide = {"body_i": "arm", "point_i": ORIGIN, "axis_i": (cos, -sin), "body_j": "slider", "point_j": ORIGIN}
    pin = Revolute(name="pin", body_i=GROUND, point_i=ORIGIN, body_j="arm", point_j=ORIGIN)
    still, turn, push = (Polynomial(coefficients=(x,)) for x in (0.0, phi, 0.7 * cos - 0.4 * sin))
    drivers = (
        AngleDriver(name="turn", body="arm", law=turn),
        refkin.YDriver(name="lift", body="slider", law=still),
        refkin.XDriver(name="push", body="arm", point=(0.7, 0.4), law=push),
    )
    bodies = tuple(Body(name=name, estimate=(0.0, 0.0, phi)) for name in ("arm", "slider"))
    mechanism = Mechanism(bodies, (pin, refkin.Prismatic(name="slide", **slide)), drivers)
    motion = solve(Scene(mechanism=mechanism, times=(0.0,), effects=frozenset()))

    assert motion.verdict == "singular"
    assert "idle motion: with the drivers held slider can still move on and on" in motion.message


@pytest.mark.parametrize("form", ["half", "dot", "printed"])
@pytest.mark.parametrize(
    ("law", "missing"), [((0.0,), 0), ((0.0, 1.0), 1), ((0.0, 0.0, 1.0), 2)], ids=["still", "rate", "acceleration"]
)
def test_a_body_on_two_crossed_hinges_is_locked_if_it_is_driven_though_rows_say_nothing_but_zeros(
    form: Any, law: tuple[float, ...], missing: int
) -> None:
    """Rows of zeros, at 0, are off by nothing of nothing: no number, it hid the others, and what is driven was ok."""
    about_z: Any = {"axis_i": (0.0, 0.0, 1.0), "axis_j": (0.0, 0.0, 1.0), "zero_i": (1.0, 0.0, 0.0)}
    about_x: Any = {"axis_i": (1.0, 0.0, 0.0), "axis_j": (1.0, 0.0, 0.0), "zero_i": (0.0, 1.0, 0.0)}
    ends: Any = {"body_i": GROUND, "point_i": (0.0,) * 3, "body_j": "plate", "point_j": (0.0,) * 3, "form": form}
    hinges = tuple(
        SpatialRevolute(name=name, zero_j=axes["zero_i"], **ends, **axes)
        for name, axes in (("z", about_z), ("x", about_x))
    )
    driver = SpatialAngleDriver(name="motor", joint="z", law=Polynomial(coefficients=law))
    plate = Body(name="plate", estimate=(0.0, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0))
    motion = solve(Scene(mechanism=Mechanism((plate,), hinges, (driver,)), times=(0.0,)))

    assert motion.verdict is (Status.LOCKED if missing else Status.OK)
    rates = [bool(np.isfinite(level).all()) for level in motion.levels[1:]]
    assert rates == [missing != 1, missing == 0]
