"""Running: a program as NumPy functions over rows, one row for each register, one column for each sample.

A `Workspace` owns its rows. Binding an instruction to them gives a function and its arguments, so that a run is one
loop over calls. Samples do not mix: one that divides by 0 or leaves the numbers' range becomes NaN or infinite, and no
other does.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import contextmanager
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

UFUNCS: Mapping[str, Callable[..., Any]] = {
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

    def __init__(self, program: Program, samples: int, *, sample_geometry: bool = False) -> None:
        """Allocate registers; with `sample_geometry` each sample is a mechanism of its own, else all are one."""
        self.program, self.samples = program, samples
        self.w = _in_lines(program.sizes["w"], samples)
        # One number for all samples has no dimension: NumPy takes half as long with it as with an array of one number.
        self.u = _in_lines(program.sizes["u"], samples) if sample_geometry else np.zeros(program.sizes["u"])
        self._masks = np.zeros((program.sizes["m"], samples), bool)
        self._objects: list[Any] = [None] * program.sizes["x"]
        self._profile: Profile | None = None
        for register, number in program.constants.items():
            self.u[register.number] = number
        self._rows = {
            bank: [rows[k, ...] for k in range(len(rows))]
            for bank, rows in (("w", self.w), ("u", self.u), ("m", self._masks))
        }
        self._calls = {name: [self._bound(i) for i in program.segments[name]] for name in SEGMENTS}

    @property
    def nbytes(self) -> int:
        """The memory of the registers."""
        return sum(bank.base.nbytes if bank.base is not None else bank.nbytes for bank in (self.w, self.u, self._masks))

    def give_geometry(self, geometry: Sequence[Sequence[Any]], profile: Profile | None = None) -> None:
        """Write the geometry, per constraint its numbers or rows, and run what depends on it alone."""
        self._profile = profile
        for leaf, register in self.program.inputs.items():
            if leaf.kind == "g":
                constraint, number = leaf.place
                self.u[register.number] = geometry[constraint][number]
        self.run("mechanism")

    def give_laws(self, laws: Mapping[int, Sequence[Sequence[Any]]]) -> None:
        """Write the laws' values, per constraint by law and order, and run what depends on geometry and laws."""
        for leaf, register in self.program.inputs.items():
            if leaf.kind == "f":
                constraint, law, order = leaf.place
                self.w[register.number] = laws[constraint][law][order]
        self.run("time")

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
        """Run one segment on all samples; divisions by 0 and the like are not reported but show in their samples."""
        with np.errstate(all="ignore"):
            for function, args in self._calls[segment]:
                function(*args)

    def _bound(self, instruction: Instruction) -> Call:
        op, out = instruction.op, instruction.out
        if op in UFUNCS:
            return UFUNCS[op], (*map(self._row, instruction.args), self._row(out))
        if op in ("max", "select"):
            return (_maximum if op == "max" else _select), (*map(self._row, instruction.args), self._row(out))
        if op == "profile":
            return self._run_profile, (instruction.value, self._row(instruction.args[0]), self._row(out))
        if op == "inverse":
            return self._run_inverse, (out.number, instruction.value, tuple(map(self._row, instruction.args)))
        if op == "apply":
            inverse, *right = instruction.args
            return self._run_apply, (out.number, inverse.number, tuple(map(self._row, right)))
        if op == "entry":
            return self._run_entry, (instruction.args[0].number, instruction.value, self._row(out))
        raise AssertionError(op)

    def _row(self, register: Register) -> Any:
        return self._rows[register.bank][register.number]

    def _run_profile(self, which: tuple[int, int], s: Any, out: Any) -> None:
        assert self._profile is not None
        out[...] = self._profile(*which, s)

    def _run_inverse(self, to: int, size: int, entries: Sequence[Any]) -> None:
        """Leave (sign of the determinant, 1 / row-sum norm of the inverse, inverse) for every sample."""
        stacked = np.empty((self.samples, size * size))
        for k, entry in enumerate(entries):
            stacked[:, k] = entry
        matrices = stacked.reshape(-1, size, size)
        matrices[~np.isfinite(stacked).all(axis=1)] = 0.0
        inverse = inverses(matrices)
        norm = np.max(np.sum(np.abs(inverse), axis=2), axis=1)
        self._objects[to] = (np.linalg.slogdet(matrices)[0], 1.0 / norm, inverse)

    def _run_apply(self, to: int, inverse: int, right: Sequence[Any]) -> None:
        columns = np.stack([np.broadcast_to(x, (self.samples,)) for x in right], axis=1)
        self._objects[to] = np.matmul(self._objects[inverse][2], columns[..., None])[..., 0].T

    def _run_entry(self, source: int, which: int, out: Any) -> None:
        out[...] = self._objects[source][which]


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


def _maximum(a: Any, b: Any, out: Any) -> None:
    np.maximum(a, b, out=out)


def _select(mask: Any, x: Any, y: Any, out: Any) -> None:
    """`out` is none of the arguments."""
    np.copyto(out, y)
    np.copyto(out, x, where=mask)
