"""refkin's own fast path as a producer of its own: the compiled elimination program, held against the reference.

Independence does not apply, and this module may import `refkin.fast`: the program is traced from the joints' own
formulas, so it says nothing about them. What it does by itself, and what is checked here, is elimination, scheduling,
its own sines, the march, and the choice of a branch. A night that did not check it against the reference would not know
whether the path that a million mechanisms take is the path that was verified.

A scene that the program leaves to the reference is refused here: the reference would agree with itself. It does so near
change points and limits, also between the times that are asked for.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import replace
from typing import Any

import numpy as np

from crosscheck.engines import (
    ELEMENTS,
    NATIVE,
    Adapter,
    Capabilities,
    EngineRefusal,
    Level,
    Term,
    refuse_joints,
    refused,
    route_by,
)
from refkin.fast import attempt
from refkin.joints import GROUND, PLANE, TurnAboutAxis, elements_of
from refkin.model import Scene
from refkin.motion import Motion, Producer, Route

NO_ROWS = refused("its rows are the reference's own formulas")
U = 2.0**-53
SINES = 4.0
"""The error of a sine or cosine by the tangent of half its angle, in units of U."""
ROUTE = route_by("refkin", "program", "refkin.fast", linear_solve_by="refkin.fast")

CAPABILITIES: Capabilities = {key: {**dict.fromkeys(Level, NO_ROWS), Level.SOLVE: NATIVE} for key in ELEMENTS}


class Lanes(Adapter):
    """The compiled elimination program, one scene at a time."""

    name = "refkin-lanes"
    solving = (ROUTE,)
    table = CAPABILITIES

    def __init__(self) -> None:
        self._last: tuple[Scene, Motion] | None = None

    def terms(self, scene: Scene, route: Route | None = None) -> Sequence[Term]:
        """Return what carrying positions from body to body leaves of closing a loop, whichever row closes it."""
        if self._last is not None and self._last[0] is scene and scene.bodies_wanted is None:
            motion: Motion | None = self._last[1]  # it was solved just now: its angles are known
        else:
            motion = attempt(replace(scene, effects=frozenset(), evidence=frozenset(), bodies_wanted=None))
        if motion is None:
            return ()
        angle = max(1.0, float(np.max(np.abs(_angles(scene, motion)), initial=0.0)))
        points = [point for c in scene.mechanism.constraints for body, point in c.points() if body != GROUND]
        arms = sum(math.hypot(*point) for point in points) / scene.mechanism.size()
        sines = 2.0 * arms * math.sqrt(2.0) * SINES * U
        return (
            Term(
                name="tree",
                level="position",
                reason="poses are sums of arms along a tree, each arm turned by an angle that is rounded and by a sine "
                "from the tangent of half that angle; Newton stops at what this leaves, and the answer adds it again",
                absolute=sines + 2.0 * arms * angle * U,
            ),
            *(
                Term(
                    name="tree",
                    level=level,
                    reason="rates are sums of arms along that tree, too, each turned by such a sine",
                    of_rates=sines,
                )
                for level in ("velocity", "acceleration")
            ),
        )

    def solve(self, scene: Scene, route: Route | None = None) -> Motion:
        """Return the motion of a scene, as the program has it.

        Raises
        ------
        EngineError
            If a joint is unknown, or the program leaves the scene to the reference.
        """
        refuse_joints(self, scene, route, (ROUTE,))
        motion = attempt(replace(scene, evidence=frozenset()))
        if motion is None:
            doubt = "a pose or the branch is in doubt, and left to the reference"
            raise EngineRefusal(f"{self.name} refuses {scene.name!r}: {doubt}")
        self._last = scene, motion
        return replace(motion, producer=Producer(name=self.name, version=self.version(), route=ROUTE))


def _angles(scene: Scene, motion: Motion) -> Any:
    """Return the angles that a program takes sines of [rad]: coordinates in the plane, those of drivers in space."""
    if motion.kind is PLANE:
        return motion.q[2::3]
    turns = [e for e in elements_of(scene.mechanism.drivers) if isinstance(e, TurnAboutAxis)]
    return np.array([law(motion.t) for e in turns for law in e.laws])
