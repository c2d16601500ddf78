"""One scene through the reference and the engines: what a worker does, what `replay` shows, what the library offers."""

from __future__ import annotations

import hashlib
import json
import math
import sys
import time
from collections import Counter
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, field, replace
from functools import cached_property
from typing import Any

import numpy as np

from crosscheck.engines import Engine, EngineError, EngineRefusal, Level, Support, Term, refused_joints, terms_of
from crosscheck.engines.loading import load
from crosscheck.engines.methods import Method, Use, copied, methods
from crosscheck.engines.undisturbed import undisturbed
from crosscheck.errors import kept
from crosscheck.judge.comparison import Comparison, QuantityComparison, Reference, compare, reference, worst_at
from crosscheck.judge.delivery import ABSOLUTE, excuse, granted, misshapen, undelivered
from crosscheck.judge.hard_poses import Solutions, samples, scene_truths
from crosscheck.judge.levels import (
    LEVELS,
    Configuration,
    compare_levels,
    configurations,
    expect_model,
    missing_rows,
    without_form,
)
from crosscheck.judge.points import points_off
from crosscheck.judge.records import (
    QUANTITIES,
    Answer,
    Cause,
    Disagreement,
    EnclosedTimes,
    LevelRow,
    MethodData,
    Record,
    RefusalRow,
    wrong,
)
from crosscheck.judge.samples import (
    histogram,
    is_bound,
    largest,
    largest_ratio,
    quantities,
    reference_row,
    sharpness_at_common,
    short,
)
from crosscheck.judge.uncompared import believed, opened_beside, put_together_wrongly, uncompared_faults
from crosscheck.judge.violations import NOT_KNOWN, violations
from crosscheck.workers.processes import Failure, raised
from refkin.joints import elements_of
from refkin.model import Mechanism, Scene
from refkin.motion import Motion, Status
from refkin.proof.pose.krawczyk import Verdict
from refkin.scenes.files import to_dict
from refkin.scenes.linkages.base import rough

CONFIGURATIONS, WITH_ROWS = 1, 4
"""Configurations per scene at which an engine's own rows are compared: a night sees more of them in another scene. Of
scenes that it knows well, with the same joints and laws at other lengths, it compares them in one of so many."""
TURNED_ROUND = 4
"""One scene in this many is solved once more, stated otherwise, at the first of so many parts of its times."""
DIRECTIONS = ("axis_i", "axis_j", "zero_i", "zero_j", "normal_j")
"""What a joint says by a vector of any length."""
NOTHING = QuantityComparison(np.zeros(0), np.zeros(0), np.zeros(0), None)
SHARPNESS = 16
"""Of one scene in this many it is measured how sharp the budgets are."""
REGULAR = 1e-4
"""Smallest singular value above which an engine has no excuse for giving no answer."""
ROWS = "rows"
"""The method of an engine's own rows."""
ANY = "any"
"""What stands for its method where an engine is wrong whatever the method."""


def key_of(scene: Scene) -> str:
    """Return the hash that names a scene: equal scenes, equal keys, whatever their name."""
    data = {k: v for k, v in to_dict(scene).items() if k != "name"}
    return hashlib.sha256(json.dumps(data, sort_keys=True).encode()).hexdigest()[:16]


