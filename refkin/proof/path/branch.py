"""Whether poses one after another belong to one motion: proved by tubes (`tube`), in float64 and then in balls."""

from __future__ import annotations

from collections import Counter
from collections.abc import Sequence
from typing import Any, NamedTuple

import numpy as np

from refkin.differences import EPS
from refkin.proof.numbers.bounded import UP, U
from refkin.proof.numbers.preconditioned import independent_rows, inverses
from refkin.proof.path.curve import Curve, crossing
from refkin.proof.path.tube import Between, ConnectionProof, Tubes
from refkin.proof.pose.certificate import certify
from refkin.system import System

HALVINGS = 20
"""How often a step is halved in float64; what is left then is not for want of small pieces, but of digits."""
MOST_IN_VAIN = 9
"""How often all pieces of a step may be halved without one of them being proved in float64, unless smaller ones are."""
SMALLER = 4
"""How often the first of these pieces is halved to see whether smaller ones are proved."""
MOST_PIECES = 2**14
"""Pieces that are tried in float64; a turn of a well-conditioned linkage needs about 50."""
SAGITTA = 0.1
"""How far a pose may lie from the middle of a chord, in units of its length, to be taken for one of the same branch."""
DOUBTED = 3
"""How often that is until it is asked whether the step meets a crossing of branches."""
FIRST_STEPS = 4
"""How many steps are tried together first; then twice as many, and so on."""
MOST_TUBES, FEW_TUBES = 4000, 400
"""Tubes that are tried in balls, a millisecond each, where all steps are asked for, and where some are."""
BLURRED = 1e-7
"""How far from their places poses may lie that are found near a crossing: the root of round-off, and more."""
CROSSED = EPS
"""|mu| of a singular point (`curve`) up to which branches cross there, and no proof is tried."""


class Piece(NamedTuple):
    """Two poses at two times, bounds of their errors, and the number of the given pose at or before them."""

    t_0: Any
    t_1: Any
    q_0: Any
    q_1: Any
    r_0: Any
    r_1: Any
    number: int

    @property
    def is_certified(self) -> bool:
        """Whether both poses are."""
        return bool(np.isfinite(self.r_0).all() and np.isfinite(self.r_1).all())


def first_unproved(system: System, t: Any, q: Any, between: Between, steps: Sequence[int] | None = None) -> int | None:
    """Return the first k for which it is not proved that poses k and k + 1 belong to one motion; None if all do.

    A step that one tube does not cover is halved, at the pose that is found in its middle; what float64 does not prove
    is left to balls.

    Parameters
    ----------
    system : System
        Compiled in its mechanism's own unit, for velocity at least.
    t, q : (T,) and (n, T) array
        Times in increasing order, and the poses there, in the system's coordinates.
    between : callable
        What finds poses in the middle of steps: nothing is believed of them that is not proved.
    steps : sequence of int, optional
        The k that are asked for; by default all.
    """
    t, q = np.asarray(t, float), np.asarray(q, float)
    asked = range(len(t) - 1) if steps is None else sorted({int(k) for k in steps})
    poses = np.array(sorted({*asked, *(k + 1 for k in asked)}), int)  # `np.unique` loads masked arrays: 30 ms
    radii = np.full_like(q, np.nan)
    radii[:, poses] = _error_bounds(system, q[:, poses], t[poses])
    pieces = [Piece(t[k], t[k + 1], q[:, k], q[:, k + 1], radii[:, k], radii[:, k + 1], k) for k in asked]
    proof, first, count = ConnectionProof(system, MOST_TUBES if steps is None else FEW_TUBES, between), 0, FIRST_STEPS
    while first < len(pieces):  # what comes after the first is not worth its proof
        left, meeting = _left(system, pieces[first : first + count], between)
        for p in left:
            if not proof.connects(p.t_0, p.t_1, p.q_0, p.q_1):
                return p.number
        if meeting is not None:
            return meeting
        first, count = first + count, 2 * count
    return None


