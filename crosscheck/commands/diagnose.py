"""A scene's equations: `crosscheck diagnose` and `crosscheck mobility` at a pose, `crosscheck program` as a list."""

from __future__ import annotations

import json
from collections.abc import Iterator
from dataclasses import replace
from typing import Annotated, Any

import numpy as np
from cyclopts import Parameter

from crosscheck.commands.solve import SCHEMA, numbers
from crosscheck.commands.usage import Json, SceneFile
from crosscheck.errors import DISAGREEMENT, PASS
from refkin.errors import RefkinError
from refkin.model import Scene
from refkin.motion import Motion, Status
from refkin.proof.singularity.diagnosis import Diagnosis, PoseKind
from refkin.scenes.files import load
from refkin.solving.mobility import Count, Mobility, Rank, count, mobility_of
from refkin.solving.solve import solve
from refkin.solving.starts import diagnose, find_start
from refkin.system import compile_system


def hardest(motion: Motion) -> int | None:
    """Return the number of the first singular pose, or else of that with the smallest sigma; None without a pose."""
    if Status.SINGULAR in motion.status:
        return motion.status.index(Status.SINGULAR)
    reached = np.isfinite(motion.q[0])
    return int(np.argmin(np.where(reached, motion.sigma_min, np.inf))) if reached.any() else None


def _text(motion: Motion, t: float, diagnosis: Diagnosis) -> str:
    lines = [
        f"verdict: {motion.verdict.value}",
        f"t = {t:.17g}",
        diagnosis.message,
        f"smallest singular value of the balanced Jacobian: {diagnosis.sigma:.3g}",
    ]
    named = {"rows": diagnosis.rows, "bodies": diagnosis.bodies}
    lines += [f"{what}: {', '.join(names)}" for what, names in named.items() if names]
    lines += [f"tangent: {np.array2string(tangent, precision=6)}" for tangent in diagnosis.tangents]
    return "\n".join(lines)


def _diagnosed(scene: Scene, motion: Motion, k: int | None, diagnosis: Diagnosis | None) -> dict[str, Any]:
    """Return a diagnosis as plain data; null where there is no pose."""
    header: dict[str, Any] = {"schema": SCHEMA, "scene": scene.name, "verdict": motion.verdict.value}
    if k is None or diagnosis is None:
        return {**header, "message": motion.message, "t": None, "kind": None}
    names, width = [body.name for body in scene.mechanism.bodies], scene.mechanism.kind.width
    return {
        **header,
        "message": diagnosis.message,
        "t": float(motion.t[k]),
        "kind": diagnosis.kind.value,
        "sigma": diagnosis.sigma,
        "rows": list(diagnosis.rows),
        "bodies": list(diagnosis.bodies),
        "other_driver": diagnosis.other_driver or None,
        "tangents": [
            {name: numbers(v[width * k : width * (k + 1)]) for k, name in enumerate(names)}
            for v in map(np.asarray, diagnosis.tangents)
        ],
    }


def print_diagnosis(scene: SceneFile, *, as_json: Json = False) -> int:
    """Classify the pose of a scene that is nearest to a singular one: regular, or which kind of singularity.

    Exit codes: 0 it is regular, or a structure, or has redundant rows that agree; 1 it is singular, or there is no
    pose; 2 the scene is invalid.
    """
    read = replace(load(scene), bodies_wanted=None)
    motion = solve(read)
    k = hardest(motion)
    if k is None:
        none = f"{motion.verdict.value}: {motion.message}"
        print(json.dumps(_diagnosed(read, motion, None, None)) if as_json else none)
        return 1
    contacts = [contact.s[k] for contact in motion.contacts.values()]
    answer = diagnose(read, np.append(motion.q[:, k], contacts), float(motion.t[k]))
    print(json.dumps(_diagnosed(read, motion, k, answer)) if as_json else _text(motion, motion.t[k], answer))
    ended = motion.status[k] is Status.OK and answer.kind in (PoseKind.REGULAR, PoseKind.STRUCTURE, PoseKind.REDUNDANT)
    return 0 if ended else 1


