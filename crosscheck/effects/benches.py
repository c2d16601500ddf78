"""What is switched on and off, in the reference and in an engine."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import replace
from functools import partial
from typing import Any

from crosscheck.effects.rows import Ablation, Bench, Work
from crosscheck.engines import Engine, Simulating
from refkin.analysis import solve
from refkin.model import Effect, Evidence, Point, Scene
from refkin.motion import Route

POSITION, VELOCITY, ACCELERATION = "position", "velocity", "acceleration"
EVERY_LEVEL = frozenset({Effect.VELOCITY, Effect.ACCELERATION})


def bare(scene: Scene, effects: frozenset[Effect] = frozenset()) -> Scene:
    """Return a scene that calls for positions of all bodies, for some effects, and for nothing else."""
    return replace(scene, effects=effects, evidence=frozenset(), points=(), bodies_wanted=None)


def _levels(scene: Scene) -> dict[str, Scene]:
    return {
        POSITION: bare(scene),
        VELOCITY: bare(scene, frozenset({Effect.VELOCITY})),
        ACCELERATION: bare(scene, EVERY_LEVEL),
    }


LEVELS = (
    Ablation(VELOCITY, off=POSITION, on=VELOCITY, called_for=True, note="beyond position"),
    Ablation(ACCELERATION, off=VELOCITY, on=ACCELERATION, called_for=True, note="beyond velocity"),
)


def reference_bench(scene: Scene) -> Bench:
    """Return what refkin may be asked for beyond positions, each against an answer without it."""
    levels = _levels(scene)
    whole, body = levels[ACCELERATION], scene.mechanism.bodies[0].name
    points = scene.points or (Point(name="a point", body=body, position=(0.0, 0.0)),)
    asked = {
        "points": (replace(whole, points=points), f"{len(points)} of them, position to acceleration"),
        "condition": (replace(whole, evidence=frozenset({Evidence.CONDITION})), "singular values of phi_q"),
        "certificate": (replace(whole, evidence=frozenset({Evidence.CERTIFICATE})), "a proof of every pose and rate"),
    }
    scenes = {**levels, **{name: wanted for name, (wanted, _) in asked.items()}}
    ablations = [
        *LEVELS,
        *(Ablation(k, off=ACCELERATION, on=k, called_for=True, note=note) for k, (_, note) in asked.items()),
    ]
    if len(scene.mechanism.bodies) > 1:
        scenes["one body"] = replace(whole, bodies_wanted=(body,))
        note = f"those beside {body}"
        ablations.append(Ablation("other bodies", off="one body", on=ACCELERATION, called_for=True, note=note))
    works: dict[str, Work] = {name: partial(solve, wanted) for name, wanted in scenes.items()}
    return Bench("refkin", "newton", True, works, tuple(ablations))


def engine_benches(engine: Engine, scene: Scene) -> Iterator[Bench]:
    """Yield a bench for each route of an engine, through its dynamics as well where it has such a route."""
    simulated = engine.physical_effects() if isinstance(engine, Simulating) else {}
    dynamic = engine.dynamic_routes() if isinstance(engine, Simulating) else ()
    for route in (*engine.routes(), *dynamic):
        works: dict[str, Work] = {name: partial(engine.solve, asked, route) for name, asked in _levels(scene).items()}
        ablations = list(LEVELS)
        for effect, told in simulated.items():
            works[effect] = _with(engine, effect, scene, route)
            ablations.append(Ablation(effect, off=ACCELERATION, on=effect, called_for=False, note=told))
        yield Bench(engine.name, route.name, False, works, tuple(ablations))


def _with(engine: Any, effect: str, scene: Scene, route: Route) -> Work:
    return partial(engine.with_effect(effect).solve, bare(scene, EVERY_LEVEL), route)
