"""How many freedoms a mechanism has: by Gruebler's count, and by the rank of its constraints at a pose.

The count needs only which joints there are: n_d = d n_b - n_c, with d = 3 in the plane and 6 in space, n_b bodies of
which the ground is one, and n_c equations, d for the ground and d less a joint's freedoms for each joint (Shabana,
Computational Dynamics, section 3.5). It is right if the equations are independent. The rank says whether they are, at
one pose: mobility = n - rank(phi_q) of the joints alone. That is the instantaneous mobility: at a singular pose, and in
a shaky linkage at every pose, it exceeds the finite one (Müller 2016).
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from refkin.errors import Fault, InvalidScene, expect
from refkin.joints import GROUND, JOINT_TYPES, KINDS, SPACE, SPATIAL_JOINT_TYPES, passive_spins, with_unit_length
from refkin.joints.annotations import check, is_real
from refkin.joints.spatial_vectors import Quaternion
from refkin.model import Mechanism
from refkin.motion import SINGULAR
from refkin.proof.singularity.second_order import balance, elsewhere, without_rounding
from refkin.system import System, compile_system

_PLANAR: Any = [joint for joint in JOINT_TYPES if isinstance(joint.rows, int)]
_SPATIAL: Any = SPATIAL_JOINT_TYPES


def _formulas(joint: Any) -> Any:
    """Return the formulas of a joint of space that says its elements one by one, in the first form of each."""
    return [next(iter(term.values())) if isinstance(term, dict) else term for term in joint.formulas]


FREEDOMS: Mapping[str, Mapping[str, int]] = {
    "planar": {joint.type: 3 - joint.rows for joint in _PLANAR} | {"cam": 2},
    "spatial": {j.type: 6 - sum(e.rows for e in j.consists_of or _formulas(j)) for j in _SPATIAL} | {"screw": 1},
}
"""Freedoms that a joint leaves between two bodies: all but those that its rows take, in space those of its elements.

