"""An engine's own rows of space where nothing is assembled: every body free, columns (v, w): a `ConstraintModel`.

Lengths are metres of the scene. Of the joints only what the engine holds by constraints of its own is here: two points
that are one (`SpaceEngine.pairs`), and where the engine has it the rotations of a weld (`WeldEngine.welded`), which are
half-angle rows.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import Any

import numpy as np

from crosscheck.engines import Level, Term
from crosscheck.engines.frames import RowMap
from crosscheck.engines.spatial.reading import AXIAL, MEETING, Hold, Numbers, numbers_of
from crosscheck.engines.spatial.system import Place
from crosscheck.engines.spatial.tree import absolute_tree
from crosscheck.engines.spatial.turning import matrix
from refkin.joints import SI, Constraint
from refkin.model import Mechanism

Array = Any
WHOLE = ("prismatic", "fixed")
"""Joints that do not turn: of their weld all three rotations are rows, else the first two."""
SPATIAL_VECTORS = tuple(
    Term(
        name="spatial vectors",
        level=level.value,
        reason="lever arms are differences of positions in the ground frame, and omega x v enters with both signs: "
        "8 roundings, two bodies",
        relative=16.0 * 2.0**-53,
    )
    for level in (Level.JACOBIAN, Level.CONSTRAINT_VELOCITY, Level.DRIFT)
)
"""What an engine adds to rows that composes spatial vectors in the ground frame."""


class SpaceRows:
    """An engine's rows for some joints of a mechanism.

    Parameters
    ----------
    build : callable
        As for `SpaceSystem`.
    welds : float or None
        What the engine's rotation rows of a weld are of the half-angle rows, up to the sign of the Euler parameters;
        None if it has no weld.
    """

    owns_driver = False
    form = "half"

    def __init__(
        self, mechanism: Mechanism, joints: Sequence[Constraint], build: Callable[..., Any], welds: float | None = None
    ) -> None:
        self.numbers: Numbers = numbers_of(mechanism, SI)
        known = {joint.name for joint in joints}
        holds = [hold for hold in self.numbers.holds if hold.name in known]
        self.places: list[Place] = []
        meeting = [hold for hold in holds if hold.kind in MEETING]
        welded = [hold for hold in holds if hold.kind in AXIAL] if welds is not None else []
        pairs, turned = ([self._ends(hold) for hold in group] for group in (meeting, welded))
        self.tree = absolute_tree(self.numbers)
        extra = {"welds": turned} if welds is not None else {}
        self.engine = build(self.tree, self.places, pairs, **extra)
        self._turned = bool(turned)
        self.rows: Sequence[RowMap] = tuple(_maps(meeting, welded, welds or 1.0))

    def _ends(self, hold: Hold) -> tuple[int, int]:
        for body in hold.bodies:
            self.places.append(Place(body, *hold.end(body)))
        return len(self.places) - 2, len(self.places) - 1

    def residual(self, q: Array, t: float) -> Array:
        """Return the residual (m,)."""
        return self._stacked(self.engine.still(q)[3], q, 0)

    def jacobian(self, q: Array, t: float) -> Array:
        """Return the Jacobian (m, 6 b) in columns (v, w) of each body."""
        return self._stacked(self.engine.still(q)[4], q, 1) @ self._to_body(q)

    def constraint_velocity(self, q: Array, qd: Array, t: float) -> Array:
        """Return the rates of the rows (m,), by the engine's velocities."""
        rates = self.tree.rates(q) @ qd
        vel = self.engine.moving(q, rates, None)[0]
        pairs = np.array(self.engine.pairs, int).reshape(-1, 2)
        return self._stacked(vel[pairs[:, 1], :3] - vel[pairs[:, 0], :3], q, 2, rates)

    def drift(self, q: Array, qd: Array, t: float) -> Array:
        """Return gamma (m,): minus the second derivative of the rows while v' and w' are zero."""
        rates = self.tree.rates(q) @ qd
        return -self._stacked(self.engine.moving(q, rates, None)[2], q, 3, rates)

    def close(self) -> None:
        """Do nothing: what the engine holds goes with the object."""

    def _stacked(self, gaps: Array, q: Array, what: int, rates: Array = None) -> Array:
        """Return the rows of pairs, then of welds: residual, Jacobian, velocity or second derivative (0 to 3)."""
        rows = np.reshape(gaps, (-1, *np.shape(gaps)[2:]))
        if not self._turned:
            return rows
        still = np.zeros(len(self.tree.rates(q))) if rates is None else rates
        turned = self.engine.welded(q, still)[what]
        return np.concatenate([rows, turned.reshape(-1, *turned.shape[2:])])

    def _to_body(self, q: Array) -> Array:
        """Return the matrix that makes rates of a free body in the engine, (v, w in its own axes), of (v, w)."""
        out = np.eye(6 * len(self.numbers.bodies))
        for k, pose in enumerate(np.reshape(q, (-1, 7))):
            turn = slice(6 * k + 3, 6 * k + 6)
            out[turn, turn] = matrix(pose[3:]).T
        return out


def _maps(meeting: Sequence[Hold], welded: Sequence[Hold], factor: float) -> list[RowMap]:
    maps = [
        RowMap(constraint=h.name, row=h.row + k, engine_row=3 * n + k) for n, h in enumerate(meeting) for k in range(3)
    ]
    first = 3 * len(meeting)
    for n, hold in enumerate(welded):
        row = hold.row + (3 if hold.kind in MEETING else 0)
        last = row + (2 if hold.kind == "fixed" else 4)
        places = [row, row + 1, last] if hold.kind in WHOLE else [row, row + 1]
        maps += [
            RowMap(constraint=hold.name, row=at, engine_row=first + 3 * n + k, factor=factor, either=True)
            for k, at in enumerate(places)
        ]
    return maps
