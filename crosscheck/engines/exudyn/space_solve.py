"""Positions of spatial mechanisms by exudyn's own static solver, time by time, and rates from its rows.

`static` starts where exudyn's own velocity points, halves the step where its Newton ends elsewhere, and takes no pose
in which axes that should have one direction have opposite ones, or a driven angle is off by pi: exudyn's rows are zero
there too. `shipped` has default tolerances and steps: each solve starts at the last answer, and is believed. Its linear
solver is not the default one, which stops where a spin is passive or rows are redundant; lengths are in sizes.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from typing import Any

import numpy as np

from crosscheck.engines import EngineError, EngineRefusal, KeptModel, Term
from crosscheck.engines.exudyn.model import FAR, MORE, bear_redundant_rows, quiet_settings
from crosscheck.engines.exudyn.solve import STALLED, TOLERANCES, OwnSolver, refuse_without_estimates, stopping_rule
from crosscheck.engines.exudyn.space import FORM, NO_TWIST, ExudynSpace
from crosscheck.engines.poses import EPS
from crosscheck.engines.spatial.kinds import JointKind
from crosscheck.engines.spatial.motion import estimates, reported
from crosscheck.engines.spatial.reading import AXIAL, ROWS, UNTURNED, numbers_of
from crosscheck.engines.spatial.turning import common_columns, matrix
from crosscheck.scenes.names import order_of
from refkin.joints import GROUND
from refkin.model import Scene
from refkin.motion import Motion, Producer

Array = Any
ACCEPTED, SHIPPED_ACCEPTED = 1e-11, 1e-6
"""Largest component of its rows with which an answer is believed, for coordinates of order 1."""
CORRECTIONS, SETTLED = 4, 4.0 * EPS
"""How often a pose may be corrected once more, and the largest component of its rows at which it no longer is."""


class SpaceModel(KeptModel):
    """exudyn's model of a scene of space; EngineError for a twist, or no estimate."""

    def __init__(
        self, scene: Scene, producer: Producer, tolerances: Sequence[float] = TOLERANCES, *, shipped: bool = False
    ) -> None:
        self.numbers, self.producer = numbers_of(scene.mechanism), producer
        refuse_without_estimates(scene)
        twists = [x.name for x in self.numbers.drives if x.kind == JointKind.ANGLE and x.hold.kind not in AXIAL]
        twists += [x.name for x in self.numbers.holds if x.kind == JointKind.TWIST]
        if twists:
            raise EngineRefusal(f"exudyn refuses {twists[0]!r}: {NO_TWIST}")
        self.start = np.concatenate([*estimates(scene, self.numbers).values()])
        self.model = ExudynSpace(self.numbers, self.numbers.holds, self.numbers.drives)
        self.equations = SpaceEquations(self.model, tolerances, shipped=shipped)

    def close(self) -> None:
        """Free what exudyn holds."""
        self.model.close()

    def solve(self, scene: Scene) -> Motion:
        """Return the motion from the estimates."""
        self.equations.begin()
        poses = self.equations.motion(self.start, scene.times, order_of(scene))
        status, message = self.equations.status(poses, scene.times)
        more = {"residual": poses.residual, "message": message}
        return reported(scene, self.numbers, list(poses.levels), status, self.producer, **more)

    def stop(self, scene: Scene) -> Term:
        """Return what SolveStatic leaves of the residual, as in the plane."""
        drives, t = self.numbers.drives, np.array(scene.times)
        values = np.array([drive.value(t) for drive in drives])
        self.model.set_state(self.start, scene.times[0])
        residual = self.model.equations()[self.model.live]
        lengths = [x for x, drive in zip(values, drives, strict=True) if drive.kind == JointKind.DISTANCE]
        return replace(stopping_rule(residual, values, lengths, 2.0, "sizes or half rad"), form=FORM)