A cam and a screw bring a coordinate of their own, and a row more for it.
"""

Connection = tuple[str, str, str]
"""Type of a joint, and the names of its two bodies."""


def kind_of(mobility: int) -> str:
    """Return what a system of this mobility is called."""
    if mobility == 0:
        return "structure"
    if mobility < 0:
        return f"overconstrained: {-mobility} equation{'s' * (mobility < -1)} more than coordinates"
    return "mechanism with one freedom" if mobility == 1 else f"mechanism with {mobility} freedoms"


class _Freedoms:
    """What a number of freedoms, `mobility`, and what is `passive` among them say."""

    mobility: Any
    passive: Any

    @property
    def useful(self) -> int:
        """Mobility without what is passive."""
        return int(self.mobility - len(self.passive))

    @property
    def kind(self) -> str:
        """What such a system is called: "structure" if nothing can move."""
        return kind_of(self.mobility)


@dataclass(frozen=True, kw_only=True)
class Count(_Freedoms):
    """Gruebler's count.

    Attributes
    ----------
    bodies, equations : int
        n_b with the ground, n_c with the ground's own.
    coordinates : int
        d of one body.
    passive : tuple of str
        Bodies that spin on their own without moving anything else: in space, those held by two spherical joints alone.
    """

    bodies: int
    equations: int
    coordinates: int
    passive: tuple[str, ...]

    @property
    def mobility(self) -> int:
        """n_d = d n_b - n_c, passive spins included."""
        return self.coordinates * self.bodies - self.equations


def gruebler(joints: Sequence[Connection], dimension: str = "planar") -> Count:
    """Count the freedoms of bodies held by joints.

    Parameters
    ----------
    joints : sequence of (type, body, body)
        Types as in `FREEDOMS`; the ground is called "ground".
    dimension : str
        "planar" or "spatial".

    Raises
    ------
    InvalidScene
        If there is no such dimension or type of joint, or a joint is not between two bodies.
    """
    if dimension not in FREEDOMS:
        raise InvalidScene([Fault("dimension", dimension, " or ".join(FREEDOMS))], "mobility")
    free, d = FREEDOMS[dimension], KINDS[dimension].freedoms
    if faults := list(_faults(joints, free)):
        raise InvalidScene(faults, "mobility")
    bodies = dict.fromkeys([GROUND, *(body for _, *pair in joints for body in pair)])
    held = {body: [kind for kind, *pair in joints if body in pair] for body in bodies}
    return Count(
        bodies=len(bodies),
        equations=d + sum(d - free[kind] for kind, _, _ in joints),
        coordinates=d,
        passive=tuple(body for body, by in held.items() if by == ["spherical"] * 2 and body != GROUND),
    )


def _faults(joints: Sequence[Any], free: Mapping[str, int]) -> Iterator[Fault]:
    """Yield what is no type of joint between two bodies."""
    for k, joint in enumerate(joints):
        if isinstance(joint, str) or len(joint) != 3 or joint[1] == joint[2]:
            yield Fault(f"joints[{k}]", joint, "a type and two different bodies")
        elif joint[0] not in free:
            yield Fault(f"joints[{k}]", joint[0], f"one of {', '.join(free)}")


def count(mechanism: Mechanism) -> Count:
    """Count the freedoms of a mechanism's joints, without its drivers.

    What a joint takes are its rows; of those that it repeats as printed, only the others.
    """
    d, joints = mechanism.kind.freedoms, mechanism.joints
    bodies = {GROUND, *(body.name for body in mechanism.bodies)}
    taken = sum(joint.independent - joint.parameters for joint in joints)
    passive = tuple(row.name for row in mechanism.kind.own_rows(mechanism.bodies, mechanism.constraints) if row.passive)
    return Count(bodies=len(bodies), equations=d + taken, coordinates=d, passive=passive)


def too_many_drivers(mechanism: Mechanism) -> str:
    """Return in words that there are more drivers than freedoms, by count; "" if there are not, or only one is."""
    freedoms, names = max(count(mechanism).mobility, 1), [driver.name for driver in mechanism.drivers]
    if len(names) <= freedoms:
        return ""
    listed = ", ".join(names)
    return f"too many drivers, by count: {len(names)} ({listed}) of {freedoms} freedom{'s' * (freedoms > 1)}"


@dataclass(frozen=True)
class Dependence:
    """A row of phi_q that is the sum of others times `factors`: it takes no freedom away that these leave.

    Rows are named by their joint, with a number where a joint has several.
    """

    row: str
    factors: Mapping[str, float]

    def __str__(self) -> str:
        return f"{self.row} depends on {', '.join(self.factors) or 'nothing: it vanishes'}"


@dataclass(frozen=True)
class Rank:
    """The rank of some rows of phi_q at a pose.

    Attributes
    ----------
    coordinates, rank : int
    kept, dropped : float
        Smallest singular value of the balanced rows that counts and largest that does not (0 if there is none): how
        clear the decision is.
    dependent : tuple of Dependence
        One for each row beyond the rank; the last of the rows that depend on each other is named.
    """

    coordinates: int
    rank: int
    kept: float
    dropped: float
    dependent: tuple[Dependence, ...]

    @property
    def freedoms(self) -> int:
        """What the rows leave free: coordinates - rank."""
        return self.coordinates - self.rank


@dataclass(frozen=True)
class Mobility(_Freedoms):
    """Rank-based mobility at a pose: of the joints alone, and with the drivers.

    `passive` are in words the motions that one body of space, or several as one, can make while nothing else moves.
    """

    joints: Rank
    driven: Rank
    passive: tuple[str, ...] = ()

    @property
    def mobility(self) -> int:
        """What the joints leave free: n - rank(phi_q)."""
        return self.joints.freedoms


def mobility(mechanism: Mechanism, q: Any, t: float = 0.0, tolerance: float = SINGULAR) -> Mobility:
    """Return the mobility of a mechanism at a pose.

    Parameters
    ----------
    mechanism : Mechanism
    q : (n,) array
        Coordinates of the bodies in their order [m, rad], then the parameters of contacts, if there are any. Euler
        parameters are made a unit.
    t : float
        When [s].
    tolerance : float
        Singular values of the balanced phi_q at or below this do not count.

    Raises
    ------
    InvalidRequest
        If q are not as many numbers, or Euler parameters of a body all 0, if t is not finite, or the tolerance no
        number of at least 0.
    """
    expect("mechanism", mechanism, Mechanism)
    system = compile_system(mechanism, unit=mechanism.unit())
    check("q", f"{system.n} coordinates", q, is_real(q, system.n) and bool(np.isfinite(np.asarray(q, float)).all()))
    check("t", "a finite time [s]", t, is_real(t) and bool(np.isfinite(t)))
    check("tolerance", "a number of at least 0", tolerance, is_real(tolerance) and tolerance >= 0.0)
    return mobility_of(system, system.to_unit(_of_unit_length(system, np.array(q, float))), t, tolerance)


def _of_unit_length(system: System, q: Any) -> Any:
    """Return a pose (n,) with Euler parameters of length 1, as those of an estimate are made."""
    if system.kind is SPACE:
        bodies = q[: system.of_bodies].reshape(-1, SPACE.width)
        check("q", "Euler parameters that are not all 0", q.tolist(), bool(bodies[:, 3:].any(axis=1).all()))
        q[: system.of_bodies] = np.ravel([with_unit_length(tuple(body)) for body in bodies.tolist()])
    return q


def mobility_of(system: System, q: Any, t: float = 0.0, tolerance: float = SINGULAR) -> Mobility:
    """Return the mobility at a pose.

    Parameters
    ----------
    system : System
        Compiled in its mechanism's own unit.
    q : (n,) array
        The pose at time t [s], in the system's coordinates.
    t : float
        When [s].
    tolerance : float
        Singular values of the balanced phi_q at or below this do not count.
    """
    if np.shape(q) != (system.n,):
        raise InvalidScene([Fault("q", np.shape(q), f"{system.n} coordinates")], "mobility")
    names, constraints = row_names(system), system.mechanism.constraints
    kinematic = sum(joint.rows for joint in constraints[: len(system.mechanism.joints)])
    driven = sum(constraint.rows for constraint in constraints)
    by_joints, by_all = (_slopes(system, q, t, m) for m in (kinematic, driven))
    of_joints, of_all = (rank_of(rows, names[: len(rows)], tolerance) for rows in (by_joints, by_all))
    return Mobility(of_joints, of_all, tuple(_alone(system, q, by_all, tolerance)))


def _slopes(system: System, q: Any, t: float, rows: int) -> Any:
    """Return the first rows of phi_q in `common_columns`, without those and the columns of which rounding is left."""
    here, there = (common_columns(system, x, system.phi_q(x, t)[:rows]) for x in (q, elsewhere(system, q)))
    return without_rounding(without_rounding(here, there).T, there.T).T


def _alone(system: System, q: Any, phi_q: Any, tolerance: float) -> Iterator[str]:
    """Yield the motions that a body of space, or bodies as one, can make while all others stand still.

    They are null vectors on the six columns of the one body; bodies that spin as one have those that a velocity of
    their points at the origin and an angular velocity give them. Rows and columns are balanced as those of all bodies
    are: in the sum over bodies that are as one the rows between them hold nothing but rounding.
    """
    if system.kind is not SPACE:
        return
    _, by_row, by_column = balance(phi_q)
    phi_q = phi_q * by_row[:, None]
    bodies, constraints = system.mechanism.bodies, system.mechanism.constraints
    together = [tuple(spin) for spin in passive_spins(bodies, constraints) if len(spin) > 1]
    for names in [*((body.name,) for body in bodies), *together]:
        at = [q[system.columns(name)] for name in names]
        columns = sum(
            _as_one(phi_q, system.columns(name).start // 7, own[:3] - at[0][:3])
            for name, own in zip(names, at, strict=True)
        )
        k = 6 * (system.columns(names[0]).start // 7)
        scale = np.repeat([np.min(by_column[k : k + 3]), np.min(by_column[k + 3 : k + 6])], 3)
        _, sigma, motions = np.linalg.svd(columns * scale)
        rotation = SPACE.values(*at[0]).rotation()
        for motion in motions[int(np.sum(sigma > tolerance)) :] * scale:
            v, w = (rotation.T @ part / np.linalg.norm(motion) for part in (motion[:3], motion[3:]))
            yield _in_words(names, v, w, system.unit.size, tolerance)


def _as_one(phi_q: Any, k: int, arm: Any) -> Any:
    """Return the columns (m, 6) of the k-th body, carried by an arm from a point with the velocities (v, omega)."""
    v, w = phi_q[:, 6 * k : 6 * k + 3], phi_q[:, 6 * k + 3 : 6 * k + 6]
    return np.hstack([v, w + np.cross(arm, v)])


def _in_words(names: Sequence[str], v: Any, w: Any, unit: float, tolerance: float) -> str:
    """Return a screw motion of bodies in words, with v and omega as they are in the first."""
    who, size = " and ".join(names), float(np.linalg.norm(w))
    s, of = ("s", "of its own") if len(names) == 1 else ("", f"of {names[0]}")
    if size <= tolerance:
        return f"{who} slide{s} along {_numbers(v / np.linalg.norm(v))} {of}"
    at, pitch = np.cross(w, v) * (unit / size**2), float(v @ w) * unit / size**2
    spins = f"{who} spin{s}{'' if s else ' as one'}"
    return f"{spins} about {_numbers(w / size)} through {_numbers(at)} {of}, pitch {round(pitch, 9) + 0.0:.3g}"


def _numbers(v: Any) -> str:
    return f"({', '.join(f'{round(float(x), 9) + 0.0:.6g}' for x in v)})"


def common_columns(system: System, q: Any, phi_q: Any) -> Any:
    """Return phi_q with the columns that all who compute it share: of space phi_q T, T = diag(I, E^T / 2).

    There a body has six: of its velocity and its angular velocity in the ground frame; p . p = 1 then says nothing. Of
    the plane, and of parameters, the columns are as they are.

    Parameters
    ----------
    system : System
    q : (n,) array
        The pose, its Euler parameters of length 1.
    phi_q : (rows, n) array
    """
    if system.kind is not SPACE:
        return phi_q
    blocks = []
    for start in range(0, system.of_bodies, SPACE.width):
        p = Quaternion.of(*q[start + 3 : start + 7])
        turning = [Quaternion.of(0.0, *axis).times(p).parts for axis in np.eye(3).tolist()]  # 2 p' of omega along each
        blocks += [phi_q[:, start : start + 3], phi_q[:, start + 3 : start + 7] @ np.array(turning).T / 2]
    return np.hstack([*blocks, phi_q[:, system.of_bodies :]])


def row_names(system: System) -> tuple[str, ...]:
    """Return the name of each row: its constraint's, with a number where a constraint has several rows."""
    return tuple(
        p.constraint.name if p.constraint.rows == 1 else f"{p.constraint.name}[{k}]"
        for p in system.placed
        for k in range(p.constraint.rows)
    )


