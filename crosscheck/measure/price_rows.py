"""The price list as data: rows, the cheapest way to so many digits, and what settings give away about themselves."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import asdict, dataclass, replace
from itertools import groupby, pairwise
from typing import Any

STEPS = (3, 6, 9, 12, 14)
"""The digits whose cheapest way is told."""
LOOSER = 1.0
"""A setting that should be more accurate and has this many digits fewer is told of."""
OURS = ("refkin", "scipy")
"""Producers that are no engine: they solve the reference's equations."""
YARDSTICK = ("refkin", "Newton, analytic Jacobian", "to round-off")
"""The row whose price is the unit of what is tracked over nights."""


@dataclass(frozen=True, kw_only=True)
class Row:
    """One route at one setting, for one quantity.

    Attributes
    ----------
    digits, digits_attainable : float or None
        The fewest over the times of the scene; None where a time has no answer.
    microseconds : float or None
        What one configuration costs up to this quantity; None if it was not measured.
    spread : float or None
        How far the median round lies above the least, as a part of it; None if it was timed once.
    newton_by : str
        Who ran Newton.
    """

    engine: str
    route: str
    knob: str
    quantity: str
    digits: float | None
    digits_attainable: float | None
    microseconds: float | None
    spread: float | None
    newton_by: str
    note: str = ""

    def to_json(self) -> dict[str, Any]:
        """Return the row as plain data."""
        return asdict(self)


def cheapest(rows: Iterable[Row], steps: Sequence[int] = STEPS) -> dict[str, dict[str, dict[str, Any] | None]]:
    """Return quantity -> digits -> the row that costs least among those with so many digits; None if there is none."""
    found: dict[str, dict[str, dict[str, Any] | None]] = {}
    for row in rows:
        for_quantity = found.setdefault(row.quantity, {str(step): None for step in steps})
        if row.digits is None or row.microseconds is None:
            continue
        for step in steps:
            best = for_quantity[str(step)]
            if row.digits >= step and (best is None or row.microseconds < best["microseconds"]):
                keys = ("engine", "route", "knob", "digits", "microseconds", "newton_by")
                for_quantity[str(step)] = {key: getattr(row, key) for key in keys}
    return found


def ratios(rows: Sequence[Row]) -> dict[tuple[str, str, str, str], float]:
    """Return (engine, route, knob, quantity) -> its price in units of refkin's Newton to round-off.

    Microseconds are those of a machine and its load; ratios are what is compared over nights.
    """
    unit = {r.quantity: r.microseconds for r in rows if (r.engine, r.route, r.knob) == YARDSTICK and r.microseconds}
    return {
        (r.engine, r.route, r.knob, r.quantity): r.microseconds / unit[r.quantity]
        for r in rows
        if r.microseconds is not None and r.quantity in unit
    }


def with_suspicions(rows: Sequence[Row]) -> list[Row]:
    """Return the rows, with a note on each setting that has fewer digits than the looser one before it.

    Digits are measured, never taken from a knob; so a knob that is not what it says shows here. What lies within a
    digit of the attainable ones is left alone: there, rounding decides.
    """
    noted = list(rows)

    def of_sweep(k: int) -> tuple[str, str, str]:
        return rows[k].engine, rows[k].route, rows[k].quantity

    for _, places in groupby(sorted(range(len(rows)), key=lambda k: (of_sweep(k), k)), key=of_sweep):
        for before, after in pairwise(places):
            a, b = rows[before], rows[after]
            if a.digits is None or b.digits is None or b.digits_attainable is None:
                continue
            if b.digits < min(a.digits, b.digits_attainable) - LOOSER:
                told = f"fewer digits than at the looser setting {a.knob!r}"
                noted[after] = replace(b, note="; ".join(filter(None, (b.note, told))))
    return noted
