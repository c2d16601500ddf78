"""Position, velocity and acceleration analysis at one time, and of a whole scene.

============ ====================== =========
position     phi(q, t) = 0          by Newton
velocity     phi_q qd = nu          linear
acceleration phi_q qdd = gamma      linear
============ ====================== =========
"""

from __future__ import annotations

from importlib.metadata import version
from typing import Any

import numpy as np

from refkin.differences import EPS
from refkin.model import Effect, Evidence, Scene
from refkin.motion import CertifiedRadius, Motion, PointMotion, Producer, Route, Seeding, Status, nowhere
from refkin.newton import NewtonResult, newton
from refkin.points import point_motion
from refkin.starts import find_start
from refkin.sweep import SINGULAR, Arrival, Sweep
from refkin.system import System, compile_system

ROUTE = Route(
    name="newton",
    residual_by="refkin",
    jacobian_by="refkin",
    newton_by="refkin",
    linear_solve_by="LAPACK",
    drift_by="refkin",
    seeding=Seeding.INITIAL_GUESS,
)


def position(system: System, q0: Any, t: float, **options: Any) -> NewtonResult:
    """Solve phi(q, t) = 0 from an estimate q0 of shape (n,); options are those of `newton`."""
    return newton(lambda q: system.phi(q, t), lambda q: system.phi_q(q, t), q0, **options)


def velocity(system: System, q: Any, t: Any) -> Any:
    """Return qd with phi_q qd = nu, in the shape of q: (n,) or (n, B)."""
    return _solve(system.phi_q(q, t), system.nu(q, t))


def acceleration(system: System, q: Any, qd: Any, t: Any) -> Any:
    """Return qdd with phi_q qdd = gamma, in the shape of q: (n,) or (n, B)."""
    return _solve(system.phi_q(q, t), system.gamma(q, qd, t))


def solve(scene: Scene) -> Motion:
    """Return position and what else the scene calls for, with evidence, on the branch of its estimates.

    Numbers that fail are statuses in the result, never exceptions.
    """
    implied = {Effect.VELOCITY} if Effect.ACCELERATION in scene.effects else set()
    system = compile_system(scene.mechanism, scene.effects | implied, scene.mechanism.unit())
    t = np.array(scene.times)
    q, status, message = _positions(system, scene)
    reached = np.flatnonzero(np.isfinite(q[0]))
    answer = _Answer(system, scene, t, q, status)
    if reached.size:
        answer.judge(reached)
        answer.rates(np.flatnonzero([s is Status.OK for s in status]))
    return answer.motion(message)


def _positions(system: System, scene: Scene) -> tuple[Any, list[Status], str]:
    """Return the poses that were reached (NaN elsewhere), a first status per time, and a message."""
    count = len(scene.times)
    q = np.full((system.n, count), np.nan)
    start = find_start(system, scene)
    if start.q is None:
        return q, [start.status] * count, start.message
    q[:, 0] = start.q
    status = [Status.OK] + [Status.BRANCH_LOST] * (count - 1)
    sweep = Sweep(system, [scene.times[0]], [start.q])
    for k in range(1, count):
        arrival = sweep.to(scene.times[k])
        if arrival is Arrival.STOPPED:
            where = f"the sweep stopped at t = {sweep.t[-1]:.17g}, before t = {scene.times[k]:g}"
            return q, status, f"{start.message}{where}: a singular pose ends the branch"
        q[:, k], status[k] = sweep.q[-1], Status.OK
        if arrival is Arrival.AT_SINGULAR_POSE:
            return q, status, f"{start.message}the pose at t = {scene.times[k]:g} is singular"
    return q, status, start.message


