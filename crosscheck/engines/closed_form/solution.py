"""A scene solved in one arithmetic: poses on the ground as jets, what rows leave open, until when all this is sure."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from crosscheck.engines.closed_form.assemble import Assembly
from crosscheck.engines.closed_form.jets import Arithmetic, Floats, Jet, Planar
from crosscheck.engines.closed_form.linkage import Linkage, Pose, RigidGroup, read_linkage
from crosscheck.engines.closed_form.lost import lost_after
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


def solve(scene: Scene, arithmetic: Arithmetic, turns_of: Callable[[int], Any] | None = None) -> Solution:
    """Return a scene solved; `turns_of(k)` gives the k-th angle found, with its turns, if these are known already.

    Raises
    ------
    NotDyadic
        If the linkage is not of class II.
    """
    assembly = Assembly(read_linkage(scene, arithmetic), scene, arithmetic, turns_of=turns_of)
    drawn = read_linkage(scene, arithmetic)
    ground = assembly.run()
    closure = np.stack([np.broadcast_to(gap, (len(scene.times),)) for gap in _gaps(drawn, ground, scene)])
    return Solution(assembly, ground, scene, closure)


def float_solution(scene: Scene) -> Solution:
    """Solve in floats, on a finer grid where an angle's turns are unsure, and return it at the scene's own times."""

    def joined(times: tuple[float, ...]) -> Assembly:
        finer = replace(scene, times=times)
        assembly = Assembly(read_linkage(finer, Floats()), finer, Floats())
        assembly.run()
        return assembly

    return replace(_with_turns(scene), lost_after=lost_after(scene.times, joined))


def _with_turns(scene: Scene) -> Solution:
    times = scene.times
    solution = solve(scene, Floats())
    for _ in range(REFINEMENTS):
        unsure = np.nonzero(solution.assembly.unsure_turns)[0]
        if not len(unsure):
            break
        middles = [0.5 * (times[k] + times[k + 1]) for k in unsure]
        times = tuple(sorted({*times, *middles}))
        solution = solve(replace(scene, times=times), Floats())
    if times == scene.times:
        return solution
    near = [angles[np.searchsorted(times, scene.times)] for angles in solution.assembly.known_angles]
    unsure = np.nonzero(solution.assembly.unsure_turns)[0]
    sure_until = times[unsure[0]] if len(unsure) else np.inf
    return replace(solve(scene, Floats(), lambda k: near[k]), sure_until=sure_until)


def _gaps(drawn: Linkage, ground: RigidGroup, scene: Scene) -> list[Any]:
    """Return what is left of every row and joint: lengths in sizes, angles in rad. Values only."""
    size = scene.mechanism.size()
    poses = {name: _still(pose) for name, pose in ground.bodies.items()}
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


def _still(pose: Pose) -> Pose:
    def planar(vector: Planar) -> Planar:
        return Planar(Jet(vector.x.v), Jet(vector.y.v))

    return Pose(Jet(pose.angle.v), planar(pose.turn), planar(pose.origin))
