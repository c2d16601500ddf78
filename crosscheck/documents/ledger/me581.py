"""The rows C1 to C12: the scalar examples of the ME581 notes, their four-bar, numerical partial derivatives."""

from __future__ import annotations

import math
from typing import Any

import numpy as np

from crosscheck.documents import loops
from crosscheck.documents.convergence import both_largest, slope
from crosscheck.documents.ledger.arithmetic import ArbNumbers, Arithmetic, Binary64, History
from crosscheck.documents.ledger.me451 import Given, Values
from crosscheck.documents.systems import SquareSystem, me581
from crosscheck.engines import vector_loop
from refkin.differences import Scheme, jacobian
from refkin.newton import newton
from refkin.scenes.linkages import FourBar


def c1(n: Arithmetic, given: Given) -> Values:
    """Newton's iterates of x^2 - 4x + 1 from the row's estimate, with residual, slope, and their ratio."""
    steps = int(given["steps"])
    history = n.newton(me581.quadratic(), n.vector([given["start"]]), steps)
    return {
        "x": [q[0] for q in history.iterates],
        "f": [f[0] for f in history.residuals[:steps]],
        "f'": [s[0, 0] for s in history.slopes[:steps]],
        "f/f'": [-c[0] for c in history.corrections],
    }


c2 = c1


def c3(n: Arithmetic, given: Given) -> Values:
    """From 1; and at x rounded to four decimals, where the notes take their last line; x = 2 has no slope."""
    values = c1(n, given)
    system, rounded = me581.quadratic(), n.vector([given["rounded"]])
    f = system.phi(rounded)[0]
    values["f(.2679)"] = f
    values["f'(.2679)"] = system.phi_q(rounded)[0, 0]
    values["f/f'(.2679)"] = f / values["f'(.2679)"]
    values["f'(2)"] = system.phi_q(n.vector(["2"]))[0, 0]
    return values


def lengths(n: Arithmetic, given: Given) -> me581.FourBarLengths:
    """Return the row's lengths."""
    return me581.FourBarLengths(*(n(r) for r in given["r"]))


def four_bar(n: Arithmetic, given: Given) -> SquareSystem:
    """Return the notes' four-bar at the row's crank angle."""
    return me581.four_bar(lengths(n, given), n(given["theta2"]) * n.pi / 180)


def estimate(n: Arithmetic) -> Any:
    """Return theta3 = 0, theta4 = 90 degrees."""
    return np.array([n("0"), n.pi / 2])


def c4(n: Arithmetic, given: Given) -> Values:
    """Every column of the notes' table, and the limit."""
    system = four_bar(n, given)
    history: History = n.newton(system, estimate(n), 5)
    degree = n.pi / 180
    return {
        "q": [[x / degree for x in q] for q in history.iterates[:5]],
        "phi": [list(f) for f in history.residuals[:5]],
        "J": history.slopes[:4],
        "J^-1 phi in rad": [list(-c) for c in history.corrections[:4]],
        "J^-1 phi in degrees": [[-x / degree for x in c] for c in history.corrections[:4]],
        "limit": [x / degree for x in n.root(system, history.iterates[3])],
        "|phi| of iterate 5": [abs(x) for x in history.residuals[4]],
        "|phi| of iterate 6": [abs(x) for x in history.residuals[5]],
    }


def loops_c4(n: Binary64, given: Given) -> Values:
    """The limit with the loop as vectors."""
    r1, r2, r3, r4 = (float(r) for r in given["r"])
    system = loops.four_bar(r1, r2, r3, r4, math.radians(float(given["theta2"])))
    return {"limit": list(np.degrees(vector_loop.close(system, estimate(n)).q))}


def refkin_c4(n: Binary64, given: Given) -> Values:
    """The limit in absolute coordinates."""
    pose = _linkage(given).assemble(math.radians(float(given["theta2"])))
    return {"limit": [math.degrees(pose["coupler"][2]), math.degrees(pose["rocker"][2])]}


def _linkage(given: Given) -> FourBar:
    return FourBar(*(float(r) for r in given["r"]))


def c5(n: Arithmetic, given: Given) -> Values:
    """Determinant and transmission angle at the limit."""
    system = four_bar(n, given)
    q = n.root(system, n.vector(["0.23", "2"]))
    r3, r4 = n(given["r"][2]), n(given["r"][3])
    angle = q[1] - q[0]
    return {"det": n.det(system.phi_q(q)), "gamma": angle * 180 / n.pi, "-r3 r4 sin(gamma)": -r3 * r4 * np.sin(angle)}


def refkin_c5(n: Binary64, given: Given) -> Values:
    """The transmission angle of the linkage."""
    return {"gamma": math.degrees(_linkage(given).transmission_angle(math.radians(float(given["theta2"]))))}