class _Answer:
    """The arrays of a motion while they are filled, in the system's coordinates."""

    def __init__(self, system: System, scene: Scene, t: Any, q: Any, status: list[Status]) -> None:
        self.system, self.scene, self.t, self.q, self.status = system, scene, t, q, status
        count = len(status)
        self.qd, self.qdd = np.full_like(q, np.nan), np.full_like(q, np.nan)
        self.residual, self.sigma_min, self.condition = (nowhere(count) for _ in range(3))

    def judge(self, lanes: Any) -> None:
        """Fill residual and condition of the poses that were reached, and give each its status."""
        q, t = self.q[:, lanes], self.t[lanes]
        self.residual[lanes] = np.max(np.abs(self.system.phi(q, t)), axis=0)
        sigma = np.linalg.svd(np.moveaxis(self.system.phi_q(q, t), -1, 0), compute_uv=False)
        self.sigma_min[lanes] = sigma[:, self.system.n - 1]
        with np.errstate(divide="ignore"):
            self.condition[lanes] = sigma[:, 0] / self.sigma_min[lanes]
        closed = self.residual[lanes] <= 32 * EPS * np.maximum(1.0, np.max(np.abs(q), axis=0))
        for k, is_closed, smallest in zip(lanes, closed, self.sigma_min[lanes], strict=True):
            isolated = Status.OK if smallest > SINGULAR else Status.SINGULAR
            self.status[k] = isolated if is_closed else Status.NOT_CONVERGED

    def rates(self, lanes: Any) -> None:
        """Fill velocity and acceleration where the pose is isolated, as far as the scene calls for them."""
        q, t = self.q[:, lanes], self.t[lanes]
        if not self.system.effects or not lanes.size:
            return
        self.qd[:, lanes] = velocity(self.system, q, t)
        if Effect.ACCELERATION in self.system.effects:
            self.qdd[:, lanes] = acceleration(self.system, q, self.qd[:, lanes], t)

    def motion(self, message: str) -> Motion:
        """Return the answer in metres, for the bodies and effects that the scene calls for."""
        scene, wants = self.scene, self.scene.effects
        self.q[:, [k for k, s in enumerate(self.status) if s in (Status.NOT_CONVERGED, Status.UNASSEMBLABLE)]] = np.nan
        levels = [self.system.to_physical(level, order) for order, level in enumerate((self.q, self.qd, self.qdd))]
        called = (True, Effect.VELOCITY in wants, Effect.ACCELERATION in wants)
        rows = np.concatenate([np.r_[self.system.columns(b)] for b in scene.wanted])
        condition = Evidence.CONDITION in scene.evidence
        count = len(self.status)
        return Motion(
            t=self.t,
            bodies=scene.wanted,
            q=levels[0][rows],
            qd=levels[1][rows] if called[1] else None,
            qdd=levels[2][rows] if called[2] else None,
            status=tuple(self.status),
            residual=self.residual,
            sigma_min=self.sigma_min if condition else nowhere(count),
            condition=self.condition if condition else nowhere(count),
            certified_radius=CertifiedRadius(
                position=nowhere(count), velocity=nowhere(count), acceleration=nowhere(count)
            ),
            points=self._points(levels, called),
            producer=Producer(name="refkin", version=version("refkin"), route=ROUTE),
            message=message,
        )

    def _points(self, levels: list[Any], called: tuple[bool, bool, bool]) -> dict[str, PointMotion]:
        found = {}
        for point in self.scene.points:
            at = self.system.columns(point.body)
            motion = point_motion(point.position, *(level[at] for level in levels))
            found[point.name] = PointMotion(
                r=motion.r, v=motion.v if called[1] else None, a=motion.a if called[2] else None
            )
        return found


def _solve(matrix: Any, right: Any) -> Any:
    """Solve for one right side or for a batch in the last axis; redundant rows by least squares."""
    stacked = np.moveaxis(matrix, -1, 0) if matrix.ndim == 3 else matrix
    columns = np.moveaxis(right, -1, 0)[..., None] if matrix.ndim == 3 else right[:, None]
    if matrix.shape[0] == matrix.shape[1]:
        x = np.linalg.solve(stacked, columns)[..., 0]
    else:
        x = (np.linalg.pinv(stacked) @ columns)[..., 0]
    return np.moveaxis(x, 0, -1) if matrix.ndim == 3 else x
