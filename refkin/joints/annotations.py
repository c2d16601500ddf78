"""Whether the fields of a dataclass hold what their annotations say: numbers, rows of numbers, some of a few words."""

from __future__ import annotations

import math
from collections.abc import Iterator
from contextlib import suppress
from dataclasses import fields, is_dataclass, replace
from functools import cache
from types import NoneType
from typing import Any, Literal, get_args, get_origin, get_type_hints

import numpy as np

from refkin.errors import LONGEST as QUOTED
from refkin.errors import Fault, InvalidRequest, UnknownName
from refkin.joints.base import Constraint
from refkin.joints.drivers import Driver

FLOAT = np.dtype(float)
LONGEST = 1e300
"""Of a length [m], so that the distance of two points is in float64; a law's rate that is not ends in a status."""


def plain(given: Any) -> Any:
    """Return what is given with tuples of Python's numbers in the place of lists and arrays, however deep they are."""
    try:
        hash(given)
    except TypeError:
        given = given.tolist() if isinstance(given, np.ndarray) else given
        if isinstance(given, list | tuple):
            return tuple(map(plain, given))
        if _is_instance(given):
            return replace(given, **{key.name: plain(getattr(given, key.name)) for key in fields(given) if key.init})
    return given


def type_faults(path: str, item: Any) -> Iterator[Fault]:
    """Yield what holds no number, not as many, or no word of those that its annotation says, in a dataclass or rows."""
    kind, one, _ = path.partition("[")
    known = isinstance(item, Constraint) + isinstance(item, Driver)  # a driver is a constraint, and no joint
    of_kind = "." in path or known == {"joint": 1, "driver": 2}.get(kind, 0)
    if isinstance(item, tuple) and not one:
        for k, part in enumerate(item):
            yield from type_faults(f"{path}[{k}]", part)
    elif not (one and _is_instance(item) and of_kind):
        yield Fault(path, item, f"a {kind}" if one else "a tuple, or a list")
    else:
        for key in fields(item):
            x, count = getattr(item, key.name), _expected(item.__class__).get(key.name, 0)
            if _is_instance(x):
                yield from type_faults(f"{path}.{key.name}", x)
            elif count and not _held(x, count) and not (x is key.default is None):
                words = " or ".join(map(repr, count)) if isinstance(count, tuple) else f"a row of {count} numbers"
                words = {1: "a number", -1: "a row of numbers"}.get(count, words)
                yield Fault(f"{path}.{key.name}", x, words)


def word_faults(item: Any) -> Iterator[Fault]:
    """Yield each field of a dataclass that holds none of the words, or flags, that its annotation says."""
    for key, words in _expected(item.__class__).items():
        if isinstance(words, tuple) and not _held(plain(getattr(item, key)), words):
            yield Fault(key, getattr(item, key), " or ".join(map(repr, words)))


def _held(x: Any, expected: Any) -> bool:
    """Whether so many numbers are held, or one of these words."""
    if isinstance(expected, tuple):
        return x in expected
    row = (x,) if expected == 1 else x
    return isinstance(row, tuple) and all(map(is_number, row)) and not len(row) != expected > 0


def _is_instance(item: Any) -> bool:
    return is_dataclass(item) and not isinstance(item, type)


def is_number(x: Any) -> bool:
    """Whether it is a number of Python's; what is not finite is one, too long whole numbers are none."""
    return isinstance(x, float) or (type(x) is int and abs(x) < LONGEST)


def check(name: str, expected: str, value: object, well: bool) -> None:
    """Raise InvalidRequest, with what was expected and what came, unless all is well with an argument.

    Parameters
    ----------
    name, expected : str
        Its name, and what it has to be, in words.
    value : object
    well : bool
    """
    if not well:
        raise InvalidRequest(name, expected, repr(value)[:QUOTED])


def is_real(value: Any, *shape: int) -> bool:
    """Whether a value is made of real numbers, none of them NaN, and has a shape; () is that of one number."""
    given = _reals(value)
    return given is not None and given.shape == shape and not np.isnan(given).any()


def is_flag(value: Any) -> bool:
    """Whether a value is True or False: a number is neither."""
    return isinstance(value, bool | np.bool_)


def numbers(name: str, value: Any, expected: str, *shapes: tuple[int | None, ...]) -> Any:
    """Return real numbers, NaN among them, as float64; raise InvalidRequest if they are none, or of another shape.

    Parameters
    ----------
    name, value, expected
        As for `check`.
    *shapes
        Those that the numbers may have; a None at the end stands for any length.
    """
    if type(value) is np.ndarray and value.dtype is FLOAT and value.shape in shapes:
        return value  # in a tenth of the time: who solves asks for each of its steps
    given = _reals(value)
    if given is None:
        raise InvalidRequest(name, expected, repr(value)[:QUOTED])
    if given.shape not in shapes and (*given.shape[:-1], None) not in shapes:
        raise InvalidRequest(name, expected, f"shape {given.shape}")
    return given


class Named(dict[str, Any]):
    """Parts by their names; UnknownName has those that there are."""

    def __missing__(self, name: str) -> Any:
        raise UnknownName("part", name, tuple(self))


def _reals(value: Any) -> Any:
    """Return real numbers as float64, or None: text would be read, a complex number lose a part, None become NaN."""
    with suppress(TypeError, ValueError, OverflowError):
        given = np.asarray(value)
        if given.dtype.kind in "biuf" or (given.dtype == object and all(hasattr(x, "__float__") for x in given.flat)):
            return np.asarray(given, float)
    return None


@cache
def _expected(kind: Any) -> dict[str, Any]:
    """Return how many numbers each field of a dataclass holds, -1 for any, or the words of which it is one.

    Nothing of a field whose annotation is not known here.
    """
    expected: dict[str, Any] = {}
    with suppress(NameError, TypeError):
        for name, hint in get_type_hints(kind).items():
            whole = [part for part in get_args(hint) if part is not NoneType] if NoneType in get_args(hint) else [hint]
            parts = get_args(whole[0]) if get_origin(whole[0]) in (tuple, Literal) else whole
            if get_origin(whole[0]) is Literal:
                expected[name] = parts
            elif whole == [bool]:
                expected[name] = (False, True)
            elif all(part in (float, int, ...) for part in parts):
                expected[name] = -1 if ... in parts else len(parts)
    return expected


def finite_faults(path: str, item: Any) -> Iterator[Fault]:
    """Yield every number in a dataclass, at any depth, that is not finite or too long."""
    if isinstance(item, float) and not (math.isfinite(item) and (abs(item) <= LONGEST or "law" in path)):
        yield Fault(path, item, "a finite number" + f" of at most {LONGEST:g} in size" * math.isfinite(item))
    elif isinstance(item, tuple):
        for k, part in enumerate(item):
            yield from finite_faults(f"{path}[{k}]", part)
    elif _is_instance(item):
        for key in fields(item):
            yield from finite_faults(f"{path}.{key.name}", getattr(item, key.name))
