"""Loops at one time, and over time by the continuation of `crosscheck.engines.march`, in the assembly that is meant.

One pose is found by `refkin.newton.newton` to round-off, with new estimates where a derivative vanishes, or by least
squares; loops may be in real or in complex form.

Rates are taken of every pose, whether a scene calls for them or not. A whole cycle stays in the assembly in which it
started, and ends where that assembly ends.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterable, Iterator, Sequence
from dataclasses import dataclass
from enum import StrEnum
from typing import Any

import numpy as np

from crosscheck.engines import Array
from crosscheck.engines import march as continuation
from crosscheck.engines.poses import CAP, CONTRACTION, EPS, TRUST, Equations, Poses
from crosscheck.engines.poses import close as close_all
from crosscheck.engines.vector_loop.system import LoopSystem
from refkin.motion import Status
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
    """Solve the loops at a time by Newton's method, to round-off by default.

    Parameters
    ----------
    system, q0, t : LoopSystem, (n,) array, float
        The estimate at a time [s].
    complex_form : bool
        Whether the iterates are complex numbers, whose imaginary parts are round-off.
    **options
        Of `newton`.
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

    One result per estimate that was used is returned, the last one is the answer. Its status is SINGULAR only if all of
    them led to a vanishing derivative; any other way to end is an end.

    Parameters
    ----------
    phi, phi_q, estimates, **options
        As `refkin.newton.newton` takes them; at least one estimate, of which each is used once.
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
    """Where the sum of squared closure errors is least, near an estimate: q and residual (n,)."""

    status: MinimumStatus
    q: Any
    residual: Any

    @property
    def gap(self) -> float:
        """Root of the sum of squares: by how much the loops together stay open."""
        return float(np.sqrt(self.residual @ self.residual))


def minimise(system: LoopSystem, q0: Any, max_evaluations: int = 1000) -> Minimum:
    """Minimise the sum of squared closure errors from an estimate: the spreadsheet solver's way (METU 3.9).

    The answer is a root only if every closure error is at round-off there; any other minimum is called stalled. (Moré,
    The Levenberg-Marquardt algorithm, 1978, as MINPACK has it.)

    Parameters
    ----------
    system, q0, max_evaluations : LoopSystem, (n,) array, int
        The estimate; how often the closure errors may be evaluated.
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


class LoopEquations(Equations):
    """The equations of loops in unknowns of order one, q times `weights`."""

    def __init__(self, system: LoopSystem) -> None:
        self.system = system
        self.laws = list({id(law): law for variable in system.variables() for _, law in variable.laws}.values())

    def rows(self, q: Array, t: Array) -> tuple[Array, Array]:
        s, at = self.system, self.unknowns(q)
        return s.residual(at, t).T / s.scale, np.moveaxis(s.jacobian(at, t), 2, 0) / s.weights / s.scale

    def nu(self, q: Array, t: Array) -> Array:
        return np.asarray(self.system.nu(self.unknowns(q), t).T / self.system.scale)

    def gamma(self, q: Array, qd: Array, t: Array) -> Array:
        return np.asarray(self.system.gamma(self.unknowns(q), self.unknowns(qd), t).T / self.system.scale)

    def round_off(self, q: Array, t: Array) -> Array:
        return np.asarray(self.system.rounding(self.unknowns(q), t).T / self.system.scale)

    def unknowns(self, q: Array) -> Array:
        """Return the system's own unknowns or rates, (n, B)."""
        return np.asarray((q / self.system.weights).T)


@dataclass(frozen=True)
class LoopMarch:
    """Unknowns and rates (n, T) over the times: NaN where there is no answer, rates also where the pose is singular.

    A status is OK, SINGULAR, or NOT_CONVERGED: not reached, which proves nothing. `residual` (T,) is the largest
    closure error at each time, in units of the system's scale.
    """

    t: Any
    q: Any
    qd: Any
    qdd: Any
    status: tuple[Status, ...]
    residual: Any

    @property
    def reached(self) -> int:
        """The number of times before the first that was not reached."""
        lost = [s is Status.NOT_CONVERGED for s in self.status]
        return lost.index(True) if any(lost) else len(lost)


Distance = Callable[[Any], float]
"""How far unknowns lie from an estimate."""


def march(system: LoopSystem, times: Sequence[float], q0: Any, distance: Distance | None = None) -> LoopMarch:
    """Close the loops at each time: at the first from the estimate, then from pose to pose, as far as they close.

    Parameters
    ----------
    system, times, q0 : LoopSystem, sequence of float, (n,) array
        Times [s], and the estimate of the first pose.
    distance : callable, optional
        Which of several assemblies is meant, where the estimate is far from all: by default the one whose unknowns are
        nearest to q0.
    """
    equations, q0 = LoopEquations(system), np.asarray(q0, float)

    def first(t: float) -> Poses:
        q = _start(system, q0, float(t), distance)
        at = np.full((1, system.n), np.nan) if q is None else (q * system.weights)[None]
        return close_all(equations, at, np.array([t]))

    poses = continuation.march(equations, first, times, 2)
    ok = [status is Status.OK for status in poses.status]
    end = ok.index(False) + 1 if False in ok else len(ok)
    status = poses.status[:end] + (Status.NOT_CONVERGED,) * (len(ok) - end)
    known = np.where(np.arange(len(ok)) < end, 1.0, np.nan)
    q, qd, qdd = (level * known / system.weights[:, None] for level in poses.levels)
    return LoopMarch(np.asarray(times, float), q, qd, qdd, status, poses.residual * known)


def _start(system: LoopSystem, q0: Any, t: float, distance: Distance | None = None) -> Any:
    """Return the unknowns at t that an estimate leads to: those of Newton, if it contracts at once; None if none close.

    From any other estimate Newton may go anywhere: then damped Newton is run also from estimates in which one angle is
    turned, and the nearest of the ends is taken, without the whole turns made on the way.
    """
    if not system.n:
        return q0
    near = close(system, q0, t)
    if near.converged and _contracts(system, near):
        return near.q
    ends = [near, *(close(system, guess, t, damped=True) for guess in _guesses(system, q0))]
    closed = [close(system, _unwound(system, end.q, q0), t).q for end in ends if end.converged]
    poses = [q for q in closed if (np.abs(system.residual(q, t)) <= system.rounding(q, t)).all()]
    far = distance or (lambda q: float(np.linalg.norm((q - q0) * system.weights)))
    return min(poses, key=far, default=None)


def _contracts(system: LoopSystem, result: NewtonResult) -> bool:
    """Return whether the first correction was not large and the second a small part of it.

    A first correction below 1e-6 is round-off of a good prediction.
    """
    sizes = np.max(np.abs(result.corrections * system.weights), axis=1, initial=0.0)
    first, second = (*sizes, 0.0, 0.0)[:2]
    return bool(first <= TRUST and (second <= CONTRACTION * first or first <= 1e-6))


def _guesses(system: LoopSystem, q0: Any) -> Iterator[Any]:
    yield q0
    for k in np.flatnonzero(system.is_angle):
        for quarters in (1, 2, 3):
            yield q0 + 0.5 * math.pi * quarters * np.eye(system.n)[k]


def _unwound(system: LoopSystem, q: Any, near: Any) -> Any:
    """Return q with whole turns taken off the angles, as far as no relation counts them."""
    counted = {v.unknown for relation in system.relations for _, v in relation.terms}
    free = system.is_angle & np.array([name not in counted for name in system.unknowns], bool)
    return q - np.where(free, math.tau * np.round((q - near) / math.tau), 0.0)
