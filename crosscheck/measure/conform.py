"""Whether an engine keeps its promises: it is asked each joint at each level; what it gets wrong is said in words."""

from __future__ import annotations

from collections.abc import Collection, Iterator, Sequence
from contextlib import closing
from dataclasses import dataclass, replace
from functools import lru_cache

import numpy as np

from crosscheck.engines import QUANTITIES, Engine, EngineError, Level, refused_joints
from crosscheck.engines.loading import load
from crosscheck.engines.methods import Use, copied, methods, motion_of
from crosscheck.judge.comparison import compare, reference
from crosscheck.judge.delivery import granted
from crosscheck.judge.known_gaps import BAD, HardOutcome
from crosscheck.judge.records import ENDED, Cause, Disagreement, Record
from crosscheck.measure.check import check, restated
from crosscheck.measure.hard_table import hard_case_rows
from crosscheck.scenes.conformance import Question, questions
from crosscheck.scenes.hard import hard_cases
from crosscheck.scenes.names import called, order_of
from crosscheck.workers.processes import Failure, FailureKind, call_in_turn, preload
from refkin.joints.spatial_bodies import UnitLength
from refkin.model import Scene

SECONDS = 60.0
"""After this long at one question an engine is said to hang."""
MOST_HUNG = 3
"""Of an engine that has hung so often nothing more is asked."""
HARD_WITHIN = 60.0
"""After so long no further hard case is asked [s]."""
FORM = "form"
"""The level of what is wrong with an answer before any number is looked at."""
STATUS, ROWS = "status", "own rows"
LEVELS = (*QUANTITIES, STATUS, FORM, ROWS)


@dataclass(frozen=True)
class LevelFault:
    """Something that an engine got wrong, at one of `LEVELS`: in words, the same for faults of one kind.

    `example` says where, and by how much; `types` are those of the joints and drivers that the answer violates.
    """

    level: str
    what: str
    example: str = ""
    types: tuple[str, ...] = ()


@dataclass(frozen=True)
class Reply:
    """What came of one question: what is wrong with the answers, or why there is none.

    `levels` are those that were held against the reference, own rows among them.
    """

    about: str
    faults: tuple[LevelFault, ...] = ()
    refusals: tuple[str, ...] = ()
    levels: tuple[str, ...] = ()

    @property
    def answered(self) -> bool:
        """Whether there was anything to be right or wrong."""
        return bool(self.levels or self.faults)


def ask(engine: Engine, question: Question) -> Reply:
    """Ask an engine one question, also with the scene stated otherwise.

    For a test of an engine of your own: `assert not ask(MyEngine(), question).faults`, for each of `questions()`.
    """
    reasons = [reason for *_, reason in refused_joints(engine, question.scene.mechanism.constraints, Level.SOLVE)]
    refused = tuple(dict.fromkeys(reasons))
    if refused and not hasattr(engine, "constraints"):
        return Reply(question.about, refusals=refused)
    about = {"expected": str(question.expected)}
    record = check(question.scene, [engine], about)
    faults = list(_faults_of(record, question.scene))
    if not faults and (record.answers or record.levels):
        faults = _stated_otherwise(engine, question.scene, record, about)
    if not faults and record.answers:
        faults = list(_asked_again(engine, question.scene, [answer.method.name for answer in record.answers]))
    levels = {q for answer in record.answers for q in answer.quantities} | ({ROWS} if record.levels else set())
    refused = refused or tuple(dict.fromkeys(row.reason for row in record.refusals if not row.joint))
    return Reply(question.about, tuple(faults), refused, tuple(level for level in LEVELS if level in levels))


