"""What of drawn scenes is counted together: the table of coverage, and what a night prefers to draw next."""

from __future__ import annotations

import math
from collections.abc import Mapping
from itertools import combinations
from typing import Any

FEATURES = ("joints", "driver", "law", "class", "hardness")
CELL = (*FEATURES, "decade of the distance")
"""What of a drawn scene is counted together: one cell of the table of coverage."""


def cell_of(about: Mapping[str, Any]) -> tuple[str, ...] | None:
    """Return the cell of the table of coverage that a scene belongs to; None if it was not drawn."""
    if not all(name in about for name in FEATURES):
        return None
    distance = about.get("distance")
    decade = str(math.floor(math.log10(distance))) if distance else "none"
    return (*(str(about[name]) for name in FEATURES), decade)


def features_of(about: Mapping[str, Any]) -> list[tuple[str, str]]:
    """Return the features of a drawn scene as (name, value), each joint, driver and law by itself."""
    named = zip(CELL, cell_of(about) or (), strict=False)
    return sorted({(name, part) for name, value in named for part in value.split(", ")})


def pairs_of(about: Mapping[str, Any]) -> list[str]:
    """Return every two features that a drawn scene has at once: what a night prefers not to have met yet."""
    return [" & ".join(map(" ".join, pair)) for pair in combinations(features_of(about), 2)]
