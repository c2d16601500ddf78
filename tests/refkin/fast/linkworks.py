"""Mechanisms with many loops, in which groups of every size occur; not a test itself."""

from __future__ import annotations

import cmath
import math
from itertools import pairwise

import numpy as np

from refkin import AngleDriver, Body, DistanceDriver, Mechanism, Polynomial, Scene
from refkin.joints import GROUND
from tests.drawn import pair, pin


def chain(windows, *, together=False, times=None, **more):
    """Rockers side by side, each coupled to the next: `windows` four-bars, 2 windows + 1 bodies.

    The first rocker is driven, so that the loops are solved one after another; or, `together`, the distance from its
    tip to a point of the last beyond its foot is given, so that all are solved at once.
    """
    rockers = [1.0 + 0.05 * (k % 3) for k in range(windows + 1)]
    feet = [complex(1.5 * k) for k in range(windows + 1)]
    angles = [1.2 + 0.1 * (k % 2) for k in range(windows + 1)]
    tips = [foot + cmath.rect(r, phi) for foot, r, phi in zip(feet, rockers, angles, strict=True)]
    bodies, joints = [], []
    for k, (foot, tip, r, phi) in enumerate(zip(feet, tips, rockers, angles, strict=True)):
        bodies.append(_body(f"rocker{k}", (foot + tip) / 2, phi))
        joints.append(pin(f"foot{k}", GROUND, foot, f"rocker{k}", -r / 2))
    for k, (a, b) in enumerate(pairwise(tips)):
        bodies.append(_body(f"coupler{k}", (a + b) / 2, cmath.phase(b - a)))
        half = abs(b - a) / 2
        joints.append(pin(f"left{k}", f"rocker{k}", rockers[k] / 2, f"coupler{k}", -half))
        joints.append(pin(f"right{k}", f"coupler{k}", half, f"rocker{k + 1}", rockers[k + 1] / 2))
    if together:
        beyond = feet[-1] - cmath.rect(rockers[-1], angles[-1])
        ends = {"body_i": "rocker0", "point_i": (rockers[0] / 2, 0.0), "body_j": f"rocker{windows}"}
        law = Polynomial(coefficients=(abs(beyond - tips[0]), 0.1))
        driver = DistanceDriver(name="motor", **ends, point_j=(-1.5 * rockers[-1], 0.0), law=law)
    else:
        driver = AngleDriver(name="motor", body="rocker0", law=Polynomial(coefficients=(1.2, 0.2)))
    times = tuple(np.linspace(0.0, 1.0, 21).tolist()) if times is None else times
    return Scene(mechanism=Mechanism(tuple(bodies), tuple(joints), (driver,)), times=times, name="chain", **more)


def platform(times=None, **more):
    """A platform on three legs, one of which stands on a crank: a group of four coordinates, a triad."""
    corners = [cmath.rect(0.6, angle) for angle in (-2.6, -0.5, 1.6)]
    centre = complex(1.1, 0.9)
    ends = [centre + corner * cmath.rect(1.0, 0.1) for corner in corners]
    feet = [end + corner * 1.5j for end, corner in zip(ends, corners, strict=True)]  # legs along the platform's turn
    pivot = feet[0] - 0.15
    bodies, joints = (
        [_body("crank", pivot, 0.0), _body("platform", centre, 0.1)],
        [pin("A0", GROUND, pivot, "crank", 0j)],
    )
    for k, (foot, end, corner) in enumerate(zip(feet, ends, corners, strict=True)):
        bodies.append(_body(f"leg{k}", foot, cmath.phase(end - foot)))
        base, at = ("crank", 0.15) if k == 0 else (GROUND, foot)
        joints.append(pin(f"foot{k}", base, at, f"leg{k}", 0j))
        joints.append(pin(f"corner{k}", f"leg{k}", abs(end - foot), "platform", corner))
    driver = AngleDriver(name="motor", body="crank", law=Polynomial(coefficients=(0.0, 1.0)))
    times = tuple(np.linspace(0.0, math.tau, 73).tolist()) if times is None else times
    return Scene(mechanism=Mechanism(tuple(bodies), tuple(joints), (driver,)), times=times, name="platform", **more)


def _body(name, z, phi):
    return Body(name=name, estimate=(*(round(x, 3) for x in pair(z)), round(phi, 3)))
