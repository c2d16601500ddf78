"""A scene solved: poses on the ground as jets, what rows leave open, until when all this is sure.

A branch is lost where the two meeting points of a dyad are one, also between the asked times. Beyond such a pose the
sign that tells meeting points apart says nothing of the branch: where a parallelogram is flat its sign changes, and
keeping it answers with the antiparallelogram. So every slack is held to be positive all along the motion. Between two
times it is least where its rate goes from - to +; such an interval is halved as long as the tangents at its ends, which
lie below a slack that is curved upwards, go down to zero.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from crosscheck.engines.closed_form.assemble import Assembly
from crosscheck.engines.closed_form.jets import Arithmetic, Floats, Jet, midpoint
from crosscheck.engines.closed_form.linkage import GroupedScene, JetPose, RigidGroup, read_linkage
from refkin.model import Scene

REFINEMENTS = 8
"""How often an interval in which an angle's turns are unsure is halved."""


@dataclass(frozen=True)
class Solution:
    """Everything on the ground, what is left open of each row, (rows, T), and until when turns and branch are sure."""

    assembly: Assembly
    ground: RigidGroup
    scene: Scene
    closure: Any
    sure_until: float = np.inf
    lost_after: float = np.inf


def assembled(scene: Scene, arithmetic: Arithmetic, turns_of: Callable[[int], Any] | None = None) -> Assembly:
    """Return a scene's groups joined; NotDyadic if the linkage is not of class II.

    Parameters
    ----------
    scene, arithmetic, turns_of : Scene, Arithmetic, callable or None
        The last: k -> the k-th angle found, with its turns, if these are known.
    """
    assembly = Assembly(read_linkage(scene, arithmetic), scene, arithmetic, turns_of=turns_of)
    assembly.run()
    return assembly


def _solved(scene: Scene, turns_of: Callable[[int], Any] | None = None) -> Solution:
    drawn = read_linkage(scene, Floats())
    apart = [replace(g, bodies=dict(g.bodies), nodes=dict(g.nodes)) for g in drawn.groups]
    assembly = Assembly(replace(drawn, groups=apart), scene, Floats(), turns_of=turns_of)
    ground = assembly.run()
    return Solution(assembly, ground, scene, rows_of(_gaps(drawn, ground, scene), len(scene.times)))


def float_solution(scene: Scene) -> Solution:
    """Solve in floats, on a finer grid where an angle's turns are unsure, and return it at the scene's own times."""
    solution = _with_turns(scene)
    lost = _lost_after(scene.times, lambda t: assembled(replace(scene, times=t), Floats()), _moves(solution))
    return replace(solution, lost_after=lost)


def _moves(solution: Solution) -> Any:
    """Return by how much an angle [rad], or a law [rad, sizes], moves in each interval at most; NaN if not known.

    A law may leave between two times and come back: what its rate makes of the interval is summed up.
    """
    times, size = np.array(solution.scene.times), solution.scene.mechanism.size()
    h = np.diff(times)
    fine = times[:-1, None] + h[:, None] * np.linspace(0.0, 1.0, PIECES + 1)
    moves = [np.zeros(len(h))]
    moves += [np.abs(np.diff(np.broadcast_to(midpoint(x), times.shape))) for x in solution.assembly.known_angles]
    for constraint in solution.scene.mechanism.constraints:
        for law in constraint.laws:
            rates = np.broadcast_to(np.asarray(law(fine.ravel(), 1), float), fine.size).reshape(fine.shape)
            moves.append(h * np.abs(rates).mean(axis=1) / min(size, 1.0))
    return np.max(moves, axis=0)


def _with_turns(scene: Scene) -> Solution:
    times = scene.times
    solution = _solved(scene)
    for _ in range(REFINEMENTS):
        unsure = np.nonzero(solution.assembly.unsure_turns)[0]
        if not len(unsure):
            break
        middles = [0.5 * (times[k] + times[k + 1]) for k in unsure]
        times = tuple(sorted({*times, *middles}))
        solution = _solved(replace(scene, times=times))
    if times == scene.times:
        return solution
    near = [angles[np.searchsorted(times, scene.times)] for angles in solution.assembly.known_angles]
    unsure = np.nonzero(solution.assembly.unsure_turns)[0]
    sure_until = times[unsure[0]] if len(unsure) else np.inf
    return replace(_solved(scene, lambda k: near[k]), sure_until=sure_until)


