"""Position over time: from one pose to the next, on one branch.

From the last poses the next is predicted by a polynomial in t, then Newton corrects it. The step is taken only if
the correction is small against the move, Newton contracted at once (its second correction is a small part of the first:
no other root is near) and the determinants of the blocks of phi_q have the signs they had; otherwise it is halved.
Where no step is small enough the sweep stops, and says whether it stopped at a singular pose. These conditions are
tests, no proofs. A sweep that is *proving* goes on from there with fewer of them, and notes such steps as doubtful:
they count only once it is proved that they did not change the branch (`proof.branch`).
"""

from __future__ import annotations

from dataclasses import dataclass, field
from enum import Enum, auto
from typing import Any

import numpy as np

from refkin.analysis import SINGULAR, sigma_min
from refkin.differences import EPS
from refkin.newton import TINY, NewtonResult, RoundOff, contracts, newton
from refkin.proof.numbers.preconditioned import independent_rows
from refkin.proof.path.blocks import Blocks, blocks
from refkin.proof.pose.isolate import isolate
from refkin.solving.turnings import turnings
from refkin.system import System

NEAR = 1 / 4
"""Largest correction of a prediction, in units of the move from the last pose."""
FIRST = 0.1
"""Largest first move, for which there is no prediction yet [sizes, rad]."""
NOISE = 256 * EPS
"""What rounding leaves of phi, times what sigma_min may have shrunk in a step: over sigma_min it is noise in a pose."""
SHORT = 1 / 8
"""Steps shorter than this part of what was asked are short: they were halved."""
APART = 64
"""Corrections below sigma_min / APART lead to no other root: near a singular pose roots are sigma_min apart or so."""
FURTHEST = 1.0
"""Largest move of an angle in one step: predictions do not know what lies within a radian [rad]."""
REACH = 0.25
"""Largest distance to a singular pose from which it is approached in one step [sizes, rad]."""
MOST_STEPS = 20_000
"""Steps from one asked time to the next: a wheel that turns 3000 times between them needs so many."""
MOST_DOUBTFUL = 1000
"""Steps tried with fewer conditions on the way to one time; passing a pivot at 1e-12 takes about 300."""


class Arrival(Enum):
    """How a step towards a time ended."""

    REACHED = auto()
    AT_SINGULAR_POSE = auto()
    STOPPED = auto()
    OUT_OF_STEPS = auto()