def check(
    scene: Scene, engines: Sequence[str | Engine], about: Mapping[str, Any] | None = None, *, arbiter: bool = False
) -> Record:
    """Return the record of one scene; what an engine raises is its error there, and Ctrl-C alone ends the caller.

    Parameters
    ----------
    scene : Scene
    engines : sequence of str or Engine
        Names are looked up among the registered engines.
    about : mapping
        What the generator knows of the scene (kind, Grashof class, branch, distance to a singular pose).
    arbiter : bool
        Whether every position is also held against its enclosure at 113 bits: some milliseconds for each time.
    """
    start = time.perf_counter()
    ref, about = reference(scene), about or {}
    uses = frozenset({Use.COMPARE, Use.FEATURE} if about.get("of_features") else {Use.COMPARE})
    as_expected = ref.motion.verdict == str(about.get("expected", Status.OK))
    known = bool(about.get("well_known"))
    subject = _Subject(ref, key_of(scene), estimated(scene, ref), arbiter, as_expected, uses, well_known=known)
    row = reference_row(ref, time.perf_counter() - start)
    sharp = sharpness_at_common(ref) if subject.drawn(SHARPNESS) else {}
    parts = [_part_of(load(e) if isinstance(e, str) else e, subject) for e in engines]
    return Record(
        key=subject.key,
        scene=scene.name,
        about={"dimension": scene.mechanism.kind.name, **about},
        reference=replace(row, excuse=subject.excuse, sharpness=sharp),
        answers=[answer for part in parts for answer in part.answers],
        levels=[level for part in parts for level in part.levels],
        refusals=[refusal for part in parts for refusal in part.refusals],
        disagreements=[*_of_reference(subject), *(d for part in parts for d in part.disagreements)],
    )


def _of_reference(subject: _Subject) -> Iterator[Disagreement]:
    """Yield the reference's verdict if it is not the one that the scene was made for; what it has the wrong way round.

    Its equations may be closed there: this is asked of it as of the engines, by formulas that are not its own.
    """
    motion = subject.ref.motion
    messages = [] if subject.as_expected else [motion.message]
    messages += [f"{row['message']}: {row['kind']}" for row in put_together_wrongly(subject.ref.scene, motion)[0]]
    who: Any = {"engine": "refkin", "method": "newton", "quantity": "status"}
    for message in messages:
        yield Disagreement(**who, kind=Cause.REFERENCE, how=motion.verdict.value, message=message)


@dataclass
class _Subject:
    """A scene that engines are asked: the reference's answer, and the scene with what they need of it."""

    ref: Reference
    key: str
    scene: Scene
    arbiter: bool
    as_expected: bool
    uses: frozenset[Use] = frozenset({Use.COMPARE})
    well_known: bool = False
    excuse: tuple[float, float] | None = None
    poses: dict[tuple[float, float], tuple[float, float] | None] = field(default_factory=dict)

    @cached_property
    def copy(self) -> Scene:
        """The scene as engines are handed it: nothing that one does to it reaches the reference or the judge."""
        return copied(self.scene)

    @cached_property
    def turned_round(self) -> Scene:
        """The scene stated otherwise (`restated`), at the first quarter of its times."""
        few = self.scene.times[: math.ceil(len(self.scene.times) / TURNED_ROUND)]
        return restated(replace(self.scene, times=few))

    def changed(self) -> bool:
        """Whether an engine has changed the scene that it was handed; what comes after it is handed another.

        Also where it has not: what laws keep at hand, splines, is no part of a scene that is compared.
        """
        return bool(vars(self).pop("copy", self.scene) != self.scene)

    @cached_property
    def configurations(self) -> list[Configuration]:
        """The configurations at which engines' own rows are compared; none if no pose was found to start from."""
        ref = self.ref
        samples = np.flatnonzero(np.isfinite(ref.levels[0][0]))
        if not samples.size:
            return []
        near = ref.system.to_physical(ref.levels[0][:, samples])
        return configurations(ref.scene.mechanism, near, ref.motion.t[samples], self.key, CONFIGURATIONS)

    @cached_property
    def truths(self) -> tuple[Solutions, ...]:
        """What the certificate proves of every time."""
        return scene_truths(self.ref)

    def excused(self, since: float, first: float) -> bool:
        """Whether an engine, right until a time, may give no answer from another on; noted as `excuse`.

        It may because of a nearly singular pose between the two.
        """
        if (since, first) not in self.poses:
            self.poses[since, first] = excuse(self.ref, first, REGULAR, since)
        pose = self.poses[since, first]
        self.excuse = pose or self.excuse
        return pose is not None

    @property
    def rows_asked(self) -> bool:
        """Whether engines' own rows are compared: they do not depend on how near a motion goes to a singular pose."""
        return not self.well_known or self.drawn(WITH_ROWS)

    def drawn(self, every: int) -> bool:
        """Whether it is one of the scenes, one in so many, to which something more is done."""
        return int(self.key, 16) % every == 0


