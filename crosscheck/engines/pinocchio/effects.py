"""What Pinocchio's models hold beside kinematics, switched on one by one, and the accelerations of its dynamics.

Limits of position, effort and dry friction, and damping, are numbers that a model keeps for whoever reads them: no
algorithm that is called here does. Switching them on shows just that.
"""

from __future__ import annotations

import numpy as np
import pinocchio as pin

from crosscheck.engines import Switch
from crosscheck.engines.pinocchio.model import PlanarModel, tree_model
from crosscheck.engines.tree.joint_tree import Array
from crosscheck.engines.tree.tree_system import TreeEngine, TreeSystem

UNREAD = "which no algorithm called here reads"
EFFORT = 10.0
"""What each joint is pushed with where actuation is on."""


def affected(planar: PlanarModel, effect: str | None) -> PlanarModel:
    """Return a model with one of `EFFECTS` switched on, or as it is."""
    if effect is not None:
        EFFECTS[effect].switch(planar)
        planar.begin()
    return planar


class ForwardDynamics:
    """Accelerations by `forwardDynamics`: Pinocchio's masses, and its solution of the constrained equations of motion.

    Masses are 1 unless the effect brings others. Constraint rows and their right side are those of the kinematic route.
    """

    def __init__(self, engine: TreeEngine, effect: str | None) -> None:
        self.system = TreeSystem(engine)
        planar = tree_model(engine.tree)  # a model of its own: the kinematic one has no masses
        with_mass(planar, 1.0, (0.0, 0.0))
        self.model = affected(planar, effect).model
        self.data = planar.data
        self.effort = np.full(self.model.nv, EFFORT if effect == "actuation" else 0.0)

    def __call__(self, q: Array, qd: Array, t: float) -> Array:
        """Return qdd (n,)."""
        at = q[None], np.array([t])
        jacobian, drift = self.system.rows(*at)[1][0], -self.system.gamma(q[None], qd[None], at[1])[0]
        return np.array(pin.forwardDynamics(self.model, self.data, q, qd, self.effort, jacobian, drift, 0.0))


def with_mass(planar: PlanarModel, mass: float, lever: tuple[float, float]) -> None:
    """Give every joint's body a mass and as much inertia, at a lever from the joint."""
    for joint in range(1, planar.model.njoints):
        planar.model.inertias[joint] = pin.Inertia(mass, np.array([*lever, 0.0]), mass * np.eye(3))


def _gravity(planar: PlanarModel) -> None:
    planar.model.gravity.linear = np.array([0.0, -9.81, 0.0])


def _friction(planar: PlanarModel) -> None:
    planar.model.lowerDryFrictionLimit[:], planar.model.upperDryFrictionLimit[:] = -1.0, 1.0


def _limits(planar: PlanarModel) -> None:
    planar.model.lowerPositionLimit[:], planar.model.upperPositionLimit[:] = -1e-3, 1e-3


def _passive(planar: PlanarModel) -> None:
    planar.model.damping[:] = 1.0


def _actuation(planar: PlanarModel) -> None:
    planar.model.lowerEffortLimit[:], planar.model.upperEffortLimit[:] = -EFFORT, EFFORT


EFFECTS = {
    "gravity": Switch("9.81 across the plane's x axis", _gravity),
    "friction": Switch(f"dry friction limits of 1 in every joint, {UNREAD}", _friction),
    "joint limits": Switch(f"every joint limited to 1e-3 about zero, {UNREAD}", _limits),
    "passive forces": Switch(f"damping 1 in every joint, {UNREAD}", _passive),
    "actuation": Switch("an effort of 10 in every joint, where a method takes efforts", _actuation),
    "inertia": Switch("seven times the mass, off the joints", lambda planar: with_mass(planar, 7.0, (0.3, 0.1))),
}

MISSING = {
    "contact": "Pinocchio keeps geometry in a model of its own, which no call of the adapter takes",
    "sensors": "Pinocchio has no sensors",
}
