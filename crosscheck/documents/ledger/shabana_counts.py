"""The rows D1, D2, D20 to D24 of the notes on Shabana: mobility, norms, rates, gears, structures."""

from __future__ import annotations

from typing import Any

import numpy as np

from crosscheck.documents.convergence import scaled_norms
from crosscheck.documents.ledger.arithmetic import Arithmetic, Binary64
from crosscheck.documents.ledger.me451 import Given, Values
from crosscheck.documents.ledger.shabana import numbers
from crosscheck.documents.ledger.shabana_four_bar import norm
from crosscheck.documents.systems.shabana import CrankAndRod
from refkin.analysis import position
from refkin.joints import (
    GROUND,
    AngleDriver,
    Gear,
    RackAndPinion,
    Revolute,
    SpatialAngleDriver,
    SpatialGear,
    SpatialRevolute,
    Triple,
    YDriver,
)
from refkin.model import Body, Mechanism, Point, Scene
from refkin.motion_laws import Integral, Law, Polynomial, Sinusoid, Table
from refkin.scenes.linkages import RSSR, SliderCrank
from refkin.solving.mobility import count, gruebler, mobility
from refkin.solving.solve import solve
from refkin.system import compile_system

STILL = (0.0, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0)
JOINTS_OF_RSSR = (
    ("revolute", GROUND, "input"),
    ("spherical", "input", "coupler"),
    ("spherical", "coupler", "output"),
    ("revolute", "output", GROUND),
)


def d1(n: Arithmetic, given: Given) -> Values:
    """Gruebler's count of the slider-crank: 3 * 4 - 11."""
    return {"coordinates": 3 * int(given["bodies"]), "equations": sum(int(rows) for rows in given["rows"])}


def refkin_d1(n: Binary64, given: Given) -> Values:
    """Count and rank of the linkage."""
    linkage = SliderCrank(crank=0.2, rod=0.35)
    whole = linkage.mechanism(linkage.driver(Polynomial(coefficients=(1.0,))))
    links = CrankAndRod(0.2, 0.35)
    at = links.pose(1.0, links.theta3(n, 1.0)).astype(float)
    counted = count(whole)
    return {
        "coordinates": counted.coordinates * counted.bodies,
        "equations": counted.equations,
        "mobility by count": counted.mobility,
        "mobility by rank": mobility(whole, at[3:]).mobility,
    }


def d2(n: Arithmetic, given: Given) -> Values:
    """Gruebler's count of the RSSR: 6 * 4 - 22."""
    return {"coordinates": 6 * int(given["bodies"]), "equations": sum(int(rows) for rows in given["rows"])}


def refkin_d2(n: Binary64, given: Given) -> Values:
    """The count by kinds of joints, with the spin that moves nothing else; and the rank at a pose of one."""
    counted = gruebler(JOINTS_OF_RSSR, "spatial")
    linkage = RSSR(crank=1.0, coupler=3.0, rocker=2.0, pivot=(2.5, -0.5, 0.75), axis=(1.0, 0.0, 0.25))
    scene = linkage.scene(speed=1.0, samples=2)
    of_rank = mobility(scene.mechanism, solve(scene).q[:, 0])
    return {
        "coordinates": counted.coordinates * counted.bodies,
        "equations": counted.equations,
        "mobility by count": counted.mobility,
        "without the passive spin": counted.useful,
        "mobility by rank": of_rank.mobility,
        "with its driver": of_rank.driven.freedoms,
    }


def _axle(name: str, i: str, j: str, axis: Triple, zero: Triple, at: Triple = (0.0, 0.0, 0.0)) -> SpatialRevolute:
    """Return a revolute joint whose axis, and zero, are the same in both bodies."""
    ends: dict[str, Any] = {"body_i": i, "point_i": at, "body_j": j, "point_j": (0.0, 0.0, 0.0)}
    return SpatialRevolute(name=name, **ends, axis_i=axis, zero_i=zero, axis_j=axis, zero_j=zero)


def _turned_by(joint: str, law: Polynomial) -> SpatialAngleDriver:
    return SpatialAngleDriver(name=f"motor of {joint}", joint=joint, law=law)


def d20(n: Arithmetic, given: Given) -> Values:
    """The norms of the printed vectors, divided by the number of equations."""
    return {name: norm(n, n.vector(given[name])) for name in ("C(q1)", "dq1")}


def refkin_d20(n: Binary64, given: Given) -> Values:
    """`scaled_norms` stops just above these norms, and not just below."""
    residual, correction = n.vector(given["C(q1)"]), n.vector(given["dq1"])
    big = np.ones(3)
    return {
        "stops just above": [scaled_norms(3.078e-4)(residual, big, big), scaled_norms(1.2618e-3)(big, correction, big)],
        "stops just below": [scaled_norms(3.076e-4)(residual, big, big), scaled_norms(1.2616e-3)(big, correction, big)],
    }


