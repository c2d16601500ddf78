"""Observed orders and rates of convergence, from the part of a history that shows them; stopping tests.

An order is read off between the basin, where the error is not yet small, and round-off, where it no longer is error. A
history that leaves too few points there is inconclusive, which is not a pass.

The stopping tests are those of the source documents; that of ME451 is `refkin.newton.CorrectionNorm`.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from refkin.differences import EPS
from refkin.newton import StoppingTest


@dataclass(frozen=True)
class Observed:
    """A fitted order or rate: p of e_(k+1) = C e_k^p, r of e_(k+1) = r e_k, or the slope of log e over log h.

    `spread` is how far single estimates lie from it at most, `points` on how many it rests: with none it is
    inconclusive.
    """

    value: float
    spread: float
    points: int

    def is_near(self, expected: float, tolerance: float) -> bool:
        """Return whether value and expectation agree; never true when inconclusive."""
        return self.points > 0 and abs(self.value - expected) <= tolerance


NOTHING = Observed(np.nan, np.nan, 0)


def newton_order(errors: Sequence[float], floor: float = 64 * EPS, basin: float = 0.1) -> Observed:
    """Return the order of convergence from a history of errors.

    Each p_k = log(e_(k+2)/e_(k+1)) / log(e_(k+1)/e_k) uses three errors; the last is
    the nearest to the limit, so it is the value, and at least two are needed.

    Parameters
    ----------
    errors : sequence of float
        One per iterate, the first one first.
    floor, basin : float
        Errors count from the first below the basin to the last above the floor.
    """
    e = _trimmed(errors, floor, basin)
    estimates = [np.log(e[k + 2] / e[k + 1]) / np.log(e[k + 1] / e[k]) for k in range(len(e) - 2)]
    if len(estimates) < 2:
        return NOTHING
    return Observed(float(estimates[-1]), float(np.ptp(estimates[-2:])), len(estimates))


def linear_rate(errors: Sequence[float], floor: float = 64 * EPS, basin: float = 0.1) -> Observed:
    """Return the rate of linear convergence: the median of e_(k+1) / e_k, of at least four.

    Parameters
    ----------
    errors, floor, basin
        As for `newton_order`.
    """
    e = _trimmed(errors, floor, basin)
    ratios = e[1:] / e[:-1]
    if len(ratios) < 4:
        return NOTHING
    rate = float(np.median(ratios))
    return Observed(rate, float(np.max(np.abs(ratios - rate))), len(ratios))


def slope(h: Any, errors: Any, floor: float) -> Observed:
    """Return the slope of log error over log h, of at least four points.

    `spread` is the largest distance of a slope between neighbours from the fitted one.

    Parameters
    ----------
    h, errors : (N,) array
        Steps, and the error of each.
    floor : float
        Errors above it count.
    """
    h, errors = np.asarray(h, float), np.asarray(errors, float)
    keep = errors > floor
    if keep.sum() < 4:
        return NOTHING
    x, y = np.log(h[keep]), np.log(errors[keep])
    fitted = float(np.polyfit(x, y, 1)[0])
    local = np.diff(y) / np.diff(x)
    return Observed(fitted, float(np.max(np.abs(local - fitted))), int(keep.sum()))


def _trimmed(errors: Sequence[float], floor: float, basin: float) -> Any:
    """Return the errors from the first below `basin` to the last above `floor`."""
    e = np.asarray(errors, float)
    started = np.flatnonzero(e < basin)
    if not started.size:
        return e[:0]
    e = e[started[0] :]
    ended = np.flatnonzero(~(e > floor))
    return e[: ended[0]] if ended.size else e


def residual_or_correction(residual_limit: float = 1e-8, correction_limit: float = 1e-8) -> StoppingTest:
    """Stop when |phi| < residual_limit or |dq| < correction_limit (METU 3.9; printed there without absolute values)."""
    norm = np.linalg.norm
    return lambda phi, dq, q: bool(norm(phi) < residual_limit or norm(dq) < correction_limit)


def both_largest(residual_limit: float = 1e-8, correction_limit: float = 1e-8) -> StoppingTest:
    """Stop when the largest components of phi and of dq are both below their limits (ME581 notes)."""
    return lambda phi, dq, q: bool(np.max(np.abs(phi)) < residual_limit and np.max(np.abs(dq)) < correction_limit)


def scaled_norms(limit: float = 1e-8) -> StoppingTest:
    """Stop when |dq| / n or |phi| / m is below the limit, n and m the numbers of components (notes on Shabana)."""
    return lambda phi, dq, q: bool(min(np.linalg.norm(v) / np.size(v) for v in (dq, phi)) < limit)
