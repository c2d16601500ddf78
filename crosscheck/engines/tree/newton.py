"""What the methods of engines with joint trees share: Newton on the engine's rows with its stop swept, and stepping.

Newton is the adapter's here and the same for every engine (`tree_system` says whose rows it works on); each pose starts
at the last one. What is timed ends at the tree's coordinates and rates; where bodies are is read afterwards.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, replace
from functools import partial
from typing import Any

import numpy as np

from crosscheck.engines import Engine, EngineError, Level, in_space, refusals, refuse
from crosscheck.engines.estimates import as_driven
from crosscheck.engines.march import MarchResult, hermite
from crosscheck.engines.methods import Batch, Method, Model, Use, one_by_one, priced
from crosscheck.engines.poses import Equations, close, largest, solve
from crosscheck.engines.spatial.motion import SpaceScene
from crosscheck.engines.tree.joint_tree import Array, JointTree
from crosscheck.engines.tree.tree_system import TreeEngine, TreeSystem, body_levels
from crosscheck.scenes.workloads import Workload
from crosscheck.scenes.workloads_space import SpatialLoops
from refkin.joints import Element, PointsCoincide, RelativeAngle
from refkin.model import Mechanism, Scene
from refkin.motion import Status

LIMITS = (1e-1, 1e-2, 1e-3, 1e-4, 1e-6, 1e-8)
"""Largest component of the correction at which Newton stops; it squares the error, so the last is at round-off."""
NOBODY = "nobody: steps in time"
"""Who ran Newton where the motion is integrated."""
CAP = 30
"""Corrections that a pose may take."""
FEWEST, COARSE, EVERY = 16, 40, 4
"""Of all times at once one pose of so many is found before the others, from the one before it; at least and at most so
many."""


@dataclass(frozen=True)
class Tree:
    """A scene as an engine's joint tree."""

    scene: Scene
    engine: TreeEngine
    system: TreeSystem

    @classmethod
    def of(cls, adapter: Engine, build: Callable[[Mechanism], TreeEngine], scene: Scene) -> Tree:
        """Return a scene as the tree an engine builds; EngineError if it refuses a joint, or a body has no estimate."""
        refuse(refusals(adapter, scene, Level.SOLVE))
        engine = build(as_driven(scene))
        tree = cls(scene, engine, TreeSystem(engine))
        tree.system.tree.start()
        return tree

    def start(self) -> Array:
        """Return the tree's coordinates nearest the estimates."""
        return self.system.tree.start()

    def read(self, levels: Sequence[Array]) -> list[Array]:
        """Return tree coordinates and rates (n, T) as those of bodies."""
        times = len(self.scene.times)
        nothing = np.full(times, np.nan)
        march = MarchResult(tuple(levels), (Status.OK,) * times, nothing)
        return body_levels(self.engine, march, [body.name for body in self.scene.mechanism.bodies])

    def first(self) -> tuple[Array, Array]:
        """Return the closed pose at the first time and its velocities, where stepping starts; EngineError without."""
        pose = close(self.system, self.system.tree.start()[None], np.array([self.scene.times[0]]))
        if not pose.regular[0]:
            raise EngineError("the tree does not close at the first time, where stepping would start")
        return pose.q[0], pose.qd[0]

    def clockwork(self, steps: int) -> Clockwork:
        """Return the prescribed coordinates at so many steps between two times."""
        return Clockwork.of(self.system.tree, self.scene.times, steps)

    def pinned(self, why: str) -> None:
        """Raise EngineError, which says why, unless its loops are closed by revolute joints alone."""
        closures = self.system.tree.closures
        other = [joint for joint in closures if not isinstance(joint, PointsCoincide)]
        if other or not closures:
            which = f"joint {other[0].name!r} closes a loop" if other else "no joint closes a loop"
            raise EngineError(f"{which}: {why}")


