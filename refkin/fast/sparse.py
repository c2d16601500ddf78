"""Large mechanisms, one configuration at a time: sparse assembly and sparse LU, for 100 to 100,000 coordinates.

Constraints of the same kind are evaluated together, on rows, by the joints' own formulas. Where each entry of phi_q
goes in the compressed columns is found once; entries that are constants are written once. The factors are SuperLU's
with the columns ordered by COLAMD and panels of one column, which suits matrices of a few entries per column.
"""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from typing import Any, cast

import numpy as np

from refkin.analysis import estimate_of, slow_enough
from refkin.errors import Fault, InvalidScene, RefkinError, expect
from refkin.joints import PLANE, Unit
from refkin.model import Effect, Scene
from refkin.motion import SINGULAR, Status
from refkin.newton import ROUND_OFF, contracts
from refkin.proof.formulas import agreeing
from refkin.proof.path.blocks import matching
from refkin.solving.starts import NEARBY
from refkin.system import ConstraintRows, System, compile_system
from refkin.vec import BodyValues, ParameterValue

MOST_NEWTON = 30
ENOUGH = 1e-8
"""Newton is done after a correction of this size: with the error squared, the next would be round-off."""
LIPSCHITZ, LARGEST_H = 8.0, 1 / 8
"""A Lipschitz constant of phi_q in row sums, for joint points within a few sizes, and the largest h taken for ok."""


class SingularFactor(RefkinError):
    """A sparse matrix without LU factors."""


@dataclass(frozen=True)
class Large:
    """The answer at one time, in metres and radians.

    Attributes
    ----------
    q, qd, qdd : (n,) array or None
        None if not called for, or where there is no answer.
    residual : float
        Largest component of the scaled phi.
    inverse_norm : float
        An estimate of the row-sum norm beta of the inverse of phi_q.
    h : float
        beta K times the largest component of phi_q^-1 phi, which Newton and Kantorovich's theorem asks to be below 1/2;
        with the estimate of beta and a usual K no proof, but a measure of how far from singular the pose is.
    steps : tuple of float
        The largest component of each correction of Newton's method.
    """

    status: Status
    q: Any
    qd: Any
    qdd: Any
    residual: float
    inverse_norm: float
    h: float
    steps: tuple[float, ...]


class _Alike:
    """Constraints of one kind between coordinates of the same kind, as one: on rows, with a number for each of them.

    `at` (rows, k) are their rows of phi. The formulas are those that all of them have.
    """

    def __init__(self, placed: Sequence[ConstraintRows]) -> None:
        self.each: list[Any] = [p.constraint for p in placed]
        self.at = np.array([p.row for p in placed]) + np.arange(self.each[0].rows)[:, None]

    def __getattr__(self, name: str) -> Any:
        if name == "each":  # of a copy that is not filled in yet
            raise AttributeError(name)
        return getattr(self.each[0], name)

    def inputs(self, t: float, unit: Unit, order: int) -> Any:
        """Return the laws' values as rows."""
        laws = (c.inputs(t, unit, order) for c in self.each)
        return tuple(tuple(map(np.array, zip(*law, strict=True))) for law in zip(*laws, strict=True))

    def profile_values(self, s: Any, unit: Unit, order: int) -> Any:
        """Return the profiles' values as rows."""
        values = (c.profile_values(x, unit, order) for c, x in zip(self.each, s, strict=True))
        return tuple(map(np.array, zip(*values, strict=True)))


def _together(placed: Sequence[ConstraintRows]) -> ConstraintRows:
    """Return constraints of one kind as one, with rows for numbers and for where bodies and parameters start."""
    g = tuple(map(np.array, zip(*(p.g for p in placed), strict=True)))
    starts = (None if side[0] is None else np.array(side) for side in zip(*(p.starts for p in placed), strict=True))
    return ConstraintRows(cast(Any, _Alike(placed)), cast(Any, g), placed[0].row, cast(Any, tuple(starts)))


