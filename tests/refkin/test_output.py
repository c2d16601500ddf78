"""Pictures and tables hold the motion, in its units; nothing is drawn of a motion without a pose."""

from __future__ import annotations

import csv
import importlib
import math
from dataclasses import replace
from xml.etree import ElementTree as ET

import numpy as np
import pytest

import refkin
from refkin.output import Drawing, NothingToDraw, animated, still
from refkin.output.tables import long, wide, write_csv

SVG = "{http://www.w3.org/2000/svg}"


@pytest.fixture(scope="module")
def scene():
    linkage = refkin.FourBar(ground=4.0, crank=1.0, coupler=3.5, rocker=3.0)
    drawn = linkage.scene(speed=2.0, turns=1, samples=9, branch="open")
    return replace(drawn, points=(refkin.Point(name="P", body="coupler", position=(0.3, 0.2)),))


@pytest.fixture(scope="module")
def motion(scene):
    return refkin.solve(scene)


def test_parts_are_drawn_where_the_bodies_are(scene, motion):
    """The coupler's ends are those of crank and rocker at every time, as lengths of the linkage say."""
    drawing = Drawing(scene, motion)
    crank, coupler, rocker = (
        next(p for p in drawing.parts if p.name == name) for name in ("crank", "coupler", "rocker")
    )
    for k in range(len(drawing.t)):
        ends = [np.array(next(s for s in part.at(k) if s.role == "body").points) for part in (crank, coupler, rocker)]
        lengths = [math.dist(points[:, 0], points[:, 1]) for points in ends]

        assert lengths == pytest.approx([1.0, 3.5, 3.0])
        assert ends[0][:, 1] == pytest.approx(ends[1][:, 0])


def test_the_box_holds_all_that_moves_and_no_more(scene, motion):
    drawing = Drawing(scene, motion)
    points = np.concatenate([s.points for p in drawing.parts for k in range(9) for s in p.at(k)], axis=1)
    curve = drawing.curves[0].points

    assert drawing.box[0] == pytest.approx(np.minimum(points.min(axis=1), curve.min(axis=1)))
    assert drawing.box[1] == pytest.approx(np.maximum(points.max(axis=1), curve.max(axis=1)))


def test_the_curve_of_a_wanted_point_is_its_motion(scene, motion):
    assert Drawing(scene, motion).curves[0].points == pytest.approx(motion.points["P"].r)


@pytest.mark.parametrize("rate", ["velocity", "acceleration"])
def test_an_arrow_points_as_the_difference_of_positions_does(scene, rate):
    """Of the wanted point: against its own v and a, which come by another way."""
    whole = refkin.solve(scene)
    drawing = Drawing(scene, whole)
    truth = getattr(whole.points["P"], rate[0])
    for k in range(9):
        tails = [(a.points[:, 0], a.points[:, 1] - a.points[:, 0]) for a in drawing.arrows(k, rate)]
        at = [v for tail, v in tails if np.allclose(tail, whole.points["P"].r[:, k])]

        assert len(at) == 1
        assert at[0] / np.linalg.norm(at[0]) == pytest.approx(truth[:, k] / np.linalg.norm(truth[:, k]))


def test_arrows_of_a_rate_that_was_not_called_for_are_refused(scene):
    positions = replace(scene, effects=frozenset())

    with pytest.raises(NothingToDraw, match="holds no velocity"):
        Drawing(positions, refkin.solve(positions)).arrows(0, "velocity")


def test_a_picture_is_svg_that_loads_nothing(scene, motion):
    for text in (still(Drawing(scene, motion), 3, ["velocity"]), animated(Drawing(scene, motion))):
        root = ET.fromstring(text)

        assert root.tag == f"{SVG}svg"
        assert "script" not in text
        assert "href" not in text


def test_an_animation_turns_each_body_by_its_angle(scene, motion):
    root = ET.fromstring(animated(Drawing(scene, motion)))
    turned = {
        group.find(f"{SVG}title").text: group.find(f"{SVG}animateTransform").get("values").split(";")
        for group in root.iter(f"{SVG}g")
        if group.find(f"{SVG}title") is not None
    }

    assert [float(x) for x in turned["rocker"]] == pytest.approx(-np.degrees(motion["rocker"].phi), abs=0.006)


def test_a_name_cannot_leave_the_picture(scene, motion):
    assert "<b>" not in still(Drawing(replace(scene, name="<b>x</b>"), motion))


def test_a_motion_without_a_pose_or_a_body_is_no_picture(scene, motion):
    with pytest.raises(NothingToDraw, match="no pose"):
        Drawing(scene, replace(motion, q=np.full_like(motion.q, np.nan)))
    part = replace(scene, bodies_wanted=("crank",))
    with pytest.raises(NothingToDraw, match="coupler, rocker"):
        Drawing(part, refkin.solve(part))


@pytest.mark.parametrize(("suffix", "first"), [(".png", b"\x89PNG"), (".gif", b"GIF8")])
def test_matplotlib_writes_the_same_parts(scene, motion, tmp_path, suffix, first):
    raster = importlib.import_module("refkin.output.raster")
    file = tmp_path / f"picture{suffix}"
    save = raster.save_still if suffix == ".png" else raster.save_animation
    save(Drawing(scene, motion), file)

    assert file.read_bytes().startswith(first)


def test_a_table_gives_every_number_back(scene, motion, tmp_path):
    write_csv(motion, tmp_path / "motion.csv")
    with open(tmp_path / "motion.csv", newline="", encoding="utf-8") as file:
        rows = list(csv.DictReader(file))

    assert [float(row["rocker.phidd [rad/s^2]"]) for row in rows] == motion["rocker"].phidd.tolist()
    assert [float(row["P.yd [m/s]"]) for row in rows] == motion.points["P"].v[1].tolist()
    assert {row["status"] for row in rows} == {"ok"}


def test_a_long_table_has_one_row_per_number_with_its_unit(motion):
    table = long(motion)
    at = (table["name"] == "coupler") & (table["quantity"] == "phid")

    assert len(table["value"]) == len(motion.t) * (len(wide(motion)) - 2)
    assert set(table["unit"][at]) == {"rad/s"}
    assert table["value"][at].tolist() == motion["coupler"].phid.tolist()


def test_no_number_is_an_empty_cell(motion, tmp_path):
    q = motion.q.copy()
    q[:, 2] = np.nan
    write_csv(replace(motion, q=q), tmp_path / "motion.csv")

    assert (tmp_path / "motion.csv").read_text(encoding="utf-8").splitlines()[3].split(",")[2] == ""


def test_a_motion_shows_itself_in_five_lines(motion):
    shown = repr(motion).splitlines()

    assert len(shown) == 5
    assert shown[-1] == "verdict: ok, 9 times ok>"
    assert "crank, coupler, rocker" in shown[2]


def test_motions_are_equal_if_every_number_is(scene, motion):
    q = motion.q.copy()
    q[0, 3] = np.nextafter(q[0, 3], 10.0)

    assert refkin.solve(scene) == motion
    assert replace(motion, q=q) != motion
    assert replace(motion, residual=motion.residual * np.nan) == replace(motion, residual=motion.residual * np.nan)


def test_the_text_of_a_scene_is_a_program_that_makes_it(scene):
    """So the text of a failing example can be pasted."""
    names = {name: getattr(refkin, name) for name in refkin.__all__}  # what `from refkin import *` gives
    linkage = refkin.SliderCrank(crank=1.0, rod=3.0)

    assert eval(repr(scene), names) == scene
    assert eval(repr(linkage), names) == linkage
