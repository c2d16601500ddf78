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
from typing import Any

import numpy as np

from crosscheck.engines import Array, EngineRefusal, Term, route_by
from crosscheck.engines.march import March
from crosscheck.engines.mujoco.model import Plan, mujoco
from crosscheck.engines.mujoco.rows import MujocoRows
from crosscheck.engines.tree.joint_tree import JointTree
from refkin.model import Scene
from refkin.motion import Status

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


def stepped(tree: JointTree, scene: Scene) -> March:
    """Return the tree coordinates at all times of a scene.

    Raises
    ------
    EngineError
        If a joint that closes a loop has no equality constraint in MuJoCo.
    """
    plan = Plan(tree, (*tree.closures, *tree.driven))
    if plan.guides:
        raise EngineRefusal(
            f"mujoco refuses this scene on the route {STEPPED.name!r}: no equality constraint holds a point on a line"
        )
    simulation = Simulation(plan)
    levels = np.full((tree.width, len(scene.times)), np.nan)
    residual = np.full(len(scene.times), np.nan)
    status = [Status.NOT_CONVERGED] * len(scene.times)
    q = tree.start()
    for k, t in enumerate(scene.times):
        pose = simulation.at_rest(q, t)
        if pose is not None:
            q, status[k] = pose, Status.OK
            levels[:, k], residual[k] = q, simulation.violation()
    return March((levels,), tuple(status), residual)


class Simulation:
    """A model with MuJoCo's defaults, and its state."""

    def __init__(self, plan: Plan) -> None:
        self.rows = MujocoRows(plan)
        self.model: Any = self.rows.model
        as_shipped(self.model)
        self.columns = np.array([self.model.joint(f"q{k}").id for k in range(plan.tree.width)], int)

    def at_rest(self, q: Array, t: float) -> Array | None:
        """Return where the mechanism comes to rest from q; None if it does not, or MuJoCo warns that it went astray."""
        self.rows.drive(t)
        data = mujoco.MjData(self.model)
        self.data: Any = data
        data.qpos[self.columns] = q
        for _ in range(MOST // AT_ONCE):
            mujoco.mj_step(self.model, data, AT_ONCE)
            if any(warning.number for warning in data.warning):
                return None
            if np.max(np.abs(data.qvel), initial=0.0) < REST:
                return np.array(data.qpos[self.columns])
        return None

    def violation(self) -> float:
        """Return the largest violation of a constraint, in MuJoCo's own unit."""
        return float(np.max(np.abs(self.data.efc_pos), initial=0.0))


def as_shipped(model: Any) -> None:
    """Give a model the options and the solver parameters that MuJoCo has by default; gravity stays off."""
    shipped = mujoco.MjModel.from_xml_string("<mujoco/>")
    for name in ("timestep", "integrator", "solver", "jacobian", "iterations", "tolerance", "ls_iterations",
                 "ls_tolerance", "disableflags", "enableflags", "impratio", "cone"):  # fmt: skip
        setattr(model.opt, name, getattr(shipped.opt, name))
    model.opt.gravity[:] = 0.0
    model.eq_solref[:] = mujoco.MjSpec().default.equality.solref
    model.eq_solimp[:] = mujoco.MjSpec().default.equality.solimp
