"""The independent closed form as an engine: class-II linkages, dyad by dyad, in float64 or in proven balls.

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

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from flint import arb, ctx
from numpy.typing import NDArray

from crosscheck.engines import (
    NATIVE,
    OF_SPACE,
    Adapter,
    Capabilities,
    EngineError,
    EngineRefusal,
    Level,
    Term,
    refusals,
    refuse,
    refused,
    route_by,
)
from crosscheck.engines.closed_form.assemble import NotDyadic
from crosscheck.engines.closed_form.jets import Balls, Jet, Planar, midpoint
from crosscheck.engines.closed_form.solution import Solution, float_solution, solve
from crosscheck.engines.closed_form.space_motion import space_closed
from crosscheck.engines.spatial.reading import in_space
from crosscheck.scenes.names import called_for
from refkin.joints import elements_of
from refkin.model import Scene
from refkin.motion import CertifiedRadius, Motion, PointMotion, Producer, Route, Status, __version__, engine_motion

Array = NDArray[np.float64]

NO_ROWS = refused("a closed form has no constraint rows")
EXPRESSED = (
    *("points coincide", "point on line", "distance", "distance by a law"),
    *("coordinate by a law", "angle", "angle by a law"),
    *OF_SPACE,
)
"""The elements that it has."""

BITS = 113
"""Precision of the balls at first."""
DOUBLINGS = 2
"""How often the precision of the balls is doubled where they decide nothing, or less than a double holds."""

OPEN = 1e-6
"""Closure of the loops, relative to the scaled coordinates, above which floats show a fault of this program."""


JETS = (
    Term(
        name="chords",
        level="position",
        reason="an area by its four factors, a root and an arctangent stand for each residual: three times its "
        "roundings; "
        "and a frame is placed from either end of its chain, each arm up to one size",
        relative=2.0,
        absolute=8.0 * 2.0**-53,
    ),
    *(
        Term(
            name="jets",
            level=level,
            reason="chord, root, quotient and arctangent of second-order jets: four steps of four products "
            "of up to four terms each",
            relative=64.0 * 2.0**-53,
        )
        for level in ("velocity", "acceleration")
    ),
)


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


@dataclass(frozen=True, kw_only=True)
class TrueMotion:
    """A motion with proven radii: |motion.q - exact| <= radii[0], entry by entry, rounding to float included.

    Attributes
    ----------
    motion : Motion
        The midpoints, rounded.
    radii : list of (n, T) array
        Of each level, in the units of its entries; NaN where there is no answer.
    balls : tuple of (n, T) object array
        The enclosures themselves, unrounded: q, qd, qdd as `flint.arb` (the int 0 for the derivative of a constant).
    bits : int
        The precision that was needed.
    """

    motion: Motion
    radii: list[Array]
    balls: tuple[Any, Any, Any]
    bits: int


CAPABILITIES: Capabilities = {key: {**dict.fromkeys(Level, NO_ROWS), Level.SOLVE: NATIVE} for key in EXPRESSED}


class ClosedForm(Adapter):
    """Closed forms in float64 (method "float"), or in `flint.arb` balls (method "arb").

    `solve` knows both; "float" alone is compared: a night needs no second truth beside the certificates.
    """

    name = "closed_form"
    table = CAPABILITIES

    def routes(self) -> Sequence[Route]:
        return [_route("float")]

    def terms(self, scene: Scene, route: Route | None = None) -> Sequence[Term]:
        """Return the rounding of the jets that carry rates through the closed form, and of frames in space."""
        return (*JETS, _frames(scene)) if in_space(scene.mechanism) else JETS

    def solve(self, scene: Scene, route: Route | None = None) -> Motion:
        """Return the motion of a scene.

        Raises
        ------
        EngineError
            If a joint is unknown, the linkage is not of class II, or it has redundant constraints.
        """
        route = route or self.routes()[0]
        if in_space(scene.mechanism):
            refuse(refusals(self, scene, Level.SOLVE))
            if route.name != "float":
                raise EngineRefusal(
                    f"closed_form refuses method {route.name!r} in space: balls decide its statuses alone"
                )
            return space_closed(scene, Producer(name=self.name, version=self.version(), route=route), BITS)
        if route.name == "arb":
            return truth(scene).motion
        if route.name != "float":
            raise EngineError(f"closed_form has no method {route.name!r}; there are: 'float', 'arb'")
        _refuse(scene)
        with np.errstate(all="ignore"):  # NaN and inf become statuses
            motion = _motion(_floats(scene), _route("float"))[0]
        return _proved(motion, scene) if Status.UNASSEMBLABLE in motion.status else motion


def truth(scene: Scene, bits: int = BITS) -> TrueMotion:
    """Return a scene's motion in balls of at least `bits` bits: midpoints rounded, and proven radii.

    The precision is doubled, at most twice, if the balls leave open whether a dyad closes or are wider than doubles.

    Raises
    ------
    EngineError
        As `ClosedForm.solve`.
    """
    _refuse(scene)
    with np.errstate(all="ignore"):
        floats = _floats(scene)
    for doubling in range(DOUBLINGS + 1):
        with ctx.workprec(bits << doubling):
            solution = solve(scene, Balls(), lambda k: floats.assembly.known_angles[k])
            solution = replace(solution, sure_until=floats.sure_until, lost_after=floats.lost_after)
            motion, radii = _motion(solution, _route("arb"))
        if _sharp(scene, motion, radii):
            break
    with ctx.workprec(bits << doubling):
        q, qd, qdd = (_numbers(_jets(solution), part, len(scene.times)) for part in ("v", "d", "a"))
    return TrueMotion(motion=motion, radii=radii, balls=(q, qd, qdd), bits=bits << doubling)


def _proved(motion: Motion, scene: Scene) -> Motion:
    """Return a float motion that says "unassemblable" only where balls prove it, else "not converged".

    A dyad behind a nearly singular one may have lost half of its digits: then its negative slack proves nothing.
    """
    proof = truth(scene).motion
    lost = [
        mine is Status.UNASSEMBLABLE and proved is not mine
        for mine, proved in zip(motion.status, proof.status, strict=True)
    ]
    status = tuple(Status.NOT_CONVERGED if bad else mine for bad, mine in zip(lost, motion.status, strict=True))
    message = f"{motion.message}; not proved at {sum(lost)} times" if any(lost) else motion.message
    return replace(motion, status=status, message=message)


def _route(name: str) -> Route:
    by = "closed form"
    return route_by(by, name, "none", linear_solve_by=by, drift_by="second-order jets")


def _refuse(scene: Scene) -> None:
    reasons = refusals(ClosedForm(), scene, Level.SOLVE)
    extra = sum(c.rows for c in scene.mechanism.constraints) - 3 * len(scene.mechanism.bodies)
    if extra > 0:
        reasons.append(f"closed_form refuses {scene.name!r}: {extra} redundant constraint{'s' * (extra > 1)}")
    refuse(reasons)


def _floats(scene: Scene) -> Solution:
    try:
        return float_solution(scene)
    except NotDyadic as error:
        raise EngineRefusal(f"closed_form refuses {scene.name!r}: {error}") from error


def _motion(solution: Solution, route: Route) -> tuple[Motion, list[Array]]:
    """Return the motion, and the proven radius of each level (NaN in floats)."""
    scene, assembly = solution.scene, solution.assembly
    levels, radii = _levels(_jets(solution), len(scene.times))
    status = _status(solution, levels)
    _blank(levels, radii, status)
    residual = _residual(solution, levels, status)
    producer = Producer(name=ClosedForm.name, version=__version__, route=route)
    certified, points = _certified(scene, radii), _points(solution, status)
    more = {"residual": residual, "certified_radius": certified, "points": points}
    message = "; ".join(assembly.remarks)
    called = called_for(scene, levels)
    motion = engine_motion(scene.times, scene.wanted, *called, status, producer, message=message, **more)
    return motion, radii


def _jets(solution: Solution) -> list[Jet]:
    """Return x, y, phi of the wanted bodies, in the scene's own ground frame."""
    poses = [solution.ground.bodies[name] for name in solution.scene.wanted]
    return [jet for pose in poses for jet in (*_in_scene(solution, pose.origin), pose.angle)]


