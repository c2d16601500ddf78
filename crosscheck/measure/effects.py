"""The ledger of effects: what is switched on and off in each method, each effect by itself.

The reference and the engines come one after the other, each in a process of its own.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from contextlib import closing
from dataclasses import dataclass, field, replace
from functools import partial
from typing import Any

from crosscheck.engines import PHYSICAL, QUANTITIES, EngineError, EngineRefusal, Term
from crosscheck.engines.methods import ORDERS, Method, Use, copied, methods
from crosscheck.engines.undisturbed import undisturbed
from crosscheck.judge.changes import change
from crosscheck.judge.comparison import Reference, reference
from crosscheck.judge.delivery import misshapen
from crosscheck.judge.prices import EffectRow
from crosscheck.workers.pool import name_and_version
from crosscheck.workers.processes import Failure, FailureKind, call_each, call_in_turn
from crosscheck.workers.timing import Timing, timed_in_turns
from refkin.model import Evidence, Point, Scene
from refkin.motion import Motion
from refkin.scenes.files import parse, to_dict

MOST_TIMES = 37
"""Configurations of a scene that are measured, the first ones: a march depends on the times before it."""

ROUNDS = 25
"""An effect is a small difference of two large times: more rounds than elsewhere, as far as there is time."""
FEWEST = 2
"""Rounds there are however long they take: nothing is known of the noise of a price of one."""
KEY = ("engine", "method", "setting")
GROUPS = 3
"""Into how many parts the rounds are divided, to see how far a difference repeats."""


REFKIN = "refkin"
POSITION, VELOCITY, ACCELERATION = QUANTITIES


@dataclass(frozen=True, kw_only=True)
class Ablation:
    """An effect as two answers, by name: without it and with it."""

    effect: str
    off: str = ACCELERATION
    on: str
    called_for: bool = True
    note: str


@dataclass(frozen=True)
class Ablations:
    """What is measured of one method: its answers by name, the effects as pairs of them, and why others are absent."""

    method: Method
    runs: Mapping[str, Callable[[], Motion]]
    effects: tuple[Ablation, ...]
    absent: Mapping[str, str] = field(default_factory=dict)


LEVELS = (
    Ablation(effect=VELOCITY, off=POSITION, on=VELOCITY, note="beyond position"),
    Ablation(effect=ACCELERATION, off=VELOCITY, on=ACCELERATION, note="beyond velocity"),
)
EVIDENCE = {Evidence.CONDITION: "singular values of phi_q", Evidence.CERTIFICATE: "a proof of every pose and rate"}


def ablations(method: Method, scene: Scene, only: str = "") -> Ablations:
    """Return what is switched on and off in a method, each effect against an answer without it.

    Evidence is the reference's own; physical effects are an engine's, which may have been made to simulate.

    Parameters
    ----------
    method, scene : Method, Scene
    only : str
        The effect that is asked for, "" for all.
    """
    whole = replace(scene, effects=ORDERS[-1], evidence=frozenset(), points=(), bodies_wanted=None)
    body, origin = scene.mechanism.bodies[0].name, (0.0,) * scene.mechanism.kind.dimension
    points = scene.points or (Point(name="a point", body=body, position=origin),)
    scenes = {q: replace(whole, effects=effects) for q, effects in zip(QUANTITIES, ORDERS, strict=True)}
    scenes["points"] = replace(whole, points=points)
    many = f"{len(points)} of them, position to acceleration"
    listed = [*LEVELS[: method.highest], Ablation(effect="points", on="points", note=many)]
    absent = {} if len(scene.mechanism.bodies) > 1 else {"other bodies": f"{body} is the only body"}
    absent |= {level.effect: "the engine delivers none" for level in LEVELS[method.highest :]}
    if len(scene.mechanism.bodies) > 1:
        scenes["one body"] = replace(whole, bodies_wanted=(body,))
        listed.append(Ablation(effect="other bodies", off="one body", on=ACCELERATION, note=f"those beside {body}"))
    runs: dict[str, Callable[[], Motion]] = {}
    if method.engine == REFKIN:
        for kind, note in EVIDENCE.items():
            scenes[kind.value] = replace(whole, evidence=frozenset({kind}))
            listed.append(Ablation(effect=kind.value, on=kind.value, note=note))
        absent |= dict.fromkeys(PHYSICAL, "refkin has none: no formula of it holds a mass or a force")
    else:
        engine = method.adapter if hasattr(method.adapter, "with_effect") else None
        none = "the engine offers no simulation to switch on"
        simulated = engine.physical_effects() if engine else {}
        reasons = engine.missing_effects() if engine else dict.fromkeys(PHYSICAL, none)
        for effect, how in simulated.items():
            runs[effect] = partial(method.affected(effect).solve, copied(whole))
            listed.append(Ablation(effect=effect, on=effect, called_for=False, note=how))
        absent |= {kind.value: "evidence is the reference's own, the engine gives none" for kind in EVIDENCE}
        absent |= {e: reasons.get(e, "the engine names none") for e in PHYSICAL if e not in simulated}
    runs |= {name: partial(method.solve, copied(asked)) for name, asked in scenes.items()}
    if only:
        listed = [a for a in listed if a.effect == only]
        runs = {name: runs[name] for a in listed for name in (a.off, a.on)}
        absent = {effect: why for effect, why in absent.items() if effect == only}
    return Ablations(method, runs, tuple(listed), absent)


def measured(asked: tuple[Mapping[str, Any], str, float, str]) -> list[EffectRow]:
    """Return the rows of one engine, or of one effect alone.

    Asked with a scene's data, what `engines.loading.load` takes, how long to measure, and an effect, "" for all.
    """
    data, spec, within, effect = asked
    scene = parse(data)
    scene = replace(scene, times=scene.times[:MOST_TIMES])
    ablated = [ablations(method, scene, effect) for method in methods(spec, Use.EFFECTS)]
    ref = reference(replace(scene, evidence=frozenset(), points=(), bodies_wanted=None))
    share, ledger = within / max(len(ablated), 1), list[EffectRow]()
    for each in ablated:
        try:
            terms = each.method.terms(scene)
        except EngineError:  # what refuses the scene adds nothing to the allowed error
            terms = ()
        ledger += rows(each, ref, share, terms)
    return ledger


def rows(ablated: Ablations, ref: Reference, within: float, terms: Sequence[Term] = ()) -> list[EffectRow]:
    """Return a row for each effect of a method.

    Parameters
    ----------
    ablated : Ablations
        Of the method.
    ref : Reference
        The reference's answer to the scene, which allowed errors are derived at.
    within : float
        How long to measure [s].
    terms : sequence of Term
        What the method adds to the allowed error.
    """
    with undisturbed():
        answers = {name: _answer(work, ref.scene) for name, work in ablated.runs.items()}
        runs = {name: work for name, work in ablated.runs.items() if not isinstance(answers[name], EngineError)}
        timings = timed_in_turns(runs, rounds=ROUNDS, fewest=FEWEST, within=within) if runs else {}
    there = [_row(ablated, a, answers, timings, ref, terms) for a in ablated.effects]
    return there + [_unmeasured(ablated.method.key, effect, why) for effect, why in ablated.absent.items()]


def _answer(work: Any, scene: Scene) -> Motion | EngineError:
    try:
        answer: Motion = work()
    except EngineError as error:
        return error
    wrong_form = "; ".join(misshapen(scene, answer))
    return EngineError(wrong_form) if wrong_form else answer


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
        return _unmeasured(key, a.effect, f"no answer without it: {off}")
    if isinstance(on, EngineRefusal):
        return _unmeasured(key, a.effect, str(on))
    if isinstance(on, EngineError):
        return _unmeasured(key, a.effect, f"{a.note}: {on}", inert=False)
    if a.on == "points" and not on.points:
        return _unmeasured(key, a.effect, "the adapter reports no motion of points")
    changed = change(ref, off, on, terms, exact=ablated.method.engine == REFKIN)
    before, after, per = timings[a.off], timings[a.on], 1e6 / len(off.t)
    return EffectRow(
        **dict(zip(KEY, key, strict=True)),
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

    That is the range of the difference over groups of rounds (every third one, of few every second). It is at least as
    much as the effect seems to save: who does more cannot take less time, so that this is noise, too.

    Parameters
    ----------
    before, after : sequence of float
        One call in each round [s], without the effect and with it.
    per : float
        What the result is multiplied by.
    """
    count = len(before)
    if count < 2:
        return None
    groups = GROUPS if count >= 2 * GROUPS else 2
    differences = [min(after[k::groups]) - min(before[k::groups]) for k in range(groups)]
    return max(max(differences) - min(differences), min(before) - min(after)) * per


