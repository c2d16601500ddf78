"""Bodies that spin while nothing else moves: one, or several as one; found, named, held, certified, on both paths."""

from __future__ import annotations

from dataclasses import replace
from functools import cache
from importlib import import_module

import numpy as np
import pytest

import refkin
from refkin import fast
from refkin.joints import GROUND, Cylindrical, DisplacementDriver, SpatialRevolute, passive_spins
from refkin.joints.spatial_vectors import Quaternion
from refkin.model import Mechanism
from refkin.motion import Status
from refkin.motion_laws import Polynomial
from refkin.proof.numbers.bounded import bounded_system
from refkin.proof.numbers.exact import exact_system
from refkin.proof.path.blocks import dips
from refkin.proof.path.curve import Curve
from refkin.scenes.linkages import Hooke
from refkin.solving.mobility import count, mobility_of
from refkin.solving.starts import find_start
from refkin.solving.steps import Steps
from refkin.system import System, compile_system
from tests.passive import (
    SPINNING,
    cylinder,
    driven_halves,
    held,
    loop,
    rod,
    rod_of_two,
    rotation,
    telescope,
    turned,
    two_halves,
)

FORMS = ("half", "dot")
SEED = 7


@cache
def drawn(coupler, seed=SEED):
    return loop(coupler, seed, FORMS)


@cache
def answer(coupler):
    return refkin.solve(drawn(coupler)[0])


def test_the_equations_of_proofs_hold_a_body_as_the_system_does():
    """However those of the same system were held before."""
    scene, _ = drawn(rod)
    system = compile_system(scene.mechanism)
    ways = [system, *(system.held_at(np.random.default_rng(k).uniform(-1.0, 1.0, system.n)) for k in (1, 2)), system]

    assert len({repr(way.gauge) for way in ways}) == 3
    assert [exact_system(way, 64).gauge for way in ways] == [way.gauge for way in ways]
    assert [bounded_system(way).gauge for way in ways] == [way.gauge for way in ways]


def rows(scene, q, t):
    """What joints and drivers say of bodies at poses (r, rotation matrix), in vectors of the ground frame."""
    at, out = {GROUND: (np.zeros(3), np.eye(3)), **q}, []
    joints = {joint.name: joint for joint in scene.mechanism.joints}
    for c in (*scene.mechanism.joints, *scene.mechanism.drivers):
        j = joints[getattr(c, "joint", c.name)]
        (ri, ai), (rj, aj) = at[j.body_i], at[j.body_j]
        d = rj + aj @ j.point_j - ri - ai @ j.point_i
        if hasattr(j, "axis_i"):
            h, k = (a @ (np.array(x) / np.linalg.norm(x)) for a, x in ((ai, j.axis_i), (aj, j.axis_j)))
        if hasattr(j, "zero_i"):
            f, g = (v - h * (h @ v) for v in (ai @ j.zero_i, aj @ j.zero_j))
            angle = np.arctan2(np.cross(f, g) @ h, f @ g)
        if c is not j:
            out.append([(angle if c.type == "angle" else h @ d) - c.law(t)])
            continue
        if j.type in ("spherical", "revolute", "universal", "fixed"):
            out.append(d)
        if j.type in ("revolute", "fixed", "cylindrical", "prismatic", "screw"):
            out.append(np.cross(h, k))
        if j.type in ("cylindrical", "prismatic", "screw"):
            out.append(np.cross(h, d))
        if j.type in ("fixed", "prismatic"):
            out.append([angle])
        if j.type == "screw":
            out.append([h @ d - j.shift - j.pitch * angle])
        if j.type == "universal":
            out.append([h @ k])
        if j.type == "distance":
            out.append([np.linalg.norm(d) - j.length])
    return np.concatenate(out)


def poses(motion, k=0):
    return {body: (motion[body].q[:3, k], rotation(motion[body].q[3:, k])) for body in motion.bodies}


