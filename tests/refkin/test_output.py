"""Pictures and tables hold the motion, in its units; nothing is drawn of a motion without a pose."""

from __future__ import annotations

import csv
import math
import pickle
import sys
from dataclasses import replace
from itertools import pairwise
from types import SimpleNamespace
from xml.etree import ElementTree as ET

import numpy as np
import pytest

import refkin
from refkin.joints import SPACE
from refkin.joints.elements import GuidedPoint
from refkin.motion import ContactMotion
from refkin.output import Drawing, NothingToDraw, animated, raster, still
from refkin.output.drawing import _features
from refkin.output.spatial import Shape
from refkin.output.svg import MARGIN, WIDTH
from refkin.output.tables import MissingPackage, long, wide
from refkin.scenes.linkages import RSSP, Hooke
from refkin.solving.follow import driven_by
from tests.linkages import ROCKER, remade

SVG = "{http://www.w3.org/2000/svg}"


@pytest.fixture(scope="module")
def scene():
    drawn = ROCKER.scene(speed=2.0, turns=1, samples=9, branch="open")
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


def test_a_picture_can_be_read_whatever_characters_names_have(scene):
    text = still(Drawing(replace(scene, name="\x01 \x7f \ufffe <&"), refkin.solve(scene)))

    assert ET.fromstring(text).find("{*}title").text.startswith("\ufffd \x7f \ufffd <&")


def test_a_distance_is_drawn_as_a_link_from_point_to_point(scene):
    """The coupler of the four-bar without its body."""
    bodies = tuple(body for body in scene.mechanism.bodies if body.name != "coupler")
    pivots = tuple(joint for joint in scene.mechanism.joints if "coupler" not in (joint.body_i, joint.body_j))
    ends = {"body_i": "crank", "point_i": (0.5, 0.0), "body_j": "rocker", "point_j": (1.5, 0.0)}
    joints = (*pivots, refkin.Distance(name="rod", **ends, length=3.5))
    scene = remade(scene, bodies=bodies, joints=joints, times=scene.times[1:], points=())
    parts = {part.name: part for part in Drawing(scene, refkin.solve(scene)).parts}
    for k in range(8):
        crank, rod, rocker = (
            next(s.points for s in parts[name].at(k) if s.role in ("body", "link"))
            for name in ("crank", "rod", "rocker")
        )

        assert rod == pytest.approx(np.column_stack([crank[:, 1], rocker[:, 1]]))


def test_the_box_holds_all_that_moves_and_no_more(scene, motion):
    drawing = Drawing(scene, motion)
    points = np.concatenate([s.points for p in drawing.parts for k in range(9) for s in p.at(k)], axis=1)
    curve = drawing.curves[0].points

    assert drawing.box[0] == pytest.approx(np.minimum(points.min(axis=1), curve.min(axis=1)))
    assert drawing.box[1] == pytest.approx(np.maximum(points.max(axis=1), curve.max(axis=1)))


@pytest.mark.parametrize("kind", [None, SPACE])
def test_the_box_holds_wheels_and_curves_and_guides_of_space_alone(kind):
    draw = np.random.default_rng(4)
    for _ in range(30):
        points, curve, radii = draw.uniform(-1.0, 1.0, (3, 2, 3)), draw.uniform(-1.5, 1.5, (2, 4)), (0.0, 0.5, 0.0)
        shapes = [*map(Shape, ("body", "wheel", "guide"), points, radii)]
        part = SimpleNamespace(at=lambda k, shapes=shapes: [shapes[k]])
        drawing = SimpleNamespace(t=range(3), parts=[part], curves=[SimpleNamespace(points=curve)], _kind=kind)
        held = np.concatenate([points[0], points[1] - 0.5, points[1] + 0.5, curve, *points[2:][kind is None :]], axis=1)

        assert np.array_equal(Drawing._box(drawing), [held.min(axis=1), held.max(axis=1)])


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


