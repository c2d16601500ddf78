"""The mechanism behind a mark: the reference's motion as moving parts, the engine's answer with its error magnified.

Everything is in pixels of one small picture, ready to be put into `transform` attributes: a part is a path in its own
frame, a frame of the motion is one (x, y, degrees) per part. So page and script draw the same with no geometry of their
own.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from crosscheck.judge.samples import frame_step
from crosscheck.report.cells import Picture
from refkin.errors import InvalidScene
from refkin.joints import GROUND, Distance, PointOnLine, Prismatic
from refkin.model import Effect, Mechanism, Scene
from refkin.motion import Motion
from refkin.scenes.files import parse
from refkin.solving.solve import solve

WIDTH, HEIGHT, MARGIN = 300, 190, 26
MOST_SCENES = 60
"""Scenes with a picture; marks of further ones have none. It bounds the page at some hundred kilobytes."""
VISIBLE = 0.12
"""How far a magnified error is to move something, as a part of the picture's width."""
BEND = 0.35
"""How far it turns a part at most [rad]: beyond it, a magnified error is no picture of a small one."""
LEVELS = {"position": 0, "velocity": 1, "acceleration": 2}

Cells = Mapping[tuple[str, str, str], Mapping[int, Picture]]


@dataclass(frozen=True)
class View:
    """How metres become pixels."""

    x: float
    y: float
    scale: float

    def pixels(self, x: Any, y: Any) -> tuple[Any, Any]:
        """Return where a point is drawn; pictures grow downwards."""
        return WIDTH / 2 + (x - self.x) * self.scale, HEIGHT / 2 - (y - self.y) * self.scale


def poses(cells: Cells) -> dict[str, Any]:
    """Return the scenes with their motion, and one mark per (engine, route, quantity, decade) that has a picture.

    Scenes are solved again by the reference, positions and rates alone; those with the fewest digits go first.
    """
    wanted = [(*name, decade, picture) for name, kept in cells.items() for decade, picture in kept.items()]
    wanted.sort(key=lambda item: (item[4].sample.digits, item[:4]))
    numbers: dict[str, int | None] = {}
    scenes: list[dict[str, Any]] = []
    drawn: list[Drawing] = []
    marks = []
    for engine, route, quantity, decade, picture in wanted:
        key = picture.place.key
        if key not in numbers:
            drawing = _drawing(picture) if len(drawn) < MOST_SCENES else None
            numbers[key] = None if drawing is None else len(drawn)
            if drawing is not None:
                drawn.append(drawing)
                scenes.append(drawing.described(picture.place.scene, key))
        number = numbers[key]
        if number is None:
            continue
        ghost = drawn[number].ghost(picture, LEVELS[quantity])
        if ghost is not None:
            who = {"engine": engine, "route": route, "quantity": quantity, "decade": decade}
            marks.append({**who, "digits": picture.sample.digits, "scene": number, **ghost})
    return {"width": WIDTH, "height": HEIGHT, "scenes": scenes, "marks": marks}


def _drawing(picture: Picture) -> Drawing | None:
    """Return the scene of a picture in motion; None if it cannot be read or has no motion to show."""
    try:
        scene = parse(dict(picture.scene_file))
    except InvalidScene:
        return None
    whole = replace(scene, bodies_wanted=None, points=(), effects=frozenset(Effect), evidence=frozenset())
    drawing = Drawing(whole, solve(whole))
    return drawing if drawing.shown.size else None


