"""Scheduling: from expressions to a program, a list of instructions on numbered registers.

Instructions come in four segments, each run as often as what it depends on changes, and no more:

========= =============================== =============================
mechanism of geometry alone               once for a mechanism
time      of geometry and laws            once for each time
newton    of the core coordinates as well once for each Newton step
answer    of the core coordinates as well once
========= =============================== =============================

What no output needs is in no segment. Registers of the `u` bank hold one number for each mechanism, those of the `w`
bank one for each sample, `m` masks and `x` inverses and solutions of whole blocks. A register is used again as soon as
its value is not needed any more (liveness), which keeps a block of samples in the cache.
"""

from __future__ import annotations

import heapq
from collections import Counter
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, field

from refkin.fast.elimination.eliminate import Eliminated
from refkin.fast.elimination.program import Instruction, Outputs, Program, Register
from refkin.proof.numbers.symbols import Graph, Leaf, Symbol, needed, substitute

NOT_COMPUTED = ("const", "input")
MASKS = ("greater",)
OBJECTS = ("inverse", "apply")
WHOLE = ("profile", "select", *OBJECTS)
"""Operations that write before they have read all arguments, or more than one register: they share none with those."""
ON_SAMPLES = (*MASKS, *WHOLE, "entry")

Wanted = Sequence[Sequence[int]]
"""Per level, called-for coordinates: of positions, of velocities, of accelerations; one to three levels."""


def schedule(solved: Eliminated, graph: Graph, wanted: Wanted, *, half_angles: bool = True) -> Program:
    """Return the program of a solution.

    Parameters
    ----------
    solved, graph : Eliminated, Graph
        The solution, and the graph of its expressions.
    wanted : sequence of sequences of int
        Which coordinates, which rates, which accelerations are computed; others only as far as these need them.
    half_angles : bool
        Take sine and cosine from the tangent of half the angle, which on rows takes a third of the time or less.
    """
    return _Scheduler(solved, graph, wanted, half_angles).program()


class _Scheduler:
    """A program while it is laid out: where each symbol's value is, and which registers there are."""

    def __init__(self, solved: Eliminated, graph: Graph, wanted: Wanted, half_angles: bool) -> None:
        self.solved, self.graph = solved, graph
        self.wanted = [set(level) for level in (*wanted, (), ())][:3]
        self.levels = [level if some else [] for level, some in zip(solved.levels, self.wanted, strict=True)]
        self.done: dict[Symbol, Symbol] = {}
        self.rule = half_angled if half_angles else None
        self.at: dict[Symbol, Register] = {}
        self.sizes = {"u": 0, "w": 0, "m": 0, "x": 0}

    def program(self) -> Program:
        """Return the program: registers for all values that are needed, instructions by segment."""
        outputs = self._outputs()
        newton, answer = self._targets(outputs)
        stages = stages_of([*newton, *answer])
        leaves = [s for s in stages if s.op == "input" and s.value.kind != "q"]
        for leaf in sorted(leaves, key=lambda s: s.value):
            self.at[leaf] = self.new("u" if leaf.value.kind == "g" else "w")
        for c, row in zip(self.solved.core, outputs.core, strict=True):
            self.at[self.graph.input("q", c)] = Register("w", row)
        constants = {self._placed(s, "u"): s.value for s in stages if s.op == "const"}
        segments = self._segments(stages, newton, answer)
        return Program(
            segments,
            constants,
            {s.value: r for s, r in self.at.items() if s.op == "input"},
            outputs,
            self.sizes,
            tuple(self.solved.core),
            tuple(self.solved.blocks),
        )

    def _outputs(self) -> Outputs:
        """Lay out the outputs: levels one after another, so that each is one slice of the bank."""
        levels = [self._range(len(level)) for level in self.levels]
        blocks = len(self.solved.blocks)
        return Outputs(
            levels=(levels[0], levels[1], levels[2]),
            core=tuple(levels[0][c] for c in self.solved.core),
            step=self._range(1)[0],
            determinants=self._range(blocks),
            pivots=self._range(blocks),
        )

    def _targets(self, outputs: Outputs) -> tuple[dict[Symbol, list[int]], dict[Symbol, list[int]]]:
        """Return what `newton` and `answer` are to leave in which registers."""
        newton: dict[Symbol, list[int]] = {}
        step = self.graph.constant(0.0)
        for c, correction in zip(self.solved.core, [*map(self._of, self.solved.corrections)], strict=True):
            size = abs(correction)
            step = size if step.zero else self.graph.node("max", step, size)
            moved = self.graph.input("q", c) - correction
            newton.setdefault(moved, []).append(outputs.levels[0][c])
        newton.setdefault(step, []).append(outputs.step)
        answer: dict[Symbol, list[int]] = {}
        for level, rows, wanted in zip(self.levels, outputs.levels, self.wanted, strict=True):
            for c, symbol in enumerate(level):
                if c in wanted and not (symbol.op == "input" and symbol.value == Leaf("q", (c,))):
                    answer.setdefault(self._of(symbol), []).append(rows[c])
        for symbols, rows in ((self.solved.determinants, outputs.determinants), (self.solved.pivots, outputs.pivots)):
            for symbol, row in zip(symbols, rows, strict=True):
                answer.setdefault(self._of(symbol), []).append(row)
        return newton, answer

    def _segments(
        self, stages: Mapping[Symbol, str], newton: dict[Symbol, list[int]], answer: dict[Symbol, list[int]]
    ) -> dict[str, tuple[Instruction, ...]]:
        first = [s for s in stages if stages[s] == "mechanism" and s.op not in NOT_COMPUTED]
        instructions = {"mechanism": tuple(self._instruction(s, self._placed(s, "u")) for s in first)}
        held = [s for s in stages if stages[s] == "time" and s.op not in NOT_COMPUTED]
        repeated = {a for s in stages if stages[s] == "core" for a in s.args} | answer.keys() | newton.keys()
        pool = _Pool(self)
        for symbol in held:
            if symbol in repeated:
                rows = answer.get(symbol)
                self.at[symbol] = Register("w", rows[0]) if rows else self.new(bank_of(symbol))
        instructions["time"] = self._segment(held, {}, pool)
        for name, targets in (("newton", newton), ("answer", answer)):
            symbols = [s for s in needed(targets) if stages[s] == "core" and s.op not in NOT_COMPUTED]
            instructions[name] = self._segment(symbols, targets, pool, at_end=name == "newton")
            for symbol in symbols:
                self.at.pop(symbol, None)
        return instructions

    def _segment(
        self, symbols: list[Symbol], targets: Mapping[Symbol, list[int]], pool: _Pool, at_end: bool = False
    ) -> tuple[Instruction, ...]:
        """Return the instructions for symbols in an order that respects arguments; targets at their registers.

        `at_end`: what overwrites its own input comes last.
        """
        if at_end:
            symbols = [s for s in symbols if s not in targets] + [s for s in symbols if s in targets]
        uses = Counter(a for s in symbols for a in s.args)
        out = []
        for symbol in symbols:
            shares = symbol.op not in WHOLE  # its register may be that of an argument
            if shares:
                pool.release(symbol.args, uses)
            if symbol in targets:
                self.at[symbol] = Register("w", targets[symbol][0])
            elif symbol not in self.at:
                self.at[symbol] = pool.take(symbol)
            out.append(self._instruction(symbol, self.at[symbol]))
            if not shares:
                pool.release(symbol.args, uses)
        pool.forget()
        for symbol, rows in targets.items():
            for row in rows:  # what is wanted in several places, or was there before
                if self.at[symbol] != Register("w", row):
                    out.append(Instruction("copy", Register("w", row), (self.at[symbol],)))
        return tuple(out)

    def _instruction(self, symbol: Symbol, out: Register) -> Instruction:
        return Instruction(symbol.op, out, tuple(self.at[a] for a in symbol.args), symbol.value)

    def _of(self, symbol: Symbol) -> Symbol:
        return substitute(symbol, self.done, self.rule) if self.rule else symbol

    def new(self, bank: str) -> Register:
        """Return a register that nobody has had."""
        self.sizes[bank] += 1
        return Register(bank, self.sizes[bank] - 1)

    def _placed(self, symbol: Symbol, bank: str) -> Register:
        self.at[symbol] = self.new(bank)
        return self.at[symbol]

    def _range(self, count: int) -> range:
        start = self.sizes["w"]
        self.sizes["w"] += count
        return range(start, start + count)


