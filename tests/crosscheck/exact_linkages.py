"""Linkages with the motion that elementary geometry gives them, in complex numbers; not a test itself."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from refkin.joints import (
    GROUND,
    AngleDriver,
    Constraint,
    Distance,
    DistanceDriver,
    Fixed,
    Gear,
    PointOnLine,
    Prismatic,
    XDriver,
    YDriver,
)
from refkin.model import Body, Mechanism, Scene
from refkin.motion import Motion
from refkin.motion_laws import Polynomial, Sinusoid
from tests.drawn import pair, pin
from tests.linkages import remade

EPS = float(np.finfo(float).eps)


@dataclass(frozen=True)
class Path:
    """A complex function of time with its first two derivatives: a point, or e^(i angle)."""

    r: Any
    v: Any
    a: Any

    def __add__(self, other: Path) -> Path:
        return Path(self.r + other.r, self.v + other.v, self.a + other.a)


@dataclass(frozen=True)
class Angle:
    """A real function of time with its first two derivatives."""

    p: Any
    d: Any
    dd: Any

    def arm(self, u: complex) -> Path:
        """Return u turned by the angle."""
        e = np.exp(1j * self.p) * u
        return Path(e, 1j * self.d * e, (1j * self.dd - self.d**2) * e)

    def plus(self, constant: float) -> Angle:
        return Angle(self.p + constant, self.d, self.dd)


def at_rest(z: complex) -> Path:
    return Path(z, 0j, 0j)


def body_rows(origin: Path, angle: Angle) -> list[np.ndarray]:
    """Return the (3, T) rows of a body at each level."""
    levels = ((origin.r, angle.p), (origin.v, angle.d), (origin.a, angle.dd))
    return [np.array([np.broadcast_to(x, T.shape) for x in (np.real(r), np.imag(r), phi)]) for r, phi in levels]


T = np.linspace(0.0, 2.0, 72)
LAW = Polynomial(coefficients=(0.6, 1.5, 0.7))
THETA = Angle(LAW(T), LAW(T, 1), LAW(T, 2) + 0.0 * T)
MOTOR = AngleDriver(name="motor", body="crank", law=LAW)


def scene_of(
    rows: dict[str, list[np.ndarray]], joints: Any, drivers: Any = (MOTOR,), size: float = 1.0, **more: Any
) -> Scene:
    """Return the scene whose exact motion is `rows`, with estimates that are off by up to 0.02 (sizes, rad)."""
    rng = np.random.default_rng(11)
    bodies = []
    for name, levels in rows.items():
        off = rng.uniform(-0.02, 0.02, 3) * [size, size, 1.0]
        bodies.append(Body(name=name, estimate=tuple((levels[0][:, 0] + off).tolist())))
    return Scene(mechanism=Mechanism(tuple(bodies), tuple(joints), tuple(drivers)), times=tuple(T.tolist()), **more)


@dataclass(frozen=True)
class Case:
    """A scene, its exact motion, and kappa: how much its equations, in units of its size, amplify an error."""

    scene: Scene
    rows: dict[str, list[np.ndarray]]
    kappa: float


def dyad(p: Path, s: Path, b: float, c: float, branch: int) -> tuple[Angle, Angle]:
    """Return the angles of links b from p and c from s to the pin that they share."""
    gap = s.r - p.r
    d = np.abs(gap)
    theta3 = np.unwrap(np.angle(gap) + branch * np.arccos((d * d + b * b - c * c) / (2 * b * d)))
    theta4 = np.unwrap(np.angle(p.r + b * np.exp(1j * theta3) - s.r))
    e3, e4 = np.exp(1j * theta3), np.exp(1j * theta4)

    def solved(rest: Any) -> tuple[Any, Any]:
        """Return (x, y) with rest + i b x e3 - i c y e4 = 0, by projection on e4 and e3."""
        x = -np.real(rest * np.conj(e4)) / np.real(1j * b * e3 * np.conj(e4))
        return x, np.real(rest * np.conj(e3)) / np.real(1j * c * e4 * np.conj(e3))

    w3, w4 = solved(p.v - s.v)
    a3, a4 = solved(p.a - s.a - b * w3**2 * e3 + c * w4**2 * e4)
    return Angle(theta3, w3, a3), Angle(theta4, w4, a4)


def four_bar(
    branch: int = 1, size: float = 1.0, at: complex = 0j, lengths: Any = (1.0, 3.5, 3.0, 4.0), **more: Any
) -> Case:
    """Crank a, coupler b, rocker c, ground d; frames away from the pins."""
    a, b, c, d = (size * length for length in lengths)
    crank = THETA.arm(a)
    coupler, rocker = dyad(crank, at_rest(d), b, c, branch)
    rows = {
        "crank": body_rows(at_rest(at) + THETA.arm(0.5 * a), THETA),
        "coupler": body_rows(at_rest(at) + crank + coupler.arm(0.5 * b + 0.25j * size), coupler),
        "rocker": body_rows(at_rest(at + d) + rocker.arm(0.5 * c), rocker),
    }
    joints = (
        pin("A0", GROUND, at, "crank", -0.5 * a),
        pin("A", "crank", 0.5 * a, "coupler", -0.5 * b - 0.25j * size),
        pin("B", "rocker", 0.5 * c, "coupler", 0.5 * b - 0.25j * size),
        pin("B0", "rocker", -0.5 * c, GROUND, at + d),
    )
    return Case(
        scene_of(rows, joints, size=size, **more), rows, float(np.max(1.0 / np.abs(np.sin(rocker.p - coupler.p))))
    )


def slider_crank(tilt: float = 0.0, angle: float = 0.0, rod_is: str = "body", guide_on: str = GROUND) -> Case:
    """Crank 1, rod 3, offset 0.4, on a guide at `tilt`, the slider turned by `angle` on it; the rod a body or not."""
    r, length, offset = 1.0, 3.0, 0.4
    sine = (offset - r * np.sin(THETA.p)) / length
    phi = np.arcsin(sine)
    d = -r * THETA.d * np.cos(THETA.p) / (length * np.cos(phi))
    dd = -r * (THETA.dd * np.cos(THETA.p) - THETA.d**2 * np.sin(THETA.p)) + length * d**2 * sine
    crank, rod = THETA.plus(tilt), Angle(phi, d, dd / (length * np.cos(phi))).plus(tilt)
    still = Angle(tilt + angle, 0.0, 0.0)
    end = crank.arm(r) + rod.arm(length)
    rows = {
        "crank": body_rows(at_rest(0j), crank),
        "rod": body_rows(crank.arm(r), rod),
        "slider": body_rows(end + still.arm(-0.5j), still),
    }
    along = np.exp(1j * tilt)
    guide = {"name": "G", "point_i": pair(1j * offset * along), "axis_i": pair(2.0 * along), "point_j": (0.0, 0.5)}
    prismatic = Prismatic(**guide, body_i=GROUND, body_j="slider", angle=tilt + angle)
    if guide_on == "slider":
        own = np.exp(-1j * angle)
        guide = {"name": "G", "point_i": (0.0, 0.5), "axis_i": pair(own), "point_j": pair(1j * offset * along)}
        prismatic = Prismatic(**guide, body_i="slider", body_j=GROUND, angle=-tilt - angle)
    joints: list[Constraint] = [pin("A0", GROUND, 0j, "crank", 0j), prismatic]
    if rod_is == "body":
        joints += [pin("A", "crank", r, "rod", 0j), pin("B", "rod", length, "slider", 0.5j)]
    else:
        del rows["rod"]
        ends = {"body_i": "crank", "point_i": (r, 0.0), "body_j": "slider", "point_j": (0.0, 0.5)}
        joints.append(Distance(name="rod", **ends, length=length))
    driver = replace(MOTOR, law=Polynomial(coefficients=(LAW.coefficients[0] + tilt, *LAW.coefficients[1:])))
    return Case(scene_of(rows, joints, (driver,)), rows, float(np.max(1.0 / np.cos(phi))))


def inverted_slider_crank() -> Case:
    """A crank of 1 drives a block along a rocker pivoted at -2.5: a guide that moves, between two moving bodies."""
    pivot, turned = -2.5, 0.4
    reach = at_rest(-pivot + 0j) + THETA.arm(1.0)
    rate, curve = reach.v / reach.r, reach.a / reach.r - (reach.v / reach.r) ** 2
    rocker = Angle(np.unwrap(np.angle(reach.r)), np.imag(rate), np.imag(curve))
    rows = {
        "crank": body_rows(at_rest(0j), THETA),
        "rocker": body_rows(at_rest(pivot + 0j), rocker),
        "block": body_rows(THETA.arm(1.0), rocker.plus(turned)),
    }
    guide = Prismatic(
        name="G",
        body_i="rocker",
        point_i=(0.3, 0.0),
        axis_i=(1.0, 0.0),
        body_j="block",
        point_j=(0.0, 0.0),
        angle=turned,
    )
    joints = (
        pin("A0", GROUND, 0j, "crank", 0j),
        pin("B0", GROUND, pivot, "rocker", 0j),
        pin("A", "crank", 1.0, "block", 0j),
        guide,
    )
    return Case(scene_of(rows, joints), rows, float(np.max(1.0 / np.abs(reach.r))))


def scotch_yoke() -> Case:
    """A crank pin on a line across a yoke that slides along x: x = cos theta."""
    pin_path = THETA.arm(1.0)
    rows = {
        "crank": body_rows(at_rest(0j), THETA),
        "yoke": body_rows(Path(*(np.real(x) + 0j for x in (pin_path.r, pin_path.v, pin_path.a))), Angle(0.0, 0.0, 0.0)),
    }
    line = PointOnLine(
        name="L", body_i="yoke", point_i=(0.0, 0.7), axis_i=(0.0, -2.0), body_j="crank", point_j=(1.0, 0.0)
    )
    guide = Prismatic(name="G", body_i=GROUND, point_i=(3.0, 0.0), axis_i=(1.0, 0.0), body_j="yoke", point_j=(0.0, 0.0))
    return Case(scene_of(rows, (pin("A0", GROUND, 0j, "crank", 0j), line, guide)), rows, 1.0)


def welded_arm() -> Case:
    """Two links, the second driven against the first, with a body fixed on its end."""
    second = Angle(*(2.0 * x for x in (THETA.p, THETA.d, THETA.dd)))
    tip = THETA.arm(1.0) + second.arm(0.8)
    tool = second.plus(-0.3)
    rows = {
        "tool": body_rows(tip + tool.arm(-0.2j), tool),
        "crank": body_rows(at_rest(0j), THETA),
        "arm": body_rows(THETA.arm(1.0), second),
    }
    weld = Fixed(name="W", body_i="tool", point_i=(0.0, 0.2), body_j="arm", point_j=(0.8, 0.0), angle=0.3)
    joints = (weld, pin("A0", GROUND, 0j, "crank", 0j), pin("A", "crank", 1.0, "arm", 0j))
    relative = AngleDriver(name="second", body="arm", relative_to="crank", law=LAW)
    return Case(scene_of(rows, joints, (MOTOR, relative)), rows, 1.0)


def cylinder() -> Case:
    """A boom raised by a cylinder between (1.5, 0) and its point at 2: f^2 = 2^2 + 1.5^2 - 2 * 2 * 1.5 cos psi."""
    law = Sinusoid(offset=2.5, amplitude=0.6, angular_frequency=2.0, phase=0.3)
    f, fd, fdd = law(T), law(T, 1), law(T, 2)
    cosine = (2.0**2 + 1.5**2 - f * f) / (2 * 2.0 * 1.5)
    psi = np.arccos(cosine)
    d = f * fd / (3.0 * np.sin(psi))
    boom = Angle(psi, d, ((fd * fd + f * fdd) / 3.0 - cosine * d * d) / np.sin(psi))
    rows = {"boom": body_rows(at_rest(0j), boom)}
    ends = {"body_i": GROUND, "point_i": (1.5, 0.0), "body_j": "boom", "point_j": (2.0, 0.0)}
    driver = DistanceDriver(name="C", **ends, law=law)
    kappa = float(np.max(f / (3.0 * np.sin(psi))))
    return Case(scene_of(rows, (pin("A0", GROUND, 0j, "boom", 0j),), (driver,)), rows, kappa)


def lifted_end(key: str) -> Case:
    """A crank of length 1 whose end follows x = f or y = f: psi = acos f or asin f."""
    law = Sinusoid(offset=0.1, amplitude=0.7, angular_frequency=2.0, phase=0.3)
    f, fd, fdd = law(T), law(T, 1), law(T, 2)
    slope = np.sqrt(1.0 - f * f) * (-1.0 if key == "x" else 1.0)  # f' = slope psi'
    psi = np.arccos(f) if key == "x" else np.arcsin(f)
    d = fd / slope
    rows = {"boom": body_rows(at_rest(2.0 - 1j), Angle(psi, d, (fdd + f * d * d) / slope))}
    kind, shift = (XDriver, 2.0) if key == "x" else (YDriver, -1.0)
    driver = kind(name="D", body="boom", point=(1.0, 0.0), law=replace(law, offset=law.offset + shift))
    return Case(
        scene_of(rows, (pin("A0", GROUND, 2.0 - 1j, "boom", 0j),), (driver,)), rows, float(np.max(1 / np.abs(slope)))
    )


def floating() -> Case:
    """A body that no joint holds: x, y and phi of it are driven."""
    path = Path(THETA.p + 2j * THETA.p, THETA.d + 2j * THETA.d, THETA.dd + 2j * THETA.dd)
    rows = {"crank": body_rows(path, THETA)}
    double = Polynomial(coefficients=tuple(2.0 * c for c in LAW.coefficients))
    drivers = (MOTOR, XDriver(name="x", body="crank", law=LAW), YDriver(name="y", body="crank", law=double))
    return Case(scene_of(rows, (), drivers), rows, 1.0)


def parallel_links() -> Case:
    """A plate swung without turning by two equal distance joints side by side; a line on the crank leads it."""
    law = Sinusoid(offset=0.3, amplitude=0.5, angular_frequency=2.0)
    swing = Angle(law(T), law(T, 1), law(T, 2))
    rows = {"plate": body_rows(swing.arm(1.5), Angle(0.0, 0.0, 0.0)), "crank": body_rows(at_rest(0j), swing)}
    ends = {"body_i": GROUND, "body_j": "plate", "length": 1.5}
    line = {"point_i": (0.0, 0.0), "axis_i": (1.0, 0.0), "point_j": (0.0, 0.0)}
    joints = (
        pin("A0", GROUND, 0j, "crank", 0j),
        Distance(name="low", point_i=(0.0, 0.0), point_j=(0.0, 0.0), **ends),
        Distance(name="high", point_i=(0.0, 2.0), point_j=(0.0, 2.0), **ends),
        PointOnLine(name="L", body_i="crank", body_j="plate", **line),
    )
    # the links turn the plate with the lever 2 cos, and are led across it with 1.5
    kappa = float(np.max(1.0 / np.cos(swing.p)))
    return Case(scene_of(rows, joints, (replace(MOTOR, law=law),)), rows, kappa)


def geared_five_bar() -> Case:
    """Two geared cranks whose tips carry two links with a common end; the second wheel is the larger one."""
    wheel = Angle(0.25 - 2.0 / 3.0 * (THETA.p - 0.125), -2.0 / 3.0 * THETA.d, -2.0 / 3.0 * THETA.dd)
    p, s = THETA.arm(1.0), at_rest(2.0 + 0j) + wheel.arm(1.0)
    left, right = dyad(p, s, 2.0, 1.75, 1)
    rows = {
        "crank": body_rows(at_rest(0j), THETA),
        "wheel": body_rows(at_rest(2.0 + 0j), wheel),
        "left": body_rows(p, left),
        "right": body_rows(s, right),
    }
    teeth = Gear(name="teeth", body_i="crank", radius_i=0.5, phi0_i=0.125, body_j="wheel", radius_j=0.75, phi0_j=0.25)
    joints = (
        pin("A", GROUND, 0j, "crank", 0j),
        pin("D", GROUND, 2.0, "wheel", 0j),
        pin("P", "crank", 1.0, "left", 0j),
        pin("S", "wheel", 1.0, "right", 0j),
        pin("T", "left", 2.0, "right", 1.75),
        teeth,
    )
    return Case(scene_of(rows, joints), rows, float(np.max(1.0 / np.abs(np.sin(right.p - left.p)))))


def planet_five_bar() -> Case:
    """A planet, with its centre on the crank, rolls on a wheel at rest, and its arm moves a link and a rocker."""
    turned = 0.25 + 2.0 / 3.0 * (THETA.p + 0.125)
    planet = Angle(THETA.p + turned, 5.0 / 3.0 * THETA.d, 5.0 / 3.0 * THETA.dd)
    crank, arm, pivot = THETA.arm(1.0), planet.arm(0.5), at_rest(4.0 + 0j)
    tip = crank + arm
    link, rocker = dyad(tip, pivot, 3.5, 3.0, 1)
    rows = {
        "crank": body_rows(at_rest(0j), THETA),
        "planet": body_rows(crank, planet),
        "link": body_rows(tip, link),
        "rocker": body_rows(pivot, rocker),
    }
    radii = {"body_i": GROUND, "radius_i": 0.5, "phi0_i": 0.125, "body_j": "planet", "radius_j": 0.75, "phi0_j": 0.25}
    joints = (
        pin("A", GROUND, 0j, "crank", 0j),
        pin("P", "crank", 1.0, "planet", 0j),
        pin("T", "planet", 0.5, "link", 0j),
        pin("S", "link", 3.5, "rocker", 3.0),
        pin("D", GROUND, 4.0, "rocker", 0j),
        Gear(name="teeth", **radii, carrier="crank"),
    )
    return Case(scene_of(rows, joints), rows, float(np.max(1.0 / np.abs(np.sin(rocker.p - link.p)))))


def case_with(case: Case, **parts: Any) -> Case:
    """Return a case with other parts of its mechanism."""
    return replace(case, scene=remade(case.scene, **parts))


def turned_on(case: Case, turns: int) -> Case:
    """Return a case whose bodies, driven by one angle, begin whole turns further on."""
    away, (motor,) = np.array([0.0, 0.0, 2 * np.pi * turns]), case.scene.mechanism.drivers
    law = replace(motor.law, coefficients=(motor.law.coefficients[0] + away[2], *motor.law.coefficients[1:]))
    bodies = tuple(replace(b, estimate=tuple(b.estimate + away)) for b in case.scene.mechanism.bodies)
    rows = {name: [levels[0] + away[:, None], *levels[1:]] for name, levels in case.rows.items()}
    return replace(case_with(case, bodies=bodies, drivers=(replace(motor, law=law),)), rows=rows)


CASES: dict[str, Callable[[], Case]] = {
    "four-bar, open": four_bar,
    "four-bar, crossed": lambda: four_bar(branch=-1),
    "slider-crank": slider_crank,
    "slider-crank, tilted and turned": lambda: slider_crank(tilt=0.7, angle=-1.1),
    "slider-crank, axis on the slider": lambda: slider_crank(tilt=0.7, angle=-1.1, guide_on="slider"),
    "slider-crank, rod a distance": lambda: slider_crank(tilt=-0.4, rod_is="distance"),
    "inverted slider-crank": inverted_slider_crank,
    "scotch yoke": scotch_yoke,
    "welded arm": welded_arm,
    "cylinder": cylinder,
    "driven x": lambda: lifted_end("x"),
    "driven y": lambda: lifted_end("y"),
    "floating body": floating,
    "parallel links": parallel_links,
    "geared five-bar": geared_five_bar,
    "planet five-bar": planet_five_bar,
}


def excess(case: Case, motion: Motion) -> float:
    """Return the largest error over what is allowed, at any level that any body has.

    In units of the size a row takes some 16 roundings, half an EPS each, of numbers up to 1 + |phi|, here and there.
    kappa carries them into q; J changes by |qd| dq, so that they enter qd by kappa once more, and qdd a third time.
    """
    size = case.scene.mechanism.size()
    worst = 0.0
    for body, exact in case.rows.items():
        value = motion[body]
        scale = np.array([[size], [size], [1.0]])
        e = 16 * EPS * (1.0 + max(np.max(np.abs(levels[0][2])) for levels in case.rows.values()))
        rate = max(1.0, *(float(np.max(np.abs(levels[1] / scale))) for levels in case.rows.values()))
        for order, (ours, theirs) in enumerate(zip(exact, (value.q, value.qd, value.qdd), strict=True)):
            if theirs is None:
                continue
            far = np.abs(exact[0]) * EPS if order == 0 else 0.0  # a coordinate is handed over in metres from the origin
            allowed = e * case.kappa ** (order + 1) * rate**order * scale + far
            worst = max(worst, float(np.max(np.abs(ours - theirs) / allowed)))
    return worst
