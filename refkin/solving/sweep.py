"""Position over time: from one pose to the next, on one branch.

From the last poses the next is predicted by a polynomial in t, then Newton corrects it. The step is taken only if
the correction is small against the move, Newton contracted at once (its second correction is a small part of the first:
no other root is near) and the determinants of the blocks of phi_q have the signs they had; otherwise it is halved. The
first step has no prediction and must be short. No step goes over a time at which a law turns back, or a distance is
zero: the poses there are steps of their own, and proved to be alone where they are nearly singular. Where no step is
small enough the sweep stops, and says what it stopped at. These conditions are tests, no proofs. A sweep
that is *proving* goes on from there with fewer of them, and notes such steps as doubtful: they count only once it is
proved that they did not change the branch (`proof.branch`).
"""

from __future__ import annotations

from dataclasses import dataclass, field, replace
from enum import Enum, auto
from functools import cached_property
from typing import Any

import numpy as np

from refkin.analysis import SINGULAR, sigma_min
from refkin.differences import EPS
from refkin.newton import TINY, NewtonResult, RoundOff, contracts, newton
from refkin.proof.numbers.extrema import extrema, extrema_of
from refkin.proof.numbers.preconditioned import independent_rows
from refkin.proof.path.blocks import Blocks, blocks
from refkin.proof.path.branch import first_gap
from refkin.proof.pose.isolate import isolate
from refkin.solving.passages import OFTEN, Winding, moving_law, over_a_range
from refkin.system import EVERYTHING, System

NEAR = 1 / 4
"""Largest correction of a prediction, in units of the move from the last pose."""
FIRST = 0.1
"""Largest first move, for which there is no prediction yet [sizes, rad].

The last pose then is the estimate, from which Newton contracts at once: so it does for every smaller change of one law,
and a law that does not turn back takes no other values on the way.
"""
PART = 1 / 8
"""How much of the way to the first time is tried first where several laws move: together they may turn back."""
SPREAD = 1 / 64
"""Poses that lie closer together than this part of the next step would only add their rounding to its prediction."""
LEAST = 2.0**-500
"""Shorter steps [s] leave no digits in products with them."""
CLEAR = 1e-2
"""Determinant of a block above which no singular values are asked for."""
ALONE = 1e-4
"""sigma_min above which the pose at an extremum of a law is not proved to be alone: the next root is as far."""
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
MANY_STEPS = 100
"""Steps towards a time after which it is asked whether some wheel only turns and turns."""
MOST_EXTREMA = 2000
"""Extrema of laws from one asked time to the next: each is a step, or several."""
BEFORE = 64
"""How many roots of what the laws are short of a limit sigma_min may be to be taken for that of a pose before it."""
MOST_DOUBTFUL = 1000
"""Steps tried with fewer conditions on the way to one time; passing a pivot at 1e-12 takes about 300."""


class Arrival(Enum):
    """How a step towards a time ended."""

    REACHED = auto()
    """The pose there is accepted."""
    AT_SINGULAR_POSE = auto()
    """The pose there is accepted and not proved to be alone."""
    STOPPED = auto()
    """No step leads there."""
    OUT_OF_STEPS = auto()
    """It would take more steps than are made, or shorter ones than there are."""


