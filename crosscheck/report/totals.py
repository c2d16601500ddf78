"""Totals of a run: its scenes, the refusals of engines, the statuses of the reference, the agreement of engines."""

from __future__ import annotations

import math
from collections import Counter
from collections.abc import Mapping, Sequence
from itertools import combinations
from statistics import median
from typing import Any

from crosscheck.judge.records import MOST_DIGITS, QUANTITIES, Answer, Disagreement, Record, ReferenceRow, RefusalRow
from crosscheck.report.cells import Digits, RecordLine, describe
from crosscheck.scenes.names import CELL, cell_of, decade, features_of

MOST_VALUES = 60
"""Distinct values kept per property; what comes after is counted as "others"."""
NOT_PROPERTIES = ("shard", "shortened", "well_known")
"""What is said about a scene to find it again, or how it was checked, not to describe it."""
OTHERS = "others"


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
                counts = self.counts.setdefault(name, Counter())
                text = "not applicable" if value is None else str(value)
                counts[text if text in counts or len(counts) < MOST_VALUES else OTHERS] += 1
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
    """How often the features of scenes were met together: the cells of the table of coverage, and every two of them."""

    def __init__(self) -> None:
        self.cells: Counter[tuple[str, ...]] = Counter()
        self.values: dict[str, set[str]] = {}
        self.pairs: Counter[tuple[tuple[str, str], tuple[str, str]]] = Counter()
        self.shortened = 0

    def add(self, about: Mapping[str, Any]) -> None:
        """Count one scene, if it was drawn."""
        cell = cell_of(about)
        if cell is not None:
            self.cells[cell] += 1
        self.shortened += about.get("shortened", False)
        features = features_of(about)
        for name, value in features:
            self.values.setdefault(name, set()).add(value)
        self.pairs.update(combinations(features, 2))

    def described(self) -> dict[str, Any]:
        """Return the features, how many cells were met and how many only once, and every cell, the rarest last.

        `shortened` is how many scenes were checked at a part of their times.

        `pairs` has, per two kinds of features, how many of all their pairs were met, how many there are, and how many
        were met only once; and by name those that were not met.
        """
        rows = [[*cell, scenes] for cell, scenes in sorted(self.cells.items(), key=lambda item: (-item[1], item[0]))]
        once = sum(scenes == 1 for scenes in self.cells.values())
        pairs = [self._pairs(a, b) for a, b in combinations(sorted(self.values), 2)]
        counts = {"cells": len(rows), "once": once, "shortened": self.shortened}
        return {"features": list(CELL), **counts, "rows": rows, "pairs": pairs}

    def _pairs(self, a: str, b: str) -> dict[str, Any]:
        every = [((a, x), (b, y)) for x in sorted(self.values[a]) for y in sorted(self.values[b])]
        missing = [[x, y] for (_, x), (_, y) in every if ((a, x), (b, y)) not in self.pairs]
        once = sum(self.pairs[pair] == 1 for pair in every)
        return {
            "features": [a, b],
            "met": len(every) - len(missing),
            "of": len(every),
            "once": once,
            "missing": missing,
        }


Who = tuple[str, str]


class Peers:
    """Digits to which each two answers agree (one number per scene), and those that rounding leaves by decade."""

    def __init__(self) -> None:
        self.pairs: dict[tuple[Who, Who], list[Counter[int]]] = {}
        self.rounding: dict[str, Digits] = {}

    def add(self, record: Record) -> None:
        """Count one scene."""
        scale = record.reference.common.scale if record.reference and record.reference.common else {}
        for one, other in combinations(sorted(record.answers, key=lambda a: (a.engine, a.method.name)), 2):
            names = ((one.engine, one.method.name), (other.engine, other.method.name))
            counts = self.pairs.setdefault(names, [Counter() for _ in QUANTITIES])
            for quantity, of_quantity in zip(QUANTITIES, counts, strict=True):
                turns = quantity == "position" and record.about.get("dimension") != "spatial"
                digits = _agreeing(one, other, quantity, scale, turns)
                if digits is not None:
                    of_quantity[math.floor(10 * digits)] += 1
        for quantity, histograms in (record.reference.rounding_by_sigma if record.reference else {}).items():
            for near, histogram in histograms.items():
                self.rounding.setdefault(quantity, Digits()).add(near, histogram)

    def agreement_described(self) -> list[dict[str, Any]]:
        """Return one row per pair: for each quantity the median over scenes and the worst scene."""
        return [
            {
                "engines": [first[0], second[0]],
                "methods": [first[1], second[1]],
                **{
                    quantity: {"scenes": of_quantity.total(), **describe(of_quantity)}
                    for quantity, of_quantity in zip(QUANTITIES, counts, strict=True)
                },
            }
            for (first, second), counts in sorted(self.pairs.items())
            if any(counts)
        ]


