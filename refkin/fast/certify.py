"""Certificates of all samples at once, by a program of their own; see `elimination.prove` for what is proved.

The truth is that of `proof.numbers.exact`: the scene as it is written. What its numbers lost when they were scaled and
rounded, and what laws lose when they are evaluated, comes as errors beside them.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np

from refkin.fast.compiled import Compiled
from refkin.fast.elimination.prove import LARGEST_GAMMA, ORDERS
from refkin.fast.elimination.run import Workspace, block_samples
from refkin.fast.elimination.trace import Known
from refkin.motion_laws import Table
from refkin.proof.numbers.bounded import TINY, UP, Bounded, Times, U, bounded_system
from refkin.proof.numbers.exact import by_parts
from refkin.proof.numbers.symbols import passive_of
from refkin.system import System


def radii(system: System, made: Compiled, levels: Sequence[Any], t: Any) -> Any:
    """Return certified radii of poses and rates, (levels, T) in scaled coordinates; None if some pose has none so.

    Parameters
    ----------
    system, made : System, Compiled
        What was solved, and by which program.
    levels : sequence of (n, T) array
        Coordinates, rates, accelerations in the system's coordinates, as many as the system's effects call for.
    t : (T,) array
        Times [s].
    """
    geometry = exact_geometry(system)
    proof = made.proof(zeros_of(geometry)) if len(levels) == made.levels else None
    if proof is None:
        return None
    laws = _laws(system, levels[0], t)
    bounds = np.empty((len(levels), len(t)))
    samples = block_samples(proof.program)
    for start in range(0, len(t), samples):
        at = slice(start, min(start + samples, len(t)))
        with proof.workspace(at.stop - at.start) as space:
            space.give_geometry(geometry)
            given = {k: [[x[at] for x in orders] for orders in law] for k, law in laws.items()}
            bounds[:, at] = proved(space, {**given, len(system.placed): [level[:, at] for level in levels]})
    return bounds if np.isfinite(bounds).all() else None


class FamilyProof:
    """Certificates of a block of mechanisms, one time after another."""

    def __init__(self, system: System, made: Compiled, samples: int) -> None:
        self.system = system
        self.nothing = np.full((made.levels, samples), np.nan)
        geometry = exact_geometry(system)
        proof = None if any(_has_spline(p.constraint) for p in system.placed) else made.proof(zeros_of(geometry))
        self.space = None if proof is None else Workspace(proof.program, samples, common=())
        if self.space is not None:
            self.space.give_geometry(geometry)

    def radii(self, levels: Sequence[Any], t: float) -> Any:
        """Return the radii (levels, L) of poses and rates (n, L) at a time, NaN where nothing is proved."""
        if self.space is None:
            return self.nothing
        return proved(self.space, {**_laws(self.system, levels[0], t), len(self.system.placed): levels})


def _laws(system: System, q: Any, t: Any) -> dict[int, Any]:
    """Return the laws by constraint; how what is passive is held at poses (n, L), as laws of one number each."""
    laws = {k: _law(system, k, t) for k, p in enumerate(system.placed) if p.constraint.laws}
    return laws | {k: [[x] for x in p.constraint.gauge(p.g, q[p.starts[1] :])] for k, p in passive_of(system)}


def exact_geometry(system: System) -> list[tuple[Any, ...]]:
    """Return per constraint its numbers, and then their errors; what holds a passive body is given as laws instead."""
    geometry = []
    for p in system.placed:
        exact: Any = p.g if p.constraint.passive else _numbers(p.constraint).constants(system.unit)
        off = [UP * (np.abs(x.mid - g) + x.rounding) for g, x in zip(p.g, map(_read, exact), strict=True)]
        geometry.append((*p.g, *off))
    return geometry


def zeros_of(geometry: Sequence[Sequence[Any]]) -> Known:
    """Return which of the numbers are 0 as the scene is written: they are part of the structure."""
    pairs = [zip(both[: len(both) // 2], both[len(both) // 2 :], strict=True) for both in geometry]
    return tuple(tuple(None if np.any(x) or np.any(off) else 0.0 for x, off in numbers) for numbers in pairs)


def proved(space: Workspace, laws: Mapping[int, Any]) -> Any:
    """Return the radii of the given levels, (levels, samples), NaN where nothing is proved."""
    with np.errstate(all="ignore"):  # what is not finite is not proved
        space.give_laws(laws)
        space.run("newton")
        space.run("answer")
    gamma, bounds = space.level(0)[0], space.level(0)[1:] * UP + TINY
    bounds[:, ~((gamma * UP <= LARGEST_GAMMA) & np.isfinite(bounds).all(axis=0))] = np.nan
    return bounds


def _read(x: Any) -> Bounded:
    """Return a number of a geometry; those that are none are zeros, scaled, or the origin itself: exact."""
    return x if isinstance(x, Bounded) else _Number.exactly(x)


def _law(system: System, k: int, t: Any) -> list[list[Any]]:
    """Return the values of a constraint's laws, by law: `ORDERS` of them, then their errors, (T,) each."""
    constraint, order = system.placed[k].constraint, ORDERS - 1
    if _has_spline(constraint):
        exact: Any = bounded_system(system).placed[k].constraint
        times = Times(t, order).values(exact.exact, system.unit)
        rows = [[(high, np.abs(low) + rest) for high, low, rest in law] for law in times]
    else:
        numbers = _numbers(constraint).inputs(_Number.exactly(t), system.unit, order)
        rows = [[(x.mid, x.rounding) for x in map(_read, law)] for law in numbers]
    if np.ndim(t):
        rows = [
            [(np.broadcast_to(x, np.shape(t)), np.broadcast_to(off, np.shape(t))) for x, off in law] for law in rows
        ]
    return [[*(mid for mid, _ in law), *(UP * off for _, off in law)] for law in rows]


