"""Why a pose is singular, in words: what `refkin.diagnose` says at a pose where phi_q has not full rank, or nearly so.

phi_q is looked at with every body's frame on one of its joints (`recentred`) and its rows and columns balanced, so that
neither units, nor lengths of 1e-6, nor frames far away pass for singularities. Let J_K be its rows of joints, of rank
r_K, and n - r_K the mobility of the pose, to be held by d driven rows. `PoseKind` says what there is.

A turning point is an actuator singularity too: with another driver the same pose is regular; the message says which.
(F. C. Park and J. W. Kim, J. Mech. Des. 121, 1999; A. Mueller, J. Mechanisms Robotics 2016; that second-order tests
need not decide: P. Lopez-Custodio, A. Mueller, J. S. Dai, J. Mechanisms Robotics 2021.)
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from enum import StrEnum
from typing import Any

import numpy as np

from refkin.joints import GROUND, SPACE
from refkin.motion import Array
from refkin.proof.numbers.inputs import contradiction
from refkin.proof.numbers.preconditioned import leading_rows
from refkin.proof.numbers.recentred import Recentred, recentred
from refkin.proof.pose.choices import isolate_every_choice
from refkin.proof.pose.krawczyk import krawczyk
from refkin.proof.singularity.second_order import advances, balanced, cone, elsewhere
from refkin.system import System

VANISHING = 1e-6
"""Balanced singular values, and rows, that count as zero: a singular pose is known to the root of round-off."""
INVOLVED = 1e-4
"""Part of the largest entry of a null vector that makes a row or body count as involved."""
NEAR = 1e-3
"""Balanced singular value below which a regular pose is called nearly singular."""
OPEN = 1e-6
"""Largest scaled residual of what is taken for a pose."""


class PoseKind(StrEnum):
    """What a pose is, in the terms of the module."""

    REGULAR = "regular"
    """phi_q has full rank; the pose is proved to be alone."""
    REDUNDANT = "redundant rows"
    """So it has, with more rows than coordinates."""
    STRUCTURE = "structure"
    """The joints alone hold everything: n = r_K; or what moves to first order does not to second."""
    FORMULATION = "formulation singularity"
    """A row of phi_q vanishes: the equation is not fit for this pose (a cylinder of length zero)."""
    TURNING_POINT = "turning point"
    """n - r_K = d, and the drivers do not hold a motion v that the joints allow: the input turns back there, for its
    second derivative along v, psi . phi_qq[v, v], is not zero."""
    ACTUATOR = "actuator singularity"
    """Likewise, but it is zero, or several motions are not held."""
    IDLE = "idle motion"
    """A motion that no driver holds, and that goes on."""
    BIFURCATION = "bifurcation"
    """n - r_K > d: two or more motions satisfy psi . phi_qq[v, v] = 0 for all psi with psi^T J_K = 0."""
    HIGHER = "singularity of higher order"
    """None of these tests decides."""


@dataclass(frozen=True, kw_only=True)
class Diagnosis:
    """What a pose is, and why.

    Attributes
    ----------
    sigma : float
        The smallest singular value of the balanced phi_q: about 1 at a good pose of any mechanism.
    rows : tuple of str
        The joints and drivers whose rows depend on each other.
    bodies : tuple of str
        The bodies that move although all drivers are held.
    tangents : tuple of (n,) arrays
        At a bifurcation the directions [m, rad] in which poses go on.
    other_driver : str
        A driver with which the same pose is regular; empty if none was found, or needed.
    message : str
        In words.
    """

    kind: PoseKind
    sigma: float
    rows: tuple[str, ...] = ()
    bodies: tuple[str, ...] = ()
    tangents: tuple[Array, ...] = ()
    other_driver: str = ""
    message: str = ""


def diagnose_scaled(system: System, q: Any, t: float) -> Diagnosis:
    """Say what a pose is.

    Parameters
    ----------
    system : System
        Compiled in its mechanism's own unit.
    q : (n,) array
        The pose, in the system's coordinates.
    t : float
        Its time [s].

    Raises
    ------
    ValueError
        If q does not close.
    """
    # Far from their origin, x and y carry the rounding of their own size.
    with np.errstate(all="ignore"):  # what leaves the numbers' range is no pose
        residual, size = float(np.max(np.abs(system.phi(q, t)))), max(1.0, float(np.max(np.abs(q))))
    if not residual <= OPEN * size < np.inf:
        raise ValueError(f"q is no pose at t = {t:g}: its largest scaled residual is {residual:.3g}")
    frames = recentred(system)
    inner, polished = frames.inner, frames.inward(q)
    for _ in range(3):  # to round-off, by the shortest corrections: Newton's may be long here
        polished = polished - np.linalg.pinv(inner.phi_q(polished, t), rcond=VANISHING) @ inner.phi(polished, t)
    pose = _Examination(frames, polished, t)
    return pose.isolated() if _is_alone(system, q, t) else pose.singular()


def _is_alone(system: System, q: Any, t: float) -> bool:
    """Whether a pose passes the test that gives it its status: of these numbers, a polished pose may where they do not.

    Where it is nearly singular, other rows of the redundant ones have to be known to say the same.
    """
    proof = isolate_every_choice(system, q[:, None], [t])
    return bool(proof.ok[0] and (np.isfinite(proof.position[0]) or recentred(system).is_regular(q, t)))


class _Examination:
    """One pose in recentred frames."""

    def __init__(self, frames: Recentred, q: Any, t: float, vanishing: float = VANISHING) -> None:
        self.frames, self.system, self.q, self.t, self.vanishing = frames, frames.inner, q, t, vanishing
        self.constraints = [p.constraint for p in self.system.placed for _ in range(p.constraint.rows)]
        m, every = self.system.mechanism, np.arange(self.system.m)  # rows of joints, of drivers, of bodies
        first = sum(joint.rows for joint in m.constraints[: len(m.joints)])
        self.stated = sum(constraint.rows for constraint in m.constraints)
        self.driven = every[first : self.stated]
        self.all = balanced(self.system, q, t, every)
        self.joints = balanced(self.system, q, t, np.setdiff1d(every, self.driven))
        self.sigma = self.all.sigma[self.system.n - 1]
        self.mobility = self.system.n - self.joints.rank(self.vanishing)

    def singular(self) -> Diagnosis:
        """Say which kind of singularity this is."""
        poses = self.q, elsewhere(self.system, self.q)
        here, there = (np.linalg.norm(self.system.phi_q(q, self.t), axis=1) for q in poses)
        vanishing = np.flatnonzero(here <= VANISHING * there)
        if vanishing.size:
            rows = self._names(vanishing)
            what = "points that it holds apart coincide, or a tangent is zero"
            return self._of(
                PoseKind.FORMULATION, f"the equation of {_and(rows)} has no gradient here: {what}", rows=rows
            )
        if self.all.rank(self.vanishing) == self.system.n:
            return self._of(PoseKind.HIGHER, "the pose is not proved to be alone, although phi_q has full rank")
        if self.mobility <= len(self.driven):
            return self._not_held()
        return self._mobile()

    def _of(self, kind: PoseKind, message: str, **more: Any) -> Diagnosis:
        return Diagnosis(kind=kind, sigma=float(self.sigma), message=f"{kind.value}: {message}", **more)

    def isolated(self) -> Diagnosis:
        """Say what is to be said of a pose that is proved to be alone."""
        rows = self._rows(self.all.left_null(self.system.n)) if self.system.m > self.system.n else ()
        if self.mobility == 0:
            return self._of(PoseKind.STRUCTURE, "the joints alone hold every body: no driver can move it", rows=rows)
        if not rows:
            return self._of(PoseKind.REGULAR, f"the pose is proved to be alone{self._near()}")
        enclosure = krawczyk(self.system, self.q, self.t)
        times = np.array([self.t])
        size = (
            0.0 if enclosure is None else contradiction(self.system, enclosure.rows, enclosure.root(self.q), times)[0]
        )
        how = "agree" if size <= 1.0 else f"contradict each other: {size:.3g} times what rounding explains"
        return self._of(PoseKind.REDUNDANT, f"the rows of {_and(rows)} depend on each other, and {how}", rows=rows)

    def _near(self) -> str:
        if self.sigma >= NEAR:
            return ""
        like = _Examination(self.frames, self.q, self.t, vanishing=max(VANISHING, 4 * float(self.sigma))).singular()
        return f"; it is nearly singular (sigma {self.sigma:.3g}), beside a pose of this kind: {like.message}"

    def _not_held(self) -> Diagnosis:
        """The drivers do not hold what the joints allow."""
        free = self.all.right_null(self.vanishing)
        left = self.all.left_null_with(self.driven, self.vanishing)
        rows, bodies = self._rows(left), self._bodies(free)
        other = self._other_driver(free)
        same = f"; driven by {other} the same pose is regular (an actuator singularity)" if other else ""
        who = {"rows": rows, "bodies": bodies, "other_driver": other}
        held = f"with the drivers held {_moving(bodies)} can still move"
        if free.shape[1] == 1 and self._turns_back(free[:, 0], left[0]):
            # Beside a bifurcation all drivers have small parts of psi.
            drivers = self._rows(np.where(np.isin(np.arange(self.system.m), self.driven), left[:1], 0.0))
            turned = f"{_and(drivers)} turn{'s' * (len(drivers) == 1)} back"
            return self._of(PoseKind.TURNING_POINT, f"{held} to first order, and {turned}{same}", **who)
        if self._goes_on(free):
            return self._of(PoseKind.IDLE, f"{held} on and on{same}", **who)
        return self._of(PoseKind.ACTUATOR, f"{held} to first order{same}", **who)

    def _turns_back(self, v: Any, psi: Any) -> bool:
        """Whether psi . phi_qq[v, v] is not zero, and of one sign as far off as a pose of third order may be known.

        Where three roots meet a pose is known to the cube root of round-off, and a bend is left that changes its sign.
        """
        way = self.vanishing ** (2 / 3) / np.max(np.abs(v))
        bends = [v @ replace(self.all, q=self.q + k * way * v).bend(psi) @ v for k in (-1, 0, 1)]
        return bool(abs(bends[1]) > self.vanishing and np.ptp(np.sign(bends)) == 0)

    def _mobile(self) -> Diagnosis:
        """The joints allow more motions than there are driven rows."""
        free, held = self.all.right_null(self.vanishing), self.joints
        tangent_cone = cone(held, self.vanishing, self.system.phi_q(self.q, self.t)[self.driven])
        rows, bodies = self._rows(held.left_null(self.system.n - self.mobility), held.rows), self._bodies(free)
        who = {"rows": rows, "bodies": bodies}
        more = f"the joints allow {self.mobility} motion{'s' * (self.mobility != 1)} to first order"
        if tangent_cone.forms == 0:
            if self._goes_on(free):
                return self._of(PoseKind.IDLE, f"no driver holds {_moving(bodies)}", bodies=bodies)
            return self._of(PoseKind.HIGHER, f"{more}; to second order nothing forbids one of them", **who)
        if len(tangent_cone.tangents) > 1:
            rates = [self.frames.outward_rate(self.q, v) for v in tangent_cone.tangents]
            tangents = tuple(self.frames.system.to_physical(r / np.max(np.abs(r)), order=1) for r in rates)
            some = f"{more}; to second order {len(tangents)} of them go on, and the path may take any"
            return self._of(PoseKind.BIFURCATION, some, tangents=tangents, **who)
        if tangent_cone.tangents:
            return self._of(
                PoseKind.HIGHER, f"{more}, of which one goes on: the rows are dependent, the path is not", **who
            )
        if tangent_cone.is_definite:
            return self._of(PoseKind.STRUCTURE, f"{more}, to second order none: the pose is alone, and shaky", **who)
        return self._of(PoseKind.HIGHER, f"{more}; the second order does not decide which of them go on", **who)

    def _goes_on(self, free: Any) -> bool:
        """Whether some of the motions (n, k) goes on, of such as have each a coordinate that the others leave alone."""
        apart = free @ np.linalg.inv(free[leading_rows(free, free.shape[1])])
        return any(advances(self.system, self.q, self.t, v) for v in apart.T)

    def _other_driver(self, free: Any) -> str:
        """Return a driven angle, or coordinate, in place of one of the drivers, with which the pose is regular.

        None of space: no driver takes an Euler parameter.
        """
        if self.system.kind is SPACE:
            return ""
        names = [body.name for body in self.system.mechanism.bodies]
        kind = self.system.kind
        size = np.max(np.abs(free), axis=1)[: self.system.of_bodies].reshape(-1, kind.width)
        candidates = []
        for k, name in enumerate(names):
            for c, coordinate in enumerate(kind.coordinates):
                words = "the angle" if coordinate == "phi" else coordinate
                weight = 1.0 if kind.turns[c] else 1e-3
                candidates.append((weight * size[k, c], f"{words} of {name}", kind.width * k + c))
        for _, words, column in sorted(candidates, reverse=True)[:4]:
            for driver in self.driven:
                if self.all.with_row(driver, column).rank(1e3 * VANISHING) == self.system.n:
                    return words
        return ""

    def _rows(self, null: Any, among: Any = None) -> tuple[str, ...]:
        """Return the constraints with a part in null vectors (k, m) of rows `among` (m,), by default all."""
        size = np.max(np.abs(null), axis=0, initial=0.0)
        involved = np.flatnonzero(size > INVOLVED * np.max(size, initial=0.0))
        return self._names(involved if among is None else among[involved])

    def _names(self, rows: Any) -> tuple[str, ...]:
        return tuple(dict.fromkeys(self.constraints[k].name for k in rows if k < self.stated))  # p . p = 1 says nothing

    def _bodies(self, free: Any) -> tuple[str, ...]:
        """Return the bodies that move in the motions (n, k)."""
        size = np.max(np.abs(free), axis=1)[: self.system.of_bodies].reshape(-1, self.system.kind.width).max(axis=1)
        names = [body.name for body in self.system.mechanism.bodies]
        return tuple(name for name, x in zip(names, size, strict=True) if x > INVOLVED * size.max() and name != GROUND)


def _moving(bodies: Any) -> str:
    return _and(bodies) if bodies else "the place where a cam is touched"


def _and(names: Any) -> str:
    names = list(names)
    return names[0] if len(names) == 1 else f"{', '.join(names[:-1])} and {names[-1]}" if names else "nothing"