def slope(scene, q, t, step=1e-6):
    """Central differences of the rows by velocities and angular velocities of the bodies in the ground frame."""
    columns = []
    for body, (r, a) in q.items():
        for k, e in enumerate([*np.eye(3)] * 2):
            ends = []
            for x in (step, -step):
                moved = (r + x * e, a) if k < 3 else (r, np.array([turned(v, e, x) for v in a.T]).T)
                ends.append(rows(scene, {**q, body: moved}, t))
            columns.append((ends[0] - ends[1]) / (2 * step))
    return np.array(columns).T


@pytest.mark.parametrize("coupler", SPINNING)
def test_what_spins_alone_or_as_one_is_found_named_held_and_certified(coupler):
    scene, spinning = drawn(coupler)
    motion, system = answer(coupler), compile_system(scene.mechanism, unit=scene.mechanism.unit())

    assert {frozenset(spin) for spin in passive_spins(scene.mechanism.bodies, scene.mechanism.constraints)} == spinning
    assert motion.verdict is Status.OK, motion.message
    assert np.max(motion.certified_radius.acceleration) < 1e-11
    assert motion.message.count("passive degree of freedom: ") == len(spinning)
    named = mobility_of(system, find_start(system, scene).q)
    assert {frozenset(words.partition(" spin")[0].split(" and ")) for words in named.passive} == spinning
    assert named.driven.freedoms == len(spinning)


@pytest.mark.parametrize("coupler", SPINNING)
def test_the_rank_is_that_of_rows_stated_anew_and_the_null_vectors_are_the_spins(coupler):
    scene, spinning = drawn(coupler)
    motion = answer(coupler)
    for k, t in enumerate(motion.t):
        q = poses(motion, k)
        assert np.max(np.abs(rows(scene, q, t))) < 1e-13
        _, sigma, motions = np.linalg.svd(slope(scene, q, t))
        rank = int(np.sum(sigma > 1e-6))
        assert 6 * len(q) - rank == len(spinning)
        moves = np.abs(motions[rank:]).reshape(len(spinning), len(q), 6).max(axis=(0, 2)) > 1e-6
        assert {body for body, moved in zip(q, moves, strict=True) if moved} == frozenset().union(*spinning)


@pytest.mark.parametrize("coupler", SPINNING)
def test_rates_are_those_of_rows_stated_anew_without_a_spin(coupler):
    """Velocities of least square, among all that the rows allow, less the spins of the first body of each group."""
    scene, _ = drawn(coupler)
    motion, k, h = answer(coupler), 1, 1e-5
    t, q = motion.t[k], poses(motion, k)
    rate = (rows(scene, q, t + h) - rows(scene, q, t - h)) / (2 * h)
    v = np.concatenate([np.append(motion[body].qd[:3, k], motion[body].omega[:, k]) for body in q])
    assert np.max(np.abs(slope(scene, q, t) @ v + rate)) < 1e-7
    for spin in passive_spins(scene.mechanism.bodies, scene.mechanism.constraints):
        body, (_, line) = next(iter(spin.items()))
        for level in (motion[body].omega, motion[body].alpha):
            assert abs(level[:, k] @ q[body][1] @ line) < 1e-10 * np.linalg.norm(line)


@pytest.mark.parametrize("coupler", [rod_of_two, driven_halves, telescope, cylinder])
def test_the_fast_path_has_the_rates_without_spin_of_all_bodies_that_spin_as_one(coupler):
    scene, _ = drawn(coupler)
    scene = replace(scene, evidence=frozenset())
    motion, reference = fast.attempt(scene), answer(coupler)

    assert motion is not None
    for body in motion.bodies:
        for level in ("omega", "alpha"):
            off = getattr(motion[body], level) - getattr(reference[body], level)
            assert np.max(np.abs(off)) < 1e-10, f"{level} of {body}"


