"""The rows D15 to D19: the slider-crank of section 3.12 of the notes on Shabana, in twelve coordinates."""

from __future__ import annotations

import math

import numpy as np

from crosscheck.documents.ledger.arithmetic import ArbNumbers, Arithmetic, Binary64
from crosscheck.documents.ledger.me451 import Given, Values
from crosscheck.documents.ledger.shabana import arm_joints, numbers
from crosscheck.documents.systems.shabana import SLIDER_DRIVEN, CrankAndRod
from refkin.analysis import acceleration, velocity
from refkin.joints import AngleDriver, Prismatic, Revolute, XDriver
from refkin.model import Body, Mechanism
from refkin.motion_laws import Polynomial, Sinusoid
from refkin.newton import CorrectionNorm, newton
from refkin.scenes.linkages import SliderCrank
from refkin.solving.solve import solve
from refkin.system import compile_system


def _mechanism(l2: float, l3: float, law: Polynomial | Sinusoid, slider_driven: bool = False) -> Mechanism:
    """Return the slider-crank of four bodies, link 1 fixed to the ground; theta2 or R4x follows the law."""
    joints = (
        *arm_joints(l2, l3),
        Revolute(name="8-9", body_i="3", point_i=(l3 / 2, 0.0), body_j="4", point_j=(0.0, 0.0)),
        Prismatic(name="10-11", body_i="1", point_i=(0.0, 0.0), axis_i=(1.0, 0.0), body_j="4", point_j=(0.0, 0.0)),
    )
    driver = XDriver(name="12", body="4", law=law) if slider_driven else AngleDriver(name="12", body="2", law=law)
    return Mechanism(tuple(Body(name=name) for name in "1234"), joints, (driver,))


def d15(n: Arithmetic, given: Given) -> Values:
    """Rates at crank angles of 0, 1 and pi: closed form, and the system of twelve equations."""
    l2, l3, omega = numbers(n, given, "l2", "l3", "omega")
    links, values = CrankAndRod(l2, l3), Values()
    for name, theta2 in (("0", n("0")), ("1", n("1")), ("pi", n.pi * 1)):
        sine, x = links.position(n("0"), theta2, 1)
        theta3 = n.arcsin(sine)
        w3, xd = links.velocity(theta2, theta3, omega)
        second = links.acceleration(theta2, theta3, (omega, w3), n("0"))
        values[f"x, theta3 at {name}"] = [x, theta3]
        values[f"x', theta3' at {name}"] = [xd, w3]
        values[f"x'', theta3'' at {name}"] = [second[1], second[0]]
    system = links.twelve_coordinates(n("1"))
    q = links.pose(n("1"), links.theta3(n, n("1")))
    values["|det C_q| at 1"] = abs(n.det(system.phi_q(q)))
    values["l3 cos(theta3) at 1"] = l3 * np.cos(links.theta3(n, n("1")))
    zero = n("0")
    qd = n.solve(system.phi_q(q), [zero] * 11 + [omega])
    qdd = n.solve(system.phi_q(q), links.right_side(q, qd, zero))
    values["twelve equations: x', theta3' at 1"] = [qd[9], qd[8]]
    values["twelve equations: x'', theta3'' at 1"] = [qdd[9], qdd[8]]
    return values


def refkin_d15(n: Binary64, given: Given) -> Values:
    """The same rates with four bodies."""
    l2, l3, omega = numbers(n, given, "l2", "l3", "omega")
    links, values = CrankAndRod(l2, l3), Values()
    for name, theta2 in (("0", 0.0), ("1", 1.0), ("pi", math.pi)):
        system = compile_system(_mechanism(l2, l3, Polynomial(coefficients=(theta2, omega))))
        q = links.pose(theta2, links.theta3(n, theta2)).astype(float)
        qd = velocity(system, q, 0.0)
        qdd = acceleration(system, q, qd, 0.0)
        values[f"x', theta3' at {name}"] = qd[[9, 8]]
        values[f"x'', theta3'' at {name}"] = qdd[[9, 8]]
    return values


def d16(n: Arithmetic, given: Given) -> Values:
    """The slider driven by f(t) = 0.35 - 0.8 l2 sin(150 t): its start, its determinant, its C_t."""
    l2, l3, omega = numbers(n, given, "l2", "l3", "omega")
    x = n(given["offset"])
    speed = -n(given["share"]) * l2 * omega
    # The triangle of crank, rod and guide: theta2 by the law of cosines.
    cosine = (l2 * l2 + x * x - l3 * l3) / (2 * l2 * x)
    theta2 = n.angle(cosine, np.sqrt(1 - cosine * cosine))
    links = CrankAndRod(l2, l3)
    theta3 = links.theta3(n, theta2)
    slope = links.twelve_coordinates(x, SLIDER_DRIVEN).phi_q(links.pose(theta2, theta3))
    rates = n.solve(slope, [n("0")] * 11 + [speed])
    return {
        "x between": [x - n(given["share"]) * l2, x + n(given["share"]) * l2],
        "dead centres": [l3 - l2, l3 + l2],
        "theta2 at the start in degrees": theta2 * 180 / n.pi,
        "theta2' at the start": rates[5],
        "|det C_q|": abs(n.det(slope)),
        "|l2 l3 sin(theta3 - theta2)|": abs(l2 * l3 * np.sin(theta3 - theta2)),
        "C_t": [n("0")] * 11 + [-speed],
    }


