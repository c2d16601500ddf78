"""Proofs that hold over an interval of time: one branch, and no other, in a tube that goes along with a pose.

Along a straight line c(s) = q + v s, t + s, |s| <= h, take the operator y -> y - R phi(c(s) + y, t + s) of
`certificate`, with one R for all s. By the mean value form phi(c(s), t + s) lies within |s| (phi_q v - nu) of
phi(q, t), both over the whole line. So with, in the norm |y| = max_k |y_k| / w_k,

    eta >= |R phi(q, t)| + h |R (phi_q(c) v - nu(c, t + s))|     Z >= |I - R phi_q(x)|, x within 2 w of the line,

eta + 2 Z w <= 2 w proves: at every time |s| <= h exactly one root lies within 2 w of c(s), and phi_q is regular there.
By the implicit function theorem these roots are one smooth motion q(t). Two poses that both lie in a tube, each at its
time, are therefore poses of one motion: no branch was changed between them.

Many lines are tried at once, in float64, with every rounding bounded; the laws of motion are enclosed over their
intervals of time in balls.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Any, cast

import numpy as np
from flint import arb, ctx

from refkin.joints import Unit
from refkin.proof.numbers.bounded import LAW_BITS, TINY, UP, Bounded, Times, U, box
from refkin.proof.numbers.exact import continued
from refkin.proof.numbers.preconditioned import Preconditioned, independent_rows
from refkin.system import System

FLOOR = 2.0**-36
"""Smallest half-width of a tube in units of its largest: a smaller one would only magnify what rounding leaves."""
LONGEST = 64
"""Half-widths of the interval of time that are tried: halvings of the first."""


@dataclass(frozen=True)
class CertifiedInterval:
    """Around a time t_k: for |t - t_k| <= `delta` exactly one q(t) lies within `radii` of q_k + v (t - t_k).

    Attributes
    ----------
    delta : float
        Half the length of the interval [s]; 0 if nothing was proved.
    radii : (n,) array
        Half-widths of the tube, in the system's coordinates.
    """

    delta: float
    radii: Any


def certified_interval(system: System, q: Any, t: float, qd: Any) -> CertifiedInterval:
    """Return an interval of time on which the implicit function theorem is proved to hold around a pose.

    Parameters
    ----------
    system : System
        Compiled in its mechanism's own unit, for velocity at least.
    q, qd : (n,) array
        A pose at time t in the system's coordinates and its velocity, which is the direction v of the tube.
    """
    q, qd = np.asarray(q, float), np.asarray(qd, float)
    # A tube never reaches further than a radian or a size: the first interval is that of the fastest coordinate.
    first = 1.0 / max(float(np.max(np.abs(qd))), 2.0**-30 * max(1.0, abs(t)))
    best = CertifiedInterval(0.0, np.full(len(q), np.nan))
    for factors in (0.5 ** np.arange(LONGEST), None):
        if factors is None:  # between the one that is proved and its double, which is not
            factors = best.delta / first * (2 - np.arange(1, 16) / 16)
        lanes = [np.repeat(x[:, None], len(factors), axis=1) for x in (q, qd)]
        tubes = Tubes(system, lanes[0], lanes[1], np.full(len(factors), t), first * factors)
        proved = np.flatnonzero(tubes.proved & (first * factors > best.delta))
        if proved.size:
            best = CertifiedInterval(float(first * factors[proved[0]]), 2 * tubes.w[:, proved[0]])
        if best.delta == 0.0:
            break
    return best


class Tubes:
    """Tubes along q + v s, |s| <= half, at times t + s; `proved` where eta + 2 Z w <= 2 w. `off` widens them."""

    def __init__(self, system: System, q: Any, v: Any, t: Any, half: Any, off: Any = 0.0) -> None:
        with np.errstate(all="ignore"):  # what leaves the numbers' range is not proved
            rows = independent_rows(system, q, t)
            pose = Preconditioned(system, rows, q, t, 1)
            at_middle = pose.carried(pose.rows_of(pose.sharp.phi(box(q), pose.times)))
            swept = UP * np.abs(v) * half
            line, spans = box(q, swept), _Spans(t, half)
            along = _over_times(pose.system)
            rate = _times(pose.system.phi_q(line, pose.times), v) - along.nu(line, spans)
            moving = pose.carried(pose.rows_of(rate))
            eta = UP * (np.abs(at_middle[0]) + at_middle[1] + half * (np.abs(moving[0]) + moving[1]))
            self.w = w = eta + off + np.maximum(FLOOR * np.max(eta, axis=0), 64 * U)
            spread = pose.slope_over(UP * (swept + 2 * w)).spread
            defect = pose.defect_on(2 * w) + pose.spread_on(spread, 2 * w)
            self.proved = np.all(UP * (eta + defect) <= 2 * w, axis=0)


def _times(slope: Any, v: Any) -> Any:
    """Return slope v, number by number."""
    rates = box(v)
    out = np.empty(len(slope), object)
    for k, row in enumerate(slope):
        terms = (x * a for a, x in zip(row, rates, strict=True) if not (isinstance(a, int) and a == 0))
        out[k] = sum(terms, Bounded(0.0))
    return out


class _Spans(Times):
    """Times t within `half`; also how far each law's value and rate move there."""

    def __init__(self, t: Any, half: Any) -> None:
        super().__init__(t, 1)
        self.half = half

    def moves(self, constraint: Any, unit: Unit) -> Any:
        """Return bounds of |f(t + s) - f(t)| and |f'(t + s) - f'(t)| for each law, (laws, 2, B)."""
        with ctx.workprec(LAW_BITS):
            found = []
            for t, half in zip(self.t.tolist(), self.half.tolist(), strict=True):
                middle, over = arb(t), arb(t, half)
                at, around = constraint.inputs(middle, unit, 1), constraint.inputs(over, unit, 1)
                found.append([[half * _above(b[1]), _above(b[1] - a[1])] for a, b in zip(at, around, strict=True)])
        return np.moveaxis(np.array(found), 0, -1)


def _above(x: Any) -> float:
    return float(abs(arb(x)).upper()) * UP + TINY


class _OverTimes:
    """A constraint of a `bounded_system` whose laws are taken over the intervals of `_Spans`.

    As balls they are a rounding longer than they are: where a table ends, its last piece goes on for that long.
    """

    def __init__(self, rounded: Any) -> None:
        self.rounded, self.continued = rounded, continued(rounded.exact) if rounded.exact.laws else rounded.exact

    def __getattr__(self, name: str) -> Any:
        return getattr(self.rounded, name)

    def inputs(self, t: _Spans, unit: Unit, order: int) -> Any:
        laws = self.rounded.inputs(t, unit, order)
        if not laws:
            return laws
        moves = t.moves(self.continued, unit)
        return tuple(
            tuple(Bounded(x.mid, x.rounding, spread) for x, spread in zip(law, by, strict=True))
            for law, by in zip(laws, moves, strict=True)
        )


def _over_times(system: System) -> System:
    placed = tuple(replace(p, constraint=cast(Any, _OverTimes(p.constraint))) for p in system.placed)
    return replace(system, placed=placed)
