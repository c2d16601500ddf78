"""What MuJoCo says of the constraints in a `Plan`: residual, Jacobian, velocity and drift term of its rows.

The stages of MuJoCo's pipeline are called one by one, as far as a question needs them; its solver is never called.
Arrays of `MjData` are views into memory that the next call reuses: whatever is returned is a copy.
"""

from __future__ import annotations

import math
from collections.abc import Iterator
from functools import cached_property
from typing import Any

import numpy as np

from crosscheck.engines.mujoco.model import Plan, mujoco
from crosscheck.engines.tree.joint_tree import Array, in_order
from crosscheck.engines.tree.tree_system import Places

HEAVY = 2.0**60
"""The armature given to a tendon: so large that what else is in the bias force is below the last digit."""


Read = tuple[Array, Any]
"""What is kept of B poses, and the view that the stages fill at each."""


class _Points:
    """Points of bodies where MuJoCo has them at `count` poses, from the frames and motion axes that it has at each.

    A motion axis (`cdof`) is the twist of a joint at unit rate, at the centre of mass of the tree it is in; what
    `mj_jac` and `mj_jacDot` make of them for a point is made of them here, for all poses at once.
    """

    def __init__(self, rows: MujocoRows, places: Places, count: int, like: _Points | None = None) -> None:
        d = rows.data
        self._bodies, self._u, self._roots, self._moves = rows.where(tuple(places))
        self._columns = rows.columns
        views = d.xpos, d.xmat, d.subtree_com, d.cdof, d.cdof_dot
        self._kept: list[Array] = like._kept if like else [np.empty((count, *view.shape)) for view in views]
        self.reads: list[Read] = list(zip(self._kept, views, strict=True))

    @cached_property
    def _parts(self) -> tuple[Array, Array]:
        """Origins of their bodies (B, P, 2), and the way from there, of which `r` far away has fewer digits."""
        x, frames = (kept.take(self._bodies, axis=1) for kept in self._kept[:2])
        turned: Array = frames[:, :, 0:4:3] * self._u[:, :1] + frames[:, :, 1:5:3] * self._u[:, 1:]
        return x[:, :, :2], turned

    @cached_property
    def r(self) -> Array:
        """Positions (B, P, 2)."""
        return self._parts[0] + self._parts[1]

    @cached_property
    def jacobian(self) -> Array:
        """Jacobians (B, P, 2, n), columns in the tree's order."""
        return self._at_points(self._kept[3])

    def drift(self, qd: Array) -> Array:
        """Return the accelerations (B, P, 2) at qdd = 0, from rates (B, n)."""
        turning = (self._kept[3][:, self._columns, 2] * qd) @ self._moves.T
        velocity, bend = along(self.jacobian, qd), along(self._at_points(self._kept[4]), qd)
        bend[:, :, 0] -= turning * velocity[:, :, 1]
        bend[:, :, 1] += turning * velocity[:, :, 0]
        return bend

    def _at_points(self, twists: Array) -> Array:
        """Return the velocities (B, P, 2, n) that twists (B, n, 6) of joints give the points that they move."""
        x, turned = self._parts
        off = x - self._kept[2].take(self._roots, axis=1)[:, :, :2] + turned
        twists = twists.take(self._columns, axis=1)[:, None]
        out = np.empty((*off.shape, len(self._columns)))
        out[:, :, 0] = twists[..., 3] - twists[..., 2] * off[:, :, 1:]
        out[:, :, 1] = twists[..., 4] + twists[..., 2] * off[:, :, :1]
        out *= self._moves[:, None]
        return out


def along(slopes: Array, rates: Array) -> Array:
    """Return the products (B, P, 2) of Jacobians (B, P, 2, n) with rates (B, n)."""
    return (slopes @ rates[:, None, :, None])[..., 0]


