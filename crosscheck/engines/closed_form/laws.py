"""The laws of a scene's drivers as jets, from their numbers alone: exact in balls, also for a spline."""

from __future__ import annotations

import bisect
import math
from functools import lru_cache
from typing import Any

import numpy as np
from flint import arb, arb_mat, ctx

from crosscheck.engines.closed_form.jets import Arithmetic, Floats, Jet, Number
from refkin.motion_laws import Integral, Law, Polynomial, Sinusoid, Table


def law_jet(law: Law, times: tuple[float, ...], arithmetic: Arithmetic) -> Jet:
    """Return f, f', f'' at the times, as a jet of rows (T,); TypeError for a law that has no closed form here.

    Parameters
    ----------
    law, times, arithmetic : Law, tuple of float, Arithmetic
        Times [s].
    """
    t = arithmetic.row(times)
    if isinstance(law, Integral):
        rate = law_jet(law.rate, times, arithmetic)
        return Jet(_integral(law.rate, times, t, arithmetic) + arithmetic.number(law.initial), rate.v, rate.d)
    if isinstance(law, Polynomial):
        return _horner([arithmetic.number(c) for c in law.coefficients], t, arithmetic)
    if isinstance(law, Sinusoid):
        w = arithmetic.number(law.angular_frequency)
        _, sine = Jet(t * w + arithmetic.number(law.phase), w).cos_sin()
        return sine.times(arithmetic.number(law.amplitude)) + Jet(arithmetic.number(law.offset))
    if isinstance(law, Table):
        return Jet(*(_table(law, times, order, arithmetic) for order in range(3)))
    raise TypeError(f"law: expected Polynomial, Sinusoid, Table or Integral, got {type(law).__name__}")


def _horner(coefficients: list[Number], t: Number, arithmetic: Arithmetic) -> Jet:
    argument = Jet(t, arithmetic.number(1.0))
    value = Jet(t * arithmetic.number(0.0))
    for c in reversed(coefficients):
        value = value * argument + Jet(c)
    return value


def _integral(law: Law, times: tuple[float, ...], t: Number, arithmetic: Arithmetic) -> Number:
    """Return the integral of a law from 0 to t."""
    if isinstance(law, Polynomial):
        raised = [arithmetic.number(c) / arithmetic.number(k + 1.0) for k, c in enumerate(law.coefficients)]
        return _horner([arithmetic.number(0.0), *raised], t, arithmetic).v
    if isinstance(law, Sinusoid):
        amplitude, offset, phase = (arithmetic.number(x) for x in (law.amplitude, law.offset, law.phase))
        half = arithmetic.number(0.5 * law.angular_frequency)
        # (cos(phase) - cos(w t + phase)) / w as a product, which keeps its digits when w t is small
        lobe = np.sin(t * half) / half if law.angular_frequency else t
        return t * offset + amplitude * np.sin(t * half + phase) * lobe
    if isinstance(law, Table):
        return _table(law, times, -1, arithmetic)
    raise TypeError(f"rate_law: expected Polynomial, Sinusoid or Table, got {type(law).__name__}")


def _table(law: Table, times: tuple[float, ...], order: int, arithmetic: Arithmetic) -> Number:
    """Return the spline's derivative of the given order, -1 for its integral from 0."""
    if isinstance(arithmetic, Floats):
        t = np.array(times)
        return law.integral(t) if order < 0 else np.asarray(law(t, order), float)
    spline = exact_spline(law, ctx.prec)
    if order >= 0:
        return np.array([spline.derivative(t, order) for t in times], dtype=object)
    return np.array([spline.antiderivative(t) - spline.antiderivative(0.0) for t in times], dtype=object)


