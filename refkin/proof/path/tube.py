"""Proofs that hold over an interval of time: one branch, and no other, in a tube that goes along with a pose.

Along a straight line c(s) = q + v s, t + s, |s| <= h, take the operator y -> y - R phi(c(s) + y, t + s) of
`certificate`, with one R for all s. By the mean value form phi(c(s), t + s) lies within |s| (phi_q v - nu) of
phi(q, t), both over the whole line. So with, in the norm |y| = max_k |y_k| / w_k,

    eta >= |R phi(q, t)| + h |R (phi_q(c) v - nu(c, t + s))|     Z >= |I - R phi_q(x)|, x within 2 w of the line,

where in eta phi_q may as well be that at t itself, if y goes along the line first and then t on. In space the rows of
an angle have its law in phi_q: Z is over all times |s| <= h, too. Then eta + 2 Z w <= 2 w proves: at every time
|s| <= h exactly one root lies within 2 w of c(s), and phi_q is regular there. By the implicit function theorem these
roots are one smooth motion q(t). Two poses that both lie in a tube, each at its time, are therefore poses of one
motion: no branch was changed between them.

`Tubes` tries many lines at once, in float64, with every rounding bounded; the laws of motion are enclosed over their
intervals of time in balls. `ConnectionProof` does the same in balls, one step after another.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field
from typing import Any

import numpy as np
from flint import arb, arb_mat, ctx

from refkin.proof.numbers.bounded import UP, Extended, Times, U, box, off_by
from refkin.proof.numbers.preconditioned import Preconditioned, independent_rows
from refkin.proof.pose.krawczyk import BallEquations, Enclosure, column, krawczyk
from refkin.system import System

FLOOR = 2.0**-36
"""Smallest half-width of a tube in units of its largest: a smaller one would only magnify what rounding leaves."""
WIDTHS, WIDER = 3, 0.625
"""How many widths are tried, each of as much of what the one before needed: a coordinate that hardly moves, as those of
a plate that does not turn, needs what the others lend it."""
BITS = 113
Between = Callable[[System, Any, float, float], Any]
"""Finds, from the pose q (n,) of a system at a time, the pose at a later time on the same branch; None if it cannot."""
DEEPEST = 40
"""How often a step is halved before a proof is given up: at a bifurcation there is no end to it."""

ENOUGH, LITTLE, GROWING = 1 / 4, 1 / 16, 3.0
"""A proof that has covered so little of its time with so many of its tubes is given up, unless they become longer: by
so much it has covered more than with half as many. Of a large mechanism each takes a second."""


class Tubes:
    """Tubes along q + v s, |s| <= half, at times t + s; `proved` where eta + 2 Z w <= 2 w. `off` widens them."""

    def __init__(self, system: System, q: Any, v: Any, t: Any, half: Any, off: Any = 0.0) -> None:
        with np.errstate(all="ignore"):  # what leaves the numbers' range is not proved
            rows = independent_rows(system, q, t)
            pose = Preconditioned(system, rows, q, t, 1)
            at_middle = pose.carried(pose.rows_of(pose.sharp.phi(box(q, 0.0, Extended), pose.times)))
            swept = UP * np.abs(v) * half
            line, over = box(q, swept), Times(t, 1, half)
            slope, nu = pose.system.phi_q(line, pose.times), pose.system.nu(line, over)
            moving = pose.carried(off_by(pose.rows_of(slope), v, pose.rows_of(nu)))
            eta = UP * (np.abs(at_middle[0]) + at_middle[1] + half * (np.abs(moving[0]) + moving[1]))
            self.w = w = eta + off + np.maximum(FLOOR * np.max(eta, axis=0), 64 * U)
            for _ in range(WIDTHS):
                wide = pose.slope_over(UP * (swept + 2 * w), over)
                needed = UP * (eta + pose.defect_on(wide, 2 * w) + pose.spread_on(wide.spread, 2 * w))
                self.w, self.proved = w, np.all(needed <= 2 * w, axis=0)
                if self.proved.all():
                    break
                w = np.where(self.proved, w, np.maximum(w, WIDER * needed))


@dataclass
class ConnectionProof:
    """Proves that poses of a system, compiled in its mechanism's own unit, belong to one motion.

    `tried` counts the tubes, at most `most`, `before` those of other steps; `covered` is how much of the time that is
    `asked` of this step they hold, `early` how much the first did. `between` finds poses in the middle of steps.
    """

    system: System
    most: int
    between: Between
    tried: int = field(default=0, init=False)
    before: int = field(default=0, init=False)
    covered: float = field(default=0.0, init=False)
    early: float = field(default=0.0, init=False)
    asked: float = field(default=0.0, init=False)
    last: Enclosure | None = field(default=None, init=False)

    def connects(self, t_0: float, t_1: float, q_0: Any, q_1: Any) -> bool:
        """Return whether it is proved that two poses (n,), at their times [s], belong to one motion."""
        first = self.last if self.last is not None and self.last.t == t_0 else krawczyk(self.system, q_0, t_0, BITS)
        self.last = last = krawczyk(self.system, q_1, t_1, BITS)
        if first is None or last is None:
            return False
        self.before, self.covered, self.asked = self.tried, 0.0, t_1 - t_0
        return self._connected(first, last, DEEPEST)

    def _connected(self, first: Enclosure, last: Enclosure, depth: int) -> bool:
        self.tried += 1
        with ctx.workprec(BITS):
            if self._tube_holds(first, last):
                self.covered += last.t - first.t
                return True
        if depth == 0 or self.tried >= self.most or self._is_far():
            return False
        middle = self._between(first, last)
        return (
            middle is not None
            and self._connected(first, middle, depth - 1)
            and self._connected(middle, last, depth - 1)
        )

    def _is_far(self) -> bool:
        """Whether the way would take many more tubes than there are, if it goes on as it did."""
        used = self.tried - self.before
        if used <= ENOUGH / 2 * self.most:
            self.early = self.covered
        little = self.covered < LITTLE * self.asked and self.covered <= GROWING * self.early
        return used >= max(DEEPEST, ENOUGH * self.most) and little  # the first may be halvings alone

    def _between(self, first: Enclosure, last: Enclosure) -> Enclosure | None:
        """Return the pose that is found halfway from the first."""
        t = (first.t + last.t) / 2
        q = self.between(self.system, first.nearest(), first.t, t) if first.t < t < last.t else None
        return None if q is None else krawczyk(self.system, q, t, BITS)

    def _tube_holds(self, first: Enclosure, last: Enclosure) -> bool:
        """Whether one tube along the line between two roots holds both; see `tube` for the condition."""
        a, b = ([x.mid() for x in end.q] for end in (first, last))
        length = arb(last.t) - arb(first.t)
        t, half = (arb(first.t) + arb(last.t)) / 2, (length / 2).upper()
        middle = [(x + y) / 2 for x, y in zip(a, b, strict=True)]
        v = [(y - x) / length for x, y in zip(a, b, strict=True)]
        here, over = (BallEquations(self.system, at, first.rows, BITS) for at in (t, t + arb(0, half)))
        inverse = here.inverse(middle)
        if inverse is None:
            return False
        line = [x + r * arb(0, half) for x, r in zip(middle, v, strict=True)]
        moving = over.slope(line) * column(v) - over.nu(line)
        still = inverse * here.phi(middle)
        eta = [
            abs(x).upper() + half * abs(y).upper()
            for x, y in zip(still.entries(), (inverse * moving).entries(), strict=True)
        ]
        ends = [2 * (x.rad() + y.rad()) for x, y in zip(first.q, last.q, strict=True)]
        floor = max(eta) * 2.0**-70 + arb(2) ** -100
        w = [(x + r + floor).upper() for x, r in zip(eta, ends, strict=True)]
        identity = arb_mat(len(w), len(w), 1)
        for _ in range(WIDTHS):
            wide = [x + arb(0, 2 * y) for x, y in zip(line, w, strict=True)]
            defect = identity - inverse * over.slope(wide)
            reach = [sum((abs(defect[i, j]) * 2 * w[j] for j in range(len(w))), arb(0)) for i in range(len(w))]
            needed = [(e + r).upper() for e, r in zip(eta, reach, strict=True)]
            if all(y < 2 * x for y, x in zip(needed, w, strict=True)):
                return True
            w = [max(x, (WIDER * y).upper()) for x, y in zip(w, needed, strict=True)]
        return False
