"""exudyn as a peer: positions by its own static Newton, rates from its own Jacobian, velocity rows and accelerations.

Two routes. `static` is exudyn at its best: lengths in units of the mechanism's size, a tight absolute tolerance, and a
march over the times that predicts each pose from exudyn's own velocities and halves the step where it goes astray.
`shipped` starts each solve at the last answer: in the plane in metres with every default; in space in sizes, with
default tolerances and steps, and a linear solver that bears redundant rows and passive spins.

exudyn does no velocity or acceleration analysis and exposes no linear solver, so those two systems are solved here.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from contextlib import closing
from dataclasses import replace

import exudyn as exu
import numpy as np

from crosscheck.engines import (
    TABULATED,
    Capabilities,
    Capability,
    ConstraintModel,
    KeptModel,
    Level,
    SimulatingAdapter,
    Support,
    Term,
    answered,
    derived,
    expressed,
    in_space,
    native_but,
    refused,
    route_by,
)
from crosscheck.engines.exudyn.integration import EFFECTS, FEATURES, INITIAL, with_initial_accelerations
from crosscheck.engines.exudyn.model import ExudynModel
from crosscheck.engines.exudyn.parts import Builder
from crosscheck.engines.exudyn.solve import (
    ExudynEquations,
    ShippedSolve,
    StaticNewton,
    in_metres,
    placed,
    start_of,
    stopping_rule,
)
from crosscheck.engines.exudyn.space import NO_TWIST, STILL_TERMS, ExudynSpaceRows
from crosscheck.engines.exudyn.space_solve import SpaceModel
from crosscheck.scenes.names import order_of
from refkin.joints import SI, PointDistance, elements_of
from refkin.model import Effect, Scene
from refkin.motion import Motion, Producer, Route

STATIC = route_by(
    "exudyn",
    "static",
    "exudyn (MainSolverStatic.Newton)",
    linear_solve_by="position: exudyn; velocity, acceleration: adapter (numpy)",
    drift_by="exudyn's point accelerations at qdd = 0, combined by the adapter; f'' of drivers by the adapter",
)
SHIPPED = replace(STATIC, name="shipped", newton_by="exudyn (SolveStatic, default tolerances)")

_SOLVED = Capability(Support.NATIVE, "positions; the linear systems of velocity and acceleration are the adapter's")


def _rows(drift: str) -> dict[Level, Capability]:
    return native_but(drift=derived(drift), solve=_SOLVED)


_FROM_POINTS = _rows("exudyn's point accelerations at qdd = 0, combined by the adapter")
_FROM_AXES = _rows("the adapter's product rule on exudyn's rotations, rates and accelerations")
_LINEAR = _rows("a linear row: the adapter knows that nothing drifts")
_SET = {
    **_rows("the adapter's product rule; f' and f'' by the adapter"),
    Level.CONSTRAINT_VELOCITY: derived("the adapter sets a frame at each time, which takes no rate: f' by the adapter"),
}
_CYLINDER = {
    Level.RESIDUAL: derived("exudyn's |d| - f, f set by the adapter, turned into (d . d - f^2) / 2"),
    Level.JACOBIAN: derived("exudyn's row of |d|, scaled by the adapter"),
    Level.CONSTRAINT_VELOCITY: derived("exudyn's distance takes no rate: f' by the adapter"),
    Level.DRIFT: derived("exudyn's point motion, combined by the adapter; f' and f'' by the adapter"),
    Level.SOLVE: derived("exudyn's distance is set anew at each time and takes no rate: f' by the adapter"),
}
CAPABILITIES: Capabilities = {
    "points coincide": _FROM_POINTS,
    "point on line": _FROM_POINTS,
    "distance": _FROM_POINTS,
    "distance by a law": _CYLINDER,
    "coordinate by a law": _rows("exudyn's point acceleration at qdd = 0; f'' by the adapter"),
    "angle": _LINEAR,
    "angle by a law": _rows("exudyn takes no second derivative of a driver: f'' by the adapter"),
    "rolling wheels": _LINEAR,
    "rolling wheels on a carrier": dict.fromkeys(Level, refused("its relative rotation of two bodies counts no turns")),
    "points of space coincide": _FROM_POINTS,
    "distance of space": _FROM_POINTS,
    **dict.fromkeys(
        ("axes parallel", "axes perpendicular", "point on axis", "point in plane", "turn about axis"), _FROM_AXES
    ),
    "turn about axis by a law": _SET,
    "shift along axis by a law": _SET,
    "distance of space by a law": _CYLINDER,
    "twist about axis": {**_FROM_AXES, Level.SOLVE: refused(NO_TWIST)},
    "screw": dict.fromkeys(Level, refused("the adapter makes no screw of exudyn's relative coordinates")),
    "turns in gear": dict.fromkeys(Level, refused("its bodies of space count no turns")),
}


class Exudyn(SimulatingAdapter):
    """exudyn 1.13, two-dimensional rigid bodies and joints."""

    name = "exudyn"
    package, table, effects = exu, CAPABILITIES, EFFECTS
    solving, special = (STATIC, SHIPPED), FEATURES
    kept = dict.fromkeys(solving, TABULATED)
    _stop: tuple[Scene, Term] | None = None
    """The scene that `shipped` solved last, and where it stopped: its terms are asked for next."""

    def terms(self, scene: Scene, route: Route | None = None) -> Sequence[Term]:
        """Return what exudyn's stopping rule leaves of the residual, on `static` nothing; and what its nodes round.

        Raises as `solve`: the rule of `shipped` depends on the start.
        """
        nodes = STILL_TERMS if in_space(scene.mechanism) else ()
        if route in (None, STATIC, INITIAL):
            return nodes
        if self._stop is None or self._stop[0] is not scene:
            with closing(self.built(scene, self.producer(scene, route))) as model:
                self._stop = scene, model.stop(scene)
        return self._stop[1], *nodes

    def built(self, scene: Scene, producer: Producer) -> PlaneModel | SpaceModel:
        """Return exudyn's model of a scene, in its own settings where the route is `shipped`."""
        shipped = producer.route == SHIPPED
        if in_space(scene.mechanism):
            return SpaceModel(scene, producer, shipped=shipped)
        more = None if self.effect is None else EFFECTS[self.effect].switch
        return PlaneModel(scene, producer, shipped=shipped, more=more)

    def constraints(self, scene: Scene) -> ConstraintModel:
        """Return exudyn's rows of the joints and drivers that it does not refuse, in metres."""
        known = expressed(self, scene)
        if in_space(scene.mechanism):
            return ExudynSpaceRows(scene.mechanism, known)
        return ExudynModel(scene.mechanism.bodies, known)

    def answer(self, scene: Scene, producer: Producer) -> Motion:
        route = producer.route
        if route == INITIAL:
            whole = replace(scene, bodies_wanted=None, effects=scene.effects | {Effect.VELOCITY})
            return with_initial_accelerations(scene, self.solve(whole, STATIC), scene.mechanism.unit())
        with closing(self.built(scene, producer)) as model:
            if route == SHIPPED:
                self._stop = scene, model.stop(scene)
            return model.solve(scene)


