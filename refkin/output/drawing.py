"""What there is to see of a mechanism: parts in the frames of their bodies, and where these are at each time.

A part comes from the elements of the joints: the points where a body is held make its outline, a guided point a line to
slide along, a distance a massless link, rolling and contact a wheel or a profile.
"""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from refkin.errors import RefkinError
from refkin.joints import SPACE, SpatialPointDistance
from refkin.joints.elements import (
    GROUND,
    Contact,
    Element,
    GuidedPoint,
    PointDistance,
    RollingOnLine,
    RollingWheels,
    elements_of,
)
from refkin.model import Scene
from refkin.motion import Motion, point_motion
from refkin.output.spatial import VIEW, Shape, block, features_of_joints, triad

RATES = ("velocity", "acceleration")
LONGEST = 0.25
"""The longest arrow, as a part of the picture's larger side."""
PROFILE_POINTS = 181
LINKS = (PointDistance, SpatialPointDistance)


class NothingToDraw(RefkinError):
    """A motion without any pose."""


class UnknownFormat(NothingToDraw):
    """A file whose ending nothing here writes."""


@dataclass(frozen=True)
class Part:
    """Shapes that move as one.

    Attributes
    ----------
    name : str
        The body's or massless link's.
    shapes : tuple of Shape
        In the part's own frame.
    poses : (3, T) or (7, T) array
        The coordinates of that frame at each time that is shown.
    """

    name: str
    shapes: tuple[Shape, ...]
    poses: Any

    def at(self, k: int) -> Iterator[Shape]:
        """Yield the shapes as they are seen at the k-th time that is shown."""
        for shape in self.shapes:
            pose = np.repeat(self.poses[:, [k]], shape.points.shape[1], axis=1)
            yield Shape(shape.role, seen(point_motion(tuple(shape.points), pose).r), shape.radius)


@dataclass(frozen=True)
class DrawnLink:
    """A massless link of space, or a cylinder, by the paths (d, T) of its ends: a `Part` would spin, or be rigid."""

    name: str
    ends: tuple[Any, Any]

    def at(self, k: int) -> Iterator[Shape]:
        """Yield the link and its pins as they are seen at the k-th time that is shown."""
        points = seen(np.stack([end[:, k] for end in self.ends], axis=1))
        yield Shape("link", points)
        for point in points.T:
            yield Shape("pin", point[:, None])


class Drawing:
    """The parts of a scene's mechanism, moved by an answer to it.

    Parameters
    ----------
    scene : Scene
    motion : Motion
        An answer that holds all bodies of the scene.

    Raises
    ------
    NothingToDraw
        If the motion has no pose, or lacks a body.

    Attributes
    ----------
    t : (T,) array
        The times that are shown [s]: those with a pose.
    parts : list of Part or DrawnLink
        The ground first.
    box : (2, 2) array
        Least and largest of all that is seen at any time, across and up [m].
    """

    def __init__(self, scene: Scene, motion: Motion) -> None:
        names = [body.name for body in scene.mechanism.bodies]
        if lacking := [name for name in names if name not in motion.bodies]:
            raise NothingToDraw(f"the motion has no {', '.join(lacking)}: a picture shows all bodies of the scene")
        shown = np.flatnonzero(np.all(np.isfinite(motion.q), axis=0))
        if not shown.size:
            raise NothingToDraw(f"no pose of {scene.name!r} was found: {motion.message or motion.verdict}")
        self.scene, self.t, self.status = scene, motion.t[shown], [motion.status[k] for k in shown]
        self._rates = [None if rate is None else rate[:, shown] for rate in (motion.qd, motion.qdd)]
        self._names = list(motion.bodies)
        self._kind = motion.kind
        still = np.repeat(np.array(self._kind.still)[:, None], len(shown), axis=1)
        self._poses = {GROUND: still} | {name: motion[name].q[:, shown] for name in self._names}
        self._size = scene.mechanism.size()
        self._points = points_of(scene)
        self.parts: list[Part | DrawnLink] = []
        self.parts += [Part(name, shapes, self._poses[name]) for name, shapes in shapes_of(scene).items()]
        self.parts += [self._link(e) for e in _seen_elements(scene) if isinstance(e, LINKS)]
        self.curves = [Shape("curve", seen(self._path(point.body, point.position))) for point in scene.points]
        self.box = self._box()

    def _path(self, body: str, point: Any) -> Any:
        """Return the path (2, T) or (3, T) of a point of a body [m]."""
        return point_motion(point, self._poses[body]).r

    def _link(self, element: Element) -> Part | DrawnLink:
        first, last = (self._path(body, point) for body, point in element.ends)
        if self._kind is SPACE or element.laws:
            return DrawnLink(element.name, (first, last))
        (xi, yi), (xj, yj) = first, last
        poses = np.array([xi, yi, np.unwrap(np.arctan2(yj - yi, xj - xi))])
        ends = np.array([[0.0, math.hypot(xj[0] - xi[0], yj[0] - yi[0])], [0.0, 0.0]])
        pins = [Shape("pin", end[:, None]) for end in ends.T]
        return Part(element.name, (Shape("link", ends), *pins), poses)

    def _box(self) -> Any:
        low, high = np.full(2, np.inf), np.full(2, -np.inf)
        every = (shape for k in range(len(self.t)) for part in self.parts for shape in part.at(k))
        for shape in every:
            if shape.role != "guide" or self._kind is SPACE:
                low = np.minimum(low, shape.points.min(axis=1) - shape.radius)
                high = np.maximum(high, shape.points.max(axis=1) + shape.radius)
        for curve in self.curves:
            low, high = np.minimum(low, curve.points.min(axis=1)), np.maximum(high, curve.points.max(axis=1))
        return np.array([low, high])

    def box_with(self, shapes: Sequence[Shape]) -> Any:
        """Return the box, grown by what these shapes need beyond it, as arrows do."""
        points = np.concatenate([self.box.T, *(shape.points for shape in shapes)], axis=1)
        return np.array([points.min(axis=1), points.max(axis=1)])

    def arrows(self, k: int, rate: str) -> list[Shape]:
        """Return velocities or accelerations of joint points and wanted points at the k-th time as arrows.

        Of each kind the largest at any time is `LONGEST`.

        Raises
        ------
        NothingToDraw
            If the motion does not hold that rate.
        """
        vectors = self._vectors(rate)
        longest = max((float(np.nanmax(np.hypot(*v), initial=0.0)) for _, v in vectors), default=0.0)
        scale = LONGEST * float(np.max(self.box[1] - self.box[0])) / longest if longest > 0 else 0.0
        return [
            Shape(rate, np.stack([path[:, k], path[:, k] + scale * v[:, k]], axis=1))
            for path, v in vectors
            if np.all(np.isfinite(v[:, k])) and scale * math.hypot(*v[:, k]) > 1e-3 * self._size
        ]

    def _vectors(self, rate: str) -> list[tuple[Any, Any]]:
        """Return the path (2, T) and the vectors (2, T) of each point of a moving body, as they are seen."""
        qd, qdd = self._rates
        order = RATES.index(rate)
        if qd is None or (order and qdd is None):
            raise NothingToDraw(f"the motion holds no {rate}: name it among the effects of the scene")
        width, vectors = self._kind.width, []
        for number, name in enumerate(self._names):
            rows = slice(width * number, width * (number + 1))
            for point in self._points[name]:
                moves = point_motion(
                    point, self._poses[name], qd[rows], qdd[rows] if order and qdd is not None else None
                )
                vectors.append((seen(moves.r), seen(moves.a if order else moves.v)))
        return vectors


