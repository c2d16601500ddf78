"""Routes of the chains: one Newton iteration at one configuration, from residual to corrected coordinates.

What is judged is where a few iterations lead.
"""

from __future__ import annotations

import ctypes
from collections.abc import Callable
from dataclasses import replace
from typing import Any

import numpy as np

from crosscheck.engines.batch_route import LEVELS, NEWTON_ITERATION, Absent, Route
from crosscheck.engines.ours.c_batch import row_of, tape_of
from crosscheck.engines.ours.c_kernels import Kernels, NoKernel
from crosscheck.engines.ours.c_tape import NotInC, emitted, geometry_of
from crosscheck.engines.ours.own_batch import fast
from crosscheck.judge.of_chains import judged
from crosscheck.scenes.works import Chain
from refkin.joints import GROUND
from refkin.system import compile_system

ITERATIONS = 5
"""From an estimate that is right to six decimals two would do."""
LARGEST = {
    "refkin-lanes": (100, "its tape is laid out for many lanes, not for many bodies: that would take minutes"),
    "refkin-reference": (100, "a dense solve in Python takes seconds there"),
    "c-same-tape": (100, "to lay the tape out and to compile it would take minutes"),
    "c-dense": (1000, "its dense matrix would take 29 GB"),
}
"""The longest chain that a route is asked for, and why not for longer ones."""
NOT_MADE = {
    "c-closed-form": "a closed form has no Newton iteration",
    "pinocchio": "not made for chains: Pinocchio closes no loops, and its dense rows would be solved by NumPy",
    "mujoco": "not made for chains: mujoco.batch binds no constraint rows, and one configuration is no batch",
    "scipy-root": "not made for chains: it makes no single Newton iterations",
}


def sparse_system(work: Chain) -> Any:
    """Return the chain's `SparseSystem` in its own unit."""
    mechanism = work.scene.mechanism
    return fast().SparseSystem(compile_system(mechanism, unit=mechanism.unit()))


def start_of(work: Chain) -> Any:
    """Return coordinates (n,) in metres and radians from which Newton starts."""
    return np.round(np.asarray(work.truth()[0], float), 6)


def sparse(work: Chain, _: Kernels) -> Route:
    """Return the sparse path."""
    system = sparse_system(work)
    from refkin.fast.sparse import factors

    t = work.scene.times[0]
    start = system.system.to_unit(start_of(work))

    def iterated(q: Any) -> Any:
        return q - factors(system.phi_q(q, t)).solve(system.phi(q, t))

    what = "assembly grouped by joint type into fixed columns, SuperLU with COLAMD"
    return _route("refkin-sparse", work, system, lambda: iterated(start), iterated, "NumPy, SciPy", what)


def reference(work: Chain, _: Kernels) -> Route:
    """Return the readable reference, dense."""
    dense = sparse_system(work)
    system, t = dense.system, work.scene.times[0]
    start = system.to_unit(start_of(work))

    def iterated(q: Any) -> Any:
        return q - np.linalg.solve(system.phi_q(q, t), system.phi(q, t))

    what = "every joint's formula in Python, dense numpy.linalg.solve"
    return _route("refkin-reference", work, dense, lambda: iterated(start), iterated, "Python", what)


def lanes(work: Chain, _: Kernels) -> Route:
    """Return the lanes' tape, on a single lane."""
    dense = sparse_system(work)
    tape, core = tape_of(replace(work.scene, effects=frozenset()))
    from refkin.fast.lanes.run import Workspace

    system, t = dense.system, work.scene.times[0]
    space = Workspace(tape, 1)
    space.give_geometry([p.g for p in system.placed])
    laws = {k: p.constraint.inputs(t, system.unit, 2) for k, p in enumerate(system.placed) if p.constraint.laws}
    space.give_laws(laws)
    start = system.to_unit(start_of(work))[list(core)]

    def answered() -> Any:
        for row, value in zip(space.core(), start, strict=True):
            row[:] = value
        for _ in range(ITERATIONS):
            space.run("newton")
        space.run("answer")
        return system.to_physical(space.level(0)[:, 0])

    what = "elimination tape as NumPy calls, on one lane: the calls take the time"
    answered()
    return _finished("refkin-lanes", work, dense, lambda: space.run("newton"), 1, answered, "NumPy", what)