def newton_methods(engine: str, tree_of: Callable[[Scene], Tree], space: Callable[..., Any]) -> Iterator[Method]:
    """Yield Newton on the engine's rows, stopped by the size of the correction, and after so many corrections.

    Parameters
    ----------
    engine, tree_of, space : str, callable, callable
        Its name; scene of the plane -> its tree; what makes its model of a tree of space (`SpaceEngine`).
    """

    def listed(name: str, setting: str, **stop: Any) -> Method:
        def build(scene: Scene) -> Model:
            tree = _in_either(tree_of, space, scene)
            return Model(partial(_newton_sweep, tree, **stop), tree.read)

        return priced(engine, name, setting, "the adapter", build)

    for limit in LIMITS:
        yield listed("Newton on its rows", f"|dq| < {limit:g}", limit=limit)
    best = listed("Newton on its rows, extrapolated", f"|dq| < {LIMITS[-1]:g}", limit=LIMITS[-1], extrapolated=True)
    note = (
        "each pose from the extrapolated one; rows and Jacobians are the engine's, the loop and NumPy's solves are not"
    )
    yield replace(best, uses=best.uses | {Use.BENCH}, batch=partial(_in_space_alone, best.model), note=note)
    for limit in (LIMITS[3], LIMITS[-1]):
        name, setting, note = "Newton on its rows, all times at once", f"|dq| < {limit:g}", "the loop is the adapter's"
        model = partial(_at_once, tree_of, space, limit)
        more: dict[str, Any] = {"uses": best.uses | {Use.BENCH}, "batch": partial(_in_space_alone, model)}
        more = more if limit == LIMITS[-1] else {}
        yield priced(engine, name, setting, "the adapter", model, note, together=True, **more)
    for count in range(1, 6):
        yield listed("Newton on its rows, stopped", f"{count} correction{'s' * (count > 1)}", most=count)


def _in_either(tree_of: Callable[[Scene], Tree], space: Callable[..., Any], scene: Scene) -> Tree | SpaceScene:
    return SpaceScene.of(scene, space) if in_space(scene.mechanism) else tree_of(scene)


def _at_once(tree_of: Callable[[Scene], Tree], space: Callable[..., Any], limit: float, scene: Scene) -> Model:
    tree = _in_either(tree_of, space, scene)
    return Model(partial(_newton_at_once, tree, limit), tree.read)


