"""`crosscheck mobility`: how many freedoms a scene's mechanism has, by count and by rank."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path

from refkin.model import Scene
from refkin.motion import Status
from refkin.scenes.files import load
from refkin.solving.mobility import Mobility, Rank, count, kind_of, mobility_of
from refkin.solving.starts import find_start
from refkin.system import compile_system


def mobility(scene: Path) -> int:
    """Count the freedoms of a scene's joints, take the rank of their equations at its first pose, name redundant rows.

    Exit codes: 0 done, 1 no pose was found to take the rank at, 2 the scene is invalid.

    Parameters
    ----------
    scene
        A scene file (TOML, or JSON if it ends in .json).
    """
    lines, posed = mobility_lines(load(scene))
    print("\n".join(lines))
    return 0 if posed else 1


def mobility_lines(scene: Scene) -> tuple[list[str], bool]:
    """Return the lines, and whether a pose was found at which the rank could be taken."""
    mechanism = scene.mechanism
    counted = count(mechanism)
    lines = [
        f"by count: {counted.coordinates} x {counted.bodies} bodies - {counted.equations} equations"
        f" = {counted.mobility}, {counted.kind}"
    ]
    system = compile_system(mechanism, unit=mechanism.unit())
    start = find_start(system, scene)
    if start.status is not Status.OK:
        return [*lines, f"by rank: no pose at t = {scene.times[0]:g}: {start.message}"], False
    return [*lines, *_of_pose(mobility_of(system, start.q, scene.times[0]), scene.times[0])], True


def _of_pose(mobility: Mobility, t: float) -> Iterator[str]:
    joints, driven = mobility.joints, mobility.driven
    yield (
        f"by rank at t = {t:g}: {joints.coordinates} coordinates - rank {joints.rank}"
        f" = {mobility.mobility}, {kind_of(mobility.mobility)}   ({_clear(joints)})"
    )
    for row in joints.dependent:
        yield f"redundant: {row}"
    yield f"drivers leave {driven.freedoms} of these free   ({_clear(driven)})"
    named = {row.row for row in joints.dependent}
    for row in driven.dependent:
        if row.row not in named:
            yield f"a driver that holds nothing here: {row}"


def _clear(rank: Rank) -> str:
    return f"smallest singular value counted {rank.kept:.3g}, largest not counted {rank.dropped:.3g}"
