"""What rounding leaves: of the rows of each level, of tables, of solving for rates, and of answers that are composed.

Of rows it is the running-error bound of the formulas (`running_error`) with coordinates that are rounded to u |q|: no
float64 code is told more. `SAFETY` covers that an engine evaluates the same closure by other formulas: in space
(products of three terms instead of two) and down a chain of frames (each pose composed of two before it), which is at
most 2 * 2 times the operations. Velocity and acceleration are solutions of linear systems: LU adds a backward error, a
residual whose two-norm is n u of the largest row of |J| |x| (`solve_error`). That and all else of which only the
largest counts is of each part of the mechanism by itself (`parts`). What it does to an answer is `budget`.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import partial
from typing import Any

import numpy as np

from crosscheck.judge.parts import Parts, by_part, chains_of, links_of, parts_of
from crosscheck.judge.running_error import Running, U, off_by, parts, running
from refkin.joints.spatial_drivers import TurnDriver
from refkin.motion_laws import Table
from refkin.proof.numbers.bounded import Times, bounded_system
from refkin.system import System

SAFETY = 4.0
SOME, UNEVEN = 32.0, 4.0
"""Of a spline and its derivatives, where no step is more than so many times another: two roundings of a difference, a
factor 3 for the solve, 4 terms of the cubic, rounded up. The worst tables that were searched for have 3.4, 3.4 and 8.1
times as much in value and derivatives; the whole budget was seen to bear the last."""


def residual_error(system: System, q: Any, t: Any) -> Any:
    """Return what the formulas leave of the residual (m, T) at rounded coordinates, tables aside.

    Parameters
    ----------
    system : System
    q : (n, T) array
        Poses, in the system's coordinates.
    t : (T,) array
        Times [s].
    """
    return SAFETY * parts(system.phi(running(q, U * np.abs(q)), Running(t)), t.shape)[1]


@dataclass(frozen=True)
class RateRows:
    """Of the rows of a level of rates, (m, T) each: the right side, and what rates leave of it.

    `error` is what rounding leaves at most, tables' as well; `size` is what stands in the rows.
    """

    right: Any
    left: Any
    error: Any
    size: Any


def rate_rows(system: System, q: Any, qd: Any, qdd: Any, t: Any, lost: Any = (0.0, 0.0)) -> tuple[RateRows, RateRows]:
    """Return the rows of velocity and of acceleration at coordinates and rates.

    Parameters
    ----------
    system : System
    q, qd, qdd : (n, T) array
        In the system's coordinates.
    t : (T,) array
        Times [s].
    lost : pair of (n, T) arrays
        By how much q and qd are rounded; qd in what is left of the velocity itself is not.
    """
    clock, at = Running(t), running(q, lost[0])  # so that laws' own rounding counts
    slope = parts(system.phi_q(at, clock), t.shape)
    nu, gamma = (parts(x, t.shape) for x in (system.nu(at, clock), system.gamma(at, running(qd, lost[1]), clock)))
    rows, exactly = [], Times(t, 2)
    for order, (rate, right) in enumerate(((qd, nu), (qdd, gamma)), 1):
        left, error = off_by(slope, rate, right)
        size = times(np.abs(slope[0]), np.abs(rate)) + (order == 2) * np.abs(right[0])
        rows.append(RateRows(right[0], left, SAFETY * error + table_error(system, exactly, order), size))
    return rows[0], rows[1]


def times(matrix: Any, vector: Any) -> Any:
    """Return the product sample by sample of (m, n, T) and (n, T), or with more axes than one for the samples."""
    return np.einsum("mn...,n...->m...", matrix, vector)


def largest(values: Any) -> Any:
    """Return the largest magnitude (T,) of some rows (K, T)."""
    return np.max(np.abs(values), axis=0)


def solve_error(size: Any) -> Any:
    """Return the two-norm (T,) of LU's backward error, as a residual, where |J| |x| is `size`: n u of its largest row.

    The worst case is n u in every row, with all signs alike. Rounding errors add up like a random walk: to some root of
    n in every row, which is n for all rows together (Higham and Mary, SIAM J. Sci. Comput. 41, 2019).
    """
    return len(size) * U * np.max(size, axis=0)


def elimination(size: Any, of: Any, to: Any) -> Any:
    """Return `solve_error` of each part, spread to some places; of a part that rests it is that of all together.

    No row of it says how its zeros are found. LU leaves them zero; QR, or least squares, turns all rows at once, and
    leaves in those of a bracket that is bolted down what it leaves in all.

    Parameters
    ----------
    size : (m, T) array
        What stands in the rows.
    of, to : array of int
        As for `by_part`.
    """
    own = by_part(solve_error, size, of, to)
    return np.where(own == 0.0, solve_error(size), own)


def table_error(system: System, clock: Times, order: int) -> Any:
    """Return what the rounding of splines leaves in the rows (m, T) of the residual, of nu or of gamma.

    A spline's slopes solve a diagonally dominant system whose right side are divided differences, each rounded by
    u max|y| / h: k-th derivatives err by `SOME` u max|y| / h^k, with the steps that are near (`_steepest`). Integrals
    to the knots add that up, each rounded as it is itself, like a random walk (`solve_error`). Where steps between
    arguments differ by more than `UNEVEN` times, the spline that engines are given is held against the exact one, too:
    an error is carried from step to step. Nowhere else, or a law that is wrong for everybody would be granted to
    everybody.

    Parameters
    ----------
    system : System
    clock : Times
        Times (T,) [s], with orders up to this one.
    order : int
        0 for the residual, 1 for nu, 2 for gamma.
    """
    out = np.zeros((system.m, len(clock.t)))
    for k, p in enumerate(system.placed):
        tables = [isinstance(getattr(law, "rate", law), Table) for law in p.constraint.laws]
        if not any(tables):
            continue
        given, factor = p.constraint.inputs(clock.t, system.unit, order), p.constraint.law_scale(system.unit)[1]
        for n, law in enumerate(p.constraint.laws):
            if tables[n]:
                off = _spline_error(law, order, clock.t) / factor
                table: Any = getattr(law, "rate", law)
                steps = np.diff(table.argument)
                if np.max(steps) > UNEVEN * np.min(steps):
                    bounded: Any = bounded_system(system).placed[k].constraint
                    high, low, rest = clock.values(bounded.exact, system.unit)[n][order]
                    off = off + 2 * (np.abs(given[n][order] - high - low) + rest)  # 2: it is carried to first order
                # A driver whose row is quadratic in its law (distance) has the law itself as a factor.
                out[p.row] += off * np.maximum(1.0, np.abs(given[n][0]))
    return out


def _spline_error(law: Any, order: int, t: Any) -> Any:
    """Return what rounding leaves (T,) of the derivative of a spline, or of an integral, as `table_error` has it."""
    table = getattr(law, "rate", law)
    size, steps = np.max(np.abs(table.value)), np.diff(table.argument)
    of_table = order if table is law else order - 1
    if of_table > 0:
        x, first = np.array(table.argument), table.argument[0]
        at = first + np.mod(t - first, x[-1] - first) if table.periodic else t
        pieces = [np.clip(x.searchsorted(at, side) - 1, 0, len(steps) - 1) for side in ("left", "right")]
        off = _steepest(steps, table.periodic) / steps ** (of_table - 1)
        return SOME * U * size * np.minimum(np.max(off[np.array(pieces)], axis=0), np.min(steps) ** -of_table)
    if of_table == 0:
        return np.full(len(t), SOME * U * size)
    areas = np.abs(law(np.array(table.argument)) - law.initial)
    return np.full(len(t), SOME * U * size * np.linalg.norm(steps) + U * np.linalg.norm(areas))


def _steepest(steps: Any, periodic: bool) -> Any:
    """Return what an error of 1 in every value of a spline does, at most, to the slopes at the ends of each step.

    The system for the slopes has in each row 2 on the diagonal and 1 beside it. So an error of a row is in no slope
    larger than in its own, and r knots on at most 2^-r of it, whatever the steps are (about 3.7^-r where they are
    even). At ends that are not periodic the first two steps are one cubic: what is off at its middle knot is off
    (h0 + h1) / h1 times as much at its end.
    """
    count = len(steps)
    if count < 3:
        return np.full(count, 1.0 / np.min(steps))
    k = np.arange(count)
    apart = np.abs(k[:, None] - k)
    if periodic:
        apart = np.minimum(apart, count - apart)
    else:
        apart[[0, -1]] = apart[[1, -2]]
    slopes = np.minimum(np.sum(0.5 ** np.maximum(apart - 1, 0) / steps, axis=1), 1.0 / np.min(steps))
    if not periodic:
        slopes[[0, -1]] *= 1.0 + steps[[0, -1]] / steps[[1, -2]]
    return slopes


def output_rounding(system: System, q: Any, qd: Any, qdd: Any, t: Any) -> tuple[Any, Any, Any]:
    """Return the rounding of coordinates and rates that are composed of others, in metres and back.

    A pose at the end of a chain is a sum of arms of one size, one per body or massless link, each turned by an angle
    that is rounded, and of the angles of the others; where frames are far from their joints, of what leads there and
    back. So are its rates, of omega r, and of alpha r and omega v, also where the sum is small: v is large where a
    frame is far from its joints, and nothing is v squared. All are of one chain (`parts`): a motor rounds nothing of
    what its gears drive slowly; but omega, which is itself rounded, is also that of what a body rolls on, where both
    have the velocity of their contact. In metres a pose is rounded relative to its distance from the scene's origin,
    which is not ours.

    Parameters
    ----------
    system : System
    q, qd, qdd : (n, T) array
        The solution, in the system's coordinates.
    t : (T,) array
        Times [s].
    """
    place, metres = chains_of(system), np.abs(system.to_physical(q))
    own, links = place.coordinates, links_of(system, place)
    size = np.where(system.turns[:, None] == 0.0, system.unit.size, 1.0)
    arms = np.bincount(own[: system.of_bodies])[own][:, None] // system.kind.width + links[own][:, None]
    away = by_part(partial(np.sum, axis=0), _away(system), own[: system.of_bodies], own) / system.kind.width
    spread: Any = partial(by_part, largest, of=own, to=own)
    turned, rate, bend = spread(metres * system.angles[:, None]), spread(qd), spread(qdd)
    arms = np.maximum(arms, np.maximum(turned, _driven(system, place, t)))
    roundings = 6 * U  # cosine or sine, product and sum for each arm, on both sides of a comparison
    part = parts_of(system).coordinates
    omega = by_part(largest, qd * (system.turns[:, None] != 0.0), part, part)
    bend = bend + (omega + roundings * arms * rate) * rate
    placed = np.maximum(np.maximum(arms, away), metres / size)
    return roundings * placed, roundings * arms * rate, roundings * arms * bend


def _away(system: System) -> Any:
    """Return how far each body's frame is from its nearest joint, in sizes, for each of its coordinates (n, 1 or T)."""
    points: dict[str, Any] = {body.name: [] for body in system.mechanism.bodies}
    for body, point in (end for c in system.mechanism.constraints for end in c.points() if end[0] in points):
        points[body].append(np.linalg.norm(point, axis=0))
    away = np.array([min(own, default=0.0) for own in points.values()])
    return np.repeat(away[:, None] / system.unit.size, system.kind.width, axis=0)


def _driven(system: System, place: Parts, t: Any) -> Any:
    """Return how far [rad] drivers turn joints of each chain of space (n, T): no coordinate of a body tells.

    Who works in the angles of joints has other joints turn as far, and rounds that.
    """
    driven = np.zeros((system.n, len(t)))
    for p in (p for p in system.placed if isinstance(p.constraint, TurnDriver)):
        ((angle,),) = p.constraint.inputs(t, system.unit, 0)
        driven = np.maximum(driven, (place.coordinates == place.rows[p.row])[:, None] * np.abs(angle))
    return driven
