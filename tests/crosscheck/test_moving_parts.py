"""Pictures of the night: each joint point is drawn where the motion has it, arrows are rates, margins are kept."""

from __future__ import annotations

import cmath
import math
import re
from dataclasses import dataclass, replace
from functools import cache
from typing import Any

import numpy as np
import pytest

import refkin
from crosscheck.night.moving_parts import BEND, HEIGHT, MARGIN, VISIBLE, WIDTH, DrawnSample
from crosscheck.night.sections import drawing_of
from refkin.joints import (
    GROUND,
    AngleDriver,
    DisplacementDriver,
    Distance,
    Gear,
    GuidedPoint,
    Revolute,
    SpatialPrismatic,
    XDriver,
    YDriver,
)
from refkin.model import Body, Mechanism
from refkin.scenes.linkages import RSSR

AZIMUTH, ELEVATION = math.radians(-60.0), math.radians(25.0)
TENTHS = 0.4
"""Places and angles are rounded to tenths of a pixel and of a degree, arms are 200 pixels long at most."""
PLANE = refkin.FourBar(ground=4.0, crank=1.0, coupler=3.5, rocker=3.0, origin=(0.5, -0.25), angle=0.2)
SLIDER = refkin.SliderCrank(crank=1.0, rod=3.0, offset=0.25, origin=(0.5, -0.25), angle=0.4)
TALL = refkin.FourBar(ground=1.0, crank=3.0, coupler=2.5, rocker=2.8, angle=1.5)


@dataclass(frozen=True)
class Bent:
    """A four-bar whose coupler has its joint points beside the axes of its frame."""

    linkage: Any
    angle: float = 0.7

    def scene(self, **more: Any) -> Any:
        scene, turn = self.linkage.scene(**more), cmath.rect(1.0, -self.angle)
        m = scene.mechanism
        beside = lambda p: ((turn * complex(*p)).real, (turn * complex(*p)).imag)  # noqa: E731
        ends = [("point_i", j.point_i) if j.body_i == "coupler" else ("point_j", j.point_j) for j in m.joints]
        joints = [
            replace(j, **{end: beside(point)}) if "coupler" in (j.body_i, j.body_j) else j
            for j, (end, point) in zip(m.joints, ends, strict=True)
        ]
        x, y, phi = m.bodies[1].estimate
        bodies = (m.bodies[0], replace(m.bodies[1], estimate=(x, y, phi + self.angle)), m.bodies[2])
        return replace(scene, mechanism=replace(m, bodies=bodies, joints=tuple(joints)))


BENT = Bent(PLANE)
SPACE = [RSSR(1.0, 3.0, 2.0, (2.5, -0.5, 0.75), (0.25, 1.0, 0.125), massless=massless) for massless in (False, True)]


@cache
def solved(linkage: Any) -> Any:
    """Return a scene and its motion, with that of every joint point."""
    scene = linkage.scene(speed=1.0, samples=9)
    some = [(body, point) for body, of_body in held(scene.mechanism).items() for point in of_body if body != GROUND]
    points = tuple(refkin.Point(name=f"{body} {point}", body=body, position=point) for body, point in some)
    return scene, refkin.solve(replace(scene, points=points))


def held(mechanism: Any) -> dict[str, list[Any]]:
    """Return the joint points of each body, each once."""
    points: dict[str, list[Any]] = {}
    for joint in mechanism.joints:
        for body, point in joint.points():
            points.setdefault(body, []).append(tuple(point))
    return {body: list(dict.fromkeys(some)) for body, some in points.items()}


def where(motion: Any, body: str, point: Any, k: int) -> Any:
    """Return where a point of a body is at a time [m], seen from the place that pictures of space are seen from."""
    p = np.array(point) if body == GROUND else motion.points[f"{body} {point}"].r[:, k]
    if len(p) == 2:
        return p
    (c, s), (cos, sin) = ((math.cos(a), math.sin(a)) for a in (AZIMUTH, ELEVATION))
    return np.array([[-s, c, 0.0], [-c * sin, -s * sin, cos], [c * cos, s * cos, sin]]) @ p