def _gaps(drawn: GroupedScene, ground: RigidGroup, scene: Scene) -> list[Any]:
    """Return what is left of every row and joint: lengths in sizes, angles in rad. Values only."""
    size = scene.mechanism.size()
    poses = {
        name: JetPose(Jet(pose.angle.v), pose.turn.part("v"), pose.origin.part("v"))
        for name, pose in ground.bodies.items()
    }
    held = {
        node: [poses[body].point(c.nodes[node]) for c in drawn.groups for body in c.bodies if node in c.nodes]
        for node in range(len(drawn.places))
    }
    gaps: list[Any] = []
    for points in held.values():
        gaps += [part.v / size for other in points[1:] for gap in [other - points[0]] for part in (gap.x, gap.y)]
    for angle in drawn.angles:
        gaps.append(poses[angle.body_j].angle.v - poses[angle.body_i].angle.v - angle.value.v)
    for line in drawn.lines:
        pose = poses[line.body_i]
        gap = held[line.node][0] - pose.point(line.anchor)
        gaps.append(((pose.turn * line.normal).dot(gap).v - line.value.v) / size)
    for row in drawn.distances:
        gaps.append(((held[row.node_b][0] - held[row.node_a][0]).length().v - row.value.v) / size)
    return gaps


PIECES = 16
"""Parts into which an interval between two times is cut: of a turn of a crank a part has one least slack at most."""
FEWEST, PART = 2, math.tau / 128
"""Fewer parts are enough, but so many, where nothing moves by more than this in any of them [rad, sizes]."""
HALVINGS = 60
"""After so many no float64 time is left between."""

Solve = Callable[[tuple[float, ...]], Assembly]
"""Returns the groups joined at times that begin with the scene's first: there the estimates tell the assembly."""


def _slacks(assembly: Assembly) -> tuple[Any, Any]:
    """Return every slack of every dyad, in scales (S, T), and its rate."""
    kept = [slack for meeting in assembly.meetings for slack in meeting.slacks]
    value, rate, scale = (
        rows_of([midpoint(getattr(slack, part)) for slack in kept], len(assembly.scene.times))
        for part in ("value", "rate", "scale")
    )
    return value / scale, rate / scale


def rows_of(numbers: Sequence[Any], count: int) -> Any:
    """Return numbers, and rows of as many as there are times, as one array (K, count)."""
    out = np.empty((len(numbers), count))
    for k, x in enumerate(numbers):
        out[k] = x
    return out


def _lost_after(times: tuple[float, ...], solve: Solve, moves: Any) -> float:
    """Return the time from which the branch is not known: the first at which a slack is not positive; else inf.

    `moves` (T - 1,) says by how much anything moves in each interval, NaN where that is not known.
    """
    if len(times) < 2:
        return np.inf
    parts = np.clip(np.nan_to_num(np.ceil(moves / PART), nan=PIECES), FEWEST, PIECES).astype(int)
    first, last = np.array(times[:-1]), np.array(times[1:])
    alike = [parts == n for n in range(FEWEST, PIECES + 1) if n in parts]
    fine = np.unique(np.concatenate([np.linspace(first[k], last[k], parts[k][0] + 1).ravel() for k in alike]))
    value, rate = _slacks(solve(tuple(fine.tolist())))
    met = _first(fine, value)
    least = (rate[:, :-1] < 0.0) & (rate[:, 1:] > 0.0) & (fine[1:] < met)
    which, k = np.nonzero(least)
    at = [(fine[i], value[which, i], rate[which, i]) for i in (k, k + 1)]
    return min(met, _least(times[0], which, at, solve))


def _least(first: float, which: Any, ends: Any, solve: Solve) -> float:
    """Return the first time at which a slack is not positive within intervals in which each has one least value."""
    (lo, v_lo, r_lo), (hi, v_hi, r_hi) = ends
    met = np.inf
    for _ in range(HALVINGS):
        with np.errstate(all="ignore"):
            bound = (v_lo * r_hi - v_hi * r_lo + (hi - lo) * r_lo * r_hi) / (r_hi - r_lo)
        middle = (lo + hi) / 2
        open_ = ~(bound > Floats.zero) & (lo < middle) & (middle < hi) & (lo < met)
        if not open_.any():
            break
        which, lo, v_lo, r_lo, hi, v_hi, r_hi, middle = (
            x[open_] for x in (which, lo, v_lo, r_lo, hi, v_hi, r_hi, middle)
        )
        times = np.unique(np.append(middle, first))
        at = np.searchsorted(times, middle)
        value, rate = (of[which, at] for of in _slacks(solve(tuple(times.tolist()))))
        met = min(met, float(np.min(middle[~(value > Floats.zero)], initial=np.inf)))
        left = rate > 0.0
        lo, v_lo, r_lo = (np.where(left, a, b) for a, b in ((lo, middle), (v_lo, value), (r_lo, rate)))
        hi, v_hi, r_hi = (np.where(left, a, b) for a, b in ((middle, hi), (value, v_hi), (rate, r_hi)))
    return met


def _first(times: Any, value: Any) -> float:
    bad = np.any(value <= Floats.zero, axis=0)
    return float(times[np.argmax(bad)]) if bad.any() else np.inf
