"""SciPy's general solvers on the reference's equations: what somebody gets who writes no Newton."""

from __future__ import annotations

from collections.abc import Iterator
from functools import partial
from typing import Any

import numpy as np
from scipy.optimize import least_squares, root

from crosscheck.engines.ours.refkin_settings import Problem, problem
from crosscheck.engines.price_route import PricedRoute, Refused
from refkin.model import Scene

TOLERANCES = (1e-2, 1e-4, 1e-8, 1e-12)
SMALLEST = 2.0**-51
"""SciPy refuses tolerances of least squares below the spacing of the numbers."""


def routes(scene: Scene) -> Iterator[PricedRoute | Refused]:
    """Yield `root` (MINPACK's hybrid method) and `least_squares` (Levenberg-Marquardt), tolerances swept."""
    lost = [body.name for body in scene.mechanism.bodies if body.estimate is None]
    if lost:
        yield Refused(engine="scipy", name="any", reason=f"no estimate to start from: {', '.join(lost)}")
        return
    given = problem(scene)
    if given.system.m == given.system.n:
        yield from _sweep(given, "root, analytic Jacobian", "SciPy (MINPACK hybrj)", _root)
        yield from _sweep(given, "root, its own differences", "SciPy (MINPACK hybrd)", partial(_root, analytic=False))
    else:
        yield Refused(engine="scipy", name="root", reason="it takes as many equations as unknowns")
    yield from _sweep(given, "least_squares", "SciPy (MINPACK lmder)", _least_squares)


def _sweep(given: Problem, name: str, newton_by: str, step: Any) -> Iterator[PricedRoute]:
    for tolerance in TOLERANCES:
        yield PricedRoute(
            engine="scipy",
            name=name,
            knob=f"tol {tolerance:g}",
            newton_by=newton_by,
            solve=partial(_swept, given, partial(step, given, tolerance)),
            read=given.read,
            note="rates by refkin",
        )


def _swept(given: Problem, step: Any, order: int) -> Any:
    q, found = given.start, np.empty((given.system.n, len(given.times)))
    for k, t in enumerate(given.times):
        q = found[:, k] = step(q, t)
    return [found, *given.rates(found, order)]


def _root(given: Problem, tolerance: float, q: Any, t: float, analytic: bool = True) -> Any:
    phi, phi_q = given.system.phi, given.system.phi_q
    return root(phi, q, args=(t,), jac=phi_q if analytic else None, method="hybr", tol=tolerance).x


def _least_squares(given: Problem, tolerance: float, q: Any, t: float) -> Any:
    phi, phi_q, tol = given.system.phi, given.system.phi_q, max(tolerance, SMALLEST)
    return least_squares(phi, q, phi_q, args=(t,), method="lm", xtol=tol, ftol=tol, gtol=tol).x
