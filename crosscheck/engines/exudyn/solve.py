"""Positions by exudyn's own static solver, time by time, and the rates that follow from its rows."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Any

import exudyn as exu
import numpy as np

from crosscheck.engines import Array, EngineError
from crosscheck.engines.exudyn.model import CURRENT, ExudynModel, quiet_settings
from crosscheck.engines.exudyn.parts import is_slider
from crosscheck.engines.march import EPS, SINGULAR, Tabulated, connected, inverses, solve
from refkin.joints import RelativeAngle, elements_of
from refkin.model import Effect, Scene
from refkin.motion import Status

TOLERANCES = (1e-14, 1e-13, 1e-12)
"""Norms of the residual, in sizes of the mechanism, at which exudyn's Newton may stop: the first that it reaches."""
STALLED = 1e-9
"""A residual below this after a failed Newton has stalled at round-off, not gone astray."""
SETTLED = 0.5 * EPS
"""A residual up to this is not corrected once more; with four times as much rates were off by twice as much."""
ASTRAY, NEAR = 0.25, 0.01
"""A pose may differ from its prediction by this part of the way from the last pose, or by this much [sizes, rad]."""
APART = 8.0
"""Two assemblies near each other are about sigma_min apart: a pose moved by less than this part of it is the nearer."""
SMALLEST_STEP = 2.0**-24
"""Smallest part of the way to the next time that a march goes at once."""


AT_ONCE = 36
"""Poses that are found before they are looked at."""


class BranchLostError(EngineError):
    """No step is small enough to tell which of two assemblies continues the motion."""


@dataclass
class Poses:
    """What was found: coordinates (n, T) in the model's unit, NaN where there is no answer."""

    q: Array
    qd: Array
    qdd: Array
    residual: Array
    status: list[Status]
    reason: str = ""
    """Why the first time without an answer has none."""


class StaticNewton:
    """A pose at time t from a start by exudyn's static Newton, to the tightest of `TOLERANCES` that round-off allows.

    Attributes
    ----------
    predicts : bool
        Whether it is to be started at a prediction, and kept from jumping; otherwise it starts at the last pose.
    size : float
        Size of the mechanism in the model's unit.
    accepted : float
        Largest component of the scaled residual with which its answer is believed, for coordinates of order 1.
    """

    predicts = True
    size = 1.0
    accepted = 10.0 * TOLERANCES[-1]

    def __init__(self, model: ExudynModel) -> None:
        self.model = model
        self.settings = quiet_settings()
        self.settings.staticSolver.newton.relativeTolerance = 0.0
        bear_redundant_rows(self.settings, model)
        model.solver.InitializeSolver(model.mbs, self.settings)

    def __call__(self, t: float, start: Array) -> Array:
        model = self.model
        model.set_state(start, t)
        extent = max(1.0, _largest(start))
        for tolerance in TOLERANCES:
            done = self._newton(tolerance * extent)
            left = _largest(model.solver.GetSystemResidual()[model.n :])
            if done:
                q: Array = model.data.GetODE2Coordinates(CURRENT)
                return q if left <= SETTLED else self._corrected_once_more(q, tolerance * extent)
            if not left < STALLED * extent:
                break
        raise EngineError("its Newton did not converge")

    def once(self, t: float, start: Array, tolerance: float) -> Array:
        """Return the pose by one call of exudyn's Newton, stopped at this norm of the residual."""
        self.model.set_state(start, t)
        if not self._newton(tolerance):
            raise EngineError(f"its Newton did not reach {tolerance:g}")
        q: Array = self.model.data.GetODE2Coordinates(CURRENT)
        return q

    def _corrected_once_more(self, q: Array, tolerance: float) -> Array:
        """Return the pose without what the tolerance left: exudyn accepts no first residual without a correction."""
        try:
            better = self._newton(tolerance)
        except EngineError:
            better = False
        return self.model.data.GetODE2Coordinates(CURRENT) if better else q

    def _newton(self, tolerance: float) -> bool:
        self.model.solver.newton.absoluteTolerance = tolerance
        try:
            return bool(self.model.solver.Newton(self.model.mbs, self.settings))
        except (exu.SolverError, exu.InternalError) as error:
            raise EngineError(f"its Newton stopped: {_first_line(error)}") from error


