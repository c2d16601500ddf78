"""The rows A1 to A14: the ME451 slides, their iterations, position analyses, code variants and claims."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import numpy as np
from flint import arb

from crosscheck.documents.convergence import linear_rate, newton_order
from crosscheck.documents.ledger.arithmetic import ArbNumbers, Arithmetic, Binary64, count_roots, excludes_zero, never
from crosscheck.documents.systems import SquareSystem, me451, scalar
from refkin.analysis import acceleration, position, velocity
from refkin.newton import CorrectionNorm, newton
from refkin.system import compile_system

Given = Mapping[str, Any]
Values = dict[str, Any]


def a1(n: Arithmetic, given: Given) -> Values:
    """sqrt(x) - sin(x): no root but 0, where the slope is unbounded; Newton leaves x > 0."""
    phi, phi_q = me451.root_minus_sine()
    values: Values = {"slope near 0": phi_q(n.vector([given["near"]]))[0, 0]}
    low, high = given["no root between"]
    if isinstance(n, ArbNumbers):
        values["no root between"] = excludes_zero(lambda x: phi([x])[0], float(low), float(high))
    else:
        scanned = np.linspace(float(low), float(high), 4001)
        runs = [newton(phi, phi_q, float(x), max_iterations=30) for x in given["starts"]]
        values["no root between"] = bool(np.min(phi([scanned])) > 0.0)
        values["steps until x < 0"] = [int(np.argmax(r.iterates[:, 0] < 0.0)) for r in runs]
        values["status"] = [r.status.name for r in runs]
    return values


def a2(n: Arithmetic, given: Given) -> Values:
    """Roots of 3x + sin(xy) - 4, x - e^(cos y)."""
    system = me451.sine_and_exponential()
    return {"roots": [n.root(system, n.vector(start)) for start in given["starts"]]}


def a3(n: Arithmetic, given: Given) -> Values:
    """Newton's iterates of x^2 + sin(x) - 1.841471, and its two roots."""
    system = me451.square_and_sine(n(given["constant"]))
    history = n.newton(system, n.vector([given["start"]]), 4)
    near = n.vector([given["truncated"]])
    root = n.root(system, n.vector(["1"]))[0]
    x1 = history.iterates[1][0]
    return {
        "x": [q[0] for q in history.iterates],
        "f": [f[0] for f in history.residuals],
        "f'": [slope[0, 0] for slope in history.slopes],
        "root": root,
        "root - 1": root - 1,
        "second root": n.root(system, n.vector(["-1.7"]))[0],
        "f(1.0042)": system.phi(near)[0],
        "f'(1.0042)": system.phi_q(near)[0, 0],
        "x2 with f'(x1) = 2.7109": x1 - history.residuals[1][0] / n("2.7109"),
    }


def a4(n: Arithmetic, given: Given) -> Values:
    """The pair x - e^y = 0, ln(1 + x) - cos y = 0; and with x - e^y = 1 as printed."""
    system, printed = me451.exponential_and_logarithm(), me451.exponential_and_logarithm(1)
    start = n.vector(given["start"])
    # On the first equation as printed, x = 1 + e^y, the second is ln(2 + e^y) - cos y: its least value is the gap.
    lowest = n.root(
        scalar(
            lambda y: np.exp(y) / (2 + np.exp(y)) + np.sin(y),
            lambda y: 2 * np.exp(y) / (2 + np.exp(y)) ** 2 + np.cos(y),
        ),
        n.vector(["-0.3"]),
    )[0]
    values: Values = {
        "iterate": n.newton(system, start, 5).iterates,
        "root": n.root(system, start),
        "printed: least gap": np.log(2 + np.exp(lowest)) - np.cos(lowest),
        "printed: gap at y": lowest,
        "printed: roots": [n.root(printed, n.vector(near)) for near in given["printed roots near"]],
    }
    low, high = given["printed: no root for y between"]
    if isinstance(n, ArbNumbers):
        values["printed: no root for y between"] = excludes_zero(
            lambda y: np.log(2 + np.exp(y)) - np.cos(y), float(low), float(high)
        )
    else:
        result = newton(*printed, start, max_iterations=40)
        values["printed: status"] = result.status.name
        values["printed: x <= -1 at iterate"] = int(np.argmax(result.iterates[:, 0] <= -1.0))
        scanned = np.linspace(float(low), float(high), 2001)
        values["printed: no root for y between"] = bool(np.min(np.log(2 + np.exp(scanned)) - np.cos(scanned)) > 0.0)
    return values