class SparseSystem:
    """The equations of a system, assembled by groups into compressed columns.

    Attributes
    ----------
    system : System
        With as many rows as coordinates.
    grouped : System
        The same with constraints of one kind as one: rows for numbers, `at` for the rows of phi.
    """

    def __init__(self, system: System) -> None:
        if system.kind is not PLANE:
            raise RefkinError(f"bodies are {system.kind.name}: large systems are planar; `sweep` takes either kind")
        if system.m != system.n:
            raise RefkinError(f"{system.m} rows for {system.n} coordinates: redundant rows are for `solve` and `sweep`")
        self.system = system
        kinds: dict[Any, list[ConstraintRows]] = {}
        for p in system.placed:
            c = p.constraint
            sides = tuple(start is None for start in p.starts)
            kinds.setdefault((type(c), getattr(c, "contact", None), len(c.laws), sides), []).append(p)
        self.grouped: Any = replace(system, placed=tuple(map(_together, kinds.values())))
        self._lay_out()

    def phi(self, q: Any, t: float) -> Any:
        """Return the residual of q (n,)."""
        return self._right(q, None, t, 0, "residual")

    def nu(self, q: Any, t: float) -> Any:
        """Return the right side of the velocities."""
        return self._right(q, None, t, 1, "nu")

    def gamma(self, q: Any, qd: Any, t: float) -> Any:
        """Return the right side of the accelerations."""
        return self._right(q, qd, t, 2, "gamma")

    def phi_q(self, q: Any, t: float) -> Any:
        """Return the Jacobian at q (n,) as a csc_array, always with the same pattern."""
        from scipy.sparse import csc_array  # here: importing SciPy's parts costs more than using them

        data = self._constants.copy()
        for place, (_, _, entry) in zip(self._places, self._entries(q, t), strict=True):
            if not isinstance(entry, int):
                data[place] = entry
        return csc_array((data, *self._pattern), shape=(self.system.n, self.system.n))

    def _entries(self, q: Any, t: float) -> Iterator[tuple[Any, Any, Any]]:
        """Yield rows, columns and values of the entries that are not the integer 0; others are always 0."""
        for p, start, block in self.grouped.blocks(_Values(self.system, q), t):
            for row, entries in zip(p.constraint.at, block, strict=True):
                for k, entry in enumerate(entries):
                    if not (isinstance(entry, int) and entry == 0):
                        yield row, start + k, entry

    def _right(self, q: Any, qd: Any, t: float, order: int, formula: str) -> Any:
        out, places = np.zeros(self.system.m), (row for p in self.grouped.placed for row in p.constraint.at)
        values = self.grouped.rows(_Values(self.system, q, qd), t, order, lambda c: getattr(c, formula))
        for place, value in zip(places, values, strict=True):
            out[place] = value
        return out

    def _lay_out(self) -> None:
        """Find the pattern, where in it each entry of each group goes, and what is constant."""
        from scipy.sparse import csc_array

        n = self.system.n
        entries = list(self._entries(np.zeros(n), 0.0))
        rows = np.concatenate([row for row, _, _ in entries])
        columns = np.concatenate([column for _, column, _ in entries])
        numbers = np.arange(1.0, len(rows) + 1)
        order = csc_array((numbers, (rows, columns)), shape=(n, n))
        order.sort_indices()
        place = np.empty(len(rows), int)
        place[order.data.astype(int) - 1] = np.arange(len(rows))
        self._places = np.split(place, np.cumsum([len(row) for row, _, _ in entries])[:-1])
        self._pattern = order.indices, order.indptr
        rows_of = [part.tolist() for part in np.split(order.indices, order.indptr[1:-1])]
        if matching(rows_of) is None:  # SuperLU looks for a pivot beyond its arrays then, and may end the process
            raise RefkinError("the equations have no unique solution by their structure: some rows are redundant")
        self._constants = np.zeros(len(rows))
        for at, (_, _, entry) in zip(self._places, entries, strict=True):
            self._constants[at] = entry if isinstance(entry, int) else 0.0


class _Values:
    """The values of bodies, or of parameters, at q (n,) as rows, by the places where they start; None is the ground."""

    def __init__(self, system: System, q: Any, qd: Any = None) -> None:
        self.bodies, self.q, self.qd = system.of_bodies, q, qd

    def __getitem__(self, start: Any) -> Any:
        if start is None:
            return BodyValues(0.0, 0.0, 0.0).moving(0.0, 0.0, 0.0)
        kind, width = (BodyValues, 3) if start[0] < self.bodies else (ParameterValue, 1)
        places = [start + k for k in range(width)]
        values: Any = kind(*(self.q[at] for at in places))
        return values if self.qd is None else values.moving(*(self.qd[at] for at in places))


