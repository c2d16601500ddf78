"""The elements of joints and drivers as exudyn objects, and how exudyn's rows map onto ours.

Everything is built from the numbers of the scene (points, axes, lengths, laws):

===================== ========================================================= =====================================
element               exudyn                                                    exudyn's rows
===================== ========================================================= =====================================
points coincide       RevoluteJoint2D [i, j]                                    +, +
point on line         PrismaticJoint2D [j, i], constrainRotation=False          - (its second row is empty)
the same, and a fixed PrismaticJoint2D [j, i], normal on i                      -, sine of ours
angle of its bodies
distance              DistanceConstraint                                        |d| - L
distance by a law     DistanceConstraint, its distance set anew at each time    |d| - f(t), made ours by the model
angle                 CoordinateConstraint [phi_i, phi_j]                       +
rolling wheels        CoordinateConstraint [phi_i, phi_j] with a factor         ours / -radius_i
coordinate by a law   CoordinateConstraint on a relative translation marker     +
===================== ========================================================= =====================================

exudyn has no drift term of its own: gamma is put together from its point motions at qdd = 0 (`Readings`). That last
step is the adapter's.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from typing import Any

import numpy as np
from exudyn import itemInterface as item

from crosscheck.engines import Array
from crosscheck.engines.exudyn.readings import ORIGIN, ExudynRow, Readings
from crosscheck.engines.frames import Length, Linear, SineRow, direction, through_its_point
from crosscheck.engines.poses import Tabulated
from refkin.joints import (
    GROUND,
    Constraint,
    Element,
    GuidedPoint,
    Pair,
    PointCoordinate,
    PointDistance,
    PointsCoincide,
    RelativeAngle,
    RollingWheels,
    Unit,
    elements_of,
)
from refkin.model import Body
from refkin.motion_laws import Law


class Clock:
    """What the laws say at the present time: all that exudyn's user functions see.

    They must not reach back to the exudyn system: it would own the function that owns it, and never be freed. If it
    `follows`, the time is the one that exudyn asks for, as in its time integration, not the one that was set.
    """

    follows = False

    def __init__(self) -> None:
        self.laws: list[Tabulated] = []
        self.values: list[Sequence[float]] = []
        self._known: tuple[float, int] = (math.nan, 0)
        self._table: dict[float, Sequence[Sequence[float]]] = {}
        self._tabulated = 0

    def add(self, law: Law, shift: float, size: float) -> int:
        """Take in a law, as (f - shift) / size, and return its number."""
        self.laws.append(Tabulated(lambda t, order: (law(t, order) - (0.0 if order else shift)) / size))
        self.values.append((math.nan,) * 3)
        return len(self.laws) - 1

    def tabulate(self, times: Sequence[float], order: int) -> None:
        """Evaluate the laws at all times that will be asked for, with derivatives up to `order`."""
        self.laws = [Tabulated(known.law, times) for known in self.laws]
        values = self.over(np.array(times), order).transpose(2, 0, 1).tolist()
        self._table, self._tabulated = dict(zip(times, values, strict=True)), order

    def over(self, times: Array, order: int) -> Array:
        """Return the laws with their derivatives up to `order` at times (B,): (laws, 3, B), NaN beyond it."""
        values = np.full((len(self.laws), 3, len(times)), math.nan)
        for rows, law in zip(values, self.laws, strict=True):
            for i in range(order + 1):
                rows[i] = law(times, i)
        return values

    def at_rate(self, one: int) -> None:
        """Say that one law goes at a rate of 1 and all others stand still."""
        self._known = (math.nan, 0)
        self.values[:] = [(math.nan, float(k == one), math.nan) for k in range(len(self.laws))]

    def set(self, t: float, order: int) -> None:
        """Evaluate the laws and their derivatives up to `order`, unless that is what they say already.

        Derivatives beyond that, and beyond those of a table, are NaN.
        """
        if t == self._known[0] and order <= self._known[1]:
            return
        if order <= self._tabulated and t in self._table:
            self._known, self.values[:] = (t, self._tabulated), self._table[t]
            return
        self._known, beyond = (t, order), (math.nan,) * (2 - order)
        self.values[:] = [(*(law(t, i) for i in range(order + 1)), *beyond) for law in self.laws]

    def at(self, law: int, order: int, t: float) -> float:
        """Return what a law says at exudyn's own time t."""
        self.set(t, 1)
        return self.values[law][order]


