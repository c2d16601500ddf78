"""The table of hard cases: engine, method, case, distance, verdict; of what is wrong the class and the quotation.

A verdict is the worst that a method did at any time of a scene, in a word and in words.

`of` is how many cases there were: where time did not suffice for all, all methods were asked the same ones.
"""

from __future__ import annotations

import time
import warnings
from collections.abc import Callable, Iterator, Sequence
from contextlib import closing
from functools import lru_cache
from itertools import pairwise
from typing import Any

from crosscheck.engines import EngineError
from crosscheck.engines.methods import Method, Use, copied, methods
from crosscheck.engines.undisturbed import undisturbed
from crosscheck.judge.delivery import granted, misshapen
from crosscheck.judge.hard_poses import PoseSample, Solutions, samples, truths
from crosscheck.judge.known_gaps import BAD, Finding, HardOutcome, finding_of, read_findings
from crosscheck.measure.bench import key_of
from crosscheck.scenes.hard import hard_cases
from crosscheck.scenes.hard_case import HardCase
from crosscheck.workers.processes import Failure, call_each, call_in_turn
from refkin.proof.pose.krawczyk import Verdict
from refkin.system import System


def listed(spec: str) -> list[tuple[str, str, str]] | EngineError:
    """Return engine, name and setting of each method that hard cases are sent through, or why there is no engine."""
    try:
        return [method.key for method in _methods(spec)]
    except EngineError as error:
        return EngineError(str(error))


def outcome_of(job: tuple[str, str, str, str]) -> tuple[str, str]:
    """Return the outcome of one method on one case, and what there is to say of it. Runs in another process.

    The job is what `engines.loading.load` takes, name and setting of a method, and a case's key.
    """
    spec, name, setting, key = job
    case, system, truth = _known(key)
    method = next(m for m in _methods(spec) if (m.name, m.setting) == (name, setting))
    with warnings.catch_warnings(record=True) as heard:
        warnings.simplefilter("always")
        try:
            with undisturbed():
                scene = copied(case.scene)
                terms, _ = granted(method.engine, scene, method.terms(scene))
                motion = method.solve(scene)
        except EngineError as error:
            rightly = "" if any(t.roots for t in truth) else "rightly, there is no assembly: "
            return HardOutcome.REFUSED.value, f"{rightly}{error}"
    for why in misshapen(case.scene, motion):
        return HardOutcome.WRONG.value, why
    poses = samples(system, truth, case.scene, motion, terms)
    said = " ".join(str(w.message) for w in heard if not issubclass(w.category, DeprecationWarning))
    return classed(poses, said)


def classed(poses: Sequence[PoseSample], said: str = "") -> tuple[str, str]:
    """Return the worst of an engine's answers at the times of a scene, in a word and in words.

    Wrong: an answer called ok lies outside. Refused: at a time there is no answer, or none that is called ok and right.
    Warned: every answer is right, but some is not called ok, or the engine warned. What the certificate leaves
    undecidable is held against nobody.
    """
    wrong = [s for s in poses if s.called_ok and (s.judgement is None or s.judgement.verdict is Verdict.OUTSIDE)]
    if wrong:
        farthest = max(wrong, key=lambda s: float("inf") if s.judgement is None else s.judgement.radii)
        worst = _told(farthest, len(wrong), len(poses))
        return HardOutcome.WRONG.value, f"{worst}; it warned: {said}" if said else worst
    lost = [s for s in poses if s.judgement is None or (not s.called_ok and s.judgement.verdict is Verdict.OUTSIDE)]
    if lost:
        rightly = "rightly, there is no assembly: " if all(s.none for s in lost) else ""
        return (
            HardOutcome.REFUSED.value,
            f"{rightly}no answer at {len(lost)} of {len(poses)} times, first t = {lost[0].t:g}",
        )
    doubted = [s for s in poses if not s.called_ok]
    open_ = sum(s.judgement is not None and s.judgement.verdict is Verdict.UNDECIDABLE for s in poses)
    note = f"undecidable at {open_} of {len(poses)} times" if open_ else ""
    if doubted or said:
        doubt = f"called {'not ok' if doubted else 'ok'} at {len(doubted) or len(poses)} of {len(poses)} times"
        return HardOutcome.WARNED.value, "; ".join(filter(None, (doubt, said, note)))
    return HardOutcome.CORRECT.value, note


def _told(worst: PoseSample, count: int, of: int) -> str:
    note = f"{worst.note}: " if worst.note else ""
    away = "" if worst.judgement is None else f"{worst.judgement.radii:.2g} radii outside "
    return f"{note}{away}at t = {worst.t:g}; wrong at {count} of {of} times"


@lru_cache(maxsize=1)
def _cases() -> dict[str, HardCase]:
    return {case.key: case for case in hard_cases()}


@lru_cache(maxsize=4)
def _known(key: str) -> tuple[HardCase, System, tuple[Solutions, ...]]:
    case = _cases()[key]
    return case, *truths(case)


@lru_cache(maxsize=8)
def _methods(spec: str) -> list[Method]:
    return methods(spec, Use.HARD)


