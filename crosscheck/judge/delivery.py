"""What an engine owes beside right numbers: all that it was asked for, and no allowance that nobody grants it.

An engine that can do less says so: by refusals, or, for levels that it never has, by an attribute `delivers`.

An error term of an engine's own (`crosscheck.engines.Term`) is an allowance that its adapter declares. What is of the
size of rounding is a derivation, to be read where it stands. Anything larger needs a sentence of the engine's
documentation, which stands here and not in the adapter, and is granted up to what that sentence says.

A missing answer is excused where the motion comes near to a singular pose between the times of a scene: an engine that
steps from time to time has to pass it, and there the other branch is close. What excuses it is a certified pose of the
reference, not a guess. Who is right after that pose has passed it: it excuses nothing later.
"""

from __future__ import annotations

import math
from collections import Counter
from collections.abc import Callable, Collection, Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from itertools import pairwise
from typing import Any

import numpy as np

from crosscheck.engines import UNLIKE, Level, Term, is_plain
from crosscheck.errors import kept
from crosscheck.judge.budget import times_with
from crosscheck.judge.comparison import Reference, begun_at
from crosscheck.judge.records import QUANTITIES, Cause, Disagreement, NewCase, Record, wrong
from crosscheck.judge.running_error import U
from crosscheck.scenes.names import called_for
from refkin.joints import Driver, PointDistance, SpatialPointDistance, elements_of
from refkin.model import Evidence, Scene
from refkin.motion import Motion, Producer, Route, Status
from refkin.solving.solve import solve

ABSOLUTE, RELATIVE, OF_FORMULAS, OF_RATES = 2.0**10 * U, 2.0**10 * U, 4.0, 2.0**20 * U
"""Up to these a term is rounding: a thousand roundings of a residual (`_so_small`), or of what stands in its equation;
four times the formulas' own (what multiplies a position's residual is their running error); and, of rates that a shape
with short links makes, a million, or what its links make of a thousand (`_is_rounding`)."""
CHAINED = 8
"""Bodies of a chain to which a thousand roundings are put down."""


@dataclass(frozen=True)
class Documented:
    """A tolerance that an engine states: the largest residual, in sizes, that it leaves; the sentence, and where."""

    largest: Callable[[Scene], float]
    quote: str
    source: str


DOCUMENTED: Mapping[tuple[str, str], Documented] = {
    ("exudyn", "stopping rule"): Documented(
        lambda scene: _left_by_default(scene),
        "relative tolerance of residual for Newton (general goal of Newton is to decrease the residual by this factor)",
        "exudyn 1.13, NewtonSettings.relativeTolerance = 1e-8",
    ),
    ("mujoco", "soft constraints"): Documented(
        lambda scene: 1e-3,
        "Tolerance threshold used for early termination of the iterative solver.",
        "MuJoCo 4.0.0, doc/XMLreference.rst, option/tolerance = 1e-8: of a soft constraint it leaves the root over k",
    ),
    ("pinocchio", "stopping rule"): Documented(
        lambda scene: 1e-10, "eps = 1e-10", "Pinocchio 3.7.0, examples/simulation-closed-kinematic-chains.py"
    ),
}


def granted(engine: str, scene: Scene, terms: Sequence[Term]) -> tuple[list[Term], list[dict[str, Any]]]:
    """Return the terms that are granted, and the others as disagreements; many small ones count as one large one.

    Parameters
    ----------
    engine, scene : str, Scene
    terms : sequence of Term
        What the engine says that it adds.
    """
    allowed: list[Term] = []
    faults = []
    for term in terms:
        most = _most(engine, scene, term)
        formulas = OF_FORMULAS if term.level == QUANTITIES[0] else RELATIVE
        same = [term, *(one for one in allowed if one.level == term.level and _most(engine, scene, one) == most)]
        absolute, relative, of_rates = (
            sum(getattr(one, key) for one in same) for key in ("absolute", "relative", "of_rates")
        )
        least = min(term.absolute, term.relative, term.of_rates)  # one below 0 would pay for another
        small = _so_small(absolute, most, scene) if term.level == QUANTITIES[0] else absolute <= most
        if small and relative <= formulas and _is_rounding(of_rates, scene) and least >= 0.0:
            allowed.append(term)
            continue
        size = least if least < 0.0 else max(term.absolute, term.relative, term.of_rates)
        message = f"{term.name!r} of {size:.3g}: no documentation of {engine} states more than {most:.3g}"
        faults.append(wrong(term.level, Cause.UNDOCUMENTED, message))
    return allowed, faults


