"""The closed form against loop closures in complex numbers, written here, and differences of its own positions.

The identities are evaluated on truth rounded to float: then each entry carries one rounding, whatever the conditioning,
and the bound is a count of roundings of the terms that stand in the identity (`Defect`), not a condition number.
"""

import ast
import cmath
import math
from dataclasses import dataclass, field, replace
from pathlib import Path

import numpy as np
import pytest
from flint import arb, ctx
from hypothesis import assume, event, given
from hypothesis import strategies as st

from crosscheck.engines import Engine, EngineError, Level, Support, load
from crosscheck.engines.closed_form import ClosedForm, truth
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
from refkin.model import Body, Mechanism, Point, Scene
from refkin.motion import Seeding, Status
from refkin.motion_laws import Polynomial, Sinusoid, Table

U = 2.0**-53
FEW = (-(2.0**-20), 0.0, 2.0**-20)


# Scenes drawn at a known pose: world points and body frames are drawn, the numbers of the joints follow.


@dataclass
class Drawing:
    """A mechanism under construction; bodies are (origin, angle) and points are world points, as complex numbers."""

    frames: dict[str, tuple[complex, float]]
    rates: tuple[float, float] = (0.7, -0.4)
    joints: list = field(default_factory=list)
    drivers: list = field(default_factory=list)

    def local(self, body, point):
        origin, angle = self.frames.get(body, (0j, 0.0))
        u = (point - origin) * cmath.exp(-1j * angle)
        return (u.real, u.imag)

    def angle(self, body):
        return self.frames.get(body, (0j, 0.0))[1]

    def ends(self, i, p, j, q):
        return {"body_i": i, "point_i": self.local(i, p), "body_j": j, "point_j": self.local(j, q)}

    def axis(self, body, direction):
        u = direction * cmath.exp(-1j * self.angle(body))
        return (u.real, u.imag)

    def pin(self, i, j, p):
        self.joints.append(Revolute(name=f"pin{len(self.joints)}", **self.ends(i, p, j, p)))

    def slide(self, i, j, p, direction, along):
        turned = self.angle(j) - self.angle(i)
        ends = self.ends(i, p, j, p + along * direction)
        axis = self.axis(i, direction)
        self.joints.append(Prismatic(name=f"slide{len(self.joints)}", axis_i=axis, angle=turned, **ends))

    def on_line(self, i, j, p, q):
        ends = self.ends(i, p, j, q)
        self.joints.append(PointOnLine(name=f"line{len(self.joints)}", axis_i=self.axis(i, q - p), **ends))

    def link(self, i, j, p, q):
        self.joints.append(Distance(name=f"link{len(self.joints)}", length=abs(q - p), **self.ends(i, p, j, q)))

    def weld(self, i, j, p):
        turned = self.angle(j) - self.angle(i)
        self.joints.append(Fixed(name=f"weld{len(self.joints)}", angle=turned, **self.ends(i, p, j, p)))

    def law(self, value):
        return Polynomial(coefficients=(value, *self.rates))

    def drive_angle(self, body, relative_to=GROUND):
        law = self.law(self.angle(body) - self.angle(relative_to))
        self.drivers.append(AngleDriver(name=f"m{len(self.drivers)}", body=body, relative_to=relative_to, law=law))

    def drive_x(self, body, p):
        law = self.law(p.real)
        self.drivers.append(XDriver(name=f"m{len(self.drivers)}", body=body, point=self.local(body, p), law=law))

    def drive_y(self, body, p):
        law = self.law(p.imag)
        self.drivers.append(YDriver(name=f"m{len(self.drivers)}", body=body, point=self.local(body, p), law=law))

    def drive_distance(self, i, j, p, q):
        law = self.law(abs(q - p))
        self.drivers.append(DistanceDriver(name=f"m{len(self.drivers)}", law=law, **self.ends(i, p, j, q)))

    def scene(self, times=FEW):
        bodies = tuple(Body(name=n, estimate=(r.real, r.imag, phi)) for n, (r, phi) in self.frames.items())
        return Scene(mechanism=Mechanism(bodies, tuple(self.joints), tuple(self.drivers)), times=times)


def four_bar(d, p):
    """Pins p0 (ground) - 1 - p1 - 2 - p2 - 3 - p3 (ground), without a driver."""
    for i, j, point in zip(("ground", "1", "2", "3"), ("1", "2", "3", "ground"), p, strict=False):
        d.pin(i, j, point)


def four_bar_crank(d, p):
    four_bar(d, p)
    d.drive_angle("1")


def four_bar_rocker(d, p):
    four_bar(d, p)
    d.drive_angle("3")


def four_bar_coupler(d, p):
    four_bar(d, p)
    d.drive_angle("2")


