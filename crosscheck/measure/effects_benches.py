"""What is switched on and off, in the reference and in an engine."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import replace
from functools import partial
from typing import Any

from crosscheck.engines import Engine, Simulating
from crosscheck.measure.effects_rows import Ablation, Bench, Work
from crosscheck.scenes.names import PHYSICAL
from refkin.model import Effect, Evidence, Point, Scene
from refkin.motion import Route
from refkin.solving.solve import solve

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


OWN = dict.fromkeys(("condition", "certificate"), "evidence is the reference's own, the engine gives none")
"""What no engine has a part in, and why."""


def _wanted(scene: Scene) -> tuple[dict[str, Scene], list[Ablation], dict[str, str]]:
    """Return what points and other bodies are seen by: scenes, ablations, and why there is no ablation."""
    whole, body = bare(scene, EVERY_LEVEL), scene.mechanism.bodies[0].name
    points = scene.points or (Point(name="a point", body=body, position=(0.0, 0.0)),)
    told = f"{len(points)} of them, position to acceleration"
    scenes = {"points": replace(whole, points=points)}
    ablations = [Ablation("points", off=ACCELERATION, on="points", called_for=True, note=told)]
    if len(scene.mechanism.bodies) == 1:
        return scenes, ablations, {"other bodies": f"{body} is the only body"}
    scenes["one body"] = replace(whole, bodies_wanted=(body,))
    beside = f"those beside {body}"
    ablations.append(Ablation("other bodies", off="one body", on=ACCELERATION, called_for=True, note=beside))
    return scenes, ablations, {}


def reference_bench(scene: Scene) -> Bench:
    """Return what refkin may be asked for beyond positions, each against an answer without it."""
    whole = bare(scene, EVERY_LEVEL)
    evidence = {
        "condition": (Evidence.CONDITION, "singular values of phi_q"),
        "certificate": (Evidence.CERTIFICATE, "a proof of every pose and rate"),
    }
    wanted, reported, absent = _wanted(scene)
    scenes = {**_levels(scene), **wanted}
    scenes |= {name: replace(whole, evidence=frozenset({kind})) for name, (kind, _) in evidence.items()}
    proved = [Ablation(k, off=ACCELERATION, on=k, called_for=True, note=note) for k, (_, note) in evidence.items()]
    works: dict[str, Work] = {name: partial(solve, asked) for name, asked in scenes.items()}
    absent |= dict.fromkeys(PHYSICAL, "refkin has none: no formula of it holds a mass or a force")
    return Bench("refkin", "newton", True, works, (*LEVELS, *reported, *proved), absent)


def engine_benches(engine: Engine, scene: Scene) -> Iterator[Bench]:
    """Yield a bench for each route of an engine, through its dynamics as well where it has such a route."""
    simulating = engine if isinstance(engine, Simulating) else None
    simulated = simulating.physical_effects() if simulating else {}
    dynamic = simulating.dynamic_routes() if simulating else ()
    wanted, reported, absent = _wanted(scene)
    absent = {**absent, **OWN, **_not_simulated(simulating, simulated)}
    for route in (*engine.routes(), *dynamic):
        scenes = {**_levels(scene), **wanted}
        works: dict[str, Work] = {name: partial(engine.solve, asked, route) for name, asked in scenes.items()}
        ablations = [*LEVELS, *reported]
        for effect, told in simulated.items():
            works[effect] = _with(engine, effect, scene, route)
            ablations.append(Ablation(effect, off=ACCELERATION, on=effect, called_for=False, note=told))
        yield Bench(engine.name, route.name, False, works, tuple(ablations), absent)


def _not_simulated(engine: Simulating | None, simulated: Mapping[str, str]) -> dict[str, str]:
    """Return each physical effect that is not switched on, and why."""
    if engine is None:
        return dict.fromkeys(PHYSICAL, "the engine offers no simulation to switch on")
    reasons = engine.missing_effects()
    return {effect: reasons.get(effect, "the engine names none") for effect in PHYSICAL if effect not in simulated}


def _with(engine: Any, effect: str, scene: Scene, route: Route) -> Work:
    return partial(engine.with_effect(effect).solve, bare(scene, EVERY_LEVEL), route)
