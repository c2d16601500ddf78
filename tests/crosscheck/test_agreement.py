"""`assert_agrees` says which coordinate is wrong, by how much, when, of what allowed, and which joint it violates."""

from __future__ import annotations

import re
import subprocess
import sys
import tomllib
from dataclasses import replace
from importlib.metadata import version
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from hypothesis.internal.cache import LRUCache
from hypothesis.internal.conjecture import providers
from hypothesis.internal.constants_ast import Constants
from hypothesis.vendor.pretty import pretty

import crosscheck
import refkin
from crosscheck import strategies
from crosscheck.engines.spatial.turning import product
from crosscheck.judge.agreement import NothingToCompare
from crosscheck.judge.comparison import compare, reference
from crosscheck.judge.violations import NOT_KNOWN, violations
from crosscheck.scenes.drawing import draw
from refkin.errors import RefkinError
from refkin.model import Mechanism
from refkin.scenes.linkages import RSSP, Branch
from tests.linkages import ROCKER
from tests.places import CORPUS, ROOT

EXAMPLE = ROOT / "examples" / "test_own_solver.py"
LAW = refkin.Sinusoid(offset=1.0, amplitude=0.8, angular_frequency=1.3, phase=0.4)
TIMES = tuple(float(t) for t in np.linspace(0.0, 2.0, 9))
FOUR_BAR, CROSSED = (ROCKER.scene(law=LAW, times=TIMES, branch=branch) for branch in ("open", "crossed"))
SLIDER = refkin.SliderCrank(crank=1.0, rod=3.0, offset=0.4).scene(law=LAW, times=TIMES)


def wrong(scene: Any, level: str = "q", row: int = 8, k: int = 3, by: float = 1e-9) -> Any:
    motion = refkin.solve(scene)
    rows = getattr(motion, level).copy()
    rows[row, k] += by
    return replace(motion, **{level: rows})


def test_the_reference_agrees_with_itself_and_so_does_a_part_of_it():
    motion = refkin.solve(FOUR_BAR)

    crosscheck.assert_agrees(motion, FOUR_BAR)
    crosscheck.assert_agrees({"rocker": {"phi": motion["rocker"].phi + 4 * np.pi}}, FOUR_BAR)
    crosscheck.assert_agrees({"crank": {"xdd": motion["crank"].xdd}, "coupler": {"y": motion["coupler"].y}}, FOUR_BAR)


@pytest.mark.parametrize("turns", [0, 5, 1600])
def test_poses_that_are_composed_of_joint_angles_are_rounded_as_these_however_far_a_crank_is_turned(turns):
    """The rod's angle against the crank's is rounded as the crank's own: the slider was blamed to be off its guide."""
    law = replace(LAW, offset=LAW.offset + 2 * np.pi * turns)
    scene = refkin.SliderCrank(crank=1.0, rod=3.0, offset=0.4).scene(law=law, times=TIMES)
    motion, at = refkin.solve(scene), {joint.name: joint for joint in scene.mechanism.joints}
    x, y, phi = motion["crank"].q
    place, answer = x + 1j * y, {}
    for pin, last, body in (("A", "crank", "connecting_rod"), ("B", "connecting_rod", "slider")):
        first, second = (complex(*dict(at[pin].points())[name]) for name in (last, body))
        turned = phi + (motion[body].phi - motion[last].phi)
        place, phi = place + first * np.exp(1j * phi) - second * np.exp(1j * turned), turned
        answer[body] = {"x": place.real, "y": place.imag, "phi": phi}

    crosscheck.assert_agrees(answer, scene)
    answer["slider"]["y"] = answer["slider"]["y"] + 1e-13 * (1 + turns)
    with pytest.raises(AssertionError):
        crosscheck.assert_agrees(answer, scene)


