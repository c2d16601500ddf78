"""Running: a program as NumPy functions over rows, one row for each register, one column for each sample.

A `Workspace` owns its rows. Binding an instruction to them gives a function and its arguments, so that a run is one
loop over calls. Samples do not mix: one that divides by 0 or leaves the numbers' range becomes NaN or infinite, and no
other does.
"""

from __future__ import annotations

from collections.abc import Callable, Collection, Iterator, Mapping, Sequence
from contextlib import contextmanager
from functools import reduce
from operator import getitem
from typing import Any

import numpy as np

from refkin.fast.elimination.program import SEGMENTS, Instruction, Program, Register
from refkin.proof.numbers.preconditioned import inverses

Profile = Callable[[int, int, Any], Any]
"""(constraint, order, parameter) -> the scaled derivative of the constraint's profile at the parameter."""
Call = tuple[Callable[..., Any], tuple[Any, ...]]

MOST_SAMPLES, MOST_BYTES = 10_240, 2**26
"""Samples in a block, and the memory of its registers: with fewer samples calls cost more than the work in them."""
MOST_IDLE, MOST_IDLE_BYTES = 2, 2**21
"""How many workspaces of one topology wait to be used again, and how large; larger ones are cheap to make anew."""
LINE = 8
"""Numbers in a line of the cache: rows start at one, with a line between them so that they do not share a place."""


def _select(mask: Any, x: Any, y: Any, out: Any) -> None:
    """`out` is none of the arguments."""
    np.copyto(out, y)
    np.copyto(out, x, where=mask)


FUNCTIONS: Mapping[str, Callable[..., Any]] = {
    "add": np.add,
    "sub": np.subtract,
    "mul": np.multiply,
    "div": np.divide,
    "neg": np.negative,
    "abs": np.absolute,
    "greater": np.greater,
    "cos": np.cos,
    "sin": np.sin,
    "tan": np.tan,
    "copy": np.positive,
    "max": lambda a, b, out: np.maximum(a, b, out=out),
    "select": _select,
}


