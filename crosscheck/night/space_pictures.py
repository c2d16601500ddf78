"""A mechanism of space as small pictures have it: its joint points and the bars between them, in projection.

A bar turns and becomes shorter as it is seen: its path is 100 pixels long, and a frame stretches it. A place is x, y,
degrees and stretch, and then how far in front of the picture's middle it lies, a bar with both ends: the page's script
turns it by these, about the middle.
"""

from __future__ import annotations

import math
from collections.abc import Iterator
from itertools import pairwise
from typing import Any

import numpy as np

from crosscheck.engines.spatial.turning import matrix
from crosscheck.night.moving_parts import BEND, HEIGHT, MARGIN, VISIBLE, WIDTH, SceneDrawing, View, factor_below, short
from refkin.joints import GROUND, SpatialPointDistance
from refkin.output.spatial import VIEW

Ends = tuple[tuple[str, Any], tuple[str, Any]]
LENGTH = 100.0
SEEN = np.vstack([VIEW, np.cross(*VIEW)])
"""From points of space to those of the picture, and how far in front of it they are."""


class SpaceDrawing(SceneDrawing):
    """As `SceneDrawing`; errors of rates are not drawn."""

    def _view(self) -> View:
        q = self.motion.q[:, self.shown]
        depths = np.concatenate(
            [self._seen(q, body, point)[2] for body, points in self.points.items() for point in points]
        )
        self.middle = (depths.max() + depths.min()) / 2
        return super()._view()

    def described(self, name: str, key: str) -> dict[str, Any]:
        """Return parts and frames; `fit` is what it shrinks by to hold every point from wherever it is seen."""
        q, view = self.motion.q[:, self.shown], self.view
        seen = [self._seen(q, body, point) for body, points in self.points.items() for point in points]
        away = np.concatenate(seen, axis=1) - np.array([[view.x], [view.y], [self.middle]])
        furthest = view.scale * float(np.max(np.linalg.norm(away, axis=0)))
        fit = min(1.0, (HEIGHT / 2 - MARGIN / 2) / max(furthest, 1e-300))
        return {**super().described(name, key), "fit": round(fit, 3)}

    def _places(self, q: Any) -> Any:
        for body, points in self.points.items():
            for point in points:
                yield self._seen(q, body, point)[:2]

    def _pixels(self, q: Any, body: str, point: Any) -> tuple[float, float, float]:
        """Return where a point is drawn, and how far in front of the middle it lies in pixels."""
        x, y, depth = self._seen(q, body, point)
        return *self.view.pixels(x, y), float((depth - self.middle) * self.view.scale)

    def _seen(self, q: Any, body: str, point: Any) -> Any:
        """Return where a point is in the picture's plane, and how far in front of it, (3,) or (3, T) [m]."""
        if body == GROUND:
            return SEEN @ (np.array(point).reshape(3, *[1] * (np.ndim(q) - 1)) + np.zeros((3, *np.shape(q)[1:])))
        pose = q[7 * self.names[body] : 7 * self.names[body] + 7]
        if np.ndim(pose) == 1:
            return SEEN @ (pose[:3] + matrix(pose[3:]) @ np.array(point))
        return np.stack([self._seen_once(column, point) for column in pose.T], axis=1)

    def _seen_once(self, pose: Any, point: Any) -> Any:
        return SEEN @ (pose[:3] + matrix(pose[3:]) @ np.array(point))

    def _bars(self) -> Iterator[Ends]:
        for body in self.names:
            points = self.points.get(body, [])
            closed = [*points, points[0]] if len(points) > 2 else points
            for one, other in pairwise(closed):
                yield (body, one), (body, other)
        for element in self.elements:
            if isinstance(element, SpatialPointDistance):
                yield element.ends

    def _pins(self) -> Iterator[tuple[str, Any]]:
        for body in self.names:
            yield from ((body, point) for point in self.points.get(body, ()))

    def _ground(self) -> list[list[float]]:
        return [short(*self._pixels(self.motion.q[:, 0], GROUND, point)) for point in self.points.get(GROUND, ())]

    def _parts(self) -> list[dict[str, Any]]:
        bars = [{"path": f"M0 0L{LENGTH:g} 0", "pins": [], "guide": ""} for _ in self._bars()]
        return bars + [{"path": "M0 0", "pins": [[0.0, 0.0]], "guide": ""} for _ in self._pins()]

    def _frame(self, q: Any) -> list[list[float]]:
        places = []
        for ends in self._bars():
            (xi, yi, zi), (xj, yj, zj) = (self._pixels(q, *end) for end in ends)
            stretch = round(math.hypot(xj - xi, yj - yi) / LENGTH, 4)
            places.append([*short(xi, yi, math.degrees(math.atan2(yj - yi, xj - xi))), stretch, *short(zi, zj)])
        for pin in self._pins():
            x, y, z = self._pixels(q, *pin)
            places.append([*short(x, y), 0.0, 1.0, *short(z)])
        return places

    def _visible(self, q: Any, off: Any) -> float:
        turned = max((2.0 * float(np.linalg.norm(off[k + 3 : k + 7])) for k in range(0, len(off), 7)), default=0.0)
        return factor_below(VISIBLE * WIDTH / max(self._moved(q, off), 1e-300), BEND / max(turned, 1e-300))

    def _moved(self, q: Any, off: Any) -> float:
        arms = [1.0, *(float(np.linalg.norm(point)) for _, point in self._pins())]
        turned = max(2.0 * float(np.linalg.norm(off[k + 3 : k + 7])) for k in range(0, len(off), 7))
        shifted = max(float(np.linalg.norm(off[k : k + 3])) for k in range(0, len(off), 7))
        return float(self.view.scale * (shifted + turned * max(arms[1:], default=1.0)))

    def _in_metres(self, off: Any) -> Any:
        size = self.scene.mechanism.size()
        return off * np.tile([size] * 3 + [1.0] * 4, len(self.names))[:, None]

    def _arrows(self, q: Any, rate: Any, off: Any, spin: Any) -> tuple[float, list[list[float]]]:
        return 1.0, []
