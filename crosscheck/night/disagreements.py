"""The disagreements of a night on disk: every scene that shows one as TOML, and for each kind of them a minimal one."""

from __future__ import annotations

import re
import time
from collections.abc import Callable, Mapping, Sequence
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING, Any

from crosscheck.judge.known_gaps import Gap, new_disagreements, table
from crosscheck.scenes.drawing import AnyDrawn, describe, draw, effort, shrink
from crosscheck.workers.journal import replace_file
from crosscheck.workers.pool import Pool
from refkin.model import Scene
from refkin.scenes.files import to_dict, to_toml

if TYPE_CHECKING:
    from crosscheck.night.campaign import Plan

SHRINKING_SECONDS = 90.0
"""How long all the simplifying of a night may take."""
MOST_SHRUNK = 8
"""Kinds of disagreements of which one is simplified."""
FOLDER = "disagreements"

Signature = tuple[str, ...]
"""Engine, route, quantity and kind: what makes two disagreements one of a kind."""


def signature(told: Mapping[str, Any]) -> Signature:
    """Return what kind of disagreement it is."""
    return tuple(told[key] for key in ("engine", "route", "quantity", "kind"))


def write_disagreements(
    plan: Plan, new: Sequence[dict[str, Any]], workers: Pool, tick: Callable[[], None] = lambda: None
) -> float:
    """Write the scenes of disagreements, note in each its `file`, and return how long shrinking took [s].

    The first of each kind, for the first kinds, becomes a minimal scene (`shrunk`), the others stay as they were drawn.
    What an earlier part of the run has written stays as it is.

    Parameters
    ----------
    new : sequence of dict
        Disagreements with the `key` and the number (`shard`) of their scenes.
    tick : callable
        Called between one scene and the next.
    """
    by_scene: dict[str, list[dict[str, Any]]] = {}
    first_of_kind: dict[Signature, dict[str, Any]] = {}
    for told in new:
        by_scene.setdefault(told["key"], []).append(told)
        first_of_kind.setdefault(signature(told), told)
    for key, of_scene in by_scene.items():
        path = plan.out / FOLDER / f"{key}.toml"
        for told in of_scene:
            told["file"] = f"{FOLDER}/{path.name}"
        if not path.exists():
            _write(path, of_scene, draw(plan.seed, of_scene[0]["shard"]))
    start = time.monotonic()
    to_shrink = list(first_of_kind.values())[:MOST_SHRUNK]
    for k, told in enumerate(to_shrink):
        left = plan.shrinking_seconds - (time.monotonic() - start)
        _shrink(plan, told, workers, left / (len(to_shrink) - k), tick)
    return time.monotonic() - start


def _shrink(plan: Plan, told: dict[str, Any], workers: Pool, seconds: float, tick: Callable[[], None]) -> None:
    """Write the minimal scene of a disagreement, if it shows once more and nobody has yet."""
    path = plan.out / FOLDER / f"{told['key']}-minimal-{_slug(told)}.toml"
    if not path.exists():
        start = time.monotonic()
        again: dict[Scene, Mapping[str, Any] | None] = {}
        gaps = table(plan.known_gaps)

        def still_fails(drawn: AnyDrawn) -> bool:
            tick()
            again[drawn.scene] = _again(signature(told), drawn, workers, gaps)
            return again[drawn.scene] is not None

        simplest, tried = shrink(plan.seed, told["shard"], still_fails, seconds)
        if simplest is None:
            told["note"] = "it did not show again when its scene was checked by itself"
            return
        shorter = _at_its_time(simplest, again[simplest.scene])
        if still_fails(shorter):
            simplest = shorter
        digits = effort(draw(plan.seed, told["shard"]).scene), effort(simplest.scene)
        took = time.monotonic() - start
        note = f"simplified from {digits[0]} to {digits[1]} digits: {tried} scenes in {took:.0f} s"
        _write(path, [{**(again[simplest.scene] or {}), "found in": f"{told['key']}.toml", "note": note}], simplest)
    told["file"], told["shrunk"] = f"{FOLDER}/{path.name}", True


def _at_its_time(drawn: AnyDrawn, told: Mapping[str, Any] | None) -> AnyDrawn:
    """Return the scene at its first time and at the one of its worst sample alone, if the disagreement names one."""
    times = drawn.scene.times
    named = re.search(r"at t = (\S+)$", told["worst"] if told else "")
    kept = [t for t in times if t == times[0] or (named and t == float(named[1]))]
    return replace(drawn, scene=replace(drawn.scene, times=tuple(kept))) if named else drawn


def _again(kind: Signature, drawn: AnyDrawn, workers: Pool, gaps: Sequence[Gap]) -> Mapping[str, Any] | None:
    """Return the disagreement of a kind that a scene shows, unless a known gap accounts for it."""
    job = {"scene": to_dict(drawn.scene), "about": describe(drawn)}
    record = workers.check_one(job, [name for name in workers.engines if name == kind[0]])
    return next((told for told in new_disagreements(record, gaps) if signature(told) == kind), None)


def _write(path: Path, of_scene: Sequence[Mapping[str, Any]], drawn: AnyDrawn) -> None:
    """Write a scene with what disagrees on it as comments."""
    lines = [f"{key}: {value}" for told in of_scene for key, value in told.items() if key not in ("file", "shrunk")]
    told = "".join(f"# {line}\n" for text in lines for line in text.splitlines())
    path.parent.mkdir(parents=True, exist_ok=True)
    replace_file(path, f"{told}# Show it again: crosscheck replay {path.name}\n\n{to_toml(drawn.scene)}")


def _slug(told: Mapping[str, Any]) -> str:
    """Return engine, route, quantity and kind as part of a file's name."""
    return re.sub(r"[^A-Za-z0-9]+", "-", "-".join(signature(told))).strip("-").lower()
