"""What closed form alone does not place: groups larger than a dyad, by way of one angle that is not known.

With one more angle given, a triad (a body on three links, a four-bar driven at its coupler point) falls into steps of closed
form again, with one row left over. Over an interval of that angle, in numbers with slopes, every branch may end by proof:
then no assembly has its angle there. Intervals that are left are halved; if none is left, there is no assembly. The
middle of each interval is a start for Newton's method.

Where one angle is not enough the starts come from a fixed sequence of angles (Halton), and nothing is proved.
"""

from __future__ import annotations

import math
from collections.abc import Iterator
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from flint import arb
from scipy.optimize import least_squares

from refkin.differences import EPS
from refkin.joints import GROUND
from refkin.motion import Array
from refkin.newton import newton
from refkin.proof.clusters import Plan, headings, plan
from refkin.proof.placing import Branch, End, place
from refkin.proof.rows import Rows, Tie
from refkin.proof.slopes import Slope, interval, whole
from refkin.system import System

FIRST_INTERVALS = 32
MOST_INTERVALS = 2000
"""How many intervals are looked at before a proof is given up: about a second for a triad."""
MOST_STARTS = 64
MOST_POSES = 32
SAME = 1e-7
"""Largest component by which two poses may differ that count as one."""
NAME = "trial angle"
PRIMES = (2, 3, 5, 7, 11, 13, 17, 19)


@dataclass(frozen=True)
class Found:
    """What a search came to: assemblies, or the end of all intervals, or neither."""

    poses: tuple[Array, ...] = ()
    end: End | None = None
    note: str = ""


def search(system: System, t: float, rows: Rows) -> Found:
    """Look for assemblies of a system that closed form does not place, and for the proof that there is none."""
    return _Search(system, t, rows).run()


class _Search:
    def __init__(self, system: System, t: float, rows: Rows) -> None:
        self.system, self.t, self.rows = system, t, rows
        self.names = [body.name for body in system.mechanism.bodies]
        self.scale = system.unit.size
        self.turned, self.plan = self._trial_angles()

    def run(self) -> Found:
        if len(self.turned) != 1 or self.rows.foreign:
            return Found(self._assemblies(self._halton()), note="the group is larger than a triad: no proof was tried")
        intervals = _Intervals(self)
        intervals.halve(FIRST_INTERVALS)
        poses = self._assemblies(intervals.middles())
        if poses:
            return Found(poses)
        intervals.halve(MOST_INTERVALS)
        if not intervals.open:
            return Found(end=intervals.end)
        poses = self._assemblies((*intervals.middles(), *self._halton()))
        width = intervals.width
        return Found(poses, note=f"{len(intervals.open)} intervals of {width:.2g} rad were not excluded")

    def at(self, angles: tuple[Any, ...]) -> Rows:
        """Return the rows with the trial angles given."""
        ties = tuple(Tie(GROUND, body, a, NAME) for body, a in zip(self.turned, angles, strict=True))
        return replace(self.rows, ties=(*self.rows.ties, *ties))

    def _trial_angles(self) -> tuple[tuple[str, ...], Plan]:
        """Return the bodies whose angles, if known, let closed form go furthest, one after another."""
        turned: tuple[str, ...] = ()
        best = plan(self.rows, self.names)
        known = next(h for h in headings(self.rows, self.names) if GROUND in h)
        while not turned or len(best.clusters) > 1:
            plans = [(b, self._plan((*turned, b))) for b in self.names if b not in (*turned, *known)]
            if not plans:
                break
            body, best = min(plans, key=lambda p: len(p[1].clusters))
            turned = (*turned, body)
        return turned, best

    def _plan(self, turned: tuple[str, ...]) -> Plan:
        ties = (Tie(GROUND, body, arb(0), NAME) for body in turned)
        return plan(replace(self.rows, ties=(*self.rows.ties, *ties)), self.names)

    def _halton(self) -> Iterator[tuple[float, ...]]:
        for k in range(1, MOST_STARTS + 1):
            yield tuple(math.tau * radical_inverse(k, p) - math.pi for _, p in zip(self.turned, PRIMES, strict=False))

    def _assemblies(self, trials: Any) -> tuple[Array, ...]:
        """Return the different assemblies that Newton reaches from the trial angles."""
        found: list[Array] = []
        for angles in trials:
            for start in self._starts(angles):
                q = self._refined(start)
                if q is not None and not any(np.max(np.abs(q - other)) < SAME for other in found):
                    found.append(q)
                if len(found) == MOST_POSES:
                    return tuple(found)
        return tuple(found)

    def _starts(self, angles: tuple[float, ...]) -> Iterator[Array]:
        padded = (*angles, *(0.0 for _ in self.turned[len(angles) :]))
        rows = self.at(tuple(arb(a) for a in padded))
        placement = place(self.plan, rows, self.names, self.scale, holding=False)
        for branch in (*placement.branches, *placement.stuck):
            yield coordinates(self.system, branch)

    def _refined(self, start: Array) -> Array | None:
        s, t = self.system, self.t
        for damped in (False, True):
            result = newton(lambda q: s.phi(q, t), lambda q: s.phi_q(q, t), start, damped=damped, max_iterations=40)
            if result.converged and closes(s, result.q, t):
                return self._without_turns(result.q)
        result = least_squares(lambda q: s.phi(q, t), start, jac=lambda q: s.phi_q(q, t), method="lm", max_nfev=60)
        return self._without_turns(result.x) if closes(s, result.x, t) else None

    def _without_turns(self, q: Array) -> Array:
        """Return the pose with each heading that no driver counts turned back into (-pi, pi]."""
        q = q.copy()
        for heading in headings(self.rows, self.names):
            if GROUND not in heading:
                phi = [self.system.columns(body).stop - 1 for body in self.names if body in heading]
                q[phi] -= math.tau * math.ceil(q[phi[0]] / math.tau - 0.5)
        return q