def four_bar_coupler_to_crank(d, p):
    four_bar(d, p)
    d.drive_angle("2", "1")


def four_bar_rocker_to_coupler(d, p):
    four_bar(d, p)
    d.drive_angle("3", "2")


def four_bar_rocker_to_crank(d, p):
    four_bar(d, p)
    d.drive_angle("3", "1")


def four_bar_coupler_point_x(d, p):
    four_bar(d, p)
    d.drive_x("2", p[1])


def four_bar_cylinder(d, p):
    four_bar(d, p)
    d.drive_distance("ground", "1", p[4], p[1])


def four_bar_cylinder_on_rocker(d, p):
    four_bar(d, p)
    d.drive_distance("3", "ground", p[4], p[5])


def massless_coupler(d, p):
    d.pin("ground", "1", p[0])
    d.link("1", "2", p[1], p[2])
    d.pin("ground", "2", p[3])
    d.drive_angle("1")


def massless_coupler_relative(d, p):
    d.pin("ground", "1", p[0])
    d.link("1", "2", p[1], p[2])
    d.pin("2", "ground", p[3])
    d.drive_angle("2", "1")


def slider_crank(d, p):
    d.pin("ground", "1", p[0])
    d.pin("1", "2", p[1])
    d.pin("3", "2", p[2])
    d.slide("ground", "3", p[3], p[4] - p[3], 0.6)


def slider_crank_by_crank(d, p):
    slider_crank(d, p)
    d.drive_angle("1")


def slider_crank_by_x(d, p):
    slider_crank(d, p)
    d.drive_x("3", p[5])


def slider_crank_by_y(d, p):
    slider_crank(d, p)
    d.drive_y("3", p[5])


def slider_crank_by_distance(d, p):
    slider_crank(d, p)
    d.drive_distance("3", "ground", p[2], p[5])


def slider_crank_by_rod(d, p):
    slider_crank(d, p)
    d.drive_angle("2")


def slider_crank_massless_slider(d, p):
    d.pin("ground", "1", p[0])
    d.pin("1", "2", p[1])
    d.on_line("ground", "2", p[3], p[2])
    d.drive_angle("1")


def slider_crank_massless_slider_by_x(d, p):
    d.pin("ground", "1", p[0])
    d.pin("1", "2", p[1])
    d.on_line("ground", "2", p[3], p[2])
    d.drive_x("2", p[2])


def moving_guide(d, p):
    """A slider on a crank's guide, with a rod to the ground."""
    d.pin("ground", "1", p[0])
    d.slide("1", "2", p[1], p[2] - p[1], -0.4)
    d.pin("2", "3", p[3])
    d.pin("3", "ground", p[4])
    d.drive_angle("1")


def inverted_slider_crank(d, p):
    """A block pinned to the crank slides, with an offset, on a guide pinned to the ground."""
    d.pin("ground", "1", p[0])
    d.pin("1", "2", p[1])
    d.slide("3", "2", p[3], p[4] - p[3], 0.8)
    d.pin("3", "ground", p[2])
    d.drive_angle("1")


def inverted_massless_block(d, p):
    d.pin("ground", "1", p[0])
    d.on_line("2", "1", p[3], p[1])
    d.pin("2", "ground", p[2])
    d.drive_angle("1")


def cylinder(d, p):
    """A block's travel along its guide is driven."""
    d.pin("ground", "1", p[0])
    d.slide("1", "2", p[3], p[4] - p[3], 0.8)
    d.pin("2", "3", p[1])
    d.pin("3", "ground", p[2])
    d.drive_distance("1", "2", p[3], p[5])


def watt(d, p):
    four_bar(d, p)
    d.pin("3", "4", p[4])
    d.pin("4", "5", p[5])
    d.pin("5", "ground", p[6])
    d.drive_angle("1")


def stephenson(d, p):
    four_bar(d, p)
    d.pin("2", "4", p[4])
    d.pin("4", "5", p[5])
    d.pin("5", "ground", p[6])
    d.drive_angle("1")


def coupler_point_slides(d, p):
    four_bar(d, p)
    d.pin("2", "4", p[4])
    d.slide("5", "4", p[5], p[0] - p[5], 0.3)
    d.pin("5", "ground", p[6])
    d.drive_angle("1")


def two_sliders(d, p):
    """A block on a fixed guide, a second on a guide of the first, held by a link: all angles known."""
    d.slide("ground", "1", p[0], p[1] - p[0], 0.5)
    d.slide("1", "2", p[2], p[3] - p[2], 0.5)
    d.link("ground", "2", p[4], p[5])
    d.drive_x("1", p[6])


