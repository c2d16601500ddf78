"""What a sweep takes for a step on its branch, each condition on its own; and what is proved of the steps it takes."""

from __future__ import annotations

import math
from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest

import refkin
import refkin.proof.path.branch
import refkin.solving.solve
from refkin import (
    AngleDriver,
    Body,
    Evidence,
    FourBar,
    InvertedSliderCrank,
    Mechanism,
    Polar,
    Polynomial,
    Revolute,
    Scene,
    Sinusoid,
    SliderCrank,
    Status,
    Table,
    YDriver,
    compile_system,
    fast,
)
from refkin.newton import NewtonResult, NewtonStatus
from refkin.proof.path.blocks import diagonal_blocks
from refkin.proof.path.branch import Piece, _halved, _linked, first_unproved, step_over_crossing
from refkin.solving import passages
from refkin.solving.ahead import Leaps
from refkin.solving.solve import _first_unproved
from refkin.solving.steps import Steps
from refkin.solving.sweep import Arrival, Sweep, pose_between
from tests.linkages import PARALLELOGRAM, ROCKER, beside_a_wheel, copied, remade, solved, system_of, with_law
from tests.mutation.change import mutated

from .assembled import beside_a_mast
from .contact_cases import cam, guide

UNPROVED = frozenset({Evidence.CONDITION})


def twice(scene):
    """The scene of a four-bar with its coupler and rocker a second time, on the same crank."""
    return copied(scene, ("coupler", "rocker"))


def swept_to(t):
    """A sweep of the rocker mechanism at two poses, and the pose at t."""
    poses = {s: refkin.solve(ROCKER.scene(law=Polynomial(coefficients=(0.5, 1.0)), times=(s,))) for s in (0.0, 0.1, t)}
    system = system_of(with_law(ROCKER.scene(), Polynomial(coefficients=(0.5, 1.0))))
    q = {s: system.to_unit(motion.q[:, 0]) for s, motion in poses.items()}
    return Sweep(system, [0.0, 0.1], [q[0.0], q[0.1]], asked=t - 0.1), q[t]


def newton_result(q, first, sizes):
    """What Newton's method would return that came from `first` to q by corrections of these sizes."""
    corrections = np.array([np.full(len(q), size) for size in sizes])
    nothing = np.zeros_like(corrections)
    iterates = np.array([first, *[q] * len(sizes)])
    return NewtonResult(NewtonStatus.CONVERGED, q, iterates, nothing, corrections)


def mirrored(sweep, q, t):
    """The pose of the other branch at the same crank angle."""
    other = refkin.solve(ROCKER.scene(law=Polynomial(coefficients=(0.5 + t,)), times=(0.0,), branch="crossed"))
    return sweep.system.to_unit(other.q[:, 0])


def test_a_step_that_meets_every_condition_is_taken():
    sweep, q = swept_to(0.2)

    assert sweep._on_branch(newton_result(q, q + 1e-3, [1e-3, 1e-5]), 0.2)


@pytest.mark.parametrize(
    ("off", "second", "t"), [(1e-3, 2e-4, 0.2), (0.05, 1e-4, 0.2), (2e-3, 1e-6, 0.101)],
    ids=["second correction", "prediction", "prediction of a short step"],
)  # fmt: skip
def test_a_step_far_from_its_prediction_or_with_a_second_correction_that_is_not_small_is_not_taken(off, second, t):
    sweep, q = swept_to(t)

    assert not sweep._on_branch(newton_result(q, q + off, [off, second]), t)


@pytest.mark.parametrize(("jumps", "said"), [([], [4, 3, 2, 1]), ([1], [4, 3, 2]), ([0, 2], [4, 3])])
def test_poses_before_the_last_jump_say_nothing_of_the_next_one(jumps, said):
    sweep, q = swept_to(0.2)
    sweep.t, sweep.q, sweep.jumps = [0.0, 0.1, 0.2, 0.3, 0.4], [q] * 5, jumps

    assert sweep._before(0.5) == said


def test_a_first_step_that_moves_far_is_not_taken():
    sweep, q = swept_to(0.9)
    alone = Sweep(sweep.system, sweep.t[1:], sweep.q[1:], asked=0.8)

    assert not alone._on_branch(newton_result(q, q + 1e-3, [1e-3, 1e-5]), 0.9)


def test_a_step_to_the_other_side_is_not_taken(monkeypatch):
    monkeypatch.setattr("refkin.solving.steps.FURTHEST", np.inf)
    sweep, _ = swept_to(0.2)
    q = mirrored(sweep, None, 0.2)

    assert not sweep._on_branch(newton_result(q, q + 1e-3, [1e-3, 1e-5]), 0.2)


def test_a_pose_is_not_meant_where_the_last_poses_lead_to_the_other_side():
    sweep, q = swept_to(0.2)
    other = mirrored(sweep, None, 0.2)
    crossing = Sweep(sweep.system, sweep.t, [2 * sweep.q[1] - other, sweep.q[1]])

    assert sweep._meant(q, 0.2)
    assert not crossing._meant(q, 0.2)


def test_a_step_that_turns_a_body_by_a_whole_turn_is_not_taken():
    sweep, q = swept_to(0.2)
    turned = q + np.where(np.arange(len(q)) == 5, 2 * np.pi, 0.0)

    assert not sweep._on_branch(newton_result(turned, turned + 1e-3, [1e-3, 1e-5]), 0.2)


