"""MuJoCo stepping in time, with its settings swept, and quasi-static relaxation.

In stepping the prescribed coordinates are overwritten before each step, with an armature beside which no constraint
force moves them; the loop is MuJoCo's soft constraint. Stepping starts at a closed pose with consistent velocities.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from functools import partial
from typing import Any

import numpy as np

from crosscheck.engines import EngineError
from crosscheck.engines.methods import Method, Model, priced
from crosscheck.engines.mujoco.engine import Mujoco, TreeRows
from crosscheck.engines.mujoco.model import mujoco
from crosscheck.engines.tree.joint_tree import Array, joint_tree
from crosscheck.engines.tree.newton import NOBODY, Clockwork, Tree
from refkin.joints import PointsCoincide, RelativeAngle
from refkin.model import Scene

FLYWHEEL = 1e7
"""Armature of a prescribed coordinate; inertias are of order 1. MuJoCo's factorisations lose what it is larger by."""
HEAVY = 1e5
"""The same in relaxation, where the coordinate is put back before every step and nothing moves in the end."""
SHIPPED = ((0.02, 1.0), (0.9, 0.95))
"""MuJoCo's default solref and solimp (its first two numbers)."""
STIFF = 0.9999
"""The largest impedance that MuJoCo accepts."""
RELAXATIONS = (1, 2, 3, 4, 6, 8)


@dataclass(frozen=True)
class Setting:
    """How MuJoCo steps, so often between two times of the scene.

    `timeconst` is the time constant of solref in steps, None for the defaults of solref and solimp; `impedance` is
    solimp, the same at any distance. It is called by the number of steps where there is no other `wording`.
    """

    integrator: str
    steps: int
    timeconst: float | None = 2.0
    solver: str = "NEWTON"
    impedance: float = STIFF
    wording: str = ""


STEPPING = {
    "mj_step, as shipped": [Setting("EULER", n, None) for n in (1, 3, 10)],
    "mj_step, Euler": [Setting("EULER", n) for n in (1, 3, 10, 30)],
    "mj_step, implicitfast": [Setting("IMPLICITFAST", n) for n in (1, 10)],
    "mj_step, discrete": [Setting("DISCRETE", n) for n in (1, 3, 10)],
    "mj_step, RK4": [Setting("RK4", n) for n in (1, 3, 10)],
    "mj_step, Euler, CG": [Setting("EULER", 10, solver="CG")],
    "mj_step, Euler, PGS": [Setting("EULER", 10, solver="PGS")],
    "mj_step, Euler, solref swept": [
        Setting("EULER", 10, timeconst=x, wording=f"solref {x:g}h") for x in (32.0, 16.0, 8.0, 4.0, 2.0)
    ],
    "mj_step, RK4, solimp swept": [
        Setting("RK4", 10, impedance=d, wording=f"solimp {d:g}") for d in (0.9, 0.99, 0.999, STIFF)
    ],
}
"""The last two sweep what keeps the loop closed, at ten steps between two times."""


def stepping_methods() -> Iterator[Method]:
    """Yield stepping in time at all settings, and relaxation."""
    for name, setting in ((name, setting) for name, settings in STEPPING.items() for setting in settings):
        steps = f"{setting.steps} step{'s' * (setting.steps > 1)} between times"
        spring = "default" if setting.timeconst is None else f"{setting.timeconst:g}h, solimp {setting.impedance:g}"
        note, build = f"{steps}; solref {spring}; solver {setting.solver}", partial(_stepped, setting)
        yield priced("mujoco", name, setting.wording or steps, NOBODY, build, note, steps=True)
    name, who = "mj_step, quasi-static relaxation", "MuJoCo (implicit damped steps)"
    note = "discrete, timestep 1, solref 0.001 1, solimp 0.9999, tolerance 0, refsafe off"
    for count in RELAXATIONS:
        named = f"{count} step{'s' * (count > 1)}"
        yield priced("mujoco", name, named, who, partial(_relaxed, count), note, highest=0, steps=True)


def _stepped(setting: Setting, scene: Scene) -> Model:
    stepper = MujocoStepper(scene)
    return Model(partial(stepper.solve, setting, stepper.tree.clockwork(setting.steps)), stepper.tree.read)


def _relaxed(count: int, scene: Scene) -> Model:
    stepper = MujocoStepper(scene)
    return Model(partial(stepper.relax, count), stepper.tree.read)


def tree_of(scene: Scene, *, massless_links: bool = False) -> Tree:
    """Return a scene as MuJoCo's joint tree, with a body for each distance if it has links; raises as `Tree.of`."""
    return Tree.of(Mujoco(), lambda m: TreeRows(joint_tree(m, massless_links=massless_links)), scene)


