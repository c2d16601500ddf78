"""Shapes; and what there is to see of a mechanism of space: from its right, in front and above, without perspective.

Axes of joints are drawn through their points: short ones where a body turns, long ones where it slides; a square where
a point stays in a plane.
"""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from itertools import groupby
from typing import Any

import numpy as np

from refkin.joints import AxesPerpendicular, Element, PointInPlane, PointOnAxis

AZIMUTH, ELEVATION = math.radians(-60.0), math.radians(25.0)
"""Where it is seen from: turned from the x axis about z, and above the plane of x and y [rad]."""
_C, _S, _UP = math.cos(AZIMUTH), math.sin(AZIMUTH), math.sin(ELEVATION)
VIEW = np.array([[-_S, _C, 0.0], [-_C * _UP, -_S * _UP, math.cos(ELEVATION)]])
"""From points of space to those of the picture."""
HINGE, GUIDE, SQUARE, TRIAD, BLOCK = 0.12, 0.75, 0.5, 0.3, 0.05
"""Half of an axis, of a line to slide along, of a side of a plane; axes of the ground; half of a block [sizes]."""


@dataclass(frozen=True)
class Shape:
    """A line, an outline or a circle.

    Attributes
    ----------
    role : str
        What it shows: ground, guide, axis, body, slider, link, wheel, pin, curve, velocity or acceleration.
    points : (2, K) or (3, K) array
        [m], in the frame of the part; or as they are seen, (2, K).
    radius : float
        Of a circle around the one point [m].
    """

    role: str
    points: Any
    radius: float = 0.0


def features_of_joints(elements: Sequence[Element], name: str, size: float) -> Iterator[Shape]:
    """Yield the axes and planes that joints have on a body, in its frame.

    Parameters
    ----------
    elements : sequence of Element
        What all joints say.
    name : str
        The body.
    size : float
        How long an axis is drawn [m].
    """
    for _, group in groupby(elements, key=lambda e: e.name):
        parts = list(group)
        for side in "ij":
            of_body = [e for e in parts if getattr(e, f"body_{side}") == name]
            points = [p for e in of_body for body, p in e.ends if body == name]
            axes = [a for e in of_body if (a := getattr(e, f"axis_{side}", None)) is not None]
            if not axes:
                continue
            at, axis = np.array(points[0] if points else (0.0, 0.0, 0.0)), np.array(axes[0]) / math.hypot(*axes[0])
            if any(isinstance(e, PointInPlane) for e in of_body):
                yield Shape("wheel", at[:, None] + SQUARE * size * _across(axis) @ [[1, 1, -1, -1], [1, -1, -1, 1]])
                continue
            slides = side == "i" and any(isinstance(e, PointOnAxis) for e in of_body)
            half = (GUIDE if slides else HINGE) * size
            alone = any(isinstance(e, AxesPerpendicular) for e in parts)
            yield Shape("guide" if slides else "axis", at[:, None] + np.outer(axis, [-half, half]))
            if alone and not points:
                yield Shape("pin", at[:, None])


def triad(size: float) -> Iterator[Shape]:
    """Yield the axes of the ground."""
    for axis in np.eye(3):
        yield Shape("guide", np.outer(axis, [0.0, TRIAD * size]))


def block(points: Any, size: float) -> Shape:
    """Return a small block around one point, or around the origin."""
    at = points[:, :1] if points.shape[1] else np.zeros((3, 1))
    return Shape("slider", at + BLOCK * size * np.array([[-1, 1, 1, -1], [0, 0, 0, 0], [-1, -1, 1, 1]]))


def _across(axis: Any) -> Any:
    """Return two unit vectors across an axis, as columns."""
    first = np.cross(axis, np.eye(3)[int(np.argmin(np.abs(axis)))])
    first /= np.linalg.norm(first)
    return np.stack([first, np.cross(axis, first)], axis=1)