def _has_spline(constraint: Any) -> bool:
    """Whether a law is a spline, whose coefficients come from a solver: it runs on no number with an error."""
    return any(isinstance(getattr(law, "rate", law), Table) for law in constraint.laws)


class _Number(Bounded):
    """A `Bounded` number with what laws need beyond formulas of joints: quotients and whole powers."""

    __slots__ = ()

    @property
    def plain(self) -> Any:
        """Whether it is 0, 1 or -1, which products and quotients take as they are."""
        return (self.rounding == 0.0) & ((self.mid == 0.0) | (np.abs(self.mid) == 1.0))

    def __mul__(self, other: Any) -> Any:
        product = super().__mul__(other)
        if not isinstance(product, _Number) or isinstance(other, int):
            return product
        x = other if isinstance(other, _Number) else self.exactly(other)
        off = np.abs(self.mid) * x.rounding + np.abs(x.mid) * self.rounding
        product.rounding = np.where(self.plain | x.plain, off, product.rounding)
        return product

    __rmul__ = __mul__

    def __truediv__(self, other: Any) -> _Number:
        x: Any = other if isinstance(other, Bounded) else self.exactly(other)
        mid = self.mid / x.mid
        least = np.abs(x.mid) - x.rounding
        off = (self.rounding + np.abs(mid) * x.rounding) / np.where(least > 0.0, least, np.nan)
        rounded = UP * off + U * np.abs(mid) + TINY * (self.mid != 0.0)  # 0 is divided exactly
        return _Number(mid, np.where(x.plain, self.rounding, rounded))

    def __rtruediv__(self, other: Any) -> _Number:
        return self.exactly(other) / self

    def sqrt(self) -> _Number:
        """Return the root, off by at most off / root and a rounding."""
        mid = np.sqrt(self.mid)
        return _Number(mid, np.where(self.plain, 0.0, UP * self.rounding / mid + U * mid))

    def __pow__(self, exponent: int) -> Any:
        power: Any = 1.0
        for _ in range(exponent):
            power = self * power
        return power


def _numbers(item: Any) -> Any:
    """Return a dataclass, tuple or number with every number in it, at any depth, as one with errors: exact ones.

    Zeros stay as they are: exact anyway, and a formula may ask whether a number is zero. So do splines (`_law`).
    """
    if isinstance(item, Table):
        return item
    if isinstance(item, np.ndarray):
        return _Number.exactly(np.asarray(item))
    if isinstance(item, int | float) and not isinstance(item, bool):
        return _Number.exactly(float(item)) if item else item
    return by_parts(item, _numbers)
