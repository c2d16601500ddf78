"""What a massless link in the place of a distance joint costs is allowed for, and nothing more."""

from __future__ import annotations

import math
from pathlib import Path

import pytest

import refkin
from crosscheck.engines.pinocchio import engine as pinocchio_engine
from crosscheck.engines.pinocchio.engine import PinocchioTree
from crosscheck.engines.tree.tree_system import link_terms
from crosscheck.measure.check import check
from tests.linkages import with_law

NEAR_LIMIT = Path(__file__).parents[1] / "corpus" / "massless-link-near-limit.toml"
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


def test_an_error_of_1e_9_of_a_rate_is_found_all_the_same(monkeypatch):
    drift = PinocchioTree.closure_drift
    off = 1.0 + 1e-9
    monkeypatch.setattr(
        PinocchioTree, "closure_drift", lambda self, *at: tuple(off * part for part in drift(self, *at))
    )

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
