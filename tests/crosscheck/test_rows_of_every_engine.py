"""What every engine with rows owes: refkin's rows where nothing is assembled, each of them once, in fresh arrays.

And faults planted in its adapter are seen in these rows.
"""

from __future__ import annotations

import itertools
from dataclasses import dataclass, replace
from typing import Literal

import numpy as np
import pytest

from crosscheck.engines import ELEMENTS, OF_SPACE, EngineError, Level, Support, refusals
from crosscheck.engines.loading import load
from refkin.joints import Constraint, RackAndPinion, elements_of
from tests.mutation.change import mutated

from .loose_rows import KINDS, ROWS, configurations, disagreement, loose_scene, rows_of

CARRIED = "rolling wheels on a carrier"
REFUSED = {"exudyn": {CARRIED}, "mujoco": set(), "pinocchio": {"rolling wheels", CARRIED}}
"""Elements of the plane that an engine has no rows of."""
CASES = [(engine, kind) for engine, kinds in KINDS.items() for kind in kinds]


@pytest.fixture(params=KINDS)
def engine(request):
    return request.param


@pytest.mark.parametrize("level", ROWS)
@pytest.mark.parametrize(("name", "kind"), CASES)
def test_rows_agree_with_refkin_where_nothing_is_assembled(name, kind, level):
    elements = elements_of(c for c in loose_scene(kind).mechanism.constraints if c.name.startswith(kind))
    table = load(name).capabilities()

    assert all(table[e.key][level].support is not Support.REFUSED for e in elements)
    assert disagreement(name, loose_scene(kind), level) <= 1.0


@pytest.mark.parametrize("level", ROWS)
def test_rows_of_all_kinds_stand_together_in_one_model(engine, level):
    assert disagreement(engine, loose_scene(*KINDS[engine]), level) <= 1.0


def test_every_row_of_refkin_is_mapped_once_and_the_others_of_the_engine_are_empty(engine):
    scene = loose_scene(*KINDS[engine])
    model = load(engine).constraints(scene)
    q, qd, t = next(configurations(1))
    theirs = [rows_of(model, level, q, qd, t) for level in ROWS]
    empty = sorted({*range(len(theirs[0]))} - {row.engine_row for row in model.rows})
    ours = [(c.name, k) for c in scene.mechanism.constraints for k in range(c.rows)]

    assert sorted((row.constraint, row.row) for row in model.rows) == sorted(ours)
    assert len({row.engine_row for row in model.rows}) == len(ours)
    assert len(empty) == (6 if engine == "exudyn" else 0)  # the second row of each point_on_line and face on a disc
    assert not any(np.any(rows[empty]) for rows in (theirs[0], theirs[1], theirs[3]))


@pytest.mark.parametrize("level", ROWS)
def test_what_was_read_stays_and_what_is_read_depends_on_nothing_before(engine, level):
    scene = loose_scene(*KINDS[engine])
    (one, other) = configurations(2)
    used, fresh = (load(engine).constraints(scene) for _ in range(2))
    first = rows_of(used, level, *one)
    kept = first.copy()
    rows_of(used, Level.DRIFT, *other)

    assert np.array_equal(rows_of(used, level, *one), rows_of(fresh, level, *one))
    assert np.array_equal(first, kept)


def test_the_table_names_every_element_that_is_built_at_every_level_and_says_why_it_is_not_native(engine):
    table = load(engine).capabilities()
    built = {e.key for e in elements_of(loose_scene(*KINDS["exudyn"], *KINDS["mujoco"]).mechanism.constraints)}
    refused = {key for key in built if {c.support for c in table[key].values()} == {Support.REFUSED}}

    assert built == set(ELEMENTS) - {"points coincide by a law", "rolling on a line", "contact"} - set(OF_SPACE)
    assert refused == REFUSED[engine]
    assert all(set(levels) == set(Level) for levels in table.values())
    assert all(c.reason for levels in table.values() for c in levels.values() if c.support is not Support.NATIVE)