def page(scene: Any, motion: Any) -> Any:
    """Return the function from metres to pixels that shows all joint points in the middle, as large as can be."""
    every = [where(motion, body, p, k) for body, some in held(scene.mechanism).items() for p in some for k in range(9)]
    low, high = np.min(every, axis=0), np.max(every, axis=0)
    scale = min((WIDTH - 2 * MARGIN) / (high - low)[0], (HEIGHT - 2 * MARGIN) / (high - low)[1])
    middle = (low + high) / 2

    def pixels(place: Any) -> Any:
        x, y = (place - middle)[:2] * scale
        return np.array([WIDTH / 2 + x, HEIGHT / 2 - y, *(place - middle)[2:] * scale])

    return pixels, scale, np.array(every) - middle


def guided(element: Any) -> bool:
    return isinstance(element, GuidedPoint) and element.body_i == GROUND


def guiding(joint: Any) -> bool:
    return any(guided(element) for element in joint.elements())


def turned(place: Any, pins: Any) -> Any:
    """Return where pins of a part are, which a `transform` of the page shifts and turns."""
    x, y, degrees = place
    c, s = math.cos(math.radians(degrees)), math.sin(math.radians(degrees))
    return np.array([[x + c * a - s * b, y + s * a + c * b] for a, b in pins])


@pytest.mark.parametrize("linkage", [PLANE, SLIDER, TALL, BENT], ids=["wide", "slider", "tall", "bent"])
def test_every_joint_point_is_drawn_where_the_motion_has_it(linkage: Any) -> None:
    scene, motion = solved(linkage)
    pixels, _, _ = page(scene, motion)
    points = held(scene.mechanism)
    picture = drawing_of(scene, motion).described("a", "b")

    assert len(picture["frames"]) == 9
    for k, frame in enumerate(picture["frames"]):
        for body, part, place in zip(motion.bodies, picture["parts"], frame, strict=True):
            wanted = [pixels(where(motion, body, point, k)) for point in points[body]]
            assert turned(place, part["pins"]) == pytest.approx(np.array(wanted), abs=TENTHS)
            assert (part["path"].count("L"), "z" in part["path"]) == ((1, False) if len(wanted) == 2 else (3, True))
    assert np.array(picture["ground"]) == pytest.approx(
        np.array([pixels(np.array(point)) for point in points[GROUND]]), abs=TENTHS
    )


def test_a_link_without_a_body_is_drawn_from_end_to_end() -> None:
    scene, _ = solved(PLANE)
    (base, tip, other, pivot), m = scene.mechanism.joints, scene.mechanism
    ends = {"body_i": "crank", "point_i": tip.point_i, "body_j": "rocker", "point_j": other.point_j}
    bare = replace(m, bodies=(m.bodies[0], m.bodies[2]), joints=(base, Distance(name="L", **ends, length=3.5), pivot))
    some = [("crank", tip.point_i), ("rocker", other.point_j)]
    points = [refkin.Point(name=f"{body} {point}", body=body, position=point) for body, point in some]
    scene = replace(scene, mechanism=bare, points=tuple(points))
    motion = refkin.solve(scene)
    picture = drawing_of(scene, motion)
    drawn = picture.described("a", "b")

    assert len(drawn["parts"]) == 3
    for k, frame in enumerate(drawn["frames"]):
        wanted = [picture.view.pixels(*where(motion, *pin, k)) for pin in some]
        assert turned(frame[2], drawn["parts"][2]["pins"]) == pytest.approx(np.array(wanted), abs=TENTHS)


def test_a_line_to_slide_along_goes_one_and_a_half_sizes_to_each_side_of_its_point() -> None:
    """Along whatever vector, of whatever length, the joint has it."""
    scene, motion = solved(SLIDER)
    joints = [replace(j, axis_i=tuple(2.0 * x for x in j.axis_i)) if guiding(j) else j for j in scene.mechanism.joints]
    scene = replace(scene, mechanism=replace(scene.mechanism, joints=tuple(joints)))
    (guide,) = (element for joint in scene.mechanism.joints for element in joint.elements() if guided(element))
    pixels, _, _ = page(scene, motion)
    along = np.array(guide.axis_i) / math.hypot(*guide.axis_i)
    foot = np.array(guide.point_i) + guide.offset * np.array([-along[1], along[0]])
    drawn = drawing_of(scene, motion).described("a", "b")["guide"].strip("M").split("L")
    ends = [pixels(foot + way * 1.5 * scene.mechanism.size() * along) for way in (-1, 1)]

    assert [[float(x) for x in end.split()] for end in drawn] == pytest.approx(np.array(ends), abs=TENTHS)