class MujocoStepper:
    """A scene in MuJoCo's own dynamics; EngineError where these close no loop so, or a driver holds no coordinate."""

    def __init__(self, scene: Scene) -> None:
        self.scene, self.tree = scene, tree_of(scene)
        left_open = [e for e in self.tree.system.tree.closures if not isinstance(e, PointsCoincide | RelativeAngle)]
        if left_open:
            raise EngineError(f"joint {left_open[0].name!r} closes a loop and is no constraint force of MuJoCo's")
        self.tree.clockwork(1)
        engine: Any = self.tree.engine
        self.model, self.data = engine.model, engine.data
        self.columns = engine.columns
        self.q, self.qd = self.tree.first()
        self.flags, self.tolerance = int(self.model.opt.disableflags), float(self.model.opt.tolerance)

    def _set(self, integrator: str, solver: str, solref: tuple[float, float], solimp: tuple[float, float]) -> None:
        option = self.model.opt
        option.integrator = getattr(mujoco.mjtIntegrator, f"mjINT_{integrator}")
        option.solver = getattr(mujoco.mjtSolver, f"mjSOL_{solver}")
        option.disableflags, option.tolerance = self.flags, self.tolerance
        self.model.eq_solref[:] = solref
        self.model.eq_solimp[:, :2] = solimp

    def _reset(self, clock: Clockwork, armature: float) -> Array:
        """Put MuJoCo at the first pose; return where MuJoCo has the prescribed coordinates."""
        held: Array = self.columns[clock.columns]
        self.model.dof_armature[:] = 0.0
        self.model.dof_armature[held] = armature
        mujoco.mj_resetData(self.model, self.data)
        self.data.qpos[self.columns], self.data.qvel[self.columns] = self.q, self.qd
        return held

    def solve(self, setting: Setting, clock: Clockwork, order: int) -> list[Array]:
        """Return tree coordinates and rates up to an order at the scene's times."""
        stiff = setting.timeconst is not None
        solref, solimp = ((0.0, 1.0), (setting.impedance,) * 2) if stiff else SHIPPED
        self._set(setting.integrator, setting.solver, solref, solimp)
        held, model, data = self._reset(clock, FLYWHEEL), self.model, self.data
        levels = [np.empty((len(self.q), len(self.scene.times))) for _ in range(order + 1)]
        for k in range(len(self.scene.times)):
            data.qpos[held], data.qvel[held] = clock.values[0, k, 0], clock.values[1, k, 0]
            self._keep(levels, k)
            if k + 1 == len(self.scene.times):
                break
            model.opt.timestep = clock.step(k)
            if setting.timeconst is not None:
                model.eq_solref[:, 0] = setting.timeconst * clock.step(k)
            for step in range(setting.steps):
                data.qpos[held], data.qvel[held] = clock.values[0, k, step], clock.values[1, k, step]
                mujoco.mj_step(model, data)
        return self._restored(levels)

    def _keep(self, levels: list[Array], k: int) -> None:
        levels[0][:, k] = self.data.qpos[self.columns]
        if len(levels) > 1:
            levels[1][:, k] = self.data.qvel[self.columns]
        if len(levels) > 2:
            mujoco.mj_forward(self.model, self.data)
            levels[2][:, k] = self.data.qacc[self.columns]

    def relax(self, count: int, order: int) -> list[Array]:
        """Return tree coordinates at the scene's times: at each so many damped steps with the driver held still."""
        clock = self.tree.clockwork(1)
        self._set("DISCRETE", "NEWTON", (0.001, 1.0), (STIFF, STIFF))
        held, model, data = self._reset(clock, HEAVY), self.model, self.data
        model.opt.timestep, model.opt.tolerance = 1.0, 0.0
        model.opt.disableflags = self.flags | int(mujoco.mjtDisableBit.mjDSBL_REFSAFE)
        q = np.empty((len(self.q), len(self.scene.times)))
        for k in range(len(self.scene.times)):
            data.qvel[:] = 0.0
            for _ in range(count):
                data.qpos[held], data.qvel[held] = clock.values[0, k, 0], 0.0
                mujoco.mj_step(model, data)
            data.qpos[held] = clock.values[0, k, 0]
            q[:, k] = data.qpos[self.columns]
        return self._restored([q])

    def _restored(self, levels: list[Array]) -> list[Array]:
        """Return the levels, the constraints being again as the rows are read: without any stabilisation."""
        self.model.eq_solref[:] = 0.0
        self.model.dof_armature[:] = 0.0
        return levels