@dataclass(frozen=True, kw_only=True)
class Magnet(Constraint):
    """A joint that no engine has."""

    rows = 6
    body_i: str
    body_j: str
    type: Literal["magnet"] = "magnet"


ENDS = {"body_i": "ground", "point_i": (0.0, 0.0), "body_j": "a", "point_j": (0.0, 0.0)}
UNKNOWN = [
    (Magnet(name="snap", body_i="ground", body_j="a"), "no such joint in this engine: no elements say what it is"),
    (RackAndPinion(name="rack", **ENDS, axis_i=(1.0, 0.0), radius=1.0), "no such element in this engine: rolling on a"),
]


@pytest.mark.parametrize(("joint", "reason"), UNKNOWN, ids=["joint", "element"])
def test_what_is_in_no_table_is_refused_by_name_and_left_out_of_the_rows(engine, joint, reason):
    loose = loose_scene("revolute")
    mechanism = replace(loose.mechanism, joints=(*loose.mechanism.joints, joint))
    scene, asked = replace(loose, mechanism=mechanism), load(engine)
    (sentence,) = refusals(asked, scene, Level.RESIDUAL)

    assert sentence.startswith(f"{engine} refuses {joint.type} '{joint.name}' at residual: {reason}")
    assert {row.constraint for row in asked.constraints(scene).rows} == {j.name for j in loose.mechanism.joints}
    with pytest.raises(EngineError, match=f"{engine} refuses {joint.type} '{joint.name}' at solve: {reason}"):
        asked.solve(scene)


NO_ROWS = [("pinocchio", "distance"), *itertools.product(("mujoco", "pinocchio"), ("angle", "x", "y", "cylinder"))]


@pytest.mark.parametrize(("name", "kind"), NO_ROWS)
def test_what_an_engine_has_no_rows_of_is_refused_with_its_reason_and_left_out(name, kind):
    scene, asked = loose_scene(kind), load(name)
    model, refused = asked.constraints(scene), [c for c in scene.mechanism.constraints if c.name.startswith(kind)]
    reasons = [asked.capabilities()[e.key][Level.RESIDUAL].reason for e in elements_of(refused)]
    sentences = zip(refusals(asked, scene, Level.RESIDUAL), refused, reasons, strict=True)

    assert all(s == f"{name} refuses {c.type} {c.name!r} at residual: {reason}" for s, c, reason in sentences)
    assert {row.constraint for row in model.rows} == {"revolute 0", "revolute 1", "revolute 2"}
    assert not model.owns_driver


# ---- planted faults: the rows above must turn red


