"""Bodies that spin as one on the engines: found anew, held, and compared but for the spin that they share."""

from __future__ import annotations

from dataclasses import replace
from functools import cache
from itertools import product as pairs

import numpy as np
import pytest

from crosscheck.engines import Level, refused_joints
from crosscheck.engines.loading import load
from crosscheck.engines.spatial.kinds import JointKind
from crosscheck.engines.spatial.passive import _feels, _in_other, _lines, _on, spins
from crosscheck.engines.spatial.reading import Hold, numbers_of
from crosscheck.engines.spatial.turning import joint_frame, product
from crosscheck.judge.comparison import compare, reference
from crosscheck.judge.levels import compare_levels, configurations
from crosscheck.measure.check import check
from crosscheck.scenes.conformance import questions
from refkin.joints import SI, passive_spins
from refkin.model import Effect
from tests.passive import SPINNING, driven_halves, held, loop, rod_of_two, rod_with_ballast, telescope, turned

FORMS = ("half", "dot", "printed")


@pytest.mark.parametrize("coupler", [*SPINNING, held])
def test_what_spins_is_found_twice_and_alike_wherever_frames_lie(coupler):
    for seed in range(4):
        mechanism = loop(coupler, seed, FORMS, far=10.0**seed)[0].mechanism
        ours = {" and ".join(spin): spin for spin in passive_spins(mechanism.bodies, mechanism.constraints)}
        theirs = {" and ".join(spin): spin for spin in numbers_of(mechanism, SI).passive}
        assert ours.keys() == theirs.keys()
        for name, lines in ours.items():
            for body, (through, line) in lines.items():
                at, direction = theirs[name][body]
                assert np.max(np.abs(np.cross(direction, line))) < 1e-9 * np.linalg.norm(line)
                assert np.max(np.abs(np.cross(direction, through - at))) < 1e-9 * 10.0**seed


@cache
def answered(coupler):
    scene = loop(coupler, 7, FORMS, off=0.002)[0]
    return scene, reference(scene), load("pinocchio").solve(scene)


@pytest.mark.parametrize("coupler", [rod_of_two, telescope])
def test_engines_agree_with_the_reference_but_for_the_spin_that_bodies_share(coupler):
    record = check(answered(coupler)[0], ["pinocchio", "mujoco", "exudyn"])

    assert [str(seen) for seen in record.disagreements] == []
    assert {a.engine for a in record.answers} == {"pinocchio", "mujoco", "exudyn"}
    for answer in record.answers:
        assert (answer.compared, answer.missing) == (3, 0)
        assert max(q.ratio for q in answer.quantities.values()) < 0.1


@pytest.mark.parametrize(("engine", "rows"), [("exudyn", 23), ("mujoco", 22), ("pinocchio", 15)])
def test_rows_of_joints_as_printed_are_compared_in_the_form_that_the_engine_has(engine, rows):
    """They were refused, with `no elements say what it is`; a wrong entry in such a row shows at its level."""
    scene = loop(rod_with_ballast, 7, ("printed",))[0]
    loaded, m = load(engine), scene.mechanism
    q = np.concatenate([body.estimate for body in m.bodies])[:, None]
    model, at = loaded.constraints(scene), configurations(m, q, scene.times[:1], "s", 3)
    levels = compare_levels(loaded, model, m, at, loaded.terms(scene))
    assert {level.agrees for level in levels.values()} == {True}
    assert {level.rows for level in levels.values()} == {rows}
    assert not any("no elements" in reason for _, _, reason in refused_joints(loaded, m.joints, Level.JACOBIAN))
    printed = next(
        k for k, row in enumerate(model.rows) if row.constraint in {j.name for j in m.joints if j.type == "fixed"}
    )
    right = model.jacobian

    def wrong(q, t):
        jacobian = right(q, t)
        jacobian[model.rows[printed].engine_row, -1] += 1e-9
        return jacobian

    model.jacobian = wrong
    worst = compare_levels(loaded, model, m, at, loaded.terms(scene))[Level.JACOBIAN]
    model.close()
    assert not worst.agrees