class Builder:
    """Adds bodies, then joints and drivers, to an exudyn system; `rows` is what came of it.

    Each body is a NodeRigidBody2D with reference coordinates zero, so that exudyn's coordinates are x, y, phi.
    """

    def __init__(
        self,
        mbs: Any,
        bodies: Sequence[Body],
        constraints: Sequence[Constraint],
        unit: Unit,
        clock: Clock,
        mass: float = 0.0,
    ) -> None:
        self.mbs, self.unit, self.clock = mbs, unit, clock
        self.rows: list[ExudynRow] = []
        self.bodies = {GROUND: mbs.AddObject(item.ObjectGround())}
        self.nodes: dict[str, Any] = {}
        for body in bodies:
            self.nodes[body.name] = mbs.AddNode(item.NodeRigidBody2D())
            rigid = item.ObjectRigidBody2D(nodeNumber=self.nodes[body.name], mass=mass, inertia=mass)
            self.bodies[body.name] = mbs.AddObject(rigid)
        self.read = Readings(mbs, self.bodies)
        still = mbs.AddNode(item.NodePointGround())
        self.still = mbs.AddMarker(item.MarkerNodeCoordinate(nodeNumber=still, coordinate=0))
        for constraint in constraints:
            elements = tuple(elements_of([constraint]))
            if is_slider(elements):
                _slider(self, *elements)
            else:
                for element in elements:
                    ADD[type(element)](self, element)

    def add(self, e: Element, number: Any, **more: Any) -> None:
        """Take in a row of an element as a row of an exudyn object."""
        ends = tuple((body, self.local(body, point)) for body, point in e.ends)
        self.rows.append(ExudynRow(**{"name": e.name, "row": e.row, "item": number, "ends": ends, **more}))
        self.read.ask(self.rows[-1])

    def local(self, body: str, point: Pair) -> tuple[float, float, float]:
        """Return a point of a body [m] as exudyn has it: in the model's unit, three components."""
        ox, oy = self.unit.origin if body == GROUND else (0.0, 0.0)
        return (point[0] - ox) / self.unit.size, (point[1] - oy) / self.unit.size, 0.0

    def points(self, e: Any, kind: Any = item.MarkerBodyPosition) -> list[Any]:
        """Return markers at the two points of an element."""
        places = [(self.bodies[body], list(self.local(body, point))) for body, point in e.ends]
        return [self.mbs.AddMarker(kind(bodyNumber=body, localPosition=u)) for body, u in places]

    def angle(self, body: str) -> Any:
        """Return a marker on the angle of a body; for the ground on a coordinate that stays zero."""
        if body == GROUND:
            return self.still
        return self.mbs.AddMarker(item.MarkerNodeCoordinate(nodeNumber=self.nodes[body], coordinate=2))

    def law(self, e: Element, shift: float = 0.0, size: float = 1.0) -> int:
        """Take an element's law into the clock and return its number."""
        (law,) = e.laws
        return self.clock.add(law, shift, size)

    def driven(self, markers: list[Any], law: int) -> Any:
        """Add a CoordinateConstraint: the second marker's coordinate minus the first's follows a law."""
        clock, at, values = self.clock, self.clock.at, self.clock.values
        return self.mbs.AddObject(
            item.CoordinateConstraint(
                markerNumbers=markers,
                offsetUserFunction=lambda mbs, t, number, offset: at(law, 0, t) if clock.follows else values[law][0],
                # Without this one exudyn silently takes the rate of the driver as zero.
                offsetUserFunction_t=lambda mbs, t, number, offset: at(law, 1, t) if clock.follows else values[law][1],
            )
        )


def is_slider(elements: Sequence[Element]) -> bool:
    """Return whether a joint is one that exudyn has whole: a guided point, and a fixed angle between its bodies."""
    if tuple(map(type, elements)) != (GuidedPoint, RelativeAngle):
        return False
    return not elements[1].laws and elements[0].bodies == elements[1].bodies


