"""The plain analysis: alone, right, and honest about what it did not find."""

from __future__ import annotations

import subprocess
import sys
from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest

import refkin
from refkin import FourBar, InvertedSliderCrank, Polynomial, Sinusoid, SliderCrank, Status, analysis
from refkin.system import compile_system
from tests.linkages import LIMITED, ROCKER, remade, system_of, with_law
from tests.places import ROOT

ALONE = """
import sys

class Blocked:
    def find_spec(self, name, path=None, target=None):
        if name.startswith(("refkin.proof", "refkin.solving", "refkin.fast", "refkin.scenes")):
            raise ImportError(f"{name} is blocked")

sys.meta_path.insert(0, Blocked())

import cmath, math
import numpy as np
from refkin import AngleDriver, Body, Mechanism, Polynomial, Revolute, Scene
from refkin.analysis import sweep

def pin(name, i, u, j, v):
    return Revolute(name=name, body_i=i, point_i=u, body_j=j, point_j=v)

joints = (
    pin("A0", "ground", (0.0, 0.0), "crank", (-0.5, 0.0)),
    pin("A", "crank", (0.5, 0.0), "coupler", (-1.75, 0.0)),
    pin("B", "coupler", (1.75, 0.0), "rocker", (1.5, 0.0)),
    pin("B0", "ground", (4.0, 0.0), "rocker", (-1.5, 0.0)),
)
bodies = (
    Body(name="crank", estimate=(0.5, 0.0, 0.0)),
    Body(name="coupler", estimate=(2.0, 1.4, 1.0)),
    Body(name="rocker", estimate=(3.5, 1.4, 1.9)),
)
motor = AngleDriver(name="motor", body="crank", law=Polynomial(coefficients=(0.0, 2.0)))
scene = Scene(mechanism=Mechanism(bodies, joints, (motor,)), times=tuple(np.linspace(0.0, math.pi, 73)))
motion = sweep(scene)
assert set(map(str, motion.status)) == {"ok"}, motion.status
for k, t in enumerate(scene.times):
    pin_at = cmath.rect(1.0, 2 * t)
    line = 4.0 - pin_at
    corner = math.acos((3.5**2 + abs(line) ** 2 - 9.0) / (2 * 3.5 * abs(line)))
    met = pin_at + cmath.rect(3.5, cmath.phase(line) + corner)
    x, y, phi = motion["rocker"].q[:, k]
    assert abs(complex(x, y) - (4.0 + met) / 2) < 1e-14
    assert abs(cmath.rect(3.0, phi) - (met - 4.0)) < 1e-14
print(sorted(name for name in sys.modules if name.startswith("refkin.")))
"""


def test_rates_beyond_numbers_are_not_ok():
    """The crank comes beyond 1e140 rad/s between the second time and the third."""
    law = Polynomial(coefficients=(0.0, 0.0, 2e279))
    scene = with_law(replace(ROCKER.scene(), times=(0.0, 1e-140, 3e-140, 3.1e-140)), law)
    motion = analysis.sweep(scene)

    assert motion.status == (Status.OK, Status.OK, Status.NOT_CONVERGED, Status.BRANCH_LOST)
    assert all(np.array_equal(np.isfinite(level[0]), [True, True, False, False]) for level in motion.levels)


def test_it_solves_a_four_bar_with_all_that_stands_above_it_blocked():
    """Every pose against the two circles; what was imported is the reference and nothing else."""
    run = subprocess.run([sys.executable, "-c", ALONE], cwd=ROOT, capture_output=True, text=True, check=False)

    assert run.returncode == 0, run.stderr
    assert "refkin.analysis" in run.stdout


@pytest.mark.parametrize("above", ["proof", "solving", "fast", "scenes"])
def test_the_block_is_one(above):
    """What stands above cannot be imported there: a block that lets it pass would show nothing."""
    blocked = ALONE.split("import cmath")[0] + f"import refkin.{above}"
    run = subprocess.run([sys.executable, "-c", blocked], cwd=ROOT, capture_output=True, text=True, check=False)

    assert f"refkin.{above} is blocked" in run.stderr


