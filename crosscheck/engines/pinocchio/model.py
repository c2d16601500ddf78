"""Pinocchio models of planar mechanisms, built from a scene's numbers, and the rows of Pinocchio's own constraints.

The joints are those of a `JointTree`; a free body hangs on the universe by a chain PX, PY, RZ, so that Pinocchio's q is
(x, y, phi) of it. What a tree leaves open, or all joints where every body is free, is held by these constraints:

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
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import partial
from typing import Any

import numpy as np
import pinocchio as pin

from crosscheck.engines.tree.joint_tree import Array, Edge, Freedom, JointTree
from refkin.joints import GROUND, Pair

WORLD_AXES = pin.LOCAL_WORLD_ALIGNED
UNTURNED = np.eye(3)
Scaling = Callable[[str, Pair], Pair]
Read = tuple[Any, tuple[int, ...]]
"""What reads something where the model is, or a view that is filled by then, and its shape."""
Target = tuple[Any, Array]
"""The same, and where it goes: a row for each of B poses."""


@dataclass(frozen=True)
class PlacedFrame:
    """A frame fixed to a joint of the model: the joint's id, and the frame's placement in the joint's."""

    joint: int
    placement: Any

    def at(self, u: Pair, direction: Pair = (1.0, 0.0)) -> PlacedFrame:
        """Return the frame at a point of this one, its x axis along a unit vector."""
        placement = self.placement * shift(u)
        return PlacedFrame(self.joint, placement if direction == (1.0, 0.0) else placement * turn(direction))


@dataclass
class PlanarModel:
    """A model, the frame of each body in it, and the angle of each body with its turns as a function of q."""

    model: Any
    frames: dict[str, PlacedFrame]
    angle: Callable[[str, Array], float]

    def __post_init__(self) -> None:
        self.model.gravity.setZero()  # no call of kinematics takes it; whoever makes another finds none
        self._rest = np.zeros(self.model.nv)
        self.begin()

    def begin(self) -> None:
        """Make what Pinocchio writes to; once more for a model that was changed."""
        self.data = self.model.createData()
        self.known = [list(of_joints) for of_joints in (self.data.oMi, self.data.v, self.data.a)]

    def place(self, q: Array) -> None:
        """Place everything at q, and the columns of the Jacobians."""
        pin.computeJointJacobians(self.model, self.data, q)

    def move(self, q: Array, qd: Array, qdd: Array | None = None) -> None:
        """Place everything at q, moving with qd and qdd, or 0: what is not given would stay as it was left."""
        pin.forwardKinematics(self.model, self.data, q, qd, self._rest if qdd is None else qdd)

    def sampled(self, pose: Callable[..., None], given: Sequence[Array], targets: Sequence[Target]) -> None:
        """Read targets at B poses, one after the other, each into its row of the target's array.

        `pose`, which is `place` or `move`, is called with what is given, (B, nv) each.
        """
        views = [(read, out) for read, out in targets if not callable(read)]
        reads = [(read, out) for read, out in targets if callable(read)]
        for k, at in enumerate(zip(*given, strict=True)):
            pose(*at)
            for read, out in reads:
                out[k] = read()
            for view, out in views:
                out[k] = view

    def columns(self, rows: int) -> tuple[int, ...]:
        """Return the shape of a Jacobian: Pinocchio hands over a single column as a vector."""
        return (rows,) if self.model.nv == 1 else (rows, self.model.nv)

    def point_jacobian(self, frame: PlacedFrame) -> Callable[[], Array]:
        """Return what reads the Jacobian of a placed frame, its shape `columns(6)`."""
        if self.model.nv == 0:  # Pinocchio ends the process with a segmentation fault
            return partial(np.zeros, (6, 0))
        return partial(pin.getFrameJacobian, self.model, self.data, frame.joint, frame.placement, WORLD_AXES)

    def point_velocity(self, frame: PlacedFrame) -> Callable[[], Array]:
        """Return what reads the velocity (3,) of a moving frame's point."""
        return self._linear(pin.getFrameVelocity, frame)

    def point_acceleration(self, frame: PlacedFrame) -> Callable[[], Array]:
        """Return what reads the acceleration (3,) of a moving frame's point: the classical one, not the spatial one."""
        return self._linear(pin.getFrameClassicalAcceleration, frame)

    def _linear(self, motion: Callable[..., Any], frame: PlacedFrame) -> Callable[[], Array]:
        model, data, joint, placement = self.model, self.data, frame.joint, frame.placement
        return lambda: motion(model, data, joint, placement, WORLD_AXES).linear


