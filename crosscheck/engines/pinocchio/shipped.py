"""Pinocchio's own way to close a loop, with the settings of the example that it ships.

`examples/simulation-closed-kinematic-chains.py` closes a four-bar by proximal steps: the KKT system of the constraints
with mass rho = 1e-10 and regularisation mu = 1e-4, factored and solved by Pinocchio's constraint Cholesky
decomposition, at most 100 times, until constraint and dual residual are below 1e-10. That loop stands here, with the
names of Pinocchio 4, for the loops of any joint tree. The input is held by a 6D constraint between the body that a
driver moves and the ground, its target placed by the law; each time starts at the last answer, as a user would do it.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Any, NoReturn

import numpy as np
import pinocchio as pin

from crosscheck.engines import Array, EngineRefusal, Term, route_by
from crosscheck.engines.march import Closing
from crosscheck.engines.pinocchio.model import shift, tree_model, turn, unit_vector
from crosscheck.engines.spatial.kinds import JointKind
from crosscheck.engines.spatial.reading import Drive
from crosscheck.engines.spatial.system import SpaceSystem
from crosscheck.engines.tree.joint_tree import Edge, Freedom, JointTree
from refkin.joints import GROUND, Element, PointCoordinate, PointsCoincide, RelativeAngle

CLOSED_CHAIN = route_by(
    "pinocchio",
    "closed-chain example",
    "adapter: the loop of Pinocchio's example simulation-closed-kinematic-chains.py",
    linear_solve_by="pinocchio (ConstraintCholeskyDecomposition)",
    drift_by="none: positions only",
)
RHO, MU, EPS, MOST = 1e-10, 1e-4, 1e-10, 100
"""The example's settings."""
STOP = Term(
    name="stopping rule",
    level="position",
    reason="the example stops at a constraint residual of 1e-10, in the model's unit, here the mechanism's size",
    absolute=EPS,
)


def closed_chain(tree: JointTree) -> Closing:
    """Return what closes a tree.

    A loop that no revolute joint closes is refused, and a driver that holds no joint by which a body hangs on the
    ground.
    """
    planar = tree_model(tree)
    drivers = [_Held(tree, element) for element in tree.driven]
    for e in tree.closures:
        if not isinstance(e, PointsCoincide):
            _refuse(f"{e.key} of {e.name!r}", "its RigidConstraintModel closes loops at points or frames")
    ends = [[planar.frames[body].at(tree.scaled(body, u)) for body, u in reversed(e.ends)] for e in tree.closures]
    places = [[x for end in pair for x in (end.joint, end.placement)] for pair in ends]
    example = Example(planar.model, planar.data, places, lambda t: [(held.joint, held.moved(t)) for held in drivers])
    return example.closed


class Example:
    """The example's loop, on a model whose loops are closed at points, two places each.

    `held` says at a time which joints are held, and how far each has moved.
    """

    def __init__(self, model: Any, data: Any, places: list[Any], held: Callable[[float], list[Any]]) -> None:
        self.model, self.data, self.held = model, data, held
        self.loops = [pin.RigidConstraintModel(pin.ContactType.CONTACT_3D, model, *ends) for ends in places]

    def _hold(self, joint: int, moved: Any) -> Any:
        """Return the constraint that holds a joint's frame where it has moved to."""
        ends = (joint, pin.SE3.Identity(), 0, self.model.jointPlacements[joint] * moved)
        return pin.RigidConstraintModel(pin.ContactType.CONTACT_6D, self.model, *ends)

    def closed(self, q: Array, t: float) -> tuple[Array | None, float]:
        """Return where the example's loop ends, None if it does not within its 100 steps, and the residual."""
        models = [*self.loops, *(self._hold(*one) for one in self.held(t))]
        datas = [model.createData() for model in models]
        size = sum(model.residualSize() for model in models)
        self.data.M = np.eye(self.model.nv) * RHO
        kkt = pin.ConstraintCholeskyDecomposition(self.model, self.data, models, datas)
        y = np.ones(size)
        for _ in range(MOST):
            pin.computeJointJacobians(self.model, self.data, q)
            for model, data in zip(models, datas, strict=True):
                model.calc(self.model, self.data, data)
            kkt.compute(self.model, self.data, models, datas, MU)
            value = np.concatenate([_value(*one) for one in zip(models, datas, strict=True)])
            jacobian = pin.getConstraintsJacobian(self.model, self.data, models, datas)
            gap = float(np.max(np.abs(value)))
            if gap < EPS and np.max(np.abs(jacobian.T @ (value + y))) < EPS:
                return q, gap
            dz = kkt.solve(np.concatenate([-value - y * MU, np.zeros(self.model.nv)]))
            if not np.isfinite(dz).all():
                break
            q = pin.integrate(self.model, q, -dz[size:])
            y = dz[:size]
        return None, np.nan


