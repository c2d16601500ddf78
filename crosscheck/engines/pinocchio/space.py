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
from crosscheck.engines.spatial.system import Place, SpaceEngine
from crosscheck.engines.spatial.tree import QUARTER, SpaceTree, SpatialEdge
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
        ends = [(*self.frames[j], *self.frames[i], WORLD_AXES) for i, j in pairs]
        self.constraints = [pin.RigidConstraintModel(pin.ContactType.CONTACT_3D, self.model, *two) for two in ends]
        self.pairs = np.array(pairs, int).reshape(-1, 2)
        self.data = self.model.createData()
        self.contacts = [constraint.createData() for constraint in self.constraints]
        self._rest = np.zeros(self.model.nv)

    def _hang(self, edge: SpatialEdge) -> tuple[int, Any]:
        """Add the joints of an edge; return the last of them, and the body's frame in it."""
        joint, at = self.bodies[edge.parent]
        place = at * pin.SE3(edge.frame_parent, edge.u_parent)
        for kind, before in _joints(edge):
            joint = self.model.addJoint(joint, kind, place * before, f"{edge.body} {self.model.njoints}")
            place = pin.SE3.Identity()
        back = pin.SE3(edge.frame_body, edge.u_body).inverse()
        return (joint, back) if edge.kind != JointKind.FIXED else (joint, place * back)

    def still(self, q: Array) -> tuple[Array, Array, Array, Array, Array]:
        model, data, nv = self.model, self.data, self.model.nv
        pin.computeJointJacobians(model, data, self.coordinates(q))
        placed = [data.oMi[joint] * at for joint, at in self.frames]
        jac = np.zeros((len(placed), 6, nv))
        for k, (joint, at) in enumerate(self.frames):
            if joint:
                jac[k] = pin.getFrameJacobian(model, data, joint, at, WORLD_AXES).reshape(6, nv)
        gap, slopes = np.empty((len(self.contacts), 3)), np.empty((len(self.contacts), 3, nv))
        for k, (constraint, contact) in enumerate(zip(self.constraints, self.contacts, strict=True)):
            constraint.calc(model, data, contact)
            gap[k] = contact.oMc1.translation - contact.oMc2.translation
            slopes[k] = pin.getConstraintJacobian(model, data, constraint, contact).reshape(3, nv)
        r, axes = np.array([m.translation for m in placed]), np.array([m.rotation for m in placed])
        return r, axes, jac, gap, slopes

    def moving(self, q: Array, rates: Array, accelerations: Array | None) -> tuple[Array, Array, Array]:
        model, data = self.model, self.data
        rest = self._rest if accelerations is None else accelerations
        pin.forwardKinematics(model, data, self.coordinates(q), rates, rest)
        vel, acc = np.zeros((2, len(self.frames), 6))
        for k, (joint, at) in enumerate(self.frames):
            if joint:
                vel[k] = pin.getFrameVelocity(model, data, joint, at, WORLD_AXES).vector
                acc[k] = pin.getFrameClassicalAcceleration(model, data, joint, at, WORLD_AXES).vector
        return vel, acc, acc[self.pairs[:, 1], :3] - acc[self.pairs[:, 0], :3]

    def coordinates(self, q: Array) -> Array:
        """Return Pinocchio's q: Euler parameters of length 1, the scalar last."""
        out = np.array(q, float)
        for ball in self.tree.balls:
            p = q[ball] / np.linalg.norm(q[ball])
            out[ball] = [p[1], p[2], p[3], p[0]]
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
