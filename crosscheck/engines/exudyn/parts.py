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

exudyn has no drift term of its own: gamma is put together from its point motions at qdd = 0 (`Readings`), by the rules
of differentiation for a difference, a product and a length. That last step is the adapter's.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from exudyn import itemInterface as item

from crosscheck.engines import Array
from crosscheck.engines.exudyn.readings import ACCELERATION, Readings, Table, dot, product_drift
from crosscheck.engines.frames import Form, Length, Linear, SineRow, direction, through_its_point
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

    They must not reach back to the exudyn system: it would own the function that owns it, and never be freed.

    Attributes
    ----------
    follows : bool
        Whether the time is the one that exudyn asks for, as in its time integration, not the one that was set.
    """

    follows = False

    def __init__(self) -> None:
        self.laws: list[tuple[Law, float, float]] = []
        self.values: list[Sequence[float]] = []
        self._known: tuple[float, int] = (math.nan, 0)
        self._least = 0
        self._table: dict[float, list[Sequence[float]]] = {}

    def add(self, law: Law, shift: float, size: float) -> int:
        """Take in a law, as (f - shift) / size, and return its number."""
        self.laws.append((law, shift, size))
        self.values.append((math.nan,) * 3)
        return len(self.laws) - 1

    def tabulate(self, times: Sequence[float], order: int) -> None:
        """Evaluate the laws at all times that will be asked for, with derivatives up to `order`; so at others, too."""
        self._least, self._table = order, {}
        self._add(np.array(times))

    def _add(self, times: Array) -> None:
        self._table.update(zip(times.tolist(), self._over(times, self._least).transpose(2, 0, 1).tolist(), strict=True))

    def over(self, times: Array, order: int) -> Array:
        """Return the laws with their derivatives up to `order`, or more, at times (B,): (laws, 3, B)."""
        if order > self._least:
            return self._over(times, order)
        asked = times.tolist()
        new = [t for t in asked if t not in self._table]
        if new:
            self._add(np.array(new))
        return np.reshape([self._table[t] for t in asked], (len(asked), len(self.laws), 3)).transpose(1, 2, 0)

    def _over(self, times: Array, order: int) -> Array:
        values = np.full((len(self.laws), 3, len(times)), math.nan)
        for rows, (law, shift, size) in zip(values, self.laws, strict=True):
            for i in range(order + 1):
                rows[i] = (law(times, i) - (0.0 if i else shift)) / size
        return values

    def at_rate(self, one: int) -> None:
        """Say that one law goes at a rate of 1 and all others stand still."""
        self._known = (math.nan, 0)
        self.values[:] = [(math.nan, float(k == one), math.nan) for k in range(len(self.laws))]

    def set(self, t: float, order: int) -> None:
        """Evaluate the laws and their derivatives up to `order`, unless that is what they say already.

        Higher derivatives become NaN.
        """
        if t == self._known[0] and order <= self._known[1]:
            return
        order = max(order, self._least)
        self._known = (t, order)
        if order == self._least and t in self._table:
            self.values[:] = self._table[t]
            return
        for k, (law, shift, size) in enumerate(self.laws):
            known = [(float(law(t, i)) - (0.0 if i else shift)) / size for i in range(order + 1)]
            self.values[k] = (*known, *(math.nan,) * (2 - order))
        if order == self._least:
            self._table[t] = list(self.values)

    def at(self, law: int, order: int, t: float) -> float:
        """Return what a law says at exudyn's own time t."""
        self.set(t, 1)
        return self.values[law][order]


@dataclass(frozen=True)
class ObjectRows:
    """One exudyn object, and the rows of a constraint that it holds.

    Attributes
    ----------
    first : int
        Which row of the constraint its first row is.
    maps : tuple of (factor, form)
        Per row how exudyn's follows from ours.
    powers : tuple of int
        Per row the power of length that it is measured in.
    drift : callable
        What was read (`Readings.now`), and value and derivatives of each law -> the object's rows of gamma.
    cylinder : int or None
        The law that the distance of a driven DistanceConstraint follows.
    """

    constraint: str
    item: Any
    first: int
    maps: tuple[tuple[float, Form], ...]
    powers: tuple[int, ...]
    drift: Callable[[Table, Any], Iterable[Any]]
    cylinder: int | None = None


