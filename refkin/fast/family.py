"""Many mechanisms of one topology: a scene whose joints and drivers have rows of numbers instead of numbers.

A row holds one number for each mechanism, its lane. The joints' own `constants` and `inputs` run on rows as they run on
numbers, so a family is a `System` whose geometry and unit are rows, and all its methods work as ever on (n, M).
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass, fields, is_dataclass, replace
from typing import Any, cast

import numpy as np

from refkin.errors import Fault, InvalidScene, UnknownName
from refkin.joints import GROUND, Constraint, Driver, Unit
from refkin.model import Body, Mechanism, Scene
from refkin.system import System

Geometry = Mapping[str, Mapping[str, Any]]
"""Joint or driver -> key -> value, as in a scene file, with rows (M,) where that has numbers; pairs may be (2, M)."""
Estimates = Mapping[str, Any]
"""Body -> (x, y, phi) with numbers or rows, or (3, M)."""


class Row(np.ndarray[Any, Any]):
    """A row that brings its own root, as balls do: axes of rows are scaled to length 1 by the joints' own text."""

    def sqrt(self) -> Any:
        """Return the root of every number."""
        return np.sqrt(self)


@dataclass(frozen=True)
class Family:
    """The mechanisms and their equations.

    Attributes
    ----------
    scene : Scene
        The scene that all have in common.
    constraints : tuple of Constraint
        Joints, then drivers, with rows in place of numbers.
    system : System
        With rows (M,) for geometry and unit.
    size : int
        M, the number of mechanisms.
    estimates : dict
        Body -> (3, M) in metres and rad, or None.
    """

    scene: Scene
    constraints: tuple[Constraint, ...]
    system: System
    size: int
    estimates: dict[str, Any]

    def lane(self, k: int) -> Scene:
        """Return the scene of one mechanism, for `refkin.solve` and everything else that takes a scene."""
        m = self.scene.mechanism
        constraints = self.of_lane(k)
        joints, drivers = constraints[: len(m.joints)], constraints[len(m.joints) :]
        bodies = []
        for body in m.bodies:
            given = self.estimates[body.name]
            estimate = None if given is None else tuple(float(x) for x in given[:, k])
            bodies.append(Body(name=body.name, estimate=cast(Any, estimate)))
        mechanism = Mechanism(tuple(bodies), joints, cast(tuple[Driver, ...], drivers))
        return replace(self.scene, mechanism=mechanism, name=f"{self.scene.name} [{k}]")

    def of_lane(self, k: int) -> tuple[Constraint, ...]:
        """Return the constraints of one mechanism."""
        return tuple(cast(Constraint, lane_of(c, k)) for c in self.constraints)

    def unit_of(self, k: int) -> Unit:
        """Return the unit of one mechanism."""
        return cast(Unit, lane_of(self.system.unit, k))


def family(scene: Scene, system: System, geometry: Geometry, estimates: Estimates | None = None) -> Family:
    """Return the family of a scene whose geometry is replaced, in part or whole, by rows.

    Parameters
    ----------
    system : System
        That of the scene.

    Raises
    ------
    UnknownName, InvalidScene
        For a joint, key or body that does not exist, or rows of different lengths.
    """
    m = scene.mechanism
    known = tuple(c.name for c in m.constraints)
    for name in geometry:
        if name not in known:
            raise UnknownName("joint or driver", name, known)
    constraints = tuple(_with_rows(c, geometry.get(c.name, {})) for c in m.constraints)
    given = _estimates(m, estimates or {})
    lengths = {len(x) for c in constraints for x in _rows(c)} | {x.shape[1] for x in given.values() if x is not None}
    lengths -= {1}
    if len(lengths) > 1:
        raise InvalidScene([Fault("geometry", sorted(lengths), "rows of one length, one number per mechanism")])
    size = lengths.pop() if lengths else 1
    unit = _unit(constraints, size)
    placed = tuple(
        replace(p, constraint=c, g=tuple(_plain_row(x, size) for x in c.constants(unit)))
        for p, c in zip(system.placed, constraints, strict=True)
    )
    full = {name: None if x is None else np.broadcast_to(x, (3, size)) for name, x in given.items()}
    return Family(scene, constraints, replace(system, unit=unit, placed=placed), size, full)


def lane_of(value: Any, k: int) -> Any:
    """Return the numbers of one lane of a value, or of a dataclass or tuple of values."""
    if isinstance(value, np.ndarray):
        return float(value[k if len(value) > 1 else 0])
    if isinstance(value, tuple):
        return tuple(lane_of(part, k) for part in value)
    if is_dataclass(value) and not isinstance(value, type):
        own = {f.name: lane_of(getattr(value, f.name), k) for f in fields(value) if f.init}
        return replace(value, **own) if any(True for _ in _rows(value)) else value
    return value


