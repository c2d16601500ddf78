"""What closed form alone does not place: groups larger than a dyad, by way of one angle that is not known.

With one more angle given, a triad (a body on three links, a four-bar driven at its coupler point) falls into steps of
closed form again, with one row left over. Over an interval of that angle, in numbers with slopes (`loci.Slope`), every
branch may end by proof: then no assembly has its angle there. Intervals that are left are halved, and their middles are
starts for Newton's method. An interval whose branches all lie where an assembly is proved to be the only one
(`krawczyk`) is done with. If no interval is left, what was found is all there is; if nothing was found, there is none.

Where one angle is not enough the starts come from a fixed sequence of angles (Halton), and nothing is proved; if closed
form places nothing at these, or nothing that leads anywhere, from one of poses that no joint holds. A search also ends
where assemblies turn out not to be isolated, or where start after start leads nowhere.
"""

from __future__ import annotations

import math
from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass, replace
from itertools import chain, pairwise, takewhile
from typing import Any

import numpy as np
from flint import arb

from refkin.analysis import position
from refkin.joints import GROUND, RollingOnLine, RollingWheels, elements_of, initial_contacts, polar_cams
from refkin.motion import Array
from refkin.newton import is_round_off
from refkin.proof.assembly.closed_form import DeadEnd, PlacedBranch, Placement, place
from refkin.proof.assembly.levenberg import least_squares
from refkin.proof.assembly.loci import Ball, above, below, interval, whole
from refkin.proof.assembly.rigid_groups import AssemblyPlan, orientations, plan
from refkin.proof.assembly.rows import AngleConstraint, AssemblyRows
from refkin.proof.numbers.inputs import A_FEW_ROUNDINGS, coordinates_have_digits, laws_have_digits
from refkin.proof.pose.krawczyk import krawczyk
from refkin.system import System

WIDTHS = (2e-3, 1e-5, 1e-8)
"""Widths of intervals at which Newton is started from their middles [rad]."""
MOST_INTERVALS = 2000
"""How many intervals are looked at before a proof is given up: about a second for a triad."""
MOST_STEPS = 10_000
"""How many steps of closed form are taken: in a larger group an interval has many branches, each of many steps."""
PROBE = 0.2
"""Width of the first intervals that are started from, a few of them: most assemblies, or a continuum, show [rad]."""
MOST_STARTS = 64
MOST_WORK = 53_000
"""How many starts there may be, in space in vain, times n^2: each takes 20 ms with 21 coordinates, 140 ms with 56."""
MOST_POSES = 32
MOST_LOOSE = 3
"""How many assemblies that are not proved to be isolated make a continuum of them likely: there is no end of such."""
MOST_FAILURES = 24
"""How many starts in a row may lead nowhere."""
SAME = 1e-7
"""Largest component by which two poses may differ that count as one."""
RADII = (3e-2, 1e-2, 3e-3, 1e-3, 1e-4, 1e-5, 1e-6, 1e-7)
"""Half-widths of the boxes in which an assembly is tried to be proved the only one, largest first."""
NAME = "trial angle"
PRIMES = (2, 3, 5, 7, 11, 13, 17, 19)


@dataclass(frozen=True, kw_only=True)
class Assemblies:
    """What is known of the assemblies of a mechanism at one time.

    Attributes
    ----------
    poses : tuple of (n,) arrays
        The assemblies that were found, in the system's coordinates. An angle that no driver counts is in (-pi, pi].
    branches : tuple of tuples of int
        For each pose, on which side each dyad was assembled: 1 if its inner joint lies left of the line from the one
        outer joint to the other, -1 if right, 0 if on it. Empty where the pose was found by search.
    radii : tuple of float
        For each pose, a bound of its error, largest component; NaN where none was proved.
    complete : bool
        Whether it is proved that these are all assemblies, up to whole turns of angles that no driver counts.
    gap : float or None
        If it is proved that there is none: a lower bound of what is missing over all branches, where the first loci
        certainly do not meet (scaled lengths; rad if angles disagree). For a dyad it is sharp.
    message : str
        In words.
    searched : bool
        Whether closed form did not do and a search was made, which takes about a second, or some where it is large.
    """

    poses: tuple[Array, ...] = ()
    branches: tuple[tuple[int, ...], ...] = ()
    radii: tuple[float, ...] = ()
    complete: bool = False
    gap: float | None = None
    message: str = ""
    searched: bool = False

    @property
    def unassemblable(self) -> bool:
        """Whether it is proved that there is no assembly, and more is missing than rounding of the numbers explains."""
        return self.gap is not None and self.gap > A_FEW_ROUNDINGS.relative


