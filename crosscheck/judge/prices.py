"""Prices as data: rows of the price list and of the ledger of effects, the cheapest method, and whether it repeats."""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import asdict, dataclass, replace
from typing import Any

from pydantic import NonNegativeFloat

from crosscheck.judge.records import Strict
from crosscheck.scenes.names import QUANTITIES
from refkin.motion import Quantity

STEPS = (3, 6, 9, 12, 14)
"""The digits whose cheapest method is named."""
CONTENDS = 3.0
"""A setting that takes so many times as long as the cheapest with as many digits is timed once: it decides nothing."""
POSES = {"one": "one pose now", "cycle": "one cycle", "bulk": "in bulk"}
"""Who asks: somebody who needs one pose at once, one cycle, or a thousand poses and more."""
SUFFIX = {"one": "_one", "cycle": "", "bulk": "_bulk"}
"""What the keys of a row end with, for so many poses."""
LOOSER = 1.0
"""A setting that should be more accurate and has this many digits fewer is reported."""


@dataclass(frozen=True, kw_only=True)
class PriceRow:
    """One method at one setting, for one quantity: over one cycle, for `_one` pose now, in `_bulk`.

    `digits` are the fewest over the times, None where a time has no answer; `digits_attainable` what half an ulp of the
    scene's own numbers leaves if each does most harm, over one cycle, which is no limit. `microseconds` is what one
    configuration costs up to this quantity, None if it was not measured, and `spread` how far the median round lies
    above the least, as a part of it, None if it was timed once. To build the model of one cycle, once, takes
    `microseconds_to_build`. `unasked_bulk` is what a pose may be expected to cost in bulk by a method that there was no
    time to ask, and that may be the cheapest.
    """

    engine: str
    method: str
    setting: str
    quantity: Quantity
    digits: float | None
    digits_attainable: float | None
    microseconds: NonNegativeFloat | None
    spread: NonNegativeFloat | None
    newton_by: str
    digits_one: float | None = None
    microseconds_one: NonNegativeFloat | None = None
    spread_one: NonNegativeFloat | None = None
    digits_bulk: float | None = None
    microseconds_bulk: NonNegativeFloat | None = None
    spread_bulk: NonNegativeFloat | None = None
    microseconds_to_build: NonNegativeFloat | None = None
    unasked_bulk: NonNegativeFloat | None = None
    note: str = ""


@dataclass(frozen=True, kw_only=True)
class EffectRow(Strict):
    """What one effect costs in one engine by one method, and whether it changes anything.

    `microseconds` is what it adds per configuration, negative by noise alone, `without` what one costs without it, and
    `spread` how far the first differs between rounds [microseconds]: what is no larger is noise. It is
    never less than what an effect seems to save. It is `inert` if nothing else changes: no bit in refkin, nothing
    beyond the allowed error in an engine, no status. `largest_change` is the largest relative one of what both answers
    have, `worst` where. None is what could not be measured, or is not known: the engine has no such effect, or no
    answer without it either. An effect that no kinematic scene calls for (`called_for`) is switched on all the same.
    `note` says what was switched on, and why there is no number where there is none.
    """

    engine: str
    method: str
    setting: str
    effect: str
    microseconds: float | None = None
    without: float | None = None
    spread: float | None = None
    inert: bool | None = None
    largest_change: float | None = None
    worst: str = ""
    called_for: bool
    note: str = ""

    @property
    def within_noise(self) -> bool:
        """Whether the price is no larger than what the measurement leaves open."""
        return self.microseconds is not None and self.microseconds <= (self.spread or 0.0)


@dataclass(frozen=True)
class Offer:
    """What a row offers for so many poses, and what it takes to build its model [us]: None if that is no part of it."""

    engine: str
    method: str
    setting: str
    digits: float
    microseconds: float
    spread: float | None
    newton_by: str
    build: float | None = None

    @property
    def name(self) -> tuple[str, str]:
        """Engine and method."""
        return self.engine, self.method

    def differs(self, other: Offer) -> bool:
        """Whether two prices differ by more than the spread of both: by how far either was off in half of its rounds.

        What was timed once has no spread, and is never known to differ: such a call was off by 86 % of its price.
        """
        if self.spread is None or other.spread is None:
            return False
        apart = abs(self.microseconds - other.microseconds)
        return apart > self.spread * self.microseconds + other.spread * other.microseconds


