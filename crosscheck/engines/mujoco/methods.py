"""MuJoCo's methods, and its fastest: many poses, or many mechanisms, at once by `mujoco.batch`, on one thread.

There the model is the joint tree with a site at either end of each loop that is left open. Positions of sites, their
Jacobians and accelerations are MuJoCo's own; Newton on the free coordinates is done here, on rows. One mechanism is
taken to a few poses one after another, and to all others from the cubics between them. Many go from time to time
together. One pose after the other is found in scalars (`tree.scalars`), on the rows of its equality constraints.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import replace
from functools import partial
from typing import Any

import numpy as np

from crosscheck.engines import EngineError
from crosscheck.engines.march import hermite
from crosscheck.engines.methods import Batch, Method, Model, Use, of_routes, priced
from crosscheck.engines.mujoco.engine import Mujoco
from crosscheck.engines.mujoco.model import Plan, mujoco, switch_on
from crosscheck.engines.mujoco.rows import in_order
from crosscheck.engines.mujoco.space import MujocoSpace
from crosscheck.engines.mujoco.stepping import stepping_methods, tree_of
from crosscheck.engines.tree.newton import Loops, newton_methods, solved_rows
from crosscheck.engines.tree.scalars import LIMITS, MOST_NEWTON, Row, ScalarNewton, scalar_methods
from crosscheck.scenes.workloads import FourBars, LoopChain, Workload, whole
from refkin.model import Scene

MECHANISMS = 200
"""So many of many mechanisms are done."""
COARSE, EVERY = 40, 4
"""One pose of so many is found before the others, from the one before it; at most so many."""
NEAR = 1e-4
"""A Jacobian this near is taken for the next correction, too: what that leaves is about the product of both."""
UNUSED = ("EQUALITY", "CONSTRAINT")
"""What of MuJoCo the batch has no need of, beside all that is no kinematics."""


def methods() -> Iterator[Method]:
    """Yield the methods of MuJoCo."""
    yield from of_routes(Mujoco(), frozenset({Use.COMPARE, Use.PRICE, Use.EFFECTS, Use.HARD}))
    name, who = "mujoco.batch, all times at once", "the adapter (NumPy on rows)"
    note = "its sites, Jacobians and accelerations; laws are tabulated with the model"
    for limit in LIMITS:
        last = limit == LIMITS[-1]
        more: Any = {"uses": frozenset({Use.PRICE, Use.BENCH}), "batch": partial(_batched, limit)} if last else {}
        yield priced("mujoco", name, f"|dq| < {limit:g}", who, partial(_swept, limit), note, together=True, **more)
    yield from scalar_methods("mujoco", linked, ConnectRows)
    yield from newton_methods("mujoco", tree_of, MujocoSpace)
    yield from stepping_methods()


linked = partial(tree_of, massless_links=True)
"""Scene -> its tree whose loops revolute joints close where distances would."""


class ConnectRows:
    """MuJoCo's loops at one pose, each a `connect` of its model of the tree, in three rows.

    EngineError if it leaves out one that no joint moves.
    """

    def __init__(self, loops: Loops) -> None:
        engine: Any = loops.tree.engine
        self.model, self.data, self.columns = engine.model, engine.data, engine.columns.tolist()
        self._q, self._v = self.data.qpos, self.data.qvel  # views
        self.closure(in_order(loops.tree.start(), engine.columns).tolist())
        if self.data.nefc != 3 * self.model.neq:
            raise EngineError("MuJoCo has no rows of a joint that closes a loop and that nothing moves")

    def closure(self, q: Row) -> tuple[Row, Row]:
        """Return the gaps of the loops (3 L,) and their Jacobian (3 L n,)."""
        model, data = self.model, self.data
        self._q[:] = q
        mujoco.mj_kinematics(model, data)
        mujoco.mj_comPos(model, data)
        mujoco.mj_makeConstraint(model, data)
        return data.efc_pos.tolist(), data.efc_J.tolist()

    def drift(self, q: Row, qd: Row) -> Row:
        """Return the accelerations of the gaps (3 L,) at qdd = 0, where the bodies were last placed."""
        model, data = self.model, self.data
        self._v[:] = qd
        mujoco.mj_comVel(model, data)
        mujoco.mj_referenceConstraint(model, data)
        return [-x for x in data.efc_aref.tolist()]


def _swept(limit: float, scene: Scene) -> Model:
    sweep = OneMechanism(Loops.of(linked(scene)), limit)
    return Model(sweep.solve, sweep.loops.tree.read)


def _batched(limit: float, workload: Workload, order: int) -> Batch:
    if isinstance(workload, LoopChain):
        raise EngineError("not made for chains: mujoco.batch binds no constraint rows, and one pose is no batch")
    if not isinstance(workload, FourBars):
        raise EngineError("made for four-bars: its joint tree is of the plane")
    part = workload.first(MECHANISMS)
    if part.mechanisms == 1:
        model = _swept(limit, part.scene())
        answers = lambda: [whole(part, np.arange(1), [x[:, None] for x in model.read(model.solve(order))])]  # noqa: E731
        return Batch(lambda: model.solve(order), part.configurations, answers)
    many = ManyMechanisms(part, limit)
    return Batch(lambda: many.solve(order), part.configurations, lambda: many.read(many.solve(order)))


class Samples:
    """So many poses of a tree's loops at once; columns are MuJoCo's, in the order of its joints."""

    def __init__(self, loops: Loops, count: int, limit: float) -> None:
        self.count, self.limit = count, limit
        joints = loops.tree.system.tree
        self.model = _model(joints)
        self.columns = np.array([self.model.joint(f"q{k}").id for k in range(joints.width)], int)
        self.held, self.free = self.columns[loops.clock.columns], self.columns[loops.free]
        self.ends = [[self.model.site(f"c{k} {side}").id for side in "ij"] for k in range(len(joints.closures))]
        from mujoco import batch

        self.batch: Any = batch.Batch(self.model, nsim=count, nthread=1)
        self.q, self.v = self.batch.bind("qpos"), self.batch.bind("qvel")
        self.sites, self.qacc = self.batch.bind("site_xpos"), self.batch.bind("qacc")
        self.sensed = self.batch.bind("sensordata")

    def solved(self, guess: Any, rates: Any, order: int) -> list[Any]:
        """Return coordinates and rates (count, n) up to an order from a guess like them; NaN where Newton does not end.

        `rates`, (2, count, d) or (2, 1, d), are rate and acceleration of the prescribed coordinates.
        """
        free, held = self.free, self.held
        self.q[:] = guess
        slope, off = None, np.inf
        for _ in range(MOST_NEWTON):
            gap, anew = self._gaps(), not off <= NEAR
            slope = self._slopes()[..., free] if anew else slope
            step = solved_rows(slope, gap)
            self.q[:, free] -= step
            size = np.max(np.abs(step))
            off = size if anew else off
            if off * size <= self.limit**2:
                break
        else:
            self.q[np.max(np.abs(step), axis=1) > self.limit] = np.nan
        levels = [self.q.copy()]
        if order == 0:
            return levels
        self._gaps()
        jacobian = self._slopes()
        self.v[:, held] = rates[0]
        self.v[:, free] = -solved_rows(jacobian[..., free], _times(jacobian[..., held], rates[0]))
        levels.append(self.v.copy())
        if order == 1:
            return levels
        self.batch.forward()
        ends = self.sensed.reshape(self.count, -1, 2, 3)[..., :2]
        drift = (ends[:, :, 0] - ends[:, :, 1]).reshape(self.count, -1) - _times(jacobian, self.qacc)
        a = np.empty_like(levels[0])
        a[:, held] = rates[1]
        a[:, free] = -solved_rows(jacobian[..., free], drift + _times(jacobian[..., held], rates[1]))
        return [*levels, a]

    def _gaps(self) -> Any:
        """Take the poses to MuJoCo; return the gaps of the loops (count, 2 L)."""
        self.batch.forward(stage=mujoco.mjtStage.mjSTAGE_POS.value)
        return np.concatenate([self.sites[:, i, :2] - self.sites[:, j, :2] for i, j in self.ends], axis=1)

    def _slopes(self) -> Any:
        """Return the Jacobians of the loops (count, 2 L, n) at the poses that MuJoCo was taken to last."""
        rows = [self._jacobian(i) - self._jacobian(j) for i, j in self.ends]
        return rows[0] if len(rows) == 1 else np.concatenate(rows, axis=1)

    def _jacobian(self, site: int) -> Any:
        body = int(self.model.site_bodyid[site])
        return self.batch.jac(body, self.sites[:, site])[0][:, :2] if body else 0.0


def _times(matrix: Any, vector: Any) -> Any:
    """Return products (B, m) of matrices (B, m, n) and vectors (B, n), or of all with one (1, n)."""
    return (matrix @ vector[..., None])[..., 0]


class OneMechanism:
    """One mechanism at all times: a few poses one after another, then all at once."""

    def __init__(self, loops: Loops, limit: float) -> None:
        self.loops, self.t = loops, np.array(loops.tree.scene.times)
        self.samples = Samples(loops, len(self.t), limit)
        self.values = loops.clock.values[:, :, 0]
        self.start = in_order(loops.tree.start(), self.samples.columns)
        count = min(COARSE + 1, max(len(self.t) // EVERY, 2), len(self.t))
        self.coarse = np.linspace(self.t[0], self.t[-1], count)
        few = Loops.of(replace(loops.tree, scene=replace(loops.tree.scene, times=tuple(self.coarse.tolist()))))
        self.few = ScalarNewton(few, ConnectRows(few), LIMITS[-2])

    def solve(self, order: int) -> list[Any]:
        """Return tree coordinates and rates (n, T) up to an order."""
        levels = self.samples.solved(self._guess(), self.values[1:], order)
        return [level[:, self.samples.columns].T for level in levels]

    def _guess(self) -> Any:
        """Return guesses (T, n): the start where there is one time, else cubics between the coarse poses."""
        if len(self.t) == 1:
            guess = self.start[None].copy()
        else:
            q, v = np.array(self.few.solve(1)).transpose(1, 0, 2)
            h = self.coarse[1] - self.coarse[0]
            k = np.minimum((self.t - self.coarse[0]) // h, len(self.coarse) - 2).astype(int)
            guess = hermite((0.0, h), (q[k], q[k + 1]), (v[k], v[k + 1]), (self.t - self.coarse[k])[:, None])
        guess[:, self.samples.held] = self.values[0]
        return guess


class ManyMechanisms:
    """Many mechanisms of one topology, time after time; places of joints and sites differ."""

    def __init__(self, work: FourBars, limit: float) -> None:
        self.work, self.t = work, work.t
        self.trees = [tree_of(work.scene(sample)) for sample in range(work.mechanisms)]
        self.loops = Loops.of(self.trees[0])
        self.samples = Samples(self.loops, work.mechanisms, limit)
        self.start = in_order(np.array([tree.start() for tree in self.trees]), self.samples.columns)
        places, sites = self.samples.batch.expand("body_pos"), self.samples.batch.expand("site_pos")
        for sample, tree in enumerate(self.trees):
            model = _model(tree.system.tree)
            places[sample], sites[sample] = model.body_pos, model.site_pos

    def solve(self, order: int) -> list[Any]:
        """Return tree coordinates and rates (T, M, n) up to an order; guesses take all rates."""
        values, held = self.loops.clock.values[:, :, 0], self.samples.held
        poses: list[list[Any]] = []
        for k in range(len(self.t)):
            if k == 0:
                guess = self.start.copy()
            else:
                h, (q, v, a) = self.t[k] - self.t[k - 1], poses[-1]
                guess = q + h * (v + 0.5 * h * a)
            guess[:, held] = values[0, k]
            poses.append(self.samples.solved(guess, values[1:, k, None], 2))
        return [np.array([pose[level] for pose in poses])[..., self.samples.columns] for level in range(order + 1)]

    def read(self, levels: list[Any]) -> Iterator[Any]:
        """Yield the answers, mechanism by mechanism."""
        for sample, tree in enumerate(self.trees):
            bodies = tree.read([level[:, sample].T for level in levels])
            yield whole(self.work, np.array([sample]), [level[:, None] for level in bodies])


def _model(joints: Any) -> Any:
    """Return MuJoCo's model of a tree, with sites and sensors of accelerations at the ends of its loops."""
    plan = Plan(joints, joints.closures)
    switch_on(plan.spec, "SENSOR")
    for k in range(len(joints.closures)):
        for side in "ij":
            plan.spec.add_sensor(
                name=f"c{k} {side}",
                type=mujoco.mjtSensor.mjSENS_FRAMELINACC,
                objtype=mujoco.mjtObj.mjOBJ_SITE,
                objname=f"c{k} {side}",
            )
    model = plan.compile()
    model.opt.disableflags |= sum(int(getattr(mujoco.mjtDisableBit, f"mjDSBL_{name}")) for name in UNUSED)
    return model
