"""One scene through the reference and the engines: what a worker does, what `replay` shows, what the library offers.

A `Record` is plain data, one JSON line: it is all that the report is built from.
"""

from __future__ import annotations

import hashlib
import json
import sys
import time
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import replace
from typing import Any

import numpy as np

from crosscheck.engines import QUANTITIES, Engine, EngineError, Level, Term, load, refusals
from crosscheck.judge.between import excuse
from crosscheck.judge.comparison import Comparison, QuantityComparison, Reference, compare, reference
from crosscheck.judge.delivery import granted, undelivered
from crosscheck.judge.hard_poses import scene_samples
from crosscheck.judge.levels import Configuration, LevelComparison, compare_levels, configurations
from crosscheck.judge.samples import attainable, common_sample, cycle, off_at, worst_samples
from refkin.model import Mechanism, Scene
from refkin.motion import Motion, Route, Status
from refkin.proof.pose.krawczyk import Verdict
from refkin.scenes.files import to_dict
from refkin.scenes.linkages.base import rough

Record = dict[str, Any]
CONFIGURATIONS = 2
"""Configurations per scene at which an engine's own rows are compared."""
TURNED_ROUND = 4
"""One time in this many is solved once more with the bodies in another order."""
NOTHING = QuantityComparison(np.zeros(0), np.zeros(0), np.zeros(0), "")
REGULAR = 1e-4
"""Smallest singular value above which an engine has no excuse for giving no answer."""


def key_of(scene: Scene) -> str:
    """Return the hash that names a scene: equal scenes, equal keys, whatever their name."""
    data = {k: v for k, v in to_dict(scene).items() if k != "name"}
    return hashlib.sha256(json.dumps(data, sort_keys=True).encode()).hexdigest()[:16]


def check(
    scene: Scene, engines: Sequence[str | Engine], about: Mapping[str, Any] | None = None, *, arbiter: bool = False
) -> Record:
    """Return everything that is found out about one scene.

    Parameters
    ----------
    engines : sequence of str or Engine
        Names are looked up among the registered engines.
    about : mapping
        What the generator knows of the scene (kind, Grashof class, branch, distance to a singular pose).
    arbiter : bool
        Whether every position is also held against its enclosure at 113 bits: some milliseconds for each time.
    """
    start = time.perf_counter()
    ref = reference(scene)
    record: Record = {
        "key": key_of(scene),
        "scene": scene.name,
        "scene_file": to_dict(scene),
        "about": dict(about or {}),
        "reference": _reference_record(ref, time.perf_counter() - start),
        "answers": [],
        "levels": [],
        "refusals": [],
        "disagreements": [],
    }
    if ref.motion.verdict is not Status.OK:
        told = {"engine": "refkin", "route": "newton", "quantity": "status", "ratio": None, "worst": ref.motion.message}
        record["disagreements"].append({**told, "kind": str(ref.motion.verdict)})
    at = _configurations(ref, record["key"])
    scene = estimated(scene, ref)
    for engine in (load(e) if isinstance(e, str) else e for e in engines):
        reasons = refusals(engine, scene, Level.SOLVE)
        record["refusals"] += reasons
        for route in () if reasons else engine.routes():
            motion = _check_route(engine, route, scene, ref, record)
            if motion is not None:
                record["answers"][-1]["certificate"] = _places(engine, scene, motion) if arbiter else None
        if hasattr(engine, "constraints"):
            _check_levels(engine, scene, at, record)
    return record


def estimated(scene: Scene, ref: Reference) -> Scene:
    """Return the scene with an estimate for each body that has none: the reference's first pose, rounded.

    Such a scene leaves open which assembly is meant; engines that chose for themselves would be compared on different
    ones. Rounding leaves two decimals of the size, more where assemblies are near: they are about sigma_min apart.
    """
    m, first = scene.mechanism, ref.levels[0][:, 0]
    if all(body.estimate for body in m.bodies) or not np.isfinite(first).all():
        return scene
    q, size, sigma = ref.system.to_physical(first), ref.system.unit.size, ref.sigma_min[0]
    at = rough({b.name: tuple(q[ref.system.columns(b.name)].tolist()) for b in m.bodies}, size, size * sigma**2)
    bodies = tuple(body if body.estimate else replace(body, estimate=at[body.name]) for body in m.bodies)
    return replace(scene, mechanism=replace(m, bodies=bodies))


