"""A scene's mechanism as moving parts, in pixels of one small picture: paths, frames, and an error magnified."""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from functools import cached_property
from itertools import pairwise
from typing import Any

import numpy as np

from refkin.joints import GROUND, PointDistance, SpatialPointDistance, elements_of
from refkin.model import Scene
from refkin.motion import Motion, point_motion
from refkin.output.drawing import points_of, shapes_of
from refkin.output.spatial import VIEW, Shape

WIDTH, HEIGHT, MARGIN = 300, 190, 26
MOST_FRAMES = 24
"""Frames of a moving picture."""
VISIBLE = 0.12
"""How far a magnified error is to move something, as a part of the picture's width."""
BEND = 0.35
"""How far it turns a part at most [rad]: beyond it, a magnified error is no picture of a small one."""
OUTMOST = ("ground", "pin", "wheel")
"""Roles of shapes that the picture holds; outlines go through points, and lines to slide along beyond it."""


@dataclass(frozen=True)
class DrawnSample:
    """The sample with the fewest digits of a decade: the number of its time, its digits, signed errors (n, T)."""

    k: int
    digits: float
    off: Any


@dataclass(frozen=True)
class View:
    """How metres become pixels."""

    x: float
    y: float
    scale: float

    def pixels(self, x: Any, y: Any) -> tuple[Any, Any]:
        """Return where a point is drawn; pictures grow downwards."""
        return WIDTH / 2 + (x - self.x) * self.scale, HEIGHT / 2 - (y - self.y) * self.scale


