"""A scene's answer and its equations: `crosscheck solve`, `schema`, `diagnose`, `mobility`, `program`.

`diagnose` and `mobility` look at a pose, `program` prints the equations as a list of operations; `schema` is the form
of scene files.
"""

from __future__ import annotations

import json
import sys
from collections.abc import Iterable, Iterator
from dataclasses import replace
from pathlib import Path
from typing import Annotated, Any

import numpy as np
from cyclopts import Parameter

from crosscheck.commands.usage import Json, SceneFile, print_numbers, writable
from crosscheck.errors import DISAGREEMENT, PASS, naming
from refkin.errors import RefkinError
from refkin.model import Scene
from refkin.motion import QUANTITIES, BodyMotion, Motion, Status
from refkin.output import SceneMotion
from refkin.proof.singularity.diagnosis import Diagnosis, PoseKind
from refkin.scenes.files import load
from refkin.solving import solve as solving
from refkin.solving.limits import LONG, expected_seconds
from refkin.solving.mobility import Count, Mobility, Rank, count, mobility_of
from refkin.solving.starts import diagnose, find_start
from refkin.system import compile_system

SCHEMA = 1


def solve(scene: SceneFile, *, as_json: Json = False, csv: Path | None = None) -> int:
    """Solve a scene with the reference.

    Exit codes: 0 every pose is ok, 1 not every pose is ok, 2 the scene is invalid.

    Parameters
    ----------
    csv
        Write all that the scene calls for to this file, one row per time, instead of printing a table.
    """
    read = load(scene)
    writable("csv", csv, scene)
    seconds = expected_seconds(read)
    if seconds > LONG:
        print(f"{len(read.times)} times: this takes about {seconds:.0f} s", file=sys.stderr, flush=True)
    motion = solving.solve(read)
    if csv is not None:
        with naming(csv):
            motion.to_csv(csv)
        print(f"{csv}: {len(motion.t)} times, verdict {motion.verdict}", file=sys.stderr)
    if as_json:
        print(json.dumps(to_json(read, motion)))
    elif csv is None:
        _print_motion(motion)
    return 0 if motion.verdict is Status.OK else 1


def print_schema() -> int:
    """Print the JSON schema of scene files, for editors."""
    from refkin.scenes.keys import schema  # here: pydantic is loaded where it is needed

    print(json.dumps(schema(), indent=2))
    return 0


def to_json(scene: Scene, motion: Motion) -> dict[str, Any]:
    """Return the answer to a scene as plain data; levels that were not called for are absent."""
    radius = motion.certified_radius
    return {
        "schema": SCHEMA,
        "scene": scene.name,
        "verdict": motion.verdict.value,
        "message": motion.message,
        "t": numbers(motion.t),
        "status": [s.value for s in motion.status],
        "bodies": {
            body: _called_for(q=motion[body].q, qd=motion[body].qd, qdd=motion[body].qdd, **_turning(motion[body]))
            for body in motion.bodies
        },
        "points": {name: _called_for(r=p.r, v=p.v, a=p.a) for name, p in motion.points.items()},
        "contacts": {
            name: {order: numbers(level) for order, level in vars(contact).items() if level is not None}
            for name, contact in motion.contacts.items()
        },
        "residual": numbers(motion.residual),
        "sigma_min": numbers(motion.sigma_min),
        "condition": numbers(motion.condition),
        "certified_radius": {quantity: numbers(getattr(radius, quantity)) for quantity in QUANTITIES},
    }


def _turning(body: BodyMotion) -> dict[str, Any]:
    """Return angular velocity and acceleration of a body of space; in the plane they are in qd and qdd."""
    return {key: getattr(body, key, None) for key in ("omega", "alpha")} if hasattr(body, "rotation") else {}


def numbers(values: Iterable[float]) -> list[float | None]:
    """Return floats with None for what is not finite."""
    return [float(v) if np.isfinite(v) else None for v in values]


def _called_for(**levels: Any) -> dict[str, Any]:
    """Return each level that was called for as one row of components per time."""
    return {key: [numbers(row) for row in level.T] for key, level in levels.items() if level is not None}


def _print_motion(motion: SceneMotion) -> None:
    from refkin.output.tables import wide

    if not print_numbers(wide(motion), len(motion.first_columns)):
        counts = ", ".join(f"{motion.status.count(s)} {s}" for s in dict.fromkeys(motion.status))
        print(f"no pose at any of {len(motion.t)} times: {counts}")
    residual = motion.residual[np.isfinite(motion.residual)]
    worst = f"{residual.max():.3g}" if residual.size else "none"
    print(f"verdict: {motion.verdict.value}   worst scaled residual: {worst}")
    if motion.message:
        print(motion.message)


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
    motion = solving.solve(read)
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
