"""The rows D1 to D9 of the notes on Shabana: mobility, closed forms, the Coriolis example, the two-link arm."""

from __future__ import annotations

import math
from typing import Any

import numpy as np

from crosscheck.documents import loops
from crosscheck.documents.ledger.arithmetic import Arithmetic, Binary64
from crosscheck.documents.ledger.me451 import Given, Values
from crosscheck.documents.systems import shabana
from crosscheck.engines import vector_loop
from refkin.analysis import acceleration, velocity
from refkin.joints import GROUND, AngleDriver, Constraint, Fixed, Revolute, XDriver
from refkin.model import Body, Mechanism
from refkin.motion import point_motion
from refkin.motion_laws import Polynomial
from refkin.scenes.linkages import ANYWHERE, FourBar, InvertedSliderCrank, SliderCrank
from refkin.system import System, compile_system


def numbers(n: Arithmetic, given: Given, *keys: str) -> list[Any]:
    """Return some of the row's numbers.

    Parameters
    ----------
    n : Arithmetic
    given : mapping
        The row's numbers, as text.
    *keys : str
        Which of them.
    """
    return [n(given[key]) for key in keys]


def _radians(n: Arithmetic, given: Given, *keys: str) -> list[Any]:
    """Return some of the row's angles, which stand there in degrees."""
    return [n(given[key]) * n.pi / 180 for key in keys]


def driven_at_0(linkage: Any, *coefficients: float) -> tuple[System, Any, Any, Any]:
    """Return the equations of a linkage whose crank follows c0 + c1 t + ..., and q, qd, qdd at t = 0."""
    mechanism = linkage.mechanism(linkage.driver(Polynomial(coefficients=coefficients)))
    system, pose = compile_system(mechanism), linkage.assemble(coefficients[0])
    q = np.concatenate([pose[body.name] for body in mechanism.bodies])
    qd = velocity(system, q, 0.0)
    return system, q, qd, acceleration(system, q, qd, 0.0)


def d3(n: Arithmetic, given: Given) -> Values:
    """At s + l = p + q the shortest link still turns fully: the law of Grashof is s + l <= p + q."""
    ground, crank, coupler, rocker = (n(x) for x in given["lengths"])
    return {"s + l": ground + crank, "p + q": coupler + rocker}


def refkin_d3(n: Binary64, given: Given) -> Values:
    """Class and range of a linkage at its change point."""
    linkage = FourBar(*(float(x) for x in given["lengths"]))
    farthest = linkage.closure_margin(math.pi)
    return {
        "class": linkage.grashof.name,
        "crank turns fully": linkage.input_range() == ANYWHERE,
        "margin with the crank at 180 degrees": farthest,
    }


def d4(n: Arithmetic, given: Given) -> Values:
    """Both assemblies of the offset slider-crank; what asin alone gives; the loop with its signs as first printed."""
    l2, l3, h = numbers(n, given, "l2", "l3", "h")
    (theta2,) = _radians(n, given, "theta2")
    links = shabana.CrankAndRod(l2, l3)
    sine, x = links.position(h, theta2, 1)
    _, x_minus = links.position(h, theta2, -1)
    theta3 = n.arcsin(sine)
    phi = links.system(h, theta2).phi
    along, across = phi(np.array([theta3, x]))
    return {
        "+: theta3, x": [theta3, x],
        "-: theta3, x": [n.pi - theta3, x_minus],
        "-: gap with theta3 = asin": phi(np.array([theta3, x_minus]))[0],
        "first version, residual": [along + 2 * x, across + 2 * h],
    }


def refkin_d4(n: Binary64, given: Given) -> Values:
    """Both assemblies of the linkage."""
    linkage = SliderCrank(*(float(given[key]) for key in ("l2", "l3", "h")))
    at = math.radians(float(given["theta2"]))
    poses = [linkage.assemble(at, branch) for branch in ("open", "crossed")]
    return {
        f"{sign}: theta3, x": [(pose["connecting_rod"][2] + 1.0) % math.tau - 1.0, pose["slider"][0]]
        for sign, pose in zip("+-", poses, strict=True)
    }


