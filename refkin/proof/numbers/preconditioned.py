"""A batch of poses with an approximate inverse of their Jacobians, and what that inverse makes of vectors and boxes."""

from __future__ import annotations

from collections.abc import Iterable, Iterator
from dataclasses import astuple, dataclass
from typing import Any

import numpy as np

from refkin.proof.numbers.bounded import TINY, UP, Bounds, Extended, Times, U, bounded_system, box, product, read
from refkin.system import System


@dataclass(frozen=True)
class Nearly:
    """Numbers proved to lie within `remainder` of `given` + `shift`: what was given, and its error; (n, B) each."""

    given: Any
    shift: Any
    remainder: Any

    @property
    def error(self) -> Any:
        """Bound of the distance from `given`."""
        return UP * (np.abs(self.shift) + self.remainder)

    def nearest(self) -> tuple[Any, Any]:
        """Return the floats nearest to `given` + `shift`, and bounds of how far off they are."""
        best = self.given + self.shift
        return best, UP * (self.remainder + U * np.abs(best))

    def box(self) -> Any:
        """Return the numbers as rows around `given` + `shift`."""
        added = UP * Extended.unit * (np.abs(self.given) + np.abs(self.shift))  # the rounding of that sum
        return box(np.longdouble(self.given) + self.shift, self.remainder + added, Extended)


def one_after_another(parts: Iterable[Nearly]) -> Nearly:
    """Return numbers of consecutive blocks of samples as one."""
    return Nearly(*(np.concatenate(part, axis=-1) for part in zip(*map(astuple, parts), strict=True)))


class Preconditioned:
    """Poses q (n, B) at times t, with R about the inverse of n rows of phi_q(q); all bounds are rounded up.

    The rows are the same at all poses, (n,), or at each its own, (n, B). What is passive is held as it is at each pose.
    """

    def __init__(self, system: System, rows: Any, q: Any, t: Any, order: int) -> None:
        system = system.held_at(q)
        self.system, self.sharp = bounded_system(system), bounded_system(system, Extended)
        self.times, self.rows, self.q = Times(t, order), rows, q
        self.inverse = np.moveaxis(inverses(np.moveaxis(of_rows(system.phi_q(q, self.times.t), rows), -1, 0)), 0, -1)
        self.size = np.abs(self.inverse)
        self.dot = (len(q) + 2) * U  # > n U/(1 - n U): the error of an inner product

    def rows_of(self, numbers: Any, wide: Any = float) -> Bounds:
        """Return the certified rows of what a system's method gave; the middles as `read` does."""
        return read_rows(numbers, self.rows, self.q.shape[1], wide)

    def slope_over(self, radii: Any, times: Times | None = None) -> Bounds:
        """Return phi_q over a box around q, and over other times than its own, if there are such."""
        return self.rows_of(self.system.phi_q(box(self.q, radii), times or self.times))

    def carried(self, x: Bounds) -> tuple[Any, Any]:
        """Return R x as a value and a bound of its error."""
        off = self.dot * np.abs(x.mid) + x.rounding + x.spread
        return product(self.inverse, x.mid), UP * product(self.size, off) + TINY

    def defect_on(self, slope: Bounds, v: Any) -> Any:
        """Return |I - R phi_q(q)| v for v >= 0, of what `slope_over` gave."""
        left = np.abs(np.eye(len(v))[..., None] - np.einsum("ijb,jkb->ikb", self.inverse, slope.mid))
        inner = product(self.dot * np.abs(slope.mid) + slope.rounding, v)
        return UP * (product(left, v) + product(self.size, inner)) + TINY

    def spread_on(self, spread: Any, v: Any) -> Any:
        """Return |R| spread v for v >= 0."""
        return UP * product(self.size, product(spread, v)) + TINY


def of_rows(values: Any, rows: Any) -> Any:
    """Return rows of values (m, ..., B): the same of all samples, (n,), or of each its own, (n, B)."""
    if rows.ndim == 1:
        return values[rows]
    return np.take_along_axis(values, rows.reshape(len(rows), *(1,) * (values.ndim - 2), -1), axis=0)


