"""What rounding of a mechanism's numbers does: the error no float64 code can avoid, and rows that contradict."""

from __future__ import annotations

from typing import Any

import numpy as np

from refkin.motion import SINGULAR
from refkin.motion_laws import Integral, Law, Polynomial, Sinusoid, Table
from refkin.proof.numbers.bounded import UP, InputError, Times, U, bounded_system, box, product, read
from refkin.proof.numbers.preconditioned import Nearly, Preconditioned, left_out, of_rows, read_rows
from refkin.system import System

HALF_ULP = InputError(U)
"""What one rounding leaves of a number."""
A_FEW_ROUNDINGS = InputError(2.0**-50, least=1.0)
"""Eight half-ulps of a number, at least of the size: what is left of one that was computed before it was written."""


def has_digits(system: System, q: Any, t: Any) -> Any:
    """Return at which poses (n, B) rounding of coordinates and laws is too little to be asked about, (B,).

    Parameters
    ----------
    system : System
    q : (n, B) array
        Poses, in the system's coordinates.
    t : (B,) array
        Times [s].
    """
    return coordinates_have_digits(q) & laws_have_digits(system, t)


def coordinates_have_digits(q: Any) -> Any:
    """Return at which poses (n, B) rounding of coordinates is too little to be asked about, (B,)."""
    return U * np.max(np.abs(q), axis=0) <= SINGULAR


def laws_have_digits(system: System, t: Any) -> Any:
    """Return at which times rounding of the laws is too little to be asked about.

    A law may be small where what it adds up is large: then its value has no more digits than that.
    """
    largest = 0.0 * np.asarray(t, float)
    for constraint in (p.constraint for p in system.placed if p.constraint.laws):
        _, factor = constraint.law_scale(system.unit)
        for law in constraint.laws:
            largest = np.maximum(largest, _added_up(law, np.abs(t)) / factor)
    return U * largest <= SINGULAR


def _added_up(law: Law, t: Any) -> Any:
    """Return about how large the numbers are that a law adds up within times t (B,), none below 0."""
    if isinstance(law, Integral):
        return abs(law.initial) + t * _added_up(law.rate, t)
    if isinstance(law, Sinusoid):
        return abs(law.offset) + abs(law.amplitude) * (1.0 + abs(law.angular_frequency) * t + abs(law.phase))
    if isinstance(law, Polynomial):
        return Polynomial(coefficients=tuple(map(abs, law.coefficients)))(t)
    assert isinstance(law, Table)
    return max(map(abs, law.value)) + 0.0 * t


def half_ulp(system: System, q: Any, order: int = 0) -> Any:
    """Return half an ulp of coordinates (n, B) as they are in metres and radians, in the system's coordinates.

    It is also the most that `System.to_physical` adds to the error of an answer.

    Parameters
    ----------
    system : System
    q : (n, B) array
        Coordinates, or rates, in the system's coordinates.
    order : int
        0 for coordinates, 1 or 2 for their rates.
    """
    spacing = np.spacing(np.abs(system.to_physical(q, order))) / 2
    # Rates know no origin: lengths are divided by the size, angles stay.
    return spacing / system.to_physical(np.ones_like(spacing), order=1)


def output_rounding(system: System, q: Any) -> Any:
    """Return what `System.to_physical` adds to the error of coordinates (n, B), in the system's coordinates.

    Half an ulp where an origin is added; the size is a power of two, and angles stay.
    """
    origin = np.zeros(system.kind.width)
    origin[: len(system.unit.origin)] = system.unit.origin
    moved = np.zeros(system.n, bool)
    moved[: system.of_bodies] = np.tile(origin != 0.0, len(system.mechanism.bodies))
    return np.where(moved[:, None], half_ulp(system, q), 0.0)


def input_effect(system: System, q: Any, t: Any, error: InputError) -> Any:
    """Return how far an error of every geometric number, time and law value moves phi, (m, B).

    Parameters
    ----------
    system : System
    q : (n, B) array
        Poses, in the system's coordinates.
    t : (B,) array
        Their times [s].
    error : InputError
        How far each number may be off, by its size.
    """
    return read(bounded_system(system.held_at(q), error=error).phi(box(q), Times(t, 1)), np.shape(q)[1]).spread