@pytest.mark.parametrize(
    ("off", "turn", "taken"),
    [(1.0, 0.0, True), (-1.0, 0.9, True), (1.0, 1.1, None), (2.45, 0.0, None), (-2.45, 0.0, None)],
)
def test_a_pose_next_to_a_singular_one_is_taken_only_on_the_side_of_the_last_pose(off, turn, taken, monkeypatch):
    """A tip is lifted by the top of the sine on a cam's edge; from behind its inflection Newton steps over the top."""
    law = Sinusoid(offset=1.0, amplitude=2.0**-7, angular_frequency=12.0)
    joints, _ = cam(profile=Polar(law=law), follower="point", held=guide("follower"))
    lift = YDriver(name="lift", body="follower", law=Polynomial(coefficients=(0.0, 1.0)))
    bodies = (Body(name="cam"), Body(name="follower"))
    m = Mechanism(bodies=bodies, joints=joints, drivers=(lift,))
    s = (np.pi / 2 + off) / 12
    steps = Steps(compile_system(m, unit=m.unit()), [law(s)], [np.array([0, 0, np.pi / 2 - s, 0, law(s), 0, s])])

    monkeypatch.setattr(Steps, "driven", lambda *_: turn)  # of a driver that turns a joint of space

    assert steps._at_singular_pose(1 + 2.0**-7 - 100 * 2.0**-52) is taken
    assert len(steps.q) == (2 if taken else 1)
    assert steps.singular is bool(taken)
    assert (np.diff([q[6] - np.pi / 24 > 0 for q in steps.q]) == 0).all()


def started(law, linkage=ROCKER, **more):
    """A sweep of a linkage at the first pose of a law."""
    return started_at(linkage.scene(law=law, times=(0.0,)), **more)


def started_at(scene, **more):
    """A sweep at the only pose of a scene."""
    system = system_of(scene)
    return Sweep(system, list(scene.times), [system.to_unit(refkin.solve(scene).q[:, 0])], **more)


def test_a_pose_where_a_law_turns_back_is_taken_back_if_it_is_not_proved_to_be_alone(monkeypatch):
    sweep = started(Sinusoid(offset=0.5, amplitude=0.2, angular_frequency=1.0))
    monkeypatch.setattr(Sweep, "_is_alone", lambda _: False)

    assert sweep.to(2.0) is Arrival.STOPPED
    assert sweep.t[-1] < 0.5 * math.pi
    assert len(sweep.t) == len(sweep.q)


@pytest.mark.parametrize(("slack", "alone"), [(1e-8, True), (0.0, False)])
def test_the_last_pose_is_alone_at_its_own_time_or_is_known_to_be_singular(slack, alone):
    """Almost flat, where the other assembly is near; the poses before, and their times, are half a radian off."""
    linkage, t = FourBar(ground=4.0, crank=1.0, coupler=2.0 + slack, rocker=3.0), [0.0, 0.5, 1.0]
    m = linkage.scene(law=Polynomial(coefficients=(math.pi - 1.0, 1.0)), times=(0.0,)).mechanism
    system, poses = compile_system(m, unit=m.unit()), [linkage.assemble(math.pi - 1.0 + x) for x in t]
    q = [system.to_unit(np.concatenate([pose[body.name] for body in m.bodies])) for pose in poses]
    sweep = Sweep(system, t, q)

    assert (sweep._is_alone(), not sweep.singular) == (alone, alone)


def test_a_law_that_turns_back_a_rounding_before_the_time_itself_does_not_stop_it_there(monkeypatch):
    sweep = started(Sinusoid(offset=0.5, amplitude=0.2, angular_frequency=0.01))
    monkeypatch.setattr(Sweep, "_is_alone", lambda _: False)

    assert sweep.to(math.nextafter(50.0 * math.pi, 200.0)) is Arrival.REACHED


def test_a_law_bends_beyond_a_digit_as_at_the_digits_around_it_within_the_times():
    digit = math.ulp(1.0)
    bends = {1.0 - digit / 2.0: 7.0, 1.0: 0.0, 1.0 + digit: 3.0, 1.0 + 2.0 * digit: 5.0}

    def law(t, order):
        return np.array([bends.get(x, 11.0) for x in t.tolist()])

    further = passages._beyond_digits(law, np.array([1.0, 1.0 + digit]), 1.0, 1.0 + 2.0 * digit)
    assert further.tolist() == [3.0 * digit**2, 5.0 * digit**2]


@pytest.mark.parametrize("doubted", ["", "its range", "its ends", "its last pose"])
def test_a_range_that_is_gone_through_leads_to_a_pose_that_is_beyond_doubt(monkeypatch, doubted):
    """By 1.3 and 0.7 from 1 to the last value; a coordinate of the pose there may be off by round-off."""
    law = Sinusoid(amplitude=0.3, angular_frequency=9.0, offset=1.0)
    sweep, lines, right, line = started(law), [], passages.position, passages._with_line
    q = passages.over_a_range(sweep, 7.0)
    last, off = sweep.system.phi_q(q, 7.0), passages.SAME * max(1.0, np.max(np.abs(q))) * (1.1 if doubted else 0.9)

    def beside(*args):
        result = right(*args)
        return replace(result, q=result.q + off * (np.arange(9) == 4))

    monkeypatch.setattr(passages, "_with_line", lambda *given: lines.append(given[2:]) or line(*given))
    if doubted == "its range":
        monkeypatch.setattr(Sweep, "unproved", [0])
        monkeypatch.setattr(Sweep, "first_unproved", lambda *_: 0)
    elif doubted == "its ends":
        clear = {True: 0.5 * passages.CLEAR, False: 1.0}
        monkeypatch.setattr(passages, "sigma_min", lambda slope: clear[bool(np.allclose(slope, last, atol=1e-9))])
    else:
        monkeypatch.setattr(passages, "position", beside)
    pose = passages.over_a_range(sweep, 7.0)

    assert (pose is None) == bool(doubted)
    ways = [(1.0, 1.3), (1.3, 0.7), (0.7, law(7.0))]
    assert np.array(lines) == pytest.approx(np.array(ways[: 1 if doubted == "its range" else 3]), abs=1e-12)