def mobility(scene: SceneFile, *, as_json: Json = False) -> int:
    """Count the freedoms of a scene's joints, take the rank of their equations at its first pose, name redundant rows.

    It also names bodies of space that spin or slide while nothing else moves. Exit codes: 0 done, 1 the scene has no
    pose at which to take the rank, 2 the scene is invalid.
    """
    read = load(scene)
    counted, system = count(read.mechanism), compile_system(read.mechanism, unit=read.mechanism.unit())
    t, start = read.times[0], find_start(system, read)
    posed = mobility_of(system, start.q, t) if start.status is Status.OK else None
    if as_json:
        print(json.dumps({"schema": SCHEMA, "scene": read.name, "t": t, **_freedoms(counted, posed, start.message)}))
    else:
        print("\n".join(_counted(counted, posed, t, start.message)))
    return 0 if posed else 1


def _freedoms(counted: Count, posed: Mobility | None, message: str) -> dict[str, Any]:
    """Return mobility by count and by rank as plain data; null by rank where there is no pose, and why."""
    keys = ("bodies", "coordinates", "equations", "mobility", "useful")
    by_count = {key: getattr(counted, key) for key in keys} | {"passive": list(counted.passive), "kind": counted.kind}
    if posed is None:
        return {"by_count": by_count, "by_rank": None, "message": message}
    by_rank = {key: getattr(posed, key) for key in ("mobility", "kind", "useful")} | {"passive": list(posed.passive)}
    by_rank |= {"joints": _rank(posed.joints), "driven": _rank(posed.driven)}
    return {"by_count": by_count, "by_rank": by_rank, "message": message}


def _rank(rank: Rank) -> dict[str, Any]:
    redundant = {row.row: dict(row.factors) for row in rank.dependent}
    return {**{key: getattr(rank, key) for key in ("coordinates", "rank", "kept", "dropped")}, "redundant": redundant}


def _counted(counted: Count, mobility: Mobility | None, t: float, message: str) -> Iterator[str]:
    """Yield the same in lines to print."""
    passive = f", {len(counted.passive)} of them passive: {', '.join(counted.passive)}" if counted.passive else ""
    yield (
        f"by count: {counted.coordinates} x {counted.bodies} bodies - {counted.equations} equations,"
        f" {counted.coordinates} of them the ground's, = {counted.mobility}, {counted.kind}{passive}"
    )
    if mobility is None:
        yield f"by rank: no pose at t = {t:g}: {message}"
        return
    joints, driven = mobility.joints, mobility.driven
    yield (
        f"by rank at t = {t:g}: {joints.coordinates} coordinates - rank {joints.rank}"
        f" = {mobility.mobility}, {mobility.kind}   ({_clear(joints)})"
    )
    for row in joints.dependent:
        yield f"redundant: {row}"
    yield from (f"passive degree of freedom: {words}" for words in mobility.passive)
    all_passive = ", all passive" if mobility.passive and driven.freedoms == len(mobility.passive) else ""
    yield f"drivers leave {driven.freedoms} of these free{all_passive}   ({_clear(driven)})"
    named = {row.row for row in joints.dependent}
    for row in driven.dependent:
        if row.row not in named:
            yield f"a driver that holds nothing here: {row}"


def _clear(rank: Rank) -> str:
    return f"singular values: {rank.kept:.3g} the smallest that counts, {rank.dropped:.3g} the largest that does not"


def program(scene: SceneFile, *, counts: Annotated[bool, Parameter(negative="")] = False) -> int:
    """Print the operations that the fast path runs for a scene, and how many there are.

    A scene that calls for less has fewer: no accelerations, or bodies wanted that do not hang on all others.

    Exit codes: 0 done, 1 the equations of the scene have no such form, 2 the scene is invalid.

    Parameters
    ----------
    counts
        Print the numbers of operations alone.
    """
    read = load(scene)
    try:
        from refkin import fast  # here, because no other command needs it
    except ImportError as error:
        print(f"this installation has no fast path: {error}")
        return DISAGREEMENT
    try:
        compiled = fast.program_of(read)
    except RefkinError as error:
        print(error)
        return DISAGREEMENT
    if not counts:
        print(fast.legend(read) + str(compiled))
    for segment, number in compiled.counts().items():
        kinds = ", ".join(f"{k} {op}" for op, k in compiled.operations(segment).most_common())
        print(f"{segment:9}  {number:5}  {kinds}".rstrip())
    print(f"all        {sum(compiled.counts().values()):5}")
    return PASS