Cheapest = dict[str, dict[str, dict[str, dict[str, Any] | None]]]
"""Poses -> quantity -> digits -> the best offer as plain data, with the `second` best, whether it `differs`, and who is
`unsure`: the cheapest that may be better, for it was called once, or not asked at all."""


def offers(rows: Iterable[Mapping[str, Any]], poses: str, quantity: str, digits: float) -> list[Offer]:
    """Return the best offer of each method with so many digits, the cheapest first.

    Parameters
    ----------
    rows, poses, quantity, digits
        As for `settings`.
    """
    best: dict[tuple[str, str], Offer] = {}
    for offer in settings(rows, poses, quantity, digits):
        best.setdefault(offer.name, offer)
    return list(best.values())


def settings(rows: Iterable[Mapping[str, Any]], poses: str, quantity: str, digits: float) -> list[Offer]:
    """Return what all settings with so many digits offer, the cheapest first.

    A rate comes with the position that it is one of: the fewest digits of all up to a quantity count. So no position
    costs more than one with rates.

    Parameters
    ----------
    rows : iterable of mapping
        Of the price list.
    poses, quantity : str
        Of which times: of one pose, a cycle or in bulk; and the quantity.
    digits : float
        At least so many.
    """
    fewest: dict[tuple[str, ...], list[float | None]] = {}
    offered = list[Offer]()
    upto = QUANTITIES[: QUANTITIES.index(quantity) + 1]
    for row in sorted((row for row in rows if row["quantity"] in upto), key=lambda row: upto.index(row["quantity"])):
        who: dict[str, Any] = {key: row.get(key, "") for key in ("engine", "method", "setting", "newton_by")}
        known = fewest.setdefault(tuple(who.values()), [])
        known.append(row.get(f"digits{SUFFIX[poses]}"))
        price, spread = (row.get(f"{key}{SUFFIX[poses]}") for key in ("microseconds", "spread"))
        there = [x for x in known if x is not None and x >= digits]
        if row["quantity"] == quantity and price is not None and len(there) == len(known):
            build = row.get("microseconds_to_build")
            offered.append(Offer(**who, digits=min(there), microseconds=price, spread=spread, build=build))
    return sorted(offered, key=lambda offer: offer.microseconds)


def cheapest(rows: Sequence[Mapping[str, Any]], steps: Sequence[int] = STEPS) -> Cheapest:
    """Return the cheapest way to so many digits of each quantity, for each number of poses; None if there is none.

    The second best is that of another method: two settings of one method may be the same thing.
    """
    quantities = list(dict.fromkeys(row["quantity"] for row in rows))

    def best(poses: str, quantity: str, step: int) -> dict[str, Any] | None:
        others = not_asked(rows, quantity, step) if poses == "bulk" else []
        return _best(offers(rows, poses, quantity, step), others)

    return {poses: {q: {str(step): best(poses, q, step) for step in steps} for q in quantities} for poses in POSES}


def not_asked(rows: Sequence[Mapping[str, Any]], quantity: str, digits: float) -> list[Offer]:
    """Return what settings that there was no time to ask in bulk may be expected to offer, the cheapest first.

    Parameters
    ----------
    rows, quantity, digits
        As for `settings`.
    """
    unasked = [{**row, "microseconds": row["unasked_bulk"]} for row in rows if row.get("unasked_bulk")]
    return [replace(offer, spread=None) for offer in settings(unasked, "cycle", quantity, digits)]


def _best(offers: Sequence[Offer], unasked: Sequence[Offer]) -> dict[str, Any] | None:
    """Return the best of some offers as data, as `Cheapest` has it."""
    if not offers:
        return None
    may_be = (offer for offer in (*offers[1:], *unasked) if contends(offer, offers[0]))
    second, unsure = offers[1] if len(offers) > 1 else None, next(may_be, None)
    differs = second is not None and offers[0].differs(second)
    shown = {"second": second and asdict(second), "unsure": unsure and asdict(unsure), "differs": differs}
    return {**asdict(offers[0]), **shown}


