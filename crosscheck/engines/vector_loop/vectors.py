"""Vectors of a loop in complex form, c r e^(i theta), and sums of them with first and second derivatives.

A length r and an angle theta are each a `Variable`: a constant, at most one unknown of the loop, known functions of
time. c is a constant complex number: which way along the link, or a point in a link's own frame. With E = c e^(i theta)

    w   = r E
    w'  = (r' + i r theta') E
    w'' = (r'' + 2 i r' theta' + i r theta'' - r theta'^2) E

Shapes: unknowns q are (n,) with a time t, or (n, T) with times (T,); sums are (rows,) or (rows, T).
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from refkin.motion_laws import Law


@dataclass(frozen=True)
class Variable:
    """constant + unknown, by its name, + sum of factor * law(t): an angle [rad] or a length."""

    constant: float = 0.0
    unknown: str | None = None
    laws: tuple[tuple[float, Law], ...] = ()


ONE = Variable(1.0)
ZERO = Variable(0.0)


def variable(given: Variable | Law | float) -> Variable:
    """Return a number or a law of time as a `Variable`."""
    if isinstance(given, Variable):
        return given
    return Variable(laws=((1.0, given),)) if callable(given) else Variable(float(given))


@dataclass(frozen=True)
class LoopVector:
    """coefficient * length * e^(i angle)."""

    coefficient: complex = 1.0
    length: Variable = ONE
    angle: Variable = ZERO

    def times(self, factor: complex) -> LoopVector:
        """Return the vector multiplied by a complex constant."""
        return LoopVector(self.coefficient * factor, self.length, self.angle)


def combined(vectors: Sequence[LoopVector]) -> list[LoopVector]:
    """Return the sum of vectors with those of the same length and angle added up, and none that is zero."""
    sums: dict[tuple[Variable, Variable], complex] = {}
    for v in vectors:
        key = v.length, v.angle
        sums[key] = sums.get(key, 0.0) + v.coefficient
    return [LoopVector(c, *key) for key, c in sums.items() if c != 0.0]


class Variables:
    """A column of K variables as functions of the unknowns and of time; `slope` (K, n) is 1 where one contains one."""

    def __init__(self, variables: Sequence[Variable], unknowns: Sequence[str]) -> None:
        self.variables = tuple(variables)
        self.slope = np.zeros((len(self.variables), len(unknowns)))
        for k, v in enumerate(self.variables):
            if v.unknown is not None:
                self.slope[k, unknowns.index(v.unknown)] = 1.0
        self._constants = np.array([v.constant for v in self.variables])
        self._laws = [(k, *term) for k, v in enumerate(self.variables) for term in v.laws]
        self._recent: tuple[Any, dict[int, Any]] = (None, {})

    def known(self, t: Any, order: int) -> Any:
        """Return what time alone makes of the variables or of their derivative, (K,) or (K, T)."""
        if self._recent[0] is not t:  # Newton asks again and again at the same time, or row of times
            self._recent = (t, {})
        values = self._recent[1]
        if order not in values:
            out = np.zeros((len(self.variables), *np.shape(t)), np.result_type(np.asarray(t), float))
            if order == 0:
                out.T[...] = self._constants
            for k, factor, law in self._laws:
                out[k] += factor * law(t, order)
            values[order] = out
        return values[order]

    def at(self, q: Any, t: Any, order: int = 0) -> Any:
        """Return the variables (order 0), or their derivative from the unknowns' derivative of that order."""
        return self.known(t, order) + self.slope @ q


