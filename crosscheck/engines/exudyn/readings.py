"""What exudyn says of points and axes of its bodies, in the plane and in space, and what drift terms are made of.

Its body outputs give position, velocity and acceleration of any point. With the accelerations of the coordinates at
zero, as they are in a static solver, these accelerations are the parts that hold no qdd: what a drift term is made of.
What a row is made of is asked for while the model is built, and read at one state after the other; the terms follow for
all states at once. A vector is an array (3,) or (B, 3).
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import exudyn as exu
import numpy as np

from crosscheck.engines.frames import Form, Linear
from refkin.joints import GROUND

Array = Any
LINEAR = Linear()
OUT = exu.OutputVariableType
OF_BODY, OF_POINT = (OUT.RotationMatrix, OUT.AngularVelocity), (OUT.Position, OUT.Velocity, OUT.Acceleration)
ORIGIN = (0.0, 0.0, 0.0)
KINDS = {"d": OF_POINT[2:], "along": OF_BODY + OF_POINT, "length": OF_POINT, "dot": OF_BODY, "sine": OF_BODY}
"""What a row says -> what is read of either of its bodies."""
End = tuple[str, tuple[float, float, float]]
"""A body and a point of it in the model's unit."""
Jet = tuple[Array, Array, Array]
"""A vector, its rate, and its second derivative at qdd = 0."""


@dataclass(frozen=True, kw_only=True)
class ExudynRow:
    """A row of ours as row `own` of an exudyn object.

    Attributes
    ----------
    row : int
        Which row of the constraint it is.
    what : str
        With d = r_j - r_i and an axis on each body: a component of d ("d", `component`), axis_i . d ("along"),
        axis_i . axis_j ("dot"; "sine" where both axes lie in the plane), |d| ("length"), or "" of angles alone.
    factor, form, power : float, Form, int
        How exudyn's row follows from ours, and the power of length that it is measured in.
    law : int or None
        The number of the law that moves it; of a "length" it is the distance.
    """

    name: str
    row: int
    item: Any
    own: int = 0
    what: str = ""
    component: int = 0
    ends: tuple[End, ...] = ()
    axes: tuple[Any, ...] = ()
    factor: float = 1.0
    form: Form = LINEAR
    power: int = 1
    law: int | None = None


class Readings:
    """Outputs of exudyn's bodies, by the names of ours, at points in the model's unit."""

    def __init__(self, mbs: Any, bodies: Mapping[str, Any]) -> None:
        self._output, self._bodies = mbs.GetObjectOutputBody, bodies
        self._calls: dict[tuple[Any, ...], tuple[Any, ...]] = {}
        self._slots: dict[tuple[Any, ...], slice] = {}
        self._read: dict[tuple[Any, ...], Array] = {}
        self._all, self._width = np.zeros((0, 3)), 0

    def ask(self, row: ExudynRow) -> None:
        """Ask for what a row's second derivative is made of."""
        for body, u in row.ends:
            for kind in KINDS[row.what] if body != GROUND else ():
                point = ORIGIN if kind in OF_BODY else u
                if (body, kind, point) not in self._calls:
                    self._calls[body, kind, point] = self._bodies[body], kind, point
                    first, self._width = self._width, self._width + (9 if kind is OUT.RotationMatrix else 3)
                    self._slots[body, kind, point] = slice(first, self._width)

    def now(self) -> list[Array]:
        """Return all that was asked for, at the present state."""
        output = self._output
        return [output(*call) for call in self._calls.values()]

    def keep(self, states: Sequence[list[Array]]) -> None:
        """Take in what was read at B states, with zeros after it."""
        nothing, still = np.empty(0), np.zeros(3)
        parts = [part for state in states for part in (*state, still)]
        self._all = np.concatenate((nothing, *parts)).reshape(-1, self._width + 3)
        self._read = {call: self._all[:, slot] for call, slot in self._slots.items()}

    def ends(self, rows: Sequence[ExudynRow]) -> tuple[Array, Array]:
        """Return where `at` finds components "d" of the accelerations of either end of rows; of the ground zeros."""
        rest = slice(self._width, None)
        found = [
            [self._slots.get((b, OF_POINT[2], u), rest).start + row.component for b, u in row.ends] for row in rows
        ]
        i, j = np.array(found, int).reshape(-1, 2).T
        return i, j

    def at(self, places: Array) -> Array:
        """Return numbers (B, R) of all that was read, at such places (R,)."""
        return self._all.take(places, axis=1)

    def bend(self, row: ExudynRow, f: Sequence[Array]) -> Array:
        """Return the second derivative (B,) of what a row says at qdd = 0; f are its law and two derivatives, (B,)."""
        if row.what == "d":
            return self._gap(row.ends, 2)[:, row.component] - f[2]
        if row.what == "along":
            return product(self.gap(row.ends), self.axis(row.ends[0][0], row.axes[0])) - f[2]
        if row.what == "length":
            d = self.gap(row.ends)
            if row.law is not None:
                return 0.5 * product(d, d) - f[1] * f[1] - f[0] * f[2]
            length = np.sqrt(dot(d[0], d[0]))  # |d| |d|'' + |d|'^2 = (d . d)'' / 2
            return (0.5 * product(d, d) - (dot(d[0], d[1]) / length) ** 2) / length
        if not row.what:
            return -f[2]
        i, j = (self.axis(body, axis) for (body, _), axis in zip(row.ends, row.axes, strict=True))
        if row.what == "dot":
            return product(i, j)
        w = [self._of_body(body, OF_BODY[1]) for body, _ in row.ends]  # against each other they turn with w: -w^2 i . j
        return -((w[1] - w[0])[..., 2] ** 2) * dot(j[0], i[0])

    def gap(self, ends: Sequence[End]) -> Jet:
        """Return the vector from point to point."""
        return self._gap(ends, 0), self._gap(ends, 1), self._gap(ends, 2)

    def _gap(self, ends: Sequence[End], order: int) -> Array:
        still = np.zeros(3)
        places = [self._read.get((body, OF_POINT[order], u), still if order else np.array(u)) for body, u in ends]
        return places[1] - places[0]

    def axis(self, body: str, u: Array) -> Jet:
        """Return an axis (3,) or axes (B, 3) of a body, as it turns: n' = w x n, n'' = w (w . n) - w^2 n."""
        if body == GROUND:
            return u, np.zeros(3), np.zeros(3)
        w, turned = self._of_body(body, OF_BODY[1]), self._of_body(body, OF_BODY[0]).reshape(-1, 3, 3)
        n = np.sum(turned * u[..., None, :], axis=-1)
        return n, _cross(w, n), w * dot(w, n)[:, None] - dot(w, w)[:, None] * n

    def _of_body(self, body: str, kind: Any) -> Array:
        """Return what was read of a body; of the ground that it does not turn."""
        return self._read.get((body, kind, ORIGIN), np.zeros(3))


def product(a: Jet, b: Jet) -> Array:
    """Return (a . b)'' at qdd = 0, which is a'' . b + 2 a' . b' + a . b''."""
    return dot(a[2], b[0]) + 2.0 * dot(a[1], b[1]) + dot(a[0], b[2])


def dot(a: Array, b: Array) -> Array:
    """Return the scalar products."""
    return np.add.reduce(a * b, axis=-1)


def _cross(a: Array, b: Array) -> Array:
    """Return the vector products: of few vectors a call of NumPy's takes several times as long."""
    left, right = (1, 2, 0), (2, 0, 1)
    return a.take(left, axis=-1) * b.take(right, axis=-1) - a.take(right, axis=-1) * b.take(left, axis=-1)