def contends(offer: Offer, best: Offer) -> bool:
    """Return whether an offer that was called once, or not at all, may be better than the best."""
    return offer.spread is None and offer.microseconds <= CONTENDS * best.microseconds


def may_be_cheapest(rows: Sequence[Mapping[str, Any]]) -> list[tuple[str, str, str]]:
    """Return engine, method and setting of whatever there was no time to ask in bulk, and may be the cheapest there."""
    found: dict[tuple[str, str, str], None] = {}
    for quantity in dict.fromkeys(row["quantity"] for row in rows):
        for step in STEPS:
            best = offers(rows, "bulk", quantity, step)[:1]
            near = (o for o in not_asked(rows, quantity, step) if not best or contends(o, best[0]))
            found.update(dict.fromkeys((o.engine, o.method, o.setting) for o in near))
    return sorted(found)


@dataclass(frozen=True)
class Repeated:
    """How far a price list repeats the winners of another, where that tells them from the second best.

    Of so many `pairs` of a winner and a second the `same` engine and method win again wherever they stand, ahead of the
    others or not; so they do in `same_cells` of the `cells` of the tables. `changed` says of each other cell who wins.
    """

    pairs: int
    same: int
    cells: int
    same_cells: int
    changed: list[str]


def repeated(first: Mapping[str, Cheapest], again: Mapping[str, Cheapest]) -> Repeated:
    """Compare the winners of two price lists, where the first tells a winner from the second best.

    Either is of all and of the engines alone, by the same names. The same two stand in several cells: at several
    digits, and among the engines alone as among all. So they are counted by pairs, too.
    """
    pairs: dict[tuple[Any, ...], list[str]] = {}
    cells = 0
    for who, (poses, quantity, digits), best in ((who, *cell) for who, won in first.items() for cell in _clear(won)):
        now = again[who][poses][quantity][digits]
        was, wins = (", ".join(_winner(one)) if one else "nobody" for one in (best, now))
        places = pairs.setdefault((poses, quantity, _winner(best), _winner(best["second"])), [])
        cells += 1
        if was != wins:
            places.append(f"{POSES[poses]}, {digits} digits of {quantity}: {was} before, {wins} now")
    elsewhere = [place for places in pairs.values() for place in places]
    same = sum(not places for places in pairs.values())
    return Repeated(len(pairs), same, cells, cells - len(elsewhere), list(dict.fromkeys(elsewhere)))


def _clear(cheapest: Cheapest) -> Iterator[tuple[tuple[str, str, str], dict[str, Any]]]:
    """Yield poses, quantity and digits, and the winner there, where it is known to be ahead of all."""
    for poses, of_poses in cheapest.items():
        for quantity, by_digits in of_poses.items():
            for digits, best in by_digits.items():
                if best is not None and best["differs"] and best["unsure"] is None:
                    yield (poses, quantity, digits), best


def _winner(best: Mapping[str, Any]) -> tuple[str, str]:
    return best["engine"], best["method"]


def with_suspicions(rows: Sequence[PriceRow]) -> list[PriceRow]:
    """Return the rows, with a note on each setting that has fewer digits than the looser one before it.

    Digits are measured, never taken from a setting; so one that is not what it says shows here. What lies within a
    digit of the attainable ones is left alone: there, rounding decides.
    """
    noted = list(rows)
    looser: dict[tuple[str, str, str], PriceRow] = {}
    for k, b in enumerate(rows):
        sweep = b.engine, b.method, b.quantity
        a = looser.get(sweep, b)
        looser[sweep] = b
        if a.digits is None or b.digits is None or b.digits_attainable is None:
            continue
        if b.digits < min(a.digits, b.digits_attainable) - LOOSER:
            suspicion = f"fewer digits than at the looser setting {a.setting!r}"
            noted[k] = replace(b, note="; ".join(filter(None, (b.note, suspicion))))
    return noted
