"""The motion of a scene of space from an engine's joint tree: coordinates (r, p) of bodies and their rates.

And an engine's own rows of space where nothing is assembled: every body free, columns (v, w): a `ConstraintModel`.
Lengths are metres of the scene. Of the joints only what the engine holds by constraints of its own is here: two points
that are one (`SpaceEngine.pairs`), and where the engine has it the rotations of a weld (`WeldEngine.welded`), which are
half-angle rows.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from crosscheck.engines import ConstraintModel, KeptModel, Level, Term, answered
from crosscheck.engines.frames import RowMap
from crosscheck.engines.march import Closing, MarchResult, march, one_by_one
from crosscheck.engines.spatial.kinds import JointKind
from crosscheck.engines.spatial.reading import AXIAL, MEETING, Hold, Numbers, numbers_of
from crosscheck.engines.spatial.system import Place, SpaceSystem
from crosscheck.engines.spatial.tree import absolute_tree, space_tree
from crosscheck.engines.spatial.turning import bends, continuous, matrix, parameters, rates
from crosscheck.scenes.names import order_of
from refkin.joints import SI
from refkin.model import Mechanism, Scene
from refkin.motion import Motion, Producer

Array = Any


@dataclass(frozen=True)
class SpaceScene:
    """A scene of space as an engine's joint tree: what Newton on its rows starts from, and how its answer is read."""

    scene: Scene
    numbers: Numbers
    system: SpaceSystem

    @classmethod
    def of(cls, scene: Scene, build: Callable[..., Any]) -> SpaceScene:
        """Return a scene as a tree; raises EngineError where a body has no estimate, or a joint is refused."""
        numbers = numbers_of(scene.mechanism)
        return cls(scene, numbers, SpaceSystem(space_tree(numbers, estimates(scene, numbers)), build))

    def start(self) -> Array:
        """Return the tree's coordinates nearest the estimates."""
        return self.system.start(self.scene.times[0])

    def motion(self, poses: MarchResult, producer: Producer) -> Motion:
        """Return what the scene wants of tree coordinates that were found in whatever way, at the levels they have."""
        levels = _levels(self.system, poses.levels)
        return reported(self.scene, self.numbers, levels, poses.status, producer, residual=poses.residual)

    def read(self, levels: Sequence[Array]) -> list[Array]:
        """Return tree coordinates and rates (n, T) as those of all bodies, (7 b, T) [m]."""
        return [self.numbers.levels(level, order) for order, level in enumerate(_levels(self.system, levels))]


class SpaceMotion(KeptModel):
    """A scene of space in an engine's joint tree, asked for the motion of the bodies and points that it wants.

    Parameters
    ----------
    scene, build, producer : Scene, callable, Producer
        `build` makes an engine's model of a tree, its places and pairs (`SpaceEngine`).
    own : callable, optional
        What closes the tree by means of the engine's own, pose by pose, positions alone; by default `march` does.
    """

    def __init__(
        self,
        scene: Scene,
        build: Callable[..., Any],
        producer: Producer,
        own: Callable[[SpaceSystem], Closing] | None = None,
    ) -> None:
        self.tree, self.producer = SpaceScene.of(scene, build), producer
        self.own = own and own(self.tree.system)

    def solve(self, scene: Scene) -> Motion:
        tree = replace(self.tree, scene=scene)
        if self.own is not None:
            poses = one_by_one(self.own, tree.start(), scene.times)
        else:
            together = not tree.numbers.passive
            poses = march(tree.system, tree.start(), scene.times, order_of(scene), together=together)
        return tree.motion(poses, self.producer)


def estimates(scene: Scene, numbers: Numbers) -> dict[str, Any]:
    """Return the estimated pose (7,) of each body in the numbers' unit, None where there is none."""
    return {b.name: None if b.estimate is None else numbers.scaled(b.estimate) for b in scene.mechanism.bodies}


