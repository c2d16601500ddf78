"""The closed form on NumPy rows, which is the limit, and SciPy's general root finder, pose after pose."""

from __future__ import annotations

import math
from collections.abc import Iterator
from typing import Any

import numpy as np

from crosscheck.engines import EngineError
from crosscheck.engines.methods import Batch, Method, Use
from crosscheck.scenes.four_bar_answers import four_bar
from crosscheck.scenes.workloads import SPEED, AnswerPiece, FourBars, Workload, chunks, whole

AT_ONCE = 10_000
"""Configurations that are computed at once: their rows stay in the cache."""
SCIPY_CONFIGURATIONS = 720


def methods() -> Iterator[Method]:
    """Yield the vectorised closed form."""
    yield Method(
        engine="numpy",
        name="closed form",
        newton_by="nobody: two circles meet",
        uses=frozenset({Use.BENCH}),
        batch=closed_form,
        at_once=True,
        note="two circles meet, differentiated twice, all at once; knows what a four-bar is",
    )


def of_four_bars(workload: Workload) -> FourBars:
    """Return a workload of four-bars; raises EngineError if it is none."""
    if not isinstance(workload, FourBars):
        raise EngineError("made for four-bars")
    return workload


def closed_form(workload: Workload, order: int) -> Batch:
    """Return the vectorised closed form; all orders come at once."""
    work = of_four_bars(workload)
    phi = SPEED * work.t[None, :]
    step = max(1, AT_ONCE // len(work.t))

    def run() -> None:
        for start in range(0, work.mechanisms, step):
            four_bar(work.lengths[:, start : start + step, None], phi, SPEED)

    def pieces() -> Iterator[AnswerPiece]:
        for samples in chunks(work):
            yield whole(work, samples, four_bar(work.lengths[:, samples, None], phi, SPEED))

    return Batch(run, work.configurations, pieces)


def four_bars_by_root(workload: Workload, order: int) -> Batch:
    """Return `scipy.optimize.root` with the analytic Jacobian at every pose, from the last one's prediction."""
    work = of_four_bars(workload)
    part = work.first(max(1, SCIPY_CONFIGURATIONS // len(work.t)))

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
    from scipy.optimize import root  # here: importing it costs more than most methods do

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
