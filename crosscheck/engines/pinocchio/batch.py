"""Pinocchio's fastest route: a joint tree of three angles, its loop closed by Newton on two of them.

Pinocchio closes no loops itself. Residual, Jacobian and point accelerations are its own; Newton and the 2x2 systems are
done here in scalars, because two calls of numpy.linalg.solve would take longer than all of Pinocchio's work.
"""

from __future__ import annotations

from collections.abc import Iterator
from typing import Any

import numpy as np
import pinocchio as pin

from crosscheck.engines.batch_route import Route, of_four_bars, whole
from crosscheck.judge.of_batches import Piece
from crosscheck.scenes.works import SPEED, FourBars

CONFIGURATIONS = 3600
"""About so many configurations of a work are done."""
AXES = pin.LOCAL_WORLD_ALIGNED
ENOUGH, MOST_NEWTON = 1e-8, 12
ANGLES = (2, 5, 8)
STILL = np.zeros(3)


def four_bars(work: FourBars) -> Route:
    """Return position, velocity and acceleration of the three angles."""
    part = work.first(max(1, CONFIGURATIONS // len(work.t)))
    trees = [_Tree(part, lane) for lane in range(part.mechanisms)]

    def pieces() -> Iterator[Piece]:
        for lane, tree in enumerate(trees):
            yield whole(part, np.array([lane]), tree.run()[:, :, None], ANGLES)

    return of_four_bars(
        "pinocchio",
        part,
        lambda: [tree.run() for tree in trees],
        pieces,
        driven_by="Python: pose after pose, and Newton",
        what="joint tree, its residual, Jacobian and drift; 2x2 systems in scalars; angles alone are read",
    )


class _Tree:
    """One mechanism in Pinocchio: q = angle of the crank, of the coupler against it, of the rocker."""

    def __init__(self, work: FourBars, lane: int) -> None:
        ground, crank, coupler, rocker = map(float, work.lengths[:, lane])
        self.t, self.start = work.t.tolist(), work.starts[:, lane]
        self.model = pin.Model()
        first = self.model.addJoint(0, pin.JointModelRZ(), _at(0.0), "crank")
        second = self.model.addJoint(first, pin.JointModelRZ(), _at(crank), "coupler")
        third = self.model.addJoint(0, pin.JointModelRZ(), _at(ground), "rocker")
        self.ends = (second, _at(coupler)), (third, _at(rocker))
        (i, at_i), (j, at_j) = self.ends
        self.loop = pin.RigidConstraintModel(pin.ContactType.CONTACT_3D, self.model, i, at_i, j, at_j, AXES)
        self.data, self.loop_data = self.model.createData(), self.loop.createData()

    def run(self) -> Any:
        """Return the levels (3, 3, T) of the bodies' angles; NaN from where Newton does not converge."""
        out = np.full((3, 3, len(self.t)), np.nan)
        angles = self.start[2::3]
        q, v, a = np.array([0.0, angles[1] - angles[0], angles[2]]), np.zeros(3), np.zeros(3)
        for k, t in enumerate(self.t):
            h = t - self.t[k - 1] if k else 0.0
            q = q + h * (v + 0.5 * h * a)
            q[0] = SPEED * t
            found = self._pose(q)
            if found is None:
                break
            v, a = found
            out[0, :, k], out[1, :, k], out[2, :, k] = q, v, a
        out[:, 1] += out[:, 0]
        return out

    def _pose(self, q: Any) -> tuple[Any, Any] | None:
        """Close the loop from q, which is changed, and return velocity and acceleration."""
        for _ in range(MOST_NEWTON):
            x, y, (row, other) = self._closure(q)
            dx, dy = _solved(row[1:], other[1:], x, y)
            q[1] -= dx
            q[2] -= dy
            if abs(dx) <= ENOUGH and abs(dy) <= ENOUGH:
                break
        else:
            return None
        _, _, (row, other) = self._closure(q)
        v = np.array([SPEED, *_solved(row[1:], other[1:], -SPEED * row[0], -SPEED * other[0])])
        pin.forwardKinematics(self.model, self.data, q, v, STILL)
        left, right = (
            pin.getFrameClassicalAcceleration(self.model, self.data, joint, place, AXES).linear.tolist()
            for joint, place in self.ends
        )
        return v, np.array([0.0, *_solved(row[1:], other[1:], right[0] - left[0], right[1] - left[1])])

    def _closure(self, q: Any) -> tuple[float, float, list[list[float]]]:
        """Return the gap of the loop and its Jacobian (2, 3)."""
        pin.computeJointJacobians(self.model, self.data, q)
        self.loop.calc(self.model, self.data, self.loop_data)
        x, y, _ = (self.loop_data.oMc1.translation - self.loop_data.oMc2.translation).tolist()
        return x, y, pin.getConstraintJacobian(self.model, self.data, self.loop, self.loop_data)[:2].tolist()


def _solved(row: list[float], other: list[float], x: float, y: float) -> tuple[float, float]:
    (a, b), (c, d) = row, other
    determinant = a * d - b * c
    return (d * x - b * y) / determinant, (a * y - c * x) / determinant


def _at(x: float) -> Any:
    return pin.SE3(np.eye(3), np.array([x, 0.0, 0.0]))
