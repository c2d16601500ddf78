"""What engines are held against beside the reference: each other, and the digits that rounding leaves to anybody."""

from __future__ import annotations

from collections import Counter
from typing import Any

from crosscheck.report.cells import Place
from crosscheck.report.digits import Digits, describe
from crosscheck.report.records import Checked, Disagreement

QUANTITIES = ("position", "velocity", "acceleration")
Who = tuple[str, str]


class Peers:
    """Digits to which each two answers agree (one number per scene), and the attainable digits by decade."""

    def __init__(self) -> None:
        self.pairs: dict[tuple[Who, Who], list[Counter[int]]] = {}
        self.attainable: dict[str, Digits] = {}

    def add(self, record: Checked) -> None:
        """Count one scene."""
        for a, one, b, other, *digits in record.agreement:
            first, second = sorted([(a, one), (b, other)])
            counts = self.pairs.setdefault((first, second), [Counter() for _ in QUANTITIES])
            for of_quantity, value in zip(counts, digits, strict=True):
                if value is not None:
                    of_quantity[round(10 * value)] += 1
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
        ]


class Silent:
    """In how many scenes each route gave an answer that is wrong, by what is wrong with it: each scene counts once."""

    def __init__(self) -> None:
        self.scenes: dict[Who, dict[str, set[str]]] = {}

    def add(self, place: Place, told: Disagreement) -> None:
        """Count a disagreement; having no answer, or being ended, is not silent."""
        if told.quantity != "status":
            self.scenes.setdefault((told.engine, told.route), {}).setdefault(told.kind, set()).add(place.key)

    def of(self, engine: str, route: str) -> dict[str, int]:
        """Return {what is wrong: scenes}, most frequent first, with "any" for all of them together."""
        kinds = self.scenes.get((engine, route), {})
        told = sorted(((kind, len(keys)) for kind, keys in kinds.items()), key=lambda item: (-item[1], item[0]))
        return {"any": len(set().union(*kinds.values())), **dict(told)} if kinds else {}
