"""Pinocchio's methods: a joint tree, its loops closed by Newton on the free coordinates (its fastest); steps in time.

Pinocchio closes no loops itself. Residual, Jacobian and point accelerations are its own; Newton and systems of two
equations are done here in scalars, because two calls of numpy.linalg.solve would take longer than all of its work.

Nor does it integrate in time: Euler and Runge-Kutta, with and without Baumgarte's terms, are the adapter's, on its
`constraintDynamics`. The prescribed coordinates are overwritten before each step, with an armature beside which no
constraint force moves them; stepping starts at a closed pose with consistent velocities.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator
from contextlib import suppress
from functools import partial
from itertools import product
from operator import mul
from typing import Any

import numpy as np
import pinocchio as pin

from crosscheck.engines.methods import Method, Model, Use, of_routes, priced
from crosscheck.engines.pinocchio.engine import Pinocchio, PinocchioTree
from crosscheck.engines.pinocchio.space import PinocchioSpace
from crosscheck.engines.tree.joint_tree import Array, joint_tree
from crosscheck.engines.tree.newton import NOBODY, Clockwork, Loops, Tree, newton_methods
from refkin.model import Scene

FLYWHEEL = 1e12
"""Armature of a prescribed coordinate, 1 for the others: there are no masses."""
COMPLIANCE, ACCURACY, ITERATIONS = 1e-10, 1e-14, 20
"""The proximal settings of the constrained dynamics: its z rows are redundant, with no compliance it gives NaN."""
BAUMGARTE = 0.25
"""Baumgarte's rate a (terms 2 a v + a^2 g) times the step: well inside what Euler's rule can bear, a h < 2."""
STEPS = (1, 3, 10)
"""Steps from one time of the scene to the next."""

Acceleration = Callable[[Array, Array, Array], Array]
"""Accelerations of the prescribed coordinates, q, qd -> those of all."""


def stepping_methods() -> Iterator[Method]:
    """Yield the integration of its constrained dynamics at all settings."""
    for (rule, by), stabilised, steps in product(RULES.items(), (False, True), STEPS):
        name, note = f"constraintDynamics, {rule}", "integrated by the adapter"
        if stabilised:
            name, note = f"{name}, Baumgarte", f"{note}; a h = {BAUMGARTE}"
        setting, build = f"{steps} step{'s' * (steps > 1)} between times", partial(_stepped, by, stabilised, steps)
        yield priced("pinocchio", name, setting, NOBODY, build, note, steps=True)


def _stepped(rule: Any, stabilised: bool, steps: int, scene: Scene) -> Model:
    stepper = PinocchioStepper(tree_of(scene))
    clock = stepper.tree.clockwork(2 * steps)  # the middle of each step, too
    return Model(partial(stepper.solve, rule, stabilised, clock), stepper.tree.read)


def tree_of(scene: Scene) -> Tree:
    """Return a scene as Pinocchio's joint tree; raises as `Tree.of`."""
    return Tree.of(Pinocchio(), lambda mechanism: PinocchioTree(joint_tree(mechanism, massless_links=True)), scene)


class PinocchioStepper:
    """A scene in Pinocchio's constrained dynamics; EngineError as `Tree.pinned`, or if a driver holds no coordinate."""

    def __init__(self, tree: Tree) -> None:
        self.tree, self.scene = tree, tree.scene
        tree.pinned("only revolute joints are priced in its constrained dynamics")
        held = tree.clockwork(1).columns
        engine: Any = tree.engine
        self.constraints, self.constraint_data = engine.rows.contacts()
        self.model, self.data = engine.planar.model, engine.planar.model.createData()
        armature = np.ones(self.model.nv)
        armature[held] = FLYWHEEL
        self.model.armature = armature
        pin.initConstraintDynamics(self.model, self.data, self.constraints, self.constraint_data)
        self.settings = pin.ProximalSettings(ACCURACY, COMPLIANCE, ITERATIONS)
        self.q, self.qd = tree.first()

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


RULES = {"Euler": _euler, "RK4": _rk4}


LIMITS = (1e-2, 1e-4, 1e-8)
"""Largest correction at which Newton stops; it squares the error."""
MOST_NEWTON = 12


def methods() -> Iterator[Method]:
    """Yield the methods of Pinocchio."""
    yield from of_routes(Pinocchio(), frozenset({Use.COMPARE, Use.PRICE, Use.EFFECTS, Use.HARD}))
    name, who = "Newton on free coordinates", "the adapter (in scalars)"
    note = "each pose from the extrapolated one; laws are tabulated with the model"
    for limit in LIMITS:
        uses = frozenset({Use.PRICE, Use.BENCH} if limit == LIMITS[-1] else {Use.PRICE})
        yield priced("pinocchio", name, f"|dq| < {limit:g}", who, partial(_direct, limit), note, uses=uses)
    yield from newton_methods("pinocchio", tree_of, PinocchioSpace)
    yield from stepping_methods()


def _direct(limit: float, scene: Scene) -> Model:
    loops = Loops.of(tree_of(scene))
    return Model(Direct(loops, limit).solve, loops.tree.read)


