"""Pinocchio's model of a joint tree of space: joints, places on bodies, and its own constraint between two points.

Joints: RZ, PZ, PZ then RZ, two RZ a quarter turn apart, Spherical (x, y, z, w; rates in the body's axes), and
HelicalUnaligned, which counts metres for each radian. A free body is a Translation and a Spherical: of a free-flyer or
a composite, zero acceleration is not zero r''.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np
import pinocchio as pin

from crosscheck.engines.pinocchio.model import WORLD_AXES
from crosscheck.engines.spatial.kinds import JointKind
from crosscheck.engines.spatial.system import Place, SpaceEngine, State, at_places
from crosscheck.engines.spatial.tree import QUARTER, SpaceTree, SpatialEdge
from crosscheck.engines.spatial.turning import length
from refkin.joints import GROUND

Array = Any


class PinocchioSpace(SpaceEngine):
    """Pinocchio's model of a joint tree of space."""

    def __init__(self, tree: SpaceTree, places: Sequence[Place], pairs: Sequence[tuple[int, int]]) -> None:
        self.tree = tree
        self.model = pin.Model()
        self.bodies: dict[str, tuple[int, Any]] = {GROUND: (0, pin.SE3.Identity())}
        for edge in tree.edges:
            self.bodies[edge.body] = self._hang(edge)
        self.model.gravity.setZero()
        self.frames = [(self.bodies[p.body][0], self.bodies[p.body][1] * pin.SE3(p.axes, p.u)) for p in places]
        self._joints = np.array([joint for joint, _ in self.frames], int)
        self._u = np.array([at.translation for _, at in self.frames]).reshape(-1, 3)
        self._axes = np.array([at.rotation for _, at in self.frames]).reshape(-1, 3, 3)
        ends = [(*self.frames[j], *self.frames[i], WORLD_AXES) for i, j in pairs]
        self.constraints = [pin.RigidConstraintModel(pin.ContactType.CONTACT_3D, self.model, *two) for two in ends]
        self.pairs = np.array(pairs, int).reshape(-1, 2)
        self.data = self.model.createData()
        self.contacts = [constraint.createData() for constraint in self.constraints]
        self._moves = self._moved()
        # Views, which Pinocchio fills; one column it has as a vector.
        self._columns = self.data.J
        self._placed = [(placed.rotation, placed.translation) for placed in self.data.oMi]
        self._held = [
            (constraint, contact, contact.oMc1.translation, contact.oMc2.translation)
            for constraint, contact in zip(self.constraints, self.contacts, strict=True)
        ]

    def _moved(self) -> Array:
        """Return which rates move a place, 1 or 0, (P, 1, v)."""
        moves = np.zeros((self.model.njoints, 1, self.model.nv))
        for joint in range(1, self.model.njoints):
            first = self.model.idx_vs[joint]
            moves[joint] = moves[self.model.parents[joint]]
            moves[joint, 0, first : first + self.model.nvs[joint]] = 1.0
        return moves[self._joints]

    def _hang(self, edge: SpatialEdge) -> tuple[int, Any]:
        """Add the joints of an edge; return the last of them, and the body's frame in it."""
        joint, at = self.bodies[edge.parent]
        place = at * pin.SE3(edge.frame_parent, edge.u_parent)
        for kind, before in _joints(edge):
            joint = self.model.addJoint(joint, kind, place * before, f"{edge.body} {self.model.njoints}")
            place = pin.SE3.Identity()
        back = pin.SE3(edge.frame_body, edge.u_body).inverse()
        return (joint, back) if edge.kind != JointKind.FIXED else (joint, place * back)

    def still(self, q: Array) -> State:
        model, data, count, nv = self.model, self.data, len(q), self.model.nv
        turned, shifted = np.empty((count, model.njoints, 3, 3)), np.empty((count, model.njoints, 3))
        columns, slopes = np.empty((count, *self._columns.shape)), np.empty((count, len(self.contacts), 3, nv))
        gap = np.empty((count, len(self.contacts), 3))
        for k, at in enumerate(self.coordinates(q)):
            pin.computeJointJacobians(model, data, at)
            columns[k] = self._columns
            for joint, (rotation, translation) in enumerate(self._placed):
                turned[k, joint], shifted[k, joint] = rotation, translation
            for n, (constraint, contact, one, other) in enumerate(self._held):
                constraint.calc(model, data, contact)
                gap[k, n] = one - other
                slopes[k, n] = pin.getConstraintJacobian(model, data, constraint, contact).reshape(3, nv)
        columns = columns.reshape(count, 6, nv)
        turned = turned.take(self._joints, axis=1)
        r = shifted.take(self._joints, axis=1) + (turned @ self._u[:, :, None])[..., 0]
        return State(r, turned @ self._axes, at_places(columns, r, self._moves), gap, slopes)

    def moving(self, q: Array, rates: Array, accelerations: Array | None) -> tuple[Array, Array, Array]:
        model, data = self.model, self.data
        rest = np.zeros_like(rates) if accelerations is None else accelerations
        vel, acc = np.zeros((2, len(q), len(self.frames), 6))
        for k, at in enumerate(zip(self.coordinates(q), rates, rest, strict=True)):
            pin.forwardKinematics(model, data, *at)
            for n, (joint, frame) in enumerate(self.frames):
                if joint:
                    vel[k, n] = pin.getFrameVelocity(model, data, joint, frame, WORLD_AXES).vector
                    acc[k, n] = pin.getFrameClassicalAcceleration(model, data, joint, frame, WORLD_AXES).vector
        return vel, acc, acc[:, self.pairs[:, 1], :3] - acc[:, self.pairs[:, 0], :3]

    def coordinates(self, q: Array) -> Array:
        """Return Pinocchio's q (..., n): Euler parameters of length 1, the scalar last."""
        out = np.array(q, float)
        for ball in self.tree.balls:
            p = q[..., ball]
            out[..., ball] = (p / length(p)).take([1, 2, 3, 0], -1)
        return out


def _joints(edge: SpatialEdge) -> list[tuple[Any, Any]]:
    """Return Pinocchio's joints of an edge, each with what lies before it."""
    here, turned = pin.SE3.Identity(), pin.SE3(QUARTER, np.zeros(3))
    z = np.array([0.0, 0.0, 1.0])
    if edge.kind == JointKind.SCREW:
        return [(pin.JointModelHelicalUnaligned(z, edge.pitch), pin.SE3(np.eye(3), z * edge.shift))]
    kinds: dict[str, list[tuple[Any, Any]]] = {
        JointKind.REVOLUTE: [(pin.JointModelRZ(), here)],
        JointKind.PRISMATIC: [(pin.JointModelPZ(), here)],
        JointKind.CYLINDRICAL: [(pin.JointModelPZ(), here), (pin.JointModelRZ(), here)],
        JointKind.UNIVERSAL: [(pin.JointModelRZ(), here), (pin.JointModelRZ(), turned)],
        JointKind.SPHERICAL: [(pin.JointModelSpherical(), here)],
        JointKind.FREE: [(pin.JointModelTranslation(), here), (pin.JointModelSpherical(), here)],
        JointKind.FIXED: [],
    }
    return kinds[edge.kind]