def _unmeasured(key: tuple[str, str, str], effect: str, note: str, inert: bool | None = None) -> EffectRow:
    """Return the row of an effect without a price: not known to be inert, or known not to be."""
    who: Any = dict(zip(KEY, key, strict=True))
    return EffectRow(**who, effect=effect, inert=inert, called_for=effect not in PHYSICAL, note=note)


WITHIN = 30.0
"""How long a ledger measures [s]."""
START = 15.0
"""How long an answer may take on top: to load an engine, to solve everything and to make the fewest rounds [s]."""
MOST_HANGS = 4
"""How many effects of an engine may hang before the others are no longer tried."""
EFFECTS = ("velocity", "acceleration", "points", "other bodies", "condition", "certificate", *PHYSICAL)
"""Each has a row for every method, be it one that says why it has no price."""
ANY = "any"
"""The method in a row about a process that failed."""


def effects_ledger(
    scene: Scene,
    engines: Sequence[str] = (),
    within: float = WITHIN,
    tell: Callable[[int, str], None] = lambda done, producer: None,
) -> list[EffectRow]:
    """Return what every effect costs and whether it is inert, for refkin, which is first, and some engines.

    Of each method there are all of `EFFECTS`. An effect with which an engine's process ends, or hangs, has a row that
    says so, and so has what an engine has not.

    Parameters
    ----------
    scene : Scene
        What it calls for is of no account: everything is switched on and off in turn.
    engines : sequence of str
        What `engines.loading.load` takes. One after the other, so that none disturbs the timings of another.
    within : float
        How long to measure in all [s]; solving everything once comes on top.
    tell : callable
        Is told how many producers are done, and which comes next.
    """
    data, share = to_dict(scene), within / (1 + len(engines))
    ledger: list[EffectRow] = []
    for done, spec in enumerate((REFKIN, *engines)):
        tell(done, spec)
        (answer,) = _asked(data, spec, share, [""])
        ledger += _one_by_one(data, spec, answer) if isinstance(answer, Failure) else answer
    return ledger


