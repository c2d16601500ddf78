"""Points that a scene wants are compared: what an engine says of them, not only what it says of their bodies."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

import crosscheck
import refkin
from crosscheck import engines
from crosscheck.engines import EngineRefusal
from crosscheck.engines.loading import load
from crosscheck.engines.methods import Use, methods
from crosscheck.measure.check import check
from crosscheck.scenes.drawing import POINTED, draw
from refkin.motion import PointMotion
from tests.linkages import ROCKER

from . import space_scenes

ALL = ("exudyn", "pinocchio", "mujoco", "closed_form", "vector_loop", "refkin-batch")
PLANE = replace(
    ROCKER.scene(speed=2.0, turns=0.5, samples=7, branch="open"),
    points=(
        refkin.Point(name="P", body="coupler", position=(0.3, -1.4)),
        refkin.Point(name="Q", body="crank", position=(-2.0, 0.25)),
    ),
)
SPACE = replace(
    space_scenes.rssr_by_distance(),
    times=space_scenes.TIMES[:4],
    points=(refkin.Point(name="P", body="rocker", position=(0.3, -0.4, 0.5)),),
)
SPINNING = replace(
    space_scenes.rssr(),
    times=space_scenes.TIMES[:4],
    points=(refkin.Point(name="P", body="coupler", position=(0.3, -0.4, 0.5)),),
)
"""The point is on a rod between two balls."""


def faults(scene, names=ALL):
    record = check(scene, [load(name) for name in names], {"of_features": True})
    return record, [fault for fault in record.disagreements if "point" in fault.message]


@pytest.mark.parametrize("scene", [PLANE, SPACE, SPINNING], ids=["plane", "space", "spinning"])
def test_every_method_says_how_points_move_and_is_right(scene):
    record, wrong = faults(scene)

    assert len(record.answers) >= (11 if scene is PLANE else 5)
    assert wrong == []
    assert not any("no motion of points" in row.reason for row in record.refusals)


def planted(monkeypatch, change):
    real = engines.engine_motion

    def changed(*given, **more):
        points = {name: change(point) for name, point in more.get("points", {}).items()}
        return real(*given, **{**more, "points": {name: point for name, point in points.items() if point}})

    monkeypatch.setattr(engines, "engine_motion", changed)


PLANTS = {
    "position": lambda p: PointMotion(p.r + 1e-12, p.v, p.a),
    "velocity": lambda p: PointMotion(p.r, -p.v, p.a),
    "acceleration": lambda p: PointMotion(p.r, p.v, p.a * (1.0 + 1e-9)),
}


@pytest.mark.parametrize("scene", [PLANE, SPACE, SPINNING], ids=["plane", "space", "spinning"])
@pytest.mark.parametrize("quantity", PLANTS)
def test_a_point_that_moves_otherwise_than_its_body_is_seen_in_its_quantity(scene, quantity, monkeypatch):
    planted(monkeypatch, PLANTS[quantity])
    _, wrong = faults(scene, ("exudyn", "pinocchio", "mujoco"))

    assert {fault.quantity for fault in wrong} == {quantity}
    assert {fault.engine for fault in wrong if "'P'" in fault.message} == {"exudyn", "pinocchio", "mujoco"}
    assert all("times the allowed" in fault.message for fault in wrong)


def test_who_gives_no_points_is_named_and_who_gives_some_owes_the_others(monkeypatch):
    planted(monkeypatch, lambda point: None)
    record, wrong = faults(PLANE, ("pinocchio",))
    said = "pinocchio (joint tree) gives no motion of points: they are not compared"
    assert wrong == []
    assert said in [row.reason for row in record.refusals]

    monkeypatch.undo()
    places = iter(range(1000))
    planted(monkeypatch, lambda point: point if next(places) % 2 else None)
    _, wrong = faults(PLANE, ("mujoco",))
    assert {(str(fault.kind), fault.message[:9]) for fault in wrong} == {("not delivered", "point 'P'")}


def test_a_point_without_the_rates_that_are_asked_for_is_not_delivered(monkeypatch):
    planted(monkeypatch, lambda point: PointMotion(point.r, None, point.a[:, :3]))
    _, wrong = faults(PLANE, ("pinocchio",))

    assert {fault.quantity for fault in wrong} == {"velocity", "acceleration"}
    assert {str(fault.kind) for fault in wrong} == {"not delivered"}


def test_what_is_allowed_grows_with_the_arm_and_bounds_what_is_seen():
    """On an arm a hundred times as long a point may be off by forty times as much: 2.6e-12 for 6.2e-14."""
    far = replace(PLANE, points=(refkin.Point(name="P", body="coupler", position=(30.0, -140.0)),))
    for scene, off in ((PLANE, 1e-13), (far, 1e-11)):
        motion = refkin.solve(scene)
        points = {name: replace(point, r=point.r + off) for name, point in motion.points.items()}
        with pytest.raises(AssertionError, match=r"position: beyond the allowed error: point 'P' is off by 1e-1"):
            crosscheck.assert_agrees(replace(motion, points=points), scene)
        points = {name: replace(point, r=point.r + off / 300.0) for name, point in motion.points.items()}
        crosscheck.assert_agrees(replace(motion, points=points), scene)


@pytest.mark.parametrize("scene", [PLANE, SPACE], ids=["plane", "space"])
@pytest.mark.parametrize("name", ALL)
def test_points_of_every_method_are_the_references(name, scene):
    truth, answered = refkin.solve(scene).points, []
    for method in methods(load(name)):
        if not method.uses & {Use.COMPARE, Use.FEATURE}:
            continue
        try:
            points = method.solve(scene).points
        except EngineRefusal:
            assert scene is SPACE
            continue
        answered.append(method)
        loose = 1e-5 if method.called in ("shipped", "closed-chain example", "mj_step") else 1e-12
        for point in truth:
            for letter in ("r", "v", "a")[: 3 if method.called != "initial accelerations" else 2]:
                own, true = (getattr(where[point], letter) for where in (points, truth))
                if letter == "r" or own is not None:
                    assert np.max(np.abs(own - true)) < loose * (1.0 + np.max(np.abs(true)))
    assert bool(answered) is (scene is PLANE or name != "vector_loop")


@pytest.mark.parametrize("place", POINTED)
def test_a_night_draws_scenes_that_want_a_point(place):
    drawn = [draw(7, place + 28 * k).scene for k in range(4)]

    assert all(len(scene.points) == 1 for scene in drawn)
    assert all(scene.points[0].body in [body.name for body in scene.mechanism.bodies] for scene in drawn)


@pytest.mark.parametrize("law", [(0.3, 0.0, 1.0), (0.3,)])
def test_a_time_at_rest_hides_no_other(law, monkeypatch):
    """Where nothing moves nothing is allowed: 0 / 0 is no ratio, and a number there is beyond all bounds."""
    crank = refkin.Mechanism(
        [refkin.Body(name="crank", estimate=[0.0, 0.0, 0.3])],
        [refkin.Revolute(name="A", body_i="ground", point_i=[0.0, 0.0], body_j="crank", point_j=[0.0, 0.0])],
        [refkin.AngleDriver(name="motor", body="crank", law=refkin.Polynomial(coefficients=law))],
    )
    still = refkin.Scene(
        mechanism=crank, times=[0.0, 0.1, 0.2], points=[refkin.Point(name="P", body="crank", position=[1.0, 0.0])]
    )
    assert faults(still, ("pinocchio",))[1] == []
    planted(monkeypatch, lambda p: PointMotion(p.r, p.v + np.array([0.0, 0.0, 5.0]), p.a))
    _, wrong = faults(still, ("pinocchio",))

    assert {fault.quantity for fault in wrong} == {"velocity"}


@pytest.mark.parametrize(
    "form", [np.ndarray.tolist, lambda r: r.astype(object), lambda r: r.astype(str), lambda r: [1, [2]]]
)
def test_a_point_that_is_no_array_of_floats_is_named_as_that(form, monkeypatch):
    planted(monkeypatch, lambda p: replace(p, v=form(p.v)))
    _, wrong = faults(PLANE, ("pinocchio",))
    said = {f"point {name!r}: expected an array of floats of shape (2, 7)" for name in "PQ"}

    assert {(fault.quantity, fault.kind) for fault in wrong} == {("velocity", "not delivered")}
    assert {fault.message for fault in wrong} == said
