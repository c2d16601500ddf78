"""Position, velocity and acceleration analysis at one time, and of a whole scene.

============ ====================== =========
position     phi(q, t) = 0          by Newton
velocity     phi_q qd = nu          linear
acceleration phi_q qdd = gamma      linear
============ ====================== =========
"""

from __future__ import annotations

from dataclasses import replace
from importlib.metadata import version
from typing import Any

import numpy as np

from refkin.contacts import end_of_profile
from refkin.differences import EPS
from refkin.model import Effect, Evidence, Scene
from refkin.motion import CertifiedRadius, ContactMotion, Motion, PointMotion, Producer, Route, Seeding, Status, nowhere
from refkin.newton import NewtonResult, newton
from refkin.points import point_motion
from refkin.proof.assembly import assemblies
from refkin.proof.isolate import isolate
from refkin.starts import find_start, unassemblable
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


def velocity(system: System, q: Any, t: Any, phi_q: Any = None) -> Any:
    """Return qd with phi_q qd = nu, in the shape of q: (n,) or (n, B); `phi_q` at q, t is evaluated unless given."""
    return _solve(system.phi_q(q, t) if phi_q is None else phi_q, system.nu(q, t))


def acceleration(system: System, q: Any, qd: Any, t: Any, phi_q: Any = None) -> Any:
    """Return qdd with phi_q qdd = gamma, in the shape of q: (n,) or (n, B); `phi_q` as in `velocity`."""
    return _solve(system.phi_q(q, t) if phi_q is None else phi_q, system.gamma(q, qd, t))


def solve(scene: Scene) -> Motion:
    """Return position and what else the scene calls for, with evidence, on the branch of its estimates.

    Numbers that fail are statuses in the result, never exceptions.
    """
    implied = {Effect.VELOCITY} if Effect.ACCELERATION in scene.effects else set()
    system = compile_system(scene.mechanism, scene.effects | implied, scene.mechanism.unit())
    q, status, message = _positions(system, scene)
    answer = _Answer(system, scene, q, status)
    reached = np.flatnonzero(np.isfinite(q[0]))
    if reached.size:
        answer.judge(reached)
    return answer.motion(message)


def _positions(system: System, scene: Scene) -> tuple[Any, list[Status], str]:
    """Return the poses that were reached (NaN elsewhere), a first status per time, and a message."""
    count = len(scene.times)
    q = np.full((system.n, count), np.nan)
    start = find_start(system, scene)
    if start.q is None:
        later = [Status.NOT_CONVERGED] * (count - 1)
        return q, _proved(system, scene, [start.status, *later])[0], start.message
    q[:, 0] = start.q
    sweep = Sweep(system, [scene.times[0]], [start.q])
    done, why = 1, ""
    while done < count and not why:
        arrival = sweep.to(scene.times[done])
        if arrival is Arrival.STOPPED:
            cam = end_of_profile(system, sweep.q[-1])
            end = f"the contact of {cam} leaves its profile" if cam else "the branch ends at a singular pose"
            why = f"{end} after t = {sweep.t[-1]:.17g}"
            break
        q[:, done] = sweep.q[-1]
        done += 1
        if arrival is Arrival.AT_SINGULAR_POSE:
            why = f"the pose at t = {sweep.t[-1]:g} is singular: how the branch goes on is not decided"
    status, gap = _proved(system, scene, [Status.OK] * done + [Status.BRANCH_LOST] * (count - done))
    return q, status, "; ".join(filter(None, (start.message, why, gap)))


def _proved(system: System, scene: Scene, status: list[Status]) -> tuple[list[Status], str]:
    """Return the statuses with UNASSEMBLABLE where that is proved of a pose that was not reached, and the first gap."""
    told = ""
    for k, t in enumerate(scene.times):
        if status[k] in (Status.BRANCH_LOST, Status.NOT_CONVERGED):
            found = assemblies(system, t, trying=False)
            if found.unassemblable:
                status[k] = Status.UNASSEMBLABLE
                told = told or f"at t = {t:g} {unassemblable(system, found)}"
    return status, told


