"""A pose or a motion as one SVG file: no scripts, no fonts, nothing to load."""

from __future__ import annotations

import math
import re
from collections.abc import Sequence
from xml.etree import ElementTree as ET

import numpy as np

from refkin.joints import PLANE
from refkin.output.drawing import Drawing, DrawnLink, Part
from refkin.output.spatial import Shape

NO_XML = re.compile("[\x00-\x08\x0b\x0c\x0e-\x1f\ufffe\uffff]")
"""Characters that a name may have and XML may not, in no spelling."""

WIDTH, MARGIN, TALLEST = 640, 36, 720
"""Pixels: of the picture, around the mechanism, and of the height at most."""
FRAMES = 90
"""An animation shows at most this many poses; a viewer turns the parts evenly between them."""
LINE = {"fill": "none", "stroke-linecap": "round", "stroke-linejoin": "round"}
STYLES: dict[str, dict[str, str]] = {
    "ground": {"fill": "#555", "stroke": "#555"},
    "guide": {**LINE, "stroke": "#999", "stroke-width": "1.5", "stroke-dasharray": "6 4"},
    "axis": {**LINE, "stroke": "#E69F00", "stroke-width": "5"},
    "body": {**LINE, "fill": "#0072B233", "stroke": "#0072B2", "stroke-width": "5"},
    "slider": {**LINE, "fill": "#0072B255", "stroke": "#0072B2", "stroke-width": "3"},
    "link": {**LINE, "stroke": "#56B4E9", "stroke-width": "3"},
    "wheel": {**LINE, "fill": "#E69F0022", "stroke": "#E69F00", "stroke-width": "2"},
    "pin": {"fill": "#fff", "stroke": "#222", "stroke-width": "1.5"},
    "curve": {**LINE, "stroke": "#CC79A7", "stroke-width": "1.5"},
    "velocity": {**LINE, "stroke": "#009E73", "stroke-width": "2"},
    "acceleration": {**LINE, "stroke": "#D55E00", "stroke-width": "2"},
}
"""How a role looks; the colours are Okabe and Ito's, which everybody can tell apart."""


class _Sheet:
    """The page: how metres become pixels, and the elements on it."""

    def __init__(self, drawing: Drawing, title: str, arrows: Sequence[Shape] = ()) -> None:
        low, high = drawing.box_with(arrows)
        wide, tall = np.maximum(high - low, 1e-300)
        self.scale = min((WIDTH - 2 * MARGIN) / wide, (TALLEST - 2 * MARGIN) / tall)
        self.left = float((low[0] + high[0]) / 2) - WIDTH / 2 / self.scale
        self.top = float(high[1]) + MARGIN / self.scale
        height = math.ceil(min(tall * self.scale + 2 * MARGIN, TALLEST))
        view = {"viewBox": f"0 0 {WIDTH} {height}", "width": str(WIDTH), "height": str(height)}
        self.root = ET.Element("svg", {"xmlns": "http://www.w3.org/2000/svg", "role": "img", **view})
        ET.SubElement(self.root, "title").text = title
        ET.SubElement(self.root, "rect", {"width": "100%", "height": "100%", "fill": "#fff"})

    def point(self, x: float, y: float) -> tuple[float, float]:
        """Return where a point [m] is on the page: pictures grow downwards."""
        return (x - self.left) * self.scale, (self.top - y) * self.scale

    def add(self, shape: Shape, parent: ET.Element, local: bool = False) -> None:
        """Put a shape on the page, or in the frame of a part, whose origin is moved by its parent."""
        where = (lambda x, y: (x * self.scale, -y * self.scale)) if local else self.point
        points = [where(float(x), float(y)) for x, y in np.asarray(shape.points).T]
        style = STYLES[shape.role]
        if shape.role in ("velocity", "acceleration"):
            (x0, y0), (x1, y1) = points
            angle = math.atan2(y1 - y0, x1 - x0)
            barbs = [(x1 - 8 * math.cos(angle + turn), y1 - 8 * math.sin(angle + turn)) for turn in (-0.4, 0.4)]
            head = "".join(f"M{x1:.2f} {y1:.2f}L{x:.2f} {y:.2f}" for x, y in barbs)
            ET.SubElement(parent, "path", {"d": f"M{x0:.2f} {y0:.2f}L{x1:.2f} {y1:.2f}{head}", **style})
        elif shape.role == "ground":
            (x, y) = points[0]
            ET.SubElement(parent, "path", {"d": f"M{x:.2f} {y:.2f}l-9 14h18z", **style})
        elif len(points) == 1:
            radius = shape.radius * self.scale if shape.radius else 4.0
            x, y = points[0]
            ET.SubElement(parent, "circle", {"cx": f"{x:.2f}", "cy": f"{y:.2f}", "r": f"{radius:.2f}", **style})
        else:
            closed = "z" if shape.role in ("slider", "wheel") or (shape.role == "body" and len(points) > 2) else ""
            path = "M" + "L".join(f"{x:.2f} {y:.2f}" for x, y in points) + closed
            ET.SubElement(parent, "path", {"d": path, **style})

    def text(self) -> str:
        """Return the file."""
        ET.indent(self.root)
        return NO_XML.sub("\ufffd", ET.tostring(self.root, encoding="unicode")) + "\n"


