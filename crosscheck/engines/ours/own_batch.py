"""Our own routes of the four-bars: the lanes, and the readable reference."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import replace
from functools import partial
from typing import Any

import numpy as np

from crosscheck.engines.batch_route import LEVELS, Absent, Route, of_four_bars, whole
from crosscheck.judge.of_batches import Piece
from crosscheck.scenes.works import FourBars
from refkin.model import Evidence, Scene
from refkin.motion import Motion
from refkin.solving.solve import solve

LANES = "refkin.fast"
BY = {False: "NumPy: all times at once", True: "NumPy: 10,000 mechanisms at once, time after time"}
TAPE = "elimination tape as NumPy calls; residual by the formulas, continuity and branch of every pose checked"
JUDGED = 1000
"""So many of many mechanisms are answered at once when they are judged: all answers of one call take memory."""
REFERENCE_MECHANISMS = 2
"""Of many mechanisms the reference does so many: it is a thousand times slower."""


def fast() -> Any:
    """Return the package of the fast paths.

    Raises
    ------
    Absent
        If it was deleted: nothing else needs it.
    """
    try:
        import refkin.fast as package
    except ImportError as error:
        raise Absent(f"no fast paths here: {error}") from error
    return package


def lanes(work: FourBars) -> Route:
    """Return the lanes: what the scene calls for, every pose verified, without evidence."""
    return _lanes("refkin-lanes", work, work.scene(), LEVELS, TAPE)


def lanes_position(work: FourBars) -> Route:
    """Return the lanes for a scene that calls for positions alone."""
    scene = replace(work.scene(), effects=frozenset())
    return _lanes(
        "refkin-lanes-position", work, scene, LEVELS[:1], "as refkin-lanes, of a scene that asks for no rates"
    )


def lanes_certificate(work: FourBars) -> Route:
    """Return the lanes with the certificate of every pose."""
    if work.mechanisms > 1:
        raise Absent("certificates are for scenes, one mechanism at a time")
    scene = replace(work.scene(), evidence=frozenset({Evidence.CERTIFICATE}))
    what = "as refkin-lanes, and a proof of every pose with certified radii"
    return _lanes("refkin-lanes-certificate", work, scene, (*LEVELS, "certificate"), what)


def reference(work: FourBars) -> Route:
    """Return the readable reference, dense, one pose after another."""
    part = work.first(REFERENCE_MECHANISMS)
    scenes = [part.scene(lane) for lane in range(part.mechanisms)]
    what = "dense 9x9 Newton on readable objects, branch-safe march"
    return _of_scenes("refkin-reference", part, scenes, solve, LEVELS, "Python: pose after pose", what)


def _lanes(name: str, work: FourBars, scene: Scene, computes: tuple[str, ...], what: str) -> Route:
    package = fast()
    by = BY[work.mechanisms > 1]
    if work.mechanisms == 1:
        if package.sweep(scene).producer.name != LANES:
            raise Absent("the lanes left this scene to the reference")
        return _of_scenes(name, work, [scene], package.sweep, computes, by, what)

    def solved(part: FourBars, reducer: Callable[[Any], Any]) -> Any:
        estimates = {body: part.starts[3 * k : 3 * k + 3] for k, body in enumerate(scene.wanted)}
        return package.solve_many(scene, part.geometry, estimates, reducer=reducer)

    def pieces() -> Iterator[Piece]:
        for first in range(0, work.mechanisms, JUDGED):
            part = replace(work, lengths=work.lengths[:, first : first + JUDGED])
            yield from solved(part, partial(_piece, first)).reduced

    def run() -> Any:
        return solved(work, _nothing)

    return of_four_bars(name, work, run, pieces, driven_by=by, what=what, computes=computes)


def _nothing(part: Any) -> None:
    """Keep nothing of a reducer's slice."""


def _piece(first: int, part: Any) -> Piece:
    """Return a copy of a reducer's slice of the mechanisms from `first` on."""
    mechanisms = first + np.arange(part.lanes.start, part.lanes.stop)
    levels = [np.array(level) for level in (part.q, part.qd, part.qdd) if level is not None]
    return Piece(mechanisms, np.full(len(mechanisms), part.k), range(9), tuple(levels))


def _of_scenes(
    name: str,
    work: FourBars,
    scenes: list[Scene],
    solved: Callable[[Scene], Motion],
    computes: tuple[str, ...],
    driven_by: str,
    what: str,
) -> Route:
    """Return the route of something that solves one scene at a time."""

    def pieces() -> Iterator[Piece]:
        for lane, scene in enumerate(scenes):
            motion = solved(scene)
            levels = [level[:, None] for level in motion.levels if level is not None]
            yield whole(work, np.array([lane]), levels)

    return of_four_bars(
        name,
        work,
        lambda: [solved(scene) for scene in scenes],
        pieces,
        driven_by=driven_by,
        what=what,
        computes=computes,
    )
