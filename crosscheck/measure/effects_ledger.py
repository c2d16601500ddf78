"""The ledger of a scene: the reference and the engines one after the other, each in a process of its own."""

from __future__ import annotations

import time
from collections.abc import Sequence
from typing import Any

from crosscheck.judge.effects_rows import EffectRow
from crosscheck.measure.effects import measured, task, unmeasured
from crosscheck.measure.effects_ablations import REFKIN
from crosscheck.scenes.names import PHYSICAL
from crosscheck.workers.processes import Failure, call_each
from refkin.model import Scene
from refkin.scenes.files import to_dict

WITHIN = 30.0
"""How long a ledger measures [s]."""
START = 15.0
"""How long a process may take on top: to start, to load an engine, to solve everything once [s]."""
EFFECTS = ("velocity", "acceleration", "points", "other bodies", "condition", "certificate", *PHYSICAL)
"""Each has a row for every method, be it one that says why it has no price."""
ANY = "any"
"""The method in a row about a process that failed."""


def effects_ledger(scene: Scene, engines: Sequence[str] = (), within: float = WITHIN) -> list[EffectRow]:
    """Return what every effect costs and whether it is inert, for refkin and some engines.

    Parameters
    ----------
    scene : Scene
        What it calls for is of no account: everything is switched on and off in turn.
    engines : sequence of str
        What `crosscheck.engines.load` takes. One after the other, so that none disturbs the timings of another.
    within : float
        How long to measure in all [s]; solving everything once comes on top.

    Returns
    -------
    list of EffectRow
        refkin's first; of each method all of `EFFECTS`. An effect with which an engine's process ends, or hangs, has a
        row that says so, and so has what an engine has not. `dataclasses.asdict` makes a row plain data.
    """
    data, share = to_dict(scene), within / (1 + len(engines))
    found: list[EffectRow] = []
    for spec in (REFKIN, *engines):
        answer = _asked(data, spec, share, share + START)
        found += _one_by_one(data, spec, answer, share + START) if isinstance(answer, Failure) else answer
    return found


def _asked(data: Any, spec: str, share: float, patience: float, effect: str = "") -> list[EffectRow] | Failure:
    answer = call_each(measured, [task(data, spec, share, effect)], patience)[0]
    return answer if isinstance(answer, Failure) else [EffectRow(**row) for row in answer]


def _one_by_one(data: Any, spec: str, first: Failure, within: float) -> list[EffectRow]:
    """Return the rows of an engine whose process failed: each effect in a process of its own, as long as time allows.

    Timings of an engine with such an effect are not what matters: each gets one round, and no more than its share of
    the time that is left. An effect that fails where another one answers is felt.
    """
    answers: dict[str, list[EffectRow] | Failure] = {}
    end = time.monotonic() + within
    for k, effect in enumerate(EFFECTS):
        left = (end - time.monotonic()) / (len(EFFECTS) - k)
        answers[effect] = _asked(data, spec, 0.0, left, effect) if left > 0 else first
    answered = [row for answer in answers.values() if not isinstance(answer, Failure) for row in answer]
    name = answered[0].engine if answered else spec
    inert = False if any(row.inert is not None for row in answered) else None
    found: list[EffectRow] = []
    for effect, answer in answers.items():
        if isinstance(answer, Failure):
            found.append(unmeasured((name, ANY, ""), effect, f"{answer.name}: {answer.text}", inert))
        else:
            found += answer
    return found
