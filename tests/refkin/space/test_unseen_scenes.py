"""Spatial scene files of all kinds against truths that share no formula with `refkin`, and those that cannot close."""

from __future__ import annotations

import math
import tomllib
from typing import Any

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

import refkin
from refkin import fast
from refkin.joints import DisplacementDriver, Screw, SpatialAngleDriver, SpatialDistance, SpatialRevolute
from refkin.model import Body, Mechanism, Scene
from refkin.motion import Status
from refkin.motion_laws import Polynomial, Sinusoid
from refkin.scenes.files import to_dict
from refkin.scenes.linkages import RSCR, RSSR, Bennett, Bricard, DoubleHooke, Hooke, ScrewJack, Stewart
from tests.places import CORPUS
from tests.refkin.space import random_starts
from tests.refkin.space.truth import Truth, off

U = 2.0**-53
BY_TAPES = ("space-small-and-far.toml", "space-large-and-far.toml")
SOLVED = (
    "space-bodies-at-rest.toml",
    "space-screw-loop-printed.toml",
    "space-seven-joints-dot.toml",
    "space-small-and-far.toml",
    "space-large-and-far.toml",
    "space-points-planes-and-links.toml",
)


def reach(motion, k, rates):
    """Return what the radii allow: a rotation is off by 4 |dp|, omega by 2 |dp'| + 2 |p'| |dp|, both in alpha."""
    radius = motion.certified_radius
    proved = np.array([radius.position[k], radius.velocity[k], radius.acceleration[k]])
    return np.cumsum(4 * proved * rates) * rates + 8 * U * rates


@pytest.mark.parametrize("name", SOLVED)
def test_a_scene_nobody_tuned_for_is_answered_to_its_radii_and_to_ulps_times_its_condition(name):
    path = CORPUS / name
    scene = refkin.load(path)
    truth, motions, size = Truth(tomllib.loads(path.read_text())), [refkin.solve(scene)], scene.mechanism.size()
    exact = truth.near(motions[0].q[:, 0], motions[0].t[0])
    motions += [fast.sweep(scene)] if name in BY_TAPES else []

    for motion in motions:
        errors, rates = off(exact, motion, 0, size)
        scale = max(1.0, np.max(np.abs(motion.q[:, 0])) / size)  # of what metres round to far from the origin
        assert motion.status[0] is Status.OK
        assert (errors <= reach(motion, 0, rates)).all()
        assert (errors <= 8 * U * rates * [truth.condition, truth.condition, truth.condition**2] * scale).all()


def test_the_truth_would_see_an_answer_that_is_wrong():
    """The same scene with one number off by 1e-9."""
    text = (CORPUS / "space-large-and-far.toml").read_text()
    motion = refkin.solve(refkin.load(CORPUS / "space-large-and-far.toml"))
    document = tomllib.loads(text)
    document["joint"][0]["point_i"][0] += 1e-9

    errors, _ = off(Truth(document).near(motion.q[:, 0], 0.0), motion, 0, 1.0)

    assert errors[0] > 1e-11


@pytest.mark.parametrize("name", ["space-leg-too-long.toml", "space-ball-out-of-reach.toml"])
def test_a_loop_of_points_whose_longest_side_is_too_long_is_proved_not_to_close(name):
    motion = refkin.solve(refkin.load(CORPUS / name))

    assert set(motion.status) == {Status.UNASSEMBLABLE}
    assert "than the rest of its loop" in motion.message


LINKAGES = {
    "RSSR by distance": RSSR(1.0, 3.0, 2.0, (2.5, -0.5, 0.75), (0.25, 1.0, 0.125), massless=True),
    "RSCR": RSCR(0.5, 2.0, 2.5, (2.5, -0.5, 0.75), (0.25, 0.5, 1.0)),
    "Bennett": Bennett(1.0, 0.7, 1.2),
    "Bricard": Bricard(1.0, 1.2),
    "double Hooke": DoubleHooke(0.5, 2.0),
    "screw jack": ScrewJack(0.1),
    "Stewart": Stewart.three_three(),
}


@pytest.mark.parametrize("name", LINKAGES)
def test_a_linkage_is_within_its_radii_of_the_truth_in_forty_digits(name):
    """Of redundant rows the truth is what all of them agree on up to the rounding of the linkage's numbers."""
    scene = LINKAGES[name].scene(start=0.9, speed=0.3, turns=0.02, samples=2)
    motion, truth = refkin.solve(scene), Truth(to_dict(scene))

    errors, rates = off(truth.near(motion.q[:, 1], motion.t[1]), motion, 1, scene.mechanism.size())

    assert motion.verdict is Status.OK
    assert np.max(motion.certified_radius.position) < 1e-14
    rounding = 8 * U * truth.condition * rates if name in ("Bennett", "Bricard") else 0.0
    assert (errors <= reach(motion, 1, rates) + rounding).all()