def test_an_animation_shows_each_pose_at_its_part_of_the_time(scene):
    uneven = replace(scene, times=(0.5, 0.75, 1.5, 2.5))
    root = ET.fromstring(animated(Drawing(uneven, refkin.solve(uneven))))
    keys = {moved.get("keyTimes") for moved in root.iter(f"{SVG}animateTransform")}

    assert keys == {"0.00000;0.12500;0.50000;1.00000"}


@pytest.mark.parametrize(("k", "height"), [(0, 0.0), (3, 0.0), (3, 0.7)])
def test_a_bar_is_drawn_from_pin_to_pin_and_the_mechanism_from_margin_to_margin(k, height):
    """The width decides here: what lies furthest to the left and to the right is `MARGIN` away from the page's ends."""
    linkage = refkin.FourBar(ground=4.0, crank=1.0, coupler=3.5, rocker=3.0, origin=(0.0, height))
    scene = linkage.scene(speed=2.0, turns=1, samples=9, branch="open")
    motion = refkin.solve(scene)
    drawing = Drawing(scene, motion)
    root = ET.fromstring(still(drawing, k))
    scale = (WIDTH - 2 * MARGIN) / (drawing.box[1] - drawing.box[0])[0]
    paths = {group.find(f"{SVG}title").text: group.findall(f"{SVG}path") for group in root.iter(f"{SVG}g")}
    bars = {name: path.get("d") for name, some in paths.items() for path in some if path.get("stroke-width") == "5"}
    for part in (part for part in drawing.parts if part.name in motion.bodies):
        points = next(shape for shape in part.at(k) if shape.role == "body").points
        at = (points - drawing.box[0][:, None]) * scale
        ends = np.array([[float(x) for x in end.split()] for end in bars[part.name].strip("Mz").split("L")]).T

        assert ends[0] == pytest.approx(MARGIN + at[0], abs=0.02)
        assert np.ptp(ends[1] + at[1]) == pytest.approx(0.0, abs=0.02)


def test_a_body_with_one_joint_point_is_an_upright_block_around_it():
    scene = refkin.SliderCrank(crank=1.0, rod=3.0).scene(samples=2, turns=0.05)
    slider = next(part for part in Drawing(scene, refkin.solve(scene)).parts if part.name == "slider")
    x, y = next(shape for shape in slider.shapes if shape.role == "slider").points
    sides = np.diff(np.array([[*x, x[0]], [*y, y[0]]]), axis=1).T

    assert [abs(one @ other) for one, other in pairwise(sides)] == pytest.approx([0.0, 0.0, 0.0])
    assert min(np.hypot(*sides.T)) > 0.0
    assert (min(x) + max(x), min(y) + max(y)) == pytest.approx((0.0, 0.0))


def test_wheels_that_roll_on_each_other_are_drawn_about_their_pins_with_their_radii():
    radii = {"first": 0.5, "second": 0.75}
    pins = [
        refkin.Revolute(name=f"pin {b}", body_i="ground", point_i=(x, 0.0), body_j=b, point_j=(0.1, 0.2))
        for b, x in (("first", 0.0), ("second", 1.25))
    ]
    teeth = refkin.Gear(name="teeth", body_i="first", radius_i=0.5, body_j="second", radius_j=-0.75)
    motor = refkin.AngleDriver(name="motor", body="first", law=refkin.Polynomial(coefficients=(0.0, 1.0)))
    bodies = tuple(refkin.Body(name=b) for b in radii)
    scene = refkin.Scene(mechanism=refkin.Mechanism(bodies, (*pins, teeth), (motor,)), times=(0.0, 1.0))
    wheels = {
        part.name: next(s for s in part.shapes if s.role == "wheel")
        for part in Drawing(scene, refkin.solve(scene)).parts
        if part.name in radii
    }

    assert {name: wheel.radius for name, wheel in wheels.items()} == radii
    assert all(wheel.points.tolist() == [[0.1], [0.2]] for wheel in wheels.values())


