"""What a test of an own solver asserts: that its answer is the reference's, within what rounding may take."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from typing import Any

import numpy as np

from crosscheck.engines import EngineError, Term
from crosscheck.engines.methods import floats
from crosscheck.errors import kept
from crosscheck.judge.budget import ErrorBudget, times_with
from crosscheck.judge.comparison import Comparison, QuantityComparison, Reference, compare, reference
from crosscheck.judge.delivery import misshapen, undelivered
from crosscheck.judge.points import points_off
from crosscheck.judge.records import QUANTITIES
from crosscheck.judge.spatial import alike, passive_lines
from crosscheck.judge.uncompared import believed, opened_beside, put_together_wrongly, uncompared_faults
from crosscheck.judge.violations import violations
from refkin.errors import RefkinError, expect
from refkin.joints.annotations import check, is_real
from refkin.model import Scene
from refkin.motion import Motion, Producer, Route, Status, engine_motion
from refkin.output.tables import UNITS

OWN = Producer(name="own solver", version="", route=Route(name="own"))


class NothingToCompare(RefkinError):
    """A scene of which the reference knows no pose and proves none away, or an answer without a number."""


def assert_agrees(motion: Motion | Mapping[str, Mapping[str, Any]], scene: Scene, *, residual: float = 0.0) -> None:
    """Assert that an answer to a scene is the reference's, within the error that double precision may make.

    What is allowed is derived for each coordinate and time from the rounding of the formulas and how near a singular
    pose is (`crosscheck.judge.budget`); angles may differ by full turns. Where no such bound holds, next to a singular
    pose, nothing is compared; what a `Motion` calls ok there has numbers and closes the joints.

    Parameters
    ----------
    motion : Motion or mapping
        The answer: a `refkin.Motion`; or, for some bodies, what was computed of x, y [m], phi [rad] (in space x, y, z,
        e0 ... e3) and their rates, each (T,), as in `{"rocker": {"phi": ..., "phid": ...}}`. NaN: no answer then.
    scene : Scene
        What was asked.
    residual : float
        What the solver leaves of the constraint equations where it stops, in sizes of the mechanism and radians; by
        default rounding alone.

    Raises
    ------
    AssertionError
        Which coordinate, by how much, at which time, of what allowed, and which joint it violates.
    NothingToCompare
        If there is nothing that could be wrong.
    """
    expect("motion", motion, Motion, Mapping)
    expect("scene", scene, Scene)
    check("residual", "a number that is not negative", residual, is_real(residual) and 0.0 <= residual < np.inf)
    ref = reference(scene)
    answer = motion if isinstance(motion, Motion) else _completed(ref, motion)
    for why in misshapen(scene, answer):
        raise RefkinError(f"{scene.name}: {why}")
    terms = [Term(name="own stopping rule", level="position", reason="said by the caller", absolute=residual)]
    compared = compare(ref, answer, terms if residual else ())
    faults = list(_faults(ref, answer, compared, terms if residual else ()))
    if answer is motion:  # what was left out of a part is the reference's own
        faults += map(_said, _owed(ref, scene, answer, terms if residual else (), compared))
    if faults:
        raise AssertionError(f"{scene.name}: " + "\n".join(faults))
    proved = {Status.UNASSEMBLABLE, Status.LOCKED} >= set(ref.motion.status)
    if not compared.compared and not proved:
        raise NothingToCompare(f"{scene.name}: nothing to compare: the reference is {ref.motion.verdict}")


def _completed(ref: Reference, given: Mapping[str, Mapping[str, Any]]) -> Motion:
    """Return the coordinates that were given as a motion; what was not given is the reference's own."""
    t = ref.motion.t
    levels = np.array(ref.motion.levels)
    own = np.zeros(levels.shape[:2], bool)
    answered = times_with(ref.motion, Status.OK)
    for body, coordinates in given.items():
        expect(f"motion[{body!r}]", coordinates, Mapping)
    if not any(given.values()):
        raise NothingToCompare(f"{ref.scene.name}: the answer has no number")
    names = [[coordinate + "d" * order for coordinate in ref.motion.kind.coordinates] for order in range(3)]
    for body, coordinates in given.items():
        ref.motion[body]  # raises UnknownName
        for name, values in coordinates.items():
            order, row = next(((k, n.index(name)) for k, n in enumerate(names) if name in n), (None, None))
            if order is None or row is None:
                known = ", ".join(n for of_level in names for n in of_level)
                raise RefkinError(f"{body}: no coordinate is called {name!r}; there are: {known}")
            expected = f"{body}.{name}: expected {len(t)} values, one per time, got"
            try:
                column = floats(values)
            except (TypeError, ValueError, EngineError) as error:
                raise RefkinError(f"{expected} {kept(repr(values))}") from error
            if column.shape != t.shape:
                raise RefkinError(f"{expected} shape {column.shape}")
            place = order, len(names[0]) * ref.motion.bodies.index(body) + row
            levels[place], own[place] = column, True
            answered &= np.isfinite(column)
    status = tuple(Status.OK if ok else Status.NOT_CONVERGED for ok in answered)
    q, qd, qdd = np.where(own[..., None], levels, _beside(ref, levels[0]))
    return engine_motion(t, ref.motion.bodies, q, qd, qdd, status, OWN)


