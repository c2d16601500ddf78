"""What takes long says so while it is under way, at once when it does, and then ever more seldom; nothing else does."""

from __future__ import annotations

import threading
import time

import pytest

import refkin
from refkin.solving import limits
from refkin.solving.limits import said_if_long


def waited_for(condition) -> bool:
    end = time.monotonic() + 60.0
    while not condition() and time.monotonic() < end:
        time.sleep(0.001)
    return bool(condition())


@pytest.fixture
def hurried(monkeypatch):
    monkeypatch.setattr(limits, "LOOK", 0.005)
    monkeypatch.setattr(limits, "LONG", 0.01)
    assert waited_for(lambda: limits._WATCH.thread is None)


def test_a_solve_that_takes_long_says_so_before_it_ends(hurried, monkeypatch, caplog):
    from refkin.solving import solve as solving

    scene = refkin.FourBar(ground=4.0, crank=1.0, coupler=3.5, rocker=3.0).scene(samples=3)
    whole, said = solving._answer, []

    def slow(*given):
        assert waited_for(lambda: len(caplog.messages) > 1)
        said.extend(caplog.messages)
        return whole(*given)

    monkeypatch.setattr(solving, "_answer", slow)
    assert refkin.solve(scene).verdict == "ok"

    assert all(line.startswith(f"solving {scene.name!r} at 3 times: ") for line in said)


def test_what_is_said_of_a_path_is_said_while_it_is_followed(hurried, caplog):
    parallelogram = refkin.FourBar(ground=4.0, crank=1.0, coupler=4.0, rocker=1.0)
    said = []

    def choose(_):
        assert waited_for(lambda: caplog.messages)
        said.extend(caplog.messages)

    refkin.follow(parallelogram.scene(law=refkin.Polynomial(coefficients=(0.0, 1.0)), times=(0.5,)), choose=choose)

    assert said[0].startswith("following a path: ")


def test_what_is_over_in_time_says_nothing_and_leaves_no_thread(monkeypatch, caplog):
    monkeypatch.setattr(limits, "LOOK", 0.005)
    for _ in range(3):
        with said_if_long("nothing"):
            pass

    assert waited_for(lambda: limits._WATCH.thread is None)
    assert not limits._WATCH.begun
    assert not caplog.messages


def test_one_thread_looks_after_all(hurried, caplog):
    with said_if_long("one"), said_if_long("other"):
        assert sum(thread.name == "refkin-patience" for thread in threading.enumerate()) == 1
        assert waited_for(lambda: {line.split(":")[0] for line in caplog.messages} == {"one", "other"})
