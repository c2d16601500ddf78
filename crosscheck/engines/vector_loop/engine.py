"""The vector-loop method as a peer: a second formulation of the same kinematics, without absolute coordinates.

The scene's joints become vectors, its loops equations in angles and slides (`crosscheck.engines.vector_loop`):
a spanning tree of vector chains leads to every body, and each chain that is left makes one loop. What the two ends of a
loop have in common cancels, so no body's place is ever an unknown, and no body that only the input moves has an
equation. Newton is refkin's, on these equations; places of bodies follow from the chains of vectors, with two
derivatives. It has no rows in absolute coordinates. Of the scene's estimates it takes a start for the unknowns, and so
the assembly and whole turns.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from crosscheck.engines import (
    ELEMENTS,
    NATIVE,
    OF_SPACE,
    Adapter,
    Array,
    Capabilities,
    EngineError,
    EngineRefusal,
    KeptModel,
    Level,
    answered,
    refused,
    route_by,
)
from crosscheck.engines.vector_loop.chains import Estimates, VectorChain, VectorChains, angle_families
from crosscheck.engines.vector_loop.marching import LoopMarch, march
from crosscheck.engines.vector_loop.system import LoopSystem
from crosscheck.engines.vector_loop.vectors import LoopVector, Sums, Variables, combined
from refkin.joints import GROUND
from refkin.model import Scene
from refkin.motion import Motion, Producer, Status


class Reading:
    """A scene in loops, lengths in units of `size` [m], places on the ground counted from `origin` [m].

    `q0` (n,) are the unknowns at the first time by the bodies' estimates. Rows of `places` are the origins of wanted
    bodies, which `angles` are of, then the scene's points. A scene is refused if a joint makes no vector, a body hangs
    on nothing, there are more or fewer equations than unknowns, or an unknown has no estimate.
    """

    def __init__(self, scene: Scene) -> None:
        self.scene, self.estimates, self.t0 = scene, Estimates(scene), float(scene.times[0])
        self.size, self.origin = self.estimates.size, self.estimates.origin
        self.angle_of, families = angle_families(scene.mechanism)
        chains = VectorChains(scene, self.angle_of, self.estimates)
        self.positions: dict[str, Sequence[LoopVector]] = {GROUND: []}  # what leads from the origin to its frame
        loops = []
        for chain in self._left_of(chains.chains):
            out, back = (self._first_point(c) for c in (chain, chain.turned_round()))
            loops.append(combined([*out, *chain.gap, *(v.times(-1.0) for v in back)]))
        unknowns = self._unknowns(loops, chains)
        points = [(point.body, self.estimates.local(point.body, point.position)) for point in scene.points]
        rows = [self.positions[body] for body in scene.wanted]
        rows += [combined([*self.positions[body], LoopVector(u, angle=self.angle_of[body])]) for body, u in points]
        self.system = LoopSystem(unknowns, loops, chains.relations)
        self.q0 = self._guesses(unknowns, families, dict(chains.guesses))
        self.places = Sums(rows, unknowns)
        self.angles = Variables([self.angle_of[body] for body in scene.wanted], unknowns)
        bodies = [body.name for body in scene.mechanism.bodies if body.estimate is not None]
        self._known = Sums([self.positions[body] for body in bodies], unknowns)
        self._known_angles = Variables([self.angle_of[body] for body in bodies], unknowns)
        self._there = [self.estimates.frame(body) for body in bodies]

    def distance(self, q: Any) -> float:
        """Return how far given unknowns put the bodies from their estimates at the first time."""
        apart = self._known.value(q, self.t0) - [r for r, _ in self._there]
        turned = self._known_angles.at(q, self.t0) - [phi for _, phi in self._there]
        return math.hypot(*np.abs(apart), *turned)

    def _refusal(self, why: str) -> EngineError:
        return EngineRefusal(f"vector_loop refuses {self.scene.name!r}: {why}")

    def _left_of(self, chains: Sequence[VectorChain]) -> list[VectorChain]:
        """Find the vectors to all bodies, breadth first so that they are short; return the chains left over."""
        left, reached = list(chains), [GROUND]
        for body in reached:
            for chain in list(left):
                if body not in (chain.i, chain.j) or (chain.i in self.positions and chain.j in self.positions):
                    continue
                left.remove(chain)
                out = chain if chain.i == body else chain.turned_round()
                to_frame = LoopVector(-out.p_j, angle=self.angle_of[out.j])
                self.positions[out.j] = combined([*self._first_point(out), *out.gap, to_frame])
                reached.append(out.j)
        lost = [body.name for body in self.scene.mechanism.bodies if body.name not in self.positions]
        if lost:
            raise self._refusal(f"no joint leads from the ground to {', '.join(lost)}")
        return left

    def _first_point(self, chain: VectorChain) -> list[LoopVector]:
        """Return what leads from the origin to the first point of a chain."""
        return [*self.positions[chain.i], LoopVector(chain.p_i, angle=self.angle_of[chain.i])]

    def _unknowns(self, loops: Sequence[Sequence[LoopVector]], chains: VectorChains) -> list[str]:
        """Return the names of what the equations contain, as many as there are equations."""
        variables = [v for loop in loops for vector in loop for v in (vector.angle, vector.length)]
        variables += [v for relation in chains.relations for _, v in relation.terms]
        names = list(dict.fromkeys(v.unknown for v in variables if v.unknown is not None))
        free = len(names) - 2 * len(loops) - len(chains.relations)
        if free:
            why = f"{-free} redundant constraints" if free < 0 else f"its loops leave {free} unknowns free"
            raise self._refusal(why)
        return names

    def _guesses(self, unknowns: list[str], families: Mapping[str, Sequence[str]], guess_of: dict[str, float]) -> Any:
        """Return the unknowns as the estimates have them; for a family of angles any member will do."""
        for name, members in families.items():
            apart = Variables([self.angle_of[body] for body in members], [name]).known(self.t0, 0)
            by_member = [self.estimates.frame(body)[1] - shift for body, shift in zip(members, apart, strict=True)]
            guess_of[name] = next((guess for guess in by_member if math.isfinite(guess)), math.nan)
        missing = [name for name in unknowns if not math.isfinite(guess_of[name])]
        if missing:
            raise self._refusal(f"no body has an estimate of the {', the '.join(missing)}")
        return np.array([guess_of[name] for name in unknowns], float)


ROUTE = route_by("vector loops", "loop closure", "refkin.newton")

NO_ROWS = refused("its rows are loops of vectors, not joints in absolute coordinates")
NO_CONTACT = refused("no vector of given or sliding length stands for a contact on a general profile")
NO_SPACE = refused("its vectors are complex numbers: of the plane")

REFUSALS = {"contact": NO_CONTACT, **dict.fromkeys(OF_SPACE, NO_SPACE)}
CAPABILITIES: Capabilities = {
    key: {**dict.fromkeys(Level, NO_ROWS), Level.SOLVE: REFUSALS.get(key, NATIVE)} for key in ELEMENTS
}


class VectorLoop(Adapter):
    """Loop-closure equations, solved by Newton."""

    name = "vector_loop"
    solving, table = (ROUTE,), CAPABILITIES
    kept = dict.fromkeys(solving, "")

    def built(self, scene: Scene, producer: Producer) -> KeptModel:
        """Return the scene as loops of vectors."""
        return LoopModel(Reading(scene), producer)


@dataclass(frozen=True)
class LoopModel(KeptModel):
    """A scene in loops, to be solved by Newton."""

    reading: Reading
    producer: Producer

    def solve(self, scene: Scene) -> Motion:
        reading = self.reading
        moved = march(reading.system, scene.times, reading.q0, reading.distance)
        places = _places(reading, moved)
        bodies = [_rows(reading, moved, place, order) for order, place in enumerate(places)]
        moving = zip(*(level[len(scene.wanted) :] for level in places), strict=True)
        of_points = ([np.array([r.real, r.imag]) for r in levels] for levels in moving)
        more = {"residual": moved.residual, "message": _message(moved)}
        return answered(scene, bodies, of_points, moved.status, self.producer, **more)


def _message(moved: LoopMarch) -> str:
    if moved.reached == len(moved.t):
        return ""
    if not moved.reached:
        return f"Newton closed the loops from no estimate at t = {moved.t[0]:.17g}"
    return f"the branch was not followed beyond t = {moved.t[moved.reached - 1]:.17g}"


def _places(reading: Reading, moved: LoopMarch) -> list[Any]:
    """Return origins of bodies, then points, as complex numbers [m] with two derivatives; NaN where none is known."""
    sums, t = reading.places, moved.t
    levels = [
        sums.value(moved.q, t) * reading.size + reading.origin,
        sums.rate(moved.q, moved.qd, t) * reading.size,
        sums.acceleration(moved.q, moved.qd, moved.qdd, t) * reading.size,
    ]
    for order, level in enumerate(levels):
        level[:, _unknown(moved, order)] = np.nan
    return levels


def _rows(reading: Reading, moved: LoopMarch, place: Any, order: int) -> Array:
    """Return x, y [m], phi [rad] of the wanted bodies, or their derivatives, (3 n, T)."""
    count = len(reading.angles.variables)
    rows = np.empty((3 * count, len(moved.t)))
    rows[0::3], rows[1::3] = place[:count].real, place[:count].imag
    rows[2::3] = reading.angles.at((moved.q, moved.qd, moved.qdd)[order], moved.t, order)
    rows[:, _unknown(moved, order)] = np.nan
    return rows


def _unknown(moved: LoopMarch, order: int) -> Any:
    """Return at which times a level has no answer: a body that only the input moves has none there, either."""
    with_answer = (Status.OK, Status.SINGULAR) if order == 0 else (Status.OK,)
    return np.array([status not in with_answer for status in moved.status])