def _stated_otherwise(engine: Engine, scene: Scene, record: Record, about: dict[str, str]) -> list[LevelFault]:
    """Return in what an engine that answered a scene is wrong where that is stated otherwise.

    Or where it is asked again: as in `check`, who answers one of both statements otherwise than before does not mind
    which it is.
    """

    def asked(scene: Scene) -> Record:
        return check(scene, [engine], about)

    def faults(again: Record, kind: Cause = Cause.ORDER) -> list[LevelFault]:
        return list(_faults_again(record, again, scene, kind))

    first = asked(restated(scene))
    if not faults(first) or (faults(asked(restated(scene))) and not faults(asked(scene))):
        return faults(first)
    return faults(first, Cause.AGAIN)


def _faults_again(record: Record, again: Record, scene: Scene, kind: Cause) -> Iterator[LevelFault]:
    """Yield in what the answer to a later question is wrong, as of a kind; or silent, and why."""
    said, *_ = *(d.message for d in again.disagreements), *(row.reason for row in again.refusals if not row.joint), ""
    silent = [method for method in _answering(record) if method not in _answering(again)]
    where = "where a scene is stated otherwise" if kind is Cause.ORDER else "when asked again"
    for method in silent:
        yield LevelFault(STATUS, f"no answer {where} (method {method!r})", said)
    others = [d for d in again.disagreements if d.method not in silent and d.kind not in ENDED]
    yield from _faults_of(replace(again, disagreements=[replace(d, kind=kind) for d in others]), scene)


def _answering(record: Record) -> list[str]:
    return [answer.method.name for answer in record.answers] + [ROWS] * bool(record.levels)


def _asked_again(engine: Engine, scene: Scene, answered: Collection[str]) -> Iterator[LevelFault]:
    """Yield which model, built once and asked again, does not answer as it has to: a price is that of such a model.

    Those of methods that have `answered` the scene are asked.
    """
    scene = replace(scene, points=(), bodies_wanted=None)
    bodies = tuple(body.name for body in scene.mechanism.bodies)
    kept = [method for method in methods(engine, Use.COMPARE) if method.build and method.called in answered]
    ref = reference(scene) if kept else None
    for method in kept:
        again = f"where its model is asked again (method {method.called!r})"
        try:
            model = method.model(copied(scene))
            orders = method.highest, 0, min(order_of(scene), method.highest)
            answers = ((model.read(model.solve(order)), order) for order in orders)
            motions = [copied(motion_of(scene.times, bodies, q[: order + 1], method.producer)) for q, order in answers]
        except EngineError as error:
            yield LevelFault(STATUS, f"no answer {again}", str(error))
            continue
        terms = [term for term in granted(method.engine, scene, method.terms(scene))[0] if term.level in QUANTITIES]
        assert ref is not None
        each = [compare(ref, motion, terms) for motion in motions]
        missing = [one.missing for one in each if one.missing]
        if missing:
            yield LevelFault(STATUS, f"no answer {again}", f"{missing[0]} times")
        wrong = [(name, q.ratio) for one in each for name, q in one.quantities.items() if not q.agrees]
        for name, ratio in wrong[:1]:  # the others follow from it
            yield LevelFault(name, f"{name} is wrong {again}", f"{np.max(ratio):.3g} times the allowed error")


OF_NUMBERS = (Cause.BEYOND, Cause.OTHER_ASSEMBLY, Cause.NO_NUMBER, Cause.ORDER, Cause.AGAIN)
"""Kinds in which a wrong number of one level makes those of the others wrong."""


def _faults_of(record: Record, scene: Scene) -> Iterator[LevelFault]:
    """Yield what a record says against an engine, of each method the first level alone: the others follow from it."""
    types = {body.name: UnitLength.type for body in scene.mechanism.bodies}  # rows of bodies of space, not of joints
    types |= {c.name: c.type for c in scene.mechanism.constraints}
    beyond: set[str] = set()
    for wrong in record.disagreements:
        level = wrong.quantity if wrong.quantity in (*QUANTITIES, STATUS) else ROWS
        level = FORM if level == STATUS and wrong.kind is Cause.NOT_DELIVERED else level
        if level in QUANTITIES and wrong.kind in OF_NUMBERS:
            if wrong.method in beyond:
                continue
            beyond.add(wrong.method)
        ratio = "" if wrong.ratio is None else f"{wrong.ratio:.3g} times the allowed error"
        example = "; ".join(filter(None, (wrong.worst if wrong.kind is not Cause.NOT_DELIVERED else "", ratio)))
        yield LevelFault(level, _words(wrong), example, tuple(dict.fromkeys(types[n] for n in wrong.violated)))