def of_lanes(system: System, lanes: Any) -> System:
    """Return the system of some lanes of a family; `lanes` is a slice or an array of numbers."""
    placed = tuple(replace(p, constraint=_cut(p.constraint, lanes), g=_cut(p.g, lanes)) for p in system.placed)
    return replace(system, unit=_cut(system.unit, lanes), placed=placed)


def _cut(value: Any, lanes: Any) -> Any:
    """Return a value with some lanes of its rows."""
    if isinstance(value, np.ndarray):
        return value[lanes] if value.ndim and len(value) > 1 else value
    if isinstance(value, tuple):
        return tuple(_cut(part, lanes) for part in value)
    if is_dataclass(value) and not isinstance(value, type) and any(True for _ in _rows(value)):
        return replace(value, **{f.name: _cut(getattr(value, f.name), lanes) for f in fields(value) if f.init})
    return value


def _rows(value: Any) -> Any:
    """Yield all rows in a value."""
    if isinstance(value, np.ndarray):
        yield value
    elif isinstance(value, tuple):
        for part in value:
            yield from _rows(part)
    elif is_dataclass(value):
        for key in fields(value):
            yield from _rows(getattr(value, key.name))


def _with_rows(constraint: Constraint, given: Mapping[str, Any]) -> Constraint:
    keys = {f.name for f in fields(constraint)} - {"name", "type", "body", "body_i", "body_j", "relative_to"}
    changed = {}
    for key, value in given.items():
        if key not in keys:
            raise UnknownName(f"key of {constraint.name!r}", key, tuple(sorted(keys)))
        own = getattr(constraint, key)
        if isinstance(own, tuple) and not isinstance(value, tuple):
            value = tuple(value)
        changed[key] = _as_rows(value)
    return replace(constraint, **changed) if changed else constraint


def _as_rows(value: Any) -> Any:
    """Return a value with its arrays, and those of its parts, as rows; single numbers stay numbers."""
    if isinstance(value, np.ndarray | list):
        row = np.asarray(value, float)
        if row.ndim > 1:
            raise InvalidScene([Fault("geometry", row.shape, "rows of shape (M,)")])
        return row.view(Row) if row.ndim else float(row)
    if isinstance(value, tuple):
        return tuple(_as_rows(part) for part in value)
    if is_dataclass(value) and not isinstance(value, type):
        return replace(value, **{f.name: _as_rows(getattr(value, f.name)) for f in fields(value) if f.init})
    return value


def _plain_row(x: Any, size: int) -> Any:
    return x if isinstance(x, float) else np.broadcast_to(np.asarray(x, float), (size,))


def _unit(constraints: tuple[Constraint, ...], size: int) -> Unit:
    """Return the unit of every mechanism, by the rules of `Mechanism.size` and `Mechanism.unit`."""
    points: dict[str, list[Any]] = {}
    for constraint in constraints:
        for body, point in constraint.points():
            points.setdefault(body, []).append(point)
    largest = np.zeros(size)
    for on in points.values():
        for k, a in enumerate(on):
            for b in on[:k]:
                largest = np.fmax(largest, np.hypot(np.subtract(a[0], b[0]), np.subtract(a[1], b[1])))
    for constraint in constraints:
        largest = np.fmax(largest, _reach(constraint, size))
    mantissa, exponent = np.frexp(largest)
    rounded = np.ldexp(1.0, np.where(mantissa > math.sqrt(0.5), exponent, exponent - 1))
    usable = (largest > 0.0) & np.isfinite(largest)
    origin = points[GROUND][0] if points.get(GROUND) else (0.0, 0.0)
    x, y = (cast(float, np.asarray(c, float)[()]) for c in origin)
    return Unit(cast(float, np.where(usable, rounded, 1.0)), (x, y))


def _reach(constraint: Constraint, size: int) -> Any:
    """Return the lengths that a constraint itself brings."""
    if not any(True for _ in _rows(constraint)):
        return constraint.reach()
    try:
        return constraint.reach()
    except ValueError:  # the largest of two rows: lane by lane
        return np.array([cast(Constraint, lane_of(constraint, k)).reach() for k in range(size)])


def _estimates(mechanism: Mechanism, given: Estimates) -> dict[str, Any]:
    """Return per body (3, M) or (3, 1): what is given, else the scene's own estimate, else None."""
    names = tuple(b.name for b in mechanism.bodies)
    for name in given:
        if name not in names:
            raise UnknownName("body", name, names)
    found: dict[str, Any] = {}
    for body in mechanism.bodies:
        value = given.get(body.name, body.estimate)
        if value is None:
            found[body.name] = None
            continue
        rows = np.broadcast_arrays(*(np.atleast_1d(np.asarray(x, float)) for x in value))
        if len(rows) != 3 or rows[0].ndim != 1:
            shape = np.shape(value)
            raise InvalidScene([Fault(f"estimates.{body.name}", shape, "x, y, phi: numbers or rows (M,)")])
        found[body.name] = np.array(rows)
    return found
