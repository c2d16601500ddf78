"""A line, an outline or a circle: what pictures consist of."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any


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