@dataclass
class _Part:
    """What one engine adds to a record."""

    engine: str
    answers: list[Answer] = field(default_factory=list)
    levels: list[LevelRow] = field(default_factory=list)
    refusals: list[RefusalRow] = field(default_factory=list)
    disagreements: list[Disagreement] = field(default_factory=list)

    def blame(self, method: str, *faults: Mapping[str, Any]) -> None:
        """Note what is wrong with the answers of a method."""
        self.disagreements += [Disagreement(engine=self.engine, method=method, **fault) for fault in faults]


def ended(engine: str, failure: Failure) -> Disagreement:
    """Return that something ended an engine at a scene."""
    who: Any = {"engine": engine, "method": ANY, "quantity": "status"}
    return Disagreement(**who, kind=Cause(failure.kind.value), how=failure.how, message=failure.text)


def _part_of(engine: Engine, subject: _Subject) -> _Part:
    try:
        return _of_engine(engine, subject)
    except (Exception, SystemExit) as error:
        subject.changed()  # whoever comes after it is handed another copy
        return _Part(engine.name, disagreements=[ended(engine.name, raised(error))])


def _of_engine(engine: Engine, subject: _Subject) -> _Part:
    """Return what one engine adds: it is asked all that it is asked, and then judged."""
    part = _Part(engine.name)
    part.refusals += _refusals(engine, subject.scene, Level.SOLVE)
    compared = [] if part.refusals else [method for method in methods(engine) if subject.uses & method.uses]
    best = next((method for method in compared if Use.COMPARE in method.uses), None)
    names = [method.called for method in compared]
    if not part.refusals and (best is None or len(set(names)) < len(names)):
        message = f"expected one method or more to compare, each with a name of its own, got {kept(str(names))}"
        part.blame(ANY, wrong("status", Cause.NOT_DELIVERED, message))
    compared = [method for k, method in enumerate(compared) if method.called not in names[:k]]  # or both count as one
    again = subject.arbiter or subject.drawn(TURNED_ROUND)
    with undisturbed():
        told = [_told(method, subject, again=again and method is best) for method in compared]
        if hasattr(engine, "constraints") and subject.rows_asked:
            _check_levels(engine, subject, part)
    for method, answer in zip(compared, told, strict=True):
        _check_method(method, answer, subject, part)
    if subject.changed():
        part.blame(ANY, wrong("status", Cause.CHANGED))
    return part


def _refusals(engine: Engine, scene: Scene, level: Level) -> list[RefusalRow]:
    return [
        RefusalRow(engine=engine.name, joint=key, name=name, level=level.value, reason=reason)
        for key, name, reason in refused_joints(engine, scene.mechanism.constraints, level)
    ]


def estimated(scene: Scene, ref: Reference) -> Scene:
    """Return the scene with an estimate for each body that has none: the reference's first pose, rounded.

    Such a scene leaves open which assembly is meant; engines that chose for themselves would be compared on different
    ones. Rounding leaves two decimals of the size, more where assemblies are near: they are about sigma_min apart.
    """
    m, first = scene.mechanism, ref.levels[0][:, 0]
    if all(body.estimate for body in m.bodies) or not np.isfinite(first).all():
        return scene
    q, size, sigma = ref.system.to_physical(first), ref.system.unit.size, ref.sigma_min[0]
    at = rough({b.name: tuple(q[ref.system.columns(b.name)].tolist()) for b in m.bodies}, size, size * sigma**2)
    bodies = tuple(body if body.estimate else replace(body, estimate=at[body.name]) for body in m.bodies)
    return replace(scene, mechanism=replace(m, bodies=bodies))


