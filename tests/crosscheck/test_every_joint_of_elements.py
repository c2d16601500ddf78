"""Joints of space of every combination of the elements that there are: solved, certified, and answered by all engines.

A body hangs on a driven crank by the joint, and on the ground by as many long rods as the joint leaves it freedoms.
"""

from __future__ import annotations

import importlib
import itertools
import math
import random
import tomllib
from dataclasses import dataclass, replace
from typing import Any, Literal

import numpy as np
import pytest

import refkin
from crosscheck.engines.loading import load
from crosscheck.engines.march import march
from crosscheck.engines.pinocchio.space import PinocchioSpace
from crosscheck.engines.spatial.motion import SpaceScene, estimates
from crosscheck.engines.spatial.reading import numbers_of
from crosscheck.engines.spatial.system import SpaceSystem
from crosscheck.engines.spatial.tree import absolute_tree
from crosscheck.engines.spatial.turning import about_z, joint_frame, parameters
from crosscheck.measure.check import check
from refkin import Body, Mechanism, Scene, Status, joints
from refkin.fast import attempt, sweep
from refkin.joints import AxesParallel, AxesPerpendicular, PointInPlane, PointOnAxis, PointsMeet, TurnAboutAxis
from refkin.motion_laws import Polynomial
from refkin.output.drawing import Drawing
from refkin.scenes import files, keys
from refkin.solving.mobility import count
from refkin.system import compile_system

ENGINES = ("exudyn", "mujoco", "pinocchio")


def rows_of(term: Any) -> int:
    return sum(t.rows for t in (term["half"] if isinstance(term, dict) else term,))


def formulas() -> dict[type[joints.Element], tuple[Any, ...]]:
    """Return the formulas of each element that joints have, as they stand in the joints."""
    found = {}
    for cls in joints.SPATIAL_JOINT_TYPES:
        terms, ends = list(cls.formulas), list(itertools.accumulate(map(rows_of, cls.formulas), initial=0))
        for k, element in enumerate(cls.consists_of):
            first = sum(e.rows for e in cls.consists_of[:k])
            own = tuple(t for t, at in zip(terms, ends, strict=False) if first <= at < first + element.rows)
            found[element] = own or found.get(element)
    return found


FORMULAS = formulas()
SCREW = {*joints.Screw.consists_of}


@dataclass(frozen=True, kw_only=True)
class Composed(joints.Screw):
    """What a joint of any elements has in a scene file; its elements and their formulas are those of a subclass."""

    length: float = 0.0
    angle = 0.0
    type: Literal["composed"] = "composed"  # type: ignore[assignment]

    @property
    def parameters(self) -> int:
        return int(joints.ScrewMotion in self.consists_of)


def joint_of(elements: Any) -> type[Composed]:
    """Return the joint of some elements, one after another; engines are handed copies, so that it needs a name."""
    name = "Of" + "".join(e.__name__ for e in elements)
    if name not in globals():
        more = {"consists_of": tuple(elements), "formulas": tuple(t for e in elements for t in FORMULAS[e])}
        globals()[name] = type(name, (Composed,), {"__module__": __name__, **more})
    return globals()[name]


def numbers(elements: Any) -> tuple[float, float, float, float] | None:
    """Return tilt and turn of the axes, shift along and way off the axis, such as elements ask for; None if none do."""
    tilt = 0.0 if AxesParallel in elements else math.pi / 2 if AxesPerpendicular in elements else 0.4
    along = 0.0 if {PointsMeet, PointInPlane} & {*elements} else 0.3
    off = 0.0 if {PointsMeet, PointOnAxis} & {*elements} else 0.4
    if {AxesParallel, AxesPerpendicular} <= {*elements} or (
        joints.SpatialPointDistance in elements and not along + off
    ):
        return None
    return tilt, 0.0 if TurnAboutAxis in elements else 0.5, along, off


CRANK = about_z(0.4)
POINT_I, AXIS_I, ZERO_I = (0.8, 0.1, 0.2), (0.2, -0.1, 1.0), (1.0, 0.3, 0.0)
POINT_J, AXIS_J, ZERO_J = (0.1, -0.2, 0.15), (0.1, 1.0, 0.3), (0.0, 0.2, 1.0)
X, Z, AT_0 = (1.0, 0.0, 0.0), (0.0, 0.0, 1.0), (0.0, 0.0, 0.0)
TIPS = ((0.9, 0.1, -0.2), (-0.3, 0.8, 0.3), (0.2, -0.4, 1.0))


