"""MuJoCo's fastest route: many poses, or many mechanisms, at once by `mujoco.batch`, on one thread.

The model is a tree of three hinges with a site at either end of the open loop. Positions of sites, their Jacobians and
accelerations are MuJoCo's own; Newton on the two free angles is done here, on rows. Many mechanisms go from time to
time together. One mechanism is taken to a few poses one after another, and to all others from the cubics between them.
"""

from __future__ import annotations

import os
from collections.abc import Iterator
from typing import Any

import numpy as np

from crosscheck.engines.batch_route import Route, of_four_bars, whole
from crosscheck.judge.of_batches import Piece
from crosscheck.scenes.works import SPEED, FourBars

os.environ.setdefault("MUJOCO_GL", "disable")  # before the import: nothing is drawn, and there may be no display
import mujoco
from mujoco import batch as mujoco_batch

MECHANISMS = 200
"""So many of many mechanisms are done."""
COARSE = 40
"""So many poses of one mechanism are found one after another."""
ENOUGH, MOST_NEWTON = 1e-8, 12
ANGLES = (2, 5, 8)
OFF = "CONTACT GRAVITY SPRING DAMPER ACTUATION LIMIT FRICTIONLOSS WARMSTART ISLAND AUTORESET EQUALITY CONSTRAINT"
WHAT = "its sites, Jacobians and accelerations, Newton on rows; angles alone are read"


def four_bars(work: FourBars) -> Route:
    """Return position, velocity and acceleration of the three angles."""
    part = work.first(MECHANISMS)
    solver: _Sweep | _Many = _Sweep(part) if part.mechanisms == 1 else _Many(part)

    def pieces() -> Iterator[Piece]:
        yield whole(part, np.arange(part.mechanisms), solver.run(), ANGLES)

    by = "NumPy over mujoco.batch: " + ("all times at once" if part.mechanisms == 1 else "time after time")
    return of_four_bars("mujoco", part, solver.run, pieces, driven_by=by, what=WHAT)


class _Batch:
    """So many four-bars at once; their lengths may differ."""

    def __init__(self, lengths: Any, count: int) -> None:
        self.count = count
        model = _model(lengths[:, 0].tolist())
        self.batch = mujoco_batch.Batch(model, nsim=count, nthread=1)
        if lengths.shape[1] > 1:
            ground, crank, coupler, rocker = lengths
            places, sites = self.batch.expand("body_pos"), self.batch.expand("site_pos")
            places[:, 2, 0], places[:, 3, 0] = crank, ground
            sites[:, 0, 0], sites[:, 1, 0] = coupler, rocker
        self.q, self.v = self.batch.bind("qpos"), self.batch.bind("qvel")
        self.sites, self.qacc = self.batch.bind("site_xpos"), self.batch.bind("qacc")
        self.sensed = self.batch.bind("sensordata")

    def solved(self, guess: Any) -> tuple[Any, Any, Any]:
        """Return coordinates, velocities and accelerations (count, 3) from guesses; NaN where Newton does not end."""
        self.q[:] = guess
        for _ in range(MOST_NEWTON):
            gap, jacobian = self._closure()
            step = _corrections(jacobian, gap)
            self.q[:, 1:] -= step
            if np.max(np.abs(step)) <= ENOUGH:
                break
        else:
            self.q[np.max(np.abs(step), axis=1) > ENOUGH] = np.nan
        _, jacobian = self._closure()
        self.v[:, 0] = SPEED
        self.v[:, 1:] = _corrections(jacobian, -SPEED * jacobian[:, :, 0])
        self.batch.forward()
        accelerations = self.sensed[:, 0:2] - self.sensed[:, 3:5]
        drift = accelerations - (jacobian @ self.qacc[:, :, None])[:, :, 0]
        a = np.zeros((self.count, 3))
        a[:, 1:] = _corrections(jacobian, -drift)
        return self.q.copy(), self.v.copy(), a

    def _closure(self) -> tuple[Any, Any]:
        """Return the gaps of the loops (count, 2) and their Jacobians (count, 2, 3)."""
        self.batch.forward(stage=mujoco.mjtStage.mjSTAGE_POS.value)
        one, other = self.sites[:, 0], self.sites[:, 1]
        jacobian = self.batch.jac(2, one)[0][:, :2] - self.batch.jac(3, other)[0][:, :2]
        return one[:, :2] - other[:, :2], jacobian


class _Many:
    """Many mechanisms, time after time."""

    def __init__(self, work: FourBars) -> None:
        self.t, self.batch = work.t.tolist(), _Batch(work.lengths, work.mechanisms)
        self.start = _relative(work.starts[2::3].T)

    def run(self) -> Any:
        """Return the levels (3, 3, M, T) of the bodies' angles."""
        out = np.empty((len(self.t), 3, self.batch.count, 3))
        for k, t in enumerate(self.t):
            if k == 0:
                guess = self.start.copy()
            else:
                h, (q, v, a) = t - self.t[k - 1], out[k - 1]
                guess = q + h * (v + 0.5 * h * a)
            guess[:, 0] = SPEED * t
            out[k] = self.batch.solved(guess)
        return _absolute(np.moveaxis(out, (0, 1, 2, 3), (3, 0, 2, 1)))


