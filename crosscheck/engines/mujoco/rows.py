"""What MuJoCo says of the constraints in a `Plan`: residual, Jacobian, velocity and drift term of its rows.

The stages of MuJoCo's pipeline are called one by one, as far as a question needs them; its solver is never called.
Arrays of `MjData` are views into memory that the next call reuses: whatever is returned is a copy.
"""

from __future__ import annotations

import math
from typing import Any

import numpy as np

from crosscheck.engines.mujoco.model import Plan, mujoco
from crosscheck.engines.tree.joint_tree import Array
from refkin.joints import Pair

HEAVY = 2.0**60
"""The armature given to a tendon: so large that what else is in the bias force is below the last digit."""


class MujocoRows:
    """The rows of a compiled plan, in the order of `plan.sources`, in the model's unit of length.

    `pose` first, then `residual` and `jacobian`; `move` after it, then `velocity` and `drift`. For points `place` and
    `move` suffice. Columns are those of the plan's tree; MuJoCo has its joints in an order of its own, depth first.
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

    def place(self, q: Array) -> None:
        """Place the bodies at q, which need not be assembled."""
        self.data.qpos[self._columns] = q
        mujoco.mj_kinematics(self.model, self.data)
        mujoco.mj_comPos(self.model, self.data)

    def pose(self, q: Array) -> None:
        """Place the bodies at q and evaluate the rows there."""
        self.place(q)
        mujoco.mj_tendon(self.model, self.data)
        mujoco.mj_makeConstraint(self.model, self.data)

    def move(self, qd: Array) -> None:
        """Give the bodies their rates."""
        self.data.qvel[self._columns] = qd
        mujoco.mj_comVel(self.model, self.data)

    def residual(self) -> Array:
        """Return the residual (m,)."""
        rows = self._spread(self.data.efc_pos)
        if self.data.ne < len(rows):
            self._fill(rows)
        guides = np.empty(0)
        if self.plan.guides:
            mujoco.mj_sensorPos(self.model, self.data)
            guides = self.data.sensordata[1 : 6 * len(self.plan.guides) : 6]
        return self._picked(rows, guides, self._constants)

    def jacobian(self) -> Array:
        """Return the Jacobian (m, n); a guide's row is its velocity at unit rates, column by column."""
        n = len(self._columns)
        rows = self._spread(self._dense())
        guides = np.empty((len(self.plan.guides), n))
        if self.plan.guides:
            for column in range(n):
                self.data.qvel[:] = 0.0
                self.data.qvel[column] = 1.0
                mujoco.mj_comVel(self.model, self.data)
                guides[:, column] = self._guide_velocity()
        return self._picked(rows, guides, np.zeros((len(self._constants), n)))[:, self._columns]

    def velocity(self) -> Array:
        """Return the velocity (m,) of the rows, without the rate of a driver's law."""
        mujoco.mj_referenceConstraint(self.model, self.data)
        guides = self._guide_velocity() if self.plan.guides else np.empty(0)
        return self._picked(self._spread(self.data.efc_vel), guides, 0.0 * self._constants)

    def drift(self) -> Array:
        """Return -Jdot qd, (m,), which the adapter completes for lines and lengths."""
        mujoco.mj_referenceConstraint(self.model, self.data)
        rows = self._spread(self.data.efc_aref)
        guides = self._guide_drift(rows) if self.plan.guides else np.empty(0)
        for row in self.plan.spatial:
            rows[row] = self._length_drift(row)
        return self._picked(rows, guides, 0.0 * self._constants)

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
        """Return the length of the spatial tendon that holds a row."""
        return float(self.data.ten_length[self._tendon(self._pick[source])])

    def point(self, body: str, u: Pair) -> tuple[Array, Array]:
        """Return a point of a body in the ground frame (2,), and its Jacobian (2, n)."""
        place, k = self._place(body, u)
        jacobian = np.empty((3, self.model.nv))
        mujoco.mj_jac(self.model, self.data, jacobian, None, place, k)
        return place[:2], jacobian[:2, self._columns]

    def point_drift(self, body: str, u: Pair) -> Array:
        """Return the acceleration (2,) of a point at qdd = 0."""
        place, k = self._place(body, u)
        rate = np.empty((3, self.model.nv))
        mujoco.mj_jacDot(self.model, self.data, rate, None, place, k)
        return (rate @ self.data.qvel)[:2]

    def _place(self, body: str, u: Pair) -> tuple[Any, int]:
        k = self._bodies[body]
        return self.data.xpos[k] + self.data.xmat[k].reshape(3, 3) @ self.plan.place(body, u), k

    def _picked(self, *parts: Array) -> Array:
        return np.concatenate(parts)[self._pick]

    def _spread(self, values: Any) -> Array:
        """Return a copy with a row for each row of every equality: MuJoCo leaves out those that no joint can move."""
        ne = self.data.ne
        if ne == len(self._owners):
            return np.array(values[:ne])
        present = np.isin(self._owners, self.data.efc_id[:ne])
        rows = np.zeros((len(self._owners), *np.shape(values)[1:]))
        rows[present] = values[:ne]
        return rows

    def _fill(self, rows: Array) -> None:
        """Write the residual of equalities that were left out, from the places of their sites or their tendon."""
        for k in set(range(self.model.neq)).difference(self.data.efc_id[: self.data.ne]):
            first, second = self.model.eq_obj1id[k], self.model.eq_obj2id[k]
            if self.model.eq_type[k] == mujoco.mjtEq.mjEQ_TENDON:
                rows[self._owners == k] = self.data.ten_length[first] - self.model.eq_data[k, 0]
            else:
                rows[self._owners == k] = self.data.site_xpos[first] - self.data.site_xpos[second]

    def _tendon(self, row: int) -> int:
        return int(self.model.eq_obj1id[self._owners[row]])

    def _guide_velocity(self) -> Array:
        mujoco.mj_sensorVel(self.model, self.data)
        return np.array(self.data.sensordata[4 : 6 * len(self.plan.guides) : 6])

    def _guide_drift(self, rows: Array) -> Array:
        """Return the drift term of n . d by the product rule, which MuJoCo does not have.

        (n . d)'' = n . d'' + 2 n' . d' + n'' . d with n' = omega x n. MuJoCo gives n, omega, d, d' and, with the
        `connect` between the two points, the part of d'' that holds no acceleration: -efc_aref.
        """
        gap, rate = self._spread(self.data.efc_pos), self._spread(self.data.efc_vel)
        drift = np.empty(len(self.plan.guides))
        for k, guide in enumerate(self.plan.guides):
            at, site = slice(guide.connect, guide.connect + 2), self._sites[guide.line]
            n = self.data.site_xmat[site].reshape(3, 3)[:2, 1]
            omega = self.data.cvel[self.model.site_bodyid[site], 2]
            turned = omega * np.array([-n[1], n[0]])
            drift[k] = n @ rows[at] - 2.0 * (turned @ rate[at]) + omega * omega * (n @ gap[at])
        return drift

    def _length_drift(self, row: int) -> float:
        """Return -Jdot qd of the length of the spatial tendon in a row, which efc_aref leaves out.

        MuJoCo knows Jdot qd for the sake of tendons that have an armature: their bias force is J^T armature Jdot qd.
        """
        tendon = self._tendon(row)
        self.model.tendon_armature[tendon] = HEAVY
        mujoco.mj_fwdVelocity(self.model, self.data)
        self.model.tendon_armature[tendon] = 0.0
        gradient = self._spread(self._dense())[row]
        if not gradient.any():  # nothing moves it; or its ends coincide, where it has no direction
            return 0.0 if self.data.ten_length[tendon] else math.nan
        return -float(gradient @ self.data.qfrc_bias / (gradient @ gradient)) / HEAVY

    def _dense(self) -> Any:
        return np.reshape(self.data.efc_J, (self.data.nefc, self.model.nv))