def double_slider(d, p):
    """Blocks on two fixed guides pinned together by a rod (elliptical trammel), one driven."""
    d.slide("ground", "1", p[0], p[1] - p[0], 0.5)
    d.slide("ground", "2", p[2], p[3] - p[2], 0.5)
    d.pin("1", "3", p[4])
    d.pin("3", "2", p[5])
    d.drive_y("1", p[6])


def cross_slider(d, p):
    """Oldham-like: a block slides on a turning crank and is pinned to a block on a fixed guide."""
    d.pin("ground", "1", p[0])
    d.slide("1", "2", p[1], p[2] - p[1], 0.5)
    d.pin("2", "3", p[3])
    d.slide("ground", "3", p[4], p[5] - p[4], 0.5)
    d.drive_angle("1")


def welded(d, p):
    four_bar(d, p)
    d.weld("3", "4", p[4])
    d.pin("4", "5", p[5])
    d.on_line("ground", "5", p[6], p[0])
    d.drive_angle("1")


TOPOLOGIES = {
    four_bar_crank: 3,
    four_bar_rocker: 3,
    four_bar_coupler: 3,
    four_bar_coupler_to_crank: 3,
    four_bar_rocker_to_coupler: 3,
    four_bar_rocker_to_crank: 3,
    four_bar_coupler_point_x: 3,
    four_bar_cylinder: 3,
    four_bar_cylinder_on_rocker: 3,
    massless_coupler: 2,
    massless_coupler_relative: 2,
    slider_crank_by_crank: 3,
    slider_crank_by_x: 3,
    slider_crank_by_y: 3,
    slider_crank_by_distance: 3,
    slider_crank_by_rod: 3,
    slider_crank_massless_slider: 2,
    slider_crank_massless_slider_by_x: 2,
    moving_guide: 3,
    inverted_slider_crank: 3,
    inverted_massless_block: 2,
    cylinder: 3,
    watt: 5,
    stephenson: 5,
    coupler_point_slides: 5,
    two_sliders: 2,
    double_slider: 3,
    cross_slider: 3,
    welded: 5,
}

UNIT = st.floats(-1.0, 1.0)


@st.composite
def drawings(draw, build, spread=0.0, frames=1.0):
    """Build a mechanism on world points within a square; `spread` scatters each point over that many decades.

    Shrinks towards points on a regular polygon, no two of which coincide and no three of which are in line.
    """
    corners = [cmath.exp(2j * math.pi * (k * 3 % 7) / 7) for k in range(7)]
    p = [c * 10 ** (spread * draw(UNIT)) + 0.3 * complex(draw(UNIT), draw(UNIT)) for c in corners]
    names = [str(k + 1) for k in range(TOPOLOGIES[build])]
    placed = {n: (frames * complex(draw(UNIT), draw(UNIT)), draw(st.floats(-9.0, 9.0))) for n in names}
    drawing = Drawing(placed, rates=(0.7 + 0.3 * draw(UNIT), draw(UNIT)))
    build(drawing, p)
    return drawing


# Loop closures, in complex numbers.


class Defect:
    """What is left of identities, and the sum of the sizes of their terms."""

    def __init__(self, parts, sizes):
        self.parts, self.sizes = parts, sizes

    def within(self, roundings):
        return all(np.all(abs(p) <= roundings * U * s) for p, s in zip(self.parts, self.sizes, strict=True))


class Carried:
    """A body's motion, or the ground's, with point positions, velocities and accelerations."""

    def __init__(self, motion, name):
        if name == GROUND:
            self.r = self.v = self.a = self.w = self.e = self.phi = np.zeros(len(motion.t))
            return
        b = motion[name]
        self.r, self.v, self.a = b.x + 1j * b.y, b.xd + 1j * b.yd, b.xdd + 1j * b.ydd
        self.phi, self.w, self.e = b.phi, b.phid, b.phidd

    def vector(self, u):
        """A body-fixed vector and its two derivatives."""
        s = np.exp(1j * self.phi) * complex(*u)
        return s, 1j * self.w * s, (1j * self.e - self.w**2) * s

    def point(self, u):
        s = self.vector(u)
        return tuple(x + y for x, y in zip((self.r, self.v, self.a), s, strict=True))

    def size(self, u):
        """Sizes of the terms of `point`, an angle's rounding included."""
        s = abs(complex(*u)) * (1 + abs(self.phi))
        spin = abs(self.w) * (1 + abs(self.w)) + abs(self.e)
        return abs(self.r) + s, abs(self.v) + (abs(self.w)) * s, abs(self.a) + spin * s


def law_rows(driver, t):
    law = driver.laws[0]
    return tuple(np.broadcast_to(law(t, k), t.shape) for k in range(3))


