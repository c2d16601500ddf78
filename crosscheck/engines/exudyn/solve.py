"""Positions by exudyn's own static solver, time by time, and the rates that follow from its rows."""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence
from contextlib import suppress
from dataclasses import replace
from typing import Any

import numpy as np

from crosscheck.engines import Array, EngineError, Term
from crosscheck.engines.estimates import as_driven
from crosscheck.engines.exudyn.model import CURRENT, FAR, MORE, ExudynModel, ExudynSystem, largest_of, quiet_settings
from crosscheck.engines.exudyn.parts import is_slider
from crosscheck.engines.march import MarchResult, march, march_of
from crosscheck.engines.poses import EPS, TRUST, Poses, close, largest, solve, with_velocities
from crosscheck.scenes.names import order_of
from refkin.joints import Unit, elements_of
from refkin.model import Point, Scene
from refkin.motion import Status

TOLERANCES = (1e-14, 1e-13, 1e-12)
"""Norms of the residual, in sizes of the mechanism, at which exudyn's Newton may stop: the first that it reaches."""
STALLED = 1e-9
"""A residual below this after a failed Newton has stalled at round-off, not gone astray."""
SETTLED = 0.5 * EPS
"""A residual up to this is not corrected once more; with four times as much rates were off by twice as much."""
CORRECTIONS, ROUNDED = 4, 4.0 * EPS
"""How often a pose is corrected at most, and the residual up to which once is enough."""
ASTRAY, NEAR = 0.25, 0.01
"""A pose may differ from its prediction by this part of the way from the last pose, or by this much [sizes, rad]."""
BACK, STEEPEST = 5, 1e4
"""So many poses are extrapolated from, fewer where the polynomial through them has more than this of one of them."""
REASONS = {
    Status.SINGULAR: "its Jacobian is singular",
    Status.BRANCH_LOST: "no step is small enough to tell which of two assemblies continues the motion",
}
"""Why there is no answer where exudyn's solver did come to a pose."""


class StaticNewton:
    """A pose at time t from a start by exudyn's static Newton, to the tightest of `TOLERANCES` that round-off allows.

    exudyn stands at it then. A solver that `predicts` is started at a prediction and kept from jumping, another one at
    the last pose. `size` is the mechanism's in the model's unit; `accepted`, for coordinates of order 1, the largest
    component of the scaled residual with which an answer is believed; `rows` (m,) are as its Newton left them.
    """

    predicts = True
    size = 1.0
    accepted = 10.0 * TOLERANCES[-1]
    rows: Array

    def __init__(self, model: ExudynModel) -> None:
        self.model = model

    def __call__(self, t: float, start: Array) -> Array:
        q = self._found(t, start)
        return self._unwound(t, q, start) if largest_of(q - start) > math.pi else q

    def _unwound(self, t: float, q: Array, start: Array) -> Array:
        """Return a pose without the turns that Newton added to angles from a far start, where no row counts them.

        An angle of hundreds of turns has no digits left for the place in the last one.
        """
        back = q.copy()
        back[2::3] -= math.tau * np.round((q - start)[2::3] / math.tau)
        extent = max(1.0, largest_of(back))
        if extent < largest_of(q) and largest_of(self.model.residual(back, t)) < STALLED * extent:
            return self._found(t, back)
        self.model.set_state(q, t)
        return q

    def _found(self, t: float, start: Array) -> Array:
        model = self.model
        model.set_state(start, t)
        extent = max(1.0, largest_of(start))
        for tolerance in TOLERANCES:
            done, self.rows = model.newton(tolerance * extent), model.left()
            left = largest_of(self.rows)
            if done:
                if extent > FAR:  # rows of angles have further to go than those of lengths
                    model.newton(0.0, MORE)
                    self.rows, left = model.left(), 0.0
                q: Array = model.data.GetODE2Coordinates(CURRENT)
                return q if left <= SETTLED else self._corrected(q, left, tolerance * extent)
            if not left < STALLED * extent:
                break
        raise EngineError("its Newton did not converge")

    def once(self, t: float, start: Array, tolerance: float) -> Array:
        """Return the pose by one call of exudyn's Newton, stopped at this norm of the residual."""
        self.model.set_state(start, t)
        if not self.model.newton(tolerance):
            raise EngineError(f"its Newton did not reach {tolerance:g}")
        q: Array = self.model.data.GetODE2Coordinates(CURRENT)
        return q

    def _corrected(self, q: Array, left: float, tolerance: float) -> Array:
        """Return the pose without what the tolerance left: exudyn accepts no first residual without a correction.

        One is not enough at a fold, where each leaves a quarter of the residual, and half of the error.
        """
        with suppress(EngineError):
            for _ in range(CORRECTIONS):
                if not self.model.newton(tolerance):
                    break
                q, self.rows, before = self.model.data.GetODE2Coordinates(CURRENT), self.model.left(), left
                left = largest_of(self.rows)
                if left <= ROUNDED or left > 0.5 * before:
                    return q
        self.model.data.SetODE2Coordinates(q, CURRENT)
        return q


