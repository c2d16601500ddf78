"""A scene as vector loops: a spanning tree of vector chains to every body, and one loop for each chain that is left.

What the two ends of a loop have in common cancels, so no body's place is ever an unknown, and no body that only the
input moves has an equation.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from crosscheck.engines import EngineError, EngineRefusal
from crosscheck.engines.vector_loop.chains import Estimates, VectorChain, VectorChains, angle_families
from crosscheck.engines.vector_loop.system import LoopSystem
from crosscheck.engines.vector_loop.vectors import Sums, Variable, Variables, Vector, combined
from refkin.joints import GROUND
from refkin.model import Scene


@dataclass(frozen=True)
class Reading:
    """A scene in loops, lengths in units of `size` [m], places on the ground counted from `origin` [m].

    Attributes
    ----------
    system : LoopSystem
    q0 : (n,) array
        The unknowns at the first time by the bodies' estimates.
    places : Sums
        Rows: the origins of the wanted bodies, then the scene's points.
    angles : Variables
        Of the wanted bodies.
    distance : callable
        How far given unknowns put the bodies from their estimates at the first time.
    """

    system: LoopSystem
    q0: Any
    places: Sums
    angles: Variables
    distance: Callable[[Any], float]
    size: float
    origin: complex


Positions = Mapping[str, Sequence[Vector]]
"""Body -> the vectors that lead from the origin to its frame."""


def read(scene: Scene) -> Reading:
    """Return the loops of a scene.

    Raises
    ------
    EngineError
        If a joint makes no vector, a body hangs on nothing, there are more or fewer equations than unknowns, or an
        unknown has no estimate.
    """
    (angles, families), estimates = angle_families(scene.mechanism), Estimates(scene)
    chains = VectorChains(scene, angles, estimates)
    positions, left = _tree(scene, chains.chains, angles)
    loops = []
    for chain in left:
        out, back = (_point(positions, angles, c) for c in (chain, chain.turned_round()))
        loops.append(combined([*out, *chain.gap, *(v.times(-1.0) for v in back)]))
    unknowns = _unknowns(scene, loops, chains)
    points = [(point.body, estimates.local(point.body, point.position)) for point in scene.points]
    rows = [positions[body] for body in scene.wanted]
    rows += [combined([*positions[body], Vector(u, angle=angles[body])]) for body, u in points]
    return Reading(
        system=LoopSystem(unknowns, loops, chains.relations),
        q0=_guesses(scene, unknowns, angles, families, chains, estimates),
        places=Sums(rows, unknowns),
        angles=Variables([angles[body] for body in scene.wanted], unknowns),
        distance=_distance(scene, positions, angles, unknowns, estimates),
        size=estimates.size,
        origin=estimates.origin,
    )


def _refuse(scene: Scene, why: str) -> EngineError:
    return EngineRefusal(f"vector_loop refuses {scene.name!r}: {why}")


def _tree(
    scene: Scene, chains: Sequence[VectorChain], angles: Mapping[str, Variable]
) -> tuple[Positions, list[VectorChain]]:
    """Return the vectors to all bodies, breadth first so that they are short, and the chains that are left over."""
    positions: dict[str, Sequence[Vector]] = {GROUND: []}
    left, reached = list(chains), [GROUND]
    for body in reached:
        for chain in list(left):
            if body not in (chain.i, chain.j) or (chain.i in positions and chain.j in positions):
                continue
            left.remove(chain)
            out = chain if chain.i == body else chain.turned_round()
            to_frame = Vector(-out.p_j, angle=angles[out.j])
            positions[out.j] = combined([*_point(positions, angles, out), *out.gap, to_frame])
            reached.append(out.j)
    lost = [body.name for body in scene.mechanism.bodies if body.name not in positions]
    if lost:
        raise _refuse(scene, f"no joint leads from the ground to {', '.join(lost)}")
    return positions, left


def _point(positions: Positions, angles: Mapping[str, Variable], chain: VectorChain) -> list[Vector]:
    """Return what leads from the origin to the first point of a chain."""
    return [*positions[chain.i], Vector(chain.p_i, angle=angles[chain.i])]


def _unknowns(scene: Scene, loops: Sequence[Sequence[Vector]], chains: VectorChains) -> list[str]:
    """Return the names of what the equations contain, as many as there are equations."""
    variables = [v for loop in loops for vector in loop for v in (vector.angle, vector.length)]
    variables += [v for relation in chains.relations for _, v in relation.terms]
    names = list(dict.fromkeys(v.unknown for v in variables if v.unknown is not None))
    free = len(names) - 2 * len(loops) - len(chains.relations)
    if free:
        raise _refuse(scene, f"{-free} redundant constraints" if free < 0 else f"its loops leave {free} unknowns free")
    return names


def _guesses(
    scene: Scene,
    unknowns: Sequence[str],
    angles: Mapping[str, Variable],
    families: Mapping[str, Sequence[str]],
    chains: VectorChains,
    estimates: Estimates,
) -> Any:
    """Return the unknowns as the estimates have them; for a family of angles any member will do."""
    t0, guess_of = float(scene.times[0]), dict(chains.guesses)
    for name, members in families.items():
        apart = Variables([angles[body] for body in members], [name]).known(t0, 0)
        by_member = [estimates.frame(body)[1] - shift for body, shift in zip(members, apart, strict=True)]
        guess_of[name] = next((guess for guess in by_member if math.isfinite(guess)), math.nan)
    missing = [name for name in unknowns if not math.isfinite(guess_of[name])]
    if missing:
        raise _refuse(scene, f"no body has an estimate of the {', the '.join(missing)}")
    return np.array([guess_of[name] for name in unknowns], float)


def _distance(
    scene: Scene, positions: Positions, angles_of: Mapping[str, Variable], unknowns: Sequence[str], estimates: Estimates
) -> Callable[[Any], float]:
    t0 = float(scene.times[0])
    bodies = [body.name for body in scene.mechanism.bodies if body.estimate is not None]
    places = Sums([positions[body] for body in bodies], unknowns)
    angles = Variables([angles_of[body] for body in bodies], unknowns)
    there = [estimates.frame(body) for body in bodies]

    def distance(q: Any) -> float:
        apart = places.value(q, t0) - [r for r, _ in there]
        return math.hypot(*np.abs(apart), *(angles.at(q, t0) - [phi for _, phi in there]))

    return distance