def _levels(system: SpaceSystem, levels: Sequence[Array]) -> list[Array]:
    """Return per level (r, p) of all bodies or its derivative, (7 n, T), in the numbers' unit."""
    count, times = len(system.tree.numbers.bodies), levels[0].shape[1]
    r, w = np.full((3, times, count, 3), np.nan), np.full((2, times, count, 3), np.nan)
    p = np.full((times, count, 4), np.nan)
    known = np.isfinite(levels[0]).all(axis=0)
    if known.any():
        q, qd, qdd = [*(level[:, known].T for level in levels), None, None][:3]
        r[0, known], turned, *moving = system.bodies(q, qd, qdd)
        p[known] = parameters(turned)
        for order, motion in enumerate(moving[: len(levels) - 1], 1):
            r[order, known], w[order - 1, known] = motion[..., :3], motion[..., 3:]
    return coordinates(r, p, w)[: len(levels)]


def coordinates(r: Array, p: Array, w: Array) -> list[Array]:
    """Return (r, p) and its two derivatives, (7 n, T) each, with Euler parameters continuous in sign.

    Parameters
    ----------
    r, p, w : (3, T, n, 3), (T, n, 4), (2, T, n, 3) array
        Origins with velocities and accelerations; Euler parameters of either sign; angular velocity and acceleration in
        the ground frame.
    """
    p = np.stack([continuous(p[:, k]) for k in range(p.shape[1])], axis=1)
    turns = (p, rates(p, w[0]), bends(p, w[0], w[1]))
    return [np.concatenate(level, axis=2).reshape(len(p), -1).T for level in zip(r, turns, strict=True)]


def reported(
    scene: Scene, numbers: Numbers, levels: list[Array], status: Any, producer: Producer, **more: Any
) -> Motion:
    """Return what a scene wants of the motion of all bodies, in metres.

    Parameters
    ----------
    scene, numbers, producer : Scene, Numbers, Producer
    levels, status : list of (7 b, T) array, sequence of Status
        Positions, and as many rates as there are, in the numbers' unit; one status per time.
    **more
        Of `answered`.
    """
    wanted = [7 * numbers.bodies.index(body) + k for body in scene.wanted for k in range(7)]
    known = [numbers.levels(level, order) for order, level in enumerate(levels)]
    places = ((p.position, 7 * numbers.bodies.index(p.body)) for p in scene.points)
    points = (_point_levels(u, [level[k : k + 7] for level in known]) for u, k in places)
    return answered(scene, [level[wanted] for level in known], points, status, producer, **more)


def _point_levels(u: Any, at: list[Array]) -> list[Array]:
    """Return how a point [m] of a body moves: A(p) u is a quadratic form, of which rates follow by its bilinear one."""
    (p, *rates), u = [level[3:] for level in at], np.asarray(u, float)
    turned = [_form(p, p, u), *(2.0 * _form(p, rate, u) for rate in rates)]
    if len(rates) > 1:
        turned[2] += 2.0 * _form(rates[0], rates[0], u)
    return [level[:3] + turn for level, turn in zip(at, turned, strict=True)]


def _form(p: Array, s: Array, u: Array) -> Array:
    """Return B(p, s) u (3, T), with A(p) u = B(p, p) u."""
    e, c, v = p[1:], s[1:], u[:, None]
    dot = np.sum(e * c, axis=0)
    along = e * (u @ c) + c * (u @ e)
    turn = np.cross((p[0] * c + s[0] * e).T, u).T
    return (p[0] * s[0] - dot) * v + along + turn


SPATIAL_VECTORS = tuple(
    Term(
        name="spatial vectors",
        level=level.value,
        reason="lever arms are differences of positions in the ground frame, and omega x v enters with both signs: "
        "8 roundings, two bodies",
        relative=16.0 * 2.0**-53,
    )
    for level in (Level.JACOBIAN, Level.CONSTRAINT_VELOCITY, Level.DRIFT)
)
"""What an engine adds to rows that composes spatial vectors in the ground frame."""


