"""How far the positions of a chain are from the truth, and how far they may be, with sparse matrices.

The budget is that of `crosscheck.judge.budget` for positions, |J^-1| e + rounding. |J^-1| has 4e9 entries for 10,000
loops; so |J^-1| e is taken from below, as the largest |J^-1 (s e)| over some random signs s. What is allowed is then
smaller than it might be, and error / allowed is told too large rather than too small.
"""

from __future__ import annotations

from typing import Any

import numpy as np

from crosscheck.engines.frames import wrap
from crosscheck.judge.budget import SAFETY, handed_over
from crosscheck.judge.of_batches import Accuracy
from crosscheck.judge.running_error import Running, U
from crosscheck.scenes.workloads import Chain
from refkin.system import compile_system
from refkin.vec import BodyValues

SIGNS = 32


def sparse_system(work: Chain) -> Any:
    """Return the chain's `SparseSystem` in its own unit."""
    from refkin.fast import SparseSystem  # here: the fast paths may be absent

    mechanism = work.scene.mechanism
    return SparseSystem(compile_system(mechanism, unit=mechanism.unit()))


def judged(work: Chain, sparse: Any, q: Any) -> Accuracy:
    """Return the accuracy of coordinates q (n,) in metres and radians; `sparse` is the chain's `SparseSystem`."""
    system = sparse.system
    truth = work.truth()[0]
    error = np.asarray(np.asarray(q, np.longdouble) - truth, float)
    error[2::3] = wrap(error[2::3])
    error = np.abs(system.to_unit(error, 1))  # as a rate: a difference has no origin
    error = np.where(np.isfinite(error), error, np.inf)
    part = error / allowed(sparse, system.to_unit(np.asarray(truth, float)), work.scene.times[0])
    return Accuracy(float(np.max(error)), float(np.max(part)), 1)


def allowed(sparse: Any, q: Any, t: float) -> Any:
    """Return the allowed errors of positions (n,) at a solution q (n,), in the system's scaled coordinates."""
    from refkin.fast.sparse import factors  # here: the fast paths may be absent

    e_phi = SAFETY * residual_error(sparse, q, t)
    signs = np.random.default_rng(0).choice([-1.0, 1.0], (len(q), SIGNS))
    lu = factors(sparse.phi_q(q, t))
    carried = np.max(np.abs(np.stack([lu.solve(column * e_phi) for column in signs.T])), axis=0)
    still = np.zeros((len(q), 1))
    return carried + handed_over(sparse.system, q[:, None], still, still)[0][:, 0]


def residual_error(sparse: Any, q: Any, t: float) -> Any:
    """Return the running error (n,) of phi, with coordinates that are rounded to U |q|."""

    def values(start: Any) -> BodyValues:
        if start is None:
            return BodyValues(0.0, 0.0, 0.0)
        return BodyValues(*(Running(q[start + k], U * np.abs(q[start + k])) for k in range(3)))

    out = np.zeros(len(q))
    for group in sparse.groups:
        found = group.formulas.residual(group.g, group.given(None, t, 0), *(values(start) for start in group.starts))
        for row, value in zip(group.rows, found, strict=True):
            out[row] = value.error
    return out
