"""Certificates of all lanes at once, by a tape of their own; see `lanes.prove` for what is proved.

The truth is that of `proof.exact`: the scene as it is written. What its numbers lost when they were scaled and rounded,
and what laws lose when they are evaluated, comes as errors beside them.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, fields, is_dataclass, replace
from typing import Any

import numpy as np

from refkin.fast.compiled import Compiled
from refkin.fast.lanes.prove import LARGEST_GAMMA, ORDERS
from refkin.fast.lanes.run import block_lanes
from refkin.motion_laws import Table
from refkin.proof.bounded import TINY, UP, Bounded, Times, U, bounded_system
from refkin.system import System


@dataclass(frozen=True)
class Radii:
    """Proved bounds of the largest error of a pose and its rates, in scaled coordinates, (T,); None if not given."""

    position: Any
    velocity: Any
    acceleration: Any


def radii(system: System, made: Compiled, levels: Sequence[Any], t: Any) -> Radii | None:
    """Return certified radii of poses and rates at all times; None if some pose has none by this means.

    Parameters
    ----------
    levels : sequence of (n, T) array
        Coordinates, rates, accelerations in the system's coordinates, as many as the system's effects call for.
    """
    proof = made.proof
    if proof is None or len(levels) != made.levels:
        return None
    geometry = _geometry(system)
    if not all(_holds(zeros, g) for zeros, g in zip(proof.zeros, geometry, strict=True)):
        return None
    laws = {k: _law(system, k, t) for k, p in enumerate(system.placed) if p.constraint.laws}
    found = np.empty((1 + len(levels), len(t)))
    lanes = block_lanes(proof.tape)
    for start in range(0, len(t), lanes):
        at = slice(start, min(start + lanes, len(t)))
        with made.proving.workspace(at.stop - at.start) as space:
            space.give_geometry(geometry)
            given = {k: [[x[..., at] for x in orders] for orders in law] for k, law in laws.items()}
            space.give_laws({**given, len(system.placed): [level[:, at] for level in levels]})
            space.run("newton")
            space.run("answer")
            found[:, at] = space.level(0)
    gamma, bounds = found[0], found[1:] * UP + TINY
    if not ((gamma * UP <= LARGEST_GAMMA).all() and np.isfinite(bounds).all()):
        return None
    return Radii(*bounds, *[None] * (3 - len(levels)))


def _geometry(system: System) -> list[tuple[float, ...]]:
    """Return per constraint its numbers, then the errors of each."""
    found = []
    for p, exact in zip(system.placed, bounded_system(system).placed, strict=True):
        numbers: Any = exact.g
        found.append((*p.g, *(UP * (abs(x.mid - g) + x.rounding) for g, x in zip(p.g, numbers, strict=True))))
    return found


def _holds(zeros: Sequence[float | None], numbers: Sequence[float]) -> bool:
    """Whether the zeros that are part of the structure are zeros of the scene as it is written, too."""
    return all(zero is None or not off for zero, off in zip(zeros, numbers[len(zeros) :], strict=True))


def _law(system: System, k: int, t: Any) -> list[list[Any]]:
    """Return the values of a constraint's laws, by law: `ORDERS` of them, then their errors, (T,) each."""
    constraint, order = system.placed[k].constraint, ORDERS - 1
    try:
        numbers = _numbers(constraint).inputs(_Number.exactly(t), system.unit, order)
        found = [[(x.mid, x.rounding) for x in law] for law in numbers]
    except _OnlyExact:
        exact: Any = bounded_system(system).placed[k].constraint
        times = Times(t, order).values(exact.exact, system.unit)
        found = [[(high, np.abs(low) + rest) for high, low, rest in law] for law in times]
    rows = [[tuple(np.broadcast_to(x, np.shape(t)) for x in pair) for pair in law] for law in found]
    return [[*(mid for mid, _ in law), *(UP * off for _, off in law)] for law in rows]


class _OnlyExact(Exception):
    """A law that does not run on numbers with errors: a spline, whose coefficients come from elsewhere."""


class _Number(Bounded):
    """A `Bounded` number with what laws need beyond formulas of joints: quotients and whole powers."""

    __slots__ = ()

    def __truediv__(self, other: Any) -> _Number:
        x = other if isinstance(other, Bounded) else self.exactly(other)
        mid = self.mid / x.mid
        least = np.abs(x.mid) - x.rounding
        off = (self.rounding + np.abs(mid) * x.rounding) / np.where(least > 0.0, least, np.nan)
        return _Number(mid, UP * off + U * np.abs(mid) + TINY)

    def __rtruediv__(self, other: Any) -> _Number:
        return self.exactly(other) / self

    def __pow__(self, exponent: int) -> Any:
        found: Any = 1.0
        for _ in range(exponent):
            found = self * found
        return found


def _numbers(item: Any) -> Any:
    """Return a dataclass, tuple or number with every number in it, at any depth, as one with errors: exact ones.

    Zeros stay as they are: exact anyway, and a formula may ask whether a number is zero.
    """
    if isinstance(item, Table):
        raise _OnlyExact
    if isinstance(item, bool) or item == 0:
        return item
    if isinstance(item, int | float):
        return _Number.exactly(float(item))
    if isinstance(item, tuple):
        return tuple(map(_numbers, item))
    if is_dataclass(item) and not isinstance(item, type):
        return replace(item, **{f.name: _numbers(getattr(item, f.name)) for f in fields(item) if f.init})
    return item
