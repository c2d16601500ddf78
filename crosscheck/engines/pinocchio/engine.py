"""Pinocchio as a peer: its own constraint rows in absolute coordinates, and its joint trees with loops to be closed.

Pinocchio has no kinematic loop solver, no prescribed motion and no distance constraint. So Newton, driver rows and
linear solves are the adapter's (`march`, `tree_system`), and a distance joint is a massless link; residual,
Jacobian, drift term and the motion of points are Pinocchio's. Every scene gets its own model.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from functools import partial
from typing import Any

import pinocchio as pin

from crosscheck.engines import (
    NATIVE,
    TABULATED,
    Array,
    Capabilities,
    ConstraintModel,
    KeptModel,
    Level,
    Term,
    by_level,
    derived,
    in_space,
    refused,
    route_by,
)
from crosscheck.engines.estimates import as_driven
from crosscheck.engines.frames import RowMap
from crosscheck.engines.pinocchio.features import EFFECTS, FEATURES, MISSING, ForwardDynamics, affected
from crosscheck.engines.pinocchio.model import Points, tree_model
from crosscheck.engines.pinocchio.rows import Rows
from crosscheck.engines.pinocchio.shipped import CLOSED_CHAIN, STOP, SpaceExample, closed_chain
from crosscheck.engines.pinocchio.space import PinocchioSpace
from crosscheck.engines.spatial.motion import SPATIAL_VECTORS, SpaceMotion, SpaceRows
from crosscheck.engines.tree.joint_tree import JointTree, absolute_tree, joint_tree
from crosscheck.engines.tree.tree_system import CHAIN, Places, TreeAdapter, TreeEngine, TreeMotion, link_terms
from refkin.joints import Constraint, elements_of
from refkin.model import Mechanism, Scene
from refkin.motion import Motion, Producer, Route

TREE = route_by("pinocchio", "joint tree", "adapter")

NO_DISTANCE = refused("Pinocchio has no distance constraint")
NO_DRIVER = refused("Pinocchio prescribes no motion; a row of the adapter's own would prove nothing")
LINK = derived("a massless link with a revolute joint at either end")
OWN_ROW = derived("a row of the adapter's, on Pinocchio's motion of points or its joint angles")

TWO_PAIRS = refused("Pinocchio has no such constraint: a second pair of points stands for it where a loop is closed")
NO_ROW = refused("Pinocchio has no such constraint in space")
GEARED = derived("a row of the adapter's on two joints of the tree; refused where one of them closes a loop")
EDGE_OR_ROW = derived("native as a joint of the tree; where a loop is closed, a row of the adapter's on its motion")

DRIVEN = (
    *("angle by a law", "coordinate by a law", "distance by a law"),
    *("turn about axis by a law", "shift along axis by a law", "distance of space by a law"),
)
NO_MIMIC = refused("its mimic joints gear one hinge of a tree to another; the adapter has none of them")
CAPABILITIES: Capabilities = {
    **{key: dict.fromkeys(Level, NATIVE) for key in ("points coincide", "point on line", "angle")},
    "distance": by_level(NO_DISTANCE, LINK),
    **dict.fromkeys(DRIVEN, by_level(NO_DRIVER, OWN_ROW)),
    **dict.fromkeys(("rolling wheels", "rolling wheels on a carrier"), dict.fromkeys(Level, NO_MIMIC)),
    "points of space coincide": dict.fromkeys(Level, NATIVE),
    "axes parallel": by_level(TWO_PAIRS, NATIVE),
    "screw": by_level(NO_ROW, NATIVE),
    "turns in gear": by_level(NO_ROW, GEARED),
    "distance of space": by_level(NO_ROW, EDGE_OR_ROW),
    **dict.fromkeys(
        ("axes perpendicular", "point on axis", "point in plane", "turn about axis", "twist about axis"),
        by_level(NO_ROW, EDGE_OR_ROW),
    ),
}


SPATIAL = (
    Term(
        name="angles from rotations",
        level=Level.RESIDUAL.value,
        reason="the angle of a prismatic row is read from a rotation matrix, each entry rounded by u or two",
        absolute=8.0 * 2.0**-53,
    ),
    *SPATIAL_VECTORS,
)


FORWARD = replace(TREE, name="forward dynamics", linear_solve_by="acceleration: pinocchio")


class PinocchioConstraints(ConstraintModel):
    """Pinocchio's rows for some joints of a mechanism, with columns (x, y, phi) per body [m, rad]; none for drivers."""

    owns_driver = False

    def __init__(self, mechanism: Mechanism, joints: Sequence[Constraint]) -> None:
        bodies = [body.name for body in mechanism.bodies]
        elements = tuple(elements_of(joints))
        self._rows = Rows(tree_model(absolute_tree(bodies)), elements, lambda body, u: u)
        self._none = Points(self._rows.planar)
        ours = [(e.name, e.row + k) for e in elements for k in range(e.rows)]
        self.rows: Sequence[RowMap] = tuple(
            RowMap(constraint=name, row=row, engine_row=k) for k, (name, row) in enumerate(ours)
        )

    def residual(self, q: Array, t: float) -> Array:
        return self._rows.both(q[None], self._none)[0][0]

    def jacobian(self, q: Array, t: float) -> Array:
        return self._rows.both(q[None], self._none)[1][0]

    def constraint_velocity(self, q: Array, qd: Array, t: float) -> Array:
        """Return phi_q qd (m,), from Pinocchio's velocities of frames."""
        return self._rows.velocity(q[None], qd[None], self._none)[0]

    def drift(self, q: Array, qd: Array, t: float) -> Array:
        """Return gamma (m,), from Pinocchio's accelerations of frames."""
        return self._rows.drift(q[None], qd[None], self._none)[0][0]