@pytest.mark.parametrize("gap", [None, 1])
def test_where_several_drivers_move_passive_bodies_each_step_is_proved(gap, monkeypatch):
    scene, _ = drawn(driven_halves)
    proof, asked = import_module("refkin.fast.sweep"), []
    monkeypatch.setattr(proof, "first_unproved", lambda system, t, q, between, steps: asked.append(steps) or gap)

    assert (fast.attempt(replace(scene, evidence=frozenset())) is None) == (gap is not None)
    assert asked == [[0, 1]]


def test_steps_of_redundant_rows_are_halved_by_newton_and_all_second_derivatives_are_one_batch(monkeypatch):
    """A sweep to each middle, and a complex step for each coordinate, took three quarters of its time."""
    scene = loop(telescope, SEED, (*FORMS, "printed"), off=0.002)[0]
    swept, complex_steps, batches = list[int](), list[bool](), list[int]()
    phi_q, bend = System.phi_q, Curve.bend
    monkeypatch.setattr("refkin.solving.sweep.pose_between", lambda *_: swept.append(1))
    monkeypatch.setattr(System, "phi_q", lambda s, q, t: complex_steps.append(np.iscomplexobj(q)) or phi_q(s, q, t))

    def counted(*args):
        before = sum(complex_steps)
        bent = bend(*args)
        batches.append(sum(complex_steps) - before)
        return bent

    monkeypatch.setattr(Curve, "bend", counted)

    assert refkin.solve(scene).verdict is Status.OK
    assert not swept
    assert set(batches) == {1}


@pytest.mark.parametrize(("far", "near"), [(0.29, True), (0.25, False)])
def test_a_loop_with_a_passive_body_that_comes_near_its_limit_is_seen_however_it_is_held(far, near):
    """Two of them side by side: the limit is 0.2904 rad from the first pose, the ends of the step 0.24 and 0.26."""
    scene, _ = drawn(rod, 4)
    m, (motor,) = scene.mechanism, scene.mechanism.drivers
    law = Polynomial(coefficients=(0.3, 4.0 * far, -4.0 * far))
    one = replace(scene, mechanism=replace(m, drivers=(replace(motor, law=law),)), times=(0.1, 0.2, 0.3, 0.5, 0.65))
    motion = refkin.analysis.sweep(one)

    def named(part, n):
        ends = ("name", "body_i", "body_j", "joint")
        return [replace(c, **{k: v + n for k, v in vars(c).items() if k in ends and v != GROUND}) for c in part]

    parts = (m.bodies, m.joints, one.mechanism.drivers)
    both = compile_system(Mechanism(*((*named(part, "1"), *named(part, "2")) for part in parts)), unit=m.unit())
    q = both.to_unit(np.tile(motion.q, (2, 1)))[:, [2, 4]]

    assert motion.verdict is Status.OK
    assert [dips(way, motion.t[[2, 4]], q).tolist() for way in (both, both.held_at(q[:, 1]))] == [[near]] * 2


def test_what_a_link_beside_the_line_holds_is_not_passive():
    scene, spinning = drawn(held)

    assert not spinning
    assert list(passive_spins(scene.mechanism.bodies, scene.mechanism.constraints)) == []


@pytest.mark.parametrize("coupler", [rod, rod_of_two, two_halves])
@pytest.mark.parametrize("off", [1e-9, 1e-3])
def test_a_ball_beside_the_line_of_others_ends_the_spin(coupler, off):
    """A third ball, on the line at first, then moved across it."""
    scene, _ = drawn(coupler)
    m = scene.mechanism
    spins = list(passive_spins(m.bodies, m.constraints))
    body, (through, line) = next(iter(spins[0].items()))
    ball = next(j for j in m.joints if j.type == "spherical" and body in (j.body_i, j.body_j))
    across = np.cross(line, (0.3, -0.5, 0.8)) / np.linalg.norm(line)

    def with_third(shift):
        side = "i" if ball.body_i == body else "j"
        third = replace(
            ball, name="third", **{f"point_{side}": tuple((0.3 * np.array(line) + through + shift).tolist())}
        )
        return {" and ".join(spin) for spin in passive_spins(m.bodies, (*m.constraints, third))}

    assert with_third(0.0 * across) == {" and ".join(spin) for spin in spins}
    assert with_third(off * across) == {" and ".join(spin) for spin in spins[1:]}


