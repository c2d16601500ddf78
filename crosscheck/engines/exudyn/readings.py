"""What exudyn says of points and directions of its bodies at the present state.

Its body outputs give position, velocity and acceleration of any point. With the accelerations of the coordinates at
zero, as they are in a static solver, these accelerations are the parts that hold no qdd: what a drift term is made of.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from typing import Any

import exudyn as exu

from refkin.joints import GROUND, Pair, Unit

OUT = exu.OutputVariableType
ACCELERATION = OUT.Acceleration
ZERO = (0.0, 0.0)

Jet = tuple[Pair, Pair, Pair]
"""A vector of the plane, its rate, and its second derivative at qdd = 0."""


class Readings:
    """Outputs of exudyn's bodies, by the names of ours; points are given in metres, read in the model's unit."""

    def __init__(self, mbs: Any, bodies: Mapping[str, Any], unit: Unit) -> None:
        self.output, self.bodies, self.unit = mbs.GetObjectOutputBody, bodies, unit
        self._local: dict[tuple[str, Pair], list[float]] = {}

    def local(self, body: str, point: Pair) -> list[float]:
        """Return a point of a body as exudyn wants it: in the model's unit, three components."""
        known = self._local.get((body, point))
        if known is None:
            ox, oy = self.unit.origin if body == GROUND else ZERO
            known = [(point[0] - ox) / self.unit.size, (point[1] - oy) / self.unit.size, 0.0]
            self._local[body, point] = known
        return known

    def point_jet(self, body: str, point: Pair) -> Jet:
        """Return exudyn's position, velocity and acceleration of a point at the present state."""
        local = self.local(body, point)
        if body == GROUND:
            return (local[0], local[1]), ZERO, ZERO
        number = self.bodies[body]
        x, v, a = (self.output(number, kind, local).tolist() for kind in (OUT.Position, OUT.Velocity, ACCELERATION))
        return (x[0], x[1]), (v[0], v[1]), (a[0], a[1])

    def acceleration_of(self, body: str, point: Pair) -> Callable[[], Sequence[float]]:
        """Return what reads exudyn's acceleration (3,) of a point; exudyn itself gives none for the ground."""
        if body == GROUND:
            return lambda: (0.0, 0.0, 0.0)
        read, number, local = self.output, self.bodies[body], self.local(body, point)
        return lambda: read(number, ACCELERATION, local).tolist()

    def spin(self, body: str) -> float:
        """Return exudyn's angular velocity of a body."""
        if body == GROUND:
            return 0.0
        w: float = self.output(self.bodies[body], OUT.AngularVelocity).tolist()[2]
        return w

    def direction(self, body: str, u: Pair) -> Pair:
        """Return a body-fixed direction in the ground frame, by exudyn's rotation matrix."""
        if body == GROUND:
            return u
        a = self.output(self.bodies[body], OUT.RotationMatrix).tolist()
        return a[0] * u[0] + a[1] * u[1], a[3] * u[0] + a[4] * u[1]

    def direction_jet(self, body: str, u: Pair) -> Jet:
        """Return a body-fixed direction, its rate and its second derivative, as it turns with exudyn's body."""
        (x, y), w = self.direction(body, u), self.spin(body)
        return (x, y), (-w * y, w * x), (-w * w * x, -w * w * y)

    def gap(self, c: Any) -> Jet:
        """Return d = r_j - r_i of a constraint between two points."""
        x, v, a = zip(self.point_jet(c.body_i, c.point_i), self.point_jet(c.body_j, c.point_j), strict=True)
        return _step(*x), _step(*v), _step(*a)


def product_drift(a: Jet, b: Jet) -> float:
    """Return -(a . b)'' at qdd = 0, which is -(a'' . b + 2 a' . b' + a . b'')."""
    return -(dot(a[2], b[0]) + 2.0 * dot(a[1], b[1]) + dot(a[0], b[2]))


def _step(a: Pair, b: Pair) -> Pair:
    return b[0] - a[0], b[1] - a[1]


def dot(a: Pair, b: Pair) -> float:
    """Return the scalar product."""
    return a[0] * b[0] + a[1] * b[1]
