"""MuJoCo's methods, and its fastest: many poses, or many mechanisms, at once by `mujoco.batch`, on one thread.

There the model is the joint tree with a site at either end of each loop that is left open. Positions of sites, their
Jacobians and accelerations are MuJoCo's own; Newton on the free coordinates is the adapter's, on rows (`tree.at_once`).
Many mechanisms go from time to time together. One pose after the other is found in scalars (`tree.scalars`), on the
rows of its equality constraints.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator
from functools import partial
from typing import Any

import numpy as np

from crosscheck.engines import EngineError
from crosscheck.engines.methods import Batch, Method, Model, Use, of_routes, one_by_one
from crosscheck.engines.mujoco.engine import Mujoco
from crosscheck.engines.mujoco.model import Plan, mujoco, switch_on
from crosscheck.engines.mujoco.space import MujocoSpace
from crosscheck.engines.mujoco.stepping import stepping_methods, tree_of
from crosscheck.engines.tree.at_once import ManyNewton, at_once_methods
from crosscheck.engines.tree.joint_tree import in_order
from crosscheck.engines.tree.newton import Loops, newton_methods
from crosscheck.engines.tree.scalars import Row, scalar_methods
from crosscheck.scenes.workloads import FourBars, LoopChain, Workload, whole
from refkin.model import Scene

MECHANISMS = 200
"""So many of many mechanisms are done."""
UNUSED = ("EQUALITY", "CONSTRAINT")
"""What of MuJoCo the batch has no need of, beside all that is no kinematics."""


def methods() -> Iterator[Method]:
    """Yield the methods of MuJoCo."""
    yield from of_routes(Mujoco(), frozenset({Use.COMPARE, Use.PRICE, Use.EFFECTS, Use.HARD}))
    name = "mujoco.batch, all times at once"
    note = "its sites, Jacobians and accelerations; laws are tabulated with the model"
    yield from at_once_methods("mujoco", name, note, linked, ConnectRows, SampledLoops, _batched)
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


def _batched(limit: float, build: Callable[[Scene], Model], workload: Workload, order: int) -> Batch:
    if isinstance(workload, LoopChain):
        raise EngineError("not made for chains: mujoco.batch binds no constraint rows, and one pose is no batch")
    if not isinstance(workload, FourBars):
        raise EngineError("made for four-bars: its joint tree is of the plane")
    part = workload.first(MECHANISMS)
    if part.mechanisms == 1:
        return one_by_one(build, part, order)
    many = ManyMechanisms(part, limit)
    return Batch(lambda: many.solve(order), part.configurations, lambda: many.read(many.solve(order)))


class SampledLoops:
    """A tree's loops at so many poses at once; columns are MuJoCo's, in the order of its joints."""

    def __init__(self, loops: Loops, count: int) -> None:
        self.count, joints = count, loops.tree.system.tree
        self.model = _model(joints)
        self.columns = np.array([self.model.joint(f"q{k}").id for k in range(joints.width)], int)
        self.ends = [[self.model.site(f"c{k} {side}").id for side in "ij"] for k in range(len(joints.closures))]
        from mujoco import batch

        self.batch: Any = batch.Batch(self.model, nsim=count, nthread=1)
        self.q, self.v = self.batch.bind("qpos"), self.batch.bind("qvel")
        self.sites, self.qacc = self.batch.bind("site_xpos"), self.batch.bind("qacc")
        self.sensed = self.batch.bind("sensordata")

    def gaps(self, q: Any) -> Any:
        """Return the gaps of the loops (B, 2 L) at q (B, n)."""
        self.q[:] = q
        self.batch.forward(stage=mujoco.mjtStage.mjSTAGE_POS.value)
        return np.concatenate([self.sites[:, i, :2] - self.sites[:, j, :2] for i, j in self.ends], axis=1)

    def slopes(self) -> Any:
        """Return their Jacobians (B, 2 L, n) at the poses whose gaps were asked for last."""
        rows = [self._jacobian(i) - self._jacobian(j) for i, j in self.ends]
        return rows[0] if len(rows) == 1 else np.concatenate(rows, axis=1)

    def drift(self, v: Any, slopes: Any) -> Any:
        """Return the accelerations of the gaps (B, 2 L) less those that MuJoCo's own qacc makes, by the slopes."""
        self.v[:] = v
        self.batch.forward()
        ends = self.sensed.reshape(self.count, -1, 2, 3)[..., :2]
        return (ends[:, :, 0] - ends[:, :, 1]).reshape(self.count, -1) - (slopes @ self.qacc[..., None])[..., 0]

    def _jacobian(self, site: int) -> Any:
        body = int(self.model.site_bodyid[site])
        return self.batch.jac(body, self.sites[:, site])[0][:, :2] if body else 0.0


class ManyMechanisms:
    """Many mechanisms of one topology, time after time; places of joints and sites differ."""

    def __init__(self, work: FourBars, limit: float) -> None:
        self.work, self.t = work, work.t
        self.trees = [tree_of(work.scene(sample)) for sample in range(work.mechanisms)]
        self.loops = Loops.of(self.trees[0])
        many = SampledLoops(self.loops, work.mechanisms)
        self.newton, self.columns = ManyNewton(self.loops, many, limit), many.columns
        self.start = in_order(np.array([tree.start() for tree in self.trees]), many.columns)
        places, sites = many.batch.expand("body_pos"), many.batch.expand("site_pos")
        for sample, tree in enumerate(self.trees):
            model = _model(tree.system.tree)
            places[sample], sites[sample] = model.body_pos, model.site_pos

    def solve(self, order: int) -> list[Any]:
        """Return tree coordinates and rates (T, M, n) up to an order; guesses take all rates."""
        values, held = self.loops.clock.values[:, :, 0], self.newton.held
        poses: list[list[Any]] = []
        for k in range(len(self.t)):
            if k == 0:
                guess = self.start.copy()
            else:
                h, (q, v, a) = self.t[k] - self.t[k - 1], poses[-1]
                guess = q + h * (v + 0.5 * h * a)
            guess[:, held] = values[0, k]
            poses.append(self.newton.solved(guess, values[1:, k, None], 2))
        return [np.array([pose[level] for pose in poses])[..., self.columns] for level in range(order + 1)]

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
