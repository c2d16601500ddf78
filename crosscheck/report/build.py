"""Write `report.json` and `index.html` into the folder of a run. The page holds nothing that report.json does not.

Both are a function of the files in the folder: nothing is solved here, and nothing is computed anew.
"""

from __future__ import annotations

import base64
import hashlib
import json
import math
import sys
from collections import Counter
from collections.abc import Mapping
from pathlib import Path
from typing import Any

from markupsafe import Markup

from crosscheck.judge.prices import STEPS
from crosscheck.judge.records import QUANTITIES as SOLVED
from crosscheck.night.plan import replace_file
from crosscheck.report import front, wording
from crosscheck.report.figures import (
    agreement_matrices,
    digits_figure,
    looks_of,
    newton_figure,
    slopes_figure,
    trends_figure,
)
from crosscheck.report.first_table import first_table
from crosscheck.report.front import first_pose, spoken, spoken_moving
from crosscheck.report.prices import cheapest_tables, effects_figure, iterations_of_notes, price_figure
from crosscheck.report.summary import Summary
from crosscheck.report.svg import power_of_ten

GROUPS = {
    "position": "Position",
    "velocity": "Velocity",
    "acceleration": "Acceleration",
    "jacobian": "The engine's own Jacobian, phi_q",
    "gamma": "The engine's own drift term, gamma",
    "residual": "The engine's own residual, phi",
    "constraint_velocity": "The engine's own constraint velocity, phi_q qd − nu",
}
NO_JOINT = "no joint, drivers alone"
"""What a mechanism is counted as whose bodies are joined by nothing but driven lengths, as Stewart's platform."""
COVERAGE_NAMES = {
    "kind": "Linkage",
    "grashof": "Grashof class",
    "branch": "Branch",
    "distance_decade": "Decade of the drawn distance to a limit position or change point",
    "sigma_min_decade": "Decade of the smallest singular value met",
    "hardness": "How it was drawn",
    "joints": "Joints",
    "driver": "Driver",
    "law": "Motion law",
    "class": "Class",
    "dimension": "Dimension",
    "expected": "Verdict that it was made for",
    "of_features": "Drawn for features of engines",
}


def summarized(folder: Path) -> dict[str, Any]:
    """Return the report of the run in a folder.

    It holds what a night wrote: records.jsonl, run.json, outcome.json, what was measured beside them, and
    disagreements/*.toml. Whatever is missing was not done.
    """
    folder.mkdir(parents=True, exist_ok=True)
    described: dict[str, Any] = plain(Summary(folder).described())
    return described


def build(folder: Path, report: Mapping[str, Any] | None = None) -> Path:
    """Write the report of a folder and its page, and return the page's path: the same files give the same bytes."""
    report = summarized(folder) if report is None else report
    replace_file(folder / "report.json", json.dumps(report, indent=1, allow_nan=False) + "\n")
    page = folder / "index.html"
    replace_file(page, render(report))
    return page


def plain(value: Any) -> Any:
    """Return data as JSON can hold it: NaN as None, infinity as the largest double."""
    if isinstance(value, float):
        if math.isnan(value):
            return None
        return max(-sys.float_info.max, min(value, sys.float_info.max))
    if isinstance(value, Mapping):
        return {str(key): plain(item) for key, item in value.items()}
    if isinstance(value, list | tuple):
        return [plain(item) for item in value]
    return value


def render(report: Mapping[str, Any]) -> str:
    """Return the page for a report; whatever comes from records is escaped."""
    js, series = wording.page_file("page.js"), (report["trends"] or {"series": ()})["series"]
    return wording.filled(
        "page.html.j2",
        report=report,
        js=js,
        css_hash=digest(wording.page_file("page.css")),
        js_hash=digest(js),
        headline=wording.headline(report["verdict"], report["new_disagreements"]),
        answer=front.answer(report),
        first=first_table(report),
        folds=front.folds(report),
        hard=front.hard_matrix(report),
        glance=glance(report),
        coverage=coverage(report),
        together=together(report["together"]),
        certified=any(report["reference"]["largest_certified_radius"].values()),
        cheapest=cheapest_tables(report["price"] or []),
        goals=STEPS,
        matrices=agreement_matrices(report["agreement"]),
        changed=any(one["changes"] for one in series),
        digits_figure=digits_figure(report),
        median_figure=digits_figure(report, "digits_median"),
        newton_figure=newton_figure(report),
        slopes_figure=slopes_figure(report["slopes"]),
        price_figure=price_figure(report["price"] or [], looks_of(report)),
        iterations_figure=iterations_of_notes(report["iterations"]) if report["iterations"] else None,
        effects_figure=effects_figure(report["effects"] or []),
        trends_figure=trends_figure(series),
        **_posed(report),
    )


