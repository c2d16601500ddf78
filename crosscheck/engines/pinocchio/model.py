"""Pinocchio models of planar mechanisms, built from a scene's numbers, and the rows of Pinocchio's own constraints.

Two forms. Absolute: each body hangs on the universe by a chain PX, PY, RZ, so that Pinocchio's q is (x, y, phi) per
body. Tree: the joints of a `JointTree`. Both hold joints (in the tree: those left open) by the same constraint classes:

============== ========================================================= =============================================
rows           Pinocchio's constraint                                    what is read of it
============== ========================================================= =============================================
two points     `RigidConstraintModel` CONTACT_3D, LOCAL_WORLD_ALIGNED    oMc1 - oMc2 with frame 1 on body j: r_j - r_i
point on line  `PointAnchorConstraintModel`, frame 1 along the axis      the y component
equal angles   `FrameAnchorConstraintModel`, frame 1 turned by `angle`   the angle of c1Mc2, component 5 of the rates
============== ========================================================= =============================================

Chains, not `JointModelComposite` or `JointModelPlanar`: the one has wrong derivatives in 4.1, the other has body-fixed
velocities. Each constraint is placed anew (`calc`) after forward kinematics, as Pinocchio 4 no longer does so itself.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass
from typing import Any, Protocol

import numpy as np
import pinocchio as pin

from crosscheck.engines import EngineError
from crosscheck.engines.frames import direction, through_its_point, unwrap_near
from crosscheck.engines.tree.joint_tree import Array, Edge, Freedom, JointTree
from refkin.joints import GROUND, Element, GuidedPoint, Pair, PointsCoincide, RelativeAngle

WORLD_AXES = pin.LOCAL_WORLD_ALIGNED
Scaling = Callable[[str, Pair], Pair]


@dataclass(frozen=True)
class Frame:
    """A frame fixed to a joint of the model: the joint's id, and the frame's placement in the joint's."""

    joint: int
    placement: Any

    def at(self, u: Pair, direction: Pair = (1.0, 0.0)) -> Frame:
        """Return the frame at a point of this one, its x axis along a unit vector."""
        return Frame(self.joint, self.placement * shift(u) * turn(direction))


@dataclass
class PlanarModel:
    """A model, the frame of each body in it, and the angle of each body with its turns as a function of q."""

    model: Any
    frames: dict[str, Frame]
    angle: Callable[[str, Array], float]

    def __post_init__(self) -> None:
        self.model.gravity.setZero()  # no call of kinematics takes it; whoever makes another finds none
        self.data = self.model.createData()
        self._rest = np.zeros(self.model.nv)

    def place(self, q: Array) -> None:
        """Place everything at q, and the columns of the Jacobians."""
        pin.computeJointJacobians(self.model, self.data, q)

    def move(self, q: Array, qd: Array) -> None:
        """Place everything at q, moving with qd at qdd = 0: what is not given would stay as an earlier call left it."""
        pin.forwardKinematics(self.model, self.data, q, qd, self._rest)

    def point(self, frame: Frame) -> Array:
        """Return where a placed frame is, (2,)."""
        return (self.data.oMi[frame.joint] * frame.placement).translation[:2].copy()

    def point_jacobian(self, frame: Frame) -> Array:
        """Return the Jacobian (2, nv) of a placed frame's point."""
        if self.model.nv == 0:  # Pinocchio ends the process with a segmentation fault
            return np.zeros((2, 0))
        return self.matrix(pin.getFrameJacobian(self.model, self.data, frame.joint, frame.placement, WORLD_AXES))[:2]

    def matrix(self, found: Any) -> Array:
        """Return a Jacobian with its columns: Pinocchio hands over a single column as a vector, and none as nothing."""
        return found.reshape(-1, self.model.nv) if self.model.nv else np.zeros((6, 0))

    def point_velocity(self, frame: Frame) -> Array:
        """Return the velocity (2,) of a moving frame's point."""
        return pin.getFrameVelocity(self.model, self.data, frame.joint, frame.placement, WORLD_AXES).linear[:2]

    def point_acceleration(self, frame: Frame) -> Array:
        """Return the acceleration (2,) of a moving frame's point: the classical one, not Pinocchio's spatial one."""
        found = pin.getFrameClassicalAcceleration(self.model, self.data, frame.joint, frame.placement, WORLD_AXES)
        return found.linear[:2]


def shift(u: Pair) -> Any:
    """Return a translation in the plane."""
    return pin.SE3(np.eye(3), np.array([*u, 0.0]))