SECONDS = 20.0
"""After this long on one scene a method is said to hang: the slowest takes about three."""
PROCESSES = 2
"""How many processes take the methods in turn: what is proved of a case is computed once in each, for all engines. What
fails in one is asked again in a process that no other engine has had: it alone says whose failure it is."""

Row = dict[str, Any]


def hard_case_rows(
    engines: Sequence[str],
    within: float | None = None,
    *,
    cases: Sequence[HardCase] | None = None,
    findings: Sequence[Finding] | None = None,
    seconds: float = SECONDS,
    tell: Callable[[int, str], None] = lambda done, case: None,
) -> list[Row]:
    """Return one row per engine, method and case, as the module says, all plain data; EngineError without an engine.

    Parameters
    ----------
    engines : sequence of str
        What `engines.loading.load` takes, or "refkin" for the reference itself.
    within : float, optional
        After this many seconds no further case is begun, for any engine. Of each kind the nearest case comes first,
        then the farthest, then what lies between: what is left out is neither the easiest nor the hardest.
    cases : sequence of HardCase, optional
        All by default; each must be one of them.
    findings : sequence of Finding, optional
        What classes and quotes wrong answers; `findings.toml` by default.
    seconds : float
        After this long on one case a method is said to hang.
    tell : callable
        Is told how many cases are done, and which comes next.
    """
    end = None if within is None else time.monotonic() + within
    chosen = _in_turn_by_kind(hard_cases() if cases is None else cases)
    known = read_findings() if findings is None else findings
    rows = list(_rows(engines, chosen, known, seconds, end, tell))
    order = {case.key: k for k, case in enumerate(hard_cases())}
    names = list(dict.fromkeys(key_of(row) for row in rows))
    rows.sort(key=lambda row: (order[row.pop("key")], names.index(key_of(row))))
    return rows


def _rows(
    engines: Sequence[str],
    cases: Sequence[HardCase],
    known: Sequence[Finding],
    seconds: float,
    end: float | None,
    tell: Callable[[int, str], None],
) -> Iterator[Row]:
    """Yield rows, case by case: where time is up, all engines have been asked the same cases."""
    by_engine = dict(zip(engines, call_each(listed, engines), strict=True))
    for answer in by_engine.values():
        if isinstance(answer, Failure | EngineError):
            raise answer if isinstance(answer, EngineError) else EngineError(answer.text)
    asked = [(spec, key) for spec, keys in by_engine.items() for key in dict.fromkeys(keys)]
    jobs = [(spec, name, setting, case.key) for case in cases for spec, (_, name, setting) in asked]
    with closing(call_in_turn(outcome_of, jobs, seconds, PROCESSES)) as answers:
        for done, case in enumerate(cases):
            tell(done, case.key)
            if end is not None and time.monotonic() > end:
                break
            for n, (_, key) in enumerate(asked, done * len(asked)):
                answer = next(answers)
                if isinstance(answer, Failure):
                    answer = _alone(jobs[n], answer, seconds)
                yield _row(key, case, answer, len(cases), known)


def _alone(job: tuple[str, str, str, str], first: Failure, seconds: float) -> Any:
    """Return the outcome of a job in a process that no other engine has had, with what came of it in the other one."""
    answer = call_each(outcome_of, [job], seconds)[0]
    if isinstance(answer, Failure):
        return answer
    verdict, note = answer
    return verdict, "; ".join(filter(None, (note, f"in a process with other engines: {first.name}")))


def _row(key: tuple[str, str, str], case: HardCase, answer: Any, of: int, known: Sequence[Finding]) -> Row:
    engine, name, setting = key
    if isinstance(answer, Failure):  # a hang, a crash, or an exception that is no refusal
        ended = HardOutcome.HANG if answer.kind == "hang" else HardOutcome.CRASH
        answer = ended.value, f"{answer.name}: {answer.text}"
    verdict, note = answer
    who = {"key": case.key, "engine": engine, "method": name, "setting": setting}
    row = {**who, "case": case.case, "distance": case.distance, "of": of, "verdict": verdict}
    finding = finding_of(known, row) if verdict in BAD else None
    return {
        **row,
        "class": None if finding is None else finding.kind,
        "quote": None if finding is None else f"{finding.quote} ({finding.source})",
        "note": note,
    }


def _in_turn_by_kind(cases: Sequence[HardCase]) -> list[HardCase]:
    """Return the nearest of every kind, then the farthest of every kind, and so on: the widest gap is halved next."""
    kinds: dict[str, list[HardCase]] = {}
    for case in cases:
        kinds.setdefault(case.case, []).append(case)
    ordered = [[kind[k] for k in spread(len(kind))] for kind in kinds.values()]
    return [kind[turn] for turn in range(max(map(len, ordered), default=0)) for kind in ordered if turn < len(kind)]


def spread(count: int) -> list[int]:
    """Return the numbers below a count: the last, the first, then always the middle of the widest gap."""
    taken = list(dict.fromkeys((count - 1, 0)))[:count]
    while len(taken) < count:
        known = sorted(taken)
        low, high = max(pairwise(known), key=lambda gap: gap[1] - gap[0])
        taken.append((low + high) // 2)
    return taken