class Direct:
    """One mechanism, pose after pose; in scalars, as an array of so few numbers costs more than what is done to it.

    Each loop is one anchor of Pinocchio's: where it is placed it has the gap, its Jacobian and, where nothing
    accelerates the tree, the acceleration of the gap, all three in axes of the same frame.
    """

    def __init__(self, loops: Loops, limit: float) -> None:
        engine: Any = loops.tree.engine
        self.limit, self.t, self.planar = limit, loops.tree.scene.times, engine.planar
        self.start = loops.tree.start().tolist()
        self.held, self.free = loops.clock.columns.tolist(), loops.free.tolist()
        self.values = loops.clock.values[:, :, 0].tolist()
        self.anchors = [self._anchor(contact) for contact in engine.rows.contacts()[0]]

    def _anchor(self, contact: Any) -> tuple[Any, ...]:
        """Return what places an anchor, what gives its Jacobian, and views of its gap and the gap's acceleration."""
        model, ends = self.planar.model, ("joint1_id", "joint1_placement", "joint2_id", "joint2_placement")
        anchor = pin.PointAnchorConstraintModel(model, *(getattr(contact, end) for end in ends))
        of_pose = anchor.createData()
        place, slopes = (partial(of, model, self.planar.data, of_pose) for of in (anchor.calc, anchor.jacobian))
        return place, slopes, of_pose.constraint_position_error, of_pose.constraint_acceleration_error

    def solve(self, order: int) -> list[Any]:
        """Return tree coordinates and rates (n, T) up to an order; NaN from where Newton does not converge."""
        poses: list[list[list[float]]] = []
        with suppress(ZeroDivisionError, np.linalg.LinAlgError):  # a singular pose, beyond which it does not go
            for pose in self._poses(order):
                poses.append(pose)
        out = np.full((len(self.t), order + 1, len(self.start)), np.nan)
        if poses:
            out[: len(poses)] = poses
        return list(out.transpose(1, 2, 0))

    def _poses(self, order: int) -> Iterator[list[list[float]]]:
        """Yield coordinates and rates up to an order, each pose from where all that is known of the last one leads."""
        still = [0.0] * len(self.start)
        known, before = [self.start, still, still, still], 0.0
        for t, *given in zip(self.t, *self.values, strict=True):
            h = t - before
            q = np.array([x + h * (v + h * (a / 2.0 + h * j / 6.0)) for x, v, a, j in zip(*known, strict=True)])
            rows = self._close(q, given[0])
            if rows is None:
                return
            if order:
                rows = self._closure(q)[1]
            pose = [q.tolist(), self._rates(rows, given[1], [0.0] * len(rows))]
            if order > 1:
                self.planar.move(q, np.array(pose[1]))
                pose.append(self._rates(rows, given[2], self._drift()))
            yield pose[: order + 1]
            pairs = zip(pose[-1], known[len(pose) - 1], strict=True)
            slope = still if known[0] is self.start else [(x - y) / h for x, y in pairs]
            known, before = [*pose, slope, still][:4], t

    def _close(self, q: Any, held: list[float]) -> list[list[float]] | None:
        """Close the loops from q, which is changed; return the last Jacobian, None without convergence."""
        for column, value in zip(self.held, held, strict=True):
            q[column] = value
        for _ in range(MOST_NEWTON):
            gaps, rows = self._closure(q)
            step = self._solved(rows, gaps)
            for column, x in zip(self.free, step, strict=True):
                q[column] -= x
            if max(map(abs, step)) <= self.limit:
                return rows
        return None

    def _rates(self, rows: list[list[float]], held: list[float], drift: list[float]) -> list[float]:
        """Return the rates (n,) for which rows and drift make 0, from those of the prescribed coordinates."""
        rates = [0.0] * len(self.start)
        for column, rate in zip(self.held, held, strict=True):
            rates[column] = rate
        right = [sum(map(mul, row, rates), more) for row, more in zip(rows, drift, strict=True)]
        for column, x in zip(self.free, self._solved(rows, right), strict=True):
            rates[column] = -x
        return rates

    def _solved(self, rows: list[list[float]], right: list[float]) -> list[float]:
        """Return the solution in the free columns; of two rows without LAPACK, whose call would take longer."""
        if len(rows) > 2:
            solution: list[float] = np.linalg.solve(np.array(rows)[:, self.free], right).tolist()
            return solution
        (i, j), (one, other), (x, y) = self.free, rows, right
        determinant = one[i] * other[j] - one[j] * other[i]
        return [(other[j] * x - one[j] * y) / determinant, (one[i] * y - other[i] * x) / determinant]

    def _closure(self, q: Any) -> tuple[list[float], list[list[float]]]:
        """Return the gaps of the loops (2 L,) and their Jacobian (2 L, n)."""
        self.planar.place(q)
        gaps, rows = [], []
        for place, slopes, gap, _ in self.anchors:
            place()
            gaps += gap.tolist()[:2]
            rows += slopes().tolist()[:2]
        return gaps, rows

    def _drift(self) -> list[float]:
        """Return the accelerations of the gaps (2 L,) as the model moves."""
        for place, *_ in self.anchors:
            place()
        return [x for *_, bend in self.anchors for x in bend.tolist()[:2]]
