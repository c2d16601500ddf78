"""The first screen: its sentence, one line per folded section, and the picture of a pose."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

from crosscheck.judge.prices import Offer
from crosscheck.report.first_table import asked, nine_digits
from crosscheck.report.measured import VERDICTS
from crosscheck.report.prices import main_class, scenes_of
from crosscheck.report.svg import Style
from crosscheck.report.wording import count, number
from crosscheck.scenes.names import OURS

Report = Mapping[str, Any]


def answer(report: Report) -> str:
    """Return the sentence that names the cheapest way to nine digits of acceleration; empty without a price list."""
    prices = report["price"] or []
    ordered = nine_digits(prices)
    if not ordered:
        return "No method reaches nine digits of acceleration." if prices else ""
    cheapest_method = _paid(ordered[0])
    engines = [offer for offer in ordered if offer.engine in report["engines"] and offer.engine not in OURS]
    if engines and engines[0] is not ordered[0]:
        cheapest_method += f"; of the engines compared here, with {_paid(engines[0])}"
    scenes = scenes_of(main_class(prices))
    return f"Nine digits of acceleration cost least over one cycle with {cheapest_method} ({scenes})."


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
    unmeasured = "not measured in this run"
    return {
        **{name: line(report[name]) if report[name] else unmeasured for name, line in MEASURED.items()},
        "features": _features_line(report["features"]),
        "disagreements": f"{count(report['new_disagreements'])} new, {count(report['known_disagreements'])} known",
        "digits": "every engine, every decade",
        "agreement": f"{len(report['agreement'])} pairs" if report["agreement"] else "not in the records of this run",
        "newton": _slopes_line(report) if report["slopes"] else unmeasured,
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
    settings, classes = {(r["engine"], r["method"], r["setting"]) for r in rows}, {r["scene_class"] for r in rows}
    timed = [r["spread"] for r in rows if r["microseconds"] is not None]
    once = f"{count(timed.count(None))} of {count(len(timed))} prices by a single call"
    return f"{len(settings)} settings on scenes of {len(classes)} class{'es' * (len(classes) != 1)}; {once}"


def _effects_line(rows: Any) -> str:
    priced = [r for r in rows if r["microseconds"] is not None]
    noise = sum(r["microseconds"] <= (r.get("spread") or 0.0) for r in priced)
    return f"{len(priced)} of {len(rows)} effects priced, {noise} of them within noise"


def _hard_line(rows: Any) -> str:
    counts = [(verdict, sum(r["verdict"] == verdict for r in rows)) for verdict in VERDICTS]
    verdicts = ", ".join(f"{n} {verdict}" for verdict, n in counts if n)
    done, of = asked(rows)
    return f"{done} of {of} cases, the same for all: {verdicts}" if done < of else verdicts


MEASURED = {"price": _price_line, "effects": _effects_line, "hard_cases": _hard_line}


def _slopes_line(report: Report) -> str:
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
