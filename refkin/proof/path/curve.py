"""The poses of a mechanism as a curve phi(q, t) = 0 in q and t together, along which t may turn.

Where the m x (n + 1) matrix [phi_q, phi_t] = [phi_q, -nu] has rank n the curve is smooth, with the null vector of that
matrix for its tangent, although phi_q may be singular: at a turning point of t. A point x stands for q and t in the
units of `scale`, in which a step of 1 is large for every coordinate: a size, a radian, and the time in which some
driver moves by as much. (H. B. Keller, Numerical solution of bifurcation and nonlinear eigenvalue problems, 1977.)

Two curves cross at a change point, which is computed exactly, with both tangents. At a simple bifurcation [phi_q,
phi_t] has one row too few: psi^T [phi_q, phi_t] = 0 for one psi, and two null vectors. The system in x = (q, t), psi
and mu (after Werner and Spence, SIAM J. Numer. Anal. 21, 1984)

    phi(x) + mu psi = 0     [phi_q, phi_t]^T psi = 0     psi . psi = 1

is regular there, so Newton's method finds the point to round-off. mu tells what it is: 0 at a bifurcation, up to what a
few roundings of the mechanism's numbers explain, each of its own size; elsewhere it says by how much the curves pass by
each other (for a four-bar near its change point, about its slack).

With z = N a in the plane of null vectors N, phi = 0 asks to second order that psi . phi_xx[z, z] = a^T B a = 0: two
real directions a if det B < 0, none if det B > 0 (an isolated pose), and no answer to second order if det B = 0. Where
k rows are missing at once there are k forms on k + 1 null vectors, and up to 2^k curves. All this is of n rows; what is
redundant has forms of its own, which directions have to satisfy, too: if one alone does, one curve goes on, and none
crosses it.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property
from typing import Any

import numpy as np
from flint import arb, ctx

from refkin.differences import Scheme
from refkin.differences import step as step_of
from refkin.newton import NewtonResult, RoundOff, contracts, newton
from refkin.proof.assembly.search import halton
from refkin.proof.numbers.bounded import InputError
from refkin.proof.numbers.exact import exact_system
from refkin.proof.numbers.inputs import input_effect
from refkin.proof.numbers.preconditioned import leading_rows
from refkin.proof.pose.krawczyk import objects
from refkin.system import System

MISSING = 1e-9
"""What a pose misses [sizes, rad] above which no rounding explains it: least squares of redundant rows end so."""


def is_pose(result: NewtonResult) -> bool:
    """Whether Newton's method did not end at a minimum, where redundant rows contradict each other."""
    return bool(are_poses(result.residuals[-1], result.q))


def are_poses(phi: Any, q: Any) -> Any:
    """Return the same of phi (m,) or (m, B) at the end of Newton's method, q (n,) or (n, B)."""
    return np.max(np.abs(phi), axis=0) <= MISSING * np.maximum(1.0, np.max(np.abs(q), axis=0))