def misshapen(scene: Scene, motion: Any) -> Iterator[str]:
    """Yield why what an engine answered cannot be compared: it is none of this scene's times, bodies or shape."""
    if not isinstance(motion, Motion):
        yield f"expected a refkin.motion.Motion, got {type(motion).__name__}"
        return
    kinds: dict[str, tuple[Any, str]] = {
        **dict.fromkeys(("bodies", "status"), (tuple | list, "a tuple")),
        "points": (Mapping, "a table of PointMotion"),
    }
    for key, (kind, expected) in kinds.items():
        if not isinstance(getattr(motion, key), kind):
            yield f"{key}: expected {expected}, got {type(getattr(motion, key)).__name__}"
            return
    if not motion.bodies:
        yield "it answers for no body"
        return
    count, width = len(scene.times), scene.mechanism.kind.width
    shape = (width * len(motion.bodies), count)
    if not (isinstance(motion.t, np.ndarray) and np.array_equal(motion.t, scene.times)):
        yield "its times are not those of the scene, as an array"
    if len(motion.status) != count:
        yield f"expected a status for each of {count} times, got {len(motion.status)}"
    unknown = [status for status in motion.status if not isinstance(status, Status)]
    if unknown:
        yield f"expected statuses of refkin.motion.Status, got {unknown[0]!r}"
    for name, level in zip(("q", "qd", "qdd"), motion.levels, strict=True):
        if level is None and name != "q":
            continue
        if level is None or not is_plain(level, "f"):
            kind, other = type(level), isinstance(level, UNLIKE)
            what = f"a {kind.__module__}.{kind.__name__}" if other else getattr(level, "dtype", kind.__name__)
            yield f"{name}: expected an array of floats, got {what}"
        elif level.shape != shape:
            yield f"{name} has shape {level.shape}, not {shape}: {width} rows a body"
    known = [b.name for b in scene.mechanism.bodies]
    strange = [body for body in motion.bodies if body not in known]
    if strange:
        yield f"it answers for {kept(', '.join(map(str, strange)))}, which the scene has not"
    elif len(set(motion.bodies)) < len(motion.bodies):
        yield f"it answers more than once for a body: {kept(', '.join(map(str, motion.bodies)))}"
    who = motion.producer
    if not (isinstance(who, Producer) and str(who.version).isprintable() and isinstance(who.route, Route)):
        yield f"expected a refkin.motion.Producer with a printable version and a Route, got {kept(repr(who))}"


def undelivered(able: Collection[str], scene: Scene, motion: Motion) -> Iterator[dict[str, Any]]:
    """Yield what a scene asks for and a motion has not, as disagreements: levels, and bodies.

    Parameters
    ----------
    able : collection of str
        The quantities that its method owes.
    scene, motion : Scene, Motion
    """
    for quantity, level in zip(called_for(scene, QUANTITIES), motion.levels, strict=True):
        if quantity in able and level is None:
            yield wrong(quantity, Cause.NOT_DELIVERED, "not delivered at any time")
    absent = [body for body in scene.wanted if body not in motion.bodies]
    if absent:
        yield wrong(QUANTITIES[0], Cause.NOT_DELIVERED, f"no answer for {', '.join(absent)}")