def a5(n: Arithmetic, given: Given) -> Values:
    """The residuals of the iterates 4 and 5 of A4, in millionths."""
    history = n.newton(me451.exponential_and_logarithm(), n.vector(given["start"]), 5)
    millionths = [[x * 1000000 for x in residual] for residual in history.residuals]
    return {"residual of iterate 5": millionths[5], "residual of iterate 4": millionths[4]}


def _problem_356(n: Arithmetic, given: Given, t: str = "0") -> SquareSystem:
    """Return Problem 3.5.6 at a time, with the row's numbers."""
    reach = n(t) * n(given["speed"]) + n(given["reach"])
    return _lengths(n, given).system(reach)


def _lengths(n: Arithmetic, given: Given) -> me451.Problem356:
    return me451.Problem356(n(given["ground"]), n(given["link"]))


def estimate_356(n: Arithmetic) -> Any:
    """Return the estimate of the slides' code: q = [0.2 ; 0.2 ; pi/4]."""
    return np.array([n("0.2"), n("0.2"), n.pi / 4])


def a6(n: Arithmetic, given: Given) -> Values:
    """Problem 3.5.6 at t = 0, iterate by iterate."""
    history = n.newton(_problem_356(n, given), estimate_356(n), 6)
    return {
        "q": history.iterates[:6],
        "correction": [np.sqrt(sum(c * c)) for c in history.corrections],
        "root": n.root(_problem_356(n, given), history.iterates[4]),
    }


def refkin_a6(n: Binary64, given: Given) -> Values:
    """The same pose in absolute coordinates, with bodies and joints."""
    system = compile_system(me451.problem_356_mechanism(float(given["ground"]), float(given["link"])))
    return {"root": absolute_356(system, 0.0)}


def absolute_356(system: Any, t: float) -> Any:
    """Return (x2, y2, phi3) of Problem 3.5.6 as a mechanism, from the slides' estimate."""
    start = np.array([0.0, 0.0, 0.8, 0.2, 0.2, 0.8, 0.6, 0.0, 0.8])
    q = position(system, start, t).q
    return np.array([q[3], q[4], q[8]])


def a7(n: Arithmetic, given: Given) -> Values:
    """The sweep of the "final form": t = 0 : 0.05 : 4, each pose from the one before."""
    if isinstance(n, Binary64):
        return _a7_sweep(given)
    q, poses = estimate_356(n), []
    for t in given["times"]:
        for part in range(1, 9):  # a step of the sweep at a time would do as well
            system = _problem_356(n, given, str(float(t) * part / 8))
            q = n.root(system, q)
        poses.append(q)
    return {"q": poses, "det at the last": n.det(_problem_356(n, given, given["times"][-1]).phi_q(poses[-1]))}


def _a7_sweep(given: Given) -> Values:
    n, q = Binary64(), estimate_356(Binary64())
    times = np.linspace(0.0, 4.0, 81)
    iterations, poses = [], {}
    for t in times:
        result = newton(*_problem_356(n, given, repr(float(t))), q, stop=CorrectionNorm(1e-8))
        q = result.q
        iterations.append(result.iterations)
        poses[round(float(t), 2)] = q
    last = _problem_356(n, given, given["times"][-1]).phi_q(q)
    return {
        "q": [poses[float(t)] for t in given["times"]],
        "det at the last": np.linalg.det(last),
        "iterations at t = 0": iterations[0],
        "iterations later": [min(iterations[1:]), max(iterations[1:])],
    }


