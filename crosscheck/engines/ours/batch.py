"""refkin's own fast path as a producer of its own: the compiled elimination program, held against the reference.

Independence does not apply, and this module may import `refkin.fast`: the program is traced from the joints' own
formulas, so it says nothing about them. What it does by itself, and what is checked here, is elimination, scheduling,
its own sines, the march, and the choice of a branch. A night that did not check it against the reference would not know
whether the path that a million mechanisms take is the path that was verified.

A scene that the program leaves to the reference is refused here: the reference would agree with itself. It does so near
change points and limits, also between the times that are asked for.

Its methods answer all times of a scene at once, many mechanisms at once, or make a chain's Newton iteration.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator, Sequence
from dataclasses import replace
from functools import cache, partial
from typing import Any

import numpy as np

from crosscheck.engines import (
    ELEMENTS,
    NATIVE,
    Adapter,
    Capabilities,
    EngineError,
    EngineRefusal,
    Term,
    by_level,
    refused,
    route_by,
)
from crosscheck.engines.methods import ORDERS, Batch, Method, Model, Use, levels_of, of_routes, one_by_one
from crosscheck.engines.ours import chains
from crosscheck.scenes.workloads import AnswerPiece, FourBars, LoopChain, Workload
from crosscheck.scenes.workloads_space import SpatialLoops
from refkin.fast import attempt, solve_many
from refkin.fast.compiled import forget
from refkin.fast.prepare import prepared
from refkin.joints import GROUND, PLANE, TurnAboutAxis, elements_of
from refkin.model import Evidence, Scene
from refkin.motion import Motion, Producer, Route

NO_ROWS = refused("its rows are the reference's own formulas")
U = 2.0**-53
SINES = 4.0
"""The error of a sine or cosine by the tangent of half its angle, in units of U."""
ROUTE = route_by("refkin", "program", "refkin.fast", linear_solve_by="refkin.fast")

AT_ONCE = "all times at once"
IN_TURN = "one mechanism after the other, one program for all of them with the numbers of each: not `solve_many`"
"""What is done of many mechanisms of space."""
COUNTED = 1000
"""So many of many mechanisms are answered at once when they are judged: all answers of one call take memory."""
EVIDENCE: dict[str, frozenset[Evidence]] = {
    "no evidence": frozenset(),
    "certificate": frozenset({Evidence.CERTIFICATE}),
}

CAPABILITIES: Capabilities = dict.fromkeys(ELEMENTS, by_level(NO_ROWS, NATIVE))


class RefkinBatch(Adapter):
    """The compiled elimination program, one scene at a time."""

    name = "refkin-batch"
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
        sines = arms * math.sqrt(2.0) * SINES
        return (
            Term(
                name="tree",
                level="position",
                reason="poses are sums of arms along a tree, each arm turned by an angle that is rounded and by a sine "
                "from the tangent of half that angle; Newton stops at what this leaves, and the answer adds it again",
                absolute=2.0 * (sines + arms * angle) * U,
            ),
        )

    def answer(self, scene: Scene, producer: Producer) -> Motion:
        """Return the motion of a scene, as the program has it; EngineError if it leaves it to the reference."""
        motion = attempt(replace(scene, evidence=frozenset()))
        if motion is None:
            doubt = "a pose or the branch is in doubt, and left to the reference"
            raise EngineRefusal(f"{self.name} refuses {scene.name!r}: {doubt}")
        self._last = scene, motion
        return replace(motion, producer=producer)


def _angles(scene: Scene, motion: Motion) -> Any:
    """Return the angles that a program takes sines of [rad]: coordinates in the plane, those of drivers in space."""
    if motion.kind is PLANE:
        return motion.q[2::3]
    turns = [e for e in elements_of(scene.mechanism.drivers) if isinstance(e, TurnAboutAxis)]
    return np.array([law(motion.t) for e in turns for law in e.laws])


def methods() -> Iterator[Method]:
    """Yield the methods of the fast path."""
    yield from of_routes(RefkinBatch(), frozenset({Use.COMPARE, Use.EFFECTS, Use.HARD}))
    for setting, evidence in EVIDENCE.items():
        yield Method(
            engine=RefkinBatch.name,
            name=AT_ONCE,
            setting=setting,
            newton_by="refkin (compiled elimination)",
            uses=frozenset({Use.PRICE, Use.BENCH}),
            build=partial(_compiled, evidence),
            batch=partial(_batched, evidence),
            together=True,
            note="compiled list of instructions as NumPy calls; every pose checked by the formulas",
        )
    yield Method(
        engine=RefkinBatch.name,
        name="sparse",
        newton_by="refkin (SuperLU with COLAMD)",
        uses=frozenset({Use.BENCH}),
        batch=chains.sparse,
        at_once=True,
        note="assembly grouped by joint type into fixed columns, SuperLU with COLAMD",
    )


def _compiled(evidence: frozenset[Evidence], scene: Scene, *, anew: bool = True) -> Model:
    if anew:
        forget()  # so that building the model is what it is for a topology that nobody has used yet
    plain = replace(scene, evidence=evidence, points=(), bodies_wanted=None)
    ready = prepared(plain)
    if ready is None or not (ready.made.program.counts() and ready.made.march):
        raise EngineError("the compiled path leaves this scene to refkin.solve")

    @cache
    def made(order: int) -> Any:
        return prepared(replace(plain, effects=ORDERS[order]))

    def solve(order: int) -> Any:
        answer = None if (again := made(order)) is None else attempt(again)
        if answer is None:
            raise EngineError("the compiled path leaves this scene to refkin.solve")
        return answer

    return Model(solve, levels_of)


def _batched(evidence: frozenset[Evidence], workload: Workload, order: int) -> Batch:
    if isinstance(workload, LoopChain):
        if evidence:
            raise EngineError("a Newton iteration has no certificate")
        return chains.by_program(workload)
    if workload.mechanisms == 1:
        return one_by_one(partial(_compiled, evidence), workload, order)
    if isinstance(workload, SpatialLoops):
        build = partial(_compiled, evidence, anew=False)
        return one_by_one(build, workload, order, workload.configurations, IN_TURN)
    return _many(evidence, workload, order)


def _many(evidence: frozenset[Evidence], work: FourBars, order: int) -> Batch:
    scene = replace(work.scene(), effects=ORDERS[order], evidence=evidence)

    def solved(part: FourBars, reducer: Callable[[Any], Any]) -> Any:
        estimates = {body: part.starts[3 * k : 3 * k + 3] for k, body in enumerate(scene.wanted)}
        return solve_many(scene, part.geometry, estimates, reducer=reducer)

    def pieces() -> Iterator[AnswerPiece]:
        for first in range(0, work.mechanisms, COUNTED):
            part = replace(work, lengths=work.lengths[:, first : first + COUNTED])
            yield from solved(part, partial(_piece, first)).reduced

    return Batch(lambda: solved(work, lambda part: None), work.configurations, pieces)


def _piece(first: int, part: Any) -> AnswerPiece:
    """Return a copy of a reducer's slice of the mechanisms from `first` on."""
    mechanisms = first + np.arange(part.samples.start, part.samples.stop)
    levels = [np.array(level) for level in (part.q, part.qd, part.qdd) if level is not None]
    return AnswerPiece(mechanisms, np.full(len(mechanisms), part.k), range(9), tuple(levels))