def block_samples(program: Program) -> int:
    """Return how many samples a block has at most."""
    return max(256, min(MOST_SAMPLES, MOST_BYTES // (8 * program.sizes["w"])))


class Workspace:
    """The registers of a program for a number of samples, and its segments bound to them.

    Attributes
    ----------
    w : (registers, samples) array
        The `w` bank; inputs are written to it and outputs read from it, see `Program.inputs` and `Program.outputs`.
    """

    def __init__(self, program: Program, samples: int, *, common: Collection[int] | None = None) -> None:
        """Allocate registers; each sample is a time, or, with `common`, a mechanism.

        The laws of the constraints in `common` have one number for all mechanisms, and so has what they alone give.
        """
        self.program, self.samples = program, samples
        self.w = _in_lines(program.sizes["w"], samples)
        # One number for all samples has no dimension: NumPy takes half as long with it as with an array of one number.
        self.u = _in_lines(program.sizes["u"], samples) if common is not None else np.zeros(program.sizes["u"])
        self._masks = np.zeros((program.sizes["m"], samples), bool)
        self._objects: list[Any] = [None] * program.sizes["x"]
        self._profile: Profile | None = None
        banks = (("w", self.w), ("u", self.u), ("m", self._masks))
        self._rows: dict[str, Any] = {bank: [rows[k, ...] for k in range(len(rows))] for bank, rows in banks}
        self._rows["x"] = range(program.sizes["x"])
        given = {r: 0.0 for leaf, r in program.inputs.items() if leaf.kind == "f" and leaf.place[0] in (common or ())}
        self._common = {register: np.array(number) for register, number in {**program.constants, **given}.items()}
        self._calls = {name: [self._bound(i) for i in program.segments[name]] for name in SEGMENTS}

    @property
    def nbytes(self) -> int:
        """The memory of the registers."""
        return sum(bank.base.nbytes if bank.base is not None else bank.nbytes for bank in (self.w, self.u, self._masks))

    def give_geometry(self, geometry: Sequence[Sequence[Any]], profile: Profile | None = None) -> None:
        """Write the geometry, per constraint its numbers or rows, and run what depends on it alone."""
        self._profile = profile
        self._give("g", geometry)
        self.run("mechanism")

    def give_laws(self, laws: Mapping[int, Sequence[Sequence[Any]]]) -> None:
        """Write the laws' values, per constraint by law and order, and run what depends on geometry and laws."""
        self._give("f", laws)
        self.run("time")

    def _give(self, kind: str, numbers: Any) -> None:
        for leaf, register in self.program.inputs.items():
            if leaf.kind == kind:
                self._row(register)[...] = reduce(getitem, leaf.place, numbers)

    def rest(self) -> None:
        """Let go of the mechanism that was run last."""
        self._profile = None

    def core(self) -> list[Any]:
        """Return the rows of the core coordinates: written before `run("newton")`, which overwrites them."""
        return [self._rows["w"][k] for k in self.program.outputs.core]

    def level(self, order: int) -> Any:
        """Return the rows of one level after `run("answer")`: a view, valid until the next run."""
        rows = self.program.outputs.levels[order]
        return self.w[rows.start : rows.stop]

    def row(self, number: int) -> Any:
        """Return one row of the `w` bank."""
        return self._rows["w"][number]

    def run(self, segment: str) -> None:
        """Run one segment on all samples; what becomes of a division by 0 and the like shows in its sample."""
        for function, args in self._calls[segment]:
            function(*args)

    def _bound(self, instruction: Instruction) -> Call:
        op, args = instruction.op, [*map(self._row, instruction.args)]
        out = self._result(instruction, args)
        if op in FUNCTIONS:
            return FUNCTIONS[op], (*args, out)
        own: dict[str, Callable[..., Any]] = {"profile": self._run_profile, "inverse": self._run_inverse}
        own |= {"apply": self._run_apply, "entry": self._run_entry}
        return own[op], (instruction.value, args, out)

    def _row(self, register: Register) -> Any:
        return self._common[register] if register in self._common else self._rows[register.bank][register.number]

    def _result(self, instruction: Instruction, args: Sequence[Any]) -> Any:
        """Return where a result goes: to its row, or to one number if all arguments are, and no output is asked for."""
        out = instruction.out
        self._common.pop(out, None)
        asked = out.bank == "w" and out.number < self.program.outputs.pivots.stop
        if instruction.op in FUNCTIONS and not asked and not any(map(np.ndim, args)):
            self._common[out] = np.zeros_like(self._row(out), shape=())
        return self._row(out)

    def _run_profile(self, which: tuple[int, int], s: Sequence[Any], out: Any) -> None:
        assert self._profile is not None
        out[...] = self._profile(*which, *s)

    def _run_inverse(self, size: int, entries: Sequence[Any], to: int) -> None:
        """Leave (sign of the determinant, 1 / row-sum norm of the inverse, inverse) for every sample."""
        stacked = np.empty((self.samples, size * size))
        for k, entry in enumerate(entries):
            stacked[:, k] = entry
        matrices = stacked.reshape(-1, size, size)
        matrices[~np.isfinite(stacked).all(axis=1)] = 0.0
        inverse = inverses(matrices)
        norm = np.max(np.sum(np.abs(inverse), axis=2), axis=1)
        self._objects[to] = (np.linalg.slogdet(matrices)[0], 1.0 / norm, inverse)

    def _run_apply(self, _: object, args: Sequence[Any], to: int) -> None:
        columns = np.stack([np.broadcast_to(x, (self.samples,)) for x in args[1:]], axis=1)
        self._objects[to] = np.matmul(self._objects[args[0]][2], columns[..., None])[..., 0].T

    def _run_entry(self, which: int, source: Sequence[int], out: Any) -> None:
        out[...] = self._objects[source[0]][which]


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


def _in_lines(count: int, samples: int) -> Any:
    """Return (count, samples) of zeros, each row from the start of a line of the cache on."""
    stride = LINE * (-(-samples // LINE) + 1)
    memory = np.zeros(count * stride + LINE)
    first = -(memory.ctypes.data // memory.itemsize) % LINE
    return memory[first : first + count * stride].reshape(count, stride)[:, :samples]
