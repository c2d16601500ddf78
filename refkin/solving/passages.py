"""Long ways of a sweep made short: many swings of one law, and many turns of one wheel, between two times.

Where one law alone moves a mechanism, its pose is a function of that law's value as long as the branch goes on:
q(t) = Q(f(t)). A law that turns back often takes the values of a range again and again. So it is enough to go once to
the largest value, from there to the smallest, and to the last (`over_a_range`): by the value, not by the time.

Where loops feel nothing but one angle, they feel only where it is in its turn. If they come back to the same pose,
whole turns aside, after one turn of it, they do so after every other (`Winding`). What loops feel is read from the
pattern of phi_q: its blocks that are not constant are loops; their rows hold coordinates of constant blocks, which
depend on others in turn. All of these must stand still, but one angle whose own row counts its turns: that of an angle
driver or of a gear. Where there is no loop at all there is one pose at each time, and no way is too long to it.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace
from itertools import pairwise
from typing import Any

import numpy as np

from refkin.analysis import position, sigma_min
from refkin.differences import EPS
from refkin.joints import Constraint, Contact, Polar, polar_cams
from refkin.motion_laws import Law, Polynomial
from refkin.newton import is_round_off, newton
from refkin.proof.numbers.extrema import extrema, extrema_of, hides, sign_changes
from refkin.proof.numbers.inputs import has_digits
from refkin.proof.path.blocks import Blocks, diagonal_blocks, dips
from refkin.proof.path.tube import Between
from refkin.system import System, compile_system

OFTEN = 8
"""How often a law turns back, between two times, for its range to be gone through instead."""
COUNTING = ({"angle by a law"}, {"rolling wheels"})
"""The elements of those constraints whose rows count the turns of an angle: an angle driver's, a gear's."""
CLEAR = 1e-6
"""Smallest sigma_min at the ends of the range: rounding of the law decides nothing there."""
HALVED = 64
"""How many steps are halved, a doubted one and parts of it, for determinants to say enough."""
LITTLE = 1e-12
"""What a law may do within the last digits of a time without a step of its own, unless it is rounding [sizes, rad]."""
SAME = 1e-9
"""How far poses of one assembly may lie apart that were found by different ways [sizes, rad]."""


def moving_law(system: System, a: float, b: float) -> tuple[int, Law] | None:
    """Return the only driver whose law is not the same at all times from a to b, by number, and the law; else None.

    Parameters
    ----------
    system : System
    a, b : float
        The first time and the last [s].
    """
    mechanism = system.mechanism
    moving = [
        (k, law)
        for k, c in enumerate(mechanism.constraints)
        for law in c.laws
        if law(a) != law(b) or extrema(law, a, b)
    ]
    first = len(mechanism.joints)
    return (moving[0][0] - first, moving[0][1]) if len(moving) == 1 and moving[0][0] >= first else None


def turning_points(system: System, a: float, b: float) -> tuple[list[float], list[float]]:
    """Return the times at which laws turn back between a and b, in order, and those too near to a or b for a step.

    What a law does within a few of the last digits of a time is only left out where it does next to nothing there.

    Parameters
    ----------
    system : System
    a, b : float
        The first time and the last [s].
    """
    constraints = system.mechanism.constraints
    close, near = 4 * EPS * max(abs(a), abs(b)), list[float]()
    turning = extrema_of(constraints, a, b)
    for t in (t for t in turning if not a + close < t < b - close):
        end = a if t <= a + close else b
        for law, size in ((law, c.law_scale(system.unit)[1]) for c in constraints for law in c.laws):
            away = abs(law(t) - law(end)) + float(_beyond_digits(law, t, a, b))
            near += [t] if away > max(16 * EPS * abs(law(end)), LITTLE * size) else []
    return [t for t in turning if a + close < t < b - close], near


def _beyond_digits(law: Law, t: Any, a: float, b: float) -> Any:
    """Return how much further a law may go next to its extrema (K,) than at them, between a and b.

    They are between their last digit and the next, and bends as at the digits around: f'' u^2 / 2 at most, here twice.
    """
    digit = np.spacing(np.abs(t))
    with np.errstate(over="ignore", invalid="ignore"):
        bends = [np.abs(law(np.clip(t + k * digit, a, b), 2)) for k in (-1, 0, 1)]
        return np.max(np.broadcast_arrays(*bends), axis=0) * digit * digit


def unseen(
    system: System,
    t: Any,
    q: Any,
    parts: Blocks | None = None,
    *,
    loops: int = 1,
    between: Between | None = None,
    jumps: Sequence[int] = (),
) -> list[int]:
    """Return the steps k, from pose k to k + 1, of which their ends say too little: they are to be proved.

    Where one law alone moves, and does not turn back, a pose is a function of its value, and that is between those at
    the ends. But there may be none for some values, and one loop may move another to and fro (`proof.path.blocks`);
    several laws together may turn back though none of them does; and a cam's profile may hide a bump.

    Parameters
    ----------
    system : System
    t, q : (T,) and (n, T) array
        Times in increasing order [s], and the poses there, in the system's coordinates.
    parts : Blocks, optional
        The blocks of phi_q, if they are known.
    loops : int
        How many loops there are at least for determinants to be looked at; 0 for never.
    between : callable, optional
        What finds poses between two by steps that pass every test: where their determinants say enough, those of the
        two need not.
    jumps : sequence of int
        Steps of which nothing is asked: over thousands of turns it would take a minute.
    """
    laws = [law for c in system.mechanism.constraints for law in c.laws]
    steps = dips(system, t, q, parts, loops) if loops else np.zeros(len(t) - 1, bool)
    steps[list(jumps)] = False
    for k in np.flatnonzero(steps) if between else ():
        steps[k] = not _seen_nearer(system, t[k : k + 2], q[:, k : k + 2], between)
    if len(laws) > 1:
        steps |= np.sum([np.diff(law(t)) != 0.0 for law in laws], axis=0) > 1
    for cam in polar_cams(system.mechanism.joints):
        contact = q[system.parameter(cam.name).start].tolist()
        steps |= np.array([hides(cam.profile.law, *sorted(ends)) for ends in pairwise(contact)], bool)
    return [int(k) for k in np.flatnonzero(steps) if k not in jumps]


def _seen_nearer(system: System, t: Any, q: Any, between: Any) -> bool:
    """Return whether no determinant is doubted in smaller steps between two poses, which lead from one to the other."""
    doubted = [(*t, *q.T)]
    for _ in range(HALVED):
        if not doubted:
            return True
        first, last, start, end = doubted.pop()
        middle = (first + last) / 2
        pose = between(system, start, first, middle) if first < middle < last else None
        arrived = None if pose is None else between(system, pose, middle, last)
        if pose is None or arrived is None or not np.max(np.abs(arrived - end)) <= SAME * max(1.0, np.max(np.abs(end))):
            return False
        at, poses = (first, middle, last), (start, pose, end)
        for k in np.flatnonzero(dips(system, np.array(at), np.column_stack(poses))):
            doubted.append((*at[k : k + 2], *poses[k : k + 2]))
    return False


def over_a_range(sweep: Any, target: float) -> Any:
    """Return the pose at a time by way of the range of the only law that moves; None if it does not lead there.

    The sweep is at a regular pose.
    """
    start = sweep.t[-1]
    moving = moving_law(sweep.system, start, target)
    if moving is None:
        return None
    driver, law = moving
    turning = np.array(extrema(law, start, target))
    turned, more = law(turning), _beyond_digits(law, turning, start, target)
    values = [float(law(start)), *(turned + more).tolist(), *(turned - more).tolist(), float(law(target))]
    turned, at = sweep, values[0]
    for value in (max(values), min(values), values[-1]):
        if value == at:
            continue
        turned = turned.branching_off(_with_line(sweep.system, driver, at, value))
        length, at = abs(value - at), value
        if not turned.arrives(length) or sigma_min(turned.system.phi_q(turned.q[-1], length)) <= CLEAR:
            return None
    q = turned.q[-1]
    end = position(sweep.system, q, target)
    near = end.converged and np.max(np.abs(end.q - q)) <= SAME * max(1.0, float(np.max(np.abs(q))))
    return end.q if near else None


def _with_line(system: System, driver: int, start: float, end: float) -> System:
    """Return a system with a driver that goes from one value to another, by 1 in a unit of time."""
    drivers = list(system.mechanism.drivers)
    line = Polynomial(coefficients=(start, math.copysign(1.0, end - start)))
    drivers[driver] = replace(drivers[driver], law=line, rate_law=None, initial=0.0)
    return compile_system(replace(system.mechanism, drivers=tuple(drivers)), system.effects, system.unit)


@dataclass
class Winding:
    """Loops of a system that depend on one angle alone, by its place in the turn; or a system without loops.

    Attributes
    ----------
    angle : int
        The coordinate that is this angle.
    loops : (k,) array of int
        The coordinates of the loops.
    felt : (k,) array of int
        All coordinates that must come back: the loops', and those they depend on.
    tree : tuple of array
        Rows and columns of the constant blocks, which give their coordinates one value at each time.
    closed : (n,) array, optional
        By how much each coordinate changes in a turn of the angle, once it is known that the loops come back.
    around : bool
        Whether the sweep went through a whole turn, be it that loops came back or not.
    """

    system: System
    angle: int
    loops: Any
    felt: Any
    tree: tuple[Any, Any]
    closed: Any = None
    around: bool = False

    @classmethod
    def of(cls, system: System, q: Any, t: float) -> Winding | None:
        """Return the winding of a system; None if its loops depend on more, or nothing is without a loop."""
        if system.m != system.n or not all(map(_repeats, system.mechanism.constraints)):
            return None
        here = system.phi_q(q, t)
        shifts = [np.sqrt(np.arange(2, system.n + 2) + k) for k in (0.0, 0.5)]
        there = [system.phi_q(q + shift, t) for shift in shifts]
        pattern = np.any([x != 0 for x in (here, *there)], axis=0)
        varies = np.any([x != here for x in there], axis=0)
        parts = diagonal_blocks(pattern)
        is_loop = [bool(varies[np.ix_(rows, columns)].any()) for rows, columns in parts]
        loops = [columns for (_, columns), loop in zip(parts, is_loop, strict=True) if loop]
        trees = [part for part, loop in zip(parts, is_loop, strict=True) if not loop]
        owner = {int(c): rows for rows, columns in parts for c in columns}
        gates, felt = _felt(system, pattern, owner, {int(c) for columns in loops for c in columns})
        if (loops and len(gates) != 1) or not trees:
            return None
        rows, columns = (np.concatenate([part[k] for part in trees]) for k in (0, 1))
        if not loops:
            return cls(system, -1, np.zeros(0, int), np.zeros(0, int), (rows, columns), closed=np.zeros(system.n))
        return cls(system, gates.pop(), np.concatenate(loops), np.array(sorted(felt)), (rows, columns))

    @property
    def unique(self) -> bool:
        """Whether there is one pose at each time: coordinates follow from each other by factors that are constant."""
        return not self.loops.size

    def placed(self, q: Any, t: float) -> Any:
        """Return a pose with the coordinates that do not depend on the loops as they are at a time."""
        rows, columns = self.tree

        def phi(x: Any) -> Any:
            return self.system.phi(whole(x), t)[rows]

        def whole(x: Any) -> Any:
            pose = np.array(q)
            pose[columns] = x
            return pose

        result = newton(phi, lambda x: self.system.phi_q(whole(x), t)[np.ix_(rows, columns)], q[columns])
        return whole(result.q) if result.converged else np.full_like(q, np.nan)

    def passed(self, sweep: Any, target: float) -> tuple[Any, float] | None:
        """Return a pose many whole turns on, and its time before `target`; None if there are few, or none is known.

        Until it is known whether loops come back after a turn, the sweep goes through one first. Without loops it is
        the pose at `target`, if its angles have digits.
        """
        if self.unique:
            q = self.placed(sweep.q[-1], target)
            closed = is_round_off(self.system.phi(q, target), q)
            return (q, target) if closed and has_digits(self.system, q[:, None], np.array([target])).all() else None
        moving = moving_law(self.system, sweep.t[-1], target)
        if moving is None:
            return None
        _, law = moving
        turns = float((self.placed(sweep.q[-1], target)[self.angle] - sweep.q[-1][self.angle]) / math.tau)
        if not abs(turns) > 3:
            return None
        if self.closed is None:
            start = sweep.q[-1]
            if not sweep.steps_to(self.after(law, sweep.t[-1], target, 1.0 / abs(turns))):
                return None
            self.around = True
            if not self.closes(start, sweep.q[-1]):
                return None
            turns -= np.sign(turns)
        whole = int(turns)
        t = self.after(law, sweep.t[-1], target, whole / turns)
        q = self.wound(sweep.q[-1], t, whole) if sweep.t[-1] < t < target else None
        return None if q is None else (q, t)

    def left(self, sweep: Any, target: float) -> float:
        """Return how far the angle has to turn yet to a time [rad]; 0 if it is not known to turn all around."""
        if not self.around:
            return 0.0
        turned = (self.placed(sweep.q[-1], target) - sweep.q[-1]) * self.system.turns
        return float(abs(turned[self.angle]))

    def after(self, law: Law, t: float, target: float, part: float) -> float:
        """Return when a law that does not turn back has made a part of its way from one time to another."""
        value = float(law(t)) + part * (float(law(target)) - float(law(t)))
        return (sign_changes(lambda x: float(law(x)) - value, [t, target]) or [target])[0]

    def closes(self, q: Any, later: Any) -> bool:
        """Note by how many turns all angles change in one of this angle; return whether nothing else has changed."""
        moved = np.where(self.system.angles, later - q, 0.0)
        whole = math.tau * np.round(moved / math.tau)
        back = np.max(np.abs(later - q - whole)[self.felt]) <= SAME and abs(whole[self.angle]) == math.tau
        self.closed = whole * np.sign(whole[self.angle]) if back else None
        return bool(back)

    def wound(self, q: Any, t: float, turns: int) -> Any:
        """Return the pose at t so many turns of the wheel, of either sign, after another; None if it is not there."""
        guess = np.array(q)
        guess[self.loops] += turns * self.closed[self.loops]
        guess = self.placed(guess, t)
        end = position(self.system, guess, t)
        off = np.max(np.abs(end.q - guess)) if end.converged else np.inf
        in_place = abs(end.q[self.angle] - q[self.angle] - math.tau * turns) <= 1e-6
        return end.q if off <= 1e-6 and in_place and is_round_off(self.system.phi(end.q, t), end.q) else None


def _repeats(constraint: Constraint) -> bool:
    """Return whether a constraint says after a turn of an angle what it did before, as all elements but one do.

    An open profile of a cam is another one in every turn, and formulas that no element states may be.
    """
    known = list(constraint.elements())
    return bool(known) and all(Polar(law=e.profile).closed for e in known if isinstance(e, Contact))


def _felt(system: System, pattern: Any, owner: dict[int, Any], loops: set[int]) -> tuple[set[int], set[int]]:
    """Return the angles that count turns among what loops depend on, and all that they depend on.

    What a law of time moves without such an angle in between makes no angle the only one: then -1 is among them.
    """
    constraints = [p.constraint for p in system.placed for _ in range(p.constraint.rows)]
    gates: set[int] = set()
    felt, waiting = set(loops), list(loops)
    while waiting:
        column = waiting.pop()
        for row in owner[column]:
            constraint = constraints[row]
            counts = {element.key for element in constraint.elements()} in COUNTING
            if column not in loops and counts and len(owner[column]) == 1:
                gates.add(column)
                continue
            if constraint.laws:
                gates.add(-1)
            new = {int(c) for c in np.flatnonzero(pattern[row])} - felt
            felt |= new
            waiting += new
    return gates, felt