def _in_scene(solution: Solution, place: Planar) -> tuple[Jet, Jet]:
    x, y = (Jet(solution.assembly.arithmetic.number(c)) for c in solution.assembly.linkage.origin)
    return place.x + x, place.y + y


def _numbers(jets: list[Jet], part: str, count: int) -> Any:
    """Return the values (v), rates (d) or accelerations (a) of jets as an object array (n, T)."""
    return np.stack([np.broadcast_to(np.asarray(getattr(jet, part), object), (count,)) for jet in jets])


def _levels(jets: list[Jet], count: int) -> tuple[list[Array], list[Array]]:
    """Return value, rate and acceleration of the jets as float arrays (n, T), and the radii about those floats."""
    levels, radii = list(np.empty((3, len(jets), count))), list(np.zeros((3, len(jets), count)))
    for level, radius, part in zip(levels, radii, ("v", "d", "a"), strict=True):
        for k, jet in enumerate(jets):
            numbers = getattr(jet, part)
            level[k] = midpoint(numbers)
            if not isinstance(numbers, int):  # the derivative of a constant
                radius[k] = _radius(numbers, level[k]) if np.asarray(numbers).dtype.hasobject else np.nan
    return levels, radii


def _ball_radius(ball: Any, rounded: float) -> float:
    """Return a bound, rounded up, on the distance from a float to anything in a ball; NaN if it is none."""
    if not isinstance(ball, arb) or not np.isfinite(rounded):
        return np.nan
    return float(np.nextafter(float((ball - rounded).abs_upper()), np.inf))


