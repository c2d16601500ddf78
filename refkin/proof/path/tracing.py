"""Points one after another along a `Curve`: steps, turning points, bifurcations, and why a trace ends."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass, field
from enum import StrEnum
from typing import Any

import numpy as np

from refkin.proof.numbers.extrema import LISTED, extrema_of
from refkin.proof.path.blocks import Blocks, blocks
from refkin.proof.path.curve import Crossing, Curve, crossing

FIRST_STEP = 1e-2
SHORTEST = 1e-11
"""Length below which a step is not halved again."""
BEND = 0.15
"""Largest angle between the tangents at the ends of a step, and between the first and the step itself [rad]: where
curves all but meet, rounding moves a point farther than a very short step does."""
FASTER = 1.5
"""Factor by which steps grow where the curve is nearly straight."""
STANDING = 1e-9
"""Part of a tangent along t below which t stands still."""
CLOSE = 1e-5
"""Length of a step within which two turning points of t are not told from none."""
INSIDE = (0.2, 0.5, 0.8)
"""Parts of a step at which the rate of t is looked at where t may turn within it."""
SAME = 1e-7
"""Distance at which a trace has come back to its start."""


class TraceEnd(StrEnum):
    """Why a path ends."""

    RANGE = "the parameter leaves its range"
    CLOSED = "the path closes"
    """It has come back to its start."""
    BIFURCATION = "a bifurcation: choose a tangent"
    POINTS = "the most points are reached"
    STOPPED = "no step is small enough"
    NO_START = "there is no pose to start from"


@dataclass
class Trace:
    """Points (n + 1,) of a curve; by their numbers those where t turns, and those where curves cross."""

    points: list[Any] = field(default_factory=list)
    turning: list[tuple[int, bool]] = field(default_factory=list)
    crossings: list[tuple[int, Crossing, Any]] = field(default_factory=list)
    end: TraceEnd = TraceEnd.NO_START


Chooser = Callable[[int, Crossing, Any], Any]
"""Returns the tangent to go on in at a crossing, or None, from its number and the tangent in which it was reached."""


class Tracer:
    """Traces a curve from a point x between two values of t, `limits`, which are in the unit of the points.

    With `t_turns` t is an angle: the curve closes after a whole turn of it too.
    """

    def __init__(
        self, curve: Curve, limits: tuple[float, float], max_step: float, most_points: int, t_turns: bool = False
    ) -> None:
        self.curve, self.limits, self.t_turns = curve, limits, t_turns
        self.max_step, self.most_points = max_step, most_points
        self.trace = Trace()
        self.blocks: Blocks | None = None
        self.at_crossing = False

    def run(self, start: Any, along: Any, direction: int, choose: Chooser) -> Trace:
        """Trace the curve from a point near it.

        Parameters
        ----------
        start : (n + 1,) array
            The point.
        along : (n + 1,) array or None
            The vector to set out in; None for that in which the parameter grows.
        direction : int
            Without `along`: 1 if the parameter is to grow at first, -1 if it is to fall.
        choose : callable
            The branch to go on with where curves cross.
        """
        here = self._crossing_at(start)  # where many curves cross, Newton's method may end nowhere
        x = self._first(start) if here is None else here.x
        if x is None:
            return self.trace
        here = here or self._crossing_at(x)
        if here is not None:
            x, self.at_crossing = here.x, True
        self.trace.points.append(x)
        if here is not None and along is None and len(here.tangents) > 1:
            return self._crossed(here, None)
        if here is not None:
            tangent = _nearest(here, direction * _along_t(len(x)) if along is None else along)
        else:
            tangent = self.curve.tangent(x, along) * (direction if along is None else 1)
        h = first = min(FIRST_STEP, self.max_step)
        while len(self.trace.points) < self.most_points:
            outcome = self._step(x, tangent, h)
            if isinstance(outcome, Crossing):
                self.trace.points.append(outcome.x)
                if not outcome.is_decided:
                    return self._ended(TraceEnd.STOPPED)
                chosen = _nearest(outcome, tangent)
                if len(outcome.tangents) > 1:
                    chosen = choose(len(self.trace.points) - 1, outcome, tangent)
                    if chosen is None:
                        return self._crossed(outcome, tangent)
                    self.trace.crossings.append((len(self.trace.points) - 1, outcome, tangent))
                x, tangent, h = outcome.x, chosen / np.linalg.norm(chosen), first
                self.at_crossing = True
                continue
            if outcome is None:
                return self._ended(TraceEnd.STOPPED)
            self.at_crossing, (new, after, h) = False, outcome
            end = self._passed(x, tangent, new, after, h)
            if end is not None:
                return self._ended(end)
            if len(self.trace.points) < self.most_points:  # a turning point may have been the last
                self.trace.points.append(new)
            straight = float(tangent @ after) > math.cos(BEND / 2)
            x, tangent, h = new, after, min(h * FASTER, self.max_step) if straight else h
        return self._ended(TraceEnd.POINTS)

    def _crossing_at(self, x: Any) -> Crossing | None:
        """Return the bifurcation that a point is at, if it is at one."""
        here = crossing(self.curve, x) if self.curve.clearance(x) < math.sqrt(SAME) else None
        is_here = here is not None and here.is_decided and np.max(np.abs(here.x - x)) < math.sqrt(SAME)
        return here if is_here else None

    def _first(self, start: Any) -> Any:
        """Return the point of the curve at the same t as a point near it, or, at a singular pose, near it; or None."""
        for across in (_along_t(len(start)), None):
            result = self.curve.corrected(start, self.curve.tangent(start) if across is None else across)
            if result.converged and np.max(np.abs(result.q - start)) <= 1.0:
                return result.q
        return None

    def _step(self, x: Any, tangent: Any, h: float) -> tuple[Any, Any, float] | Crossing | None:
        """Return the next point, its tangent and the step that led there; a crossing on the way; or None."""
        while h >= SHORTEST and not self.curve.is_locked(x):
            new = self.curve.stepped(x, tangent, h)
            after = None if new is None else self.curve.tangent(new, tangent)
            straight = new is not None and min(tangent @ after, h / np.linalg.norm(new - x)) >= math.cos(BEND)
            if straight and not (_turns_twice(x, tangent, new, after) or self._turns_unseen(x, tangent, new, after, h)):
                rows = self.curve.rows(new)
                if self.at_crossing or self.curve.side(new, after, rows) == self.curve.side(x, tangent, rows):
                    if self._same_sides(x, tangent, new, after) and not self._touches(x, new):
                        end = self._crossing(x, new, off=BEND) if self._may_cross(x, new) else None
                        if end is None and (self.at_crossing or not self._turns_over(x, tangent, new, after, rows)):
                            return new, after, h
                    else:
                        end = self._crossing(x, new, least=2)
                else:
                    end = self._crossing(x, new)
                if end is not None and (end.is_decided or h < CLOSE):
                    return end
            h /= 2
        return None

    def _may_cross(self, x: Any, new: Any) -> bool:
        """Whether an end of a step is as near to a crossing as a step that passes two of them begins or ends.

        They leave all signs as they were. A step of 1 changes the matrix by about 1, and so its clearance.
        """
        return min(map(self.curve.clearance, (x, new))) < float(np.linalg.norm(new - x)) / 2

    def _turns_over(self, x: Any, tangent: Any, new: Any, after: Any, rows: Any) -> bool:
        """Whether directions turn over between the matrices at the ends of a step: two at once leave the sign.

        The shorter a step is along a curve, the nearer is what leads from one matrix to the other to the identity.
        """
        here, there = (np.vstack([self.curve.slope(y)[rows], v]) for y, v in ((x, tangent), (new, after)))
        return bool(np.linalg.eigvals(np.linalg.lstsq(here, there)[0]).real.min() < 0.0)

    def _turns_unseen(self, x: Any, tangent: Any, new: Any, after: Any, h: float) -> bool:
        """Whether t turns within a step oftener than the signs of its rate at the ends say: once, or not at all.

        Asked where the rate of t at an end is so small that a tangent which strays by `BEND` / 2 can lose it. The rate
        is taken to be the polynomial through its values at both ends and at `INSIDE`.
        """
        smaller = min(abs(tangent[-1]), abs(after[-1]))
        if np.linalg.norm(new - x) <= CLOSE or not STANDING < smaller <= math.sin(BEND / 2):
            return False
        inside = [self.curve.corrected(x + part * h * tangent, tangent) for part in INSIDE]
        if not all(y.converged for y in inside):
            return True
        rates = [tangent[-1], *(self.curve.tangent(y.q, tangent)[-1] for y in inside), after[-1]]
        between = np.polynomial.Polynomial.fit((0.0, *INSIDE, 1.0), rates, len(INSIDE) + 1)(np.linspace(0.0, 1.0, 65))
        clear = np.sign([tangent[-1], *between[np.abs(between) > STANDING], after[-1]])
        return int(np.count_nonzero(np.diff(clear))) > int(clear[0] != clear[-1])

    def _same_sides(self, x: Any, tangent: Any, new: Any, after: Any) -> bool:
        """Whether the blocks of phi_q have the signs they had, which they keep where t does not turn.

        Two crossings passed at once change the sign of the determinant twice.
        """
        system, turns = self.curve.system, tangent[-1] * after[-1] <= 0
        if turns or min(abs(tangent[-1]), abs(after[-1])) < STANDING:
            return True
        if self.at_crossing:  # from a crossing each of its curves goes on with signs of its own
            return True
        (q, t), pose = self.curve.pose(x), self.curve.pose(new)
        if self.blocks is None or system.m > system.n:  # which rows are independent changes along the way
            self.blocks = blocks(system, q, t)
        here, there = (self.blocks.determinants(system.phi_q(*at))[0] for at in ((q, t), pose))
        return here == there

    def _touches(self, x: Any, new: Any) -> bool:
        """Whether a law turns back between two points where another curve is: they touch, and no sign changes."""
        times = sorted(float(y[-1] * self.curve.scale[-1]) for y in (x, new))
        turning = extrema_of(self.curve.system.mechanism.constraints, *times)
        if len(turning) > LISTED:
            return True
        for t in turning:
            part = (t / self.curve.scale[-1] - x[-1]) / (new[-1] - x[-1])
            there = self.curve.corrected(x + part * (new - x), _along_t(len(x)))
            if not (there.converged and self.curve.clearance(there.q) > SAME):
                return True
        return False

    def _crossing(self, x: Any, new: Any, least: int = 1, off: float = 1.0) -> Crossing | None:
        """Return the bifurcation between two points, if the curves do cross there and not only pass by each other.

        That of several rows may be undecided. `least` is how many rows must depend there at once, `off` how far from
        the chord it may lie, as a part of it. It is not the one that the step begins at.
        """
        chord = new - x
        length = float(np.linalg.norm(chord))
        for part in (0.5, 0.1, 0.9):
            branch_point = crossing(self.curve, x + part * chord, 2.0 * length)
            if branch_point is None or len(branch_point.forms) < least:
                continue
            if branch_point.is_decided or (len(branch_point.forms) > 1 and branch_point.is_bifurcation):
                way = branch_point.x - x
                at = way @ chord / length**2
                again = self.at_crossing and np.max(np.abs(way)) < math.sqrt(SAME) * length
                if -0.01 <= at <= 1.01 and np.linalg.norm(way - at * chord) <= off * length and not again:
                    return branch_point
        return None

    def _passed(self, x: Any, tangent: Any, new: Any, after: Any, h: float) -> TraceEnd | None:
        """Note a turning point of this step; return why the trace ends in it, if it does."""
        turns = tangent[-1] * after[-1] < 0 and max(abs(tangent[-1]), abs(after[-1])) > STANDING
        stops = [(h, new)]
        if turns:
            at = self._where(x, tangent, h, lambda y: self.curve.tangent(y, tangent)[-1])
            stops.insert(0, at)
        closing = self._closing(x, tangent, h)
        for k, (s, y) in enumerate(stops):
            outside = [limit for limit, way in zip(self.limits, (-1, 1), strict=True) if way * (y[-1] - limit) > 0]
            if closing is not None and closing <= s:
                self.trace.points.append(self.trace.points[0] + self._turns(new))
                return TraceEnd.CLOSED
            if outside:
                self._stop_at(x, tangent, s, outside[0])
                return TraceEnd.RANGE
            if turns and k == 0:
                self.trace.points.append(y)
                self.trace.turning.append((len(self.trace.points) - 1, bool(tangent[-1] > 0)))
        return None

    def _where(self, x: Any, tangent: Any, h: float, value: Callable[[Any], float]) -> tuple[float, Any]:
        """Return the step, at most h, and the point there, at which a function of the point is zero."""
        from scipy.optimize import brentq  # here, because importing it costs more than the rest of refkin

        def at(s: float) -> Any:
            y = x if s == 0.0 else self.curve.corrected(x + s * tangent, tangent).q
            return float(value(y))

        s = float(brentq(at, 0.0, h, xtol=1e-15, rtol=1e-15)) if at(0.0) * at(h) < 0 else h
        return s, self.curve.corrected(x + s * tangent, tangent).q

    def _stop_at(self, x: Any, tangent: Any, h: float, limit: float) -> None:
        """Add the point at which t reaches a limit, exactly, unless the trace is there already."""
        _, y = self._where(x, tangent, h, lambda y: float(y[-1] - limit))
        guess = np.append(y[:-1], limit)
        exact = self.curve.corrected(guess, _along_t(len(y)))
        y = exact.q if exact.converged and np.max(np.abs(exact.q - guess)) < 1e-3 else y
        if x[-1] != limit:
            self.trace.points.append(y)

    def _turns(self, x: Any) -> Any:
        """Return the whole turns of angles by which x differs from the first point; p and -p of a body are one turn."""
        system = self.curve.system
        period = 2 * math.pi / np.append(np.ones(system.n), self.curve.scale[-1])
        angles = np.append(system.angles, self.t_turns)
        first = self.trace.points[0]
        turns = np.where(angles, period * np.round((x - first) / period), 0.0)
        width, parameters = system.kind.width, np.flatnonzero(np.equal(system.kind.turns, 2.0))
        for start in range(0, system.of_bodies if parameters.size else 0, width):
            p = start + parameters
            if (x[p] * self.curve.scale[p]) @ (first[p] * self.curve.scale[p]) < 0.0:
                turns[p] = -2.0 * first[p]
        return turns

    def _closing(self, x: Any, tangent: Any, h: float) -> float | None:
        """Return the length of step that ends at the start, whole turns aside; None if this step does not."""
        if len(self.trace.points) < 4:
            return None
        back = self.trace.points[0] + self._turns(x) - x
        s = float(back @ tangent)
        if not (0 < s <= h):
            return None
        y = self.curve.corrected(x + s * tangent, tangent).q
        return s if np.max(np.abs(y - x - back)) < SAME else None

    def _crossed(self, branch_point: Crossing, incoming: Any) -> Trace:
        self.trace.crossings.append((len(self.trace.points) - 1, branch_point, incoming))
        return self._ended(TraceEnd.BIFURCATION)

    def _ended(self, end: TraceEnd) -> Trace:
        self.trace.end = end
        return self.trace


def _turns_twice(x: Any, tangent: Any, new: Any, after: Any) -> bool:
    """Whether t, which goes the same way at both ends of a step, nearly stands still, or turns twice, in between.

    Its rate in the middle, m, follows from the way that t goes (Simpson's rule); the rate is that of the parabola.
    """
    length, way = float(np.linalg.norm(new - x)), float(np.sign(tangent[-1]))
    first, last = way * float(tangent[-1]), way * float(after[-1])
    if length <= CLOSE or min(first, last) <= STANDING:
        return False
    middle = (6 * way * float(new[-1] - x[-1]) / length - first - last) / 4
    slope, bend = 4 * middle - 3 * first - last, 2 * (first + last - 2 * middle)
    within = bend > 0.0 and 0.0 < -slope < 2 * bend
    return within and first - slope * slope / (4 * bend) < min(first, last) / 4


def _nearest(here: Crossing, along: Any) -> Any:
    """Return of the tangents at a crossing, either way, the one that goes most along a vector."""
    return max((sign * t for t in here.tangents for sign in (1, -1)), key=lambda t: float(t @ along), default=along)


def _along_t(size: int) -> Any:
    """Return the unit vector (size,) of t among the coordinates of a point."""
    return np.append(np.zeros(size - 1), 1.0)
