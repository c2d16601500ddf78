"""Spatial mechanisms: the proof, in balls, that one cannot be assembled; and the assemblies that many starts lead to.

A body on a hinge or a slide whose motion a driver gives stands where that says. A point of a body on a free hinge is on
a circle, on a free slide on a line, on a cylinder or a screw at one distance from its axis; a link, a distance or a
body on two spherical joints, keeps it on a sphere around a point that stands. Where they certainly miss each other
there is no pose: the gap is what is missing. So ends an RSSR whose K^2 > P^2 + Q^2, and an RSSP whose rod is too short.
Of any mechanism the points that coincide, and the distances that are given, make loops (`point_rows`), of which none
may have a side longer than all the others together; nor may one that an axis closes, along which all may slide, be
wider across it than the rest is long (`assembly`). All numbers are spread as in `rows`: which rows are redundant a
count does not tell where others are lacking.

Of the assemblies nothing is proved to be all there is. Starts come from a fixed sequence: orientations spread evenly
over all turns (Shoemake, Uniform random rotations, 1992, on Halton's sequence), origins within the mechanism's size.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterable, Iterator
from functools import partial
from typing import Any, cast

import numpy as np
from flint import arb, ctx

from refkin.joints import (
    GROUND,
    AxesParallel,
    PointOnAxis,
    PointsMeet,
    ShiftAlongAxis,
    SpatialPointDistance,
    TurnAboutAxis,
    initial_contacts,
    passive_spins,
)
from refkin.joints.spatial_frames import frame
from refkin.joints.spatial_vectors import Vec3
from refkin.proof.assembly.closed_form import DeadEnd
from refkin.proof.assembly.loci import Ball, below, length, root
from refkin.proof.assembly.rows import SPREAD, PointRow, RowKind, wide
from refkin.proof.assembly.search import SAME, halton, refined, starts_of
from refkin.proof.numbers.exact import exact
from refkin.proof.numbers.recentred import recentred
from refkin.system import System

PRECISION = 113
HINGE: set[type] = {PointsMeet, AxesParallel}
LOOSE: set[type] = {AxesParallel, PointOnAxis}
SLIDE: set[type] = {AxesParallel, PointOnAxis, TurnAboutAxis}
MOST_STARTS = 120
MOST_POSES = 48
ENOUGH = 40
"""How many starts in a row may lead nowhere new."""
Place = Callable[[Any], Vec3]
"""Where a point of a body, in its own frame, stands on the ground."""


def certain_miss(system: System, t: float) -> DeadEnd | None:
    """Return the proof that drivers contradict each other at time t, or that some link does not reach; else None."""
    with ctx.workprec(PRECISION):
        reader = _SpatialReader(system, t)
        for gap, words in reader.contradictions():
            if gap > 0:
                return DeadEnd(gap, partial(str, words))
        for link, near, far, body, reach in reader.links():
            gap = reader.gap(near, far, body, reach)
            if gap is not None and gap > 0:
                metres = below(gap) * system.unit.size
                words = f"{link} does not reach {body}: at least {metres:.6g} m are missing"
                return DeadEnd(gap, partial(str, words))
    return None


def point_rows(system: System, t: float) -> list[PointRow]:
    """Return what joins point to point at time t: where they meet, and distances; slides driven along their axis.

    Of a point on an axis the row is that of a line; its `normal` are the axis, and that of body j along it, or None.
    """
    reader, rows = _SpatialReader(system, t), list[PointRow]()
    slides = {j.name for j in system.mechanism.joints if any(isinstance(e, PointOnAxis) for e in j.elements())}
    for c in system.mechanism.constraints:
        for e in c.elements():
            driven = isinstance(e, ShiftAlongAxis) and getattr(c, "joint", "") in slides
            if not (driven or isinstance(e, PointsMeet | SpatialPointDistance | PointOnAxis)):
                continue
            (i, p), (j, q) = ((body, reader.vector(u)) for body, u in exact(e.ends))
            if isinstance(e, PointOnAxis):
                axis_j = getattr(c, "axis_j", None)
                axes = tuple(axis and reader.frame(exact(axis))[2] for axis in (e.axis_i, axis_j))
                rows.append(PointRow(RowKind.LINE, i, j, cast(Any, p), cast(Any, q), c.name, normal=cast(Any, axes)))
                continue
            meets = isinstance(e, PointsMeet)
            apart = None if meets else reader.distance(e)
            kind = RowKind.PIN if meets else RowKind.DISTANCE
            rows.append(PointRow(kind, i, j, cast(Any, p), cast(Any, q), c.name, distance=apart))
    return rows


class _SpatialReader:
    def __init__(self, system: System, t: float) -> None:
        self.mechanism, self.t = system.mechanism, arb(float(t))
        self.size = system.unit.size
        self.joints = {c.name: (c, exact(c)) for c in self.mechanism.joints}
        self.places: dict[str, Place] = {GROUND: self.vector}
        for driver in self.mechanism.constraints[len(self.mechanism.joints) :]:
            for element in driver.elements():
                if isinstance(element, TurnAboutAxis | ShiftAlongAxis) and element.body_i == GROUND:
                    self._place(driver, self.joints[driver.joint], isinstance(element, TurnAboutAxis))  # type: ignore[attr-defined]

    def vector(self, u: Any) -> Vec3:
        """Return a point as it is given, scaled."""
        return self._wide(x / self.size for x in u)

    def frame(self, axis: Any, zero: Any = None) -> tuple[Vec3, ...]:
        """Return a joint's (f, g, h) on a body."""
        return tuple(self._wide(v.parts) for v in frame(axis, zero))

    def distance(self, e: Any) -> Ball:
        """Return how far apart an element keeps two points, scaled; a law may be negative."""
        return abs(self._value(e.laws[0], self.size) if e.laws else wide(arb(e.length) / self.size, SPREAD))

    def _wide(self, parts: Iterable[Any]) -> Vec3:
        return Vec3(*(wide(x, SPREAD) for x in parts))

    def _value(self, law: Any, size: float = 1.0) -> Ball:
        """Return a law's value, scaled; its numbers are spread, and the time, which moves it by its rate."""
        value, rate = (arb(exact(law)(self.t, order)) / size for order in (0, 1))
        off = arb(exact(law, SPREAD)(self.t, 0)).rad() / size
        return value + arb(0, 1) * (off.max(SPREAD) + SPREAD * abs(self.t * rate))

    def _place(self, driver: Any, joint: Any, turning: bool) -> None:
        """Note where a body stands that a driver holds on a hinge, or on a slide, of the ground."""
        kinds, c = {type(e) for e in joint[0].elements()}, joint[1]
        if kinds != (HINGE if turning else SLIDE) or c.body_i != GROUND or None in (c.zero_i, c.zero_j):
            return
        (f, g, h), own = self.frame(c.axis_i, c.zero_i), self.frame(c.axis_j, c.zero_j)
        start, value = self.vector(c.point_i), self._value(driver.laws[0], 1.0 if turning else self.size)
        if turning:
            f, g = f * value.cos() + g * value.sin(), g * value.cos() - f * value.sin()
        else:
            start = start + h * value

        def place(u: Any) -> Vec3:
            arm = self.vector(u) - self.vector(c.point_j)
            x, y, z = (arm.dot(v) for v in own)
            there: Vec3 = start + f * x + g * y + h * z
            return there

        self.places[c.body_j] = place

    def contradictions(self) -> Iterator[tuple[Ball, str]]:
        """Yield how far apart two values are that drivers ask of one joint, scaled, and that in words."""
        first: dict[Any, tuple[str, Ball]] = {}
        for driver in self.mechanism.constraints[len(self.mechanism.joints) :]:
            for e in driver.elements():
                if not isinstance(e, TurnAboutAxis | ShiftAlongAxis):
                    continue
                joint, turning = driver.joint, isinstance(e, TurnAboutAxis)  # type: ignore[attr-defined]
                what, unit, size = ("an angle", "rad", 1.0) if turning else ("a displacement", "m", self.size)
                value = self._value(e.laws[0], size)
                name, other = first.setdefault((joint, turning), (driver.name, value))
                gap = abs(value - other)
                if turning and driver.form != "counted":  # type: ignore[attr-defined]
                    turn = 2 * arb.pi()  # of which any number leads to the same angle
                    gap = abs(gap - turn * ((gap / turn).mid() + 0.5).floor())
                if name != driver.name:
                    off = f"{float((gap * size).mid()):.6g} {unit} off that of {name}"
                    yield gap, f"{driver.name} asks for {what} of {joint} that is {off}"

    def links(self) -> Iterator[tuple[str, Vec3, Any, str, Ball]]:
        """Yield links from a point that stands: name, that point, the other end's point and body, the length."""
        links = []
        for c in self.mechanism.constraints:
            for e in c.elements():
                if isinstance(e, SpatialPointDistance):
                    links.append((c.name, exact(e.ends), self.distance(e)))
        for spin in passive_spins(self.mechanism.bodies, self.mechanism.constraints):
            every = self.mechanism.constraints[: len(self.mechanism.joints)]
            joints = [c for c in every if len(spin.keys() & {*c.bodies}) == 1]
            held = [e for c in joints for e in exact(tuple(c.elements()))]
            own = [end for e in held for end in e.ends if end[0] in spin]
            if [type(e) for e in held] == [PointsMeet] * 2 and own[0][0] == own[1][0]:
                ends = tuple(next(end for end in e.ends if end[0] not in spin) for e in held)
                links.append((own[0][0], ends, length(self.vector(own[0][1]) - self.vector(own[1][1]))))
        for name, ends, reach in links:
            for (a, u), (b, v) in (ends, ends[::-1]):
                if a in self.places:
                    yield name, self.places[a](u), v, b, reach

    def gap(self, near: Vec3, u: Any, body: str, reach: Ball) -> Ball | None:
        """Return by how much a link misses all places that a point of a body may be at; None if that is not known."""
        if body in self.places:
            return abs(length(self.places[body](u) - near) - reach)
        for plain, c in self.joints.values():
            kinds = {type(e) for e in plain.elements()}
            if GROUND not in plain.bodies or body not in plain.bodies or not (kinds == HINGE or kinds >= LOOSE):
                continue
            i, j = ("i", "j") if c.body_i == GROUND else ("j", "i")
            axis, at = getattr(c, f"axis_{i}"), self.vector(getattr(c, f"point_{i}"))
            _, _, h = self.frame(axis)
            own = self.vector(u) - self.vector(getattr(c, f"point_{j}"))
            if kinds == HINGE:
                _, _, turning = self.frame(getattr(c, f"axis_{j}"))
                height = own.dot(turning)
                radius, w = length(own - turning * height), near - at - h * height
                up = w.dot(h)
                beside = length(w - h * up)
                nearest, furthest = (root((beside - s * radius) ** 2 + up * up) for s in (1, -1))
                return max([nearest - reach, reach - furthest], key=below)
            if kinds != SLIDE:
                return abs(across(near - at, h) - across(own, self.frame(getattr(c, f"axis_{j}"))[2])) - reach
            rest = self.frame(getattr(c, f"axis_{j}"), getattr(c, f"zero_{j}"))
            f, g, _ = self.frame(axis, getattr(c, f"zero_{i}"))
            w = near - at - f * own.dot(rest[0]) - g * own.dot(rest[1])
            return length(w - h * w.dot(h)) - reach
        return None