def turn(direction: Pair) -> Any:
    """Return the rotation in the plane that turns the x axis to a unit vector."""
    c, s = direction
    return pin.SE3(np.array([[c, -s, 0.0], [s, c, 0.0], [0.0, 0.0, 1.0]]), np.zeros(3))


def unit_vector(angle: float) -> Pair:
    """Return the unit vector at an angle to the x axis."""
    return math.cos(angle), math.sin(angle)


def absolute_model(bodies: Sequence[str]) -> PlanarModel:
    """Return the model whose q is (x, y, phi) of each body in turn."""
    model = pin.Model()
    frames = {GROUND: Frame(0, pin.SE3.Identity())}
    for body in bodies:
        frames[body] = Frame(_free_joint(model, body, frames[GROUND]), pin.SE3.Identity())
    columns = {body: 3 * k + 2 for k, body in enumerate(bodies)}
    return PlanarModel(model, frames, lambda body, q: 0.0 if body == GROUND else float(q[columns[body]]))


def tree_model(tree: JointTree) -> PlanarModel:
    """Return the model whose q is that of a joint tree."""
    model = pin.Model()
    frames = {GROUND: Frame(0, pin.SE3.Identity())}
    for edge in tree.edges:
        frames[edge.body] = _hang(model, edge, frames[edge.parent])
    return PlanarModel(model, frames, tree.angle)


def _hang(model: Any, edge: Edge, parent: Frame) -> Frame:
    """Add the joint of an edge and return the body's frame, which lies away from the joint's by the pin."""
    place = parent.at(edge.point, unit_vector(edge.angle))
    back = shift((-edge.pin[0], -edge.pin[1]))
    if edge.freedom is Freedom.NONE:
        return Frame(place.joint, place.placement * back)
    if edge.freedom is Freedom.FREE:
        return Frame(_free_joint(model, edge.body, place), back)
    if edge.freedom is Freedom.TURN:
        joint = pin.JointModelRZ()
    else:
        joint = pin.JointModelPrismaticUnaligned(np.array([*edge.axis, 0.0]))
    return Frame(model.addJoint(place.joint, joint, place.placement, edge.body), back)


def _free_joint(model: Any, body: str, place: Frame) -> int:
    joint, placement = place.joint, place.placement
    for kind in (pin.JointModelPX, pin.JointModelPY, pin.JointModelRZ):
        joint = model.addJoint(joint, kind(), placement, f"{body} {kind.__name__}")
        placement = pin.SE3.Identity()
    return int(joint)


class Row(Protocol):
    """Rows of one of Pinocchio's constraints, read after `place` or `move` of the model."""

    count: int
    constraint: Any
    data: Any

    def residual(self, q: Array) -> Array:
        """Return the residual (count,) where the model was placed."""

    def jacobian(self) -> Array:
        """Return its Jacobian (count, nv)."""

    def velocity(self) -> Array:
        """Return the residual's rate (count,) as the model moves."""

    def acceleration(self) -> Array:
        """Return the residual's second derivative (count,) as the model moves, without its acceleration."""


class TwoPoints:
    """r_j - r_i, along the axes of the ground."""

    count = 2

    def __init__(self, planar: PlanarModel, i: Frame, j: Frame) -> None:
        self.planar, self.i, self.j = planar, i, j
        ends = (j.joint, j.placement, i.joint, i.placement)
        self.constraint = pin.RigidConstraintModel(pin.ContactType.CONTACT_3D, planar.model, *ends, WORLD_AXES)
        self.data = self.constraint.createData()

    def residual(self, q: Array) -> Array:
        self.constraint.calc(self.planar.model, self.planar.data, self.data)
        return (self.data.oMc1.translation - self.data.oMc2.translation)[:2]

    def jacobian(self) -> Array:
        model, data = self.planar.model, self.planar.data
        self.constraint.calc(model, data, self.data)
        return self.planar.matrix(pin.getConstraintJacobian(model, data, self.constraint, self.data))[:2]

    def velocity(self) -> Array:
        return self.planar.point_velocity(self.j) - self.planar.point_velocity(self.i)

    def acceleration(self) -> Array:
        return self.planar.point_acceleration(self.j) - self.planar.point_acceleration(self.i)