@pytest.mark.parametrize(("turns", "moved", "known"), [(5, 0.0, True), (4, 0.0, False), (5, 0.01, False)])
def test_a_pose_many_turns_on_is_where_the_wheel_is_and_the_loops_come_back(turns, moved, known):
    sweep = started(Polynomial(coefficients=(0.5, 1.0)))
    winding = passages.Winding.of(sweep.system, sweep.q[0], 0.0)
    winding.closed = math.tau * (np.arange(9) == 2) + moved * (np.arange(9) == 8)
    pose = winding.wound(sweep.q[0], 5 * math.tau, turns)

    assert (pose is not None) == known
    assert pose is None or np.max(np.abs(pose - sweep.q[0] - turns * winding.closed)) < 1e-13


def test_of_a_step_that_leaves_out_whole_turns_nothing_is_asked_between_its_ends(monkeypatch):
    """The 1600 turns were gone through in parts, for ten seconds and more; what was found was then not looked at."""
    asked, law = [], Sinusoid(amplitude=1e4, angular_frequency=1.0)
    monkeypatch.setattr(passages, "_seen_nearer", lambda system, t, *_: asked.append(float(np.ptp(law(t)))) or True)
    motion = refkin.solve(ROCKER.scene(law=law, times=(0.0, 1.0, 2.0)))

    assert motion.verdict is Status.OK
    assert max(asked, default=0.0) < math.tau


@pytest.mark.parametrize(("off", "singular"), [(0.0, True), (1e-9, True), (1e-5, False), (0.5, False)])
@pytest.mark.parametrize("known", [True, False])
def test_whoever_sets_out_from_a_singular_pose_knows_it(off, singular, known):
    sweep, _ = stepped(PARALLELOGRAM, ("open",), (math.pi - 0.5 - off,))
    sweep.singular = known
    sweep._set_out(sweep.t[0] + 1.0)

    assert bool(sweep.singular) is (known or singular)


@pytest.mark.parametrize("law", [(0.25,), (0.25, 1.0), (0.25, 2.0, -2.0)], ids=["rests", "goes on", "comes back"])
def test_where_two_laws_move_the_first_step_is_a_part_of_the_way(law):
    scene = beside_a_wheel(
        ROCKER.scene(law=Polynomial(coefficients=(0.5, 1.0)), times=(0.25,)), Polynomial(coefficients=law)
    )
    sweep = started_at(scene)
    sweep._set_out(0.75)

    assert sweep.step == (math.inf if len(law) == 1 else 0.0625)


@pytest.mark.parametrize("digits", [2, 4])
def test_where_two_laws_move_the_first_step_is_a_digit_of_the_time_at_least(digits):
    law = Polynomial(coefficients=(0.5, 1.0))
    scene = beside_a_wheel(ROCKER.scene(law=law, times=(0.25, 0.25 + digits * math.ulp(0.25), 0.5)), law)

    assert refkin.solve(scene).verdict is Status.OK


@pytest.mark.parametrize("proving", [True, False])
def test_from_a_singular_first_pose_no_step_is_taken(proving):
    sweep = started(Polynomial(coefficients=(0.0, 1.0)), PARALLELOGRAM, proving=proving)

    assert sweep.to(0.05) is Arrival.STOPPED
    assert sweep.t == [0.0]


def test_from_a_singular_pose_no_step_is_taken():
    sweep = started(Polynomial(coefficients=(np.pi / 2, 1.0)), PARALLELOGRAM)

    assert sweep.to(np.pi / 2) is Arrival.AT_SINGULAR_POSE
    steps = len(sweep.t)
    assert sweep.to(2.0) is Arrival.STOPPED
    assert len(sweep.t) == steps


@pytest.mark.parametrize("first", [5e-7, 1e-8])
@pytest.mark.parametrize("off", [5e-7, 1e-8])
def test_near_a_singular_pose_small_corrections_are_excused_only_where_no_other_root_is_so_near(first, off):
    """Before a flat pose, at 1e-5 from it, sigma is about as small, and the other root as near."""
    law = Polynomial(coefficients=(np.pi / 2, 1.0))
    scene = PARALLELOGRAM.scene(law=law, times=tuple(np.pi / 2 - np.array([3e-5, 2e-5, 1e-5])))
    system, q = solved(scene)
    sweep = Sweep(system, list(scene.times[:2]), [q[:, 0], q[:, 1]], asked=1.0)

    result = newton_result(q[:, 2], q[:, 2] + off, [first, first / 2])
    assert sweep._on_branch(result, scene.times[2]) is (first + off < 1e-7)


def test_a_step_from_which_newton_did_not_converge_is_not_taken():
    sweep, q = swept_to(0.2)
    result = replace(newton_result(q, q + 1e-3, [1e-3, 1e-5]), status=NewtonStatus.ITERATION_LIMIT)

    assert not sweep._on_branch(result, 0.2)


@pytest.mark.parametrize("evidence", [UNPROVED, frozenset(Evidence)], ids=["tests alone", "proved"])
@pytest.mark.parametrize("slack", [1e-3, -1e-5, 1e-7, -1e-9, 1e-11])
def test_two_linkages_that_pass_a_near_change_point_together_stay_on_their_branches(slack, evidence):
    """Both signs change at once, and so that of det phi_q does not: a coarse step was carried over, with verdict ok."""
    linkage = FourBar(ground=3.0, crank=1.25, coupler=2.5, rocker=1.25 - slack + 2 * 0.375)
    times = tuple(np.linspace(0.0, 7.0, 8))
    scene = linkage.scene(law=Polynomial(coefficients=(5.6, 1.0)), times=times, branch="crossed")
    motion = refkin.solve(replace(twice(scene), evidence=evidence, effects=frozenset()))
    expected = np.array([linkage.assemble(phi, "crossed")["rocker"][2] for phi in motion["crank"].phi])
    off = np.abs(np.angle(np.exp(1j * (motion["rocker 2"].phi - expected))))
    ok = np.array([s is Status.OK for s in motion.status])

    assert ok[0]
    assert np.max(off[ok]) < 1e-8


