"""The named checks, each of which the mutants are held against."""

from __future__ import annotations

import pytest

from crosscheck.selfchecks import CHECKS, CheckFailed
from crosscheck.selfchecks.claims import demand, demand_near, demand_raises


@pytest.mark.parametrize("name", CHECKS)
def test_check(name):
    CHECKS[name].run()


def test_every_check_says_what_it_claims():
    assert [name for name, check in CHECKS.items() if not check.claim.endswith(".")] == []


def test_nan_holds_nowhere():
    with pytest.raises(CheckFailed):
        demand_near([1.0, float("nan")], [1.0, 2.0], 1e9, "nan")


def test_another_shape_is_no_agreement():
    with pytest.raises(CheckFailed, match="shape"):
        demand_near([1.0], [[1.0]], 1e9, "shape")


def test_an_error_that_does_not_come_is_seen():
    with pytest.raises(CheckFailed, match="no ValueError"):
        demand_raises(ValueError, lambda: None, "nothing")


def test_a_claim_that_does_not_hold_is_told():
    with pytest.raises(CheckFailed, match="why"):
        demand(False, "why")
