"""The allowed error of an answer, derived per sample and component; nothing here is tuned.

First-order propagation through the equations of the reference, at its solution and in its scaled coordinates. With
A = phi_q^-1, S = d(phi_q qd - nu)/dq, T = d(phi_q qdd - gamma)/dq and C = d gamma/d qd, errors e of the three residuals
move the three levels by

    dq   = A e_phi                                                    (B1)
    dqd  = A (e_nu - S dq)               = A e_nu - A S A e_phi       (B2)
    dqdd = A (e_gamma - T dq + C dqd)    = A e_gamma + A C A e_nu - A (T + C A S) A e_phi (B3)

The rows err independently, so the largest move takes the absolute values of these products, not of their factors: a
pose that is wrong by one row's error is wrong in all its coordinates together, and what that does to the rates cancels
for the most part. Taken factor by factor it does not, and allows up to 1e5 times too much. A frame far from its joints
is no different: its large arms stand in A and S alike, and cancel in A S A, as they would in recentred frames. To this
comes the rounding of the answer itself. Where an error is beyond first order its square is asked for, too: it counts
where the first order cancels, as of a body that is hardly moved by what turns others fast.

The e are what rounding leaves (`rounding`). The other side of a comparison, the reference, is off by no more than its
certified radius, and no more than an engine without terms; the smaller is added, component by component.

What an engine adds by its own doing, such as a stopping rule above round-off, is a named `Term` with its reason. Where
it leaves that in rows of another form, y = M(q) phi, its rates satisfy y' = M phi' + M' phi = 0, and not phi' = 0: so
B1 to B3 are those of the rows y, whose S, T and C differ by M' and M''.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import Any

import numpy as np

from crosscheck.engines import Term
from crosscheck.judge.parts import at_joints, by_part, parts_of
from crosscheck.judge.rounding import (
    elimination,
    largest,
    output_rounding,
    rate_rows,
    residual_error,
    table_error,
    times,
)
from crosscheck.scenes.names import QUANTITIES
from refkin.motion import Motion, Status
from refkin.newton import solve_linear
from refkin.proof.numbers.bounded import Times
from refkin.solving.starts import in_form
from refkin.system import System, compile_system

BOTH_SIDES = 2.0
"""Where what an answer is held against is itself computed in float64, and no radius of it is known."""
STEP = 1e-100
CORRECTIONS = 4
"""Corrections to a pose whose residual changes J by less than `TENTH`: by one J, its fourth power is left of it."""
TENTH = 0.1
"""By less than this much of itself a change of position must change J for first order to say enough."""
AT_ONCE = 1_000_000
"""About so many entries of J are computed at once, and at least those of one direction."""


@dataclass(frozen=True)
class ErrorBudget:
    """Allowed absolute errors of the three levels in scaled coordinates (3, n, T); NaN where none is derived.

    `compared` says per time if a first-order statement holds: where the position error could change J by a good part
    of itself (near a singular pose) none does, and only a certificate can arbitrate.
    """

    levels: Any
    compared: Any


@dataclass(frozen=True)
class Carried:
    """How errors of the residuals of the three levels move the three levels; absolute values, (n, m, T) each.

    `phi`, `nu` and `gamma` are what an error of that residual does to the levels from its own on. `bend` (n, T) bounds
    by how much of itself a change of each coordinate changes J.
    """

    phi: tuple[Any, Any, Any]
    nu: tuple[Any, Any]
    gamma: tuple[Any]
    bend: Any

    def __call__(self, *errors: Any) -> list[Any]:
        """Return what errors (m, T) of the three residuals do to position, velocity and acceleration, (n, T) each."""
        alone = [self.of(level, e) for level, e in enumerate(errors)]
        return [sum(alone[k][level - k] for k in range(level + 1)) for level in range(3)]

    def of(self, level: int, error: Any) -> list[Any]:
        """Return what errors (m, T) of the residual of one level alone do to the levels from its own on."""
        return [times(matrix, error) for matrix in (self.phi, self.nu, self.gamma)[level]]

    def of_norm(self, in_nu: Any, in_gamma: Any) -> list[Any]:
        """Return what residuals do to the three levels of which each part's norms are known, (n, T)."""
        velocity, by_velocity, acceleration = (np.sqrt(np.einsum("nmt,nmt->nt", a, a)) for a in (*self.nu, *self.gamma))
        return [0.0, velocity * in_nu, by_velocity * in_nu + acceleration * in_gamma]

    def at(self, samples: Any) -> Carried:
        """Return the same at some of the samples."""
        phi, nu, gamma = (tuple(a[..., samples] for a in level) for level in (self.phi, self.nu, self.gamma))
        return Carried(phi, nu, gamma, self.bend[:, samples])


