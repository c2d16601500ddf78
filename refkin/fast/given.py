"""What `solve_many` is given, read and checked: rows of numbers in place of numbers, and nothing else.

What has another shape or type than the scene's own value is refused at once, by its name: read as something else, it
would be answered without a word.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import fields, is_dataclass, replace
from typing import Any

import numpy as np

from refkin.errors import Fault, InvalidScene, UnknownName
from refkin.joints import Constraint
from refkin.model import Mechanism
from refkin.motion_laws import Polynomial, Sinusoid, Table

Geometry = Mapping[str, Mapping[str, Any]]
"""Joint or driver -> key -> value, as in a scene file, with rows (M,) where that has numbers; pairs may be (2, M)."""
Estimates = Mapping[str, Any]
"""Body -> (x, y, phi) with numbers or rows, or (3, M)."""
NAMES = {"name", "type", "body", "body_i", "body_j", "relative_to"}
"""Fields that make the topology."""
LAWS = (Polynomial, Sinusoid, Table)


class Row(np.ndarray[Any, Any]):
    """A row that brings its own root, as balls do: axes of rows are scaled to length 1 by the joints' own text."""

    def sqrt(self) -> Any:
        """Return the root of every number."""
        return np.sqrt(self)


def constraints_of(mechanism: Mechanism, given: Geometry) -> tuple[Constraint, ...]:
    """Return joints, then drivers, with rows in place of numbers where they are given.

    Raises
    ------
    UnknownName, InvalidScene
        For a joint or key that does not exist, or a value that does not fit.
    """
    _mapping("geometry", given, "a mapping: joint or driver -> key -> value")
    known = tuple(c.name for c in mechanism.constraints)
    for name in given:
        if name not in known:
            raise UnknownName("joint or driver", name, known)
    return tuple(_with_rows(c, given.get(c.name, {})) for c in mechanism.constraints)


def estimates_of(mechanism: Mechanism, given: Estimates) -> dict[str, Any]:
    """Return per body (3, M) or (3, 1): what is given, else the scene's own estimate, else None.

    Raises
    ------
    UnknownName, InvalidScene
        For a body that does not exist, or a value that does not fit.
    """
    _mapping("estimates", given, "a mapping: body -> (x, y, phi)")
    names = tuple(b.name for b in mechanism.bodies)
    for name in given:
        if name not in names:
            raise UnknownName("body", name, names)
    estimates: dict[str, Any] = {}
    for body in mechanism.bodies:
        value = given.get(body.name, body.estimate)
        estimates[body.name] = None if value is None else _estimate(f"estimates.{body.name}", value)
    return estimates


def _estimate(path: str, value: Any) -> Any:
    parts = _parts(path, value, 3, "x, y, phi: numbers or rows (M,), or an array (3, M)")
    parts = tuple(np.atleast_1d(_numbers(path, part)) for part in parts)
    size = next((len(part) for part in parts if len(part) != 1), 1)
    if any(len(part) not in (1, size) for part in parts):
        raise _wrong(path, [len(part) for part in parts], "rows of one length")
    return np.array([np.broadcast_to(part, (size,)) for part in parts])


def rows_in(value: Any) -> Any:
    """Yield all rows in a value."""
    if isinstance(value, np.ndarray):
        yield value
    elif isinstance(value, tuple):
        for part in value:
            yield from rows_in(part)
    elif is_dataclass(value):
        for key in fields(value):
            yield from rows_in(getattr(value, key.name))


def has_rows(value: Any) -> bool:
    """Return whether there is a row in a value."""
    return any(True for _ in rows_in(value))


def _with_rows(constraint: Constraint, given: Mapping[str, Any]) -> Constraint:
    path = f"geometry.{constraint.name}"
    _mapping(path, given, "a mapping: key -> value")
    keys = {f.name for f in fields(constraint)} - NAMES
    for key in given:
        if key not in keys:
            raise UnknownName(f"key of {constraint.name!r}", key, tuple(sorted(keys)))
    changed = {key: _fitting(f"{path}.{key}", getattr(constraint, key), value) for key, value in given.items()}
    return replace(constraint, **changed) if changed else constraint


def _fitting(path: str, own: Any, value: Any) -> Any:
    """Return a value with rows that may stand in place of the scene's own."""
    if isinstance(own, LAWS):
        return _law(path, value)
    if is_dataclass(own) and not isinstance(own, type):
        if type(value) is not type(own):
            raise _wrong(path, value, f"a {type(own).__name__}, as the scene has")
        keys = [f.name for f in fields(own) if f.init]
        return replace(value, **{k: _fitting(f"{path}.{k}", getattr(own, k), getattr(value, k)) for k in keys})
    if isinstance(own, tuple):
        parts = _parts(path, value, len(own), f"{len(own)} values: numbers or rows (M,), or an array ({len(own)}, M)")
        return tuple(_fitting(path, *pair) for pair in zip(own, parts, strict=True))
    if isinstance(own, float | int) and not isinstance(own, bool):
        return _numbers(path, value)
    if type(value) is type(own) and value == own:
        return own
    raise _wrong(path, value, f"the scene's own {own!r}: only numbers may be rows")


def _law(path: str, value: Any) -> Any:
    """Return a law with rows in place of numbers, of any kind."""
    if not isinstance(value, LAWS):
        raise _wrong(path, value, "a law: Polynomial, Sinusoid or Table")
    if isinstance(value, Polynomial):
        return replace(value, coefficients=tuple(_numbers(f"{path}.coefficients", c) for c in value.coefficients))
    if isinstance(value, Sinusoid):
        keys = ("amplitude", "angular_frequency", "offset", "phase")
        return replace(value, **{key: _numbers(f"{path}.{key}", getattr(value, key)) for key in keys})
    if any(np.ndim(x) for x in (*value.argument, *value.value)):
        raise _wrong(path, "rows", "a table of numbers: tables have no rows, polynomials and sinusoids do")
    return value


def _parts(path: str, value: Any, count: int, expected: str) -> tuple[Any, ...]:
    if not isinstance(value, tuple | list | np.ndarray) or (isinstance(value, np.ndarray) and not value.ndim):
        raise _wrong(path, value, expected)
    if len(value) != count:
        raise _wrong(path, np.shape(value) if isinstance(value, np.ndarray) else value, expected)
    return tuple(value)


def _numbers(path: str, value: Any) -> Any:
    """Return a number, or a row of them."""
    try:
        row = np.asarray(value)
    except ValueError:  # lists of several lengths
        raise _wrong(path, value, "a number or a row (M,)") from None
    if row.dtype.kind not in "fiu":
        raise _wrong(path, value, "a number or a row (M,) of numbers")
    if row.ndim > 1:
        raise _wrong(path, row.shape, "a number or a row (M,)")
    return np.array(row, float).view(Row) if row.ndim else float(row)  # a copy: the given one may be written over


def _mapping(path: str, value: Any, expected: str) -> None:
    if not isinstance(value, Mapping):
        raise _wrong(path, value, expected)


def _wrong(path: str, value: Any, expected: str) -> InvalidScene:
    return InvalidScene([Fault(path, value, expected)])
