"""The equations of a joint tree, and its motion: an engine's rows for its loops, and the adapter's for what laws move.

An engine supplies rows for the joints that its tree leaves open, and the motion of points (`TreeEngine`). Driven rows
are appended here, the same way for every engine; `march` solves the whole, for every engine
that has no loop solver.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from functools import partial
from math import sqrt
from typing import Any, Protocol

import numpy as np

from crosscheck.engines import (
    ConstraintModel,
    EngineError,
    KeptModel,
    Level,
    SimulatingAdapter,
    Term,
    answered,
    expressed,
    in_space,
    refusals,
    refuse,
)
from crosscheck.engines.march import Closing, MarchResult, march, one_by_one
from crosscheck.engines.poses import EPS, Tabulated
from crosscheck.engines.spatial.tree import longest_chain
from crosscheck.engines.tree.joint_tree import Array, JointTree
from crosscheck.scenes.names import order_of
from refkin.joints import GROUND, Constraint, Element, Pair, PointCoordinate, PointDistance, RelativeAngle, elements_of
from refkin.model import Mechanism, Scene
from refkin.motion import Motion, Producer
from refkin.motion_laws import Law

Places = Sequence[tuple[str, Pair]]
"""Points of bodies, each in its body's own frame."""


class TreeEngine(Protocol):
    """An engine's model of a `JointTree`, in the tree's coordinates, unit of length and origin, at B poses at once.

    Arrays are fresh copies. Points are given in their body's own frame, in units of the size; never on the ground. The
    tree's closures have c = `closure_rows` rows.
    """

    tree: JointTree
    closure_rows: int

    def closure(self, q: Array, places: Places) -> tuple[Array, Array, Array, Array]:
        """Return the residual (B, c) of the closures at q (B, n), and its Jacobian (B, c, n).

        Then points in the ground frame, (B, P, 2), and their Jacobians, (B, P, 2, n).
        """

    def closure_drift(self, q: Array, qd: Array, places: Places) -> tuple[Array, ...]:
        """Return gamma of the closures (B, c), which is Jacobian times qdd.

        Then of points, (B, P, 2) each, if there are any: positions, velocities, and accelerations at qdd = 0.
        """

    def motion(self, q: Array, qd: Array | None, qdd: Array | None, places: Places) -> list[Array]:
        """Return position, velocity and acceleration (B, P, 2) of points of bodies, as far as rates are given."""


class TreeAdapter(SimulatingAdapter):
    """An adapter of an engine that holds mechanisms as joint trees.

    `rows_of_space` makes the engine's rows of a mechanism of space, `rows_of_plane` those of some joints of the plane.
    """

    rows_of_space: Callable[[Mechanism], ConstraintModel]
    rows_of_plane: Callable[[Mechanism, Sequence[Constraint]], ConstraintModel]

    def constraints(self, scene: Scene) -> ConstraintModel:
        """Return its rows of the joints that it does not refuse; EngineError if it refuses all, and why."""
        if in_space(scene.mechanism):
            return self.rows_of_space(scene.mechanism)
        known = expressed(self, scene)
        if not known:
            refuse(refusals(self, scene, Level.RESIDUAL))
        return self.rows_of_plane(scene.mechanism, known)


