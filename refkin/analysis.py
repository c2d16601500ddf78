"""Kinematic analysis: position, velocity and acceleration, at one time and over the times of a scene.

============ ====================== ====================================
position     phi(q, t) = 0 (K2)     by Newton's method from an estimate
velocity     phi_q qd = nu (K3)     linear in qd
acceleration phi_q qdd = gamma (K4) linear in qdd
============ ====================== ====================================

`sweep` solves a scene so, from one time to the next, and calls a pose `ok` by two numbers: its residual is what
rounding leaves, and the smallest singular value of phi_q is well above zero. Nothing is proved, and nothing is seen of
what happens between two times: for that there is `refkin.solve`. (Haug, Computer Aided Kinematics and Dynamics, 4;
Nikravesh, Computer-Aided Analysis of Mechanical Systems, 3 and 4.)
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from typing import Any

import numpy as np

from refkin.differences import EPS
from refkin.errors import expect
from refkin.joints import initial_contacts
from refkin.joints.annotations import Named, numbers
from refkin.model import Effect, Evidence, Scene
from refkin.motion import (
    SINGULAR,
    CertifiedRadius,
    ContactMotion,
    Motion,
    Producer,
    Route,
    Seeding,
    Status,
    no_radius,
    nowhere,
    point_motion,
)
from refkin.newton import TINY, NewtonResult, contracts, is_round_off, newton, solve_linear
from refkin.system import System, compile_system

NEAR, FURTHEST, REACH, MOST_STEPS = 1 / 4, 1.0, 1 / 4, 5000
"""How far a step may end from its prediction, as a part of its move; how far it may move, and how far onto a singular
pose, in units of length or rad; how many steps there may be from one time to the next."""
FASTEST = 1e140
"""The largest velocity of a pose that is ok [sizes or rad, per s], and the root of the largest acceleration: a point is
moved by their squares, which must be numbers."""
OWN = {"residual_by": "refkin", "jacobian_by": "refkin", "newton_by": "refkin", "drift_by": "refkin"}
ROUTE = Route(name="newton", linear_solve_by="LAPACK", seeding=Seeding.INITIAL_GUESS, **OWN)


def position(system: System, q0: Any, t: float, **options: Any) -> NewtonResult:
    """Solve phi(q, t) = 0 from an estimate.

    Parameters
    ----------
    system : System
    q0 : (n,) array
        The estimate, in the system's coordinates.
    t : float
        Time [s].
    **options
        Those of `newton`.
    """
    expect("system", system, System)
    q0 = numbers("q0", q0, f"{system.n} coordinates", (system.n,))
    t = t if isinstance(t, float) else numbers("t", t, "a time [s]", ())[()]
    return newton(lambda q: system.phi(q, t), lambda q: system.phi_q(q, t), q0, **options)


def velocity(system: System, q: Any, t: Any, phi_q: Any = None) -> Any:
    """Return qd with phi_q qd = nu, in the shape of q.

    Parameters
    ----------
    system : System
    q : (n,) or (n, B) array
        A pose, or a batch of them.
    t : float or (B,) array
        Time [s].
    phi_q : (m, n) or (m, n, B) array, optional
        The Jacobian there, if it is known already.
    """
    q, t, phi_q = _given(system, q, t, phi_q)
    return solve_linear(system.phi_q(q, t) if phi_q is None else phi_q, system.nu(q, t))


def acceleration(system: System, q: Any, qd: Any, t: Any, phi_q: Any = None) -> Any:
    """Return qdd with phi_q qdd = gamma, in the shape of q.

    Parameters
    ----------
    system, t, phi_q
        As for `velocity`.
    q, qd : (n,) or (n, B) array
        A pose and its velocity, or a batch of them.
    """
    q, t, phi_q = _given(system, q, t, phi_q)
    qd = numbers("qd", qd, "velocities in the shape of q", q.shape)
    return solve_linear(system.phi_q(q, t) if phi_q is None else phi_q, system.gamma(q, qd, t))


def _given(system: System, q: Any, t: Any, phi_q: Any) -> tuple[Any, Any, Any]:
    """Return q, t and phi_q, where it is known, as numbers of shapes that go together; a number t stays one."""
    expect("system", system, System)
    q = numbers("q", q, f"{system.n} coordinates", (system.n,), (system.n, None))
    t = t if isinstance(t, float) else numbers("t", t, "a time [s], or one for each pose", (), q.shape[1:])[()]
    if phi_q is not None:
        phi_q = numbers("phi_q", phi_q, "the Jacobian of each pose", (system.m, system.n, *q.shape[1:]))
    return q, t, phi_q


def sigma_min(phi_q: Any) -> float:
    """Return the n-th singular value of phi_q (m, n), which is 0 where a pose is not isolated to first order."""
    return float(np.linalg.svd(phi_q, compute_uv=False)[phi_q.shape[1] - 1])


def slow_enough(rates: Sequence[Any], axis: int | None = None) -> Any:
    """Return whether velocities and accelerations (n, T), as far as there are any, are none too large; by `axis`."""
    return np.logical_and.reduce([np.abs(x).max(axis, initial=0.0) <= FASTEST**k for k, x in enumerate(rates, 1)])


def sweep(scene: Scene) -> Motion:
    """Return the motion of a scene: from its estimates to the first pose, then from one time to the next.

    A time is `ok` if its residual is round-off and sigma_min above `SINGULAR`, whatever the laws do between two times;
    `singular` if only sigma_min is too small; `not_converged` if there is no first pose, or rates are too large for
    numbers; `branch_lost` after the last.
    """
    expect("scene", scene, Scene)
    system, t = compile_system(scene.mechanism, unit=scene.mechanism.unit()), np.array(scene.times)
    first = position(system, estimate_of(system, scene), scene.times[0])
    q = march(system, first.q, scene.times) if first.converged else np.full((system.n, len(t)), np.nan)
    status = [Status.BRANCH_LOST if first.converged else Status.NOT_CONVERGED] * len(t)
    residual, sigma, condition = (np.full(len(t), np.nan) for _ in range(3))
    for k in np.flatnonzero(np.isfinite(q[0])):
        here = system.held_at(q[:, k])
        phi, values = here.phi(q[:, k], t[k]), np.linalg.svd(here.phi_q(q[:, k], t[k]), compute_uv=False)
        residual[k], sigma[k] = np.max(np.abs(phi)), values[system.n - 1]
        condition[k] = values[0] / sigma[k] if sigma[k] else np.inf
        closed = Status.OK if sigma[k] > SINGULAR else Status.SINGULAR
        status[k] = closed if is_round_off(phi, q[:, k]) else Status.NOT_CONVERGED
        if status[k] is not Status.OK:
            q[:, k + (status[k] is Status.SINGULAR) :] = np.nan
            break
    ok = np.array(status) == Status.OK
    system = system.held_at(q[:, ok])
    qd, qdd = np.full_like(q, np.nan), np.full_like(q, np.nan)
    with np.errstate(all="ignore"):
        qd[:, ok] = velocity(system, q[:, ok], t[ok])
        if Effect.ACCELERATION in scene.effects:
            qdd[:, ok] = acceleration(system, q[:, ok], qd[:, ok], t[ok])
    order = 2 if Effect.ACCELERATION in scene.effects else len(scene.effects)
    for k in np.flatnonzero(ok & ~slow_enough([qd, qdd][:order] or [q], axis=0))[:1]:
        status[k:] = [Status.NOT_CONVERGED, *[Status.BRANCH_LOST] * (len(t) - k - 1)]
        for level in (q, qd, qdd, residual, sigma, condition):
            level[..., k:] = np.nan
    evidence = {"residual": residual, "sigma_min": sigma, "condition": condition, "certified_radius": None}
    made = Producer.of_refkin("refkin.analysis", ROUTE)
    message = "" if first.converged else f"no pose was found at t = {t[0]:g}: {first.status}"
    return motion_of(system, scene, t, (q, qd, qdd), status=tuple(status), producer=made, message=message, **evidence)


def estimate_of(system: System, scene: Scene) -> Any:
    """Return the scene's estimates in the system's coordinates (n,), or 0; cams start where they may touch."""
    q = np.zeros(system.n)
    for body in scene.mechanism.bodies:
        q[system.columns(body.name)] = body.estimate or system.kind.still
    return initial_contacts(system, system.to_unit(q), scene.times[0])


def march(system: System, q: Any, times: Sequence[float]) -> Any:
    """Return the poses (n, T) on the branch of the first one; NaN from the first time that is not reached.

    Parameters
    ----------
    system : System
        In its mechanism's own unit, compiled for velocity.
    q : (n,) array
        The pose at the first time.
    times : sequence of float
        Increasing [s].
    """
    poses = np.full((system.n, len(times)), np.nan)
    poses[:, 0], goes_on = q, bool(sigma_min(system.held_at(q).phi_q(q, times[0])) > SINGULAR)
    for k in range(1, len(times)):
        if not goes_on:
            break
        poses[:, k], goes_on = _next(system.held_at(poses[:, k - 1]), poses[:, k - 1], times[k - 1], times[k])
    return poses


def _next(system: System, q: Any, t: float, target: float) -> tuple[Any, bool]:
    """Return the pose at a later time, in `MOST_STEPS` at most, and whether the branch goes on from it.

    A step is predicted along the velocity, and halved until Newton's method stays near the prediction.
    """
    h, left = target - t, MOST_STEPS
    while t < target and (left := left - 1):
        to = target if t + h >= target else t + h
        result = position(system, q + (to - t) * velocity(system, q, t), to)
        if _stays(system, q, t, result, to):
            q, t, h = result.q, to, 2 * h
        elif h > 4 * EPS * max(abs(t), abs(target), target - t):
            h /= 2
        else:
            break
    else:
        return (q, bool(sigma_min(system.phi_q(q, target)) > SINGULAR)) if left else (np.nan, False)
    result = position(system, q, target, max_iterations=60)  # to a singular pose Newton's method comes slowly
    near = result.converged and np.max(np.abs(result.q - q)) <= REACH
    return (result.q if near and sigma_min(system.phi_q(result.q, target)) <= SINGULAR else np.nan), False


def _stays(system: System, q: Any, t: float, result: NewtonResult, to: float) -> bool:
    """Return whether Newton's method, from a prediction, went to the branch of the last pose."""
    sizes, move = np.max(np.abs(result.corrections), axis=1), np.max(np.abs(result.q - q))
    closed = result.converged and is_round_off(result.residuals[-1], result.q)  # not least squares of redundant rows
    if not (closed and contracts(sizes) and sizes[0] <= max(NEAR * move, TINY) and move <= FURTHEST):
        return False
    before, after = system.phi_q(q, t), system.phi_q(result.q, to)
    kink = (to - t) * np.max(np.abs(velocity(system, result.q, t) - velocity(system, q, t)))  # of the path, not the law
    if sigma_min(after) <= SINGULAR or kink > move / 2:  # where branches cross, rounding would choose between them
        return False
    return bool(system.m > system.n or np.linalg.slogdet(before)[0] == np.linalg.slogdet(after)[0])


