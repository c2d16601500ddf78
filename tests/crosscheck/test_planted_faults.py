"""Faults planted in production code: each is caught, and blamed on whom it is in and on the quantity it spoils."""

from __future__ import annotations

from dataclasses import replace
from typing import Any, NamedTuple

import numpy as np
import pytest

from crosscheck.engines import poses
from crosscheck.measure.check import check
from refkin import InvertedSliderCrank, Sinusoid, SliderCrank, Table
from refkin.joints import Distance
from refkin.model import Mechanism, Scene
from refkin.motion_laws import Integral
from tests.linkages import ROCKER
from tests.mutation.change import mutated

PEERS = ("closed_form", "exudyn", "pinocchio", "mujoco")
BY_TREE = ("pinocchio", "mujoco")
KEEPING = (*BY_TREE, "exudyn")
"""The engines whose loops the adapters' own Newton closes."""
TIMES = tuple(float(t) for t in np.linspace(0.0, 2.0, 9))
LAW = Sinusoid(offset=1.0, amplitude=0.8, angular_frequency=1.3, phase=0.4)
"""Neither its rate nor its acceleration vanishes at any of the times."""

FOUR_BAR = ROCKER.scene(law=LAW, times=TIMES)
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


class Fault(NamedTuple):
    """A passage of production code with a fault in it, the scene on which it is planted, and what must be found.

    `engines` must disagree, and nobody else, and each of them by each of its routes in `quantity`; in what comes
    `BEFORE` it and in what it `spares` they must not. A fault in the reference itself has everybody disagree.
    """

    target: str
    old: str
    new: str
    scene: Scene
    engines: str | tuple[str, ...]
    quantity: str
    spares: tuple[str, ...] = ()


