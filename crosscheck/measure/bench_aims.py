"""What this project aims at, and whether a run reached it: ratios of rows of one run, and what a first use costs.

A row that is not ranked counts for nothing, on either side.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from typing import Any

from crosscheck.engines.methods import OURS

SWEEP, MANY, ANY, LARGE = "sweep-1000", "many-10000x360", "many-10000x360-any", "chain-10000"
RSSR = "rssr-1000"
SAMPLES, CERTIFICATE = (("refkin-lanes", "all times at once", setting) for setting in ("no evidence", "certificate"))
SPARSE, DENSE = ("refkin-lanes", "sparse", ""), ("c", "dense Newton", "")
BODIES = 2 * 10_000 + 1
PLANE, SPACE = 3 * 3, 3 * 7
"""Coordinates of a four-bar and of an RSSR."""
Key = tuple[str, str, str]
"""Engine, method, setting."""


class Times:
    """The times of the ranked rows of a run [ns], by workload and method, and the seconds of a first use."""

    def __init__(self, results: Mapping[str, Any]) -> None:
        rows = [row for row in results["rows"] if row["ranked"]]
        self._of: dict[tuple[str, Key], float] = {}
        self._computes: dict[tuple[str, Key], int] = {}
        # Where a method is measured for positions alone as well, its price is that of all it has.
        for row in sorted(rows, key=lambda row: len(row["computes"])):
            at = row["workload"], key_of(row)
            self._of[at] = float(row["nanoseconds_per_configuration"])
            self._computes[at] = len(row["computes"])
        self.first_use: Mapping[str, float] = results.get("first_use", {})

    def __call__(self, work: str, method: Key) -> float:
        """Return a time; KeyError if there is no such row, or it is not ranked."""
        return self._of[work, method]

    def engine(self, work: str, beside: Key) -> float:
        """Return the time of the fastest method of an engine that computes no less than another method."""
        asked = self._computes[work, beside]
        engines = [at for at, n in self._computes.items() if at[0] == work and at[1][0] not in OURS and n >= asked]
        if not engines:
            raise KeyError(work)
        return min(self._of[at] for at in engines)


def key_of(row: Mapping[str, Any]) -> Key:
    """Return engine, method and setting of a row."""
    return row["engine"], row["method"], row["setting"]


@dataclass(frozen=True)
class Aim:
    """A number that is to be at most, or at least, so much; `workloads` are those whose rows it needs."""

    name: str
    workloads: tuple[str, ...]
    value: Callable[[Times], float]
    at_most: float = math.inf
    at_least: float = -math.inf


def _certificate(t: Times, work: str) -> float:
    """Return what the certificate of a pose adds to its price [ns]."""
    return t(work, CERTIFICATE) - t(work, SAMPLES)


def _quotient(name: str, work: str, over: Key, under: Key, **bound: float) -> Aim:
    """Return the aim for the time of one method of a workload over that of another."""
    return Aim(name, (work,), lambda t: t(work, over) / t(work, under), **bound)


def _beside_engines(linkage: str, work: str) -> Aim:
    return Aim(
        f"one {linkage}: fastest engine / fast path",
        (work,),
        lambda t: t.engine(work, SAMPLES) / t(work, SAMPLES),
        at_least=10.0,
    )


AIMS = (
    _quotient("one four-bar: fast path / dense C", SWEEP, SAMPLES, DENSE, at_most=0.6),
    _beside_engines("four-bar", SWEEP),
    _quotient("one four-bar: certificates / the fast path's solve", SWEEP, CERTIFICATE, SAMPLES, at_most=5.0),
    Aim("10,000 four-bars, 2 % margin: fast path [ns]", (MANY,), lambda t: t(MANY, SAMPLES), at_most=200.0),
    _quotient("10,000 four-bars, 2 % margin: dense C / fast path", MANY, DENSE, SAMPLES, at_least=4.0),
    Aim("10,000 four-bars, no margin: fast path [ns]", (ANY,), lambda t: t(ANY, SAMPLES), at_most=550.0),
    Aim(
        "chains: growth exponent of a Newton iteration, 100 to 10,000 loops",
        ("chain-100", LARGE),
        lambda t: math.log10(t(LARGE, SPARSE) / t("chain-100", SPARSE)) / 2.0,
        at_most=1.1,
    ),
    Aim(
        "chain of 10,000 loops: a Newton iteration [us per body]",
        (LARGE,),
        lambda t: t(LARGE, SPARSE) / BODIES / 1e3,
        at_most=3.0,
    ),
    Aim("one RSSR: fast path [us]", (RSSR,), lambda t: t(RSSR, SAMPLES) / 1e3, at_most=6.0),
    _beside_engines("RSSR", RSSR),
    Aim(
        "certificate of a pose, per coordinate: RSSR / four-bar",
        (SWEEP, RSSR),
        lambda t: _certificate(t, RSSR) / SPACE / (_certificate(t, SWEEP) / PLANE),
        at_most=5.0,
    ),
    Aim("first use: the program of a four-bar [s]", (SWEEP,), lambda t: t.first_use["tape_seconds"], at_most=0.03),
    Aim(
        "first use: import of refkin beyond NumPy's and SciPy's [s]",
        (SWEEP,),
        lambda t: t.first_use["import_seconds"],
        at_most=0.3,
    ),
)


def reached(results: Mapping[str, Any]) -> list[dict[str, Any]]:
    """Return what a run says of each aim: name, bound, measured number, whether it was reached.

    An aim is left out where the run did not ask for its workloads; it is missed where a row is absent or not ranked.
    """
    times = Times(results)
    known = {row["workload"] for row in (*results["rows"], *results["absent"])}
    verdicts = []
    for aim in AIMS:
        if not known.issuperset(aim.workloads):
            continue
        try:
            value: float | None = aim.value(times)
        except KeyError:
            value = None
        bound = {"at_most": aim.at_most} if math.isfinite(aim.at_most) else {"at_least": aim.at_least}
        good = value is not None and aim.at_least <= value <= aim.at_most
        verdicts.append({"aim": aim.name, **bound, "measured": value, "reached": good})
    return verdicts
