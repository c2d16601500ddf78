"""Chains of four-bars in one configuration: a Newton iteration, from residual to corrected coordinates.

What is judged is where a few iterations lead.
"""

from __future__ import annotations

import ctypes
from dataclasses import replace
from typing import Any

import numpy as np

from crosscheck.engines import EngineError
from crosscheck.engines.methods import Batch
from crosscheck.engines.ours.c_kernels import emitted, geometry_of, library, row_of
from crosscheck.engines.ours.refkin_methods import ITERATIONS, iterated, refuse_longer
from crosscheck.scenes.workloads import LoopChain, Workload
from refkin.joints import GROUND
from refkin.model import Scene
from refkin.system import System

OF_PROGRAM = 100, "to lay the program out, and to compile it, would take minutes"
OF_DENSE = 1000, "its dense matrix would take 29 GB"
"""The longest chain that a method is asked for, and why not for longer ones."""
REPEATED = 100
"""So many iterations are one call of a function in C, whose own cost is then nothing."""


def sparse(workload: Workload, order: int) -> Batch:
    """Return the sparse path."""
    if not isinstance(workload, LoopChain):
        raise EngineError("made for chains")
    from refkin.fast import SparseSystem  # here: the methods in C do without the fast paths
    from refkin.fast.sparse import factors

    system, t = SparseSystem(workload.system), workload.scene.times[0]
    return iterated(workload, lambda q: q - factors(system.phi_q(q, t)).solve(system.phi(q, t)))


def by_program(work: LoopChain) -> Batch:
    """Return the fast path's program, on a single sample."""
    program, system, start = _laid_out(work)
    from refkin.fast.elimination.run import Workspace

    t, space = work.scene.times[0], Workspace(program, 1)
    space.give_geometry([p.g for p in system.placed])
    laws = {k: p.constraint.inputs(t, system.unit, 2) for k, p in enumerate(system.placed) if p.constraint.laws}
    space.give_laws(laws)

    def answered() -> Any:
        for row, value in zip(space.core(), start, strict=True):
            row[:] = value
        for _ in range(ITERATIONS):
            space.run("newton")
        space.run("answer")
        return system.to_physical(space.level(0)[:, 0])

    answered()
    return Batch(lambda: space.run("newton"), 1, answered)


def same_program(work: LoopChain) -> Batch:
    """Return the fast path's program, compiled."""
    program, system, start = _laid_out(work)
    function = library("program.c", program=emitted(program)).program_newton
    function.restype = ctypes.c_double
    geometry = np.array([system.placed[c].g[k] for _, (c, k) in geometry_of(program)])
    law = [ctypes.c_double(float(work.law(0.0, order))) for order in range(3)]
    out = np.empty(system.n)

    def iterate(count: int, to: Any = None) -> None:
        function(ctypes.c_long(count), row_of(geometry), row_of(start), *law, None if to is None else row_of(to))

    def answered() -> Any:
        iterate(ITERATIONS, out)
        return system.to_physical(out)

    return Batch(lambda: iterate(REPEATED), REPEATED, answered)


def dense_c(work: LoopChain) -> Batch:
    """Return dense Newton in C."""
    refuse_longer(work, *OF_DENSE)
    function = library("dense_chain.c").chain_newton
    function.restype = ctypes.c_double
    mechanism, n = work.scene.mechanism, len(work.start)
    number = {GROUND: -1, **{b.name: k for k, b in enumerate(mechanism.bodies)}}
    ends = np.array([[number[body] for body in joint.bodies] for joint in mechanism.joints], np.dtype("l"))
    points = np.array([[x for _, point in joint.points() for x in point] for joint in mechanism.joints])
    start, angle = work.start, float(work.law(0.0))
    matrix, right = np.empty((n, n)), np.empty(n)

    def iterate(count: int) -> Any:
        q = start.copy()
        joints = ends.ctypes.data_as(ctypes.POINTER(ctypes.c_long))
        sizes = map(ctypes.c_long, (count, n, len(ends)))
        function(*sizes, joints, row_of(points), ctypes.c_double(angle), *map(row_of, (q, matrix, right)))
        return q

    return Batch(lambda: iterate(1), 1, lambda: iterate(ITERATIONS))


def program_of(scene: Scene) -> tuple[Any, tuple[int, ...]]:
    """Return the fast path's program of a scene, and the coordinates that it iterates in; EngineError without one."""
    try:
        from refkin.fast.prepare import prepared
    except ImportError as error:
        raise EngineError(f"no fast paths here: {error}") from error
    answer = prepared(scene)
    if answer is None:
        raise EngineError("there is no program for this scene")
    return answer.made.program, answer.made.core


def _laid_out(work: LoopChain) -> tuple[Any, System, Any]:
    """Return a chain's program, its equations, and where the program starts."""
    refuse_longer(work, *OF_PROGRAM)
    program, core = program_of(replace(work.scene, effects=frozenset()))
    return program, work.system, work.system.to_unit(work.start)[list(core)]
