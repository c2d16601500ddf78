"""The other sections of a report, measured and drawn after the scenes of a night.

Hard cases, prices, effects and the source documents: each is a file of plain rows in the night's folder
(`report.measured` reads them). They are measured when the scenes are done, one after the other, so that nothing else
disturbs their timings.

And the mechanism behind a mark: the reference's motion as moving parts, the engine's answer with its error magnified.
Records hold digits, not poses: the scenes that are worst in a decade are solved once more when the night is over, each
in a process of its own. Everything is in pixels of one small picture, ready to be put into `transform` attributes: a
part is a path in its own frame, a frame of the motion is one (x, y, degrees) per part; in space the numbers of
`moving_parts.SpaceDrawing`. So page and script draw the same with no geometry of their own.
"""

from __future__ import annotations

import json
import math
import time
from collections.abc import Callable, Collection, Iterable, Iterator, Mapping, Sequence
from contextlib import suppress
from dataclasses import asdict, replace
from pathlib import Path
from typing import Any

import numpy as np

from crosscheck.documents.ledger.page import digits_by_iteration, documents, newton_histories, slopes
from crosscheck.engines import EngineError
from crosscheck.engines.methods import PRICED, Use, copied, methods
from crosscheck.judge.comparison import QuantityComparison, compare, reference
from crosscheck.judge.records import QUANTITIES, Record, Unreadable, read_records
from crosscheck.measure.check import estimated
from crosscheck.measure.effects import REFKIN, effects_ledger
from crosscheck.measure.hard_table import hard_case_rows
from crosscheck.measure.jobs import scene_of
from crosscheck.measure.price import LEAST, price_list
from crosscheck.night.moving_parts import HEIGHT, WIDTH, DrawnSample, SceneDrawing, SpaceDrawing
from crosscheck.night.plan import PICTURES, replace_file
from crosscheck.scenes.hard import priced_classes
from crosscheck.scenes.names import OURS
from crosscheck.workers.pool import Job
from crosscheck.workers.processes import Failure, call_in_turn
from refkin.model import Point, Scene
from refkin.motion import Motion

HARD, PRICE, EFFECTS = 0.25, 0.5, 0.25
"""How the time is shared."""
PRICED_CLASS = "regular"
"""The class of the price list whose scene the ledger of effects is about."""


def write_sections(
    folder: Path,
    engines: Mapping[str, str],
    left_out: Collection[str],
    seconds: float,
    tell: Callable[[str], None] = lambda doing: None,
) -> None:
    """Write hard_cases.json, price.json and effects.json, as far as engines get in some time.

    Parameters
    ----------
    folder : Path
        The folder of the run.
    engines : mapping
        Name -> what `engines.loading.load` takes for it.
    left_out : collection of str
        Names of those that are not asked.
    seconds : float
        How long it may take in all, beside the start of processes. Nothing is written where the price list cannot keep
        to its share, since it gives each class of scenes its least.
    tell : callable
        Is told what is being measured.
    """
    if not PRICE * seconds >= LEAST * len(priced_classes()):
        return
    named = [spec for name, spec in engines.items() if name not in left_out]
    priced = (*(name for name in PRICED if name in OURS), *named)
    scene = priced_classes()[PRICED_CLASS]
    point = Point(name="P", body=scene.mechanism.bodies[0].name, position=(0.3, 0.2))  # so that points have a price
    felt = replace(scene, points=(point,))
    measures: dict[str, tuple[str, Callable[[], Sequence[Any]]]] = {
        "hard_cases": ("hard cases", lambda: hard_case_rows([REFKIN, *named], HARD * seconds)),
        "price": ("the price list", lambda: price_list(PRICE * seconds, priced)),
        "effects": ("the ledger of effects", lambda: list(map(asdict, effects_ledger(felt, named, EFFECTS * seconds)))),
    }
    for name, (doing, measure) in measures.items():
        tell(doing)
        replace_file(folder / f"{name}.json", json.dumps(measure(), indent=1, allow_nan=False) + "\n")


def write_documents(folder: Path) -> None:
    """Write documents.json: the source documents recomputed, and the experiments on convergence that they describe."""
    recomputed: dict[str, Any] = {"newton_histories": newton_histories(), "slopes": slopes()}
    recomputed |= {"documents": documents(), "iterations": digits_by_iteration()}
    replace_file(folder / "documents.json", json.dumps(recomputed, indent=1, allow_nan=False) + "\n")


MOST_SCENES = 60
"""Scenes with a picture; marks of further ones have none. It bounds the page at some hundred kilobytes."""
Mark = tuple[str, str, str, int]
"""Engine, method, quantity, decade of sigma_min."""


def write_pictures(folder: Path, seed: int, engines: Mapping[str, str], seconds: float) -> None:
    """Write `pictures.json` for the records of a night, as far as its time goes.

    Parameters
    ----------
    folder : Path
        The night's.
    seed : int
        By which its scenes were drawn.
    engines : mapping
        Name -> what `engines.loading.load` takes for it.
    seconds : float
        After this long no further scene is pictured.
    """
    records = (record for _, record in read_records(folder / "records.jsonl") if not isinstance(record, Unreadable))
    drawn = (record for record in records if "shard" in record.about)
    drawings = pictures(drawn, lambda r: job_of(seed, r), engines, seconds)
    replace_file(folder / PICTURES, json.dumps(drawings, allow_nan=False) + "\n")