class Points:
    """Points of frames at B poses, from the placements, velocities and accelerations of joints that Pinocchio has.

    Pinocchio states motions in the joint's own axes, the linear part first; reading a point's costs ten times as much.
    """

    def __init__(self, planar: PlanarModel, frames: Sequence[PlacedFrame] = ()) -> None:
        self._nv, self._columns = planar.model.nv, planar.columns(6)
        self._slopes = [planar.point_jacobian(frame) for frame in frames]
        joints = list(dict.fromkeys(frame.joint for frame in frames))
        self._joints = [joints.index(frame.joint) for frame in frames]
        self._u = np.array([frame.placement.translation[:2] for frame in frames]).reshape(-1, 2)
        placed, velocities, accelerations = ([of[joint] for joint in joints] for of in planar.known)
        self._views: list[tuple[tuple[int, ...], list[Any]]] = [  # what moves the model fills them
            ((3, 3), [joint.rotation for joint in placed]),
            ((3,), [joint.translation for joint in placed]),
            ((6,), [joint.vector for joint in velocities]),
            ((6,), [joint.vector for joint in accelerations]),
        ]

    def jacobians(self, count: int) -> tuple[Array, list[Target]]:
        """Return the Jacobians (B, P, 2, nv) of the points."""
        out = np.empty((count, len(self._slopes), *self._columns))
        return out.reshape(*out.shape[:2], 6, self._nv)[:, :, :2], [(s, out[:, k]) for k, s in enumerate(self._slopes)]

    def kept(self, count: int, levels: int) -> tuple[list[Array], list[Target]]:
        """Return arrays for what `motion` is made of, for as many levels as are wanted."""
        views = self._views[: levels + 1]
        out = [np.empty((count, len(joints), *shape)) for shape, joints in views]
        pairs = zip(views, out, strict=True)
        return out, [(view, kept[:, k]) for (_, joints), kept in pairs for k, view in enumerate(joints)]

    def motion(self, kept: Sequence[Array]) -> list[Array]:
        """Return positions, velocities and accelerations (B, P, 2), as many as were kept."""
        if not self._joints:
            return [np.empty((len(kept[0]), 0, 2)) for _ in kept[1:]]
        rotations, *known = (of_joints[:, self._joints] for of_joints in kept)
        own = [np.broadcast_to(self._u, known[0][..., :2].shape)]
        own += [motion[..., :2] + motion[..., 5:] * _turned(own[0]) for motion in known[1:]]
        if len(own) > 2:
            own[2] += known[1][..., 5:] * _turned(own[1])
        levels = [(rotations[..., :2, :2] @ level[..., None])[..., 0] for level in own]
        levels[0] += known[0][..., :2]
        return levels


def _turned(vectors: Array) -> Array:
    """Return vectors (..., 2) turned by a quarter."""
    return vectors[..., ::-1] * (-1.0, 1.0)


def shift(u: Pair) -> Any:
    """Return a translation in the plane."""
    return pin.SE3(UNTURNED, np.array([*u, 0.0]))


def turn(direction: Pair) -> Any:
    """Return the rotation in the plane that turns the x axis to a unit vector."""
    c, s = direction
    return pin.SE3(np.array([[c, -s, 0.0], [s, c, 0.0], [0.0, 0.0, 1.0]]), np.zeros(3))


def unit_vector(angle: float) -> Pair:
    """Return the unit vector at an angle to the x axis."""
    return math.cos(angle), math.sin(angle)


def tree_model(tree: JointTree) -> PlanarModel:
    """Return the model whose q is that of a joint tree."""
    model = pin.Model()
    frames = {GROUND: PlacedFrame(0, pin.SE3.Identity())}
    for edge in tree.edges:
        frames[edge.body] = _hang(model, edge, frames[edge.parent])
    return PlanarModel(model, frames, tree.angle)


def _hang(model: Any, edge: Edge, parent: PlacedFrame) -> PlacedFrame:
    """Add the joint of an edge and return the body's frame, which lies away from the joint's by the pin."""
    place = parent.at(edge.point, unit_vector(edge.angle))
    joint, placement = place.joint, place.placement
    for kind in _joints(edge):
        joint = model.addJoint(joint, kind, placement, f"{edge.body} {model.njoints}")
        placement = pin.SE3.Identity()
    back = shift((-edge.pin[0], -edge.pin[1]))
    return PlacedFrame(joint, back if edge.freedom is not Freedom.NONE else placement * back)


def _joints(edge: Edge) -> list[Any]:
    if edge.freedom is Freedom.SLIDE:
        return [pin.JointModelPrismaticUnaligned(np.array([*edge.axis, 0.0]))]
    free = [pin.JointModelPX(), pin.JointModelPY()] * (edge.freedom is Freedom.FREE)
    return [*free, *[pin.JointModelRZ()] * (edge.freedom in (Freedom.TURN, Freedom.FREE))]
