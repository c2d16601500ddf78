"""How far a method's answers to a workload are from the truth, and how far they may be.

The truth is the closed form in long double; where that is no longer than a double the truth errs as a row does, which
the budgets cover: they count roundings on both sides. The error of a position is stated in sizes and radians, that of a
rate as a part of the largest rate at that configuration. What is allowed is derived as everywhere
(`crosscheck.judge.budget`), at the truth and component by component.

Of four-bars every configuration's error is taken; budgets, which cost a hundred times more, are derived for a sample
spread over all and for the configurations with the largest errors. Of a chain all coordinates are judged, with
sparse matrices. |J^-1| has 4e9 entries for 10,000 loops, so |J^-1| e is taken from below, as the largest |J^-1 (s e)|
over some random signs s: the ratio is too large rather than too small.

Of RSSRs the truth is the certified reference, so what the reference itself answers has no error. Every configuration
is judged as a night judges it (`crosscheck.judge.comparison`): signs of p and spins of couplers are those of the truth.
"""

from __future__ import annotations

from collections.abc import Iterable, Iterator
from dataclasses import dataclass, replace
from functools import cache
from typing import Any

import numpy as np

from crosscheck.engines.frames import wrap
from crosscheck.engines.methods import motion_of
from crosscheck.judge.budget import propagation
from crosscheck.judge.comparison import Reference, compare, reference, scales
from crosscheck.judge.rounding import SAFETY, output_rounding
from crosscheck.judge.running_error import Running, U
from crosscheck.scenes.four_bar_answers import four_bar
from crosscheck.scenes.workloads import SPEED, AnswerPiece, FourBars, LoopChain, system_of, unit_of
from crosscheck.scenes.workloads_space import SpatialLoops
from refkin.model import Evidence
from refkin.motion import Producer, Route
from refkin.vec import BodyValues

SAMPLE, WORST = 20_000, 2000
"""Of how many configurations, spread over all and with the largest errors, the budgets are derived."""
SAMPLES = 2000
"""So many budgets are derived at once."""
SIGNS = 32
"""How many random signs bound |J^-1| e of a chain."""
NOBODY = Producer(name="", version="", route=Route(name="closed form"))


@dataclass(frozen=True)
class Accuracy:
    """What was found, of position and further `levels`.

    `uncompared` counts the sampled configurations for which no budget holds (next to a fold).
    """

    max_error: float
    worst_over_allowed: float
    configurations: int
    uncompared: int = 0
    levels: int = 1

    @property
    def ranked(self) -> bool:
        """Whether the answers are as right as they can be, and so their price worth naming."""
        return self.worst_over_allowed <= 1.0 and not self.uncompared


