"""One pose, or many at once: full Newton on an engine's equations, its velocities, and whether it is regular.

Nothing here knows an engine: residual, Jacobian and right sides of a batch of poses come from `Equations`. An engine
with a Newton of its own has `closed` besides, (q, t, last or None) -> poses, Jacobians, largest residuals: it is called
in the place of ours, on guesses (B, n), which are predictions from a pose `last` where there is one; so is `along`,
(last, t) -> poses, each predicted from those before it, as far as it goes. If it is not one that `predicts`, what it
says is believed, whatever residual it leaves.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import lru_cache
from itertools import groupby
from typing import Any, Protocol, Self

import numpy as np

from crosscheck.engines import Array
from refkin.motion import SINGULAR
from refkin.motion_laws import Law
from refkin.proof.numbers.extrema import extrema as turning_points

EPS = float(np.finfo(float).eps)
CAP = 60
"""Corrections that Newton may take; at a fold, where the error halves, it needs about 26 to reach round-off."""
CONTRACTION = 0.25
"""A correction larger than this part of the one before says that the prediction was too far off."""
STALLED = 0.9
"""A correction larger than this part of the one before, at a residual of round-off, is noise: the error of a regular
pose shrinks faster, so does that of a fold (1/2), and of four roots in one (3/4). Noise may shrink for ever."""
HALF, LONGER = 0.05, 1.75
"""How near 1/2 a correction's part of the one before tells of a fold, and how much longer it is made then: what is left
becomes an eighth, on its side of the fold. So in a batch, once others are found: its poses are guesses (`march`)."""
SQUARED = EPS / 8.0
"""What Newton's convergence leaves of an error that its next correction only would exchange for other rounding."""
LEFT = 16.0
"""Units of rounding up to which it is believed that so little was left: an error that bends otherwise is larger."""
TRUST = 0.25
"""The largest correction (rad, or sizes) of a predicted pose; what lies further off may be another branch."""


class Equations(Protocol):
    """Constraint equations at B poses; n coordinates and m rows of order one, lengths in sizes of the mechanism.

    `laws` are those of the drivers, as the scene has them.
    """

    laws: Sequence[Law]

    def rows(self, q: Array, t: Array) -> tuple[Array, Array]:
        """Return residual (B, m) and Jacobian (B, m, n) at q (B, n), t (B,)."""

    def nu(self, q: Array, t: Array) -> Array:
        """Return the right side (B, m) of the velocities."""

    def gamma(self, q: Array, qd: Array, t: Array) -> Array:
        """Return the right side (B, m) of the accelerations."""

    def round_off(self, q: Array, t: Array) -> Array:
        """Return a bound on what rounding leaves of residuals that are zero, (B, m) or (B, 1)."""


@dataclass(frozen=True)
class Poses:
    """B poses, NaN where Newton found none.

    Times (B,), coordinates (B, n), Jacobians (B, m, n), largest components of the residuals (B,), inverses of the
    Jacobians (B, n, m), and velocities (B, n), which are NaN, too, where a pose is not `regular`.
    """

    t: Array
    q: Array
    jacobian: Array
    residual: Array
    inverse: Array
    qd: Array
    regular: Any

    @property
    def known(self) -> Any:
        """Which of them there are, (B,)."""
        return np.isfinite(self.residual)

    def __getitem__(self, which: Any) -> Self:
        return type(self)(*[part[which] for part in vars(self).values()])

    @classmethod
    def joined(cls, parts: Sequence[Poses]) -> Self:
        """Return several batches as one."""
        return cls(*map(np.concatenate, zip(*(vars(part).values() for part in parts), strict=True)))


