"""MuJoCo's model of a joint tree of space: bodies, joints, sites, and its own equality `connect` between two points.

Joints: hinge, slide, slide and hinge, two hinges, ball (w, x, y, z; rates in the body's axes). MuJoCo's body lies at
its joint, so a pose of the specification is that of coordinates zero, computed from the scene's numbers. A screw is a
slide that the adapter moves with its hinge, a free body three slides and a ball.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np

from crosscheck.engines import EngineError
from crosscheck.engines.mujoco.model import MASSES, add_equality, compiled, kinematic_spec, mujoco
from crosscheck.engines.spatial.kinds import JointKind
from crosscheck.engines.spatial.system import Place, SpaceEngine
from crosscheck.engines.spatial.tree import QUARTER, SpaceTree, SpatialEdge
from crosscheck.engines.spatial.turning import parameters
from refkin.joints import GROUND

Array = Any
HINGE, SLIDE, BALL = mujoco.mjtJoint.mjJNT_HINGE, mujoco.mjtJoint.mjJNT_SLIDE, mujoco.mjtJoint.mjJNT_BALL
X, Y, Z = [1.0, 0.0, 0.0], [0.0, 1.0, 0.0], [0.0, 0.0, 1.0]
JOINTS: dict[str, list[tuple[Any, list[float]]]] = {
    JointKind.REVOLUTE: [(HINGE, Z)],
    JointKind.PRISMATIC: [(SLIDE, Z)],
    JointKind.CYLINDRICAL: [(SLIDE, Z), (HINGE, Z)],
    JointKind.SCREW: [(SLIDE, Z), (HINGE, Z)],
    JointKind.UNIVERSAL: [(HINGE, Y), (HINGE, Z)],  # the first axis is that of the parent, QUARTER^T z
    JointKind.SPHERICAL: [(BALL, Z)],
    JointKind.FREE: [(SLIDE, X), (SLIDE, Y), (SLIDE, Z), (BALL, Z)],
    JointKind.FIXED: [],
}


class MujocoSpace(SpaceEngine):
    """MuJoCo's model of a joint tree of space."""

    def __init__(
        self,
        tree: SpaceTree,
        places: Sequence[Place],
        pairs: Sequence[tuple[int, int]],
        welds: Sequence[tuple[int, int]] = (),
    ) -> None:
        self.tree, self.places = tree, places
        self.spec = kinematic_spec()
        self.bodies: dict[str, Any] = {GROUND: self.spec.worldbody}
        self.frames: dict[str, tuple[Any, Any]] = {GROUND: (np.zeros(3), np.eye(3))}
        self._names: list[str] = []
        for k, edge in enumerate(tree.edges):
            self._hang(k, edge)
        for k, pair in enumerate(pairs):
            self._equality(f"pair {k}", mujoco.mjtEq.mjEQ_CONNECT, *pair)
        for k, pair in enumerate(welds):
            self._equality(f"weld {k}", mujoco.mjtEq.mjEQ_WELD, *pair)
        self._add()
        self.pairs, self.welded_from = pairs, 3 * len(pairs)
        self._owners = np.repeat(np.arange(len(pairs) + len(welds)), [3] * len(pairs) + [6] * len(welds))
        self.model = compiled(self.spec)
        self.model.body_sameframe[:] = 0
        self.data = mujoco.MjData(self.model)
        joints = [self.model.joint(name) for name in self._names]
        self.columns = np.array([j.qposadr[0] + k for j in joints for k in range(len(j.qpos0))], int)
        self._v = np.array([j.dofadr[0] + k for j in joints for k in range((1, 3)[len(j.qpos0) > 1])], int)
        self._from_tree = self._columns()
        self._at = [(self.bodies[p.body].id, *self._local(p)) for p in places]

    def _add(self) -> None:
        """Add nothing more to the specification before it is compiled."""

    def _hang(self, k: int, edge: SpatialEdge) -> None:
        u, frame = self.frames[edge.parent]
        turned = edge.frame_parent @ QUARTER if edge.kind == JointKind.UNIVERSAL else edge.frame_parent
        place, joints = edge.u_parent + edge.frame_parent[:, 2] * edge.shift, JOINTS[edge.kind]
        body = self.bodies[edge.parent].add_body(
            name=f"b{k}", pos=frame.T @ (place - u), quat=parameters(frame.T @ turned), **MASSES[bool(joints)]
        )
        for kind, axis in joints:
            self._names.append(f"q{len(self._names)}")
            body.add_joint(name=self._names[-1], type=kind, axis=axis)
        self.bodies[edge.body], self.frames[edge.body] = body, (edge.u_body, edge.frame_body)

    def _local(self, place: Place) -> tuple[Any, Any]:
        """Return a place's point and axes in the frame of MuJoCo's body."""
        u, frame = self.frames[place.body]
        return frame.T @ (place.u - u), frame.T @ place.axes

    def _equality(self, name: str, kind: Any, i: int, j: int) -> None:
        for side, k in (("i", i), ("j", j)):
            u, axes = self._local(self.places[k])
            self.bodies[self.places[k].body].add_site(name=f"{name} {side}", pos=u, quat=parameters(axes))
        add_equality(self.spec, kind, mujoco.mjtObj.mjOBJ_SITE, f"{name} j", f"{name} i", solref=[0.0, 0.0])

    def _columns(self) -> Array:
        """Return what makes rates of MuJoCo's joints, in the order of edges, of those of the tree: a screw has two."""
        total = sum(edge.rates for edge in self.tree.edges)
        rows, first = [], 0
        for edge in self.tree.edges:
            own = np.eye(total)[first : first + edge.rates]
            rows += [edge.pitch * own, own] if edge.kind == JointKind.SCREW else [own]
            first += edge.rates
        return np.concatenate(rows)

    def coordinates(self, q: Array) -> list[float]:
        """Return coordinates of the tree as those of MuJoCo's joints, edge by edge: of a screw two."""
        values: list[float] = []
        for edge in self.tree.edges:
            part = list(q[edge.slot])
            if edge.kind == JointKind.SCREW:
                part = [edge.pitch * part[0], part[0]]
            if edge.turned.stop:
                p = q[edge.turned]
                part[-4:] = p / np.linalg.norm(p)
            values += part
        return values

    def _place(self, q: Array) -> None:
        self.data.qpos[self.columns] = self.coordinates(q)
        mujoco.mj_kinematics(self.model, self.data)
        mujoco.mj_comPos(self.model, self.data)
        mujoco.mj_makeConstraint(self.model, self.data)
        self._present = np.isin(self._owners, self.data.efc_id[: self.data.nefc])
        if not self._present[self.welded_from :].all():
            raise EngineError("MuJoCo left out a weld that no joint can move")

    def _spread(self, values: Any) -> Array:
        """Return a copy with a row for each row of every equality: MuJoCo leaves out points that no joint can move."""
        rows = np.zeros((len(self._owners), *np.shape(values)[1:]))
        rows[self._present] = values
        return rows

    def _jacobian(self) -> Array:
        rows = self.data.efc_J[: self.data.nefc * self.model.nv]  # there is room for those that are left out, too
        return self._spread(rows.reshape(self.data.nefc, self.model.nv))

    def _gaps(self) -> Array:
        """Return what leads from point to point (pairs, 3), of those that MuJoCo leaves out from their sites."""
        gap = self._spread(self.data.efc_pos)[: self.welded_from].reshape(-1, 3)
        for k in np.flatnonzero(~self._present[: self.welded_from : 3]):
            gap[k] = self.data.site_xpos[self.model.eq_obj1id[k]] - self.data.site_xpos[self.model.eq_obj2id[k]]
        return gap

    def still(self, q: Array) -> tuple[Array, Array, Array, Array, Array]:
        self._place(q)
        m, d, count = self.model, self.data, len(self._at)
        r, axes, jac = np.empty((count, 3)), np.empty((count, 3, 3)), np.empty((count, 6, m.nv))
        for k, (body, u, own) in enumerate(self._at):
            turned = d.xmat[body].reshape(3, 3)
            r[k], axes[k] = d.xpos[body] + turned @ u, turned @ own
            mujoco.mj_jac(m, d, jac[k, :3], jac[k, 3:], r[k], body)
        gap, rows = self._gaps(), self._jacobian()[: self.welded_from]
        return r, axes, self._own(jac), gap, self._own(rows).reshape(len(gap), 3, self._from_tree.shape[1])

    def _own(self, rows: Array) -> Array:
        """Return rows (..., nv) of MuJoCo with columns of the tree's rates."""
        return rows[..., self._v] @ self._from_tree

    def _move(self, q: Array, rates: Array) -> None:
        self._place(q)
        self.data.qvel[self._v] = self._from_tree @ rates
        mujoco.mj_comVel(self.model, self.data)
        mujoco.mj_makeConstraint(self.model, self.data)
        mujoco.mj_referenceConstraint(self.model, self.data)

    def moving(self, q: Array, rates: Array, accelerations: Array | None) -> tuple[Array, Array, Array]:
        self._move(q, rates)
        m, d = self.model, self.data
        vel, acc = np.empty((2, len(self._at), 6))
        qacc, jac, change = np.zeros(m.nv), np.empty((6, m.nv)), np.empty((6, m.nv))
        if accelerations is not None:
            qacc[self._v] = self._from_tree @ accelerations
        for k, (body, u, _) in enumerate(self._at):
            point = d.xpos[body] + d.xmat[body].reshape(3, 3) @ u
            mujoco.mj_jac(m, d, jac[:3], jac[3:], point, body)
            mujoco.mj_jacDot(m, d, change[:3], change[3:], point, body)
            vel[k], acc[k] = jac @ d.qvel, change @ d.qvel + jac @ qacc
        bend = self._jacobian() @ qacc - self._spread(d.efc_aref)
        return vel, acc, bend[: self.welded_from].reshape(-1, 3)

    def welded(self, q: Array, rates: Array) -> tuple[Array, Array, Array, Array]:
        """Return of the welds' rotations (K, 3): residual, Jacobian (K, 3, v), velocity, and minus its drift term."""
        self._move(q, rates)
        d = self.data
        residual, jacobian, rate, drift = (
            values[self.welded_from :].reshape(-1, 6, *values.shape[1:])[:, 3:]
            for values in (
                self._spread(d.efc_pos),
                self._own(self._jacobian()),
                self._spread(d.efc_vel),
                -self._spread(d.efc_aref),
            )
        )
        return residual, jacobian, rate, drift
