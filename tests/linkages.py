"""Linkages that many tests move, and scenes made of others: of other parts, with another law, with copies of bodies."""

from __future__ import annotations

import math
from collections.abc import Callable, Collection
from dataclasses import replace
from typing import Any

from refkin import AngleDriver, FourBar, Revolute, solve
from refkin.model import Body, Scene
from refkin.system import System, compile_system

ROCKER = FourBar(ground=4.0, crank=1.0, coupler=3.5, rocker=3.0)
LIMITED = FourBar(ground=0.9, crank=0.3, coupler=0.6, rocker=0.45)
CHANGE_POINT = FourBar(ground=4.0, crank=1.0, coupler=3.5, rocker=1.5)
PARALLELOGRAM = FourBar(ground=3.0, crank=1.0, coupler=3.0, rocker=1.0)
KITE = FourBar(ground=3.0, crank=1.0, coupler=1.0, rocker=3.0)


def remade(scene: Scene, **parts: Any) -> Scene:
    """Return a scene with other parts, of its own or of its mechanism."""
    own = {key: parts.pop(key) for key in ("bodies", "joints", "drivers") if key in parts}
    return replace(scene, mechanism=replace(scene.mechanism, **own), **parts)


def with_law(scene: Scene, law: Any) -> Scene:
    """Return a scene whose first driver follows another law, whether the linkage can or not."""
    first, *others = scene.mechanism.drivers
    return remade(scene, drivers=(replace(first, law=law), *others))


def with_estimates(scene: Scene, of: Callable[[Body], Any]) -> Scene:
    """Return a scene with other estimates, each of which a function gives for its body."""
    return remade(scene, bodies=tuple(replace(b, estimate=of(b)) for b in scene.mechanism.bodies))


def without_estimates(scene: Scene, *kept: str) -> Scene:
    """Return a scene that gives no estimate but those of the bodies that are kept."""
    return with_estimates(scene, lambda b: b.estimate if b.name in kept else None)


def moved_frame(scene: Scene, body: str, at: tuple[float, float]) -> Scene:
    """Return a scene with the frame of one of its bodies at another point of that: the motion stays."""
    u, v = at

    def joint(c: Any) -> Any:
        points = {f"point_{s}": getattr(c, f"point_{s}") for s in "ij" if getattr(c, f"body_{s}") == body}
        return replace(c, **{key: (float(x - u), float(y - v)) for key, (x, y) in points.items()})

    def estimate(b: Body) -> Any:
        if b.name != body:
            return b.estimate
        x, y, phi = b.estimate
        c, s = math.cos(phi), math.sin(phi)
        return x + c * u - s * v, y + s * u + c * v, phi

    return remade(with_estimates(scene, estimate), joints=tuple(map(joint, scene.mechanism.joints)))


def copied(scene: Scene, names: Collection[str], other: Scene | None = None) -> Scene:
    """Return a scene with copies of some bodies, its own or another scene's, and of the joints that they have."""
    m, of = scene.mechanism, (other or scene).mechanism
    name = {body: f"{body} 2" for body in names}
    bodies = [replace(b, name=name[b.name]) for b in of.bodies if b.name in name]
    joints = [
        replace(j, name=f"{j.name} 2", body_i=name.get(j.body_i, j.body_i), body_j=name.get(j.body_j, j.body_j))
        for j in of.joints
        if {j.body_i, j.body_j} & {*names}
    ]
    return remade(scene, bodies=(*m.bodies, *bodies), joints=(*m.joints, *joints))


def beside(scene: Scene, other: Scene) -> Scene:
    """Return a scene with the mechanism of another one, each of its parts called a second one, beside its own."""

    def second(part: Any) -> Any:
        keys = [key for key in ("name", "body", "body_i", "body_j") if getattr(part, key, "ground") != "ground"]
        return replace(part, **{key: f"{getattr(part, key)} 2" for key in keys})

    m, of, kinds = scene.mechanism, other.mechanism, ("bodies", "joints", "drivers")
    return remade(scene, **{kind: (*getattr(m, kind), *map(second, getattr(of, kind))) for kind in kinds})


def beside_a_wheel(scene: Scene, law: Any) -> Scene:
    """Return a scene with a wheel that a law turns, of which no estimate is given."""
    m = scene.mechanism
    pin = Revolute(name="pin", body_i="ground", point_i=(9.0, 0.0), body_j="wheel", point_j=(0.0, 0.0))
    motor = AngleDriver(name="motor", body="wheel", law=law)
    bodies = (*m.bodies, Body(name="wheel"))
    return remade(scene, bodies=bodies, joints=(*m.joints, pin), drivers=(*m.drivers, motor))


def system_of(scene: Scene) -> System:
    """Return the system of a scene in its mechanism's own unit."""
    return compile_system(scene.mechanism, unit=scene.mechanism.unit())


def solved(scene: Scene) -> tuple[System, Any]:
    """Return the system of a scene and the poses (n, T) that solve it, in its coordinates."""
    system = system_of(scene)
    return system, system.to_unit(solve(scene).q)


def posed(scene: Scene) -> tuple[System, Any]:
    """Return the system of a scene and its first pose (n,)."""
    system, q = solved(scene)
    return system, q[:, 0]