def test_what_matplotlib_does_not_fill_it_does_not_close(scene, motion, tmp_path):
    raster = pytest.importorskip("refkin.output.raster")
    raster.save_still(Drawing(scene, motion), tmp_path / "picture.svg")
    styled = [(path.get("style", ""), path.get("d")) for path in ET.parse(tmp_path / "picture.svg").iter(f"{SVG}path")]
    hollow = [d for style, d in styled if "fill: none" in style and "stroke: #" in style]

    assert any(d.count("L") + d.count("C") >= 8 for d in hollow)
    assert not any(d.strip().endswith("z") for d in hollow)


def test_a_name_cannot_leave_the_picture(scene, motion):
    assert "<b>" not in still(Drawing(replace(scene, name="<b>x</b>"), motion))


def test_a_motion_without_a_pose_or_a_body_is_no_picture(scene, motion):
    with pytest.raises(NothingToDraw, match="no pose"):
        Drawing(scene, replace(motion, q=np.full_like(motion.q, np.nan)))
    part = replace(scene, bodies_wanted=("crank",))
    with pytest.raises(NothingToDraw, match="coupler, rocker"):
        Drawing(part, refkin.solve(part))


@pytest.mark.parametrize(("suffix", "first"), [(".png", b"\x89PNG"), (".gif", b"GIF8")])
def test_matplotlib_writes_the_same_parts(motion, tmp_path, suffix, first):
    file = tmp_path / f"picture{suffix}"
    (motion.plot() if suffix == ".png" else motion.animate()).save(file)

    assert file.read_bytes().startswith(first)


def test_a_page_is_as_high_as_what_it_shows(scene, motion):
    drawing = Drawing(scene, motion)
    figure, axes = raster._page(drawing)
    (x0, x1, y0, y1), (wide, high) = axes.axis(), figure.get_size_inches()

    assert high / wide == pytest.approx((y1 - y0) / (x1 - x0), rel=1e-12)


def test_matplotlib_draws_each_shape_where_it_is():
    figure = raster.Figure()
    axes = figure.add_axes((0.0, 0.0, 1.0, 1.0))
    plate = np.array([[0.0, 1.0, 2.0], [0.0, 3.0, 1.0]])
    for shape in (Shape("velocity", plate[:, :2] + 1), Shape("wheel", plate[:, 1:2], 2.5), Shape("body", plate)):
        raster._add(axes, shape)
    ((arrow,), (circle, polygon)) = axes.texts, axes.patches

    assert (arrow.xyann, arrow.xy) == ((1.0, 1.0), (2.0, 4.0))
    assert (circle.center, circle.radius) == ((1.0, 3.0), 2.5)
    assert np.array_equal(polygon.get_xy()[:-1].T, plate)
    assert not axes.lines


def test_a_table_gives_every_number_back(scene, motion, tmp_path):
    motion.to_csv(tmp_path / "motion.csv")
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
    replace(motion, q=q).to_csv(tmp_path / "motion.csv")

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


def test_a_data_frame_has_the_units_in_its_headers_and_gives_every_number_back(motion):
    pandas = pytest.importorskip("pandas")
    frame, rows = motion.to_dataframe(), motion.to_dataframe("long")

    assert list(frame.columns) == list(wide(motion))
    assert frame["rocker.phid [rad/s]"].tolist() == motion["rocker"].phid.tolist()
    assert frame["P.xdd [m/s^2]"].tolist() == motion.points["P"].a[0].tolist()
    assert isinstance(rows, pandas.DataFrame)
    assert rows.query("name == 'rocker' and quantity == 'phi'")["value"].tolist() == motion["rocker"].phi.tolist()
    with pytest.raises(refkin.InvalidRequest, match="'wide' or 'long', got 'tall'"):
        motion.to_dataframe("tall")


def test_without_pandas_the_message_says_what_to_install(motion, monkeypatch):
    monkeypatch.setitem(sys.modules, "pandas", None)

    with pytest.raises(MissingPackage, match=r"pip install 'refkin\[tables\]'"):
        motion.to_dataframe()


