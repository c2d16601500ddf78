"""The first screen: one row per engine and method, one line per folded section, and the picture of a pose."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

from crosscheck.judge.prices import Offer, offers
from crosscheck.judge.records import QUANTITIES as SOLVED
from crosscheck.report.measured import VERDICTS
from crosscheck.report.prices import main_class
from crosscheck.report.svg import Style
from crosscheck.report.wording import count, number
from crosscheck.scenes.names import OURS

Report = Mapping[str, Any]
GOAL = 9
"""Digits of acceleration whose price stands in the first table."""
ANSWERED = ("correct", "warned", "wrong")
SERIOUS = (None, "", "defect")
"""Classes of wrong answers that nothing excuses: none, or a defect of the engine."""


def first_table(report: Report) -> list[dict[str, Any]]:
    """Return a row per engine and method: digits, price, what was wrong without a word.

    The price is that of the row's own method over one cycle: what is cheaper is no price of these digits. After
    them come the methods of shipped defaults that no drawn scene is sent through, as users run them: their digits are
    the most that the price list has of them.
    """
    prices = report["price"] or []
    paid = {offer.name: offer.microseconds for offer in _offers(prices)}
    priced = {(row["engine"], row["method"]) for row in prices}
    of_methods = {(row["engine"], row["method"]): row for row in report["methods"]}
    rows = []
    for engine, methods in report["engines"].items():
        for method, quantities in methods.items():
            made = of_methods.get((engine, method), {})
            silent, seriousness = _silent(report, engine, method, made)
            rows.append(
                {
                    "engine": engine,
                    "method": method,
                    "cells": [_cell(quantities[quantity]) for quantity in SOLVED],
                    "price": paid.get((engine, method)) if prices else made.get("microseconds_median"),
                    "priced": (engine, method) in priced or not prices,
                    "silent": silent,
                    "silent_class": seriousness,
                    "asked": True,
                    "scenes": made.get("scenes", 0),
                    "newton_by": quantities["position"]["newton_by"],
                }
            )
        rows += _as_shipped(report, engine, list(methods))
    return rows


def _as_shipped(report: Report, engine: str, methods: Sequence[str]) -> list[dict[str, Any]]:
    """Return the rows of an engine's methods that were asked hard cases, and no drawn scene."""
    asked = dict.fromkeys(row["method"] for row in report["hard_cases"] or () if row["engine"] == engine)
    rows = []
    for method in (name for name in asked if name not in methods):
        named = (method, f"{method}, as shipped")
        priced = [r for r in report["price"] or () if r["engine"] == engine and r["method"] in named]
        best = [max((r["digits"] for r in priced if r["quantity"] == q and r["digits"]), default=None) for q in SOLVED]
        silent, seriousness = _silent(report, engine, method, {})
        shown = priced[0]["method"] if priced else method
        row = {"engine": engine, "method": shown, "cells": [{"best": digits, "samples": 0} for digits in best]}
        said = {"silent": silent, "silent_class": seriousness, "scenes": 1, "asked": False}
        newton_by = priced[0].get("newton_by") if priced else None
        rows.append({**row, **said, "price": None, "priced": bool(priced), "newton_by": newton_by})
    return rows


def _offers(prices: Sequence[Mapping[str, Any]]) -> list[Offer]:
    """Return the cheapest setting of each method with nine digits of acceleration over one cycle, cheapest first."""
    of_class = [row for row in prices if row["scene_class"] == main_class(prices)]
    return offers(of_class, "cycle", "acceleration", GOAL)


def _cell(cell: Mapping[str, Any]) -> dict[str, Any]:
    beyond = cell["worst_over_allowed"] is not None and cell["worst_over_allowed"] > 1.0
    seriousness = ("gap" if cell["known_gaps"] and not cell["failures"] else "bad") if beyond else ""
    return {
        "median": cell["digits_median"],
        "worst": cell["digits_worst"],
        "samples": cell["samples"],
        "class": seriousness,
        "best": None,
    }