@dataclass
class Sweep:
    """The poses accepted so far; times need not be those that were asked.

    Attributes
    ----------
    proving : bool
        Whether doubtful steps are taken where no others are left.
    doubtful : list of int
        The numbers of the poses from which a doubtful step was taken: what rounding hides may have decided there.
    certified : bool
        Whether all steps are to be proved, not only the doubtful ones.
    jumps : list of int
        The numbers of the poses from which the next was found by a way of its own, proved as far as it must be.
    why : str
        Why it did not reach the last time that was asked, in words.
    """

    system: System
    t: list[float]
    q: list[Any]
    proving: bool = False
    certified: bool = False
    doubtful: list[int] = field(default_factory=list)
    asked: float = np.inf
    blocked: bool = False
    step: float = np.inf
    relaxed: bool = False
    tiny: float = TINY
    jumps: list[int] = field(default_factory=list)
    why: str = ""
    _winding: Winding | None = field(default=None, init=False)
    _blocks: Blocks | None = field(default=None, init=False)
    _signs: list[float] = field(default_factory=list, init=False)

    def to(self, target: float) -> Arrival:
        """Go on to a time, in as many steps as it takes; on REACHED and AT_SINGULAR_POSE `q[-1]` is the pose there.

        It goes by way of the poses where laws turn back: a step over them does not see a limit that they pass.
        """
        if len(self.t) == 1:
            self._set_out(target)
        start, close = self.t[-1], 4 * EPS * max(abs(self.t[-1]), abs(target))
        turning = extrema_of(self.system.mechanism.constraints, start + close, target - close)
        if len(turning) > OFTEN and not self.blocked and (q := over_a_range(self, target, turning)) is not None:
            self._jump(q, target)
            return Arrival.REACHED
        if len(turning) > MOST_EXTREMA:
            before = f"more than {MOST_EXTREMA} times before t = {target:.17g}"
            self.why = f"gave up at t = {start:.17g}: the laws turn back {before}"
            return Arrival.OUT_OF_STEPS
        for t in turning:
            arrival = self._to(t)
            if arrival in (Arrival.OUT_OF_STEPS, Arrival.STOPPED):
                return arrival
            if not self._is_alone():
                self._take_back(len(self.t) - 1)
                self.why = f"at t = {t:.17g}, where a law turns back, no pose of the branch is proved to be alone"
                return Arrival.STOPPED
        return self._to(target)

    def _set_out(self, target: float) -> None:
        q, t = self.q[0], self.t[0]
        nearly = self._sides(q, t)[1] <= np.log(CLEAR)
        # Rounding could decide on which of two branches a step from here goes on.
        self.blocked = self.blocked or (nearly and sigma_min(self.system.phi_q(q, t)) <= SINGULAR)
        laws = [law for c in self.system.mechanism.constraints for law in c.laws]
        if sum(law(t) != law(target) or bool(extrema(law, t, target)) for law in laws) > 1:
            self.step = PART * (target - t)

    def _is_alone(self) -> bool:
        """Whether the last pose is proved to be the only one near, unless that is beyond doubt."""
        q, t = self.q[-1], self.t[-1]
        sigma = sigma_min(self.system.phi_q(q, t))
        self.blocked = self.blocked or sigma <= SINGULAR
        return sigma > ALONE or bool(isolate(self.system, q[:, None], [t]).ok[0])

    def _take_back(self, count: int) -> None:
        """Forget all poses but the first so many."""
        del self.t[count:], self.q[count:]
        self.doubtful = [k for k in self.doubtful if k < count - 1]

    @property
    def unproved(self) -> list[int]:
        """The numbers of the poses from which a step was taken that is to be proved."""
        steps = range(len(self.t) - 1) if self.certified else self.doubtful
        return [k for k in steps if k not in self.jumps]

    def branching_off(self, system: System) -> Sweep:
        """Return a sweep of the same kind, with another system, that starts at time 0 from the last pose."""
        return Sweep(system, [0.0], [self.q[-1]], proving=self.proving, certified=self.certified)

    def arrives(self, target: float) -> bool:
        """Go to a time, and return whether that is certain, or proved, as it is to be."""
        if self.to(target) is not Arrival.REACHED:
            return False
        t, q = np.array(self.t), np.array(self.q).T
        return not self.unproved or first_gap(self._full, t, q, pose_between, self.unproved) is None

    def _jump(self, q: Any, t: float) -> None:
        """Go on from a pose that no step led to."""
        self.jumps.append(len(self.t) - 1)
        self.t.append(t)
        self.q.append(q)
        self.step = np.inf

    def _wind(self, target: float) -> None:
        """Leave out whole turns on the way to a time, where loops come back after each of them."""
        self._winding = self._winding or Winding.of(self.system, self.q[-1], self.t[-1])
        found = moving_law(self.system, self.t[-1], target)
        if self._winding is None or found is None:
            return
        (_, law), winding = found, self._winding
        turns = winding.turns(self.q[-1], self.t[-1], target)
        if not abs(turns) > 3 or self.blocked:
            return
        if winding.closed is None:
            first = len(self.t) - 1
            once = winding.after(law, self.t[-1], target, 1.0 / abs(turns))
            if self._walk(once, MOST_STEPS) is not Arrival.REACHED or not winding.closes(self.q[first], self.q[-1]):
                return
            turns -= np.sign(turns)
        whole = int(turns)
        t = winding.after(law, self.t[-1], target, whole / turns)
        q = winding.wound(self.q[-1], t, whole) if self.t[-1] < t < target else None
        if q is not None:
            self._jump(q, t)

    def _to(self, target: float) -> Arrival:
        if self._winding is not None and self._winding.closed is not None:
            self._wind(target)
        arrival = Arrival.STOPPED if self.blocked else self._walk(target, min(MANY_STEPS, MOST_STEPS))
        if arrival is Arrival.OUT_OF_STEPS and MANY_STEPS < MOST_STEPS:
            self._wind(target)
            arrival = self._walk(target, MOST_STEPS - MANY_STEPS)
        if arrival is Arrival.STOPPED and self.proving:
            arrival = self._doubtfully(target)
        if arrival is Arrival.OUT_OF_STEPS:
            self.why = f"gave up at t = {self.t[-1]:.17g} after {MOST_STEPS} steps"
        return self._stopped(target) if arrival is Arrival.STOPPED else arrival

    def _stopped(self, target: float) -> Arrival:
        """Say what the sweep stopped at: a singular pose, the last digit of t, or neither of them.

        Before a limit sigma_min is about the root of what the laws are short of it.
        """
        q, t = self.q[-1], self.t[-1]
        sigma, law = (
            sigma_min(self.system.phi_q(q, t)),
            self._smallest(target) * float(np.max(np.abs(self._full.nu(q, t)))),
        )
        if self.blocked or sigma <= min(BEFORE * max(law, EPS) ** 0.5, CLEAR):
            self.why = f"the branch ends at a singular pose after t = {t:.17g}"
        elif law > TINY:
            self.why = f"t has no more digits at t = {t:.17g}: by its last one a law moves by {law:.3g} [sizes, rad]"
            return Arrival.OUT_OF_STEPS
        else:
            self.why = f"no step from t = {t:.17g} on, however small, is certain to stay on the branch"
        return Arrival.STOPPED

    @cached_property
    def _full(self) -> System:
        """The system with its rates."""
        return replace(self.system, effects=EVERYTHING)

    def _smallest(self, target: float) -> float:
        """Return the smallest step on the way to a time."""
        return float(max(np.spacing(max(abs(target), abs(self.t[-1]))), 4 * EPS * (target - self.t[-1])))

    def _doubtfully(self, target: float) -> Arrival:
        """Go on with fewer conditions; what leads nowhere is taken back."""
        sure, self.relaxed, self.step = len(self.t), True, np.inf
        arrival = self._walk(target, MOST_DOUBTFUL)
        self.relaxed, self.tiny = False, TINY
        if arrival not in (Arrival.STOPPED, Arrival.OUT_OF_STEPS):
            return arrival
        self._take_back(sure)
        return Arrival.STOPPED

    def _walk(self, target: float, most_steps: int) -> Arrival:
        self.asked = target - self.t[-1]
        smallest = self._smallest(target)
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

    def _before(self, t: float) -> list[int]:
        """Return the numbers of the last poses, at most four, that say something of the pose at t, the last one first.

        Those from before a jump do not, nor those that lie too close to another.
        """
        kept = [len(self.t) - 1]
        first = self.jumps[-1] if self.jumps else -1
        for k in range(len(self.t) - 2, max(len(self.t) - 8, first), -1):
            if len(kept) < 4 and self.t[kept[-1]] - self.t[k] >= max(SPREAD * (t - self.t[-1]), LEAST):
                kept.append(k)
        return kept

    def _predicted(self, t: float) -> Any:
        """Extrapolate the last poses by the polynomial through them (Neville's scheme)."""
        kept = self._before(t)[::-1]
        times, poses = [self.t[k] for k in kept], [self.q[k] for k in kept]
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
        move, off = (float(np.max(np.abs(result.q - q))) for q in (self.q[-1], result.iterates[0]))
        turn = np.max(np.abs(result.q - self.q[-1])[self.system.angles], initial=0.0)
        unled = len(self._before(t)) == 1
        if turn > FURTHEST or (move > FIRST if unled else off > max(NEAR * move, self.tiny)):
            return False
        same, determinant = self._sides(result.q, t)
        if not same or self.relaxed:
            return same
        # Where something is near no step may end where rounding could decide which of two roots is the next.
        decided = contracts(sizes, 0.0) and (unled or off <= NEAR * move)
        if decided and determinant > np.log(CLEAR) and t - self.t[-1] >= SHORT * self.asked:
            return True
        sigma = sigma_min(self.system.phi_q(result.q, t))
        return bool(sigma > SINGULAR and (decided or max(off, sizes[0]) <= sigma / APART))

    def _same_side(self, q: Any, t: float) -> bool:
        return self._sides(q, t)[0]

    def _sides(self, q: Any, t: float) -> tuple[bool, float]:
        """Whether the determinants of the blocks of phi_q have the signs of the last pose; the smallest's logarithm."""
        s, last = self.system, (self.q[-1], self.t[-1])
        if s.m == s.n and self._blocks is None:
            self._blocks = blocks(s, *last, np.arange(s.n))
            self._signs = self._blocks.determinants(s.phi_q(*last))[0]
        if self._blocks is not None:
            signs, smallest = self._blocks.determinants(s.phi_q(q, t))
            return signs == self._signs, smallest
        found = blocks(s, *last, independent_rows(s, last[0][:, None], np.array(last[1:])))
        signs, smallest = found.determinants(s.phi_q(q, t))
        return found.determinants(s.phi_q(*last))[0] == signs, smallest

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
