"""One way to do a work: what is timed, what it answers, and who drives its loop."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator
from dataclasses import dataclass
from typing import Any

import numpy as np

from crosscheck.judge.of_batches import Accuracy, Piece, judged
from crosscheck.scenes.works import FourBars

CONFIGURATION, NEWTON_ITERATION = "configuration", "newton-iteration"
LEVELS = ("position", "velocity", "acceleration")
CHUNK = 500
"""So many mechanisms are answered at once when a route's accuracy is taken."""


class Absent(Exception):
    """A route that cannot be taken here; the message says why."""


@dataclass(frozen=True)
class Route:
    """A route of a work.

    Attributes
    ----------
    computes : tuple of str
        What of a configuration is computed, in what is timed and in what is judged.
    driven_by : str
        Who goes from configuration to configuration and iterates.
    what : str
        What is computed how, in one line for a reader of the table.
    run : callable
        What is timed.
    count : int
        How many configurations, or Newton iterations, one call is.
    accuracy : callable
        Returns how right the answers are.
    """

    name: str
    computes: tuple[str, ...]
    driven_by: str
    what: str
    run: Callable[[], object]
    count: int
    accuracy: Callable[[], Accuracy]
    unit: str = CONFIGURATION


def of_four_bars(
    name: str,
    work: FourBars,
    run: Callable[[], object],
    pieces: Callable[[], Iterable[Piece]],
    *,
    driven_by: str,
    what: str,
    timed: FourBars | None = None,
    computes: tuple[str, ...] = LEVELS,
) -> Route:
    """Return a route that answers four-bars; `timed` is the part of the work that one call of `run` does."""
    count = (timed or work).configurations
    return Route(name, computes, driven_by, what, run, count, lambda: judged(work, pieces()))


def whole(work: FourBars, mechanisms: Any, levels: Iterable[Any], rows: Any = range(9)) -> Piece:
    """Return the answers of some mechanisms at all times as a piece; each level is (rows, M, T)."""
    count = len(work.t)
    return Piece(
        np.repeat(mechanisms, count),
        np.tile(np.arange(count), len(mechanisms)),
        rows,
        tuple(np.reshape(level, (len(rows), -1)) for level in levels),
    )


def chunks(work: FourBars) -> Iterator[Any]:
    """Yield the numbers of the mechanisms of a work, a chunk at a time."""
    for start in range(0, work.mechanisms, CHUNK):
        yield np.arange(start, min(start + CHUNK, work.mechanisms))