def test_a_small_linkage_beside_a_large_body_passes_its_near_change_point():
    """The branches lie 3e-5 rad apart; what they miss, 1e-12 m, is no rounding of links of millimetres."""
    small = FourBar(ground=4e-3, crank=1e-3, coupler=3.5e-3, rocker=(1.5 + 1e-9) * 1e-3)
    scene = small.scene(law=Polynomial(coefficients=(0.0, 1.0)), times=(3.0, 3.1, 3.2))

    assert refkin.solve(beside_a_mast(scene)).verdict is Status.OK


@pytest.mark.parametrize("angle", [1e12, 1e14])
@pytest.mark.parametrize("turning", [False, True], ids=["alone", "beside one that turns"])
def test_a_linkage_at_a_large_angle_stands_still(angle, turning):
    """Its poses are predicted where they are: to extrapolate the angle itself would leave its rounding, 1e-4 rad."""
    times = np.linspace(0.0, 1.0, 7)
    scene = ROCKER.scene(law=Polynomial(coefficients=(angle,)), times=times)
    motion = refkin.solve(beside_a_wheel(scene, Polynomial(coefficients=(0.0, 1.0))) if turning else scene)

    assert motion.verdict is Status.OK
    assert np.ptp(motion["rocker"].phi) < 1e-14


@pytest.mark.parametrize("evidence", [frozenset(), frozenset(Evidence)], ids=["tests alone", "proved"])
@pytest.mark.parametrize("samples", [5, 8, 14, 30, 100])
def test_a_flat_parallelogram_ends_the_branch(samples, evidence):
    """There it may go on as a parallelogram or as an antiparallelogram: neither is the branch that was asked for."""
    times = tuple(np.linspace(0.0, 4.0, samples))
    scene = PARALLELOGRAM.scene(law=Polynomial(coefficients=(1.0, 1.0)), times=times)
    motion = refkin.solve(replace(scene, evidence=evidence))

    assert motion.status == tuple(Status.OK if t < np.pi - 1.0 else Status.BRANCH_LOST for t in times)


def test_an_uncertified_step_that_is_not_proved_ends_the_branch(monkeypatch):
    """A pin that passes its slot's pivot at 1e-9: rounding hides there whether Newton contracts."""
    scene = InvertedSliderCrank(ground=1.0 + 1e-9, crank=1.0).scene(turns=1, samples=9)
    before = refkin.solve(scene)
    asked = []
    monkeypatch.setattr("refkin.solving.sweep.first_unproved", lambda *a: asked.append(a[-1]) or asked[-1][0])
    after = refkin.solve(scene)

    assert before.verdict is Status.OK
    assert asked[0]
    assert after.verdict is Status.BRANCH_LOST


@pytest.mark.parametrize("short", [1e-2, 1e-9])
def test_an_uncertified_step_may_be_off_by_noise_in_the_pose_it_starts_from_and_no_more(short, monkeypatch):
    """Noise is what rounding leaves of phi over sigma_min; below 1e-6 nothing is looked at anyway."""
    law, times = Polynomial(coefficients=(np.pi / 2, 1.0)), np.pi / 2 - short * np.array([3.0, 2.0, 1.0])
    scene = PARALLELOGRAM.scene(law=law, times=(0.0,))
    system = system_of(scene)
    q = [system.to_unit(refkin.solve(replace(scene, times=(t,))).q[:, 0]) for t in times]
    sweep = Sweep(system, list(times[:2]), q[:2], lenient=True, step=short / 2)
    with monkeypatch.context() as patch:
        patch.setattr(Sweep, "_on_branch", lambda *_: False)
        sweep._in_steps(times[2], 1)
    noise = max(1e-6, 256 * np.finfo(float).eps / np.linalg.svd(system.phi_q(q[1], times[1]))[1][-1])

    for off, taken in ((0.9 * noise, True), (1.1 * noise, False)):
        assert sweep._on_branch(newton_result(q[2], q[2] + off, [off, off]), times[2]) is taken, off


@pytest.mark.parametrize("distance", [1e-3, 1e-6, 1e-9, 1e-12])
def test_a_pin_that_passes_the_pivot_of_its_slot_is_followed(distance):
    """The slot turns by half a turn within about a distance: by its law, atan2 of the pin from the pivot."""
    ground = 1.0 + distance
    motion = refkin.solve(InvertedSliderCrank(ground=ground, crank=1.0).scene(turns=1, samples=37))
    phi = motion["crank"].phi
    # 1 + d - cos is 2 sin^2 + d, without cancellation.
    away = 2 * np.sin(phi / 2) ** 2 + (ground - 1.0)
    slot = next(b for b in motion.bodies if b != "crank" and np.ptp(motion[b].phi) > 0.1)
    expected = np.arctan2(-np.sin(phi), away)
    off = np.abs(np.sin(motion[slot].phi - expected))

    assert motion.verdict is Status.OK
    assert np.max(off / (1e-15 + 1e-15 / np.hypot(np.sin(phi), away))) < 8


def test_a_certified_motion_is_that_of_the_plain_solve():
    scene = ROCKER.scene(turns=2, samples=9)
    plain, certified = refkin.solve(scene), refkin.solve(scene, certified=True)

    assert certified.verdict is Status.OK
    assert np.array_equal(plain.q, certified.q)


def test_a_jump_to_the_other_branch_is_no_motion():
    """Both poses are certified, and Newton finds either: only the tube between them is missing."""
    law, t = Polynomial(coefficients=(0.5, 1.0)), (0.0, 0.1, 0.2)
    scene = ROCKER.scene(law=law, times=t)
    system = system_of(scene)
    here, there = (
        system.to_unit(refkin.solve(ROCKER.scene(law=law, times=t, branch=b)).q) for b in ("open", "crossed")
    )

    assert first_unproved(system, t, here, pose_between) is None
    assert first_unproved(system, t, np.column_stack([here[:, :2], there[:, 2:]]), pose_between) == 1