def _silent(report: Report, engine: str, method: str, made: Mapping[str, Any]) -> tuple[str, str]:
    """Return where a method was wrong and said nothing, and whether a known gap or a finding accounts for all of it.

    Hard cases are counted by kind: those of one kind often begin alike, and what is wrong there is wrong in each.
    """
    kinds = {kind: n for kind, n in made.get("silent", {}).items() if kind != "any"}
    parts = [f"{kind}: {count(n)} scene{'s' * (n > 1)}" for kind, n in kinds.items()]
    cases = [row for row in report["hard_cases"] or () if (row["engine"], row["method"]) == (engine, method)]
    wrong = [row for row in cases if row["verdict"] == "wrong"]
    if wrong:
        answered = len({row["case"] for row in cases if row["verdict"] in ANSWERED})
        classes = ", ".join(dict.fromkeys(row["class"] or "not explained" for row in wrong))
        asked, of = _asked(cases)
        few = f", {asked} of {of} cases asked" if asked < of else ""
        kinds_wrong = len({row["case"] for row in wrong})
        parts.append(f"{kinds_wrong} of {answered} kinds of hard cases that it answers{few} ({classes})")
    new = any(not d["known"] for d in report["disagreements"] if (d["engine"], d["method"]) == (engine, method))
    return "; ".join(parts), "bad" if new or any(row["class"] in SERIOUS for row in wrong) else "gap"


def answer(report: Report) -> str:
    """Return the sentence that names the cheapest way to nine digits of acceleration; empty without a price list."""
    prices = report["price"] or []
    ordered = _offers(prices)
    if not ordered:
        return "No method reaches nine digits of acceleration." if prices else ""
    cheapest_method = _paid(ordered[0])
    engines = [offer for offer in ordered if offer.engine in report["engines"] and offer.engine not in OURS]
    if engines and engines[0] is not ordered[0]:
        cheapest_method += f"; of the engines compared here, with {_paid(engines[0])}"
    return (
        f"Nine digits of acceleration cost least over one cycle with {cheapest_method} ({main_class(prices)} scenes)."
    )


def _paid(offer: Offer) -> str:
    return f"{offer.engine} · {offer.method}: {number(offer.microseconds)} µs"


def hard_matrix(report: Report) -> dict[str, Any]:
    """Return case x engine and method -> verdict; where a case has several for one method, the worst, and how many.

    A refusal where there is no assembly is "rightly refused".
    """
    rows = report["hard_cases"] or []
    names = list(dict.fromkeys((r["engine"], r["method"]) for r in rows))
    met: dict[tuple[str, tuple[str, str]], list[str]] = {}
    for r in rows:
        rightly = r["verdict"] == "refused" and (r["note"] or "").startswith("rightly")
        met.setdefault((r["case"], (r["engine"], r["method"])), []).append(
            "rightly refused" if rightly else r["verdict"]
        )
    lines = [
        (case, [_worst(met[case, name]) if (case, name) in met else None for name in names])
        for case in dict.fromkeys(r["case"] for r in rows)
    ]
    return {"names": [" · ".join(name) for name in names], "lines": lines}


def _worst(verdicts: Sequence[str]) -> tuple[str, str]:
    """Return the worst of several verdicts, and of how many it is one: "" if of all."""
    worst = max(verdicts, key=(VERDICTS[0], "rightly refused", *VERDICTS[1:]).index)
    count = verdicts.count(worst)
    return worst, f"{count} of {len(verdicts)}" if count < len(verdicts) else ""


def folds(report: Report) -> dict[str, str]:
    """Return what each folded section says without being opened."""
    gaps, refusals, trends = report["known_gaps"], report["refusals"], report["trends"]
    nights = len(trends["nights"]) if trends else 0
    changed = sum(len(series["changes"]) for series in trends["series"]) if trends else 0
    compared, kept = "the golden set was not compared in this run", "no history was kept with this run"
    if golden := report["golden"]:
        worse = len(golden["worse"])
        found = f"{worse} numbers worse" if worse else "nothing worse"
        compared = f"golden set of {golden['cases']} scenes: {found}"
    if nights:
        kept = f"{nights} night{'s' * (nights != 1)}, {changed} change{'s' * (changed != 1)} of level"
    return {
        "price": _price_line(report["price"]),
        "effects": _effects_line(report["effects"]),
        "hard_cases": _hard_line(report["hard_cases"]),
        "features": _features_line(report["features"]),
        "disagreements": f"{count(report['new_disagreements'])} new, {count(report['known_disagreements'])} known",
        "digits": "every engine, every decade",
        "agreement": f"{len(report['agreement'])} pairs" if report["agreement"] else "not in the records of this run",
        "newton": _slopes_line(report),
        "glance": "percentiles, error / allowed, who solved what, own rows",
        "gaps": f"{len(gaps)} in the table, {sum(g['disagreements'] > 0 for g in gaps)} met",
        "trends": f"{compared}; {kept}",
        "coverage": f"{count(report['scenes'])} scenes, by kind, class, branch and distance",
        "refusals": f"{len(refusals)} kinds" if refusals else "none",
        "documents": (report["documents"] or {"closing": "not recomputed in this run"})["closing"],
        "method": "what is true, what is allowed, how it was timed, how to draw it again",
    }