def test_without_matplotlib_a_picture_says_what_to_install(motion, tmp_path, monkeypatch):
    monkeypatch.delitem(sys.modules, "refkin.output.raster", raising=False)
    monkeypatch.delattr("refkin.output.raster", raising=False)
    monkeypatch.setitem(sys.modules, "matplotlib", None)

    with pytest.raises(MissingPackage, match=r"pip install 'refkin\[figures\]'"):
        motion.plot().save(tmp_path / "x.png")


def test_arrays_in_a_file_stand_under_their_headers(motion, tmp_path):
    motion.to_npz(tmp_path / "motion.npz")
    with np.load(tmp_path / "motion.npz") as arrays:
        assert {key: arrays[key].tolist() for key in arrays} == {k: list(v) for k, v in wide(motion).items()}


def test_the_contact_of_a_cam_has_columns():
    scene = refkin.load("tests/corpus/stretched.toml")
    motion = refkin.solve(scene)
    cam = replace(motion, contacts={"cam": ContactMotion(s=motion.t, sd=2 * motion.t)})

    assert wide(cam)["cam.sd [rad/s]"].tolist() == (2 * motion.t).tolist()
    assert "cam.sdd [rad/s^2]" not in wide(cam)


def test_a_path_is_a_table_of_its_poses(scene, tmp_path):
    path = refkin.follow(driven_by(scene, "driver"))
    path.to_csv(tmp_path / "path.csv")
    with open(tmp_path / "path.csv", newline="", encoding="utf-8") as file:
        rows = list(csv.DictReader(file))

    assert [float(row["driver [rad]"]) for row in rows] == path.t.tolist()
    assert [float(row["rocker.phi [rad]"]) for row in rows] == path["rocker"].phi.tolist()
    assert "t [s]" in wide(refkin.follow(scene))


def test_coordinates_that_were_called_for_complete_on_tab(scene, motion):
    positions = refkin.solve(replace(scene, effects=frozenset()))

    assert {"x", "yd", "phidd"} <= set(dir(motion["rocker"]))
    assert {"x", "y", "phi"} <= set(dir(positions["rocker"]))
    assert "phid" not in dir(positions["rocker"])
    assert motion._ipython_key_completions_() == ["crank", "coupler", "rocker"]
    with pytest.raises(AttributeError, match="not called for by the scene"):
        positions["rocker"].phid  # noqa: B018


def test_motion_picture_scene_and_linkage_show_themselves_in_a_notebook(motion, scene):
    linkages = refkin.SliderCrank(crank=1.0, rod=3.0), Hooke(beta=0.5)

    for shown in (motion, motion.plot(), scene, *linkages):
        assert ET.fromstring(shown._repr_svg_()).tag == f"{SVG}svg"
    assert "verdict: ok" in motion._repr_html_()
    assert "<svg" in motion._repr_html_()


def test_what_has_no_pose_shows_no_picture_in_a_notebook(motion):
    apart = refkin.FourBar(ground=10.0, crank=1.0, coupler=1.0, rocker=1.0)
    nowhere = replace(motion, q=np.full_like(motion.q, np.nan))

    assert apart._repr_svg_() is None
    assert RSSP(crank=1.0, rod=0.5, guide=(0.0, 3.0, 0.0), axis=(1.0, 0.0, 0.0))._repr_svg_() is None
    assert nowhere._repr_svg_() is None
    assert "<svg" not in nowhere._repr_html_()


def test_a_plot_takes_the_pose_nearest_to_a_time(motion):
    assert motion.plot(motion.t[4] + 0.01).k == 4
    assert motion.plot().k == 0
    assert motion.plot(1e308).k == motion.plot(1e17).k == motion.t.size - 1
    assert "FourBar open, t = 0 s:" in repr(motion.plot())
    assert "FourBar open, 9 poses:" in repr(motion.animate(0.5))
    for wrong in (math.nan, math.inf):
        with pytest.raises(refkin.InvalidRequest, match="finite time"):
            motion.plot(wrong)


