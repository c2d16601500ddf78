"""Names that engines, judgement and report share, what a scene calls for by them, how drawn scenes are counted."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from itertools import combinations
from typing import Any

from refkin.model import Effect, Scene
from refkin.motion import QUANTITIES as QUANTITIES

PHYSICAL = ("gravity", "contact", "friction", "joint limits", "passive forces", "actuation", "sensors", "inertia")
"""What a kinematic scene never calls for: every adapter has it switched off or at its least."""
PEERS = ("exudyn", "pinocchio", "mujoco")
"""Who is asked where nobody says whom to ask."""
OURS = ("refkin", "refkin-batch", "scipy", "numpy", "c")
"""Producers that are no engine: they solve the reference's equations, or know what a four-bar is."""


def called(method: str, setting: str = "") -> str:
    """Return what a method is called where settings have no column."""
    return f"{method}, {setting}" if setting else method


def order_of(scene: Scene) -> int:
    """Return the highest order that a scene calls for."""
    if Effect.ACCELERATION in scene.effects:
        return 2
    return 1 if Effect.VELOCITY in scene.effects else 0


def called_for(scene: Scene, levels: Sequence[Any]) -> tuple[Any, Any, Any]:
    """Return position, velocity and acceleration; None for what was computed on the way, or not at all."""
    q, qd, qdd, *_ = (*levels, None, None)
    return q, qd if Effect.VELOCITY in scene.effects else None, qdd if Effect.ACCELERATION in scene.effects else None


def decade(value: float | None) -> int | None:
    """Return the decade [10^d, 10^(d+1)) of a positive number; None for anything else."""
    return math.floor(math.log10(value)) if value is not None and 0.0 < value < math.inf else None


FEATURES = ("joints", "driver", "law", "class", "hardness")
CELL = (*FEATURES, "decade of the distance")
"""What of a drawn scene is counted together: one cell of the table of coverage."""


def cell_of(about: Mapping[str, Any]) -> tuple[str, ...] | None:
    """Return the cell of the table of coverage that a scene belongs to; None if it was not drawn."""
    if not all(name in about for name in FEATURES):
        return None
    near = decade(about.get("distance"))
    return (*(str(about[name]) for name in FEATURES), "none" if near is None else str(near))


def features_of(about: Mapping[str, Any]) -> list[tuple[str, str]]:
    """Return the features of a drawn scene as (name, value), each joint, driver and law by itself."""
    named = zip(CELL, cell_of(about) or (), strict=False)
    return sorted({(name, part) for name, value in named for part in value.split(", ")})


def pairs_of(about: Mapping[str, Any]) -> list[str]:
    """Return every two features that a drawn scene has at once: what a night prefers not to have met yet."""
    return [" & ".join(map(" ".join, pair)) for pair in combinations(features_of(about), 2)]