class _Answer:
    """The arrays of a motion while they are filled, in the system's coordinates."""

    def __init__(self, system: System, scene: Scene, q: Any, status: list[Status]) -> None:
        self.system, self.scene, self.t, self.q, self.status = system, scene, np.array(scene.times), q, status
        count = len(status)
        self.note = ""
        self.qd, self.qdd = np.full_like(q, np.nan), np.full_like(q, np.nan)
        self.residual, self.sigma_min, self.condition = (nowhere(count) for _ in range(3))
        self.radius = CertifiedRadius(position=nowhere(count), velocity=nowhere(count), acceleration=nowhere(count))

    def judge(self, lanes: Any) -> None:
        """Fill rates and evidence of the poses that were reached, and give each its status."""
        q, t = self.q[:, lanes], self.t[lanes]
        self.residual[lanes] = np.max(np.abs(self.system.phi(q, t)), axis=0)
        solvable, regular = self._regular(lanes, np.moveaxis(self.system.phi_q(q, t), -1, 0))
        self._rates(lanes[solvable])
        proved = Evidence.CERTIFICATE in self.scene.evidence
        ok = np.where(proved, False, regular)
        for group in (lanes[~ok & solvable], lanes[~ok & ~solvable]):
            ok[np.isin(lanes, group)] = self._prove(group)
        closed = self.residual[lanes] <= 32 * EPS * np.maximum(1.0, np.max(np.abs(q), axis=0))
        for k, isolated, closes in zip(lanes, ok, closed, strict=True):
            if self.status[k] is Status.OK:
                open_ = Status.SINGULAR if closes else Status.NOT_CONVERGED
                self.status[k] = Status.OK if isolated else open_
            if self.status[k] is not Status.OK:
                self.qd[:, k] = self.qdd[:, k] = np.nan
                for radii in (self.radius.position, self.radius.velocity, self.radius.acceleration):
                    radii[k] = np.nan

    def _regular(self, lanes: Any, jacobian: Any) -> tuple[Any, Any]:
        """Return which phi_q (B, m, n) can be solved with, and which have a sigma_min above SINGULAR.

        Singular values are computed where the scene calls for them, and where a bound that costs less leaves doubt.
        """
        n = self.system.n
        solvable = np.zeros(len(lanes), bool)
        if Evidence.CONDITION not in self.scene.evidence:
            limit = np.maximum(SINGULAR, n * EPS * np.linalg.norm(jacobian, axis=(1, 2)))
            solvable = _at_least(jacobian) > 2 * limit  # 2: the bound is rounded
        regular, asked = solvable.copy(), ~solvable
        if asked.any():
            sigma = np.linalg.svd(jacobian[asked], compute_uv=False)
            smallest = self.sigma_min[lanes[asked]] = sigma[:, n - 1]
            with np.errstate(divide="ignore"):
                self.condition[lanes[asked]] = sigma[:, 0] / smallest
            solvable[asked], regular[asked] = smallest > n * EPS * sigma[:, 0], smallest > SINGULAR
        return solvable, regular

    def _rates(self, lanes: Any) -> None:
        """Fill velocity and acceleration, as far as the scene calls for them."""
        if not self.system.effects or not lanes.size:
            return
        q, t = self.q[:, lanes], self.t[lanes]
        phi_q = self.system.phi_q(q, t)
        self.qd[:, lanes] = velocity(self.system, q, t, phi_q)
        if Effect.ACCELERATION in self.system.effects:
            self.qdd[:, lanes] = acceleration(self.system, q, self.qd[:, lanes], t, phi_q)

    def _prove(self, lanes: Any) -> Any:
        """Return which poses are isolated, by proof, and note the proved radii."""
        if not lanes.size:
            return np.zeros(0, bool)
        rates = [level[:, lanes] if np.isfinite(level[:, lanes]).all() else None for level in (self.qd, self.qdd)]
        found = isolate(self.system, self.q[:, lanes], self.t[lanes], *rates)
        for name in ("position", "velocity", "acceleration"):
            getattr(self.radius, name)[lanes] = getattr(found, name)
        for k, size in zip(lanes, found.contradiction, strict=True):
            if size > 1.0:
                self.status[k] = Status.UNASSEMBLABLE
                self.note = f"redundant rows contradict each other: {size:.3g} times what rounding explains"
        return found.ok

    def motion(self, message: str) -> Motion:
        """Return the answer in metres, for the bodies and effects that the scene calls for."""
        scene, wants = self.scene, self.scene.effects
        self.q[:, [k for k, s in enumerate(self.status) if s in (Status.NOT_CONVERGED, Status.UNASSEMBLABLE)]] = np.nan
        computed = (True, bool(self.system.effects), Effect.ACCELERATION in self.system.effects)
        levels: list[Any] = [
            self.system.to_physical(level, order) if computed[order] else None
            for order, level in enumerate((self.q, self.qd, self.qdd))
        ]
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
            certified_radius=self.radius,
            points=self._points(levels, called),
            contacts=self._contacts(levels, called),
            producer=Producer(name="refkin", version=version("refkin"), route=ROUTE),
            message="; ".join(filter(None, (message, self.note))),
        )

    def _contacts(self, levels: list[Any], called: tuple[bool, bool, bool]) -> dict[str, ContactMotion]:
        found = {}
        for joint in self.scene.mechanism.joints:
            if joint.parameters:
                at = self.system.parameter(joint.name).start
                sd, sdd = (level[at] if wanted else None for level, wanted in zip(levels[1:], called[1:], strict=True))
                found[joint.name] = ContactMotion(s=levels[0][at], sd=sd, sdd=sdd)
        return found

    def _points(self, levels: list[Any], called: tuple[bool, bool, bool]) -> dict[str, PointMotion]:
        found = {}
        for point in self.scene.points:
            at = self.system.columns(point.body)
            motion = point_motion(point.position, *(None if level is None else level[at] for level in levels))
            found[point.name] = replace(motion, v=motion.v if called[1] else None)
        return found


def _at_least(matrices: Any) -> Any:
    """Return a lower bound of the smallest singular value of each matrix (B, m, n), m >= n; 0 if none is known.

    It is 1 / |M^-1| in Frobenius's norm, at most sqrt(n) below that value; of redundant rows the factor R has the
    singular values.
    """
    square = matrices if matrices.shape[1] == matrices.shape[2] else np.linalg.qr(matrices, mode="r")
    try:
        return 1.0 / np.linalg.norm(np.linalg.inv(square), axis=(1, 2))
    except np.linalg.LinAlgError:  # one of them is singular to the last bit
        return np.zeros(len(matrices))


def _solve(matrix: Any, right: Any) -> Any:
    """Solve for one right side or for a batch in the last axis; redundant rows by least squares."""
    stacked = np.moveaxis(matrix, -1, 0) if matrix.ndim == 3 else matrix
    columns = np.moveaxis(right, -1, 0)[..., None] if matrix.ndim == 3 else right[:, None]
    if matrix.shape[0] == matrix.shape[1]:
        x = np.linalg.solve(stacked, columns)[..., 0]
    else:
        x = (np.linalg.pinv(stacked) @ columns)[..., 0]
    return np.moveaxis(x, 0, -1) if matrix.ndim == 3 else x