class _Sweep:
    """One mechanism at all times: a few poses one after another, then all at once."""

    def __init__(self, work: FourBars) -> None:
        self.t, self.batch = work.t, _Batch(work.lengths, len(work.t))
        self.start = _relative(work.starts[2::3, 0])
        self.model = _model(work.lengths[:, 0].tolist())
        self.data = mujoco.MjData(self.model)
        self.jacobians = np.zeros((2, 3, 3))
        self.coarse = np.linspace(work.t[0], work.t[-1], COARSE + 1)

    def run(self) -> Any:
        """Return the levels (3, 3, 1, T) of the bodies' angles."""
        q, v = self._coarse()
        h = self.coarse[1] - self.coarse[0]
        k = np.minimum((self.t - self.coarse[0]) // h, COARSE - 1).astype(int)
        s = ((self.t - self.coarse[k]) / h)[:, None]
        left, right = q[k], q[k + 1]
        rise = right - left
        one, other = h * v[k] - rise, rise - h * v[k + 1]
        guess = left + s * (rise + (1.0 - s) * (one * (1.0 - s) + other * s))
        guess[:, 0] = SPEED * self.t
        return _absolute(np.moveaxis(np.array(self.batch.solved(guess)), 2, 1)[:, :, None])

    def _coarse(self) -> tuple[Any, Any]:
        """Return the poses and rates (COARSE + 1, 3) from which all others are guessed."""
        q, v = np.empty((2, COARSE + 1, 3))
        at, rate, h = self.start.tolist(), [SPEED, 0.0, 0.0], self.coarse[1] - self.coarse[0]
        for k, t in enumerate(self.coarse.tolist()):
            if k:
                at = [x + h * w for x, w in zip(at, rate, strict=True)]
            at[0] = SPEED * t
            for _ in range(MOST_NEWTON):
                (x, y), (row, other) = self._closure(at)
                dx, dy = _solved(row, other, x, y)
                at[1] -= dx
                at[2] -= dy
                if abs(dx) <= ENOUGH and abs(dy) <= ENOUGH:
                    break
            rate[1:] = _solved(row, other, -SPEED * row[0], -SPEED * other[0])
            q[k], v[k] = at, rate
        return q, v

    def _closure(self, q: list[float]) -> tuple[list[float], list[list[float]]]:
        model, data, (one, other) = self.model, self.data, self.jacobians
        data.qpos[:] = q
        mujoco.mj_kinematics(model, data)
        mujoco.mj_comPos(model, data)
        mujoco.mj_jacSite(model, data, one, None, 0)
        mujoco.mj_jacSite(model, data, other, None, 1)
        gap = data.site_xpos[0, :2] - data.site_xpos[1, :2]
        return gap.tolist(), (one[:2] - other[:2]).tolist()


def _model(lengths: list[float]) -> Any:
    """Return the tree: crank, coupler on it, rocker; sites 0 and 1 where coupler and rocker are to meet."""
    ground, crank, coupler, rocker = lengths
    spec = mujoco.MjSpec()
    spec.compiler.degree = False
    spec.option.disableflags = sum(getattr(mujoco.mjtDisableBit, f"mjDSBL_{name}") for name in OFF.split())
    first = _link(spec.worldbody, "crank", 0.0)
    second = _link(first, "coupler", crank)
    third = _link(spec.worldbody, "rocker", ground)
    for body, name, length in ((second, "one", coupler), (third, "other", rocker)):
        body.add_site(name=name, pos=[length, 0.0, 0.0])
        spec.add_sensor(
            name=name,
            type=mujoco.mjtSensor.mjSENS_FRAMELINACC,
            objtype=mujoco.mjtObj.mjOBJ_SITE,
            objname=name,
        )
    model = spec.compile()
    model.site_sameframe[:] = 0  # a site near its body's origin would be taken to be there
    return model


def _link(parent: Any, name: str, x: float) -> Any:
    body = parent.add_body(
        name=name, pos=[x, 0.0, 0.0], explicitinertial=True, mass=1.0, inertia=[1.0] * 3, ipos=[0.0] * 3
    )
    body.add_joint(name=name, type=mujoco.mjtJoint.mjJNT_HINGE, axis=[0.0, 0.0, 1.0])
    return body


def _relative(angles: Any) -> Any:
    """Return the tree's coordinates (..., 3) of the bodies' angles."""
    out = np.array(angles)
    out[..., 1] -= out[..., 0]
    return out


def _absolute(levels: Any) -> Any:
    """Return the bodies' angles (levels, 3, ...) of the tree's coordinates."""
    out = np.array(levels)
    out[:, 1] += out[:, 0]
    return out


def _corrections(jacobian: Any, right: Any) -> Any:
    """Return the solutions (count, 2) of the systems in the last two columns of Jacobians (count, 2, 3)."""
    (a, b), (c, d) = np.moveaxis(jacobian[:, :, 1:], 0, 2)
    x, y = right.T
    determinant = a * d - b * c
    return np.stack([(d * x - b * y) / determinant, (a * y - c * x) / determinant], axis=1)


def _solved(row: list[float], other: list[float], x: float, y: float) -> tuple[float, float]:
    (_, a, b), (_, c, d) = row, other
    determinant = a * d - b * c
    return (d * x - b * y) / determinant, (a * y - c * x) / determinant
