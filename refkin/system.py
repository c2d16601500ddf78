"""A mechanism's equations: phi(q, t) = 0, phi_q qd = nu, phi_q qdd = gamma.

`compile_system` is the only place that knows where a body's coordinates sit in q. Coordinates come first, a batch comes
last: q has shape (n,) or (n, B), t is a number or (B,), and so are all results. The dtype of q decides the arithmetic:
float, complex, or object (balls, symbols).
"""

from __future__ import annotations

from collections.abc import Callable, Iterable
from dataclasses import dataclass
from typing import Any

import numpy as np

from refkin.errors import NotCalledFor
from refkin.joints import GROUND, SI, Constraint, Unit
from refkin.model import Effect, Mechanism
from refkin.vec import BodyValues

EVERYTHING = frozenset(Effect)


@dataclass(frozen=True)
class Placed:
    """A constraint with its scaled geometry `g`, its first row, and where the coordinates of its bodies start in q.

    A start is None for the ground, which has no coordinates.
    """

    constraint: Constraint
    g: tuple[float, ...]
    row: int
    starts: tuple[int | None, ...]


@dataclass(frozen=True)
class System:
    """The equations of a mechanism in a unit of length; see `compile_system`.

    Attributes
    ----------
    n, m : int
        Number of coordinates and of constraint rows; m >= n.
    """

    mechanism: Mechanism
    effects: frozenset[Effect]
    unit: Unit
    placed: tuple[Placed, ...]
    n: int
    m: int

    def columns(self, body: str) -> slice:
        """Return where (x, y, phi) of a body sit in q."""
        start = 3 * [b.name for b in self.mechanism.bodies].index(body)
        return slice(start, start + 3)

    @property
    def row_names(self) -> tuple[str, ...]:
        """The name of each row: its constraint's, with a number where a constraint has several rows."""
        return tuple(
            p.constraint.name if p.constraint.rows == 1 else f"{p.constraint.name}[{k}]"
            for p in self.placed
            for k in range(p.constraint.rows)
        )

    def phi(self, q: Any, t: Any) -> Any:
        """Return the constraint residual, (m,) or (m, B)."""
        q = np.asarray(q)
        bodies = self._bodies(q)
        rows = self._rows(bodies, t, 0, lambda c: c.residual)
        return _stack(rows, self.m, q, t)

    def phi_q(self, q: Any, t: Any) -> Any:
        """Return the constraint Jacobian, (m, n) or (m, n, B)."""
        q = np.asarray(q)
        bodies = self._bodies(q)
        out = np.zeros((self.m, self.n, *q.shape[1:]), dtype=np.result_type(q, np.asarray(t)))
        for p in self.placed:
            f = p.constraint.inputs(t, self.unit, 0)
            blocks = p.constraint.jacobian(p.g, f, *(bodies[s] for s in p.starts))
            for start, block in zip(p.starts, blocks, strict=True):
                if start is None:
                    continue
                for k, row in enumerate(block):
                    for column, entry in enumerate(row, start):
                        out[p.row + k, column] = entry
        return out

    def nu(self, q: Any, t: Any) -> Any:
        """Return the velocity right side nu = -phi_t, (m,) or (m, B)."""
        self._called_for(Effect.VELOCITY, Effect.ACCELERATION)
        q = np.asarray(q)
        rows = self._rows(self._bodies(q), t, 1, lambda c: c.nu)
        return _stack(rows, self.m, q, t)

    def gamma(self, q: Any, qd: Any, t: Any) -> Any:
        """Return the acceleration right side gamma = -(phi_q qd)_q qd - 2 phi_qt qd - phi_tt, (m,) or (m, B)."""
        self._called_for(Effect.ACCELERATION)
        q, qd = np.asarray(q), np.asarray(qd)
        rows = self._rows(self._bodies(q, qd), t, 2, lambda c: c.gamma)
        return _stack(rows, self.m, q + qd, t)

    def to_unit(self, q: Any) -> Any:
        """Return physical coordinates (m, rad) as coordinates of this system."""
        out = np.array(q, copy=True)
        for k, shift in enumerate(self.unit.origin):
            out[k::3] = (out[k::3] - shift) / self.unit.size
        return out

    def to_physical(self, q: Any, order: int = 0) -> Any:
        """Return this system's coordinates (order 0) or their rates (order 1, 2) in m and rad."""
        out = np.array(q, copy=True)
        for k, shift in enumerate(self.unit.origin):
            out[k::3] = out[k::3] * self.unit.size + (0.0 if order else shift)
        return out

    def _bodies(self, q: Any, qd: Any = None) -> dict[int | None, BodyValues]:
        """Return the values of each body by the place where it starts in q; None is the ground."""
        values = q.tolist() if q.ndim == 1 else q
        bodies: dict[int | None, BodyValues] = {None: BodyValues(0.0, 0.0, 0.0)}
        for k in range(0, self.n, 3):
            bodies[k] = BodyValues(*values[k : k + 3])
        if qd is not None:
            rates = qd.tolist() if qd.ndim == 1 else qd
            bodies[None].moving(0.0, 0.0, 0.0)
            for k in range(0, self.n, 3):
                bodies[k].moving(*rates[k : k + 3])
        return bodies

    def _rows(
        self, bodies: dict[int | None, BodyValues], t: Any, order: int, formula: Callable[[Constraint], Any]
    ) -> Iterable[Any]:
        """Yield the rows of one formula; laws are evaluated up to `order`, no further."""
        for p in self.placed:
            f = p.constraint.inputs(t, self.unit, order)
            yield from formula(p.constraint)(p.g, f, *(bodies[s] for s in p.starts))

    def _called_for(self, *effects: Effect) -> None:
        if not self.effects.intersection(effects):
            raise NotCalledFor(effects[0], frozenset(self.effects))


def compile_system(mechanism: Mechanism, effects: frozenset[Effect] = EVERYTHING, unit: Unit = SI) -> System:
    """Return the equations of a mechanism.

    Parameters
    ----------
    mechanism : Mechanism
        Bodies, joints and drivers. Rows come in the order of joints, then drivers; columns in the order of bodies.
    effects : frozenset of Effect
        What may be asked beyond phi and phi_q.
    unit : Unit
        Length and origin of the coordinates: metres by default; `mechanism.unit()` for those every solve runs in.
    """
    starts: dict[str, int | None] = {GROUND: None}
    for k, body in enumerate(mechanism.bodies):
        starts[body.name] = 3 * k
    placed = []
    row = 0
    for constraint in mechanism.constraints:
        where = tuple(starts[body] for body in constraint.bodies)
        placed.append(Placed(constraint, constraint.constants(unit), row, where))
        row += constraint.rows
    return System(mechanism, effects, unit, tuple(placed), 3 * len(mechanism.bodies), row)


def _stack(rows: Iterable[Any], m: int, q: Any, t: Any) -> Any:
    """Return rows, some of them plain numbers, as one array of the arithmetic of q and t."""
    out = np.empty((m, *q.shape[1:]), dtype=np.result_type(q, np.asarray(t)))
    for k, row in enumerate(rows):
        out[k] = row
    return out