_radius = np.frompyfunc(_ball_radius, 2, 1)


def _status(solution: Solution, levels: list[Array]) -> tuple[Status, ...]:
    """Return what is known: first non-assembly, then singular (no number came out), then lost branch, unsure turns."""
    assembly = solution.assembly
    finite = np.all([np.isfinite(level).all(axis=0) for level in levels], axis=0)
    unsure, lost = (np.array(solution.scene.times) > end for end in (solution.sure_until, solution.lost_after))
    if lost.any():
        assembly.remarks.append(
            f"two assemblies meet, or there is none, at t = {solution.lost_after:.17g} s: branch lost"
        )
    if unsure.any():
        assembly.remarks.append(f"the turns of an angle are unsure after t = {solution.sure_until:.17g} s")
    status = np.where(unsure, Status.NOT_CONVERGED, Status.OK)
    status = np.where(lost, Status.BRANCH_LOST, status)
    status = np.where(assembly.singular | ~finite, Status.SINGULAR, status)
    return tuple(Status(word) for word in np.where(assembly.absent, Status.UNASSEMBLABLE, status))


def _blank(levels: list[Array], radii: list[Array], status: tuple[Status, ...]) -> None:
    """Take away what a status says is not known: the rates if singular, all if there is no pose."""
    absent = np.array([word not in (Status.OK, Status.SINGULAR) for word in status])
    known = np.array([word is Status.OK for word in status])
    for order in range(3):
        for array in (levels[order], radii[order]):
            array[:, absent if order == 0 else ~known] = np.nan


def _residual(solution: Solution, levels: list[Array], status: tuple[Status, ...]) -> Array:
    """Return the largest gap per time, and make sure that every joint and row of the scene is closed.

    Raises
    ------
    EngineError
        If one is open although every dyad was placed: a fault of this program.
    """
    gaps = np.abs(midpoint(solution.closure)).max(axis=0)
    known = np.array([word is Status.OK for word in status])
    if isinstance(solution.assembly.arithmetic, Balls):
        closed = all(ball.contains(0) for ball in solution.closure[:, known].flat)
    else:
        largest = np.abs(levels[0] / _scale(solution.scene)).max(axis=0)
        closed = bool((gaps[known] < OPEN * np.maximum(1.0, largest[known])).all())
    if not closed:
        raise EngineError(
            f"closed_form: {solution.scene.name!r}: a joint is left open by {np.nanmax(gaps[known]):.3g} sizes"
        )
    return gaps


def _certified(scene: Scene, radii: list[Array]) -> CertifiedRadius:
    """Return the largest radius of the scaled coordinates per time."""
    largest = [(radius / _scale(scene)).max(axis=0, initial=0.0) for radius in radii]
    return CertifiedRadius(position=largest[0], velocity=largest[1], acceleration=largest[2])


def _points(solution: Solution, status: tuple[Status, ...]) -> dict[str, PointMotion]:
    scene, number = solution.scene, solution.assembly.arithmetic.number
    motions = {}
    for point in scene.points:
        local = Planar(*(Jet(number(c)) for c in point.position))
        place = solution.ground.bodies[point.body].point(local)
        levels, radii = _levels(list(_in_scene(solution, place)), len(scene.times))
        _blank(levels, radii, status)
        motions[point.name] = PointMotion(*called_for(scene, levels))
    return motions


def _sharp(scene: Scene, motion: Motion, radii: list[Array]) -> bool:
    """Return whether every time is decided, and no ball is wider than 4 eps of its level's largest scaled entry."""
    if any(word is Status.SINGULAR for word in motion.status):
        return False
    scale = _scale(scene)
    for level, radius in zip(motion.levels, radii, strict=True):
        if level is not None and np.isfinite(level).any():
            largest = np.nanmax(np.abs(level) / scale)
            if np.nanmax(radius / scale) > 4 * np.finfo(float).eps * largest:
                return False
    return True


def _scale(scene: Scene) -> Array:
    """Return the unit of each coordinate, (n, 1): the mechanism's size for lengths, 1 for angles."""
    return np.tile([scene.mechanism.size()] * 2 + [1.0], len(scene.wanted))[:, None]
