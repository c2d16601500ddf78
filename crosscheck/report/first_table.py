"""The first table of the page: digits on the same scenes, their price, and where a method was wrong without a word.

Blame is never of a part of the scenes: where a method was wrong counts all that it was asked.
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from typing import Any

from crosscheck.judge.known_gaps import HardOutcome, unexplained
from crosscheck.judge.prices import SUFFIX, Offer, offers
from crosscheck.judge.records import QUANTITIES as SOLVED
from crosscheck.report.prices import main_class
from crosscheck.report.wording import count

Report = Mapping[str, Any]
Row = dict[str, Any]
GOAL = 9
"""Digits of acceleration whose price stands in the first table."""
ANSWERED = ("correct", "warned", "wrong")
SERIOUS = (None, "contract violated")
"""Classes of wrong answers that nothing excuses: none, or that the engine does not do what it documents."""
NOBODY: Mapping[str, Any] = {"scenes": 0, "poses": 0, "apart": [], "engines": {}}
"""What methods have in common that answered no scene."""
HALF = "half of all poses / the worst pose"


def first_table(report: Report) -> list[dict[str, Any]]:
    """Return blocks of rows, each under a `head` that says of what its digits are.

    First the methods that are compared on the same scenes (`crosscheck.report.alike`), then those of shipped defaults
    that no drawn scene is sent through, as users run them, and those of engines that answered none. Last what answered
    fewer scenes: with the best of the first block on the scenes that all of these have answered.
    """
    first, *others = report["same_scenes"] or [NOBODY]
    apart = [tuple(who) for block in others for who in block["apart"]]
    named = [(engine, method) for engine, methods in report["engines"].items() for method in methods]
    of_first = [who for who in named if who not in apart]
    alike = f"{HALF}, on the {_size(first)} that all of these answered; rates where these are called for"
    blocks = [{"head": alike if first["scenes"] else "", "rows": _rows(report, first, of_first)}]
    most = ": the most digits of any setting on any scene of the price list" if report["price"] else ""
    answering = {row["engine"] for row in report["methods"] if row["scenes"]}
    for head, at_all in (("as users run it, and asked other scenes", True), ("no answer but to other scenes", False)):
        engines = [engine for engine in report["engines"] if (engine in answering) is at_all]
        if others_asked := [row for engine in engines for row in _as_shipped(report, engine, sent=not at_all)]:
            blocks.append({"head": f"{head}{most}", "rows": others_asked})
    for block in others:
        rows = _rows(report, block, [who for who in named if list(who) in block["apart"]])
        head = f"{HALF}, on the {_size(block)} that these and all of the first block answered"
        blocks.append({"head": head, "rows": [*rows, _best(block)]})
    return blocks


def _size(block: Mapping[str, Any]) -> str:
    scenes, poses = block["scenes"], block["poses"]
    return f"{count(scenes)} scene{'s' * (scenes != 1)} ({count(poses)} pose{'s' * (poses != 1)})"


def _rows(report: Report, block: Mapping[str, Any], named: Iterable[tuple[str, str]]) -> list[Row]:
    """Return a row per engine and method with its digits on the scenes of a block.

    The price is that of the row's own method over one cycle: what is cheaper is no price of these digits. `once` says
    that it is of a single call.
    """
    prices = report["price"] or []
    paid = {offer.name: offer for offer in nine_digits(prices)}
    priced = {(row["engine"], row["method"]) for row in prices}
    of_engine = {offer.engine: offer for offer in reversed(paid.values())}  # the cheapest is first among the paid
    of_methods = {(row["engine"], row["method"]): row for row in report["methods"]}
    rows = []
    for engine, method in named:
        made, quantities = of_methods.get((engine, method), {}), report["engines"][engine][method]
        digits = block["engines"].get(engine, {}).get(method, {})
        offer = paid.get((engine, method))
        rows.append(
            {
                "engine": engine,
                "method": method,
                "cells": [_cell(digits.get(quantity), quantities[quantity]) for quantity in SOLVED],
                "price": (offer and offer.microseconds) if prices else made.get("microseconds_median"),
                "once": offer is not None and offer.spread is None,
                "priced": (engine, method) in priced or not prices,
                "instead": of_engine.get(engine),
                **_silent(report, engine, method, made),
                "asked": True,
                "scenes": made.get("scenes", 0),
                "fewer": _fewer(block, digits),
                "newton_by": quantities["position"]["newton_by"],
            }
        )
    return rows


def _fewer(block: Mapping[str, Any], digits: Mapping[str, Any]) -> int:
    """Return at how many poses fewer than another of its block a method was compared, in any quantity that it has."""
    most = {q: max(c[q]["samples"] for of in block["engines"].values() for c in of.values()) for q in digits}
    return max((most[q] - cell["samples"] for q, cell in digits.items() if cell["samples"]), default=0)


def _as_shipped(report: Report, engine: str, *, sent: bool) -> list[Row]:
    """Return the rows of an engine's methods that were asked hard cases, and of drawn scenes none, or answered none."""
    asked_hard = dict.fromkeys(row["method"] for row in report["hard_cases"] or () if row["engine"] == engine)
    rows = []
    for method in (name for name in asked_hard if name not in report["engines"][engine]):
        named = (method, f"{method}, as shipped")
        priced = [r for r in report["price"] or () if r["engine"] == engine and r["method"] in named]
        digits = [(r["quantity"], d) for r in priced for of in SUFFIX.values() if (d := r.get(f"digits{of}"))]
        best = [max((d for quantity, d in digits if quantity == q), default=None) for q in SOLVED]
        shown = priced[0]["method"] if priced else method
        row = {"engine": engine, "method": shown, "cells": [_shown(None, None, 0) | {"best": d} for d in best]}
        said = {**_silent(report, engine, method, {"scenes": 1}), "scenes": 0, "fewer": 0, "asked": sent}
        newton_by = priced[0].get("newton_by") if priced else None
        rows.append({**row, **said, "price": None, "priced": bool(priced), "instead": None, "newton_by": newton_by})
    return rows


