"""Levenberg and Marquardt's method: the least-squares form of phi(q) = 0, for starts from which Newton goes astray.

It minimises |phi|^2 / 2, as solvers of spreadsheets do with closure errors (METU 3.9): each correction solves

    (phi_q^T phi_q + mu D) dq = -phi_q^T phi,

D the largest diagonal of phi_q^T phi_q so far, so that units do not matter; mu is lowered after a correction that made
|phi| smaller, raised after one that did not. So |phi| never grows, and near a root the method becomes Newton's. A
minimum with phi != 0 is no root: there it *stalls*, and says so. (J. J. More, Numerical Analysis Dundee, 1977.)
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import numpy as np

from refkin.analysis import position
from refkin.differences import EPS
from refkin.newton import NewtonResult, NewtonStatus, is_round_off
from refkin.system import System

MOST_TRIED = 60
"""Corrections that are tried at most."""
LOWER, RAISE = 0.2, 4.0
"""Factors of mu after a success and after a failure."""
FLAT = 1e-10
"""Cosine between phi and the range of phi_q below which a minimum is taken for reached."""


def least_squares(system: System, q0: Any, t: float) -> NewtonResult:
    """Solve phi(q, t) = 0 from an estimate by this method; a root is polished by Newton's, unless that leaves it.

    Parameters
    ----------
    system, q0, t
        As for `analysis.position`.
    """
    fit = levenberg_marquardt(lambda q: system.phi(q, t), lambda q: system.phi_q(q, t), q0)
    if not fit.converged:
        return fit
    end = position(system, fit.q, t, max_iterations=60)
    near = end.converged and np.max(np.abs(end.q - fit.q)) <= 1e-3 * max(1.0, np.max(np.abs(fit.q)))
    return end if near else fit


def levenberg_marquardt(phi: Callable[[Any], Any], phi_q: Callable[[Any], Any], q0: Any) -> NewtonResult:
    """Minimise |phi(q)|^2 from q0; never raises for numbers that fail. Of its history it returns the end alone.

    The status is singular at a minimum which is no root; `q` has the smallest |phi|.

    Parameters
    ----------
    phi, phi_q : callable
        From (n,) to (m,) and to (m, n), m >= n or not; phi of the order of 1 (it is compared with round-off).
    q0 : (n,) array
        The estimate.
    """
    q = np.atleast_1d(np.array(q0, float))
    with np.errstate(all="ignore"):  # what leaves the numbers' range is no success
        residual = np.asarray(phi(q), float) if np.isfinite(q).all() else np.full(1, np.nan)
        if not np.isfinite(residual).all():
            return _ended(NewtonStatus.NOT_FINITE, q, residual)
        diagonal, mu, slope = np.zeros(q.size), 1e-3, None
        for _ in range(MOST_TRIED):
            if is_round_off(residual, q):
                return _ended(NewtonStatus.CONVERGED, q, residual)
            if slope is None:
                slope = np.asarray(phi_q(q), float)
                if not np.isfinite(slope).all():
                    return _ended(NewtonStatus.NOT_FINITE, q, residual)
                diagonal = np.maximum(diagonal, np.linalg.norm(slope, axis=0))
                gradient = slope.T @ residual
            correction = _correction(slope, residual, np.sqrt(mu) * np.where(diagonal > 0, diagonal, 1.0))
            if correction is None:
                return _ended(NewtonStatus.NOT_FINITE, q, residual)
            too_small = np.max(np.abs(correction)) <= EPS * max(1.0, np.max(np.abs(q)))
            if too_small or np.all(np.abs(gradient) <= FLAT * diagonal * np.linalg.norm(residual)):
                return _ended(NewtonStatus.SINGULAR, q, residual)
            tried = np.asarray(phi(q + correction), float) if np.isfinite(q + correction).all() else residual * np.inf
            if np.linalg.norm(tried) < np.linalg.norm(residual):
                q, residual, slope, mu = q + correction, tried, None, mu * LOWER
            else:
                mu *= RAISE
    status = NewtonStatus.CONVERGED if is_round_off(residual, q) else NewtonStatus.ITERATION_LIMIT
    return _ended(status, q, residual)


def _correction(slope: Any, residual: Any, weight: Any) -> Any:
    """Return the minimiser of |slope dq + residual|^2 + |weight dq|^2; None where numbers are too large for one."""
    stacked = np.vstack([slope, np.diag(weight)])
    try:
        return np.linalg.lstsq(stacked, -np.concatenate([residual, np.zeros(len(weight))]), rcond=None)[0]
    except np.linalg.LinAlgError:
        return None


def _ended(status: NewtonStatus, q: Any, residual: Any) -> NewtonResult:
    return NewtonResult(status, q, q[None], residual[None], np.empty((0, q.size)))
