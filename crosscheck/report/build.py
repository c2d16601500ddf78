"""Write `report.json` and `index.html` into the folder of a run. The page holds nothing that report.json does not."""

from __future__ import annotations

import base64
import hashlib
import json
import math
import os
import sys
from collections.abc import Mapping, Sequence
from functools import cache
from importlib.resources import files
from pathlib import Path
from typing import Any

from jinja2 import Environment, PackageLoader, StrictUndefined
from markupsafe import Markup

from crosscheck.documents.page import digits_by_iteration, documents, newton_histories, slopes
from crosscheck.judge import known_gaps
from crosscheck.judge.known_gaps import Gap
from crosscheck.night.history import HistoryError, append
from crosscheck.night.history import trends as trends_in
from crosscheck.report import front, wording
from crosscheck.report.figures import digits_figure, looks_of, newton_figure
from crosscheck.report.figures_more import agreement_matrices, slopes_figure, trends_figure
from crosscheck.report.posed import first_pose, pose_picture, spoken, spoken_moving
from crosscheck.report.prices import GOALS, cheapest_tables, effects_figure, iterations_of_notes, price_figure
from crosscheck.report.summary import SOLVED, Ended, Summary
from crosscheck.report.svg import bar, power_of_ten

MOST_TRENDS = 24
"""Series whose course is kept in a report, those that changed first; the history has all."""
GROUPS = {
    "position": "Position",
    "velocity": "Velocity",
    "acceleration": "Acceleration",
    "jacobian": "The engine's own Jacobian, phi_q",
    "gamma": "The engine's own drift term, gamma",
    "residual": "The engine's own residual, phi",
    "constraint_velocity": "The engine's own constraint velocity, phi_q qd − nu",
}
HARD_CASES = "hard_cases.json"
"""The file in a run's folder that holds the rows of `crosscheck.measure.hard_table.hard_case_rows`."""
COVERAGE_NAMES = {
    "kind": "Linkage",
    "grashof": "Grashof class",
    "branch": "Branch",
    "distance_decade": "Decade of the drawn distance to a limit position or change point",
    "sigma_min_decade": "Decade of the smallest singular value met",
    "hardness": "How it was drawn",
}


def build(
    folder: Path,
    outcome: Ended | None = None,
    *,
    required: Sequence[str] | None = None,
    gaps: Sequence[Gap] | None = None,
    history: Path | None = None,
) -> Path:
    """Write `report.json` and `index.html` for the run in a folder, and return the path of the page.

    Parameters
    ----------
    folder : Path
        Holds records.jsonl and run.json (both may be missing: then nothing ran), and disagreements/*.toml.
    outcome : crosscheck.night.campaign.Outcome, optional
        How the run ended. Its new disagreements and failures count in addition to those that the records hold.
    required : sequence of str, optional
        Engines without which the night fails; what run.json says by default.
    gaps : sequence of Gap, optional
        The table of known gaps by default.
    history : Path, optional
        The file that nights are kept in: this one is added to it, and its trends stand on the page.

    Returns
    -------
    Path
        index.html. The same records give the same bytes.
    """
    folder.mkdir(parents=True, exist_ok=True)
    summary = Summary(folder, known_gaps.read() if gaps is None else gaps, outcome)
    computed = {
        "newton_histories": newton_histories(),
        "slopes": slopes(),
        "documents": documents(),
        "iterations": digits_by_iteration(),
    }
    described, trends = _remembered(summary, required, history)
    report = plain({**described, **computed, "trends": trends})
    _replace(folder / "report.json", json.dumps(report, indent=1, allow_nan=False) + "\n")
    page = folder / "index.html"
    _replace(page, render(report))
    return page


def _remembered(
    summary: Summary, required: Sequence[str] | None, path: Path | None
) -> tuple[dict[str, Any], dict[str, Any] | None]:
    """Return the report, and the trends of the history that it was added to; a history that fails fails the night."""
    described = summary.described(required)
    if path is None:
        return described, None
    try:
        append(path, plain(described))
        if not path.is_file():
            return described, None
        found = trends_in(path)
        series = [one for one in found["series"] if one["nights"][-1] == found["nights"][-1]]
        shown = series[:MOST_TRENDS]
        return described, {**found, "series": shown, "not_shown": len(series) - len(shown)}
    except (HistoryError, OSError) as error:
        summary.failures.append(f"the history cannot be kept: {error}")
        return summary.described(required), None


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
    css, js = (files("crosscheck.report").joinpath("page", f"page.{kind}").read_text("utf-8") for kind in ("css", "js"))
    return (
        _environment()
        .get_template("page.html.j2")
        .render(
            report=report,
            css=Markup(css),  # our own files: nothing of a record is in them
            js=Markup(js),
            css_hash=digest(css),
            js_hash=digest(js),
            headline=wording.headline(report["verdict"], report["new_disagreements"]),
            answer=front.answer(report),
            first=front.first_table(report),
            folds=front.folds(report),
            hard=front.hard_matrix(report),
            glance=glance(report),
            coverage=coverage(report),
            certified=any(report["reference"]["largest_certified_radius"].values()),
            cheapest=cheapest_tables(report["price"] or []),
            goals=GOALS,
            matrices=agreement_matrices(report["agreement"]),
            changed=any(series["changes"] for series in (report["trends"] or {"series": ()})["series"]),
            **_figures(report),
            **_posed(report),
        )
    )


