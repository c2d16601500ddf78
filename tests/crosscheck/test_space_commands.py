"""Commands on scenes of space: follow closes its path, effects are inert, every priced method answers or refuses."""

from __future__ import annotations

import json
from collections.abc import Iterator
from dataclasses import replace
from typing import Any

import numpy as np
import pytest

import refkin
from crosscheck.commands.bench import felt_lines
from crosscheck.commands.follow import _direction
from crosscheck.engines import EngineError, EngineRefusal
from crosscheck.engines.methods import Method, Use, methods
from crosscheck.judge.changes import change
from crosscheck.judge.comparison import reference
from crosscheck.judge.truth import CertifiedTruth
from crosscheck.measure.check import check
from crosscheck.measure.effects import ablations, rows
from refkin.model import Scene
from refkin.scenes.linkages import Hooke
from refkin.solving.follow import driven_by

from . import space_scenes

TIMES = (0.0, 0.05, 0.1, 0.15)


def hooke() -> Scene:
    return Hooke(beta=0.7).scene(samples=7, turns=0.1)


def few(scene: Scene) -> Scene:
    return replace(scene, times=TIMES)


def test_a_crank_in_space_that_turns_once_closes_its_path(command: Any) -> None:
    """Its Euler parameters are those of the first pose with the other sign."""
    code, out, _ = command("follow", space_scenes.rssr_by_distance(), "--json")
    path = json.loads(out)
    assert (code, path["end"]) == (0, "closed")
    assert path["t"][-1] - path["t"][0] == pytest.approx(2.0 * np.pi, abs=1e-12)
    assert len(path["tangents"][0]["bodies"]["crank"]) == 7
    assert refkin.follow(driven_by(space_scenes.rssr(), "motor"), most_points=2).parameter == "motor [rad]"


def test_a_tangent_in_space_is_told_by_angular_rates() -> None:
    path = refkin.follow(driven_by(space_scenes.rssr_by_distance(), "motor"), most_points=2)
    words = _direction(path, "motor", path.q[:, 0], path.tangents[0])
    crank, rocker = (np.fromstring(part.split(")")[0], sep=",") for part in words.split("(")[1:])
    assert words.endswith("rad per unit of motor")
    assert crank == pytest.approx([0.0, 0.0, 1.0], abs=1e-12)
    assert np.linalg.norm(np.cross(rocker, (0.25, 1.0, 0.125))) < 1e-5 < np.linalg.norm(rocker)


def test_effects_of_a_scene_of_space_are_inert_and_a_change_of_sign_is_none() -> None:
    scene = few(space_scenes.rssr())
    ref = reference(scene)
    (solving,) = methods("refkin", Use.EFFECTS)
    result = rows(ablations(solving, scene), ref, 0.0)
    assert {row.inert for row in result if row.note[:9] != "refkin ha"} == {True}
    turned = replace(ref.motion, **{k: getattr(ref.motion, k).copy() for k in ("q", "qd", "qdd")})
    for level in turned.levels:
        level[3:7] *= -1.0
    assert change(ref, ref.motion, turned, exact=False).largest == 0.0
    turned.q[17] += 1e-9
    seen = change(ref, ref.motion, turned, exact=False)
    assert (seen.inert, seen.worst.split(" at ")[0]) == (False, "position of rocker.e0")


def test_an_effect_that_is_refused_is_not_felt() -> None:
    scene = few(space_scenes.rssr_by_distance())
    method = next(m for m in methods("pinocchio", Use.EFFECTS) if m.name == "joint tree")
    whole = ablations(method, scene)
    gravity = tuple(a for a in whole.effects if a.effect == "gravity")
    runs = {name: whole.runs[name] for a in gravity for name in (a.off, a.on)}
    (row,) = (
        r
        for r in rows(replace(whole, effects=gravity, runs=runs), reference(scene), 0.0)
        if r.microseconds is None and r.effect == "gravity"
    )
    assert row.inert is None
    assert row.note == "pinocchio refuses physical effects in space: its adapter has them in the plane alone"
    assert felt_lines([row]) == ["no effect was measured"]


def answers(method: Method, scene: Scene) -> Any:
    model = method.model(scene)
    return list(model.read(model.solve(2)))


def priced(engine: str) -> Iterator[Method]:
    yield from (m for m in methods(engine, Use.PRICE) if not m.steps)


@pytest.mark.parametrize("make", [space_scenes.rssr, hooke], ids=["RSSR", "Hooke"])
@pytest.mark.parametrize("engine", ["exudyn", "pinocchio", "mujoco"])
def test_every_priced_method_answers_in_space_or_refuses_by_name(engine: str, make: Any) -> None:
    scene = few(make()) if make is space_scenes.rssr else make()
    truth, most, refused = CertifiedTruth(scene), 0.0, list[str]()
    for method in priced(engine):
        try:
            levels = answers(method, scene)
        except EngineRefusal as refusal:
            refused.append(str(refusal))
            continue
        digits = [truth.digits(level, k, levels[:k])[0] for k, level in enumerate(levels)]
        assert None not in digits
        most = max(most, min(d for d in digits if d is not None))
    assert most > 12.0
    assert all("space" in reason for reason in refused)


@pytest.mark.parametrize("engine", ["exudyn", "pinocchio", "mujoco"])
def test_methods_that_step_in_time_refuse_space_by_name(engine: str) -> None:
    for method in methods(engine, Use.PRICE):
        if method.steps:
            with pytest.raises(EngineError, match="space"):
                method.model(space_scenes.rssr())


def test_mujoco_answers_where_two_points_meet_that_no_joint_moves() -> None:
    """Both shafts of a Hooke joint turn about its centre: MuJoCo makes no rows of a connect there."""
    record = check(hooke(), ["mujoco"])
    assert [str(seen) for seen in record.disagreements] == []
    assert {answer.engine for answer in record.answers} == {"mujoco"}
