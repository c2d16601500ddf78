"""Intervals of time on which one motion is proved to be the only one near a pose; starts from anywhere."""

from __future__ import annotations

import math
from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest
from flint import arb, ctx

import refkin
from refkin import FourBar, Polynomial, SliderCrank, Status, compile_system
from refkin.motion_laws import Sinusoid
from refkin.proof.numbers.bounded import Times, bounded_system, box, read
from refkin.proof.path import tube
from refkin.proof.path.blocks import Blocks
from refkin.proof.path.branch import first_unproved
from refkin.proof.path.tube import DEEPEST, ConnectionProof, Tubes
from refkin.proof.pose.krawczyk import BallEquations
from refkin.scenes.linkages import Hooke
from refkin.solving import starts as starting
from refkin.solving.starts import _turned_to
from refkin.solving.sweep import pose_between
from tests.linkages import LIMITED, ROCKER, posed, solved, system_of, with_estimates
from tests.places import CORPUS


def widest(system, q, t, qd):
    """The widest interval that a tube proves, of halvings of the first: its half-length and the tube's half-widths."""
    halves = 0.5 ** np.arange(64) / max(np.max(np.abs(qd)), 2.0**-30)
    q, qd = (np.repeat(x[:, None], len(halves), axis=1) for x in (q, qd))
    tubes = Tubes(system, q, qd, np.full(len(halves), t), halves)
    k = np.argmax(tubes.proved)
    return (halves[k], 2 * tubes.w[:, k]) if tubes.proved[k] else (0.0, None)


def interval(scene):
    """The widest interval around the scene's first time, the tube, the system and the pose."""
    system, q = posed(scene)
    t = scene.times[0]
    return *widest(system, q, t, refkin.velocity(system, q, t)), system, q


@pytest.mark.parametrize("d", [0.5, 1e-2, 1e-4, 1e-6, 1e-8])
def test_the_interval_before_a_limit_does_not_reach_it_and_is_a_good_part_of_the_way(d):
    law = Polynomial(coefficients=(LIMITED.input_range()[0][1] - d, 1.0))
    half, *_ = interval(LIMITED.scene(law=law, times=(0.0,)))

    assert d / 100 < half < d


@pytest.mark.parametrize("angle", [0.3, 1.7, 3.0, 5.5])
def test_the_motion_stays_in_the_tube_all_over_the_interval(angle):
    scene = ROCKER.scene(law=Polynomial(coefficients=(angle, 1.0)), times=(0.0,))
    half, radii, system, q = interval(scene)
    rate = refkin.velocity(system, q, 0.0)
    for s in np.linspace(-1.0, 1.0, 9) * half:
        there = ROCKER.scene(law=Polynomial(coefficients=(angle + s, 1.0)), times=(0.0,))
        away = system.to_unit(refkin.solve(there).q[:, 0]) - q - s * rate
        assert np.all(np.abs(away) <= radii + 1e-15)


def test_at_a_singular_pose_no_interval_is_certified():
    scene = SliderCrank(0.25, 0.5).scene(driven="slider", law=Polynomial(coefficients=(0.75, -0.1)), times=(0.0,))
    system, q = posed(scene)

    assert widest(system, q, 0.0, np.zeros_like(q))[0] == 0.0


@pytest.mark.parametrize(("swing", "inside"), [(0.3, True), (0.6, False)])
def test_a_swing_is_one_motion_in_a_few_tubes_and_one_beyond_a_limit_is_none(swing, inside):
    """There and back: both ends are one pose, 0.5 rad from the limit."""
    start = LIMITED.input_range()[0][1] - 0.5
    scene = LIMITED.scene(law=Sinusoid(amplitude=swing, angular_frequency=1.0, offset=start), times=(0.0,))
    system, q = posed(scene)

    assert ConnectionProof(system, 40, pose_between).connects(0.0, math.pi, q, q) is inside


