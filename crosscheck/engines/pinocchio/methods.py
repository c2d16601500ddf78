"""Pinocchio's methods: a joint tree, its loops closed by Newton on the free coordinates (its fastest); steps in time.

Pinocchio closes no loops itself. Residual, Jacobian and point accelerations are its own; Newton and systems of two
equations are done here in scalars, because two calls of numpy.linalg.solve would take longer than all of its work.

Nor does it integrate in time: Euler and Runge-Kutta, with and without Baumgarte's terms, are the adapter's, on its
`constraintDynamics`. The prescribed coordinates are overwritten before each step, with an armature beside which no
constraint force moves them; stepping starts at a closed pose with consistent velocities.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator
from functools import partial
from typing import Any

import numpy as np
import pinocchio as pin

from crosscheck.engines import EngineError
from crosscheck.engines.methods import Method, Model, Use, of_routes
from crosscheck.engines.pinocchio.engine import Pinocchio, PinocchioTree
from crosscheck.engines.pinocchio.rows import element_rows
from crosscheck.engines.pinocchio.space import PinocchioSpace
from crosscheck.engines.tree.joint_tree import Array, joint_tree
from crosscheck.engines.tree.newton import NOBODY, Clockwork, Loops, Tree, newton_methods, solved_one
from refkin.joints import PointsCoincide
from refkin.model import Scene

FLYWHEEL = 1e12
"""Armature of a prescribed coordinate, 1 for the others: there are no masses."""
COMPLIANCE, ACCURACY, ITERATIONS = 1e-10, 1e-14, 20
"""The proximal settings of the constrained dynamics: its z rows are redundant, with no compliance it gives NaN."""
BAUMGARTE = 0.25
"""Baumgarte's rate a (terms 2 a v + a^2 g) times the step: well inside what Euler's rule can bear, a h < 2."""
STEPPING = {
    "constraintDynamics, Euler": ("euler", False, (1, 3, 10)),
    "constraintDynamics, Euler, Baumgarte": ("euler", True, (1, 3, 10)),
    "constraintDynamics, RK4": ("rk4", False, (1, 3, 10)),
    "constraintDynamics, RK4, Baumgarte": ("rk4", True, (1, 3, 10)),
}

Acceleration = Callable[[Array, Array, Array], Array]
"""Accelerations of the prescribed coordinates, q, qd -> those of all."""


def stepping_methods() -> Iterator[Method]:
    """Yield the integration of its constrained dynamics at all settings."""
    for name, (rule, stabilised, counts) in STEPPING.items():
        for steps in counts:
            yield Method(
                engine="pinocchio",
                name=name,
                setting=f"{steps} step{'s' * (steps > 1)} between times",
                newton_by=NOBODY,
                uses=frozenset({Use.PRICE}),
                build=partial(_stepped, RULES[rule], stabilised, steps),
                steps=True,
                note="integrated by the adapter" + f"; a h = {BAUMGARTE}" * stabilised,
            )


def _stepped(rule: Any, stabilised: bool, steps: int, scene: Scene) -> Model:
    stepper = Stepper(tree_of(scene))
    return Model(partial(stepper.solve, rule, stabilised, stepper.clockwork(steps)), stepper.tree.read)


def tree_of(scene: Scene) -> Tree:
    """Return a scene as Pinocchio's joint tree; raises as `Tree.of`."""
    return Tree.of(Pinocchio(), lambda mechanism: PinocchioTree(joint_tree(mechanism, massless_links=True)), scene)


