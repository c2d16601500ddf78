"""Counts per engine, method and quantity; digits are counted in histograms, which merge exactly."""

from __future__ import annotations

import math
from collections import Counter
from collections.abc import Mapping
from dataclasses import asdict, dataclass, field
from typing import Any

from crosscheck.judge.records import Answer, At, Histogram, MethodData

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
        self.by_decade.setdefault(decade, Counter()).update(histogram)

    @property
    def samples(self) -> int:
        """How many samples there are."""
        return sum(counts.total() for counts in self.by_decade.values())

    def described(self) -> dict[str, Any]:
        """Return median, 1st percentile and worst over all decades; None where there is no sample."""
        return describe(sum(self.by_decade.values(), Counter()))

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
    """Return the digits that at least `percent` of the samples in tenths do not exceed."""
    tenths = reached(counts, percent)
    return None if tenths is None else tenths / 10


def reached(counts: Mapping[int, int], percent: int) -> int | None:
    """Return the smallest value that at least `percent` of the samples do not exceed.

    The inverse of their distribution: always a value that occurs. In integers, so that no rounding of percent * N / 100
    moves it by one sample.
    """
    rank, so_far = max(1, -(-sum(counts.values()) * percent // 100)), 0
    for value in sorted(counts):
        so_far += counts[value]
        if so_far >= rank:
            return value
    return None


@dataclass(frozen=True)
class RecordLine:
    """Where a number was met: record, scene, line of records.jsonl."""

    key: str
    scene: str
    line: int


@dataclass(frozen=True)
class WorstSample:
    """The largest error / allowed and the sample it was met at: a coordinate and a time, or a row."""

    ratio: float
    place: RecordLine
    at: At | None

    def described(self) -> dict[str, Any]:
        """Return it as plain data."""
        return {"ratio": self.ratio, **vars(self.place), **sample(self.at)}


def sample(at: At | None) -> dict[str, Any]:
    """Return where a number was met as plain data: its component, and its time if it has one."""
    return {"component": None, "time": None} if at is None else asdict(at)


def worse(so_far: WorstSample | None, ratio: float | None, place: RecordLine, at: At | None) -> WorstSample | None:
    """Return the larger of two ratios with its sample; NaN and None are no ratios.

    Parameters
    ----------
    so_far : WorstSample or None
    ratio : float or None
        The other one.
    place, at : RecordLine, At or None
        Where that was met.
    """
    if ratio is None or math.isnan(ratio) or (so_far is not None and ratio <= so_far.ratio):
        return so_far
    return WorstSample(ratio, place, at)


@dataclass
class Cell:
    """One quantity by one method of one engine.

    It was compared in so many scenes, in `compared` configurations of them against a budget (position, velocity,
    acceleration); in `failures` of the scenes disagrees what no known gap accounts for, in `known_gaps` what one does.
    """

    digits: Digits = field(default_factory=Digits)
    scenes: int = 0
    compared: int = 0
    failures: int = 0
    known_gaps: int = 0
    worst: WorstSample | None = None
    least: tuple[float, RecordLine] | None = None

    def add(self, histograms: Mapping[int, Histogram] | Mapping[None, Histogram], place: RecordLine) -> None:
        """Count one scene's digits."""
        self.scenes += 1
        for decade, histogram in histograms.items():
            self.digits.add(decade, histogram)
        least = min((tenths for h in histograms.values() for tenths, times in h.items() if times), default=None)
        if least is not None and (self.least is None or least / 10 < self.least[0]):
            self.least = (least / 10, place)

    def meet(self, ratio: float | None, place: RecordLine, at: At | None) -> None:
        """Keep a ratio if it is the largest so far."""
        self.worst = worse(self.worst, ratio, place, at)

    def described(self) -> dict[str, Any]:
        """Return it as plain data."""
        least = self.least
        return {
            **self.digits.described(),
            "worst_over_allowed": self.worst.ratio if self.worst else None,
            "scenes": self.scenes,
            "samples": self.digits.samples,
            "compared": self.compared,
            "failures": self.failures,
            "known_gaps": self.known_gaps,
            "worst": self.worst.described() if self.worst else None,
            "digits_worst_at": {"digits": least[0], **vars(least[1])} if least else None,
            "digits_by_sigma": self.digits.described_by_sigma(),
        }


TIME_BINS = 100
"""Bins per decade of the histogram of times: a median is right to 1.2 %."""


@dataclass
class MethodTotals:
    """What one method of one engine did over the run, whatever the quantity."""

    made: MethodData
    version: str
    scenes: int = 0
    times: int = 0
    compared: int = 0
    unanswered: int = 0
    unanswered_by_sigma: Counter[int] = field(default_factory=Counter)
    seconds: float = 0.0
    granted: dict[str, float] = field(default_factory=dict)
    bins: Counter[int] = field(default_factory=Counter)

    def add(self, answer: Answer, sigma_decade: int | None) -> None:
        """Count one scene's answer; `sigma_decade` is that of the scene's smallest sigma_min."""
        self.scenes += 1
        self.times += answer.times
        self.compared += answer.compared
        self.unanswered += answer.missing
        if answer.missing and sigma_decade is not None:
            self.unanswered_by_sigma[sigma_decade] += answer.missing
        self.seconds += answer.seconds
        for term, size in answer.granted.items():
            self.granted[term] = max(self.granted.get(term, 0.0), size)
        if answer.times and answer.seconds > 0:
            microseconds = 1e6 * answer.seconds / answer.times
            self.bins[math.floor(TIME_BINS * math.log10(microseconds))] += 1

    @property
    def microseconds(self) -> dict[str, float | None]:
        """Mean over all configurations; median over scenes of the scene's mean."""
        mean = 1e6 * self.seconds / self.times if self.times else None
        middle = reached(self.bins, 50)
        median = None if middle is None else float(10 ** ((middle + 0.5) / TIME_BINS))
        return {"microseconds_mean": mean, "microseconds_median": median}

    def described(self) -> dict[str, Any]:
        """Return it as plain data."""
        return {
            "version": self.version,
            **{key: value for key, value in vars(self.made).items() if key != "name"},
            "scenes": self.scenes,
            "configurations": self.times,
            "compared": self.compared,
            "unanswered": self.unanswered,
            "granted": dict(self.granted),
            "not_compared": self.times - self.compared - self.unanswered,
            "unanswered_by_sigma": {str(d): n for d, n in sorted(self.unanswered_by_sigma.items())},
            **self.microseconds,
        }