def test_a_step_is_halved_as_often_as_is_stated_before_it_is_given_up(monkeypatch):
    scene = ROCKER.scene(samples=9)
    system = system_of(scene)
    monkeypatch.setattr(ConnectionProof, "_tube_holds", lambda *_: False)
    proof = ConnectionProof(system, 1000, pose_between)

    assert not proof.connects(*scene.times[:2], *system.to_unit(refkin.solve(scene).q).T[:2])
    assert proof.tried == 1 + DEEPEST


@pytest.mark.parametrize(("swing", "holds"), [(1e-7, True), (0.6, False)])
@pytest.mark.parametrize(("start", "sign"), [(-1.0, 1.0), (0.0, -1.0)], ids=["at once", "at last"])
def test_one_tube_holds_no_motion_that_leaves_it_at_either_end(start, sign, swing, holds):
    """A pulse of height 1, (1 + t) t^80 or (1 - t) t^80, that is below 1e-4 but for a sixth of the time."""
    height = 81.0 * math.e * swing
    law = Polynomial(coefficients=(LIMITED.input_range()[0][1] - 0.5, *[0.0] * 79, height, sign * height))
    scene = LIMITED.scene(law=law, times=(start,))
    system, q = posed(scene)

    assert ConnectionProof(system, 1, pose_between).connects(start, start + 1.0, q, q) is holds


def test_one_tube_holds_a_short_turn_in_space_whose_law_stands_in_the_jacobian():
    """At another time than its own the line would leave the equations at once."""
    scene = Hooke(0.5).scene(samples=2, turns=0.03)
    system, q = solved(scene)

    assert ConnectionProof(system.held_at(q[:, 0]), 1, pose_between).connects(*scene.times, *q.T)


@pytest.mark.parametrize(("reach", "holds", "in_balls"), [(0.3, True, True), (0.35, False, True), (0.4, False, False)])
def test_a_tube_in_space_is_proved_over_all_its_times(reach, holds, in_balls):
    """phi_q has the law of the angle: with the one at the middle 0.35 s were proved, where the condition is false."""
    law, frame = Sinusoid(amplitude=2.0, angular_frequency=1.0, offset=3.0), ("point", "axis", "zero")
    ends = {f"{key}_{side}": (float(key == "zero"), 0.0, float(key == "axis")) for key in frame for side in "ij"}
    pin = refkin.SpatialRevolute(name="pin", body_i="ground", body_j="arm", **ends)
    arm, driver = refkin.Body(name="arm"), refkin.SpatialAngleDriver(name="turn", joint="pin", law=law)
    mechanism = refkin.Mechanism((arm,), (pin,), (driver,))
    system = compile_system(mechanism, unit=mechanism.unit())
    times = np.array([math.pi / 2 - reach, math.pi / 2 + reach])
    half = np.array([law(t) / 2 for t in times])
    q = np.array([0 * half, 0 * half, 0 * half, np.cos(half), 0 * half, 0 * half, np.sin(half)])
    middle, v = q.mean(axis=1)[:, None], ((q[:, 1] - q[:, 0]) / (2 * reach))[:, None]

    assert bool(Tubes(system, middle, v, np.array([math.pi / 2]), np.array([reach])).proved[0]) is holds
    assert ConnectionProof(system, 1, pose_between).connects(*times, *q.T) is in_balls


def test_the_poses_between_those_of_a_crank_that_turns_are_found_from_their_chords_alone():
    scene = ROCKER.scene(samples=9)
    system, q = solved(scene)

    assert first_unproved(system, np.array(scene.times), q, between=lambda *_: None) is None