class MujocoRows:
    """The rows of a compiled plan, in the order of `plan.sources`, in the model's unit of length, at B poses at once.

    Columns are those of the plan's tree; MuJoCo has its joints in an order of its own, depth first. Poses go through
    its stages one by one, as `mujoco.batch` hands out no rows of constraints: in loops that do little else, because a
    stage takes 0.2 us and anything in Python as long.
    """

    def __init__(self, plan: Plan) -> None:
        self.plan = plan
        self.model: Any = plan.compile()
        self.data: Any = mujoco.MjData(self.model)
        self._armature, self._bias = self.model.tendon_armature, self.data.qfrc_bias  # views
        self._owners = np.array(plan.owners, int)
        self._constants = np.array([s.constant for s in plan.sources if s.equality is None and s.guide is None])
        self._held = len(plan.owners) + len(plan.guides) + len(self._constants)
        self._pick = self._places()
        self.columns = np.array([self.model.joint(f"q{k}").id for k in range(plan.tree.width)], int)
        self._entries = (self._pick[:, None] * self.model.nv + self.columns).ravel()
        self.bodies = {name: body.id for name, body in plan.bodies.items()}
        self._moved: Any = None, None, None
        """The last poses and rates that were asked for, and what was read at them."""
        self._ways: dict[Any, tuple[Any, Array, Any, Array]] = {}
        self._sites = {site.name: site.id for site in plan.spec.sites}
        tendon = mujoco.mj_tendon if self.model.ntendon else None
        self._lines = [self._sites[guide.line] for guide in plan.guides]
        self._turned = [self.bodies[guide.body] for guide in plan.guides]
        self._connects = np.array([[g.connect, g.connect + 1] for g in plan.guides], int).reshape(-1, 2)
        self._turns = np.zeros((len(plan.guides), self.model.nv))
        for turns, guide in zip(self._turns, plan.guides, strict=True):
            turns[self.columns] = plan.tree.angle_rows[guide.body]
        self._stages = mujoco.mj_kinematics, mujoco.mj_comPos, tendon, mujoco.mj_makeConstraint

    def _places(self) -> Any:
        """Return where each source is in (equality rows, guides, constants)."""
        equalities, guides = len(self.plan.owners), len(self.plan.guides)
        places, constant = [], equalities + guides
        for source in self.plan.sources:
            if source.equality is not None:
                places.append(source.equality)
            elif source.guide is not None:
                places.append(equalities + source.guide)
            else:
                places.append(constant)
                constant += 1
        return np.array(places, int)

    def drive(self, t: float) -> None:
        """Write the value of every driver's law at t into the model."""
        for driven in self.plan.driven:
            value = driven.value(t, 0)
            if driven.site:
                self.model.site_pos[self._sites[driven.site], driven.axis] = value
            else:
                self.model.eq_data[driven.equality, 0] = value

    def rows(self, q: Array, places: Places = ()) -> tuple[Array, Array, Array, Array]:
        """Return residual (B, m) and Jacobian (B, m, n) at q (B, n), points (B, P, 2) and their Jacobians (B, P, 2, n).

        The poses need not be assembled.
        """
        m, d, count, n = self.model, self.data, len(self._owners), self.model.nv
        residual, jacobian = np.empty((len(q), self._held)), np.zeros((len(q), self._held, n))
        held, slopes = residual[:, :count], jacobian.reshape(len(q), -1)[:, : count * n]  # views
        points = _Points(self, places, len(q)) if places else None
        guided, sensor = self._guided(len(q))[:2], mujoco.mj_sensorPos
        reads = guided + points.reads[:4] if points else guided  # nothing moves
        for k in self._posed(q):
            if d.nefc == count:
                held[k], slopes[k] = d.efc_pos, d.efc_J
            else:
                held[k], slopes[k] = self._filled(self._spread(d.efc_pos)), self._spread(self._dense()).ravel()
            if guided:
                sensor(m, d)
            for kept, view in reads:
                kept[k] = view
        if self._held > count:
            self._guide_rows(guided, residual, jacobian)
        slopes = jacobian.reshape(len(q), -1).take(self._entries, axis=1).reshape(len(q), len(self._pick), n)
        residual = residual.take(self._pick, axis=1)
        if points is None:
            return residual, slopes, np.empty((len(q), 0, 2)), np.empty((len(q), 0, 2, n))
        return residual, slopes, points.r, points.jacobian

    def _guided(self, count: int) -> list[Read]:
        """Return what is kept of the guides at so many poses, and views of it: sensors, frames of sites, velocities."""
        d = self.data
        reads = (d.sensordata, d.site_xmat, d.cvel) if self.plan.guides else ()
        return [(np.empty((count, *view.shape)), view) for view in reads]

    def _guide_rows(self, guided: list[Read], residual: Array, jacobian: Array) -> None:
        """Write the rows after those of the equalities: the guides' n . d, from sensors, and what is constant.

        The slopes are those of the product: of d, from the `connect` between the two points, and of n, which turns by
        the angles of the tree on the way to its body.
        """
        row = len(self._owners)
        for k, (guide, line) in enumerate(zip(self.plan.guides, self._lines, strict=True)):
            x, y = guide.connect, guide.connect + 1
            nx, ny = guided[1][0][:, line, 1, None], guided[1][0][:, line, 4, None]
            turning = nx * residual[:, y, None] - ny * residual[:, x, None]
            jacobian[:, row] = nx * jacobian[:, x] + ny * jacobian[:, y] + turning * self._turns[k]
            residual[:, row] = guided[0][0][:, 6 * k + 1]
            row += 1
        residual[:, row:] = self._constants

    def rates(self, q: Array, qd: Array, places: Places = ()) -> tuple[Array, ...]:
        """Return the rows' velocities (B, m) and drift terms -Jdot qd (B, m), both without what the laws bring.

        The adapter completes the drift of lines and lengths. And of points, (B, P, 2) each, if there are any: where
        they are, their velocities, and their accelerations at qdd = 0.
        """
        m, d, count = self.model, self.data, len(self._owners)
        gap, rate, drift = np.empty((3, len(q), count))
        com_vel, reference, sensor = mujoco.mj_comVel, mujoco.mj_referenceConstraint, mujoco.mj_sensorVel
        points, guided = _Points(self, places, len(q)), self._guided(len(q))
        reads = guided + points.reads
        for k in self._posed(q, qd):
            com_vel(m, d)
            reference(m, d)
            if d.nefc == count:
                rate[k], drift[k], gap[k] = d.efc_vel, d.efc_aref, d.efc_pos
            else:
                rate[k], drift[k], gap[k] = map(self._spread, (d.efc_vel, d.efc_aref, d.efc_pos))
            if guided:
                sensor(m, d)
            for kept, view in reads:
                kept[k] = view
            for row in self.plan.spatial:
                drift[k, row] = self._length_drift(row)
        self._moved = points, q, qd
        sensed, of_guides = self._guide_rates(guided, gap, rate, drift)
        still = np.zeros((len(q), len(self._constants)))
        return (
            self._picked(rate, sensed, still),
            self._picked(drift, of_guides, still),
            *((points.r, along(points.jacobian, qd), points.drift(qd)) if places else ()),
        )

    def motion(self, q: Array, qd: Array | None, qdd: Array | None, places: Places) -> list[Array]:
        """Return position, velocity and acceleration (B, P, 2) of points of bodies, as far as rates are given."""
        m, d = self.model, self.data
        known, known_q, known_qd = self._moved
        if qd is None or qdd is None or not (np.array_equal(known_q, q) and np.array_equal(known_qd, qd)):
            known = None
        points = _Points(self, places, len(q), known)
        for k in () if known else self._posed(q, None if qdd is None else qd, constrained=False):
            if qdd is not None:
                mujoco.mj_comVel(m, d)
            for kept, view in points.reads:
                kept[k] = view
        levels = [points.r, *(along(points.jacobian, rate) for rate in (qd, qdd) if rate is not None)]
        if qd is not None and qdd is not None:
            levels[2] += points.drift(qd)
        return levels

    def where(self, places: Any) -> tuple[Any, Array, Any, Array]:
        """Return the bodies of points (P,), places in them (P, 2), roots of their trees (P,), what moves them (P, n).

        Columns are the tree's.
        """
        if places not in self._ways:
            m, bodies = self.model, np.array([self.bodies[body] for body, _ in places], int)
            moves = np.zeros((m.nbody, m.nv))
            for body, parent in enumerate(m.body_parentid):
                moves[body] = moves[parent] + (m.dof_bodyid == body)
            u = np.array([self.plan.place(body, u)[:2] for body, u in places]).reshape(-1, 2)
            self._ways[places] = bodies, u, m.body_rootid[bodies], moves[bodies][:, self.columns]
        return self._ways[places]

    def _posed(self, q: Array, qd: Array | None = None, *, constrained: bool = True) -> Iterator[int]:
        """Place the bodies at one q (B, n) after the other, with rates if there are any; yield its index."""
        m, d = self.model, self.data
        at, rate = d.qpos, d.qvel
        rates = None if qd is None else in_order(qd, self.columns)
        kinematics, com_pos, tendon, constrain = self._stages
        for k, row in enumerate(in_order(q, self.columns)):
            at[:] = row
            if rates is not None:
                rate[:] = rates[k]
            kinematics(m, d)
            com_pos(m, d)
            if constrained:
                if tendon:
                    tendon(m, d)
                constrain(m, d)
            yield k

    def forward(self, q: Array, qd: Array, t: float) -> Array:
        """Return the accelerations (n,) that MuJoCo's dynamics give: all stages of mj_forward, with soft constraints.

        The second derivative of a driver's law is written to MuJoCo's reference acceleration, which holds no law.
        """
        m, d = self.model, self.data
        self.drive(t)
        d.qpos[self.columns], d.qvel[self.columns] = q, qd
        mujoco.mj_fwdPosition(m, d)
        mujoco.mj_sensorPos(m, d)
        mujoco.mj_fwdVelocity(m, d)
        mujoco.mj_sensorVel(m, d)
        mujoco.mj_fwdActuation(m, d)
        mujoco.mj_fwdAcceleration(m, d)
        for driven in self.plan.driven:
            d.efc_aref[: d.ne][d.efc_id[: d.ne] == driven.equality] += driven.value(t, 2)
        mujoco.mj_fwdConstraint(m, d)
        mujoco.mj_sensorAcc(m, d)
        return np.array(d.qacc[self.columns])

    def _picked(self, *parts: Array) -> Array:
        return np.concatenate(parts, axis=1)[:, self._pick]

    def _spread(self, values: Any) -> Array:
        """Return a copy with a row for each row of every equality: MuJoCo leaves out those that no joint can move."""
        ne = self.data.ne
        present = np.isin(self._owners, self.data.efc_id[:ne])
        rows = np.zeros((len(self._owners), *np.shape(values)[1:]))
        rows[present] = values[:ne]
        return rows

    def _filled(self, rows: Array) -> Array:
        """Return the residual with equalities that were left out, from the places of their sites or their tendon."""
        for k in set(range(self.model.neq)).difference(self.data.efc_id[: self.data.ne]):
            first, second = self.model.eq_obj1id[k], self.model.eq_obj2id[k]
            if self.model.eq_type[k] == mujoco.mjtEq.mjEQ_TENDON:
                rows[self._owners == k] = self.data.ten_length[first] - self.model.eq_data[k, 0]
            else:
                rows[self._owners == k] = self.data.site_xpos[first] - self.data.site_xpos[second]
        return rows

    def _guide_rates(self, guided: Any, gap: Array, rate: Array, drift: Array) -> tuple[Array, Array]:
        """Return the rates (B, guides) of n . d, from sensors, and drift terms by the product rule, which it has not.

        (n . d)'' = n . d'' + 2 n' . d' + n'' . d with n' = omega x n. MuJoCo gives n and omega, and with
        the `connect` between the two points d, d' and the part of d'' that holds no acceleration: -efc_aref.
        """
        if not guided:
            return gap[:, :0], gap[:, :0]
        at = self._connects
        n, omega = guided[1][0][:, self._lines, 1:5:3], guided[2][0][:, self._turned, 2:3]  # normals: y axes of sites
        turned = omega * np.stack([-n[..., 1], n[..., 0]], axis=-1)
        bent = n * drift[:, at] - 2.0 * turned * rate[:, at] + omega * omega * n * gap[:, at]
        return guided[0][0][:, 4 : 6 * len(self._turns) : 6], np.sum(bent, axis=-1)

    def _length_drift(self, row: int) -> float:
        """Return -Jdot qd of the length of the spatial tendon in a row, which efc_aref leaves out.

        MuJoCo knows Jdot qd for the sake of tendons that have an armature: their bias force is J^T armature Jdot qd.
        """
        tendon = int(self.model.eq_obj1id[self._owners[row]])
        m, d, armature = self.model, self.data, self._armature
        armature[tendon] = HEAVY
        mujoco.mj_fwdVelocity(m, d)
        armature[tendon] = 0.0
        full = d.ne == len(self._owners)
        gradient = d.efc_J[row * m.nv : (row + 1) * m.nv] if full else self._spread(self._dense())[row]
        square = float(gradient @ gradient)
        if not square:  # nothing moves it; or its ends coincide, where it has no direction
            return 0.0 if d.ten_length[tendon] else math.nan
        return -float(gradient @ self._bias) / square / HEAVY

    def _dense(self) -> Any:
        """Return the Jacobian of the rows that there are; a tendon of no length is counted, and then left out."""
        rows, columns = self.data.nefc, self.model.nv
        return self.data.efc_J[: rows * columns].reshape(rows, columns)
