"""What rounding of a mechanism's numbers does: the error no float64 code can avoid, and rows that contradict."""

from __future__ import annotations

from typing import Any

import numpy as np

from refkin.proof.bounded import UP, Times, U, bounded_system, box, read
from refkin.proof.certificate import Pose, independent_rows, product
from refkin.system import System


def attainable(system: System, q: Any, t: Any, rows: Any = None) -> Any:
    """Return the error (n, B) that any float64 code may have with these inputs, to first order.

    Half an ulp of every number of the geometry, of the time and of the laws' values, carried by |J^-1|, and half an ulp
    of the answer in metres and radians. NaN where phi_q is singular.

    Parameters
    ----------
    system : System
        Compiled in its mechanism's own unit.
    q : (n, B) array
        Poses in the system's coordinates, at the times t (B,).
    rows : (n,) array of int, optional
        The rows that are solved where there are more than n.
    """
    q, t = np.asarray(q, float), np.broadcast_to(np.asarray(t, float), np.shape(q)[1:])
    rows = independent_rows(system, q, t) if rows is None else rows
    with np.errstate(all="ignore"):
        pose = Pose(system, rows, q, t, 0)
        return product(pose.size, input_effect(system, q, t)[rows]) + half_ulp(system, q)


def half_ulp(system: System, q: Any) -> Any:
    """Return half an ulp of coordinates (n, B) as they are in metres and radians, in the system's coordinates.

    It is also the most that `System.to_physical` adds to the error of an answer.
    """
    spacing = np.spacing(np.abs(system.to_physical(q))) / 2
    # A rate of the unit: lengths divided by its size, angles as they are.
    return spacing / system.to_physical(np.ones_like(spacing), order=1)


def input_effect(system: System, q: Any, t: Any) -> Any:
    """Return how far half an ulp of every geometric number, time and law value moves phi, (m, B)."""
    return read(bounded_system(system, input_error=U).phi(box(q), Times(t, 1)), np.shape(q)[1]).spread


def contradiction(system: System, rows: Any, q: Any, t: Any, radii: Any) -> Any:
    """Return the largest |phi| of the rows that were left out, in units of what explains it, (B,).

    Up to 1 the rows are consistent. What explains it: rounding, the proved `radii` (n, B) of q, and half-ulp errors of the mechanism's numbers, in these
    rows and, through the pose, in the rows (n,) that were solved. 0 if no row was left out.
    """
    others = np.setdiff1d(np.arange(system.m), rows)
    if not others.size:
        return np.zeros(np.shape(q)[1])
    with np.errstate(all="ignore"):
        pose = Pose(system, rows, np.asarray(q, float), np.asarray(t, float), 0)
        lanes = pose.q.shape[1]
        phi = read(pose.system.phi(box(pose.q, radii), pose.times)[others], lanes)
        slope = read(pose.system.phi_q(box(pose.q), pose.times)[others], lanes)
        inputs = input_effect(system, pose.q, t)
        moved = product(np.abs(slope.mid), product(pose.size, inputs[rows]))
        explained = UP * (phi.rounding + phi.spread + inputs[others] + moved)
        return np.max(np.abs(phi.mid) / explained, axis=0)
