"""The vector-loop method as a peer: against closed forms, and against refkin within derived budgets."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from hypothesis import event, given, settings
from hypothesis import strategies as st

import refkin
from crosscheck.documents import loops
from crosscheck.engines import EngineError, Level, Support, vector_loop
from crosscheck.engines.vector_loop.engine import Reading, VectorLoop
from crosscheck.judge.comparison import compare, reference
from crosscheck.measure.check import restated
from crosscheck.strategies import Hardness, drawn_scenes
from refkin.joints import GROUND, AngleDriver, Prismatic
from refkin.model import Body, Mechanism, Scene
from refkin.motion import Status
from refkin.motion_laws import Polynomial
from tests.linkages import remade, with_estimates, without_estimates

from .exact_linkages import CASES, four_bar, pin, slider_crank
from .loop_scenes import DRIVES, TOUCHING, general_cam, rapier

REGULAR = 1e-4
"""Smallest singular value above which there is no excuse for giving no answer."""


def found_wrong(scene):
    """What a comparison with the reference, within the derived budget, has against the answer."""
    ref = reference(scene)
    assert ref.motion.verdict is Status.OK
    compared = compare(ref, VectorLoop().solve(scene), VectorLoop().terms(scene))
    missed = compared.missing and np.nanmin(ref.sigma_min) > REGULAR
    return [f"{name} {q.worst}" for name, q in compared.quantities.items() if not q.agrees] + ["missing"] * missed


# ---- agreement


@settings(max_examples=40)
@given(drawn=drawn_scenes(hardness=[Hardness.REGULAR], samples=12))
def test_drawn_scenes_agree_with_the_reference_at_all_times(drawn):
    event(drawn.kind)
    ref = reference(drawn.scene)
    compared = compare(ref, VectorLoop().solve(drawn.scene))

    assert (compared.agrees, compared.missing, compared.compared) == (True, 0, 12)


@settings(max_examples=30)
@given(drawn=drawn_scenes(hardness=[Hardness.LIMIT, Hardness.CHANGE_POINT], samples=12))
def test_scenes_near_singular_poses_agree_as_far_as_they_are_judged(drawn):
    event(f"{drawn.hardness}, {drawn.kind}")

    assert found_wrong(drawn.scene) == []


@settings(max_examples=15)
@given(drawn=drawn_scenes(samples=4))
def test_the_order_of_bodies_and_joints_does_not_matter(drawn):
    assert found_wrong(restated(drawn.scene)) == []


@settings(max_examples=20)
@given(drawn=drawn_scenes(hardness=[Hardness.REGULAR], samples=1), off=st.lists(st.floats(-0.1, 0.1), min_size=15))
def test_a_rough_estimate_leads_to_the_assembly_that_the_reference_takes(drawn, off):
    """Assemblies are about sigma_min apart: a tenth of that is near one alone."""
    mechanism, at = drawn.scene.mechanism, iter(off)
    near = min(1.0, refkin.solve(drawn.scene).sigma_min[0])
    scales = (near * mechanism.size(), near * mechanism.size(), near)

    def rough(body):
        return tuple(x + next(at) * scale for x, scale in zip(body.estimate, scales, strict=True))

    assert found_wrong(with_estimates(drawn.scene, rough)) == []


@pytest.mark.parametrize("branch", ["open", "crossed"])
@pytest.mark.parametrize(
    "linkage",
    [
        refkin.FourBar(4.0, 1.0, 3.5, 3.0, origin=(3.0, -2.0), angle=0.4),
        refkin.SliderCrank(1.0, 3.0, 0.4, angle=-0.7),
        refkin.InvertedSliderCrank(3.0, 1.0, 0.2, origin=(-1.0, 5.0)),
    ],
    ids=lambda linkage: type(linkage).__name__,
)
def test_both_assemblies_over_a_whole_turn(linkage, branch):
    assert found_wrong(linkage.scene(samples=25, branch=branch)) == []


@pytest.mark.parametrize(("reading", "degrees"), [("R1", 360.0), ("R2", 89.0)])
def test_the_rapier_drive_agrees_with_absolute_coordinates_over_its_cycle(reading, degrees):
    assert found_wrong(rapier(reading, np.radians(np.linspace(60.0, 60.0 + degrees, 31)))) == []


@pytest.mark.parametrize("reading", ["R1", "R2"])
def test_the_documents_own_loops_and_those_read_from_the_scene_are_one_motion(reading):
    times = np.radians(np.linspace(60.0, 140.0, 9))
    read_from_scene = VectorLoop().solve(rapier(reading, times))
    start = [*np.radians([200.0, 80.0, 180.0]), 400.0]
    own = vector_loop.march(loops.rapier(DRIVES[reading], Polynomial(coefficients=(0.0, 1.0))), times, start)
    c0_or_a0 = -623.0 if reading == "R1" else 0.0
    rows = [*(read_from_scene[body].phi for body in ("coupler", "lever", "rocker"))]
    rows.append(read_from_scene["rapier"].x + 1100.0 - c0_or_a0)

    assert np.array(rows) == pytest.approx(own.q, rel=1e-12, abs=0.0)


# ---- joints beyond links and slides


@pytest.mark.parametrize("name", TOUCHING)
def test_gears_racks_discs_and_moved_pivots_agree(name):
    assert found_wrong(TOUCHING[name]) == []


# ---- what it has not


def test_it_declares_that_it_has_no_rows():
    engine = VectorLoop()
    rows = {entry[level].support for entry in engine.capabilities().values() for level in Level if level != Level.SOLVE}

    assert rows == {Support.REFUSED}
    with pytest.raises(EngineError, match="its rows are loops of vectors"):
        engine.constraints(four_bar().scene)


def test_a_driven_crank_is_no_unknown_and_a_four_bar_is_one_loop():
    value = Reading(four_bar().scene).system

    assert value.unknowns == ("angle of rocker", "angle of coupler")
    assert len(value.loops) == 1
    assert Reading(CASES["welded arm"]().scene).system.n == 0


def with_joint(scene, joint):
    return remade(scene, joints=(*scene.mechanism.joints, joint))


def floating():
    """A body that only its angle is known of, though the constraints are as many as the coordinates."""
    body = Body(name="free", estimate=(0.0, 0.0, 0.0))
    drivers = tuple(
        AngleDriver(name=f"d{k}", body=b, law=Polynomial(coefficients=(0.0,))) for k, b in enumerate(("crank", "free"))
    )
    twice = tuple(replace(pin("A0", GROUND, 0j, "crank", 0j), name=name) for name in ("A0", "again"))
    return Scene(
        mechanism=Mechanism((Body(name="crank", estimate=(0.0, 0.0, 0.0)), body), twice, drivers), times=(0.0,)
    )


REFUSED = {
    "the angle of coupler has no estimate": (
        lambda: without_estimates(four_bar().scene, "crank", "rocker"),
        "no body has an estimate of the angle of coupler",
    ),
    "a redundant pin": (
        lambda: with_joint(four_bar().scene, pin("again", GROUND, 0j, "crank", -0.5)),
        "2 redundant constraints",
    ),
    "an angle given twice": (
        lambda: with_joint(
            slider_crank().scene,
            Prismatic(
                name="P2", body_i=GROUND, point_i=(0.0, 0.4), axis_i=(1.0, 0.0), body_j="slider", point_j=(0.0, 0.5)
            ),
        ),
        "'P2': redundant, the angle of 'slider' is given",
    ),
    "a cam of general profile": (general_cam, "refuses cam 'c' at solve: no vector .* a contact on a general profile"),
    "a body that hangs on nothing": (floating, "no joint leads from the ground to free"),
}


@pytest.mark.parametrize("name", REFUSED)
def test_what_it_cannot_do_is_refused_by_name(name):
    build, words = REFUSED[name]
    with pytest.raises(EngineError, match=words):
        VectorLoop().solve(build())