class Stepper:
    """A scene in Pinocchio's constrained dynamics.

    Raises
    ------
    EngineError
        If a loop is closed by another joint than a revolute, or a driver holds no coordinate of the tree.
    """

    def __init__(self, tree: Tree) -> None:
        self.tree, self.scene = tree, tree.scene
        closures = tree.system.tree.closures
        other = [element for element in closures if not isinstance(element, PointsCoincide)]
        if other or not closures:
            which = f"joint {other[0].name!r} closes a loop" if other else "no joint closes a loop"
            raise EngineError(f"{which}: only revolute joints are priced in its constrained dynamics")
        held = self.clockwork(1).columns
        engine: Any = tree.engine
        self.constraints, self.constraint_data = engine.contacts()
        self.model, self.data = engine.planar.model, engine.planar.model.createData()
        armature = np.ones(self.model.nv)
        armature[held] = FLYWHEEL
        self.model.armature = armature
        pin.initConstraintDynamics(self.model, self.data, self.constraints, self.constraint_data)
        self.settings = pin.ProximalSettings(ACCURACY, COMPLIANCE, ITERATIONS)
        self.q, self.qd = tree.first()

    def clockwork(self, steps: int) -> Clockwork:
        """Return the prescribed coordinates at the beginning and the middle of so many steps between two times."""
        return Clockwork.of(self.tree.system.tree, self.scene.times, 2 * steps)

    def solve(self, rule: Any, stabilised: bool, clock: Clockwork, order: int) -> list[Array]:
        """Return tree coordinates and rates up to an order at the scene's times."""
        q, qd, held = self.q.copy(), self.qd.copy(), clock.columns
        levels = [np.empty((len(q), len(self.scene.times))) for _ in range(order + 1)]
        steps = clock.times.shape[1] // 2
        values = clock.values.reshape(3, -1, len(held))
        for k in range(len(self.scene.times)):
            at = 2 * steps * k
            q[held], qd[held] = values[:2, at]
            for level, row in zip(levels, (q, qd), strict=False):
                level[:, k] = row
            if order > 1:
                levels[2][:, k] = self._acceleration(held, values[2, at], q, qd)
            if k + 1 == len(self.scene.times):
                break
            h = 2.0 * clock.step(k)
            self._stabilise(BAUMGARTE / h if stabilised else 0.0)
            for _ in range(steps):
                q[held], qd[held] = values[:2, at]
                q, qd = rule(partial(self._acceleration, held), values[2, at : at + 3], q, qd, h)
                at += 2
        return levels

    def _stabilise(self, rate: float) -> None:
        for constraint in self.constraints:
            constraint.m_baumgarte_parameters = pin.BaumgarteCorrectorParameters(rate * rate, 2.0 * rate)

    def _acceleration(self, held: Array, prescribed: Array, q: Array, qd: Array) -> Array:
        """Return the acceleration (n,) that Pinocchio gives, the prescribed coordinates being driven."""
        force = np.zeros(self.model.nv)
        force[held] = FLYWHEEL * prescribed
        system = (self.model, self.data, q, qd, force, self.constraints, self.constraint_data, self.settings)
        acceleration: Array = pin.constraintDynamics(*system)
        return acceleration


def _euler(acceleration: Acceleration, prescribed: Array, q: Array, qd: Array, h: float) -> tuple[Array, Array]:
    """Return the state after a step of Euler's semi-implicit rule."""
    qd = qd + h * acceleration(prescribed[0], q, qd)
    return q + h * qd, qd


def _rk4(acceleration: Acceleration, prescribed: Array, q: Array, qd: Array, h: float) -> tuple[Array, Array]:
    """Return the state after a step of the classical Runge-Kutta rule."""
    a1 = acceleration(prescribed[0], q, qd)
    v2 = qd + h / 2 * a1
    a2 = acceleration(prescribed[1], q + h / 2 * qd, v2)
    v3 = qd + h / 2 * a2
    a3 = acceleration(prescribed[1], q + h / 2 * v2, v3)
    v4 = qd + h * a3
    a4 = acceleration(prescribed[2], q + h * v3, v4)
    return q + h / 6 * (qd + 2 * v2 + 2 * v3 + v4), qd + h / 6 * (a1 + 2 * a2 + 2 * a3 + a4)


RULES = {"euler": _euler, "rk4": _rk4}


LIMITS = (1e-2, 1e-4, 1e-8)
"""Largest correction at which Newton stops; it squares the error."""
MOST_NEWTON = 12


