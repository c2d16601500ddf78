"""A mechanism of space as a tree of joints with loops to close: the form in which robotics engines hold it.

A spanning tree over the bodies, rooted in the ground, takes joints as its edges, first those that engines can only have
as edges (screws), last those that they close best (spherical joints). Bodies that no such joint reaches get a free
joint. A free or spherical edge has Euler parameters as its coordinates, which need not be of length 1: their length is
a row of the equations (`crosscheck.engines.spatial.system`), so that plain Newton on vectors stays plain Newton.
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from dataclasses import dataclass, field, replace
from functools import cached_property
from typing import Any

import numpy as np

from crosscheck.engines import Array, EngineError, EngineRefusal
from crosscheck.engines.spatial.kinds import JointKind
from crosscheck.engines.spatial.reading import MOVED, Drive, Hold, Numbers
from crosscheck.engines.spatial.turning import about_z, body_columns, matrix, parameters
from refkin.joints import GROUND

WIDTH = {
    **dict.fromkeys((JointKind.REVOLUTE, JointKind.PRISMATIC, JointKind.SCREW), 1),
    **dict.fromkeys((JointKind.CYLINDRICAL, JointKind.UNIVERSAL), 2),
    **{JointKind.FIXED: 0, JointKind.SPHERICAL: 4, JointKind.FREE: 7},
}
"""How many coordinates an edge has: angles [rad], lengths (a shift before its turn), Euler parameters."""
TURNED = (JointKind.SPHERICAL, JointKind.FREE)
"""What has Euler parameters."""
PREFERENCE = (
    JointKind.SCREW,
    JointKind.FIXED,
    JointKind.PRISMATIC,
    JointKind.CYLINDRICAL,
    JointKind.UNIVERSAL,
    JointKind.REVOLUTE,
    JointKind.SPHERICAL,
)
"""Which joints become edges first; those that a driver moves, or whose turns count, come before all of them."""
QUARTER = np.array([[0.0, 0.0, 1.0], [1.0, 0.0, 0.0], [0.0, 1.0, 0.0]])
"""What leads from the first axis of a universal joint to the second: z becomes x."""
OVER = np.diag([1.0, -1.0, -1.0])
"""Half a turn about f, which turns the axis round: OVER Rz(q) OVER = Rz(-q)."""


@dataclass(frozen=True, kw_only=True)
class SpatialEdge:
    """How a body hangs on its parent: joint frames on both, and what its coordinates, from `first` on, do between them.

    Where the parent is body j of the joint, both frames are turned over (`OVER`), so that angles and shifts are all
    the same those of the joint, from i to j.
    """

    body: str
    parent: str
    kind: JointKind
    u_parent: Any = field(default_factory=lambda: np.zeros(3))
    frame_parent: Any = field(default_factory=lambda: np.eye(3))
    u_body: Any = field(default_factory=lambda: np.zeros(3))
    frame_body: Any = field(default_factory=lambda: np.eye(3))
    pitch: float = 0.0
    shift: float = 0.0
    hold: str = ""
    first: int = 0

    @property
    def slot(self) -> slice:
        """Where its coordinates are among those of the tree."""
        return slice(self.first, self.first + WIDTH[self.kind])

    @property
    def turned(self) -> slice:
        """Where its Euler parameters are; empty if it has none."""
        return slice(self.slot.stop - 4, self.slot.stop) if self.kind in TURNED else slice(0, 0)

    @property
    def rates(self) -> int:
        """How many rates it has: three of a turn by Euler parameters."""
        return WIDTH[self.kind] - (self.kind in TURNED)


@dataclass(frozen=True, kw_only=True)
class SpaceTree:
    """Edges, parents before children; `closures` are the joints that are none; `estimates` poses (7,) of the bodies."""

    numbers: Numbers
    edges: tuple[SpatialEdge, ...]
    closures: tuple[Hold, ...]
    estimates: Mapping[str, Any]

    @cached_property
    def width(self) -> int:
        """The number n of coordinates."""
        return sum(WIDTH[edge.kind] for edge in self.edges)

    @cached_property
    def balls(self) -> list[slice]:
        """Where Euler parameters are among the coordinates."""
        return [edge.turned for edge in self.edges if edge.kind in TURNED]

    def edge_of(self, drive: Drive) -> SpatialEdge | None:
        """Return the edge that a driver moves, if its joint has become one."""
        edges = (edge for edge in self.edges if (edge.hold, edge.kind) == (drive.hold.name, drive.hold.kind))
        return next((edge for edge in edges if edge.kind in MOVED.get(drive.kind, ())), None)

    def turn_of(self, joint: str) -> int:
        """Return the coordinate that is the turn of a joint; EngineRefusal if the joint is none of the tree."""
        for edge in self.edges:
            if edge.hold == joint and edge.kind in MOVED[JointKind.ANGLE]:
                return edge.first + (edge.kind == JointKind.CYLINDRICAL)
        raise EngineRefusal(f"a gear counts the turns of {joint!r}, which closes a loop: only those of a tree count")

    def rates(self, q: Array) -> Array:
        """Return the matrices (..., v, n) that make rates of joints, turns in the body's own axes, of q' (..., n)."""
        plain, balls = self._plain
        out = np.empty((*q.shape[:-1], *plain.shape))
        out[...] = plain
        for rows, ball in balls:
            out[..., rows, ball] = body_columns(q[..., ball])
        return out

    @cached_property
    def _plain(self) -> tuple[Array, list[tuple[slice, slice]]]:
        """Return what of `rates` is the same at all poses, and where the rest goes: rows of a turn, its parameters."""
        out, balls, row = np.zeros((sum(edge.rates for edge in self.edges), self.width)), [], 0
        for edge in self.edges:
            single = edge.rates - (3 if edge.turned.stop else 0)
            out[row : row + single, edge.first : edge.first + single] = np.eye(single)
            if edge.turned.stop:
                balls.append((slice(row + single, row + edge.rates), edge.turned))
            row += edge.rates
        return out, balls

    def start(self) -> Array:
        """Return the coordinates nearest the bodies' estimates; EngineError if a body has none."""
        return self._nearest.copy()

    @cached_property
    def _nearest(self) -> Array:
        q = np.zeros(self.width)
        poses = {GROUND: (np.zeros(3), np.eye(3))}
        for body, estimate in self.estimates.items():
            if estimate is None:
                raise EngineError(f"body {body!r} has no estimate: a joint tree is closed from one of every body")
            poses[body] = (estimate[:3], matrix(estimate[3:]))
        for edge in self.edges:
            q[edge.slot] = _coordinates(edge, poses[edge.parent], poses[edge.body])
        return q