class SceneDrawing:
    """A scene's mechanism as parts, its motion as frames."""

    def __init__(self, scene: Scene, motion: Motion) -> None:
        self.scene, self.motion = scene, motion
        self.names = {body.name: k for k, body in enumerate(scene.mechanism.bodies)}
        self.shown = np.flatnonzero(np.all(np.isfinite(motion.q), axis=0))
        self.width = scene.mechanism.kind.width
        self.points = points_of(scene)
        self.pins = [(body, point) for body, points in self.points.items() for point in points]
        self.elements = list(elements_of(scene.mechanism.joints))
        self.links = [e for e in self.elements if isinstance(e, PointDistance) and not e.laws]
        step = max(1, -(-motion.t.size // MOST_FRAMES))
        self.frames = [k for k in range(0, motion.t.size, step) if k in self.shown]
        if self.shown.size:
            self.view = self._view()

    @cached_property
    def shapes(self) -> dict[str, tuple[Shape, ...]]:
        """What there is to see of the ground and of each body, in its own frame."""
        return shapes_of(self.scene)

    def _within(self, q: Any) -> Any:
        """Return the outmost places of points, wheels and bodies without a point at poses (n, T), (2, K)."""
        shapes = [(body, s) for body, of_body in self.shapes.items() for s in of_body]
        parts = [(body, s) for body, s in shapes if s.role in OUTMOST or not (self.points[body] or body == GROUND)]
        places = [(self._seen(q, body, point), shape.radius) for body, shape in parts for point in shape.points.T]
        return np.concatenate([at + way * radius for at, radius in places for way in (-1, 1)], axis=1)

    def _view(self) -> View:
        """Return the view that holds every part at every time.

        What hardly moves, as a crank alone, is no larger in it than the block that is drawn for it.
        """
        x, y = self._within(self.motion.q[:, self.shown])
        wide, high = np.ptp(x), np.ptp(y)
        least = 0.12 * self.scene.mechanism.size()
        room = min((WIDTH - 2 * MARGIN) / max(wide, least), (HEIGHT - 2 * MARGIN) / max(high, least))
        return View((x.max() + x.min()) / 2, (y.max() + y.min()) / 2, float(room))

    def _rows(self, body: str) -> slice:
        return slice(self.width * self.names[body], self.width * (self.names[body] + 1))

    def _seen(self, q: Any, body: str, point: Any) -> Any:
        """Return where a point of a body is in the picture, (2,) or (2, T) [m]."""
        if body == GROUND:
            return np.add.outer(point, np.zeros(np.shape(q)[1:]))
        return point_motion(point, q[self._rows(body)]).r

    def _pixels(self, q: Any, body: str, point: Any) -> tuple[Any, ...]:
        return self.view.pixels(*self._seen(q, body, point))

    def described(self, name: str, key: str) -> dict[str, Any]:
        """Return parts and frames."""
        frames = [self._frame(self.motion.q[:, k]) for k in self.frames]
        ground = [short(*self._pixels(self.motion.q[:, 0], GROUND, point)) for point in self.points[GROUND]]
        picture = {"name": name, "key": key, "ground": ground, "guide": self._guide(GROUND)}
        return {**picture, "parts": self._parts(), "frames": frames}

    def _guide(self, body: str) -> str:
        """Return what a body or the ground has beside its outline: lines to slide along, wheels and profiles."""
        beside = [shape for shape in self.shapes[body] if shape.role in ("guide", "wheel")]
        return "".join(self._path(shape, placed=body == GROUND) for shape in beside)

    def _path(self, shape: Shape, *, placed: bool = False) -> str:
        """Return a shape of a part in its own frame, or of the ground where it is placed: a line, outline or circle."""
        s, (x, y) = self.view.scale, shape.points
        across, down = self.view.pixels(x, y) if placed else (x * s, -y * s)
        r = shape.radius * s
        if r:
            halves = "".join(f"a{r:.1f} {r:.1f} 0 0 0 {way * r:.1f} 0" for way in (2.0, -2.0))
            return f"M{across[0] - r:.1f} {down[0]:.1f}{halves}"
        line = "M" + "L".join(f"{x:.1f} {y:.1f}" for x, y in zip(across, down, strict=True))
        return line + ("" if shape.role == "guide" or len(x) == 2 else "z")

    def _parts(self) -> list[dict[str, Any]]:
        """Return a path per body, through its points, and one per massless link."""
        parts = []
        for body in self.names:
            outline, *_ = self.shapes[body]
            pins = [short(x * self.view.scale, -y * self.view.scale) for x, y in self.points[body]]
            parts.append({"path": self._path(outline), "pins": pins, "guide": self._guide(body)})
        for link in self.links:
            length = link.length * self.view.scale
            parts.append({"path": f"M0 0L{length:.1f} 0", "pins": [[0.0, 0.0], short(length, 0.0)], "guide": ""})
        return parts

    def _frame(self, q: Any) -> list[list[float]]:
        places = []
        for k in range(len(self.names)):
            x, y = self.view.pixels(q[3 * k], q[3 * k + 1])
            places.append(short(x, y, -math.degrees(math.remainder(q[3 * k + 2], math.tau))))
        for link in self.links:
            (xi, yi), (xj, yj) = (self._pixels(q, *end) for end in link.ends)
            places.append(short(xi, yi, math.degrees(math.atan2(yj - yi, xj - xi))))
        return places

    def ghost(self, sample: DrawnSample, level: int) -> dict[str, Any] | None:
        """Return the pose of a sample, the engine's answer in it, and by which factor its error is magnified.

        A wrong position is another pose; wrong rates are arrows (from, truth's head, engine's head) at the bodies.
        """
        k = sample.k
        if k not in self.shown:
            return None
        # Signed errors in scaled coordinates become those in metres and rad, or in Euler parameters.
        size, lengths = self.scene.mechanism.size(), self.scene.mechanism.kind.dimension
        scales = np.tile([size] * lengths + [1.0] * (self.width - lengths), len(self.names))
        errors = sample.off * scales[:, None]
        off, q = np.nan_to_num(errors[:, k]), self.motion.q[:, k]
        picture = {"digits": sample.digits, "time": float(self.motion.t[k]), "pose": self._frame(q)}
        if level == 0:
            factor = self._visible(q, off)
            ghost = self._frame(q + factor * off)
            return {**picture, "factor": factor, "ghost": ghost, "arrows": [], "cycle": self._cycle(errors)}
        rates = [rate[:, k] for rate in (self.motion.qd, self.motion.qdd)[:level] if rate is not None]
        if len(rates) < level or not np.all(np.isfinite(rates[-1])):
            return None
        factor, arrows = self._arrows(q, rates, off)
        return {**picture, "factor": factor, "ghost": [], "arrows": arrows, "cycle": None}

    def _visible(self, q: Any, off: Any) -> float:
        """Return the factor by which an error of a pose can be seen and is still a small one."""
        bent = max(self._turned(off), 1e-300)
        return factor_below(VISIBLE * WIDTH / max(self._moved(q, off), 1e-300), BEND / bent)

    def _turned(self, off: Any) -> float:
        """Return by how much an error turns a body at most [rad]."""
        return float(np.max(np.abs(off[2::3])))

    def _cycle(self, errors: Any) -> dict[str, Any] | None:
        """Return the engine's answer in every frame, one factor for all: the smallest of those that suit a frame."""
        off = {k: errors[:, k] if np.all(np.isfinite(errors[:, k])) else None for k in self.frames}
        if all(error is None for error in off.values()):
            return None
        wrong = {k: error for k, error in off.items() if error is not None and error.any()}
        factor = min((self._visible(self.motion.q[:, k], error) for k, error in wrong.items()), default=1.0)
        frames = [
            None if error is None else self._frame(self.motion.q[:, k] + factor * error) for k, error in off.items()
        ]
        return {"factor": factor, "frames": frames}

    def _moved(self, q: Any, off: Any) -> float:
        """Return how far an error moves the joint points at most, to first order, in pixels."""
        there = [math.hypot(*(self._seen(q + off, *pin) - self._seen(q, *pin))) for pin in self.pins]
        turned = [abs(off[3 * self.names[b] + 2]) * math.hypot(*point) for b, point in self.pins if b in self.names]
        first = np.max(np.abs([*off[0::3], *off[1::3]]))
        return float(self.view.scale * max([*there, *turned, first]))

    def _arrows(self, q: Any, rates: Sequence[Any], off: Any) -> tuple[float, list[list[float]]]:
        """Return the last of some rates at the bodies' joint points as arrows, and the factor of the error in them."""
        tails, truths, errors = [], [], []
        for body, point in (pin for pin in self.pins if pin[0] in self.names):
            rows = self._rows(body)
            moves = point_motion(point, q[rows], *(rate[rows] for rate in rates))
            tails.append(self.view.pixels(*moves.r))
            truths.append(moves.v if len(rates) == 1 else moves.a)
            errors.append(point_motion(point, q[rows], off[rows]).v)
        truth, error = np.array(truths).reshape(-1, 2), np.array(errors).reshape(-1, 2)
        scale = 0.22 * HEIGHT / max(np.max(np.hypot(*truth.T), initial=0.0), 1e-300)
        factor = factor_below(0.6 * VISIBLE * WIDTH / max(scale * np.max(np.hypot(*error.T), initial=0.0), 1e-300))
        arrows = []
        for (x, y), one, other in zip(tails, scale * truth, scale * (truth + factor * error), strict=True):
            if max(*np.abs(one), *np.abs(other)) > 1.0:  # shorter ones are dots
                arrows.append(short(x, y, x + one[0], y - one[1], x + other[0], y - other[1]))
        return factor, arrows


def factor_below(*largest: float) -> float:
    """Return the largest 1, 2 or 5 times a power of ten below all, at least 1: errors are never made smaller."""
    limit = min(largest)
    if not limit > 1.0 or limit > 1e30:
        return 1.0
    power = 10.0 ** math.floor(math.log10(limit))  # may be rounded up to just above the limit
    return max([1.0, *(step * power for step in (0.5, 1, 2, 5) if step * power <= limit)])


def short(*numbers: float) -> list[float]:
    """Return numbers to a tenth of a pixel or a degree."""
    return [round(float(x), 1) for x in np.clip(numbers, -1e4, 1e4)]


Ends = tuple[tuple[str, Any], tuple[str, Any]]
LENGTH = 100.0
SEEN = np.vstack([VIEW, np.cross(*VIEW)])
"""From points of space to those of the picture, and how far in front of it they are."""


class SpaceDrawing(SceneDrawing):
    """A mechanism of space: its joint points and the bars between them, in projection; errors of rates are not drawn.

    A bar becomes shorter as it is seen: its path is `LENGTH` pixels long, and a frame stretches it. A place is x, y,
    degrees and stretch, and then how far in front of the picture's middle it lies, a bar with both ends: the page's
    script turns it by these, about the middle.
    """

    def _guide(self, body: str) -> str:
        return ""

    def _within(self, q: Any) -> Any:
        return np.concatenate([self._seen(q, *pin)[:2] for pin in self.pins], axis=1)

    def _view(self) -> View:
        q = self.motion.q[:, self.shown]
        depths = np.concatenate([self._seen(q, *pin)[2] for pin in self.pins])
        self.middle = (depths.max() + depths.min()) / 2
        return super()._view()

    def described(self, name: str, key: str) -> dict[str, Any]:
        """Return parts and frames; `fit` is what it shrinks by to hold every point from wherever it is seen."""
        q, middle = self.motion.q[:, self.shown], [[self.view.x], [self.view.y], [self.middle]]
        away = np.concatenate([self._seen(q, *pin) for pin in self.pins], axis=1) - middle
        furthest = self.view.scale * float(np.max(np.linalg.norm(away, axis=0)))
        fit = min(1.0, (HEIGHT / 2 - MARGIN / 2) / max(furthest, 1e-300))
        return {**super().described(name, key), "fit": round(fit, 3)}

    def _pixels(self, q: Any, body: str, point: Any) -> tuple[float, float, float]:
        """Return where a point is drawn, and how far in front of the middle it lies in pixels."""
        x, y, depth = self._seen(q, body, point)
        return *self.view.pixels(x, y), float((depth - self.middle) * self.view.scale)

    def _seen(self, q: Any, body: str, point: Any) -> Any:
        """Return where a point is in the picture's plane, and how far in front of it, (3,) or (3, T) [m]."""
        if body == GROUND:
            return SEEN @ super()._seen(q, body, point)
        pose = np.array(q[self._rows(body)])
        pose[3:] /= np.linalg.norm(pose[3:], axis=0)  # a magnified error makes them longer
        return SEEN @ point_motion(point, pose).r

    def _bars(self) -> Iterator[Ends]:
        for body in self.names:
            points = self.points[body]
            closed = [*points, points[0]] if len(points) > 2 else points
            for one, other in pairwise(closed):
                yield (body, one), (body, other)
        for element in self.elements:
            if isinstance(element, SpatialPointDistance):
                yield element.ends

    @property
    def _moving(self) -> list[tuple[str, Any]]:
        return [pin for pin in self.pins if pin[0] in self.names]

    def _parts(self) -> list[dict[str, Any]]:
        bars = [{"path": f"M0 0L{LENGTH:g} 0", "pins": [], "guide": ""} for _ in self._bars()]
        return bars + [{"path": "M0 0", "pins": [[0.0, 0.0]], "guide": ""} for _ in self._moving]

    def _frame(self, q: Any) -> list[list[float]]:
        places = []
        for ends in self._bars():
            (xi, yi, zi), (xj, yj, zj) = (self._pixels(q, *end) for end in ends)
            stretch = round(math.hypot(xj - xi, yj - yi) / LENGTH, 4)
            places.append([*short(xi, yi, math.degrees(math.atan2(yj - yi, xj - xi))), stretch, *short(zi, zj)])
        for pin in self._moving:
            x, y, z = self._pixels(q, *pin)
            places.append([*short(x, y), 0.0, 1.0, *short(z)])
        return places

    def _turned(self, off: Any) -> float:
        return max((2.0 * float(np.linalg.norm(off[k + 3 : k + 7])) for k in range(0, len(off), 7)), default=0.0)

    def _moved(self, q: Any, off: Any) -> float:
        longest = max((float(np.linalg.norm(point)) for _, point in self._moving), default=1.0)
        shifted = max(float(np.linalg.norm(off[k : k + 3])) for k in range(0, len(off), 7))
        return float(self.view.scale * (shifted + self._turned(off) * longest))

    def _arrows(self, q: Any, rates: Sequence[Any], off: Any) -> tuple[float, list[list[float]]]:
        return 1.0, []
