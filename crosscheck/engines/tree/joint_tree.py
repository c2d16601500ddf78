"""A mechanism as a tree of joints with loops to close: the form in which robotics engines hold it.

`joint_tree` reads a mechanism's topology and its own numbers; nothing here states a constraint. A spanning tree over
the bodies, rooted in the ground, takes as its edges the joints whose elements are those of one (`SHAPES`); the elements
of the others are left to be closed (`march`), and those that a law moves are rows to be appended
(`tree_system`). Bodies that no such joint ties to the ground get a free planar joint (x, y, phi) to it.
Lengths are in units of the mechanism's size and seen from its first ground point, so that neither the scale nor the
distance from the origin costs digits; any power of two and any origin would serve, as the way back undoes both.
"""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from enum import StrEnum
from functools import cached_property
from typing import Any

import numpy as np
from numpy.typing import NDArray

from crosscheck.engines import EngineError, EngineRefusal, in_space
from crosscheck.engines.frames import direction, through_its_point
from refkin.joints import GROUND, Element, GuidedPoint, Pair, PointDistance, PointsCoincide, RelativeAngle, elements_of
from refkin.model import Mechanism

Array = NDArray[np.float64]
Pose = tuple[float, float, float]


class Freedom(StrEnum):
    """What an edge of the tree lets a body do against its parent."""

    TURN = "turn"
    """Turn about a point: one angle."""
    SLIDE = "slide"
    """Move along a line: one length."""
    NONE = "none"
    """Nothing."""
    FREE = "free"
    """Everything: the body hangs on no joint."""


WIDTH = {Freedom.TURN: 1, Freedom.SLIDE: 1, Freedom.NONE: 0, Freedom.FREE: 3}
"""How many coordinates an edge has: an angle [rad]; a length; none; x, y and an angle."""
SHAPES: Mapping[tuple[type[Element], ...], Freedom] = {
    (PointsCoincide,): Freedom.TURN,
    (PointsCoincide, RelativeAngle): Freedom.NONE,
    (GuidedPoint, RelativeAngle): Freedom.SLIDE,
}
"""What a joint of these elements, all between the same two bodies, leaves free."""
Joint = tuple[Element, ...]
"""What a joint holds at all times: those of its elements that no law moves."""


@dataclass(frozen=True, kw_only=True)
class Edge:
    """How a body hangs on its parent: pose = parent's pose . shift(point) . turn(angle) . freedom(q) . shift(-pin).

    The parent is the ground or the body of an earlier edge. TURN is turned by q, SLIDE shifted by q times `axis`, FREE
    shifted by q[0], q[1] and turned by q[2]. `point` and `pin` are the joint's point on parent and body, each in its
    own frame, in units of the size; `angle` [rad] is constant between the two; the unit vector `axis` is in the body's
    own frame. The edge's coordinates begin at `first` in the tree's q.
    """

    body: str
    parent: str
    freedom: Freedom
    point: Pair = (0.0, 0.0)
    angle: float = 0.0
    pin: Pair = (0.0, 0.0)
    axis: Pair = (1.0, 0.0)
    first: int = 0