class Sums:
    """Rows of sums of K vectors with complex `coefficients`; `which` (rows, K) is 1 where one belongs to a row."""

    def __init__(self, rows: Sequence[Sequence[LoopVector]], unknowns: Sequence[str]) -> None:
        vectors = [v for row in rows for v in row]
        self.coefficients = np.array([v.coefficient for v in vectors], complex)
        self.lengths = Variables([v.length for v in vectors], unknowns)
        self.angles = Variables([v.angle for v in vectors], unknowns)
        self.which = np.zeros((len(rows), len(vectors)))
        owners = [k for k, row in enumerate(rows) for _ in row]
        self.which[owners, range(len(vectors))] = 1.0
        by = [self.which[:, None] * v.slope.T[None] for v in (self.lengths, self.angles)]
        self._by_length, self._by_angle = (of.reshape(len(rows) * len(unknowns), len(vectors)) for of in by)

    def value(self, q: Any, t: Any, sense: int = 1) -> Any:
        """Return the sums; with `sense` -1 those of the conjugate vectors, c* r e^(-i theta)."""
        return self.which @ (self.lengths.at(q, t) * self._directions(q, t, sense))

    def slope(self, q: Any, t: Any, sense: int = 1) -> Any:
        """Return the derivatives of `value` by the unknowns, (rows, n) or (rows, n, T).

        By a length it is c e^(i theta), by an angle i c r e^(i theta).
        """
        along = self._directions(q, t, sense)
        across = sense * 1j * self.lengths.at(q, t) * along
        return self._columns(along, across)

    def parts(self, q: Any, t: Any) -> tuple[Any, Any]:
        """Return x and y of the sums, written with cos and sin; analytic in q, as a complex step asks for."""
        x, y = self._components(q, t)
        r = self.lengths.at(q, t)
        return self.which @ (r * x), self.which @ (r * y)

    def slope_parts(self, q: Any, t: Any) -> tuple[Any, Any]:
        """Return the derivatives of `parts` by the unknowns, each (rows, n) or (rows, n, T)."""
        x, y = self._components(q, t)
        r = self.lengths.at(q, t)
        return self._columns(x, -r * y), self._columns(y, r * x)

    def rate(self, q: Any, qd: Any, t: Any) -> Any:
        """Return the first derivative of the sums."""
        r, rd, angled = self.lengths.at(q, t), self.lengths.at(qd, t, 1), self.angles.at(qd, t, 1)
        return self.which @ ((rd + 1j * r * angled) * self._directions(q, t))

    def acceleration(self, q: Any, qd: Any, qdd: Any, t: Any) -> Any:
        """Return the second derivative of the sums."""
        r, rd, rdd = self.lengths.at(q, t), self.lengths.at(qd, t, 1), self.lengths.at(qdd, t, 2)
        angled, angledd = self.angles.at(qd, t, 1), self.angles.at(qdd, t, 2)
        turning = rdd - r * angled**2 + 1j * (2.0 * rd * angled + r * angledd)
        return self.which @ (turning * self._directions(q, t))

    def size(self, q: Any, t: Any) -> Any:
        """Return the sum of |c r| (1 + |theta|): what one rounding of each number in a row may move it by, over u."""
        long = np.abs(self._spread(self.coefficients, q) * self.lengths.at(q, t))
        return self.which @ (long * (1.0 + np.abs(self.angles.at(q, t))))

    def _directions(self, q: Any, t: Any, sense: int = 1) -> Any:
        c = self.coefficients if sense > 0 else np.conj(self.coefficients)
        return self._spread(c, q) * np.exp(sense * 1j * self.angles.at(q, t))

    def _components(self, q: Any, t: Any) -> tuple[Any, Any]:
        angles, c = self.angles.at(q, t), self._spread(self.coefficients, q)
        cosine, sine = np.cos(angles), np.sin(angles)
        return c.real * cosine - c.imag * sine, c.real * sine + c.imag * cosine

    def _columns(self, by_length: Any, by_angle: Any) -> Any:
        """Return the derivatives by the unknowns from those by each length and by each angle."""
        if by_length.ndim == 1:
            columns = by_length[:, None] * self.lengths.slope + by_angle[:, None] * self.angles.slope
            return self.which @ columns
        flat = self._by_length @ by_length + self._by_angle @ by_angle
        return flat.reshape(len(self.which), self.lengths.slope.shape[1], by_length.shape[1])

    @staticmethod
    def _spread(c: Any, q: Any) -> Any:
        return c[:, None] if np.ndim(q) == 2 else c
