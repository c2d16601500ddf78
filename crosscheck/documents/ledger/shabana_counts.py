"""The rows D1, D2, D20 to D24 of the notes on Shabana: mobility, norms, rates, gears, structures."""

from __future__ import annotations

import numpy as np

from crosscheck.documents.convergence import ScaledNorms
from crosscheck.documents.ledger.arithmetic import Arithmetic, Binary64
from crosscheck.documents.ledger.me451 import Given, Values
from crosscheck.documents.ledger.shabana import numbers
from crosscheck.documents.ledger.shabana_four_bar import norm
from crosscheck.documents.ledger.shabana_slider_crank import theta3_at
from crosscheck.documents.systems.shabana import pose
from refkin.analysis import position
from refkin.joints import GROUND, AngleDriver, Gear, RackAndPinion, Revolute, YDriver
from refkin.model import Body, Mechanism
from refkin.motion_laws import Integral, Law, Polynomial, Sinusoid, Table
from refkin.scenes.linkages import SliderCrank
from refkin.solving.mobility import count, gruebler, mobility
from refkin.system import compile_system

RSSR = (
    ("revolute", GROUND, "input"),
    ("spherical", "input", "coupler"),
    ("spherical", "coupler", "output"),
    ("revolute", "output", GROUND),
)


def d1(n: Arithmetic, given: Given) -> Values:
    """Gruebler's count of the slider-crank: 3 * 4 - 11."""
    return {"coordinates": 3 * int(given["bodies"]), "equations": sum(int(rows) for rows in given["rows"])}


def refkin_d1(given: Given) -> Values:
    """Count and rank of the linkage."""
    n = Binary64()
    linkage = SliderCrank(crank=0.2, rod=0.35)
    whole = linkage.mechanism(linkage.driver(Polynomial(coefficients=(1.0,))))
    at = pose(0.2, 0.35, 1.0, theta3_at(n, 0.2, 0.35, 1.0)).astype(float)
    counted = count(whole)
    return {
        "coordinates": counted.coordinates * counted.bodies,
        "equations": counted.equations,
        "mobility by count": counted.mobility,
        "mobility by rank": mobility(whole, at[3:]).mobility,
    }


def d2(n: Arithmetic, given: Given) -> Values:
    """Gruebler's count of the RSSR: 6 * 4 - 22; the rank is open until there are spatial bodies."""
    return {"coordinates": 6 * int(given["bodies"]), "equations": sum(int(rows) for rows in given["rows"])}


def refkin_d2(given: Given) -> Values:
    """The count by kinds of joints, with the spin that moves nothing else."""
    counted = gruebler(RSSR, "spatial")
    return {
        "coordinates": counted.coordinates * counted.bodies,
        "equations": counted.equations,
        "mobility by count": counted.mobility,
        "without the idle spin": counted.useful,
    }


def d20(n: Arithmetic, given: Given) -> Values:
    """The norms of the printed vectors, divided by the number of equations."""
    return {name: norm(n, n.vector(given[name])) for name in ("C(q1)", "dq1")}


def refkin_d20(given: Given) -> Values:
    """`ScaledNorms` stops just above these norms, and not just below."""
    n = Binary64()
    residual, correction = n.vector(given["C(q1)"]), n.vector(given["dq1"])
    big = np.ones(3)
    return {
        "stops just above": [ScaledNorms(3.078e-4)(residual, big, big), ScaledNorms(1.2618e-3)(big, correction, big)],
        "stops just below": [ScaledNorms(3.076e-4)(residual, big, big), ScaledNorms(1.2616e-3)(big, correction, big)],
    }


def d21(n: Arithmetic, given: Given) -> Values:
    """theta_0 + the integral of a rate: polynomial, sinusoid, and the spline through a cubic, which is that cubic."""
    t, initial = n(given["t"]), n(given["initial"])
    a, w, p = numbers(n, given, "amplitude", "frequency", "phase")
    cubic = [n(c) for c in given["cubic"]]
    whole = sum((c * t ** (k + 1) / (k + 1) for k, c in enumerate(cubic)), initial)
    return {
        "polynomial": whole,
        "sinusoid": initial + a / w * (np.cos(p) - np.cos(w * t + p)),
        "spline": whole,
    }


def refkin_d21(given: Given) -> Values:
    """The laws that drivers follow."""
    n = Binary64()
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
    """A spur pair and a rack with its pinion: what rolling without sliding makes of an input angle."""
    a_i, a_j, turned, radius = numbers(n, given, "a_i", "a_j", "theta_i", "radius")
    return {"spur: theta_j": -a_i / a_j * turned, "rack: travel": radius * turned}


def refkin_d22(given: Given) -> Values:
    """The same with gear and rack as joints."""
    n = Binary64()
    a_i, a_j, turned, radius = numbers(n, given, "a_i", "a_j", "theta_i", "radius")
    origin = (0.0, 0.0)
    wheels = tuple(
        Revolute(name=f"axle {name}", body_i=GROUND, point_i=at, body_j=name, point_j=origin)
        for name, at in (("i", origin), ("j", (a_i + a_j, 0.0)))
    )
    drive = AngleDriver(name="input", body="i", law=Polynomial(coefficients=(turned,)))
    mesh = Gear(name="mesh", body_i="i", radius_i=a_i, body_j="j", radius_j=a_j)
    pair = compile_system(Mechanism((Body(name="i"), Body(name="j")), (*wheels, mesh), (drive,)))
    return {"spur: theta_j": position(pair, np.zeros(6), 0.0).q[5], "rack: travel": _rack(radius, turned)}


def _rack(radius: float, turned: float) -> float:
    """Return how far a pinion rolls along a rack on the ground, its centre at height -radius."""
    origin = (0.0, 0.0)
    rolling = RackAndPinion(
        name="rack",
        body_i=GROUND,
        point_i=origin,
        axis_i=(1.0, 0.0),
        body_j="pinion",
        point_j=origin,
        radius=radius,
    )
    still = Polynomial(coefficients=(-radius,))
    held = YDriver(name="height", body="pinion", law=still)
    drive = AngleDriver(name="input", body="pinion", law=Polynomial(coefficients=(turned,)))
    system = compile_system(Mechanism((Body(name="pinion"),), (rolling,), (held, drive)))
    return float(position(system, np.array([0.0, -radius, 0.0]), 0.0).q[0])


def d24(n: Arithmetic, given: Given) -> Values:
    """Mobility 0: three pins between two links and the ground; nothing but the count is to be computed."""
    return {}


def refkin_d24(given: Given) -> Values:
    """The count, and what it is called."""
    counted = gruebler([tuple(joint) for joint in given["joints"]])
    return {"mobility": counted.mobility, "name": counted.kind}