def bear_redundant_rows(settings: Any, model: ExudynModel) -> None:
    """Choose a linear solver that bears the rows of a model: exudyn's default stops at the matrix of redundant ones."""
    if len(model.live) > model.n:
        settings.linearSolver.solverType = exu.LinearSolverType.EigenDense
        settings.linearSolver.ignoreSingularJacobian = True


class ShippedSolve:
    """A pose at time t from a start by mbs.SolveStatic with exudyn's own settings."""

    predicts = False
    # Its relative tolerance 1e-8 refers to the residual of the start, at most a few sizes away.
    accepted = 1e-6

    def __init__(self, model: ExudynModel, size: float) -> None:
        self.model, self.size = model, size
        self.settings = quiet_settings()

    def __call__(self, t: float, start: Array) -> Array:
        model = self.model
        model.set_time(t)
        model.data.SetODE2Coordinates(start, exu.ConfigurationType.Initial)
        try:
            success = model.mbs.SolveStatic(self.settings)
        except (exu.SolverError, exu.InternalError) as error:
            raise EngineError(f"SolveStatic: {_first_line(error)}") from error
        if not success:
            raise EngineError("SolveStatic reported no success")
        return model.data.GetODE2Coordinates(CURRENT)


@dataclass(frozen=True)
class Pose:
    """A pose with exudyn's residual (largest component) and, where they are needed, Jacobian, right side and rate.

    All are scaled by the mechanism's size. The right side is that of the velocities, the rate NaN where the Jacobian is
    singular. `sign` is that of the Jacobian's determinant, 0 if it is not square.
    """

    t: float
    q: Array
    residual: float
    jacobian: Any = None
    right: Any = None
    rate: Any = None
    sign: float = 0.0


