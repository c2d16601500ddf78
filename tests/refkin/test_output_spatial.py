"""Mechanisms of space are seen from one place: parts where the bodies are, arrows along their motion, moving lines."""

from __future__ import annotations

from dataclasses import replace
from xml.etree import ElementTree as ET

import numpy as np
import pytest

from refkin.joints import GROUND, elements_of
from refkin.joints.spatial import Perpendicular
from refkin.model import Effect
from refkin.motion import point_motion
from refkin.output import Drawing, animated, still
from refkin.output.drawing import Part, seen
from refkin.output.spatial import VIEW, block, features_of_joints
from refkin.scenes.files import load
from refkin.solving.solve import solve
from tests.places import ROOT

SCENES = ROOT / "docs" / "scenes"
SVG = "{http://www.w3.org/2000/svg}"


@pytest.fixture(scope="module")
def scene():
    result = replace(load(SCENES / "spatial-screw.toml"), effects=frozenset(Effect), evidence=frozenset())
    return replace(result, times=result.times[:9])


@pytest.fixture(scope="module")
def motion(scene):
    return solve(scene)


def test_the_view_is_a_right_handed_projection():
    across, up = VIEW

    assert pytest.approx(np.eye(2)) == VIEW @ VIEW.T
    assert pytest.approx([0.0, up[2]]) == VIEW @ [0.0, 0.0, 1.0]
    assert up[2] > 0
    assert np.cross(across, up) @ [1.0, 0.0, 0.0] > 0 > np.cross(across, up) @ [0.0, 1.0, 0.0]


def test_parts_are_seen_where_the_bodies_are():
    result = replace(load(SCENES / "spatial-distance.toml"), evidence=frozenset())
    answer = solve(replace(result, times=result.times[:5]))
    drawing = Drawing(answer.scene, answer)
    ends = [point_motion(u, answer[body].q).r for body, u in (("crank", (1.0, 0.0, 0.0)), ("rocker", (2.0, 0.0, 0.0)))]
    link = next(part for part in drawing.parts if part.name == "coupler")
    for k in range(5):
        points = np.stack([end[:, k] for end in ends], axis=1)

        assert np.linalg.norm(points[:, 1] - points[:, 0]) == pytest.approx(3.0)
        assert next(shape for shape in link.at(k) if shape.role == "link").points == pytest.approx(VIEW @ points)
        crank = next(part for part in drawing.parts if part.name == "crank")
        assert any(np.allclose(shape.points[:, -1], VIEW @ points[:, 0]) for shape in crank.at(k))


def test_a_cylinder_is_drawn_as_long_as_its_law_says():
    found = replace(load(SCENES / "distance-driver.toml"), evidence=frozenset())
    answer = solve(replace(found, times=found.times[:9]))
    drawing = Drawing(answer.scene, answer)
    (cylinder,) = (part for part in drawing.parts if part.name == "cylinder")
    law = found.mechanism.drivers[0].laws[0]
    for k, t in enumerate(drawing.t):
        (link,) = (shape.points for shape in cylinder.at(k) if shape.role == "link")

        assert np.linalg.norm(link[:, 1] - link[:, 0]) == pytest.approx(law(float(t)))


@pytest.mark.parametrize("rate", ["velocity", "acceleration"])
def test_an_arrow_is_seen_along_the_motion_of_its_point(scene, motion, rate):
    handle = motion.points["handle"]
    for k in range(9):
        truth = VIEW @ getattr(handle, rate[0])[:, k]
        arrows = [a.points for a in Drawing(scene, motion).arrows(k, rate)]
        (arrow,) = [points for points in arrows if np.allclose(points[:, 0], VIEW @ handle.r[:, k])]
        shown = arrow[:, 1] - arrow[:, 0]

        assert shown / np.linalg.norm(shown) == pytest.approx(truth / np.linalg.norm(truth))


def test_the_lines_of_an_animation_go_through_the_stills(scene, motion):
    drawing = Drawing(scene, motion)
    moving = ET.fromstring(animated(drawing))
    paths = [a.get("values").split(";") for a in moving.iter(f"{SVG}animate") if a.get("attributeName") == "d"]

    assert paths
    for k in range(9):
        still_paths = {path.get("d") for path in ET.fromstring(still(drawing, k)).iter(f"{SVG}path")}
        assert {values[k] for values in paths} <= still_paths


@pytest.mark.parametrize("file", sorted(SCENES.glob("spatial-*.toml")), ids=lambda file: file.stem)
def test_every_joint_of_space_can_be_drawn(file):
    result = replace(load(file), evidence=frozenset())
    answer = solve(replace(result, times=result.times[:2]))

    drawing = Drawing(answer.scene, answer)

    assert seen(np.zeros((3, 1))).shape == (2, 1)
    assert still(drawing).startswith("<svg")
    for part in (part for part in drawing.parts if isinstance(part, Part)):
        points = [(0.0, 0.0, 0.0), *(s.points[:, 0] for s in part.shapes if s.role in ("pin", "ground"))]
        for shape in part.shapes:
            triad = part.name == "ground" and shape.role == "guide" and not shape.points[:, 0].any()
            if shape.points.shape[1] > 1 and shape.role != "body" and not triad:
                around = np.linalg.norm(shape.points.mean(axis=1) - points, axis=1)
                assert np.min(around) < 1e-12 * answer.scene.mechanism.size()  # drawn evenly around a joint's point


def test_a_joint_of_axes_alone_is_drawn_around_the_origin_of_a_body():
    joint = Perpendicular(name="across", body_i=GROUND, axis_i=(0.0, 0.0, 1.0), body_j="body", axis_j=(3.0, 0.0, 4.0))
    middles = [s.points.mean(axis=1).tolist() for s in features_of_joints([*elements_of([joint])], "body", 2.0)]

    assert middles == [[0.0, 0.0, 0.0]] * 2


def test_a_body_of_one_point_is_an_upright_square_around_it():
    corners = block(np.array([[1.0], [2.0], [3.0]]), 10.0).points - np.array([[1.0], [2.0], [3.0]])
    half = np.abs(corners[0, 0])

    assert sorted(map(tuple, (corners / half).T)) == [(-1, 0, -1), (-1, 0, 1), (1, 0, -1), (1, 0, 1)]
    assert np.all(np.abs(np.diff(corners, axis=1)).sum(axis=0) == 2 * half)
