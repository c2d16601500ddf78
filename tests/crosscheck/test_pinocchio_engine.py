"""What of Pinocchio is no other engine's: turns of a residual angle, its example, and where a branch ends."""

from __future__ import annotations

import math
from dataclasses import replace
from typing import Any

import numpy as np
import pinocchio
import pytest

import refkin
from crosscheck.engines import EngineRefusal
from crosscheck.engines.pinocchio import engine as pinocchio_engine
from crosscheck.engines.pinocchio.engine import Pinocchio
from crosscheck.engines.pinocchio.rows import Rows
from crosscheck.engines.pinocchio.shipped import CLOSED_CHAIN
from crosscheck.engines.tree.tree_system import link_terms
from crosscheck.judge.comparison import compare, reference
from crosscheck.measure.check import check
from crosscheck.scenes.drawing import draw
from refkin.joints import AngleDriver, Distance, Prismatic, Revolute, XDriver, YDriver
from refkin.model import Body, Effect, Mechanism, Scene
from refkin.motion import Status
from refkin.motion_laws import Polynomial
from tests.linkages import ROCKER, with_law
from tests.mutation.change import mutated
from tests.places import CORPUS

from .exact_linkages import four_bar, slider_crank

EPS = float(np.finfo(float).eps)


def slide(angle: float) -> Any:
    """Return Pinocchio's rows of a slide between two bodies that lie on the ground."""
    ends = {"point_i": (0.0, 0.0), "axis_i": (1.0, 0.0), "point_j": (0.0, 0.0)}
    joints = [Prismatic(name=j, body_i=i, body_j=j, **ends) for i, j in (("ground", "a"), ("ground", "b"))]
    between = Prismatic(name="between", body_i="a", body_j="b", **ends, angle=angle)
    mechanism = Mechanism((Body(name="a"), Body(name="b")), (between, *joints))
    return Pinocchio().constraints(Scene(mechanism=mechanism, times=(0.0,)))


def test_a_residual_angle_keeps_its_turns() -> None:
    q = np.array([0.0, 0.0, 1.0, 0.0, 0.0, 101.5])

    assert slide(0.5).residual(q, 0.0)[1] == pytest.approx(100.0, abs=100 * EPS)


@pytest.mark.parametrize("beyond", [1e-3, 1e-8, 1e-15])
def test_a_residual_angle_is_exact_near_a_half_turn(beyond: float) -> None:
    """Where Pinocchio's own log6 is right to 1e-11 only."""
    for angle in (math.pi - beyond, math.pi + beyond):
        assert slide(0.0).residual(np.array([0.0] * 5 + [angle]), 0.0)[1] == pytest.approx(angle, abs=2 * EPS)


def driven_slide(driver: type[XDriver] | type[YDriver], angle: float) -> Scene:
    """Return a slider-crank that a coordinate of a point of the slider drives; its guide comes first: the origin."""
    case = slider_crank(0.3, angle)
    x, y, phi = case.rows["slider"][0][:, 0]
    at = complex(x, y) + np.exp(1j * phi) * (0.2 + 0.1j)
    law = Polynomial(coefficients=(0.01 + (at.real if driver is XDriver else at.imag), -0.1))
    motor = driver(name="motor", body="slider", point=(0.2, 0.1), law=law)
    mechanism = replace(case.scene.mechanism, joints=case.scene.mechanism.joints[::-1], drivers=(motor,))
    return replace(case.scene, mechanism=mechanism)


INPUTS = {
    "a crank": four_bar().scene,
    "x of a slide": driven_slide(XDriver, 0.5 * math.pi),
    "y of a slide": driven_slide(YDriver, 0.0),
}


@pytest.mark.parametrize("name", INPUTS)
def test_the_shipped_example_holds_the_input_where_the_law_has_it(name: str) -> None:
    scene = replace(INPUTS[name], times=INPUTS[name].times[:3])
    motion = Pinocchio().solve(scene, CLOSED_CHAIN)
    compared = compare(reference(scene), motion, Pinocchio().terms(scene, CLOSED_CHAIN))

    assert set(motion.status) == {Status.OK}
    assert not compared.other_assembly
    assert np.max(compared.quantities["position"].ratio) < 1.0


def test_the_shipped_example_holds_no_body_that_hangs_on_another() -> None:
    scene = four_bar().scene
    driver = replace(scene.mechanism.drivers[0], body="coupler")
    with pytest.raises(EngineRefusal, match=r"angle by a law of 'motor'.* by which a body hangs on the ground"):
        Pinocchio().solve(replace(scene, mechanism=replace(scene.mechanism, drivers=(driver,))), CLOSED_CHAIN)


def test_only_what_is_called_for_is_computed(monkeypatch: pytest.MonkeyPatch) -> None:
    """Without the acceleration of any point or joint being asked of Pinocchio."""
    monkeypatch.setattr(pinocchio, "getFrameClassicalAcceleration", None)
    monkeypatch.setattr(Rows, "drift", None)
    motion = Pinocchio().solve(four_bar(effects=frozenset({Effect.VELOCITY})).scene)

    assert (motion.verdict, motion.qdd) == (Status.OK, None)


