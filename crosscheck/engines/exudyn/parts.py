"""Joints and drivers as exudyn objects, and how exudyn's rows map onto ours.

Everything is built from the numbers of the scene (points, axes, lengths, laws):

=================== ========================================================= =====================================
ours                exudyn                                                    exudyn's rows
=================== ========================================================= =====================================
revolute            RevoluteJoint2D [i, j]                                    +, +
fixed               RevoluteJoint2D [i, j], CoordinateConstraint [phi_i, j]   +, +, +
prismatic           PrismaticJoint2D [j, i], normal on i                      -, sine of ours
point_on_line       the same with constrainRotation=False                     - (its second row is empty)
distance            DistanceConstraint                                        |d| - L
gear                CoordinateConstraint [phi_i, phi_j] with a factor         ours / -radius_i
angle driver        CoordinateConstraint [phi_i, phi_j]                       +
x, y driver         CoordinateConstraint on a relative translation marker     +
distance driver     DistanceConstraint, its distance set anew at each time    |d| - f(t), made ours by the model
=================== ========================================================= =====================================

exudyn has no drift term of its own: gamma is put together from its point motions at qdd = 0 (`Readings`), by the rules
of differentiation for a difference, a product and a length. That last step is the adapter's.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass
from typing import Any

from exudyn import itemInterface as item

from crosscheck.engines.exudyn.readings import Readings, dot, product_drift
from crosscheck.engines.frames import Form, Length, Linear, Sine
from refkin.joints import (
    GROUND,
    AngleDriver,
    Constraint,
    Distance,
    DistanceDriver,
    Fixed,
    Gear,
    Pair,
    PointOnLine,
    Prismatic,
    Revolute,
    Unit,
    XDriver,
    YDriver,
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
        self.values: list[tuple[float, ...]] = []
        self._known: tuple[float, int] = (math.nan, 0)

    def add(self, law: Law, shift: float, size: float) -> int:
        """Take in a law, as (f - shift) / size, and return its number."""
        self.laws.append((law, shift, size))
        self.values.append((math.nan,) * 3)
        return len(self.laws) - 1

    def set(self, t: float, order: int) -> None:
        """Evaluate the laws and their derivatives up to `order`, unless that is what they say already.

        Higher derivatives become NaN.
        """
        if t == self._known[0] and order <= self._known[1]:
            return
        self._known = (t, order)
        for k, (law, shift, size) in enumerate(self.laws):
            known = [(float(law(t, i)) - (0.0 if i else shift)) / size for i in range(order + 1)]
            self.values[k] = (*known, *(math.nan,) * (2 - order))

    def at(self, law: int, order: int, t: float) -> float:
        """Return what a law says when exudyn asks for it at its own time t."""
        if self.follows:
            self.set(t, 1)
        return self.values[law][order]


@dataclass(frozen=True)
class Block:
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
        Returns the object's rows of gamma at the present state.
    cylinder : int or None
        The law that the distance of a driven DistanceConstraint follows.
    """

    constraint: str
    item: Any
    first: int
    maps: tuple[tuple[float, Form], ...]
    powers: tuple[int, ...]
    drift: Callable[[], Iterable[float]]
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
        self.blocks: list[Block] = []
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
            ADD[type(constraint)](self, constraint)

    def point(self, body: str, point: Pair) -> Any:
        """Return a marker at a point of a body."""
        marker = item.MarkerBodyPosition(bodyNumber=self.bodies[body], localPosition=self.read.local(body, point))
        return self.mbs.AddMarker(marker)

    def points(self, c: Any) -> list[Any]:
        """Return markers at the two points of a constraint."""
        return [self.point(c.body_i, c.point_i), self.point(c.body_j, c.point_j)]

    def frame(self, body: str, point: Pair) -> Any:
        """Return a marker at a point of a body that turns with it."""
        marker = item.MarkerBodyRigid(bodyNumber=self.bodies[body], localPosition=self.read.local(body, point))
        return self.mbs.AddMarker(marker)

    def angle(self, body: str) -> Any:
        """Return a marker on the angle of a body; for the ground on a coordinate that stays zero."""
        if body == GROUND:
            return self.still
        return self.mbs.AddMarker(item.MarkerNodeCoordinate(nodeNumber=self.nodes[body], coordinate=2))

    def law(self, c: Any, shift: float = 0.0, size: float = 1.0) -> int:
        """Take a driver's law into the clock and return its number."""
        (law,) = c.laws
        return self.clock.add(law, shift, size)

    def driven(self, markers: list[Any], law: int) -> Any:
        """Add a CoordinateConstraint: the second marker's coordinate minus the first's follows a law."""
        at = self.clock.at
        return self.mbs.AddObject(
            item.CoordinateConstraint(
                markerNumbers=markers,
                offsetUserFunction=lambda mbs, t, number, offset: at(law, 0, t),
                # Without this one exudyn silently takes the rate of the driver as zero.
                offsetUserFunction_t=lambda mbs, t, number, offset: at(law, 1, t),
            )
        )


def _revolute(b: Builder, c: Any) -> None:
    joint = b.mbs.AddObject(item.RevoluteJoint2D(markerNumbers=b.points(c)))

    def drift() -> Iterable[float]:
        i, j = b.read.acceleration(c.body_i, c.point_i), b.read.acceleration(c.body_j, c.point_j)
        return i[0] - j[0], i[1] - j[1]

    b.blocks.append(Block(c.name, joint, 0, ((1.0, Linear()), (1.0, Linear())), (1, 1), drift))


