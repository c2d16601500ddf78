"""From pose to pose along one branch, one sample at a time: what predicts all other samples, and helps those that fail.

The rules are those of `refkin.solving.steps`, and stricter. The prediction is the quintic through the last two poses.
A step is taken only if Newton contracts at once, no block's determinant has changed its sign, no block is nearly
singular, and the rates continue the prediction as the coordinates do: where two branches cross, the wrong one has a
kink. Otherwise the step is shortened. No step goes over a time at which a law turns back (`extrema`): what the law
reaches there is seen at neither end. How far off a prediction is says how long the next step may be: it grows with
the sixth power.

The quintic is the polynomial of degree 5 through two poses with their rates and accelerations (Hermite). Of each
coordinate, with s = (t - t0) / h, h = t1 - t0, and what a Taylor step from t0 misses at t1,

    d0 = q1 - q0 - h v0 - h^2 a0 / 2,   d1 = h (v1 - v0) - h^2 a0,   d2 = h^2 (a1 - a0),

it is q0 + s (h v0 + s (h^2 a0 / 2 + s (c3 + s (c4 + s c5)))) with

    c3 = 10 d0 - 4 d1 + d2 / 2,   c4 = -15 d0 + 7 d1 - d2,   c5 = 6 d0 - 3 d1 + d2 / 2.

Its error is E = f'''''' (t - t0)^3 (t - t1)^3 / 720: one step beyond t1 it is 512 times what it is half-way, and the
error of the rate there is E (3 / (t - t0) + 3 / (t - t1)), at most 6 E / (t - t1).
"""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from typing import Any, NamedTuple

import numpy as np

from refkin.differences import EPS
from refkin.fast.elimination.program import Single, StepAnswer
from refkin.joints import Constraint, Unit
from refkin.newton import contracts

FAR = 1e-2
"""How far off a prediction may be [sizes, rad] for steps to grow: the quintic between the poses then errs by 2e-5."""
FARTHEST = 0.2
"""A prediction further off than this is not corrected but made again, from nearer."""
PART = 1 / 4
"""Nor one that is further off than this part of the move from the last pose (as in `refkin.solving.steps`)."""
FURTHEST = 1.0
"""Largest change of a law's value in one step: predictions do not know what lies within a radian [sizes, rad]."""
ENOUGH = 1e-8
"""Newton is done after a correction e of this size: what is left is about e^2 times the condition, as of round-off."""
SMALLEST_PIVOT = 1e-5
"""A block with a smaller pivot is near a pose where branches meet; `refkin.solve` goes there.

The branches are then about as far apart, which must be far more than `SMALL`, below which nothing is said of Newton.
"""
SMALL = 1e-6
"""A first correction below this need not contract: it is round-off of a good prediction."""
SMOOTH = 7.0
"""How many times more than the coordinates the rates, times the step, may be off the prediction.

The quintic's own errors have at most the ratio 6, to leading order, and 4.5 after equal steps. Beyond a crossing, with
the other branch s away, Newton contracts to it (ratio 1/8) only if the prediction was off it by at most s / 8, and so
off the right one by 7 s / 8, and its rate by 4.5 times that over the step. The rates of the branches differ by about s
over the step; so those of the other are off by about 2.9 s, far more than `SMOOTH` s / 8.
"""
MOST_NEWTON = 8
LONGER, SHORTER = 3.0, 0.25
"""The largest and smallest factors by which a step changes."""
MOST_STEPS = 20_000
SHORT = 1 / 64
"""Steps this much shorter than the next say nothing of it that the rates do not: rounding is what they would add."""
LEAST = 2.0**-500
"""Nor do steps [s] that leave no digits to their squares."""

Levels = Sequence[Sequence[Any]]
"""Coordinates, rates, accelerations, each a sequence of numbers or rows."""


class Pose(NamedTuple):
    """A pose that was reached: time, levels of the core, the laws' values, and how far off its prediction was.

    `path` are the quintics that lead to it from the pose before, one for each core coordinate (`coefficients`).
    """

    t: float
    levels: tuple[tuple[float, ...], ...]
    laws: Sequence[float]
    off: float = 0.0
    path: Sequence[tuple[float, ...]] = ()