def rank_of(matrix: Any, names: Sequence[str], tolerance: float = SINGULAR) -> Rank:
    """Return the rank of a matrix, and which of its rows depend on which.

    Parameters
    ----------
    matrix : (m, n) array
        Rows of phi_q.
    names : sequence of str
        What the rows are called, m of them.
    tolerance : float
        Singular values of the balanced rows at or below this do not count: units, and small parts beside large ones,
        say nothing of a rank.
    """
    m, n = matrix.shape
    if not m:
        return Rank(n, 0, 0.0, 0.0, ())
    matrix, by_row, _ = balance(matrix)
    left, sigma, _ = np.linalg.svd(matrix)
    rank = int(np.sum(sigma > tolerance))
    kept = float(sigma[rank - 1]) if rank else 0.0
    dropped = float(sigma[rank]) if rank < len(sigma) else 0.0
    # What rounding and the pose leave of a factor that is zero: a perturbation over the smallest value that counts.
    smallest = min(0.1, tolerance / kept) if rank else 0.1
    return Rank(n, rank, kept, dropped, tuple(_dependences(left[:, rank:].T, by_row, names, smallest)))


def _dependences(null: Any, by_row: Any, names: Sequence[str], smallest: float) -> Iterator[Dependence]:
    """Yield the dependences in a basis (m - rank, m) of the left null space, by elimination from the last row on.

    The basis is that of rows times `by_row` (m,); what is small is so for those.
    """
    rest = np.array(null)
    solved: list[tuple[int, Any]] = []
    for row in range(len(names) - 1, -1, -1):
        if not len(rest):
            break
        k = int(np.argmax(np.abs(rest[:, row])))
        if abs(rest[k, row]) <= smallest:
            continue
        pivot = rest[k] / rest[k, row]
        rest = np.delete(rest, k, axis=0)
        rest = rest - np.outer(rest[:, row], pivot)
        solved = [(other, basis - basis[row] * pivot) for other, basis in solved]
        solved.append((row, pivot))
    for row, basis in reversed(solved):
        factors = -basis * by_row / by_row[row]
        yield Dependence(
            names[row], {names[k]: float(factors[k]) for k, x in enumerate(basis) if abs(x) > smallest and k != row}
        )