class TreeSystem:
    """The rows to be solved: the engine's closures, then the driven elements, which the adapter appends.

    These are `poses.Equations`. A driven row rests on the engine's motion of its points; that of an angle on the sum of
    the joint angles alone. That of a distance is (d . d - f^2) / 2, divided by the number f (t is fixed while it is
    solved).
    """

    def __init__(self, engine: TreeEngine, times: Sequence[float] = ()) -> None:
        self.engine, self.tree, self.driven = engine, engine.tree, engine.tree.driven
        for e in self.driven:
            if not isinstance(e, RelativeAngle | PointCoordinate | PointDistance):
                raise EngineError(f"{e.key} of {e.name!r}: a joint tree has no row for it")
        self._rounding = 16.0 * (1 + longest_chain(self.tree.edges)) ** 2 * EPS
        self._places: list[tuple[str, Pair]] = []
        self.laws: Sequence[Law] = [e.laws[0] for e in self.driven]
        self._laws = [Tabulated(self._in_the_unit(e), times) for e in self.driven]
        self._ends = [self._read_ends(e) for e in self.driven]
        self._turns = {k: self.tree.turn(e) for k, e in enumerate(self.driven) if isinstance(e, RelativeAngle)}

    def _in_the_unit(self, e: Element) -> Callable[..., Any]:
        """Return the law of a driven element, in the tree's unit and from its origin, and its derivatives."""
        law, size = e.laws[0], self.tree.size
        if isinstance(e, RelativeAngle):
            return law
        shift = self.tree.origin[e.axis] if isinstance(e, PointCoordinate) else 0.0
        return lambda t, order: (law(t, order) - (0.0 if order else shift)) / size

    def _read_ends(self, e: Element) -> tuple[Array, list[tuple[bool, int]]]:
        """Return the vector of an element, a point or d = r_j - r_i, without places that move; and of these, which.

        Of each: whether it is to be subtracted, and its index.
        """
        fixed, moving = np.zeros(2), []
        for (body, u), minus in zip(reversed(e.ends), (False, True), strict=False):
            scaled = self.tree.scaled(body, u)
            if body == GROUND:
                fixed = np.array(scaled) * (-1.0 if minus else 1.0)
            else:
                moving.append((minus, len(self._places)))
                self._places.append((body, scaled))
        return fixed, moving

    def _vector(self, k: int, of_places: Array) -> Any:
        """Return what the places that move, of which something is known (B, P, ...), add to the vector of element k."""
        parts = [-of_places[:, at] if minus else of_places[:, at] for minus, at in self._ends[k][1]]
        return sum(parts[1:], start=parts[0])

    def rows(self, q: Array, t: Array) -> tuple[Array, Array]:
        closures = self.engine.closure_rows
        residual = np.empty((len(t), closures + len(self.driven)))
        jacobian = np.empty((*residual.shape, self.tree.width))
        residual[:, :closures], jacobian[:, :closures], r, slopes = self.engine.closure(q, self._places)
        for k, e in enumerate(self.driven):
            f, row = self._laws[k](t, 0), closures + k
            if k in self._turns:
                turns, offset = self._turns[k]
                jacobian[:, row], residual[:, row] = turns, q @ turns + offset - f
                continue
            d, slope = self._ends[k][0] + self._vector(k, r), self._vector(k, slopes)
            if isinstance(e, PointCoordinate):
                residual[:, row], jacobian[:, row] = d[:, e.axis] - f, slope[:, e.axis]
            else:
                scale = _not_zero(f)
                residual[:, row] = (np.add.reduce(d * d, axis=1) - f * f) / (2.0 * scale)
                jacobian[:, row] = (d[:, None] @ slope)[:, 0] / scale[:, None]
        return residual, jacobian

    def nu(self, q: Array, t: Array) -> Array:
        closures = self.engine.closure_rows
        right = np.zeros((len(t), closures + len(self.driven)))
        for k, law in enumerate(self._laws, closures):
            right[:, k] = law(t, 1)
        return right

    def gamma(self, q: Array, qd: Array, t: Array) -> Array:
        closures = self.engine.closure_rows
        right = np.empty((len(t), closures + len(self.driven)))
        right[:, :closures], *levels = self.engine.closure_drift(q, qd, self._places)
        for k, e in enumerate(self.driven):
            f, fd, fdd = (self._laws[k](t, order) for order in range(3))
            row = closures + k
            if isinstance(e, RelativeAngle):
                right[:, row] = fdd
                continue
            d, rate, bend = (self._vector(k, level) for level in levels)
            if isinstance(e, PointCoordinate):
                right[:, row] = fdd - bend[:, e.axis]
            else:
                bent = np.add.reduce(rate * rate + (self._ends[k][0] + d) * bend, axis=1)
                right[:, row] = (fd * fd + f * fdd - bent) / _not_zero(f)
        return right

    def round_off(self, q: Array, t: Array) -> Array:
        """Return a bound (B, 1) on what rounding leaves of a residual that is zero.

        A row compares two points, each at the end of at most `depth` links. In units of the size a link is no longer
        than 3/2 and a slide no longer than |q|, so a point lies within 3/2 depth (1 + |q|). Every link costs it at most
        4 EPS of that (cosine and sine, a product of rotations, a sum), the rounding of the angles themselves another
        EPS |q|: together less than 8 (1 + depth)^2 EPS (1 + |q|) for a point, and twice that for two.
        """
        largest: Array = np.maximum.reduce(np.abs(q), axis=1, initial=0.0, keepdims=True)
        return self._rounding * (1.0 + largest)


def _not_zero(f: Array) -> Array:
    """Return the lengths (B,) that a law asks for, by which rows of distances are divided: 1 instead of 0."""
    return f if f.all() else np.where(f == 0.0, 1.0, f)


Accelerations = Callable[[Array, Array, float], Array]

CHAIN = (
    Term(
        name="chain of frames",
        level="position",
        reason="a loop is closed by a chain of up to four frames where the reference composes one: twice the roundings",
        relative=1.0,
    ),
    *(
        Term(
            name="rates down a chain",
            level=level,
            reason="rates are composed down the same chain: two roundings for each of four frames, at both ends",
            relative=16.0 * 2.0**-53,
        )
        for level in ("velocity", "acceleration")
    ),
)