class ShippedSolve:
    """A pose at time t from a start by mbs.SolveStatic with exudyn's own settings; exudyn stands at it then."""

    predicts = False
    # Its relative tolerance 1e-8 refers to the residual of the start, at most a few sizes away.
    accepted = 1e-6

    def __init__(self, model: ExudynModel, size: float) -> None:
        self.model, self.size = model, size
        self.settings = quiet_settings()

    def __call__(self, t: float, start: Array) -> Array:
        model = self.model
        model.set_time(t)
        model.solve_static(start, self.settings)
        q: Array = model.data.GetODE2Coordinates(CURRENT)
        return q

    @property
    def rows(self) -> Array:
        """The rows of exudyn at the pose, as SolveStatic left them."""
        rows: Array = self.model.mbs.sys["staticSolver"].GetSystemResidual()[self.model.n :]
        return rows


class OwnSolver:
    """Equations of which poses are found by exudyn's own solver: `poses.Equations` without rows, and without rates.

    A solver that `predicts` is started at the estimates that it is given, another one at the last pose that it reached.
    `shape` is that of exudyn's Jacobian, `failed` says why there is no pose at a time. Poses may be found all at once,
    `together`, and may differ from their predictions by `furthest` [sizes, rad]: further off is another assembly.
    """

    predicts = together = True
    furthest = TRUST

    def __init__(self, model: ExudynSystem, *shape: int) -> None:
        self.system, self.shape = model, shape
        self.begin()

    def begin(self) -> None:
        """Forget the motion before: nothing of it is left in what comes now."""
        self.system.rest()
        self.failed = dict[float, str]()
        self._last: Array | None = None

    def solved(self, start: Array, t: float) -> tuple[Array, float, Array]:
        """Return exudyn's pose, its largest residual and Jacobian; EngineError says why there is none."""
        raise NotImplementedError

    def apart(self, q: Array, other: Array) -> float:
        """Return the largest component [sizes, rad] by which a pose differs from another."""
        return largest_of((q - other).ravel())

    def closed(self, q: Array, t: Array, last: Array | None) -> tuple[Array, Array, Array]:
        """Return poses, Jacobians and residuals (B,) by exudyn's solver, NaN where it reached none or none is believed.

        Predictions from `last` are not to be left by more than a part of the way from there: as `poses.close`.
        """
        return self._joined([self._reached(start, at, last) for start, at in zip(q, t.tolist(), strict=True)])

    def _reached(self, start: Array, t: float, last: Array | None = None) -> tuple[Array, float, Array] | None:
        if self._last is not None and not self.predicts:
            start = self._last
        try:
            solved = self.solved(start, t)
        except EngineError as error:
            self.failed[t] = str(error)
            return None
        self._last = pose = solved[0]
        self.failed.pop(t, None)
        if last is None:
            return solved
        near = min(max(ASTRAY * self.apart(pose, last), NEAR), self.furthest)
        return solved if self.apart(pose, start) <= near else None

    def _joined(self, solved: Sequence[tuple[Array, float, Array] | None]) -> tuple[Array, Array, Array]:
        nothing = np.full(self.shape[1], np.nan), math.nan, np.full(self.shape, np.nan)
        poses, residuals, jacobians = map(np.array, zip(*(one or nothing for one in solved), strict=True))
        return poses, jacobians, residuals

    def along(self: Any, last: Poses, t: Array) -> Poses:
        """Return the poses after one at times (B,), up to the first that exudyn does not reach.

        Each is started where the polynomial through the ones before it leads, the first on the tangent.
        """
        times, q = np.append(last.t, t), np.append(last.q, np.empty((len(t), self.shape[1])), axis=0)
        weights, solved = extrapolation(times), list[tuple[Array, float, Array]]()
        for k, at in enumerate(t.tolist(), 1):
            start = weights[k, -k:] @ q[max(k - BACK, 0) : k] if k > 1 else q[0] + (at - times[0]) * last.qd[0]
            one = self._reached(start, at)
            if one is None:
                break
            q[k] = one[0]
            solved.append(one)
        return with_velocities(self, t[: len(solved)], *self._joined(solved)) if solved else last[:0]

    def motion(self: Any, start: Array, times: Sequence[float], order: int) -> MarchResult:
        """Return the motion from an estimate of the first pose."""
        if self.predicts:
            return march(self, start, times, order, together=self.together, resumes=True)
        t = np.array(times)
        return march_of(self, t, [close(self, np.tile(start, (len(t), 1)), t)], order)

    def status(self, poses: MarchResult, times: Sequence[float]) -> tuple[tuple[Status, ...], str]:
        """Return the status of each time, and in words what is not ok.

        Where exudyn's solver came to a pose, but to none that continues the motion, the branch is lost.
        """
        lost = {Status.NOT_CONVERGED: Status.BRANCH_LOST}
        status = [s if t in self.failed else lost.get(s, s) for s, t in zip(poses.status, times, strict=True)]
        failures = [k for k, each in enumerate(status) if each is not Status.OK]
        if not failures:
            return tuple(status), ""
        first = times[failures[0]]
        reason = REASONS.get(status[failures[0]]) or self.failed[first]
        message = f"exudyn: {len(failures)} of {len(status)} times not ok, first t = {first!r}: {reason}"
        return tuple(status), message


