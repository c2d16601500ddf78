"""How far the answers of a method are from the truth, and how far they may be.

The truth is the closed form in long double; where that is no longer than a double the truth errs as a row does, which
the budgets cover: they count roundings on both sides. The error of a position is told in sizes and radians, that of a
rate as a part of the largest rate at that configuration. What is allowed is derived as everywhere
(`crosscheck.judge.budget`), at the truth and component by component.

Of four-bars every configuration's error is taken; budgets, which cost a hundred times more, are derived for a sample
spread over all and for the configurations with the largest errors. Of a chain all coordinates are judged: its budget is
that of `crosscheck.judge.budget` with sparse matrices, and |J^-1| e is taken from below (`from_below`), so that the
ratio is told too large rather than too small.
"""

from __future__ import annotations

from collections.abc import Iterable, Iterator
from dataclasses import dataclass
from typing import Any

import numpy as np

from crosscheck.engines.frames import wrap
from crosscheck.judge.budget import derive
from crosscheck.scenes.four_bar_answers import four_bar
from crosscheck.scenes.workloads import SPEED, FourBars, Piece, system_of, unit_of
from refkin.motion import Motion, Producer, Route, Seeding, Status, engine_motion

SAMPLE, WORST = 20_000, 2000
"""Of how many configurations, spread over all and with the largest errors, the budgets are derived."""
LANES = 2000
"""So many budgets are derived at once."""
ROUTE = Route(
    name="closed form",
    **dict.fromkeys(("residual_by", "jacobian_by", "newton_by", "linear_solve_by", "drift_by"), "nobody"),
    seeding=Seeding.NONE,
)


@dataclass(frozen=True)
class Accuracy:
    """What was found, of position and further `levels`.

    `unjudged` counts the sampled configurations for which no budget holds (next to a fold).
    """

    max_error: float
    worst_over_allowed: float
    configurations: int
    unjudged: int = 0
    levels: int = 1

    @property
    def ranked(self) -> bool:
        """Whether the answers are as right as they can be, and so their price worth naming."""
        return self.worst_over_allowed <= 1.0 and not self.unjudged


def judged(work: FourBars, pieces: Iterable[Piece]) -> Accuracy:
    """Return the accuracy of a method's answers to a workload of four-bars."""
    stride = max(1, work.configurations // SAMPLE)
    largest, count, levels = 0.0, 0, 0
    sample: list[Piece] = []
    worst: list[tuple[Any, Piece]] = []
    for piece in pieces:
        errors = _relative_errors(work, piece)
        largest, count = max(largest, float(np.max(errors, initial=0.0))), count + len(errors)
        levels = len(piece.levels)
        sample.append(piece.of(np.flatnonzero((piece.mechanisms * len(work.t) + piece.times) % stride == 0)))
        top = np.argsort(errors)[-WORST:]
        worst.append((errors[top], piece.of(top)))
        if len(worst) > 20:
            worst = [_worst_of(worst)]
    ratio, unjudged = 0.0, 0
    for piece in _in_lanes([*sample, _worst_of(worst)[1]]):
        found, without = _over_allowed(work, piece)
        ratio, unjudged = max(ratio, found), unjudged + without
    return Accuracy(largest, ratio, count, unjudged, levels)


def _truth(work: FourBars, piece: Piece) -> tuple[Any, ...]:
    lengths = work.lengths[:, piece.mechanisms].astype(np.longdouble)
    return four_bar(lengths, SPEED * work.t[piece.times].astype(np.longdouble), np.longdouble(SPEED))


def _errors(work: FourBars, piece: Piece, truth: tuple[Any, ...]) -> Iterator[tuple[Any, Any]]:
    """Yield per level the errors (rows, L) in sizes and radians, and what they are a part of, (L,)."""
    size = unit_of(work.lengths[:, piece.mechanisms]).size
    rows = np.asarray(piece.rows)
    angles = rows % 3 == 2
    for order, (level, exact) in enumerate(zip(piece.levels, truth, strict=False)):
        error = np.asarray(level - exact[rows], float)
        if order == 0:
            error[angles] = wrap(error[angles])
        scaled = np.where((np.arange(9) % 3 == 2)[:, None], exact, exact / size)
        error = np.abs(np.where(angles[:, None], error, error / size))
        part = np.max(np.abs(scaled), axis=0) if order else np.ones(error.shape[1])
        yield np.where(np.isfinite(error), error, np.inf), np.asarray(part, float)


def _relative_errors(work: FourBars, piece: Piece) -> Any:
    """Return the largest error of each configuration, of all levels."""
    found = [np.max(error, axis=0) / part for error, part in _errors(work, piece, _truth(work, piece))]
    return np.maximum.reduce(found)


def _worst_of(found: list[tuple[Any, Piece]]) -> tuple[Any, Piece]:
    errors = np.concatenate([e for e, _ in found])
    top = np.argsort(errors)[-WORST:]
    return errors[top], _joined([piece for _, piece in found]).of(top)


def _joined(pieces: list[Piece]) -> Piece:
    levels = zip(*(p.levels for p in pieces), strict=True)
    return Piece(
        np.concatenate([p.mechanisms for p in pieces]),
        np.concatenate([p.times for p in pieces]),
        pieces[0].rows,
        tuple(np.concatenate(level, axis=1) for level in levels),
    )


def _in_lanes(pieces: list[Piece]) -> Iterator[Piece]:
    whole = _joined(pieces)
    for start in range(0, len(whole.times), LANES):
        yield whole.of(slice(start, start + LANES))


def _over_allowed(work: FourBars, piece: Piece) -> tuple[float, int]:
    """Return the largest error / allowed, and of how many configurations no first-order statement holds."""
    truth = _truth(work, piece)
    system = system_of(work, piece.mechanisms)
    levels = [system.to_unit(np.asarray(level, float), order) for order, level in enumerate(truth)]
    budget = derive(system, _as_motion(work.t[piece.times], levels), *levels)
    rows, known = np.asarray(piece.rows), budget.judged
    ratio = 0.0
    for (error, _), allowed in zip(
        _errors(work, piece, truth), (budget.position, budget.velocity, budget.acceleration), strict=False
    ):
        with np.errstate(divide="ignore", invalid="ignore"):
            part = np.where(error == 0.0, 0.0, error / allowed[rows])
        ratio = max(ratio, float(np.max(part[:, known], initial=0.0)))
    return ratio, int(np.sum(~known))


def _as_motion(t: Any, levels: list[Any]) -> Motion:
    producer = Producer(name="closed form", version="", route=ROUTE)
    q, qd, qdd = levels
    return engine_motion(t, (), q, qd, qdd, (Status.OK,) * len(t), producer)