def methods() -> Iterator[Method]:
    """Yield the methods of Pinocchio."""
    yield from of_routes(Pinocchio(), frozenset({Use.COMPARE, Use.PRICE, Use.EFFECTS, Use.HARD}))
    for limit in LIMITS:
        yield Method(
            engine="pinocchio",
            name="Newton on free coordinates",
            setting=f"|dq| < {limit:g}",
            newton_by="the adapter (in scalars)",
            uses=frozenset({Use.PRICE, Use.BENCH}) if limit == LIMITS[-1] else frozenset({Use.PRICE}),
            build=partial(_direct, limit),
            note="each pose from the extrapolated one; laws are tabulated with the model",
        )
    yield from newton_methods("pinocchio", tree_of, PinocchioSpace)
    yield from stepping_methods()


def _direct(limit: float, scene: Scene) -> Model:
    loops = Loops.of(tree_of(scene))
    return Model(Direct(loops, limit).solve, loops.tree.read)


class Direct:
    """One mechanism, pose after pose."""

    def __init__(self, loops: Loops, limit: float) -> None:
        self.loops, self.limit, self.t = loops, limit, loops.tree.scene.times
        engine: Any = loops.tree.engine
        joints, self.planar = engine.tree, engine.planar
        self.ends = [element_rows(self.planar, element, joints.scaled) for element in joints.closures]
        self.start, self.held, self.free = joints.start(), loops.clock.columns, loops.free
        self.values = loops.clock.values[:, :, 0]
        self.still = np.zeros(joints.width)

    def solve(self, order: int) -> list[Any]:
        """Return tree coordinates and rates (n, T) up to an order; NaN from where Newton does not converge."""
        out = np.full((order + 1, len(self.start), len(self.t)), np.nan)
        q, v, before = self.start.copy(), self.still, self.still
        for k in range(len(self.t)):
            if k:
                h = self.t[k] - self.t[k - 1]
                q = q + h * (v + 0.5 * h * self._bend(out, k, v, before))
            jacobian = self._close(q, k)
            if jacobian is None:
                break
            if order:
                jacobian = self._closure(q)[1]
            before, v = v, self._velocity(jacobian, self.values[1, k])
            for level, row in zip(out, (q, v), strict=False):
                level[:, k] = row
            if order > 1:
                out[2, :, k] = self._acceleration(jacobian, q, v, self.values[2, k])
        return list(out)

    def _bend(self, out: Any, k: int, v: Any, before: Any) -> Any:
        """Return the acceleration at the last time, or how the last two velocities differ."""
        if len(out) > 2:
            return out[2, :, k - 1]
        return (v - before) / (self.t[k - 1] - self.t[k - 2]) if k > 1 else self.still

    def _close(self, q: Any, k: int) -> Any:
        """Close the loops at a time from q, which is changed; return the last Jacobian, None without convergence."""
        q[self.held] = self.values[0, k]
        for _ in range(MOST_NEWTON):
            gap, jacobian = self._closure(q)
            step = solved_one(jacobian[:, self.free], gap)
            q[self.free] -= step
            if max(map(abs, step.tolist())) <= self.limit:
                return jacobian
        return None

    def _velocity(self, jacobian: Any, rate: Any) -> Any:
        v = np.empty(len(self.start))
        v[self.held] = rate
        v[self.free] = -solved_one(jacobian[:, self.free], jacobian[:, self.held] @ rate)
        return v

    def _acceleration(self, jacobian: Any, q: Any, v: Any, rate: Any) -> Any:
        self.planar.move(q, v)
        a = np.empty(len(self.start))
        a[self.held] = rate
        a[self.free] = -solved_one(jacobian[:, self.free], self._drift() + jacobian[:, self.held] @ rate)
        return a

    def _closure(self, q: Any) -> tuple[Any, Any]:
        """Return the gaps of the loops (2 L,) and their Jacobian (2 L, n)."""
        self.planar.place(q)
        rows, gaps = [], []
        for (slopes, _), (at_j, _), (at_i, _) in (row.still for row in self.ends):
            rows.append(slopes()[:2])  # calculates, and fills the places
            gaps.append(at_j[:2] - at_i[:2])
        return (gaps[0], rows[0]) if len(rows) == 1 else (np.concatenate(gaps), np.concatenate(rows))

    def _drift(self) -> Any:
        """Return the accelerations of the gaps (2 L,) as the model moves."""
        rows = [np.subtract(*(read()[:2] for read, _ in row.bends)) for row in self.ends]
        return rows[0] if len(rows) == 1 else np.concatenate(rows)