class Drawing:
    """A scene's mechanism as parts, its motion as frames."""

    def __init__(self, scene: Scene, motion: Motion) -> None:
        self.scene, self.motion = scene, motion
        self.names = {body.name: k for k, body in enumerate(scene.mechanism.bodies)}
        self.shown = np.flatnonzero(np.all(np.isfinite(motion.q), axis=0))
        self.points = _points(scene.mechanism)
        self.links = [tuple(c.points()) for c in scene.mechanism.joints if isinstance(c, Distance)]
        step = frame_step(motion.t.size)
        self.frames = [k for k in range(0, motion.t.size, step) if k in self.shown]
        self.step = step
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
        told = {"name": name, "key": key, "ground": self._ground(), "guide": self._guide(None)}
        return {**told, "parts": self._parts(), "frames": frames}

    def _ground(self) -> list[list[float]]:
        return [_short(*self.view.pixels(x, y)) for x, y in self.points.get(GROUND, ())]

    def _guide(self, body: str | None) -> str:
        """Return the lines along which something slides on a body (None: the ground), two sizes to each side."""
        lines = []
        for joint in self.scene.mechanism.joints:
            if not isinstance(joint, Prismatic | PointOnLine) or joint.body_i != (body or GROUND):
                continue
            along = 2.0 * self.scene.mechanism.size() / math.hypot(*joint.axis_i)
            (px, py), (ax, ay) = joint.point_i, joint.axis_i
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
            parts.append({"path": _path(pins), "pins": [_short(*pin) for pin in pins], "guide": self._guide(body.name)})
        lengths = [c.length * s for c in self.scene.mechanism.joints if isinstance(c, Distance)]
        for length in lengths:
            pins = [(0.0, 0.0), (length, 0.0)]
            parts.append({"path": _path(pins), "pins": [_short(*pin) for pin in pins], "guide": ""})
        return parts

    def _frame(self, q: Any) -> list[list[float]]:
        places = []
        for k in range(len(self.names)):
            x, y = self.view.pixels(q[3 * k], q[3 * k + 1])
            places.append(_short(x, y, -math.degrees(math.remainder(q[3 * k + 2], math.tau))))
        for (body_i, point_i), (body_j, point_j) in self.links:
            (xi, yi), (xj, yj) = (
                self.view.pixels(*_place(q, self.names.get(body), point))
                for body, point in ((body_i, point_i), (body_j, point_j))
            )
            places.append(_short(xi, yi, math.degrees(math.atan2(yj - yi, xj - xi))))
        return places

    def ghost(self, picture: Picture, level: int) -> dict[str, Any] | None:
        """Return the pose of a sample, the engine's answer in it, and by which factor its error is magnified.

        A wrong position is another pose; wrong rates are arrows (from, truth's head, engine's head) at the bodies.
        """
        k, size = picture.sample.k, self.scene.mechanism.size()
        off = np.array([0.0 if x is None else x for x in picture.sample.off])
        if k >= self.motion.t.size or k not in self.shown or off.size != 3 * len(self.names):
            return None
        off[0::3], off[1::3] = off[0::3] * size, off[1::3] * size
        q = self.motion.q[:, k]
        told = {"time": float(self.motion.t[k]), "pose": self._frame(q)}
        if level == 0:
            factor = self._visible(q, off)
            ghost = self._frame(q + factor * off)
            return {**told, "factor": factor, "ghost": ghost, "arrows": [], "cycle": self._cycle(picture, size)}
        rate = (self.motion.qd, self.motion.qdd)[level - 1]
        if rate is None or not np.all(np.isfinite(rate[:, k])):
            return None
        factor, arrows = self._arrows(q, rate[:, k], off)
        return {**told, "factor": factor, "ghost": [], "arrows": arrows, "cycle": None}

    def _visible(self, q: Any, off: Any) -> float:
        """Return the factor by which an error of a pose can be seen and is still a small one."""
        bent = max(np.max(np.abs(off[2::3])), 1e-300)
        return _factor(VISIBLE * WIDTH / max(self._moved(q, off), 1e-300), BEND / bent)

    def _cycle(self, picture: Picture, size: float) -> dict[str, Any] | None:
        """Return the engine's answer in every frame, one factor for all: the smallest of those that suit a frame."""
        found = picture.cycle
        if found is None or len(found.off) != -(-self.motion.t.size // self.step):
            return None
        scale = np.tile([size, size, 1.0], len(self.names)) * found.unit
        errors = {k: found.off[k // self.step] for k in self.frames}
        if any(whole is not None and len(whole) != scale.size for whole in errors.values()):
            return None
        off = {k: None if whole is None else scale * np.array(whole) for k, whole in errors.items()}
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

    def _arrows(self, q: Any, rate: Any, off: Any) -> tuple[float, list[list[float]]]:
        """Return the rates of the bodies' joint points as arrows, and the factor of the error in them."""
        tails, truths, errors = [], [], []
        for body, points in self.points.items():
            for point in points if body in self.names else ():
                k = 3 * self.names[body]
                x, y = _place(q, self.names[body], point)
                arm = (-(y - q[k + 1]), x - q[k])
                tails.append(self.view.pixels(x, y))
                truths.append([rate[k] + arm[0] * rate[k + 2], rate[k + 1] + arm[1] * rate[k + 2]])
                errors.append([off[k] + arm[0] * off[k + 2], off[k + 1] + arm[1] * off[k + 2]])
        truth, error = np.array(truths), np.array(errors)
        scale = 0.22 * HEIGHT / max(np.max(np.hypot(*truth.T), initial=0.0), 1e-300)
        factor = _factor(0.6 * VISIBLE * WIDTH / max(scale * np.max(np.hypot(*error.T), initial=0.0), 1e-300))
        arrows = []
        for (x, y), one, other in zip(tails, scale * truth, scale * (truth + factor * error), strict=True):
            if max(*np.abs(one), *np.abs(other)) > 1.0:  # shorter ones are dots
                arrows.append(_short(x, y, x + one[0], y - one[1], x + other[0], y - other[1]))
        return factor, arrows


def _points(mechanism: Mechanism) -> dict[str, list[tuple[float, float]]]:
    """Return the joint points per body, each once, in the body's own frame."""
    found: dict[str, list[tuple[float, float]]] = {}
    for constraint in mechanism.joints:
        for body, point in constraint.points():
            of_body = found.setdefault(body, [])
            if point not in of_body:
                of_body.append(point)
    return found


def _place(q: Any, body: int | None, point: tuple[float, float]) -> tuple[Any, Any]:
    """Return a point of a body in metres; None is the ground."""
    if body is None:
        return point[0] + np.zeros(np.shape(q)[1:]), point[1] + np.zeros(np.shape(q)[1:])
    x, y, phi = q[3 * body : 3 * body + 3]
    c, s = np.cos(phi), np.sin(phi)
    return x + c * point[0] - s * point[1], y + s * point[0] + c * point[1]


def _factor(*largest: float) -> float:
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


def _short(*numbers: float) -> list[float]:
    """Return numbers to a tenth of a pixel or a degree."""
    return [round(float(x), 1) for x in np.clip(numbers, -1e4, 1e4)]