def still(drawing: Drawing, k: int = 0, rates: Sequence[str] = ()) -> str:
    """Return one pose as SVG, with the curves of the wanted points.

    Parameters
    ----------
    drawing : Drawing
    k : int
        Number of the time among those that are shown.
    rates : sequence of {"velocity", "acceleration"}
        What is shown by arrows.
    """
    arrows = [arrow for rate in rates for arrow in drawing.arrows(k, rate)]
    sheet = _Sheet(drawing, f"{drawing.scene.name or 'mechanism'} at t = {drawing.t[k]:g} s", arrows)
    for curve in drawing.curves:
        sheet.add(curve, sheet.root)
    for part in drawing.parts:
        group = ET.SubElement(sheet.root, "g")
        ET.SubElement(group, "title").text = part.name
        for shape in part.at(k):
            sheet.add(shape, group)
    for arrow in arrows:
        sheet.add(arrow, sheet.root)
    return sheet.text()


def animated(drawing: Drawing, seconds: float = 4.0) -> str:
    """Return the motion as SVG that plays by itself, over and over, `seconds` long [s]."""
    sheet = _Sheet(drawing, f"{drawing.scene.name or 'mechanism'} in motion")
    frames = frames_of(drawing)
    keys = (drawing.t[frames] - drawing.t[0]) / max(drawing.t[-1] - drawing.t[0], 1e-300)
    timing = {"dur": f"{seconds:g}s", "repeatCount": "indefinite", "keyTimes": ";".join(f"{k:.5f}" for k in keys)}
    for curve in drawing.curves:
        sheet.add(curve, sheet.root)
    for part in drawing.parts:
        if isinstance(part, Part) and len(part.poses) == PLANE.width and len(frames) > 1:
            inner = _moving(part, sheet, frames, timing)
            for shape in part.shapes:
                sheet.add(shape, inner, local=True)
        else:
            _reshaped(part, sheet, frames, timing)
    return sheet.text()


def _moving(part: Part, sheet: _Sheet, frames: Sequence[int], timing: dict[str, str]) -> ET.Element:
    places = [sheet.point(float(x), float(y)) for x, y in part.poses[:2, frames].T]
    degrees = -np.degrees(part.poses[2, frames])
    moves = {"translate": [f"{x:.2f} {y:.2f}" for x, y in places], "rotate": [f"{angle:.2f}" for angle in degrees]}
    group = sheet.root
    for kind, values in moves.items():
        group = ET.SubElement(group, "g", {"transform": f"{kind}({values[0]})"})
        animation = {"attributeName": "transform", "type": kind, "values": ";".join(values), **timing}
        ET.SubElement(group, "animateTransform", animation)
    ET.SubElement(group, "title").text = part.name
    return group


def _reshaped(part: Part | DrawnLink, sheet: _Sheet, frames: Sequence[int], timing: dict[str, str]) -> None:
    """Put a part of space on the page: its lines change, where those of the plane are moved and turned."""
    group = ET.SubElement(sheet.root, "g")
    ET.SubElement(group, "title").text = part.name
    poses = []
    for k in frames:
        poses.append(ET.Element("g"))
        for shape in part.at(k):
            sheet.add(shape, poses[-1])
    for looks in zip(*poses, strict=True):
        group.append(looks[0])
        for name in list(looks[0].attrib):
            values = [look.get(name, "") for look in looks]
            if len(set(values)) > 1:
                ET.SubElement(looks[0], "animate", {"attributeName": name, "values": ";".join(values), **timing})


def frames_of(drawing: Drawing) -> list[int]:
    """Return the numbers of the poses that an animation shows: all, or so many, evenly spread."""
    count = len(drawing.t)
    return sorted({round(k) for k in np.linspace(0, count - 1, min(count, FRAMES))})
