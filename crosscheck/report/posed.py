"""The picture of a mechanism in a pose, as it stands on the page before anybody points at a mark."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any
from xml.etree import ElementTree as ET

from markupsafe import Markup

from crosscheck.report.svg import Style
from crosscheck.report.wording import number


def first_pose(report: Mapping[str, Any], looks: Mapping[tuple[str, str], Style]) -> int | None:
    """Return the number of the mark that is shown first: of the magnified positions the one farthest from singular.

    Near a singular pose all links lie in one line, which is a poor picture to begin with; so is an engine in the colour
    of the reference.
    """
    marks = report["poses"]["marks"]
    magnified = [k for k, m in enumerate(marks) if m["ghost"] and m["factor"] > 1.0]
    own = {k for k in magnified if looks[marks[k]["engine"], marks[k]["route"]].colour != "currentColor"}
    return max(magnified, key=lambda k: (k in own, marks[k]["decade"], -k), default=0 if marks else None)


def pose_picture(report: Mapping[str, Any], which: int, looks: Mapping[tuple[str, str], Style]) -> Markup:
    """Return the drawing: ground, the reference's answer, the engine's dashed, rates as arrows."""
    poses = report["poses"]
    mark = poses["marks"][which]
    scene = poses["scenes"][mark["scene"]]
    size = {"viewBox": f"0 0 {poses['width']} {poses['height']}", "width": str(poses["width"])}
    named = {"role": "img", "aria-labelledby": "pose-name", "id": "pose-picture"}
    root = ET.Element("svg", {**size, "height": str(poses["height"]), **named})
    ET.SubElement(root, "title", {"id": "pose-name"}).text = spoken(mark)
    ground = ET.SubElement(root, "g", {"id": "pose-ground", "stroke": "currentColor", "fill": "none"})
    for x, y, *_ in scene["ground"]:
        ET.SubElement(ground, "path", {"d": f"M{x - 7} {y + 9}L{x} {y}L{x + 7} {y + 9}z"})
    _guide(ground, scene["guide"])
    truth = {"id": "pose-truth", "stroke": "currentColor", "fill": "currentColor", "stroke-width": "2.2"}
    _parts(ET.SubElement(root, "g", truth), scene["parts"], mark["pose"])
    colour = looks[mark["engine"], mark["route"]].colour
    ghost = {"stroke": colour, "fill": "none", "stroke-width": "2", "stroke-dasharray": "5 3"}
    _parts(ET.SubElement(root, "g", {"id": "pose-ghost", **ghost}), scene["parts"], mark["ghost"])
    arrows = ET.SubElement(root, "g", {"id": "pose-arrows", "fill": "none", "stroke-width": "1.6"})
    for x, y, a, b, c, d in mark["arrows"]:
        ET.SubElement(arrows, "path", {"d": f"M{x} {y}L{a} {b}", "stroke": "currentColor"})
        ET.SubElement(arrows, "path", {"d": f"M{x} {y}L{c} {d}", "stroke": colour, "stroke-dasharray": "4 3"})
    return Markup(ET.tostring(root, encoding="unicode"))


def _parts(parent: ET.Element, parts: Sequence[Mapping[str, Any]], places: Sequence[Sequence[float]]) -> None:
    for part, (x, y, degrees, *along) in zip(parts, places, strict=False):  # no ghost: no places
        # Of space: bars become shorter as they are seen; what lies in front of the picture is for the script.
        stretched = f" scale({along[0]:g} 1)" if along else ""
        placed = f"translate({x:g} {y:g}) rotate({degrees:g}){stretched}"
        group = ET.SubElement(parent, "g", {"transform": placed})
        path = {"d": part["path"], "fill-opacity": "0.08", "stroke-linejoin": "round", "stroke-linecap": "round"}
        ET.SubElement(group, "path", path)
        _guide(group, part["guide"])
        for cx, cy in part["pins"]:
            ET.SubElement(group, "circle", {"cx": str(cx), "cy": str(cy), "r": "2.6"})


def _guide(parent: ET.Element, path: str) -> None:
    if path:
        ET.SubElement(parent, "path", {"d": path, "stroke-width": "1", "stroke-opacity": "0.45"})


def spoken(mark: Mapping[str, Any]) -> str:
    """Return what a picture shows, in words."""
    factor = "to scale" if mark["factor"] == 1.0 else f"× {number(mark['factor'], 1)}"
    return (
        f"{mark['engine']} · {mark['route']}, {mark['quantity']}: {mark['digits']:.1f} digits"
        f" at t = {mark['time']:.4g} s; error drawn {factor}"
    )


def spoken_moving(mark: Mapping[str, Any]) -> str:
    """Return what a moving picture shows, in words."""
    who = f"{mark['engine']} · {mark['route']}"
    if mark["cycle"] is None:
        return f"{who}: the reference over the cycle"
    factor = mark["cycle"]["factor"]
    return f"{who} over the cycle; error drawn {'to scale' if factor == 1.0 else f'× {number(factor, 1)}'}"
