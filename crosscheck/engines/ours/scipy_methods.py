"""SciPy's general solvers on the reference's equations, and on a four-bar's: what one gets who writes no Newton."""

from __future__ import annotations

import math
from collections.abc import Iterator
from functools import partial
from typing import Any

import numpy as np
from scipy.optimize import least_squares, root

from crosscheck.engines import EngineError
from crosscheck.engines.methods import Batch, Method, Model, Use, of_four_bars, priced
from crosscheck.engines.ours.refkin_methods import ScaledProblem, problem
from crosscheck.scenes.workloads import SPEED, AnswerPiece, Workload, whole
from refkin.model import Scene

TOLERANCES = (1e-2, 1e-4, 1e-8, 1e-12)
SMALLEST = 2.0**-51
"""SciPy refuses tolerances of least squares below the spacing of the numbers."""
CONFIGURATIONS = 720
"""So many of many mechanisms are answered."""


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


def four_bars_by_root(workload: Workload, order: int) -> Batch:
    """Return `scipy.optimize.root` with the analytic Jacobian at every pose, from the last one's prediction."""
    work = of_four_bars(workload)
    part = work.first(max(1, CONFIGURATIONS // len(work.t)))

    def solved(sample: int) -> Any:
        out = np.empty((3, 9, len(part.t)))
        q, before = part.starts[:, sample], None
        for k, t in enumerate(part.t.tolist()):
            if before is not None:
                h = t - part.t[k - 1]
                q = before[0] + h * (before[1] + 0.5 * h * before[2])
            before = _pose(part.lengths[:, sample].tolist(), q, t)
            out[:, :, k] = before
        return out

    def pieces() -> Iterator[AnswerPiece]:
        for sample in range(part.mechanisms):
            yield whole(part, np.array([sample]), solved(sample)[:, :, None])

    return Batch(lambda: [solved(sample) for sample in range(part.mechanisms)], part.configurations, pieces)


def _pose(lengths: list[float], guess: Any, t: float) -> Any:
    """Return position, velocity and acceleration (3, 9) at a time."""
    # It stops at its tolerance, or says that it makes no good progress: then it is at round-off, which is judged.
    q = root(_residual, guess, (lengths, SPEED * t), method="hybr", jac=_jacobian, options={"xtol": 1e-15}).x
    slope = _jacobian(q, lengths, SPEED * t)
    right = np.zeros(9)
    right[8] = SPEED
    qd = np.linalg.solve(slope, right)
    return q, qd, np.linalg.solve(slope, _bend(q, qd, lengths))


def _arms(q: Any, lengths: list[float]) -> list[tuple[float, float]]:
    return [(0.5 * x * math.cos(phi), 0.5 * x * math.sin(phi)) for x, phi in zip(lengths[1:], q[2::3], strict=True)]


def _residual(q: Any, lengths: list[float], phi: float) -> list[float]:
    a, b, c = _arms(q, lengths)
    x = q.tolist()
    return [
        x[0] - a[0],
        x[1] - a[1],
        x[3] - b[0] - x[0] - a[0],
        x[4] - b[1] - x[1] - a[1],
        x[6] + c[0] - x[3] - b[0],
        x[7] + c[1] - x[4] - b[1],
        x[6] - c[0] - lengths[0],
        x[7] - c[1],
        x[2] - phi,
    ]


def _jacobian(q: Any, lengths: list[float], phi: float) -> Any:
    a, b, c = _arms(q, lengths)
    out = _CONSTANT.copy()
    for row, column, (x, y) in ((0, 2, a), (6, 8, c), (2, 5, b), (2, 2, a), (4, 5, b)):
        out[row, column], out[row + 1, column] = y, -x
    out[4, 8], out[5, 8] = -c[1], c[0]
    return out


def _bend(q: Any, qd: Any, lengths: list[float]) -> Any:
    a, b, c = (np.array(arm) * w * w for arm, w in zip(_arms(q, lengths), qd[2::3], strict=True))
    return np.concatenate([-a, -b - a, c - b, -c, [0.0]])


def _constant() -> Any:
    out = np.zeros((9, 9))
    for row, column, sign in ((0, 0, 1), (2, 3, 1), (2, 0, -1), (4, 6, 1), (4, 3, -1), (6, 6, 1)):
        out[row, column] = out[row + 1, column + 1] = sign
    out[8, 2] = 1.0
    return out


_CONSTANT = _constant()
