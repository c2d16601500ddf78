"""The rows of one engine, measured; this is what a process of the ledger does."""

from __future__ import annotations

import json
from collections.abc import Mapping, Sequence
from dataclasses import asdict, replace
from typing import Any

from crosscheck.engines import EngineError, EngineRefusal, Term
from crosscheck.engines.methods import Method, Use, methods
from crosscheck.judge.changes import change
from crosscheck.judge.comparison import Reference, reference
from crosscheck.judge.effects_rows import EffectRow
from crosscheck.measure.effects_ablations import Ablation, Ablations, ablations
from crosscheck.scenes.names import PHYSICAL
from crosscheck.workers.timing import Timing, timed_in_turns
from refkin.model import Scene
from refkin.motion import Motion
from refkin.scenes.files import parse

MOST_TIMES = 37
"""Configurations of a scene that are measured, the first ones: a march depends on the times before it."""

ROUNDS = 25
"""An effect is a small difference of two large times: more rounds than elsewhere, as far as there is time."""
FEWEST = 2
"""Rounds there are however long they take: nothing is known of the noise of a price of one."""
GROUPS = 3
"""Into how many parts the rounds are divided, to see how far a difference repeats."""


def task(scene: Mapping[str, Any], spec: str, within: float, effect: str = "") -> str:
    """Return what `measured` takes, as text: a scene's data, an engine, how long to measure, an effect or all."""
    return json.dumps({"scene": scene, "spec": spec, "within": within, "effect": effect})


def measured(text: str) -> list[dict[str, Any]]:
    """Return the rows of one engine, or of one effect alone, as plain data."""
    asked = json.loads(text)
    scene = parse(asked["scene"])
    scene = replace(scene, times=scene.times[:MOST_TIMES])
    ablated = [ablations(method, scene) for method in methods(asked["spec"], Use.EFFECTS)]
    if asked["effect"]:
        ablated = [_alone(each, asked["effect"]) for each in ablated]
    ref = reference(replace(scene, evidence=frozenset(), points=(), bodies_wanted=None))
    share = asked["within"] / max(len(ablated), 1)
    return [asdict(row) for each in ablated for row in rows(each, ref, share, _terms(each.method, scene))]


def _alone(ablated: Ablations, effect: str) -> Ablations:
    effects = tuple(a for a in ablated.effects if a.effect == effect)
    names = {name for a in effects for name in (a.off, a.on)}
    absent = {name: why for name, why in ablated.absent.items() if name == effect}
    return replace(ablated, effects=effects, works={name: ablated.works[name] for name in names}, absent=absent)


def _terms(method: Method, scene: Scene) -> Sequence[Term]:
    """Return what the method adds to the allowed error; what refuses the scene adds nothing."""
    try:
        return method.terms(scene)
    except EngineError:
        return ()


def rows(ablated: Ablations, ref: Reference, within: float, terms: Sequence[Term] = ()) -> list[EffectRow]:
    """Return a row for each effect of a method.

    Parameters
    ----------
    ref : Reference
        The reference's answer to the scene, which allowed errors are derived at.
    within : float
        How long to measure [s].
    """
    answers = {name: _answer(work) for name, work in ablated.works.items()}
    works = {name: work for name, work in ablated.works.items() if not isinstance(answers[name], EngineError)}
    timings = timed_in_turns(works, rounds=ROUNDS, fewest=FEWEST, within=within) if works else {}
    there = [_row(ablated, a, answers, timings, ref, terms) for a in ablated.effects]
    return there + [unmeasured(ablated.method.key, effect, why) for effect, why in ablated.absent.items()]


def _answer(work: Any) -> Motion | EngineError:
    try:
        answer: Motion = work()
    except EngineError as error:
        return error
    return answer


def _row(
    ablated: Ablations,
    a: Ablation,
    answers: Mapping[str, Motion | EngineError],
    timings: Mapping[str, Timing],
    ref: Reference,
    terms: Sequence[Term],
) -> EffectRow:
    off, on, key = answers[a.off], answers[a.on], ablated.method.key
    if isinstance(off, EngineError):
        return unmeasured(key, a.effect, f"no answer without it: {off}")
    if isinstance(on, EngineRefusal):
        return unmeasured(key, a.effect, str(on))
    if isinstance(on, EngineError):
        return unmeasured(key, a.effect, f"{a.note}: {on}", inert=False)
    if a.on == "points" and not on.points:
        return unmeasured(key, a.effect, "the adapter reports no motion of points")
    changed = change(ref, off, on, terms, exact=ablated.exact)
    before, after, per = timings[a.off], timings[a.on], 1e6 / len(off.t)
    return EffectRow(
        engine=key[0],
        method=key[1],
        setting=key[2],
        effect=a.effect,
        microseconds=(after.seconds - before.seconds) * per,
        without=before.seconds * per,
        spread=noise(before.turns, after.turns, per),
        inert=changed.inert,
        largest_change=changed.largest,
        worst=changed.worst,
        called_for=a.called_for,
        note=a.note,
    )


def noise(before: Sequence[float], after: Sequence[float], per: float = 1.0) -> float | None:
    """Return how far off the difference of two least times may be; None for a single round.

    Parameters
    ----------
    before, after : sequence of float
        One call in each round [s], without the effect and with it.
    per : float
        What the result is multiplied by.

    Returns
    -------
    float or None
        The range of that difference over groups of rounds (every third one, of few every second). It is at least
        as much as the effect seems to save: who does more cannot take less time, so that this is noise, too.
    """
    count = len(before)
    if count < 2:
        return None
    groups = GROUPS if count >= 2 * GROUPS else 2
    differences = [min(after[k::groups]) - min(before[k::groups]) for k in range(groups)]
    return max(max(differences) - min(differences), min(before) - min(after)) * per


def unmeasured(key: tuple[str, str, str], effect: str, note: str, inert: bool | None = None) -> EffectRow:
    """Return the row of an effect without a price: not known to be inert, or known not to be."""
    return EffectRow(
        engine=key[0],
        method=key[1],
        setting=key[2],
        effect=effect,
        microseconds=None,
        without=None,
        spread=None,
        inert=inert,
        largest_change=None,
        worst="",
        called_for=effect not in PHYSICAL,
        note=note,
    )