def d21(n: Arithmetic, given: Given) -> Values:
    """theta_0 + the integral of a rate: polynomial, sinusoid, and the spline through a cubic, which is that cubic."""
    t, initial = n(given["t"]), n(given["initial"])
    a, w, p = numbers(n, given, "amplitude", "frequency", "phase")
    cubic = [n(c) for c in given["cubic"]]
    whole = sum((c * t ** (k + 1) / (k + 1) for k, c in enumerate(cubic)), initial)
    return {"polynomial": whole, "sinusoid": initial + a / w * (np.cos(p) - np.cos(w * t + p)), "spline": whole}


def refkin_d21(n: Binary64, given: Given) -> Values:
    """The laws that drivers follow."""
    t, initial = n(given["t"]), n(given["initial"])
    amplitude, frequency, phase = numbers(n, given, "amplitude", "frequency", "phase")
    cubic = Polynomial(coefficients=tuple(n(c) for c in given["cubic"]))
    knots = tuple(n(k) for k in given["knots"])
    rates: dict[str, Law] = {
        "polynomial": cubic,
        "sinusoid": Sinusoid(amplitude=amplitude, angular_frequency=frequency, phase=phase),
        "spline": Table(argument=knots, value=tuple(float(cubic(k)) for k in knots)),
    }
    laws = {name: Integral(rate=rate, initial=initial) for name, rate in rates.items()}
    return {name: float(law(t)) for name, law in laws.items()}


def d22(n: Arithmetic, given: Given) -> Values:
    """A spur pair and a rack with its pinion: what rolling without sliding makes of an input angle.

    Bevel gears roll as their cones do; helical ones as wheels of radius R cos(helix) do, across the teeth.
    """
    a_i, a_j, turned, radius = numbers(n, given, "a_i", "a_j", "theta_i", "radius")
    cone_i, cone_j, helix_i, helix_j = numbers(n, given, "cone_i", "cone_j", "helix_i", "helix_j")
    return {
        "spur: theta_j": -a_i / a_j * turned,
        "rack: travel": radius * turned,
        "bevel: omega_j / omega_i": -np.sin(cone_i) / np.sin(cone_j),
        "helical: omega_j / omega_i": -a_i * np.cos(helix_i) / (a_j * np.cos(helix_j)),
    }


def _in_gear(axis_j: Triple, at_j: Triple, radius_i: float, radius_j: float) -> float:
    """Return omega_j / omega_i of two wheels in gear; i turns about z, j about an axis through a point."""
    across = (1.0, 0.0, 0.0) if abs(axis_j[0]) < 0.9 else (0.0, 1.0, 0.0)
    axles = (
        _axle("i", GROUND, "wheel i", (0.0, 0.0, 1.0), (1.0, 0.0, 0.0)),
        _axle("j", GROUND, "wheel j", axis_j, across, at_j),
    )
    mesh = SpatialGear(name="mesh", joint_i="i", radius_i=radius_i, joint_j="j", radius_j=radius_j)
    bodies = (Body(name="wheel i", estimate=STILL), Body(name="wheel j", estimate=(*at_j, 1.0, 0.0, 0.0, 0.0)))
    driver = _turned_by("i", Polynomial(coefficients=(0.0, 1.0)))
    motion = solve(Scene(mechanism=Mechanism(bodies, (*axles, mesh), (driver,)), times=(0.0,)))
    return float(motion["wheel j"].omega[:, 0] @ axis_j / motion["wheel i"].omega[2, 0])


def refkin_d22(n: Binary64, given: Given) -> Values:
    """The same with gears and rack as joints, in space by the radii at which cones touch, and across the teeth."""
    a_i, a_j, turned, radius = numbers(n, given, "a_i", "a_j", "theta_i", "radius")
    cone_i, cone_j, helix_i, helix_j = numbers(n, given, "cone_i", "cone_j", "helix_i", "helix_j")
    origin = (0.0, 0.0)
    wheels = tuple(
        Revolute(name=f"axle {name}", body_i=GROUND, point_i=at, body_j=name, point_j=origin)
        for name, at in (("i", origin), ("j", (a_i + a_j, 0.0)))
    )
    drive = AngleDriver(name="input", body="i", law=Polynomial(coefficients=(turned,)))
    mesh = Gear(name="mesh", body_i="i", radius_i=a_i, body_j="j", radius_j=a_j)
    pair = compile_system(Mechanism((Body(name="i"), Body(name="j")), (*wheels, mesh), (drive,)))
    shaft, crossed, a = cone_i + cone_j, helix_i + helix_j, a_i + a_j
    bevel = (np.sin(shaft), 0.0, np.cos(shaft)), (0.0, 0.0, 0.0), np.sin(cone_i), np.sin(cone_j)
    across_teeth = a_i * np.cos(helix_i), a_j * np.cos(helix_j)
    helical = (0.0, -np.sin(crossed), np.cos(crossed)), (a, 0.0, 0.0), *across_teeth
    return {
        "spur: theta_j": position(pair, np.zeros(6), 0.0).q[5],
        "rack: travel": _rack(radius, turned),
        "bevel: omega_j / omega_i": _in_gear(*bevel),
        "helical: omega_j / omega_i": _in_gear(*helical),
    }