def longest_chain(edges: Iterable[Any]) -> int:
    """Return how many bodies the longest chain of a tree's edges has, parents before children."""
    depths = {GROUND: 0}
    for edge in edges:
        depths[edge.body] = depths[edge.parent] + 1
    return max(depths.values())


def _coordinates(edge: SpatialEdge, parent: tuple[Any, Any], body: tuple[Any, Any]) -> Any:
    """Return an edge's coordinates nearest two poses (place, rotation)."""
    turned = parent[1] @ edge.frame_parent
    relative = turned.T @ body[1] @ edge.frame_body
    gap = turned.T @ (body[0] + body[1] @ edge.u_body - parent[0] - parent[1] @ edge.u_parent)
    angle = _about_z(relative)
    if edge.kind == JointKind.FREE:
        return [*body[0], *parameters(body[1])]
    if edge.kind == JointKind.SPHERICAL:
        return parameters(relative)
    if edge.kind == JointKind.UNIVERSAL:
        first = np.arctan2(relative[1, 2], relative[0, 2])
        return [first, _about_z(QUARTER.T @ about_z(first).T @ relative)]
    if edge.kind == JointKind.SCREW:
        turns = np.round(((gap[2] - edge.shift) / edge.pitch - angle) / (2 * np.pi)) if edge.pitch else 0.0
        return [angle + 2 * np.pi * turns]
    along = [gap[2]] * (edge.kind in (JointKind.PRISMATIC, JointKind.CYLINDRICAL))
    return [*along, *[angle] * (edge.kind in (JointKind.REVOLUTE, JointKind.CYLINDRICAL))]


def _about_z(rotation: Any) -> float:
    return float(np.arctan2(rotation[1, 0] - rotation[0, 1], rotation[0, 0] + rotation[1, 1]))


def space_tree(numbers: Numbers, estimates: Mapping[str, Any]) -> SpaceTree:
    """Return the tree of a mechanism."""
    driven = {drive.hold.name for drive in numbers.drives} | numbers.counted
    order = sorted(
        (hold for hold in numbers.holds if hold.kind in PREFERENCE),
        key=lambda hold: (hold.name not in driven, PREFERENCE.index(hold.kind)),
    )
    edges: list[SpatialEdge] = []
    used, reached = list[Hold](), [GROUND]
    while len(reached) <= len(numbers.bodies):
        hold = next((h for h in order if (h.body_i in reached) != (h.body_j in reached)), None)
        if hold is None:
            body = next(name for name in numbers.bodies if name not in reached)
            edge = SpatialEdge(body=body, parent=GROUND, kind=JointKind.FREE)
        else:
            edge = _edge(hold, hold.body_i if hold.body_i in reached else hold.body_j)
            used.append(hold)
        edges.append(replace(edge, first=sum(WIDTH[before.kind] for before in edges)))
        reached.append(edge.body)
    closures = tuple(hold for hold in numbers.holds if not any(hold is edge for edge in used))
    return SpaceTree(numbers=numbers, edges=tuple(edges), closures=closures, estimates=dict(estimates))


def absolute_tree(numbers: Numbers) -> SpaceTree:
    """Return the tree in which every body is free: its coordinates are (r, p) of each body in turn."""
    free: Any = {"parent": GROUND, "kind": JointKind.FREE}
    edges = tuple(SpatialEdge(body=body, first=7 * k, **free) for k, body in enumerate(numbers.bodies))
    return SpaceTree(numbers=numbers, edges=edges, closures=numbers.holds, estimates={})


def _edge(hold: Hold, parent: str) -> SpatialEdge:
    body, over = hold.other(parent), np.eye(3) if parent == hold.body_i else OVER
    (u_parent, frame_parent), (u_body, frame_body) = hold.end(parent), hold.end(body)
    return SpatialEdge(
        body=body, parent=parent, kind=hold.kind, u_parent=u_parent, frame_parent=frame_parent @ over,
        u_body=u_body, frame_body=frame_body @ over, pitch=hold.pitch, shift=hold.shift, hold=hold.name,
    )  # fmt: skip
