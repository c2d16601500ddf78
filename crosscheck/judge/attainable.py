"""How near to a pose any float64 code can come with the numbers of a scene, also where the pose is nearly singular.

With phi_q = U S V^T at the pose and a residual that is known to e, no code tells apart poses whose residual differs by
less. Along each singular vector the residual grows as s_k x; along the last one, where s may be 0, as
s x - K x^2 / 2, K = |u . phi_qq[v, v]|. So it errs by at most

    x_k = |u_k . e| / s_k  (k < n),       x_n = 2 f / (s + sqrt(s^2 - 2 K f)),  f = |u_n . e|,

the smaller root of s x - K x^2 / 2 = f, while there is one: s^2 > 2 K f. Nearer to the fold the two assemblies have the
same residual to within e, and x_n is what takes a code from the farther one to beyond the nearer one:
x_n = (s + sqrt(s^2 + 2 K f)) / K; at the fold sqrt(2 f / K). What x_n moves the other coordinates by is
|phi_qq[v, v]| x_n^2 / 2, carried by their own s_k.

e is the running error of the formulas with the one safety factor of the budgets, on both sides, and what the result is
rounded to is added, as there (`crosscheck.judge.budget`).
"""

from __future__ import annotations

from typing import Any

import numpy as np

from crosscheck.judge.budget import BOTH_SIDES, SAFETY
from crosscheck.judge.running_error import Running, U, errors, running
from refkin.system import System

STEP = 1e-100
ROUNDINGS = 6 * U
"""Cosine or sine, product and sum for each body's arm, on both sides of a comparison."""


def residual_error(system: System, q: Any, t: float) -> Any:
    """Return what rounding leaves of the residual (m,) at a pose (n,)."""
    rows = system.phi(running(q, U * np.abs(q)), Running(np.float64(t)))
    return BOTH_SIDES * SAFETY * errors(rows, ())


def attainable(system: System, q: Any, t: float) -> Any:
    """Return the error (n,) that no float64 code can be blamed for, in scaled coordinates; inf where nothing is held.

    Parameters
    ----------
    system : System
        Compiled in its mechanism's own unit.
    q : (n,) array
        The pose, in the system's coordinates.
    """
    e = residual_error(system, q, t)
    u, s, vt = np.linalg.svd(system.phi_q(q, t), full_matrices=False)
    bend = _second_derivative(system, q, t, vt[-1])
    f = np.abs(u.T) @ e
    last = fold(s[-1], abs(float(u[:, -1] @ bend)), float(f[-1]))
    with np.errstate(divide="ignore", invalid="ignore"):
        others = (f[:-1] + np.abs(u.T[:-1] @ bend) * last**2 / 2) / s[:-1]
    return np.abs(vt[:-1].T) @ others + np.abs(vt[-1]) * last + _handed_over(system, q)


def fold(s: float, k: float, f: float) -> float:
    """Return the largest x that a residual of f hides where the residual is s x - k x^2 / 2."""
    if s * s > 2 * k * f:
        return float(2 * f / (s + np.sqrt(s * s - 2 * k * f)))
    return float((s + np.sqrt(s * s + 2 * k * f)) / k) if k else np.inf


def _second_derivative(system: System, q: Any, t: float, v: Any) -> Any:
    """Return phi_qq[v, v] (m,) by a complex step."""
    return np.imag(system.phi_q(q + 1j * STEP * v, t)) @ v / STEP


def _handed_over(system: System, q: Any) -> Any:
    """Return what it costs (n,) to state the pose in metres, seen from the scene's origin."""
    metres = np.abs(system.to_physical(q)) / np.where(system.angles, 1.0, system.unit.size)
    return ROUNDINGS * np.maximum(len(system.mechanism.bodies), metres)
