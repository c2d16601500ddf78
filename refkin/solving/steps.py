"""One step along a branch: from the last poses to the next, and whether that is the next one.

From the last poses the next is predicted by a polynomial in t, then Newton corrects it. The step is taken only if
the correction is small against the move, Newton contracted at once (its second correction is a small part of the first:
no other root is near) and the determinants of the blocks of phi_q have the signs they had. The first step has no
prediction and must be short. These conditions are tests, no proofs. Of a step that is to be proved afterwards fewer
are asked (`lenient`): it is noted as uncertified.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field
from itertools import pairwise
from typing import Any

import numpy as np

from refkin.analysis import sigma_min
from refkin.differences import EPS
from refkin.joints import SPACE, TurnAboutAxis
from refkin.motion import SINGULAR
from refkin.newton import TINY, NewtonResult, RoundOff, contracts, newton
from refkin.proof.path.blocks import Blocks, blocks
from refkin.proof.path.curve import is_pose
from refkin.proof.pose.isolate import isolate
from refkin.system import System

NEAR = 1 / 4
"""Largest correction of a prediction, in units of the move from the last pose."""
FIRST = 0.1
"""Largest first move, for which there is no prediction yet [sizes, rad].

The last pose then is the estimate, from which Newton contracts at once: so it does for every smaller change of one law,
and a law that does not turn back takes no other values on the way.
"""
LEFT = 1e-10
"""Down to it corrections contract one after the other in a first step: the first of them may be that of a large body,
which hides what a small loop does, as a link of a millimetre on a crank of a metre [sizes, rad]."""
NOISE = 256 * EPS
"""What rounding leaves of phi, times what sigma_min may have shrunk in a step: over sigma_min it is noise in a pose."""
STEEP = 4.0
"""How many times the radius of curvature that Newton's later corrections tell of a first step may go."""
SPREAD = 1 / 64
"""Poses that lie closer together than this part of the next step would only add their rounding to its prediction."""
LEAST = 2.0**-500
"""Shorter steps [s] leave no digits in products with them."""
CLEAR = 1e-2
"""Determinant of a block above which no singular values are asked for."""
SHORT = 1 / 8
"""Steps shorter than this part of what was asked are short: they were halved."""
APART = 64
"""Corrections below sigma_min / APART lead to no other root: near a singular pose roots are sigma_min apart or so."""
FURTHEST = 1.0
"""Largest move of an angle in one step: predictions do not know what lies within a radian [rad]."""
TURNED = 0.6
"""Cosine of half the turn of a passive body up to which it is held as it was: at 0 nothing would hold it."""
REACH = 0.25
"""Largest distance to a singular pose from which it is approached in one step [sizes, rad]."""