@pytest.mark.parametrize("branch", ["open", "crossed"])
@pytest.mark.parametrize(
    "linkage",
    [ROCKER, SliderCrank(crank=1.0, rod=3.0, offset=0.4), InvertedSliderCrank(ground=2.0, crank=0.75)],
    ids=["four-bar", "slider-crank", "inverted"],
)
def test_it_agrees_with_what_is_proved(linkage, branch):
    scene = linkage.scene(speed=2.0, samples=73, branch=branch)
    plain, proved = analysis.sweep(scene), refkin.solve(scene)

    assert plain.status == proved.status
    for a, b in zip(plain.levels, proved.levels, strict=True):
        assert np.max(np.abs(a - b)) < 1e-12
    assert plain.sigma_min == pytest.approx(proved.sigma_min, rel=1e-10)
    assert plain.condition == pytest.approx(proved.condition, rel=1e-10)
    system = system_of(scene)
    left = [np.abs(system.phi(q, t)).max() for q, t in zip(system.to_unit(plain.q).T, plain.t, strict=True)]
    assert plain.residual.tolist() == left


def test_a_dead_centre_is_singular_and_nothing_is_said_after_it():
    limit = LIMITED.input_range()[0][1]
    scene = LIMITED.scene(law=Sinusoid(amplitude=0.5, angular_frequency=1.0), times=(0.0, 0.7, np.pi / 2, 2.0))
    motion = analysis.sweep(with_law(scene, Sinusoid(amplitude=limit, angular_frequency=1.0)))

    assert motion.status == (Status.OK, Status.OK, Status.SINGULAR, Status.BRANCH_LOST)
    assert np.isfinite(motion.q[:, 2]).all()
    assert np.isnan(motion.qd[:, 2:]).all()
    assert np.isnan(motion.q[:, 3]).all()


@pytest.mark.parametrize(("solver", "proved"), [(analysis.sweep, set()), (refkin.solve, {Status.UNASSEMBLABLE})])
def test_beyond_a_limit_the_branch_is_lost(solver, proved):
    """The law leaves the range of the crank and comes back: nothing jumps."""
    limit = LIMITED.input_range()[0][1]
    scene = LIMITED.scene(law=Sinusoid(amplitude=0.5, angular_frequency=1.0), times=tuple(np.linspace(0.0, 3.0, 31)))
    law = Sinusoid(amplitude=limit + 0.05, angular_frequency=1.0)
    motion = solver(with_law(scene, law))
    beyond = np.flatnonzero(np.abs(law(motion.t)) > limit)[0]

    assert set(motion.status[:beyond]) == {Status.OK}
    assert set(motion.status[beyond:]) == {Status.BRANCH_LOST} | proved
    assert np.isnan(motion.q[:, beyond:]).all()


def test_a_linkage_that_does_not_close_has_no_pose():
    scene = ROCKER.scene(samples=3)
    coupler = replace(scene.mechanism.joints[1], point_j=(-30.0, 0.0))
    joints = (scene.mechanism.joints[0], coupler, *scene.mechanism.joints[2:])
    motion = analysis.sweep(remade(scene, joints=joints))

    assert set(motion.status) == {Status.NOT_CONVERGED}
    assert np.isnan(motion.q).all()
    assert "no pose was found" in motion.message


def test_rows_that_contradict_each_other_are_no_pose_and_end_the_branch():
    """A second pin at B, a thousandth off: least squares converge to what satisfies neither."""
    scene = ROCKER.scene(samples=4)
    m = scene.mechanism
    twin = replace(m.joints[2], name="B2", point_i=(m.joints[2].point_i[0] + 1e-3, 0.0))
    motion = analysis.sweep(remade(scene, joints=(*m.joints, twin)))

    assert motion.status == (Status.NOT_CONVERGED, *[Status.BRANCH_LOST] * 3)
    assert np.isnan(motion.q).all()


def test_a_coarse_march_stays_on_its_branch():
    """Four samples a turn: without the sign of the determinant and the distance from the prediction it would not."""
    scene = ROCKER.scene(turns=2, samples=9)
    system = system_of(scene)
    fine = refkin.solve(ROCKER.scene(turns=2, samples=721))
    first = analysis.position(system, analysis.estimate_of(system, scene), 0.0).q
    poses = system.to_physical(analysis.march(system, first, scene.times))

    assert np.max(np.abs(poses - fine.q[:, ::90])) < 1e-13


