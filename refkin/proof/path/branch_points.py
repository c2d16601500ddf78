"""Where two curves of poses cross: change points. Found exactly, with both tangents.

At a simple bifurcation [phi_q, phi_t] has one row too few: psi^T [phi_q, phi_t] = 0 for one psi, and two null vectors.
The system in x = (q, t), psi and mu (after Werner and Spence, SIAM J. Numer. Anal. 21, 1984)

    phi(x) + mu psi = 0     [phi_q, phi_t]^T psi = 0     psi . psi = 1

is regular there, so Newton's method finds the point to round-off. mu tells what it is: 0 at a bifurcation, up to what a
few roundings of the mechanism's lengths explain; elsewhere it says by how much the curves pass by each other (for a
four-bar near its change point, about its slack).

With z = N a in the plane of null vectors N, phi = 0 asks to second order that psi . phi_xx[z, z] = a^T B a = 0: two
real directions a if det B < 0, none if det B > 0 (an isolated pose), and no answer to second order if det B = 0.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
from flint import arb, ctx

from refkin.differences import EPS
from refkin.newton import newton
from refkin.proof.numbers.exact import exact_system
from refkin.proof.path.curve import Curve

ROUND_OFF = 16 * EPS
"""|mu| up to which curves are taken to cross: what a few roundings of the mechanism's lengths explain [sizes]."""
BITS = 113
"""Precision in which mu is computed: at an angle of many turns float64 would only give the rounding of the angle."""
FLAT = 1e-6
"""det B in units of |B|^2 up to which tangents are not decided to second order."""


@dataclass(frozen=True)
class Crossing:
    """A singular point of the curve: x (n + 1,), mu, the form B (2, 2) and the null vectors (n + 1, 2) it is on."""

    x: Any
    mu: float
    form: Any
    null: Any

    @property
    def is_bifurcation(self) -> bool:
        """Whether the curves cross, to round-off."""
        return abs(self.mu) <= ROUND_OFF

    @property
    def tangents(self) -> tuple[Any, ...]:
        """Unit tangents (n + 1,) of the curves that cross here; none if they are not decided to second order."""
        return tuple(self.null @ a for a in roots(self.form))


def crossing(curve: Curve, guess: Any) -> Crossing | None:
    """Return the singular point that Newton finds from a guess of x; None if it finds none."""
    rows = curve.rows(guess)
    n = len(rows)
    psi = np.linalg.svd(curve.slope(guess)[rows])[0][:, -1]
    start = np.concatenate([guess, psi, [-(psi @ curve.phi(guess)[rows])]])

    def equations(y: Any) -> Any:
        x, psi, mu = y[: n + 1], y[n + 1 : -1], y[-1]
        return np.concatenate([curve.phi(x)[rows] + mu * psi, curve.slope(x)[rows].T @ psi, [psi @ psi - 1]])

    def slope(y: Any) -> Any:
        x, psi, mu = y[: n + 1], y[n + 1 : -1], y[-1]
        first, second = curve.slope(x)[rows], curve.bend(x, psi, rows)
        column, row = psi[:, None], np.zeros((1, n + 1))
        top = np.hstack([first, mu * np.eye(n), column])
        middle = np.hstack([second, first.T, np.zeros((n + 1, 1))])
        return np.vstack([top, middle, np.hstack([row, 2 * psi[None], [[0.0]]])])

    result = newton(equations, slope, start, max_iterations=25)
    if not result.converged or result.residual > 1e-10:
        return None
    x, psi = result.q[: n + 1], result.q[n + 1 : -1]
    null = np.linalg.svd(curve.slope(x)[rows])[2][-2:].T
    return Crossing(x, _mu(curve, x, psi, rows), null.T @ curve.bend(x, psi, rows) @ null, null)


def _mu(curve: Curve, x: Any, psi: Any, rows: Any) -> float:
    """Return mu = -psi . phi(x), in balls: to first order it feels no error of x, and of psi only mu times as much."""
    q, t = curve.pose(x)
    with ctx.workprec(BITS):
        phi = exact_system(curve.system, BITS).phi(_objects(q), arb(t))[rows]
        return float(-sum((arb(float(w)) * p for w, p in zip(psi, phi, strict=True)), arb(0)))


def _objects(q: Any) -> Any:
    """Return numbers as an object array of exact balls."""
    out = np.empty(len(q), object)
    out[:] = [arb(v) for v in q.tolist()]
    return out


def roots(form: Any) -> tuple[Any, ...]:
    """Return the directions a (unit vectors) with a^T B a = 0: two, or none where B is definite or degenerate."""
    (a, b), (_, c) = form
    size = max(abs(a), abs(b), abs(c))
    if size == 0.0 or b * b - a * c <= FLAT * size * size:
        return ()
    root = b + np.copysign(np.sqrt(b * b - a * c), b)  # no cancellation
    directions = [np.array([-root, a]), np.array([c, -root])]
    return tuple(v / np.linalg.norm(v) for v in directions)