@pytest.mark.parametrize("half", [np.pi, 0.4], ids=["the other sign", "another spin"])
@pytest.mark.parametrize("order", [0, 1, 2])
def test_a_part_of_an_answer_in_space_may_have_either_sign_of_p_and_any_passive_spin(order, half):
    """What it leaves out is as it is beside such a pose; an error is seen there, too."""
    scene = refkin.load(ROOT / "examples" / "rssr.toml")
    motion = refkin.solve(scene)
    coupler = motion["coupler"]
    given, spin = {}, np.array([[np.cos(half), np.sin(half), 0.0, 0.0]])  # about the line of its two balls
    for k, level in enumerate((coupler.q, coupler.qd, coupler.qdd)[: order + 1]):
        turned = np.vstack([level[:3], product(level[3:].T, spin).T])
        given |= {f"{name}{'d' * k}": row for name, row in zip(motion.kind.coordinates, turned, strict=True)}

    crosscheck.assert_agrees({"coupler": given}, scene)
    given[f"y{'d' * order}"][3] += 1e-9
    with pytest.raises(AssertionError, match=f"coupler.y{'d' * order} is off by 1e-09"):
        crosscheck.assert_agrees({"coupler": given}, scene)


@pytest.mark.parametrize(
    ("level", "row", "place", "unit"),
    [("q", 8, "rocker.phi", "rad"), ("qd", 3, "coupler.xd", "m/s"), ("qdd", 5, "coupler.phidd", "rad/s^2")],
)
def test_what_is_off_is_said_with_place_size_time_and_allowance(level, row, place, unit):
    with pytest.raises(AssertionError) as result:
        crosscheck.assert_agrees(wrong(FOUR_BAR, level, row), FOUR_BAR)
    number, unit = r"([\d.e+-]+)", re.escape(unit)
    match = re.search(
        rf"{place} is off by {number} {unit} at t = {number} s, {number} times the allowed {number} {unit}; it",
        str(result.value),
    )

    assert match, result.value
    off, time, times, allowed = map(float, match.groups())
    assert off == pytest.approx(1e-9, rel=1e-3, abs=0.0)
    assert time == TIMES[3]
    assert times == pytest.approx(off / allowed, rel=0.02, abs=0.0)
    assert 1e3 < times < 1e8


@pytest.mark.parametrize("level", ["q", "qd", "qdd"])
def test_an_error_of_some_roundings_is_not_called_another_pose(level):
    said = violations(reference(FOUR_BAR), wrong(FOUR_BAR, level, by=2e-13), ("q", "qd", "qdd").index(level), TIMES[3])

    assert "joint 'B0'" in said.text or "joint 'B'" in said.text
    assert "to rounding" not in said.text


@pytest.mark.parametrize("order", [0, 1, 2])
def test_what_rounding_leaves_of_rows_is_that_of_the_time_that_is_asked_for(order):
    right = reference(FOUR_BAR).propagation
    errors = [e.copy() for e in right.e]
    errors[order][:, 3] += 1.0
    more = [np.max(replace(right, e=tuple(errors)).left(order, t) - right.left(order, t)) for t in TIMES]

    assert more == pytest.approx([0.0, 0.0, 0.0, 1.0, *[0.0] * 5])


def test_no_answer_a_wrong_ok_and_the_other_assembly_are_said():
    rocker = refkin.solve(FOUR_BAR)["rocker"].phi.copy()
    rocker[5:] = np.nan
    apart = replace(FOUR_BAR, mechanism=longer(FOUR_BAR.mechanism, "B0", point_i=(40.0, 0.0)))

    with pytest.raises(AssertionError, match=r"no answer at 4 of 9 times, the first t = 1\.25 s"):
        crosscheck.assert_agrees({"rocker": {"phi": rocker}}, FOUR_BAR)
    with pytest.raises(AssertionError, match="it is the other assembly"):
        crosscheck.assert_agrees(refkin.solve(CROSSED), FOUR_BAR)
    with pytest.raises(AssertionError, match="ok where there is no assembly: 9 times, first t = 0"):
        crosscheck.assert_agrees(refkin.solve(FOUR_BAR), apart)
    crosscheck.assert_agrees(refkin.solve(apart), apart)


