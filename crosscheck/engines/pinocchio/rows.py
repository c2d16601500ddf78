"""What Pinocchio says of the constraints of a planar model: residual, Jacobian, velocity and drift term, at B poses.

Pinocchio has no batch of forward kinematics: poses go through its calls one by one, in loops that do little else. Each
constraint is placed (`calc`) once a pose, after which both its residual and its Jacobian are read.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from itertools import pairwise
from typing import Any, Protocol

import numpy as np
import pinocchio as pin

from crosscheck.engines import EngineRefusal
from crosscheck.engines.frames import direction, through_its_point, unwrap_near
from crosscheck.engines.pinocchio.model import WORLD_AXES, Frame, PlanarModel, Scaling, unit_vector
from crosscheck.engines.tree.joint_tree import Array
from refkin.joints import Element, GuidedPoint, PointsCoincide, RelativeAngle


class Row(Protocol):
    """Rows of one of Pinocchio's constraints, read after `place` or `move` of the model."""

    count: int
    constraint: Any
    data: Any

    def read(self, q: Array, residual: Array, jacobian: Array) -> None:
        """Write the residual (count,) and its Jacobian (count, nv) where the model was placed."""

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
        self._j, self._i = (place.translation[:2] for place in (self.data.oMc1, self.data.oMc2))  # views: `calc` fills

    def read(self, q: Array, residual: Array, jacobian: Array) -> None:
        model, data = self.planar.model, self.planar.data
        self.constraint.calc(model, data, self.data)
        np.subtract(self._j, self._i, out=residual)
        jacobian[:] = self.planar.matrix(pin.getConstraintJacobian(model, data, self.constraint, self.data))[:2]

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
        self._slot = slice(self.component, self.component + 1)
        self._gap, self._rate, self._bend = (  # views: `calc` fills them
            getattr(self.data, f"constraint_{level}_error") for level in ("position", "velocity", "acceleration")
        )

    def read(self, q: Array, residual: Array, jacobian: Array) -> None:
        model, data = self.planar.model, self.planar.data
        self.constraint.calc(model, data, self.data)
        residual[0] = self._value(q)
        jacobian[:] = self.planar.matrix(self.constraint.jacobian(model, data, self.data))[self._slot]

    def velocity(self) -> Array:
        self.constraint.calc(self.planar.model, self.planar.data, self.data)
        return self._rate[self._slot].copy()

    def acceleration(self) -> Array:
        self.constraint.calc(self.planar.model, self.planar.data, self.data)
        return self._bend[self._slot].copy()

    def _value(self, q: Array) -> float:
        return float(self._gap[self.component])


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
        angles = [
            planar.angle(held.body_j, q) - planar.angle(held.body_i, q) for q in np.eye(1 + planar.model.nv)[:, 1:]
        ]
        self._near, self._turns = angles[0] - held.angle, np.round(np.subtract(angles[1:], angles[0]))
        self._rotation = self.data.c1Mc2.rotation  # a view: `calc` fills it

    def _value(self, q: Array) -> float:
        rotation = self._rotation
        return unwrap_near(math.atan2(rotation[1, 0], rotation[0, 0]), self._near + float(self._turns.dot(q)))


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
        raise EngineRefusal(f"pinocchio refuses {e.key} of {e.name!r}: it is not written for this element")
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
        ends = np.cumsum([0, *(row.count for row in self._rows)]).tolist()
        self.count, self._parts = ends[-1], [slice(a, b) for a, b in pairwise(ends)]

    def contacts(self) -> tuple[list[Any], list[Any]]:
        """Return Pinocchio's own constraints, and their data."""
        return [row.constraint for row in self._rows], [row.data for row in self._rows]

    def both(self, q: Array, points: Sequence[Frame] = ()) -> tuple[Array, Array, Array, Array]:
        """Return residual (B, count) and Jacobian (B, count, nv) at q (B, nv), points (B, P, 2) and their Jacobians."""
        nv = self.planar.model.nv
        residual, jacobian = np.empty((len(q), self.count)), np.empty((len(q), self.count, nv))
        r, slopes = np.empty((len(q), len(points), 2)), np.empty((len(q), len(points), 2, nv))
        rows = list(zip(self._rows, self._parts, strict=True))
        for at, value, slope, *read in zip(q, residual, jacobian, r, slopes, strict=True):
            self.planar.place(at)
            for row, part in rows:
                row.read(at, value[part], slope[part])
            for k, frame in enumerate(points):
                read[0][k], read[1][k] = self.planar.point(frame), self.planar.point_jacobian(frame)
        return residual, jacobian, r, slopes

    def velocity(self, q: Array, qd: Array) -> Array:
        """Return the rates (B, count) of the residuals."""
        out = np.empty((len(q), self.count))
        for at, rate, velocity in zip(q, qd, out, strict=True):
            self.planar.move(at, rate)
            for row, part in zip(self._rows, self._parts, strict=True):
                velocity[part] = row.velocity()
        return out

    def drift(self, q: Array, qd: Array, points: Sequence[Frame] = ()) -> tuple[Array, Array]:
        """Return gamma (B, count), minus the second derivative of the residual at qdd = 0, and that of points."""
        out, bends = np.empty((len(q), self.count)), np.empty((len(q), len(points), 2))
        for at, rate, acceleration, bend in zip(q, qd, out, bends, strict=True):
            self.planar.move(at, rate)
            for row, part in zip(self._rows, self._parts, strict=True):
                acceleration[part] = row.acceleration()
            for k, frame in enumerate(points):
                bend[k] = self.planar.point_acceleration(frame)
        return -out, bends