def scene_of(
    elements: Any, driver: Any = None, cls: Any = None, turn: float | None = None, **more: Any
) -> Scene | None:
    """Return a scene with a joint of elements, which may be driven; None if there is nothing to drive, or no pose."""
    if (known := numbers(elements)) is None:
        return None
    tilt, by_default, along, off = known
    turn = by_default if turn is None else turn
    towards = about_z(0.7)
    swing = towards @ np.array([[1, 0, 0], [0, math.cos(tilt), -math.sin(tilt)], [0, math.sin(tilt), math.cos(tilt)]])
    frame_i, frame_j = CRANK @ joint_frame(AXIS_I, ZERO_I), joint_frame(AXIS_J, ZERO_J)
    turned = frame_i @ swing @ towards.T @ about_z(turn) @ frame_j.T
    place = CRANK @ POINT_I + frame_i @ [off, 0.0, along] - turned @ POINT_J
    sizes = {"length": math.hypot(off, along), "pitch": 0.35, "shift": along - 0.35 * turn}
    of_i = {"body_i": "crank", "point_i": POINT_I, "axis_i": AXIS_I, "zero_i": ZERO_I}
    of_j = {"body_j": "part", "point_j": POINT_J, "axis_j": AXIS_J, "zero_j": ZERO_J}
    joint = (cls or joint_of(elements))(**{"name": "P", **of_i, **of_j, **sizes, **more})
    hinge = refkin.SpatialRevolute(
        name="R", body_i="ground", point_i=AT_0, axis_i=Z, zero_i=X,
        body_j="crank", point_j=AT_0, axis_j=Z, zero_j=X,
    )  # fmt: skip
    drivers = [refkin.SpatialAngleDriver(name="motor", joint="R", law=Polynomial(coefficients=(0.4, 0.5, 0.2)))]
    if driver is not None:
        start = turn if driver is joints.SpatialAngleDriver else along
        drivers.append(driver(name="drive", joint="P", law=Polynomial(coefficients=(start, 0.3, 0.1))))
    poses = (0.0, 0.0, 0.0, *parameters(CRANK)), (*place, *parameters(turned))
    bodies = tuple(
        Body(name=name, estimate=tuple(np.round(pose, 2).tolist()))
        for name, pose in zip(("crank", "part"), poses, strict=True)
    )
    rods = [rod(f"D{n}{a}", tip, place + turned @ tip, np.eye(3)[a]) for n, tip in enumerate(TIPS) for a in range(3)]
    q = np.array([*poses[0], *poses[1], *[0.5 * turn] * joint.parameters])
    held = needed(Mechanism(bodies, (hinge, joint, *rods), tuple(drivers)), q)
    if held is None:
        return None
    mechanism = Mechanism(bodies, (hinge, *(rod for rod in rods if rod.name in held), joint), tuple(drivers))
    effects = frozenset({"velocity", "acceleration"})
    return Scene(mechanism=mechanism, times=(0.0, 0.1), effects=effects, name=named(elements))


def rod(name: str, tip: Any, place: Any, axis: Any) -> refkin.SpatialDistance:
    """Return a long rod from the ground to where a tip of the part is, nearly along an axis."""
    foot = (place + 2.5 * axis + 0.4 * np.roll(axis, 1)).tolist()
    ends = {"body_i": "ground", "point_i": tuple(foot), "body_j": "part", "point_j": tip}
    return refkin.SpatialDistance(name=name, **ends, length=math.hypot(2.5, 0.4))


def needed(mechanism: Mechanism, q: Any) -> list[str] | None:
    """Return which rods hold what is free, those first that hold most; None if a driver has nothing to move."""
    system = compile_system(mechanism)
    assert np.abs(system.phi(q, 0.0)).max() < 1e-14
    slope = np.asarray(system.phi_q(q, 0.0), float)
    own = {p.constraint.name: slope[p.row : p.row + p.constraint.rows] for p in system.placed}
    rods = {name: own.pop(name) for name in list(own) if name[0] == "D"}
    drives = own.pop("drive", np.zeros((0, system.n)))
    _, sizes, rest = np.linalg.svd(np.concatenate([*own.values()]))
    free, chosen = rest[int(np.sum(sizes > 1e-9)) :], list[str]()
    if len(drives) and np.linalg.norm(free @ drives[0]) < 1e-9:
        return None
    held = drives
    while True:
        free = np.linalg.svd(held @ free.T)[2][len(held) :] @ free
        if not len(free):
            return chosen
        chosen.append(max(sorted(rods.keys() - {*chosen}), key=lambda name: np.linalg.norm(free @ rods[name][0])))
        held = rods[chosen[-1]]


