"""A scene as vector loops: a spanning tree of ways to every body, and one loop for each way that is left.

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
from crosscheck.engines.vector_loop.families import Families, angle_families
from crosscheck.engines.vector_loop.system import LoopSystem
from crosscheck.engines.vector_loop.vectors import Sums, Variable, Variables, Vector, combined
from crosscheck.engines.vector_loop.ways import Estimates, Way, Ways
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


Chains = Mapping[str, Sequence[Vector]]
"""Body -> the vectors that lead from the origin to its frame."""


def read(scene: Scene) -> Reading:
    """Return the loops of a scene.

    Raises
    ------
    EngineError
        If a joint makes no vector, a body hangs on nothing, there are more or fewer equations than unknowns, or an
        unknown has no estimate.
    """
    families, estimates = angle_families(scene.mechanism), Estimates(scene)
    ways = Ways(scene, families.angles, estimates)
    chains, left = _tree(scene, ways.ways, families.angles)
    loops = [combined([*_point(chains, families.angles, w), *w.gap, *_back(chains, families.angles, w)]) for w in left]
    unknowns = _unknowns(scene, loops, ways)
    points = [(point.body, estimates.local(point.body, point.position)) for point in scene.points]
    rows = [chains[body] for body in scene.wanted]
    rows += [combined([*chains[body], Vector(u, angle=families.angles[body])]) for body, u in points]
    return Reading(
        system=LoopSystem(unknowns, loops, ways.relations),
        q0=_guesses(scene, unknowns, families, ways, estimates),
        places=Sums(rows, unknowns),
        angles=Variables([families.angles[body] for body in scene.wanted], unknowns),
        distance=_distance(scene, chains, families, unknowns, estimates),
        size=estimates.size,
        origin=estimates.origin,
    )


def _refuse(scene: Scene, why: str) -> EngineError:
    return EngineRefusal(f"vector_loop refuses {scene.name!r}: {why}")


def _tree(scene: Scene, ways: Sequence[Way], angles: Mapping[str, Variable]) -> tuple[Chains, list[Way]]:
    """Return the chains to all bodies, breadth first so that they are short, and the ways that are left over."""
    chains: dict[str, Sequence[Vector]] = {GROUND: []}
    left, reached = list(ways), [GROUND]
    for body in reached:
        for way in list(left):
            if body not in (way.i, way.j) or (way.i in chains and way.j in chains):
                continue
            left.remove(way)
            out = way if way.i == body else way.turned_round()
            to_frame = Vector(-out.p_j, angle=angles[out.j])
            chains[out.j] = combined([*_point(chains, angles, out), *out.gap, to_frame])
            reached.append(out.j)
    lost = [body.name for body in scene.mechanism.bodies if body.name not in chains]
    if lost:
        raise _refuse(scene, f"no joint leads from the ground to {', '.join(lost)}")
    return chains, left


def _point(chains: Chains, angles: Mapping[str, Variable], way: Way) -> list[Vector]:
    """Return what leads from the origin to the first point of a way."""
    return [*chains[way.i], Vector(way.p_i, angle=angles[way.i])]


def _back(chains: Chains, angles: Mapping[str, Variable], way: Way) -> list[Vector]:
    """Return what leads from the second point of a way to the origin."""
    return [v.times(-1.0) for v in _point(chains, angles, way.turned_round())]


def _unknowns(scene: Scene, loops: Sequence[Sequence[Vector]], ways: Ways) -> list[str]:
    """Return the names of what the equations contain, as many as there are equations."""
    variables = [v for loop in loops for vector in loop for v in (vector.angle, vector.length)]
    variables += [v for relation in ways.relations for _, v in relation.terms]
    names = list(dict.fromkeys(v.unknown for v in variables if v.unknown is not None))
    free = len(names) - 2 * len(loops) - len(ways.relations)
    if free:
        raise _refuse(scene, f"{-free} redundant constraints" if free < 0 else f"its loops leave {free} unknowns free")
    return names


def _guesses(scene: Scene, unknowns: Sequence[str], families: Families, ways: Ways, estimates: Estimates) -> Any:
    """Return the unknowns as the estimates have them; for a family of angles any member will do."""
    t0, guess_of = float(scene.times[0]), dict(ways.guesses)
    for name, members in families.members.items():
        apart = Variables([families.angles[body] for body in members], [name]).known(t0, 0)
        by_member = [estimates.frame(body)[1] - shift for body, shift in zip(members, apart, strict=True)]
        guess_of[name] = next((guess for guess in by_member if math.isfinite(guess)), math.nan)
    missing = [name for name in unknowns if not math.isfinite(guess_of[name])]
    if missing:
        raise _refuse(scene, f"no body has an estimate of the {', the '.join(missing)}")
    return np.array([guess_of[name] for name in unknowns], float)


def _distance(
    scene: Scene, chains: Chains, families: Families, unknowns: Sequence[str], estimates: Estimates
) -> Callable[[Any], float]:
    t0 = float(scene.times[0])
    bodies = [body.name for body in scene.mechanism.bodies if body.estimate is not None]
    places = Sums([chains[body] for body in bodies], unknowns)
    angles = Variables([families.angles[body] for body in bodies], unknowns)
    there = [estimates.frame(body) for body in bodies]

    def distance(q: Any) -> float:
        apart = places.value(q, t0) - [r for r, _ in there]
        return math.hypot(*np.abs(apart), *(angles.at(q, t0) - [phi for _, phi in there]))

    return distance