@pytest.mark.parametrize("size", [1e-300, 1e-200, 1e200])
def test_axes_of_any_length_are_as_far_from_parallel(size):
    """What short ones have across each other is no number: a Hooke joint was told to spin, and not solved."""
    scene = Hooke(beta=0.5).scene(speed=1.0, samples=3)
    m = scene.mechanism

    def as_long(joint):
        return replace(joint, **{end: tuple(size * x for x in getattr(joint, end)) for end in ("axis_i", "axis_j")})

    long = replace(m, joints=tuple(map(as_long, m.joints)))
    assert list(passive_spins(m.bodies, long.constraints)) == []
    assert refkin.solve(replace(scene, mechanism=long)).verdict is Status.OK


def test_a_body_that_hangs_on_one_joint_lacks_a_driver_and_is_not_passive():
    scene, _ = drawn(rod)
    m = scene.mechanism
    at, axis = (0.1, 0.2, 0.3), (0.0, 0.0, 1.0)
    ends = {"body_i": "c", "point_i": at, "axis_i": axis, "body_j": "d", "point_j": at, "axis_j": axis}
    hanging = SpatialRevolute(name="hook", **ends)
    bodies = (*m.bodies, refkin.Body(name="d"))

    sliding = Cylindrical(name="slide", **ends)
    pushed = DisplacementDriver(name="push", joint="slide", law=Polynomial(coefficients=(0.1,))).among([sliding])

    for joints in ((hanging,), (sliding,), (sliding, pushed)):
        assert [" and ".join(spin) for spin in passive_spins(bodies, (*m.constraints, *joints))] == ["b"]
    with pytest.raises(refkin.RefkinError, match="1 more constraint: add drivers"):
        Mechanism(bodies, (*m.joints, hanging), m.drivers)


def test_rows_that_repeat_others_hide_no_missing_driver():
    """As printed a revolute has seven rows of rank five: they made up for a driver, and the answer was `singular`."""
    m = drawn(rod)[0].mechanism
    printed = tuple(replace(j, form="printed") if j.type == "revolute" else j for j in m.joints)

    assert count(Mechanism(m.bodies, printed, m.drivers)).mobility == count(m).mobility == 2
    with pytest.raises(refkin.RefkinError, match="1 more constraint: add drivers"):
        Mechanism(m.bodies, printed)


def test_a_passive_body_is_held_at_its_estimate_as_at_any_other_pose():
    system = compile_system(drawn(rod)[0].mechanism)
    (p,) = (p for p in system.placed if p.constraint.passive)
    reference = np.array(p.constraint.reference) / np.linalg.norm(p.constraint.reference)

    assert p.constraint.gauge(p.g, np.array([0.0, 0.0, 0.0, *reference])) == pytest.approx(p.g[:4], abs=1e-15)


@pytest.mark.parametrize(("angle", "again"), [(1.5, False), (2.0, True)])
def test_a_passive_body_that_has_turned_far_is_held_as_it_is_there(angle, again):
    """About a line across that of its spin: half of the way round the rows that hold it would be singular."""
    scene, _ = drawn(rod)
    system = compile_system(scene.mechanism)
    (p,) = (p for p in system.placed if p.constraint.passive)
    q = system.to_unit(answer(rod).q[:, 0])
    system = system.held_at(q)
    across = np.cross(p.g[4:7], [0.3, -0.8, 0.5])
    turn = Quaternion.of(np.cos(angle / 2), *(np.sin(angle / 2) * across / np.linalg.norm(across)))
    there, at = q.copy(), system.columns(p.constraint.body)
    there[at][3:] = Quaternion.of(*q[at][3:]).times(turn).parts
    steps = Steps(system, [0.0], [q])
    steps._accept(there, 0.1)

    assert steps.held_from == ([(1, system)] if again else [])
    assert steps.system.gauge == (system.held_at(there) if again else system).gauge