OFF = "(1.0 + 1e-9 * (body == 'coupler'))"
FAULTS = {
    "sign of nu of the driver": Fault(
        "refkin.joints.drivers:AngleDriver.nu", "f[0][1]", "-f[0][1]", FOUR_BAR, PEERS, "velocity"
    ),
    "a driver whose rate is forgotten": Fault(
        "refkin.joints.drivers:AngleDriver.nu", "f[0][1]", "0.0", FOUR_BAR, PEERS, "velocity"
    ),
    "gamma without the driver's acceleration": Fault(
        "refkin.joints.drivers:AngleDriver.gamma", "f[0][2]", "0.0", FOUR_BAR, PEERS, "acceleration"
    ),
    "gamma of point_on_line without its Coriolis term": Fault(
        "refkin.joints.planar:PointOnLine.gamma", "n.perp().dot(gap_rate(a_i, a_j, i, j)) * (2 * i.omega) -", "-",
        INVERTED, PEERS, "acceleration",
    ),
    "gamma with a sign wrong": Fault(
        "refkin.joints.base:drift", "- a_j", "+ a_j", FOUR_BAR, PEERS, "acceleration"
    ),
    "a start on the other assembly": Fault(
        "refkin.solving.starts:find_start", "return Start(Status.OK, first.q)",
        "return Start(Status.OK, max(assemblies(system, t).poses, key=lambda q: np.linalg.norm(q - first.q)))",
        FOUR_BAR, PEERS, "position",
    ),
    "a length off by 1e-9": Fault(
        "refkin.joints.base:Constraint.constants", "tuple(c for", "tuple(c * (1.0 + 1e-9 * (self.name == 'B')) for",
        FOUR_BAR, PEERS, "position",
    ),
    "exudyn: a length off by 1e-9": Fault(
        "crosscheck.engines.exudyn.parts:Builder.local", "point[0] - ox", f"point[0] * {OFF} - ox",
        FOUR_BAR, "exudyn", "position",
    ),
    "exudyn: a driver whose rate is forgotten": Fault(
        "crosscheck.engines.exudyn.parts:Clock.at_rate", "float(k == one)", "0.0", FOUR_BAR, "exudyn", "velocity"
    ),
    "exudyn: columns of another body": Fault(
        "crosscheck.engines.exudyn.solve:in_metres", "[level * scale", "[np.roll(level, 3, axis=0) * scale",
        FOUR_BAR, "exudyn", "position",
    ),
    "exudyn: a driver that is never set again": Fault(
        "crosscheck.engines.exudyn.parts:Clock.set", "self._table[t]", "self._table[0.0]",
        FOUR_BAR, "exudyn", "position",
    ),
    "exudyn: a start on the other assembly": Fault(
        "crosscheck.engines.exudyn.solve:start_of", "as_driven(scene).bodies], float)",
        "as_driven(scene).bodies], float) * ([1, 1, 1], [1, -1, -1], [1, -1, -1])", FOUR_BAR, "exudyn", "position",
    ),
    "exudyn: a product rule without its mixed term": Fault(
        "crosscheck.engines.exudyn.readings:product", "+ 2.0 * dot(a[1], b[1])", "", INVERTED, "exudyn", "acceleration"
    ),
    "pinocchio: a length off by 1e-9": Fault(
        "crosscheck.engines.pinocchio.engine:PinocchioTree.__init__", "tree.scaled)",
        "lambda *of: [(1.0 + 1e-9) * u for u in tree.scaled(*of)])", FOUR_BAR, "pinocchio", "position",
    ),
    "pinocchio: a stale drift term": Fault(
        "crosscheck.engines.pinocchio.engine:PinocchioTree.closure_drift", "(q, qd,",
        "(q[[0] * len(q)], qd[[0] * len(q)],", FOUR_BAR, "pinocchio", "acceleration",
    ),
    "pinocchio: points of a stale pose": Fault(
        "crosscheck.engines.pinocchio.engine:PinocchioTree.motion", "in (q, qd, qdd)", "in (q[[0] * len(q)], qd, qdd)",
        FOUR_BAR, "pinocchio", "position",
    ),
    "mujoco: a length off by 1e-9": Fault(
        "crosscheck.engines.mujoco.model:Plan._site", "point))", "[u * (1.0 + 1e-9) for u in point]))",
        FOUR_BAR, "mujoco", "position",
    ),
    "mujoco: a stale drift term": Fault(
        "crosscheck.engines.mujoco.engine:TreeRows.closure_drift", "(q, qd,", "(q[[0] * len(q)], qd[[0] * len(q)],",
        FOUR_BAR, "mujoco", "acceleration",
    ),
    "mujoco: a tendon's drift term left out, as MuJoCo does": Fault(
        "crosscheck.engines.mujoco.rows:MujocoRows.rates", "= self._length_drift(row)", "= 0.0",
        ROD, "mujoco", "acceleration",
    ),
    "joint trees: bodies permuted": Fault(
        "crosscheck.engines.tree.tree_system:body_levels", "for body in bodies]", "for body in bodies[::-1]]",
        FOUR_BAR, BY_TREE, "position",
    ),
    "laws kept at hand: a driver whose rate is forgotten": Fault(
        "crosscheck.engines.poses:Tabulated.__call__", "return self._values[key]",
        "return self._values[key] * (order != 1)", FOUR_BAR, KEEPING, "velocity",
    ),
    "laws kept at hand: a driver whose acceleration is forgotten": Fault(
        "crosscheck.engines.poses:Tabulated.__call__", "return self._values[key]",
        "return self._values[key] * (order != 2)", FOUR_BAR, KEEPING, "acceleration",
    ),
    "closed form: a length off by 1e-9": Fault(
        "crosscheck.engines.closed_form.linkage:_local", "number(a)", f"number(a * {OFF})",
        FOUR_BAR, "closed_form", "position",
    ),
    "closed form: the other of two meeting points": Fault(
        "crosscheck.engines.closed_form.assemble:Assembly._sign", "(first.conjugate() * second).imag",
        "(second.conjugate() * first).imag", FOUR_BAR, "closed_form", "position",
    ),
    "exudyn: a row with the wrong sign": Fault(
        "crosscheck.engines.exudyn.model:ExudynModel.__init__", "factor=line.factor", "factor=abs(line.factor)",
        INVERTED, "exudyn", "residual",
    ),
    "exudyn: a sine taken for its angle": Fault(
        "crosscheck.engines.exudyn.model:ExudynModel.__init__", "form=line.form", "form=type(line).form",
        SLIDER, "exudyn", "jacobian",
    ),
    "pinocchio: a length off by 1e-9 in its own rows": Fault(
        "crosscheck.engines.pinocchio.engine:PinocchioConstraints.__init__", "lambda body, u: u",
        f"lambda body, u: [{OFF} * c for c in u]", FOUR_BAR, "pinocchio", "residual",
    ),
    "mujoco: bodies permuted in its own rows": Fault(
        "crosscheck.engines.mujoco.engine:AbsoluteRows.jacobian", "jacobian * np.outer",
        "np.roll(jacobian, 3, axis=1) * np.outer", FOUR_BAR, "mujoco", "jacobian", ("position", "residual"),
    ),
}  # fmt: skip


