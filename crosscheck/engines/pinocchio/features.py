"""Two of Pinocchio's features, as a reader of its documentation uses them.

`composite joints`: each body hangs on the ground by one JointModelComposite of PX, PY and RZ, so that q is (x, y, phi);
the drift term is the time variation of the Jacobian, times the rates. `point anchors with an offset`: a pin is one
PointAnchorConstraintModel between the frames of its bodies, the pin's place on body i its `desired_constraint_offset`;
rates come from the constraint's Jacobian, the drift term from its acceleration error.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from typing import Any

import numpy as np
import pinocchio as pin

from crosscheck.engines import Array, route_by
from crosscheck.engines.features import Pins, pins_of, with_rates
from crosscheck.engines.pinocchio.model import WORLD_AXES, Frame, absolute_model, shift
from refkin.joints import GROUND
from refkin.model import Scene
from refkin.motion import Motion, Route

COMPOSITE = route_by(
    "pinocchio",
    "composite joints",
    "adapter (by the method joint tree)",
    drift_by="pinocchio (getFrameJacobianTimeVariation)",
)
ANCHOR = replace(COMPOSITE, name="point anchors with an offset", drift_by="pinocchio (constraint_acceleration_error)")
FEATURES = (COMPOSITE, ANCHOR)


def with_feature(scene: Scene, motion: Motion, route: Route) -> Motion:
    """Return a motion of the method `joint tree` with its rates by a feature; raises EngineRefusal as `pins_of`."""
    pins = pins_of(scene, route)
    rows: Any = _Composite(pins) if route == COMPOSITE else _Anchors(pins)
    return with_rates(motion, pins, route, rows.jacobian, rows.drift)


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

    def _anchor(self, frames: dict[str, Frame], ends: Sequence[Any]) -> Any:
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