def none_of(ends: Sequence[DeadEnd]) -> Assemblies:
    """Return the proof that there is no assembly: the end that misses least speaks for all."""
    least = min(ends, key=lambda end: below(end.gap))
    return Assemblies(complete=True, gap=max(0.0, below(least.gap)), message=least.words())


def by_search(
    poses: tuple[Array, ...], radii: tuple[float, ...], complete: bool = False, *, why: str = "", note: str = ""
) -> Assemblies:
    """Return the assemblies that were found by search.

    Parameters
    ----------
    poses, radii, complete
        As in `Assemblies`.
    why, note : str
        Why it was made, and what is to be said of it.
    """
    what = f"{len(poses)} assemblies were found by search" if poses else "the search found none"
    message, branches = "; ".join(filter(None, (what, why, note))), tuple(() for _ in poses)
    return Assemblies(poses=poses, branches=branches, radii=radii, complete=complete, message=message, searched=True)


@dataclass(frozen=True)
class _Known:
    """An assembly, the half-width of the box around it in which it is alone, and a bound of its error."""

    q: Array
    alone: float
    radius: float


class Search:
    """The search for all assemblies of a system that closed form does not place, or the proof that there is none.

    Parameters
    ----------
    system : System
        Compiled in its mechanism's own unit.
    t : float
        Time [s].
    rows : AssemblyRows
        Its constraints at that time, in balls (`read_rows`).
    why : str
        Why closed form does not.
    all_wanted : bool
        Whether all assemblies are looked for; else one will do that is proved to be there.
    """

    def __init__(self, system: System, t: float, rows: AssemblyRows, why: str, all_wanted: bool = True) -> None:
        self.system, self.t, self.rows, self.why, self.all_wanted = system, t, rows, why, all_wanted
        self.names = [body.name for body in system.mechanism.bodies]
        self.turned, self.plan = self._trial_angles()
        self.known: list[_Known] = []
        self.failures = self.taken = self.started = 0

    def run(self) -> Assemblies:
        """Return what is found, in narrower and narrower intervals of the angle that opens the group."""
        if len(self.turned) != 1 or len(self.plan.groups) > 1 or self.rows.foreign:
            self._try(self._halton())
            if not self.known:
                self._try_starts(self._anywhere(), MOST_STARTS)
            foreign = ", ".join(self.rows.foreign)
            why = f"there is no closed form of {foreign}" if foreign else "the group is larger than a triad"
            return self._result(f"{why}: no proof was tried")
        intervals = _Intervals(self)
        intervals.halve(PROBE)
        self._try(intervals.middles(most=8))
        for width in () if self.exhausted else WIDTHS:
            intervals.halve(width)
            self._try(intervals.middles(MOST_STARTS))
            intervals.open = [part for part in intervals.open if not intervals.done(part)]
            if not intervals.open or self.exhausted or intervals.width > width:
                break
        if not intervals.open:
            return self._result(complete=True) if self.known else self._none(intervals.gap)
        left = f"{len(intervals.open)} intervals of {intervals.width:.2g} rad of the angle of {self.turned[0]}"
        return self._result(f"{left} may hold more")

    def placed(self, angles: tuple[Any, ...], holding: bool = True) -> Placement:
        """Return the placement with the trial angles given."""
        trial = (AngleConstraint(GROUND, body, a, NAME) for body, a in zip(self.turned, angles, strict=True))
        rows = replace(self.rows, relative_angles=(*self.rows.relative_angles, *trial))
        placement = place(self.plan, rows, self.names, self.system.unit.size, holding)
        self.taken += placement.taken
        return placement

    def _result(self, note: str = "", complete: bool = False) -> Assemblies:
        note += "; not all starts were tried" if self.spent and not complete else ""
        poses, radii = (tuple(getattr(known, key) for known in self.known) for key in ("q", "radius"))
        return by_search(poses, radii, complete, why=self.why, note=note)

    def _none(self, gap: Ball) -> Assemblies:
        least = below(gap)
        note = f"no angle of {self.turned[0]} closes it: at least {least * self.system.unit.size:.6g} m are missing"
        return Assemblies(complete=True, gap=least, message=note, searched=True)

    def _orientations(self, rolling: Iterable[Any] = ()) -> list[set[str]]:
        """Return the bodies whose angles are counted against each other, by rolling elements, too, where given."""
        counted = [(relative.i, relative.j) for relative in self.rows.relative_angles]
        return orientations((*counted, *chain(*(pairwise(e.bodies) for e in rolling))), self.names)

    def _trial_angles(self) -> tuple[tuple[str, ...], AssemblyPlan]:
        """Return the bodies whose angles, if known, let closed form go furthest, one after another."""
        turned: tuple[str, ...] = ()
        best = plan(self.rows, self.names)
        given = next(h for h in self._orientations() if GROUND in h)
        while not turned or len(best.groups) > 1:
            plans = [(b, self._plan((*turned, b))) for b in self.names if b not in (*turned, *given)]
            if not plans:
                break
            body, best = min(plans, key=lambda p: len(p[1].groups))
            turned = (*turned, body)
        return turned, best

    def _plan(self, turned: tuple[str, ...]) -> AssemblyPlan:
        trial = (AngleConstraint(GROUND, body, arb(0), NAME) for body in turned)
        return plan(replace(self.rows, relative_angles=(*self.rows.relative_angles, *trial)), self.names)

    def _halton(self) -> Iterator[tuple[float, ...]]:
        """Yield trial angles, and contact parameters after them."""
        contacts = [cam.span for cam in polar_cams(self.system.mechanism.joints)]
        ranges = [(-math.pi, math.pi) for _ in self.turned] + contacts
        for k in range(1, MOST_STARTS + 1 if ranges else 2):
            point = zip(halton(k, len(ranges)), ranges, strict=True)
            yield tuple(low + x * (high - low) for x, (low, high) in point)

    def _anywhere(self) -> Iterator[Array]:
        """Yield poses of bodies that no joint holds, spread evenly."""
        count = len(self.names)
        for k in range(MOST_STARTS):
            q, reaches = np.zeros(self.system.n), (1.0, 1.0, math.pi)
            points = (halton(at, 3) for at in range(1 + k * count, 1 + (k + 1) * count))  # one for each body
            q[: 3 * count] = [reach * (2 * x - 1) for at in points for x, reach in zip(at, reaches, strict=True)]
            yield initial_contacts(self.system, q, self.t)

    @property
    def exhausted(self) -> bool:
        """Whether looking on is in vain."""
        loose = sum(known.alone == 0.0 for known in self.known)
        if loose < len(self.known) and not self.all_wanted:
            return True
        return len(self.known) >= MOST_POSES or loose >= MOST_LOOSE or self.spent

    @property
    def spent(self) -> bool:
        """Whether the starts, and the steps to them, were as many as there may be."""
        return self.started >= starts_of(self.system.n) or self.taken > MOST_STEPS

    def _try(self, trials: Iterable[tuple[float, ...]]) -> None:
        """Note the new assemblies that Newton reaches from trial angles."""
        affordable = takewhile(lambda _: not self.spent, trials)
        self._try_starts(start for angles in affordable for start in self._starts(angles))

    def _try_starts(self, starts: Iterable[Array], most_failures: int = MOST_FAILURES) -> None:
        for start in starts:
            q = self._refined(start)
            self.started += 1
            self.failures = self.failures + 1 if q is None else 0
            if q is not None and self._is_new(q):
                self.known.append(self._proved(q))
            if self.exhausted or self.failures >= most_failures:
                self.failures = 0
                return

    def _refined(self, start: Array) -> Array | None:
        """Return the assembly that Newton finds from a start, without whole turns; None if it finds none.

        Angles of 1e15 rad have no digits: what seems to close there does not once they are turned back. Where a gear
        counts turns they cannot be; then it is no assembly either, unless a law asks for such angles.
        """
        for _ in range(2):
            q = refined(self.system, start, self.t)
            if q is None:
                return None
            start = self._without_turns(q)
            told = coordinates_have_digits(start[self.system.angles]) or not laws_have_digits(self.system, self.t)
            if told and closes(self.system, start, self.t):
                return start
        return None

    def _is_new(self, q: Array) -> bool:
        """Whether a pose is no known one, and its contacts lie where they are looked for, or the scene says where."""
        sought = [cam for cam in polar_cams(self.system.mechanism.joints) if cam.contact_estimate is None]
        contacts = [(cam.span, q[self.system.parameter(cam.name)]) for cam in sought if not cam.profile.closed]
        there = all(low - SAME <= s <= high + SAME for (low, high), (s,) in contacts)
        off = (self._without_turns(q - other.q) for other in self.known)
        # However a gear has counted turns of bodies: it holds in both poses.
        angles = self.system.angles & (np.arange(self.system.n) < self.system.of_bodies)
        return there and all(np.max(np.abs(x - math.tau * np.round(x / math.tau) * angles)) > SAME for x in off)

    def _starts(self, angles: tuple[float, ...]) -> Iterator[Array]:
        turned, contacts = angles[: len(self.turned)], angles[len(self.turned) :]
        placement = self.placed(tuple(arb(a) for a in turned), holding=False)
        for branch in (*placement.branches, *placement.stuck):
            q = coordinates(self.system, branch)
            q[self.system.of_bodies :][: len(contacts)] = contacts
            yield q
            if contacts:
                yield initial_contacts(self.system, q, self.t)

    def _without_turns(self, q: Array) -> Array:
        """Return q, or a difference, with angles in (-pi, pi] unless they are counted; bodies that roll turn as one."""
        q = q.copy()
        joints = self.system.mechanism.joints
        rolling = (e for e in elements_of(joints) if isinstance(e, RollingWheels | RollingOnLine))
        free = [bodies for bodies in self._orientations(rolling) if GROUND not in bodies]
        groups = [[self.system.columns(body).stop - 1 for body in self.names if body in bodies] for bodies in free]
        closed = [cam.name for cam in polar_cams(joints) if cam.profile.closed]
        for group in (*groups, *([self.system.parameter(name).start] for name in closed)):
            q[group] -= math.tau * math.ceil(q[group[0]] / math.tau - 0.5)
        return q

    def _proved(self, q: Array) -> _Known:
        for alone in RADII:
            root = krawczyk(self.system, q, self.t, radius=alone)
            if root is not None:
                return _Known(q, alone, max(above(abs(x - float(v))) for x, v in zip(root.q, q, strict=True)))
        return _Known(q, 0.0, math.nan)