def _fixed(b: Builder, c: Fixed) -> None:
    _revolute(b, c)
    markers = [b.angle(c.body_i), b.angle(c.body_j)]
    weld = b.mbs.AddObject(item.CoordinateConstraint(markerNumbers=markers, offset=c.angle))
    b.blocks.append(Block(c.name, weld, 2, ((1.0, Linear()),), (0,), lambda: (0.0,)))


def _guide(b: Builder, c: Any, axis_j: Pair, rotation: bool) -> Any:
    """Add a PrismaticJoint2D with the guide on body i; `axis_j` is the axis in the frame of body j."""
    return b.mbs.AddObject(
        item.PrismaticJoint2D(
            markerNumbers=[b.frame(c.body_j, c.point_j), b.frame(c.body_i, c.point_i)],
            axisMarker0=[*axis_j, 0.0],
            normalMarker1=[*_normal(c), 0.0],
            constrainRotation=rotation,
        )
    )


def _across(b: Builder, c: Any) -> float:
    """Return gamma of exudyn's row -(n . d), n the normal of the axis on body i."""
    return -product_drift(b.read.gap(c), b.read.direction_jet(c.body_i, _normal(c)))


def _point_on_line(b: Builder, c: PointOnLine) -> None:
    joint = _guide(b, c, (1.0, 0.0), rotation=False)
    b.blocks.append(Block(c.name, joint, 0, ((-1.0, Linear()),), (1,), lambda: (_across(b, c),)))


def _prismatic(b: Builder, c: Prismatic) -> None:
    y, x = _normal(c)  # the axis is (x, -y)
    cos, sin = math.cos(c.angle), math.sin(c.angle)
    axis_j = (cos * x - sin * y, -sin * x - cos * y)
    joint = _guide(b, c, axis_j, rotation=True)

    def drift() -> Iterable[float]:
        # Two unit vectors that turn with w against each other: (t . n)'' = -w^2 t . n.
        w = b.read.spin(c.body_j) - b.read.spin(c.body_i)
        return _across(b, c), w * w * dot(b.read.direction(c.body_j, axis_j), b.read.direction(c.body_i, _normal(c)))

    b.blocks.append(Block(c.name, joint, 0, ((-1.0, Linear()), (1.0, Sine())), (1, 0), drift))


def _distance(b: Builder, c: Distance) -> None:
    length = c.length / b.unit.size
    rod = b.mbs.AddObject(item.DistanceConstraint(markerNumbers=b.points(c), distance=length))

    def drift() -> Iterable[float]:
        d = b.read.gap(c)
        distance = math.hypot(*d[0])
        rate = dot(d[0], d[1]) / distance
        return ((0.5 * product_drift(d, d) + rate * rate) / distance,)  # |d| |d|'' + |d|'^2 = (d . d)'' / 2

    b.blocks.append(Block(c.name, rod, 0, ((1.0, Length(length)),), (1,), drift))


def _gear(b: Builder, c: Gear) -> None:
    # exudyn's row: factor phi_j - phi_i - offset.
    factor = -c.radius_j / c.radius_i
    teeth = b.mbs.AddObject(
        item.CoordinateConstraint(
            markerNumbers=[b.angle(c.body_i), b.angle(c.body_j)],
            factorValue1=factor,
            offset=factor * c.phi0_j - c.phi0_i,
        )
    )
    b.blocks.append(Block(c.name, teeth, 0, ((-b.unit.size / c.radius_i, Linear()),), (0,), lambda: (0.0,)))


def _distance_driver(b: Builder, c: DistanceDriver) -> None:
    law = b.law(c, size=b.unit.size)
    rod = b.mbs.AddObject(item.DistanceConstraint(markerNumbers=b.points(c), distance=1.0))

    def drift() -> Iterable[float]:
        d = b.read.gap(c)
        f, fd, fdd = b.clock.values[law]
        return (0.5 * product_drift(d, d) + fd * fd + f * fdd,)

    b.blocks.append(Block(c.name, rod, 0, ((1.0, Linear()),), (2,), drift, cylinder=law))


def _angle(b: Builder, c: AngleDriver) -> None:
    law = b.law(c)
    motor = b.driven([b.angle(c.relative_to), b.angle(c.body)], law)
    b.blocks.append(Block(c.name, motor, 0, ((1.0, Linear()),), (0,), lambda: (b.clock.values[law][2],)))


def _coordinate(b: Builder, c: Any, axis: int) -> None:
    law = b.law(c, b.unit.origin[axis], b.unit.size)
    along = item.MarkerBodiesRelativeTranslationCoordinate(
        bodyNumbers=[b.bodies[GROUND], b.bodies[c.body]],
        localPosition1=b.read.local(c.body, c.point),
        axis0=[1.0 - axis, float(axis), 0.0],
    )
    actuator = b.driven([b.still, b.mbs.AddMarker(along)], law)

    def drift() -> Iterable[float]:
        return (b.clock.values[law][2] - b.read.acceleration(c.body, c.point)[axis],)

    b.blocks.append(Block(c.name, actuator, 0, ((1.0, Linear()),), (1,), drift))


ADD: dict[type[Constraint], Callable[[Builder, Any], None]] = {
    Revolute: _revolute,
    Fixed: _fixed,
    Prismatic: _prismatic,
    PointOnLine: _point_on_line,
    Distance: _distance,
    Gear: _gear,
    AngleDriver: _angle,
    XDriver: lambda b, c: _coordinate(b, c, 0),
    YDriver: lambda b, c: _coordinate(b, c, 1),
    DistanceDriver: _distance_driver,
}
"""What exudyn can express, and how."""


def _normal(c: Any) -> Pair:
    """Return the unit normal of the axis on body i, a quarter turn counter-clockwise from it."""
    x, y = c.axis_i
    length = math.hypot(x, y)
    return -y / length, x / length