def defects(scene, motion):
    """Yield (name, level 0..2, Defect) for every joint and driver."""
    for c in scene.mechanism.constraints:
        i, j = (Carried(motion, name) for name in c.bodies)
        found = {
            "revolute": _pinned,
            "fixed": _welded,
            "prismatic": _slides,
            "point_on_line": _aligned,
            "distance": _apart,
            "angle": _turned,
            "x": _driven_x,
            "y": _driven_y,
        }[c.type](c, i, j, motion.t)
        for level in range(3):
            yield c.name, level, Defect(*zip(*[(part[level], size[level]) for part, size in found], strict=True))


def _gap(c, i, j):
    d = tuple(q - p for p, q in zip(i.point(c.point_i), j.point(c.point_j), strict=True))
    return d, tuple(a + b for a, b in zip(i.size(c.point_i), j.size(c.point_j), strict=True))


def _pinned(c, i, j, t):
    d, size = _gap(c, i, j)
    return [(d, size)]


def _angles(i, j, f):
    """An angle near zero is a sum of angles that are not, and its ball has the width of those: 2^-113 of them."""
    pairs = ((i.phi, j.phi), (i.w, j.w), (i.e, j.e))
    rows = tuple(b - a - x for (a, b), x in zip(pairs, f, strict=True))
    return rows, tuple(abs(b) + abs(a) + abs(x) + 2.0**-40 for (a, b), x in zip(pairs, f, strict=True))


def _welded(c, i, j, t):
    return [*_pinned(c, i, j, t), _angles(i, j, (c.angle, 0, 0))]


def _aligned(c, i, j, t):
    """Im(conj(axis) d) = 0 and twice differentiated."""
    (d, dd, ddd), (s, sd, sdd) = _gap(c, i, j)
    a, ad, add = (np.conj(x) for x in i.vector(c.axis_i))
    turn = 1 + abs(i.phi)
    rows = ((a * d).imag, (ad * d + a * dd).imag, (add * d + 2 * ad * dd + a * ddd).imag)
    sizes = (
        abs(a) * turn * s,
        turn * (abs(ad) * s + abs(a) * sd),
        turn * (abs(add) * s + 2 * abs(ad) * sd + abs(a) * sdd),
    )
    return [(rows, sizes)]


def _slides(c, i, j, t):
    return [*_aligned(c, i, j, t), _angles(i, j, (c.angle, 0, 0))]


def _apart(c, i, j, t):
    (d, dd, ddd), (s, sd, sdd) = _gap(c, i, j)
    f = law_rows(c, t) if hasattr(c, "law") else (c.length + 0 * t, 0 * t, 0 * t)
    rows = (
        abs(d) ** 2 - f[0] ** 2,
        (d.conj() * dd).real - f[0] * f[1],
        abs(dd) ** 2 + (d.conj() * ddd).real - f[1] ** 2 - f[0] * f[2],
    )
    sizes = (s**2 + f[0] ** 2, s * sd + abs(f[0] * f[1]), sd**2 + s * sdd + f[1] ** 2 + abs(f[0] * f[2]))
    return [(rows, sizes)]


def _turned(c, i, j, t):
    return [_angles(i, j, law_rows(c, t))]


def _driven(c, j, t, part):
    p, f = j.point(c.point), law_rows(c, t)
    sizes = tuple(s + abs(x) for s, x in zip(j.size(c.point), f, strict=True))
    return [(tuple(part(x) - y for x, y in zip(p, f, strict=True)), sizes)]


def _driven_x(c, i, j, t):
    return _driven(c, j, t, np.real)


def _driven_y(c, i, j, t):
    return _driven(c, j, t, np.imag)


ROUNDINGS = 64
"""Roundings per term: at most eight operations on each, in numbers that carry one, squared at worst; and 2 to spare."""


def open_rows(scene, motion):
    return [(name, level) for name, level, defect in defects(scene, motion) if not defect.within(ROUNDINGS)]


def q_of(scene):
    return np.array([c for b in scene.mechanism.bodies for c in b.estimate])


# The claims.


@pytest.mark.parametrize("build", TOPOLOGIES, ids=lambda b: b.__name__)
@given(data=st.data())
def test_truth_closes_every_loop_at_every_level(build, data):
    scene = data.draw(drawings(build)).scene()
    motion = truth(scene).motion
    event(motion.verdict)
    assume(motion.verdict is Status.OK)

    assert open_rows(scene, motion) == []


@pytest.mark.parametrize("build", TOPOLOGIES, ids=lambda b: b.__name__)
@given(data=st.data())
def test_the_pose_drawn_is_the_pose_found(build, data):
    """Branch and turns: drawn poses have either orientation in each dyad, and angles up to 9 rad.

    The joints carry one rounding of the pose drawn. At a fold a rounding u moves the pose by sqrt(u) = 1e-8, hence the
    bound; the other assembly is further by the chord, which is assumed to be longer.
    """
    scene = data.draw(drawings(build)).scene(times=(0.0,))
    motion = truth(scene).motion
    assume(motion.verdict is Status.OK)
    assume(np.abs(motion.qd).max() < 1e4)  # a chord of 1e-4: far longer than 1e-6

    assert np.abs(motion.q[:, 0] - q_of(scene)).max() < 1e-6