class _Intervals:
    """Intervals of the trial angle, all of the same width, that may hold assemblies not known yet."""

    def __init__(self, search: Search) -> None:
        self.search = search
        # A little more than a turn, so that the ends of the interval are inside as well.
        self.open, self.width = [(-3.1416, 3.1416)], 6.2832
        self.looked_at = 0
        self.gap: Ball = arb.pos_inf()

    def halve(self, width: float) -> None:
        """Halve, and drop what is done with, until nothing is left, a width or the allowed number is reached."""
        while self.open and self.width > width and self._affordable(2 * len(self.open)):
            self.looked_at += 2 * len(self.open)
            halves = [half for low, high in self.open for half in pairwise((low, (low + high) / 2, high))]
            self.open = [part for part in halves if not self.done(part)]
            self.width /= 2

    def _affordable(self, more: int) -> bool:
        """Whether there may be so many intervals more, each of as many steps as those so far."""
        every = self.looked_at + more
        return every <= MOST_INTERVALS and self.search.taken * every <= MOST_STEPS * max(1, self.looked_at)

    def middles(self, most: int) -> tuple[tuple[float], ...]:
        """Return the middles of the open intervals: all, or some evenly."""
        step = -(-len(self.open) // most) or 1
        return tuple(((low + high) / 2,) for low, high in self.open[::step])

    def done(self, part: tuple[float, float]) -> bool:
        """Whether an interval holds no assembly but known ones."""
        placement = self.search.placed((interval(*part),))
        if placement.stuck or placement.truncated:
            return False
        self.gap = min([self.gap, *(whole(end.gap) for end in placement.ends)], key=below)
        return all(self._is_known(branch) for branch in placement.branches)

    def _is_known(self, branch: PlacedBranch) -> bool:
        """Whether all of a branch lies where a known assembly is the only one."""
        names, system = self.search.names, self.search.system
        for known in self.search.known:
            off = 0.0
            for body in names:
                pose, (x, y, phi) = branch.poses[body], known.q[system.columns(body)]
                turn = whole(pose.phi) - float(phi)
                turn = turn - 2 * arb.pi() * round(float(turn.mid()) / math.tau)
                off = max([off, *(above(abs(d)) for d in (whole(pose.r.x) - x, whole(pose.r.y) - y, turn))])
            if off <= known.alone:
                return True
        return False


def starts_of(n: int) -> int:
    """Return how many starts a search may have where there are n coordinates: each takes longer the more they are."""
    return max(1, MOST_WORK // n**2)


def halton(k: int, count: int) -> list[float]:
    """Return the k-th point of Halton's sequence, so many coordinates from 0 to 1; its eight bases come again."""
    return [radical_inverse(k, PRIMES[n % len(PRIMES)]) for n in range(count)]


def radical_inverse(k: int, base: int) -> float:
    """Return the digits of k in a base, mirrored at the point: one coordinate of Halton's sequence."""
    value, weight = 0.0, 1.0 / base
    while k:
        k, digit = divmod(k, base)
        value += digit * weight
        weight /= base
    return value


def refined(system: System, start: Array, t: float) -> Array | None:
    """Return the assembly that Newton finds from a start, or else Levenberg and Marquardt; None if neither finds one.

    Parameters
    ----------
    system : System
        Compiled in its mechanism's own unit.
    start : (n,) array
        A guess of the pose at time t [s], in the system's coordinates.
    t : float
        When [s].
    """
    result = position(system, start, t, max_iterations=30)
    if not (result.converged and closes(system, result.q, t)):
        result = least_squares(system, start, t)
    return result.q if result.converged and closes(system, result.q, t) else None


def closes(system: System, q: Array, t: float, allowed: float = 0.0) -> bool:
    """Return whether the residual of a pose is round-off, or no more than is allowed.

    Parameters
    ----------
    system : System
        Compiled in its mechanism's own unit.
    q : (n,) array
        The pose at time t [s], in the system's coordinates.
    t : float
        When [s].
    allowed : float
        The residual that is allowed in any case.
    """
    residual = system.phi(q, t)
    return bool(is_round_off(residual, q)) or float(np.max(np.abs(residual))) <= allowed


def coordinates(system: System, branch: PlacedBranch) -> Array:
    """Return the middles of a branch's balls as coordinates."""
    q = np.zeros(system.n)
    for body in system.mechanism.bodies:
        pose = branch.poses[body.name]
        q[system.columns(body.name)] = [float(whole(x).mid()) for x in (pose.r.x, pose.r.y, pose.phi)]
    return q
