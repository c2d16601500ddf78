"""Write `report.json` and `index.html` into the folder of a run. The page holds nothing that report.json does not."""

from __future__ import annotations

import json
import math
import os
import sys
from collections.abc import Mapping, Sequence
from importlib.resources import files
from pathlib import Path
from typing import Any

from jinja2 import Environment, StrictUndefined
from markupsafe import Markup

from crosscheck import known_gaps
from crosscheck.known_gaps import Gap
from crosscheck.report import wording
from crosscheck.report.documents import documents
from crosscheck.report.figures import digits_figure, newton_figure
from crosscheck.report.histories import newton_histories
from crosscheck.report.summary import SOLVED, Ended, Summary
from crosscheck.report.svg import bar, power_of_ten

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
"""The file in a run's folder that holds the rows of `crosscheck.hard_cases.hard_case_rows`."""
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
) -> Path:
    """Write `report.json` and `index.html` for the run in a folder, and return the path of the page.

    Parameters
    ----------
    folder : Path
        Holds records.jsonl and run.json (both may be missing: then nothing ran), and disagreements/*.toml.
    outcome : crosscheck.campaign.Outcome, optional
        How the run ended. Its new disagreements and failures count in addition to those that the records hold.
    required : sequence of str, optional
        Engines without which the night fails; what run.json says by default.
    gaps : sequence of Gap, optional
        The table of known gaps by default.

    Returns
    -------
    Path
        index.html. The same records give the same bytes.
    """
    folder.mkdir(parents=True, exist_ok=True)
    summary = Summary(folder, known_gaps.read() if gaps is None else gaps, outcome)
    more = {"newton_histories": newton_histories(), "documents": documents(), "hard_cases": hard_case_rows(folder)}
    report = plain({**summary.described(required), **more})
    _replace(folder / "report.json", json.dumps(report, indent=1, allow_nan=False) + "\n")
    page = folder / "index.html"
    _replace(page, render(report))
    return page


def hard_case_rows(folder: Path) -> list[dict[str, Any]]:
    """Return the rows of the hard cases that a run wrote to its folder; none if it had no time for them."""
    path = folder / HARD_CASES
    rows: list[dict[str, Any]] = json.loads(path.read_text(encoding="utf-8")) if path.exists() else []
    return rows


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
    environment = Environment(autoescape=True, undefined=StrictUndefined, trim_blocks=True, lstrip_blocks=True)
    environment.filters.update(
        {
            name: getattr(wording, name)
            for name in ("digits", "count", "number", "ratio", "sample", "seeding", "whose", "words", "known")
        }
    )
    source = files("crosscheck.report")
    template = environment.from_string(source.joinpath("page.html.j2").read_text(encoding="utf-8"))
    css = source.joinpath("page.css").read_text(encoding="utf-8")
    return template.render(
        report=report,
        css=Markup(css),  # our own file: nothing of a record is in it
        headline=wording.headline(report["verdict"], report["new_disagreements"]),
        glance=glance(report),
        digits_figure=digits_figure(report),
        newton_figure=newton_figure(report),
        coverage=coverage(report),
        certified=any(report["reference"]["largest_certified_radius"].values()),
    )


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