def refkin_d16(n: Binary64, given: Given) -> Values:
    """The same start with four bodies."""
    l2, l3, omega = numbers(n, given, "l2", "l3", "omega")
    law = Sinusoid(offset=n(given["offset"]), amplitude=-n(given["share"]) * l2, angular_frequency=omega)
    system = compile_system(_mechanism(l2, l3, law, slider_driven=True))
    linkage = SliderCrank(crank=l2, rod=l3)
    start = linkage.assemble(float(law(0.0)), driven="slider")
    theta2 = start["crank"][2]
    q = CrankAndRod(l2, l3).pose(theta2, start["connecting_rod"][2]).astype(float)
    return {
        "theta2 at the start in degrees": math.degrees(theta2),
        "theta2' at the start": velocity(system, q, 0.0)[5],
        "C_t": -system.nu(q, 0.0),
    }


def d17(n: Arithmetic, given: Given) -> Values:
    """At theta2 = theta3 = 0 the slider's system is singular, the crank's is not: the same pose, another actuator."""
    l2, l3 = numbers(n, given, "l2", "l3")
    links = CrankAndRod(l2, l3)
    q = links.pose(n("0"), n("0"))
    slider = links.twelve_coordinates(l2 + l3, SLIDER_DRIVEN).phi_q(q)
    crank = links.twelve_coordinates(n("0")).phi_q(q)
    relation = [a + b + c - d for a, b, c, d in zip(slider[5], slider[7], slider[11], slider[3], strict=True)]
    values: Values = {
        "largest of rows 6 + 8 + 12 - 4": max(abs(x) for x in relation),
        "|det| with the crank driven": abs(n.det(crank)),
    }
    if isinstance(n, ArbNumbers):  # the minor that leaves out row 4 and the column of theta2
        keep_rows, keep_columns = [k for k in range(12) if k != 3], [k for k in range(12) if k != 5]
        minor = n.det(slider[np.ix_(keep_rows, keep_columns)])
        values["rank with the slider driven"] = 11 if minor != 0 else 0
        values["rank with the crank driven"] = 12 if n.det(crank) != 0 else 0
        return values
    values["rank with the slider driven"] = int(np.linalg.matrix_rank(slider.astype(float)))
    values["rank with the crank driven"] = int(np.linalg.matrix_rank(crank.astype(float)))
    values["smallest singular value with the slider driven"] = float(np.linalg.svd(slider.astype(float))[1][-1])
    values["condition with the crank driven"] = float(np.linalg.cond(crank.astype(float)))
    return values


def refkin_d17(n: Binary64, given: Given) -> Values:
    """The same ranks with four bodies."""
    l2, l3 = numbers(n, given, "l2", "l3")
    q = CrankAndRod(l2, l3).pose(0.0, 0.0).astype(float)
    slopes = [
        compile_system(_mechanism(l2, l3, Polynomial(coefficients=(value,)), slider_driven=slider)).phi_q(q, 0.0)
        for value, slider in ((l2 + l3, True), (0.0, False))
    ]
    return {
        "rank with the slider driven": int(np.linalg.matrix_rank(slopes[0])),
        "rank with the crank driven": int(np.linalg.matrix_rank(slopes[1])),
    }


def d18(n: Arithmetic, given: Given) -> Values:
    """Newton on the way to that pose: x = l2 + l3 - e."""
    if isinstance(n, ArbNumbers):
        return {}
    l2, l3 = numbers(n, given, "l2", "l3")
    links = CrankAndRod(l2, l3)
    start = links.pose(*(n(x) for x in given["estimate"])).astype(float)
    results = []
    for e in given["e"]:
        system = links.twelve_coordinates(l2 + l3 - n(e), SLIDER_DRIVEN)
        results.append(newton(*system, start, stop=CorrectionNorm(n(given["tolerance"])), max_iterations=200))
    return {
        "iterations at e = 1e-2, 1e-4, 1e-6": [r.iterations for r in results[:3]],
        "iterations below": [r.iterations for r in results[3:]],
        "error of theta2 at e = 0": abs(float(results[-1].q[5])),
        "residual at e = 0": results[-1].residual,
    }


def d19(n: Arithmetic, given: Given) -> Values:
    """What the curves of figures 3.36 to 3.39 reach over a turn of the crank."""
    l2, l3, omega = numbers(n, given, "l2", "l3", "omega")
    links, zero = CrankAndRod(l2, l3), n("0")
    steepest = n.arcsin(l2 / l3)
    turned = [links.velocity(theta2, zero, omega)[0] for theta2 in (zero, n.pi * 1)]
    ends = []
    for theta2, w3 in zip((zero, n.pi * 1), turned, strict=True):
        ends.append(links.acceleration(theta2, zero, (omega, w3), zero)[1])
    return {
        "theta3 (3.36)": [-steepest, steepest],
        "x (3.37)": [l3 - l2, l3 + l2],
        "theta3' (3.38a)": turned,
        "x'' at the dead centres (3.39b)": ends,
    }


def refkin_d19(n: Binary64, given: Given) -> Values:
    """The curves themselves, over a turn."""
    l2, l3, omega = numbers(n, given, "l2", "l3", "omega")
    motion = solve(SliderCrank(crank=l2, rod=l3).scene(speed=omega, samples=721))
    rod, slider = motion["connecting_rod"], motion["slider"]
    return {
        "theta3 (3.36)": [np.min(rod.phi), np.max(rod.phi)],
        "x (3.37)": [np.min(slider.x), np.max(slider.x)],
        "theta3' (3.38a)": [np.min(rod.phid), np.max(rod.phid)],
        "x'' at the dead centres (3.39b)": [slider.xdd[0], slider.xdd[360]],
        "largest |x'| (3.38b)": np.max(np.abs(slider.xd)),
        "largest |theta3''| (3.39a)": np.max(np.abs(rod.phidd)),
        "verdict": motion.verdict.value,
    }