def test_a_singular_pose_is_reported_where_the_motion_is_certified_up_to_it():
    linkage = FourBar(ground=4.0, crank=1.0, coupler=3.5, rocker=1.5)
    motion = refkin.solve(linkage.scene(turns=1, samples=13), certified=True)

    assert list(motion.status[:7]) == [*[Status.OK] * 6, Status.SINGULAR]
    assert set(motion.status[7:]) == {Status.BRANCH_LOST}


def test_dyads_are_blocks_of_their_own():
    system = system_of(twice(ROCKER.scene()))
    generic = np.sqrt(np.arange(2, system.n + 2))
    blocks = diagonal_blocks(system.phi_q(generic, 0.0) != 0)

    assert sorted(len(rows) for rows, _ in blocks) == [1, 1, 1, 6, 6]


def test_a_pattern_without_a_matching_is_one_block():
    pattern = np.array([[True, False], [True, False]])

    assert [len(rows) for rows, _ in diagonal_blocks(pattern)] == [2]


def three_cranks(offset, error=0.0, angle=0.3):
    """A parallelogram with a third crank, its ground points on a line at an angle, far from the origin."""
    along = np.array([np.cos(angle), np.sin(angle)])
    ground = {k: tuple((offset * np.array([1.0, 0.3]) + k * along).tolist()) for k in (0.0, 1.5, 3.0)}
    names = {0.0: "first", 1.5: "middle", 3.0: "last"}
    bodies = [Body(name=names[k], estimate=(*ground[k], 0.7)) for k in ground]
    pin = (ground[0.0][0] + np.cos(0.7), ground[0.0][1] + np.sin(0.7))
    bodies.append(Body(name="coupler", estimate=(*pin, angle)))
    joints = []
    for k, name in names.items():
        base = (ground[k][0] + (error if k == 1.5 else 0.0), ground[k][1])
        joints.append(Revolute(name=f"{name} 0", body_i="ground", point_i=base, body_j=name, point_j=(0.0, 0.0)))
        joints.append(
            Revolute(name=f"{name} 1", body_i=name, point_i=(1.0, 0.0), body_j="coupler", point_j=(float(k), 0.0))
        )
    motor = AngleDriver(name="motor", body="first", law=Polynomial(coefficients=(0.7, 1.0)))
    mechanism = Mechanism(bodies=tuple(bodies), joints=tuple(joints), drivers=(motor,))
    return Scene(name="three cranks", mechanism=mechanism, times=(0.0, 0.1, 0.2, 0.3))


@pytest.mark.parametrize("angle", [0.0, 0.3, 2.9])
@pytest.mark.parametrize("offset", [0.0, 1e3, 1e6, 1e8])
def test_redundant_rows_agree_up_to_the_rounding_of_ground_points_far_away(offset, angle):
    assert refkin.solve(three_cranks(offset, angle=angle)).verdict is Status.OK


@pytest.mark.parametrize(("offset", "error"), [(0.0, 1e-12), (1e3, 1e-9), (1e6, 1e-6), (1e8, 1e-4)])
def test_redundant_rows_that_rounding_does_not_explain_are_refused(offset, error):
    assert refkin.solve(three_cranks(offset, error)).verdict is Status.UNASSEMBLABLE


@pytest.mark.parametrize("steps", [10, 11, 12, 13])
def test_a_sweep_that_gives_up_before_a_law_turns_back_does_not_step_over_it(monkeypatch, steps):
    """So many steps do not lead to t = 0.5, where the law turns, though as many more would lead on from there."""
    law = Sinusoid(amplitude=0.5, angular_frequency=math.pi)
    linkage = FourBar(ground=4.0, crank=2.0, coupler=1.5, rocker=2.5)
    monkeypatch.setattr("refkin.solving.sweep.MOST_STEPS", steps)

    assert refkin.solve(linkage.scene(law=law, times=(0.0, 0.6))).status == (Status.OK, Status.NOT_CONVERGED)


def stepped(linkage, branches, times, law=Polynomial(coefficients=(0.5, 1.0))):  # noqa: B008
    """A sweep that says it went from one pose of a branch to the next, with none of its steps in doubt."""
    scene = linkage.scene(law=law, times=tuple(times))
    system, m = system_of(scene), scene.mechanism
    poses = [linkage.assemble(law(t), branch) for branch, t in zip(branches, times, strict=True)]
    q = [system.to_unit(np.concatenate([pose[b.name] for b in m.bodies])) for pose in poses]
    return Sweep(system, list(times), q), scene


@pytest.mark.parametrize(
    ("certified", "uncertified", "gap"), [(True, [], 1), (False, [], None), (False, [1], 1), (False, [0], None)]
)
def test_a_step_to_the_other_branch_is_a_gap_if_it_is_asked_for(certified, uncertified, gap):
    """Every step where all are to be proved, else those in doubt."""
    sweep, scene = stepped(ROCKER, ("open", "open", "crossed"), (0.0, 0.1, 0.2))
    sweep.uncertified[:], sweep.certified = uncertified, certified

    assert _first_unproved(sweep, scene.times, Leaps(sweep, ())) == gap


@pytest.mark.parametrize(
    ("branches", "times", "gap"),
    [
        (("open", "open", "open", "open"), (0.0, 1.0, 2.0, 3.0), 2),
        (("crossed", "open", "open", "open"), (0.0, 1.0, 2.0, 3.0), 0),
        (("open", "open", "crossed", "crossed"), (0.0, 1.0, 3.0), 2),
    ],
)
def test_beside_a_crossing_only_steps_to_the_times_before_it_need_a_proof(branches, times, gap):
    """A parallelogram steps over its flat pose between t = 2 and 3; steps that lead to no time before it are free."""
    sweep, _ = stepped(PARALLELOGRAM, branches, (0.0, 1.0, 2.0, 3.0))
    sweep.uncertified[:], sweep.certified = [2], True

    assert _first_unproved(sweep, times, Leaps(sweep, ())) == gap


