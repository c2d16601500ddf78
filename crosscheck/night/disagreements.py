"""The disagreements of a night on disk: every scene that shows one as TOML, and for each kind of them a minimal one."""

from __future__ import annotations

import hashlib
import re
import time
from collections.abc import Callable, Collection, Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any

from crosscheck.judge.known_gaps import KnownGap, Tally, table
from crosscheck.judge.records import Cause, Disagreement, NewCase, plain
from crosscheck.night.plan import NightPlan, write_scene
from crosscheck.scenes.drawing import AnyDrawn, describe, draw, effort, expected_of, in_part, shrink
from crosscheck.scenes.featured import Featured
from crosscheck.workers.pool import Pool
from refkin.model import Scene
from refkin.motion import Status
from refkin.scenes.files import to_dict

MOST_SHRUNK = 8
"""Kinds of disagreements of which one is simplified."""
FOLDER = "disagreements"
SCENE_FILE = re.compile(r"([0-9a-f]{16}|golden-)[a-z0-9-]*\.toml")
"""The names of the files in it."""
LONGEST_NAME = 80
"""Characters of what a file's name says of a disagreement."""

Signature = tuple[str, str, str, str]
"""Engine, method, quantity and kind: what makes two disagreements one of a kind."""


def write_disagreements(
    plan: NightPlan, new: Sequence[NewCase], workers: Pool, tick: Callable[[], None] = lambda: None
) -> float:
    """Write the scenes of disagreements, note in each its `file`, and return how long shrinking took [s].

    The first of each kind, for the first kinds, becomes a minimal scene (`shrunk`), the others stay as they were drawn.
    What an earlier part of the run has written stays as it is.

    Parameters
    ----------
    plan : NightPlan
    new : sequence of NewCase
        Each with the number (`shard`) of its scene.
    workers : Pool
        What checks while shrinking.
    tick : callable
        Called between one scene and the next.
    """
    by_scene: dict[str, list[NewCase]] = {}
    first_of_kind: dict[Signature, NewCase] = {}
    for case in new:
        by_scene.setdefault(case.key, []).append(case)
        first_of_kind.setdefault(case.disagreement.signature, case)
    for key, of_scene in by_scene.items():
        path = plan.out / FOLDER / f"{key}.toml"
        for case in of_scene:
            case.file = f"{FOLDER}/{path.name}"
        if not path.exists():
            notes = [line for case in of_scene for line in _notes(case.disagreement, case)]
            _write(path, notes, _drawn(plan, of_scene[0]), plan)
    start = time.monotonic()
    to_shrink = list(first_of_kind.values())[:MOST_SHRUNK]
    for k, disagreement in enumerate(to_shrink):
        left = plan.shrinking_seconds - (time.monotonic() - start)
        beside = frozenset(case.disagreement.signature for case in by_scene[disagreement.key])
        _shrink(plan, disagreement, beside, workers, left / (len(to_shrink) - k), tick)
    return time.monotonic() - start


def _drawn(plan: NightPlan, case: NewCase) -> AnyDrawn:
    """Return the scene of a disagreement as the night had it: a part begins elsewhere, and may alone be wrong."""
    whole = draw(plan.seed, case.shard or 0)
    return in_part(whole) if case.shortened else whole


def _shrink(
    plan: NightPlan,
    case: NewCase,
    beside: Collection[Signature],
    workers: Pool,
    seconds: float,
    tick: Callable[[], None],
) -> None:
    """Write the minimal scene of a disagreement, if it shows once more and nobody has; `beside`: all of that scene."""
    kind = case.disagreement.signature
    path = plan.out / FOLDER / f"{case.key}-minimal-{slug(*kind)}.toml"
    if not path.exists():
        start = time.monotonic()
        again: dict[Scene, Disagreement | None] = {}
        gaps = table(plan.known_gaps)

        def still_fails(drawn: AnyDrawn) -> bool:
            tick()
            again[drawn.scene] = _again(kind, beside, drawn, workers, gaps)
            return again[drawn.scene] is not None

        simplest, tried = shrink(plan.seed, case.shard or 0, still_fails, seconds, part=case.shortened)
        if simplest is None:
            case.note = "it did not show again when its scene was checked by itself"
            return
        shorter = _at_its_time(simplest, again[simplest.scene])
        if still_fails(shorter):
            simplest = shorter
        digits = effort(_drawn(plan, case).scene), effort(simplest.scene)
        took = time.monotonic() - start
        note = f"simplified from {digits[0]} to {digits[1]} digits: {tried} scenes in {took:.0f} s"
        shown = again[simplest.scene] or case.disagreement
        _write(path, [*_notes(shown), f"found in: {case.key}.toml", f"note: {note}"], simplest, plan)
    case.file, case.shrunk = f"{FOLDER}/{path.name}", True


def _at_its_time(drawn: AnyDrawn, shown: Disagreement | None) -> AnyDrawn:
    """Return the scene at its first time and at the one of its worst sample alone, if the disagreement has one.

    And at its end, if it was made to end so.
    """
    if shown is None or shown.at is None or shown.at.time is None:
        return drawn
    times = drawn.scene.times
    end = times[0] if expected_of(drawn) is Status.OK else times[-1]
    kept = tuple(t for t in times if t in (times[0], shown.at.time, end))
    return replace(drawn, scene=replace(drawn.scene, times=kept))


def _again(
    kind: Signature, beside: Collection[Signature], drawn: AnyDrawn, workers: Pool, gaps: Sequence[KnownGap]
) -> Disagreement | None:
    """Return the disagreement of a kind that a scene shows, unless a known gap accounts for it.

    A simpler scene in which the method is wrong in one more way shows another fault: wrong rates of a right pose do
    not become those of a wrong one.
    """
    turned = kind[3] in (Cause.ORDER, Cause.AGAIN)  # asked of one scene in some, but for those that are asked all
    job = {"scene": to_dict(drawn.scene), "about": describe(drawn), "arbiter": turned}
    record = workers.check_one(job, [name for name in workers.engines if name == kind[0]])
    of_method = {d.signature: d for d in Tally(gaps).add(record) if d.signature[:2] == kind[:2]}
    return of_method.get(kind) if of_method.keys() <= set(beside) else None


def _notes(shown: Disagreement, case: NewCase | None = None) -> list[str]:
    fields = {**plain(shown), "at": str(shown.at) if shown.at else None}
    fields |= {} if case is None else {"key": case.key, "shard": case.shard}
    return [f"{key}: {value}" for key, value in fields.items() if value not in (None, "")]


def _write(path: Path, notes: Sequence[str], drawn: AnyDrawn, plan: NightPlan) -> None:
    of: Any = {"features": isinstance(drawn, Featured), "expected": expected_of(drawn)}
    write_scene(path, notes, drawn.scene, plan.engines, **of)


def slug(*words: str) -> str:
    """Return words as part of a file's name, of bounded length: the end of a longer one tells it from others."""
    plain_words = re.sub(r"[^A-Za-z0-9]+", "-", "-".join(words)).strip("-").lower()
    if len(plain_words) <= LONGEST_NAME:
        return plain_words
    return f"{plain_words[: LONGEST_NAME - 9]}-{hashlib.sha256('-'.join(words).encode()).hexdigest()[:8]}"