def d5(n: Arithmetic, given: Given) -> Values:
    """Velocity and acceleration of the slider-crank in closed form."""
    l2, l3, h, rate, second = numbers(n, given, "l2", "l3", "h", "theta2'", "theta2''")
    (theta2,) = _radians(n, given, "theta2")
    links = shabana.CrankAndRod(l2, l3)
    theta3 = n.arcsin(links.position(h, theta2, 1)[0])
    velocity_ = links.velocity(theta2, theta3, rate)
    return {"theta3', x'": velocity_, "theta3'', x''": links.acceleration(theta2, theta3, (rate, velocity_[0]), second)}


def _driven(n: Arithmetic, given: Given) -> Polynomial:
    """Return the law of a row's theta2: at t = 0 it has the angle, rate and acceleration that are given."""
    rate, second = numbers(n, given, "theta2'", "theta2''")
    return Polynomial(coefficients=(math.radians(float(given["theta2"])), rate, second / 2))


def loops_d5(n: Binary64, given: Given) -> Values:
    """The same rates from the differentiated loop."""
    l2, l3, h = numbers(n, given, "l2", "l3", "h")
    system = loops.slider_crank(l2, l3, h, _driven(n, given))
    q = vector_loop.close(system, [0.0, 0.4]).q
    qd = system.velocity(q, 0.0)
    return {"theta3', x'": qd, "theta3'', x''": system.acceleration(q, qd, 0.0)}


def refkin_d5(n: Binary64, given: Given) -> Values:
    """The same rates in absolute coordinates."""
    linkage = SliderCrank(*numbers(n, given, "l2", "l3", "h"))
    system, _, qd, qdd = driven_at_0(linkage, *_driven(n, given).coefficients)
    wanted = [system.columns("connecting_rod").start + 2, system.columns("slider").start]
    return {"theta3', x'": qd[wanted], "theta3'', x''": qdd[wanted]}


def d6(n: Arithmetic, given: Given) -> Values:
    """The determinant is l3 cos(theta3): at theta3 = 0 it is largest, at 90 degrees it vanishes."""
    l2, l3 = numbers(n, given, "l2", "l3")
    links = shabana.CrankAndRod(l2, l3)
    slopes = [links.system(n("0"), n("1")).phi_q(n.vector([angle, "1"])) for angle in ("0", "1")]
    values: Values = {"det at theta3 = 0": n.det(slopes[0]), "det at theta3 = 1 rad": n.det(slopes[1])}
    values["l3 cos(1 rad)"] = l3 * np.cos(n("1"))
    if isinstance(n, Binary64):  # where crank and rod lie on each other, upright
        free = loops.slider_crank(1.0, 1.0, 0.0, Polynomial(coefficients=(math.pi / 2, 1.0)))
        q = np.array([-math.pi / 2, 0.0])
        slope = np.column_stack([-free.nu(q, 0.0), free.jacobian(q, 0.0)])
        rank = int(np.linalg.matrix_rank(slope, tol=1e-12))
        values["rank of the loop in theta2, theta3, x for l2 = l3 at 90 degrees"] = rank
    return values


def d7(n: Arithmetic, given: Given) -> Values:
    """The Coriolis example: rates, accelerations, and both with the terms that are printed."""
    l1, l2, rate, second = numbers(n, given, "l1", "l2", "theta2'", "theta2''")
    (theta2,) = _radians(n, given, "theta2")
    example = shabana.CoriolisExample(l1, l2, theta2)
    q = n.root(example.system(), n.vector(given["estimate"]))
    qd = example.velocity(q, rate)
    matrix, right = example.right_side(q, qd, rate, second)
    as_printed = np.array([right[0], right[1] - 2 * second * l2 * np.cos(theta2)])
    term = qd[0] * qd[1]
    return {
        "theta3, x": q,
        "theta3', x'": qd,
        "theta3'', x''": n.solve(matrix, right),
        "theta3'', x'' with -theta2'' in row 2": n.solve(matrix, as_printed),
        "Coriolis acceleration": 2 * term,
        "with three terms": 3 * term,
        "acceleration of the block": l2 * (second * turned(theta2, 1) - rate * rate * turned(theta2, 0)),
    }


def turned(angle: Any, quarters: int) -> Any:
    """Return the unit vector at an angle, or that vector turned by a quarter turn."""
    c, s = np.cos(angle), np.sin(angle)
    return np.array([-s, c]) if quarters else np.array([c, s])


def loops_d7(n: Binary64, given: Given) -> Values:
    """The same rates from the differentiated loop."""
    l1, l2 = numbers(n, given, "l1", "l2")
    system = loops.inverted_slider_crank(l1, l2, _driven(n, given))
    q = vector_loop.close(system, n.vector(given["estimate"])).q
    qd = system.velocity(q, 0.0)
    return {"theta3, x": q, "theta3', x'": qd, "theta3'', x''": system.acceleration(q, qd, 0.0)}