@pytest.mark.parametrize("build", TOPOLOGIES, ids=lambda b: b.__name__)
@given(data=st.data())
def test_rates_are_the_differences_of_positions(build, data):
    """Central differences at h = 2^-100 in 400 bits err by h^2 f''' / 6 < 1e-40 and are exact to float."""
    h = 2.0**-100
    scene = data.draw(drawings(build)).scene(times=(-h, 0.0, h))
    assume(truth(replace(scene, times=(0.0,))).motion.verdict is Status.OK)
    found = truth(scene, bits=400)
    assume(found.motion.verdict is Status.OK)
    with ctx.workprec(400):
        q = found.balls[0]
        rate, acceleration = (q[:, 2] - q[:, 0]) / arb(2 * h), (q[:, 2] - 2 * q[:, 1] + q[:, 0]) / arb(h) ** 2
    size = np.abs(found.motion.qdd).max() ** 2 + 1  # bounds f''' by the growth of f''
    assume(size < 1e20)

    assert np.abs(rate.astype(float) - found.motion.qd[:, 1]).max() <= 4 * U * np.abs(found.motion.qd).max()
    assert np.abs(acceleration.astype(float) - found.motion.qdd[:, 1]).max() <= 4 * U * np.abs(found.motion.qdd).max()


# Four-bars and slider-cranks by their lengths.

LENGTHS = {"ground": 4.0, "crank": 1.0, "coupler": 3.5, "rocker": 3.0}
LAW = Polynomial(coefficients=(0.3, 1.0))


def linkage(lengths, law=LAW, times=(0.0,), sign=1, estimates=True, turns=0):
    """A four-bar with frames at the pins, estimated on the branch of the given sign."""
    g, a, b, c = (lengths[k] for k in ("ground", "crank", "coupler", "rocker"))
    theta = float(law(times[0], 0))
    tip = cmath.rect(a, theta)
    base = g - tip
    x = (abs(base) ** 2 + b * b - c * c) / (2 * abs(base))
    pin = tip + base / abs(base) * complex(x, sign * math.sqrt(abs(b * b - x * x)))
    angles = (theta, cmath.phase(pin - tip) + math.tau * turns, cmath.phase(pin - g))
    poses = zip((0j, tip, complex(g)), angles, strict=True)
    bodies = tuple(
        Body(name=n, estimate=(r.real, r.imag, phi) if estimates else None)
        for n, (r, phi) in zip(("crank", "coupler", "rocker"), poses, strict=True)
    )
    joints = (
        Revolute(name="A0", body_i=GROUND, point_i=(0.0, 0.0), body_j="crank", point_j=(0.0, 0.0)),
        Revolute(name="A", body_i="crank", point_i=(a, 0.0), body_j="coupler", point_j=(0.0, 0.0)),
        Revolute(name="B", body_i="coupler", point_i=(b, 0.0), body_j="rocker", point_j=(c, 0.0)),
        Revolute(name="B0", body_i=GROUND, point_i=(g, 0.0), body_j="rocker", point_j=(0.0, 0.0)),
    )
    drivers = (AngleDriver(name="motor", body="crank", law=law),)
    return Scene(mechanism=Mechanism(bodies, joints, drivers), times=times)


def orientation(motion):
    """The sign of coupler x rocker at the pin B, per time."""
    return np.sign(np.sin(motion["rocker"].phi - motion["coupler"].phi))


@pytest.mark.parametrize("build", TOPOLOGIES, ids=lambda b: b.__name__)
@given(data=st.data())
def test_lengths_may_differ_by_six_decades(build, data):
    scene = data.draw(drawings(build, spread=3.0)).scene(times=(0.0,))
    motion = truth(scene).motion
    event(motion.verdict)
    assume(motion.verdict is Status.OK)

    assert open_rows(scene, motion) == []


@given(data=st.data(), build=st.sampled_from([four_bar_crank, slider_crank_by_crank, inverted_slider_crank]))
def test_floats_agree_with_balls_within_the_conditioning(data, build):
    """For one dyad between unit-size loops driven by unit rates.

    With s the sine of the dyad: |qd| <= c / s, |qdd| <= c / s^3. A rounding u of the pins moves the pose by u / s, so
    level k is off by u / s^(2 k + 1). 1 / s is measured by the truth itself, as the largest rate; the frames' arms and
    angles add a factor of their size, about 10 each.
    """
    scene = data.draw(drawings(build)).scene(times=(0.0,))
    exact, floats = truth(scene).motion, ClosedForm().solve(scene)
    assume(exact.verdict is Status.OK and floats.verdict is Status.OK)
    cosecant = 1.0 + np.abs(exact.qd).max()
    off = [np.abs(a - b).max() for a, b in zip(floats.levels, exact.levels, strict=True)]

    assert all(error <= 1000 * U * cosecant ** (2 * k + 1) for k, error in enumerate(off)), (off, cosecant)