class Builder:
    """Adds bodies, then joints and drivers, to an exudyn system; `blocks` is what came of it.

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
        self.blocks: list[ObjectRows] = []
        self.bodies = {GROUND: mbs.AddObject(item.ObjectGround())}
        self.nodes: dict[str, Any] = {}
        for body in bodies:
            self.nodes[body.name] = mbs.AddNode(item.NodeRigidBody2D())
            rigid = item.ObjectRigidBody2D(nodeNumber=self.nodes[body.name], mass=mass, inertia=mass)
            self.bodies[body.name] = mbs.AddObject(rigid)
        self.read = Readings(mbs, self.bodies, unit)
        still = mbs.AddNode(item.NodePointGround())
        self.still = mbs.AddMarker(item.MarkerNodeCoordinate(nodeNumber=still, coordinate=0))
        for constraint in constraints:
            elements = tuple(elements_of([constraint]))
            if is_slider(elements):
                _slider(self, *elements)
            else:
                for element in elements:
                    ADD[type(element)](self, element)

    def point(self, body: str, point: Pair) -> Any:
        """Return a marker at a point of a body."""
        marker = item.MarkerBodyPosition(bodyNumber=self.bodies[body], localPosition=self.read.local(body, point))
        return self.mbs.AddMarker(marker)

    def points(self, e: Any) -> list[Any]:
        """Return markers at the two points of an element."""
        return [self.point(body, point) for body, point in e.ends]

    def frame(self, body: str, point: Pair) -> Any:
        """Return a marker at a point of a body that turns with it."""
        marker = item.MarkerBodyRigid(bodyNumber=self.bodies[body], localPosition=self.read.local(body, point))
        return self.mbs.AddMarker(marker)

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

    one, other = (b.read.vector(ACCELERATION, *end) for end in e.ends)

    def drift(table: Table, laws: Sequence[Any]) -> Iterable[Any]:
        d = one(table) - other(table)
        return d.real, d.imag

    b.blocks.append(ObjectRows(e.name, joint, e.row, ((1.0, Linear()), (1.0, Linear())), (1, 1), drift))


def _guide(b: Builder, e: GuidedPoint, axis_j: Pair, rotation: bool) -> Any:
    """Add a PrismaticJoint2D with the guide on body i; `axis_j` is the axis in the frame of body j."""
    return b.mbs.AddObject(
        item.PrismaticJoint2D(
            markerNumbers=[b.frame(e.body_j, e.point_j), b.frame(e.body_i, e.point_i)],
            axisMarker0=[*axis_j, 0.0],
            normalMarker1=[*_normal(e), 0.0],
            constrainRotation=rotation,
        )
    )


def _across(b: Builder, e: GuidedPoint) -> Callable[[Table], Any]:
    """Return what finds gamma of exudyn's row -(n . d), n the normal of the axis on body i."""
    gap, normal = b.read.gap(e), b.read.direction_jet(e.body_i, _normal(e))
    return lambda table: -product_drift(gap(table), normal(table))


def _guided(b: Builder, e: GuidedPoint) -> None:
    e = through_its_point(e)
    joint, across = _guide(b, e, (1.0, 0.0), rotation=False), _across(b, e)
    b.blocks.append(ObjectRows(e.name, joint, e.row, ((-1.0, Linear()),), (1,), lambda table, laws: (across(table),)))


