"""Two arithmetics for one text: binary64 through refkin's own Newton, and balls that enclose the truth.

A computation of the ledger is written once, with an arithmetic `n`: `n("0.6")` is the decimal number 0.6, the nearest
binary64 number or a ball around 0.6 itself; `n.newton` iterates, `n.root` finds a root. On balls a root is proved by
Krawczyk's operator: exactly one lies in the ball. The same computation on balls of 53 bits has as radius a bound of
what rounding makes of it in binary64: so the error that is allowed there is derived, not guessed.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

import numpy as np
from flint import arb, arb_mat, ctx

from crosscheck.documents.systems import SquareSystem
from refkin.newton import NewtonStatus, newton
from refkin.proof.pose.krawczyk import column, objects

MOST_STEPS = 60
"""Newton steps until a root is given up: enough to halve an error from 1 to below 2^-53."""
GUARD = 16
"""Bits by which a root is widened before it is proved: Krawczyk's box must be larger than its own round-off."""


class NoRoot(ArithmeticError):
    """No root was found, or none could be proved."""


@dataclass(frozen=True)
class History:
    """Iterates 0 ... k, residual and Jacobian at each of them, and the corrections q_(k+1) - q_k."""

    iterates: list[Any]
    residuals: list[Any]
    slopes: list[Any]
    corrections: list[Any]


class Binary64:
    """Floats; Newton is the production code."""

    name = "binary64"
    pi = np.pi

    def __call__(self, text: str) -> float:
        return float(text)

    def vector(self, texts: Any) -> Any:
        """Return numbers as an array."""
        return np.array([self(t) for t in texts])

    def arcsin(self, x: Any) -> Any:
        return np.arcsin(x)

    def angle(self, x: Any, y: Any) -> Any:
        """Return the direction of (x, y) in (-pi, pi]."""
        return np.arctan2(y, x)

    def solve(self, matrix: Any, right: Any) -> Any:
        return np.linalg.solve(np.asarray(matrix, float), np.asarray(right, float))

    def det(self, matrix: Any) -> Any:
        return np.linalg.det(np.asarray(matrix, float))

    def newton(self, system: SquareSystem, q0: Any, steps: int) -> History:
        """Return exactly so many Newton steps."""
        result = newton(*system, q0, stop=never, max_iterations=steps)
        if result.status is not NewtonStatus.ITERATION_LIMIT:
            raise NoRoot(f"after {result.iterations} of {steps} iterations: {result.status}")
        slopes = [np.asarray(system.phi_q(q), float) for q in result.iterates]
        return History(list(result.iterates), list(result.residuals), slopes, list(result.corrections))

    def root(self, system: SquareSystem, q0: Any) -> Any:
        """Return the root that Newton finds from q0."""
        result = newton(*system, q0, max_iterations=MOST_STEPS)
        if not result.converged:
            raise NoRoot(f"from {q0}: {result.status}")
        return result.q


