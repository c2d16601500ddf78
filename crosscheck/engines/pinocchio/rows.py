"""What Pinocchio says of the constraints of a planar model: residual, Jacobian, velocity and drift term, at B poses.

Pinocchio has no batch of forward kinematics: poses go through its calls one by one, in loops that do little else. Each
constraint is placed (`calc`) once a pose, after which both its residual and its Jacobian are read.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from itertools import chain, pairwise
from typing import Any, Protocol

import numpy as np
import pinocchio as pin

from crosscheck.engines import EngineRefusal
from crosscheck.engines.frames import direction, through_its_point
from crosscheck.engines.pinocchio.model import WORLD_AXES, PlacedFrame, PlanarModel, Points, Read, Scaling, unit_vector
from crosscheck.engines.tree.joint_tree import Array
from crosscheck.scenes.names import QUANTITIES
from refkin.joints import Element, GuidedPoint, PointsCoincide, RelativeAngle


class PinocchioRows(Protocol):
    """Rows of one of Pinocchio's constraints: what is read of it at a pose, in turn, and what that says of the rows.

    It is read `still` where the model is placed (slopes, then gaps or both places), `rates` where it moves, `bends`
    where nothing accelerates it. Constraint and data are Pinocchio's own.
    """

    count: int
    constraint: Any
    data: Any
    still: Sequence[Read]
    rates: Sequence[Read]
    bends: Sequence[Read]

    def closure(self, q: Array, slopes: Array, *places: Array) -> tuple[Array, Array]:
        """Return residuals (B, count) and Jacobians (B, count, nv) at q (B, nv), from what was read."""

    def change(self, *parts: Array) -> Array:
        """Return first or second derivatives (B, count) of the residuals, from what was read."""


class TwoPoints(PinocchioRows):
    """r_j - r_i, along the axes of the ground."""

    count = 2

    def __init__(self, planar: PlanarModel, i: PlacedFrame, j: PlacedFrame) -> None:
        model, data = planar.model, planar.data
        ends = (j.joint, j.placement, i.joint, i.placement)
        constraint = pin.RigidConstraintModel(pin.ContactType.CONTACT_3D, model, *ends, WORLD_AXES)
        of_pose = constraint.createData()
        calc, slopes = constraint.calc, pin.getConstraintJacobian
        at_j, at_i = of_pose.oMc1.translation, of_pose.oMc2.translation  # views: `calc` fills them
        self.constraint, self.data, self._nv = constraint, of_pose, model.nv

        def jacobian() -> Any:
            calc(model, data, of_pose)
            return slopes(model, data, constraint, of_pose)

        self.still = ((jacobian, planar.columns(3)), (at_j, (3,)), (at_i, (3,)))
        self.rates = ((planar.point_velocity(j), (3,)), (planar.point_velocity(i), (3,)))
        self.bends = ((planar.point_acceleration(j), (3,)), (planar.point_acceleration(i), (3,)))

    def closure(self, q: Array, slopes: Array, *places: Array) -> tuple[Array, Array]:
        return places[0][:, :2] - places[1][:, :2], slopes.reshape(len(q), 3, self._nv)[:, :2]

    def change(self, *parts: Array) -> Array:
        return parts[0][:, :2] - parts[1][:, :2]


class Anchor(PinocchioRows):
    """One component of an anchor constraint of so many: frame 2 as it is seen from frame 1."""

    count = 1
    component: int
    components: int
    kind: Any

    def __init__(self, planar: PlanarModel, i: PlacedFrame, j: PlacedFrame) -> None:
        model, data = planar.model, planar.data
        anchor = self.kind(model, i.joint, i.placement, j.joint, j.placement)
        of_pose = anchor.createData()
        calc, slopes, self._nv = anchor.calc, anchor.jacobian, model.nv
        self.constraint, self.data = anchor, of_pose
        gap, rate, bend = (  # views: `calc` fills them
            getattr(of_pose, f"constraint_{level}_error") for level in QUANTITIES
        )

        def jacobian() -> Any:
            calc(model, data, of_pose)
            return slopes(model, data, of_pose)

        def calculated(view: Any) -> Any:
            calc(model, data, of_pose)
            return view

        vector = (self.components,)
        self.still = ((jacobian, planar.columns(self.components)), (gap, vector))
        self.rates = ((lambda: calculated(rate), vector),)
        self.bends = ((lambda: calculated(bend), vector),)

    def closure(self, q: Array, slopes: Array, *places: Array) -> tuple[Array, Array]:
        return self._values(q, places[0]), slopes.reshape(len(q), self.components, self._nv)[:, self._slot]

    def change(self, *parts: Array) -> Array:
        return parts[0][:, self._slot]

    def _values(self, q: Array, gaps: Array) -> Array:
        return gaps[:, self._slot]

    @property
    def _slot(self) -> slice:
        return slice(self.component, self.component + 1)


class PointToLine(Anchor):
    """The distance of a point of body j from the x axis of a frame on body i."""

    component, components = 1, 3
    kind = pin.PointAnchorConstraintModel


class EqualAngles(Anchor):
    """The angle of body j against a frame on body i.

    Pinocchio's residual is log6 of the relative placement, which near a half turn is right to 1e-11 only; so the angle
    is read from the relative rotation. Like every rotation it knows no turns: those are taken from the coordinates.
    """

    component, components = 5, 6
    kind = pin.FrameAnchorConstraintModel

    def __init__(self, planar: PlanarModel, i: PlacedFrame, j: PlacedFrame, held: RelativeAngle) -> None:
        super().__init__(planar, i, j)
        angles = [
            planar.angle(held.body_j, q) - planar.angle(held.body_i, q) for q in np.eye(1 + planar.model.nv)[:, 1:]
        ]
        self._near, self._turns = angles[0] - held.angle, np.round(np.subtract(angles[1:], angles[0]))
        rotation = self.data.c1Mc2.rotation  # a view: `calc` fills it
        self.still = (self.still[0], (rotation[:2, 0], (2,)))

    def _values(self, q: Array, gaps: Array) -> Array:
        near = (self._near + q @ self._turns).tolist()
        angles = ((math.atan2(y, x), at) for (x, y), at in zip(gaps.tolist(), near, strict=True))
        return np.array([angle + math.tau * round((at - angle) / math.tau) for angle, at in angles])[:, None]


def _element_rows(planar: PlanarModel, e: Element, scaled: Scaling) -> PinocchioRows:
    """Return the rows of one element, in its own order; refuse one of another kind."""
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
        self._rows = [_element_rows(planar, element, scaled) for element in elements]
        ends = np.cumsum([0, *(row.count for row in self._rows)]).tolist()
        self.count, self._parts = ends[-1], [slice(a, b) for a, b in pairwise(ends)]
        self._work = dict[tuple[str, int, Points], Any]()

    def contacts(self) -> tuple[list[Any], list[Any]]:
        """Return Pinocchio's own constraints, and their data."""
        return [row.constraint for row in self._rows], [row.data for row in self._rows]

    def both(self, q: Array, points: Points) -> tuple[Array, Array, Array, Array]:
        """Return residual (B, count) and Jacobian (B, count, nv) at q (B, nv), points (B, P, 2) and their Jacobians."""
        count = len(q)
        kept, of_points, slopes, targets = self._kept("still", count, points, 1)
        self.planar.sampled(self.planar.place, (q,), targets)
        residual, jacobian = np.empty((count, self.count)), np.empty((count, self.count, self.planar.model.nv))
        for row, part, read in zip(self._rows, self._parts, kept, strict=True):
            residual[:, part], jacobian[:, part] = row.closure(q, *read)
        return residual, jacobian, *points.motion(of_points), slopes.copy()

    def velocity(self, q: Array, qd: Array, points: Points) -> Array:
        """Return the rates (B, count) of the residuals."""
        kept, *_, targets = self._kept("rates", len(q), points, 0)
        self.planar.sampled(self.planar.move, (q, qd), targets)
        return self._changes(kept, len(q))

    def drift(self, q: Array, qd: Array, points: Points) -> tuple[Array, ...]:
        """Return gamma (B, count), minus the second derivative of the residual at qdd = 0; and the motion of points.

        These are positions, velocities and, at qdd = 0, accelerations (B, P, 2).
        """
        kept, of_points, _, targets = self._kept("bends", len(q), points, 3)
        self.planar.sampled(self.planar.move, (q, qd), targets)
        return -self._changes(kept, len(q)), *points.motion(of_points)

    def _kept(self, what: str, count: int, points: Points, levels: int) -> Any:
        """Return arrays for what is read of each row and of points at so many poses, and the targets of both."""
        key = what, count, points
        if key not in self._work:
            reads = [getattr(row, what) for row in self._rows]
            kept = [[np.empty((count, *shape)) for _, shape in row] for row in reads]
            of_points, more = points.kept(count, levels)
            slopes, most = points.jacobians(count) if what == "still" else (None, [])
            pairs = zip(chain.from_iterable(reads), chain.from_iterable(kept), strict=True)
            targets = [*((read, out) for (read, _), out in pairs), *more, *most]
            self._work[key] = kept, of_points, slopes, targets
        return self._work[key]

    def _changes(self, kept: list[list[Array]], count: int) -> Array:
        out = np.empty((count, self.count))
        for row, part, read in zip(self._rows, self._parts, kept, strict=True):
            out[:, part] = row.change(*read)
        return out
