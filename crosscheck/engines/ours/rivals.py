"""The rivals of the benchmark: the closed form on NumPy rows, which is the limit, and in C; there, dense Newton, too.

The fast path's own program is the third in C. What is in C is compiled here and now, and runs in one thread.
"""

from __future__ import annotations

import ctypes
from collections.abc import Iterator
from typing import Any

import numpy as np

from crosscheck.engines import EngineError
from crosscheck.engines.methods import Batch, Method, Use, of_four_bars
from crosscheck.engines.ours import chains
from crosscheck.engines.ours.c_kernels import emitted, geometry_of, library, row_of, rows
from crosscheck.engines.ours.chains import program_of
from crosscheck.scenes.four_bar_answers import four_bar
from crosscheck.scenes.workloads import SPEED, AnswerPiece, FourBars, LoopChain, Workload, chunks, system_of, whole

LONG, DOUBLE = ctypes.c_long, ctypes.c_double
TIMED = 1000
"""Of many mechanisms so many are timed; all are judged."""
AT_ONCE = 10_000
"""Configurations that NumPy computes at once: their rows stay in the cache."""


def methods() -> Iterator[Method]:
    """Yield the rivals, at the benchmark's workloads."""
    yield Method(
        engine="numpy",
        name="closed form",
        newton_by="nobody: two circles meet",
        uses=frozenset({Use.BENCH}),
        batch=on_rows,
        at_once=True,
        note="two circles meet, differentiated twice, all at once; knows what a four-bar is",
    )
    for name, batch, note in (
        ("same program", _same_program, "the fast path's list of operations, compiled"),
        ("dense Newton", _dense, "all equations, LU with partial pivoting; residual and branch checked"),
        ("closed form", _closed_form, "two circles meet, differentiated twice; knows what a four-bar is"),
    ):
        who: Any = {"engine": "c", "name": name, "newton_by": "C: pose after pose", "note": note}
        yield Method(**who, uses=frozenset({Use.BENCH}), batch=batch, at_once=True)


def on_rows(workload: Workload, order: int) -> Batch:
    """Return the vectorised closed form; all orders come at once."""
    work = of_four_bars(workload)
    phi = SPEED * work.t[None, :]
    step = max(1, AT_ONCE // len(work.t))

    def run() -> None:
        for start in range(0, work.mechanisms, step):
            four_bar(work.lengths[:, start : start + step, None], phi, SPEED)

    def pieces() -> Iterator[AnswerPiece]:
        for samples in chunks(work):
            yield whole(work, samples, four_bar(work.lengths[:, samples, None], phi, SPEED))

    return Batch(run, work.configurations, pieces)


def _dense(workload: Workload, order: int) -> Batch:
    if isinstance(workload, LoopChain):
        return chains.dense_c(workload)
    return _Call(of_four_bars(workload), _function("dense.c", "dense_march")).batch()


def _closed_form(workload: Workload, order: int) -> Batch:
    if isinstance(workload, LoopChain):
        raise EngineError("a closed form has no Newton iteration")
    return _Call(of_four_bars(workload), _function("closed.c", "closed_form")).batch()


def _same_program(workload: Workload, order: int) -> Batch:
    if isinstance(workload, LoopChain):
        return chains.same_program(workload)
    work = of_four_bars(workload)
    program, core = program_of(work.scene())
    return _ProgramCall(work, _function("program.c", "program_march", program=emitted(program)), program, core).batch()


def _function(source: str, name: str, **generated: str) -> Any:
    function = getattr(library(source, **generated), name)
    function.restype = LONG
    return function


class _Call:
    """A kernel with its arguments laid out; `more` numbers than those of mechanisms and times."""

    more: tuple[int, ...] = ()

    def __init__(self, work: FourBars, function: Any) -> None:
        self.work, self.function = work, function
        self.t = np.ascontiguousarray(work.t)

    def arguments(self, mechanisms: Any) -> tuple[Any, Any]:
        """Return the numbers of the geometry and the starts, each (M, ...)."""
        return rows(self.work.lengths[:, mechanisms]), rows(self.work.starts[:, mechanisms])

    def answers(self, mechanisms: Any, out: Any) -> tuple[Any, ...]:
        """Return the levels (9, M, T) in metres of what the kernel wrote."""
        return tuple(np.moveaxis(out[:, :, 9 * k : 9 * k + 9], 2, 0) for k in range(3))

    def called(self, geometry: Any, starts: Any, keep: bool, out: Any) -> None:
        numbers = map(LONG, (len(geometry), len(self.t), *self.more))
        self.function(*numbers, *map(row_of, (geometry, starts, self.t)), DOUBLE(SPEED), int(keep), row_of(out))

    def batch(self) -> Batch:
        """Return what is timed: some mechanisms; all are answered."""
        timed = self.work.first(TIMED)
        given = self.arguments(np.arange(timed.mechanisms))
        one = np.empty((1, len(self.t), 27))  # one mechanism's answers: written over by the next, so no memory is timed

        def pieces() -> Iterator[AnswerPiece]:
            for samples in chunks(self.work):
                out = np.empty((len(samples), len(self.t), 27))
                self.called(*self.arguments(samples), True, out)
                yield whole(self.work, samples, self.answers(samples, out))

        return Batch(lambda: self.called(*given, False, one), timed.configurations, pieces)


class _ProgramCall(_Call):
    """The compiled program: scaled geometry in the order of its registers, and starts of the core alone."""

    def __init__(self, work: FourBars, function: Any, program: Any, core: tuple[int, ...]) -> None:
        super().__init__(work, function)
        self.places, self.core = [place for _, place in geometry_of(program)], list(core)
        self.more = (len(self.places),)

    def arguments(self, mechanisms: Any) -> tuple[Any, Any]:
        system = system_of(self.work, mechanisms)
        geometry = [np.broadcast_to(system.placed[c].g[k], len(mechanisms)) for c, k in self.places]
        return rows(geometry), rows(system.to_unit(self.work.starts[:, mechanisms])[self.core])

    def answers(self, mechanisms: Any, out: Any) -> tuple[Any, ...]:
        system = system_of(self.work, np.repeat(mechanisms, len(self.t)))
        scaled = super().answers(mechanisms, out)
        return tuple(system.to_physical(x.reshape(9, -1), order).reshape(x.shape) for order, x in enumerate(scaled))