def test_where_branches_cross_between_two_times_no_branch_is_chosen():
    """A parallelogram that is flat between two times: Newton's method with the sign of det alone takes the kink."""
    scene = FourBar(ground=2.0, crank=1.0, coupler=2.0, rocker=1.0).scene(turns=1, samples=13, start=0.5)
    motion = analysis.sweep(scene)

    assert motion.status == (Status.OK,) * 6 + (Status.BRANCH_LOST,) * 7
    assert motion["rocker"].phi[:6] == pytest.approx(motion["crank"].phi[:6])


def test_what_is_not_called_for_is_neither_computed_nor_reported(monkeypatch):
    monkeypatch.delattr(analysis, "acceleration")
    motion = analysis.sweep(replace(ROCKER.scene(samples=3), effects=frozenset(), bodies_wanted=("rocker",)))

    assert motion.qd is None
    assert motion.bodies == ("rocker",)


@pytest.mark.parametrize(("converged", "away", "taken"), [(True, 0.1, True), (True, 1.0, False), (False, 0.1, False)])
def test_a_branch_ends_in_a_singular_pose_only_if_newton_came_to_one_nearby(monkeypatch, converged, away, taken):
    """Where no step stays on the branch, down to the last that leads to a later time in float64."""
    m = ROCKER.scene().mechanism
    system, q = compile_system(m, unit=m.unit()), np.zeros(9)
    reached = q + away * (np.arange(9) == 4)
    result, tried = SimpleNamespace(converged=converged, q=reached), []
    monkeypatch.setattr(analysis, "position", lambda _system, _q, to, **_: tried.append(to) or result)
    monkeypatch.setattr(analysis, "velocity", lambda *_: np.zeros(9))
    monkeypatch.setattr(analysis, "_stays", lambda *_: False)
    monkeypatch.setattr(analysis, "sigma_min", lambda *_: 0.0)
    pose, goes_on = analysis._next(system, q, 100.0, 101.0)

    assert not goes_on
    assert 100.0 < min(tried) < 100.0 + 1e-13
    assert np.array_equal(np.broadcast_to(pose, 9), reached) is taken


def step_of_a_rocker():
    """A system, where it is at a time, that time and the next, the solution there."""
    scene = ROCKER.scene(samples=721)
    system, (t, to) = system_of(scene), scene.times[:2]
    q = analysis.position(system, analysis.estimate_of(system, scene), t).q
    return system, q, t, to, analysis.position(system, q + (to - t) * analysis.velocity(system, q, t), to)


@pytest.mark.parametrize(("kink", "stays"), [(0.4, True), (0.6, False), (1.5, False)])
def test_a_step_stays_on_its_branch_while_its_path_bends_by_less_than_half_of_the_way(monkeypatch, kink, stays):
    system, q, t, to, result = step_of_a_rocker()
    rate = kink * np.max(np.abs(result.q - q)) / (to - t)
    monkeypatch.setattr(analysis, "velocity", lambda _, there, at: rate * (there is result.q) + np.zeros_like(q))

    assert analysis._stays(system, q, t, result, to) is stays


@pytest.mark.parametrize(("part", "stays"), [(0.24, True), (0.26, False)])
def test_a_step_stays_on_its_branch_while_it_is_led_to_but_for_a_quarter_of_its_move(part, stays):
    system, q, t, to, result = step_of_a_rocker()
    corrections = np.array([[part * np.max(np.abs(result.q - q))], [0.0]])

    assert analysis._stays(system, q, t, replace(result, corrections=corrections), to) is stays


def test_a_wheel_that_turns_too_often_between_two_times_is_given_up(monkeypatch):
    """It went on for hours."""
    monkeypatch.setattr(analysis, "MOST_STEPS", 50)
    laws = [Polynomial(coefficients=(0.3, w)) for w in (10.0, 1e15)]
    motions = [analysis.sweep(ROCKER.scene(law=law, times=(0.0, 1.0))) for law in laws]

    assert [motion.status[-1] for motion in motions] == [Status.OK, Status.BRANCH_LOST]