class March:
    """Steps along a branch.

    Parameters
    ----------
    constraints, unit : sequence of Constraint, Unit
        What brings the laws and profiles of `single`.
    extrema : callable
        a, b -> the times between them at which a law turns back, in order.
    most_steps : int
        After so many steps, all calls of `to` together, no more are made.
    """

    def __init__(
        self,
        single: Single,
        u: Sequence[float],
        constraints: Sequence[Constraint],
        unit: Unit,
        extrema: Callable[[float, float], Sequence[float]],
        most_steps: int = MOST_STEPS,
    ) -> None:
        self.single, self.u, self.extrema = single, u, extrema
        self.laws, self.profile = laws_of(single, constraints, unit), profile_of(constraints, unit)
        self.signs: tuple[float, ...] = ()
        self.values, self.rates = ([k for k, law in enumerate(single.laws) if law[2] == order] for order in (0, 1))
        self.most_steps = most_steps
        self.steps = 0

    def start(self, t: float, core: Sequence[float], f: Sequence[float]) -> Pose | None:
        """Return the pose at core coordinates that solve the equations; it sets the signs of the branch."""
        answer = self._newton(f, core)
        if answer is None or not _converged(answer.steps):
            return None
        self.signs = tuple(math.copysign(1.0, d) for d in answer.determinants)
        return Pose(t, answer.levels, f) if self._regular(answer) else None

    def step(self, t: float, last: Pose, before: Pose | None) -> Pose | None:
        """Return the pose at t if it is on the branch for certain, from the last pose and the one before it.

        No law may turn back in between.
        """
        self.steps += 1
        if before is not None and last.t - before.t < max(SHORT * (t - last.t), LEAST):
            before = None
        f = self.laws(t)
        for k in self.values:
            if abs(f[k] - last.laws[k]) > FURTHEST:
                return None
        guess, rates = predicted(t, last, before)
        answer = self._newton(f, guess)
        if answer is None or not (self.accepts(answer) and contracts(answer.steps)):
            return None
        q, v, _ = answer.levels
        off, move, bent = math.dist(q, guess), math.dist(q, last.levels[0]), math.dist(v, rates) * (t - last.t)
        near = off <= min(FARTHEST, max(PART * move, SMALL)) and bent <= max(SMOOTH * off, SMALL)
        return Pose(t, answer.levels, f, off, coefficients(last.levels, answer.levels, t - last.t)) if near else None

    def accepts(self, answer: StepAnswer) -> bool:
        """Whether Newton converged to a regular pose with the branch's signs."""
        return _converged(answer.steps) and self._regular(answer)

    def _regular(self, answer: StepAnswer) -> bool:
        """Whether no determinant has changed its sign, or is nearly 0."""
        for determinant, sign, pivot in zip(answer.determinants, self.signs, answer.pivots, strict=True):
            if not (determinant * sign > 0.0 and pivot > SMALLEST_PIVOT):
                return False
        return True

    def to(self, t: float, last: Pose, before: Pose | None = None, h: float = math.inf) -> list[Pose] | None:
        """Return the poses of as many steps as it takes to t; None if the branch cannot be followed there.

        It goes by way of the poses at which laws turn back. `h` is the largest step.
        """
        path: list[Pose] = []
        for end in (*self.extrema(last.t, t), t):
            poses = self._to(end, last, before, h)
            if poses is None:
                return None
            path += poses
            last, before = path[-1], path[-2] if len(path) > 1 else last
        return path

    def _to(self, t: float, last: Pose, before: Pose | None, h: float) -> list[Pose] | None:
        path: list[Pose] = []
        most = h = min(h, t - last.t)
        if before is None:  # Taylor's polynomial reaches less far than the quintic
            h = min(h, self._longest(last) / 2)
        smallest = 4 * EPS * max(abs(t), abs(last.t), abs(h))
        while self.steps < self.most_steps:
            ends = last.t + h >= t
            pose = self.step(t if ends else last.t + h, last, before)
            if pose is None:
                h = min(h, t - last.t) / 4
                if h <= smallest:
                    return None
                continue
            path.append(pose)
            if ends:
                return path
            last, before = pose, last
            h = min(most, h * factor(pose.off), self._longest(pose))
        return None

    def _longest(self, pose: Pose) -> float:
        """Return about how long a step may be before some law has changed by `FURTHEST`."""
        fastest = max([abs(pose.laws[k]) for k in self.rates], default=0.0)
        return 0.99 * FURTHEST / fastest if fastest else math.inf

    def _newton(self, f: Sequence[float], core: Sequence[float]) -> StepAnswer | None:
        try:
            return self.single.advance(self.u, f, core, self.profile, MOST_NEWTON, ENOUGH)
        except (ArithmeticError, ValueError):  # a pivot of 0, an overflow, the sine of infinity
            return None