def _features_line(rows: Any) -> str:
    if not rows:
        return "not asked in this run"
    wrong, new = sum(r["wrong"] > 0 for r in rows), sum(r["new"] > 0 for r in rows)
    return f"{len(rows)} asked, {wrong} of them wrong, {new} of these new"


def _price_line(rows: Any) -> str:
    if not rows:
        return "not measured in this run"
    settings, classes = {(r["engine"], r["method"], r["setting"]) for r in rows}, {r["scene_class"] for r in rows}
    timed = [r["spread"] for r in rows if r["microseconds"] is not None]
    once = f"{timed.count(None)} of {len(timed)} prices by a single call"
    return f"{len(settings)} settings on scenes of {len(classes)} classes; {once}"


def _effects_line(rows: Any) -> str:
    if not rows:
        return "not measured in this run"
    priced = [r for r in rows if r["microseconds"] is not None]
    noise = sum(r["microseconds"] <= (r.get("spread") or 0.0) for r in priced)
    return f"{len(priced)} of {len(rows)} effects priced, {noise} of them within noise"


def _hard_line(rows: Any) -> str:
    if not rows:
        return "not measured in this run"
    counts = [(verdict, sum(r["verdict"] == verdict for r in rows)) for verdict in VERDICTS]
    verdicts = ", ".join(f"{n} {verdict}" for verdict, n in counts if n)
    asked, of = _asked(rows)
    return f"{asked} of {of} cases, the same for all: {verdicts}" if asked < of else verdicts


def _asked(rows: Sequence[Mapping[str, Any]]) -> tuple[int, int]:
    """Return of how many hard cases there are rows, and how many cases there are."""
    return len({(r["case"], r.get("distance")) for r in rows}), max(r.get("of", 0) for r in rows)


def _slopes_line(report: Report) -> str:
    if not report["slopes"]:
        return "not measured in this run"
    fitted = [f"{line['fitted']:.2f}" for line in report["slopes"] if line["fitted"] is not None]
    orders = [h["last_order"] for h in report["newton_histories"] if h["last_order"] is not None]
    least, most = (f"{order(orders):.2f}" for order in (min, max)) if orders else ("", "")
    newton = f"Newton's last order {least}{f' to {most}' * (most != least)}; " if orders else ""
    return f"{newton}fitted slopes {', '.join(fitted)}"


def first_pose(report: Mapping[str, Any], looks: Mapping[tuple[str, str], Style]) -> int | None:
    """Return the number of the mark that is shown first: of the magnified positions the one farthest from singular.

    Near a singular pose all links lie in one line, which is a poor picture to begin with; so is an engine in the colour
    of the reference.
    """
    marks = report["poses"]["marks"]
    magnified = [k for k, m in enumerate(marks) if m["ghost"] and m["factor"] > 1.0]
    own = {k for k in magnified if looks[marks[k]["engine"], marks[k]["method"]].colour != "currentColor"}
    return max(magnified, key=lambda k: (k in own, marks[k]["decade"], -k), default=0 if marks else None)


def spoken(mark: Mapping[str, Any]) -> str:
    """Return what a picture shows, in words."""
    factor = "to scale" if mark["factor"] == 1.0 else f"× {number(mark['factor'], 1)}"
    return (
        f"{mark['engine']} · {mark['method']}, {mark['quantity']}: {mark['digits']:.1f} digits"
        f" at t = {mark['time']:.4g} s; error drawn {factor}"
    )


def spoken_moving(mark: Mapping[str, Any]) -> str:
    """Return what a moving picture shows, in words."""
    who = f"{mark['engine']} · {mark['method']}"
    if mark["cycle"] is None:
        return f"{who}: the reference over the cycle"
    factor = mark["cycle"]["factor"]
    return f"{who} over the cycle; error drawn {'to scale' if factor == 1.0 else f'× {number(factor, 1)}'}"
