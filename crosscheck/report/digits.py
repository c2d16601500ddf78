"""Digits of agreement over a whole run, as histograms: they merge exactly and take no memory per sample."""

from __future__ import annotations

from collections import Counter
from collections.abc import Mapping
from typing import Any

PERCENT = {"digits_median": 50, "digits_p01": 1}


class Digits:
    """How often each number of digits was met, by decade of sigma_min (None: at no particular distance).

    Digits are kept in whole tenths, rounded down as the records have them, so every quantile is a lower bound of the
    sample's own by less than 0.1.
    """

    def __init__(self) -> None:
        self.by_decade: dict[int | None, Counter[int]] = {}

    def add(self, decade: int | None, histogram: Mapping[int, int]) -> None:
        """Merge a histogram of a record."""
        counts = self.by_decade.setdefault(decade, Counter())
        for tenths, times in histogram.items():
            counts[tenths] += times

    @property
    def samples(self) -> int:
        """How many samples there are."""
        return sum(counts.total() for counts in self.by_decade.values())

    def described(self) -> dict[str, Any]:
        """Return median, 1st percentile and worst over all decades; None where there is no sample."""
        merged: Counter[int] = Counter()
        for counts in self.by_decade.values():
            merged.update(counts)
        return describe(merged)

    def described_by_sigma(self) -> dict[str, dict[str, Any]]:
        """Return the same per decade of sigma_min, with the number of samples, nearest to singular first."""
        decades = sorted(d for d in self.by_decade if d is not None)
        return {str(d): {"samples": self.by_decade[d].total(), **describe(self.by_decade[d])} for d in decades}


def describe(counts: Mapping[int, int]) -> dict[str, float | None]:
    """Return median, 1st percentile and worst of a histogram in tenths of digits."""
    present = sorted(tenths for tenths, times in counts.items() if times)
    worst = present[0] / 10 if present else None
    return {**{name: quantile(counts, percent) for name, percent in PERCENT.items()}, "digits_worst": worst}


def quantile(counts: Mapping[int, int], percent: int) -> float | None:
    """Return the smallest value that at least `percent` of the samples do not exceed.

    The inverse of their distribution: always a value that occurs. In integers, so that no rounding of percent * N / 100
    moves it by one sample.
    """
    rank = max(1, -(-sum(counts.values()) * percent // 100))
    reached = 0
    for tenths in sorted(counts):
        reached += counts[tenths]
        if reached >= rank:
            return tenths / 10
    return None
