"""What the scenes of a run were, and what engines refused of them."""

from __future__ import annotations

import math
import re
from collections import Counter
from collections.abc import Mapping
from typing import Any

from crosscheck.judge.records import ReferenceRow

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
            found = sorted(d for d in counts if d is not None)
            named[f"{name}_decade"] = {str(d): counts[d] for d in found}
            if counts[None]:
                named[f"{name}_decade"]["no decade"] = counts[None]
        return named


REFUSAL = re.compile(
    r"(?P<engine>\S+) refuses (?P<joint>.+?) (?:'.*?'|\".*?\") at (?P<level>\w+): (?P<reason>.*)", re.S
)


class Refusals:
    """What engines refused, by engine, joint type, level and reason; what else they said for an answer, by its text."""

    def __init__(self) -> None:
        self.joints: Counter[tuple[str, ...]] = Counter()
        self.scenes: Counter[tuple[str, ...]] = Counter()

    def add(self, texts: list[str]) -> None:
        """Count the refusals of one scene."""
        found: Counter[tuple[str, ...]] = Counter(map(_named, texts))
        for name, joints in found.items():
            if name not in self.joints and len(self.joints) >= MOST_VALUES:
                name = ("", "", "", OTHERS)
            self.joints[name] += joints
            self.scenes[name] += 1

    def described(self) -> list[dict[str, Any]]:
        """Return one row per refusal, most frequent first."""
        keys = ("engine", "joint", "level", "reason")
        order = sorted(self.joints, key=lambda name: (name[0], -self.scenes[name], name))
        return [
            {**dict(zip(keys, name, strict=True)), "scenes": self.scenes[name], "joints": self.joints[name]}
            for name in order
        ]


def _named(text: str) -> tuple[str, ...]:
    found = REFUSAL.fullmatch(text)
    return tuple(found.group("engine", "joint", "level", "reason")) if found else ("", "", "", text)


def _count(counts: Counter[str], value: str) -> None:
    counts[value if value in counts or len(counts) < MOST_VALUES else OTHERS] += 1