@dataclass(frozen=True)
class Curve:
    """The curve of a system (compiled for velocity); `scale` (n + 1,) has the units of the coordinates and of t."""

    system: System
    scale: Any

    @classmethod
    def through(cls, system: System, q: Any, times: Any) -> Curve:
        """Return the curve through a pose (n,), with the unit of t in which the fastest driver moves by 1.

        Drivers' rates are compared at the times [s]; the system is compiled in its mechanism's own unit.
        """
        rate = float(np.max([np.abs(system.nu(q, float(t))) for t in times]))
        unit = 1.0 / rate if rate else 1.0
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
        """Return [phi_q, phi_t] in the units of the points, (m, n + 1)."""
        q, t = self.pose(x)
        return np.column_stack([self.system.phi_q(q, t), -self.system.nu(q, t)]) * self.scale

    def bend(self, x: Any, psi: Any, rows: Any) -> Any:
        """Return the second derivatives of psi . phi, (n + 1, n + 1), psi being weights of n rows.

        By complex steps along all coordinates in one batch: each by itself takes as long as all of them. Other rows
        have no weight instead of being left out: a Jacobian for each coordinate is large, and is not copied.
        """
        step, weights = 1j * step_of(Scheme.COMPLEX_STEP, x), np.zeros(self.system.m)
        weights[rows] = psi
        moved = (x[:, None] + np.diag(step)) * self.scale[:, None]
        q, t = moved[:-1], moved[-1]
        there = np.vstack([np.tensordot(weights, self.system.phi_q(q, t), 1), -weights @ self.system.nu(q, t)])
        bent = np.imag(there) * self.scale[:, None] / step.imag
        return (bent + bent.T) / 2

    def tangent(self, x: Any, along: Any = None) -> Any:
        """Return the unit tangent, of its two directions that which goes along a vector (by default with t)."""
        direction = np.linalg.svd(self.slope(x))[2][-1]
        way = direction[-1] if along is None else direction @ along
        return direction if way >= 0 else -direction

    def clearance(self, x: Any) -> float:
        """Return the smallest singular value of [phi_q, phi_t]; 0 where curves cross."""
        return float(np.linalg.svd(self.slope(x), compute_uv=False)[self.system.n - 1])

    def is_locked(self, x: Any) -> bool:
        """Whether redundant rows contradict each other in the rates: then there is a pose, and no curve through it."""
        n = self.system.n
        return self.system.m > n and bool(np.linalg.svd(self.slope(x), compute_uv=False)[n] > FLAT)

    def rows(self, x: Any) -> Any:
        """Return n rows that are independent at a point."""
        n = self.system.n
        return np.arange(n) if self.system.m == n else leading_rows(self.slope(x), n)

    def side(self, x: Any, tangent: Any, rows: Any) -> float:
        """Return the sign of det [phi_q, phi_t; tangent], of rows (n,): it cannot change along a smooth curve."""
        return float(np.linalg.slogdet(np.vstack([self.slope(x)[rows], tangent]))[0])

    def corrected(self, guess: Any, across: Any) -> NewtonResult:
        """Return what Newton makes of a guess in the plane through it that `across` (n + 1,) is normal to."""
        return newton(
            lambda x: np.append(self.phi(x), across @ (x - guess)),
            lambda x: np.vstack([self.slope(x), across]),
            guess,
            max_iterations=30,
        )

    def stepped(self, x: Any, tangent: Any, h: float) -> Any:
        """Return the point of the curve at a step h from x along its unit tangent, in the units of `scale`.

        None if Newton does not contract to one.
        """
        result = self.corrected(x + h * tangent, tangent)
        if not (result.converged and is_pose(result) and contracts(np.max(np.abs(result.corrections), axis=1))):
            return None
        return result.q


ROUNDED = InputError(2.0**-50)
"""A few roundings of a number: curves cross where they explain mu."""
BITS = 113
"""Precision in which mu is computed: at an angle of many turns float64 would only give the rounding of the angle."""
SATISFIED = 1e-6
"""Value of a form of size 1 that counts as zero: a singular pose is known to the root of round-off.

A double root of forms is known to the root of that."""
STARTS = 48
"""Directions from which tangents are sought where several equations must hold."""
BESIDE = 1e-3
"""Singular value of [phi_q, phi_t] up to which a point is looked at as one beside a crossing of many curves."""
FLAT = 1e-6
"""det B in units of |B|^2 up to which tangents are not decided to second order."""


@dataclass(frozen=True)
class Crossing:
    """A singular point of the curve: x (n + 1,), mu, the k forms B (k, k + 1, k + 1) and the null vectors they are on.

    `explained` is the |mu| that rounding of the mechanism's numbers explains. Where k is above 1 both are those of that
    psi whose mu is the least explained. `others` (j, k + 1, k + 1) are forms of all rows, if some are redundant.
    """

    x: Any
    mu: float
    explained: float
    forms: Any
    null: Any
    others: Any = ()

    @property
    def is_bifurcation(self) -> bool:
        """Whether the curves cross, to round-off."""
        return abs(self.mu) <= self.explained

    @property
    def is_decided(self) -> bool:
        """Whether the curves cross, and in which directions."""
        return self.is_bifurcation and bool(self.tangents)

    @cached_property
    def tangents(self) -> tuple[Any, ...]:
        """Unit tangents (n + 1,) of the curves that cross here; none if they are not decided to second order.

        k quadratic forms have at most 2^k common directions (Bezout): these are all of them, or none is returned. Of
        them those that no redundant row contradicts.
        """
        directions = roots(self.forms[0]) if len(self.forms) == 1 else common_roots(list(self.forms))
        if len(directions) != 2 ** len(self.forms):
            return ()
        return tuple(self.null @ a for a in directions if all(abs(a @ b @ a) <= SATISFIED for b in self.others))


def crossing(curve: Curve, guess: Any, reach: float = np.inf) -> Crossing | None:
    """Return the singular point that Newton finds from a guess; None if it finds none.

    Parameters
    ----------
    curve, guess : Curve, (n + 1,) array
    reach : float
        Iterates that leave the guess further are not waited for: they come to no point nearby.
    """
    rows = curve.rows(guess)
    n = len(rows)
    left, sizes, _ = np.linalg.svd(curve.slope(guess)[rows])
    count = int(np.sum(sizes <= BESIDE))
    if count > 1 and (of_many := _of_many(curve, guess, rows, count)) and of_many.is_bifurcation:
        return of_many
    psi = left[:, -1]
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

    settled = RoundOff()

    def stop(residual: Any, correction: Any, y: Any) -> bool:
        return bool(np.abs(y[: n + 1] - guess).max() > reach) or settled(residual, correction, y)

    result = newton(equations, slope, start, stop=stop, max_iterations=25)
    if not result.converged or result.residual > 1e-10:
        return None
    x, psi = result.q[: n + 1], result.q[n + 1 : -1]
    return _singular(curve, x, rows, psi[None])


