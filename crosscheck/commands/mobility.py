"""`crosscheck mobility`: how many freedoms a scene's mechanism has, by count and by rank."""

from __future__ import annotations

import json
from collections.abc import Iterator
from pathlib import Path
from typing import Any

from crosscheck.commands.usage import Json
from refkin.motion import Status
from refkin.scenes.files import load
from refkin.solving.mobility import Count, Mobility, Rank, count, mobility_of
from refkin.solving.starts import find_start
from refkin.system import compile_system

SCHEMA = 1


def mobility(scene: Path, *, as_json: Json = False) -> int:
    """Count the freedoms of a scene's joints, take the rank of their equations at its first pose, name redundant rows.

    Of bodies of space that spin, or slide, while nothing else moves it says so. Exit codes: 0 done, 1 no pose was found
    to take the rank at, 2 the scene is invalid.

    Parameters
    ----------
    scene
        A scene file (TOML, or JSON if it ends in .json).
    as_json
        Print one JSON object instead of lines.
    """
    read = load(scene)
    counted, system = count(read.mechanism), compile_system(read.mechanism, unit=read.mechanism.unit())
    t, start = read.times[0], find_start(system, read)
    posed = mobility_of(system, start.q, t) if start.status is Status.OK else None
    if as_json:
        print(json.dumps({"schema": SCHEMA, "scene": read.name, "t": t, **to_json(counted, posed, start.message)}))
    else:
        print("\n".join([_of_count(counted), *_of_pose(posed, t, start.message)]))
    return 0 if posed else 1


def to_json(counted: Count, posed: Mobility | None, message: str) -> dict[str, Any]:
    """Return mobility by count and by rank as plain data; null by rank where there is no pose, and why."""
    keys = ("bodies", "coordinates", "equations", "mobility", "useful")
    by_count = {key: getattr(counted, key) for key in keys} | {"passive": list(counted.passive), "kind": counted.kind}
    if posed is None:
        return {"by_count": by_count, "by_rank": None, "message": message}
    by_rank = {
        "mobility": posed.mobility,
        "kind": posed.kind,
        "useful": posed.useful,
        "passive": list(posed.passive),
        "joints": _rank(posed.joints),
        "driven": _rank(posed.driven),
    }
    return {"by_count": by_count, "by_rank": by_rank, "message": message}


def _rank(rank: Rank) -> dict[str, Any]:
    redundant = {row.row: dict(row.factors) for row in rank.dependent}
    return {**{key: getattr(rank, key) for key in ("coordinates", "rank", "kept", "dropped")}, "redundant": redundant}


def _of_count(counted: Count) -> str:
    passive = f", {len(counted.passive)} of them passive: {', '.join(counted.passive)}" if counted.passive else ""
    return (
        f"by count: {counted.coordinates} x {counted.bodies} bodies - {counted.equations} equations"
        f" = {counted.mobility}, {counted.kind}{passive}"
    )


def _of_pose(mobility: Mobility | None, t: float, message: str) -> Iterator[str]:
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
    yield f"drivers leave {driven.freedoms} of these free{_all_passive(mobility)}   ({_clear(driven)})"
    named = {row.row for row in joints.dependent}
    for row in driven.dependent:
        if row.row not in named:
            yield f"a driver that holds nothing here: {row}"


def _all_passive(mobility: Mobility) -> str:
    return ", all passive" if mobility.passive and mobility.driven.freedoms == len(mobility.passive) else ""


def _clear(rank: Rank) -> str:
    return f"smallest singular value counted {rank.kept:.3g}, largest not counted {rank.dropped:.3g}"
