"""Scenes for the vector-loop method: the rapier drive in absolute coordinates, joints that touch; not a test itself."""

from __future__ import annotations

import cmath
from dataclasses import replace

import numpy as np

from crosscheck.documents.systems.metu import Rapier
from refkin.joints import GROUND, AngleDriver, Cam, Disc, Gear, Polar, Prismatic, RackAndPinion
from refkin.model import Body, Mechanism, Scene
from refkin.motion_laws import Polynomial, Sinusoid
from tests.linkages import ROCKER

from .exact_linkages import pair, pin

LENGTHS = {"a1": 340, "b1": 520, "d1": 623, "a2": 250, "a3": 1225, "a4": 350, "a5": 600, "b4": 600, "a6": 1100}
DRIVES = {
    "R1": Rapier(-623.0, -340.0, -520.0, -250.0, -623.0, 250.0, 1225.0, 350.0, 600.0, 1100.0),
    "R2": Rapier(-623.0, -340.0, 520.0, 950.0, 0.0, 250.0, 1225.0, 350.0, 600.0, 1100.0),
}
"""The rapier drive in both readings of its lost figure [mm]."""


def rapier(reading, times, **lengths):
    """The rapier drive in absolute coordinates, of five bodies in two coupled loops."""
    long = {**LENGTHS, **lengths}
    first = reading == "R1"
    c0 = complex(-long["d1"], -long["a1"])
    to_d, guide = (long["a4"] - long["b4"], -long["b1"]) if first else (long["a4"] + long["b4"], long["b1"])
    estimate = {"crank": (0, 1.05), "coupler": (125 + 216j, 3.3), "lever": (-1223 - 300j, 1.15)}
    estimate |= {"rocker": (c0, 3.1), "rapier": (-1317 + 1j * guide if first else -824 + 1j * guide, 0.0)}
    joints = (
        pin("A0", GROUND, 0j, "crank", 0j),
        pin("A", "crank", long["a2"], "coupler", 0j),
        pin("B", "coupler", long["a3"], "lever", long["a4"]),
        pin("C", "lever", 0j, "rocker", long["a5"]),
        pin("C0", GROUND, c0, "rocker", 0j),
        pin("D", "lever", to_d, "rapier", 0j),
        Prismatic(
            name="guide", body_i=GROUND, point_i=(0.0, guide), axis_i=(1.0, 0.0), body_j="rapier", point_j=(0.0, 0.0)
        ),
    )
    bodies = tuple(Body(name=name, estimate=(*pair(z), phi)) for name, (z, phi) in estimate.items())
    driver = AngleDriver(name="motor", body="crank", law=Polynomial(coefficients=(0.0, 1.0)))
    return Scene(mechanism=Mechanism(bodies, joints, (driver,)), times=tuple(times))


def touching():
    """Scenes with a gear pair, a rack, a disc cam with each follower, a pivot moved by a law."""
    wave = Sinusoid(amplitude=2.0, angular_frequency=1.0, phase=0.2)
    axis = cmath.rect(2.0, 0.5)

    def scene(bodies, joints, driven, law=wave):
        held = tuple(Body(name=name, estimate=q) for name, q in bodies.items())
        driver = AngleDriver(name="motor", body=driven, law=law)
        return Scene(mechanism=Mechanism(held, tuple(joints), (driver,)), times=tuple(np.linspace(0.0, 3.0, 9)))

    wheel = pin("A", GROUND, 0j, "wheel", 0j)
    gear = Gear(name="g", body_i="wheel", radius_i=1.0, body_j="other", radius_j=2.0, phi0_i=0.1, phi0_j=0.3)
    on_axis = {"body_i": GROUND, "point_i": (0.2, 0.0), "axis_i": pair(axis), "body_j": "rack", "point_j": (0.0, 0.1)}
    rolls = {"body_i": "rack", "point_i": (0.0, 0.1), "axis_i": pair(axis * cmath.exp(-0.3j))}
    rack = RackAndPinion(name="r", **rolls, body_j="wheel", point_j=(0.0, 0.0), radius=0.4, phi0=0.2, s0=0.1)
    yield (
        "gear",
        scene(
            {"wheel": (0.0, 0.0, 0.4), "other": (3.0, 0.0, 0.0)},
            (wheel, pin("B", GROUND, 3.0, "other", 0.5), gear),
            "wheel",
        ),
    )
    slide = Prismatic(name="P", **on_axis, angle=0.3)
    yield "rack", scene({"wheel": (0.0, 0.0, 0.4), "rack": (0.0, 0.0, 0.3)}, (wheel, slide, rack), "wheel")
    guide = Prismatic(
        name="P", body_i=GROUND, point_i=(0.1, 0.0), axis_i=(0.0, 1.0), body_j="follower", point_j=(0.0, 0.0)
    )
    for kind, more in (("flat", {"normal_j": (0.6, 0.8)}), ("point", {}), ("roller", {"roller_radius": 0.3})):
        ends = {"body_i": "wheel", "point_i": (0.3, 0.2), "body_j": "follower", "point_j": (0.0, 0.0)}
        cam = Cam(name="c", **ends, profile=Disc(radius=1.0), follower=kind, **more)
        yield kind, scene({"wheel": (0.0, 0.0, 0.4), "follower": (0.1, 1.4, 0.0)}, (wheel, guide, cam), "wheel")
    linkage = ROCKER.scene(samples=9)
    *rest, b0 = linkage.mechanism.joints
    moved = replace(
        b0, offset_law=(Sinusoid(amplitude=0.2, angular_frequency=1.3), Polynomial(coefficients=(0.0, 0.1)))
    )
    yield "pivot", replace(linkage, mechanism=replace(linkage.mechanism, joints=(*rest, moved)))


TOUCHING = dict(touching())


def general_cam():
    """Return a scene with a cam that is no disc, of which an engine can know no distance of two points."""
    scene = TOUCHING["point"]
    *rest, cam = scene.mechanism.joints
    general = replace(cam, profile=Polar(law=Sinusoid(amplitude=0.1, angular_frequency=1.0, offset=1.0)))
    return replace(scene, mechanism=replace(scene.mechanism, joints=(*rest, general)))