def across(v: Vec3, h: Vec3) -> Ball:
    """Return how far a vector leads from a line along h."""
    return length(v - h * v.dot(h))


def starts(system: System, t: float, count: int = MOST_STARTS, first: int = 1) -> Iterator[Any]:
    """Yield poses (n,) of bodies that no joint holds, spread evenly.

    Parameters
    ----------
    system : System
    t : float
        When [s].
    count, first : int
        How many, and the number of the first in their sequence.
    """
    bodies, width = len(system.mechanism.bodies), system.kind.width
    for k in range(first, first + count):
        q = np.zeros(system.n)
        for body in range(bodies):
            at = 1 + k * bodies + body  # a point of the sequence for each body
            u = halton(at, 6)
            a, b = math.sqrt(1 - u[0]), math.sqrt(u[0])
            s, c = math.tau * u[1], math.tau * u[2]
            turn = (b * math.cos(c), a * math.sin(s), a * math.cos(s), b * math.sin(c))
            q[width * body : width * (body + 1)] = (*(2 * x - 1 for x in u[3:]), *turn)
        yield initial_contacts(system, q, t)


def assemblies_in_space(system: System, t: float) -> list[Any]:
    """Return the poses (n,) that Newton's method, or least squares, reaches from many starts; of p and -p one.

    They are looked for, and told apart, in frames near the joints: no start is near one that is far away.
    """
    poses: list[Any] = []
    since = 0
    left = starts_of(system.n)  # in vain: one that leads to a new pose is short, and what the search is for
    frames = recentred(system)
    for start in starts(frames.inner, t):
        q = refined(frames.inner, start, t)
        if q is None and frames.furthest:  # redundant rows may agree but for the rounding of far points
            q = refined(system, frames.outward(start), t)
            q = None if q is None else frames.inward(q)
        q = None if q is None else signed(system, q, np.ones(system.n))
        off = [] if q is None else [signed(system, q, other) - other for other in poses]
        # How many turns a gear has counted makes no other assembly.
        new = q is not None and all(np.max(np.abs(x[: system.of_bodies])) > SAME for x in off)
        since, left = (0, left) if new else (since + 1, left - 1)
        if new:
            poses.append(q)
        if len(poses) >= MOST_POSES or since >= ENOUGH or not left:
            break
    return [frames.outward(q) for q in poses]


def signed(system: System, q: Any, like: Any) -> Any:
    """Return a pose (n,) with the Euler parameters of each body on the side of those in another pose.

    Parameters
    ----------
    system : System
    q, like : (n,) array
        The pose, and the other one.
    """
    q = np.array(q)
    for body in system.mechanism.bodies:
        at = system.columns(body.name)
        p = slice(at.start + system.kind.dimension, at.stop)
        if q[p] @ like[p] < 0:
            q[p] = -q[p]
    return q