def _asked(data: Any, spec: str, share: float, effects: Sequence[str]) -> Any:
    """Yield the rows of some effects; a process that fails at one is replaced for those that are left."""
    return call_in_turn(measured, [(data, spec, share, effect) for effect in effects], share + START)


def _one_by_one(data: Any, spec: str, first: Failure) -> list[EffectRow]:
    """Return the rows of an engine whose process failed, asked for one after the other, until too many hang.

    Timings of an engine with such an effect are not what matters: each takes the fewest rounds. An effect that fails
    where another one answers is felt.
    """
    answers: dict[str, list[EffectRow] | Failure] = dict.fromkeys(EFFECTS, first)
    hung = 0
    with closing(_asked(data, spec, 0.0, EFFECTS)) as asked:
        for effect, answer in zip(EFFECTS, asked, strict=False):
            answers[effect] = answer
            hung += isinstance(answer, Failure) and answer.kind is FailureKind.HANG
            if hung == MOST_HANGS:
                break
    answered = [row for answer in answers.values() if not isinstance(answer, Failure) for row in answer]
    (own,) = [(answered[0].engine, "")] if answered else call_each(name_and_version, [spec])
    name = spec if isinstance(own, Failure) else own[0]
    inert = False if any(row.inert is not None for row in answered) else None
    ledger: list[EffectRow] = []
    for effect, answer in answers.items():
        if isinstance(answer, Failure):
            ledger.append(_unmeasured((name, ANY, ""), effect, f"{answer.name}: {answer.text}", inert))
        else:
            ledger += answer
    return ledger