def close(equations: Equations, q: Array, t: Array, *, near: Array | None = None) -> Poses:
    """Return the poses to which full Newton converges.

    Converged means that the residual is at round-off and the correction has stalled.

    Parameters
    ----------
    equations, q, t : Equations, (B, n) array, (B,) array
        Where to begin, at which times [s].
    near : (B, n) array, optional
        Poses from which q are predictions: then each correction must contract and the first not be large.
    """
    own = getattr(equations, "closed", None)
    if own is not None:
        return with_velocities(equations, t, *own(q, t, near))
    count, n = q.shape
    guess, now, active, previous, left = q, t, np.arange(count), *np.full((2, count), np.inf)
    done = list[tuple[Any, Array, Array, Array]]()
    for _ in range(CAP):
        residual, jacobian = equations.rows(q, now)
        correction = solve(jacobian, residual)
        size = largest(correction)
        on = size <= 1.0 / EPS  # an angle that large has no digit left
        closed = within(residual, equations.round_off(q, now))
        if near is not None:
            on &= closed | ((size <= CONTRACTION * previous) & (size <= TRUST))
        if np.count_nonzero(closed):
            units = largest(correction / (EPS * (1.0 + np.abs(q))))  # each coordinate's own: a hinge may sit far out
            noise = (size > STALLED * previous) | (units <= 1.0) | (left <= SQUARED) & (units <= LEFT)
            stalled = on & closed & noise
            on &= ~stalled
            good = stalled if near is None else stalled & (largest(q - guess[active]) <= TRUST)
            if np.count_nonzero(good):
                done.append((active[good], q[good], jacobian[good], largest(residual[good])))
        if near is None and len(size) < count:
            correction[(np.abs(size / previous - 0.5) < HALF) & ~closed] *= LONGER
        if previous[0] < np.inf:
            left = size * (size / previous) ** 2  # the error is squared
        q, previous = q - correction, size
        if np.count_nonzero(on) < len(on):
            active, q, previous, left = active[on], q[on], previous[on], left[on]
            if not active.size:
                break
            now = t[active]
    shapes = ((count, n), (count, *jacobian.shape[1:]), (count,))
    poses = [np.full(shape, np.nan) for shape in shapes]
    for which, *parts in done:
        for whole, part in zip(poses, parts, strict=True):
            whole[which] = part
    return with_velocities(equations, t, *poses)


def nowhere(like: Poses, t: float) -> Poses:
    """Return no pose at t."""
    nothing = {name: np.full_like(part, np.nan) for name, part in vars(like).items()}
    return Poses(**{**nothing, "t": np.array([t]), "regular": np.zeros(1, bool)})


def with_velocities(equations: Equations, t: Array, q: Array, jacobian: Array, residual: Array) -> Poses:
    """Return poses where residuals are finite, with velocities where they are regular: NaN elsewhere.

    A residual r is worth a correction of r / sigma. By Kantorovich's theorem one root is near and alone if
    K r / sigma^2 < 1/2; with K of order 2 (rows of coordinates of order one) a pose beyond that may be a singular one.

    Parameters
    ----------
    equations, t : Equations, (B,) array
        Times [s].
    q, jacobian, residual : (B, n), (B, m, n), (B,) array
        Poses, and at them phi_q and the largest residual; NaN where there is none.
    """
    count, m, n = jacobian.shape
    inverse, qd = np.full((count, n, m), np.nan), np.full((count, n), np.nan)
    regular = np.isfinite(residual)
    if np.count_nonzero(regular):
        some = _which(regular)
        inverse[some] = inverses(jacobian[some])
        off = residual[some] * getattr(equations, "predicts", True)
        regular[some] = _regular(jacobian[some], inverse[some], np.maximum(SINGULAR, 2.0 * np.sqrt(off)))
    if np.count_nonzero(regular):
        some = _which(regular)
        qd[some] = solve(jacobian[some], equations.nu(q[some], t[some]))
        regular &= np.isfinite(qd).all(axis=1)
    return Poses(t, q, jacobian, residual, inverse, qd, regular)


def _which(mask: Any) -> Any:
    """Return what picks the samples of a mask: all of them, if there is no other, without a copy."""
    return mask if np.count_nonzero(mask) < len(mask) else slice(None)


def within(residual: Array, bound: Array) -> Any:
    """Return whether all residuals of a pose are within a bound, (B,)."""
    return np.logical_and.reduce(np.abs(residual) <= bound, axis=1)


def _regular(jacobian: Array, inverse: Array, least: Array) -> Any:
    """Return whether singular values are at least so large (B,), of which the inverse's norm is a bound."""
    _, m, n = jacobian.shape
    regular: Any = (norm(inverse) <= 1.0 / least) & (m == n or n == 0)  # else truncated
    for k in np.flatnonzero(~regular):
        regular[k] = np.linalg.svd(jacobian[k], compute_uv=False)[-1] >= least[k]
    return regular


def norm(matrix: Array) -> Array:
    """Return Frobenius norms (B,) of matrices (B, n, m)."""
    return np.sqrt(np.add.reduce(matrix * matrix, axis=(1, 2)))