@dataclass
class Steps:
    """The poses q (n,) of a branch accepted so far, at their times, and the test of the next.

    Attributes
    ----------
    asked : float
        The length of the way that the steps are to cover [s]: much shorter ones were halved.
    singular : bool
        Whether the branch is at a singular pose, where rounding could decide how it goes on.
    lenient : bool
        Whether fewer conditions are asked of steps, which are then noted as uncertified.
    uncertified : list of int
        The numbers of the poses from which such a step was taken: what rounding hides may have decided there.
    tiny : float
        First corrections below it are not looked at.
    held_from : list of (int, System)
        The numbers of the poses from which passive bodies were held another way, each with the system up to there.
    jumps : list of int
        The numbers of the poses from which the next was found in a way of its own, proved as far as it must be.
    """

    system: System
    t: list[float]
    q: list[Any]
    asked: float = np.inf
    singular: bool = False
    lenient: bool = False
    uncertified: list[int] = field(default_factory=list)
    tiny: float = TINY
    jumps: list[int] = field(default_factory=list)
    held_from: list[tuple[int, System]] = field(default_factory=list)
    _blocks: Blocks | None = field(default=None, init=False)
    _signs: list[float] = field(default_factory=list, init=False)

    def _take_back(self, count: int) -> None:
        """Forget all poses but the first so many."""
        del self.t[count:], self.q[count:]
        self.uncertified = [k for k in self.uncertified if k < count - 1]
        while self.held_from and self.held_from[-1][0] >= count:
            self.system, self._blocks = self.held_from.pop()[1], None
            vars(self).pop("full", None)

    def _accept(self, q: Any, t: float) -> None:
        if self.lenient:
            self.uncertified.append(len(self.t) - 1)
        self.t.append(t)
        self.q.append(q)
        self._hold(q)

    def _hold(self, q: Any) -> None:
        """Hold passive bodies as they are turned here, if they have turned far from where they are held."""
        here = self.system.held_at(q)
        for p in self.system.placed if here.gauge else ():
            if p.constraint.passive:
                held = self.system.gauge.get(p.row, p.g[:4])
                if abs(sum(x * y for x, y in zip(held, here.gauge[p.row], strict=True))) < 4 * TURNED:
                    self.held_from.append((len(self.q) - 1, self.system))
                    self.system, self._blocks = here, None
                    vars(self).pop("full", None)
                    break

    def _before(self, t: float) -> list[int]:
        """Return the numbers of the last poses, at most four, that say something of the pose at t, the last one first.

        Those from before a jump do not, nor those that lie too close to another.
        """
        return before(self.t, len(self.t) - 1, t, self.jumps[-1] if self.jumps else -1)

    def _predicted(self, t: float) -> Any:
        """Extrapolate the last poses by the polynomial through them (Neville's scheme)."""
        kept = self._before(t)[::-1]
        return neville([self.t[k] for k in kept], [self.q[k] for k in kept], t)

    def _corrected(self, t: float) -> NewtonResult:
        s, stop = self.system, _WhileContracting(tiny=self.tiny)
        return newton(lambda q: s.phi(q, t), lambda q: s.phi_q(q, t), self._predicted(t), stop=stop)

    def _on_branch(self, result: NewtonResult, t: float) -> bool:
        sizes = np.max(np.abs(result.corrections), axis=1)
        if not (result.converged and contracts(sizes, self.tiny)) or not is_pose(result):
            return False
        move, off = (float(np.max(np.abs(result.q - q))) for q in (self.q[-1], result.iterates[0]))
        turn = np.max(np.abs(result.q - self.q[-1]) * self.system.turns, initial=self.driven(self.t[-1], t))
        unled = len(self._before(t)) == 1
        if unled and not self.lenient and self._small_loop(sizes.tolist(), result.q, t):
            return False
        if turn > FURTHEST or (move > FIRST if unled else off > max(NEAR * move, self.tiny)):
            return False
        same, determinant = self._sides(result.q, t)
        if not same or self.lenient:
            return same
        # Where something is near no step may end where rounding could decide which of two roots is the next.
        decided = contracts(sizes, 0.0) and (unled or off <= NEAR * move)
        if decided and determinant > np.log(CLEAR) and t - self.t[-1] >= SHORT * self.asked:
            return True
        sigma = sigma_min(self.system.phi_q(result.q, t))
        return bool(sigma > SINGULAR and (decided or max(off, sizes[0]) <= sigma / APART))

    def _small_loop(self, sizes: list[float], q: Any, t: float) -> bool:
        """Whether Newton's corrections tell of a loop that is small against a step that has no prediction.

        The second one leaves K times the square of its size, the next as well: with 1 / K about the size of the loop.
        What is noise tells nothing.
        """
        telling = [
            one
            for one, other in pairwise(sizes[1:])
            if not contracts((one, other), LEFT) or (one > self.tiny and sizes[0] * other > STEEP * one * one)
        ]
        return bool(telling) and telling[0] > NOISE / max(EPS, sigma_min(self.system.phi_q(q, t)))

    def driven(self, a: Any, b: Any) -> Any:
        """Return the furthest that a driver turns a joint of space from times a to b [rad]: poses count no turns there.

        Of two floats, or of two rows of times.
        """
        constraints = self.system.mechanism.constraints if self.system.kind is SPACE else ()
        turned = [e for c in constraints if c.laws for e in c.elements() if isinstance(e, TurnAboutAxis)]
        ways = [np.abs(law(b) - law(a)) for e in turned for law in e.laws]
        return np.max(ways, axis=0) if ways else np.zeros(np.shape(a))

    def _sides(self, q: Any, t: float) -> tuple[bool, float]:
        """Whether the determinants of the blocks of phi_q have the signs of the last pose; the smallest's logarithm."""
        parts, known = self.sides()
        signs, smallest = parts.determinants(self.system.phi_q(q, t))
        return signs == known, smallest

    def sides(self) -> tuple[Blocks, list[float]]:
        """Return the blocks of phi_q, and the signs of their determinants at the last pose.

        Of redundant rows those are taken that are independent there; others may be at a later pose.
        """
        if self._blocks is not None:
            return self._blocks, self._signs
        s, last = self.system, (self.q[-1], self.t[-1])
        parts = blocks(s, *last)
        known = parts.determinants(s.phi_q(*last))[0]
        if s.m == s.n:
            self._blocks, self._signs = parts, known
        return parts, known

    def _at_singular_pose(self, t: float) -> bool | None:
        """Accept a pose with a tiny sigma_min, to which Newton comes slowly from the last pose; None if there is none.

        True if it is proved to be alone and lies on this branch.
        """
        s, start = self.system, self.q[-1]
        result = newton(lambda q: s.phi(q, t), lambda q: s.phi_q(q, t), start, max_iterations=60)
        if (
            not (result.converged and is_pose(result))
            or self.driven(self.t[-1], t) > FURTHEST
            or np.max(np.abs(result.q - start)) > REACH
        ):
            return None
        if sigma_min(s.phi_q(result.q, t)) > SINGULAR:
            return None
        isolated = bool(isolate(s, result.q[:, None], [t]).ok[0])
        if isolated and not (self._sides(result.q, t)[0] and self._meant(result.q, t)):
            return None
        self._accept(result.q, t)
        self.singular = True  # rounding could decide on which of two branches a step from here goes on
        return isolated

    def _meant(self, q: Any, t: float) -> bool:
        """Whether the smooth continuation does not lead to another pose, beyond a bifurcation: there det changes sign.

        It is asked only where it is told apart from q: where Newton moves the prediction by less than from it to q.
        """
        s, predicted = self.system, self._predicted(t)
        other = newton(lambda x: s.phi(x, t), lambda x: s.phi_q(x, t), predicted, max_iterations=60)
        if not other.converged:
            return True
        moved, apart = (float(np.max(np.abs(other.q - x))) for x in (predicted, q))
        return apart <= moved or self._sides(other.q, t)[0]