def test_wheels_are_circles_of_their_radius_and_lie_within_the_picture() -> None:
    """One that rolls on another, which stands still."""
    bodies = Body(name="carrier", estimate=(1.0, 2.0, 0.0)), Body(name="planet", estimate=(4.0, 2.0, 0.0))
    joints = (
        Revolute(name="O", body_i=GROUND, point_i=(1.0, 2.0), body_j="carrier", point_j=(0.0, 0.0)),
        Revolute(name="C", body_i="carrier", point_i=(3.0, 0.0), body_j="planet", point_j=(0.0, 0.0)),
        Gear(name="mesh", body_i=GROUND, body_j="planet", carrier="carrier", radius_i=2.0, radius_j=1.0),
    )
    turn = AngleDriver(name="d", body="carrier", law=refkin.Polynomial(coefficients=(0.0, 1.0)))
    scene = refkin.Scene(
        name="planet", mechanism=Mechanism(bodies, joints, (turn,)), times=tuple(np.linspace(0.0, 6.0, 49))
    )
    picture = drawing_of(scene, refkin.solve(scene))
    drawn = picture.described("a", "b")
    circle = r"M(\S+) (\S+)a(\S+) \3 0 0 0 (\S+) 0a\3 \3 0 0 0 -\4 0"
    (left, y, r, across), (start, level, small, _) = (
        map(float, re.fullmatch(circle, path).groups())  # type: ignore[union-attr]
        for path in (drawn["guide"], drawn["parts"][1]["guide"])
    )

    assert (left + r, y) == pytest.approx(picture.view.pixels(1.0, 2.0), abs=TENTHS)
    assert (start + small, level) == (0.0, 0.0)
    assert (r, across, small) == pytest.approx(np.array([2.0, 4.0, 1.0]) * picture.view.scale, abs=TENTHS)
    assert picture.view.scale == pytest.approx((HEIGHT - 2 * MARGIN) / 8.0, rel=0.01)  # the planet goes round outside


def test_the_block_of_a_body_that_one_point_holds_or_none_is_within_the_picture() -> None:
    """A crank alone was beyond it, as large as rounding is small; a body without a joint had no picture."""
    crank = Revolute(name="O", body_i=GROUND, point_i=(1.0, 2.0), body_j="b", point_j=(-0.5, 0.0))
    turn = AngleDriver(name="d", body="b", law=refkin.Polynomial(coefficients=(0.0, 1.0)))
    at = (XDriver(name="x", body="b", law=turn.law), YDriver(name="y", body="b", law=turn.law))
    for joints, drivers in (((crank,), (turn,)), ((), (*at, turn))):
        scene = refkin.Scene(mechanism=Mechanism((Body(name="b"),), joints, drivers), times=(0.0, 0.5, 1.0))
        picture = drawing_of(scene, refkin.solve(scene))
        drawn = picture.described("a", "b")
        corners = np.array(re.findall(r"[ML](\S+) (-?[0-9.]+)", drawn["parts"][0]["path"]), float)
        places = np.array([turned(frame[0], corners) for frame in drawn["frames"]])

        assert places.shape == (3, 4, 2)
        assert places.min() >= 0.0
        assert (np.array([WIDTH, HEIGHT]) - places).min() >= 0.0
        assert np.ptp(places[0], axis=0).max() > 10.0
        assert [picture.ghost(DrawnSample(0, 9.0, 1e-9 * np.ones((3, 3))), level) is None for level in range(3)] == [
            False
        ] * 3