def a8(n: Arithmetic, given: Given) -> Values:
    """The limits of Problem 3.5.6: folds, where the closed form ends."""
    ground, link = n(given["ground"]), n(given["link"])
    at_fold = _lengths(n, given).fold()
    times = []
    for start in (["0.8", "0", "-1.5", "0.8", "0", "1", "1"], ["0.4", "0", "1.5", "0.4", "0", "-1", "1"]):
        times.append((n.root(at_fold, n.vector(start))[3] - n(given["reach"])) / n(given["speed"]))
    reach = n(given["speed"]) + n(given["reach"])
    values: Values = {
        "t of the folds": times,
        "x2 at t = 1 in closed form": (ground * ground - link * link + reach * reach) / (2 * ground),
    }
    return {**values, **(_a8_runs(n, given) if isinstance(n, Binary64) else {})}


def _a8_runs(n: Binary64, given: Given) -> Values:
    """Newton at the fold, and beyond it: with a cap, for there the slides' while loops never end."""
    phi, phi_q = _problem_356(n, given, given["at fold"])
    exact = np.array([0.85, 0.0, -np.pi / 2])
    result = newton(phi, phi_q, exact + np.array([-0.05, 0.05, 0.1]), stop=never, max_iterations=200)
    errors = np.max(np.abs(result.iterates - exact), axis=1)
    beyond = newton(*_problem_356(n, given, given["beyond"]), exact, stop=never, max_iterations=200)
    return {
        "rate at the fold": linear_rate(errors, floor=1e-6).value,
        "error after 200": errors[-1],
        "condition there": np.linalg.cond(phi_q(result.q)),
        "largest residual component there": result.residual,
        "beyond: status": beyond.status.name,
    }


def a9(n: Arithmetic, given: Given) -> Values:
    """The even function: its constant, its roots, how many there are."""
    system = me451.even_function(n(given["constant"]))
    at = n.vector([given["x"]])
    values: Values = {
        "f(-1.2)": system.phi(at)[0],
        "f'(-1.2)": system.phi_q(at)[0, 0],
        "inner root": n.root(system, n.vector(["0.85"]))[0],
        "outer root": n.root(system, n.vector(["1.2"]))[0],
    }
    if isinstance(n, ArbNumbers):
        # Where 0 < x < 12 and cos x > 0; near the ends of these pieces f is above 100: ln(cos x) < -13 there.
        ends = (((2 * k - 0.5) * np.pi + 1e-6, (2 * k + 0.5) * np.pi - 1e-6) for k in range(3))
        pieces = [(max(0.0, low), min(high, 12.0)) for low, high in ends]
        values["roots for |x| < 12"] = 2 * sum(count_roots(system, *piece) for piece in pieces)
    return values


def a10(n: Arithmetic, given: Given) -> Values:
    """x^2 + 4 has no real root, x^2 - 4 has two."""
    none, two = me451.square(4), me451.square(-4)
    values: Values = {"roots of x^2 - 4": [n.root(two, n.vector([start]))[0] for start in ("1", "-3")]}
    if isinstance(n, ArbNumbers):
        values["no root of x^2 + 4 for |x| < 1000"] = excludes_zero(lambda x: none.phi([x])[0], -1000.0, 1000.0)
    else:
        values["no root of x^2 + 4 for |x| < 1000"] = bool(np.min(none.phi([np.linspace(-1e3, 1e3, 9999)])) > 0.0)
        values["status for x^2 + 4"] = newton(*none, 5.0).status.name
    return values


