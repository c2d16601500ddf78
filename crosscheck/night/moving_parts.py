"""A scene's mechanism as moving parts, in pixels of one small picture: paths, frames, and an error magnified."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Any

import numpy as np

from refkin.joints import GROUND, GuidedPoint, PointDistance, elements_of
from refkin.model import Mechanism, Scene
from refkin.motion import Motion

WIDTH, HEIGHT, MARGIN = 300, 190, 26
MOST_FRAMES = 24
"""Frames of a moving picture."""
VISIBLE = 0.12
"""How far a magnified error is to move something, as a part of the picture's width."""
BEND = 0.35
"""How far it turns a part at most [rad]: beyond it, a magnified error is no picture of a small one."""


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
        self.points = _points(scene.mechanism)
        self.elements = list(elements_of(scene.mechanism.joints))
        self.links = [e for e in self.elements if isinstance(e, PointDistance) and not e.laws]
        step = max(1, -(-motion.t.size // MOST_FRAMES))
        self.frames = [k for k in range(0, motion.t.size, step) if k in self.shown]
        if self.shown.size:
            self.view = self._view()

    def _view(self) -> View:
        """Return the view that holds every joint point at every time."""
        x, y = (np.concatenate(part) for part in zip(*self._places(self.motion.q[:, self.shown]), strict=True))
        wide, high = np.ptp(x), np.ptp(y)
        room = min((WIDTH - 2 * MARGIN) / max(wide, 1e-300), (HEIGHT - 2 * MARGIN) / max(high, 1e-300))
        return View((x.max() + x.min()) / 2, (y.max() + y.min()) / 2, float(min(room, 1e300)))

    def _places(self, q: Any) -> Any:
        for body, points in self.points.items():
            for point in points:
                yield _place(q, self.names.get(body), point)

    def described(self, name: str, key: str) -> dict[str, Any]:
        """Return parts and frames."""
        frames = [self._frame(self.motion.q[:, k]) for k in self.frames]
        picture = {"name": name, "key": key, "ground": self._ground(), "guide": self._guide(None)}
        return {**picture, "parts": self._parts(), "frames": frames}

    def _ground(self) -> list[list[float]]:
        return [short(*self.view.pixels(x, y)) for x, y in self.points.get(GROUND, ())]

    def _guide(self, body: str | None) -> str:
        """Return the lines along which something slides on a body (None: the ground), two sizes to each side."""
        lines = []
        for e in self.elements:
            if not isinstance(e, GuidedPoint) or e.body_i != (body or GROUND):
                continue
            length, (ax, ay) = math.hypot(*e.axis_i), e.axis_i
            along, aside = 2.0 * self.scene.mechanism.size() / length, e.offset / length
            px, py = e.point_i[0] - aside * ay, e.point_i[1] + aside * ax
            ends = [(px + way * ax, py + way * ay) for way in (-along, along)]
            s = self.view.scale
            placed = [(x * s, -y * s) if body else self.view.pixels(x, y) for x, y in ends]
            lines.append("M" + "L".join(f"{x:.1f} {y:.1f}" for x, y in placed))
        return "".join(lines)

    def _parts(self) -> list[dict[str, Any]]:
        """Return a path per body, through its joint points, and one per massless link."""
        s = self.view.scale
        parts = []
        for body in self.scene.mechanism.bodies:
            pins = [(x * s, -y * s) for x, y in self.points.get(body.name, ())]
            parts.append({"path": _path(pins), "pins": [short(*pin) for pin in pins], "guide": self._guide(body.name)})
        for link in self.links:
            pins = [(0.0, 0.0), (link.length * s, 0.0)]
            parts.append({"path": _path(pins), "pins": [short(*pin) for pin in pins], "guide": ""})
        return parts

    def _frame(self, q: Any) -> list[list[float]]:
        places = []
        for k in range(len(self.names)):
            x, y = self.view.pixels(q[3 * k], q[3 * k + 1])
            places.append(short(x, y, -math.degrees(math.remainder(q[3 * k + 2], math.tau))))
        for link in self.links:
            (xi, yi), (xj, yj) = (
                self.view.pixels(*_place(q, self.names.get(body), point)) for body, point in link.ends
            )
            places.append(short(xi, yi, math.degrees(math.atan2(yj - yi, xj - xi))))
        return places

    def ghost(self, sample: DrawnSample, level: int) -> dict[str, Any] | None:
        """Return the pose of a sample, the engine's answer in it, and by which factor its error is magnified.

        A wrong position is another pose; wrong rates are arrows (from, truth's head, engine's head) at the bodies.
        """
        k = sample.k
        if k not in self.shown:
            return None
        errors = self._in_metres(sample.off)
        off, q = np.nan_to_num(errors[:, k]), self.motion.q[:, k]
        picture = {"digits": sample.digits, "time": float(self.motion.t[k]), "pose": self._frame(q)}
        if level == 0:
            factor = self._visible(q, off)
            ghost = self._frame(q + factor * off)
            return {**picture, "factor": factor, "ghost": ghost, "arrows": [], "cycle": self._cycle(errors)}
        rate = (self.motion.qd, self.motion.qdd)[level - 1]
        if rate is None or self.motion.qd is None or not np.all(np.isfinite(rate[:, k])):
            return None
        factor, arrows = self._arrows(q, rate[:, k], off, (level - 1) * self.motion.qd[:, k])
        return {**picture, "factor": factor, "ghost": [], "arrows": arrows, "cycle": None}

    def _visible(self, q: Any, off: Any) -> float:
        """Return the factor by which an error of a pose can be seen and is still a small one."""
        bent = max(np.max(np.abs(off[2::3])), 1e-300)
        return factor_below(VISIBLE * WIDTH / max(self._moved(q, off), 1e-300), BEND / bent)

    def _in_metres(self, off: Any) -> Any:
        """Return signed errors in scaled coordinates in metres and rad."""
        size = self.scene.mechanism.size()
        return off * np.tile([size, size, 1.0], len(self.names))[:, None]

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
        there = [np.subtract(b, a) for a, b in zip(self._places(q), self._places(q + off), strict=True)]
        turned = [
            abs(off[3 * self.names[body] + 2]) * math.hypot(*point)
            for body, points in self.points.items()
            if body in self.names
            for point in points
        ]
        first = max((abs(x) for x in [*off[0::3], *off[1::3]]), default=0.0)
        return float(self.view.scale * max([math.hypot(*d) for d in there] + turned + [first]))

    def _arrows(self, q: Any, rate: Any, off: Any, spin: Any) -> tuple[float, list[list[float]]]:
        """Return the rates of the bodies' joint points as arrows, and the factor of the error in them.

        Points are accelerated towards a body's origin as it turns, by the `spin` in the velocity (n,) that is given.
        """
        tails, truths, errors = [], [], []
        for body, points in self.points.items():
            for point in points if body in self.names else ():
                k = 3 * self.names[body]
                x, y = _place(q, self.names[body], point)
                dx, dy = x - q[k], y - q[k + 1]
                tails.append(self.view.pixels(x, y))
                inward = spin[k + 2] ** 2
                truths.append([rate[k] - dy * rate[k + 2] - dx * inward, rate[k + 1] + dx * rate[k + 2] - dy * inward])
                errors.append([off[k] - dy * off[k + 2], off[k + 1] + dx * off[k + 2]])
        truth, error = np.array(truths), np.array(errors)
        scale = 0.22 * HEIGHT / max(np.max(np.hypot(*truth.T), initial=0.0), 1e-300)
        factor = factor_below(0.6 * VISIBLE * WIDTH / max(scale * np.max(np.hypot(*error.T), initial=0.0), 1e-300))
        arrows = []
        for (x, y), one, other in zip(tails, scale * truth, scale * (truth + factor * error), strict=True):
            if max(*np.abs(one), *np.abs(other)) > 1.0:  # shorter ones are dots
                arrows.append(short(x, y, x + one[0], y - one[1], x + other[0], y - other[1]))
        return factor, arrows


def _points(mechanism: Mechanism) -> dict[str, list[tuple[float, float]]]:
    """Return the joint points per body, each once, in the body's own frame."""
    points: dict[str, list[tuple[float, float]]] = {}
    for constraint in mechanism.joints:
        for body, point in constraint.points():
            of_body = points.setdefault(body, [])
            if point not in of_body:
                of_body.append(point)
    return points


def _place(q: Any, body: int | None, point: tuple[float, float]) -> tuple[Any, Any]:
    """Return a point of a body in metres; None is the ground."""
    if body is None:
        return point[0] + np.zeros(np.shape(q)[1:]), point[1] + np.zeros(np.shape(q)[1:])
    x, y, phi = q[3 * body : 3 * body + 3]
    c, s = np.cos(phi), np.sin(phi)
    return x + c * point[0] - s * point[1], y + s * point[0] + c * point[1]


def factor_below(*largest: float) -> float:
    """Return the largest 1, 2 or 5 times a power of ten below all, at least 1: errors are never made smaller."""
    limit = min(largest)
    if not limit > 1.0 or limit > 1e30:
        return 1.0
    power = 10.0 ** math.floor(math.log10(limit))  # may be rounded up to just above the limit
    return max([1.0, *(step * power for step in (0.5, 1, 2, 5) if step * power <= limit)])


def _path(pins: list[tuple[float, float]]) -> str:
    """Return the outline of a part: a bar through two points, a plate through more, a little box at one."""
    if len(pins) < 2:
        x, y = pins[0] if pins else (0.0, 0.0)
        return f"M{x - 7:.1f} {y - 5:.1f}h14v10h-14z"
    return "M" + "L".join(f"{x:.1f} {y:.1f}" for x, y in pins) + ("z" if len(pins) > 2 else "")


def short(*numbers: float) -> list[float]:
    """Return numbers to a tenth of a pixel or a degree."""
    return [round(float(x), 1) for x in np.clip(numbers, -1e4, 1e4)]