def test_the_other_assembly_at_one_time_is_said_whatever_is_off_at_another():
    right, crossed = (refkin.solve(replace(scene, times=TIMES[:3])) for scene in (FOUR_BAR, CROSSED))
    q = right.q.copy()
    q[:, 1] = crossed.q[:, 1]
    q[0, 2] += 1e-3
    ref = reference(replace(FOUR_BAR, times=TIMES[:3]))

    assert compare(ref, replace(right, q=q)).other_assembly
    q[:, 1] = right.q[:, 1]
    assert not compare(ref, replace(right, q=q)).other_assembly


SINGULAR, LOST = (refkin.load(CORPUS / f"{name}.toml") for name in ("singular-in-the-end", "crank-over-a-gap"))


def called_ok(scene: Any, **levels: float) -> Any:
    """Return the reference's answer, all of it ok, with these numbers where it is not."""
    motion = refkin.solve(scene)
    ok = np.array([str(status) == "ok" for status in motion.status])
    return replace(
        motion,
        status=(refkin.Status.OK,) * len(ok),
        **{name: np.where(ok, getattr(motion, name), x) for name, x in levels.items()},
    )


@pytest.mark.parametrize(
    ("scene", "motion", "said"),
    [
        (SINGULAR, called_ok(SINGULAR, q=0.3), "position: ok where joints are open: 1 times, first t = 1"),
        (LOST, called_ok(LOST), "position: status ok without a number"),
        (FOUR_BAR, replace(refkin.solve(FOUR_BAR), qd=None, qdd=None), "velocity: not delivered: not delivered at any"),
        (FOUR_BAR, refkin.solve(replace(FOUR_BAR, bodies_wanted=("crank",))), "no answer for coupler, rocker"),
    ],
)
def test_a_whole_answer_owes_what_an_engine_owes(scene, motion, said):
    with pytest.raises(AssertionError, match=said):
        crosscheck.assert_agrees(motion, scene)


@pytest.mark.parametrize("residual", [-1.0, float("nan"), float("inf"), None, "0", 1j, np.zeros(2)])
def test_a_residual_is_a_number_that_is_not_negative(residual):
    with pytest.raises(ValueError, match="residual: expected a number that is not negative, got"):
        crosscheck.assert_agrees(refkin.solve(FOUR_BAR), FOUR_BAR, residual=residual)


def test_what_cannot_be_compared_is_no_agreement():
    with pytest.raises(NothingToCompare, match="the answer has no number"):
        crosscheck.assert_agrees({"rocker": {}}, FOUR_BAR)
    with pytest.raises(RefkinError, match="its times are not those of the scene"):
        crosscheck.assert_agrees(refkin.solve(FOUR_BAR), replace(FOUR_BAR, times=TIMES[:1]))
    with pytest.raises(RefkinError, match="no body is called 'lever'"):
        crosscheck.assert_agrees({"lever": {"phi": np.zeros(9)}}, FOUR_BAR)
    with pytest.raises(RefkinError, match="no coordinate is called 'angle'; there are: x, y, phi, xd"):
        crosscheck.assert_agrees({"rocker": {"angle": np.zeros(9)}}, FOUR_BAR)
    with pytest.raises(RefkinError, match="no coordinate is called 'phiddd'"):
        crosscheck.assert_agrees({"rocker": {"phiddd": np.zeros(9)}}, FOUR_BAR)
    with pytest.raises(RefkinError, match="expected 9 values, one per time"):
        crosscheck.assert_agrees({"rocker": {"phi": np.zeros(8)}}, FOUR_BAR)
    for no_numbers in (["a"] * 9, [[0.0], 1.0], None, {}, np.array(refkin.solve(FOUR_BAR)["rocker"].phi) + 1j):
        with pytest.raises(RefkinError, match=r"rocker\.phi: expected 9 values, one per time, got "):
            crosscheck.assert_agrees({"rocker": {"phi": no_numbers}}, FOUR_BAR)


def test_a_stopping_rule_is_granted_as_far_as_it_goes():
    answer = wrong(FOUR_BAR, by=1e-9)

    crosscheck.assert_agrees(answer, FOUR_BAR, residual=1e-8)
    with pytest.raises(AssertionError):
        crosscheck.assert_agrees(answer, FOUR_BAR, residual=1e-12)