@pytest.mark.parametrize("power", range(1, 9))
def test_near_its_gimbal_pose_a_hooke_joint_is_right_or_says_that_it_is_not(power):
    """Shafts at nearly a right angle, the input's pin in their plane: the ratio of the rates is 1 / b."""
    b = 10.0**-power
    law = Polynomial(coefficients=(math.pi / 2, 1.0))
    scene = Hooke(math.pi / 2 - b).scene(law=law, times=(0.0,))
    motion = refkin.solve(scene)

    assert motion.verdict is Status.OK or (power > 6 and motion.verdict is Status.SINGULAR)
    if motion.verdict is Status.OK:
        truth = Truth(to_dict(scene))
        errors, rates = off(truth.near(motion.q[:, 0], 0.0), motion, 0, 1.0)
        assert (errors <= reach(motion, 0, rates) + 8 * U * truth.condition * rates).all()
        assert errors[0] <= 8 * U * truth.condition


@pytest.mark.parametrize("name", ["space-dot-flipped.toml", "space-printed-flipped.toml"])
def test_rows_with_false_roots_are_begun_at_a_true_one(name):
    scene = refkin.load(CORPUS / name)
    motion = refkin.solve(scene)

    assert motion.verdict is Status.OK
    assert not random_starts.wrong(scene, motion)


@pytest.mark.parametrize("form", random_starts.FORMS)
@pytest.mark.parametrize("name", random_starts.LINKAGES)
def test_no_estimate_leads_to_a_reversed_axis_or_a_crank_half_a_turn_off(name, form):
    """One of the 1,001 estimates a form that `random_starts` goes through."""
    ((_, statuses, wrong, _),) = random_starts.campaign(form, [name], [1])

    assert (statuses, wrong) == ({"ok": 1}, [])


@pytest.mark.parametrize(
    ("turn", "body", "fault"),
    [
        ((0.0, 1.0, 0.0, 0.0), "rocker", "R2: its axes are reversed"),
        ((0.0, 0.0, 0.0, 1.0), "crank", "driver: the angle is half a turn off"),
    ],
)
def test_a_joint_the_wrong_way_round_would_be_seen(turn, body, fault):
    scene = LINKAGES["RSSR by distance"].scene(samples=2)
    motion = refkin.solve(scene)
    turned = Rotation.from_quat(motion[body].q[3:, 0], scalar_first=True) * Rotation.from_quat(turn, scalar_first=True)
    motion[body].q[3:, 0] = turned.as_quat(scalar_first=True)

    assert fault in random_starts.wrong(scene, motion)


def test_two_motors_that_part_lock_the_pose_they_agree_on_and_no_pose_that_is_none():
    hinge = refkin.SpatialRevolute(
        name="hinge",
        **{"body_i": "ground", "point_i": (0.0, 0.0, 0.0), "axis_i": (0.0, 0.0, 1.0), "zero_i": (1.0, 0.0, 0.0)},
        **{"body_j": "arm", "point_j": (1.0, 0.0, 0.0), "axis_j": (0.0, 0.0, 1.0), "zero_j": (1.0, 0.0, 0.0)},
    )
    drivers = (
        refkin.SpatialAngleDriver(name=f"motor {k}", joint="hinge", law=Polynomial(coefficients=(0.0, rate)))
        for k, rate in enumerate((0.2, 0.9))
    )
    arm = refkin.Body(name="arm", estimate=(-1.0, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0))
    mechanism = refkin.Mechanism(bodies=(arm,), joints=(hinge,), drivers=tuple(drivers))

    motion = refkin.solve(refkin.Scene(mechanism=mechanism, times=(0.0, 1.0), effects=frozenset({"velocity"})))

    assert motion.status == (Status.LOCKED, Status.UNASSEMBLABLE), "they are 0.7 rad apart"
    assert np.isfinite(motion.q[:, 0]).all()
    assert np.isnan(motion.q[:, 1]).all()


def hinge(name: str, at: float, x: float = 0.0, body: str = "b") -> SpatialRevolute:
    """Return a hinge about z at the height `at`, and `x` beside where the body has it."""
    frames = {f"{key}_{side}": v for side in "ij" for key, v in (("axis", (0.0, 0.0, 1.0)), ("zero", (1.0, 0.0, 0.0)))}
    return SpatialRevolute(name=name, body_i="ground", point_i=(x, 0.0, at), body_j=body, point_j=(0, 0, at), **frames)


