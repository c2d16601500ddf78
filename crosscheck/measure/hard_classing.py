"""One method of one engine on one hard scene: the worst it did at any time, in a word and in words."""

from __future__ import annotations

import json
import warnings
from collections.abc import Sequence
from functools import lru_cache

from crosscheck.engines import EngineError
from crosscheck.engines.methods import Method, Use, methods
from crosscheck.judge.hard_poses import HardOutcome, PoseSample, Solutions, samples, truths
from crosscheck.scenes.hard import hard_cases
from crosscheck.scenes.hard_case import HardCase
from crosscheck.workers.processes import Failure
from refkin.proof.pose.krawczyk import Verdict
from refkin.system import System


def listed(spec: str) -> list[tuple[str, str, str]]:
    """Return engine, name and setting of each method that hard cases are sent through, of shipped defaults as well."""
    return [method.key for method in _methods(spec)]


def job(spec: str, name: str, case: str, setting: str = "") -> str:
    """Return what `outcome_of` takes."""
    return json.dumps([spec, name, setting, case])


def outcome_of(text: str) -> tuple[str, str]:
    """Return the outcome of one method on one case, and what there is to say of it. Runs in a process of its own."""
    spec, name, setting, key = json.loads(text)
    case, system, truth = _known(key)
    method = next(m for m in _methods(spec) if (m.name, m.setting) == (name, setting))
    with warnings.catch_warnings(record=True) as heard:
        warnings.simplefilter("always")
        try:
            terms = method.terms(case.scene)
            motion = method.solve(case.scene)
        except EngineError as error:
            return HardOutcome.REFUSED.value, _rightly(truth) + str(error)
    poses = samples(system, truth, case.scene, motion, terms)
    said = " ".join(str(w.message) for w in heard if not issubclass(w.category, DeprecationWarning))
    return classed(poses, said)


def outcome_of_failure(failure: Failure) -> tuple[str, str]:
    """Return what it is that a process failed at a case: a hang, a crash, or an exception that is no refusal."""
    return (HardOutcome.HANG if failure.kind == "hang" else HardOutcome.CRASH).value, f"{failure.name}: {failure.text}"


def classed(poses: Sequence[PoseSample], said: str = "") -> tuple[str, str]:
    """Return the worst of an engine's answers at the times of a scene, in a word and in words.

    Wrong: an answer called ok lies outside. Refused: at a time there is no answer, or none that is called ok and right.
    Warned: every answer is right, but some is not called ok, or the engine warned. What the certificate leaves
    undecidable is held against nobody.
    """
    wrong = [s for s in poses if s.called_ok and (s.judgement is None or s.judgement.verdict is Verdict.OUTSIDE)]
    if wrong:
        worst = _told(max(wrong, key=_radii), len(wrong), len(poses))
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


def _radii(sample: PoseSample) -> float:
    return float("inf") if sample.judgement is None else sample.judgement.radii


def _told(worst: PoseSample, count: int, of: int) -> str:
    note = f"{worst.note}: " if worst.note else ""
    away = "" if worst.judgement is None else f"{worst.judgement.radii:.2g} radii outside "
    return f"{note}{away}at t = {worst.t:g}; wrong at {count} of {of} times"


def _rightly(truth: Sequence[Solutions]) -> str:
    return "" if any(t.roots for t in truth) else "rightly, there is no assembly: "


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
