"""What an engine's answer to a hard scene is worth: the certificate arbitrates, never a majority.

At each time the truth is enclosed at 113 bits: one root in a ball (Krawczyk), or none (closed form of the loop). An
answer is held against the ball and the least error there (`least_error`), and lies inside, outside by so many radii,
or the balls cannot say. Where the pose is exactly singular no ball holds one root; there the pose itself is known, and
the radius is that of the fold.

What is allowed is as near to the pose as any float64 code can come, also where it is nearly singular. With phi_q = U S
V^T at the pose and a residual that is known to e, no code tells apart poses whose residual differs by less. Along each
singular vector the residual grows as s_k x; along the last one, where s may be 0, as s x - K x^2 / 2, K = |u .
phi_qq[v, v]|. So it errs by at most

    x_k = |u_k . e| / s_k  (k < n),       x_n = 2 f / (s + sqrt(s^2 - 2 K f)),  f = |u_n . e|,

the smaller root of s x - K x^2 / 2 = f, while there is one: s^2 > 2 K f. Nearer to the fold the two assemblies have the
same residual to within e, and x_n is what takes a code from the farther one to beyond the nearer one:
x_n = (s + sqrt(s^2 + 2 K f)) / K; at the fold sqrt(2 f / K). What x_n moves the other coordinates by is
|phi_qq[v, v]| x_n^2 / 2, carried by their own s_k.

e is the running error of the formulas with the one safety factor of the budgets, on both sides, and what the result is
rounded to is added, as there (`crosscheck.judge.rounding`). Each part of a mechanism has a last singular vector of its
own (`crosscheck.judge.parts`): where several are singular at once, each is at its own fold, and others are regular.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from flint import arb

from crosscheck.engines import Term
from crosscheck.engines.frames import wrap
from crosscheck.judge import rounding
from crosscheck.judge.budget import BOTH_SIDES
from crosscheck.judge.comparison import Reference
from crosscheck.judge.parts import parts_of
from crosscheck.judge.spatial import alike, passive_lines, reversed_joints, spun
from crosscheck.scenes.hard_case import HardCase
from refkin.joints import PLANE
from refkin.model import Scene
from refkin.motion import Motion, Status
from refkin.proof.assembly.assembly import assemblies
from refkin.proof.pose.krawczyk import Judgement, Verdict, judge, krawczyk
from refkin.system import System, compile_system

GRANTED = 20.0
"""Times a stopping rule or a compliance is granted, as a part of the residual: at the regular poses in which these
scenes begin, |phi_q^-1| is below 20 (but where many loops hang on each other). What a singular pose makes of a
tolerance beyond that is what is looked for."""
TOO_WIDE = 0.1
"""A least error above this says nothing [rad, sizes]: a linkage that folds up is free there."""


@dataclass(frozen=True)
class Solutions:
    """What is proved of one time: `roots` as balls with the least error at each; none at all if `gap` is known."""

    roots: tuple[tuple[tuple[Any, ...], Any], ...]
    gap: float | None = None


@dataclass(frozen=True)
class PoseSample:
    """An answer at one time: where it lies, whether it was called ok, what was proved there; `none`: no assembly."""

    t: float
    judgement: Judgement | None
    called_ok: bool
    note: str = ""
    none: bool = False


def truths(case: HardCase) -> tuple[System, tuple[Solutions, ...]]:
    """Return what is proved of every time of a case, in the system's scaled coordinates."""
    system = compile_system(case.scene.mechanism, unit=case.scene.mechanism.unit())
    solutions: list[Solutions] = []
    mode: tuple[int, ...] | None = None
    for t in case.scene.times:
        truth, mode = _among_assemblies(system, case, t, mode)
        solutions.append(truth)
    return system, tuple(solutions)


def _stacked(system: System, pose: Any) -> Any:
    return system.to_unit(np.concatenate([pose[body.name] for body in system.mechanism.bodies]))