class Unanswered:
    """Engines that no scene has an answer of, and what they refused although their tables have every joint of it."""

    def __init__(self) -> None:
        self.answering: set[str] = set()
        self.first: dict[str, tuple[Record, str]] = {}
        self.refused = Counter[str]()

    def add(self, record: Record) -> None:
        """Count one scene."""
        self.answering |= {answer.engine for answer in record.answers}
        by_table = {row.engine for row in record.refusals if row.level == Level.SOLVE}
        reasons = {row.engine: row.reason for row in record.refusals if not row.joint}
        for engine in reasons.keys() - by_table:
            self.first.setdefault(engine, (record, reasons[engine]))
            self.refused[engine] += 1

    def new(self, answers_plain_ones: Callable[[str], bool]) -> Iterator[NewCase]:
        """Yield every engine that answered nothing as a disagreement, unless it answers plain mechanisms.

        What is drawn may by chance be all that an honest engine refuses for a reason that no table can hold. The
        plainest mechanism of a joint in its table is not.
        """
        for engine, (record, reason) in self.first.items():
            if engine not in self.answering and not answers_plain_ones(engine):
                scenes = f"{self.refused[engine]} scenes whose joints its table has, and no plain mechanism"
                message = f"answered none of {scenes}; the first: {reason}"
                who: Any = {"engine": engine, "method": "any", "quantity": "status"}
                fault = Disagreement(**who, kind=Cause.NOT_DELIVERED, message=message)
                yield NewCase(disagreement=fault, key=record.key, shard=int(record.about.get("shard") or 0))


def _most(engine: str, scene: Scene, term: Term) -> float:
    documented = DOCUMENTED.get((engine, term.name)) if term.level == QUANTITIES[0] else None
    return max(ABSOLUTE, documented.largest(scene)) if documented else ABSOLUTE


def _so_small(absolute: float, most: float, scene: Scene) -> bool:
    """Return whether an error of a residual is at most so large, or rounding of it.

    Of as many turns as drivers go, or as a joint holds a body turned.
    """
    if absolute <= most:
        return True
    held = [abs(getattr(element, "angle", 0.0)) for element in elements_of(scene.mechanism.joints)]
    reach: float = max(_reach(scene, scene.mechanism.drivers), *held)
    return absolute <= max(1.0, reach / math.tau) * ABSOLUTE  # what is documented grows with no turn


def _left_by_default(scene: Scene) -> float:
    """Return what a relative tolerance of 1e-8 leaves: of forty sizes or radians, or of what drivers ask for at once.

    That times what length is driven; exudyn's norm takes metres for radians, and radians for metres.
    """
    size, drivers, lengths = scene.mechanism.size(), scene.mechanism.drivers, PointDistance | SpatialPointDistance
    length = _reach(scene, [d for d in drivers if any(isinstance(e, lengths) for e in elements_of([d]))])
    return 1e-8 * max(40.0, 4.0 * _reach(scene, drivers)) * max(1.0, length) * max(size, 1.0 / size)


def _reach(scene: Scene, drivers: Iterable[Driver]) -> float:
    """Return how far drivers go [sizes or rad], from the first point of the ground."""
    t, unit, reach = np.array(scene.times), scene.mechanism.unit(), [0.0]
    for driver in drivers:
        shifts, factor = driver.law_scale(unit)
        reach += [np.max(np.abs(law(t, 0) - x)) / factor for law, x in zip(driver.laws, shifts, strict=True)]
    return float(max(reach))


def _is_rounding(of_rates: float, scene: Scene) -> bool:
    """Return whether rounding explains an error of so much of the rates.

    A massless link of length L turns with w = (v_i + v_j) / L, each v up to twice the size, and w^2 is in its rates.
    Each link adds its own. A thousand roundings are of a chain of `CHAINED` bodies; one of n has as many frames, each
    rounded with an arm for as many bodies below it: n^2.
    """
    if of_rates <= OF_RATES:
        return True
    size, given = scene.mechanism.size(), elements_of(scene.mechanism.constraints)
    lengths = [e.length for e in given if isinstance(e, PointDistance) and not e.laws] or [size]
    roundings = RELATIVE * max(1.0, len(scene.mechanism.bodies) / CHAINED) ** 2
    return of_rates <= roundings * sum((4.0 * size / length) ** 2 for length in lengths)


FIRST, LATER = 4, 8
"""Times that are put into each interval at first, and on either side of the smallest values found afterwards."""
ROUNDS = 12
"""Each narrows the intervals ninefold: twelve reach the resolution of time."""
NARROWED = 3
"""Smallest local minima that are looked into, by themselves: what lies before them is solved already."""
FALLS = 2.0
"""How many times a minimum a neighbour is, at least, where sigma_min may pass zero beside it: three if straight."""


