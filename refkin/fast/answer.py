"""From coordinates of every sample to a `Motion`, checked by the formulas a person reads.

Nothing here trusts the program. Residuals come from the formulas, singular values from `System`, certificates from a
program of their own, or from `refkin.proof`; the pose and the rates are what they are asked about.

Where there are more rows than coordinates, all are asked about the answer. The program solves rows that are independent
at the first pose. At a later one they may be nearly dependent, where all rows together are not: the smallest singular
value of those of a Bennett linkage fell from 0.14 to 0.006, that of all stayed at 0.26. What the solution has lost then
lies where its own rows hardly see it, and the others do.
"""

from __future__ import annotations

from functools import partial
from typing import Any

import numpy as np

from refkin.analysis import acceleration, motion_of, slow_enough, velocity
from refkin.fast.certify import radii
from refkin.fast.compiled import Compiled
from refkin.fast.elimination.blocks import LARGEST_SELECTED
from refkin.fast.prepare import Prepared
from refkin.fast.residual import residual
from refkin.joints import Unit
from refkin.joints.elements import Triple
from refkin.joints.spatial_frames import unit_vector
from refkin.joints.spatial_vectors import Quaternion, SpatialValues, Vec3
from refkin.model import Evidence
from refkin.motion import SINGULAR, CertifiedRadius, Motion, Producer, Route, Seeding, Status, nowhere
from refkin.newton import ROUND_OFF, is_round_off
from refkin.proof.numbers.bounded import product
from refkin.proof.numbers.inputs import coordinates_have_digits, half_ulp
from refkin.proof.numbers.symbols import passive_of
from refkin.proof.pose.choices import isolate_every_choice
from refkin.proof.pose.isolate import FLOAT64, are_sharp
from refkin.system import System

ROUTE = Route(
    name="program",
    residual_by="refkin",
    jacobian_by="refkin",
    newton_by="refkin.fast",
    linear_solve_by="refkin.fast",
    drift_by="refkin",
    seeding=Seeding.INITIAL_GUESS,
)
MANY = 100
"""Times from which on the proof of a block too large to be solved by selecting is worth its seconds of compiling."""
CLEAR = 1e-3
"""Above this pivot a block is far from singular, and no singular values are asked for.

A pivot is within a factor of a few of the block's smallest singular value, SINGULAR is 1.2e-7, and the rest of phi_q is
triangular with ones in its diagonal.
"""


def motion(ready: Prepared, levels: list[Any], pivot: Any, message: str = "") -> Motion | None:
    """Return the motion if every sample is beyond doubt, else None.

    Parameters
    ----------
    ready : Prepared
        What was solved, at T times.
    levels : list of (n, T) array
        Coordinates and rates as far as they are called for, in the system's scaled coordinates.
    pivot : (T,) array
        The smallest pivot of each sample.
    message : str
        What the motion says.
    """
    scene, system, t = ready.scene, ready.system, ready.t
    corrected = by_all_rows(system, levels, t) if system.m > system.n else levels
    if corrected is None:
        return None
    levels, off = corrected, residual(ready.checked, corrected[0], t)
    closed = (off <= ROUND_OFF).all() or is_round_off(off[None], levels[0]).all()
    if not closed or not slow_enough(levels[1:]):
        return None
    near = np.flatnonzero(~(pivot > CLEAR))
    levels = without_spin(system, _by_pivots(system, levels, t, near))
    evidence = _evidence(ready, levels, near)
    if evidence is None:
        return None
    sigma_min, condition, radius, covered = evidence
    less = f"not asked {ready.dropped}" if ready.dropped else ""
    return motion_of(
        system,
        scene,
        t.copy(),
        [*levels, None, None][:3],
        status=(Status.OK,) * len(t),
        residual=off,
        sigma_min=sigma_min,
        condition=condition,
        certified_radius=radius,
        producer=Producer.of_refkin("refkin.fast", ROUTE),
        message="; ".join(filter(None, (message, *(p.constraint.passive for p in system.placed), covered, less))),
    )