class SpaceRows(ConstraintModel):
    """An engine's rows for the joints of a mechanism; `build` is as for `SpaceSystem`.

    `welds` is what its rotation rows of a weld are of the half-angle rows, up to the sign of the Euler parameters; None
    if it has no weld.
    """

    owns_driver = False
    form = "half"

    def __init__(self, mechanism: Mechanism, build: Callable[..., Any], welds: float | None = None) -> None:
        self.numbers: Numbers = numbers_of(mechanism, SI)
        known = {joint.name for joint in mechanism.joints}
        holds = [hold for hold in self.numbers.holds if hold.name in known]
        self.places: list[Place] = []
        meeting = [hold for hold in holds if hold.kind in MEETING]
        welded = [hold for hold in holds if hold.kind in ROTATIONS] if welds is not None else []
        pairs, turned = ([self._ends(hold) for hold in group] for group in (meeting, welded))
        self.tree = absolute_tree(self.numbers)
        extra = {"welds": turned} if welds is not None else {}
        self.engine = build(self.tree, self.places, pairs, **extra)
        self._turned = bool(turned)
        self.rows: Sequence[RowMap] = tuple(_maps(meeting, welded, welds or 1.0))

    def _ends(self, hold: Hold) -> tuple[int, int]:
        for body in hold.bodies:
            self.places.append(Place(body, *hold.end(body)))
        return len(self.places) - 2, len(self.places) - 1

    def residual(self, q: Array, t: float) -> Array:
        return self._stacked(self.engine.still(q[None]).gap[0], q, 0)

    def jacobian(self, q: Array, t: float) -> Array:
        return self._stacked(self.engine.still(q[None]).gap_jac[0], q, 1) @ self._to_body(q)

    def constraint_velocity(self, q: Array, qd: Array, t: float) -> Array:
        """Return the rates of the rows (m,), by the engine's velocities."""
        rates = self.tree.rates(q) @ qd
        vel = self.engine.moving(q[None], rates[None], None)[0][0]
        pairs = np.array(self.engine.pairs, int).reshape(-1, 2)
        return self._stacked(vel[pairs[:, 1], :3] - vel[pairs[:, 0], :3], q, 2, rates)

    def drift(self, q: Array, qd: Array, t: float) -> Array:
        """Return gamma (m,): minus the second derivative of the rows while v' and w' are zero."""
        rates = self.tree.rates(q) @ qd
        return -self._stacked(self.engine.moving(q[None], rates[None], None)[2][0], q, 3, rates)

    def _stacked(self, gaps: Array, q: Array, what: int, rates: Array = None) -> Array:
        """Return the rows of pairs, then of welds: residual, Jacobian, velocity or second derivative (0 to 3)."""
        rows = np.reshape(gaps, (-1, *np.shape(gaps)[2:]))
        if not self._turned:
            return rows
        still = np.zeros(len(self.tree.rates(q))) if rates is None else rates
        turned = self.engine.welded(q[None], still[None])[what][0]
        return np.concatenate([rows, turned.reshape(-1, *turned.shape[2:])])

    def _to_body(self, q: Array) -> Array:
        """Return the matrix that makes rates of a free body in the engine, (v, w in its own axes), of (v, w)."""
        out = np.eye(6 * len(self.numbers.bodies))
        for k, pose in enumerate(np.reshape(q, (-1, 7))):
            turn = slice(6 * k + 3, 6 * k + 6)
            out[turn, turn] = matrix(pose[3:]).T
        return out


def _maps(meeting: Sequence[Hold], welded: Sequence[Hold], factor: float) -> list[RowMap]:
    maps = [
        RowMap(constraint=h.name, row=h.rows[k], engine_row=3 * n + k) for n, h in enumerate(meeting) for k in range(3)
    ]
    first = 3 * len(meeting)
    for n, hold in enumerate(welded):
        maps += [
            RowMap(constraint=hold.name, row=hold.rows[at], engine_row=first + 3 * n + k, factor=factor, either=True)
            for k, at in ROTATIONS[hold.kind].items()
        ]
    return maps


_AXES = {0: 0, 1: 1}
ROTATIONS: dict[JointKind, dict[int, int]] = {
    **dict.fromkeys(AXIAL, _AXES),
    JointKind.REVOLUTE: {0: 3, 1: 4},
    JointKind.FIXED: {0: 3, 1: 4, 2: 5},
    JointKind.PRISMATIC: _AXES | {2: 4},
    JointKind.ORIENTATION: _AXES | {2: 2},
    JointKind.TURN: {2: 0},
    JointKind.TWIST: {2: 0},
}
"""Rotation of a weld -> which of a joint's rows it is."""
