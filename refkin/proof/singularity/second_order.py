"""Rows of phi_q at a pose, balanced; their null vectors; and which first-order motions go on to second order."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Any

import numpy as np

from refkin.differences import jacobian
from refkin.joints import GROUND
from refkin.proof.assembly.search import closes, radical_inverse
from refkin.proof.path.curve import SATISFIED, common_roots, roots
from refkin.system import System

ROUNDS = 24
"""How often rows and columns are balanced in turn: a factor 2^24 between neighbours is gone by then."""
FAR, STEPS, MOST_CORRECTIONS = 1e-2, 8, 12
"""How far a motion is followed to see whether it goes on, in the largest coordinate; in how many steps, as links that
are short for the mechanism turn far meanwhile; and how often each is corrected."""


@dataclass(frozen=True)
class Balanced:
    """A matrix D_1 J D_2 with rows and columns of about the same size, and its singular values and vectors."""

    system: System
    q: Any
    t: float
    rows: Any
    matrix: Any
    by_row: Any
    by_column: Any
    left: Any
    sigma: Any
    right: Any

    def rank(self, tolerance: float) -> int:
        """Return how many singular values are above a tolerance."""
        return int(np.sum(self.sigma > tolerance))

    def right_null(self, tolerance: float) -> Any:
        """Return motions (n, k) that the rows allow, as changes of the coordinates."""
        vectors = self.right[self.rank(tolerance) :].T
        return vectors * self.by_column[:, None]

    def left_null(self, rank: int) -> Any:
        """Return weights (k, m) of rows whose sum is zero, beyond a rank."""
        return self.left[:, rank:].T * self.by_row

    def left_null_with(self, rows: Any, tolerance: float) -> Any:
        """Return of these the weights (k, m) in which the given rows have a part, the largest one first."""
        null = self.left[:, self.rank(tolerance) :]
        _, parts, weights = np.linalg.svd(null[rows])
        return (null @ weights[: max(1, int(np.sum(parts > tolerance)))].T).T * self.by_row

    def bend(self, weights: Any) -> Any:
        """Return the second derivatives (n, n) of the sum of rows with weights (m,)."""
        bent = jacobian(lambda q: weights @ self.system.phi_q(q, self.t)[self.rows], self.q)
        return (bent + bent.T) / 2

    def with_row(self, row: int, column: int) -> Balanced:
        """Return the matrix with a row replaced by one that holds a single coordinate."""
        jacobian = _slopes(self.system, self.q, self.t, self.rows)
        jacobian[row] = 0.0
        jacobian[row, column] = 1.0
        return balanced(self.system, self.q, self.t, self.rows, jacobian)


def balanced(system: System, q: Any, t: float, rows: Any, slopes: Any = None) -> Balanced:
    """Return some rows of phi_q, balanced, or a matrix in their place.

    Parameters
    ----------
    system : System
        Compiled in its mechanism's own unit.
    q : (n,) array
        The pose, in the system's coordinates.
    t : float
        Its time [s].
    rows : (k,) array of int
        Which rows, of the m.
    slopes : (k, n) array, optional
        Instead of them.
    """
    matrix, by_row, by_column = balance(_slopes(system, q, t, rows) if slopes is None else slopes)
    left, sigma, right = np.linalg.svd(matrix)
    sigma = np.append(sigma, np.zeros(max(0, system.n - len(sigma))))
    return Balanced(system, q, t, rows, matrix, by_row, by_column, left, sigma, right)


def balance(matrix: Any) -> tuple[Any, Any, Any]:
    """Return D_1 J D_2 of a matrix J (m, n), with rows and columns of one size or so, D_1 (m,) and D_2 (n,)."""
    by_row, by_column = np.ones(len(matrix)), np.ones(matrix.shape[1])
    for _ in range(ROUNDS):
        row, column = (np.sqrt(np.max(np.abs(matrix), axis=axis, initial=0.0)) for axis in (1, 0))
        row, column = np.where(row > 0, row, 1.0), np.where(column > 0, column, 1.0)
        matrix = matrix / row[:, None] / column
        by_row, by_column = by_row / row, by_column / column
    return matrix, by_row, by_column


def elsewhere(system: System, q: Any) -> Any:
    """Return coordinates (n,) that have nothing to do with a pose: entries of phi_q are there what they usually are.

    Each body is moved by a part of its own size, so that small bodies beside a large one are not torn apart.
    """
    shift = np.array([0.1 + 0.2 * radical_inverse(k + 1, 2) for k in range(system.n)])
    for body in system.mechanism.bodies:
        own = np.arange(system.n)[system.columns(body.name)]
        shift[own[~system.turns[own].astype(bool)]] *= _size(system, body.name)
    return q + shift


def _size(system: System, body: str) -> float:
    """Return how far a body's joints, and links on it, reach, in the system's unit; 1 where nothing says it."""
    sizes = [0.0]
    for constraint in system.mechanism.constraints:
        if body in constraint.bodies:
            sizes += [constraint.reach(), *(math.hypot(*at) for on, at in constraint.points() if on != GROUND)]
    return max(sizes) / system.unit.size or 1.0


def without_rounding(here: Any, there: Any) -> Any:
    """Return a matrix without the columns that vanish against those elsewhere: only rounding is left there."""
    vanishing = np.linalg.norm(here, axis=0) <= SATISFIED * np.linalg.norm(there, axis=0)
    return np.where(vanishing, 0.0, here)


def _slopes(system: System, q: Any, t: float, rows: Any) -> Any:
    """Return rows of phi_q without the columns that vanish: to balance what rounding leaves of them would hide it."""
    return without_rounding(*(system.phi_q(x, t)[rows] for x in (q, elsewhere(system, q))))


@dataclass(frozen=True)
class Cone:
    """Motions that go on to second order.

    Attributes
    ----------
    forms : int
        How many independent conditions psi . phi_qq[v, v] = 0 there are.
    tangents : tuple of (n,) arrays
        The motions that satisfy them all, if these are finitely many.
    is_definite : bool
        Whether one condition alone forbids every motion.
    """

    forms: int
    tangents: tuple[Any, ...] = ()
    is_definite: bool = False


def cone(held: Balanced, tolerance: float, driven: Any = None) -> Cone:
    """Return which of the motions that some rows allow to first order go on to second order.

    Motions that no condition feels, and that drivers hold, are left out as far as one driver stays: they are those of
    linkages that have nothing to do with a singular one.

    Parameters
    ----------
    held : Balanced
        The rows of joints.
    tolerance : float
        Largest singular value that counts as zero.
    driven : (d, n) array, optional
        The slopes of the drivers' rows; by default there are none.
    """
    rank = held.rank(tolerance)
    free, count = held.right_null(tolerance), held.system.n - rank
    forms = [free.T @ held.bend(psi) @ free for psi in held.left_null(rank)]
    upper = np.triu_indices(count)
    _, sizes, basis = np.linalg.svd(np.array([form[upper] for form in forms]).reshape(len(forms), -1))
    independent = [_symmetric(b, count) for b in basis[: int(np.sum(sizes > tolerance))]]
    if not independent:
        return Cone(0)
    _, sizes, basis = np.linalg.svd(np.vstack(independent))
    felt, idle = np.split(basis.T, [int(np.sum(sizes > tolerance))], axis=1)
    if (
        driven is not None
        and 0 < idle.shape[1] < len(driven)
        and np.linalg.matrix_rank(driven @ free @ idle) == idle.shape[1]
    ):
        free, count, independent = free @ felt, felt.shape[1], [felt.T @ form @ felt for form in independent]
    definite = any(np.ptp(np.sign(values)) == 0 for values in (_eigenvalues(f, tolerance) for f in independent))
    if count == 2:
        directions = tuple(a for a in roots(independent[0]) if all(abs(a @ b @ a) <= SATISFIED for b in independent))
    else:
        directions = common_roots(independent) if len(independent) >= count - 1 else ()
    return Cone(len(independent), tuple(free @ a for a in directions), definite)


def _symmetric(entries: Any, count: int) -> Any:
    out = np.zeros((count, count))
    out[np.triu_indices(count)] = entries
    return out + np.triu(out, 1).T


def _eigenvalues(form: Any, tolerance: float) -> Any:
    values = np.linalg.eigvalsh(form)
    return np.where(np.abs(values) > tolerance * np.max(np.abs(values)), values, 0.0)


def advances(system: System, q: Any, t: float, direction: Any) -> bool:
    """Return whether a motion at a fixed time goes on: whether there is another pose a little further.

    Parameters
    ----------
    system : System
    q : (n,) array
        A pose, in the system's coordinates, at the time t [s].
    t : float
        When [s].
    direction : (n,) array
        A null vector of phi_q there.
    """
    step, way = direction, FAR / STEPS
    for _ in range(STEPS):
        step = step / np.max(np.abs(step)) * way
        x = q + step
        for _ in range(MOST_CORRECTIONS):
            x = x - np.linalg.pinv(system.phi_q(x, t), rcond=1e-6) @ system.phi(x, t)
        away, off = np.max(np.abs(x - q)), np.max(np.abs(x - q - step))
        if not (off < way / 2 < away and closes(system, x, t)):
            return False
        q, step = x, x - q
    return True
