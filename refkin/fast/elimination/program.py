"""A program: instructions on numbered registers, by segments; its text for a person; one sample at a time.

A program becomes Python functions, which beat NumPy calls on a few samples by far. Their source is the program's own
text, with the Newton segment in a loop. Nothing of a scene is in that text but numbers of registers, so there is
nothing in it that somebody else wrote.
"""

from __future__ import annotations

import math
from collections import Counter
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from typing import Any, NamedTuple

import numpy as np

from refkin.proof.numbers.symbols import Leaf

SEGMENTS = ("mechanism", "time", "newton", "answer")
"""In the order in which they are run; `schedule` says what is in which."""


class Register(NamedTuple):
    """Where a number is: bank `u`, `w`, `m` or `x`, and which of its registers."""

    bank: str
    number: int

    def __str__(self) -> str:
        return f"{self.bank}{self.number}"


@dataclass(frozen=True)
class Instruction:
    """`out` becomes `op` of `args`; see `symbols.Symbol` for the operations, and `copy`."""

    op: str
    out: Register
    args: tuple[Register, ...]
    value: object = None


@dataclass(frozen=True)
class Outputs:
    """Which registers of the `w` bank hold what after a run.

    Attributes
    ----------
    levels : tuple of range
        Coordinates, velocities, accelerations, in the order of the system; empty if not called for.
    core : tuple of int
        The core coordinates: read by `newton` and overwritten by it.
    step : int
        The largest core correction of the last `newton`.
    determinants, pivots : range
        Per block.
    """

    levels: tuple[range, range, range]
    core: tuple[int, ...]
    step: int
    determinants: range
    pivots: range


@dataclass(frozen=True)
class Program:
    """Instructions by segment, and where inputs and outputs are.

    Attributes
    ----------
    constants : dict
        Register of the `u` bank -> number.
    inputs : dict
        Leaf -> register.
    sizes : dict
        Bank -> number of registers.
    """

    segments: Mapping[str, tuple[Instruction, ...]]
    constants: Mapping[Register, float]
    inputs: Mapping[Leaf, Register]
    outputs: Outputs
    sizes: Mapping[str, int]
    core: tuple[int, ...]
    blocks: tuple[tuple[int, ...], ...]

    def counts(self) -> dict[str, int]:
        """Return the number of instructions of each segment."""
        return {name: len(self.segments[name]) for name in SEGMENTS}

    def operations(self, segment: str) -> Counter[str]:
        """Return how often each operation stands in a segment."""
        return Counter(i.op for i in self.segments[segment])

    def __str__(self) -> str:
        """Return the program as text: where inputs and outputs are, then each segment with its count."""
        lines = [f"# core coordinates {list(self.core)} in blocks {[list(b) for b in self.blocks]}"]
        lines += [f"# {size} registers in bank {bank}" for bank, size in self.sizes.items() if size]
        lines += [f"{register} = {number!r}" for register, number in self.constants.items()]
        for leaf, register in self.inputs.items():
            lines.append(f"{register} = {leaf.kind}[{', '.join(map(str, leaf.place))}]")
        for name in SEGMENTS:
            operations = ", ".join(f"{k} {op}" for op, k in self.operations(name).most_common())
            lines += ["", f"# {name}: {len(self.segments[name])} instructions ({operations})"]
            lines += [statement(i) for i in self.segments[name]]
        out = self.outputs
        names = ("q", "qd", "qdd")
        lines += [
            "",
            *(f"# {name} = w{rows[0]} ... w{rows[-1]}" for name, rows in zip(names, out.levels, strict=True) if rows),
        ]
        return "\n".join([*lines, f"# step = w{out.step}", ""])


FORMATS: Mapping[str, str] = {
    "add": "{0} + {1}",
    "sub": "{0} - {1}",
    "mul": "{0} * {1}",
    "div": "{0} / {1}",
    "neg": "-{0}",
    "abs": "abs({0})",
    "max": "{0} if {0} > {1} else {1}",
    "greater": "{0} > {1}",
    "select": "{1} if {0} else {2}",
    "cos": "cos({0})",
    "sin": "sin({0})",
    "tan": "tan({0})",
    "copy": "{0}",
    "profile": "profile({value[0]}, {value[1]}, {0})",
    "inverse": "inverse({value}, {args})",
    "apply": "apply({args})",
    "entry": "{0}[{value}]",
}


def statement(instruction: Instruction) -> str:
    """Return an instruction as a Python statement."""
    args = [str(a) for a in instruction.args]
    right = FORMATS[instruction.op].format(*args, args=", ".join(args), value=instruction.value)
    return f"{instruction.out} = {right}"


