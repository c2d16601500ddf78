"""Pinocchio stepping in time: its constrained dynamics with and without Baumgarte's terms.

Pinocchio integrates nothing in time: Euler and Runge-Kutta are the adapter's, on `constraintDynamics`. The prescribed
coordinates are overwritten before each step, with an armature beside which no constraint force moves them; stepping
starts at a closed pose with consistent velocities.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator
from functools import partial
from typing import Any

import numpy as np
import pinocchio as pin

from crosscheck.engines import EngineError
from crosscheck.engines.methods import Method, Model, Use
from crosscheck.engines.pinocchio.engine import Pinocchio, PinocchioTree
from crosscheck.engines.tree.joint_tree import Array, joint_tree
from crosscheck.engines.tree.newton import NOBODY, Clockwork, Tree
from refkin.joints import PointsCoincide
from refkin.model import Scene

FLYWHEEL = 1e12
"""Armature of a prescribed coordinate, 1 for the others: there are no masses."""
COMPLIANCE, ACCURACY, ITERATIONS = 1e-10, 1e-14, 20
"""The proximal settings of the constrained dynamics: its z rows are redundant, with no compliance it gives NaN."""
BAUMGARTE = 0.25
"""Baumgarte's rate a (terms 2 a v + a^2 g) times the step: well inside what Euler's rule can bear, a h < 2."""
STEPPING = {
    "constraintDynamics, Euler": ("euler", False, (1, 3, 10)),
    "constraintDynamics, Euler, Baumgarte": ("euler", True, (1, 3, 10)),
    "constraintDynamics, RK4": ("rk4", False, (1, 3, 10)),
    "constraintDynamics, RK4, Baumgarte": ("rk4", True, (1, 3, 10)),
}

Acceleration = Callable[[Array, Array, Array], Array]
"""Accelerations of the prescribed coordinates, q, qd -> those of all."""


def stepping_methods() -> Iterator[Method]:
    """Yield the integration of its constrained dynamics at all settings."""
    for name, (rule, stabilised, counts) in STEPPING.items():
        for steps in counts:
            yield Method(
                engine="pinocchio",
                name=name,
                setting=f"{steps} step{'s' * (steps > 1)} between times",
                newton_by=NOBODY,
                uses=frozenset({Use.PRICE}),
                build=partial(_stepped, RULES[rule], stabilised, steps),
                steps=True,
                note="integrated by the adapter" + f"; a h = {BAUMGARTE}" * stabilised,
            )


def _stepped(rule: Any, stabilised: bool, steps: int, scene: Scene) -> Model:
    stepper = Stepper(tree_of(scene))
    return Model(partial(stepper.solve, rule, stabilised, stepper.clockwork(steps)), stepper.tree.read)


def tree_of(scene: Scene) -> Tree:
    """Return a scene as Pinocchio's joint tree; raises as `Tree.of`."""
    return Tree.of(Pinocchio(), lambda mechanism: PinocchioTree(joint_tree(mechanism, massless_links=True)), scene)


class Stepper:
    """A scene in Pinocchio's constrained dynamics.

    Raises
    ------
    EngineError
        If a loop is closed by another joint than a revolute, or a driver holds no coordinate of the tree.
    """

    def __init__(self, tree: Tree) -> None:
        self.tree, self.scene = tree, tree.scene
        closures = tree.system.tree.closures
        other = [element for element in closures if not isinstance(element, PointsCoincide)]
        if other or not closures:
            which = f"joint {other[0].name!r} closes a loop" if other else "no joint closes a loop"
            raise EngineError(f"{which}: only revolute joints are priced in its constrained dynamics")
        held = self.clockwork(1).columns
        engine: Any = tree.engine
        self.constraints, self.constraint_data = engine.contacts()
        self.model, self.data = engine.planar.model, engine.planar.model.createData()
        armature = np.ones(self.model.nv)
        armature[held] = FLYWHEEL
        self.model.armature = armature
        pin.initConstraintDynamics(self.model, self.data, self.constraints, self.constraint_data)
        self.settings = pin.ProximalSettings(ACCURACY, COMPLIANCE, ITERATIONS)
        self.q, self.qd = tree.first()

    def clockwork(self, steps: int) -> Clockwork:
        """Return the prescribed coordinates at the beginning and the middle of so many steps between two times."""
        return Clockwork.of(self.tree.system.tree, self.scene.times, 2 * steps)

    def solve(self, rule: Any, stabilised: bool, clock: Clockwork, order: int) -> list[Array]:
        """Return tree coordinates and rates up to an order at the scene's times."""
        q, qd, held = self.q.copy(), self.qd.copy(), clock.columns
        levels = [np.empty((len(q), len(self.scene.times))) for _ in range(order + 1)]
        steps = clock.times.shape[1] // 2
        values = clock.values.reshape(3, -1, len(held))
        for k in range(len(self.scene.times)):
            at = 2 * steps * k
            q[held], qd[held] = values[:2, at]
            for level, row in zip(levels, (q, qd), strict=False):
                level[:, k] = row
            if order > 1:
                levels[2][:, k] = self._acceleration(held, values[2, at], q, qd)
            if k + 1 == len(self.scene.times):
                break
            h = 2.0 * clock.step(k)
            self._stabilise(BAUMGARTE / h if stabilised else 0.0)
            for _ in range(steps):
                q[held], qd[held] = values[:2, at]
                q, qd = rule(partial(self._acceleration, held), values[2, at : at + 3], q, qd, h)
                at += 2
        return levels

    def _stabilise(self, rate: float) -> None:
        for constraint in self.constraints:
            constraint.m_baumgarte_parameters = pin.BaumgarteCorrectorParameters(rate * rate, 2.0 * rate)

    def _acceleration(self, held: Array, prescribed: Array, q: Array, qd: Array) -> Array:
        """Return the acceleration (n,) that Pinocchio gives, the prescribed coordinates being driven."""
        force = np.zeros(self.model.nv)
        force[held] = FLYWHEEL * prescribed
        system = (self.model, self.data, q, qd, force, self.constraints, self.constraint_data, self.settings)
        acceleration: Array = pin.constraintDynamics(*system)
        return acceleration


def _euler(acceleration: Acceleration, prescribed: Array, q: Array, qd: Array, h: float) -> tuple[Array, Array]:
    """Return the state after a step of Euler's semi-implicit rule."""
    qd = qd + h * acceleration(prescribed[0], q, qd)
    return q + h * qd, qd


def _rk4(acceleration: Acceleration, prescribed: Array, q: Array, qd: Array, h: float) -> tuple[Array, Array]:
    """Return the state after a step of the classical Runge-Kutta rule."""
    a1 = acceleration(prescribed[0], q, qd)
    v2 = qd + h / 2 * a1
    a2 = acceleration(prescribed[1], q + h / 2 * qd, v2)
    v3 = qd + h / 2 * a2
    a3 = acceleration(prescribed[1], q + h / 2 * v2, v3)
    v4 = qd + h * a3
    a4 = acceleration(prescribed[2], q + h * v3, v4)
    return q + h / 6 * (qd + 2 * v2 + 2 * v3 + v4), qd + h / 6 * (a1 + 2 * a2 + 2 * a3 + a4)


RULES = {"euler": _euler, "rk4": _rk4}
