"""A scene that gives no estimates leaves the assembly open: the engines are asked for the one the reference found."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import pytest

from crosscheck.measure.check import check
from refkin.model import Scene
from refkin.scenes.files import load

EXAMPLES = sorted((Path(__file__).parent.parent.parent / "examples").glob("*.toml"))


def without_estimates(path: Path, *kept: str) -> Scene:
    scene = load(path)
    bodies = tuple(b if b.name in kept else replace(b, estimate=None) for b in scene.mechanism.bodies)
    return replace(scene, mechanism=replace(scene.mechanism, bodies=bodies), times=scene.times[:5])


@pytest.mark.parametrize("kept", [(), ("crank",)], ids=["no estimate", "one estimate"])
@pytest.mark.parametrize("path", EXAMPLES, ids=lambda path: path.stem)
def test_every_engine_answers_a_scene_without_estimates_and_agrees(path, kept):
    record = check(without_estimates(path, *kept), ["closed_form", "vector_loop", "exudyn", "pinocchio", "mujoco"])

    assert record.disagreements == []
    assert {a.engine for a in record.answers} == {"closed_form", "vector_loop", "exudyn", "pinocchio", "mujoco"}
