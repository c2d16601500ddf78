"""The fast path's methods: all times of a scene at once, many mechanisms at once, a chain's Newton iteration."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import replace
from functools import cache, partial
from typing import Any

import numpy as np

from crosscheck.engines import EngineError
from crosscheck.engines.methods import ORDERS, Batch, Method, Model, Use, levels_of, of_routes, one_by_one
from crosscheck.engines.ours import chains
from crosscheck.engines.ours.lanes import Lanes
from crosscheck.scenes.workloads import Chain, FourBars, Piece, Workload
from crosscheck.scenes.workloads_space import SpatialLoops
from refkin.model import Evidence, Scene

ENGINE = "refkin-lanes"
AT_ONCE = "all times at once"
IN_TURN = "one mechanism after the other, one program for all of them with the numbers of each: not `solve_many`"
"""What is done of many mechanisms of space."""
COUNTED = 1000
"""So many of many mechanisms are answered at once when they are judged: all answers of one call take memory."""
EVIDENCE: dict[str, frozenset[Evidence]] = {
    "no evidence": frozenset(),
    "certificate": frozenset({Evidence.CERTIFICATE}),
}


def methods() -> Iterator[Method]:
    """Yield the methods of the fast path."""
    yield from of_routes(Lanes(), frozenset({Use.COMPARE, Use.EFFECTS, Use.HARD}))
    for setting, evidence in EVIDENCE.items():
        yield Method(
            engine=ENGINE,
            name=AT_ONCE,
            setting=setting,
            newton_by="refkin (compiled elimination)",
            uses=frozenset({Use.PRICE, Use.BENCH}),
            build=partial(_compiled, evidence),
            batch=partial(_batched, evidence),
            note="compiled list of instructions as NumPy calls; every pose checked by the formulas",
        )
    yield Method(
        engine=ENGINE,
        name="sparse",
        newton_by="refkin (SuperLU with COLAMD)",
        uses=frozenset({Use.BENCH}),
        batch=chains.sparse,
        at_once=True,
        note="assembly grouped by joint type into fixed columns, SuperLU with COLAMD",
    )


def _compiled(evidence: frozenset[Evidence], scene: Scene, *, anew: bool = True) -> Model:
    from refkin.fast import attempt
    from refkin.fast.compiled import forget
    from refkin.fast.prepare import prepared

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
        answer = attempt(made(order))
        if answer is None:
            raise EngineError("the compiled path leaves this scene to refkin.solve")
        return answer

    return Model(solve, levels_of)


def _batched(evidence: frozenset[Evidence], workload: Workload, order: int) -> Batch:
    if isinstance(workload, Chain):
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
    from refkin.fast import solve_many

    scene = replace(work.scene(), effects=ORDERS[order], evidence=evidence)

    def solved(part: FourBars, reducer: Callable[[Any], Any]) -> Any:
        estimates = {body: part.starts[3 * k : 3 * k + 3] for k, body in enumerate(scene.wanted)}
        return solve_many(scene, part.geometry, estimates, reducer=reducer)

    def pieces() -> Iterator[Piece]:
        for first in range(0, work.mechanisms, COUNTED):
            part = replace(work, lengths=work.lengths[:, first : first + COUNTED])
            yield from solved(part, partial(_piece, first)).reduced

    return Batch(lambda: solved(work, lambda part: None), work.configurations, pieces)


def _piece(first: int, part: Any) -> Piece:
    """Return a copy of a reducer's slice of the mechanisms from `first` on."""
    mechanisms = first + np.arange(part.samples.start, part.samples.stop)
    levels = [np.array(level) for level in (part.q, part.qd, part.qdd) if level is not None]
    return Piece(mechanisms, np.full(len(mechanisms), part.k), range(9), tuple(levels))
