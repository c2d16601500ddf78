"""The rows B1 to B7: Newton's method for loop closure equations, the coupled example, the rapier drive."""

from __future__ import annotations

import math
from itertools import product
from typing import Any

import numpy as np

from crosscheck.documents import loops
from crosscheck.documents.convergence import residual_or_correction
from crosscheck.documents.ledger.arithmetic import ArbNumbers, Arithmetic, Binary64, NoRoot
from crosscheck.documents.ledger.me451 import Given, Values
from crosscheck.documents.systems import SquareSystem, me581, metu
from crosscheck.engines import vector_loop
from refkin.differences import Scheme, jacobian
from refkin.motion_laws import Polynomial
from refkin.newton import NewtonResult, newton
from refkin.scenes.linkages import FourBar
from refkin.solving.solve import solve


def b1(n: Arithmetic, given: Given) -> Values:
    """The four sketches of how Newton's method goes, and the stopping test that is printed without absolute values."""
    if isinstance(n, ArbNumbers):
        return {}
    sketches: dict[str, tuple[Any, Any, float]] = {
        "a": (lambda x: x * x - 2, lambda x: 2 * x, 1.0),
        "b": (np.arctan, lambda x: 1 / (1 + x * x), 1.5),
        "c": (lambda x: x**3 - x, lambda x: 3 * x * x - 1, 0.46),
        "d": (lambda x: x * x - 2, lambda x: 2 * x, 0.0),
    }
    runs = {key: newton(f, slope, start) for key, (f, slope, start) in sketches.items()}
    cubic = [newton(*sketches["c"][:2], start).q[0] for start in (0.4, 0.46, 0.6)]
    test = residual_or_correction(1e-8, 1e-8)
    quadratic = me581.quadratic()
    # The test as printed, F < 1e-8 or x(k+1) - x(k) < 1e-8: any negative number stops.
    stopped = newton(*quadratic, 2.5, stop=lambda f, dx, x: bool(f[0] < 1e-8 or dx[0] < 1e-8))
    return {
        "status": [runs[key].status.name for key in "abcd"],
        "(c): roots from 0.4, 0.46, 0.6": [round(float(x)) for x in cubic],
        "x^2 - 4x + 1 from 2.5: iterations": newton(*quadratic, 2.5, stop=test).iterations,
        "the same with the printed test": stopped.iterations,
        "x where the printed test stops": stopped.q[0],
    }


# What section 3.9 prints wrong, as it is printed: for nothing but to show that it is wrong.


def with_printed_jacobian(m: metu.Slotted) -> SquareSystem:
    """Return the coupled example with its Jacobian as printed: entries (3,2) and (3,4) have the wrong sign."""
    right = metu.slotted(m)

    def phi_q(q: Any) -> Any:
        out = right.phi_q(q)
        out[2, 1], out[2, 3] = -out[2, 1], -out[2, 3]
        return out

    return SquareSystem(right.phi, phi_q)


def with_printed_residual(m: metu.Slotted) -> SquareSystem:
    """Return the coupled example with its right side as printed: the first two rows have theta14 for theta15."""
    right = metu.slotted(m)

    def phi(q: Any) -> Any:
        out = right.phi(q)
        out[0] = out[0] + m.a5 * (np.cos(q[0]) - np.cos(q[1]))
        out[1] = out[1] + m.a5 * (np.sin(q[0]) - np.sin(q[1]))
        return out

    return SquareSystem(phi, right.phi_q)


def coupled(n: Arithmetic, given: Given) -> tuple[metu.Slotted, Any, Any]:
    """Return the coupled example on the row's geometry, the pose for which it was made, and an estimate."""
    degree = n.pi / 180
    angles = [n(given[key]) * degree for key in ("theta12", "theta14", "theta15")]
    a2, a4, a5, s4 = (n(given[key]) for key in ("a2", "a4", "a5", "s4"))
    theta12, theta14, theta15 = angles
    m, pose = metu.slotted_that_closes(a2, a4, a5, theta12, theta14, theta15, s4)
    return m, pose, pose + n.vector(given["estimate is off by"])


def b2(n: Arithmetic, given: Given) -> Values:
    """The coupled example: Newton with the right equations, and with the Jacobian and the right side as printed."""
    m, pose, start = coupled(n, given)
    system = metu.slotted(m)
    wrong = {"printed Jacobian": with_printed_jacobian(m), "printed right side": with_printed_residual(m)}
    values: Values = {
        "error": [_largest(q - pose) for q in n.newton(system, start, 4).iterates],
        "b1, c1, a1": [m.b1, m.c1, m.a1],
    }
    values["error in complex form"] = values["error"]
    for name, other in wrong.items():
        values[f"error with the {name}"] = [_largest(q - pose) for q in n.newton(other, start, 4).iterates]
    if isinstance(n, Binary64):
        exact = jacobian(system.phi, start, Scheme.COMPLEX_STEP)
        off = np.abs(exact - wrong["printed Jacobian"].phi_q(start))
        values["largest |J - printed J|"] = float(np.max(off))
        values["wrong entries of the printed J"] = [[int(i) + 1, int(j) + 1] for i, j in np.argwhere(off > 1e-9)]
        values["largest |J - right J|"] = float(np.max(np.abs(exact - system.phi_q(start))))
    return values


