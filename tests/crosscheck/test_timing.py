"""The timer takes works in turns, repeats the quick ones, and keeps the least of several rounds."""

from __future__ import annotations

import pytest

from crosscheck.workers import timing
from crosscheck.workers.timing import timed_in_turns


class Clock:
    """A clock that only works move on."""

    def __init__(self) -> None:
        self.now = 0.0

    def perf_counter(self) -> float:
        return self.now


@pytest.fixture
def clock(monkeypatch):
    clock = Clock()
    monkeypatch.setattr(timing, "time", clock)
    return clock


def lasting(clock, *seconds):
    """A work whose calls last so long, one after the other, the last for ever after."""
    left = list(seconds)

    def work():
        clock.now += left.pop(0) if len(left) > 1 else left[0]

    return work


def test_the_least_of_all_rounds_counts_and_the_spread_is_how_far_the_median_lies_above(clock):
    found = timed_in_turns({"a": lasting(clock, 1.0, 1.0, 4.0, 2.0, 3.0)}, rounds=3, at_least=0.0)

    assert (found["a"].seconds, found["a"].spread) == (2.0, 0.5)


def test_a_quick_work_is_repeated_until_its_turn_is_long_enough(clock):
    found = timed_in_turns({"a": lasting(clock, 1e-5)}, rounds=2, at_least=1e-3)

    assert found["a"].seconds == pytest.approx(1e-5)
    assert clock.now >= 2 * 1e-3


def test_works_are_taken_in_turns(clock):
    order = []
    works = {name: (lambda name=name: (order.append(name), lasting(clock, 1.0)())) for name in "ab"}
    timed_in_turns(works, rounds=3, at_least=0.0)

    assert "".join(order[-6:]) == "ababab"


def test_no_round_is_begun_when_the_time_is_over(clock):
    order = []
    timed_in_turns({"a": lambda: (order.append("a"), lasting(clock, 1.0)())}, rounds=100, at_least=0.0, within=3.0)

    assert len(order) == 2 + 4