def cranks(*sides: float, longer: float = 0.0) -> Scene:
    """Return cranks side by side at 0.5 rad, each on two rods not quite in its plane: mirrored it misses by 0.008.

    Where a side is -1 its estimate is the mirrored one.
    """
    bodies, joints = [], []
    for k, side in enumerate(sides):
        at, place = 10.0 * k, (10.0 * k + math.cos(0.5), math.sin(0.5), 0.0)
        bodies.append(Body(name=f"b{k}", estimate=(at, 0, 0, math.cos(0.25), 0, 0, side * math.sin(0.25))))
        joints.append(hinge(f"h{k}", 0.0, at, f"b{k}"))
        for x, y, more in ((3.0, 0.0, 0.0), (4.0, 0.1, longer)):
            ends: dict[str, Any] = {"point_i": (at + x, y, 0.0), "point_j": (1, 0, 0)}
            length = math.dist(ends["point_i"], place) + more
            joints.append(SpatialDistance(name=f"{k} {x}", body_i="ground", body_j=f"b{k}", **ends, length=length))
    return Scene(mechanism=Mechanism(tuple(bodies), tuple(joints)), times=(0.0,))


@pytest.mark.parametrize("side", [1.0, -1.0])
def test_a_pose_of_some_of_the_redundant_rows_is_no_assembly_where_there_is_another(side):
    """It was taken for one, and then proved not to meet."""
    motion = refkin.solve(cranks(side))

    assert motion.verdict is Status.OK, motion.message
    assert math.atan2(motion.q[6, 0], motion.q[3, 0]) == pytest.approx(0.25)


def test_a_pose_of_some_of_the_redundant_rows_is_no_proof_where_the_search_finds_no_other():
    """Of eight cranks it does not find the assembly that there is."""
    assert refkin.solve(cranks(*[1.0] * 8)).verdict is Status.OK
    assert refkin.solve(cranks(-1.0, *[1.0] * 7)).verdict is Status.NOT_CONVERGED


@pytest.mark.parametrize("longer", [1e-3, 1e-9])
def test_nothing_starts_at_a_pose_of_some_of_the_redundant_rows(longer):
    scene = cranks(1.0, longer=longer)

    assert "poses of some of the redundant rows contradict others" in refkin.solve(scene).message
    assert refkin.follow(scene).t.size == 0
    with pytest.raises(ValueError, match="the scene has no first pose"):
        refkin.diagnose(scene)


def test_a_gap_that_rounding_explains_proves_nothing_at_any_time():
    """Of a door whose hinges are 1e-16 apart, and whose law turns back too often to be followed."""
    law = Sinusoid(amplitude=1.0, angular_frequency=1e9)
    driver = SpatialAngleDriver(name="d", joint="low", law=law)
    door = Mechanism(
        (Body(name="b", estimate=(0, 0, 0, 1, 0, 0, 0.1)),), (hinge("low", 0), hinge("high", 1, 1e-16)), (driver,)
    )

    assert refkin.solve(Scene(mechanism=door, times=(0.0, 1.0))).status == (Status.OK, Status.NOT_CONVERGED)


@pytest.mark.parametrize("travel", [6e-7, 2e-6])
def test_a_fine_thread_on_a_long_arm_is_proved_in_small_steps(travel):
    """What the chord of the arm's arc leaves out turned the screw by more than a tube holds: it was given up."""
    arm = SpatialRevolute(
        name="R", body_i="ground", point_i=(0, 0, 0), axis_i=(0, 0, 1), zero_i=(1, 0, 0),
        body_j="arm", point_j=(0, 0, 0), axis_j=(0, 0, 1), zero_j=(1, 0, 0),
    )  # fmt: skip
    thread = Screw(
        name="H", body_i="arm", point_i=(1, 0, 0), axis_i=(1, 0, 0), zero_i=(0, 1, 0),
        body_j="nut", point_j=(0, 0, 0), axis_j=(1, 0, 0), zero_j=(0, 1, 0), pitch=6e-7,
    )  # fmt: skip
    turning = SpatialAngleDriver(name="a", joint="R", law=Polynomial(coefficients=(0.3, 0.5)))
    moving = DisplacementDriver(name="d", joint="H", law=Polynomial(coefficients=(0.0, travel)))
    mechanism = Mechanism((Body(name="arm"), Body(name="nut")), (arm, thread), (turning, moving))
    motion = refkin.solve(Scene(mechanism=mechanism, times=(0.0, 1.0)))
    truth = Rotation.from_euler("ZX", [0.8, travel / 6e-7]).as_matrix()

    assert motion.verdict is Status.OK
    assert np.abs(motion["nut"].rotation[..., 1] - truth).max() < 1e-8