def _best(block: Mapping[str, Any]) -> Row:
    """Return the row of the most digits that any method of the first block has on the scenes of another."""
    cells = [
        cells
        for engine, methods in block["engines"].items()
        for method, cells in methods.items()
        if [engine, method] not in block["apart"]
    ]
    most = []
    for quantity in SOLVED:
        of = [cell[quantity] for cell in cells if cell[quantity]["samples"]]
        median, worst = (max((c[key] for c in of), default=None) for key in ("digits_median", "digits_worst"))
        most.append(_shown(median, worst, len(of)))
    return {"best_of": len(cells), "cells": most}


def nine_digits(prices: Sequence[Mapping[str, Any]]) -> list[Offer]:
    """Return the cheapest setting of each method with nine digits of acceleration over one cycle, cheapest first."""
    of_class = [row for row in prices if row["scene_class"] == main_class(prices)]
    return offers(of_class, "cycle", "acceleration", GOAL)


def _cell(digits: Mapping[str, Any] | None, cell: Mapping[str, Any]) -> dict[str, Any]:
    """Return the digits on common scenes; their class says what there is on any scene of the method."""
    beyond = cell["worst_over_allowed"] is not None and cell["worst_over_allowed"] > 1.0
    seriousness = ("gap" if cell["known_gaps"] and not cell["failures"] else "bad") if beyond else ""
    found = digits or {"digits_median": None, "digits_worst": None, "samples": 0}
    median, worst, samples = (found[key] for key in ("digits_median", "digits_worst", "samples"))
    elsewhere = not samples and cell["samples"] > 0
    return _shown(median, worst, samples) | {"class": seriousness, "elsewhere": elsewhere}


def _shown(median: float | None, worst: float | None, samples: int) -> dict[str, Any]:
    none: dict[str, Any] = {"class": "", "elsewhere": False, "best": None}
    return {"median": median, "worst": worst, "samples": samples, **none}


def _silent(report: Report, engine: str, method: str, made: Mapping[str, Any]) -> dict[str, str]:
    """Return where a method was wrong and said nothing, whether a known gap or a finding accounts for all of it.

    Hard cases are counted by kind: those of one kind often begin alike, and what is wrong there is wrong in each. Where
    it was nowhere wrong, `nowhere` says at how many of the hard cases that was looked for.
    """
    kinds = {kind: n for kind, n in made.get("silent", {}).items() if kind != "any"}
    parts = [f"{kind}: {count(n)} scene{'s' * (n > 1)}" for kind, n in kinds.items()]
    cases = [row for row in report["hard_cases"] or () if (row["engine"], row["method"]) == (engine, method)]
    wrong = [row for row in cases if row["verdict"] == "wrong"]
    if wrong:
        answered = len({row["case"] for row in cases if row["verdict"] in ANSWERED})
        classes = ", ".join(dict.fromkeys(row["class"] or "not explained" for row in wrong))
        done, of = asked(cases)
        few = f", {done} of {of} cases asked" if done < of else ""
        kinds_wrong = len({row["case"] for row in wrong})
        parts.append(f"{kinds_wrong} of {answered} kinds of hard cases that it answers{few} ({classes})")
    ended = {row["case"] for row in cases if row["verdict"] in (HardOutcome.CRASH, HardOutcome.HANG)}
    if ended:
        parts.append(f"no answer, as it crashed or hung, at {len(ended)} kinds of hard cases")
    new = any(not d["known"] for d in report["disagreements"] if (d["engine"], d["method"]) == (engine, method))
    seriousness = "bad" if new or unexplained(cases) or any(row["class"] in SERIOUS for row in wrong) else "gap"
    nowhere = _nowhere(report, cases) if made.get("scenes") else "no answer in any scene"
    return {"silent": "; ".join(parts), "silent_class": seriousness, "nowhere": nowhere}


def _nowhere(report: Report, cases: Sequence[Mapping[str, Any]]) -> str:
    """Return in what a method was nowhere wrong: of hard cases a short night asks few, and some methods none."""
    if not report["hard_cases"]:
        return "nowhere; hard cases were not asked"
    if not cases:
        return "nowhere; not asked at hard cases"
    done, of = asked(cases)
    return f"nowhere; asked at {done} of {of} hard cases" if done < of else "nowhere"


def asked(rows: Sequence[Mapping[str, Any]]) -> tuple[int, int]:
    """Return of how many hard cases there are rows, and how many cases there are."""
    return len({(r["case"], r.get("distance")) for r in rows}), max(r.get("of", 0) for r in rows)