class ExudynEquations(OwnSolver):
    """exudyn's rows of a scene of the plane, lengths in sizes, and poses by a solver of its own."""

    def __init__(self, model: ExudynModel, scene: Scene, solver: StaticNewton | ShippedSolve) -> None:
        super().__init__(model, model.m, model.n)
        self.model, self.solver, self.predicts = model, solver, solver.predicts
        self.row_scale = solver.size**model.powers
        self.column_scale = np.tile([solver.size, solver.size, 1.0], model.n // 3)
        self._scale = self.column_scale / self.row_scale[:, None]
        whole = model.live == list(range(model.m))  # nothing to be picked: most mechanisms have no empty row
        self._live: Any = slice(None) if whole else model.live
        self.laws = [law for constraint in scene.mechanism.constraints for law in constraint.laws]
        self._weights = np.zeros(model.m)
        self._weights[model.live] = 1.0 / self.row_scale
        columns = {body.name: 3 * k + 2 for k, body in enumerate(scene.mechanism.bodies)}
        joints = [tuple(elements_of([joint])) for joint in scene.mechanism.joints]
        held: list[Any] = [elements[1] for elements in joints if is_slider(elements)]
        self.slides = [(angle, *map(columns.get, angle.bodies)) for angle in held]
        model.clock.tabulate(scene.times, max(order_of(scene), 1))

    def nu(self, q: Array, t: Array) -> Array:
        """Return the right sides of the velocities (B, m): what exudyn's rows of velocity leave while bodies rest."""
        return self.model.at_rest(q[0] * self.column_scale, t)[:, self._live] / -self.row_scale

    def gamma(self, q: Array, qd: Array, t: Array) -> Array:
        drift = self.model.drifts(q * self.column_scale, qd * self.column_scale, t)
        return drift[:, self._live] / self.row_scale

    def solved(self, start: Array, t: float) -> tuple[Array, float, Array]:
        """Return exudyn's pose, its largest residual and Jacobian; EngineError says why there is none.

        Start, pose and Jacobian are in the model's unit, the residual in sizes.
        """
        q, rows = self.solver(t, start), self.solver.rows
        jacobian = self.model.slopes(rows)
        gap, accepted = largest_of(self.model.squared(rows) * self._weights), self.solver.accepted
        if gap > accepted and not gap <= accepted * largest_of(q / self.column_scale):
            raise EngineError(f"it reported success with a residual of {gap:.1e}")
        for held, i, j in self.slides:
            off = (0.0 if j is None else q[j]) - (0.0 if i is None else q[i]) - held.angle
            if abs(off) > 1.0:
                raise EngineError(f"it holds only the sine of {held.name!r}, and settled {off:.2f} rad off its angle")
        return q, gap, jacobian

    def closed(self, q: Array, t: Array, last: Array | None) -> tuple[Array, Array, Array]:
        """Return poses, Jacobians and residuals as `OwnSolver`, in sizes and of rows that are not empty."""
        return super().closed(q * self.column_scale, t, None if last is None else last * self.column_scale)

    def _joined(self, solved: Sequence[tuple[Array, float, Array] | None]) -> tuple[Array, Array, Array]:
        poses, jacobians, residuals = super()._joined(solved)
        return poses / self.column_scale, jacobians[:, self._live] * self._scale, residuals

    def march(self, start: Array, times: Sequence[float], order: int) -> MarchResult:
        """Return the motion in the model's unit, from an estimate of the first pose in it."""
        poses = self.motion(start / self.column_scale, times, order)
        return replace(poses, levels=tuple(level * self.column_scale[:, None] for level in poses.levels))


def refuse_without_estimates(scene: Scene) -> None:
    """Raise EngineError if a body has no estimate: exudyn needs a start."""
    lost = [body.name for body in scene.mechanism.bodies if body.estimate is None]
    if lost:
        raise EngineError(f"exudyn needs a start: no estimate for {', '.join(lost)}")


def start_of(scene: Scene, unit: Unit) -> Array:
    """Return the estimates of all bodies (3 b,) in a unit, as drivers begin; EngineError if there is none of one."""
    refuse_without_estimates(scene)
    start = np.array([body.estimate for body in as_driven(scene).bodies], float)
    start[:, :2] = (start[:, :2] - unit.origin) / unit.size
    return start.ravel()


def stopping_rule(residual: Array, values: Array, lengths: Sequence[Array], factor: float, unit: str) -> Term:
    """Return what SolveStatic leaves of the residual, all rows together, in the scaled one: the row |d| - f times f.

    It stops at the larger of an absolute norm and a part of that which it started with: at the estimate,
    later at the last pose, where only rows of drivers are not zero.

    Parameters
    ----------
    residual, values, lengths : array, (laws, T) array, sequence of (T,) array
        At the estimate; of the drivers' laws; the distances of drivers, in sizes.
    factor, unit : float, str
        By which exudyn's residual, in this unit, becomes the scaled one.
    """
    newton = quiet_settings().staticSolver.newton
    norms = [np.linalg.norm(residual), *(np.linalg.norm(np.diff(values), axis=0) if len(values) else ())]
    left = float(max(newton.absoluteTolerance, newton.relativeTolerance * max(norms)))
    return Term(
        name="stopping rule",
        level="position",
        reason=f"SolveStatic stops at a residual of {left:.1e} {unit} by its default tolerances",
        absolute=left * factor * max([1.0, *(float(np.max(np.abs(length))) for length in lengths)]),
    )


def in_metres(unit: Unit, levels: Sequence[Array]) -> list[Array]:
    """Return coordinates and rates (n, T) of bodies in metres."""
    bodies = len(levels[0]) // 3
    scale, shift = np.tile([unit.size, unit.size, 1.0], bodies), np.tile([*unit.origin, 0.0], bodies)
    return [level * scale[:, None] + (shift[:, None] if k == 0 else 0.0) for k, level in enumerate(levels)]


def placed(points: Sequence[Point], bodies: Sequence[str], levels: Sequence[Array]) -> Iterator[list[Array]]:
    """Yield per level the motion of points, (2, T) each [m], with the bodies that exudyn has moved.

    Parameters
    ----------
    points, bodies : sequence of Point, sequence of str
    levels : sequence of (3 b, T) array
        Coordinates of the bodies [m, rad], and as many rates as there are.
    """
    for point in points:
        k = 3 * bodies.index(point.body)
        (x, y), at = point.position, [level[k : k + 3] for level in levels]
        cosine, sine = np.cos(at[0][2]), np.sin(at[0][2])
        arm = np.array([cosine * x - sine * y, sine * x + cosine * y])
        across = np.array([-arm[1], arm[0]])
        moved = [at[0][:2] + arm, *(rate[:2] + across * rate[2] for rate in at[1:])]
        if len(moved) > 2:
            moved[2] -= arm * at[1][2] ** 2
        yield moved


def extrapolation(t: Array) -> Array:
    """Return what the polynomial through the last `BACK` of times (T,) before each has of the samples there, (T, BACK).

    It goes through as many as there are, the others have zeros; through fewer where times nearly coincide.
    """
    weights, times = np.zeros((len(t), BACK)), t.tolist()
    for k in range(1, min(len(t), BACK)):
        weights[k, -k:] = _polynomial(times[k], times[:k])
    if len(t) > BACK:
        weights[BACK:] = np.transpose(_polynomial(t[BACK:], [t[k : k - BACK] for k in range(BACK)]))
    for k in np.flatnonzero(np.abs(weights).max(axis=1) > STEEPEST).tolist():
        count = min(k, BACK)
        while np.abs(weights[k]).max() > STEEPEST:
            count -= 1
            weights[k] = [*[0.0] * (BACK - count), *_polynomial(times[k], times[k - count : k])]
    return weights


def _polynomial(t: Any, before: Sequence[Any]) -> list[Any]:
    """Return how much the polynomial through samples before has of each at a time, or at times (T,)."""
    return [math.prod((t - b) / (a - b) for b in before if b is not a) for a in before]


def rates_at(model: ExudynModel, q: Array, times: Array, order: int) -> list[Array]:
    """Return the rates (B, n) of poses up to an order, NaN where singular.

    exudyn has no such analysis: the rows are its own, the linear systems are solved here.

    Parameters
    ----------
    model, q, times : ExudynModel, (B, n) array, (B,) array
        Whose poses, at which times [s].
    order : int
        0 for none, 1 for velocities, 2 for accelerations too.
    """
    if not order or not len(q):
        return [q] * order
    jacobians = np.array([model.jacobian(*each) for each in zip(q, times.tolist(), strict=True)])[:, model.live]
    rates = [solved(jacobians, -model.at_rest(q[0], times)[:, model.live])]
    if order > 1:
        rates.append(solved(jacobians, model.drifts(q, rates[0], times)[:, model.live]))
    return rates


def solved(jacobian: Array, right: Array) -> Array:
    """Return x (B, n) of jacobian (B, m, n) x = right (B, m), of redundant rows by least squares; NaN where singular.

    Singular also means: x outgrows the right side by so much that the rounding of the matrix alone makes up for it.
    """
    _, m, n = jacobian.shape
    x = solve(jacobian, right)
    if m == n:
        sound = n * EPS * np.abs(jacobian).max(axis=(1, 2)) * largest(x) <= largest(right)
    else:
        sigma = np.linalg.svd(jacobian, compute_uv=False)
        sound = sigma[:, -1] > EPS * max(m, n) * sigma[:, 0]
    x[~sound] = np.nan
    return x
