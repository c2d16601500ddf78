"""Pinocchio's methods: a joint tree, its loops closed by Newton on the free coordinates (its fastest); steps in time.

Pinocchio closes no loops itself. Residual, Jacobian and point accelerations are its own; Newton and systems of two
equations are the adapter's, in scalars (`tree.scalars`) or, of many poses at once, on rows (`tree.at_once`).

Nor does it integrate in time: Euler and Runge-Kutta, with and without Baumgarte's terms, are the adapter's, on its
`constraintDynamics`. The prescribed coordinates are overwritten before each step, with an armature beside which no
constraint force moves them; stepping starts at a closed pose with consistent velocities.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from functools import partial
from itertools import product
from typing import Any

import numpy as np
import pinocchio as pin

from crosscheck.engines.methods import Method, Model, Use, of_routes, priced
from crosscheck.engines.pinocchio.engine import Pinocchio, PinocchioTree
from crosscheck.engines.pinocchio.model import PlacedFrame, Points
from crosscheck.engines.pinocchio.space import PinocchioSpace
from crosscheck.engines.tree.at_once import at_once_methods
from crosscheck.engines.tree.joint_tree import Array, joint_tree
from crosscheck.engines.tree.newton import NOBODY, Clockwork, Loops, Tree, newton_methods
from crosscheck.engines.tree.scalars import Row, scalar_methods
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
            rate = BAUMGARTE / h if stabilised else 0.0
            for constraint in self.constraints:
                constraint.m_baumgarte_parameters = pin.BaumgarteCorrectorParameters(rate * rate, 2.0 * rate)
            for _ in range(steps):
                q[held], qd[held] = values[:2, at]
                q, qd = rule(partial(self._acceleration, held), values[2, at : at + 3], q, qd, h)
                at += 2
        return levels

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


def methods() -> Iterator[Method]:
    """Yield the methods of Pinocchio."""
    yield from of_routes(Pinocchio(), frozenset({Use.COMPARE, Use.PRICE, Use.EFFECTS, Use.HARD}))
    name, note = (
        "all times at once",
        "places, Jacobians, accelerations are its own; laws are tabulated with the model",
    )
    yield from at_once_methods("pinocchio", name, note, tree_of, Anchors, PlacedLoops)
    yield from scalar_methods("pinocchio", tree_of, Anchors)
    yield from newton_methods("pinocchio", tree_of, PinocchioSpace)
    yield from stepping_methods()


class Anchors:
    """Pinocchio's loops at one pose, each one of its anchors.

    Where an anchor is placed it has the gap, its Jacobian and, where nothing accelerates the tree, the acceleration of
    the gap, all three in axes of the same frame.
    """

    def __init__(self, loops: Loops) -> None:
        engine: Any = loops.tree.engine
        self.planar = engine.planar
        self.columns: Sequence[int] = range(self.planar.model.nv)
        self.anchors = [self._anchor(contact) for contact in engine.rows.contacts()[0]]

    def _anchor(self, contact: Any) -> tuple[Any, ...]:
        """Return what places an anchor, what gives its Jacobian, and views of its gap and the gap's acceleration."""
        model, ends = self.planar.model, ("joint1_id", "joint1_placement", "joint2_id", "joint2_placement")
        anchor = pin.PointAnchorConstraintModel(model, *(getattr(contact, end) for end in ends))
        of_pose = anchor.createData()
        place, slopes = (partial(of, model, self.planar.data, of_pose) for of in (anchor.calc, anchor.jacobian))
        return place, slopes, of_pose.constraint_position_error, of_pose.constraint_acceleration_error

    def closure(self, q: Row) -> tuple[Row, Row]:
        """Return the gaps of the loops (3 L,) and their Jacobian (3 L n,)."""
        self.planar.place(np.array(q))
        gaps: Row = []
        rows: Row = []
        for place, slopes, gap, _ in self.anchors:
            place()
            gaps += gap.tolist()
            rows += slopes().ravel().tolist()
        return gaps, rows

    def drift(self, q: Row, qd: Row) -> Row:
        """Return the accelerations of the gaps (3 L,) at qdd = 0."""
        self.planar.move(np.array(q), np.array(qd))
        for place, *_ in self.anchors:
            place()
        return [x for *_, bend in self.anchors for x in bend.tolist()]


class PlacedLoops:
    """Pinocchio's loops at so many poses: its calls one pose after the other, what they say together.

    Of the joints that hold the ends of loops it has places, velocities and accelerations, and one Jacobian of all.
    """

    def __init__(self, loops: Loops, count: int) -> None:
        engine: Any = loops.tree.engine
        planar = self.planar = engine.planar
        self.columns = np.arange(planar.model.nv)
        sides = ("joint1_id", "joint1_placement"), ("joint2_id", "joint2_placement")
        contacts = engine.rows.contacts()[0]
        ends = [PlacedFrame(*(getattr(contact, key) for key in side)) for side in sides for contact in contacts]
        self.points, self.moved = Points(planar, ends), np.zeros((len(ends), planar.model.nv))
        for moves, end in zip(self.moved, ends, strict=True):
            for joint in planar.model.supports[end.joint].tolist()[1:]:
                moves[planar.model.idx_vs[joint]] = 1.0
        self.poses, self.placing = self.points.kept(count, 1)
        self.slopes_of_all = np.empty((count, 6, planar.model.nv))
        self.placing += [(planar.data.J, self.slopes_of_all)]  # a view: what places the model fills it
        self.rates, self.moving = self.points.kept(count, 3)
        self.q = np.empty((count, planar.model.nv))
        self.at: Array = np.empty(0)

    def gaps(self, q: Array) -> Array:
        """Return the gaps of the loops (B, 2 L) at q (B, n)."""
        self.q[:] = q
        self.planar.sampled(self.planar.place, (q,), self.placing)
        self.at = self.points.motion(self.poses)[0]
        return _between(self.at)

    def slopes(self) -> Array:
        """Return their Jacobians (B, 2 L, n) at the poses whose gaps were asked for last."""
        along, turning = self.slopes_of_all[:, None, :2], self.slopes_of_all[:, None, 5]
        across = np.stack([-self.at[..., 1:] * turning, self.at[..., :1] * turning], axis=2)
        return _between((along + across) * self.moved[:, None])

    def drift(self, v: Array, slopes: Array) -> Array:
        """Return the accelerations of the gaps (B, 2 L) at qdd = 0, at rates v (B, n) there."""
        self.planar.sampled(self.planar.move, (self.q, v), self.moving)
        return _between(self.points.motion(self.rates)[2])


def _between(ends: Array) -> Array:
    """Return what is of the first ends of loops (B, 2 L, 2, ...) less what is of the second, (B, 2 L, ...)."""
    first, second = np.split(ends, 2, axis=1)
    gaps: Array = (first - second).reshape(len(ends), -1, *ends.shape[3:])
    return gaps