COMBINATIONS = [
    elements
    for n in range(1, len(FORMULAS) + 1)
    for elements in itertools.combinations(FORMULAS, n)
    if numbers(elements) is not None
]


def named(elements: Any) -> str:
    return "+".join(e.__name__ for e in elements)


def refusing(elements: Any, driver: Any = None) -> set[str]:
    """Return which engines have no means for a joint of these elements."""
    twisted = AxesParallel not in elements and (TurnAboutAxis in elements or driver is joints.SpatialAngleDriver)
    return {"exudyn"} if joints.ScrewMotion in elements or twisted else set()


def assert_answered(scene: Scene, refused: set[str]) -> None:
    record = check(scene, ENGINES)

    assert record.reference.verdict == Status.OK
    assert [str(seen) for seen in record.disagreements] == []
    assert {answer.engine for answer in record.answers} == {*ENGINES} - refused
    assert {answer.compared for answer in record.answers} == {len(scene.times)}
    assert {seen.engine for seen in record.refusals if seen.level in ("", "solve")} == refused


@pytest.mark.parametrize("elements", COMBINATIONS, ids=named)
def test_a_joint_of_any_known_elements_is_solved_and_answered_by_every_engine_that_has_them(elements):
    scene = scene_of(elements)

    assert_answered(scene, refusing(elements))


def read(elements: Any) -> list[dict[str, Any]]:
    """Return what engines read of a joint, and of which of its elements each row is."""
    mechanism = scene_of(elements).mechanism
    rows = [(e.kind, k) for e in mechanism.joints[-1].placed_elements for k in range(e.rows)]
    own = [vars(hold) for hold in numbers_of(mechanism).holds if hold.name == "P"]
    held = [{key: np.array(x).tolist() for key, x in hold.items()} for hold in own]
    return [hold | {"rows": [rows[k] for k in hold["rows"]]} for hold in held]


def test_the_order_of_elements_is_nothing_to_an_engine():
    for elements in COMBINATIONS:
        parts = read(elements)

        assert sum(len(part["rows"]) for part in parts) == sum(e.rows for e in elements)
        assert read(elements[::-1]) == parts
        assert len(parts) == 1 or {*elements} not in [{*joint.consists_of} for joint in joints.SPATIAL_JOINT_TYPES]


DRAWN = random.Random(20).sample(COMBINATIONS, 10)


@pytest.mark.parametrize("elements", [random.Random(k).sample(e, len(e)) for k, e in enumerate(DRAWN)], ids=named)
def test_a_drawn_joint_in_a_drawn_order_does_the_same_and_is_fast_drawn_and_read_from_files(elements, monkeypatch):
    scene = scene_of(elements)
    assert_answered(scene, refusing(elements))

    motion, rods = refkin.solve(scene), len(scene.mechanism.joints) - 2
    own = int(joints.ScrewMotion in elements)
    assert count(scene.mechanism).mobility == 12 - 5 - sum(e.rows for e in elements) + own - rods
    assert np.max(motion.certified_radius.position) < 1e-12
    system = refkin.compile_system(scene.mechanism)
    fast = attempt if system.m == system.n else sweep  # redundant rows are left to the reference at few times
    assert np.allclose(fast(replace(scene, evidence=frozenset())).q, motion.q, rtol=0, atol=1e-13)
    assert Drawing(scene, motion).parts
    monkeypatch.setattr("refkin.joints.SPATIAL_JOINT_TYPES", (*joints.SPATIAL_JOINT_TYPES, joint_of(elements)))
    importlib.reload(keys)
    assert files.parse(tomllib.loads(files.to_toml(scene))) == scene
    monkeypatch.undo()
    importlib.reload(keys)


