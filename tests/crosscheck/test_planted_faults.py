"""Faults planted in production code: each is caught, and blamed on whom it is in and on the quantity it spoils."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
import pytest

import refkin.solving.solve
from crosscheck.engines import poses
from crosscheck.engines.closed_form import assemble, linkage
from crosscheck.engines.exudyn import engine as exudyn_engine
from crosscheck.engines.exudyn import model as exudyn_model
from crosscheck.engines.exudyn import parts as exudyn_parts
from crosscheck.engines.exudyn import readings as exudyn_readings
from crosscheck.engines.frames import Linear
from crosscheck.engines.mujoco import engine as mujoco_engine
from crosscheck.engines.mujoco import rows as mujoco_rows
from crosscheck.engines.pinocchio import engine as pin_engine
from crosscheck.engines.tree import tree_system
from crosscheck.measure.check import check
from refkin import FourBar, InvertedSliderCrank, Sinusoid, SliderCrank, Table
from refkin.joints import AngleDriver, Distance, PointOnLine, Revolute, planar
from refkin.model import Mechanism, Scene
from refkin.motion import Status
from refkin.motion_laws import Integral
from refkin.proof.assembly.assembly import assemblies
from refkin.solving.starts import Start
from refkin.vec import Vec

PEERS = ("closed_form", "exudyn", "pinocchio", "mujoco")
BY_TREE = ("pinocchio", "mujoco")
KEEPING = (*BY_TREE, "exudyn")
"""The engines whose loops the adapters' own Newton closes."""
TIMES = tuple(float(t) for t in np.linspace(0.0, 2.0, 9))
LAW = Sinusoid(offset=1.0, amplitude=0.8, angular_frequency=1.3, phase=0.4)
"""Neither its rate nor its acceleration vanishes at any of the times."""

FOUR_BAR = FourBar(ground=4.0, crank=1.0, coupler=3.5, rocker=3.0).scene(law=LAW, times=TIMES)
SLIDER = SliderCrank(crank=1.0, rod=3.0, offset=0.4).scene(law=LAW, times=TIMES)
INVERTED = InvertedSliderCrank(ground=3.0, crank=1.0, offset=0.3).scene(law=LAW, times=TIMES)


def massless_coupler() -> Scene:
    """Return the four-bar whose coupler is a distance."""
    m = FOUR_BAR.mechanism
    by_name = {joint.name: joint for joint in m.joints}
    ends = {"body_i": "crank", "point_i": by_name["A"].point_i, "body_j": "rocker", "point_j": by_name["B"].point_j}
    rod = Distance(name="rod", **ends, length=3.5)
    bodies = tuple(body for body in m.bodies if body.name != "coupler")
    return replace(FOUR_BAR, mechanism=Mechanism(bodies, (by_name["A0"], by_name["B0"], rod), m.drivers))


ROD = massless_coupler()


BEFORE = {"velocity": ("position",), "acceleration": ("position", "velocity")}
BEFORE |= dict.fromkeys(("residual", "jacobian"), ("position",))


@dataclass(frozen=True)
class Fault:
    """A fault, the scene on which it is planted, and what must be found.

    Attributes
    ----------
    plant : callable
        Takes monkeypatch and replaces production code.
    engines : str, or tuple of str
        Who must disagree, and nobody else. A fault in the reference itself has everybody disagree.
    quantity : str
        What must disagree, for each of them by each of its routes; what comes `BEFORE` it must not.
    spares : tuple of str
        What must not, either.
    """

    plant: Callable[[pytest.MonkeyPatch], None]
    scene: Scene
    engines: str | tuple[str, ...]
    quantity: str
    spares: tuple[str, ...] = ()


def static(owner: Any, name: str, function: Any) -> Callable[[pytest.MonkeyPatch], None]:
    return lambda patch: patch.setattr(owner, name, staticmethod(function))


def around(owner: Any, name: str, function: Any) -> Callable[[pytest.MonkeyPatch], None]:
    """Replace a function by one that is given the right one before its arguments."""
    right = getattr(owner, name)
    return lambda patch: patch.setattr(owner, name, lambda *given, **keys: function(right, *given, **keys))


def gamma_without_coriolis(g: Any, f: Any, i: Any, j: Any) -> Any:
    a_i, a_j, d = planar.arms(g, i, j)
    n = i.turned(Vec(g[4], g[5]))
    return (n.dot(d) * (i.omega * i.omega) - n.dot(planar.drift(a_i, a_j, i, j)),)