def laws_of(single: Single, constraints: Sequence[Constraint], unit: Unit) -> Callable[[float], list[float]]:
    """Return t -> the laws' values in the order of `single.laws`, as `Constraint.inputs` has them, and no others.

    Parameters
    ----------
    single, constraints, unit : Single, sequence of Constraint, Unit
        What asks for them, what brings them, and the unit of their values.
    """
    own = []
    for c, k, order in single.laws:
        shifts, factor = constraints[c].law_scale(unit)
        own.append((constraints[c].laws[k], order, 0.0 if order else shifts[k], factor))
    return lambda t: [float((law(t, order) - shift) / factor) for law, order, shift, factor in own]


def profile_of(constraints: Sequence[Constraint], unit: Unit) -> Callable[[int, int, Any], Any]:
    """Return (constraint, order, parameter) -> that derivative of the constraint's profile, in the unit."""
    return lambda c, order, s: constraints[c].profile_values(s, unit, order)[order]


class Guesses:
    """The quintics between consecutive marched poses."""

    def __init__(self, poses: list[Pose]) -> None:
        self.poses = poses
        self._fit()

    def _fit(self) -> None:
        self.t = np.array([p.t for p in self.poses])
        self.width = np.diff(self.t)
        self.polynomials: Any = np.array([p.path for p in self.poses[1:]]).T  # (6, core, intervals)

    def at(self, t: Any) -> Any:
        """Return the core coordinates at times (B,) in order, (core, B)."""
        if len(self.poses) == 1:
            return np.repeat(np.array(self.poses[0].levels[0])[:, None], len(t), axis=1)
        ends = [0, *t.searchsorted(self.t[1:-1]), len(t)]  # t is in order, as the poses are
        counts = np.subtract(ends[1:], ends[:-1])
        s = (t - self.t[:-1].repeat(counts)) / self.width.repeat(counts)
        return at(self.polynomials.repeat(counts, axis=2), s)

    def quarter(self, t: Any, march: March) -> bool:
        """March again, in a quarter of the step, between the poses around times; False if that leads elsewhere."""
        if len(self.poses) == 1:
            return False
        for k in np.unique(self.t[1:-1].searchsorted(t, side="right"))[::-1].tolist():
            last = self.poses[k + 1]
            between = march.to(last.t, self.poses[k], h=(last.t - self.poses[k].t) / 4)
            if between is None:
                return False
            if any(abs(x - y) > SMALL for x, y in zip(between[-1].levels[0], last.levels[0], strict=True)):
                return False
            self.poses[k + 1 : k + 2] = between
        self._fit()
        return True


def predicted(t: float, last: Pose, before: Pose | None) -> tuple[list[float], list[float]]:
    """Return the core coordinates that two poses lead to, or one by its rates, and their rates.

    Parameters
    ----------
    t : float
        Where to [s].
    last, before : Pose
        The latest pose, and the one before it, if there is one.
    """
    if before is None:
        h = t - last.t
        first = [q + h * (v + 0.5 * h * a) for q, v, a in zip(*last.levels, strict=True)]
        return first, [v + h * a for _, v, a in zip(*last.levels, strict=True)]
    h = last.t - before.t
    s = (t - before.t) / h
    path = last.path or coefficients(before.levels, last.levels, h)
    return [at(c, s) for c in path], [slope(c, s) / h for c in path]


def factor(off: float) -> float:
    """Return by how much the next step is to be longer than one whose prediction was off by so much."""
    return min(LONGER, max(SHORTER, 0.9 * (FAR / off) ** (1 / 6) if off > 0.0 else LONGER))


def _converged(steps: Sequence[float]) -> bool:
    return not steps or steps[-1] <= ENOUGH


def coefficients(first: Levels, last: Levels, h: Any) -> list[tuple[Any, ...]]:
    """Return per coordinate the six coefficients, that of the power 0 first.

    Parameters
    ----------
    first, last : sequence of three sequences
        Value, rate and second rate of each coordinate at both ends.
    h : float
        From end to end [s].
    """
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
    """Return by what q, v, a at `before` and at `last` are multiplied to give the value, and the rate, at t.

    Parameters
    ----------
    before, last, t : float
        Times [s].
    """
    unit = [[float(k == m) for m in range(6)] for k in range(6)]
    h = last - before
    s = (t - before) / h
    basis = coefficients(unit[:3], unit[3:], h)
    return [at(b, s) for b in basis], [slope(b, s) / h for b in basis]
