"""The polynomial of degree 5 through two poses with their rates and accelerations (Hermite), per coordinate.

With s = (t - t0) / h, h = t1 - t0, and what a Taylor step from t0 misses at t1,

    d0 = q1 - q0 - h v0 - h^2 a0 / 2,   d1 = h (v1 - v0) - h^2 a0,   d2 = h^2 (a1 - a0),

it is q0 + s (h v0 + s (h^2 a0 / 2 + s (c3 + s (c4 + s c5)))) with

    c3 = 10 d0 - 4 d1 + d2 / 2,   c4 = -15 d0 + 7 d1 - d2,   c5 = 6 d0 - 3 d1 + d2 / 2.

Its error is E = f'''''' (t - t0)^3 (t - t1)^3 / 720: one step beyond t1 it is 512 times what it is half-way, and the
error of the rate there is E (3 / (t - t0) + 3 / (t - t1)), at most 6 E / (t - t1).
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

Levels = Sequence[Sequence[Any]]
"""Coordinates, rates, accelerations, each a sequence of numbers or rows."""


def coefficients(first: Levels, last: Levels, h: Any) -> list[tuple[Any, ...]]:
    """Return per coordinate the six coefficients, that of the power 0 first."""
    rows = []
    for q0, v0, a0, q1, v1, a1 in zip(*first, *last, strict=True):
        step, bend = h * v0, h * h * a0
        half = 0.5 * bend
        d0 = q1 - q0 - step - half
        d1 = h * v1 - step - bend
        d2 = 0.5 * (h * h * a1 - bend)
        rows.append((q0, step, half, 10 * d0 - 4 * d1 + d2, 7 * d1 - 15 * d0 - 2 * d2, 6 * d0 - 3 * d1 + d2))
    return rows


def at(polynomial: Sequence[Any], s: Any) -> Any:
    """Return the value at s."""
    c0, c1, c2, c3, c4, c5 = polynomial
    return c0 + s * (c1 + s * (c2 + s * (c3 + s * (c4 + s * c5))))


def slope(polynomial: Sequence[Any], s: Any) -> Any:
    """Return the derivative by s."""
    _, c1, c2, c3, c4, c5 = polynomial
    return c1 + s * (2 * c2 + s * (3 * c3 + s * (4 * c4 + s * 5 * c5)))


def weights(before: float, last: float, t: float) -> tuple[list[float], list[float]]:
    """Return by what q, v, a at `before` and at `last` are multiplied to give the value, and the rate, at t."""
    unit = [[float(k == m) for m in range(6)] for k in range(6)]
    h = last - before
    s = (t - before) / h
    basis = [coefficients([e[0:1], e[1:2], e[2:3]], [e[3:4], e[4:5], e[5:6]], h)[0] for e in unit]
    return [at(b, s) for b in basis], [slope(b, s) / h for b in basis]