def _slider(b: Builder, e: Any, turned: Any) -> None:
    e = through_its_point(e)
    y, x = _normal(e)  # the axis is (x, -y)
    cos, sin = math.cos(turned.angle), math.sin(turned.angle)
    axis_j = (cos * x - sin * y, -sin * x - cos * y)
    joint, across = _guide(b, e, axis_j, rotation=True), _across(b, e)
    spins = [b.read.spin(body) for body in e.bodies]
    along, normal = b.read.direction(e.body_j, axis_j), b.read.direction(e.body_i, _normal(e))

    def drift(table: Table, laws: Sequence[Any]) -> Iterable[Any]:
        # Two unit vectors that turn with w against each other: (t . n)'' = -w^2 t . n.
        i, j = (spin(table) for spin in spins)
        return across(table), (j - i) ** 2 * dot(along(table), normal(table))

    b.blocks.append(ObjectRows(e.name, joint, e.row, ((-1.0, Linear()), (1.0, SineRow())), (1, 0), drift))


def _distance(b: Builder, e: PointDistance) -> None:
    law = b.law(e, size=b.unit.size) if e.laws else None
    length = e.length / b.unit.size if law is None else 1.0
    rod = b.mbs.AddObject(item.DistanceConstraint(markerNumbers=b.points(e), distance=length))
    gap = b.read.gap(e)

    def drift(table: Table, laws: Sequence[Any]) -> Iterable[Any]:
        d = gap(table)
        if law is not None:
            f, fd, fdd = laws[law]
            return (0.5 * product_drift(d, d) + fd * fd + f * fdd,)
        distance = abs(d[0])
        rate = dot(d[0], d[1]) / distance
        return ((0.5 * product_drift(d, d) + rate * rate) / distance,)  # |d| |d|'' + |d|'^2 = (d . d)'' / 2

    form, power = (Length(length), 1) if law is None else (Linear(), 2)
    b.blocks.append(ObjectRows(e.name, rod, e.row, ((1.0, form),), (power,), drift, cylinder=law))


def _angle(b: Builder, e: RelativeAngle) -> None:
    markers = [b.angle(body) for body in e.bodies]
    if e.laws:
        law = b.law(e)
        held = b.driven(markers, law)
        b.blocks.append(ObjectRows(e.name, held, e.row, ((1.0, Linear()),), (0,), lambda table, laws: (laws[law][2],)))
    else:
        held = b.mbs.AddObject(item.CoordinateConstraint(markerNumbers=markers, offset=e.angle))
        b.blocks.append(ObjectRows(e.name, held, e.row, ((1.0, Linear()),), (0,), lambda table, laws: (0.0,)))


def _wheels(b: Builder, e: RollingWheels) -> None:
    # exudyn's row: factor phi_j - phi_i - offset.
    factor = -e.radius_j / e.radius_i
    teeth = b.mbs.AddObject(
        item.CoordinateConstraint(
            markerNumbers=[b.angle(body) for body in e.bodies], factorValue1=factor, offset=factor * e.zero_j - e.zero_i
        )
    )
    b.blocks.append(
        ObjectRows(e.name, teeth, e.row, ((-b.unit.size / e.radius_i, Linear()),), (0,), lambda table, laws: (0.0,))
    )


def _coordinate(b: Builder, e: PointCoordinate) -> None:
    law = b.law(e, b.unit.origin[e.axis], b.unit.size)
    along = item.MarkerBodiesRelativeTranslationCoordinate(
        bodyNumbers=[b.bodies[GROUND], b.bodies[e.body_j]],
        localPosition1=b.read.local(e.body_j, e.point_j),
        axis0=[1.0 - e.axis, float(e.axis), 0.0],
    )
    actuator = b.driven([b.still, b.mbs.AddMarker(along)], law)
    acceleration = b.read.vector(ACCELERATION, e.body_j, e.point_j)

    def drift(table: Table, laws: Sequence[Any]) -> Iterable[Any]:
        a = acceleration(table)
        return (laws[law][2] - (a.imag if e.axis else a.real),)

    b.blocks.append(ObjectRows(e.name, actuator, e.row, ((1.0, Linear()),), (1,), drift))


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
