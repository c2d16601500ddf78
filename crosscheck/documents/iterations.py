"""Digits after each Newton iteration, on the four-bar of section 3.11 of the notes on Shabana.

The notes stop after the first correction and print velocities and accelerations there with five digits. How many of
them are right is computed here, as is what the next iterations would have given. The truth is a root proved in balls.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np

from crosscheck.documents.ledger.arithmetic import Arithmetic, Balls, Binary64
from crosscheck.documents.ledger.rows import read
from crosscheck.documents.ledger.shabana_four_bar import estimate, four_bar, rates
from crosscheck.engines import QUANTITIES
from crosscheck.judge.comparison import MOST_DIGITS

ROW = "D12"
ITERATIONS = 5
TRUTH_BITS = 256
PRINTED = {"velocity": "omega", "acceleration": "alpha"}
"""Quantity -> its name in the ledger."""

Levels = Sequence[Sequence[Any]]


def digits_by_iteration() -> list[dict[str, Any]]:
    """Return rows of iteration, quantity, digits: the fewest over coupler and rocker, relative to the number itself.

    The rows with the iteration "printed" are of what the notes print.
    """
    row = next(row for row in read().row if row.id == ROW)
    truth = _truth(row.inputs)
    found = [(str(k), at) for k, at in enumerate(_iterates(Binary64(), row.inputs))]
    rows = [
        {"iteration": name, "quantity": quantity, "digits": _fewest(level, right)}
        for name, levels in found
        for quantity, level, right in zip(QUANTITIES, levels, truth, strict=True)
    ]
    values = {value.name: value for value in row.values}
    for quantity, name in PRINTED.items():
        level = [float(x) for x in values[name].printed]
        right = truth[QUANTITIES.index(quantity)]
        rows.append({"iteration": "printed", "quantity": quantity, "digits": _fewest(level, right)})
    return rows


def _iterates(n: Arithmetic, given: Mapping[str, Any]) -> list[Levels]:
    """Return (q, qd, qdd) at the estimate and after each iteration."""
    system = four_bar(n, given)
    history = n.newton(system, estimate(n, given), ITERATIONS)
    return [(q, *rates(n, given, system, q)[::2]) for q in history.iterates]


def _truth(given: Mapping[str, Any]) -> Levels:
    balls = Balls(TRUTH_BITS)
    with balls.at_precision():
        system = four_bar(balls, given)
        q = balls.root(system, estimate(balls, given))
        qd, _, qdd = rates(balls, given, system, q)
        return [[float(x) for x in level] for level in (q, qd, qdd)]


def _fewest(level: Any, truth: Any) -> float:
    """Return the digits of the worst of the coordinates that are not held by the driver."""
    worst = max(abs(float(a) - b) / abs(b) for a, b in zip(level[1:], truth[1:], strict=True))
    return min(MOST_DIGITS, float(-np.log10(worst))) if worst else MOST_DIGITS
