"""What exudyn says of points and directions of its bodies.

Its body outputs give position, velocity and acceleration of any point. With the accelerations of the coordinates at
zero, as they are in a static solver, these accelerations are the parts that hold no qdd: what a drift term is made of.
What a drift term is made of is asked for while the model is built, and read at one state after the other; the terms
follow for all states at once. A vector of the plane is a complex number, or an array of them, one for each state.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from itertools import chain
from typing import Any

import exudyn as exu
import numpy as np

from crosscheck.engines import Array
from refkin.joints import GROUND, Pair, Unit

OUT = exu.OutputVariableType
ACCELERATION = OUT.Acceleration
ZERO = (0.0, 0.0)

Table = Sequence[Any] | Array
"""Numbers read from exudyn, in the order in which they were asked for, each a float or an array (B,) of B states."""
Jet = tuple[Any, Any, Any]
"""A vector of the plane, its rate, and its second derivative at qdd = 0."""


class Readings:
    """Outputs of exudyn's bodies, by the names of ours; points are given in metres, read in the model's unit."""

    def __init__(self, mbs: Any, bodies: Mapping[str, Any], unit: Unit) -> None:
        self.output, self.bodies, self.unit = mbs.GetObjectOutputBody, bodies, unit
        self._asked: dict[tuple[Any, ...], int] = {}
        self._calls: list[tuple[Any, Any, list[float]]] = []
        self._size = 0

    def now(self) -> list[Array]:
        """Return all that was asked for, at the present state: what `table` puts in order."""
        output = self.output
        return [output(*call) for call in self._calls]

    def table(self, states: Sequence[list[Array]]) -> Array:
        """Return what was read at B states as rows (size, B)."""
        read = list(chain.from_iterable(states))
        return np.concatenate(read).reshape(len(states), -1).T if read else np.zeros((0, len(states)))

    def local(self, body: str, point: Pair) -> list[float]:
        """Return a point of a body as exudyn wants it: in the model's unit, three components."""
        ox, oy = self.unit.origin if body == GROUND else ZERO
        return [(point[0] - ox) / self.unit.size, (point[1] - oy) / self.unit.size, 0.0]

    def _ask(self, kind: Any, body: str, point: Pair, size: int = 3) -> int:
        """Ask for an output of a body at a point and return its place in the table."""
        key = kind, body, point
        if key not in self._asked:
            self._asked[key], self._size = self._size, self._size + size
            self._calls.append((self.bodies[body], kind, self.local(body, point)))
        return self._asked[key]

    def vector(self, kind: Any, body: str, point: Pair) -> Callable[[Table], Any]:
        """Return what finds exudyn's position, velocity or acceleration of a point in a table."""
        if body == GROUND:
            x, y, _ = self.local(body, point)
            fixed = complex(x, y) if kind == OUT.Position else 0j
            return lambda table: fixed
        k = self._ask(kind, body, point)
        return lambda table: table[k] + 1j * table[k + 1]

    def spin(self, body: str) -> Callable[[Table], Any]:
        """Return what finds exudyn's angular velocity of a body."""
        if body == GROUND:
            return lambda table: 0.0
        k = self._ask(OUT.AngularVelocity, body, ZERO)
        return lambda table: table[k + 2]

    def direction(self, body: str, u: Pair) -> Callable[[Table], Any]:
        """Return what finds a body-fixed direction in the ground frame, by exudyn's rotation matrix."""
        x, y = u
        if body == GROUND:
            return lambda table: complex(x, y)
        k = self._ask(OUT.RotationMatrix, body, ZERO, 9)
        return lambda a: (a[k] * x + a[k + 1] * y) + 1j * (a[k + 3] * x + a[k + 4] * y)

    def direction_jet(self, body: str, u: Pair) -> Callable[[Table], Jet]:
        """Return what finds a body-fixed direction, its rate and its second derivative, as it turns with the body."""
        direction, spin = self.direction(body, u), self.spin(body)

        def jet(table: Table) -> Jet:
            n, w = direction(table), spin(table)
            return n, 1j * w * n, -w * w * n

        return jet

    def gap(self, e: Any) -> Callable[[Table], Jet]:
        """Return what finds d = r_j - r_i of an element between two points."""
        levels = [[self.vector(kind, *end) for end in e.ends] for kind in (OUT.Position, OUT.Velocity, ACCELERATION)]

        def jet(table: Table) -> Jet:
            x, v, a = (j(table) - i(table) for i, j in levels)
            return x, v, a

        return jet


def product_drift(a: Jet, b: Jet) -> Any:
    """Return -(a . b)'' at qdd = 0, which is -(a'' . b + 2 a' . b' + a . b'')."""
    return -(dot(a[2], b[0]) + 2.0 * dot(a[1], b[1]) + dot(a[0], b[2]))


def dot(a: Any, b: Any) -> Any:
    """Return the scalar product."""
    return a.real * b.real + a.imag * b.imag
