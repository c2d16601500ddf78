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
from refkin.joints import Prismatic, XDriver, YDriver
from refkin.model import Body, Effect, Mechanism, Scene
from refkin.motion import Status
from refkin.motion_laws import Polynomial
from tests.linkages import with_law
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
    """w = (v_i + v_j) / L with v = sqrt(2) + |u|; w' = (a_i + a_j) / L + w^2 with a = sqrt(2) + 2 |u|; all in sizes."""
    mechanism = refkin.load(NEAR_LIMIT).mechanism
    (link,) = (joint for joint in mechanism.joints if joint.type == "distance")
    size, bodies = mechanism.size(), len(mechanism.bodies)
    length = link.length / size
    ends = ((link.body_i, link.point_i), (link.body_j, link.point_j))
    arms = [math.hypot(*point) / size for body, point in ends if body != "ground"]
    turning = sum(math.sqrt(2.0) + arm for arm in arms) / length
    bending = sum(math.sqrt(2.0) + 2.0 * arm for arm in arms) / length + turning**2
    roundings = 6.0 * (bodies + 1) * (length + 1.5 * bodies) * 2.0**-53

    assert max(arms) > 0.0
    assert {term.level: term.of_rates for term in link_terms(mechanism)} == pytest.approx(
        {"velocity": roundings * turning, "acceleration": roundings * bending}, rel=1e-9, abs=0.0
    )


def test_a_mechanism_without_distance_joints_has_no_such_terms():
    assert link_terms(refkin.FourBar(ground=4.0, crank=1.0, coupler=3.5, rocker=3.0).scene().mechanism) == ()
