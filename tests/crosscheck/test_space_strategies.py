"""Drawn spatial linkages close at every time on the branch meant, go where they are said to go, and engines agree."""

from __future__ import annotations

from collections.abc import Callable
from contextlib import suppress
from typing import Any

import numpy as np
import pytest
from hypothesis import HealthCheck, Phase, assume, given, settings
from hypothesis import strategies as st

from crosscheck.engines import EngineRefusal
from crosscheck.engines.closed_form.jets import Floats
from crosscheck.engines.closed_form.space import SpatialAssembly
from crosscheck.engines.loading import load
from crosscheck.engines.spatial.motion import estimates
from crosscheck.engines.spatial.reading import numbers_of
from crosscheck.judge.comparison import reference
from crosscheck.measure.check import check
from crosscheck.night.moving_parts import DrawnSample
from crosscheck.night.sections import drawing_of
from crosscheck.scenes.drawing import SPATIAL, draw
from crosscheck.strategies import Spatial, space_kinds, spatial_scenes
from crosscheck.strategies.space_kinds import KINDS
from crosscheck.strategies.space_plans import ROOM, Region
from crosscheck.strategies.verdicts import Ended, ended_scenes
from refkin.joints import GROUND, SPATIAL_DRIVER_TYPES, SPATIAL_JOINT_TYPES
from refkin.model import Scene
from refkin.motion import Motion, Status
from refkin.scenes.files import parse, to_dict

from . import space_scenes

CAREFULLY = settings(max_examples=25, deadline=None, suppress_health_check=list(HealthCheck))


BY_NEWTON = ("RSCR", "Bricard", "Stewart")
"""Kinds whose bodies do not follow one from another: the closed form refuses them by name."""


def solved(drawn: Spatial) -> Motion:
    """Return the answer of the closed form; of Pinocchio where it refuses, which it may where joints are in parts."""
    with suppress(EngineRefusal):
        return load("closed_form").solve(drawn.scene)
    assert drawn.kind in BY_NEWTON or any(joint.type == "parallel" for joint in drawn.scene.mechanism.joints)
    return load("pinocchio").solve(drawn.scene)


@CAREFULLY
@given(spatial_scenes(samples=12))
def test_a_drawn_scene_closes_at_all_times_from_its_estimate(drawn: Spatial) -> None:
    motion = solved(drawn)
    assert set(motion.status) == {Status.OK}
    numbers = numbers_of(drawn.scene.mechanism)
    first = motion.q[:, 0].reshape(-1, 7)
    for at, (body, estimate) in zip(first, estimates(drawn.scene, numbers).items(), strict=True):
        if not any(body in spin for spin in numbers.passive):
            assert np.max(np.abs((at[:3] - numbers.origin) / numbers.size - estimate[:3])) < 0.05
            assert abs(at[3:] @ estimate[3:]) > 0.999


@CAREFULLY
@given(spatial_scenes(samples=5))
def test_a_drawn_scene_is_written_and_read_again(drawn: Spatial) -> None:
    assert parse(to_dict(drawn.scene)) == drawn.scene


@settings(CAREFULLY, max_examples=5)
@given(spatial_scenes(samples=8, kinds=("RSSR", "RSSP"), regions=(Region.LIMIT,), decades=(3, 3)))
def test_a_limit_is_as_near_as_it_is_said_to_be(drawn: Spatial) -> None:
    """What is left of the root by which its coupler is placed: at most a tenth in the end, and more before it."""
    assume(all(joint.type != "parallel" for joint in drawn.scene.mechanism.joints))  # in parts it may refuse them
    assembly = SpatialAssembly(drawn.scene, Floats())
    assembly.run()
    least = np.min([np.broadcast_to(root.share.v, 8) for root in assembly.roots], axis=0)
    if drawn.hardness is Region.LIMIT:
        assert 0.0 < least[-1] < 0.1
        assert least[0] > least[-1]
    else:
        assert drawn.hardness is Region.REGULAR


def test_nights_draw_every_joint_and_driver_of_space() -> None:
    drawn = [draw(3, 28 * k + place).scene.mechanism for k in range(60) for place in SPATIAL]
    types = {constraint.type for mechanism in drawn for constraint in (*mechanism.joints, *mechanism.drivers)}
    assert types == {constraint.type for constraint in (*SPATIAL_JOINT_TYPES, *SPATIAL_DRIVER_TYPES)}


def test_a_slide_never_moves_along_the_axis_of_the_rocker(monkeypatch: pytest.MonkeyPatch) -> None:
    """All points of the rocker are as far from a tip on its axis: no span has room, and drawing did not end."""
    reaches: list[Any] = []
    drawn = {"ground": 1.25, "rocker": 1.0}  # an axis along x, as all that is zero has it
    monkeypatch.setattr(
        space_kinds, "drawn_coupler", lambda *given: reaches.append(given[-1]) or ((0.0, 1.0), 1.5, 0.5, given[1])
    )
    KINDS["PSSR"][0](lambda _, label: drawn.get(label, 0.0), Region.REGULAR, 1.0, (2, 6))
    least, greatest = reaches[0](np.linspace(-3.0, 3.0, 7))

    assert np.max(greatest - least) > ROOM