def _enclosure(subject: _Subject, motion: Motion, terms: Sequence[Term]) -> EnclosedTimes:
    """Return at how many times a motion lies within the least error of the pose and beyond it, and how far."""
    samples_of = samples(subject.ref.system, subject.truths, subject.ref.scene, motion, terms)
    judgements = [sample.judgement for sample in samples_of if sample.judgement is not None]
    counts = Counter(j.verdict for j in judgements)
    return EnclosedTimes(
        inside=counts[Verdict.INSIDE],
        outside=counts[Verdict.OUTSIDE],
        undecidable=counts[Verdict.UNDECIDABLE],
        no_answer=len(samples_of) - len(judgements),
        radii=largest([j.radii for j in judgements]),
    )


@dataclass
class _Told:
    """What a method answers: its motion, or why there is none, and the terms that it adds to the allowed error.

    `again` says whether it was asked a second time, the scene turned round, and `turned_round` what it answered then.
    """

    motion: Motion | EngineError
    seconds: float = 0.0
    terms: Sequence[Term] = ()
    again: bool = False
    turned_round: Motion | EngineError | None = None


def _told(method: Method, subject: _Subject, *, again: bool) -> _Told:
    """Return what a method answers, as it is then: an engine may write over what it has handed out.

    It is asked again for the first quarter of the times: what depends on how a scene is stated does so at any time, and
    times that are as near as ever take no more steps than before.
    """
    try:
        start = time.perf_counter()
        motion, seconds = method.solve(subject.copy), time.perf_counter() - start
        told = _Told(copied(motion), seconds, again=again)
        told.terms = [term for term in method.terms(subject.copy) if term.level not in LEVELS]
    except EngineError as error:
        return _Told(error)
    told.turned_round = _anew(method, subject.turned_round) if again else None
    return told


def _anew(method: Method, scene: Scene) -> Motion | EngineError:
    """Return what a method answers to a scene that it keeps to itself."""
    try:
        return copied(method.solve(copied(scene)))
    except EngineError as error:
        return error


@np.errstate(over="ignore", invalid="ignore")  # numbers of any size are answers, and what overflows is judged as that
def _check_method(method: Method, told: _Told, subject: _Subject, part: _Part) -> None:
    ref, scene, engine, motion = subject.ref, subject.scene, part.engine, told.motion
    if isinstance(motion, EngineError):
        part.refusals.append(RefusalRow(engine=engine, reason=str(motion)))
        if not _is_refusal(motion, scene) and not subject.excused(*ref.motion.t[[0, -1]]):
            part.blame(method.called, wrong("status", Cause.NO_ANSWER, str(motion)))
        return
    terms, faults = granted(engine, scene, told.terms)
    wrong_form = [wrong("status", Cause.NOT_DELIVERED, why) for why in misshapen(scene, motion)]
    if wrong_form:
        part.blame(method.called, *faults, *wrong_form)
        return
    compared = compare(ref, motion, terms)
    part.answers.append(
        Answer(
            engine=engine,
            version=str(method.producer.version),  # of who was asked, whoever it says that it is
            method=MethodData(**{k: str(v) for k, v in vars(method.producer.route).items()} | {"name": method.called}),
            quantities=quantities(ref, compared),
            missing=compared.missing,
            compared=compared.compared,
            times=len(motion.status),
            seconds=float(f"{told.seconds:.4g}"),
            certificate=_enclosure(subject, motion, terms) if subject.arbiter else None,
            feature=Use.COMPARE not in method.uses,
            granted={term.name: short(term.absolute) for term in terms if term.absolute > ABSOLUTE},
        )
    )
    wrong_way, wrong_at = put_together_wrongly(scene, motion)
    faults += [*undelivered(method.delivers, scene, motion), *wrong_way, *uncompared_faults(ref, motion, terms)]
    if scene.points and not motion.points:
        reason = f"{engine} ({method.called}) gives no motion of points: they are not compared"
        part.refusals.append(RefusalRow(engine=engine, reason=reason))
    faults += [*opened_beside(ref, motion, terms, compared), *points_off(ref, motion, method.delivers, terms, compared)]
    part.blame(method.called, *faults, *(believed(ref, motion) if subject.as_expected else ()))
    part.blame(method.called, *_disagreements(compared, subject, motion, wrong_at))
    part.blame(method.called, *(_asked_again(method, told, compared, subject, terms) if told.again else ()))


