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
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
import pinocchio as pin

from crosscheck.engines import Array, EngineRefusal, Switch, route_by
from crosscheck.engines.pinocchio.model import WORLD_AXES, PlacedFrame, PlanarModel, absolute_model, shift, tree_model
from crosscheck.engines.tree.tree_system import TreeEngine, TreeSystem
from refkin.joints import GROUND, Pair, PointsCoincide, RelativeAngle, Unit, elements_of
from refkin.model import Scene
from refkin.motion import Motion, Route, Status


@dataclass(frozen=True)
class Pins:
    """What features are asked about: pins, and angles that laws drive.

    Attributes
    ----------
    ends : sequence of ((body i, point), (body j, point))
        Of each pin, in sizes; on the ground from the mechanism's first ground point.
    """

    bodies: tuple[str, ...]
    times: Sequence[float]
    unit: Unit
    ends: Sequence[tuple[tuple[str, Pair], ...]]
    driven: Sequence[RelativeAngle]


def pins_of(scene: Scene, route: Route) -> Pins:
    """Return the pins and driven angles of a scene; refuse one that has anything else."""
    unit, ends, driven = scene.mechanism.unit(), [], []
    for e in elements_of(scene.mechanism.constraints):
        if isinstance(e, PointsCoincide) and not e.laws:
            ends.append(tuple((body, _scaled(unit, body, point)) for body, point in e.ends))
        elif isinstance(e, RelativeAngle) and e.laws:
            driven.append(e)
        else:
            raise EngineRefusal(f"the feature {route.name!r} is asked for pins and driven angles, not for {e.key}")
    return Pins(tuple(body.name for body in scene.mechanism.bodies), scene.times, unit, ends, driven)


def _scaled(unit: Unit, body: str, point: Pair) -> Pair:
    x, y = unit.origin if body == GROUND else (0.0, 0.0)
    return (point[0] - x) / unit.size, (point[1] - y) / unit.size


def _with_rates(
    motion: Motion, pins: Pins, route: Route, jacobian: Callable[[Array], Array], drift: Callable[[Array, Array], Array]
) -> Motion:
    """Return a motion of all bodies with velocity and acceleration from a feature's rows of the pins.

    In sizes and rad these are q (3 bodies,) -> rows of the pins (m, 3 bodies), and q, qd -> gamma (m,).
    """
    columns = {name: 3 * k + 2 for k, name in enumerate(pins.bodies)}
    turning = np.zeros((len(pins.driven), 3 * len(pins.bodies)))
    for row, e in zip(turning, pins.driven, strict=True):
        for body, sign in ((e.body_i, -1.0), (e.body_j, 1.0)):
            if body != GROUND:
                row[columns[body]] += sign
    scale = np.tile([pins.unit.size, pins.unit.size, 1.0], len(pins.bodies))
    shift = np.tile([*pins.unit.origin, 0.0], len(pins.bodies))
    qd, qdd = np.full((2, *motion.q.shape), np.nan)
    for k in [k for k, status in enumerate(motion.status) if status is Status.OK]:
        q, t = (motion.q[:, k] - shift) / scale, pins.times[k]
        rate, bend = ([float(e.laws[0](t, order)) for e in pins.driven] for order in (1, 2))
        rows = np.vstack([jacobian(q), turning])
        still = np.zeros(len(rows) - len(pins.driven))
        speed = _solved(rows, np.append(still, rate))
        qd[:, k] = speed * scale
        qdd[:, k] = _solved(rows, np.append(drift(q, speed), bend)) * scale
    return replace(motion, qd=qd, qdd=qdd, producer=replace(motion.producer, route=route))


def _solved(rows: Array, right: Array) -> Array:
    try:
        return np.asarray(np.linalg.solve(rows, right), float)
    except np.linalg.LinAlgError:  # rows that are no derivatives may be dependent where the motion is regular
        return np.asarray(np.linalg.lstsq(rows, right, rcond=None)[0], float)


COMPOSITE = route_by(
    "pinocchio",
    "composite joints",
    "adapter (by the method joint tree)",
    drift_by="pinocchio (getFrameJacobianTimeVariation)",
)
ANCHOR = replace(COMPOSITE, name="point anchors with an offset", drift_by="pinocchio (constraint_acceleration_error)")
FEATURES = (COMPOSITE, ANCHOR)


def with_feature(scene: Scene, motion: Motion, route: Route) -> Motion:
    """Return a motion with its rates by a feature; raises EngineRefusal as `pins_of`.

    Parameters
    ----------
    scene, motion, route : Scene, Motion, Route
        A motion by the method `joint tree`, whose positions are used; which feature.
    """
    pins = pins_of(scene, route)
    rows: Any = _Composite(pins) if route == COMPOSITE else _Anchors(pins)
    return _with_rates(motion, pins, route, rows.jacobian, rows.drift)


class _Composite:
    """Rows of pins r_j - r_i, on bodies that hang on one composite joint each."""

    def __init__(self, pins: Pins) -> None:
        self.model = pin.Model()
        joints = {GROUND: 0}
        for body in pins.bodies:
            joint = pin.JointModelComposite()
            for kind in (pin.JointModelPX, pin.JointModelPY, pin.JointModelRZ):
                joint.addJoint(kind())
            joints[body] = self.model.addJoint(0, joint, pin.SE3.Identity(), body)
        self.frames = [
            [self.model.addFrame(pin.Frame(f"{k}{body}", joints[body], 0, shift(u), pin.OP_FRAME)) for body, u in ends]
            for k, ends in enumerate(pins.ends)
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


class _Anchors:
    """Rows of pins as point anchors, along the axes of body i."""

    def __init__(self, pins: Pins) -> None:
        planar = absolute_model(pins.bodies)
        self.model, self.data = planar.model, planar.data
        self.anchors = [self._anchor(planar.frames, ends) for ends in pins.ends]
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
    """Give every joint's body a mass and as much inertia, at a lever from the joint.

    Parameters
    ----------
    planar, mass, lever : PlanarModel, float, (x, y)
        The model is changed, in its own units; the lever leads from the joint to the centre of mass.
    """
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
        f"every joint limited to 1e-3 about zero, {UNREAD}",
        _filled(lowerPositionLimit=-1e-3, upperPositionLimit=1e-3),
    ),
    "passive forces": Switch(f"damping 1 in every joint, {UNREAD}", _filled(damping=1.0)),
    "actuation": Switch(
        "an effort of 10 in every joint, where a method takes efforts",
        _filled(lowerEffortLimit=-EFFORT, upperEffortLimit=EFFORT),
    ),
    "inertia": Switch("seven times the mass, off the joints", lambda planar: with_mass(planar, 7.0, (0.3, 0.1))),
}

MISSING = {
    "contact": "Pinocchio keeps geometry in a model of its own, which no call of the adapter takes",
    "sensors": "Pinocchio has no sensors",
}