def read_rows(numbers: Any, rows: Any, batch: int, wide: Any = float) -> Bounds:
    """Return what `read` does of such rows of an object array (m, ...).

    Parameters
    ----------
    numbers, batch, wide
        As for `read`.
    rows : (n,) or (n, B) array of int
        Which of the m.
    """
    if rows.ndim == 1:
        return read(numbers[rows], batch, wide)
    every = read(numbers, batch, wide)
    return Bounds(*(of_rows(part, rows) for part in (every.mid, every.rounding, every.spread)))


def left_out(rows: Any, m: int) -> Any:
    """Return the others of m rows, (m - n,) or (m - n, B)."""
    if rows.ndim == 1:
        return np.delete(np.arange(m), rows)
    taken = np.zeros((m, rows.shape[1]), bool)
    np.put_along_axis(taken, rows, True, axis=0)
    return np.argsort(taken, axis=0, kind="stable")[: m - len(rows)]


def independent_rows(system: System, q: Any, t: Any) -> Any:
    """Return n rows of phi_q that are independent at the first finite pose, by pivoted QR: all rows if m = n.

    Parameters
    ----------
    system : System
    q : (n, B) array
        Poses, in the system's coordinates.
    t : (B,) array
        Their times [s].
    """
    finite = np.flatnonzero(np.isfinite(q).all(axis=0))
    if system.m == system.n or not finite.size:
        return np.arange(system.n)
    return leading_rows(system.phi_q(q[:, finite[0]], t[finite[0]]), system.n)


WORSE = 3.0
"""How much larger the inverse of some rows may be than that of all, before others are taken."""


def groups_of_rows(system: System, q: Any, t: Any) -> Iterator[tuple[Any, Any]]:
    """Yield poses (their numbers) and n rows of phi_q that are independent there, about as well as any are.

    Rows that are independent at one pose may be nearly dependent at a later one: they serve as long as the norm of
    their inverse is at most `WORSE` times that of the pseudo-inverse of all rows; then others are chosen.

    Parameters
    ----------
    system : System
    q : (n, B) array
        Poses, in the system's coordinates.
    t : (B,) array
        Their times [s].
    """
    left = np.arange(np.shape(q)[1])
    if system.m == system.n or not (known := np.isfinite(q).all(axis=0) & np.isfinite(t)).any():
        yield left, np.arange(system.n)
        return
    slope = np.moveaxis(system.phi_q(q, t), -1, 0)
    with np.errstate(all="ignore"):
        best = np.full(len(left), np.inf)
        best[known] = 1 / np.linalg.svd(slope[known], compute_uv=False)[:, -1]
        while left.size:
            first = np.flatnonzero(known[left])[:1]
            if not first.size:
                yield left, np.arange(system.n)
                return
            rows = leading_rows(slope[left[first[0]]], system.n)
            worse = np.linalg.norm(inverses(slope[left][:, rows]), axis=(1, 2)) / best[left]
            served = ~(worse > np.fmax(WORSE, 1.25 * worse[first]))
            served[first] = True
            yield left[served], rows
            left = left[~served]


def leading_rows(matrix: Any, count: int) -> Any:
    """Return the numbers, in order, of so many rows of a matrix that are independent, by pivoted QR."""
    from scipy.linalg import qr  # here, because importing it costs more than the rest of refkin

    return np.sort(qr(matrix.T, mode="r", pivoting=True)[1][:count])


def inverses(stacked: Any) -> Any:
    """Return approximate inverses of (B, n, n), NaN where a matrix is singular or not finite."""
    try:
        return np.linalg.inv(stacked)
    except np.linalg.LinAlgError:  # one singular matrix refuses the batch: halve it until it stands alone
        if len(stacked) == 1:
            return np.full_like(stacked, np.nan)
        half = len(stacked) // 2
        return np.concatenate([inverses(stacked[:half]), inverses(stacked[half:])])