def _coincide(b: Builder, e: PointsCoincide) -> None:
    joint = b.mbs.AddObject(item.RevoluteJoint2D(markerNumbers=b.points(e)))
    for k in range(2):
        b.add(e, joint, row=e.row + k, own=k, what="d", component=k)


def _guide(b: Builder, e: GuidedPoint, axis_j: Pair, rotation: bool) -> Any:
    """Add a PrismaticJoint2D with the guide on body i; `axis_j` is the axis in the frame of body j."""
    joint = b.mbs.AddObject(
        item.PrismaticJoint2D(
            markerNumbers=b.points(e, item.MarkerBodyRigid)[::-1],
            axisMarker0=[*axis_j, 0.0],
            normalMarker1=[*_normal(e), 0.0],
            constrainRotation=rotation,
        )
    )
    b.add(e, joint, what="along", axes=(np.array([*_normal(e), 0.0]),), factor=-1.0)
    return joint


def _guided(b: Builder, e: GuidedPoint) -> None:
    _guide(b, through_its_point(e), (1.0, 0.0), rotation=False)


def _slider(b: Builder, e: Any, turned: Any) -> None:
    e = through_its_point(e)
    y, x = _normal(e)  # the axis is (x, -y)
    cos, sin = math.cos(turned.angle), math.sin(turned.angle)
    axis_j = (cos * x - sin * y, -sin * x - cos * y)
    joint, axes = _guide(b, e, axis_j, rotation=True), (np.array([*_normal(e), 0.0]), np.array([*axis_j, 0.0]))
    b.add(e, joint, row=e.row + 1, own=1, what="sine", axes=axes, form=SineRow(), power=0)


def _distance(b: Builder, e: PointDistance) -> None:
    law = b.law(e, size=b.unit.size) if e.laws else None
    length = e.length / b.unit.size if law is None else 1.0
    rod = b.mbs.AddObject(item.DistanceConstraint(markerNumbers=b.points(e), distance=length))
    form, power = (Length(length), 1) if law is None else (Linear(), 2)
    b.add(e, rod, what="length", form=form, power=power, law=law)


def _angle(b: Builder, e: RelativeAngle) -> None:
    markers, law = [b.angle(body) for body in e.bodies], b.law(e) if e.laws else None
    if law is None:
        held = b.mbs.AddObject(item.CoordinateConstraint(markerNumbers=markers, offset=e.angle))
    else:
        held = b.driven(markers, law)
    b.add(e, held, power=0, law=law, ends=())


def _wheels(b: Builder, e: RollingWheels) -> None:
    # exudyn's row: factor phi_j - phi_i - offset.
    factor = -e.radius_j / e.radius_i
    teeth = b.mbs.AddObject(
        item.CoordinateConstraint(
            markerNumbers=[b.angle(e.body_i), b.angle(e.body_j)], factor1=factor, offset=factor * e.zero_j - e.zero_i
        )
    )
    b.add(e, teeth, factor=-b.unit.size / e.radius_i, power=0, ends=())


def _coordinate(b: Builder, e: PointCoordinate) -> None:
    law = b.law(e, b.unit.origin[e.axis], b.unit.size)
    end = e.body_j, b.local(e.body_j, e.point_j)
    along = item.MarkerBodiesRelativeTranslationCoordinate(
        bodyNumbers=[b.bodies[GROUND], b.bodies[e.body_j]],
        localPosition1=list(end[1]),
        axis0=[1.0 - e.axis, float(e.axis), 0.0],
    )
    actuator = b.driven([b.still, b.mbs.AddMarker(along)], law)
    b.add(e, actuator, what="d", component=e.axis, ends=((GROUND, ORIGIN), end), law=law)


ADD: dict[type[Element], Callable[[Builder, Any], None]] = {
    PointsCoincide: _coincide,
    GuidedPoint: _guided,
    PointDistance: _distance,
    PointCoordinate: _coordinate,
    RelativeAngle: _angle,
    RollingWheels: _wheels,
}
"""What exudyn can express, and how."""


def _normal(e: GuidedPoint) -> Pair:
    """Return the unit normal of the axis on body i, a quarter turn counter-clockwise from it."""
    x, y = direction(e.axis_i)
    return -y, x
