"""What is made once of a topology, and kept: its programs, and the workspaces they run on.

Two mechanisms have the same topology if their constraints are of the same kinds between the same bodies in the same
order, and the same numbers of their geometry are 0, 1 or -1. Lengths, angles, laws and profiles are inputs.
"""

from __future__ import annotations

from collections import OrderedDict
from collections.abc import Sequence
from dataclasses import dataclass, field
from functools import cached_property
from threading import RLock
from typing import Any

from refkin.fast.elimination.eliminate import Eliminated, Elimination, NotReducible
from refkin.fast.elimination.program import Program, Single, compile_single
from refkin.fast.elimination.prove import proof_of
from refkin.fast.elimination.run import Workspaces
from refkin.fast.elimination.schedule import schedule
from refkin.fast.elimination.trace import Known, known_of, trace
from refkin.proof.numbers.symbols import Graph
from refkin.system import System

MOST_KEPT = 64
"""How many topologies are kept; the one that was used longest ago goes first."""


@dataclass
class Compiled:
    """A topology's solution by expressions, and what is made of it on demand.

    Attributes
    ----------
    levels : int
        1 for positions alone, 2 with velocities, 3 with accelerations: what `program` answers.
    system, known : System, tuple
        A system of this topology, and which numbers of its geometry are structure.
    """

    solved: Eliminated
    graph: Graph
    levels: int
    system: System
    known: Known
    _proofs: dict[Known, Workspaces | None] = field(default_factory=dict)

    @property
    def n(self) -> int:
        """The number of coordinates."""
        return len(self.solved.levels[0])

    @property
    def core(self) -> tuple[int, ...]:
        """The coordinates in which Newton iterates."""
        return self.solved.core

    @cached_property
    def program(self) -> Program:
        """The program of all coordinates and called-for levels, for rows."""
        return schedule(self.solved, self.graph, [range(self.n)] * self.levels)

    @cached_property
    def marching(self) -> Program:
        """The same with the rates of the core in any case, by which the next pose is predicted."""
        every = [range(self.n)] * self.levels
        return schedule(self.solved, self.graph, every + [self.core] * (3 - self.levels))

    @cached_property
    def march(self) -> Single:
        """All levels of the core coordinates, one sample at a time: what predicts the next pose."""
        program = schedule(self.solved, self.graph, [self.core] * 3, half_angles=False)
        return compile_single(program, self.core)

    @cached_property
    def whole(self) -> Single:
        """The same as `program`, one sample at a time: what finds the first pose, and answers a single one."""
        program = schedule(self.solved, self.graph, [range(self.n)] * self.levels, half_angles=False)
        return compile_single(program, range(self.n))

    def proof(self, zeros: Known) -> Workspaces | None:
        """Return the certificate of answers on all called-for levels; None if a program cannot give it.

        `zeros` are, as `known`, the numbers of the geometry that are 0 exactly: what rounding made 0 is not.
        """
        if zeros not in self._proofs:
            square = self.system.m == self.system.n
            self._proofs[zeros] = proof_of(self.system, zeros, self.levels) if square else None
        return self._proofs[zeros]

    @cached_property
    def solving(self) -> Workspaces:
        """Workspaces of `program`."""
        return Workspaces(self.program)


_kept: OrderedDict[Any, Compiled | None] = OrderedDict()
_lock = RLock()


def compiled(system: System, rows: Sequence[int], geometry: Sequence[Sequence[Any]]) -> Compiled | None:
    """Return what is made of a system's topology; None if its equations have no solution by their structure alone.

    Parameters
    ----------
    system : System
    rows : sequence of int
        The n rows that are solved: all, or independent ones where there are more.
    geometry : sequence
        Per constraint its scaled numbers, or rows of them: only which are 0, 1 or -1 matters.
    """
    known = known_of(geometry)
    kinds = tuple(
        (type(p.constraint), getattr(p.constraint, "contact", None), len(p.constraint.laws), p.starts)
        for p in system.placed
    )
    key = (kinds, known, tuple(rows), system.effects)
    with _lock:
        if key not in _kept:
            _kept[key] = _compile(system, rows, known)
        if len(_kept) > MOST_KEPT:
            _kept.popitem(last=False)
        _kept.move_to_end(key)
        return _kept[key]


def forget() -> None:
    """Drop everything that was compiled, so that the next use compiles again."""
    with _lock:
        _kept.clear()


def _compile(system: System, rows: Sequence[int], known: Known) -> Compiled | None:
    traced = trace(system, known, rows)
    try:
        solved = Elimination(traced).result()
    except NotReducible:
        return None
    return Compiled(solved, traced.graph, 1 + len(system.effects), system, known)