def _by_pivots(system: System, levels: list[Any], t: Any, near: Any) -> list[Any]:
    """Return the levels with rates of the samples near a singular pose by elimination with pivots.

    Cramer's rule is forward stable alone: what it leaves of the rows is larger than rounding by the condition, and so
    is the error of rates that do not feel the singular pose at all.
    """
    if near.size and len(levels) > 1:
        q, now, here = levels[0][:, near], t[near], system.held_at(levels[0][:, near])
        levels[1][:, near] = velocity(here, q, now)
        if len(levels) > 2:
            levels[2][:, near] = acceleration(here, q, levels[1][:, near], now)
    return levels


def without_spin(system: System, levels: list[Any]) -> list[Any]:
    """Return the levels (n, L) with rates of which passive bodies do not spin: the program holds them as estimated."""
    q, *rates = levels
    names = [body.name for body in system.mechanism.bodies]
    for _, p in passive_of(system) if rates else ():
        held: Any = p.constraint
        lines, spin = [(p.g[4:7], p.g[7:]), *map(partial(_line, system.unit), held.others)], None
        for body, line in zip((held.body, *(body for body, _ in held.others)), lines, strict=True):
            start = system.kind.width * names.index(body)
            at = slice(start, start + system.kind.width)
            own, spin = _still(line, q[at], [level[at] for level in rates], spin)
            for level, still in zip(rates, own, strict=False):
                level[at] = still
    return levels


def _line(unit: Unit, other: tuple[str, tuple[Triple, Triple]]) -> tuple[Any, Any]:
    """Return the direction of a line in a body, and a point of it in the unit."""
    body, (through, line) = other
    return unit_vector(line).parts, unit.point(body, through)


def _still(line: Any, q: Any, rates: Any, spin: Any = None) -> tuple[tuple[Any, ...], tuple[Any, Any]]:
    """Return the rates (7, B) of a body that does not spin about a line, and the spin (chi', chi'' / 2) taken from it.

    Its points on the line move as they are given. With p turned by chi about the line, p (cos chi/2, u sin chi/2), chi'
    and chi'' are such that s . p' = s . p'' = 0, s = p0 (0, u); or as another body's, that spins as one with it.
    """
    u, through = Quaternion(0, Vec3(*line[0])), line[1]
    given, still = (SpatialValues(*q).moving(*rates[0]) for _ in range(2))
    s, p, pd = given.p.times(u), given.p, given.pd
    rate = s.dot(pd) * -2 if spin is None else spin[0]
    still.pd = pd + s * (rate * 0.5)
    arm, arm_still = given.arm(*through), still.arm(*through)
    velocity = np.array((*(given.v + arm.rate - arm_still.rate).parts, *still.pd.parts))
    if len(rates) == 1:
        return (velocity,), (rate, 0.0)
    qdd = rates[1]
    pdd = Quaternion.of(*qdd[3:])
    on = pdd + pd.times(u) * rate + p * (rate * rate * -0.25)
    bend = -s.dot(on) if spin is None else spin[1]
    on = on + s * bend
    acceleration = Vec3(*qdd[:3]) + arm.along(pdd) + arm.drift - arm_still.along(on) - arm_still.drift
    return (velocity, np.array((*acceleration.parts, *on.parts))), (rate, bend)


def _evidence(ready: Prepared, levels: list[Any], near: Any) -> tuple[Any, Any, CertifiedRadius | None, str] | None:
    """Return smallest singular value, condition, certified radii, what these cover; None if a pose fails, or may."""
    system, t = ready.system, ready.t
    asked, proved = (evidence in ready.scene.evidence for evidence in (Evidence.CONDITION, Evidence.CERTIFICATE))
    sigma_min, condition = nowhere(len(t)), nowhere(len(t))
    if proved and near.size:
        return None  # there the reference also proves that the branch was never changed
    if not proved and not (ready.laws_have_digits and coordinates_have_digits(levels[0]).all()):
        return None
    if asked or near.size:
        at = np.arange(len(t)) if asked else near
        here = system.held_at(levels[0][:, at])
        slope = np.moveaxis(here.phi_q(levels[0][:, at], t[at]), -1, 0)
        sigma = np.linalg.svd(slope, compute_uv=False)
        smallest = sigma[:, system.n - 1]
        if not proved and not (smallest > SINGULAR).all():
            return None
        if asked:
            with np.errstate(divide="ignore"):
                sigma_min, condition = smallest, sigma[:, 0] / smallest
    if proved:
        certified = _certified(system, ready.made, levels, t)
        return None if certified is None else (sigma_min, condition, *certified)
    return sigma_min, condition, None, ""


