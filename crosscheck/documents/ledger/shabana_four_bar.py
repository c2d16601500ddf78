"""The rows D10 to D14: the four-bar of section 3.11 of the notes on Shabana, as it should be and as it is printed."""

from __future__ import annotations

import math
from typing import Any

import numpy as np

from crosscheck.documents.ledger.arithmetic import Arithmetic, Binary64
from crosscheck.documents.ledger.me451 import Given, Values
from crosscheck.documents.ledger.shabana import driven_at_0
from crosscheck.documents.systems import SquareSystem, shabana
from refkin.scenes.linkages import FourBar


def links(n: Arithmetic, given: Given) -> shabana.LoopOfFourBars:
    """Return the row's lengths."""
    return shabana.LoopOfFourBars(*(n(x) for x in given["l"]))


def four_bar(n: Arithmetic, given: Given) -> SquareSystem:
    """Return the loop with theta2 held."""
    return links(n, given).system(n(given["theta2"]) * (n.pi / 180))


def estimate(n: Arithmetic, given: Given) -> Any:
    """Return the notes' estimate: theta2, theta3, theta4 in degrees."""
    return np.array([n(x) * n.pi / 180 for x in given["estimate"]])


def norm(n: Arithmetic, vector: Any) -> Any:
    """Return the Euclidean norm divided by the number of components, as the notes have it."""
    return np.sqrt(sum(x * x for x in vector)) / len(vector)


def d10(n: Arithmetic, given: Given) -> Values:
    """Two Newton steps; and the first as it comes out of the matrices that are printed, with four digits."""
    history = n.newton(four_bar(n, given), estimate(n, given), 2)
    rows = [[n(x) for x in row] for row in given["printed C_q(q0)"]]
    right = [-n(x) for x in given["printed C(q0)"]]
    second = [[n(x) for x in row] for row in given["printed C_q(q1)"]]
    wrong, after = n.solve(rows, right)[1:], [n(x) for x in given["printed C(q1)"]]
    return {
        "q0": history.iterates[0],
        "C(q0)": history.residuals[0],
        "C_q(q0)": history.slopes[0][:2],
        "dq0": history.corrections[0],
        "q1": history.iterates[1],
        "C(q1)": history.residuals[1],
        "C_q(q1)": history.slopes[1][:2],
        "dq1": history.corrections[1],
        "|C(q1)| / 3": norm(n, history.residuals[1]),
        "|dq1| / 3": norm(n, history.corrections[1]),
        "dq0 from what is printed": wrong,
        "q1 from what is printed": [n("0.1745") + wrong[0], n("4.2761") + wrong[1]],
        "dq1 from what is printed": n.solve(second, [-x for x in after])[1:],
        "|C(q1)| / 3 from what is printed": norm(n, after),
        "C(q0) from rounded q0": links(n, given).system(n("1.0996")).phi(n.vector(["1.0996", "0.1745", "4.2761"])),
    }


def rates(n: Arithmetic, given: Given, q: Any) -> tuple[Any, Any, Any]:
    """Return qd, Q_d, qdd at q (3,) for the row's constant speed.

    Parameters
    ----------
    n, given, q
    """
    slope = four_bar(n, given).phi_q(q)
    qd = n.solve(slope, [n("0"), n("0"), n(given["omega"])])
    right = links(n, given).right_side(q, qd)
    return qd, right, n.solve(slope, right)


def d11(n: Arithmetic, given: Given) -> Values:
    """With theta_0 = 63 degrees the crank is at 63 degrees + omega t: another pose, and a third residual of -0.1."""
    start = estimate(n, given)
    turned = n(given["omega"]) * n(given["t"])
    system = links(n, given).system(start[0] + turned)
    q = n.root(system, start)
    qd, _, qdd = rates(n, given, q)
    return {
        "theta_0 for a third residual of 0": (start[0] - turned) * 180 / n.pi,
        "C3(q0)": system.phi(start)[2],
        "q": q,
        "qd": qd,
        "qdd": qdd,
    }


def d12(n: Arithmetic, given: Given) -> Values:
    """The converged pose and its rates, and the rates at the once-iterated pose."""
    system = four_bar(n, given)
    q = n.root(system, estimate(n, given))
    history = n.newton(system, estimate(n, given), 4)
    qd, right, qdd = rates(n, given, q)
    early = [rates(n, given, iterate) for iterate in history.iterates]
    return {
        "theta3, theta4": q[1:],
        "theta3, theta4 in degrees": [x * 180 / n.pi for x in q[1:]],
        "omega": qd,
        "Q_d": right,
        "alpha": qdd,
        "omega at q1": early[1][0],
        "Q_d at q1": early[1][1],
        "alpha at q1": early[1][2],
        "digits of q2, qd, qdd": _digits((history.iterates[2], *early[2][::2]), (q, qd, qdd)),
        "digits of q3, qd, qdd": _digits((history.iterates[3], *early[3][::2]), (q, qd, qdd)),
    }


def _digits(levels: Any, truth: Any) -> list[int]:
    """Return the whole numbers of correct digits of some vectors, each that of its worst component but the first."""
    pairs = (zip(x[1:], y[1:], strict=True) for x, y in zip(levels, truth, strict=True))
    return [math.floor(-math.log10(max(float(abs(a - b) / abs(b)) for a, b in pair))) for pair in pairs]


def refkin_d12(n: Binary64, given: Given) -> Values:
    """Pose and rates in absolute coordinates; the notes' rocker points the other way."""
    linkage = FourBar(*(float(x) for x in given["l"]))
    at, omega = math.radians(float(given["theta2"])), float(given["omega"])
    _, q, qd, qdd = driven_at_0(linkage, at, omega)
    angles = [2, 5, 8]
    return {"theta3, theta4": [q[5], q[8] % math.tau + n.pi], "omega": qd[angles], "alpha": qdd[angles]}


def d13(n: Arithmetic, given: Given) -> Values:
    """C_q qdd = +Q_d: with the minus that is printed the accelerations change their sign."""
    system = four_bar(n, given)
    q = n.root(system, estimate(n, given))
    _, right, qdd = rates(n, given, q)
    slope = system.phi_q(q)
    return {
        "alpha": qdd[1:],
        "alpha from C_q qdd = -Q_d": n.solve(slope, -right)[1:],
        "qd from C_q qd = -C": n.solve(slope, -system.phi(q))[1:],
        "qd from C_q qd = -C_t": rates(n, given, q)[0][1:],
    }


def d14(n: Arithmetic, given: Given) -> Values:
    """The other assembly, and the class."""
    system = four_bar(n, given)
    q = n.root(system, np.array([n(x) * n.pi / 180 for x in given["near"]]))
    l1, l2, l3, l4 = links(n, given)
    return {"theta3, theta4 in degrees": [x * 180 / n.pi for x in q[1:]], "s + l": l2 + l1, "p + q": l3 + l4}


def refkin_d14(n: Binary64, given: Given) -> Values:
    """The other assembly of the linkage; the notes' rocker points the other way."""
    linkage = FourBar(*(float(x) for x in given["l"]))
    pose = linkage.assemble(math.radians(float(given["theta2"])), "crossed")
    angles = [math.degrees(pose["coupler"][2]) % 360.0, (math.degrees(pose["rocker"][2]) + 180.0) % 360.0]
    return {"theta3, theta4 in degrees": angles, "class": linkage.grashof.name}
