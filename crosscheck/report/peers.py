"""What engines are held against beside the reference: each other, and the digits that rounding leaves to anybody."""

from __future__ import annotations

import math
from collections import Counter
from collections.abc import Mapping
from itertools import combinations
from typing import Any

from crosscheck.judge.records import MOST_DIGITS, QUANTITIES, Answer, Disagreement, Record
from crosscheck.report.cells import Place
from crosscheck.report.digits import Digits, describe

Who = tuple[str, str]


class Peers:
    """Digits to which each two answers agree (one number per scene), and the attainable digits by decade."""

    def __init__(self) -> None:
        self.pairs: dict[tuple[Who, Who], list[Counter[int]]] = {}
        self.attainable: dict[str, Digits] = {}

    def add(self, record: Record) -> None:
        """Count one scene."""
        scale = record.reference.common.scale if record.reference and record.reference.common else {}
        for one, other in combinations(sorted(record.answers, key=lambda a: (a.engine, a.route.name)), 2):
            names = ((one.engine, one.route.name), (other.engine, other.route.name))
            counts = self.pairs.setdefault(names, [Counter() for _ in QUANTITIES])
            for quantity, of_quantity in zip(QUANTITIES, counts, strict=True):
                digits = _agreeing(one, other, quantity, scale)
                if digits is not None:
                    of_quantity[math.floor(10 * digits)] += 1
        for quantity, histograms in (record.reference.attainable_by_sigma if record.reference else {}).items():
            for decade, histogram in histograms.items():
                self.attainable.setdefault(quantity, Digits()).add(decade, histogram)

    def attainable_described(self) -> dict[str, Any]:
        """Return {quantity: {decade: median, 1st percentile, worst}}."""
        return {quantity: digits.described_by_sigma() for quantity, digits in self.attainable.items()}

    def agreement_described(self) -> list[dict[str, Any]]:
        """Return one row per pair: for each quantity the median over scenes and the worst scene."""
        return [
            {
                "engines": [first[0], second[0]],
                "routes": [first[1], second[1]],
                **{
                    quantity: {"scenes": of_quantity.total(), **describe(of_quantity)}
                    for quantity, of_quantity in zip(QUANTITIES, counts, strict=True)
                },
            }
            for (first, second), counts in sorted(self.pairs.items())
            if any(counts)
        ]


def _agreeing(one: Answer, other: Answer, quantity: str, scale: Mapping[str, float]) -> float | None:
    """Return the digits to which two answers agree at the common sample; None if one of them has nothing there."""
    if quantity not in scale or quantity not in one.quantities or quantity not in other.quantities:
        return None
    both = zip(one.quantities[quantity].common, other.quantities[quantity].common, strict=False)
    apart = [a - b for a, b in both if a is not None and b is not None]
    if not apart:
        return None
    if quantity == "position":  # angles are the same modulo full turns
        apart[2::3] = [math.remainder(x, math.tau) for x in apart[2::3]]
    largest = max(map(abs, apart)) / scale[quantity]
    return MOST_DIGITS if largest == 0.0 else min(MOST_DIGITS, -math.log10(largest))


class Silent:
    """In how many scenes each route gave an answer that is wrong, by what is wrong with it: each scene counts once."""

    def __init__(self) -> None:
        self.scenes: dict[Who, dict[str, set[str]]] = {}

    def add(self, place: Place, wrong: Disagreement) -> None:
        """Count a disagreement; having no answer, or being ended, is not silent."""
        if wrong.quantity != "status":
            self.scenes.setdefault((wrong.engine, wrong.route), {}).setdefault(wrong.name, set()).add(place.key)

    def of(self, engine: str, route: str) -> dict[str, int]:
        """Return {what is wrong: scenes}, most frequent first, with "any" for all of them together."""
        kinds = self.scenes.get((engine, route), {})
        counts = sorted(((kind, len(keys)) for kind, keys in kinds.items()), key=lambda item: (-item[1], item[0]))
        return {"any": len(set().union(*kinds.values())), **dict(counts)} if kinds else {}