def _rack(radius: float, turned: float) -> float:
    """Return how far a pinion rolls along a rack on the ground, its centre at height -radius."""
    origin = (0.0, 0.0)
    rolling = RackAndPinion(
        name="rack", body_i=GROUND, point_i=origin, axis_i=(1.0, 0.0), body_j="pinion", point_j=origin, radius=radius
    )
    still = Polynomial(coefficients=(-radius,))
    held = YDriver(name="height", body="pinion", law=still)
    drive = AngleDriver(name="input", body="pinion", law=Polynomial(coefficients=(turned,)))
    system = compile_system(Mechanism((Body(name="pinion"),), (rolling,), (held, drive)))
    return float(position(system, np.array([0.0, -radius, 0.0]), 0.0).q[0])


def _about(axis: int, angle: Any, order: int) -> Any:
    """Return the rotation about z (axis 2) or x (axis 0), or a derivative of it with respect to the angle."""
    c, s = np.cos(angle), np.sin(angle)
    c, s = ((c, s), (-s, c), (-c, -s))[order]
    still = c * 0 + (1 if order == 0 else 0)
    zero = c * 0
    if axis == 2:
        return np.array([[c, -s, zero], [s, c, zero], [zero, zero, still]], dtype=object)
    return np.array([[still, zero, zero], [zero, c, -s], [zero, s, c]], dtype=object)


def d23(n: Arithmetic, given: Given) -> Values:
    """The derivatives of Rz(a + w t) Rx(b + u t) s, product by product."""
    (w, u), (a, b), t = n.vector(given["rates"]), n.vector(given["first"]), n(given["t"])
    s = np.array(list(n.vector(given["point"])), dtype=object)
    z, x = ([_about(axis, angle, k) for k in range(3)] for axis, angle in ((2, a + w * t), (0, b + u * t)))
    velocity = w * (z[1] @ x[0]) + u * (z[0] @ x[1])
    bent = w * w * (z[2] @ x[0]) + 2 * w * u * (z[1] @ x[1]) + u * u * (z[0] @ x[2])
    return {"velocity": list(velocity @ s), "acceleration": list(bent @ s)}


def refkin_d23(n: Binary64, given: Given) -> Values:
    """V + omega x s and a + alpha x s + omega x (omega x s), with the rates of the body that two joints carry."""
    (w, u), (a, b), t = n.vector(given["rates"]), n.vector(given["first"]), float(n(given["t"]))
    axles = (
        _axle("outer", GROUND, "frame", (0.0, 0.0, 1.0), (1.0, 0.0, 0.0)),
        _axle("inner", "frame", "body", (1.0, 0.0, 0.0), (0.0, 1.0, 0.0)),
    )
    laws = (Polynomial(coefficients=(a, w)), Polynomial(coefficients=(b, u)))
    drives = [_turned_by(axle.name, law) for axle, law in zip(axles, laws, strict=True)]
    bodies = tuple(Body(name=name, estimate=STILL) for name in ("frame", "body"))
    point = Point(name="P", body="body", position=tuple(map(float, n.vector(given["point"]))))
    motion = solve(Scene(mechanism=Mechanism(bodies, axles, tuple(drives)), times=(t,), points=(point,)))
    body = motion["body"]
    omega, alpha, s = body.omega[:, 0], body.alpha[:, 0], body.rotation[:, :, 0] @ np.array(point.position)
    path = motion.points["P"]
    by_formula = np.cross(omega, s), np.cross(alpha, s) + np.cross(omega, np.cross(omega, s))
    assert path.v is not None
    assert path.a is not None
    for formula, ours in zip(by_formula, (path.v[:, 0], path.a[:, 0]), strict=True):
        assert np.allclose(formula, ours, rtol=0.0, atol=1e-13)
    return {"velocity": list(map(float, by_formula[0])), "acceleration": list(map(float, by_formula[1]))}


def refkin_d24(n: Binary64, given: Given) -> Values:
    """Mobility 0, three pins between two links and the ground: the count, and what it is called."""
    counted = gruebler([tuple(joint) for joint in given["joints"]])
    return {"mobility": counted.mobility, "name": counted.kind}
