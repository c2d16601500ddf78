"""What is switched on and off in a method, each effect by itself."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass, field, replace
from functools import partial

from crosscheck.engines import PHYSICAL, QUANTITIES, Simulating
from crosscheck.engines.methods import ORDERS, Method
from refkin.model import Effect, Evidence, Point, Scene
from refkin.motion import Motion

REFKIN = "refkin"
Work = Callable[[], Motion]


@dataclass(frozen=True)
class Ablation:
    """An effect as two answers, by name: without it and with it."""

    effect: str
    off: str = field(kw_only=True)
    on: str = field(kw_only=True)
    called_for: bool = field(kw_only=True)
    note: str = field(kw_only=True)


@dataclass(frozen=True)
class Ablations:
    """What is measured of one method: its answers by name, the effects as pairs of them, and why others are absent."""

    method: Method
    works: Mapping[str, Work]
    effects: tuple[Ablation, ...]
    absent: Mapping[str, str] = field(default_factory=dict)

    @property
    def exact(self) -> bool:
        """Whether every bit counts: in the reference."""
        return self.method.engine == REFKIN


POSITION, VELOCITY, ACCELERATION = QUANTITIES


def bare(scene: Scene, effects: frozenset[Effect] = frozenset(Effect)) -> Scene:
    """Return a scene that calls for positions of all bodies, for some effects, and for nothing else."""
    return replace(scene, effects=effects, evidence=frozenset(), points=(), bodies_wanted=None)


LEVELS = (
    Ablation(VELOCITY, off=POSITION, on=VELOCITY, called_for=True, note="beyond position"),
    Ablation(ACCELERATION, off=VELOCITY, on=ACCELERATION, called_for=True, note="beyond velocity"),
)


EVIDENCE = {
    "condition": (Evidence.CONDITION, "singular values of phi_q"),
    "certificate": (Evidence.CERTIFICATE, "a proof of every pose and rate"),
}
OWN = dict.fromkeys(("condition", "certificate"), "evidence is the reference's own, the engine gives none")
"""What no engine has a part in, and why."""


def _wanted(scene: Scene) -> tuple[dict[str, Scene], list[Ablation], dict[str, str]]:
    """Return what points and other bodies are seen by: scenes, ablations, and why there is no ablation."""
    whole, body = bare(scene), scene.mechanism.bodies[0].name
    origin = (0.0,) * scene.mechanism.kind.dimension
    points = scene.points or (Point(name="a point", body=body, position=origin),)
    many = f"{len(points)} of them, position to acceleration"
    scenes = {"points": replace(whole, points=points)}
    ablations = [Ablation("points", off=ACCELERATION, on="points", called_for=True, note=many)]
    if len(scene.mechanism.bodies) == 1:
        return scenes, ablations, {"other bodies": f"{body} is the only body"}
    scenes["one body"] = replace(whole, bodies_wanted=(body,))
    beside = f"those beside {body}"
    ablations.append(Ablation("other bodies", off="one body", on=ACCELERATION, called_for=True, note=beside))
    return scenes, ablations, {}


def ablations(method: Method, scene: Scene) -> Ablations:
    """Return what is switched on and off in a method, each against an answer without it.

    Evidence is the reference's own; physical effects are an engine's, which may have been made to simulate.
    """
    wanted, reported, absent = _wanted(scene)
    scenes = {**{q: bare(scene, effects) for q, effects in zip(QUANTITIES, ORDERS, strict=True)}, **wanted}
    listed = [*LEVELS[: method.highest], *reported]
    absent |= {level.effect: "the engine delivers none" for level in LEVELS[method.highest :]}
    works: dict[str, Work] = {}
    if method.engine == REFKIN:
        whole = bare(scene)
        for name, (kind, note) in EVIDENCE.items():
            scenes[name] = replace(whole, evidence=frozenset({kind}))
            listed.append(Ablation(name, off=ACCELERATION, on=name, called_for=True, note=note))
        absent |= dict.fromkeys(PHYSICAL, "refkin has none: no formula of it holds a mass or a force")
    else:
        simulating = method.simulating
        simulated = simulating.physical_effects() if simulating else {}
        for effect, how in simulated.items():
            works[effect] = partial(method.affected(effect).solve, bare(scene))
            listed.append(Ablation(effect, off=ACCELERATION, on=effect, called_for=False, note=how))
        absent |= {**OWN, **_not_simulated(simulating, simulated)}
    works |= {name: partial(method.solve, asked) for name, asked in scenes.items()}
    return Ablations(method, works, tuple(listed), absent)


def _not_simulated(engine: Simulating | None, simulated: Mapping[str, str]) -> dict[str, str]:
    """Return each physical effect that is not switched on, and why."""
    if engine is None:
        return dict.fromkeys(PHYSICAL, "the engine offers no simulation to switch on")
    reasons = engine.missing_effects()
    return {effect: reasons.get(effect, "the engine names none") for effect in PHYSICAL if effect not in simulated}