def test_a_linkage_is_plotted_in_the_pose_of_its_closed_form():
    linkage = refkin.FourBar(ground=4.0, crank=1.0, coupler=3.5, rocker=3.0, origin=(1.0, -2.0), angle=0.3)
    drawing = linkage.plot(1.2, "crossed").drawing
    at = {part.name: part.poses[:, 0] for part in drawing.parts}
    pose = linkage.assemble(1.2, "crossed")

    assert {name: at[name].tolist() for name in pose} == {name: list(q) for name, q in pose.items()}
    assert math.isfinite(linkage.plot().drawing.box.sum())


@pytest.mark.parametrize("rates", [["velocity"], ["velocity", "acceleration"]])
def test_every_arrow_lies_on_the_page(rates):
    """The pin of a low crank moves at right angles to it, far beyond where any part comes."""
    scene = refkin.SliderCrank(crank=1.0, rod=3.0).scene(samples=2, turns=0.05)
    drawing = Drawing(scene, refkin.solve(scene))
    root = ET.fromstring(still(drawing, 0, rates))
    tips = [path.attrib["d"].split("M")[1].split("L")[1].split() for path in root.findall(f"{SVG}path")]

    assert any(tip[1] > drawing.box[1][1] for arrow in drawing.arrows(0, "velocity") for tip in [arrow.points[:, 1]])
    assert all(0 <= float(x) <= float(root.attrib["width"]) for x, _ in tips)
    assert all(0 <= float(y) <= float(root.attrib["height"]) for _, y in tips)


def test_the_barbs_of_an_arrow_are_mirror_images_and_point_back(scene):
    paths = ET.fromstring(still(Drawing(scene, refkin.solve(scene)), 2, ["velocity"])).findall(f"{SVG}path")
    arrows = [path.attrib["d"].split("M")[1:] for path in paths if path.attrib["d"].count("M") == 3]
    assert arrows
    for lines in arrows:
        start, *tips = (complex(*map(float, line.split("L")[0].split())) for line in lines)
        tip, *barbs = (complex(*map(float, line.split("L")[1].split())) for line in lines)
        along = (start - tip) / abs(start - tip)

        assert tips == [tip, tip]
        turns = sorted(((barb - tip) / along for barb in barbs), key=lambda z: z.imag)
        assert turns == pytest.approx([8 * np.exp(-0.4j), 8 * np.exp(0.4j)], abs=0.05)


def test_a_guide_runs_along_its_axis_as_far_to_one_side_of_its_foot_as_to_the_other():
    linkage = refkin.SliderCrank(crank=1.0, rod=3.0, offset=0.25, angle=0.5)
    drawing = Drawing(scene := linkage.scene(samples=2, turns=0.05), refkin.solve(scene))
    (guide,) = (s.points for part in drawing.parts for s in part.shapes if s.role == "guide")
    way, axis = guide[:, 1] - guide[:, 0], np.array([np.cos(0.5), np.sin(0.5)])

    assert way == pytest.approx(3 * scene.mechanism.size() * axis)
    assert abs(guide.mean(axis=1) @ [-axis[1], axis[0]]) == pytest.approx(0.25)
    assert guide.mean(axis=1) @ axis == pytest.approx(0.0, abs=1e-12)


def test_a_guide_beside_its_point_lies_to_the_left_of_it():
    """As the row of its joint has it: a point on the left of an axis is at a positive offset."""
    element = GuidedPoint(
        body_i="ground", point_i=(1.0, 2.0), axis_i=(3.0, 4.0), body_j="disc", point_j=(0.0, 0.0), offset=0.5
    )
    (guide,) = _features(element, "ground", 1.0, np.zeros((2, 0)))

    assert guide.points.mean(axis=1) == pytest.approx([0.6, 2.3])


def test_a_motion_can_be_sent_to_another_process_and_is_the_same_there(motion):
    assert pickle.loads(pickle.dumps(motion)) == motion
    assert motion != replace(motion, qd=None)
    assert replace(motion, qd=None) != motion


def test_the_rows_of_a_body_are_shown_by_their_names(motion):
    assert repr(replace(motion, qd=None, qdd=None)["rocker"]) == "<BodyMotion: x, y, phi at 9 times>"


def test_completion_offers_what_is_imported_when_asked_for():
    assert set(refkin.__all__) <= set(dir(refkin))