def motion_of(system: System, scene: Scene, t: Any, levels: Sequence[Any], **evidence: Any) -> Motion:
    """Return an answer in metres and radians, for the bodies and effects that the scene calls for.

    Parameters
    ----------
    system, scene, t
        What was solved, and its times (T,) [s].
    levels : sequence of (n, T) array or None
        q, qd, qdd in the system's coordinates, which are overwritten; None where not computed.
    **evidence
        The other attributes of `Motion`.
    """
    wanted = (True, Effect.VELOCITY in scene.effects, Effect.ACCELERATION in scene.effects)
    levels = [None if x is None else system.to_physical(x, order, in_place=True) for order, x in enumerate(levels)]

    def called_for(rows: Any) -> list[Any]:
        return [level[rows] if want else None for level, want in zip(levels, wanted, strict=True)]

    radii = vars((Evidence.CERTIFICATE in scene.evidence and evidence["certified_radius"]) or no_radius(len(t)))
    kept = {name: radii[name] if want else nowhere(len(t)) for name, want in zip(radii, wanted, strict=True)}
    evidence["certified_radius"] = CertifiedRadius(**kept)
    points = Named()
    for point in scene.points:
        at = system.columns(point.body)
        moved = point_motion(point.position, *(None if level is None else level[at] for level in levels))
        points[point.name] = replace(moved, v=moved.v if wanted[1] else None, a=moved.a if wanted[2] else None)
    own = (p for p in system.placed if p.constraint.parameters)
    contacts = Named((p.constraint.name, ContactMotion(*called_for(p.starts[2]))) for p in own)
    every = scene.bodies_wanted is None
    q, qd, qdd = called_for(np.s_[: system.of_bodies] if every else np.r_[*map(system.columns, scene.wanted)])
    return Motion(t=t, bodies=scene.wanted, q=q, qd=qd, qdd=qdd, points=points, contacts=contacts, **evidence)
