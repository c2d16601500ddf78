"""Spatial mechanisms of few numbers, with estimates to two digits, for the tests of the engines in space."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import replace
from typing import Any

import numpy as np

from crosscheck.engines.spatial.turning import joint_frame, parameters
from crosscheck.scenes.conformance import questions
from refkin.joints import (
    GROUND,
    Cylindrical,
    DisplacementDriver,
    Screw,
    SpatialAngleDriver,
    SpatialDistance,
    SpatialDistanceDriver,
    SpatialPrismatic,
    SpatialRevolute,
    Universal,
)
from refkin.model import Body, Mechanism, Scene
from refkin.motion_laws import Polynomial
from refkin.scenes.linkages import RSSP, RSSR, Bennett, SpatialLinkage

TIMES = tuple(np.linspace(0.0, 2.0 * math.pi / 1.7, 25).tolist())
LAW = Polynomial(coefficients=(0.4, 1.7, -0.225))
AT, X, Y, Z = (0.0, 0.0, 0.0), (1.0, 0.0, 0.0), (0.0, 1.0, 0.0), (0.0, 0.0, 1.0)


def between(i: str, at_i: Sequence[float], j: str, at_j: Sequence[float]) -> dict[str, Any]:
    return {"body_i": i, "point_i": tuple(at_i), "body_j": j, "point_j": tuple(at_j)}


def axes(axis_i: Any, zero_i: Any, axis_j: Any, zero_j: Any) -> dict[str, Any]:
    fields = {"axis_i": axis_i, "zero_i": zero_i, "axis_j": axis_j, "zero_j": zero_j}
    return {key: None if value is None else tuple(float(x) for x in value) for key, value in fields.items()}


def scene(name: str, bodies: Sequence[tuple[str, Any]], joints: Sequence[Any], *drivers: Any) -> Scene:
    known = tuple(Body(name=body, estimate=tuple(round(float(x), 3) for x in at)) for body, at in bodies)
    return Scene(mechanism=Mechanism(known, tuple(joints), tuple(drivers)), times=TIMES, name=name)


def motor(joint: str = "R1") -> SpatialAngleDriver:
    return SpatialAngleDriver(name="motor", joint=joint, law=LAW)


def of_linkage(linkage: SpatialLinkage, name: str) -> Scene:
    """Return a linkage whose input follows `LAW`, with estimates as rough as those of the others."""
    return scene(name, [*linkage.assemble(LAW(0.0)).items()], linkage.joints(), motor())


def rssr(*, massless: bool = False) -> Scene:
    """RSSR with its coupler, which spins as it likes."""
    pivot, axis = (2.5, -0.5, 0.75), (0.25, 1.0, 0.125)
    return of_linkage(RSSR(1.0, 3.0, 2.0, pivot, axis, massless=massless), "RSSR")


def rssr_by_distance() -> Scene:
    return rssr(massless=True)


def rssr_by_a_cylinder() -> Scene:
    """The coupler is a cylinder that pushes the rocker: a driven distance."""
    law = Polynomial(coefficients=(3.0, 0.06, -0.02))
    cylinder = SpatialDistanceDriver(name="cylinder", **between("crank", X, "rocker", (2.0, 0.0, 0.0)), law=law)
    by_distance, m = rssr_by_distance(), rssr_by_distance().mechanism
    return replace(by_distance, mechanism=replace(m, joints=m.joints[::2], drivers=(*m.drivers, cylinder)))


def rssp() -> Scene:
    """A spatial slider-crank, the slide askew."""
    return of_linkage(RSSP(1.0, 3.0, (1.0, 0.5, 0.2), (1.0, 0.2, 0.1)), "RSSP")


def bennett() -> Scene:
    """Bennett's linkage: opposite links equal, a / sin alpha = b / sin beta; three rows are redundant."""
    return of_linkage(Bennett(1.0, 0.6, 1.1), "Bennett")