def longer(mechanism: Mechanism, name: str, **keys: Any) -> Mechanism:
    """Return the mechanism with one joint or driver changed."""
    joints = tuple(replace(j, **keys) if j.name == name else j for j in mechanism.joints)
    drivers = tuple(replace(d, **keys) if d.name == name else d for d in mechanism.drivers)
    return replace(mechanism, joints=joints, drivers=drivers)


@pytest.mark.parametrize(
    ("scene", "name", "keys"),
    [
        (FOUR_BAR, "joint 'B' (revolute)", {"point_j": (1.500001, 0.0)}),
        (FOUR_BAR, "driver 'driver' (angle)", {"law": replace(LAW, amplitude=0.800001)}),
        (SLIDER, "joint 'guide' (prismatic)", {"point_i": (0.0, 0.400001)}),
    ],
    ids=["revolute", "driver", "prismatic"],
)
def test_an_answer_to_another_joint_violates_that_joint_alone(scene, name, keys):
    """The answer solves the same mechanism with that one joint changed."""
    kind, joint = name.split("'")[0].strip(), name.split("'")[1]
    group = scene.mechanism.joints if kind == "joint" else scene.mechanism.drivers
    assert joint in [c.name for c in group], [c.name for c in group]
    motion = refkin.solve(replace(scene, mechanism=longer(scene.mechanism, joint, **keys)))
    said = violations(reference(scene), motion, 0, TIMES[4])

    assert said.names == (joint,)
    assert said.text.startswith(f"it violates the {name}: scaled residual ")


def test_turns_that_an_answer_does_not_count_violate_nothing():
    """A driver and gears count turns; an answer need not."""
    ref, motion = reference(FOUR_BAR), wrong(FOUR_BAR, by=1e-3)
    turned = replace(motion, q=motion.q + np.tile([[0.0], [0.0], [2 * np.pi]], (3, 1)))
    named = [set(violations(ref, answer, 0, TIMES[3]).names) for answer in (motion, turned)]

    assert named == [{"B", "B0"}] * 2
    assert violations(ref, refkin.solve(FOUR_BAR), 0, TIMES[3]).names == ()


def test_a_wrong_level_violates_that_level_alone():
    ref, motion = reference(FOUR_BAR), refkin.solve(FOUR_BAR)
    stale = replace(motion, qdd=motion.qdd * 0.5)

    assert violations(ref, stale, 2, TIMES[4]).text.startswith("it violates the acceleration of ")
    assert violations(ref, stale, 1, TIMES[4]).text.startswith("every joint and driver is satisfied there to rounding")
    assert [violations(ref, motion, order, TIMES[4]).names for order in range(3)] == [(), (), ()]
    assert violations(ref, replace(motion, bodies=("crank",), q=motion.q[:3]), 0, TIMES[4]) == NOT_KNOWN
    alone = replace(motion, qd=None, qdd=None)
    assert violations(ref, alone, 0, TIMES[4]) == violations(ref, motion, 0, TIMES[4]) != NOT_KNOWN
    assert violations(ref, alone, 1, TIMES[4]) == NOT_KNOWN


def run_example(source: str, folder: Path) -> str:
    file = folder / "test_it.py"
    file.write_text(source, encoding="utf-8")
    options = ["-q", "-x", "-n", "0", "-p", "no:cacheprovider", "-c", str(ROOT / "pyproject.toml")]
    command = [sys.executable, "-m", "pytest", *options, f"--rootdir={folder}", str(file)]
    return subprocess.run(command, capture_output=True, text=True, check=False, cwd=folder, timeout=280).stdout


def test_the_example_passes(tmp_path):
    assert "1 passed" in run_example(EXAMPLE.read_text(encoding="utf-8"), tmp_path)


def test_the_example_fails_with_a_linkage_that_can_be_pasted_where_a_fault_is_planted(tmp_path):
    """The fault: sine for cosine in the rocker's rate."""
    right = EXAMPLE.read_text(encoding="utf-8")
    planted = right.replace("np.sin(angle - coupler)", "np.cos(angle - coupler)")
    assert planted != right
    shown = run_example(planted, tmp_path)
    lines = [re.sub(r"^E ? ?", "", line).strip() for line in shown.splitlines()]
    pasted = re.search(r"linkage=(FourBar\([^()]*(?:\([^()]*\)[^()]*)*\))", " ".join(lines))

    assert "1 failed" in shown
    assert "rocker.phid is off by" in shown
    assert pasted, shown
    assert isinstance(eval(pasted[1], {"FourBar": refkin.FourBar}), refkin.FourBar)