@pytest.mark.parametrize("slack", [1e-5, 1e-7])
def test_a_step_past_a_nearly_singular_pose_is_proved_in_small_pieces_and_not_in_balls(slack, monkeypatch):
    linkage = FourBar(ground=4.0, crank=1.0, coupler=3.0, rocker=2.0 + slack)
    scene = linkage.scene(law=Polynomial(coefficients=(0.2, 1.0)), times=tuple(np.linspace(0.0, 6.0, 61)))
    system, ends = system_of(scene), [10, 50]
    q = system.to_unit(refkin.solve(scene).q[:, ends])
    monkeypatch.setattr(ConnectionProof, "connects", lambda *_: pytest.fail("in balls"))

    assert first_unproved(system, np.array(scene.times)[ends], q, pose_between) is None


def test_a_law_that_moves_fast_has_a_short_interval():
    """The same motion at a thousand times the speed: an interval a thousand times shorter."""
    slow, *_ = interval(ROCKER.scene(law=Polynomial(coefficients=(0.5, 1.0)), times=(0.0,)))
    fast, *_ = interval(ROCKER.scene(law=Polynomial(coefficients=(0.5, 1000.0)), times=(0.0,)))

    assert fast == pytest.approx(slow / 1000, rel=0.1)


def started(x):
    """A scene whose estimates are all somewhere else."""
    scene = ROCKER.scene(law=Polynomial(coefficients=(0.5, 1.0)), times=(0.0,))
    return with_estimates(scene, lambda b: x)


@pytest.mark.parametrize(
    "x", [(0.0, 0.0, 0.0), (1e3, -1e3, 50.0), (1e9, 1e9, 1e6), (1e200, 0.0, 0.0), (0.0, 0.0, 1e300)]
)
def test_from_a_far_start_an_assembly_is_found_and_told(x):
    motion = refkin.solve(started(x))
    expected = [ROCKER.assemble(0.5, branch)["rocker"][2] for branch in ("open", "crossed")]
    off = min(abs(math.remainder(motion["rocker"].phi[0] - phi, math.tau)) for phi in expected)

    assert motion.verdict is Status.OK
    assert off < 1e-9 * max(1.0, abs(motion["rocker"].phi[0]))
    assert "assembly" in motion.message


@pytest.mark.parametrize("held", ["crank", "rocker", "none"])
def test_whole_turns_are_an_estimate_s_but_for_angles_that_a_driver_counts_or_that_have_none(held):
    scene = ROCKER.scene(samples=2)
    system = system_of(scene)
    q, twice = system.to_unit(refkin.solve(scene).q[:, 0]), 2 * math.tau * np.tile([0.0, 0.0, 1.0], 3)
    at = np.repeat(np.array(["crank", "coupler", "rocker"]) == held, 3)

    assert np.array_equal(_turned_to(system, q, q + twice, at, 0.0), q + twice * (at & (held == "rocker")))


def test_the_radius_counts_the_rounding_of_coordinates_far_from_the_origin():
    """The middle of the crank in metres, in 300 bits; to add an origin of 1e6 m to it rounds by up to 6e-11 m."""
    linkage = replace(ROCKER, origin=(1e6 + 0.1, 0.0))
    motion = refkin.solve(
        linkage.scene(law=Polynomial(coefficients=(0.3, 1.0)), times=tuple(np.linspace(0.0, 6.0, 25)))
    )
    with ctx.workprec(300):
        truth = [arb(linkage.origin[0]) + (arb(0.3) + arb(t)).cos() / 2 for t in motion.t]
        off = np.array([float(abs(arb(float(x)) - y).upper()) for x, y in zip(motion["crank"].x, truth, strict=True)])
    size = linkage.scene().mechanism.unit().size

    assert np.max(off) > 1e-11
    assert np.all(off <= motion.certified_radius.position * size)


def test_the_right_sides_over_an_interval_hold_their_values_there():
    law = Sinusoid(amplitude=1.0, angular_frequency=3.0, offset=0.5)
    system = compile_system(ROCKER.scene(law=law, times=(0.0,)).mechanism)
    t, half, q = np.array([0.2, 0.9]), np.array([0.05, 0.2]), np.zeros(system.n)
    over = read(bounded_system(system).nu(box(np.zeros((system.n, 2))), Times(t, 1, half)), 2)
    for part in (-1.0, -0.5, 0.5, 1.0):
        there = np.stack([system.nu(q, at) for at in (t + part * half).tolist()], axis=1)

        assert (np.abs(there - over.mid) <= over.rounding + over.spread + 1e-14).all()