def double_hooke() -> Scene:
    """Two shafts askew, joined by a link with a universal joint at either end; the output may shift."""
    n, first = np.array([0.0, math.sin(0.5), math.cos(0.5)]), np.array([0.0, 0.0, 1.0])
    line = np.array([0.0, math.sin(0.3), math.cos(0.3)])
    pin = np.array([math.cos(0.4), math.sin(0.4), 0.0])
    across = np.cross(line, pin) / np.linalg.norm(np.cross(line, pin))
    link = np.stack([np.cross(across, line), across, line], axis=1)
    fork = np.cross(across, n) / np.linalg.norm(np.cross(across, n))
    shaft = np.stack([fork, np.cross(n, fork), n], axis=1)
    bodies = (
        ("input", (0.0, 0.0, 0.0, *parameters(joint_frame(Z, pin)))),
        ("link", (*first, *parameters(link))),
        ("output", (*(first + line), *parameters(shaft))),
    )
    joints = (
        SpatialRevolute(name="R1", **between(GROUND, AT, "input", AT), **axes(Z, X, Z, X)),
        Universal(name="U1", **between("input", Z, "link", AT), axis_i=X, axis_j=Y),
        Universal(name="U2", **between("link", Z, "output", AT), axis_i=Y, axis_j=X),
        Cylindrical(name="C", **between(GROUND, first + line + 0.7 * n, "output", (0.0, 0.0, 0.7)), **axes(n, X, Z, X)),
    )
    return scene("double Hooke", bodies, joints, motor())


def screw_jack() -> Scene:
    """A nut that turns on a screw and lifts a slider through a distance."""
    screw = Screw(name="H", **between(GROUND, AT, "nut", AT), **axes(Z, X, Z, X), pitch=0.125, shift=0.25)
    rail = SpatialPrismatic(name="P", **between(GROUND, (2.0, 0.0, 0.0), "slider", AT), **axes(X, Y, X, Y))
    rod = SpatialDistance(name="rod", **between("nut", (0.5, 0.0, 0.0), "slider", (0.0, 0.5, 0.0)), length=2.5)
    bodies = (("nut", (0.0, 0.0, 0.3, 0.98, 0.0, 0.0, 0.2)), ("slider", (2.94, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0)))
    return scene("screw jack", bodies, (screw, rail, rod), motor("H"))


def bevel_wheels() -> Scene:
    return next(question.scene for question in questions() if question.about == "space: gear, bevel wheels")


def gears_on_an_arm() -> Scene:
    return next(question.scene for question in questions() if question.about == "space: gears on an arm")


def two_slides() -> Scene:
    """A cylindrical joint driven in both ways, and a slider that a distance ties to it."""
    joint = Cylindrical(name="C", **between(GROUND, AT, "arm", AT), **axes((0.2, 0.1, 1.0), X, Z, X))
    rail = SpatialPrismatic(name="P", **between(GROUND, (2.0, 0.0, 0.0), "slider", AT), **axes(X, Y, X, Y))
    rod = SpatialDistance(name="rod", **between("arm", (0.5, 0.0, 0.0), "slider", (0.0, 0.5, 0.0)), length=3.0)
    lift = DisplacementDriver(name="lift", joint="C", law=Polynomial(coefficients=(0.1, 0.05, 0.03)))
    frame = joint_frame((0.2, 0.1, 1.0), X) @ np.array(
        [[math.cos(0.4), -math.sin(0.4), 0.0], [math.sin(0.4), math.cos(0.4), 0.0], [0.0, 0.0, 1.0]]
    )
    bodies = (("arm", (0.02, 0.01, 0.1, *parameters(frame))), ("slider", (3.4, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0)))
    return scene("two slides", bodies, (joint, rail, rod), motor("C"), lift)


ALL = (rssr, rssr_by_distance, rssr_by_a_cylinder, rssp, bennett, double_hooke, screw_jack, two_slides)
GEARED = (bevel_wheels, gears_on_an_arm)
