"""One small page with a scene's price list: the cheapest ways, work-precision diagrams, and every row as a table."""

from __future__ import annotations

from collections.abc import Mapping
from importlib.resources import files
from typing import Any

from jinja2 import Environment, StrictUndefined
from markupsafe import Markup

from crosscheck.judge.prices import POSES, STEPS
from crosscheck.report.price_figures import legend, work_precision


def page(result: Mapping[str, Any]) -> str:
    """Return the page of a price list (`price_shown.to_json`); whatever comes from a scene is escaped."""
    environment = Environment(autoescape=True, undefined=StrictUndefined, trim_blocks=True, lstrip_blocks=True)
    text = files("crosscheck.commands").joinpath("price_page.html.j2").read_text(encoding="utf-8")
    template = environment.from_string(text)
    css = files("crosscheck.report").joinpath("page/page.css").read_text(encoding="utf-8")
    rows = result["rows"]
    quantities = list(dict.fromkeys(row["quantity"] for row in rows))
    return template.render(
        result=result,
        poses=POSES,
        css=Markup(css),  # our own file: nothing of a scene is in it
        steps=[str(step) for step in STEPS],
        panels=[work_precision(rows, quantity) for quantity in quantities],
        legend=legend(rows),
    )
