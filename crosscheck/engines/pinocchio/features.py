"""Two of Pinocchio's features, as a reader of its documentation uses them.

`composite joints`: each body hangs on the ground by one JointModelComposite of PX, PY and RZ, so that q is (x, y, phi);
the drift term is the time variation of the Jacobian, times the rates. `point anchors with an offset`: a pin is one
PointAnchorConstraintModel between the frames of its bodies, the pin's place on body i its `desired_constraint_offset`;
rates come from the constraint's Jacobian, the drift term from its acceleration error.

A feature is a method of its own (`Use.FEATURE`); what the adapters make safe elsewhere is left as it is. A night asks
it of the scenes that are drawn for it (`crosscheck.scenes.featured`), and its answers are judged like any other.

`EFFECTS` is what Pinocchio's models hold beside kinematics, switched on one by one. Limits of position, effort and dry
friction, and damping, are numbers that a model keeps for whoever reads them: no algorithm that is called here does.
Switching them on shows just that.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import replace
from typing import Any

import numpy as np
import pinocchio as pin

from crosscheck.engines import Array, EngineRefusal, Switch, route_by
from crosscheck.engines.pinocchio.model import WORLD_AXES, PlacedFrame, PlanarModel, shift, tree_model
from crosscheck.engines.tree.joint_tree import absolute_tree
from crosscheck.engines.tree.tree_system import TreeEngine, TreeSystem
from refkin.joints import GROUND, Pair, PointsCoincide, RelativeAngle, elements_of
from refkin.model import Scene
from refkin.motion import Motion, Route, Status

COMPOSITE = route_by(
    "pinocchio",
    "composite joints",
    "adapter (by the method joint tree)",
    drift_by="pinocchio (getFrameJacobianTimeVariation)",
)
ANCHOR = replace(COMPOSITE, name="point anchors with an offset", drift_by="pinocchio (constraint_acceleration_error)")


class PinRows:
    """Pins and driven angles of a scene, and the rates that a feature's rows of the pins make of a motion.

    `ends` are those of each pin, ((body i, point), (body j, point)), in sizes; on the ground from the mechanism's first
    ground point. A scene that has anything else is refused. In sizes and rad, a feature has `jacobian`, q (3 bodies,)
    -> rows of the pins (m, 3 bodies), and `drift`, q and qd -> gamma (m,); `build` makes Pinocchio's model for them.
    """

    build: Any
    jacobian: Any
    drift: Any

    def __init__(self, scene: Scene, route: Route) -> None:
        self.scene, self.route, self.unit = scene, route, scene.mechanism.unit()
        self.bodies = tuple(body.name for body in scene.mechanism.bodies)
        self.ends: list[tuple[tuple[str, Pair], ...]] = []
        self.driven: list[RelativeAngle] = []
        for e in elements_of(scene.mechanism.constraints):
            if isinstance(e, PointsCoincide) and not e.laws:
                self.ends.append(tuple((body, self._scaled(body, point)) for body, point in e.ends))
            elif isinstance(e, RelativeAngle) and e.laws:
                self.driven.append(e)
            else:
                raise EngineRefusal(f"the feature {route.name!r} is asked for pins and driven angles, not for {e.key}")
        self.build()

    def _scaled(self, body: str, point: Pair) -> Pair:
        x, y = self.unit.origin if body == GROUND else (0.0, 0.0)
        return (point[0] - x) / self.unit.size, (point[1] - y) / self.unit.size

    def with_rates(self, motion: Motion) -> Motion:
        """Return a motion of all bodies, by the method `joint tree`, with rates from these rows."""
        columns = {name: 3 * k + 2 for k, name in enumerate(self.bodies)}
        turning = np.zeros((len(self.driven), 3 * len(self.bodies)))
        for row, e in zip(turning, self.driven, strict=True):
            for body, sign in ((e.body_i, -1.0), (e.body_j, 1.0)):
                if body != GROUND:
                    row[columns[body]] += sign
        scale = np.tile([self.unit.size, self.unit.size, 1.0], len(self.bodies))
        shift = np.tile([*self.unit.origin, 0.0], len(self.bodies))
        qd, qdd = np.full((2, *motion.q.shape), np.nan)
        for k in [k for k, status in enumerate(motion.status) if status is Status.OK]:
            q, t = (motion.q[:, k] - shift) / scale, self.scene.times[k]
            rate, bend = ([float(e.laws[0](t, order)) for e in self.driven] for order in (1, 2))
            rows = np.vstack([self.jacobian(q), turning])
            still = np.zeros(len(rows) - len(self.driven))
            speed = _solved(rows, np.append(still, rate))
            qd[:, k] = speed * scale
            qdd[:, k] = _solved(rows, np.append(self.drift(q, speed), bend)) * scale
        return replace(motion, qd=qd, qdd=qdd, producer=replace(motion.producer, route=self.route))


def _solved(rows: Array, right: Array) -> Array:
    try:
        return np.asarray(np.linalg.solve(rows, right), float)
    except np.linalg.LinAlgError:  # rows that are no derivatives may be dependent where the motion is regular
        return np.asarray(np.linalg.lstsq(rows, right, rcond=None)[0], float)


class _Composite(PinRows):
    """Rows of pins r_j - r_i, on bodies that hang on one composite joint each."""

    def build(self) -> None:
        self.model = pin.Model()
        joints = {GROUND: 0}
        for body in self.bodies:
            joint = pin.JointModelComposite()
            for kind in (pin.JointModelPX, pin.JointModelPY, pin.JointModelRZ):
                joint.addJoint(kind())
            joints[body] = self.model.addJoint(0, joint, pin.SE3.Identity(), body)
        self.frames = [
            [self.model.addFrame(pin.Frame(f"{k}{body}", joints[body], 0, shift(u), pin.OP_FRAME)) for body, u in ends]
            for k, ends in enumerate(self.ends)
        ]
        self.data = self.model.createData()

    def jacobian(self, q: Array) -> Array:
        pin.computeJointJacobians(self.model, self.data, q)
        pin.updateFramePlacements(self.model, self.data)
        return self._rows(pin.getFrameJacobian)

    def drift(self, q: Array, qd: Array) -> Array:
        pin.computeJointJacobiansTimeVariation(self.model, self.data, q, qd)
        pin.updateFramePlacements(self.model, self.data)
        return -self._rows(pin.getFrameJacobianTimeVariation) @ qd

    def _rows(self, read: Any) -> Array:
        slopes = [[read(self.model, self.data, end, WORLD_AXES)[:2] for end in ends] for ends in self.frames]
        return np.vstack([j - i for i, j in slopes])


class _Anchors(PinRows):
    """Rows of pins as point anchors, along the axes of body i."""

    def build(self) -> None:
        planar = tree_model(absolute_tree(self.bodies))
        self.model, self.data = planar.model, planar.data
        self.anchors = [self._anchor(planar.frames, ends) for ends in self.ends]
        self.states = [anchor.createData() for anchor in self.anchors]

    def _anchor(self, frames: dict[str, PlacedFrame], ends: Sequence[Any]) -> Any:
        (i, offset), (j, place) = ends
        at = (frames[i].joint, pin.SE3.Identity(), frames[j].joint, shift(place))
        anchor = pin.PointAnchorConstraintModel(self.model, *at)
        anchor.desired_constraint_offset = np.array([*offset, 0.0])
        return anchor

    def jacobian(self, q: Array) -> Array:
        pin.computeJointJacobians(self.model, self.data, q)
        return np.vstack([anchor.jacobian(self.model, self.data, state)[:2] for anchor, state in self._placed()])

    def drift(self, q: Array, qd: Array) -> Array:
        pin.forwardKinematics(self.model, self.data, q, qd, np.zeros(self.model.nv))
        return -np.concatenate([state.constraint_acceleration_error[:2] for _, state in self._placed()])

    def _placed(self) -> list[tuple[Any, Any]]:
        for anchor, state in zip(self.anchors, self.states, strict=True):
            anchor.calc(self.model, self.data, state)
        return list(zip(self.anchors, self.states, strict=True))


FEATURES = {COMPOSITE: _Composite, ANCHOR: _Anchors}
"""The rows of a scene's pins by each feature."""

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
        _with_mass(planar, 1.0, (0.0, 0.0))
        self.model = affected(planar, effect).model
        self.data = planar.data
        self.effort = np.full(self.model.nv, EFFORT if effect == "actuation" else 0.0)

    def __call__(self, q: Array, qd: Array, t: float) -> Array:
        """Return qdd (n,)."""
        at = q[None], np.array([t])
        jacobian, drift = self.system.rows(*at)[1][0], -self.system.gamma(q[None], qd[None], at[1])[0]
        return np.array(pin.forwardDynamics(self.model, self.data, q, qd, self.effort, jacobian, drift, 0.0))