def _reference_record(ref: Reference, seconds: float) -> dict[str, Any]:
    motion = ref.motion
    radius = motion.certified_radius
    return {
        "verdict": motion.verdict.value,
        "message": motion.message,
        "statuses": {s.value: motion.status.count(s) for s in set(motion.status)},
        "sigma_min": _smallest(ref.sigma_min),
        "sigma_per_step": _sigma_per_step(ref),
        "residual": _largest(motion.residual),
        "certified_radius": {q: _largest(getattr(radius, q)) for q in QUANTITIES},
        "common": common_sample(ref),
        "attainable_by_sigma": {q: by_decade(ref.sigma_min, digits) for q, digits in attainable(ref).items()},
        "seconds": seconds,
    }


def _sigma_per_step(ref: Reference) -> float | None:
    """Return the smallest ratio of sigma_min, at either end of a step, to what a coordinate changes by in it."""
    steps = np.max(np.abs(np.diff(ref.levels[0], axis=1)), axis=0)
    sigma = np.minimum(ref.sigma_min[1:], ref.sigma_min[:-1])
    moved = np.isfinite(sigma) & (steps > 0.0)
    return _smallest(sigma[moved] / steps[moved]) if moved.any() else None


def _configurations(ref: Reference, key: str) -> list[Configuration]:
    """Return the configurations at which engines' own rows are compared; none if no pose was found to start from."""
    lanes = np.flatnonzero(np.isfinite(ref.levels[0][0]))
    if not lanes.size:
        return []
    near = ref.system.to_physical(ref.levels[0][:, lanes])
    return configurations(ref.scene.mechanism, near, ref.motion.t[lanes], key, CONFIGURATIONS)


def _places(engine: Engine, scene: Scene, motion: Motion) -> dict[str, Any] | None:
    """Return at how many times a motion lies inside and outside of what is attainable, and how far; None for cams."""
    if any(joint.parameters for joint in scene.mechanism.joints):
        return None
    found = scene_samples(scene, motion, engine.terms(scene, motion.producer.route))
    judged = [sample.judgement for sample in found if sample.judgement is not None]
    counts = {place.value: sum(j.verdict is place for j in judged) for place in Verdict}
    return {**counts, "no answer": len(found) - len(judged), "radii": _largest([j.radii for j in judged])}


def _check_route(engine: Engine, route: Route, scene: Scene, ref: Reference, record: Record) -> Motion | None:
    """Compare one route's answer, and return it; None if there is none."""
    told = {"engine": engine.name, "route": route.name}
    try:
        terms, faults = granted(engine, scene, engine.terms(scene, route))
        start = time.perf_counter()
        motion = engine.solve(scene, route)
        seconds = time.perf_counter() - start
    except EngineError as error:
        record["refusals"].append(str(error))
        if not _is_refusal(error, scene) and not _excused(ref, ref.motion.t[-1], record):
            record["disagreements"].append({**told, **_no_answer("no answer", str(error))})
        return None
    found = compare(ref, motion, terms)
    record["answers"].append(_answer_record(engine, motion, found, ref, seconds))
    record["disagreements"] += [{**told, **fault} for fault in (*faults, *undelivered(engine, scene, motion))]
    turned_round = _turned_round(engine, route, scene, ref, terms) if route == engine.routes()[0] else None
    for quantity, q in found.quantities.items():
        if not q.agrees:
            kind = "other assembly" if found.other_assembly else "beyond the allowed error"
        elif turned_round is not None and not turned_round.quantities[quantity].agrees:
            q, kind = turned_round.quantities[quantity], "depends on the order of bodies"
        else:
            continue
        kind = "status ok without a number" if np.isinf(q.error).any() else kind
        at = {"quantity": quantity, "kind": kind, "ratio": _largest_ratio(q.ratio), "worst": q.worst}
        record["disagreements"].append({**told, **at})
    if found.missing and not _excused(ref, found.first_missing, record):
        record["disagreements"].append({**told, **_no_answer("no answer", f"{found.missing} times without answer")})
    elif turned_round is not None and turned_round.missing and not _excused(ref, turned_round.first_missing, record):
        at = _no_answer("depends on the order of bodies", f"{turned_round.missing} times without answer")
        record["disagreements"].append({**told, **at})
    return motion


def _excused(ref: Reference, first: float, record: Record) -> bool:
    """Whether an engine may give no answer from a time on, because of a nearly singular pose; noted in the record."""
    found = excuse(ref, first, REGULAR)
    if found is not None:
        record["reference"]["excuse"] = found
    return found is not None


def _turned_round(engine: Engine, route: Route, scene: Scene, ref: Reference, terms: Sequence[Term]) -> Comparison:
    """Return the comparison of the engine's answer to the same scene with its bodies, joints and drivers reversed.

    It is asked for every fourth time: what depends on the order of bodies does so at any time, and the march between
    them is another one.
    """
    asked = np.arange(0, len(scene.times), TURNED_ROUND)
    fewer = replace(permuted(scene), times=tuple(scene.times[k] for k in asked))
    try:
        return compare(ref, engine.solve(fewer, route), terms, asked)
    except EngineError:
        nothing = dict.fromkeys(QUANTITIES, NOTHING)
        return Comparison(nothing, len(asked), 0, other_assembly=False, first_missing=float(ref.motion.t[-1]))