def drift_with_one_sign_wrong(a_i: Vec, a_j: Vec, i: Any, j: Any) -> Vec:
    return a_i * (i.omega * i.omega) + a_j * (j.omega * j.omega)


def other_assembly(right: Any, system: Any, scene: Scene) -> Start:
    near = right(system, scene)
    poses = assemblies(system, scene.times[0]).poses
    return Start(Status.OK, max(poses, key=lambda q: float(np.linalg.norm(q - near.q))))


def longer_by_a_billionth(joint: Any) -> Any:
    """Return the joint with one length off by 1e-9 of itself."""
    if joint.name != "B":
        return joint
    return replace(joint, point_j=(joint.point_j[0] * (1.0 + 1e-9), joint.point_j[1]))


def with_a_length_off(right: Any, mechanism: Mechanism, *more: Any, **keys: Any) -> Any:
    joints = tuple(longer_by_a_billionth(joint) for joint in mechanism.joints)
    return right(replace(mechanism, joints=joints), *more, **keys)


def marker_off(right: Any, self: Any, body: str, point: Any) -> Any:
    return tuple(c * (1.0 + 1e-9) if body == "coupler" else c for c in right(self, body, point))


def place_off(right: Any, drawn: Any, place: Any, arithmetic: Any) -> Any:
    body, (x, y) = place
    return right(drawn, (body, (x * (1.0 + 1e-9), y) if body == "coupler" else (x, y)), arithmetic)


def columns_of_the_next_body(right: Any, unit: Any, levels: Any) -> Any:
    return right(unit, [np.roll(level, 3, axis=0) for level in levels])


def no_law_moves(right: Any, self: Any, one: int) -> None:
    right(self, -1)


def stopped_clock(right: Any, self: Any, t: float, order: int) -> None:
    right(self, TIMES[0], order)


def product_without_mixed_term(a: Any, b: Any) -> float:
    return exudyn_readings.dot(a[2], b[0]) + exudyn_readings.dot(a[0], b[2])


def row_with_plus(right: Any, **of_row: Any) -> Any:
    return right(**{**of_row, "factor": abs(of_row["factor"])})


def linear_row(right: Any, **of_row: Any) -> Any:
    return right(**{**of_row, "form": Linear()})


def start_on_the_other_side(right: Any, scene: Scene, unit: Any) -> Any:
    """Start exudyn's march at the four-bar's other assembly."""
    other = FourBar(ground=4.0, crank=1.0, coupler=3.5, rocker=3.0).scene(law=LAW, times=TIMES, branch="crossed")
    estimates = {body.name: body for body in other.mechanism.bodies}
    bodies = tuple(estimates[body.name] for body in scene.mechanism.bodies)
    return right(replace(scene, mechanism=replace(scene.mechanism, bodies=bodies)), unit)


def stale_drift(right: Any, self: Any, q: Any, qd: Any, places: Any) -> Any:
    """Read the drift term without moving the engine to where it is asked for, but the first time."""
    return right(self, q[[0] * len(q)], qd[[0] * len(q)], places)


def stale_points(right: Any, self: Any, q: Any, *more: Any) -> Any:
    """Place the bodies only at the first pose that is asked for."""
    return right(self, q[[0] * len(q)], *more)


def law_without(missing: int) -> Any:
    def law(right: Any, self: Any, t: Any, order: int) -> Any:
        value = right(self, t, order)
        return 0.0 * value if order == missing else value

    return law


def the_other_sign(right: Any, self: Any, *given: Any) -> float:
    return -right(self, *given)


