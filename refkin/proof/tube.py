"""Proofs that hold over an interval of time: one branch, and no other, in a tube that goes along with a pose.

Along a straight line c(s) = q + v s, t + s, |s| <= h, the operator of `certificate`, y -> y - R phi(c(s) + y, t + s),
is the same for all s. By the mean value form phi(c(s), t + s) lies within |s| (phi_q v - nu) of phi(q, t), both over
the whole line. So with, in the norm |y| = max_k |y_k| / w_k,

    eta >= |R phi(q, t)| + h |R (phi_q(c) v - nu(c, t + s))|     Z >= |I - R phi_q(x)|, x within 2 w of the line,

eta + 2 Z w <= 2 w proves: at every time |s| <= h exactly one root lies within 2 w of c(s), and phi_q is regular there.
By the implicit function theorem these roots are one smooth motion q(t). Two poses that both lie in a tube, each at its
time, are therefore poses of one motion: no branch was changed between them.

Lines of many poses are tried at once, in float64, with every rounding bounded; the laws of motion are enclosed over
their intervals of time in balls.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Any, cast

import numpy as np
from flint import arb, ctx

from refkin.joints import Unit
from refkin.proof.bounded import LAW_BITS, TINY, UP, Bounded, Times, U, box
from refkin.proof.certificate import certify
from refkin.proof.krawczyk import krawczyk
from refkin.proof.preconditioned import Preconditioned, independent_rows
from refkin.sweep import Arrival, Sweep
from refkin.system import System

FLOOR = 2.0**-20
"""Smallest half-width of a tube in units of its largest: a smaller one would only magnify what rounding leaves."""
LONGEST = 64
"""Half-widths of the interval of time that are tried: halvings of the first."""
MOST_PIECES = 2**15
"""Pieces into which a motion is cut before a proof is given up; a turn of a well-conditioned linkage needs about 50."""
NARROWEST = 2.0**-46
"""Length of a piece, in units of its time, below which it is not cut again."""


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
        along, moving = (np.repeat(x[:, None], len(factors), axis=1) for x in (q, qd))
        tubes = _Tubes(system, along, moving, np.full(len(factors), t), first * factors)
        proved = np.flatnonzero(tubes.proved & (first * factors > best.delta))
        if proved.size:
            best = CertifiedInterval(float(first * factors[proved[0]]), 2 * tubes.w[:, proved[0]])
        if best.delta == 0.0:
            break
    return best


def first_gap(system: System, t: Any, q: Any) -> int | None:
    """Return the first k for which it is not proved that poses k and k + 1 belong to one motion; None if all do.

    Parameters
    ----------
    system : System
        Compiled in its mechanism's own unit, for velocity at least.
    t, q : (T,) and (n, T) array
        Times in increasing order, and the poses there, in the system's coordinates.
    """
    t, q = np.asarray(t, float), np.asarray(q, float)
    radii = _error_bounds(system, q, t)
    unproved = np.flatnonzero(~np.isfinite(radii).all(axis=0))
    first, pieces = (max(0, int(unproved[0]) - 1) if unproved.size else len(t)), 0
    ends = [_between(k, t, q, radii) for k in range(min(first, len(t) - 1))]
    while ends:
        pieces += len(ends)
        linked = _linked(system, *(_stacked(ends, k) for k in range(6)))
        open_ = [end for end, link in zip(ends, linked, strict=True) if not link and end[6] < first]
        too_short = [e[6] for e in open_ if e[1] - e[0] <= NARROWEST * max(abs(e[0]), abs(e[1]), 1.0)]
        if pieces + 2 * len(open_) > MOST_PIECES:
            too_short = [e[6] for e in open_]
        first = min([first, *(int(k) for k in too_short)])
        halves, lost = _halved(system, [e for e in open_ if e[6] < first])
        first = min([first, *lost])
        ends = [e for e in halves if e[6] < first]
    return None if first == len(t) else first


def _error_bounds(system: System, q: Any, t: Any) -> Any:
    """Return proved bounds of the error of each coordinate, (n, B); NaN where there are none."""
    proof = certify(system, q, t)
    radii = np.where(proof.ok, proof.radii, np.nan)
    for lane in np.flatnonzero(~proof.ok & np.isfinite(q).all(axis=0)):
        enclosure = krawczyk(system, q[:, lane], t[lane])
        if enclosure is not None:
            radii[:, lane] = enclosure.distance(q[:, lane])
    return radii


def _between(k: int, t: Any, q: Any, radii: Any) -> Piece:
    return t[k], t[k + 1], q[:, k], q[:, k + 1], radii[:, k], radii[:, k + 1], k


Piece = tuple[Any, Any, Any, Any, Any, Any, Any]
"""Two times, the poses there, bounds of their errors, and the number of the given pose before them."""


def _stacked(ends: list[Piece], k: int) -> Any:
    return np.stack([end[k] for end in ends], axis=-1)


def _halved(system: System, ends: list[Piece]) -> tuple[list[Piece], list[int]]:
    """Return the pieces cut at a pose found in their middles; and those where none was found, by number."""
    found: list[Any] = []
    lost: list[int] = []
    for end in ends:
        sweep, middle = Sweep(system, [end[0]], [end[2]]), (end[0] + end[1]) / 2
        if end[0] < middle < end[1] and sweep.to(middle) is Arrival.REACHED:
            found.append((end, middle, sweep.q[-1]))
        else:
            lost.append(int(end[6]))
    if not found:
        return [], lost
    radii = _error_bounds(system, _stacked(found, 2), _stacked(found, 1))
    halves = []
    for (end, t, q), radius in zip(found, radii.T, strict=True):
        halves.append((end[0], t, end[2], q, end[4], radius, end[6]))
        halves.append((t, end[1], q, end[3], radius, end[5], end[6]))
    return halves, lost


def _linked(system: System, t_0: Any, t_1: Any, q_0: Any, q_1: Any, r_0: Any, r_1: Any) -> Any:
    """Return for each pair of poses whether one tube holds them both, (B,)."""
    t, q = (t_0 + t_1) / 2, (q_0 + q_1) / 2
    half = np.maximum(t_1 - t, t - t_0) * UP
    v = (q_1 - q_0) / (t_1 - t_0)
    off = 8 * U * (np.abs(q_0) + np.abs(q_1)) + np.maximum(r_0, r_1)
    tubes = _Tubes(system, q, v, t, half, off)
    away = [np.abs((end - q) - v * (at - t)) for end, at in ((q_0, t_0), (q_1, t_1))]
    return tubes.proved & np.all(np.maximum(*away) + off <= 2 * tubes.w, axis=0)


class _Tubes:
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
        out[k] = sum(
            (x * a for a, x in zip(row, rates, strict=True) if not (isinstance(a, int) and a == 0)), Bounded(0.0)
        )
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
    """A constraint of a `bounded_system` whose laws are taken over the intervals of `_Spans`."""

    def __init__(self, rounded: Any) -> None:
        self.rounded = rounded

    def __getattr__(self, name: str) -> Any:
        return getattr(self.rounded, name)

    def inputs(self, t: _Spans, unit: Unit, order: int) -> Any:
        laws = self.rounded.inputs(t, unit, order)
        if not laws:
            return laws
        moves = t.moves(self.rounded.exact, unit)
        return tuple(
            tuple(Bounded(x.mid, x.rounding, spread) for x, spread in zip(law, by, strict=True))
            for law, by in zip(laws, moves, strict=True)
        )


def _over_times(system: System) -> System:
    placed = tuple(replace(p, constraint=cast(Any, _OverTimes(p.constraint))) for p in system.placed)
    return replace(system, placed=placed)