@dataclass(frozen=True, kw_only=True)
class JointTree:
    """Edges, parents before children, one per body; and what is left to be closed.

    `closures` are elements of the joints that are no edge, in the scene's own numbers (metres): read their points
    through `scaled`. `driven` are those that a law moves, of joints and drivers. `size` [m] is the unit of length,
    `origin` [m] the ground point that is the tree's. Massless `links` stand for distances: they are bodies of the tree,
    but not of the scene.
    """

    edges: tuple[Edge, ...]
    closures: tuple[Element, ...]
    driven: tuple[Element, ...]
    size: float
    origin: Pair
    estimates: Mapping[str, Pose | None]
    links: Mapping[str, PointDistance]

    @cached_property
    def width(self) -> int:
        """The number n of tree coordinates."""
        return sum(WIDTH[edge.freedom] for edge in self.edges)

    @cached_property
    def angle_rows(self) -> dict[str, Array]:
        """Body -> (n,) row of zeros and ones: d(phi of the body)/dq. The ground's is zero."""
        rows = {GROUND: np.zeros(self.width)}
        for edge in self.edges:
            rows[edge.body] = rows[edge.parent].copy()
            if edge.freedom in (Freedom.TURN, Freedom.FREE):
                rows[edge.body][edge.first + WIDTH[edge.freedom] - 1] = 1.0
        return rows

    @cached_property
    def angle_offsets(self) -> dict[str, float]:
        """Body -> phi at q = 0 [rad]: the sum of the constant angles on the way to it, up to full turns after a turn.

        A coordinate that turns takes no full turns over from a constant angle: it would be as large as they are, and
        its rounding with it.
        """
        offsets = {GROUND: 0.0}
        for edge in self.edges:
            turns = edge.freedom is Freedom.TURN
            offsets[edge.body] = _within_a_turn(offsets[edge.parent]) if turns else offsets[edge.parent] + edge.angle
        return offsets

    def angle(self, body: str, q: Array) -> Any:
        """Return phi [rad] of a body with its turns: the sum of the angles on the way to it; q is (n,) or (n, T)."""
        return self.angle_offsets[body] + self.angle_rows[body] @ q

    def turned(self, edge: Edge) -> float:
        """Return by how much phi of an edge's body differs from its parent's at q = 0 [rad]."""
        return self.angle_offsets[edge.body] - self.angle_offsets[edge.parent]

    def turn(self, e: RelativeAngle) -> tuple[Array, float]:
        """Return the row (n,) and the constant [rad] of the angle of body j against body i."""
        (i, j), rows, offsets = e.bodies, self.angle_rows, self.angle_offsets
        return rows[j] - rows[i], offsets[j] - offsets[i]

    def scaled(self, body: str, u: Pair) -> Pair:
        """Return a point of a body in units of the size; on the ground, seen from the tree's origin."""
        ox, oy = self.origin if body == GROUND else (0.0, 0.0)
        return (u[0] - ox) / self.size, (u[1] - oy) / self.size

    def start(self) -> Array:
        """Return the tree coordinates (n,) nearest the bodies' estimates; EngineError if a body has none."""
        poses = dict(self._estimated_poses())
        q = np.zeros(self.width)
        for edge in self.edges:
            body = poses[edge.body]
            slot = slice(edge.first, edge.first + WIDTH[edge.freedom])
            if edge.freedom is Freedom.FREE:
                q[slot] = body
            elif edge.freedom is Freedom.TURN:
                q[slot] = body[2] - poses[edge.parent][2] - self.turned(edge)
            elif edge.freedom is Freedom.SLIDE:
                (px, py), (bx, by) = _point(poses[edge.parent], edge.point), _point(body, edge.pin)
                ax, ay = _point((0.0, 0.0, body[2]), edge.axis)
                q[slot] = ax * (bx - px) + ay * (by - py)
        return q

    def _estimated_poses(self) -> Iterator[tuple[str, Pose]]:
        poses: dict[str, Pose] = {GROUND: (0.0, 0.0, 0.0)}
        for body, estimate in self.estimates.items():
            if estimate is None:
                raise EngineError(f"body {body!r} has no estimate: a joint tree is closed from one of every body")
            poses[body] = (*self.scaled(GROUND, estimate[:2]), estimate[2])
        for link, distance in self.links.items():
            (xi, yi), (xj, yj) = (_point(poses[body], self.scaled(body, point)) for body, point in distance.ends)
            poses[link] = (xi, yi, math.atan2(yj - yi, xj - xi))
        yield from poses.items()


def joint_tree(mechanism: Mechanism, *, massless_links: bool = False) -> JointTree:
    """Return the tree of a mechanism, breadth first from the ground, so that chains are short.

    Parameters
    ----------
    mechanism : Mechanism
        Its joints become edges or closures; what laws move are rows to be appended (`tree_system`).
    massless_links : bool
        Whether each distance becomes a body of its length that is pinned at either end, for an engine that has no
        distance constraint. Such a body lies along its own x axis, from point_i to point_j.
    """
    if in_space(mechanism):
        raise EngineRefusal("this method is refused in space: the adapter has its joint tree for the plane alone")
    unit = mechanism.unit()
    joints = [tuple(e for e in elements_of([c]) if not e.laws) for c in mechanism.constraints]
    links: dict[str, PointDistance] = {}
    names = [body.name for body in mechanism.bodies]
    if massless_links:
        joints, links = _with_links(joints, names)
    bare = JointTree(
        edges=(),
        closures=(),
        driven=tuple(e for e in elements_of(mechanism.constraints) if e.laws),
        size=unit.size,
        origin=unit.origin,
        estimates={body.name: body.estimate for body in mechanism.bodies},  # type: ignore[misc]
        links=links,
    )
    edges, used = _span(bare, [*names, *links], joints)
    closures = tuple(element for k, joint in enumerate(joints) if k not in used for element in joint)
    return replace(bare, edges=tuple(edges), closures=closures)