def solve(matrix: Array, right: Array) -> Array:
    """Return x (B, n) with matrix (B, m, n) x = right (B, m), by least squares if rows are redundant.

    Or several, (B, n, k) of (B, m, k). NaN where there is no finite one.
    """
    _, m, n = matrix.shape
    if right.ndim == 2:
        return solve(matrix, right[:, :, None])[:, :, 0]
    if n != m:
        inverse = inverses(matrix)
        x = inverse @ right
        x = x + inverse @ (right - matrix @ x)  # a product with an inverse leaves more than rounding
    else:
        x = _each(np.linalg.solve, matrix, right, out=right)
    if not math.isfinite(x.sum()):
        x[~np.isfinite(x).all(axis=(1, 2))] = np.nan
    return x


def inverses(matrix: Array) -> Array:
    """Return inverses (B, n, m) of matrices (B, m, n), pseudo-inverses if rows are redundant; NaN where singular."""
    _, m, n = matrix.shape
    if m == n:
        return _each(np.linalg.inv, matrix, out=matrix)
    return _each(lambda a: np.linalg.pinv(a, rcond=EPS * max(m, n)), matrix, out=matrix.transpose(0, 2, 1))


def _each(function: Callable[..., Array], *given: Array, out: Array) -> Array:
    """Return a function of batches, sample by sample where one singular matrix spoils the batch."""
    try:
        return function(*given)
    except np.linalg.LinAlgError:
        if len(out) == 1:
            return np.full_like(out, np.nan)
        single = (tuple(array[k : k + 1] for array in (*given, out)) for k in range(len(out)))
        return np.concatenate([_each(function, *one[:-1], out=one[-1]) for one in single])


def largest(values: Array) -> Array:
    """Return the largest component (B,) of vectors (B, n)."""
    largest: Array = np.maximum.reduce(np.abs(values), axis=1, initial=0.0)
    return largest


def extrema(laws: Sequence[Any], times: Array) -> Array:
    """Return where laws turn back between times, in order: in each step where a law is highest, and where lowest.

    And a time between these two: a step from rest to rest says nothing of how fast it is.
    """
    found = set[float]()
    for law in laws:
        turns = _turns(law, float(times[0]), float(times[-1]))
        values = law(np.array(turns)).tolist() if turns else []
        for _, own in groupby(range(len(turns)), key=times.searchsorted(turns).tolist().__getitem__):
            inside = list(own)
            low, high = (turns[pick(inside, key=values.__getitem__)] for pick in (min, max))
            found.update((low, 0.5 * (low + high), high))
    return np.array(sorted(found.difference(times.tolist())))


@lru_cache(maxsize=64)
def _turns(law: Any, a: float, b: float) -> tuple[float, ...]:
    """Return where a law of a scene turns back between two times; of any other function that is not known."""
    try:
        return tuple(turning_points(law, a, b))
    except TypeError:
        return ()


class Tabulated:
    """A law whose values are kept; at `times`, those that will be asked for, it is asked once for all of them."""

    def __init__(self, law: Callable[..., Any], times: Sequence[float] = ()) -> None:
        self.law, self._times = law, np.array(times, float)
        self._places = {t: k for k, t in enumerate(self._times.tolist())}
        self._tables = dict[int, Array]()
        self._values = dict[tuple[int, Any], Any]()

    def __call__(self, t: Any, order: int) -> Any:
        """Return the derivative of the given order at a time, or at times (B,): then read-only."""
        key = order, t if isinstance(t, float) else t.tobytes()
        if key not in self._values:
            self._values[key] = self._one(t, order) if isinstance(t, float) else self._row(t, order)
        return self._values[key]

    def _one(self, t: float, order: int) -> float:
        place = self._places.get(t)
        return float(self.law(t, order) if place is None else self._table(order)[place])

    def _row(self, t: Array, order: int) -> Array:
        places = [self._places.get(at) for at in t.tolist()]
        row = self._asked(t, order) if None in places else self._table(order).take(places)  # type: ignore[arg-type]
        row.flags.writeable = False
        return row

    def _table(self, order: int) -> Array:
        if order not in self._tables:
            self._tables[order] = self._asked(self._times, order)
        return self._tables[order]

    def _asked(self, t: Array, order: int) -> Array:
        values = np.array(self.law(t, order), float)
        return values if values.shape == t.shape else np.full(t.shape, values)
