"""Newton's method on callables: phi(q) = 0 by phi_q dq = -phi, with its whole history, in a bounded number of steps.

It knows nothing of mechanisms: `phi` maps (n,) to (m,), m >= n, `phi_q` to (m, n); scalars are accepted too. More
rows than unknowns are solved by least squares (redundant rows change nothing where they are consistent).
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, field
from enum import StrEnum
from typing import Any

import numpy as np

from refkin.differences import EPS
from refkin.errors import LONGEST, InvalidRequest, expect

CONTRACTION = 1 / 8
"""Largest second correction / first one: a quarter of the 1/2 that Newton-Kantorovich allows it at a proved root."""
ROUND_OFF = 32 * EPS
"""What rounding leaves of phi at a root, in units of the largest coordinate or of 1."""
TINY = 1e-6
"""First corrections below it are round-off of a good prediction, or too small to leave a regular branch."""


def is_round_off(residual: Any, q: Any) -> Any:
    """Return whether phi (m,) or (m, B) at q (n,) or (n, B) is what rounding leaves of it at a root."""
    return np.abs(residual).max(axis=0) <= ROUND_OFF * np.maximum(1.0, np.abs(q).max(axis=0))


def contracts(sizes: Sequence[float], tiny: float = TINY) -> bool:
    """Return whether Newton's second correction is small against its first (`sizes`): then no other root is near.

    A first correction below `tiny` is not looked at.
    """
    return len(sizes) < 2 or bool(sizes[1] <= CONTRACTION * sizes[0] or sizes[0] < tiny)


class NewtonStatus(StrEnum):
    """How an iteration ended."""

    CONVERGED = "converged"
    """The stopping test is met."""
    ITERATION_LIMIT = "the iteration limit was reached"
    SINGULAR = "the Jacobian is singular away from a root"
    NOT_FINITE = "the iterates left the domain of the equations"


StoppingTest = Callable[[Any, Any, Any], bool]
"""Says whether to stop, from phi(q_k), the correction dq_k and q_k + dq_k."""


@dataclass(frozen=True)
class CorrectionNorm:
    """Stop when |dq| < limit, Euclidean norm."""

    limit: float = 1e-8

    def __call__(self, residual: Any, correction: Any, q: Any) -> bool:
        return bool(np.linalg.norm(correction) < self.limit)


@dataclass
class RoundOff:
    """Stop when the correction is below the spacing of the numbers, or stalls with the residual at round-off.

    Near a double root each correction is half of the one before, down to about sqrt(EPS); from there they only
    jitter. So a small one, below 1e-6, has stalled if it is more than 0.6 of the one before: halves may go on.
    """

    previous: float = field(default=np.inf, repr=False)

    def __call__(self, residual: Any, correction: Any, q: Any) -> bool:
        size, scale = np.abs(correction).max(), max(1.0, np.abs(q).max())
        stalled = size <= 1e-6 * scale and size > 0.6 * self.previous and is_round_off(residual, q)
        self.previous = size
        return bool(size <= EPS * scale or stalled)


@dataclass(frozen=True)
class NewtonResult:
    """What an iteration did, all of it.

    `q` (n,) is the last of `iterates` (k + 1, n); `residuals` (k + 1, m) are phi at each of these, `corrections` (k, n)
    lead from each to the next; of a NaN in q0 they are one row. `residual` is the largest component of phi at `q`.
    """

    status: NewtonStatus
    q: Any
    iterates: Any
    residuals: Any
    corrections: Any

    @property
    def converged(self) -> bool:
        return self.status is NewtonStatus.CONVERGED

    @property
    def iterations(self) -> int:
        return len(self.corrections)

    @property
    def residual(self) -> float:
        return float(np.max(np.abs(self.residuals[-1])))


def newton(
    phi: Callable[[Any], Any],
    phi_q: Callable[[Any], Any],
    q0: Any,
    *,
    stop: StoppingTest | None = None,
    max_iterations: int = 50,
    jacobian_every: int = 1,
    damped: bool = False,
) -> NewtonResult:
    """Solve phi(q) = 0 from q0. Failure is a status of the result, no exception but of what makes no sense.

    Parameters
    ----------
    phi, phi_q : callable
        Residual and Jacobian; the Jacobian may be a difference quotient (`refkin.differences.jacobian`).
    q0 : float or (n,) array
        The estimate; if it is complex, so are the iterates, and the residual may be.
    stop : StoppingTest, optional
        `RoundOff()` by default, which goes on until arithmetic allows no more.
    max_iterations : int
        The cap on corrections.
    jacobian_every : int
        1 is full Newton, k renews the Jacobian every k corrections, 0 keeps the first (chord method).
    damped : bool
        Halve a correction until the residual decreases (for starts far from a root).
    """
    stop = RoundOff() if stop is None else stop
    for name, called in (("phi", phi), ("phi_q", phi_q), ("stop", stop)):
        expect(name, called, Callable)  # type: ignore[arg-type]
    for name, count in (("max_iterations", max_iterations), ("jacobian_every", jacobian_every)):
        if not (isinstance(count, int | np.integer) and count >= 0):
            raise InvalidRequest(name, "a whole number from 0 on", repr(count)[:LONGEST])
    if type(damped) not in (bool, np.bool_):
        raise InvalidRequest("damped", "True or False", repr(damped)[:LONGEST])
    q = _row(q0)
    if not np.isfinite(q).all():
        return NewtonResult(NewtonStatus.NOT_FINITE, q, q[None], q[None] * np.nan, np.empty((0, q.size)))
    iterates, corrections, slope = [q], [], None
    with np.errstate(all="ignore"):  # leaving the domain is a status, not a warning
        residuals = [_vector(phi(q))]
        status = NewtonStatus.ITERATION_LIMIT
        for k in range(max_iterations):
            if slope is None or (jacobian_every and k % jacobian_every == 0):
                slope = _matrix(phi_q(q), residuals[-1].size, q.size)
            if not (np.isfinite(residuals[-1]).all() and np.isfinite(slope).all()):
                status = NewtonStatus.NOT_FINITE
                break
            try:
                correction = solve_linear(slope, -residuals[-1])
            except np.linalg.LinAlgError:
                status = NewtonStatus.CONVERGED if not residuals[-1].any() else NewtonStatus.SINGULAR
                break
            if not np.isfinite(q + correction).all():
                status = NewtonStatus.NOT_FINITE
                break
            if damped:
                correction = _damp(phi, q, residuals[-1], correction)
            q = q + correction
            corrections.append(correction)
            iterates.append(q)
            residuals.append(_vector(phi(q)))
            if stop(residuals[-2], correction, q) and np.isfinite(residuals[-1]).all():
                status = NewtonStatus.CONVERGED
                break
    history = np.array(corrections).reshape(len(corrections), q.size)
    return NewtonResult(status, q, np.array(iterates), np.array(residuals), history)


def solve_linear(matrix: Any, right: Any) -> Any:
    """Return x with matrix x = right, (m, n) and (m,) or batches of them: by LU, or by least squares if m > n."""
    square = matrix.shape[0] == matrix.shape[1]
    if matrix.ndim == 2:
        return np.linalg.solve(matrix, right) if square else np.linalg.lstsq(matrix, right, rcond=None)[0]
    stacked, columns = matrix.transpose(2, 0, 1), right.T[..., None]
    if square:
        x = np.linalg.solve(stacked, columns)
    else:
        x = (inverse := np.linalg.pinv(stacked)) @ columns  # least squares, which NumPy has of one system alone
        x = x + inverse @ (columns - stacked @ x)  # the product leaves |J^+| |J| roundings
    return x[..., 0].T


def _row(q0: Any) -> Any:
    q = _vector(q0, "q0")
    unread = q0 is None or np.asarray(q0).dtype.kind in "SU"
    if unread or q.ndim != 1 or not q.size:
        raise InvalidRequest("q0", "a number or a row of numbers", repr(q0)[:LONGEST] if unread else f"shape {q.shape}")
    return q


def _matrix(value: Any, rows: int, columns: int) -> Any:
    slope = np.asarray(value)
    if slope.size != rows * columns or slope.dtype.kind in "OU" or (slope.ndim == 2 and slope.shape != (rows, columns)):
        raise InvalidRequest("phi_q", f"a matrix of shape {(rows, columns)}", f"shape {slope.shape} of {slope.dtype}")
    return slope.reshape(rows, columns)


def _vector(value: Any, name: str = "phi") -> Any:
    try:
        return np.atleast_1d(np.array(value, complex if np.iscomplexobj(value) else float))
    except (TypeError, ValueError, OverflowError):
        raise InvalidRequest(name, "numbers", repr(value)[:LONGEST]) from None


def _damp(phi: Callable[[Any], Any], q: Any, residual: Any, correction: Any) -> Any:
    """Return the largest of correction * 2^-k whose residual is smaller; 2^-20 of it if none is."""
    norm = np.linalg.norm(residual)
    for _ in range(20):
        if np.linalg.norm(_vector(phi(q + correction))) < norm:
            return correction
        correction = correction / 2
    return correction