def absolute_tree(bodies: Sequence[str], size: float = 1.0) -> JointTree:
    """Return the tree in which every body is free on the ground, so that its q is (x, y, phi) per body."""
    free = tuple(Edge(body=b, parent=GROUND, freedom=Freedom.FREE, first=3 * k) for k, b in enumerate(bodies))
    return JointTree(edges=free, closures=(), driven=(), size=size, origin=(0.0, 0.0), estimates={}, links={})


def _with_links(joints: Sequence[Joint], names: Sequence[str]) -> tuple[list[Joint], dict[str, PointDistance]]:
    """Return the joints with every distance replaced by two pins, and body name -> distance."""
    kept: list[Joint] = []
    links: dict[str, PointDistance] = {}
    for joint in joints:
        for distance in (element for element in joint if isinstance(element, PointDistance)):
            link = f"link of {distance.name}"
            while link in (*names, *links):
                link += "'"
            links[link] = distance
            for side, (body, point), end in zip("ij", distance.ends, (0.0, distance.length), strict=True):
                name = f"{distance.name}, end {side}"
                pin = PointsCoincide(name=name, body_i=body, point_i=point, body_j=link, point_j=(end, 0.0))
                kept.append((pin,))
        kept.append(tuple(element for element in joint if not isinstance(element, PointDistance)))
    return kept, links


def _span(tree: JointTree, bodies: Sequence[str], joints: Sequence[Joint]) -> tuple[list[Edge], set[int]]:
    """Return the edges of a spanning forest, its roots on the ground, and the indices of the joints they use."""
    edges: list[Edge] = []
    used: set[int] = set()
    reached = [GROUND]

    def hang(edge: Edge) -> None:
        width = sum(WIDTH[before.freedom] for before in edges)
        edges.append(replace(edge, first=width))
        reached.append(edge.body)

    frontier = 0
    while frontier < len(reached) or len(edges) < len(bodies):
        if frontier == len(reached):  # nothing more hangs on what was reached: the next body floats
            body = next(name for name in bodies if name not in reached)
            hang(Edge(body=body, parent=GROUND, freedom=Freedom.FREE))
        parent = reached[frontier]
        for k, joint in enumerate(joints):
            edge = _edge(tree, joint, parent)
            if edge is not None and edge.body not in reached:
                hang(edge)
                used.add(k)
        frontier += 1
    return edges, used


def _edge(tree: JointTree, joint: Joint, parent: str) -> Edge | None:
    """Return the edge by which the other body of a joint hangs on `parent`, or None if the joint makes none."""
    freedom = SHAPES.get(tuple(map(type, joint)))
    if freedom is None or parent not in joint[0].bodies or joint[0].bodies != joint[-1].bodies:
        return None
    e: Any = joint[0] if freedom is not Freedom.SLIDE else through_its_point(joint[0])  # type: ignore[arg-type]
    forward = parent == e.body_i
    (_, point), (body, pin) = e.ends if forward else reversed(e.ends)
    said: dict[str, Any] = {"point": tree.scaled(parent, point), "pin": tree.scaled(body, pin)}
    turned: Any = joint[-1]
    if freedom is not Freedom.TURN:
        said["angle"] = turned.angle if forward else -turned.angle
    if freedom is Freedom.SLIDE:  # on the parent; the body is turned against it
        axis = direction(e.axis_i)
        said["axis"] = _point((0.0, 0.0, -turned.angle), axis) if forward else axis
    return Edge(body=body, parent=parent, freedom=freedom, **said)


def _within_a_turn(angle: float) -> float:
    """Return an angle less full turns, to its own last digit: sine and cosine reduce by more digits of pi than a float.

    An angle of less than half a turn stays as it is.
    """
    return angle if abs(angle) <= math.pi else math.atan2(math.sin(angle), math.cos(angle))


def _point(pose: Pose, u: Pair) -> Pair:
    """Return a point of a body in the ground frame."""
    x, y, phi = pose
    c, s = math.cos(phi), math.sin(phi)
    return x + c * u[0] - s * u[1], y + s * u[0] + c * u[1]


def in_order(q: Array, columns: Array) -> Array:
    """Return coordinates or rates (..., n) of a tree in the order of an engine's, which have these columns."""
    out = np.empty_like(q)
    out[..., columns] = q
    return out