def contradiction(system: System, rows: Any, root: Nearly, t: Any) -> Any:
    """Return the largest |phi| of the rows that were left out, at the root, in units of what explains it, (B,).

    Up to 1 the rows are consistent. What explains it: rounding, and `A_FEW_ROUNDINGS` of the mechanism's numbers, in
    these rows and, through the pose, in the rows that were solved. 0 if no row was left out.

    Parameters
    ----------
    system : System
    rows : (n,) or (n, B) array of int
        The rows that were solved.
    root : Nearly
        Their root, (n, B), as narrowly as it is known.
    t : (B,) array
        Times [s].
    """
    others, batch = left_out(rows, system.m), np.shape(root.given)[1]
    if not others.size:
        return np.zeros(batch)
    with np.errstate(all="ignore"):
        pose = Preconditioned(system, rows, root.given, t, 0)
        phi = read_rows(pose.sharp.phi(root.box(), pose.times), others, batch)
        slope = read_rows(pose.system.phi_q(box(pose.q), pose.times), others, batch)
        inputs = input_effect(system, pose.q, t, A_FEW_ROUNDINGS)
        moved = product(np.abs(slope.mid), product(pose.size, of_rows(inputs, rows))) + of_rows(inputs, others)
        return np.max(np.abs(phi.mid) / (UP * (phi.rounding + phi.spread + moved)), axis=0)


def rate_contradiction(system: System, rows: Any, q: Any, t: Any, acceleration: bool) -> Any:
    """Return the largest part of velocity, and of acceleration, that left-out rows contradict, (2, B), in such units.

    A pose that all rows share says nothing of the next one: rows that contradict each other there do so here in
    phi_q qd = nu, or in phi_q qdd = gamma. Rates are those of the rows (n,) that were solved. What explains a left-out
    row that is off by more than 0: its spread over what the pose may be off by and, by the rates, that of the solved.

    Parameters
    ----------
    system : System
    rows : (n,) or (n, B) array of int
        The rows that were solved.
    q : (n, B) array
        Poses, in the system's coordinates.
    t : (B,) array
        Their times [s].
    acceleration : bool
        Whether accelerations are asked for; if not, their part is 0.
    """
    others, batch = left_out(rows, system.m), np.shape(q)[1]
    excess = np.zeros((2, batch))
    if not others.size:
        return excess
    with np.errstate(all="ignore"):
        pose, times = Preconditioned(system, rows, q, t, 0), Times(t, 3 if acceleration else 2)
        rough = bounded_system(system.held_at(q), error=A_FEW_ROUNDINGS)
        near = product(pose.size, of_rows(input_effect(system, q, t, A_FEW_ROUNDINGS), rows)) + half_ulp(system, q)
        slope = read(rough.phi_q(box(q, near), times), batch)
        at, rate, radii = box(q, near), np.zeros_like(q), np.zeros_like(q)
        for order in range(2 if acceleration else 1):
            right = read(rough.gamma(at, box(rate, radii), times) if order else rough.nu(at, times), batch)
            rate = product(pose.inverse, of_rows(right.mid, rows))
            size = product(np.abs(slope.mid), np.abs(rate)) + np.abs(right.mid)
            spread = product(slope.spread + slope.rounding, np.abs(rate)) + right.spread + right.rounding
            spread += system.n * pose.dot * size  # of the inverse and of the products here
            off = np.abs(product(slope.mid, rate) - right.mid)
            # Bodies at rest have rates that are nothing but what the inverse left: the solved rows say how much.
            radii = product(pose.size, of_rows(spread + off, rows))
            ratio = np.where(off == 0.0, 0.0, off / (UP * (spread + product(np.abs(slope.mid), radii))))
            excess[order] = np.max(of_rows(ratio, others), axis=0)
    return excess