class _Intervals:
    """Intervals of the trial angle that may hold an assembly, by width."""

    def __init__(self, search: _Search) -> None:
        self.search = search
        # A little more than a turn, so that the ends of the interval are inside as well.
        self.open, self.width = [(-3.1416, 3.1416)], 6.2832
        self.looked_at = 0
        self.end: End | None = None

    def halve(self, most: int) -> None:
        """Halve and exclude until nothing is left, or the next halving would go beyond `most` intervals."""
        while self.open and self.looked_at + 2 * len(self.open) <= most:
            self.looked_at += 2 * len(self.open)
            halves = [half for low, high in self.open for half in _halves(low, high)]
            self.open = [part for part in halves if not self._excluded(part)]
            self.width /= 2

    def middles(self) -> tuple[tuple[float], ...]:
        """Return the middles of the open intervals: all, or some evenly."""
        step = -(-len(self.open) // MOST_STARTS) or 1
        return tuple(((low + high) / 2,) for low, high in self.open[::step])

    def _excluded(self, part: tuple[float, float]) -> bool:
        search = self.search
        placement = place(search.plan, search.at((interval(*part),)), search.names, search.scale)
        if not placement.impossible:
            return False
        least = min(placement.ends, key=lambda end: float(end.gap.lower()))
        if self.end is None or float(least.gap.lower()) < float(self.end.gap.lower()):
            self.end = least
        return True


def _halves(low: float, high: float) -> tuple[tuple[float, float], tuple[float, float]]:
    middle = (low + high) / 2
    return (low, middle), (middle, high)


def radical_inverse(k: int, base: int) -> float:
    """Return the digits of k in a base, mirrored at the point: one coordinate of Halton's sequence."""
    value, weight = 0.0, 1.0 / base
    while k:
        k, digit = divmod(k, base)
        value += digit * weight
        weight /= base
    return value


def closes(system: System, q: Array, t: float) -> bool:
    """Whether the residual of a pose is round-off."""
    residual = float(np.max(np.abs(system.phi(q, t))))
    return residual <= 32 * EPS * max(1.0, float(np.max(np.abs(q))))


def coordinates(system: System, branch: Branch) -> Array:
    """Return the middles of a branch's balls as coordinates."""
    q = np.zeros(system.n)
    for body in system.mechanism.bodies:
        pose = branch.poses[body.name]
        q[system.columns(body.name)] = [float(whole(x).mid()) for x in (pose.r.x, pose.r.y, pose.phi)]
    return q