def step_over_crossing(system: System, t: Any, q: Any, steps: Sequence[int]) -> int | None:
    """Return the k of `steps` for which branches cross between poses k and k + 1, as far as float64 can tell, or None.

    Where they do, no proof needs to be tried.

    Parameters
    ----------
    system : System
    t : (T,) array
        Times [s].
    q : (n, T) array
        The poses there, in the system's coordinates.
    steps : sequence of int
        The numbers k of the steps that are looked at.
    """
    pieces = [Piece(t[k], t[k + 1], q[:, k], q[:, k + 1], None, None, int(k)) for k in steps]
    return _crossing_in(system, pieces) if pieces else None


def _left(system: System, pieces: list[Piece], between: Between) -> tuple[list[Piece], int | None]:
    """Return the pieces that float64 does not prove, in the order of time, up to the first step that meets a crossing.

    The number of that step is the second thing returned, None if there is none.
    """
    left: list[Piece] = []
    steps, looked_at, in_vain, meeting = {p.number: p for p in pieces}, 0, Counter[int](), None
    for _ in range(HALVINGS):
        left += [p for p in pieces if not p.is_certified]
        pieces = [p for p in pieces if p.is_certified]
        looked_at += len(pieces)
        if not pieces or looked_at > MOST_PIECES:
            break
        open_ = [p for p, link in zip(pieces, _linked(system, pieces), strict=True) if not link]
        before, after = (Counter(p.number for p in some) for some in (pieces, open_))
        for number, count in before.items():
            in_vain[number] = in_vain[number] + 1 if after[number] == count else 0
        doubted = [steps[number] for number in sorted(before) if in_vain[number] == DOUBTED]
        if meeting is None and doubted:
            meeting = _crossing_in(system, doubted)
        if meeting is not None:
            open_, left = ([p for p in some if p.number < meeting] for some in (open_, left))
        tired = {p.number: p for p in reversed(open_) if in_vain[p.number] > MOST_IN_VAIN}  # each step's first piece
        given_up = {number for number, p in tired.items() if not _begins(system, p, between)}
        left += [p for p in open_ if p.number in given_up]
        pieces, lost = _halved(system, [p for p in open_ if p.number not in given_up], between)
        left += lost
    return _merged([*left, *pieces]), meeting


def _begins(system: System, p: Piece, between: Between) -> bool:
    """Return whether a piece, halved again and again, begins with one that is proved: smaller ones are not in vain.

    A fine thread on a long arm needs them: what a chord leaves out of the arm's arc turns the screw by far more.
    """
    for _ in range(SMALLER):
        halves, _ = _halved(system, [p], between)
        if not halves or not (p := halves[0]).is_certified:
            return False
        if _linked(system, [p])[0]:
            return True
    return False


def _merged(pieces: list[Piece]) -> list[Piece]:
    """Return pieces in the order of time, with those of one step that follow each other as one."""
    merged: list[Piece] = []
    for p in sorted(pieces, key=lambda p: p.t_0):
        if merged and merged[-1].number == p.number and merged[-1].t_1 == p.t_0:
            merged[-1] = merged[-1]._replace(t_1=p.t_1, q_1=p.q_1, r_1=p.r_1)
        else:
            merged.append(p)
    return merged