@pytest.mark.parametrize("level", [1, 2])
def test_arrows_are_the_rates_of_the_joint_points_and_those_of_an_engine_with_its_error_magnified(level: int) -> None:
    """The error is 1e-9 of the coupler's shift and of the rocker's turn; an arrow of a pixel or less is none."""
    scene, motion = solved(PLANE)
    k, size, off = 3, scene.mechanism.size(), np.zeros((9, 9))
    off[3], off[8] = 1e-9, 1e-9
    mark = drawing_of(scene, motion).ghost(DrawnSample(k, 9.0, off), level)
    pixels, _, _ = page(scene, motion)
    assert mark is not None
    rows = []
    for body, point in [(name, point) for name in motion.bodies for point in held(scene.mechanism)[name]]:
        at, (x, y) = motion.points[f"{body} {point}"], where(motion, body, point, k) - motion[body].q[:2, k]
        error = {"coupler": (1e-9 * size, 0.0), "rocker": (-1e-9 * y, 1e-9 * x)}.get(body, (0.0, 0.0))
        rows.append((pixels(at.r[:, k]), (at.v, at.a)[level - 1][:, k], np.array(error)))
    tails, rates, errors = map(np.array, zip(*rows, strict=True))
    scale = 0.22 * HEIGHT / np.max(np.hypot(*rates.T))
    true, wrong = (scale * x * [1, -1] for x in (rates, rates + mark["factor"] * errors))
    shown = np.max(np.abs(np.hstack([true, wrong])), axis=1) > 1.0

    assert np.array(mark["arrows"]) == pytest.approx(np.hstack([tails, tails + true, tails + wrong])[shown], abs=TENTHS)
    assert 0 < sum(shown) < len(shown)
    largest = scale * mark["factor"] * np.max(np.hypot(*errors.T))
    assert 0.4 * 0.072 * WIDTH < largest <= 0.072 * WIDTH


@pytest.mark.parametrize("linkage", SPACE, ids=["with its coupler", "by distance"])
def test_every_bar_and_pin_of_space_is_drawn_from_where_it_is_seen(linkage: Any) -> None:
    scene, motion = solved(linkage)
    pixels, scale, away = page(scene, motion)
    points = held(scene.mechanism)
    picture = drawing_of(scene, motion).described("a", "b")
    bars = [((body, one), (body, other)) for body in motion.bodies for one, other in [points[body]]]
    if linkage.massless:
        bars += [tuple(joint.points()) for joint in scene.mechanism.joints if "distance" in joint.type]
    pins = [(body, point) for body in motion.bodies for point in points[body]]

    for k, frame in enumerate(picture["frames"]):
        assert len(frame) == len(picture["parts"]) == len(bars) + len(pins)
        for (one, other), (x, y, degrees, stretch, *depths) in zip(bars, frame, strict=False):
            first, last = (pixels(where(motion, *end, k)) for end in (one, other))
            there = turned((x, y, degrees), [(0.0, 0.0), (100.0 * stretch, 0.0)])
            ends = sorted(np.column_stack([there, depths]).tolist())
            assert np.array(ends) == pytest.approx(np.array(sorted([first.tolist(), last.tolist()])), abs=TENTHS)
        for pin, (x, y, _, stretch, depth) in zip(pins, frame[len(bars) :], strict=True):
            assert [x, y, depth] == pytest.approx(pixels(where(motion, *pin, k)), abs=TENTHS)
            assert stretch == 1.0
    furthest = picture["fit"] * scale * np.max(np.linalg.norm(away, axis=1))
    assert picture["fit"] == 1.0 or furthest == pytest.approx(HEIGHT / 2 - MARGIN / 2, abs=0.2)
    assert furthest <= HEIGHT / 2 - MARGIN / 2 + 0.2


def test_what_is_as_tall_as_its_picture_is_not_made_larger_to_be_turned() -> None:
    """A slide straight upwards in the picture: turned about its middle it would fill less than there is room for."""
    up = (-math.cos(AZIMUTH) * math.sin(ELEVATION), -math.sin(AZIMUTH) * math.sin(ELEVATION), math.cos(ELEVATION))
    across = (-math.sin(AZIMUTH), math.cos(AZIMUTH), 0.0)
    line: Any = {"axis_i": up, "zero_i": across, "axis_j": (0.0, 0.0, 1.0), "zero_j": (1.0, 0.0, 0.0)}
    at: Any = {"body_i": GROUND, "point_i": (0.0, 0.0, 0.0), "body_j": "slider", "point_j": (0.0, 0.0, 0.0)}
    slide = SpatialPrismatic(name="P", **at, **line)
    lift = DisplacementDriver(name="lift", joint="P", law=refkin.Polynomial(coefficients=(0.5, 1.0))).among([slide])
    scene = refkin.Scene(mechanism=refkin.Mechanism((refkin.Body(name="slider"),), (slide,), (lift,)), times=(0.0, 1.0))
    picture = drawing_of(scene, refkin.solve(scene)).described("a", "b")
    (start, end), (ground,) = (frame[0][:2] for frame in picture["frames"]), picture["ground"]

    assert picture["fit"] == 1.0
    assert abs(end[1] - ground[1]) == pytest.approx(HEIGHT - 2 * MARGIN, abs=TENTHS)
    assert abs(start[1] - ground[1]) == pytest.approx((HEIGHT - 2 * MARGIN) / 3, abs=TENTHS)