class Anchor:
    """One component of an anchor constraint: frame 2 as it is seen from frame 1."""

    count = 1
    component: int
    kind: Any

    def __init__(self, planar: PlanarModel, i: Frame, j: Frame) -> None:
        self.planar = planar
        self.constraint = self.kind(planar.model, i.joint, i.placement, j.joint, j.placement)
        self.data = self.constraint.createData()

    def residual(self, q: Array) -> Array:
        return self._calculated().constraint_position_error[self._slot].copy()

    def jacobian(self) -> Array:
        data = self._calculated()
        return self.planar.matrix(self.constraint.jacobian(self.planar.model, self.planar.data, data))[self._slot]

    def velocity(self) -> Array:
        return self._calculated().constraint_velocity_error[self._slot].copy()

    def acceleration(self) -> Array:
        return self._calculated().constraint_acceleration_error[self._slot].copy()

    @property
    def _slot(self) -> slice:
        return slice(self.component, self.component + 1)

    def _calculated(self) -> Any:
        self.constraint.calc(self.planar.model, self.planar.data, self.data)
        return self.data


class PointToLine(Anchor):
    """The distance of a point of body j from the x axis of a frame on body i."""

    component = 1
    kind = pin.PointAnchorConstraintModel


class EqualAngles(Anchor):
    """The angle of body j against a frame on body i.

    Pinocchio's residual is log6 of the relative placement, which near a half turn is right to 1e-11 only; so the angle
    is read from the relative rotation. Like every rotation it knows no turns: those are taken from the coordinates.
    """

    component = 5
    kind = pin.FrameAnchorConstraintModel

    def __init__(self, planar: PlanarModel, i: Frame, j: Frame, held: RelativeAngle) -> None:
        super().__init__(planar, i, j)
        self.held = held

    def residual(self, q: Array) -> Array:
        rotation = self._calculated().c1Mc2.rotation
        angle, held = self.planar.angle, self.held
        near = angle(held.body_j, q) - angle(held.body_i, q) - held.angle
        return np.array([unwrap_near(math.atan2(rotation[1, 0], rotation[0, 0]), near)])


def element_rows(planar: PlanarModel, e: Element, scaled: Scaling) -> Row:
    """Return the rows of one element, in its own order.

    Raises
    ------
    EngineError
        If it is of another kind.
    """
    if isinstance(e, RelativeAngle) and not e.laws:
        frame_i, frame_j = (planar.frames[body] for body in e.bodies)
        return EqualAngles(planar, frame_i.at((0.0, 0.0), unit_vector(e.angle)), frame_j, e)
    if e.laws or not isinstance(e, PointsCoincide | GuidedPoint):
        raise EngineError(f"pinocchio refuses {e.key} of {e.name!r}: it is not written for this element")
    along = (1.0, 0.0)
    if isinstance(e, GuidedPoint):
        e, along = through_its_point(e), direction(e.axis_i)
    frame_i, frame_j = (planar.frames[body].at(scaled(body, point)) for body, point in e.ends)
    if isinstance(e, PointsCoincide):
        return TwoPoints(planar, frame_i, frame_j)
    return PointToLine(planar, frame_i.at((0.0, 0.0), along), frame_j)


class Rows:
    """The rows of several elements, stacked."""

    def __init__(self, planar: PlanarModel, elements: Sequence[Element], scaled: Scaling) -> None:
        self.planar = planar
        self._rows = [element_rows(planar, element, scaled) for element in elements]
        self.count = sum(row.count for row in self._rows)

    def contacts(self) -> tuple[list[Any], list[Any]]:
        """Return Pinocchio's own constraints, and their data."""
        return [row.constraint for row in self._rows], [row.data for row in self._rows]

    def residual(self, q: Array) -> Array:
        """Return the residual (count,)."""
        self.planar.place(q)
        return self._stacked(row.residual(q) for row in self._rows)

    def jacobian(self, q: Array) -> Array:
        """Return the Jacobian (count, nv)."""
        self.planar.place(q)
        return self._jacobian()

    def both(self, q: Array) -> tuple[Array, Array]:
        """Return residual and Jacobian, with everything placed once."""
        return self.residual(q), self._jacobian()

    def _jacobian(self) -> Array:
        return self._stacked((row.jacobian() for row in self._rows), self.planar.model.nv)

    def velocity(self, q: Array, qd: Array) -> Array:
        """Return the rate (count,) of the residual."""
        self.planar.move(q, qd)
        return self._stacked(row.velocity() for row in self._rows)

    def drift(self, q: Array, qd: Array) -> Array:
        """Return gamma (count,): minus the second derivative of the residual at qdd = 0."""
        self.planar.move(q, qd)
        return -self._stacked(row.acceleration() for row in self._rows)

    def _stacked(self, parts: Iterable[Array], *columns: int) -> Array:
        found, first = np.empty((self.count, *columns)), 0
        for row, part in zip(self._rows, parts, strict=True):
            found[first : first + row.count] = part
            first += row.count
        return found
