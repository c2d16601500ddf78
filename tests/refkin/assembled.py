"""Mechanisms drawn around a pose: each joint's numbers are made to fit bodies that already lie somewhere.

So every kind of joint is there, between any two bodies, and every mechanism assembles. A pose is (x + i y, phi) by name
of the body; a joint is made at a point of the plane.
"""

from __future__ import annotations

import cmath
from collections.abc import Callable
from dataclasses import replace
from typing import Any

import numpy as np

from refkin.analysis import position
from refkin.joints import (
    GROUND,
    AngleDriver,
    Constraint,
    Distance,
    DistanceDriver,
    Driver,
    Fixed,
    Pair,
    PointOnLine,
    Prismatic,
    Revolute,
    Unit,
    XDriver,
)
from refkin.model import Body, Mechanism
from refkin.motion_laws import Law, Polynomial, Sinusoid, Table
from refkin.system import System, compile_system


class Draw:
    """A pose of some bodies, and joints that fit it."""

    def __init__(self, rng: np.random.Generator, bodies: tuple[str, ...]) -> None:
        self.rng, self.names = rng, bodies
        self.pose = {name: (self.point(), float(rng.uniform(-3, 3))) for name in bodies}
        self.pose[GROUND] = (0j, 0.0)
        self.joints: list[Constraint] = []
        self.drivers: list[Driver] = []

    def point(self) -> complex:
        return complex(*self.rng.uniform(-1, 1, 2))

    def local(self, body: str, point: complex) -> Pair:
        r, phi = self.pose[body]
        u = (point - r) * cmath.exp(-1j * phi)
        return u.real, u.imag

    def place(self, body: str, u: Pair) -> complex:
        r, phi = self.pose[body]
        return r + complex(*u) * cmath.exp(1j * phi)

    def _ends(self, i: str, at_i: complex, j: str, at_j: complex) -> dict[str, Any]:
        ends = {"body_i": i, "point_i": self.local(i, at_i), "body_j": j, "point_j": self.local(j, at_j)}
        return {"name": f"joint {len(self.joints) + len(self.drivers)}", **ends}

    def revolute(self, i: str, j: str) -> None:
        at = self.point()
        self.joints.append(Revolute(**self._ends(i, at, j, at)))

    def fixed(self, i: str, j: str) -> None:
        at = self.point()
        self.joints.append(Fixed(**self._ends(i, at, j, at), angle=self.pose[j][1] - self.pose[i][1]))

    def sliding(self, i: str, j: str, turning: bool = False) -> None:
        at, axis = self.point(), cmath.exp(1j * self.rng.uniform(-3, 3))
        ends = self._ends(i, at, j, at + axis * self.rng.uniform(-1, 1))
        turned = axis * cmath.exp(-1j * self.pose[i][1]) * self.rng.uniform(0.1, 10)
        ends["axis_i"] = (turned.real, turned.imag)
        if turning:
            self.joints.append(PointOnLine(**ends))
        else:
            self.joints.append(Prismatic(**ends, angle=self.pose[j][1] - self.pose[i][1]))

    def distance(self, i: str, j: str) -> None:
        a, b = self.point(), self.point()
        self.joints.append(Distance(**self._ends(i, a, j, b), length=abs(b - a)))

    def law(self, value: float) -> Law:
        """Return a law that starts at a value, at t = 0."""
        rate, swing = self.rng.uniform(-1, 1, 2)
        knots = tuple(float(k) for k in range(-2, 5))
        return (
            Polynomial(coefficients=(value, rate, swing)),
            Sinusoid(offset=value, amplitude=swing, angular_frequency=1 + rate**2),
            Table(argument=knots, value=tuple(value + (rate * k if k else 0.0) for k in knots)),
        )[self.rng.integers(3)]

    def turn(self, body: str) -> None:
        value, name = self.pose[body][1], f"joint {len(self.joints) + len(self.drivers)}"
        if self.rng.random() < 0.25:
            rate = Sinusoid(amplitude=1.0, angular_frequency=0.5, offset=1.0)
            self.drivers.append(AngleDriver(name=name, body=body, rate_law=rate, initial=value))
        else:
            self.drivers.append(AngleDriver(name=name, body=body, law=self.law(value)))

    def push(self, body: str) -> None:
        u = self.local(body, self.point())
        self.drivers.append(XDriver(name="push", body=body, point=u, law=self.law(self.place(body, u).real)))

    def stretch(self, i: str, j: str) -> None:
        a, b = self.point(), self.point()
        self.drivers.append(DistanceDriver(**self._ends(i, a, j, b), law=self.law(abs(b - a))))

    def system(self, unit: Unit | None = None) -> tuple[System, Any]:
        """Return the system, in its own unit by default, and the drawn pose in its coordinates."""
        mechanism = Mechanism(tuple(Body(name=n) for n in self.names), tuple(self.joints), tuple(self.drivers))
        system = compile_system(mechanism, unit=unit or mechanism.unit())
        q = [c for n in self.names for c in (self.pose[n][0].real, self.pose[n][0].imag, self.pose[n][1])]
        return system, system.to_unit(np.array(q))


def four_bar(rng: np.random.Generator) -> Draw:
    d = Draw(rng, ("crank", "coupler", "rocker"))
    for i, j in ((GROUND, "crank"), ("crank", "coupler"), ("coupler", "rocker"), (GROUND, "rocker")):
        d.revolute(i, j)
    d.turn("crank")
    return d


def slider_crank(rng: np.random.Generator) -> Draw:
    d = Draw(rng, ("crank", "rod", "slider"))
    for i, j in ((GROUND, "crank"), ("crank", "rod"), ("rod", "slider")):
        d.revolute(i, j)
    d.sliding(GROUND, "slider")
    if rng.random() < 0.5:
        d.turn("crank")
    else:
        d.push("slider")
    return d


def inverted(rng: np.random.Generator) -> Draw:
    """A block on the crank pin slides along the rocker: a prismatic joint between two moving bodies."""
    d = Draw(rng, ("crank", "block", "rocker"))
    for i, j in ((GROUND, "crank"), ("crank", "block"), (GROUND, "rocker")):
        d.revolute(i, j)
    d.sliding("rocker", "block")
    d.turn("crank")
    return d


def pin_in_slot(rng: np.random.Generator) -> Draw:
    """A pin of the crank in a slot of the rocker, and a plate fixed to the rocker."""
    d = Draw(rng, ("crank", "rocker", "plate"))
    d.revolute(GROUND, "crank")
    d.revolute(GROUND, "rocker")
    d.sliding("rocker", "crank", turning=True)
    d.fixed("rocker", "plate")
    d.turn("crank")
    return d


def massless_coupler(rng: np.random.Generator) -> Draw:
    d = Draw(rng, ("crank", "rocker"))
    d.revolute(GROUND, "crank")
    d.revolute(GROUND, "rocker")
    d.distance("crank", "rocker")
    if rng.random() < 0.5:
        d.turn("crank")
    else:
        d.stretch(GROUND, "crank")
    return d


FAMILIES: tuple[Callable[[np.random.Generator], Draw], ...] = (
    four_bar,
    slider_crank,
    inverted,
    pin_in_slot,
    massless_coupler,
)


def perturbed(draw: Draw, change: Callable[[float], float], unit: Unit | None = None) -> tuple[System, Any]:
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
