"""The equations of a system as a straight-line program, for who asks for their numbers again and again.

No formula is stated here: the joints' own run on symbols (`proof.numbers.symbols`), which leaves one list of operations
for phi and phi_q together, each of them once, without what is always 0 or 1. On floats, or rows of them, it gives the
numbers that the formulas give, to the last bit, in a fifth of the time. Balls and all else that carries a proof take
the formulas themselves.
"""

from __future__ import annotations

import operator
from collections.abc import Sequence
from dataclasses import dataclass, field, fields
from typing import Any

import numpy as np

from refkin.proof.numbers.bounded import NoFormula
from refkin.proof.numbers.symbols import Graph, Symbol, coordinates, needed, symbolic_system
from refkin.system import System
from refkin.vec import cosine_and_sine


@dataclass(frozen=True)
class StraightLineSystem(System):
    """A system whose phi and phi_q at floats are run from a program, as long as it is that of what is `placed`."""

    program: StraightLineProgram = field(kw_only=True, repr=False, compare=False)

    @classmethod
    def of(cls, system: System) -> StraightLineSystem:
        """Return a system with its equations written out."""
        return cls(
            **{f.name: getattr(system, f.name) for f in fields(System) if f.init}, program=StraightLineProgram(system)
        )

    def phi(self, q: Any, t: Any) -> Any:
        """Return the constraint residual, (m,) or (m, B)."""
        values = self._values_at(q, t)
        return super().phi(q, t) if values is None else _filled(self.program.phi, values, q.shape[1:])

    def phi_q(self, q: Any, t: Any) -> Any:
        """Return the constraint Jacobian, (m, n) or (m, n, B)."""
        values = self._values_at(q, t)
        return super().phi_q(q, t) if values is None else _filled(self.program.phi_q, values, q.shape[1:])

    def _values_at(self, q: Any, t: Any) -> Any:
        """Return what all operations give, kept from phi to phi_q; None for other numbers, or of other equations."""
        real = isinstance(t, float) or (isinstance(t, np.ndarray) and t.dtype == float)
        if not (real and isinstance(q, np.ndarray) and q.dtype == float and self.program.placed is self.placed):
            return None
        key = (q.tobytes(), q.shape, t if isinstance(t, float) else t.tobytes())
        kept = self._kept.get("values")
        if kept is None or kept[0] != key:
            kept = self._kept["values"] = (key, self._run(q, t))
        return kept[1]

    def _run(self, q: Any, t: Any) -> list[Any]:
        values = self.program.start.copy()
        values[: self.n] = q.tolist() if q.ndim == 1 else q.copy()
        for p, inputs in self.program.inputs:
            held = self.gauge.get(p.row, p.g)
            given = [law[0] for law in self._laws_at(p, t, 0)] if p.constraint.laws else held
            for place, number in inputs:
                values[place] = given[number]
        for place, operation, a, b in self.program.steps:
            values[place] = operation(values[a], values[b])
        return values


class StraightLineProgram:
    """The operations of phi and phi_q, on places in a list of values; the coordinates are the first of these.

    Attributes
    ----------
    placed : tuple of ConstraintRows
        The constraints whose equations these are.
    start : list
        The values before anything is done: the constants.
    inputs : list
        (constraint, its (place, number) pairs): where the values of its laws go, or what it holds the passive by.
    steps : list
        (place, operation, place, place) in order.
    phi, phi_q : tuple
        An array of the constants, the numbers of the entries that are none, and the places of their values.
    """

    def __init__(self, system: System) -> None:
        graph, self.placed = Graph(), system.placed
        geometry = [tuple(map(graph.constant, p.g)) for p in system.placed]
        q, symbolic = coordinates(graph, "q", system.n), symbolic_system(system, graph, geometry, held=True)
        phi, phi_q = symbolic.phi(q, 0.0), symbolic.phi_q(q, 0.0)
        rest = needed([s for s in (*phi, *phi_q.flat) if isinstance(s, Symbol)], dict.fromkeys(q))
        places = {s: k for k, s in enumerate([*q, *rest])}
        self.start: list[Any] = [s.value if s.op == "const" else None for s in places]
        inputs: dict[int, list[tuple[int, int]]] = {}
        self.steps: list[tuple[Any, ...]] = []
        for s in rest:
            if s.op == "input":
                inputs.setdefault(s.value.place[0], []).append((places[s], s.value.place[1]))
            elif s.op not in ("const", "profile", *OPERATIONS):
                kinds = ", ".join(sorted({p.constraint.type for p in self.placed}))
                raise NoFormula(f"{s.op!r}, in one of: {kinds}")
            elif s.op != "const":
                operation = self._profile(system, *s.value) if s.op == "profile" else OPERATIONS[s.op]
                self.steps.append((places[s], operation, places[s.args[0]], places[s.args[-1]]))
        self.inputs = [(system.placed[k], pairs) for k, pairs in inputs.items()]
        self.phi, self.phi_q = _result(phi, places), _result(phi_q, places)

    @staticmethod
    def _profile(system: System, k: int, order: int) -> Any:
        constraint = system.placed[k].constraint
        return lambda s, _: constraint.profile_values(s, system.unit, order)[order]


OPERATIONS = {
    "add": operator.add,
    "sub": operator.sub,
    "mul": operator.mul,
    "neg": lambda x, _: -x,
    "cos": lambda x, _: cosine_and_sine(x)[0],
    "sin": lambda x, _: cosine_and_sine(x)[1],
}
"""What is done with the values of two places; that of one has it twice."""


def _result(entries: Any, places: dict[Symbol, int]) -> tuple[Any, Any, Sequence[int]]:
    symbols = {k: s for k, s in enumerate(entries.flat) if isinstance(s, Symbol)}
    constants = np.array([0.0 if k in symbols else float(s) for k, s in enumerate(entries.flat)])
    return constants.reshape(entries.shape), np.array(list(symbols), int), [places[s] for s in symbols.values()]


def _filled(result: tuple[Any, Any, Sequence[int]], values: list[Any], batch: tuple[int, ...]) -> Any:
    """Return entries (...,) or (..., B) from the values of all places."""
    constants, entries, places = result
    if not batch:
        out = constants.copy()
        out.reshape(-1)[entries] = [values[k] for k in places]
        return out
    out = np.empty((*constants.shape, *batch))
    out[...] = constants[..., None]
    rows = out.reshape(-1, *batch)
    for k, place in zip(entries.tolist(), places, strict=True):
        rows[k] = values[place]
    return out