class Pinocchio(TreeAdapter):
    """The engine of the package `pin`."""

    name = "pinocchio"
    package, table, effects, missing = pin, CAPABILITIES, EFFECTS, MISSING
    rows_of_space, rows_of_plane = staticmethod(partial(SpaceRows, build=PinocchioSpace)), PinocchioConstraints
    solving, shipped, special, dynamic = (TREE,), (CLOSED_CHAIN,), tuple(FEATURES), (FORWARD,)
    kept = dict.fromkeys(solving, TABULATED)

    def terms(self, scene: Scene, route: Route | None = None) -> Sequence[Term]:
        """Return the rounding of chains, drift terms and massless links, and what stops Pinocchio's own loop."""
        own = (STOP,) if route == CLOSED_CHAIN else ()
        return (*CHAIN, *SPATIAL, *link_terms(scene.mechanism), *own)

    def answer(self, scene: Scene, producer: Producer) -> Motion:
        route = producer.route
        if route in FEATURES:
            return FEATURES[route](scene, route).with_rates(self.solve(replace(scene, bodies_wanted=None), TREE))
        return super().answer(scene, producer)

    def built(self, scene: Scene, producer: Producer) -> KeptModel:
        """Return Pinocchio's joint tree of a scene, closed from the bodies' estimates."""
        route = producer.route
        if in_space(scene.mechanism):
            own = (lambda system: SpaceExample(system).closed) if route == CLOSED_CHAIN else None
            return SpaceMotion(scene, PinocchioSpace, producer, own)
        tree = PinocchioTree(joint_tree(as_driven(scene), massless_links=True), self.effect)
        closing = closed_chain(tree.tree) if route == CLOSED_CHAIN else None
        forward = ForwardDynamics(tree, self.effect) if route == FORWARD else None
        return TreeMotion(tree, scene, producer, closing, forward)


class PinocchioTree(TreeEngine):
    """Pinocchio's model of a joint tree."""

    def __init__(self, tree: JointTree, effect: str | None = None) -> None:
        self.tree = tree
        self.planar = affected(tree_model(tree), effect)
        self.rows = Rows(self.planar, tree.closures, tree.scaled)
        self.closure_rows = self.rows.count
        self._points = dict[Any, Points]()

    def closure(self, q: Array, places: Places) -> tuple[Array, Array, Array, Array]:
        return self.rows.both(q, self._at(places))

    def closure_drift(self, q: Array, qd: Array, places: Places) -> tuple[Array, ...]:
        return self.rows.drift(q, qd, self._at(places))

    def motion(self, q: Array, qd: Array | None, qdd: Array | None, places: Places) -> list[Array]:
        """Return position, velocity and acceleration (B, P, 2) of points: one call of forward kinematics a pose."""
        given = [level for level in (q, qd, qdd) if level is not None]
        points = self._at(places)
        kept, targets = points.kept(len(q), len(given))
        self.planar.sampled(self.planar.place if qd is None else self.planar.move, given, targets)
        return points.motion(kept)

    def _at(self, places: Places) -> Points:
        key = tuple(places)
        if key not in self._points:
            self._points[key] = Points(self.planar, [self.planar.frames[body].at(u) for body, u in key])
        return self._points[key]