def disagreements(scene: Scene) -> list[dict[str, Any]]:
    return list(check(scene, PEERS).disagreements)


@pytest.mark.parametrize("fault", FAULTS.values(), ids=FAULTS)
def test_a_planted_fault_is_caught_and_blamed_where_it_is(fault):
    assert disagreements(fault.scene) == []

    with mutated(*fault[:3]):
        listed = disagreements(fault.scene)

    engines = {fault.engines} if isinstance(fault.engines, str) else {*fault.engines}
    assert {d.engine for d in listed} - {"refkin"} == engines
    assert {d.engine for d in listed if d.quantity == fault.quantity} >= engines
    assert not {d.quantity for d in listed} & {*BEFORE.get(fault.quantity, ()), *fault.spares}


@pytest.mark.parametrize("name", ["a start on the other assembly", "exudyn: a start on the other assembly"])
def test_a_swapped_branch_is_told_as_one(name):
    fault = FAULTS[name]
    with mutated(*fault[:3]):
        kinds = {d.kind for d in disagreements(fault.scene) if d.quantity == "position"}

    assert kinds == {"other assembly"}


@pytest.mark.parametrize(
    ("spoil", "quantity", "kind"),
    [
        ("levels[0][0] += 1e-9 * (bodies[0] == 'rocker')", "position", "depends on how a scene is stated"),
        ("levels[1][2, 1] = np.nan", "velocity", "status ok without a number"),
    ],
)
def test_an_answer_that_is_none_is_called_what_it_is(spoil, quantity, kind):
    with mutated("crosscheck.engines.tree.tree_system:body_levels", "return levels", f"{spoil}; return levels"):
        listed = disagreements(FOUR_BAR)

    assert {(d.engine, d.quantity, d.kind) for d in listed} == {(engine, quantity, kind) for engine in BY_TREE}


def test_an_engine_that_gives_no_answer_to_a_regular_scene_is_caught(monkeypatch):
    monkeypatch.setattr(poses, "CAP", 1)
    listed = disagreements(FOUR_BAR)

    assert {(d.engine, d.quantity, d.kind) for d in listed} == {(engine, "status", "no answer") for engine in BY_TREE}


TABLE = Table(argument=(0.0, 0.4, 0.7, 1.2, 1.6), value=(0.0, 0.5, 0.3, 0.9, 0.4))


@pytest.mark.parametrize("law", [TABLE, Integral(rate=TABLE)], ids=["value", "rate"])
def test_a_law_that_all_read_wrongly_is_told_by_the_proof(law):
    """The engines take the values of a law from the same place as the reference: only exact laws can object."""
    scene = ROCKER.scene(law=law, times=[0.2, 0.5, 1.0, 1.3])
    assert disagreements(scene) == []

    given = "lambda x, k: self._spline(x, order + k)[()]"
    pieces = "lambda x, k: self._spline(x, order + k)[()] if order + k else np.interp(x, self.argument, self.value)"
    with mutated("refkin.motion_laws:Table.__call__", given, pieces):
        assert disagreements(scene)