class BallSpline:
    """The cubic spline of a table in balls, by its second derivatives M_k at the knots.

    h_(k-1) M_(k-1) + 2 (h_(k-1) + h_k) M_k + h_k M_(k+1) = 6 (slope_k - slope_(k-1)) at inner knots; at the ends the
    same third derivative on both sides of the neighbour (not-a-knot), or the same equation around (periodic). Two knots
    make a straight line, three a parabola.
    """

    def __init__(self, law: Table) -> None:
        self.x, self.y = law.argument, [arb(value) for value in law.value]
        self.periodic = law.periodic
        self.h = [arb(b) - arb(a) for a, b in zip(self.x, self.x[1:], strict=False)]
        slopes = [(b - a) / h for a, b, h in zip(self.y, self.y[1:], self.h, strict=False)]
        self.m = self._second_derivatives(slopes)
        areas = [self._piece(k, h, -1) for k, h in enumerate(self.h)]
        self.area = [sum(areas[:k], arb(0)) for k in range(len(areas) + 1)]

    def _second_derivatives(self, slopes: list[Any]) -> list[Any]:
        n, h = len(self.x), self.h
        if n == 2:
            return [arb(0)] * 2
        if n == 3 and not self.periodic:
            return [2 * (slopes[1] - slopes[0]) / (h[0] + h[1])] * 3
        rows, right = [[arb(0)] * n for _ in range(n)], [arb(0)] * n
        for k in range(1, n - 1):
            rows[k][k - 1], rows[k][k], rows[k][k + 1] = h[k - 1], 2 * (h[k - 1] + h[k]), h[k]
            right[k] = 6 * (slopes[k] - slopes[k - 1])
        if self.periodic:
            rows[0][0], rows[0][n - 1] = arb(1), arb(-1)
            rows[-1][0], rows[-1][1] = 2 * (h[-1] + h[0]), h[0]
            rows[-1][n - 2] += h[-1]
            right[-1] = 6 * (slopes[0] - slopes[-1])
        else:
            for row, k in ((rows[0], 0), (rows[-1], n - 3)):
                row[k], row[k + 1], row[k + 2] = -h[k + 1], h[k] + h[k + 1], -h[k]
        solved = arb_mat(rows).solve(arb_mat([[value] for value in right]))
        return [solved[k, 0] for k in range(n)]

    def _piece(self, k: int, s: Any, order: int) -> Any:
        """Return piece k at s = t - x_k: derivative of the given order, -1 for the integral from x_k."""
        third = (self.m[k + 1] - self.m[k]) / self.h[k]
        first = (self.y[k + 1] - self.y[k]) / self.h[k] - self.h[k] * (2 * self.m[k] + self.m[k + 1]) / 6
        taylor = [self.y[k], first, self.m[k], third]
        if order < 0:
            return sum((c * s ** (p + 1) / math.factorial(p + 1) for p, c in enumerate(taylor)), arb(0))
        return sum((c * s**p / math.factorial(p) for p, c in enumerate(taylor[order:])), arb(0))

    def _place(self, t: float) -> tuple[int, Any, int]:
        """Return the piece that holds t, the offset in it, and the whole periods before it."""
        argument, periods = arb(t), 0
        if self.periodic:
            period = arb(self.x[-1]) - arb(self.x[0])
            periods = int(float(((argument - arb(self.x[0])) / period).floor().mid()))
            argument -= periods * period
        k = min(max(bisect.bisect_right(self.x, float(argument)) - 1, 0), len(self.h) - 1)
        return k, argument - arb(self.x[k]), periods

    def derivative(self, t: float, order: int) -> Any:
        """Return the derivative of the given order at t."""
        k, s, _ = self._place(t)
        return self._piece(k, s, order)

    def antiderivative(self, t: float) -> Any:
        """Return the integral from the first knot to t."""
        k, s, periods = self._place(t)
        return self.area[k] + self._piece(k, s, -1) + periods * self.area[-1]


@lru_cache(maxsize=64)
def exact_spline(law: Table, bits: int) -> BallSpline:
    """Return the spline of a table in balls of the given precision, which must be the current one."""
    assert bits == ctx.prec, "the spline is computed at the precision of the context"
    return BallSpline(law)
