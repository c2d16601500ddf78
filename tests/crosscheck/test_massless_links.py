"""What a massless link in the place of a distance joint costs is allowed for, and nothing more."""

from __future__ import annotations

import math
from dataclasses import replace
from pathlib import Path

import pytest

import refkin
from crosscheck.engines.pinocchio import engine as pinocchio_engine
from crosscheck.engines.pinocchio.engine import PinocchioTree
from crosscheck.engines.tree.tree_motion import link_terms
from crosscheck.measure.check import check

NEAR_LIMIT = Path(__file__).parents[1] / "corpus" / "massless-link-near-limit.toml"
"""A slider-crank whose crank is a distance, 1e-3 rad before the rod's limit: there the link turns 64 times as fast."""


def disagreements(before=1e-3):
    scene = refkin.load(NEAR_LIMIT)
    law = refkin.Polynomial(coefficients=(0.0, math.asin(10.0 / 80.0) - before))
    (driver,) = scene.mechanism.drivers
    scene = replace(scene, mechanism=replace(scene.mechanism, drivers=(replace(driver, law=law),)))
    record = check(scene, engines=["pinocchio"])
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


def test_a_mechanism_without_distance_joints_has_no_such_terms():
    assert link_terms(refkin.FourBar(ground=4.0, crank=1.0, coupler=3.5, rocker=3.0).scene().mechanism) == ()
