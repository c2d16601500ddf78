"""MuJoCo's model of a joint tree of space: bodies, joints, sites, and its own equality `connect` between two points.

Joints: hinge, slide, slide and hinge, two hinges, ball (w, x, y, z; rates in the body's axes). MuJoCo's body lies at
its joint, so a pose of the specification is that of coordinates zero, computed from the scene's numbers. A screw is a
slide that the adapter moves with its hinge, a free body three slides and a ball.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from typing import Any

import numpy as np

from crosscheck.engines import EngineError
from crosscheck.engines.mujoco.model import MASSES, add_equality, compiled, kinematic_spec, mujoco
from crosscheck.engines.spatial.kinds import JointKind
from crosscheck.engines.spatial.system import Place, SpaceEngine, State, at_places
from crosscheck.engines.spatial.tree import QUARTER, SpaceTree, SpatialEdge
from crosscheck.engines.spatial.turning import cross, length, parameters
from refkin.joints import GROUND

Array = Any
HINGE, SLIDE, BALL = mujoco.mjtJoint.mjJNT_HINGE, mujoco.mjtJoint.mjJNT_SLIDE, mujoco.mjtJoint.mjJNT_BALL
X, Y, Z = [1.0, 0.0, 0.0], [0.0, 1.0, 0.0], [0.0, 0.0, 1.0]
SLIDING = (JointKind.PRISMATIC, JointKind.CYLINDRICAL, JointKind.SCREW)
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
        self._bodies = np.array([self.bodies[p.body].id for p in places], int)
        self._u = np.array([self._local(p)[0] for p in places]).reshape(-1, 3)
        self._axes = np.array([self._local(p)[1] for p in places]).reshape(-1, 3, 3)
        self._roots, self._moves = self.model.body_rootid[self._bodies], self._moved()

    def _add(self) -> None:
        """Add nothing more to the specification before it is compiled."""

    def _hang(self, k: int, edge: SpatialEdge) -> None:
        u, frame = self.frames[edge.parent]
        turned = edge.frame_parent @ QUARTER if edge.kind == JointKind.UNIVERSAL else edge.frame_parent
        place, joints = edge.u_parent + edge.frame_parent[:, 2] * edge.shift, JOINTS[edge.kind]
        own, own_body = frame.T @ turned, edge.frame_body
        if edge.kind in SLIDING:  # along its axis as it is: turned by a quaternion it would be off as far as it goes
            joints, own, own_body = [(kind, own[:, 2]) for kind, _ in joints], np.eye(3), edge.frame_body @ own.T
        body = self.bodies[edge.parent].add_body(
            name=f"b{k}", pos=frame.T @ (place - u), quat=parameters(own), **MASSES[bool(joints)]
        )
        for kind, axis in joints:
            self._names.append(f"q{len(self._names)}")
            body.add_joint(name=self._names[-1], type=kind, axis=axis)
        self.bodies[edge.body], self.frames[edge.body] = body, (edge.u_body, own_body)

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

    def _moved(self) -> Array:
        """Return which of the tree's rates move a place, 1 or 0, (P, 1, v)."""
        m = self.model
        moves = np.zeros((m.nbody, m.nv))
        for body, parent in enumerate(m.body_parentid):
            moves[body] = moves[parent] + (m.dof_bodyid == body)
        return (moves[self._bodies][:, self._v] @ np.abs(self._from_tree) > 0.0)[:, None] * 1.0

    def coordinates(self, q: Array) -> Array:
        """Return coordinates (..., n) of the tree as those of MuJoCo's joints, edge by edge: of a screw two."""
        parts = []
        for edge in self.tree.edges:
            part = q[..., edge.slot]
            if edge.kind == JointKind.SCREW:
                part = part * [edge.pitch, 1.0]
            if edge.turned.stop:
                p = q[..., edge.turned]
                part = np.concatenate([part[..., :-4], p / length(p)], axis=-1)
            parts.append(part)
        return np.concatenate(parts, axis=-1)

    def _posed(self, q: Array, rates: Array | None = None) -> Iterator[int]:
        """Place the bodies at one q (B, n) after the other, with rates (B, v) if there are any; yield its index."""
        m, d = self.model, self.data
        at = np.empty((len(q), m.nq))
        at[:, self.columns] = self.coordinates(q)
        moving = np.zeros((len(q), m.nv))
        if rates is not None:
            moving[:, self._v] = rates @ self._from_tree.T
        for k in range(len(q)):
            d.qpos[:], d.qvel[:] = at[k], moving[k]
            mujoco.mj_kinematics(m, d)
            mujoco.mj_comPos(m, d)
            mujoco.mj_makeConstraint(m, d)
            if rates is not None:
                mujoco.mj_comVel(m, d)
                mujoco.mj_referenceConstraint(m, d)
            self._present = None
            if d.nefc != len(self._owners):
                self._present = np.isin(self._owners, d.efc_id[: d.nefc])
                if not self._present[self.welded_from :].all():
                    raise EngineError("MuJoCo left out a weld that no joint can move")
            yield k

    def _spread(self, values: Any) -> Array:
        """Return values with a row for each row of every equality: MuJoCo leaves out points that no joint can move."""
        if self._present is None:
            return values
        rows = np.zeros((len(self._owners), *np.shape(values)[1:]))
        rows[self._present] = values
        return rows

    def _jacobian(self) -> Array:
        rows = self.data.efc_J[: self.data.nefc * self.model.nv]  # there is room for those that are left out, too
        return self._spread(rows.reshape(self.data.nefc, self.model.nv))

    def _gaps(self) -> Array:
        """Return what leads from point to point, of those that MuJoCo leaves out from their sites."""
        gap = self._spread(self.data.efc_pos)[: self.welded_from]
        for k in () if self._present is None else np.flatnonzero(~self._present[: self.welded_from : 3]):
            ends = (self.data.site_xpos[ids[k]] for ids in (self.model.eq_obj1id, self.model.eq_obj2id))
            gap[3 * k : 3 * k + 3] = next(ends) - next(ends)
        return gap

    def still(self, q: Array) -> State:
        d, count = self.data, len(q)
        gap, rows = np.empty((count, self.welded_from)), np.empty((count, self.welded_from, self.model.nv))
        reads = self._kept(count, d.xpos, d.xmat, d.subtree_com, d.cdof)
        for k in self._posed(q):
            gap[k], rows[k] = self._gaps(), self._jacobian()[: self.welded_from]
            for kept, view in reads:
                kept[k] = view
        r, axes, jac = self._placed(*(kept for kept, _ in reads))
        pairs = count, self.welded_from // 3, 3
        slopes = self._own(rows).reshape(*pairs, self._from_tree.shape[1])
        return State(r, axes, jac, gap.reshape(pairs), slopes)

    def _kept(self, count: int, *views: Any) -> list[tuple[Array, Any]]:
        """Return what is kept of so many poses, and the views that the stages fill at each."""
        return [(np.empty((count, *view.shape)), view) for view in views]

    def _placed(self, x: Array, frames: Array, com: Array, twists: Array) -> tuple[Array, Array, Array]:
        """Return places (B, P, 3), axes (B, P, 3, 3) and Jacobians (B, P, 6, v) from what MuJoCo has of its bodies.

        A motion axis (`cdof`) is the twist of a joint at unit rate, turn first, at the centre of mass of its tree.
        """
        frames = frames.take(self._bodies, axis=1).reshape(len(x), -1, 3, 3)
        r = x.take(self._bodies, axis=1) + (frames @ self._u[:, :, None])[..., 0]
        off = r - com.take(self._roots, axis=1)
        return r, frames @ self._axes, at_places(self._twists(twists), off, self._moves)

    def _twists(self, axes: Array) -> Array:
        """Return motion axes (B, nv, 6) of joints, the turn first, as twists (B, 6, v) of the tree's rates."""
        return self._own(axes.swapaxes(1, 2)).take([3, 4, 5, 0, 1, 2], axis=1)

    def _own(self, rows: Array) -> Array:
        """Return rows (..., nv) of MuJoCo with columns of the tree's rates."""
        return rows.take(self._v, axis=-1) @ self._from_tree

    def moving(self, q: Array, rates: Array, accelerations: Array | None) -> tuple[Array, Array, Array]:
        d, count = self.data, len(q)
        reads = self._kept(count, d.xpos, d.xmat, d.subtree_com, d.cdof, d.cdof_dot)
        bend, rows = np.empty((count, self.welded_from)), np.empty((count, self.welded_from, self.model.nv))
        for k in self._posed(q, rates):
            bend[k] = -self._spread(d.efc_aref)[: self.welded_from]
            rows[k] = self._jacobian()[: self.welded_from]
            for kept, view in reads:
                kept[k] = view
        x, frames, com, twists, changes = (kept for kept, _ in reads)
        r, _, jac = self._placed(x, frames, com, twists)
        off = r - com.take(self._roots, axis=1)
        vel = np.einsum("bpiv,bv->bpi", jac, rates)
        acc = np.einsum("bpiv,bv->bpi", at_places(self._twists(changes), off, self._moves), rates)
        acc[..., :3] += cross(vel[..., 3:], vel[..., :3])  # the place goes on while the axes turn
        if accelerations is not None:
            acc += np.einsum("bpiv,bv->bpi", jac, accelerations)
            bend += np.einsum("bmv,bv->bm", self._own(rows), accelerations)
        return vel, acc, bend.reshape(count, self.welded_from // 3, 3)

    def welded(self, q: Array, rates: Array) -> tuple[Array, ...]:
        """Return of the welds' rotations (B, K, 3): residual, Jacobian (B, K, 3, v), velocity, minus its drift term."""
        d, parts = self.data, []
        for _ in self._posed(q, rates):
            whole = d.efc_pos, self._own(self._jacobian()), d.efc_vel, -d.efc_aref
            first = self.welded_from
            spread = (part if k == 1 else self._spread(part) for k, part in enumerate(whole))
            parts.append([np.array(x[first:]).reshape(-1, 6, *x.shape[1:])[:, 3:] for x in spread])
        return tuple(map(np.array, zip(*parts, strict=True)))
