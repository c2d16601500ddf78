"""The proof of `tube` in ball arithmetic, one step at a time: that two poses belong to one motion."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field
from typing import Any

import numpy as np
from flint import arb, arb_mat, ctx

from refkin.proof.numbers.exact import exact_system
from refkin.proof.pose.krawczyk import Enclosure, krawczyk
from refkin.system import System

BITS = 113
Between = Callable[[System, Any, float, float], Any]
"""Finds, from the pose q (n,) of a system at a time, the pose at a later time on the same branch; None if it cannot."""
DEEPEST = 40
"""How often a step is halved before a proof is given up: at a bifurcation there is no end to it."""


@dataclass
class Linker:
    """Links poses of a system, compiled in its mechanism's own unit; `tried` counts the tubes, at most `most`."""

    system: System
    most: int
    between: Between
    tried: int = field(default=0, init=False)
    last: Enclosure | None = field(default=None, init=False)

    def links(self, t_0: float, t_1: float, q_0: Any, q_1: Any) -> bool:
        """Return whether it is proved that the poses q_0 and q_1 (n,), at their times, belong to one motion."""
        first = self.last if self.last is not None and self.last.t == t_0 else krawczyk(self.system, q_0, t_0, BITS)
        self.last = last = krawczyk(self.system, q_1, t_1, BITS)
        if first is None or last is None:
            return False
        return self._linked(first, last, DEEPEST)

    def _linked(self, first: Enclosure, last: Enclosure, depth: int) -> bool:
        self.tried += 1
        with ctx.workprec(BITS):
            if self._tube_holds(first, last):
                return True
        if depth == 0 or self.tried >= self.most:
            return False
        middle = self._between(first, last)
        return middle is not None and self._linked(first, middle, depth - 1) and self._linked(middle, last, depth - 1)

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
        equations = _Rows(self.system, first.rows)
        inverse = equations.slope(middle, t).inv(nonstop=True).mid()
        if not all(x.is_finite() for x in inverse.entries()):
            return False
        line = [x + r * arb(0, half) for x, r in zip(middle, v, strict=True)]
        moving = equations.slope(line, t + arb(0, half)) * _column(v) - equations.nu(line, t + arb(0, half))
        still = inverse * equations.phi(middle, t)
        eta = [
            abs(x).upper() + half * abs(y).upper()
            for x, y in zip(still.entries(), (inverse * moving).entries(), strict=True)
        ]
        ends = [2 * (x.rad() + y.rad()) for x, y in zip(first.q, last.q, strict=True)]
        floor = max(eta) * 2.0**-70 + arb(2) ** -100
        w = [(x + r + floor).upper() for x, r in zip(eta, ends, strict=True)]
        wide = [x + arb(0, 2 * y) for x, y in zip(line, w, strict=True)]
        identity = arb_mat(len(w), len(w), 1)
        defect = identity - inverse * equations.slope(wide, t + arb(0, half))
        reach = [sum((abs(defect[i, j]) * 2 * w[j] for j in range(len(w))), arb(0)) for i in range(len(w))]
        return all(e + r < 2 * x for e, r, x in zip(eta, reach, w, strict=True))


class _Rows:
    """n rows of a system's equations in balls, at times that are balls."""

    def __init__(self, system: System, rows: Any) -> None:
        self.system, self.rows = exact_system(system, BITS), rows

    def phi(self, q: Any, t: Any) -> Any:
        return _column(self.system.phi(_objects(q), t)[self.rows])

    def nu(self, q: Any, t: Any) -> Any:
        return _column(self.system.nu(_objects(q), t)[self.rows])

    def slope(self, q: Any, t: Any) -> Any:
        return arb_mat(self.system.phi_q(_objects(q), t)[self.rows].tolist())


def _objects(q: Any) -> Any:
    out = np.empty(len(q), object)
    out[:] = list(q)
    return out


def _column(entries: Any) -> Any:
    return arb_mat([[x] for x in entries])
