"""The first pose: the assembly that the scene's estimate is nearest to, or, without one, the first that is found.

And what kind of pose it, or a given one, is: `proof.singularity`, by the scene's own numbers.
"""

from __future__ import annotations

import math
from collections.abc import Iterator
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from refkin.analysis import estimate_of, position, sigma_min
from refkin.errors import expect
from refkin.joints import SPACE, initial_contacts, polar_cams
from refkin.joints.annotations import check, is_real
from refkin.model import Mechanism, Scene
from refkin.motion import SINGULAR, Status
from refkin.newton import NewtonResult, contracts
from refkin.proof.assembly.assembly import assemblies
from refkin.proof.assembly.levenberg import least_squares, levenberg_marquardt
from refkin.proof.assembly.search import SAME, Assemblies, closes, halton
from refkin.proof.assembly.spatial import signed, starts
from refkin.proof.numbers.recentred import recentred
from refkin.proof.pose.isolate import isolate
from refkin.proof.singularity.diagnosis import Diagnosis, diagnose_scaled
from refkin.solving.steps import APART
from refkin.solving.table_ends import ends
from refkin.system import System, compile_system

USELESS = 1e12
"""Estimates further out [sizes, rad] say nothing: at most four digits of an angle are left there."""
NEARBY = 0.2
"""What Newton finds further from its estimate [sizes, rad] is not told to be the nearest by how it went there: that
tells of curvature near it, and nothing of a fold that its first step went over, or of angles that come round again."""
NEW_ESTIMATES = 6
"""How many estimates are made up where the given one leads nowhere."""
TURNED = 1e-9
"""What a turn of 1 rad that nobody sees counts in a distance."""
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

    An estimate from which Newton contracts at once is near one assembly and far from others, unless that is so nearly
    singular that rounding decides where Newton goes. From any other estimate it may go anywhere: then all assemblies
    are enumerated and the nearest is taken; if none is found so, damped Newton and least squares are tried, from the
    estimate and from a few new ones.

    Rows of space in the forms `dot` and `printed` are zero, too, where axes point against each other or an angle is
    off by half a turn. So the first pose is that of the rows in half angles, which are not; from there no step leaves
    the branch.
    """
    meant = _meant(scene)
    if meant is not scene:
        return find_start(compile_system(meant.mechanism, system.effects, system.unit), meant)
    t, bodies = scene.times[0], scene.mechanism.bodies
    with np.errstate(all="ignore"):  # estimates may lie anywhere
        estimate = estimate_of(system, scene)
        useless = np.abs(estimate) > USELESS
        missing = [b.name for b in bodies if b.estimate is None or useless[system.columns(b.name)].any()]
        estimate = np.where(useless, 0.0, estimate)
        first = position(system, estimate, t)
        contracted = first.converged and contracts(np.max(np.abs(first.corrections), axis=1))
        contracted = contracted and bool(np.max(np.abs(first.q - estimate)) <= NEARBY)
        if not missing and contracted and closes(system, first.q, t) and _leads_to_one(system, first.q, t):
            return Start(Status.OK, first.q)
        search = assemblies(system, t)
        if search.complete:
            own = None
        else:
            own = _beside(system, search, estimate, missing, t) if missing else _own(system, search, estimate, first, t)
        if search.poses or (missing and own is not None):  # of an estimate that is whole `_far` says how it leads on
            return Start(Status.OK, *_choice(system, search, own, estimate, missing, t))
        if search.unassemblable:
            return Start(Status.UNASSEMBLABLE, message=unassemblable(system, search))
        q, how = _far(system, t, estimate, first)
    if q is None:
        return Start(Status.NOT_CONVERGED, message=f"no assembly was found at t = {t:g}: {search.message}; {how}")
    if search.gap is not None:
        return Start(Status.OK, q, f"{search.message}: less than rounding of the numbers explains")
    return Start(Status.OK, q, how)


def in_form(mechanism: Mechanism, form: str) -> Mechanism:
    """Return a mechanism of space with its rows in a form; as it is if they are, and those of the plane, or form ""."""
    joints, drivers = mechanism.joints, mechanism.drivers
    of_drivers = "dot" if form == "printed" else form  # no driver has printed rows
    known = [getattr(c, "form", own) == own for parts, own in ((joints, form), (drivers, of_drivers)) for c in parts]
    if all(known) or not form:
        return mechanism

    def changed(parts: tuple[Any, ...], form: str) -> tuple[Any, ...]:
        changes = {"form": form} | ({} if form == "printed" else {"spacing": None})  # it belongs to printed rows
        return tuple(replace(c, **{key: new for key, new in changes.items() if hasattr(c, key)}) for c in parts)

    return replace(mechanism, joints=changed(joints, form), drivers=changed(drivers, of_drivers))


def _meant(scene: Scene) -> Scene:
    """Return the scene with rows in half angles."""
    mechanism = in_form(scene.mechanism, "half")
    return scene if mechanism is scene.mechanism else replace(scene, mechanism=mechanism)


def _far(system: System, t: float, estimate: Any, first: NewtonResult) -> tuple[Any, str]:
    """Return an assembly from a far estimate, and what found it; else None, and how near all tries came."""
    smallest, least = np.nanmin(np.append(np.max(np.abs(first.residuals), axis=1), np.inf)), math.inf
    for found, how in _tries(system, t, estimate, first):
        size = _contradicted(system, found, t)
        if size <= 1.0:
            return found.q, f"the estimate was far: {how} found an assembly at t = {t:g}"
        smallest, least = np.nanmin([smallest, found.residual]), min(least, size)
    why = f"smallest scaled residual {smallest:.3g}"
    if least < math.inf:
        why = f"{why}; poses of some of the redundant rows contradict others: {least:.3g} times what rounding explains"
    return None, why


def _tries(system: System, t: float, estimate: Any, first: NewtonResult) -> Iterator[tuple[NewtonResult, str]]:
    """Yield what Newton, damped Newton and least squares make of the estimate, and what each is called.

    They may end at a pose that is no root (a singular phi_q, a minimum): then new estimates are taken, the angles
    turned by a fixed sequence.
    """
    yield first, "Newton"
    for k in range(NEW_ESTIMATES + 1):
        start, new = _new_estimate(system, estimate, k, t) if k else estimate, " from a new estimate" if k else ""
        yield position(system, start, t, damped=True, max_iterations=30), f"damped Newton{new}"
        yield least_squares(system, start, t), f"least squares{new}"


def _new_estimate(system: System, estimate: Any, k: int, t: float) -> Any:
    """Return the k-th estimate that is made up: the angles turned by a fixed sequence; in space one of its own."""
    if system.kind is SPACE:
        return next(starts(system, t, 1, k))
    return estimate + math.tau * np.multiply(halton(k, system.n), system.angles)


def _leads_to_one(system: System, q: Any, t: float) -> bool:
    """Whether it was not rounding that decided on the root.

    Near a singular pose roots are sigma_min apart or so, and corrections are not known to EPS / sigma_min: below
    `SINGULAR` that is more than sigma_min / `APART`, however small the corrections were.
    """
    jacobian = system.phi_q(q, t)
    regular = system.m == system.n and np.linalg.slogdet(jacobian)[0] != 0.0
    if regular and np.linalg.norm(np.linalg.inv(jacobian)) < 1.0 / SINGULAR:  # this norm is at least 1 / sigma_min
        return True
    return bool(sigma_min(jacobian) > SINGULAR)


def _own(system: System, search: Assemblies, estimate: Any, first: NewtonResult, t: float) -> Any:
    """Return the assembly to which Newton's method goes from the estimate, or least squares where no driver holds it.

    None if it is none, or one that least squares came to and the search knows.
    """
    found = first if first.converged else least_squares(system, estimate, t)
    known = not first.converged and any(np.max(np.abs(found.q - q)) <= SAME for q in search.poses)
    return found.q if not known and _contradicted(system, found, t) <= 1.0 else None


def _beside(system: System, search: Assemblies, estimate: Any, missing: list[str], t: float) -> Any:
    """Return the assembly to which estimates lead, the bodies that have none being put between the others first.

    They are from a few places of their own. It is the first assembly that leaves the others where they are, else the
    one that moves them least; None if none leads to one, or to one that the search knows.
    """
    held, best, least = _held(system, missing), None, math.inf

    def placed(some: Any) -> Any:
        q = estimate.copy()
        q[~held] = some
        return q

    for k in range(1, NEW_ESTIMATES + 1):
        start = _new_estimate(system, estimate, k, t)[~held]
        between = levenberg_marquardt(
            lambda x: system.phi(placed(x), t), lambda x: system.phi_q(placed(x), t)[:, ~held], start
        )
        found = least_squares(system, placed(between.q), t)
        if _contradicted(system, found, t) <= 1.0:
            q = _turned_to(system, found.q, estimate, held, t)
            moved = float(np.max(np.abs(q - estimate)[held], initial=0.0))
            best, least = (q, moved) if moved < least else (best, least)
        if least <= NEARBY:
            break
    poses = [] if best is None else [_turned_to(system, q, estimate, held, t) - best for q in search.poses]
    known = any(np.max(np.abs(off[: system.of_bodies])) <= SAME for off in poses)  # a contact may be turns on
    return None if known else best


def _held(system: System, missing: list[str]) -> Any:
    """Return of which coordinates (n,) there is an estimate."""
    held = np.zeros(system.n, bool)
    for body in system.mechanism.bodies:
        held[system.columns(body.name)] = body.name not in missing
    for cam in polar_cams(system.mechanism.joints):
        held[system.parameter(cam.name)] = cam.contact_estimate is not None
    return held


def _contradicted(system: System, found: NewtonResult, t: float) -> float:
    """Return by how many times what rounding explains redundant rows contradict a root; inf if it is none.

    It is one by its residual, or, where a row is divided by a small number, by proof: of rows that serve.
    """
    if not found.converged:
        return math.inf
    if closes(system, found.q, t):
        return 0.0
    proof = isolate(system, found.q[:, None], [t])
    return float(proof.contradiction[0, 0]) if proof.ok[0] else math.inf


def unassemblable(system: System, search: Assemblies) -> str:
    """Return the proof in words, with the gap: of lengths in sizes of the mechanism, of angles in rad."""
    return f"{search.message} (gap at least {search.gap:.3g}, in sizes of {system.unit.size:g} m or rad)"


def _choice(
    system: System, search: Assemblies, own: Any, estimate: Any, missing: list[str], t: float
) -> tuple[Any, str]:
    """Return an assembly and what to say of the choice: the nearest to what estimates there are, else the first.

    Bodies of the plane are as near as they look: whole turns that a driver counts decide only between poses that look
    alike. Where not all assemblies are known, that to which the estimate led, `own`, is one of them. A singular one is
    chosen only where it is much nearer than all others: no motion starts there. It may be the only one: all were looked
    for because the estimate alone did not decide.
    """
    held = _held(system, missing)
    poses = [_turned_to(system, q, estimate, held, t) for q in (*search.poses, *([] if own is None else [own]))]
    regular = [sigma_min(system.phi_q(q, t)) > SINGULAR for q in poses]
    away = np.array(poses) - estimate
    seen = np.where(system.turns == 1.0, away - math.tau * np.round(away / math.tau), away)
    distances = [
        float(np.linalg.norm(x[held]) + TURNED * np.linalg.norm(y[held])) for x, y in zip(seen, away, strict=True)
    ]
    nearest = min(range(len(poses)), key=lambda k: (distances[k] * (1 if regular[k] else APART), not regular[k]))
    inward = recentred(system).inward  # rounding moves a frame that is far from its joints
    counted = slice(system.of_bodies if system.kind is SPACE else None)  # no turns that a gear of space has counted

    def differ(q: Any, like: Any) -> bool:
        off = inward(_turned_to(system, q, like, True, t)) - inward(like)
        return float(np.max(np.abs(off[counted]))) > SAME

    known = own is not None and not all(differ(q, poses[-1]) for q in search.poses)
    others = sum(differ(q, poses[nearest]) for q in (search.poses if known else poses))
    far = [body.name for body in system.mechanism.bodies if body.name in missing and body.estimate is not None]
    absent = [name for name in missing if name not in far]
    doubt = "more than one assembly may be near the estimate" if others else "the estimate alone does not decide"
    why = f"no estimate for {', '.join(absent)}" if absent else doubt
    why = f"an estimate beyond all digits for {', '.join(far)}" if far and not absent else why
    if nearest == len(search.poses):
        told = f"the nearest of {others + 1}" if others else "the only one"
        return poses[nearest], f"{why}: that of the estimate, {told} found"
    many = max(len(search.poses), others + 1)
    if many == 1 and search.complete and not missing:
        return poses[nearest], ""
    which = f"assembly {nearest + 1} of {many}" if many > 1 else "the only assembly"
    which += "" if search.complete else " found"
    mode = f", mode {search.branches[nearest]}" if search.branches[nearest] else ""
    return poses[nearest], f"{why}: {which}{mode}"


def _turned_to(system: System, q: Any, estimate: Any, held: Any, t: float) -> Any:
    """Return the assembly with whole turns added to its angles so that they are nearest to the estimate's.

    Turns that a driver, gear or profile counts are not ours to choose: none are added that break a constraint.
    """
    if system.kind is SPACE:
        return signed(system, q, estimate)
    turns = math.tau * np.where(system.angles & held, np.round((estimate - q) / math.tau), 0.0)
    for some in (turns, *np.diag(turns)):
        if some.any() and np.max(np.abs(system.phi(q + some, t))) < COUNTED:
            q = q + some
            if some is turns:
                break
    return q


def diagnose(given: Scene | System, q: Any = None, t: float | None = None) -> Diagnosis:
    """Say what a pose is.

    Parameters
    ----------
    given : Scene or System
    q : (n,) array, optional
        The pose [m, rad], contact parameters last, or without parameters; by default the first pose of the scene.
    t : float, optional
        Its time; by default the scene's first, whose pose alone is known without q.

    Raises
    ------
    ValueError
        If there is no pose: a system without q and t, a scene without a first pose, a q that does not close
        or has another number of coordinates, a time that is not in a law's table.
    """
    expect("given", given, Scene, System)
    system = compile_system(given.mechanism, unit=given.mechanism.unit())
    check("t", "a finite time [s]", t, t is None or (is_real(t) and math.isfinite(t)))
    counts = dict.fromkeys((system.n, system.of_bodies))  # with contact parameters, or without
    check("q", f"{' or '.join(map(str, counts))} numbers", q, q is None or any(is_real(q, n) for n in counts))
    over = [name for name, first, last in ends(given.mechanism.constraints) if not first <= (t or 0.0) <= last]
    check("t", f"a time in the table of {', '.join(over)}", t, t is None or not over)
    if isinstance(given, Scene):
        t = given.times[0] if t is None else t
        if q is None:
            check("t", "q as well, or the scene's first time", t, t == given.times[0])
            start = find_start(system, given)
            if start.q is None:
                raise ValueError(f"the scene has no first pose: {start.message}")
            return diagnose_scaled(system, start.q, t)
    if q is None or t is None:
        raise ValueError("a system alone has no pose: give q and t")
    pose = np.asarray(q, float)
    if len(pose) == system.n:
        return diagnose_scaled(system, system.to_unit(pose), float(t))
    whole = system.to_unit(np.append(pose, np.zeros(system.n - len(pose))))
    return diagnose_scaled(system, initial_contacts(system, whole, float(t)), float(t))
