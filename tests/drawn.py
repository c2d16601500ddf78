"""Mechanisms drawn around a pose: each joint's numbers are made to fit bodies that already lie somewhere.

So every kind of joint is there, between any two bodies, and every mechanism assembles. A pose is (x + i y, phi) by name
of the body; joints are made at points of the plane, given or drawn.
"""

from __future__ import annotations

import cmath

import numpy as np

from refkin.joints import (
    GROUND,
    AngleDriver,
    Distance,
    DistanceDriver,
    Fixed,
    PointOnLine,
    Prismatic,
    Revolute,
    XDriver,
    YDriver,
)
from refkin.model import Body, Mechanism, Scene
from refkin.motion_laws import Polynomial, Sinusoid, Table
from refkin.system import compile_system


def pair(z):
    """Return a point of the plane as two numbers."""
    return complex(z).real, complex(z).imag


def pin(name, i, point_i, j, point_j):
    """Return a revolute joint at points of two bodies, each a complex number."""
    return Revolute(name=name, body_i=i, point_i=pair(point_i), body_j=j, point_j=pair(point_j))


class Drawing:
    """A pose of some bodies, and joints and drivers that fit it; laws begin with the given `rates`."""

    def __init__(self, pose, rates=(0.7, -0.4)):
        self.pose, self.rates = {GROUND: (0j, 0.0), **pose}, rates
        self.joints, self.drivers = [], []

    def local(self, body, point):
        r, phi = self.pose[body]
        return pair((point - r) * cmath.exp(-1j * phi))

    def place(self, body, u):
        r, phi = self.pose[body]
        return r + u * cmath.exp(1j * phi)

    def angle(self, i, j):
        return self.pose[j][1] - self.pose[i][1]

    def named(self):
        return {"name": f"joint {len(self.joints) + len(self.drivers)}"}

    def ends(self, i, p, j, q):
        points = {"point_i": self.local(i, p), "point_j": self.local(j, q)}
        return {**self.named(), "body_i": i, "body_j": j, **points}

    def pin(self, i, j, p):
        self.joints.append(Revolute(**self.ends(i, p, j, p)))

    def weld(self, i, j, p):
        self.joints.append(Fixed(**self.ends(i, p, j, p), angle=self.angle(i, j)))

    def slide(self, i, j, p, q, direction, turning=False):
        """The point q of body j slides along a direction through the point p of body i; it may turn there, or not."""
        axis = direction * cmath.exp(-1j * self.pose[i][1])
        ends = {**self.ends(i, p, j, q), "axis_i": pair(axis)}
        self.joints.append(PointOnLine(**ends) if turning else Prismatic(**ends, angle=self.angle(i, j)))

    def link(self, i, j, p, q):
        self.joints.append(Distance(**self.ends(i, p, j, q), length=abs(q - p)))

    def law(self, value):
        return Polynomial(coefficients=(value, *self.rates))

    def drive_angle(self, body, relative_to=GROUND):
        law = self.law(self.angle(relative_to, body))
        self.drivers.append(AngleDriver(**self.named(), body=body, relative_to=relative_to, law=law))

    def drive_x(self, body, p):
        self.drivers.append(XDriver(**self.named(), body=body, point=self.local(body, p), law=self.law(p.real)))

    def drive_y(self, body, p):
        self.drivers.append(YDriver(**self.named(), body=body, point=self.local(body, p), law=self.law(p.imag)))

    def drive_distance(self, i, j, p, q):
        self.drivers.append(DistanceDriver(**self.ends(i, p, j, q), law=self.law(abs(q - p))))

    def coordinates(self):
        """Return the coordinates [m, rad] of each body but the ground."""
        return {name: (r.real, r.imag, phi) for name, (r, phi) in self.pose.items() if name != GROUND}

    def mechanism(self, estimated=False):
        bodies = (Body(name=n, estimate=q if estimated else None) for n, q in self.coordinates().items())
        return Mechanism(tuple(bodies), tuple(self.joints), tuple(self.drivers))

    def scene(self, times):
        return Scene(mechanism=self.mechanism(estimated=True), times=times)

    def q(self, system):
        """Return the drawn pose in the coordinates of a system of the mechanism."""
        return system.to_unit(np.concatenate(list(self.coordinates().values())))

    def system(self, unit=None):
        """Return the system, in its own unit by default, and the drawn pose in its coordinates."""
        mechanism = self.mechanism()
        system = compile_system(mechanism, unit=unit or mechanism.unit())
        return system, self.q(system)


class Drawn(Drawing):
    """A drawing whose bodies and points are drawn, in a square of side 2; its laws too, unless it is `still`."""

    def __init__(self, rng, *names, still=False):
        super().__init__({}, rates=())
        self.rng, self.still = rng, still
        for name in names:
            self.body(name)

    def point(self):
        return complex(*self.rng.uniform(-1, 1, 2))

    def body(self, name=None):
        name = name or f"b{len(self.pose)}"
        self.pose[name] = (self.point(), float(self.rng.uniform(-3, 3)))
        return name

    def pin(self, i, j, p=None):
        super().pin(i, j, self.point() if p is None else p)

    def weld(self, i, j, p=None):
        super().weld(i, j, self.point() if p is None else p)

    def slide(self, i, j, turning=False):
        p, axis = self.point(), cmath.exp(1j * self.rng.uniform(-3, 3))
        q, axis = p + axis * self.rng.uniform(-1, 1), axis * self.rng.uniform(0.1, 10)
        super().slide(i, j, p, q, axis, turning)

    def link(self, i, j):
        super().link(i, j, self.point(), self.point())

    def law(self, value):
        """Return a law that starts at a value, at t = 0."""
        if self.still:
            return super().law(value)
        rate, swing = self.rng.uniform(-1, 1, 2)
        knots = tuple(float(k) for k in range(-2, 5))
        return (
            Polynomial(coefficients=(value, rate, swing)),
            Sinusoid(offset=value, amplitude=swing, angular_frequency=1 + rate**2),
            Table(argument=knots, value=tuple(value + (rate * k if k else 0.0) for k in knots)),
        )[self.rng.integers(3)]

    def turn(self, body):
        """Drive its angle by a law, or by one of its rate."""
        if self.rng.random() < 0.25:
            rate = Sinusoid(amplitude=1.0, angular_frequency=0.5, offset=1.0)
            self.drivers.append(AngleDriver(**self.named(), body=body, rate_law=rate, initial=self.pose[body][1]))
        else:
            self.drive_angle(body)
