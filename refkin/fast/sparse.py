"""Large mechanisms, one configuration at a time: sparse assembly and sparse LU, for 100 to 100,000 coordinates.

Constraints of the same kind are evaluated together, on rows, by the joints' own formulas. Where each entry of phi_q
goes in the compressed columns is found once; entries that are constants are written once. The factors are SuperLU's
with the columns ordered by COLAMD and panels of one column, which suits matrices of a few entries per column.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from refkin.errors import Fault, InvalidScene, RefkinError
from refkin.joints import initial_contacts
from refkin.model import Effect, Scene
from refkin.motion import Status
from refkin.newton import ROUND_OFF, contracts
from refkin.system import PROFILE_ORDER, ConstraintRows, System, compile_system
from refkin.vec import BodyValues, ParameterValue, Vec, cosine_and_sine

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


class Group:
    """Constraints of one kind between coordinates of the same kind, evaluated together.

    Attributes
    ----------
    rows : (rows, k) array of int
        The rows of phi of the k constraints.
    starts : tuple of (k,) array or None
        Where the bodies and parameters start in q; None is the ground.
    """

    def __init__(self, system: System, placed: Sequence[ConstraintRows]) -> None:
        self.system, self.placed = system, placed
        first = placed[0]
        self.formulas: Any = first.constraint
        self.g = tuple(np.array(numbers) for numbers in zip(*(p.g for p in placed), strict=True))
        self.rows = np.array([p.row for p in placed]) + np.arange(first.constraint.rows)[:, None]
        self.starts = tuple(
            None if start is None else np.array([p.starts[side] for p in placed])
            for side, start in enumerate(first.starts)
        )

    def given(self, parameters: Any, t: float, order: int) -> Any:
        """Return the laws' values as rows, and those of the profiles at the parameters."""
        laws = [p.constraint.inputs(t, self.system.unit, order) for p in self.placed] if self.formulas.laws else [()]
        f = tuple(tuple(map(np.array, zip(*law, strict=True))) for law in zip(*laws, strict=True))
        if not self.formulas.parameters:
            return f
        values = [
            p.constraint.profile_values(s, self.system.unit, min(order + 2, PROFILE_ORDER))
            for p, s in zip(self.placed, parameters.value, strict=True)
        ]
        return (*f, tuple(map(np.array, zip(*values, strict=True))))


class SparseSystem:
    """The equations of a system, assembled by groups into compressed columns.

    Attributes
    ----------
    system : System
        With as many rows as coordinates.
    """

    def __init__(self, system: System) -> None:
        if system.m != system.n:
            raise ValueError(f"expected as many rows as coordinates, got {system.m} and {system.n}")
        self.system = system
        kinds: dict[Any, list[ConstraintRows]] = {}
        for p in system.placed:
            c = p.constraint
            sides = tuple(start is None for start in p.starts)
            kinds.setdefault((type(c), getattr(c, "contact", None), len(c.laws), sides), []).append(p)
        self.groups = [Group(system, placed) for placed in kinds.values()]
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
        values = _Values(self.system, q, None)
        for group, places in zip(self.groups, self._places, strict=True):
            for place, (_, _, entry) in zip(places, self._entries(group, values, t), strict=True):
                if not isinstance(entry, int):
                    data[place] = entry
        return csc_array((data, *self._pattern), shape=(self.system.n, self.system.n))

    def _entries(self, group: Group, values: _Values, t: float) -> Iterator[tuple[Any, Any, Any]]:
        """Yield rows, columns and values of the entries of a group that are not the integer 0; others are always 0."""
        at = [values.at(start) for start in group.starts]
        blocks = group.formulas.jacobian(group.g, group.given(at[-1], t, 0), *at)
        for start, block in zip(group.starts, blocks, strict=True):
            if start is None:
                continue
            for row, entries in zip(group.rows, block, strict=True):
                for k, entry in enumerate(entries):
                    if not (isinstance(entry, int) and entry == 0):
                        yield row, (start, k), entry

    def _right(self, q: Any, qd: Any, t: float, order: int, formula: str) -> Any:
        values = _Values(self.system, q, qd)
        out = np.zeros(self.system.m)
        for group in self.groups:
            at = [values.at(start) for start in group.starts]
            f = group.given(at[-1], t, order)
            for row, value in zip(group.rows, getattr(group.formulas, formula)(group.g, f, *at), strict=True):
                out[row] = value
        return out

    def _lay_out(self) -> None:
        """Find the pattern, where in it each entry of each group goes, and what is constant."""
        from scipy.sparse import csc_array

        n = self.system.n
        values = _Values(self.system, np.zeros(n), None)
        by_group = [list(self._entries(group, values, 0.0)) for group in self.groups]
        entries = [entry for of_group in by_group for entry in of_group]
        rows = np.concatenate([row for row, _, _ in entries])
        columns = np.concatenate([start + k for _, (start, k), _ in entries])
        numbers = np.arange(1.0, len(rows) + 1)
        order = csc_array((numbers, (rows, columns)), shape=(n, n))
        order.sort_indices()
        place = np.empty(len(rows), int)
        place[order.data.astype(int) - 1] = np.arange(len(rows))
        each = iter(np.split(place, np.cumsum([len(row) for row, _, _ in entries])[:-1]))
        self._places = [[next(each) for _ in of_group] for of_group in by_group]
        self._pattern = order.indices, order.indptr
        self._constants = np.zeros(len(rows))
        for places, of_group in zip(self._places, by_group, strict=True):
            for at, (_, _, entry) in zip(places, of_group, strict=True):
                self._constants[at] = entry if isinstance(entry, int) else 0.0