def respun(motion, bodies, lines, angle):
    """An answer with some bodies turned about a line in each, at one angle."""
    q = motion.q.copy()
    for body in bodies:
        k, (at, line) = motion.bodies.index(body), lines[body]
        own, turn = slice(7 * k, 7 * k + 3), slice(7 * k + 3, 7 * k + 7)
        about = np.array([np.cos(angle / 2), *(np.sin(angle / 2) * line)])
        before = product(product(q[turn].T, [0.0, *at]), q[turn].T * [1, -1, -1, -1])[:, 1:]
        q[turn] = product(q[turn].T, about).T
        q[own] += (before - product(product(q[turn].T, [0.0, *at]), q[turn].T * [1, -1, -1, -1])[:, 1:]).T
    return replace(motion, q=q, qd=None, qdd=None)


@pytest.mark.parametrize("coupler", [rod_with_ballast, rod_of_two, driven_halves, telescope])
def test_a_shared_spin_is_no_error_and_a_turn_of_one_against_the_other_is(coupler):
    scene, ref, motion = answered(coupler)
    (lines,) = numbers_of(scene.mechanism, SI).passive

    assert compare(ref, respun(motion, lines, lines, 0.9)).agrees
    for body in lines:
        assert not compare(ref, respun(motion, [body], lines, 1e-9)).agrees


def test_the_closed_form_places_a_rod_with_what_is_fixed_to_it():
    scene, ref, _ = answered(rod_with_ballast)

    assert compare(ref, load("closed_form").solve(scene)).agrees


@pytest.mark.parametrize(("along", "far", "allowed"), [(3.0, 0.0, 3e-12), (0.0, 1e3, 8e-12), (-2.0, 1e3, 1e-11)])
def test_a_point_is_on_a_line_that_misses_it_by_what_rounding_leaves_and_no_more(along, far, allowed):
    """1e-12 of the way to it, and 4e-15 of both places."""
    line = np.array([0.0, far, 0.0]), np.array([0.6, 0.0, 0.8])

    for part, on in ((0.9, True), (1.1, False)):
        assert _on(line[0] + along * line[1] + part * allowed * np.array([0.8, 0.0, -0.6]), line) is on


@pytest.mark.parametrize("sense", [1.0, -1.0])
@pytest.mark.parametrize(
    "kind", [JointKind.REVOLUTE, JointKind.CYLINDRICAL, JointKind.SCREW, JointKind.PRISMATIC, JointKind.FIXED]
)
def test_a_line_along_an_axis_of_a_joint_is_along_it_in_the_other_body_too(kind, sense):
    """Straight in the one, askew in the other."""
    x, z = np.eye(3)[0], np.eye(3)[2]
    ends = {"frame_i": joint_frame(z, x), "frame_j": joint_frame((1.0, 2.0, 2.0), (2.0, 1.0, -2.0))}
    hold = Hold(name="h", kind=kind, body_i="a", body_j="b", u_i=2.0 * x, u_j=np.array([0.0, 3.0, 1.0]), **ends)
    far, askew = hold.u_j + 5.0 * hold.frame_j[:, 2], sense * np.array([1.0, 2.0, 2.0]) / 3.0

    at, line = _in_other(hold, "a", (hold.u_i + 5.0 * z, sense * z))
    assert at == pytest.approx(far if kind in (JointKind.PRISMATIC, JointKind.FIXED) else hold.u_j)
    assert line == pytest.approx(askew)
    at, line = _in_other(hold, "b", (far, askew))
    assert (*at, *line) == pytest.approx(
        (2.0, 0.0, 5.0 * (kind in (JointKind.PRISMATIC, JointKind.FIXED)), *(sense * z))
    )
    beside = _in_other(hold, "a", (hold.u_i + x, z))
    assert (beside is None) == (kind not in (JointKind.PRISMATIC, JointKind.FIXED))