RESIDUAL, JACOBIAN, VELOCITY, DRIFT = ROWS
OF_MUJOCO, LINES = KINDS["mujoco"], ("prismatic", "point_on_line")
FAULTS = {
    "exudyn: lengths off by 1e-9": (
        "exudyn.parts:Builder.local", "return (", "return (1.0 + 1e-9) * (", {RESIDUAL: ["revolute"]},
    ),
    "exudyn: the rate of a driver is not told": (
        "exudyn.parts:Builder.driven", "values[law][1]", "0.0", {VELOCITY: ["angle", "x"]},
    ),
    "exudyn: no mixed term in the drift of a product": (
        "exudyn.readings:product", "+ 2.0 * dot(a[1], b[1])", "", {DRIFT: ["point_on_line", "distance"]},
    ),
    "exudyn: the other sign of velocities": (
        "exudyn.model:ExudynModel.constraint_velocity", "return rows", "return -rows", {VELOCITY: ["prismatic"]},
    ),
    "exudyn: laws are evaluated once": (
        "exudyn.parts:Clock.set", "t == self._known[0] and order <= self._known[1]", "not math.isnan(self._known[0])",
        {RESIDUAL: ["y"]},
    ),
    "exudyn: markers in the wrong order": (
        "exudyn.parts:Builder.points", "in places]", "in places[::-1]]", {RESIDUAL: ["revolute"], JACOBIAN: ["fixed"]},
    ),
    "mujoco: a point off by 1e-9": (
        "mujoco.model:Plan._site", "point))", "(point[0] + 1e-9, point[1])))",
        {RESIDUAL: OF_MUJOCO, JACOBIAN: ["revolute", "distance", "prismatic"]},
    ),
    "mujoco: ends exchanged": ("mujoco.model:Plan._connect", "3, j, i", "3, i, j", {RESIDUAL: ["revolute"]}),
    "mujoco: columns permuted": (
        "mujoco.rows:MujocoRows.__init__", "self._stages =", "self.columns = np.roll(self.columns, 3); self._stages =",
        {JACOBIAN: OF_MUJOCO},
    ),
    "mujoco: stale positions": (
        "mujoco.rows:MujocoRows.rows", "self._posed(q)", "self._posed(vars(self).setdefault('first', q))",
        {RESIDUAL: OF_MUJOCO, JACOBIAN: OF_MUJOCO},
    ),
    "mujoco: stabilised": (
        "mujoco.model:Plan._equality", "[0.0, 0.0]", "[0.02, 1.0]",
        {DRIFT: ["revolute", "fixed", "prismatic"]},
    ),
    "mujoco: no Coriolis term on a line": (
        "mujoco.rows:MujocoRows._guide_rates", "- 2.0 * turned * rate[:, at] + omega * omega * n * gap[:, at]", "",
        {DRIFT: LINES},
    ),
    "mujoco: a line that does not turn": (
        "mujoco.rows:MujocoRows._guide_rows", "+ turning * self._turns[k]", "", {JACOBIAN: LINES},
    ),
    "mujoco: no bias of a length": (
        "mujoco.rows:MujocoRows.rates", "self._length_drift(row)", "0.0", {DRIFT: ["distance"]},
    ),
    "pinocchio: stale placements": (
        "pinocchio.model:PlanarModel.place", "pin.computeJointJacobians(self.model, self.data, q)", "pass",
        {RESIDUAL: ["fixed"]},
    ),
    "pinocchio: stale rates": (
        "pinocchio.model:PlanarModel.move", "q, qd, self", "q, 0.0 * qd, self",
        {VELOCITY: ["revolute"], DRIFT: ["revolute"]},
    ),
    "pinocchio: bodies exchanged": (
        "pinocchio.rows:TwoPoints.__init__", "j.joint, j.placement, i.joint, i.placement",
        "i.joint, i.placement, j.joint, j.placement", {RESIDUAL: ["revolute"]},
    ),
    "pinocchio: along the axis instead of across": (
        "pinocchio.rows:Anchor._slot", "self.component, self.component + 1", "0, 1", {JACOBIAN: LINES},
    ),
    "pinocchio: constant angle of the other sign": (
        "pinocchio.rows:_element_rows", "unit_vector(", "unit_vector(-", {RESIDUAL: ["fixed", "prismatic"]},
    ),
    "pinocchio: sign of gamma": ("pinocchio.rows:Rows.drift", "return -", "return ", {DRIFT: KINDS["pinocchio"]}),
    "pinocchio: a point off by 1e-9": (
        "pinocchio.model:shift", "*u,", "u[0] + 1e-9, u[1],", {RESIDUAL: KINDS["pinocchio"]},
    ),
    "pinocchio: bodies permuted": (
        "pinocchio.engine:PinocchioConstraints.__init__", "absolute_tree(bodies)", "absolute_tree(bodies[::-1])",
        {RESIDUAL: KINDS["pinocchio"]},
    ),
}  # fmt: skip
"""What is put in an engine's adapter, where and in place of what; where it must be seen, in which rows."""
PLANTED = [(name, kind, level) for name, (*_, at) in FAULTS.items() for level, kinds in at.items() for kind in kinds]


@pytest.mark.parametrize(("name", "kind", "level"), PLANTED)
def test_a_planted_fault_is_seen(name, kind, level):
    asked, scene, (target, old, new, _) = name.split(":")[0], loose_scene(kind), FAULTS[name]
    assert disagreement(asked, scene, level) <= 1.0

    with mutated(f"crosscheck.engines.{target}", old, new):
        assert not disagreement(asked, scene, level) <= 1.0
