"""A mechanism's equations: phi(q, t) = 0, phi_q qd = nu, phi_q qdd = gamma.

`compile_system` alone knows where coordinates sit in q: three for each body, or seven in space, then the parameters of
joints that bring some. Coordinates come first, a batch comes last: q has shape (n,) or (n, B), t is a number or (B,),
and so are all results. The dtype of q decides the arithmetic: float, complex, or object (balls, symbols).
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Mapping, Set
from dataclasses import dataclass, field, replace
from functools import cached_property
from typing import Any

import numpy as np

from refkin.errors import Fault, InvalidRequest, InvalidScene, NotCalledFor, RefkinError, expect
from refkin.joints import SI, Constraint, Kind, Unit
from refkin.joints.annotations import Named, check, is_real, numbers
from refkin.model import Effect, Mechanism
from refkin.vec import ParameterValue

EVERYTHING = frozenset(Effect)
FLOAT = np.zeros(())
PROFILE_ORDER = 3
"""The highest derivative of a profile that any formula takes: gamma holds the second rate of its tangent."""


@dataclass(frozen=True)
class ConstraintRows:
    """A constraint, its scaled geometry, its first row, where in q its bodies (ground: None) and parameters start."""

    constraint: Constraint
    g: tuple[float, ...]
    row: int
    starts: tuple[int | None, ...]


@dataclass(frozen=True)
class System:
    """The equations of a mechanism: m >= n rows, n coordinates, each body's from `starts` on; see `compile_system`."""

    mechanism: Mechanism
    effects: frozenset[Effect]
    unit: Unit
    placed: tuple[ConstraintRows, ...]
    n: int
    m: int
    kind: Kind
    starts: Mapping[str, int] = field(repr=False, compare=False)
    gauge: Mapping[int, Any] = field(default_factory=dict, repr=False, compare=False)
    _kept: dict[Any, tuple[Any, Any]] = field(default_factory=dict, init=False, repr=False, compare=False)

    def held_at(self, q: Any) -> System:
        """Return the system with its passive freedoms held as they are at a pose, (n,) or (n, B), not as estimated."""
        held = {p.row: p.constraint.gauge(p.g, q[p.starts[1] :]) for p in self.placed if p.constraint.passive}
        return replace(self, gauge=held) if held else self

    def columns(self, body: str) -> slice:
        """Return where the coordinates of a body sit in q."""
        return slice(start := self.starts[body], start + self.kind.width)

    def parameter(self, joint: str) -> slice:
        """Return where the parameter of a joint sits in q; an empty slice if it has none."""
        p = Named((p.constraint.name, p) for p in reversed(self.placed))[joint]
        return slice(p.starts[2], p.starts[2] + 1) if p.constraint.parameters else slice(0, 0)

    @cached_property
    def of_bodies(self) -> int:
        """The number of coordinates that belong to bodies; those of parameters come after them."""
        return self.kind.width * len(self.mechanism.bodies)

    @cached_property
    def turns(self) -> Any:
        """How far a body turns [rad] as each coordinate changes by 1, (n,): 1 for angles, as all parameters are."""
        return np.array(self.kind.turns * len(self.mechanism.bodies) + (1.0,) * (self.n - self.of_bodies))

    @cached_property
    def angles(self) -> Any:
        """Which coordinates are angles, (n,) of bool: phi of each body of the plane, and all parameters."""
        return self.turns == 1.0

    def phi(self, q: Any, t: Any) -> Any:
        """Return the constraint residual, (m,) or (m, B)."""
        return _stack(self.rows(self._values(q), t, 0, lambda c: c.residual), self.m, q, t)

    def phi_q(self, q: Any, t: Any) -> Any:
        """Return the constraint Jacobian, (m, n) or (m, n, B)."""
        out = np.zeros((self.m, self.n, *np.shape(q)[1:]), dtype=_arithmetic(q, t))
        for p, start, block in self.blocks(self._values(q), t):
            for k, row in enumerate(block, p.row):
                for column, entry in enumerate(row, start):
                    out[k, column] = entry
        return out

    def nu(self, q: Any, t: Any) -> Any:
        """Return the velocity right side nu = -phi_t, (m,) or (m, B)."""
        self._called_for(Effect.VELOCITY)
        return _stack(self.rows(self._values(q), t, 1, lambda c: c.nu), self.m, q, t)

    def gamma(self, q: Any, qd: Any, t: Any) -> Any:
        """Return the acceleration right side gamma = -(phi_q qd)_q qd - 2 phi_qt qd - phi_tt, (m,) or (m, B)."""
        self._called_for(Effect.ACCELERATION)
        return _stack(self.rows(self._values(q, qd), t, 2, lambda c: c.gamma), self.m, np.add(q, qd), t)

    def to_unit(self, q: Any, order: int = 0) -> Any:
        """Return coordinates (order 0) or rates (1, 2) in m and rad as those of this system: all n, or the bodies'."""
        out = np.array(q, _arithmetic(q), copy=True)
        for k, shift in enumerate(self.unit.origin):
            at = slice(k, self.of_bodies, self.kind.width)
            out[at] = (out[at] - (0.0 if order else shift)) / self.unit.size
        return out

    def to_physical(self, q: Any, order: int = 0, in_place: bool = False) -> Any:
        """Return coordinates (order 0) or rates (1, 2) in m and rad: all n, or the bodies'; a copy unless in place."""
        out = q if in_place else np.array(q, _arithmetic(q), copy=True)
        for k, shift in enumerate(self.unit.origin):
            at = out[k : self.of_bodies : self.kind.width]
            at *= self.unit.size
            if not order:
                at += shift
        return out

    def _values(self, q: Any, qd: Any = None) -> dict[int | None, Any]:
        """Return the values of each body and parameter by the place where it starts in q; None is the ground."""
        given = q.tolist() if (q := np.asarray(q)).ndim == 1 else q
        if q.shape[:1] != (self.n,):
            raise InvalidRequest("q", f"{self.n} coordinates", f"shape {q.shape}")
        kind, width = self.kind, self.kind.width
        places = {k: slice(k, k + width) for k in range(0, self.of_bodies, width)}
        places |= {k: slice(k, k + 1) for k in range(self.of_bodies, self.n)}
        values: dict[int | None, Any] = {None: kind.values(*kind.still)}
        for k, at in places.items():
            values[k] = (kind.values if k < self.of_bodies else ParameterValue)(*given[at])
        if qd is not None:
            rates = qd.tolist() if (qd := np.asarray(qd)).ndim == 1 else qd
            values[None].moving(*(0.0,) * width)
            for k, at in places.items():
                values[k].moving(*rates[at])
        return values

    def _given(self, p: ConstraintRows, values: dict[int | None, Any], t: Any, order: int) -> Any:
        """Return the values of a constraint's laws up to `order`, and of its profile as far as the formulas go."""
        f = self._laws_at(p, t, order) if p.constraint.laws else self.gauge.get(p.row, ())
        if not p.constraint.parameters:
            return f
        return (*f, p.constraint.profile_values(values[p.starts[2]].value, self.unit, min(order + 2, PROFILE_ORDER)))

    def _laws_at(self, p: ConstraintRows, t: Any, order: int) -> Any:
        """Return the values of a constraint's laws; Newton asks for those of the same times again and again."""
        if not isinstance(t, float) and not (isinstance(t, np.ndarray) and t.dtype == float):
            return p.constraint.inputs(t, self.unit, order)
        at, kept = t if isinstance(t, float) else t.tobytes(), self._kept.get((p.row, order))
        if kept is None or kept[0] != at:
            kept = self._kept[p.row, order] = (at, p.constraint.inputs(t, self.unit, order))
        return kept[1]

    def rows(self, values: Any, t: Any, order: int, formula: Callable[[Constraint], Any]) -> Iterable[Any]:
        """Yield the rows of one formula, as many as there are; laws are evaluated up to `order`, no further."""
        for p in self.placed:
            own = formula(c := p.constraint)(p.g, self._given(p, values, t, order), *(values[s] for s in p.starts))
            yield from _counted(c, own, c.rows, "rows")

    def blocks(self, values: Any, t: Any) -> Iterable[tuple[ConstraintRows, Any, Any]]:
        """Yield the blocks of phi_q that are not the ground's: whose each is, where its columns start, its rows."""
        for p in self.placed:
            own = (c := p.constraint).jacobian(p.g, self._given(p, values, t, 0), *(values[s] for s in p.starts))
            for k, block in enumerate(_counted(c, own, len(p.starts), "blocks")):
                if (start := p.starts[k]) is not None:
                    width = self.kind.width if k < len(c.bodies) else 1
                    yield p, start, [_counted(c, row, width, "columns") for row in _counted(c, block, c.rows, "rows")]

    def _called_for(self, effect: Effect) -> None:
        if effect not in self.effects:
            raise NotCalledFor(effect, self.effects)