def held_by(kind, i, j):
    """What a joint holds of (point, axes) on its two bodies, or a driver."""
    d, h, other = j[0] - i[0], i[1][2], j[1][2]
    same, on_axis, turn = [axis @ other for axis in i[1][:2]], [axis @ d for axis in i[1][:2]], [i[1][0] @ j[1][1]]
    held = {
        JointKind.SPHERICAL: [d],
        JointKind.REVOLUTE: [d, same],
        JointKind.UNIVERSAL: [d, [h @ other]],
        JointKind.CYLINDRICAL: [same, on_axis],
        JointKind.PRISMATIC: [same, on_axis, turn],
        JointKind.FIXED: [d, same, turn],
        JointKind.PARALLEL: [same],
        JointKind.PERPENDICULAR: [[h @ other]],
        JointKind.ON_LINE: [on_axis],
        JointKind.ON_PLANE: [[h @ d]],
        JointKind.DISPLACEMENT: [[h @ d]],
        JointKind.DISTANCE: [[d @ d]],
    }
    return held if kind is None else np.concatenate(held[kind])


@pytest.mark.parametrize("body", "ij")
@pytest.mark.parametrize("kind", held_by(None, (np.zeros(3), np.eye(3)), (np.zeros(3), np.eye(3))))
def test_a_joint_feels_a_turn_of_one_of_its_bodies_if_what_it_holds_changes(kind, body):
    """Both bodies lie in the ground frame; the turn is about a line through its point or not, along its axis or not."""
    frame, p = joint_frame((1.0, 2.0, 2.0), (2.0, 1.0, -2.0)), np.array([0.3, -0.4, 1.2])
    across = frame[:, [1, 2, 0]] if kind in ("universal", "perpendicular") else frame
    q = p if kind in ("spherical", "revolute", "universal", "fixed") else p + 0.7 * frame[:, 2]
    hold = Hold(name="h", kind=kind, body_i="i", body_j="j", u_i=p, u_j=q, frame_i=frame, frame_j=across)
    ends = {"i": (p, frame.T), "j": (q, across.T)}
    point, axes = ends[body]

    for on, along in pairs((True, False), repeat=2):
        at = point if on else point + 0.3 * axes[0] + 0.2 * axes[1]
        line = axes[2] if along else np.array([0.6, 0.0, 0.8])
        new = at + turned(point - at, line, 0.9), np.array([turned(axis, line, 0.9) for axis in axes])
        changes = not np.allclose(held_by(kind, **ends), held_by(kind, **{**ends, body: new}))
        swings = kind in ("point_on_plane", "displacement") and body == "j" and along and not on
        assert _feels(hold, kind, body, (at, line)) == (changes or swings)  # within the plane: no spin in place


def test_two_points_alike_but_for_rounding_are_no_line_and_a_body_on_one_joint_alone_is_no_spin():
    far, kinds = (
        np.array([0.0, 0.0, 1e4]),
        {"ball": JointKind.SPHERICAL, "weld": JointKind.FIXED, "pin": JointKind.REVOLUTE},
    )
    ends = {"body_i": "ground", "u_i": far, "u_j": far}
    ball, *others = [Hold(name=n, kind=kind, body_j="a" if n == "ball" else "b", **ends) for n, kind in kinds.items()]
    twice = [ball, replace(ball, u_j=far * (1.0 + 1e-13))]

    assert len(list(_lines("a", [(hold, hold.kind) for hold in twice]))) == 4  # along each axis through each
    assert list(spins("ab", [ball, *others], ())) == []


def test_accelerations_alone_of_what_spins_as_it_likes_are_no_fault_and_those_of_other_bodies_are_held():
    """How fast it spins was not asked: honest ones were beyond what is allowed by 4e7 times."""
    (rod,) = (q.scene for q in questions() if q.about == "space: spherical, a rod that spins as it likes")
    scene = replace(rod, effects=frozenset({Effect.ACCELERATION}))
    right = load("closed_form").solve(scene)
    ref, crank = reference(scene), 7 * right.bodies.index("crank")
    wrong = replace(right, qdd=right.qdd + 1e-6 * (np.arange(len(right.qdd)) == crank)[:, None])

    assert compare(ref, right).agrees
    assert not compare(ref, wrong).quantities["acceleration"].agrees
    assert not compare(ref, replace(right, qdd=np.nan * right.qdd)).agrees
    coupler = 7 * right.bodies.index("coupler") + np.arange(3, 7)
    nowhere = right.q.copy()
    nowhere[coupler] = 0.0  # no turn at all
    assert not compare(ref, replace(right, q=nowhere)).agrees