class _Values:
    """The values of bodies and parameters at q (n,), gathered for a group; cosines are taken once."""

    def __init__(self, system: System, q: Any, qd: Any) -> None:
        self.bodies, self.q, self.qd = system.of_bodies, q, qd
        self.c, self.s = (np.empty_like(self.q) for _ in range(2))
        at = system.angles
        self.c[at], self.s[at] = cosine_and_sine(self.q[at])

    def at(self, start: Any) -> Any:
        """Return the values of the bodies, or of the parameters, that start there; of the ground if None."""
        if start is None:
            return BodyValues(0.0, 0.0, 0.0).moving(0.0, 0.0, 0.0)
        if start[0] >= self.bodies:
            parameter = ParameterValue.__new__(ParameterValue)
            parameter.value, parameter.c, parameter.s = self.q[start], self.c[start], self.s[start]
            return parameter if self.qd is None else parameter.moving(self.qd[start])
        body = BodyValues.__new__(BodyValues)
        body.r, body.phi = Vec(self.q[start], self.q[start + 1]), self.q[start + 2]
        body.c, body.s = self.c[start + 2], self.s[start + 2]
        return body if self.qd is None else body.moving(*(self.qd[start + k] for k in range(3)))


def solve_large(scene: Scene) -> Large:
    """Return position, velocity and acceleration at the scene's first time, as far as it calls for them.

    Newton's method from the scene's estimates, all of which are needed. The pose is ok if Newton contracted at once,
    the residual is at round-off and `Large.h` is small; nothing is searched for and nothing is proved.
    """
    implied = {Effect.VELOCITY} if Effect.ACCELERATION in scene.effects else set()
    system = compile_system(scene.mechanism, scene.effects | implied, scene.mechanism.unit())
    missing = [b.name for b in scene.mechanism.bodies if b.estimate is None]
    if missing:
        raise InvalidScene([Fault(f"body {missing[0]!r}", None, "an estimate of its first pose")], scene.name)
    estimate = system.to_unit(np.array([x for b in scene.mechanism.bodies for x in b.estimate or ()]))
    sparse, t, steps = SparseSystem(system), scene.times[0], list[float]()
    q = initial_contacts(system, estimate, t)
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
    closes = size <= ROUND_OFF * scale and steps[-1] <= ENOUGH * scale and contracts(steps)
    norm = inverse_norm(lu, len(q))
    h = LIPSCHITZ * norm * float(np.max(np.abs(lu.solve(residual))))
    status = Status.NOT_CONVERGED if not closes else Status.OK if h <= LARGEST_H else Status.SINGULAR
    levels = [q, None, None] if closes else [None] * 3
    if status is Status.OK and system.effects:
        levels[1] = lu.solve(sparse.nu(q, t))
        if Effect.ACCELERATION in system.effects:
            levels[2] = lu.solve(sparse.gamma(q, levels[1], t))
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