class StepAnswer(NamedTuple):
    """What `Single.advance` returns.

    Attributes
    ----------
    levels : tuple of three tuples
        The wanted coordinates, their rates, their accelerations; empty if the program has none.
    determinants, pivots : tuple
        Per block.
    steps : list of float
        The largest core correction of each Newton step.
    """

    levels: tuple[tuple[float, ...], ...]
    determinants: tuple[float, ...]
    pivots: tuple[float, ...]
    steps: list[float]


class Single(NamedTuple):
    """The functions of a program.

    Attributes
    ----------
    prepare : callable
        Numbers of the geometry, in the order of `geometry` -> numbers of the `u` bank.
    advance : callable
        (u, f, q, profile, most, enough) -> StepAnswer: Newton from the core q, then the rest. `f` are the laws'
        values in the order of `laws`; at most `most` Newton steps are made, and none after one of at most `enough`.
        Numbers that fail raise ArithmeticError or ValueError.
    geometry, laws : list of tuple
        (constraint, number) and (constraint, law, order) of the inputs.
    """

    prepare: Callable[[Sequence[float]], tuple[float, ...]]
    advance: Callable[..., StepAnswer]
    geometry: list[tuple[int, ...]]
    laws: list[tuple[int, ...]]


def compile_single(program: Program, wanted: Sequence[int]) -> Single:
    """Return the functions of a program whose answer is about the coordinates `wanted`."""
    scope = {
        "cos": math.cos,
        "sin": math.sin,
        "tan": math.tan,
        "inverse": _inverse,
        "apply": lambda inverse, *right: (inverse[2] @ np.array(right)).tolist(),
        "StepAnswer": StepAnswer,
    }
    exec(compile(source(program, wanted), "<program>", "exec"), scope)
    places = {kind: [leaf.place for leaf in program.inputs if leaf.kind == kind] for kind in "gf"}
    prepare: Any = scope["prepare"]
    advance: Any = scope["advance"]
    return Single(prepare, advance, places["g"], places["f"])


def source(program: Program, wanted: Sequence[int]) -> str:
    """Return the source of the functions."""
    inputs = {kind: [str(r) for leaf, r in program.inputs.items() if leaf.kind == kind] for kind in "gf"}
    core = [f"w{k}" for k in program.outputs.core]
    u = [f"u{k}" for k in range(program.sizes["u"])]
    levels = [[f"w{rows[c]}" for c in wanted if rows] for rows in program.outputs.levels]
    evidence = [_tuple([f"w{k}" for k in rows]) for rows in (program.outputs.determinants, program.outputs.pivots)]
    prepare = [
        *_unpacked(inputs["g"], "g"),
        *(f"{register} = {number!r}" for register, number in program.constants.items()),
        *map(statement, program.segments["mechanism"]),
        f"return {_tuple(u)}",
    ]
    step = f"w{program.outputs.step}"
    newton = [*map(statement, program.segments["newton"]), f"steps.append({step})", f"if {step} <= enough: break"]
    advance = [
        *_unpacked(u, "u"),
        *_unpacked(inputs["f"], "f"),
        *_unpacked(core, "q"),
        *map(statement, program.segments["time"]),
        "steps = []",
        "for _ in range(most):",
        *("    " + line for line in newton),
        *map(statement, program.segments["answer"]),
        f"return StepAnswer({_tuple([_tuple(level) for level in levels])}, {', '.join(evidence)}, steps)",
    ]
    return "\n".join(
        [
            "def prepare(g):",
            *("    " + line for line in prepare),
            "def advance(u, f, q, profile, most, enough):",
            *("    " + line for line in advance),
            "",
        ]
    )


def _unpacked(names: Sequence[str], given: str) -> list[str]:
    return [f"{_tuple(names)} = {given}"] if names else []


def _tuple(names: Sequence[str]) -> str:
    return f"({', '.join(names)},)" if names else "()"


def _inverse(size: int, *entries: float) -> tuple[Any, ...]:
    matrix = np.array(entries).reshape(size, size)
    try:
        inverse = np.linalg.inv(matrix)
    except np.linalg.LinAlgError:
        raise ZeroDivisionError("a singular block") from None
    largest = float(np.max(np.sum(np.abs(inverse), axis=1)))
    if not largest < math.inf:  # of entries beyond all numbers NumPy would warn whoever runs this
        raise OverflowError("a block without a finite inverse")
    return float(np.linalg.slogdet(matrix)[0]), 1.0 / largest, inverse