def axes(drawn: Spatial) -> list[Any]:
    """Return the axes of the ground's joints."""
    held = {}
    for hold in numbers_of(drawn.scene.mechanism).holds:
        frames = {hold.body_i: hold.frame_i, hold.body_j: hold.frame_j}
        if GROUND in frames:
            held[hold.name] = frames[GROUND][:, 2]
    return [held[name] for name in sorted(held)]


PLACES: dict[Region, Callable[[Spatial], bool]] = {
    Region.LIMIT: lambda drawn: drawn.distance <= 1e-2,
    Region.FOLD: lambda drawn: drawn.distance <= 1e-2,
    Region.PLANAR: lambda drawn: np.linalg.norm(np.cross(*axes(drawn)[:2])) < 0.03,
    Region.GIMBAL: lambda drawn: abs(np.dot(*axes(drawn)[:2])) < 0.011,
    Region.OVER: lambda drawn: np.linalg.norm(np.cross(*axes(drawn)[:2])) < 0.2,
    Region.ALIKE: lambda drawn: drawn.distance < 0.5,
}
"""How it shows that a scene has gone to a region."""


@pytest.mark.parametrize("region", list(PLACES))
def test_every_hard_region_is_gone_to_on_purpose(region: Region) -> None:
    """Where a drawn linkage has no limit or fold it stays regular; that is so of two thirds at most."""
    drawn: list[Spatial] = []

    @settings(CAREFULLY, max_examples=32, derandomize=True, database=None, phases=[Phase.generate])
    @given(spatial_scenes(samples=3, regions=(region,)))
    def collect(one: Spatial) -> None:
        drawn.append(one)

    collect()
    there = [one for one in drawn if one.hardness is region]
    assert len(there) > len(drawn) / 3
    assert all(PLACES[region](one) for one in there)


def test_scenes_of_space_end_in_a_singular_pose_or_in_none_by_proof() -> None:
    seen: set[Status] = set()

    @settings(CAREFULLY, max_examples=24, derandomize=True, database=None, phases=[Phase.generate])
    @given(ended_scenes(samples=4))
    def ends(drawn: Ended) -> None:
        if drawn.kind == "RSSR" and (drawn.expected not in seen):
            seen.add(drawn.expected)
            record = check(drawn.scene, ["closed_form", "exudyn"], {"expected": str(drawn.expected)})
            assert record.reference.verdict == drawn.expected
            assert [str(d) for d in record.disagreements if d.method != "shipped"] == []

    ends()
    assert seen == {Status.SINGULAR, Status.UNASSEMBLABLE}


@pytest.mark.parametrize("engine", ["pinocchio", "mujoco", "exudyn"])
@settings(CAREFULLY, max_examples=6)
@given(spatial_scenes(samples=8, kinds=set(KINDS) - {"screw", *BY_NEWTON}, regions=(Region.REGULAR,)))
def test_engines_agree_with_the_closed_form_on_what_is_drawn(engine: str, drawn: Spatial) -> None:
    assume(engine != "exudyn" or drawn.kind != "geared")  # it refuses gears
    ours, theirs = solved(drawn), load(engine).solve(drawn.scene)
    assert set(theirs.status) == {Status.OK}
    passive = numbers_of(drawn.scene.mechanism).passive
    for k, body in enumerate(ours.bodies):
        if any(body in spin for spin in passive):
            continue
        one, other = (m.q[7 * k : 7 * k + 7] for m in (ours, theirs))
        sign = np.sign(np.sum(one[3:] * other[3:], axis=0))
        assert np.allclose(one[3:], sign * other[3:], rtol=0.0, atol=1e-9)


@pytest.mark.parametrize("kind", BY_NEWTON)
@settings(CAREFULLY, max_examples=3)
@given(data=st.data())
def test_engines_agree_on_what_no_closed_form_answers(kind: str, data: st.DataObject) -> None:
    drawn = data.draw(spatial_scenes(samples=8, kinds=(kind,), regions=(Region.REGULAR,)))
    record = check(drawn.scene, ["exudyn", "pinocchio", "mujoco"])
    assert record.reference.verdict == "ok"
    assert [str(d) for d in record.disagreements if d.method != "shipped"] == []
    assert {a.engine for a in record.answers} == {"exudyn", "pinocchio", "mujoco"}


def test_a_night_draws_a_share_of_spatial_scenes() -> None:
    drawn = [draw(1, number, 3) for number in range(28)]
    assert [k for k, d in enumerate(drawn) if isinstance(d, Spatial)] == list(SPATIAL)


@pytest.mark.parametrize("make", [space_scenes.rssr, space_scenes.rssr_by_distance, space_scenes.double_hooke])
def test_a_spatial_scene_is_pictured_in_projection(make: Callable[[], Scene]) -> None:
    """Bars between joint points, each as long as it is seen; a magnified error moves them."""
    scene = make()
    ref = reference(scene)
    drawing = drawing_of(ref.scene, ref.motion)
    picture = drawing.described(scene.name, "key")
    assert len(picture["parts"]) == len(picture["frames"][0])
    lengths = [place[3] for frame in picture["frames"] for place in frame if len(place) == 6]
    assert lengths
    assert max(lengths) < 4.0
    off = np.zeros_like(ref.levels[0])
    off[0] = 1e-9
    ghost = drawing.ghost(DrawnSample(2, 8.0, off), 0)
    assert ghost is not None
    assert ghost["factor"] > 1e6
    assert ghost["ghost"] != ghost["pose"]