@pytest.mark.parametrize("entry", [3, 4], ids=["to the right", "upwards"])
def test_in_the_plane_a_shift_of_less_than_a_rounding_is_magnified_as_well(entry: int) -> None:
    scene, motion = solved(PLANE)
    off = np.zeros((9, 9))
    off[entry] = 1e-20
    mark = drawing_of(scene, motion).ghost(DrawnSample(3, 9.0, off), 0)
    assert mark is not None

    limit = VISIBLE * WIDTH / (page(scene, motion)[1] * scene.mechanism.size() * 1e-20)
    assert limit / 2.51 < mark["factor"] <= limit


@pytest.mark.parametrize(("linkage", "lengths"), [(PLANE, 2), (SPACE[0], 3)], ids=["plane", "space"])
def test_an_error_moves_points_by_its_shift_or_by_its_turn_and_their_distance(linkage: Any, lengths: int) -> None:
    """In space by the largest distance of all, and by twice what Euler parameters are off."""
    scene, motion = solved(linkage)
    picture, points = drawing_of(scene, motion), held(scene.mechanism)
    arms = np.array([max(math.hypot(*point) for point in points[body]) for body in motion.bodies])
    of_turn = arms if lengths == 2 else np.full(3, 2.0 * arms.max())
    moved = np.hstack([np.ones((3, lengths)), np.tile(of_turn[:, None], (1, len(motion.q) // 3 - lengths))])

    for off, wanted in zip(1e-20 * np.eye(len(motion.q)), moved.ravel(), strict=True):
        assert picture._moved(motion.q[:, 3], off) == pytest.approx(
            picture.view.scale * 1e-20 * wanted, rel=1e-12, abs=0.0
        )


@pytest.mark.parametrize("entry", [1, 4], ids=["shifted", "turned"])
def test_in_space_an_error_is_magnified_as_far_as_it_stays_a_small_one_that_can_be_seen(entry: int) -> None:
    """The shift of the coupler, or a part of its Euler parameters: half of what it turns by."""
    scene, motion = solved(SPACE[0])
    k, off = 3, np.zeros((21, 9))
    off[7 + entry] = 1e-9
    mark = drawing_of(scene, motion).ghost(DrawnSample(k, 9.0, off), 0)
    assert mark is not None
    assert mark["cycle"] is not None
    _, scale, _ = page(scene, motion)
    factor, size = mark["factor"], scene.mechanism.size()
    longest = max(np.linalg.norm(p) for body, some in held(scene.mechanism).items() if body != GROUND for p in some)
    moved = scale * 1e-9 * (size if entry < 3 else 2.0 * longest)
    limit = min(VISIBLE * WIDTH / moved, math.inf if entry < 3 else BEND / 2e-9)

    assert limit / 2.51 < factor <= limit
    assert mark["cycle"]["factor"] == pytest.approx(factor)
    assert mark["ghost"] != mark["pose"]
    of_coupler = {n for n, (one, other) in enumerate(zip(mark["pose"], mark["ghost"], strict=True)) if one != other}
    assert 1 in of_coupler  # its bar, which is as long as it was
    pose, ghost = ([100.0 * bar[3], bar[5] - bar[4]] for bar in (mark["pose"][1], mark["ghost"][1]))
    assert math.hypot(*ghost) == pytest.approx(math.hypot(*pose), abs=TENTHS)
    assert len(of_coupler) <= 3  # and its two pins
