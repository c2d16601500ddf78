"""What is priced: one way to an answer, at one setting of its knob."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from importlib import import_module
from typing import Any

from refkin.model import Effect, Scene

QUANTITIES = ("position", "velocity", "acceleration")
PRODUCERS = {
    "refkin": "crosscheck.engines.ours.refkin_settings",
    "scipy": "crosscheck.engines.ours.scipy_settings",
    "exudyn": "crosscheck.engines.exudyn.settings",
    "mujoco": "crosscheck.engines.mujoco.settings",
    "pinocchio": "crosscheck.engines.pinocchio.settings",
}
"""Producer -> the module whose `routes(scene)` yields its routes; imported where they are measured, not before."""
PRICED_AS = {
    ("exudyn", "static"): "MainSolverStatic.Newton",
    ("exudyn", "shipped"): "SolveStatic, as shipped",
    ("mujoco", "newton"): "Newton on its rows",
    ("pinocchio", "joint tree"): "Newton on its rows",
}
"""Engine and route of a night -> the route of the price list that does the same, its knobs turned."""
NOBODY = "nobody: steps in time"
"""Who ran Newton where the motion is integrated."""


@dataclass(frozen=True, kw_only=True)
class PricedRoute:
    """A route at one setting.

    Attributes
    ----------
    engine, name, knob : str
        Who, by which route, at which setting. Settings come in their order: what should be more accurate comes later.
    newton_by : str
        Who ran Newton.
    solve : callable
        Order (0 position, 1 velocity too, 2 acceleration too) -> the answer at the scene's times in the producer's own
        coordinates. This is what is timed.
    read : callable
        That answer -> per order (3 bodies, T): x, y [m], phi [rad] of every body of the scene, or derivatives; NaN
        where there is no answer.
    highest : int
        The highest order it gives.
    at_once : bool
        Whether all orders come from one run, so that each costs what all cost.
    note : str
        What a reader has to know of it.
    """

    engine: str
    name: str
    knob: str
    newton_by: str
    solve: Callable[[int], Any]
    read: Callable[[Any], Sequence[Any]]
    highest: int = 2
    at_once: bool = False
    note: str = ""

    @property
    def key(self) -> tuple[str, str, str]:
        """What it is called by: engine, route, knob."""
        return self.engine, self.name, self.knob


@dataclass(frozen=True, kw_only=True)
class Refused:
    """A route that cannot be taken on a scene, and why not."""

    engine: str
    name: str
    reason: str


def order_of(scene: Scene) -> int:
    """Return the highest order that a scene calls for."""
    if Effect.ACCELERATION in scene.effects:
        return 2
    return 1 if Effect.VELOCITY in scene.effects else 0


def quantities(scene: Scene) -> tuple[str, ...]:
    """Return the quantities that a scene calls for; acceleration computes velocity, but does not report it unasked."""
    called = {"position": True, **{q: Effect(q) in scene.effects for q in QUANTITIES[1:]}}
    return tuple(q for q in QUANTITIES if called[q])


def routes_of(producer: str, scene: Scene) -> list[PricedRoute | Refused]:
    """Return the routes of a producer (a name of `PRODUCERS`, or a module) for a scene.

    A producer whose package is missing, or that refuses the scene, is one refusal.
    """
    from crosscheck.engines import EngineError

    try:
        return list(import_module(PRODUCERS.get(producer, producer)).routes(scene))
    except (ImportError, EngineError) as error:
        return [Refused(engine=producer, name="any", reason=str(error))]