def job_of(seed: int, record: Record) -> Job:
    """Return what the scene of a night's record is drawn from."""
    return {"night": seed, "shards": [record.about["shard"]], "shortened": bool(record.about.get("shortened"))}


def pictures(
    records: Iterable[Record], job_of: Callable[[Record], Job], engines: Mapping[str, str], seconds: float = math.inf
) -> dict[str, Any]:
    """Return the scenes with their motion, and one mark per engine, method, quantity and decade that has a picture.

    Of each the scene with the fewest digits is pictured; those with the fewest of all go first.

    Parameters
    ----------
    records : iterable of Record
    job_of : callable
        Record -> what its scene is made from.
    engines, seconds
        As for `write_pictures`.
    """
    end = time.monotonic() + seconds
    jobs = list(_jobs(records, job_of, engines))[:MOST_SCENES]
    scenes: list[dict[str, Any]] = []
    marks: list[dict[str, Any]] = []
    for answer in call_in_turn(pictured, jobs):
        if not isinstance(answer, Failure) and answer is not None:
            marks += [{**mark, "scene": len(scenes)} for mark in answer["marks"]]
            scenes.append(answer["scene"])
        if time.monotonic() > end:
            break
    marks.sort(key=lambda m: (m["digits"], m["engine"], m["method"], m["quantity"], m["decade"]))
    return {"width": WIDTH, "height": HEIGHT, "scenes": scenes, "marks": marks}


def _jobs(records: Iterable[Record], job_of: Callable[[Record], Job], engines: Mapping[str, str]) -> Iterator[Job]:
    """Yield what `pictured` takes: a scene and the marks that are worst there."""
    worst: dict[Mark, tuple[int, str]] = {}
    jobs: dict[str, Job] = {}
    for record in records:
        for mark, tenths in _digits(record):
            if mark[0] in engines and (mark not in worst or tenths < worst[mark][0]):
                worst[mark] = (tenths, record.key)
                jobs[record.key] = {**job_of(record), "key": record.key}
    wanted: dict[str, list[Mark]] = {}
    for mark, (_, key) in sorted(worst.items(), key=lambda item: (item[1][0], item[0])):
        wanted.setdefault(key, []).append(mark)
    for key, marks in wanted.items():
        yield {**jobs[key], "marks": marks, "specs": {mark[0]: engines[mark[0]] for mark in marks}}


def _digits(record: Record) -> Iterator[tuple[Mark, int]]:
    """Yield the fewest digits of each answer, quantity and decade, in tenths; features are not pictured."""
    for answer in (answer for answer in record.answers if not answer.feature):
        for quantity, q in answer.quantities.items():
            for decade, histogram in q.digits_by_sigma.items():
                if histogram:
                    yield (answer.engine, answer.method.name, quantity, decade), min(histogram)


def pictured(job: Job) -> dict[str, Any] | None:
    """Return the scene of a job as parts and frames, and its marks; None if it has no motion to show."""
    scene, _ = scene_of(job)
    ref = reference(scene)
    drawing = drawing_of(ref.scene, ref.motion)
    if not drawing.shown.size:
        return None
    marks = []
    for name, method in ((name, m) for name, spec in job["specs"].items() for m in methods(spec, Use.COMPARE)):
        wanted = [mark[2:] for mark in job["marks"] if mark[:2] == (name, method.called)]
        asked = copied(estimated(ref.scene, ref))
        with suppress(EngineError):
            compared = compare(ref, method.solve(asked), method.terms(asked)).quantities if wanted else {}
            for quantity, decade in wanted:
                sample = worst_sample(ref.sigma_min, compared[quantity], decade)
                ghost = None if sample is None else drawing.ghost(sample, QUANTITIES.index(quantity))
                if ghost is not None:
                    who = {"engine": name, "method": method.called, "quantity": quantity, "decade": decade}
                    marks.append({**who, **ghost})
    return {"scene": drawing.described(scene.name, job["key"]), "marks": marks}


def worst_sample(sigma: Any, q: QuantityComparison, decade: int) -> DrawnSample | None:
    """Return the sample of a comparison with the fewest digits of a decade of sigma_min; None if it has none there.

    Parameters
    ----------
    sigma : (T,) array
        sigma_min.
    q : QuantityComparison
    decade : int
        floor(log10(sigma_min)).
    """
    if q.difference is None:
        return None
    with np.errstate(divide="ignore", invalid="ignore"):
        places = np.flatnonzero(np.isfinite(q.digits) & (np.floor(np.log10(sigma)) == decade))
    if not places.size:
        return None
    k = int(places[np.argmin(q.digits[places])])
    return DrawnSample(k, float(np.floor(q.digits[k] * 10) / 10), q.difference)


def drawing_of(scene: Scene, motion: Motion) -> SceneDrawing:
    """Return the drawing of a mechanism of the plane or of space."""
    return (SceneDrawing if scene.mechanism.kind.name == "planar" else SpaceDrawing)(scene, motion)