class SpaceEquations(OwnSolver):
    """exudyn's rows of a mechanism of space in coordinates (r, p) of each body, and poses by its own solver.

    A row for each passive spin holds it still, u . w = 0 (its pose is wherever exudyn leaves it), and one for each body
    keeps its Euler parameters at length 1. exudyn has rows at that length alone.
    """

    def __init__(self, model: ExudynSpace, tolerances: Sequence[float], *, shipped: bool) -> None:
        numbers = model.numbers
        self.accepted = SHIPPED_ACCEPTED if shipped else max(ACCEPTED, 10.0 * tolerances[-1])
        super().__init__(model, len(model.lines), model.n)
        self.model, self.numbers, self.tolerances, self.predicts = model, numbers, tolerances, not shipped
        self.together, self.laws = not numbers.passive, [drive.law for drive in numbers.drives]
        passive = [7 * numbers.bodies.index(body) + k for spin in numbers.passive for body in spin for k in range(3, 7)]
        self.moving = np.delete(np.arange(model.n), passive)
        self.default = quiet_settings()
        bear_redundant_rows(self.default)

    def _joined(self, solved: Sequence[tuple[Array, float, Array] | None]) -> tuple[Array, Array, Array]:
        poses, slopes, residuals = super()._joined(solved)
        return poses, self._whole(poses, slopes), residuals

    def _whole(self, q: Array, slopes: Array) -> Array:
        """Return the Jacobians (B, rows, n) of all rows, from exudyn's own (B, m, n)."""
        columns, bodies = common_columns(q), len(self.numbers.bodies)
        of_rates = columns.swapaxes(1, 2) * np.tile([1.0, 1.0, 1.0, 4.0, 4.0, 4.0], bodies)[:, None]  # w = 2 E p'
        units = np.zeros((len(q), bodies, self.model.n))
        for k in range(bodies):
            p = slice(7 * k + 3, 7 * k + 7)
            units[:, k, p] = q[:, p]
        common = np.concatenate([slopes @ columns, self._spins(q)], axis=1)
        return np.concatenate([common @ of_rates, units], axis=1)

    def nu(self, q: Array, t: Array) -> Array:
        out = []
        for each in zip(q, t.tolist(), strict=True):
            self.model.set_state(*each)
            out.append(self._with_own(-self.model.law_rates(each[1])))
        return np.array(out)

    def velocities(self, q: Array, t: Array) -> tuple[Array, Array]:
        """Return the Jacobians (B, rows, n) of poses, and the right sides (B, rows) of their velocities."""
        slopes, right = [], []
        for each in zip(q, t.tolist(), strict=True):
            slopes.append(self.model.both(*each)[1])
            right.append(self._with_own(-self.model.law_rates(each[1])))
        return self._whole(q, np.array(slopes)), np.array(right)

    def _with_own(self, right: Array, qd: Any = None) -> Array:
        bodies = len(self.numbers.bodies)
        lengths = np.zeros(bodies) if qd is None else -np.sum(qd.reshape(-1, 7)[:, 3:] ** 2, axis=1)
        return np.concatenate([right, np.zeros(len(self.numbers.passive)), lengths])

    def gamma(self, q: Array, qd: Array, t: Array) -> Array:
        drifts = self.model.drifts(q, qd, t)
        return np.array([self._with_own(drift, rate) for drift, rate in zip(drifts, qd, strict=True)])

    def apart(self, q: Array, other: Array) -> float:
        """Return the largest component [sizes, half rad] by which a pose differs from another, passive spins apart."""
        return super().apart(q[..., self.moving], other[..., self.moving])

    def solved(self, start: Array, t: float) -> tuple[Array, float, Array]:
        q = (self._newton if self.predicts else self._shipped_newton)(t, unit(start))
        if not np.isfinite(q).all():
            raise EngineError("its Newton ended in no number")
        q = unit(q)
        rows, slopes = self.model.both(q, t)
        gap = float(np.abs(rows).max(initial=0.0))
        if not gap <= self.accepted * max(1.0, np.abs(q).max()):
            raise EngineError(f"it reported success with a residual of {gap:.1e}")
        if self.predicts:
            self._check_directions(q, t)
        return q, gap, slopes

    def _newton(self, t: float, start: Array) -> Array:
        extent = max(1.0, np.abs(start).max())
        for tolerance in self.tolerances:
            self.model.set_state(start, t)
            if self.model.newton(tolerance * extent):
                if extent > FAR:  # rows of angles have further to go than those of lengths
                    self.model.newton(0.0, MORE)
                    return self.model.coordinates()
                return self._corrected(t, self.model.coordinates(), tolerance * extent)
            if not np.abs(self.model.left()).max() < STALLED * extent:  # gone astray: so it would for the next one
                break
        raise EngineError("its Newton did not converge")

    def _corrected(self, t: float, q: Array, tolerance: float) -> Array:
        """Return the pose without what the tolerance left: exudyn accepts no first residual without a correction.

        One is not always enough: of redundant rows its pivots choose some, and the others may keep their residual.
        """
        best, least, last = q, np.inf, q
        for _ in range(CORRECTIONS):
            self.model.set_state(last, t)
            if not self.model.newton(tolerance):
                break
            last = self.model.coordinates()
            left = float(np.abs(self.model.residual(last, t)).max(initial=0.0))
            if left < least:
                best, least = last, left
            if left <= SETTLED * max(1.0, np.abs(q).max()):
                break
        return best

    def _shipped_newton(self, t: float, start: Array) -> Array:
        self.model.set_time(t)
        self.model.solve_static(start - self.model.still, self.default)
        return self.model.coordinates()

    def _check_directions(self, q: Array, t: float) -> None:
        """Raise EngineError where axes are antiparallel, or a crank is off by pi: closed equations, and no assembly."""
        at = {GROUND: np.eye(3)} | {
            body: matrix(pose[3:]) for body, pose in zip(self.numbers.bodies, q.reshape(-1, 7), strict=True)
        }
        for hold in self.numbers.holds:
            x, y = at[hold.body_i] @ hold.frame_i, at[hold.body_j] @ hold.frame_j
            if hold.kind in AXIAL and x[:, 2] @ y[:, 2] < 0.0:
                raise EngineError(f"it reported success with the axes of {hold.name!r} antiparallel")
            if UNTURNED in ROWS.get(hold.kind, ()) and x[:, 0] @ y[:, 0] < 0.0:
                raise EngineError(f"it reported success with {hold.name!r} turned by pi")
        for drive in self.numbers.drives:
            if drive.kind == JointKind.ANGLE:
                x, y = at[drive.hold.body_i] @ drive.hold.frame_i, at[drive.hold.body_j] @ drive.hold.frame_j
                f = drive.value(t)
                if (np.cos(f) * x[:, 0] + np.sin(f) * x[:, 1]) @ y[:, 0] < 0.0:
                    raise EngineError(f"it reported success with {drive.name!r} off by pi")

    def _spins(self, q: Array) -> Array:
        """Return the rows (B, spins, 6 b) that hold passive spins still, in columns (v, w)."""
        rows = np.zeros((len(q), len(self.numbers.passive), 6 * len(self.numbers.bodies)))
        for n, spin in enumerate(self.numbers.passive):
            body, (_, line) = next(iter(spin.items()))
            k = self.numbers.bodies.index(body)
            rows[:, n, 6 * k + 3 : 6 * k + 6] = matrix(q[:, 7 * k + 3 : 7 * k + 7]) @ line
        return rows


def unit(q: Array) -> Array:
    """Return coordinates (r, p) of each body with p of length 1."""
    bodies = np.array(q).reshape(-1, 7)
    bodies[:, 3:] /= np.linalg.norm(bodies[:, 3:], axis=1, keepdims=True)
    return bodies.ravel()
