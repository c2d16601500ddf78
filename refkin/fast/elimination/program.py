"""A program: instructions on numbered registers, by segments, and its text for a person."""

from __future__ import annotations

from collections import Counter
from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any, NamedTuple

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
        return text(self)


FORMATS: Mapping[str, str] = {
    "add": "{0} + {1}",
    "sub": "{0} - {1}",
    "mul": "{0} * {1}",
    "div": "{0} / {1}",
    "neg": "-{0}",
    "abs": "abs({0})",
    "max": "{0} if {0} > {1} else {1}",
    "min": "{0} if {0} < {1} else {1}",
    "greater": "{0} > {1}",
    "select": "{1} if {0} else {2}",
    "cos": "cos({0})",
    "sin": "sin({0})",
    "tan": "tan({0})",
    "copy": "{0}",
}


def statement(instruction: Instruction) -> str:
    """Return an instruction as a Python statement."""
    args = [str(a) for a in instruction.args]
    value: Any = instruction.value
    if instruction.op == "profile":
        right = f"profile({value[0]}, {value[1]}, {args[0]})"
    elif instruction.op == "inverse":
        right = f"inverse({value}, {', '.join(args)})"
    elif instruction.op == "apply":
        right = f"apply({', '.join(args)})"
    elif instruction.op == "entry":
        right = f"{args[0]}[{value}]"
    else:
        right = FORMATS[instruction.op].format(*args)
    return f"{instruction.out} = {right}"


def text(program: Program) -> str:
    """Return a program as text: where inputs and outputs are, then each segment with its count."""
    lines = [f"# core coordinates {list(program.core)} in blocks {[list(b) for b in program.blocks]}"]
    lines += [f"# {size} registers in bank {bank}" for bank, size in program.sizes.items() if size]
    lines += [f"{register} = {number!r}" for register, number in program.constants.items()]
    for leaf, register in program.inputs.items():
        lines.append(f"{register} = {leaf.kind}[{', '.join(map(str, leaf.place))}]")
    for name in SEGMENTS:
        operations = ", ".join(f"{k} {op}" for op, k in program.operations(name).most_common())
        lines += ["", f"# {name}: {len(program.segments[name])} instructions ({operations})"]
        lines += [statement(i) for i in program.segments[name]]
    out = program.outputs
    names = ("q", "qd", "qdd")
    lines += [
        "",
        *(f"# {name} = w{rows[0]} ... w{rows[-1]}" for name, rows in zip(names, out.levels, strict=True) if rows),
    ]
    return "\n".join([*lines, f"# step = w{out.step}", ""])