def compile_system(mechanism: Mechanism, effects: frozenset[Effect] = EVERYTHING, unit: Unit = SI) -> System:
    """Return the equations of a mechanism.

    Parameters
    ----------
    mechanism : Mechanism
        Rows come in the order of joints, drivers, then what bodies bring; columns in that of bodies, then of joints
        with parameters.
    effects : frozenset of Effect
        What may be asked beyond phi and phi_q; who asks for accelerations has velocities.
    unit : Unit
        Length and origin of the coordinates: metres by default; `mechanism.unit()` for those every solve runs in.
    """
    for name, value, known in (("mechanism", mechanism, Mechanism), ("effects", effects, Set), ("unit", unit, Unit)):
        expect(name, value, known)
    check("unit.size", "a finite number above 0", unit.size, is_real(unit.size) and 0.0 < unit.size < np.inf)
    numbers("unit.origin", unit.origin, "two or three numbers", (2,), (3,))
    kind, bodies = mechanism.kind, mechanism.bodies
    effects |= {Effect.VELOCITY} if Effect.ACCELERATION in effects else set()
    starts = Named((body.name, kind.width * k) for k, body in enumerate(bodies))
    placed, owners = list[ConstraintRows](), dict[str, range]()
    row, n = 0, kind.width * len(bodies)
    for c in mechanism.constraints:
        owners[c.name] = range(n, n := n + c.parameters)
    for c in (*mechanism.constraints, *kind.own_rows(bodies, mechanism.constraints)):
        owning = (c.name, *c.shares) if c.parameters else c.shares  # rows of a body may have a joint's name
        where = (*(starts.get(b) for b in c.bodies), *(k for name in owning for k in owners.get(name, ())))
        placed.append(ConstraintRows(c, _geometry(c, unit), row, where))
        row += c.rows
    return System(mechanism, effects, unit, tuple(placed), n, row, kind, starts)


def _geometry(constraint: Constraint, unit: Unit) -> tuple[float, ...]:
    """Return a constraint's numbers, scaled; those that its formulas cannot take are a fault that it did not name."""
    try:
        return constraint.constants(unit)
    except ArithmeticError as error:
        what = f"numbers that the formulas of a {constraint.type} can take ({error})"
        raise InvalidScene([Fault(constraint.name, None, what)], "mechanism") from error


def _counted(c: Constraint, parts: Any, count: int, what: str) -> Any:
    if len(parts) != count:
        raise RefkinError(f"{c.type} {c.name!r}: expected a formula to have {count} {what}, got {len(parts)}")
    return parts


def _stack(rows: Iterable[Any], m: int, q: Any, t: Any) -> Any:
    """Return rows, some of them plain numbers, as one array of the arithmetic of q and t."""
    out = np.empty((m, *np.shape(q)[1:]), dtype=_arithmetic(q, t))
    for k, row in enumerate(rows):
        out[k] = row
    return out


def _arithmetic(q: Any, t: Any = 0.0) -> Any:
    """Return the dtype of what is computed of these: of whole numbers it is float, as a joint's lengths are none."""
    return np.result_type(np.asarray(q), np.asarray(t), FLOAT)
