"""MuJoCo as an engine: its own residual, Jacobian and drift term, in absolute coordinates and in a joint tree.

MuJoCo closes loops by soft forces, never exactly. Its constraint rows are exact all the same, so that the adapter runs
Newton on them. MuJoCo's dynamics and solver are used by the method of its shipped defaults (`shipped`), and by
the method through mj_forward, which answers no scene: it is for the ledger of effects, to show what is felt there.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from functools import partial

import numpy as np

from crosscheck.engines import (
    TABULATED,
    Capabilities,
    Capability,
    ConstraintModel,
    EngineRefusal,
    KeptModel,
    Level,
    Support,
    Term,
    by_level,
    derived,
    in_space,
    native_but,
    refused,
    route_by,
)
from crosscheck.engines.estimates import as_driven
from crosscheck.engines.frames import RowMap
from crosscheck.engines.mujoco.features import EFFECTS, FEATURES, SITES, SPARSE, Sites, SparseNewton, affected
from crosscheck.engines.mujoco.model import Plan, mujoco
from crosscheck.engines.mujoco.rows import MujocoRows
from crosscheck.engines.mujoco.shipped import STEPPED, SpaceSimulation, freedoms, soft, stepped
from crosscheck.engines.mujoco.space import MujocoSpace
from crosscheck.engines.spatial.motion import SPATIAL_VECTORS, SpaceMotion, SpaceRows
from crosscheck.engines.tree.joint_tree import Array, JointTree, absolute_tree, joint_tree
from crosscheck.engines.tree.tree_system import CHAIN, Accelerations, Places, TreeAdapter, TreeEngine, TreeMotion
from refkin.joints import Constraint, PointsCoincide, RelativeAngle, RollingWheels, elements_of
from refkin.model import Mechanism, Scene
from refkin.motion import Producer, Route

NEWTON = route_by("mujoco", "newton", "adapter")

SPATIAL = (
    Term(
        name="frames by quaternions",
        level=Level.RESIDUAL.value,
        reason="a guide's frame is turned by a quaternion: also entries of its matrix that are 0 or 1 are off by three "
        "roundings, two products of two components each, and multiply the whole of d, twice the largest coordinate",
        relative=6.0 * 2.0**-53,
    ),
    *SPATIAL_VECTORS,
)


_BY_PARTS = derived(
    "no such equality: product rule in the adapter, on the numbers of a connect and of the guide's frame"
)
_LINE = native_but(
    jacobian=_BY_PARTS,
    drift=_BY_PARTS,
    solve=derived("a tree joint is MuJoCo's own; for a closing one the adapter forms the drift term"),
)
_LAW = derived("the adapter appends the row, on MuJoCo's motion of the body")
_NO_RATE = refused("MuJoCo knows no rate of a law: what it holds by one is used where it simulates, and not compared")
_BIAS = derived("efc_aref lacks Jdot qd of a tendon: taken from the bias force of a tendon with armature")

_NO_ROW = refused("MuJoCo has no equality of this kind between free bodies in space")
_UNUSED = refused("a tendon or a weld has such a row in space, by an equality that the adapter does not use")
_GEARED = derived("a row of the adapter's on two joints of the tree; refused where one of them closes a loop")
_EDGE_OR_ROW = derived("native as a joint of the tree; where a loop is closed, a row of the adapter's on its motion")

CAPABILITIES: Capabilities = {
    "points coincide": native_but(),
    "point on line": _LINE,
    "distance": native_but(drift=_BIAS, solve=_BIAS),
    "angle": native_but(),
    **dict.fromkeys(("rolling wheels", "rolling wheels on a carrier"), native_but()),
    **dict.fromkeys(("angle by a law", "coordinate by a law", "distance by a law"), by_level(_NO_RATE, _LAW)),
    "points of space coincide": native_but(),
    "axes parallel": native_but(solve=Capability(Support.NATIVE, "a tree joint, or a second pair of points")),
    **dict.fromkeys(("turn about axis", "twist about axis"), native_but(solve=_EDGE_OR_ROW)),
    "screw": by_level(_NO_ROW, derived("a slide that the adapter moves with its hinge")),
    "turns in gear": by_level(_NO_ROW, _GEARED),
    **dict.fromkeys(("axes perpendicular", "point on axis", "point in plane"), by_level(_NO_ROW, _EDGE_OR_ROW)),
    "distance of space": by_level(_UNUSED, _EDGE_OR_ROW),
    "shift along axis by a law": by_level(_NO_ROW, _LAW),
    **dict.fromkeys(("turn about axis by a law", "distance of space by a law"), by_level(_UNUSED, _LAW)),
}


FORWARD = replace(NEWTON, name="forward dynamics", linear_solve_by="acceleration: mujoco", drift_by="mujoco (soft)")
HELD = (PointsCoincide, RelativeAngle, RollingWheels)
"""What MuJoCo's dynamics hold as they are: the rows of the others are read beside the model, or idle within it."""