def _posed(report: Mapping[str, Any]) -> dict[str, Any]:
    """Return the picture that is shown first, and what the script needs for the others."""
    looks, poses = looks_of(report), report["poses"]
    which = first_pose(report, looks)
    names = list(looks)
    marks = [
        {**m, "look": names.index((m["engine"], m["method"])), "summary": spoken(m), "moving": spoken_moving(m)}
        for m in poses["marks"]
    ]
    kept = ("look", "summary", "moving", "scene", "pose", "ghost", "arrows", "cycle")
    data = {**poses, "first": which, "marks": [{key: m[key] for key in kept} for m in marks]}
    colours = [look.colour for look in looks.values()]
    pose = None
    if which is not None:
        mark = marks[which]
        pose = {"mark": mark, "scene": poses["scenes"][mark["scene"]], "colour": colours[mark["look"]]}
    return {"poses": data_block(data), "looks": data_block(colours), "pose": pose}


def data_block(value: Any) -> Markup:
    """Return data as the text of a script element that is none: no character in it can end it."""
    text = json.dumps(value, separators=(",", ":"), allow_nan=False)
    return Markup(text.replace("&", "\\u0026").replace("<", "\\u003c").replace(">", "\\u003e"))


def digest(text: str) -> str:
    """Return what a content policy names an inline style or script by."""
    return "sha256-" + base64.b64encode(hashlib.sha256(text.encode()).digest()).decode()


def glance(report: Mapping[str, Any]) -> list[dict[str, Any]]:
    """Return the table at a glance: by quantity, then engine and method; own rows are the same by every method."""
    groups = []
    for quantity, title in GROUPS.items():
        solved = quantity in SOLVED
        rows = []
        for engine, methods in report["engines"].items():
            for method in methods if solved else list(methods)[:1]:
                cell = methods[method][quantity]
                rows.append({"engine": engine, "method": method if solved else None, "cell": cell})
        absent = [{"engine": name, "reason": reason} for name, reason in report["missing"].items()]
        groups.append({"quantity": quantity, "title": title, "solved": solved, "rows": rows, "absent": absent})
    return groups


def coverage(report: Mapping[str, Any]) -> list[dict[str, Any]]:
    """Return a table of counts with bars per property of the scenes."""
    tables = []
    order = [name for name in dict.fromkeys((*COVERAGE_NAMES, *report["coverage"])) if name in report["coverage"]]
    for name in order:
        counts = report["coverage"][name]
        most = max(counts.values(), default=1)
        rows = [(_value(name, value), n, n / most) for value, n in counts.items()]
        tables.append({"title": COVERAGE_NAMES.get(name, name.replace("_", " ")), "rows": rows})
    return tables


def together(report: Mapping[str, Any]) -> dict[str, Any]:
    """Return how many scenes have which features at once: joints, and driver with hardness, by motion law.

    `unseen` is how likely one more scene's combination is new: the share of those with one of their own (Good, Turing).
    """
    by_joints: dict[str, Counter[str]] = {}
    by_driver: dict[str, Counter[str]] = {}
    for joints, driver, law, _, hardness, _, scenes in report["rows"]:
        by_joints.setdefault(joints or NO_JOINT, Counter())[law] += scenes
        by_driver.setdefault(f"{driver} · {hardness}", Counter())[law] += scenes
    laws = sorted({law for counts in by_joints.values() for law in counts})
    tables = {"by_joints": by_joints, "by_driver": by_driver}
    rows = {name: [(row, [t[row][law] for law in laws]) for row in sorted(t)] for name, t in tables.items()}
    counts = {name: report[name] for name in ("cells", "once", "shortened", "pairs")}
    unseen = report["once"] / max(1, sum(scenes for *_, scenes in report["rows"]))
    return {"laws": laws, **counts, "unseen": unseen, **rows}


def _value(name: str, value: str) -> str:
    if name == "joints" and not value:
        return NO_JOINT
    if not name.endswith("_decade") or not value.lstrip("-").isdigit():
        return {"": "none", "True": "yes", "False": "no"}.get(value, value.replace("_", " "))
    return f"{power_of_ten(int(value))} to {power_of_ten(int(value) + 1)}"
