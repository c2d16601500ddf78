"""Two answers to one scene, held against a derived budget: error, error / allowed, digits, the worst sample."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from functools import cached_property
from typing import Any

import numpy as np

from crosscheck.engines import Term
from crosscheck.engines.frames import wrap
from crosscheck.judge.budget import BOTH_SIDES, ErrorBudget, Propagation, propagation, times_with
from crosscheck.judge.poses import with_contacts, with_counts, with_turns
from crosscheck.judge.records import MOST_DIGITS, QUANTITIES, At, Common
from crosscheck.judge.spatial import Spins, alike, half_angles, passive_lines, spun
from crosscheck.scenes.names import decade
from refkin.model import Effect, Evidence, Scene
from refkin.motion import Motion, Status
from refkin.solving.solve import nearest
from refkin.system import System, compile_system


@dataclass(frozen=True)
class Reference:
    """The reference's answer for every body and effect, with what a comparison needs of it."""

    scene: Scene
    system: System
    motion: Motion
    levels: tuple[Any, Any, Any]
    sigma_min: Any

    _budgets: dict[tuple[Term, ...], ErrorBudget] = field(default_factory=dict, repr=False)

    @cached_property
    def propagation(self) -> Propagation:
        """What budgets are derived from; it costs most of them, and is the same for all engines."""
        return propagation(self.system, self.motion, *self.levels)

    @cached_property
    def passive(self) -> Spins:
        """The lines about which bodies of space spin as they like, in the system's unit (`passive_lines`)."""
        if self.system.kind.name != "spatial":
            return ()
        return passive_lines(self.scene.mechanism, self.system.unit)

    @cached_property
    def common(self) -> Common | None:
        """The one time of a scene at which answers are compared with each other, and what their errors relate to.

        It is the middle one of the times at which a budget is derived; None if there is none.
        """
        times = np.flatnonzero(self.budget().compared)
        if not times.size:
            return None
        k = int(times[times.size // 2])
        scale = {q: float(scales(self.levels, order, self.rests)[k]) for order, q in enumerate(QUANTITIES)}
        return Common(k=k, scale=scale)

    @cached_property
    def rests(self) -> Any:
        """Whether laws leave each level (3, T) nothing but rounding: it has no digits of its own there."""
        rests = np.zeros((3, len(self.motion.t)), bool)
        rests[:, self.propagation.samples] = self.propagation.rests
        return rests

    @cached_property
    def decades(self) -> list[int | None]:
        """The decade of the distance to a singular pose at each time; None where there is none, or zero."""
        return [decade(s) for s in self.sigma_min.tolist()]

    def budget(self, terms: Sequence[Term] = ()) -> ErrorBudget:
        """Return the allowed errors against another answer."""
        key = tuple(terms)
        if key not in self._budgets:
            self._budgets[key] = self.propagation.budget(key)
        return self._budgets[key]


@dataclass(frozen=True)
class QuantityComparison:
    """One quantity of a comparison, per time; NaN where it was not compared.

    The largest `error` is in scaled coordinates, the largest `ratio` that to what is allowed, at `worst`; `digits` are
    -log10 of the error plus the proved radius of the reference, if there is one, relative to what `scales` says: so
    many are right for certain. `difference` (n, T) is the answer minus the reference, signed,
    in the reference's scaled coordinates of bodies and their order; NaN for bodies that the answer has not. `places`
    are the coordinates in which the ratio is largest.
    """

    error: Any
    ratio: Any
    digits: Any
    worst: At | None
    difference: Any = None
    places: Any = None

    @property
    def agrees(self) -> bool:
        """Whether every compared sample is within its budget."""
        return not (self.ratio > 1.0).any()


@dataclass(frozen=True)
class Comparison:
    """An answer against the reference, by the names of the quantities that both have.

    At `missing` times, the first of them `first_missing` [s], the reference is ok and the other answer is not;
    `compared` were held against a budget. At the times `elsewhere` (T,) it closes the linkage, but on another branch.
    `silences` has of each stretch without a right position in which an answer is missing the last time [s] before it
    that has one, or the first time of all, and the first missing one. `budget` is what it was held against.
    """

    quantities: Mapping[str, QuantityComparison]
    missing: int
    compared: int
    elsewhere: Any
    first_missing: float = np.inf
    silences: Sequence[tuple[float, float]] = ()
    budget: Any = None

    @property
    def other_assembly(self) -> bool:
        """Whether it is on another branch at any time."""
        return bool(self.elsewhere.any())

    @property
    def agrees(self) -> bool:
        """Whether every compared sample of every quantity is within its budget."""
        return all(q.agrees for q in self.quantities.values())


def begun_at(scene: Scene, motion: Motion, k: int, times: Sequence[float]) -> Scene:
    """Return a scene at other times, its estimates being the poses of its motion at the k-th time.

    Parameters
    ----------
    scene, motion : Scene, Motion
    k : int
        Which of the motion's times.
    times : sequence of float
        Those of the new scene [s].
    """
    bodies = tuple(replace(body, estimate=tuple(motion[body.name].q[:, k].tolist())) for body in scene.mechanism.bodies)
    return replace(scene, mechanism=replace(scene.mechanism, bodies=bodies), times=tuple(times))


def reference(scene: Scene) -> Reference:
    """Solve a scene with refkin for every body and effect, whatever the scene calls for."""
    evidence = scene.evidence | {Evidence.CONDITION}
    whole = replace(scene, bodies_wanted=None, effects=frozenset(Effect), evidence=evidence)
    motion = nearest(whole)
    system = compile_system(scene.mechanism, unit=scene.mechanism.unit())
    contacts: list[Any] = [(c.s, c.sd, c.sdd) for c in motion.contacts.values()]
    whole_levels: list[Any] = [(level, *(c[k] for c in contacts)) for k, level in enumerate(motion.levels)]
    with np.errstate(invalid="ignore"):
        q, qd, qdd = (system.to_unit(np.vstack(level), order) for order, level in enumerate(whole_levels))
    return Reference(whole, system, motion, (q, qd, qdd), motion.sigma_min)


def compare(ref: Reference, motion: Motion, terms: Sequence[Term] = (), at: Any = slice(None)) -> Comparison:
    """Compare a motion with the reference's, body by body in the motion's own order.

    Angles are compared modulo full turns.

    Parameters
    ----------
    ref : Reference
    motion : Motion
        The engine's answer, at the reference's times or some of them.
    terms : sequence of Term
        What the engine adds.
    at : index
        The places among the reference's times of those that the motion has.
    """
    budget = ref.budget(terms)
    answered, ok = times_with(motion, Status.OK), times_with(ref.motion, Status.OK)
    samples = budget.compared[at] & answered
    compared = _judge(ref, motion, budget, samples, at)
    beyond = np.zeros(len(ok), bool)
    beyond[at] = np.any([~(quantity.ratio <= 1.0) for quantity in compared.values()], axis=0) & samples
    if "position" in compared:  # of a pose that is elsewhere no square says anything
        beyond[at] &= ~(compared["position"].error > BOTH_SIDES * np.max(budget.levels[0][:, at], axis=0))
    if beyond.any():
        budget = ref.propagation.second_order(budget, terms, beyond)
        compared = _judge(ref, motion, budget, samples, at)
    missing = ok[at] & ~answered
    right = compared["position"].ratio <= 1.0 if "position" in compared else np.zeros(len(missing), bool)
    silences = _silences(motion.t, missing, right)
    first = silences[0][1] if silences else np.inf
    other = _elsewhere(ref, motion, compared, at)
    return Comparison(compared, int(missing.sum()), int(samples.sum()), other, first, silences, budget)


def _silences(t: Any, missing: Any, right: Any) -> list[tuple[float, float]]:
    """Return where answers are missing, as `Comparison.silences` has it."""
    silences, since, silent = list[tuple[float, float]](), float(t[0]), False
    for time, nothing, known in zip(t.tolist(), missing, right, strict=True):
        if known:
            since, silent = time, False
        elif nothing and not silent:
            silences.append((since, time))
            silent = True
    return silences


def uncompared(ref: Reference, motion: Motion, terms: Sequence[Term] = ()) -> Any:
    """Return at which times (T,) an answer calls ok what is held against no budget, but where there is an assembly.

    Parameters
    ----------
    ref, motion : Reference, Motion
    terms : sequence of Term
        What the engine adds.
    """
    nowhere = times_with(ref.motion, Status.UNASSEMBLABLE)  # what is called ok there is wrong (`believed`)
    return times_with(motion, Status.OK) & ~ref.budget(terms).compared & ~nowhere


def rows_of(system: System, bodies: Sequence[str]) -> list[int]:
    """Return the coordinates of some bodies, in their order."""
    return [k for body in bodies for k in range(system.n)[system.columns(body)]]


def scales(levels: Sequence[Any], order: int, rests: Any) -> Any:
    """Return what an error is relative to, per time: 1 (the size) for position, else the largest component.

    Of an acceleration it is the square of the largest velocity where that is more: it is part of the sum in which it
    was rounded. Where a rate rests it is the median of the other times, 1 if there are none.

    Parameters
    ----------
    levels : sequence of (n, T) array
        Position, velocity and acceleration of the reference, scaled.
    order : int
        Which of them.
    rests : (3, T) array of bool
        At which times each of them rests (`Reference.rests`).
    """
    if order == 0:
        return np.ones(levels[0].shape[1])
    velocity, level = (np.max(np.abs(levels[k]), axis=0) for k in (1, order))
    largest = np.maximum(level, velocity**order)
    still = rests[order] | (largest == 0.0)
    if not still.any():
        return largest
    moving = largest[~still & np.isfinite(largest)]
    return np.where(still, np.median(moving) if moving.size else 1.0, largest)


def scaled(ref: Reference, bodies: Sequence[str], levels: Mapping[int, Any], at: Any = slice(None)) -> tuple[Any, Any]:
    """Return K levels of an answer, and the reference's own, both in its scaled coordinates, (K, n, T) each.

    Signs of Euler parameters and passive spins are in both those of the reference.

    Parameters
    ----------
    ref : Reference
    bodies : sequence of str
        In the order in which the levels have them.
    levels : mapping
        Order 0, 1, 2 -> position, velocity, acceleration (width * bodies, T) of the bodies [m, rad], in their order. In
        space no rate comes without the position.
    at : index
        The places among the reference's times of those that the levels have.
    """
    system, rows = ref.system, rows_of(ref.system, bodies)
    ours = np.array([ref.levels[order][rows][:, at] for order in levels])
    theirs = np.array([*levels.values()], float)
    for c, shift in enumerate(system.unit.origin):
        if 0 in levels:
            theirs[0, c :: system.kind.width] -= shift
        theirs[:, c :: system.kind.width] /= system.unit.size
    if system.kind.name == "spatial":
        given, alone = theirs, bool(ref.passive) and list(levels) == [0, 2]
        if alone:
            theirs = np.insert(theirs, 1, np.nan, axis=0)
            ours = np.insert(ours, 1, ref.levels[1][rows][:, at], axis=0)
        with np.errstate(invalid="ignore", divide="ignore"):
            theirs = np.array(alike(list(theirs), list(ours), bodies, ref.passive))
        if alone:  # how what spins as it likes is accelerated says nothing where it is not said how fast it spins
            theirs, ours = theirs[::2], ours[::2]
            theirs[1] = np.where(np.isnan(theirs[1]) & np.isfinite(given[1]), ours[1], theirs[1])
    return theirs, ours


def difference(system: System, theirs: Any, ours: Any, level: int) -> Any:
    """Return a level of the bodies minus another, both scaled, (n,) or (n, T): angles without whole turns.

    Parameters
    ----------
    system : System
    theirs, ours : (n,) or (n, T) array
        Scaled coordinates, or rates.
    level : int
        0 for coordinates, 1 or 2 for their rates.
    """
    apart = theirs - ours
    if level == 0 and system.kind.name == "planar":
        apart[2::3] = wrap(apart[2::3])
    return apart


def _judge(ref: Reference, motion: Motion, budget: ErrorBudget, samples: Any, at: Any) -> dict[str, QuantityComparison]:
    """Return the comparison of each quantity that a motion has, by name; all of them at once, (K, n, T)."""
    system, levels = ref.system, {k: level for k, level in enumerate(motion.levels) if level is not None}
    if not levels:
        return {}
    error, ratio, digits = np.full((3, len(levels), len(samples)), np.nan)
    signed = np.full((len(levels), system.of_bodies, len(samples)), np.nan)
    worst: list[At | None] = [None] * len(levels)
    names = np.array([f"{body}.{coordinate}" for body in motion.bodies for coordinate in system.kind.coordinates])
    places = np.full((len(levels), len(samples)), "", names.dtype)
    if samples.any():
        theirs, ours = scaled(ref, motion.bodies, levels, at)
        differences = np.array([difference(system, *pair) for pair in zip(theirs, ours, levels, strict=True)])
        rows, where = rows_of(system, motion.bodies), slice(None) if samples.all() else samples
        whole, rests = [level[rows][:, at][:, where] for level in ref.levels], ref.rests[:, at][:, where]
        signed[:, rows] = np.where(samples, differences, np.nan)
        allowed = budget.levels[list(levels)][:, rows][..., at]
        if ref.passive:
            allowed = np.array([spun(level, motion.bodies, ref.passive) for level in allowed])
        allowed = allowed[..., where]
        with np.errstate(divide="ignore", invalid="ignore"):
            off = np.abs(differences[..., where])
            off[~np.isfinite(off)] = np.inf  # a NaN that calls itself an answer is as wrong as can be
            ratios = off / allowed
            ratios[off == 0.0] = 0.0
            error[:, where], ratio[:, where] = np.max(off, axis=1), np.max(ratios, axis=1)
            proved = [np.nan_to_num(getattr(ref.motion.certified_radius, QUANTITIES[k]))[at][where] for k in levels]
            relative = (error[:, where] + proved) / np.array([scales(whole, k, rests) for k in levels])
            digits[:, where] = np.minimum(MOST_DIGITS, -np.log10(relative))
        places[:, where] = names[np.argmax(np.fmax(ratios, 0.0), axis=1)]
        worst = [worst_at(*pair, samples, motion.t) for pair in zip(ratio, places, strict=True)]
    compared = zip(levels, error, ratio, digits, worst, signed, places, strict=True)
    return {QUANTITIES[k]: QuantityComparison(*parts) for k, *parts in compared}


def worst_at(ratio: Any, places: Any, samples: Any, t: Any) -> At:
    """Return where a ratio is largest among some times.

    Parameters
    ----------
    ratio, places : (T,) array
        The largest of each time, and in which coordinate that is.
    samples : (T,) array of bool
    t : (T,) array
        All times [s].
    """
    k = int(np.argmax(np.where(samples, np.fmax(ratio, 0.0), -1.0)))
    return At(str(places[k]), float(t[k]))


def _elsewhere(ref: Reference, motion: Motion, compared: Mapping[str, QuantityComparison], at: Any) -> Any:
    """Return at which times (T,) a wrong position is another solution of the constraints: put together another way.

    It is if its own residual, carried by |J^-1|, accounts for less than a tenth of its error: to first order the two
    are equal, and no second order is ten times as large but where it leads to the next solution. Each time is asked by
    itself: one at which it is says nothing of the others, which it would hide behind a gap that is known.
    """
    elsewhere = np.zeros(len(motion.t), bool)
    if "position" not in compared or compared["position"].agrees:
        return elsewhere
    position = compared["position"]
    wrong = (position.ratio > 1.0) & np.isfinite(position.error)
    t, ours = motion.t[wrong], ref.levels[0][:, at][:, wrong]
    q = whole_poses(ref.system, motion, wrong, ours)
    stacked = np.moveaxis(ref.system.held_at(ours).phi_q(ours, t), -1, 0)
    residual = np.moveaxis(np.abs(ref.system.held_at(q).phi(q, t)), -1, 0)[..., None]  # no spin violates anything
    carried = np.abs(np.linalg.pinv(stacked)) @ residual
    elsewhere[wrong] = np.max(carried, axis=(1, 2)) < 0.1 * position.error[wrong]
    return elsewhere


OWN_TURNS = 0.5
"""The part of the residual in the reference's turns below which that in an answer's own ones says that it counts so."""


def whole_poses(system: System, motion: Motion, samples: Any, ours: Any) -> Any:
    """Return an answer's poses (n, K) at some of its times, scaled; NaN in what is of bodies that it has not.

    Parameters
    ----------
    system : System
        The reference's.
    motion : Motion
    samples : (T,) array of bool
        Which of the motion's times.
    ours : (n, K) array
        The reference's poses there; NaN where it has none.
    """
    q, t, width = np.zeros((system.n, int(samples.sum()))), motion.t[samples], system.kind.width
    bodies = q[: system.of_bodies]
    bodies[:] = np.nan
    for k, body in enumerate(motion.bodies):
        q[system.columns(body)] = motion.q[width * k : width * (k + 1), samples]
    if width == 7 and len(bodies) < len(q):
        q[len(bodies) :] = half_angles(system.mechanism, bodies)
    q = with_counts(system, system.to_unit(q), t, ours)
    known, own = np.isfinite(ours).all(axis=0), ours[: system.of_bodies]
    bodies, given = q[: system.of_bodies], q.copy()
    bodies[:, known] = (own + difference(system, bodies, own, 0))[:, known]
    q[:, ~known] = with_turns(system, q[:, ~known], t[~known])
    if np.any(np.abs(given - q) > 1.0):  # of another assembly the reference's turns may be none
        left = [np.max(np.abs(np.nan_to_num(system.phi(x, t))), axis=0, initial=0.0) for x in (given, q)]
        q = np.where(left[0] < OWN_TURNS * left[1], given, q)
    return with_contacts(system, q, t, ours)