@pytest.mark.parametrize("number", [0, 1, 6, 13, 20])
def test_a_scene_that_hypothesis_shows_can_be_pasted(number):
    names = {name: getattr(refkin, name) for name in refkin.__all__}
    scene = draw(20261122, number, 3).scene

    assert eval(pretty(scene), names) == scene


def test_spatial_linkages_and_their_joints_that_hypothesis_shows_can_be_pasted():
    names = {name: getattr(refkin, name) for name in refkin.__all__}
    linkage = RSSP(crank=1.0, rod=3.0, guide=(0.5, 0.0, 0.0), axis=(1.0, 0.5, 0.25))

    assert eval(pretty(linkage), {"RSSP": RSSP}) == linkage
    assert [eval(pretty(joint), names) for joint in linkage.joints()] == [*linkage.joints()]


def test_what_strategies_beyond_linkages_yield_can_be_pasted():
    """With the names that stand in it: those of refkin, of crosscheck.strategies, and Branch."""
    names = {name: getattr(package, name) for package in (refkin, strategies) for name in package.__all__}
    about = {"scene": FOUR_BAR, "branch": Branch.CROSSED, "distance": 0.25}
    chain = strategies.Chain(kind="six-bar", **about)
    spatial = strategies.Spatial(kind="RSSP", hardness=strategies.Region.LIMIT, **about)
    ended = strategies.Ended(scene=FOUR_BAR, kind="RSSP", branch=Branch.OPEN, expected=refkin.Status.SINGULAR)

    for drawn in (chain, spatial, ended):
        assert eval(pretty(drawn), {**names, "Branch": Branch}) == drawn


def test_what_is_patched_of_hypothesis_is_there_in_the_versions_that_are_allowed():
    """`own_choices_only` puts `Constants` in place of `_get_local_constants`, and a cache of its own beside it.

    And has garbage collections not timed: a signal in the middle of that was told, and lost.
    """
    asked = tomllib.loads((ROOT / "pyproject.toml").read_text(encoding="utf-8"))["project"]["dependencies"]
    (hypothesis,) = [line for line in asked if line.startswith("hypothesis")]
    low, high = (tuple(map(int, part.split("."))) for part in re.findall(r"[\d.]+", hypothesis))

    assert low <= tuple(map(int, version("hypothesis").split("."))) < high
    assert isinstance(providers._get_local_constants(), Constants)
    assert isinstance(providers.CONSTANTS_CACHE, LRUCache)
    assert not any(vars(Constants()).values())
    drawn = """
import gc
from crosscheck.night.hunting import OutOfTime, turn_of
from crosscheck.scenes.drawing import climb, draw

def once(drawn):
    raise OutOfTime

draw(1, 0)
for turn in (lambda: climb(1, 0, once, 1, 3), lambda: turn_of(once, (1.0, 3.0), 1)):
    try:
        turn()
    except OutOfTime:
        print(gc.callbacks)
"""
    done = subprocess.run([sys.executable, "-c", drawn], capture_output=True, text=True, check=True, cwd=ROOT)
    assert done.stdout.split() == ["[]", "[]"]


@pytest.mark.parametrize(
    ("motion", "scene", "said"),
    [
        (None, FOUR_BAR, "motion: expected a Motion or Mapping, got a NoneType"),
        (FOUR_BAR, None, "motion: expected a Motion or Mapping, got a Scene"),
        ({}, "four-bar", "scene: expected a Scene, got a str"),
        ({"rocker": np.zeros(3)}, FOUR_BAR, r"motion\['rocker'\]: expected a Mapping, got a ndarray"),
    ],
)
def test_what_is_no_answer_or_no_scene_is_told(motion, scene, said):
    with pytest.raises(TypeError, match=said):
        crosscheck.assert_agrees(motion, scene)