def coarse(times: Array) -> Array:
    """Return the times at which poses are found before those of all times (T,)."""
    count = min(COARSE + 1, max(len(times) // EVERY, FEWEST), len(times))
    return np.linspace(times[0], times[-1], count)


def between(known: Array, q: Array, rates: Array, times: Array) -> Array:
    """Return poses (T, n) by the cubics between those that are known; of one time that pose.

    Parameters
    ----------
    known, q, rates, times : (K,), (K, n), (K, n), (T,) array
        Times of the known poses, these and their rates; the times that are asked for.
    """
    if len(known) == 1:
        return q.copy()
    h = known[1] - known[0]
    k = np.minimum((times - known[0]) // h, len(known) - 2).astype(int)
    return hermite((0.0, h), (q[k], q[k + 1]), (rates[k], rates[k + 1]), (times - known[k])[:, None])


def _newton_at_once(tree: Tree | SpaceScene, limit: float, order: int) -> list[Array]:
    """Return tree coordinates and rates (n, T) up to an order, NaN where a pose has none: a few, then all at once."""
    system: Equations = tree.system
    t = np.array(tree.scene.times)
    known = coarse(t)
    few = replace(tree, scene=replace(tree.scene, times=tuple(known.tolist())))
    with np.errstate(all="ignore"):
        first, rates = _newton_sweep(few, 1, limit=LIMITS[3], extrapolated=True)
        q = between(known, first.T, rates.T, t)
        off = np.full(len(t), np.inf)
        for _ in range(CAP):
            residual, jacobian = system.rows(q, t)
            correction = solve(jacobian, residual)
            q, off = q - correction, largest(correction)
            if not (off >= limit).any():  # what has none is lost
                break
        q[~(off < limit)] = np.nan
        levels = [q]
        if order:
            jacobian = system.rows(q, t)[1]
            levels.append(solve(jacobian, system.nu(q, t)))
        if order > 1:
            levels.append(solve(jacobian, system.gamma(q, levels[1], t)))
    return [level.T for level in levels]


def _in_space_alone(build: Callable[[Scene], Model], workload: Workload, order: int) -> Batch:
    if not isinstance(workload, SpatialLoops):
        raise EngineError("measured on workloads of space: in the plane another of its methods is faster")
    return one_by_one(build, workload, order)


def _newton_sweep(
    tree: Tree | SpaceScene, order: int, *, limit: float = 0.0, most: int = CAP, extrapolated: bool = False
) -> list[Array]:
    """Return tree coordinates and rates (n, T) up to an order, NaN where a pose has none.

    Each pose starts at the last one, or where the rates of that lead to.
    """
    system: Equations = tree.system
    q, times = tree.start(), tree.scene.times
    levels = [np.full((len(q), len(times)), np.nan) for _ in range(max(order, 2 * extrapolated) + 1)]
    with np.errstate(all="ignore"):  # an iterate that runs away has no digits, which is what the row will say
        for k, t in enumerate(times):
            pose = _newton(system, _extrapolated(levels, k, times) if extrapolated and k else q, t, limit, most)
            if pose is None:
                continue
            q = levels[0][:, k] = pose
            if order or extrapolated:
                _rates(system, levels, k, t)
    return levels[: order + 1]


def _extrapolated(levels: list[Array], k: int, times: Sequence[float]) -> Array:
    """Return where position, velocity and acceleration at the time before the k-th lead to; NaN without them."""
    h, (q, qd, qdd) = times[k] - times[k - 1], (level[:, k - 1] for level in levels)
    guess: Array = q + h * (qd + 0.5 * h * qdd)
    return guess


def _rates(system: Equations, levels: list[Array], k: int, t: float) -> None:
    q, at = levels[0][:, k][None].copy(), np.array([t])
    jacobian = system.rows(q, at)[1]
    qd = solve(jacobian, system.nu(q, at))
    levels[1][:, k] = qd[0]
    if len(levels) > 2 and np.isfinite(qd).all():
        levels[2][:, k] = solve(jacobian, system.gamma(q, qd, at))[0]


def _newton(system: Equations, q: Array, t: float, limit: float, most: int) -> Array | None:
    for _ in range(most):
        residual, jacobian = system.rows(q[None], np.array([t]))
        correction = solve(jacobian, residual)[0]
        if not np.isfinite(correction).all():
            return None
        q = q - correction
        if np.abs(correction).max() < limit:
            break
    return q


def prescribed(tree: JointTree) -> list[tuple[int, float, Element]]:
    """Return (column, offset, element) for each that a law moves: the tree coordinate it holds is its law less offset.

    EngineError if one holds something else than one coordinate of the tree: stepping prescribes coordinates alone.
    """
    rows = []
    for e in tree.driven:
        row, offset = tree.turn(e) if isinstance(e, RelativeAngle) else (None, 0.0)
        if row is None or np.count_nonzero(row) != 1 or row.max() != 1.0:
            raise EngineError(f"driver {e.name!r} does not hold one coordinate of the tree, as stepping needs it")
        rows.append((int(np.argmax(row)), offset, e))
    return rows


@dataclass(frozen=True)
class Clockwork:
    """The prescribed coordinates at every step between the times of a scene.

    `columns` (d,) are those that are prescribed, `times` (T, steps) begin each step [s], of which row k leads to time
    k + 1 of the scene; `values` (3, T, steps, d) are value, rate and acceleration then, the last row at the last one.
    """

    columns: Array
    times: Array
    values: Array

    @classmethod
    def of(cls, tree: JointTree, times: Sequence[float], steps: int) -> Clockwork:
        """Return the clockwork of a tree's laws with so many steps between two times."""
        held = prescribed(tree)
        t = np.asarray(times)
        length = np.append(np.diff(t), 0.0)
        at = t[:, None] + length[:, None] * (np.arange(steps) / steps)
        values = np.empty((3, *at.shape, len(held)))
        for k, (_, offset, e) in enumerate(held):
            for order in range(3):
                law = np.array([float(e.laws[0](float(x), order)) for x in at.ravel()])
                values[order, ..., k] = law.reshape(at.shape) - (offset if order == 0 else 0.0)
        return cls(np.array([column for column, _, _ in held], int), at, values)

    def step(self, k: int) -> float:
        """Return the length of the steps from time k to the next [s]."""
        return float((self.times[k + 1, 0] - self.times[k, 0]) / self.times.shape[1])


@dataclass(frozen=True)
class Loops:
    """The loops of a tree whose open joints are revolute, with as many free coordinates as they have equations.

    `clock` has the prescribed coordinates at the times of the scene; Newton corrects the others, `free` (f,).
    """

    tree: Tree
    clock: Clockwork
    free: Array

    @classmethod
    def of(cls, tree: Tree) -> Loops:
        """Return the loops of a tree; EngineError as `pinned`, for other drivers than of a coordinate, or too few."""
        joints = tree.system.tree
        tree.pinned("it is made for loops that revolute joints close")
        clock = tree.clockwork(1)
        free = np.setdiff1d(np.arange(joints.width), clock.columns)
        if len(free) != 2 * len(joints.closures):
            raise EngineError(f"{2 * len(joints.closures)} equations of loops for {len(free)} coordinates")
        return cls(tree, clock, free)


def solved_rows(matrix: Any, right: Any) -> Any:
    """Return the solutions (..., f) of systems (..., f, f); two equations by determinants, without a call for each."""
    if matrix.shape[-1] != 2:
        return np.linalg.solve(matrix, right[..., None])[..., 0]
    (a, b), (c, d) = np.moveaxis(matrix, (-2, -1), (0, 1))
    x, y = np.moveaxis(right, -1, 0)
    determinant = a * d - b * c
    return np.stack([(d * x - b * y) / determinant, (a * y - c * x) / determinant], axis=-1)
