"""Faults planted in one engine's adapter of space show at the level where they are wrong, and not before it."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from typing import Any, NamedTuple

import numpy as np
import pytest

import refkin
from crosscheck.engines.loading import load
from crosscheck.judge.uncompared import put_together_wrongly
from crosscheck.measure.check import check
from refkin.solving import starts
from tests.linkages import with_estimates
from tests.mutation.change import mutated
from tests.places import CORPUS

from . import space_scenes

LEVELS = ("residual", "jacobian", "constraint_velocity", "drift", "position", "velocity", "acceleration")


def wrong_at(engine: str, scene: Any) -> set[str]:
    record = check(scene, [engine])
    return {item.quantity for item in record.disagreements if item.method != "shipped"}


class Fault(NamedTuple):
    """A passage of an adapter with a fault in it, the engine whose answer shows it, at which levels, and where not."""

    target: str
    old: str
    new: str
    engine: str
    shows: set[str]
    sound: set[str]
    make: Callable[[], Any] = space_scenes.rssr


ALL, ROWS, SOLVED, LATER = set(LEVELS), set(LEVELS[:4]), set(LEVELS[4:]), {"velocity", "acceleration"}
JACK, SHAFTS = space_scenes.screw_jack, space_scenes.double_hooke
FAULTS = {
    "Pinocchio is handed Euler parameters as they are, where it wants the scalar last": Fault(
        "pinocchio.space:PinocchioSpace.coordinates", ".take([1, 2, 3, 0], -1)", "", "pinocchio", {"residual"}, set(),
    ),
    "rates of balls by E^T for E": Fault(
        "spatial.tree:SpaceTree.rates", "body_columns(q[..., ball])",
        "body_columns(q[..., ball] * [1, -1, -1, -1]) * [-1, 1, 1, 1]", "mujoco", {"constraint_velocity"},
        {"residual", "jacobian"},
    ),
    "p'' without |w|^2 p / 4": Fault(
        "spatial.motion:coordinates", "bends(p, w[0], w[1])", "rates(p, w[1])", "mujoco", {"acceleration"},
        ALL - {"acceleration"},
    ),
    "the weld's rows are taken for the half-angle rows themselves": Fault(
        "spatial.motion:_maps", "factor=factor", "factor=2.0 * factor", "mujoco", {"residual", "jacobian"}, SOLVED,
    ),
    "f and h of every joint frame change places": Fault(
        "spatial.reading:_hold", "joint_frame(axis, zero)", "joint_frame(axis, zero)[:, [2, 1, 0]] * [1.0, -1.0, 1.0]",
        "exudyn", {"residual"}, set(),
    ),
    "the rate of a driven angle is left out": Fault(
        "exudyn.space:ExudynSpace.law_rates", "return out", "return 0.0 * out", "exudyn",
        {"constraint_velocity", "velocity"}, {"residual", "jacobian", "position"},
    ),
    "drift terms of axes without the term of both rates": Fault(
        "exudyn.space:ExudynSpace._bend", "product(turned,", "product((turned[0], 0.0 * turned[1], turned[2]),",
        "exudyn", {"drift"}, ALL - {"drift", "acceleration"},
    ),
    "exudyn's columns of Euler parameters are projected with the wrong sign of e~": Fault(
        "exudyn.space:ExudynSpace.jacobian", "common_columns(q)",
        "((s := np.tile([1, 1, 1, 1, -1, -1, -1], len(q) // 7))[:, None] * common_columns(s * q))", "exudyn",
        {"jacobian"}, {"residual", "constraint_velocity"},
    ),
    "MuJoCo's connect reads body i minus body j": Fault(
        "mujoco.space:MujocoSpace._equality", 'f"{name} j", f"{name} i"', 'f"{name} i", f"{name} j"', "mujoco",
        {"residual", "jacobian"}, {"position", "velocity"},
    ),
    "MuJoCo's hinges turn left-handed": Fault(
        "mujoco.space:MujocoSpace._hang", "JOINTS[edge.kind]",
        "{**JOINTS, 'revolute': [(HINGE, [0.0, 0.0, -1.0])]}[edge.kind]", "mujoco", {"position"}, ROWS,
    ),
    "Pinocchio is told metres for a whole turn, where it wants them for a radian": Fault(
        "pinocchio.space:_joints", "(z, edge.pitch)", "(z, 2.0 * np.pi * edge.pitch)", "pinocchio", {"position"}, ROWS,
        JACK,
    ),
    "the slide of MuJoCo's screw moves half as fast as its hinge says, but stands where it should": Fault(
        "mujoco.space:MujocoSpace._columns", "[edge.pitch * own", "[0.5 * edge.pitch * own", "mujoco", {"velocity"},
        ROWS | {"position"}, JACK,
    ),
    "angular velocities of the ground frame are taken for those in the body's own axes": Fault(
        "spatial.motion:coordinates", "rates(p, w[0])", "rates(p * [1, -1, -1, -1], -w[0]) * [1, -1, -1, -1]", "mujoco",
        LATER, ROWS | {"position"},
    ),
    "Pinocchio's columns of a free body are taken for those of the ground frame": Fault(
        "spatial.motion:SpaceRows._to_body", "matrix(pose[3:]).T", "np.eye(3)", "pinocchio", {"jacobian"},
        SOLVED | {"residual", "constraint_velocity"},
    ),
    "joints of MuJoCo's tree lie at body j's place on body i, and the other way round": Fault(
        "spatial.tree:_edge", "(u_parent, frame_parent), (u_body, frame_body) =",
        "(u_body, frame_parent), (u_parent, frame_body) =", "mujoco", {"position"}, ROWS,
    ),
    "Pinocchio's spatial accelerations stand for those of points: omega x v is missing": Fault(
        "pinocchio.space:PinocchioSpace.moving", "getFrameClassicalAcceleration", "getFrameAcceleration", "pinocchio",
        {"drift", "acceleration"}, ROWS - {"drift"} | {"velocity"},
    ),
    "the adapter's rows of a universal joint that closes a loop drift without the term of both rates": Fault(
        "spatial.system:_product", "+ 2.0 * _dots(a[1], b[1])", "", "mujoco", {"acceleration"},
        ROWS | {"position", "velocity"}, SHAFTS,
    ),
    "the third rotation of a slide's weld is said to be one of the rows of its displacements": Fault(
        "spatial.motion:_maps", "row=hold.rows[at]",
        "row=2 if hold.rows[at] == 4 and hold.name == 'P' else hold.rows[at]", "mujoco", {"status"}, ALL,
        space_scenes.rssp,
    ),
}  # fmt: skip


@pytest.mark.parametrize("name", FAULTS)
def test_a_fault_planted_in_one_adapter_shows_at_its_level(name: str) -> None:
    fault = FAULTS[name]
    scene = replace(fault.make(), times=space_scenes.TIMES[:4])
    assert wrong_at(fault.engine, scene) == set()
    with mutated(f"crosscheck.engines.{fault.target}", fault.old, fault.new):
        places = wrong_at(fault.engine, scene)
    assert fault.shows <= places or (places == {"status"} and fault.shows == {"position"})  # a loop that closes no more
    assert not fault.sound & places


def test_a_reference_with_joints_the_wrong_way_round_is_blamed_for_them(monkeypatch: pytest.MonkeyPatch) -> None:
    scene = refkin.load(CORPUS / "space-dot-flipped.toml")
    assert [item for item in check(scene, []).disagreements if item.engine == "refkin"] == []
    monkeypatch.setattr(starts, "_meant", lambda given: given)  # rows with false roots, begun at one of these
    blamed = [item.message for item in check(scene, []).disagreements if item.engine == "refkin"]
    assert blamed
    assert all("joint put together the wrong way round" in message for message in blamed)


def test_no_flipped_joint_passes_unseen() -> None:
    """From random starts exudyn's shipped solver reports success on reversed axes; its static route takes none."""
    draw = np.random.default_rng(5)
    scene = replace(space_scenes.rssr_by_distance(), times=(0.0,))
    flipped: dict[tuple[str, str], int] = {}
    for _ in range(24):
        turns = draw.normal(size=(2, 4))
        estimates = iter([(*draw.uniform(-1.0, 1.0, 3), *(p / np.linalg.norm(p))) for p in turns])
        asked = with_estimates(scene, lambda b, at=estimates: tuple(map(float, next(at))))
        for engine in map(load, ("exudyn", "pinocchio", "mujoco")):
            for route in engine.routes():
                wrong, _ = put_together_wrongly(asked, engine.solve(asked, route))
                flipped[engine.name, route.name] = flipped.get((engine.name, route.name), 0) + bool(wrong)
    assert flipped.pop(("exudyn", "shipped")) > 4
    assert set(flipped.values()) == {0}
