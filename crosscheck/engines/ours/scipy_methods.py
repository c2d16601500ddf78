"""SciPy's general solvers on the reference's equations: what somebody gets who writes no Newton."""

from __future__ import annotations

from collections.abc import Iterator
from functools import partial
from typing import Any

from scipy.optimize import least_squares, root

from crosscheck.engines import EngineError
from crosscheck.engines.methods import Method, Model, Use, priced
from crosscheck.engines.ours.numpy_methods import four_bars_by_root
from crosscheck.engines.ours.refkin_methods import ScaledProblem, problem
from refkin.model import Scene

TOLERANCES = (1e-2, 1e-4, 1e-8, 1e-12)
SMALLEST = 2.0**-51
"""SciPy refuses tolerances of least squares below the spacing of the numbers."""


def methods() -> Iterator[Method]:
    """Yield `root` (MINPACK's hybrid method) and `least_squares` (Levenberg-Marquardt), tolerances swept."""
    yield from _sweep("root, analytic Jacobian", "SciPy (MINPACK hybrj)", _root)
    yield from _sweep("root, its own differences", "SciPy (MINPACK hybrd)", partial(_root, analytic=False))
    yield from _sweep("least_squares", "SciPy (MINPACK lmder)", _least_squares)
    yield Method(
        engine="scipy",
        name="root, a four-bar written out",
        setting="xtol 1e-15",
        newton_by="SciPy (MINPACK hybrj)",
        uses=frozenset({Use.BENCH}),
        batch=four_bars_by_root,
        at_once=True,
        note="hybr, analytic 9x9 Jacobian written for the four-bar; rates by numpy.linalg.solve",
    )


def _sweep(name: str, newton_by: str, step: Any) -> Iterator[Method]:
    for tolerance in TOLERANCES:
        build = partial(_built, step, tolerance)
        yield priced("scipy", name, f"tol {tolerance:g}", newton_by, build, "rates by refkin")


def _built(step: Any, tolerance: float, scene: Scene) -> Model:
    given = problem(scene)
    if step is not _least_squares and given.system.m != given.system.n:
        raise EngineError("it takes as many equations as unknowns")

    def solve(order: int) -> Any:
        poses = given.poses(partial(step, given, tolerance))
        return [poses, *given.rates(poses, order)]

    return Model(solve, given.read)


def _root(given: ScaledProblem, tolerance: float, q: Any, t: float, analytic: bool = True) -> Any:
    phi, phi_q = given.system.phi, given.system.phi_q
    return root(phi, q, args=(t,), jac=phi_q if analytic else None, method="hybr", tol=tolerance).x


def _least_squares(given: ScaledProblem, tolerance: float, q: Any, t: float) -> Any:
    phi, phi_q, tol = given.system.phi, given.system.phi_q, max(tolerance, SMALLEST)
    return least_squares(phi, q, phi_q, args=(t,), method="lm", xtol=tol, ftol=tol, gtol=tol).x