def _certified(system: System, made: Compiled, levels: list[Any], t: Any) -> tuple[CertifiedRadius, str] | None:
    """Return certified radii, and what they cover if not all choices of rows; None if float64 proves too little.

    They are those of the program of the proof, else of the dense one.
    """
    absent, why = nowhere(len(t)), ""
    worth = len(t) >= MANY or max(map(len, made.program.blocks), default=0) <= LARGEST_SELECTED
    bounds = radii(system, made, levels, t) if system.m == system.n and worth else None
    if bounds is not None and are_sharp(bounds, levels).all():
        position, *rates = (*bounds, absent, absent)[:3]
    else:
        dense = isolate_every_choice(system, levels[0], t, *levels[1:])
        if not dense.ok.all() or (dense.bits > FLOAT64).any() or (dense.contradiction > 1.0).any():
            return None  # what only balls can enclose is answered from there
        position, rates, why = dense.position, [dense.velocity, dense.acceleration], dense.why
    if any(system.unit.origin):  # moving a pose back to where the scene has it rounds once more
        position = position + np.max(half_ulp(system, levels[0]), axis=0)
    return CertifiedRadius(position=position, velocity=rates[0], acceleration=rates[1]), why


def by_all_rows(system: System, levels: list[Any], t: Any) -> list[Any] | None:
    """Return the levels, corrected by all rows in the samples that leave some open; None if these contradict others.

    Rows that contradict each other in a rate lock a pose that they share: the program, which sees some of them, moves.

    Parameters
    ----------
    system : System
    levels : list of (n, T) array
        Coordinates and rates as far as they are called for, in the system's scaled coordinates.
    t : (T,) array
        Times [s].
    """
    with np.errstate(over="ignore", invalid="ignore"):
        lost = np.flatnonzero(~_closed(system, levels, t))
        if not lost.size:
            return levels
        try:
            corrected = _corrected(system, [level[:, lost] for level in levels], t[lost])
        except np.linalg.LinAlgError:  # where numbers are not finite
            return None
        if not _closed(system, corrected, t[lost]).all():
            return None
    for level, better in zip(levels, corrected, strict=True):
        level[:, lost] = better
    return levels


def _closed(system: System, levels: list[Any], t: Any) -> Any:
    """Return in which samples all rows are closed but for rounding, on all levels, (T,)."""
    q, *rates = levels
    here = system.held_at(q)
    closed, slope = is_round_off(here.phi(q, t), q), here.phi_q(q, t) if rates else None
    for order, rate in enumerate(rates, start=1):
        right = _right_side(here, levels[:order], t)
        closed &= _largest(product(slope, rate) - right) <= ROUND_OFF * np.maximum(_largest(rate), _largest(right))
    return closed


def _corrected(system: System, levels: list[Any], t: Any) -> list[Any]:
    """Return the levels after a step of least squares: one inverse serves for all, as what was lost is small."""
    q, *rates = levels
    here = system.held_at(q)
    inverse = np.moveaxis(np.linalg.pinv(np.moveaxis(here.phi_q(q, t), -1, 0)), 0, -1)
    better = [q - product(inverse, here.phi(q, t))]
    here = system.held_at(better[0])
    slope = here.phi_q(better[0], t)
    for rate in rates:
        off = product(slope, rate) - _right_side(here, better, t)
        better.append(rate - product(inverse, off))
    return better


def _right_side(system: System, levels: list[Any], t: Any) -> Any:
    """Return what the rates after these levels solve: nu at a pose, gamma at a pose and its velocity."""
    return system.nu(levels[0], t) if len(levels) == 1 else system.gamma(levels[0], levels[1], t)


def _largest(rows: Any) -> Any:
    return np.max(np.abs(rows), axis=0)
