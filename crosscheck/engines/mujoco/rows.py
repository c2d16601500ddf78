"""What MuJoCo says of the constraints in a `Plan`: residual, Jacobian, velocity and drift term of its rows.

The stages of MuJoCo's pipeline are called one by one, as far as a question needs them; its solver is never called.
Arrays of `MjData` are views into memory that the next call reuses: whatever is returned is a copy.
"""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence
from typing import Any

import numpy as np

from crosscheck.engines.mujoco.model import Plan, mujoco
from crosscheck.engines.tree.joint_tree import Array
from crosscheck.engines.tree.tree_system import Places

UNTURNED = np.array([1.0, 0.0, 0.0, 0.0])
HEAVY = 2.0**60
"""The armature given to a tendon: so large that what else is in the bias force is below the last digit."""


class _Points:
    """Points of bodies, (body, place in it) each, where MuJoCo has them at `count` poses: read pose by pose."""

    def __init__(self, at: Sequence[tuple[int, Array]], count: int, n: int) -> None:
        self._place, self._slope, self._bend = np.empty((len(at), 3)), *np.empty((2, len(at), 3, n))
        self._at = [(*end, self._place[k], self._slope[k], self._bend[k]) for k, end in enumerate(at)]
        self._places, self._frame = np.empty((count, len(at), 3)), np.empty(9)
        self._slopes, self._bends = np.empty((2, count, len(at), 3, n))

    def read(self, m: Any, d: Any, pose: int, *, moving: bool = False) -> None:
        """Read where the points are, their Jacobians and, if bodies have rates, how those change."""
        world, jac, jac_dot, frame = mujoco.mj_local2Global, mujoco.mj_jac, mujoco.mj_jacDot, self._frame
        for body, u, place, slope, bend in self._at:
            world(d, place, frame, u, UNTURNED, body, 0)
            jac(m, d, slope, None, place, body)
            if moving:
                jac_dot(m, d, bend, None, place, body)
        self._places[pose], self._slopes[pose] = self._place, self._slope
        if moving:
            self._bends[pose] = self._bend

    @property
    def r(self) -> Array:
        """Positions (B, P, 2)."""
        return self._places[:, :, :2]

    @property
    def jacobian(self) -> Array:
        """Jacobians (B, P, 2, n), columns in MuJoCo's order."""
        return self._slopes[:, :, :2]

    def drift(self, qd: Array) -> Array:
        """Return the accelerations (B, P, 2) at qdd = 0, from rates (B, n) in MuJoCo's order."""
        return (self._bends[:, :, :2] @ qd[:, None, :, None])[..., 0]


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
        self._owners = np.array(plan.owners, int)
        self._constants = np.array([s.constant for s in plan.sources if s.equality is None and s.guide is None])
        self._pick = self._places()
        self._columns = np.array([self.model.joint(f"q{k}").id for k in range(plan.tree.width)], int)
        self._bodies = {name: body.id for name, body in plan.bodies.items()}
        self._sites = {site.name: site.id for site in plan.spec.sites}
        tendon = mujoco.mj_tendon if self.model.ntendon else None
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
        residual, jacobian = np.empty((len(q), count)), np.empty((len(q), count * n))
        guides = np.empty((len(q), len(self.plan.guides), 1 + n))
        points, more = self._points(len(q), places), bool(places or self.plan.guides)
        for k in self._posed(q):
            if d.nefc == count:
                residual[k], jacobian[k] = d.efc_pos, d.efc_J
            else:
                residual[k], jacobian[k] = self._filled(self._spread(d.efc_pos)), self._spread(self._dense()).ravel()
            if more:
                self._read_guides(m, d, guides[k])
                points.read(m, d, k)
        slopes = jacobian.reshape(len(q), count, n)
        if guides.size or self._constants.size:
            none = np.zeros((len(q), len(self._constants), 1 + n))  # n may be 0: all that moves is fixed
            slopes = np.concatenate([slopes, guides[:, :, 1:], none[:, :, 1:]], axis=1)
            residual = np.concatenate([residual, guides[:, :, 0], none[:, :, 0] + self._constants], axis=1)
        slopes = slopes[:, self._pick[:, None], self._columns]
        return residual[:, self._pick], slopes, points.r, points.jacobian[..., self._columns]

    def _read_guides(self, m: Any, d: Any, out: Array) -> None:
        """Read the guides' rows, then their velocities at unit rates, column by column, into `out` (guides, 1 + n)."""
        if not len(out):
            return
        last, sensor, com_vel, rates = 6 * len(out), mujoco.mj_sensorVel, mujoco.mj_comVel, d.qvel
        position, velocity = d.sensordata[1:last:6], d.sensordata[4:last:6]
        mujoco.mj_sensorPos(m, d)
        out[:, 0] = position
        rates[:] = 0.0
        for column in range(1, 1 + m.nv):
            rates[column - 1] = 1.0
            com_vel(m, d)
            sensor(m, d)
            out[:, column] = velocity
            rates[column - 1] = 0.0

    def rates(self, q: Array, qd: Array, places: Places = ()) -> tuple[Array, Array, Array]:
        """Return the rows' velocities (B, m) and drift terms -Jdot qd (B, m), both without what the laws bring.

        The adapter completes the drift of lines and lengths. And accelerations of points at qdd = 0, (B, P, 2).
        """
        m, d, count, guides = self.model, self.data, len(self._owners), self.plan.guides
        gap, rate, drift = np.empty((3, len(q), count))
        sensed, turning = np.empty((len(q), len(guides))), np.empty((len(q), len(guides), 3))
        com_vel, reference, points = mujoco.mj_comVel, mujoco.mj_referenceConstraint, self._points(len(q), places)
        for k in self._posed(q, qd):
            com_vel(m, d)
            reference(m, d)
            if d.nefc == count:
                rate[k], drift[k], gap[k] = d.efc_vel, d.efc_aref, d.efc_pos
            else:
                rate[k], drift[k], gap[k] = map(self._spread, (d.efc_vel, d.efc_aref, d.efc_pos))
            if guides:
                mujoco.mj_sensorVel(m, d)
                sensed[k] = d.sensordata[4 : 6 * len(guides) : 6]
                for j, guide in enumerate(guides):
                    site = self._sites[guide.line]
                    turning[k, j] = (*d.site_xmat[site, 1:5:3], d.cvel[m.site_bodyid[site], 2])
            if places:
                points.read(m, d, k, moving=True)
            for row in self.plan.spatial:
                drift[k, row] = self._length_drift(row)
        still = np.zeros((len(q), len(self._constants)))
        of_guides = self._guide_drift(gap, rate, drift, turning)
        bends = points.drift(self._in_order(qd))
        return self._picked(rate, sensed, still), self._picked(drift, of_guides, still), bends

    def motion(self, q: Array, qd: Array | None, qdd: Array | None, places: Places) -> list[Array]:
        """Return position, velocity and acceleration (B, P, 2) of points of bodies, as far as rates are given."""
        m, d, points = self.model, self.data, self._points(len(q), places)
        rates = None if qdd is None else qd
        for k in self._posed(q, rates, constrained=False):
            if rates is not None:
                mujoco.mj_comVel(m, d)
            points.read(m, d, k, moving=rates is not None)
        levels = [points.r]
        for rate in (qd, qdd):
            if rate is not None:
                levels.append((points.jacobian @ self._in_order(rate)[:, None, :, None])[..., 0])
        if rates is not None:
            levels[2] += points.drift(self._in_order(rates))
        return levels

    def _points(self, count: int, places: Places) -> _Points:
        at = [(self._bodies[body], np.array(self.plan.place(body, u))) for body, u in places]
        return _Points(at, count, self.model.nv)

    def _in_order(self, q: Array) -> Array:
        """Return coordinates or rates (B, n) of the tree in MuJoCo's order."""
        out = np.empty_like(q)
        out[:, self._columns] = q
        return out

    def _posed(self, q: Array, qd: Array | None = None, *, constrained: bool = True) -> Iterator[int]:
        """Place the bodies at one q (B, n) after the other, with rates if there are any; yield its index."""
        m, d = self.model, self.data
        at, rate = d.qpos, d.qvel
        rates = None if qd is None else self._in_order(qd)
        kinematics, com_pos, tendon, constrain = self._stages
        for k, row in enumerate(self._in_order(q)):
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
        d.qpos[self._columns], d.qvel[self._columns] = q, qd
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
        return np.array(d.qacc[self._columns])

    def length(self, source: int) -> float:
        """Return the length of the spatial tendon that holds a row, where the bodies were last placed."""
        return float(self.data.ten_length[self._tendon(self._pick[source])])

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

    def _tendon(self, row: int) -> int:
        return int(self.model.eq_obj1id[self._owners[row]])

    def _guide_drift(self, gap: Array, rate: Array, drift: Array, turning: Array) -> Array:
        """Return the drift terms (B, guides) of n . d by the product rule, which MuJoCo does not have.

        (n . d)'' = n . d'' + 2 n' . d' + n'' . d with n' = omega x n. MuJoCo gives n and omega (`turning`), and with
        the `connect` between the two points d, d' and the part of d'' that holds no acceleration: -efc_aref.
        """
        at = np.array([[g.connect, g.connect + 1] for g in self.plan.guides], int).reshape(-1, 2)
        n, omega = turning[..., :2], turning[..., 2:]
        turned = omega * np.stack([-n[..., 1], n[..., 0]], axis=-1)
        return np.sum(n * drift[:, at] - 2.0 * turned * rate[:, at] + omega * omega * n * gap[:, at], axis=-1)

    def _length_drift(self, row: int) -> float:
        """Return -Jdot qd of the length of the spatial tendon in a row, which efc_aref leaves out.

        MuJoCo knows Jdot qd for the sake of tendons that have an armature: their bias force is J^T armature Jdot qd.
        """
        tendon = self._tendon(row)
        self.model.tendon_armature[tendon] = HEAVY
        mujoco.mj_fwdVelocity(self.model, self.data)
        self.model.tendon_armature[tendon] = 0.0
        full = self.data.ne == len(self._owners)
        gradient = (self._dense() if full else self._spread(self._dense()))[row]
        if not gradient.any():  # nothing moves it; or its ends coincide, where it has no direction
            return 0.0 if self.data.ten_length[tendon] else math.nan
        return -float(gradient @ self.data.qfrc_bias / (gradient @ gradient)) / HEAVY

    def _dense(self) -> Any:
        return np.reshape(self.data.efc_J, (self.data.nefc, self.model.nv))