def _of_many(curve: Curve, guess: Any, rows: Any, count: int) -> Crossing | None:
    """Return the point near a guess at which so many rows (> 1) depend at once: there the system above is singular.

    With all psi and all null vectors z, phi = 0 and psi . [phi_q, phi_t] z = 0 are more equations than unknowns, and
    have a solution where linkages stacked on each other come to their change points together (Gauss and Newton).
    """
    x = guess
    for _ in range(12):
        first = curve.slope(x)[rows]
        if not np.isfinite(first).all():  # it runs away, or beyond the end of a table
            return None
        left, _, directions = np.linalg.svd(first)
        psis, null = left[:, -count:].T, directions[-count - 1 :].T
        residual = np.append(curve.phi(x)[rows], psis @ first @ null)
        step = np.linalg.lstsq(np.vstack([first, *(null.T @ curve.bend(x, psi, rows) for psi in psis)]), residual)[0]
        x = x - step
    return _singular(curve, x, rows, psis) if np.max(np.abs(residual)) <= 1e-10 else None


def _singular(curve: Curve, x: Any, rows: Any, psis: Any) -> Crossing | None:
    """Return a singular point with its weights (k, n) of rows; None if not just so many rows depend there."""
    count = len(psis)
    _, sizes, directions = np.linalg.svd(curve.slope(x)[rows])
    if (count < len(rows) and sizes[-count - 1] <= FLAT) or (count > 1 and sizes[-count] > FLAT):
        return None
    null = directions[-count - 1 :].T
    q, t = curve.pose(x)
    effect = input_effect(curve.system, q[:, None], np.array([t]), ROUNDED)[rows, 0]
    both = [(_mu(curve, x, psi, rows), float(np.abs(psi) @ effect)) for psi in psis]
    mu, explained = max(both, key=lambda each: abs(each[0]) - each[1])
    forms = np.array([null.T @ curve.bend(x, psi, rows) @ null for psi in psis])
    if curve.system.m == len(rows):
        return Crossing(x, mu, explained, forms, null)
    left, sizes, _ = np.linalg.svd(curve.slope(x))
    if sizes[len(rows) - count] > FLAT:
        return None
    every = left[:, len(rows) - count :].T
    others = [null.T @ curve.bend(x, psi, np.s_[:]) @ null for psi in every]
    return Crossing(x, mu, explained, forms, null, np.array(others))


def _mu(curve: Curve, x: Any, psi: Any, rows: Any) -> float:
    """Return mu = -psi . phi(x), in balls: to first order it feels no error of x, and of psi only mu times as much."""
    q, t = curve.pose(x)
    with ctx.workprec(BITS):
        phi = exact_system(curve.system, BITS).phi(objects([arb(v) for v in q.tolist()]), arb(t))[rows]
        return float(-sum((arb(float(w)) * p for w, p in zip(psi, phi, strict=True)), arb(0)))


def roots(form: Any) -> tuple[Any, ...]:
    """Return the directions a (unit vectors) with a^T B a = 0: two, or none where B is definite or degenerate."""
    (a, b), (_, c) = form
    size = max(abs(a), abs(b), abs(c))
    if size == 0.0 or b * b - a * c <= FLAT * size * size:
        return ()
    root = b + np.copysign(np.sqrt(b * b - a * c), b)  # no cancellation
    directions = [np.array([-root, a]), np.array([c, -root])]
    return tuple(v / np.linalg.norm(v) for v in directions)


def common_roots(forms: list[Any]) -> tuple[Any, ...]:
    """Return the unit vectors a, up to sign, with a^T B a = 0 for all forms, by Newton from many directions."""
    count = len(forms[0])
    directions: list[Any] = []
    for k in range(1, STARTS + 1):
        a = np.array([2 * x - 1 for x in halton(k, count)])
        for _ in range(30):
            residual = np.append([a @ b @ a for b in forms], a @ a - 1)
            slope = np.vstack([*(2 * a @ b for b in forms), 2 * a])
            if np.linalg.cond(slope) > 1e8:  # a multiple root, or none: not decided to second order
                break
            a = a - np.linalg.lstsq(slope, residual, rcond=None)[0]
        else:
            if np.max(np.abs(residual)) < SATISFIED and all(
                min(abs(a - b).max(), abs(a + b).max()) > np.sqrt(SATISFIED) for b in directions
            ):
                directions.append(a)
    return tuple(directions)