def _beside(ref: Reference, q: Any) -> Any:
    """Return the reference's levels (3, n, T) as they stand beside the pose of an answer (n, T).

    In space p and -p are one pose, of a body that spins as it likes so is any turn, and p' and p'' are those of either.
    """
    levels = ref.motion.levels
    if ref.motion.kind.name == "planar":
        return np.array(levels)
    with np.errstate(invalid="ignore", divide="ignore"):
        lines = passive_lines(ref.scene.mechanism)
        return np.array(alike(list(levels), [q, *levels[1:]], ref.motion.bodies, lines))


def _faults(ref: Reference, motion: Motion, compared: Comparison, terms: Any) -> Iterator[str]:
    for order, name in enumerate(QUANTITIES):
        quantity = compared.quantities.get(name)
        if quantity is not None and not quantity.agrees and quantity.worst is not None:
            yield _sentence(ref, motion, order, quantity, compared.budget)
    if compared.other_assembly:
        yield "it is the other assembly: the joints are satisfied, but the linkage is put together another way"
    if compared.missing:
        of = f"{compared.missing} of {len(motion.status)} times"
        yield f"no answer at {of}, the first t = {compared.first_missing:.17g} s, where there is one, by proof"
    yield from map(_said, (*believed(ref, motion), *points_off(ref, motion, QUANTITIES, terms, compared)))


def _owed(ref: Reference, scene: Scene, motion: Motion, terms: Any, compared: Comparison) -> Iterator[dict[str, Any]]:
    """Yield what a whole answer lacks, and what of it is wrong by itself, as disagreements."""
    yield from undelivered(QUANTITIES, scene, motion)
    yield from put_together_wrongly(scene, motion)[0]
    yield from uncompared_faults(ref, motion, terms)
    yield from opened_beside(ref, motion, terms, compared)


def _said(fault: Mapping[str, Any]) -> str:
    return f"{fault['quantity']}: {fault['kind']}: {fault['message']}"


def _sentence(ref: Reference, motion: Motion, order: int, quantity: QuantityComparison, budget: ErrorBudget) -> str:
    at = quantity.worst
    assert at is not None
    assert at.time is not None
    body, _, name = at.component.rpartition(".")
    kind = ref.motion.kind
    axis, k = kind.coordinates.index(name), int(np.flatnonzero(ref.motion.t == at.time)[0])
    row = kind.width * ref.motion.bodies.index(body) + axis
    unit, size = UNITS[kind.name][order][axis], 1.0 if kind.turns[axis] else ref.system.unit.size
    off, allowed = abs(float(quantity.difference[row, k])) * size, float(budget.levels[order, row, k]) * size
    place = f"{body}.{name}{'d' * order}"
    violated = violations(ref, motion, order, at.time).text
    return (
        f"{place} is off by {off:.3g} {unit} at t = {at.time:.17g} s, {quantity.ratio[k]:.3g} times the allowed "
        f"{allowed:.3g} {unit}{f'; {violated}' if violated else ''}"
    )