@given(data=st.data(), build=st.sampled_from(list(TOPOLOGIES)))
def test_the_radius_holds_what_twice_the_bits_find(data, build):
    scene = data.draw(drawings(build)).scene(times=(0.0,))
    found, finer = truth(scene), truth(scene, bits=400)
    assume(found.motion.verdict is Status.OK)
    for level, radius, exact in zip(
        found.motion.levels, (found.radius_q, found.radius_qd, found.radius_qdd), finer.balls, strict=True
    ):
        with ctx.workprec(400):
            inside = [abs(arb(x) - y) <= arb(r) for x, y, r in zip(level.flat, exact.flat, radius.flat, strict=True)]
        assert all(inside)


@pytest.mark.parametrize("sign", [1, -1])
@pytest.mark.parametrize("route", [0, 1], ids=["float", "arb"])
def test_the_estimate_chooses_the_branch_and_the_motion_keeps_it(sign, route):
    engine = ClosedForm()
    scene = linkage(LENGTHS, times=tuple(np.linspace(0.0, 7.0, 40)), sign=sign)
    motion = engine.solve(scene, engine.routes()[route])

    assert motion.verdict is Status.OK
    assert set(orientation(motion)) == {sign}


def test_a_flat_estimate_goes_to_the_nearer_assembly():
    """Coupler and rocker in one line in the estimate, which lies on the upper side."""
    scene = linkage(LENGTHS, sign=1)
    bodies = list(scene.mechanism.bodies)
    tip, ground = cmath.rect(1.0, 0.3), 4.0 + 0j
    pin = 0.5 * (tip + ground) + 0.1j  # sine of the angle at the pin: below 0.13
    for k, root in ((1, tip), (2, ground)):
        bodies[k] = replace(bodies[k], estimate=(root.real, root.imag, cmath.phase(pin - root)))
    flat = replace(scene, mechanism=replace(scene.mechanism, bodies=tuple(bodies)))

    assert np.array_equal(ClosedForm().solve(flat).q, ClosedForm().solve(scene).q)


def test_without_estimates_the_positive_orientation_is_taken_and_said():
    motion = ClosedForm().solve(linkage(LENGTHS, estimates=False))

    assert motion.verdict is Status.OK
    assert "no estimate" in motion.message


@pytest.mark.parametrize("turns", [-3, 0, 7])
def test_angles_keep_the_turns_of_the_estimate(turns):
    scene = linkage(LENGTHS, times=tuple(np.linspace(0.0, 20.0, 100)), turns=turns)
    plain = linkage(LENGTHS, times=scene.times)
    moved = ClosedForm().solve(scene)["coupler"].phi - ClosedForm().solve(plain)["coupler"].phi

    assert np.abs(moved - math.tau * turns).max() < 1e-13


@pytest.mark.parametrize("bits", [None, 113])
def test_a_follower_that_turns_is_counted_between_far_times(bits):
    """A drag link: crank, coupler and rocker all turn, 50 rad between two times that are asked for."""
    drag = {"ground": 1.0, "crank": 3.0, "coupler": 2.5, "rocker": 3.2}
    law = Polynomial(coefficients=(0.3, 100.0))
    motion = ClosedForm(bits).solve(linkage(drag, law, times=(0.0, 0.5, 1.0, 1.5)))
    turned = motion["rocker"].phi - motion["crank"].phi

    assert motion.verdict is Status.OK
    assert np.abs(turned - turned[0]).max() < math.pi, motion.message


def test_turns_that_cannot_be_counted_are_no_answer():
    """1e9 rad between two times: no grid of the closed form follows that."""
    drag = {"ground": 1.0, "crank": 3.0, "coupler": 2.5, "rocker": 3.2}
    law = Polynomial(coefficients=(0.3, 1e9))
    motion = ClosedForm().solve(linkage(drag, law, times=(0.0, 1.0)))

    assert motion.status == (Status.OK, Status.NOT_CONVERGED)
    assert np.isnan(motion.q[:, 1]).all()


