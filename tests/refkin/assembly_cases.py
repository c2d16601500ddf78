"""Linkages with few words, linkages drawn around a pose, and the formula that says whether a four-bar assembles."""

from __future__ import annotations

import cmath

import mpmath
import numpy as np

from refkin.joints import (
    AngleDriver,
    Distance,
    DistanceDriver,
    Fixed,
    PointOnLine,
    Prismatic,
    Revolute,
)
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
            name="guide",
            body_i="ground",
            point_i=(0.0, offset),
            axis_i=(1.0, 0.0),
            body_j="slider",
            point_j=(0.0, 0.0),
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


class Assembled:
    """Bodies that lie somewhere, and joints made to fit them: every joint is drawn at a point of the plane."""

    def __init__(self, rng, *names):
        self.rng, self.pose, self.joints, self.drivers = rng, {"ground": (0j, 0.0)}, [], []
        for name in names:
            self.body(name)

    def point(self):
        return complex(*self.rng.uniform(-1, 1, 2))

    def local(self, body, point):
        r, phi = self.pose[body]
        u = (point - r) * cmath.exp(-1j * phi)
        return (u.real, u.imag)

    def any_body(self):
        return str(self.rng.choice(sorted(self.pose)))

    def body(self, name=None):
        name = name or f"b{len(self.pose)}"
        self.pose[name] = (self.point(), float(self.rng.uniform(-3, 3)))
        return name

    def ends(self, i, at_i, j, at_j):
        names = {"name": f"joint {len(self.joints)}", "body_i": i, "body_j": j}
        return {**names, "point_i": self.local(i, at_i), "point_j": self.local(j, at_j)}

    def pin(self, i, j):
        at = self.point()
        self.joints.append(Revolute(**self.ends(i, at, j, at)))

    def slide(self, i, j, turning=False):
        at, axis = self.point(), cmath.exp(1j * self.rng.uniform(-3, 3))
        inner = axis * cmath.exp(-1j * self.pose[i][1])
        ends = self.ends(i, at, j, at + axis * self.rng.uniform(-1, 1)) | {"axis_i": (inner.real, inner.imag)}
        kind = PointOnLine(**ends) if turning else Prismatic(**ends, angle=self.pose[j][1] - self.pose[i][1])
        self.joints.append(kind)

    def rod(self, i, j):
        a, b = self.point(), self.point()
        self.joints.append(Distance(**self.ends(i, a, j, b), length=abs(b - a)))

    def weld(self, i, j):
        at = self.point()
        self.joints.append(Fixed(**self.ends(i, at, j, at), angle=self.pose[j][1] - self.pose[i][1]))

    def turn(self, i, a):
        law = constant(self.pose[a][1] - self.pose[i][1])
        self.drivers.append(AngleDriver(name=f"motor {a}", body=a, relative_to=i, law=law))

    def add_group(self):
        """Add one or two bodies that are determined by those there are."""
        group = GROUPS[self.rng.integers(len(GROUPS))]
        group(self, self.any_body(), self.any_body(), self.body())

    def mechanism(self):
        return Mechanism(bodies(*(b for b in self.pose if b != "ground")), tuple(self.joints), tuple(self.drivers))

    def q(self, system):
        drawn = [c for b, (r, phi) in self.pose.items() if b != "ground" for c in (r.real, r.imag, phi)]
        return system.to_unit(np.array(drawn))


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
    d.pin(i, a), d.slide(b, a), d.slide(b, j, turning=True), d.rod(i, a)


def pin_and_line_of_the_other(d, i, j, a):
    d.pin(i, a), d.slide(j, a, turning=True)


def pin_and_own_line(d, i, j, a):
    d.pin(i, a), d.slide(a, j, turning=True)


def pin_and_rod(d, i, j, a):
    d.pin(i, a), d.rod(j, a)


def slider_and_rod(d, i, j, a):
    d.slide(i, a), d.rod(j, a)


def fixed(d, i, j, a):
    d.weld(i, a)


def driven(d, i, j, a):
    d.pin(i, a), d.turn(i, a)


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