@pytest.mark.parametrize(("half", "slack"), [(0.1, 0.0), (1e-9, 0.0), (0.1, 2.0**-48)])
def test_a_crossing_in_the_middle_of_a_step_is_in_it_however_short_it_is(half, slack):
    """Poses beside it are found to the root of round-off, which is more than a short step moves.

    A slack of mu = 2 EPS is none: of the angle pi, the largest coordinate, rounding is as much.
    """
    flat, linkage = math.pi - 0.5, replace(PARALLELOGRAM, ground=3.0 - slack)
    sweep, _ = stepped(linkage, ("open", "open"), (flat - half, flat + half))

    assert step_over_crossing(sweep.system, sweep.t, np.array(sweep.q).T, [0]) == 0


@pytest.mark.parametrize(("turns", "met"), [(0, 2), (1, None)])
def test_a_crossing_is_in_the_step_that_has_its_time_and_its_pose(turns, met):
    """Found from steps beside it; not in one whose coupler is a whole turn further, nor where Newton finds no point."""
    times = math.pi - 0.5 + np.array([-0.5, -0.4, -0.1, 0.1, 0.4, 0.5])
    sweep, _ = stepped(PARALLELOGRAM, ("open",) * 6, times)
    q = np.array(sweep.q).T
    q[5, 2:4] += turns * math.tau

    assert step_over_crossing(sweep.system, sweep.t, q, [0, 4, 2]) == met
    assert step_over_crossing(sweep.system, sweep.t, q + 1e9, [0, 4, 2]) is None


@pytest.mark.parametrize("steps", [[4], [0, 4], [0, 2, 4, 6]])
def test_a_crossing_is_looked_for_from_the_middle_of_the_first_step_and_of_the_middle_one(steps):
    """The crank swings through its flat pose at each multiple of pi: from step 0 Newton comes to that at 2 pi."""
    times = math.tau * np.array([1.05, 1.08, 1.12, 1.16, 1.97, 2.03, 2.1, 2.2])
    sweep, _ = stepped(
        PARALLELOGRAM, ("open",) * 8, times, Sinusoid(offset=math.pi, amplitude=0.5, angular_frequency=1.0)
    )

    assert step_over_crossing(sweep.system, times, np.array(sweep.q).T, steps) == 4


def test_the_worse_of_two_bounds_widens_a_tube():
    """Two poses that are known well are linked; with one of them known to half a radian nothing is proved."""
    sweep, _ = stepped(ROCKER, ("open", "open"), (0.0, 0.02))
    good, bad = np.full(9, 1e-14), np.full(9, 0.5)
    pieces = [Piece(*sweep.t, *sweep.q, *radii, 0) for radii in ((good, good), (good, bad), (bad, good))]

    assert _linked(sweep.system, pieces).tolist() == [True, False, False]


def test_two_poses_are_known_if_every_coordinate_of_both_is():
    known, partly = np.full(9, 1e-14), np.where(np.arange(9) == 4, np.nan, 1e-14)
    radii = (known, known), (known, partly), (partly, known)

    assert [Piece(0.0, 1.0, None, None, *pair, 0).is_certified for pair in radii] == [True, False, False]


@pytest.mark.parametrize(("wide", "linked"), [(1.0, True), (0.4, False)])
def test_a_tube_links_no_poses_that_it_does_not_hold(wide, linked, monkeypatch):
    """As wide as two poses may be off, or less, whatever is proved in it."""
    sweep, _ = stepped(ROCKER, ("open", "open"), (0.0, 0.02))
    known = np.full(9, 1e-9)
    tube = SimpleNamespace(proved=np.array([True]), w=wide * known[:, None])
    monkeypatch.setattr(refkin.proof.path.branch, "Tubes", lambda *_: tube)

    assert _linked(sweep.system, [Piece(*sweep.t, *sweep.q, known, known, 0)]).tolist() == [linked]


def test_between_two_neighbouring_times_there_is_no_middle(monkeypatch):
    monkeypatch.setattr(refkin.proof.path.branch, "_near_chords", lambda system, times, q_0, q_1: (q_0 + q_1) / 2)
    sweep, _ = stepped(ROCKER, ("open", "open"), (1.0, float(np.nextafter(1.0, 2.0))))
    piece = Piece(*sweep.t, *sweep.q, *np.zeros((2, 9)), 0)

    assert _halved(sweep.system, [piece], lambda system, q, *_: q) == ([], [piece])


def test_a_step_is_halved_at_the_pose_in_its_middle_with_the_bound_of_its_own_error():
    sweep, _ = stepped(ROCKER, ("open", "open", "open"), (0.0, 0.1, 0.2))
    known = np.full(9, 1e-9)
    (first, second), left = _halved(sweep.system, [Piece(0.0, 0.2, sweep.q[0], sweep.q[2], known, known, 7)], None)

    assert (left, first.t_0, first.t_1, second.t_0, second.t_1) == ([], 0.0, 0.1, 0.1, 0.2)
    assert (first.number, second.number) == (7, 7)
    assert np.array_equal([first.q_0, second.q_1], [sweep.q[0], sweep.q[2]])
    assert np.array_equal([first.q_1, first.r_1], [second.q_0, second.r_0])
    assert np.array_equal([first.r_0, second.r_1], [known, known])
    assert (np.abs(first.q_1 - sweep.q[1]) <= first.r_1 + 1e-15).all()
    assert (first.r_1 < 1e-13).all()


