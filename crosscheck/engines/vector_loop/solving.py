"""One pose of a set of loops: Newton to round-off, new estimates where a derivative vanishes, and least squares.

Newton itself is `refkin.newton.newton`, with the callables of a `LoopSystem` in real or in complex form.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable
from dataclasses import dataclass
from enum import StrEnum
from typing import Any

import numpy as np

from crosscheck.engines.poses import CAP, EPS
from crosscheck.engines.vector_loop.system import LoopSystem
from refkin.newton import NewtonResult, NewtonStatus, newton


@dataclass
class Closed:
    """Stop when the closure errors are at round-off and the correction is too, or no longer shrinks.

    At a double root, where it halves, it shrinks down to the root of round-off.
    """

    bound: Any
    previous: float = np.inf

    def __call__(self, residual: Any, correction: Any, q: Any) -> bool:
        size = float(np.max(np.abs(correction)))
        closed = bool((np.abs(residual) <= self.bound).all())
        done = size <= EPS * max(1.0, float(np.max(np.abs(q)))) or size > 0.6 * self.previous
        self.previous = size
        return closed and done


def close(system: LoopSystem, q0: Any, t: float = 0.0, *, complex_form: bool = False, **options: Any) -> NewtonResult:
    """Solve the loops at a time by Newton's method, to round-off by default; options are those of `newton`.

    In complex form the iterates are complex numbers, whose imaginary parts are round-off.
    """
    q0 = np.asarray(q0, complex if complex_form else float)
    stop = Closed(np.max(system.rounding(q0.real, t)))
    given = {"stop": stop, "max_iterations": CAP, **options}
    if complex_form:
        return newton(lambda q: system.complex_residual(q, t), lambda q: system.complex_jacobian(q, t), q0, **given)
    return newton(lambda q: system.residual(q, t), lambda q: system.jacobian(q, t), q0, **given)


def with_new_estimates(
    phi: Callable[[Any], Any], phi_q: Callable[[Any], Any], estimates: Iterable[Any], **options: Any
) -> list[NewtonResult]:
    """Run Newton from one estimate after the other while the derivative vanishes away from a root (METU 3.9).

    Parameters
    ----------
    phi, phi_q, options
        As `refkin.newton.newton` takes them; `stop` may be a function that makes a new test for each run.
    estimates : iterable
        At least one; each is used once.

    Returns
    -------
    list of NewtonResult
        One per estimate that was used, the last one is the answer. Its status is SINGULAR only if all of them led to
        a vanishing derivative; any other way to end is an end.
    """
    results = []
    for estimate in estimates:
        results.append(newton(phi, phi_q, estimate, **options))
        if results[-1].status is not NewtonStatus.SINGULAR:
            break
    if not results:
        raise ValueError("estimates: expected at least one, got none")
    return results


class MinimumStatus(StrEnum):
    """What a least-squares search ended at."""

    ROOT = "the loops close"
    STALLED = "a minimum of the closure errors that is no root"
    ITERATION_LIMIT = "the evaluation limit was reached"


@dataclass(frozen=True)
class Minimum:
    """Where the sum of squared closure errors is least, near an estimate.

    Attributes
    ----------
    q, residual : (n,) array
    gap : float
        Root of the sum of squares: by how much the loops together stay open.
    """

    status: MinimumStatus
    q: Any
    residual: Any

    @property
    def gap(self) -> float:
        return float(np.sqrt(self.residual @ self.residual))


def minimise(system: LoopSystem, q0: Any, max_evaluations: int = 1000) -> Minimum:
    """Minimise the sum of squared closure errors from an estimate: the spreadsheet solver's way (METU 3.9).

    The answer is a root only if every closure error is at round-off there; any other minimum is called stalled. (Moré,
    The Levenberg-Marquardt algorithm, 1978, as MINPACK has it.)
    """
    from scipy.optimize import least_squares  # here, because importing it costs more than the rest of this package

    scale, weights = system.scale, system.weights

    def errors(z: Any) -> Any:
        return system.residual(z / weights, 0.0) / scale

    def slopes(z: Any) -> Any:
        return system.jacobian(z / weights, 0.0) / weights / scale

    limits: dict[str, Any] = dict.fromkeys(("xtol", "ftol", "gtol"), EPS)
    start = np.asarray(q0, float) * weights
    fit = least_squares(errors, start, jac=slopes, method="lm", max_nfev=max_evaluations, **limits)
    q = fit.x / weights
    residual = system.residual(q, 0.0)
    if (np.abs(residual) <= system.rounding(q, 0.0)).all():
        return Minimum(MinimumStatus.ROOT, q, residual)
    return Minimum(MinimumStatus.STALLED if fit.status > 0 else MinimumStatus.ITERATION_LIMIT, q, residual)