def seen(points: Any) -> Any:
    """Return points (2, K) of a picture: those of the plane themselves, those of space by the view of `spatial`."""
    return VIEW @ points if len(points) == len(VIEW[0]) else points


def _seen_elements(scene: Scene) -> list[Element]:
    """Return what joints say, and which distances are driven: they look like links."""
    driven = (e for e in elements_of(scene.mechanism.constraints) if e.laws and isinstance(e, LINKS))
    return [*elements_of(scene.mechanism.joints), *driven]


def points_of(scene: Scene) -> dict[str, list[Any]]:
    """Return for the ground and each body the points where it is held or wanted, each once, in its own frame."""
    points: dict[str, list[Any]] = {GROUND: []} | {body.name: [] for body in scene.mechanism.bodies}
    ends = [end for element in _seen_elements(scene) for end in element.ends]
    for body, point in (*ends, *((p.body, p.position) for p in scene.points)):
        if point not in points[body]:
            points[body].append(point)
    return points


def shapes_of(scene: Scene) -> dict[str, tuple[Shape, ...]]:
    """Return what there is to see of the ground and of each body, in its own frame."""
    elements, kind, size = _seen_elements(scene), scene.mechanism.kind, scene.mechanism.size()

    def shapes(name: str, held: list[Any]) -> Iterator[Shape]:
        points = np.array(held, float).reshape(-1, kind.dimension).T
        if name != GROUND:
            yield _outline(points, size)
        elif kind is SPACE:
            yield from triad(size)
        if kind is SPACE:
            yield from features_of_joints(elements, name, size)
        for element in elements:
            yield from _features(element, name, size, points)
        for point in points.T:
            yield Shape("ground" if name == GROUND else "pin", point[:, None])

    return {name: tuple(shapes(name, held)) for name, held in points_of(scene).items()}


def _outline(points: Any, size: float) -> Shape:
    """Return a bar through two points, a plate through more, a small block around one or none."""
    if points.shape[1] > 1:
        return Shape("body", points)
    if len(points) == SPACE.dimension:
        return block(points, size)
    x, y = points[:, 0] if points.shape[1] else (0.0, 0.0)
    w, h = 0.06 * size, 0.035 * size
    return Shape("slider", np.array([[x - w, x + w, x + w, x - w], [y - h, y - h, y + h, y + h]]))


def _features(element: Element, name: str, size: float, points: Any) -> Iterator[Shape]:
    """Yield what an element adds to the outline of a body: a guide, a wheel, a profile."""
    if isinstance(element, GuidedPoint | RollingOnLine) and element.body_i == name:
        axis = np.array(element.axis_i) / math.hypot(*element.axis_i)
        offset = element.offset if isinstance(element, GuidedPoint) else 0.0
        foot = np.array(element.point_i) + offset * np.array([-axis[1], axis[0]])
        yield Shape("guide", foot[:, None] + np.outer(axis, [-1.5 * size, 1.5 * size]))
    if isinstance(element, RollingOnLine) and element.body_j == name:
        yield Shape("wheel", np.array(element.point_j, float)[:, None], abs(element.radius))
    if isinstance(element, RollingWheels) and name in (element.body_i, element.body_j):
        radius = element.radius_i if element.body_i == name else element.radius_j
        yield Shape("wheel", points[:, :1] if points.shape[1] else np.zeros((2, 1)), abs(radius))
    if isinstance(element, Contact) and element.body_i == name:
        first, last = np.clip(element.profile.domain(), -math.pi, math.pi)
        s = np.linspace(first, last, PROFILE_POINTS)
        d = np.array([float(element.profile(angle)) for angle in s])
        yield Shape("wheel", np.array(element.point_i, float)[:, None] + d * np.array([np.cos(s), np.sin(s)]))
    if isinstance(element, Contact) and element.body_j == name and element.roller_radius:
        yield Shape("wheel", np.array(element.point_j, float)[:, None], element.roller_radius)
