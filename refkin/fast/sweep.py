"""One mechanism, many times: few poses one after another, all others at once.

1. March (`march`): few poses, each predicted from the last two and corrected by Newton, by the branch-safe rules of the
   reference. Steps grow until the prediction is off by about 1e-2, and end where a law turns back.
2. Guess: for every time the quintic between the poses around it, which is right to about 2e-5.
3. Newton, twice or more, on all times at once; then the answer: coordinates, velocities, accelerations.
4. Check, sample by sample: Newton contracted, no determinant changed its sign, the pose lies on the quintic between the
   marched poses (continuity), and the formulas a person reads are satisfied to round-off (`answer`).
5. Where a sample fails, the poses around it are marched again in a quarter of the step, and so on. If that does not
   help, or anything at all is in doubt, the scene is solved by `refkin.solve`, and the motion's producer says so.
"""

from __future__ import annotations

import math
from bisect import bisect_left, bisect_right
from collections.abc import Sequence
from dataclasses import replace
from functools import partial
from typing import Any

import numpy as np

from refkin.fast.answer import motion
from refkin.fast.elimination.program import StepAnswer
from refkin.fast.elimination.run import Workspace, block_samples
from refkin.fast.march import ENOUGH, SMALL, SMALLEST_PIVOT, Guesses, March, Pose, laws_of
from refkin.fast.prepare import Prepared, prepared
from refkin.joints import SPACE
from refkin.model import Scene
from refkin.motion import Motion, Status
from refkin.newton import CONTRACTION, contracts
from refkin.proof.path.branch import first_unproved
from refkin.solving.passages import unseen
from refkin.solving.solve import solve
from refkin.solving.starts import NEARBY, find_start
from refkin.solving.sweep import pose_between
from refkin.system import EVERYTHING

NEWTON_STEPS = 2, 4
"""How many Newton steps every sample makes, and how many at most: two go from 1e-5 to the square of its square."""
CONTINUOUS = 1e-2
"""How far a sample may lie from the quintic between the marched poses [sizes, rad]: a guess so far off converges."""
QUARTERINGS = 4
"""How often the step between marched poses is quartered for the samples between them."""
MOST_EXTREMA = 500
"""Extrema of laws from the first time to the last beyond which it is left to the reference what to do about them."""
FEWEST = 128
"""Times below which redundant rows of space are left to the reference: to prove long steps takes as long."""
MOST_AT_FIRST = 12
"""Newton steps from an estimate."""
NEAR = 8.0
"""How many times further than the estimate every other solution must be for the estimate to decide the branch."""


def sweep(scene: Scene) -> Motion:
    """Return position and what else the scene calls for, on the branch of its estimates, as `refkin.solve` does.

    The answer is that of `refkin.solve` to a few units in the last place, times the condition number, and to what a
    float64 spline is off by where a table has uneven steps. Residual and condition are those of the reference's own
    formulas. Certificates are proved on the loops' equations (`certify`), in about the time of the solution; they bound
    what rounding might have done, where the reference's, which cost 30 times that, come near what it did: radii are
    about 20 times larger, 6e-15 for a four-bar. Where a time is in doubt for whatever reason the whole answer is that
    of `refkin.solve` itself; `motion.producer` tells which it is.

    Bodies on which nothing wanted depends are left out, unless the condition is asked for: that is said in the message,
    as a status then says nothing of them.

    Beside the answer the registers take memory: 5 MB for a four-bar, 64 MB at most for any mechanism.
    """
    return attempt(scene) or solve(scene)


def attempt(scene: Scene | Prepared) -> Motion | None:
    """Return what `sweep` does without ever asking the reference: None where a time is in doubt.

    A scene that is solved again and again may be `prepared` once.
    """
    ready = scene if isinstance(scene, Prepared) else prepared(scene)
    with np.errstate(all="ignore"):  # what runs away is in doubt, and says so
        return None if ready is None else _Task(ready).motion()