OF_REFERENCE = {
    "sign of nu of the driver": Fault(
        static(AngleDriver, "nu", lambda g, f, i, j: (-f[0][1],)), FOUR_BAR, PEERS, "velocity"
    ),
    "a driver whose rate is forgotten": Fault(
        static(AngleDriver, "nu", lambda g, f, i, j: (0.0,)), FOUR_BAR, PEERS, "velocity"
    ),
    "gamma without the driver's acceleration": Fault(
        static(AngleDriver, "gamma", lambda g, f, i, j: (0.0,)), FOUR_BAR, PEERS, "acceleration"
    ),
    "gamma of point_on_line without its Coriolis term": Fault(
        static(PointOnLine, "gamma", gamma_without_coriolis), INVERTED, PEERS, "acceleration"
    ),
    "gamma with a sign wrong": Fault(
        lambda patch: patch.setattr(planar, "drift", drift_with_one_sign_wrong), FOUR_BAR, PEERS, "acceleration"
    ),
    "a start on the other assembly": Fault(
        around(refkin.solving.solve, "find_start", other_assembly), FOUR_BAR, PEERS, "position"
    ),
    "a length off by 1e-9": Fault(
        around(Revolute, "constants", lambda right, self, unit: right(longer_by_a_billionth(self), unit)),
        FOUR_BAR,
        PEERS,
        "position",
    ),
}
OF_ADAPTERS = {
    "exudyn: a length off by 1e-9": Fault(
        around(exudyn_parts.Builder, "local", marker_off), FOUR_BAR, "exudyn", "position"
    ),
    "exudyn: a driver whose rate is forgotten": Fault(
        around(exudyn_parts.Clock, "at_rate", no_law_moves), FOUR_BAR, "exudyn", "velocity"
    ),
    "exudyn: columns of another body": Fault(
        around(exudyn_engine, "in_metres", columns_of_the_next_body), FOUR_BAR, "exudyn", "position"
    ),
    "exudyn: a driver that is never set again": Fault(
        around(exudyn_parts.Clock, "set", stopped_clock), FOUR_BAR, "exudyn", "position"
    ),
    "exudyn: a start on the other assembly": Fault(
        around(exudyn_engine, "start_of", start_on_the_other_side), FOUR_BAR, "exudyn", "position"
    ),
    "exudyn: a product rule without its mixed term": Fault(
        lambda patch: patch.setattr(exudyn_readings, "product", product_without_mixed_term),
        INVERTED,
        "exudyn",
        "acceleration",
    ),
    "pinocchio: a length off by 1e-9": Fault(
        around(pin_engine, "joint_tree", with_a_length_off), FOUR_BAR, "pinocchio", "position"
    ),
    "pinocchio: a stale drift term": Fault(
        around(pin_engine.PinocchioTree, "closure_drift", stale_drift), FOUR_BAR, "pinocchio", "acceleration"
    ),
    "pinocchio: points of a stale pose": Fault(
        around(pin_engine.PinocchioTree, "motion", stale_points), FOUR_BAR, "pinocchio", "position"
    ),
    "mujoco: a length off by 1e-9": Fault(
        around(mujoco_engine, "joint_tree", with_a_length_off), FOUR_BAR, "mujoco", "position"
    ),
    "mujoco: a stale drift term": Fault(
        around(mujoco_engine.TreeRows, "closure_drift", stale_drift), FOUR_BAR, "mujoco", "acceleration"
    ),
    "mujoco: a tendon's drift term left out, as MuJoCo does": Fault(
        lambda patch: patch.setattr(mujoco_rows.MujocoRows, "_length_drift", lambda self, row: 0.0),
        ROD,
        "mujoco",
        "acceleration",
    ),
    "joint trees: bodies permuted": Fault(
        around(tree_system, "body_levels", lambda right, engine, march, bodies: right(engine, march, bodies[::-1])),
        FOUR_BAR,
        BY_TREE,
        "position",
    ),
    "laws kept at hand: a driver whose rate is forgotten": Fault(
        around(poses.Tabulated, "__call__", law_without(1)), FOUR_BAR, KEEPING, "velocity"
    ),
    "laws kept at hand: a driver whose acceleration is forgotten": Fault(
        around(poses.Tabulated, "__call__", law_without(2)), FOUR_BAR, KEEPING, "acceleration"
    ),
    "closed form: a length off by 1e-9": Fault(
        around(linkage, "_local", place_off), FOUR_BAR, "closed_form", "position"
    ),
    "closed form: the other of two meeting points": Fault(
        around(assemble.Assembly, "_sign", the_other_sign), FOUR_BAR, "closed_form", "position"
    ),
}
OF_ROWS = {
    "exudyn: a row with the wrong sign": Fault(
        around(exudyn_model, "RowMap", row_with_plus), INVERTED, "exudyn", "residual"
    ),
    "exudyn: a sine taken for its angle": Fault(
        around(exudyn_model, "RowMap", linear_row), SLIDER, "exudyn", "jacobian"
    ),
    "pinocchio: a length off by 1e-9 in its own rows": Fault(
        around(
            pin_engine.PinocchioConstraints,
            "__init__",
            lambda right, self, scene, joints: right(self, scene, [longer_by_a_billionth(joint) for joint in joints]),
        ),
        FOUR_BAR,
        "pinocchio",
        "residual",
    ),
    "mujoco: bodies permuted in its own rows": Fault(
        around(mujoco_engine.AbsoluteRows, "jacobian", lambda right, self, q, t: np.roll(right(self, q, t), 3, axis=1)),
        FOUR_BAR,
        "mujoco",
        "jacobian",
        ("position", "residual"),
    ),
}
FAULTS = OF_REFERENCE | OF_ADAPTERS | OF_ROWS