@pytest.mark.parametrize(("converged", "closed"), [(True, False), (False, True)])
def test_a_far_estimate_leads_to_an_assembly_only_where_newton_converged_and_the_joints_close(
    monkeypatch, converged, closed
):
    system = compile_system(ROCKER.scene().mechanism)
    end = SimpleNamespace(converged=converged, q=np.zeros(system.n), residual=0.5, residuals=np.ones((1, system.m)))
    least = SimpleNamespace(converged=False, q=end.q, residual=0.5)
    nothing = SimpleNamespace(ok=[False])
    for name, value in (("position", end), ("least_squares", least), ("closes", closed), ("isolate", nothing)):
        monkeypatch.setattr(starting, name, lambda *_, value=value, **__: value)

    assert starting._far(system, 0.0, np.zeros(system.n), end) == (None, "smallest scaled residual 0.5")


@pytest.mark.parametrize("seed", range(8))
def test_newton_with_balls_goes_on_to_round_off_also_where_it_sets_out_by_growing_steps(seed):
    """Not much less than a size, or a radian, away: where it ends, if anywhere, the joints close in all digits."""
    scene = ROCKER.scene(samples=2)
    system = system_of(scene)
    q = system.to_unit(refkin.solve(scene).q[:, 0]) + 0.8 * np.random.default_rng(seed).uniform(-1.0, 1.0, system.n)
    with ctx.workprec(200):
        equations = BallEquations(system, arb(0), np.arange(system.n), 200)
        root = equations.newton(q)

        assert root is not None
        assert max(abs(x) for x in equations.phi(root).entries()) < 1e-50


@pytest.mark.parametrize("one", [0.25, 8.0])
def test_of_blocks_the_smallest_determinant_counts_and_of_a_batch_each(one):
    """If it is below one: the number is compared with a limit far below."""
    both, slope = Blocks(np.array([0, 3]), np.array([0, 1]), np.zeros((2, 1, 1))), np.diag([one, -4.0])
    signs, logarithms = both.each_of_batch(slope[:, :, None])

    assert both.determinants(slope) == ([1.0, -1.0], min(math.log(one), 0.0))
    assert (signs.tolist(), logarithms.tolist()) == ([[1.0, -1.0]], [[math.log(one), math.log(4.0)]])


def test_a_plate_that_does_not_turn_is_proved_to_stay_on_its_branch():
    """Its Euler parameters stand still: tubes as thin as their rates held no others, and the branch was called lost."""
    scene = refkin.load(CORPUS / "space-delta-robot.toml")

    assert refkin.solve(scene).verdict == "ok"


@pytest.mark.parametrize(
    ("longest", "proved", "most_tried"),
    [
        (lambda t: 2.0**-7, True, 255),
        (lambda t: 2.0**-11, False, 110),
        (lambda t: 2.0**-20 + t / 4, True, 400),
        (lambda t: 0.0, False, 41),
    ],
    ids=["as many as there are", "many more", "short ones at first", "none holds"],
)
def test_a_proof_that_would_take_many_times_its_tubes_ends_early(longest, proved, most_tried, monkeypatch):
    """It went on to the last of them: of large mechanisms of space, of which each takes a second, for minutes."""
    monkeypatch.setattr(tube, "krawczyk", lambda system, q, t, bits: SimpleNamespace(t=t, nearest=lambda: None))
    monkeypatch.setattr(tube.ConnectionProof, "_tube_holds", lambda self, a, b: b.t - a.t <= longest(a.t))
    proof = tube.ConnectionProof(None, 400, lambda *_: 0.0)

    assert proof.connects(0.0, 1.0, None, None) is proved
    assert proof.tried <= most_tried