def test_without_evidence_a_pose_whose_residual_is_more_than_round_off_is_not_taken_as_it_is():
    """Newton's root moved by 1e-10: what is reported is the root, or it is not ok."""
    scene = replace(ROCKER.scene(law=Polynomial(coefficients=(0.5, 1.0)), times=(0.0,)), evidence=frozenset())
    root = refkin.solve(scene).q
    with mutated("refkin.solving.starts:find_start", "Start(Status.OK, first.q)", "Start(Status.OK, first.q + 1e-10)"):
        motion = refkin.solve(scene)

    assert motion.verdict is not Status.OK or np.max(np.abs(motion.q - root)) < 1e-14


def test_after_a_pose_that_is_not_proved_none_is_one_of_the_branch():
    """Though each of them is proved to be alone."""
    with mutated("refkin.solving.solve:_Answer._prove", "return isolation.ok", "return isolation.ok & (samples != 1)"):
        motion = refkin.solve(ROCKER.scene(samples=4))

    assert motion.status == (Status.OK, Status.SINGULAR, Status.BRANCH_LOST, Status.BRANCH_LOST)
    assert np.isfinite(motion.q).all(axis=0).tolist() == [True, True, False, False]


@pytest.mark.parametrize("knot", [240, 248, 406])
def test_a_pulse_of_a_table_between_two_times_is_not_stepped_over(knot):
    """One knot of 1601 takes the crank beyond its limit and back: the rate looked at in 65 places did not show it."""
    linkage = FourBar(ground=0.9, crank=0.3, coupler=0.6, rocker=0.45)
    limit = linkage.input_range()[0][1]
    argument, value = np.linspace(0.0, 2.0, 1601), np.full(1601, limit - 0.4)
    value[knot] = limit + 0.3
    first = linkage.assemble(limit - 0.4, "open")
    scene = linkage.scene(law=Polynomial(coefficients=(limit - 0.4,)), times=(0.0, 1.0, 2.0))
    bodies = tuple(replace(b, estimate=tuple(map(float, first[b.name]))) for b in scene.mechanism.bodies)
    pulse = Table(argument=tuple(argument.tolist()), value=tuple(value.tolist()))
    motion = refkin.solve(with_law(remade(scene, bodies=bodies), pulse))

    assert [str(status) for status in motion.status] == ["ok", "branch_lost", "branch_lost"]


@pytest.mark.parametrize("solving", [refkin.solve, fast.sweep])
@pytest.mark.parametrize("estimate", [1.2, 1.545, 1.569, 1.571, 1.64, 1.9])
def test_the_first_pose_is_the_nearest_though_newton_goes_far_and_contracts_there(solving, estimate):
    """A tip at y = 1/2: near the top the first correction is of any size, and the second is small against it."""
    pin = Revolute(name="A", body_i="ground", point_i=(0.0, 0.0), body_j="a", point_j=(0.0, 0.0))
    lift = YDriver(name="lift", body="a", point=(1.0, 0.0), law=Polynomial(coefficients=(0.5, 0.1)))
    arm = Mechanism((Body(name="a", estimate=(0.0, 0.0, estimate)),), (pin,), (lift,))
    phi = solving(Scene(mechanism=arm, times=(0.0, 1.0)))["a"].phi[0]

    assert phi == pytest.approx(math.asin(0.5) if estimate < math.pi / 2 else math.pi - math.asin(0.5))


@pytest.mark.parametrize("speed", [1e10, 1e20])
def test_of_what_float64_knows_little_of_the_fast_path_says_no_more_than_the_reference(speed):
    """A crank of which no digit was left was ok, a metre off, with a radius of 3331."""
    pin = Revolute(name="A", body_i="ground", point_i=(0.0, 0.0), body_j="a", point_j=(-1.0, 0.0))
    motor = AngleDriver(name="motor", body="a", law=Polynomial(coefficients=(0.25, speed)))
    crank = Mechanism((Body(name="a", estimate=(1.0, 0.0, 0.25)),), (pin,), (motor,))
    scene = Scene(mechanism=crank, times=(0.0, 0.3))

    assert fast.sweep(scene).status == refkin.solve(scene).status == (Status.OK, Status.NOT_CONVERGED)


def test_of_many_the_one_that_newton_takes_far_from_its_estimate_is_not_ok():
    scene = SliderCrank(crank=1.0, rod=3.0).scene(law=Polynomial(coefficients=(0.3, 1.0)), times=(0.0, 0.1))
    at = {body.name: body.estimate for body in scene.mechanism.bodies}
    rod = (*at["connecting_rod"][:2], at["connecting_rod"][2] + np.array([0.0, 1.57 + 0.0987, 1.5725 + 0.0987]))
    many = fast.solve_many(scene, {}, {**at, "connecting_rod": rod})

    assert [many.status(sample)[0] is Status.OK for sample in range(3)] == [True, False, False]


@pytest.mark.parametrize(
    ("lengths", "turned", "estimates", "crank"),
    [
        (
            (1.3348, 1.0635, 1.157, 0.2739),
            -1.8972,
            ((-0.0301, -0.0018, 1.1118), (0.6267, 1.192, -0.7542), (0.2755, -0.02, 0.3519)),
            1.0998583,
        ),
        (
            (0.6185, 1.2265, 1.5339, 0.5984),
            4.0249,
            ((0.0337, -0.1405, 4.547), (-0.1224, -0.6737, 8.5711), (0.5205, -0.0239, 2.8158)),
            4.5049616,
        ),
    ],
)
def test_newton_contracts_to_an_assembly_that_is_five_times_as_far_and_it_is_not_taken(
    lengths, turned, estimates, crank
):
    """A coupler is turned against its crank: of the rows it leaves, Newton jumps over the fold, and then contracts."""
    a, b, c, base = lengths
    pins = (
        ("O", "ground", 0.0, "a", 0.0),
        ("A", "a", a, "b", 0.0),
        ("C", "b", b, "c", c),
        ("B", "ground", base, "c", 0.0),
    )
    joints = tuple(
        Revolute(name=name, body_i=i, point_i=(x, 0.0), body_j=j, point_j=(y, 0.0)) for name, i, x, j, y in pins
    )
    motor = AngleDriver(name="motor", body="b", relative_to="a", law=Polynomial(coefficients=(turned,)))
    bodies = tuple(Body(name=name, estimate=q) for name, q in zip("abc", estimates, strict=True))
    scene = Scene(mechanism=Mechanism(bodies, joints, (motor,)), times=(0.0,))
    many, large = fast.solve_many(scene, {"A": {"point_i": (np.full(2, a), 0.0)}}), fast.solve_large(scene)

    assert [solving(scene)["a"].phi[0] for solving in (refkin.solve, fast.sweep)] == pytest.approx([crank] * 2)
    assert many.status(0)[0] is not Status.OK or many.q[2, 0, 0] == pytest.approx(crank)
    assert large.status is not Status.OK or large.q[2] == pytest.approx(crank)