class AbsoluteRows(ConstraintModel):
    """MuJoCo's rows with every body free on the ground, so that qpos is (x, y, phi) per body; none for drivers.

    The model is in units of the mechanism's size, a power of two, so that MuJoCo is given the very numbers it is asked
    about.
    """

    owns_driver = False

    def __init__(self, mechanism: Mechanism, constraints: Sequence[Constraint]) -> None:
        bodies, size = [body.name for body in mechanism.bodies], mechanism.size()
        self._rows = MujocoRows(Plan(absolute_tree(bodies, size), elements_of(constraints)))
        sources = self._rows.plan.sources
        self._metre = np.array([size**s.unit for s in sources])
        self._unit = np.tile([1.0 / size, 1.0 / size, 1.0], len(bodies))
        self.rows = tuple(
            RowMap(constraint=s.element.name, row=s.element.row + s.row, engine_row=k, form=s.form)
            for k, s in enumerate(sources)
        )

    def residual(self, q: Array, t: float) -> Array:
        return self._rows.rows((q * self._unit)[None])[0][0] * self._metre

    def jacobian(self, q: Array, t: float) -> Array:
        jacobian = self._rows.rows((q * self._unit)[None])[1][0]
        return jacobian * np.outer(self._metre, self._unit)

    def constraint_velocity(self, q: Array, qd: Array, t: float) -> Array:
        """Return the velocity of MuJoCo's rows, (m,)."""
        return self._rows.rates((q * self._unit)[None], (qd * self._unit)[None])[0][0] * self._metre

    def drift(self, q: Array, qd: Array, t: float) -> Array:
        """Return MuJoCo's -Jdot qd, (m,)."""
        return self._rows.rates((q * self._unit)[None], (qd * self._unit)[None])[1][0] * self._metre


class Mujoco(TreeAdapter):
    """MuJoCo, through its Python package; every scene gets a model of its own."""

    name = "mujoco"
    package, table, effects = mujoco, CAPABILITIES, EFFECTS
    rows_of_space, rows_of_plane = staticmethod(partial(SpaceRows, build=MujocoSpace, welds=0.5)), AbsoluteRows
    solving, shipped, special, dynamic = (NEWTON,), (STEPPED,), FEATURES, (FORWARD,)
    kept = dict.fromkeys(solving, TABULATED)

    def terms(self, scene: Scene, route: Route | None = None) -> Sequence[Term]:
        """Return the rounding of MuJoCo's drift terms, and what soft constraints leave; Newton runs to round-off."""
        if route == STEPPED:
            return (*CHAIN, *SPATIAL, soft(freedoms(scene.mechanism)))
        return (*CHAIN, *SPATIAL)

    def built(self, scene: Scene, producer: Producer) -> KeptModel:
        """Return the scene as a joint tree, closed from the bodies' estimates."""
        route = producer.route
        if in_space(scene.mechanism):
            own = (lambda system: SpaceSimulation(system).at_rest) if route == STEPPED else None
            return SpaceMotion(scene, MujocoSpace, producer, own)
        tree = joint_tree(as_driven(scene))
        rows = ThroughSites(tree) if route == SITES else TreeRows(tree, self.effect)
        closing = stepped(tree) if route == STEPPED else None
        departing = SparseNewton(scene.mechanism).departure if route == SPARSE else None
        accelerations = self._forward(tree) if route == FORWARD else None
        return TreeMotion(rows, scene, producer, closing, accelerations, departing)

    def _forward(self, tree: JointTree) -> Accelerations:
        """Return the accelerations by MuJoCo's dynamics, where its model is that of the scene."""
        elements = (*tree.closures, *tree.driven)
        strange = dict.fromkeys(e.name for e in elements if not isinstance(e, HELD))
        if strange:
            raise EngineRefusal(
                f"mujoco refuses {FORWARD.name} with {', '.join(strange)}: its model does not hold them"
            )
        return MujocoRows(affected(Plan(tree, elements), self.effect)).forward


class TreeRows(MujocoRows, TreeEngine):
    """MuJoCo's model of a joint tree."""

    def __init__(self, tree: JointTree, effect: str | None = None) -> None:
        super().__init__(affected(Plan(tree, tree.closures), effect))
        self.tree, self.closure_rows = tree, len(self.plan.sources)

    def closure(self, q: Array, places: Places) -> tuple[Array, Array, Array, Array]:
        return self.rows(q, places)

    def closure_drift(self, q: Array, qd: Array, places: Places) -> tuple[Array, ...]:
        return self.rates(q, qd, places)[1:]


class ThroughSites(TreeRows):
    """The same, but for the places and velocities of bodies, which are read from sites."""

    def __init__(self, tree: JointTree) -> None:
        super().__init__(tree)
        self.sites = Sites(tree)

    def motion(self, q: Array, qd: Array | None, qdd: Array | None, places: Places) -> list[Array]:
        """Return the motion of places, of origins of bodies position and velocity by sites, all else as elsewhere."""
        levels = super().motion(q, qd, qdd, places)
        origins = [p for p, (_, u) in enumerate(places) if not any(u)]
        of_sites = [places[p] for p in origins]
        for k, at in enumerate(q) if origins else ():
            for level, read in zip(levels, self.sites.read(at, None if qd is None else qd[k], of_sites), strict=False):
                level[k, origins] = read
        return levels