def c6(n: Arithmetic, given: Given) -> Values:
    """With theta4 as the driver: the determinant is r2 r3 sin(theta3 - theta2)."""
    m, q = lengths(n, given), n.vector(given["q"])
    system = me581.four_bar_by_rocker(m, n("2"))
    return {"det": n.det(system.phi_q(q)), "r2 r3 sin(theta3 - theta2)": m.r2 * m.r3 * np.sin(q[1] - q[0])}


def c7(n: Arithmetic, given: Given) -> Values:
    """What the notes do not say: the class, the limits of theta2, the crossed assembly."""
    r1, r2, r3, r4 = (n(r) for r in given["r"])
    reach = r3 + r4
    cosine = (r1 * r1 + r2 * r2 - reach * reach) / (2 * r1 * r2)
    sine = np.sqrt(1 - cosine * cosine)
    crossed = n.root(four_bar(n, given), n.vector(["5.4", "3.6"]))
    return {
        "s + l": r1 + r2,
        "p + q": reach,
        "limit of theta2": n.angle(cosine, sine) * 180 / n.pi,
        "crossed": [x * 180 / n.pi for x in crossed],
    }


def refkin_c7(n: Binary64, given: Given) -> Values:
    """Class, range and crossed assembly of the linkage."""
    linkage = _linkage(given)
    pose = linkage.assemble(math.radians(float(given["theta2"])), "crossed")
    return {
        "class": linkage.grashof.name,
        "limit of theta2": math.degrees(linkage.input_range()[0][1]),
        "crossed": [math.degrees(pose[body][2]) % 360.0 for body in ("coupler", "rocker")],
    }


def c8(n: Arithmetic, given: Given) -> Values:
    """Numerical partial derivatives with the row's step, column by column, reset in between."""
    system, q, h = four_bar(n, given), estimate(n), n(given["step"])
    moved = [system.phi(np.array([q[0] + h, q[1]])), system.phi(np.array([q[0], q[1] + h]))]
    base, exact = system.phi(q), system.phi_q(q)
    columns = [(f - base) / h for f in moved]
    return {
        "phi": list(base),
        "phi moved": [list(f) for f in moved],
        "J": [[column[row] for column in columns] for row in (0, 1)],
        "error": [[columns[k][row] - exact[row][k] for k in (0, 1)] for row in (0, 1)],
    }


def refkin_c8(n: Binary64, given: Given) -> Values:
    """The same quotients by `refkin.differences.jacobian`."""
    system = four_bar(n, given)
    quotients = jacobian(system.phi, estimate(n), Scheme.FORWARD, float(given["step"]))
    return {"J": quotients.tolist(), "error": (quotients - system.phi_q(estimate(n))).tolist()}


def c9(n: Arithmetic, given: Given) -> Values:
    """test_jac.m takes a step of 0.01."""
    return {"error": c8(n, given)["error"]}


def refkin_c9(n: Binary64, given: Given) -> Values:
    """The same by `refkin.differences.jacobian`."""
    return {"error": refkin_c8(n, given)["error"]}


def c10(n: Arithmetic, given: Given) -> Values:
    """How the error of a difference quotient goes with its step."""
    if isinstance(n, ArbNumbers):
        return {}
    system, q = four_bar(n, given), n.vector(given["q"])
    exact = system.phi_q(q)
    steps = 10.0 ** -np.arange(1.0, 13.0)
    values: Values = {}
    for scheme in (Scheme.FORWARD, Scheme.CENTRAL):
        errors = [float(np.max(np.abs(jacobian(system.phi, q, scheme, h) - exact))) for h in steps]
        values[f"{scheme}: least error"] = min(errors)
        values[f"{scheme}: best step"] = float(steps[int(np.argmin(errors))])
        truncated = slope(steps[:4], errors[:4], floor=0.0)
        values[f"{scheme}: slope"] = truncated.value
    stepped = np.max(np.abs(jacobian(system.phi, q, Scheme.COMPLEX_STEP) - exact))
    values["complex step: error"] = float(stepped)
    return values


def c11(n: Arithmetic, given: Given) -> Values:
    """Steps 1 to 8: without the reset, the second column holds what the first coordinate was moved by as well."""
    values = c8(n, given)
    system, q, h = four_bar(n, given), estimate(n), n(given["step"])
    kept = (system.phi(np.array([q[0] + h, q[1] + h])) - system.phi(q)) / h
    return {"J": values["J"], "second column without the reset": list(kept)}


def refkin_c11(n: Binary64, given: Given) -> Values:
    """By `refkin.differences.jacobian`, which resets each coordinate."""
    return {"J": refkin_c8(n, given)["J"]}


def c12(n: Arithmetic, given: Given) -> Values:
    """Largest component of the residual and of the correction, both below their limits."""
    if isinstance(n, ArbNumbers):
        return {}
    limits = [float(x) for x in given["limits"]]
    result = newton(*four_bar(n, given), estimate(n), stop=both_largest(*limits))
    return {"iterations": result.iterations, "status": result.status.name}
