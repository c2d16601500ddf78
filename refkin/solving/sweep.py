"""Position over time, on one branch: by steps (`steps`) from one asked time to the next.

A step that is not taken is halved. No step goes over a time at which a law turns back, or a distance is zero: the poses
there are steps of their own, and proved to be alone where they are nearly singular. Where no step is small enough the
sweep stops, and says what it stopped at. A sweep that is *proving* goes on from there with fewer conditions, by steps
that are noted as uncertified: they count only once it is proved (`proof.path.branch`) that the branch was kept.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, field, replace
from enum import Enum, auto
from functools import cached_property, partial
from typing import Any

import numpy as np

from refkin.analysis import sigma_min
from refkin.differences import EPS
from refkin.motion import SINGULAR
from refkin.newton import TINY
from refkin.proof.numbers.extrema import LISTED, extrema
from refkin.proof.path.branch import first_unproved
from refkin.proof.pose.isolate import isolate
from refkin.solving.passages import OFTEN, Winding, over_a_range, turning_points, unseen
from refkin.solving.steps import CLEAR, FURTHEST, NOISE, Steps
from refkin.system import EVERYTHING, System

PART = 1 / 8
"""How much of the way to the first time is tried first where several laws move: together they may turn back."""
ALONE = 1e-4
"""sigma_min above which the pose at an extremum of a law is not proved to be alone: the next root is as far."""
MOST_STEPS = 20_000
"""Steps from one asked time to the next: a wheel that turns 3000 times between them needs so many."""
MANY_STEPS = 100
"""Steps towards a time after which it is asked whether some wheel only turns and turns."""
MOST_EXTREMA = 2000
"""Extrema of laws from one asked time to the next: each is a step, or several."""
BEFORE = 64
"""How many roots of what the laws are short of a limit sigma_min may be to be taken for that of a pose before it."""
UNPROVED = 1 / 64
"""The part of a step to a singular pose of which no proof is asked."""
MOST_UNCERTIFIED = 1000
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
class Sweep(Steps):
    """The steps from one asked time to the next; others are taken between them.

    Attributes
    ----------
    proving : bool
        Whether uncertified steps are taken where no others are left.
    certified : bool
        Whether all steps are to be proved, not only the uncertified ones.
    hopeless : callable
        Whether it is proved that there is no pose at a time.
    step : float
        The length of the next step [s].
    why : str
        Why it did not reach the last time that was asked, in words.
    """

    proving: bool = False
    certified: bool = False
    hopeless: Callable[[float], bool] = lambda t: False
    step: float = np.inf
    why: str = ""
    _winding: Winding | None = field(default=None, init=False)

    def to(self, target: float) -> Arrival:
        """Go on to a time, in as many steps as it takes; on REACHED and AT_SINGULAR_POSE `q[-1]` is the pose there.

        It goes by way of the poses where laws turn back: a step over them does not see a limit that they pass.
        """
        if len(self.t) == 1:
            self._set_out(target)
        start = self.t[-1]
        turning, hidden = turning_points(self.system, start, target)
        if hidden:
            what = self._turning(hidden[0], start, target)
            self.why = f"t has no more digits: {what} at t = {hidden[0]:.17g}, next to a time asked for"
            return Arrival.OUT_OF_STEPS
        often = OFTEN < len(turning) <= LISTED
        if often and not self.singular and (q := over_a_range(self, target)) is not None:
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
                what = self._turning(t, start, target)
                self.why = f"at t = {t:.17g}, where {what}, no pose of the branch is proved to be alone"
                return Arrival.STOPPED
        return self._to(target)

    def _turning(self, t: float, start: float, target: float) -> str:
        """Return in words what makes a row turn back at one of `turning_points`."""
        laws = [law for c in self.system.mechanism.constraints for law in c.laws]
        return "a law turns back" if any(t in extrema(law, start, target) for law in laws) else "a distance is zero"

    def _set_out(self, target: float) -> None:
        q, t = self.q[0], self.t[0]
        nearly = self._sides(q, t)[1] <= np.log(CLEAR)
        # Rounding could decide on which of two branches a step from here goes on.
        self.singular = self.singular or (nearly and sigma_min(self.system.phi_q(q, t)) <= SINGULAR)
        laws = [law for c in self.system.mechanism.constraints for law in c.laws]
        if sum(law(t) != law(target) or bool(extrema(law, t, target)) for law in laws) > 1:
            self.step = max(PART * (target - t), self._smallest(target))

    def _is_alone(self) -> bool:
        """Whether the last pose is proved to be the only one near, unless that is beyond doubt."""
        q, t = self.q[-1], self.t[-1]
        sigma = sigma_min(self.system.phi_q(q, t))
        self.singular = self.singular or sigma <= SINGULAR
        return sigma > ALONE or bool(isolate(self.system, q[:, None], [t]).ok[0])

    @property
    def unproved(self) -> list[int]:
        """The numbers of the poses from which a step was taken that is to be proved."""
        steps: Sequence[int] = range(len(self.t) - 1)
        if not self.certified:
            steps = unseen(
                self.system,
                np.array(self.t),
                np.array(self.q).T,
                self._blocks,
                between=partial(pose_between, proving=False),
                jumps=self.jumps,
            )
            steps = sorted({*self.uncertified, *steps})
        return [k for k in steps if k not in self.jumps]

    @property
    def winds(self) -> bool:
        """Whether it has left out whole turns, or was about to."""
        return self._winding is not None

    def branching_off(self, system: System) -> Sweep:
        """Return a sweep of the same kind, with another system, that starts at time 0 from the last pose."""
        return Sweep(system, [0.0], [self.q[-1]], proving=self.proving, certified=self.certified)

    def arrives(self, target: float) -> bool:
        """Go to a time, and return whether that is certain, or proved, as it is to be."""
        if self.to(target) is not Arrival.REACHED:
            return False
        return not (steps := self.unproved) or self.first_unproved(steps) is None

    def comes_to_singular_pose(self, step: int) -> bool:
        """Return whether a step ends at a pose that is not proved to be alone, and no branches cross on the way there.

        That is proved of all but the last of the way, where no proof can be; a step that begins there is the last.
        """
        (t, end), (q, last) = self.t[step : step + 2], self.q[step : step + 2]
        if isolate(self.system, last[:, None], [end]).ok[0]:
            return False
        if sigma_min(self.system.phi_q(q, t)) <= ALONE:
            return True
        return Sweep(self.system, [t], [q], proving=True, certified=True).arrives(end - (end - t) * UNPROVED)

    def first_unproved(self, steps: list[int]) -> int | None:
        """Return the first of some steps that is not proved; None if all are."""
        t, q, first = np.array(self.t), np.array(self.q).T, 0
        for last, system in (*self.held_from, (len(t) - 1, self.system)):
            own, full = [k - first for k in steps if first <= k < last], replace(system, effects=EVERYTHING)
            at = np.s_[first : last + 1]
            step = first_unproved(full, t[at], q[:, at], pose_between, own) if own else None
            if step is not None:
                return step + first
            first = last
        return None

    def _jump(self, q: Any, t: float) -> None:
        """Go on from a pose that no step led to."""
        self.jumps.append(len(self.t) - 1)
        self.t.append(t)
        self.q.append(q)
        self.step = np.inf

    def steps_to(self, target: float) -> bool:
        """Go to a time by steps alone, and return whether they lead there."""
        return self._in_steps(target, MOST_STEPS) is Arrival.REACHED

    def _wind(self, target: float, stopped: bool = False) -> bool:
        """Leave out whole turns on the way to a time, where loops come back after each; return whether it is there.

        What is singular, or stopped by other things than the number of steps, goes on where there are no loops alone.
        """
        winding = self._winding or Winding.of(self.system, self.q[-1], self.t[-1])
        if winding is None or ((stopped or self.singular) and not winding.unique):
            return False
        self._winding = winding
        if (there := winding.passed(self, target)) is not None:
            self._jump(*there)
        return self.t[-1] == target

    def _to(self, target: float) -> Arrival:
        if self._winding is not None and self._winding.closed is not None and self._wind(target):
            return Arrival.REACHED
        arrival = Arrival.STOPPED if self.singular else self._in_steps(target, min(MANY_STEPS, MOST_STEPS))
        if arrival is Arrival.OUT_OF_STEPS and MANY_STEPS < MOST_STEPS:
            if self._wind(target):
                return Arrival.REACHED
            left = self._winding.left(self, target) if self._winding else 0.0
            if left > FURTHEST * MOST_STEPS:
                self.why = (
                    f"gave up at t = {self.t[-1]:.17g}: a wheel turns by {left:.3g} rad to t = {target:.17g}, "
                    f"more than in {MOST_STEPS} steps"
                )
                return arrival
            arrival = self._in_steps(target, MOST_STEPS - MANY_STEPS)
        if arrival is Arrival.STOPPED and self._wind(target, stopped=True):
            return Arrival.REACHED
        if arrival is Arrival.STOPPED and self.proving and not self.hopeless(target):
            arrival = self._uncertified_steps(target)
        if arrival is Arrival.OUT_OF_STEPS:
            self.why = f"gave up at t = {self.t[-1]:.17g} after {MOST_STEPS} steps"
        return self._stopped(target) if arrival is Arrival.STOPPED else arrival

    def _stopped(self, target: float) -> Arrival:
        """Say what the sweep stopped at: a singular pose, the last digit of t, or neither of them.

        Before a limit sigma_min is about the root of what the laws are short of it. Where a law turns back it stands
        still: how fast it goes is asked at the pose before, too.
        """
        q, t = self.q[-1], self.t[-1]
        sigma = sigma_min(self.system.phi_q(q, t))
        rates = [self.full.nu(*pose) for pose in zip(self.q[-2:], self.t[-2:], strict=True)]
        law = self._smallest(target) * float(np.max(np.abs(rates)))
        if self.singular or sigma <= min(BEFORE * max(law, EPS) ** 0.5, CLEAR):
            self.why = f"the branch ends or meets another at a singular pose after t = {t:.17g}"
        elif law > TINY:
            self.why = f"t has no more digits at t = {t:.17g}: by its last one a law moves by {law:.3g} [sizes, rad]"
            return Arrival.OUT_OF_STEPS
        else:
            self.why = f"no step from t = {t:.17g} on, however small, is certain to stay on the branch"
        return Arrival.STOPPED

    @cached_property
    def full(self) -> System:
        """The system with its rates."""
        return replace(self.system, effects=EVERYTHING)

    def _smallest(self, target: float) -> float:
        """Return the smallest step on the way to a time."""
        return float(max(np.spacing(max(abs(target), abs(self.t[-1]))), 4 * EPS * (target - self.t[-1])))

    def _uncertified_steps(self, target: float) -> Arrival:
        """Go on with fewer conditions; what leads nowhere is taken back."""
        sure, self.lenient, self.step = len(self.t), True, np.inf
        arrival = self._in_steps(target, MOST_UNCERTIFIED)
        self.lenient, self.tiny = False, TINY
        if arrival not in (Arrival.STOPPED, Arrival.OUT_OF_STEPS):
            return arrival
        self._take_back(sure)
        return Arrival.STOPPED

    def _in_steps(self, target: float, most_steps: int) -> Arrival:
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
            if last and (isolated := self._at_singular_pose(t)) is not None:
                return Arrival.REACHED if isolated else Arrival.AT_SINGULAR_POSE
            self.step = (t - self.t[-1]) / 2
            if self.lenient:
                self.tiny = max(TINY, NOISE / max(EPS, sigma_min(self.system.phi_q(self.q[-1], self.t[-1]))))
            if self.step < smallest:
                return Arrival.STOPPED
        return Arrival.OUT_OF_STEPS


def pose_between(system: System, q: Any, t: float, later: float, *, proving: bool = True) -> Any:
    """Return the pose (n,) that a sweep from the pose q (n,) at t finds at a later time; None if it finds none.

    Parameters
    ----------
    system : System
    q : (n,) array
        The pose at time t [s].
    t, later : float
        Times [s].
    proving : bool
        Whether steps are taken that count only once it is proved that the branch was kept.
    """
    sweep = Sweep(system, [t], [q], proving=proving)
    return sweep.q[-1] if sweep.to(later) is Arrival.REACHED else None