def _agreeing(one: Answer, other: Answer, quantity: str, scale: Mapping[str, float], turns: bool) -> float | None:
    """Return the digits to which two answers agree at the common sample; None if one of them has nothing there.

    `turns`: each third coordinate is an angle, the same modulo full turns.
    """
    if quantity not in scale or quantity not in one.quantities or quantity not in other.quantities:
        return None
    both = zip(one.quantities[quantity].common, other.quantities[quantity].common, strict=False)
    apart = [a - b for a, b in both if a is not None and b is not None]
    if not apart:
        return None
    if turns:
        apart[2::3] = [math.remainder(x, math.tau) for x in apart[2::3]]
    largest = max(map(abs, apart)) / scale[quantity]
    return MOST_DIGITS if largest == 0.0 else min(MOST_DIGITS, -math.log10(largest))


class Silent:
    """In how many scenes each method gave an answer that is wrong, by what is wrong with it: each scene counts once."""

    def __init__(self) -> None:
        self.scenes: dict[Who, dict[str, set[str]]] = {}

    def add(self, place: RecordLine, wrong: Disagreement) -> None:
        """Count a disagreement; having no answer, or being ended, is not silent."""
        if wrong.quantity != "status":
            self.scenes.setdefault((wrong.engine, wrong.method), {}).setdefault(wrong.name, set()).add(place.key)

    def of(self, engine: str, method: str) -> dict[str, int]:
        """Return {what is wrong: scenes}, most frequent first, with "any" for all of them together."""
        kinds = self.scenes.get((engine, method), {})
        counts = sorted(((kind, len(keys)) for kind, keys in kinds.items()), key=lambda item: (-item[1], item[0]))
        return {"any": len(set().union(*kinds.values())), **dict(counts)} if kinds else {}


class ReferenceTotals:
    """Statuses, and the extremes with the record they were met at."""

    def __init__(self) -> None:
        self.verdicts: Counter[str] = Counter()
        self.statuses: Counter[str] = Counter()
        self.seconds = 0.0
        self.largest: dict[str, tuple[float, RecordLine]] = {}
        self.smallest_sigma: tuple[float, RecordLine] | None = None
        self.sharpness: dict[str, list[tuple[float, float]]] = {}

    @property
    def configurations(self) -> int:
        """How many configurations the scenes ask for."""
        return self.statuses.total()

    def add(self, row: ReferenceRow, place: RecordLine) -> None:
        """Count one scene."""
        self.verdicts[row.verdict] += 1
        self.statuses.update(row.statuses)
        self.seconds += row.seconds
        for name, value in (("residual", row.residual), *row.certified_radius.items()):
            if value is not None and value > self.largest.get(name, (-1.0, place))[0]:
                self.largest[name] = (value, place)
        for name, sharp in row.sharpness.items():
            self.sharpness.setdefault(name, []).append(sharp)
        if self.smallest_sigma is None or row.sigma_min < self.smallest_sigma[0]:
            self.smallest_sigma = (row.sigma_min, place)

    def described(self) -> dict[str, Any]:
        """Return it as plain data."""
        count = self.configurations
        return {
            "verdicts": dict(self.verdicts.most_common()),
            "statuses": dict(self.statuses.most_common()),
            "largest_residual": _with_place(self.largest.get("residual")),
            "smallest_sigma_min": _with_place(self.smallest_sigma),
            "largest_certified_radius": {q: _with_place(self.largest[q]) for q in QUANTITIES if q in self.largest},
            "sharpness": {name: _sharpness(met) for name, met in self.sharpness.items()},
            "microseconds_mean": 1e6 * self.seconds / count if count else None,
        }


def _sharpness(met: Sequence[tuple[float, float]]) -> dict[str, Any]:
    """Return how many sensitivities a planted error has that is seen: somewhere, in half of the scenes, in all."""
    seen = sorted(smallest for _, smallest in met)
    return {
        "scenes": len(met),
        "smallest_seen": seen[0],
        "median_seen": median(seen),
        "always_seen": seen[-1],
        "loosest": max(largest for largest, _ in met),
    }


def _with_place(extreme: tuple[float, RecordLine] | None) -> dict[str, Any] | None:
    return {"value": extreme[0], **vars(extreme[1])} if extreme else None