def before(times: Sequence[float], last: int, t: float, first: int = -1) -> list[int]:
    """Return the numbers of at most four times that say something of t, `last` and others between `first` and it.

    The last one comes first; those that lie too close to another say nothing.

    Parameters
    ----------
    times : sequence of float
        Increasing [s].
    last, first : int
        Between which of them: `first` itself is left out.
    t : float
        For when [s].
    """
    kept = [last]
    for k in range(last - 1, max(last - 7, first), -1):
        if len(kept) < 4 and times[kept[-1]] - times[k] >= max(SPREAD * (t - times[last]), LEAST):
            kept.append(k)
    return kept


def neville(times: Sequence[Any], poses: list[Any], t: Any) -> Any:
    """Return where the polynomial through poses is at a time, by Neville's scheme on what they differ by from the last.

    So what does not move is predicted where it is, to the last bit, however large it may be.

    Parameters
    ----------
    times : sequence of float or of (B,) array
        k times, no two of them equal [s].
    poses : list of array
        (n,) or (n, B), the poses there.
    t : float or (B,) array
        The time asked for [s].
    """
    last, moved = poses[-1], [pose - poses[-1] for pose in poses]
    for width in range(1, len(times)):
        for k in range(len(times) - width):
            a, b = times[k], times[k + width]
            moved[k] = ((t - b) * moved[k] + (a - t) * moved[k + 1]) / (a - b)
    return last + moved[0]


@dataclass
class _WhileContracting(RoundOff):
    """Goes on to round-off, but gives a step up at once that will not be taken.

    Near a singular pose what is left at round-off may shrink slowly, by any factor: that takes iterations, no smaller
    step.
    """

    tiny: float = TINY
    sizes: list[float] = field(default_factory=list)

    def __call__(self, residual: Any, correction: Any, q: Any) -> bool:
        done = super().__call__(residual, correction, q)
        self.sizes.append(self.previous)
        return done or not contracts(self.sizes, self.tiny)
