"""Linkages drawn around a pose, of five families, and many of their poses; and any linkage beside a large body."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from typing import Any

import numpy as np

from refkin.analysis import position
from refkin.joints import GROUND, Revolute, Unit, XDriver
from refkin.model import Body, Scene
from refkin.motion_laws import Polynomial
from refkin.system import System
from tests.drawn import Drawn


def four_bar(rng: np.random.Generator) -> Drawn:
    d = Drawn(rng, "crank", "coupler", "rocker")
    for i, j in ((GROUND, "crank"), ("crank", "coupler"), ("coupler", "rocker"), (GROUND, "rocker")):
        d.pin(i, j)
    d.turn("crank")
    return d


def slider_crank(rng: np.random.Generator) -> Drawn:
    d = Drawn(rng, "crank", "rod", "slider")
    for i, j in ((GROUND, "crank"), ("crank", "rod"), ("rod", "slider")):
        d.pin(i, j)
    d.slide(GROUND, "slider")
    if rng.random() < 0.5:
        d.turn("crank")
    else:
        d.drive_x("slider", d.point())
    return d


def inverted(rng: np.random.Generator) -> Drawn:
    """A block on the crank pin slides along the rocker: a prismatic joint between two moving bodies."""
    d = Drawn(rng, "crank", "block", "rocker")
    for i, j in ((GROUND, "crank"), ("crank", "block"), (GROUND, "rocker")):
        d.pin(i, j)
    d.slide("rocker", "block")
    d.turn("crank")
    return d


def pin_in_slot(rng: np.random.Generator) -> Drawn:
    """A pin of the crank in a slot of the rocker, and a plate fixed to the rocker."""
    d = Drawn(rng, "crank", "rocker", "plate")
    d.pin(GROUND, "crank")
    d.pin(GROUND, "rocker")
    d.slide("rocker", "crank", turning=True)
    d.weld("rocker", "plate")
    d.turn("crank")
    return d


def massless_coupler(rng: np.random.Generator) -> Drawn:
    d = Drawn(rng, "crank", "rocker")
    d.pin(GROUND, "crank")
    d.pin(GROUND, "rocker")
    d.link("crank", "rocker")
    if rng.random() < 0.5:
        d.turn("crank")
    else:
        d.drive_distance(GROUND, "crank", d.point(), d.point())
    return d


FAMILIES: tuple[Callable[[np.random.Generator], Drawn], ...] = (
    four_bar,
    slider_crank,
    inverted,
    pin_in_slot,
    massless_coupler,
)


def perturbed(draw: Drawn, change: Callable[[float], float], unit: Unit | None = None) -> tuple[System, Any]:
    """Return the system of a drawn mechanism of revolute joints with every coordinate of its points changed."""
    for k, joint in enumerate(draw.joints):
        points = {side: tuple(change(c) for c in getattr(joint, side)) for side in ("point_i", "point_j")}
        draw.joints[k] = replace(joint, **points)
    return draw.system(unit)


def poses(count: int, seed: int, per_mechanism: int = 4) -> list[tuple[System, Any, Any]]:
    """Return `count` poses as (system, q (n, B), t (B,)), by Newton from the drawn pose of each mechanism."""
    rng = np.random.default_rng(seed)
    result, missing = [], count
    while missing:
        system, start = FAMILIES[len(result) % len(FAMILIES)](rng).system()
        times = np.sort(np.r_[0.0, rng.uniform(0, 0.05, per_mechanism - 1)])
        results = [position(system, start, float(t)) for t in times]
        reached = [k for k, r in enumerate(results) if r.converged][:missing]
        if reached:
            result.append((system, np.stack([results[k].q for k in reached], axis=1), times[reached]))
            missing -= len(reached)
    return result


def beside_a_mast(scene: Scene) -> Scene:
    """A scene with a mast of 1 km that a driver of its own holds: the size of what is small is none of its business."""
    mast = Body(name="mast", estimate=(0.0, 0.0, float(np.arccos(0.6))))
    foot = Revolute(name="foot", body_i=GROUND, point_i=(0.0, 0.0), body_j="mast", point_j=(0.0, 0.0))
    tip = XDriver(name="tip", body="mast", point=(1000.0, 0.0), law=Polynomial(coefficients=(600.0,)))
    m = scene.mechanism
    beside = replace(m, bodies=(*m.bodies, mast), joints=(*m.joints, foot), drivers=(*m.drivers, tip))
    return replace(scene, mechanism=beside)