def _disagreements(compared: Comparison, subject: _Subject, motion: Motion, wrong_at: Any) -> Iterator[dict[str, Any]]:
    """Yield in what one method's answer is beyond what is allowed.

    At the times `wrong_at` (T,) it has a joint the wrong way round: that is said, and its numbers there add nothing.
    """
    for quantity, q in compared.quantities.items():
        for kind, here in ((Cause.OTHER_ASSEMBLY, compared.elsewhere), (Cause.BEYOND, ~compared.elsewhere)):
            beyond = here & (q.ratio > 1.0) & ~wrong_at
            if beyond.any():
                yield _beyond(subject.ref, motion, quantity, q, kind, beyond)
    if _is_silent(compared, subject):
        bound = is_bound(subject.ref, compared.first_missing)
        yield {**wrong("status", Cause.NO_ANSWER, f"{compared.missing} times without answer"), "bound": bound}


def _is_silent(compared: Comparison, subject: _Subject) -> bool:
    return not all(subject.excused(*silence) for silence in compared.silences)


def _asked_again(
    method: Method, told: _Told, compared: Comparison, subject: _Subject, terms: Sequence[Term]
) -> list[dict[str, Any]]:
    """Return in what a method is wrong where the scene is stated otherwise, and was not before.

    Who is so minds how a scene is stated, unless it answers one of both statements otherwise when asked once more.
    """

    def faults(scene: Scene, motion: Any) -> list[dict[str, Any]]:
        return list(_otherwise(compared, _compared_anew(scene, motion, subject, terms), subject, motion))

    asked = (subject.turned_round, subject.scene)
    found = faults(asked[0], told.turned_round)
    if not found:
        return found
    with undisturbed():
        once_more = [_anew(method, scene) for scene in asked]
    otherwise, as_before = map(faults, asked, once_more)
    if otherwise and not as_before:
        return found
    return [{**fault, "kind": Cause.AGAIN if fault["kind"] is Cause.ORDER else fault["kind"]} for fault in found]


def _otherwise(
    compared: Comparison, again: Comparison, subject: _Subject, motion: Motion | EngineError | None
) -> Iterator[dict[str, Any]]:
    """Yield in what a comparison is within what is allowed, and that of the answer to a later question is not."""
    for quantity, before in compared.quantities.items():
        q = again.quantities[quantity]
        if before.agrees and not q.agrees:
            kind = Cause.NO_NUMBER if np.isinf(q.error).any() else Cause.ORDER
            yield {**wrong(quantity, kind), "ratio": largest_ratio(q.ratio), "at": q.worst}
    if _is_silent(again, subject) and not _is_silent(compared, subject):
        failed = isinstance(motion, EngineError)
        said = f"no answer: {motion}" if failed else f"{again.missing} times without answer"
        yield wrong("status", Cause.ORDER, said)


def _beyond(
    ref: Reference, motion: Motion, quantity: str, q: QuantityComparison, kind: Cause, samples: Any
) -> dict[str, Any]:
    """Return that a quantity is beyond what is allowed at some of its times (T,), and what it violates at the worst."""
    at, violated = worst_at(q.ratio, q.places, samples, motion.t), NOT_KNOWN
    if kind is Cause.BEYOND and at.time is not None:
        violated = violations(ref, motion, QUANTITIES.index(quantity), at.time)
    kind = Cause.NO_NUMBER if np.isinf(q.error[samples]).any() else kind
    bound = kind is Cause.OTHER_ASSEMBLY and is_bound(ref, float(motion.t[samples][0]))
    seen = {"ratio": largest_ratio(q.ratio[samples]), "at": at, "violated": list(violated.names), "bound": bound}
    return {**wrong(quantity, kind, violated.text), **seen}


