"""What balls prove of a function on an interval: that it has no root, or how many."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

from flint import arb

from crosscheck.documents.systems import SquareSystem

NARROWEST = 1e-9
"""Width of a piece at which a proof is given up."""


class Undecided(ArithmeticError):
    """Neither a proof nor its opposite was found."""


def ball(low: float, high: float) -> Any:
    """Return a ball that holds an interval."""
    return arb((low + high) / 2, (high - low) / 2 * (1 + 2.0**-40))


def excludes_zero(f: Callable[[Any], Any], low: float, high: float) -> bool:
    """Return whether f has no zero between low and high: proved, by halving until each piece excludes it."""
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

    Raises
    ------
    Undecided
        If a root lies where the interval is cut, or where f' vanishes too.
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