class _Task:
    """What is done for a scene."""

    def __init__(self, ready: Prepared) -> None:
        self.ready = ready
        self.scene, self.system, self.made, self.first = ready.scene, ready.system, ready.made, ready.start
        self.t, self.laws, self.extrema = ready.t, ready.laws, ready.extrema
        self.redundant = self.system.m > self.system.n
        self.geometry = [p.g for p in self.system.placed]
        self.constraints = [p.constraint for p in self.system.placed]
        self.march = March(self.made.march, ready.u, self.constraints, self.system.unit, self._extrema)
        self.message = ""

    def motion(self) -> Motion | None:
        """Return the answer at all times; None if any is in doubt."""
        if self.redundant and self.system.kind is SPACE and 1 < len(self.t) < FEWEST:
            return None
        start = self._start() if len(self.extrema) < MOST_EXTREMA else None
        if start is None:
            return None
        if len(self.t) == 1:
            answer = self._alone(start)
        else:
            poses = self._marched(start) if self.made.core else [start]
            if poses is None:
                return None
            answer = self._samples(poses)
            if answer is not None and not self._keeps_its_branch(answer[0][0], poses):
                return None
        return None if answer is None else motion(self.ready, *answer, self.message)

    def _keeps_its_branch(self, q: Any, poses: list[Pose]) -> bool:
        """Whether the steps that their ends say too little of are proved, as the reference's are.

        A long one is proved from marched pose to marched pose: to find the poses between is what a proof costs most. Of
        a single loop determinants are not looked at again: beyond a gap the march's prediction, which is so near, leads
        to the other assembly, with the other sign. Where rows are redundant all steps are proved: the determinant of
        those that are solved may have a factor of its own, which changes its sign at the same place. They are listed,
        so that no more tubes are tried than where some are: the reference is faster.
        """
        # Where there are two, one may move another: it is seen at the marched poses, too.
        loops, t = 2 if len(self.march.signs) > 1 else 0, self.t
        if not (loops or self.redundant) and not unseen(self.system, t, q, loops=0):
            return True
        known = set(self.scene.times)
        between = [p for p in poses if p.t not in known]
        whole = [self._advanced(p.levels[0], p.t, 1).levels[0] for p in between]
        t = np.append(t, [p.t for p in between])
        q, order = np.column_stack([q, *whole]), np.argsort(t)
        t, q = t[order], q[:, order]
        nearer = partial(pose_between, proving=False)
        steps = range(len(t) - 1) if self.redundant else unseen(self.system, t, q, loops=loops, between=nearer)
        full = replace(self.system, effects=EVERYTHING)
        return steps == [] or first_unproved(full, t, q, pose_between, steps) is None

    def _advanced(self, core: Sequence[float], t: float, most: int) -> StepAnswer:
        """Return what at most so many steps of Newton make of core coordinates at a time, number by number."""
        whole = self.made.whole
        laws = laws_of(whole, self.constraints, self.system.unit)(t)
        u = whole.prepare([self.geometry[c][k] for c, k in whole.geometry])
        return whole.advance(u, laws, core, self.march.profile, most, ENOUGH)

    def _extrema(self, a: float, b: float) -> list[float]:
        """Return the times between a and b at which a law turns back."""
        return self.extrema[bisect_right(self.extrema, a) : bisect_left(self.extrema, b)]

    def _start(self) -> Pose | None:
        """Return the first pose: the solution next to the estimate, if that is beyond doubt, else as the reference."""
        q = self._near_estimate() if self.first is None else None
        if q is None:
            start = find_start(self.system, self.scene) if self.first is None else self.first
            if start.status is not Status.OK:
                return None
            q, self.message = start.q, start.message
        core = [float(q[c]) for c in self.made.core]
        t = self.scene.times[0]
        return self.march.start(t, core, self.march.laws(t))

    def _near_estimate(self) -> Any:
        """Return the solution that Newton finds from the estimate if it is much nearer than any other.

        Near a fold Newton's error goes from e to e^2 / s, with s the distance of the two solutions. So its first two
        corrections tell how far the other solution is; the estimate must be `NEAR` times nearer in every coordinate.
        """
        bodies = self.scene.mechanism.bodies
        if self.system.n != self.system.of_bodies or any(b.estimate is None for b in bodies):
            return None
        estimate = self.system.to_unit([x for b in bodies for x in b.estimate])  # type: ignore[union-attr]
        answer = self._first([float(estimate[c]) for c in self.made.core])
        if answer is None:
            return None
        q, steps = np.array(answer.levels[0]), answer.steps
        off = float(np.max(np.abs(q - estimate)))
        if steps and not (steps[-1] <= ENOUGH and contracts(steps)):
            return None
        second = steps[1] if len(steps) > 1 else 0.0
        near = off <= SMALL or (off <= NEARBY and NEAR * off * second <= steps[0] * steps[0])
        return q if near else None

    def _first(self, core: Sequence[float]) -> StepAnswer | None:
        """Return what Newton makes of core coordinates at the first time; None where numbers fail."""
        try:
            return self._advanced(core, self.scene.times[0], MOST_AT_FIRST)
        except (ArithmeticError, ValueError):
            return None

    def _alone(self, start: Pose) -> tuple[list[Any], Any] | None:
        """Return the levels at the only time, and its smallest pivot: rows of one number take five times as long."""
        answer = self._first(start.levels[0])
        if answer is None or not self.march.accepts(answer):
            return None
        levels = [np.array(level)[:, None] for level in answer.levels[: self.made.levels]]
        return levels, np.array([min(answer.pivots, default=math.inf)])

    def _marched(self, start: Pose) -> list[Pose] | None:
        """Return poses from the first time to the last; None if the branch cannot be followed there."""
        between = self.march.to(self.scene.times[-1], start)
        return None if between is None else [start, *between]

    def _samples(self, poses: list[Pose]) -> tuple[list[Any], Any] | None:
        """Return the levels at all times, and the smallest pivot of each; None if a sample is in doubt."""
        count = len(self.t)
        levels = [np.empty((self.system.n, count)) for _ in range(self.made.levels)]
        pivot = np.full(count, np.inf)
        guesses = Guesses(poses)
        pivots = self.made.program.outputs.pivots
        samples = block_samples(self.made.program)
        for start in range(0, count, samples):
            block = slice(start, min(start + samples, count))
            with self.made.solving.workspace(block.stop - block.start) as space:
                space.give_geometry(self.geometry, self.march.profile)
                space.give_laws({k: [[x[block] for x in law] for law in laws] for k, laws in self.laws.items()})
                if not self._solved(space, self.t[block], guesses):
                    return None
                for order, level in enumerate(levels):
                    level[:, block] = space.level(order)
                if pivots:
                    pivot[block] = np.minimum.reduce(space.w[pivots.start : pivots.stop])
        return (levels, pivot) if (pivot > SMALLEST_PIVOT).all() else None

    def _solved(self, space: Workspace, t: Any, guesses: Guesses) -> bool:
        """Solve a block of samples; return whether each is on the branch."""
        core = space.core()
        for _ in range(QUARTERINGS + 1):
            guess = guesses.at(t)
            for row, values in zip(core, guess, strict=True):
                row[:] = values
            ok = newton(space) if core else np.ones(len(t), bool)
            space.run("answer")
            ok &= self._on_branch(space, guess)
            if ok.all():
                return True
            if not guesses.quarter(t[~ok], self.march):
                return False
        return False

    def _on_branch(self, space: Workspace, guess: Any) -> Any:
        """Return which samples lie on the quintics that they were guessed by, with the branch's signs of determinants.

        The residual sees neither: both branches satisfy the equations.
        """
        ok = np.ones(space.samples, bool)
        for row, values in zip(space.core(), guess, strict=True):
            ok &= np.abs(row - values) <= CONTINUOUS
        for k, sign in zip(self.made.program.outputs.determinants, self.march.signs, strict=True):
            ok &= space.row(k) * sign > 0
        return ok


def newton(space: Workspace) -> Any:
    """Make the Newton steps of a workspace's samples; return which samples converged, and contracted at once."""
    step = space.row(space.program.outputs.step)
    space.run("newton")
    first = step.copy()
    fewest, most = NEWTON_STEPS
    space.run("newton")
    ok = (step <= CONTRACTION * first) | (first < SMALL)
    for _ in range(fewest, most):
        if (step <= ENOUGH).all():
            break
        space.run("newton")
    return ok & (step <= ENOUGH)