class Marcher:
    """Goes from time to time with a solver, each found pose being the start of the next.

    A solver that `predicts` is started where exudyn's own velocity points, and a pose is taken only if it lies near
    that and the determinant of exudyn's Jacobian keeps its sign; otherwise the step is halved. So the branch is kept.
    Where the pose near the prediction is the one whose sign has changed, the sign is no longer the branch's: the motion
    itself may go through a singular pose, as a parallelogram does where it is flat. From there on a pose is taken only
    if exudyn's Newton moved the prediction by less than assemblies lie apart; where no step does that, and where a pose
    that is singular to rounding is left, the branch is lost, for all later times too. Any other time without an answer
    is marked, and the next one is tried from the last good pose.

    Several poses are found at once, each started where those before it point, and only then looked at, together
    (`_several`). What is not as plain as can be is found once more, one pose after another.
    """

    def __init__(self, model: ExudynModel, scene: Scene, solver: StaticNewton | ShippedSolve) -> None:
        self.model, self.scene, self.solver = model, scene, solver
        self.acceleration = Effect.ACCELERATION in scene.effects
        self.velocity = self.acceleration or Effect.VELOCITY in scene.effects
        self.row_scale = solver.size**model.powers
        self.column_scale = np.tile([solver.size, solver.size, 1.0], model.n // 3)
        columns = {body.name: 3 * k + 2 for k, body in enumerate(scene.mechanism.bodies)}
        joints = [tuple(elements_of([joint])) for joint in scene.mechanism.joints]
        held: list[Any] = [elements[1] for elements in joints if is_slider(elements)]
        self.slides = [(angle, *map(columns.get, angle.bodies)) for angle in held]
        self.last: Pose | None = None
        self.sign = 0.0
        self.at_once = AT_ONCE
        highest = 2 if self.acceleration else int(self.velocity or solver.predicts)
        for k, (law, shift, size) in enumerate(model.clock.laws):
            table: Any = Tabulated(law)
            for order in range(highest + 1):
                table(np.array(scene.times), order)
            model.clock.laws[k] = (table, shift, size)
        model.clock.least = highest

    def run(self, start: Array) -> Poses:
        """Return the poses at all times of the scene, from an estimate of the first."""
        times, answers = self.scene.times, list[Pose | EngineError]()
        start = self._on_the_turn_meant(start)
        lost = True
        while len(answers) < len(times):
            t = times[len(answers)]
            try:
                ahead = times[len(answers) : len(answers) + self.at_once]
                if self.last is None or lost or not (self.solver.predicts or self.velocity):
                    poses = [self._pose(t, start if self.last is None else self.last.q)]
                elif not self.solver.predicts:
                    poses = self._in_a_row(self.last, ahead) or [self._pose(t, self.last.q)]
                else:
                    poses = self._several(answers, self.last, ahead)
                    self.at_once = min(2 * self.at_once, AT_ONCE) if poses else max(self.at_once // 2, 1)
                    poses = poses or [self._advanced(self.last, t)]
            except BranchLostError as error:
                answers += [error] * (len(times) - len(answers))
            except EngineError as error:
                answers.append(error)
                lost = True
            else:
                answers += poses
                self.last, self.sign, lost = poses[-1], self.sign or poses[-1].sign, False
        return self._with_rates(answers)

    def _with_rates(self, answers: Sequence[Pose | EngineError]) -> Poses:
        """Return what was found at the times, with velocity and acceleration as far as the scene calls for them."""
        q, qd, qdd = (np.full((self.model.n, len(answers)), np.nan) for _ in range(3))
        residual, status, reason = np.full(len(answers), np.nan), [Status.NOT_CONVERGED] * len(answers), ""
        there = [k for k, pose in enumerate(answers) if isinstance(pose, Pose)]
        poses = [pose for pose in answers if isinstance(pose, Pose)]
        for k, error in enumerate(answers):
            if isinstance(error, EngineError):
                reason = reason or str(error)
                status[k] = Status.BRANCH_LOST if isinstance(error, BranchLostError) else status[k]
        if poses:
            q[:, there], residual[there] = np.array([pose.q for pose in poses]).T, [pose.residual for pose in poses]
        if self.velocity and poses:
            jacobians, rights = (np.array([getattr(pose, name) for pose in poses]) for name in ("jacobian", "right"))
            qd[:, there] = (self.column_scale * solved(jacobians, rights)).T
            if self.acceleration:
                drifts = [self.model.drift(pose.q, qd[:, k], pose.t) for k, pose in zip(there, poses, strict=True)]
                rights = np.array(drifts)[:, self.model.live] / self.row_scale
                qdd[:, there] = (self.column_scale * solved(jacobians, rights)).T
        finite: Any = np.isfinite(qd[:, there] if self.velocity else q[:, there]).all(axis=0)
        if self.acceleration:
            finite &= np.isfinite(qdd[:, there]).all(axis=0)
        for k, known in zip(there, finite.tolist(), strict=True):
            status[k] = Status.OK if known else Status.SINGULAR
        if poses and poses[0].jacobian is not None:
            for k in np.array(there)[_singular(np.array([pose.jacobian for pose in poses]))]:
                status[k], qd[:, k], qdd[:, k] = Status.SINGULAR, np.nan, np.nan  # its rates would be rounding
        return Poses(q, qd, qdd, residual, status, reason)

    def _in_a_row(self, last: Pose, times: Sequence[float]) -> list[Pose]:
        """Return poses at the first of the next times, each found from the one before, believed as in `_seen`."""
        at, q, rows = list[float](), [last.q], list[tuple[Array, Array, Array]]()
        try:
            for t in times:
                found = self.solver(t, q[-1])
                rows.append(self.model.at_rest(found, t))
                at.append(t)
                q.append(found)
        except EngineError:
            pass
        if not at:
            return []
        poses = np.array(q[1:])
        residual, jacobian, right = self._scaled(*(np.array(part) for part in zip(*rows, strict=True)))
        gap = np.abs(residual).max(axis=1)
        good = gap <= self.solver.accepted * np.maximum(1.0, np.abs(poses / self.column_scale).max(axis=1))
        for _, _, turned in self._turned(poses.T):
            good &= np.abs(turned) <= 1.0
        count = int(np.argmin(np.append(good, False)))
        return [Pose(*parts) for parts in zip(at[:count], q[1:], gap, jacobian, right, strict=False)]

    def _several(self, answers: Sequence[Pose | EngineError], last: Pose, times: Sequence[float]) -> list[Pose]:
        """Return poses at the first of the next times: those that plainly continue the motion one after another.

        Each starts on the polynomial through the poses before it. Then the tests of `_pose` are made on all of them;
        beyond these, no pose may be near a singular one, and no singular one may lie between two of them.
        """
        if not self.sign:
            return []
        known = [(pose.t, pose.q) for pose in answers[-4:] if isinstance(pose, Pose)] or [(last.t, last.q)]
        first, rows, model = len(known), list[tuple[Array, Array, Array]](), self.model
        try:
            for t in times:
                start = self._predicted(last, t) if len(known) == 1 else _extrapolated(known[-4:], t)
                q = self.solver(t, start)
                rows.append(model.at_rest(q, t))
                known.append((t, q))
        except EngineError:
            pass
        if not rows:
            return []
        at, q = (np.array(part) for part in zip(*known[first - 1 :], strict=True))
        residual, jacobian, right = self._scaled(*(np.array(part) for part in zip(*rows, strict=True)))
        rate = self.column_scale * solved(jacobian, right)
        jacobian, rates = np.concatenate([last.jacobian[None], jacobian]), np.concatenate([last.rate[None], rate])
        inverse, sign, gap = inverses(jacobian), np.linalg.slogdet(jacobian[1:])[0], np.abs(residual).max(axis=1)
        off = np.abs(np.diff(q, axis=0) - np.diff(at)[:, None] * rates[:-1]).max(axis=1)
        with np.errstate(invalid="ignore"):
            plain = off <= np.maximum(ASTRAY * np.abs(np.diff(q, axis=0)).max(axis=1), NEAR)
            plain &= gap <= self.solver.accepted * np.maximum(1.0, np.abs(q[1:] / self.column_scale).max(axis=1))
            plain &= (np.linalg.norm(inverse, axis=(1, 2)) < 1.0 / SINGULAR)[1:] & (sign * self.sign > 0.0)
            plain &= connected(inverse[:-1], jacobian[1:]) & np.isfinite(rate).all(axis=1)
        for _, _, turned in self._turned(q[1:].T):
            plain &= np.abs(turned) <= 1.0
        good = int(np.argmin(np.append(plain, False)))
        whole = zip(at[1:].tolist(), q[1:], gap, jacobian[1:], right, rate, sign, strict=True)
        return [Pose(*parts) for parts in list(whole)[:good]]

    def _scaled(self, residual: Array, jacobian: Array, velocity: Array) -> tuple[Array, Array, Array]:
        """Return residual, Jacobian and right side of the velocities scaled, rows (..., L) without empty ones."""
        live, units = self.model.live, self.row_scale
        scaled = jacobian[..., live, :] * self.column_scale / units[:, None]
        return residual[..., live] / units, scaled, -velocity[..., live] / units

    def _advanced(self, last: Pose, t: float) -> Pose:
        """Return the pose at time t, reached in as many steps as it takes to stay on the branch."""
        smallest, step, crossing = SMALLEST_STEP * (t - last.t), t - last.t, False
        while last.t < t:
            target = t if last.t + step >= t else last.t + step
            try:
                last = self._pose(target, self._predicted(last, target), last, crossing)
            except EngineError as error:
                crossing = crossing or isinstance(error, BranchLostError)
                step = (target - last.t) / 2
                if step < smallest:
                    if crossing:
                        raise BranchLostError(str(error)) from error
                    raise
            else:
                step *= 2
        return last

    def _predicted(self, last: Pose, t: float) -> Array:
        return last.q + (t - last.t) * last.rate if np.isfinite(last.rate).all() else last.q

    def _seen(self, t: float, q: Array) -> Pose:
        """Return exudyn's rows at what its solver found; EngineError says why it is not believed."""
        if self.solver.predicts or self.velocity:
            rows: tuple[Array, ...] = self._scaled(*self.model.at_rest(q, t))
        else:
            rows = (self.model.residual(q, t)[self.model.live] / self.row_scale,)
        gap = _largest(rows[0])
        if not gap <= self.solver.accepted * max(1.0, _largest(q / self.column_scale)):
            raise EngineError(f"it reported success with a residual of {gap:.1e}")
        self._check_turns(q)
        return Pose(t, q, gap, *rows[1:])  # type: ignore[arg-type]

    def _pose(self, t: float, start: Array, last: Pose | None = None, crossing: bool = False) -> Pose:
        """Return the pose that the solver finds from a start; EngineError says why it is not believed."""
        pose = self._seen(t, self.solver(t, start))
        if not self.solver.predicts:
            return pose
        q, jacobian = pose.q, pose.jacobian
        if last is not None and _largest(q - start) > max(ASTRAY * _largest(q - last.q), NEAR):
            raise EngineError("no step is small enough for its Newton to stay near the motion predicted")
        sign = float(np.linalg.slogdet(jacobian)[0]) if len(jacobian) == self.model.n else 0.0
        if sign * self.sign < 0.0:
            raise BranchLostError("the determinant of its Jacobian changed sign: another branch")
        if last is not None and _sigma_min(last.jacobian) <= SINGULAR < _sigma_min(jacobian):
            raise BranchLostError("from a singular pose the motion may go on in two ways")
        if crossing and _largest((q - start) / self.column_scale) > _sigma_min(jacobian) / APART:
            raise BranchLostError("two assemblies are too near each other to tell which of them continues the motion")
        return replace(pose, rate=self.column_scale * solved(jacobian, pose.right), sign=sign)

    def _turned(self, q: Array) -> list[tuple[RelativeAngle, int | None, float]]:
        """Return for each held angle of a slider how far body j is turned from it against body i, turns included."""
        return [
            (held, j, (0.0 if j is None else q[j]) - (0.0 if i is None else q[i]) - held.angle)
            for held, i, j in self.slides
        ]

    def _on_the_turn_meant(self, start: Array) -> Array:
        """Return the estimate without whole turns of body j on a slider: exudyn's sine is blind to them."""
        start = start.copy()
        for k in range(len(self.slides)):
            _, column, off = self._turned(start)[k]
            if column is not None:
                start[column] -= math.tau * round(off / math.tau)
        return start

    def _check_turns(self, q: Array) -> None:
        for held, _, off in self._turned(q):
            if abs(off) > 1.0:
                raise EngineError(f"it holds only the sine of {held.name!r}, and settled {off:.2f} rad off its angle")


def _extrapolated(known: Sequence[tuple[float, Array]], t: float) -> Array:
    """Return where the polynomial through coordinates at times is at t (Lagrange)."""
    times = [at for at, _ in known]
    weights = [math.prod([(t - b) / (a - b) for b in times if b != a]) for a in times]
    with np.errstate(all="ignore"):  # a start that is no number is no start
        return np.asarray(weights @ np.array([q for _, q in known]))


def solved(jacobian: Array, right: Array) -> Array:
    """Return x of jacobian x = right, of redundant rows by least squares; NaN where the matrix is singular.

    Singular also means: x outgrows the right side by so much that the rounding of the matrix alone makes up for it.

    Parameters
    ----------
    jacobian, right : (m, n) and (m,) array, or (B, m, n) and (B, m)
    """
    if jacobian.ndim == 2:
        return solved(jacobian[None], right[None])[0]
    _, m, n = jacobian.shape
    x = solve(jacobian, right)
    if m == n:
        rounding = n * EPS * np.abs(jacobian).max(axis=(1, 2)) * np.abs(x).max(axis=1)
        sound = rounding <= np.abs(right).max(axis=1)
    else:
        sigma = np.linalg.svd(jacobian, compute_uv=False)
        sound = sigma[:, -1] > EPS * max(m, n) * sigma[:, 0]
    return np.where(sound[:, None], x, np.nan)


def _singular(jacobians: Array) -> Any:
    """Return at which of B Jacobians sigma_min is at most `SINGULAR`; the inverse's norm is a bound of it."""
    singular = ~(np.linalg.norm(inverses(jacobians), axis=(1, 2)) < 0.5 / SINGULAR)
    singular[singular] = np.linalg.svd(jacobians[singular], compute_uv=False)[:, -1] <= SINGULAR
    return singular


def _largest(x: Array) -> float:
    return float(np.abs(x).max())


def _sigma_min(jacobian: Array) -> float:
    return float(np.linalg.svd(jacobian, compute_uv=False)[-1])


def _first_line(error: Exception) -> str:
    return str(error).strip().splitlines()[0]