FEW = [
    (elements, driver)
    for elements in COMBINATIONS
    if len(elements) < 3
    for driver in (joints.SpatialAngleDriver, joints.DisplacementDriver)
]
DRIVEN = [(elements, driver) for elements, driver in FEW if scene_of(elements, driver) is not None]


@pytest.mark.parametrize(("elements", "driver"), DRIVEN, ids=lambda x: x.__name__ if isinstance(x, type) else named(x))
def test_a_driver_moves_a_joint_of_any_two_elements(elements, driver):
    assert_answered(scene_of(elements[::-1], driver), refusing(elements, driver))


@pytest.mark.parametrize("elements", [e for e in COMBINATIONS if len(e) < 3 or len(e) == len(SCREW & {*e})], ids=named)
def test_a_tree_closes_by_rows_what_may_be_an_edge_of_it(elements):
    scene = scene_of(elements)
    numbers = numbers_of(scene.mechanism)
    free = replace(absolute_tree(numbers), estimates=estimates(scene, numbers))
    answer = load("pinocchio").solve(scene)
    closed = SpaceScene(scene, numbers, SpaceSystem(free, PinocchioSpace))
    own = closed.motion(march(closed.system, closed.start(), scene.times, 2), answer.producer)

    for level, expected in zip(own.levels, answer.levels, strict=True):
        assert np.allclose(level, expected, rtol=0, atol=1e-12)


@dataclass(frozen=True, kw_only=True)
class Unheard(joints.Element):
    """An element that nobody knows: it says what `AxesPerpendicular` says."""

    kind = "unheard of"
    body_i: str
    body_j: str


@pytest.mark.parametrize("elements", [(PointsMeet, Unheard), (Unheard, TurnAboutAxis), ()], ids=named)
def test_the_judge_refuses_no_element_and_engines_name_what_they_have_not(elements, monkeypatch):
    monkeypatch.setitem(FORMULAS, Unheard, FORMULAS[AxesPerpendicular])
    known = [AxesPerpendicular if e is Unheard else e for e in elements] or [PointsMeet, AxesPerpendicular]
    joint = type("Odd", (joint_of(known),), {"consists_of": elements, "__module__": __name__})
    monkeypatch.setitem(globals(), "Odd", joint)
    scene = scene_of(known, cls=joint)
    alone, record = check(scene, ()), check(scene, ENGINES)

    assert alone.reference.verdict == record.reference.verdict == Status.OK
    assert [str(seen) for seen in record.disagreements] == []
    assert {(seen.engine, seen.name) for seen in record.refusals} >= {(engine, "P") for engine in ENGINES}
    assert all(("unheard of" if elements else "no elements") in seen.reason for seen in record.refusals[:1])


@dataclass(frozen=True, kw_only=True)
class Slanted(Composed):
    """A slide turned by an angle, which its element has, and the zero of its formulas."""

    consists_of = (AxesParallel, PointOnAxis, TurnAboutAxis)
    formulas = tuple(t for e in consists_of for t in FORMULAS[e])

    def elements(self) -> Any:
        for e in super().elements():
            yield replace(e, zero_i=ZERO_I, angle=0.25) if isinstance(e, TurnAboutAxis) else e


def test_the_angle_of_a_turn_counts():
    f, _, _ = (joint_frame(AXIS_I, ZERO_I) @ about_z(0.25)).T
    scene = scene_of(Slanted.consists_of, cls=Slanted, turn=0.25, zero_i=tuple(f.tolist()))

    assert_answered(scene, set())


@dataclass(frozen=True, kw_only=True)
class Motor(Composed):
    """A cylinder that turns by a law of its own."""

    law: Any
    law_is_angle = True
    consists_of = (PointOnAxis, TurnAboutAxis, AxesParallel)
    formulas = (*FORMULAS[PointOnAxis], *joints.spatial_drivers.TurnDriver.formulas, *FORMULAS[AxesParallel])

    @property
    def laws(self) -> Any:
        return (self.law,)

    @property
    def law_keys(self) -> tuple[str, ...]:
        return ("law",)

    def elements(self) -> Any:
        yield from (e if isinstance(e, TurnAboutAxis) else replace(e, laws=()) for e in super().elements())


def test_a_joint_may_have_a_driver_among_its_elements():
    law = Polynomial(coefficients=(0.5, 0.3, 0.1))

    assert_answered(scene_of(Motor.consists_of, cls=Motor, turn=0.5, law=law), set())
