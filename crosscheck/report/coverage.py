"""What the scenes of a run were, and what engines refused of them."""

from __future__ import annotations

import math
from collections import Counter
from collections.abc import Mapping, Sequence
from typing import Any

from crosscheck.judge.records import CELL, ReferenceRow, RefusalRow, cell_of

MOST_VALUES = 60
"""Distinct values kept per property; what comes after is counted as "others"."""
NOT_PROPERTIES = ("shard",)
"""What the generator says about a scene to find it again, not to describe it."""
OTHERS = "others"


def decade(value: float | None) -> int | None:
    """Return the decade [10^d, 10^(d+1)) of a positive number; None for anything else."""
    if value is None or not math.isfinite(value) or value <= 0:
        return None
    return math.floor(math.log10(value))


class Coverage:
    """Counts of scenes by what the generator knows of them; numbers are counted by decade."""

    def __init__(self) -> None:
        self.counts: dict[str, Counter[str]] = {}
        self.decades: dict[str, Counter[int | None]] = {}

    def add(self, about: Mapping[str, Any], reference: ReferenceRow | None) -> None:
        """Count one scene."""
        for name, value in about.items():
            if name in NOT_PROPERTIES:
                continue
            if isinstance(value, int | float) and not isinstance(value, bool):
                self.decades.setdefault(name, Counter())[decade(value)] += 1
            else:
                _count(self.counts.setdefault(name, Counter()), "not applicable" if value is None else str(value))
        if reference is not None:
            self.decades.setdefault("sigma_min", Counter())[decade(reference.sigma_min)] += 1

    def described(self) -> dict[str, Any]:
        """Return {property: {value: scenes}}, most frequent first, and decades from the smallest on."""
        named = {name: dict(counts.most_common()) for name, counts in sorted(self.counts.items())}
        for name, counts in sorted(self.decades.items()):
            known = sorted(d for d in counts if d is not None)
            named[f"{name}_decade"] = {str(d): counts[d] for d in known}
            if counts[None]:
                named[f"{name}_decade"]["no decade"] = counts[None]
        return named


class Refusals:
    """What engines refused, by engine, joint type, level and reason."""

    def __init__(self) -> None:
        self.joints: Counter[tuple[str, ...]] = Counter()
        self.scenes: Counter[tuple[str, ...]] = Counter()

    def add(self, rows: Sequence[RefusalRow]) -> None:
        """Count the refusals of one scene."""
        refused = Counter((row.engine, row.joint, row.level, row.reason) for row in rows)
        for name, joints in refused.items():
            kept = name if name in self.joints or len(self.joints) < MOST_VALUES else ("", "", "", OTHERS)
            self.joints[kept] += joints
            self.scenes[kept] += 1

    def described(self) -> list[dict[str, Any]]:
        """Return one row per refusal, most frequent first."""
        keys = ("engine", "joint", "level", "reason")
        order = sorted(self.joints, key=lambda name: (name[0], -self.scenes[name], name))
        return [
            {**dict(zip(keys, name, strict=True)), "scenes": self.scenes[name], "joints": self.joints[name]}
            for name in order
        ]


class Together:
    """How often the features of scenes were met together: the cells of the table of coverage."""

    def __init__(self) -> None:
        self.cells: Counter[tuple[str, ...]] = Counter()

    def add(self, about: Mapping[str, Any]) -> None:
        """Count one scene, if it was drawn."""
        cell = cell_of(about)
        if cell is not None:
            self.cells[cell] += 1

    def described(self) -> dict[str, Any]:
        """Return the features, how many cells were met and how many only once, and every cell, the rarest last."""
        rows = [[*cell, scenes] for cell, scenes in sorted(self.cells.items(), key=lambda item: (-item[1], item[0]))]
        once = sum(scenes == 1 for scenes in self.cells.values())
        return {"features": list(CELL), "cells": len(rows), "once": once, "rows": rows}


def _count(counts: Counter[str], value: str) -> None:
    counts[value if value in counts or len(counts) < MOST_VALUES else OTHERS] += 1
