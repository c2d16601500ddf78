"""What is made once of a topology, and kept: its programs, and the workspaces they run on.

Two mechanisms have the same topology if their constraints are of the same kinds between the same bodies in the same
order, and the same numbers of their geometry are 0, 1 or -1. Lengths, angles, laws and profiles are inputs.
"""

from __future__ import annotations

from collections import OrderedDict
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass
from functools import cached_property
from threading import RLock
from typing import Any

from refkin.fast.elimination.eliminate import Eliminated, eliminate
from refkin.fast.elimination.groups import NotReducible
from refkin.fast.elimination.program import Program
from refkin.fast.elimination.prove import Proof, proof_of
from refkin.fast.elimination.run import Workspace
from refkin.fast.elimination.schedule import schedule
from refkin.fast.elimination.single import Single, compile_single
from refkin.fast.elimination.symbols import Graph
from refkin.fast.elimination.trace import Known, known_of, trace
from refkin.model import Effect
from refkin.system import System

MOST_KEPT = 64
"""How many topologies are kept; the one that was used longest ago goes first."""
MOST_IDLE, MOST_IDLE_BYTES = 2, 2**21
"""How many workspaces of one topology wait to be used again, and how large; larger ones are cheap to make anew."""


@dataclass
class Compiled:
    """A topology's solution by expressions, and what is made of it on demand.

    Attributes
    ----------
    levels : int
        1 for positions alone, 2 with velocities, 3 with accelerations: what `program` answers.
    depends : dict
        Per coordinate, those that its own equations hold.
    system, known : System, tuple
        A system of this topology, and which numbers of its geometry are structure.
    """

    solved: Eliminated
    graph: Graph
    levels: int
    depends: dict[int, set[int]]
    system: System
    known: Known

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

    @cached_property
    def proof(self) -> Proof | None:
        """The certificate of answers on all called-for levels; None if a program cannot give it."""
        system = self.system
        plain = system.m == system.n == system.of_bodies
        return proof_of(system, self.known, self.levels) if plain else None

    @cached_property
    def solving(self) -> Workspaces:
        """Workspaces of `program`."""
        return Workspaces(self.program)

    @cached_property
    def proving(self) -> Workspaces:
        """Workspaces of `proof`."""
        assert self.proof is not None
        return Workspaces(self.proof.program)


class Workspaces:
    """The workspaces of a program for one mechanism at a time, a few of which are kept."""

    def __init__(self, program: Program) -> None:
        self.program = program
        self._idle: list[Workspace] = []

    @contextmanager
    def workspace(self, samples: int) -> Iterator[Workspace]:
        """Lend a workspace for so many samples; nobody else has it meanwhile."""
        try:
            space = self._idle.pop()  # atomic, as append is: threads never share a workspace
        except IndexError:
            space = None
        if space is None or space.samples != samples:
            space = Workspace(self.program, samples)
        yield space
        space.rest()
        if len(self._idle) < MOST_IDLE and space.nbytes <= MOST_IDLE_BYTES:
            self._idle.append(space)


_kept: OrderedDict[Any, Compiled | None] = OrderedDict()
_lock = RLock()


def compiled(system: System, rows: Sequence[int], geometry: Sequence[Sequence[Any]]) -> Compiled | None:
    """Return what is made of a system's topology; None if its equations have no solution by their structure alone.

    Parameters
    ----------
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
        solved = eliminate(traced)
    except NotReducible:
        return None
    by_row = [set(row) for row in traced.phi_q]
    depends = {c: by_row[r] for c, r in solved.stated_by.items()}
    for block in solved.blocks:
        together = set().union(*(by_row[solved.matched[c]] for c in block))
        depends.update((c, together) for c in block)
    return Compiled(solved, traced.graph, levels_of(system), depends, system, known)


def levels_of(system: System) -> int:
    """Return how many levels a system's effects call for; accelerations come with velocities."""
    if Effect.ACCELERATION in system.effects:
        return 3
    return 2 if Effect.VELOCITY in system.effects else 1