def disagreements(scene: Scene) -> list[dict[str, Any]]:
    return list(check(scene, PEERS).disagreements)


@pytest.mark.parametrize("fault", FAULTS.values(), ids=FAULTS)
def test_a_planted_fault_is_caught_and_blamed_where_it_is(fault, monkeypatch):
    assert disagreements(fault.scene) == []

    fault.plant(monkeypatch)
    listed = disagreements(fault.scene)

    engines = {fault.engines} if isinstance(fault.engines, str) else {*fault.engines}
    assert {d.engine for d in listed} - {"refkin"} == engines
    assert {d.engine for d in listed if d.quantity == fault.quantity} >= engines
    assert not {d.quantity for d in listed} & {*BEFORE.get(fault.quantity, ()), *fault.spares}


@pytest.mark.parametrize("name", ["a start on the other assembly", "exudyn: a start on the other assembly"])
def test_a_swapped_branch_is_told_as_one(name, monkeypatch):
    fault = FAULTS[name]
    fault.plant(monkeypatch)

    kinds = {d.kind for d in disagreements(fault.scene) if d.quantity == "position"}
    assert kinds == {"other assembly"}


def first_body_off(levels: Any, bodies: Any) -> None:
    levels[0][0] += 1e-9 if bodies[0] == "rocker" else 0.0


def one_missing(levels: Any, bodies: Any) -> None:
    levels[1][2, 1] = np.nan


@pytest.mark.parametrize(
    ("spoil", "quantity", "kind"),
    [
        (first_body_off, "position", "depends on the order of bodies"),
        (one_missing, "velocity", "status ok without a number"),
    ],
)
def test_an_answer_that_is_none_is_called_what_it_is(spoil, quantity, kind, monkeypatch):
    right = tree_system.body_levels

    def spoilt(engine: Any, march: Any, bodies: Any) -> Any:
        levels = right(engine, march, bodies)
        spoil(levels, bodies)
        return levels

    monkeypatch.setattr(tree_system, "body_levels", spoilt)

    assert {(d.engine, d.quantity, d.kind) for d in disagreements(FOUR_BAR)} == {
        (engine, quantity, kind) for engine in BY_TREE
    }


def test_an_engine_that_gives_no_answer_to_a_regular_scene_is_caught(monkeypatch):
    monkeypatch.setattr(poses, "CAP", 1)
    listed = disagreements(FOUR_BAR)

    assert {(d.engine, d.quantity, d.kind) for d in listed} == {(engine, "status", "no answer") for engine in BY_TREE}


TABLE = Table(argument=(0.0, 0.4, 0.7, 1.2, 1.6), value=(0.0, 0.5, 0.3, 0.9, 0.4))


def law_of_straight_pieces(right: Any, self: Any, t: Any, order: int = 0) -> Any:
    return (
        np.interp(t, self.argument, self.value)
        if order == 0 and isinstance(t, float | np.ndarray)
        else right(self, t, order)
    )


@pytest.mark.parametrize("law", [TABLE, Integral(rate=TABLE)], ids=["value", "rate"])
def test_a_law_that_all_read_wrongly_is_told_by_the_proof(law, monkeypatch):
    """The engines take the values of a law from the same place as the reference: only exact laws can object."""
    linkage = FourBar(ground=4.0, crank=1.0, coupler=3.5, rocker=3.0)
    scene = linkage.scene(law=law, times=[0.2, 0.5, 1.0, 1.3])
    assert disagreements(scene) == []

    around(Table, "__call__", law_of_straight_pieces)(monkeypatch)

    assert disagreements(scene)