@dataclass
class _Pool:
    """Registers for values that live within one segment; the lowest that is free is taken."""

    scheduler: _Scheduler
    free: dict[str, list[int]] = field(default_factory=lambda: {"w": [], "m": [], "x": []})
    taken: dict[Symbol, Register] = field(default_factory=dict)

    def take(self, symbol: Symbol) -> Register:
        bank = bank_of(symbol)
        free = self.free[bank]
        register = Register(bank, heapq.heappop(free)) if free else self.scheduler.new(bank)
        self.taken[symbol] = register
        return register

    def release(self, args: Iterable[Symbol], uses: Counter[Symbol]) -> None:
        """Count one use of each argument, and free the registers of those that have none left."""
        for a in args:
            uses[a] -= 1
            if not uses[a] and a in self.taken:
                register = self.taken.pop(a)
                heapq.heappush(self.free[register.bank], register.number)

    def forget(self) -> None:
        """Free what is still taken: a segment has ended."""
        for register in self.taken.values():
            heapq.heappush(self.free[register.bank], register.number)
        self.taken.clear()


def bank_of(symbol: Symbol) -> str:
    """Return the bank in which a sample's value of this symbol is kept."""
    return "m" if symbol.op in MASKS else "x" if symbol.op in OBJECTS else "w"


def stages_of(outputs: Iterable[Symbol]) -> dict[Symbol, str]:
    """Return for each needed symbol on what it depends at most: "mechanism", "time" or "core".

    What is no plain arithmetic is done on samples, even if it depends on the geometry alone.
    """
    order = ("mechanism", "time", "core")
    stages: dict[Symbol, str] = {}
    for symbol in needed(outputs):
        if symbol.op == "input":
            stages[symbol] = {"g": "mechanism", "f": "time", "q": "core"}[symbol.value.kind]
            continue
        least = "time" if symbol.op in ON_SAMPLES else "mechanism"
        stages[symbol] = max((stages[a] for a in symbol.args), key=order.index, default="mechanism")
        stages[symbol] = max(stages[symbol], least, key=order.index)
    return stages


def half_angled(symbol: Symbol, args: tuple[Symbol, ...]) -> Symbol:
    """Return a node again, sine and cosine by t = tan(x / 2): r = 2 / (1 + t^2), cos x = r - 1, sin x = t r.

    On rows a tangent is computed 8 numbers at a time where sine and cosine are not. The absolute error is at most about
    3 units 2^-53 (1 + t^2 and the quotient are rounded once each, r is at most 2), and t is finite for every float.
    """
    if symbol.op not in ("cos", "sin"):
        return symbol.graph.again(symbol, args) if args else symbol
    graph = symbol.graph
    t = graph.node("tan", graph.mul(args[0], graph.constant(0.5)))
    r = graph.constant(2.0) / (graph.constant(1.0) + t * t)
    return r - 1.0 if symbol.op == "cos" else t * r
