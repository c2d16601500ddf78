"""Rows that the program leaves out, where there are more than coordinates: all are asked about its answer.

The program solves rows that are independent at the first pose. At a later one they may be nearly dependent, where all
rows together are not: the smallest singular value of those of a Bennett linkage fell from 0.14 to 0.006, that of all
stayed at 0.26. What the solution has lost then lies where its own rows hardly see it, and the others do.
"""

from __future__ import annotations

from typing import Any

import numpy as np

from refkin.newton import ROUND_OFF, is_round_off
from refkin.proof.numbers.bounded import product
from refkin.system import System


def by_all_rows(system: System, levels: list[Any], t: Any) -> list[Any] | None:
    """Return the levels, corrected by all rows in the samples that leave some open; None if these contradict others.

    Rows that contradict each other in a rate lock a pose that they share: the program, which sees some of them, moves.

    Parameters
    ----------
    system : System
    levels : list of (n, T) array
        Coordinates and rates as far as they are called for, in the system's scaled coordinates.
    t : (T,) array
        Times [s].
    """
    with np.errstate(over="ignore", invalid="ignore"):
        lost = np.flatnonzero(~_closed(system, levels, t))
        if not lost.size:
            return levels
        try:
            corrected = _corrected(system, [level[:, lost] for level in levels], t[lost])
        except np.linalg.LinAlgError:  # where numbers are not finite
            return None
        if not _closed(system, corrected, t[lost]).all():
            return None
    for level, better in zip(levels, corrected, strict=True):
        level[:, lost] = better
    return levels


def _closed(system: System, levels: list[Any], t: Any) -> Any:
    """Return in which samples all rows are closed but for rounding, on all levels, (T,)."""
    q, *rates = levels
    here = system.held_at(q)
    closed, slope = is_round_off(here.phi(q, t), q), here.phi_q(q, t) if rates else None
    for order, rate in enumerate(rates, start=1):
        right = _right_side(here, levels[:order], t)
        closed &= _largest(product(slope, rate) - right) <= ROUND_OFF * np.maximum(_largest(rate), _largest(right))
    return closed


def _corrected(system: System, levels: list[Any], t: Any) -> list[Any]:
    """Return the levels after a step of least squares: one inverse serves for all, as what was lost is small."""
    q, *rates = levels
    here = system.held_at(q)
    inverse = np.moveaxis(np.linalg.pinv(np.moveaxis(here.phi_q(q, t), -1, 0)), 0, -1)
    better = [q - product(inverse, here.phi(q, t))]
    here = system.held_at(better[0])
    slope = here.phi_q(better[0], t)
    for rate in rates:
        off = product(slope, rate) - _right_side(here, better, t)
        better.append(rate - product(inverse, off))
    return better


def _right_side(system: System, levels: list[Any], t: Any) -> Any:
    """Return what the rates after these levels solve: nu at a pose, gamma at a pose and its velocity."""
    return system.nu(levels[0], t) if len(levels) == 1 else system.gamma(levels[0], levels[1], t)


def _largest(rows: Any) -> Any:
    return np.max(np.abs(rows), axis=0)
