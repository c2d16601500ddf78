"""Numbers as a page shows them, and pages filled with them. A missing answer is written "no answer", never a blank."""

from __future__ import annotations

import math
import re
import sys
from collections.abc import Mapping
from functools import cache
from importlib.resources import files
from typing import Any

from jinja2 import Environment, PackageLoader, StrictUndefined
from markupsafe import Markup

from crosscheck.report.svg import SUPERSCRIPTS

NO_ANSWER = Markup('<span class="none">no answer</span>')
THIN = "\u202f"
MINUS = "\u2212"
SEEDING = {"initial_guess": "an estimate", "configuration": "the pose", "none": "nothing"}


def digits(value: float | None) -> str:
    """Return digits to a tenth, as they are kept."""
    return NO_ANSWER if value is None else f"{value:.1f}".replace("-", MINUS)


def count(value: int | None) -> str:
    """Return a whole number in groups of three."""
    return NO_ANSWER if value is None else f"{value:,}".replace(",", THIN)


def number(value: float | None, figures: int = 2) -> str:
    """Return a number to a few figures, with a power of ten where it is very large or small."""
    if value is None or math.isnan(value):
        return NO_ANSWER
    if abs(value) >= sys.float_info.max:
        return "unbounded"
    if value == 0:
        return "0"
    exponent = math.floor(math.log10(abs(float(f"{value:.{figures - 1}e}"))))
    if -4 <= exponent < 5:
        return f"{value:,.{max(0, figures - 1 - exponent)}f}".replace(",", THIN)
    mantissa = value / 10.0**exponent if exponent > -300 else value * 1e300 / 10.0 ** (exponent + 300)
    return f"{mantissa:.{figures - 1}f} × 10{str(exponent).translate(SUPERSCRIPTS)}"


def ratio(value: float | None) -> str:
    """Return error / allowed to two figures, or more where rounding would move it across 1."""
    if value is not None and value != 1.0 and abs(value - 1.0) < 0.1:
        return next(
            (t for f in range(2, 17) if ((float(t := f"{value:.{f}f}")) > 1.0) == (value > 1.0) and float(t) != 1.0),
            str(value),
        )
    return number(value)


def seeding(value: str | None) -> str:
    """Return in words what a method starts from."""
    return NO_ANSWER if value is None else SEEDING.get(value, value)


def whose(text: str | None, quantity: str) -> str:
    """Return who did something for one quantity, in short: the table of methods has the whole text.

    A method may tell by quantity, as in "position: exudyn; velocity, acceleration: adapter (numpy)".
    """
    if text is None:
        return NO_ANSWER
    parts = [part.partition(": ") for part in text.split("; ")]
    by_quantity = {name.strip(): who for names, colon, who in parts if colon for name in names.split(",")}
    bare = re.sub(r" \([^)]*\)", "", by_quantity.get(quantity, text))
    clause = re.split("[,;]", bare)[0]
    return clause if clause == bare else f"{clause} …"


def sample(place: Mapping[str, Any]) -> str:
    """Return the component and time of a number, the time to six figures; report.json has all digits."""
    if place["component"] is None:
        return str(place.get("message") or "not in the record")
    return str(place["component"]) if place["time"] is None else f"{place['component']} at t = {place['time']:.6g}"


def known(value: Any) -> Any:
    """Return what is known about the run itself."""
    return Markup('<span class="none">not known</span>') if value is None else value


def headline(verdict: str, new: int) -> str:
    """Return the verdict as the page's heading."""
    if verdict == "new disagreements":
        return f"{count(new)} new disagreement{'s' * (new != 1)}"
    return {"infrastructure": "Infrastructure failure"}.get(verdict, verdict.capitalize())


def filled(template: str, **values: Any) -> str:
    """Return a page; whatever is put into it is escaped, but for our own files."""
    return _environment().get_template(template).render(css=page_file("page.css"), **values)


def page_file(name: str) -> Markup:
    """Return the text of a file of ours that stands in pages as it is: nothing of a record is in it."""
    return Markup(files("crosscheck.report").joinpath("page", name).read_text("utf-8"))


@cache
def _environment() -> Environment:
    environment = Environment(
        loader=PackageLoader("crosscheck.report", "page"),
        autoescape=True,
        undefined=StrictUndefined,
        trim_blocks=True,
        lstrip_blocks=True,
    )
    shown = (digits, count, number, ratio, sample, seeding, whose, known)
    environment.filters.update({show.__name__: show for show in shown})
    return environment