def solve_large(scene: Scene) -> Large:
    """Return position, velocity and acceleration at the scene's first time, as far as it calls for them.

    Newton's method from the scene's estimates, all of which are needed. The pose is ok if Newton contracted at once and
    found it within 0.2 sizes and rad, the residual is at round-off, `Large.h` is small, the inverse of phi_q no
    larger than at a regular pose (`SINGULAR`) and rates are numbers whose squares are; nothing is searched for and
    nothing is proved. Points of the scene are not read.

    Raises
    ------
    RefkinError
        If an estimate is missing, bodies are of space, there are not as many rows as coordinates, or some rows are
        redundant whatever the numbers in them.
    """
    expect("scene", scene, Scene)
    system = agreeing(compile_system(scene.mechanism, scene.effects, scene.mechanism.unit()), scene.times)
    missing = [b.name for b in scene.mechanism.bodies if b.estimate is None]
    if missing:
        raise InvalidScene([Fault(f"body {missing[0]!r}", None, "an estimate of its first pose")], scene.name)
    sparse, t, steps = SparseSystem(system), scene.times[0], list[float]()
    q = estimate = estimate_of(system, scene)
    residual = sparse.phi(q, t)
    try:
        for _ in range(MOST_NEWTON):
            correction = factors(sparse.phi_q(q, t)).solve(residual)
            q = q - correction
            residual = sparse.phi(q, t)
            steps.append(float(np.max(np.abs(correction))))
            scale = max(1.0, float(np.max(np.abs(q))))
            if not steps[-1] > ENOUGH * scale or not contracts(steps):
                break
        lu = factors(sparse.phi_q(q, t))
    except SingularFactor:
        off = float(np.max(np.abs(residual)))
        return Large(Status.NOT_CONVERGED, None, None, None, off, np.inf, np.inf, tuple(steps))
    size = float(np.max(np.abs(residual)))
    near = bool(np.max(np.abs(q - estimate)) <= NEARBY)
    closes = size <= ROUND_OFF * scale and steps[-1] <= ENOUGH * scale and contracts(steps) and near
    norm = inverse_norm(lu, len(q))
    h = LIPSCHITZ * norm * float(np.max(np.abs(lu.solve(residual))))
    # A residual may be 0 however singular the pose is. Of n rows sigma_min is at most sqrt(n) / norm.
    regular = h <= LARGEST_H and math.sqrt(len(q)) > SINGULAR * norm
    status = Status.NOT_CONVERGED if not closes else Status.OK if regular else Status.SINGULAR
    levels = [q, None, None]
    if status is Status.OK and system.effects:
        with np.errstate(all="ignore"):  # rates may be beyond all numbers
            levels[1] = lu.solve(sparse.nu(q, t))
            if Effect.ACCELERATION in system.effects:
                levels[2] = lu.solve(sparse.gamma(q, levels[1], t))
        status = Status.OK if slow_enough(levels[1 : 1 + len(system.effects)]) else Status.NOT_CONVERGED
        levels[1] = levels[1] if Effect.VELOCITY in scene.effects else None
    levels = levels if status in (Status.OK, Status.SINGULAR) else [None] * 3
    q, qd, qdd = (None if level is None else system.to_physical(level, order) for order, level in enumerate(levels))
    return Large(status, q, qd, qdd, size, norm, h, tuple(steps))


def factors(matrix: Any) -> Any:
    """Return SuperLU's factors of a csc_array.

    Raises
    ------
    SingularFactor
        If a pivot is exactly 0, or an entry is not finite.
    """
    from scipy.sparse.linalg import splu  # here: importing SciPy's parts costs more than using them

    if not np.isfinite(matrix.data).all():
        raise SingularFactor("an entry is not finite")
    try:
        return splu(matrix, permc_spec="COLAMD", relax=1, panel_size=1)
    except RuntimeError as error:  # all that SciPy says of a pivot that is exactly 0
        raise SingularFactor(str(error)) from error


def inverse_norm(lu: Any, n: int) -> float:
    """Return an estimate from below, rarely by more than a factor 3, of the row-sum norm of the inverse.

    Hager's method; Higham and Tisseur, SIAM J. Matrix Anal. Appl. 21 (2000).
    """
    from scipy.sparse.linalg import LinearOperator, onenormest

    transposed = LinearOperator((n, n), matvec=lambda x: lu.solve(x, "T"), rmatvec=lu.solve, dtype=float)
    return float(onenormest(transposed, t=1))