@cache
def _environment() -> Environment:
    environment = Environment(
        loader=PackageLoader("crosscheck.report", "page"),
        autoescape=True,
        undefined=StrictUndefined,
        trim_blocks=True,
        lstrip_blocks=True,
    )
    shown = ("digits", "count", "number", "ratio", "sample", "seeding", "whose", "words", "known")
    environment.filters.update({name: getattr(wording, name) for name in shown})
    return environment


def _figures(report: Mapping[str, Any]) -> dict[str, Any]:
    return {
        "digits_figure": digits_figure(report),
        "median_figure": digits_figure(report, "digits_median"),
        "newton_figure": newton_figure(report),
        "slopes_figure": slopes_figure(report["slopes"]),
        "price_figure": price_figure(report["price"] or [], looks_of(report)),
        "iterations_figure": iterations_of_notes(report["iterations"]),
        "effects_figure": effects_figure(report["effects"] or []),
        "trends_figure": trends_figure((report["trends"] or {"series": ()})["series"]),
    }


def _posed(report: Mapping[str, Any]) -> dict[str, Any]:
    """Return the picture that is shown first, and what the script needs for the others."""
    looks, poses = looks_of(report), report["poses"]
    which = first_pose(report, looks)
    names = list(looks)
    marks = [
        {**m, "look": names.index((m["engine"], m["route"])), "told": spoken(m), "moving": spoken_moving(m)}
        for m in poses["marks"]
    ]
    kept = ("look", "told", "moving", "scene", "pose", "ghost", "arrows", "cycle")
    data = {**poses, "first": which, "marks": [{key: m[key] for key in kept} for m in marks]}
    mark = None if which is None else marks[which]
    scene = None if mark is None else poses["scenes"][mark["scene"]]
    return {
        "poses": data_block(data),
        "looks": data_block([look.colour for look in looks.values()]),
        "pose": None if which is None else pose_picture(report, which, looks),
        "poses_told": mark["told"] if mark else "",
        "pose_scene": f"{scene['name']} (record {scene['key']})" if scene else "",
    }


def data_block(value: Any) -> Markup:
    """Return data as the text of a script element that is none: no character in it can end it."""
    text = json.dumps(value, separators=(",", ":"), allow_nan=False)
    return Markup(text.replace("&", "\\u0026").replace("<", "\\u003c").replace(">", "\\u003e"))


def digest(text: str) -> str:
    """Return what a content policy names an inline style or script by."""
    return "sha256-" + base64.b64encode(hashlib.sha256(text.encode()).digest()).decode()


def glance(report: Mapping[str, Any]) -> list[dict[str, Any]]:
    """Return the table at a glance: by quantity, then engine and route; own rows are the same by every route."""
    groups = []
    for quantity, title in GROUPS.items():
        solved = quantity in SOLVED
        rows = []
        for engine, routes in report["engines"].items():
            for route in routes if solved else list(routes)[:1]:
                cell = routes[route][quantity]
                rows.append({"engine": engine, "route": route if solved else None, "cell": cell})
        absent = [{"engine": name, "reason": reason} for name, reason in report["missing"].items()]
        groups.append({"quantity": quantity, "title": title, "solved": solved, "rows": rows, "absent": absent})
    return groups


def coverage(report: Mapping[str, Any]) -> list[dict[str, Any]]:
    """Return a table of counts with bars per property of the scenes."""
    tables = []
    order = [*(name for name in COVERAGE_NAMES if name in report["coverage"])]
    order += [name for name in report["coverage"] if name not in COVERAGE_NAMES]
    for name in order:
        counts = report["coverage"][name]
        most = max(counts.values(), default=1)
        rows = [(_value(name, value), n, bar(n / most)) for value, n in counts.items()]
        tables.append({"title": COVERAGE_NAMES.get(name, name.replace("_", " ")), "rows": rows})
    return tables


def _value(name: str, value: str) -> str:
    if not name.endswith("_decade") or not value.lstrip("-").isdigit():
        return value.replace("_", " ")
    return f"{power_of_ten(int(value))} to {power_of_ten(int(value) + 1)}"


def _replace(path: Path, text: str) -> None:
    """Write a file so that a reader sees the old or the new one, never a part."""
    part = path.with_name(path.name + ".part")
    part.write_text(text, encoding="utf-8")
    os.replace(part, path)