def _value(model: Any, data: Any) -> Any:
    """Return how far a constraint is off: three rows of two points, or six of two frames."""
    return data.c1Mc2.translation if model.residualSize() == 3 else pin.log6(data.c1Mc2).vector


class SpaceExample:
    """The same for a joint tree of space: spherical joints close loops at a point, revolutes at two of their axis.

    Of redundant rows the example's loop is a noise of 1e-6 and never ends (Bennett's linkage): it says so. Other loops
    are refused, and drivers that hold no revolute or prismatic joint by which a body hangs on the ground.
    """

    def __init__(self, system: SpaceSystem) -> None:
        self.space: Any = system.engine
        self.model, tree = self.space.model, system.tree
        for gear in tree.numbers.gears:
            _refuse(f"gear {gear.name!r}", "its RigidConstraintModel couples no turns")
        self.drives = [(drive, self._joint(tree.edge_of(drive), drive)) for drive in tree.numbers.drives]
        for hold in tree.closures:
            if hold.kind not in (JointKind.SPHERICAL, JointKind.REVOLUTE):
                _refuse(f"{hold.kind} {hold.name!r}", "its RigidConstraintModel closes loops at points or frames")
        ends = [(*self.space.frames[j], *self.space.frames[i]) for i, j in system.pairs]
        self.example = Example(self.model, self.space.data, ends, self._held)

    def closed(self, q: Array, t: float) -> tuple[Array | None, float]:
        """Return where the example's loop ends in the tree's coordinates, or None, and the residual."""
        pose, gap = self.example.closed(self.space.coordinates(q), t)
        if pose is not None:
            for ball in self.space.tree.balls:
                pose[ball] = np.roll(pose[ball], 1)
        return pose, gap

    def _joint(self, edge: Any, drive: Drive) -> int:
        """Return the joint that a driver holds."""
        if edge is None or edge.parent != GROUND or edge.kind not in (JointKind.REVOLUTE, JointKind.PRISMATIC):
            _refuse(f"{drive.kind} {drive.name!r}", "it holds no joint by which a body hangs on the ground")
        return int(self.space.bodies[edge.body][0])

    def _held(self, t: float) -> list[tuple[int, Any]]:
        return [(joint, _moved(drive.kind, float(drive.value(t)))) for drive, joint in self.drives]


def _moved(kind: JointKind, value: float) -> Any:
    along = np.array([0.0, 0.0, value])
    return turn(unit_vector(value)) if kind == JointKind.ANGLE else pin.SE3(np.eye(3), along)


def _refuse(what: str, why: str) -> NoReturn:
    raise EngineRefusal(f"pinocchio refuses {what} by the method {CLOSED_CHAIN.name!r}: {why}")


class _Held:
    """The coordinate by which a body hangs on the ground, held by a driver."""

    def __init__(self, tree: JointTree, element: Element) -> None:
        self.tree, self.element = tree, element
        joints = [(k + 1, edge) for k, edge in enumerate(_moving(tree)) if edge.body == element.bodies[1]]
        if not joints:
            raise EngineRefusal(f"pinocchio refuses {element.key} of {element.name!r}: its body is fixed to another")
        self.joint, self.edge = joints[0]
        turning = isinstance(element, RelativeAngle) and element.body_i == GROUND
        sliding = isinstance(element, PointCoordinate)
        wanted = Freedom.TURN if turning else Freedom.SLIDE if sliding else None
        if self.edge.parent != GROUND or self.edge.freedom is not wanted:
            _refuse(f"{element.key} of {element.name!r}", "it holds no joint by which a body hangs on the ground")

    def moved(self, t: float) -> Any:
        """Return how far the law has moved the joint at a time."""
        value, (x, y) = self._coordinate(float(self.element.laws[0](t))), self.edge.axis
        return turn(unit_vector(value)) if self.edge.freedom is Freedom.TURN else shift((value * x, value * y))

    def _coordinate(self, law: float) -> float:
        """Return the joint's coordinate at a value of the law."""
        if self.edge.freedom is Freedom.TURN:
            return law  # a pin on the ground has no constant angle
        # A point of a slide moves along the axis: r = r0 + q a, along x or y of the ground.
        assert isinstance(self.element, PointCoordinate)
        k, edge = self.element.axis, self.edge
        along = turn(unit_vector(edge.angle)).rotation[:2, :2]
        arm = np.subtract(self.tree.scaled(edge.body, self.element.point_j), edge.pin)
        start = edge.point[k] + float(along[k] @ arm)
        return ((law - self.tree.origin[k]) / self.tree.size - start) / float(along[k] @ np.array(edge.axis))


def _moving(tree: JointTree) -> list[Edge]:
    """Return the edges that are joints of the model, in its order; a free body would be three of them."""
    edges: list[Edge] = []
    for edge in tree.edges:
        if edge.freedom is Freedom.FREE:
            _refuse(f"body {edge.body!r}", "no joint ties it to the rest")
        edges += [edge] * (edge.freedom is not Freedom.NONE)
    return edges