@pytest.mark.parametrize("bits", [None, 113])
@pytest.mark.parametrize(("coupler", "gap"), [(1.5, "(a + b) - D"), (8.5, "D - |a - b|")])
def test_what_cannot_close_is_unassemblable_with_its_gap(bits, coupler, gap):
    """Crank at pi: D = 5. Rocker 3 and coupler 1.5 reach 4.5; coupler 8.5 and rocker 3 stay 5.5 apart."""
    law = Polynomial(coefficients=(math.pi, 1.0))
    motion = ClosedForm(bits).solve(linkage({**LENGTHS, "coupler": coupler}, law))

    assert motion.verdict is Status.UNASSEMBLABLE
    assert f"{gap} = -0.5 m" in motion.message
    assert np.isnan(motion.q).all()


def test_a_motion_that_leaves_its_range_is_answered_within_it():
    short = {**LENGTHS, "coupler": 1.5}
    times = tuple(np.linspace(0.0, math.tau, 41))
    motion = ClosedForm().solve(linkage(short, times=times))
    distance = abs(4.0 - np.exp(1j * (0.3 + motion.t)))
    closes = (distance < 4.5) & (distance > 1.5)

    assert [w is Status.OK for w in motion.status] == list(closes)
    assert 0 < closes.sum() < 41
    assert np.isfinite(motion.q[:, closes]).all()


@pytest.mark.parametrize("bits", [None, 113])
def test_a_dead_centre_is_singular_with_a_pose_and_no_rates(bits):
    """Crank at 0 and 4 = 1 + 1.5 + 1.5: coupler and rocker in line."""
    lengths = {"ground": 4.0, "crank": 1.0, "coupler": 1.5, "rocker": 1.5}
    motion = ClosedForm(bits).solve(linkage(lengths, Polynomial(coefficients=(0.0, 1.0))))

    assert motion.verdict is Status.SINGULAR
    assert motion["rocker"].phi == pytest.approx(math.pi, abs=1e-7)
    assert np.isnan(motion.qd).all()


@pytest.mark.parametrize("slack", [1e-9, 1e-12])
def test_balls_decide_near_a_dead_centre(slack):
    """Slack 1e-12 is 1e-16 after its root: floats lose half of their digits there, balls do not."""
    lengths = {"ground": 4.0, "crank": 1.0, "coupler": 1.5, "rocker": 1.5 + slack}
    found = truth(linkage(lengths, Polynomial(coefficients=(0.0, 1.0))))

    assert found.motion.verdict is Status.OK
    assert found.radius_q.max() < 4 * U * np.abs(found.motion.q).max()


def test_scenes_scale_with_powers_of_two_bit_by_bit():
    scene = linkage(LENGTHS, times=tuple(np.linspace(0.0, 6.0, 20)))
    small = linkage({k: math.ldexp(v, -30) for k, v in LENGTHS.items()}, times=scene.times)
    scale = np.tile([2.0**-30, 2.0**-30, 1.0], 3)[:, None]

    for large, little in zip(ClosedForm().solve(scene).levels, ClosedForm().solve(small).levels, strict=True):
        assert np.array_equal(little, large * scale)


@given(data=st.data(), build=st.sampled_from(list(TOPOLOGIES)))
def test_the_order_of_bodies_and_joints_does_not_matter(data, build):
    scene = data.draw(drawings(build)).scene(times=(0.0,))
    m = scene.mechanism
    turned = replace(scene, mechanism=Mechanism(m.bodies[::-1], m.joints[::-1], m.drivers))
    one, two = truth(scene), truth(turned)
    assume(one.motion.verdict is Status.OK)
    radius = np.fmax(one.radius_q, two.radius_q.reshape(-1, 3)[::-1].reshape(-1, 1))

    assert np.all(abs(one.motion.q - two.motion.q.reshape(-1, 3)[::-1].reshape(-1, 1)) <= 2 * radius)


# Laws, points, wanted bodies, refusals.

LAWS = [
    Polynomial(coefficients=(0.2, 0.5, -0.1, 0.03)),
    Sinusoid(amplitude=0.4, angular_frequency=1.3, offset=0.1, phase=0.2),
    Table(argument=(0.0, 0.7, 1.1, 2.0, 3.0), value=(0.1, 0.3, 0.2, 0.5, 0.4)),
    Table(argument=(0.0, 1.0, 3.0), value=(0.1, 0.3, 0.2)),
    Table(argument=(0.0, 3.0), value=(0.1, 0.3)),
    Table(argument=(0.0, 0.4, 1.0, 1.7), value=(0.1, 0.3, 0.2, 0.1), periodic=True),
]