def link_terms(mechanism: Mechanism) -> tuple[Term, ...]:
    """Return what massless links in the place of distance joints cost: rates that no other formulation knows.

    A link of length L turns at up to w = (v_i + v_j) / L, with v <= sqrt(2) times the largest rate at a joint, however
    small its row d . v of the reference is. It stands in two columns, its own and that of the body that hangs on it,
    with an arm of L and 3/2 for every body below it. Each product costs two roundings for every frame of the chain, and
    the solve of n equations n more; all lengths in sizes. Likewise its angular acceleration, (a_i + a_j) / L, and w^2.
    """
    unit, chain = mechanism.unit(), len(mechanism.bodies)
    velocity = acceleration = 0.0
    for e in elements_of(mechanism.constraints):
        if isinstance(e, PointDistance) and not e.laws:
            length = e.length / unit.size
            turning = sqrt(2.0) * sum(body != GROUND for body, _ in e.ends) / length
            roundings = 2.0 * 3.0 * (chain + 1) * (length + 1.5 * chain) * 2.0**-53
            velocity += roundings * turning
            acceleration += roundings * (turning + turning**2)
    why = "a massless link turns fast where its distance joint hardly moves, and every body below turns back"
    return tuple(
        Term(name="massless links", level=level, reason=why, of_rates=size)
        for level, size in (("velocity", velocity), ("acceleration", acceleration))
        if size
    )


class TreeMotion(KeptModel):
    """A scene in an engine's joint tree, asked for the motion of the bodies and points that it wants.

    Parameters
    ----------
    engine, scene, producer : TreeEngine, Scene, Producer
    own : callable, optional
        What closes the tree by means of the engine's own, pose by pose, positions alone; by default `march` does.
    accelerations : callable, optional
        What gives qdd (n,) from q, qd and t, instead of the constraints' own equations.
    departing : callable, optional
        What is added to qdd, likewise.
    """

    def __init__(
        self,
        engine: TreeEngine,
        scene: Scene,
        producer: Producer,
        own: Closing | None = None,
        accelerations: Accelerations | None = None,
        departing: Accelerations | None = None,
    ) -> None:
        self.engine, self.producer = engine, producer
        self.accelerations, self.departing = accelerations, departing
        start = engine.tree.start()
        self._found: Callable[[Sequence[float], int], MarchResult] = (
            partial(march, TreeSystem(engine, scene.times), start)
            if own is None
            else lambda times, order: one_by_one(own, start, times)
        )

    def solve(self, scene: Scene) -> Motion:
        poses = self._poses(scene.times, order_of(scene))
        places = _point_levels(self.engine, poses, [(p.body, p.position) for p in scene.points])
        points = ([level[:, k] for level in places] for k in range(len(scene.points)))
        levels = body_levels(self.engine, poses, scene.wanted)
        return answered(scene, levels, points, poses.status, self.producer, residual=poses.residual)

    def _poses(self, times: Sequence[float], order: int) -> MarchResult:
        """Return the tree's coordinates and rates up to an order."""
        poses = self._found(times, order)
        if (self.accelerations or self.departing) and order == 2:
            q, qd, qdd = poses.levels
            for k in np.flatnonzero(np.isfinite(qdd).all(axis=0)).tolist():
                at = q[:, k], qd[:, k], times[k]
                if self.accelerations:
                    qdd[:, k] = self.accelerations(*at)
                elif self.departing:
                    qdd[:, k] += self.departing(*at)
        return poses


def body_levels(engine: TreeEngine, march: MarchResult, bodies: Sequence[str]) -> list[Array]:
    """Return per level (x [m], y [m], phi [rad]) of the bodies in the ground frame, or its derivative, (3 n, T).

    phi is the sum of the joint angles, with its turns; x and y are the engine's own.

    Parameters
    ----------
    engine, march, bodies : TreeEngine, MarchResult, sequence of str
    """
    origins = _point_levels(engine, march, [(body, (0.0, 0.0)) for body in bodies])
    levels = [np.empty((3 * len(bodies), q.shape[1])) for q in march.levels]
    for order, (rows, origin, q) in enumerate(zip(levels, origins, march.levels, strict=True)):
        rows[0::3], rows[1::3] = origin
        for k, body in enumerate(bodies):
            rows[3 * k + 2] = engine.tree.angle(body, q) if order == 0 else engine.tree.angle_rows[body] @ q
    return levels


def _point_levels(engine: TreeEngine, march: MarchResult, places: Sequence[tuple[str, Any]]) -> list[Array]:
    """Return per level position [m] of P points of bodies (each [m] in its body's frame), or its derivative, (2, P, T).

    NaN where there is none.
    """
    tree = engine.tree
    levels = [np.full((2, len(places), q.shape[1]), np.nan) for q in march.levels]
    scaled = [(body, tree.scaled(body, u)) for body, u in places]
    there = np.isfinite(march.levels[0]).all(axis=0)
    q, qd, qdd = ([level[:, there].T for level in march.levels] + [None, None])[:3]
    if places and there.any():
        assert q is not None
        for order, level in enumerate(engine.motion(q, qd, qdd, scaled)):
            shift = tree.origin if order == 0 else (0.0, 0.0)
            levels[order][:, :, there] = np.transpose(level * tree.size + shift, (2, 1, 0))
    return levels