def _with_mass(planar: PlanarModel, mass: float, lever: tuple[float, float]) -> None:
    """Give every joint's body a mass and as much inertia, in the model's units, at a lever from the joint."""
    for joint in range(1, planar.model.njoints):
        planar.model.inertias[joint] = pin.Inertia(mass, np.array([*lever, 0.0]), mass * np.eye(3))


def _gravity(planar: PlanarModel) -> None:
    planar.model.gravity.linear = np.array([0.0, -9.81, 0.0])


def _filled(**numbers: float) -> Callable[[PlanarModel], None]:
    """Return what fills some vectors of a model, each with one number."""

    def switch(planar: PlanarModel) -> None:
        for key, value in numbers.items():
            getattr(planar.model, key)[:] = value

    return switch


EFFECTS = {
    "gravity": Switch("9.81 across the plane's x axis", _gravity),
    "friction": Switch(
        f"dry friction limits of 1 in every joint, {UNREAD}",
        _filled(lowerDryFrictionLimit=-1.0, upperDryFrictionLimit=1.0),
    ),
    "joint limits": Switch(
        f"every joint limited to 1e-3 about zero, {UNREAD}", _filled(lowerPositionLimit=-1e-3, upperPositionLimit=1e-3)
    ),
    "passive forces": Switch(f"damping 1 in every joint, {UNREAD}", _filled(damping=1.0)),
    "actuation": Switch(
        "an effort of 10 in every joint, where a method takes efforts",
        _filled(lowerEffortLimit=-EFFORT, upperEffortLimit=EFFORT),
    ),
    "inertia": Switch("seven times the mass, off the joints", lambda planar: _with_mass(planar, 7.0, (0.3, 0.1))),
}

MISSING = {
    "contact": "Pinocchio keeps geometry in a model of its own, which no call of the adapter takes",
    "sensors": "Pinocchio has no sensors",
}
