"""The check of every pose of the fast paths: the residual by the formulas, with sines of its own."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

import refkin
from refkin.fast import answer, attempt, prepared
from refkin.fast.prepare import Prepared
from refkin.fast.residual import residual
from refkin.newton import ROUND_OFF

SCENES = {
    "four_bar": refkin.FourBar(crank=1.0, coupler=3.5, rocker=3.0, ground=4.0).scene(samples=40),
    "fast four_bar": refkin.FourBar(crank=1.0, coupler=3.5, rocker=3.0, ground=4.0).scene(samples=40, speed=1e6),
    "inverted": refkin.InvertedSliderCrank(crank=1.0, ground=3.0).scene(samples=40),
}


def made(scene: str) -> Prepared:
    result = prepared(replace(SCENES[scene], evidence=frozenset()))
    assert result is not None
    return result


@pytest.fixture(params=SCENES)
def ready(request: pytest.FixtureRequest) -> Prepared:
    return made(request.param)


def poses(ready: Prepared) -> np.ndarray:
    motion = attempt(ready)
    assert motion is not None
    return ready.system.to_unit(motion.q)


@pytest.mark.parametrize("scene", SCENES)
@pytest.mark.parametrize("turns", [0.0, 1.0, -30.0, 1e6])
def test_it_is_that_of_the_readable_formulas_to_a_few_units_however_far_an_angle_has_turned(
    scene: str, turns: float
) -> None:
    ready = made(scene)
    q = poses(ready)
    q[2::3] += 2.0 * np.pi * turns
    expected = np.max(np.abs(ready.system.phi(q, ready.t)), axis=0)
    assert np.max(np.abs(residual(ready.system, q, ready.t) - expected)) <= ROUND_OFF / 4


@pytest.mark.parametrize("scene", SCENES)
@pytest.mark.parametrize("count", [1, 2, 40])
def test_every_coordinate_that_is_off_is_seen_at_its_time_alone(scene: str, count: int) -> None:
    ready = made(scene)
    q = poses(ready)[:, :count]
    for coordinate in range(ready.system.n):
        off = q.copy()
        off[coordinate, count // 2] += 1e-12
        seen = residual(ready.system, off, ready.t[:count]) > ROUND_OFF
        assert np.flatnonzero(seen).tolist() == [count // 2]


def test_a_number_that_is_none_is_none_in_the_residual_of_its_time(ready: Prepared) -> None:
    q = poses(ready)
    q[2, 3] = np.nan
    assert np.flatnonzero(np.isnan(residual(ready.system, q, ready.t))).tolist() == [3]


def test_a_prepared_scene_is_solved_again_and_again_to_the_same_bits_whatever_is_done_to_an_answer(
    ready: Prepared,
) -> None:
    first = attempt(ready)
    assert first is not None
    kept = [level.copy() for level in first.levels if level is not None]
    for level in (*first.levels, first.t, first.residual):
        assert level is not None
        level[:] = 0.0
    again = attempt(ready)
    assert again is not None
    assert again == attempt(ready.scene)
    assert all(np.array_equal(a, b) for a, b in zip(again.levels, kept, strict=True))


def test_one_time_alone_has_the_answer_that_it_has_among_others_and_is_checked_as_well(
    ready: Prepared, monkeypatch: pytest.MonkeyPatch
) -> None:
    among, scene = attempt(ready), replace(ready.scene, times=ready.scene.times[:1])
    alone = attempt(scene)
    assert among is not None
    assert alone is not None
    for level, first in zip(alone.levels, among.levels, strict=True):
        assert level is not None
        assert first is not None
        assert np.max(np.abs(level - first[:, :1])) <= 1e-14 * max(1.0, float(np.max(np.abs(first))))

    monkeypatch.setattr(answer, "residual", lambda system, q, t: residual(system, q + 1e-12, t))
    assert attempt(scene) is None