def loops_b2(n: Binary64, given: Given) -> Values:
    """The same iteration with the loops as vectors, in real and in complex form."""
    m, pose, start = coupled(n, given)
    system = loops.slotted(m, m.theta12)
    runs = [vector_loop.close(system, start, complex_form=form) for form in (False, True)]
    errors = [[float(np.max(np.abs(q - pose))) for q in r.iterates[:5]] for r in runs]
    return {"error": errors[0], "error in complex form": errors[1]}


def b3(n: Arithmetic, given: Given) -> Values:
    """The update: unknowns and their names, and the sign of E in A delta = E."""
    m, pose, start = coupled(n, given)
    system = metu.slotted(m)
    step = n.solve(system.phi_q(start), system.phi(start))
    values: Values = {"error before": _largest(start - pose)}
    values["error after delta = -A^-1 F"] = _largest(start - step - pose)
    values["error after delta = +A^-1 F"] = _largest(start + step - pose)
    values["unknowns"] = list(loops.slotted(metu.Slotted(*[1.0] * 7), 0.0).unknowns)
    return values


READINGS = list(product((-1, 1), (-1, 1), (-1, 1), (-1, 1)))
"""Signs of x and y of C0, the side of C on which D lies, the side of the guide."""


Signs = tuple[int, int, int, int]


def _lengths(n: Arithmetic, given: Given, reading: Signs) -> metu.Rapier:
    """Return the rapier drive for signs of x0 and y0 of C0, of D's side of C, and of the guide's."""
    x, y, side, up = reading
    a = {key: n(given[key]) for key in ("a1", "a2", "a3", "a4", "a5", "a6", "b1", "b4", "d1")}
    x0 = a["d1"] * x
    # s16 is counted from C0 in reading R1, from A0 in R2; a root's angles do not depend on it.
    counted_from = x0 if side < 0 else a["d1"] * 0
    links = (a[f"a{k}"] for k in (2, 3, 4, 5, 6))
    return metu.Rapier(x0, a["a1"] * y, a["b1"] * up, a["a4"] + a["b4"] * side, counted_from, *links)


R1, R2 = (-1, -1, -1, -1), (-1, -1, 1, 1)


def guess(n: Arithmetic, given: Given) -> Any:
    """Return the document's guess of theta13, theta14, theta15, s16."""
    degree = n.pi / 180
    return np.array([*(n(x) * degree for x in given["guess"][:3]), n(given["guess"][3])])


def b5(n: Arithmetic, given: Given) -> Values:
    """The rapier drive at theta12 = 60 degrees, in both readings of its lost figure."""
    degree = n.pi / 180
    values: Values = {}
    for name, reading in (("R1", R1), ("R2", R2)):
        q = n.root(metu.rapier(_lengths(n, given, reading), n(given["theta12"]) * degree), guess(n, given))
        values[name] = [*(angle / degree for angle in q[:3]), q[3]]
    near = n.vector([*given["R2 stops near"], "1", "1", "-0.5", "-500"])
    values["R2: the crank stops at"] = n.root(metu.rapier_fold(_lengths(n, given, R2)), near)[4] / degree
    return values


def loops_b5(n: Binary64, given: Given) -> Values:
    """The same with the loops as vectors, and over the whole cycle."""
    start, at = guess(n, given), math.radians(float(given["theta12"]))
    values: Values = {}
    drives = {name: _lengths(n, given, reading) for name, reading in (("R1", R1), ("R2", R2))}
    for name, drive in drives.items():
        result = vector_loop.close(loops.rapier(drive, at), start)
        values[name] = [*np.degrees(result.q[:3]), result.q[3]]
        values[f"{name}: iterations"] = result.iterations
    turn = Polynomial(coefficients=(at, 1.0))
    times = np.linspace(0.0, math.tau, 721).tolist()
    whole = vector_loop.march(loops.rapier(drives["R1"], turn), times, start)
    values["R1: times reached of a turn"] = whole.reached
    values["R1: stroke"] = float(np.ptp(whole.q[3]))
    quarters = np.linspace(0.0, math.tau, 1441).tolist()
    part = vector_loop.march(loops.rapier(drives["R2"], turn), quarters, start)
    values["R2: last theta12 reached"] = math.degrees(at + quarters[part.reached - 1])
    return values


