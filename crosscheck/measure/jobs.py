"""What the workers of a night do: check a scene that they are handed, or one that they draw by its number."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace
from functools import lru_cache, partial
from typing import Any

from crosscheck.engines import Engine
from crosscheck.engines.loading import load
from crosscheck.engines.undisturbed import undisturbed
from crosscheck.judge.records import Cause, Record
from crosscheck.measure.check import check, ended, key_of
from crosscheck.scenes.drawing import COSTS, WELL_KNOWN, describe, draw, shortened
from crosscheck.scenes.names import pairs_of
from crosscheck.workers.pool import Parts, Work, Workers
from crosscheck.workers.processes import Failure, FailureKind, preload
from refkin.model import Scene
from refkin.motion import Status
from refkin.scenes.files import parse, to_dict


def scene_of(job: Mapping[str, Any]) -> tuple[Scene, dict[str, Any]]:
    """Return the scene of a job and what the generator knows of it.

    A job holds the data of a scene's file under `scene`, and perhaps `about`; or the seed of a night under `night` and
    the numbers of scenes under `shards`. Of those the one is drawn that adds most for its time: the pairs of its
    features were met least often, as `seen` (pair -> how often) has it: 1 counts one not met yet, 1/2 one met once. It
    has fewer times (`shortened`) if that adds next to nothing, or if the job says so. Of one that is `well_known` every
    two features were met often enough.
    """
    if "scene" in job:
        return parse(job["scene"]), dict(job.get("about", {}))
    scenes = [draw(job["night"], number) for number in job["shards"]]
    seen = job.get("seen", {})
    about = [{**describe(drawn), "shard": number} for drawn, number in zip(scenes, job["shards"], strict=True)]
    new = [sum(1.0 / (1 + seen.get(pair, 0)) for pair in pairs_of(one)) for one in about]
    best = max(range(len(new)), key=lambda k: new[k] / COSTS.get(about[k]["kind"], 1.0))
    known = about[best]
    well_known = min((seen.get(pair, 0) for pair in pairs_of(known)), default=0) >= WELL_KNOWN
    known |= {"well_known": True} if well_known else {}
    if job.get("shortened", well_known) and (part := shortened(scenes[best])) is not None:
        return part, {**known, "shortened": True}
    return scenes[best].scene, known


def by_itself(scene: Scene, *, features: bool = False, expected: Status = Status.OK) -> dict[str, Any]:
    """Return the job of a scene of which nothing else is known, with the arbiter: whoever asks so hears the same.

    Parameters
    ----------
    scene : Scene
    features : bool
        Whether engines are also asked by the features that a night tests apart.
    expected : Status
        The verdict that the scene was made for: another one is the reference's fault.
    """
    return {"scene": to_dict(scene), "about": {"of_features": features, "expected": expected.value}, "arbiter": True}


def check_job(job: Mapping[str, Any]) -> Record | Failure:
    """Return the record of a job, as workers are handed it: with the specs of its `engines`, and perhaps `arbiter`.

    Where an engine raises an error that is all: each is asked again by itself, so that none is blamed for another.
    """
    scene, about = scene_of(job)
    record = check(scene, _loaded(tuple(job["engines"])), about, arbiter=job.get("arbiter", False))
    errors = (d for d in record.disagreements if d.kind is Cause.ERROR)
    return next((Failure(FailureKind.ERROR, d.message, d.how) for d in errors), record)


@lru_cache
def _loaded(specs: tuple[str, ...]) -> list[Engine]:
    with undisturbed():
        return [load(spec) for spec in specs]


def load_engines(job: Mapping[str, Any]) -> None:
    """Load the engines of a job: what a worker does before the first scene, with more time than a scene has."""
    _loaded(tuple(job["engines"]))


def joined(job: Mapping[str, Any], engines: Sequence[str], parts: Parts) -> Record:
    """Return the record of a scene that was taken apart, as if nothing had happened, but with what failed again.

    Parameters
    ----------
    job : mapping
        As a worker takes it.
    engines : sequence of str
        Names, in the order of the record.
    parts : mapping
        Engine, "" for none -> the record of this part, or a Failure.
    """
    whole: Record | Failure = parts[""]
    rows: dict[str, Any] = {name: [] for name in ("answers", "levels", "refusals", "disagreements")}
    if isinstance(whole, Failure):
        scene, about = scene_of(job)
        text = f"the reference itself: {whole.name}; {whole.text}"
        return Record(key=key_of(scene), scene=scene.name, about=about, failure=text, **rows)
    of_reference = len(whole.disagreements)  # every part has these, too
    rows["disagreements"] += whole.disagreements
    for engine in engines:
        part = parts[engine]
        if isinstance(part, Failure):
            rows["disagreements"].append(ended(engine, part))
            continue
        for name, of_all in rows.items():
            of_all += getattr(part, name)[of_reference if name == "disagreements" else 0 :]
    return replace(whole, **rows)


CHECK = Work(check_job, load_engines, joined)
preload(__name__)
checkers = partial(Workers, CHECK)
"""Makes worker processes that check scenes."""
