"""The ledger of a scene: the reference and the engines one after the other, each in a process of its own."""

from __future__ import annotations

from collections.abc import Callable, Generator, Sequence
from contextlib import closing
from typing import Any

from crosscheck.judge.effects_rows import EffectRow
from crosscheck.measure.effects import measured, task, unmeasured
from crosscheck.measure.effects_ablations import REFKIN
from crosscheck.scenes.names import PHYSICAL
from crosscheck.workers.processes import Failure, FailureKind, call_in_turn
from refkin.model import Scene
from refkin.scenes.files import to_dict

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
    """Return what every effect costs and whether it is inert, for refkin and some engines.

    Parameters
    ----------
    scene : Scene
        What it calls for is of no account: everything is switched on and off in turn.
    engines : sequence of str
        What `crosscheck.engines.load` takes. One after the other, so that none disturbs the timings of another.
    within : float
        How long to measure in all [s]; solving everything once comes on top.
    tell : callable
        Is told how many producers are done, and which comes next.

    Returns
    -------
    list of EffectRow
        refkin's first; of each method all of `EFFECTS`. An effect with which an engine's process ends, or hangs, has a
        row that says so, and so has what an engine has not. `dataclasses.asdict` makes a row plain data.
    """
    data, share = to_dict(scene), within / (1 + len(engines))
    ledger: list[EffectRow] = []
    for done, spec in enumerate((REFKIN, *engines)):
        tell(done, spec)
        (answer,) = _asked(data, spec, share, [""])
        ledger += _one_by_one(data, spec, answer) if isinstance(answer, Failure) else answer
    return ledger


def _asked(data: Any, spec: str, share: float, effects: Sequence[str]) -> Generator[list[EffectRow] | Failure]:
    """Yield the rows of some effects; a process that fails at one is replaced for those that are left."""
    for answer in call_in_turn(measured, [task(data, spec, share, effect) for effect in effects], share + START):
        yield answer if isinstance(answer, Failure) else [EffectRow(**row) for row in answer]


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
    name = answered[0].engine if answered else spec
    inert = False if any(row.inert is not None for row in answered) else None
    ledger: list[EffectRow] = []
    for effect, answer in answers.items():
        if isinstance(answer, Failure):
            ledger.append(unmeasured((name, ANY, ""), effect, f"{answer.name}: {answer.text}", inert))
        else:
            ledger += answer
    return ledger
