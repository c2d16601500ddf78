"""Tracing: the formulas of a mechanism run on symbols, which leaves the expressions of its equations.

No formula is stated here. A `System` is given symbols for its geometry, its laws' values and its coordinates, and its
own methods are called. Numbers of the geometry that are exactly 0, 1 or -1 are part of the structure and fold away (an
axis along a coordinate, a point at its body's origin); all others are inputs, so one compiled structure serves every
mechanism with the same joints and the same such numbers.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from refkin.proof.numbers.symbols import Graph, Symbol, coordinates, symbolic_system
from refkin.system import System

Known = tuple[tuple[float | None, ...], ...]
"""Per constraint, the numbers of its geometry that are structure: 0, 1 or -1; None stands for an input."""
STRUCTURE = {0.0: 0.0, 1.0: 1.0, -1.0: -1.0}
"""The numbers that are structure; -0.0 is found as 0.0."""


@dataclass(frozen=True)
class Traced:
    """The n equations phi = 0, phi_q qd = nu, phi_q qdd = gamma as symbols in q[c] and qd[c].

    Attributes
    ----------
    phi, nu, gamma : list of Symbol
    phi_q : list of dict
        Per row, the entries that are not zero, by coordinate.
    """

    graph: Graph
    phi: list[Symbol]
    phi_q: list[dict[int, Symbol]]
    nu: list[Symbol]
    gamma: list[Symbol]


def trace(system: System, known: Known, rows: Sequence[int], held: bool = False) -> Traced:
    """Return the traced equations of a system, on all levels: scheduling leaves out what nobody calls for.

    What is passive is held as it was estimated, so that poses are functions of time; or, `held`, as laws say.

    Parameters
    ----------
    system : System
    known : tuple
        As `known_of` returns it.
    rows : sequence of int
        The n rows to trace: all, or independent ones where there are more.
    held : bool
        What is passive moves as laws say.
    """
    graph = Graph()
    geometry = [
        tuple(graph.input("g", k, m) if x is None else graph.constant(x) for m, x in enumerate(numbers))
        for k, numbers in enumerate(known)
    ]
    symbolic = symbolic_system(system, graph, geometry, held=held)
    q, qd = (coordinates(graph, kind, system.n) for kind in ("q", "qd"))
    slope = [list(map(graph.lift, row)) for row in symbolic.phi_q(q, 0.0)[list(rows)]]
    right = symbolic.phi(q, 0.0), symbolic.nu(q, 0.0), symbolic.gamma(q, qd, 0.0)
    phi, nu, gamma = ([graph.lift(values[row]) for row in rows] for values in right)
    return Traced(graph, phi, [{c: x for c, x in enumerate(row) if not x.zero} for row in slope], nu, gamma)


def known_of(geometry: Sequence[Sequence[Any]]) -> Known:
    """Return which numbers of a geometry are 0, 1 or -1, in every sample where they are rows."""
    return tuple(tuple(_known(x) for x in numbers) for numbers in geometry)


def _known(x: Any) -> float | None:
    if isinstance(x, float):
        return STRUCTURE.get(x)
    return next((n for n in STRUCTURE if np.all(x == n)), None)
