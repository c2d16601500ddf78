"""Positions of spatial mechanisms by exudyn's own static solver, time by time, and rates from its rows.

`static` starts where exudyn's own velocity points, halves the step where its Newton ends elsewhere, and takes no pose
in which axes that should have one direction have opposite ones, or a driven angle is off by pi: exudyn's rows are zero
there too. `shipped` is what a user gets who changes no setting: each solve starts at the last answer, and is believed.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import exudyn as exu
import numpy as np

from crosscheck.engines import EngineError, Term
from crosscheck.engines.exudyn.model import CURRENT, quiet_settings
from crosscheck.engines.exudyn.solve import ASTRAY, NEAR, SMALLEST_STEP, TOLERANCES
from crosscheck.engines.exudyn.space import FORM, ExudynSpace, law_value
from crosscheck.engines.march import EPS, SINGULAR, connected, inverses, solve
from crosscheck.engines.spatial.motion import coordinates, estimates, reported
from crosscheck.engines.spatial.reading import ANGLE, AXIAL, DISTANCE, Numbers, numbers_of
from crosscheck.engines.spatial.turning import matrix, rates
from refkin.joints import GROUND
from refkin.model import Effect, Scene
from refkin.motion import Motion, Producer, Status

Array = Any
ACCEPTED, SHIPPED_ACCEPTED = 1e-11, 1e-6
"""Largest component of its rows with which an answer is believed, for coordinates of order 1."""
CORRECTIONS, SETTLED = 4, 4.0 * EPS
"""How often a pose may be corrected once more, and the largest component of its rows at which it no longer is."""
LARGEST_TURN = 0.25
"""A pose may differ from its prediction by so much at most [sizes, half rad]: further off is another assembly."""


def space_solved(scene: Scene, producer: Producer, *, shipped: bool) -> Motion:
    """Return exudyn's answer to a scene of space.

    Raises
    ------
    EngineError
        If a body has no estimate, or exudyn cannot express a joint.
    """
    model = SpaceModel(scene)
    try:
        return model.solve(scene, producer, shipped=shipped)
    finally:
        model.model.close()


class SpaceModel:
    """exudyn's model of a scene of space, which may be solved again and again.

    Raises
    ------
    EngineError
        If a body has no estimate, or exudyn cannot express a joint.
    """

    def __init__(self, scene: Scene, tolerances: Sequence[float] = TOLERANCES) -> None:
        self.numbers, self.tolerances = numbers_of(scene.mechanism), tolerances
        start = estimates(scene, self.numbers)
        lost = [body for body, at in start.items() if at is None]
        if lost:
            raise EngineError(f"exudyn needs a start: no estimate for {', '.join(lost)}")
        self.start = np.concatenate([start[body] for body in self.numbers.bodies])
        self.model = ExudynSpace(self.numbers, self.numbers.holds, self.numbers.drives)

    def solve(self, scene: Scene, producer: Producer, *, shipped: bool = False) -> Motion:
        """Return the motion of a scene of the same mechanism, from the estimates."""
        marcher = _Marcher(self.model, scene, self.numbers, self.tolerances, shipped=shipped)
        return marcher.run(self.start, producer)


class _Pose:
    """A pose with its Jacobian in columns (v, w), spins included, and its velocities (6 b,)."""

    def __init__(self, t: float, q: Array, jacobian: Array, velocity: Array) -> None:
        self.t, self.q, self.jacobian, self.velocity = t, q, jacobian, velocity
        self.inverse = inverses(jacobian[None])


class _Marcher:
    def __init__(
        self, model: ExudynSpace, scene: Scene, numbers: Numbers, tolerances: Sequence[float], *, shipped: bool
    ) -> None:
        self.model, self.scene, self.numbers, self.shipped = model, scene, numbers, shipped
        self.tolerances = tolerances
        self.idle = [7 * numbers.bodies.index(body) + k for spin in numbers.idle for body in spin for k in range(3, 7)]
        self.moving = np.delete(np.arange(model.n), self.idle)
        self.last: _Pose | None = None
        self.default = quiet_settings()

    def run(self, start: Array, producer: Producer) -> Motion:
        """Return the poses at all times of the scene, from an estimate of the first."""
        times, count = self.scene.times, len(self.numbers.bodies)
        r, w = np.full((3, len(times), count, 3), np.nan), np.full((2, len(times), count, 3), np.nan)
        p = np.full((len(times), count, 4), np.nan)
        status, residual, message = [], np.full(len(times), np.nan), ""
        for k, t in enumerate(times):
            try:
                pose = self._pose(t, start, None) if self.last is None else self._advanced(self.last, t)
            except EngineError as error:
                status.append(Status.NOT_CONVERGED)
                message = message or f"exudyn, first at t = {t!r}: {error}"
                continue
            self.last = pose
            at = pose.q.reshape(count, 7)
            r[0, k], p[k] = at[:, :3], at[:, 3:]
            residual[k] = self._residual(pose.q, t)
            # At a fold a residual r leaves a pose that is off by about the root of r, and so is sigma_min.
            limit = SINGULAR if self.shipped else max(SINGULAR, np.sqrt(residual[k]))
            sigma = np.linalg.svd(pose.jacobian, compute_uv=False)
            if len(sigma) < 6 * count or sigma[-1] <= limit:
                status.append(Status.SINGULAR)
                continue
            acceleration = self._acceleration(pose)
            for order, level in enumerate((pose.velocity, acceleration), 1):
                r[order, k], w[order - 1, k] = np.split(level.reshape(count, 6), 2, axis=1)
            finite = np.isfinite(pose.velocity).all() and np.isfinite(acceleration).all()
            status.append(Status.OK if finite else Status.SINGULAR)
        levels = coordinates(r, p, w)
        return reported(self.scene, self.numbers, levels, tuple(status), producer, residual=residual, message=message)

    def _advanced(self, last: _Pose, t: float) -> _Pose:
        """Return the pose at t on the branch of the last one, by steps that are halved where its Newton goes astray."""
        if self.shipped:
            return self._pose(t, last.q, None)
        step = t - last.t
        smallest = step * SMALLEST_STEP
        while last.t < t:
            target = t if last.t + step >= t else last.t + step
            try:
                last = self._pose(target, self._predicted(last, target - last.t), last)
            except EngineError:
                step = (target - last.t) / 2
                if step < smallest:
                    raise
            else:
                step *= 2
        return last

    def _predicted(self, last: _Pose, h: float) -> Array:
        at, v = last.q.reshape(-1, 7), last.velocity.reshape(-1, 6)
        moved = np.concatenate([at[:, :3] + h * v[:, :3], at[:, 3:] + h * rates(at[:, 3:], v[:, 3:])], axis=1)
        moved[:, 3:] /= np.linalg.norm(moved[:, 3:], axis=1, keepdims=True)
        return moved.ravel()

    def _pose(self, t: float, start: Array, last: _Pose | None) -> _Pose:
        """Return the pose that exudyn finds from a start; EngineError says why it is not believed."""
        q = (self._shipped_newton if self.shipped else self._newton)(t, start)
        if not np.isfinite(q).all():
            raise EngineError("its Newton ended in no number")
        at = q.reshape(-1, 7)
        at[:, 3:] /= np.linalg.norm(at[:, 3:], axis=1, keepdims=True)
        gap = self._residual(q, t)
        accepted = SHIPPED_ACCEPTED if self.shipped else max(ACCEPTED, 10.0 * self.tolerances[-1])
        if not gap <= accepted * max(1.0, np.abs(q).max()):
            raise EngineError(f"it reported success with a residual of {gap:.1e}")
        if not self.shipped:
            self._check_directions(q, t)
        jacobian = self._jacobian(q, t)
        pose = _Pose(t, q, jacobian, self._solved(jacobian, -self._rates_at_rest(q, t)))
        if last is not None:
            off, way = (np.abs((q - x)[self.moving]).max() for x in (start, last.q))
            if off > min(max(ASTRAY * way, NEAR), LARGEST_TURN):
                raise EngineError("no step is small enough for its Newton to stay near the motion predicted")
            if not connected(last.inverse, jacobian[None])[0]:
                raise EngineError("a singular pose may lie between two poses")
        return pose

    def _newton(self, t: float, start: Array) -> Array:
        extent = max(1.0, np.abs(start).max())
        for tolerance in self.tolerances:
            if self.model.newton(start, t, tolerance * extent):
                return self._corrected(t, self.model.coordinates(), tolerance * extent)
        raise EngineError("its Newton did not converge")

    def _corrected(self, t: float, q: Array, tolerance: float) -> Array:
        """Return the pose without what the tolerance left: exudyn accepts no first residual without a correction.

        One is not always enough: of redundant rows its pivots choose some, and the others may keep their residual.
        """
        poses = [q]
        for _ in range(CORRECTIONS):
            if not self.model.newton(poses[-1], t, tolerance):
                break
            poses.append(self.model.coordinates())
            if self._residual(poses[-1], t) <= SETTLED * max(1.0, np.abs(q).max()):
                break
        return min(poses[1:] or poses, key=lambda pose: self._residual(pose, t))

    def _residual(self, q: Array, t: float) -> float:
        """Return the largest residual of exudyn's rows."""
        return float(np.abs(self.model.residual(q, t)).max(initial=0.0))

    def _shipped_newton(self, t: float, start: Array) -> Array:
        model = self.model
        model.set_state(start, t)
        initial = exu.ConfigurationType.Initial
        model.data.SetODE2Coordinates(model.data.GetODE2Coordinates(CURRENT), initial)
        settings = self.default
        settings.linearSolver.solverType = exu.LinearSolverType.EigenDense
        settings.linearSolver.ignoreSingularJacobian = True
        try:
            success = model.mbs.SolveStatic(settings)
        except (exu.SolverError, exu.InternalError) as error:
            raise EngineError(f"SolveStatic: {str(error).strip().splitlines()[0]}") from error
        if not success:
            raise EngineError("SolveStatic reported no success")
        return model.coordinates()

    def _check_directions(self, q: Array, t: float) -> None:
        """Raise EngineError where axes are antiparallel, or a crank is off by pi: closed equations, and no assembly."""
        at = {GROUND: np.eye(3)} | {
            body: matrix(pose[3:]) for body, pose in zip(self.numbers.bodies, q.reshape(-1, 7), strict=True)
        }
        for hold in self.numbers.holds:
            x, y = at[hold.body_i] @ hold.frame_i, at[hold.body_j] @ hold.frame_j
            if hold.kind in AXIAL and x[:, 2] @ y[:, 2] < 0.0:
                raise EngineError(f"it reported success with the axes of {hold.name!r} antiparallel")
            if hold.kind in ("prismatic", "fixed") and x[:, 0] @ y[:, 0] < 0.0:
                raise EngineError(f"it reported success with {hold.name!r} turned by pi")
        for drive in self.numbers.drives:
            if drive.kind == ANGLE:
                x, y = at[drive.hold.body_i] @ drive.hold.frame_i, at[drive.hold.body_j] @ drive.hold.frame_j
                f = law_value(drive, t, 0)
                if (np.cos(f) * x[:, 0] + np.sin(f) * x[:, 1]) @ y[:, 0] < 0.0:
                    raise EngineError(f"it reported success with {drive.name!r} off by pi")

    def _jacobian(self, q: Array, t: float) -> Array:
        """Return exudyn's Jacobian in columns (v, w), with a row for each idle spin."""
        return np.concatenate([self.model.jacobian(q, t), *self._spins(q)])

    def _spins(self, q: Array) -> Sequence[Array]:
        rows = []
        for spin in self.numbers.idle:
            body, (_, line) = next(iter(spin.items()))
            k = self.numbers.bodies.index(body)
            row = np.zeros((1, 6 * len(self.numbers.bodies)))
            row[0, 6 * k + 3 : 6 * k + 6] = matrix(q[7 * k + 3 : 7 * k + 7]) @ line
            rows.append(row)
        return rows

    def _rates_at_rest(self, q: Array, t: float) -> Array:
        self.model.set_state(q, t, np.zeros(self.model.n))
        return self.model.law_rates(q, t)

    def _solved(self, jacobian: Array, right: Array) -> Array:
        whole = np.concatenate([right, np.zeros(len(jacobian) - len(right))])
        found: Array = solve(jacobian[None], whole[None])[0]
        return found

    def _acceleration(self, pose: _Pose) -> Array:
        if Effect.ACCELERATION not in self.scene.effects:
            return np.zeros_like(pose.velocity)
        at, v = pose.q.reshape(-1, 7), pose.velocity.reshape(-1, 6)
        qd = np.concatenate([v[:, :3], rates(at[:, 3:], v[:, 3:])], axis=1).ravel()
        return self._solved(pose.jacobian, self.model.drift(pose.q, qd, pose.t))