def of_four_bars(work: FourBars, pieces: Iterable[AnswerPiece]) -> Accuracy:
    """Return the accuracy of a method's answers to a workload of four-bars."""
    stride = max(1, work.configurations // SAMPLE)
    largest, count, levels = 0.0, 0, 0
    sample: list[AnswerPiece] = []
    worst: list[tuple[Any, AnswerPiece]] = []
    for piece in pieces:
        of_levels = _errors(work, piece, _truth(work, piece))
        errors = np.maximum.reduce([np.max(error, axis=0) / part for error, part in of_levels])
        largest, count = max(largest, float(np.max(errors, initial=0.0))), count + len(errors)
        levels = len(piece.levels)
        sample.append(piece.of(np.flatnonzero((piece.mechanisms * len(work.t) + piece.times) % stride == 0)))
        worst.append(_worst_of([(errors, piece)]))
        if len(worst) > 20:
            worst = [_worst_of(worst)]
    ratio, uncompared = 0.0, 0
    compared = _joined([*sample, _worst_of(worst)[1]])
    for start in range(0, len(compared.times), SAMPLES):
        of_piece, without = _over_allowed(work, compared.of(slice(start, start + SAMPLES)))
        ratio, uncompared = max(ratio, of_piece), uncompared + without
    return Accuracy(largest, ratio, count, uncompared, levels)


def _truth(work: FourBars, piece: AnswerPiece) -> tuple[Any, ...]:
    lengths = work.lengths[:, piece.mechanisms].astype(np.longdouble)
    return four_bar(lengths, SPEED * work.t[piece.times].astype(np.longdouble), np.longdouble(SPEED))


def _errors(work: FourBars, piece: AnswerPiece, truth: tuple[Any, ...]) -> Iterator[tuple[Any, Any]]:
    """Yield per level the errors (rows, L) in sizes and radians, and what they are a part of, (L,)."""
    size = unit_of(work.lengths[:, piece.mechanisms]).size
    rows, angles = np.asarray(piece.rows), np.arange(9) % 3 == 2
    for order, (level, exact) in enumerate(zip(piece.levels, truth, strict=False)):
        error = np.asarray(level - exact[rows], float)
        if order == 0:
            error[angles[rows]] = wrap(error[angles[rows]])
        scaled = np.where(angles[:, None], exact, exact / size)
        error = np.abs(np.where(angles[rows][:, None], error, error / size))
        part = np.max(np.abs(scaled), axis=0) if order else np.ones(error.shape[1])
        yield np.where(np.isfinite(error), error, np.inf), np.asarray(part, float)


def _worst_of(pieces: list[tuple[Any, AnswerPiece]]) -> tuple[Any, AnswerPiece]:
    errors = np.concatenate([e for e, _ in pieces])
    top = np.argsort(errors)[-WORST:]
    return errors[top], _joined([piece for _, piece in pieces]).of(top)


def _joined(pieces: list[AnswerPiece]) -> AnswerPiece:
    levels = zip(*(p.levels for p in pieces), strict=True)
    return AnswerPiece(
        np.concatenate([p.mechanisms for p in pieces]),
        np.concatenate([p.times for p in pieces]),
        pieces[0].rows,
        tuple(np.concatenate(level, axis=1) for level in levels),
    )


def _over_allowed(work: FourBars, piece: AnswerPiece) -> tuple[float, int]:
    """Return the largest error / allowed, and of how many configurations no first-order statement holds."""
    truth = _truth(work, piece)
    system = system_of(work, piece.mechanisms)
    levels = [system.to_unit(np.asarray(level, float), order) for order, level in enumerate(truth)]
    budget = propagation(system, motion_of(work.t[piece.times], (), levels, NOBODY), *levels).budget()
    rows, known = np.asarray(piece.rows), budget.compared
    ratio = 0.0
    for (error, _), allowed in zip(_errors(work, piece, truth), budget.levels, strict=False):
        with np.errstate(divide="ignore", invalid="ignore"):
            part = np.where(error == 0.0, 0.0, error / allowed[rows])
        ratio = max(ratio, float(np.max(part[:, known], initial=0.0)))
    return ratio, int(np.sum(~known))


@cache
def _certified(work: SpatialLoops, mechanism: int) -> Reference:
    """Return the certified reference of one mechanism."""
    return reference(replace(work.scene(mechanism), evidence=frozenset({Evidence.CERTIFICATE})))


def of_spatial_loops(work: SpatialLoops, pieces: Iterable[AnswerPiece]) -> Accuracy:
    """Return the accuracy of a method's answers to a workload of RSSRs, each piece one mechanism at all times.

    A time at which nothing is proved, or no budget holds, is uncompared; a missing answer is an infinite error.
    """
    largest, ratio, count, uncompared, levels = 0.0, 0.0, 0, 0, 0
    for piece in pieces:
        ref = _certified(work, int(piece.mechanisms[0]))
        compared = compare(ref, motion_of(np.array(work.t), ref.motion.bodies, piece.levels, NOBODY))
        count, levels = count + len(piece.times), len(piece.levels)
        proved = np.isfinite(ref.motion.certified_radius.acceleration)
        uncompared += int(np.sum(~(ref.budget().compared & proved)))
        if compared.missing:
            largest = ratio = np.inf
        for order, quantity in enumerate(compared.quantities.values()):
            largest = max(largest, float(np.nanmax(quantity.error / scales(ref.levels, order, ref.rests), initial=0.0)))
            ratio = max(ratio, float(np.nanmax(quantity.ratio, initial=0.0)))
    return Accuracy(largest, ratio, count, uncompared, levels)


def sparse_system(work: LoopChain) -> Any:
    """Return the chain's `SparseSystem` in its own unit."""
    from refkin.fast import SparseSystem  # here: the fast paths may be absent

    return SparseSystem(work.system)


def of_chain(work: LoopChain, q: Any) -> Accuracy:
    """Return the accuracy of a chain's coordinates q (n,) in metres and radians."""
    system, truth = work.system, work.truth()[0]
    error = np.asarray(np.asarray(q, np.longdouble) - truth, float)
    error[2::3] = wrap(error[2::3])
    error = np.abs(system.to_unit(error, 1))  # as a rate: a difference has no origin
    error = np.where(np.isfinite(error), error, np.inf)
    part = error / allowed(sparse_system(work), system.to_unit(np.asarray(truth, float)), work.scene.times[0])
    return Accuracy(float(np.max(error)), float(np.max(part)), 1)


def allowed(sparse: Any, q: Any, t: float) -> Any:
    """Return the allowed errors of positions (n,) at a solution q (n,), in the system's scaled coordinates.

    Parameters
    ----------
    sparse : SparseSystem
    q : (n,) array
        The pose, in its scaled coordinates.
    t : float
        When [s].
    """
    from refkin.fast.sparse import factors  # here: the fast paths may be absent

    e_phi = SAFETY * residual_error(sparse, q, t)
    signs = np.random.default_rng(0).choice([-1.0, 1.0], (len(q), SIGNS))
    lu = factors(sparse.phi_q(q, t))
    carried = np.max(np.abs(np.stack([lu.solve(column * e_phi) for column in signs.T])), axis=0)
    still = np.zeros((len(q), 1))
    return carried + output_rounding(sparse.system, q[:, None], still, still, np.array([t]))[0][:, 0]


def residual_error(sparse: Any, q: Any, t: float) -> Any:
    """Return the running error (n,) of phi, with coordinates that are rounded to U |q|.

    Parameters
    ----------
    sparse, q, t
        As for `allowed`.
    """

    def values(start: Any) -> BodyValues:
        if start is None:
            return BodyValues(0.0, 0.0, 0.0)
        return BodyValues(*(Running(q[start + k], U * np.abs(q[start + k])) for k in range(3)))

    out = np.zeros(len(q))
    for p in sparse.grouped.placed:
        f = p.constraint.inputs(t, sparse.system.unit, 0)
        residual = p.constraint.residual(p.g, f, *map(values, p.starts))
        for row, value in zip(p.constraint.at, residual, strict=True):
            out[row] = value.error
    return out
