"""Linkages with few words, linkages drawn around a pose, and the formula that says whether a four-bar assembles."""

from __future__ import annotations

import mpmath
import numpy as np

from refkin.joints import AngleDriver, DistanceDriver, Prismatic, Revolute
from refkin.model import Body, Mechanism
from refkin.motion_laws import Polynomial
from refkin.proof.assembly.assembly import assemblies
from refkin.system import compile_system

ROUND_OFF = 1e-14
"""Residual of a pose in scaled coordinates: some ten roundings of numbers up to 10."""


def constant(value):
    return Polynomial(coefficients=(float(value),))


def pin(name, i, at_i, j, at_j):
    return Revolute(name=name, body_i=i, point_i=at_i, body_j=j, point_j=at_j)


def bodies(*names):
    return tuple(Body(name=name) for name in names)


def turned(body, law):
    return AngleDriver(name="motor", body=body, law=law if not isinstance(law, float) else constant(law))


def cylinder(i, at_i, j, at_j, length):
    return DistanceDriver(name="cylinder", body_i=i, point_i=at_i, body_j=j, point_j=at_j, law=constant(length))


def four_bar(ground, crank, coupler, rocker, driver, at=(0.0, 0.0)):
    """Pins A0, A, B, B0; `driver` is the crank's angle or a driver."""
    joints = (
        pin("A0", "ground", at, "crank", (0.0, 0.0)),
        pin("A", "crank", (crank, 0.0), "coupler", (0.0, 0.0)),
        pin("B", "coupler", (coupler, 0.0), "rocker", (rocker, 0.0)),
        pin("B0", "ground", (at[0] + ground, at[1]), "rocker", (0.0, 0.0)),
    )
    driver = turned("crank", driver) if isinstance(driver, float) else driver
    return Mechanism(bodies("crank", "coupler", "rocker"), joints, (driver,))


def slider_crank(crank, rod, offset, driver):
    joints = (
        pin("A0", "ground", (0.0, 0.0), "crank", (0.0, 0.0)),
        pin("A", "crank", (crank, 0.0), "rod", (0.0, 0.0)),
        pin("C", "rod", (rod, 0.0), "slider", (0.0, 0.0)),
        Prismatic(
            name="guide", body_i="ground", point_i=(0.0, offset), axis_i=(1.0, 0.0), body_j="slider", point_j=(0.0, 0.0)
        ),
    )
    return Mechanism(bodies("crank", "rod", "slider"), joints, (driver,))


def solved(mechanism, t=0.0):
    system = compile_system(mechanism, unit=mechanism.unit())
    return system, assemblies(system, t)


def residual(system, actual, t=0.0):
    """Largest residual of the poses, relative to their largest coordinate above 1."""
    return max(np.abs(system.phi(q, t)).max() / max(1.0, np.abs(q).max()) for q in actual.poses)


def diagonal(ground, crank, angle):
    """|B0 - A| to 50 digits."""
    with mpmath.workdps(50):
        g, a, th = (mpmath.mpf(x) for x in (ground, crank, angle))
        return mpmath.sqrt((g - a * mpmath.cos(th)) ** 2 + (a * mpmath.sin(th)) ** 2)


def missing(ground, crank, coupler, rocker, angle):
    """What a four-bar misses: D - (b + c) or |b - c| - D, whichever is larger; negative if it assembles."""
    with mpmath.workdps(50):
        d, b, c = diagonal(ground, crank, angle), mpmath.mpf(coupler), mpmath.mpf(rocker)
        return max(d - (b + c), abs(b - c) - d)


def distance(one, other):
    """Largest difference of two poses, angles without whole turns."""
    off = one - other
    off[2::3] = (off[2::3] + np.pi) % (2 * np.pi) - np.pi
    return float(np.abs(off).max())


def add_group(drawing):
    """Add one or two bodies that are determined by those there are."""
    group = GROUPS[drawing.rng.integers(len(GROUPS))]
    bodies = sorted(drawing.pose)
    i, j = (str(drawing.rng.choice(bodies)) for _ in range(2))
    group(drawing, i, j, drawing.body())


def rrr(d, i, j, a):
    b = d.body()
    d.pin(i, a), d.pin(a, b), d.pin(b, j)


def rrp(d, i, j, a):
    b = d.body()
    d.pin(i, a), d.pin(a, b), d.slide(j, b)


def rpr(d, i, j, a):
    b = d.body()
    d.pin(i, a), d.slide(a, b), d.pin(b, j)


def prp(d, i, j, a):
    b = d.body()
    d.slide(i, a), d.pin(a, b), d.slide(b, j)


def slider_on_a_lever(d, i, j, a):
    b = d.body()
    d.pin(i, a), d.slide(b, a), d.slide(b, j, turning=True), d.link(i, a)


def pin_and_line_of_the_other(d, i, j, a):
    d.pin(i, a), d.slide(j, a, turning=True)


def pin_and_own_line(d, i, j, a):
    d.pin(i, a), d.slide(a, j, turning=True)


def pin_and_rod(d, i, j, a):
    d.pin(i, a), d.link(j, a)


def slider_and_rod(d, i, j, a):
    d.slide(i, a), d.link(j, a)


def fixed(d, i, j, a):
    d.weld(i, a)


def driven(d, i, j, a):
    d.pin(i, a), d.drive_angle(a, i)


def three_points_on_lines(d, i, j, a):
    for _ in range(3):
        d.slide(i, a, turning=True)


def three_lines_on_points(d, i, j, a):
    for _ in range(3):
        d.slide(a, i, turning=True)


GROUPS = (
    rrr,
    rrp,
    rpr,
    prp,
    slider_on_a_lever,
    pin_and_line_of_the_other,
    pin_and_own_line,
    pin_and_rod,
    slider_and_rod,
    fixed,
    driven,
    three_points_on_lines,
    three_lines_on_points,
)