def _among_assemblies(
    system: System, case: HardCase, t: float, mode: tuple[int, ...] | None
) -> tuple[Solutions, tuple[int, ...] | None]:
    """Return the pose that is the truth, or is among all assemblies in closed form, and the mode it is put together in.

    A branch keeps its mode as long as it meets no fold, also where a pose in float64 is nearer to the other one.
    """
    if case.every is not None:
        return Solutions(tuple(_root(system, _stacked(system, pose), t) for pose in case.every(t))), None
    pose = case.poses(t)
    near = None if pose is None else _stacked(system, pose)
    if case.exact:
        return Solutions((_root(system, near, t),)), mode
    search = assemblies(system, t, trying=False)
    if case.any_assembly:
        return Solutions(tuple(_root(system, q, t) for q in search.poses)), None
    if near is None:
        return Solutions((), search.gap), None
    if not search.poses:
        hidden = (search.gap or 0.0) <= np.max(residual_error(system, near, t))
        return (Solutions((_singular(system, near, t),)) if hidden else Solutions((), search.gap)), mode
    at = next((k for k, there in enumerate(search.branches) if there == mode), None)
    if at is None:
        at = int(np.argmin([np.max(np.abs(_away(system, q, near))) for q in search.poses]))
    return Solutions((_root(system, search.poses[at], t),)), search.branches[at] if mode is None else mode


def _away(system: System, q: Any, near: Any) -> Any:
    """Return q - near with angles less than half a turn apart."""
    difference = np.array(q - near)
    difference[system.angles] = wrap(difference[system.angles])
    return difference


def _root(system: System, q: Any, t: float) -> tuple[tuple[Any, ...], Any]:
    enclosure = krawczyk(system, q, t)
    if enclosure is None:
        return _singular(system, q, t)
    return enclosure.q, allowed_at(system, enclosure.nearest(), t)


def _singular(system: System, q: Any, t: float) -> tuple[tuple[Any, ...], Any]:
    return tuple(arb(float(x)) for x in q), allowed_at(system, q, t)


def allowed_at(system: System, q: Any, t: float, left: Any = 0.0) -> Any:
    """Return the least error (n,); a body that spins passively may have it in any of its Euler parameters.

    Parameters
    ----------
    system, q, t, left
        As for `least_error`.
    """
    least = least_error(system.held_at(q), q, t, left)
    if system.kind is PLANE:
        return least
    lines = passive_lines(system.mechanism, system.unit)
    return spun(least[:, None], [body.name for body in system.mechanism.bodies], lines)[:, 0]


def _alike(system: System, q: Any, middle: Any) -> Any:
    """Return an answer (n,) with signs of Euler parameters and passive spins as near a root's as can be."""
    if system.kind is PLANE:
        return q
    names = [body.name for body in system.mechanism.bodies]
    lines = passive_lines(system.mechanism, system.unit)
    with np.errstate(invalid="ignore"):
        (own,) = alike([q[: system.of_bodies, None]], [middle[: system.of_bodies, None]], names, lines)
    return np.append(own[:, 0], q[system.of_bodies :])


def samples(
    system: System, truth: Sequence[Solutions], scene: Scene, motion: Motion, terms: Sequence[Term]
) -> tuple[PoseSample, ...]:
    """Return where a motion lies, time by time.

    Parameters
    ----------
    system, truth
        As `truths` returns them.
    scene, motion : Scene, Motion
        What was asked, and the answer.
    terms : sequence of Term
        What the engine adds by its own doing.
    """
    rows = np.concatenate([np.r_[system.columns(body)] for body in motion.bodies])
    q = np.full((system.n, len(scene.times)), np.nan)
    q[rows] = motion.q
    q = system.to_unit(q)
    rows.sort()
    granted = GRANTED * sum(term.absolute for term in terms if term.level == "position")
    turned = {} if system.kind is PLANE else reversed_joints(scene.mechanism, motion)
    made = []
    for k, (t, true) in enumerate(zip(scene.times, truth, strict=True)):
        ok = motion.status[k] is Status.OK
        if not np.isfinite(q[rows, k]).all():
            note = "called ok without a number" if ok else motion.status[k].value
            made.append(PoseSample(t, None, ok, note, none=true.gap is not None))
            continue
        sample = _sample(system, true, q[:, k], rows, t, ok, granted)
        wrong = [name for name, at in turned.items() if at[k]]
        if wrong and not sample.note:
            sample = replace(sample, note=f"{', '.join(wrong)} the wrong way round")
        made.append(sample)
    return tuple(made)


def scene_truths(ref: Reference) -> tuple[Solutions, ...]:
    """Return what is proved of every time of a scene that is no hard case: the reference says which branch is meant.

    Where it has no pose of its own every assembly will do; where it proves that there is none, none will.
    """
    solutions = []
    for q, t in zip(ref.levels[0].T, ref.scene.times, strict=True):
        if np.isfinite(q).all():
            solutions.append(Solutions((_root(ref.system, q, t),)))
        else:
            there = assemblies(ref.system, t, trying=False)
            solutions.append(Solutions(tuple(_root(ref.system, x, t) for x in there.poses), there.gap))
    return tuple(solutions)