@pytest.mark.parametrize(("smallest", "solvable", "known"), [(1e-2, True, False), (1e-6, False, True)])
def test_what_is_below_the_rounding_of_the_largest_entries_is_nothing_to_solve_with(smallest, solvable, known):
    """Rows of 1e12 are rounded by 1e-4: a singular value of 1e-6 is asked for, and is none."""
    system = SimpleNamespace(m=2, n=2, placed=(), phi=lambda q, t: 0.0 * q)
    system.held_at, system.phi_q = lambda q: system, lambda q, t: np.diag([1e12, smallest])[..., None]
    scene = SimpleNamespace(times=(0.0,), evidence=frozenset())
    answer = refkin.solving.solve._Answer(system, scene, np.zeros((2, 1)), [Status.OK], "")

    assert answer._look(np.array([0]))[0].tolist() == [solvable]
    assert np.isfinite(answer.sigma_min).tolist() == [known]


@pytest.mark.parametrize("beyond", [1e-3, 1e-6, 1e-9, 1e-12])
def test_no_pose_beyond_a_flat_parallelogram_is_called_ok_on_the_other_branch(beyond):
    times = [-0.5, -0.3, -0.1, -beyond, beyond, 0.1]
    law = Polynomial(coefficients=(0.0, 1.0))
    motion = refkin.solve(PARALLELOGRAM.scene(law=law, times=times, branch="crossed", effects=()))

    ok = np.array([status is Status.OK for status in motion.status])

    assert motion["coupler"].phi[ok] == pytest.approx(0.0, abs=1e-7)
    assert ok[:3].all()


@pytest.mark.parametrize("beyond", [1e-6, 3e-8, 3.0000000000000004e-09])
@pytest.mark.parametrize("size", [1.0, 2.3])
def test_an_estimate_nearer_to_a_parallelogram_than_to_its_twin_starts_the_parallelogram(beyond, size):
    """Newton starts within a thousandth of what lies between them; rounding over sigma_min is more than that."""
    linkage = refkin.FourBar(ground=3 * size, crank=size, coupler=3 * size, rocker=size)
    scene = linkage.scene(law=Polynomial(coefficients=(np.pi + beyond, 1.0)), times=[0.0], branch="crossed", effects=())
    off = 1e-3 * beyond
    phi = np.pi + beyond
    c, s = np.cos(phi) * size, np.sin(phi) * size
    crank, coupler, rocker = (c / 2, s / 2, phi), (c + 1.5 * size, s, off), (c / 2 + 3 * size, s / 2, phi)
    estimates = {"crank": crank, "coupler": coupler, "rocker": rocker}
    bodies = tuple(replace(body, estimate=estimates[body.name]) for body in scene.mechanism.bodies)
    motion = refkin.solve(remade(scene, bodies=bodies))

    assert motion.verdict in (Status.OK, Status.SINGULAR)
    assert motion.verdict is Status.SINGULAR or abs(motion["coupler"].phi[0]) <= beyond / 4


def test_an_estimate_that_is_a_singular_pose_to_the_bit_is_a_start():
    """Newton has nothing to correct there."""
    linkage = refkin.FourBar(ground=3.0, crank=3.0, coupler=1.0, rocker=1.0)
    scene = linkage.scene(law=Polynomial(coefficients=(0.5, 1.0)), times=[0.0], branch="open", effects=())
    estimates = {"crank": (1.5, 0.0, 0.0), "coupler": (3.5, 0.0, 0.0), "rocker": (3.5, 0.0, 0.0)}
    bodies = tuple(replace(body, estimate=estimates[body.name]) for body in scene.mechanism.bodies)
    motion = refkin.solve(remade(with_law(scene, Polynomial(coefficients=(0.0, 1.0))), bodies=bodies))

    assert motion.verdict is Status.SINGULAR
    assert np.isfinite(motion.q).all()


@pytest.mark.parametrize("beyond", [1e-2, 1e-6, 1e-10])
def test_a_limit_that_is_passed_and_come_back_from_within_one_step_is_seen(beyond):
    """Both ends of the step have the same pose, and the law turns back between them beyond the limit of the crank."""
    linkage = refkin.FourBar(ground=4.0, crank=2.0, coupler=2.5, rocker=2.0)
    (_, end), *_ = linkage.input_range()
    law = refkin.Sinusoid(amplitude=end * (1.0 + beyond), angular_frequency=1.0)
    scene = linkage.scene(law=Polynomial(coefficients=(end * np.sin(0.5), 1.0)), times=[0.5], branch="open", effects=())
    scene = replace(with_law(scene, law), times=(0.5, np.pi - 0.5))
    first = linkage.scene(law=Polynomial(coefficients=(law(0.5), 1.0)), times=[0.0], branch="open").mechanism.bodies
    scene = remade(scene, bodies=first)

    assert refkin.solve(scene).status == (Status.OK, Status.BRANCH_LOST)
