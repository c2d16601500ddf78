"""MuJoCo as it is shipped: `mj_step` with every default, its constraints soft, until the mechanism has come to rest.

The loops are equality constraints with the default `solref` and `solimp`, the input is one more, set anew at each time;
integrator, solver, tolerances, flags and the choice between dense and sparse Jacobians are MuJoCo's own. Only gravity
is off: no scene here has a load. Each time starts at the last answer, at rest.

At rest and without a load a soft constraint is exact: MuJoCo's dynamics in constraint space are a1 + d (b v + k r) =
(1 - d) a0 (its documentation, Modeling, Solver parameters), and a1 = v = a0 = 0 with d k > 0 leave r = 0. But MuJoCo's
solver ends "early" when a step improves its cost by less than `tolerance`, 1e-8, "scaled" by the mean inertia and the
number n of freedoms. With accelerations off by a the cost is at least a^2 / 2 per unit of inertia, so that a violation
is no longer corrected when k r = a < sqrt(2 n tolerance); k = 1 / (dmax timeconst dampratio)^2.
"""

from __future__ import annotations

import math
from typing import Any, NoReturn

import numpy as np

from crosscheck.engines import Array, EngineRefusal, Term, in_space, route_by
from crosscheck.engines.march import Closing
from crosscheck.engines.mujoco.model import Plan, add_equality, mujoco
from crosscheck.engines.mujoco.rows import MujocoRows
from crosscheck.engines.mujoco.space import JOINTS, MujocoSpace
from crosscheck.engines.spatial.kinds import JointKind
from crosscheck.engines.spatial.reading import Drive, Hold, numbers_of
from crosscheck.engines.spatial.system import SpaceSystem
from crosscheck.engines.spatial.tree import WIDTH, space_tree
from crosscheck.engines.tree.joint_tree import JointTree, joint_tree
from refkin.model import Mechanism

STEPPED = route_by(
    "mujoco",
    "mj_step",
    "mujoco (mj_step to rest, every option as shipped, gravity off)",
    linear_solve_by="mujoco (its constraint solver)",
    drift_by="none: positions only",
)
REST = 1e-9
"""Largest rate at which the mechanism counts as being at rest [rad/s, sizes/s]: less than the solver tells from it."""
MOST = 10_000
"""Steps after which it is not: 20 s of the default step, 1000 time constants."""
AT_ONCE = 10
"""Steps between two looks at the rates."""


def soft(freedoms: int) -> Term:
    """Return what soft constraints leave at rest, from MuJoCo's default options."""
    shipped, equality = mujoco.MjModel.from_xml_string("<mujoco/>").opt, mujoco.MjSpec().default.equality
    timeconst, dampratio = equality.solref[:2]
    stiffness = 1.0 / (equality.solimp[1] * timeconst * dampratio) ** 2
    left = math.sqrt(2 * freedoms * shipped.tolerance) / stiffness
    return Term(
        name="soft constraints",
        level="position",
        reason=f"MuJoCo's solver ends at a tolerance of {shipped.tolerance:g}: of its soft constraints that leaves up "
        f"to {left:.1e} sizes uncorrected",
        absolute=left,
    )


def stepped(tree: JointTree) -> Closing:
    """Return what closes a tree; EngineError if no equality constraint closes a loop."""
    plan = Plan(tree, (*tree.closures, *tree.driven))
    if plan.guides:
        raise EngineRefusal(
            f"mujoco refuses this scene by the method {STEPPED.name!r}: no equality constraint holds a point on a line"
        )
    rows = MujocoRows(plan)
    as_shipped(rows.model)

    def at_rest(q: Array, t: float) -> tuple[Array | None, float]:
        rows.drive(t)
        return _at_rest(rows.model, rows.columns, q, np.eye(rows.model.nv))

    return at_rest