def _sample(system: System, true: Solutions, q: Any, rows: Any, t: float, ok: bool, granted: float) -> PoseSample:
    if not true.roots:
        gap = f"there is no assembly: {true.gap:.3g} sizes are missing" if true.gap else "no truth is known"
        verdict = Verdict.OUTSIDE if true.gap else Verdict.UNDECIDABLE
        return PoseSample(t, Judgement(verdict, np.inf if true.gap else np.nan), ok, gap)
    best = min((_judged(system, *root, q, rows, granted) for root in true.roots), key=lambda j: j.radii)
    whole = len(rows) == system.n
    other = whole and best.verdict is Verdict.OUTSIDE and _on_other_assembly(system, true.roots[0][0], q, t)
    return PoseSample(t, best, ok, "on the other assembly" if other else "")


def _on_other_assembly(system: System, balls: tuple[Any, ...], q: Any, t: float) -> bool:
    """Return whether an answer is next to another root, by proof: ten times nearer to it than to the right one."""
    enclosure = krawczyk(system, q, t)
    if enclosure is None:
        return False
    middle = np.array([float(x) for x in balls])
    away = np.max(np.abs(_away(system, _alike(system, q, middle), middle)))
    return bool(np.max(enclosure.distance(q)) < 0.1 * away)


def _judged(system: System, balls: tuple[Any, ...], allowed: Any, q: Any, rows: Any, granted: float) -> Judgement:
    """Hold the coordinates of the bodies that are answered for against a root, full turns apart or not."""
    middle = np.array([float(x) for x in balls])
    q = _alike(system, q, middle)
    if not np.max(allowed[rows]) < TOO_WIDE:
        return Judgement(Verdict.UNDECIDABLE, float(np.max(np.abs(_away(system, q, middle)[rows]) / TOO_WIDE)))
    turns = np.where(system.angles, np.round((q - middle) / (2 * np.pi)), 0.0)
    moved = tuple(balls[k] + 2 * arb.pi() * int(turns[k]) if turns[k] else balls[k] for k in rows)
    return judge(moved, q[rows], allowed[rows] + granted)


STEP = 1e-100


def residual_error(system: System, q: Any, t: float) -> Any:
    """Return what rounding leaves of the residual (m,) at a pose (n,).

    Parameters
    ----------
    system : System
    q : (n,) array
        The pose, in the system's coordinates.
    t : float
        When [s].
    """
    return BOTH_SIDES * rounding.residual_error(system, q[:, None], np.array([t]))[:, 0]


def least_error(system: System, q: Any, t: float, left: Any = 0.0) -> Any:
    """Return the error (n,) that no float64 code can be blamed for, in scaled coordinates; inf where nothing is held.

    Parameters
    ----------
    system : System
        Compiled in its mechanism's own unit.
    q : (n,) array
        The pose, in the system's coordinates.
    t : float
        When [s].
    left : float or (m,) array
        What is left of the residual beside rounding.
    """
    e, slope = residual_error(system, q, t) + left, system.phi_q(q, t)
    still = np.zeros((system.n, 1))
    out = rounding.output_rounding(system, q[:, None], still, still, np.array([t]))[0][:, 0]
    for rows, own in parts_of(system):
        u, s, vt = np.linalg.svd(slope[np.ix_(rows, own)], full_matrices=False)
        v = np.zeros(system.n)
        v[own] = vt[-1]
        bend = (np.imag(system.phi_q(q + 1j * STEP * v, t)) @ v / STEP)[rows]  # phi_qq[v, v] by a complex step
        f = np.abs(u.T) @ e[rows]
        last = fold(s[-1], abs(float(u[:, -1] @ bend)), float(f[-1]))
        with np.errstate(divide="ignore", invalid="ignore"):
            others = (f[:-1] + np.abs(u.T[:-1] @ bend) * last**2 / 2) / s[:-1]
            out[own] += np.abs(vt[:-1].T) @ others + np.abs(vt[-1]) * last
    return out


def fold(s: float, k: float, f: float) -> float:
    """Return the largest x that a residual of f hides where the residual is s x - k x^2 / 2.

    Parameters
    ----------
    s, k, f : float
        None is negative.
    """
    if s * s > 2 * k * f:
        return float(2 * f / (s + np.sqrt(s * s - 2 * k * f)))
    return float((s + np.sqrt(s * s + 2 * k * f)) / k) if k else np.inf