@dataclass(frozen=True)
class Propagation:
    """What carries errors through the equations at a solution: the same for every engine. See `propagation`.

    `levels` are its coordinates and rates (n, T), `e` the errors of the residuals of the three levels (m, T) before an
    engine adds its own, `solving` what solving for rates adds to the levels, `size` what stands in their equations,
    `rounding` what handing a result over costs, and `radius` (T,) how far the reference itself may be off; NaN where it
    has no certificate. Where a level `rests`, (3, T) of bool, nothing is left of the right side of its equations but
    rounding.
    """

    system: System
    levels: tuple[Any, Any, Any]
    t: Any
    samples: Any
    count: int
    carried: Carried
    e: tuple[Any, Any, Any]
    solving: list[Any]
    size: tuple[Any, Any, Any]
    rounding: tuple[Any, Any, Any]
    radius: tuple[Any, Any, Any]
    rests: Any

    @cached_property
    def both(self) -> Any:
        """What is allowed of an engine without terms, (3, n, T).

        It is the engine's own error, that which the reference may be off by, no larger, and the rounding.
        """
        own = [moved + solving for moved, solving in zip(self.carried(*self.e), self.solving, strict=True)]
        each = zip(own, self.radius, self.rounding, strict=True)
        return np.array([theirs + np.fmin(radius, theirs) + rounding for theirs, radius, rounding in each])

    @cached_property
    def rates(self) -> tuple[Any, Any, Any]:
        """The largest rate at joints, acceleration and square of a rate in the same part, by level, (n, T) each."""
        own = parts_of(self.system).coordinates
        rate, bend = (by_part(largest, x, own, own) for x in at_joints(self.system, *self.levels))
        return np.zeros_like(rate), rate, bend + rate**2

    @cached_property
    def of_one(self) -> list[Any]:
        """What an error of 1 in every row of a residual does to its own level and those after, (3 - level, n, T)."""
        return [np.sum(own, axis=2) for own in (self.carried.phi, self.carried.nu, self.carried.gamma)]

    @property
    def weights(self) -> float:
        """How much more a residual that is left does to later levels, where rows are redundant.

        Such a pose contradicts some rows, and rates are least squares of what is left: an engine's rows are ours times
        1/2 to 2 (sines of angles or of their halves), so that their squares weigh up to four times as much.
        """
        return 4.0 if self.system.m > self.system.n else 1.0

    @cached_property
    def of_size(self) -> list[Any]:
        """What errors as large as what stands in a residual's equations do, as `of_one`."""
        return [np.array(self.carried.of(level, size)) for level, size in enumerate(self.size)]

    def left(self, order: int, t: float) -> Any:
        """Return what rounding leaves of the rows (m,) of a level at one of the times: of formulas, answer, solving."""
        return self.of_rows[order][:, int(np.flatnonzero(self.t == t)[0])]

    @cached_property
    def of_rows(self) -> list[Any]:
        """What rounding leaves of the rows of each level, (m, T) each (`left`)."""
        slope, rows = np.abs(self.system.phi_q(self.levels[0], self.t)), parts_of(self.system).rows
        left = [e + times(slope, rounding) for e, rounding in zip(self.e, self.rounding, strict=True)]
        solving = [elimination(size, rows, rows) for size in self.size[1:]]
        return [left[0], *(own + more for own, more in zip(left[1:], solving, strict=True))]

    def budget(self, terms: Sequence[Term] = ()) -> ErrorBudget:
        """Return the allowed errors where an engine adds these terms."""
        levels = self.both.copy()
        for term in (term for term in terms if term.level in QUANTITIES):  # others are of an engine's own rows
            first = QUANTITIES.index(term.level)
            if term.form:
                added = self._left_in(term.form, term.absolute)[first:]
            else:
                of_rates = term.of_rates * self.rates[first] if term.of_rates else 0.0
                added = (term.absolute + of_rates) * self.of_one[first]
                if term.relative:
                    added += term.relative * self.of_size[first]
            added[1:] *= self.weights
            levels[first:] += added
        levels[1:] += self._solved_with(levels)
        whole = np.full((*levels.shape[:2], self.count), np.nan)
        whole[..., self.samples] = levels
        return ErrorBudget(whole, self._judged(levels[0]))

    def second_order(self, budget: ErrorBudget, terms: Sequence[Term], at: Any) -> ErrorBudget:
        """Return a budget with what is allowed at some times (count,) of bool beyond first order.

        It is what a residual makes of all levels, solved for with either sign, less what it makes of them to first
        order: the most of those along the left singular vectors. Next to a singular pose that is the last one's.
        """
        here = np.flatnonzero(at[self.samples])
        q, t = self.levels[0][:, here], self.t[here]
        left = BOTH_SIDES * self.e[0][:, here]
        for term in (term for term in terms if term.level == QUANTITIES[0]):
            left = left + (BOTH_SIDES if term.form else 1.0) * (term.absolute + term.relative * self.size[0][:, here])
        levels, places = budget.levels.copy(), self.samples[here]
        more = _beyond_first(self.system, q, left, t, BOTH_SIDES * np.max(levels[0][:, places], axis=0))
        more[2] += self._squares(terms, here)
        levels[..., places] += np.where(more > TENTH * self.both[..., here], more, 0.0)  # less is rounding
        return ErrorBudget(levels, budget.compared)

    def _squares(self, terms: Sequence[Term], here: Any) -> Any:
        """Return what squares of velocities that are off add to accelerations (n, K), at some of the samples.

        Of a linkage that is pushed along and does not turn nothing else is: omega = 0 may be off by rounding / sigma,
        and its square is in gamma. What is even in velocities there, less what is left at none, are their squares.
        """
        q, t, left = self.levels[0][:, here], self.t[here], BOTH_SIDES * self.of_rows[1][:, here]
        for term in (term for term in terms if term.level == QUANTITIES[1]):
            left = left + term.absolute + term.relative * self.size[1][:, here]
        system, more = self.system.held_at(q), np.zeros_like(q)
        slope, still = system.phi_q(q, t), system.gamma(q, 0.0 * q, t)
        for alike, at, inverse, residual in _along_directions(system, slope, q, t, left):
            held, off = system.held_at(alike), times(inverse, residual)
            even = 0.5 * (held.gamma(alike, off, at) + held.gamma(alike, -off, at))
            gained = np.abs(times(inverse, even - np.tile(still, len(at) // len(t))))
            more = np.maximum(more, np.max(gained.reshape(len(q), -1, len(t)), axis=1))
        return more

    def _solved_with(self, levels: Any) -> Any:
        """Return what solving adds to rates (2, n, T) that may be off (3, n, T) by a good part of themselves.

        What they are off is solved for with them, by all coordinates' rows together.
        """
        more, most = np.zeros_like(levels[1:]), np.max(np.abs(self.levels[1:]), axis=1)
        far = np.flatnonzero(((np.max(levels[1:], axis=1) > TENTH * most) & (most > 0.0)).any(axis=0))
        if far.size:
            own, slope = parts_of(self.system), np.abs(self.system.phi_q(self.levels[0][:, far], self.t[far]))
            sizes = [elimination(times(slope, off[:, far]), own.rows, own.coordinates) for off in levels[1:]]
            more[..., far] = self.carried.at(far).of_norm(*sizes)[1:]
        return more

    def _judged(self, dq: Any) -> Any:
        """Return (count,) whether first order says enough where a position is off by dq (n, T)."""
        enough = times(self.carried.bend[None], dq)[0] < TENTH
        if not enough.all():  # bounds of each coordinate's part may say too much together
            far = ~enough
            inverse, q = self.carried.phi[0][..., far], self.levels[0][:, far]
            enough[far] = _first_order(self.system, inverse, dq[:, far], q, self.t[far])
        compared = np.zeros(self.count, bool)
        compared[self.samples] = enough
        return compared

    def _left_in(self, form: str, residual: float) -> Any:
        """Return what a residual of the position, in rows of another form, does to the three levels, (3, n, T)."""
        system = compile_system(in_form(self.system.mechanism, form), unit=self.system.unit)
        left, nothing = np.full((2, system.m, len(self.t)), [[[residual]], [[0.0]]])
        return np.array(carried(system, *self.levels, self.t)(left, nothing, nothing))


def propagation(system: System, motion: Motion, q: Any, qd: Any, qdd: Any) -> Propagation:
    """Return what budgets are derived from, at the times at which the reference is ok.

    Parameters
    ----------
    system : System
        Compiled with `mechanism.unit()` and every effect.
    motion : Motion
        The reference's answer, for times and statuses.
    q, qd, qdd : (n, T) array
        Its coordinates and rates in the system's scaled coordinates; NaN where there is no answer.
    """
    samples = np.flatnonzero(times_with(motion, Status.OK))
    t, q, qd, qdd = motion.t[samples], q[:, samples], qd[:, samples], qdd[:, samples]
    e_phi = residual_error(system, q, t)
    velocity, acceleration = rate_rows(system, q, qd, qdd, t)  # the rounding of the results is `output_rounding`
    own = parts_of(system)
    e = _contradicted(
        system,
        (e_phi + table_error(system, Times(t, 0), 0), velocity.error, acceleration.error),
        (system.phi(q, t), velocity.left, acceleration.left),
    )
    still, steady = ((np.abs(rows.right) <= rows.error).all(axis=0) for rows in (velocity, acceleration))
    carry = carried(system, q, qd, qdd, t)
    return Propagation(
        system=system,
        levels=(q, qd, qdd),
        t=t,
        samples=samples,
        count=len(motion.t),
        carried=carry,
        e=e,
        solving=carry.of_norm(*(elimination(x.size, own.rows, own.coordinates) for x in (velocity, acceleration))),
        size=(e_phi, velocity.size, acceleration.size),
        rounding=output_rounding(system, q, qd, qdd, t),
        radius=tuple(getattr(motion.certified_radius, level)[samples] for level in QUANTITIES),
        rests=np.array([np.zeros_like(still), still, still & steady]),
    )


def _contradicted(system: System, e: tuple[Any, Any, Any], left: tuple[Any, Any, Any]) -> tuple[Any, Any, Any]:
    """Return the errors of residuals with the most that redundant rows contradict each other by, where that is more.

    The numbers of a scene far from its origin are that rough. The reference leaves it, `left`, in some of the rows; who
    satisfies those leaves it in others.
    """
    if system.m == system.n:
        return e
    each = ((own, largest(x)) for own, x in zip(e, left, strict=True))
    first, second, third = (own + np.where(most > largest(own), most, 0.0) for own, most in each)
    return first, second, third


def times_with(motion: Motion, status: Status) -> Any:
    """Return at which times a motion has a status, (T,) of bool."""
    return np.array([s is status for s in motion.status], bool)


def carried(system: System, q: Any, qd: Any, qdd: Any, t: Any) -> Carried:
    """Return how errors of residuals move a solution (n, T) of the system; the products of the module's formulas.

    Parameters
    ----------
    system : System
    q, qd, qdd : (n, T) array
        The solution, in the system's coordinates.
    t : (T,) array
        Times [s].
    """
    slope, second, third, coriolis = slopes(system, q, qd, qdd, t)
    inverse, bent = _inverse(np.real(slope[:, :, 0])), np.imag(slope) / STEP
    rate = inverse @ second  # A S
    bend = inverse @ (third + coriolis @ rate)
    own, rate, bend, turned = (
        np.moveaxis(np.abs(x), 0, -1) for x in (inverse, rate @ inverse, bend @ inverse, inverse @ coriolis @ inverse)
    )
    changed = np.max(np.abs(inverse) @ _stacked(np.sum(np.abs(bent), axis=1)), axis=1)
    return Carried(phi=(own, rate, bend), nu=(own, turned), gamma=(own,), bend=changed.T)


def slopes(system: System, q: Any, qd: Any, qdd: Any, t: Any) -> tuple[Any, Any, Any, Any]:
    """Return J with a complex step in each coordinate, (m, n, n, T), and S, T and C, (T, m, n) each.

    Parameters
    ----------
    system, q, qd, qdd, t
        As for `carried`.
    """
    z, n = _stepped(q), len(q)
    slope = system.phi_q(z, t)
    bent, still = np.imag(slope) / STEP, np.zeros_like(z)
    # One call for both derivatives of gamma, to q and to qd: what a call costs is not its numbers.
    at, moving = (np.concatenate(x, axis=1) for x in ((z, q[:, None] + still), (qd[:, None] + still, _stepped(qd))))
    gamma = np.imag(system.gamma(at, moving, t)) / STEP
    second = _stacked(times(bent, qd[:, None]) - np.imag(system.nu(z, t)) / STEP)
    return slope, second, _stacked(times(bent, qdd[:, None]) - gamma[:, :n]), _stacked(gamma[:, n:])


def _inverse(slope: Any) -> Any:
    """Return J^-1 (T, n, m) of J (m, n, T), of a least-squares inverse where rows are redundant."""
    stacked = _stacked(slope)
    return np.linalg.inv(stacked) if len(slope) == len(slope[0]) else np.linalg.pinv(stacked)


def _stacked(matrices: Any) -> Any:
    """Return (m, n, T) as (T, m, n), of which products are taken sample by sample."""
    return np.ascontiguousarray(np.moveaxis(matrices, -1, 0))


def _stepped(x: Any) -> Any:
    """Return (n, n, T): x (n, T) with a complex step in each component, whose derivatives are exact to round-off."""
    return x[:, None] + 1j * STEP * np.eye(len(x))[:, :, None]


def _beyond_first(system: System, q: Any, left: Any, t: Any, within: Any) -> Any:
    """Return what residuals (m, T) make of the levels (3, n, T) beyond first order: see `Propagation.second_order`.

    Where they move a pose by more than `within` (T,) it is one of another assembly.
    """
    held = system.held_at(q)
    slope = held.phi_q(q, t)
    middle = _solved(held, np.moveaxis(_inverse(slope), 0, -1), q, 0.0 * left, t)
    more = np.zeros((3, *q.shape))
    for alike, at, inverse, residual in _along_directions(system, slope, q, t, left):
        held = system.held_at(alike)
        linear = np.imag(_rated(held, alike + 1j * STEP * times(inverse, residual), at)) / STEP
        ends = (_solved(held, inverse, alike, residual, at), _solved(held, inverse, alike, -residual, at))
        first, second = (end.reshape(3, len(q), -1, len(t)) - middle[:, :, None] for end in ends)
        linear = linear.reshape(first.shape)
        near = np.maximum(*(np.max(np.abs(off[0]), axis=0) for off in (first, second))) <= within
        off = np.maximum(np.abs(first - linear), np.abs(second + linear))
        more = np.fmax(more, np.fmax.reduce(np.where(near, off, 0.0), axis=2))
    return more


def _along_directions(system: System, slope: Any, q: Any, t: Any, left: Any) -> Iterator[tuple[Any, Any, Any, Any]]:
    """Yield poses, times, J^-1 and residuals `left` (m, T) along some of the directions, all of these at once."""
    inverse, directions = np.moveaxis(_inverse(slope), 0, -1), _directions(system, slope)
    for signs in np.array_split(directions, min(1 + directions.size * len(q) // AT_ONCE, len(directions))):
        residual = np.moveaxis(signs * left, 0, 1).reshape(len(left), -1)
        yield *(np.tile(x, len(signs)) for x in (q, t, inverse)), residual


def _directions(system: System, slope: Any) -> Any:
    """Return the signs of the left singular vectors of J (m, n, T), part by part, all parts at once, (K, m, T)."""
    parts = list(parts_of(system))
    signs = np.zeros((max(len(own) for _, own in parts), len(slope), slope.shape[-1]))
    for rows, own in parts:
        signs[: len(own), rows] = np.sign(np.linalg.svd(_stacked(slope[np.ix_(rows, own)]))[0].T[: len(own)])
    return signs


def _solved(system: System, inverse: Any, q: Any, left: Any, t: Any) -> Any:
    """Return the levels (3, n, T) that leave so much (m, T) of the position's residual, with J^-1 (n, m, T) at q."""
    for _ in range(CORRECTIONS):
        q = q - times(inverse, system.phi(q, t) - left)
    return _rated(system, q, t)


def _rated(system: System, q: Any, t: Any) -> Any:
    """Return the levels (3, n, T) of poses (n, T), their rates as the system's equations have them there."""
    slope = system.phi_q(q, t)
    qd = solve_linear(slope, system.nu(q, t))
    return np.array([q, qd, solve_linear(slope, system.gamma(q, qd, t))])


def _first_order(system: System, inverse: Any, dq: Any, q: Any, t: Any) -> Any:
    """Return per sample whether dq changes J by less than a tenth of itself, so that first order says enough."""
    change = np.imag(system.phi_q(q + 1j * STEP * dq, t)) / STEP
    return np.max(times(inverse, np.sum(np.abs(change), axis=1)), axis=0) < TENTH