def excuse(ref: Reference, first: float, enough: float, since: float = -np.inf) -> tuple[float, float] | None:
    """Return (time, sigma_min) of a pose as near to singular as `enough` that is met between two times, or None.

    Who gives no answer from `first` [s] on is excused by such a pose, at one of the times or between two: the branch
    may have been lost there. What comes later is none of its business, nor what it had passed at `since`.

    Parameters
    ----------
    ref : Reference
    first : float
        Up to when [s].
    enough : float
        The largest sigma_min that excuses.
    since : float
        When its position was right last [s].
    """
    times = ref.motion.t
    asked = (times >= since) & (times <= first)
    near = np.flatnonzero(asked & (ref.sigma_min <= enough))
    if near.size:
        return float(times[near[0]]), float(ref.sigma_min[near[0]])
    begun, given = int(np.argmax(asked)), tuple(times[asked].tolist())
    scene = begun_at(ref.scene, ref.motion, begun, given) if begun else replace(ref.scene, times=given)
    return singular_between(scene, enough)


def singular_between(scene: Scene, enough: float) -> tuple[float, float] | None:
    """Return (time, sigma_min) of a certified pose as near to singular as `enough`, or None if none is found.

    The reference has solved the scene, every time of it ok.
    """
    scene = replace(scene, effects=frozenset(), evidence=frozenset({Evidence.CONDITION}))
    parts = [replace(scene, times=tuple(sorted({*scene.times, *_within(scene.times, FIRST)})))]
    for narrowed in range(ROUNDS):
        lowest = sorted((pose for part in parts for pose in _minima(solve(part))), key=lambda pose: pose[0])[:NARROWED]
        for sigma, k, motion in lowest:
            if sigma <= enough and _certified(scene, motion, k):
                return float(motion.t[k]), sigma
        if narrowed:
            lowest = [(s, k, motion) for s, k, motion in lowest if s <= FALLS * enough or _falls(motion, k)]
        parts = [part for _, k, motion in lowest for part in _narrowed(scene, motion, k)]
    return None


def _certified(scene: Scene, motion: Motion, k: int) -> bool:
    """Return whether the k-th pose of a motion is proved: what is narrowed on the way to it needs no proof."""
    there = begun_at(scene, motion, k, [float(motion.t[k])])
    return solve(replace(there, evidence=frozenset(Evidence))).status[0] is Status.OK


def _falls(motion: Motion, k: int) -> bool:
    """Return whether sigma_min may fall further beside a minimum: not if its neighbours are hardly larger."""
    beside = motion.sigma_min[max(k - 1, 0) : k + 2]
    return not np.max(beside) < FALLS * motion.sigma_min[k]


def _narrowed(scene: Scene, motion: Motion, k: int) -> Iterator[Scene]:
    """Yield the scene about the k-th time, begun from the pose before it, if there are times between."""
    first = k - 1 if k and motion.status[k - 1] is Status.OK else k
    times = motion.t[first : k + 2].tolist()
    more = sorted({*times, *_within(times)})
    if len(more) > len(times):
        yield begun_at(scene, motion, first, more)


def _within(times: tuple[float, ...] | list[float], count: int = LATER) -> list[float]:
    """Return some times between each two."""
    return [float(t) for a, b in pairwise(times) for t in np.linspace(a, b, count + 2)[1:-1]]


def _minima(motion: Motion) -> Iterator[tuple[float, int, Motion]]:
    """Yield (sigma_min, k, motion) of the poses at which it is smaller than before and after."""
    ok = times_with(motion, Status.OK)
    sigma = np.pad(np.where(ok, motion.sigma_min, np.inf), 1, constant_values=np.inf)
    lowest = ok & (sigma[1:-1] <= sigma[:-2]) & (sigma[1:-1] <= sigma[2:])
    yield from ((float(sigma[k + 1]), int(k), motion) for k in np.flatnonzero(lowest))
