"""The first pose: the assembly that the scene's estimate is nearest to, or, without one, the first that is found."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Any

import numpy as np

from refkin.contacts import touched
from refkin.joints import Cam
from refkin.model import Scene
from refkin.motion import Status
from refkin.newton import NewtonResult, newton
from refkin.proof.assembly import Assemblies, assemblies
from refkin.sweep import contracts
from refkin.system import System

COUNTED = 1e-6
"""Scaled residual that says that a constraint counts a turn: far above round-off, far below what a gear makes of it."""


@dataclass(frozen=True)
class Start:
    """The first pose in the system's coordinates, or the status and the reason why there is none."""

    status: Status
    q: Any = None
    message: str = ""


def find_start(system: System, scene: Scene) -> Start:
    """Return the assembly at the first time that the scene's estimates lead to.

    An estimate from which Newton contracts at once is near one assembly and far from others. From any other estimate
    Newton may go anywhere: then all assemblies are enumerated and the nearest is taken.
    """
    t, bodies = scene.times[0], scene.mechanism.bodies
    missing = [b.name for b in bodies if b.estimate is None]
    estimate = _estimate(system, scene)
    tries: list[NewtonResult] = []
    if not missing:
        tries.append(_newton(system, t, estimate))
        if tries[0].converged and contracts(np.max(np.abs(tries[0].corrections), axis=1)):
            return Start(Status.OK, tries[0].q)
    found = assemblies(system, t)
    if found.unassemblable:
        return Start(Status.UNASSEMBLABLE, message=unassemblable(system, found))
    if found.poses:
        return Start(Status.OK, *_choice(system, found, estimate, missing, t))
    tries.append(_newton(system, t, estimate, damped=True))
    best = next((r for r in tries if r.converged), None)
    if best is not None:
        return Start(Status.OK, best.q, f"the estimate was far; Newton found an assembly from it at t = {t:g}")
    smallest = min(np.nanmin(np.max(np.abs(r.residuals), axis=1), initial=np.inf) for r in tries)
    why = f"{found.message}; {tries[-1].status}; smallest scaled residual {smallest:.3g}"
    return Start(Status.NOT_CONVERGED, message=f"no assembly was found at t = {t:g}: {why}")


def _estimate(system: System, scene: Scene) -> Any:
    """Return the estimates in the system's coordinates, zero where a body has none; contacts are looked for there."""
    q = np.zeros(system.n)
    for body in scene.mechanism.bodies:
        q[system.columns(body.name)] = body.estimate or (0.0, 0.0, 0.0)
    return touched(system, system.to_unit(q), scene.times[0])


def unassemblable(system: System, found: Assemblies) -> str:
    """Return the proof in words, with the gap in metres where it is a length."""
    return f"{found.message} (gap at least {found.gap:.3g} of the size {system.unit.size:g} m)"


def _newton(system: System, t: float, start: Any, damped: bool = False) -> NewtonResult:
    return newton(lambda q: system.phi(q, t), lambda q: system.phi_q(q, t), start, damped=damped)


def _choice(system: System, found: Assemblies, estimate: Any, missing: list[str], t: float) -> tuple[Any, str]:
    """Return an assembly and what to say of the choice: the nearest to what estimates there are, else the first."""
    held = np.zeros(system.n, bool)
    for body in system.mechanism.bodies:
        held[system.columns(body.name)] = body.name not in missing
    for cam in (j for j in system.mechanism.joints if isinstance(j, Cam)):
        held[system.parameter(cam.name)] = cam.contact_estimate is not None
    poses = [_turned_to(system, q, estimate, held, t) for q in found.poses]
    distances = [float(np.linalg.norm((q - estimate)[held])) for q in poses]
    nearest = int(np.argmin(distances))
    if not missing:
        return poses[nearest], ""
    which = f"assembly {nearest + 1} of {len(poses)}{'' if found.complete else ' found'}"
    sides = f", sides {found.branches[nearest]}" if found.branches[nearest] else ""
    return poses[nearest], f"no estimate for {', '.join(missing)}: {which}{sides}; "


def _turned_to(system: System, q: Any, estimate: Any, held: Any, t: float) -> Any:
    """Return the assembly with whole turns added to its angles so that they are nearest to the estimate's.

    Turns that a driver, gear or profile counts are not ours to choose: none are added that break a constraint.
    """
    turns = math.tau * np.where(system.angles & held, np.round((estimate - q) / math.tau), 0.0)
    for some in (turns, *np.diag(turns)):
        if some.any() and np.max(np.abs(system.phi(q + some, t))) < COUNTED:
            q = q + some
            if some is turns:
                break
    return q