def _crossing_in(system: System, steps: list[Piece]) -> int | None:
    """Return the number of the step in which branches cross, as far as float64 can tell; None if in none."""
    for p in (steps[0], steps[len(steps) // 2]):
        t, q = 0.5 * p.t_0 + 0.5 * p.t_1, 0.5 * p.q_0 + 0.5 * p.q_1
        curve = Curve.through(system, q, [t])
        at_crossing = crossing(curve, curve.point(q, t))
        if at_crossing is None or not at_crossing.is_bifurcation:
            continue
        if abs(at_crossing.mu) <= CROSSED * max(1.0, float(np.max(np.abs(at_crossing.x)))):
            at, time = curve.pose(at_crossing.x)
            for step in steps:
                move, off = np.max(np.abs(step.q_1 - step.q_0)), np.max(np.abs(at - step.q_0))
                if off <= 4 * move + BLURRED and step.t_0 <= time <= step.t_1:
                    return step.number
    return None


def _error_bounds(system: System, q: Any, t: Any) -> Any:
    """Return bounds of the error of each coordinate, (n, B), proved in float64; NaN where there are none."""
    if not t.size:
        return q
    proof = certify(system, q, t)
    return np.where(proof.ok, proof.radii, np.nan)


def _halved(system: System, pieces: list[Piece], between: Between) -> tuple[list[Piece], list[Piece]]:
    """Return the pieces cut at a pose found in their middles; and those where none was found."""
    if not pieces:
        return [], []
    t_0, t_1, q_0, q_1 = (np.stack([p[k] for p in pieces], axis=-1) for k in range(4))
    t = (t_0 + t_1) / 2
    q = np.where((t_0 < t) & (t < t_1), _near_chords(system, (t, t_0), q_0, q_1), np.nan)
    for k in np.flatnonzero(np.isnan(q[0])):
        pose = between(system, q_0[:, k], t_0[k], t[k]) if t_0[k] < t[k] < t_1[k] else None
        if pose is not None:
            q[:, k] = pose
    known = np.flatnonzero(np.isfinite(q[0]))
    halves = []
    for k, radius in zip(known, _error_bounds(system, q[:, known], t[known]).T, strict=True):
        halves.append(pieces[k]._replace(t_1=t[k], q_1=q[:, k], r_1=radius))
        halves.append(pieces[k]._replace(t_0=t[k], q_0=q[:, k], r_0=radius))
    return halves, [pieces[k] for k in np.flatnonzero(np.isnan(q[0]))]


def _near_chords(system: System, times: tuple[Any, Any], q_0: Any, q_1: Any) -> Any:
    """Return the poses that Newton finds from the middles of chords; NaN where they are off, or on another side.

    Of redundant rows n that are independent at the first pose are solved: what is found is to be proved anyway.
    """
    (t, t_0), middle = times, (q_0 + q_1) / 2
    q, rows = middle, independent_rows(system, q_0, t_0)
    with np.errstate(all="ignore"):  # what leaves the numbers' range is off
        for _ in range(6):
            inverse = inverses(np.moveaxis(system.phi_q(q, t)[rows], -1, 0))
            q = q - np.einsum("bij,jb->ib", inverse, system.phi(q, t)[rows])
        slopes = (np.moveaxis(system.phi_q(x, at)[rows], -1, 0) for x, at in ((q, t), (q_0, t_0)))
        sides = [np.linalg.slogdet(np.nan_to_num(slope))[0] for slope in slopes]
        off = np.max(np.abs(q - middle), axis=0) <= SAGITTA * np.max(np.abs(q_1 - q_0), axis=0)
    return np.where(off & (sides[0] == sides[1]), q, np.nan)


def _linked(system: System, pieces: list[Piece]) -> Any:
    """Return for each piece whether one tube holds both its poses, (B,)."""
    t_0, t_1, q_0, q_1, r_0, r_1 = (np.stack([p[k] for p in pieces], axis=-1) for k in range(6))
    t, q = (t_0 + t_1) / 2, (q_0 + q_1) / 2
    half = np.maximum(t_1 - t, t - t_0) * UP
    v = (q_1 - q_0) / (t_1 - t_0)
    off = 8 * U * (np.abs(q_0) + np.abs(q_1)) + np.maximum(r_0, r_1)
    tubes = Tubes(system, q, v, t, half, off)
    away = [np.abs((end - q) - v * (at - t)) for end, at in ((q_0, t_0), (q_1, t_1))]
    return tubes.proved & np.all(np.maximum(*away) + off <= 2 * tubes.w, axis=0)
