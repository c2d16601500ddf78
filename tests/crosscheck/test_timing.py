"""The timer takes workloads in turns, repeats the quick ones, and keeps the least of several rounds."""

from __future__ import annotations

from functools import partial

import pytest

from crosscheck.workers import timing
from crosscheck.workers.timing import timed_in_turns


class Clock:
    """A clock that only workloads move on."""

    def __init__(self) -> None:
        self.now = 0.0

    def perf_counter(self) -> float:
        return self.now

    process_time = perf_counter


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
    timings = timed_in_turns({"a": lasting(clock, 1.0, 1.0, 4.0, 2.0, 3.0)}, rounds=3, at_least=0.0)

    assert (timings["a"].seconds, timings["a"].spread) == (2.0, 0.5)


def test_a_quick_work_is_repeated_until_its_turn_is_long_enough(clock):
    timings = timed_in_turns({"a": lasting(clock, 1e-5)}, rounds=2, at_least=1e-3)

    assert timings["a"].seconds == pytest.approx(1e-5)
    assert 2 * 1e-3 <= clock.now < 1e-2


def test_works_are_taken_in_turns(clock):
    order = []
    workloads = {name: (lambda name=name: (order.append(name), lasting(clock, 1.0)())) for name in "ab"}
    timed_in_turns(workloads, rounds=3, at_least=0.0)

    assert "".join(order[-6:]) == "ababab"


def routes(clock, cold):
    """Return position, and position with rates, of two methods that find the other's caches; a cold call costs more."""
    last = [""]

    def solve(name, seconds):
        clock.now += seconds + (cold if last[0] != name else 0.0)
        last[0] = name

    costs = {"position": 5e-4, "position and rates": 6e-4}
    return {f"{m}: {what}": partial(solve, m, s) for m in ("one", "other") for what, s in costs.items()}


@pytest.mark.parametrize("cold", [3e-4, 1e-3, 1e-2])
def test_who_comes_after_another_method_does_not_pay_for_cold_caches(clock, cold):
    """Planted: the timer that timed a turn's first call, too, had positions cost more than positions with rates."""
    timings = timed_in_turns(routes(clock, cold), rounds=3)

    for name in ("one", "other"):
        assert timings[f"{name}: position"].seconds == pytest.approx(5e-4)
        assert timings[f"{name}: position and rates"].seconds == pytest.approx(6e-4)


def test_what_a_call_takes_need_not_be_measured_where_it_is_known(clock):
    calls = []
    timed_in_turns({"a": lambda: (calls.append(1), lasting(clock, 1.0)())}, rounds=2, at_least=0.0, known={"a": 1.0})

    assert len(calls) == 2  # so long a call needs none before it


def test_no_round_is_begun_when_the_time_is_over(clock):
    order = []
    timed_in_turns({"a": lambda: (order.append("a"), lasting(clock, 1.0)())}, rounds=100, at_least=0.0, within=3.0)

    assert len(order) == 2 + 4