class PlaneModel(KeptModel):
    """exudyn's model of a scene of the plane: in sizes, or in metres with its own settings, `shipped`."""

    def __init__(
        self, scene: Scene, producer: Producer, *, shipped: bool, more: Callable[[Builder], None] | None = None
    ) -> None:
        self.producer = producer
        self.unit = SI if shipped else scene.mechanism.unit()
        self.size = scene.mechanism.size() if shipped else 1.0
        self.start = start_of(scene, self.unit)
        self.model = ExudynModel(scene.mechanism.bodies, scene.mechanism.constraints, self.unit, more=more)
        solver = ShippedSolve(self.model, self.size) if shipped else StaticNewton(self.model)
        self.equations = ExudynEquations(self.model, scene, solver)

    def close(self) -> None:
        """Free what exudyn holds."""
        self.model.close()

    def solve(self, scene: Scene) -> Motion:
        """Return the poses of the wanted bodies in metres, NaN where there is no answer."""
        self.equations.begin()
        poses = self.equations.march(self.start, scene.times, order_of(scene))
        status, message = self.equations.status(poses, scene.times)
        names = [body.name for body in scene.mechanism.bodies]
        wanted = [3 * names.index(name) + k for name in scene.wanted for k in range(3)]
        levels, more = in_metres(self.unit, poses.levels), {"residual": poses.residual, "message": message}
        points = placed(scene.points, names, levels)
        return answered(scene, [level[wanted] for level in levels], points, status, self.producer, **more)

    def stop(self, scene: Scene) -> Term:
        """Return what SolveStatic leaves of the residual in metres and rad."""
        elements, t = list(elements_of(scene.mechanism.constraints)), np.array(scene.times)
        values = np.array([law(t, 0) + 0.0 * t for driver in scene.mechanism.drivers for law in driver.laws])
        self.model.set_state(self.start, scene.times[0])
        residual = self.model.equations()
        lengths = [e.laws[0](t, 0) / self.size for e in elements if isinstance(e, PointDistance) and e.laws]
        return stopping_rule(residual, values, lengths, max(1.0, 1.0 / self.size), "m or rad")
