"""A solve that would take hours is refused at once, by a limit that can be raised; one that takes long says so."""

from __future__ import annotations

import threading
import time
from dataclasses import replace
from itertools import pairwise

import pytest

import refkin
from refkin import AngleDriver, Body, Mechanism, Polynomial, Revolute, Scene
from refkin.errors import InvalidRequest, InvalidScene
from refkin.scenes.linkages import RSSP
from refkin.solving import limits
from refkin.solving.limits import check_size, said_if_long
from refkin.solving.solve import nearest
from refkin.system import compile_system

from .contact_cases import RATE, over_profile


def chain(count: int) -> Scene:
    """Return a chain of bodies, each turned against the one before."""
    names = ["ground", *(f"b{k}" for k in range(count))]
    pairs = list(pairwise(names))
    joints = tuple(
        Revolute(name=f"j{k}", body_i=i, point_i=(float(k > 0), 0.0), body_j=j, point_j=(0.0, 0.0))
        for k, (i, j) in enumerate(pairs)
    )
    law = Polynomial(coefficients=(0.1,))
    drivers = tuple(AngleDriver(name=f"d{k}", body=j, relative_to=i, law=law) for k, (i, j) in enumerate(pairs))
    bodies = tuple(Body(name=name, estimate=(float(k), 0.0, 0.0)) for k, name in enumerate(names[1:]))
    return Scene(mechanism=Mechanism(bodies, joints, drivers), times=(0.0,), name="chain")


@pytest.mark.parametrize("solving", [refkin.solve, nearest])
def test_a_chain_of_twenty_thousand_bodies_is_refused_in_a_second_with_what_it_would_take(solving):
    scene = chain(20_000)
    start = time.process_time()
    with pytest.raises(
        InvalidScene, match=r"60000 coordinates at 1 times, would take about 28.8 GB and \d+ h; set REFKIN_LIMIT="
    ):
        solving(scene)

    assert time.process_time() - start < 5.0


@pytest.mark.parametrize("given", ["much", "", "nan", "0", "-1"])
def test_limits_are_raised_by_a_number_alone(given, monkeypatch):
    """A word was an error of Python, and no number no limit."""
    monkeypatch.setenv(limits.VARIABLE, given)

    with pytest.raises(InvalidRequest, match=f"REFKIN_LIMIT: expected a number above 0, got '{given}'"):
        refkin.solve(chain(2))


@pytest.mark.parametrize("made", ["chain", "redundant", "space", "cam"])
def test_what_a_dense_solve_takes_is_reckoned_with_the_rows_and_coordinates_that_it_has(made, monkeypatch):
    """8 bytes for a number of the Jacobian, eight eliminations of it for a pose; what just fits is not refused."""
    scene = {
        "chain": chain(3),
        "space": RSSP(1.0, 3.0, (0.5, 0.25, 0.5), (1.0, 0.5, 0.25)).scene(samples=5),
        "cam": over_profile(RATE),
    }.get(made)
    if scene is None:
        plain = chain(3)
        driver = AngleDriver(name="again", body="b0", law=Polynomial(coefficients=(0.1,)))
        mechanism = replace(plain.mechanism, drivers=(*plain.mechanism.drivers, driver))
        scene = replace(plain, mechanism=mechanism, times=(0.0, 1.0))
    system, times = compile_system(scene.mechanism), len(scene.times)
    numbers = system.m * system.n * times
    for name, most in (("MOST_BYTES", 8.0 * numbers), ("MOST_SECONDS", 8e-9 * numbers * system.n)):
        with monkeypatch.context() as lowered:
            lowered.setattr(limits, name, 1.001 * most)
            check_size(scene)
            lowered.setattr(limits, name, most / 4.0)
            with pytest.raises(
                InvalidScene, match=rf"of {system.n} coordinates at {times} times, .* REFKIN_LIMIT=4.2 "
            ):
                check_size(scene)


def test_the_limit_can_be_raised_and_lowered(monkeypatch):
    scene = chain(3)
    assert refkin.solve(scene).verdict == "ok"

    monkeypatch.setattr(limits, "MOST_BYTES", 8.0 * 9 * 9 / 2)
    with pytest.raises(InvalidScene, match="REFKIN_LIMIT=2"):
        refkin.solve(scene)
    monkeypatch.setenv(limits.VARIABLE, "2.1")
    assert refkin.solve(scene).verdict == "ok"


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