def b4(n: Arithmetic, given: Given) -> Values:
    """The guidance: fewer than ten iterations, steps below ten degrees, the previous pose as the guess; and too far."""
    if isinstance(n, ArbNumbers):
        return {}
    fine, coarse = (_cycle(given, int(step)) for step in (given["step"], given["coarse step"]))
    return {
        "most iterations in small steps": max(r.iterations for r in fine),
        "most iterations in large steps": max(r.iterations for r in coarse),
        "assembly at the end": [_assembly(cycle[-1].q) for cycle in (fine, coarse)],
    }


def _cycle(given: Given, step: int) -> list[NewtonResult]:
    """Return a four-bar over a turn in steps of so many degrees, each pose the guess of the next."""
    lengths = me581.FourBarLengths(*(float(r) for r in given["r"]))
    q, results = np.array([float(x) for x in given["estimate"]]), []
    for degrees in range(0, 361, step):
        results.append(newton(*me581.four_bar(lengths, math.radians(degrees)), q, max_iterations=200))
        q = results[-1].q
    return results


def _assembly(q: Any) -> str:
    """Return the assembly by the side of the coupler on which the rocker lies."""
    return "open" if math.sin(q[1] - q[0]) > 0 else "crossed"


def refkin_b4(n: Binary64, given: Given) -> Values:
    """A sweep over the same coarse times changes its step, and not the assembly."""
    linkage = FourBar(*(float(r) for r in given["r"]))
    samples = 360 // int(given["coarse step"]) + 1
    motion = solve(linkage.scene(speed=1.0, samples=samples))
    end = [motion[body].phi[-1] for body in ("coupler", "rocker")]
    return {"sweep in coarse steps": [motion.verdict.value, _assembly(end)]}


def _largest(x: Any) -> Any:
    return max(abs(v) for v in x)


def scan_b5(n: Binary64, given: Given) -> Values:
    """Of all readings of the lost figure: those within 45 degrees of the guess, and of them those that turn fully."""
    near, turning = [], []
    start, at = guess(n, given), float(given["theta12"])
    for reading in READINGS:
        try:
            q = n.root(metu.rapier(_lengths(n, given, reading), math.radians(at)), start)
        except NoRoot:
            continue
        if np.max(np.abs(q[:3] - start[:3])) < math.radians(45.0):
            near.append(reading)
            turning += [reading] * _turns(n, given, reading, q)
    return {
        "readings": len(READINGS),
        "near the guess": [list(reading) for reading in near],
        "near, and turns fully": [list(reading) for reading in turning],
    }


def _turns(n: Binary64, given: Given, reading: Signs, q: Any) -> bool:
    """Return whether the drive follows its crank over a turn, in half degrees, without leaps."""
    for k in range(1, 721):
        result = newton(*metu.rapier(_lengths(n, given, reading), math.radians(float(given["theta12"]) + k / 2)), q)
        if not result.converged or np.max(np.abs(result.q[:3] - q[:3])) > 0.3:
            return False
        q = result.q
    return True


def b6(n: Arithmetic, given: Given) -> Values:
    """The three ways to end: a root, a new estimate where the slope vanishes, no solution after m steps."""
    if isinstance(n, ArbNumbers):
        return {}
    test = residual_or_correction(1e-9, 1e-9)
    quadratic = me581.quadratic()
    runs = vector_loop.with_new_estimates(*quadratic, [2.0, 5.0], stop=test)
    none = newton(lambda x: x * x + 4, lambda x: 2 * x, 5.0, stop=test, max_iterations=25)
    return {
        "status": [newton(*quadratic, 5.0, stop=test).status.name, runs[0].status.name, none.status.name],
        "root from the new estimate": runs[-1].q[0],
        "estimates used": len(runs),
        "steps without a solution": none.iterations,
    }


def b7(n: Arithmetic, given: Given) -> Values:
    """Least squares from the guess of B5: the same root; at a crank angle that reading R2 cannot reach, a minimum."""
    degree = n.pi / 180
    q = n.root(metu.rapier(_lengths(n, given, R1), n(given["theta12"]) * degree), guess(n, given))
    values: Values = {"R1": [*(angle / degree for angle in q[:3]), q[3]]}
    if isinstance(n, Binary64):
        beyond = math.radians(float(given["beyond the limit of R2"]))
        stalled = vector_loop.minimise(loops.rapier(_lengths(n, given, R2), beyond), guess(n, given))
        values["beyond the limit: status"] = stalled.status.name
        values["beyond the limit: gap in mm"] = stalled.gap
    return values


def loops_b7(n: Binary64, given: Given) -> Values:
    """The same root by minimising the sum of squared closure errors of the loops as vectors."""
    system = loops.rapier(_lengths(n, given, R1), math.radians(float(given["theta12"])))
    minimum = vector_loop.minimise(system, guess(n, given))
    return {"R1": [*np.degrees(minimum.q[:3]), minimum.q[3]], "status": minimum.status.name}
