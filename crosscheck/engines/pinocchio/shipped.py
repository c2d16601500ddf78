"""Pinocchio's own way to close a loop, with the settings of the example that it ships.

`examples/simulation-closed-kinematic-chains.py` closes a four-bar by proximal steps: the KKT system of the constraints
with mass rho = 1e-10 and regularisation mu = 1e-4, factored and solved by Pinocchio's constraint Cholesky
decomposition, at most 100 times, until constraint and dual residual are below 1e-10. That loop stands here, with the
names of Pinocchio 4, for the loops of any joint tree. The input is held by a 6D constraint between the body that a
driver moves and the ground, its target placed by the law; each time starts at the last answer, as a user would do it.
"""

from __future__ import annotations

from collections.abc import Iterator
from typing import Any

import numpy as np
import pinocchio as pin

from crosscheck.engines import Array, EngineRefusal, Term, route_by
from crosscheck.engines.march import March
from crosscheck.engines.pinocchio.model import PlanarModel, shift, tree_model, turn, unit_vector
from crosscheck.engines.tree.joint_tree import Edge, Freedom, JointTree
from refkin.joints import GROUND, Element, PointCoordinate, PointsCoincide, RelativeAngle
from refkin.model import Scene
from refkin.motion import Status

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


def closed_chain(tree: JointTree, scene: Scene) -> March:
    """Return the tree coordinates at all times of a scene.

    Raises
    ------
    EngineError
        If a joint that closes a loop is not a revolute, or a driver does not hold the joint by which a body hangs on
        the ground; the message names it.
    """
    chain = _Chain(tree)
    q = tree.start()
    levels = np.full((tree.width, len(scene.times)), np.nan)
    residual = np.full(len(scene.times), np.nan)
    status = [Status.NOT_CONVERGED] * len(scene.times)
    for k, t in enumerate(scene.times):
        pose, gap = chain.closed(q, t)
        if pose is not None:
            q, status[k], residual[k] = pose, Status.OK, gap
            levels[:, k] = q
    return March((levels,), tuple(status), residual)


class _Chain:
    """A tree with its constraints: the loops, then one per driver."""

    def __init__(self, tree: JointTree) -> None:
        self.tree = tree
        self.planar: PlanarModel = tree_model(tree)
        self.model, self.data = self.planar.model, self.planar.data
        self.drivers = [_Held(tree, element) for element in tree.driven]
        self.loops = [self._loop(element) for element in tree.closures]

    def _loop(self, e: Element) -> Any:
        if not isinstance(e, PointsCoincide):
            raise EngineRefusal(
                f"pinocchio refuses {e.key} of {e.name!r} on the route {CLOSED_CHAIN.name!r}: "
                "its RigidConstraintModel closes loops at points or frames"
            )
        ends = [self.planar.frames[body].at(self.tree.scaled(body, point)) for body, point in reversed(e.ends)]
        places = [x for end in ends for x in (end.joint, end.placement)]
        return pin.RigidConstraintModel(pin.ContactType.CONTACT_3D, self.model, *places)

    def closed(self, q: Array, t: float) -> tuple[Array | None, float]:
        """Return where the example's loop ends, None if it does not within its 100 steps, and the residual."""
        models = [*self.loops, *(held.constraint(self.model, t) for held in self.drivers)]
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
            value = np.concatenate([*self._values(datas)])
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

    def _values(self, datas: list[Any]) -> Iterator[Array]:
        for k, data in enumerate(datas):
            yield data.c1Mc2.translation if k < len(self.loops) else pin.log6(data.c1Mc2).vector


class _Held:
    """The coordinate by which a body hangs on the ground, held by a driver."""

    def __init__(self, tree: JointTree, element: Element) -> None:
        self.tree, self.element = tree, element
        self.joint, self.edge = self._joint()
        turning = isinstance(element, RelativeAngle) and element.body_i == GROUND
        sliding = isinstance(element, PointCoordinate)
        wanted = Freedom.TURN if turning else Freedom.SLIDE if sliding else None
        if self.edge.parent != GROUND or self.edge.freedom is not wanted:
            raise EngineRefusal(
                f"pinocchio refuses {element.key} of {element.name!r} on the route {CLOSED_CHAIN.name!r}: "
                "it holds no joint by which a body hangs on the ground"
            )

    def _joint(self) -> tuple[int, Edge]:
        """Return the joint by which the driven body hangs on another, and its edge."""
        joints = [(k + 1, edge) for k, edge in enumerate(_moving(self.tree)) if edge.body == self.element.bodies[1]]
        if not joints:
            raise EngineRefusal(
                f"pinocchio refuses {self.element.key} of {self.element.name!r}: its body is fixed to another"
            )
        return joints[0]

    def constraint(self, model: Any, t: float) -> Any:
        """Return the constraint that holds the joint's frame where the law has it at a time."""
        value = self._coordinate(float(self.element.laws[0](t)))
        place = model.jointPlacements[self.joint]
        moved = turn(unit_vector(value)) if self.edge.freedom is Freedom.TURN else self._shifted(value)
        ends = (self.joint, pin.SE3.Identity(), 0, place * moved)
        return pin.RigidConstraintModel(pin.ContactType.CONTACT_6D, model, *ends)

    def _shifted(self, value: float) -> Any:
        return shift((value * self.edge.axis[0], value * self.edge.axis[1]))

    def _coordinate(self, law: float) -> float:
        """Return the joint's coordinate at a value of the law."""
        if self.edge.freedom is Freedom.TURN:
            return law - self.tree.turned(self.edge)
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
            raise EngineRefusal(
                f"pinocchio refuses body {edge.body!r} on the route {CLOSED_CHAIN.name!r}: no joint ties it to the rest"
            )
        edges += [edge] * (edge.freedom is not Freedom.NONE)
    return edges