class ArbNumbers:
    """`flint.arb` numbers of so many bits; use them inside `at_precision`."""

    def __init__(self, bits: int) -> None:
        self.bits, self.name = bits, f"balls of {bits} bits"

    def at_precision(self) -> Any:
        """Return a context manager: within, one computes with the bits of these balls."""
        return ctx.workprec(self.bits)

    @property
    def pi(self) -> Any:
        return arb.pi()

    def __call__(self, text: str) -> Any:
        return arb(text)

    def vector(self, texts: Any) -> Any:
        """Return numbers as an array of objects."""
        return objects([self(t) for t in texts])

    def arcsin(self, x: Any) -> Any:
        return arb(x).asin()

    def angle(self, x: Any, y: Any) -> Any:
        """Return the direction of (x, y) in (-pi, pi]."""
        return arb.atan2(arb(y), arb(x))

    def solve(self, matrix: Any, right: Any) -> Any:
        return objects(_matrix(matrix).solve(column(map(arb, right))).entries())

    def det(self, matrix: Any) -> Any:
        return _matrix(matrix).det()

    def newton(self, system: SquareSystem, q0: Any, steps: int) -> History:
        """Return exactly so many Newton steps, each enclosed; the balls widen from step to step."""
        q = objects([arb(x) for x in q0])
        history = History([q], [system.phi(q)], [system.phi_q(q)], [])
        for _ in range(steps):
            history.corrections.append(-self.solve(history.slopes[-1], history.residuals[-1]))
            q = q + history.corrections[-1]
            history.iterates.append(q)
            history.residuals.append(system.phi(q))
            history.slopes.append(system.phi_q(q))
        return history

    def root(self, system: SquareSystem, q0: Any) -> Any:
        """Return balls that hold exactly one root, the one that Newton finds from q0."""
        middle = objects([arb(x).mid() for x in q0])
        for _ in range(MOST_STEPS):
            correction = self.solve(system.phi_q(middle), system.phi(middle))
            middle = objects([(a - c).mid() for a, c in zip(middle, correction, strict=True)])
            small = arb(2) ** (GUARD // 2 - self.bits)
            if all(abs(c) < small * (1 + abs(x)) for c, x in zip(correction, middle, strict=True)):
                break
        for bits in range(self.bits - GUARD, self.bits // 2, -GUARD // 2):
            width = arb(2) ** -bits
            enclosure = self._proved(system, middle, objects([arb(0, width * (1 + abs(x))) for x in middle]))
            if enclosure is not None:
                return enclosure
        raise NoRoot(f"no root is proved near {[float(x) for x in middle]}")

    def proves(self, system: SquareSystem, q: Any, widths: Any) -> bool:
        """Return whether a box of these half-widths around q is proved to hold exactly one root.

        Numbers of the system that are balls may be wide: then there is one for each value in them.
        """
        return self._proved(system, objects([x.mid() for x in q]), objects([arb(0, w) for w in widths])) is not None

    def _proved(self, system: SquareSystem, middle: Any, widths: Any) -> Any:
        """Return Krawczyk's image of middle + widths if it lies inside, which proves one root in it; else None."""
        inverse = _matrix(system.phi_q(middle)).inv().mid()
        whole = middle + widths
        identity = arb_mat(len(middle), len(middle), 1)
        image = (identity - inverse * _matrix(system.phi_q(whole))) * column(widths) - inverse * column(
            system.phi(middle)
        )
        if not all(w.contains_interior(x) for w, x in zip(widths, image.entries(), strict=True)):
            return None
        return middle + objects(image.entries())


Arithmetic = Binary64 | ArbNumbers


def never(*_: Any) -> bool:
    """Go on to the cap: the stopping test of a for loop."""
    return False


def _matrix(matrix: Any) -> Any:
    return arb_mat([[arb(x) for x in row] for row in matrix])


# ---- proofs by enclosing

NARROWEST = 1e-9
"""Width of a piece at which a proof is given up."""


class Undecided(ArithmeticError):
    """Neither a proof nor its opposite was found."""


def ball(low: float, high: float) -> Any:
    """Return a ball that holds an interval."""
    return arb((low + high) / 2, (high - low) / 2 * (1 + 2.0**-40))


def excludes_zero(f: Callable[[Any], Any], low: float, high: float) -> bool:
    """Return whether f has no zero between low and high: proved, by halving until each piece excludes it.

    Parameters
    ----------
    f : callable
        A function of a ball, which returns one.
    low, high : float
    """
    pieces = [(low, high)]
    while pieces:
        a, b = pieces.pop()
        value = f(ball(a, b))
        if value.is_finite() and not value.contains(0):
            continue
        if b - a < NARROWEST:
            return False
        pieces += [(a, (a + b) / 2), ((a + b) / 2, b)]
    return True


def count_roots(system: SquareSystem, low: float, high: float) -> int:
    """Return how many roots a function of one variable has between low and high.

    Halves the interval until on each piece either f excludes zero, or f' does, so that the signs at its ends tell.
    Undecided if a root lies where the interval is cut, or where f' vanishes too.

    Parameters
    ----------
    system : SquareSystem
    low, high : float
    """
    pieces, count = [(low, high)], 0
    while pieces:
        a, b = pieces.pop()
        x = ball(a, b)
        value, slope = system.phi([x])[0], system.phi_q([x])[0, 0]
        if value.is_finite() and not value.contains(0):
            continue
        if slope.is_finite() and not slope.contains(0):
            ends = [system.phi([arb(end)])[0] for end in (a, b)]
            if any(end.contains(0) for end in ends):
                raise Undecided(f"a root lies at {a} or {b}")
            count += (ends[0] > 0) != (ends[1] > 0)
            continue
        if b - a < NARROWEST:
            raise Undecided(f"near {a} neither f nor f' excludes zero")
        pieces += [(a, (a + b) / 2), ((a + b) / 2, b)]
    return count