@pytest.mark.parametrize("rate", [False, True])
@pytest.mark.parametrize("law", LAWS, ids=lambda law: f"{law.kind}-{len(getattr(law, 'argument', ()))}")
def test_exact_laws_agree_with_float_laws(law, rate):
    """Coefficients of five knots are some tens of operations on values and slopes of order 1: 1e-14 holds them."""
    scene = linkage(LENGTHS, times=tuple(np.linspace(0.0, 3.0, 13)))
    driver = {"rate_law": law, "initial": 0.3} if rate else {"law": law}
    motor = AngleDriver(name="motor", body="crank", **driver)
    driven = replace(scene, mechanism=replace(scene.mechanism, drivers=(motor,)))
    crank = truth(driven).motion["crank"]
    expected = [motor.laws[0](np.array(scene.times), order) for order in range(3)]

    for got, want in zip((crank.phi, crank.phid, crank.phidd), expected, strict=True):
        assert np.abs(got - want).max() < 1e-14


def test_points_move_with_their_body():
    scene = linkage(LENGTHS, times=tuple(np.linspace(0.0, 1.0, 5)))
    scene = replace(scene, points=(Point(name="P", body="coupler", position=(0.3, 0.2)),))
    motion = truth(scene).motion
    carried = Carried(motion, "coupler").point((0.3, 0.2))
    p = motion.points["P"]

    for got, want in zip((p.r, p.v, p.a), carried, strict=True):
        assert np.abs(got[0] + 1j * got[1] - want).max() < 1e-14


def test_only_what_is_wanted_is_reported():
    scene = replace(linkage(LENGTHS), bodies_wanted=("rocker",), effects=frozenset())
    motion = ClosedForm().solve(scene)

    assert motion.bodies == ("rocker",)
    assert motion.q.shape == (3, 1)
    assert motion.qd is None
    assert motion.qdd is None


def triad():
    """Three bodies on three pins of a coupler that is not held: class III."""
    d = Drawing({"1": (0j, 0.0), "2": (1 + 0j, 1.0), "3": (0j, 2.0), "4": (1j, 0.5)})
    for k, (root, tip) in enumerate(((0j, 1 + 0.2j), (3 + 0j, 2 + 0.3j), (1 + 3j, 1.5 + 1j))):
        d.pin("ground", str(k + 1), root)
        d.pin(str(k + 1), "4", tip)
    return d.scene(times=(0.0,))


def test_a_group_of_class_three_is_refused_by_name():
    with pytest.raises(EngineError, match=r"no dyad places '1', '2', '3', '4'"):
        ClosedForm().solve(triad())


def test_redundant_constraints_are_refused_by_name():
    scene = linkage(LENGTHS)
    twice = AngleDriver(name="again", body="rocker", law=LAW)
    m = scene.mechanism

    with pytest.raises(EngineError, match="1 redundant constraint"):
        ClosedForm().solve(replace(scene, mechanism=replace(m, drivers=(*m.drivers, twice))))


def test_an_angle_given_twice_is_refused_by_name():
    """As many rows as coordinates, but one angle has two and a distance none."""
    scene = linkage(LENGTHS)
    m = scene.mechanism
    twice = AngleDriver(name="again", body="crank", law=LAW)
    loose = (*m.joints[:3], PointOnLine(name="B0", body_i=GROUND, point_i=(4.0, 0.0), axis_i=(1.0, 0.0),
                                       body_j="rocker", point_j=(0.0, 0.0)))  # fmt: skip

    with pytest.raises(EngineError, match="'again' gives an angle that is already given"):
        ClosedForm().solve(replace(scene, mechanism=Mechanism(m.bodies, loose, (*m.drivers, twice))))


def test_there_are_no_constraint_rows():
    engine = ClosedForm()
    with pytest.raises(EngineError, match="no constraint rows"):
        engine.constraints(linkage(LENGTHS))

    levels = {(lv, c.support) for joint in engine.capabilities().values() for lv, c in joint.items()}
    assert {lv for lv, support in levels if support is not Support.REFUSED} == {Level.SOLVE}


def test_an_unknown_route_is_refused():
    engine = ClosedForm()
    with pytest.raises(EngineError, match="route"):
        engine.solve(linkage(LENGTHS), replace(engine.routes()[0], name="guess"))


def test_it_is_registered_as_an_engine():
    assert isinstance(load("closed_form"), Engine)


def test_only_the_branch_is_taken_from_the_estimate():
    assert {route.seeding for route in ClosedForm().routes()} == {Seeding.INITIAL_GUESS}


def test_no_geometry_is_shared_with_the_reference():
    """It reads the dataclasses of a scene, laws among them, and writes a Motion; it imports no formula."""
    root = Path(__file__).parents[2] / "crosscheck"
    files = [*(root / "assur").glob("*.py"), root / "engines" / "closed_form.py"]
    trees = [ast.parse(path.read_text()) for path in files]
    modules = {n.module for tree in trees for n in ast.walk(tree) if isinstance(n, ast.ImportFrom)}

    assert len(files) == 7
    assert {m for m in modules if m.startswith("refkin")} <= {
        "refkin.joints",
        "refkin.model",
        "refkin.motion",
        "refkin.motion_laws",
    }
