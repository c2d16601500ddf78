"""The vector-loop method as a peer: a second formulation of the same kinematics, without absolute coordinates.

The scene's joints become vectors, its loops equations in angles and slides (`crosscheck.engines.vector_loop`); Newton
is refkin's, on these equations; places of bodies follow from the chains of vectors, with two derivatives. It has no
rows in absolute coordinates. Of the scene's estimates it takes a start for the unknowns, and so the assembly and whole
turns.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np

from crosscheck.engines import (
    ELEMENTS,
    NATIVE,
    OF_SPACE,
    Adapter,
    Array,
    Capabilities,
    Level,
    refuse_joints,
    refused,
    route_by,
)
from crosscheck.engines.vector_loop.marching import LoopMarch, march
from crosscheck.engines.vector_loop.reading import Reading, read
from crosscheck.scenes.names import called_for
from refkin.model import Scene
from refkin.motion import Motion, PointMotion, Producer, Route, Status, engine_motion

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

    def solve(self, scene: Scene, route: Route | None = None) -> Motion:
        """Return the motion of a scene.

        Raises
        ------
        EngineError
            If a joint is refused, or the scene makes no square set of loops with an estimate of each unknown.
        """
        refuse_joints(self, scene, route, (ROUTE,))
        reading = read(scene)
        moved = march(reading.system, scene.times, reading.q0, reading.distance)
        places = _places(reading, moved)
        bodies = [_rows(reading, moved, place, order) for order, place in enumerate(places)]
        points = {point.name: _point(scene, places, k) for k, point in enumerate(scene.points, start=len(scene.wanted))}
        producer = Producer(name=self.name, version=self.version(), route=ROUTE)
        return engine_motion(
            scene.times,
            scene.wanted,
            *called_for(scene, bodies),
            moved.status,
            producer,
            residual=moved.residual,
            points=points,
            message=_message(moved),
        )


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


def _point(scene: Scene, places: Sequence[Any], k: int) -> PointMotion:
    r, v, a = called_for(scene, [np.array([level[k].real, level[k].imag]) for level in places])
    return PointMotion(r=r, v=v, a=a)