def a11(n: Arithmetic, given: Given) -> Values:
    """Velocity and acceleration of Problem 3.5.6 at t = 0."""
    system, speed = _problem_356(n, given), n(given["speed"])
    q = n.root(system, estimate_356(n))
    slope = system.phi_q(q)
    qd = n.solve(slope, _lengths(n, given).nu(n(given["reach"]), speed))
    qdd = n.solve(slope, _lengths(n, given).gamma(q, qd, speed))
    return {"qd": qd, "qdd": qdd}


def refkin_a11(n: Binary64, given: Given) -> Values:
    """The same rates with bodies and joints."""
    system = compile_system(me451.problem_356_mechanism())
    x, y, angle = absolute_356(system, 0.0)
    along = np.arctan2(y, x)
    q = np.array([0.0, 0.0, along, x, y, along, 0.6, 0.0, angle])
    qd = velocity(system, q, 0.0)
    qdd = acceleration(system, q, qd, 0.0)
    rows = [3, 4, 8]
    return {"qd": qd[rows], "qdd": qdd[rows]}


def a12(n: Arithmetic, given: Given) -> Values:
    """The five forms of the code end at one answer; a fold is regular with its null vector among the unknowns."""
    if isinstance(n, ArbNumbers):
        return {}
    system, q0 = _problem_356(n, given), estimate_356(n)
    ways: list[dict[str, Any]] = [
        {"stop": never, "max_iterations": 5},
        {"stop": never, "max_iterations": 6},
        {"stop": CorrectionNorm(1e-8)},
    ]
    results = [newton(*system, q0, **way) for way in ways]
    mechanism = me451.problem_356_mechanism()
    at_fold = _lengths(n, given).fold()
    regular = newton(*at_fold, n.vector(["0.8", "0.05", "-1.3", "0.8", "0", "1", "1"]))
    errors = np.max(np.abs(regular.iterates - regular.q), axis=1)
    return {
        "iterations": [r.iterations for r in results],
        "largest difference of the answers": max(float(np.max(np.abs(r.q - results[2].q))) for r in results),
        "counter that starts at 1 ends at": 1 + results[2].iterations,
        "nk": sum(joint.rows for joint in mechanism.joints),
        "nd": sum(driver.rows for driver in mechanism.drivers),
        "nc": 3 * len(mechanism.bodies),
        "order at the fold, with its null vector": newton_order(errors, basin=0.5).value,
    }


def a13(n: Arithmetic, given: Given) -> Values:
    """A certified delta of the implicit function theorem: q(t) exists, once, in a box for all |t - t_k| < delta.

    Krawczyk's operator on a box around q(t_k), with the whole interval of times in the equations; the largest power of
    two for which it proves a box that is a few times as wide as what the velocity sweeps over.
    """
    if isinstance(n, Binary64):
        return {}
    system = _problem_356(n, given)
    q = n.root(system, estimate_356(n))
    slope = system.phi_q(q)
    qd = n.solve(slope, _lengths(n, given).nu(n(given["reach"]), n(given["speed"])))
    swept, delta, proved = [float(abs(rate)) for rate in qd], 8.0, False
    while delta > 2.0**-40 and not proved:  # each box is held against every time |t| <= delta
        delta /= 2
        reach = arb(0, delta) * n(given["speed"]) + n(given["reach"])
        whole = _lengths(n, given).system(reach)
        proved = any(n.proves(whole, q, [f * delta * s for s in swept]) for f in (1.25, 1.5, 2.0, 3.0))
    return {"det phi_q": n.det(slope), "delta": delta}


def a14(n: Arithmetic, given: Given) -> Values:
    """The slides' stopping test: the norm of the correction below 1e-8."""
    if isinstance(n, ArbNumbers):
        history = n.newton(_problem_356(n, given), estimate_356(n), 6)
        return {"last correction": np.sqrt(sum(c * c for c in history.corrections[5]))}
    result = newton(*_problem_356(n, given), estimate_356(n), stop=CorrectionNorm(float(given["tolerance"])))
    return {"iterations": result.iterations, "last correction": np.linalg.norm(result.corrections[-1])}