@dataclass
class Sweep:
    """The poses accepted so far; times need not be those that were asked.

    Attributes
    ----------
    proving : bool
        Whether doubtful steps are taken where no others are left.
    doubtful : list of int
        The numbers of the poses from which a doubtful step was taken: what rounding hides may have decided there.
    """

    system: System
    t: list[float]
    q: list[Any]
    proving: bool = False
    doubtful: list[int] = field(default_factory=list)
    asked: float = np.inf
    blocked: bool = False
    step: float = np.inf
    relaxed: bool = False
    tiny: float = TINY
    _blocks: Blocks | None = field(default=None, init=False)
    _signs: list[float] = field(default_factory=list, init=False)

    def to(self, target: float) -> Arrival:
        """Go on to a time, in as many steps as it takes; on REACHED and AT_SINGULAR_POSE `q[-1]` is the pose there.

        It goes by way of the poses where laws turn back: a step over them does not see a limit that they pass.
        """
        laws = [law for constraint in self.system.mechanism.constraints for law in constraint.laws]
        for t in sorted({t for law in laws for t in turnings(law, self.t[-1], target)}):
            if (arrival := self._to(t)) is not Arrival.REACHED:
                return Arrival.OUT_OF_STEPS if arrival is Arrival.OUT_OF_STEPS else Arrival.STOPPED
        return self._to(target)

    def _to(self, target: float) -> Arrival:
        arrival = Arrival.STOPPED if self.blocked else self._walk(target, MOST_STEPS)
        if arrival is Arrival.STOPPED and self.proving:
            return self._doubtfully(target)
        return arrival

    def _doubtfully(self, target: float) -> Arrival:
        """Go on with fewer conditions; what leads nowhere is taken back."""
        sure, self.relaxed, self.step = len(self.t), True, np.inf
        arrival = self._walk(target, MOST_DOUBTFUL)
        self.relaxed, self.tiny = False, TINY
        if arrival not in (Arrival.STOPPED, Arrival.OUT_OF_STEPS):
            return arrival
        del self.t[sure:], self.q[sure:]
        self.doubtful = [k for k in self.doubtful if k < sure - 1]
        return Arrival.STOPPED

    def _walk(self, target: float, most_steps: int) -> Arrival:
        self.asked = target - self.t[-1]
        smallest = 4 * EPS * max(abs(target), abs(self.t[-1]), target - self.t[-1])
        for _ in range(most_steps):
            last = self.t[-1] + self.step >= target  # as rounded: a step may land on the target
            t = target if last else self.t[-1] + self.step
            result = self._corrected(t)
            if self._on_branch(result, t):
                self.step = 2 * max(t - self.t[-1], self.step if last else 0.0)
                self._accept(result.q, t)
                if last:
                    return Arrival.REACHED
                continue
            if last and (arrival := self._at_singular_pose(t)) is not None:
                return arrival
            self.step = (t - self.t[-1]) / 2
            if self.relaxed:
                self.tiny = max(TINY, NOISE / max(EPS, sigma_min(self.system.phi_q(self.q[-1], self.t[-1]))))
            if self.step < smallest:
                return Arrival.STOPPED
        return Arrival.OUT_OF_STEPS

    def _accept(self, q: Any, t: float) -> None:
        if self.relaxed:
            self.doubtful.append(len(self.t) - 1)
        self.t.append(t)
        self.q.append(q)

    def _predicted(self, t: float) -> Any:
        """Extrapolate the last poses, at most four, by the polynomial through them (Neville's scheme)."""
        times, poses = self.t[-4:], list(self.q[-4:])
        for width in range(1, len(times)):
            for k in range(len(times) - width):
                a, b = times[k], times[k + width]
                poses[k] = ((t - b) * poses[k] + (a - t) * poses[k + 1]) / (a - b)
        return poses[0]

    def _corrected(self, t: float) -> NewtonResult:
        s, stop = self.system, _WhileContracting(tiny=self.tiny)
        return newton(lambda q: s.phi(q, t), lambda q: s.phi_q(q, t), self._predicted(t), stop=stop)

    def _on_branch(self, result: NewtonResult, t: float) -> bool:
        sizes = np.max(np.abs(result.corrections), axis=1)
        if not (result.converged and contracts(sizes, self.tiny)):
            return False
        if not self.relaxed and t - self.t[-1] < SHORT * self.asked:
            # Something is near. No step may end where rounding could decide which of two roots is the next.
            sigma = sigma_min(self.system.phi_q(result.q, t))
            if sigma <= SINGULAR or (not contracts(sizes, 0.0) and sizes[0] > sigma / APART):
                return False
        move, off = (np.max(np.abs(result.q - q)) for q in (self.q[-1], result.iterates[0]))
        near = off <= max(NEAR * move, self.tiny) if len(self.q) > 1 else move <= FIRST
        turn = np.max(np.abs(result.q - self.q[-1])[self.system.angles], initial=0.0)
        return bool(near and turn <= FURTHEST and self._same_side(result.q, t))

    def _same_side(self, q: Any, t: float) -> bool:
        """Whether the determinants of the blocks of phi_q have the signs of the last pose."""
        s, last = self.system, (self.q[-1], self.t[-1])
        if s.m == s.n and self._blocks is None:
            self._blocks = blocks(s, *last, np.arange(s.n))
            self._signs = self._blocks.signs(s.phi_q(*last))
        if self._blocks is not None:
            return bool(self._blocks.signs(s.phi_q(q, t)) == self._signs)
        found = blocks(s, *last, independent_rows(s, last[0][:, None], np.array(last[1:])))
        return bool(found.signs(s.phi_q(*last)) == found.signs(s.phi_q(q, t)))

    def _at_singular_pose(self, t: float) -> Arrival | None:
        """Accept a pose with a tiny sigma_min, to which Newton comes slowly from the last pose; None if there is none.

        REACHED if it is proved to be alone and lies on this branch.
        """
        s, start = self.system, self.q[-1]
        result = newton(lambda q: s.phi(q, t), lambda q: s.phi_q(q, t), start, max_iterations=60)
        if not result.converged or np.max(np.abs(result.q - start)) > REACH:
            return None
        if sigma_min(s.phi_q(result.q, t)) > SINGULAR:
            return None
        isolated = bool(isolate(s, result.q[:, None], [t]).ok[0])
        if isolated and not (self._same_side(result.q, t) and self._meant(result.q, t)):
            return None
        self._accept(result.q, t)
        self.blocked = True  # rounding could decide on which of two branches a step from here goes on
        return Arrival.REACHED if isolated else Arrival.AT_SINGULAR_POSE

    def _meant(self, q: Any, t: float) -> bool:
        """Whether the smooth continuation does not lead to another pose, beyond a bifurcation: there det changes sign.

        It is asked only where it is told apart from q: where Newton moves the prediction by less than from it to q.
        """
        s, predicted = self.system, self._predicted(t)
        other = newton(lambda x: s.phi(x, t), lambda x: s.phi_q(x, t), predicted, max_iterations=60)
        if not other.converged:
            return True
        moved, apart = (float(np.max(np.abs(other.q - x))) for x in (predicted, q))
        return apart <= moved or self._same_side(other.q, t)


@dataclass
class _WhileContracting(RoundOff):
    """Goes on to round-off, but gives a step up at once that will not be taken.

    Near a singular pose what is left at round-off may shrink slowly, by any factor: that takes iterations, no smaller
    step.
    """

    tiny: float = TINY
    sizes: list[float] = field(default_factory=list)

    def __call__(self, residual: Any, correction: Any, q: Any) -> bool:
        self.sizes.append(float(np.max(np.abs(correction))))
        return super().__call__(residual, correction, q) or not contracts(self.sizes, self.tiny)


def pose_between(system: System, q: Any, t: float, later: float) -> Any:
    """Return the pose (n,) that a proving sweep from the pose q (n,) at t finds at a later time; None if it finds none.

    Parameters
    ----------
    system : System
    q : (n,) array
        The pose at time t [s].
    t, later : float
        Times [s].
    """
    sweep = Sweep(system, [t], [q], proving=True)
    return sweep.q[-1] if sweep.to(later) is Arrival.REACHED else None