def shipped_stop(scene: Scene) -> Term:
    """Return what SolveStatic leaves of the residual by its default tolerances, as in the plane (`_shipped_stop`).

    A start is the last pose, where only the drivers' rows are not zero, and at the first time the estimate.
    """
    numbers = numbers_of(scene.mechanism)
    newton = quiet_settings().staticSolver.newton
    start = estimates(scene, numbers)
    model = ExudynSpace(numbers, numbers.holds, numbers.drives)
    try:
        at = np.concatenate([start[body] for body in numbers.bodies])
        norms = [float(np.linalg.norm(model.residual(at, scene.times[0])))]
    finally:
        model.close()
    values = np.array([[law_value(drive, t, 0) for t in scene.times] for drive in numbers.drives])
    norms += np.linalg.norm(np.diff(values), axis=0).tolist() if numbers.drives else []
    stop = max(newton.absoluteTolerance, newton.relativeTolerance * max(norms))
    lengths = [abs(float(x)) for k, d in enumerate(numbers.drives) if d.kind == DISTANCE for x in values[k]]
    return Term(
        name="stopping rule",
        level="position",
        reason=f"SolveStatic stops at a residual of {stop:.1e} sizes or half rad by its default tolerances",
        absolute=2.0 * stop * max([1.0, *lengths]),
        form=FORM,
    )