def same_tape(work: Chain, kernels: Kernels) -> Route:
    """Return the lanes' tape, compiled."""
    dense = sparse_system(work)
    tape, core = tape_of(replace(work.scene, effects=frozenset()))
    try:
        function = kernels.library("tape.c", tape=emitted(tape)).tape_newton
    except (NoKernel, NotInC) as error:
        raise Absent(str(error)) from error
    function.restype = ctypes.c_double
    system = dense.system
    geometry = np.array([system.placed[c].g[k] for _, (c, k) in geometry_of(tape)])
    start = system.to_unit(start_of(work))[list(core)]
    law = [ctypes.c_double(float(work.law(0.0, order))) for order in range(3)]
    out = np.empty(system.n)

    def iterated(count: int, to: Any = None) -> None:
        function(ctypes.c_long(count), row_of(geometry), row_of(start), *law, None if to is None else row_of(to))

    def answered() -> Any:
        iterated(ITERATIONS, out)
        return system.to_physical(out)

    what = "the lanes' list of operations, compiled, scalar"
    return _finished("c-same-tape", work, dense, lambda: iterated(REPEATED), REPEATED, answered, "C", what)


REPEATED = 100
"""So many iterations are one call of a function in C, whose own cost is then nothing."""


def dense_c(work: Chain, kernels: Kernels) -> Route:
    """Return dense Newton in C."""
    dense = sparse_system(work)
    try:
        function = kernels.library("dense_chain.c").chain_newton
    except NoKernel as error:
        raise Absent(str(error)) from error
    function.restype = ctypes.c_double
    mechanism, n = work.scene.mechanism, dense.system.n
    number = {GROUND: -1, **{b.name: k for k, b in enumerate(mechanism.bodies)}}
    ends = np.array([[number[body] for body in joint.bodies] for joint in mechanism.joints], np.dtype("l"))
    points = np.array([[x for _, point in joint.points() for x in point] for joint in mechanism.joints])
    start, angle = start_of(work), float(work.law(0.0))
    matrix, right = np.empty((n, n)), np.empty(n)

    def iterated(count: int) -> Any:
        q = start.copy()
        joints = ends.ctypes.data_as(ctypes.POINTER(ctypes.c_long))
        sizes = map(ctypes.c_long, (count, n, len(ends)))
        function(*sizes, joints, row_of(points), ctypes.c_double(angle), *map(row_of, (q, matrix, right)))
        return q

    what = "all equations, dense LU with partial pivoting that passes over zeros"
    return _finished("c-dense", work, dense, lambda: iterated(1), 1, lambda: iterated(ITERATIONS), "C", what)


def exudyn(work: Chain, _: Kernels) -> Route:
    """Return exudyn's static Newton with its sparse solver."""
    from crosscheck.measure.bench import engine_module

    dense = sparse_system(work)
    solver = engine_module("exudyn").ChainSolver(work, start_of(work))
    count = solver.run()
    what = "MainSolverStatic.Newton with EigenSparse: coordinates and multipliers, time by iterations made"
    return _finished("exudyn", work, dense, solver.run, count, solver.answered, "exudyn", what)


def _route(
    name: str, work: Chain, dense: Any, run: Callable[[], object], iterated: Callable[[Any], Any], by: str, what: str
) -> Route:
    """Return a route whose iteration is a function of scaled coordinates."""

    def answered() -> Any:
        q = dense.system.to_unit(start_of(work))
        for _ in range(ITERATIONS):
            q = iterated(q)
        return dense.system.to_physical(q)

    return _finished(name, work, dense, run, 1, answered, by, what)


def _finished(
    name: str,
    work: Chain,
    dense: Any,
    run: Callable[[], object],
    count: int,
    answered: Callable[[], Any],
    by: str,
    what: str,
) -> Route:
    accuracy = lambda: judged(work, dense, answered())  # noqa: E731
    return Route(name, LEVELS[:1], by, what, run, count, accuracy, NEWTON_ITERATION)


def _limited(name: str, builder: Callable[[Chain, Kernels], Route]) -> Callable[[Chain, Kernels], Route]:
    """Return a builder that refuses chains that are too long for its route."""
    largest, reason = LARGEST[name]

    def build(work: Chain, kernels: Kernels) -> Route:
        if work.windows > largest:
            raise Absent(f"not for more than {largest} loops: {reason}")
        return builder(work, kernels)

    return build


def _refused(reason: str) -> Callable[[Chain, Kernels], Route]:
    def build(work: Chain, kernels: Kernels) -> Route:
        raise Absent(reason)

    return build


BUILDERS: dict[str, Callable[[Any, Kernels], Route]] = {
    "refkin-sparse": sparse,
    "refkin-lanes": _limited("refkin-lanes", lanes),
    "refkin-reference": _limited("refkin-reference", reference),
    "c-same-tape": _limited("c-same-tape", same_tape),
    "c-dense": _limited("c-dense", dense_c),
    "exudyn": exudyn,
    **{name: _refused(reason) for name, reason in NOT_MADE.items()},
}
