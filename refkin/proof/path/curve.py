"""The poses of a mechanism as a curve phi(q, t) = 0 in q and t together, along which t may turn.

Where the m x (n + 1) matrix [phi_q, phi_t] = [phi_q, -nu] has rank n the curve is smooth, with the null vector of that
matrix for its tangent, although phi_q may be singular: at a turning point of t. A point x stands for q and t in the
units of `scale`, in which a step of 1 is large for every coordinate: a size, a radian, and the time in which some
driver moves by as much. (H. B. Keller, Numerical solution of bifurcation and nonlinear eigenvalue problems, 1977.)
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np

from refkin.newton import NewtonResult, contracts, newton
from refkin.proof.numbers.preconditioned import leading_rows
from refkin.system import System

STEP = 1e-100
"""Step of complex-step derivatives: there is no difference, so no cancellation."""


@dataclass(frozen=True)
class Curve:
    """The curve of a system (compiled for velocity); `scale` (n + 1,) has the units of the coordinates and of t."""

    system: System
    scale: Any

    @classmethod
    def through(cls, system: System, q: Any, times: Any) -> Curve:
        """Return the curve with the unit of t in which the fastest driver moves by 1, judged at the given times."""
        rate = max(float(np.max(np.abs(system.nu(q, float(t))))) for t in times)
        unit = 1.0 / rate if rate > 0 else 1.0
        return cls(system, np.append(np.ones(system.n), unit))

    def point(self, q: Any, t: float) -> Any:
        """Return the point x (n + 1,) of a pose."""
        return np.append(q, t) / self.scale

    def pose(self, x: Any) -> tuple[Any, float]:
        """Return q (n,) and t of a point."""
        return x[:-1] * self.scale[:-1], float(x[-1] * self.scale[-1])

    def phi(self, x: Any) -> Any:
        """Return the residual (m,)."""
        return self.system.phi(*self.pose(x))

    def slope(self, x: Any) -> Any:
        """Return [phi_q, phi_t] in the units of the points, (m, n + 1); also of complex points."""
        q, t = x[:-1] * self.scale[:-1], x[-1] * self.scale[-1]
        t = t if np.iscomplexobj(x) else float(t)
        return np.column_stack([self.system.phi_q(q, t), -self.system.nu(q, t)]) * self.scale

    def bend(self, x: Any, psi: Any, rows: Any) -> Any:
        """Return the second derivatives of psi . phi, (n + 1, n + 1), psi being weights of n rows; by complex steps."""
        out = np.empty((len(x), len(x)))
        for k in range(len(x)):
            moved = x.astype(complex)
            moved[k] += STEP * 1j
            out[k] = psi @ np.imag(self.slope(moved)[rows]) / STEP
        return (out + out.T) / 2

    def tangent(self, x: Any, along: Any = None) -> Any:
        """Return the unit tangent, of its two directions that which goes along a vector (by default with t)."""
        direction = np.linalg.svd(self.slope(x))[2][-1]
        way = direction[-1] if along is None else direction @ along
        return direction if way >= 0 else -direction

    def clearance(self, x: Any) -> float:
        """Return the smallest singular value of [phi_q, phi_t]; 0 where curves cross."""
        return float(np.linalg.svd(self.slope(x), compute_uv=False)[self.system.n - 1])

    def rows(self, x: Any) -> Any:
        """Return n rows that are independent at a point."""
        n = self.system.n
        return np.arange(n) if self.system.m == n else leading_rows(self.slope(x), n)

    def determinant(self, x: Any, tangent: Any, rows: Any) -> tuple[float, float]:
        """Return sign and logarithm of det [phi_q, phi_t; tangent]: the sign cannot change along a smooth curve."""
        sign, log = np.linalg.slogdet(np.vstack([self.slope(x)[rows], tangent]))
        return float(sign), float(log)

    def corrected(self, guess: Any, across: Any) -> NewtonResult:
        """Return what Newton makes of a guess in the plane through it that `across` (n + 1,) is normal to."""
        return newton(
            lambda x: np.append(self.phi(x), across @ (x - guess)),
            lambda x: np.vstack([self.slope(x), across]),
            guess,
            max_iterations=30,
        )

    def stepped(self, x: Any, tangent: Any, h: float) -> Any:
        """Return the point of the curve at a step h along the tangent; None if Newton does not contract to one."""
        result = self.corrected(x + h * tangent, tangent)
        if not (result.converged and contracts(np.max(np.abs(result.corrections), axis=1))):
            return None
        return result.q