def refkin_d7(n: Binary64, given: Given) -> Values:
    """The rod as a body that the crank's pin guides, and how the pin, where the block is, moves along it."""
    linkage = InvertedSliderCrank(*numbers(n, given, "l1", "l2"))
    system, *levels = driven_at_0(linkage, *_driven(n, given).coefficients)
    crank, rod = (system.columns(body) for body in ("crank", "lever"))
    block = point_motion((linkage.crank / 2, 0.0), *(level[crank] for level in levels))
    theta3, w3, alpha3 = (level[rod][2] for level in levels)
    along = turned(theta3, 0)
    x, v = (block.r - levels[0][rod][:2]) @ along, block.v @ along
    return {
        "theta3, x": [theta3, x],
        "theta3', x'": [w3, v],
        "theta3'', x''": [alpha3, block.a @ along + w3 * w3 * x],
        "Coriolis acceleration": 2 * w3 * v,
        "acceleration of the block": block.a,
    }


def d8(n: Arithmetic, given: Given) -> Values:
    """The driven two-link arm: velocities, accelerations, C_t with nine entries."""
    l2, l3, w2, w3 = numbers(n, given, "l2", "l3", "omega2", "omega3")
    theta2, theta3 = _radians(n, given, "theta2", "theta3")
    velocity_, acceleration_ = shabana.CrankAndRod(l2, l3).arm_rates(theta2, theta3, w2, w3)
    return {"R2', R3'": velocity_, "R2'', R3''": acceleration_, "C_t": [0, 0, 0, 0, 0, 0, 0, -w2, -w3]}


def refkin_d8(n: Binary64, given: Given) -> Values:
    """The same arm with bodies and joints, its link 1 a body that is fixed to the ground."""
    l2, l3, w2, w3 = numbers(n, given, "l2", "l3", "omega2", "omega3")
    theta2, theta3 = _radians(n, given, "theta2", "theta3")
    drivers = tuple(
        AngleDriver(name=f"theta{body}", body=body, rate_law=Polynomial(coefficients=(rate,)), initial=value)
        for body, value, rate in (("2", theta2, w2), ("3", theta3, w3))
    )
    system = compile_system(Mechanism(tuple(Body(name=name) for name in "123"), arm_joints(l2, l3), drivers))
    c2, c3 = (np.array([math.cos(a), math.sin(a)]) for a in (theta2, theta3))
    q = np.concatenate([[0.0] * 3, l2 / 2 * c2, [theta2], l2 * c2 + l3 / 2 * c3, [theta3]])
    qd = velocity(system, q, 0.0)
    rows = [3, 4, 6, 7]
    return {
        "R2', R3'": qd[rows],
        "R2'', R3''": acceleration(system, q, qd, 0.0)[rows],
        "C_t": -system.nu(q, 0.0),
        "joint rows": sum(joint.rows for joint in system.mechanism.joints),
    }


def arm_joints(l2: float, l3: float) -> tuple[Constraint, ...]:
    """Return the joints of a link 1 that is fixed to the ground and two links one after the other."""
    origin, ends = (0.0, 0.0), [(x, 0.0) for x in (-l2 / 2, l2 / 2, -l3 / 2)]
    return (
        Fixed(name="1-3", body_i=GROUND, point_i=origin, body_j="1", point_j=origin),
        Revolute(name="4-5", body_i="1", point_i=origin, body_j="2", point_j=ends[0]),
        Revolute(name="6-7", body_i="2", point_i=ends[1], body_j="3", point_j=ends[2]),
    )


def refkin_d9(n: Binary64, given: Given) -> Values:
    """Linear constraints of which one stands twice: determinant and rank with bodies and drivers."""
    still = Polynomial(coefficients=(0.0,))
    drivers = (
        AngleDriver(name="once", body="b", law=still),
        AngleDriver(name="again", body="b", law=still),
        XDriver(name="x", body="b", law=still),
    )
    slope = compile_system(Mechanism((Body(name="b"),), (), drivers)).phi_q(np.zeros(3), 0.0)
    values = {"det": float(np.linalg.det(slope)), "rank": int(np.linalg.matrix_rank(slope))}
    return {"constraints": len(drivers), **values}
