"""The independent closed form as an engine: class-II linkages, dyad by dyad, in float64.

It iterates on nothing and has no constraint rows, so it is the arbiter of the others' formulas; see
`crosscheck.engines.closed_form`. Of the scene's estimates it takes the assembly of each dyad (the sign of the dyad's
loop Jacobian) and the whole turns of each angle at the first time, and nothing else; the sign is kept over all times.
Once a motion has met a pose where the sign can change, or that it cannot reach, also between two times, the branch is
lost (`.solution`). A dyad without an estimate gets the positive orientation, and the message
says so.

Every number is a jet of value and two derivatives, so velocities and accelerations are computed of every scene, and
cost no more where they are called for.

Beyond class II (three bodies that close only together) a scene is refused by name, and so is a redundant one.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from typing import Any

import numpy as np
from flint import ctx

from crosscheck.engines import (
    NATIVE,
    OF_SPACE,
    Adapter,
    Array,
    Capabilities,
    EngineError,
    EngineRefusal,
    Term,
    answered,
    by_level,
    in_space,
    refused,
    route_by,
)
from crosscheck.engines.closed_form.assemble import NotDyadic
from crosscheck.engines.closed_form.jets import Balls, Jet, Planar
from crosscheck.engines.closed_form.solution import Solution, assembled, float_solution, rows_of
from crosscheck.engines.closed_form.space_motion import BITS, space_closed
from refkin.joints import elements_of
from refkin.model import Scene
from refkin.motion import Motion, Producer, Route, Status

NO_ROWS = refused("a closed form has no constraint rows")
EXPRESSED = (
    *("points coincide", "point on line", "distance", "distance by a law"),
    *("coordinate by a law", "angle", "angle by a law"),
    *OF_SPACE,
)
"""The elements that it has."""

ROUTE = route_by("closed form", "float", "none", linear_solve_by="closed form", drift_by="second-order jets")

OPEN = 1e-6
"""Closure of the loops, relative to the scaled coordinates, above which floats show a fault of this program."""


CHORDS = Term(
    name="chords",
    level="position",
    reason="an area by its four factors, a root and an arctangent stand for each residual: three times its "
    "roundings; "
    "and a frame is placed from either end of its chain, each arm up to one size",
    relative=2.0,
    absolute=8.0 * 2.0**-53,
)
JETS = tuple(
    Term(
        name="jets",
        level=level,
        reason="root, quotient and arctangent of second-order jets: four steps of four products of up to four terms "
        "each",
        relative=64.0 * 2.0**-53,
    )
    for level in ("velocity", "acceleration")
)
"""In space. In the plane rates keep each row to the rounding of its own terms (`linkage`), as all are allowed to."""


def _frames(scene: Scene) -> Term:
    """Return what composing frames of space leaves of its conditions."""
    rows = sum(element.rows for element in elements_of(scene.mechanism.constraints))
    choice = CHOICE if rows > 6 * len(scene.mechanism.bodies) else 1.0
    return Term(
        name="frames",
        level="position",
        reason="a frame of space is one of a joint, a turn, another of a joint, and the frame before: three products, "
        "each entry a sum of three (5 roundings), met from either end by arms and axes of up to one size; where rows "
        "are redundant it solves some of them, whose inverse is up to three times as large as that of all",
        absolute=choice * 32.0 * 2.0**-53,
    )


CHOICE = 3.0
"""How much larger the inverse of as many rows as there are coordinates may be than that of all of them together."""


CAPABILITIES: Capabilities = dict.fromkeys(EXPRESSED, by_level(NO_ROWS, NATIVE))


class ClosedForm(Adapter):
    """Closed forms in float64; balls decide whether nothing assembles."""

    name = "closed_form"
    solving, table = (ROUTE,), CAPABILITIES

    def terms(self, scene: Scene, route: Route | None = None) -> Sequence[Term]:
        """Return the rounding of positions, and in space of frames and of the jets that carry rates through roots."""
        return (CHORDS, *JETS, _frames(scene)) if in_space(scene.mechanism) else (CHORDS,)

    def answer(self, scene: Scene, producer: Producer) -> Motion:
        """Return the motion of a scene, of the plane by dyads; one is refused that is redundant, or not of class II."""
        if in_space(scene.mechanism):
            return space_closed(scene, producer)
        extra = sum(c.rows for c in scene.mechanism.constraints) - 3 * len(scene.mechanism.bodies)
        if extra > 0:
            raise EngineRefusal(f"closed_form refuses {scene.name!r}: {extra} redundant constraint{'s' * (extra > 1)}")
        with np.errstate(all="ignore"):  # NaN and inf become statuses
            try:
                solution = float_solution(scene)
            except NotDyadic as error:
                raise EngineRefusal(f"closed_form refuses {scene.name!r}: {error}") from error
            return _motion(solution, producer)


def _motion(solution: Solution, producer: Producer) -> Motion:
    scene = solution.scene
    poses = [solution.ground.bodies[name] for name in scene.wanted]
    jets = [jet for pose in poses for jet in (*_in_scene(solution, pose.origin), pose.angle)]
    levels = _levels(jets, len(scene.times))
    status = _status(solution, levels)
    _blank(levels, status)
    residual, points = _residual(solution, levels, status), _points(solution, status)
    message = "; ".join(solution.assembly.remarks)
    return answered(scene, levels, points, status, producer, message=message, residual=residual)


def _in_scene(solution: Solution, place: Planar) -> tuple[Jet, Jet]:
    x, y = map(Jet, solution.assembly.linkage.origin)
    return place.x + x, place.y + y


def _levels(jets: list[Jet], count: int) -> list[Array]:
    """Return value, rate and acceleration of the jets as float arrays (n, T)."""
    return [rows_of([getattr(jet, part) for jet in jets], count) for part in "vda"]


def _status(solution: Solution, levels: list[Array]) -> tuple[Status, ...]:
    """Return what is known: first non-assembly, then singular (no number came out), then lost branch, unsure turns.

    A dyad behind a nearly singular one may have lost half of its digits: then its negative slack proves nothing.
    """
    assembly = solution.assembly
    finite = np.all([np.isfinite(level).all(axis=0) for level in levels], axis=0)
    unsure, lost = (np.array(solution.scene.times) > end for end in (solution.sure_until, solution.lost_after))
    if lost.any():
        assembly.remarks.append(
            f"two assemblies meet, or there is none, at t = {solution.lost_after:.17g} s: branch lost"
        )
    if unsure.any():
        assembly.remarks.append(f"the turns of an angle are unsure after t = {solution.sure_until:.17g} s")
    unproved = assembly.absent & ~_proved_absent(solution) if assembly.absent.any() else assembly.absent
    if unproved.any():
        assembly.remarks.append(f"not proved at {unproved.sum()} times")
    status = np.where(unsure, Status.NOT_CONVERGED, Status.OK)
    status = np.where(lost, Status.BRANCH_LOST, status)
    status = np.where(assembly.singular | ~finite, Status.SINGULAR, status)
    status = np.where(assembly.absent, Status.UNASSEMBLABLE, status)
    return tuple(map(Status, np.where(unproved, Status.NOT_CONVERGED, status).tolist()))


def _proved_absent(solution: Solution) -> Any:
    """Return at which times balls prove that a dyad does not close (T,)."""
    with ctx.workprec(BITS):
        return assembled(solution.scene, Balls(), lambda k: solution.assembly.known_angles[k]).absent


def _blank(levels: list[Array], status: tuple[Status, ...]) -> None:
    """Take away what a status says is not known: the rates if singular, all if there is no pose."""
    absent = np.array([word not in (Status.OK, Status.SINGULAR) for word in status])
    known = np.array([word is Status.OK for word in status])
    for order, level in enumerate(levels):
        level[:, absent if order == 0 else ~known] = np.nan


def _residual(solution: Solution, levels: list[Array], status: tuple[Status, ...]) -> Array:
    """Return the largest gap per time; EngineError if a joint is open although every dyad was placed: a fault here."""
    gaps: Array = np.abs(solution.closure).max(axis=0)
    known = np.array([word is Status.OK for word in status])
    size = np.tile([solution.scene.mechanism.size()] * 2 + [1.0], len(solution.scene.wanted))[:, None]
    largest = np.abs(levels[0] / size).max(axis=0)
    if not (gaps[known] < OPEN * np.maximum(1.0, largest[known])).all():
        raise EngineError(
            f"closed_form: {solution.scene.name!r}: a joint is left open by {np.nanmax(gaps[known]):.3g} sizes"
        )
    return gaps


def _points(solution: Solution, status: tuple[Status, ...]) -> Iterator[list[Array]]:
    for point in solution.scene.points:
        place = solution.ground.bodies[point.body].point(Planar(*map(Jet, point.position)))
        levels = _levels(list(_in_scene(solution, place)), len(solution.scene.times))
        _blank(levels, status)
        yield levels
