"""The rows A10 to A14: existence, velocity and acceleration, the code variants, and what the slides claim of them."""

from __future__ import annotations

from typing import Any

import numpy as np
from flint import arb

from crosscheck.documents.convergence import newton_order
from crosscheck.documents.ledger.arithmetic import Arithmetic, Balls, Binary64, excludes_zero
from crosscheck.documents.ledger.me451 import Given, Values, absolute_356, estimate_356, never, problem_356
from crosscheck.documents.systems import me451
from refkin.analysis import acceleration, velocity
from refkin.newton import CorrectionNorm, newton
from refkin.system import compile_system


def a10(n: Arithmetic, given: Given) -> Values:
    """x^2 + 4 has no real root, x^2 - 4 has two."""
    none, two = me451.square(4), me451.square(-4)
    values: Values = {"roots of x^2 - 4": [n.root(two, n.vector([start]))[0] for start in ("1", "-3")]}
    if isinstance(n, Balls):
        values["no root of x^2 + 4 for |x| < 1000"] = excludes_zero(lambda x: none.phi([x])[0], -1000.0, 1000.0)
    else:
        values["no root of x^2 + 4 for |x| < 1000"] = bool(np.min(none.phi([np.linspace(-1e3, 1e3, 9999)])) > 0.0)
        values["status for x^2 + 4"] = newton(*none, 5.0).status.name
    return values


def a11(n: Arithmetic, given: Given) -> Values:
    """Velocity and acceleration of Problem 3.5.6 at t = 0."""
    system, speed = problem_356(n, given), n(given["speed"])
    q = n.root(system, estimate_356(n))
    slope = system.phi_q(q)
    qd = n.solve(slope, me451.problem_356_nu(n(given["reach"]), speed))
    qdd = n.solve(slope, me451.problem_356_gamma(n(given["link"]), q, qd, speed))
    return {"qd": qd, "qdd": qdd}


def refkin_a11(given: Given) -> Values:
    """The same rates with bodies and joints."""
    system = compile_system(me451.problem_356_mechanism())
    reduced = absolute_356(system, 0.0)
    q = _whole(reduced)
    qd = velocity(system, q, 0.0)
    qdd = acceleration(system, q, qd, 0.0)
    rows = [3, 4, 8]
    return {"qd": qd[rows], "qdd": qdd[rows]}


def _whole(reduced: Any) -> Any:
    """Return the nine coordinates of the mechanism from (x2, y2, phi3)."""
    x, y, angle = reduced
    along = np.arctan2(y, x)
    return np.array([0.0, 0.0, along, x, y, along, 0.6, 0.0, angle])


def a12(n: Arithmetic, given: Given) -> Values:
    """The five forms of the code end at one answer; a fold is regular with its null vector among the unknowns."""
    if isinstance(n, Balls):
        return {}
    system, q0 = problem_356(n, given), estimate_356(n)
    ways: list[dict[str, Any]] = [
        {"stop": never, "max_iterations": 5},
        {"stop": never, "max_iterations": 6},
        {"stop": CorrectionNorm(1e-8)},
    ]
    results = [newton(*system, q0, **way) for way in ways]
    mechanism = me451.problem_356_mechanism()
    at_fold = me451.problem_356_fold(n(given["ground"]), n(given["link"]))
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
    system = problem_356(n, given)
    q = n.root(system, estimate_356(n))
    slope = system.phi_q(q)
    qd = n.solve(slope, me451.problem_356_nu(n(given["reach"]), n(given["speed"])))
    swept = [float(abs(rate)) for rate in qd]
    delta = 4.0
    while delta > 2.0**-40 and not any(
        _proved_for(n, given, q, delta, [f * delta * s for s in swept]) for f in (1.25, 1.5, 2.0, 3.0)
    ):
        delta /= 2
    return {"det phi_q": n.det(slope), "delta": delta}


def _proved_for(n: Balls, given: Given, q: Any, delta: float, widths: list[float]) -> bool:
    """Return whether each box of these half-widths holds exactly one pose at every time |t| <= delta."""
    reach = arb(0, delta) * n(given["speed"]) + n(given["reach"])
    return n.proves(me451.problem_356(reach, n(given["ground"]), n(given["link"])), q, widths)


def a14(n: Arithmetic, given: Given) -> Values:
    """The slides' stopping test: the norm of the correction below 1e-8."""
    if isinstance(n, Balls):
        history = n.newton(problem_356(n, given), estimate_356(n), 6)
        return {"last correction": np.sqrt(sum(c * c for c in history.corrections[5]))}
    result = newton(*problem_356(n, given), estimate_356(n), stop=CorrectionNorm(float(given["tolerance"])))
    return {"iterations": result.iterations, "last correction": np.linalg.norm(result.corrections[-1])}
