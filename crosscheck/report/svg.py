"""A small plot in SVG: axes, lines, markers. Presentation attributes only, so that it survives any content policy.

Everything is built as a tree and escaped when written. Text and axes take the colour of the page; series have one of
the Okabe-Ito colours, a marker and a dash each, so that none of the three alone has to tell them apart.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field
from xml.etree import ElementTree as ET

from markupsafe import Markup

COLOURS = ("currentColor", "#0072B2", "#D55E00", "#009E73", "#CC79A7", "#E69F00", "#56B4E9")
"""Okabe and Ito's, black being the colour of the page's text; without their yellow, which white paper swallows."""
DASHES = ("none", "7 3", "2 2.5", "8 3 2 3", "4 2", "1 2.5", "10 3 2 3 2 3")
MARKERS = ("circle", "square", "triangle", "diamond", "inverted", "plus", "cross")
SUPERSCRIPTS = str.maketrans("-0123456789", "⁻⁰¹²³⁴⁵⁶⁷⁸⁹")


@dataclass(frozen=True)
class Style:
    """How a series looks."""

    colour: str
    dash: str
    marker: str


def style(k: int) -> Style:
    """Return the look of the k-th series; after seven the combinations shift, so that no two of 49 are equal."""
    shift = k // len(COLOURS)
    n = len(COLOURS)
    return Style(COLOURS[k % n], DASHES[(k + shift) % n], MARKERS[(k + shift) % n])


@dataclass(frozen=True)
class Mark:
    """A point of a series that says what it is; `pose` is the number of the picture that belongs to it."""

    x: float
    y: float
    label: str
    pose: int | None = None


def power_of_ten(exponent: int) -> str:
    """Return 10^exponent in typography."""
    return "10" + str(exponent).translate(SUPERSCRIPTS)


@dataclass
class Plot:
    """One panel with a linear scale in both directions: x and y from low to high, y upwards.

    `ident` is unique on the page; the role is "img" for a picture, "group" for one whose marks are read one by one.
    """

    ident: str
    title: str
    description: str
    x: tuple[float, float]
    y: tuple[float, float]
    width: int = 372
    height: int = 268
    left: int = 44
    right: int = 12
    top: int = 30
    bottom: int = 46
    role: str = "img"
    root: ET.Element = field(init=False)

    def __post_init__(self) -> None:
        size = {"viewBox": f"0 0 {self.width} {self.height}", "width": str(self.width), "height": str(self.height)}
        named = {"role": self.role, "aria-labelledby": f"{self.ident}-title {self.ident}-desc"}
        font = {"font-size": "11", "font-family": "system-ui, sans-serif", "fill": "currentColor"}
        self.root = ET.Element("svg", {**size, **named, **font})
        ET.SubElement(self.root, "title", {"id": f"{self.ident}-title"}).text = self.title
        ET.SubElement(self.root, "desc", {"id": f"{self.ident}-desc"}).text = self.description
        self.text(self.left, 16, self.title, anchor="start", weight="600", size="12.5")

    def px(self, x: float) -> float:
        """Return where x is, in pixels."""
        low, high = self.x
        return self.left + (x - low) / (high - low) * (self.width - self.left - self.right)

    def py(self, y: float) -> float:
        """Return where y is, in pixels."""
        low, high = self.y
        return self.height - self.bottom - (y - low) / (high - low) * (self.height - self.top - self.bottom)

    def axes(self, x_ticks: Sequence[tuple[float, str]], y_ticks: Sequence[tuple[float, str]], x_label: str) -> None:
        """Draw grid, ticks and the name of the x axis; the title names y."""
        low, high = self.px(self.x[0]), self.px(self.x[1])
        for y, label in y_ticks:
            self.line([(low, self.py(y)), (high, self.py(y))], stroke="currentColor", opacity="0.14")
            self.text(low - 7, self.py(y) + 3.8, label, anchor="end")
        floor = self.height - self.bottom
        self.line([(low, floor), (high, floor)], stroke="currentColor", opacity="0.6")
        for x, label in x_ticks:
            self.line([(self.px(x), floor), (self.px(x), floor + 4)], stroke="currentColor", opacity="0.6")
            self.text(self.px(x), floor + 17, label)
        self.text((low + high) / 2, self.height - 9, x_label)

    def series(self, points: Sequence[tuple[float, float]], look: Style) -> None:
        """Draw a line with markers through (x, y) points."""
        for x, y in self._through(points, look):
            _marker(self.root, x, y, look)

    def _through(self, points: Sequence[tuple[float, float]], look: Style) -> list[tuple[float, float]]:
        """Draw a line through (x, y) points, and return where they are, in pixels."""
        placed = [(self.px(x), self.py(y)) for x, y in points]
        if len(placed) > 1:
            self.line(placed, stroke=look.colour, stroke_dasharray=look.dash, stroke_width="1.5")
        return placed

    def marks(self, points: Sequence[Mark], look: Style) -> None:
        """Draw a line with marks that can be pointed at, focused and read aloud through them."""
        placed = self._through([(m.x, m.y) for m in points], look)
        for m, (x, y) in zip(points, placed, strict=True):
            first = not any("data-mark" in element.attrib for element in self.root)
            attributes = {"role": "img", "aria-label": m.label, "tabindex": "0" if first else "-1", "data-mark": ""}
            attributes |= {"data-pose": str(m.pose)} if m.pose is not None else {}
            group = ET.SubElement(self.root, "g", attributes)
            ET.SubElement(group, "title").text = m.label
            around = {"cx": f"{x:.1f}", "cy": f"{y:.1f}", "r": "8", "fill": "transparent"}
            ET.SubElement(group, "circle", around)
            _marker(group, x, y, look)

    def band(self, x: Sequence[float], low: Sequence[float], high: Sequence[float]) -> None:
        """Shade what lies between two lines."""
        there = [(self.px(a), self.py(b)) for a, b in zip(x, high, strict=True)]
        back = [(self.px(a), self.py(b)) for a, b in zip(x, low, strict=True)][::-1]
        points = " ".join(f"{a:.1f},{b:.1f}" for a, b in there + back)
        ET.SubElement(self.root, "polygon", {"points": points, "fill": "currentColor", "fill-opacity": "0.1"})

    def line(self, placed: Sequence[tuple[float, float]], **attributes: str) -> None:
        """Draw a polyline through pixels."""
        drawn = {name.replace("_", "-"): value for name, value in attributes.items()}
        points = " ".join(f"{x:.1f},{y:.1f}" for x, y in placed)
        ET.SubElement(self.root, "polyline", {"points": points, "fill": "none", "stroke-width": "1", **drawn})

    def text(
        self, x: float, y: float, text: str, anchor: str = "middle", weight: str = "400", size: str = "11"
    ) -> None:
        """Write text at pixels."""
        attributes = {"x": f"{x:.1f}", "y": f"{y:.1f}", "text-anchor": anchor, "font-weight": weight, "font-size": size}
        ET.SubElement(self.root, "text", attributes).text = text

    def markup(self) -> Markup:
        """Return the drawing as text that a page can hold."""
        return Markup(ET.tostring(self.root, encoding="unicode"))


def _marker(parent: ET.Element, x: float, y: float, look: Style) -> None:
    """Draw a marker at pixels."""
    r = 3.6
    h = 0.87 * r
    lozenge = f"l{r:.1f} {1.25 * r:.1f}l{-r:.1f} {1.25 * r:.1f}l{-r:.1f} {-1.25 * r:.1f}z"
    paths = {
        "square": f"M{x - h:.1f} {y - h:.1f}h{2 * h:.1f}v{2 * h:.1f}h{-2 * h:.1f}z",
        "triangle": f"M{x:.1f} {y - r * 1.15:.1f}l{r * 1.1:.1f} {r * 1.95:.1f}h{-2.2 * r:.1f}z",
        "inverted": f"M{x:.1f} {y + r * 1.15:.1f}l{r * 1.1:.1f} {-r * 1.95:.1f}h{-2.2 * r:.1f}z",
        "diamond": f"M{x:.1f} {y - 1.25 * r:.1f}{lozenge}",
        "plus": f"M{x - r:.1f} {y:.1f}h{2 * r:.1f}M{x:.1f} {y - r:.1f}v{2 * r:.1f}",
        "cross": f"M{x - h:.1f} {y - h:.1f}l{2 * h:.1f} {2 * h:.1f}M{x - h:.1f} {y + h:.1f}l{2 * h:.1f} {-2 * h:.1f}",
    }
    if look.marker == "circle":
        at = {"cx": f"{x:.1f}", "cy": f"{y:.1f}", "r": f"{r:.1f}", "fill": look.colour}
        ET.SubElement(parent, "circle", at)
        return
    strokes = {"stroke": look.colour, "stroke-width": "1.8"} if look.marker in ("plus", "cross") else {}
    ET.SubElement(parent, "path", {"d": paths[look.marker], "fill": "none" if strokes else look.colour, **strokes})


def swatch(look: Style, line: bool = True) -> Markup:
    """Return the sample of a series for a legend."""
    root = ET.Element("svg", {"viewBox": "0 0 34 12", "width": "34", "height": "12", "aria-hidden": "true"})
    if line:
        dash = {"stroke-dasharray": look.dash, "stroke-width": "1.5"}
        ET.SubElement(root, "polyline", {"points": "1,6 33,6", "fill": "none", "stroke": look.colour, **dash})
    _marker(root, 17, 6, look)
    return Markup(ET.tostring(root, encoding="unicode"))


BAND = Markup(
    '<svg viewBox="0 0 34 12" width="34" height="12" aria-hidden="true">'
    '<rect width="34" height="12" fill="currentColor" fill-opacity="0.14" /></svg>'
)
"""The sample of a shaded band for a legend."""
