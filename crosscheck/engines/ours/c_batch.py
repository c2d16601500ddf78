"""The rivals in C: dense Newton, the lanes' own tape, the closed form; one thread each, compiled here and now."""

from __future__ import annotations

import ctypes
from collections.abc import Iterator
from typing import Any

import numpy as np

from crosscheck.engines.batch_route import Absent, Route, chunks, of_four_bars, whole
from crosscheck.engines.ours.c_kernels import Kernels, NoKernel
from crosscheck.engines.ours.c_tape import NotInC, emitted, geometry_of
from crosscheck.engines.ours.own_batch import fast
from crosscheck.judge.of_batches import Piece, system_of
from crosscheck.scenes.works import SPEED, FourBars
from refkin.model import Scene

LONG, DOUBLE, ROW = ctypes.c_long, ctypes.c_double, ctypes.POINTER(ctypes.c_double)
TIMED = 1000
"""Of many mechanisms so many are timed; all are judged."""
BY = "C: pose after pose"


def dense(work: FourBars, kernels: Kernels) -> Route:
    """Return Newton on the dense 9x9 equations."""
    call = _Call(work, _function(kernels, "dense.c", "dense_march"))
    return call.route(
        "c-dense",
        "Newton on nine equations from q + h qd + h^2 qdd / 2, LU with partial pivoting; residual and branch checked",
    )


def closed_form(work: FourBars, kernels: Kernels) -> Route:
    """Return the closed form."""
    call = _Call(work, _function(kernels, "closed.c", "closed_form"))
    return call.route("c-closed-form", "two circles meet, differentiated twice; knows what a four-bar is")


def same_tape(work: FourBars, kernels: Kernels) -> Route:
    """Return the lanes' list of operations, compiled, marched pose after pose."""
    tape, core = tape_of(work.scene())
    try:
        function = _function(kernels, "tape.c", "tape_march", tape=emitted(tape))
    except NotInC as error:
        raise Absent(str(error)) from error
    call = _TapeCall(work, function, tape, core)
    return call.route(
        "c-same-tape",
        "the lanes' list of operations, one pose at a time from a cubic prediction; contraction and branch checked",
    )


def tape_of(scene: Scene) -> tuple[Any, tuple[int, ...]]:
    """Return the lanes' tape of a scene, and the coordinates that it iterates in."""
    fast()
    from refkin.fast.prepare import prepared

    found = prepared(scene)
    if found is None:
        raise Absent("there is no tape for this scene")
    return found.made.lanes, found.made.core


def _function(kernels: Kernels, source: str, name: str, **generated: str) -> Any:
    try:
        function = getattr(kernels.library(source, **generated), name)
    except NoKernel as error:
        raise Absent(str(error)) from error
    function.restype = LONG
    return function


class _Call:
    """A kernel with its arguments laid out."""

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
        numbers = (len(geometry), len(self.t))
        self.function(
            *map(LONG, numbers), *map(row_of, (geometry, starts, self.t)), DOUBLE(SPEED), int(keep), row_of(out)
        )

    def route(self, name: str, what: str) -> Route:
        timed = self.work.first(TIMED)
        given = self.arguments(np.arange(timed.mechanisms))
        one = np.empty((1, len(self.t), 27))  # one mechanism's answers: written over by the next, so no memory is timed

        def pieces() -> Iterator[Piece]:
            for lanes in chunks(self.work):
                out = np.empty((len(lanes), len(self.t), 27))
                self.called(*self.arguments(lanes), True, out)
                yield whole(self.work, lanes, self.answers(lanes, out))

        return of_four_bars(
            name,
            self.work,
            lambda: self.called(*given, False, one),
            pieces,
            driven_by=BY,
            what=what,
            timed=timed,
        )


class _TapeCall(_Call):
    """The compiled tape: scaled geometry in the order of its registers, and starts of the core alone."""

    def __init__(self, work: FourBars, function: Any, tape: Any, core: tuple[int, ...]) -> None:
        super().__init__(work, function)
        self.places, self.core = [place for _, place in geometry_of(tape)], list(core)

    def arguments(self, mechanisms: Any) -> tuple[Any, Any]:
        system = system_of(self.work, mechanisms)
        geometry = [np.broadcast_to(system.placed[c].g[k], len(mechanisms)) for c, k in self.places]
        return rows(geometry), rows(system.to_unit(self.work.starts[:, mechanisms])[self.core])

    def answers(self, mechanisms: Any, out: Any) -> tuple[Any, ...]:
        system = system_of(self.work, np.repeat(mechanisms, len(self.t)))
        scaled = super().answers(mechanisms, out)
        return tuple(system.to_physical(x.reshape(9, -1), order).reshape(x.shape) for order, x in enumerate(scaled))

    def called(self, geometry: Any, starts: Any, keep: bool, out: Any) -> None:
        numbers = (*geometry.shape[:1], len(self.t), geometry.shape[1])
        self.function(
            *map(LONG, numbers), *map(row_of, (geometry, starts, self.t)), DOUBLE(SPEED), int(keep), row_of(out)
        )


def rows(x: Any) -> Any:
    """Return numbers (k, M) as C has them, mechanism by mechanism."""
    return np.ascontiguousarray(np.transpose(x), float)


def row_of(x: Any) -> Any:
    """Return an array of doubles as C takes it."""
    return x.ctypes.data_as(ROW)