def _words(wrong: Disagreement) -> str:
    if wrong.kind is Cause.TRANSLATED:
        return f"its own rows at level {wrong.quantity} are not those of the scene"
    subject, verb = ("", "") if wrong.quantity == STATUS else (f"{wrong.quantity} ", "is ")
    words = {Cause.BEYOND: "is wrong", Cause.NOT_DELIVERED: f"{verb}{wrong.message}", Cause.NO_ANSWER: "no answer"}
    return f"{subject}{words.get(wrong.kind, wrong.name)} (method {wrong.method!r})"


@lru_cache(maxsize=1)
def _asked() -> dict[str, Question]:
    return {question.about: question for question in questions()}


@lru_cache(maxsize=1)
def _loaded(spec: str) -> Engine:
    return load(spec)


def reply(job: tuple[str, str]) -> Reply:
    """Return what came of one question (engine as `load` takes it, what it is about), in a process of the engine's own.

    All questions go to one engine: what it keeps of a scene shows in its answer to the next.
    """
    return ask(_loaded(job[0]), _asked()[job[1]])


preload(__name__)


def replies(spec: str) -> Iterator[Reply]:
    """Yield what comes of each question; one at which an engine crashes is none of the others', nor are a few hangs."""
    jobs = [(spec, about) for about in _asked()]
    hung = 0
    with closing(call_in_turn(reply, jobs, SECONDS)) as answers:
        for _, about in jobs:
            if hung == MOST_HUNG:
                yield Reply(about, refusals=(f"it was not asked: it hung at {hung} questions",))
                continue
            answer = next(answers)
            if isinstance(answer, Failure):
                hung += answer.kind is FailureKind.HANG
                answer = Reply(about, (LevelFault(STATUS, f"{answer.kind}", f"{answer.name}: {answer.text}"),))
            yield answer


def hard_replies(spec: str, within: float = HARD_WITHIN) -> Iterator[Reply]:
    """Yield what comes of one hard case of each kind: what matters there is that nothing wrong is called right."""
    first = {case.case: case for case in reversed(hard_cases())}
    for row in hard_case_rows([spec], within, cases=list(reversed(first.values()))):
        about = f"hard case: {row['case']}"
        if row["verdict"] == HardOutcome.REFUSED:
            parts = (part.partition(f" at {Level.SOLVE}: ")[2] or part for part in row["note"].split("; "))
            yield Reply(about, refusals=tuple(dict.fromkeys(parts)))  # of each joint the reason alone, said once
            continue
        wrong = row["verdict"] in BAD and row["class"] is None
        what = {HardOutcome.WRONG: "a wrong pose is called ok at a hard case"}.get(row["verdict"], row["verdict"])
        who = called(row["method"], row["setting"])
        faults = (LevelFault(STATUS, f"{what} (method {who!r})", row["note"]),) if wrong else ()
        yield Reply(about, faults, levels=(QUANTITIES[0],))


def summary(replied: Sequence[Reply]) -> list[str]:
    """Return what all wrong answers have in common: a level, and the type of a joint."""
    wrong = [fault for reply in replied for fault in reply.faults if fault.types or fault.level in QUANTITIES]
    if not any(fault.types for fault in wrong):
        return []
    lines = []
    common = set.intersection(*(set(fault.types) for fault in wrong))
    if common:
        lines.append(f"every answer with a wrong number violates a {' or a '.join(sorted(common))}")
    levels = {fault.level for fault in wrong}
    if len(levels) == 1 and (level := levels.pop()) != QUANTITIES[0]:
        lines.append(f"whatever the joint, numbers are right up to the {level}, which is the first that is wrong")
    return lines