def _compared_anew(scene: Scene, motion: Any, subject: _Subject, terms: Sequence[Term]) -> Comparison:
    """Return the comparison of a method's answer to the scene, however it is stated there, or at its first times."""
    ref = subject.ref
    if not isinstance(motion, Motion) or any(misshapen(scene, motion)):
        nothing = dict.fromkeys(QUANTITIES, NOTHING)
        whole = (float(ref.motion.t[0]), float(ref.motion.t[-1]))
        return Comparison(nothing, len(scene.times), 0, np.zeros(0, bool), whole[1], [whole])
    return compare(ref, motion, terms, slice(len(scene.times)))


def _is_refusal(error: EngineError, scene: Scene) -> bool:
    """Whether an engine says what it cannot do, rather than that it failed at something it can."""
    return isinstance(error, EngineRefusal) or any(body.estimate is None for body in scene.mechanism.bodies)


def _check_levels(engine: Engine, subject: _Subject, part: _Part) -> None:
    """Compare the engine's own rows for the joints that it does not refuse; a refused joint is named, not skipped."""
    scene, at, table = subject.copy, subject.configurations, engine.capabilities()
    part.refusals += _refusals(engine, scene, Level.JACOBIAN)
    known = [table.get(e.key, {}).get(Level.JACOBIAN) for e in elements_of(scene.mechanism.constraints)]
    if not at or not any(c is not None and c.support is not Support.REFUSED for c in known):
        return
    try:
        model = engine.constraints(scene)
        expect_model(engine, model, scene.mechanism)
        try:
            missing = missing_rows(engine, model, scene.mechanism)
            of_rows = [term for term in terms_of(engine, scene) if term.level in LEVELS]
            terms, faults = granted(engine.name, scene, of_rows)
            part.blame(ROWS, *faults)
            levels = compare_levels(engine, model, scene.mechanism, at, terms)
            part.refusals += _of_other_forms(engine, scene, getattr(model, "form", ""))
        finally:
            if hasattr(model, "close"):
                model.close()
    except EngineError as error:
        part.refusals.append(RefusalRow(engine=engine.name, reason=str(error)))
        if not _is_refusal(error, scene):
            part.blame(ROWS, wrong("status", Cause.NO_ANSWER, str(error)))
        return
    if missing:
        message = f"not there, multiplied by zero, or more than once: {', '.join(missing)}"
        part.blame(ROWS, wrong("status", Cause.NOT_DELIVERED, message))
    for level, compared in levels.items():
        ratio = short(compared.ratio) if np.isfinite(compared.ratio) else sys.float_info.max
        numbers: Any = {"ratio": ratio, "digits": histogram(compared.digits), "rows": compared.rows}
        part.levels.append(LevelRow(engine=engine.name, level=level.value, worst=compared.worst, **numbers))
        if not compared.agrees:
            part.blame(ROWS, {**wrong(level.value, Cause.TRANSLATED), "ratio": ratio, "at": compared.worst})


def _of_other_forms(engine: Engine, scene: Scene, form: str) -> list[RefusalRow]:
    """Return whose own rows of turns are not compared: the formulas have them in another form than the engine."""
    why: Any = {
        "level": Level.JACOBIAN.value,
        "reason": f"its rows are in the form {form!r}, which the formulas have not",
    }
    others = without_form(scene.mechanism, form)
    return [RefusalRow(engine=engine.name, joint=c.type, name=c.name, **why) for c in others]


def restated(scene: Scene) -> Scene:
    """Return the same scene with bodies, joints and drivers in reverse order, and directions of other lengths."""
    m = scene.mechanism
    joints, drivers = (tuple(map(_stretched, some[::-1])) for some in (m.joints, m.drivers))
    return replace(scene, mechanism=Mechanism(m.bodies[::-1], joints, drivers))


def _stretched(constraint: Any) -> Any:
    """Return a joint or driver with its directions twice or half as long, which changes no digit of a unit vector."""
    given = {key: u for key in DIRECTIONS if (u := getattr(constraint, key, None)) is not None}
    factors = {key: 2.0 if max(map(abs, u)) < 1.0 else 0.5 for key, u in given.items()}
    return replace(constraint, **{key: tuple(factors[key] * x for x in u) for key, u in given.items()})
