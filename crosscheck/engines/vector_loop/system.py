"""Loop-closure equations: sums of vectors that must vanish, in real form and in complex form.

In complex form each loop gives F = sum c r e^(i theta) = 0 and its conjugate F* = sum c* r e^(-i theta) = 0; in real
form the two are replaced by x = (F + F*)/2 and y = (F - F*)/(2i). The unknowns, angles and lengths, are the same real
numbers. Where links touch otherwise (gears, racks), a `AngleRelation` between unknowns is one more equation. (METU,
Mechanisms, 3.9.)

Velocity and acceleration follow by differentiating the loops: phi_q qd = nu, phi_q qdd = gamma.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from crosscheck.engines.poses import EPS, solve
from crosscheck.engines.vector_loop.vectors import LoopVector, Sums, Variable, Variables


@dataclass(frozen=True)
class AngleRelation:
    """sum of factor * variable + constant = 0."""

    terms: tuple[tuple[float, Variable], ...]
    constant: float = 0.0


class LoopSystem:
    """The equations of a set of loops, of which each sums to zero, and relations: as many as unknowns.

    The names of unknowns are in the order of q. `scale` is the power of two nearest the longest constant vector, 1 if
    there is none. `is_angle` (n,) says which unknowns are angles; the others are lengths. `weights` (n,) make them
    comparable: 1 for an angle, 1/scale for a length.
    """

    def __init__(
        self, unknowns: Sequence[str], loops: Sequence[Sequence[LoopVector]], relations: Sequence[AngleRelation] = ()
    ) -> None:
        self.unknowns, self.loops, self.relations = tuple(unknowns), tuple(map(tuple, loops)), tuple(relations)
        equations = 2 * len(self.loops) + len(self.relations)
        if equations != len(self.unknowns):
            raise ValueError(f"loops: expected {len(self.unknowns)} equations for {self.unknowns}, got {equations}")
        used = {v.unknown for v in self.variables()} - {None}
        if used != set(self.unknowns):
            raise ValueError(
                f"unknowns: expected {sorted(map(str, used))}, which the loops contain, got {self.unknowns}"
            )
        self._sums = Sums(self.loops, self.unknowns)
        self._related = Variables([v for r in self.relations for _, v in r.terms], self.unknowns)
        self.scale = self._scale()
        lengths = {v.length.unknown for loop in self.loops for v in loop}
        self.is_angle = np.array([name not in lengths for name in self.unknowns], bool)
        self.weights = np.where(self.is_angle, 1.0, 1.0 / self.scale)
        self._factors = np.zeros((len(self.relations), len(self._related.variables)))
        owners = [(k, factor) for k, r in enumerate(self.relations) for factor, _ in r.terms]
        for column, (k, factor) in enumerate(owners):
            self._factors[k, column] = factor

    def variables(self) -> list[Variable]:
        """Return every length and angle that the equations contain."""
        of_vectors = [v for loop in self.loops for vector in loop for v in (vector.length, vector.angle)]
        return of_vectors + [v for relation in self.relations for _, v in relation.terms]

    @property
    def n(self) -> int:
        """The number of unknowns, and of equations."""
        return len(self.unknowns)

    def _scale(self) -> float:
        long = [abs(v.coefficient) * v.length.constant for loop in self.loops for v in loop]
        longest = max(map(abs, long), default=0.0)
        return 2.0 ** round(math.log2(longest)) if longest > 0.0 else 1.0

    def residual(self, q: Any, t: Any = 0.0) -> Any:
        """Return x and y of each loop, then the relations, (n,) or (n, T)."""
        x, y = self._sums.parts(np.asarray(q), t)
        return self._rows(x, y, self._relation_values(q, t, 0))

    def jacobian(self, q: Any, t: Any = 0.0) -> Any:
        """Return the real Jacobian phi_q, (n, n) or (n, n, T)."""
        x, y = self._sums.slope_parts(np.asarray(q), t)
        return self._rows(x, y, self._relation_slopes(q))

    def complex_residual(self, q: Any, t: Any = 0.0) -> Any:
        """Return the loops, then their conjugates, then the relations, (n,) or (n, T)."""
        q = np.asarray(q)
        pair = self._sums.value(q, t), self._sums.value(q, t, -1)
        return np.concatenate([*pair, self._relation_values(q, t, 0)])

    def complex_jacobian(self, q: Any, t: Any = 0.0) -> Any:
        """Return the derivatives of `complex_residual` by the unknowns, (n, n) or (n, n, T)."""
        q = np.asarray(q)
        return np.concatenate([self._sums.slope(q, t), self._sums.slope(q, t, -1), self._relation_slopes(q)])

    def nu(self, q: Any, t: Any = 0.0) -> Any:
        """Return the velocity right side: minus the rate of the equations while the unknowns rest."""
        q = np.asarray(q)
        rate = self._sums.rate(q, np.zeros_like(q), t)
        return -self._rows(rate.real, rate.imag, self._relation_values(0.0 * q, t, 1))

    def gamma(self, q: Any, qd: Any, t: Any = 0.0) -> Any:
        """Return the acceleration right side: minus the second derivative of the equations at qdd = 0."""
        q = np.asarray(q)
        second = self._sums.acceleration(q, np.asarray(qd), np.zeros_like(q), t)
        return -self._rows(second.real, second.imag, self._relation_values(0.0 * q, t, 2))

    def velocity(self, q: Any, t: Any = 0.0) -> Any:
        """Return qd (n,) with phi_q qd = nu, NaN where phi_q is singular."""
        return solve(self.jacobian(q, t)[None], self.nu(q, t)[None])[0]

    def acceleration(self, q: Any, qd: Any, t: Any = 0.0) -> Any:
        """Return qdd (n,) with phi_q qdd = gamma, NaN where phi_q is singular."""
        return solve(self.jacobian(q, t)[None], self.gamma(q, qd, t)[None])[0]

    def rounding(self, q: Any, t: Any = 0.0) -> Any:
        """Return what rounding may leave of equations that are satisfied, (n,) or (n, T).

        A vector is a product of a few factors and of a cosine of a rounded angle: 8 roundings at most of |c r| (1 +
        |theta|); each is then added to the others of its loop.
        """
        q = np.asarray(q)
        vectors = self._sums.which.sum(axis=1)
        count = (8.0 + vectors) if q.ndim == 1 else (8.0 + vectors)[:, None]
        loops = count * self._sums.size(q, t)
        related = np.abs(self._factors) @ (np.abs(self._related.at(q, t)) + 1.0)
        return EPS * self._rows(loops, loops, 8.0 * related)

    def _relation_values(self, q: Any, t: Any, order: int) -> Any:
        if not self.relations:
            return np.zeros((0, *np.shape(q)[1:]))
        constants = np.array([0.0 if order else r.constant for r in self.relations])
        values = self._factors @ self._related.at(np.asarray(q), t, order)
        return values + (constants[:, None] if values.ndim == 2 else constants)

    def _relation_slopes(self, q: Any) -> Any:
        slopes = self._factors @ self._related.slope
        return slopes if np.ndim(q) == 1 else np.repeat(slopes[:, :, None], np.shape(q)[1], axis=2)

    def _rows(self, x: Any, y: Any, related: Any) -> Any:
        """Return x and y of the first loop, of the second, ..., then the relations."""
        loops = 2 * len(x)
        out = np.empty((loops + len(related), *x.shape[1:]), np.result_type(x, related))
        out[0:loops:2], out[1:loops:2], out[loops:] = x, y, related
        return out