class SpaceSimulation(MujocoSpace):
    """A model of space with MuJoCo's defaults: spherical joints close loops by a `connect`, revolutes by two.

    A screw is tied to its slide, and wheels in gear to each other, by an equality of two joints, distances are
    equalities of tendons, and drivers set the value of a joint or of a tendon's length. By default nothing brakes the
    spin of a body between two spherical joints; as its mass lies on the line of the two and its inertias are alike, the
    spin pulls at nothing, and is not asked to rest. A loop or a driver that no equality constraint holds is refused.
    """

    def __init__(self, system: SpaceSystem) -> None:
        for hold in system.tree.closures:
            if hold.kind not in (JointKind.SPHERICAL, JointKind.REVOLUTE, JointKind.DISTANCE):
                _refuse(f"{hold.kind} {hold.name!r}, which closes a loop")
        super().__init__(system.tree, system.places, system.pairs)
        as_shipped(self.model)
        self.braked = np.eye(self.model.nv)
        lines = {body: line for spin in system.tree.numbers.passive for body, (_, line) in spin.items()}
        for edge in system.tree.edges:
            if edge.kind == JointKind.SPHERICAL and edge.body in lines:
                line = self.frames[edge.body][1].T @ lines[edge.body]
                spin = self.model.joint(f"q{self._first[edge.hold]}").dofadr[0] + np.arange(3)
                self.braked[np.ix_(spin, spin)] -= np.outer(line, line)

    def at_rest(self, q: Array, t: float) -> tuple[Array | None, float]:
        for drive, equality, shift in self.driven:
            self.model.eq_data[equality, 0] = drive.value(t) - shift
        pose, violation = _at_rest(self.model, self.columns, self.coordinates(q), self.braked)
        if pose is None:
            return None, violation
        known = [x for e in self.tree.edges for x in [False] * (e.kind == JointKind.SCREW) + [True] * WIDTH[e.kind]]
        return pose[np.array(known, bool)], violation

    def _add(self) -> None:
        joints = np.cumsum([0, *(len(JOINTS[edge.kind]) for edge in self.tree.edges)])
        self._first = {edge.hold: int(k) for edge, k in zip(self.tree.edges, joints[:-1], strict=True)}
        for edge in self.tree.edges:
            if edge.kind == JointKind.SCREW:
                slide = self._first[edge.hold]
                self._coupling([0.0, edge.pitch], mujoco.mjtObj.mjOBJ_JOINT, f"q{slide}", f"q{slide + 1}")
        for hold in self.tree.closures:
            if hold.kind == JointKind.DISTANCE:
                self._hold_length(hold, hold.length)
        for gear in self.tree.numbers.gears:
            wheels = (f"q{self._turn(name)}" for name in reversed(gear.joints))
            first, second = gear.radii
            self._coupling([gear.sum / second, -first / second], mujoco.mjtObj.mjOBJ_JOINT, *wheels)
        self.driven = [(drive, *self._drive(drive)) for drive in self.tree.numbers.drives]

    def _turn(self, joint: str) -> int:
        """Return which of MuJoCo's joints is the turn of one of the tree."""
        self.tree.turn_of(joint)  # or it is refused
        edge = next(edge for edge in self.tree.edges if edge.hold == joint)
        return self._first[joint] + (edge.kind in (JointKind.CYLINDRICAL, JointKind.SCREW))

    def _drive(self, drive: Drive) -> tuple[int, float]:
        """Return the equality that a driver sets, and the law's value at which the equality's is zero."""
        if drive.kind == JointKind.DISTANCE:
            return self._hold_length(drive.hold, 0.0), 0.0
        edge = self.tree.edge_of(drive)
        if edge is None:
            _refuse(f"{drive.kind} {drive.name!r}, whose joint closes a loop")
        turns = drive.kind == JointKind.ANGLE
        moved = self._turn(edge.hold) if turns else self._first[edge.hold]
        equality = self._coupling([0.0], mujoco.mjtObj.mjOBJ_JOINT, f"q{moved}")
        return equality, edge.shift if edge.kind == JointKind.SCREW and not turns else 0.0

    def _hold_length(self, hold: Hold, length: float) -> int:
        """Hold two points at a distance by a tendon, and return its equality."""
        tendon = self.spec.add_tendon(name=f"length {hold.name}")
        for side, body in zip("ij", hold.bodies, strict=True):
            u, frame = self.frames[body]
            site = self.bodies[body].add_site(name=f"{tendon.name} {side}", pos=frame.T @ (hold.end(body)[0] - u))
            tendon.wrap_site(site.name)
        return self._coupling([length], mujoco.mjtObj.mjOBJ_TENDON, tendon.name)

    def _coupling(self, polynomial: list[float], between: Any, *names: str) -> int:
        kind = mujoco.mjtEq.mjEQ_TENDON if between == mujoco.mjtObj.mjOBJ_TENDON else mujoco.mjtEq.mjEQ_JOINT
        add_equality(self.spec, kind, between, *names).data[: len(polynomial)] = polynomial
        return len(self.spec.equalities) - 1


def _refuse(what: str) -> NoReturn:
    raise EngineRefusal(f"mujoco refuses {what}, by the method {STEPPED.name!r}: no equality constraint holds it")


def freedoms(mechanism: Mechanism) -> int:
    """Return how many freedoms a mechanism has as a joint tree in MuJoCo."""
    if not in_space(mechanism):
        return joint_tree(mechanism).width
    return sum(edge.rates + (edge.kind == JointKind.SCREW) for edge in space_tree(numbers_of(mechanism), {}).edges)


def _at_rest(model: Any, columns: Array, q: Any, braked: Array) -> tuple[Array | None, float]:
    """Return where a model comes to rest from q, None if it does not or MuJoCo warns that it went astray.

    `braked` (v, v) times the rates is what has to vanish. The other value is the largest violation of a constraint, in
    MuJoCo's own unit.
    """
    data: Any = mujoco.MjData(model)
    data.qpos[columns] = q
    for _ in range(MOST // AT_ONCE):
        mujoco.mj_step(model, data, AT_ONCE)
        if any(warning.number for warning in data.warning):
            break
        if np.max(np.abs(braked @ data.qvel), initial=0.0) < REST:
            return np.array(data.qpos[columns]), float(np.max(np.abs(data.efc_pos), initial=0.0))
    return None, math.nan


def as_shipped(model: Any) -> None:
    """Give a model the options and the solver parameters that MuJoCo has by default; gravity stays off."""
    shipped = mujoco.MjModel.from_xml_string("<mujoco/>")
    for name in ("timestep", "integrator", "solver", "jacobian", "iterations", "tolerance", "ls_iterations",
                 "ls_tolerance", "disableflags", "enableflags", "impratio", "cone"):  # fmt: skip
        setattr(model.opt, name, getattr(shipped.opt, name))
    model.opt.gravity[:] = 0.0
    model.eq_solref[:] = mujoco.MjSpec().default.equality.solref
    model.eq_solimp[:] = mujoco.MjSpec().default.equality.solimp