def _is_refusal(error: EngineError, scene: Scene) -> bool:
    """Whether an engine says what it cannot do, rather than that it failed at something it can."""
    return "refuses" in str(error) or any(body.estimate is None for body in scene.mechanism.bodies)


def _no_answer(kind: str, worst: str) -> dict[str, Any]:
    return {"quantity": "status", "kind": kind, "ratio": None, "worst": worst}


def _answer_record(engine: Engine, motion: Motion, found: Comparison, ref: Reference, seconds: float) -> dict[str, Any]:
    route, common = motion.producer.route, common_sample(ref)
    return {
        "engine": engine.name,
        "version": motion.producer.version,
        "route": {k: str(v) for k, v in vars(route).items()},
        "quantities": {
            name: {
                "ratio": _largest_ratio(q.ratio),
                "worst": q.worst,
                "digits_by_sigma": by_decade(ref.sigma_min, q.digits),
                "samples": worst_samples(ref.sigma_min, q),
                "common": off_at(q, common),
                **({"cycle": cycle(q)} if name == "position" else {}),
            }
            for name, q in found.quantities.items()
        },
        "missing": found.missing,
        "judged": found.judged,
        "times": len(motion.status),
        "seconds": seconds,
    }


def _check_levels(engine: Engine, scene: Scene, at: Sequence[Configuration], record: Record) -> None:
    """Compare the engine's own rows for the joints that it does not refuse; a refused joint is named, not skipped."""
    reasons = refusals(engine, scene, Level.JACOBIAN)
    record["refusals"] += reasons
    if not at or len(reasons) == len(scene.mechanism.constraints):
        return
    try:
        model = engine.constraints(scene)
        try:
            found = compare_levels(engine, model, scene.mechanism, at, engine.terms(scene))
        finally:
            model.close()
    except EngineError as error:
        record["refusals"].append(str(error))
        if not _is_refusal(error, scene):
            told = {"engine": engine.name, "route": "rows", **_no_answer("no answer", str(error))}
            record["disagreements"].append(told)
        return
    for level, comparison in found.items():
        record["levels"].append(_level_record(engine, level, comparison))
        if not comparison.agrees:
            at_level = {
                "engine": engine.name,
                "route": "rows",
                "quantity": level.value,
                "kind": "model translated wrongly",
            }
            record["disagreements"].append({**at_level, "ratio": comparison.ratio, "worst": comparison.worst})


def _level_record(engine: Engine, level: Level, found: LevelComparison) -> dict[str, Any]:
    digits = histogram(found.digits)
    return {
        "engine": engine.name,
        "level": level.value,
        "ratio": found.ratio,
        "digits": digits,
        "rows": found.rows,
        "worst": found.worst,
    }


def histogram(digits: Iterable[float]) -> dict[str, int]:
    """Return how often each number of digits occurs, rounded down to a tenth; NaN is left out."""
    counts: dict[str, int] = {}
    for value in np.asarray(list(digits)):
        if np.isfinite(value):
            name = f"{np.floor(value * 10) / 10:.1f}"
            counts[name] = counts.get(name, 0) + 1
    return counts


def by_decade(sigma: Any, digits: Any) -> dict[str, dict[str, int]]:
    """Return the histogram of digits for each decade of sigma_min, the distance to a singular pose."""
    seen = np.isfinite(sigma) & np.isfinite(digits) & (np.asarray(sigma) > 0)
    decades = np.floor(np.log10(sigma[seen])).astype(int)
    return {str(d): histogram(digits[seen][decades == d]) for d in sorted(set(decades.tolist()))}


def permuted(scene: Scene) -> Scene:
    """Return the same scene with its bodies, joints and drivers in reverse order."""
    m = scene.mechanism
    return replace(scene, mechanism=Mechanism(m.bodies[::-1], m.joints[::-1], m.drivers[::-1]))


def _largest(values: Any) -> float | None:
    finite = np.asarray(values)[np.isfinite(values)]
    return float(finite.max()) if finite.size else None


def _largest_ratio(ratios: Any) -> float | None:
    """Return the largest ratio, an infinite one as the largest double; None if nothing was judged."""
    judged = np.asarray(ratios)[~np.isnan(ratios)]
    return min(float(judged.max()), sys.float_info.max) if judged.size else None


def _smallest(values: Any) -> float:
    finite = np.asarray(values)[np.isfinite(values)]
    return float(finite.min()) if finite.size else 0.0