def test_a_pose_just_before_the_end_of_a_branch_is_found_where_the_end_was_guessed_wrong() -> None:
    """A cubic towards a wrong end fails at the same time from however near, where the tangent goes on."""
    scene = draw(777001, 149).scene
    engine = Pinocchio()

    assert set(engine.solve(scene, engine.routes()[0]).status) == {Status.OK}


NEAR_LIMIT = CORPUS / "massless-link-near-limit.toml"
"""A slider-crank whose crank is a distance, 1e-3 rad before the rod's limit: there the link turns 64 times as fast."""


def disagreements(before=1e-3):
    scene = refkin.load(NEAR_LIMIT)
    law = refkin.Polynomial(coefficients=(0.0, math.asin(10.0 / 80.0) - before))
    record = check(with_law(scene, law), engines=["pinocchio"])
    return {(d.quantity, d.kind) for d in record.disagreements}


@pytest.mark.parametrize("before", [1e-3, 2e-4])
def test_a_link_that_turns_fast_may_round_its_rates(before):
    assert disagreements(before) == set()


def test_without_its_terms_it_would_be_blamed(monkeypatch):
    monkeypatch.setattr(pinocchio_engine, "link_terms", lambda mechanism: ())

    assert ("acceleration", "beyond the allowed error") in disagreements(2e-4)


def test_an_error_of_1e_9_of_a_rate_is_found_all_the_same():
    drift, given = "crosscheck.engines.pinocchio.engine:PinocchioTree.closure_drift", "self.rows.drift(q, qd,"
    with mutated(drift, given, "self.rows.drift(q, (1.0 + 5e-10) * qd,"):
        assert ("acceleration", "beyond the allowed error") in disagreements()


def test_the_terms_are_what_a_link_may_turn_at_as_often_as_it_is_rounded():
    """w = (v_i + v_j) / L with v = sqrt(2) of a point on a body; w' = (a_i + a_j) / L + w^2; all in sizes."""
    mechanism = refkin.load(NEAR_LIMIT).mechanism
    (link,) = (joint for joint in mechanism.joints if joint.type == "distance")
    length, bodies = link.length / mechanism.size(), len(mechanism.bodies)
    moving = [body for body in (link.body_i, link.body_j) if body != "ground"]
    turning = len(moving) * math.sqrt(2.0) / length
    roundings = 6.0 * (bodies + 1) * (length + 1.5 * bodies) * 2.0**-53

    assert moving
    assert {term.level: term.of_rates for term in link_terms(mechanism)} == pytest.approx(
        {"velocity": roundings * turning, "acceleration": roundings * (turning + turning**2)}, rel=1e-9, abs=0.0
    )


def linked(count, away=0.0):
    """Return so many four-bars on end, each with a massless link for a coupler, and frames some way behind."""
    bodies, joints = [], []
    for k in range(count + 1):
        frame = -away * math.cos(1.2), -away * math.sin(1.2)
        bodies.append(Body(name=f"r{k}", estimate=(0.1 * k + frame[0], frame[1], 1.2)))
        ends = {"point_i": (0.1 * k, 0.0), "body_j": f"r{k}", "point_j": (away, 0.0)}
        joints.append(Revolute(name=f"R{k}", body_i="ground", **ends))
    for k in range(count):
        ends = {"body_i": f"r{k}", "body_j": f"r{k + 1}", "point_i": (0.5 + away, 0.0), "point_j": (0.49 + away, 0.0)}
        joints.append(Distance(name=f"L{k}", length=0.1, **ends))
    motor = AngleDriver(name="motor", body="r0", law=Polynomial(coefficients=(1.2, 0.5)))
    return Scene(mechanism=Mechanism(bodies, joints, (motor,)), times=(0.0, 0.02, 0.04))


@pytest.mark.parametrize(("count", "away"), [(5, 0.0), (10, 0.0), (20, 0.0), (2, 300.0)])
def test_what_links_cost_is_granted_in_a_long_chain_and_where_frames_are_far_from_joints(count, away):
    """Five were an undocumented error term, and so were frames 300 m off: their own rates are those of no joint."""
    record = check(linked(count, away), ["pinocchio"])

    assert record.reference.verdict == "ok"
    assert not record.disagreements


def test_frames_far_from_joints_allow_accelerations_no_more_than_their_own_rounding():
    """Links took the rates of frames for those of joints: with frames 300 m off 10 rad/s^2 were allowed."""
    allowed = [
        np.max(reference(scene).budget(link_terms(scene.mechanism)).levels[2, 2::3])
        for scene in (linked(2), linked(2, 300.0))
    ]

    assert allowed[1] < 1e4 * allowed[0]


def test_a_mechanism_without_distance_joints_has_no_such_terms():
    assert link_terms(ROCKER.scene().mechanism) == ()
